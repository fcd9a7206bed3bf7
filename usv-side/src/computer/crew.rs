//! Crew orders for deck and course. Each is repeated until the vessel's status names it, but is accepted only once.

use std::collections::VecDeque;

use alight_shared::{
    msg::{CrewOrder, DeckOrder, MAX_ORDERS, Seq},
    time::VesselTime,
    topics,
};

use super::VesselEvent;

/// Newest accepted orders, by which repetitions are recognised.
#[derive(Clone, Debug, Default)]
pub(super) struct CrewOrders(VecDeque<u32>);

impl CrewOrders {
    /// Orders accepted now, and events for those that are too late, because the situation may have changed.
    pub(super) fn take(
        &mut self,
        now: VesselTime,
        orders: &[CrewOrder],
        events: &mut Vec<VesselEvent>,
    ) -> Vec<DeckOrder> {
        let mut counted = Vec::new();
        for CrewOrder { header, order } in orders {
            if self.0.contains(&header.boot) {
                continue;
            }
            if now - header.at > topics::CREW.stale_after {
                events.push(VesselEvent::LateOrder(*order));
                continue;
            }
            if self.0.len() == MAX_ORDERS {
                self.0.pop_front();
            }
            self.0.push_back(header.boot);
            events.push(VesselEvent::DeckOrder(*order));
            counted.push(*order);
        }
        counted
    }
    pub(super) fn taken(&self) -> Seq<u32, MAX_ORDERS> {
        Seq::filled(self.0.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};

    #[test]
    fn crew_orders_taken_once_and_in_time() {
        let mut orders = CrewOrders::default();
        let mut events = Vec::new();
        let given = |boot, at_s| CrewOrder {
            header: Header::new(1, 0, boot, 0, Time::from_secs(at_s)),
            order: DeckOrder::Closed,
        };
        let now = Time::from_secs(100.0);
        let mut take = |all: &[CrewOrder]| orders.take(now, all, &mut events).len();
        assert_eq!(take(&[given(1, 99.0), given(1, 99.0)]), 1);
        assert_eq!(
            take(&[given(3, 99.5), given(1, 99.0)]),
            1,
            "a repetition after a later one"
        );
        assert_eq!(
            take(&[given(2, 100.0 - topics::CREW.stale_after.secs() - 0.1)]),
            0
        );
        assert_eq!(orders.taken()[..], [1, 3]);
        let late = events.pop().map(|e| (e.is_warning(), e.to_string()));
        let text = "crew order: deck closed: too late and rejected: give it again";
        assert_eq!(late, Some((true, text.to_owned())));
        assert_eq!(events.len(), 2);
        // Earlier orders, however many, do not displace the newest ones.
        let many: Vec<_> = (10..10 + 2 * MAX_ORDERS as u32)
            .map(|boot| given(boot, 99.0))
            .collect();
        let mut take = |all: &[CrewOrder]| orders.take(now, all, &mut events).len();
        assert_eq!(take(&many), many.len());
        assert_eq!(take(&many[MAX_ORDERS..]), 0);
    }
}

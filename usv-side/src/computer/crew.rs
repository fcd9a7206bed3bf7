//! The crew's orders for deck and course: each is repeated until the vessel's status names it, and taken once.

use std::collections::VecDeque;

use alight_shared::msg::{CrewOrder, DeckOrder, MAX_ORDERS, Seq};
use alight_shared::time::{Time, VesselClock};
use alight_shared::topics;

use super::VesselEvent;

/// The orders that were taken last: a repetition is none of its own.
#[derive(Clone, Debug, Default)]
pub(super) struct CrewOrders(VecDeque<u32>);

impl CrewOrders {
    /// What of these counts now, and what the crew is to know of the others. One that is taken up late would be a wrong one.
    pub(super) fn take(
        &mut self,
        now: Time<VesselClock>,
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
    /// The receipt.
    pub(super) fn taken(&self) -> Seq<u32, MAX_ORDERS> {
        Seq::filled(self.0.iter().copied())
    }
}

//! Crew's orders for deck and course, sent from a command or a page on the vessel's computer to the vessel's process,
//! and repeated until its status confirms them.

use std::time::Duration;

use alight_shared::{
    admission::Retransmission,
    msg::{CrewOrder, DeckOrder, Header, VesselStatus},
    time::{SteadyClock, Time},
    topics,
};
use alight_transport::{
    TransportError,
    clock::steady_ns,
    memory::{Memory, Publisher, Subscriber},
};

use crate::{config::VesselComputerConfig, process::life::draw_boot};

const POLL_PERIOD: Duration = Duration::from_millis(50);

fn steady() -> Time<SteadyClock> {
    Time::from_nanos(steady_ns())
}

pub struct OrderOnItsWay {
    order: Retransmission<SteadyClock, CrewOrder>,
    orders: Publisher<CrewOrder>,
    statuses: Subscriber<VesselStatus>,
}

impl OrderOnItsWay {
    /// Begins to send an order to the vessel's process on this computer.
    pub fn give(
        memory: &Memory,
        computer: &VesselComputerConfig,
        order: DeckOrder,
    ) -> Result<OrderOnItsWay, TransportError> {
        let header = Header::new(computer.vessel_id, 0, draw_boot(), 0, computer.clock.now());
        Ok(OrderOnItsWay {
            order: Retransmission::new(CrewOrder { header, order }, steady(), topics::CREW_RETRIES),
            orders: memory.publisher()?,
            statuses: memory.subscriber()?,
        })
    }
    /// Sends the order when due; returns the status that confirms it.
    pub fn poll(&mut self) -> Option<VesselStatus> {
        let names_it = |s: &VesselStatus| s.orders.contains(&self.order.message.header.boot);
        let answer = self.statuses.newest(steady_ns()).filter(names_it);
        if answer.is_none() {
            self.orders.send_any(self.order.due(steady()).as_ref());
        }
        answer
    }
    pub fn is_over(&self) -> bool {
        self.order.is_over(steady())
    }
    /// Waits for the status that confirms the order; None if the order was not accepted in time or a signal ended the
    /// wait.
    pub fn wait(mut self, memory: &Memory) -> Option<VesselStatus> {
        loop {
            let answer = self.poll();
            if answer.is_some() || self.is_over() || !memory.wait(POLL_PERIOD) {
                return answer;
            }
        }
    }
}

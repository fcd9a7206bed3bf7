//! Operator ashore, who repeats a command by radio until the vessel sends its receipt, as `alight order` does.

use super::{
    physics::{BOOT, DRONE_ID, VESSEL_ID},
    scenario::Scenario,
};
use crate::{physics::streams::Streams, radio::Session};
use alight_bridge::Packet;
use alight_shared::{
    admission::{Retransmission, Sender},
    msg::{CommandKind, CommandReceipt, Header, OperatorCommand},
    radio::RadioTopic,
    time::{Time, TrueTime, VesselClock, WorldTime},
    topics::ASHORE_RETRIES,
    wire,
};

pub(super) struct Ashore {
    /// Link to the vessel; the operator is at the drone's end of the session.
    pub(super) radio: Session<Packet>,
    sequence: u32,
    open: Vec<Retransmission<TrueTime, OperatorCommand<VesselClock>>>,
}

impl Ashore {
    pub(super) fn new(scenario: &Scenario, streams: &Streams) -> Ashore {
        Ashore {
            // Streams of one more drone: this link is independent of the drones'.
            radio: Session::new(&scenario.radio, &streams.of_drone(scenario.drones as usize)),
            sequence: 0,
            open: Vec::new(),
        }
    }
    /// Replaces the drone's previous command, if that has no receipt yet.
    pub(super) fn command(&mut self, t: WorldTime, k: usize, kind: CommandKind) {
        self.sequence += 1;
        let header = Header::new(VESSEL_ID, DRONE_ID + k as u32, BOOT, self.sequence, Time::EPOCH);
        let order = OperatorCommand { header, kind };
        self.open.retain(|o| o.message.header.drone != header.drone);
        self.open.push(Retransmission::new(order, t, ASHORE_RETRIES));
    }
    /// Reads receipts, then sends the commands that are due.
    pub(super) fn tick(&mut self, t: WorldTime) {
        for (_, packet) in self.radio.at_drone(t) {
            if packet.kind == RadioTopic::Receipts
                && let Ok(receipt) = wire::decode::<CommandReceipt>(&packet.bytes)
            {
                let is_other = |h: &Header<VesselClock>| receipt.operator != [h.boot, h.sequence];
                self.open.retain(|o| is_other(&o.message.header));
            }
        }
        for order in &mut self.open {
            if let Some(Ok(bytes)) = order.due(t).map(|order| wire::encode(&order)) {
                let kind = RadioTopic::Order;
                let sender = Sender::Operator(1);
                self.radio
                    .send_to_vessel(t, bytes.len(), Packet { kind, sender, bytes });
            }
        }
    }
}

//! Topics of the radio between the computers, with sender, reader, urgency, and whether the newest message is held.

use serde::{Deserialize, Serialize};

use crate::{
    topics::{self, Topic},
    wire,
};

/// Kind of computer at one end of the radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioEnd {
    /// A vessel's computer.
    Vessel,
    /// A drone's computer.
    Drone,
    /// An operator ashore.
    Operator,
}

/// Urgency of a topic's messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Urgency {
    /// Orders: sent first, from a separate queue.
    Order,
    /// State and time.
    State,
    /// Models and predictions.
    Model,
    /// Display data.
    Status,
}

/// Topic with its direction on the radio.
#[derive(Clone, Copy, Debug)]
pub struct RadioRow {
    /// Topic that is sent.
    pub topic: &'static Topic,
    /// Sender.
    pub from: RadioEnd,
    /// Readers.
    pub to: RadioEnd,
    /// Urgency of the messages.
    pub urgency: Urgency,
    /// The sender holds the newest message for computers that join later, because it is sent rarely.
    pub held: bool,
}

macro_rules! radio {
    ($($name:ident: $topic:ident, $from:ident => $to:ident, $urgency:ident $(, $held:ident)?;)*) => {
        /// Topic of the radio.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum RadioTopic {
            $(#[doc = concat!("[`topics::", stringify!($topic), "`].")] $name,)*
        }
        impl RadioTopic {
            /// All radio topics.
            pub const ALL: &[RadioTopic] = &[$(RadioTopic::$name),*];
            /// Number of topics that a vessel's computer sends, the most of all senders.
            pub(crate) const MAX_SENT: usize = {
                let mut sent = [0; 3];
                $(sent[RadioEnd::$from as usize] += 1;)*
                let [vessel, drone, operator] = sent;
                assert!(vessel >= drone && vessel >= operator);
                vessel
            };
            /// Row of this topic in the table.
            pub const fn row(self) -> RadioRow {
                match self {
                    $(RadioTopic::$name => RadioRow {
                        topic: &topics::$topic,
                        from: RadioEnd::$from,
                        to: RadioEnd::$to,
                        urgency: Urgency::$urgency,
                        held: {
                            let held: &[&str] = &[$(stringify!($held))?];
                            !held.is_empty()
                        },
                    },)*
                }
            }
            /// Passes each encoded message to `send`. One that cannot be encoded is not sent; the receiver
            /// detects the gap.
            pub fn encode_each<'a, M: Serialize + 'a>(
                self,
                messages: impl IntoIterator<Item = &'a M>,
                mut send: impl FnMut(RadioTopic, Vec<u8>),
            ) {
                for bytes in messages.into_iter().filter_map(|m| wire::encode(m).ok()) {
                    send(self, bytes);
                }
            }
        }
    };
}
// Step records refer to topics by position: append new ones at the end.
radio! {
    Estimate: ESTIMATE, Vessel => Drone, State;
    Wave: WAVE, Vessel => Drone, Model, held;
    Prediction: PREDICTION, Vessel => Drone, Model;
    TimeReply: TIME_REPLY, Vessel => Drone, State;
    Deck: DECK, Vessel => Drone, State;
    Surroundings: SURROUNDINGS, Vessel => Drone, State, held;
    Rtcm: RTCM, Vessel => Drone, Model;
    Command: OPERATOR, Vessel => Drone, Order;
    Process: VESSEL_PROCESS, Vessel => Drone, Status;
    Drones: DRONES, Vessel => Operator, Status;
    Receipts: RECEIPTS, Vessel => Operator, State;
    TimeRequest: TIME_REQUEST, Drone => Vessel, State;
    Status: DRONE_STATUS, Drone => Vessel, Status;
    Order: OPERATOR, Operator => Vessel, Order;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::Medium;

    #[test]
    fn senders_of_every_radio_topic() {
        let sent: Vec<&str> = RadioTopic::ALL.iter().map(|t| t.row().topic.name).collect();
        for topic in topics::ALL.iter().filter(|t| t.medium == Medium::Radio) {
            assert!(sent.contains(&topic.name), "{} has no sender", topic.name);
        }
    }
}

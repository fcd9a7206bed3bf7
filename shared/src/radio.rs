//! The radio between the computers: its topics, each declared once with sender, reader, urgency, and whether a computer that
//! joins later is given the newest.

use serde::{Deserialize, Serialize};

use crate::topics::{self, Topic};

/// Kind of computer at an end of the radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioEnd {
    /// A vessel's computer.
    Vessel,
    /// A drone's.
    Drone,
    /// Operators ashore.
    Operator,
}

/// Urgency of a topic's messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Urgency {
    /// Orders: before everything else, in a queue of their own.
    Order,
    /// State and time.
    State,
    /// Models and predictions.
    Model,
    /// For people.
    Status,
}

/// A topic on its way.
#[derive(Clone, Copy, Debug)]
pub struct RadioRow {
    /// The topic.
    pub topic: &'static Topic,
    /// Sender.
    pub from: RadioEnd,
    /// Readers.
    pub to: RadioEnd,
    /// Urgency of the messages.
    pub urgency: Urgency,
    /// The sender holds the newest for computers that join later, as it is broadcast seldom.
    pub held: bool,
}

macro_rules! radio {
    ($($name:ident: $topic:ident, $from:ident => $to:ident, $urgency:ident $(, $held:ident)?;)*) => {
        /// A topic of the radio.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum RadioTopic {
            $(#[doc = concat!("[`topics::", stringify!($topic), "`].")] $name,)*
        }
        impl RadioTopic {
            /// All of them.
            pub const ALL: &[RadioTopic] = &[$(RadioTopic::$name),*];
            /// The row of the table.
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
        }
    };
}
// Records of steps name the vessel's topics for drones by their place: a new one stands at the end.
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
            assert!(sent.contains(&topic.name), "{} is sent by none", topic.name);
        }
    }
}

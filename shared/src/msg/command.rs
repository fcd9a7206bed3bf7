//! Operator commands and their receipts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, Station};
use crate::time::{Clock, DroneClock, Time, VesselClock};

/// Kind of an operator command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum CommandKind {
    /// Land on the vessel.
    #[default]
    Land,
    /// Abort the landing, climb and hold; overrides every other command. If the deck would strike a climbing
    /// drone harder than a landing one, the drone completes the landing.
    Abort,
    /// Hold at the present position, but not below the tracking height above the deck.
    Hold,
    /// Take off from the deck, climb to approach height and hold.
    TakeOff,
    /// Confirm that the drone is ready for its next sortie (unattended cycles).
    Ready,
    /// Keep this position next to the vessel for a limited time.
    Station(Station),
}

/// Command to the mission.
pub type Command = OperatorCommand<DroneClock>;

/// Command for the drone named in the header, passed from the operator to the vessel, the drone and the mission.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct OperatorCommand<C: Clock> {
    /// Identity and time of the command.
    pub header: Header<C>,
    /// Kind of the command.
    pub kind: CommandKind,
}

message!(@C OperatorCommand<C>, C, |m| {
    m.kind.is_sane() => "kind",
});
restamped!(OperatorCommand { kind });

/// Progress of an operator command at the vessel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "snake_case")]
pub enum CommandProgress {
    /// Repeated until the drone acknowledges it; an abort is repeated without limit.
    #[default]
    Pending,
    /// Acknowledged and accepted by the drone.
    Taken,
    /// Rejected by the drone, or not acknowledged in time.
    GivenUp,
    /// Not forwarded: an abort, possibly unknown to this operator, was pending or had just been given.
    Forbidden,
    /// Replaced by a newer command for the drone.
    Replaced,
    /// Received before a restart of the vessel's process, and no longer repeated.
    Unknown,
}

/// Receipt for one operator command.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CommandReceipt {
    /// Identity of the vessel, the addressed drone, and the time of this progress.
    pub header: Header<VesselClock>,
    /// Boot and sequence number of the operator's message, which differ from those of the vessel's repetitions.
    pub operator: [u32; 2],
    /// Kind of the command.
    pub kind: CommandKind,
    /// Progress of the command.
    pub progress: CommandProgress,
}

message!(CommandReceipt, VesselClock, |m| {});

impl CommandKind {
    fn is_sane(self) -> bool {
        match self {
            CommandKind::Station(station) => station.is_sane(),
            CommandKind::Land
            | CommandKind::Abort
            | CommandKind::Hold
            | CommandKind::TakeOff
            | CommandKind::Ready => true,
        }
    }
}

//! Commands of an operator, and their receipts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, Station};
use crate::time::{Clock, DroneClock, Time, VesselClock};

/// Command of an operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum CommandKind {
    /// Land on the vessel.
    #[default]
    Land,
    /// Stop landing, climb and hold; always wins. Where a climb would meet the deck harder
    /// than the landing does, that is completed.
    Abort,
    /// Hold where you are (not below the tracking height over the deck).
    Hold,
    /// Take off from the deck, climb to the height of the approach and hold there.
    TakeOff,
    /// In unattended cycles: the drone is ready for its next sortie.
    Ready,
    /// Keep this place next to the vessel for a while.
    Station(Station),
}

/// A command to the mission.
pub type Command = OperatorCommand<DroneClock>;

/// A command for the drone that its header names: from an operator to the vessel, from the vessel to the drone, and to
/// the mission.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct OperatorCommand<C: Clock> {
    /// Identity, and time it was given.
    pub header: Header<C>,
    /// Kind of the command.
    pub kind: CommandKind,
}

message!(@C OperatorCommand<C>, C, |m| {
    m.kind.is_sane() => "kind",
});
restamped!(OperatorCommand { kind });

/// Progress of an operator's command at the vessel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "snake_case")]
pub enum CommandProgress {
    /// Repeated to the drone, which has not shown that it has taken it: an abort for as long as that takes.
    #[default]
    Pending,
    /// The drone's status echoes it, and does not reject it.
    Taken,
    /// The drone rejects it, or did not take it in time.
    GivenUp,
    /// Not passed on: an abort that the operator may not know of was pending, or given just before.
    Forbidden,
    /// A newer command for the drone came.
    Replaced,
    /// Known from before a restart of the vessel, and not repeated any more.
    Unknown,
}

/// Receipt of one command of an operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CommandReceipt {
    /// Identity of the vessel, the drone that the command is for, and the time of this progress.
    pub header: Header<VesselClock>,
    /// Boot and sequence of the operator's message: the vessel's own repetitions have others.
    pub operator: [u32; 2],
    /// Kind of the command.
    pub kind: CommandKind,
    /// Progress of the command.
    pub progress: CommandProgress,
}

message!(CommandReceipt, VesselClock, |m| {});

impl CommandKind {
    /// Whether the station that it names is within bounds.
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

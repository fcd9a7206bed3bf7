//! Checkpoints: what of a node outlives its process, so that a successor goes on where a crashed predecessor was. A node
//! publishes its checkpoint as it runs; a successor waits for the newest one and validates it before it counts.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::msg::{MESSAGE_VERSION, Message};
use crate::time::{DroneClock, Span, Time};

/// A successor waits so long for an answer: 15 periods of its keeper.
const TIMEOUT: Span = Span::from_millis(300);
/// A checkpoint may lie so far ahead of its reader's clock.
const AHEAD: Span = Span::from_millis(50);

/// Why a checkpoint does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CheckpointRejection {
    /// Another layout.
    Version,
    /// Another drone's.
    OtherDrone,
    /// Too old, or from the future.
    Age,
    /// A number in it is none that its writer writes.
    Damaged,
}

impl fmt::Display for CheckpointRejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            CheckpointRejection::Version => "of another version",
            CheckpointRejection::OtherDrone => "another drone's",
            CheckpointRejection::Age => "too old",
            CheckpointRejection::Damaged => "damaged",
        })
    }
}

/// A node that begins waits for the checkpoint of a crashed predecessor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recovery<M> {
    since: Option<Time<DroneClock>>,
    /// The keeper's answer.
    answer: Option<M>,
}

impl<M: Message<Clock = DroneClock> + Copy> Recovery<M> {
    /// Takes the checkpoint that the node with this `boot` is `given`; true once the keeper has answered, or the wait is
    /// over.
    pub fn poll(&mut self, now: Time<DroneClock>, boot: u32, given: Option<&M>) -> bool {
        self.answer = given.filter(|m| m.header().boot != boot).copied().or(self.answer);
        self.answer.is_some() || self.waited(now) >= TIMEOUT
    }
    /// Time since the first poll.
    pub fn waited(&mut self, now: Time<DroneClock>) -> Span {
        now - *self.since.get_or_insert(now)
    }
    /// The predecessor's checkpoint, not yet validated; None where the keeper has none (boot 0).
    pub fn checkpoint(&self) -> Option<M> {
        self.answer.filter(|m| m.header().boot != 0)
    }
}

/// Whether `m` counts at `now` for drone `drone`, where one older than `max_age` does not.
pub fn validate(
    now: Time<DroneClock>,
    drone: u32,
    max_age: Span,
    m: &impl Message<Clock = DroneClock>,
) -> Result<(), CheckpointRejection> {
    let h = m.header();
    if h.version != MESSAGE_VERSION {
        return Err(CheckpointRejection::Version);
    }
    if h.drone != drone {
        return Err(CheckpointRejection::OtherDrone);
    }
    if now - h.at < -AHEAD || now - h.at > max_age {
        return Err(CheckpointRejection::Age);
    }
    m.check().map_err(|_field| CheckpointRejection::Damaged)
}

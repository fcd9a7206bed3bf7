//! What a node was told of the one before it, whose process ended in flight: judged before it counts.

use core::fmt;

use alight_shared::msg::{MESSAGE_VERSION, Message};
use alight_shared::time::{DroneClock, Span, Time};
use serde::{Deserialize, Serialize};

/// A node that begins waits so long for the memory of the one before it: six periods of who keeps it, and more.
const WAIT: Span = Span::from_millis(300);
/// A memory may lie so far ahead of its reader's clock.
const AHEAD: Span = Span::from_millis(50);

/// Why a memory does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MemoryRefusal {
    /// Another layout.
    Version,
    /// Another drone's.
    OtherDrone,
    /// Too old, or from the future.
    Age,
    /// A number in it is none that its writer writes.
    Damaged,
}

impl fmt::Display for MemoryRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            MemoryRefusal::Version => "of another version",
            MemoryRefusal::OtherDrone => "another drone's",
            MemoryRefusal::Age => "too old",
            MemoryRefusal::Damaged => "damaged",
        })
    }
}

/// The memory of the one before, for which a node asks at its beginning.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Predecessor<M> {
    since: Option<Time<DroneClock>>,
    /// Who keeps the memory has answered, with this.
    answer: Option<M>,
}

impl<M: Message<Clock = DroneClock> + Copy> Predecessor<M> {
    /// Takes what its keeper says to the node with this `boot`; whether the keeper has answered, or will not any more.
    pub(crate) fn ask(&mut self, now: Time<DroneClock>, boot: u32, given: Option<&M>) -> bool {
        self.answer = given.filter(|m| m.header().boot != boot).copied().or(self.answer);
        self.answer.is_some() || self.waited(now) >= WAIT
    }
    /// Since the node asked first.
    pub(crate) fn waited(&mut self, now: Time<DroneClock>) -> Span {
        now - *self.since.get_or_insert(now)
    }
    /// What the one before left, to be judged; boot 0: who keeps it has nothing.
    pub(crate) fn left(&self) -> Option<M> {
        self.answer.filter(|m| m.header().boot != 0)
    }
}

/// Whether `m` counts at `now` for drone `drone`, where one older than `max_age` does not.
pub(crate) fn judge(
    now: Time<DroneClock>,
    drone: u32,
    max_age: Span,
    m: &impl Message<Clock = DroneClock>,
) -> Result<(), MemoryRefusal> {
    let h = m.header();
    if h.version != MESSAGE_VERSION {
        return Err(MemoryRefusal::Version);
    }
    if h.drone != drone {
        return Err(MemoryRefusal::OtherDrone);
    }
    if now - h.at < -AHEAD || now - h.at > max_age {
        return Err(MemoryRefusal::Age);
    }
    m.check().map_err(|_field| MemoryRefusal::Damaged)
}

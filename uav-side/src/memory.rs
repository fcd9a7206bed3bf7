//! What a node was told of the one before it, whose process ended in flight: judged before it counts.

use core::fmt;

use alight_shared::msg::{MESSAGE_VERSION, Message};
use alight_shared::time::{DroneClock, Span, Time};
use serde::{Deserialize, Serialize};

/// A node that begins waits so long for the memory of the one before it: six periods of who keeps it, and more.
pub(crate) const WAIT: Span = Span::from_millis(300);
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

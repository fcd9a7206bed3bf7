//! The flight recorder: each process writes the steps of its node to MCAP files of its own, always.
//!
//! A flight is what one start of a computer's processes records: a directory, named by date and time (UTC) and a
//! number that counts the flights of the computer:
//!
//! | file | holds |
//! |---|---|
//! | `pilot-0123abcd-001.mcap` | a part: steps of one start (boot id) of a process, its configuration attached |
//! | `flight.json` | the summary: phases, outcome, figures ([`summary`]) |
//!
//! A step is the time, the whole input and a hash of the output of a node ([`super::entry::Entry`]), its MCAP sequence number
//! counts the steps of the start. The parts of a start are computed again one after the other, and need no other
//! process's.
//!
//! [`recorder`] is what a process holds: it never waits for the disk. [`parts`] writes, on a thread of its own, chunk by
//! chunk and synchronised every second, so that a power cut costs less than 2 s. [`keeper`] writes the summary and
//! removes the oldest flights. [`store`] finds flights, [`super::reading`] reads parts, also those without an end, and
//! [`mend`] gives them one.

pub mod keeper;
pub mod mend;
mod parts;
pub mod recorder;
pub mod store;
pub mod summary;

/// Disk that recording leaves to the rest of the computer, bytes: the deck's state lies on it.
const MIN_FREE_BYTES: u64 = 256 << 20;

/// Bytes that whoever is not root may still write below `directory`; None where the system does not report it.
fn free_bytes(directory: &std::path::Path) -> Option<u64> {
    let found = rustix::fs::statvfs(directory).ok()?;
    Some(found.f_bavail.saturating_mul(found.f_frsize))
}

/// The calling thread comes after everything that flies; those that it starts, too.
fn yield_to_flight() {
    /// Above that of a process without a wish of its own.
    const NICENESS: i32 = 5;
    // Less priority is always permitted.
    let _unchanged = rustix::process::setpriority_process(None, NICENESS);
}

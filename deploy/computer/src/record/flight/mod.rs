//! The flight recorder: each process writes the steps of its node to its own MCAP files, always.
//!
//! A flight is the record of one start of a computer's processes: a directory, named by date and time (UTC) and the
//! computer's flight number:
//!
//! | file | holds |
//! |---|---|
//! | `pilot-0123abcd-001.mcap` | a part: steps of one start (boot id) of a process, its configuration attached |
//! | `flight.json` | the summary: phases, outcome, figures ([`summary`]) |
//!
//! A step holds a node's time, its whole input and a hash of its output ([`super::entry::Entry`]); its MCAP
//! sequence number counts the steps of the start. The parts of a start are replayed in sequence, without
//! other processes.
//!
//! A process holds a [`recorder`], which never waits for the disk. [`parts`] writes on a separate thread, chunk by
//! chunk, and synchronises every second, so that a power cut costs less than 2 s. [`recording`] writes the summary and
//! removes the oldest flights. [`store`] finds flights, [`super::reading`] reads parts, including those without an end,
//! and [`mend`] adds the end.

pub mod mend;
mod parts;
pub mod recorder;
pub mod recording;
pub mod store;
pub mod summary;

/// Disk space that recording leaves free, bytes: the deck's state is on the same disk.
const MIN_FREE_BYTES: u64 = 256 << 20;

/// Bytes that users other than root can still write below `directory`; None if the system does not report it.
fn free_bytes(directory: &std::path::Path) -> Option<u64> {
    let found = rustix::fs::statvfs(directory).ok()?;
    Some(found.f_bavail.saturating_mul(found.f_frsize))
}

/// Lowers the priority of this thread and its later children below the processes of flight.
fn yield_to_flight() {
    const NICENESS: i32 = 5;
    let _unchanged = rustix::process::setpriority_process(None, NICENESS);
}

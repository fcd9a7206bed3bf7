//! Interface of all computing nodes, `step(now, &In) -> Out`.

use crate::time::{Clock, Time};

/// A node computes: it never waits, reads a clock, opens a socket or draws an unseeded random number. It runs
/// in the lock-step world and as an operating-system process.
pub trait Node {
    /// Clock of the node's computer.
    type Clock: Clock;
    /// Input since the last step: state streams are `Option` (newest value, if any), event streams are `Vec`.
    type In;
    /// Output of a step.
    type Out;

    /// Processes the input at the node's own time `now`, which never decreases.
    fn step(&mut self, now: Time<Self::Clock>, input: &Self::In) -> Self::Out;
}

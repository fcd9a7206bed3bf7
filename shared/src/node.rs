//! Node: the one interface of everything that computes, `step(now, &In) -> Out`.

use crate::time::{Clock, Time};

/// A node computes: it never waits, reads a clock, opens a socket or draws an unseeded random
/// number. The same node runs in the lock-step world and as an operating-system process.
pub trait Node {
    /// The clock of the computer it runs on.
    type Clock: Clock;
    /// Input that arrived since the last step. State streams are `Option` (the newest, if any arrived),
    /// event streams are `Vec`.
    type In;
    /// Output of a step.
    type Out;

    /// Consumes what arrived, at the node's own time `now`. `now` never goes back.
    fn step(&mut self, now: Time<Self::Clock>, input: &Self::In) -> Self::Out;
}

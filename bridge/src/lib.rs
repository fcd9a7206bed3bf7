//! Drone's end of the radio: admission of the vessel's messages, clock offset, link statistics.
//!
//! Pure: packets in, messages on the drone's clock out; the sockets belong to the process around
//! it. Read [`node`] first: [`node::Bridge`]'s `step` is the whole way of a packet. [`order`]
//! is the order of messages, `status` the drone's status for the vessel, [`clock`] finds the offset of the two clocks, [`link`] keeps the
//! statistics.

pub mod clock;
pub mod config;
pub mod link;
pub mod node;
pub mod order;
mod status;
#[cfg(test)]
mod tests;

pub use config::{BridgeConfig, ClockConfig};
pub use node::{Bridge, BridgeIn, BridgeOut, BridgePorts, Packet};

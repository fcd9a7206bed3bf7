//! The drone's radio end: admission of the vessel's messages, clock offset, link statistics.
//!
//! The crate is pure: packets in, messages on the drone's clock out; its process owns the sockets. Start with
//! [`node`]: [`node::Bridge`]'s `step` processes a packet. [`order`] keeps messages in order, `status`
//! assembles the drone's status, [`clock`] estimates the offset, [`link`] keeps the statistics.

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

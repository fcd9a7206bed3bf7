//! True sea, vessel and drones, and their contact with the deck, driven by the seed's random streams.

pub mod body;
pub mod deck_motion;
pub mod drone;
pub mod sea;
pub mod spline;
pub mod streams;
pub mod vessel;

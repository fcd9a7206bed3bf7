//! The vessel's side of Alight: sensors to estimate, identification of the sea, broadcast.

pub mod sea_state;

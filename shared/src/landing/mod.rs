//! The probability that a landing succeeds: one meaning for the drone, which judges the next contact by its forecast, and for
//! the vessel, which compares courses by the sea that it measures.
//!
//! A good landing meets the limits of [`Limit`]: the speed onto the deck and along it, the angle between drone and deck, four
//! feet inside the edges, and staying where it stands.

mod contact;
pub mod normal;
mod odds;
mod staying;
mod wind;

pub use contact::{BLIND_S, CONTACT_MPS, Contact, Margins, REACTION_S, alignment_mps};
pub use odds::{Limit, MAX_ODDS, Odds};
pub use staying::{Slopes, Stand, Staying, needed_hold_n};
pub use wind::{DRAG_PER_M, LINEAR_MPS, TURBULENCE, WindPush, beyond_aligned, drag, wind_during_alignment};

/// The limits of a good contact (trials are judged by the same): speeds, m/s, and angle, rad.
pub const MAX_MPS: f64 = 1.0;
/// The limit of the angle between the normals of drone and deck, rad.
pub const MAX_TILT_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// Coefficient of friction between feet and deck, wet.
pub const FRICTION: f64 = 0.4;
/// Cost of waiting a minute, as a probability of a landing: battery and crew.
pub const WAITING_COST_PER_MIN: f64 = 0.1;

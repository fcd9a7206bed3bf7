//! Probability that a landing succeeds, defined once for the drone, which forecasts its next contact, and for
//! the vessel, which compares courses in the measured sea.
//!
//! A good landing meets every [`Limit`]: speed onto and along the deck, angle, four feet inside, rest.

mod contact;
pub mod normal;
mod odds;
mod staying;
mod wind;

pub use contact::{BLIND_S, CONTACT_MPS, Contact, Margins, REACTION_S, alignment_mps};
pub use odds::{Limit, MAX_ODDS, Odds};
pub use staying::{Slopes, Staying, SupportPolygon, needed_hold_n};
pub use wind::{DRAG_PER_M, LINEAR_MPS, TURBULENCE, WindPush, beyond_aligned, drag, wind_during_alignment};

/// Limit of the contact speeds, m/s; trials use the same limits.
pub const MAX_MPS: f64 = 1.0;
/// Limit of the angle between the normals of drone and deck, rad.
pub const MAX_TILT_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// Coefficient of friction between the feet and a wet deck.
pub const FRICTION: f64 = 0.4;
/// Cost of waiting for a minute in battery and crew time, expressed as a probability of landing.
pub const WAITING_COST_PER_MIN: f64 = 0.1;

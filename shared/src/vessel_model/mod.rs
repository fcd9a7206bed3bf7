//! Wave-augmented linear model for the vessel's estimator (Procházka et al. 2024, eq. 1-3; Fossen 2011,
//! chapters 7 and 8), and the [`modes`] of its motion for vessel and drone.
//!
//! ```text
//! M nu_dot + D (nu - nu_slow) + G (eta - eta_slow) = G_s (sum_j w_j + b) + M_f (sum_j w_j + b)
//! w_j'' + 2 lambda_j omega_j w_j' + omega_j^2 w_j = white noise of density `drive`
//! ```
//!
//! No actuator inputs. Degrees of freedom: surge, sway, heave, roll, pitch, yaw. `w_j` is the oscillator of
//! component `j`, one per degree of freedom, with a common frequency.
//!
//! **Normalisation.** A degree of freedom with stiffness (`G_ii > 0`: heave, roll, pitch) is *stiff*: its
//! `w_j` is an equilibrium position (m, rad), multiplied by G. For the others (surge, sway, yaw) `w_j` is an
//! acceleration (m/s², rad/s²), multiplied by M. A small boat follows the water, so the oscillators of heave,
//! roll and pitch nearly equal the motion.
//!
//! **State per degree of freedom** (`slot`): [`ETA`], [`NU`] (its rate), [`SLOW`] (stiff: mean level or trim; free:
//! mean velocity, a random walk), [`DISTURBANCE`] (first-order Markov, in the units of `w`: residual of the
//! components), then additional states (sensor biases), then `[value, rate]` per component ([`Layout::value`],
//! [`Layout::rate`]).
//!
//! **Frame.** Vessel-parallel at a *reference heading*, stored by the owner of the [`Belief`]: the state is linear in
//! a frame rotated from NED by this heading, and [`Belief::turn`] rotates the state when the heading changes. At a
//! reference heading of zero the state is in NED, as are the [`Modes`]; roll and pitch are then those of a vessel
//! that heads north with the same deck normal ([`turn_tilt`]).
//!
//! Typical use: [`VesselModel::with_bank`], [`Belief::new`], then [`Belief::propagate`] by a [`BeliefStep`]
//! per step and [`Belief::update`] per scalar measurement.

mod belief;
mod config;
mod expm;
mod model;
mod modes;
#[cfg(test)]
mod tests;

pub use belief::{Belief, BeliefSpec, BeliefStep, Extra, Layout, Term};
pub use config::{Coupling, VesselModelConfig};
pub use expm::{expm, van_loan};
pub use model::{Component, Discrete, VesselModel, turn_tilt};
pub use modes::{Mode, Modes, Motion};

/// Number of degrees of freedom.
pub const DOFS: usize = 6;
/// Surge, positive forward in the reference-parallel frame.
pub const SURGE: usize = 0;
/// Sway, positive to starboard.
pub const SWAY: usize = 1;
/// Heave, positive down.
pub const HEAVE: usize = 2;
/// Roll, positive starboard down.
pub const ROLL: usize = 3;
/// Pitch, positive bow up.
pub const PITCH: usize = 4;
/// Yaw, positive clockwise from above.
pub const YAW: usize = 5;

/// Slot of the position or angle (m, rad).
pub const ETA: usize = 0;
/// Slot of the rate (m/s, rad/s).
pub const NU: usize = 1;
/// Slot of the mean level (stiff: m, rad) or mean velocity (free: m/s, rad/s).
pub const SLOW: usize = 2;
/// Slot of the disturbance, in the units of the wave oscillators.
pub const DISTURBANCE: usize = 3;
/// Number of slots before the additional states.
pub const HEAD: usize = 4;

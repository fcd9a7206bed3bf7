//! Identification of the sea from the vessel's own motion.
//!
//! The vessel is a wave buoy: the vertical acceleration and the tilt of its deck hold, for every
//! wave component, the same frequency. The last minute of them is modelled as
//!
//! ```text
//! y_c(t) = o_c + s_c t + sum_j Re( A_cj exp(i phi_j(t)) ),   phi_j(t) = omega_j t - k_j d_j . x(t)
//! ```
//!
//! with channels `c` (acceleration upwards, north and east component of the deck's upward normal),
//! deep-water dispersion `k = omega^2 / g`, the unit vector `d_j` the component travels to and the
//! vessel's mean path `x(t)`. Through `x(t)` the frequencies are those of the earth frame, and a
//! vessel that moves or turns within the minute does not smear them.
//!
//! Usage: [`Identifier::push`] every sample, [`Identifier::update`] every tick; `update` works only
//! when it is due (once in `update_period_s`) and within a fixed number of iterations.

mod bound_waves;
mod config;
mod course;
mod direction;
mod fit;
mod identifier;
mod record;
mod spectrum;
mod tracker;

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::MAX_COMPONENTS;
use alight_shared::msg::Seq;
use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::{BoundMotion, WaveNonlinearity, WaveResponse, bound_motion};
use nalgebra::Complex;

pub use config::SeaStateConfig;
pub use identifier::Identifier;

/// Slower than this a vessel is taken to drift, without a helmsman who changes its course, m/s.
const DRIFT_MPS: f64 = 0.8;

/// The vessel's motion at one instant, in the earth frame (NED axes), on the vessel's clock. Uneven
/// times are fine, 10 to 100 Hz; the samples are averaged into bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample {
    /// Time of validity.
    pub at: Time<VesselClock>,
    /// Velocity over ground of the reference point without the waves' orbital motion: north, east,
    /// m/s. Better with some of it left than late: what is in step with a known wave is taken out
    /// here without lag.
    pub mean_velocity: [f64; 2],
    /// North and east component of the deck's upward unit normal `n = -R_nb [0 0 1]'`, the waves'
    /// share and any trim included; `-r_nb.down()` of `alight_shared::frames`. Best from an
    /// attitude that gyros carry: an accelerometer on a hull that follows the water measures no tilt.
    pub normal: [f64; 2],
    /// Vertical acceleration of the reference point, upwards positive, gravity removed, m/s².
    pub acceleration_up: f64,
}

/// One wave component of the identified sea.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeaComponent {
    /// Earth-frame angular frequency, rad/s.
    pub omega: f64,
    /// Direction the component travels to, from north towards east, rad.
    pub direction: f64,
    /// Its standard deviation, rad; pi when unknown.
    pub direction_sd: f64,
    /// Amplitude of the heave, m.
    pub amplitude_heave_m: f64,
    /// Amplitude of the tilt, rad.
    pub amplitude_tilt_rad: f64,
    /// Phasor of the heave upwards at the state's time of validity, m: `Re(p e^{i omega_e tau})` is
    /// the component's heave `tau` later, with `omega_e` of [`SeaComponent::encounter`].
    pub heave: Complex<f64>,
    /// Phasors of the north and east component of the deck's upward normal, likewise.
    pub normal: [Complex<f64>; 2],
}

/// Result of the identification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// No motion worth a component: a calm sea.
    Calm,
    /// There is motion, but the components do not explain it yet (too short a record, or a sea too
    /// broad): use the broad default bank.
    Broad,
    /// The components may be used.
    Identified,
}

/// The identified sea.
#[derive(Clone, Debug, PartialEq)]
pub struct SeaState {
    /// Time of validity of the phasors: the newest sample of the record.
    pub at: Time<VesselClock>,
    /// The vessel's mean velocity then, smoothed without lag: north, east, m/s. For
    /// [`SeaComponent::encounter`].
    pub mean_velocity: [f64; 2],
    /// It drifts straight on, without a helmsman who changes its course.
    pub adrift: bool,
    /// Result.
    pub verdict: Verdict,
    /// Components, strongest first.
    pub components: Seq<SeaComponent, MAX_COMPONENTS>,
    /// Significant wave height from the vessel's heave, 4 times its standard deviation, m.
    pub significant_height_m: f64,
    /// 0 to 1: explained fraction of the motion, times the maturity of the record.
    pub confidence: f64,
}

impl SeaComponent {
    /// Angular frequency of encounter `omega - (omega^2 / g) U . d` at the mean velocity (north,
    /// east, m/s), rad/s (Fossen 2011, eq. 8.79).
    pub fn encounter(&self, mean_velocity: [f64; 2]) -> f64 {
        let (sin, cos) = self.direction.sin_cos();
        self.omega - self.omega * self.omega / GRAVITY * (mean_velocity[0] * cos + mean_velocity[1] * sin)
    }
}

impl SeaState {
    /// What heave (down), roll and pitch of a hull that heads north differ by from the components' sum, `t`
    /// seconds after the state's time, when it is `nonlinearity` by so much and goes at this mean velocity (north,
    /// east, m/s).
    pub fn bound(&self, nonlinearity: WaveNonlinearity, mean_velocity: [f64; 2], t: f64) -> BoundMotion {
        if nonlinearity.is_linear() {
            return BoundMotion::default();
        }
        let waves: Vec<WaveResponse> = self
            .components
            .iter()
            .map(|c| {
                WaveResponse::new(
                    [-c.heave, c.normal[1], -c.normal[0]],
                    (c.omega, c.encounter(mean_velocity)),
                    (c.direction, c.direction_sd),
                    mean_velocity,
                )
            })
            .collect();
        bound_motion(&waves, nonlinearity, t)
    }
}

#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod tests;

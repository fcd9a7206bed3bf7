//! Acceleration of a drone by the wind over the deck.

use core::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Matrix2, Vector2};

use crate::msg::DroneState;

/// Default drag per mass before identification, 1/m: a multirotor of 3.5 kg that banks by 16 deg in 10 m/s.
pub const DRAG_PER_M: f64 = 0.03;
/// Airspeed below which drag is linear, m/s.
pub const LINEAR_MPS: f64 = 1.0;
/// Intensity of turbulence over water, 0.19 at 7 m (MIL-F-8785C).
pub const TURBULENCE: f64 = 0.19;
/// Maximum wind acceleration that an aligned drone accepts entirely as drift, m/s²: each m/s² costs 0.3 m/s
/// along the deck (0.3 s of alignment), or 6 deg of tilt. At 5 m/s (0.7 m/s²) aligning costs little.
const ALIGNED_MPS2: f64 = 1.2;
/// Fraction of the excess over [`ALIGNED_MPS2`] accepted as drift; tilt compensates the rest.
const ALIGNED_FRACTION: f64 = 0.6;

/// Speed along the deck at the contact per gust acceleration at 7 m above the deck, m/s per m/s² (landings at random moments in 8 to 14 m/s).
pub const ALONG_PER_GUST_S: f64 = 0.15;
/// Tilt at the contact as a fraction of the bank that compensates the gust.
pub const TILT_PER_GUST: f64 = 1.0 - ALIGNED_FRACTION;
/// Displacement of the contact point per gust acceleration, m per m/s²; from the same landings.
pub const PLACE_PER_GUST_S2: f64 = 0.15;

/// Correlation time of gusts, s: from the acceleration measured 0.3 to 3 s before 60 contacts in 12 m/s and
/// the tilt at the contact.
const GUST_S: f64 = 2.2;

/// Effect of the wind over the deck on a drone that follows the vessel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindPush {
    /// Mean acceleration, NED, m/s².
    pub mean: Vector2<f64>,
    /// Standard deviation of gusts on one axis, m/s².
    pub gust_sd: f64,
}

impl WindPush {
    /// Wind measured by the drone's odometry.
    pub fn of(drone: &DroneState) -> WindPush {
        WindPush {
            mean: drone.wind_push.into(),
            gust_sd: drone.gust_sd,
        }
    }
    /// Wind `ahead_s` after the acceleration `now` (NED, m/s²) was measured.
    #[must_use]
    pub fn after(&self, now: &Vector2<f64>, ahead_s: f64) -> WindPush {
        let remains = (-ahead_s / GUST_S).exp();
        WindPush {
            mean: self.mean + (now - self.mean) * remains,
            gust_sd: self.gust_sd * (1.0 - remains * remains).sqrt(),
        }
    }
    /// Effect of the wind on a drone with usual drag above a moving vessel. The vessel's velocity `way` adds
    /// to the mean, but not to the gusts, of the true wind's velocity `wind`; NED, m/s.
    pub fn over(wind: Vector2<f64>, way: Vector2<f64>) -> WindPush {
        let (mean, slope) = drag(DRAG_PER_M, &(way - wind));
        WindPush {
            mean,
            gust_sd: slope.norm() * FRAC_1_SQRT_2 * TURBULENCE * wind.norm(),
        }
    }
}

/// Drag acceleration at airspeed `u` (m/s²) and its derivative by the wind, 1/s: `-k s u`, `s = sqrt(|u|² +
/// u0²)`: quadratic, but linear below `u0` because of rotor drag (Faessler et al. 2018); `k` in 1/m.
pub fn drag(k: f64, u: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let s = u.norm().hypot(LINEAR_MPS);
    (
        -u * (k * s),
        (Matrix2::identity() * s + u * u.transpose() / s) * k,
    )
}

/// Part of the acceleration `wind` (m/s²) that an aligned drone accepts as drift; tilt compensates the rest.
pub fn wind_during_alignment(wind: &Vector2<f64>) -> Vector2<f64> {
    let whole = wind.norm();
    if whole <= ALIGNED_MPS2 {
        return *wind;
    }
    wind * ((ALIGNED_MPS2 + ALIGNED_FRACTION * (whole - ALIGNED_MPS2)) / whole)
}

/// Excess of `wind` over the acceleration that an aligned drone accepts as drift, m/s². With an excess, the
/// tilted and the aligned attitude differ significantly.
pub fn beyond_aligned(wind: &Vector2<f64>) -> f64 {
    (wind.norm() - ALIGNED_MPS2).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_and_tilt_in_strong_wind() {
        let accepted = |d: f64| wind_during_alignment(&Vector2::new(0.0, d)).y;
        assert_eq!((accepted(0.7), accepted(-1.2)), (0.7, -1.2));
        assert!((accepted(1.201) - 1.2006).abs() < 1e-9 && (accepted(3.2) - 2.4).abs() < 1e-9);
        let beyond = |d: f64| beyond_aligned(&Vector2::new(0.0, d));
        assert!(beyond(-1.2) == 0.0 && (beyond(-3.2) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn gust_of_now_that_is_forgotten() {
        let mean = Vector2::new(0.0, 3.0);
        let now = Vector2::new(1.0, 1.0);
        let wind = WindPush { mean, gust_sd: 0.8 };
        let [at_once, late] = [0.0, 30.0].map(|s| wind.after(&now, s));
        assert!((at_once.mean - now).norm() < 1e-9 && at_once.gust_sd < 1e-9);
        assert!((late.mean - mean).norm() < 1e-5 && (late.gust_sd - 0.8).abs() < 1e-5);
    }

    #[test]
    fn wind_over_a_vessel_under_way() {
        let wind_over = |wind: [f64; 2], way: [f64; 2]| WindPush::over(wind.into(), way.into());
        // The vessel's speed is a headwind without gusts; an equal following wind cancels it.
        let own = wind_over([0.0, 0.0], [5.0, 0.0]);
        assert!(
            own.mean.x < -0.7 && own.mean.x > -0.8 && own.gust_sd == 0.0,
            "{own:?}"
        );
        let along = wind_over([5.0, 0.0], [5.0, 0.0]);
        assert!(along.mean.norm() < 1e-12 && along.gust_sd > 0.0);
        assert!(wind_over([-5.0, 0.0], [5.0, 0.0]).mean.x < -2.5);
    }
}

//! Heading of least deck tilt.
//!
//! Waves push a vessel the way they run: her horizontal acceleration `a` and the rate of the surface, `w` up, are in phase
//! (deep water, Fossen 2011, section 8.2), so `E[a w]` points to where they run to, and `E[a a']` holds how their
//! directions spread. Along her axes the tilt is taken to answer to the push in that direction alone, by the gains that
//! were measured in the same seconds: roll by `g_r = var(roll) / var(a_sway)`, pitch by `g_p = var(pitch) / var(a_surge)`.
//! On heading psi, with `S = E[a a']` in NED, along and across the unit vectors,
//!
//! ```text
//! var(tilt) = g_p along' S along + g_r across' S across
//! ```
//!
//! Resonances that another speed or heading would meet are not in it.

use core::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Matrix2, Vector2};

use crate::frames::wrap_angle;

/// Headings that are compared, ten degrees apart.
const HEADINGS: u32 = 36;
/// Least correlation of horizontal push and rise of waves whose direction is known.
const MIN_DIRECTED: f64 = 0.3;

/// Second moments of the motion of late.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    /// Of acceleration north and east, (m/s²)².
    pub(super) push: Matrix2<f64>,
    /// Of that acceleration with the rate of the surface, up, m²/s³.
    pub(super) runs: Vector2<f64>,
    /// Variance of the rate of the surface, (m/s)².
    pub(super) rise: f64,
    /// Variances of acceleration along the vessel and across her, (m/s²)².
    pub(super) own_push: [f64; 2],
    /// Variances of pitch, which the first turns, and of roll, rad².
    pub(super) own_tilt: [f64; 2],
}

/// What another heading would bring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuietHeading {
    /// Heading of the least tilt, rad: of two that are equal the one that meets the waves.
    pub heading: f64,
    /// Standard deviation of the tilt there, rad.
    pub tilt: f64,
    /// The same, predicted alike, on the present heading, rad.
    pub tilt_now: f64,
    /// Where the waves run to, rad.
    pub waves_to: f64,
}

impl Moments {
    /// The heading of the least tilt for a vessel that heads `now` (rad); None where the waves have no direction that
    /// is known.
    pub(super) fn quietest(&self, now: f64) -> Option<QuietHeading> {
        let directed = self.runs.norm() / (self.rise * self.push.trace()).sqrt();
        let (pitch, roll) = (
            self.own_tilt[0] / self.own_push[0],
            self.own_tilt[1] / self.own_push[1],
        );
        if !(directed > MIN_DIRECTED && pitch.is_finite() && roll.is_finite()) {
            return None;
        }
        let tilt = |heading: f64| {
            let unit = |angle: f64| Vector2::new(angle.cos(), angle.sin());
            let (along, across) = (unit(heading), unit(heading + FRAC_PI_2));
            (pitch * along.dot(&(self.push * along)) + roll * across.dot(&(self.push * across)))
                .max(0.0)
                .sqrt()
        };
        let waves_to = self.runs.y.atan2(self.runs.x);
        // Abeam counts as meeting them, by a rounded cosine.
        let meets = |heading: f64| wrap_angle(heading - waves_to).cos() < 1e-9;
        let heading = (0..HEADINGS)
            .map(|k| wrap_angle(TAU * f64::from(k) / f64::from(HEADINGS)))
            .filter(|h| meets(*h))
            .min_by(|a, b| tilt(*a).total_cmp(&tilt(*b)))?;
        Some(QuietHeading {
            heading,
            tilt: tilt(heading),
            tilt_now: tilt(now),
            waves_to,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waves that run to `to` (rad) with some spread, met by a vessel that rolls `ratio` times as much as she pitches.
    fn moments(to: f64, ratio: f64) -> Moments {
        let turn = nalgebra::Rotation2::new(to);
        Moments {
            push: turn * Matrix2::new(0.9, 0.0, 0.0, 0.1) * turn.inverse(),
            runs: turn * Vector2::new(0.8, 0.0),
            rise: 1.0,
            own_push: [0.5, 0.5],
            own_tilt: [0.01, 0.01 * ratio * ratio],
        }
    }

    #[test]
    fn quiet_heading_with_the_stiffer_axis() {
        for to in [-2.5_f64, 0.0, 1.2, 3.0] {
            let bow = moments(to, 2.0).quietest(to).unwrap();
            assert!(wrap_angle(bow.heading - to).abs() > 3.05, "{to}: {bow:?}");
            assert!((bow.tilt - bow.tilt_now).abs() < 0.01 * bow.tilt);
            let beam = moments(to, 0.5).quietest(to).unwrap();
            let off = wrap_angle(beam.heading - to).abs();
            assert!((off - FRAC_PI_2).abs() < 0.1, "{to}: {beam:?}");
            assert!(beam.tilt < 0.7 * beam.tilt_now);
        }
    }

    #[test]
    fn quiet_heading_in_waves_from_everywhere() {
        let mut m = moments(0.0, 2.0);
        m.runs *= 0.2;
        assert_eq!(m.quietest(0.0), None);
        m.own_push = [0.0; 2];
        assert_eq!(m.quietest(0.0), None);
    }
}

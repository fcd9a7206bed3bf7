//! Apparent slope of the deck: tangent of the angle between its normal and the specific force.
//!
//! A landed drone with stopped motors stays only while friction exceeds the apparent slope. In steep short seas a light
//! hull leaves the water: its deck tilts and falls in a way that no sum of waves predicts, in groups 15 to 45 s apart.
//! The vessel has observed its deck for longer than an arriving drone, so it publishes the steepest apparent slope of
//! each window of the last two minutes. Above a vessel that publishes none, the drone computes it from its own vision.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    frames::body_rates,
    geometry::GRAVITY,
    msg::{SLOPE_STEP, SLOPE_WINDOW_S, SLOPE_WINDOWS, Seq, VesselEstimate},
    time::{Clock, Span, Time},
};

/// Rate of the input states, Hz.
pub const RATE_HZ: f64 = 20.0;
/// Averaging time of the specific force, s; shorter slides move the drone only by centimetres.
const MEAN_S: f64 = 1.0;
/// Maximum time between two estimates whose velocities are differenced to an acceleration, s.
const MAX_GAP_S: f64 = 0.3;
/// Minimum normal force for a slope, m/s².
const MIN_NORMAL_FORCE_MPS2: f64 = 0.5;

/// Mean specific force of the deck and its steepest slope per window.
#[derive(Clone, Debug)]
pub struct ApparentSlope<C: Clock> {
    /// Time and velocity (NED, m/s) of the deck's centre at the last update.
    before: Option<(Time<C>, Vector3<f64>)>,
    /// Specific force in the deck's axes (m/s²) and duration of each (s), oldest first.
    forces: VecDeque<(Vector3<f64>, f64)>,
    /// Steepest slope per window, newest first, and start of the newest.
    windows: Seq<u8, SLOPE_WINDOWS>,
    began: Option<Time<C>>,
}

impl<C: Clock> Default for ApparentSlope<C> {
    fn default() -> Self {
        ApparentSlope {
            before: None,
            forces: VecDeque::new(),
            windows: Seq::new(),
            began: None,
        }
    }
}

impl<C: Clock> ApparentSlope<C> {
    /// Adds the vessel's state.
    pub fn update(&mut self, e: &VesselEstimate<C>) {
        let [_, _, _, roll, pitch, yaw] = e.eta;
        let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let [vn, ve, vd, dr, dp, dy] = e.eta_dot.map(f64::from);
        let spin = attitude * body_rates(roll, pitch, Vector3::new(dr, dp, dy));
        let velocity = Vector3::new(vn, ve, vd) + spin.cross(&(attitude * e.deck_centre()));
        self.push(e.header.at, &attitude, velocity);
    }
    /// Adds the deck's attitude (NED from deck) and the velocity of its centre, m/s, whose differences give
    /// the acceleration: a filter's acceleration contains only modelled motion.
    pub fn push(&mut self, at: Time<C>, attitude: &UnitQuaternion<f64>, velocity: Vector3<f64>) {
        let before = self.before.replace((at, velocity));
        let Some((dt, old)) = before.map(|(t, v)| ((at - t).secs(), v)) else {
            return;
        };
        if !(dt > 0.0 && dt < MAX_GAP_S) {
            self.forces.clear();
            return;
        }
        let acceleration = (velocity - old) / dt;
        let force = attitude.inverse_transform_vector(&(acceleration - Vector3::z() * GRAVITY));
        self.forces.push_back((force, dt));
        while self.duration_s() - self.forces.front().map_or(0.0, |f| f.1) >= MEAN_S {
            self.forces.pop_front();
        }
        self.advance_windows(at);
        if self.duration_s() < MEAN_S {
            return;
        }
        let sum = self
            .forces
            .iter()
            .fold(Vector3::zeros(), |a, (f, dt)| a + f * *dt)
            / self.duration_s();
        let slope = sum.xy().norm() / (-sum.z).max(MIN_NORMAL_FORCE_MPS2);
        if let Some(newest) = self.windows.first_mut() {
            // The cast saturates.
            *newest = (*newest).max((slope / SLOPE_STEP).round() as u8);
        }
    }

    /// Steepest slope of each window in units of [`SLOPE_STEP`], newest first; empty before the first window.
    pub fn slopes(&self, now: Time<C>) -> Seq<u8, SLOPE_WINDOWS> {
        let mut copy = ApparentSlope {
            windows: self.windows,
            began: self.began,
            ..ApparentSlope::default()
        };
        if copy.began.is_some() {
            copy.advance_windows(now);
        }
        copy.windows
    }

    fn duration_s(&self) -> f64 {
        self.forces.iter().map(|f| f.1).sum()
    }

    fn advance_windows(&mut self, now: Time<C>) {
        let Some(began) = self.began else {
            self.began = Some(now);
            self.windows = Seq::filled([0]);
            return;
        };
        let steps = ((now - began).secs() / SLOPE_WINDOW_S).clamp(0.0, SLOPE_WINDOWS as f64) as usize;
        if steps > 0 {
            self.began = Some(if steps == SLOPE_WINDOWS {
                now
            } else {
                began + Span::from_secs(SLOPE_WINDOW_S * steps as f64)
            });
            let old = self.windows;
            self.windows = Seq::filled(std::iter::repeat_n(0, steps).chain(old.iter().copied()));
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{
        msg::Header,
        time::VesselClock,
        vessel_model::{ROLL, SWAY},
    };

    /// Vessel that rolls by `amplitude` sin(omega t) and, if `with` is 1, accelerates with the sloping water.
    fn rolling_vessel(amplitude: f64, omega: f64, with: f64, seconds: f64) -> ApparentSlope<VesselClock> {
        let mut f = ApparentSlope::default();
        for k in 0..(seconds * RATE_HZ) as u32 {
            let t = f64::from(k) / RATE_HZ;
            let (s, c) = (omega * t).sin_cos();
            let mut e = VesselEstimate {
                header: Header::new(1, 0, 1, k, Time::from_secs(100.0 + t)),
                ..VesselEstimate::default()
            };
            e.eta[ROLL] = amplitude * s;
            e.eta_dot[ROLL] = (amplitude * omega * c) as f32;
            e.eta_dot[SWAY] = (-with * GRAVITY * amplitude * c / omega) as f32;
            f.update(&e);
        }
        f
    }

    #[test]
    fn apparent_slope_of_a_slow_roll() {
        let now = Time::from_secs(160.0);
        let steepest = |f: &ApparentSlope<VesselClock>| f.slopes(now).iter().skip(2).take(4).max().copied();
        let alone = rolling_vessel(0.3, 1.0, 0.0, 60.0);
        assert!(
            (28..=34).contains(&steepest(&alone).unwrap()),
            "{:?}",
            steepest(&alone)
        );
        let carried = rolling_vessel(0.3, 1.0, 1.0, 60.0);
        assert!(steepest(&carried).unwrap() < 5, "{:?}", steepest(&carried));
    }

    #[test]
    fn apparent_slope_of_quick_rocking() {
        let slopes =
            rolling_vessel(0.2, 2.0 * core::f64::consts::PI, 0.0, 30.0).slopes(Time::from_secs(130.0));
        assert!(slopes[2] < 3, "{}", slopes[2]);
    }

    #[test]
    fn apparent_slope_windows() {
        let f = rolling_vessel(0.3, 1.0, 0.0, 7.0);
        let soon = f.slopes(Time::from_secs(130.0));
        assert!(soon.len() >= 6 && soon[0] == 0 && soon.iter().any(|s| *s > 20));
        let late = f.slopes(Time::from_secs(400.0));
        assert!(late.len() == SLOPE_WINDOWS && late.iter().all(|s| *s == 0));
        assert!(
            ApparentSlope::<VesselClock>::default()
                .slopes(Time::from_secs(1.0))
                .is_empty()
        );
    }
}

//! Collective thrust as a command and as a fraction of full thrust, and hover thrust.

use super::DroneTime;
use crate::odometry::hover::hover_sample;

const BOUNDS: [f64; 2] = [0.1, 0.9];

/// Fraction of full thrust for an autopilot command `u`: `T = f u² + (1 - f) u` (PX4's thrust model, THR_MDL_FAC).
pub(crate) fn fraction(command: f64, curve: f64) -> f64 {
    let u = command.clamp(0.0, 1.0);
    curve * u * u + (1.0 - curve) * u
}

pub(crate) fn command(fraction: f64, curve: f64) -> f64 {
    // NaN gives zero thrust.
    let t = if fraction > 0.0 { fraction.min(1.0) } else { 0.0 };
    if curve < 1e-6 {
        return t;
    }
    let b = 1.0 - curve;
    ((b * b + 4.0 * curve * t).sqrt() - b) / (2.0 * curve)
}

/// Hover thrust, identified in flight: `T_h = T g / f` with the low-pass-filtered upward specific force `f`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct HoverThrust {
    value: f64,
    learned_s: f64,
}

impl HoverThrust {
    pub(crate) fn new(first: f64) -> HoverThrust {
        HoverThrust {
            value: first.clamp(BOUNDS[0], BOUNDS[1]),
            learned_s: 0.0,
        }
    }
    /// Hover thrust as a fraction of full thrust.
    pub(crate) fn value(&self) -> f64 {
        self.value
    }
    /// Hover thrust, and its learning time, s.
    pub(crate) fn learned(&self) -> (f64, f64) {
        (self.value, self.learned_s)
    }
    pub(crate) fn resume(&mut self, value: f64, learned_s: f64) {
        *self = HoverThrust::new(value);
        self.learned_s = learned_s;
    }
    pub(crate) fn is_learned(&self, time_s: f64) -> bool {
        self.learned_s >= time_s
    }
    /// Learns in flight from the applied thrust (fraction) and the upward specific force, m/s². Shocks, free fall and
    /// low thrust are ignored because they are not informative.
    pub(crate) fn learn(&mut self, thrust: f64, up: f64, dt: f64, time_s: f64) {
        let Some(sample) = hover_sample(thrust, up, [0.7, 1.3]) else {
            return;
        };
        if !(0.3 * self.value..=1.0).contains(&thrust) || !(0.0..=0.1).contains(&dt) {
            return;
        }
        // Starts as a mean and becomes an exponentially weighted one, so that a wrong initial value is soon forgotten.
        self.learned_s += dt;
        let gain = (dt / time_s.min(self.learned_s).max(dt)).min(1.0);
        self.value += gain * (sample - self.value);
        self.value = self.value.clamp(BOUNDS[0], BOUNDS[1]);
    }
}

/// Maximum time between set-points of a stream, s.
const STREAM_S: f64 = 0.1;
/// Delay until a commanded thrust takes effect, s: serial line, autopilot period and rotor lag.
const REACHES_S: f64 = 0.2;

/// Whether the commanded thrust has been low for long enough to take effect. Replaces a missing thrust report.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SentThrust {
    at: Option<DroneTime>,
    low_since: Option<DroneTime>,
}

impl SentThrust {
    pub(crate) fn sent(&mut self, now: DroneTime, low: bool) {
        let streams = self.at.is_some_and(|at| (now - at).secs() <= STREAM_S);
        let since = self.low_since.filter(|_| streams).unwrap_or(now);
        self.at = Some(now);
        self.low_since = low.then_some(since);
    }
    pub(crate) fn is_low(&self, now: DroneTime) -> bool {
        let streams = self.at.is_some_and(|at| (now - at).secs() <= STREAM_S);
        let acts = self
            .low_since
            .is_some_and(|since| (now - since).secs() >= REACHES_S);
        streams && acts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::geometry::GRAVITY;

    #[test]
    fn thrust_curve_inverse() {
        for curve in [0.0, 0.3, 0.7, 1.0] {
            for k in 0..=20 {
                let t = f64::from(k) / 20.0;
                assert!(
                    (fraction(command(t, curve), curve) - t).abs() < 1e-12,
                    "{curve} {t}"
                );
            }
        }
        assert!((command(0.25, 1.0) - 0.5).abs() < 1e-12);
        assert!(command(f64::NAN, 0.5).abs() < 1e-12 && command(2.0, 0.5) <= 1.0);
    }

    #[test]
    fn hover_thrust_from_a_wrong_start() {
        let mut h = HoverThrust::new(0.2);
        for k in 0..400 {
            let wave = 0.1 * (0.05 * f64::from(k)).sin();
            h.learn(0.45 * (1.0 + wave), GRAVITY * (1.0 + wave), 0.01, 2.0);
        }
        assert!((h.value() - 0.45).abs() < 1e-3, "{}", h.value());
        let before = h.value();
        for bad in [f64::NAN, 0.0, 60.0, -9.8] {
            h.learn(0.3, bad, 0.01, 2.0);
        }
        assert!((h.value() - before).abs() < 1e-12);
    }
}

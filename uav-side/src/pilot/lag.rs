//! Lag of the autopilot's attitude loop: identified in flight, and compensated.
//!
//! Autopilots turn towards a commanded attitude at a rate in proportion to the angle left,
//! `w = e / T` (PX4, ArduPilot). The lag `T` is their setting and differs from drone to drone; the
//! tracking loop is laid out for one of its own, `T0`. Commanding the angle `e T / T0` in place of
//! `e` makes any such loop turn as one with the lag `T0` would.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::config::LagConfig;

/// What is known of the lag: least squares of `e = T w` over the recent past, from a prior.
#[derive(Clone, Debug)]
pub(crate) struct AttitudeLagEstimator {
    nominal: f64,
    /// Sum of squared angles, rad² s.
    square: f64,
    /// Sum of angle times rate, rad².
    product: f64,
    /// What was commanded last; None while the autopilot closes the loop.
    commanded: Option<UnitQuaternion<f64>>,
    /// The angle left after the lag of the rate loop, body, rad.
    left: Vector2<f64>,
}

impl AttitudeLagEstimator {
    /// Starts from the nominal lag, s.
    pub(crate) fn new(nominal: f64, c: &LagConfig) -> Self {
        let nominal = nominal.clamp(c.bounds_s[0], c.bounds_s[1]);
        AttitudeLagEstimator {
            nominal,
            square: c.prior_rad2s,
            product: c.prior_rad2s / nominal,
            commanded: None,
            left: Vector2::zeros(),
        }
    }

    /// The lag, s.
    pub(crate) fn lag(&self, c: &LagConfig) -> f64 {
        let [low, high] = c.bounds_s;
        (self.square / self.product.max(1e-9)).clamp(low, high)
    }

    /// The command for an attitude loop of this lag that makes it turn from `is` as one with the lag
    /// that the tracking loop is laid out for would with `wanted`.
    pub(crate) fn command(
        &self,
        wanted: &UnitQuaternion<f64>,
        is: &UnitQuaternion<f64>,
        c: &LagConfig,
    ) -> UnitQuaternion<f64> {
        let angle = (is.inverse() * wanted).scaled_axis();
        // Heading has a loop of its own.
        let factor = self.lag(c) / c.design_s;
        let scaled = Vector3::new(factor * angle.x, factor * angle.y, angle.z);
        is * UnitQuaternion::from_scaled_axis(scaled)
    }

    /// The command that the next attitude received answers; None: the pilot commanded no attitude.
    pub(crate) fn answers(&mut self, command: Option<UnitQuaternion<f64>>) {
        self.commanded = command;
    }

    /// Learns from attitude and body rates (rad/s) `dt` after the command, in free flight.
    pub(crate) fn learn(&mut self, is: &UnitQuaternion<f64>, rates: &Vector3<f64>, dt: f64, c: &LagConfig) {
        let Some(commanded) = &self.commanded else {
            self.left = Vector2::zeros();
            return;
        };
        let angle = (is.inverse() * commanded).scaled_axis().xy();
        self.left += (angle - self.left) * (1.0 - (-dt / c.rate_loop_s).exp());
        let rate = rates.xy();
        if !(self.left.norm() <= c.angle_limit_rad && rate.norm().is_finite()) {
            return;
        }
        // The prior is what remains when nothing is received for long.
        let fade = 1.0 - (-dt / c.memory_s).exp();
        self.square += fade * (c.prior_rad2s - self.square) + self.left.norm_squared() * dt;
        self.product += fade * (c.prior_rad2s / self.nominal - self.product) + self.left.dot(&rate) * dt;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Follows a rocking command for `seconds` with an attitude loop of lag `lag`; gives the
    /// estimate and the loop's greatest distance from one with the design lag in the last second.
    fn rock(lag: f64, seconds: f64) -> (f64, f64) {
        let c = LagConfig::default();
        let mut x = AttitudeLagEstimator::new(0.2, &c);
        let (dt, mut worst) = (0.01, 0.0_f64);
        let (mut is, mut ideal) = (UnitQuaternion::identity(), UnitQuaternion::identity());
        let (mut rate, mut ideal_rate) = (Vector3::zeros(), Vector3::zeros());
        let n = (seconds / dt) as usize;
        for k in 0..n {
            let t = dt * k as f64;
            let wanted =
                UnitQuaternion::from_euler_angles(0.1 * (3.0 * t).sin(), 0.05 * (2.0 * t).cos(), 0.0);
            x.learn(&is, &rate, dt, &c);
            let command = x.command(&wanted, &is, &c);
            x.answers(Some(command));
            // The rate loop follows with its own lag.
            let turn =
                |q: &mut UnitQuaternion<f64>, w: &mut Vector3<f64>, u: &UnitQuaternion<f64>, lag: f64| {
                    let set = (q.inverse() * u).scaled_axis() / lag;
                    *w += (set - *w) * (dt / 0.05);
                    *q *= UnitQuaternion::from_scaled_axis(*w * dt);
                };
            turn(&mut is, &mut rate, &command, lag);
            turn(&mut ideal, &mut ideal_rate, &wanted, c.design_s);
            if k + 100 > n {
                worst = worst.max(is.angle_to(&ideal));
            }
        }
        (x.lag(&c), worst)
    }

    #[test]
    fn attitude_lag_estimate_and_compensation() {
        for lag in [0.1, 0.2, 0.3, 0.4] {
            let (found, worst) = rock(lag, 4.0);
            assert!((found / lag - 1.0).abs() < 0.12, "{lag}: {found}");
            assert!(worst < 0.012, "{lag}: {worst}");
        }
    }

    #[test]
    fn attitude_lag_without_a_command() {
        let c = LagConfig::default();
        let mut x = AttitudeLagEstimator::new(0.2, &c);
        for _ in 0..500 {
            x.answers(None);
            x.learn(
                &UnitQuaternion::identity(),
                &Vector3::new(1.0, 1.0, 0.0),
                0.01,
                &c,
            );
        }
        assert!((x.lag(&c) - 0.2).abs() < 1e-9);
    }

    #[test]
    fn attitude_lag_with_rates_not_finite() {
        let c = LagConfig::default();
        let mut x = AttitudeLagEstimator::new(0.2, &c);
        let tilted = UnitQuaternion::from_euler_angles(0.1, 0.0, 0.0);
        let command = x.command(&tilted, &UnitQuaternion::identity(), &c);
        x.answers(Some(command));
        x.learn(&UnitQuaternion::identity(), &Vector3::repeat(f64::NAN), 0.01, &c);
        assert!((x.lag(&c) - 0.2).abs() < 1e-9);
    }
}

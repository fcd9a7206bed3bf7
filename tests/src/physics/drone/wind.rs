//! Wind over the water: a mean and Dryden gusts.

use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::config::WindConfig;
use super::noise::normal;

const FOOT_M: f64 = 0.3048;

/// Mean wind and Dryden gusts (MIL-F-8785C, section 3.7.3.4, low-altitude model).
#[derive(Clone, Debug)]
pub(crate) struct Wind {
    mean: Vector3<f64>,
    gusts: bool,
    along: f64,
    /// Two states for each of the lateral and vertical second-order forms.
    lateral: [f64; 2],
    vertical: [f64; 2],
    rng: ChaCha8Rng,
    now: Vector3<f64>,
}

/// The first draw of the wind's stream: where the mean wind blows to, rad.
pub(crate) fn drawn_direction(rng: &mut ChaCha8Rng) -> f64 {
    rng.random_range(0.0..core::f64::consts::TAU)
}

impl Wind {
    pub(crate) fn new(config: &WindConfig, mut rng: ChaCha8Rng) -> Self {
        let drawn = drawn_direction(&mut rng);
        let to = config.to_deg.map_or(drawn, f64::to_radians);
        let mean = Vector3::new(to.cos(), to.sin(), 0.0) * config.mean_mps;
        Wind {
            mean,
            gusts: config.gusts && config.mean_mps > 0.0,
            along: normal(&mut rng),
            lateral: [normal(&mut rng), 0.0],
            vertical: [normal(&mut rng), 0.0],
            rng,
            now: mean,
        }
    }

    /// Wind velocity in NED, m/s, as of the last `step`.
    pub(crate) fn velocity(&self) -> Vector3<f64> {
        self.now
    }

    /// Goes on by `dt` for a drone at `height` (m above the water) with ground velocity `velocity`.
    ///
    /// With `W20` the mean wind at 20 ft and h in ft: `sigma_w = 0.1 W20`,
    /// `sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4`, `L_w = h`,
    /// `L_u = L_v = h / (0.177 + 0.000823 h)^1.2`. The longitudinal form is first-order with
    /// `T = L/V`, the others are `(1 + sqrt(3) T s) / (1 + T s)²`. The gusts are taken as frozen
    /// and carried by the mean wind: V is the drone's speed relative to it, 1 m/s at the least.
    pub(crate) fn step(&mut self, dt: f64, height: f64, velocity: &Vector3<f64>) {
        if !self.gusts {
            return;
        }
        let mean = self.mean.norm();
        let h = (height / FOOT_M).clamp(10.0, 1000.0);
        let k = 0.177 + 0.000_823 * h;
        let sigma_w = 0.1 * mean;
        let sigma_u = sigma_w / k.powf(0.4);
        let length_w = h * FOOT_M;
        let length_u = length_w / k.powf(1.2);
        let airspeed = (velocity - self.mean).norm().max(1.0);
        let second_order = |x: &mut [f64; 2], keep: f64, n: f64| {
            let before = x[0];
            x[0] = keep * x[0] + (1.0 - keep * keep).sqrt() * n;
            x[1] = keep * x[1] + (1.0 - keep) * 0.5 * (before + x[0]);
            // With unit variance of x[0] the stationary variance of this sum is 2.
            let root3 = 3.0_f64.sqrt();
            (root3 * x[0] + (1.0 - root3) * x[1]) / 2.0_f64.sqrt()
        };
        let keep_u = (-dt * airspeed / length_u).exp();
        let keep_w = (-dt * airspeed / length_w).exp();
        self.along = keep_u * self.along + (1.0 - keep_u * keep_u).sqrt() * normal(&mut self.rng);
        let lateral = second_order(&mut self.lateral, keep_u, normal(&mut self.rng));
        let vertical = second_order(&mut self.vertical, keep_w, normal(&mut self.rng));
        let ahead = self.mean / mean.max(1e-9);
        let across = Vector3::new(-ahead.y, ahead.x, 0.0);
        self.now = self.mean
            + ahead * (sigma_u * self.along)
            + across * (sigma_u * lateral)
            + Vector3::z() * (sigma_w * vertical);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::streams::Streams;

    fn spread(mean_mps: f64, height: f64) -> (Vector3<f64>, Vector3<f64>) {
        let config = WindConfig {
            mean_mps,
            to_deg: Some(0.0),
            with_waves: false,
            gusts: true,
        };
        let mut wind = Wind::new(&config, Streams::new(7).stream("wind"));
        let (mut sum, mut square, n) = (Vector3::zeros(), Vector3::zeros(), 400_000);
        for _ in 0..n {
            wind.step(0.05, height, &Vector3::zeros());
            sum += wind.velocity();
            square += wind.velocity().component_mul(&wind.velocity());
        }
        let mean = sum / f64::from(n);
        (
            mean,
            (square / f64::from(n) - mean.component_mul(&mean)).map(f64::sqrt),
        )
    }

    #[test]
    fn dryden_gusts_have_the_specified_standard_deviation() {
        let (mean, sd) = spread(10.0, 6.096);
        // At h = 20 ft: sigma_w = 1, sigma_u = 1 / (0.177 + 0.01646)^0.4 = 1.929 m/s.
        assert!((mean.x - 10.0).abs() < 0.15 && mean.y.abs() < 0.15, "{mean}");
        assert!((sd.x / 1.929 - 1.0).abs() < 0.1, "{sd}");
        assert!((sd.y / 1.929 - 1.0).abs() < 0.1, "{sd}");
        assert!((sd.z / 1.0 - 1.0).abs() < 0.1, "{sd}");
    }

    #[test]
    fn wind_without_a_mean_is_still_air() {
        let (mean, sd) = spread(0.0, 10.0);
        assert_eq!((mean, sd), (Vector3::zeros(), Vector3::zeros()));
    }
}

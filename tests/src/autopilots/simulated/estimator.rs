//! Sensors and state estimator of the autopilot.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use alight_shared::{frames::yaw_rotation, geometry::GRAVITY};

use crate::physics::{
    drone::{
        NavigationConfig, PlantState,
        noise::{GaussMarkov, normal},
    },
    streams::{Stream, Streams},
};

/// Correlation time of the barometer's drift, s.
const BAROMETER_S: f64 = 600.0;
/// Time constant with which the heading follows the magnetometer, s; it reflects the gyroscopes' weight in
/// PX4 and ArduPilot.
const STEEL_S: f64 = 5.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub(super) position: Vector3<f64>,
    pub(super) velocity: Vector3<f64>,
    pub(super) attitude: UnitQuaternion<f64>,
    pub(super) rates: Vector3<f64>,
    pub(super) specific_force: Vector3<f64>,
    /// Acceleration in NED, without gravity and accelerometer bias, m/s².
    pub(super) acceleration: Vector3<f64>,
}

/// Errors of the estimated attitude (NED rotation, multiplied from the left) and rates.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimulatedErrors {
    pub(super) attitude: UnitQuaternion<f64>,
    pub(super) rates: Vector3<f64>,
}

/// Inertial sensors, GNSS, and a Kalman filter for position, velocity and accelerometer bias. The three axes
/// share one 3x3 covariance.
#[derive(Clone, Debug)]
pub(super) struct SimulatedEstimator {
    config: NavigationConfig,
    gnss_bias: [GaussMarkov; 3],
    /// Drift of the barometer, which is the height reference.
    barometer: GaussMarkov,
    attitude_error: [GaussMarkov; 3],
    /// Additional heading errors, rad: from the hull's steel, and from resets of the estimate.
    steel: f64,
    reset: f64,
    /// Position offset caused by resets, m.
    displaced: Vector3<f64>,
    gyro_bias: Vector3<f64>,
    accelerometer_bias: Vector3<f64>,
    gnss_rng: Stream,
    barometer_rng: Stream,
    imu_rng: Stream,
    attitude_rng: Stream,
    /// Bias in NED, m/s².
    bias: Vector3<f64>,
    covariance: Matrix3<f64>,
    until_fix_s: f64,
    estimate: Estimate,
    errors: SimulatedErrors,
}

impl SimulatedEstimator {
    /// Estimator that has converged on the hovering drone `m`.
    pub(super) fn new(config: &NavigationConfig, streams: &Streams, m: &PlantState, dt: f64) -> Self {
        let mut gnss_rng = streams.stream("drone.gnss");
        let mut imu_rng = streams.stream("drone.imu");
        let mut attitude_rng = streams.stream("drone.attitude");
        let c = config;
        let gnss_bias = core::array::from_fn(|_| {
            GaussMarkov::new(c.gnss_bias_m, c.gnss_bias_s, 1.0 / c.gnss_hz, &mut gnss_rng)
        });
        let mut barometer_rng = streams.stream("drone.barometer");
        let barometer = GaussMarkov::new(
            c.barometer_drift_m,
            BAROMETER_S,
            1.0 / c.gnss_hz,
            &mut barometer_rng,
        );
        let attitude_error = [
            (c.tilt_error_deg, c.tilt_error_s),
            (c.tilt_error_deg, c.tilt_error_s),
            (c.heading_error_deg, c.heading_error_s),
        ]
        .map(|(sd, time)| GaussMarkov::new(sd.to_radians(), time, dt, &mut attitude_rng));
        let mut draw = |sd: f64| Vector3::from_fn(|_, _| sd * normal(&mut imu_rng));
        let gyro_bias = draw(c.gyro_bias_rps);
        let accelerometer_bias = draw(c.accelerometer_bias_mps2);
        let offset = Vector3::from_fn(|i, _| gnss_bias[i].value) + Vector3::z() * barometer.value;
        let mut e = SimulatedEstimator {
            config: config.clone(),
            gnss_bias,
            barometer,
            attitude_error,
            steel: 0.0,
            reset: 0.0,
            displaced: Vector3::zeros(),
            gyro_bias,
            accelerometer_bias,
            gnss_rng,
            barometer_rng,
            imu_rng,
            attitude_rng,
            bias: Vector3::zeros(),
            covariance: Matrix3::from_diagonal(&Vector3::new(
                c.gnss_noise_m.powi(2),
                c.gnss_velocity_mps.powi(2),
                c.accelerometer_bias_mps2.powi(2) + (c.tilt_error_deg.to_radians() * GRAVITY).powi(2),
            )),
            until_fix_s: 0.0,
            estimate: Estimate {
                position: m.position + offset,
                velocity: m.velocity,
                attitude: m.attitude,
                rates: m.rates,
                specific_force: Vector3::new(0.0, 0.0, -GRAVITY),
                acceleration: Vector3::zeros(),
            },
            errors: SimulatedErrors {
                attitude: UnitQuaternion::identity(),
                rates: Vector3::zeros(),
            },
        };
        // Twenty seconds of hover before the start let the biases converge.
        let still = Vector3::new(0.0, 0.0, -GRAVITY);
        for _ in 0..(20.0 / dt) as usize {
            e.step(m, &still, 0.35, dt);
        }
        e
    }

    /// Position of the drone's navigation frame relative to the true one, m: the sum of GNSS error, barometer
    /// error and resets.
    pub(super) fn offset(&self) -> Vector3<f64> {
        let wander = Vector3::from_fn(|i, _| self.gnss_bias[i].value) + Vector3::z() * self.barometer.value;
        wander + self.displaced
    }
    pub(super) fn now(&self) -> &Estimate {
        &self.estimate
    }
    pub(super) fn errors(&self) -> &SimulatedErrors {
        &self.errors
    }
    /// Standard deviations of position (m) and velocity (m/s). The position's excludes the slow GNSS error,
    /// which successive fixes share.
    pub(super) fn sd(&self) -> (f64, f64) {
        let p = &self.covariance;
        (p[(0, 0)].max(0.0).sqrt(), p[(1, 1)].max(0.0).sqrt())
    }

    /// Applies the compass error caused by the hull's steel at `distance_m` for `dt` (s).
    pub(super) fn near_steel(&mut self, distance_m: f64, dt: f64) {
        let error = self.config.steel_heading_deg.to_radians() / distance_m.max(0.5).powi(3);
        self.steel += (error - self.steel) * (dt / STEEL_S).min(1.0);
    }
    pub(super) fn reset_heading(&mut self, by_rad: f64) {
        self.reset += by_rad;
    }
    /// Resets the position by `by` (m), as when the estimator switches to another position source.
    pub(super) fn reset_position(&mut self, by: &Vector3<f64>) {
        self.displaced += by;
        self.estimate.position += by;
    }

    /// Standard deviations of roll, pitch and yaw, rad.
    pub(super) fn euler_sd(&self) -> [f64; 3] {
        let c = &self.config;
        [c.tilt_error_deg, c.tilt_error_deg, c.heading_error_deg]
            .map(|slow| slow.hypot(c.attitude_noise_deg).to_radians())
    }

    /// Advances by a tick of `dt` that ends at the true motion `m`. `force` is the mean specific force in the
    /// body frame during the tick, `thrust` the mean collective thrust (fraction of the maximum).
    pub(super) fn step(&mut self, m: &PlantState, force: &Vector3<f64>, thrust: f64, dt: f64) {
        let c = &self.config;
        let errors = [0, 1, 2].map(|i| {
            self.attitude_error[i].step(&mut self.attitude_rng)
                + c.attitude_noise_deg.to_radians() * normal(&mut self.attitude_rng)
        });
        // Tilt errors act about the level axes and the heading error about the vertical: an NED rotation, multiplied from the left.
        let (_, _, yaw) = m.attitude.euler_angles();
        let level = yaw_rotation(yaw);
        let further = Vector3::z() * (self.steel + self.reset);
        let wrong = UnitQuaternion::from_scaled_axis(level * Vector3::from(errors) + further);
        let attitude = wrong * m.attitude;

        let gyro = |rng: &mut Stream| c.gyro_noise_rps * normal(rng);
        let rates = m.rates + self.gyro_bias + Vector3::from_fn(|_, _| gyro(&mut self.imu_rng));
        let noise = c.accelerometer_noise_mps2.hypot(c.vibration_mps2 * thrust);
        let limit = c.accelerometer_range_mps2;
        let specific_force =
            (force + self.accelerometer_bias + Vector3::from_fn(|_, _| noise * normal(&mut self.imu_rng)))
                .map(|f| f.clamp(-limit, limit));

        let acceleration = attitude * specific_force + Vector3::z() * GRAVITY - self.bias;
        let e = &mut self.estimate;
        e.position += e.velocity * dt + acceleration * (0.5 * dt * dt);
        e.velocity += acceleration * dt;
        e.attitude = attitude;
        e.rates = rates;
        e.specific_force = specific_force;
        e.acceleration = acceleration;
        self.errors = SimulatedErrors {
            attitude: wrong,
            rates: rates - m.rates,
        };
        self.predict(noise, dt);

        self.until_fix_s -= dt;
        if self.until_fix_s <= 0.5 * dt {
            self.until_fix_s += 1.0 / self.config.gnss_hz;
            self.fuse(m);
        }
    }

    /// `P = F P F' + Q` for x = [p, v, b], dv/dt = a - b. Q contains white accelerometer noise, fast attitude
    /// noise, and the drift of the bias (tilt error times gravity). As in PX4's EKF2, Q does not model the
    /// drift of the GNSS error; the estimate follows that drift with a lag.
    fn predict(&mut self, accelerometer_sd: f64, dt: f64) {
        let c = &self.config;
        let f = Matrix3::new(1.0, dt, -0.5 * dt * dt, 0.0, 1.0, -dt, 0.0, 0.0, 1.0);
        let white = accelerometer_sd.hypot(c.attitude_noise_deg.to_radians() * GRAVITY) * dt;
        let tilt = c.tilt_error_deg.to_radians() * GRAVITY;
        let q = Vector3::new(0.0, white * white, 2.0 * tilt * tilt / c.tilt_error_s * dt);
        self.covariance = f * self.covariance * f.transpose() + Matrix3::from_diagonal(&q);
    }

    /// Fuses a position and velocity fix, one scalar at a time (Gelb 1974, section 4.2).
    fn fuse(&mut self, m: &PlantState) {
        let sd_p = self.config.gnss_noise_m;
        let sd_v = self.config.gnss_velocity_mps;
        let barometer = self.barometer.step(&mut self.barometer_rng);
        let offset =
            Vector3::from_fn(|i, _| self.gnss_bias[i].step(&mut self.gnss_rng)) + Vector3::z() * barometer;
        let offset = offset + self.displaced;
        let mut noise = |sd: f64| Vector3::from_fn(|_, _| sd * normal(&mut self.gnss_rng));
        let position = m.position + offset + noise(sd_p);
        let velocity = m.velocity + noise(sd_v);
        for (row, measured, variance) in [(0, position, sd_p * sd_p), (1, velocity, sd_v * sd_v)] {
            let p = &self.covariance;
            let gain = p.column(row) / (p[(row, row)] + variance);
            let predicted = if row == 0 {
                self.estimate.position
            } else {
                self.estimate.velocity
            };
            let innovation = measured - predicted;
            self.estimate.position += innovation * gain[0];
            self.estimate.velocity += innovation * gain[1];
            self.bias += innovation * gain[2];
            let reduced = p - gain * p.row(row);
            self.covariance = (reduced + reduced.transpose()) * 0.5;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_estimator_stated_deviations() {
        let dt = 0.01;
        // The reported position deviation excludes this constant GNSS error.
        let config = NavigationConfig {
            gnss_bias_s: 1e5,
            ..NavigationConfig::default()
        };
        let mut p2 = 0.0;
        let mut v2 = 0.0;
        let mut n = 0.0;
        let mut sp = 0.0;
        let mut sv = 0.0;
        for seed in 0..20 {
            let mut m = PlantState {
                position: Vector3::new(0.0, 0.0, -15.0),
                ..PlantState::default()
            };
            let mut e = SimulatedEstimator::new(&config, &Streams::new(seed), &m, dt);
            for k in 0..3000 {
                // Sway of 1 m at 1 rad/s.
                let t = f64::from(k) * dt;
                let a = Vector3::new(-t.sin(), 0.0, 0.0);
                m.position.x = t.sin();
                m.velocity.x = t.cos();
                let f = a - Vector3::z() * GRAVITY;
                e.step(&m, &f, 0.35, dt);
                if k > 500 && k % 50 == 0 {
                    p2 += (e.now().position - m.position - e.offset()).norm_squared() / 3.0;
                    v2 += (e.now().velocity - m.velocity).norm_squared() / 3.0;
                    n += 1.0;
                    sp += e.sd().0.powi(2);
                    sv += e.sd().1.powi(2);
                }
            }
        }
        let position = p2 / sp;
        let velocity = v2 / sv;
        println!(
            "sd {} {} ratio {position} {velocity}",
            (sp / n).sqrt(),
            (sv / n).sqrt()
        );
        assert!(
            (0.6..1.6).contains(&position),
            "{position} (sd {})",
            (sp / n).sqrt()
        );
        assert!(
            (0.6..1.6).contains(&velocity),
            "{velocity} (sd {})",
            (sv / n).sqrt()
        );
    }
}

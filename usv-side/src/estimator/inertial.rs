//! Gyroscope and accelerometer.

use alight_shared::{
    estimation::Update,
    geometry::GRAVITY,
    msg::ImuSample,
    vessel_model::{
        DISTURBANCE, ETA, HEAD, HEAVE, NU, PITCH, ROLL, SURGE, SWAY, Term, VesselModelConfig, YAW,
    },
};
use nalgebra::Vector3;

use super::{InnovationChannel, STEP_S, VesselFilter};
use crate::VesselNodeConfig;

/// Gate of an inertial channel on the normalised innovation squared (7 standard deviations).
const GATE: f64 = 49.0;
/// Number of consecutive steps with a rejection after which the covariance is inflated (half a second).
const MAX_REJECTED: u32 = 26;
/// Error of the model of specific force (lever-arm errors, second order in the tilt), m/s².
const FORCE_MODEL_SD: f64 = 0.03;

/// Maximum vertical offset of a working accelerometer, in standard deviations of bias and model.
const MAX_OFFSET: f64 = 5.0;
/// Maximum innovation that can be real motion, rad/s, m/s².
const MAX_MISSED: f64 = 50.0;
/// Standard deviation of the velocity caused by an impulse, as a fraction of that velocity.
const IMPULSE_SD_FRACTION: f64 = 0.3;
/// Maximum innovations attributed to slamming: angular rate, rad/s, and specific force, m/s².
const MAX_IMPULSE: [f64; 2] = [3.0, 40.0];
/// Fraction of the excess acceleration that is treated as measurement noise.
const FAST_FRACTION: f64 = 0.1;

/// Sum or mean of inertial samples, time since the last step (s), and count.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Samples {
    gyro: Vector3<f64>,
    force: Vector3<f64>,
    pub(super) ahead: f64,
    n: f64,
}

impl Samples {
    fn mean(&self) -> Samples {
        let Samples {
            gyro,
            force,
            ahead,
            n,
        } = *self;
        Samples {
            gyro: gyro / n,
            force: force / n,
            ahead: ahead / n,
            n,
        }
    }
}

/// Inertial samples since the last step, summed in two halves.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ImuWindow {
    halves: [Samples; 2],
    /// Time of the first sample since the last step, s.
    begin: f64,
}

impl ImuWindow {
    /// Adds a sample taken `ahead` seconds after the last step and `period` (s) after the previous sample.
    pub(super) fn push(&mut self, sample: &ImuSample, ahead: f64, period: f64) {
        let [first, second] = &mut self.halves;
        if first.n == 0.0 {
            self.begin = ahead;
        }
        let late = first.n > 0.0 && ahead - self.begin >= 0.5 * (STEP_S - period);
        let sum = if late { second } else { first };
        sum.gyro += Vector3::from(sample.gyro);
        sum.force += Vector3::from(sample.accelerometer);
        sum.ahead += ahead;
        sum.n += 1.0;
    }
    pub(super) fn mean(&self) -> Samples {
        let [a, b] = self.halves;
        let sum = Samples {
            gyro: a.gyro + b.gyro,
            force: a.force + b.force,
            ahead: a.ahead + b.ahead,
            n: a.n + b.n,
        };
        sum.mean()
    }
    /// Mean rates and forces of the second half minus the first. None for one sample: it may be an outlier.
    fn apart(&self) -> Option<[Vector3<f64>; 2]> {
        let [a, b] = self.halves.map(|half| half.mean());
        (b.n > 0.0).then(|| [b.gyro - a.gyro, b.force - a.force])
    }
}

/// Mean of the samples, and difference between their two halves.
type Mean = (Vector3<f64>, Option<Vector3<f64>>);

/// Whether a rejected innovation is real motion: the halves of the samples then agree, whereas an outlier makes them
/// differ by twice the innovation of the mean.
fn is_impulse(innovation: f64, apart: f64, most: f64) -> bool {
    innovation.abs() < most && apart.abs() < innovation.abs()
}

impl VesselFilter {
    fn gyro_bias(&self) -> Vector3<f64> {
        Vector3::new(
            self.belief.get(ROLL, HEAD),
            self.belief.get(PITCH, HEAD),
            self.belief.get(YAW, HEAD),
        )
    }
    fn force_bias(&self) -> Vector3<f64> {
        Vector3::new(
            self.belief.get(SURGE, HEAD),
            self.belief.get(SWAY, HEAD),
            self.belief.get(HEAVE, HEAD),
        )
    }

    /// Whether the accelerometer works. A vessel's mean specific force is gravity, and GNSS makes the heave
    /// bias observable: a bias (m/s²) beyond its spread and the model error indicates clipping or a defect.
    pub(super) fn measures_gravity(&self, config: &VesselNodeConfig) -> bool {
        let sd = config.imu.accelerometer_bias_sd_mps2.hypot(FORCE_MODEL_SD);
        self.belief.get(HEAVE, HEAD).abs() <= MAX_OFFSET * sd
    }

    fn record_innovation(&mut self, channel: InnovationChannel, dof: usize, update: Update) {
        self.consistency.observe(channel, update);
        match update {
            Update::Fused { nis } | Update::Rejected { nis } => {
                self.adaptive_noise.observe(dof, nis.min(GATE), STEP_S);
            }
            Update::Invalid => {}
        }
    }

    /// Returns 1 if the channel was rejected, 0 if fused. A rejected innovation may be real motion, so it
    /// adds `doubt` per unit to the rate's uncertainty; otherwise the GNSS gate would reject the velocity
    /// after a partly fused impulse.
    fn reject(&mut self, dof: usize, update: Update, innovation: f64, doubt: f64) -> u64 {
        match update {
            Update::Fused { .. } => return 0,
            Update::Rejected { .. } => {
                let missed = doubt * innovation.abs().min(MAX_MISSED);
                self.belief.inflate(dof, NU, missed * missed);
            }
            Update::Invalid => {}
        }
        1
    }

    /// Adds an impulsive disturbance: an unmodelled acceleration over the last step, with its effect on
    /// position and velocity. Process noise wide enough for slamming would hide the waves of other hulls.
    fn impulse(&mut self, dof: usize, acceleration: f64, eta: f64, nu: f64) {
        let gain = self.model.acceleration_row(dof, dof)[DISTURBANCE];
        if gain > 0.0 {
            let d = self.belief.get(dof, DISTURBANCE) + acceleration / gain;
            self.belief.set(dof, DISTURBANCE, d);
            self.belief.inflate(
                dof,
                DISTURBANCE,
                (IMPULSE_SD_FRACTION * acceleration / gain).powi(2),
            );
        }
        let e = self.belief.get(dof, ETA);
        let v = self.belief.get(dof, NU);
        self.belief.set(dof, ETA, e + eta);
        self.belief.set(dof, NU, v + nu);
        self.belief.inflate(dof, NU, (IMPULSE_SD_FRACTION * nu).powi(2));
    }

    /// Fuses the mean of the samples, `offset` s after the state's time. Returns the number of rejections.
    pub(super) fn fuse_inertial(
        &mut self,
        config: &VesselNodeConfig,
        window: &ImuWindow,
        offset: f64,
    ) -> u64 {
        let Samples { gyro, force, n, .. } = window.mean();
        let apart = window.apart();
        let gate = self.imu.gate(GATE, MAX_REJECTED);
        if gate.is_infinite() {
            self.open();
        }
        let rates = config.imu.gyro_sd_radps.powi(2) / n;
        let forces = config.imu.accelerometer_sd_mps2.powi(2) / n + FORCE_MODEL_SD.powi(2);
        let mut rejected = self.fuse_rates((gyro, apart.map(|a| a[0])), rates, offset, gate);
        rejected += self.fuse_force(&config.model, (force, apart.map(|a| a[1])), forces, gate);
        let at = self.imu.measured_at.unwrap_or(self.at);
        self.imu.record(at, 0.0, rejected == 0);
        rejected
    }

    /// Fuses the gyroscope: roll and pitch rates at the reference heading, `n_dot = (R omega) x n`.
    fn fuse_rates(&mut self, (gyro, apart): Mean, r: f64, offset: f64, gate: f64) -> u64 {
        let mut rejected = 0;
        let tilt = self.tilt();
        let measured = tilt.rates_from_gyro(gyro - self.gyro_bias());
        let differ = apart.map(|gyro| tilt.rates_from_gyro(gyro));
        for (k, dof) in [ROLL, PITCH, YAW].into_iter().enumerate() {
            let z = measured[k];
            let predicted = self.belief.get(dof, NU) + offset * self.belief.acceleration(&self.model, dof);
            let row = [Term::new(dof, NU, 1.0), Term::new(dof, HEAD, 1.0)];
            let innovation = z - predicted;
            let update = self.belief.update(&row, innovation, r, gate);
            self.record_innovation(InnovationChannel::Gyro, dof, update);
            let impulse = differ.is_some_and(|d| is_impulse(innovation, d[k], MAX_IMPULSE[0]));
            if impulse && matches!(update, Update::Rejected { .. }) {
                self.impulse(dof, innovation / STEP_S, 0.5 * innovation * STEP_S, innovation);
            } else {
                rejected += self.reject(dof, update, innovation, 1.0);
            }
        }
        rejected
    }

    /// Fuses the accelerometer: `f = R' (a + lever arm - g)`, reference-parallel; `white`: its variance.
    fn fuse_force(&mut self, config: &VesselModelConfig, (force, apart): Mean, white: f64, gate: f64) -> u64 {
        let mut rejected = 0;
        let lever_arm = self.imu_lever_arm;
        for axis in 0..3 {
            let tilt = self.tilt();
            let rotation = tilt.rotation();
            let f = rotation * (force - self.force_bias());
            let acceleration = self.accelerations();
            let lever_arm = rotation * lever_arm;
            let spin = rotation * tilt.body_rates();
            let turning = Vector3::new(acceleration[ROLL], acceleration[PITCH], acceleration[YAW]);
            let lever = turning.cross(&lever_arm) + spin.cross(&spin.cross(&lever_arm));
            let z = f[axis] - lever[axis] - acceleration[axis] + if axis == 2 { GRAVITY } else { 0.0 };
            // In fast motion, the error of the sampling time also contributes.
            let fast = self.adaptive_noise.spread(config, axis);
            let r = white + (FAST_FRACTION * fast).powi(2);
            let mut row = core::mem::take(&mut self.row);
            row.clear();
            self.belief.acceleration_terms(&self.model, axis, 1.0, &mut row);
            row.push(Term::new(axis, HEAD, 1.0));
            // Gravity, not the measured vertical force: its fluctuation would separate tilt from bias only if no horizontal
            // force fluctuated with it. On a slamming hull at 7 m/s the bias grew to 1.4 m/s² and the tilt to 9 deg.
            let tilts = match axis {
                SURGE => Some((PITCH, GRAVITY, lever_arm.z)),
                SWAY => Some((ROLL, -GRAVITY, -lever_arm.z)),
                _ => None,
            };
            if let Some((dof, gravity, height)) = tilts {
                row.push(Term::new(dof, ETA, gravity));
                self.belief.acceleration_terms(&self.model, dof, height, &mut row);
            }
            let update = self.belief.update(&row, z, r, gate);
            self.row = row;
            self.record_innovation(InnovationChannel::Accelerometer, axis, update);
            let is_rejected = matches!(update, Update::Rejected { .. });
            let impulsive =
                apart.is_some_and(|force| is_impulse(z, (rotation * force)[axis], MAX_IMPULSE[1]));
            if is_rejected && impulsive {
                // The acceleration grows linearly over the step.
                self.impulse(axis, z, 0.0, 0.5 * z * STEP_S);
            } else {
                rejected += self.reject(axis, update, z, STEP_S);
            }
        }
        rejected
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impulse_test_of_outlier_and_growing_rate() {
        // One of two samples is off by 2 rad/s: the mean is off by 1, the halves differ by 2.
        assert!(!is_impulse(1.0, 2.0, MAX_IMPULSE[0]));
        // After one step, a rate that grows by 20 rad/s² has an innovation of 0.4; its samples differ by 0.2.
        assert!(is_impulse(0.4, 0.2, MAX_IMPULSE[0]) && is_impulse(-0.4, -0.2, MAX_IMPULSE[0]));
        assert!(!is_impulse(5.0, 0.1, MAX_IMPULSE[0]), "no hull turns like that");
        // A single outlier of a fast sensor, at any position in the step.
        for (rate_hz, wild) in [
            (100, 0),
            (100, 1),
            (250, 2),
            (400, 0),
            (400, 3),
            (400, 4),
            (1000, 19),
        ] {
            let mut window = ImuWindow::default();
            let period = 1.0 / f64::from(rate_hz);
            for k in 0..rate_hz / 50 {
                let gyro = [if k == wild { 2.0 } else { 0.0 }, 0.0, 0.0];
                let sample = ImuSample {
                    gyro,
                    ..ImuSample::default()
                };
                window.push(&sample, f64::from(k + 1) * period, period);
            }
            let apart = window.apart().map_or(0.0, |a| a[0].x);
            assert!(
                !is_impulse(window.mean().gyro.x, apart, MAX_IMPULSE[0]),
                "{rate_hz} Hz: {wild}"
            );
        }
        assert!(!is_impulse(f64::NAN, 0.0, MAX_IMPULSE[0]) && !is_impulse(1.0, f64::NAN, MAX_IMPULSE[0]));
    }
}

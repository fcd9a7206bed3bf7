//! Gyroscope and accelerometer.

use alight_shared::geometry::GRAVITY;
use alight_shared::kalman::Update;
use alight_shared::vessel_model::{DISTURBANCE, ETA, HEAD, HEAVE, NU, PITCH, ROLL, SURGE, SWAY, Term, YAW};
use nalgebra::Vector3;

use super::{Channel, Filter, STEP_S};
use crate::VesselNodeConfig;
use crate::sea_state::MotionSample;

/// Gate of an inertial channel on the normalised innovation squared (7 standard deviations).
const GATE: f64 = 49.0;
/// After this many steps with a refusal in a row the covariance is opened (half a second).
const PATIENCE: u32 = 25;
/// What the model of specific force leaves out (lever-arm errors, second order in the tilt), m/s².
const FORCE_MODEL_SD: f64 = 0.03;

/// Largest innovation that counts as possibly true, rad/s, m/s².
const MOST_MISSED: f64 = 50.0;
/// Largest fluctuation of the specific force along the vertical that is used to tell tilt from bias, m/s².
const MOST_LIFT: f64 = 1.0;
/// Share of a jolt's velocity that is in doubt.
const JOLT_DOUBT: f64 = 0.3;
/// Largest innovation of a rate and of a specific force that a hull that slams explains, rad/s, m/s².
const MOST_JOLT: [f64; 2] = [3.0, 40.0];
/// The same where the model's rest has jumped a step ago.
const MOST_SHIFT: [f64; 2] = [10.0, 200.0];
/// Share of the unexplained acceleration that is taken for noise of the measurement.
const FAST_SHARE: f64 = 0.1;

/// Whether an innovation that the gate refused is motion: the two samples of the step agree about it, which
/// one wild sample of the two would not (it makes their difference twice the innovation of their mean).
fn is_jolt(innovation: f64, apart: f64, most: f64) -> bool {
    innovation.abs() < most && apart.abs() < innovation.abs()
}

impl Filter {
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

    /// Tells the accounts how a channel has fitted.
    fn note(&mut self, channel: Channel, dof: usize, update: Update) {
        self.consistency.observe(channel, update);
        match update {
            Update::Fused { nis } | Update::Gated { nis } => {
                self.unexplained.observe(dof, nis.min(GATE), STEP_S);
            }
            Update::Invalid => {}
        }
    }

    /// 1 when the channel was refused, not fused. What was refused may have been true: the rate (by `doubt` per
    /// unit of innovation) is that much less certain, or a real jolt that is refused by halves leaves a velocity
    /// that GNSS is not believed about.
    fn refuse(&mut self, dof: usize, update: Update, innovation: f64, doubt: f64) -> u64 {
        match update {
            Update::Fused { .. } => return 0,
            Update::Gated { .. } => {
                let missed = doubt * innovation.abs().min(MOST_MISSED);
                self.belief.inflate(dof, NU, missed * missed);
            }
            Update::Invalid => {}
        }
        1
    }

    /// Takes an acceleration that the model lacked over the last step for a disturbance, with what it did to
    /// place and velocity since: no spread of disturbances that lets a hull leave the water tells the waves
    /// of one that does not.
    fn jolt(&mut self, dof: usize, acceleration: f64, eta: f64, nu: f64) {
        let gain = self.model.acceleration_row(dof, dof)[DISTURBANCE];
        if gain > 0.0 {
            let d = self.belief.get(dof, DISTURBANCE) + acceleration / gain;
            self.belief.set(dof, DISTURBANCE, d);
            self.belief
                .inflate(dof, DISTURBANCE, (JOLT_DOUBT * acceleration / gain).powi(2));
        }
        let (e, v) = (self.belief.get(dof, ETA), self.belief.get(dof, NU));
        self.belief.set(dof, ETA, e + eta);
        self.belief.set(dof, NU, v + nu);
        self.belief.inflate(dof, NU, (JOLT_DOUBT * nu).powi(2));
    }

    /// Fuses the mean of `n` samples, taken `offset` seconds after the state's time. Returns the
    /// number of channels refused.
    pub(super) fn fuse_inertial(
        &mut self,
        config: &VesselNodeConfig,
        (gyro, force): (Vector3<f64>, Vector3<f64>),
        apart: (Vector3<f64>, Vector3<f64>),
        n: f64,
        offset: f64,
    ) -> u64 {
        let gate = if self.refused_imu > PATIENCE {
            self.open();
            self.refused_imu = 0;
            f64::INFINITY
        } else {
            GATE
        };
        let mut refused = 0;
        // Gyroscope: n_dot = (R omega) x n gives the rates of roll and pitch at the reference.
        let r = config.imu.gyro_sd_radps.powi(2) / n;
        let tilt = self.tilt();
        let measured = tilt.rates_from_gyro(gyro - self.gyro_bias());
        let differ = tilt.rates_from_gyro(apart.0);
        for (k, dof) in [ROLL, PITCH, YAW].into_iter().enumerate() {
            let z = measured[k];
            let predicted = self.belief.get(dof, NU) + offset * self.belief.acceleration(&self.model, dof);
            let row = [Term::new(dof, NU, 1.0), Term::new(dof, HEAD, 1.0)];
            let innovation = z - predicted;
            let update = self.belief.update(&row, innovation, r, gate);
            self.note(Channel::Gyro, dof, update);
            let shifted = self.remodelled && innovation.abs() < MOST_SHIFT[0];
            let jolt = shifted || is_jolt(innovation, differ[k], MOST_JOLT[0]);
            if jolt && matches!(update, Update::Gated { .. }) {
                self.jolt(dof, innovation / STEP_S, 0.5 * innovation * STEP_S, innovation);
            } else {
                refused += self.refuse(dof, update, innovation, 1.0);
            }
        }
        // Accelerometer: f = R' (a + lever arm - g), all in the reference-parallel frame.
        let white = config.imu.accelerometer_sd_mps2.powi(2) / n + FORCE_MODEL_SD.powi(2);
        let arm = self.imu_arm;
        for axis in 0..3 {
            let tilt = self.tilt();
            let rotation = tilt.rotation();
            let f = rotation * (force - self.force_bias());
            let acceleration = self.accelerations();
            let arm = rotation * arm;
            let spin = rotation * tilt.body_rates();
            let turning = Vector3::new(acceleration[ROLL], acceleration[PITCH], acceleration[YAW]);
            let lever = turning.cross(&arm) + spin.cross(&spin.cross(&arm));
            // Specific force along the vertical, which a tilt error leaks into the horizontal. Its
            // fluctuation tells tilt from bias, as long as the horizontal force has no fluctuation
            // of its own that goes with it: on a platform that turns about a point away from the
            // sensor it has, and led the tilt 0.1 rad astray. What a hull feels that leaves the water and
            // slams goes with such a force, too (0.02 rad).
            let known = self.unexplained.factor(SURGE).max(self.unexplained.factor(SWAY));
            let lift = GRAVITY - (f.z + GRAVITY).clamp(-MOST_LIFT, MOST_LIFT) / (known * known);
            let z = f[axis] - lever[axis] - acceleration[axis] + if axis == 2 { GRAVITY } else { 0.0 };
            // What changes fast is also sampled at the wrong instant.
            let fast = self.unexplained.spread(&config.model, axis);
            let r = white + (FAST_SHARE * fast).powi(2);
            let mut row = core::mem::take(&mut self.row);
            row.clear();
            self.belief.acceleration_terms(&self.model, axis, 1.0, &mut row);
            row.push(Term::new(axis, HEAD, 1.0));
            match axis {
                SURGE => {
                    row.push(Term::new(PITCH, ETA, lift));
                    self.belief
                        .acceleration_terms(&self.model, PITCH, arm.z, &mut row);
                }
                SWAY => {
                    row.push(Term::new(ROLL, ETA, -lift));
                    self.belief
                        .acceleration_terms(&self.model, ROLL, -arm.z, &mut row);
                }
                _ => {}
            }
            let update = self.belief.update(&row, z, r, gate);
            self.row = row;
            self.note(Channel::Accelerometer, axis, update);
            let gated = matches!(update, Update::Gated { .. });
            if gated && self.remodelled && z.abs() < MOST_SHIFT[1] {
                // Not the hull has jumped but what the model takes for its rest, a step ago.
                self.jolt(axis, z, 0.5 * z * STEP_S * STEP_S, z * STEP_S);
            } else if gated && is_jolt(z, (rotation * apart.1)[axis], MOST_JOLT[1]) {
                // It has grown over the step.
                self.jolt(axis, z, 0.0, 0.5 * z * STEP_S);
            } else {
                refused += self.refuse(axis, update, z, STEP_S);
            }
        }
        self.remodelled = false;
        self.refused_imu = if refused > 0 { self.refused_imu + 1 } else { 0 };
        refused
    }

    /// Specific force at the sensor as measured and what the lever to it adds to that of the reference point,
    /// in the reference-parallel frame, m/s².
    fn measured(&self, force: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let tilt = self.tilt();
        let rotation = tilt.rotation();
        let f = rotation * (force - self.force_bias());
        let arm = rotation * self.imu_arm;
        let spin = rotation * tilt.body_rates();
        let acceleration = self.accelerations();
        let turning = Vector3::new(acceleration[ROLL], acceleration[PITCH], acceleration[YAW]);
        (f, turning.cross(&arm) + spin.cross(&spin.cross(&arm)))
    }

    /// The motion for the identification: tilt as the gyroscope carries it, vertical acceleration
    /// as measured. Tells the crests what the hull does on its slopes.
    pub(super) fn motion_sample(&mut self, force: Vector3<f64>) -> MotionSample {
        let (f, lever) = self.measured(force);
        let tilt = self.tilt();
        self.crests.watch(self.at, tilt.angles, (f - lever).into());
        let up = -(tilt.rotation() * Vector3::z());
        let (s, c) = self.reference.sin_cos();
        MotionSample {
            at: self.at,
            mean_velocity: [self.mean_velocity.x, self.mean_velocity.y],
            normal: [c * up.x - s * up.y, s * up.x + c * up.y],
            acceleration_up: -(f.z + GRAVITY - lever.z),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wild_sample_is_no_jolt_and_a_growing_rate_is_one() {
        // The second of two samples is wild by 2 rad/s: their mean by 1, their difference by 2.
        assert!(!is_jolt(1.0, 2.0, MOST_JOLT[0]));
        // A rate that grows by 20 rad/s² is off by 0.4 after a step and differs by 0.2 between its samples.
        assert!(is_jolt(0.4, 0.2, MOST_JOLT[0]) && is_jolt(-0.4, -0.2, MOST_JOLT[0]));
        assert!(!is_jolt(5.0, 0.1, MOST_JOLT[0]), "no hull turns like that");
        assert!(!is_jolt(f64::NAN, 0.0, MOST_JOLT[0]) && !is_jolt(1.0, f64::NAN, MOST_JOLT[0]));
    }
}

//! Gyroscope and accelerometer.

use alight_shared::geometry::GRAVITY;
use alight_shared::kalman::Update;
use alight_shared::vessel_model::{ETA, HEAD, HEAVE, NU, PITCH, ROLL, SURGE, SWAY, Term, YAW};
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
/// Share of the unexplained acceleration that is taken for noise of the measurement.
const FAST_SHARE: f64 = 0.1;

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

    /// Tells the account of unexplained motion; 1 when the channel was refused. What was refused may
    /// have been true: the rate (by `doubt` per unit of innovation) is that much less certain, or a
    /// real jolt that is refused by halves leaves a velocity that GNSS is not believed about.
    fn account(&mut self, channel: Channel, dof: usize, update: Update, innovation: f64, doubt: f64) -> u64 {
        self.consistency.observe(channel, update);
        let (nis, refused) = match update {
            Update::Fused { nis } => (nis, 0),
            Update::Gated { nis } => (nis, 1),
            Update::Invalid => return 1,
        };
        if refused > 0 {
            let missed = doubt * innovation.abs().min(MOST_MISSED);
            self.belief.inflate(dof, NU, missed * missed);
        }
        self.unexplained.observe(dof, nis.min(GATE), STEP_S);
        refused
    }

    /// Fuses the mean of `n` samples, taken `offset` seconds after the state's time. Returns the
    /// number of channels refused.
    pub(super) fn fuse_inertial(
        &mut self,
        config: &VesselNodeConfig,
        gyro: Vector3<f64>,
        force: Vector3<f64>,
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
        for (dof, z) in [(ROLL, measured[0]), (PITCH, measured[1]), (YAW, measured[2])] {
            let predicted = self.belief.get(dof, NU) + offset * self.belief.acceleration(&self.model, dof);
            let row = [Term::new(dof, NU, 1.0), Term::new(dof, HEAD, 1.0)];
            let innovation = z - predicted;
            let update = self.belief.update(&row, innovation, r, gate);
            refused += self.account(Channel::Gyro, dof, update, innovation, 1.0);
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
            // sensor it has, and led the tilt 0.1 rad astray.
            let known = self.unexplained.factor(SURGE).max(self.unexplained.factor(SWAY));
            let lift = GRAVITY - (f.z + GRAVITY) / (known * known);
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
            refused += self.account(Channel::Accelerometer, axis, update, z, STEP_S);
            self.row = row;
        }
        self.refused_imu = if refused > 0 { self.refused_imu + 1 } else { 0 };
        refused
    }

    /// The motion for the identification: tilt as the gyroscope carries it, vertical acceleration
    /// as measured.
    pub(super) fn motion_sample(&self, force: Vector3<f64>) -> MotionSample {
        let tilt = self.tilt();
        let rotation = tilt.rotation();
        let f = rotation * (force - self.force_bias());
        let arm = rotation * self.imu_arm;
        let spin = rotation * tilt.body_rates();
        let acceleration = self.accelerations();
        let turning = Vector3::new(acceleration[ROLL], acceleration[PITCH], acceleration[YAW]);
        let lever = turning.cross(&arm) + spin.cross(&spin.cross(&arm));
        let up = -(rotation * Vector3::z());
        let (s, c) = self.reference.sin_cos();
        MotionSample {
            at: self.at,
            mean_velocity: [self.mean_velocity.x, self.mean_velocity.y],
            normal: [c * up.x - s * up.y, s * up.x + c * up.y],
            acceleration_up: -(f.z + GRAVITY - lever.z),
        }
    }
}

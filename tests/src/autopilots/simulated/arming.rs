//! Reasons for which the autopilot denies arming, with the texts of its firmware.
//!
//! PX4 (`imuConsistencyCheck`) compares its inertial sensors by COM_ARM_IMU_ACC and COM_ARM_IMU_GYR. Two sensors that
//! are misaligned by 2 deg differ by 0.3 m/s² at rest, and by more when the deck accelerates and rotates them.
//! ArduCopter (`AP_Arming::ins_checks`) requires that the gyro calibration at its start succeeded, which fails on a
//! rotating deck (INS_GYR_CAL), and that the tilt is below ANGLE_MAX.

use alight_uav::autopilot::modes::Firmware;

use super::SimulatedAutopilot;

const MISALIGNED_RAD: f64 = 0.035;
/// Rotation rate above which a gyro calibration fails, rad/s (0.5 deg/s).
const CALIBRATES_RPS: f64 = 0.009;
/// ArduCopter's ANGLE_MAX, rad: 30 deg.
const ANGLE_MAX_RAD: f64 = 0.524;

impl SimulatedAutopilot {
    pub(super) fn arming_denial(&self) -> Option<String> {
        if let Some(text) = self.arming_fault {
            return Some(text.into());
        }
        let e = self.estimator.now();
        match self.firmware() {
            Firmware::Px4 => {
                let [accelerometer, gyro] =
                    [e.specific_force.norm(), e.rates.norm()].map(|v| MISALIGNED_RAD * v);
                let beyond = |name: &str, by: f64| by > self.parameter(name);
                let which = if beyond("COM_ARM_IMU_ACC", accelerometer) {
                    "Accel"
                } else if beyond("COM_ARM_IMU_GYR", gyro) {
                    "Gyro"
                } else {
                    return None;
                };
                Some(format!("Preflight Fail: {which} 1 inconsistent - check cal"))
            }
            Firmware::ArduCopter => {
                let (roll, pitch, _) = e.attitude.euler_angles();
                let calibrates = self.parameter("INS_GYR_CAL") > 0.0;
                if calibrates && self.started_rps > CALIBRATES_RPS {
                    return Some("Arm: Gyros not calibrated".into());
                }
                let tilted = (roll.cos() * pitch.cos()).clamp(-1.0, 1.0).acos() > ANGLE_MAX_RAD;
                tilted.then(|| "Arm: Leaning".into())
            }
        }
    }
}

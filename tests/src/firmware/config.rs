//! The plant that a firmware flies.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

use crate::drone::ROTORS;

/// Ticks of the world a second.
const TICKS_HZ: u32 = 100;

/// Motors and sensors between a firmware and the simulated drone. Position, sense and strength of the
/// rotors are the drone's own (`airframe`): four in an X, numbered as PX4 and ArduPilot number them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FirmwareConfig {
    /// Where the firmware finds its simulator; 0: the usual port (PX4 TCP 4560, ArduPilot UDP 9002).
    pub port: u16,
    /// Exchanges a second, a multiple of 100; 0: the firmware's usual (PX4 400, ArduPilot 800).
    pub exchange_hz: u32,
    /// Which of the firmware's outputs turns which rotor: front right, rear left, front left, rear right.
    pub outputs: [usize; ROTORS],
    /// Share of the square in thrust over output.
    pub thrust_curve: f64,
    /// Below this share of thrust on all rotors the motors are off.
    pub off_below: f64,
    /// Pulse widths that mean no and full thrust, us (ArduPilot).
    pub pwm_us: [f64; 2],
    /// Magnetic field, NED, gauss.
    pub field_gauss: [f64; 3],
    /// White noise of the magnetometer, gauss.
    pub magnetometer_gauss: f64,
    /// White noise of the barometer, hPa.
    pub barometer_hpa: f64,
    /// A firmware that does not answer within this time is not waited for, s.
    pub patience_s: f64,
}

impl Default for FirmwareConfig {
    fn default() -> Self {
        FirmwareConfig {
            port: 0,
            exchange_hz: 0,
            outputs: [0, 1, 2, 3],    // both number an X quadrotor so
            thrust_curve: 0.0,        // PX4's THR_MDL_FAC 0; ArduPilot: MOT_THST_EXPO 0
            off_below: 0.01,          // ours
            pwm_us: [1000.0, 2000.0], // MOT_PWM_MIN, MOT_PWM_MAX
            // About 43.5 N 16.3 E (World Magnetic Model): declination 4.7 deg, inclination 60 deg.
            field_gauss: [0.235, 0.019, 0.409],
            magnetometer_gauss: 0.002, // ours
            barometer_hpa: 0.01,       // ours: 8 cm
            patience_s: 0.05,          // ours
        }
    }
}
impl FirmwareConfig {
    /// Exchanges in a tick of the world, for a firmware that usually wants `usual_hz`.
    pub fn slices(&self, usual_hz: u32) -> u32 {
        let hz = if self.exchange_hz == 0 {
            usual_hz
        } else {
            self.exchange_hz
        };
        (hz / TICKS_HZ).max(1)
    }
}
impl Check for FirmwareConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.require(
            self.exchange_hz.is_multiple_of(TICKS_HZ) && self.exchange_hz <= 1000,
            "exchange_hz",
            self.exchange_hz,
            "0, or a multiple of 100 to 1000",
        )?;
        for k in self.outputs {
            at.require(k < 16, "outputs", k, "0 to 15")?;
        }
        at.range("thrust_curve", self.thrust_curve, 0.0, 1.0)?;
        at.range("off_below", self.off_below, 0.0, 0.2)?;
        at.ranges("pwm_us", &self.pwm_us, 500.0, 2500.0)?;
        at.require(
            self.pwm_us[1] > self.pwm_us[0],
            "pwm_us",
            self.pwm_us[1],
            "full above none",
        )?;
        at.ranges("field_gauss", &self.field_gauss, -1.0, 1.0)?;
        at.range("magnetometer_gauss", self.magnetometer_gauss, 0.0, 0.1)?;
        at.range("barometer_hpa", self.barometer_hpa, 0.0, 1.0)?;
        at.range("patience_s", self.patience_s, 0.001, 10.0)
    }
}

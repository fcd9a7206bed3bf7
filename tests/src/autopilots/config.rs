//! Configuration of the plant for a firmware.

use alight_shared::config;

use crate::physics::drone::MAX_ROTORS;

const TICKS_HZ: u32 = 100;

config! {
    /// Motors and sensors between a firmware and the simulated drone. The rotors' positions, directions and
    /// thrusts are those of the drone (`airframe`), in PX4's numbering.
    pub struct FirmwareConfig {
        /// UDP or TCP port of the simulator to which the firmware connects; 0: default (PX4 TCP 4560,
        /// ArduPilot UDP 9002).
        pub port: u16 = 0;
        /// Exchanges per second, a multiple of 100; 0: the firmware's default (PX4 400, ArduPilot 800).
        pub exchange_hz: u32 = 0;
        /// Firmware output that drives each rotor: front right, rear left, front left, rear right; on a
        /// hexarotor right, left, front left, rear right, front right, rear left.
        /// Source: numbering of PX4 and ArduPilot.
        pub outputs: [usize; MAX_ROTORS] = [0, 1, 2, 3, 4, 5];
        /// Fraction of the quadratic term in the curve of thrust against output.
        /// Source: PX4's THR_MDL_FAC 0; ArduPilot: MOT_THST_EXPO 0.
        pub thrust_curve: f64 = 0.0, in 0.0..=1.0;
        /// Motors are off while the thrust of every rotor is below this fraction of its maximum.
        pub off_below: f64 = 0.01, in 0.0..=0.2;
        /// Pulse widths of zero and full thrust, us (ArduPilot).
        /// Source: MOT_PWM_MIN, MOT_PWM_MAX.
        pub pwm_us: [f64; 2] = [1000.0, 2000.0], in 500.0..=2500.0;
        /// Magnetic field, NED, gauss.
        /// Source: World Magnetic Model at about 43.5 N 16.3 E: declination 4.7 deg, inclination 60 deg.
        pub field_gauss: [f64; 3] = [0.235, 0.019, 0.409], in -1.0..=1.0;
        /// White noise of the magnetometer, gauss.
        pub magnetometer_gauss: f64 = 0.002, in 0.0..=0.1;
        /// White noise of the barometer, hPa.
        /// Chosen: corresponds to a height of 8 cm.
        pub barometer_hpa: f64 = 0.01, in 0.0..=1.0;
        /// Time to wait for a firmware's answer, s.
        /// Chosen: longer than scheduling delays of a desktop computer. Motors keep their commands after a time-out.
        pub answer_timeout_s: f64 = 0.5, in 0.001..=10.0;
    }
    check |this, at| {
        at.require(
            this.exchange_hz.is_multiple_of(TICKS_HZ) && this.exchange_hz <= 1000,
            "exchange_hz",
            this.exchange_hz,
            "0, or a multiple of 100 up to 1000",
        )?;
        for k in this.outputs {
            at.require(k < 16, "outputs", k, "0 to 15")?;
        }
        at.require(
            this.pwm_us[1] > this.pwm_us[0],
            "pwm_us",
            this.pwm_us[1],
            "full above none",
        )?;
    }
}

impl FirmwareConfig {
    /// Exchanges per tick of the world; `usual_hz` is the firmware's default rate.
    pub fn exchanges(&self, usual_hz: u32) -> u32 {
        let hz = if self.exchange_hz == 0 {
            usual_hz
        } else {
            self.exchange_hz
        };
        (hz / TICKS_HZ).max(1)
    }
}

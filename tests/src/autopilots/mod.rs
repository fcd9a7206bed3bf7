//! The simulated drone as the plant of a real firmware (PX4, ArduPilot): sensor readings out, motor
//! commands in. Pure: bytes are made and read here, sockets belong to the process around it.
//!
//! [`px4`] speaks PX4's simulator API (MAVLink HIL messages), [`ardupilot`] ArduPilot's JSON backend. [`simulated`] is
//! an autopilot of our own with the character of either, in the place of a firmware.
//! Sea, deck, contact, wind, camera and rangefinder are those of every other landing.

pub mod ardupilot;
mod config;
pub mod px4;
mod sensors;
pub mod simulated;
pub mod stand_in;

pub use config::FirmwareConfig;
pub use sensors::FirmwareSensors;

use crate::physics::drone::MAX_ROTORS;

/// Fractions of a rotor's maximum thrust from a firmware's outputs, 0 to 1 each; None with all off.
///
/// `T / T_max = f u² + (1 - f) u` with the share `f` of the square: a rotor's thrust goes with the
/// square of its speed, and electronic speed controllers differ in what they make of `u`.
pub fn motors(config: &FirmwareConfig, outputs: &[f64]) -> Option<[f64; MAX_ROTORS]> {
    let f = config.thrust_curve;
    let thrusts = config.outputs.map(|k| {
        let u = outputs.get(k).copied().unwrap_or(0.0);
        // What is no number turns nothing.
        let u = if u.is_finite() { u.clamp(0.0, 1.0) } else { 0.0 };
        f * u * u + (1.0 - f) * u
    });
    thrusts.iter().any(|s| *s > config.off_below).then_some(thrusts)
}

#[cfg(test)]
mod tests;

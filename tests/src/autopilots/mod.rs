//! The simulated drone as the plant of a real firmware (PX4, ArduPilot): it sends sensor readings and
//! receives motor commands. This module only encodes and decodes bytes; its caller owns the sockets.
//!
//! [`px4`] implements PX4's simulator API (MAVLink HIL messages), [`ardupilot`] ArduPilot's JSON backend.
//! [`simulated`] is Alight's own autopilot model, which imitates either firmware. All three share sea, deck,
//! contact, wind, camera and rangefinder.

pub mod ardupilot;
mod config;
pub mod px4;
mod sensors;
pub mod simulated;
pub mod stand_in;

pub use config::FirmwareConfig;
pub use sensors::FirmwareSensors;

use crate::physics::drone::MAX_ROTORS;

/// Rotor thrusts from a firmware's outputs, as fractions of the maximum, 0 to 1; None if all motors are off.
///
/// `T / T_max = f u² + (1 - f) u` with the fraction `f` of the quadratic term: thrust is proportional to the
/// square of the rotor speed, and the speed's dependence on the output `u` differs between speed controllers.
pub fn motors(config: &FirmwareConfig, outputs: &[f64]) -> Option<[f64; MAX_ROTORS]> {
    let f = config.thrust_curve;
    let thrusts = config.outputs.map(|k| {
        let u = outputs.get(k).copied().unwrap_or(0.0);
        // A NaN output stops the rotor.
        let u = if u.is_finite() { u.clamp(0.0, 1.0) } else { 0.0 };
        f * u * u + (1.0 - f) * u
    });
    thrusts.iter().any(|s| *s > config.off_below).then_some(thrusts)
}

#[cfg(test)]
mod tests;

//! ArduPilot's JSON backend: ArduPilot sends its servo outputs to UDP port 9002 and waits; the plant
//! answers each with one line of JSON, which moves ArduPilot's clock to its `timestamp`.

use std::fmt::Write;

use super::{FirmwareConfig, motors};
use crate::physics::drone::{MAX_ROTORS, PlantState};

/// Port at which ArduPilot looks for a simulator.
pub const PORT: u16 = 9002;
/// Exchanges a second. ArduCopter does not arm unless its gyroscopes are read 1.8 times in each of its 400
/// loops a second, and reads them once an exchange.
pub const EXCHANGE_HZ: u32 = 800;
/// Magic number of a packet with 16 and with 32 outputs.
const MAGIC: [(u16, usize); 2] = [(18458, 16), (29569, 32)];
/// Outputs begin here.
const OUTPUTS_AT: usize = 8;

/// A packet of servo outputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Servos {
    /// Steps a second that ArduPilot would like.
    pub rate_hz: u16,
    /// Counts packets; a number that comes again is the same packet sent again.
    pub frame: u32,
    /// Pulse widths, us.
    pub pwm_us: Vec<u16>,
}

/// Reads a packet; None for anything else.
pub fn servos(bytes: &[u8]) -> Option<Servos> {
    let u16_at = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    let magic = u16_at(0)?;
    let (_, outputs) = MAGIC.into_iter().find(|(m, _)| *m == magic)?;
    if bytes.len() != OUTPUTS_AT + 2 * outputs {
        return None;
    }
    Some(Servos {
        rate_hz: u16_at(2)?,
        frame: u32::from(u16_at(4)?) | u32::from(u16_at(6)?) << 16,
        pwm_us: (0..outputs).filter_map(|k| u16_at(OUTPUTS_AT + 2 * k)).collect(),
    })
}

/// Fractions of a rotor's maximum thrust; None with all off.
pub fn rotors(config: &FirmwareConfig, servos: &Servos) -> Option<[f64; MAX_ROTORS]> {
    let [none, full] = config.pwm_us;
    let outputs: Vec<f64> = servos
        .pwm_us
        .iter()
        .map(|p| (f64::from(*p) - none) / (full - none))
        .collect();
    motors(config, &outputs)
}

/// The plant's answer: newline, compact JSON, newline. ArduPilot adds its own sensors' noise. `start_s`
/// is the true time at which its clock begins, s; positions are relative to its home, which is to be
/// the datum.
pub fn answer(truth: &PlantState, start_s: f64) -> String {
    let mut text = String::from("\n{");
    let list = |v: &[f64]| {
        let numbers: Vec<String> = v.iter().map(|x| format!("{x:.9}")).collect();
        format!("[{}]", numbers.join(","))
    };
    let q = truth.attitude;
    let _never = writeln!(
        text,
        "\"timestamp\":{:.6},\"imu\":{{\"gyro\":{},\"accel_body\":{}}},\"position\":{},\"quaternion\":{},\"velocity\":{}}}",
        truth.at.secs() - start_s,
        list(truth.rates.as_slice()),
        list(truth.specific_force.as_slice()),
        list(truth.position.as_slice()),
        list(&[q.w, q.i, q.j, q.k]),
        list(truth.velocity.as_slice()),
    );
    text
}

//! ArduPilot's JSON backend: ArduPilot sends its servo outputs to UDP port 9002 and waits. The plant answers
//! each packet with one line of JSON, whose `timestamp` sets ArduPilot's clock.

use alight_shared::frames::wxyz;
use std::fmt::Write;

use super::{FirmwareConfig, motors};
use crate::physics::drone::{MAX_ROTORS, PlantState};

pub const PORT: u16 = 9002;
/// Exchange rate, Hz. ArduCopter arms only if its gyroscopes are read 1.8 times in each of its 400 loops per second,
/// and it reads them once per exchange.
pub const EXCHANGE_HZ: u32 = 800;
/// Magic numbers of a packet with 16 outputs, and of one with 32.
const MAGIC: [(u16, usize); 2] = [(18458, 16), (29569, 32)];
/// Offset of the outputs in a packet, bytes.
const OUTPUTS_AT: usize = 8;

#[derive(Clone, Debug, PartialEq)]
pub struct Servos {
    pub rate_hz: u16,
    /// Packet counter; a repeated number marks a retransmission.
    pub frame: u32,
    pub pwm_us: Vec<u16>,
}

/// None if the bytes are not a packet of servo outputs.
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

/// Rotor thrusts as fractions of the maximum; None if all motors are off.
pub fn rotors(config: &FirmwareConfig, servos: &Servos) -> Option<[f64; MAX_ROTORS]> {
    let [none, full] = config.pwm_us;
    let outputs: Vec<f64> = servos
        .pwm_us
        .iter()
        .map(|p| (f64::from(*p) - none) / (full - none))
        .collect();
    motors(config, &outputs)
}

/// Answer of the plant: newline, compact JSON, newline. ArduPilot adds the sensor noise. `start_s` is the true time at
/// which ArduPilot's clock starts, s; positions are relative to its home, which must be the datum.
pub fn answer(truth: &PlantState, start_s: f64) -> String {
    let mut text = String::from("\n{");
    let list = |v: &[f64]| {
        let numbers: Vec<String> = v.iter().map(|x| format!("{x:.9}")).collect();
        format!("[{}]", numbers.join(","))
    };
    let _never = writeln!(
        text,
        "\"timestamp\":{:.6},\"imu\":{{\"gyro\":{},\"accel_body\":{}}},\"position\":{},\"quaternion\":{},\"velocity\":{}}}",
        truth.at.secs() - start_s,
        list(truth.rates.as_slice()),
        list(truth.specific_force.as_slice()),
        list(truth.position.as_slice()),
        list(&wxyz(&truth.attitude)),
        list(truth.velocity.as_slice()),
    );
    text
}

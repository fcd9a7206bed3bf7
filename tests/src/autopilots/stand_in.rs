//! The firmware's side of both protocols (encoding and decoding), for programs that replace a firmware.

use alight_shared::{
    frames::TrueNed, geodesy::Datum, geometry::GRAVITY, mavlink::dialect::HIL_ACTUATOR_CONTROLS_DATA,
    time::Time,
};
use alight_uav::autopilot::{
    message::{Address, HilGps, HilSensor, MavMessage, MavModeFlag},
    wire::Encoder,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::physics::drone::{MAX_ROTORS, PlantState};

/// Packet of servo outputs, each 0 to 1.
pub fn servo_packet(frame: u32, outputs: [f64; MAX_ROTORS]) -> Vec<u8> {
    let mut pulses = [1000_u16; 16];
    for (pulse, u) in pulses.iter_mut().zip(outputs) {
        *pulse = (1000.0 + 1000.0 * u) as u16;
    }
    let mut packet = 18458_u16.to_le_bytes().to_vec();
    packet.extend(400_u16.to_le_bytes());
    packet.extend(frame.to_le_bytes());
    packet.extend(pulses.iter().flat_map(|p| p.to_le_bytes()));
    packet
}

/// Parses the plant's line as ArduPilot does; None if a key is missing.
pub fn read_line(line: &str) -> Option<PlantState> {
    let after = |key: &str| line.split_once(key).map(|(_, text)| text);
    let list = |key: &str| -> Option<Vec<f64>> {
        let (numbers, _) = after(key)?.strip_prefix('[')?.split_once(']')?;
        numbers.split(',').map(|w| w.parse().ok()).collect()
    };
    let three = |key: &str| list(key)?.try_into().ok().map(|v: [f64; 3]| v.into());
    let (stamp, _) = after("\"timestamp\":")?.split_once(',')?;
    let [w, i, j, k] = list("\"quaternion\":")?.try_into().ok()?;
    Some(PlantState {
        at: Time::from_secs(stamp.parse().ok()?),
        position: three("\"position\":")?,
        velocity: three("\"velocity\":")?,
        attitude: UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)),
        rates: three("\"gyro\":")?,
        specific_force: three("\"accel_body\":")?,
    })
}

/// PX4's answer to the sample of `time_us`: motor outputs, each 0 to 1.
pub fn motor_answer(time_us: u64, outputs: [f64; MAX_ROTORS], armed: bool) -> Vec<u8> {
    let mut answer = HIL_ACTUATOR_CONTROLS_DATA {
        time_usec: time_us,
        mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        ..HIL_ACTUATOR_CONTROLS_DATA::DEFAULT
    };
    let controls = answer.controls.iter_mut().zip(outputs);
    for (c, u) in controls {
        *c = u as f32;
    }
    if armed {
        answer.mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
    }
    Encoder::default()
        .frame(
            Address::new(1, 1),
            &MavMessage::HIL_ACTUATOR_CONTROLS(answer).into(),
        )
        .unwrap_or_default()
}

pub fn place(fix: &HilGps, origin: &Datum) -> Vector3<f64> {
    let at = Datum::new(
        fix.latitude.to_degrees(),
        fix.longitude.to_degrees(),
        fix.altitude_m,
    );
    origin.to::<TrueNed>(&at).0
}

/// Correction step of a simple estimator: moves `believed` towards a fix at `place`.
pub fn correct(believed: &mut PlantState, fix: &HilGps, place: Vector3<f64>, gain: f64) {
    believed.position += (place - believed.position) * gain;
    believed.velocity += (Vector3::from(fix.velocity) - believed.velocity) * gain;
}

/// Prediction step of a simple estimator over one sample of `dt` seconds.
pub fn advance(believed: &mut PlantState, sample: &HilSensor, dt: f64) {
    believed.rates = sample.gyro.into();
    believed.specific_force = sample.accelerometer.into();
    believed.attitude *= UnitQuaternion::from_scaled_axis(believed.rates * dt);
    let acceleration = believed.attitude * believed.specific_force + Vector3::z() * GRAVITY;
    believed.velocity += acceleration * dt;
    believed.position += believed.velocity * dt;
}

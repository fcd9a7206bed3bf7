//! MAVLink 2 frames from a boat's autopilot: HEARTBEAT, HIGHRES_IMU, GPS_RAW_INT (mavlink.io: "Packet
//! serialization"; fields of common.xml, ordered by size).

use core::f64::consts::TAU;

use alight_shared::{
    geodesy::Datum,
    mavlink::{MavlinkSender, Outgoing, encode},
};

use super::{StatedErrors, put};

/// Message id, and the byte that the message's definition adds to the checksum (CRC_EXTRA).
#[derive(Clone, Copy, Debug)]
pub struct MavlinkId(pub u32, pub u8);

pub const HEARTBEAT: MavlinkId = MavlinkId(0, 50);
pub const HIGHRES_IMU: MavlinkId = MavlinkId(105, 93);
pub const GPS_RAW_INT: MavlinkId = MavlinkId(24, 24);

const SYSTEM: u8 = 1;
const AUTOPILOT: u8 = 1;

/// MAVLink 2 frame without signature.
pub fn frame(sequence: u8, MavlinkId(id, extra): MavlinkId, payload: &[u8]) -> Vec<u8> {
    let from = MavlinkSender {
        system: SYSTEM,
        component: AUTOPILOT,
        sequence,
    };
    encode(from, Outgoing::new(id, extra, payload.to_vec()), None)
}

/// Payload: custom mode, type, autopilot, base mode, status, version.
pub fn heartbeat(custom_mode: u32, [kind, autopilot, base_mode, status]: [u8; 4]) -> [u8; 9] {
    let mut p = [0; 9];
    put(&mut p, 0, &custom_mode.to_le_bytes());
    put(&mut p, 4, &[kind, autopilot, base_mode, status, 3]);
    p
}

/// Heartbeat of an active surface boat with ArduPilot.
pub fn boat_heartbeat() -> [u8; 9] {
    heartbeat(0, [11, 3, 0, 4])
}

/// Specific force, m/s², and rates, rad/s, in sensor axes.
pub fn highres_imu(at_ns: i64, force: [f64; 3], rates: [f64; 3]) -> [u8; 62] {
    let mut p = [0; 62];
    put(&mut p, 0, &time_us(at_ns));
    for (k, value) in force.into_iter().chain(rates).enumerate() {
        put(&mut p, 8 + 4 * k, &(value as f32).to_le_bytes());
    }
    // Flags: accelerometers and gyroscopes are updated.
    put(&mut p, 60, &0x3f_u16.to_le_bytes());
    p
}

/// A 3-D fix with the height of the sea above the ellipsoid; if `heading` (rad, from two antennas) is given,
/// a message without a fix.
pub fn gps_raw_int(
    at_ns: i64,
    (place, geoid_m): (Datum, f64),
    velocity: [f64; 3],
    stated: &StatedErrors,
    heading: Option<f64>,
) -> [u8; 52] {
    let fixed = heading.is_none();
    let [north, east, _] = velocity;
    let degrees = |rad: f64| rad.rem_euclid(TAU).to_degrees() * 100.0;
    let mut p = [0; 52];
    put(&mut p, 0, &time_us(at_ns));
    let signed = |v: f64| (v.round() as i32).to_le_bytes();
    put(&mut p, 8, &signed(place.latitude_deg * 1e7));
    put(&mut p, 12, &signed(place.longitude_deg * 1e7));
    put(&mut p, 16, &signed((place.height_m - geoid_m) * 1e3));
    // Dilutions of precision: unknown.
    put(&mut p, 20, &[0xff; 4]);
    put(&mut p, 24, &centi(100.0 * north.hypot(east)));
    put(&mut p, 26, &centi(degrees(east.atan2(north))));
    put(&mut p, 28, &[if fixed { 3 } else { 1 }, 12]);
    put(&mut p, 30, &signed(place.height_m * 1e3));
    let unsigned = |v: f64| ((v * 1e3).round() as u32).to_le_bytes();
    put(&mut p, 34, &unsigned(stated.position_m));
    put(&mut p, 38, &unsigned(stated.position_m));
    put(&mut p, 42, &unsigned(stated.velocity_mps));
    // 0 means that there is no heading, so north is encoded as 36000.
    let yaw = heading.map_or([0; 2], |h| match centi(degrees(h)) {
        [0, 0] => 36_000_u16.to_le_bytes(),
        other => other,
    });
    put(&mut p, 50, &yaw);
    p
}

fn centi(value: f64) -> [u8; 2] {
    (value.round() as u16).to_le_bytes()
}

fn time_us(at_ns: i64) -> [u8; 8] {
    (at_ns / 1000).max(0).to_le_bytes()
}

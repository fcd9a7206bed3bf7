//! UBX messages from a receiver: NAV-PVT, NAV-RELPOSNED (u-blox F9 HPG 1.32, "Interface description",
//! UBX-22008968, sections 3.15.11 and 3.15.13).

use core::f64::consts::TAU;

use alight_shared::{geodesy::Datum, msg::CarrierSolution};

use super::{StatedErrors, put};

const NAV: u8 = 0x01;
const PVT: u8 = 0x07;
const RELPOSNED: u8 = 0x3c;
const WEEK_MS: i64 = 7 * 86_400_000;

/// Sync bytes, class, id, length, payload, and two checksum bytes over class to payload (RFC 1145 with 8 bits).
pub fn message(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u16).to_le_bytes();
    let mut bytes = vec![0xb5, 0x62, class, id, length[0], length[1]];
    bytes.extend_from_slice(payload);
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in bytes.iter().skip(2) {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    bytes.extend([a, b]);
    bytes
}

/// Time of week, ms.
fn of_week(at_ns: i64) -> [u8; 4] {
    ((at_ns / 1_000_000).rem_euclid(WEEK_MS) as u32).to_le_bytes()
}

/// A signed and an unsigned field in units of `unit`.
fn signed(value: f64, unit: f64) -> [u8; 4] {
    ((value / unit).round() as i32).to_le_bytes()
}
fn unsigned(value: f64, unit: f64) -> [u8; 4] {
    ((value / unit).round() as u32).to_le_bytes()
}

/// NAV-PVT of a 3-D fix: position with its heights above ellipsoid and sea; velocity to north, east, down, m/s.
pub fn nav_pvt(
    at_ns: i64,
    (place, geoid_m): (Datum, f64),
    velocity: [f64; 3],
    stated: &StatedErrors,
) -> Vec<u8> {
    let [north, east, down] = velocity;
    let (speed, course) = (north.hypot(east), east.atan2(north).to_degrees());
    let mut p = [0_u8; 92];
    put(&mut p, 0, &of_week(at_ns));
    // Valid 3-D fix (gnssFixOK), 12 satellites, no valid date.
    put(&mut p, 20, &[3, 1, 0, 12]);
    put(&mut p, 24, &signed(place.longitude_deg, 1e-7));
    put(&mut p, 28, &signed(place.latitude_deg, 1e-7));
    put(&mut p, 32, &signed(place.height_m, 1e-3));
    put(&mut p, 36, &signed(place.height_m - geoid_m, 1e-3));
    put(&mut p, 40, &unsigned(stated.position_m, 1e-3));
    put(&mut p, 44, &unsigned(stated.position_m, 1e-3));
    put(&mut p, 48, &signed(north, 1e-3));
    put(&mut p, 52, &signed(east, 1e-3));
    put(&mut p, 56, &signed(down, 1e-3));
    put(&mut p, 60, &signed(speed, 1e-3));
    put(&mut p, 64, &signed(course.rem_euclid(360.0), 1e-5));
    put(&mut p, 68, &unsigned(stated.velocity_mps, 1e-3));
    // Course accuracy: unknown, as at rest.
    put(&mut p, 72, &unsigned(180.0, 1e-5));
    put(&mut p, 76, &120_u16.to_le_bytes());
    message(NAV, PVT, &p)
}

/// NAV-RELPOSNED of a drone's receiver that uses a moving base: vector between the antennas, NED, m, and its
/// standard deviations, m.
pub fn nav_relposned_of_place(
    at_ns: i64,
    place_m: [f64; 3],
    sd_m: [f64; 3],
    solution: CarrierSolution,
) -> Vec<u8> {
    let carrier = match solution {
        CarrierSolution::None => 0_u32,
        CarrierSolution::Float => 1,
        CarrierSolution::Fixed => 2,
    };
    let mut p = [0_u8; 64];
    put(&mut p, 0, &[1]);
    put(&mut p, 4, &of_week(at_ns));
    for (k, (metres, sd)) in place_m.into_iter().zip(sd_m).enumerate() {
        // Centimetres, and the remainder in units of 0.1 mm.
        let cm = (100.0 * metres).trunc();
        put(&mut p, 8 + 4 * k, &(cm as i32).to_le_bytes());
        put(
            &mut p,
            32 + k,
            &((1e4 * metres - 100.0 * cm).round() as i8).to_le_bytes(),
        );
        put(&mut p, 36 + 4 * k, &unsigned(sd, 1e-4));
    }
    // gnssFixOK, diffSoln, relPosValid, isMoving.
    put(&mut p, 60, &(0b10_0111 | carrier << 3).to_le_bytes());
    message(NAV, RELPOSNED, &p)
}

/// NAV-RELPOSNED of a rover 1 m from its moving base: heading of the line between them, and its standard
/// deviation, rad.
pub fn nav_relposned(at_ns: i64, heading: f64, sd: f64) -> Vec<u8> {
    let heading = heading.rem_euclid(TAU);
    let (east, north) = heading.sin_cos();
    let mut p = [0_u8; 64];
    put(&mut p, 0, &[1]);
    put(&mut p, 4, &of_week(at_ns));
    put(&mut p, 8, &signed(north, 1e-2));
    put(&mut p, 12, &signed(east, 1e-2));
    put(&mut p, 20, &signed(1.0, 1e-2));
    put(&mut p, 24, &signed(heading.to_degrees(), 1e-5));
    put(&mut p, 52, &unsigned(sd.to_degrees(), 1e-5));
    // gnssFixOK, diffSoln, relPosValid, carrSoln fixed, isMoving, relPosHeadingValid.
    put(&mut p, 60, &0b1_0011_0111_u32.to_le_bytes());
    message(NAV, RELPOSNED, &p)
}

//! NMEA 2000 as text from a gateway (Yacht Devices RAW): one CAN frame per line. Layouts: canboat's database.

use alight_shared::geodesy::Datum;

const SOURCE: u32 = 35;
const PRIORITY: u32 = 2;

fn line(at_ns: i64, pgn: u32, data: &[u8]) -> Vec<u8> {
    let id = PRIORITY << 26 | pgn << 8 | SOURCE;
    let ms = at_ns.div_euclid(1_000_000).rem_euclid(86_400_000);
    let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
    let bytes: String = data.iter().map(|b| format!(" {b:02X}")).collect();
    format!(
        "{hours:02}:{minutes:02}:{seconds:02}.{:03} R {id:08X}{bytes}\r\n",
        ms % 1000
    )
    .into_bytes()
}
/// Encodes an angle in units of 0.1 mrad, from 0 to a full turn.
fn angle(rad: f64) -> [u8; 2] {
    ((rad.rem_euclid(core::f64::consts::TAU) * 1e4).round() as u16).to_le_bytes()
}

/// 127250: true heading, rad.
pub fn heading(at_ns: i64, heading: f64) -> Vec<u8> {
    let [a, b] = angle(heading);
    line(at_ns, 127_250, &[0xff, a, b, 0xff, 0x7f, 0xff, 0x7f, 0xfc])
}
/// 129026: course and speed over ground, from the velocity to north and east, m/s.
pub fn velocity(at_ns: i64, [north, east]: [f64; 2]) -> Vec<u8> {
    let [a, b] = angle(east.atan2(north));
    let [c, d] = ((north.hypot(east) * 100.0).round() as u16).to_le_bytes();
    line(at_ns, 129_026, &[0xff, 0xfc, a, b, c, d, 0xff, 0xff])
}
/// 127251: rate of turn, rad/s.
pub fn rate_of_turn(at_ns: i64, rate: f64) -> Vec<u8> {
    let [a, b, c, d] = ((rate * 32e6).round() as i32).to_le_bytes();
    line(at_ns, 127_251, &[0xff, a, b, c, d, 0xff, 0xff, 0xff])
}
/// 127252: heave, m up.
pub fn heave(at_ns: i64, heave_m: f64) -> Vec<u8> {
    let [a, b] = ((heave_m * 100.0).round() as i16).to_le_bytes();
    line(at_ns, 127_252, &[0xff, a, b, 0xff, 0xff, 0xff, 0xff, 0xff])
}
/// 127257: roll and pitch, rad.
pub fn attitude(at_ns: i64, tilt: [f64; 2]) -> Vec<u8> {
    let [[a, b], [c, d]] = tilt.map(|x| ((x * 1e4).round() as i16).to_le_bytes());
    line(at_ns, 127_257, &[0xff, 0xff, 0x7f, c, d, a, b, 0xff])
}
/// 129025: position without a height.
pub fn position(at_ns: i64, place: Datum) -> Vec<u8> {
    let place = [place.latitude_deg, place.longitude_deg].map(|d| ((d * 1e7).round() as i32).to_le_bytes());
    line(at_ns, 129_025, &place.concat())
}
fn frames(at_ns: i64, pgn: u32, message: &[u8], sequence: u8) -> Vec<u8> {
    let head = sequence << 5;
    let (first, rest) = message.split_at(6);
    let mut bytes = line(at_ns, pgn, &[&[head, message.len() as u8], first].concat());
    for (part, k) in rest.chunks(7).zip(1..) {
        bytes.extend(line(at_ns, pgn, &[&[head | k], part].concat()));
    }
    bytes
}
/// 130842 of Furuno: angular rates of roll, pitch and yaw, rad/s.
pub fn rates(at_ns: i64, rates: [f64; 3], sequence: u8) -> Vec<u8> {
    let mut message = vec![0x3f, 0x9f];
    message.resize(15, 0);
    for rate in rates {
        message.extend(((rate.to_degrees() * 1e3).round() as i32).to_le_bytes());
    }
    message.extend([0, 0]);
    frames(at_ns, 130_842, &message, sequence)
}
/// 129029: fix of quality 1 with its dilution of precision, in seven frames.
pub fn gnss(at_ns: i64, place: Datum, hdop: f64, sequence: u8) -> Vec<u8> {
    let wide = |x: f64, steps: f64| ((x * steps).round() as i64).to_le_bytes();
    let day_ns = at_ns.rem_euclid(86_400_000_000_000);
    let mut message = vec![0xff];
    message.extend(20_000_u16.to_le_bytes());
    message.extend(((day_ns / 100_000) as u32).to_le_bytes());
    message.extend(wide(place.latitude_deg, 1e16));
    message.extend(wide(place.longitude_deg, 1e16));
    message.extend(wide(place.height_m, 1e6));
    message.extend([0x10, 0xfc, 12]);
    message.extend(((hdop * 100.0).round() as i16).to_le_bytes());
    message.extend([0xff, 0x7f]);
    message.extend([0xff, 0xff, 0xff, 0x7f, 0]);
    frames(at_ns, 129_029, &message, sequence)
}

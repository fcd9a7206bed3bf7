//! NMEA 0183 sentences from a receiver and a compass: GGA, VTG, ZDA, HDT (u-blox, "Receiver description
//! including protocol specification", UBX-13003221, chapter NMEA messages).

use core::f64::consts::TAU;

use alight_shared::geodesy::Datum;

/// Knots per m/s, and km/h per m/s.
const KNOTS: f64 = 3600.0 / 1852.0;
const KMH: f64 = 3.6;
/// Decimals of minutes and metres, of usual and of high-precision receivers.
pub const USUAL: [usize; 2] = [5, 1];
pub const FINE: [usize; 2] = [7, 3];

/// `$`, the body, `*`, the exclusive or of its bytes in two hexadecimal digits, carriage return, line feed.
pub fn sentence(body: &str) -> Vec<u8> {
    let mut sum = 0_u8;
    for byte in body.bytes() {
        sum ^= byte;
    }
    format!("${body}*{sum:02X}\r\n").into_bytes()
}

/// `hhmmss.ss` of a time since midnight, ns.
fn time_of_day(utc_ns: i64) -> String {
    let hundredths = utc_ns.rem_euclid(86_400_000_000_000) / 10_000_000;
    let (seconds, hundredths) = (hundredths / 100, hundredths % 100);
    format!(
        "{:02}{:02}{:02}.{hundredths:02}",
        seconds / 3600,
        seconds / 60 % 60,
        seconds % 60
    )
}

/// Degrees with `width` digits, minutes with `digits` decimals, and the letter of the hemisphere.
fn degrees_minutes(degrees: f64, width: usize, digits: usize, letters: [char; 2]) -> String {
    // Counting in units of the last digit never rounds minutes to 60.
    let unit = 10_f64.powi(digits as i32);
    let all = (degrees.abs() * 60.0 * unit).round();
    let whole = (all / (60.0 * unit)).floor();
    let minutes = (all - whole * 60.0 * unit) / unit;
    let letter = letters[usize::from(degrees < 0.0)];
    format!("{whole:0width$.0}{minutes:0m$.digits$},{letter}", m = digits + 3)
}

#[derive(Clone, Copy, Debug)]
pub struct Gga {
    /// Time since midnight, ns.
    pub utc_ns: i64,
    /// Position; its height is above the ellipsoid.
    pub place: Datum,
    /// Height of the sea above the ellipsoid, m.
    pub geoid_m: f64,
    pub hdop: f64,
    pub satellites: u8,
}

impl Gga {
    /// A fix without corrections (quality 1), with the given decimals of minutes and metres.
    pub fn sentence(&self, [minutes, metres]: [usize; 2]) -> Vec<u8> {
        let Gga {
            place,
            geoid_m,
            hdop,
            satellites,
            ..
        } = self;
        sentence(&format!(
            "GPGGA,{},{},{},1,{satellites:02},{hdop:.2},{:.metres$},M,{geoid_m:.metres$},M,,",
            time_of_day(self.utc_ns),
            degrees_minutes(place.latitude_deg, 2, minutes, ['N', 'S']),
            degrees_minutes(place.longitude_deg, 3, minutes, ['E', 'W']),
            place.height_m - geoid_m,
        ))
    }
}

/// Course and speed over ground, from the velocity to north and east, m/s.
pub fn vtg([north, east]: [f64; 2]) -> Vec<u8> {
    let course = east.atan2(north).rem_euclid(TAU).to_degrees();
    let speed = north.hypot(east);
    sentence(&format!(
        "GPVTG,{course:.2},T,,M,{:.3},N,{:.3},K,A",
        speed * KNOTS,
        speed * KMH
    ))
}

/// Time since midnight, ns, and day, month, year if known.
pub fn zda(utc_ns: i64, date: Option<[u16; 3]>) -> Vec<u8> {
    let date = date.map_or(",,".into(), |[day, month, year]| {
        format!("{day:02},{month:02},{year}")
    });
    sentence(&format!("GPZDA,{},{date},00,00", time_of_day(utc_ns)))
}

/// True heading, rad.
pub fn hdt(heading: f64) -> Vec<u8> {
    sentence(&format!("GPHDT,{:.2},T", heading.rem_euclid(TAU).to_degrees()))
}

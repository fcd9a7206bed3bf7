//! Names of columns: which quantity, in which unit.
//!
//! A name is a quantity and a unit: `roll_deg`, `Roll (deg)`, `"Heave [m]"`, `acc_x [m/s²]`, `vel_n_m_s`. A quantity
//! without a unit is not read: a roll of 0.2 may be degrees or radians.

use super::Dimension::{Acceleration, Angle, Length, Rate, Speed};
use super::{Dimension, Quantity};

/// A quantity: its own name, which has its unit, the largest magnitude that a cell may have, other names for it.
pub(super) struct Known {
    pub(super) name: &'static str,
    pub(super) limit: f64,
    dimension: Dimension,
    /// Lower case, letters and digits only.
    names: &'static [&'static str],
}

const fn known(
    name: &'static str,
    limit: f64,
    dimension: Dimension,
    names: &'static [&'static str],
) -> Known {
    Known {
        name,
        limit,
        dimension,
        names,
    }
}

/// In the order of [`Quantity`].
pub(super) const KNOWN: [Known; Quantity::COUNT] = [
    known("roll_deg", 75.0, Angle, &["roll", "rollangle"]),
    known("pitch_deg", 75.0, Angle, &["pitch", "pitchangle"]),
    known(
        "heading_deg",
        1e5,
        Angle,
        &["heading", "hdg", "headingtrue", "trueheading", "hdt"],
    ),
    known("heave_m", 50.0, Length, &["heave"]),
    known("surge_m", 1e5, Length, &["surge"]),
    known("sway_m", 1e5, Length, &["sway"]),
    known(
        "gyro_x_radps",
        50.0,
        Rate,
        &["gyrox", "gyrx", "gyroscopex", "angularratex", "angularvelocityx"],
    ),
    known(
        "gyro_y_radps",
        50.0,
        Rate,
        &["gyroy", "gyry", "gyroscopey", "angularratey", "angularvelocityy"],
    ),
    known(
        "gyro_z_radps",
        50.0,
        Rate,
        &["gyroz", "gyrz", "gyroscopez", "angularratez", "angularvelocityz"],
    ),
    known(
        "accel_x_mps2",
        500.0,
        Acceleration,
        &[
            "accelx",
            "accx",
            "accelerometerx",
            "accelerationx",
            "specificforcex",
        ],
    ),
    known(
        "accel_y_mps2",
        500.0,
        Acceleration,
        &[
            "accely",
            "accy",
            "accelerometery",
            "accelerationy",
            "specificforcey",
        ],
    ),
    known(
        "accel_z_mps2",
        500.0,
        Acceleration,
        &[
            "accelz",
            "accz",
            "accelerometerz",
            "accelerationz",
            "specificforcez",
        ],
    ),
    known("latitude_deg", 90.0, Angle, &["latitude", "lat"]),
    known(
        "longitude_deg",
        360.0,
        Angle,
        &["longitude", "lon", "lng", "long"],
    ),
    known(
        "altitude_m",
        1e4,
        Length,
        &["altitude", "alt", "height", "ellipsoidalheight", "hae"],
    ),
    known(
        "north_mps",
        100.0,
        Speed,
        &[
            "north",
            "veln",
            "vn",
            "velnorth",
            "vnorth",
            "velocitynorth",
            "northvelocity",
        ],
    ),
    known(
        "east_mps",
        100.0,
        Speed,
        &[
            "east",
            "vele",
            "ve",
            "veleast",
            "veast",
            "velocityeast",
            "eastvelocity",
        ],
    ),
    known(
        "down_mps",
        100.0,
        Speed,
        &[
            "down",
            "veld",
            "vd",
            "veldown",
            "vdown",
            "velocitydown",
            "downvelocity",
        ],
    ),
    known("sog_mps", 100.0, Speed, &["sog", "speedoverground"]),
    known("cog_deg", 1e5, Angle, &["cog", "courseoverground"]),
];

/// Names of the time.
const TIMES: &[&str] = &[
    "t",
    "time",
    "timestamp",
    "ts",
    "elapsed",
    "elapsedtime",
    "utc",
    "utctime",
    "timeutc",
    "gpstime",
    "datetime",
    "dateandtime",
    "dateutc",
    "datetimeutc",
    "localtime",
    "logtime",
    "sampletime",
    "unixtime",
    "epoch",
    "epochtime",
];

/// Units of a dimension, letters and digits only (`m/s²` is `ms2`), with what turns them into those of [`KNOWN`].
const UNITS: &[(Dimension, &[&str], f64)] = &[
    (
        Angle,
        &[
            "deg",
            "degs",
            "degree",
            "degrees",
            "degt",
            "degtrue",
            "decimaldegrees",
            "decdeg",
        ],
        1.0,
    ),
    (
        Angle,
        &["rad", "rads", "radian", "radians"],
        180.0 / core::f64::consts::PI,
    ),
    (Angle, &["mrad"], 0.18 / core::f64::consts::PI),
    (Length, &["m", "meter", "meters", "metre", "metres"], 1.0),
    (
        Length,
        &["cm", "centimeter", "centimeters", "centimetre", "centimetres"],
        1e-2,
    ),
    (
        Length,
        &["mm", "millimeter", "millimeters", "millimetre", "millimetres"],
        1e-3,
    ),
    (Length, &["ft", "foot", "feet"], 0.3048),
    (Rate, &["radps", "rads", "radsec", "radpersec", "radianss"], 1.0),
    (
        Rate,
        &["degps", "degs", "dps", "degsec", "degpersec", "degreess"],
        core::f64::consts::PI / 180.0,
    ),
    (Acceleration, &["mps2", "ms2", "mss", "msec2"], 1.0),
    (Acceleration, &["g"], 9.80665),
    (Acceleration, &["mg"], 9.80665e-3),
    (Speed, &["mps", "ms", "msec"], 1.0),
    (
        Speed,
        &["kn", "kt", "kts", "kns", "knot", "knots"],
        1852.0 / 3600.0,
    ),
    (Speed, &["kmh", "kph"], 1.0 / 3.6),
];
/// Units of time, s.
const SECONDS: &[(&[&str], f64)] = &[
    (&["s", "sec", "secs", "second", "seconds"], 1.0),
    (&["ms", "msec", "millis", "millisecond", "milliseconds"], 1e-3),
    (&["us", "usec", "micros", "microsecond", "microseconds"], 1e-6),
    (&["ns", "nsec", "nanos", "nanosecond", "nanoseconds"], 1e-9),
];

/// What a column's name says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Name {
    /// The time; with a unit, its seconds.
    Time(Option<f64>),
    /// A quantity, with what turns its unit into that of [`KNOWN`].
    Quantity(usize, f64),
    /// A quantity whose unit is not stated, or not known.
    WithoutUnit(usize),
    /// Something else.
    Other,
}

impl Name {
    /// It names something that is read, if only its unit were known.
    pub(super) fn is_known(self) -> bool {
        !matches!(self, Name::Other)
    }
}

/// Lower-case words of letters and digits: `RollAngle_deg` is `roll angle deg`.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    let mut lower = false;
    for c in text.chars() {
        let letters = match c {
            '°' | 'º' => "deg",
            '²' => "2",
            'µ' | 'μ' => "u",
            c if c.is_ascii_alphanumeric() => {
                if lower && c.is_ascii_uppercase() {
                    words.push(core::mem::take(&mut word));
                }
                lower = c.is_ascii_lowercase();
                word.push(c.to_ascii_lowercase());
                continue;
            }
            // A power, not the end of a word.
            '^' => continue,
            _ => "",
        };
        lower = false;
        if letters.is_empty() && !word.is_empty() {
            words.push(core::mem::take(&mut word));
        }
        word += letters;
    }
    if !word.is_empty() {
        words.push(word);
    }
    words
}

/// A name without its brackets, and what the last of them encloses.
fn bracketed(name: &str) -> Option<(&str, &str)> {
    let name = name.trim();
    let close = name.chars().last()?;
    let open = match close {
        ']' => '[',
        ')' => '(',
        '}' => '{',
        '>' => '<',
        _ => return None,
    };
    let (base, unit) = name.strip_suffix(close)?.rsplit_once(open)?;
    Some((base, unit))
}

fn seconds(unit: &str) -> Option<f64> {
    SECONDS
        .iter()
        .find(|(names, _)| names.contains(&unit))
        .map(|(_, s)| *s)
}
fn factor(dimension: Dimension, unit: &str) -> Option<f64> {
    UNITS
        .iter()
        .find(|(d, names, _)| *d == dimension && names.contains(&unit))
        .map(|(_, _, factor)| *factor)
}
fn quantity(base: &str) -> Option<(usize, Dimension)> {
    let k = KNOWN.iter().position(|k| k.names.contains(&base))?;
    Some((k, KNOWN.get(k)?.dimension))
}

/// What a column's name says.
pub(super) fn name(text: &str) -> Name {
    if let Some((base, unit)) = bracketed(text) {
        let (base, unit) = (words(base).concat(), words(unit).concat());
        if TIMES.contains(&base.as_str()) {
            return Name::Time(seconds(&unit));
        }
        return match quantity(&base) {
            Some((k, dimension)) => {
                factor(dimension, &unit).map_or(Name::WithoutUnit(k), |f| Name::Quantity(k, f))
            }
            // The brackets may hold more of the name: `Heading (true)_deg`.
            None => plain(text),
        };
    }
    plain(text)
}

/// The same of a name whose unit is its last words.
fn plain(text: &str) -> Name {
    let words = words(text);
    for end in (1..words.len()).rev() {
        let (Some(base), Some(unit)) = (words.get(..end), words.get(end..)) else {
            continue;
        };
        let (base, unit) = (base.concat(), unit.concat());
        if TIMES.contains(&base.as_str())
            && let Some(s) = seconds(&unit)
        {
            return Name::Time(Some(s));
        }
        if let Some((k, dimension)) = quantity(&base)
            && let Some(factor) = factor(dimension, &unit)
        {
            return Name::Quantity(k, factor);
        }
    }
    let all = words.concat();
    if TIMES.contains(&all.as_str()) {
        return Name::Time(None);
    }
    quantity(&all).map_or(Name::Other, |(k, _)| Name::WithoutUnit(k))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_columns() {
        let of = |q: Quantity| q as usize;
        for (text, want) in [
            ("t_s", Name::Time(Some(1.0))),
            ("Time [s]", Name::Time(Some(1.0))),
            ("timestamp_ms", Name::Time(Some(1e-3))),
            ("Time (UTC)", Name::Time(None)),
            ("time", Name::Time(None)),
            ("roll_deg", Name::Quantity(of(Quantity::Roll), 1.0)),
            ("Roll (°)", Name::Quantity(of(Quantity::Roll), 1.0)),
            ("Roll Angle [deg]", Name::Quantity(of(Quantity::Roll), 1.0)),
            ("HeadingTrue_deg", Name::Quantity(of(Quantity::Heading), 1.0)),
            ("Heave [cm]", Name::Quantity(of(Quantity::Heave), 1e-2)),
            ("gyro_z_radps", Name::Quantity(of(Quantity::GyroZ), 1.0)),
            (
                "Gyr_X [deg/s]",
                Name::Quantity(of(Quantity::GyroX), core::f64::consts::PI / 180.0),
            ),
            ("Acc_Z (m/s²)", Name::Quantity(of(Quantity::ForceZ), 1.0)),
            ("accel_z_m_s2", Name::Quantity(of(Quantity::ForceZ), 1.0)),
            ("Acc_Y [m/s^2]", Name::Quantity(of(Quantity::ForceY), 1.0)),
            ("vel_n_m_s", Name::Quantity(of(Quantity::North), 1.0)),
            ("SOG (kn)", Name::Quantity(of(Quantity::Speed), 1852.0 / 3600.0)),
            ("roll", Name::WithoutUnit(of(Quantity::Roll))),
            ("Heave [counts]", Name::WithoutUnit(of(Quantity::Heave))),
            ("heave_sd_m", Name::Other),
            ("roll_raw", Name::Other),
            ("yaw_deg", Name::Other),
            ("north_m", Name::Other),
            ("", Name::Other),
        ] {
            assert_eq!(name(text), want, "{text}");
        }
        // The own names are read as they are.
        for (k, known) in KNOWN.iter().enumerate() {
            assert_eq!(name(known.name), Name::Quantity(k, 1.0), "{}", known.name);
        }
    }
}

//! Numbers for flags, with units where they have one: `15kn`, `10m/s`, `90s`, `5min`.

use std::{ops::RangeInclusive, str::FromStr};

use alight_shared::geodesy::KNOT_MPS;

const SPEEDS: [(&str, f64); 4] = [
    ("m/s", 1.0),
    ("kn", KNOT_MPS),
    ("kt", KNOT_MPS),
    ("km/h", 1.0 / 3.6),
];
const TIMES: [(&str, f64); 4] = [("s", 1.0), ("min", 60.0), ("h", 3600.0), ("ms", 1e-3)];

pub const SECOND: (&str, f64) = ("s", 1.0);
pub const MINUTE: (&str, f64) = ("min", 60.0);

fn split(text: &str, units: &[(&str, f64)]) -> Result<(f64, Option<f64>), String> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    if let Some(plain) = number(text) {
        return Ok((plain, None));
    }
    let with = |(name, size): &(&str, f64)| Some((number(text.trim().strip_suffix(name)?)?, Some(*size)));
    units.iter().find_map(with).ok_or_else(|| {
        let names: Vec<&str> = units.iter().map(|u| u.0).collect();
        format!(
            "a number is needed, such as 1.5, alone or with a unit: {}",
            names.join(", ")
        )
    })
}

/// Speed, m/s; a plain number is in m/s.
pub fn speed_mps(text: &str) -> Result<f64, String> {
    split(text, &SPEEDS).map(|(number, unit)| number * unit.unwrap_or(1.0))
}

/// Duration, s; a plain number is in s.
pub fn duration_s(text: &str) -> Result<f64, String> {
    split(text, &TIMES).map(|(number, unit)| number * unit.unwrap_or(1.0))
}

/// Parser of a whole number in `range`.
pub fn whole<T: TryFrom<i64>>(range: RangeInclusive<i64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        if let Ok(number) = text.parse()
            && range.contains(&number)
            && let Ok(number) = T::try_from(number)
        {
            return Ok(number);
        }
        let low = range.start();
        let high = range.end();
        Err(format!("a whole number from {low} to {high} is needed"))
    }
}

pub fn seconds(range: RangeInclusive<u32>) -> impl Fn(&str) -> Result<u32, String> + Clone {
    move |text| text.parse::<WrittenTime>()?.whole(SECOND, &range)
}

/// Time as written; the command decides the unit of a plain number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrittenTime(f64, Option<f64>);

impl FromStr for WrittenTime {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        split(text, &TIMES).map(|(number, unit)| WrittenTime(number, unit))
    }
}

impl WrittenTime {
    pub fn whole(self, (name, unit_s): (&str, f64), range: &RangeInclusive<u32>) -> Result<u32, String> {
        let count = self.1.map_or(self.0, |s| self.0 * s / unit_s);
        let low = *range.start();
        let high = *range.end();
        if count.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&count) {
            return Ok(count as u32);
        }
        Err(format!("a whole number from {low} to {high} {name} is needed"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_speed_and_time() {
        let speeds = ["7", "10m/s", "10 m/s", "3.6km/h", "-2"].map(|t| speed_mps(t).unwrap());
        assert_eq!(speeds, [7.0, 10.0, 10.0, 1.0, -2.0]);
        assert!((speed_mps("15kn").unwrap() - 7.716_667).abs() < 1e-6);
        let times = ["90", "90s", "5min", "1e1s", "500ms", "1h"].map(|t| duration_s(t).unwrap());
        assert_eq!(times, [90.0, 90.0, 300.0, 10.0, 0.5, 3600.0]);
        for wrong in ["", "kn", "5 miles", "5min", "s"] {
            assert!(speed_mps(wrong).unwrap_err().contains("kn"), "{wrong}");
        }
    }

    #[test]
    fn whole_numbers_within_a_range() {
        let stars = whole::<u8>(1..=5);
        assert_eq!(stars("5"), Ok(5));
        for wrong in ["0", "6", "", "1.5", "-1", "99999999999999999999"] {
            assert!(stars(wrong).unwrap_err().contains("from 1 to 5"), "{wrong}");
        }
        assert_eq!(seconds(1..=600)("5min"), Ok(300));
        let minutes = |text: &str| text.parse::<WrittenTime>()?.whole(MINUTE, &(1..=30));
        assert_eq!((minutes("10"), minutes("120s")), (Ok(10), Ok(2)));
        for wrong in ["31", "90s", "0", "-1", "NaN"] {
            assert!(minutes(wrong).unwrap_err().contains("1 to 30 min"), "{wrong}");
        }
    }
}

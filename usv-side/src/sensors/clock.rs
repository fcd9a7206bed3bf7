//! Date and time formats of sources.

use time::{Date, Month};

pub(super) const DAY_NS: i64 = 86_400_000_000_000;
/// Julian day number of 1 January 1970.
const JULIAN_1970: i32 = 2_440_588;

/// Parses `hhmmss` with an optional fraction to nanoseconds of the day.
pub(super) fn time_of_day_ns(text: &str) -> Option<i64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    if whole.len() != 6 || !digits(whole) || !digits(fraction) || fraction.len() > 9 {
        return None;
    }
    let two = |k: usize| whole.get(k..k + 2).and_then(|t| t.parse::<i64>().ok());
    let (h, m, s) = (two(0)?, two(2)?, two(4)?);
    // 60 is a leap second.
    if h > 23 || m > 59 || s > 60 {
        return None;
    }
    let fraction: i64 = format!("{fraction:0<9}").parse().ok()?;
    Some(((h * 60 + m) * 60 + s) * 1_000_000_000 + fraction)
}

/// Parses `hh:mm:ss` with an optional fraction to nanoseconds of the day.
pub(super) fn of_day_ns(text: &str) -> Option<i64> {
    let bytes = text.as_bytes();
    let colons = bytes.get(2) == Some(&b':') && bytes.get(5) == Some(&b':');
    colons.then(|| time_of_day_ns(&text.replacen(':', "", 2)))?
}
/// Parses a UTC date and time (`2016-04-09T16:41:09.078Z`) to nanoseconds since 1970.
pub(super) fn utc_ns(text: &str) -> Option<i64> {
    let text = text
        .strip_suffix('Z')
        .or(text.strip_suffix("+00:00"))
        .unwrap_or(text);
    let (date, time) = text.split_at_checked(10)?;
    let time = time.strip_prefix(['T', '-', ' ', '_'])?;
    let mut parts = date.split('-');
    let mut part = || parts.next().filter(|p| p.bytes().all(|b| b.is_ascii_digit()));
    let (year, month, day) = (
        part()?.parse().ok()?,
        part()?.parse::<u8>().ok()?,
        part()?.parse().ok()?,
    );
    let date = Date::from_calendar_date(year, Month::try_from(month).ok()?, day).ok()?;
    let days = i64::from(date.to_julian_day() - JULIAN_1970);
    days.checked_mul(DAY_NS)?.checked_add(of_day_ns(time)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn date_and_time_of_day() {
        let at = 1_460_220_069_078_000_000;
        for text in [
            "2016-04-09T16:41:09.078Z",
            "2016-04-09-16:41:09.078",
            "2016-04-09T16:41:09.078+00:00",
        ] {
            assert_eq!(utc_ns(text), Some(at), "{text}");
        }
        for text in [
            "",
            "2016-04-09",
            "2016-13-09T16:41:09Z",
            "2016-04-31T16:41:09Z",
            "2016-04-09T24:41:09Z",
            "9999-04-09T16:41:09Z",
            "2016-04-09T16:41:09+02:00",
            "+016-04-09T16:41:09Z",
            "2016-04-é9T16:41:09Z",
            "16:41:09.078",
        ] {
            assert_eq!(utc_ns(text), None, "{text}");
        }
    }
}

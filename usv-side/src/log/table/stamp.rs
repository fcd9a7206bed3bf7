//! Times of rows: seconds in any unit, or clocks with or without a date.

use time::{Date, Month};

/// Years in which something was recorded.
const YEARS: core::ops::Range<i32> = 1970..2200;
/// The Julian day number of 1 January 1970.
const JULIAN_1970: i32 = 2_440_588;
/// A day, s.
const DAY_S: f64 = 86_400.0;
/// A clock that goes back by more has passed midnight, s.
const MIDNIGHT_S: f64 = 43_200.0;

/// A time as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stamp {
    /// In seconds.
    Seconds(f64),
    /// A time of day (s, of UTC where a zone is given), of a day.
    Clock(Option<Day>, f64),
}

/// A day as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Day {
    /// By its number.
    Number(i32),
    /// Two numbers of which one is the day and one the month, and the year.
    Either(u8, u8, i32),
}

/// A number without a unit is a count since 1970 where it can be nothing else: its seconds.
pub(super) fn epoch_unit(value: f64) -> Option<f64> {
    // From 2001 to 2286 in seconds, and the same in the smaller units.
    let of = |unit: f64| (1e9..1e10).contains(&(value * unit)).then_some(unit);
    [1.0, 1e-3, 1e-6, 1e-9].into_iter().find_map(of)
}

/// A date and a time of day: `2026-05-20T12:00:00.10Z`, `20.05.2026 12:00:00`, `12:00:00,1`, `1:02:03 PM`.
pub(super) fn clock(text: &str) -> Option<Stamp> {
    let text = text.trim();
    let colon = text.find(':')?;
    let head = text.get(..colon)?;
    let begin = head.rfind([' ', 'T', 't', '_']).map_or(0, |k| k + 1);
    let date = text.get(..begin)?.trim_end_matches([' ', 'T', 't', '_', ',']);
    let day = if date.is_empty() { None } else { Some(day(date)?) };
    let of_day = text.get(begin..)?.to_ascii_lowercase();
    let mut rest = of_day.trim_end();
    for zone in ["utc", "gmt", "z"] {
        rest = rest.strip_suffix(zone).unwrap_or(rest).trim_end();
    }
    let (rest, half) = match (rest.strip_suffix("am"), rest.strip_suffix("pm")) {
        (Some(r), _) => (r.trim_end(), Some(0.0)),
        (_, Some(r)) => (r.trim_end(), Some(12.0)),
        (None, None) => (rest, None),
    };
    let (rest, zone_s) = match rest.rfind(['+', '-']) {
        Some(k) => (rest.get(..k)?.trim_end(), zone(rest.get(k..)?)?),
        None => (rest, 0.0),
    };
    let rest = rest.replace(',', ".");
    let parts: Vec<&str> = rest.split(':').collect();
    let (h, m, s) = match parts.as_slice() {
        [h, m] => (h, m, "0"),
        [h, m, s] => (h, m, *s),
        _ => return None,
    };
    let mut hour = f64::from(digits(h)?);
    if let Some(half) = half {
        if !(1.0..=12.0).contains(&hour) {
            return None;
        }
        hour = hour % 12.0 + half;
    }
    let minute = f64::from(digits(m)?);
    let plain = s.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    let second: f64 = s.parse().ok().filter(|_| plain)?;
    // 60 is a leap second.
    let valid = hour < 24.0 && minute < 60.0 && (0.0..61.0).contains(&second);
    valid.then_some(Stamp::Clock(day, (hour * 60.0 + minute) * 60.0 + second - zone_s))
}

fn digits(text: &str) -> Option<u16> {
    let all = !text.is_empty() && text.len() <= 4 && text.bytes().all(|b| b.is_ascii_digit());
    text.parse().ok().filter(|_| all)
}

/// `+02:00`, `-0330`, `+2`, s east.
fn zone(text: &str) -> Option<f64> {
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text.strip_prefix('+')?),
    };
    let (h, m) = match (rest.split_once(':'), rest.len()) {
        (Some((h, m)), _) => (digits(h)?, digits(m)?),
        (None, 4) => (digits(rest.get(..2)?)?, digits(rest.get(2..)?)?),
        (None, _) => (digits(rest)?, 0),
    };
    (h < 24 && m < 60).then(|| sign * 60.0 * f64::from(h * 60 + m))
}

fn day(text: &str) -> Option<Day> {
    let parts: Vec<&str> = text.split(['-', '/', '.']).collect();
    let [a, b, c] = parts.as_slice() else { return None };
    let small = |t: &str| digits(t).and_then(|v| u8::try_from(v).ok());
    if a.len() == 4 {
        return number(i32::from(digits(a)?), small(b)?, small(c)?).map(Day::Number);
    }
    if c.len() != 4 {
        return None;
    }
    let (a, b, year) = (small(a)?, small(b)?, i32::from(digits(c)?));
    if text.contains('.') {
        return number(year, b, a).map(Day::Number);
    }
    (number(year, b, a).is_some() || number(year, a, b).is_some()).then_some(Day::Either(a, b, year))
}

/// Days since 1970.
fn number(year: i32, month: u8, day: u8) -> Option<i32> {
    let month = Month::try_from(month).ok()?;
    let date = Date::from_calendar_date(year, month, day).ok()?;
    YEARS.contains(&year).then(|| date.to_julian_day() - JULIAN_1970)
}

/// The times, s, in the order of the rows; else which of them is unclear, and why. Clocks without a date go on over
/// midnight.
pub(super) fn resolve(stamps: &[Stamp]) -> Result<Vec<f64>, (usize, String)> {
    let either = || {
        stamps.iter().enumerate().filter_map(|(k, s)| match s {
            Stamp::Clock(Some(Day::Either(a, b, year)), _) => Some((k, (*a, *b, *year))),
            Stamp::Clock(_, _) | Stamp::Seconds(_) => None,
        })
    };
    let day_first = either().any(|(_, (a, _, _))| a > 12);
    let month_first = either().any(|(_, (_, b, _))| b > 12);
    let first = either().next();
    let other = first.and_then(|(_, day)| either().find(|(_, d)| *d != day));
    if let Some((k, (a, b, year))) = other.filter(|_| day_first == month_first) {
        let message = format!(
            "the date {a}/{b}/{year} may begin with its day or its month; write dates as year-month-day"
        );
        return Err((k, message));
    }
    let mut days = 0.0;
    let mut before = f64::NEG_INFINITY;
    let time = |(k, stamp): (usize, &Stamp)| {
        let (day, of_day) = match stamp {
            Stamp::Seconds(s) => return Ok(*s),
            Stamp::Clock(day, of_day) => (day, *of_day),
        };
        match day {
            Some(Day::Number(n)) => Ok(f64::from(*n) * DAY_S + of_day),
            // The same day in every row where neither order is known.
            Some(Day::Either(_, _, _)) if day_first == month_first => Ok(of_day),
            Some(Day::Either(a, b, year)) => {
                let (day, month) = if day_first { (*a, *b) } else { (*b, *a) };
                let n = number(*year, month, day);
                let n =
                    n.ok_or_else(|| (k, format!("{a}/{b}/{year} is no date as the others are written")))?;
                Ok(f64::from(n) * DAY_S + of_day)
            }
            None => {
                if of_day + days < before - MIDNIGHT_S {
                    days += DAY_S;
                }
                before = of_day + days;
                Ok(before)
            }
        }
    };
    stamps.iter().enumerate().map(time).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(texts: &[&str]) -> Result<Vec<f64>, (usize, String)> {
        let stamps: Vec<Stamp> = texts.iter().map(|t| clock(t).unwrap()).collect();
        resolve(&stamps)
    }

    #[test]
    fn clocks_and_dates() {
        let noon = |text: &str| match clock(text) {
            Some(Stamp::Clock(_, s)) => s,
            other => panic!("{text}: {other:?}"),
        };
        for text in [
            "12:00:00.5",
            "12:00:00,5",
            "2026-05-20T12:00:00.500Z",
            "2026-05-20 14:00:00.5+02:00",
            "2026/05/20 12:00:00.5 UTC",
            "20.05.2026 12:00:00.5",
            "5/20/2026 12:00:00.5 PM",
            "2026-05-20T08:30:00.5-0330",
        ] {
            assert_eq!(noon(text), 43_200.5, "{text}");
        }
        for bad in [
            "12",
            "25:00:00",
            "12:60:00",
            "12:00:xx",
            "12:00:-1",
            "13:00:00 PM",
            "2026-13-01 12:00:00",
            "0026-01-01 12:00:00",
            "20/05/26 12:00:00",
            "yesterday 12:00:00",
            "12:00:00:01",
            ":",
            "é:ü",
        ] {
            assert_eq!(clock(bad), None, "{bad}");
        }
        let t = times(&["2026-12-31 23:59:59.9", "2027-01-01 00:00:00"]).unwrap();
        assert!((t[1] - t[0] - 0.1).abs() < 1e-4, "{t:?}");
        let t = times(&["23:59:59.9", "00:00:00.1", "00:00:00.0"]).unwrap();
        assert!((t[1] - t[0] - 0.2).abs() < 1e-9 && t[2] < t[1], "{t:?}");
    }

    #[test]
    fn dates_with_day_or_month_first() {
        assert!(times(&["5/6/2026 1:00:00", "5/6/2026 1:00:01"]).is_ok());
        let t = times(&["30/6/2026 23:59:59", "1/7/2026 0:00:00"]).unwrap();
        assert_eq!(t[1] - t[0], 1.0);
        let t = times(&["6/30/2026 23:59:59", "7/1/2026 0:00:00"]).unwrap();
        assert_eq!(t[1] - t[0], 1.0);
        let (k, message) = times(&["5/6/2026 23:59:59", "5/7/2026 0:00:00"]).unwrap_err();
        assert!(k == 1 && message.contains("year-month-day"), "{message}");
    }

    #[test]
    fn counts_since_1970() {
        assert_eq!(epoch_unit(1.78e9), Some(1.0));
        assert_eq!(epoch_unit(1.78e12), Some(1e-3));
        assert_eq!(epoch_unit(1.78e18), Some(1e-9));
        assert_eq!([0.0, 12.5, 120_000.0, f64::NAN].map(epoch_unit), [None; 4]);
    }
}

//! Text formats in which gateways and loggers output NMEA 2000.
//!
//! ```text
//! 17:33:21.141 R 09F80115 A0 7D E6 18 C0 05 FB D5             Yacht Devices RAW: a CAN frame
//! (1436509052.249713) can0 09F80115#A07DE618C005FBD5          candump -L: the same
//!  (1436509052.249713)  can0  09F80115   [8]  A0 7D E6 18     candump -ta, with or without the time; -tA with a date; -tz from
//!                                                             zero; -x with the direction and flags behind the interface
//! A173321.107 23FF7 1F513 012F3070002F30709F                  Actisense N2K ASCII: a whole message
//! 2016-04-09T16:41:09.078Z,3,127257,17,255,8,00,ff,7f,52,00   canboat's plain format: either
//! ```

use crate::sensors::clock::{of_day_ns, time_of_day_ns, utc_ns};

/// Longest message, bytes: 6 in the first and 7 in each of 31 further frames.
pub(super) const MAX_MESSAGE: usize = 223;
/// Smallest time that counts as a time since 1970 (a date in 2001), ns.
const EPOCH_NS: i64 = 1_000_000_000_000_000_000;
/// Bytes of a CAN frame.
pub(super) const FRAME: usize = 8;

/// Time at which a line was written, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum N2kStamp {
    /// Since midnight.
    OfDay(i64),
    /// Since 1970.
    Unix(i64),
    /// Since the first or the previous line.
    Relative(i64),
    None,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct N2kLine {
    pub(super) at: N2kStamp,
    /// Parameter group number.
    pub(super) pgn: u32,
    /// Address of its sender.
    pub(super) source: u8,
    pub(super) data: Vec<u8>,
    /// The line holds a whole message, possibly longer than a frame.
    pub(super) whole: bool,
}

impl N2kLine {
    /// Parses a line; None for any other kind of line.
    pub(super) fn parse(text: &str) -> Option<N2kLine> {
        let text = text.trim();
        if text.split(',').count() > 6 {
            return plain(text);
        }
        if let Some((stamp, rest)) = text.strip_prefix('(').and_then(|t| t.split_once(')')) {
            let at = match unix_ns(stamp) {
                // candump's times are since 1970 or, with -td and -tz, since another line.
                Some(at_ns) if at_ns < EPOCH_NS => N2kStamp::Relative(at_ns),
                Some(at_ns) => N2kStamp::Unix(at_ns),
                None => N2kStamp::Unix(utc_ns(stamp)?),
            };
            let fields: Vec<&str> = rest.split_whitespace().take(FRAME + 6).collect();
            return candump(at, &fields);
        }
        let fields: Vec<&str> = text.split_whitespace().take(FRAME + 6).collect();
        let (first, rest) = fields.split_first()?;
        if first.starts_with('A') && fields.len() == 4 {
            return actisense(&fields);
        }
        match of_day_ns(first) {
            Some(at) => frame(N2kStamp::OfDay(at), rest.get(1)?, rest.get(2..)?),
            None => candump(N2kStamp::None, &fields),
        }
    }
}

/// Parameter group and sender of a 29-bit CAN identifier (ISO 11783-3); addressed groups have no extension.
fn identifier(text: &str) -> Option<(u32, u8)> {
    let id = u32::from_str_radix(text, 16).ok().filter(|id| *id < 1 << 29)?;
    let (page, format, specific) = ((id >> 24) & 3, (id >> 16) & 0xff, (id >> 8) & 0xff);
    let extension = if format >= 240 { specific } else { 0 };
    Some((page << 16 | format << 8 | extension, (id & 0xff) as u8))
}
fn byte(text: &str) -> Option<u8> {
    (text.len() == 2).then(|| u8::from_str_radix(text, 16).ok())?
}
fn bytes(text: &str) -> Option<Vec<u8>> {
    let whole = text.is_ascii() && text.len().is_multiple_of(2) && text.len() <= 2 * MAX_MESSAGE;
    let all = text.as_bytes().chunks(2);
    whole.then(|| all.map(|two| byte(core::str::from_utf8(two).ok()?)).collect())?
}
fn frame(at: N2kStamp, id: &str, data: &[&str]) -> Option<N2kLine> {
    let (pgn, source) = identifier(id)?;
    let data: Vec<u8> = data.iter().map(|b| byte(b)).collect::<Option<_>>()?;
    (data.len() <= FRAME).then_some(N2kLine {
        at,
        pgn,
        source,
        data,
        whole: false,
    })
}
/// Interface, then identifier and bytes, in either of candump's two formats.
fn candump(at: N2kStamp, fields: &[&str]) -> Option<N2kLine> {
    let (_, rest) = fields.split_first()?;
    let rest = match rest {
        ["RX" | "TX", _, _, rest @ ..] => rest,
        rest => rest,
    };
    let (id, rest) = rest.split_first()?;
    let Some((id, data)) = id.split_once('#') else {
        let (length, data) = rest.split_first()?;
        let length: usize = length.strip_prefix('[')?.strip_suffix(']')?.parse().ok()?;
        return frame(at, id, data.get(..length)?);
    };
    let (pgn, source) = identifier(id)?;
    let data = bytes(data).filter(|d| d.len() <= FRAME)?;
    Some(N2kLine {
        at,
        pgn,
        source,
        data,
        whole: false,
    })
}
/// `Ahhmmss.ddd`, sender, receiver and priority in one field, number, bytes.
fn actisense(fields: &[&str]) -> Option<N2kLine> {
    let [time, addresses, pgn, data] = fields else {
        return None;
    };
    let at = time_of_day_ns(time.strip_prefix('A')?)?;
    Some(N2kLine {
        at: N2kStamp::OfDay(at),
        pgn: u32::from_str_radix(pgn, 16).ok()?,
        source: byte(addresses.get(..2)?)?,
        data: bytes(data)?,
        whole: true,
    })
}
/// Time, priority, number, sender, receiver, length, bytes.
fn plain(text: &str) -> Option<N2kLine> {
    let mut fields = text.split(',');
    let time = fields.next()?;
    let at = match of_day_ns(time.trim_end_matches('Z')) {
        Some(of_day) => N2kStamp::OfDay(of_day),
        None => N2kStamp::Unix(utc_ns(time)?),
    };
    let pgn = fields.nth(1)?.parse().ok()?;
    let source = fields.next()?.parse().ok()?;
    let length: usize = fields.nth(1)?.parse().ok().filter(|n| *n <= MAX_MESSAGE)?;
    let data: Vec<u8> = fields.map(byte).collect::<Option<_>>()?;
    (data.len() == length).then_some(N2kLine {
        at,
        pgn,
        source,
        whole: length > FRAME,
        data,
    })
}
/// Seconds since 1970 with a fraction, to nanoseconds.
fn unix_ns(text: &str) -> Option<i64> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = |t: &str| t.len() <= 10 && t.bytes().all(|b| b.is_ascii_digit());
    if !digits(seconds) || !digits(fraction) || fraction.len() > 9 {
        return None;
    }
    let fraction: i64 = format!("{fraction:0<9}").parse().ok()?;
    let whole = seconds.parse::<i64>().ok()?.checked_mul(1_000_000_000)?;
    whole.checked_add(fraction)
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn n2k_lines_of_gateways_and_loggers() {
        let position = [0xa0, 0x7d, 0xe6, 0x18, 0xc0, 0x05, 0xfb, 0xd5];
        let of_day = (17 * 60 + 33) * 60_000_000_000 + 21_141_000_000;
        for (text, at) in [
            // Example in Yacht Devices' manual.
            (
                "17:33:21.141 R 09F80115 A0 7D E6 18 C0 05 FB D5",
                N2kStamp::OfDay(of_day),
            ),
            (
                "(1436509052.250000) can0 09F80115#A07DE618C005FBD5",
                N2kStamp::Unix(1_436_509_052_250_000_000),
            ),
            (
                " (1436509052.250000)  can0  09F80115   [8]  A0 7D E6 18 C0 05 FB D5",
                N2kStamp::Unix(1_436_509_052_250_000_000),
            ),
            ("can0  09F80115   [8]  A0 7D E6 18 C0 05 FB D5", N2kStamp::None),
            (
                "(000.001234) can0 09F80115#A07DE618C005FBD5",
                N2kStamp::Relative(1_234_000),
            ),
            (
                " (2016-04-09 16:41:09.078000)  can0  09F80115   [8]  A0 7D E6 18 C0 05 FB D5",
                N2kStamp::Unix(1_460_220_069_078_000_000),
            ),
            (
                " (1436509052.250000)  can0  RX - -  09F80115   [8]  A0 7D E6 18 C0 05 FB D5",
                N2kStamp::Unix(1_436_509_052_250_000_000),
            ),
        ] {
            let line = N2kLine::parse(text).unwrap();
            assert_eq!(
                (line.at, line.pgn, line.source, line.whole),
                (at, 129_025, 0x15, false),
                "{text}"
            );
            assert_eq!(line.data, position, "{text}");
        }
        // From a public test of a parser for canboat's format: attitude without yaw.
        let line =
            N2kLine::parse("2016-04-09T16:41:09.078Z,3,127257,17,255,8,00,ff,7f,52,00,21,fe,ff").unwrap();
        assert_eq!(
            (line.pgn, line.source, line.data.len(), line.whole),
            (127_257, 17, 8, false)
        );
        assert_eq!(line.at, N2kStamp::Unix(1_460_220_069_078_000_000));
        // Example in Actisense's manual: group 130323, longer than a frame.
        let line = N2kLine::parse("A173321.107 23FF7 1F513 012F3070002F30709F").unwrap();
        assert_eq!(
            (line.pgn, line.source, line.data.len(), line.whole),
            (0x1f513, 0x23, 9, true)
        );
    }

    #[test]
    fn n2k_lines_that_are_none() {
        for text in [
            "",
            "$GPGGA,1,2,3,4,5,6,7",
            "17:33:21.141 R",
            "17:33:21.141 R 09F80115 A0 7D E6 18 C0 05 FB D5 00",
            "17:33:21.141 R FFFFFFFF A0",
            "25:33:21.141 R 09F80115 A0",
            "(x) can0 09F80115#A0",
            "(9999999999.0) can0 09F80115#A0",
            "can0 09F80115 [9] A0",
            "can0 09F80115#A0Z",
            "A173321.107 23FF7 1F513 012",
            "2016-04-09T16:41:09.078Z,3,127257,17,255,9,00,ff",
            "é,é,é,é,é,é,é",
        ] {
            assert_eq!(N2kLine::parse(text), None, "{text}");
        }
    }
}

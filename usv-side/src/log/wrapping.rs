//! Wrapping of lines by their logger, removed before decoding.

use std::borrow::Cow;

const MAX_QUOTED: usize = 256 << 10;
/// Digits of milliseconds since 1970, for 2001 to 2286.
const MILLIS_DIGITS: usize = 13;

/// Line without its logger's wrapping.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Peeled<'a> {
    /// Arrival time recorded by the logger, ns since 1970.
    pub(super) arrival_ns: Option<i64>,
    /// Line with its terminator.
    pub(super) content: Cow<'a, [u8]>,
}

impl<'a> Peeled<'a> {
    /// Removes time and name of a Signal K raw log (`milliseconds;name;line`), or the quotes of a table cell.
    pub(super) fn of(line: &'a [u8]) -> Self {
        let (arrival_ns, rest) = match raw_log(line) {
            Some((at_ns, rest)) => (Some(at_ns), rest),
            None => (None, line),
        };
        let content = quoted(rest).map_or(Cow::Borrowed(rest), Cow::Owned);
        Peeled { arrival_ns, content }
    }
}

/// Time and line after the prefix of a raw log.
fn raw_log(line: &[u8]) -> Option<(i64, &[u8])> {
    let mut parts = line.splitn(3, |b| *b == b';');
    let millis = parts.next()?;
    let _name = parts.next()?;
    let rest = parts.next()?;
    if millis.len() != MILLIS_DIGITS || !millis.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let millis: i64 = core::str::from_utf8(millis).ok()?.parse().ok()?;
    Some((millis.checked_mul(1_000_000)?, rest))
}

/// Longest quoted cell of a line, as a line. Quotes inside a sentence or object belong to it.
fn quoted(line: &[u8]) -> Option<Vec<u8>> {
    let first = line.iter().find(|b| matches!(b, b'"' | b'{' | b'$' | b'!'))?;
    if *first != b'"' || line.len() > MAX_QUOTED {
        return None;
    }
    let mut longest = Vec::new();
    let mut cell = None;
    let mut bytes = line.iter().copied().peekable();
    while let Some(b) = bytes.next() {
        match (b, cell.take()) {
            (b'"', None) => cell = Some(Vec::new()),
            // A doubled quote stands for one quote.
            (b'"', Some(mut open)) if bytes.next_if_eq(&b'"').is_some() => {
                open.push(b'"');
                cell = Some(open);
            }
            (b'"', Some(closed)) => {
                if closed.len() > longest.len() {
                    longest = closed;
                }
            }
            (b, Some(mut open)) => {
                open.push(b);
                cell = Some(open);
            }
            (_, None) => {}
        }
    }
    longest.push(b'\n');
    (longest.len() > 1).then_some(longest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_in_what_loggers_write_around_them() {
        let raw = "17:33:21.141 R 09F80115 A0 7D\n";
        let delta = "{\"updates\":[]}\n";
        for (line, content, arrival_ns) in [
            (raw.to_owned(), raw, None),
            (
                format!("1779278400123;A;{raw}"),
                raw,
                Some(1_779_278_400_123_000_000),
            ),
            (
                format!("1779278400123;I;{delta}"),
                delta,
                Some(1_779_278_400_123_000_000),
            ),
            (format!("\"12:00\",\"{}\",7\r\n", raw.trim_end()), raw, None),
            ("1,\"{\"\"updates\"\":[]}\"\n".to_owned(), delta, None),
            ("12;A;x\n".to_owned(), "12;A;x\n", None),
            ("$GPTXT,01,\"a\"*00\n".to_owned(), "$GPTXT,01,\"a\"*00\n", None),
        ] {
            let peeled = Peeled::of(line.as_bytes());
            assert_eq!(peeled.arrival_ns, arrival_ns, "{line}");
            assert_eq!(&*peeled.content, content.as_bytes(), "{line}");
        }
    }
}

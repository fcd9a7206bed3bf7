//! NMEA 2000 as text of a gateway or a logger.

use super::{Gather, LogError, Recording};
use crate::sensors::{Decoder, Mount, Mounting, N2kDecoder};

/// Lines that are looked at, and how many of them have to be such messages.
const LOOKED_AT: usize = 40;
const ENOUGH: usize = 5;

/// Lines of the beginning show messages of NMEA 2000.
pub(super) fn is_n2k(head: &[u8]) -> bool {
    let mut decoder = N2kDecoder::new(&Mounting::default());
    for line in head.split_inclusive(|b| *b == b'\n').take(LOOKED_AT) {
        decoder.push(line, &mut Vec::new());
    }
    let found = decoder.decoded();
    let messages = found.good + found.ignored;
    messages >= ENOUGH as u64 && messages > found.corrupted
}

/// Reads the messages.
pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<Recording, LogError> {
    let mut decoder = N2kDecoder::new(&Mounting::new(mount));
    let (mut gather, mut decoded) = (Gather::default(), Vec::new());
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        decoder.push(line, &mut decoded);
        decoded.drain(..).for_each(|m| gather.push(m, 0));
    }
    let count = decoder.decoded();
    let found = format!(
        "{} messages that are used, {} of other groups, {} damaged lines",
        count.good, count.ignored, count.corrupted
    );
    let missing = gather.missing();
    let mut notes = vec![match missing.is_empty() {
        true => found.clone(),
        false => format!("{found}; of all that came {missing}"),
    }];
    notes.extend(decoder.remarks().into_iter().map(|r| r.text));
    Ok(Recording {
        format: "NMEA 2000",
        measurements: gather.finish(origin, &found)?,
        decoded: count,
        notes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn n2k_recording_of_a_gateway() {
        // Attitude at 10 Hz, a position each second, wind that is not read.
        let mut text = String::new();
        for k in 0..300 {
            let at = format!("12:00:{:06.3}", 0.1 * f64::from(k));
            text += &format!("{at} R 09F11923 FF FF 7F 52 00 21 FE FF\r\n");
            if k % 10 == 0 {
                text += &format!("{at} R 09F80115 A0 7D E6 18 C0 05 FB D5\r\n");
                text += &format!("{at} R 09FD0223 FF 64 00 10 27 FA FF FF\r\n");
            }
        }
        let r = crate::log::read(text.as_bytes(), "boat.txt", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.decoded.ignored),
            ("NMEA 2000", 330, 30)
        );
        assert_eq!(r.measurements.len(), 330);
        let said = r.notes.join("\n");
        assert!(
            said.contains("no heading") && said.contains("30 130306"),
            "{said}"
        );
    }
}

//! What went over a boat's networks, a message a line: NMEA 2000 as text of a gateway or a logger, and deltas of Signal K.

use alight_shared::time::Time;

use super::wrapping::Peeled;
use super::{Gather, LogError, Recording};
use crate::sensors::{Decoder, Mount, Mounting, N2kDecoder, SignalKDecoder, SourceMeasurement};

/// Lines that are looked at, and how many of their messages have to be such.
const LOOKED_AT: usize = 40;
const ENOUGH: u64 = 5;

/// A format of lines.
#[derive(Clone, Copy, Debug)]
pub(super) enum Bus {
    N2k,
    SignalK,
}

impl Bus {
    /// Which of them the lines of the beginning are.
    pub(super) fn of(head: &[u8]) -> Option<Bus> {
        [Bus::N2k, Bus::SignalK].into_iter().find(|bus| bus.begins(head))
    }
    fn begins(self, head: &[u8]) -> bool {
        let mut decoder = self.decoder(&Mounting::default());
        for line in head.split_inclusive(|b| *b == b'\n').take(LOOKED_AT) {
            decoder.push(&Peeled::of(line).content, &mut Vec::new());
        }
        let found = decoder.decoded();
        let messages = found.good + found.ignored;
        messages >= ENOUGH && messages > found.corrupted
    }
    fn decoder(self, mounting: &Mounting) -> Box<dyn Decoder> {
        match self {
            Bus::N2k => Box::new(N2kDecoder::new(mounting)),
            Bus::SignalK => Box::new(SignalKDecoder::new(mounting)),
        }
    }
    /// Reads the messages.
    pub(super) fn read(self, bytes: &[u8], origin: &str, mount: &Mount) -> Result<Recording, LogError> {
        let mut decoder = self.decoder(&Mounting::new(mount));
        let (mut gather, mut decoded) = (Gather::default(), Vec::new());
        for line in bytes.split_inclusive(|b| *b == b'\n') {
            let peeled = Peeled::of(line);
            // A delta has the time of its update.
            let arrival_ns = peeled.arrival_ns.filter(|_| matches!(self, Bus::N2k));
            if let Some(at_ns) = arrival_ns {
                decoder.arrive(Time::from_nanos(at_ns));
            }
            decoder.push(&peeled.content, &mut decoded);
            let own = decoder.timeless().into_iter().zip(arrival_ns.into_iter().cycle());
            decoded.extend(own.map(|(m, at_ns)| SourceMeasurement::new(at_ns, m)));
            decoded.drain(..).for_each(|m| gather.push(m, 0));
        }
        decoder.finish(&mut decoded);
        decoded.drain(..).for_each(|m| gather.push(m, 0));
        let count = decoder.decoded();
        let (format, messages, others) = match self {
            Bus::N2k => ("NMEA 2000", "messages", "groups"),
            Bus::SignalK => ("Signal K", "values", "paths or vessels"),
        };
        let found = format!(
            "{} {messages} that are used, {} of other {others}, {} damaged lines",
            count.good, count.ignored, count.corrupted
        );
        let missing = gather.missing();
        let mut notes = vec![match missing.is_empty() {
            true => found.clone(),
            false => format!("{found}; of all that came {missing}"),
        }];
        notes.extend(decoder.remarks().into_iter().map(|r| r.text));
        Ok(Recording {
            format,
            measurements: gather.finish(origin, &found)?,
            decoded: count,
            notes,
        })
    }
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

    #[test]
    fn n2k_recording_in_a_raw_log_and_in_quotes() {
        let frame = "09F11923 FF FF 7F 52 00 21 FE FF";
        let timeless = "can0  09F11923   [8]  FF FF 7F 52 00 21 FE FF";
        let mut texts = [String::new(), String::new(), String::new()];
        for k in 0..300_u64 {
            let line = format!("12:00:{:02}.{} R {frame}", k / 10, k % 10);
            let [raw, quoted, by_arrival] = &mut texts;
            *raw += &format!("{};A;{line}\n", 1_779_278_400_000 + 100 * k);
            *quoted += &format!("{k},\"{line}\",3\n");
            *by_arrival += &format!("{};A;{timeless}\n", 1_779_278_400_000 + 100 * k);
        }
        for text in texts {
            let r = crate::log::read(text.as_bytes(), "boat.log", &Mount::default()).unwrap();
            assert_eq!(
                (
                    r.format,
                    r.decoded.good,
                    r.decoded.corrupted,
                    r.measurements.len()
                ),
                ("NMEA 2000", 300, 0, 300),
                "{text:.80}"
            );
            let last = r.measurements.last().map(|m| m.at().secs()).unwrap_or_default();
            assert!((last - 29.9).abs() < 0.1, "{last}");
        }
    }

    #[test]
    fn signalk_recording_with_a_loggers_prefix() {
        let mut text = String::from(
            "{\"name\":\"signalk-server\",\"self\":\"urn:mrn:imo:mmsi:1\",\"version\":\"2.8.0\"}\n",
        );
        for k in 0..300 {
            let at = format!("2026-05-20T12:00:{:06.3}Z", 0.1 * f64::from(k));
            text += &format!(
                "1779278400000;I;{{\"updates\":[{{\"$source\":\"n2k.5\",\"timestamp\":\"{at}\",\"values\":[\
                 {{\"path\":\"navigation.attitude\",\"value\":{{\"roll\":0.1,\"pitch\":0.0,\"yaw\":0.0}}}},\
                 {{\"path\":\"environment.wind.speedApparent\",\"value\":7.0}}]}}]}}\n"
            );
        }
        let r = crate::log::read(text.as_bytes(), "boat.log", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.decoded.ignored, r.measurements.len()),
            ("Signal K", 300, 300, 299)
        );
        let said = r.notes.join("\n");
        assert!(
            said.contains("no position, no heading") && said.contains("300 speedApparent"),
            "{said}"
        );
    }
}

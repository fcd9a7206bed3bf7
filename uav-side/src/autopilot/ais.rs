//! Vessel position by AIS: `!AIVDM` and `!AIVDO` sentences from a receiver (NMEA 0183, ITU-R M.1371).
//!
//! Decodes position reports of class A (types 1, 2, 3) and class B (18, 19) with a valid checksum. AIS is not
//! authenticated.

use std::collections::VecDeque;

use alight_shared::{
    geodesy::KNOT_MPS,
    lines::{Cut, LineBuffer},
};
use nmea_kit::{
    ais::{AisMessage, AisParser, PositionReport},
    parse_frame,
};

use super::place_report::{AisReport, PlaceReport};

/// Maximum sentence length, bytes: the standard's 82 plus a logger's tags.
const MAX_LINE: usize = 256;
/// Queue length: more reports than a receiver outputs in a second.
const MAX_REPORTS: usize = 32;

pub struct AisDecoder {
    lines: LineBuffer,
    parser: AisParser,
    reports: VecDeque<AisReport>,
}

impl Default for AisDecoder {
    fn default() -> Self {
        AisDecoder {
            lines: LineBuffer::new(MAX_LINE),
            parser: AisParser::default(),
            reports: VecDeque::default(),
        }
    }
}

impl AisDecoder {
    /// Decodes bytes; when the queue is full, the oldest report is dropped.
    pub fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(Cut::Line(line)) = self.lines.push(*byte) {
                self.take(&line);
            }
        }
    }
    pub fn next_report(&mut self) -> Option<AisReport> {
        self.reports.pop_front()
    }
    fn take(&mut self, line: &[u8]) {
        if let Some(report) = self.sentence(line) {
            if self.reports.len() == MAX_REPORTS {
                self.reports.pop_front();
            }
            self.reports.push_back(report);
        }
    }
    fn sentence(&mut self, line: &[u8]) -> Option<AisReport> {
        let text = core::str::from_utf8(line).ok().filter(|t| t.is_ascii())?;
        // IEC 61162-450 tags may precede the sentence. A sentence without a checksum may be truncated.
        let sentence = text.get(text.find('!')?..).filter(|s| s.contains('*'))?;
        let frame = parse_frame(sentence).ok()?;
        match self.parser.decode(&frame)? {
            AisMessage::Position(report) => placed(&report),
            _ => None,
        }
    }
}

fn placed(report: &PositionReport) -> Option<AisReport> {
    let speed_mps = report.sog.map(|knots| f64::from(knots) * KNOT_MPS);
    let velocity = match (speed_mps, report.cog) {
        (Some(speed_mps), Some(course_deg)) => {
            let (sin, cos) = f64::from(course_deg).to_radians().sin_cos();
            Some([speed_mps * cos, speed_mps * sin])
        }
        // A vessel at rest does not report a course.
        (Some(0.0), None) => Some([0.0; 2]),
        (Some(_) | None, _) => None,
    };
    Some(AisReport {
        mmsi: report.mmsi,
        place: PlaceReport {
            latitude_deg: report.latitude?,
            longitude_deg: report.longitude?,
            velocity,
            error_m: None,
        },
        age_s: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decoded(text: &str) -> Vec<AisReport> {
        let mut decoder = AisDecoder::default();
        decoder.push(text.as_bytes());
        core::iter::from_fn(|| decoder.next_report()).collect()
    }

    /// Sentences from gpsd's AIVDM documentation and samples.
    #[test]
    fn ais_sentences_of_each_type() {
        // Types 1, 18 and 19, with the values that other decoders give.
        for (sentence, mmsi) in [
            ("!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C", 477_553_000),
            ("!AIVDM,1,1,,A,B52K>;h00Fc>jpUlNV@ikwpUoP06,0*4C", 338_087_471),
            (
                "!AIVDM,1,1,,B,C5N3SRgPEnJGEBT>NhWAwwo862PaLELTBJ:V00000000S0D:R220,0*0B",
                367_059_850,
            ),
        ] {
            let all = decoded(&format!("{sentence}\r\n"));
            assert!(
                matches!(all.as_slice(), [r] if r.mmsi == mmsi),
                "{sentence}: {all:?}"
            );
        }
        let [r] = decoded("!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C\n")[..] else {
            panic!()
        };
        assert!((r.place.latitude_deg - 47.582_833).abs() < 1e-6, "{r:?}");
        assert!((r.place.longitude_deg + 122.345_833).abs() < 1e-6, "{r:?}");
        assert!(r.place.velocity.is_some_and(|[n, e]| n.hypot(e) < 1e-9), "{r:?}");
        // The vessel is in New York and moves at 0.1 kn on course 79.6 deg.
        let [r] = decoded("\\s:rx*00\\!AIVDM,1,1,,A,B52K>;h00Fc>jpUlNV@ikwpUoP06,0*4C\n")[..] else {
            panic!()
        };
        let [north, east] = r.place.velocity.unwrap();
        assert!((north.hypot(east) - 0.1 * KNOT_MPS).abs() < 1e-6, "{r:?}");
        assert!(
            (f64::atan2(east, north).to_degrees() - 79.6).abs() < 0.01,
            "{r:?}"
        );
    }

    #[test]
    fn ais_sentences_that_are_none() {
        let sound = "!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C";
        for wrong in [
            sound.replace("177", "178"),
            sound.replace("*5C", ""),
            sound.replace("!AIVDM", "$GPGGA"),
            // Base station report and static data.
            "!AIVDM,1,1,,A,H52N>V@T2rNVPJ2000000000000,2*29".into(),
            "x".repeat(10_000) + sound,
            String::new(),
        ] {
            assert_eq!(decoded(&format!("{wrong}\n")), [], "{wrong}");
        }
        assert_eq!(decoded(&format!("{sound}\n").repeat(1000)).len(), MAX_REPORTS);
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_of_an_ais_receiver(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut decoder = AisDecoder::default();
            decoder.push(&bytes);
            prop_assert!(decoder.reports.len() <= MAX_REPORTS);
        }
    }
}

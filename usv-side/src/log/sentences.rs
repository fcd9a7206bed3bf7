//! NMEA 0183 text, with or without a logger's prefix before each sentence, and statistics of sentence kinds.

use alight_shared::msg::Decoded;
use std::collections::BTreeMap;

use super::{Gather, LogError, SensorRecording, buses, wrapping::Peeled};
use crate::sensors::{ANGLES, Format, Mount, Mounting, NmeaDecoder, SensorDecoder};

/// Maximum number of kinds distinguished, and of kinds listed.
const MAX_KINDS: usize = 200;
const MAX_NAMED: usize = 16;

#[derive(Clone, Copy, Debug, Default)]
struct Fate {
    read: u64,
    empty: u64,
    passed_over: u64,
    damaged: u64,
    undated: u64,
}

impl Fate {
    fn total(&self) -> u64 {
        self.read + self.empty + self.passed_over + self.damaged
    }
    fn text(&self) -> String {
        let fates = [
            (self.read, "read"),
            (self.empty, "empty"),
            (self.passed_over, "passed over"),
            (self.damaged, "damaged"),
            (self.undated, "without a time"),
        ];
        let some = fates.iter().filter(|f| f.0 > 0);
        some.map(|(n, fate)| format!("{n} {fate}"))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

#[derive(Debug, Default)]
struct Kinds(BTreeMap<String, Fate>);

impl Kinds {
    /// Counts the decoder's result for a line.
    fn count(&mut self, line: &[u8], before: &Decoded, after: &Decoded) {
        let Some((address, content)) = sentence(line) else {
            return;
        };
        if self.0.len() >= MAX_KINDS && !self.0.contains_key(&address) {
            return;
        }
        let fate = self.0.entry(address).or_default();
        fate.undated += after.undated - before.undated;
        if after.corrupted > before.corrupted {
            fate.damaged += 1;
        } else if after.good > before.good && after.left_out == before.left_out {
            fate.read += 1;
        } else {
            let is_empty = !content.iter().any(u8::is_ascii_digit);
            *if is_empty {
                &mut fate.empty
            } else {
                &mut fate.passed_over
            } += 1;
        }
    }
    /// Counts as text, most frequent kind first.
    fn text(&self) -> String {
        let mut all: Vec<(&String, &Fate)> = self.0.iter().collect();
        all.sort_by_key(|(_, fate)| core::cmp::Reverse(fate.total()));
        let total: u64 = all.iter().map(|(_, fate)| fate.total()).sum();
        let named = all
            .iter()
            .take(MAX_NAMED)
            .map(|(kind, fate)| format!("{kind} {}", fate.text()));
        let named: Vec<String> = named.collect();
        let more = match all.len().saturating_sub(MAX_NAMED) {
            0 => String::new(),
            n => format!("; and {n} more kinds"),
        };
        format!("{total} sentences: {}{more}", named.join("; "))
    }
}

/// Address and content of the sentence at the end of a line.
fn sentence(line: &[u8]) -> Option<(String, &[u8])> {
    let begin = line.iter().rposition(|b| matches!(b, b'$' | b'!'))? + 1;
    let rest = line.get(begin..)?;
    let end = rest.iter().position(|b| !b.is_ascii_alphanumeric())?;
    let address = core::str::from_utf8(rest.get(..end)?).ok()?;
    let content = rest.get(end..)?;
    let content = content.split(|b| *b == b'*').next().unwrap_or_default();
    (3..=8).contains(&end).then(|| (address.to_owned(), content))
}

/// Whether the text contains the start of a sentence (`$`, capitals, comma), or iKonvert's NMEA 2000.
pub(super) fn is_nmea(head: &[u8]) -> bool {
    let mut lines = head.split(|b| *b == b'\n');
    lines.any(|line| Peeled::of(line).content.starts_with(b"!PDGY,")) || has_sentence(head)
}
fn has_sentence(head: &[u8]) -> bool {
    head.split(|b| *b == b'$').skip(1).any(|rest| {
        let address = rest.iter().take_while(|b| b.is_ascii_uppercase()).count();
        (4..=6).contains(&address) && rest.get(address) == Some(&b',')
    })
}

fn pass(bytes: &[u8], decoder: &mut NmeaDecoder) -> (Gather, Kinds) {
    let mut kinds = Kinds::default();
    let mut before = decoder.sentences();
    let gather = buses::play(Format::Nmea, bytes, decoder, |line, decoder| {
        let after = decoder.sentences();
        kinds.count(line, &before, &after);
        before = after;
    });
    (gather, kinds)
}

pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<SensorRecording, LogError> {
    let mounting = Mounting::new(mount);
    let mut decoder = NmeaDecoder::new(&mounting);
    let (mut gather, mut kinds) = pass(bytes, &mut decoder);
    if gather.first_ns.is_none() {
        let mut by_counter = NmeaDecoder::new(&mounting).by_counter();
        let dated = pass(bytes, &mut by_counter);
        if dated.0.first_ns.is_some() {
            ((gather, kinds), decoder) = (dated, by_counter);
        }
    }
    // The table already counts each kind's results, so only findings are added.
    let carried = decoder.carried_remarks();
    let mut remarks = decoder.remarks();
    remarks.retain(|r| r.remedy.is_some() || r.text.contains(ANGLES) || carried.contains(r));
    gather.recording(origin, "NMEA 0183", &kinds.text(), decoder.decoded(), remarks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::sentence;

    #[test]
    fn hour_of_sentences_without_a_measurement() {
        let mut text = String::new();
        for k in 0..100 {
            text += &sentence("IIHDT,,T");
            text += &sentence("WIMWV,214.8,T,0.1,T,A");
            text += &sentence(&format!("GPZDA,12{:02}{:02},,,,00,", k / 60, k % 60));
        }
        let e = crate::log::read(text.as_bytes(), "boat.nmea", &Mount::default())
            .unwrap_err()
            .to_string();
        for expected in [
            "300 sentences",
            "IIHDT 100 empty",
            "WIMWV 100 passed over",
            "GPZDA 100 read",
            "no roll and pitch, no position, no heading",
        ] {
            assert!(e.contains(expected), "{expected}: {e}");
        }
    }

    /// One minute of attitude and heading at 10 Hz in PCDIN or MXPGN.
    fn carriers(kind: &str) -> String {
        let mut text = String::new();
        for k in 0..600_u32 {
            for (pgn, data) in [("01F119", "00FF7FAA00DC00FF"), ("01F112", "001027FF7FFF7FFC")] {
                text += &match kind {
                    "PCDIN" => sentence(&format!("PCDIN,{pgn},{:08X},23,{data}", 5000 + 100 * k)),
                    _ => sentence(&format!("MXPGN,{pgn},3823,{data}")),
                };
            }
        }
        text
    }

    #[test]
    fn n2k_inside_of_sentences_by_the_gateways_counter() {
        let r = read(carriers("PCDIN").as_bytes(), "boat.nmea", &Mount::default()).unwrap();
        let last = r.measurements.last().map(|m| m.at().secs()).unwrap_or_default();
        assert_eq!(
            (r.measurements.len(), (last - 59.9).abs() < 1e-6),
            (1200, true),
            "{last}"
        );
        let mut text = String::new();
        for k in 0..300 {
            text += &format!("!PDGY,127257,3,17,255,{:.3},AP9/UgAh/v8=\r\n", 0.1 * f64::from(k));
            text += "$PDGY,000000,4,,5,482,1,0\r\n";
        }
        let r = crate::log::read(text.as_bytes(), "boat.log", &Mount::default()).unwrap();
        assert_eq!(
            (r.measurements.len(), r.decoded.good, r.decoded.corrupted),
            (300, 300, 0)
        );
        // These sentences carry neither a time nor a counter.
        let e = read(carriers("MXPGN").as_bytes(), "boat.nmea", &Mount::default());
        let e = e.unwrap_err().to_string();
        assert!(e.contains("MXPGN 1200 read"), "{e}");
    }

    #[test]
    fn kinds_of_sentences_among_measurements() {
        let mut text = String::new();
        for k in 0..200 {
            text += &sentence(&format!(
                "PASHR,1200{:02}.{}0,90.0,T,1.5,-2.0,0.25,0.1,0.1,0.2,2,1",
                k / 10,
                k % 10
            ));
            text += "$GPGLL,5000.000,N,014*00\r\n";
        }
        let r = read(text.as_bytes(), "boat.nmea", &Mount::default()).unwrap();
        let notes = r.notes.join("\n");
        assert!(
            notes.contains("PASHR 200 read") && notes.contains("GPGLL 200 damaged"),
            "{notes}"
        );
        assert!(
            notes.contains("no position") && !notes.contains("no heading"),
            "{notes}"
        );
    }
}

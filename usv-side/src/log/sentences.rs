//! NMEA 0183 text, with or without a logger's prefix before each sentence; what became of each kind of sentence.

use alight_shared::msg::Decoded;
use std::collections::BTreeMap;

use super::wrapping::Peeled;
use super::{Gather, LogError, Recording};
use crate::sensors::{Decoder, Mount, Mounting, NmeaDecoder};

/// Most kinds of sentences that are distinguished, and that are named.
const MAX_KINDS: usize = 200;
const MAX_NAMED: usize = 16;
/// Sentences in which gateways send NMEA 2000.
const CARRIERS: [&str; 3] = ["PCDIN", "MXPGN", "PDGY"];

/// What became of the sentences of a kind.
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

/// The sentences of a file by kind.
#[derive(Debug, Default)]
struct Kinds(BTreeMap<String, Fate>);

impl Kinds {
    /// Counts what a decoder made of a line.
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
    /// For people, the most frequent first.
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
        format!("{total} sentences: {}{more}{}", named.join("; "), self.carriers())
    }
    /// Remedy for the kinds that carry NMEA 2000; empty without one.
    fn carriers(&self) -> String {
        let there = CARRIERS.into_iter().filter(|c| self.0.contains_key(*c));
        let there: Vec<&str> = there.collect();
        match there.len() {
            0 => String::new(),
            n => format!(
                "; {} {} NMEA 2000, which is not read inside of sentences: let the gateway send RAW",
                there.join(", "),
                if n == 1 { "carries" } else { "carry" }
            ),
        }
    }
}

/// Address and content of the sentence that ends a line.
fn sentence(line: &[u8]) -> Option<(String, &[u8])> {
    let begin = line.iter().rposition(|b| matches!(b, b'$' | b'!'))? + 1;
    let rest = line.get(begin..)?;
    let end = rest.iter().position(|b| !b.is_ascii_alphanumeric())?;
    let address = core::str::from_utf8(rest.get(..end)?).ok()?;
    let content = rest.get(end..)?;
    let content = content.split(|b| *b == b'*').next().unwrap_or_default();
    (3..=8).contains(&end).then(|| (address.to_owned(), content))
}

/// A sentence begins in it: a dollar, an address of capitals, a comma.
pub(super) fn is_nmea(head: &[u8]) -> bool {
    head.split(|b| *b == b'$').skip(1).any(|rest| {
        let address = rest.iter().take_while(|b| b.is_ascii_uppercase()).count();
        (4..=6).contains(&address) && rest.get(address) == Some(&b',')
    })
}

/// Reads the sentences.
pub(super) fn read(bytes: &[u8], origin: &str, mount: &Mount) -> Result<Recording, LogError> {
    let mut decoder = NmeaDecoder::new(&Mounting::new(mount));
    let (mut gather, mut decoded, mut kinds) = (Gather::default(), Vec::new(), Kinds::default());
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let line = Peeled::of(line).content;
        let before = decoder.decoded();
        decoder.push(&line, &mut decoded);
        kinds.count(&line, &before, &decoder.decoded());
        decoded.drain(..).for_each(|m| gather.push(m, 0));
    }
    decoder.finish(&mut decoded);
    decoded.drain(..).for_each(|m| gather.push(m, 0));
    let found = kinds.text();
    let missing = gather.missing();
    Ok(Recording {
        format: "NMEA 0183",
        measurements: gather.finish(origin, &found)?,
        decoded: decoder.decoded(),
        notes: match missing.is_empty() {
            true => vec![found],
            false => vec![format!("{found}; of all that came {missing}")],
        },
    })
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
        for says in [
            "300 sentences",
            "IIHDT 100 empty",
            "WIMWV 100 passed over",
            "GPZDA 100 read",
            "no roll and pitch, no position, no heading",
        ] {
            assert!(e.contains(says), "{says}: {e}");
        }
    }

    #[test]
    fn n2k_inside_of_sentences() {
        let mut text = String::new();
        for k in 0..30 {
            text += &sentence(&format!(
                "GPGGA,1200{k:02}.00,1000.00000,N,02000.00000,E,1,12,0.8,1.0,M,20.0,M,,"
            ));
            text += &sentence("PCDIN,01F119,00000000,23,00FF7FAA00DC00FF");
        }
        let r = read(text.as_bytes(), "boat.nmea", &Mount::default()).unwrap();
        let notes = r.notes.join("\n");
        assert!(
            notes.contains("PCDIN carries NMEA 2000") && notes.contains("send RAW"),
            "{notes}"
        );
        assert!(!notes.contains("MXPGN"), "{notes}");
    }

    #[test]
    fn sentences_in_quoted_cells() {
        let mut text = String::new();
        for k in 0..200 {
            let body = format!(
                "PASHR,1200{:02}.{}0,90.0,T,1.5,-2.0,0.25,0.1,0.1,0.2,2,1",
                k / 10,
                k % 10
            );
            text += &format!("{k},\"{}\"\r\n", sentence(&body).trim_end());
        }
        let r = read(text.as_bytes(), "boat.csv", &Mount::default()).unwrap();
        assert_eq!((r.decoded.good, r.decoded.corrupted), (200, 0));
    }

    #[test]
    fn kinds_of_sentences_beside_measurements() {
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
        let said = r.notes.join("\n");
        assert!(
            said.contains("PASHR 200 read") && said.contains("GPGLL 200 damaged"),
            "{said}"
        );
        assert!(
            said.contains("no position") && !said.contains("no heading"),
            "{said}"
        );
    }
}

//! Key of MAVLink 2 signing, and counts of signatures as metrics.

use std::{fs, path::Path};

use alight_shared::{
    mavlink::{Signatures, Signing},
    metrics::{Metric, MetricName, MetricValue},
};
use sha2::{Digest, Sha256};

use crate::{
    exit::{CliError, Doing},
    io::wall::wall_ns,
};

const MAX_BYTES: u64 = 1024;
/// Time from 1970 to 2015, in units of 10 us.
const FROM_1970: i64 = 142_007_040_000_000;
const DIGITS: usize = 64;

/// Key in the file at `path`, the value of configuration key `key`; None if the path is empty.
pub fn read(key: &str, path: &str) -> Result<Option<Signing>, CliError> {
    if path.is_empty() {
        return Ok(None);
    }
    let doing = || format!("reading {key}, {path}");
    let metadata = fs::metadata(path).doing(doing())?;
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        return Err(CliError(format!(
            "{}: not a file of at most {MAX_BYTES} bytes with one line: a passphrase or {DIGITS} hexadecimal digits",
            doing()
        )));
    }
    let text = fs::read_to_string(Path::new(path)).doing(doing())?;
    let mut lines = text.lines();
    match (lines.next(), lines.next()) {
        (Some(line), None) if !line.trim().is_empty() => Ok(Some(Signing::with_clock(of_line(line), time))),
        (_, _) => Err(CliError(format!(
            "{}: it has to hold one line: a passphrase or {DIGITS} hexadecimal digits",
            doing()
        ))),
    }
}

/// Time in the unit of signatures, 10 us since 1 January 2015; 0 before that date.
fn time() -> u64 {
    u64::try_from(wall_ns() / 10_000 - FROM_1970).unwrap_or(0)
}

pub fn metrics(s: Signatures) -> [Metric; 4] {
    [
        MetricName::UnsignedFrames.count(s.unsigned),
        MetricName::OtherKeyFrames.count(s.other_key),
        MetricName::OldFrames.count(s.old),
        MetricName::UncheckedSignatures.count(s.unchecked),
    ]
}

pub fn counts(metrics: &[Metric]) -> Signatures {
    let of = |name| {
        metrics
            .iter()
            .find_map(|m| match m.value {
                MetricValue::Count(n) if m.name == name => Some(n),
                _ => None,
            })
            .unwrap_or(0)
    };
    Signatures {
        unsigned: of(MetricName::UnsignedFrames),
        other_key: of(MetricName::OtherKeyFrames),
        old: of(MetricName::OldFrames),
        unchecked: of(MetricName::UncheckedSignatures),
    }
}

/// Key of 64 hexadecimal digits, or the SHA-256 of any other line.
fn of_line(line: &str) -> [u8; 32] {
    digits(line).unwrap_or_else(|| Sha256::digest(line.as_bytes()).into())
}

fn digits(line: &str) -> Option<[u8; 32]> {
    let digits: Vec<u8> = line
        .chars()
        .map(|c| c.to_digit(16).map(|d| d as u8))
        .collect::<Option<_>>()?;
    let bytes: Vec<u8> = digits
        .chunks_exact(2)
        .map(|pair| pair.iter().fold(0, |b, d| b << 4 | d))
        .collect();
    bytes.try_into().ok().filter(|_| digits.len() == DIGITS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_uav::autopilot::{
        message::{Address, CommandLong},
        wire::{Decoder, Encoder},
    };

    const OF_ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    fn read_from(text: &str) -> Result<Option<Signing>, CliError> {
        let digest: [u8; 32] = Sha256::digest(text).into();
        let name = format!("alight-mavlink-{}-{:02x?}", std::process::id(), &digest[..4]);
        let file = std::env::temp_dir().join(name);
        fs::write(&file, text).unwrap();
        let key = read("autopilot.signing_key", file.to_str().unwrap());
        fs::remove_file(file).unwrap();
        key
    }

    #[test]
    fn passphrase_and_its_key() {
        let [phrase, hexadecimal] = ["abc\n", OF_ABC].map(|text| read_from(text).unwrap());
        let bytes = Encoder::signed(phrase).frame(
            Address::new(1, 1),
            &CommandLong::request(Address::default(), 0).into(),
        );
        let mut decoder = Decoder::signed(hexadecimal);
        decoder.push(&bytes.unwrap());
        assert!(decoder.next_frame().is_some());
    }

    #[test]
    fn file_without_a_key() {
        for (text, why) in [
            ("", "one line"),
            ("one\ntwo\n", "one line"),
            (" \n", "one line"),
            (&"x".repeat(2000), "1024 bytes"),
        ] {
            let error = read_from(text).unwrap_err().to_string();
            assert!(
                error.contains(why) && error.contains("autopilot.signing_key"),
                "{error}"
            );
        }
        let missing = read("sensor.boat.signing_key", "/no/such/file")
            .unwrap_err()
            .to_string();
        assert!(
            missing.contains("sensor.boat.signing_key, /no/such/file"),
            "{missing}"
        );
        assert!(read("autopilot.signing_key", "").unwrap().is_none());
    }
}

//! Parts that the tests of several modules share.

use alight_shared::msg::{AttitudeFix, GnssFix};
use proptest::prelude::*;
use proptest::sample::Index;

use crate::sensors::{Measurement, SensorDecoder, SourceMeasurement};

/// An NMEA sentence with its checksum and end of line.
pub(crate) fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
    format!("${body}*{sum:02X}\r\n")
}

/// A frame of RTCM 3 with a message of this number, whose payload has so many bytes; of 4072 its subtype 0.
pub(crate) fn rtcm_frame(message: u16, payload: usize) -> Vec<u8> {
    let mut content = vec![(message >> 4) as u8, (message << 4) as u8, 0];
    content.extend((6..payload + 3).map(|k| (7 * k) as u8));
    alight_shared::rtcm::frame(&content)
}

/// Measurements by `decoder` from bytes that arrive in parts of `cut`, and the decoder then.
pub(crate) fn decode<D: SensorDecoder>(
    mut decoder: D,
    bytes: &[u8],
    cut: usize,
) -> (Vec<SourceMeasurement>, D) {
    let mut out = Vec::new();
    bytes.chunks(cut).for_each(|part| decoder.push(part, &mut out));
    (out, decoder)
}

/// Number of measurements of this kind, of [`crate::KINDS`].
pub(crate) fn count(all: &[SourceMeasurement], kind: usize) -> usize {
    all.iter().filter(|m| m.measurement.kind() == kind).count()
}

/// The attitudes among all measurements, with their times.
pub(crate) fn attitudes(all: &[SourceMeasurement]) -> Vec<(i64, AttitudeFix)> {
    let attitude = |m: &SourceMeasurement| match m.measurement {
        Measurement::Attitude(a) => Some((m.at_ns, a)),
        _ => None,
    };
    all.iter().filter_map(attitude).collect()
}

/// The fixes among all measurements.
pub(crate) fn fixes(all: &[SourceMeasurement]) -> Vec<GnssFix> {
    let fix = |m: &SourceMeasurement| match m.measurement {
        Measurement::Gnss(fix) => Some(fix),
        _ => None,
    };
    all.iter().filter_map(fix).collect()
}

/// The headings among all measurements, rad.
pub(crate) fn headings(all: &[SourceMeasurement]) -> Vec<f64> {
    let heading = |m: &SourceMeasurement| match m.measurement {
        Measurement::Heading(h) => Some(h.heading),
        _ => None,
    };
    all.iter().filter_map(heading).collect()
}

/// Rounded to whole numbers.
pub(crate) fn whole(all: Vec<f64>) -> Vec<f64> {
    all.into_iter().map(f64::round).collect()
}

/// Up to `most` changed bytes, and where the bytes are cut off.
pub(crate) fn damage(most: usize) -> impl Strategy<Value = (Vec<(Index, u8)>, Index)> {
    let changes = prop::collection::vec((any::<Index>(), any::<u8>()), 0..most);
    (changes, any::<Index>())
}

/// The bytes with this damage.
pub(crate) fn damaged(mut bytes: Vec<u8>, (changes, cut): (Vec<(Index, u8)>, Index)) -> Vec<u8> {
    for (at, to) in changes {
        let k = at.index(bytes.len());
        bytes[k] = to;
    }
    bytes.truncate(cut.index(bytes.len()));
    bytes
}

use alight_shared::msg::{AttitudeFix, GnssFix};
use proptest::{prelude::*, sample::Index};

use crate::sensors::{SensorDecoder, SourceMeasurement};

/// NMEA sentence with checksum and line end.
pub(crate) fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
    format!("${body}*{sum:02X}\r\n")
}

/// UBX message with its checksum (Fletcher's, over class to payload).
pub(crate) fn ubx(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let body = [&[class, id][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
    let (a, b) = body.iter().fold((0_u8, 0_u8), |(a, b), x| {
        let a = a.wrapping_add(*x);
        (a, b.wrapping_add(a))
    });
    [&[0xb5, 0x62][..], &body, &[a, b]].concat()
}

/// NAV-PVT of a fix at 50 N 14.5 E, number `k` at 5 Hz.
pub(crate) fn nav_pvt(k: u32) -> Vec<u8> {
    let mut payload = [0_u8; 92];
    payload[..4].copy_from_slice(&(1000 + 200 * k).to_le_bytes());
    (payload[20], payload[21]) = (3, 1);
    payload[24..28].copy_from_slice(&145_000_000_i32.to_le_bytes());
    payload[28..32].copy_from_slice(&500_000_000_i32.to_le_bytes());
    ubx(1, 7, &payload)
}

/// RTCM 3 frame with this message number and payload length, bytes. Message 4072 gets subtype 0.
pub(crate) fn rtcm_frame(message: u16, payload: usize) -> Vec<u8> {
    let mut content = vec![(message >> 4) as u8, (message << 4) as u8, 0];
    content.extend((6..payload + 3).map(|k| (7 * k) as u8));
    alight_shared::rtcm::frame(&content)
}

/// Measurements and final state of `decoder` after decoding the bytes in pieces of `cut` bytes.
pub(crate) fn decode<D: SensorDecoder>(
    mut decoder: D,
    bytes: &[u8],
    cut: usize,
) -> (Vec<SourceMeasurement>, D) {
    let mut out = Vec::new();
    for part in bytes.chunks(cut) {
        decoder.push(part, &mut out);
    }
    (out, decoder)
}

/// Number of measurements of this kind, of [`crate::KINDS`].
pub(crate) fn count(all: &[SourceMeasurement], kind: usize) -> usize {
    all.iter().filter(|m| m.measurement.kind() == kind).count()
}

pub(crate) fn attitudes(all: &[SourceMeasurement]) -> Vec<(i64, AttitudeFix)> {
    let attitude = |m: &SourceMeasurement| Some((m.at_ns, *m.measurement.attitude()?));
    all.iter().filter_map(attitude).collect()
}

pub(crate) fn fixes(all: &[SourceMeasurement]) -> Vec<GnssFix> {
    all.iter().filter_map(|m| m.measurement.gnss().copied()).collect()
}

pub(crate) fn headings(all: &[SourceMeasurement]) -> Vec<f64> {
    all.iter()
        .filter_map(|m| Some(m.measurement.heading()?.heading))
        .collect()
}

pub(crate) fn whole(all: Vec<f64>) -> Vec<f64> {
    all.into_iter().map(f64::round).collect()
}

/// Up to `most` changed bytes, and the position of a cut.
pub(crate) fn damage(most: usize) -> impl Strategy<Value = (Vec<(Index, u8)>, Index)> {
    let changes = prop::collection::vec((any::<Index>(), any::<u8>()), 0..most);
    (changes, any::<Index>())
}

pub(crate) fn damaged(mut bytes: Vec<u8>, (changes, cut): (Vec<(Index, u8)>, Index)) -> Vec<u8> {
    for (at, to) in changes {
        let k = at.index(bytes.len());
        bytes[k] = to;
    }
    bytes.truncate(cut.index(bytes.len()));
    bytes
}

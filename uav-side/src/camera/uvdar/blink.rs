//! Identifies markers by their blinking codes (Walter et al. 2019, section IV). Bright spots are tracked from image to
//! image; in images in which they are dark, at their predicted positions. The recent history of each spot is compared
//! with the codes in every phase.

use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::Vector2;

use super::blobs::Blob;

/// Maximum length of a code, images, and maximum number of markers.
pub const MAX_BITS: usize = 32;
const MAX_TRACKS: usize = 64;

/// Code of a marker; the first bit is the lowest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code {
    bits: u32,
    length: usize,
}

impl Code {
    pub fn parse(text: &str) -> Option<Code> {
        let length = text.len();
        if !(4..=MAX_BITS).contains(&length) || !text.bytes().all(|b| b == b'0' || b == b'1') {
            return None;
        }
        let bits = text
            .bytes()
            .enumerate()
            .fold(0, |bits, (k, b)| bits | (u32::from(b == b'1') << k));
        Some(Code { bits, length })
    }
    /// Whether the marker is lit in image `k` of its code.
    pub fn lit(&self, k: u64) -> bool {
        (self.bits >> (k % self.length as u64)) & 1 == 1
    }
    pub fn images(&self) -> usize {
        self.length
    }
    /// Longest dark period of the repeating code, images.
    pub fn max_dark(&self) -> usize {
        let mut longest = 0;
        let mut dark = 0;
        for k in 0..2 * self.length as u64 {
            dark = if self.lit(k) { 0 } else { dark + 1 };
            longest = longest.max(dark);
        }
        longest
    }
    /// Minimum over all phases of the number of bits in which `observed` (newest bit lowest) differs from the code.
    fn distance(&self, observed: u32) -> u32 {
        let mask = u32::MAX >> (32 - self.length as u32);
        (0..self.length)
            .map(|phase| {
                let turned = (0..self.length).fold(0_u32, |bits, k| {
                    // The bits run backwards in time from the newest image.
                    let at = (phase + self.length - k) % self.length;
                    bits | (((self.bits >> at) & 1) << k)
                });
                ((turned ^ observed) & mask).count_ones()
            })
            .min()
            .unwrap_or(u32::MAX)
    }
    /// Minimum over all phases of the number of bits in which two codes of equal length differ.
    pub fn apart(&self, other: &Code) -> u32 {
        let backwards = (0..other.length).fold(0_u32, |bits, k| {
            bits | (((other.bits >> (other.length - 1 - k)) & 1) << k)
        });
        self.distance(backwards)
    }
}

#[derive(Clone, Debug)]
struct Track {
    at: Vector2<f64>,
    velocity: Vector2<f64>,
    last: Time<DroneClock>,
    /// Whether the spot was lit in each of the last images, newest in the lowest bit.
    observed: u32,
    images: u32,
    dark: usize,
    lit_now: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentifiedMarker {
    pub marker: usize,
    /// Position in the image, px.
    pub at: Vector2<f64>,
}

#[derive(Clone, Debug)]
pub struct BlinkTracker {
    codes: Vec<Code>,
    wrong_bits: u32,
    gate_px: f64,
    period: Span,
    max_dark: usize,
    tracks: Vec<Track>,
    last: Option<Time<DroneClock>>,
}

impl BlinkTracker {
    /// Tracker for one image every `period`; a spot must be within `gate_px` of its prediction.
    pub fn new(codes: Vec<Code>, wrong_bits: u32, gate_px: f64, period: Span) -> BlinkTracker {
        BlinkTracker {
            max_dark: codes.iter().map(Code::max_dark).max().unwrap_or(0),
            codes,
            wrong_bits,
            gate_px,
            period,
            tracks: Vec::new(),
            last: None,
        }
    }
    pub fn step(&mut self, at: Time<DroneClock>, blobs: &[Blob]) -> Vec<IdentifiedMarker> {
        // Bits of lost images are unknown, so all tracks restart.
        let gap = self
            .last
            .map_or(f64::INFINITY, |last| (at - last).secs() / self.period.secs());
        if !(0.5..1.5).contains(&gap) {
            self.tracks.clear();
        }
        self.last = Some(at);
        let taken = self.follow(at, blobs);
        for track in &mut self.tracks {
            track.observed = (track.observed << 1) | u32::from(track.lit_now);
            track.images = track.images.saturating_add(1);
            track.dark = if track.lit_now { 0 } else { track.dark + 1 };
        }
        let longest = self.max_dark + 1;
        self.tracks.retain(|t| t.dark <= longest);
        for (blob, used) in blobs.iter().zip(&taken) {
            if !used && self.tracks.len() < MAX_TRACKS {
                self.tracks.push(Track {
                    at: blob.at,
                    velocity: Vector2::zeros(),
                    last: at,
                    observed: 1,
                    images: 1,
                    dark: 0,
                    lit_now: true,
                });
            }
        }
        self.known()
    }
    /// Assigns to each track the spot nearest to its predicted position. Returns which spots are assigned.
    fn follow(&mut self, at: Time<DroneClock>, blobs: &[Blob]) -> Vec<bool> {
        let mut taken = vec![false; blobs.len()];
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (t, track) in self.tracks.iter().enumerate() {
            let age = (at - track.last).secs();
            let place = track.at + track.velocity * age;
            let gate = self.gate_px * (1.0 + track.dark as f64).sqrt();
            for (b, blob) in blobs.iter().enumerate() {
                let distance = (blob.at - place).norm();
                if distance <= gate {
                    pairs.push((distance, t, b));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        for track in &mut self.tracks {
            track.lit_now = false;
        }
        for (_, t, b) in pairs {
            let (Some(track), Some(used), Some(blob)) =
                (self.tracks.get_mut(t), taken.get_mut(b), blobs.get(b))
            else {
                continue;
            };
            if track.lit_now || *used {
                continue;
            }
            *used = true;
            let age = (at - track.last).secs().max(1e-6);
            let velocity = (blob.at - track.at) / age;
            // The first difference gives the velocity; later ones are averaged.
            let gain = if track.images < 2 { 1.0 } else { 0.4 };
            track.velocity += (velocity - track.velocity) * gain;
            track.at = blob.at;
            track.last = at;
            track.lit_now = true;
        }
        taken
    }
    /// Lit spots that match exactly one marker, except for markers matched by two spots.
    fn known(&self) -> Vec<IdentifiedMarker> {
        let mut claims: Vec<(u32, IdentifiedMarker)> = Vec::new();
        for track in self.tracks.iter().filter(|t| t.lit_now) {
            let fit = |(marker, code): (usize, &Code)| {
                (track.images as usize >= code.images()).then(|| (code.distance(track.observed), marker))
            };
            let mut fits: Vec<(u32, usize)> = self.codes.iter().enumerate().filter_map(fit).collect();
            fits.sort_unstable();
            let Some((wrong, marker)) = fits.first().copied() else {
                continue;
            };
            let next = fits.get(1).map_or(u32::MAX, |f| f.0);
            if wrong <= self.wrong_bits && next > wrong {
                claims.push((wrong, IdentifiedMarker { marker, at: track.at }));
            }
        }
        let alone = |(wrong, known): &(u32, IdentifiedMarker)| {
            !claims
                .iter()
                .any(|(w, k)| k.marker == known.marker && k.at != known.at && w <= wrong)
        };
        claims
            .iter()
            .filter(|c| alone(c))
            .map(|(_, known)| *known)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODES: [&str; 4] = ["001001001011", "001001100101", "001010101111", "001100110111"];

    fn codes() -> Vec<Code> {
        CODES.iter().map(|c| Code::parse(c).unwrap()).collect()
    }
    fn tracker() -> BlinkTracker {
        BlinkTracker::new(codes(), 1, 6.0, Span::from_millis(50))
    }
    fn blob(x: f64, y: f64) -> Blob {
        Blob {
            at: Vector2::new(x, y),
            light: 500.0,
        }
    }

    #[test]
    fn blink_code_lengths() {
        assert!(Code::parse("101").is_none() && Code::parse("10x1").is_none());
        assert!(Code::parse(&"01".repeat(17)).is_none());
        let code = Code::parse("0011").unwrap();
        assert_eq!((code.lit(0), code.lit(2), code.lit(7)), (false, true, true));
        assert_eq!(code.max_dark(), 2);
        assert_eq!(
            code.apart(&Code::parse("1001").unwrap()),
            0,
            "the same in another phase"
        );
        assert_eq!(code.apart(&Code::parse("0101").unwrap()), 2);
    }

    #[test]
    fn blink_tracker_of_moving_markers() {
        let mut tracker = tracker();
        let mut known = Vec::new();
        for k in 0..40_u64 {
            let drift = 2.0 * k as f64;
            let mut blobs = vec![blob(300.0, 20.0)];
            for (m, code) in codes().iter().enumerate() {
                if code.lit(k + 5 * m as u64) {
                    blobs.push(blob(100.0 + 15.0 * m as f64 + drift, 200.0 + drift));
                }
            }
            known = tracker.step(Time::from_nanos(k as i64 * 50_000_000), &blobs);
            assert!(k >= 11 || known.is_empty(), "a whole code first");
            for marker in &known {
                let place = Vector2::new(100.0 + 15.0 * marker.marker as f64 + drift, 200.0 + drift);
                assert!((marker.at - place).norm() < 1e-9, "{k}: {marker:?}");
            }
        }
        assert!(!known.is_empty());
    }

    #[test]
    fn blink_tracker_with_a_wrong_bit_and_a_gap() {
        let code = codes()[2];
        let mut tracker = tracker();
        let mut identified = 0;
        for k in 0..48_u64 {
            let lit = code.lit(k) && k % 12 != 6;
            let blobs: Vec<Blob> = lit.then(|| blob(50.0, 60.0)).into_iter().collect();
            let known = tracker.step(Time::from_nanos(k as i64 * 50_000_000), &blobs);
            assert!(known.iter().all(|m| m.marker == 2));
            identified += known.len();
        }
        assert!(identified > 10, "{identified}");
        let late = Time::from_nanos(49 * 50_000_000 + 1_000_000_000);
        assert!(tracker.step(late, &[blob(50.0, 60.0)]).is_empty());
    }
}

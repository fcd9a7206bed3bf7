//! Directional wave spectrum and powers of the deck's motion, from the vessel's motion as it meets the waves.
//!
//! The spectra are averaged periodograms (Welch 1967) with a Hann window over segments of 26 s that begin every 6 s. Water
//! and hull move vertically by `z` and horizontally by `u`, in phase in the direction of propagation. With the
//! cross-spectra `C` per frequency, `[a, b] = [C_zn, C_ze] / sqrt(C_zz (C_nn + C_ee))` therefore points in that direction,
//! and its length `r` gives the spread `s = r / (1 - r)` of `cos^2s((theta - theta_1) / 2)` (Longuet-Higgins, Cartwright
//! and Smith 1963). The wave frequency in each direction follows from that of encounter, `omega_e = omega - omega² U cos mu
//! / g`; of up to three solutions the longest wave is assumed to carry the energy.

use std::collections::VecDeque;

use alight_shared::{
    frames::wrap_angle,
    geometry::GRAVITY,
    motion_model::{MotionSample, SAMPLE_S},
    time::VesselClock,
    vessel_model::{HEAVE, PITCH, ROLL, SURGE, SWAY},
};
use core::f64::consts::TAU;
use nalgebra::{Complex, Vector2, Vector3};

use super::hull::{Encounter, HullModel, HullMotion, Powers, SIGNALS, SLOPE, TILT};

/// Length of a segment and interval between segments, samples.
const SEGMENT: usize = 256;
const HOP: usize = 64;
/// Range of frequency bins: periods of 13 to 1.8 s; slower motion belongs to the course.
const FIRST: usize = 2;
const BINS: usize = 13;
/// Memory, segments: 100 s, some twenty waves, as in the identification.
const MEMORY: f64 = 16.0;
/// Minimum number of segments for an estimate of the sea: 45 s.
const MIN_SEGMENTS: f64 = 4.0;
/// Change of heading within a segment, or between means of two segments, that counts as a turn, rad.
const TURN_RAD: f64 = 15.0 * TAU / 360.0;
/// Frequency of the shortest waves that move a boat, rad/s: a change of speed that shifts them by one bin in
/// a head sea counts as another course ([`course_change_mps`]).
const SHORT_RADPS: f64 = 1.3;
const DIRECTIONS: usize = 24;
/// Maximum length of the mean direction vector, because the directions in a sea always have some spread.
const MAX_DIRECTED: f64 = 0.95;
/// Minimum length of the mean direction vector over all waves with a known direction.
const MIN_DIRECTED: f64 = 0.3;
/// Minimum heave power of the hull per wave power for identifying a wave.
const MIN_RESPONSE: f64 = 0.1;
/// Prior of the correction, as a fraction of a signal's power at the strongest frequency.
const PRIOR: f64 = 0.1;
/// Fraction of the total variance below which waves are dropped.
const NEGLIGIBLE: f64 = 1e-4;
/// Frequencies that represent the width of a bin, as offsets from its centre in bins.
const LINES: [f64; 3] = [-1.0 / 3.0, 0.0, 1.0 / 3.0];

const fn bin_width() -> f64 {
    TAU / (SEGMENT as f64 * SAMPLE_S)
}
/// Change of speed that shifts a wave of [`SHORT_RADPS`] by one bin, m/s: 1.4.
const fn course_change_mps() -> f64 {
    bin_width() * GRAVITY / (SHORT_RADPS * SHORT_RADPS)
}
fn frequency(bin: usize) -> f64 {
    bin_width() * (FIRST + bin) as f64
}
fn bin_of(met: f64) -> usize {
    ((met.abs() / bin_width()).round() as usize).clamp(FIRST, FIRST + BINS - 1) - FIRST
}

#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    /// Variance of heave, m², and of the horizontal velocity, m²/s².
    heave: f64,
    speed: f64,
    /// Covariance of heave (up) with the velocity north and east, m²/s.
    towards: Vector2<f64>,
    deck: Powers,
}

#[derive(Clone, Debug)]
pub(super) struct WaveSpectrum {
    deck: Vector3<f64>,
    record: VecDeque<(MotionSample<VesselClock>, Vector2<f64>)>,
    since: usize,
    segments: f64,
    bins: [Bin; BINS],
    /// Mean heading, rad, and velocity, NED, m/s.
    heading: f64,
    velocity: Vector2<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WaveComponent {
    /// Angular frequency, rad/s.
    pub omega: f64,
    /// Direction of propagation, rad.
    pub towards: f64,
    /// Variance of the elevation, m².
    pub variance: f64,
}

#[derive(Clone, Debug)]
pub(super) struct EstimatedSea {
    pub waves: Vec<WaveComponent>,
    /// Mean direction of propagation, rad.
    pub towards: f64,
    /// Ratio of measured to modelled power of each signal by frequency of encounter.
    correction: [Powers; BINS],
}

impl EstimatedSea {
    /// Powers of the deck's signals on this heading (rad) at this speed, m/s.
    pub(super) fn powers(
        &self,
        hull: &HullModel,
        deck: &Vector3<f64>,
        heading: f64,
        speed_mps: f64,
    ) -> Powers {
        let mut sum = Powers::default();
        for w in &self.waves {
            let e = Encounter::of(w.omega, w.towards, heading, speed_mps);
            let one = hull.motion(&e).powers(e.met, deck);
            for ((sum, p), c) in sum.iter_mut().zip(one).zip(self.correction[bin_of(e.met)]) {
                *sum += w.variance * p * c;
            }
        }
        sum
    }
}

impl WaveSpectrum {
    /// Spectrum of a vessel whose deck's centre is at `deck`, body frame, m.
    pub(super) fn new(deck: Vector3<f64>) -> WaveSpectrum {
        WaveSpectrum {
            deck,
            record: VecDeque::with_capacity(SEGMENT),
            since: 0,
            segments: 0.0,
            bins: Default::default(),
            heading: 0.0,
            velocity: Vector2::zeros(),
        }
    }
    /// Adds a motion sample and the mean velocity, NED, m/s. Returns true when a segment was added.
    pub(super) fn push(&mut self, sample: MotionSample<VesselClock>, velocity: Vector2<f64>) -> bool {
        let gap = |(last, _): &(MotionSample<VesselClock>, _)| {
            let dt = (sample.at - last.at).secs();
            !(dt > 0.5 * SAMPLE_S && dt < 1.5 * SAMPLE_S)
        };
        if self.record.back().is_some_and(gap) {
            self.record.clear();
            self.since = 0;
        }
        self.record.push_back((sample, velocity));
        if self.record.len() > SEGMENT {
            self.record.pop_front();
        }
        self.since += 1;
        if self.record.len() < SEGMENT || self.since < HOP {
            return false;
        }
        self.since = 0;
        self.add_segment()
    }

    /// Mean heading (rad) and velocity (NED, m/s) of the segment; None if the vessel changes course or speed.
    fn course(&self) -> Option<(f64, Vector2<f64>)> {
        let n = self.record.len() as f64;
        let first = self.record.front().map_or(0.0, |r| r.0.mean_heading);
        let mut turned = [0.0_f64; 2];
        let mut speeds = [f64::INFINITY, f64::NEG_INFINITY];
        let mut sum = 0.0;
        let mut velocity = Vector2::zeros();
        let extend = |[low, high]: [f64; 2], x: f64| [low.min(x), high.max(x)];
        for (s, v) in &self.record {
            let off = wrap_angle(s.mean_heading - first);
            turned = extend(turned, off);
            speeds = extend(speeds, ahead(v, s.mean_heading));
            sum += off;
            velocity += v / n;
        }
        let steady = turned[1] - turned[0] <= TURN_RAD && speeds[1] - speeds[0] <= course_change_mps();
        let known = velocity.norm().is_finite();
        (steady && known).then(|| (wrap_angle(first + sum / n), velocity))
    }

    /// Adds the segment unless course or speed change in it; discards segments of another course or speed.
    fn add_segment(&mut self) -> bool {
        let Some((heading, velocity)) = self.course() else {
            return false;
        };
        let turned = wrap_angle(heading - self.heading).abs() > TURN_RAD;
        let faster_mps = ahead(&velocity, heading) - ahead(&self.velocity, self.heading);
        if turned || faster_mps.abs() > course_change_mps() {
            self.segments = 0.0;
        }
        self.segments = (self.segments + 1.0).min(MEMORY);
        let fraction = 1.0 / self.segments;
        self.heading = wrap_angle(self.heading + fraction * wrap_angle(heading - self.heading));
        self.velocity += (velocity - self.velocity) * fraction;
        for bin in 0..BINS {
            let new = self.bin(bin, heading);
            let old = &mut self.bins[bin];
            old.heave += (new.heave - old.heave) * fraction;
            old.speed += (new.speed - old.speed) * fraction;
            old.towards += (new.towards - old.towards) * fraction;
            for (old, new) in old.deck.iter_mut().zip(new.deck) {
                *old += (new - *old) * fraction;
            }
        }
        true
    }

    /// Powers of the recorded segment at one frequency, for this mean heading, rad.
    fn bin(&self, bin: usize, heading: f64) -> Bin {
        let n = self.record.len() as f64;
        let mut means = [0.0; 6];
        for (s, _) in &self.record {
            for (m, v) in means.iter_mut().zip(s.value) {
                *m += v / n;
            }
        }
        let w = frequency(bin);
        let mut x = [Complex::new(0.0, 0.0); 6];
        let mut squares = 0.0;
        for (k, (s, _)) in self.record.iter().enumerate() {
            let window = 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n).cos();
            squares += window * window;
            let turn = Complex::from_polar(window, -w * SAMPLE_S * k as f64);
            for ((x, v), m) in x.iter_mut().zip(s.value).zip(means) {
                *x += turn * (v - m);
            }
        }
        let scale = (2.0 / (n * squares)).sqrt();
        let [north, east, heave, about_north, about_east] =
            [SURGE, SWAY, HEAVE, ROLL, PITCH].map(|d| x[d] * scale);
        let (s, c) = heading.sin_cos();
        let body = |a: Complex<f64>, b: Complex<f64>| [a * c + b * s, b * c - a * s];
        let rate = Complex::new(0.0, w);
        let motion = HullMotion {
            push: body(north, east).map(|v| v * rate),
            heave,
            tilt: body(about_north, about_east),
        };
        let with_rise = |v: Complex<f64>| -(heave.conj() * v).re;
        Bin {
            heave: heave.norm_sqr(),
            speed: north.norm_sqr() + east.norm_sqr(),
            towards: Vector2::new(with_rise(north), with_rise(east)),
            deck: motion.powers(w, &self.deck),
        }
    }

    /// Sea estimated with this hull; None before enough segments, and without a clear wave direction.
    pub(super) fn sea(&self, hull: &HullModel) -> Option<EstimatedSea> {
        if self.segments < MIN_SEGMENTS {
            return None;
        }
        let [rise, speed] = self
            .bins
            .iter()
            .fold([0.0, 0.0], |[h, s], b| [h + b.heave, s + b.speed]);
        let towards: Vector2<f64> = self.bins.iter().map(|b| b.towards).sum();
        let directed = towards.norm() / (rise * speed).sqrt();
        // The negation also rejects NaN.
        if !(directed > MIN_DIRECTED) {
            return None;
        }
        let mut sea = EstimatedSea {
            waves: Vec::new(),
            towards: towards.y.atan2(towards.x),
            correction: [[1.0; SIGNALS]; BINS],
        };
        let mut modelled = [Powers::default(); BINS];
        for (k, bin) in self.bins.iter().enumerate() {
            let (waves, powers) = self.waves(hull, k, bin);
            sea.waves.extend(waves);
            modelled[k] = powers;
        }
        let strongest = modelled
            .iter()
            .map(paired)
            .fold(Powers::default(), |a, b| core::array::from_fn(|f| a[f].max(b[f])));
        for (k, bin) in self.bins.iter().enumerate() {
            sea.correction[k] = correction(&bin.deck, &modelled[k], &strongest);
        }
        let all: f64 = sea.waves.iter().map(|w| w.variance).sum();
        sea.waves.retain(|w| w.variance > NEGLIGIBLE * all);
        (all > 0.0).then_some(sea)
    }

    /// Waves at one frequency of encounter, and the modelled powers of the deck's signals.
    fn waves(&self, hull: &HullModel, k: usize, bin: &Bin) -> (Vec<WaveComponent>, Powers) {
        let directed = bin.towards.norm() / (bin.heave * bin.speed).sqrt().max(f64::MIN_POSITIVE);
        let r = directed.min(MAX_DIRECTED);
        let spread = 2.0 * r / (1.0 - r);
        let mean = bin.towards.y.atan2(bin.towards.x);
        let step = bin_width();
        let (heading, speed_mps) = (self.heading, ahead(&self.velocity, self.heading));
        let mut waves: Vec<WaveComponent> = Vec::with_capacity(DIRECTIONS * LINES.len());
        for j in 0..DIRECTIONS {
            let towards = TAU * j as f64 / DIRECTIONS as f64;
            let weight = (0.5 * (towards - mean)).cos().abs().powf(spread);
            let along = speed_mps * (towards - heading).cos();
            waves.extend(LINES.iter().map(|line| WaveComponent {
                omega: own_frequency(frequency(k) + line * step, along),
                towards,
                variance: weight,
            }));
        }
        let total: f64 = waves.iter().map(|w| w.variance).sum();
        let mut modelled = Powers::default();
        let mut heaves = 0.0;
        for w in &mut waves {
            w.variance /= total;
            let e = Encounter::of(w.omega, w.towards, heading, speed_mps);
            let motion = hull.motion(&e);
            heaves += w.variance * motion.heave.norm_sqr();
            let powers = motion.powers(e.met, &self.deck);
            for (m, p) in modelled.iter_mut().zip(powers) {
                *m += w.variance * p;
            }
        }
        let variance = bin.heave / heaves.max(MIN_RESPONSE);
        for w in &mut waves {
            w.variance *= variance;
        }
        (waves, modelled.map(|m| m * variance))
    }
}

/// Powers of the signals, summed over the two axes of slope and of tilt.
fn paired(powers: &Powers) -> Powers {
    core::array::from_fn(|f| {
        let pair = [SLOPE, TILT].into_iter().find(|p| p.contains(&f));
        pair.map_or(powers[f], |[a, b]| powers[a] + powers[b])
    })
}

/// Ratio of measured to modelled power of each signal at one frequency: `(M + e) / (P + e)`. The prior `e` is a tenth
/// of the power of its pair of axes at the strongest frequency, so that signals hardly excited on the present course
/// keep the model's power.
fn correction(measured: &Powers, modelled: &Powers, strongest: &Powers) -> Powers {
    core::array::from_fn(|f| {
        let prior = PRIOR * strongest[f];
        let ratio = (measured[f] + prior) / (modelled[f] + prior);
        if ratio.is_finite() { ratio } else { 1.0 }
    })
}

/// Component of a velocity (NED, m/s) along a heading (rad).
pub(super) fn ahead(velocity: &Vector2<f64>, heading: f64) -> f64 {
    velocity.x * heading.cos() + velocity.y * heading.sin()
}

/// Frequency of the longest wave met at `met` rad/s, for the speed `along` (m/s) in its direction, rad/s:
/// `omega - omega² along / g = met`.
fn own_frequency(met: f64, along: f64) -> f64 {
    let a = along / GRAVITY;
    let root = 1.0 - 4.0 * a * met;
    if a.abs() < 1e-6 {
        met
    } else if root <= 0.0 {
        // No wave is met at this frequency: use the wave with the highest frequency of encounter.
        0.5 / a
    } else {
        2.0 * met / (1.0 + root.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of accepted segments after motion northwards at these speeds, m/s, each for this number of samples.
    fn segments(speeds: &[(f64, usize)]) -> f64 {
        let mut spectrum = WaveSpectrum::new(Vector3::zeros());
        let samples = speeds.iter().flat_map(|(mps, n)| core::iter::repeat_n(*mps, *n));
        for (k, mps) in samples.enumerate() {
            let sample = MotionSample {
                at: alight_shared::time::Time::from_secs(SAMPLE_S * k as f64),
                mean_heading: 0.0,
                value: [0.0; 6],
                rate: [0.0; 5],
                level_variance: 0.0,
            };
            spectrum.push(sample, Vector2::new(mps, 0.0));
        }
        spectrum.segments
    }

    #[test]
    fn segments_of_a_vessel_that_changes_its_speed() {
        assert!((1.3..1.5).contains(&course_change_mps()));
        let before = SEGMENT + 3 * HOP;
        assert_eq!(segments(&[(3.0, before)]), 4.0);
        // A change of speed that shifts waves by less than one bin keeps the spectrum.
        assert_eq!(segments(&[(3.0, before), (4.0, SEGMENT)]), 8.0);
        // The segment with the change is rejected, and only the first one after it remains.
        assert_eq!(segments(&[(5.0, before), (2.0, SEGMENT - HOP)]), 4.0);
        assert_eq!(segments(&[(5.0, before), (2.0, SEGMENT)]), 1.0);
    }

    #[test]
    fn own_frequency_of_a_wave_that_is_met() {
        for (omega, along) in [(1.2_f64, -4.0), (1.2, 0.0), (0.9, 3.0), (0.6, 5.0)] {
            let met = omega - omega * omega * along / GRAVITY;
            assert!(
                (own_frequency(met, along) - omega).abs() < 1e-9,
                "{omega} {along}"
            );
        }
        assert!((own_frequency(3.0, 4.0) - 0.5 * GRAVITY / 4.0).abs() < 1e-9);
    }

    #[test]
    fn correction_of_a_figure_that_is_hardly_excited() {
        let mut modelled = [1.0; SIGNALS];
        modelled[0] = 1e-6;
        let mut measured = modelled.map(|m| 4.0 * m);
        measured[0] = 1e-3;
        let c = correction(&measured, &modelled, &paired(&modelled));
        assert!(c[0] < 1.1 && c[1] > 3.5 && c[2] > 3.5, "{c:?}");
        assert_eq!(correction(&measured, &[0.0; SIGNALS], &[0.0; SIGNALS])[2], 1.0);
        // At a frequency without waves, a small remainder of a manoeuvre is not a response.
        let quiet = correction(&[0.01; SIGNALS], &[1e-6; SIGNALS], &paired(&modelled));
        assert!(quiet.iter().all(|c| *c < 1.2), "{quiet:?}");
    }
}

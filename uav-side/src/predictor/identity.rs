//! Identifies the vessel's own deck among several decks with the same tags.
//!
//! A place with repeated detections is a deck. A single deck is accepted unless its rocking differs from the radio's
//! report; for the own deck the sum of squares over a block of [`BLOCK`] samples is chi-square distributed. Among
//! several decks the own deck is the one that was followed before the others appeared (only without the radio).
//! Otherwise it is the one whose log likelihood exceeds that of every other deck by [`MARGIN`]. The log likelihood
//! ratio of decks 1 and 2 is
//!
//! ```text
//! L = 1/2 ((apart2 / sd)² - (apart1 / sd)²) + 1/2 ((yaw2 / sd)² - (yaw1 / sd)²)
//!     + sum over tilt about north, about east and height of n/2 ln((s1 + s2)² / (4 s1 s2)), negative where s1 > s2
//! ```
//!
//! The last terms are the ratios for normal values of unknown variances `s` (about the mean), which are smaller for the
//! own deck. Whatever the errors, these terms grow with the number of independent samples `n` only if the decks move
//! differently.
//!
//! `apart` is the distance from the position by radio or beacon. `yaw`, `tilt` and `height` are the camera's values
//! minus the radio's at the same time. The height is relative to its low-pass, because the drone's own height drifts.
//! During the approach the height discriminates better than the tilt, which is then accurate only to ten degrees. Boats
//! moored next to each other have the same heading but rock differently, because a wave reaches one before the other.
//! The camera mount's error is the same for both and is part of the mean. Until the decision no deck is followed, and
//! the reason is reported.

use std::collections::VecDeque;

use alight_shared::{
    estimation::low_pass_gain,
    frames::wrap_angle,
    time::{DroneTime, Span},
};
use nalgebra::{Vector2, Vector3, Vector4};

use super::{agreement::PLACE_SD, observation::DeckObservation, track::FrameJump};

const MAX_DECKS: usize = 4;
/// Number of stored radio reports: more than a second at 30 Hz.
const MAX_REPORTS: usize = 48;
/// Maximum time over which a report is extrapolated with its rates, forward or backward, s.
const HOLDS_S: f64 = 0.2;
/// Maximum distance between detections of one deck, m: less than the width of any deck, because decks do not overlap.
const SAME_M: f64 = 0.8;
/// Increase of this distance with time, in addition to the vessel's motion, m/s, and per metre of range, for errors of
/// the drone's attitude and heading.
const SAME_MPS: f64 = 0.3;
const SAME_PER_M: f64 = 0.05;
/// Minimum distance between decks that were never detected in one image, m; closer ones may be the same deck.
const APART_M: f64 = 5.0;
/// Minimum number of images for a place to count as a deck: a single misread tag is not a deck.
const CONFIRMED: u32 = 5;
/// Time for which an undetected deck is remembered, s, as in a forecast from vision alone.
const MEMORY_S: f64 = 30.0;
/// Time after which a single deck is followed without the radio, s.
const FOLLOWED_S: f64 = 2.0;
/// Minimum of a mean square, in units of the stated variance; smaller values are due to chance or overestimated
/// variances.
const MIN_VARIANCE: f64 = 0.05;
/// Sampling interval of the tilt, s, because errors of successive images are correlated; and minimum number of samples
/// per deck: half a wave.
const SAMPLE_S: f64 = 0.2;
/// Interval between independent samples, s: half a wave period, or a view of the tags from one side.
const INDEPENDENT_S: f64 = 3.0;
/// Minimum log likelihood ratio of each single motion, because tilt and height of one hull must not contradict each
/// other.
const AGAINST: f64 = -1.0;
const MIN_SAMPLES: f64 = 15.0;
/// Maximum difference in tilt, rad. No drone lands at a larger tilt, so a larger difference means that the tag was
/// solved for the wrong minimum.
const MAX_TILT_RAD: f64 = 0.3;
/// Minimum log likelihood ratio against any other deck, for 1 wrong decision in 10 000.
const MARGIN: f64 = 9.2;
/// Errors of yaw by compass and camera, of the vessel's tilt by radio, and of a tag's tilt (minimum), rad.
const YAW_SD_RAD: f64 = 0.037;
const TILT_SD_RAD: f64 = 0.009;
/// Error of the deck's height by radio and of the drone's height from one wave to the next, m.
const HEAVE_SD_M: f64 = 0.1;
/// Time constant of the mean height residual, s: follows the drone's own drift and passes most of a wave.
const LEVEL_TIME_S: f64 = 4.0;
/// Number of tilt samples in a block: one wave period, 5 s.
const BLOCK: f64 = 25.0;
/// Maximum sum of squares of a block for the own deck. The 99.99 % point of a chi-square with 48 degrees of freedom
/// (two angles about their means) is 93; the factor 4 allows errors twice as large as stated.
const MAX_SQUARES: f64 = 4.0 * 93.0;
/// Upper limit of one squared sample: a single misread tag is not a contradiction.
const MAX_SAMPLE: f64 = 30.0;
/// Time after the last ambiguous image for which the ambiguity is reported, s.
const REPORTED_S: f64 = 1.0;

/// Tilt about north and east, yaw, rad, height of the deck's centre (down, m), and their rates.
#[derive(Clone, Copy, Debug)]
struct Report {
    at: DroneTime,
    pose: Vector4<f64>,
    rates: Vector4<f64>,
}

/// Detected minus reported attitude of a deck: mean, and sum of squares about the mean in variances.
#[derive(Clone, Copy, Debug, Default)]
struct Residual {
    n: f64,
    mean: Vector3<f64>,
    /// Sums of squares of tilt about north, of tilt about east, and of height.
    squares: [f64; 3],
    sampled: Option<DroneTime>,
}

impl Residual {
    /// Adds a sample (Welford's update).
    fn take(&mut self, at: DroneTime, r: Vector3<f64>, tilt_variance: [f64; 2]) {
        self.sampled = Some(at);
        self.n += 1.0;
        let before = r - self.mean;
        self.mean += before / self.n;
        let after = r - self.mean;
        for i in 0..2 {
            self.squares[i] += (before[i] * after[i] / tilt_variance[i]).min(MAX_SAMPLE);
        }
    }
    /// Log likelihood ratio of this deck against the other; minus infinity if one motion contradicts the others.
    fn over(&self, other: &Residual) -> f64 {
        let yaw = |r: &Residual| (r.mean.z / YAW_SD_RAD).powi(2);
        let n = self.n.min(other.n) * SAMPLE_S / INDEPENDENT_S;
        let variance = |r: &Residual, i: usize| (r.squares[i] / r.n.max(1.0)).max(MIN_VARIANCE);
        let motion: [f64; 3] = core::array::from_fn(|i| {
            let own = variance(self, i);
            let others = variance(other, i);
            let ratio = (own + others).powi(2) / (4.0 * own * others);
            (0.5 * n * ratio.ln()).copysign(others - own)
        });
        if motion.iter().any(|m| !(*m >= AGAINST)) {
            return f64::NEG_INFINITY;
        }
        0.5 * (yaw(other) - yaw(self)) + motion.iter().sum::<f64>()
    }
}

#[derive(Clone, Copy, Debug)]
struct Deck {
    place: Vector2<f64>,
    at: DroneTime,
    since: DroneTime,
    images: u32,
    /// Number of images in which another deck was detected as well.
    together: u32,
    /// Distance from the position by radio or beacon, in standard deviations.
    apart_sd: Option<f64>,
    /// Residual while other decks are in view.
    residual: Residual,
    /// Low-pass of measured minus reported height while other decks are in view, and its sample count.
    level: Option<(f64, f64)>,
    block: Residual,
    /// Whether the last complete block contradicted the radio.
    rocks_apart: bool,
}

impl Deck {
    /// Adds a sample, and tests the block when it is complete.
    fn judge(&mut self, at: DroneTime, r: Vector3<f64>, tilt_variance: [f64; 2]) {
        self.block.take(at, r, tilt_variance);
        if self.block.n >= BLOCK {
            let [north, east, _] = self.block.squares;
            self.rocks_apart = !(north + east <= MAX_SQUARES);
            self.block = Residual {
                sampled: Some(at),
                ..Residual::default()
            };
        }
    }
    /// Adds tilt and height (m) to the residual that is compared with other decks.
    fn distinguish(&mut self, at: DroneTime, r: Vector3<f64>, tilt_variance: [f64; 2], height: (f64, f64)) {
        let (height, variance) = height;
        let dt = (self.residual.sampled).map_or(0.0, |before| (at - before).secs());
        self.residual.take(at, r, tilt_variance);
        let (level, n) = self.level.map_or((height, 1.0), |(level, n)| (level, n + 1.0));
        // A plain mean at first, because one sample does not define a level.
        let gain = low_pass_gain(dt, LEVEL_TIME_S).max(1.0 / n);
        let before = height - level;
        let after = (height - level) * (1.0 - gain);
        self.level = Some((height - after, n));
        self.residual.squares[2] += (before * after / variance).min(MAX_SAMPLE);
    }
    fn is_admissible(&self) -> bool {
        self.apart_sd.is_none_or(|sd| sd <= PLACE_SD)
    }
    fn counts(&self) -> bool {
        self.images >= CONFIRMED && self.is_admissible()
    }
    /// Whether the other deck may be the own deck: it is present and is not a poor detection of this deck.
    fn rivals(&self, other: &Deck) -> bool {
        let in_one_image = other.at == self.at && other.is_admissible();
        let two = other.together >= CONFIRMED || (other.place - self.place).norm() > APART_M;
        in_one_image || other.counts() && two
    }
    fn is_clear_of(&self, other: &Deck) -> bool {
        let apart = |d: &Deck| d.apart_sd.unwrap_or(0.0).powi(2);
        let place = 0.5 * (apart(other) - apart(self));
        let enough = self.residual.n.min(other.residual.n) >= MIN_SAMPLES;
        enough && place + self.residual.over(&other.residual) >= MARGIN
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Own,
    Other,
    /// Undecided between this many decks.
    Several(u32),
}

#[derive(Clone, Debug, Default)]
pub(super) struct Decks {
    decks: Vec<Deck>,
    reports: VecDeque<Report>,
    /// Index of the own deck in `decks`, once decided.
    own: Option<usize>,
    several: Option<(DroneTime, u32)>,
}

impl Decks {
    /// Adds an estimate received by radio. `height`: height of the deck's centre, down, m, and its rate, m/s.
    pub(super) fn report(&mut self, o: &DeckObservation, height: [f64; 2]) {
        let [.., Some((north, _)), Some((east, _)), Some((yaw, _))] = o.value else {
            return;
        };
        if self.reports.back().is_some_and(|r| r.at >= o.at) {
            return;
        }
        if self.reports.len() == MAX_REPORTS {
            self.reports.pop_front();
        }
        let rate = |i: usize| o.rate[i].map_or(0.0, |(v, _)| v);
        self.reports.push_back(Report {
            at: o.at,
            pose: Vector4::new(north, east, yaw, height[0]),
            rates: Vector4::new(rate(3), rate(4), rate(5), height[1]),
        });
    }
    /// Radio report extrapolated to `t` from the nearest report.
    fn reported(&self, t: DroneTime) -> Option<Vector4<f64>> {
        let away = |r: &&Report| (t - r.at).secs().abs();
        let nearest = (self.reports.iter()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        let by = (t - nearest.at).secs();
        (by.abs() <= HOLDS_S).then(|| nearest.pose + nearest.rates * by)
    }

    /// Assigns tags detected at `range_m` to a deck and returns its index. `velocity`: velocity of the vessel, m/s;
    /// `apart`: distance from the position by radio or beacon, and its limit, m.
    pub(super) fn see(
        &mut self,
        o: &DeckObservation,
        range_m: f64,
        velocity: Vector2<f64>,
        apart: Option<[f64; 2]>,
    ) -> Option<usize> {
        let [Some((north, _)), Some((east, _)), ..] = o.value else {
            return None;
        };
        self.forget(o.at);
        let place = Vector2::new(north, east);
        let apart_sd = apart.map(|[apart, limit]| PLACE_SD * apart / limit.max(1e-3));
        let near = |d: &Deck| {
            let dt = (o.at - d.at).secs().max(0.0);
            let off = (place - d.place - velocity * dt).norm();
            (off, SAME_M + SAME_MPS * dt + SAME_PER_M * range_m)
        };
        // Detections in the same image belong to different decks.
        let nearest = (self.decks.iter().enumerate())
            .filter(|(_, d)| d.at != o.at)
            .map(|(k, d)| (k, near(d)))
            .filter(|(_, (off, within))| off <= within)
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let k = match nearest {
            Some((k, _)) => k,
            None if self.decks.len() < MAX_DECKS => {
                self.decks.push(Deck {
                    place,
                    at: o.at,
                    since: o.at,
                    images: 0,
                    together: 0,
                    apart_sd,
                    residual: Residual::default(),
                    level: None,
                    block: Residual::default(),
                    rocks_apart: false,
                });
                self.decks.len() - 1
            }
            None => return None,
        };
        let deck = self.decks.get_mut(k)?;
        deck.place = place;
        deck.at = o.at.max(deck.at);
        deck.images = deck.images.saturating_add(1);
        deck.apart_sd = apart_sd;
        let in_image = self.decks.iter().filter(|d| d.at == o.at).count();
        if in_image > 1 {
            // The second detection in an image also counts for the first deck.
            let both = |(i, d): &(usize, &mut Deck)| d.at == o.at && (*i == k || in_image == 2);
            (self.decks.iter_mut().enumerate())
                .filter(both)
                .for_each(|(_, d)| d.together = d.together.saturating_add(1));
        }
        Some(k)
    }
    /// Compares tilt and height of a detected deck with the radio at the same time.
    fn compare(&mut self, k: usize, o: &DeckObservation) {
        let [
            ..,
            Some((down, vd)),
            Some((north, vn)),
            Some((east, ve)),
            Some((yaw, _)),
        ] = o.value
        else {
            return;
        };
        let several = self.rivals_of(k).next().is_some();
        let Some(report) = self.reported(o.at) else {
            return;
        };
        let Some(deck) = self.decks.get_mut(k) else { return };
        let due = |r: &Residual| {
            let pause = Span::from_secs(SAMPLE_S);
            r.sampled.is_none_or(|at| o.at - at >= pause)
        };
        let mut r = Vector3::new(north, east, yaw) - report.xyz();
        r.z = wrap_angle(r.z);
        // The tilt of a tag viewed from the side is unreliable.
        if o.lever() == [0.0; 2] || r.xy().amax() > MAX_TILT_RAD {
            return;
        }
        let variances = [vn, ve].map(|v| v + 2.0 * TILT_SD_RAD.powi(2));
        if several && due(&deck.residual) {
            let height = (down - report.w, vd + HEAVE_SD_M * HEAVE_SD_M);
            deck.distinguish(o.at, r, variances, height);
        }
        if due(&deck.block) {
            deck.judge(o.at, r, variances);
        }
    }
    /// Verdict on the tags of deck `k`. `radio`: whether the radio is received.
    pub(super) fn verdict(&mut self, k: usize, o: &DeckObservation, radio: bool) -> Verdict {
        self.compare(k, o);
        if self.decks.get(k).is_some_and(|d| d.rocks_apart) {
            self.own = self.own.filter(|own| *own != k);
            self.several = Some((o.at, 2));
            return Verdict::Other;
        }
        if self.own.is_none() {
            self.own = self.decide(o.at, radio);
        }
        if let Some(own) = self.own {
            return if own == k { Verdict::Own } else { Verdict::Other };
        }
        match u32::try_from(self.rivals_of(k).count()) {
            Ok(0) => Verdict::Own,
            rivals => {
                let n = rivals.unwrap_or(u32::MAX).saturating_add(1);
                self.several = Some((o.at, n));
                Verdict::Several(n)
            }
        }
    }
    fn rivals_of(&self, k: usize) -> impl Iterator<Item = &Deck> {
        let deck = self.decks.get(k);
        let others = self.decks.iter().enumerate().filter(move |(i, _)| *i != k);
        others
            .filter(move |(_, other)| deck.is_some_and(|d| d.rivals(other)))
            .map(|(_, other)| other)
    }
    /// Index of the own deck, once it can be decided.
    fn decide(&self, now: DroneTime, radio: bool) -> Option<usize> {
        let clear = |(k, deck): &(usize, &Deck)| {
            if self.rivals_of(*k).next().is_none() {
                // While the radio is received, a second deck may still appear at the vessel's position and be the own deck.
                return (now - deck.since).secs() >= FOLLOWED_S && !radio;
            }
            self.rivals_of(*k).all(|other| deck.is_clear_of(other))
        };
        let mut counts = self.decks.iter().enumerate().filter(|(_, d)| d.counts());
        counts.find(clear).map(|(k, _)| k)
    }
    fn forget(&mut self, now: DroneTime) {
        let lasts = |d: &Deck| (now - d.at).secs() <= MEMORY_S;
        if self.decks.iter().all(lasts) {
            return;
        }
        let own = self
            .own
            .and_then(|k| self.decks.get(k))
            .filter(|d| lasts(d))
            .copied();
        self.decks.retain(lasts);
        self.own = own.and_then(|own| {
            let same = |d: &Deck| d.since == own.since && d.place == own.place;
            self.decks.iter().position(same)
        });
    }
    pub(super) fn shift(&mut self, jump: &FrameJump) {
        for d in &mut self.decks {
            let place = Vector3::new(d.place.x, d.place.y, jump.about.z);
            d.place = jump.of(&place).xy();
            d.level = None;
        }
    }
    /// Number of decks between which the identification is undecided; 0 once it is decided.
    pub(super) fn undecided(&self, now: DroneTime) -> u32 {
        let recent = self.several.filter(|(at, _)| (now - *at).secs() < REPORTED_S);
        recent.filter(|_| self.own.is_none()).map_or(0, |(_, n)| n)
    }
}

#[cfg(test)]
mod tests {
    use super::{super::observation::ObservationKind, *};
    use alight_shared::time::Time;

    fn observation(kind: ObservationKind, at_s: f64, place: [f64; 2], attitude: [f64; 3]) -> DeckObservation {
        let tilt_variance = 0.02_f64.powi(2);
        let [n, e] = place.map(|v| Some((v, 1e-4)));
        let [a, b, c] = attitude.map(|v| Some((v, tilt_variance)));
        DeckObservation {
            at: Time::from_secs(at_s),
            kind,
            value: [n, e, Some((0.0, 1e-4)), a, b, c],
            rate: [None; 6],
            from_drone: Vector3::z() * 7.0,
        }
    }
    /// Roll of a vessel; `later_s` is the delay of the wave, s.
    fn roll(t: f64, later_s: f64) -> f64 {
        0.07 * (1.2 * (t - later_s)).sin() + 0.03 * (1.9 * (t - later_s)).sin()
    }
    fn heave(t: f64, later_s: f64) -> f64 {
        0.3 * (1.2 * (t - later_s)).sin()
    }
    /// Verdicts on two decks 3 m apart after `seconds`.
    fn side_by_side(seconds: f64, radio: bool, later_s: f64) -> ([Verdict; 2], Decks) {
        with_tilt_sd(0.02, seconds, radio, later_s)
    }
    /// Verdicts for tags whose tilt has this standard deviation, rad.
    fn with_tilt_sd(tilt_sd: f64, seconds: f64, radio: bool, later_s: f64) -> ([Verdict; 2], Decks) {
        let mut decks = Decks::default();
        let mut verdicts = [Verdict::Own; 2];
        for k in 0..(seconds * 30.0) as u32 {
            let t = f64::from(k) / 30.0;
            if radio {
                let estimate = observation(ObservationKind::Estimate, t, [0.0; 2], [roll(t, 0.0), 0.0, 0.1]);
                decks.report(&estimate, [heave(t, 0.0), 0.0]);
            }
            // Errors of the tag's tilt and of the camera's mount.
            let noise = tilt_sd * (37.0 * t).sin() + 0.02;
            let detected = [0.0, later_s].map(|later| {
                // Drift and noise of the drone's height.
                let down = heave(t, later) + 0.02 * t + 0.05 * (41.0 * t).sin();
                ([roll(t, later) + noise, 0.02 - noise, 0.12], down)
            });
            let places = [[1.0, 0.0], [-2.0, 0.0]];
            let both: Vec<_> = (detected.iter().zip(places))
                .map(|((attitude, down), place)| {
                    let mut o = observation(ObservationKind::Tag, t, place, *attitude);
                    o.value[2] = Some((*down, 0.1 * 0.1));
                    o.value[3] = o.value[3].map(|(v, _)| (v, tilt_sd * tilt_sd));
                    o.value[4] = o.value[4].map(|(v, _)| (v, tilt_sd * tilt_sd));
                    o
                })
                .collect();
            let of: Vec<_> = (both.iter().zip([1.0, 2.0]))
                .map(|(o, m)| decks.see(o, 7.0, Vector2::zeros(), radio.then_some([m, 5.7])))
                .collect();
            for (i, (o, k)) in both.iter().zip(of).enumerate() {
                verdicts[i] = decks.verdict(k.unwrap(), o, radio);
            }
        }
        (verdicts, decks)
    }

    #[test]
    fn own_deck_by_its_rocking() {
        assert_eq!(side_by_side(90.0, true, 0.4).0, [Verdict::Own, Verdict::Other]);
        // In calm water, or if they rock in phase, the decks cannot be distinguished.
        let (verdicts, decks) = side_by_side(30.0, true, 0.0);
        assert_eq!(verdicts, [Verdict::Several(2); 2]);
        assert_eq!(decks.undecided(Time::from_secs(30.0)), 2);
    }

    /// At 15 m, where a tag's tilt is accurate only to ten degrees, the height distinguishes the decks.
    #[test]
    fn own_deck_by_its_heave() {
        assert_eq!(
            with_tilt_sd(0.17, 360.0, true, 0.4).0,
            [Verdict::Own, Verdict::Other]
        );
        assert_eq!(with_tilt_sd(0.17, 30.0, true, 0.0).0, [Verdict::Several(2); 2]);
    }

    /// A single deck rocks by 7 deg as reported by radio, or half a period later.
    #[test]
    fn lone_deck_against_the_radio() {
        for (later_s, expected) in [(0.0, Verdict::Own), (2.4, Verdict::Other)] {
            let mut decks = Decks::default();
            let mut verdict = Verdict::Own;
            for n in 0..300 {
                let t = f64::from(n) / 30.0;
                let roll = |t: f64| 0.12 * (1.3 * t).sin();
                decks.report(
                    &observation(ObservationKind::Estimate, t, [0.0; 2], [roll(t), 0.0, 0.0]),
                    [0.0; 2],
                );
                let o = observation(
                    ObservationKind::Tag,
                    t,
                    [0.5, 0.0],
                    [roll(t - later_s) + 0.03, 0.02, 0.0],
                );
                let k = decks.see(&o, 7.0, Vector2::zeros(), Some([0.5, 5.7])).unwrap();
                verdict = decks.verdict(k, &o, true);
            }
            assert_eq!(verdict, expected, "{later_s} s later");
            let undecided = decks.undecided(Time::from_secs(10.0));
            assert_eq!(undecided > 1, expected == Verdict::Other);
        }
    }

    #[test]
    fn decks_without_a_radio() {
        // If there are two decks from the start, neither is followed.
        assert_eq!(side_by_side(30.0, false, 0.4).0, [Verdict::Several(2); 2]);
        // A single deck remains the own deck when another comes into view, and while it is out of view itself.
        let mut decks = Decks::default();
        let mut verdict = |t: f64, north: f64| {
            let o = observation(ObservationKind::Tag, t, [north, 0.0], [0.0; 3]);
            let k = decks.see(&o, 5.0, Vector2::zeros(), None).unwrap();
            decks.verdict(k, &o, false)
        };
        for k in 0..90 {
            assert_eq!(verdict(f64::from(k) / 30.0, 0.0), Verdict::Own);
        }
        assert_eq!(verdict(3.1, 5.0), Verdict::Other);
        for k in 0..300 {
            assert_eq!(verdict(4.0 + f64::from(k) / 30.0, 5.0), Verdict::Other);
        }
        assert_eq!(verdict(15.0, 0.5), Verdict::Own);
    }
}

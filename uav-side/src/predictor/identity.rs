//! Which of several decks with the same tags is the vessel's own.
//!
//! Each place at which tags are detected again and again is a deck. One alone is taken, unless it rocks otherwise than
//! the radio reports: the last sum is that of [`BLOCK`] samples then, and chi-square distributed where they are of one
//! deck. Of several the vessel's own is, in this order, the one that was followed before they were several (continuity of
//! place: without the radio), and the one that is more likely than any other by a factor of [`MARGIN`]'s exponential,
//! with the logarithm of the ratio of the likelihoods of decks 1 and 2
//!
//! ```text
//! L = 1/2 ((apart2 / sd)² - (apart1 / sd)²)  +  1/2 ((yaw2 / sd)² - (yaw1 / sd)²)
//!     + sum over tilt about north, about east and height of  n/2 ln((s1 + s2)² / (4 s1 s2)),  negative where s1 > s2
//! ```
//!
//! The last are the ratios for normal values of unknown variances `s`, of which the own deck's is the smaller one: they grow with the
//! independent samples `n` only where the decks move apart, however much both err, and not by chance. A variance is that about
//! the mean.
//!
//! `apart` is its distance from where radio or beacon places the vessel; `yaw`, `tilt` and `height` are what the camera sees less
//! what the radio reports of the same time, the latter about its low-pass: the drone's own height
//! drifts. From the height of an approach the height distinguishes more than the tilt, which is measured to ten degrees there. Boats that lie side by side head alike, and still rock apart:
//! a wave reaches one before the other. What the camera's mount adds is the same for both, and in the mean. Until then none
//! is followed, and the reason is given.

use std::collections::VecDeque;

use alight_shared::estimation::low_pass_gain;
use alight_shared::frames::wrap_angle;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{Vector2, Vector3, Vector4};

use super::agreement::PLACE_SD;
use super::observation::DeckObservation;
use super::track::FrameJump;

/// Maximum number of decks that are distinguished.
const MAX_DECKS: usize = 4;
/// Reports of the radio that are kept: more than a second at 30 Hz.
const MAX_REPORTS: usize = 48;
/// A report holds for so long before and after its time, by its rates, s.
const HOLDS_S: f64 = 0.2;
/// Tags are of the same deck where they are no further from where it was than this, m: two decks do not overlap, and the
/// narrowest that a drone lands on is wider.
const SAME_M: f64 = 0.8;
/// ... and this much more for each second since, m/s, besides the vessel's own way, and for each metre from which they
/// are detected: attitude and heading of the drone.
const SAME_MPS: f64 = 0.3;
const SAME_PER_M: f64 = 0.05;
/// Tags never detected in one image are two decks from this distance on, m: nearer it may be one deck, badly detected.
const APART_M: f64 = 5.0;
/// A deck counts once it was detected in so many images: a single misread tag does not make one.
const CONFIRMED: u32 = 5;
/// A deck that is not detected is remembered for so long, s: as the forecast by vision alone.
const MEMORY_S: f64 = 30.0;
/// Without the radio a deck that was alone for so long is the one that is followed, s.
const FOLLOWED_S: f64 = 2.0;
/// A mean square in units of the stated variance is no smaller than this: by chance, or stated too large.
const MIN_VARIANCE: f64 = 0.05;
/// Samples of the tilt are taken so far apart, s: errors of successive images are not independent. So many of each deck are
/// compared at least: half a wave.
const SAMPLE_S: f64 = 0.2;
/// Errors of the same sign last for so long, s, as do tags viewed from one side and half a wave: so far apart two samples count as
/// two.
const INDEPENDENT_S: f64 = 3.0;
/// No motion may speak so much against the deck that the others speak for, as a logarithm: they are of one hull.
const AGAINST: f64 = -1.0;
const MIN_SAMPLES: f64 = 15.0;
/// A tilt that differs by more is no deck's on which a drone lands, but of a tag that was solved for its other minimum, rad.
const MAX_TILT_RAD: f64 = 0.3;
/// The vessel's own deck is so much more likely than any other, as a logarithm: 1 of 10 000 is wrong.
const MARGIN: f64 = 9.2;
/// Error of compass and camera in yaw together, rad; of the vessel's tilt by radio, rad, and minimum error of a tag's tilt.
const YAW_SD_RAD: f64 = 0.037;
const TILT_SD_RAD: f64 = 0.009;
/// Error of the deck's height by radio and of the drone's own, m, from one wave to the next.
const HEAVE_SD_M: f64 = 0.1;
/// Time constant of what is left of the height on the average, s: that of the drone's own drift, and most of a wave passes.
const LEVEL_TIME_S: f64 = 4.0;
/// Samples of a deck's tilt after which it is compared with the radio's as a whole: 5 s, a period of the waves.
const BLOCK: f64 = 25.0;
/// A sum of squares of that many samples of two angles about their mean that is no own deck's: 99.99 % of a chi-square with 48
/// degrees of freedom, 93, of errors twice as large as they are stated.
const MAX_SQUARES: f64 = 4.0 * 93.0;
/// One sample counts no more than this: tags that are misread once, or tilted the wrong way, are no contradiction.
const MAX_SAMPLE: f64 = 30.0;
/// Ambiguity is reported for so long after the last image that showed it, s.
const REPORTED_S: f64 = 1.0;

/// Report of the deck by radio at a time: tilt about north and east, yaw, rad, and the height of its centre (down, m), and
/// their rates.
#[derive(Clone, Copy, Debug)]
struct Report {
    at: Time<DroneClock>,
    pose: Vector4<f64>,
    rates: Vector4<f64>,
}

/// Difference of a deck's detected attitude from the radio's: mean, and sum of squares about it in units of their variances.
#[derive(Clone, Copy, Debug, Default)]
struct Residual {
    n: f64,
    mean: Vector3<f64>,
    /// Sums of squares of tilt about north and about east, and of the height.
    squares: [f64; 3],
    sampled: Option<Time<DroneClock>>,
}

impl Residual {
    /// Takes a sample (Welford's update of the sum of squares about the mean).
    fn take(&mut self, at: Time<DroneClock>, r: Vector3<f64>, tilt_variance: [f64; 2]) {
        self.sampled = Some(at);
        self.n += 1.0;
        let before = r - self.mean;
        self.mean += before / self.n;
        let after = r - self.mean;
        for i in 0..2 {
            self.squares[i] += (before[i] * after[i] / tilt_variance[i]).min(MAX_SAMPLE);
        }
    }
    /// Logarithm of the ratio of the likelihoods that this is the own deck's and that the other is; none where one motion
    /// contradicts the others.
    fn over(&self, other: &Residual) -> f64 {
        let yaw = |r: &Residual| (r.mean.z / YAW_SD_RAD).powi(2);
        let n = self.n.min(other.n) * SAMPLE_S / INDEPENDENT_S;
        let variance = |r: &Residual, i: usize| (r.squares[i] / r.n.max(1.0)).max(MIN_VARIANCE);
        let motion: [f64; 3] = core::array::from_fn(|i| {
            let (own, others) = (variance(self, i), variance(other, i));
            let ratio = (own + others).powi(2) / (4.0 * own * others);
            (0.5 * n * ratio.ln()).copysign(others - own)
        });
        if motion.iter().any(|m| !(*m >= AGAINST)) {
            return f64::NEG_INFINITY;
        }
        0.5 * (yaw(other) - yaw(self)) + motion.iter().sum::<f64>()
    }
}

/// A deck in sight.
#[derive(Clone, Copy, Debug)]
struct Deck {
    place: Vector2<f64>,
    at: Time<DroneClock>,
    since: Time<DroneClock>,
    images: u32,
    /// Images in which another was detected as well.
    together: u32,
    /// Distance from where radio or beacon has the vessel, in standard deviations; None: neither has it anywhere.
    apart_sd: Option<f64>,
    /// While others are in sight.
    residual: Residual,
    /// The height as measured less the radio's, low-pass, while others are detected, and of how many samples.
    level: Option<(f64, f64)>,
    /// Always, of the newest block of samples.
    block: Residual,
    /// By the last whole block it rocks otherwise than the radio reports.
    rocks_apart: bool,
}

impl Deck {
    /// Takes a sample to the block, and judges by a whole one.
    fn judge(&mut self, at: Time<DroneClock>, r: Vector3<f64>, tilt_variance: [f64; 2]) {
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
    /// Takes a sample of tilt and height, m, to what distinguishes it from others detected.
    fn distinguish(
        &mut self,
        at: Time<DroneClock>,
        r: Vector3<f64>,
        tilt_variance: [f64; 2],
        height: (f64, f64),
    ) {
        let (height, variance) = height;
        let dt = (self.residual.sampled).map_or(0.0, |before| (at - before).secs());
        self.residual.take(at, r, tilt_variance);
        let (level, n) = self.level.map_or((height, 1.0), |(level, n)| (level, n + 1.0));
        // The mean at first: one sample is no level.
        let gain = low_pass_gain(dt, LEVEL_TIME_S).max(1.0 / n);
        let (before, after) = (height - level, (height - level) * (1.0 - gain));
        self.level = Some((height - after, n));
        self.residual.squares[2] += (before * after / variance).min(MAX_SAMPLE);
    }
    /// It lies where the vessel may be.
    fn is_admissible(&self) -> bool {
        self.apart_sd.is_none_or(|sd| sd <= PLACE_SD)
    }
    fn counts(&self) -> bool {
        self.images >= CONFIRMED && self.is_admissible()
    }
    /// The other may be the own one as well: it is there, and not the same one badly detected.
    fn rivals(&self, other: &Deck) -> bool {
        let in_one_image = other.at == self.at && other.is_admissible();
        let two = other.together >= CONFIRMED || (other.place - self.place).norm() > APART_M;
        in_one_image || other.counts() && two
    }
    /// It is the own one rather than the other.
    fn is_clear_of(&self, other: &Deck) -> bool {
        let apart = |d: &Deck| d.apart_sd.unwrap_or(0.0).powi(2);
        let place = 0.5 * (apart(other) - apart(self));
        let enough = self.residual.n.min(other.residual.n) >= MIN_SAMPLES;
        enough && place + self.residual.over(&other.residual) >= MARGIN
    }
}

/// Verdict on tags at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// They are the deck's own, as far as is known.
    Own,
    /// They are another deck's.
    Other,
    /// One of so many decks is the own one, and it is not known which.
    Several(u32),
}

/// The decks in sight.
#[derive(Clone, Debug, Default)]
pub(super) struct Decks {
    decks: Vec<Deck>,
    reports: VecDeque<Report>,
    /// Index of the own one in `decks`, once that is decided.
    own: Option<usize>,
    /// When one of so many could not be decided upon.
    several: Option<(Time<DroneClock>, u32)>,
}

impl Decks {
    /// The radio's estimate of the vessel; `height`: of the deck's centre, down, m, and its rate, m/s.
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
    /// Radio's report at `t`, by the nearest one.
    fn reported(&self, t: Time<DroneClock>) -> Option<Vector4<f64>> {
        let away = |r: &&Report| (t - r.at).secs().abs();
        let nearest = (self.reports.iter()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        let by = (t - nearest.at).secs();
        (by.abs() <= HOLDS_S).then(|| nearest.pose + nearest.rates * by)
    }

    /// Tags detected from `range_m`; `velocity`: of the vessel, m/s; `apart`: how far from where the radio or the beacon
    /// has the vessel, and how far that may be, m. Returns the deck that they belong to.
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
        // Two of one image are two.
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
        (deck.place, deck.at, deck.images) = (place, o.at.max(deck.at), deck.images.saturating_add(1));
        deck.apart_sd = apart_sd;
        let in_image = self.decks.iter().filter(|d| d.at == o.at).count();
        if in_image > 1 {
            // The first of an image learns of it with the second.
            let both = |(i, d): &(usize, &mut Deck)| d.at == o.at && (*i == k || in_image == 2);
            (self.decks.iter_mut().enumerate())
                .filter(both)
                .for_each(|(_, d)| d.together = d.together.saturating_add(1));
        }
        Some(k)
    }
    /// Tilt and height of a deck that was detected against the radio's of the same time.
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
        // From the side a tag's tilt is a guess.
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
    /// Whether tags that were detected of the deck `k` are the vessel's own; `radio`: that is received.
    pub(super) fn verdict(&mut self, k: usize, o: &DeckObservation, radio: bool) -> Verdict {
        self.compare(k, o);
        if self.decks.get(k).is_some_and(|d| d.rocks_apart) {
            self.own = self.own.filter(|own| *own != k);
            // The vessel's own is another.
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
    /// The others of which one may be the own deck in the place of this.
    fn rivals_of(&self, k: usize) -> impl Iterator<Item = &Deck> {
        let deck = self.decks.get(k);
        let others = self.decks.iter().enumerate().filter(move |(i, _)| *i != k);
        others
            .filter(move |(_, other)| deck.is_some_and(|d| d.rivals(other)))
            .map(|(_, other)| other)
    }
    /// The own deck, if it is known.
    fn decide(&self, now: Time<DroneClock>, radio: bool) -> Option<usize> {
        let clear = |(k, deck): &(usize, &Deck)| {
            if self.rivals_of(*k).next().is_none() {
                // With the radio a second one may still come into view where the vessel is.
                return (now - deck.since).secs() >= FOLLOWED_S && !radio;
            }
            self.rivals_of(*k).all(|other| deck.is_clear_of(other))
        };
        let mut counts = self.decks.iter().enumerate().filter(|(_, d)| d.counts());
        counts.find(clear).map(|(k, _)| k)
    }
    /// Forgets what was not detected for long.
    fn forget(&mut self, now: Time<DroneClock>) {
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
    /// The frame has jumped.
    pub(super) fn shift(&mut self, jump: &FrameJump) {
        for d in &mut self.decks {
            let place = Vector3::new(d.place.x, d.place.y, jump.about.z);
            d.place = jump.of(&place).xy();
            d.level = None;
        }
    }
    /// Number of decks of which one is the own one, while it is not known which; 0: it is known, or no deck is.
    pub(super) fn undecided(&self, now: Time<DroneClock>) -> u32 {
        let recent = self.several.filter(|(at, _)| (now - *at).secs() < REPORTED_S);
        recent.filter(|_| self.own.is_none()).map_or(0, |(_, n)| n)
    }
}

#[cfg(test)]
mod tests {
    use super::super::observation::ObservationKind;
    use super::*;

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
    /// A vessel that rolls, and one that the same wave reaches so much later, s.
    fn roll(t: f64, later_s: f64) -> f64 {
        0.07 * (1.2 * (t - later_s)).sin() + 0.03 * (1.9 * (t - later_s)).sin()
    }
    /// Height of its deck, m.
    fn heave(t: f64, later_s: f64) -> f64 {
        0.3 * (1.2 * (t - later_s)).sin()
    }
    /// The verdict on each of two decks after `seconds`, 3 m from each other; with or without the radio.
    fn side_by_side(seconds: f64, radio: bool, later_s: f64) -> ([Verdict; 2], Decks) {
        with_tilt_sd(0.02, seconds, radio, later_s)
    }
    /// Verdicts where a tag's tilt has this standard deviation, rad.
    fn with_tilt_sd(tilt_sd: f64, seconds: f64, radio: bool, later_s: f64) -> ([Verdict; 2], Decks) {
        let mut decks = Decks::default();
        let mut verdicts = [Verdict::Own; 2];
        for k in 0..(seconds * 30.0) as u32 {
            let t = f64::from(k) / 30.0;
            if radio {
                let estimate = observation(ObservationKind::Estimate, t, [0.0; 2], [roll(t, 0.0), 0.0, 0.1]);
                decks.report(&estimate, [heave(t, 0.0), 0.0]);
            }
            // Errors of the tags' tilt, and of the camera's mount.
            let noise = tilt_sd * (37.0 * t).sin() + 0.02;
            let detected = [0.0, later_s].map(|later| {
                // The drone's own height drifts, and errs.
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
        // In calm water, or where both rock as one, nothing distinguishes them.
        let (verdicts, decks) = side_by_side(30.0, true, 0.0);
        assert_eq!(verdicts, [Verdict::Several(2); 2]);
        assert_eq!(decks.undecided(Time::from_secs(30.0)), 2);
    }

    /// From 15 m a tag's tilt is measured to ten degrees: the height distinguishes them.
    #[test]
    fn own_deck_by_its_heave() {
        assert_eq!(
            with_tilt_sd(0.17, 360.0, true, 0.4).0,
            [Verdict::Own, Verdict::Other]
        );
        assert_eq!(with_tilt_sd(0.17, 30.0, true, 0.0).0, [Verdict::Several(2); 2]);
    }

    /// One deck alone that rocks by 7 deg as the radio reports, or half a period later.
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
        // Two at the beginning: none is followed.
        assert_eq!(side_by_side(30.0, false, 0.4).0, [Verdict::Several(2); 2]);
        // One alone is, and stays the one when another comes into view, and while it is out of view itself.
        let mut decks = Decks::default();
        let mut verdict = |t: f64, north: f64| {
            let o = observation(ObservationKind::Tag, t, [north, 0.0], [0.0; 3]);
            let k = decks.see(&o, 5.0, Vector2::zeros(), None).unwrap();
            decks.verdict(k, &o, false)
        };
        (0..90).for_each(|k| assert_eq!(verdict(f64::from(k) / 30.0, 0.0), Verdict::Own));
        assert_eq!(verdict(3.1, 5.0), Verdict::Other);
        (0..300).for_each(|k| assert_eq!(verdict(4.0 + f64::from(k) / 30.0, 5.0), Verdict::Other));
        assert_eq!(verdict(15.0, 0.5), Verdict::Own);
    }
}

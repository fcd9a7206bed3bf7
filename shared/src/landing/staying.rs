//! The probability that a drone that stands on the deck with its motors stopped stays there: friction, slope, motion and
//! wind.
//!
//! Feet hold while `|f_xy| <= mu |f_z|`, with the specific force `f` in the deck's axes (Coulomb): with the apparent slope
//! `s = f_xy / |f_z|` and the wind's acceleration `w` of a drone that stands, `|s - w / g| <= mu`. What exceeds that moves it,
//! and it is lost where it comes to the edge. A wave is a sine of the amplitude `A` and of the waves' mean frequency `omega`,
//! `A = m x / sin(x)`, `x = omega T / 2`, from the mean `m` over the second `T` about its peak that is predicted and measured.
//! With a push `b` of wind, trim and heel along it, it moves the drone by
//!
//! `d = 9/2 g (A + b - mu)+² / (A omega²)`
//!
//! (the peak as a parabola: the drone breaks away `a` before it and stands again `2 a` after it, `a² = 2 (A + b - mu) / A`).
//!
//! - until a drone that descends now is at rest, each wave of [`WAVE_S`] is the predicted one, along its direction; its
//!   slope is normal with the variance of the predicted tilt, of a peak over its mean and of the gusts;
//! - later no forecast reaches. Waves like those of the last two minutes move it to and fro: by `(d(b) - d(-b)) / 2` in the
//!   mean of a window, with the variance `((d(b) + d(-b)) / 4)²`.
//!
//! In a strong wind a drone does not come to rest where it meets the deck. With the wind's mean acceleration in flight `m` and a
//! gust `u`, which is normal, it meets it by `k_p u` further along the wind, at the speed `k_v u`, and is blown on while its rotors
//! still carry a part of it, by `w = m + u`, to `v = k_v u + t_p (w + g s - p mu g)`; then friction stops it:
//!
//! `x = k_p u + t_p (k_v u + v) / 2 + v² / (2 (g (mu - s) - c w))`, the last at most `v t_w`,
//!
//! with negative speeds taken as 0, and without a slide where `v` is 0.
//! So it is to meet the deck by the mean of `x` upwind of the centre, at most half way to the edge: it then rests about the
//! centre.
//!
//! All is averaged over the friction (Gauss and Hermite, three nodes) and the gusts.

use core::f64::consts::TAU;

use nalgebra::Vector2;

use super::normal::{below, larger, norm};
use super::wind::{ALONG_PER_GUST_S, PLACE_PER_GUST_S2, WindPush, beyond_aligned};
use crate::estimation::moments;
use crate::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use crate::msg::{DeckForecast, PREDICTED_SLOPE_STEP_S, SLOPE_STEP, SLOPE_WINDOW_S};

/// Fraction of the wind's acceleration in flight on a drone that stands with its rotors stopped: half, since rotors that
/// turn have as much drag as the body, and less by the wind's profile above water and deck.
const STANDING: f64 = 0.4;
/// Standard deviation of the friction as a part of it: dry, wet and salt.
const FRICTION_SD: f64 = 0.15;
/// Nodes of an average over a normal figure, in standard deviations, and their weights.
const NODES: [(f64, f64); 3] = [(-1.732, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732, 1.0 / 6.0)];
/// Standard deviation of a peak's slope as a part of it.
const PEAK_SD: f64 = 0.3;
/// Slopes are means over this time, s.
const MEAN_S: f64 = 1.0;
/// Periods that waves have, s: a hull that is quicker carries no drone, and slower ones are a slope that stays.
const PERIOD_S: [f64; 2] = [1.7, 12.0];
/// Waves of which nothing is predicted peak as the quickest do, and move a drone for as long as those of this period, s: a
/// small boat's roll.
const UNKNOWN_PERIOD_S: f64 = 2.3;
/// From the beginning of a descent to rest on the deck, s: down in 4 to 6 s, at rest 4 s later.
const TIME_TO_REST_S: f64 = 10.0;
/// Steepest slopes so far apart are independent, s: half of a wave's period.
const WAVE_S: f64 = 2.0;
/// A slope that was measured so lately counts as if it were predicted, s: a hull that leaves the water over a steep crest
/// does so again.
const JUST_NOW_S: f64 = 4.0;
/// The slope's spread without a forecast of it: the prediction is wrong by this (rms) some seconds ahead.
const UNKNOWN_SD: f64 = 0.08;
/// Minimum spread of any slope: the measured ones' step, and the deck's roughness.
const MIN_SD: f64 = 0.02;
/// From the contact on its rotors still carry it for so long, s, and meanwhile the deck carries this part of its weight.
const PRESS_S: f64 = 0.2;
const PRESSED: f64 = 0.65;
/// Relative standard deviation of a slide.
const SLIDE_SD: f64 = 0.4;
/// Gusts that are averaged over: so many to either side of the mean, so far apart in standard deviations.
const GUSTS: i32 = 6;
const GUST_STEP: f64 = 0.5;
/// A slope that the friction does not overcome passes within this time, s: half of a wave.
const SLIDES_S: f64 = 1.0;
/// Time for which a landed drone has to stay without a hand that holds it, s.
const STAY_S: f64 = 60.0;

/// Whether a drone that lands now will stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Staying {
    /// Probability that it stays.
    pub probability: f64,
    /// Place at which it is to meet the deck to come to rest about its centre, from that, NED, m.
    pub meets: Vector2<f64>,
}

impl Default for Staying {
    fn default() -> Self {
        Staying {
            probability: 1.0,
            meets: Vector2::zeros(),
        }
    }
}

/// Feet on a deck.
#[derive(Clone, Copy, Debug)]
pub struct Stand {
    /// Coefficient of friction; forces that hold the drone down in addition to its weight count in it.
    pub friction: f64,
    /// From the centre to where the first foot would leave the deck, m.
    pub edge_m: f64,
}

impl Stand {
    /// A drone on a deck: friction and the force that holds it, and the nearest edge.
    pub fn on(deck: &DeckGeometry, drone: &DroneGeometry, friction: f64) -> Stand {
        let edge = |side_m: f64, span_m: f64| 0.5 * (side_m - span_m);
        Stand {
            friction: friction * (1.0 + deck.hold_n / (drone.mass_kg * GRAVITY)),
            edge_m: edge(deck.length_m, drone.feet_span_m[0]).min(edge(deck.width_m, drone.feet_span_m[1])),
        }
    }
}

/// Most force that a deck is asked to hold with, N.
const MAX_HOLD_N: u32 = 1000;

/// The smallest `hold_n` (whole newtons) of this deck with which a drone that these slopes move stays with at least
/// `probability`; None where no force up to 1 kN is enough.
pub fn needed_hold_n(
    slopes: &Slopes,
    (deck, drone): (&DeckGeometry, &DroneGeometry),
    friction: f64,
    probability: f64,
) -> Option<f64> {
    let stays = |hold: u32| {
        let hold_n = f64::from(hold);
        let stand = Stand::on(&DeckGeometry { hold_n, ..*deck }, drone, friction);
        Staying::of(slopes, &stand).probability >= probability
    };
    // The probability grows with the force: between one that is too small and one that is enough.
    let (mut small, mut enough) = (0, MAX_HOLD_N);
    if stays(small) {
        return Some(0.0);
    }
    if !stays(enough) {
        return None;
    }
    while enough - small > 1 {
        let middle = (small + enough) / 2;
        if stays(middle) {
            enough = middle;
        } else {
            small = middle;
        }
    }
    Some(f64::from(enough))
}

impl Staying {
    /// Probability by the slopes, predicted and measured, and the wind; 0 where one of them is not a number.
    pub fn of(slopes: &Slopes, stand: &Stand) -> Staying {
        let upwind_m = slopes.blown(stand.friction).min(0.5 * stand.edge_m);
        let given = |(sds, weight): (f64, f64)| {
            let friction = stand.friction * (1.0 + FRICTION_SD * sds);
            weight * slopes.stays(friction, stand.edge_m, upwind_m)
        };
        let probability: f64 = NODES.into_iter().map(given).sum();
        let meets = slopes.downwind() * -upwind_m;
        if !probability.is_finite() || meets.iter().any(|m| !m.is_finite()) {
            return Staying {
                probability: 0.0,
                ..Staying::default()
            };
        }
        Staying { probability, meets }
    }
}

/// Waves as sines of one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sines {
    /// rad/s.
    omega: f64,
    /// Amplitude of a sine whose mean over [`MEAN_S`] about its peak is 1.
    peak: f64,
}

impl Sines {
    /// Waves of these slopes' mean frequency, `omega² = <s'²> / <s²>`; without waves those of [`UNKNOWN_PERIOD_S`].
    fn of(slopes: &[Vector2<f64>], mean: &Vector2<f64>) -> Sines {
        let changes = slopes.windows(2).map(|w| match w {
            [before, after] => (after - before).norm_squared(),
            _ => 0.0,
        });
        let square: f64 = slopes.iter().map(|s| (s - mean).norm_squared()).sum();
        // Of a sine, step by step: 4 sin²(omega dt / 2).
        let half = 0.5 * (changes.sum::<f64>() / square).sqrt();
        let [quick, slow] = PERIOD_S.map(|s| TAU / s);
        let peak = |omega: f64| {
            let x = 0.5 * omega * MEAN_S;
            x / x.sin()
        };
        // Less than a step of the message is no wave.
        let known = square > slopes.len() as f64 * SLOPE_STEP * SLOPE_STEP;
        if !(known && half.is_finite()) {
            return Sines {
                omega: TAU / UNKNOWN_PERIOD_S,
                peak: peak(quick),
            };
        }
        let omega = (2.0 / PREDICTED_SLOPE_STEP_S * half.min(1.0).asin()).clamp(slow, quick);
        Sines {
            omega,
            peak: peak(omega),
        }
    }
    /// By how much a wave of this slope (a mean about its peak) with a push along it moves a drone, m.
    fn moves(&self, slope: f64, push: f64, friction: f64) -> f64 {
        let amplitude = self.peak * slope;
        let over = amplitude + push - friction;
        // A value that is not a number must not count as calm water.
        if over <= 0.0 {
            return 0.0;
        }
        4.5 * GRAVITY * over * over / (amplitude * self.omega * self.omega)
    }
}

/// Causes that move a standing drone, as slopes.
#[derive(Clone, Debug, PartialEq)]
pub struct Slopes {
    waves: Sines,
    /// Each predicted wave where it is steepest: slope about the mean, the push along it, its direction, and the spread of
    /// its prediction.
    predicted: Vec<(f64, f64, Vector2<f64>, f64)>,
    /// The steepest measured in each span, the newest first.
    measured: Vec<f64>,
    /// Acceleration by the wind.
    push: Vector2<f64>,
    gust: f64,
    /// The wind in flight; none of one with which an aligned drone is wholly blown along.
    in_flight: WindPush,
    /// Slope of trim and heel.
    trim: f64,
    /// Slope of the wind, trim and heel.
    bias: Vector2<f64>,
}

impl Slopes {
    /// By a forecast, predicted and measured.
    pub fn of(forecast: Option<&DeckForecast>, wind: &WindPush) -> Slopes {
        let push = wind.mean * (STANDING / GRAVITY);
        let slope = |s: &[i8; 2]| Vector2::new(f64::from(s[0]), f64::from(s[1])) * SLOPE_STEP;
        let predicted: Vec<Vector2<f64>> = forecast
            .map(|f| f.predicted_slopes.iter().map(slope).collect())
            .unwrap_or_default();
        let mean = predicted.iter().sum::<Vector2<f64>>() / predicted.len().max(1) as f64;
        let until_rest = (TIME_TO_REST_S / PREDICTED_SLOPE_STEP_S) as usize;
        let per_wave = (WAVE_S / PREDICTED_SLOPE_STEP_S) as usize;
        let bias = mean - push;
        let wave = |(k, slopes): (usize, &[Vector2<f64>])| {
            let steepest = slopes
                .iter()
                .map(|s| s - push)
                .fold(Vector2::zeros(), |a, b| if b.norm() > a.norm() { b } else { a });
            let along = steepest.try_normalize(0.0).unwrap_or_default();
            let sd = tilt_sd(forecast, WAVE_S * (k as f64 + 0.5));
            let pushed = bias.dot(&along);
            ((steepest.norm() - pushed).max(0.0), pushed, along, sd)
        };
        Slopes {
            waves: Sines::of(&predicted, &mean),
            predicted: predicted
                .get(..until_rest)
                .unwrap_or(&predicted)
                .chunks(per_wave)
                .enumerate()
                .map(wave)
                .collect(),
            measured: forecast
                .map(|f| f.slopes.iter().map(|s| f64::from(*s) * SLOPE_STEP).collect())
                .unwrap_or_default(),
            gust: wind.gust_sd * STANDING / GRAVITY,
            trim: mean.norm(),
            bias,
            push,
            in_flight: strong(wind),
        }
    }
    /// In a sea of which no single wave is predicted: the steepest slope of each window of [`SLOPE_WINDOW_S`], the newest
    /// first, about the mean slope `mean` (NED).
    pub fn in_sea(steepest: impl IntoIterator<Item = f64>, mean: Vector2<f64>, wind: &WindPush) -> Slopes {
        let push = wind.mean * (STANDING / GRAVITY);
        Slopes {
            predicted: Vec::new(),
            measured: steepest.into_iter().collect(),
            waves: Sines::of(&[], &mean),
            trim: mean.norm(),
            bias: mean - push,
            gust: wind.gust_sd * STANDING / GRAVITY,
            push,
            in_flight: strong(wind),
        }
    }
    /// That it stays within the edge: of the waves until it is at rest, and of those of the minute after, when it meets the deck
    /// so far upwind.
    fn stays(&self, friction: f64, edge_m: f64, upwind_m: f64) -> f64 {
        let (first, of_first) = self.until_rest(friction);
        let (after, of_after) = self.after(friction);
        let along = self.bias.try_normalize(0.0).unwrap_or_default();
        // Slopes are what holds a drone: it goes the other way.
        let waves = -(first + along * after);
        let blown = |gust_sds: f64| {
            let [met, slid] = self.blown_in(gust_sds * self.in_flight.gust_sd, 1.0, friction);
            let moved = (waves + self.downwind() * (met + slid - upwind_m)).norm();
            let sd = norm(&[of_first, of_after, SLIDE_SD * slid, MIN_SD]);
            below((edge_m - moved) / sd) - below((-edge_m - moved) / sd)
        };
        let within = over_gusts(blown);
        let again = self.holds_as_just_now(friction);
        // One that is no number stays none.
        if again < within { again } else { within }
    }
    /// Displacement by the waves until it is at rest, north and east, and its standard deviation, m.
    fn until_rest(&self, friction: f64) -> (Vector2<f64>, f64) {
        let (mut moved, mut variance) = (Vector2::zeros(), 0.0);
        if self.predicted.is_empty() {
            // While no wave is known the next group of waves is taken to be like the last.
            let (mean, sd) = match self.measured.as_slice() {
                [] => (0.0, 0.0),
                waves => moments(waves),
            };
            let along = self.bias.try_normalize(0.0).unwrap_or_default();
            let (by, of) = self.wave(friction, mean, self.bias.norm(), sd);
            let waves = TIME_TO_REST_S / WAVE_S;
            return (along * (by * waves), of * waves.sqrt());
        }
        for (slope, push, along, sd) in &self.predicted {
            let (by, of) = self.wave(friction, *slope, *push, *sd);
            moved += along * by;
            variance += of * of;
        }
        (moved, variance.sqrt())
    }
    /// Direction towards which a strong wind blows.
    fn downwind(&self) -> Vector2<f64> {
        self.in_flight.mean.try_normalize(0.0).unwrap_or_default()
    }
    /// Distance along it at which a drone that the plan leads to the centre comes to rest, in the mean of gusts and of
    /// waves to either side, m.
    fn blown(&self, friction: f64) -> f64 {
        let to = |side: f64, sds: f64| {
            let blown = self.blown_in(sds * self.in_flight.gust_sd, side, friction);
            blown.iter().sum::<f64>()
        };
        over_gusts(|sds| 0.5 * (to(1.0, sds) + to(-1.0, sds)))
    }
    /// Distances along the wind in a gust of `gust` (m/s²): to where it meets the deck, and from there on, m; the waves
    /// slope to leeward (`side` 1) or to windward (-1).
    fn blown_in(&self, gust: f64, side: f64, friction: f64) -> [f64; 2] {
        let mean = self.in_flight.mean.norm();
        if mean == 0.0 {
            return [0.0; 2];
        }
        let near = (TIME_TO_REST_S / WAVE_S / 2.0) as usize;
        let slope = match self.predicted.get(..near).unwrap_or(&self.predicted) {
            [] if self.measured.is_empty() => 0.0,
            [] => moments(&self.measured).0,
            waves => waves.iter().map(|(slope, ..)| slope).sum::<f64>() / waves.len() as f64,
        };
        // Trim and heel to leeward.
        let slope = side * slope - (self.bias + self.push).dot(&self.downwind());
        let wind = mean + gust;
        let met_mps = ALONG_PER_GUST_S * gust;
        let pushed = wind + GRAVITY * (slope - PRESSED * friction);
        let speed = larger(met_mps + PRESS_S * pushed, 0.0);
        let braked = larger(GRAVITY * (friction - slope) - STANDING * wind, 0.0);
        let pressed = 0.5 * PRESS_S * (larger(met_mps, 0.0) + speed);
        let slid = (0.5 * speed * speed / braked).min(SLIDES_S * speed);
        // Nothing slides: not a number where nothing brakes, either.
        let slid = if speed == 0.0 { 0.0 } else { pressed + slid };
        [PLACE_PER_GUST_S2 * gust, slid]
    }
    /// By how much a wave of this slope, which is known to `sd`, moves the drone, and how far that is off, m.
    fn wave(&self, friction: f64, slope: f64, push: f64, sd: f64) -> (f64, f64) {
        let sd = norm(&[sd, PEAK_SD * slope, self.gust, MIN_SD]);
        let moves = |k: f64| {
            self.waves
                .moves((slope + k * sd).clamp(0.0, f64::INFINITY), push, friction)
        };
        let (mut mean, mut square) = (0.0, 0.0);
        for (k, weight) in NODES {
            let by = moves(k);
            mean += weight * by;
            square += weight * by * by;
        }
        (mean, (square - mean * mean).max(0.0).sqrt())
    }
    /// A slope that was measured so lately does not overcome the friction when it comes again.
    fn holds_as_just_now(&self, friction: f64) -> f64 {
        let just_now = self.measured.iter().take((JUST_NOW_S / SLOPE_WINDOW_S) as usize);
        let again = just_now.copied().fold(0.0, f64::max) + self.push.norm();
        below((friction - again) / norm(&[self.gust, MIN_SD]))
    }
    /// By how much the waves of the minute after move it along the push, and how far that is off, m.
    fn after(&self, friction: f64) -> (f64, f64) {
        let windows = STAY_S / SLOPE_WINDOW_S / self.measured.len().max(1) as f64;
        let (mut mean, mut square) = (0.0, 0.0);
        let bias = self.bias.norm();
        for s in &self.measured {
            let [on, back] = [bias, -bias].map(|b| {
                self.waves
                    .moves((s - self.trim).clamp(0.0, f64::INFINITY), b, friction)
            });
            mean += windows * 0.5 * (on - back);
            square += windows * (0.25 * (on + back)).powi(2);
        }
        (mean, square.sqrt())
    }
}

/// A strong wind; none of another.
fn strong(wind: &WindPush) -> WindPush {
    if beyond_aligned(&wind.mean) > 0.0 {
        *wind
    } else {
        WindPush::default()
    }
}

/// The mean of what follows from a normal figure, which is given in standard deviations.
fn over_gusts(of: impl Fn(f64) -> f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in -GUSTS..=GUSTS {
        let sds = GUST_STEP * f64::from(k);
        let weight = (-0.5 * sds * sds).exp();
        sum += weight * of(sds);
        weights += weight;
    }
    sum / weights
}

/// Standard deviation of the tilt so far ahead, rad; that of a prediction some seconds ahead without a forecast of it.
fn tilt_sd(forecast: Option<&DeckForecast>, ahead_s: f64) -> f64 {
    let stage = forecast.and_then(|f| {
        let at = (ahead_s / f.step.secs().max(1e-3)) as usize;
        f.stages.get(at).or(f.stages.last())
    });
    stage.map_or(UNKNOWN_SD, |s| {
        norm(&s.euler_sd[..2]) * core::f64::consts::FRAC_1_SQRT_2
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Peaks of a sea whose slope has this standard deviation (Rayleigh), an ordinary one the newest.
    fn peaks(sd: f64) -> impl Iterator<Item = f64> {
        (0..60).map(move |k| {
            let p = (f64::from((k + 30) % 60) + 0.5) / 60.0;
            sd * (-2.0 * (1.0 - p).ln()).sqrt()
        })
    }

    #[test]
    fn staying_in_a_sea() {
        let stand = Stand {
            friction: 0.4,
            edge_m: 0.65,
        };
        let p = |slope_sd: f64, wind: f64| {
            let wind = WindPush {
                mean: Vector2::new(wind, 0.0),
                gust_sd: 0.0,
            };
            Staying::of(&Slopes::in_sea(peaks(slope_sd), Vector2::zeros(), &wind), &stand).probability
        };
        assert!(p(0.02, 0.0) > 0.99 && p(0.25, 0.0) < 0.5);
        assert!(p(f64::NAN, 0.0) < 1e-12 && p(0.02, f64::NAN) < 1e-12);
        let steeper = (1..12).map(|k| p(0.02 * f64::from(k), 0.0));
        assert!(steeper.clone().zip(steeper.skip(1)).all(|(a, b)| a >= b - 1e-9));
        // A wind that adds to it.
        assert!(p(0.08, 3.0) < p(0.08, 0.0));
    }

    /// The final displacement by waves and wind adds to the slide, and a list to leeward makes that longer.
    #[test]
    fn slide_and_drift_to_leeward() {
        let wind = WindPush {
            mean: Vector2::new(3.0, 0.0),
            gust_sd: 0.8,
        };
        let slopes = |list: f64| Slopes::in_sea(peaks(0.07), Vector2::new(list, 0.0), &wind);
        let drifts = slopes(0.0);
        assert!(drifts.after(0.4).0 + drifts.until_rest(0.4).0.norm() > 0.1);
        let [windward, centre, leeward] = [0.2, 0.0, -0.2].map(|aim| drifts.stays(0.4, 0.65, aim));
        assert!(
            windward > centre && centre > leeward,
            "{windward} {centre} {leeward}"
        );
        // The deck holds a drone to windward that lists to leeward.
        assert!(slopes(-0.05).blown(0.4) > slopes(0.0).blown(0.4) + 0.02);
        assert!(slopes(0.05).blown(0.4) < slopes(0.0).blown(0.4));
    }

    /// On a level deck a strong wind moves a drone on where it meets the deck, and far on a slippery one and in gusts.
    #[test]
    fn slide_in_a_strong_wind() {
        let slopes = |wind: f64, gust_sd: f64| {
            let mean = Vector2::new(0.0, wind);
            Slopes::in_sea(peaks(0.03), Vector2::zeros(), &WindPush { mean, gust_sd })
        };
        let blown = |wind: f64, gust_sd: f64, friction: f64| slopes(wind, gust_sd).blown(friction);
        assert_eq!(blown(1.0, 0.3, 0.4), 0.0);
        assert!(
            (0.02..0.1).contains(&blown(3.5, 0.0, 0.4)),
            "{}",
            blown(3.5, 0.0, 0.4)
        );
        assert!(blown(4.0, 0.0, 0.4) > 1.5 * blown(3.5, 0.0, 0.4));
        assert!(blown(3.0, 0.0, 0.2) > 2.0 * blown(3.0, 0.0, 0.4));
        // As far in the mean as 12 m/s moves one, and upwind of the centre by that.
        let gusty = slopes(3.8, 1.1);
        assert!((0.05..0.2).contains(&gusty.blown(0.4)), "{}", gusty.blown(0.4));
        let stand = Stand {
            friction: 0.4,
            edge_m: 0.65,
        };
        let of = Staying::of(&gusty, &stand);
        assert!(
            (of.meets - Vector2::new(0.0, -gusty.blown(0.4))).norm() < 1e-9,
            "{of:?}"
        );
        assert!(gusty.stays(0.4, 0.65, of.meets.norm()) > gusty.stays(0.4, 0.65, 0.0));
        let narrow = Stand { edge_m: 0.1, ..stand };
        assert!((Staying::of(&gusty, &narrow).meets.norm() - 0.05).abs() < 1e-9);
        let [none, far] = [f64::NAN, f64::INFINITY].map(|w| Staying::of(&slopes(w, 1.0), &stand));
        assert_eq!([none.probability, far.probability], [0.0; 2]);
        assert_eq!([none.meets, far.meets], [Vector2::zeros(); 2]);
    }

    #[test]
    fn holding_force_that_a_sea_needs() {
        let pair = (&DeckGeometry::default(), &DroneGeometry::default());
        let needed = |slope_sd: f64| {
            let slopes = Slopes::in_sea(peaks(slope_sd), Vector2::zeros(), &WindPush::default());
            (slopes.clone(), needed_hold_n(&slopes, pair, 0.4, 0.95))
        };
        assert_eq!(needed(0.01).1, Some(0.0));
        let (slopes, force) = needed(0.15);
        let force = force.unwrap();
        assert!(force > 5.0 && force < 100.0, "{force}");
        let stays = |hold_n: f64| {
            let deck = DeckGeometry { hold_n, ..*pair.0 };
            Staying::of(&slopes, &Stand::on(&deck, pair.1, 0.4)).probability
        };
        assert!(stays(force) >= 0.95 && stays(force - 1.0) < 0.95);
        assert_eq!(needed(f64::NAN).1, None);
    }
}

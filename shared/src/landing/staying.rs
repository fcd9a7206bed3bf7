//! Probability that a drone on the deck with stopped motors stays in place, given friction, slope, motion and wind.
//!
//! The feet hold while `|f_xy| <= mu |f_z|`, with the specific force `f` in the deck's axes (Coulomb): with the
//! apparent slope `s = f_xy / |f_z|` and the wind's acceleration `w` of a standing drone, `|s - w / g| <= mu`. Any
//! excess moves the drone, and it is lost when it reaches the edge. A wave is a sine of amplitude `A` and of the waves'
//! mean frequency `omega`, `A = m x / sin(x)`, `x = omega T / 2`, where `m` is the predicted or measured mean over the
//! second `T` about its peak. With a bias `b` (wind, trim and heel along the wave), a wave moves the drone by
//!
//! `d = 9/2 g (A + b - mu)+² / (A omega²)`
//!
//! (approximating the peak by a parabola, the drone breaks away `a` before it and stops `2 a` after it, `a² =
//! 2 (A + b - mu) / A`).
//!
//! - until a descending drone is at rest, the waves, one per [`WAVE_S`], have the predicted slopes and directions. Each
//!   slope is normally distributed; its variance is the sum of those of the predicted tilt, of a peak relative to its
//!   mean, and of the gusts;
//! - later there is no forecast. Waves like those of the last two minutes move the drone to and fro: per
//!   window by `(d(b) - d(-b)) / 2` on average, with the variance `((d(b) + d(-b)) / 4)²`.
//!
//! In a strong wind a drone does not come to rest at the contact point. With the mean wind acceleration in flight `m`
//! and a normally distributed gust `u`, it touches down `k_p u` further downwind at the speed `k_v u`. While its rotors
//! still carry a part of its weight it is accelerated by `w = m + u` to `v = k_v u + t_p (w + g s - p mu g)`; then
//! friction stops it:
//!
//! `x = k_p u + t_p (k_v u + v) / 2 + v² / (2 (g (mu - s) - c w))`, where the last term is at most `v t_w`,
//!
//! with negative speeds taken as 0, and without a slide if `v` is 0. The drone therefore aims upwind of the centre by
//! the mean of `x`, at most half way to the edge, and comes to rest about the centre.
//!
//! All results are averaged over the friction (Gauss-Hermite, three nodes) and the gusts.

use core::f64::consts::TAU;

use nalgebra::Vector2;

use super::{
    normal::{below, larger, norm},
    wind::{ALONG_PER_GUST_S, PLACE_PER_GUST_S2, WindPush, beyond_aligned},
};
use crate::{
    estimation::moments,
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    msg::{DeckForecast, PREDICTED_SLOPE_STEP_S, SLOPE_STEP, SLOPE_WINDOW_S},
};

/// Wind acceleration of a standing drone as a fraction of that in flight: half, because turning rotors have
/// as much drag as the body, and further reduced by the wind profile above water and deck.
const STANDING: f64 = 0.4;
/// Relative standard deviation of the friction over dry, wet and salty decks.
const FRICTION_SD: f64 = 0.15;
/// Nodes of an average over a standard normal variable, and their weights.
const NODES: [(f64, f64); 3] = [(-1.732, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732, 1.0 / 6.0)];
/// Relative standard deviation of a peak's slope.
const PEAK_SD: f64 = 0.3;
/// Averaging time of slopes, s.
const MEAN_S: f64 = 1.0;
/// Range of wave periods, s: no drone rides on a hull with faster motion, and slower waves act as a constant slope.
const PERIOD_S: [f64; 2] = [1.7, 12.0];
/// Assumed wave period without a prediction, s: peaks as high as those of the fastest waves, which last as long as
/// those of a boat's roll.
const UNKNOWN_PERIOD_S: f64 = 2.3;
/// Time from the start of a descent to rest on the deck, s: 4 to 6 s of descent, at rest 4 s later.
const TIME_TO_REST_S: f64 = 10.0;
/// Time between independent peaks of the slope, s: half a wave period.
const WAVE_S: f64 = 2.0;
/// Age below which a measured slope counts as predicted, s: a hull that has left a steep crest is likely to do so again.
const JUST_NOW_S: f64 = 4.0;
/// Standard deviation of the slope without a forecast: rms error of a prediction several seconds ahead.
const UNKNOWN_SD: f64 = 0.08;
/// Minimum standard deviation of any slope: resolution of the measurement, and roughness of the deck.
const MIN_SD: f64 = 0.02;
/// Time after the contact during which the rotors still produce lift, s, and fraction of the weight on the deck until then.
const PRESS_S: f64 = 0.2;
const PRESSED: f64 = 0.65;
/// Relative standard deviation of the length of a slide.
const SLIDE_SD: f64 = 0.4;
/// Gust samples on either side of the mean, and their spacing in standard deviations.
const GUSTS: i32 = 6;
const GUST_STEP: f64 = 0.5;
/// Time for which a steep slope exceeds the friction, s: half a wave.
const SLIDES_S: f64 = 1.0;
/// Time until the crew secures a landed drone, s.
const STAY_S: f64 = 60.0;

/// Prediction of whether a drone that lands now stays on the deck.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Staying {
    /// Probability that it stays.
    pub probability: f64,
    /// Touchdown target relative to the deck's centre, NED, m, from which the drone comes to rest about the centre.
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

/// Contact conditions of the feet.
#[derive(Clone, Copy, Debug)]
pub struct SupportPolygon {
    /// Coefficient of friction, including forces that hold the drone down in addition to its weight.
    pub friction: f64,
    /// Distance from the centre at which the first foot leaves the deck, m.
    pub edge_m: f64,
}

impl SupportPolygon {
    /// Conditions of a drone on this deck.
    pub fn on(deck: &DeckGeometry, drone: &DroneGeometry, friction: f64) -> SupportPolygon {
        let edge = |side_m: f64, span_m: f64| 0.5 * (side_m - span_m);
        SupportPolygon {
            friction: friction * (1.0 + deck.hold_n / (drone.mass_kg * GRAVITY)),
            edge_m: edge(deck.length_m, drone.feet_span_m[0]).min(edge(deck.width_m, drone.feet_span_m[1])),
        }
    }
}

const MAX_HOLD_N: u32 = 1000;

/// Smallest `hold_n` (whole newtons) that gives at least `probability` on these slopes; None above 1 kN.
pub fn needed_hold_n(
    slopes: &Slopes,
    (deck, drone): (&DeckGeometry, &DroneGeometry),
    friction: f64,
    probability: f64,
) -> Option<f64> {
    let stays = |hold: u32| {
        let hold_n = f64::from(hold);
        let support = SupportPolygon::on(&DeckGeometry { hold_n, ..*deck }, drone, friction);
        Staying::of(slopes, &support).probability >= probability
    };
    // The probability increases with the force: bisect.
    let mut small = 0;
    let mut enough = MAX_HOLD_N;
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
    /// Prediction from predicted and measured slopes and the wind; probability 0 if one of them is NaN.
    pub fn of(slopes: &Slopes, support: &SupportPolygon) -> Staying {
        let upwind_m = slopes.blown(support.friction).min(0.5 * support.edge_m);
        let given = |(sds, weight): (f64, f64)| {
            let friction = support.friction * (1.0 + FRICTION_SD * sds);
            weight * slopes.stays(friction, support.edge_m, upwind_m)
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

#[derive(Clone, Copy, Debug, PartialEq)]
struct Sines {
    omega: f64,
    /// Amplitude of a sine whose mean over [`MEAN_S`] about its peak is 1.
    peak: f64,
}

impl Sines {
    /// Waves with the slopes' mean frequency, `omega² = <s'²> / <s²>`; without waves [`UNKNOWN_PERIOD_S`].
    fn of(slopes: &[Vector2<f64>], mean: &Vector2<f64>) -> Sines {
        let changes = slopes.windows(2).map(|w| match w {
            [before, after] => (after - before).norm_squared(),
            _ => 0.0,
        });
        let square: f64 = slopes.iter().map(|s| (s - mean).norm_squared()).sum();
        // For a sampled sine: 4 sin²(omega dt / 2).
        let half = 0.5 * (changes.sum::<f64>() / square).sqrt();
        let [quick, slow] = PERIOD_S.map(|s| TAU / s);
        let peak = |omega: f64| {
            let x = 0.5 * omega * MEAN_S;
            x / x.sin()
        };
        // A slope below the message's resolution does not count as a wave.
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
    /// Displacement of a drone by a wave of this slope (mean about its peak) and bias along it, m.
    fn moves(&self, slope: f64, push: f64, friction: f64) -> f64 {
        let amplitude = self.peak * slope;
        let over = amplitude + push - friction;
        // A NaN must not pass for calm water.
        if over <= 0.0 {
            return 0.0;
        }
        4.5 * GRAVITY * over * over / (amplitude * self.omega * self.omega)
    }
}

/// Slopes and wind that move a standing drone.
#[derive(Clone, Debug, PartialEq)]
pub struct Slopes {
    waves: Sines,
    /// Steepest slope of each predicted wave: value about the mean, bias along it, direction, standard deviation.
    predicted: Vec<(f64, f64, Vector2<f64>, f64)>,
    /// Steepest measured slope in each window, newest first.
    measured: Vec<f64>,
    /// Wind acceleration of the standing drone.
    push: Vector2<f64>,
    gust: f64,
    /// Wind in flight; zero if an aligned drone accepts all of it as drift.
    in_flight: WindPush,
    /// Slope of trim and heel.
    trim: f64,
    /// Slope of wind, trim and heel.
    bias: Vector2<f64>,
}

impl Slopes {
    /// Predicted and measured slopes of a forecast.
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
    /// Slopes without predicted waves: the steepest in each window of [`SLOPE_WINDOW_S`], newest first, about `mean`.
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
    /// Probability that a drone touching down this far upwind stays within the edge, until rest and for a minute after.
    fn stays(&self, friction: f64, edge_m: f64, upwind_m: f64) -> f64 {
        let (first, of_first) = self.until_rest(friction);
        let (after, of_after) = self.after(friction);
        let along = self.bias.try_normalize(0.0).unwrap_or_default();
        // The slope is the force on the drone's feet; the drone moves the other way.
        let waves = -(first + along * after);
        let blown = |gust_sds: f64| {
            let [met, slid] = self.blown_in(gust_sds * self.in_flight.gust_sd, 1.0, friction);
            let moved = (waves + self.downwind() * (met + slid - upwind_m)).norm();
            let sd = norm(&[of_first, of_after, SLIDE_SD * slid, MIN_SD]);
            below((edge_m - moved) / sd) - below((-edge_m - moved) / sd)
        };
        let within = over_gusts(blown);
        let again = self.holds_as_just_now(friction);
        if again < within { again } else { within }
    }
    /// Displacement by the waves until the drone is at rest, north and east, and its standard deviation, m.
    fn until_rest(&self, friction: f64) -> (Vector2<f64>, f64) {
        let mut moved = Vector2::zeros();
        let mut variance = 0.0;
        if self.predicted.is_empty() {
            // Without identified waves, the next wave group is assumed to be like the last.
            let (mean, sd) = match self.measured.as_slice() {
                [] => (0.0, 0.0),
                waves => moments(waves),
            };
            let along = self.bias.try_normalize(0.0).unwrap_or_default();
            let (displacement, displacement_sd) = self.wave(friction, mean, self.bias.norm(), sd);
            let waves = TIME_TO_REST_S / WAVE_S;
            return (along * (displacement * waves), displacement_sd * waves.sqrt());
        }
        for (slope, push, along, sd) in &self.predicted {
            let (displacement, displacement_sd) = self.wave(friction, *slope, *push, *sd);
            moved += along * displacement;
            variance += displacement_sd * displacement_sd;
        }
        (moved, variance.sqrt())
    }
    fn downwind(&self) -> Vector2<f64> {
        self.in_flight.mean.try_normalize(0.0).unwrap_or_default()
    }
    /// Distance downwind at which a drone aimed at the centre comes to rest, averaged over gusts and waves, m.
    fn blown(&self, friction: f64) -> f64 {
        let to = |side: f64, sds: f64| {
            let blown = self.blown_in(sds * self.in_flight.gust_sd, side, friction);
            blown.iter().sum::<f64>()
        };
        over_gusts(|sds| 0.5 * (to(1.0, sds) + to(-1.0, sds)))
    }
    /// Distances downwind in a gust (m/s²), to the contact and then to rest, m. `side` is 1 for waves towards leeward.
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
        let slope = side * slope - (self.bias + self.push).dot(&self.downwind());
        let wind = mean + gust;
        let met_mps = ALONG_PER_GUST_S * gust;
        let pushed = wind + GRAVITY * (slope - PRESSED * friction);
        let speed = larger(met_mps + PRESS_S * pushed, 0.0);
        let braked = larger(GRAVITY * (friction - slope) - STANDING * wind, 0.0);
        let pressed = 0.5 * PRESS_S * (larger(met_mps, 0.0) + speed);
        let slid = (0.5 * speed * speed / braked).min(SLIDES_S * speed);
        // Without a slide; the formula would give NaN if nothing braked the drone.
        let slid = if speed == 0.0 { 0.0 } else { pressed + slid };
        [PLACE_PER_GUST_S2 * gust, slid]
    }
    /// Displacement by a wave of this slope with standard deviation `sd`, and its standard deviation, m.
    fn wave(&self, friction: f64, slope: f64, push: f64, sd: f64) -> (f64, f64) {
        let sd = norm(&[sd, PEAK_SD * slope, self.gust, MIN_SD]);
        let moves = |k: f64| {
            self.waves
                .moves((slope + k * sd).clamp(0.0, f64::INFINITY), push, friction)
        };
        let mut mean = 0.0;
        let mut square = 0.0;
        for (k, weight) in NODES {
            let by = moves(k);
            mean += weight * by;
            square += weight * by * by;
        }
        (mean, (square - mean * mean).max(0.0).sqrt())
    }
    /// Probability that a recently measured slope does not exceed the friction when it recurs.
    fn holds_as_just_now(&self, friction: f64) -> f64 {
        let just_now = self.measured.iter().take((JUST_NOW_S / SLOPE_WINDOW_S) as usize);
        let again = just_now.copied().fold(0.0, f64::max) + self.push.norm();
        below((friction - again) / norm(&[self.gust, MIN_SD]))
    }
    /// Displacement along the bias by the waves of the following minute, and its standard deviation, m.
    fn after(&self, friction: f64) -> (f64, f64) {
        let windows = STAY_S / SLOPE_WINDOW_S / self.measured.len().max(1) as f64;
        let mut mean = 0.0;
        let mut square = 0.0;
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

fn strong(wind: &WindPush) -> WindPush {
    if beyond_aligned(&wind.mean) > 0.0 {
        *wind
    } else {
        WindPush::default()
    }
}

/// Mean of a function of a standard normal variable.
fn over_gusts(value: impl Fn(f64) -> f64) -> f64 {
    let mut sum = 0.0;
    let mut weights = 0.0;
    for k in -GUSTS..=GUSTS {
        let sds = GUST_STEP * f64::from(k);
        let weight = (-0.5 * sds * sds).exp();
        sum += weight * value(sds);
        weights += weight;
    }
    sum / weights
}

/// Standard deviation of the tilt this far ahead, rad; a constant without a forecast.
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

    /// Peaks of a sea whose slope has this standard deviation (Rayleigh), starting with a typical one.
    fn peaks(sd: f64) -> impl Iterator<Item = f64> {
        (0..60).map(move |k| {
            let p = (f64::from((k + 30) % 60) + 0.5) / 60.0;
            sd * (-2.0 * (1.0 - p).ln()).sqrt()
        })
    }

    #[test]
    fn staying_in_a_sea() {
        let support = SupportPolygon {
            friction: 0.4,
            edge_m: 0.65,
        };
        let p = |slope_sd: f64, wind: f64| {
            let wind = WindPush {
                mean: Vector2::new(wind, 0.0),
                gust_sd: 0.0,
            };
            Staying::of(
                &Slopes::in_sea(peaks(slope_sd), Vector2::zeros(), &wind),
                &support,
            )
            .probability
        };
        assert!(p(0.02, 0.0) > 0.99 && p(0.25, 0.0) < 0.5);
        assert!(p(f64::NAN, 0.0) < 1e-12 && p(0.02, f64::NAN) < 1e-12);
        let steeper = (1..12).map(|k| p(0.02 * f64::from(k), 0.0));
        assert!(steeper.clone().zip(steeper.skip(1)).all(|(a, b)| a >= b - 1e-9));
        // Wind increases the slope.
        assert!(p(0.08, 3.0) < p(0.08, 0.0));
    }

    /// Displacements by waves and wind add up, and a list to leeward increases them.
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
        // The deck pushes a drone to windward if it lists to leeward.
        assert!(slopes(-0.05).blown(0.4) > slopes(0.0).blown(0.4) + 0.02);
        assert!(slopes(0.05).blown(0.4) < slopes(0.0).blown(0.4));
    }

    /// A strong wind moves a drone from its contact point, more so on a slippery deck and in gusts.
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
        // Mean displacement in 12 m/s, compensated by an upwind target.
        let gusty = slopes(3.8, 1.1);
        assert!((0.05..0.2).contains(&gusty.blown(0.4)), "{}", gusty.blown(0.4));
        let support = SupportPolygon {
            friction: 0.4,
            edge_m: 0.65,
        };
        let staying = Staying::of(&gusty, &support);
        assert!(
            (staying.meets - Vector2::new(0.0, -gusty.blown(0.4))).norm() < 1e-9,
            "{staying:?}"
        );
        assert!(gusty.stays(0.4, 0.65, staying.meets.norm()) > gusty.stays(0.4, 0.65, 0.0));
        let narrow = SupportPolygon {
            edge_m: 0.1,
            ..support
        };
        assert!((Staying::of(&gusty, &narrow).meets.norm() - 0.05).abs() < 1e-9);
        let [none, far] = [f64::NAN, f64::INFINITY].map(|w| Staying::of(&slopes(w, 1.0), &support));
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
            Staying::of(&slopes, &SupportPolygon::on(&deck, pair.1, 0.4)).probability
        };
        assert!(stays(force) >= 0.95 && stays(force - 1.0) < 0.95);
        assert_eq!(needed(f64::NAN).1, None);
    }
}

//! The probability that a drone that stands on the deck with its motors stopped stays there: friction, slope, motion and
//! wind.
//!
//! Feet hold while `|f_xy| <= mu |f_z|`, with the specific force `f` in the deck's axes (Coulomb): with the apparent slope
//! `s = f_xy / |f_z|`, averaged over a second, and the wind's acceleration `w` of a drone that stands,
//! `|s - w / g| <= mu`. Slope and gust are independent, and the friction is known to a part of it:
//!
//! - until a drone that descends now is at rest, each wave's steepest `|s - w / g|` is normal with the variance of the
//!   predicted tilt, of a peak over its second's mean and of the gusts, and each of [`WAVE_S`] is another draw;
//! - later no forecast reaches. In waves like those of the last two minutes feet slip now and then, to and fro. With the
//!   mean push `b = |mean(s) - w / g|` of trim, heel and wind a wave of the slope `s` moves the drone by
//!   `c = g t² / 2 (s + b - mu)+` one way and by `d = g t² / 2 (s - b - mu)+` back, for the time `t` of a peak: in a minute by
//!   `sum (c - d) / 2` in the mean, with the variance `sum ((c + d) / 4)²`.
//!
//! Both are averaged over the friction (Gauss and Hermite, three nodes).

use nalgebra::Vector2;

use super::normal::{below, norm};
use super::wind::WindPush;
use crate::estimation::moments;
use crate::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use crate::msg::{DeckForecast, PREDICTED_SLOPE_STEP_S, SLOPE_STEP, SLOPE_WINDOW_S};

/// Of the wind's acceleration in flight, a drone that stands with its rotors stopped has this part: half, since rotors that
/// turn have as much drag as the body, and less by the wind's profile above water and deck.
const STANDING: f64 = 0.4;
/// Standard deviation of the friction as a part of it: dry, wet and salt.
const FRICTION_SD: f64 = 0.15;
/// Its nodes, in standard deviations, and their weights.
const FRICTION_NODES: [(f64, f64); 3] = [(-1.732, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732, 1.0 / 6.0)];
/// Standard deviation of a peak's slope as a part of its second's mean.
const PEAK_SD: f64 = 0.3;
/// The peak of a quick wave for its mean over a second: a sine of 1.7 s. Of 589 landings on three foreign hulls at 0, 2 and
/// 7 m/s 76 slid overboard within a minute; of the 376 that a drift below 0.2 m permits 3 did. With 1.6 it permits 464,
/// and 19.
const PEAK: f64 = 2.0;
/// From the beginning of a descent to rest on the deck, s: down in 4 to 6 s, at rest 4 s later.
const TIME_TO_REST_S: f64 = 10.0;
/// Steepest slopes so far apart are independent, s: half of a wave's period.
const WAVE_S: f64 = 2.0;
/// A slope that was measured so lately counts as if it were predicted, s: a hull that leaves the water over a steep crest
/// does so again.
const JUST_NOW_S: f64 = 4.0;
/// The slope's spread without a forecast of it: the prediction is wrong by this (rms) some seconds ahead.
const UNKNOWN_SD: f64 = 0.08;
/// The spread that any slope has: the measured ones' step, and the deck's roughness.
const LEAST_SD: f64 = 0.02;
/// Time of a slope's peak, s: a second's mean does not resolve it.
const PEAK_TIME_S: f64 = 0.5;
/// Time for which a landed drone has to stay without a hand that holds it, s.
const STAY_S: f64 = 60.0;

/// Whether a drone that lands now will stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Staying {
    /// How likely it stays.
    pub probability: f64,
}

impl Default for Staying {
    fn default() -> Self {
        Staying { probability: 1.0 }
    }
}

/// Feet on a deck.
#[derive(Clone, Copy, Debug)]
pub struct Stand {
    /// Coefficient of friction; what holds the drone down beside its weight counts in it.
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
    /// Probability by the slopes, predicted and measured, and the wind; 0 of slopes that are no numbers.
    pub fn of(slopes: &Slopes, stand: &Stand) -> Staying {
        if !slopes.are_finite() {
            return Staying { probability: 0.0 };
        }
        let given = |(sds, weight): (f64, f64)| {
            let friction = stand.friction * (1.0 + FRICTION_SD * sds);
            weight * slopes.hold(friction) * slopes.keep(friction, stand.edge_m)
        };
        Staying {
            probability: FRICTION_NODES.into_iter().map(given).sum(),
        }
    }
}

/// What moves a drone that stands, as slopes.
#[derive(Clone, Debug, PartialEq)]
pub struct Slopes {
    /// Steepest of each predicted wave with the wind, and the spread of its prediction.
    predicted: Vec<(f64, f64)>,
    /// The steepest measured in each span, the newest first.
    measured: Vec<f64>,
    /// Of the wind.
    push: Vector2<f64>,
    gust: f64,
    /// Of the wind, trim and heel.
    bias: f64,
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
        let wave = |(k, slopes): (usize, &[Vector2<f64>])| {
            let steepest = slopes.iter().map(|s| (s - push).norm()).fold(0.0, f64::max);
            (steepest, tilt_sd(forecast, WAVE_S * (k as f64 + 0.5)))
        };
        Slopes {
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
            bias: (mean - push).norm(),
            gust: wind.gust_sd * STANDING / GRAVITY,
            push,
        }
    }
    /// In a sea of which no single wave is predicted: the steepest slope of each window of [`SLOPE_WINDOW_S`], the newest
    /// first, about the mean slope `mean` (NED).
    pub fn in_sea(steepest: impl IntoIterator<Item = f64>, mean: Vector2<f64>, wind: &WindPush) -> Slopes {
        let push = wind.mean * (STANDING / GRAVITY);
        Slopes {
            predicted: Vec::new(),
            measured: steepest.into_iter().collect(),
            bias: (mean - push).norm(),
            gust: wind.gust_sd * STANDING / GRAVITY,
            push,
        }
    }
    /// A comparison with a figure that is no number would leave it out.
    fn are_finite(&self) -> bool {
        let predicted = self.predicted.iter().flat_map(|(slope, sd)| [slope, sd]);
        let all = predicted.chain(&self.measured).chain(&self.push);
        all.chain([&self.gust, &self.bias]).all(|v| v.is_finite())
    }
    /// That a wave of this slope, which is known to `sd`, does not overcome the friction.
    fn holds(&self, friction: f64, slope: f64, sd: f64) -> f64 {
        below((friction - slope) / norm(&[sd, PEAK_SD * slope, self.gust, LEAST_SD]))
    }
    /// That nothing moves the drone before it is at rest.
    fn hold(&self, friction: f64) -> f64 {
        let until_rest = if self.predicted.is_empty() {
            // While no wave is known the next group of waves is taken to be like the last.
            let (mean, sd) = match self.measured.as_slice() {
                [] => (0.0, 0.0),
                waves => moments(waves),
            };
            self.holds(friction, mean + self.push.norm(), sd)
                .powf(TIME_TO_REST_S / WAVE_S)
        } else {
            let waves = self.predicted.iter();
            waves
                .map(|(slope, sd)| self.holds(friction, *slope, *sd))
                .product()
        };
        let just_now = self.measured.iter().take((JUST_NOW_S / SLOPE_WINDOW_S) as usize);
        let again = just_now.copied().fold(0.0, f64::max) + self.push.norm();
        until_rest.min(below((friction - again) / norm(&[self.gust, LEAST_SD])))
    }
    /// That it keeps within the edge in the minute after.
    fn keep(&self, friction: f64, edge_m: f64) -> f64 {
        let peak = 0.5 * GRAVITY * PEAK_TIME_S * PEAK_TIME_S;
        let slips = |s: f64| peak * (s - friction).max(0.0);
        let windows = STAY_S / SLOPE_WINDOW_S / self.measured.len().max(1) as f64;
        let (mut mean, mut square) = (0.0, 0.0);
        for s in &self.measured {
            let (on, back) = (slips(PEAK * s + self.bias), slips(PEAK * s - self.bias));
            mean += windows * 0.5 * (on - back);
            square += windows * (0.25 * (on + back)).powi(2);
        }
        let sd = norm(&[square.sqrt(), LEAST_SD]);
        below((edge_m - mean) / sd) - below((-edge_m - mean) / sd)
    }
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

//! The probability that a drone that stands on the deck with its motors stopped stays there: friction, slope, motion and
//! wind.
//!
//! Feet hold while `|f_xy| <= mu |f_z|`, with the specific force `f` in the deck's axes (Coulomb): with the apparent slope
//! `s = f_xy / |f_z|`, averaged over a second, and the wind's acceleration `w` of a drone that stands,
//! `|s - w / g| <= mu`. Slope and gust are independent:
//!
//! - until a drone that descends now is at rest, each wave's steepest `|s - w / g|` is normal with the variance of the
//!   predicted tilt and of the gusts, and each of [`WAVE_S`] is another draw;
//! - later no forecast reaches. In waves like those of the last two minutes feet slip now and then, to either side alike
//!   as long as there is no wind; a wind adds to one side and takes from the other, and the drone drifts. Each wave of
//!   the slope `s` moves it by `(g t² / 2) ((s + w/g - mu)+ - (s - w/g - mu)+) / 2` for the time `t` of a peak. Slips that
//!   come one after the other at random bring it `D` far in the mean and over an edge `e` away with `exp(-e / D)`.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{DeckForecast, PREDICTED_SLOPE_STEP_S, SLOPE_STEP, SLOPE_WINDOW_S};
use nalgebra::Vector2;

use super::odds::{below, norm};
use super::wind::WindMonitor;

/// Of the wind's acceleration in flight, a drone that stands with its rotors stopped has this part: it has no rotors' drag,
/// and stands lower in the wind's profile and in the deck's boundary layer.
const STANDING: f64 = 0.5;
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
/// The slope's spread where no forecast tells of it: the prediction is wrong by this (rms) some seconds ahead.
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

impl Staying {
    /// By the forecast's slopes, predicted and measured, the deck's steepest apparent slope recently and the wind.
    pub fn of(
        forecast: Option<&DeckForecast>,
        recent_slope: f64,
        wind: &WindMonitor,
        stand: &Stand,
    ) -> Staying {
        let push = wind.mean() * (STANDING / GRAVITY);
        let gust = wind.gust_sd() * STANDING / GRAVITY;
        let holds = |slope: f64, sd: f64| below((stand.friction - slope) / norm(&[sd, gust, LEAST_SD]));
        let measured: Vec<f64> = forecast
            .map(|f| f.slopes.iter().map(|s| f64::from(*s) * SLOPE_STEP).collect())
            .unwrap_or_default();
        let waves = TIME_TO_REST_S / WAVE_S;
        let until_rest = match forecast.filter(|f| !f.predicted_slopes.is_empty()) {
            Some(f) => predicted(f, &push, &holds),
            // While no wave is known the next group of waves is taken to be like the last.
            None => {
                let (mean, sd) = moments(&measured);
                holds(mean + push.norm(), sd).powf(waves)
            }
        };
        let just_now = measured
            .iter()
            .take((JUST_NOW_S / SLOPE_WINDOW_S) as usize)
            .fold(recent_slope, |a, b| a.max(*b));
        let again = holds(just_now + push.norm(), 0.0);
        let drift_m = drift_m(&measured, push.norm(), stand.friction);
        let stays = 1.0 - (-stand.edge_m.max(0.0) / drift_m.max(1e-9)).exp();
        Staying {
            probability: until_rest.min(again) * stays,
        }
    }
}

/// That none of the predicted waves overcomes the friction.
fn predicted(f: &DeckForecast, push: &Vector2<f64>, holds: &impl Fn(f64, f64) -> f64) -> f64 {
    let per_wave = (WAVE_S / PREDICTED_SLOPE_STEP_S) as usize;
    let slopes: Vec<f64> = f
        .predicted_slopes
        .iter()
        .take((TIME_TO_REST_S / PREDICTED_SLOPE_STEP_S) as usize)
        .map(|[north, east]| (Vector2::new(f64::from(*north), f64::from(*east)) * SLOPE_STEP - push).norm())
        .collect();
    let sd = |ahead_s: f64| {
        let at = (ahead_s / f.step.secs().max(1e-3)) as usize;
        let stage = f.stages.get(at).or(f.stages.last());
        stage.map_or(UNKNOWN_SD, |s| {
            norm(&s.euler_sd[..2]) * core::f64::consts::FRAC_1_SQRT_2
        })
    };
    let wave = |(k, slopes): (usize, &[f64])| {
        let steepest = slopes.iter().copied().fold(0.0, f64::max);
        holds(steepest, sd(WAVE_S * (k as f64 + 0.5)))
    };
    slopes.chunks(per_wave).enumerate().map(wave).product()
}

/// Mean and standard deviation; 0 of none.
fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, square.sqrt())
}

/// How far waves like the measured ones and a push move a drone in the minute after, m.
fn drift_m(measured: &[f64], push: f64, friction: f64) -> f64 {
    let slips = |s: f64| (s - friction).max(0.0);
    let way = |s: &f64| 0.5 * (slips(PEAK * s + push) - slips(PEAK * s - push));
    let windows = STAY_S / SLOPE_WINDOW_S / measured.len().max(1) as f64;
    let peak = 0.5 * GRAVITY * PEAK_TIME_S * PEAK_TIME_S;
    peak * windows * measured.iter().map(way).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least probability of the shipped configuration.
    fn likely(p: f64) -> bool {
        p >= super::super::MissionConfig::default().min_probability
    }
    fn of(predicted: &[i8], measured: &[u8], wind_mps2: f64) -> f64 {
        let mut f = DeckForecast::default();
        for s in predicted {
            // Across the wind's push, which adds to it.
            f.predicted_slopes.push([-*s, 0]).unwrap();
        }
        measured.iter().for_each(|s| f.slopes.push(*s).unwrap());
        let stand = Stand {
            friction: 0.4,
            edge_m: 0.65,
        };
        Staying::of(Some(&f), 0.1, &WindMonitor::steady(wind_mps2), &stand).probability
    }

    #[test]
    fn probability_of_staying_by_slope_and_wind() {
        assert!(of(&[], &[], 0.0) > 0.999);
        assert!(likely(of(&[10; 48], &[10; 60], 0.5)));
        assert!(!likely(of(&[26; 48], &[10; 60], 0.0)));
        // A steep wave after the drone has come to rest is another landing's.
        let mut late = [10; 48];
        late[45] = 60;
        assert!(likely(of(&late, &[10; 60], 0.0)));
        // Slope and wind, each of which it would bear alone.
        assert!(!likely(of(&[16; 48], &[10; 60], 2.0)));
        assert!(likely(of(&[16; 48], &[10; 60], 0.0)) && likely(of(&[2; 48], &[2; 60], 2.0)));
        // The same with the wind is borne.
        assert!(of(&[-16; 48], &[10; 60], 2.0) > of(&[16; 48], &[10; 60], 2.0) + 0.05);
        assert!(!likely(of(&[], &[], 7.0)));
    }

    #[test]
    fn slope_measured_a_moment_ago() {
        let mut waves = [10; 60];
        waves[1] = 45;
        assert!(!likely(of(&[10; 48], &waves, 0.0)));
        waves.swap(1, 10);
        assert!(likely(of(&[10; 48], &waves, 0.0)));
    }

    #[test]
    fn drift_by_waves_and_wind_together() {
        // Waves that slip it to either side alike, and the own wind of a vessel at 7 m/s.
        let mut waves = [30; 60];
        (waves[0], waves[1]) = (5, 5);
        assert!(likely(of(&[10; 48], &waves, 0.0)));
        assert!(!likely(of(&[5; 48], &waves, 2.0)) && likely(of(&[5; 48], &[10; 60], 2.0)));
    }

    #[test]
    fn probability_that_is_no_number_is_not_likely() {
        let stand = Stand {
            friction: f64::NAN,
            edge_m: 0.65,
        };
        let p = Staying::of(None, 0.1, &WindMonitor::default(), &stand).probability;
        assert!(!likely(p));
    }
}

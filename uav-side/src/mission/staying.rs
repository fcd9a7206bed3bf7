//! Whether a drone that stands on the deck with its motors stopped will stay there: friction, slope, motion and wind.
//!
//! Feet hold while `|f_xy| <= mu |f_z|`, with the specific force `f` in the deck's axes, wind included (Coulomb). The
//! vessel and the forecast state its first part as the apparent slope `s = |f_xy| / |f_z|`, averaged over a second. With
//! the wind's acceleration `w`:
//!
//! - until a drone that descends now is at rest, the friction used `u = (s + w / g) / mu` has to stay below one;
//! - later no forecast reaches. In waves like those of the last two minutes feet slip now and then, to either side alike
//!   as long as there is no wind; a wind adds to one side and takes from the other, and the drone drifts. Each wave of
//!   the slope `s` moves it by `(g t² / 2) ((s + w/g - mu)+ - (s - w/g - mu)+) / 2` for the time `t` of a peak.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{
    DeckForecast, PREDICTED_SLOPE_STEP_S, Reason, ReasonCode, SLOPE_STEP, SLOPE_WINDOW_S,
};

use super::limits::exceeds;
use super::wind::WindMonitor;

/// The slope that has to be expected for one that is predicted: the prediction is wrong by 0.08 (rms) some seconds ahead.
const EXPECTED: f64 = 1.6;
/// The peak of a quick wave for its mean over a second: a sine of 1.7 s. Of 589 landings on three foreign hulls at 0, 2 and
/// 7 m/s 76 slid overboard within a minute; of the 376 that the drift below permits 3 did. With 1.6 it permits 464, and 19.
const PEAK: f64 = 2.0;
/// From the beginning of a descent to rest on the deck, s: down in 4 to 6 s, at rest 4 s later.
const TIME_TO_REST_S: f64 = 10.0;
/// A slope that was measured so lately counts as if it were predicted, s: a hull that leaves the water over a steep crest
/// does so again.
const JUST_NOW_S: f64 = 4.0;
/// Time of a slope's peak, s: a second's mean does not resolve it.
const PEAK_TIME_S: f64 = 0.5;
/// Time for which a landed drone has to stay without a hand that holds it, s.
const STAY_S: f64 = 60.0;
/// Drift in that time that is permitted, m: a quarter of the way from the centre to the edge of the smallest deck.
const MAX_DRIFT_M: f64 = 0.2;

/// Whether a drone that lands now will stay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Staying {
    /// Greatest part of the friction used until it is at rest; 0 while nothing is known.
    pub used: f64,
    /// How far it drifts in the minute after, m.
    pub drift_m: f64,
}

impl Staying {
    /// By the forecast's slopes, predicted and measured, the deck's steepest tilt recently (rad) and the wind, on feet with
    /// the coefficient of `friction`.
    pub fn of(
        forecast: Option<&DeckForecast>,
        recent_tilt_rad: f64,
        wind: &WindMonitor,
        friction: f64,
    ) -> Staying {
        let slope = |s: &u8| f64::from(*s) * SLOPE_STEP;
        let steepest = |s: &[u8]| s.iter().map(slope).fold(0.0, f64::max);
        let (predicted, measured) =
            forecast.map_or((&[][..], &[][..]), |f| (&f.predicted_slopes[..], &f.slopes[..]));
        let first = |slopes: &[u8], span_s: f64, step_s: f64| {
            steepest(slopes.get(..(span_s / step_s) as usize + 1).unwrap_or(slopes))
        };
        // While no wave is known the next group of waves is taken to be like the last.
        let ahead = if predicted.is_empty() {
            steepest(measured)
        } else {
            let before = first(measured, JUST_NOW_S - SLOPE_WINDOW_S, SLOPE_WINDOW_S);
            before.max(EXPECTED * first(predicted, TIME_TO_REST_S, PREDICTED_SLOPE_STEP_S))
        };
        let mean = wind.mean() / GRAVITY;
        let slips = |s: f64| (s - friction).max(0.0);
        let way = |s: &u8| 0.5 * (slips(PEAK * slope(s) + mean) - slips(PEAK * slope(s) - mean));
        let windows = STAY_S / SLOPE_WINDOW_S / measured.len().max(1) as f64;
        let peak = 0.5 * GRAVITY * PEAK_TIME_S * PEAK_TIME_S;
        // On a deck that rocks faster than the waves a second's mean tells of no slope.
        let ahead = ahead.max(recent_tilt_rad.tan());
        Staying {
            used: (ahead + wind.peak() / GRAVITY) / friction,
            drift_m: peak * windows * measured.iter().map(way).sum::<f64>(),
        }
    }

    /// Why no descent may begin.
    pub fn rejection(&self) -> Option<Reason> {
        exceeds(ReasonCode::SlidePredicted, self.used, 1.0)
            .or_else(|| exceeds(ReasonCode::DriftPredicted, self.drift_m, MAX_DRIFT_M))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn staying(predicted: &[u8], measured: &[u8], wind_mps2: f64) -> Staying {
        let mut f = DeckForecast::default();
        predicted
            .iter()
            .for_each(|s| f.predicted_slopes.push(*s).unwrap());
        measured.iter().for_each(|s| f.slopes.push(*s).unwrap());
        Staying::of(Some(&f), 0.1, &WindMonitor::steady(wind_mps2), 0.4)
    }
    fn rejected(predicted: &[u8], measured: &[u8], wind_mps2: f64) -> Option<ReasonCode> {
        staying(predicted, measured, wind_mps2)
            .rejection()
            .map(|r| r.code)
    }
    const SLIDES: Option<ReasonCode> = Some(ReasonCode::SlidePredicted);
    const DRIFTS: Option<ReasonCode> = Some(ReasonCode::DriftPredicted);

    #[test]
    fn drone_stays_on_a_deck_whose_predicted_slope_and_wind_use_less_than_its_friction() {
        assert_eq!(rejected(&[], &[], 0.0), None);
        assert_eq!(rejected(&[10; 48], &[10; 60], 0.5), None);
        assert_eq!(rejected(&[26; 48], &[10; 60], 0.0), SLIDES);
        // A steep wave after the drone has come to rest is another landing's.
        let mut late = [10; 48];
        late[45] = 60;
        assert_eq!(rejected(&late, &[10; 60], 0.0), None);
        // Slope and wind, each of which it would bear alone.
        assert_eq!(rejected(&[15; 48], &[10; 60], 2.0), SLIDES);
        assert_eq!(rejected(&[15; 48], &[10; 60], 0.0), None);
        assert_eq!(rejected(&[], &[], 2.0), None);
        assert_eq!(rejected(&[], &[], 3.6), SLIDES);
        let rocks = Staying::of(None, 0.41, &WindMonitor::default(), 0.4);
        assert_eq!(rocks.rejection().map(|r| r.code), SLIDES);
    }

    #[test]
    fn slope_measured_a_moment_ago_counts_although_none_was_predicted() {
        let mut waves = [10; 60];
        waves[1] = 45;
        assert_eq!(rejected(&[10; 48], &waves, 0.0), SLIDES);
        waves.swap(1, 10);
        assert_eq!(rejected(&[10; 48], &waves, 0.0), None);
        // While no wave is known, each of the last two minutes does.
        assert_eq!(rejected(&[], &waves, 0.0), SLIDES);
    }

    #[test]
    fn drone_drifts_where_waves_and_wind_together_overcome_its_friction() {
        // Waves that slip it to either side alike, and the own wind of a vessel at 7 m/s.
        let mut waves = [30; 60];
        (waves[0], waves[1]) = (5, 5);
        assert!(staying(&[10; 48], &waves, 0.0).drift_m < 1e-9);
        assert_eq!(rejected(&[5; 48], &waves, 1.4), DRIFTS);
        assert_eq!(rejected(&[5; 48], &[10; 60], 1.4), None);
    }

    #[test]
    fn drone_does_not_stay_by_figures_that_are_none() {
        let unknown = Staying {
            used: f64::NAN,
            drift_m: 0.0,
        };
        assert!(unknown.rejection().is_some());
    }
}

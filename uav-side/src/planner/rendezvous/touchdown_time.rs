//! Selects a reachable time at which the deck is nearly level, rotates slowly and accelerates like an aligned drone.

use alight_shared::{
    geometry::GRAVITY,
    msg::{DeckForecast, DeckStage},
    time::{DroneClock, Span, Time},
};
use nalgebra::{Vector2, Vector3};

use super::config::TouchdownTimeConfig;
use crate::flatness::aligned_acceleration;

/// Spacing of the candidates, s.
const GRID_S: f64 = 0.1;
/// Maximum number of candidates: a window of 4 s.
const MAX_CANDIDATES: usize = 41;

/// Expected cost of touching this deck in `wind` (m/s²), excluding the cost of waiting: `E[x²] = E[x]² + var x` of each
/// quantity, so that a poorly predicted time has the average cost.
pub fn expected_cost(deck: &DeckStage, wind: &Vector2<f64>, c: &TouchdownTimeConfig) -> f64 {
    let variance = |sd: &[f64]| sd.iter().map(|s| s * s).sum::<f64>();
    let tilt_var = variance(&deck.euler_sd[..2]);
    let a = Vector3::from(deck.acceleration).xy();
    let n = deck.normal();
    let mismatch = (a - aligned_acceleration(deck, &n) - wind).norm_squared()
        + variance(&deck.acceleration_sd[..2])
        + GRAVITY * GRAVITY * tilt_var;
    let tilt = n.x.hypot(n.y).min(1.0).asin().powi(2) + tilt_var;
    let [roll, pitch, _] = deck.euler_rates;
    let rate = roll * roll + pitch * pitch + variance(&deck.euler_rates_sd[..2]);
    // Half of the deviations of a velocity are upwards.
    let rising = (-deck.velocity[2]).max(0.0).powi(2) + 0.5 * variance(&deck.velocity_sd[2..]);
    let over = |square: f64, scale: f64| square / (scale * scale);
    over(mismatch, c.mismatch_mps2)
        + 0.5
            * (over(tilt, c.tilt_deg.to_radians())
                + over(rate, c.tilt_rate_dps.to_radians())
                + over(rising, c.rising_mps))
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TouchdownTime {
    at: Option<Time<DroneClock>>,
}

impl TouchdownTime {
    pub fn forget(&mut self) {
        self.at = None;
    }

    /// Time to contact (s); final from [`TouchdownTimeConfig::freeze_s`] before contact on. `min_time` is the earliest
    /// possible, `left` the profile's time at the current height. In a `flare` the drone does not wait.
    pub fn choose(
        &mut self,
        now: Time<DroneClock>,
        forecast: &DeckForecast,
        wind: &Vector2<f64>,
        min_time: f64,
        left: f64,
        flare: bool,
        c: &TouchdownTimeConfig,
    ) -> f64 {
        let end = forecast.header.at + forecast.step * (forecast.stages.len() as i64 - 1);
        let price = |t: Time<DroneClock>| {
            // Times beyond the forecast have the cost of its last stage.
            let deck = forecast.at(t.min(end).max(forecast.header.at))?;
            Some(expected_cost(&deck, wind, c) + c.waiting_per_s * (t - now).secs())
        };
        let earliest = now + Span::from_secs(min_time);
        let old = self.at;
        let frozen = old.is_some_and(|t| (t - now).secs() < c.freeze_s);
        let mut chosen = match old {
            Some(t) => t,
            None => earliest,
        };
        if !frozen && min_time >= c.freeze_s {
            let mut best = price(chosen).unwrap_or(f64::INFINITY);
            if old.is_some() {
                best -= c.hysteresis;
            }
            let count = ((c.window_s / GRID_S) as usize).min(MAX_CANDIDATES);
            for k in 0..=count {
                let t = earliest + Span::from_secs(GRID_S * k as f64);
                if let Some(p) = price(t)
                    && p < best
                {
                    best = p;
                    chosen = t;
                }
            }
        }
        // A late drone descends slightly faster than the profile.
        let soonest = now + Span::from_secs((left - c.hurry_s * left.max(1.0)).max(-10.0));
        chosen = chosen.max(soonest);
        if flare {
            chosen = chosen.min(now + Span::from_secs(left + c.linger_s));
        }
        self.at = Some(chosen);
        (chosen - now).secs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header};

    const STILL: Vector2<f64> = Vector2::new(0.0, 0.0);

    fn rocking(phase: f64) -> DeckForecast {
        forecast(header(0, Time::EPOCH), |t| {
            let (s, c) = (1.3 * t + phase).sin_cos();
            DeckStage {
                euler: [0.15 * s, 0.0, 0.0],
                euler_rates: [0.15 * 1.3 * c, 0.0, 0.0],
                ..DeckStage::default()
            }
        })
    }

    #[test]
    fn touchdown_time_on_a_level_deck() {
        let c = TouchdownTimeConfig {
            waiting_per_s: 0.0,
            tilt_rate_dps: 100.0,
            ..TouchdownTimeConfig::default()
        };
        let f = rocking(0.0);
        let mut i = TouchdownTime::default();
        // The deck is level at pi / 1.3 = 2.42 s.
        let t = i.choose(Time::EPOCH, &f, &STILL, 1.5, 1.5, false, &c);
        assert!((t - 2.42).abs() < 0.1, "{t}");
        // The final choice is kept although the forecast has changed.
        let now = Time::from_secs(1.5);
        let later = i.choose(now, &rocking(1.0), &STILL, 0.8, 0.8, false, &c);
        assert!((later + 1.5 - t).abs() < 1e-9, "{later}");
        // A delay of half a second postpones the contact by less, because a late drone descends faster.
        let late = i.choose(now, &f, &STILL, 1.5, 1.5, false, &c);
        assert!((late - 1.275).abs() < 1e-6, "{late}");
        // An early drone that is low above the deck does not wait.
        let early = i.choose(now, &f, &STILL, 0.3, 0.3, true, &c);
        assert!((early - 0.3 - c.linger_s).abs() < 1e-6, "{early}");
    }

    #[test]
    fn touchdown_time_and_waiting() {
        let c = TouchdownTimeConfig {
            waiting_per_s: 1e3,
            ..TouchdownTimeConfig::default()
        };
        let t = TouchdownTime::default().choose(Time::EPOCH, &rocking(0.7), &STILL, 1.6, 1.6, false, &c);
        assert!((t - 1.6).abs() < 1e-9);
    }

    #[test]
    fn touchdown_time_with_a_deck_level_on_average() {
        let c = TouchdownTimeConfig::default();
        let ahead = |spread: f64| {
            let f = forecast(header(0, Time::EPOCH), |t| {
                // The forecast decays to the mean, and its spread increases.
                let known = (-t / 2.0).exp();
                DeckStage {
                    euler: [0.15 * known, 0.0, 0.0],
                    euler_sd: [spread * (1.0 - known * known).sqrt(); 3],
                    ..DeckStage::default()
                }
            });
            TouchdownTime::default().choose(Time::EPOCH, &f, &STILL, 1.5, 1.5, false, &c)
        };
        assert!(ahead(0.0) > 3.0, "{}", ahead(0.0));
        assert!(ahead(0.15) < 1.6, "{}", ahead(0.15));
    }

    #[test]
    fn touchdown_cost_of_acceleration_down_the_slope() {
        // The slope of the water corresponds to its acceleration: a = g tan(tilt).
        let mut d = DeckStage {
            euler: [0.1, 0.0, 0.0],
            ..DeckStage::default()
        };
        let a = aligned_acceleration(&d, &d.normal());
        assert!((a.norm() - GRAVITY * 0.1_f64.tan()).abs() < 1e-9);
        let c = TouchdownTimeConfig {
            tilt_deg: 90.0,
            ..TouchdownTimeConfig::default()
        };
        let stuck = expected_cost(&d, &STILL, &c);
        d.acceleration = [a.x, a.y, 0.0];
        assert!(expected_cost(&d, &STILL, &c) < 0.01 && stuck > 1.0);
        // In wind a level deck also accelerates relative to an aligned drone.
        let level = DeckStage {
            acceleration: [0.8, 0.0, 0.0],
            ..DeckStage::default()
        };
        let wind = Vector2::new(0.8, 0.0);
        assert!(expected_cost(&level, &wind, &c) < 1e-9 && expected_cost(&level, &STILL, &c) > 1.0);
    }
}

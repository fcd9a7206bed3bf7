//! Probabilities of a safe contact. Each quantity is normally distributed about its prediction, with the
//! variance that control can no longer reduce.
//!
//! | quantity | mean | standard deviations |
//! |---|---|---|
//! | onto the deck, m/s | `sqrt(v² + 2 a_b h_f)` | the pilot's, `1.3 u_z` |
//! | along it, m/s | `v_t + v_l` | the pilot's, `u_xy`, gusts, `t_a m`, half of the turn's `v_t` |
//! | horizontal thrust, m/s² | that against the wind | a tenth of its limit |
//! | angle, rad | the bank against a strong wind at the contact | the pilot's, `sd(tilt)`, gusts, `k_a w_s / g` |
//! | place, m | the present offset that remains | the pilot's, the forecast's, drift without vision, gusts |
//!
//! with `u` the unforeseen speeds that the deck gains within the drone's reaction time, and `m` the part of the deck's
//! acceleration that an aligned drone does not follow. The part `w_s` (m/s²) of a strong wind (above 6 m/s) is
//! compensated by tilt until the drone aligns. The lowest foot meets the deck `h_f = k_f s w_s / g` before the others
//! (`s`: distance from their middle to each), while the drone still brakes with `a_b` and is not aligned yet.

use nalgebra::Vector2;

use super::{
    MAX_MPS, MAX_TILT_RAD,
    normal::{below, inside, norm},
    odds::Odds,
    wind::{PLACE_PER_GUST_S2, TILT_PER_GUST, WindPush, beyond_aligned, wind_during_alignment},
};
use crate::geometry::{DeckGeometry, DroneGeometry, GRAVITY};

/// Reaction time to unforeseen deck motion, s: 0.1 s to the thrust, 0.2 s to a change of the sink rate.
pub const REACTION_S: f64 = 0.3;
/// Usual contact speed, m/s.
pub const CONTACT_MPS: f64 = 0.33;
/// Standard deviation of the contact speed from drone and pilot alone, m/s.
const CONTACT_SD_MPS: f64 = 0.12;
/// Residual errors of pilot and drone in still air: speed along the deck, m/s, angle, rad, position, m.
const ALONG_SD_MPS: f64 = 0.07;
const TILT_SD_RAD: f64 = 0.6 * core::f64::consts::PI / 180.0;
const PLACE_SD_M: f64 = 0.03;
/// Duration of an alignment, s, during which unfollowed deck motion separates drone and deck.
const ALIGNMENT_S: f64 = 0.1;
/// Factor by which wave groups increase the deck's uncertainty between decision and contact.
const CHANGES: f64 = 1.3;
/// Standard deviation per axis of the unfinished part of a turn of `w_s / g`: fit to landings in 12 m/s, with the wind
/// at the deck's height.
const UNFINISHED: f64 = 0.18;
/// Speed along the deck at the contact per gust acceleration at the deck's height, m/s per m/s². Source: with [`UNFINISHED`]
/// from 89 contacts in 12 m/s.
const ALONG_PER_GUST_S: f64 = 0.25;
/// Twice the deceleration over the last half metre (2.5 m/s²) times the height of the feet's middle at first
/// contact, per `w_s`: 0.45 of half a span of 0.28 m over g; 48 landings begun at random moments in 12 m/s.
const FIRST_FOOT_M: f64 = 2.0 * 2.5 * 0.45 * 0.28 / GRAVITY;
/// Horizontal thrust per mass at the pilot's largest tilt (0.61 rad), m/s²: if vessel and wind need more, the
/// drone falls behind. Relative standard deviation of this limit, from mass and drag.
const MAX_THRUST_MPS2: f64 = 6.8;
const THRUST_SD: f64 = 0.1;
/// Drift of the odometry without vision of the deck, m/s.
const DRIFT_MPS: f64 = 0.05;
/// Time without vision before the contact, s.
pub const BLIND_S: f64 = 0.5;
/// Separation speed, m/s, of an aligned drone and a deck whose accelerations differ by `apart`, m/s².
pub fn alignment_mps(apart: f64) -> f64 {
    ALIGNMENT_S * apart
}

/// Margins of the feet: maximum offset of the drone's centre from the deck's, m, along both axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins(pub [f64; 2]);

impl Margins {
    /// Margins of this drone on this deck.
    pub fn on(deck: &DeckGeometry, drone: &DroneGeometry) -> Margins {
        Margins([
            0.5 * (deck.length_m - drone.feet_span_m[0]),
            0.5 * (deck.width_m - drone.feet_span_m[1]),
        ])
    }
}

/// Predicted contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Mean speed onto the deck, m/s.
    pub speed_mps: f64,
    /// Mean speed along the deck caused by the vessel's turn, m/s.
    pub turn_mps: f64,
    /// Remainder of the present speed along the deck, m/s.
    pub left_mps: f64,
    /// Standard deviation of the unforeseen deck speed gained within the reaction time, m/s: per horizontal axis, vertical.
    pub unforeseen_mps: [f64; 2],
    /// Separation speed of deck and aligned drone, m/s.
    pub parted_mps: f64,
    /// Standard deviation of the unforeseen tilt about one axis, rad.
    pub tilt_sd_rad: f64,
    /// Remaining offset from the deck's centre, forward and right, m.
    pub offset_m: Vector2<f64>,
    /// Standard deviation of the forecast position on one axis, m.
    pub place_sd_m: f64,
    /// Time without vision of the deck before the contact, s.
    pub blind_s: f64,
    /// Wind over the deck.
    pub wind: WindPush,
    /// Wind at the contact, predicted from the drone's present measurement.
    pub wind_at_contact: WindPush,
    /// Probability that the drone stays on the deck.
    pub stays: f64,
}

impl Contact {
    /// Probabilities of this contact on a deck with these margins.
    pub fn odds(&self, margins: &Margins) -> Odds {
        let steady = WindPush {
            gust_sd: 0.0,
            ..self.wind
        };
        let without = Contact {
            wind: steady,
            wind_at_contact: steady,
            ..*self
        };
        let odds = self.limits(margins);
        Odds {
            gusts: without.limits(margins).harm() < 0.5 * odds.harm(),
            ..odds
        }
    }
    fn limits(&self, margins: &Margins) -> Odds {
        let (wind, gust) = (self.wind.mean, self.wind.gust_sd);
        let slips = ALONG_PER_GUST_S * gust;
        let [horizontal, vertical] = self.unforeseen_mps;
        let turns = 0.5 * self.turn_mps;
        let along_sd = norm(&[ALONG_SD_MPS, horizontal, slips, self.parted_mps, turns]);
        let strong = beyond_aligned(&wind);
        let last = self.wind_at_contact;
        let unfinished = UNFINISHED * beyond_aligned(&last.mean) / GRAVITY;
        let tilt_sd = norm(&[
            TILT_SD_RAD,
            self.tilt_sd_rad,
            TILT_PER_GUST * last.gust_sd / GRAVITY,
            unfinished,
        ]);
        // The drone banks against the wind that would move an aligned drone too fast.
        let bank = (last.mean - wind_during_alignment(&last.mean)).norm() / GRAVITY;
        let follows = below((MAX_THRUST_MPS2 - wind.norm()) / (THRUST_SD * MAX_THRUST_MPS2));
        let speed = (self.speed_mps.powi(2) + FIRST_FOOT_M * strong).sqrt();
        Odds {
            hard: below((MAX_MPS - speed) / norm(&[CONTACT_SD_MPS, CHANGES * vertical])),
            fast: follows * inside(self.turn_mps + self.left_mps, along_sd, MAX_MPS),
            tilted: inside(bank, tilt_sd, MAX_TILT_RAD),
            outside: self.inside_edges(margins, PLACE_PER_GUST_S2 * gust),
            slides: self.stays,
            gusts: false,
            turns: self.turn_mps > horizontal.max(slips).max(self.parted_mps),
        }
    }
    fn inside_edges(&self, margins: &Margins, blown_m: f64) -> f64 {
        let sd = norm(&[PLACE_SD_M, self.place_sd_m, DRIFT_MPS * self.blind_s, blown_m]);
        let axis = |margin: f64, off: f64| below((margin - off) / sd) - below((-margin - off) / sd);
        let Margins([length, width]) = *margins;
        axis(length, self.offset_m.x) * axis(width, self.offset_m.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calm() -> Contact {
        Contact {
            speed_mps: CONTACT_MPS,
            turn_mps: 0.0,
            left_mps: 0.0,
            unforeseen_mps: [0.03, 0.05],
            parted_mps: 0.0,
            tilt_sd_rad: 0.01,
            offset_m: Vector2::zeros(),
            place_sd_m: 0.05,
            blind_s: BLIND_S,
            wind: WindPush::default(),
            wind_at_contact: WindPush::default(),
            stays: 1.0,
        }
    }

    /// A wind of 12 m/s accelerates a drone with usual drag by 3 to 4 m/s².
    #[test]
    fn odds_of_a_contact_in_strong_wind() {
        let margins = Margins::on(&DeckGeometry::default(), &DroneGeometry::default());
        let odds_in_wind = |push: f64| {
            let wind = WindPush {
                mean: Vector2::new(0.0, push),
                gust_sd: 0.3 * push,
            };
            Contact {
                wind,
                wind_at_contact: wind,
                ..calm()
            }
            .odds(&margins)
        };
        let [still, fresh, strong, gale] = [0.0, 1.2, 3.0, 4.3].map(odds_in_wind);
        assert!(fresh.tilted > 0.999 && fresh.hard == still.hard);
        assert!((0.95..0.97).contains(&strong.tilted), "{strong:?}");
        assert!((0.55..0.7).contains(&gale.tilted), "{gale:?}");
        // A foot that touches down while the drone still brakes makes the contact harder, but rarely too hard.
        assert!(gale.hard < strong.hard && gale.hard > 0.99, "{gale:?}");
        // 12 m/s is within the thrust of the largest tilt; 15 m/s, or 7 m/s against 8 m/s, is at its limit.
        assert!(gale.fast > 0.9 && odds_in_wind(6.8).fast < 0.5);
    }

    #[test]
    fn odds_of_a_contact_fall_with_each_error() {
        let margins = Margins::on(&DeckGeometry::default(), &DroneGeometry::default());
        let whole = |change: &dyn Fn(&mut Contact)| {
            let mut c = calm();
            change(&mut c);
            c.odds(&margins).whole()
        };
        assert!(whole(&|_| {}) > 0.98);
        let worse: [&dyn Fn(&mut Contact); 8] = [
            &|c| c.speed_mps = 0.9,
            &|c| c.turn_mps = 0.8,
            &|c| c.unforeseen_mps = [0.5, 0.05],
            &|c| c.unforeseen_mps = [0.03, 0.4],
            &|c| c.tilt_sd_rad = 0.1,
            &|c| c.offset_m.x = 1.0,
            &|c| c.wind.gust_sd = 2.5,
            &|c| c.stays = 0.5,
        ];
        for (k, change) in worse.iter().enumerate() {
            assert!(whole(change) < 0.95, "{k}");
        }
        let none: [&dyn Fn(&mut Contact); 9] = [
            &|c| c.place_sd_m = f64::NAN,
            &|c| c.speed_mps = f64::NAN,
            &|c| c.turn_mps = f64::NAN,
            &|c| c.left_mps = f64::NAN,
            &|c| c.unforeseen_mps = [f64::NAN, 0.05],
            &|c| c.parted_mps = f64::NAN,
            &|c| c.tilt_sd_rad = f64::NAN,
            &|c| c.wind.mean.x = f64::NAN,
            &|c| c.stays = f64::NAN,
        ];
        for (k, change) in none.iter().enumerate() {
            assert!(whole(change) < 1e-12, "{k}");
        }
    }
}

//! The probability that a landing which begins or goes on now succeeds.
//!
//! A good landing meets limits ([`super::odds::Limit`]): the speed onto the deck and along it, the angle between drone and deck, four
//! feet inside the edges, and staying where it stands. Each figure is taken as normal about what is predicted for the
//! contact, with the variance of everything that nobody can take back any more:
//!
//! | figure | mean | standard deviations |
//! |---|---|---|
//! | onto the deck, m/s | `max(v_t, sqrt(w² - 2 a (h - w t_b)))` | the pilot's, `r sd(a_z)` |
//! | along it, m/s | `U psi' t_l`, what is left of the present speed | the pilot's, `r sd(a_xy)`, gusts, `t_a m`, half of the turn's |
//! | angle, rad | against a strong wind the drone banks | the pilot's, `sd(tilt)`, gusts |
//! | place, m | what is left of the present offset | the pilot's, the forecast's, drift without sight, gusts |
//!
//! with the drone's reaction `r`, the speed `w` at which deck and drone come together at the height `h`, and the deck's
//! acceleration `m` that an aligned drone does not have. What a feedback takes back counts no more:
//! errors of a prediction older than `r` are corrected before the contact. The landing's probability is the product over
//! the limits, whose errors have different causes. Where the planner chooses the instant, it is that of the best one in
//! its window.

use core::f64::consts::FRAC_1_SQRT_2;

use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use alight_shared::msg::{AttitudeResponse, DeckForecast, DeckStage};
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{Vector2, Vector3};

use super::normal::{below, inside, norm};
use super::odds::Odds;
use super::situation::Deck;
use super::staying::Staying;
use super::wind::WindMonitor;
use crate::contingency::{MAX_MPS, MAX_TILT_RAD};
use crate::flatness::{aligned_acceleration, wind_during_alignment};

/// What the deck does unforeseen for so long the drone does not follow, s: a tenth from measurement to thrust, and two
/// tenths until its sink has changed.
const REACTION_S: f64 = 0.3;
/// A time constant of the attitude that this includes, s: what is slower, and the dead time, comes on top.
const FOLLOWS_S: f64 = 0.2;
/// Usual speed onto the deck, m/s, and how it is spread by drone and pilot alone.
const CONTACT_MPS: f64 = 0.33;
const CONTACT_SD_MPS: f64 = 0.12;
/// What pilot and drone leave along the deck, m/s, of the angle, rad, and of the place, m: landings in still air on a deck
/// that does not move.
const ALONG_SD_MPS: f64 = 0.07;
const TILT_SD_RAD: f64 = 0.6 * core::f64::consts::PI / 180.0;
const PLACE_SD_M: f64 = 0.03;
/// The drone can brake its sinking by this, m/s², twice what is planned; and begins to so late, s.
const BRAKING_MPS2: f64 = 5.0;
const BRAKING_LAG_S: f64 = 0.15;
/// Time constant with which the pilot closes a gap, s.
const CLOSING_S: f64 = 0.5;
/// An alignment lasts so long, s: meanwhile what the deck does not share with an aligned drone parts the two.
const ALIGNMENT_S: f64 = 0.1;
/// Between the decision and the contact the deck's uncertainty changes, with the groups of the waves, to this much.
const CHANGES: f64 = 1.3;
/// What a gust of 1 m/s² leaves, by landings begun at random moments in 8 to 14 m/s of wind: of speed along the deck,
/// m/s; of tilt, in parts of the thrust that holds it; of place, m.
const ALONG_PER_GUST_S: f64 = 0.15;
const TILT_PER_GUST: f64 = 0.25;
const PLACE_PER_GUST_S2: f64 = 0.15;
/// Odometry drifts by this without sight of the deck, m/s, and sight ends so long before the contact, s.
const DRIFT_MPS: f64 = 0.05;
const BLIND_S: f64 = 0.5;
/// The planner chooses the instant of contact within this time, s, and this far apart are those that are judged.
const WINDOW_S: f64 = 2.5;
const GRID_S: f64 = 0.25;
/// What the odds depend on beside the deck.
pub struct Outlook<'a> {
    /// The deck's forecast.
    pub forecast: &'a DeckForecast,
    /// The deck and the drone above it now.
    pub deck: &'a Deck,
    /// The wind over the deck.
    pub wind: &'a WindMonitor,
    /// Whether a landed drone stays.
    pub staying: &'a Staying,
    /// The drone.
    pub drone: &'a DroneGeometry,
    /// The deck to land on.
    pub plate: &'a DeckGeometry,
    /// The planner still chooses the instant of contact.
    pub chooses: bool,
    /// How the drone's attitude answers.
    pub response: AttitudeResponse,
}

impl Outlook<'_> {
    /// The odds of a landing that goes on from here at `now`; None where the forecast does not reach.
    pub fn odds(&self, now: Time<DroneClock>) -> Option<Odds> {
        let left_s = self.time_to_contact_s();
        let start = now.max(self.forecast.header.at);
        let reacted = self.at(start, self.reaction_s())?;
        let window_s = if self.chooses { WINDOW_S } else { 0.0 };
        let moments = (0..=(window_s / GRID_S) as usize).filter_map(|k| {
            let contact = self.at(start, left_s + GRID_S * k as f64)?;
            Some(self.at_contact(&reacted, &contact, left_s))
        });
        moments.reduce(|best, next| if next.whole() > best.whole() { next } else { best })
    }
    /// What the deck does unforeseen for so long this drone does not follow sideways and in tilt, s.
    fn reaction_s(&self) -> f64 {
        let r = &self.response;
        let slowest = r.lag_s[0].max(r.lag_s[1]);
        REACTION_S + r.dead_time_s + (slowest - FOLLOWS_S).max(0.0)
    }
    /// Down from here at the plan's usual pace, s.
    fn time_to_contact_s(&self) -> f64 {
        0.9 + self.deck.clearance_m.max(0.0) / 2.5
    }
    fn at(&self, start: Time<DroneClock>, ahead_s: f64) -> Option<DeckStage> {
        let stage = self.forecast.at(start + Span::from_secs(ahead_s));
        stage.or(self.forecast.stages.last().copied())
    }

    /// The odds of the contact with the deck `contact`, as uncertain as it is a reaction ahead.
    fn at_contact(&self, reacted: &DeckStage, contact: &DeckStage, left_s: f64) -> Odds {
        let left = (-left_s / CLOSING_S).exp();
        let (wind, gust) = (self.wind.mean(), self.wind.gust_sd());
        let slips = ALONG_PER_GUST_S * gust;
        let reaction_s = self.reaction_s();
        let [ax, ay, az] = reacted.acceleration_sd.map(|sd| reaction_s * sd);
        let horizontal = (0.5 * (ax * ax + ay * ay)).sqrt();
        // Both to and fro: of what an aligned drone is parted by, the plan allows for the part that is foreseen.
        let apart = Vector3::from(contact.acceleration).xy() - aligned_acceleration(contact) - wind;
        let parted = ALIGNMENT_S * apart.norm();
        // How far the forecast lags behind a turn is known to a half only.
        let turns = 0.5 * self.deck.turn_mps;
        let along_sd = norm(&[ALONG_SD_MPS, horizontal, slips, parted, turns]);
        let along = self.deck.turn_mps + left * self.deck.relative_speed_mps;
        let tilt_sd = norm(&[
            TILT_SD_RAD,
            (0.5 * (reacted.euler_sd[0].powi(2) + reacted.euler_sd[1].powi(2))).sqrt(),
            TILT_PER_GUST * gust / GRAVITY,
        ]);
        // Against the part of a strong wind that would blow an aligned drone along too fast it banks.
        let lean = (wind - wind_during_alignment(&wind)).norm() / GRAVITY;
        Odds {
            hard: below((MAX_MPS - self.contact_mps()) / norm(&[CONTACT_SD_MPS, CHANGES * az])),
            fast: inside(along, along_sd, MAX_MPS),
            tilted: inside(lean, tilt_sd, MAX_TILT_RAD),
            beside: self.inside_edges(left, reacted, PLACE_PER_GUST_S2 * gust),
            slides: self.staying.probability,
            turns: self.deck.turn_mps > horizontal.max(slips).max(parted),
        }
    }
    /// The speed onto the deck if the drone brakes from now on, m/s.
    fn contact_mps(&self) -> f64 {
        let (w, h) = (self.deck.sinking_mps.max(0.0), self.deck.clearance_m.max(0.0));
        let square = w * w - 2.0 * BRAKING_MPS2 * (h - w * BRAKING_LAG_S);
        CONTACT_MPS.max(square.max(0.0).sqrt())
    }
    fn inside_edges(&self, left: f64, reacted: &DeckStage, blown_m: f64) -> f64 {
        let blind_s = BLIND_S + self.deck.vision_age_s.min(self.deck.radio_age_s);
        let margin = [
            0.5 * (self.plate.length_m - self.drone.feet_span_m[0]),
            0.5 * (self.plate.width_m - self.drone.feet_span_m[1]),
        ];
        let sd = norm(&[
            PLACE_SD_M,
            reacted.position_sd[0].hypot(reacted.position_sd[1]) * FRAC_1_SQRT_2,
            DRIFT_MPS * blind_s,
            blown_m,
        ]);
        let offset: Vector2<f64> = self.deck.feet * left;
        let axis = |margin: f64, off: f64| below((margin - off) / sd) - below((-margin - off) / sd);
        axis(margin[0], offset.x) * axis(margin[1], offset.y)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::with_deck;
    use super::*;
    use crate::fixtures::{forecast, header};
    use alight_shared::msg::ReasonCode;

    fn of(change: impl FnOnce(&mut Deck), stage: impl Fn(&mut DeckStage)) -> Odds {
        let deck = with_deck(|d| {
            d.clearance_m = 1.0;
            change(d);
        })
        .deck
        .unwrap();
        let known = DeckStage {
            position_sd: [0.03; 3],
            acceleration_sd: [0.2; 3],
            euler_sd: [0.01; 3],
            ..DeckStage::default()
        };
        let f = forecast(header(0, Time::EPOCH), |_| {
            let mut s = known;
            stage(&mut s);
            s
        });
        let outlook = Outlook {
            forecast: &f,
            deck: &deck,
            wind: &WindMonitor::default(),
            staying: &Staying::default(),
            drone: &DroneGeometry::default(),
            plate: &DeckGeometry::default(),
            chooses: false,
            response: AttitudeResponse::default(),
        };
        outlook.odds(Time::EPOCH).unwrap()
    }
    fn code(odds: &Odds) -> Option<ReasonCode> {
        odds.below(0.95).map(|r| r.code)
    }

    #[test]
    fn odds_of_a_calm_deck_and_of_each_limit() {
        assert!(of(|_| {}, |_| {}).whole() > 0.98);
        for (odds, why) in [
            // The deck's speed may change by 0.4 m/s before the drone reacts.
            (of(|_| {}, |s| s.acceleration_sd[2] = 1.4), ReasonCode::LikelyHard),
            // 2.3 m/s at half a metre: nothing brakes that.
            (
                of(|d| (d.sinking_mps, d.clearance_m) = (2.3, 0.5), |_| {}),
                ReasonCode::LikelyHard,
            ),
            (
                of(|_| {}, |s| s.acceleration_sd = [1.6, 1.6, 0.2]),
                ReasonCode::LikelyFast,
            ),
            (of(|d| d.turn_mps = 0.7, |_| {}), ReasonCode::TurnTooFast),
            (of(|_| {}, |s| s.euler_sd = [0.1; 3]), ReasonCode::LikelyTilted),
            (of(|_| {}, |s| s.position_sd = [0.5; 3]), ReasonCode::LikelyBeside),
            (
                of(|_| {}, |s| s.position_sd = [f64::NAN; 3]),
                ReasonCode::LikelyBeside,
            ),
        ] {
            assert_eq!(code(&odds), Some(why), "{odds:?}");
        }
        // What time is left to make up for.
        assert_eq!(code(&of(|d| d.feet = Vector2::new(0.8, 0.0), |_| {})), None);
    }
}

//! Probability that a landing which starts or continues now succeeds.
//!
//! A good landing meets limits ([`alight_shared::landing::Limit`]) on the speed onto and along the deck, the angle
//! between drone and deck, four feet inside the edges, and staying in place. Each quantity is normally distributed
//! about its prediction, with the variance of all errors that cannot be corrected before contact.
//!
//! The mean speed onto the deck is `max(v_t, sqrt(w² - 2 a (h - w t_b)))` with the closing speed `w` at the height `h`.
//! The mean speed along the deck is `U psi' t_l` due to the vessel's turn, plus the remainder of the current speed,
//! plus the effect of the deck's acceleration relative to an aligned drone, whose unpredicted part is `r sd(a)` with
//! the drone's reaction time `r` ([`alight_shared::landing`]'s contact).
//!
//! Prediction errors older than `r` do not count, because feedback corrects them before contact. The probability of the
//! landing is the product over the limits, whose errors have different causes. It is that of the planned touchdown
//! time, and before there is a plan that of the best time in the planner's window.

use core::f64::consts::FRAC_1_SQRT_2;

use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry},
    landing::{
        BLIND_S, CONTACT_MPS, Contact, Margins, Odds, REACTION_S, Staying, WindPush, alignment_mps,
        normal::{larger, smaller},
        wind_during_alignment,
    },
    msg::{AttitudeResponse, DeckForecast, DeckStage},
    time::{DroneClock, Span, Time},
};
use nalgebra::{Rotation2, Vector2, Vector3};

use super::situation::Deck;
use crate::flatness::aligned_acceleration;

/// Attitude time constant included in the reaction time, s. A larger one adds the excess; the dead time is always
/// added.
const FOLLOWS_S: f64 = 0.2;
/// Maximum vertical deceleration, m/s², twice the planned one, and its delay, s.
const BRAKING_MPS2: f64 = 5.0;
const BRAKING_LAG_S: f64 = 0.15;
/// Time constant with which the pilot closes a gap, s.
const CLOSING_S: f64 = 0.5;
/// Window in which the planner chooses the touchdown time, s, and spacing of the assessed times, s.
const WINDOW_S: f64 = 2.5;
const GRID_S: f64 = 0.25;
pub struct Outlook<'a> {
    pub forecast: &'a DeckForecast,
    pub deck: &'a Deck,
    pub wind: WindPush,
    /// Measured acceleration due to the wind, NED, m/s².
    pub blown: Vector2<f64>,
    pub staying: &'a Staying,
    pub drone: &'a DroneGeometry,
    pub plate: &'a DeckGeometry,
    pub chooses: bool,
    /// Time to the planned contact, s; None without a plan that touches.
    pub planned_s: Option<f64>,
    pub response: AttitudeResponse,
}

impl Outlook<'_> {
    /// Odds of a landing from here at `now`; None if the forecast ends before contact.
    pub fn odds(&self, now: Time<DroneClock>) -> Option<Odds> {
        let left_s = self.planned_s.unwrap_or_else(|| self.time_to_contact_s());
        let start = now.max(self.forecast.header.at);
        let reacted = self.at(start, self.reaction_s())?;
        let chooses = self.chooses && self.planned_s.is_none();
        let window_s = if chooses { WINDOW_S } else { 0.0 };
        let moments = (0..=(window_s / GRID_S) as usize).filter_map(|k| {
            let contact = self.at(start, left_s + GRID_S * k as f64)?;
            Some(self.at_contact(&reacted, &contact, left_s))
        });
        moments.reduce(|best, next| if next.whole() > best.whole() { next } else { best })
    }
    /// Time until the drone follows the deck's unpredicted lateral motion and tilt, s.
    fn reaction_s(&self) -> f64 {
        let r = &self.response;
        let slowest = r.lag_s[0].max(r.lag_s[1]);
        REACTION_S + r.dead_time_s + (slowest - FOLLOWS_S).max(0.0)
    }
    /// Time to contact from here at the plan's usual speed, s.
    fn time_to_contact_s(&self) -> f64 {
        0.9 + self.deck.clearance_m.max(0.0) / 2.5
    }
    fn at(&self, start: Time<DroneClock>, ahead_s: f64) -> Option<DeckStage> {
        let stage = self.forecast.at(start + Span::from_secs(ahead_s));
        stage.or(self.forecast.stages.last().copied())
    }

    /// Odds for the deck state `contact`, with the uncertainty of a forecast one reaction time ahead.
    fn at_contact(&self, reacted: &DeckStage, contact: &DeckStage, left_s: f64) -> Odds {
        let left = (-left_s / CLOSING_S).exp();
        let wind = self.wind;
        let reaction_s = self.reaction_s();
        // The deck gains no more unforeseen speed than the whole forecast speed is uncertain.
        let [ax, ay, az] = core::array::from_fn(|i| {
            smaller(reaction_s * reacted.acceleration_sd[i], reacted.velocity_sd[i])
        });
        // Signed, because the plan allows for the predicted acceleration between an aligned drone and the deck.
        let blown = wind_during_alignment(&wind.mean);
        let meant = aligned_acceleration(contact, &contact.normal());
        let apart = Vector3::from(contact.acceleration).xy() - meant - blown;
        let [roll, pitch, _] = reacted.euler_sd;
        let meets = Rotation2::new(-self.deck.heading_rad) * self.staying.meets;
        let contact = Contact {
            speed_mps: self.contact_mps(),
            turn_mps: self.deck.turn_mps,
            left_mps: left * self.deck.relative_speed_mps,
            unforeseen_mps: [(0.5 * (ax * ax + ay * ay)).sqrt(), az],
            parted_mps: alignment_mps(apart.norm()),
            tilt_sd_rad: (0.5 * (roll.powi(2) + pitch.powi(2))).sqrt(),
            offset_m: meets + (self.deck.feet - meets) * left,
            place_sd_m: reacted.position_sd[0].hypot(reacted.position_sd[1]) * FRAC_1_SQRT_2,
            blind_s: BLIND_S + self.deck.vision_age_s.min(self.deck.radio_age_s),
            wind,
            wind_at_contact: wind.after(&self.blown, left_s),
            stays: self.staying.probability,
        };
        contact.odds(&Margins::on(self.plate, self.drone))
    }
    /// Speed onto the deck if the drone brakes from now on, m/s; NaN if speed or height is NaN.
    fn contact_mps(&self) -> f64 {
        let [w, h] = [self.deck.sinking_mps, self.deck.clearance_m].map(|v| larger(v, 0.0));
        let square = w * w - 2.0 * BRAKING_MPS2 * (h - w * BRAKING_LAG_S);
        larger(CONTACT_MPS, larger(square, 0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::{super::tests::with_deck, *};
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
            velocity_sd: [0.5; 3],
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
            wind: WindPush::default(),
            blown: Vector2::zeros(),
            staying: &Staying::default(),
            drone: &DroneGeometry::default(),
            plate: &DeckGeometry::default(),
            chooses: false,
            planned_s: None,
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
            // At 2.3 m/s the drone is too fast to brake within half a metre.
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
            (
                of(|_| {}, |s| s.position_sd = [0.5; 3]),
                ReasonCode::LikelyOutside,
            ),
            (
                of(|_| {}, |s| s.position_sd = [f64::NAN; 3]),
                ReasonCode::LikelyOutside,
            ),
        ] {
            assert_eq!(code(&odds), Some(why), "{odds:?}");
        }
        // NaN never counts as a soft contact.
        for odds in [
            of(|d| d.sinking_mps = f64::NAN, |_| {}),
            of(|d| d.clearance_m = f64::NAN, |_| {}),
            of(|d| d.turn_mps = f64::NAN, |_| {}),
            of(|d| d.relative_speed_mps = f64::NAN, |_| {}),
            of(|_| {}, |s| s.euler_sd = [f64::NAN; 3]),
            of(|_| {}, |s| s.acceleration_sd = [f64::NAN; 3]),
        ] {
            assert!(odds.whole() < 1e-12, "{odds:?}");
        }
        // An uncertain acceleration, but a well-known speed.
        let known = of(|_| {}, |s| (s.acceleration_sd[2], s.velocity_sd[2]) = (1.4, 0.1));
        assert_eq!(code(&known), None);
        // An offset of 0.8 m can be corrected in the remaining time.
        assert_eq!(code(&of(|d| d.feet = Vector2::new(0.8, 0.0), |_| {})), None);
    }
}

//! The probability that a landing which begins or goes on now succeeds.
//!
//! A good landing meets limits ([`Limit`]): the speed onto the deck and along it, the angle between drone and deck, four
//! feet inside the edges, and staying where it stands. Each figure is taken as normal about what is predicted for the
//! contact, with the variance of everything that nobody can take back any more:
//!
//! | figure | mean | variance |
//! |---|---|---|
//! | onto the deck, m/s | `max(v_t, sqrt(w² - 2 a (h - w r)))` | the pilot's, `(r sd(a_z))²` |
//! | along it, m/s | `U psi' t_l`, what is left of the present speed | the pilot's, `(r sd(a_xy))²`, `(r s_w)²`, `(t_a m)²` |
//! | angle, rad | 0 | the pilot's, `sd(tilt)²`, `(r² sd(a_xy) / ...)²` |
//! | place, m | what is left of the present offset | the pilot's, the forecast's, `(odometry's drift x time without sight)²` |
//!
//! with the drone's reaction `r`, the speed of the deck's approach `w` at the height `h`, the gusts' standard deviation
//! `s_w` and the deck's acceleration `m` that an aligned drone does not have. What a feedback takes back counts no more:
//! errors of a prediction older than `r` are corrected before the contact. The landing's probability is the product over
//! the limits, whose errors have different causes. Where the planner chooses the instant, it is that of the best one in
//! its window.

use core::f64::consts::SQRT_2;

use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use alight_shared::msg::{DeckForecast, DeckStage, Reason, ReasonCode};
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{Vector2, Vector3};

use super::situation::Deck;
use super::staying::Staying;
use super::wind::WindMonitor;
use crate::planner::rendezvous::touchdown_time::aligned_acceleration;

/// The limits of a good contact ([`crate`]'s trials are judged by the same): speeds, m/s, and angle, rad.
const MAX_MPS: f64 = 1.0;
const MAX_TILT_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// What the deck does unforeseen for so long the drone does not follow, s: a tenth from measurement to thrust, and two
/// tenths until its sink has changed.
pub const REACTION_S: f64 = 0.3;
/// Usual speed onto the deck, m/s, and how it is spread by drone and pilot alone.
const CONTACT_MPS: f64 = 0.33;
const CONTACT_SD_MPS: f64 = 0.06;
/// What pilot and drone leave along the deck, m/s, of the angle, rad, and of the place, m: landings in still air on a deck
/// that does not move.
const ALONG_SD_MPS: f64 = 0.07;
const TILT_SD_RAD: f64 = 0.6 * core::f64::consts::PI / 180.0;
const PLACE_SD_M: f64 = 0.03;
/// The drone can brake its sinking by this, m/s², the planned 2.5 and a reserve; and begins to so late, s.
const BRAKING_MPS2: f64 = 3.5;
const BRAKING_LAG_S: f64 = 0.15;
/// Time constant with which the pilot closes a gap, s.
const CLOSING_S: f64 = 0.5;
/// An alignment lasts this long, s: for so long what the deck does not share with an aligned drone parts the two.
const ALIGNMENT_S: f64 = 0.15;
/// Odometry drifts by this without sight of the deck, m/s, and sight ends so long before the contact, s.
const DRIFT_MPS: f64 = 0.05;
const BLIND_S: f64 = 0.5;
/// The planner chooses the instant of contact within this time, s, and this far apart are those that are judged.
const WINDOW_S: f64 = 2.5;
const GRID_S: f64 = 0.25;
/// No landing is more likely than this: what is in no model.
const MOST: f64 = 0.999;

/// What a landing may fail of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The speed onto the deck.
    Hard,
    /// The speed along it.
    Fast,
    /// The angle between the normals.
    Tilted,
    /// Four feet inside the deck's edges.
    Beside,
    /// Staying where it stands.
    Slides,
}

/// The probability that each limit is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odds {
    /// Of the speed onto the deck.
    pub hard: f64,
    /// Of the speed along it.
    pub fast: f64,
    /// Of the angle.
    pub tilted: f64,
    /// Of the place.
    pub beside: f64,
    /// Of staying.
    pub slides: f64,
    /// The vessel's turn is most of what makes the contact fast.
    pub turns: bool,
}

impl Odds {
    fn each(&self) -> [(Limit, f64); 5] {
        [
            (Limit::Hard, self.hard),
            (Limit::Fast, self.fast),
            (Limit::Tilted, self.tilted),
            (Limit::Beside, self.beside),
            (Limit::Slides, self.slides),
        ]
    }
    /// That all limits are kept; 0 where a figure is none.
    pub fn whole(&self) -> f64 {
        let p: f64 = self.each().iter().map(|(_, p)| *p).product();
        if p.is_finite() { p.min(MOST) } else { 0.0 }
    }
    /// Why it is not likely enough: the number and the limit that costs most of it.
    pub fn below(&self, needed: f64) -> Option<Reason> {
        let p = self.whole();
        let least = |a: (Limit, f64), b: (Limit, f64)| if b.1 < a.1 || b.1.is_nan() { b } else { a };
        let (limit, _) = self.each().into_iter().fold((Limit::Hard, self.hard), least);
        let code = match limit {
            Limit::Hard => ReasonCode::LikelyHard,
            Limit::Fast if self.turns => ReasonCode::TurnTooFast,
            Limit::Fast => ReasonCode::LikelyFast,
            Limit::Tilted => ReasonCode::LikelyTilted,
            Limit::Beside => ReasonCode::LikelyBeside,
            Limit::Slides => ReasonCode::LikelySlides,
        };
        (p < needed).then_some(Reason::new(code, p, needed))
    }
}

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
}

impl Outlook<'_> {
    /// The odds of a landing that goes on from here at `now`; None where the forecast does not reach.
    pub fn odds(&self, now: Time<DroneClock>) -> Option<Odds> {
        let left_s = self.time_to_contact_s();
        let start = now.max(self.forecast.header.at);
        let reacted = self.at(start, REACTION_S)?;
        let window_s = if self.chooses { WINDOW_S } else { 0.0 };
        let moments = (0..=(window_s / GRID_S) as usize).filter_map(|k| {
            let contact = self.at(start, left_s + GRID_S * k as f64)?;
            Some(self.at_contact(&reacted, &contact, left_s))
        });
        moments.reduce(|best, next| if next.whole() > best.whole() { next } else { best })
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
        let gust = REACTION_S * self.wind.gust_sd();
        let [ax, ay, az] = reacted.acceleration_sd.map(|sd| REACTION_S * sd);
        let horizontal = (0.5 * (ax * ax + ay * ay)).sqrt();
        // Both to and fro: of what an aligned drone is parted by, the plan allows for the part that is foreseen.
        let apart =
            Vector3::from(contact.acceleration).xy() - aligned_acceleration(contact) - self.wind.mean();
        let parted = ALIGNMENT_S * apart.norm();
        // How far the forecast lags behind a turn is known to a half only.
        let turns = 0.5 * self.deck.turn_mps;
        let along_sd = norm(&[ALONG_SD_MPS, horizontal, gust, parted, turns]);
        let along = self.deck.turn_mps + left * self.deck.relative_speed_mps;
        let tilt_sd = norm(&[
            TILT_SD_RAD,
            (0.5 * (reacted.euler_sd[0].powi(2) + reacted.euler_sd[1].powi(2))).sqrt(),
            gust / GRAVITY,
        ]);
        Odds {
            hard: below((MAX_MPS - self.contact_mps()) / norm(&[CONTACT_SD_MPS, az])),
            fast: inside(along, along_sd, MAX_MPS),
            tilted: inside(0.0, tilt_sd, MAX_TILT_RAD),
            beside: self.inside_edges(left, reacted),
            slides: self.staying.probability,
            turns: self.deck.turn_mps > horizontal.max(gust).max(parted),
        }
    }
    /// The speed onto the deck if the drone brakes from now on, m/s.
    fn contact_mps(&self) -> f64 {
        let (w, h) = (self.deck.sinking_mps.max(0.0), self.deck.clearance_m.max(0.0));
        let square = w * w - 2.0 * BRAKING_MPS2 * (h - w * BRAKING_LAG_S);
        CONTACT_MPS.max(square.max(0.0).sqrt())
    }
    fn inside_edges(&self, left: f64, reacted: &DeckStage) -> f64 {
        let blind_s = BLIND_S + self.deck.vision_age_s.min(self.deck.radio_age_s);
        let margin = [
            0.5 * (self.plate.length_m - self.drone.feet_span_m[0]),
            0.5 * (self.plate.width_m - self.drone.feet_span_m[1]),
        ];
        let sd = norm(&[
            PLACE_SD_M,
            reacted.position_sd[0].hypot(reacted.position_sd[1]) / SQRT_2,
            DRIFT_MPS * blind_s,
        ]);
        let offset: Vector2<f64> = self.deck.feet * left;
        let axis = |margin: f64, off: f64| below((margin - off) / sd) - below((-margin - off) / sd);
        axis(margin[0], offset.x) * axis(margin[1], offset.y)
    }
}

/// Root of the sum of the squares.
pub(super) fn norm(parts: &[f64]) -> f64 {
    parts.iter().map(|p| p * p).sum::<f64>().sqrt()
}

/// Probability that a standard normal figure is below `z`.
pub(super) fn below(z: f64) -> f64 {
    0.5 * libm::erfc(-z / SQRT_2)
}

/// Probability that a plane's normal figure with the mean `mean` from the middle and the standard deviation `sd` of each
/// axis lies within `radius` of the middle (Rice): `∫ phi(u) (2 Phi(sqrt(radius² - x²) / sd) - 1) du`, `x = mean + sd u`.
fn inside(mean: f64, sd: f64, radius: f64) -> f64 {
    /// Standard deviations to either side, and steps.
    const REACH: f64 = 6.0;
    const STEPS: u32 = 96;
    if !(sd > 0.0) {
        return f64::from(mean < radius);
    }
    let step = 2.0 * REACH / f64::from(STEPS);
    let part = |k: u32| {
        let u = -REACH + step * (f64::from(k) + 0.5);
        let x = mean + sd * u;
        let half = (radius * radius - x * x).max(0.0).sqrt();
        (-0.5 * u * u).exp() * (1.0 - libm::erfc(half / sd / SQRT_2))
    };
    let sum: f64 = (0..STEPS).map(part).sum();
    (sum * step / core::f64::consts::TAU.sqrt()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::tests::with_deck;
    use super::*;
    use crate::fixtures::{forecast, header};

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
        };
        outlook.odds(Time::EPOCH).unwrap()
    }
    fn code(odds: &Odds) -> Option<ReasonCode> {
        odds.below(0.95).map(|r| r.code)
    }

    #[test]
    fn odds_of_a_calm_deck_and_of_each_limit() {
        assert!(of(|_| {}, |_| {}).whole() > 0.99);
        for (odds, why) in [
            // The deck's speed may change by 0.4 m/s before the drone reacts.
            (of(|_| {}, |s| s.acceleration_sd[2] = 1.4), ReasonCode::LikelyHard),
            // 2.3 m/s at the flare: braked within 0.9 m only at once.
            (
                of(|d| (d.sinking_mps, d.clearance_m) = (2.3, 0.9), |_| {}),
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

    #[test]
    fn probability_inside_a_circle() {
        for sd in [0.2, 0.5, 1.0] {
            // Rayleigh, where the mean is the middle.
            let rayleigh = 1.0 - (-0.5_f64 / (sd * sd)).exp();
            assert!((inside(0.0, sd, 1.0) - rayleigh).abs() < 2e-3, "{sd}");
        }
        // Far off along one axis it is that axis's alone.
        assert!((inside(0.8, 0.05, 1.0) - below(4.0)).abs() < 1e-3);
        assert!(inside(2.0, 0.1, 1.0) < 1e-6 && inside(0.5, 0.0, 1.0) > 0.999);
    }
}

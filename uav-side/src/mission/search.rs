//! Search for a deck that only a beacon reports: a spiral about the beacon's predicted position.
//!
//! ```text
//! r = b theta,  2 pi b = pitch          pitch: three quarters of the camera's view from side to side
//! s = b (theta^2 - 1) / 2               path flown, m; from theta = 1 on
//! R = 3.4 sd                            radius that contains the deck with 99.7 % (Rayleigh)
//! ```
//!
//! The path ends with a full circle at `R` minus half of the camera's view. `R` increases while the beacon is silent.

use core::f64::consts::TAU;

use alight_shared::msg::{Reason, ReasonCode};
use nalgebra::Vector2;

use super::{
    limits::CONTACT_CONFIRM_S,
    phase::{
        DroneTime, HoldCause, MissionPhase, PhaseTransition, Search, gave_up, holding, lasting, too_far,
    },
    situation::{Deck, Situation},
};
use crate::mission_config::MissionConfig;

/// Radius that contains the deck with 99.7 %, in standard deviations (each axis) of the beacon's position.
const WITHIN_SD: f64 = 3.4;
/// Maximum radius of a search, m: it takes 5 min with the default camera.
pub(super) const MAX_SEARCH_M: f64 = 50.0;
/// Speed along the spiral relative to the vessel, m/s: a tag stays in view for seconds, and the drone tilts little.
const SEARCH_MPS: f64 = 3.0;
/// Maximum distance between the drone and its reference on the spiral at which the reference advances, m.
const BEHIND_M: f64 = 3.0;
/// Distance between two turns of the spiral, in widths of the camera's view.
const PITCH: f64 = 0.75;
/// Observation time at the end of the path, s.
const LOOKS_S: f64 = 5.0;
/// Maximum duration of a search, as a multiple of its duration without wind and waits.
const MAX_SLOWER: f64 = 2.0;
/// Distance from the beacon's position at which the drone has arrived, m.
const AT_BEACON_M: f64 = 3.0;

fn reach_m(sd_m: f64) -> f64 {
    WITHIN_SD * sd_m
}

#[derive(Clone, Copy, Debug)]
struct Spiral {
    /// Increase of the radius with the angle, m/rad.
    b: f64,
    /// Radius of the full circle at the end, m.
    outer_m: f64,
    /// Path length up to that circle, and total path length, m.
    inner_m: f64,
    length_m: f64,
}

impl Spiral {
    fn new(sd_m: f64, half_width_m: f64) -> Spiral {
        let b = 2.0 * PITCH * half_width_m / TAU;
        let outer_m = (reach_m(sd_m).min(MAX_SEARCH_M) - half_width_m).max(0.0);
        let theta = (outer_m / b).max(1.0);
        let inner_m = 0.5 * b * (theta * theta - 1.0);
        Spiral {
            b,
            outer_m,
            inner_m,
            length_m: inner_m + TAU * outer_m,
        }
    }
    /// Position at `flown_m` along the path, relative to the beacon, m.
    fn at(&self, flown_m: f64) -> Vector2<f64> {
        let turned = |flown_m: f64| (1.0 + 2.0 * flown_m / self.b).sqrt();
        let theta = if flown_m < self.inner_m || self.outer_m <= 0.0 {
            turned(flown_m)
        } else {
            turned(self.inner_m) + (flown_m - self.inner_m) / self.outer_m
        };
        Vector2::new(theta.cos(), theta.sin()) * (self.b * theta).min(self.outer_m)
    }
    fn limit_s(&self) -> f64 {
        MAX_SLOWER * self.length_m / SEARCH_MPS + 2.0 * LOOKS_S
    }
}

impl Search {
    /// Target relative to the beacon's predicted position, north and east, m; None while the deck is detected.
    pub(super) fn offset(&self, deck: &Deck, c: &MissionConfig) -> Option<[f64; 2]> {
        let [sd_m, _] = deck.beacon.filter(|_| deck.vision_age_s > c.vision_fresh_s)?;
        Some(Spiral::new(sd_m, c.search_view_m[1]).at(self.flown_m).into())
    }
}

pub(super) fn vague(deck: &Deck) -> Option<Reason> {
    let [sd_m, _] = deck.beacon?;
    let reach_m = reach_m(sd_m);
    (reach_m > MAX_SEARCH_M).then(|| Reason::new(ReasonCode::BeaconVague, reach_m, MAX_SEARCH_M))
}

pub(super) fn height_m(c: &MissionConfig) -> f64 {
    c.search_view_m[0].clamp(c.tracking_height_m.min(c.approach_height_m), c.approach_height_m)
}

/// Start of a search; None if the deck is detected, the vessel is received, or the drone is away from the beacon's
/// position.
pub(super) fn begins(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<PhaseTransition> {
    let [sd_m, _] = deck.beacon.filter(|_| deck.radio_age_s > c.radio_lost_s)?;
    if deck.distance_m > AT_BEACON_M {
        return None;
    }
    if let Some(why) = vague(deck) {
        return Some(gave_up(s, c).enter(why));
    }
    let search = Search {
        since: s.now,
        at: s.now,
        ..Search::default()
    };
    let why = Reason::new(ReasonCode::AtBeacon, deck.distance_m, reach_m(sd_m));
    Some(MissionPhase::Search(search).enter(why))
}

/// Searches until the tags are detected, the vessel is received, or the path ends.
pub(super) fn search(search: Search, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let stays = MissionPhase::Search(search);
    let Some(deck) = s.fresh_deck() else {
        return stays.stay(s.no_deck());
    };
    if let Some(why) = too_far(deck, c) {
        return holding(HoldCause::Data, s, c).enter(why);
    }
    if deck.vision_age_s <= c.vision_fresh_s {
        return found(search, s);
    }
    if deck.radio_age_s <= c.radio_fresh_s {
        return MissionPhase::APPROACH.enter(Reason::new(ReasonCode::Recovered, 0.0, 0.0));
    }
    let Some([sd_m, _]) = deck.beacon else {
        return holding(HoldCause::Data, s, c).enter(ReasonCode::NoVessel);
    };
    let spiral = Spiral::new(sd_m, c.search_view_m[1]);
    let search = search.advanced(&spiral, deck, s.now);
    let took_s = (s.now - search.since).secs();
    let (ended, looked_s) = lasting(search.flown_m >= spiral.length_m, search.ended, s.now);
    if looked_s > LOOKS_S || took_s > spiral.limit_s() {
        let why = Reason::new(ReasonCode::NotFound, reach_m(sd_m).min(MAX_SEARCH_M), took_s);
        return gave_up(s, c).enter(vague(deck).or(s.several).unwrap_or(why));
    }
    let flies = Reason::new(ReasonCode::Searching, search.flown_m, spiral.length_m);
    let search = Search {
        ended,
        detected: None,
        ..search
    };
    // Tags away from the beacon's position belong to another vessel.
    MissionPhase::Search(search).stay(deck.contradicted.or(s.several).unwrap_or(flies))
}

/// Transition while the deck is detected: after a while the drone follows it, unless its height is in doubt.
fn found(search: Search, s: &Situation) -> PhaseTransition {
    let (detected, lasted) = lasting(true, search.detected, s.now);
    let goes_on = MissionPhase::Search(Search {
        detected,
        at: s.now,
        ..search
    });
    match s.doubt {
        Some(why) => goes_on.stay(why),
        None if lasted < CONTACT_CONFIRM_S => goes_on.stay(ReasonCode::NoVision),
        None => MissionPhase::TRACKING.enter(ReasonCode::InSight),
    }
}

impl Search {
    /// Search at `now`, advanced if the drone is near its target.
    fn advanced(self, spiral: &Spiral, deck: &Deck, now: DroneTime) -> Search {
        let from_beacon = Vector2::new(deck.bearing_rad.cos(), deck.bearing_rad.sin()) * -deck.distance_m;
        let behind_m = (spiral.at(self.flown_m) - from_beacon).norm();
        let dt = (now - self.at).secs().clamp(0.0, 0.1);
        let goes_m = if behind_m <= BEHIND_M {
            SEARCH_MPS * dt
        } else {
            0.0
        };
        Search {
            at: now,
            flown_m: (self.flown_m + goes_m).min(spiral.length_m),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point within the radius comes into view, and the path stays within the radius.
    #[test]
    fn spiral_that_covers_its_circle() {
        for (sd_m, half_m) in [(2.0, 6.0), (5.0, 6.0), (12.0, 6.0), (17.0, 3.0)] {
            let spiral = Spiral::new(sd_m, half_m);
            let steps = (spiral.length_m / 0.5).ceil() as usize;
            let path: Vec<_> = (0..=steps)
                .map(|k| spiral.at((0.5 * k as f64).min(spiral.length_m)))
                .chain([Vector2::zeros()])
                .collect();
            let reach_m = reach_m(sd_m).min(MAX_SEARCH_M);
            assert!(path.iter().all(|p| p.norm() <= reach_m));
            for k in 0..2000 {
                // The points form a sunflower pattern, which covers the circle evenly.
                let r = reach_m * (f64::from(k) / 2000.0).sqrt();
                let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
                let deck = Vector2::new(cos, sin) * r;
                let nearest = path.iter().map(|p| (p - deck).norm()).fold(f64::MAX, f64::min);
                assert!(nearest <= half_m + 0.3, "{sd_m} {half_m}: {deck:?} {nearest}");
            }
            // An error of 5 m is searched in 40 s.
            assert!(sd_m > 5.0 || spiral.length_m / SEARCH_MPS < 40.0, "{spiral:?}");
            assert!(spiral.limit_s() < 1500.0);
        }
    }
}

//! Witnesses of the deck's height: what confirms or contradicts the forecast before a drone goes lower than it has flown.
//!
//! Until a camera sees the deck, its height in the drone's NED is the difference of two receivers' heights, and one that lacks
//! the geoid is wrong by up to 100 m. So a second witness has to agree, each within what it errs by (a level of the deck,
//! NED z, against that of the forecast):
//!
//! | witness | level of the deck | errs by |
//! |---|---|---|
//! | take-off | where the feet stood on the deck | drift of barometer or GNSS height in a flight |
//! | mean sea level, by the origin that the autopilot reports | still water with the deck's height over it | tide, both receivers, their geoid models |
//! | camera | the forecast while it sees the deck, and since | drift, as for a take-off |
//! | rangefinder | whatever is below, water or deck: no confirmation, but the drone stays above it | 0.1 m |
//!
//! A relative place that the tags have confirmed counts as the camera.
//!
//! A witness that has the deck *higher* by more than it errs by contradicts: the drone stays as high as if both levels were
//! the deck's. Without a witness it stays no lower than a pilot flew it. Mean sea level is no witness where the drone
//! itself has been lower (an inland water below the sea), and contradicts nothing that a take-off from the deck confirms.

use alight_shared::estimation::low_pass;
use alight_shared::msg::{LandedState, RangeSample, Reason, ReasonCode};
use alight_shared::time::Span;
use alight_shared::topics;
use nalgebra::Vector3;

use super::MissionNode;
use super::phase::DroneTime;
use super::situation::relative_age_s;
use crate::mission_config::MissionConfig;

/// The mean level that counts follows the forecasts' no faster than this, m/s: many times what two GNSS receivers drift apart.
/// The minimum altitude depends on it, and a wrong forecast (20 m below the water, from an estimator that had lost the
/// tilt) must not lower it; a frame that moves for good shows in the count of origin resets.
const LEVEL_MPS: f64 = 0.2;
/// A deck whose height is known no better was not detected, standard deviation, m: two receivers are worse, a camera that
/// sees the tag from the tracking height ten times better.
const VISION_SD_M: f64 = 0.5;

/// A take-off's level, and that of the last sight, err by this, m: a barometer drifts by 1 to 4 m in ten minutes, and rises
/// and falls of a deck at sea are not averaged.
const FLIGHT_DRIFT_M: f64 = 5.0;
/// Mean sea level errs by this, m: tides of up to 4 m from the mean, two receivers of 2 m each, and geoid models of 1 m.
const SEA_LEVEL_M: f64 = 8.0;
/// Nearer than this to the deck's centre, by the forecast, a disarmed drone stands on the deck, m: two receivers.
const ON_DECK_M: f64 = 4.0;

/// Readings of a surface count when they have come for so long, s, and for so long after the last.
const SURFACE_LASTS_S: f64 = 0.5;
const SURFACE_STALE: Span = Span::from_millis(500);
/// Readings that differ by more than this are of another surface, m: waves and a deck's edge.
const SURFACE_JUMP_M: f64 = 3.0;
/// Time constant of a surface's height, s.
const SURFACE_TIME_S: f64 = 0.5;

/// Surface below the drone, by its rangefinder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Surface {
    /// Since when, the newest reading, and its height, NED z, m.
    observed: Option<(DroneTime, DroneTime, f64)>,
}

impl Surface {
    /// A reading of a surface at the height `z` (NED, m).
    pub(super) fn update(&mut self, at: DroneTime, z: f64) {
        let same = |(_, last, level): &(DroneTime, DroneTime, f64)| {
            at > *last && at - *last <= SURFACE_STALE && (z - level).abs() <= SURFACE_JUMP_M
        };
        self.observed = match self.observed.filter(same) {
            Some((since, last, level)) => {
                Some((since, at, low_pass(level, z, (at - last).secs(), SURFACE_TIME_S)))
            }
            None => z.is_finite().then_some((at, at, z)),
        };
    }
    /// Height of the surface, NED z, m, when readings of it last.
    pub(super) fn level(&self, now: DroneTime) -> Option<f64> {
        let (since, last, level) = self.observed?;
        (now - last <= SURFACE_STALE && (last - since).secs() >= SURFACE_LASTS_S).then_some(level)
    }
}

/// Input of one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeightInput {
    /// Deck's mean level of the newest forecast, NED z, m.
    pub(super) forecast_z: Option<f64>,
    /// The camera sees the deck, or a relative place that the tags have confirmed shows it, by the forecast.
    pub(super) observed: bool,
    /// Drone's centre of mass, NED z, m, where odometry is fresh.
    pub(super) own_z: Option<f64>,
    /// Feet below the centre of mass, m.
    pub(super) feet_m: f64,
    /// Horizontal distance from the deck's centre, m.
    pub(super) distance_m: f64,
    /// By the autopilot.
    pub(super) landed: LandedState,
    /// The motors may turn.
    pub(super) armed: bool,
    /// Height of the origin above mean sea level, m.
    pub(super) origin_sea_m: Option<f64>,
    /// The mission commands the drone's height.
    pub(super) flies: bool,
}

/// The witnesses, in the drone's present NED.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct HeightWitnesses {
    /// Mean sea level, NED z, m.
    sea_z: Option<f64>,
    /// Deck's level where the drone stood on it, NED z, m.
    take_off_z: Option<f64>,
    /// Deck's level while the camera saw it, NED z, m.
    vision_z: Option<f64>,
    /// The lowest place that the drone has been at without the mission, NED z, m.
    proven_z: Option<f64>,
}

/// Limits of the drone's height by the witnesses of the deck's level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Heights {
    /// The highest level of the deck among forecast and witnesses that contradict it, NED z, m.
    pub(super) deck_z: Option<f64>,
    /// Highest level of the water, NED z, m: before the camera has detected the deck no lower than mean sea level.
    pub(super) water_z: Option<f64>,
    /// The drone goes no lower than this, NED z, m; None: its heights over the deck count.
    pub(super) lowest_z: Option<f64>,
    /// Why it goes no lower.
    pub(super) doubt: Option<Reason>,
}

impl Heights {
    /// These limits for a drone at `own_z` that sees a surface at `surface_z` below it: it goes no lower than `clear_m`
    /// above that, but does not climb for it: a reading that is too short follows the drone up.
    pub(super) fn above_surface(self, surface_z: f64, own_z: f64, above_m: f64, clear_m: f64) -> Heights {
        let lowest = (surface_z - clear_m).max(own_z);
        let aims_z = self.deck_z.map(|deck| deck - above_m);
        if aims_z.is_none_or(|z| lowest >= z) || self.lowest_z.is_some_and(|z| z <= lowest) {
            return self;
        }
        let higher_m = self.deck_z.map_or(0.0, |deck| deck - surface_z);
        Heights {
            lowest_z: Some(lowest),
            doubt: self.doubt.or(Some(Reason::new(
                ReasonCode::HeightsDisagree,
                higher_m,
                above_m - clear_m,
            ))),
            ..self
        }
    }
}

impl HeightWitnesses {
    /// The frame itself has moved.
    pub(super) fn forget(&mut self) {
        *self = HeightWitnesses::default();
    }

    /// Takes what is known now.
    pub(super) fn update(&mut self, i: &HeightInput, c: &MissionConfig) {
        self.sea_z = i.origin_sea_m;
        let stands = !i.armed || i.landed == LandedState::OnGround;
        if let Some(z) = i.own_z {
            // From the ground a drone climbs clear of the waves first.
            let z = if stands { z - c.minimum_altitude_m } else { z };
            if !i.flies || self.proven_z.is_none() {
                self.proven_z = Some(self.proven_z.map_or(z, |p| p.max(z)));
            }
        }
        // A heartbeat that is late reports a drone in the air as disarmed.
        let rests = !i.armed && i.landed == LandedState::OnGround;
        if let Some(z) = i.own_z.filter(|_| rests && i.distance_m < ON_DECK_M) {
            self.take_off_z = Some(z + i.feet_m);
        }
        if let Some(z) = i.forecast_z.filter(|_| i.observed) {
            self.vision_z = Some(z);
        }
    }

    /// Mean sea level where the drone itself does not refute it, NED z, m.
    fn sea_z(&self) -> Option<f64> {
        let below = |sea: &f64| self.proven_z.is_some_and(|p| p > sea + SEA_LEVEL_M);
        self.sea_z.filter(|sea| !below(sea))
    }

    /// The levels of the deck with what they err by; `deck_m`: height of the deck over still water.
    fn levels(&self, deck_m: f64) -> [Option<(f64, f64)>; 3] {
        [
            self.take_off_z.map(|z| (z, FLIGHT_DRIFT_M)),
            self.sea_z().map(|z| (z - deck_m, SEA_LEVEL_M)),
            self.vision_z.map(|z| (z, FLIGHT_DRIFT_M)),
        ]
    }

    /// A witness has the deck at this level, NED z, m, and none has it higher.
    pub(super) fn confirm(&self, z: f64, deck_m: f64) -> bool {
        let [take_off, sea, observed] = self.levels(deck_m);
        self.agree(z, deck_m, [take_off, sea, observed])
    }
    /// Confirmation by witnesses that do not rest on the forecast.
    pub(super) fn confirm_aside(&self, z: f64, deck_m: f64) -> bool {
        let [take_off, sea, _] = self.levels(deck_m);
        self.agree(z, deck_m, [take_off, sea, None])
    }
    fn agree(&self, z: f64, deck_m: f64, levels: [Option<(f64, f64)>; 3]) -> bool {
        let near = |(level, err): &(f64, f64)| (z - level).abs() <= *err;
        self.contradiction(z, deck_m).is_none() && levels.iter().flatten().any(near)
    }

    /// The highest level that contradicts the deck's at `z`, with what it errs by.
    fn contradiction(&self, z: f64, deck_m: f64) -> Option<(f64, f64)> {
        let [take_off, sea, observed] = self.levels(deck_m);
        let stood = take_off.is_some_and(|(level, err)| (z - level).abs() <= err);
        [take_off, sea.filter(|_| !stood), observed]
            .into_iter()
            .flatten()
            .filter(|(level, err)| *level < z - err)
            .reduce(|a, b| if b.0 < a.0 { b } else { a })
    }

    /// Judges a deck at the mean level `mean_z` and at that of the newest forecast, NED z, m; `deck_m`: height of the
    /// deck over still water, `above_m`: height of the approach over the deck.
    pub(super) fn judge(
        &self,
        mean_z: Option<f64>,
        forecast_z: Option<f64>,
        deck_m: f64,
        above_m: f64,
    ) -> Heights {
        let Some(mean) = mean_z else {
            return Heights::default();
        };
        // The lower of both is the more dangerous.
        let lowest = forecast_z.map_or(mean, |z| z.max(mean));
        let sea_z = self.sea_z().filter(|_| self.vision_z.is_none());
        let water_z = sea_z.map_or(mean + deck_m, |sea| sea.min(mean + deck_m));
        let sound = Heights {
            deck_z: Some(mean),
            water_z: Some(water_z),
            lowest_z: None,
            doubt: None,
        };
        if let Some((level, err)) = self.contradiction(lowest, deck_m) {
            let deck_z = level.min(mean);
            return Heights {
                deck_z: Some(deck_z),
                water_z: Some(water_z.min(deck_z + deck_m)),
                lowest_z: Some(deck_z - above_m),
                doubt: Some(Reason::new(ReasonCode::HeightsDisagree, lowest - level, err)),
            };
        }
        if self.confirm(lowest, deck_m) {
            return sound;
        }
        let lowest_z = self.proven_z;
        Heights {
            lowest_z,
            doubt: lowest_z.map(|z| Reason::new(ReasonCode::HeightUnconfirmed, mean - z, above_m)),
            ..sound
        }
    }
}

impl MissionNode {
    /// Height of the deck over still water, m.
    fn deck_height_m(&self) -> f64 {
        -self.deck_geometry.centre_m[2]
    }

    /// Limits of the drone's height by the witnesses of the deck's.
    pub(super) fn heights(&mut self, now: DroneTime) -> Heights {
        let forecast = self.forecast.fresh(now, topics::FORECAST.stale_after);
        let own = self.drone.fresh(now, topics::DRONE_STATE.stale_after);
        let level = forecast.and_then(|f| f.mean_z);
        let autopilot = self.autopilot.fresh(now, topics::AUTOPILOT.stale_after);
        if let Some(a) = autopilot {
            let deck = forecast.and_then(|f| f.at(now.max(f.header.at)));
            let apart = own
                .zip(deck)
                .map(|(d, deck)| d.position() - Vector3::from(deck.position));
            let input = HeightInput {
                forecast_z: level,
                observed: forecast
                    .is_some_and(|f| f.vision_age_s.min(relative_age_s(f)) <= self.config.vision_fresh_s)
                    && deck.is_some_and(|d| d.position_sd[2] < VISION_SD_M),
                own_z: own.map(|d| d.position[2]),
                feet_m: self.drone_geometry.feet_below_m,
                distance_m: apart.map_or(f64::INFINITY, |r| r.xy().norm()),
                landed: a.landed,
                armed: a.armed,
                // In the frame that goes on through the jumps of the autopilot's estimate.
                origin_sea_m: a.origin_sea_m.zip(own).map(|(m, d)| m + d.datum_offset[2]),
                flies: self.phase.flies(),
            };
            self.heights.update(&input, &self.config);
        }
        let above_m = self.config.approach_height_m;
        let (mean_z, deck_m) = (self.mean_deck_z.map(|(_, z)| z), self.deck_height_m());
        let heights = self.heights.judge(mean_z, level, deck_m, above_m);
        let own_z = own.map(|d| d.position[2]);
        match self.surface.level(now).zip(own_z) {
            Some((surface_z, own_z)) => {
                heights.above_surface(surface_z, own_z, above_m, self.config.minimum_altitude_m)
            }
            None => heights,
        }
    }

    /// Follows the deck's mean level of a forecast, NED z, m.
    pub(super) fn follow_level(&mut self, at: DroneTime, z: f64) {
        let mean = self.mean_deck_z.map_or(z, |(last, mean)| {
            let limit_m = LEVEL_MPS * (at - last).secs().max(0.0);
            mean + (z - mean).clamp(-limit_m, limit_m)
        });
        // Vision has corrected the radio: what a second witness confirms need not be followed slowly.
        let (deck_m, w) = (self.deck_height_m(), &self.heights);
        let rises = z < mean && w.confirm(z, deck_m) && !w.confirm(mean, deck_m);
        let agrees = rises || w.confirm_aside(z, deck_m) && !w.confirm_aside(mean, deck_m);
        self.mean_deck_z = Some((at, if agrees { z } else { mean }));
    }

    /// Takes what the rangefinder sees below the drone.
    pub(super) fn see_surface(&mut self, now: DroneTime, ranges: &[RangeSample]) {
        let own = self.drone.fresh(now, topics::DRONE_STATE.stale_after);
        for (m, d) in ranges.iter().zip(own.into_iter().cycle()) {
            let down = d.attitude() * (Vector3::z() * (m.range_m + self.drone_geometry.rangefinder_m[2]));
            self.surface.update(m.header.at, d.position[2] + down.z);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECK_M: f64 = 1.3;
    const ABOVE_M: f64 = 15.0;

    /// In the air, flown by a pilot at this height above its origin.
    fn airborne(own_z: f64) -> HeightInput {
        HeightInput {
            forecast_z: None,
            observed: false,
            own_z: Some(own_z),
            feet_m: 0.3,
            distance_m: 50.0,
            landed: LandedState::InAir,
            armed: true,
            origin_sea_m: None,
            flies: false,
        }
    }
    fn after(inputs: &[HeightInput]) -> HeightWitnesses {
        let mut w = HeightWitnesses::default();
        inputs.iter().for_each(|i| w.update(i, &MissionConfig::default()));
        w
    }
    fn judged(w: &HeightWitnesses, deck_z: f64) -> Heights {
        w.judge(Some(deck_z), Some(deck_z), DECK_M, ABOVE_M)
    }
    fn code(h: &Heights) -> Option<ReasonCode> {
        h.doubt.map(|why| why.code)
    }

    /// A vessel whose receiver is silent of the geoid: its deck 22 to 51 m too low, or too high.
    #[test]
    fn height_against_mean_sea_level() {
        let at_sea = HeightInput {
            origin_sea_m: Some(10.0),
            ..airborne(2.0)
        };
        let w = after(&[at_sea]);
        let true_z = 10.0 - DECK_M;
        let sound = judged(&w, true_z + 3.0);
        assert_eq!((code(&sound), sound.lowest_z), (None, None));
        for wrong_m in [22.0, 36.0, 51.0] {
            let h = judged(&w, true_z + wrong_m);
            assert_eq!(code(&h), Some(ReasonCode::HeightsDisagree));
            assert!((h.lowest_z.unwrap() - (true_z - ABOVE_M)).abs() < 1e-9, "{h:?}");
            assert!((h.water_z.unwrap() - 10.0).abs() < 1e-9, "{h:?}");
            // Too high: up there nothing sees the deck, and nothing is met.
            let h = judged(&w, true_z - wrong_m);
            assert_eq!(code(&h), Some(ReasonCode::HeightUnconfirmed));
        }
        // A wrong level of the newest forecast counts before the mean has followed.
        let h = w.judge(Some(true_z), Some(true_z + 30.0), DECK_M, ABOVE_M);
        assert_eq!(code(&h), Some(ReasonCode::HeightsDisagree));
    }

    #[test]
    fn height_with_the_radio_alone() {
        let inland = airborne(-20.0);
        let mut w = after(&[inland]);
        let h = judged(&w, 5.0);
        assert_eq!(code(&h), Some(ReasonCode::HeightUnconfirmed));
        assert_eq!(h.lowest_z, Some(-20.0));
        // Nor lower as the mission lets it drift; as low as a pilot flies it.
        let drifts = HeightInput {
            flies: true,
            ..airborne(-17.0)
        };
        w.update(&drifts, &MissionConfig::default());
        assert_eq!(judged(&w, 5.0).lowest_z, Some(-20.0));
        w.update(&airborne(-8.0), &MissionConfig::default());
        assert_eq!(judged(&w, 5.0).lowest_z, Some(-8.0));
        // Until a camera sees the deck.
        let sees = HeightInput {
            forecast_z: Some(6.0),
            observed: true,
            flies: true,
            ..airborne(-8.0)
        };
        w.update(&sees, &MissionConfig::default());
        assert_eq!(code(&judged(&w, 6.0)), None);
        assert_eq!(code(&judged(&w, 40.0)), Some(ReasonCode::HeightsDisagree));
    }

    #[test]
    fn height_on_waters_above_and_below_the_sea() {
        for (water_m, contradicts) in [(400.0, false), (-430.0, false), (-3.0, false)] {
            // The origin is on the water.
            let lake = HeightInput {
                origin_sea_m: Some(water_m),
                ..airborne(-10.0)
            };
            let h = judged(&after(&[lake]), -DECK_M);
            let disagrees = code(&h) == Some(ReasonCode::HeightsDisagree);
            assert_eq!(disagrees, contradicts, "{water_m} m: {h:?}");
        }
    }

    /// Radio and sea level are wrong alike: the autopilot's origin is. The rangefinder sees the water come.
    #[test]
    fn height_above_the_surface_that_the_rangefinder_sees() {
        let deck_z = 40.0;
        let sound = Heights {
            deck_z: Some(deck_z),
            ..Heights::default()
        };
        let observed = |surface_z: f64, own_z: f64| sound.above_surface(surface_z, own_z, ABOVE_M, 3.0);
        // The deck, or water below it; a mast of 8 m.
        for surface_z in [deck_z, deck_z + DECK_M, deck_z - 8.0] {
            assert_eq!(observed(surface_z, deck_z - 20.0), sound);
        }
        let h = observed(0.0, -5.0);
        assert_eq!(
            (h.lowest_z, code(&h)),
            (Some(-3.0), Some(ReasonCode::HeightsDisagree))
        );
        // Too low already, or a beam that ends at the drone's own feet: no lower.
        assert_eq!(observed(0.0, -1.0).lowest_z, Some(-1.0));
        assert_eq!(observed(-50.0, -50.5).lowest_z, Some(-50.5));

        let mut surface = Surface::default();
        let at = |s: f64| DroneTime::from_secs(s);
        for k in 0..20 {
            let t = 10.0 + 0.02 * f64::from(k);
            surface.update(at(t), 1.0);
            assert_eq!(surface.level(at(t)), None);
        }
        // One reading of spray restarts it.
        surface.update(at(10.4), -8.0);
        for k in 1..40 {
            surface.update(at(10.4 + 0.02 * f64::from(k)), 1.0);
        }
        assert!((surface.level(at(11.2)).unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(surface.level(at(11.8)), None);
    }

    #[test]
    fn height_after_a_take_off_from_the_deck() {
        let on_deck = HeightInput {
            distance_m: 1.0,
            armed: false,
            landed: LandedState::OnGround,
            origin_sea_m: Some(12.0),
            ..airborne(-0.3)
        };
        let w = after(&[on_deck, airborne(-20.0)]);
        // Its own tide: mean sea level would be 13 m below the deck.
        assert_eq!(code(&judged(&w, 0.5)), None);
        let h = judged(&w, 30.0);
        assert_eq!(code(&h), Some(ReasonCode::HeightsDisagree));
        assert!((h.deck_z.unwrap()).abs() < 1e-9, "{h:?}");
        // One that appears above the deck, and is reported armed late.
        let appears = HeightInput {
            distance_m: 1.0,
            armed: false,
            ..airborne(-8.0)
        };
        assert_eq!(after(&[appears]).take_off_z, None);
        let mut moved = w;
        moved.forget();
        assert_eq!(moved, HeightWitnesses::default());
    }
}

//! Second sources (witnesses) of the deck's height, which confirm or contradict the forecast before a drone descends.
//!
//! Until a camera detects the deck, its height in the drone's NED is the difference of two receivers' heights, and a
//! receiver that ignores the geoid is wrong by up to 100 m. The deck level (NED z) of a second source must therefore
//! agree with the forecast's within the source's error:
//!
//! | witness | deck level | error |
//! |---|---|---|
//! | take-off | feet's level on the deck | drift of barometer or GNSS height in a flight |
//! | mean sea level, from the autopilot's origin | deck's height above still water | tide, receivers, geoid models |
//! | camera | forecast during and since a detection | drift, as for a take-off |
//! | rangefinder | surface below, water or deck: no confirmation, but the drone stays above it | 0.1 m |
//!
//! A relative position that the tags have confirmed counts as the camera.
//!
//! A witness with a *higher* deck level contradicts the forecast if the difference exceeds its error, and the drone
//! then stays high enough for both levels. Without a witness it flies no lower than a pilot has flown it. Mean sea
//! level does not count as a witness if the drone has been lower (inland water below sea level), and it cannot
//! contradict a height that the camera or a take-off from the deck confirms. A take-off level counts until the camera
//! measures another deck level, so a drone with tags in view waits for no other witness.

use alight_shared::{
    estimation::low_pass,
    msg::{LandedState, RangeSample, Reason, ReasonCode},
    time::Span,
    topics,
};
use nalgebra::Vector3;

use super::{MissionNode, phase::DroneTime, situation::relative_age_s};
use crate::mission_config::MissionConfig;

/// Maximum rate at which the mean level follows the forecasts, m/s: many times the drift between two GNSS receivers.
/// The minimum altitude depends on it, and a wrong forecast (such as a deck 20 m below the water, from an estimator
/// without tilt) must not lower it. A permanent jump of the frame counts as an origin reset.
const LEVEL_MPS: f64 = 0.2;
/// Maximum standard deviation of a detected deck's height, m: below that of two receivers, above that of a camera.
const VISION_SD_M: f64 = 0.5;

/// Error of the levels from a take-off and from the last detection, m: a barometer drifts by 1 to 4 m in ten minutes,
/// and the deck's heave is not averaged.
const FLIGHT_DRIFT_M: f64 = 5.0;
/// Error of mean sea level, m: tides of up to 4 m from the mean, two receivers at 2 m each, and geoid models at 1 m.
const SEA_LEVEL_M: f64 = 8.0;
/// Maximum distance between the forecast deck's centre and a disarmed drone on the deck, m: two receivers.
const ON_DECK_M: f64 = 4.0;

/// Time for which a surface must be measured before it is used, and for which it then stays in use, s.
const SURFACE_LASTS_S: f64 = 0.5;
const SURFACE_STALE: Span = Span::from_millis(500);
/// Difference between readings of different surfaces, m: more than waves and less than a deck's edge.
const SURFACE_JUMP_M: f64 = 3.0;
const SURFACE_TIME_S: f64 = 0.5;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Surface {
    /// Times of the first and newest reading, and the surface's NED z, m.
    observed: Option<(DroneTime, DroneTime, f64)>,
}

impl Surface {
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
    /// Level of the surface, NED z, m; None until readings have lasted.
    pub(super) fn level(&self, now: DroneTime) -> Option<f64> {
        let (since, last, level) = self.observed?;
        (now - last <= SURFACE_STALE && (last - since).secs() >= SURFACE_LASTS_S).then_some(level)
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct HeightInput {
    /// Mean level of the deck in the newest forecast, NED z, m.
    pub(super) forecast_z: Option<f64>,
    /// Whether the deck's position comes from the camera, or from a relative position that the tags have confirmed.
    pub(super) observed: bool,
    /// NED z of the centre of mass, m; None without fresh odometry.
    pub(super) own_z: Option<f64>,
    /// Distance of the feet below the centre of mass, m.
    pub(super) feet_m: f64,
    pub(super) distance_m: f64,
    pub(super) landed: LandedState,
    pub(super) armed: bool,
    /// Height of the origin above mean sea level, m.
    pub(super) origin_sea_m: Option<f64>,
    pub(super) flies: bool,
}

/// Deck level of each witness, in the drone's current NED.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct HeightWitnesses {
    /// Mean sea level, NED z, m.
    sea_z: Option<f64>,
    /// Level of the deck at the take-off, NED z, m.
    take_off_z: Option<f64>,
    /// Level of the deck while the camera detected it, NED z, m.
    vision_z: Option<f64>,
    /// Lowest height to which another authority has flown the drone, NED z, m.
    proven_z: Option<f64>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Heights {
    /// Highest deck level of the forecast and any contradicting witnesses, NED z, m.
    pub(super) deck_z: Option<f64>,
    /// Highest level of the water, NED z, m: mean sea level or above until the camera has detected the deck.
    pub(super) water_z: Option<f64>,
    /// Lower limit of the drone's height, NED z, m; None if only the heights above the deck apply.
    pub(super) lowest_z: Option<f64>,
    pub(super) doubt: Option<Reason>,
}

impl Heights {
    /// Adds the limit `clear_m` above a surface at `surface_z` for a drone at `own_z`. The limit does not make the
    /// drone climb, because a range that is too short would follow the drone upwards.
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
    pub(super) fn forget(&mut self) {
        *self = HeightWitnesses::default();
    }

    /// Whether the drone stood on the deck before this flight.
    pub(super) fn stood_on_deck(&self) -> bool {
        self.take_off_z.is_some()
    }

    pub(super) fn update(&mut self, i: &HeightInput, c: &MissionConfig) {
        self.sea_z = i.origin_sea_m;
        let stands = !i.armed || i.landed == LandedState::OnGround;
        if let Some(z) = i.own_z {
            // A drone on the ground climbs clear of the waves first.
            let z = if stands { z - c.minimum_altitude_m } else { z };
            if !i.flies || self.proven_z.is_none() {
                self.proven_z = Some(self.proven_z.map_or(z, |p| p.max(z)));
            }
        }
        // A late heartbeat may report an airborne drone as disarmed.
        let rests = !i.armed && i.landed == LandedState::OnGround;
        if let Some(z) = i.own_z.filter(|_| rests && i.distance_m < ON_DECK_M) {
            self.take_off_z = Some(z + i.feet_m);
        }
        if let Some(z) = i.forecast_z.filter(|_| i.observed) {
            self.vision_z = Some(z);
            // Otherwise the drone stood on a quay or a roof next to the deck.
            self.take_off_z = self
                .take_off_z
                .filter(|level| (level - z).abs() <= FLIGHT_DRIFT_M);
        }
    }

    /// Mean sea level, NED z, m; None if the drone itself has been lower.
    fn sea_z(&self) -> Option<f64> {
        let below = |sea: &f64| self.proven_z.is_some_and(|p| p > sea + SEA_LEVEL_M);
        self.sea_z.filter(|sea| !below(sea))
    }

    /// Deck levels with their errors, m. `deck_m`: height of the deck above still water.
    fn levels(&self, deck_m: f64) -> [Option<(f64, f64)>; 3] {
        [
            self.take_off_z.map(|z| (z, FLIGHT_DRIFT_M)),
            self.sea_z().map(|z| (z - deck_m, SEA_LEVEL_M)),
            self.vision_z.map(|z| (z, FLIGHT_DRIFT_M)),
        ]
    }

    /// Whether a witness confirms this level (NED z, m) and none has a higher one.
    pub(super) fn confirm(&self, z: f64, deck_m: f64) -> bool {
        let [take_off, sea, observed] = self.levels(deck_m);
        self.agree(z, deck_m, [take_off, sea, observed])
    }
    /// Whether witnesses that do not depend on the forecast confirm the level.
    pub(super) fn confirm_aside(&self, z: f64, deck_m: f64) -> bool {
        let [take_off, sea, _] = self.levels(deck_m);
        self.agree(z, deck_m, [take_off, sea, None])
    }
    fn agree(&self, z: f64, deck_m: f64, levels: [Option<(f64, f64)>; 3]) -> bool {
        let near = |(level, err): &(f64, f64)| (z - level).abs() <= *err;
        self.contradiction(z, deck_m).is_none() && levels.iter().flatten().any(near)
    }

    fn contradiction(&self, z: f64, deck_m: f64) -> Option<(f64, f64)> {
        let [take_off, sea, observed] = self.levels(deck_m);
        let confirms = |(level, err): &(f64, f64)| (z - level).abs() <= *err;
        let measured = take_off.iter().chain(&observed).any(confirms);
        [take_off, sea.filter(|_| !measured), observed]
            .into_iter()
            .flatten()
            .filter(|(level, err)| *level < z - err)
            .reduce(|a, b| if b.0 < a.0 { b } else { a })
    }

    /// Assesses a deck at the mean level `mean_z` and at the newest forecast's level (NED z, m). `deck_m`: height of
    /// the deck above still water; `above_m`: approach height above the deck.
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
        // The lower of the two levels decides, because it leads the drone lower.
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
    fn deck_height_m(&self) -> f64 {
        -self.deck_geometry.centre_m[2]
    }

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
                // Converted to the frame that is continuous across jumps of the estimate.
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

    pub(super) fn follow_level(&mut self, at: DroneTime, z: f64) {
        let mean = self.mean_deck_z.map_or(z, |(last, mean)| {
            let limit_m = LEVEL_MPS * (at - last).secs().max(0.0);
            mean + (z - mean).clamp(-limit_m, limit_m)
        });
        // A jump by which vision corrects the radio applies at once if a second witness confirms it.
        let (deck_m, w) = (self.deck_height_m(), &self.heights);
        let rises = z < mean && w.confirm(z, deck_m) && !w.confirm(mean, deck_m);
        let agrees = rises || w.confirm_aside(z, deck_m) && !w.confirm_aside(mean, deck_m);
        self.mean_deck_z = Some((at, if agrees { z } else { mean }));
    }

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

    /// With a receiver that ignores the geoid the deck appears 22 to 51 m too low or too high.
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
            // If the deck appears too high, the drone stays too far above it, which is safe.
            let h = judged(&w, true_z - wrong_m);
            assert_eq!(code(&h), Some(ReasonCode::HeightUnconfirmed));
        }
        // A wrong level in the newest forecast shows before the mean has followed it.
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
        // A drift under the mission's control does not lower the limit; a pilot's flight does.
        let drifts = HeightInput {
            flies: true,
            ..airborne(-17.0)
        };
        w.update(&drifts, &MissionConfig::default());
        assert_eq!(judged(&w, 5.0).lowest_z, Some(-20.0));
        w.update(&airborne(-8.0), &MissionConfig::default());
        assert_eq!(judged(&w, 5.0).lowest_z, Some(-8.0));
        // The limit applies until a camera detects the deck.
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
            let lake = HeightInput {
                origin_sea_m: Some(water_m),
                ..airborne(-10.0)
            };
            let h = judged(&after(&[lake]), -DECK_M);
            let disagrees = code(&h) == Some(ReasonCode::HeightsDisagree);
            assert_eq!(disagrees, contradicts, "{water_m} m: {h:?}");
        }
    }

    /// Radio and sea level have the same origin error; the rangefinder measures the approaching water.
    #[test]
    fn height_above_the_surface_that_the_rangefinder_sees() {
        let deck_z = 40.0;
        let sound = Heights {
            deck_z: Some(deck_z),
            ..Heights::default()
        };
        let observed = |surface_z: f64, own_z: f64| sound.above_surface(surface_z, own_z, ABOVE_M, 3.0);
        // The deck, water below it, or a mast of 8 m.
        for surface_z in [deck_z, deck_z + DECK_M, deck_z - 8.0] {
            assert_eq!(observed(surface_z, deck_z - 20.0), sound);
        }
        let h = observed(0.0, -5.0);
        assert_eq!(
            (h.lowest_z, code(&h)),
            (Some(-3.0), Some(ReasonCode::HeightsDisagree))
        );
        // The drone is already too low, or the beam ends at its feet: the limit is the current height.
        assert_eq!(observed(0.0, -1.0).lowest_z, Some(-1.0));
        assert_eq!(observed(-50.0, -50.5).lowest_z, Some(-50.5));

        let mut surface = Surface::default();
        let at = |s: f64| DroneTime::from_secs(s);
        for k in 0..20 {
            let t = 10.0 + 0.02 * f64::from(k);
            surface.update(at(t), 1.0);
            assert_eq!(surface.level(at(t)), None);
        }
        // A single reading of spray restarts the surface.
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
        // At this tide mean sea level is 13 m below the deck.
        assert_eq!(code(&judged(&w, 0.5)), None);
        let h = judged(&w, 30.0);
        assert_eq!(code(&h), Some(ReasonCode::HeightsDisagree));
        assert!((h.deck_z.unwrap()).abs() < 1e-9, "{h:?}");
        // A quay 8 m above the deck, from which the drone detects the tags before or after its take-off.
        let quay = HeightInput {
            own_z: Some(-8.3),
            ..on_deck
        };
        let sees = HeightInput {
            forecast_z: Some(0.0),
            observed: true,
            ..airborne(-20.0)
        };
        for inputs in [[quay, sees], [sees, quay]] {
            let mut w = after(&inputs);
            w.update(&sees, &MissionConfig::default());
            assert_eq!((w.take_off_z, code(&judged(&w, 0.0))), (None, None));
        }
        assert!(after(&[on_deck, sees]).stood_on_deck());
        // The sea appears 20 m above the deck that the camera measures.
        let wrong = HeightInput {
            origin_sea_m: Some(-20.0),
            ..sees
        };
        assert_eq!(code(&judged(&after(&[wrong]), 0.0)), None);
        let mut moved = w;
        moved.forget();
        assert_eq!(moved, HeightWitnesses::default());
    }
}

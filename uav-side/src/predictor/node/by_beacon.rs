//! Forecast of a vessel that is known only from its beacon or its last position.

use super::*;

/// Time for which the last known level of the deck is used, s; a barometer drifts by a metre in that time.
const LEVEL_S: f64 = 300.0;

impl Predictor {
    /// Forecast from the beacon alone: a level deck on a straight course, at its configured height above mean sea
    /// level. None without a beacon or a sea level from the autopilot.
    pub(super) fn forecast_by_beacon(&mut self, now: DroneTime, ages: [f64; 2]) -> Option<DeckForecast> {
        let known = self.known_by_beacon(now)?;
        let [radio_age_s, vision_age_s] = ages;
        let known_z = (self.filter.as_ref().and_then(Filter::last))
            .filter(|_| radio_age_s.min(vision_age_s) < LEVEL_S)
            .map(|axes| axes[2].project(MeasurementRow::Vision).0);
        let deck_z = match (known_z, self.origin_sea_m) {
            (Some(z), _) => z,
            (None, sea_m) => sea_m? + self.track.newest()?.datum_offset[2] + self.config.deck.centre_m[2],
        };
        let elsewhere = (self.elsewhere).filter(|(at, _)| (now - *at).secs() < self.config.fresh_s);
        let header = Header::new(0, 0, self.boot, self.sequence, now);
        self.sequence = self.sequence.wrapping_add(1);
        let stages = known.stages(deck_z, self.config.stage_s);
        let f = DeckForecast {
            header,
            step: Span::from_secs(self.config.stage_s),
            source: Source::None,
            radio_age_s,
            vision_age_s,
            tag_age_s: self.age_s(now, &[Tag]),
            beacon: Some([known.sd_m, known.age_s]),
            relative: self.relative.state(now),
            decks_in_sight: self.decks.undecided(now),
            place_apart_m: elsewhere.map(|(_, apart)| apart),
            mean_heading: known.course_rad(),
            mean_z: self.level.follow(now, &stages),
            stages,
            surroundings: self.surroundings,
            ..DeckForecast::default()
        };
        f.check().is_ok().then_some(f)
    }
    /// Forecast without a deck: several decks are in view and none is followed.
    pub(super) fn no_forecast(&mut self, now: DroneTime, ages: [f64; 2]) -> Option<DeckForecast> {
        let decks_in_sight = self.decks.undecided(now);
        if decks_in_sight == 0 {
            return None;
        }
        let [radio_age_s, vision_age_s] = ages;
        let header = Header::new(0, 0, self.boot, self.sequence, now);
        self.sequence = self.sequence.wrapping_add(1);
        Some(DeckForecast {
            header,
            step: Span::from_secs(self.config.stage_s),
            radio_age_s,
            vision_age_s,
            tag_age_s: f64::INFINITY,
            relative: self.relative.state(now),
            decks_in_sight,
            ..DeckForecast::default()
        })
    }
    /// More accurate of the estimates from the beacon and from the last known position.
    pub(super) fn known_by_beacon(&self, now: DroneTime) -> Option<BeaconEstimate> {
        let drone = self.track.newest()?;
        let last = self.last_known.as_ref().filter(|_| !self.is_received(now));
        (self.beacon.iter().chain(last))
            .filter_map(|track| track.known(now, drone))
            .min_by(|a, b| a.sd_m.total_cmp(&b.sd_m))
    }
    /// Stores position and velocity of the vessel from fresh measurements.
    pub(super) fn remember(&mut self, now: DroneTime, axes: &[Axis; AXES], source: Source) {
        let Some(drone) = self.track.newest().filter(|_| self.config.beacons) else {
            return;
        };
        if source == Source::None {
            return;
        }
        let modes = self.waves.motion(now);
        let level = |mean: &dyn Fn(usize) -> (f64, f64)| {
            let [north, east] = [0, 1].map(mean);
            Level {
                value: [north.0, east.0],
                sd: north.1.max(east.1).max(0.0).sqrt(),
            }
        };
        let place = level(&|i| {
            let (value, variance) = axes[i].project(MeasurementRow::Vision);
            (value + modes.value[i], variance)
        });
        let velocity = level(&|i| (axes[i].x[RATE], axes[i].p[RATE][RATE]));
        self.last_known = BeaconTrack::of_vessel(now, drone, &place, &velocity);
    }
    /// Updates the sea level and, if the mission permits beacons, the vessel's beacons.
    pub(super) fn receive_beacons(&mut self, now: DroneTime, input: &PredictorIn) {
        if let Some(a) = &input.autopilot {
            self.origin_sea_m = a.origin_sea_m;
        }
        let permitted = self.config.beacons;
        for m in input.beacons.iter().filter(|_| permitted) {
            let admitted = Self::admit(now, m).and_then(|()| {
                let counts = BeaconTrack::receive(&mut self.beacon, now, m);
                counts.then_some(()).ok_or(RejectionReason::Stale)
            });
            self.count(admitted);
        }
    }
}

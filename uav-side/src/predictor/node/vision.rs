//! Measurements of the deck by camera and rangefinder: identification of the deck, check of its position, and fusion.

use super::*;

impl Predictor {
    pub(super) fn measure(&mut self, now: DroneTime, input: &PredictorIn) {
        for m in &input.relative {
            let admitted = self.relative_place(now, m);
            self.count(admitted);
        }
        for m in &input.uvdar {
            let detected = self.observed(now, m, |p, c| observation::uvdar(m, p, c));
            let admitted = detected.and_then(|o| {
                let axes = self.filter.as_ref().map(|f| f.at(&self.waves, o.at));
                self.not_elsewhere(now, axes.as_ref(), &o)?;
                self.vision(now, &o)
            });
            self.count(admitted);
        }
        // All tags of an image are registered first, because each decision depends on the other decks in view.
        let sighted: Vec<_> = input.tags.iter().map(|m| self.sighted(now, m)).collect();
        for detected in sighted {
            let admitted = detected.and_then(|detected| self.identified(now, detected));
            self.count(admitted);
        }
        for m in &input.ranges {
            let admitted = self.range(now, m);
            self.count(admitted);
        }
    }

    pub(super) fn observed(
        &self,
        now: DroneTime,
        m: &impl Message<Clock = DroneClock>,
        observe: impl FnOnce(&super::super::track::Pose, &PredictorConfig) -> DeckObservation,
    ) -> Result<DeckObservation, RejectionReason> {
        Self::admit(now, m)?;
        let pose = self
            .track
            .at(m.header().at)
            .ok_or(RejectionReason::NoDroneState)?;
        Ok(observe(&pose, &self.config))
    }
    /// Deck of the tags, or an error if they are not at the vessel's position.
    pub(super) fn sighted(
        &mut self,
        now: DroneTime,
        m: &TagPose,
    ) -> Result<(DeckObservation, Option<usize>), RejectionReason> {
        let o = self.observed(now, m, |p, c| observation::tag(m, p, c))?;
        let axes = self.filter.as_ref().map(|f| f.at(&self.waves, o.at));
        self.not_elsewhere(now, axes.as_ref(), &o)?;
        let velocity = axes.map_or(Vector2::zeros(), |a| Vector2::new(a[0].x[RATE], a[1].x[RATE]));
        let apart = match (&self.filter, &axes) {
            (Some(filter), Some(axes)) if self.is_received(now) => filter.apart(&self.waves, axes, &o),
            (_, _) => self.known_by_beacon(now).and_then(|b| b.apart(&o)),
        };
        let range_m = (self.track.newest()).map_or(0.0, |d| {
            let place = Vector3::from_fn(|i, _| o.value[i].map_or(0.0, |(v, _)| v));
            (place - d.position()).norm()
        });
        let deck = self.decks.see(&o, range_m, velocity, apart);
        Ok((o, deck))
    }
    /// Fuses tags of deck `k` if that is the vessel's own deck.
    pub(super) fn identified(
        &mut self,
        now: DroneTime,
        (o, k): (DeckObservation, Option<usize>),
    ) -> Result<(), RejectionReason> {
        let radio = self.is_received(now);
        let last = self.filter.as_ref().and_then(Filter::last);
        let compared = last.map_or(o, |s| measurement::without_mount(s, o));
        match k.map(|k| self.decks.verdict(k, &compared, radio)) {
            Some(Verdict::Own) => {
                self.compare_relative(&o);
                self.vision(now, &o)
            }
            Some(Verdict::Other | Verdict::Several(_)) | None => Err(RejectionReason::Outlier),
        }
    }

    pub(super) fn vision(
        &mut self,
        now: DroneTime,
        observation: &DeckObservation,
    ) -> Result<(), RejectionReason> {
        self.fuse_next_to_relative(now, observation)?;
        if let ([Some((north, _)), Some((east, _)), ..], Some(drone), Some(beacon)) =
            (observation.value, self.track.newest(), &mut self.beacon)
        {
            beacon.learn(now, drone, Vector2::new(north, east));
        }
        Ok(())
    }
    /// Whether the radio still gives the vessel's position.
    pub(super) fn is_received(&self, now: DroneTime) -> bool {
        self.age_s(now, &[Estimate]) <= SILENT_S
    }
    /// Rejects a detection that is too far from the vessel's position by radio or beacon.
    pub(super) fn not_elsewhere(
        &mut self,
        now: DroneTime,
        axes: Option<&[Axis; AXES]>,
        o: &DeckObservation,
    ) -> Result<(), RejectionReason> {
        match self.apart_from_radio(now, axes, o) {
            Some(apart) => {
                self.elsewhere = Some((o.at, apart));
                Err(RejectionReason::Outlier)
            }
            None => Ok(()),
        }
    }

    /// Distance between another vessel's tags and the vessel's position, and its limit, m. The vessel's position is the
    /// relative position or the radio's; while the radio is silent and no deck is followed, the beacon's.
    pub(super) fn apart_from_radio(
        &self,
        now: DroneTime,
        axes: Option<&[Axis; AXES]>,
        o: &DeckObservation,
    ) -> Option<[f64; 2]> {
        let followed = self.age_s(now, &CAMERA) < self.config.fresh_s;
        if let Some(apart) = axes.and_then(|axes| self.apart_from_relative(axes, o)) {
            return Some(apart);
        }
        if !self.is_received(now) {
            let beacon = self.known_by_beacon(now).filter(|_| !followed)?;
            return beacon.apart(o).filter(|[apart, limit]| !(apart <= limit));
        }
        let filter = self.filter.as_ref()?;
        filter.elsewhere(&self.waves, axes?, o, followed)
    }

    /// Distance between the positions by vision (of the deck, or of another deck's tags) and by radio, and its limit,
    /// m.
    pub(super) fn place_apart_m(
        &self,
        now: DroneTime,
        filter: &Filter,
        [radio_age_s, vision_age_s]: [f64; 2],
    ) -> Option<[f64; 2]> {
        let fresh_s = self.config.fresh_s;
        let elsewhere = self.elsewhere.filter(|(at, _)| (now - *at).secs() < fresh_s);
        match elsewhere {
            Some((_, apart)) if vision_age_s >= fresh_s => Some(apart),
            // An old radio position does not show where the vessel is now.
            Some(_) | None => (filter.place_apart_m()).filter(|_| radio_age_s < self.config.silence_s),
        }
    }
}

//! Relative position from a receiver with the vessel as its moving base.

use alight_shared::frames::yaw_rotation;

use super::{
    super::{
        axis::DRIFT,
        observation::Plane,
        relative::{self, Use},
    },
    *,
};

impl Predictor {
    /// Processes a relative position. If it is not fixed, or the tags contradict it, it is only reported in the
    /// forecast.
    pub(super) fn relative_place(
        &mut self,
        now: DroneTime,
        m: &RelativePlace,
    ) -> Result<(), RejectionReason> {
        Self::admit(now, m)?;
        let used = self.relative.take(m).ok_or(RejectionReason::Stale)?;
        let at = m.header.at;
        let Some(filter) = self.filter.as_ref().filter(|_| used != Use::Ignore) else {
            return Ok(());
        };
        let pose = self.track.at(at).ok_or(RejectionReason::NoDroneState)?;
        let axes = filter.at(&self.waves, at);
        let deck = measurement::plane(&axes, &self.waves.motion(at), self.waves.lever_arm());
        // The baseline refers to true north, so the rotation removes the compass errors.
        let to_north = yaw_rotation(-axes[5].x[VISION]);
        let heading_sd = axes[5].project(MeasurementRow::Level).1.sqrt();
        let deck = Plane {
            rotation: to_north * deck.rotation,
            ..deck
        };
        let o = relative::observation(m, &pose, &deck, heading_sd, &self.config);
        self.relative.locate(&o);
        if used == Use::Fuse {
            self.fuse(&o)?;
            self.relative.count(at);
        }
        Ok(())
    }
    /// Fuses a detection. Additional camera errors apply while a relative position is in use.
    pub(super) fn fuse_next_to_relative(
        &mut self,
        now: DroneTime,
        o: &DeckObservation,
    ) -> Result<(), RejectionReason> {
        if self.relative.is_in_use(now) {
            self.fuse(&relative::with_camera_error(*o, &self.config))
        } else {
            self.fuse(o)
        }
    }
    /// Compares the vessel's own tags with the relative position. On a contradiction the position derived from it is
    /// discarded, so that the tags are not rejected as outliers.
    pub(super) fn compare_relative(&mut self, tag: &DeckObservation) {
        let comparable = self.relative.is_comparable(tag.at);
        let Some(filter) = self.filter.as_mut().filter(|_| comparable) else {
            return;
        };
        let in_use = self.relative.is_in_use(tag.at);
        let velocity = velocity(&self.waves, &filter.at(&self.waves, tag.at), tag.at);
        if let Some(apart_m) = self.relative.compare(tag, &velocity, &self.config)
            && in_use
        {
            filter.give_up_place(apart_m);
        }
    }
    /// Distance between another detected deck and the relative position, and its limit, m.
    pub(super) fn apart_from_relative(&self, axes: &[Axis; AXES], o: &DeckObservation) -> Option<[f64; 2]> {
        if !self.relative.is_comparable(o.at) {
            return None;
        }
        let velocity = velocity(&self.waves, axes, o.at);
        self.relative.elsewhere(o, &velocity, &self.config)
    }
}

/// Velocity of the deck in the drone's frame at `at`, m/s.
fn velocity(waves: &Waves, axes: &[Axis; AXES], at: DroneTime) -> Vector3<f64> {
    let modes = waves.motion(at);
    Vector3::from_fn(|i, _| axes[i].predicted(MeasurementRow::Rate) + axes[i].x[DRIFT] + modes.rate[i])
}

//! Messages from the vessel: estimate and wave model.

use alight_shared::{
    admission::RejectionReason,
    msg::{VesselEstimate, WaveModel},
    time::{DroneClock, DroneTime},
    vessel_model::YAW,
};

use super::{
    super::{observation, placement::placed},
    Estimate, Predictor,
};

impl Predictor {
    pub(super) fn wave(&mut self, now: DroneTime, m: &WaveModel<DroneClock>) -> Result<(), RejectionReason> {
        Self::admit(now, m)?;
        self.slopes = Some((m.header.at, m.slopes));
        let identified = self.waves.receive(m);
        self.follow_modes(m.header.at, identified);
        Ok(())
    }

    /// Switches the filter to newer modes. `identified`: whether they replace the default oscillators.
    pub(super) fn follow_modes(&mut self, at: DroneTime, identified: bool) {
        match &mut self.filter {
            Some(f) if identified => f.adopt_modes(&self.waves),
            Some(f) => f.rebase(&self.waves, at),
            None => {}
        }
    }

    pub(super) fn estimate(
        &mut self,
        now: DroneTime,
        e: &VesselEstimate<DroneClock>,
    ) -> Result<(), RejectionReason> {
        Self::admit(now, e)?;
        let drone = self.track.newest().ok_or(RejectionReason::NoDroneState)?;
        let e = &placed(e, &drone.datum, &drone.datum_offset()).ok_or(RejectionReason::OutOfRange)?;
        let known = (e.header.boot, e.header.sequence);
        if self.radio_sequence == Some(known) {
            return Err(RejectionReason::Duplicate);
        }
        let o = observation::estimate(e, self.clock_sd_s);
        self.decks.report(&o, observation::deck_height(e));
        let newest = self.fused_at(&[Estimate]);
        self.fuse(&o)?;
        if newest.is_none_or(|t| e.header.at > t) {
            self.radio_sequence = Some(known);
            self.waves.set_lever_arm(e.deck_centre(), e.eta[YAW]);
            self.stated = observation::stated(e);
        }
        Ok(())
    }
}

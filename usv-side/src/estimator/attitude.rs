//! Attitude sensor that replaces a missing inertial sensor. The model propagates the state between attitudes.

use alight_shared::{
    estimation::Update,
    msg::AttitudeFix,
    time::VesselTime,
    vessel_model::{ETA, HEAVE, NU, PITCH, ROLL, Term, YAW, turn_tilt},
};
use nalgebra::Vector3;

use super::{InnovationChannel, STEP_S, VesselFilter};

/// Gate on the normalised innovation squared (5 standard deviations).
const GATE: f64 = 25.0;
/// Number of consecutive attitudes with a rejection after which the covariance is inflated (1 s at 10 Hz).
const MAX_REJECTED: u32 = 11;
/// Silence of the inertial sensor after which the attitude sensor replaces it, s.
const SILENT_S: f64 = 0.5;
/// White noise of an attitude's rates, rad/s (our choice: an INS smooths unbiased rates over tens of ms).
const RATE_SD: f64 = 0.02;

impl VesselFilter {
    pub(super) fn has_inertial(&self, at: VesselTime) -> bool {
        self.imu.measured_at.is_some_and(|t| (at - t).secs() < SILENT_S)
    }

    /// Fuses an attitude. Returns the number of rejected components.
    pub(super) fn fuse_attitude(&mut self, fix: &AttitudeFix) -> u64 {
        let late = (self.at - fix.header.at).secs();
        let last = self.attitude.measured_at;
        let since = last.map_or(STEP_S, |t| (fix.header.at - t).secs());
        let gate = self.attitude.gate(GATE, MAX_REJECTED);
        if gate.is_infinite() {
            self.open();
        }
        let mut rejected = 0;
        // Roll and pitch of the measured deck normal at the reference heading.
        let heading = self.tilt().heading - late * self.belief.get(YAW, NU);
        let (roll, pitch) = turn_tilt(fix.tilt[0], fix.tilt[1], -heading);
        let measured = [
            (InnovationChannel::Tilt, ROLL, Some(roll), fix.tilt_sd),
            (InnovationChannel::Tilt, PITCH, Some(pitch), fix.tilt_sd),
            (InnovationChannel::Heave, HEAVE, fix.heave, fix.heave_sd),
        ];
        for (channel, dof, z, sd) in measured {
            let Some(z) = z else { continue };
            let row = [Term::new(dof, ETA, 1.0), Term::new(dof, NU, -late)];
            let innovation = z - self.belief.predicted(&row);
            let update = self.belief.update(&row, innovation, sd * sd, gate);
            self.consistency.observe(channel, update);
            rejected += u64::from(!update.fused());
            if let Update::Fused { nis } | Update::Rejected { nis } = update {
                self.adaptive_noise.observe(dof, nis.min(GATE), since);
            }
        }
        if let Some(rates) = fix.rates {
            let measured = self.tilt().rates_from_gyro(Vector3::from(rates));
            for (dof, z) in [(ROLL, measured[0]), (PITCH, measured[1]), (YAW, measured[2])] {
                let predicted = self.belief.get(dof, NU) - late * self.belief.acceleration(&self.model, dof);
                let row = [Term::new(dof, NU, 1.0)];
                let update = self.belief.update(&row, z - predicted, RATE_SD * RATE_SD, gate);
                self.consistency.observe(InnovationChannel::Rate, update);
                rejected += u64::from(!update.fused());
            }
        }
        self.attitude.record(fix.header.at, 0.0, rejected == 0);
        rejected
    }
}

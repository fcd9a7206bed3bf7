//! Shadow mode: a person flies, nothing is commanded, and the commands that would have been sent are
//! compared.

use alight_shared::msg::{LandingMode, Motors, Phase, SetPointKind, ShadowComparison};
use alight_shared::topics;
use nalgebra::Vector3;

use super::{AutopilotLink, DroneTime};

impl AutopilotLink {
    /// Set-points, modes, arming and disarming may be commanded. Before one is received it may be a mission that only looks on.
    pub(super) fn may_command(&self) -> bool {
        match self.mode {
            Some(LandingMode::Land | LandingMode::Match) => true,
            Some(LandingMode::Shadow) | None => false,
        }
    }

    /// Comparison of the pilot's set-point and the drone's motion, while a mission that looks on would fly: angle between
    /// the two thrust axes and difference of the velocities. (At the same time: the attitude follows a command by its lag.)
    pub(super) fn shadow(&self, now: DroneTime) -> Option<ShadowComparison> {
        let looks_on = self.mode == Some(LandingMode::Shadow);
        let mission = self.mission.fresh(now, topics::MISSION.stale_after);
        mission.filter(|m| looks_on && m.state.phase() != Phase::None)?;
        let wanted = self.set_point.fresh(now, topics::SET_POINT.stale_after)?;
        let own = self
            .state
            .filter(|s| now - s.header.at <= topics::DRONE_STATE.stale_after)?;
        if wanted.kind == SetPointKind::None {
            return None;
        }
        let (attitude, down) = (wanted.attitude(), Vector3::z());
        let (roll, pitch, _) = attitude.euler_angles();
        Some(ShadowComparison {
            tilt: [roll, pitch],
            thrust: wanted.thrust,
            velocity: wanted.velocity,
            stops: wanted.motors == Motors::Stop,
            apart_rad: (attitude * down).angle(&(own.attitude() * down)),
            apart_mps: (Vector3::from(wanted.velocity) - own.velocity()).norm(),
        })
    }
}

//! Shadow mode: a person flies, nothing is commanded, and the commands that would have been sent are
//! compared.

use alight_shared::msg::{DroneState, LandingMode, Motors, Phase, SetPointKind, ShadowComparison};
use nalgebra::Vector3;

use super::DroneTime;
use super::inputs::LinkInputs;

impl LinkInputs {
    /// Set-points, modes, arming and disarming may be commanded. Before one is received it may be a mission that only looks on.
    pub(super) fn may_command(&self) -> bool {
        match self.mode {
            Some(LandingMode::Land | LandingMode::Match) => true,
            Some(LandingMode::Shadow) | None => false,
        }
    }

    /// Nothing may be commanded.
    pub(super) fn looks_on(&self) -> bool {
        self.mode == Some(LandingMode::Shadow)
    }

    /// Comparison of the pilot's set-point and the drone's motion, while a mission that looks on would fly: angle between
    /// the two thrust axes and difference of the velocities. (At the same time: the attitude follows a command by its lag.)
    pub(super) fn shadow(&self, now: DroneTime, own: Option<DroneState>) -> Option<ShadowComparison> {
        let mission = self.fresh_mission(now);
        mission.filter(|m| self.looks_on() && m.state.phase() != Phase::None)?;
        let (wanted, own) = (self.fresh_set_point(now)?, own?);
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

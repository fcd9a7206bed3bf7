//! Return to a vessel that is not received, at the position extrapolated with its last velocity.
//!
//! A drone returns in this way on a sortie, or when its charge requires it. The position is `p + u t` at the time `t`
//! after the last reception; the required charge allows for its uncertainty ([`super::sortie`]). If the radio is
//! received again, the landing starts as usual. Otherwise the battery's reserve leads to the next place of
//! `battery_order`.

use alight_shared::msg::{Reason, ReasonCode};
use nalgebra::{Vector2, Vector3};

use super::{
    phase::{MAX_VESSEL_DISTANCE_M, MissionPhase, MissionProgress, PhaseTransition, old_data},
    situation::{ControlState, SilentVessel, Situation},
};
use crate::mission_config::MissionConfig;

/// Distance from the vessel's position up to which the drone holds for data, m.
pub(super) const FAR_M: f64 = 100.0;
/// Distance to the target below which the heading stays constant, m.
const ARRIVED_M: f64 = 10.0;

/// Vessel to seek if the drone must return; None without fresh odometry, or with a forecast.
pub(super) fn due(progress: &MissionProgress, s: &Situation) -> Option<SilentVessel> {
    let without = s.fresh_deck().is_none() && s.odometry_age_s <= s.odometry_limit_s && s.moved.is_none();
    let near = |seeks: &SilentVessel| seeks.offset.norm() <= MAX_VESSEL_DISTANCE_M;
    let returns = progress.sortie || s.flight == ControlState::Ours && s.sortie.turns_back.is_some();
    s.sortie.seeks.filter(|_| returns && without).filter(near)
}

fn reason(seeks: &SilentVessel) -> Reason {
    Reason::new(ReasonCode::SeeksVessel, seeks.offset.norm(), seeks.silent_s)
}

pub(super) fn sets_out(
    progress: &mut MissionProgress,
    seeks: &SilentVessel,
    s: &Situation,
) -> PhaseTransition {
    progress.started = s.now;
    MissionPhase::Seek.enter(reason(seeks))
}

pub(super) fn seek(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    if s.fresh_deck().is_some() {
        progress.started = s.now;
        let from = s.own.map_or([0.0; 2], |own| own.position.xy().into());
        let received = Reason::new(ReasonCode::Recovered, 0.0, c.radio_fresh_s);
        return MissionPhase::GetAltitude { from }.enter(received);
    }
    match &s.sortie.seeks {
        Some(seeks) => MissionPhase::Seek.stay(reason(seeks)),
        None => MissionPhase::Seek.stay(old_data(s).unwrap_or(s.no_deck())),
    }
}

/// Target at the approach height above the known deck or at the current height, and heading.
pub(super) fn place(s: &Situation, c: &MissionConfig) -> (Vector3<f64>, f64) {
    let Some((own, seeks)) = s.own.zip(s.sortie.seeks) else {
        let own = s
            .own
            .map_or((Vector3::zeros(), 0.0), |own| (own.position, own.yaw));
        return own;
    };
    let there: Vector2<f64> = own.position.xy() + seeks.offset;
    let level = s.mean_deck_z.map(|m| m - s.approach_height_m(c));
    let z = s.no_lower(level.unwrap_or(own.position.z));
    let far = seeks.offset.norm() > ARRIVED_M;
    let yaw = if far {
        seeks.offset.y.atan2(seeks.offset.x)
    } else {
        own.yaw
    };
    (Vector3::new(there.x, there.y, z), yaw)
}

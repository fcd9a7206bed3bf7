//! The way back to a vessel that is not received: to where its last velocity has brought it, until it is.
//!
//! A drone on a sortie flies it, and any other once its charge calls it back. The place is `p + u t` after the time `t` since the vessel
//! was received; how far from there it may be is in what the way is taken to cost ([`super::sortie`]). With the radio back the
//! landing begins as any. With nothing received the battery's reserve sends the drone to the next place of `battery_order`.

use alight_shared::msg::{Reason, ReasonCode};
use nalgebra::{Vector2, Vector3};

use super::phase::{MAX_VESSEL_DISTANCE_M, MissionPhase, MissionProgress, PhaseTransition, old_data};
use super::situation::{ControlState, SilentVessel, Situation};
use crate::mission_config::MissionConfig;

/// A hold for want of data is no place to wait further away than this, m.
pub(super) const FAR_M: f64 = 100.0;
/// No turn of the heading nearer to the place than this, m.
const ARRIVED_M: f64 = 10.0;

/// Whether a drone that has to come back seeks its vessel: on a sortie or by its charge, by odometry that is fresh, without a
/// forecast.
pub(super) fn due(progress: &MissionProgress, s: &Situation) -> Option<SilentVessel> {
    let without = s.fresh_deck().is_none() && s.odometry_age_s <= s.odometry_limit_s && s.moved.is_none();
    let near = |seeks: &SilentVessel| seeks.offset.norm() <= MAX_VESSEL_DISTANCE_M;
    let returns = progress.sortie || s.flight == ControlState::Ours && s.sortie.turns_back.is_some();
    s.sortie.seeks.filter(|_| returns && without).filter(near)
}

/// Why it is on its way: how far, m, and how long the vessel has been silent, s.
fn reason(seeks: &SilentVessel) -> Reason {
    Reason::new(ReasonCode::SeeksVessel, seeks.offset.norm(), seeks.silent_s)
}

/// Sets out for it.
pub(super) fn sets_out(
    progress: &mut MissionProgress,
    seeks: &SilentVessel,
    s: &Situation,
) -> PhaseTransition {
    progress.started = s.now;
    MissionPhase::Seek.enter(reason(seeks))
}

/// Seek: until the vessel is received.
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

/// Place and heading of the drone: at the approach height over the level that is known, or as high as it is.
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

//! Position of a drone that does not follow the deck: a waiting place, a position that moves with the deck, or a fixed
//! one.

use nalgebra::Vector3;

use super::{
    phase::{HoldCause, MissionPhase, hold_height, moving_place, stands_aside},
    search, seek,
    situation::Situation,
    station,
};
use crate::mission_config::MissionConfig;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Waypoint {
    /// Drone's NED, m.
    pub(super) at: Vector3<f64>,
    /// Heading, rad.
    pub(super) yaw: f64,
    /// Height over the deck's mean level, m.
    pub(super) height_m: f64,
    pub(super) with_deck: bool,
    /// Waiting place relative to the deck's centre, NED, m.
    pub(super) offset: Option<[f64; 2]>,
}

impl Waypoint {
    pub(super) fn of(phase: MissionPhase, s: &Situation, c: &MissionConfig) -> Waypoint {
        let (own, own_yaw) = s.own.map_or((Vector3::zeros(), 0.0), |o| (o.position, o.yaw));
        let here = Waypoint {
            at: own,
            yaw: own_yaw,
            height_m: s.approach_height_m(c),
            with_deck: false,
            offset: None,
        };
        let held = |at, yaw, leaves| Waypoint {
            at,
            yaw,
            with_deck: moving_place(&at, s, leaves).0,
            offset: stands_aside(&at, s, leaves),
            ..here
        };
        match phase {
            MissionPhase::GetAltitude { from: [x, y] } => {
                let z = s.mean_deck_z.map_or(own.z, |m| s.no_lower(m - here.height_m));
                let at = Vector3::new(x, y, z);
                let leaves = s.place.is_some() && moving_place(&at, s, false).0;
                Waypoint {
                    at,
                    yaw: s.deck.filter(|_| !leaves).map_or(own_yaw, |d| d.bearing_rad),
                    with_deck: leaves,
                    ..here
                }
            }
            MissionPhase::Hold {
                at,
                yaw,
                cause: HoldCause::Station(kept),
                ..
            } => Waypoint {
                height_m: f64::from(kept.station.height_m),
                offset: station::offset(&kept, &at, s, c),
                ..held(at, yaw, false)
            },
            MissionPhase::Hold { at, yaw, .. } => Waypoint {
                height_m: hold_height(s, c),
                ..held(at, yaw, false)
            },
            MissionPhase::GaveUp { at, yaw } => held(at, yaw, true),
            MissionPhase::ClimbOut { at, yaw, .. } => Waypoint {
                offset: None,
                ..held(at, yaw, true)
            },
            MissionPhase::Approach { .. } => here.approaching(s, c),
            MissionPhase::Seek => {
                let (at, yaw) = seek::place(s, c);
                Waypoint { at, yaw, ..here }
            }
            MissionPhase::Search(looks) => Waypoint {
                height_m: search::height_m(c),
                offset: s.fresh_deck().and_then(|d| looks.offset(d, c)),
                ..here
            },
            MissionPhase::Idle
            | MissionPhase::Preparing
            | MissionPhase::Countdown { .. }
            | MissionPhase::SpinUp { .. }
            | MissionPhase::TakeOff { .. }
            | MissionPhase::StandDown { .. } => here,
            MissionPhase::Tracking { .. }
            | MissionPhase::TrackingStable
            | MissionPhase::Descent { .. }
            | MissionPhase::Flare { .. }
            | MissionPhase::Landed { .. } => Waypoint {
                height_m: c.tracking_height_m,
                ..here
            },
        }
    }

    fn approaching(self, s: &Situation, c: &MissionConfig) -> Waypoint {
        let waits = s.waits(c).is_some();
        let above = s.fresh_deck().is_some_and(|d| d.distance_m < d.ring_m);
        Waypoint {
            height_m: match (s.place, s.mean_deck_z) {
                (None, Some(mean)) if waits => mean - self.at.z,
                _ if above && !waits => c.approach_height_m,
                _ => self.height_m,
            },
            offset: s.waiting_offset().filter(|_| waits),
            ..self
        }
    }
}

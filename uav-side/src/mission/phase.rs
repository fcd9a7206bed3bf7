//! States with their data, and transitions between them.

use alight_shared::{
    msg::{BatteryPlace, KeptStation, Reason, ReasonCode, State, WAITING_DISTANCE_M},
    time::{DroneClock, Time},
};
use nalgebra::Vector3;

use super::{
    cycles::Cycles,
    limits::exceeds,
    situation::{Deck, Situation},
};
use crate::{
    contingency::{BELOW_M, HARD_MPS},
    mission_config::MissionConfig,
    surroundings::WITH_DECK_M,
};

pub(super) type DroneTime = Time<DroneClock>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldCause {
    /// Hold ordered by an operator; ends with the next order to land.
    Operator,
    /// Hold because data were stale; ends when they are fresh.
    Data,
    Station(KeptStation),
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Search {
    /// Start of the search, and time of its last step.
    pub(super) since: DroneTime,
    pub(super) at: DroneTime,
    pub(super) flown_m: f64,
    /// Time of arrival at the end of the path.
    pub(super) ended: Option<DroneTime>,
    /// Time since which the tags have been detected.
    pub(super) detected: Option<DroneTime>,
}

/// State of the mission, with its data.
///
/// A field of type `Option<DroneTime>` is the time since which the named condition has held. `at` is a position in the
/// drone's NED, m; `yaw` a heading, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MissionPhase {
    #[default]
    Idle,
    GetAltitude {
        /// Start position, NED, north and east, m.
        from: [f64; 2],
    },
    Approach {
        detected: Option<DroneTime>,
    },
    Search(Search),
    Seek,
    Tracking {
        steady: Option<DroneTime>,
    },
    TrackingStable,
    Descent {
        violated: Option<DroneTime>,
        paused: Option<DroneTime>,
    },
    Flare {
        /// Whether only hard reasons break off the flare.
        committed: bool,
        violated: Option<DroneTime>,
    },
    Landed {
        disarmed: bool,
        airborne: Option<DroneTime>,
    },
    Hold {
        cause: HoldCause,
        at: Vector3<f64>,
        yaw: f64,
        fresh: Option<DroneTime>,
    },
    GaveUp {
        at: Vector3<f64>,
        yaw: f64,
    },
    /// Checks on the deck before the countdown.
    Preparing,
    Countdown {
        since: DroneTime,
    },
    /// Stands on the deck with the motors started.
    SpinUp {
        since: DroneTime,
        armed: Option<DroneTime>,
    },
    TakeOff {
        since: DroneTime,
        left: bool,
    },
    ClimbOut {
        since: DroneTime,
        at: Vector3<f64>,
        yaw: f64,
        /// Whether an operator has stopped the climb-out; the drone then holds once clear of the vessel.
        stopped: bool,
    },
    /// On the deck after a stopped take-off.
    StandDown {
        since: DroneTime,
        /// Reason for the stop, unless the autopilot was reported armed.
        unarmed: Option<Reason>,
    },
}

impl MissionPhase {
    pub(super) const TRACKING: MissionPhase = MissionPhase::Tracking { steady: None };
    pub(super) const DESCENT: MissionPhase = MissionPhase::Descent {
        violated: None,
        paused: None,
    };
    pub(super) const LANDED: MissionPhase = MissionPhase::Landed {
        disarmed: false,
        airborne: None,
    };
    pub(super) const STANDS: MissionPhase = MissionPhase::Landed {
        disarmed: true,
        airborne: None,
    };
    pub(super) const APPROACH: MissionPhase = MissionPhase::Approach { detected: None };

    pub const fn state(&self) -> State {
        match self {
            MissionPhase::Idle => State::Idle,
            MissionPhase::GetAltitude { .. } => State::GetAltitude,
            MissionPhase::Approach { .. } => State::Approach,
            MissionPhase::Search(_) | MissionPhase::Seek => State::Search,
            MissionPhase::Tracking { .. } => State::Tracking,
            MissionPhase::TrackingStable => State::TrackingStable,
            MissionPhase::Descent { .. } => State::Descent,
            MissionPhase::Flare { .. } => State::Flare,
            MissionPhase::Landed { .. } => State::Landed,
            MissionPhase::Hold { .. } => State::Hold,
            MissionPhase::GaveUp { .. } => State::GaveUp,
            MissionPhase::Preparing => State::Preparing,
            MissionPhase::Countdown { .. } => State::Countdown,
            MissionPhase::SpinUp { .. } => State::SpinUp,
            MissionPhase::TakeOff { .. } => State::TakeOff,
            MissionPhase::ClimbOut { .. } => State::ClimbOut,
            MissionPhase::StandDown { .. } => State::StandDown,
        }
    }
    pub(super) fn stay(self, why: impl Into<Reason>) -> PhaseTransition {
        PhaseTransition::Stay(self, why.into())
    }
    pub(super) fn enter(self, why: impl Into<Reason>) -> PhaseTransition {
        PhaseTransition::Go(self, why.into())
    }
    pub(super) const fn flies(&self) -> bool {
        !self.stands() && !matches!(self, MissionPhase::Idle | MissionPhase::Landed { .. })
    }
    /// Whether the drone stands on the deck for a take-off, or after a stopped one.
    pub(super) const fn stands(&self) -> bool {
        self.state().stands_for_take_off()
    }
    /// Whether climbing is the only safe action.
    pub(super) const fn takes_off(&self) -> bool {
        matches!(self, MissionPhase::TakeOff { .. } | MissionPhase::ClimbOut { .. })
    }
    pub(super) const fn has_left(&self) -> bool {
        matches!(
            self,
            MissionPhase::TakeOff { left: true, .. } | MissionPhase::ClimbOut { .. }
        )
    }
    /// Whether the drone holds, or climbs to a hold.
    pub(super) const fn rests(&self) -> bool {
        matches!(self, MissionPhase::Hold { .. } | MissionPhase::GaveUp { .. })
    }
    pub(super) const fn waits_for_data(&self) -> bool {
        matches!(
            self,
            MissionPhase::Idle
                | MissionPhase::Hold {
                    cause: HoldCause::Data,
                    ..
                }
        )
    }
    pub(super) const fn waits_for_operator(&self) -> bool {
        matches!(
            self,
            MissionPhase::Hold {
                cause: HoldCause::Operator | HoldCause::Station(_),
                ..
            }
        )
    }
    pub(super) const fn station(&self) -> Option<KeptStation> {
        match self {
            MissionPhase::Hold {
                cause: HoldCause::Station(kept),
                ..
            } => Some(*kept),
            _ => None,
        }
    }
    /// Whether the mission intends to land and depends on fresh data.
    pub(super) const fn needs_data(&self) -> bool {
        self.flies()
            && !self.takes_off()
            && !matches!(
                self,
                MissionPhase::Hold { .. } | MissionPhase::GaveUp { .. } | MissionPhase::Seek
            )
    }
}

/// Time for which a rejection is reported, s: as long as the vessel repeats the order, plus one report.
const SHOWN_S: f64 = 15.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectedOrder {
    pub(super) at: DroneTime,
    pub(super) why: Reason,
}

impl RejectedOrder {
    pub(super) fn shown(&self, now: DroneTime) -> Option<Reason> {
        ((now - self.at).secs() <= SHOWN_S).then_some(self.why)
    }
}

/// Progress that persists across states.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MissionProgress {
    pub landing: bool,
    pub attempts: u32,
    /// Start of the landing, of the take-off, or of the hold after it.
    pub started: DroneTime,
    /// Whether a landing was ordered below the battery's reserve, which makes the deck the first choice.
    pub deck_first: bool,
    /// Whether an operator has stopped a landing on low battery, so that the deck is not chosen again.
    pub deck_declined: bool,
    /// Whether the drone has been armed since the order, so that the order ends with the flight.
    pub armed: bool,
    /// Time since which the deck has been closed, reserved, unknown or undetected.
    pub missing: Option<DroneTime>,
    /// Time since which the drone has hovered without an order within reach of waves.
    pub low_since: Option<DroneTime>,
    /// Landing place chosen at the battery's reserve.
    pub low_battery: Option<BatteryPlace>,
    /// Whether an operator has stopped the mission and ordered no landing since. A landing too close to the deck for a
    /// climb is still completed.
    pub stopped: bool,
    /// Whether the pilot node's touchdown was false and is ignored until withdrawn.
    pub overruled: bool,
    /// Last step of a committed flare with fresh data. Since then the drone may have touched the deck unobserved.
    pub flared: Option<DroneTime>,
    /// Whether set-points were lost and the autopilot holds; the landing resumes once they are followed again.
    pub set_points_lost: bool,
    /// Station before the computer restarted; the drone returns to it once it is under our control.
    pub station: Option<KeptStation>,
    /// Whether the drone has taken off and not landed since; it then returns while its battery lasts.
    pub sortie: bool,
    pub cycles: Cycles,
    /// Position at which a beacon alone began to lead the drone, drone's NED, north and east, m.
    pub led_from: Option<[f64; 2]>,
    pub rejected: Option<RejectedOrder>,
}

impl MissionProgress {
    /// Whether the battery is low and the deck is the place to land.
    pub(super) fn is_urgent(&self) -> bool {
        self.low_battery == Some(BatteryPlace::Deck)
    }
}

pub(super) enum PhaseTransition {
    Stay(MissionPhase, Reason),
    Go(MissionPhase, Reason),
    BreakOff(Reason),
}

/// Maximum distance to a vessel, m, because a wrong origin could place it anywhere.
pub const MAX_VESSEL_DISTANCE_M: f64 = 5e3;

/// Reason if the vessel is beyond that distance, or too far for a beacon alone.
pub(super) fn too_far(deck: &Deck, c: &MissionConfig) -> Option<Reason> {
    let by_beacon = deck.beacon.is_some() && deck.radio_age_s > c.radio_fresh_s;
    let limit_m = if by_beacon {
        c.beacon_max_way_m
    } else {
        MAX_VESSEL_DISTANCE_M
    };
    exceeds(ReasonCode::VesselTooFar, deck.distance_m, limit_m)
}

pub(super) fn old_data(s: &Situation) -> Option<Reason> {
    exceeds(ReasonCode::OdometryStale, s.odometry_age_s, s.odometry_limit_s)
        .or(s.moved)
        .or_else(|| exceeds(ReasonCode::ForecastStale, s.forecast_age_s, s.forecast_limit_s))
        .or_else(|| s.deck.is_none().then(|| s.no_deck()))
}

pub(super) fn hard_contact(s: &Situation) -> Option<Reason> {
    let reason = |mps| Reason::new(ReasonCode::HardContact, mps, HARD_MPS);
    s.hard_contact_mps.map(reason)
}

/// Start and duration (s) of the period in which `holds` has been true.
pub(super) fn lasting(holds: bool, since: Option<DroneTime>, now: DroneTime) -> (Option<DroneTime>, f64) {
    if !holds {
        return (None, 0.0);
    }
    let since = since.unwrap_or(now);
    (Some(since), (now - since).secs())
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    pub phase: MissionPhase,
    pub progress: MissionProgress,
    /// Reason for a change of state; None without a change.
    pub entered: Option<Reason>,
    pub waiting: Reason,
}

/// Height above the deck of a hold, m, or of the drone's waiting place, because others may be below it.
pub(super) fn hold_height(s: &Situation, c: &MissionConfig) -> f64 {
    s.place.map_or(c.tracking_height_m, |_| s.approach_height_m(c))
}

/// Hold at the drone's position, at least at [`hold_height`] and the minimum altitude ([`moving_place`]).
pub(super) fn holding(cause: HoldCause, s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, hold_height(s, c));
    MissionPhase::Hold {
        cause,
        at,
        yaw,
        fresh: None,
    }
}

/// Climb to the approach height over the deck ([`moving_place`]).
pub(super) fn gave_up(s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, s.approach_height_m(c));
    MissionPhase::GaveUp { at, yaw }
}

/// Climb away from the vessel after a take-off, to the approach height above the deck.
pub(super) fn climbing_out(s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, s.approach_height_m(c));
    MissionPhase::ClimbOut {
        since: s.now,
        at,
        yaw,
        stopped: false,
    }
}

/// Whether the drone moves with the deck on the way to `at`, and the resulting position. Below the height of `at` it
/// keeps its position over the deck, because structures of a moving vessel would hit a drone that stops. The position
/// becomes fixed at that height, far from the deck, or with a stale forecast. A drone that `leaves` a vessel with an
/// escape direction continues until it is clear of the vessel.
pub(super) fn moving_place(at: &Vector3<f64>, s: &Situation, leaves: bool) -> (bool, Vector3<f64>) {
    let near = s.fresh_deck().filter(|d| d.distance_m < d.ring_m);
    let escapes = leaves && near.is_some_and(|d| d.escapes);
    let low = s.own.filter(|own| escapes || own.position.z > at.z + BELOW_M);
    low.filter(|_| near.is_some()).map_or((false, *at), |own| {
        (true, Vector3::new(own.position.x, own.position.y, at.z))
    })
}

/// Waiting place, relative to the deck's centre (NED, m), of a drone after its landing; None if it stays at `at`.
pub(super) fn stands_aside(at: &Vector3<f64>, s: &Situation, leaves: bool) -> Option<[f64; 2]> {
    let near = |d: &&Deck| d.distance_m < WAITING_DISTANCE_M + WITH_DECK_M;
    let here = s.place.is_some() && s.fresh_deck().filter(near).is_some() && !moving_place(at, s, leaves).0;
    s.waiting_offset().filter(|_| here)
}

/// Position of a drone that holds at `at`: it moves with the deck during the climb, then clear of other drones.
pub(super) fn held_place(at: &Vector3<f64>, s: &Situation, leaves: bool) -> Vector3<f64> {
    match (stands_aside(at, s, leaves), s.own) {
        (Some(_), Some(own)) => Vector3::new(own.position.x, own.position.y, at.z),
        (Some(_) | None, _) => moving_place(at, s, leaves).1,
    }
}

/// Position straight above (or at) the drone, at least `height` above the deck's mean level.
fn safe_place(s: &Situation, c: &MissionConfig, height: f64) -> (Vector3<f64>, f64) {
    let (mut at, yaw) = s
        .own
        .map_or((Vector3::zeros(), 0.0), |own| (own.position, own.yaw));
    if let Some(mean) = s.mean_deck_z {
        at.z = at.z.min(mean - height);
    }
    at.z = at.z.min(s.water_z - c.minimum_altitude_m);
    (Vector3::new(at.x, at.y, s.no_lower(at.z)), yaw)
}

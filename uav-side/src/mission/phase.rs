//! States with their data, and the next steps of a state.

use alight_shared::msg::{BatteryPlace, KeptStation, Reason, ReasonCode, State, WAITING_DISTANCE_M};
use alight_shared::time::{DroneClock, Time};
use nalgebra::Vector3;

use super::cycles::Cycles;
use super::limits::exceeds;
use super::situation::{Deck, Situation};
use crate::contingency::{BELOW_M, HARD_MPS};
use crate::mission_config::MissionConfig;
use crate::surroundings::WITH_DECK_M;

pub(super) type DroneTime = Time<DroneClock>;

/// Why a hold began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldCause {
    /// An operator commanded it; ends with the next landing command.
    Operator,
    /// Data were old; ends when they are fresh again.
    Data,
    /// On a station that an operator has ordered.
    Station(KeptStation),
}

/// Progress of the search.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Search {
    /// Since when it lasts, and when it last went on.
    pub(super) since: DroneTime,
    pub(super) at: DroneTime,
    /// Path of the spiral so far, m.
    pub(super) flown_m: f64,
    /// It is at the path's end since.
    pub(super) ended: Option<DroneTime>,
    /// The tags have been detected since.
    pub(super) detected: Option<DroneTime>,
}

/// A state with what it has to remember.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MissionPhase {
    #[default]
    Idle,
    /// Straight up or down.
    GetAltitude {
        /// North and east where it began, m.
        from: [f64; 2],
    },
    /// Towards the vessel.
    Approach {
        /// Detected since.
        detected: Option<DroneTime>,
    },
    /// Looks for a deck that is known by a beacon alone.
    Search(Search),
    /// Towards a vessel that is not received.
    Seek,
    /// Over the vessel.
    Tracking {
        /// Steady since.
        steady: Option<DroneTime>,
    },
    /// Steady over the vessel.
    TrackingStable,
    /// Descends to the flare.
    Descent {
        /// A condition has been violated since.
        violated: Option<DroneTime>,
        /// Waits at the decision clearance since.
        paused: Option<DroneTime>,
    },
    /// Descends to the deck.
    Flare {
        /// Below the commit clearance: only hard reasons break it off.
        committed: bool,
        /// A condition has been violated since.
        violated: Option<DroneTime>,
    },
    /// On the deck.
    Landed {
        /// The autopilot was disarmed meanwhile.
        disarmed: bool,
        /// The rotors have carried it above the deck since.
        airborne: Option<DroneTime>,
    },
    /// Stays at a safe height.
    Hold {
        cause: HoldCause,
        /// Place, drone's NED, m.
        at: Vector3<f64>,
        /// Heading, rad.
        yaw: f64,
        /// Data have been fresh since.
        fresh: Option<DroneTime>,
    },
    /// Ended without landing.
    GaveUp {
        /// Place where it stays, drone's NED, m.
        at: Vector3<f64>,
        /// Heading, rad.
        yaw: f64,
    },
    /// On the deck, checked before a take-off.
    Preparing,
    /// On the deck, before the motors start.
    Countdown { since: DroneTime },
    /// On the deck with the motors started.
    SpinUp {
        since: DroneTime,
        /// The autopilot has been armed since.
        armed: Option<DroneTime>,
    },
    /// Leaves the deck.
    TakeOff {
        since: DroneTime,
        /// The feet have left the deck.
        left: bool,
    },
    /// Away from the vessel, up to the height of the approach.
    ClimbOut {
        since: DroneTime,
        /// Place where it will hold, drone's NED, m.
        at: Vector3<f64>,
        /// Heading, rad.
        yaw: f64,
        /// An operator has stopped it: it holds as soon as it is clear of the vessel.
        stopped: bool,
    },
    /// On the deck after a take-off that was stopped.
    StandDown {
        /// Since.
        since: DroneTime,
        /// Not reported armed since: why the take-off was stopped.
        unarmed: Option<Reason>,
    },
}

impl MissionPhase {
    /// Over the vessel, not steady yet.
    pub(super) const TRACKING: MissionPhase = MissionPhase::Tracking { steady: None };
    /// A descent that nothing disturbs yet.
    pub(super) const DESCENT: MissionPhase = MissionPhase::Descent {
        violated: None,
        paused: None,
    };
    /// On the deck, not disarmed yet.
    pub(super) const LANDED: MissionPhase = MissionPhase::Landed {
        disarmed: false,
        airborne: None,
    };
    /// On the deck, disarmed.
    pub(super) const STANDS: MissionPhase = MissionPhase::Landed {
        disarmed: true,
        airborne: None,
    };
    /// On the way to the vessel, not detected yet.
    pub(super) const APPROACH: MissionPhase = MissionPhase::Approach { detected: None };

    /// State for messages.
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
    /// Stays in this phase, waiting for `why`.
    pub(super) fn stay(self, why: impl Into<Reason>) -> PhaseTransition {
        PhaseTransition::Stay(self, why.into())
    }
    /// Goes to this phase for the reason `why`.
    pub(super) fn enter(self, why: impl Into<Reason>) -> PhaseTransition {
        PhaseTransition::Go(self, why.into())
    }
    /// Whether the mission flies the drone.
    pub(super) const fn flies(&self) -> bool {
        !self.stands() && !matches!(self, MissionPhase::Idle | MissionPhase::Landed { .. })
    }
    /// Whether the drone stands on the deck to take off, or because that was stopped.
    pub(super) const fn stands(&self) -> bool {
        self.state().stands_for_take_off()
    }
    /// Whether it leaves the deck: nothing but up is safe.
    pub(super) const fn takes_off(&self) -> bool {
        matches!(self, MissionPhase::TakeOff { .. } | MissionPhase::ClimbOut { .. })
    }
    /// Whether it has left the deck, and is not at the end of the take-off yet.
    pub(super) const fn has_left(&self) -> bool {
        matches!(
            self,
            MissionPhase::TakeOff { left: true, .. } | MissionPhase::ClimbOut { .. }
        )
    }
    /// Whether it holds, or climbs to hold.
    pub(super) const fn rests(&self) -> bool {
        matches!(self, MissionPhase::Hold { .. } | MissionPhase::GaveUp { .. })
    }
    /// Whether it holds until an operator commands a landing.
    pub(super) const fn waits_for_operator(&self) -> bool {
        matches!(
            self,
            MissionPhase::Hold {
                cause: HoldCause::Operator | HoldCause::Station(_),
                ..
            }
        )
    }
    /// The station that it keeps.
    pub(super) const fn station(&self) -> Option<KeptStation> {
        match self {
            MissionPhase::Hold {
                cause: HoldCause::Station(kept),
                ..
            } => Some(*kept),
            _ => None,
        }
    }
    /// Whether the mission still intends to land and depends on fresh data.
    pub(super) const fn needs_data(&self) -> bool {
        self.flies()
            && !self.takes_off()
            && !matches!(
                self,
                MissionPhase::Hold { .. } | MissionPhase::GaveUp { .. } | MissionPhase::Seek
            )
    }
}

/// Why an order was rejected is shown for so long, s: until the vessel has given the order up, and a report after that.
const SHOWN_S: f64 = 15.0;

/// An order that was rejected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectedOrder {
    pub(super) at: DroneTime,
    pub(super) why: Reason,
}

impl RejectedOrder {
    /// Why, while that is shown.
    pub(super) fn shown(&self, now: DroneTime) -> Option<Reason> {
        ((now - self.at).secs() <= SHOWN_S).then_some(self.why)
    }
}

/// Progress that outlasts a state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MissionProgress {
    /// A landing is wanted.
    pub landing: bool,
    /// Descents begun since the command.
    pub attempts: u32,
    /// When the landing, the take-off or the hold in which that ends was begun.
    pub started: DroneTime,
    /// The operator asked for a landing below the battery's reserve: the deck is the first place until the landing ends.
    pub deck_first: bool,
    /// An operator has stopped a landing that the low battery had brought about: the deck is not chosen again.
    pub deck_declined: bool,
    /// The drone was armed since the order: that ends with the flight.
    pub armed: bool,
    /// The deck is closed, another drone's, unknown or not detected since.
    pub missing: Option<DroneTime>,
    /// It hovers without an order lower than waves reach since.
    pub low_since: Option<DroneTime>,
    /// The battery's reserve was reached: where it lands.
    pub low_battery: Option<BatteryPlace>,
    /// An operator stopped what the mission did, and has commanded no landing since. In descent or flare: too
    /// near to the deck for a climb, the landing is completed.
    pub stopped: bool,
    /// The pilot's touchdown was false: its stop counts for nothing until it is taken back.
    pub overruled: bool,
    /// Set-points ceased and the autopilot holds: the landing goes on once they are back.
    pub lapsed: bool,
    /// The station that it kept before its computer began again: it goes on there once the drone is ours.
    pub station: Option<KeptStation>,
    /// It has taken off from the deck, and not landed since: it comes back while the battery lasts.
    pub sortie: bool,
    /// Sorties one after the other.
    pub cycles: Cycles,
    /// Place where a beacon alone began to lead it, drone's NED, north and east, m.
    pub led_from: Option<[f64; 2]>,
    /// The order that was rejected last.
    pub rejected: Option<RejectedOrder>,
}

impl MissionProgress {
    /// The battery is low, and the deck is the place to land.
    pub(super) fn is_urgent(&self) -> bool {
        self.low_battery == Some(BatteryPlace::Deck)
    }
}

/// Next transition of a state.
pub(super) enum PhaseTransition {
    /// Stays, waiting for this.
    Stay(MissionPhase, Reason),
    /// Goes to that phase for this reason.
    Go(MissionPhase, Reason),
    /// Breaks the landing off for this reason.
    BreakOff(Reason),
}

/// No drone flies to a vessel further away than this, m: an origin that is wrong lies anywhere.
pub const MAX_VESSEL_DISTANCE_M: f64 = 5e3;

/// The vessel is further away than anybody means to fly, or to be led by a beacon alone.
pub(super) fn too_far(deck: &Deck, c: &MissionConfig) -> Option<Reason> {
    let by_beacon = deck.beacon.is_some() && deck.radio_age_s > c.radio_fresh_s;
    let limit_m = if by_beacon {
        c.beacon_max_way_m
    } else {
        MAX_VESSEL_DISTANCE_M
    };
    exceeds(ReasonCode::VesselTooFar, deck.distance_m, limit_m)
}

/// Data that are too old to go on.
pub(super) fn old_data(s: &Situation) -> Option<Reason> {
    exceeds(ReasonCode::OdometryStale, s.odometry_age_s, s.odometry_limit_s)
        .or(s.moved)
        .or_else(|| exceeds(ReasonCode::ForecastStale, s.forecast_age_s, s.forecast_limit_s))
        .or_else(|| s.deck.is_none().then(|| s.no_deck()))
}

/// The hard contact that was noticed.
pub(super) fn hard_contact(s: &Situation) -> Option<Reason> {
    let reason = |mps| Reason::new(ReasonCode::HardContact, mps, HARD_MPS);
    s.hard_contact_mps.map(reason)
}

/// Since when `holds` has been true, and for how long, s.
pub(super) fn lasting(holds: bool, since: Option<DroneTime>, now: DroneTime) -> (Option<DroneTime>, f64) {
    if !holds {
        return (None, 0.0);
    }
    let since = since.unwrap_or(now);
    (Some(since), (now - since).secs())
}

/// Decision of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// The phase from now on.
    pub phase: MissionPhase,
    /// Progress that is kept with it.
    pub progress: MissionProgress,
    /// Why the state changed; None when it did not.
    pub entered: Option<Reason>,
    /// Why the next state is not entered yet.
    pub waiting: Reason,
}

/// Height of a hold over the deck, m: with a waiting place that one's, since between deck and place there may be others.
pub(super) fn hold_height(s: &Situation, c: &MissionConfig) -> f64 {
    s.place.map_or(c.tracking_height_m, |_| s.approach_height_m(c))
}

/// Hold where the drone is, not below the height of a hold over the deck ([`hold_height`]) nor the minimum altitude ([`moving_place`]).
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

/// Away from the vessel after a take-off, up to the approach height over the deck.
pub(super) fn climbing_out(s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, s.approach_height_m(c));
    MissionPhase::ClimbOut {
        since: s.now,
        at,
        yaw,
        stopped: false,
    }
}

/// Whether the drone is low over the deck on its way to `at`, and where it holds. Until it is as high as there, it stays
/// in place over the deck and moves with it: what stands on a vessel under way would meet a drone that stops before it is
/// clear of all that. A drone that comes so high, a deck far away or a stale forecast leave the place where it is then. One
/// that `leaves` a vessel with an escape direction goes on until it is away from her.
pub(super) fn moving_place(at: &Vector3<f64>, s: &Situation, leaves: bool) -> (bool, Vector3<f64>) {
    let near = s.fresh_deck().filter(|d| d.distance_m < d.ring_m);
    let escapes = leaves && near.is_some_and(|d| d.escapes);
    let low = s.own.filter(|own| escapes || own.position.z > at.z + BELOW_M);
    low.filter(|_| near.is_some()).map_or((false, *at), |own| {
        (true, Vector3::new(own.position.x, own.position.y, at.z))
    })
}

/// Waiting place of a drone that has ended its landing, `at` a place or on its way up there, from the deck's centre (NED,
/// m): it keeps out of the way of the deck's owner. None: it stays at that place.
pub(super) fn stands_aside(at: &Vector3<f64>, s: &Situation, leaves: bool) -> Option<[f64; 2]> {
    let near = |d: &&Deck| d.distance_m < WAITING_DISTANCE_M + WITH_DECK_M;
    let here = s.place.is_some() && s.fresh_deck().filter(near).is_some() && !moving_place(at, s, leaves).0;
    s.waiting_offset().filter(|_| here)
}

/// The place `at` where a drone holds, as it moves: with the deck on its way up, out of the way of others then.
pub(super) fn held_place(at: &Vector3<f64>, s: &Situation, leaves: bool) -> Vector3<f64> {
    match (stands_aside(at, s, leaves), s.own) {
        (Some(_), Some(own)) => Vector3::new(own.position.x, own.position.y, at.z),
        (Some(_) | None, _) => moving_place(at, s, leaves).1,
    }
}

/// Straight above (or at) the drone, at least `height` over the deck's mean level.
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

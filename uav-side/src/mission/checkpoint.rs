//! Checkpoint of the mission, published with every state and validated by a successor.
//!
//! A mission that starts while the drone flies continues its predecessor's state or, without a usable checkpoint, makes
//! the drone safe from its own inputs. Until then it publishes no state, and the pilot uses the last one.

use alight_shared::{
    admission::command::keep,
    msg::{
        Command, KeptStation, LastVessel, Message as _, MissionCheckpoint, Phase, Reason, ReasonCode, State,
    },
    time::Span,
    topics,
};

use super::{
    cycles::Cycles,
    limits::{AWAY_M, CLIMB_S, HEAVE_M, LOST_OUTSIDE_M, RESUME_DISTANCE_M, STEADY_HEIGHT_M},
    phase::{
        DroneTime, HoldCause, MissionPhase, MissionProgress, RejectedOrder, climbing_out, gave_up, holding,
    },
    situation::{ControlState, Deck, Situation},
    take_off::standing_down,
};
use crate::{lift_off::LEFT_M, mission_config::MissionConfig};
use alight_shared::checkpoint::{CheckpointRejection, Recovery, validate};

/// Time for which a starting mission waits for autopilot, odometry and forecast: five periods of the slowest.
const EVIDENCE_WAIT: Span = Span::from_millis(500);
const MAX_COMMANDS: usize = 16;

#[derive(Clone, Debug, Default)]
pub(super) struct MissionStartUp {
    recovery: Recovery<MissionCheckpoint>,
    commands: Vec<Command>,
}

pub(super) struct Begun {
    pub(super) checkpoint: Option<MissionCheckpoint>,
    /// Checkpoint that is too old to continue from and gives only the purpose of the flight.
    pub(super) aged: Option<MissionCheckpoint>,
    pub(super) rejected: Option<CheckpointRejection>,
    pub(super) commands: Vec<Command>,
}

impl MissionStartUp {
    /// Returns the result once it is decided. `complete`: whether the mission has the states of drone and deck.
    pub(super) fn step(
        &mut self,
        now: DroneTime,
        ids: [u32; 2],
        checkpoint: Option<&MissionCheckpoint>,
        commands: &[Command],
        complete: bool,
    ) -> Option<Begun> {
        let [drone, boot] = ids;
        for c in commands {
            keep(&mut self.commands, c, MAX_COMMANDS);
        }
        let answered = self.recovery.poll(now, boot, checkpoint);
        if !answered || !(complete || self.recovery.waited(now) >= EVIDENCE_WAIT) {
            return None;
        }
        let checkpoint = self.recovery.checkpoint();
        let rejected = checkpoint.and_then(|m| validate(now, drone, &m).err());
        let is_aged = |m: &MissionCheckpoint| {
            rejected == Some(CheckpointRejection::Age) && m.header.at <= now && m.check().is_ok()
        };
        Some(Begun {
            checkpoint: checkpoint.filter(|_| rejected.is_none()),
            aged: checkpoint.filter(is_aged),
            rejected,
            commands: core::mem::take(&mut self.commands),
        })
    }
}

/// Phase of the checkpoint `m`, and the reason if it differs. `same_frame`: whether its positions are valid.
pub(super) fn restored(
    m: &MissionCheckpoint,
    same_frame: bool,
    s: &Situation,
    c: &MissionConfig,
) -> (MissionPhase, Option<Reason>) {
    match interrupted(m.header.at, m.state.state, m.stopped, s, c) {
        Some(phase) => {
            let why = Reason::new(ReasonCode::Restarted, s.clearance_m(), 0.0);
            (phase, Some(why))
        }
        None => (phase_of(m, same_frame, s, c), None),
    }
}

/// Phase after an interruption of a mission that last published `state` at the time `published`; None: the mission
/// continues in its phase. After a long interruption the pilot has left the plan and climbs, and a landing starts
/// again. Exceptions: the landing is over; the pilot completes it, because a climb would hit the deck harder; or
/// the operator has `stopped` it.
pub(super) fn interrupted(
    published: DroneTime,
    state: State,
    stopped: bool,
    s: &Situation,
    c: &MissionConfig,
) -> Option<MissionPhase> {
    let left = s.now - published > topics::MISSION.stale_after;
    let goes_on = s.fresh_deck().is_some_and(|d| ends_softer(d, s));
    if !left || state.phase() != Phase::Landing || s.motors_stopped || goes_on {
        return None;
    }
    Some(if stopped {
        gave_up(s, c)
    } else {
        MissionPhase::TRACKING
    })
}

/// Whether, according to the forecast, the feet are on the deck and stay there.
pub(super) fn rests(s: &Situation) -> bool {
    let rests = |d: &Deck| d.ends.is_some_and(|e| e.rests) && d.sinking_mps.abs() < RISES_MPS;
    s.fresh_deck().is_some_and(rests) && s.slides().is_none()
}
/// Speed away from the deck of a drone that has left it, m/s: several times the estimate's error.
const RISES_MPS: f64 = 0.5;

/// Whether a drone in a take-off stands on the deck and does not rise, according to its autopilot or a camera that
/// detects the deck. GNSS heights may be wrong by metres, and the autopilot's report may be old.
fn stands(s: &Situation, c: &MissionConfig) -> bool {
    let Some(deck) = s.fresh_deck() else {
        return false;
    };
    let rises = deck.sinking_mps < -RISES_MPS;
    let detected = deck.vision_age_s <= c.vision_fresh_s && deck.clearance_m < LEFT_M;
    !rises && (s.on_ground || detected)
}
pub(super) fn ends_softer(d: &Deck, s: &Situation) -> bool {
    s.outside_m <= LOST_OUTSIDE_M && d.ends.is_some_and(|e| e.landing_is_softer())
}

fn phase_of(m: &MissionCheckpoint, same_frame: bool, s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = (m.state.hold_position(), m.state.hold_yaw);
    match m.state.state {
        State::GetAltitude => {
            let own = s.own.filter(|_| !same_frame).map_or(at, |own| own.position);
            MissionPhase::GetAltitude { from: [own.x, own.y] }
        }
        // A search restarts at the beacon's position.
        State::Approach | State::Search => MissionPhase::APPROACH,
        State::Tracking | State::TrackingStable => MissionPhase::TRACKING,
        State::Descent => MissionPhase::DESCENT,
        State::Flare => MissionPhase::Flare {
            committed: m.committed,
            violated: None,
        },
        State::Landed => MissionPhase::Landed {
            disarmed: m.disarmed,
            airborne: None,
        },
        State::Hold => {
            // The hold after a take-off also waits for an order.
            let cause = match m.state.station {
                Some(kept) => HoldCause::Station(kept),
                None if m.stopped || m.sortie && !m.landing => HoldCause::Operator,
                None => HoldCause::Data,
            };
            if same_frame {
                MissionPhase::Hold {
                    cause,
                    at,
                    yaw,
                    fresh: None,
                }
            } else {
                holding(cause, s, c)
            }
        }
        State::GaveUp if same_frame => MissionPhase::GaveUp { at, yaw },
        State::GaveUp => gave_up(s, c),
        State::Idle | State::Preparing | State::Countdown => MissionPhase::Idle,
        State::SpinUp | State::StandDown => standing_down(s, ReasonCode::Disarmed.into()),
        State::TakeOff if !m.sortie && stands(s, c) => standing_down(s, ReasonCode::Disarmed.into()),
        State::TakeOff | State::ClimbOut => climbing_out(s, c),
    }
}

pub(super) fn progress(m: &MissionCheckpoint) -> MissionProgress {
    MissionProgress {
        landing: m.landing,
        attempts: m.state.attempts,
        started: m.started,
        deck_first: m.deck_first,
        deck_declined: m.deck_declined,
        armed: false,
        low_battery: m.state.low_battery,
        missing: None,
        low_since: None,
        stopped: m.stopped,
        overruled: false,
        flared: if m.committed { Some(m.header.at) } else { None },
        set_points_lost: false,
        station: None,
        sortie: m.sortie,
        // The distance is measured again from the current position.
        led_from: None,
        cycles: Cycles {
            on: m.cycling,
            sorties: m.state.sorties[0],
            ended: m.cycles_ended,
            ready: m.ready,
            ..Cycles::default()
        },
        rejected: m.state.rejected.map(|why| RejectedOrder {
            at: m.state.header.at,
            why,
        }),
    }
}

const BOOT_S: f64 = 30.0;

/// Whether a checkpoint is older than the computer's boot, which restarts its clock.
fn of_former_boot(m: &MissionCheckpoint) -> bool {
    m.header.at < DroneTime::EPOCH
}

pub(super) fn known_vessel(now: DroneTime, m: &MissionCheckpoint) -> Option<LastVessel> {
    let at = now - Span::from_secs(BOOT_S);
    let known = |v| {
        if of_former_boot(m) {
            LastVessel { at, ..v }
        } else {
            v
        }
    };
    m.last_vessel.map(known)
}

/// Purpose of the flight, from a checkpoint that is too old to continue from. An order to land and a station continue
/// once the drone is in our mode, and end if a pilot has control. An operator's stop and a declined deck persist. A
/// drone on a sortie returns while its charge lasts, and its cycles end. A disarmed drone has no purpose.
pub(super) fn purpose(now: DroneTime, m: &MissionCheckpoint) -> MissionProgress {
    if !m.armed {
        return MissionProgress::default();
    }
    let begun = |kept: KeptStation| {
        if of_former_boot(m) {
            kept.begun_at(now)
        } else {
            kept
        }
    };
    let restarted = m.cycling.then(|| ReasonCode::Restarted.into());
    MissionProgress {
        landing: m.landing,
        started: now,
        deck_first: m.deck_first,
        armed: true,
        set_points_lost: true,
        station: m.state.station.map(begun),
        stopped: m.stopped,
        deck_declined: m.deck_declined,
        sortie: m.sortie && !m.deck_declined,
        cycles: Cycles {
            sorties: m.state.sorties[0],
            ended: restarted.or(m.cycles_ended),
            ..Cycles::default()
        },
        ..MissionProgress::default()
    }
}

pub(super) fn is_away(s: &Situation) -> bool {
    s.fresh_deck().is_some_and(|d| d.distance_m >= AWAY_M)
}

/// Evasive climb of a drone that hovers without an order within the deck's heave while the vessel approaches.
pub(super) fn gives_way(s: &Situation, c: &MissionConfig) -> Option<(MissionPhase, Reason)> {
    let deck = s.fresh_deck()?;
    let near_m = RESUME_DISTANCE_M + CLIMB_S * deck.closing_mps.max(0.0);
    let comes = deck.clearance_m < HEAVE_M && deck.distance_m < near_m;
    if !comes || s.flight != ControlState::Ours || s.motors_stopped || rests(s) {
        return None;
    }
    let why = Reason::new(ReasonCode::TooNear, deck.clearance_m, HEAVE_M);
    Some((gave_up(s, c), why))
}

/// Start of an idle mission without a checkpoint when the drone flies near a deck or rests on it with motors running.
/// It was landing or taking off, and the rising deck could hit it. A drone that is still `landing` climbs and starts
/// again. `code` is the reason why the checkpoint is missing. `Err` until decided.
pub(super) fn safe_start(
    s: &Situation,
    landing: bool,
    code: ReasonCode,
    c: &MissionConfig,
) -> Result<Option<(MissionPhase, Reason)>, ()> {
    match s.flight {
        // The drone may come under our control at any time, even low above the deck.
        ControlState::Unknown | ControlState::SetPointsLost | ControlState::OtherControl(_) => return Err(()),
        ControlState::Disarmed => return Ok(None),
        ControlState::OnGround | ControlState::Ours => {}
    }
    if s.motors_stopped {
        return Ok(Some((MissionPhase::LANDED, ReasonCode::Touchdown.into())));
    }
    let Some(deck) = s.fresh_deck() else {
        return Err(());
    };
    // Even without a deck the drone may stay at the tracking height.
    let low = deck.clearance_m < c.tracking_height_m - STEADY_HEIGHT_M;
    if !(low && deck.distance_m < RESUME_DISTANCE_M) {
        return Ok(None);
    }
    let why = Reason::new(code, deck.clearance_m, 0.0);
    let phase = if rests(s) || landing && ends_softer(deck, s) {
        // The pilot's touchdown detector decides.
        MissionPhase::Flare {
            committed: true,
            violated: None,
        }
    } else if let Some(own) = s.own.filter(|_| landing) {
        let from = own.position.xy().into();
        MissionPhase::GetAltitude { from }
    } else {
        gave_up(s, c)
    };
    Ok(Some((phase, why)))
}

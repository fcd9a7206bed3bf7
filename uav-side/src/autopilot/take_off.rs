//! The mode and the arming of a take-off, and the disarm of one that was stopped on the deck.
//!
//! While the mission is in [`State::SpinUp`] the link chooses OFFBOARD (GUIDED) and arms: an operator has ordered the take-off,
//! the crew has cleared the deck, and the countdown is over. A mode that the pilot chooses after that is not chosen again, nor
//! is armed again what was armed: a link that begins in that state does neither.
//! What the autopilot answers to a command to arm is passed on with the text that it gave for it.
//!
//! A take-off that was stopped leaves a drone that this link has armed and that has had little thrust since. It is disarmed by
//! force, because no land detector finds the ground on a deck that moves: once two witnesses show that it stands
//! ([`crate::standing`]). Where set-points have ceased meanwhile its autopilot may have lifted it: until two witnesses show that it
//! stands, a thrust that does not carry it is not passed on, and it climbs a little and holds.

use alight_shared::admission::Periodic;
use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{AutopilotMode, LandedState, Motors, SetPoint, SetPointKind, State};
use alight_shared::time::{DroneClock, Span};
use nalgebra::Vector3;

use super::message::{CommandLong, CommandResult, command, severity};
use super::modes::Firmware;
use super::{AutopilotLink, AutopilotOut, ControlAuthority, DroneTime};
use crate::standing::{StandingMonitor, StandingVerdict, by_height};

/// PX4 denies OFFBOARD without a stream of set-points for so long.
const STREAMS: Span = Span::from_millis(1200);
/// Between two commands.
const PAUSE: Span = Span::from_millis(1000);
/// Commands to choose the mode, to arm and to disarm, at most.
const MODE_TRIES: u32 = 3;
const ARM_TRIES: u32 = 3;
const DISARM_TRIES: u32 = 50;
/// Between two commands to disarm.
const DISARM_PAUSE: Span = Span::from_millis(200);
/// Without set-points for so long its autopilot may do something by itself.
const GAP: Span = Span::from_millis(150);
/// A text explains a denial that comes no later.
const EXPLAINS: Span = Span::from_millis(3000);

/// Progress of a take-off at the autopilot.
#[derive(Clone, Debug, Default)]
pub(super) struct TakeOffSequence {
    /// Since when set-points are streamed for it.
    since: Option<DroneTime>,
    modes: u32,
    arms: u32,
    /// The autopilot was in our mode since.
    was_ours: bool,
    /// It was commanded to arm, and was not observed disarmed in another state of the mission since.
    armed: bool,
    disarms: u32,
    standing: StandingMonitor,
    verdict: StandingVerdict,
    /// Set-points ceased, and nothing has shown since that it stands.
    may_fly: bool,
    next: Periodic<DroneClock>,
    /// The autopilot's newest text of a denial.
    text: Option<(DroneTime, String)>,
}

impl TakeOffSequence {
    /// Commands to disarm so far.
    pub(super) fn disarms(&self) -> u32 {
        self.disarms
    }
    /// Takes a text of the autopilot, which may be its reason not to arm.
    pub(super) fn explained(&mut self, now: DroneTime, text: &str) {
        if self.since.is_some() {
            self.text = Some((now, text.into()));
        }
    }
    /// A command to arm or disarm was accepted: PX4's next heartbeat may be a second away.
    pub(super) fn accepted(&mut self, now: DroneTime) {
        if self.arms > 0 && self.disarms == 0 {
            self.next.restart(now, PAUSE + PAUSE);
        }
    }
    /// Report of a denied command to arm; None where it was not for a take-off.
    pub(super) fn denied(&mut self, now: DroneTime, result: CommandResult) -> Option<String> {
        if self.since.is_none() || self.arms == 0 || self.disarms > 0 {
            return None;
        }
        let text = self.text.take().filter(|(at, _)| now - *at <= EXPLAINS);
        let why = text.map_or_else(|| format!("{result:?}, without a text"), |(_, text)| text);
        Some(format!("does not arm: {why}"))
    }
}

impl AutopilotLink {
    /// Set-points are to be followed before a heartbeat shows that they are: in a take-off, and where the autopilot holds because
    /// they had ceased, in every state in which the mission flies.
    pub(super) fn streams_ahead(&self, now: DroneTime) -> bool {
        let Some(state) = self.inputs.fresh_state(now) else {
            return false;
        };
        let (authority, lapsed) = (self.control_authority(), self.stream.lapse.is_lapsed());
        match state {
            State::SpinUp | State::TakeOff | State::StandDown => {
                authority.may_offer() || authority == ControlAuthority::Disarmed
            }
            State::ClimbOut
            | State::Hold
            | State::GaveUp
            | State::GetAltitude
            | State::Approach
            | State::Search
            | State::Tracking
            | State::TrackingStable
            | State::Descent
            | State::Flare => authority.may_offer() && lapsed,
            State::Idle | State::Preparing | State::Countdown | State::Landed => false,
        }
    }

    /// Watches whether a drone that is to take off, or was to, stands on the deck.
    pub(super) fn watch_standing(&mut self, now: DroneTime) {
        let Some(peer) = &self.peer else { return };
        let mission = self.inputs.last_state(now);
        let stands = matches!(mission, Some(State::SpinUp | State::StandDown));
        if !peer.armed || !(stands || self.commands.departure.armed) {
            let d = &mut self.commands.departure;
            (d.standing, d.verdict, d.may_fly) = Default::default();
            return;
        }
        let evidence = self.contact(now);
        let applied = self.thrust_of_hover(now);
        // Who follows what is sent gives that, where it reports nothing.
        let sent = (self.stream.thrust.is_low(now) && peer.mode == AutopilotMode::Offboard).then_some(0.0);
        // In whatever attitude it came to rest.
        let state = self.estimate.fresh(now);
        let force = state.map(|s| Vector3::from(s.specific_force).norm() / GRAVITY);
        // By the receivers the deck may be metres off: their height speaks for it alone.
        let forecast = (evidence.forecast_height).is_some_and(|h| h.abs() <= self.config.disarm.height_m);
        let heights = [
            by_height(evidence.range_height),
            forecast.then_some(true),
            (peer.landed(now) == LandedState::OnGround).then_some(true),
            // The mission stands down on two witnesses of its own.
            (mission == Some(State::StandDown)).then_some(true),
        ];
        let ceased = self.stream.sent_at.is_none_or(|at| now - at > GAP) || self.stream.lapse.is_lapsed();
        let d = &mut self.commands.departure;
        d.verdict = d.standing.step(now, applied.or(sent), force, &heights);
        d.may_fly = match d.verdict {
            StandingVerdict::Stands => false,
            StandingVerdict::Unknown => d.may_fly || ceased,
            StandingVerdict::Flies => true,
        };
    }
    /// The pilot's set-point for a drone that stands on the deck; one that may be in the air climbs a little and holds.
    pub(super) fn carried(&mut self, now: DroneTime, wanted: SetPoint) -> Option<SetPoint> {
        let low = self.config.disarm.max_thrust_of_hover * self.estimate.hover.value();
        let falls = wanted.kind == SetPointKind::Attitude && wanted.thrust <= low;
        let state = self.inputs.last_state(now);
        let stands = matches!(state, Some(State::SpinUp | State::StandDown));
        if !(self.commands.departure.may_fly && falls && stands && wanted.motors == Motors::Run) {
            return Some(wanted);
        }
        self.hold_above(now).or(Some(wanted))
    }

    /// Chooses the mode and arms, or disarms, as the mission's state wants it.
    pub(super) fn take_off(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        // One that is silent may be back.
        let Some(state) = self.inputs.fresh_state(now) else {
            return;
        };
        if state == State::SpinUp {
            self.prepare_take_off(now, out);
        } else if state.wants_motors_off() {
            self.disarm_stopped(now, out);
        } else {
            self.commands.departure = TakeOffSequence::default();
        }
    }

    fn prepare_take_off(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let authority = self.control_authority();
        // A link before this one may have been in our mode, or have armed, and the pilot have ended that.
        let succeeds = self.inputs.fresh_mission(now).map(|m| m.since) < self.succession.began;
        let Some(peer) = &self.peer else { return };
        let d = &mut self.commands.departure;
        let since = *d.since.get_or_insert(now);
        let ours = peer.mode == AutopilotMode::Offboard;
        d.was_ours |= ours;
        if peer.armed {
            // A later disarm is the will of the pilot, or the autopilot's own.
            d.arms = ARM_TRIES;
        }
        if peer.armed || succeeds {
            return;
        }
        if !ours {
            let streamed = peer.firmware != Firmware::Px4 || now - since >= STREAMS;
            let may = authority.may_offer() && !d.was_ours && streamed && d.modes < MODE_TRIES;
            if may && d.next.is_due_spaced(now, PAUSE) {
                d.modes += 1;
                out.send(CommandLong::mode(peer.address, peer.firmware.offboard()));
            }
            return;
        }
        // In that mode PX4 wants the stream, too.
        let streamed = now - since >= STREAMS;
        let may = authority == ControlAuthority::Disarmed && streamed && d.arms < ARM_TRIES;
        if may && d.next.is_due_spaced(now, PAUSE) {
            (d.arms, d.armed) = (d.arms + 1, true);
            out.send(CommandLong::new(peer.address, command::ARM_DISARM, [1.0]));
        }
    }

    /// A drone that this link has armed for a take-off that was stopped is disarmed.
    fn disarm_stopped(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let Some(peer) = &self.peer else { return };
        let (armed, ours) = (peer.armed, peer.mode == AutopilotMode::Offboard);
        let stands_down = self.inputs.fresh_state(now) == Some(State::StandDown);
        if !armed && !stands_down {
            // A command to arm may be under way for as long as its answer takes.
            let d = &mut self.commands.departure;
            if d.next.is_ready(now - PAUSE) {
                *d = TakeOffSequence::default();
            }
            return;
        }
        // A drone that somebody else flies is theirs.
        let may = armed && ours && (self.commands.departure.armed || stands_down);
        let low = self.stream.thrust.is_low(now);
        let d = &mut self.commands.departure;
        let stands = d.verdict == StandingVerdict::Stands && low;
        if !(may && stands) || d.disarms >= DISARM_TRIES || !d.next.is_due_spaced(now, DISARM_PAUSE) {
            return;
        }
        d.disarms += 1;
        out.send(CommandLong::disarm(peer.address, d.disarms));
        if d.disarms == DISARM_TRIES {
            let text = "still ARMED after a stopped take-off: disarm by remote control";
            out.alarm(severity::CRITICAL, text.into());
        }
    }
}

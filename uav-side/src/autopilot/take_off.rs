//! Mode change and arming for a take-off, and disarming after a take-off that was stopped on the deck.
//!
//! In [`State::SpinUp`] (ordered by an operator, cleared by the crew, countdown over) the link selects OFFBOARD
//! (GUIDED) and arms. It neither overrides a mode that the pilot chooses afterwards nor arms a second time; a link that
//! starts in that state does neither. A text explains a denied arming command.
//!
//! After a stopped take-off the drone was armed by this link and has had little thrust since. It is disarmed by force
//! once two witnesses show that it stands ([`crate::standing`]), because no land detector works on a moving deck. If
//! set-points stopped in the meantime, the autopilot may have lifted the drone. Until two witnesses show that it
//! stands, a thrust too low to carry it is replaced by a small climb and a hold.

use alight_shared::{
    admission::Periodic,
    geometry::GRAVITY,
    msg::{AutopilotMode, LandedState, Motors, SetPoint, SetPointKind, State},
    time::{DroneClock, Span},
};
use nalgebra::Vector3;

use super::{
    AutopilotLink, AutopilotOut, ControlAuthority, DroneTime,
    message::{CommandLong, MavCmd, MavResult, result_name, severity},
    modes::Firmware,
};
use crate::standing::{StandingMonitor, StandingVerdict, by_height};

/// Duration of a set-point stream before PX4 accepts OFFBOARD.
const STREAMS: Span = Span::from_millis(1200);
const PAUSE: Span = Span::from_millis(1000);
const MODE_TRIES: u32 = 3;
const ARM_TRIES: u32 = 3;
const DISARM_TRIES: u32 = 50;
const DISARM_PAUSE: Span = Span::from_millis(200);
/// Gap in the set-points after which the autopilot may act by itself.
const GAP: Span = Span::from_millis(150);
/// Maximum age of a text that explains a denial.
const EXPLAINS: Span = Span::from_millis(3000);

#[derive(Clone, Debug, Default)]
pub(super) struct TakeOffSequence {
    since: Option<DroneTime>,
    modes: u32,
    arms: u32,
    was_ours: bool,
    /// Whether an arming command was sent, and no disarmed state outside a take-off has followed.
    armed: bool,
    disarms: u32,
    standing: StandingMonitor,
    verdict: StandingVerdict,
    /// Whether set-points have stopped and no verdict since then shows that the drone stands.
    may_fly: bool,
    next: Periodic<DroneClock>,
    text: Option<(DroneTime, String)>,
}

impl TakeOffSequence {
    pub(super) fn disarms(&self) -> u32 {
        self.disarms
    }
    pub(super) fn explained(&mut self, now: DroneTime, text: &str) {
        if self.since.is_some() {
            self.text = Some((now, text.into()));
        }
    }
    /// Whether an accepted command has armed the drone. No other follows, because PX4's next heartbeat may be a second
    /// away.
    pub(super) fn accepted(&mut self, now: DroneTime) -> bool {
        let arms = self.arms > 0 && self.disarms == 0;
        if arms {
            self.next.restart(now, PAUSE + PAUSE);
        }
        arms
    }
    pub(super) fn denied(&mut self, now: DroneTime, result: MavResult) -> Option<String> {
        if self.since.is_none() || self.arms == 0 || self.disarms > 0 {
            return None;
        }
        let text = self.text.take().filter(|(at, _)| now - *at <= EXPLAINS);
        let why = text.map_or_else(
            || format!("{}, without a text", result_name(result)),
            |(_, text)| text,
        );
        Some(format!("does not arm: {why}"))
    }
}

impl AutopilotLink {
    /// Whether set-points are streamed before a heartbeat shows that they are followed: in a take-off, and after a
    /// set-point loss in every flying state of the mission.
    pub(super) fn streams_ahead(&self, now: DroneTime) -> bool {
        let Some(state) = self.inputs.fresh_state(now) else {
            return false;
        };
        let authority = self.control_authority();
        let lost = self.stream.loss.is_lost();
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
            | State::Flare => authority.may_offer() && lost,
            State::Idle | State::Preparing | State::Countdown | State::Landed => false,
        }
    }

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
        // In OFFBOARD without a thrust report, the commanded thrust is used.
        let sent = (self.stream.thrust.is_low(now) && peer.mode == AutopilotMode::Offboard).then_some(0.0);
        // The norm of the specific force at rest does not depend on the attitude.
        let state = self.estimate.fresh(now);
        let force = state.map(|s| Vector3::from(s.specific_force).norm() / GRAVITY);
        // From GNSS receivers alone the deck's height may be wrong by metres, so it can only support the verdict.
        let forecast = (evidence.forecast_height).is_some_and(|h| h.abs() <= self.config.disarm.height_m);
        let heights = [
            by_height(evidence.range_height),
            forecast.then_some(true),
            (peer.landed(now) == LandedState::OnGround).then_some(true),
            // The mission enters stand-down only if two witnesses show that the drone stands.
            (mission == Some(State::StandDown)).then_some(true),
        ];
        let ceased = self.stream.sent_at.is_none_or(|at| now - at > GAP) || self.stream.loss.is_lost();
        let d = &mut self.commands.departure;
        d.verdict = d.standing.step(now, applied.or(sent), force, &heights);
        d.may_fly = match d.verdict {
            StandingVerdict::Stands => false,
            StandingVerdict::Unknown => d.may_fly || ceased,
            StandingVerdict::Flies => true,
        };
    }
    /// Replaces the set-point of a drone that may be flying with too little thrust by a small climb and a hold.
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

    pub(super) fn take_off(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        // A mission that is silent now may return.
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
        // A previous link may have selected our mode or armed, and the pilot may have ended that.
        let succeeds = self.inputs.fresh_mission(now).map(|m| m.since) < self.succession.began;
        let Some(peer) = &self.peer else { return };
        let d = &mut self.commands.departure;
        let since = *d.since.get_or_insert(now);
        let ours = peer.mode == AutopilotMode::Offboard;
        d.was_ours |= ours;
        if peer.armed {
            // A later disarm comes from the pilot or the autopilot.
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
        // PX4 also needs the stream for arming in that mode.
        let streamed = now - since >= STREAMS;
        let may = authority == ControlAuthority::Disarmed && streamed && d.arms < ARM_TRIES;
        if may && d.next.is_due_spaced(now, PAUSE) {
            d.arms += 1;
            d.armed = true;
            out.send(CommandLong::new(
                peer.address,
                MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
                [1.0],
            ));
        }
    }

    fn disarm_stopped(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let Some(peer) = &self.peer else { return };
        let armed = peer.armed;
        let ours = peer.mode == AutopilotMode::Offboard;
        let stands_down = self.inputs.fresh_state(now) == Some(State::StandDown);
        if !armed && !stands_down {
            // An arming command may still be unanswered.
            let d = &mut self.commands.departure;
            if d.next.is_ready(now - PAUSE) {
                *d = TakeOffSequence::default();
            }
            return;
        }
        // A drone under another authority is not disarmed.
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

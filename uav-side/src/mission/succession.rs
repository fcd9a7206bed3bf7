//! Start of a mission from a predecessor's checkpoint, or with a drone found in flight.

use alight_shared::{
    admission::CommandAdmission,
    checkpoint::CheckpointRejection,
    geodesy::Datum,
    msg::{CommandKind, MissionCheckpoint, MissionState, Reason, ReasonCode},
    time::{DroneClock, Time},
};

use super::{
    MissionIn, MissionNode,
    checkpoint::{self, Begun, MissionStartUp},
    concerns::resume_landing,
    phase::{Decision, MissionPhase},
    situation::{ControlState, Situation},
};

#[derive(Clone, Debug, Default)]
pub(super) struct MissionSuccession {
    /// Start-up, until it is known whether a predecessor was flying the drone.
    pub(super) beginning: Option<MissionStartUp>,
    /// Reason to make the drone safe first: no checkpoint at the start, or control lost to a hold.
    pub(super) needs_safe_start: Option<ReasonCode>,
    /// Whether the drone was away from the deck, under our control without an order.
    was_away: bool,
    pub(super) published: Option<Time<DroneClock>>,
}

impl MissionNode {
    /// Begins in the decided state. Returns the command received during the start.
    fn begin(&mut self, now: Time<DroneClock>, begun: &Begun) -> Option<CommandKind> {
        self.succession.needs_safe_start = begun.checkpoint.is_none().then_some(ReasonCode::Restarted);
        if let Some(m) = &begun.checkpoint {
            let drone = self.drone.get();
            let same_frame = drone.is_none_or(|d| (d.frames, d.datum) == (m.frames, m.datum));
            self.adjust(&m.state.settings);
            let s = self.situation(now);
            let (phase, changed) = checkpoint::restored(m, same_frame, &s, &self.config);
            self.phase = phase;
            self.progress = checkpoint::progress(m);
            self.succession.was_away = m.was_away;
            self.last_vessel = m.last_vessel;
            self.meets = m.state.meets;
            self.previous = m.state.previous;
            self.since = m.state.since;
            self.entered = m.state.entered;
            if let Some(why) = changed {
                (self.previous, self.since, self.entered) = (m.state.state, now, why);
            }
            self.commands = CommandAdmission::after(m.command, m.abort);
            if let Some((charge, known)) = m.state.battery.zip(m.battery) {
                self.battery.resume(m.header.at, charge, &known, &self.config);
            }
            if let Some(z) = m.mean_deck_z.filter(|_| same_frame) {
                self.mean_deck_z = Some((m.header.at, z));
            }
        }
        if let Some(m) = &begun.aged {
            self.progress = checkpoint::purpose(now, m);
            self.last_vessel = checkpoint::known_vessel(now, m);
        }
        self.commands.first_of(now, &begun.commands)
    }

    /// Command to apply, and reason of a rejected checkpoint; None until the start is decided.
    pub(super) fn order(
        &mut self,
        now: Time<DroneClock>,
        input: &MissionIn,
        s: &Situation,
    ) -> Option<(Option<CommandKind>, Option<CheckpointRejection>)> {
        let Some(beginning) = &mut self.succession.beginning else {
            self.resume(now, s);
            return Some((self.commands.first_of(now, &input.commands), None));
        };
        // The pilot node's set-point shows whether the landing of a disarmed drone is over.
        let complete = match s.flight {
            ControlState::Disarmed => self.set_point.get().is_some(),
            ControlState::Unknown => false,
            ControlState::OnGround
            | ControlState::Ours
            | ControlState::SetPointsLost
            | ControlState::OtherControl(_) => s.fresh_deck().is_some(),
        };
        let ids = [self.drone_id, self.boot];
        let begun = beginning.step(now, ids, input.checkpoint.as_ref(), &input.commands, complete)?;
        self.succession.beginning = None;
        Some((self.begin(now, &begun), begun.rejected))
    }

    /// Acts as its own successor after a pause longer than other nodes wait for the mission's state.
    fn resume(&mut self, now: Time<DroneClock>, s: &Situation) {
        let state = self.phase.state();
        let stopped = self.progress.stopped;
        let Some(at) = self.succession.published else {
            return;
        };
        if let Some(phase) = checkpoint::interrupted(at, state, stopped, s, &self.config) {
            let why = Reason::new(ReasonCode::StoodStill, s.clearance_m(), (now - at).secs());
            (self.previous, self.since, self.entered) = (state, now, why);
            self.phase = phase;
        }
    }

    /// Decision of an idle mission about a drone in flight, found without a checkpoint or near the vessel.
    pub(super) fn keeps_clear(&mut self, s: &Situation) -> Option<Decision> {
        let waits = self.phase == MissionPhase::Idle;
        // A drone handed over above the deck stays there.
        self.succession.was_away &= waits && s.flight == ControlState::Ours;
        if !waits {
            self.succession.needs_safe_start = None;
            return None;
        }
        let landing = self.progress.landing;
        if landing && resume_landing(self.phase, &self.progress, s, &self.config).is_some() {
            return None;
        }
        let (phase, why) = if let Some(code) = self.succession.needs_safe_start {
            let found = checkpoint::safe_start(s, self.progress.landing, code, &self.config);
            self.succession.needs_safe_start = self.succession.needs_safe_start.filter(|_| found.is_err());
            found.ok().flatten()?
        } else {
            self.succession.was_away |= s.flight == ControlState::Ours && checkpoint::is_away(s);
            let gives_way = checkpoint::gives_way(s, &self.config);
            gives_way.filter(|_| self.succession.was_away && !self.progress.landing)?
        };
        Some(Decision {
            phase,
            progress: self.progress,
            entered: Some(why),
            waiting: Reason::default(),
        })
    }

    pub(super) fn checkpoint(&self, state: &MissionState) -> MissionCheckpoint {
        MissionCheckpoint {
            header: state.header,
            state: *state,
            armed: self.autopilot.get().is_some_and(|a| a.armed),
            landing: self.progress.landing,
            started: self.progress.started,
            deck_first: self.progress.deck_first,
            battery: self.battery.memory(),
            deck_declined: self.progress.deck_declined,
            stopped: self.progress.stopped,
            committed: matches!(self.phase, MissionPhase::Flare { committed: true, .. }),
            disarmed: matches!(self.phase, MissionPhase::Landed { disarmed: true, .. }),
            command: self.commands.newest(),
            abort: self.commands.abort(),
            frames: self.drone.get().map_or(0, |d| d.frames),
            datum: self.drone.get().map_or(Datum::default(), |d| d.datum),
            mean_deck_z: self.mean_deck_z.map(|(_, z)| z),
            was_away: self.succession.was_away,
            sortie: self.progress.sortie,
            cycling: self.progress.cycles.on,
            ready: self.progress.cycles.ready,
            cycles_ended: self.progress.cycles.ended,
            last_vessel: self.last_vessel,
        }
    }
}

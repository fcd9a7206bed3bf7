//! Summary of a flight for the recorder, on the flight's own computer: states, outcome and metrics.

use std::{collections::BTreeMap, path::PathBuf};

use alight_shared::msg::{DroneStatus, Reason, State};

use crate::{
    config::recorder::RecorderConfig,
    process::{args::ProcessArgs, snapshot::Snapshot},
    record::flight::{
        recording::{FlightRecording, SUMMARY_PERIOD_NS},
        summary::FlightSummary,
    },
};

/// Metric: time constant of the attitude response in the slower axis, s.
pub const ATTITUDE_LAG: &str = "attitude_lag_s";
pub const ATTITUDE_DEAD_TIME: &str = "attitude_dead_time_s";
/// Maximum number of drones in a vessel's summary: a hostile drone may invent numbers.
const MAX_DRONES: usize = 16;

/// Flight that a computer's first process begins and summarises.
pub struct CurrentFlight {
    log: FlightLog,
    recording: FlightRecording,
}

impl CurrentFlight {
    /// Begins a flight if the configuration names a directory and no other process has begun one.
    pub fn begin(
        config: &RecorderConfig,
        args: &ProcessArgs,
        computer: &str,
        now_ns: i64,
    ) -> Option<CurrentFlight> {
        (args.flight.is_none() && !config.directory.is_empty()).then(|| CurrentFlight {
            log: FlightLog::of(computer, now_ns),
            recording: FlightRecording::begin(config.directory.as_ref(), config.max_bytes()),
        })
    }
    pub fn path(&self) -> PathBuf {
        self.recording.path().into()
    }
    pub fn log(&mut self) -> &mut FlightLog {
        &mut self.log
    }
    pub fn poll(&mut self, now_ns: i64) {
        if self.log.is_due(now_ns) && self.recording.sum_up(self.log.summary(now_ns, false)) {
            self.log.written(now_ns);
        }
    }
    /// Ends the flight; all processes must have stopped recording.
    pub fn end(mut self, now_ns: i64) {
        // While the disk is behind, the previous summary remains.
        let _behind = self.recording.sum_up(self.log.summary(now_ns, true));
    }
}

/// Number of the drone; None on the drone itself.
type DroneNumber = Option<u32>;

pub struct FlightLog {
    summary: FlightSummary,
    begun_ns: i64,
    /// State of each drone, time of its entry, and time at which the approach to the deck began.
    states: BTreeMap<DroneNumber, (State, i64, Option<i64>)>,
    changed: bool,
    due_ns: i64,
}

impl FlightLog {
    pub fn of(computer: &str, now_ns: i64) -> FlightLog {
        FlightLog {
            summary: FlightSummary {
                outcome: "not commanded".into(),
                ..FlightSummary::of(computer)
            },
            begun_ns: now_ns,
            states: BTreeMap::new(),
            changed: true,
            due_ns: now_ns,
        }
    }
    fn t_s(&self, now_ns: i64) -> f64 {
        seconds(now_ns - self.begun_ns)
    }
    pub fn state(&mut self, now_ns: i64, who: DroneNumber, state: State, entered: Reason, waiting: Reason) {
        let before = self.states.get(&who).copied();
        if before.is_some_and(|(last, ..)| last == state)
            || (before.is_none() && self.states.len() >= MAX_DRONES)
        {
            return;
        }
        self.count_time(now_ns, who);
        let (last, way_ns) = before.map_or((State::Idle, None), |(last, _, way_ns)| (last, way_ns));
        let way_ns = way_ns.or((last == State::Idle && state.is_landing()).then_some(now_ns));
        if state == State::Landed && before.is_some() {
            self.add("landed", 1.0);
            if let Some(from) = way_ns {
                self.set("landing_s", seconds(now_ns - from));
            }
        }
        if state == State::GaveUp && before.is_some() {
            self.add("gave_up", 1.0);
        }
        self.states
            .insert(who, (state, now_ns, way_ns.filter(|_| state.is_landing())));
        let t_s = self.t_s(now_ns);
        // The reason for entering the first state is unknown.
        let reason = if before.is_none() { waiting } else { entered };
        self.summary
            .enter(t_s, &named(who, state.name()), reason.to_string());
        let outcome = match state {
            // The message names the previous state instead.
            State::Idle if last.is_landing() => "ended",
            State::Idle | State::Preparing | State::Countdown | State::SpinUp | State::StandDown => "",
            // It landed or aborted before this flight.
            State::Landed | State::GaveUp if before.is_none() => "",
            State::Landed => "landed",
            State::GaveUp => "gave up",
            State::GetAltitude
            | State::Approach
            | State::Search
            | State::Tracking
            | State::TrackingStable
            | State::Descent
            | State::Flare
            | State::Hold
            | State::TakeOff
            | State::ClimbOut => "in flight",
        };
        if !outcome.is_empty() {
            self.summary.outcome = named(who, outcome);
            self.summary.reason = state.because(&reason);
        }
        self.changed = true;
    }
    fn count_time(&mut self, now_ns: i64, who: DroneNumber) {
        if let Some((state, since_ns, way_ns)) = self.states.get(&who).copied() {
            let time = self
                .summary
                .time_in_s
                .entry(named(who, state.name()))
                .or_default();
            *time += seconds(now_ns - since_ns);
            self.states.insert(who, (state, now_ns, way_ns));
        }
    }
    pub fn set(&mut self, name: &str, value: f64) {
        if value.is_finite() {
            self.summary.figures.insert(name.into(), value);
        }
    }
    pub fn max(&mut self, name: &str, value: f64) {
        let before = self.summary.figures.get(name).copied();
        self.set(name, before.map_or(value, |b| b.max(value)));
    }
    fn add(&mut self, name: &str, value: f64) {
        let before = self.summary.figures.get(name).copied().unwrap_or(0.0);
        self.set(name, before + value);
    }
    /// Records the computer's newest snapshot: states and, on a vessel, waves.
    pub fn observe(&mut self, now_ns: i64, snapshot: &Snapshot, restarts: u32) {
        self.set("restarts", f64::from(restarts));
        if let Some(vessel) = *snapshot.vessel {
            for s in vessel.drones.iter().map(|d| &d.status) {
                self.state(now_ns, Some(s.header.drone), s.state, s.entered, s.waiting);
            }
            if let Some([height_m, _]) = vessel.estimator.waves {
                self.set("wave_height_m", height_m);
            }
        }
        let Some(m) = *snapshot.mission else { return };
        let was = self.states.get(&None).map(|s| s.0);
        self.state(now_ns, None, m.state, m.entered, m.waiting);
        if m.state == State::Landed && was.is_some_and(|s| s != State::Landed) {
            let apart =
                DroneStatus::from_deck_m(m.header.at, snapshot.drone.as_ref(), snapshot.forecast.as_ref());
            if let Some(from_deck) = apart {
                self.set("off_centre_m", from_deck.norm());
            }
        }
        self.set("descents", f64::from(m.attempts));
        if let Some(battery) = snapshot.autopilot.as_ref().and_then(|a| a.battery) {
            self.set("battery", battery);
        }
        if let Some(r) = snapshot.response.filter(|r| r.identified) {
            self.set(ATTITUDE_LAG, r.lag_s[0].max(r.lag_s[1]));
            self.set(ATTITUDE_DEAD_TIME, r.dead_time_s);
        }
        if let Some(link) = snapshot
            .link
            .as_ref()
            .filter(|_| !matches!(m.state, State::Idle | State::Landed))
        {
            self.max("link_age_max_s", link.age_s);
            self.max("link_loss_max", link.loss);
        }
    }
    /// Whether the summary changed, or a period has passed since the last write.
    fn is_due(&self, now_ns: i64) -> bool {
        now_ns >= self.due_ns || (self.changed && now_ns >= self.due_ns - SUMMARY_PERIOD_NS + 500_000_000)
    }
    fn written(&mut self, now_ns: i64) {
        self.changed = false;
        self.due_ns = now_ns + SUMMARY_PERIOD_NS;
    }
    fn summary(&mut self, now_ns: i64, ended: bool) -> &FlightSummary {
        for who in self.states.keys().copied().collect::<Vec<_>>() {
            self.count_time(now_ns, who);
        }
        self.summary.length_s = self.t_s(now_ns);
        self.summary.ended = ended;
        &self.summary
    }
}

fn seconds(ns: i64) -> f64 {
    ns.max(0) as f64 / 1e9
}

fn named(who: DroneNumber, what: &str) -> String {
    who.map_or_else(|| what.into(), |drone| format!("drone {drone}: {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::ReasonCode;

    const S: i64 = 1_000_000_000;

    fn reason(code: ReasonCode) -> Reason {
        Reason {
            code,
            ..Reason::default()
        }
    }

    #[test]
    fn flight_summary_of_two_landings() {
        let mut log = FlightLog::of("drone-1", 0);
        let enter = |log: &mut FlightLog, s: i64, state| {
            log.state(
                s * S,
                None,
                state,
                reason(ReasonCode::Steady),
                reason(ReasonCode::NotCommanded),
            );
        };
        assert_eq!(log.summary(S, false).outcome, "not commanded");
        for (s, state) in [
            (1, State::Idle),
            (10, State::Approach),
            (15, State::Approach),
            (20, State::Descent),
            (24, State::Landed),
        ] {
            enter(&mut log, s, state);
        }
        let landed = log.summary(30 * S, false).clone();
        assert_eq!(landed.outcome, "landed");
        assert_eq!(
            (landed.figures["landed"], landed.figures["landing_s"]),
            (1.0, 14.0)
        );
        assert_eq!(
            (landed.time_in_s["Idle"], landed.time_in_s["Approach"]),
            (9.0, 10.0)
        );
        assert_eq!((landed.time_in_s["Landed"], landed.length_s), (6.0, 30.0));
        let states: Vec<&str> = landed.phases.iter().map(|p| p.state.as_str()).collect();
        assert_eq!(states, ["Idle", "Approach", "Descent", "Landed"]);

        for (s, state) in [
            (40, State::Idle),
            (50, State::GetAltitude),
            (60, State::GaveUp),
            (61, State::Idle),
        ] {
            enter(&mut log, s, state);
        }
        let second = log.summary(70 * S, true);
        assert_eq!((second.outcome.as_str(), second.ended), ("gave up", true));
        assert_eq!((second.figures["landed"], second.figures["gave_up"]), (1.0, 1.0));
    }

    #[test]
    fn flight_summary_of_a_vessel() {
        let mut log = FlightLog::of("vessel-1", 0);
        for drone in 0..1000 {
            let entered = reason(ReasonCode::Touchdown);
            let waiting = Reason::default();
            log.state(0, Some(drone), State::Flare, entered, waiting);
            log.state(S, Some(drone), State::Landed, entered, waiting);
        }
        let summary = log.summary(2 * S, false);
        assert_eq!(summary.outcome, "drone 15: landed");
        assert_eq!((summary.phases.len(), summary.time_in_s.len()), (32, 32));
    }
}

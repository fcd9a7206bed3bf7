//! Decisions of the supervisor: start a process, restart it after a delay, kill a silent one, or give up. A pure
//! function from observations of each process to actions.

use alight_shared::{
    node::Node,
    process::ProcessKind,
    time::{Span, SteadyClock, Time},
};
use serde::{Deserialize, Serialize};

/// Delay before the restart of a process that ended early; doubles with each further failure.
const INITIAL_BACKOFF: Span = Span::from_millis(100);
const MAX_BACKOFF: Span = Span::from_millis(2000);
/// Maximum delay before a restart of the viewers' server. No process needs the server, and the cause of its failure
/// (a port in use) usually persists.
const MAX_VIEW_BACKOFF: Span = Span::from_millis(60_000);
/// Run time after which a start counts as successful; the process is then restarted without delay.
const STABLE_RUN: Span = Span::from_millis(5000);
/// Factor on the silence timeout before the first report: a process loads libraries and opens devices, and on a busy
/// computer simultaneous starts delay each other.
const START_FACTOR: f64 = 5.0;
/// Maximum number of doublings of the silence timeout before the first report. Each kill doubles it, because killing
/// a slow process does not make it faster. A stable run resets the timeout.
const MAX_DOUBLINGS: u32 = 3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SupervisorLimits {
    /// Silence after which a process that has reported is killed, s; None: silence is tolerated.
    pub silence_timeout_s: Option<f64>,
    /// Consecutive failures after which a process is given up; None: never, as in flight.
    pub max_failures: Option<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Observed {
    pub kind: ProcessKind,
    pub running: bool,
    pub reported: Option<Time<SteadyClock>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SupervisorAction {
    Start(ProcessKind),
    /// Kill the process after this silence, s.
    Kill(ProcessKind, f64),
    GiveUp(ProcessKind),
}

#[derive(Clone, Copy, Debug)]
struct Child {
    kind: ProcessKind,
    starts: u32,
    failures: u32,
    started: Time<SteadyClock>,
    due: Time<SteadyClock>,
    backoff: Span,
    was_running: bool,
    killed: Option<Time<SteadyClock>>,
    silences: u32,
    ready: Option<Time<SteadyClock>>,
}

impl Child {
    fn new(kind: ProcessKind) -> Child {
        Child {
            kind,
            starts: 0,
            failures: 0,
            started: Time::EPOCH,
            due: Time::from_nanos(i64::MIN),
            backoff: INITIAL_BACKOFF,
            was_running: false,
            killed: None,
            silences: 0,
            ready: None,
        }
    }
    fn on_exit(&mut self, now: Time<SteadyClock>) {
        self.was_running = false;
        if now - self.started > STABLE_RUN {
            self.backoff = Span::ZERO;
            self.failures = 0;
        }
        self.failures = self.failures.saturating_add(1);
        self.due = now + self.backoff;
        let longest = match self.kind {
            ProcessKind::View => MAX_VIEW_BACKOFF,
            _ => MAX_BACKOFF,
        };
        self.backoff = (self.backoff * 2).clamp(INITIAL_BACKOFF, longest);
    }
    fn step(
        &mut self,
        now: Time<SteadyClock>,
        observation: &Observed,
        limits: &SupervisorLimits,
    ) -> Option<SupervisorAction> {
        if !observation.running {
            if self.was_running {
                // The remains in shared memory are cleaned up before the next start.
                self.on_exit(now);
                return None;
            }
            // A simulated world that ended has lost its state: a restart would begin another flight.
            if self.starts > 0 && self.kind == ProcessKind::World || now < self.due {
                return None;
            }
            // No process needs the viewers' server, so its end does not end a flight.
            let needed = self.kind != ProcessKind::View;
            if needed && limits.max_failures.is_some_and(|most| self.failures >= most) {
                return Some(SupervisorAction::GiveUp(self.kind));
            }
            self.started = now;
            self.was_running = true;
            self.ready = None;
            self.starts = self.starts.saturating_add(1);
            return Some(SupervisorAction::Start(self.kind));
        }
        self.was_running = true;
        let reports = !matches!(self.kind, ProcessKind::World | ProcessKind::Link);
        let waits = self.kind == ProcessKind::View && observation.reported.is_none();
        let watched = reports && !waits;
        let timeout_s = limits.silence_timeout_s.filter(|_| watched)?;
        // A report of the predecessor does not count for this start.
        let reported = observation.reported.filter(|at| *at > self.started);
        self.ready = self.ready.or(reported);
        let newest = [Some(self.started), self.killed, reported];
        let silence_s = (now - newest.into_iter().flatten().max().unwrap_or(now)).secs();
        let received = reported.is_some_and(|at| (now - at).secs() <= timeout_s);
        if received && self.ready.is_some_and(|at| now - at > STABLE_RUN) {
            self.silences = 0;
        }
        (silence_s > self.allowed_s(timeout_s)).then(|| {
            self.killed = Some(now);
            self.silences = self.silences.saturating_add(1);
            SupervisorAction::Kill(self.kind, silence_s)
        })
    }
    fn allowed_s(&self, timeout_s: f64) -> f64 {
        let factor = if self.ready.is_some() { 1.0 } else { START_FACTOR };
        timeout_s * factor * f64::from(1_u32 << self.silences.min(MAX_DOUBLINGS))
    }
}

#[derive(Clone, Debug)]
pub struct SupervisorNode {
    limits: SupervisorLimits,
    children: Vec<Child>,
}

impl SupervisorNode {
    pub fn new(limits: SupervisorLimits) -> SupervisorNode {
        SupervisorNode {
            limits,
            children: Vec::new(),
        }
    }
    pub fn restarts(&self) -> u32 {
        self.children.iter().map(|c| c.starts.saturating_sub(1)).sum()
    }
}

impl Node for SupervisorNode {
    type Clock = SteadyClock;
    type In = Vec<Observed>;
    type Out = Vec<SupervisorAction>;

    fn step(&mut self, now: Time<SteadyClock>, input: &Vec<Observed>) -> Vec<SupervisorAction> {
        let mut actions = Vec::new();
        for observation in input {
            let known = self.children.iter().position(|c| c.kind == observation.kind);
            let k = known.unwrap_or_else(|| {
                self.children.push(Child::new(observation.kind));
                self.children.len() - 1
            });
            if let Some(child) = self.children.get_mut(k) {
                actions.extend(child.step(now, observation, &self.limits));
            }
        }
        actions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PILOT: ProcessKind = ProcessKind::Pilot;

    fn at(ms: i64) -> Time<SteadyClock> {
        Time::from_nanos(ms * 1_000_000)
    }
    fn observed(kind: ProcessKind, running: bool, reported_ms: Option<i64>) -> Vec<Observed> {
        vec![Observed {
            kind,
            running,
            reported: reported_ms.map(at),
        }]
    }

    #[test]
    fn failing_viewers_server() {
        let limits = SupervisorLimits {
            silence_timeout_s: Some(5.0),
            max_failures: Some(3),
        };
        let mut node = SupervisorNode::new(limits);
        let mut starts = Vec::new();
        for ms in (0..600_000).step_by(20) {
            for action in node.step(at(ms), &observed(ProcessKind::View, false, None)) {
                assert_eq!(action, SupervisorAction::Start(ProcessKind::View));
                starts.push(ms);
            }
        }
        let gaps: Vec<i64> = starts.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(
            gaps[0] <= 200 && gaps.iter().all(|gap| *gap <= 60_100),
            "{gaps:?}"
        );
        assert!(gaps.last().is_some_and(|gap| *gap >= 59_900), "{gaps:?}");
    }

    #[test]
    fn restart_delays_and_a_stable_run() {
        let mut node = SupervisorNode::new(SupervisorLimits::default());
        let mut starts = Vec::new();
        for ms in (0..8000).step_by(10) {
            if !node.step(at(ms), &observed(PILOT, false, None)).is_empty() {
                starts.push(ms);
            }
        }
        let delays: Vec<i64> = starts.windows(2).map(|w| w[1] - w[0]).collect();
        assert_eq!(delays[..5], [110, 210, 410, 810, 1610], "{starts:?}");
        assert!(delays[5..].iter().all(|d| *d == 2010), "{delays:?}");
        assert_eq!(node.restarts() as usize, starts.len() - 1);
        for ms in (8000..20_000).step_by(10) {
            assert!(node.step(at(ms), &observed(PILOT, true, Some(ms))).is_empty());
        }
        // No delay after a long run, then the initial delay.
        let starts = (20_000..20_200).step_by(10).filter(|&ms| {
            let actions = node.step(at(ms), &observed(PILOT, false, None));
            actions == [SupervisorAction::Start(PILOT)]
        });
        assert_eq!(starts.collect::<Vec<_>>(), [20_010, 20_120]);
    }

    #[test]
    fn silent_process_and_viewer_never_received() {
        let limits = SupervisorLimits {
            silence_timeout_s: Some(3.0),
            max_failures: None,
        };
        let cases = [
            // Never ready: five times the timeout, and twice that after a kill.
            (PILOT, None, vec![15_010, 45_020]),
            (PILOT, Some(1000), vec![4010, 10_020, 22_030, 46_040]),
            (ProcessKind::View, None, vec![]),
            (ProcessKind::View, Some(1000), vec![4010, 10_020, 22_030, 46_040]),
        ];
        for (kind, reported, kills) in cases {
            let mut node = SupervisorNode::new(limits);
            let mut killed = Vec::new();
            for ms in (0..50_000).step_by(10) {
                for action in node.step(at(ms), &observed(kind, ms > 0, reported.filter(|at| *at <= ms))) {
                    if matches!(action, SupervisorAction::Kill(..)) {
                        killed.push(ms);
                    }
                }
            }
            // Within two polls, because a permitted silence is a product of floating-point numbers.
            let near = |(a, b): (&i64, &i64)| (a - b).abs() <= 40;
            let same = killed.len() == kills.len() && killed.iter().zip(&kills).all(near);
            assert!(same, "{kind:?}: {killed:?}");
        }
        let mut node = SupervisorNode::new(limits);
        node.step(at(0), &observed(PILOT, false, None));
        for ms in (10..20_000).step_by(10) {
            assert!(
                node.step(at(ms), &observed(PILOT, true, Some(ms - ms % 500)))
                    .is_empty()
            );
        }
    }

    /// Times of each start and kill of a process, ms, on a busy computer where the first report comes `start_ms` after
    /// a start. Later reports come at 2 Hz, except while `hang` is true.
    fn on_a_busy_computer(
        kinds: &[ProcessKind],
        start_ms: i64,
        hang: impl Fn(i64) -> bool,
        for_ms: i64,
    ) -> Vec<(i64, SupervisorAction)> {
        let mut node = SupervisorNode::new(SupervisorLimits {
            silence_timeout_s: Some(3.0),
            max_failures: None,
        });
        let mut started: Vec<Option<i64>> = vec![None; kinds.len()];
        let mut reported: Vec<Option<i64>> = vec![None; kinds.len()];
        let mut actions = Vec::new();
        for ms in (0..for_ms).step_by(20) {
            let mut observations = Vec::new();
            for ((kind, began), newest) in kinds.iter().zip(&started).zip(&mut reported) {
                let up_ms = began.map(|began| ms - began - start_ms);
                if up_ms.is_some_and(|up| up >= 0 && up % 500 == 0) && !hang(ms) {
                    *newest = Some(ms);
                }
                observations.push(Observed {
                    kind: *kind,
                    running: began.is_some(),
                    reported: newest.map(at),
                });
            }
            for action in node.step(at(ms), &observations) {
                let (SupervisorAction::Start(kind)
                | SupervisorAction::Kill(kind, _)
                | SupervisorAction::GiveUp(kind)) = action;
                if let Some(k) = kinds.iter().position(|known| *known == kind) {
                    started[k] = matches!(action, SupervisorAction::Start(_)).then_some(ms);
                }
                actions.push((ms, action));
            }
        }
        actions
    }

    #[test]
    fn slow_starts_on_a_busy_computer() {
        let six = [
            ProcessKind::Bridge,
            ProcessKind::Predictor,
            ProcessKind::Mission,
            ProcessKind::Planner,
            PILOT,
            ProcessKind::Autopilot,
        ];
        for start_ms in [500, 5000, 20_000, 45_000] {
            let actions = on_a_busy_computer(&six, start_ms, |_| false, 200_000);
            let last_start = |kind| {
                let started = |a: &&(i64, SupervisorAction)| a.1 == SupervisorAction::Start(kind);
                actions.iter().rfind(started).map(|(ms, _)| *ms)
            };
            for kind in six {
                let ready = last_start(kind).unwrap() + start_ms;
                assert!(
                    ready <= 100_000,
                    "{kind:?} after starts of {start_ms} ms: {ready}"
                );
            }
            let kills = actions
                .iter()
                .filter(|(_, a)| matches!(a, SupervisorAction::Kill(..)))
                .count();
            assert!(kills <= 6 * 2 && (start_ms > 15_000 || kills == 0), "{kills}");
        }
    }

    #[test]
    fn allowed_silence_within_its_bound() {
        let kills = |actions: &[(i64, SupervisorAction)]| -> Vec<i64> {
            let killed =
                |(ms, a): &(i64, SupervisorAction)| matches!(a, SupervisorAction::Kill(..)).then_some(*ms);
            actions.iter().filter_map(killed).collect()
        };
        let never = kills(&on_a_busy_computer(&[PILOT], 1_000_000, |_| false, 1_000_000));
        assert!(never.len() >= 8, "{never:?}");
        assert!(never.windows(2).all(|w| w[1] - w[0] <= 123_000), "{never:?}");
        // The silence timeout of a process that hangs after long runs is the same at each hang.
        let hangs = |ms: i64| (30_000..40_000).contains(&ms) || (100_000..110_000).contains(&ms);
        let twice = kills(&on_a_busy_computer(&[PILOT], 200, hangs, 150_000));
        let after: Vec<i64> = [30_000, 100_000]
            .iter()
            .filter_map(|from| twice.iter().find(|ms| **ms > *from).map(|ms| ms - from))
            .collect();
        assert!(
            after.len() == 2 && after.iter().all(|ms| (2400..=3100).contains(ms)),
            "{twice:?}"
        );
    }

    #[test]
    fn restart_limits_and_the_world() {
        let mut node = SupervisorNode::new(SupervisorLimits {
            silence_timeout_s: None,
            max_failures: Some(3),
        });
        let world = ProcessKind::World;
        let first = node.step(at(0), &observed(world, false, None));
        assert_eq!(first, [SupervisorAction::Start(world)]);
        let mut last = Vec::new();
        let mut starts = 0;
        for ms in (10..3000).step_by(10) {
            assert!(node.step(at(ms), &observed(world, false, None)).is_empty());
            last = node.step(at(ms), &observed(PILOT, false, None));
            starts += usize::from(last == [SupervisorAction::Start(PILOT)]);
            if last == [SupervisorAction::GiveUp(PILOT)] {
                break;
            }
        }
        assert_eq!((last, starts), (vec![SupervisorAction::GiveUp(PILOT)], 3));
    }
}

//! The supervisor's decisions: which process is started, started again after which delay, killed for its
//! silence, or given up. Pure: what is observed of each process in, what is to be done out.

use alight_shared::node::Node;
use alight_shared::time::{Clock, Span, Time};
use alight_shared::transport::process::ProcessKind;
use serde::{Deserialize, Serialize};

/// Delay before a process is started again that had not run for long; doubles with each further failure.
const INITIAL_BACKOFF: Span = Span::from_millis(100);
/// Longest delay before a restart.
const MAX_BACKOFF: Span = Span::from_millis(2000);
/// The same of the viewers' server, which nothing needs: what keeps it from starting (its port is taken) stays.
const MAX_VIEW_BACKOFF: Span = Span::from_millis(60_000);
/// A process that ran for this long started well: it is started again at the next look.
const STABLE_RUN: Span = Span::from_millis(5000);

/// The operating system's steady clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SteadyClock;

impl Clock for SteadyClock {
    const NAME: &'static str = "steady clock";
}

/// What a supervisor tolerates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// A process that reports nothing for this long is killed, s; None: silence is tolerated.
    pub silence_timeout_s: Option<f64>,
    /// A process that failed so often in a row is given up; None: never, as in flight.
    pub max_failures: Option<u32>,
}

/// What is observed of one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Observed {
    /// Which.
    pub kind: ProcessKind,
    /// It lives.
    pub running: bool,
    /// When its newest report came, if one did.
    pub reported: Option<Time<SteadyClock>>,
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Action {
    /// Start it.
    Start(ProcessKind),
    /// Kill it: it has been silent for this long, s.
    Kill(ProcessKind, f64),
    /// It failed too often in a row.
    GiveUp(ProcessKind),
}

/// One process as the supervisor remembers it.
#[derive(Clone, Copy, Debug)]
struct Child {
    kind: ProcessKind,
    starts: u32,
    failures: u32,
    started: Time<SteadyClock>,
    /// Not started again before this.
    due: Time<SteadyClock>,
    backoff: Span,
    was_running: bool,
    killed: Option<Time<SteadyClock>>,
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
        }
    }
    fn on_exit(&mut self, now: Time<SteadyClock>) {
        self.was_running = false;
        if now - self.started > STABLE_RUN {
            (self.backoff, self.failures) = (Span::ZERO, 0);
        }
        self.failures = self.failures.saturating_add(1);
        self.due = now + self.backoff;
        let longest = match self.kind {
            ProcessKind::View => MAX_VIEW_BACKOFF,
            _ => MAX_BACKOFF,
        };
        self.backoff = (self.backoff * 2).clamp(INITIAL_BACKOFF, longest);
    }
    fn step(&mut self, now: Time<SteadyClock>, seen: &Observed, limits: &Limits) -> Option<Action> {
        if !seen.running {
            if self.was_running {
                // What it left in shared memory is cleaned up before the next begins.
                self.on_exit(now);
                return None;
            }
            // A simulated world that ended has lost its state: starting it again would be another flight.
            if self.starts > 0 && self.kind == ProcessKind::World || now < self.due {
                return None;
            }
            // Nothing needs the viewers' server: it ends no flight.
            let needed = self.kind != ProcessKind::View;
            if needed && limits.max_failures.is_some_and(|most| self.failures >= most) {
                return Some(Action::GiveUp(self.kind));
            }
            (self.started, self.was_running) = (now, true);
            self.starts = self.starts.saturating_add(1);
            return Some(Action::Start(self.kind));
        }
        self.was_running = true;
        let watched = match self.kind {
            // They report nothing.
            ProcessKind::World | ProcessKind::Link => false,
            // Its reports reach only a supervisor that is its service's manager.
            // A viewer's reach only where there is shared memory.
            ProcessKind::Vessel | ProcessKind::View => seen.reported.is_some(),
            ProcessKind::Bridge
            | ProcessKind::Predictor
            | ProcessKind::Mission
            | ProcessKind::Planner
            | ProcessKind::Pilot
            | ProcessKind::Autopilot
            | ProcessKind::Sensors
            | ProcessKind::Camera
            | ProcessKind::Uvdar => true,
        };
        let timeout_s = limits.silence_timeout_s.filter(|_| watched)?;
        let newest = [Some(self.started), self.killed, seen.reported];
        let silence_s = (now - newest.into_iter().flatten().max().unwrap_or(now)).secs();
        (silence_s > timeout_s).then(|| {
            self.killed = Some(now);
            Action::Kill(self.kind, silence_s)
        })
    }
}

/// The decisions as a node.
#[derive(Clone, Debug)]
pub struct SupervisorNode {
    limits: Limits,
    children: Vec<Child>,
}

impl SupervisorNode {
    /// Has started nothing yet.
    pub fn new(limits: Limits) -> SupervisorNode {
        SupervisorNode {
            limits,
            children: Vec::new(),
        }
    }
    /// Starts beyond the first, of all processes.
    pub fn restarts(&self) -> u32 {
        self.children.iter().map(|c| c.starts.saturating_sub(1)).sum()
    }
}

impl Node for SupervisorNode {
    type Clock = SteadyClock;
    /// Every process under supervision, in the order in which they start.
    type In = Vec<Observed>;
    type Out = Vec<Action>;

    fn step(&mut self, now: Time<SteadyClock>, input: &Vec<Observed>) -> Vec<Action> {
        let mut actions = Vec::new();
        for seen in input {
            let known = self.children.iter().position(|c| c.kind == seen.kind);
            let k = known.unwrap_or_else(|| {
                self.children.push(Child::new(seen.kind));
                self.children.len() - 1
            });
            if let Some(child) = self.children.get_mut(k) {
                actions.extend(child.step(now, seen, &self.limits));
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
        let limits = Limits {
            silence_timeout_s: Some(5.0),
            max_failures: Some(3),
        };
        let mut node = SupervisorNode::new(limits);
        let mut starts = Vec::new();
        for ms in (0..600_000).step_by(20) {
            // It ends at once.
            for action in node.step(at(ms), &observed(ProcessKind::View, false, None)) {
                assert_eq!(action, Action::Start(ProcessKind::View));
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
        let mut node = SupervisorNode::new(Limits::default());
        let mut starts = Vec::new();
        for ms in (0..8000).step_by(10) {
            // It ends at once.
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
        // Without a delay after a run that was long, and then with the first.
        let starts = (20_000..20_200).step_by(10).filter(|&ms| {
            let actions = node.step(at(ms), &observed(PILOT, false, None));
            actions == [Action::Start(PILOT)]
        });
        assert_eq!(starts.collect::<Vec<_>>(), [20_010, 20_120]);
    }

    #[test]
    fn silent_process_and_vessel_never_received() {
        let limits = Limits {
            silence_timeout_s: Some(3.0),
            max_failures: None,
        };
        let cases = [
            (PILOT, None, vec![3010, 6020]),
            (ProcessKind::Vessel, None, vec![]),
            (ProcessKind::Vessel, Some(1000), vec![4010, 7020]),
        ];
        for (kind, reported, kills) in cases {
            let mut node = SupervisorNode::new(limits);
            let mut killed = Vec::new();
            for ms in (0..8000).step_by(10) {
                for action in node.step(at(ms), &observed(kind, ms > 0, reported.filter(|at| *at <= ms))) {
                    if matches!(action, Action::Kill(..)) {
                        killed.push(ms);
                    }
                }
            }
            assert_eq!(killed, kills, "{kind:?}");
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

    #[test]
    fn restart_limits_and_the_world() {
        let mut node = SupervisorNode::new(Limits {
            silence_timeout_s: None,
            max_failures: Some(3),
        });
        let world = ProcessKind::World;
        let first = node.step(at(0), &observed(world, false, None));
        assert_eq!(first, [Action::Start(world)]);
        let mut last = Vec::new();
        let mut starts = 0;
        for ms in (10..3000).step_by(10) {
            assert!(node.step(at(ms), &observed(world, false, None)).is_empty());
            last = node.step(at(ms), &observed(PILOT, false, None));
            starts += usize::from(last == [Action::Start(PILOT)]);
            if last == [Action::GiveUp(PILOT)] {
                break;
            }
        }
        assert_eq!((last, starts), (vec![Action::GiveUp(PILOT)], 3));
    }
}

//! `alight faults`: every process killed and frozen in every phase of a live landing, and what came
//! of it.

use alight_shared::msg::State;
use alight_shared::transport::process::ProcessKind;
use alight_sim::harness::outcome::Ending;
use serde::Serialize;

use crate::exit::{CliError, Exit};
use crate::lab::live::args::FaultsArgs;
use crate::lab::live::fault::{FaultKind, FaultSpec, Moment, PROCESSES};
use crate::lab::live::fleet::{self, Done, Job};
use crate::table::{Cell, Table, verdict};
use crate::terminal::note;
use crate::{cells, terminal};

/// The phases of the table.
const PHASES: [State; 4] = [State::Approach, State::Tracking, State::Descent, State::Flare];

/// One case.
#[derive(Clone, Debug, Serialize)]
struct Case {
    fault: String,
    seed: u64,
    /// The state in which it happened.
    state: Option<State>,
    at_s: Option<f64>,
    recovery_s: Option<f64>,
    /// First contact minus fault, s.
    contact_after_s: Option<f64>,
    outcome: Option<Ending>,
    reason: String,
    unsafe_contacts: u32,
    position_error_m: Option<f64>,
    attempts: u32,
    restarts: u32,
    leftovers: Vec<String>,
    /// The mission's states from the fault on.
    then: Vec<String>,
}

impl Case {
    fn of(spec: FaultSpec, seed: u64, done: &Done) -> Case {
        let report = done.landed.as_ref();
        let fault = report.and_then(|r| r.live.fault.as_ref());
        let at_s = fault.and_then(|f| f.at_s);
        let contact = report.and_then(|r| r.live.first_contact_s);
        Case {
            fault: spec.to_string(),
            seed,
            state: fault.and_then(|f| f.state),
            at_s,
            recovery_s: fault.and_then(|f| f.recovery_s),
            contact_after_s: contact.zip(at_s).map(|(c, f)| c - f),
            outcome: report.map(|r| r.outcome.outcome),
            reason: report.map_or_else(
                || done.output.lines().last().unwrap_or_default().to_string(),
                |r| r.outcome.reason.clone(),
            ),
            unsafe_contacts: report.map_or(0, |r| r.outcome.unsafe_contacts),
            position_error_m: report.and_then(|r| r.outcome.position_error_m),
            attempts: report.map_or(0, |r| r.outcome.attempts),
            restarts: report.map_or(0, |r| r.live.restarts),
            leftovers: done.leftovers.clone(),
            then: report
                .into_iter()
                .flat_map(|r| &r.live.phases)
                .filter(|p| at_s.is_some_and(|at| p.t_s >= at))
                .map(|p| p.state.clone())
                .collect(),
        }
    }
    /// Whether the fault met the landing at all.
    fn was_injected(&self) -> bool {
        self.at_s.is_some()
    }
    /// Not into the water, no unsafe contact but in the flare, back, and nothing left.
    fn holds(&self) -> bool {
        let in_flare = self.state == Some(State::Flare);
        self.was_injected()
            && self.outcome.is_some_and(|o| o != Ending::Water)
            && (self.unsafe_contacts == 0 || in_flare)
            && self.recovery_s.is_some()
            && self.leftovers.is_empty()
    }
    /// What came of it, and why when it did not land.
    fn line(&self) -> String {
        let reason = match self.outcome {
            Some(Ending::Success) => String::new(),
            _ => format!(": {}", self.reason),
        };
        format!(
            "{} seed {} in {}: {}, {} s until it reported again  {}{reason}",
            self.fault,
            self.seed,
            self.state.map_or("no phase", State::name),
            self.outcome.map_or("none", Ending::name),
            self.recovery_s.map_or_else(|| "-".into(), |v| format!("{v:.2}")),
            verdict(if self.holds() { "holds" } else { "FAILS" }, self.holds()),
        )
    }
}

/// Flies all cases and shows the table.
pub fn run(args: &FaultsArgs) -> Result<Exit, CliError> {
    let mut specs = args.fault.clone();
    if specs.is_empty() {
        for moment in PHASES.map(Moment::In) {
            for process in PROCESSES.into_iter().filter(|p| *p != ProcessKind::Autopilot) {
                for kind in FaultKind::ALL {
                    specs.push(FaultSpec {
                        process,
                        kind,
                        moment,
                    });
                }
            }
        }
    }
    let specs: Vec<FaultSpec> = (0..args.repeat).flat_map(|_| specs.clone()).collect();
    let seed = |k: usize| args.seed0 + k as u64;
    let jobs: Vec<Job> = specs
        .iter()
        .enumerate()
        .map(|(k, spec)| Job {
            instance: format!("{}-{k}", args.instance),
            flags: ["--seed", &seed(k).to_string(), "--fault", &spec.to_string()]
                .map(str::to_string)
                .into_iter()
                .chain(args.land.clone())
                .collect(),
        })
        .collect();
    let case = |k: usize, done: &Done| specs.get(k).map(|spec| Case::of(*spec, seed(k), done));
    let done = fleet::fly(&jobs, usize::from(args.jobs), |k, d| {
        if let Some(case) = case(k, d) {
            note(args.json, case.line());
        }
    })?;
    let cases: Vec<Case> = done.iter().enumerate().filter_map(|(k, d)| case(k, d)).collect();
    note(args.json, matrix(&specs, &cases).text());
    let held = cases.iter().filter(|c| c.holds()).count();
    note(
        args.json,
        format!(
            "{held} of {} cases hold: not into the water, no unsafe contact but after a fault in the flare, the process back, nothing left behind",
            cases.len()
        ),
    );
    if args.json {
        terminal::json(&cases)?;
    }
    Ok(Exit::of(held == cases.len()))
}

/// Process and kind by moment: landed of flown, unsafe contacts.
fn matrix(specs: &[FaultSpec], cases: &[Case]) -> Table {
    let mut moments: Vec<Moment> = specs.iter().map(|s| s.moment).collect();
    moments.sort_unstable();
    moments.dedup();
    let mut table = Table::new(
        ..,
        ["process", "fault"]
            .into_iter()
            .chain(moments.iter().map(|m| m.name())),
    );
    for (process, kind) in PROCESSES.into_iter().flat_map(|p| FaultKind::ALL.map(|k| (p, k))) {
        if !specs.iter().any(|s| (s.process, s.kind) == (process, kind)) {
            continue;
        }
        let cell = |moment: &Moment| {
            let spec = FaultSpec {
                process,
                kind,
                moment: *moment,
            };
            let these = || {
                specs
                    .iter()
                    .zip(cases)
                    .filter(|(s, _)| **s == spec)
                    .map(|(_, c)| c)
            };
            let count = |is: fn(&Case) -> bool| these().filter(|c| is(c)).count();
            let notes = [
                (count(|c| c.unsafe_contacts > 0), "unsafe"),
                (count(|c| !c.was_injected()), "not injected"),
            ];
            let notes = notes.iter().filter(|(n, _)| *n > 0);
            let notes: Vec<String> = notes.map(|(n, what)| format!("{n} {what}")).collect();
            let landed = count(|c| c.outcome == Some(Ending::Success));
            match these().count() {
                0 => "-".into(),
                flown => Cell::from(format!("{landed} of {flown} landed")).note(notes.join(", ")),
            }
        };
        table.row(
            cells![process.name(), kind.name()]
                .into_iter()
                .chain(moments.iter().map(cell)),
        );
    }
    table
}

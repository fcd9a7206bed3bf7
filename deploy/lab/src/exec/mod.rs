//! `--planner exec:COMMAND` and `--predictor exec:COMMAND`: planners and predictors that are other programs.
//! Each period the program receives a line and answers with a line ([`protocol`]). If it fails to answer, the flight
//! continues without plans or forecasts.

mod child;
pub mod predictor;
pub mod protocol;
#[cfg(test)]
mod tests;

use alight_computer::terminal::note;
use alight_shared::{
    msg::{DeckForecast, DroneState, MissionState, Plan},
    schema::{self, LineFormat},
    time::{DroneTime, Span, Time},
    topics,
};
use alight_sim::baselines::own::{OwnLaw, OwnReport, Reported};
use alight_uav::{
    planner::{law::Law, model::ModelState, reference::PlanReference},
    settings::DroneSettings,
};

use child::{AnswerLimits, AnsweringChild};
use predictor::{PREDICTOR_VERSION, PredictorAnswer, PredictorInput};
use protocol::{Answer, Limits, MAX_SOLVE_S, PLANNER_VERSION, PlannerAnswer, PlannerInput};
use serde::Serialize;

/// Prefixes of names on the command line and in outcomes: plans are flown with the solve times that the program states,
/// otherwise the scenario's, so that a seed reproduces a flight; or with those measured.
const EXEC: &str = "exec:";
pub const EXEC_MEASURED: &str = "exec-measured:";

/// Command of a name with one of the prefixes.
pub fn command(name: &str) -> Option<&str> {
    name.strip_prefix(EXEC).or(name.strip_prefix(EXEC_MEASURED))
}

/// Planner run by the program that `name` starts; each flight starts a separate one.
pub fn planner(name: &str) -> OwnLaw {
    let own = name.to_owned();
    OwnLaw::new(name, move |drone, report| {
        Box::new(ExecLaw::start(&own, drone, report))
    })
}

/// The lines, for `alight config schema`.
pub const LINES: [LineFormat; 4] = [
    (
        "planner-input",
        PLANNER_VERSION,
        schema::of_input::<PlannerInput<'static>>,
    ),
    (
        "planner-answer",
        PLANNER_VERSION,
        schema::of_answer::<PlannerAnswer>,
    ),
    (
        "predictor-input",
        PREDICTOR_VERSION,
        schema::of_input::<PredictorInput<'static>>,
    ),
    (
        "predictor-answer",
        PREDICTOR_VERSION,
        schema::of_answer::<PredictorAnswer>,
    ),
];

#[derive(Debug)]
struct ExecLaw {
    child: Option<AnsweringChild>,
    /// Solve times are measured.
    measures: bool,
    report: OwnReport,
    limits: Limits,
    drone: Option<DroneState>,
    /// End of the newest solve that took longer than a period.
    solved_at: DroneTime,
    /// The newest answer leaves the plan to the common planner.
    common: bool,
}

impl ExecLaw {
    fn start(name: &str, drone: &DroneSettings, report: &OwnReport) -> ExecLaw {
        ExecLaw {
            child: start(name, report, PLANS),
            measures: name.starts_with(EXEC_MEASURED),
            report: report.clone(),
            limits: Limits::of(drone),
            drone: None,
            solved_at: Time::from_nanos(i64::MIN),
            common: false,
        }
    }
    fn answer(&mut self, now: DroneTime, input: &PlannerInput<'_>) -> Option<Result<(Answer, Span), String>> {
        let asked = ask(self.child.as_mut()?, input);
        Some(asked.and_then(|(line, took)| Ok((PlannerAnswer::read(&line, now)?, took))))
    }
}

impl Law for ExecLaw {
    fn observe(&mut self, drone: Option<&DroneState>, _: Option<&DeckForecast>, _: &PlanReference) {
        self.drone = drone.copied().or(self.drone);
    }
    fn plans_alone(&self) -> bool {
        !self.common
    }
    fn own_plan(
        &mut self,
        now: DroneTime,
        mission: &MissionState,
        forecast: Option<&DeckForecast>,
        _start: Option<(ModelState, f64)>,
    ) -> Option<Plan> {
        let stale_after = topics::DRONE_STATE.stale_after;
        let drone = self.drone.filter(|d| now - d.header.at <= stale_after)?;
        // A program that takes longer than a period is asked again when it is ready.
        if now < self.solved_at {
            return None;
        }
        let input = PlannerInput::of(now, (mission, &drone), forecast, self.limits);
        let answered = self.answer(now, &input)?;
        self.common = matches!(answered, Ok((Answer::Common, _)));
        *self.report.get() = Reported::default();
        match answered {
            Ok((Answer::Plan(plan, stated), measured)) => {
                let solve = if self.measures { Some(measured) } else { stated };
                self.report.get().solve = solve;
                let solve_s = solve.map_or(0.0, Span::secs);
                if solve_s > self.limits.period_s {
                    self.solved_at = now + Span::from_secs(solve_s);
                }
                if solve_s > MAX_SOLVE_S {
                    let why = format!(
                        "its plan took {solve_s:.2} s, and older ones than {MAX_SOLVE_S} s are not flown"
                    );
                    self.report.get().none = Some(why);
                    return None;
                }
                return Some(*plan);
            }
            Ok((Answer::None(why), _)) => self.report.get().none = Some(why),
            Ok((Answer::Common, _)) => {}
            Err(why) => {
                fail(&self.report, PLANS, why);
                self.child = None;
            }
        }
        None
    }
}

/// Names of the program and of its output, which the flight lacks after a failure.
type Part = [&'static str; 2];
const PLANS: Part = ["planner", "plans"];

fn start(name: &str, report: &OwnReport, part: Part) -> Option<AnsweringChild> {
    let started = AnsweringChild::start(command(name).unwrap_or(name), AnswerLimits::default());
    started.map_err(|why| fail(report, part, why)).ok()
}

fn ask(child: &mut AnsweringChild, input: &impl Serialize) -> Result<(Vec<u8>, Span), String> {
    let line = serde_json::to_string(input).map_err(|e| format!("cannot be asked: {e}"))?;
    child.ask(line + "\n")
}

fn fail(report: &OwnReport, [name, answers]: Part, why: String) {
    let text = format_args!("the {name} {why}: the flight continues without {answers}");
    note(true, text);
    report.get().failure = Some(why);
}

use std::{collections::BTreeMap, fmt::Write as _, fs, path::Path};

use alight_shared::{
    msg::{DeckForecast, DeckStage, Plan},
    process::ProcessKind,
    step::Step,
    time::WorldTime,
};
use alight_sim::harness::{
    observer::WorldObserver,
    outcome::Outcome,
    scenario::{NodeConfigs, Scenario},
    trial::{Watch, fly_with, outcome},
};
use alight_uav::planner::PlannerOut;

use super::{
    child::{AnswerLimits, AnsweringChild},
    predictor::PredictorAnswer,
    protocol::{Answer, AnsweredStage, PlannerAnswer},
    *,
};

const IMPATIENT: AnswerLimits = AnswerLimits {
    first_s: 0.3,
    next_s: 0.3,
};

fn asked(command: &str) -> Result<(Vec<u8>, Span), String> {
    AnsweringChild::start(command, AnswerLimits::default()).and_then(|mut c| c.ask("{}\n".into()))
}

#[test]
fn programs_that_do_not_answer_with_their_reasons() {
    let silent = AnsweringChild::start("cat > /dev/null", IMPATIENT).and_then(|mut c| c.ask("{}\n".into()));
    assert_eq!(silent.unwrap_err(), "did not answer within 0.3 s");
    for (command, why) in [
        ("exit 3", "ended (exit status: 3)"),
        ("exec no-such-program 2> /dev/null", "ended (exit status: 127)"),
        ("kill -9 $$", "ended (signal: 9 (SIGKILL))"),
        (
            "exec < /dev/null > /dev/null; sleep 100",
            "closed its input or output",
        ),
        (
            "head -c 300000 /dev/zero",
            "answered with a line of more than 131072 bytes",
        ),
    ] {
        assert_eq!(asked(command).unwrap_err(), why, "{command}");
    }
    let mut eager = AnsweringChild::start("echo one; echo two; cat > /dev/null", IMPATIENT).unwrap();
    assert_eq!(eager.ask("{}\n".into()).unwrap().0, b"one\n");
    let second = eager.ask("{}\n".into());
    let third = second.and_then(|_| eager.ask("{}\n".into()));
    assert!(third.is_err(), "{third:?}");
}

#[test]
fn end_of_a_program_and_of_what_it_has_started() {
    let mut child = AnsweringChild::start("sleep 1000 & echo $!; wait", AnswerLimits::default()).unwrap();
    let (line, _) = child.ask("{}\n".into()).unwrap();
    let pid: u32 = String::from_utf8(line).unwrap().trim().parse().unwrap();
    let runs = || fs::read_link(format!("/proc/{pid}/exe")).is_ok();
    assert!(runs());
    drop(child);
    for _ in 0..1000 {
        if !runs() {
            return;
        }
        alight_computer::process::supervisor::pause(std::time::Duration::from_millis(10));
    }
    panic!("{pid} still runs");
}

#[test]
fn answers_that_are_rejected_with_the_field() {
    let stage = r#"{"position":[0,0,-5],"velocity":[0,0,0],"acceleration":[0,0,0],"euler":[0,0,0]}"#;
    let plan = |rest: &str, count: usize| {
        let stages = vec![stage; count].join(",");
        format!(r#"{{"version":1,"stages":[{stages}],{rest}}}"#)
    };
    let read = |line: &str| PlannerAnswer::read(line.as_bytes(), Time::EPOCH);
    for (line, why) in [
        ("Traceback".into(), "answered \"Traceback\""),
        (r#"{"version":2,"common":true}"#.into(), "version 2 instead of 1"),
        (r#"{"version":1}"#.into(), "one of stages, none and common"),
        (r#"{"version":1,"plan":[]}"#.into(), "unknown field `plan`"),
        (plan(r#""step_s":0.1"#, 1), "1 instead of 2 to 41"),
        (plan(r#""step_s":0.1"#, 42), "42 instead of 2 to 41"),
        (plan(r#""step_s":0"#, 2), "step_s"),
        (plan(r#""step_s":0.1,"solve_s":60"#, 2), "solve_s"),
        (
            plan(r#""step_s":0.1"#, 2).replacen("-5", "-5e9", 1),
            "stages: a number is out of range",
        ),
        (plan(r#""step_s":0.1"#, 2).replacen("-5", "null", 1), "null"),
    ] {
        let e = read(&line).unwrap_err();
        assert!(e.contains(why), "{line}: {e}");
    }
    let none = read(r#"{"version":1,"none":"the deck is too steep"}"#).unwrap();
    assert!(matches!(none, Answer::None(why) if why == "the deck is too steep"));
    let stated = read(&plan(r#""step_s":0.1,"solve_s":0.03"#, 41)).unwrap();
    let Answer::Plan(plan, Some(solve)) = stated else {
        panic!("{stated:?}");
    };
    assert_eq!(
        (plan.stages.len(), plan.step, solve),
        (41, Span::from_millis(100), Span::from_millis(30))
    );
}

fn flown(scenario: &Scenario, command: &str, seed: u64) -> Outcome {
    let nodes = NodeConfigs {
        own: Some(planner(command)),
        ..NodeConfigs::default()
    };
    outcome(scenario, &nodes, seed, "").unwrap()
}
fn predicted(command: &str) -> Outcome {
    let nodes = NodeConfigs {
        predictor: Some(predictor::predictor(command)),
        ..NodeConfigs::default()
    };
    outcome(&Scenario::default(), &nodes, 1, "").unwrap()
}

#[test]
fn flights_by_forecasts_of_another_program() {
    let program = |answer: &str| {
        let text = format!(
            "import json, sys\nfor line in sys.stdin:\n    print(json.dumps({answer}), flush=True)\n"
        );
        let file = std::env::temp_dir().join(format!("alight-predictor-{}.py", std::process::id()));
        fs::write(&file, text).unwrap();
        let outcome = predicted(&format!("python3 {}", file.display()));
        fs::remove_file(&file).unwrap();
        outcome
    };
    let echoed = program("{'version': 1, 'stages': json.loads(line)['forecast']['stages']}");
    let included = outcome(&Scenario::default(), &NodeConfigs::default(), 1, "").unwrap();
    assert!(included.success && echoed.digest == included.digest, "{echoed:?}");
    let none = program("{'version': 1, 'none': 'no idea'}");
    assert!(!none.success && none.unsafe_contacts == 0, "{none:?}");
    let why = "; predictor: has no answer: no idea";
    assert!(none.reason.ends_with(why), "{}", none.reason);
}

#[test]
fn forecasts_that_are_rejected() {
    let own = DeckForecast::default();
    for (answer, why) in [
        (r#"{"version":2}"#, "answered in version 2 instead of 1"),
        (
            r#"{"version":1}"#,
            "answered with an invalid choice: give one of stages and none",
        ),
        (
            r#"{"version":1,"stages":[{"position":[0,0]}]}"#,
            "which is not the expected line of JSON",
        ),
        (
            &format!(
                r#"{{"version":1,"stages":[{}]}}"#,
                serde_json::to_string(&DeckStage::default()).unwrap()
            ),
            "answered with 1 stages instead of 0",
        ),
    ] {
        let rejected = PredictorAnswer::read(answer.as_bytes(), &own).unwrap_err();
        assert!(rejected.contains(why), "{rejected}");
    }
}

#[test]
fn flight_whose_planner_ends_goes_on_without_plans() {
    let some = "for i in 1 2 3 4 5; do read -r l; echo '{\"version\":1,\"common\":true}'; done";
    let outcome = flown(&Scenario::default(), &format!("{some}; exit 3"), 1);
    assert!(!outcome.success && outcome.unsafe_contacts == 0, "{outcome:?}");
    let why = "; planner: ended (exit status: 3)";
    assert!(outcome.reason.ends_with(why), "{}", outcome.reason);
}

#[derive(Default)]
struct Plans(BTreeMap<i64, Plan>);

impl WorldObserver for Plans {
    fn step(&mut self, _t: WorldTime, step: &Step<'_>) {
        let plan = step.output::<PlannerOut>().and_then(|out| out.plan);
        if let Some(plan) = plan.filter(|_| step.process == ProcessKind::Planner) {
            self.0.insert(step.now_ns, plan);
        }
    }
}

fn write_answers(plans: &Plans, path: &Path) {
    let mut text = String::new();
    for (now_ns, plan) in &plans.0 {
        let stages = plan.stages.iter().map(|s| AnsweredStage {
            position: s.position,
            velocity: s.velocity,
            acceleration: s.acceleration,
            euler: s.euler,
            euler_rates: Some(s.euler_rates),
        });
        let answer = PlannerAnswer {
            version: protocol::PLANNER_VERSION,
            step_s: Some(plan.step.secs()),
            stages: Some(stages.collect()),
            touchdown_s: plan.touchdown_at.map(|t| t.secs()),
            disturbance: Some(plan.disturbance),
            solve_s: Some(Scenario::default().solve_delay_s),
            ..PlannerAnswer::default()
        };
        let time_s = serde_json::to_string(&DroneTime::from_nanos(*now_ns).secs()).unwrap();
        writeln!(text, "{time_s} {}", serde_json::to_string(&answer).unwrap()).unwrap();
    }
    fs::write(path, text).unwrap();
}

const REPLAY: &str = "import json, sys
answers = dict((float(t), a) for t, a in (line.split(' ', 1) for line in open(sys.argv[1])))
for line in sys.stdin:
    time_s = json.loads(line)['time_s']
    print(answers.get(time_s, '{\"version\":1,\"none\":\"not recorded\"}').strip(), flush=True)
";

#[test]
fn recorded_plans_fly_the_same_bits() {
    let directory = std::env::temp_dir().join(format!("alight-exec-{}", std::process::id()));
    fs::create_dir_all(&directory).unwrap();
    let program = directory.join("replay.py");
    fs::write(&program, REPLAY).unwrap();
    let scenario = Scenario::default();
    for seed in [1, 2] {
        let mut plans = Plans::default();
        let watch = Watch {
            on_event: &mut |_| {},
            trace_step_s: None,
        };
        let included = fly_with(&scenario, &NodeConfigs::default(), seed, "", watch, &mut plans).unwrap();
        let file = directory.join(format!("{seed}.txt"));
        write_answers(&plans, &file);
        let command = format!("python3 {} {}", program.display(), file.display());
        let own = flown(&scenario, &command, seed);
        assert!(included.outcome.success, "{:?}", included.outcome);
        assert_eq!(
            own.digest, included.outcome.digest,
            "{own:?} {:?}",
            included.outcome
        );
    }
    fs::remove_dir_all(&directory).unwrap();
}

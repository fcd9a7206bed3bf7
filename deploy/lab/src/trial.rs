use alight_computer::{
    config::view::ViewConfig,
    exit::{CliError, Doing, Exit},
    playback::{StartViewer, Viewer},
    terminal::{self, note},
};
use alight_shared::msg::{ComputerReport, Reason, ReasonCode};
use alight_sim::{
    chart::landing,
    harness::trial::{Event, FlownTrial, Watch, fly},
};

use crate::{
    args::TrialArgs,
    chart, outcome_table, record,
    scene::{Scene, stopwatch},
};

/// Flies one landing, shows its phases, and ends with a table.
pub fn run(args: &TrialArgs, viewer: StartViewer<'_>) -> Result<Exit, CliError> {
    let scene = Scene::of(&args.scene)?;
    if let Some(path) = &args.plot {
        chart::can_write(path)?;
    }
    let elapsed = stopwatch();
    let mut newest = Reason::default();
    let mut show = |event: &Event| {
        let Event::Phase { t_s, name, reason } = event;
        newest = *reason;
        let line = format!("{t_s:>7.2} s  {name:<16} {reason}");
        // With --json standard output contains only the object.
        note(args.form.alone(), line);
    };
    let watch = Watch {
        on_event: &mut show,
        trace_step_s: args.plot.as_ref().map(|_| 0.05),
    };
    let (flight, recorded) = flown(args, &scene, watch, viewer)?;
    let mut outcome = flight.outcome;
    outcome.wall_time_s = elapsed();
    let matched = (newest.code == ReasonCode::Matched).then(|| newest.to_string());
    if let (Some(path), Some(trace)) = (&args.plot, &flight.trace) {
        chart::landing(trace, &landing::title(&outcome), path)?;
    }
    if !args.form.print(&outcome, &[&outcome])? {
        terminal::line(format_args!(
            "\n{}",
            outcome_table::outcome(&outcome, matched.as_deref(), usize::MAX)
        ));
        if let Some(path) = &args.plot {
            terminal::line(format_args!("plot: {}", path.display()));
        }
        if let Some(path) = args.record.as_ref().filter(|_| recorded.is_ok()) {
            terminal::line(format_args!("recording: {}", path.display()));
        }
    }
    recorded?;
    Ok(Exit::of(outcome.success || matched.is_some()))
}

fn flown(
    args: &TrialArgs,
    scene: &Scene,
    watch: Watch<'_>,
    viewer: StartViewer<'_>,
) -> Result<(FlownTrial, Result<(), CliError>), CliError> {
    let mut observer = observer(args, scene, viewer)?;
    if args.record.is_none() && observer.is_none() {
        let flown = fly(&scene.scenario, &scene.nodes, args.seed, &scene.sea, watch);
        return Ok((flown.doing("setting up the trial")?, Ok(())));
    }
    let subject = record::RecordingScene {
        scenario: &scene.scenario,
        nodes: &scene.nodes,
        seed: args.seed,
        sea: &scene.sea,
        live: false,
    };
    record::fly(args.record.as_deref(), &subject, watch, observer.as_deref_mut())
}

fn observer(
    args: &TrialArgs,
    scene: &Scene,
    start: StartViewer<'_>,
) -> Result<Option<Box<dyn Viewer>>, CliError> {
    let Some(view) = args.view.over(&ViewConfig::default()) else {
        return Ok(None);
    };
    let deck = &scene.scenario.deck;
    let airframe = &scene.scenario.airframe;
    let known = ComputerReport {
        title: format!("trial, sea {}, seed {}", scene.sea, args.seed)
            .as_str()
            .into(),
        deck: Some(scene.nodes.drone.deck.dimensions()),
        deck_tilt_rad: Some(scene.nodes.drone.mission.deck_tilt_rad),
        disarm_s: Some(scene.nodes.autopilot.disarm.longest_s()),
        ..ComputerReport::default()
    };
    let bodies = Some((*deck, *airframe));
    let observer = start(&view, "trial", known, bodies)?;
    observer.begin(args.form.alone());
    Ok(Some(observer))
}

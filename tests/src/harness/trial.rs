//! One landing: from a scenario, the nodes' configurations and a seed to an [`Outcome`].

use alight_shared::{
    msg::{CommandKind, PlanRefusal, Reason, State},
    time::Span,
};

use crate::harness::{
    observer::{NoObserver, WorldObserver},
    outcome::{Judge, Outcome, TIME_LIMIT_S, centroid_error},
    physics::TICK,
    rig::Rig,
    scenario::{NodeConfigs, Scenario, SetupError},
    storm::Schedule,
    trace::Trace,
    world::World,
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    Phase {
        t_s: f64,
        name: &'static str,
        reason: Reason,
    },
}

pub struct Watch<'a> {
    pub on_event: &'a mut dyn FnMut(&Event),
    /// Interval of the trace's points, s; None: no trace.
    pub trace_step_s: Option<f64>,
}

pub struct FlownTrial {
    pub outcome: Outcome,
    pub trace: Option<Trace>,
}

/// `sea` is the sea's name in the outcome.
pub fn fly(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    sea: &str,
    watch: Watch<'_>,
) -> Result<FlownTrial, SetupError> {
    fly_with(scenario, nodes, seed, sea, watch, &mut NoObserver)
}

pub fn outcome(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    sea: &str,
) -> Result<Outcome, SetupError> {
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    Ok(fly(scenario, nodes, seed, sea, watch)?.outcome)
}

pub fn fly_with(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    sea: &str,
    watch: Watch<'_>,
    observer: &mut dyn WorldObserver,
) -> Result<FlownTrial, SetupError> {
    let world = World::new(scenario, nodes, seed)?;
    Ok(land(world, scenario, nodes, seed, sea, watch, observer))
}

/// The warm-up of `world` has not begun yet.
pub fn land(
    mut world: World,
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    sea: &str,
    watch: Watch<'_>,
    observer: &mut dyn WorldObserver,
) -> FlownTrial {
    world.warm_up(observer);
    world.command(CommandKind::Land);
    let mut rig = Rig::of(world, scenario, nodes);
    let mut faults = Schedule::new(&scenario.faults);

    let half_deck = [scenario.deck.length_m / 2.0, scenario.deck.width_m / 2.0];
    let mut judge = Judge::default();
    let mut trace = watch.trace_step_s.map(|step_s| Trace {
        step_s,
        ..Trace::default()
    });
    let mut state = State::Idle;
    let mut next_point = 0.0;
    let mut ages: Option<[f64; 2]> = None;
    let mut odds = [None; 2];
    let mut committed_harm = None;
    let mut refusal: Option<PlanRefusal> = None;
    let mut refused_s = 0.0;
    // The judge's time limit bounds the loop.
    for _ in 0..(TIME_LIMIT_S / TICK.secs()) as u64 + 2 {
        faults.act(&mut rig);
        rig.advance(observer);
        let world = &mut rig.world;
        let t_s = world.physics().time_since_start().secs();
        let mission = world.mission_state();
        if mission.state != state {
            state = mission.state;
            let name = state.name();
            let reason = mission.entered;
            (watch.on_event)(&Event::Phase { t_s, name, reason });
            if state == State::Flare {
                committed_harm = mission.harm;
            }
            if state == State::Descent {
                odds = [mission.likelihood, mission.harm];
                committed_harm = None;
                world.ask_change();
            }
        }
        if let Some(why) = world.drones()[0].last_set_point.and_then(|s| s.plan_refusal) {
            refusal = Some(why);
            refused_s += TICK.secs();
        }
        if let Some(trace) = trace.as_mut()
            && t_s + 1e-9 >= next_point
        {
            next_point += trace.step_s;
            trace.points.push(world.physics().trace_point(0));
        }
        let over = judge.observe(&world.observation(), half_deck);
        if let (Some(trace), Some(t)) = (trace.as_mut(), judge.first_contact_s()) {
            trace.touchdown_s = Some(t);
        }
        if judge.first_contact_s().is_some()
            && ages.is_none()
            && let Some(forecast) = world.drones()[0].forecast
        {
            ages = Some([forecast.radio_age_s, forecast.vision_age_s]);
        }
        if over {
            break;
        }
    }
    let sim_time_s =
        rig.world.physics().time_since_start().secs() + Span::from_secs(scenario.start.warm_up_s).secs();
    let mut outcome = judge.outcome(seed, sea, nodes.planner_name(), sim_time_s);
    [outcome.radio_age_s, outcome.vision_age_s] =
        [0, 1].map(|i| ages.and_then(|a| a.get(i).copied()).filter(|a| a.is_finite()));
    [outcome.likelihood, outcome.harm] = odds;
    outcome.committed_harm = committed_harm;
    outcome.predictor = nodes.predictor.as_ref().map(|own| own.name().into());
    outcome.refused_plans = refused_s / rig.world.physics().time_since_start().secs();
    if let Some(why) = refusal
        && !outcome.success
    {
        outcome.reason += &format!("; plans not flown for {refused_s:.2} s, last because {why}");
    }
    for why in rig.world.drones()[0].own_failures() {
        outcome.reason += &format!("; {why}");
    }
    outcome.digest = format!("{:016x}", rig.world.physics().digest());
    for _ in 0..(scenario.stay_s / TICK.secs()) as u64 {
        faults.act(&mut rig);
        rig.advance(observer);
    }
    if scenario.stay_s > 0.0 && outcome.success {
        outcome.stay_position_error_m = Some(centroid_error(&rig.world.observation().feet));
    }
    FlownTrial { outcome, trace }
}

//! The planner: a trajectory for the next seconds, again and again.
//!
//! Reading order: [`mpc_faa`] (the problem), [`model`] and [`weights`] (its parts), [`reference`]
//! (what it follows in each mission state), [`rendezvous`] (what `alight` follows in a landing), [`condensed`] and [`qp`] (how it is solved), this file
//! (when, from where, and what becomes of it).
//!
//! A plan starts from the previous plan sampled at now, not from the measured state: the pilot's
//! tracker closes the loop, and a lagging drone does not bend its own plan. It starts from the
//! measured state when there is no plan, when the last is old, when the drone is further from it
//! than [`config::Reset`] allows, and when the autopilot's position estimate jumped. In a landing of
//! `alight` it starts no higher above the drone, and sinking no slower, than that is.

pub mod baselines;
pub mod condensed;
pub mod config;
mod governor;
pub mod model;
pub mod mpc_faa;
pub mod qp;
pub mod reference;
pub mod rendezvous;
pub mod weights;

#[cfg(test)]
mod start_tests;
#[cfg(test)]
mod tests;

use alight_shared::frames::wrap_angle;
use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use alight_shared::msg::{
    AutopilotState, DeckForecast, DroneState, Header, MESSAGE_VERSION, Message, MissionState, Phase, Plan,
    PlanStage, Solve,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

pub use config::{PlannerConfig, PlannerKind};

use baselines::Views;
use baselines::mpc_ne::MpcNe;
use model::{INPUTS, State};
use mpc_faa::{Mpc, Problem, Solution};
use reference::{Reference, ReferenceGenerator, clearance, tilt_of, up_of};
use rendezvous::wind::Wind;
use rendezvous::{Rendezvous, true_tilt};

/// What the planner hears.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlannerIn {
    /// The predicted deck.
    pub forecast: Option<DeckForecast>,
    /// What is permitted.
    pub mission: Option<MissionState>,
    /// Odometry.
    pub drone: Option<DroneState>,
    /// The autopilot: its origin-reset counter.
    pub autopilot: Option<AutopilotState>,
}

/// What it says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlannerOut {
    /// A new plan, starting now.
    pub plan: Option<Plan>,
}

/// What happened, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlannerCounters {
    /// Inputs refused: wrong version, impossible numbers, out of order, from the future.
    pub rejected: u32,
    /// Plans made.
    pub plans: u32,
    /// Of these, how many needed the solver.
    pub constrained: u32,
    /// Solves without a solution.
    pub infeasible: u32,
    /// Starts from the measured state.
    pub resets: u32,
}

/// A plan as the solver left it: exact at any time, not only at its stages.
#[derive(Clone, Debug)]
struct SolvedPlan {
    at: Time<DroneClock>,
    start: State,
    solution: Solution,
}

/// The node.
#[derive(Debug)]
pub struct Planner {
    config: PlannerConfig,
    drone_geometry: DroneGeometry,
    boot: u32,
    sequence: u32,
    mpc: Mpc,
    generator: ReferenceGenerator,
    rendezvous: Rendezvous,
    views: Views,
    ne: Option<MpcNe>,
    /// Time to the chosen instant of contact in the last plan, s.
    time_to_contact_s: Option<f64>,
    wind: Option<Wind>,
    problem: Problem,
    reference: Reference,
    scratch: Solution,
    solved: Option<SolvedPlan>,
    last_solve: Option<(Time<DroneClock>, Phase)>,
    forecast: Option<DeckForecast>,
    mission: Option<MissionState>,
    drone: Option<DroneState>,
    autopilot: Option<AutopilotState>,
    counters: PlannerCounters,
}

impl Planner {
    /// A planner for this drone and deck. `boot` tells this start from others.
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry, deck: &DeckGeometry, boot: u32) -> Self {
        Planner {
            config: config.clone(),
            drone_geometry: *drone,
            boot,
            sequence: 0,
            mpc: Mpc::new(config, drone),
            generator: ReferenceGenerator::new(config, drone, deck),
            rendezvous: Rendezvous::new(&config.rendezvous, drone),
            views: Views::new(config, drone),
            ne: (config.kind == PlannerKind::MpcNe).then(|| MpcNe::new(config, drone)),
            time_to_contact_s: None,
            wind: (config.kind == PlannerKind::Alight).then(Wind::default),
            problem: Problem::default(),
            reference: Reference::default(),
            scratch: Solution::default(),
            solved: None,
            last_solve: None,
            forecast: None,
            mission: None,
            drone: None,
            autopilot: None,
            counters: PlannerCounters::default(),
        }
    }

    /// What happened so far.
    pub fn counters(&self) -> &PlannerCounters {
        &self.counters
    }
    /// The last problem, for benchmarks and displays.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }
    /// What the last references amounted to.
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    fn receive(&mut self, now: Time<DroneClock>, input: &PlannerIn) {
        let c = &self.config;
        let jumped = |old: &Option<AutopilotState>, new: &Option<AutopilotState>| match (old, new) {
            (Some(a), Some(b)) => a.origin_resets != b.origin_resets,
            _ => false,
        };
        let rejected = &mut self.counters.rejected;
        admit(
            now,
            c.forecast_age_s,
            &input.forecast,
            &mut self.forecast,
            rejected,
        );
        admit(now, c.mission_age_s, &input.mission, &mut self.mission, rejected);
        let last = self.drone.map(|d| d.header.at);
        admit(now, c.odometry_age_s, &input.drone, &mut self.drone, rejected);
        let before = self.autopilot;
        // Any age will do for a counter of jumps.
        admit(now, 10.0, &input.autopilot, &mut self.autopilot, rejected);
        if jumped(&before, &self.autopilot) {
            self.solved = None;
            self.generator.forget();
        }
        if let Some(wind) = &mut self.wind
            && let Some(d) = self.drone.filter(|d| Some(d.header.at) != last)
        {
            let near = self.reference.touch && self.reference.clearance_m < c.rendezvous.wind.free_m;
            wind.update(&d, near, &c.rendezvous.wind);
        }
    }

    /// The wind that plans allow for, as its acceleration, m/s²: where there is one, a state's tilt
    /// is the acceleration that it causes in this wind, else the lean of the body.
    fn wind(&self) -> Vector2<f64> {
        self.wind.as_ref().map_or_else(Vector2::zeros, Wind::value)
    }

    /// Where the plan starts: the last plan now, or the measured state. None without odometry.
    fn start(&mut self, now: Time<DroneClock>) -> Option<(State, [f64; INPUTS])> {
        let drone = self
            .drone
            .filter(|d| is_fresh(now, d.header.at, self.config.odometry_age_s))?;
        let mut measured = measured_state(&drone);
        let wind = self.wind() / GRAVITY;
        measured[3] += wind.y;
        measured[4] -= wind.x;
        let r = &self.config.reset;
        if let Some(solved) = &self.solved
            && is_fresh(now, solved.at, r.age_s)
        {
            let (then, _) = self.at(solved, drone.header.at); // compared at the odometry's time
            let gap: [f64; 12] = core::array::from_fn(|i| measured[i] - then[i]);
            let near = gap[0].hypot(gap[1]) <= r.horizontal_m
                && gap[6].hypot(gap[7]) <= r.horizontal_mps
                && gap[2].abs() <= r.vertical_m
                && gap[8].abs() <= r.vertical_mps
                && wrap_angle(gap[5]).abs() <= r.yaw_deg.to_radians();
            if near {
                let (mut state, input) = self.at(solved, now);
                if self.ours() {
                    // A drone that is lower than its plan meets the deck sooner and faster than the plan
                    // believes. One that is higher keeps the plan: the gap is what presses it down.
                    for (i, max) in [(2, r.ahead_m), (8, r.ahead_mps)] {
                        state[i] += (gap[i] - max).max(0.0);
                    }
                }
                return Some((state, input));
            }
        }
        self.solved = None;
        self.generator.restart();
        self.counters.resets += 1;
        // Limits are soft except those of the inputs, and hover is inside these.
        Some((measured, [0.0; INPUTS]))
    }

    /// Whether the rendezvous planner is landing.
    fn ours(&self) -> bool {
        let landing = self.last_solve.is_some_and(|(_, p)| p == Phase::Landing);
        landing && self.config.kind == PlannerKind::Alight
    }

    /// A flight's state and input at a time, exactly: whole stages from the solver's states, the
    /// rest rolled. Before its start the start, after its end constant velocity and level.
    fn at(&self, solved: &SolvedPlan, t: Time<DroneClock>) -> (State, [f64; INPUTS]) {
        let step = self.mpc.step_s();
        let x = (t - solved.at).secs().max(0.0) / step;
        let k = (x + 1e-6).floor() as usize;
        let rest = ((x - k as f64) * step).max(0.0);
        let from = match k.checked_sub(1) {
            None => Some(solved.start),
            Some(i) => solved.solution.states.get(i).copied(),
        };
        match (from, solved.solution.inputs.get(k)) {
            (Some(state), Some(input)) if rest > 1e-6 => (self.mpc.roll(&state, input, rest), *input),
            (Some(state), Some(input)) => (state, *input),
            _ => {
                let mut s = solved.solution.states.last().copied().unwrap_or(solved.start);
                let beyond = (x - solved.solution.states.len() as f64) * step;
                for i in 0..3 {
                    s[i] += s[6 + i] * beyond;
                }
                for i in [3, 4, 9, 10, 11] {
                    s[i] = 0.0;
                }
                (s, [0.0; INPUTS])
            }
        }
    }

    fn due(&mut self, now: Time<DroneClock>, phase: Phase) -> bool {
        let rate = match phase {
            Phase::None => return false,
            Phase::Navigation => self.config.navigation_hz,
            Phase::Follow | Phase::Landing => self.config.landing_hz,
        };
        // Half a tick of the fastest world early is on time.
        const EARLY_S: f64 = 0.004;
        match self.last_solve {
            Some((at, before)) => before != phase || (now - at).secs() >= 1.0 / rate - EARLY_S,
            None => true,
        }
    }

    /// The rendezvous begins where the drone is: what the autopilot's own position loop has left
    /// open, 0.5 m or more, would take the pilot longer to close than the landing lasts.
    fn begin_landing(&mut self, phase: Phase) {
        let begins = phase == Phase::Landing && self.last_solve.is_none_or(|(_, before)| before != phase);
        let c = &self.config;
        if begins && c.kind == PlannerKind::Alight && c.rendezvous.start_from_measured {
            self.solved = None;
        }
    }

    fn plan(&mut self, now: Time<DroneClock>, mission: &MissionState) -> Option<Plan> {
        if let Some(plan) = self.own_law(now, mission) {
            return Some(plan);
        }
        let (state, input) = self.start(now)?;
        let forecast = self
            .forecast
            .filter(|f| is_fresh(now, f.header.at, self.config.forecast_age_s));
        let view = self.views.view(self.config.kind, now, mission, forecast, &state);
        let (mission, forecast) = (&view.mission, view.forecast);
        self.problem.state = state;
        self.problem.input = input;
        let (n, step) = (self.mpc.stages(), self.mpc.step_s());
        self.generator.reference(
            now,
            mission,
            forecast.as_ref(),
            n,
            step,
            &mut self.problem,
            &mut self.reference,
        );
        self.write_references(now, mission, forecast.as_ref(), step);
        let (generator, reference) = (&self.generator, &self.reference);
        self.mpc.solve(
            &mut self.problem,
            |k, x, y| generator.ceiling(reference, k, x, y),
            &mut self.scratch,
        );
        self.counters.plans += 1;
        if self.scratch.iterations > 0 {
            self.counters.constrained += 1;
        }
        let (solve, iterations) = (self.scratch.solve, self.scratch.iterations);
        match solve {
            Solve::Optimal | Solve::IterationLimit => {
                let kept = self.solved.get_or_insert_with(|| SolvedPlan {
                    at: now,
                    start: state,
                    solution: Solution::default(),
                });
                kept.at = now;
                kept.start = state;
                core::mem::swap(&mut kept.solution, &mut self.scratch);
            }
            // The previous flight goes on until it is too old; then the measured state begins anew.
            Solve::Infeasible => self.counters.infeasible += 1,
        }
        let solved = self.solved.as_ref()?;
        let mut plan = self.written(now, solved);
        plan.solve = solve;
        plan.iterations = iterations;
        plan.alignment = self.reference.alignment;
        plan.touchdown_at = self.touchdown(now, solved);
        plan.check().is_ok().then_some(plan)
    }

    /// The plan of a baseline that has its own model and solver, while it has one.
    fn own_law(&mut self, now: Time<DroneClock>, mission: &MissionState) -> Option<Plan> {
        let mut ne = self.ne.take()?;
        let fresh = self
            .forecast
            .filter(|f| is_fresh(now, f.header.at, self.config.forecast_age_s));
        let mut plan = None;
        if let (Some(forecast), true) = (fresh, MpcNe::flies(mission.state)) {
            let drone = self.drone.map(|d| (d.header.at, measured_state(&d)));
            if !ne.goes_on(now, drone.as_ref(), &self.config.reset)
                && let Some((state, input)) = self.start(now)
            {
                ne.begin(now, &state, self.mpc.model().vertical * input[0]);
            }
            plan = ne.plan(now, mission, &forecast);
        }
        if let Some(plan) = &mut plan {
            plan.header = Header::new(0, 0, self.boot, self.sequence, now);
            // When it ends, the common planner begins from the measured state.
            self.solved = None;
            self.generator.restart();
            self.counters.plans += 1;
        } else {
            ne.leave();
        }
        self.ne = Some(ne);
        plan.filter(|p| p.check().is_ok())
    }

    /// The rendezvous' references in place of the guide's.
    fn write_references(
        &mut self,
        now: Time<DroneClock>,
        mission: &MissionState,
        forecast: Option<&DeckForecast>,
        step: f64,
    ) {
        self.time_to_contact_s = None;
        let ours = match self.config.kind {
            PlannerKind::Alight => Rendezvous::lands(mission.state),
            PlannerKind::MpcFaa
            | PlannerKind::Mpc
            | PlannerKind::MpcNe
            | PlannerKind::WaitCalm
            | PlannerKind::PrecisionLand
            | PlannerKind::GnssRadio => false,
        };
        let Some(forecast) = forecast.filter(|_| ours) else {
            self.rendezvous.forget();
            return;
        };
        let wind = self.wind();
        self.time_to_contact_s = self.rendezvous.write_references(
            now,
            mission,
            forecast,
            step,
            &wind,
            &mut self.problem,
            &self.reference,
        );
        self.reference.touch = self.time_to_contact_s.is_some();
        self.reference.alignment = self.problem.weight.first().map_or(0.0, |w| w[3]);
        self.generator.keep_dry(&self.reference, &mut self.problem);
    }

    /// The flight as a message from `now` on: at half steps where they fit, so that the pilot's
    /// interpolation is fine.
    fn written(&self, now: Time<DroneClock>, solved: &SolvedPlan) -> Plan {
        let (n, step) = (self.mpc.stages(), self.mpc.step_s());
        let halves = 2 * n < alight_shared::msg::PLAN_STAGES;
        let mut plan = Plan {
            header: Header::new(0, 0, self.boot, self.sequence, now),
            step: Span::from_secs(if halves { 0.5 * step } else { step }),
            disturbance: self.wind().into(),
            ..Plan::default()
        };
        let mut keep = |state: &State, input: &[f64; INPUTS]| {
            // Capacity is checked by the configuration: n < PLAN_STAGES.
            let _ = plan.stages.push(self.stage(state, input));
        };
        if solved.at == now {
            let mut state = solved.start;
            for (input, next) in solved.solution.inputs.iter().zip(&solved.solution.states) {
                keep(&state, input);
                if halves {
                    keep(&self.mpc.half_step(&state, input), input);
                }
                state = *next;
            }
            keep(&state, &[0.0; INPUTS]);
        } else {
            let stride = plan.step;
            let count = if halves { 2 * n } else { n };
            for k in 0..=count {
                let (state, input) = self.at(solved, now + stride * k as i64);
                keep(&state, &input);
            }
        }
        plan
    }

    /// A state as a stage of the message: tilt turned into the body's heading.
    fn stage(&self, s: &State, input: &[f64; INPUTS]) -> PlanStage {
        let down = self.mpc.model().vertical * input[0];
        let (north, east, growth) = match self.config.kind {
            PlannerKind::MpcFaa
            | PlannerKind::Mpc
            | PlannerKind::MpcNe
            | PlannerKind::WaitCalm
            | PlannerKind::PrecisionLand
            | PlannerKind::GnssRadio => (s[3], s[4], 1.0),
            PlannerKind::Alight if !self.config.rendezvous.true_tilt => {
                let wind = self.wind() / GRAVITY;
                (s[3] - wind.y, s[4] + wind.x, 1.0)
            }
            PlannerKind::Alight => true_tilt(s, down, &self.wind()),
        };
        let (phi, theta) = tilt_of(&up_of(north, east), s[5]);
        let (sin, cos) = s[5].sin_cos();
        PlanStage {
            position: [s[0], s[1], s[2]],
            velocity: [s[6], s[7], s[8]],
            acceleration: [-GRAVITY * s[4], GRAVITY * s[3], down],
            euler: [phi, theta, wrap_angle(s[5])],
            euler_rates: [
                growth * (cos * s[9] + sin * s[10]) + s[11] * theta,
                growth * (-sin * s[9] + cos * s[10]) - s[11] * phi,
                s[11],
            ],
        }
    }

    /// When the feet reach the deck's plane in this flight, if they are meant to.
    fn touchdown(&self, now: Time<DroneClock>, solved: &SolvedPlan) -> Option<Time<DroneClock>> {
        if !self.reference.touch {
            return None;
        }
        if let Some(left) = self.time_to_contact_s.filter(|left| left.is_finite()) {
            return Some(now + Span::from_secs(left.max(0.0)));
        }
        if self.reference.clearance_m <= 0.0 {
            return Some(now);
        }
        let (step, mut before) = (self.mpc.step_s(), self.reference.clearance_m);
        for (k, s) in solved.solution.states.iter().enumerate() {
            let deck = self.reference.deck.get(k + 1)?;
            let p = Vector3::new(s[0], s[1], s[2]);
            let c = clearance(&p, &up_of(s[3], s[4]), deck, self.drone_geometry.feet_below_m);
            if c <= 0.0 {
                let fraction = before / (before - c);
                return Some(now + Span::from_secs(step * (k as f64 + fraction)));
            }
            before = c;
        }
        None
    }
}

impl Node for Planner {
    type Clock = DroneClock;
    type In = PlannerIn;
    type Out = PlannerOut;

    fn step(&mut self, now: Time<DroneClock>, input: &PlannerIn) -> PlannerOut {
        self.receive(now, input);
        if let (Some(ne), Some(forecast)) = (&mut self.ne, &self.forecast) {
            ne.observe(forecast);
        }
        let mission = self
            .mission
            .filter(|m| is_fresh(now, m.header.at, self.config.mission_age_s));
        let Some(mission) = mission else {
            return PlannerOut::default();
        };
        let phase = mission.state.phase();
        match phase {
            Phase::None => {
                self.solved = None;
                self.last_solve = None;
                self.generator.restart();
                PlannerOut::default()
            }
            Phase::Navigation | Phase::Follow | Phase::Landing => {
                if !self.due(now, phase) {
                    return PlannerOut::default();
                }
                self.begin_landing(phase);
                self.last_solve = Some((now, phase));
                let mut plan = self.plan(now, &mission);
                if let Some(plan) = &mut plan {
                    plan.header.vessel = mission.header.vessel;
                    plan.header.drone = mission.header.drone;
                    self.sequence = self.sequence.wrapping_add(1);
                }
                PlannerOut { plan }
            }
        }
    }
}

/// Tolerance for stamps ahead of now, s: shared memory between processes of one computer.
const AHEAD_S: f64 = 0.05;

fn is_fresh(now: Time<DroneClock>, at: Time<DroneClock>, age_s: f64) -> bool {
    let age = (now - at).secs();
    (-AHEAD_S..=age_s).contains(&age)
}

/// Keeps `new` if it is of this version, possible, in order, not old and not from the future; else
/// counts a refusal.
fn admit<M: Message<Clock = DroneClock> + Clone>(
    now: Time<DroneClock>,
    age_s: f64,
    new: &Option<M>,
    kept: &mut Option<M>,
    rejected: &mut u32,
) {
    let Some(new) = new else {
        return;
    };
    let h = new.header();
    let in_order = kept.as_ref().is_none_or(|old| {
        let old = old.header();
        old.boot != h.boot || (h.sequence > old.sequence && h.at >= old.at)
    });
    if h.version == MESSAGE_VERSION && in_order && is_fresh(now, h.at, age_s) && new.check().is_ok() {
        *kept = Some(new.clone());
    } else {
        *rejected = rejected.saturating_add(1);
    }
}

/// Odometry as a state of the model: tilt and rates about north and east.
fn measured_state(drone: &DroneState) -> State {
    let q = drone.attitude();
    let (phi, theta) = tilt_of(&(q * -Vector3::z()), 0.0);
    let w = q * Vector3::from(drone.rates);
    let (p, v) = (drone.position, drone.velocity);
    [
        p[0],
        p[1],
        p[2],
        phi,
        theta,
        drone.euler().z,
        v[0],
        v[1],
        v[2],
        w.x,
        w.y,
        w.z,
    ]
}

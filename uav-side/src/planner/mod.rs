//! Planner: a trajectory over a receding horizon.
//!
//! Reading order: [`mpc_faa`] (the problem), [`model`] and [`weights`] (its parts), [`reference`] (references by
//! mission state), [`law`] (what differs between planners), [`alignment`] and [`rendezvous`] (the laws of `mpc-faa` and
//! `alight`), [`condensed`], `active_set` and [`qp`] (solvers), `start` (start of a plan), this file (schedule and
//! messages).
//!
//! A plan starts from the current point of the previous plan: the pilot's tracker closes the loop, and a lagging drone
//! does not change its own plan. A plan starts from the measured state if there is no recent previous plan, if the
//! drone is farther from it than [`config::Reset`] allows, or if the autopilot's position estimate has jumped. In a
//! landing `alight` limits height and sink rate at the start by `Reset`.

mod active_set;
pub mod alignment;
pub mod condensed;
pub mod config;
mod governor;
pub mod law;
pub mod model;
pub mod mpc_faa;
pub mod qp;
pub mod reference;
pub mod rendezvous;
mod start;
pub mod view;
pub mod weights;

#[cfg(test)]
mod solver_tests;
#[cfg(test)]
mod start_tests;
#[cfg(test)]
mod tests;

use alight_shared::{
    admission::Latest,
    bus::wiring,
    frames::wrap_angle,
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    msg::{
        DeckForecast, DroneState, Header, LandingMode, Message as _, MissionState, Phase, Plan, PlanStage,
        Solve,
    },
    node::Node,
    time::{DroneClock, Span, Time},
    topics,
};
use serde::{Deserialize, Serialize};

pub use config::{PlannerConfig, PlannerKind};

use alignment::FaaAlignment;
use law::{Law, View};
use model::{INPUTS, ModelState, clearance, state, tilt_of, up_of};
use mpc_faa::{Mpc, Problem, Solution};
use reference::{PlanReference, ReferenceGenerator};
use rendezvous::Rendezvous;
use start::SolvedPlan;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlannerIn {
    pub forecast: Option<DeckForecast>,
    pub mission: Option<MissionState>,
    pub drone: Option<DroneState>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlannerOut {
    pub plan: Option<Plan>,
}

wiring! {
    PlannerPorts of Planner: PlannerIn => PlannerOut {
        reads {
            newest forecast: DeckForecast,
            newest mission: MissionState,
            newest drone: DroneState,
        }
        writes { plan: Plan }
        wakes { DeckForecast, MissionState }
    }
}

#[derive(Debug)]
pub struct Planner {
    config: PlannerConfig,
    drone_geometry: DroneGeometry,
    boot: u32,
    sequence: u32,
    law: Box<dyn Law>,
    mpc: Mpc,
    generator: ReferenceGenerator,
    /// Time to contact in the last plan, s.
    time_to_contact_s: Option<f64>,
    problem: Problem,
    reference: PlanReference,
    scratch: Solution,
    solved: Option<SolvedPlan>,
    last_solve: Option<(Time<DroneClock>, Phase)>,
    forecast: Latest<DeckForecast>,
    mission: Latest<MissionState>,
    drone: Latest<DroneState>,
    resets: u32,
}

impl Planner {
    /// `boot` distinguishes this process from its predecessors.
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry, deck: &DeckGeometry, boot: u32) -> Self {
        let law: Box<dyn Law> = match config.kind {
            PlannerKind::MpcFaa => Box::new(FaaAlignment::new(&config.faa, drone)),
            PlannerKind::Alight => Box::new(Rendezvous::new(config, drone)),
        };
        Planner::with_law(law, config, drone, deck, boot)
    }
    pub fn with_law(
        law: Box<dyn Law>,
        config: &PlannerConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        boot: u32,
    ) -> Self {
        Planner {
            config: config.clone(),
            drone_geometry: *drone,
            boot,
            sequence: 0,
            law,
            mpc: Mpc::new(config, drone),
            generator: ReferenceGenerator::new(config, drone, deck),
            time_to_contact_s: None,
            problem: Problem::default(),
            reference: PlanReference::default(),
            scratch: Solution::default(),
            solved: None,
            last_solve: None,
            forecast: Latest::default(),
            mission: Latest::default(),
            drone: Latest::default(),
            resets: 0,
        }
    }

    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    fn receive(&mut self, now: Time<DroneClock>, input: &PlannerIn) {
        if let Some(m) = &input.forecast {
            self.forecast.offer(now, m);
        }
        if let Some(m) = &input.mission {
            self.mission.offer(now, m);
        }
        let before = self.drone.get().copied();
        let drone = input.drone.filter(|m| self.drone.offer(now, m));
        if (before.zip(drone)).is_some_and(|(before, d)| d.origin_moved_m(&before).is_some()) {
            self.solved = None;
            self.generator.restart();
        }
        self.law
            .observe(drone.as_ref(), self.forecast.get(), &self.reference);
    }

    fn due(&mut self, now: Time<DroneClock>, phase: Phase, with_deck: bool) -> bool {
        let rate = match phase {
            Phase::None => return false,
            Phase::Navigation if with_deck => self.config.landing_hz,
            Phase::Navigation => self.config.navigation_hz,
            Phase::Follow | Phase::Landing => self.config.landing_hz,
        };
        // A step counts as on time if it is early by up to half a tick of the highest rate.
        const EARLY_S: f64 = 0.004;
        match self.last_solve {
            Some((at, before)) => before != phase || (now - at).secs() >= 1.0 / rate - EARLY_S,
            None => true,
        }
    }

    /// Drops the previous plan when `alight` begins a landing, because the autopilot's own position loop may have left
    /// an error of 0.5 m, which the pilot would need longer than the landing to correct.
    fn begin_landing(&mut self, phase: Phase) {
        let begins = phase == Phase::Landing && self.last_solve.is_none_or(|(_, before)| before != phase);
        if begins && self.law.landing_start().measured {
            self.solved = None;
        }
    }

    /// State and input at the plan's start: those of the last plan at `now`, or the measured ones. None without
    /// odometry.
    fn start(&mut self, now: Time<DroneClock>) -> Option<(ModelState, [f64; INPUTS])> {
        let c = &self.config;
        let drone = *self.drone.fresh(now, topics::DRONE_STATE.stale_after)?;
        let law = &self.law;
        let lands = self.last_solve.is_some_and(|(_, phase)| phase == Phase::Landing);
        let landing = lands.then(|| law.landing_start());
        let previous = self.solved.as_ref();
        let start = start::start(now, &drone, previous, &self.mpc, law.wind(), landing, &c.reset);
        if start.measured {
            self.solved = None;
            self.generator.restart();
            self.resets += 1;
        }
        Some((start.state, start.input))
    }

    fn plan(&mut self, now: Time<DroneClock>, mission: &MissionState) -> Option<Plan> {
        let mut view = View {
            mission: *mission,
            forecast: self.forecast.fresh(now, topics::FORECAST.stale_after).copied(),
        };
        if let Some(plan) = self.own_plan(now, mission, view.forecast.as_ref()) {
            return Some(plan);
        }
        if self.law.plans_alone() {
            return None;
        }
        let (state, input) = self.start(now)?;
        let law = &mut self.law;
        law.limit(now, &state, &mut view);
        self.problem.state = state;
        self.problem.input = input;
        self.generator
            .write(now, &view, &mut self.problem, &mut self.reference);
        self.time_to_contact_s = law.refine(
            now,
            &view,
            &self.generator,
            &mut self.problem,
            &mut self.reference,
        );
        self.generator.keep_out(&self.reference, &mut self.problem);
        let (generator, reference) = (&self.generator, &self.reference);
        self.mpc.solve(
            &mut self.problem,
            |k, x, y| generator.ceiling(reference, k, x, y),
            &mut self.scratch,
        );
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
            // The previous plan continues until planning restarts from the measured state.
            Solve::Infeasible => {}
        }
        let solved = self.solved.as_ref()?;
        let mut plan = self.message(now, solved);
        plan.solve = solve;
        plan.iterations = iterations;
        plan.alignment = self.reference.alignment;
        plan.touchdown_at = self.touchdown(now, solved);
        plan.check().is_ok().then_some(plan)
    }

    fn own_plan(
        &mut self,
        now: Time<DroneClock>,
        mission: &MissionState,
        forecast: Option<&DeckForecast>,
    ) -> Option<Plan> {
        let law = &self.law;
        let begins = law.begins(now, mission, forecast, self.drone.get());
        let start = if begins { self.start(now) } else { None };
        let start = start.map(|(state, input)| (state, self.mpc.model().vertical * input[0]));
        let law = &mut self.law;
        let mut plan = law.own_plan(now, mission, forecast, start)?;
        plan.header = Header::new(0, 0, self.boot, self.sequence, now);
        // The common planner then restarts from the measured state.
        self.solved = None;
        self.generator.restart();
        plan.check().is_ok().then_some(plan)
    }

    /// Plan as a message from `now` on. Half steps are included if they fit, for finer interpolation.
    fn message(&self, now: Time<DroneClock>, solved: &SolvedPlan) -> Plan {
        let (n, step) = (self.mpc.stages(), self.mpc.step_s());
        let halves = 2 * n < alight_shared::msg::PLAN_STAGES;
        let mut plan = Plan {
            header: Header::new(0, 0, self.boot, self.sequence, now),
            step: Span::from_secs(if halves { 0.5 * step } else { step }),
            disturbance: self.law.wind().into(),
            ..Plan::default()
        };
        let mut keep = |state: &ModelState, input: &[f64; INPUTS]| {
            // The configuration guarantees n < PLAN_STAGES.
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
                let (state, input) = solved.sample(now + stride * k as i64, &self.mpc);
                keep(&state, &input);
            }
        }
        plan
    }

    /// Converts a state to a stage of the message, with the tilt in the body's heading.
    fn stage(&self, s: &ModelState, input: &[f64; INPUTS]) -> PlanStage {
        let down = self.mpc.model().vertical * input[0];
        let (up, rate_factor) = self.law.attitude(s, down);
        let (phi, theta) = tilt_of(&up, s[state::PSI]);
        let (sin, cos) = s[state::PSI].sin_cos();
        PlanStage {
            position: [s[state::NORTH], s[state::EAST], s[state::DOWN]],
            velocity: [s[state::V_NORTH], s[state::V_EAST], s[state::V_DOWN]],
            acceleration: [-GRAVITY * s[state::THETA], GRAVITY * s[state::PHI], down],
            euler: [phi, theta, wrap_angle(s[state::PSI])],
            euler_rates: [
                rate_factor * (cos * s[state::PHI_DOT] + sin * s[state::THETA_DOT])
                    + s[state::PSI_DOT] * theta,
                rate_factor * (-sin * s[state::PHI_DOT] + cos * s[state::THETA_DOT])
                    - s[state::PSI_DOT] * phi,
                s[state::PSI_DOT],
            ],
        }
    }

    /// Time at which the feet contact the deck's plane in this plan.
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
            let p = state::position(s);
            let c = clearance(
                &p,
                &up_of(s[state::PHI], s[state::THETA]),
                deck,
                self.drone_geometry.feet_below_m,
            );
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
        let mission = self.mission.fresh(now, topics::MISSION.stale_after).copied();
        // Without a mission the pilot has flown on its own, which invalidates the previous plan.
        let mission = mission.unwrap_or_default();
        let phase = mission.state.phase();
        match phase {
            Phase::None => {
                self.solved = None;
                self.last_solve = None;
                self.generator.restart();
                PlannerOut::default()
            }
            Phase::Navigation | Phase::Follow | Phase::Landing => {
                if !self.due(now, phase, mission.with_deck) {
                    return PlannerOut::default();
                }
                self.begin_landing(phase);
                if mission.settings.mode == LandingMode::Shadow {
                    self.solved = None;
                }
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

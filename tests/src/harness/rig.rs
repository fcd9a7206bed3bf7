//! Test rig for one flight: commands and faults at chosen times, and measurements. Times are in s after the start.

use alight_shared::msg::{CommandKind, MissionState, ReasonCode, State};

use super::{
    failing::Failing,
    observer::{NoObserver, WorldObserver},
    physics::TICK,
    scenario::{NodeConfigs, Scenario, SetupError},
    storm::{Fault, FaultKind},
    world::World,
};
use crate::autopilots::simulated::SimulatedAutopilot;

pub struct Rig {
    pub world: World,
    pub scenario: Scenario,
    pub nodes: NodeConfigs,
    /// States entered by each drone, with entry times, s.
    visited: Vec<Vec<(State, f64)>>,
    /// Time of the first drone's first contact, s.
    touched_s: Option<f64>,
    /// Reasons that the first drone's mission has stated.
    pub reasons: Vec<ReasonCode>,
}

impl Rig {
    pub fn new(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<Rig, SetupError> {
        Rig::observed(scenario, nodes, seed, &mut NoObserver)
    }
    pub fn observed(
        scenario: &Scenario,
        nodes: &NodeConfigs,
        seed: u64,
        observer: &mut dyn WorldObserver,
    ) -> Result<Rig, SetupError> {
        let mut world = World::new(scenario, nodes, seed)?;
        world.warm_up(observer);
        Ok(Rig::of(world, scenario, nodes))
    }
    /// `world` has completed its warm-up.
    pub fn of(world: World, scenario: &Scenario, nodes: &NodeConfigs) -> Rig {
        Rig {
            world,
            scenario: scenario.clone(),
            nodes: nodes.clone(),
            visited: vec![vec![(State::Idle, 0.0)]; scenario.drones as usize],
            touched_s: None,
            reasons: Vec::new(),
        }
    }
    pub fn landing(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<Rig, SetupError> {
        let mut rig = Rig::new(scenario, nodes, seed)?;
        rig.world.command(CommandKind::Land);
        Ok(rig)
    }

    /// Advances one tick, and checks that two drones never use the deck together.
    pub fn tick(&mut self, observer: &mut dyn WorldObserver) {
        self.advance(observer);
        assert!(self.using_the_deck().len() <= 1, "{:?}", self.visited);
    }
    /// Advances one tick without the check.
    pub fn advance(&mut self, observer: &mut dyn WorldObserver) {
        self.world.tick(observer);
        let t_s = self.t_s();
        if self.touched_s.is_none() && self.world.physics().touches(0) {
            self.touched_s = Some(t_s);
        }
        let m = self.mission(0);
        for code in [m.entered.code, m.waiting.code] {
            if !self.reasons.contains(&code) {
                self.reasons.push(code);
            }
        }
        for (drone, visited) in self.world.drones().iter().zip(&mut self.visited) {
            let state = drone.mission_state.state;
            if visited.last().is_none_or(|(last, _)| *last != state) {
                visited.push((state, t_s));
            }
        }
    }
    pub fn run(&mut self, seconds: f64) {
        self.until(seconds, |_| false);
    }
    /// Runs until `done`; false if `limit_s` passes first.
    pub fn until(&mut self, limit_s: f64, mut done: impl FnMut(&Rig) -> bool) -> bool {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            if done(self) {
                return true;
            }
            self.tick(&mut NoObserver);
        }
        done(self)
    }
    /// Runs for at most `limit_s`. `after` is called after every tick and returns true to stop.
    pub fn each(&mut self, limit_s: f64, mut after: impl FnMut(&mut Rig) -> bool) {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            self.tick(&mut NoObserver);
            if after(self) {
                break;
            }
        }
    }

    /// Begins a fault. A lasting fault replaces all other lasting faults.
    pub fn begin(&mut self, kind: FaultKind, size: f64) {
        kind.effect().begin(self, size);
        if kind.effect().lasts() {
            let mut failing = Failing::default();
            kind.effect().apply(&mut failing, size);
            self.world.fail(&failing);
        }
    }
    pub fn end(&mut self, kind: FaultKind, size: f64) {
        kind.effect().end(self, size);
        if kind.effect().lasts() {
            self.world.fail(&Failing::default());
        }
    }
    pub fn restart_vessel(&mut self) {
        self.world.restart_vessel();
    }
    pub fn restart_drone(&mut self, k: usize) {
        self.world.restart_drone(k);
    }

    pub fn t_s(&self) -> f64 {
        self.world.physics().time_since_start().secs()
    }
    pub fn mission(&self, k: usize) -> &MissionState {
        &self.world.drones()[k].mission_state
    }
    pub fn state(&self, k: usize) -> State {
        self.mission(k).state
    }
    pub fn visited(&self, k: usize) -> Vec<State> {
        self.visited[k].iter().map(|(state, _)| *state).collect()
    }
    pub fn first_entered_s(&self, k: usize, state: State) -> Option<f64> {
        let entered = self.visited[k].iter().find(|(s, _)| *s == state);
        entered.map(|(_, t_s)| *t_s)
    }
    pub fn entered(&self, k: usize) -> &[(State, f64)] {
        &self.visited[k]
    }
    /// Time of the moment from which the fault's delay counts, s.
    pub fn moment_s(&self, fault: &Fault) -> Option<f64> {
        fault.moment_s(self.entered(0), self.touched_s)
    }
    pub fn thrust(&self, k: usize) -> f64 {
        self.world.drones()[k]
            .autopilot()
            .map_or(0.0, SimulatedAutopilot::thrust)
    }
    pub fn hover_thrust(&self, k: usize) -> f64 {
        self.world.drones()[k]
            .autopilot()
            .map_or(1.0, SimulatedAutopilot::hover_thrust)
    }
    /// Entry time of the present state, s.
    pub fn entered_s(&self, k: usize) -> f64 {
        self.visited[k].last().map_or(0.0, |(_, t_s)| *t_s)
    }
    /// Whether the first drone has been in this state for at least `after_s`.
    pub fn is_due(&self, state: State, after_s: f64) -> bool {
        self.state(0) == state && self.t_s() >= self.entered_s(0) + after_s
    }
    /// Drones that are descending or standing on the deck.
    pub fn using_the_deck(&self) -> Vec<usize> {
        let uses = |k: &usize| matches!(self.state(*k), State::Descent | State::Flare | State::Landed);
        (0..self.visited.len()).filter(uses).collect()
    }
}

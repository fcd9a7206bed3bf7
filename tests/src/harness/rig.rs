//! One flight in the simulated world, as tests drive it: commands, faults and measurements at moments.

use alight_shared::msg::{CommandKind, MissionState, State};

use super::failing::Failing;
use super::physics::TICK;
use super::scenario::{NodeConfigs, Scenario, SetupError};
use super::storm::{Effect, Fault, FaultKind};
use super::tap::{NoTap, Tap};
use super::world::World;
use crate::autopilots::simulated::SimulatedAutopilot;

/// The world of one flight, and the states that the missions went through.
pub struct Rig {
    pub world: World,
    /// Scenario of the world.
    pub scenario: Scenario,
    /// Configurations of the nodes.
    pub nodes: NodeConfigs,
    /// States of each drone, with the time after the start at which each was entered, s.
    visited: Vec<Vec<(State, f64)>>,
    /// When the first drone first touched something, after the start, s.
    touched_s: Option<f64>,
}

impl Rig {
    /// At the start of the flight of `seed`.
    pub fn new(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<Rig, SetupError> {
        Rig::tapped(scenario, nodes, seed, &mut NoTap)
    }
    /// A rig with a warm-up that is shown to a tap.
    pub fn tapped(
        scenario: &Scenario,
        nodes: &NodeConfigs,
        seed: u64,
        tap: &mut impl Tap,
    ) -> Result<Rig, SetupError> {
        let mut world = World::new(scenario, nodes, seed)?;
        world.warm_up(tap);
        Ok(Rig::of(world, scenario, nodes))
    }
    /// A rig of a world after its warm-up.
    pub fn of(world: World, scenario: &Scenario, nodes: &NodeConfigs) -> Rig {
        Rig {
            world,
            scenario: scenario.clone(),
            nodes: nodes.clone(),
            visited: vec![vec![(State::Idle, 0.0)]; scenario.drones as usize],
            touched_s: None,
        }
    }
    /// At the start, with the order to land.
    pub fn landing(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Result<Rig, SetupError> {
        let mut rig = Rig::new(scenario, nodes, seed)?;
        rig.world.command(CommandKind::Land);
        Ok(rig)
    }

    /// One tick of the world, shown to a tap. At no time may two drones use the deck.
    pub fn tick(&mut self, tap: &mut impl Tap) {
        self.advance(tap);
        assert!(self.using_the_deck().len() <= 1, "{:?}", self.visited);
    }
    /// One tick of the world, whatever the drones do.
    pub fn advance(&mut self, tap: &mut impl Tap) {
        self.world.tick(tap);
        let t_s = self.t_s();
        if self.touched_s.is_none() && self.world.physics().touches(0) {
            self.touched_s = Some(t_s);
        }
        for (drone, visited) in self.world.drones().iter().zip(&mut self.visited) {
            let state = drone.mission_state.state;
            if visited.last().is_none_or(|(last, _)| *last != state) {
                visited.push((state, t_s));
            }
        }
    }
    /// For so long, s.
    pub fn run(&mut self, seconds: f64) {
        self.until(seconds, |_| false);
    }
    /// Until `done`, `limit_s` at most; whether it was done.
    pub fn until(&mut self, limit_s: f64, mut done: impl FnMut(&Rig) -> bool) -> bool {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            if done(self) {
                return true;
            }
            self.tick(&mut NoTap);
        }
        done(self)
    }
    /// Runs with `after` behind every tick until it returns that the flight is over, `limit_s` at most.
    pub fn each(&mut self, limit_s: f64, mut after: impl FnMut(&mut Rig) -> bool) {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            self.tick(&mut NoTap);
            if after(self) {
                break;
            }
        }
    }

    /// Begins a fault of this kind and size, as the only one.
    pub fn begin(&mut self, kind: FaultKind, size: f64) {
        match kind.effect() {
            Effect::Events(begin, _) => begin(self, size),
            Effect::Lasting(fail) => {
                let mut failing = Failing::default();
                fail(&mut failing, size);
                self.world.fail(&failing);
            }
        }
    }
    /// It is over.
    pub fn end(&mut self, kind: FaultKind, size: f64) {
        match kind.effect() {
            Effect::Events(_, end) => end(self, size),
            Effect::Lasting(_) => self.world.fail(&Failing::default()),
        }
    }
    /// Restarts the vessel's computer, with what it kept.
    pub fn restart_vessel(&mut self) {
        self.world.restart_vessel();
    }
    /// The crew takes a drone away and restarts it.
    pub fn restart_drone(&mut self, k: usize) {
        self.world.restart_drone(k);
    }

    /// Time since the start, s.
    pub fn t_s(&self) -> f64 {
        self.world.physics().time_since_start().secs()
    }
    /// A drone's mission.
    pub fn mission(&self, k: usize) -> &MissionState {
        &self.world.drones()[k].mission_state
    }
    /// State of a drone's mission.
    pub fn state(&self, k: usize) -> State {
        self.mission(k).state
    }
    /// The states that it went through.
    pub fn visited(&self, k: usize) -> Vec<State> {
        self.visited[k].iter().map(|(state, _)| *state).collect()
    }
    /// When it first entered a state, after the start, s.
    pub fn first_entered_s(&self, k: usize, state: State) -> Option<f64> {
        let entered = self.visited[k].iter().find(|(s, _)| *s == state);
        entered.map(|(_, t_s)| *t_s)
    }
    /// The states that a drone has entered, each with the time after the start, s.
    pub fn entered(&self, k: usize) -> &[(State, f64)] {
        &self.visited[k]
    }
    /// When the moment of a fault began, after the start, s.
    pub fn moment_s(&self, fault: &Fault) -> Option<f64> {
        fault.moment_s(self.entered(0), self.touched_s)
    }
    /// Collective thrust that its autopilot commands, 0 to 1.
    pub fn thrust(&self, k: usize) -> f64 {
        self.world.drones()[k]
            .autopilot()
            .map_or(0.0, SimulatedAutopilot::thrust)
    }
    /// The thrust that hovers, as its autopilot estimates it, 0 to 1.
    pub fn hover_thrust(&self, k: usize) -> f64 {
        self.world.drones()[k]
            .autopilot()
            .map_or(1.0, SimulatedAutopilot::hover_thrust)
    }
    /// When it entered its state, after the start, s.
    pub fn entered_s(&self, k: usize) -> f64 {
        self.visited[k].last().map_or(0.0, |(_, t_s)| *t_s)
    }
    /// The first drone has been in this state for so long, s.
    pub fn is_due(&self, state: State, after_s: f64) -> bool {
        self.state(0) == state && self.t_s() >= self.entered_s(0) + after_s
    }
    /// The drones that are on the way down or stand on the deck.
    pub fn using_the_deck(&self) -> Vec<usize> {
        let uses = |k: &usize| matches!(self.state(*k), State::Descent | State::Flare | State::Landed);
        (0..self.visited.len()).filter(uses).collect()
    }
}

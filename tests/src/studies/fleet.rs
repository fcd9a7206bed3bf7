//! Several drones above one deck, with random orders, aborts and radio outages. The crew closes and opens the
//! deck; some drones stay on it, others are removed. Two drones below the waiting height, a descent to an
//! occupied or closed deck, and a collision are forbidden.

use alight_shared::msg::{CommandKind, DeckOrder, State};

use super::aborts::drive;
use crate::{
    harness::{
        observer::NoObserver,
        physics::TICK,
        scenario::{NodeConfigs, Scenario, SetupError},
        world::World,
    },
    physics::{sea::SeaConfig, streams::Streams},
    sensors::noise::Noise,
};

const FLOWN_S: f64 = 180.0;
/// Distance below the approach height at which a drone counts as below the waiting height, m: more than a
/// waiting drone's heave and GNSS height errors.
const BELOW_M: f64 = 5.0;
/// Distance from the deck's centre within which a drone with its motors off counts as on the deck, m.
const ON_DECK_M: f64 = 3.0;
/// Time after which drones know that the deck is closed, or have no fresh grant, s.
const KNOWN_AFTER_S: f64 = 2.5;

/// Time within which the vessel receives a report after a radio outage, s.
const REPORTED_AFTER_S: f64 = 1.5;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FleetReport {
    pub landings: u32,
    pub descents: u32,
    pub stops: u32,
    pub outages: u32,
    pub closures: u32,
    /// Number of times that a second drone descended below the waiting height.
    pub two_below: u32,
    /// Number of ticks in which a drone descended to a deck with another drone on it.
    pub on_occupied: u32,
    pub on_closed: u32,
    pub collisions: u32,
    pub in_water: u32,
    /// Minimum distance between two airborne drones, m.
    pub nearest_m: f64,
}

impl FleetReport {
    pub fn safe(&self) -> bool {
        self.two_below + self.on_occupied + self.on_closed + self.collisions == 0
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Watched {
    state: State,
    /// The mission has reached its altitude since the drone appeared.
    risen: bool,
    below: bool,
    on_deck: bool,
    in_water: bool,
    /// Time at which the crew removed the drone, s.
    taken_at: Option<f64>,
    /// End of the radio outage, s.
    silent_until: f64,
}

struct Flight {
    world: World,
    draw: Noise,
    drones: Vec<Watched>,
    /// Start and end of the deck's closure, s.
    closed: Option<[f64; 2]>,
    stays: Option<usize>,
    report: FleetReport,
}

impl Flight {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.draw.uniform()
    }
    fn one_of(&mut self, n: usize) -> usize {
        ((self.draw.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    fn happen(&mut self, t: f64) {
        let k = self.one_of(self.drones.len());
        match self.one_of(10) {
            0..=4 => self.world.operator_command(k, CommandKind::Land),
            5 | 6 => {
                self.report.stops += 1;
                self.world.operator_command(k, CommandKind::Abort);
            }
            7 => {
                self.report.stops += 1;
                self.world.operator_command(k, CommandKind::Hold);
            }
            8 => {
                self.report.outages += 1;
                let duration_s = self.between(5.0, 20.0);
                let watched = &mut self.drones[k];
                watched.silent_until = watched.silent_until.max(t + duration_s);
                self.world.radio_outage(k, duration_s);
            }
            _ if self.closed.is_none() => {
                self.report.closures += 1;
                self.world.deck_order(DeckOrder::Closed);
                self.closed = Some([t, t + self.between(5.0, 30.0)]);
            }
            _ => {}
        }
    }

    /// Crew's actions: opens the deck, and removes a landed drone. Before opening the deck, the crew checks
    /// for silent drones.
    fn attend(&mut self, t: f64) {
        let silent = |d: &Watched| (d.on_deck || d.below) && t < d.silent_until + REPORTED_AFTER_S;
        let found = self.drones.iter().any(silent);
        if self.closed.is_some_and(|[_, until]| t >= until) && !found {
            self.closed = None;
            self.world.deck_order(DeckOrder::Open);
        }
        for k in 0..self.drones.len() {
            if self.drones[k].taken_at.is_some_and(|at| t >= at) {
                self.drones[k] = Watched::default();
                self.world.restart_drone(k);
            }
        }
    }

    fn judge(&mut self, t: f64, waiting_m: f64) {
        let physics = self.world.physics();
        let deck = physics.deck().position.0;
        let mut places = Vec::new();
        let mut begun = 0;
        let mut landed = None;
        let had_below = self.drones.iter().filter(|d| d.below).count();
        for (k, watched) in self.drones.iter_mut().enumerate() {
            let Some(truth) = physics.drone(k) else { continue };
            let mission = &self.world.drones()[k].mission_state;
            let o = physics.observation(k, mission);
            let at = truth.position.0;
            let height = deck.z - at.z;
            watched.risen |= !matches!(
                mission.state,
                State::Idle | State::GetAltitude | State::Hold | State::GaveUp
            );
            watched.below = o.motors_on && watched.risen && height < waiting_m - BELOW_M;
            let stood = watched.on_deck;
            watched.on_deck = !o.motors_on && !o.in_water && o.horizontal_m < ON_DECK_M;
            if watched.on_deck && !stood {
                self.report.landings += 1;
                landed = Some(k);
            }
            self.report.in_water += u32::from(o.in_water && !watched.in_water);
            watched.in_water = o.in_water;
            begun += u32::from(mission.state == State::Descent && watched.state != State::Descent);
            watched.state = mission.state;
            if o.motors_on {
                places.push(at);
            }
        }
        let below = self.drones.iter().filter(|d| d.below).count();
        self.report.two_below += u32::from(below > 1 && below > had_below);
        // The mission of a drone on the deck may still be in descent or flare.
        let descends = |d: &Watched| !d.on_deck && matches!(d.state, State::Descent | State::Flare);
        let stands = self.drones.iter().any(|d| d.on_deck);
        self.report.on_occupied += u32::from(stands && self.drones.iter().any(descends));
        self.report.descents += begun;
        if self.closed.is_some_and(|[since, _]| t > since + KNOWN_AFTER_S) {
            self.report.on_closed += begun;
        }
        for (i, a) in places.iter().enumerate() {
            for b in places.iter().skip(i + 1) {
                self.report.nearest_m = self.report.nearest_m.min((a - b).norm());
            }
        }
        self.report.collisions = physics.collisions();
        if let Some(k) = landed.filter(|k| Some(*k) != self.stays) {
            self.drones[k].taken_at = Some(t + self.between(5.0, 25.0));
        }
    }
}

/// The seed determines the sea, the vessel's speed and all events.
pub fn fly(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    drones: u32,
) -> Result<FleetReport, SetupError> {
    let mut draw = Noise::new(&Streams::new(seed), "fleet.draw");
    let mut scenario = Scenario {
        drones,
        sea: SeaConfig::paper(0.6 * draw.uniform(), 5.0),
        ..scenario.clone()
    };
    let speed = if draw.chance(0.5) {
        0.0
    } else {
        3.0 * draw.uniform()
    };
    drive(&mut scenario, speed);
    let stays = draw.chance(0.5).then_some(0);
    let mut world = World::new(&scenario, nodes, seed)?;
    world.warm_up(&mut NoObserver);
    let mut flight = Flight {
        world,
        draw,
        drones: vec![Watched::default(); drones as usize],
        closed: None,
        stays,
        report: FleetReport {
            nearest_m: f64::INFINITY,
            ..FleetReport::default()
        },
    };
    flight.stays = flight.stays.map(|_| flight.one_of(drones as usize));
    let mut first: Vec<f64> = (0..drones).map(|_| flight.between(0.0, 20.0)).collect();
    let mut next = flight.between(10.0, 30.0);
    for tick in 0..(FLOWN_S / TICK.secs()) as u32 {
        let t = f64::from(tick) * TICK.secs();
        for (k, at) in first.iter_mut().enumerate().filter(|(_, at)| **at <= t) {
            *at = f64::INFINITY;
            flight.world.operator_command(k, CommandKind::Land);
        }
        if t >= next {
            next = t + flight.between(3.0, 15.0);
            flight.happen(t);
        }
        flight.attend(t);
        flight.world.tick(&mut NoObserver);
        flight.judge(t, nodes.drone.mission.approach_height_m);
    }
    Ok(flight.report)
}

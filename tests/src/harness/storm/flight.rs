//! Flies a storm: people give orders, faults begin and end, and the rules are checked in every tick.

use alight_shared::msg::{ReasonCode, State};
use serde::Serialize;

use super::{
    FaultKind, FlightKind, Mutant, Storm,
    kinds::Takes,
    people::People,
    schedule::{Schedule, Scheduled},
    watch::{
        RESUME_S, SPENT_OF_RESERVE, StormEnding, StormRule, StormScene, StormWatch, Violation, end, goes_on,
        is_stuck, is_unreported, no_last_resort,
    },
};
use crate::{
    autopilots::simulated::{Installed, SimulatedAutopilot, warned_by_default},
    harness::{
        failing::Failing,
        observer::{NoObserver, WorldObserver},
        outcome::{FALSE_STOP_M, REST_S},
        rig::Rig,
        scenario::SetupError,
    },
};

/// Time after the end of a fault for which it counts as simultaneous with others, s.
const TOGETHER_S: f64 = 5.0;
/// Maximum time in which an abort from ashore or over MAVLink reaches the mission without other faults, s.
const ASHORE_S: f64 = 2.0;
/// Duration from which nodes notice a fault, s.
const NOTICED_S: f64 = 1.0;
/// Time after the last fault for which a drone that gave up waits for the operator, s; its climb takes less.
const GIVEN_UP_S: f64 = 20.0;
/// Maximum age of a descent that may continue to its end, s.
const DESCENDS_S: f64 = 30.0;

/// Charge given to a drone that waits in OFFBOARD (GUIDED), above the level at which the operator must decide.
const RUNS_LOW: f64 = 0.01;
/// Maximum time from setting that charge until the drone rests on the deck, s.
const COMES_DOWN_S: f64 = 330.0;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flown {
    pub ending: StormEnding,
    /// Reason for which the drone waits at the end.
    pub waits_for: Option<String>,
    /// Ending of a flight whose waiting drone's battery was drained.
    pub came_down: Option<StormEnding>,
    pub violation: Option<Violation>,
    /// Rule that was broken because of parameters at the maker's default.
    pub warned: Option<Warned>,
    /// Started faults: kind, the mission's state, time after the order, s.
    pub began: Vec<(FaultKind, State, f64)>,
    /// States of the first drone, with entry times after the order, s.
    pub states: Vec<(&'static str, f64)>,
    /// Time from the order to the end, s.
    pub lasted_s: f64,
    pub last_state: State,
}

/// What a warning of `alight check` is worth: the rule that a flight breaks without its parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Warned {
    /// Parameters each of which breaks a rule alone at the maker's default; empty: only several together do.
    pub parameters: Vec<&'static str>,
    pub violation: Violation,
}

/// `show` is called with each fault and state as it begins.
pub fn fly(storm: &Storm, show: &mut dyn FnMut(f64, &str)) -> Result<Flown, SetupError> {
    fly_observed(storm, None, &mut NoObserver, show)
}

/// `observer` receives the steps of this flight, but not those of flights that judge it by comparison.
pub fn fly_observed(
    storm: &Storm,
    mutant: Option<Mutant>,
    observer: &mut dyn WorldObserver,
    show: &mut dyn FnMut(f64, &str),
) -> Result<Flown, SetupError> {
    let installed = if storm.stock {
        Installed::Required
    } else {
        Installed::All
    };
    let mut flown = fly_excused(storm, installed, mutant, observer, show)?;
    if let Some(violation) = flown.violation
        && storm.stock
    {
        let breaks = |installed| -> Result<bool, SetupError> {
            let again = fly_excused(storm, installed, mutant, &mut NoObserver, &mut |_, _| {})?;
            Ok(again.violation.is_some())
        };
        if !breaks(Installed::All)? {
            let mut parameters = Vec::new();
            for name in warned_by_default(storm.autopilot.maker(), storm.version()) {
                if breaks(Installed::AllBut(name))? {
                    parameters.push(name);
                }
            }
            flown.ending = StormEnding::Warned;
            flown.violation = None;
            flown.warned = Some(Warned {
                parameters,
                violation,
            });
        }
    }
    Ok(flown)
}

/// Flies a storm. A crash that faults excuse breaks a rule unless these faults alone end the flight badly.
fn fly_excused(
    storm: &Storm,
    installed: Installed,
    mutant: Option<Mutant>,
    observer: &mut dyn WorldObserver,
    show: &mut dyn FnMut(f64, &str),
) -> Result<Flown, SetupError> {
    let mut flown = fly_once(storm, installed, mutant, observer, show)?;
    let excusing = storm.faults.iter().filter(|f| f.kind.excuses());
    let alone = Storm {
        faults: excusing.copied().collect(),
        ..storm.clone()
    };
    if flown.ending != StormEnding::Crashed || alone.faults.len() == storm.faults.len() {
        return Ok(flown);
    }
    let again = fly_once(&alone, installed, mutant, &mut NoObserver, &mut |_, _| {})?;
    if again.ending != StormEnding::Crashed && again.violation.is_none() {
        flown.ending = StormEnding::Violated;
        flown.violation = Some(Violation {
            rule: StormRule::NotExcused,
            t_s: flown.lasted_s,
            figure: 0.0,
            state: flown.last_state,
        });
    }
    Ok(flown)
}

fn fly_once(
    storm: &Storm,
    installed: Installed,
    mutant: Option<Mutant>,
    observer: &mut dyn WorldObserver,
    show: &mut dyn FnMut(f64, &str),
) -> Result<Flown, SetupError> {
    let mut run = Run::new(storm, installed)?;
    while run.tick(mutant, observer, show) {}
    // A storm ends when the battery of a waiting drone starts to run low.
    let lasted_s = run.runs_low_s.unwrap_or(run.rig.t_s());
    Ok(Flown {
        lasted_s,
        last_state: run.rig.state(0),
        states: run
            .rig
            .entered(0)
            .iter()
            .filter(|(_, t_s)| *t_s <= lasted_s)
            .map(|(state, t_s)| (state.name(), *t_s))
            .collect(),
        ..run.flown
    })
}

struct Run {
    flight: FlightKind,
    rig: Rig,
    people: People,
    faults: Schedule,
    /// Number of the first drone's states that were passed to `show`.
    shown: usize,
    watches: Vec<StormWatch>,
    /// Time of the last active fault, s.
    last_s: f64,
    /// Last time at which a failsafe of the autopilot had chosen the mode, s.
    failsafe_s: f64,
    /// Last time at which the drone was not at rest on the deck, s.
    moved_s: f64,
    /// Last time at which the mission reported a condition for its next step, s.
    reported_s: f64,
    /// Time from which the battery of a waiting drone runs low, s.
    runs_low_s: Option<f64>,
    flown: Flown,
}

impl Run {
    fn new(storm: &Storm, installed: Installed) -> Result<Run, SetupError> {
        let (mut scenario, mut nodes) = storm.scene();
        storm.flight.set_up(&mut scenario, &mut nodes);
        let mut rig = Rig::new(&scenario, &nodes, storm.seed)?;
        for k in 0..storm.drones.into() {
            if let Some(linked) = rig.world.linked(k) {
                let config = &scenario.drone.autopilot;
                linked.autopilot.install(config, storm.version(), installed);
            }
        }
        rig.world.set_deck_shared();
        Ok(Run {
            flight: storm.flight,
            rig,
            people: People::new(storm.flight),
            faults: Schedule::new(&storm.faults),
            shown: 1,
            watches: vec![StormWatch::default(); storm.drones.into()],
            last_s: 0.0,
            failsafe_s: f64::NEG_INFINITY,
            moved_s: 0.0,
            reported_s: 0.0,
            runs_low_s: None,
            flown: Flown {
                ending: StormEnding::Waits,
                waits_for: None,
                came_down: None,
                violation: None,
                began: Vec::new(),
                warned: None,
                states: Vec::new(),
                lasted_s: 0.0,
                last_state: State::Idle,
            },
        })
    }

    /// One tick, after the orders and faults that are due; returns true while the flight continues.
    fn tick(
        &mut self,
        mutant: Option<Mutant>,
        observer: &mut dyn WorldObserver,
        show: &mut dyn FnMut(f64, &str),
    ) -> bool {
        let t_s = self.rig.t_s();
        if self.rig.entered(0).len() > self.shown {
            self.shown += 1;
            let m = self.rig.mission(0);
            show(t_s, &format!("{}: {}", m.state.name(), m.entered));
        }
        self.people.act(&mut self.rig);
        self.begin_and_end(show);
        let failing = self.faults.failing(t_s);
        self.rig.world.fail(&Failing { mutant, ..failing });
        self.rig.advance(observer);
        if self.rig.mission(0).waiting.code != ReasonCode::None {
            self.reported_s = self.rig.t_s();
        }
        let over = match self.look() {
            Some(violation) => Some((StormEnding::Violated, Some(violation))),
            None if self.runs_low_s.is_some() => self.come_down(),
            None => self.over(),
        };
        if over == Some((StormEnding::Waits, None)) && self.run_low(show) {
            return true;
        }
        if let Some((ending, violation)) = over {
            let waited = self.runs_low_s.is_some() && violation.is_none();
            self.flown.came_down = waited.then_some(ending);
            (self.flown.ending, self.flown.violation) = if waited {
                (StormEnding::Waits, None)
            } else {
                (ending, violation)
            };
        }
        if let Some(violation) = self.flown.violation {
            show(self.rig.t_s(), &violation.to_string());
        }
        over.is_none()
    }

    /// Drains the battery of a drone that waits in OFFBOARD (GUIDED); returns false in another mode.
    fn run_low(&mut self, show: &mut dyn FnMut(f64, &str)) -> bool {
        let reserve = self.rig.nodes.drone.mission.battery_reserve;
        let waiting = self.rig.mission(0).waiting.to_string();
        let t_s = self.rig.t_s();
        show(t_s, &format!("waits: {waiting}"));
        self.flown.waits_for = Some(waiting);
        let Some(linked) = self.rig.world.linked(0).filter(|l| l.autopilot.in_offboard()) else {
            return false;
        };
        let low = SPENT_OF_RESERVE * reserve + RUNS_LOW;
        linked.autopilot.battery = linked.autopilot.battery.min(low);
        self.runs_low_s = Some(t_s);
        true
    }
    /// Ending after the battery ran low: on the deck, or elsewhere if the deck was unavailable.
    fn come_down(&mut self) -> Option<(StormEnding, Option<Violation>)> {
        let t_s = self.rig.t_s();
        let o = self.rig.world.observation();
        let stands = !o.motors_on && !o.in_water && o.feet_height_m().abs() < FALSE_STOP_M;
        if !stands {
            self.moved_s = t_s;
        }
        if t_s - self.moved_s > REST_S {
            return Some((StormEnding::Landed, None));
        }
        let late = self.runs_low_s.is_some_and(|at| t_s > at + COMES_DOWN_S);
        (late || o.in_water || !o.motors_on && !stands).then(|| {
            let ending = end(&self.rig);
            let excused = self.flight.may_land_elsewhere() || !self.rig.world.deck_is_free(0);
            (ending, (!excused).then(|| no_last_resort(&self.rig)))
        })
    }

    fn begin_and_end(&mut self, show: &mut dyn FnMut(f64, &str)) {
        let flight = self.flight;
        let people = &self.people;
        let flown = &mut self.flown;
        for scheduled in &mut self.faults.0 {
            scheduled.step(&mut self.rig, |rig, scheduled| {
                let t_s = rig.t_s();
                let fault = scheduled.timer.fault;
                scheduled.stops = !flight.takes_off() || goes_on(flight, rig, 0);
                flown.began.push((fault.kind, rig.state(0), t_s));
                let name = fault.kind.name();
                let size = fault.size;
                let lasts = fault.lasts_s;
                show(t_s, &format!("fault: {name}, size {size}, for {lasts} s"));
                people.give(rig, fault.kind)
            });
        }
    }

    fn look(&mut self) -> Option<Violation> {
        let rig = &self.rig;
        let autopilot = rig.world.drones().first().and_then(|d| d.autopilot());
        if autopilot.is_some_and(SimulatedAutopilot::obeys_failsafe) {
            self.failsafe_s = rig.t_s();
        }
        let scene = StormScene {
            failsafe: rig.t_s() < self.failsafe_s + RESUME_S,
            runs_low: self.runs_low_s.is_some(),
            ..scene_of(self.flight, &self.faults.0, self.people.ordered_s(), rig.t_s())
        };
        let mut looks = self.watches.iter_mut().enumerate();
        looks.find_map(|(k, watch)| watch.look(rig, k, &scene))
    }

    /// Ending of the flight, and the rule that was broken although the drone had enough time without faults;
    /// None: the flight continues.
    fn over(&mut self) -> Option<(StormEnding, Option<Violation>)> {
        let (rig, people, t_s) = (&self.rig, &self.people, self.rig.t_s());
        let active = |f: &Scheduled| f.timer.began_s.is_some() && !f.timer.over;
        let active = self.faults.0.iter().any(active);
        if active {
            self.last_s = t_s;
        }
        let o = rig.world.observation();
        let stands = !o.motors_on && !o.in_water && o.feet_height_m().abs() < FALSE_STOP_M;
        if !stands || active || !people.is_over(rig) {
            self.moved_s = t_s;
        }
        if t_s - self.moved_s > REST_S {
            return Some((StormEnding::Landed, None));
        }
        let [lively_s, limit_s] = self.flight.limits_s();
        let given_up = rig.state(0) == State::GaveUp || people.is_up(rig);
        let given_up = given_up && t_s > rig.entered_s(0).max(self.last_s) + GIVEN_UP_S;
        let alone = given_up || t_s > self.last_s.max(people.since_s()) + lively_s;
        let descends = matches!(rig.state(0), State::Descent | State::Flare);
        if !alone || descends && t_s < rig.entered_s(0) + DESCENDS_S {
            // A flight that ends early lacks undisturbed time and is not judged.
            return (t_s > limit_s).then(|| (end(rig), None));
        }
        Some(
            match is_stuck(rig).or_else(|| is_unreported(rig, self.reported_s)) {
                Some(violation) => (StormEnding::Violated, Some(violation)),
                None => (end(rig), None),
            },
        )
    }
}

fn scene_of(flight: FlightKind, faults: &[Scheduled], ordered_s: f64, t_s: f64) -> StormScene {
    let began = || faults.iter().filter_map(|f| Some((f, f.timer.began_s?)));
    let newest_s = began().map(|(f, at)| {
        if f.timer.over {
            at + f.timer.fault.lasts_s
        } else {
            at
        }
    });
    let until = |after_s: f64| move |f: &Scheduled, at: f64| t_s < at + f.timer.fault.lasts_s + after_s;
    let takes = |what: Takes, after_s: f64| {
        began().any(|(f, at)| f.timer.fault.kind.spec().takes == what && until(after_s)(f, at))
    };
    let ([aborted_s, last_abort_s], withdrawn_s) = withdrawn(flight, faults);
    let received = |kind: FaultKind| kind == FaultKind::OrderedAshore && !flight.is_silent();
    let orders =
        |f: &Scheduled| f.timer.fault.kind == FaultKind::OrderedAgain || received(f.timer.fault.kind);
    let ordered_again =
        withdrawn_s.is_some_and(|w| ordered_s > w || began().any(|(f, at)| orders(f) && at >= w - NOTICED_S));
    StormScene {
        flight,
        failsafe: false,
        runs_low: false,
        faults: began().filter(|(f, at)| until(TOGETHER_S)(f, *at)).count(),
        newest_s: newest_s.fold(f64::NEG_INFINITY, f64::max),
        uncommanded: takes(Takes::Command, RESUME_S),
        without_power: takes(Takes::Power, 1.0),
        charge_left: began().filter_map(|(f, _)| f.charge_left).reduce(f64::min),
        aborted_s,
        last_abort_s,
        withdrawn_s: withdrawn_s.filter(|_| !ordered_again),
    }
}

/// Times at which the mission received the first and the newest abort, and at which the first abort or a
/// reported take-over withdrew its order, s. Aborts without effect do not count: a sortie away from the deck
/// has no landing to stop.
fn withdrawn(flight: FlightKind, faults: &[Scheduled]) -> ([Option<f64>; 2], Option<f64>) {
    let began = || faults.iter().filter_map(|f| Some((f, f.timer.began_s?)));
    let stopped = |from_s: f64, until_s: f64, hides: &dyn Fn(FaultKind) -> bool| {
        began().any(|(f, at)| {
            hides(f.timer.fault.kind)
                && at < until_s + NOTICED_S
                && at + f.timer.fault.lasts_s + NOTICED_S > from_s
        })
    };
    let received = |at: &f64| !stopped(*at, *at, &FaultKind::stops_mission);
    // An abort from ashore passes through radio, relay and bridge; an abort over MAVLink passes through the
    // autopilot's wire and the link. Another fault may block these paths.
    let undisturbed = |at: f64, own: FaultKind| {
        let hides = |k: FaultKind| k != own;
        !stopped(at - ASHORE_S, at + ASHORE_S, &hides)
    };
    let arrives = |at: f64, own: FaultKind| undisturbed(at, own).then_some(at + ASHORE_S);
    let aborts = || {
        began()
            .filter(|(f, _)| f.stops)
            .filter_map(|(f, at)| match f.timer.fault.kind {
                FaultKind::Abort if flight == FlightKind::Mavlink => arrives(at, FaultKind::Abort),
                FaultKind::Abort => Some(at).filter(received),
                FaultKind::AbortAshore if !flight.is_silent() => arrives(at, FaultKind::AbortAshore),
                _ => None,
            })
    };
    let aborted_s = aborts().reduce(f64::min);
    let last_abort_s = aborts().reduce(f64::max);
    let hides =
        |k: FaultKind| k != FaultKind::TakenOver && (k.stops_mission() || k.spec().takes == Takes::Command);
    let taken = began().find(|(f, at)| {
        let lasts_s = f.timer.fault.lasts_s;
        let takes = f.timer.fault.kind == FaultKind::TakenOver && f.stops && lasts_s > NOTICED_S;
        takes && !stopped(*at, at + lasts_s, &hides)
    });
    ([aborted_s, last_abort_s], aborted_s.or(taken.map(|(_, at)| at)))
}

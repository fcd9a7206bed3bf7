//! Flies a storm: faults begin and end at their times, and every tick is watched.

use alight_shared::autopilot_parameters::{ARDU_COPTER, PX4};
use alight_shared::msg::State;
use alight_uav::autopilot::modes::Firmware;
use serde::Serialize;

use super::kinds::{Effect, Takes};
use super::watch::{Ending, Scene, Violation, Watch, end, is_stuck};
use super::{Fault, Kind, Mutant, Storm};
use crate::harness::failing::Failing;
use crate::harness::outcome::{FALSE_STOP_M, REST_S};
use crate::harness::rig::Rig;
use crate::harness::scenario::SetupError;
use crate::harness::tap::NoTap;

/// Everything is over within this time of the order, s.
const LIMIT_S: f64 = 300.0;
/// Within this time after the last fault it has landed, or waits for a stated reason, s.
const LIVELY_S: f64 = 120.0;
/// A fault that was over so long ago is none of several any more, s.
const TOGETHER_S: f64 = 5.0;
/// An abort from ashore has come to the mission within this time where nothing else fails, s.
const ASHORE_S: f64 = 2.0;
/// What lasts longer is seen, s.
const SEEN_S: f64 = 1.0;
/// Given up for so long, after the last fault, it waits for the operator, s: longer than it climbs.
const GIVEN_UP_S: f64 = 20.0;

/// A flown storm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flown {
    /// How it ended.
    pub ending: Ending,
    /// The first rule that was broken.
    pub violation: Option<Violation>,
    /// The faults that began: kind, the mission's state at that time, and when, s after the order.
    pub began: Vec<(Kind, State, f64)>,
    /// Time from the order to the end, s.
    pub lasted_s: f64,
}

/// A fault of the list at its place in time.
struct Scheduled {
    fault: Fault,
    began_s: Option<f64>,
    over: bool,
    /// What it has left of the battery where it met that, 0 to 1.
    charge_left: Option<f64>,
}

impl Scheduled {
    fn is_active(&self, t_s: f64) -> bool {
        self.began_s.is_some_and(|at| t_s < at + self.fault.lasts_s)
    }
}

/// Flies it; `show` is given each fault and each state as it begins.
pub fn fly(storm: &Storm, show: &mut dyn FnMut(f64, &str)) -> Result<Flown, SetupError> {
    fly_mutant(storm, None, show)
}

/// Flies a storm with a defect in the drone's nodes.
pub fn fly_mutant(
    storm: &Storm,
    mutant: Option<Mutant>,
    show: &mut dyn FnMut(f64, &str),
) -> Result<Flown, SetupError> {
    let (scenario, nodes) = storm.scene();
    let mut rig = Rig::landing(&scenario, &nodes, storm.seed)?;
    set_up(&mut rig);
    rig.world.share_deck();
    let pending = |fault: &Fault| Scheduled {
        fault: *fault,
        began_s: None,
        over: false,
        charge_left: None,
    };
    let mut faults: Vec<Scheduled> = storm.faults.iter().map(pending).collect();
    let mut watches = vec![Watch::default(); storm.drones.into()];
    let mut flown = Flown {
        ending: Ending::Waits,
        violation: None,
        began: Vec::new(),
        lasted_s: 0.0,
    };
    let (mut last_s, mut rested_s, mut state) = (0.0_f64, 0.0_f64, State::Idle);
    loop {
        let t_s = rig.t_s();
        if rig.state(0) != state {
            state = rig.state(0);
            show(t_s, &format!("{}: {}", state.name(), rig.mission(0).entered));
        }
        for k in 0..faults.len() {
            step(&mut rig, &mut faults, k, &mut flown, show);
        }
        let failing = failing(&faults, t_s);
        rig.world.fail(&Failing { mutant, ..failing });
        rig.advance(&mut NoTap);
        let t_s = rig.t_s();
        let scene = scene_of(&faults, t_s);
        let mut looks = watches.iter_mut().enumerate();
        if let Some(violation) = looks.find_map(|(k, watch)| watch.look(&rig, k, &scene)) {
            show(t_s, &violation.to_string());
            flown.ending = Ending::Violated;
            flown.violation = Some(violation);
            break;
        }
        let active = faults.iter().any(|f| f.began_s.is_some() && !f.over);
        if active {
            last_s = t_s;
        }
        let o = rig.world.observation();
        let rests = !o.motors_on && !o.in_water && o.feet_height_m().abs() < FALSE_STOP_M && !active;
        rested_s = if rests { rested_s } else { t_s };
        if t_s - rested_s > REST_S {
            flown.ending = Ending::Landed;
            break;
        }
        let given_up = rig.state(0) == State::GaveUp && t_s > rig.entered_s(0).max(last_s) + GIVEN_UP_S;
        if given_up || t_s > last_s + LIVELY_S || t_s > LIMIT_S {
            flown.ending = end(&rig);
            // A storm that is cut off has not been left alone for long enough to be asked.
            let is_cut = !given_up && t_s <= last_s + LIVELY_S;
            if let Some(violation) = is_stuck(&rig).filter(|_| !is_cut) {
                show(t_s, &violation.to_string());
                (flown.ending, flown.violation) = (Ending::Violated, Some(violation));
            }
            break;
        }
    }
    flown.lasted_s = rig.t_s();
    Ok(flown)
}

/// Sets the autopilot's parameters as `alight check` asks for them.
fn set_up(rig: &mut Rig) {
    let Some(linked) = rig.world.linked(0) else { return };
    let autopilot = &mut linked.autopilot;
    let asked = match autopilot.firmware() {
        Firmware::Px4 => PX4,
        Firmware::ArduCopter => ARDU_COPTER,
    };
    for p in asked {
        if let Some(value) = autopilot.parameters.get_mut(p.name).filter(|v| !p.suits(**v)) {
            *value = p.wanted.value();
        }
    }
}

/// Begins or ends the `k`-th fault where that is due.
fn step(
    rig: &mut Rig,
    faults: &mut [Scheduled],
    k: usize,
    flown: &mut Flown,
    show: &mut dyn FnMut(f64, &str),
) {
    let t_s = rig.t_s();
    let Some(scheduled) = faults.get_mut(k) else {
        return;
    };
    let fault = scheduled.fault;
    match scheduled.began_s {
        None if rig
            .began_s(fault.moment)
            .is_some_and(|at| t_s >= at + fault.after_s) =>
        {
            scheduled.began_s = Some(t_s);
            scheduled.charge_left = fault.kind.empties().then_some(0.0);
            flown.began.push((fault.kind, rig.state(0), t_s));
            let (size, lasts) = (fault.size, fault.lasts_s);
            show(
                t_s,
                &format!("fault: {}, size {size}, for {lasts} s", fault.kind.name()),
            );
            if let Effect::Events(begin, _) = fault.kind.spec().effect {
                begin(rig, fault.size);
            }
        }
        Some(_) if !scheduled.over && !scheduled.is_active(t_s) => {
            scheduled.over = true;
            let charge = rig.world.linked(0).map(|l| l.autopilot.battery);
            scheduled.charge_left = charge.filter(|_| fault.kind.empties());
            if let Effect::Events(_, end) = fault.kind.spec().effect {
                end(rig, fault.size);
            }
        }
        None | Some(_) => {}
    }
}

/// What fails now, of all that are active.
fn failing(faults: &[Scheduled], t_s: f64) -> Failing {
    let mut failing = Failing::default();
    for f in faults.iter().filter(|f| f.is_active(t_s)) {
        if let Effect::Lasting(fail) = f.fault.kind.spec().effect {
            fail(&mut failing, f.fault.size);
        }
    }
    failing
}

/// The faults as the rules see them.
fn scene_of(faults: &[Scheduled], t_s: f64) -> Scene {
    let began = || faults.iter().filter_map(|f| Some((f, f.began_s?)));
    let newest_s = began().map(|(f, at)| if f.over { at + f.fault.lasts_s } else { at });
    let until = |after_s: f64| move |f: &Scheduled, at: f64| t_s < at + f.fault.lasts_s + after_s;
    let takes = |what: Takes, after_s: f64| {
        began().any(|(f, at)| f.fault.kind.spec().takes == what && until(after_s)(f, at))
    };
    let ([aborted_s, last_abort_s], withdrawn_s) = withdrawn(faults);
    let orders = |f: &Scheduled| matches!(f.fault.kind, Kind::OrderedAgain | Kind::OrderedAshore);
    let ordered_again = began().any(|(f, at)| orders(f) && withdrawn_s.is_some_and(|w| at >= w - SEEN_S));
    Scene {
        faults: began().filter(|(f, at)| until(TOGETHER_S)(f, *at)).count(),
        newest_s: newest_s.fold(f64::NEG_INFINITY, f64::max),
        uncommanded: takes(Takes::Command, super::watch::RESUME_S),
        without_power: takes(Takes::Power, 1.0),
        charge_left: began().filter_map(|(f, _)| f.charge_left).reduce(f64::min),
        aborted_s,
        last_abort_s,
        withdrawn_s: withdrawn_s.filter(|_| !ordered_again),
    }
}

/// When the mission received the first abort and the newest, and when it lost its order by the first or by a take-over that the link
/// reported, s.
fn withdrawn(faults: &[Scheduled]) -> ([Option<f64>; 2], Option<f64>) {
    let began = || faults.iter().filter_map(|f| Some((f, f.began_s?)));
    let stopped = |from_s: f64, until_s: f64, hides: &dyn Fn(Kind) -> bool| {
        began().any(|(f, at)| {
            hides(f.fault.kind) && at < until_s + SEEN_S && at + f.fault.lasts_s + SEEN_S > from_s
        })
    };
    let received = |at: &f64| !stopped(*at, *at, &Kind::stops_mission);
    // From ashore by radio, relay and bridge, any of which another fault may have stopped.
    let undisturbed = |at: f64| {
        let hides = |k: Kind| k != Kind::AbortAshore;
        !stopped(at - ASHORE_S, at + ASHORE_S, &hides)
    };
    let aborts = || {
        began().filter_map(|(f, at)| match f.fault.kind {
            Kind::Abort => Some(at).filter(received),
            Kind::AbortAshore if undisturbed(at) => Some(at + ASHORE_S),
            _ => None,
        })
    };
    let aborted_s = aborts().reduce(f64::min);
    let last_abort_s = aborts().reduce(f64::max);
    let hides = |k: Kind| k != Kind::TakenOver && (k.stops_mission() || k.spec().takes == Takes::Command);
    let taken = began().find(|(f, at)| {
        let lasts_s = f.fault.lasts_s;
        f.fault.kind == Kind::TakenOver && lasts_s > SEEN_S && !stopped(*at, at + lasts_s, &hides)
    });
    ([aborted_s, last_abort_s], aborted_s.or(taken.map(|(_, at)| at)))
}

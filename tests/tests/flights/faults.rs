//! The fault matrix: at every moment of a landing with one order, a process or the whole computer of the
//! drone is killed or frozen, or its cable goes silent. Both autopilots are flown. `alight land --fault`
//! draws such times in live flights.

use std::path::Path;

use alight_shared::msg::State;
use alight_sim::{
    autopilots::simulated::SimulatedAutopilot,
    harness::{
        outcome::{Ending, FALSE_STOP_M, Judge, Outcome, TIME_LIMIT_S},
        physics::TICK,
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
        storm::{Fault, FaultKind, FaultTimer, FaultTurn, Moment},
    },
    physics::{deck_motion::DeckMotionConfig, sea::SeaConfig},
};
use alight_uav::autopilot::{
    message::{MavCmd, MavResult},
    modes::Firmware,
};
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::BOTH;

/// Maximum time on the deck with the motors on, s: the autopilot denies disarming for 1 s, PX4 returns from
/// its failsafe, and a restarted process collects evidence of the landing.
const MOTORS_ON_S: f64 = 5.0;
/// Time from the first disarm command until the autopilot accepts one, s; longer than the time from the stop
/// to a fault.
const DENIES_S: f64 = 1.0;
const CABLE_OUT_S: f64 = 1.0;
/// Maximum tilt in excess of the command before contact, deg.
const TILT_BEYOND_DEG: f64 = 10.0;
/// Time constant with which the commanded tilt is remembered, s, as in the mission.
const TILT_MEMORY_S: f64 = 0.5;
/// Maximum distance from the deck's centre at rest, m.
const REST_ERROR_M: f64 = 1.0;
/// Minimum height above the deck at which a drone may hold in a final state, m.
const HOLDS_M: f64 = 4.0;
/// Flight time after the mission gave up, s; long enough to climb clear of the deck.
const CLIMB_S: f64 = 15.0;
/// Maximum percentage of flights with a contact slightly above the limit. Observed here and on recorded
/// decks: 1 of 118, at 1.006 of the limit by the second foot.
const HARD_PERCENT: usize = 3;
/// Limit ratio up to which a contact counts as slightly above the limit.
const LITTLE_HARD: f64 = 1.05;

/// Whether the fault stops pilot, link or computer for longer than the autopilot waits for set-points, so
/// that the autopilot holds. PX4's hold slides and hops on a moving deck before the disarm of a restarted link.
fn is_uncommanded(fault: Option<Fault>) -> bool {
    use FaultKind::{ComputerKilled, LinkFrozen, LinkKilled, PilotFrozen};
    fault.is_some_and(|fault| match fault.kind {
        PilotFrozen | LinkFrozen | ComputerKilled => true,
        LinkKilled => fault.moment == Moment::In(State::Landed),
        _ => false,
    })
}

/// Whether a mission restarted without its checkpoint does not know about the landing.
fn forgets(fault: &Fault) -> bool {
    fault.kind == FaultKind::MissionKilled && fault.size > 0.0
}
/// Whether the drone may take off: the autopilot's hold may lift it off a sinking deck, and a drone that
/// continues is not pressed back onto the deck.
fn may_take_off(fault: &Fault) -> bool {
    fault.kind == FaultKind::ComputerKilled && fault.moment == Moment::In(State::Landed)
}
fn must_land(fault: &Fault) -> bool {
    use FaultKind::{ComputerKilled, MissionKilled, PredictorKilled};
    let resumes = matches!(fault.kind, MissionKilled | PredictorKilled | ComputerKilled);
    resumes && !forgets(fault) && !may_take_off(fault)
}

#[derive(Clone, Debug)]
struct Case {
    firmware: Firmware,
    fault: Option<Fault>,
    seed: u64,
    sea: SeaConfig,
    deck_motion: Option<DeckMotionConfig>,
}

#[derive(Debug)]
struct Flown {
    outcome: Outcome,
    /// Start and end of the fault, s.
    fault_s: [Option<f64>; 2],
    landed: bool,
    armed: bool,
    /// The drone holds high above the deck in a final state.
    holds: bool,
    motors_on_deck_s: f64,
    tilt_beyond_deg: f64,
}

impl Case {
    fn scenario(&self) -> Scenario {
        let mut scenario = Scenario {
            sea: self.sea.clone(),
            deck_motion: self.deck_motion.clone(),
            ..Scenario::default()
        };
        let autopilot = &mut scenario.drone.autopilot;
        // Longest permitted delay of the autopilot's failsafe.
        autopilot.firmware = self.firmware;
        autopilot.loss_after_s = 0.5;
        scenario
    }
    /// Whether the autopilot denies a disarm at `now_s`, as if it had not detected the landing, because a
    /// fault follows the stop of the motors.
    fn is_denied(&self, autopilot: &SimulatedAutopilot, now_s: f64) -> bool {
        let first = autopilot
            .commands
            .iter()
            .find(|(_, c)| c.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
        let after_the_stop = self.fault.is_some_and(|f| f.moment == Moment::In(State::Landed));
        after_the_stop && first.is_none_or(|(at, _)| now_s < at.secs() + DENIES_S)
    }
    fn fly(&self) -> Flown {
        let scenario = self.scenario();
        let half_deck = [scenario.deck.length_m / 2.0, scenario.deck.width_m / 2.0];
        let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), self.seed).unwrap();
        let mut judge = Judge::default();
        let mut tilt = Tilt::default();
        let mut timer = self.fault.map(FaultTimer::new);
        let mut fault_s = [None; 2];
        let mut motors_on_deck_s = 0.0;
        let mut judged_s = None;
        rig.each(TIME_LIMIT_S + CLIMB_S, |rig| {
            let t = rig.t_s();
            let now_s = rig.world.physics().now().secs();
            let attitude = rig.world.physics().drone(0).unwrap().attitude.0;
            let o = rig.world.observation();
            let over = judge.observe(&o, half_deck);
            let touched_s = judge.first_contact_s();
            let on_deck = o.feet_height_m() < FALSE_STOP_M && o.horizontal_m < scenario.deck.length_m;
            if touched_s.is_some() && on_deck && o.motors_on {
                motors_on_deck_s += TICK.secs();
            }
            let autopilot = &mut rig.world.linked(0).unwrap().autopilot;
            let denied = touched_s.is_some() && self.is_denied(autopilot, now_s);
            autopilot.answer = denied.then_some(MavResult::MAV_RESULT_DENIED);
            if touched_s.is_none() {
                tilt.observe(autopilot, &attitude);
            }
            if let Some(timer) = &mut timer {
                let fault = timer.fault;
                match timer.poll(t, rig.moment_s(&fault)) {
                    Some(FaultTurn::Begins) => rig.begin(fault.kind, fault.size),
                    Some(FaultTurn::Ends) => {
                        fault_s[1] = Some(t);
                        rig.end(fault.kind, fault.size);
                    }
                    None => {}
                }
                fault_s[0] = timer.began_s;
            }
            judged_s = judged_s.or(over.then_some(t));
            let clear = rig.state(0) != State::GaveUp || judged_s.is_some_and(|at| t >= at + CLIMB_S);
            let fails = fault_s[0].is_some() && fault_s[1].is_none();
            judged_s.is_some() && clear && !fails
        });
        let landed = rig.visited(0).contains(&State::Landed);
        let o = rig.world.observation();
        let stays = matches!(rig.state(0), State::GaveUp | State::Hold | State::Idle);
        Flown {
            outcome: judge.outcome(self.seed, "", "", rig.t_s()),
            fault_s,
            landed,
            holds: o.motors_on && o.feet_height_m() > HOLDS_M && stays,
            armed: rig.world.linked(0).unwrap().autopilot.armed(),
            motors_on_deck_s,
            tilt_beyond_deg: tilt.beyond.to_degrees(),
        }
    }
}

#[derive(Default)]
struct Tilt {
    commanded: f64,
    beyond: f64,
}

impl Tilt {
    fn observe(&mut self, autopilot: &SimulatedAutopilot, attitude: &UnitQuaternion<f64>) {
        let tilt = |q: &UnitQuaternion<f64>| (q * Vector3::z()).angle(&Vector3::z());
        let kept = (-TICK.secs() / TILT_MEMORY_S).exp();
        self.commanded = (self.commanded * kept).max(tilt(&autopilot.wanted()));
        if autopilot.in_offboard() {
            self.beyond = self.beyond.max(tilt(attitude) - self.commanded);
        }
    }
}

impl Flown {
    /// Whether the drone rests on the deck and was disarmed in time, or is away from the deck without
    /// contact. It must not have touched the water, and every contact must be soft. If pilot or link was
    /// frozen, the autopilot's hold excuses a hard contact.
    fn is_safe(&self, fault: Option<Fault>) -> bool {
        let o = &self.outcome;
        let rests = o.rest_position_error_m.is_some_and(|e| e < REST_ERROR_M);
        let forgot = fault.as_ref().is_some_and(forgets);
        let landed = (self.landed || forgot) && !self.armed && rests && self.motors_on_deck_s <= MOTORS_ON_S;
        let gave_up = o.outcome == Ending::GaveUp && o.touchdown_speed_mps.is_none();
        let away = gave_up && !fault.as_ref().is_some_and(must_land);
        let holds = self.holds && fault.as_ref().is_some_and(may_take_off);
        o.water_contacts == 0
            && (o.unsafe_contacts == 0 || is_uncommanded(fault) || self.is_little_hard())
            && (landed || away || holds)
            && self.tilt_beyond_deg <= TILT_BEYOND_DEG
    }
    /// Whether the only unsafe contact was slightly above the limit.
    fn is_little_hard(&self) -> bool {
        let o = &self.outcome;
        o.outcome == Ending::Hard && o.unsafe_contacts == 1 && o.limit_ratio <= LITTLE_HARD
    }
}

/// Asserts that no case is unsafe, tilts too far or ends before its fault, and that few contacts are slightly
/// above the limit.
fn assert_all_safe(cases: &[Case]) {
    let flown: Vec<_> = cases.par_iter().map(|case| (case, case.fly())).collect();
    let landed = flown.iter().filter(|(_, f)| f.landed).count();
    let late = |f: &Flown| f.fault_s[1].is_none();
    let is_safe = |c: &Case, f: &Flown| f.is_safe(c.fault) && (c.fault.is_none() || !late(f));
    let wrong: Vec<_> = flown.iter().filter(|(c, f)| !is_safe(c, f)).collect();
    let hard: Vec<_> = (flown
        .iter()
        .filter(|(c, f)| !is_uncommanded(c.fault) && f.is_little_hard()))
    .map(|(c, f)| (c.seed, f.outcome.limit_ratio))
    .collect();
    let tilts = flown.iter().map(|(_, f)| f.tilt_beyond_deg);
    // Visible with --nocapture.
    println!(
        "{landed} of {} landed, slightly hard: {hard:?}, tilt at most {:.2} deg beyond the command",
        cases.len(),
        tilts.fold(0.0, f64::max)
    );
    assert!(
        wrong.is_empty(),
        "{} of {} ({landed} landed): {wrong:#?}",
        wrong.len(),
        cases.len()
    );
    assert!(
        100 * hard.len() <= HARD_PERCENT * cases.len(),
        "slightly hard: {hard:?}"
    );
}

const MOMENTS: [Moment; 4] = [
    Moment::In(State::Descent),
    Moment::In(State::Flare),
    Moment::Contact,
    Moment::In(State::Landed),
];

const KINDS: [FaultKind; 8] = [
    FaultKind::PredictorKilled,
    FaultKind::PredictorFrozen,
    FaultKind::MissionKilled,
    FaultKind::MissionFrozen,
    FaultKind::PilotKilled,
    FaultKind::PilotFrozen,
    FaultKind::LinkKilled,
    FaultKind::LinkFrozen,
];

/// Kills and freezes of predictor, mission, pilot and link, and silences of the cable, at each moment with
/// both autopilots; kills of the computer, and of a mission without its checkpoint.
#[test]
fn faults_at_every_moment_over_both_autopilots() {
    let mut all = Vec::new();
    for firmware in BOTH {
        for moment in MOMENTS {
            all.extend(KINDS.map(|kind| (firmware, kind, moment, 0.0)));
        }
        all.push((firmware, FaultKind::CableOut, Moment::Contact, 0.0));
    }
    for (moment, lost) in MOMENTS.into_iter().zip(BOTH.into_iter().cycle()) {
        all.extend(BOTH.map(|firmware| (firmware, FaultKind::ComputerKilled, moment, 0.0)));
        all.push((lost, FaultKind::MissionKilled, moment, 1.0));
    }
    let lasts = |fault: Fault| Fault {
        lasts_s: if fault.kind == FaultKind::CableOut {
            CABLE_OUT_S
        } else {
            fault.lasts_s
        },
        ..fault
    };
    let case = |(seed, (firmware, kind, moment, size))| Case {
        firmware,
        fault: Some(Fault {
            size,
            ..lasts(Fault::drawn(kind, moment, seed))
        }),
        seed,
        sea: SeaConfig::paper(0.5, 5.0),
        deck_motion: None,
    };
    let cases: Vec<_> = (300..).zip(all).map(case).collect();
    assert_eq!(cases.len(), 78);
    assert_all_safe(&cases);
}

#[test]
#[ignore = "needs ../shared/data/decks"]
fn faults_on_the_decks_next_to_the_project() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/decks");
    let decks = ["mono-5m-js15-6", "twin-5m-cross", "work-12m-js25-7"];
    let decks = decks.map(|d| folder.join(d).with_extension("csv"));
    let faults = [
        None,
        Some((FaultKind::MissionKilled, State::Descent)),
        Some((FaultKind::MissionKilled, State::Flare)),
        Some((FaultKind::LinkKilled, State::Landed)),
    ];
    let mut cases = Vec::new();
    for firmware in BOTH {
        for k in 0..20_usize {
            cases.push(Case {
                firmware,
                fault: faults[k % faults.len()]
                    .map(|(kind, state)| Fault::drawn(kind, Moment::In(state), 400 + k as u64)),
                seed: 400 + k as u64,
                sea: SeaConfig::paper(0.0, 5.0),
                deck_motion: Some(DeckMotionConfig {
                    file: decks[k % decks.len()].clone(),
                    start_s: 15.0 * k as f64,
                    water_follows: true,
                    ..DeckMotionConfig::default()
                }),
            });
        }
    }
    assert_all_safe(&cases);
}

//! Gaps in what a flight rests on, in every state in which rotors turn: the drone goes on, or reports what it does; orders act, and
//! nothing is disarmed in the air or left low over the deck.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State, Station};
use alight_sim::harness::failing::Failing;
use alight_sim::harness::outcome::MAX_CONTACT_MPS;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::storm::{Effect, FaultKind, Takes};
use alight_sim::physics::sea::SeaConfig;
use alight_sim::physics::vessel::VesselCourse;
use alight_uav::autopilot::message::id;
use alight_uav::autopilot::modes::Firmware;
use rayon::prelude::*;

use super::BOTH;
use super::takeoff::{armed, on_deck};

/// In what state the gap begins, reached how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum When {
    SpinUp,
    TakeOff,
    ClimbOut,
    StandDown,
    /// In the hold after a take-off, and on a station.
    Hold,
    Station,
    /// In a hold that was ordered, and after an abort, on the way to the deck.
    Stopped,
    GaveUp,
    /// Handed over, without an order.
    Idle,
    GetAltitude,
    Approach,
    Tracking,
    Descent,
    Flare,
    Landed,
}
use When::{
    Approach, ClimbOut, Descent, Flare, GaveUp, GetAltitude, Hold, Idle, Landed, SpinUp, StandDown,
    Station as OnStation, Stopped, TakeOff, Tracking,
};

const ALL: [When; 15] = [
    SpinUp,
    TakeOff,
    ClimbOut,
    StandDown,
    Hold,
    OnStation,
    Stopped,
    GaveUp,
    Idle,
    GetAltitude,
    Approach,
    Tracking,
    Descent,
    Flare,
    Landed,
];
/// Who is gone.
const GONE: [FaultKind; 13] = [
    FaultKind::RadioLost,
    FaultKind::PilotFrozen,
    FaultKind::PilotKilled,
    FaultKind::PlannerFrozen,
    FaultKind::MissionFrozen,
    FaultKind::MissionKilled,
    FaultKind::LinkFrozen,
    FaultKind::LinkKilled,
    FaultKind::ComputerFrozen,
    FaultKind::ComputerKilled,
    FaultKind::CableOut,
    FaultKind::AutopilotSilent,
    FaultKind::StreamStops,
];

const ABEAM: Station = Station {
    ahead_m: 0,
    right_m: 20,
    height_m: 15,
    for_min: 10,
};

/// A flight with one gap.
#[derive(Clone, Copy, Debug)]
struct Cell {
    when: When,
    /// After it entered that state, s.
    after_s: f64,
    gone: FaultKind,
    gap_s: f64,
    firmware: Firmware,
    /// Given 2 s after the gap.
    order: Option<CommandKind>,
    seed: u64,
}

/// Ending of a flight.
#[derive(Debug, Default)]
struct End {
    bad: Option<String>,
    state: State,
    /// On the deck and disarmed.
    stands: bool,
}

/// The drone is commanded again within this time after a gap, s.
const RESUME_S: f64 = 5.0;
/// Time after an act of the autopilot alone for which contacts are excused, s.
const EXCUSED_S: f64 = 1.5;
/// An order has been acted on within this time, s: the way up and out of a take-off.
const ACTS_S: f64 = 35.0;
/// Feet higher than this are not on the deck, m.
const AIR_M: f64 = 0.25;

impl Cell {
    fn takes_off(&self) -> bool {
        matches!(
            self.when,
            SpinUp | TakeOff | ClimbOut | StandDown | Hold | OnStation
        )
    }
    fn rig(&self) -> Rig {
        let (mut scenario, nodes) = if self.takes_off() {
            on_deck(0.5, self.firmware)
        } else {
            let mut scenario = Scenario {
                sea: SeaConfig::paper(0.5, 5.0),
                ..Scenario::default()
            };
            scenario.drone.autopilot.firmware = self.firmware;
            scenario.start.height_m = [6.0, 6.5];
            (scenario, NodeConfigs::default())
        };
        scenario.start.warm_up_s = 30.0;
        if self.seed % 2 == 1 {
            scenario.vessel.course = VesselCourse::Straight;
            scenario.vessel.speed_mps = 2.0;
        }
        let mut rig = Rig::new(&scenario, &nodes, self.seed).unwrap();
        if self.takes_off() {
            rig.world.deck_order(DeckOrder::TakeOff(1));
            rig.run(1.0);
            rig.world.command(CommandKind::TakeOff);
        } else if self.when != Idle {
            rig.world.command(CommandKind::Land);
        }
        rig
    }
    /// Goes on to the state in which the gap begins.
    fn reach(&self, rig: &mut Rig) -> bool {
        let due = |rig: &mut Rig, state: State, after_s: f64| rig.until(90.0, |r| r.is_due(state, after_s));
        let armed_in = |rig: &mut Rig, state: State| rig.until(90.0, |r| r.state(0) == state && armed(r, 0));
        let ordered = |rig: &mut Rig, kind: CommandKind, state: State| {
            rig.world.command(kind);
            due(rig, state, self.after_s)
        };
        match self.when {
            SpinUp => {
                armed_in(rig, State::SpinUp) && {
                    rig.run(self.after_s);
                    rig.state(0) == State::SpinUp
                }
            }
            StandDown => armed_in(rig, State::SpinUp) && ordered(rig, CommandKind::Abort, State::StandDown),
            TakeOff => due(rig, State::TakeOff, self.after_s),
            ClimbOut => due(rig, State::ClimbOut, self.after_s),
            Hold => due(rig, State::Hold, self.after_s),
            OnStation => {
                due(rig, State::Hold, 1.0) && {
                    rig.world.command(CommandKind::Station(ABEAM));
                    rig.run(self.after_s + 1.0);
                    rig.mission(0).station.is_some()
                }
            }
            Stopped => due(rig, State::Approach, 0.5) && ordered(rig, CommandKind::Hold, State::Hold),
            GaveUp => due(rig, State::Tracking, 0.5) && ordered(rig, CommandKind::Abort, State::GaveUp),
            Idle => {
                rig.run(self.after_s);
                true
            }
            GetAltitude => due(rig, State::GetAltitude, self.after_s),
            Approach => due(rig, State::Approach, self.after_s),
            Tracking => due(rig, State::Tracking, self.after_s),
            Descent => due(rig, State::Descent, self.after_s),
            Flare => due(rig, State::Flare, self.after_s.min(0.3)),
            Landed => due(rig, State::Landed, 0.0),
        }
    }
    fn begin(&self, rig: &mut Rig) {
        match self.gone.effect() {
            Effect::Lasting(fail) => {
                let mut failing = Failing::default();
                let size = match (self.gone, self.firmware) {
                    (FaultKind::StreamStops, Firmware::Px4) => id::ODOMETRY,
                    (FaultKind::StreamStops, Firmware::ArduCopter) => id::LOCAL_POSITION_NED,
                    _ => 0,
                };
                fail(&mut failing, f64::from(size));
                rig.world.fail(&failing);
            }
            Effect::Events(begin, _) => begin(rig, 0.0),
        }
    }
    fn end(&self, rig: &mut Rig) {
        match self.gone.effect() {
            Effect::Lasting(_) => rig.world.fail(&Failing::default()),
            Effect::Events(_, end) => end(rig, 0.0),
        }
    }

    fn fly(&self) -> End {
        let mut rig = self.rig();
        if !self.reach(&mut rig) {
            let bad = Some(format!("never came so far: {:?}", rig.visited(0)));
            return End {
                bad,
                ..End::default()
            };
        }
        let began_s = rig.t_s();
        self.begin(&mut rig);
        let (mut over, mut ordered) = (false, false);
        let mut watch = Watched::default();
        let over_s = began_s + self.gap_s;
        rig.each(self.gap_s + ACTS_S + 5.0, |rig| {
            let t_s = rig.t_s();
            if t_s >= over_s && !over {
                over = true;
                self.end(rig);
            }
            if t_s >= over_s + 2.0 && !ordered {
                ordered = true;
                if let Some(order) = self.order {
                    rig.world.command(order);
                }
            }
            watch.look(self, rig, t_s - over_s);
            watch.end.bad.is_some() || watch.rests(rig)
        });
        watch.judge(self, &rig);
        watch.end
    }
}

/// Observations of a flight.
#[derive(Default)]
struct Watched {
    end: End,
    turned: bool,
    rested: u32,
}

impl Watched {
    /// `since_s`: since the gap was over.
    fn look(&mut self, cell: &Cell, rig: &Rig, since_s: f64) {
        let o = rig.world.observation();
        let stops = core::mem::replace(&mut self.turned, o.motors_on) && !o.motors_on;
        let height_m = o.feet_height_m();
        let excused = cell.gone.spec().takes == Takes::Command && since_s < EXCUSED_S;
        let strikes = |normal_mps: f64, foot: bool| normal_mps > MAX_CONTACT_MPS || !foot;
        let hit = o
            .contacts
            .iter()
            .find(|c| strikes(c.normal_mps, c.foot))
            .map(|c| c.normal_mps);
        let in_offboard = rig.world.drones()[0].autopilot().is_some_and(|a| a.in_offboard());
        let restarted = matches!(cell.gone, FaultKind::MissionKilled | FaultKind::ComputerKilled);
        let bad = if o.in_water {
            Some("in the water".to_owned())
        } else if stops && height_m > AIR_M {
            Some(format!("stopped {height_m:.2} m above the deck"))
        } else if let Some(mps) = hit.filter(|_| !excused) {
            Some(format!("met the deck at {mps:.2} m/s"))
        } else if since_s > RESUME_S && o.motors_on && height_m > AIR_M && !in_offboard {
            Some(format!(
                "{height_m:.1} m above the deck, and follows no set-points"
            ))
        } else if !restarted && rig.mission(0).entered.code == ReasonCode::Restarted {
            Some("reports a restart that was none".to_owned())
        } else {
            None
        };
        if let Some(bad) = bad {
            let (state, entered) = (rig.state(0), rig.mission(0).entered);
            self.end.bad = Some(format!(
                "{bad}, {since_s:.2} s after the gap in {state:?}: {entered}"
            ));
        }
    }
    /// On the deck with motors off, for a second.
    fn rests(&mut self, rig: &Rig) -> bool {
        let o = rig.world.observation();
        let rests = !armed(rig, 0) && !o.in_water && o.feet_height_m().abs() < AIR_M;
        self.rested = if rests { self.rested + 1 } else { 0 };
        self.rested > 100
    }
    fn judge(&mut self, cell: &Cell, rig: &Rig) {
        let o = rig.world.observation();
        let (state, m) = (rig.state(0), rig.mission(0));
        let height_m = o.feet_height_m();
        self.end.state = state;
        self.end.stands = !armed(rig, 0) && height_m.abs() < AIR_M && !o.in_water;
        if self.end.bad.is_some() {
            return;
        }
        let held = matches!(state, State::Hold | State::GaveUp);
        let low = armed(rig, 0) && height_m < 3.0 && o.horizontal_m < 4.0;
        let bad = if self.end.stands {
            None
        } else if cell.order.is_some() && !held {
            Some("the order did not act")
        } else if low && !matches!(state, State::Descent | State::Flare) {
            Some("is left low over the deck")
        } else if state == State::StandDown || state == State::SpinUp {
            Some("stands there armed")
        } else {
            None
        };
        if let Some(bad) = bad {
            let (entered, waiting) = (m.entered, m.waiting);
            self.end.bad = Some(format!(
                "{bad}: {state:?}, {height_m:.1} m, {entered}, waits: {waiting}"
            ));
        }
    }
}

/// Flies them; the bad ones.
fn bad(cells: &[Cell]) -> Vec<String> {
    let fly = |cell: &Cell| {
        let bad = cell.fly().bad?;
        println!("{cell:?}: {bad}");
        Some(format!("{cell:?}: {bad}"))
    };
    cells.par_iter().filter_map(fly).collect()
}
const ORDERS: [Option<CommandKind>; 3] = [None, Some(CommandKind::Hold), Some(CommandKind::Abort)];

#[test]
fn gaps_that_ended_badly_once() {
    let cell = |when, after_s, gone, gap_s, firmware, order, seed| Cell {
        when,
        after_s,
        gone,
        gap_s,
        firmware,
        order,
        seed,
    };
    let [px4, copter] = BOTH;
    let (hold, abort) = (Some(CommandKind::Hold), Some(CommandKind::Abort));
    let found = bad(&[
        cell(ClimbOut, 0.5, FaultKind::PilotFrozen, 0.8, px4, hold, 80),
        cell(ClimbOut, 0.5, FaultKind::ComputerFrozen, 0.95, px4, None, 81),
        cell(SpinUp, 0.5, FaultKind::PilotKilled, 1.0, px4, None, 82),
        cell(SpinUp, 0.5, FaultKind::ComputerFrozen, 2.0, px4, None, 83),
        cell(SpinUp, 2.8, FaultKind::LinkKilled, 1.0, copter, None, 84),
        cell(StandDown, 0.05, FaultKind::LinkFrozen, 1.0, px4, None, 85),
        cell(OnStation, 1.0, FaultKind::PilotFrozen, 0.8, px4, hold, 86),
        // It hovers by a thrust that was taken for less than hover; stands by a hover thrust that was learned on the deck.
        cell(SpinUp, 0.5, FaultKind::AutopilotSilent, 0.8, px4, abort, 913),
        cell(SpinUp, 0.5, FaultKind::ComputerKilled, 0.5, px4, abort, 910),
        // The autopilot alone slides it to the deck's edge.
        cell(Flare, 0.1, FaultKind::ComputerFrozen, 1.5, px4, abort, 924),
        cell(Landed, 0.5, FaultKind::ComputerFrozen, 1.5, px4, abort, 925),
        cell(Descent, 1.0, FaultKind::MissionFrozen, 0.5, px4, None, 917),
    ]);
    assert!(found.is_empty(), "{} of 12: {found:#?}", found.len());
}

/// Every state, every gap, whoever is gone, both characters: 1950 flights, or every 13th with ALIGHT_GAPS_PART=0 to 12.
#[test]
#[ignore = "minutes"]
fn gaps_in_every_state() {
    let mut cells = Vec::new();
    for (k, when) in ALL.into_iter().enumerate() {
        for (l, gone) in GONE.into_iter().enumerate() {
            for (j, gap_s) in [0.2, 0.5, 0.8, 1.5, 3.0].into_iter().enumerate() {
                for (i, firmware) in BOTH.into_iter().enumerate() {
                    let n = k + l + j + i;
                    cells.push(Cell {
                        when,
                        after_s: [0.1, 0.5, 1.0][n % 3],
                        gone,
                        gap_s,
                        firmware,
                        order: ORDERS[(n / 2 + l) % 3],
                        seed: 900 + n as u64,
                    });
                }
            }
        }
    }
    let only = |name: &str| std::env::var(name).ok();
    let part: Option<usize> = only("ALIGHT_GAPS_PART").and_then(|v| v.parse().ok());
    let some: Vec<Cell> = match part {
        Some(n) => cells.into_iter().skip(n).step_by(13).collect(),
        None => cells,
    };
    let found = bad(&some);
    println!("{} of {} end badly", found.len(), some.len());
    assert!(found.is_empty(), "{} of {}: {found:#?}", found.len(), some.len());
}

//! Interruptions while the rotors turn: the drone continues, or reports its actions; orders take effect; no
//! drone is disarmed in the air or stays low over the deck. Storms draw other combinations.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State, Station};
use alight_sim::{
    harness::{
        outcome::MAX_CONTACT_MPS,
        rig::Rig,
        scenario::NodeConfigs,
        storm::{FaultKind, Takes},
    },
    physics::vessel::VesselCourse,
};
use alight_uav::autopilot::modes::Firmware;
use rayon::prelude::*;

use super::{
    BOTH,
    takeoff::{armed, on_deck},
};
use crate::at_sea;
const ABEAM: Station = Station {
    ahead_m: 0,
    right_m: 20,
    height_m: 15,
    for_min: 10,
};

#[derive(Clone, Copy, Debug)]
struct Cell {
    /// State in which the gap starts; [`State::Hold`] is on a station after a take-off.
    when: State,
    /// Delay after entry to the state, s.
    after_s: f64,
    gone: FaultKind,
    gap_s: f64,
    firmware: Firmware,
    /// Order given 2 s after the gap.
    order: Option<CommandKind>,
    seed: u64,
}

const RESUME_S: f64 = 5.0;
/// Time after an action by the autopilot alone during which contacts are excused, s.
const EXCUSED_S: f64 = 1.5;
/// Maximum time until an order has taken effect, s; long enough for the climb of a take-off.
const ACTS_S: f64 = 35.0;
/// Height of the feet above the deck that counts as airborne, m.
const AIR_M: f64 = 0.25;

impl Cell {
    fn takes_off(&self) -> bool {
        use State::{ClimbOut, Hold, SpinUp, StandDown};
        matches!(self.when, SpinUp | ClimbOut | StandDown | Hold)
    }
    fn rig(&self) -> Rig {
        let (mut scenario, nodes) = if self.takes_off() {
            on_deck(0.5, self.firmware)
        } else {
            let mut scenario = at_sea("0.5,5");
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
        } else {
            rig.world.command(CommandKind::Land);
        }
        rig
    }
    /// Flies to the start of the gap; returns false if it is not reached.
    fn reach(&self, rig: &mut Rig) -> bool {
        let due = |rig: &mut Rig, state: State, after_s: f64| rig.until(90.0, |r| r.is_due(state, after_s));
        let spins = |rig: &mut Rig| rig.until(90.0, |r| r.state(0) == State::SpinUp && armed(r, 0));
        match self.when {
            State::SpinUp => {
                spins(rig) && {
                    rig.run(self.after_s);
                    rig.state(0) == State::SpinUp
                }
            }
            State::StandDown => {
                spins(rig) && {
                    rig.world.command(CommandKind::Abort);
                    due(rig, State::StandDown, self.after_s)
                }
            }
            State::Hold => {
                due(rig, State::Hold, 1.0) && {
                    rig.world.command(CommandKind::Station(ABEAM));
                    rig.run(self.after_s + 1.0);
                    rig.mission(0).station.is_some()
                }
            }
            State::Landed => due(rig, State::Landed, 0.0),
            state => due(rig, state, self.after_s),
        }
    }
    /// Flies the case; returns the first broken rule.
    fn fly(&self) -> Option<String> {
        let mut rig = self.rig();
        if !self.reach(&mut rig) {
            return Some(format!("never reached the gap: {:?}", rig.visited(0)));
        }
        let began_s = rig.t_s();
        rig.begin(self.gone, 0.0);
        let mut over = false;
        let mut ordered = false;
        let mut watch = Watched::default();
        let over_s = began_s + self.gap_s;
        rig.each(self.gap_s + ACTS_S + 5.0, |rig| {
            let t_s = rig.t_s();
            if t_s >= over_s && !over {
                over = true;
                rig.end(self.gone, 0.0);
            }
            if t_s >= over_s + 2.0 && !ordered {
                ordered = true;
                if let Some(order) = self.order {
                    rig.world.command(order);
                }
            }
            watch.look(self, rig, t_s - over_s);
            watch.bad.is_some() || watch.rests(rig)
        });
        watch.bad.or_else(|| self.judge(&rig))
    }

    /// Rule broken at the end of the flight.
    fn judge(&self, rig: &Rig) -> Option<String> {
        let o = rig.world.observation();
        let state = rig.state(0);
        let m = rig.mission(0);
        let height_m = o.feet_height_m();
        let stands = !armed(rig, 0) && height_m.abs() < AIR_M && !o.in_water;
        let held = matches!(state, State::Hold | State::GaveUp);
        let low = armed(rig, 0) && height_m < 3.0 && o.horizontal_m < 4.0;
        let bad = if stands {
            return None;
        } else if self.order.is_some() && !held {
            "the order had no effect"
        } else if low && !matches!(state, State::Descent | State::Flare) {
            "stays low over the deck"
        } else if state == State::StandDown || state == State::SpinUp {
            "stands armed on the deck"
        } else {
            return None;
        };
        Some(format!(
            "{bad}: {state:?}, {height_m:.1} m, {}, waits: {}",
            m.entered, m.waiting
        ))
    }
}

#[derive(Default)]
struct Watched {
    bad: Option<String>,
    turned: bool,
    rested: u32,
}

impl Watched {
    /// `since_s` is the time since the end of the gap.
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
            Some(format!("hit the deck at {mps:.2} m/s"))
        } else if since_s > RESUME_S && o.motors_on && height_m > AIR_M && !in_offboard {
            Some(format!("follows no set-points {height_m:.1} m above the deck"))
        } else if !restarted && rig.mission(0).entered.code == ReasonCode::Restarted {
            Some("reports a restart that did not happen".to_owned())
        } else {
            None
        };
        if let Some(bad) = bad {
            let state = rig.state(0);
            let entered = rig.mission(0).entered;
            self.bad = Some(format!(
                "{bad}, {since_s:.2} s after the gap in {state:?}: {entered}"
            ));
        }
    }
    /// Whether the drone has been on the deck with motors off for 1 s.
    fn rests(&mut self, rig: &Rig) -> bool {
        let o = rig.world.observation();
        let rests = !armed(rig, 0) && !o.in_water && o.feet_height_m().abs() < AIR_M;
        self.rested = if rests { self.rested + 1 } else { 0 };
        self.rested > 100
    }
}

#[test]
fn gaps_that_ended_badly_once() {
    use FaultKind::{
        AutopilotSilent, ComputerFrozen, ComputerKilled, LinkFrozen, LinkKilled, MissionFrozen, PilotFrozen,
        PilotKilled,
    };
    use State::{ClimbOut, Descent, Flare, Hold, Landed, SpinUp, StandDown};
    let [px4, copter] = BOTH;
    let hold = Some(CommandKind::Hold);
    let abort = Some(CommandKind::Abort);
    let cells = [
        (ClimbOut, 0.5, PilotFrozen, 0.8, px4, hold, 80),
        (ClimbOut, 0.5, ComputerFrozen, 0.95, px4, None, 81),
        (SpinUp, 0.5, PilotKilled, 1.0, px4, None, 82),
        (SpinUp, 0.5, ComputerFrozen, 2.0, px4, None, 83),
        (SpinUp, 2.8, LinkKilled, 1.0, copter, None, 84),
        (StandDown, 0.05, LinkFrozen, 1.0, px4, None, 85),
        (Hold, 1.0, PilotFrozen, 0.8, px4, hold, 86),
        // Former defects: a hover whose thrust counted as less than hover thrust, and a stop due to a hover
        // thrust learned on the deck.
        (SpinUp, 0.5, AutopilotSilent, 0.8, px4, abort, 913),
        (SpinUp, 0.5, ComputerKilled, 0.5, px4, abort, 910),
        // While the autopilot holds by itself, the drone slides to the deck's edge.
        (Flare, 0.1, ComputerFrozen, 1.5, px4, abort, 924),
        (Landed, 0.5, ComputerFrozen, 1.5, px4, abort, 925),
        (Descent, 1.0, MissionFrozen, 0.5, px4, None, 917),
    ];
    let found = cells
        .into_par_iter()
        .filter_map(|(when, after_s, gone, gap_s, firmware, order, seed)| {
            let cell = Cell {
                when,
                after_s,
                gone,
                gap_s,
                firmware,
                order,
                seed,
            };
            Some(format!("{cell:?}: {}", cell.fly()?))
        });
    let found: Vec<String> = found.collect();
    assert!(found.is_empty(), "{found:#?}");
}

//! Landings that are aborted, held, or lose their planner at a random height, for the hulls and seas of
//! `study seas`, adrift or under way. Measures whether contacts follow, and their speed.

use alight_shared::msg::{CommandKind, Phase};

use crate::{
    harness::{
        observer::NoObserver,
        outcome::{ContactEvent, MAX_CONTACT_MPS},
        scenario::{NodeConfigs, Scenario, SetupError},
        world::World,
    },
    physics::vessel::VesselCourse,
};
use alight_shared::process::ProcessKind;

/// Maximum time to reach the height of the interruption, s.
const LIMIT_S: f64 = 150.0;
/// Flight time after the interruption, s; long enough for a climb to the tracking height.
const REST_S: f64 = 20.0;
/// Height of the feet below which the drone must stay above the deck, m.
const CLEAR_M: f64 = 3.0;
/// Maximum distance from the deck's centre below that height, m.
const STRAYED_M: f64 = 3.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    Abort,
    Hold,
    /// The planner's process is killed permanently.
    PlanLost,
}

/// Sets the vessel adrift, or straight ahead at this speed (m/s).
pub fn drive(scenario: &mut Scenario, speed_mps: f64) {
    let vessel = &mut scenario.vessel;
    vessel.course = if speed_mps > 0.0 {
        VesselCourse::Straight
    } else {
        VesselCourse::Drift
    };
    vessel.speed_mps = speed_mps;
    vessel.power_for(speed_mps);
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interrupted {
    /// Maximum impact speed along the deck's normal after the interruption, m/s; 0 without an impact.
    pub hardest_mps: f64,
    /// A part other than a foot touched, or a foot touched faster than a landing permits.
    pub unsafe_contact: bool,
    /// The drone is in the water with motors on.
    pub water: bool,
    /// Maximum distance from the deck's centre before the drone was clear, m.
    pub strayed_m: f64,
    pub collided: bool,
}

impl Interrupted {
    pub fn strayed(&self) -> bool {
        self.strayed_m > STRAYED_M
    }
    pub fn safe(&self) -> bool {
        !self.unsafe_contact && !self.water && !self.collided && !self.strayed()
    }
    fn touch(&mut self, c: &ContactEvent) {
        self.hardest_mps = self.hardest_mps.max(c.normal_mps);
        self.unsafe_contact |= !c.foot || !c.on_deck || c.normal_mps > MAX_CONTACT_MPS;
    }
}

/// Flies a landing until the lowest foot is `height_m` above the deck, interrupts it, and continues the
/// flight. None if that height is never reached.
pub fn fly(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    interruption: Interruption,
    height_m: f64,
) -> Result<Option<Interrupted>, SetupError> {
    let mut world = World::new(scenario, nodes, seed)?;
    world.warm_up(&mut NoObserver);
    world.command(CommandKind::Land);
    let mut began = false;
    let mut near = true;
    let mut end_s = LIMIT_S;
    let mut report = Interrupted::default();
    loop {
        world.tick(&mut NoObserver);
        let t = world.physics().time_since_start().secs();
        let landing = world.mission_state().state.phase() == Phase::Landing;
        let o = world.observation();
        let lowest = o.feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min);
        if began {
            for c in o.contacts {
                report.touch(c);
            }
            report.water |= o.in_water && o.motors_on;
            report.collided |= o.keep_out_gap_m.is_some_and(|gap| gap <= 0.0);
            near &= o.motors_on && lowest < CLEAR_M;
            if near {
                report.strayed_m = report.strayed_m.max(o.horizontal_m);
            }
        } else if !o.motors_on {
            return Ok(None);
        } else if landing && lowest < height_m {
            began = true;
            end_s = t + REST_S;
            match interruption {
                Interruption::Abort => world.command(CommandKind::Abort),
                Interruption::Hold => world.command(CommandKind::Hold),
                Interruption::PlanLost => world.kill(0, ProcessKind::Planner),
            }
        }
        if t > end_s || report.water {
            break;
        }
    }
    Ok(began.then_some(report))
}

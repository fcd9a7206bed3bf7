//! Landings that end on the way down: aborted, held or without a planner from a random height on, over the hulls and
//! seas of `study seas` with a vessel that drifts or drives. What the drone touches afterwards, and how hard.

use alight_shared::msg::{CommandKind, Phase};

use crate::harness::outcome::{ContactEvent, MAX_CONTACT_MPS};
use crate::harness::scenario::{NodeConfigs, Scenario, SetupError};
use crate::harness::tap::NoTap;
use crate::harness::world::World;
use crate::physics::vessel::VesselCourse;
use alight_shared::process::ProcessKind;

/// Time in which the drone comes so low, s.
const LIMIT_S: f64 = 150.0;
/// Flown on afterwards, s: longer than a climb to the tracking height.
const REST_S: f64 = 20.0;
/// Until its feet are so high above the deck the drone has to stay above it, m ...
const CLEAR_M: f64 = 3.0;
/// ... no further from above its centre than this, m.
const STRAYED_M: f64 = 3.0;

/// Interruption of a landing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    /// An operator aborts it.
    Abort,
    /// An operator commands a hold.
    Hold,
    /// The planner's process dies for good.
    PlanLost,
}

/// A vessel that drifts, or drives straight on at this speed (m/s).
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

/// Result of an interrupted landing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interrupted {
    /// The hardest impact afterwards along the deck's normal, m/s; 0 without one.
    pub hardest_mps: f64,
    /// Something else than feet on the deck met it, or at more than the limit of a successful landing.
    pub unsafe_contact: bool,
    /// In the water, motors on.
    pub water: bool,
    /// Distance from above the deck's centre that it reached before it was clear of the deck, m.
    pub strayed_m: f64,
    /// It entered a keep-out volume.
    pub collided: bool,
}

impl Interrupted {
    /// It left the place above the deck before it was clear of it.
    pub fn strayed(&self) -> bool {
        self.strayed_m > STRAYED_M
    }
    /// Nothing that must not happen has happened.
    pub fn safe(&self) -> bool {
        !self.unsafe_contact && !self.water && !self.collided && !self.strayed()
    }
    fn touch(&mut self, c: &ContactEvent) {
        self.hardest_mps = self.hardest_mps.max(c.normal_mps);
        self.unsafe_contact |= !c.foot || !c.on_deck || c.normal_mps > MAX_CONTACT_MPS;
    }
}

/// Lands until the lowest foot is `height_m` above the deck, and flies on after the interruption. None when the drone
/// never came so low.
pub fn fly(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    interruption: Interruption,
    height_m: f64,
) -> Result<Option<Interrupted>, SetupError> {
    let mut world = World::new(scenario, nodes, seed)?;
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let (mut began, mut near) = (false, true);
    let mut end_s = LIMIT_S;
    let mut report = Interrupted::default();
    loop {
        world.tick(&mut NoTap);
        let t = world.physics().time_since_start().secs();
        let landing = world.mission_state().state.phase() == Phase::Landing;
        let o = world.observation();
        let lowest = o.feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min);
        if began {
            o.contacts.iter().for_each(|c| report.touch(c));
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

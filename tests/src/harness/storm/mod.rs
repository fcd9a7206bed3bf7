//! A storm: one landing of the whole system with several faults, drawn from a seed or written in a file, and what must hold
//! in every tick of it ([`watch`]). A fault is a state of the mission and a delay, a kind, a size and how long it lasts, so
//! that a list is a scenario, and the shortest list that still breaks a rule ([`shrink`]) is a test.
//!
//! After Claessen and Hughes 2000 (shrinking) and Groce et al. 2012 (swarm testing: each seed leaves kinds out).

mod draw;
mod flight;
mod kinds;
mod moment;
mod shrink;
pub mod watch;

use alight_uav::autopilot::modes::Firmware;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::scenario::{NodeConfigs, Scenario};
use crate::physics::sea::SeaConfig;
use crate::physics::vessel::Course;
use crate::studies::aborts::drive;

pub use super::mutant::Mutant;
pub use draw::{Pair, pairs};
pub use flight::{Flown, fly, fly_mutant};
pub use kinds::{Effect, Kind, Spec, Takes};
pub use moment::Moment;
pub use shrink::shrink;
pub use watch::Ending;

/// Faults of a list, at most.
pub const MAX_FAULTS: usize = 16;
/// A fault begins at most so long after its state was entered, and lasts at most so long, s.
const MAX_S: f64 = 60.0;

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// What.
    pub kind: Kind,
    /// It begins at this moment ...
    #[serde(rename = "state")]
    pub moment: Moment,
    /// ... and so much later, s.
    #[serde(default)]
    pub after_s: f64,
    /// Its size, in the unit of [`Spec::of`].
    #[serde(default)]
    pub size: f64,
    /// How long it lasts, s; of what happens at once, nothing.
    #[serde(default)]
    pub lasts_s: f64,
}

/// A landing and its faults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Storm {
    /// Seed of the world.
    pub seed: u64,
    /// Whose character the autopilot has.
    pub autopilot: Firmware,
    /// Amplitude of the sea's three waves, m, and period of the middle one, s.
    pub sea: [f64; 2],
    /// What the vessel does.
    pub course: Course,
    /// Its speed, m/s.
    pub speed_mps: f64,
    /// Mean wind, m/s.
    pub wind_mps: f64,
    /// A landing needs the deck's reservation.
    pub reserved: bool,
    /// Drones that are ordered to land, 1 or 2; faults meet the first.
    #[serde(default = "one")]
    pub drones: u8,
    /// A mast forward of the deck and an A-frame abeam of it, known to the vessel's surroundings.
    #[serde(default)]
    pub mast: bool,
    /// The faults.
    #[serde(default, rename = "fault")]
    pub faults: Vec<Fault>,
}

/// One drone.
const fn one() -> u8 {
    1
}

/// A mast forward of the deck and an A-frame abeam of it: opposite corners in the deck's frame, m.
const MAST_M: [[[f64; 3]; 2]; 2] = [
    [[2.2, -0.2, -9.3], [2.6, 0.2, 0.0]],
    [[-1.2, 1.6, -4.8], [1.2, 2.0, -0.5]],
];

/// Why a list cannot be flown.
#[derive(Debug, Error, PartialEq)]
pub enum StormError {
    /// It is no TOML of a storm.
    #[error("{0}")]
    Toml(String),
    /// A figure is out of its range.
    #[error("{0}")]
    Range(String),
}

impl Storm {
    /// Reads a list; a figure out of its range is an error that names it.
    pub fn read(text: &str) -> Result<Storm, StormError> {
        let storm: Storm = toml::from_str(text).map_err(|e| StormError::Toml(e.to_string()))?;
        storm.check()?;
        Ok(storm)
    }
    /// As a file that is read again.
    pub fn text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), StormError> {
        let within = |what: String, value: f64, [low, high]: [f64; 2]| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            let wanted = format!("{what} = {value}: {low} to {high} is possible");
            Err(StormError::Range(wanted))
        };
        within("sea, amplitude".into(), self.sea[0], [0.0, 1.0])?;
        within("sea, period".into(), self.sea[1], [3.0, 12.0])?;
        within("speed_mps".into(), self.speed_mps, [0.0, 10.0])?;
        within("wind_mps".into(), self.wind_mps, [0.0, 15.0])?;
        within("drones".into(), f64::from(self.drones), [1.0, 2.0])?;
        within(
            "faults in the list".into(),
            self.faults.len() as f64,
            [0.0, MAX_FAULTS as f64],
        )?;
        for fault in &self.faults {
            let (name, spec) = (fault.kind.name(), fault.kind.spec());
            let largest = spec.size[0].abs().max(spec.size[1].abs());
            let of = if spec.of.is_empty() { "none" } else { spec.of };
            within(format!("{name}, size ({of})"), fault.size, [-largest, largest])?;
            within(format!("{name}, after_s"), fault.after_s, [0.0, MAX_S])?;
            within(format!("{name}, lasts_s"), fault.lasts_s, [0.0, MAX_S])?;
        }
        Ok(())
    }

    /// The scene, and the nodes' configurations.
    pub fn scene(&self) -> (Scenario, NodeConfigs) {
        let [amplitude_m, period_s] = self.sea;
        let mut scenario = Scenario {
            sea: SeaConfig::paper(amplitude_m, period_s),
            ..Scenario::default()
        };
        if self.course.is_under_way() {
            drive(&mut scenario, self.speed_mps);
        }
        scenario.vessel.course = self.course;
        scenario.drone.autopilot.firmware = self.autopilot;
        scenario.drone.wind.mean_mps = self.wind_mps;
        let mut nodes = NodeConfigs::default();
        nodes.drone.mission.reservation_required = self.reserved;
        scenario.drones = self.drones.into();
        if self.mast {
            scenario.keep_out_m = MAST_M.to_vec();
            nodes.vessel.surroundings.keep_out_m = MAST_M.to_vec();
        }
        (scenario, nodes)
    }
}

#[cfg(test)]
mod tests {
    use alight_shared::msg::State;

    use super::*;

    #[test]
    fn storm_as_text_and_back() {
        for seed in 0..50 {
            let storm = Storm::drawn(seed, 5);
            assert_eq!(storm.faults.len(), 5);
            assert_eq!(Storm::read(&storm.text()), Ok(storm));
        }
        let aimed = Storm::drawn(3, 4).aimed((Kind::RangeZero, State::Flare));
        assert_eq!(aimed.faults[..3], Storm::drawn(3, 4).faults[..3]);
        assert_eq!(
            (aimed.faults[3].kind, aimed.faults[3].moment),
            (Kind::RangeZero, Moment::In(State::Flare))
        );
        assert_eq!(aimed.check(), Ok(()));
        let wrong = Storm::drawn(1, 2).text().replace("wind_mps = ", "wind_mps = 9");
        assert!(matches!(Storm::read(&wrong), Err(StormError::Range(_))));
        assert!(matches!(Storm::read("seed = 1"), Err(StormError::Toml(_))));
    }
}

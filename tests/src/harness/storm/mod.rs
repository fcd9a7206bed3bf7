//! A storm: one flight of the whole system with several faults, drawn from a seed or read from a file, and rules that
//! must hold in every tick ([`watch`]). Each fault has a kind, a size, a duration, and a start, given as a delay after
//! the mission enters a state. The shortest list of faults that still breaks a rule ([`shrink`]) becomes a test.
//!
//! Source: Claessen and Hughes 2000 (shrinking) and Groce et al. 2012 (swarm testing: each seed omits kinds).

mod draw;
mod effects;
pub(super) mod fault;
mod flight;
mod kinds;
mod people;
mod plan;
mod schedule;
mod shrink;
pub mod watch;

use alight_shared::{
    autopilot_parameters::Version,
    config::{self, ConfigError, Keys},
};
use alight_uav::autopilot::modes::Firmware;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::scenario::{NodeConfigs, Scenario};
use crate::{
    physics::{sea::SeaConfig, vessel::VesselCourse},
    sensors::moving_base::MovingBaseConfig,
    studies::aborts::drive,
};

pub use super::mutant::Mutant;
pub use draw::{Pair, pairs};
pub use fault::{Fault, Moment};
pub use flight::{Flown, Warned, fly, fly_observed};
pub use kinds::{FaultKind, Spec, Takes};
pub use plan::FlightKind;
pub use schedule::{FaultTimer, FaultTurn, Schedule};
pub use shrink::shrink;
pub use watch::StormEnding;

pub const MAX_FAULTS: usize = 16;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Storm {
    pub seed: u64,
    #[serde(default)]
    pub flight: FlightKind,
    pub autopilot: Firmware,
    /// Amplitude of the sea's three waves, m, and period of the middle wave, s.
    pub sea: [f64; 2],
    pub course: VesselCourse,
    pub speed_mps: f64,
    pub wind_mps: f64,
    /// Landings need a reservation of the deck.
    pub reserved: bool,
    /// Number of drones ordered to land: 1, or 2 in a landing. Faults affect the first.
    #[serde(default = "one")]
    pub drones: u8,
    /// Obstacles that the vessel publishes: a mast forward of the deck, an A-frame abeam.
    #[serde(default)]
    pub mast: bool,
    #[serde(default)]
    pub moving_base: bool,
    /// Parameters that only cause a warning are at the maker's default.
    #[serde(default)]
    pub stock: bool,
    /// Version of the firmware, major and minor number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<Version>,
    #[serde(default, rename = "fault")]
    pub faults: Vec<Fault>,
}

/// Names in lists of older versions, with the present equivalent.
const FORMER: [(&str, &str); 1] = [(
    "flight = \"helm\"",
    "flights whose computer steered the vessel were removed: write flight = \"landing\"",
)];

const fn one() -> u8 {
    1
}

/// Mast forward of the deck, and A-frame abeam: opposite corners in the deck's frame, m.
const MAST_M: [[[f64; 3]; 2]; 2] = [
    [[2.2, -0.2, -9.3], [2.6, 0.2, 0.0]],
    [[-1.2, 1.6, -4.8], [1.2, 2.0, -0.5]],
];

#[derive(Debug, Error, PartialEq)]
pub enum StormError {
    #[error("{0}")]
    Toml(String),
    #[error("{0}")]
    Range(String),
}

impl Storm {
    /// Reads TOML; an error names the value that is out of range.
    pub fn read(text: &str) -> Result<Storm, StormError> {
        if let Some((former, advice)) = FORMER.iter().find(|(former, _)| text.contains(former)) {
            return Err(StormError::Toml(format!(
                "`{former}` is of an older version; {advice}"
            )));
        }
        let storm: Storm = config::read(text, "the list").map_err(|e| StormError::Toml(e.to_string()))?;
        storm.check().map_err(|e| StormError::Range(e.to_string()))?;
        Ok(storm)
    }
    /// Version of the firmware: the list's, otherwise a usual one.
    pub fn version(&self) -> Version {
        self.version.unwrap_or(self.autopilot.maker().assumed())
    }
    pub fn text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), ConfigError> {
        let at = Keys::ROOT;
        at.range("sea[0]", self.sea[0], 0.0, 1.0)?;
        at.range("sea[1]", self.sea[1], 3.0, 12.0)?;
        at.range("speed_mps", self.speed_mps, 0.0, 10.0)?;
        at.range("wind_mps", self.wind_mps, 0.0, 15.0)?;
        let most_drones = self.flight.most_drones().into();
        at.range("drones", self.drones.into(), 1.0, most_drones)?;
        let of_faults = at.table("fault");
        of_faults.range("count", self.faults.len() as f64, 0.0, MAX_FAULTS as f64)?;
        Fault::check_all(&self.faults, &of_faults, fault::MAX_S)
    }

    /// Scenario of a landing with these faults, and the nodes' configurations; [`FlightKind`] adapts both to
    /// other flights.
    pub fn scene(&self) -> (Scenario, NodeConfigs) {
        let [amplitude_m, period_s] = self.sea;
        let mut scenario = Scenario {
            sea: SeaConfig::paper(amplitude_m, period_s),
            faults: self.faults.clone(),
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
        scenario.sensors.moving_base = self.moving_base.then(MovingBaseConfig::default);
        (scenario, nodes)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use alight_shared::msg::State;

    use super::*;

    #[test]
    fn storm_as_text_and_back() {
        for seed in 0..50 {
            let storm = Storm::drawn(seed, 5);
            assert_eq!(storm.faults.len(), 5);
            assert_eq!(Storm::read(&storm.text()), Ok(storm));
        }
        let aimed = Storm::drawn(3, 4).aimed((FaultKind::RangeZero, State::Flare));
        assert_eq!(aimed.faults[..3], Storm::drawn(3, 4).faults[..3]);
        assert_eq!(
            (aimed.faults[3].kind, aimed.faults[3].moment),
            (FaultKind::RangeZero, Moment::In(State::Flare))
        );
        assert!(aimed.check().is_ok());
        let wrong = Storm::drawn(1, 2).text().replace("wind_mps = ", "wind_mps = 9");
        assert!(matches!(Storm::read(&wrong), Err(StormError::Range(_))));
        assert!(matches!(Storm::read("seed = 1"), Err(StormError::Toml(_))));
        let former = aimed.text().replace("range-zero", "neighbour-seen");
        let kind = |storm: Storm| storm.faults[3].kind;
        assert_eq!(Storm::read(&former).map(kind), Ok(FaultKind::NeighbourDetected));
        let helm = former.replace("flight = \"", "flight = \"helm\" # ");
        let error = Storm::read(&helm).unwrap_err().to_string();
        assert!(error.contains("helm") && error.contains("landing"), "{error}");
    }

    #[test]
    fn flight_and_entry_as_text_and_back() {
        let mut storm = Storm {
            flight: FlightKind::TagAlone,
            drones: 1,
            ..Storm::drawn(1, 1)
        };
        storm.faults[0].entry = 3;
        let text = storm.text();
        assert!(
            text.contains("flight = \"tag-alone\"") && text.contains("entry = 3"),
            "{text}"
        );
        assert_eq!(Storm::read(&text), Ok(storm.clone()));
        for (key, wrong) in [
            ("entry = 3", "entry = 0"),
            ("entry = 3", "entry = 10"),
            ("drones = 1", "drones = 2"),
        ] {
            let read = Storm::read(&text.replace(key, wrong));
            assert!(matches!(read, Err(StormError::Range(_))), "{wrong}: {read:?}");
        }
    }

    #[test]
    fn list_without_flight_and_entry() {
        let text = include_str!("../../../storm/live-abort.toml");
        assert!(!text.contains("flight") && !text.contains("entry"));
        let storm = Storm::read(text).unwrap();
        assert_eq!(storm.flight, FlightKind::Landing);
        assert!(!storm.faults.is_empty() && storm.faults.iter().all(|f| f.entry == 1));
    }

    #[test]
    fn moving_base_without_a_shift_of_other_draws() {
        let storms: Vec<Storm> = (1..=200).map(|seed| Storm::drawn(seed, 5)).collect();
        let of_base = |s: &Storm| s.faults.iter().filter(|f| f.kind.needs_moving_base()).count();
        assert!(storms.iter().all(|s| of_base(s) == usize::from(s.moving_base)));
        let with = storms.iter().filter(|s| s.moving_base);
        assert!((15..=45).contains(&with.clone().count()));
        assert!(
            with.clone()
                .all(|s| !s.flight.is_silent() && s.faults[0].kind.needs_moving_base())
        );
        let aimed = Storm::drawn(3, 4).aimed((FaultKind::FalseFix, State::Descent));
        assert!(aimed.moving_base && aimed.check().is_ok());
        // This list was written before the field existed.
        let former = include_str!("../../../storm/live-abort.toml");
        assert!(!Storm::read(former).unwrap().moving_base);
    }

    #[test]
    fn device_fault_without_a_shift_of_other_draws() {
        let storms: Vec<Storm> = (1..=200).map(|seed| Storm::drawn(seed, 5)).collect();
        let of_device = |s: &&Storm| s.faults[1].kind.is_of_device();
        assert!((45..=90).contains(&storms.iter().filter(of_device).count()));
        let others = storms
            .iter()
            .flat_map(|s| [&s.faults[..1], &s.faults[2..]].concat());
        assert_eq!(others.filter(|f| f.kind.is_of_device()).count(), 0);
    }

    #[test]
    fn flights_and_entries_that_are_drawn() {
        let storms: Vec<Storm> = (1..=60).map(|seed| Storm::drawn(seed, 5)).collect();
        let flights: BTreeSet<FlightKind> = storms.iter().map(|s| s.flight).collect();
        assert_eq!(flights, BTreeSet::from(FlightKind::ALL));
        let landings = storms.iter().filter(|s| s.flight == FlightKind::Landing);
        assert!((15..=30).contains(&landings.count()));
        for storm in &storms {
            let states: Vec<Moment> = storm.flight.states().map(Moment::In).collect();
            assert!(
                storm.faults.iter().all(|f| states.contains(&f.moment)),
                "{storm:?}"
            );
        }
        let again = storms.iter().flat_map(|s| &s.faults).filter(|f| f.entry > 1);
        assert!((20..=120).contains(&again.count()), "of 300");
    }
}

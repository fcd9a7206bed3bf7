//! Configuration keys that belong to the method: studies set them with a lab file (`--tuning`); a computer's file
//! must not set them.

use std::{collections::BTreeMap, path::Path};

use alight_shared::config::{self, Check, ConfigError, Keys};
use serde::{Serialize, de::DeserializeOwned};
use toml::{Table, Value, de::DeTable};

use crate::config::{DroneComputerConfig, VesselComputerConfig};

/// Clocks of simulated computers; real computers use the system's.
const BENCH: &str = "clock";
/// Tables and keys of the method in the files of both computers.
const METHOD: &[&str] = &[
    BENCH,
    "autopilot.battery.for_s",
    "autopilot.battery.tries",
    "autopilot.disarm",
    "autopilot.heartbeat_hz",
    "autopilot.heartbeat_loss_s",
    "autopilot.hover_thrust_s",
    "autopilot.odometry_hz",
    "autopilot.odometry_loss_s",
    "autopilot.set_point_hz",
    "autopilot.timesync_hz",
    "autopilot.timesync_limit_s",
    "bridge.clock",
    "bridge.future_margin_s",
    "bridge.link_rate_hz",
    "bridge.loss_window_s",
    "deck.startup_hold_s",
    "drone.camera.tag",
    "drone.camera.uvdar.gate_px",
    "drone.camera.uvdar.max_misfit",
    "drone.camera.uvdar.max_pixels",
    "drone.camera.uvdar.spot_sd_px",
    "drone.camera.uvdar.wrong_bits",
    "drone.mission.battery_lasts_s",
    "drone.mission.commit_clearance_m",
    "drone.mission.decision_clearance_m",
    "drone.mission.descent_timeout_s",
    "drone.mission.descent_vision_s",
    "drone.mission.flare_clearance_m",
    "drone.mission.flare_mps",
    "drone.mission.flare_timeout_s",
    "drone.mission.missed_m",
    "drone.odometry",
    "drone.pilot",
    "drone.planner",
    "drone.predictor",
    "vessel.broadcast",
    "vessel.gnss.height_bias_time_s",
    "vessel.heading.bias_time_s",
    "vessel.imu.bias_time_s",
    "vessel.imu.timeout_s",
    "vessel.model.bank_damping",
    "vessel.model.bank_omega_radps",
    "vessel.model.bank_slope_sd",
    "vessel.model.disturbance_sd_mps2_m_rad_radps2",
    "vessel.model.disturbance_time_s",
    "vessel.model.eta_walk_m_rad",
    "vessel.model.slow_sd_mps_m_rad_radps",
    "vessel.model.slow_walk_mps_m_rad_radps",
];
/// Keys within these tables that an installer measures or an operator chooses.
const OF_FLIGHT: &[&str] = &[
    "autopilot.disarm.on_deck",
    "autopilot.disarm.own_landing",
    "drone.camera.tag.decimate",
    "drone.camera.tag.id",
    "drone.camera.tag.min_margin",
    "drone.camera.tag.place_sd_m",
    "drone.pilot.output",
    "drone.planner.kind",
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyOwner {
    /// Set by an installer or operator, in the computer's file.
    Flight,
    /// Set by a study, in a lab file.
    Method,
    /// Set by the simulated world.
    Bench,
}

impl KeyOwner {
    pub fn of(key: &str) -> KeyOwner {
        let is_within = |name: &&str| {
            let rest = key.strip_prefix(*name);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        if is_within(&BENCH) {
            KeyOwner::Bench
        } else if METHOD.iter().any(is_within) && !OF_FLIGHT.iter().any(is_within) {
            KeyOwner::Method
        } else {
            KeyOwner::Flight
        }
    }
    fn part(self, table: &Table, at: &str) -> Table {
        let own = table.iter().filter_map(|(name, value)| {
            let key = dotted(at, name);
            let kept = match value.as_table() {
                Some(inner) => {
                    let inner = self.part(inner, &key);
                    (!inner.is_empty()).then_some(Value::Table(inner))
                }
                None => (KeyOwner::of(&key) == self).then(|| value.clone()),
            };
            Some((name.clone(), kept?))
        });
        own.collect()
    }
}

fn dotted(at: &str, key: &str) -> String {
    [at, key].join(if at.is_empty() { "" } else { "." })
}

/// Keys of a text with their positions, in order; empty if the text is not TOML, because the parser reports that
/// error.
fn keys(text: &str) -> Vec<(usize, String)> {
    fn collect(table: &DeTable<'_>, at: &str, all: &mut Vec<(usize, String)>) {
        for (name, value) in table {
            let key = dotted(at, name.get_ref());
            match value.get_ref().as_table() {
                Some(inner) => collect(inner, &key, all),
                None => all.push((name.span().start, key)),
            }
        }
    }
    let mut all = Vec::new();
    if let Ok(table) = DeTable::parse(text) {
        collect(table.get_ref(), "", &mut all);
    }
    all.sort();
    all
}

/// Rejects a text with keys for which `fault` returns a reason; the error names the line of each.
fn reject(text: &str, origin: &str, fault: impl Fn(&str) -> Option<&'static str>) -> Result<(), ConfigError> {
    let line = |start: usize| {
        text.get(..start)
            .map_or(1, |before| before.matches('\n').count() + 1)
    };
    let faults = keys(text)
        .into_iter()
        .filter_map(|(start, key)| Some(format!("line {}: {key} {}", line(start), fault(&key)?)));
    let faults: Vec<String> = faults.collect();
    if faults.is_empty() {
        return Ok(());
    }
    Err(ConfigError::Parse {
        origin: origin.into(),
        message: faults.join("\n"),
    })
}

/// Rejects a computer's file that sets keys of the method; the error names each key.
pub fn check_flight(text: &str, origin: &str) -> Result<(), ConfigError> {
    reject(text, origin, |key| match KeyOwner::of(key) {
        KeyOwner::Flight => None,
        KeyOwner::Method => Some(
            "belongs to the method and is not set in a flight: remove it; studies set it with --tuning FILE",
        ),
        KeyOwner::Bench => Some(
            "belongs to the simulated world and is not set in a flight: remove it; the clock is the system's",
        ),
    })
}

pub fn parse<T: DeserializeOwned + Check>(text: &str, origin: &str) -> Result<T, ConfigError> {
    check_flight(text, origin)?;
    config::parse(text, origin)
}

pub fn load<T: DeserializeOwned + Check>(path: &Path) -> Result<T, ConfigError> {
    parse(&read(path)?, &path.display().to_string())
}

fn read(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
        path: path.into(),
        source,
    })
}

pub fn lay(over: &Table, base: &mut Table) {
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay(above, below),
            (Some(_) | None, _) => {
                base.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Splits a configuration into two files: the keys that a computer's file may set, and the keys of the method that
/// differ from their defaults.
pub fn divided<T: Serialize + Default>(config: &T) -> Result<[Table; 2], toml::ser::Error> {
    let [all, default] = [Table::try_from(config)?, Table::try_from(T::default())?];
    let [tuned, default] = [all.clone(), default].map(|t| KeyOwner::Method.part(&t, ""));
    Ok([KeyOwner::Flight.part(&all, ""), unlike(&tuned, &default)])
}

fn unlike(table: &Table, other: &Table) -> Table {
    let differing = table.iter().filter_map(|(key, value)| {
        let there = other.get(key);
        let kept = match (value.as_table(), there.and_then(Value::as_table)) {
            (Some(inner), Some(there)) => {
                let inner = unlike(inner, there);
                (!inner.is_empty()).then_some(Value::Table(inner))
            }
            (_, _) => (there != Some(value)).then(|| value.clone()),
        };
        Some((key.clone(), kept?))
    });
    differing.collect()
}

/// Lab file: keys of the method for both computers.
#[derive(Clone, Debug, Default)]
pub struct Tuning {
    table: Table,
    origin: String,
}

impl Tuning {
    pub fn load(path: &Path) -> Result<Tuning, ConfigError> {
        Tuning::parse(&read(path)?, &path.display().to_string())
    }
    fn parse(text: &str, origin: &str) -> Result<Tuning, ConfigError> {
        let table = config::read(text, origin)?;
        let mut known = BTreeMap::new();
        VesselComputerConfig::describe(&Keys::ROOT, &mut known);
        DroneComputerConfig::describe(&Keys::ROOT, &mut known);
        reject(text, origin, |key| {
            let is_known = known.contains_key(key);
            match KeyOwner::of(key) {
                KeyOwner::Method if is_known => None,
                KeyOwner::Flight if is_known => {
                    Some("does not belong to the method: set it with --vessel-config or --drone-config")
                }
                KeyOwner::Bench => Some("belongs to the simulated world: set its clocks in --scenario"),
                KeyOwner::Flight | KeyOwner::Method => Some(
                    "is not a key: `alight config vessel --tuning` and `alight config drone --tuning` print them",
                ),
            }
        })?;
        Ok(Tuning {
            table,
            origin: origin.into(),
        })
    }
    /// Applies the computer's part of the lab file to its configuration, and checks the result.
    pub fn over<T: Serialize + DeserializeOwned + Check>(&self, config: T) -> Result<T, ConfigError> {
        let fault = |message: String| ConfigError::Parse {
            origin: self.origin.clone(),
            message,
        };
        let mut known = BTreeMap::new();
        T::describe(&Keys::ROOT, &mut known);
        let own: Table = self
            .table
            .iter()
            .filter(|(name, _)| known.contains_key(*name))
            .map(|(name, value)| (name.clone(), value.clone()))
            .collect();
        if own.is_empty() {
            return Ok(config);
        }
        let mut table = Table::try_from(&config).map_err(|e| fault(e.to_string()))?;
        lay(&own, &mut table);
        let text = toml::to_string(&table).map_err(|e| fault(e.to_string()))?;
        config::parse(&text, &self.origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(owner: KeyOwner, text: &str) -> Vec<String> {
        let all = keys(text).into_iter().map(|(_, key)| key);
        all.filter(|key| KeyOwner::of(key) == owner).collect()
    }

    #[test]
    fn file_with_every_key_of_a_former_version() {
        let text = config::commented(&DroneComputerConfig::default()).unwrap();
        let e = parse::<DroneComputerConfig>(&text, "drone.toml")
            .unwrap_err()
            .to_string();
        let rejected = [KeyOwner::Method, KeyOwner::Bench].map(|owner| of(owner, &text));
        for key in rejected.iter().flatten() {
            assert!(e.contains(&format!(": {key} belongs to the ")), "{key}: {e}");
        }
        assert_eq!(e.lines().count(), rejected.concat().len());

        let [flight, tuned] = divided(&DroneComputerConfig::default()).unwrap();
        assert!(tuned.is_empty(), "{tuned}");
        let read: DroneComputerConfig = parse(&flight.to_string(), "drone.toml").unwrap();
        assert_eq!(read, DroneComputerConfig::default());
    }

    #[test]
    fn method_key_in_a_file_of_a_flight() {
        let text =
            "[drone.planner]\nkind = \"alight\"\n\n[drone.planner.rendezvous.touchdown_time]\nwindow_s = 0\n";
        let e = parse::<DroneComputerConfig>(text, "drone.toml")
            .unwrap_err()
            .to_string();
        let expected = "parsing configuration drone.toml: line 5: \
                        drone.planner.rendezvous.touchdown_time.window_s belongs to the method and is not set in a \
                        flight: remove it; studies set it with --tuning FILE";
        assert_eq!(e, expected);
        let inline =
            "drone.pilot = { output = \"attitude\", lag = { design_s = 0.1 } }\nclock.offset_s = 1.0\n";
        let e = parse::<DroneComputerConfig>(inline, "drone.toml")
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("line 1: drone.pilot.lag.design_s belongs to the method"),
            "{e}"
        );
        assert!(
            e.contains("line 2: clock.offset_s belongs to the simulated world"),
            "{e}"
        );
        let e = parse::<DroneComputerConfig>("[drone", "drone.toml")
            .unwrap_err()
            .to_string();
        assert!(e.contains("line 1"), "{e}");
    }

    #[test]
    fn tuning_of_both_computers() {
        let text = "[drone.planner]\npress_m = 0.2\n[vessel.broadcast]\nwave_hz = 4.0\n";
        let tuning = Tuning::parse(text, "tuning.toml").unwrap();
        let drone = tuning.over(DroneComputerConfig::default()).unwrap();
        assert_eq!(drone.drone.planner.press_m, 0.2);
        let vessel = tuning.over(VesselComputerConfig::default()).unwrap();
        assert_eq!(vessel.vessel.broadcast.wave_hz, 4.0);
        let [flight, tuned] = divided(&drone).unwrap();
        assert!(tuned.to_string().ends_with("press_m = 0.2\n") && !flight.to_string().contains("press_m"));
        let again = Tuning::parse(&tuned.to_string(), "again").unwrap();
        let plain: DroneComputerConfig = parse(&flight.to_string(), "flight").unwrap();
        assert_eq!(again.over(plain).unwrap(), drone);
    }

    #[test]
    fn tuning_rejected_key_by_key() {
        let text = "[drone.planner]\nkind = \"alight\"\npres_m = 0.2\n[drone.airframe]\nmass_kg = 4.0\n[clock]\noffset_s = 1\n";
        let e = Tuning::parse(text, "tuning.toml").unwrap_err().to_string();
        for line in [
            "line 2: drone.planner.kind does not belong to the method",
            "line 3: drone.planner.pres_m is not a key",
            "line 5: drone.airframe.mass_kg does not belong to the method",
            "line 7: clock.offset_s belongs to the simulated world",
        ] {
            assert!(e.contains(line), "{line}: {e}");
        }
        let tuning = Tuning::parse("[drone.planner]\npress_m = 1e9\n", "tuning.toml").unwrap();
        let e = tuning
            .over(DroneComputerConfig::default())
            .unwrap_err()
            .to_string();
        assert!(e.contains("drone.planner.press_m"), "{e}");
    }

    #[test]
    fn owners_name_keys_that_exist() {
        let mut known = BTreeMap::new();
        VesselComputerConfig::describe(&Keys::ROOT, &mut known);
        DroneComputerConfig::describe(&Keys::ROOT, &mut known);
        for key in METHOD.iter().chain(OF_FLIGHT) {
            assert!(known.contains_key(*key), "{key}");
        }
    }
}

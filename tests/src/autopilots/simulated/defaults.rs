//! Makers' defaults of the parameters that the simulated autopilots have, and the parameters of an installation.

use std::collections::BTreeMap;

use alight_shared::autopilot_parameters::{Maker, Parameter, Severity, Version, Versions};
use alight_uav::autopilot::modes::Firmware;

use crate::physics::drone::{AutopilotConfig, LossAction};

const DEFAULTS: &str = include_str!("defaults.csv");

/// Default of a parameter in a maker's releases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MakersDefault {
    pub maker: Maker,
    pub versions: Versions,
    pub name: &'static str,
    pub unit: &'static str,
    pub integer: bool,
    pub value: f64,
}

/// Which rows of the table of parameters an installer has set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Installed {
    All,
    /// Those without which no landing is permitted; parameters that only cause a warning stay at the maker's default.
    Required,
    /// All but this one, which stays at the maker's default.
    AllBut(&'static str),
}

impl Installed {
    fn sets(self, row: &Parameter) -> bool {
        match self {
            Installed::All => true,
            Installed::Required => row.severity == Severity::Reject,
            Installed::AllBut(name) => row.name != name,
        }
    }
}

fn version(text: &str) -> Option<Version> {
    let (major, minor) = text.split_once('.')?;
    Some([major.parse().ok()?, minor.parse().ok()?])
}

fn read(line: &'static str) -> Option<MakersDefault> {
    let mut columns = line.split(',');
    let mut next = || columns.next();
    let maker = match next()? {
        "px4" => Maker::Px4,
        "ardupilot" => Maker::ArduPilot,
        _ => return None,
    };
    Some(MakersDefault {
        maker,
        versions: Versions {
            from: version(next()?).unwrap_or(Versions::ALL.from),
            before: version(next()?).unwrap_or(Versions::ALL.before),
        },
        name: next()?,
        unit: next()?,
        integer: next()? == "int",
        value: next()?.parse().ok()?,
    })
}

/// Makers' defaults of the parameters in this version.
pub fn makers_defaults(maker: Maker, version: Version) -> impl Iterator<Item = MakersDefault> {
    let all = DEFAULTS.lines().filter_map(read);
    all.filter(move |d| d.maker == maker && d.versions.contain(version))
}

/// Parameters that only cause a warning and do not suit by default in this version.
pub fn warned_by_default(maker: Maker, version: Version) -> impl Iterator<Item = &'static str> {
    let warns = |p: &Parameter| p.severity == Severity::Warn;
    let rows = maker.parameters(version).filter(move |(_, p)| warns(p));
    rows.filter_map(move |(_, row)| {
        let default = makers_defaults(maker, version).find(|d| d.name == row.name)?;
        if row.suits(default.value) {
            None
        } else {
            Some(row.name)
        }
    })
}

pub(super) fn is_integer(name: &str) -> bool {
    DEFAULTS
        .lines()
        .filter_map(read)
        .any(|d| d.name == name && d.integer)
}

/// Parameters of an autopilot: the makers' defaults, corrected by the table that `alight check` requires, with the
/// set-point timeout and its action as configured.
pub(super) fn parameters(
    c: &AutopilotConfig,
    version: Version,
    installed: Installed,
) -> BTreeMap<&'static str, f64> {
    let maker = c.firmware.maker();
    let defaults = makers_defaults(maker, version).map(|d| (d.name, d.value));
    let mut all = BTreeMap::from_iter(defaults);
    for (_, row) in maker.parameters(version) {
        if let Some(value) = all.get_mut(row.name)
            && installed.sets(row)
        {
            *value = row.corrected(*value);
        }
    }
    match c.firmware {
        Firmware::Px4 => {
            all.insert("COM_OF_LOSS_T", c.loss_after_s);
            let action = match c.loss_action {
                LossAction::Hold => 5.0,
                LossAction::Land => 4.0,
                LossAction::Return => 3.0,
            };
            all.insert("COM_OBL_RC_ACT", action);
        }
        Firmware::ArduCopter => {
            all.insert("GUID_TIMEOUT", c.loss_after_s);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use alight_shared::time::Time;
    use alight_uav::autopilot::parameters::Parameters;

    use super::*;

    const RELEASES: [(Firmware, Version); 5] = [
        (Firmware::Px4, [1, 16]),
        (Firmware::Px4, [1, 17]),
        (Firmware::Px4, [1, 18]),
        (Firmware::ArduCopter, [4, 6]),
        (Firmware::ArduCopter, [4, 7]),
    ];

    #[test]
    fn lines_of_the_makers_defaults() {
        let lines = DEFAULTS.lines().filter(|l| !l.starts_with('#'));
        assert!(lines.clone().count() > 30 && lines.clone().all(|l| read(l).is_some()));
    }

    /// Names and units of the table against the makers' releases, and the link's check of their defaults.
    #[test]
    fn rows_in_the_makers_releases() {
        for (firmware, version) in RELEASES {
            let maker = firmware.maker();
            for (_, row) in maker.parameters(version) {
                let mut defaults = makers_defaults(maker, version);
                let found = defaults.find(|d| d.name == row.name);
                let unit = found.map(|d| d.unit);
                assert_eq!(unit, Some(row.unit.trim()), "{version:?}: {}", row.name);
            }
            let mut check = Parameters::new(firmware, true, Time::EPOCH);
            check.on_version(version);
            for d in makers_defaults(maker, version) {
                check.received(d.name, firmware.parameter_value(d.value, d.integer));
            }
            assert!(check.complete(), "{version:?}");
            let warned = check.faults().filter(|(p, _)| p.severity == Severity::Warn);
            let warned: Vec<&str> = warned.map(|(p, _)| p.name).collect();
            assert!(warned.into_iter().eq(warned_by_default(maker, version)));
        }
    }

    #[test]
    fn installation_with_defaults_and_the_table_only() {
        for (firmware, version) in RELEASES {
            let config = AutopilotConfig {
                firmware,
                ..AutopilotConfig::default()
            };
            let maker = firmware.maker();
            let names = || makers_defaults(maker, version).map(|d| d.name);
            let all = parameters(&config, version, Installed::All);
            assert!(all.keys().all(|name| names().any(|n| n == *name)));
            for (_, row) in maker.parameters(version) {
                assert!(row.suits(all[row.name]), "{version:?}: {}", row.name);
            }
            // Parameters outside the table keep the maker's default.
            let table = |name| maker.parameters(version).any(|(_, row)| row.name == name);
            for d in makers_defaults(maker, version).filter(|d| !table(d.name)) {
                assert_eq!(all[d.name], d.value, "{}", d.name);
            }
            let required = parameters(&config, version, Installed::Required);
            for (_, row) in maker.parameters(version) {
                let default = makers_defaults(maker, version).find(|d| d.name == row.name);
                let stays = Some(required[row.name]) == default.map(|d| d.value);
                let rejects = row.severity == Severity::Reject;
                assert!(
                    if rejects {
                        row.suits(required[row.name])
                    } else {
                        stays
                    },
                    "{}",
                    row.name
                );
            }
        }
    }
}

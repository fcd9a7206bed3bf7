//! Radio profiles, each a TOML file: by name in `deploy/links`, or by path.

use std::path::Path;

use alight_computer::exit::CliError;
use alight_shared::config;
use alight_sim::radio::SimulatedRadioConfig;

const PROFILES: [(&str, &str); 7] = [
    ("clean", include_str!("../../../links/clean.toml")),
    ("wifi-near", include_str!("../../../links/wifi-near.toml")),
    ("wifi-far", include_str!("../../../links/wifi-far.toml")),
    ("radio-mesh", include_str!("../../../links/radio-mesh.toml")),
    ("storm", include_str!("../../../links/storm.toml")),
    ("blackout-5s", include_str!("../../../links/blackout-5s.toml")),
    ("narrow", include_str!("../../../links/narrow.toml")),
];

pub fn names() -> impl Iterator<Item = &'static str> {
    PROFILES.iter().map(|(name, _)| *name)
}

pub fn load(name: &str) -> Result<SimulatedRadioConfig, CliError> {
    if let Some((_, text)) = PROFILES.iter().find(|(n, _)| *n == name) {
        return Ok(config::parse(text, name)?);
    }
    if !Path::new(name).exists() {
        let known: Vec<&str> = names().collect();
        return Err(CliError(format!(
            "the link {name}: neither a profile ({}) nor a file; choose one of them",
            known.join(", ")
        )));
    }
    Ok(config::load(Path::new(name))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_and_an_unknown_name() {
        for (name, _) in PROFILES {
            load(name).unwrap();
        }
        assert_eq!(load("storm").unwrap().loss, 0.3);
        assert!(load("no-such-thing").unwrap_err().0.contains("radio-mesh"));
    }
}

//! File of a study: the scenes and planners to fly, and the published results.

use std::{collections::BTreeMap, path::Path};

use alight_computer::exit::{CliError, Doing};
use alight_shared::config;
use clap::builder::PossibleValue;
use serde::{Deserialize, Serialize};
use toml::Table;

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../../tests/studies/", $name, ".toml")))),*]
    };
}

const SHIPPED: &[(&str, &str)] = shipped![
    "table2",
    "seas",
    "moving",
    "rocking",
    "wind",
    "sensors",
    "size",
    "link",
    "faa",
    "budget",
    "underway",
    "ablation",
    "benchmark",
];

#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedResult {
    position_error_m: f64,
    landing_time_s: f64,
    touchdown_speed_mps: f64,
}

impl PublishedResult {
    pub fn metric(&self, name: &str) -> Option<f64> {
        match name {
            "position_error_m" => Some(self.position_error_m),
            "landing_time_s" => Some(self.landing_time_s),
            "touchdown_speed_mps" => Some(self.touchdown_speed_mps),
            _ => None,
        }
    }
}

/// Changes of the scene that the command line describes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Changes {
    pub name: String,
    /// The world matches the configurations: deck, keep-out volumes, airframe.
    pub as_configured: bool,
    /// The simulated vessel's engines suffice for its speed.
    pub powered: bool,
    pub published: BTreeMap<String, PublishedResult>,
    /// Flags of `alight trial`, and the tables `scenario`, `vessel_config` and `drone_config` with keys of the files
    /// that these flags name.
    #[serde(flatten)]
    pub flags: Table,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyAxis {
    pub name: String,
    pub choice: Vec<Changes>,
}

/// Scenes for all combinations of the axes' choices.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyGrid {
    pub axis: Vec<StudyAxis>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    pub title: String,
    /// Version of a benchmark, whose table has scores; the scenes of a version never change.
    pub version: Option<u32>,
    /// First seed, unless the command line gives one.
    pub seed0: Option<u64>,
    #[serde(default)]
    pub all: Changes,
    /// Planners, the first of which is compared with the others; empty: the configured planner.
    #[serde(default)]
    pub planner: Vec<Changes>,
    #[serde(default)]
    pub row: Vec<Changes>,
    #[serde(default)]
    pub grid: Vec<StudyGrid>,
    /// Axis by whose choices outcomes are pooled.
    pub pooled_by: Option<String>,
    /// Planner whose published values are shown next to planners without published values.
    #[serde(default)]
    pub beat: String,
    /// Published landings and trials, by planner, over all scenes.
    #[serde(default)]
    pub published_landed: BTreeMap<String, [u32; 2]>,
}

pub fn text(name: &str) -> Result<String, CliError> {
    if let Some((_, text)) = SHIPPED.iter().find(|(n, _)| *n == name) {
        return Ok((*text).into());
    }
    if Path::new(name).extension().is_none_or(|e| e != "toml") {
        let known: Vec<&str> = SHIPPED.iter().map(|(n, _)| *n).collect();
        return Err(CliError(format!(
            "study {name}: neither a study ({}, merge) nor a file FILE.toml; choose one of them",
            known.join(", ")
        )));
    }
    std::fs::read_to_string(name).doing(format_args!(
        "reading the study {name} (alight help study lists some)"
    ))
}

pub fn parse(text: &str, origin: &str) -> Result<Definition, CliError> {
    let doing = || format!("reading the study {origin}");
    let definition: Definition = config::read(text, "the study").doing(doing())?;
    let axes = definition.grid.iter().flat_map(|g| &g.axis);
    let empty = axes.clone().find(|a| a.choice.is_empty());
    if let Some(axis) = empty {
        let why = format!("the axis `{}` has no choice; give it one", axis.name);
        return Err(CliError::because(doing(), why));
    }
    if let Some(by) = &definition.pooled_by
        && axes.clone().all(|a| a.name != *by)
    {
        let why = format!("pooled_by = \"{by}\" is not the name of an axis of a [[grid]]");
        return Err(CliError::because(doing(), why));
    }
    if definition.row.is_empty() && definition.grid.is_empty() {
        return Err(CliError::because(
            doing(),
            "no scene; write a [[row]] or a [[grid]]",
        ));
    }
    Ok(definition)
}

pub fn offered() -> Vec<PossibleValue> {
    let shipped = SHIPPED.iter().map(|(name, text)| {
        let title = parse(text, name).map(|d| d.title).unwrap_or_default();
        PossibleValue::new(*name).help(title)
    });
    let merge = "Join the rows of shards: study merge --out ALL shard-1 shard-2";
    shipped.chain([PossibleValue::new("merge").help(merge)]).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn shipped() -> impl Iterator<Item = (&'static str, Definition)> {
        SHIPPED
            .iter()
            .map(|(name, text)| (*name, parse(text, name).unwrap()))
    }

    #[test]
    fn study_definition_rejections() {
        for (text, why) in [
            ("title = \"x\"", "no scene"),
            ("title = \"x\"\nrows = []", "unknown field `rows`"),
            (
                "title = \"x\"\npooled_by = \"hull\"\n[[row]]",
                "the name of an axis",
            ),
            (
                "title = \"x\"\n[[grid]]\n[[grid.axis]]\nname = \"hull\"\nchoice = []",
                "no choice",
            ),
        ] {
            let e = parse(text, "own.toml").unwrap_err().0;
            assert!(e.contains(why) && e.contains("own.toml"), "{e}");
        }
        assert!(super::text("nothing").unwrap_err().0.contains("table2"));
    }
}

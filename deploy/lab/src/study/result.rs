//! `result.json`: record of what produced a study's rows, with the digest of each flight.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use alight_computer::{
    config::DroneFile,
    exit::{CliError, Doing},
};
use alight_shared::wire;
use alight_sim::harness::{outcome::Outcome, scenario::NodeConfigs};
use alight_uav::planner::PlannerKind;
use serde::{Deserialize, Serialize};

use super::rows::StudyRow;
use crate::exec::{EXEC_MEASURED, command};

pub const RESULT_FILE: &str = "result.json";
/// Maximum number of differences that a message names.
const MAX_NAMED: usize = 6;

/// Record of a result.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct StudyResult {
    /// Program with its commit; hashes of the study's file, of each scene with its configurations, and of the files of
    /// planners and predictors; the flags that change scenes. Rows are joined only if these agree.
    pub facts: BTreeMap<String, String>,
    /// Processors on which the rows were flown: another type may round differently.
    pub machines: BTreeSet<String>,
    /// Digest of each flight.
    pub digests: BTreeMap<String, String>,
}

fn hash(text: &[u8]) -> String {
    format!("{:016x}", wire::hash_bytes(text))
}

/// Name of a flight in the record.
pub fn flight(scene: &str, planner: &str, seed: u64) -> String {
    format!("{scene} of {planner}, seed {seed}")
}

/// Text with the hash of each file that `words` name.
fn with_files<'a>(text: &str, words: impl Iterator<Item = &'a str>) -> String {
    let mut out = text.to_owned();
    for word in words.map(|w| w.trim_matches(['\'', '"'])) {
        if let Ok(bytes) = std::fs::read(word) {
            out += &format!(", {word} {}", hash(&bytes));
        }
    }
    out
}

/// Latency and files of a planner or predictor that is another program.
fn program_fact(name: &str) -> String {
    let latency = if name.starts_with(EXEC_MEASURED) {
        "latency measured"
    } else {
        "latency stated"
    };
    command(name).map_or("included".into(), |command| {
        with_files(latency, command.split_whitespace())
    })
}

impl StudyResult {
    /// Record of a study of `rows` that has not been flown yet, with these flags.
    pub fn new(program: &str, study: &str, given: &[(&str, String)], rows: &[StudyRow]) -> Self {
        let mut facts = BTreeMap::from([
            ("program".into(), program.into()),
            ("study".into(), hash(study.as_bytes())),
        ]);
        for (name, value) in given.iter().filter(|(name, _)| *name != "planner") {
            facts.insert(
                format!("--{name}"),
                with_files(value, [value.as_str()].into_iter()),
            );
        }
        for row in rows {
            let world = toml::to_string(&row.world).unwrap_or_default();
            let scene = hash((world + &configuration_hash(&row.nodes)).as_bytes());
            facts.insert(format!("scene {} of {}", row.scenario, row.planner), scene);
            facts.insert(format!("planner {}", row.planner), program_fact(row.kind()));
            if let Some(own) = &row.nodes.predictor {
                facts.insert("predictor".into(), program_fact(own.name()));
            }
        }
        StudyResult {
            facts,
            machines: BTreeSet::from([machine()]),
            digests: BTreeMap::new(),
        }
    }

    pub fn read(path: &Path) -> Result<StudyResult, CliError> {
        let doing = format!("reading the record of a result {}", path.display());
        let text = std::fs::read_to_string(path).doing(&doing)?;
        serde_json::from_str(&text).doing(&doing)
    }

    /// Writes the record with the digests of `outcomes`.
    pub fn write(mut self, out: &Path, outcomes: &[Outcome]) -> Result<(), CliError> {
        let digest = |o: &Outcome| (flight(&o.sea, &o.planner, o.seed), o.digest.clone());
        self.digests.extend(outcomes.iter().map(digest));
        let text = serde_json::to_string_pretty(&self).doing("writing the record of a result")?;
        write_files(out, &[(RESULT_FILE, text)])
    }

    /// Hash of everything that rows have in common.
    pub fn configuration(&self) -> String {
        hash(format!("{:?}", self.facts).as_bytes())
    }

    /// Differences between this record and `other` that make their rows different experiments.
    pub fn differences(&self, other: &StudyResult) -> Vec<String> {
        let names: BTreeSet<_> = self.facts.keys().chain(other.facts.keys()).collect();
        let difference = |name: &String| {
            let values = [self, other].map(|r| r.facts.get(name));
            let [a, b] = values.map(|v| v.map_or("not given", String::as_str));
            // A scene or planner may be in one of them only.
            let is_common = name.starts_with("--") || values.iter().all(Option::is_some);
            if a == b || !is_common {
                None
            } else {
                Some(format!("{name}: {a} and {b}"))
            }
        };
        names.into_iter().filter_map(difference).collect()
    }

    /// Adds what `other` has, or says what differs; `doing` names the rejected action.
    pub fn join(&mut self, other: StudyResult, doing: &str) -> Result<(), CliError> {
        let mut differences = self.differences(&other);
        if !differences.is_empty() {
            differences.truncate(MAX_NAMED);
            return Err(CliError(format!(
                "{doing}: another configuration: {}",
                differences.join("; ")
            )));
        }
        self.facts.extend(other.facts);
        self.machines.extend(other.machines);
        self.digests.extend(other.digests);
        Ok(())
    }

    /// Differences between the result and its complete, unaltered study of `scenes` scenes.
    pub fn remarks(&self, outcomes: &[Outcome], scenes: usize) -> Vec<String> {
        let flown: BTreeSet<_> = outcomes.iter().map(|o| &o.sea).collect();
        let flags = self.facts.iter().filter(|(name, _)| name.starts_with("--"));
        let mut remarks: Vec<String> = flags.map(|(name, v)| format!("altered by {name} {v}")).collect();
        if flown.len() < scenes {
            remarks.push(format!("partial: {} of {scenes} rows", flown.len()));
        }
        remarks
    }
}

/// Hash of the nodes' configuration without the planner's kind, the same for all rows of a table.
pub fn configuration_hash(nodes: &NodeConfigs) -> String {
    let mut drone = DroneFile {
        bridge: nodes.bridge.clone(),
        drone: nodes.drone.clone(),
    };
    drone.drone.planner.kind = PlannerKind::default();
    let texts = [
        toml::to_string(&nodes.vessel),
        toml::to_string(&nodes.deck),
        toml::to_string(&nodes.autopilot),
        toml::to_string(&drone),
    ];
    let text = texts.map(Result::unwrap_or_default).concat();
    format!("{:016x}", wire::hash_record(&text).unwrap_or_default())
}

pub fn write_files(out: &Path, files: &[(&str, String)]) -> Result<(), CliError> {
    std::fs::create_dir_all(out).doing(format_args!("making {}", out.display()))?;
    for (name, text) in files {
        let path = out.join(name);
        std::fs::write(&path, text).doing(format_args!("writing {}", path.display()))?;
    }
    Ok(())
}

/// Processor and number of threads of this computer.
pub fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text
        .lines()
        .find_map(|l| l.strip_prefix("model name")?.split_once(": "));
    let threads = std::thread::available_parallelism().map_or(0, usize::from);
    format!(
        "{}, {threads} threads",
        model.map_or("unknown processor", |(_, name)| name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_that_are_not_joined_say_what_differs() {
        let file = std::env::temp_dir().join(format!("alight-planner-{}.py", std::process::id()));
        let planner = format!("exec:python3 {}", file.display());
        let record = |program: &str, text: &str, given: &[(&str, String)]| {
            std::fs::write(&file, text).unwrap();
            let mut record = StudyResult::new(program, "study", given, &[]);
            record.facts.insert("planner".into(), program_fact(&planner));
            record
        };
        let wind = [("wind", "6".to_owned())];
        let first = record("a", "none", &[]);
        first.clone().join(record("a", "none", &[]), "").unwrap();
        for (other, why) in [
            (record("b", "none", &[]), "program: a and b"),
            (record("a", "stages", &[]), "planner: latency stated, "),
            (record("a", "none", &wind), "--wind: not given and 6"),
        ] {
            let e = first.clone().join(other, "study merge").unwrap_err().0;
            assert!(e.contains(why), "{e}");
        }
        let altered = record("a", "none", &wind).remarks(&[], 34);
        assert_eq!(altered, ["altered by --wind 6", "partial: 0 of 34 rows"]);
        std::fs::remove_file(&file).unwrap();
    }
}

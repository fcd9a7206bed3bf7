//! Runs a grid of scenes and planners: resumable, sharded, with a CSV row per trial.

use std::{
    collections::BTreeSet,
    fs::{File, OpenOptions},
    path::{Path, PathBuf},
    sync::Mutex,
};

use alight_computer::{
    config::{DroneFile, VesselComputerConfig, method},
    exit::CliError,
    terminal::{line, note, wrapped},
};
use alight_sim::{
    harness::{outcome::Outcome, trial::Watch},
    studies::statistics::wilson,
};
use alight_transport::wake::end_requested;

use super::{
    definition::Definition,
    result::{RESULT_FILE, StudyResult, flight, machine},
    rows::StudyRow,
    tasks,
};
use crate::{
    args::{Shard, StudyArgs},
    record::{self, RecordingScene},
    trials::{fly_seed, in_parallel, seeds},
};

pub struct GridRun<'a> {
    pub study: &'a str,
    /// Scenes, programs and settings that produce the rows.
    pub result: StudyResult,
    pub trials: u32,
    pub seed0: u64,
    /// None: all cores.
    pub jobs: Option<u16>,
    pub out: Option<&'a Path>,
    pub shard: Option<Shard>,
    /// Half-width of a row's landing rate interval at which the row ends.
    pub within: Option<f64>,
    /// Flies the first failed trials again and records them.
    pub records_failed: bool,
    /// Measures the planner's solve times.
    pub timed: bool,
    pub alone: bool,
}

impl<'a> GridRun<'a> {
    pub fn of(
        args: &'a StudyArgs,
        study: &'a str,
        program: &str,
        definition: &Definition,
        rows: &[StudyRow],
    ) -> Self {
        GridRun {
            study,
            result: StudyResult::new(program, study, &args.scene.given(), rows),
            trials: args.trials,
            seed0: first_seed(args, definition),
            jobs: args.jobs,
            out: args.out.as_deref(),
            shard: args.shard,
            within: args.within.map(|percent| f64::from(percent) / 100.0),
            records_failed: true,
            timed: definition.version.is_some(),
            alone: args.form.alone(),
        }
    }
}

/// First seed: the command line's, otherwise the study's.
pub fn first_seed(args: &StudyArgs, definition: &Definition) -> u64 {
    args.seed0.or(definition.seed0).unwrap_or(1)
}

fn rows_file(out: &Path) -> PathBuf {
    out.join("rows.csv")
}

fn read_rows(dir: &Path) -> Result<Vec<Outcome>, CliError> {
    let path = rows_file(dir);
    let doing = format!("reading the rows {} (of a study's --out)", path.display());
    let reading = |e: csv::Error| CliError::because(&doing, e);
    let mut reader = csv::Reader::from_path(&path).map_err(reading)?;
    reader.deserialize().map(|r| r.map_err(reading)).collect()
}

/// Joins the contents of `dirs` into `out`: rows, and the files for replaying a trial. All must have been produced alike,
/// as the returned record says.
pub fn join(dirs: &[PathBuf], out: &Path) -> Result<(Vec<Outcome>, StudyResult), CliError> {
    let writing = |e: &dyn std::fmt::Display| CliError::because(format!("writing into {}", out.display()), e);
    let mut outcomes = Vec::new();
    let mut joined: Option<StudyResult> = None;
    std::fs::create_dir_all(out).map_err(|e| writing(&e))?;
    for dir in dirs {
        outcomes.extend(read_rows(dir)?);
        let own = StudyResult::read(&dir.join(RESULT_FILE))?;
        match &mut joined {
            Some(joined) => joined.join(own, &format!("study merge: {} is not joined", dir.display()))?,
            None => joined = Some(own),
        }
        for part in ["scenarios", "configs/vessel", "configs/drone", "configs/tuning"] {
            // A missing file means that its configuration was the default.
            for entry in std::fs::read_dir(dir.join(part)).into_iter().flatten().flatten() {
                let folder = out.join(part);
                std::fs::create_dir_all(&folder).map_err(|e| writing(&e))?;
                std::fs::copy(entry.path(), folder.join(entry.file_name())).map_err(|e| writing(&e))?;
            }
        }
    }
    if let Some(dir) = dirs.first() {
        std::fs::copy(dir.join(STUDY_FILE), out.join(STUDY_FILE)).map_err(|e| writing(&e))?;
    }
    outcomes.sort_by(|a, b| (&a.sea, &a.planner, a.seed).cmp(&(&b.sea, &b.planner, b.seed)));
    outcomes.dedup_by(|a, b| (&a.sea, &a.planner, a.seed) == (&b.sea, &b.planner, b.seed));
    let mut writer = csv::Writer::from_path(rows_file(out)).map_err(|e| writing(&e))?;
    for o in &outcomes {
        writer.serialize(o).map_err(|e| writing(&e))?;
    }
    writer.flush().map_err(|e| writing(&e))?;
    let joined = joined.unwrap_or_default();
    joined.clone().write(out, &outcomes)?;
    Ok((outcomes, joined))
}

pub fn scenario_file(out: &Path, scenario: &str) -> PathBuf {
    out.join("scenarios").join(file_stem(scenario) + ".toml")
}

/// Files in a study's directory for the non-default configurations of vessel and drone and keys of the method.
pub fn config_files(out: &Path, row: &StudyRow) -> [PathBuf; 3] {
    let name = file_stem(&format!("{} {}", row.scenario, row.planner)) + ".toml";
    ["vessel", "drone", "tuning"].map(|side| out.join("configs").join(side).join(&name))
}

pub const STUDY_FILE: &str = "study.toml";

/// Writes the files for replaying the study's trials. Rejects a directory with rows of another study, configuration
/// or scene.
fn prepare(args: &GridRun<'_>, out: &Path, rows: &[StudyRow]) -> Result<(), CliError> {
    let doing = || format!("preparing the directory {}", out.display());
    let because = |e: &dyn std::fmt::Display| CliError::because(doing(), e);
    let mut files = vec![(out.join(STUDY_FILE), args.study.to_owned())];
    for row in rows {
        let text = toml::to_string(&row.world).map_err(|e| because(&e))?;
        files.push((scenario_file(out, &row.scenario), text));
        let nodes = row.nodes.clone();
        let [vessel, drone, tuning] = config_files(out, row);
        let computer = VesselComputerConfig {
            vessel: nodes.vessel,
            ..VesselComputerConfig::default()
        };
        let [own, mut tuned] = method::divided(&computer).map_err(|e| because(&e))?;
        if computer != VesselComputerConfig::default() {
            files.push((vessel, own.to_string()));
        }
        let file = DroneFile {
            bridge: nodes.bridge,
            drone: nodes.drone,
        };
        let [own, tuned_drone] = method::divided(&file).map_err(|e| because(&e))?;
        tuned.extend(tuned_drone);
        let mut plain = DroneFile::default();
        plain.drone.planner.kind = file.drone.planner.kind;
        if file != plain {
            files.push((drone, own.to_string()));
        }
        if !tuned.is_empty() {
            files.push((tuning, tuned.to_string()));
        }
    }
    let mut result = args.result.clone();
    if rows_file(out).exists() {
        let doing = format!(
            "{} has rows that would be mixed with these; give another directory",
            out.display()
        );
        result.join(StudyResult::read(&out.join(RESULT_FILE))?, &doing)?;
    }
    for (path, text) in files {
        if let Some(dir) = path.parent() {
            std::fs::create_dir_all(dir).map_err(|e| because(&e))?;
        }
        std::fs::write(&path, text).map_err(|e| because(&e))?;
    }
    result.write(out, &[])
}

/// `alight study NAME --verify result.json`: flies the record's trials of these rows and seeds again, and compares their
/// digests.
pub fn verify(path: &Path, run: &GridRun<'_>, rows: &[StudyRow]) -> Result<(), CliError> {
    let record = StudyResult::read(path)?;
    let mut work = Vec::new();
    for row in rows {
        for seed in seeds(run.seed0, run.trials)? {
            let name = flight(&row.scenario, &row.planner, seed);
            work.extend(
                record
                    .digests
                    .get_key_value(&name)
                    .map(|digest| (row, seed, digest)),
            );
        }
    }
    for difference in run.result.differences(&record) {
        line(wrapped(&format!("here and in the record, {difference}")));
    }
    let differ = in_parallel(run.jobs, "trials", &work, |(row, seed, (name, digest))| {
        let flown = fly_seed((&row.world, &row.nodes), *seed, &row.scenario, false)?;
        Ok(if flown.digest == **digest {
            None
        } else {
            Some(*name)
        })
    })?;
    let differ: Vec<&String> = differ.into_iter().flatten().collect();
    let text = format!(
        "{} of {} flights are those of the record, which has {} on {:?}",
        work.len() - differ.len(),
        work.len(),
        record.digests.len(),
        record.machines
    );
    if differ.is_empty() && !work.is_empty() {
        line(text);
        return Ok(());
    }
    Err(CliError(format!(
        "{text}; here on {}; others: {differ:?}",
        machine()
    )))
}

pub fn file_stem(scenario: &str) -> String {
    scenario.replace(|c: char| !c.is_ascii_alphanumeric() && c != '.', "-")
}

type TrialKey = (String, String, u64);

fn key_of(o: &Outcome) -> TrialKey {
    (o.sea.clone(), o.planner.clone(), o.seed)
}
fn wanted_key((row, seed): &(&StudyRow, u64)) -> TrialKey {
    (row.scenario.clone(), row.planner.clone(), *seed)
}

struct RowsWriter(Mutex<csv::Writer<File>>);

impl RowsWriter {
    /// Opens the file, and reads the trials that were already flown.
    fn open(
        args: &GridRun<'_>,
        out: &Path,
        rows: &[StudyRow],
    ) -> Result<(RowsWriter, Vec<Outcome>), CliError> {
        prepare(args, out, rows)?;
        let path = rows_file(out);
        let fresh = !path.exists();
        let done = if fresh { Vec::new() } else { read_rows(out)? };
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let file = file.map_err(|e| CliError::because(format!("writing the rows {}", path.display()), e))?;
        let lines = csv::WriterBuilder::new().has_headers(fresh).from_writer(file);
        Ok((RowsWriter(Mutex::new(lines)), done))
    }
    fn add(&self, outcome: &Outcome) -> Result<(), CliError> {
        // A thread that panicked while writing has ended the study.
        let Ok(mut writer) = self.0.lock() else {
            return Ok(());
        };
        writer
            .serialize(outcome)
            .and_then(|()| writer.flush().map_err(Into::into))
            .map_err(|e| CliError::because("writing a row", e))
    }
}

/// Flies the missing trials; returns all outcomes in the order of rows and seeds.
pub fn fly_grid(args: &GridRun<'_>, rows: &[StudyRow]) -> Result<Vec<Outcome>, CliError> {
    // The first call installs the signal handler.
    end_if_asked(args, 0, 0);
    let seeds = seeds(args.seed0, args.trials)?;
    let opened = args
        .out
        .map(|out| RowsWriter::open(args, out, rows))
        .transpose()?;
    let (writer, mut done) = opened.map_or((None, Vec::new()), |(writer, done)| (Some(writer), done));
    let known: BTreeSet<_> = done.iter().map(key_of).collect();
    let all = || {
        rows.iter()
            .flat_map(|row| seeds.iter().map(move |seed| (row, *seed)))
    };
    let wanted: BTreeSet<_> = all().map(|trial| wanted_key(&trial)).collect();
    if !done.is_empty() {
        let taken = wanted.intersection(&known).count();
        let text = format!(
            "{taken} of {} trials were flown before and are taken from rows.csv",
            wanted.len()
        );
        note(args.alone, text);
    }
    let fly = |(row, seed): &(&StudyRow, u64)| {
        let outcome = Outcome {
            planner: row.planner.clone(),
            ..fly_seed((&row.world, &row.nodes), *seed, &row.scenario, args.timed)?
        };
        writer.as_ref().map_or(Ok(()), |w| w.add(&outcome))?;
        Ok(outcome)
    };
    done.retain(|o| wanted.contains(&key_of(o)));
    if let Some(within) = args.within {
        for block in seeds.chunks(LOOKED_AT) {
            let open: Vec<&StudyRow> = rows.iter().filter(|row| !is_known(row, &done, within)).collect();
            let work = open.iter().flat_map(|row| block.iter().map(|seed| (*row, *seed)));
            let work: Vec<_> = work.filter(|t| !known.contains(&wanted_key(t))).collect();
            done.extend(in_parallel(args.jobs, "trials", &work, fly)?);
        }
    } else {
        let mine = |number: usize| args.shard.is_none_or(|s| number as u64 % s.count == s.index - 1);
        let work: Vec<_> = all()
            .enumerate()
            .filter(|(number, trial)| mine(*number) && !known.contains(&wanted_key(trial)))
            .map(|(_, trial)| trial)
            .collect();
        done.extend(in_parallel(args.jobs, "trials", &work, fly)?);
    }
    end_if_asked(args, done.len(), wanted.len());
    let place = |o: &Outcome| rows.iter().position(|r| r.is_of(o));
    done.sort_by_key(|o| (place(o), o.seed));
    if let Some(out) = args.out {
        // The directory may have rows of other scenes.
        StudyResult::read(&out.join(RESULT_FILE))?.write(out, &done)?;
    }
    if let Some(out) = args.out.filter(|_| args.records_failed) {
        record_failed(args, out, rows, &done)?;
    }
    Ok(done)
}

/// Ends the process if it was asked to, reporting the number of landings flown and how to continue.
pub fn end_if_asked(args: &GridRun<'_>, flown: usize, all: usize) {
    if !end_requested() {
        return;
    }
    let rest = match args.out.map(rows_file) {
        Some(rows) => {
            let rows = rows.display();
            let command = tasks::given();
            format!("{rows} has them; this continues:\n  {command}")
        }
        None => "they are lost; --out DIRECTORY keeps them".into(),
    };
    let text = format!("interrupted after {flown} of {all} landings: {rest}");
    note(true, text);
    std::process::exit(1);
}

/// Number of a row's trials between two checks of its interval.
const LOOKED_AT: usize = 20;

/// Whether a row's landing rate is known to `within`, up and down, by Wilson's 95 % interval. Because the row's own
/// trials end it, the interval covers a little less than 95 %.
fn is_known(row: &StudyRow, done: &[Outcome], within: f64) -> bool {
    let own: Vec<&Outcome> = done.iter().filter(|o| row.is_of(o)).collect();
    let flown = own.len();
    let landed = own.iter().filter(|o| o.success).count();
    let (low, high) = wilson(landed, flown);
    let rate = landed as f64 / flown.max(1) as f64;
    flown >= LOOKED_AT && (rate - low).max(high - rate) <= within
}

const MAX_RECORDED_FAILURES: usize = 5;

fn record_failed(
    args: &GridRun<'_>,
    out: &Path,
    rows: &[StudyRow],
    done: &[Outcome],
) -> Result<(), CliError> {
    let dir = out.join("failed");
    for o in done.iter().filter(|o| !o.success).take(MAX_RECORDED_FAILURES) {
        let Some(row) = rows.iter().find(|r| r.is_of(o)) else {
            continue;
        };
        let name = file_stem(&format!("{} {}", o.sea, o.planner));
        let path = dir.join(format!("{name}-{}.mcap", o.seed));
        if path.exists() {
            continue;
        }
        std::fs::create_dir_all(&dir)
            .map_err(|e| CliError::because(format!("making {}", dir.display()), e))?;
        let subject = RecordingScene {
            scenario: &row.world,
            nodes: &row.nodes,
            seed: o.seed,
            sea: &row.scenario,
            live: false,
        };
        let watch = Watch {
            on_event: &mut |_| {},
            trace_step_s: None,
        };
        record::fly(Some(&path), &subject, watch, None)?.1?;
        note(args.alone, format_args!("recorded: {}", path.display()));
    }
    Ok(())
}

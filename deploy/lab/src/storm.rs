//! `alight study storm`: flights with several drawn faults each, rules that must hold in every tick, and the shortest
//! list of faults that breaks a rule.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    quantity::{seconds, whole},
    record::observer::StepObserver,
    terminal::{self, Form, note, wrapped},
};
use alight_people::said::Statements;
use alight_shared::{
    msg::State,
    step::Step,
    time::{Time, TrueTime},
};
use alight_sim::harness::{
    observer::WorldObserver,
    storm::{
        FaultKind, FlightKind, Flown, MAX_FAULTS, Pair, Storm, StormEnding, fly, fly_observed, pairs, shrink,
        watch::{StormRule, Violation},
    },
};
use alight_transport::wake::end_requested;
use clap::Args;
use serde::Serialize;

use super::{
    scene::stopwatch,
    trials::{in_parallel, seeds},
};

const MAX_LIST_BYTES: u64 = 1 << 20;
/// Seeds per worker between two checks of the clock.
const BATCH: u32 = 8;

/// Arguments of `alight study storm`.
#[derive(Args, Debug)]
#[command(
    after_help = "A violation prints the shortest list that still breaks the rule, as a file for --list.\n\
  alight study storm --trials 100 --faults 4\n  alight study storm --for 8min --save violations\n  \
  alight study storm --list violations/17.toml\n\n\
Exit codes: 0 every rule held, 1 one was broken, 2 bad input."
)]
pub struct StormArgs {
    /// Number of storms.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole::<u32>(1..=1_000_000))]
    trials: u32,
    /// Fly for this duration instead, s.
    #[arg(long = "for", value_name = "TIME", conflicts_with = "trials", value_parser = seconds(1..=604_800))]
    seconds: Option<u32>,
    /// First seed.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed0: u64,
    /// Faults per storm.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = whole::<u8>(1..=MAX_FAULTS as i64))]
    faults: u8,
    /// Threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = whole::<u16>(1..=1024))]
    jobs: Option<u16>,
    /// Fly this list instead, and show the events.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["trials", "seconds", "seed0", "faults", "jobs", "save"])]
    list: Option<PathBuf>,
    /// Directory for each violation's shortest list, SEED.toml.
    #[arg(long, value_name = "DIRECTORY")]
    save: Option<PathBuf>,
    /// Output format.
    #[command(flatten)]
    form: Form,
}

#[derive(Serialize)]
struct Broken {
    seed: u64,
    violation: Violation,
    /// List as drawn, and the shortest list that still breaks the rule.
    storm: Storm,
    shrunk: Storm,
}

#[derive(Serialize)]
struct BrokenRow<'a> {
    seed: u64,
    #[serde(flatten)]
    violation: &'a Violation,
}

struct StormEnd {
    flight: FlightKind,
    flown: Flown,
    broken: Option<Box<Broken>>,
    said: Statements,
}

/// Passes the steps of a simulated flight to the judge of statements.
#[derive(Default)]
struct StatementObserver(Statements);

impl WorldObserver for StatementObserver {
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        self.0.step(t, step);
    }
}

#[derive(Default, Serialize)]
struct Summary {
    storms: usize,
    landed: usize,
    waits: usize,
    crashed: usize,
    /// Number of storms that broke a rule only with parameters at the maker's default, and for these parameters the
    /// number of such storms.
    warned: usize,
    warnings: BTreeMap<String, usize>,
    violations: BTreeMap<StormRule, usize>,
    /// Moments at which the statements were judged, and for each rule on them the moments that broke it.
    judged: u32,
    said: BTreeMap<&'static str, u32>,
    /// Number of faults that began; for kinds, and for pairs of kind and state, the number that began and the total
    /// number.
    faults_begun: usize,
    kinds_begun: usize,
    kinds: usize,
    pairs_begun: usize,
    /// Sums over flights: kinds that began and kinds that can begin, and likewise states in which faults began.
    kinds_in_flights_begun: usize,
    kinds_in_flights: usize,
    states_in_flights_begun: usize,
    states_in_flights: usize,
    storms_per_s: f64,
    broken: Vec<Broken>,
}

pub fn run(args: &StormArgs) -> Result<Exit, CliError> {
    // The first call installs the handler, so that from here on a signal ends the study with the storms flown so far.
    if end_requested() {
        return Ok(Exit::Failed);
    }
    if let Some(path) = &args.list {
        return fly_list(path, args.form);
    }
    if let Some(directory) = &args.save {
        fs::create_dir_all(directory).doing(format_args!("making the directory {}", directory.display()))?;
    }
    let elapsed = stopwatch();
    let cores = || u32::try_from(rayon::current_num_threads()).unwrap_or(1);
    let workers = args.jobs.map_or_else(cores, u32::from);
    let mut all: Vec<StormEnd> = Vec::new();
    let mut coverage = Coverage::default();
    let mut next = args.seed0;
    loop {
        let left = args
            .seconds
            .map_or(args.trials.saturating_sub(flown_count(&all)), |_| u32::MAX);
        let batch = seeds(next, left.min(BATCH * workers))?;
        next = next.saturating_add(batch.len() as u64);
        // The pairs of kind and state with the fewest begun faults are flown next.
        let drawn = batch
            .into_iter()
            .map(|seed| Storm::drawn(seed, args.faults.into()));
        let batch: Vec<Storm> = drawn.map(|storm| coverage.aim(storm)).collect();
        let flown = in_parallel(args.jobs, "storms", &batch, |storm| fly_one(args, storm))?;
        for end in &flown {
            coverage.add(end.flight, &end.flown);
        }
        all.extend(flown);
        let over = match args.seconds {
            Some(s) => elapsed() >= f64::from(s),
            None => flown_count(&all) >= args.trials,
        };
        if over || end_requested() {
            break;
        }
    }
    let summary = Summary::of(all, &coverage, elapsed());
    if !args.form.print(&summary, &summary.rows())? {
        terminal::line(summary.text());
    }
    Ok(Exit::of(
        summary.broken.is_empty() && summary.said.is_empty() && summary.storms > 0,
    ))
}

fn flown_count(all: &[StormEnd]) -> u32 {
    u32::try_from(all.len()).unwrap_or(u32::MAX)
}

/// Coverage: for each kind and state, the number of faults that began and of storms aimed at it; for each type of
/// flight, the kinds and states in which faults began.
#[derive(Default)]
struct Coverage {
    begun: BTreeMap<Pair, usize>,
    aimed: BTreeMap<Pair, usize>,
    kinds: BTreeSet<(FlightKind, FaultKind)>,
    states: BTreeSet<(FlightKind, State)>,
}

impl Coverage {
    fn add(&mut self, flight: FlightKind, flown: &Flown) {
        for (kind, state, _) in &flown.began {
            *self.begun.entry((*kind, *state)).or_default() += 1;
            self.kinds.insert((flight, *kind));
            // A fault drawn for one state may begin after it, in a state that is not counted.
            let counts = flight.states().any(|s| s == *state);
            self.states.extend(counts.then_some((flight, *state)));
        }
    }
    /// Aims a storm at the rarest pair of its flight; leaves it unchanged before the first flight.
    fn aim(&mut self, storm: Storm) -> Storm {
        if self.begun.is_empty() {
            return storm;
        }
        let count = |of: &BTreeMap<Pair, usize>, pair: &Pair| of.get(pair).copied().unwrap_or(0);
        let rarest = pairs(storm.flight).min_by_key(|p| count(&self.begun, p) + count(&self.aimed, p));
        let Some(pair) = rarest else { return storm };
        *self.aimed.entry(pair).or_default() += 1;
        storm.aimed(pair)
    }
}

fn fly_one(args: &StormArgs, storm: &Storm) -> Result<StormEnd, CliError> {
    let seed = storm.seed;
    if args.trials == 1 && args.seconds.is_none() {
        note(args.form.alone(), storm.text());
    }
    let silent = &mut |_: f64, _: &str| {};
    let doing = format!("setting up the storm of seed {seed}");
    let mut observer = StatementObserver::default();
    let flown = fly_observed(storm, None, &mut observer, silent).doing(&doing)?;
    for s in &observer.0.broken {
        let moment = format!(
            "seed {seed}, {}'s page, {:.1} s, {} moments",
            s.page, s.t_s, s.moments
        );
        note(
            args.form.alone(),
            format_args!("{moment}: not: {}: {}", s.rule, s.text),
        );
    }
    let broken = flown.violation.map(|violation| {
        let breaks = |s: &Storm| {
            if end_requested() {
                return None;
            }
            let again = fly(s, &mut |_, _| {}).ok()?;
            again.violation.map(|v| v.rule)
        };
        let shrunk = shrink(storm, violation.rule, breaks);
        Box::new(Broken {
            seed,
            violation,
            storm: storm.clone(),
            shrunk,
        })
    });
    if let Some(broken) = &broken {
        show(args, broken)?;
    }
    Ok(StormEnd {
        flight: storm.flight,
        flown,
        broken,
        said: observer.0,
    })
}

/// Reads a list that real processes can fly, which must be of a landing.
pub fn read_list(path: &Path) -> Result<Storm, CliError> {
    let storm = read(path)?;
    if storm.flight == FlightKind::Landing {
        return Ok(storm);
    }
    Err(CliError::because(
        format!("reading the list {}", path.display()),
        "real processes fly landings; fly it by `alight study storm --list`",
    ))
}

fn read(path: &Path) -> Result<Storm, CliError> {
    let doing = format_args!("reading the list {} (--save writes them)", path.display());
    let length = fs::metadata(path).doing(doing)?.len();
    if length > MAX_LIST_BYTES {
        return Err(CliError(format!(
            "{doing}: it has {length} bytes, and a list has at most {MAX_LIST_BYTES}"
        )));
    }
    let text = fs::read_to_string(path).doing(doing)?;
    Storm::read(&text).map_err(|e| {
        let error = e.to_string();
        CliError(match missing(&error) {
            Some(key) => format!("{doing}: the key `{key}` is missing; write it above the first [[fault]]"),
            None => format!("{doing}: {error}"),
        })
    })
}

/// Missing top-level key, from the parser's error, which points to the first line because the key has no entry.
fn missing(error: &str) -> Option<&str> {
    let key = error.split_once("missing field `")?.1.split('`').next()?;
    let whole = Storm::drawn(1, 0).text();
    whole
        .lines()
        .any(|line| line.split(" = ").next() == Some(key))
        .then_some(key)
}

fn fly_list(path: &Path, form: Form) -> Result<Exit, CliError> {
    let storm = read(path)?;
    let mut show = |t_s: f64, line: &str| note(form.alone(), format_args!("{t_s:>7.2} s  {line}"));
    let flown = fly(&storm, &mut show).doing(format_args!("flying the list {}", path.display()))?;
    if !form.print(&flown, &[&flown])? {
        let end = match flown.ending {
            StormEnding::Landed => "landed: every rule held",
            StormEnding::Waits if flown.came_down == Some(StormEnding::Landed) => {
                "waited for a stated reason, and landed by its battery: every rule held"
            }
            StormEnding::Waits => "waits for a stated reason: every rule held",
            StormEnding::Crashed => "crashed under a fault that excuses it: every rule held",
            StormEnding::Violated => "a rule was broken",
            StormEnding::Warned => "a rule was broken by parameters at the maker's default",
        };
        terminal::line(format_args!("{:>7.2} s  {end}", flown.lasted_s));
    }
    Ok(Exit::of(flown.ending != StormEnding::Violated))
}

/// Prints a violation and its list in one call, because several threads print.
fn show(args: &StormArgs, broken: &Broken) -> Result<(), CliError> {
    let seed = broken.seed;
    let text = broken.shrunk.text();
    let list = match &args.save {
        Some(directory) => {
            let path = directory.join(format!("{seed}.toml"));
            fs::write(&path, text).doing(format_args!("writing {}", path.display()))?;
            format!("  replay: alight study storm --list {}", path.display())
        }
        None => text.lines().map(|line| format!("  {line}\n")).collect(),
    };
    let list = list.trim_end();
    note(
        args.form.alone(),
        format_args!("seed {seed}: {}\n{list}", broken.violation),
    );
    Ok(())
}

impl Summary {
    fn of(all: Vec<StormEnd>, coverage: &Coverage, elapsed_s: f64) -> Summary {
        let mut summary = Summary {
            storms: all.len(),
            kinds: FaultKind::ALL.len(),
            kinds_in_flights: FlightKind::ALL.len() * FaultKind::ALL.len(),
            states_in_flights: FlightKind::ALL.into_iter().flat_map(FlightKind::states).count(),
            storms_per_s: all.len() as f64 / elapsed_s.max(1e-3),
            ..Summary::default()
        };
        for end in all {
            let StormEnd { flown, broken, .. } = end;
            summary.judged += end.said.judged;
            for s in end.said.broken {
                *summary.said.entry(s.rule).or_default() += s.moments;
            }
            match flown.ending {
                StormEnding::Landed => summary.landed += 1,
                StormEnding::Waits => summary.waits += 1,
                StormEnding::Crashed => summary.crashed += 1,
                StormEnding::Violated => {}
                StormEnding::Warned => summary.warned += 1,
            }
            if let Some(warned) = flown.warned {
                let names = if warned.parameters.is_empty() {
                    "several together".into()
                } else {
                    warned.parameters.join(", ")
                };
                *summary.warnings.entry(names).or_default() += 1;
            }
            if let Some(v) = flown.violation {
                *summary.violations.entry(v.rule).or_default() += 1;
            }
            summary.faults_begun += flown.began.len();
            summary.broken.extend(broken.map(|b| *b));
        }
        summary.pairs_begun = coverage.begun.len();
        let kinds: BTreeSet<FaultKind> = coverage.begun.keys().map(|(kind, _)| *kind).collect();
        summary.kinds_begun = kinds.len();
        summary.kinds_in_flights_begun = coverage.kinds.len();
        summary.states_in_flights_begun = coverage.states.len();
        summary
    }
    /// Violations without the lists of faults, which --save writes.
    fn rows(&self) -> Vec<BrokenRow<'_>> {
        self.broken
            .iter()
            .map(|b| BrokenRow {
                seed: b.seed,
                violation: &b.violation,
            })
            .collect()
    }
    fn text(&self) -> String {
        let Summary {
            storms,
            landed,
            waits,
            crashed,
            warned,
            warnings,
            faults_begun,
            kinds_begun,
            kinds,
            pairs_begun,
            kinds_in_flights_begun,
            kinds_in_flights,
            states_in_flights_begun,
            states_in_flights,
            storms_per_s,
            judged,
            said,
            ..
        } = self;
        let ends = format!(
            "{storms} storms: {landed} landed, {waits} wait for a stated reason, {crashed} crashed under a fault that excuses it, {} broke a rule",
            self.broken.len()
        );
        let begun = format!(
            "{faults_begun} faults of {kinds_begun} of {kinds} kinds, {pairs_begun} pairs of kind and state; \
             begun in {kinds_in_flights_begun} of {kinds_in_flights} pairs of kind and flight, \
             {states_in_flights_begun} of {states_in_flights} of state and flight; {storms_per_s:.1} storms/s"
        );
        let mut text = format!("{}\n{}", wrapped(&ends), wrapped(&begun));
        if *warned > 0 {
            text += &format!("\n{warned} ended badly with parameters at the maker's default:");
        }
        for (names, storms) in warnings {
            text += &format!("\n{storms:>4}  {names}");
        }
        text += &format!("\nstatements judged at {judged} moments");
        for (rule, moments) in said {
            text += &format!("\n{moments:>6}  broken: {rule}");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID_SEEDS: [u64; 2] = [3, 21];

    #[test]
    fn aims_go_through_all_pairs_of_a_flight() {
        let mut coverage = Coverage::default();
        let storm = Storm::drawn(1, 2);
        assert_eq!(coverage.aim(storm.clone()), storm);
        // The other faults never began, like those of a state that is not reached.
        let first = pairs(storm.flight).next().unwrap();
        coverage.begun.insert(first, 1);
        let all = pairs(storm.flight).count();
        for _ in 0..all {
            coverage.aim(storm.clone());
        }
        let aimed = coverage.aimed.len();
        assert!(aimed + 1 >= all, "{aimed} of {all}");
    }

    /// Storms with lost sources, aborts and stations, in which no page breaks a rule on statements.
    #[test]
    fn statements_in_storms() {
        for seed in SAID_SEEDS {
            let mut observer = StatementObserver::default();
            let storm = Storm::drawn(seed, 3);
            fly_observed(&storm, None, &mut observer, &mut |_, _| {}).unwrap();
            let Statements { judged, broken, .. } = observer.0;
            assert!(
                judged > 100 && broken.is_empty(),
                "seed {seed}: {judged}, {broken:?}"
            );
        }
    }

    #[test]
    fn coverage_by_flight() {
        let began = |state| Flown {
            ending: StormEnding::Landed,
            waits_for: None,
            came_down: None,
            violation: None,
            warned: None,
            began: vec![(FaultKind::Blind, state, 1.0)],
            states: Vec::new(),
            lasted_s: 1.0,
            last_state: state,
        };
        let mut coverage = Coverage::default();
        coverage.add(FlightKind::Landing, &began(State::Descent));
        coverage.add(FlightKind::Sortie, &began(State::Descent));
        // No landing is drawn with faults in that state.
        coverage.add(FlightKind::Landing, &began(State::GaveUp));
        let summary = Summary::of(Vec::new(), &coverage, 1.0);
        let begun = [summary.kinds_in_flights_begun, summary.states_in_flights_begun];
        assert_eq!((begun, summary.pairs_begun), ([2, 2], 2));
        assert!(summary.states_in_flights > 50 && summary.kinds_in_flights == 8 * summary.kinds);
    }

    #[test]
    fn list_without_a_key() {
        let path = std::env::temp_dir().join(format!("alight-list-{}.toml", std::process::id()));
        for (key, advice) in [("wind_mps", "above the first [[fault]]"), ("kind", "[[fault]]\n")] {
            let text = Storm::drawn(1, 2).text();
            let lines = text.lines().filter(|l| !l.starts_with(&format!("{key} = ")));
            fs::write(&path, lines.collect::<Vec<_>>().join("\n")).unwrap();
            let error = read(&path).unwrap_err().to_string();
            assert!(
                error.contains(&format!("`{key}`")) && error.contains(advice),
                "{error}"
            );
        }
        fs::remove_file(path).unwrap();
    }

    #[test]
    fn lists_that_real_processes_fly() {
        let directory = std::env::temp_dir().join(format!("alight-lists-{}", std::process::id()));
        fs::create_dir_all(&directory).unwrap();
        let path = directory.join("list.toml");
        let storm = |flight| Storm {
            flight,
            drones: 1,
            ..Storm::drawn(1, 0)
        };
        for (flight, flies) in [(FlightKind::Landing, true), (FlightKind::TakeOff, false)] {
            fs::write(&path, storm(flight).text()).unwrap();
            assert_eq!(read(&path).unwrap(), storm(flight));
            assert_eq!(read_list(&path).is_ok(), flies, "{flight:?}");
        }
        fs::remove_dir_all(&directory).unwrap();
    }
}

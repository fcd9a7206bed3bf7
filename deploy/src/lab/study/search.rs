//! `alight study search`: numbers that a baseline's authors did not publish, chosen so that it does as
//! well as it can. A coordinate search: one number at a time times or divided by a factor, kept when it
//! does better on the same seeds and seas. Bounded by its rounds.

use std::fmt;

use alight_shared::config::{Check, Keys};
use alight_sim::baselines::Baseline;
use alight_sim::baselines::config::MpcNeConfig;
use alight_sim::harness::outcome::Outcome;
use alight_sim::physics::sea::SeaConfig;
use serde::Serialize;
use serde_json::{Value, json};

use crate::exit::CliError;
use crate::lab::args::{Planner, StudyArgs};
use crate::lab::report::document::write_files;
use crate::lab::scene::Scene;
use crate::lab::trials::{fly_seed, in_parallel, seeds};
use crate::terminal::note;

/// Seas of the search: low, middle and high of Table II.
const SEAS: [&str; 3] = ["0.3,5", "0.5,5", "0.8,5"];
/// Every number is tried twice at most this often, with smaller factors each time.
const FACTORS: [f64; 2] = [2.0, 1.4];
/// A candidate that is behind by this much after half of the seeds is given up.
const ABANDON_MARGIN: f64 = 0.1;

/// A number of the search: its key, and where it is.
type Parameter = (&'static str, ParameterOf);
type ParameterOf = fn(&mut MpcNeConfig) -> Vec<&mut f64>;

/// What Gupta et al. do not publish and what matters to a landing. S keeps its ratio of position to
/// velocity in one of them; h_d is published.
const PARAMETERS: [Parameter; 9] = [
    ("horizontal", |c| c.horizontal.iter_mut().collect()),
    ("horizontal velocity", |c| {
        c.horizontal.iter_mut().skip(1).collect()
    }),
    ("vertical velocity", |c| c.vertical.iter_mut().skip(1).collect()),
    ("increment_weight", |c| vec![&mut c.increment_weight]),
    ("tilt_weight", |c| vec![&mut c.tilt_weight]),
    ("vertical speed limit", |c| {
        c.vertical_limits.iter_mut().take(1).collect()
    }),
    ("press_m", |c| vec![&mut c.press_m]),
    ("place_s", |c| vec![&mut c.place_s]),
    ("walk_m_rad", |c| c.walk_m_rad.iter_mut().collect()),
];

/// The numbers with one of them scaled by the factor `f`, or by as much of it as the configuration takes.
fn scaled(of: &MpcNeConfig, at: ParameterOf, mut f: f64) -> MpcNeConfig {
    for _ in 0..8 {
        let mut tried = *of;
        for value in at(&mut tried) {
            *value *= f;
        }
        if tried.check(&Keys::ROOT).is_ok() {
            return tried;
        }
        f = f.sqrt();
    }
    *of
}

/// What a trial costs: 1 for a failure, else up to 0.2 for time (40 s) and place (0.65 m, where a foot
/// reaches the deck's edge).
fn cost(o: &Outcome) -> f64 {
    let fraction = |v: Option<f64>, most: f64| v.map_or(1.0, |v| (v / most).min(1.0));
    if o.success {
        0.1 * fraction(o.landing_time_s, 40.0) + 0.1 * fraction(o.position_error_m, 0.65)
    } else {
        1.0
    }
}

/// What a set of numbers does.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Score {
    cost: f64,
    successes: usize,
    trials: usize,
    position_m: f64,
    time_s: f64,
    speed_mps: f64,
}

impl Score {
    fn of(outcomes: &[Outcome]) -> Score {
        let mean = |f: fn(&Outcome) -> Option<f64>| {
            let v: Vec<f64> = outcomes.iter().filter_map(f).collect();
            v.iter().sum::<f64>() / v.len().max(1) as f64
        };
        Score {
            cost: mean(|o| Some(cost(o))),
            successes: outcomes.iter().filter(|o| o.success).count(),
            trials: outcomes.len(),
            position_m: mean(|o| o.position_error_m),
            time_s: mean(|o| o.landing_time_s),
            speed_mps: mean(|o| o.touchdown_speed_mps),
        }
    }
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.3}  {}/{} landed, {:.2} m, {:.1} s, {:.2} m/s",
            self.cost, self.successes, self.trials, self.position_m, self.time_s, self.speed_mps
        )
    }
}

/// The scenes of the search.
struct SearchGrid<'a> {
    base: &'a Scene,
    seas: Vec<(&'static str, SeaConfig)>,
    seeds: Vec<u64>,
    jobs: Option<u16>,
}

impl SearchGrid<'_> {
    fn fly(&self, c: &MpcNeConfig, seeds: &[u64]) -> Result<Vec<Outcome>, CliError> {
        let mut nodes = self.base.nodes.clone();
        nodes.baseline = Some(Baseline::MpcNe(*c));
        let work: Vec<(&(&str, SeaConfig), u64)> = seeds
            .iter()
            .flat_map(|s| self.seas.iter().map(move |sea| (sea, *s)))
            .collect();
        in_parallel(self.jobs, "trials", &work, |((name, sea), seed)| {
            let mut scenario = self.base.scenario.clone();
            scenario.sea = sea.clone();
            fly_seed(&scenario, &nodes, *seed, name)
        })
    }

    /// None when it was given up half way.
    fn score(&self, c: &MpcNeConfig, best: Option<&[Outcome]>) -> Result<Option<Vec<Outcome>>, CliError> {
        let (first, rest) = self.seeds.split_at(self.seeds.len().div_ceil(2));
        let mut flown = self.fly(c, first)?;
        let behind = best
            .and_then(|b| b.get(..flown.len()))
            .map_or(0.0, |b| Score::of(&flown).cost - Score::of(b).cost);
        if behind > ABANDON_MARGIN {
            return Ok(None);
        }
        flown.extend(self.fly(c, rest)?);
        Ok(Some(flown))
    }
}

/// Searches, prints every candidate, and ends with the configuration that did best.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    if !args.planners.is_empty() && args.planners != [Planner::MpcNe] {
        return Err(CliError(
            "study search: only mpc-ne has numbers to search for; leave --planners out or give mpc-ne".into(),
        ));
    }
    let base = Scene::of(&args.scene)?;
    let grid = SearchGrid {
        seas: SEAS
            .iter()
            .map(|s| Ok((*s, s.parse().map_err(CliError)?)))
            .collect::<Result<_, CliError>>()?,
        base: &base,
        seeds: seeds(args.seed0, args.trials)?,
        jobs: args.jobs,
    };
    let mut log = csv::Writer::from_writer(Vec::new());
    log.write_record([
        "candidate",
        "cost",
        "successes",
        "trials",
        "position_m",
        "time_s",
        "speed_mps",
    ])
    .map_err(|e| CliError::because("writing search.csv", e))?;
    let mut record = |what: &str, s: &Score| {
        note(args.json, format_args!("{what:<32}{s}"));
        // A vector takes every row.
        let _written = log.serialize((
            what,
            s.cost,
            s.successes,
            s.trials,
            s.position_m,
            s.time_s,
            s.speed_mps,
        ));
    };
    let mut best = MpcNeConfig::default();
    let mut flown = grid.score(&best, None)?.unwrap_or_default();
    record("as configured", &Score::of(&flown));
    for factor in FACTORS {
        for (name, at) in PARAMETERS {
            for f in [factor, 1.0 / factor] {
                let tried = scaled(&best, at, f);
                let what = format!("{name} x {f:.2}");
                let Some(outcomes) = grid.score(&tried, Some(&flown))? else {
                    note(args.json, format_args!("{what:<32}given up half way"));
                    continue;
                };
                let score = Score::of(&outcomes);
                let better = score.cost < Score::of(&flown).cost;
                record(&format!("{what}{}", if better { " kept" } else { "" }), &score);
                if better {
                    (best, flown) = (tried, outcomes);
                    // The other way is where it came from.
                    break;
                }
            }
        }
    }
    let toml = |text: Result<String, toml::ser::Error>| {
        text.map_err(|e| CliError::because("writing the configuration", e))
    };
    note(
        args.json,
        format_args!("best:\n{}", toml(toml::to_string(&best))?),
    );
    if let Some(out) = &args.out {
        let log = log
            .into_inner()
            .map_err(|e| CliError::because("writing search.csv", e))?;
        let log = String::from_utf8_lossy(&log).into_owned();
        write_files(
            out,
            &[
                ("search.csv", log),
                ("mpc-ne.toml", toml(toml::to_string(&best))?),
            ],
        )?;
    }
    let mut value = json!(Score::of(&flown));
    value["planner"] = Baseline::MpcNe(best).name().into();
    value["configuration"] = json!(best);
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn search_parameters() {
        for (name, at) in PARAMETERS {
            for f in [4.0, 0.25] {
                let c = scaled(&MpcNeConfig::default(), at, f);
                assert_ne!(c, MpcNeConfig::default(), "{name}");
                c.check(&Keys::ROOT).unwrap();
            }
        }
    }
}

//! How often a landing is unsafe where that is rare: splitting by how near to a limit a landing comes.
//!
//! A population of landings is flown; the quarter that came nearest to a limit is kept, and each of it goes on as a chain:
//! some of its random streams are drawn anew (the sea, the wind, a sensor), and the landing that follows takes the place of
//! the one before where it comes at least as near. After `k` levels the probability is the product of the shares that were
//! kept, times the share of the last population that is beyond a limit:
//! `P = p_1 p_2 ... p_k p_last` (Kahn and Harris 1951; subset simulation, Au and Beck 2001). Each population is flown from
//! the beginning: no state of a flight is copied. Several runs that know nothing of each other give mean and interval.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use crate::harness::outcome::Outcome;
use crate::harness::scenario::{NodeConfigs, Scenario, SetupError};
use crate::harness::tap::NoTap;
use crate::harness::trial::{self, Watch};
use crate::harness::world::World;
use crate::physics::streams::{GROUPS, Streams};

/// Share of a population that is kept.
const KEPT: f64 = 0.25;
/// Levels, at most: below 1e-6 no population of this size says anything.
const MAX_LEVELS: usize = 10;
/// Each group of streams is drawn anew with this probability in a move.
const REDRAWN: f64 = 0.4;
/// Quantile of Student's distribution for a two-sided interval of 95 %, by the degrees of freedom from 1 on.
const STUDENT: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// One run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Probability that a landing is unsafe.
    pub probability: f64,
    /// The levels: how near to a limit a landing had to come, 1 is the limit.
    pub levels: Vec<f64>,
    /// Landings that were flown.
    pub landings: usize,
}

/// Several runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Mean of the runs' probabilities.
    pub probability: f64,
    /// Its interval of 95 %, by Student's distribution over the runs; from 0 to 1 with one run.
    pub interval: [f64; 2],
    /// Landings that were flown.
    pub landings: usize,
    /// The runs.
    pub runs: Vec<Run>,
}

impl Estimate {
    /// Of these runs; none without any.
    pub fn of(runs: Vec<Run>) -> Option<Estimate> {
        let n = runs.len() as f64;
        let mean = runs.iter().map(|r| r.probability).sum::<f64>() / n;
        let interval = match runs.len() {
            0 => return None,
            1 => [0.0, 1.0],
            count => {
                let squares = runs.iter().map(|r| (r.probability - mean).powi(2)).sum::<f64>();
                let student = STUDENT.get(count - 2).copied().unwrap_or(2.262);
                let half = student * (squares / (n - 1.0) / n).sqrt();
                [(mean - half).max(0.0), (mean + half).min(1.0)]
            }
        };
        Some(Estimate {
            probability: mean,
            interval,
            landings: runs.iter().map(|r| r.landings).sum(),
            runs,
        })
    }
}

/// A draw of all streams, and how near to a limit its landing comes.
type Particle = (Streams, f64);

/// One run with populations of `population`; `near` flies a landing and says how near to a limit it comes.
pub fn split<E: Send>(
    population: usize,
    seed: u64,
    near: impl Fn(&Streams) -> Result<f64, E> + Sync,
) -> Result<Run, E> {
    let mut draw = Streams::new(seed).stream("splitting");
    let population = population.max(4);
    let first: Vec<Streams> = (0..population).map(|_| Streams::new(draw.random())).collect();
    let fly = |streams: Vec<Streams>| -> Result<Vec<Particle>, E> {
        streams
            .into_par_iter()
            .map(|s| near(&s).map(|n| (s, n)))
            .collect()
    };
    let mut particles = fly(first)?;
    let mut run = Run {
        probability: 1.0,
        levels: Vec::new(),
        landings: population,
    };
    let share = |particles: &[Particle], level: f64| {
        let beyond = particles.iter().filter(|(_, n)| *n >= level).count();
        beyond as f64 / population as f64
    };
    loop {
        let level = kept_from(&particles);
        let stays = run.levels.last() == Some(&level);
        if level >= 1.0 || stays || run.levels.len() >= MAX_LEVELS {
            run.probability *= share(&particles, 1.0);
            return Ok(run);
        }
        run.probability *= share(&particles, level);
        run.levels.push(level);
        let kept: Vec<Particle> = particles.into_iter().filter(|(_, n)| *n >= level).collect();
        let chained: Vec<Particle> = kept.iter().cycle().take(population).copied().collect();
        let moved = fly(chained.iter().map(|(s, _)| redrawn(s, &mut draw)).collect())?;
        run.landings += population;
        let pairs = chained.into_iter().zip(moved);
        particles = pairs
            .map(|(before, after)| if after.1 >= level { after } else { before })
            .collect();
    }
}

/// The quarter that came nearest comes at least so near.
fn kept_from(particles: &[Particle]) -> f64 {
    let mut near: Vec<f64> = particles.iter().map(|(_, n)| *n).collect();
    near.sort_by(|a, b| b.total_cmp(a));
    let last = (KEPT * near.len() as f64).ceil() as usize;
    near.get(last.saturating_sub(1)).copied().unwrap_or(f64::INFINITY)
}

/// Some of the groups drawn anew, one at least.
fn redrawn(streams: &Streams, draw: &mut ChaCha8Rng) -> Streams {
    let sure = draw.random_range(0..GROUPS);
    (0..GROUPS).fold(*streams, |streams, group| {
        let anew = group == sure || draw.random::<f64>() < REDRAWN;
        let seed = draw.random();
        if anew {
            streams.redrawn(group, seed)
        } else {
            streams
        }
    })
}

/// Lands in the world of these streams; how near to a limit it comes ([`Outcome::limit_ratio`]).
pub fn land(scenario: &Scenario, nodes: &NodeConfigs, streams: &Streams) -> Result<f64, SetupError> {
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    let world = World::new(scenario, nodes, *streams)?;
    let Outcome { limit_ratio, .. } = trial::land(world, scenario, nodes, 0, "", watch, &mut NoTap).outcome;
    Ok(limit_ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A landing whose nearness is the greatest of one uniform number from each of three streams, so that it passes `limit`
    /// in `1 - limit^3` of all.
    fn near(limit: f64) -> impl Fn(&Streams) -> Result<f64, ()> {
        move |streams| {
            let of = |name: &str| streams.stream(name).random::<f64>();
            let greatest = ["sea", "wind", "gnss"].map(of).into_iter().fold(0.0, f64::max);
            Ok(greatest / limit)
        }
    }

    #[test]
    fn splitting_of_a_known_probability() {
        for rarity in [0.1_f64, 1e-3] {
            let limit = (1.0 - rarity).cbrt();
            let runs = (0..8).map(|seed| split(200, seed, near(limit)).unwrap());
            let estimate = Estimate::of(runs.collect()).unwrap();
            let [low, high] = estimate.interval;
            assert!(low < rarity && rarity < high, "{rarity}: {estimate:?}");
            assert!(high < 3.0 * rarity, "{rarity}: {estimate:?}");
            // By chance alone a thousandth takes some ten thousands of landings for that.
            assert!(estimate.landings < 16_000, "{}", estimate.landings);
        }
    }

    #[test]
    fn splitting_of_what_never_or_always_happens() {
        let never = split(20, 1, |_| Ok::<f64, ()>(0.3)).unwrap();
        assert_eq!((never.probability, never.landings), (0.0, 40));
        let always = split(20, 1, |_| Ok::<f64, ()>(1.7)).unwrap();
        assert_eq!((always.probability, always.landings), (1.0, 20));
        assert_eq!(Estimate::of(Vec::new()), None);
        assert_eq!(Estimate::of(vec![never]).unwrap().interval, [0.0, 1.0]);
    }
}

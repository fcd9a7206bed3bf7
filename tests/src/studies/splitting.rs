//! Probability of a rare unsafe landing, by splitting on how close a landing comes to a limit.
//!
//! The quarter of a population that comes closest to a limit is kept. Each of these landings is moved several
//! times: all its random numbers change by a large or small amount, and the new landing replaces the old one
//! if it comes at least as close. After `k` levels, `P = p_1 p_2 ... p_k p_last` is the product of the kept
//! fractions and the fraction of the last population beyond a limit (Kahn and Harris 1951; subset simulation,
//! Au and Beck 2001). Every landing is flown from the start; no state is copied. Independent runs yield a
//! mean and an interval. The estimate has an upward bias of the order of one over the population.

use rand::RngExt;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    harness::{
        observer::NoObserver,
        outcome::Outcome,
        scenario::{NodeConfigs, Scenario, SetupError},
        trial::{self, Watch},
        world::World,
    },
    physics::streams::{MOVES, Stream, Streams},
    studies::statistics::{at_most_95, student_95},
};

const KEPT: f64 = 0.25;
/// Maximum number of levels, each of which is a move; reaches a probability of 1e-6.
const MAX_LEVELS: usize = MOVES;
/// Maximum exponent `n` of a move by `2^-n` of a number's range. The exponent is drawn because the move that
/// suits landings near their limit is not known in advance.
const SMALLEST: u32 = 9;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// A quarter of the last population exceeded a limit.
    Limit,
    /// No landing of the last population came closer than the others; for instance, all were aborted.
    Plateau,
    /// The maximum number of levels was not enough.
    Levels,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SplittingRun {
    pub probability: f64,
    /// Product of the kept fractions, i.e. probability of the set from which the last population is drawn.
    pub reached: f64,
    pub beyond: usize,
    pub end: End,
    /// Limit ratio required at each level; 1 is the limit.
    pub levels: Vec<f64>,
    pub landings: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SplittingEstimate {
    pub probability: f64,
    /// Student's 95 % interval over the runs; starts at 0 with one run. Its upper end is at least the bound from the
    /// last populations alone (Clopper and Pearson 1934). Coverage is lower with few runs of a rare event.
    pub interval: [f64; 2],
    pub landings: usize,
    pub runs: Vec<SplittingRun>,
}

impl SplittingEstimate {
    /// None without runs.
    pub fn of(runs: Vec<SplittingRun>, population: usize) -> Option<SplittingEstimate> {
        let probabilities: Vec<f64> = runs.iter().map(|r| r.probability).collect();
        let n = runs.len() as f64;
        let mean = probabilities.iter().sum::<f64>() / n;
        let reached = runs.iter().map(|r| r.reached).sum::<f64>() / n;
        let beyond = runs.iter().map(|r| r.beyond).sum();
        let open = reached * at_most_95(beyond, population * runs.len());
        let [low, high] = student_95(&probabilities)?;
        let interval = [low.max(0.0), high.max(open).min(1.0)];
        Some(SplittingEstimate {
            probability: mean,
            interval,
            landings: runs.iter().map(|r| r.landings).sum(),
            runs,
        })
    }
}

/// Random streams, and the limit ratio of their landing.
type Particle = (Streams, f64);

/// `near` flies a landing and returns its limit ratio.
pub fn split<E: Send>(
    population: usize,
    seed: u64,
    near: impl Fn(&Streams) -> Result<f64, E> + Sync,
) -> Result<SplittingRun, E> {
    let mut draw = Streams::new(seed).stream("splitting");
    let first: Vec<Streams> = (0..population).map(|_| Streams::new(draw.random())).collect();
    let fly = |streams: Vec<Streams>| -> Result<Vec<Particle>, E> {
        streams
            .into_par_iter()
            .map(|s| near(&s).map(|n| (s, n)))
            .collect()
    };
    let mut particles = fly(first)?;
    let mut levels = Vec::new();
    let mut landings = population;
    let mut reached = 1.0;
    let count = |particles: &[Particle], level: f64| particles.iter().filter(|(_, n)| *n >= level).count();
    let fraction = |count: usize| count as f64 / population as f64;
    loop {
        let next = match next_level(&particles) {
            Some(level) if level >= 1.0 => Err(End::Limit),
            None => Err(End::Plateau),
            Some(_) if levels.len() >= MAX_LEVELS => Err(End::Levels),
            Some(level) => Ok(level),
        };
        let level = match next {
            Ok(level) => level,
            Err(end) => {
                let beyond = count(&particles, 1.0);
                return Ok(SplittingRun {
                    probability: reached * fraction(beyond),
                    reached,
                    beyond,
                    end,
                    levels,
                    landings,
                });
            }
        };
        reached *= fraction(count(&particles, level));
        levels.push(level);
        let kept: Vec<Particle> = particles.into_iter().filter(|(_, n)| *n >= level).collect();
        let chained: Vec<Particle> = kept.iter().cycle().take(population).copied().collect();
        let tried = fly(chained.iter().map(|(s, _)| moved(s, &mut draw)).collect())?;
        landings += population;
        let pairs = chained.into_iter().zip(tried);
        particles = pairs
            .map(|(before, after)| if after.1 >= level { after } else { before })
            .collect();
    }
}

/// Limit ratio that the closest quarter reaches. If all landings reach it, the next larger ratio; None if all
/// are equal.
fn next_level(particles: &[Particle]) -> Option<f64> {
    let mut near: Vec<f64> = particles.iter().map(|(_, n)| *n).collect();
    near.sort_by(|a, b| b.total_cmp(a));
    let last = (KEPT * near.len() as f64).ceil() as usize;
    let quarter = *near.get(last.saturating_sub(1))?;
    let lowest = *near.last()?;
    if quarter > lowest || lowest >= 1.0 {
        return Some(quarter);
    }
    near.into_iter().rev().find(|n| *n > lowest)
}

fn moved(streams: &Streams, draw: &mut Stream) -> Streams {
    streams.moved(draw.random(), draw.random_range(0..=SMALLEST))
}

pub fn land(scenario: &Scenario, nodes: &NodeConfigs, streams: &Streams) -> Result<f64, SetupError> {
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    let world = World::new(scenario, nodes, *streams)?;
    let Outcome { limit_ratio, .. } =
        trial::land(world, scenario, nodes, 0, "", watch, &mut NoObserver).outcome;
    Ok(limit_ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limit ratio is the maximum of three uniform numbers and exceeds `limit` with the probability `1 -
    /// limit^3`; a fraction `broken_off` has no contact.
    fn near(limit: f64, broken_off: f64) -> impl Fn(&Streams) -> Result<f64, ()> {
        move |streams| {
            let uniform = |name: &str| streams.stream(name).random::<f64>();
            let largest = ["sea", "wind", "gnss"]
                .map(uniform)
                .into_iter()
                .fold(0.0, f64::max);
            let flies = uniform("mission") >= broken_off;
            Ok(if flies { largest / limit } else { 0.0 })
        }
    }
    fn estimate(near: impl Fn(&Streams) -> Result<f64, ()> + Sync) -> SplittingEstimate {
        let runs = (0..8).map(|seed| split(200, seed, &near).unwrap());
        SplittingEstimate::of(runs.collect(), 200).unwrap()
    }

    #[test]
    fn splitting_of_a_known_probability() {
        for (rarity, broken_off) in [(0.1_f64, 0.0), (1e-3, 0.0), (0.01, 0.9)] {
            let estimate = estimate(near((1.0 - rarity).cbrt(), broken_off));
            let truth = rarity * (1.0 - broken_off);
            let [low, high] = estimate.interval;
            assert!(low < truth && truth < high, "{rarity}: {estimate:?}");
            assert!(high < 3.0 * truth, "{rarity}: {estimate:?}");
            // Direct simulation of a probability of 1e-3 would need about 10 000 landings.
            assert!(estimate.landings < 16_000, "{}", estimate.landings);
            assert!(estimate.runs.iter().all(|r| r.end == End::Limit), "{estimate:?}");
        }
    }

    #[test]
    fn splitting_of_what_never_or_always_happens() {
        let never = split(20, 1, |_| Ok::<f64, ()>(0.3)).unwrap();
        assert_eq!(
            (never.probability, never.landings, never.end),
            (0.0, 20, End::Plateau)
        );
        let always = split(20, 1, |_| Ok::<f64, ()>(1.7)).unwrap();
        assert_eq!(
            (always.probability, always.landings, always.end),
            (1.0, 20, End::Limit)
        );
        assert_eq!(SplittingEstimate::of(Vec::new(), 20), None);
        assert_eq!(SplittingEstimate::of(vec![always], 20).unwrap().interval[1], 1.0);
        // Forty landings without an event give an upper bound of 7 %.
        let estimate = SplittingEstimate::of(vec![never.clone(), never], 20).unwrap();
        assert!((estimate.interval[1] - 0.0722).abs() < 1e-3, "{estimate:?}");
    }
}

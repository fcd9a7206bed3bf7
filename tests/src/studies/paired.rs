//! Comparison of planners by paired differences on the same seeds, which cancel out the effect of the sea.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::harness::outcome::Outcome;
use crate::studies::statistics::{OutcomeMetric, bootstrap_mean, wilson};

pub const COMPARED: [OutcomeMetric; 6] = [
    ("position_error_m", |o| o.position_error_m),
    ("touchdown_speed_mps", |o| o.touchdown_speed_mps),
    ("tangential_speed_mps", |o| o.tangential_speed_mps),
    ("tilt_error_deg", |o| o.tilt_error_deg),
    ("landing_time_s", |o| o.landing_time_s),
    ("over_deck_time_s", |o| o.over_deck_time_s),
];

/// Mean of `other - first` over pairs that both touched down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    pub metric: &'static str,
    pub mean: f64,
    /// Bootstrap 95 % interval.
    pub interval: [f64; 2],
    pub pairs: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rates {
    /// Number of successes of the first and the other planner.
    pub successes: [usize; 2],
    /// Wilson's 95 % interval of each rate.
    pub wilson: [[f64; 2]; 2],
    /// Number of seeds on which only the first planner succeeds, and only the other.
    pub only: [usize; 2],
    /// `other - first`.
    pub difference: f64,
    /// Bootstrap 95 % interval over pairs.
    pub interval: [f64; 2],
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Scenario of the comparison; None: all scenarios.
    pub scenario: Option<String>,
    pub first: String,
    pub other: String,
    pub pairs: usize,
    pub rates: Rates,
    pub differences: Vec<Difference>,
}

type Pair<'a> = (&'a Outcome, &'a Outcome);

/// Outcomes that exist for both planners, matched by scenario and seed.
pub fn pairs<'a>(outcomes: &'a [Outcome], scenario: Option<&str>, first: &str, other: &str) -> Vec<Pair<'a>> {
    let flown_by = |planner: &str| -> BTreeMap<(&'a str, u64), &'a Outcome> {
        outcomes
            .iter()
            .filter(|o| o.planner == planner && scenario.is_none_or(|s| s == o.sea))
            .map(|o| ((o.sea.as_str(), o.seed), o))
            .collect()
    };
    let others = flown_by(other);
    flown_by(first)
        .into_iter()
        .filter_map(|(key, a)| others.get(&key).map(|b| (a, *b)))
        .collect()
}

/// A `scenario` of None means all of them. None without a common seed.
pub fn compare(outcomes: &[Outcome], scenario: Option<&str>, first: &str, other: &str) -> Option<Comparison> {
    let pairs = pairs(outcomes, scenario, first, other);
    let n = pairs.len();
    let count = |f: &dyn Fn(&Pair<'_>) -> bool| pairs.iter().filter(|p| f(p)).count();
    let successes = [count(&|p| p.0.success), count(&|p| p.1.success)];
    let changes: Vec<f64> = pairs
        .iter()
        .map(|(a, b)| f64::from(i8::from(b.success) - i8::from(a.success)))
        .collect();
    let rates = Rates {
        successes,
        wilson: successes.map(|s| wilson(s, n).into()),
        only: [
            count(&|p| p.0.success && !p.1.success),
            count(&|p| p.1.success && !p.0.success),
        ],
        difference: changes.iter().sum::<f64>() / n.max(1) as f64,
        interval: bootstrap_mean(&changes)?,
    };
    let differences = COMPARED
        .iter()
        .filter_map(|(metric, f)| {
            let d: Vec<f64> = pairs
                .iter()
                .filter_map(|(a, b)| Some(f(b)? - f(a)?))
                .filter(|d| d.is_finite())
                .collect();
            Some(Difference {
                metric,
                interval: bootstrap_mean(&d)?,
                mean: d.iter().sum::<f64>() / d.len() as f64,
                pairs: d.len(),
            })
        })
        .collect();
    Some(Comparison {
        scenario: scenario.map(Into::into),
        first: first.into(),
        other: other.into(),
        pairs: n,
        rates,
        differences,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harness::outcome::Judge;

    fn flown(planner: &str, sea: &str, seed: u64, position: Option<f64>, success: bool) -> Outcome {
        Outcome {
            position_error_m: position,
            success,
            ..Judge::default().outcome(seed, sea, planner, 1.0)
        }
    }

    #[test]
    fn paired_difference_without_the_common_sea() {
        let mut all = Vec::new();
        for seed in 0..40 {
            let sea = 0.1 * (seed % 7) as f64;
            all.push(flown("a", "x", seed, Some(sea), true));
            // Outcomes in a different order, with one seed more than the first planner has.
            all.insert(0, flown("b", "x", seed, Some(sea + 0.05), seed % 4 != 0));
        }
        all.push(flown("b", "x", 99, Some(9.0), false));
        all.push(flown("b", "y", 1, Some(9.0), false));
        let c = compare(&all, Some("x"), "a", "b").unwrap();
        assert_eq!(
            (c.pairs, c.rates.successes, c.rates.only),
            (40, [40, 30], [10, 0])
        );
        let d = c.differences[0];
        assert!((d.mean - 0.05).abs() < 1e-12 && d.interval.iter().all(|i| (i - 0.05).abs() < 1e-12));
        assert!((c.rates.difference + 0.25).abs() < 1e-12);
        assert!(c.rates.interval[0] < -0.25 && c.rates.interval[1] > -0.25);
        assert!(compare(&all, Some("y"), "a", "b").is_none());
    }

    #[test]
    fn paired_rates_with_a_trial_without_contact() {
        let all = [
            flown("a", "x", 1, Some(0.1), true),
            flown("b", "x", 1, None, false),
            flown("a", "x", 2, Some(0.1), true),
            flown("b", "x", 2, Some(0.4), true),
        ];
        let c = compare(&all, None, "a", "b").unwrap();
        assert_eq!((c.pairs, c.differences[0].pairs), (2, 1));
        assert!((c.differences[0].mean - 0.3).abs() < 1e-12);
    }
}

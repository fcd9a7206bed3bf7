//! Comparison of planners by paired differences on the same seeds, which cancel out the effect of the sea.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::{
    harness::outcome::Outcome,
    studies::statistics::{OutcomeMetric, bootstrap_mean, wilson},
};

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
    /// Planner with which another is compared.
    pub first: String,
    pub pairs: usize,
    pub rates: Rates,
    pub differences: Vec<Difference>,
}

/// Outcomes of two planners in the same scenario with the same seed.
struct Pair<'a> {
    first: &'a Outcome,
    other: &'a Outcome,
}

/// Compares another planner's outcomes with the first one's. None without a common scenario and seed.
pub fn compare(first: &[&Outcome], other: &[&Outcome]) -> Option<Comparison> {
    let others: BTreeMap<(&str, u64), &Outcome> =
        other.iter().map(|o| ((o.sea.as_str(), o.seed), *o)).collect();
    let pairs: Vec<Pair<'_>> = first
        .iter()
        .filter_map(|first| {
            let other = others.get(&(first.sea.as_str(), first.seed))?;
            Some(Pair { first, other })
        })
        .collect();
    let count = |is_counted: fn(&Pair<'_>) -> bool| pairs.iter().filter(|p| is_counted(p)).count();
    let successes = [count(|p| p.first.success), count(|p| p.other.success)];
    let changes: Vec<f64> = pairs
        .iter()
        .map(|p| f64::from(i8::from(p.other.success) - i8::from(p.first.success)))
        .collect();
    let rates = Rates {
        successes,
        wilson: successes.map(|s| wilson(s, pairs.len()).into()),
        only: [
            count(|p| p.first.success && !p.other.success),
            count(|p| p.other.success && !p.first.success),
        ],
        difference: changes.iter().sum::<f64>() / pairs.len().max(1) as f64,
        interval: bootstrap_mean(&changes)?,
    };
    let difference = |(metric, value): &OutcomeMetric| {
        let changes: Vec<f64> = pairs
            .iter()
            .filter_map(|p| Some(value(p.other)? - value(p.first)?))
            .filter(|d| d.is_finite())
            .collect();
        Some(Difference {
            metric,
            interval: bootstrap_mean(&changes)?,
            mean: changes.iter().sum::<f64>() / changes.len() as f64,
            pairs: changes.len(),
        })
    };
    Some(Comparison {
        first: pairs.first()?.first.planner.clone(),
        pairs: pairs.len(),
        rates,
        differences: COMPARED.iter().filter_map(difference).collect(),
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
    fn compared(all: &[Outcome]) -> Option<Comparison> {
        let (first, other): (Vec<&Outcome>, Vec<&Outcome>) = all.iter().partition(|o| o.planner == "a");
        compare(&first, &other)
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
        let c = compared(&all).unwrap();
        assert_eq!(
            (c.pairs, c.rates.successes, c.rates.only),
            (40, [40, 30], [10, 0])
        );
        let d = c.differences[0];
        assert!((d.mean - 0.05).abs() < 1e-12 && d.interval.iter().all(|i| (i - 0.05).abs() < 1e-12));
        assert!((c.rates.difference + 0.25).abs() < 1e-12);
        assert!(c.rates.interval[0] < -0.25 && c.rates.interval[1] > -0.25);
        all.retain(|o| (&o.planner, &o.sea) != (&"b".into(), &"x".into()));
        assert!(compared(&all).is_none());
    }

    #[test]
    fn paired_rates_with_a_trial_without_contact() {
        let all = [
            flown("a", "x", 1, Some(0.1), true),
            flown("b", "x", 1, None, false),
            flown("a", "x", 2, Some(0.1), true),
            flown("b", "x", 2, Some(0.4), true),
        ];
        let c = compared(&all).unwrap();
        assert_eq!((c.pairs, c.differences[0].pairs), (2, 1));
        assert!((c.differences[0].mean - 0.3).abs() < 1e-12);
    }
}

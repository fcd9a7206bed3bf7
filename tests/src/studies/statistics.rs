use alight_shared::estimation::quantile;
use serde::Serialize;

use crate::harness::outcome::{Ending, Outcome};

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SampleStatistics {
    pub mean: f64,
    pub sd: f64,
    pub p50: f64,
    pub p95: f64,
    pub max: f64,
}

impl SampleStatistics {
    /// None without values. Percentiles and maximum use the signed values; `sd` is the spread of these values.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<SampleStatistics> {
        let mut v: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
        let p50 = quantile(&mut v, 0.5)?;
        let p95 = quantile(&mut v, 0.95)?;
        let n = v.len() as f64;
        let last = *v.last()?;
        let mean = v.iter().sum::<f64>() / n;
        let var = v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        Some(SampleStatistics {
            mean,
            sd: var.sqrt(),
            p50,
            p95,
            max: last,
        })
    }
}

/// Wilson's 95 % score interval of a rate (Wilson 1927).
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    if trials == 0 {
        return (0.0, 1.0);
    }
    let n = trials as f64;
    let z = 1.959_964;
    let p = successes as f64 / n;
    let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    ((centre - half).max(0.0), (centre + half).min(1.0))
}

/// Number of successes without a failure for which the lower end of [`wilson`] reaches `rate`: `n / (n + z^2)
/// >= rate`. It is below 40 000, because a rate of 1 cannot be shown.
pub fn successes_to_show(rate: f64) -> usize {
    let z2 = 1.959_964_f64.powi(2);
    let n = (z2 * rate / (1.0 - rate).max(1e-4)).ceil();
    n.max(1.0) as usize
}

/// Upper end of the one-sided 95 % interval of a rate (Clopper and Pearson 1934): the largest `p` with `P(X
/// <= events) >= 0.05`, X binomial with `trials` and `p`. Coverage is at least 95 % at any rate.
pub fn at_most_95(events: usize, trials: usize) -> f64 {
    if events >= trials {
        return 1.0;
    }
    let n = trials as f64;
    // Computed in logarithms, each term from the previous one, because (1 - p)^n alone underflows f64.
    let tail = |p: f64| {
        let mut log_term = n * (-p).ln_1p();
        let odds = (p / (1.0 - p)).ln();
        let mut sum = log_term.exp();
        for k in 1..=events {
            log_term += ((n - k as f64 + 1.0) / k as f64).ln() + odds;
            sum += log_term.exp();
        }
        sum
    };
    let mut low = events as f64 / n;
    let mut high = 1.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tail(middle) >= 0.05 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// Student's two-sided 95 % interval of the mean of independent values; unbounded for one value, None without values.
pub fn student_95(values: &[f64]) -> Option<[f64; 2]> {
    // Quantiles by degrees of freedom, from 1.
    const STUDENT: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];
    let SampleStatistics { mean, sd, .. } = SampleStatistics::of(values.iter().copied())?;
    let half = match values.len() {
        1 => f64::INFINITY,
        // With more degrees of freedom the quantile is smaller.
        count => STUDENT.get(count - 2).copied().unwrap_or(2.262) * sd / (count as f64).sqrt(),
    };
    Some([mean - half, mean + half])
}

/// Percentile bootstrap (Efron 1979) of the mean: 95 % interval from 1000 resamples with a fixed stream, so
/// that reports are reproducible. None without values.
pub fn bootstrap_mean(values: &[f64]) -> Option<[f64; 2]> {
    use rand_chacha::rand_core::Rng;
    const RESAMPLES: usize = 1000;
    let n = values.len();
    if n == 0 {
        return None;
    }
    let mut rng = crate::physics::streams::Streams::new(0).stream("bootstrap");
    let mut drawn = || values.get((rng.next_u64() % n as u64) as usize);
    let mut mean = || (0..n).filter_map(|_| drawn()).sum::<f64>() / n as f64;
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| mean()).collect();
    means.sort_by(f64::total_cmp);
    Some([
        *means.get(RESAMPLES / 40)?,
        *means.get(RESAMPLES - RESAMPLES / 40 - 1)?,
    ])
}

pub type OutcomeMetric = (&'static str, fn(&Outcome) -> Option<f64>);

/// Metrics, named as in the outcome, and their sources.
pub const METRICS: &[OutcomeMetric] = &[
    ("position_error_m", |o| o.position_error_m),
    ("rest_position_error_m", |o| o.rest_position_error_m),
    ("touchdown_speed_mps", |o| o.touchdown_speed_mps),
    ("tangential_speed_mps", |o| o.tangential_speed_mps),
    ("tilt_error_deg", |o| o.tilt_error_deg),
    ("roll_error_deg", |o| o.roll_error_deg),
    ("pitch_error_deg", |o| o.pitch_error_deg),
    ("yaw_error_deg", |o| o.yaw_error_deg),
    ("landing_time_s", |o| o.landing_time_s),
    ("over_deck_time_s", |o| o.over_deck_time_s),
    ("stop_time_s", |o| o.stop_time_s),
    ("radio_age_s", |o| o.radio_age_s),
    ("vision_age_s", |o| o.vision_age_s),
    ("attempts", |o| Some(f64::from(o.attempts))),
    ("sim_time_s", |o| Some(o.sim_time_s)),
    ("wall_time_s", |o| Some(o.wall_time_s)),
    ("solve_p99_ms", |o| o.solve_p99_ms),
];

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FailureCount {
    pub outcome: &'static str,
    /// Reason in which each number is replaced by `N`.
    pub reason: String,
    pub count: u32,
    /// Seed of the first trial.
    pub seed: u64,
}

/// Number of failures by ending and reason, most frequent first.
fn count_failures<'a>(failures: impl Iterator<Item = (Ending, &'a str, u64)>) -> Vec<FailureCount> {
    let mut counts: Vec<FailureCount> = Vec::new();
    for (ending, reason, seed) in failures {
        let outcome = ending.name();
        let reason = without_numbers(reason);
        match counts
            .iter_mut()
            .find(|c| (c.outcome, &c.reason) == (outcome, &reason))
        {
            Some(c) => c.count += 1,
            None => counts.push(FailureCount {
                outcome,
                reason,
                count: 1,
                seed,
            }),
        }
    }
    counts.sort_by_key(|c| core::cmp::Reverse(c.count));
    counts
}

fn without_numbers(text: &str) -> String {
    let is_figure = |part: &str| {
        let digits = part.trim_start_matches(['-', '+']);
        digits.starts_with(|c: char| c.is_ascii_digit())
    };
    let mut out: Vec<String> = Vec::new();
    for part in text.split(' ') {
        let (before, figure) = part.split_at(part.len() - part.trim_start_matches('(').len());
        let end = figure.rfind(|c: char| c.is_ascii_digit()).map_or(0, |k| k + 1);
        out.push(match figure.get(end..) {
            Some(after) if is_figure(figure) => format!("{before}N{after}"),
            Some(_) | None => part.to_owned(),
        });
    }
    out.join(" ")
}

/// Summary of trials; its metrics cover trials that touched the deck.
#[derive(Clone, Debug)]
pub struct Summary {
    pub trials: usize,
    pub successes: usize,
    /// Number of trials without a landing in time and without a contact beyond its limits.
    pub rejected: usize,
    /// Number of descents begun, and number of those that ended badly: neither at rest on the deck nor
    /// aborted without contact.
    pub descents: [u32; 2],
    /// Number of all other trials.
    pub unsafe_trials: usize,
    pub unsafe_contacts: u32,
    pub water_contacts: u32,
    /// Number of entries into keep-out volumes; None without volumes.
    pub keep_out_collisions: Option<u32>,
    pub contacts_above_2_mps: u32,
    pub failures: Vec<FailureCount>,
    /// Endings of last descents, binned by predicted probability of success.
    pub likelihood: Vec<OddsBin>,
    /// Unsafe contacts of last descents, binned by predicted probability.
    pub harm: Vec<OddsBin>,
    /// Calibration by the probability predicted at the commitment.
    pub committed_harm: Vec<OddsBin>,
    pub metrics: Vec<(&'static str, Option<SampleStatistics>)>,
}

/// Bin bounds for the probability of success, and for that of an unsafe contact.
const LIKELIHOODS: [f64; 7] = [0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0];
const HARMS: [f64; 7] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 1.0];

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OddsBin {
    pub between: [f64; 2],
    pub descents: usize,
    /// Number of descents with the event.
    pub came: usize,
    pub predicted: f64,
    /// Wilson's 95 % interval of that fraction.
    pub interval: (f64, f64),
}

/// Distance from the deck's centre above which a drone has left the deck, m: half the default deck's diagonal.
const LEFT_M: f64 = 1.5;

/// `all` has each predicted probability, and whether the event occurred.
fn binned(bounds: &[f64], all: &[(f64, bool)]) -> Vec<OddsBin> {
    let bins = bounds.windows(2).filter_map(|b| {
        let &[from, to] = b.first_chunk::<2>()?;
        let last = *b.last()? >= 1.0;
        let within = |p: f64| p >= from && (p < to || last);
        let of: Vec<(f64, bool)> = all.iter().filter(|(p, _)| within(*p)).copied().collect();
        let came = of.iter().filter(|(_, came)| *came).count();
        (!of.is_empty()).then(|| OddsBin {
            between: [from, to],
            descents: of.len(),
            came,
            predicted: of.iter().map(|(p, _)| p).sum::<f64>() / of.len() as f64,
            interval: wilson(came, of.len()),
        })
    });
    bins.collect()
}
/// Whether the last descent ended at rest on the deck, and the drone stayed there while observed.
fn has_landed(o: &Outcome) -> bool {
    o.success && o.stay_position_error_m.is_none_or(|m| m < LEFT_M)
}

fn ended_badly(o: &Outcome) -> bool {
    let waited = matches!(o.outcome, Ending::Timeout | Ending::GaveUp);
    let untouched = o.position_error_m.is_none() && o.unsafe_contacts == 0 && o.water_contacts == 0;
    o.attempts > 0 && !o.success && !(waited && untouched)
}

impl Summary {
    pub fn of(outcomes: &[&Outcome]) -> Summary {
        let all = || outcomes.iter().copied();
        let touched = || all().filter(|o| o.position_error_m.is_some());
        let estimated = |of: fn(&Outcome) -> Option<(f64, bool)>| all().filter_map(of).collect::<Vec<_>>();
        Summary {
            trials: outcomes.len(),
            likelihood: binned(&LIKELIHOODS, &estimated(|o| Some((o.likelihood?, has_landed(o))))),
            harm: binned(&HARMS, &estimated(|o| Some((o.harm?, o.is_unsafe())))),
            committed_harm: binned(&HARMS, &estimated(|o| Some((o.committed_harm?, o.is_unsafe())))),
            successes: all().filter(|o| o.success).count(),
            rejected: all().filter(|o| o.is_rejected()).count(),
            descents: [
                all().map(|o| o.attempts).sum(),
                all().map(|o| u32::from(ended_badly(o))).sum(),
            ],
            unsafe_trials: all().filter(|o| o.is_unsafe()).count(),
            unsafe_contacts: all().map(|o| o.unsafe_contacts).sum(),
            water_contacts: all().map(|o| o.water_contacts).sum(),
            keep_out_collisions: all().filter_map(|o| o.keep_out_collisions).reduce(|a, b| a + b),
            contacts_above_2_mps: all().map(|o| o.contacts_above_2_mps).sum(),
            failures: count_failures(
                all()
                    .filter(|o| !o.success)
                    .map(|o| (o.outcome, o.reason.as_str(), o.seed)),
            ),
            metrics: METRICS
                .iter()
                .map(|(name, f)| (*name, SampleStatistics::of(touched().filter_map(f))))
                .collect(),
        }
    }
    pub fn metric(&self, name: &str) -> Option<SampleStatistics> {
        self.metrics
            .iter()
            .find(|(n, _)| *n == name)
            .and_then(|(_, f)| *f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_interval_of_published_values() {
        // 95 of 100 give 0.8883 to 0.9785 (Newcombe 1998, table I, method 3).
        let (lo, hi) = wilson(95, 100);
        assert!(
            (lo - 0.8882).abs() < 5e-4 && (hi - 0.9785).abs() < 5e-4,
            "{lo} {hi}"
        );
        assert!(wilson(100, 100).0 > 0.96);
    }

    #[test]
    fn upper_bound_of_published_values() {
        // Without an event the bound is 1 - 0.05^(1/n), about 3/n (Hanley and Lippman-Hand 1983).
        for n in [1, 5, 35, 100, 3000] {
            let exact = 1.0 - 0.05_f64.powf(1.0 / n as f64);
            assert!((at_most_95(0, n) - exact).abs() < 1e-9, "{n}");
        }
        // Upper end of the two-sided 90 % interval: 0.3942 for 1 of 10, 0.7776 for 5 of 10 (tables of Clopper
        // and Pearson).
        for (k, n, p) in [(1, 10, 0.3942), (5, 10, 0.7776), (10, 10, 1.0), (0, 0, 1.0)] {
            assert!(
                (at_most_95(k, n) - p).abs() < 1e-4,
                "{k} of {n}: {}",
                at_most_95(k, n)
            );
        }
        // Far outside the range of (1 - p)^n; must be close to the normal approximation.
        assert!((at_most_95(20_000, 40_000) - (0.5 + 1.645 * 0.5 / 200.0)).abs() < 1e-4);
    }

    #[test]
    fn student_interval_of_four_values() {
        // Mean 2.5, standard deviation 1.2910; 3.182 times half of it.
        let [low, high] = student_95(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert!(
            (low - 0.446).abs() < 1e-3 && (high - 4.554).abs() < 1e-3,
            "{low} {high}"
        );
        assert_eq!(student_95(&[]), None);
        assert_eq!(student_95(&[1.0]), Some([f64::NEG_INFINITY, f64::INFINITY]));
    }

    #[test]
    fn successes_that_show_a_rate() {
        for rate in [0.5, 0.8, 0.9, 0.95, 0.99] {
            let n = successes_to_show(rate);
            assert!(
                wilson(n, n).0 >= rate && wilson(n - 1, n - 1).0 < rate,
                "{rate}: {n}"
            );
        }
        assert_eq!(successes_to_show(0.9), 35);
    }

    #[test]
    fn bootstrap_interval_against_the_normal_one() {
        let values: Vec<f64> = (0..200).map(|k| f64::from(k % 20)).collect();
        let [lo, hi] = bootstrap_mean(&values).unwrap();
        // The sd is 5.77, so the interval is the mean of 9.5 ± 1.96 sd / sqrt(200) = 0.80.
        assert!((lo - 8.7).abs() < 0.15 && (hi - 10.3).abs() < 0.15, "{lo} {hi}");
    }

    #[test]
    fn failures_by_ending_and_reason() {
        let failures = [
            (Ending::GaveUp, "the mission gave up at attempt 4", 2),
            (Ending::Hard, "contact at 1.32 m/s (limit 1)", 3),
            (Ending::Hard, "contact at 1.05 m/s (limit 1)", 4),
            (Ending::Hard, "contact at -0.1 m/s (limit 1)", 5),
            (Ending::Water, "in the water after 41.0 s", 6),
        ];
        let counts = count_failures(failures.into_iter());
        let count = |outcome, reason: &str, count, seed| FailureCount {
            outcome,
            reason: reason.into(),
            count,
            seed,
        };
        assert_eq!(
            counts,
            [
                count("hard", "contact at N m/s (limit N)", 3, 3),
                count("gave-up", "the mission gave up at attempt N", 1, 2),
                count("water", "in the water after N s", 1, 6),
            ]
        );
    }

    #[test]
    fn sample_statistics_of_a_known_set() {
        let f = SampleStatistics::of((1..=100).map(f64::from)).unwrap();
        assert_eq!((f.mean, f.p50, f.p95, f.max), (50.5, 50.0, 95.0, 100.0));
        assert!(SampleStatistics::of([]).is_none());
    }
}

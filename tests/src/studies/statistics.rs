//! Figures over many trials, with intervals.

use serde::Serialize;

use crate::harness::outcome::{Ending, Outcome};

/// Mean, standard deviation, 95th percentile and maximum of one figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SampleStatistics {
    /// Arithmetic mean.
    pub mean: f64,
    /// Sample standard deviation.
    pub sd: f64,
    /// 95th percentile (nearest rank).
    pub p95: f64,
    /// Maximum.
    pub max: f64,
}

impl SampleStatistics {
    /// Of the given values; None without any. Percentile and maximum are of the values as they
    /// are: for signed figures the spread is `sd`.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<SampleStatistics> {
        let mut v: Vec<f64> = values.into_iter().filter(|x| x.is_finite()).collect();
        v.sort_by(f64::total_cmp);
        let n = v.len() as f64;
        let (last, mean) = (*v.last()?, v.iter().sum::<f64>() / n);
        let var = v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        let rank = ((0.95 * n).ceil() as usize).clamp(1, v.len()) - 1;
        Some(SampleStatistics {
            mean,
            sd: var.sqrt(),
            p95: v.get(rank).copied().unwrap_or(last),
            max: last,
        })
    }
}

/// Wilson's 95 % score interval of a rate (Wilson 1927).
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    if trials == 0 {
        return (0.0, 1.0);
    }
    let (n, z) = (trials as f64, 1.959_964);
    let p = successes as f64 / n;
    let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    ((centre - half).max(0.0), (centre + half).min(1.0))
}

/// Percentile bootstrap (Efron 1979) of the mean: its 95 % interval from 1000 resamples of a fixed
/// stream, so that a report is reproducible. None without values.
pub fn bootstrap_mean(values: &[f64]) -> Option<[f64; 2]> {
    bootstrap(values, |v| v.iter().sum::<f64>() / v.len() as f64)
}

/// The same for any statistic of a sample. `values` may be pairs: what is drawn stays together.
pub fn bootstrap<T: Copy>(values: &[T], statistic: impl Fn(&[T]) -> f64) -> Option<[f64; 2]> {
    use rand_chacha::rand_core::Rng;
    const RESAMPLES: usize = 1000;
    let n = values.len();
    if n == 0 {
        return None;
    }
    let mut rng = crate::physics::streams::Streams::new(0).stream("bootstrap");
    let mut drawn = Vec::with_capacity(n);
    let mut results: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            drawn.clear();
            drawn.extend((0..n).filter_map(|_| values.get((rng.next_u64() % n as u64) as usize)));
            statistic(&drawn)
        })
        .collect();
    results.sort_by(f64::total_cmp);
    Some([
        *results.get(RESAMPLES / 40)?,
        *results.get(RESAMPLES - RESAMPLES / 40 - 1)?,
    ])
}

/// A named figure of an outcome.
pub type Metric = (&'static str, fn(&Outcome) -> Option<f64>);

/// Every figure of the summary: name (as in the outcome) and where it comes from.
pub const METRICS: &[Metric] = &[
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
];

/// The summary of a set of trials: figures over all that touched.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Number of trials.
    pub trials: usize,
    /// Number of successes.
    pub successes: usize,
    /// Descents begun, and those of them that ended badly: in any other way than at rest on the deck or
    /// broken off without a contact.
    pub descents: [u32; 2],
    /// Contacts that broke the limits.
    pub unsafe_contacts: u32,
    /// Contacts with water.
    pub water_contacts: u32,
    /// Entries into keep-out volumes; None where there are none.
    pub keep_out_collisions: Option<u32>,
    /// Contacts at more than 2 m/s.
    pub contacts_above_2_mps: u32,
    /// Figures under the names of [`METRICS`].
    pub metrics: Vec<(&'static str, Option<SampleStatistics>)>,
}

/// Whether the last descent of a trial ended badly.
fn ended_badly(o: &Outcome) -> bool {
    let waited = matches!(o.outcome, Ending::Timeout | Ending::GaveUp);
    let untouched = o.position_error_m.is_none() && o.unsafe_contacts == 0 && o.water_contacts == 0;
    o.attempts > 0 && !o.success && !(waited && untouched)
}

impl Summary {
    /// Of these outcomes.
    pub fn of(outcomes: &[Outcome]) -> Summary {
        let touched = || outcomes.iter().filter(|o| o.position_error_m.is_some());
        Summary {
            trials: outcomes.len(),
            successes: outcomes.iter().filter(|o| o.success).count(),
            descents: [
                outcomes.iter().map(|o| o.attempts).sum(),
                outcomes.iter().map(|o| u32::from(ended_badly(o))).sum(),
            ],
            unsafe_contacts: outcomes.iter().map(|o| o.unsafe_contacts).sum(),
            water_contacts: outcomes.iter().map(|o| o.water_contacts).sum(),
            keep_out_collisions: outcomes
                .iter()
                .filter_map(|o| o.keep_out_collisions)
                .reduce(|a, b| a + b),
            contacts_above_2_mps: outcomes.iter().map(|o| o.contacts_above_2_mps).sum(),
            metrics: METRICS
                .iter()
                .map(|(name, f)| (*name, SampleStatistics::of(touched().filter_map(f))))
                .collect(),
        }
    }
    /// A figure by name.
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
    fn wilson_interval_matches_published_values() {
        // 95 of 100: 0.8883 to 0.9785 (Newcombe 1998, table I method 3 style check).
        let (lo, hi) = wilson(95, 100);
        assert!(
            (lo - 0.8882).abs() < 5e-4 && (hi - 0.9785).abs() < 5e-4,
            "{lo} {hi}"
        );
        assert!(wilson(100, 100).0 > 0.96);
    }

    #[test]
    fn bootstrap_interval_is_near_the_normal_one() {
        let values: Vec<f64> = (0..200).map(|k| f64::from(k % 20)).collect();
        let [lo, hi] = bootstrap_mean(&values).unwrap();
        // sd 5.77, so 1.96 sd / sqrt(200) = 0.80 about the mean of 9.5.
        assert!((lo - 8.7).abs() < 0.15 && (hi - 10.3).abs() < 0.15, "{lo} {hi}");
    }

    #[test]
    fn sample_statistics_of_a_known_set_are_exact() {
        let f = SampleStatistics::of((1..=100).map(f64::from)).unwrap();
        assert_eq!((f.mean, f.p95, f.max), (50.5, 95.0, 100.0));
        assert!(SampleStatistics::of([]).is_none());
    }
}

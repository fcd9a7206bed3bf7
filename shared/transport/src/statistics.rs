use hdrhistogram::Histogram;

use alight_shared::{bus::ReadCounts, process::InputState, topics::Topic};

#[derive(Clone, Debug)]
pub struct InputStatistics {
    received: ReadCounts,
    ages: Quantiles,
}

impl InputStatistics {
    pub fn new(topic: &'static Topic) -> InputStatistics {
        InputStatistics {
            received: ReadCounts::of(topic),
            ages: Quantiles::default(),
        }
    }
    pub fn count(&mut self, order: Option<(u32, u32)>, at_ns: i64, now_ns: i64) {
        self.received.count(order, at_ns);
        self.ages.add(now_ns.saturating_sub(at_ns) as f64 * 1e-9);
    }
    pub fn state(&self, now_ns: i64) -> InputState {
        InputState {
            read_age_p50_s: self.ages.quantile(0.5),
            read_age_p99_s: self.ages.quantile(0.99),
            ..self.received.state(now_ns)
        }
    }
}

const MAX_US: u64 = 67_000_000;

/// Quantiles of positive times to two digits, with bounded memory.
#[derive(Clone, Debug)]
pub struct Quantiles(Option<Histogram<u32>>);

impl Default for Quantiles {
    fn default() -> Self {
        Quantiles(Histogram::new_with_bounds(1, MAX_US, 2).ok())
    }
}

impl Quantiles {
    /// Counts a time, s, clamped to 1 us and 67 s.
    pub fn add(&mut self, time_s: f64) {
        if let Some(histogram) = &mut self.0 {
            // `as` saturates and maps NaN to zero.
            histogram.saturating_record(((time_s * 1e6) as u64).clamp(1, MAX_US));
        }
    }
    /// The `q` quantile, s; 0 if nothing was counted.
    pub fn quantile(&self, q: f64) -> f64 {
        self.0
            .as_ref()
            .map_or(0.0, |h| h.value_at_quantile(q) as f64 * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::topics;

    #[test]
    fn input_statistics_gaps_and_restarts() {
        let mut statistics = InputStatistics::new(&topics::PLAN);
        // The third message is lost, the fourth overtaken, and one is older than the first.
        let orders = [
            (1, 1),
            (1, 2),
            (1, 5),
            (1, 4),
            (1, 5),
            (1, 4),
            (1, 6),
            (1, 0),
            (2, 90),
            (2, 91),
        ];
        for order in orders {
            statistics.count(Some(order), 0, 3_000_000);
        }
        let state = statistics.state(1_000_000_000);
        assert_eq!((state.received, state.missed), (10, 1));
        assert_eq!(state.age_s, 1.0);
        assert!(
            (0.00298..0.00306).contains(&state.read_age_p50_s),
            "{}",
            state.read_age_p50_s
        );
    }

    #[test]
    fn quantiles_to_two_digits() {
        let mut q = Quantiles::default();
        assert_eq!(q.quantile(0.5), 0.0);
        for k in 1..=1000 {
            q.add(f64::from(k) * 1e-4);
        }
        for (fraction, exact) in [(0.5, 0.05), (0.99, 0.099)] {
            let got = q.quantile(fraction);
            assert!((got / exact - 1.0).abs() < 0.02, "{fraction}: {got}");
        }
        q.add(f64::NAN);
        q.add(f64::INFINITY);
        assert!(q.quantile(1.0) > 60.0);
    }
}

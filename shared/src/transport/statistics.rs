//! What a process read on a topic, counted.

use crate::topics::Topic;
use crate::transport::process::InputState;

/// Statistics of one topic as one process reads it.
#[derive(Clone, Debug)]
pub struct InputStatistics {
    topic: &'static Topic,
    received: u64,
    missed: u64,
    order: Option<(u32, u32)>,
    newest_ns: Option<i64>,
    ages: Quantiles,
}

impl InputStatistics {
    /// Nothing read yet.
    pub fn new(topic: &'static Topic) -> InputStatistics {
        InputStatistics {
            topic,
            received: 0,
            missed: 0,
            order: None,
            newest_ns: None,
            ages: Quantiles::default(),
        }
    }
    /// A message was read.
    pub fn note(&mut self, order: Option<(u32, u32)>, at_ns: i64, now_ns: i64) {
        self.received += 1;
        if let (Some((boot, sequence)), Some((old_boot, old))) = (order, self.order)
            && boot == old_boot
        {
            let step = sequence.wrapping_sub(old);
            // Backwards is a reordered or repeated message, not a gap of four thousand million.
            if (2..1 << 31).contains(&step) {
                self.missed += u64::from(step) - 1;
            }
        }
        self.order = order;
        self.newest_ns = Some(at_ns);
        self.ages.add(now_ns.saturating_sub(at_ns) as f64 * 1e-9);
    }
    /// The figures now.
    pub fn state(&self, now_ns: i64) -> InputState {
        let index = crate::topics::ALL.iter().position(|t| t.name == self.topic.name);
        InputState {
            topic: index.map_or(u32::MAX, |i| i as u32),
            received: self.received,
            missed: self.missed,
            age_s: self
                .newest_ns
                .map_or(f64::INFINITY, |at| now_ns.saturating_sub(at) as f64 * 1e-9),
            read_age_p50_s: self.ages.quantile(0.5),
            read_age_p99_s: self.ages.quantile(0.99),
        }
    }
}

/// Bins per factor of two.
const PER_OCTAVE: usize = 4;
/// Bins: 1 us times 2^(1/4) each, up to about 67 s.
const BINS: usize = 26 * PER_OCTAVE;

/// Quantiles of positive times by a histogram with bins of 19 % width: bounded memory, exact counts.
#[derive(Clone, Debug)]
pub struct Quantiles {
    bins: [u32; BINS],
    total: u64,
}

impl Default for Quantiles {
    fn default() -> Self {
        Quantiles {
            bins: [0; BINS],
            total: 0,
        }
    }
}

impl Quantiles {
    /// Counts a time, s. Below 1 us and above the last bin count as those.
    pub fn add(&mut self, time_s: f64) {
        let bin = ((time_s * 1e6).max(1.0).log2() * PER_OCTAVE as f64) as usize;
        if let Some(count) = self.bins.get_mut(bin.min(BINS - 1)) {
            *count = count.saturating_add(1);
            self.total += 1;
        }
    }
    /// The `q` quantile, s (the upper edge of its bin); 0 when nothing was counted.
    pub fn quantile(&self, q: f64) -> f64 {
        let wanted = (q * self.total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (bin, count) in self.bins.iter().enumerate() {
            seen += u64::from(*count);
            if seen >= wanted {
                return 1e-6 * ((bin + 1) as f64 / PER_OCTAVE as f64).exp2();
            }
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics;

    #[test]
    fn input_statistics_count_gaps_but_not_restarts_or_repetitions() {
        let mut intake = InputStatistics::new(&topics::PLAN);
        for (boot, sequence) in [(1, 1), (1, 2), (1, 5), (1, 4), (1, 5), (2, 90), (2, 91)] {
            intake.note(Some((boot, sequence)), 0, 3_000_000);
        }
        let state = intake.state(1_000_000_000);
        assert_eq!((state.received, state.missed), (7, 2));
        assert_eq!(state.age_s, 1.0);
        assert!(
            (0.003..0.0036).contains(&state.read_age_p50_s),
            "{}",
            state.read_age_p50_s
        );
    }

    #[test]
    fn quantiles_are_exact_to_one_bin() {
        let mut q = Quantiles::default();
        assert_eq!(q.quantile(0.5), 0.0);
        (1..=1000).for_each(|k| q.add(f64::from(k) * 1e-4));
        for (share, exact) in [(0.5, 0.05), (0.99, 0.099)] {
            let got = q.quantile(share);
            assert!(got >= exact && got < exact * 1.2, "{share}: {got}");
        }
        q.add(f64::NAN);
        q.add(f64::INFINITY);
        assert!(q.quantile(1.0) > 60.0);
    }
}

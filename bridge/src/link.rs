//! Statistics of the link: loss from sequence gaps, latency, age of information.

use std::collections::VecDeque;

use alight_shared::{estimation::quantile, time::DroneTime};

const MAX_ARRIVALS: usize = 256;

#[derive(Clone, Copy, Debug)]
struct Admitted {
    at: DroneTime,
    /// Sequence number minus the previous one: 1 without loss.
    advance: u32,
    latency_s: f64,
}

#[derive(Clone, Debug)]
pub struct LinkStatistics {
    window_s: f64,
    arrivals: VecDeque<Admitted>,
    /// Arrivals of estimates that came after a newer one.
    out_of_order: VecDeque<DroneTime>,
    newest_valid: Option<DroneTime>,
    sorted: Vec<f64>,
}

impl LinkStatistics {
    pub fn new(window_s: f64) -> Self {
        LinkStatistics {
            window_s,
            arrivals: VecDeque::with_capacity(MAX_ARRIVALS),
            out_of_order: VecDeque::with_capacity(MAX_ARRIVALS),
            newest_valid: None,
            sorted: Vec::with_capacity(MAX_ARRIVALS),
        }
    }

    pub fn admitted(&mut self, arrival: DroneTime, valid: DroneTime, advance: u32) {
        if self.arrivals.len() == MAX_ARRIVALS {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back(Admitted {
            at: arrival,
            advance: advance.max(1),
            latency_s: (arrival - valid).secs(),
        });
        self.newest_valid = Some(self.newest_valid.map_or(valid, |v| v.max(valid)));
    }

    pub fn out_of_order(&mut self, arrival: DroneTime) {
        if self.out_of_order.len() == MAX_ARRIVALS {
            self.out_of_order.pop_front();
        }
        self.out_of_order.push_back(arrival);
    }

    /// Clears ages and latencies, which refer to the old clock of a restarted vessel.
    pub fn reset(&mut self) {
        self.arrivals.clear();
        self.out_of_order.clear();
        self.newest_valid = None;
    }

    /// Age of the newest admitted estimate, s; infinite without one.
    pub fn age_s(&self, now: DroneTime) -> f64 {
        self.newest_valid
            .map_or(f64::INFINITY, |v| (now - v).secs().max(0.0))
    }

    /// Fractions of missing and overtaken estimates; 0 without estimates. On datagram links the middleware discards
    /// overtaken packets, which count as missing (30 ms of jitter at 30 Hz: 42 % at 30 % actual loss).
    pub fn loss(&mut self, now: DroneTime) -> (f64, f64) {
        let window = self.window_s;
        self.arrivals.retain(|a| (now - a.at).secs() <= window);
        self.out_of_order.retain(|at| (now - *at).secs() <= window);
        let sent: f64 = self.arrivals.iter().map(|a| f64::from(a.advance)).sum();
        if sent > 0.0 {
            // At the window's start, an overtaken estimate may be counted without the gap that it left.
            let used = self.arrivals.len() as f64;
            let late = self.out_of_order.len() as f64;
            ((1.0 - (used + late) / sent).max(0.0), (late / sent).min(1.0))
        } else {
            (0.0, 0.0)
        }
    }

    /// Median and 99th percentile of the latency over the window, s; 0 without estimates.
    pub fn latency_s(&mut self) -> (f64, f64) {
        self.sorted.clear();
        self.sorted.extend(self.arrivals.iter().map(|a| a.latency_s));
        let [p50, p99] = [0.5, 0.99].map(|q| quantile(&mut self.sorted, q).unwrap_or(0.0));
        (p50, p99)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    #[test]
    fn link_statistics_of_known_arrivals() {
        let mut s = LinkStatistics::new(5.0);
        let t = |ms: i64| Time::from_nanos(ms * 1_000_000);
        assert_eq!(s.age_s(t(0)), f64::INFINITY);
        for k in 0..100_i64 {
            // Every fourth estimate follows a lost one; latencies of 1 to 100 ms.
            let advance = if k % 4 == 0 { 2 } else { 1 };
            s.admitted(t(1000 + k), t(1000 + k - (k + 1)), advance);
        }
        assert!((s.loss(t(1100)).0 - 0.2).abs() < 1e-12);
        // Five of the gaps were late estimates.
        for k in 0..5 {
            s.out_of_order(t(1010 + k));
        }
        let (lost, out_of_order) = s.loss(t(1100));
        assert!((lost - 0.16).abs() < 1e-12 && (out_of_order - 0.04).abs() < 1e-12);
        let (p50, p99) = s.latency_s();
        assert!(
            (p50 - 0.050).abs() < 1e-9 && (p99 - 0.099).abs() < 1e-9,
            "{p50} {p99}"
        );
        assert!((s.age_s(t(1100)) - 0.101).abs() < 1e-9);
        assert_eq!(s.loss(t(9000)), (0.0, 0.0), "the window has emptied");
    }
}

//! Value of waiting: probability above which waiting does not pay, by optimal stopping without recall.
//!
//! A second of waiting costs the probability `c`, for battery and crew. A later probability is modelled as a draw from
//! those of the last minute, `P`. Waiting at `p` pays while `E[(P - p)+] > c`, so a landing begins at the `p*` with
//! `E[(P - p*)+] = c` (DeGroot 1970, Optimal statistical decisions, section 13.4).

use alight_shared::time::{DroneClock, Span, Time};

/// Number of stored probabilities: one per second for a minute.
const MAX_DRAWS: usize = 60;
const DRAW_S: f64 = 1.0;

#[derive(Clone, Debug, Default)]
pub struct Waiting {
    draws: Vec<f64>,
    next: usize,
    due: Option<Time<DroneClock>>,
}

impl Waiting {
    /// Adds the probability of a landing that begins at `now`.
    pub fn update(&mut self, now: Time<DroneClock>, p: f64) {
        if self.due.is_some_and(|due| now < due) {
            return;
        }
        self.due = Some(now + Span::from_secs(DRAW_S));
        if self.draws.len() < MAX_DRAWS {
            self.draws.push(p);
        } else if let Some(old) = self.draws.get_mut(self.next) {
            *old = p;
            self.next = (self.next + 1) % MAX_DRAWS;
        }
    }
    /// Probability above which waiting is not worth `cost_per_s`; 0 without draws.
    pub fn threshold(&self, cost_per_s: f64) -> f64 {
        let mut best = self.draws.clone();
        best.sort_by(|a, b| b.total_cmp(a));
        let spent = cost_per_s * DRAW_S * best.len() as f64;
        // The solution for the k best draws, sum (P_i - p) = n c, increases until the next draw is below it.
        let (mut sum, mut threshold) = (0.0, 0.0_f64);
        for (k, p) in best.iter().enumerate() {
            sum += p;
            threshold = threshold.max((sum - spent) / (k as f64 + 1.0));
        }
        threshold
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(draws: impl IntoIterator<Item = f64>) -> Waiting {
        let mut w = Waiting::default();
        for (k, p) in draws.into_iter().enumerate() {
            w.update(Time::from_secs(k as f64), p);
        }
        w
    }
    fn gain(w: &Waiting, p: f64) -> f64 {
        w.draws.iter().map(|d| (d - p).max(0.0)).sum::<f64>() / w.draws.len() as f64
    }

    #[test]
    fn waiting_threshold() {
        let waves = of((0..60).map(|k| 0.9 + 0.08 * (0.7 * f64::from(k)).sin()));
        for cost in [1e-4, 1e-3, 0.01, 0.03] {
            let p = waves.threshold(cost);
            assert!((gain(&waves, p) - cost).abs() < 1e-9, "{cost}: {p}");
        }
        let calm = of([0.99; 30]);
        assert!(calm.threshold(1e-3) < 0.99);
        assert!(of([]).threshold(1e-3) < 1e-9);
    }

    #[test]
    fn waiting_draws_of_the_last_minute() {
        let mut w = of([0.2; 200]);
        assert_eq!(w.draws.len(), MAX_DRAWS);
        (0..100).for_each(|k| w.update(Time::from_secs(200.0 + 0.01 * f64::from(k)), 0.9));
        assert_eq!(w.draws.iter().filter(|d| **d > 0.5).count(), 1);
    }
}

//! Record of one measurement source of a filter, like the aid sources of PX4's EKF2. From it the filter
//! decides whether to use the source, to stop using it, or to accept it again.

use crate::time::{Clock, Time};

/// Maximum ratio between the innovations in a run of rejections. After a jump they are alike; noise makes them differ.
const CONSISTENT: f64 = 2.0;

/// Newest measurement of a source and its innovation in a filter.
#[derive(Clone, Copy, Debug, Default)]
pub struct AidSource<C: Clock> {
    /// Time of the newest measurement.
    pub measured_at: Option<Time<C>>,
    /// Time of the newest fused measurement.
    pub fused_at: Option<Time<C>>,
    /// Innovation of the newest scalar measurement.
    pub innovation: f64,
    /// Consecutive rejections.
    pub rejections: u32,
    /// Time and innovation of the first rejection in the present run of consistent innovations.
    run: Option<(Time<C>, f64)>,
}

impl<C: Clock> AidSource<C> {
    /// Records a scalar measurement made at `at`, with its innovation.
    pub fn record(&mut self, at: Time<C>, innovation: f64, fused: bool) {
        self.measured_at = self.measured_at.max(Some(at));
        self.innovation = innovation;
        if fused {
            self.fused_at = self.fused_at.max(Some(at));
            self.rejections = 0;
            self.run = None;
            return;
        }
        self.rejections = self.rejections.saturating_add(1);
        let continues = |(_, first): &(Time<C>, f64)| {
            let ratio = innovation / first;
            (1.0 / CONSISTENT..=CONSISTENT).contains(&ratio)
        };
        self.run = self.run.filter(continues).or(Some((at, innovation)));
    }
    /// Gate to apply: `closed`, or infinite after `limit` rejections, because the filter is then assumed to be wrong.
    pub fn gate(&self, closed: f64, limit: u32) -> f64 {
        if self.rejections < limit {
            closed
        } else {
            f64::INFINITY
        }
    }
    /// Duration of the present run of consistent rejections, s, and the change of the innovation in it.
    pub fn contradiction(&self) -> (f64, f64) {
        self.run
            .zip(self.measured_at)
            .map_or((0.0, 0.0), |((since, first), at)| {
                ((at - since).secs(), self.innovation - first)
            })
    }
    /// Time since the newest fused measurement, s; infinite before the first.
    pub fn age_s(&self, now: Time<C>) -> f64 {
        self.fused_at.map_or(f64::INFINITY, |t| (now - t).secs().max(0.0))
    }
}

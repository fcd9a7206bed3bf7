//! Age of information at the drone: age of the newest state of the vessel, sampled in every tick.
//! (Ten times a second, as the bridge reports it, is in step with the vessel's 30 Hz and shows one
//! phase of the saw-tooth only.)

use alight_bridge::BridgeOut;
use alight_shared::estimation;
use alight_shared::step::Step;
use alight_shared::time::{DroneClock, Time, TrueTime};

use crate::harness::tap::Tap;

/// Collects the ages from a time on.
#[derive(Clone, Debug)]
pub struct AgeTap {
    from: Time<TrueTime>,
    newest: Option<Time<DroneClock>>,
    ages_s: Vec<f64>,
}

impl AgeTap {
    /// Collects from `from_s` of the world's time on: before, clocks and sessions settle.
    pub fn from(from_s: f64) -> AgeTap {
        AgeTap {
            from: Time::from_secs(from_s),
            newest: None,
            ages_s: Vec::new(),
        }
    }
    /// The `q` quantile, s; NaN when nothing was seen.
    pub fn quantile(&self, q: f64) -> f64 {
        estimation::quantile(&mut self.ages_s.clone(), q).unwrap_or(f64::NAN)
    }
}

impl Tap for AgeTap {
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        let Some(output) = step.output::<BridgeOut>() else {
            return;
        };
        let now: Time<DroneClock> = Time::from_nanos(step.now_ns);
        self.newest = output.estimate.map(|e| e.header.at).or(self.newest);
        if t >= self.from {
            self.ages_s.extend(self.newest.map(|at| (now - at).secs()));
        }
    }
}

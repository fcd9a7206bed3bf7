//! Which part of the record describes the sea best.
//!
//! One tracker shortens its record while its prediction error is large, as in a sea that changes or is broad. But a
//! short record does not resolve waves of nearly one frequency, predicts badly for that reason too, and stays short:
//! on a hull that a steep sea lifts out of the water, where the harmonics of tilt are large, it did so half of the
//! time, with frequencies wrong by up to 7 %. A second tracker therefore keeps the whole record whenever the first
//! does not, and the state of the one that has predicted better is published.

use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::WaveNonlinearity;

use super::record::Record;
use super::tracker::Tracker;
use super::{MotionSample, SeaState, SeaStateConfig};

/// The whole record's state is no longer used when the other's squared error is below this fraction of its own.
const CLEARLY: f64 = 0.7;

/// Identifies the sea from the vessel's own motion.
#[derive(Clone, Debug)]
pub struct Identifier {
    period_s: f64,
    record: Record,
    worked_at: Option<Time<VesselClock>>,
    /// Uses as much of the record as predicts well.
    adaptive: Tracker,
    /// Uses all of it.
    whole: Tracker,
    /// The whole record's state is given out.
    takes_whole: bool,
}

impl Identifier {
    /// An identifier without a record.
    pub fn new(config: &SeaStateConfig) -> Self {
        Self::with(Tracker::new(config), config)
    }

    /// An identifier with known angular frequency (rad/s) and direction (rad) of every component: it fits
    /// amplitudes and phases only. For studies of what not knowing them costs: no
    /// configuration leads here.
    pub fn with_known_waves(config: &SeaStateConfig, components: &[(f64, f64)]) -> Self {
        Self::with(Tracker::with_known_waves(config, components), config)
    }

    fn with(tracker: Tracker, config: &SeaStateConfig) -> Self {
        Identifier {
            whole: tracker.clone(),
            adaptive: tracker,
            takes_whole: false,
            period_s: config.update_period_s,
            record: Record::new(config.window_s, config.bin_s),
            worked_at: None,
        }
    }

    /// Takes a sample; one that is not finite, implausible, repeated or older than the newest is counted and
    /// dropped.
    pub fn push(&mut self, sample: &MotionSample) {
        self.record.push(sample);
    }

    /// Samples dropped so far.
    pub fn rejected(&self) -> u64 {
        self.record.rejected()
    }

    /// Does the work that is due at `now`, at most once in `update_period_s`, and returns the
    /// newest state: `None` before `min_window_s` of record and when the record has gone stale. `nonlinearity`
    /// is by how much the hull's motion is more than the waves' sum.
    pub fn update(&mut self, now: Time<VesselClock>, nonlinearity: WaveNonlinearity) -> Option<&SeaState> {
        let due = self
            .worked_at
            .is_none_or(|t| (now - t).secs().abs() >= self.period_s * 0.999);
        if due {
            self.worked_at = Some(now);
            self.work(now, nonlinearity);
        }
        if self.takes_whole {
            self.whole.state()
        } else {
            self.adaptive.state()
        }
    }

    fn work(&mut self, now: Time<VesselClock>, nonlinearity: WaveNonlinearity) {
        self.adaptive.work(&self.record, now, false, nonlinearity);
        if self.adaptive.uses_all() {
            self.whole = self.adaptive.clone();
            self.takes_whole = true;
            return;
        }
        self.whole.work(&self.record, now, true, nonlinearity);
        let (adaptive, whole) = (
            self.adaptive.long_prediction_error(),
            self.whole.long_prediction_error(),
        );
        let clearly = if self.takes_whole { CLEARLY } else { 1.0 };
        self.takes_whole = self.whole.state().is_some() && adaptive >= clearly * whole;
    }
}

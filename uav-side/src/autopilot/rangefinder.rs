//! Readings of the rangefinder.

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{Header, Message as _, RangeSample};
use alight_shared::topics;

use super::config::AutopilotLinkConfig;
use super::message::DistanceReport;
use super::{DroneTime, Output, OutputHeaders};
use crate::range_witness::{RangeWitness, disagree};

/// No deck is nearer to the rangefinder than the feet by more than this, m.
const BELOW_FEET_M: f64 = 0.10;

/// A reading of the rangefinder; None out of its limits, and of 0 m, which is no reading whatever its limits.
pub(super) fn sample(at: DroneTime, d: &DistanceReport, c: &AutopilotLinkConfig) -> Option<RangeSample> {
    let [low, high] = d.limits_m;
    let sample = RangeSample {
        header: Header::new(0, 0, 0, 0, at),
        range_m: d.range_m,
        variance: d
            .variance
            .filter(|v| *v > 0.0)
            .unwrap_or(c.range_sd_m * c.range_sd_m),
    };
    // A rangefinder without an echo reports its greatest distance.
    (d.range_m > 0.0 && (low..high).contains(&d.range_m) && sample.check().is_ok()).then_some(sample)
}

/// The newest reading, and whether it counts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RangeReadings {
    /// Reading with the feet on the deck, m.
    pub(super) feet_m: f64,
    newest: Option<RangeSample>,
    /// Whether the rangefinder follows the drone.
    pub(super) witness: RangeWitness,
}

impl RangeReadings {
    /// Readings of the drone `geometry`.
    pub(super) fn new(geometry: &DroneGeometry) -> RangeReadings {
        RangeReadings {
            feet_m: geometry.feet_below_m - geometry.rangefinder_m[2],
            ..RangeReadings::default()
        }
    }
    /// Takes a reading; None for one that is no newer than the last.
    pub(super) fn take(
        &mut self,
        mut sample: RangeSample,
        headers: &mut OutputHeaders,
    ) -> Option<RangeSample> {
        if self.newest.is_some_and(|r| sample.header.at <= r.header.at) {
            return None;
        }
        sample.header = headers.next(Output::Range, sample.header.at);
        self.newest = Some(sample);
        self.witness.reads(sample.header.at, sample.range_m);
        Some(sample)
    }
    /// The last fresh reading, m.
    pub(super) fn fresh_m(&self, now: DroneTime) -> Option<f64> {
        let stale_after = topics::RANGE.stale_after;
        let fresh = self.newest.filter(|r| now - r.header.at <= stale_after);
        fresh.map(|r| r.range_m)
    }
    /// Whether this range (m) is one of the deck's: not of a rangefinder that does not follow the drone, none that no deck can
    /// be at, and not against the forecast.
    pub(super) fn believes(&self, range_m: f64, forecast_height: Option<f64>) -> bool {
        let height = range_m - self.feet_m;
        height >= -BELOW_FEET_M && !self.witness.contradicts() && !disagree(height, forecast_height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    #[test]
    fn rangefinder_at_its_limit() {
        let sample = |range_m, variance| {
            let report = DistanceReport {
                time_ms: 0,
                range_m,
                limits_m: [0.0, 10.0],
                variance,
            };
            super::sample(Time::from_secs(1.0), &report, &AutopilotLinkConfig::default())
        };
        assert!(sample(10.0, None).is_none() && sample(f64::NAN, None).is_none());
        // No reading, of a rangefinder that states no minimum distance.
        let none = DistanceReport {
            time_ms: 0,
            range_m: 0.0,
            limits_m: [0.0, 30.0],
            variance: None,
        };
        assert!(super::sample(Time::from_secs(1.0), &none, &AutopilotLinkConfig::default()).is_none());
        let s = sample(2.0, Some(0.0)).unwrap();
        assert!((s.variance - 0.0004).abs() < 1e-12);
    }
}

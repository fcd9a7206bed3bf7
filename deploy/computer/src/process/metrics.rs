use alight_shared::{metrics::MetricValue, process::ProcessState};

use crate::process::snapshot::time;

/// Metrics of a process as text, without counts of zero.
pub fn text(p: &ProcessState) -> String {
    let shown: Vec<String> = p
        .metrics
        .iter()
        .filter_map(|m| {
            let value = match m.value {
                MetricValue::Count(0)
                | MetricValue::AccessRejection(None)
                | MetricValue::ForeignTag(None) => {
                    return None;
                }
                MetricValue::Count(n) => n.to_string(),
                MetricValue::Seconds(s) => time(s),
                MetricValue::Fraction(f) => format!("{:.0} %", 100.0 * f),
                MetricValue::AccessRejection(Some(why)) => why.name().into(),
                MetricValue::ForeignTag(Some(tag)) => tag.to_string(),
                MetricValue::State(state) => state.map_or("-", |s| s.name()).into(),
            };
            Some(format!("{} {value}", m.name.text()))
        })
        .collect();
    shown.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        admission::AccessRejection,
        metrics::MetricName as M,
        msg::{Seq, State},
    };

    #[test]
    fn metric_names_and_units() {
        let vessel = ProcessState {
            metrics: Seq::filled([
                M::SensorReadingsMissed.count(0_u32),
                M::BytesSent.count(1200_u32),
                M::DroneMessageAge.seconds(0.25),
                M::DroneState.with(MetricValue::State(Some(State::Tracking))),
                M::DroneBattery.fraction(0.8),
                M::LastPeerRejection.with(MetricValue::AccessRejection(Some(AccessRejection::Expired))),
                M::MeasurementToEstimateP50.seconds(0.01),
            ]),
            ..ProcessState::default()
        };
        assert_eq!(
            text(&vessel),
            "bytes sent 1200, age of drone message 0.25 s, drone state Tracking, drone battery 80 %, \
             last peer rejected for an expired certificate, measurement to estimate p50 10 ms"
        );
    }
}

//! Metrics of the pilot's process: ages of the newest vessel measurement and of the odometry when the set-point is
//! computed.

use alight_shared::{
    bus::{Edge, RowStep},
    metrics::{Metric, MetricName},
    time::DroneTime,
};
use alight_transport::statistics::Quantiles;
use alight_uav::pilot::Pilot;

use crate::process::run::{NodeView, ProcessEdge};

#[derive(Default)]
pub struct Ages {
    /// Time of the newest forecast, and the age of the vessel measurement at that time, s.
    newest: Option<(DroneTime, f64)>,
    from_vessel: Quantiles,
    from_odometry: Quantiles,
}

impl Edge<Pilot> for Ages {}
impl ProcessEdge<Pilot> for Ages {
    fn stepped(&mut self, sent: &NodeView<'_, Pilot>, step: &RowStep<Pilot>) {
        let RowStep { input, out, .. } = step;
        let newest = input.forecast.as_ref().map(|f| (f.header.at, f.radio_age_s));
        self.newest = newest.or(self.newest);
        if let (Some((at, radio_age_s)), true) = (self.newest, out.set_point.is_some())
            && radio_age_s.is_finite()
        {
            self.from_vessel.add(radio_age_s + (sent.now - at).secs());
        }
        if let Some(d) = &input.drone {
            self.from_odometry.add((sent.now - d.header.at).secs());
        }
    }
    fn metrics(&mut self, _at: &NodeView<'_, Pilot>) -> Vec<Metric> {
        vec![
            MetricName::VesselToSetPointP50.seconds(self.from_vessel.quantile(0.5)),
            MetricName::VesselToSetPointP99.seconds(self.from_vessel.quantile(0.99)),
            MetricName::OdometryToSetPointP50.seconds(self.from_odometry.quantile(0.5)),
            MetricName::OdometryToSetPointP99.seconds(self.from_odometry.quantile(0.99)),
        ]
    }
}

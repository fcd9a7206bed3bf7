//! Metrics of the mission's process in addition to its steps.

use alight_shared::metrics::Metric;
use alight_shared::time::{DroneClock, Time};
use alight_uav::mission::{MissionIn, MissionNode, MissionOut};
use tracing::warn;

use crate::process::shell::AfterStep;

/// Reports why a checkpoint does not count.
pub struct RejectionMetrics;

impl AfterStep<MissionNode> for RejectionMetrics {
    fn after_step(&mut self, _input: &MissionIn, out: &MissionOut, _sent: Time<DroneClock>) -> Vec<Metric> {
        if let Some(why) = out.rejected {
            warn!(
                "the checkpoint of the mission before this one does not count: it is {why}; what a ground station set is \
                 the file's again: set it again before the next landing"
            );
        }
        Vec::new()
    }
}

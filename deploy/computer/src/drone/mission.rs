//! Reports that the mission's process ignores a checkpoint.

use alight_shared::bus::{Edge, RowStep};
use alight_uav::mission::MissionNode;
use tracing::warn;

use crate::process::run::{NodeView, ProcessEdge};

pub struct RejectionReport;

impl Edge<MissionNode> for RejectionReport {}
impl ProcessEdge<MissionNode> for RejectionReport {
    fn stepped(&mut self, _at: &NodeView<'_, MissionNode>, step: &RowStep<MissionNode>) {
        if let Some(why) = step.out.rejected {
            warn!(
                "the checkpoint of the previous mission is ignored: it is {why}; settings from a ground station are lost, and \
                 those of the file apply: set them again before the next landing"
            );
        }
    }
}

//! Report of the mission's process in addition to its steps.

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
                "the checkpoint of the previous mission is ignored: it is {why}; settings of a ground station are \
                 the file's again: set them again before the next landing"
            );
        }
    }
}

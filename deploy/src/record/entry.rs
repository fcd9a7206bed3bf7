//! What is recorded of a node's step: its time, its input bit for bit and a hash of its output.
//!
//! Forecasts and plans are nine tenths of all bytes that flow, and each is another node's output of
//! the same recording. An input therefore names them by their sequence number: the replay feeds the
//! forecast and the plan that it has computed itself, and the hash of each output says whether
//! those are the same bits.

use alight_shared::msg::{
    AutopilotState, Command, DeckForecast, DroneState, MissionState, Plan, RangeSample, SetPoint,
};
use alight_uav::mission::MissionIn;
use alight_uav::pilot::PilotIn;
use alight_uav::planner::PlannerIn;
use serde::{Deserialize, Serialize};

/// Encoding of the channels of this module, as MCAP calls it.
pub const ENCODING: &str = "alight-record";
/// Format of the entries; a replay refuses any other.
pub const FORMAT: u32 = 2;

/// One step of a node.
#[derive(Serialize, Deserialize)]
pub struct Entry<I> {
    /// The node's own time, ns.
    pub now_ns: i64,
    /// What it consumed.
    pub input: I,
    /// [`alight_shared::wire::hash_record`] of what it said.
    pub output: u64,
}

/// A forecast or plan by its sequence number.
type Reference = Option<u32>;

/// The mission's input.
#[derive(Serialize, Deserialize)]
pub struct MissionEntry {
    forecast: Reference,
    plan: Reference,
    drone: Option<DroneState>,
    autopilot: Option<AutopilotState>,
    set_point: Option<SetPoint>,
    command: Option<Command>,
}
/// The planner's input.
#[derive(Serialize, Deserialize)]
pub struct PlannerEntry {
    forecast: Reference,
    mission: Option<MissionState>,
    drone: Option<DroneState>,
    autopilot: Option<AutopilotState>,
}
/// The pilot's input.
#[derive(Serialize, Deserialize)]
pub struct PilotEntry<R> {
    forecast: Reference,
    plan: Reference,
    mission: Option<MissionState>,
    drone: Option<DroneState>,
    autopilot: Option<AutopilotState>,
    ranges: R,
}

fn forecast_id(forecast: Option<&DeckForecast>) -> Reference {
    forecast.map(|f| f.header.sequence)
}
fn plan_id(plan: Option<&Plan>) -> Reference {
    plan.map(|p| p.header.sequence)
}

impl From<&MissionIn> for MissionEntry {
    fn from(i: &MissionIn) -> Self {
        MissionEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            plan: plan_id(i.plan.as_ref()),
            drone: i.drone,
            autopilot: i.autopilot,
            set_point: i.set_point,
            command: i.command,
        }
    }
}
impl From<&PlannerIn> for PlannerEntry {
    fn from(i: &PlannerIn) -> Self {
        PlannerEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            mission: i.mission,
            drone: i.drone,
            autopilot: i.autopilot,
        }
    }
}
impl<'a> From<&'a PilotIn> for PilotEntry<&'a [RangeSample]> {
    fn from(i: &'a PilotIn) -> Self {
        PilotEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            plan: plan_id(i.plan.as_ref()),
            mission: i.mission,
            drone: i.drone,
            autopilot: i.autopilot,
            ranges: &i.ranges,
        }
    }
}

/// A named forecast or plan that the replay has not computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing;

/// Forecasts and plans that are kept: more than can be under way between two nodes.
const KEPT: usize = 128;

/// What the replay has computed, newest last.
#[derive(Default)]
pub struct Computed {
    forecasts: Vec<DeckForecast>,
    plans: Vec<Plan>,
}

impl Computed {
    /// Keeps a forecast.
    pub fn forecast(&mut self, forecast: Option<DeckForecast>) {
        keep(&mut self.forecasts, forecast);
    }
    /// Keeps a plan.
    pub fn plan(&mut self, plan: Option<Plan>) {
        keep(&mut self.plans, plan);
    }
    fn forecast_of(&self, id: Reference) -> Result<Option<DeckForecast>, Missing> {
        find(&self.forecasts, id, |f| f.header.sequence)
    }
    fn plan_of(&self, id: Reference) -> Result<Option<Plan>, Missing> {
        find(&self.plans, id, |p| p.header.sequence)
    }
}

fn keep<T>(kept: &mut Vec<T>, new: Option<T>) {
    let Some(new) = new else { return };
    if kept.len() >= KEPT {
        kept.remove(0);
    }
    kept.push(new);
}

fn find<T: Copy>(kept: &[T], id: Reference, sequence: impl Fn(&T) -> u32) -> Result<Option<T>, Missing> {
    let Some(id) = id else { return Ok(None) };
    let found = kept.iter().rev().find(|t| sequence(t) == id);
    found.copied().map(Some).ok_or(Missing)
}

impl MissionEntry {
    /// The input that was recorded.
    pub fn input(self, computed: &Computed) -> Result<MissionIn, Missing> {
        Ok(MissionIn {
            forecast: computed.forecast_of(self.forecast)?,
            drone: self.drone,
            autopilot: self.autopilot,
            plan: computed.plan_of(self.plan)?,
            set_point: self.set_point,
            command: self.command,
        })
    }
}
impl PlannerEntry {
    /// The input that was recorded.
    pub fn input(self, computed: &Computed) -> Result<PlannerIn, Missing> {
        Ok(PlannerIn {
            forecast: computed.forecast_of(self.forecast)?,
            mission: self.mission,
            drone: self.drone,
            autopilot: self.autopilot,
        })
    }
}
impl PilotEntry<Vec<RangeSample>> {
    /// The input that was recorded.
    pub fn input(self, computed: &Computed) -> Result<PilotIn, Missing> {
        Ok(PilotIn {
            plan: computed.plan_of(self.plan)?,
            mission: self.mission,
            forecast: computed.forecast_of(self.forecast)?,
            drone: self.drone,
            autopilot: self.autopilot,
            ranges: self.ranges,
        })
    }
}

//! Record of a node's step: time, input bit for bit, hash of the output.
//!
//! Forecasts and plans are nine tenths of all bytes that flow, and each is another node's output of
//! the same recording. An input therefore names them by their sequence number: the replay feeds the
//! forecast and the plan that it has computed itself, and the hash of each output says whether
//! those are the same bits. The drone's state comes to four nodes in the same tick: the first entry
//! holds it, the others say that it is the one before.

use alight_shared::msg::{
    AttitudeResponse, AutopilotState, Command, DeckForecast, DeckGrant, DroneState, Header,
    MissionCheckpoint, MissionState, Plan, RangeSample, SetPoint,
};
use alight_shared::time::DroneClock;
use alight_uav::mission::MissionIn;
use alight_uav::pilot::PilotIn;
use alight_uav::planner::PlannerIn;
use serde::{Deserialize, Serialize};

/// Encoding of the channels of this module, as MCAP calls it.
pub const ENCODING: &str = "alight-record";
/// Format of the entries, in recordings and in the flight recorder's files; a replay rejects any other.
pub const FORMAT: u32 = 18;

/// One step of a node.
#[derive(Serialize, Deserialize)]
pub struct Entry<I> {
    /// The node's own time, ns.
    pub now_ns: i64,
    /// What it consumed.
    pub input: I,
    /// [`alight_shared::wire::hash_record`] of its output.
    pub output: u64,
}

/// A forecast or plan by its sequence number.
type Reference = Option<u32>;

/// The drone's state, or that it is the newest in the file.
#[derive(Serialize, Deserialize)]
struct DroneEntry {
    before: bool,
    state: Option<DroneState>,
}

/// Which drone state the file's newest is.
#[derive(Default)]
pub struct Newest(Option<Header<DroneClock>>);

impl Newest {
    /// This one was recorded in full.
    pub fn recorded(&mut self, drone: Option<&DroneState>) {
        if let Some(d) = drone {
            self.0 = Some(d.header);
        }
    }
    fn entry(&mut self, drone: Option<&DroneState>) -> DroneEntry {
        let before = drone.is_some_and(|d| self.0 == Some(d.header));
        self.recorded(drone);
        DroneEntry {
            before,
            state: drone.filter(|_| !before).copied(),
        }
    }
}

/// The mission's input.
#[derive(Serialize, Deserialize)]
pub struct MissionEntry {
    forecast: Reference,
    plan: Reference,
    drone: DroneEntry,
    autopilot: Option<AutopilotState>,
    set_point: Option<SetPoint>,
    commands: Vec<Command>,
    deck: Option<DeckGrant<DroneClock>>,
    ranges: Vec<RangeSample>,
    checkpoint: Option<MissionCheckpoint>,
}
/// The planner's input.
#[derive(Serialize, Deserialize)]
pub struct PlannerEntry {
    forecast: Reference,
    mission: Option<MissionState>,
    drone: DroneEntry,
}
/// The pilot's input.
#[derive(Serialize, Deserialize)]
pub struct PilotEntry<R> {
    forecast: Reference,
    plan: Reference,
    mission: Option<MissionState>,
    drone: DroneEntry,
    autopilot: Option<AutopilotState>,
    ranges: R,
}

fn forecast_id(forecast: Option<&DeckForecast>) -> Reference {
    forecast.map(|f| f.header.sequence)
}
fn plan_id(plan: Option<&Plan>) -> Reference {
    plan.map(|p| p.header.sequence)
}

impl MissionEntry {
    /// Of this input, which comes next in the file.
    pub fn of(i: &MissionIn, newest: &mut Newest) -> Self {
        MissionEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            plan: plan_id(i.plan.as_ref()),
            drone: newest.entry(i.drone.as_ref()),
            autopilot: i.autopilot,
            set_point: i.set_point,
            commands: i.commands.clone(),
            deck: i.deck,
            ranges: i.ranges.clone(),
            checkpoint: i.checkpoint,
        }
    }
}
impl PlannerEntry {
    /// Of this input, which comes next in the file.
    pub fn of(i: &PlannerIn, newest: &mut Newest) -> Self {
        PlannerEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            mission: i.mission,
            drone: newest.entry(i.drone.as_ref()),
        }
    }
}
impl<'a> PilotEntry<&'a [RangeSample]> {
    /// Of this input, which comes next in the file.
    pub fn of(i: &'a PilotIn, newest: &mut Newest) -> Self {
        PilotEntry {
            forecast: forecast_id(i.forecast.as_ref()),
            plan: plan_id(i.plan.as_ref()),
            mission: i.mission,
            drone: newest.entry(i.drone.as_ref()),
            autopilot: i.autopilot,
            ranges: &i.ranges,
        }
    }
}

/// A named forecast or plan that the replay has not computed, or a drone state that no entry before
/// holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing;

/// Forecasts and plans that are kept: more than can be under way between two nodes.
const KEPT: usize = 128;

/// What the replay has computed, newest last.
#[derive(Default)]
pub struct Computed {
    forecasts: Vec<DeckForecast>,
    plans: Vec<Plan>,
    /// The newest that was read.
    drone: Option<DroneState>,
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
    /// Keeps a drone state that was recorded in full.
    pub fn drone(&mut self, drone: Option<DroneState>) {
        self.drone = drone.or(self.drone);
    }
    fn drone_of(&mut self, entry: DroneEntry) -> Result<Option<DroneState>, Missing> {
        if entry.before {
            return self.drone.map(Some).ok_or(Missing);
        }
        self.drone(entry.state);
        Ok(entry.state)
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
    /// Whether the motors may turn, when the autopilot says so.
    pub fn armed(&self) -> Option<bool> {
        self.autopilot.map(|a| a.armed)
    }
    /// How the drone's attitude answers, when a set-point came.
    pub fn response(&self) -> Option<AttitudeResponse> {
        self.set_point.map(|s| s.response)
    }
    /// The input that was recorded.
    pub fn input(self, computed: &mut Computed) -> Result<MissionIn, Missing> {
        Ok(MissionIn {
            forecast: computed.forecast_of(self.forecast)?,
            drone: computed.drone_of(self.drone)?,
            autopilot: self.autopilot,
            plan: computed.plan_of(self.plan)?,
            set_point: self.set_point,
            commands: self.commands,
            deck: self.deck,
            ranges: self.ranges,
            checkpoint: self.checkpoint,
        })
    }
}
impl PlannerEntry {
    /// The input that was recorded.
    pub fn input(self, computed: &mut Computed) -> Result<PlannerIn, Missing> {
        Ok(PlannerIn {
            forecast: computed.forecast_of(self.forecast)?,
            mission: self.mission,
            drone: computed.drone_of(self.drone)?,
        })
    }
}
impl PilotEntry<Vec<RangeSample>> {
    /// The input that was recorded.
    pub fn input(self, computed: &mut Computed) -> Result<PilotIn, Missing> {
        Ok(PilotIn {
            plan: computed.plan_of(self.plan)?,
            mission: self.mission,
            forecast: computed.forecast_of(self.forecast)?,
            drone: computed.drone_of(self.drone)?,
            autopilot: self.autopilot,
            ranges: self.ranges,
        })
    }
}

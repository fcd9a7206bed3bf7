//! Record of a node's step: time, input bit for bit, hash of the output; and whose steps they are.
//!
//! The flight recorder's files hold every input in full: each process is computed again without the others, also after
//! one that was killed. Forecasts and plans are nine tenths of all bytes that flow, and each is another node's output:
//! a recording, all nodes in one file, therefore leaves them out of the inputs and names them by their sequence number.
//! The replay puts in the forecast and the plan that it has computed itself, and the hash of each output shows whether
//! those are the same bits. The drone's state comes to four nodes in the same tick: the first entry holds it, the others
//! state that it is the one before.

use std::collections::BTreeMap;

use alight_bridge::BridgeIn;
use alight_shared::msg::{DeckForecast, DroneState, Header, Plan};
use alight_shared::step::Recorded;
use alight_shared::time::{Clock, DroneClock};
use alight_shared::wire::{self, WireError};
use alight_uav::autopilot::AutopilotIn;
use alight_uav::mission::MissionIn;
use alight_uav::pilot::PilotIn;
use alight_uav::planner::PlannerIn;
use alight_uav::predictor::PredictorIn;
use alight_usv::ComputerIn;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::record::observer::NodeStep;

/// Encoding of a channel of steps, as MCAP calls it.
pub const ENCODING: &str = "alight-step";
/// Format of the entries; a reader rejects any other.
pub const FORMAT: u32 = 21;

/// One step of a node.
#[derive(Serialize, Deserialize)]
pub struct Entry<I> {
    /// The node's own time, ns.
    pub now_ns: i64,
    /// The input of the step.
    pub input: I,
    /// Parts that are left out of the input.
    pub references: References,
    /// [`alight_shared::wire::hash_record`] of its output.
    pub output: u64,
}

/// Appends the entry of a step with its whole input: the bytes of an [`Entry`], whatever the types of input and output.
pub fn append(
    to: &mut Vec<u8>,
    now_ns: i64,
    (input, output): (&dyn Recorded, &dyn Recorded),
) -> Result<(), WireError> {
    wire::append_record(to, &now_ns)?;
    input.append(to)?;
    wire::append_record(to, &(References::default(), output.hash()?))
}

/// Whose steps a file holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartHeader {
    /// Name of the process.
    pub process: String,
    /// The boot id.
    pub boot: u32,
    /// When it began, on the computer's steady clock, ns: the order of a process's starts.
    pub began_ns: i64,
    /// Steps of the start before the first in this file: above zero in the second part and later, and where nothing
    /// could be written before.
    pub first_step: u64,
    /// The text of its configuration.
    pub config: String,
}

impl PartHeader {
    /// As names and values; the configuration is attached as `config`.
    pub fn values(&self, config: &str) -> BTreeMap<String, String> {
        [
            ("format", FORMAT.to_string()),
            ("program", env!("CARGO_PKG_VERSION").into()),
            ("process", self.process.clone()),
            ("boot", self.boot.to_string()),
            ("began_ns", self.began_ns.to_string()),
            ("first_step", self.first_step.to_string()),
            ("config", config.into()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }
    /// A value of such values and the texts attached to them.
    pub fn of(values: &BTreeMap<String, String>, texts: &BTreeMap<String, String>) -> Option<PartHeader> {
        Some(PartHeader {
            process: values.get("process")?.clone(),
            boot: values.get("boot")?.parse().ok()?,
            began_ns: values.get("began_ns")?.parse().ok()?,
            first_step: values.get("first_step")?.parse().ok()?,
            config: texts.get(values.get("config")?)?.clone(),
        })
    }
}

/// A place of an input.
type Slot<'a, T> = Option<&'a mut Option<T>>;

/// The input of a node whose steps are recorded, and what of it others of the same file hold.
pub trait Input: Clone + Serialize + DeserializeOwned {
    /// The predictor's output.
    fn forecast(&mut self) -> Slot<'_, DeckForecast> {
        None
    }
    /// The planner's output.
    fn plan(&mut self) -> Slot<'_, Plan> {
        None
    }
    /// The drone's state.
    fn drone(&mut self) -> Slot<'_, DroneState> {
        None
    }
}

macro_rules! inputs {
    ($($input:ty { $($field:ident: $message:ty),* })*) => {
        $(impl Input for $input {
            $(fn $field(&mut self) -> Slot<'_, $message> {
                Some(&mut self.$field)
            })*
        })*
    };
}
inputs! {
    ComputerIn {}
    BridgeIn { forecast: DeckForecast, drone: DroneState }
    PredictorIn { drone: DroneState }
    MissionIn { forecast: DeckForecast, plan: Plan, drone: DroneState }
    PlannerIn { forecast: DeckForecast, drone: DroneState }
    PilotIn { forecast: DeckForecast, plan: Plan, drone: DroneState }
    AutopilotIn {}
}

/// Parts that are left out of an input, and the place of their content: nothing in the flight recorder's files.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct References {
    /// Boot id and sequence number.
    forecast: Option<(u32, u32)>,
    /// The text for an error.
    plan: Option<(u32, u32)>,
    /// It is the newest in the file.
    drone: bool,
}

/// Which drone state the file's newest is.
#[derive(Default)]
pub struct NewestHeader(Option<Header<DroneClock>>);

impl References {
    /// Takes out of `input` what the file has already: of a process that was killed it lacks the last steps.
    pub fn take(input: &mut impl Input, newest: &mut NewestHeader, written: &Computed) -> References {
        let forecast = input
            .forecast()
            .and_then(|slot| slot.take_if(|f| written.has_forecast(&f.header)));
        let plan = input
            .plan()
            .and_then(|slot| slot.take_if(|p| written.has_plan(&p.header)));
        let before = newest.0;
        newest.0 = input.drone().and_then(|d| d.map(|d| d.header)).or(before);
        let drone = input
            .drone()
            .and_then(|slot| slot.take_if(|d| before == Some(d.header)));
        References {
            forecast: forecast.map(|f| name(&f.header)),
            plan: plan.map(|p| name(&p.header)),
            drone: drone.is_some(),
        }
    }
}

/// Boot id and number: no two messages of a kind share them.
fn name<C: Clock>(header: &Header<C>) -> (u32, u32) {
    (header.boot, header.sequence)
}

/// A named forecast or plan that the replay has not computed, or a drone state that no entry before
/// holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing;

/// Forecasts and plans that are kept: more than can be under way between two nodes.
const KEPT: usize = 128;

/// Outputs that the replay has computed, or a recording written, newest last.
#[derive(Default)]
pub struct Computed {
    forecasts: Vec<DeckForecast>,
    plans: Vec<Plan>,
    /// The newest that was read.
    drone: Option<DroneState>,
}

impl Computed {
    /// Keeps what a step has computed for others.
    pub fn keep(&mut self, step: &NodeStep<'_>) {
        match step {
            NodeStep::Predictor(_, _, o) => keep(&mut self.forecasts, o.forecast),
            NodeStep::Planner(_, _, o) => keep(&mut self.plans, o.plan),
            NodeStep::Vessel(..) | NodeStep::Bridge(..) | NodeStep::Mission(..) | NodeStep::Pilot(..) => {}
        }
    }
    fn has_forecast(&self, of: &Header<DroneClock>) -> bool {
        find(&self.forecasts, |f| name(&f.header) == name(of)).is_ok()
    }
    fn has_plan(&self, of: &Header<DroneClock>) -> bool {
        find(&self.plans, |p| name(&p.header) == name(of)).is_ok()
    }
    /// Puts what was left out into `input`.
    pub fn fill(&mut self, input: &mut impl Input, references: References) -> Result<(), Missing> {
        if let Some(slot) = input.drone() {
            match references.drone {
                true => *slot = Some(self.drone.ok_or(Missing)?),
                false => self.drone = slot.or(self.drone),
            }
        }
        if let (Some(id), Some(slot)) = (references.forecast, input.forecast()) {
            *slot = Some(find(&self.forecasts, |f| name(&f.header) == id)?);
        }
        if let (Some(id), Some(slot)) = (references.plan, input.plan()) {
            *slot = Some(find(&self.plans, |p| name(&p.header) == id)?);
        }
        Ok(())
    }
}

fn keep<T>(kept: &mut Vec<T>, new: Option<T>) {
    let Some(new) = new else { return };
    if kept.len() >= KEPT {
        kept.remove(0);
    }
    kept.push(new);
}

fn find<T: Copy>(kept: &[T], is_it: impl Fn(&T) -> bool) -> Result<T, Missing> {
    kept.iter().rev().find(|t| is_it(t)).copied().ok_or(Missing)
}

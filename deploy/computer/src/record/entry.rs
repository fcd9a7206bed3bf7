//! Record of a node's step: time, input bit for bit, hash of the output; and the header that names the process.
//!
//! The flight recorder's files hold every input in full, so that each process can be replayed without the others,
//! even if one was killed. Forecasts and plans are nine tenths of all bytes, and each is the output of another node.
//! A recording has all nodes in one file and therefore refers to them by sequence number. The replay inserts the
//! forecast and the plan that it has computed; the hash of each output shows whether the bits are equal. Four nodes
//! receive the drone's state in the same tick: the first entry holds it, the others refer to it.

use core::any::Any;
use std::collections::BTreeMap;

use alight_shared::{
    msg::{DeckForecast, DroneState, Header, Plan},
    step::Recorded,
    time::{Clock, DroneClock},
    wire::{self, WireError},
};
use serde::{Deserialize, Serialize};

pub const ENCODING: &str = "alight-step";
/// Format of the entries; a reader rejects every other format.
pub const FORMAT: u32 = 22;

#[derive(Serialize, Deserialize)]
pub struct Entry<I> {
    pub now_ns: i64,
    pub input: I,
    pub references: References,
    pub output: u64,
}

/// Appends the bytes of an [`Entry`] with any types of input and output.
pub fn append(
    to: &mut Vec<u8>,
    now_ns: i64,
    (input, references, output): (&dyn Recorded, References, &dyn Recorded),
) -> Result<(), WireError> {
    wire::append_record(to, &now_ns)?;
    input.append(to)?;
    let hash = hash(output, to)?;
    wire::append_record(to, &(references, hash))
}

/// [`alight_shared::wire::hash_record`] of an output. It is first encoded at the end of `scratch`, to be hashed in
/// one run instead of number by number.
pub fn hash(output: &dyn Recorded, scratch: &mut Vec<u8>) -> Result<u64, WireError> {
    let begin = scratch.len();
    let appended = output.append(scratch);
    let hash = wire::hash_bytes(scratch.get(begin..).unwrap_or_default());
    scratch.truncate(begin);
    appended.map(|()| hash)
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartHeader {
    pub process: String,
    pub boot: u32,
    /// Start time of the process on the computer's steady clock, ns, which orders its starts.
    pub began_ns: i64,
    /// Number of the first step in the file, from 0; above 0 from the second part on, and if the first steps could
    /// not be written.
    pub first_step: u64,
    pub config: String,
}

impl PartHeader {
    /// The header as names and values; the configuration is a separate attachment, `config`.
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

/// References to the parts that an input leaves out; empty in the flight recorder's files.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct References {
    /// Boot id and sequence number, as for the plan.
    forecast: Option<(u32, u32)>,
    plan: Option<(u32, u32)>,
    drone: bool,
}

#[derive(Default)]
pub struct NewestHeader(Option<Header<DroneClock>>);

impl References {
    /// Removes from an input's `part` the data that the file already holds. The file lacks the last steps of a killed
    /// process.
    pub fn take(&mut self, part: &mut dyn Any, newest: &mut NewestHeader, written: &Computed) {
        if let Some(slot) = part.downcast_mut::<Option<DeckForecast>>() {
            let taken = slot.take_if(|f| find(&written.forecasts, |k| &k.header, name(&f.header)).is_ok());
            self.forecast = taken.map(|f| name(&f.header));
        } else if let Some(slot) = part.downcast_mut::<Option<Plan>>() {
            let taken = slot.take_if(|p| find(&written.plans, |k| &k.header, name(&p.header)).is_ok());
            self.plan = taken.map(|p| name(&p.header));
        } else if let Some(slot) = part.downcast_mut::<Option<DroneState>>() {
            let before = newest.0;
            newest.0 = slot.map(|d| d.header).or(before);
            self.drone = slot.take_if(|d| before == Some(d.header)).is_some();
        }
    }
}

/// Boot id and sequence number, unique among messages of a kind.
fn name<C: Clock>(header: &Header<C>) -> (u32, u32) {
    (header.boot, header.sequence)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing;

/// Number of forecasts and plans to keep: more than can be in transit between two nodes.
const KEPT: usize = 128;

/// Outputs that the replay has computed or the recording has written, newest last.
#[derive(Default)]
pub struct Computed {
    forecasts: Vec<DeckForecast>,
    plans: Vec<Plan>,
    /// The newest drone state in the input.
    drone: Option<DroneState>,
    pub scratch: Vec<u8>,
}

impl Computed {
    /// Keeps a part of an output that other nodes read.
    pub fn keep(&mut self, part: &dyn Any) {
        if let Some(forecast) = part.downcast_ref() {
            keep(&mut self.forecasts, *forecast);
        } else if let Some(plan) = part.downcast_ref() {
            keep(&mut self.plans, *plan);
        }
    }
    pub fn fill(&mut self, part: &mut dyn Any, references: References) -> Result<(), Missing> {
        if let Some(slot) = part.downcast_mut::<Option<DroneState>>() {
            if references.drone {
                *slot = Some(self.drone.ok_or(Missing)?)
            } else {
                self.drone = slot.or(self.drone)
            }
        } else if let (Some(id), Some(slot)) = (references.forecast, part.downcast_mut()) {
            *slot = Some(find(&self.forecasts, |f| &f.header, id)?);
        } else if let (Some(id), Some(slot)) = (references.plan, part.downcast_mut()) {
            *slot = Some(find(&self.plans, |p| &p.header, id)?);
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

fn find<T: Copy>(
    kept: &[T],
    header: impl Fn(&T) -> &Header<DroneClock>,
    id: (u32, u32),
) -> Result<T, Missing> {
    let found = kept.iter().rev().find(|t| name(header(t)) == id);
    found.copied().ok_or(Missing)
}

//! Record of a node's step: time, input bit for bit, hash of the output; and whose steps they are.
//!
//! The flight recorder's files hold every input in full: each process is computed again without the others, also after
//! one that was killed. Forecasts and plans are nine tenths of all bytes that flow, and each is another node's output:
//! a recording, all nodes in one file, therefore leaves them out of the inputs and names them by their sequence number.
//! The replay puts in the forecast and the plan that it has computed itself, and the hash of each output shows whether
//! those are the same bits. The drone's state comes to four nodes in the same tick: the first entry holds it, the others
//! state that it is the one before.

use core::any::Any;
use std::collections::BTreeMap;

use alight_shared::msg::{DeckForecast, DroneState, Header, Plan};
use alight_shared::step::Recorded;
use alight_shared::time::{Clock, DroneClock};
use alight_shared::wire::{self, WireError};
use serde::{Deserialize, Serialize};

/// Encoding of a channel of steps, as MCAP calls it.
pub const ENCODING: &str = "alight-step";
/// Format of the entries; a reader rejects any other.
pub const FORMAT: u32 = 22;

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

/// Appends the entry of a step: the bytes of an [`Entry`], whatever the types of input and output.
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

/// [`alight_shared::wire::hash_record`] of an output, which lies at the end of `scratch` meanwhile: in one run, and not number
/// by number.
pub fn hash(output: &dyn Recorded, scratch: &mut Vec<u8>) -> Result<u64, WireError> {
    let begin = scratch.len();
    let appended = output.append(scratch);
    let hash = wire::hash_bytes(scratch.get(begin..).unwrap_or_default());
    scratch.truncate(begin);
    appended.map(|()| hash)
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
    /// Takes out of an input's `part` what the file has already: of a process that was killed it lacks the last steps.
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
    /// Outputs on their way to a hash.
    pub scratch: Vec<u8>,
}

impl Computed {
    /// Keeps a part of an output that others read.
    pub fn keep(&mut self, part: &dyn Any) {
        if let Some(forecast) = part.downcast_ref() {
            keep(&mut self.forecasts, *forecast);
        } else if let Some(plan) = part.downcast_ref() {
            keep(&mut self.plans, *plan);
        }
    }
    /// Puts what was left out into an input's `part`.
    pub fn fill(&mut self, part: &mut dyn Any, references: References) -> Result<(), Missing> {
        if let Some(slot) = part.downcast_mut::<Option<DroneState>>() {
            match references.drone {
                true => *slot = Some(self.drone.ok_or(Missing)?),
                false => self.drone = slot.or(self.drone),
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

//! The shell around a node of the drone: wakes with messages, steps the node with what arrived, publishes
//! its output. The processes differ in what they read and publish, nothing else.

use std::time::Duration;

use alight_shared::config;
use alight_shared::metrics::Metric;
use alight_shared::msg::Seq;
use alight_shared::node::Node;
use alight_shared::process::{InputState, ProcessKind};
use alight_shared::time::{DroneClock, Time};
use alight_transport::memory::{Instance, Listener, Memory};
use alight_transport::{TransportError, wake};
use serde::Serialize;

use crate::config::DroneComputer;
use crate::exit::{CliError, Exit};
use crate::process::args::ProcessArgs;
use crate::process::life::Process;

/// A process without messages wakes this often.
const MAX_WAIT: Duration = Duration::from_millis(20);

/// The topics that a node reads.
pub trait Reads: Sized {
    /// The node's input.
    type In;
    /// Subscribes to all.
    fn join(memory: &Memory) -> Result<Self, TransportError>;
    /// What came since the last call; `t` is the drone's clock, ns.
    fn read(&mut self, t: i64) -> Self::In;
    /// Statistics of each topic.
    fn states(&self, t: i64) -> Vec<InputState>;
}

/// Declares the topics that a node reads, with the names of its input's fields: `newest` is a state
/// stream, `all` an event stream; the field after the semicolon is filled in by [`Shell::complete`].
macro_rules! reads {
    ($(#[$doc:meta])* $name:ident => $input:ident {
        $($how:ident $field:ident: $message:ty,)*
        $(; $later:ident)?
    }) => {
        $(#[$doc])*
        pub struct $name { $($field: alight_transport::memory::Subscriber<$message>,)* }
        impl $crate::process::shell::Reads for $name {
            type In = $input;
            fn join(memory: &Memory) -> Result<Self, TransportError> {
                Ok($name { $($field: memory.subscriber()?,)* })
            }
            fn read(&mut self, t: i64) -> $input {
                $input { $($field: self.$field.$how(t),)* $($later: None)? }
            }
            fn states(&self, t: i64) -> Vec<alight_shared::process::InputState> {
                vec![$(self.$field.statistics().state(t),)*]
            }
        }
    };
}
pub(crate) use reads;

/// A node of the drone as a process.
pub trait Shell: Sized {
    /// The node.
    type Node: Node<Clock = DroneClock, In: Serialize, Out: Serialize>;
    /// The topics it reads.
    type Reads: Reads<In = <Self::Node as Node>::In>;
    /// Which process.
    const KIND: ProcessKind;

    /// The node of this computer, for a start with this boot id.
    fn node(computer: &DroneComputer, boot: u32) -> Self::Node;
    /// Declares what it publishes.
    fn join(memory: &Memory) -> Result<Self, TransportError>;
    /// What wakes it.
    fn wakes(memory: &Memory) -> Result<Vec<Listener>, TransportError>;
    /// Completes the input with what is not read all the time; `t` is the drone's clock, ns.
    fn complete(&mut self, _t: i64, _input: &mut <Self::Node as Node>::In) {}
    /// Publishes; true when the node had something to do.
    fn send(&mut self, out: &<Self::Node as Node>::Out) -> bool;
    /// Messages that could not be published.
    fn unsent(&self) -> u64;
    /// Metrics of its own after a step whose output was sent at `sent`.
    fn metrics(
        &mut self,
        _input: &<Self::Node as Node>::In,
        _out: &<Self::Node as Node>::Out,
        _sent: Time<DroneClock>,
    ) -> Vec<Metric> {
        Vec::new()
    }
}

/// Runs until asked to end.
pub fn run<S: Shell>(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: DroneComputer = config::load(&args.config)?;
    let mut process = Process::start(S::KIND, args, computer.clock, |boot| S::node(&computer, boot))?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, S::KIND.name())?;
    let mut reads = S::Reads::join(&memory)?;
    let mut shell = S::join(&memory)?;
    let mut state = memory.publisher()?;
    let wakes = S::wakes(&memory)?;

    wake::run(&wakes.iter().collect::<Vec<_>>(), MAX_WAIT, || {
        let t = process.now().nanos();
        let mut input = reads.read(t);
        shell.complete(t, &mut input);
        // Read after the messages: a step is never earlier than a message that it consumes, however long
        // the process was kept waiting in between.
        let now = process.now();
        let t = now.nanos();
        let out = process.step(now, &input, |out| shell.send(out));
        let sent = process.now();
        process.life.metrics = Seq::filled(shell.metrics(&input, &out, sent));
        let report = process.state(|| reads.states(t), shell.unsent());
        state.send_any(report.as_ref());
        !process.ended()
    })?;
    Ok(Exit::Success)
}

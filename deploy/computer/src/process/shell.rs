//! The shell around a node of the drone: wakes with messages, steps the node with what arrived, publishes
//! its output. The processes differ in their wiring, which is the node's ([`alight_shared::bus`]).

use std::time::Duration;

use alight_shared::bus::{Ports as _, Wired};
use alight_shared::config;
use alight_shared::metrics::Metric;
use alight_shared::msg::Seq;
use alight_shared::node::Node;
use alight_shared::process::ProcessKind;
use alight_shared::time::{DroneClock, Time};
use alight_transport::memory::{Instance, Memory};
use alight_transport::wake;
use serde::Serialize;

use crate::config::DroneComputer;
use crate::exit::{CliError, Exit};
use crate::process::args::ProcessArgs;
use crate::process::life::Process;

/// A process without messages wakes this often.
const MAX_WAIT: Duration = Duration::from_millis(20);

/// A node of the drone as a process: what is not in its wiring.
pub trait Shell: Default {
    /// The node.
    type Node: Wired<Clock = DroneClock, In: Serialize, Out: Serialize>;
    /// Which process.
    const KIND: ProcessKind;

    /// The node of this computer, for a start with this boot id.
    fn node(computer: &DroneComputer, boot: u32) -> Self::Node;
    /// Tells people what a step means whose output was sent at `sent`; metrics of its own.
    fn after_step(
        &mut self,
        _input: &<Self::Node as Node>::In,
        _out: &<Self::Node as Node>::Out,
        _sent: Time<DroneClock>,
    ) -> Vec<Metric> {
        Vec::new()
    }
}

/// The ports of a node in shared memory.
type InMemory<N> = <N as Wired>::Ports<Memory>;

/// Runs until asked to end.
pub fn run<S: Shell>(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: DroneComputer = config::load(&args.config)?;
    let mut process = Process::start(S::KIND, args, computer.clock, |boot| S::node(&computer, boot))?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, S::KIND.name())?;
    let mut ports = InMemory::<S::Node>::join(&memory)?;
    let mut shell = S::default();
    let mut state = memory.publisher()?;
    let wakes = InMemory::<S::Node>::wakes(&memory)?;

    wake::run(&wakes.iter().collect::<Vec<_>>(), MAX_WAIT, || {
        let input = ports.read(process.now().nanos());
        // Read after the messages: a step is never earlier than a message that it consumes, however long
        // the process was kept waiting in between.
        let now = process.now();
        let t = now.nanos();
        let out = process.step(now, &input, |out| ports.write(out));
        let sent = process.now();
        process.life.metrics = Seq::filled(shell.after_step(&input, &out, sent));
        let report = process.state(|| ports.states(t), ports.unsent());
        state.send_any(report.as_ref());
        !process.ended()
    })?;
    Ok(Exit::Success)
}

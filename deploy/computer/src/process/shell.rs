//! The shell around a row of the drone's computer without an edge: wakes with messages, steps the node with what arrived,
//! publishes its output. The processes differ in their wiring, which is the node's ([`alight_shared::bus`]).

use std::time::Duration;

use alight_shared::bus::{MAX_WAIT, Ports as _, Wired};
use alight_shared::config;
use alight_shared::metrics::Metric;
use alight_shared::msg::Seq;
use alight_shared::node::Node;
use alight_shared::step::Recorded;
use alight_shared::time::{DroneClock, Time};
use alight_transport::memory::{Instance, Memory};
use alight_transport::wake;
use alight_uav::computer::Installed;

use crate::config::DroneComputerConfig;
use crate::exit::{CliError, Exit};
use crate::process::args::ProcessArgs;
use crate::process::life::Process;

/// Work of a process after each step of its node.
pub trait AfterStep<N: Node> {
    /// Reports what a step means whose output was sent at `sent`; metrics of its own.
    fn after_step(&mut self, input: &N::In, out: &N::Out, sent: Time<N::Clock>) -> Vec<Metric>;
}

/// Nothing.
impl<N: Node> AfterStep<N> for () {
    fn after_step(&mut self, _input: &N::In, _out: &N::Out, _sent: Time<N::Clock>) -> Vec<Metric> {
        Vec::new()
    }
}

/// The ports of a node in shared memory.
type InMemory<N> = <N as Wired>::Ports<Memory>;

/// Runs the installed node `N` until asked to end.
pub fn run<N>(args: &ProcessArgs, observer: impl AfterStep<N>) -> Result<Exit, CliError>
where
    N: Installed<Clock = DroneClock, In: Recorded, Out: Recorded>,
{
    run_node(
        args,
        |computer, boot| N::installed(&computer.nodes(), boot),
        observer,
    )
}

/// Runs a process with the node that `make` makes for a boot id.
pub fn run_node<N>(
    args: &ProcessArgs,
    make: impl FnOnce(&DroneComputerConfig, u32) -> N,
    mut observer: impl AfterStep<N>,
) -> Result<Exit, CliError>
where
    N: Installed<Clock = DroneClock, In: Recorded, Out: Recorded>,
{
    let computer: DroneComputerConfig = config::load(&args.config)?;
    let mut process = Process::start(N::KIND, args, computer.clock, |boot| make(&computer, boot))?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, N::KIND.name())?;
    let mut ports = InMemory::<N>::join(&memory)?;
    let mut state = memory.publisher()?;
    let wakes = InMemory::<N>::wakes(&memory)?;

    let max_wait = Duration::from_nanos(MAX_WAIT.nanos().unsigned_abs());
    wake::run(&wakes.iter().collect::<Vec<_>>(), max_wait, || {
        let input = ports.read(process.now().nanos());
        // Read after the messages: a step is never earlier than a message that it consumes, however long
        // the process was kept waiting in between.
        let now = process.now();
        let t = now.nanos();
        let out = process.step(now, &input, |out| ports.write(out));
        let sent = process.now();
        process.life.metrics = Seq::filled(observer.after_step(&input, &out, sent));
        let report = process.state(|| ports.states(t), ports.unsent());
        state.send_any(report.as_ref());
        !process.ended()
    })?;
    Ok(Exit::Success)
}

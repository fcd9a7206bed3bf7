//! Loop of every process on both computers: it waits; its row reads, steps and writes ([`alight_shared::bus`]);
//! observers record and show the step; it reports at 2 Hz. Processes differ in the topics of their rows ([`Wired`])
//! and in their edges ([`ProcessEdge`]).

use std::{future::Future, time::Duration};

use alight_shared::{
    bus::{Bus as _, Edge, MAX_WAIT, Ports as _, Row, RowStep, Wired, Writer as _},
    config,
    metrics::{Metric, MetricName},
    msg::Seq,
    process::{InputState, ProcessKind, ProcessState},
    time::Time,
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::{Instance, Memory, Publisher},
    wake,
};
use alight_uav::computer::{DroneNodes, Installed};

use crate::{
    config::DroneComputerConfig,
    exit::{CliError, Exit},
    io::wakes::Wakes,
    process::{
        args::ProcessArgs,
        life::{Life, draw_boot, node_recorder},
    },
    record::flight::recorder::NodeRecorder,
};

pub struct NodeView<'a, N: Wired> {
    pub node: &'a N,
    pub now: Time<N::Clock>,
    pub inputs: &'a dyn Fn() -> Vec<InputState>,
}

/// Edge of a row on a computer, with the actions of its process besides the row's steps.
pub trait ProcessEdge<N: Wired>: Edge<N> {
    /// Called after each step of the row, once its output is sent and recorded.
    fn stepped(&mut self, _at: &NodeView<'_, N>, _step: &RowStep<N>) {}
    fn metrics(&mut self, _at: &NodeView<'_, N>) -> Vec<Metric> {
        Vec::new()
    }
    /// Number of messages that could not be sent to other computers or devices.
    fn unsent(&self) -> u64 {
        0
    }
    /// Reports to publish: the process's own, if due, and those that the edge received.
    fn reports(&mut self, _at: &NodeView<'_, N>, own: Option<ProcessState>) -> Vec<ProcessState> {
        Vec::from_iter(own)
    }
    fn is_over(&self) -> bool {
        false
    }
}
impl<N: Wired> ProcessEdge<N> for () {}

/// Edge that waits for more than the row's topics.
pub trait AwaitedEdge<N: Wired>: ProcessEdge<N> {
    /// Waits for an input or the time of the next step; true if a step is due. `wakes`: topics that wake the row.
    fn arrival(&mut self, wakes: &Wakes) -> impl Future<Output = Result<bool, CliError>>;
}

/// Row as a process, which records its steps in the flight's directory.
pub struct Process<N: Wired> {
    row: Row<N, Option<Memory>>,
    states: Option<Publisher<ProcessState>>,
    recorder: Option<NodeRecorder>,
    clock: ProcessClock,
    last: Time<N::Clock>,
    life: Life,
    /// Memory of the instance; None for a process that runs alone.
    pub memory: Option<Memory>,
}

impl<N: Wired> Process<N> {
    /// Starts a process of `kind`; `make` returns its node for a boot id. Joins the shared memory of `instance`, if
    /// given.
    pub fn start(
        kind: ProcessKind,
        args: &ProcessArgs,
        (instance, clock): (Option<&str>, ProcessClock),
        make: impl FnOnce(u32) -> Result<N, CliError>,
    ) -> Result<Process<N>, CliError> {
        let boot = draw_boot();
        let flight = args.flight.as_ref();
        let recorder = flight.map(|flight| node_recorder(flight, kind.name(), boot, &args.config));
        let recorder = recorder.transpose()?;
        // The recorder's thread, started before this, must not inherit the priority.
        args.scheduling.apply();
        let node = make(boot)?;
        let life = Life::begin(kind, boot, args.supervised);
        let join = |name| Ok::<_, CliError>(Memory::join(&Instance::new(name)?, kind.name())?);
        let memory = instance.map(join).transpose()?;
        let row = Row::join(&memory, node)?;
        let states = memory.writer()?;
        args.scheduling.lock_memory();
        Ok(Process {
            row,
            states,
            recorder,
            clock,
            last: Time::from_nanos(i64::MIN),
            life,
            memory,
        })
    }
    pub fn boot(&self) -> u32 {
        self.life.boot()
    }

    /// Runs until asked to end; topics of the row wake it.
    pub fn run(mut self, mut edge: impl ProcessEdge<N>) -> Result<Exit, CliError> {
        let wakes: Vec<_> = self.row.wakes.drain(..).flatten().collect();
        let max_wait = Duration::from_nanos(MAX_WAIT.nanos().unsigned_abs());
        wake::run(&wakes.iter().collect::<Vec<_>>(), max_wait, || {
            self.round(&mut edge, true);
            !self.is_over(&edge)
        })?;
        Ok(Exit::Success)
    }
    /// Runs until asked to end; the edge waits for its inputs.
    pub async fn run_awaiting(mut self, edge: &mut impl AwaitedEdge<N>) -> Result<Exit, CliError> {
        let wakes = Wakes::watch(self.row.wakes.drain(..).flatten())?;
        while !self.is_over(edge) {
            let due = edge.arrival(&wakes).await?;
            self.round(edge, due);
        }
        Ok(Exit::Success)
    }
    fn is_over(&self, edge: &impl ProcessEdge<N>) -> bool {
        self.life.ended() || edge.is_over()
    }

    /// Makes a step if one is due, lets the edge act on it, and reports.
    fn round(&mut self, edge: &mut impl ProcessEdge<N>, due: bool) {
        let clock = self.clock;
        let last = &mut self.last;
        // Time never runs backwards.
        let mut now = || {
            *last = (*last).max(clock.now());
            *last
        };
        let mut at = now();
        if due {
            let step = self.row.step(&mut now, edge);
            at = step.at;
            // Steps without work do not count in the statistics of step times.
            self.life.stepped(step.worked.then(|| step.took.secs()));
            if let Some(recorder) = &mut self.recorder {
                recorder.step(steady_ns(), step.at.nanos(), &step.input, &step.out);
            }
        }
        let Row {
            node, ports, last, ..
        } = &self.row;
        let inputs = &|| ports.states(at.nanos());
        if due {
            let now = now();
            edge.stepped(&NodeView { node, now, inputs }, last);
        }
        let look = NodeView {
            node,
            now: at,
            inputs,
        };
        self.life.metrics = Seq::filled(edge.metrics(&look));
        let unsent = ports.unsent() + self.states.unsent() + edge.unsent();
        let mut own = self.life.state(inputs, unsent);
        if let (Some(own), Some(recorder)) = (&mut own, &self.recorder) {
            // The capacity exceeds the number of metrics of any process.
            let _full = own
                .metrics
                .push(MetricName::StepsUnrecorded.count(recorder.missing()));
        }
        self.states.send_each(&edge.reports(&look, own));
    }
}

/// Runs a process of the drone's computer; `make` returns its node for a boot id.
pub fn run<N>(
    args: &ProcessArgs,
    make: impl FnOnce(&DroneNodes, u32) -> N,
    edge: impl ProcessEdge<N>,
) -> Result<Exit, CliError>
where
    N: Installed,
{
    let computer: DroneComputerConfig = config::load(&args.config)?;
    let of = (Some(computer.instance.as_str()), computer.clock);
    let make = |boot| Ok(make(&computer.nodes(), boot));
    Process::start(N::KIND, args, of, make)?.run(edge)
}

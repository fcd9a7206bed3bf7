//! Bus between the rows of a computer, and wiring of nodes to it. A row is a node with its ports, run by one process.
//!
//! Each node declares its wiring once with [`wiring!`]: topics that it reads (newest or all messages), writes and is
//! woken by, and its checkpoint. The [`Bus`] is implemented in another crate.

mod absent;

use core::any::Any;

use serde::de::DeserializeOwned;

use crate::{
    node::Node,
    plain::Plain,
    process::{InputState, ProcessKind},
    step::{Parts, Recorded, Step},
    time::{Span, Time},
    topics::{self, Topic},
};

/// Transport of messages between the rows of a computer.
pub trait Bus {
    /// Error of opening a port.
    type Error;
    /// Reader of messages `M`.
    type Reader<M: Plain>: Reader<M>;
    /// Writer of messages `M`.
    type Writer<M: Plain>: Writer<M>;
    /// Signal that wakes a row.
    type Wake: Wake;

    /// Opens a reader of the topic of `M`.
    fn reader<M: Plain>(&self) -> Result<Self::Reader<M>, Self::Error>;
    /// Opens a writer of the topic of `M`.
    fn writer<M: Plain>(&self) -> Result<Self::Writer<M>, Self::Error>;
    /// Opens a signal that wakes a row at each message `M`.
    fn wake<M: Plain>(&self) -> Result<Self::Wake, Self::Error>;
}

/// Reads messages `M` in the order in which they were sent.
pub trait Reader<M> {
    /// Replaces `to` by the newest message since the last read, or by None; `now_ns` is on the clock of the messages.
    fn read_newest(&mut self, now_ns: i64, to: &mut Option<M>);
    /// Replaces `to` by all messages since the last read, at most as many as the topic's buffer holds.
    fn read_all(&mut self, now_ns: i64, to: &mut Vec<M>);
    /// Newest message since the last read, if any.
    fn newest(&mut self, now_ns: i64) -> Option<M> {
        let mut newest = None;
        self.read_newest(now_ns, &mut newest);
        newest
    }
    /// All messages since the last read.
    fn all(&mut self, now_ns: i64) -> Vec<M> {
        let mut all = Vec::new();
        self.read_all(now_ns, &mut all);
        all
    }
    /// Counts of messages read and missed so far.
    fn state(&self, now_ns: i64) -> InputState;
}

/// Signal that a message has arrived on a topic.
pub trait Wake {
    /// Whether a message has arrived since the last call.
    fn woke(&mut self) -> bool;
}

/// Writes messages `M` and never waits for a reader.
pub trait Writer<M> {
    /// Sends `message` to all readers.
    fn send(&mut self, message: &M);
    /// Number of messages that could not be sent.
    fn unsent(&self) -> u64;

    /// Sends all messages of an `Option` or a `Vec`. Returns whether there were any.
    fn send_each<'a>(&mut self, messages: impl IntoIterator<Item = &'a M>) -> bool
    where
        M: 'a,
    {
        messages.into_iter().inspect(|m| self.send(m)).count() > 0
    }
}

/// A node whose wiring is declared. Its steps can be recorded and computed again.
pub trait Wired:
    Node<In: Recorded + Clone + Default + DeserializeOwned, Out: Recorded + Default> + Sized
{
    /// Ports of the node on a bus.
    type Ports<B: Bus>: Ports<B, In = Self::In, Out = Self::Out>;

    /// Passes each part of an input that comes from a topic to `each`: an `Option` or a `Vec` of messages.
    fn read_parts(input: &mut Self::In, each: &mut dyn FnMut(&mut dyn Any));
    /// Passes each part of an output that goes to a topic to `each`: a collection of messages.
    fn written_parts(out: &Self::Out, each: &mut dyn FnMut(&dyn Any));
}

/// Ports of a node on one bus.
pub trait Ports<B: Bus>: Sized {
    /// The node's input.
    type In;
    /// The node's output.
    type Out;

    /// Opens all ports.
    fn join(bus: &B) -> Result<Self, B::Error>;
    /// Opens the signals that wake the node.
    fn wakes(bus: &B) -> Result<Vec<B::Wake>, B::Error>;
    /// Replaces `input` by what arrived since the last read; `now_ns` is on the computer's clock.
    fn read(&mut self, now_ns: i64, input: &mut Self::In);
    /// Writes an output, its checkpoint first. Returns whether it contained anything besides the checkpoint.
    fn write(&mut self, out: &Self::Out) -> bool;
    /// Counts of the messages read on each topic.
    fn states(&self, now_ns: i64) -> Vec<InputState>;
    /// Number of messages that could not be sent.
    fn unsent(&self) -> u64;
}

/// Checkpoint topic of a node. The node reads its predecessor's checkpoint until it first writes its own, which it
/// must not read back.
pub struct Saved<B: Bus, M: Plain> {
    own: B::Writer<M>,
    predecessor: Option<B::Reader<M>>,
}

impl<B: Bus, M: Plain> Saved<B, M> {
    /// Opens the topic of the checkpoint.
    pub fn join(bus: &B) -> Result<Saved<B, M>, B::Error> {
        Ok(Saved {
            own: bus.writer()?,
            predecessor: Some(bus.reader()?),
        })
    }
    /// Replaces `to` by the checkpoint of the predecessor, or by None; `now_ns` is on the computer's clock.
    pub fn read_predecessor(&mut self, now_ns: i64, to: &mut Option<M>) {
        self.predecessor.read_newest(now_ns, to);
    }
    /// Writes the node's own checkpoint, if it is due.
    pub fn write(&mut self, own: Option<&M>) {
        if self.own.send_each(own) {
            self.predecessor = None;
        }
    }
    /// Number of messages that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.own.unsent()
    }
}

/// Connection of a row to the outside of its bus: a radio, a cable or a device; `()` for a row without one.
pub trait Edge<N: Wired> {
    /// Adds data from outside since the last step to the input of the next one.
    fn read(&mut self, _input: &mut N::In) {}
    /// Sends a step's output to the outside and to the ports. Returns whether it was more than a checkpoint.
    fn write<B: Bus>(&mut self, _input: &N::In, out: &mut N::Out, ports: &mut N::Ports<B>) -> bool {
        ports.write(out)
    }
}
impl<N: Wired> Edge<N> for () {}

/// Maximum time between two steps of a row without messages.
pub const MAX_WAIT: Span = Span::from_millis(20);

/// A node with its ports, run by one process.
pub struct Row<N: Wired, B: Bus> {
    /// The node.
    pub node: N,
    /// Ports of the node.
    pub ports: N::Ports<B>,
    /// Signals that wake the row; a caller that waits for them may take them.
    pub wakes: Vec<B::Wake>,
    /// Last step, which the next one overwrites in place: a forecast has 10 kB.
    pub last: RowStep<N>,
    has_stepped: bool,
}

/// Completed step of a row.
pub struct RowStep<N: Node> {
    /// Time on the row's own clock.
    pub at: Time<N::Clock>,
    /// Duration of the node's computation.
    pub took: Span,
    /// The step sent something besides the checkpoint.
    pub worked: bool,
    /// Input of this step.
    pub input: N::In,
    /// Output of the step.
    pub out: N::Out,
}

impl<N: Wired> RowStep<N> {
    /// This step as reported to observers, for a process that was started with this boot id.
    pub fn of(&self, process: ProcessKind, boot: u32) -> Step<'_> {
        Step {
            process,
            boot,
            now_ns: self.at.nanos(),
            input: &self.input,
            output: &self.out,
            parts: self,
        }
    }
}
impl<N: Wired> Parts for RowStep<N> {
    fn input_with(&self, change: &mut dyn FnMut(&mut dyn Any)) -> Box<dyn Recorded> {
        let mut input = self.input.clone();
        N::read_parts(&mut input, change);
        Box::new(input)
    }
    fn written(&self, each: &mut dyn FnMut(&dyn Any)) {
        N::written_parts(&self.out, each);
    }
}

impl<N: Wired, B: Bus> Row<N, B> {
    /// Joins the bus.
    pub fn join(bus: &B, node: N) -> Result<Row<N, B>, B::Error> {
        Ok(Row {
            node,
            ports: N::Ports::join(bus)?,
            wakes: N::Ports::wakes(bus)?,
            last: RowStep {
                at: Time::EPOCH,
                took: Span::ZERO,
                worked: false,
                input: N::In::default(),
                out: N::Out::default(),
            },
            has_stepped: false,
        })
    }
    /// Whether the row is due at `now`: a topic has woken it, or it has waited for [`MAX_WAIT`].
    pub fn is_due(&mut self, now: Time<N::Clock>) -> bool {
        let woken = self
            .wakes
            .iter_mut()
            .fold(false, |woken, wake| wake.woke() | woken);
        woken || !self.has_stepped || now - self.last.at >= MAX_WAIT
    }
    /// Performs one step. `clock` reads the computer's clock, which never goes back.
    pub fn step(
        &mut self,
        mut clock: impl FnMut() -> Time<N::Clock>,
        edge: &mut impl Edge<N>,
    ) -> &RowStep<N> {
        let step = &mut self.last;
        self.ports.read(clock().nanos(), &mut step.input);
        edge.read(&mut step.input);
        // The clock is read after the messages, so that no step precedes its input even if the process was delayed.
        step.at = clock();
        self.has_stepped = true;
        step.out = self.node.step(step.at, &step.input);
        step.took = clock() - step.at;
        step.worked = edge.write(&step.input, &mut step.out, &mut self.ports);
        step
    }
}

/// Counts of messages read and missed on one topic, from their sequence numbers.
#[derive(Clone, Copy, Debug)]
pub struct ReadCounts {
    topic: &'static Topic,
    received: u64,
    missed: u64,
    /// Boot and sequence of the newest message.
    order: Option<(u32, u32)>,
    /// Bit mask of the newest message (lowest bit) and its predecessors; set for messages read or before the first one.
    read: u64,
    newest_ns: Option<i64>,
}

impl ReadCounts {
    /// Counts of a topic without messages so far.
    pub const fn of(topic: &'static Topic) -> ReadCounts {
        ReadCounts {
            topic,
            received: 0,
            missed: 0,
            order: None,
            read: u64::MAX,
            newest_ns: None,
        }
    }
    /// Counts a message that was read.
    pub fn count(&mut self, order: Option<(u32, u32)>, at_ns: i64) {
        self.received += 1;
        self.newest_ns = Some(at_ns);
        let of_newest_boot = order.zip(self.order).filter(|(new, old)| new.0 == old.0);
        let step = of_newest_boot.map(|(new, old)| new.1.wrapping_sub(old.1) as i32);
        match step {
            Some(ahead @ 1..) => {
                self.missed += ahead as u64 - 1;
                self.read = self.read.checked_shl(ahead as u32).unwrap_or(0) | 1;
            }
            // A repetition, or an overtaken message that was counted as missed.
            Some(behind @ -63..=0) => {
                let own = 1 << -behind;
                self.missed -= u64::from(self.read & own == 0);
                self.read |= own;
                return;
            }
            Some(_) | None => self.read = u64::MAX,
        }
        self.order = order;
    }
    /// Counts for a report; `now_ns` is on the clock of the messages.
    pub fn state(&self, now_ns: i64) -> InputState {
        let index = topics::ALL.iter().position(|t| t.name == self.topic.name);
        InputState {
            topic: index.map_or(u32::MAX, |i| i as u32),
            received: self.received,
            missed: self.missed,
            age_s: self
                .newest_ns
                .map_or(f64::INFINITY, |at| now_ns.saturating_sub(at) as f64 * 1e-9),
            ..InputState::default()
        }
    }
}

/// Declares a computer: its rows in the order of the data flow, each with a node, the process that runs it,
/// and an expression that creates the node for a start with a boot id.
///
/// ```ignore
/// computer! {
///     /// The drone's computer.
///     DroneRows of DroneNodes {
///         /// The deck's forecast.
///         predictor: Predictor => ProcessKind::Predictor, |of, boot| Predictor::new(&of.drone.predictor(), boot);
///     }
///     /// Their processes.
///     PROCESSES: Installed, RowVisitor
/// }
/// ```
#[macro_export]
macro_rules! computer {
    (
        $(#[$doc:meta])* $computer:ident of $nodes:ty {
            $($(#[$about:meta])* $row:ident: $node:ty => $process:expr, $make:expr;)*
        }
        $(#[$list_doc:meta])* $list:ident: $kind:ident, $visitor:ident
    ) => {
        $(#[$doc])*
        pub struct $computer<B: $crate::bus::Bus> {
            // A row has up to 50 kB and is moved by several callers: a test's thread has 2 MB of stack.
            $($(#[$about])* pub $row: Option<Box<$crate::bus::Row<$node, B>>>,)*
        }
        impl<B: $crate::bus::Bus> Default for $computer<B> {
            /// No process runs at first.
            fn default() -> Self {
                $computer { $($row: None,)* }
            }
        }
        impl<B: $crate::bus::Bus> $computer<B> {
            /// Starts this process of the computer, and replaces it if it already runs.
            pub fn start(
                &mut self,
                process: $crate::process::ProcessKind,
                bus: &B,
                (nodes, boot): (&$nodes, u32),
            ) -> Result<(), B::Error> {
                $(if process == $process {
                    self.$row = Some(Box::new($crate::bus::Row::join(bus, $kind::installed(nodes, boot))?));
                })*
                Ok(())
            }
            /// Ends this process.
            pub fn kill(&mut self, process: $crate::process::ProcessKind) {
                $(if process == $process {
                    self.$row = None;
                })*
            }
        }
        $(#[$list_doc])*
        pub const $list: &[$crate::process::ProcessKind] = &[$($process),*];
        /// Node of a row of this computer, run by one of its processes.
        pub trait $kind: $crate::bus::Wired {
            /// Process that runs the node.
            const KIND: $crate::process::ProcessKind;
            /// Creates the node for a start with this boot id.
            fn installed(nodes: &$nodes, boot: u32) -> Self;
        }
        $(impl $kind for $node {
            const KIND: $crate::process::ProcessKind = $process;
            fn installed(nodes: &$nodes, boot: u32) -> $node {
                let make: fn(&$nodes, u32) -> $node = $make;
                make(nodes, boot)
            }
        })*
        /// Operation that can be performed on the row of any node type.
        pub trait $visitor: Sized {
            /// Result of the operation.
            type Found;
            /// Performs the operation on the row of this node.
            fn row<N: $kind + 'static>(self) -> Self::Found;
            /// Performs the operation on the row of this process. None if the computer has no such row.
            fn visit(self, process: $crate::process::ProcessKind) -> Option<Self::Found> {
                $(if process == $process {
                    return Some(self.row::<$node>());
                })*
                None
            }
        }
    };
}
pub use crate::computer;

/// Declares readers of topics outside the rows, by message type.
#[macro_export]
macro_rules! readers {
    ($(#[$doc:meta])* $vis:vis struct $name:ident { $($field:ident: $read:ty),* $(,)? }) => {
        $(#[$doc])*
        $vis struct $name<B: $crate::bus::Bus> {
            $($field: B::Reader<$read>,)*
        }
        impl<B: $crate::bus::Bus> $name<B> {
            /// Joins a bus.
            $vis fn join(bus: &B) -> Result<Self, B::Error> {
                Ok($name {
                    $($field: bus.reader()?,)*
                })
            }
        }
    };
}
pub use crate::readers;

/// Declares the wiring of a node, with the field names of its input and output:
///
/// ```ignore
/// wiring! {
///     /// Inputs and outputs of the planner.
///     PlannerPorts of Planner: PlannerIn => PlannerOut {
///         reads { newest forecast: DeckForecast, all commands: Command }
///         edge { packets }
///         writes { plan: Plan }
///         wakes { DeckForecast }
///         saves { checkpoint: PlannerCheckpoint }
///     }
/// }
/// ```
///
/// Ports leave inputs from an edge (packets, frames) empty; the edge fills them. `edge` and `saves` are
/// optional. Every field of the input must be named.
#[macro_export]
macro_rules! wiring {
    (@newest $reader:expr, $now_ns:expr, $to:expr) => {
        $reader.read_newest($now_ns, $to)
    };
    (@all $reader:expr, $now_ns:expr, $to:expr) => {
        $reader.read_all($now_ns, $to)
    };
    ($(#[$doc:meta])* $ports:ident of $node:ident: $input:ident => $output:ident {
        reads { $($how:ident $in:ident: $read:ty),* $(,)? }
        $(edge { $($edge:ident),* $(,)? })?
        writes { $($out:ident: $written:ty),* $(,)? }
        wakes { $($wake:ty),* $(,)? }
        $(saves { $saved:ident: $checkpoint:ty })?
    }) => {
        $(#[$doc])*
        pub struct $ports<B: $crate::bus::Bus> {
            $($in: B::Reader<$read>,)*
            $($out: B::Writer<$written>,)*
            $($saved: $crate::bus::Saved<B, $checkpoint>,)?
        }
        impl<B: $crate::bus::Bus> $crate::bus::Ports<B> for $ports<B> {
            type In = $input;
            type Out = $output;
            fn join(bus: &B) -> Result<Self, B::Error> {
                Ok($ports {
                    $($in: bus.reader()?,)*
                    $($out: bus.writer()?,)*
                    $($saved: $crate::bus::Saved::join(bus)?,)?
                })
            }
            fn wakes(bus: &B) -> Result<Vec<B::Wake>, B::Error> {
                Ok(vec![$(bus.wake::<$wake>()?),*])
            }
            #[allow(unused_variables, reason = "a node may read nothing")]
            fn read(&mut self, now_ns: i64, input: &mut $input) {
                #[allow(unused_imports, reason = "a node may read nothing")]
                use $crate::bus::Reader as _;
                $($crate::wiring!(@$how self.$in, now_ns, &mut input.$in);)*
                $(self.$saved.read_predecessor(now_ns, &mut input.$saved);)?
                $($(input.$edge = Default::default();)*)?
            }
            fn write(&mut self, out: &$output) -> bool {
                #[allow(unused_imports, reason = "a node may write nothing")]
                use $crate::bus::Writer as _;
                $(self.$saved.write(out.$saved.as_ref());)?
                let sent: &[bool] = &[$(self.$out.send_each(&out.$out)),*];
                sent.contains(&true)
            }
            fn states(&self, now_ns: i64) -> Vec<$crate::process::InputState> {
                #[allow(unused_imports, reason = "a node may read nothing")]
                use $crate::bus::Reader as _;
                vec![$(self.$in.state(now_ns)),*]
            }
            fn unsent(&self) -> u64 {
                #[allow(unused_imports, reason = "a node may write nothing")]
                use $crate::bus::Writer as _;
                0 $(+ self.$out.unsent())* $(+ self.$saved.unsent())?
            }
        }
        // A process reports the state of every topic that it reads.
        const _: () = {
            let reads: &[&str] = &[$(stringify!($in)),*];
            assert!(reads.len() <= $crate::process::MAX_INPUTS);
        };
        impl $crate::bus::Wired for $node {
            type Ports<B: $crate::bus::Bus> = $ports<B>;

            #[allow(unused_variables, reason = "a node may read nothing")]
            fn read_parts(input: &mut $input, each: &mut dyn FnMut(&mut dyn core::any::Any)) {
                $(each(&mut input.$in);)*
            }
            #[allow(unused_variables, reason = "a node may write nothing")]
            fn written_parts(out: &$output, each: &mut dyn FnMut(&dyn core::any::Any)) {
                $(each(&out.$out);)*
            }
        }
    };
}
pub use crate::wiring;

#[cfg(test)]
mod tests {
    use core::{cell::RefCell, convert::Infallible, marker::PhantomData};
    use std::rc::Rc;

    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::{
        msg::{MissionCheckpoint, MissionState, Plan, RangeSample},
        time::{DroneClock, DroneTime},
    };

    /// All sent messages, in order.
    #[derive(Default)]
    struct Wire(Rc<RefCell<Vec<Box<dyn Any>>>>);
    struct Port<M>(Rc<RefCell<Vec<Box<dyn Any>>>>, usize, PhantomData<M>);

    impl Wire {
        fn port<M>(&self) -> Port<M> {
            Port(self.0.clone(), 0, PhantomData)
        }
        fn sent<M: 'static>(&self, place: usize) -> bool {
            self.0.borrow().get(place).is_some_and(|m| m.is::<M>())
        }
    }
    impl Bus for Wire {
        type Error = Infallible;
        type Reader<M: Plain> = Port<M>;
        type Writer<M: Plain> = Port<M>;
        type Wake = &'static str;
        fn reader<M: Plain>(&self) -> Result<Port<M>, Infallible> {
            Ok(self.port())
        }
        fn writer<M: Plain>(&self) -> Result<Port<M>, Infallible> {
            Ok(self.port())
        }
        fn wake<M: Plain>(&self) -> Result<&'static str, Infallible> {
            Ok(M::TOPIC.name)
        }
    }
    impl Wake for &'static str {
        fn woke(&mut self) -> bool {
            false
        }
    }
    impl<M: Plain> Reader<M> for Port<M> {
        fn read_newest(&mut self, now_ns: i64, to: &mut Option<M>) {
            *to = self.all(now_ns).pop();
        }
        fn read_all(&mut self, _now_ns: i64, to: &mut Vec<M>) {
            let sent = self.0.borrow();
            let new = sent.iter().skip(core::mem::replace(&mut self.1, sent.len()));
            *to = new.filter_map(|m| m.downcast_ref().copied()).collect();
        }
        fn state(&self, _now_ns: i64) -> InputState {
            InputState::default()
        }
    }
    impl<M: Plain> Writer<M> for Port<M> {
        fn send(&mut self, message: &M) {
            self.0.borrow_mut().push(Box::new(*message));
        }
        fn unsent(&self) -> u64 {
            1
        }
    }

    pub struct Echo;
    #[derive(Clone, Default, Serialize, Deserialize)]
    pub struct In {
        plan_in: Option<Plan>,
        ranges: Vec<RangeSample>,
        frames: Vec<u8>,
        kept: Option<MissionCheckpoint>,
    }
    #[derive(Default, Serialize)]
    pub struct Out {
        states: Vec<MissionState>,
        plan: Option<Plan>,
        kept: Option<MissionCheckpoint>,
    }
    impl Node for Echo {
        type Clock = DroneClock;
        type In = In;
        type Out = Out;
        fn step(&mut self, _now: DroneTime, _input: &In) -> Out {
            Out::default()
        }
    }
    wiring! {
        EchoPorts of Echo: In => Out {
            reads { newest plan_in: Plan, all ranges: RangeSample }
            edge { frames }
            writes { states: MissionState, plan: Plan }
            wakes { RangeSample, Plan }
            saves { kept: MissionCheckpoint }
        }
    }

    #[test]
    fn wiring_of_a_node() {
        let wire = Wire::default();
        let mut ports = <Echo as Wired>::Ports::join(&wire).unwrap();
        let mut others = (
            wire.port::<RangeSample>(),
            wire.port::<Plan>(),
            wire.port::<MissionCheckpoint>(),
        );
        others.0.send(&RangeSample::default());
        others.0.send(&RangeSample::default());
        others.1.send(&Plan::default());
        others.2.send(&MissionCheckpoint::default());
        let mut read = In {
            frames: vec![7],
            ..In::default()
        };
        ports.read(0, &mut read);
        assert_eq!(
            (read.plan_in.is_some(), read.ranges.len(), read.frames.len()),
            (true, 2, 0)
        );
        assert!(read.kept.is_some());
        ports.read(0, &mut read);
        assert!(read.plan_in.is_none() && read.ranges.is_empty());

        // Once a checkpoint has been written, the predecessor's is no longer read.
        assert!(!ports.write(&Out {
            kept: Some(MissionCheckpoint::default()),
            ..Out::default()
        }));
        let states = vec![MissionState::default(); 2];
        assert!(ports.write(&Out {
            states,
            kept: Some(MissionCheckpoint::default()),
            plan: None
        }));
        assert!(
            wire.sent::<MissionCheckpoint>(5) && wire.sent::<MissionState>(6) && wire.sent::<MissionState>(7)
        );
        ports.read(0, &mut read);
        assert!(read.kept.is_none());

        assert_eq!((ports.states(0).len(), ports.unsent()), (2, 3));
        let mut read = 0;
        let mut written = 0;
        Echo::read_parts(&mut In::default(), &mut |part| {
            read += usize::from(part.is::<Option<Plan>>() || part.is::<Vec<RangeSample>>());
        });
        Echo::written_parts(&Out::default(), &mut |part| {
            written += usize::from(part.is::<Vec<MissionState>>())
        });
        assert_eq!((read, written), (2, 1));
        assert_eq!(
            EchoPorts::wakes(&wire),
            Ok(vec![crate::topics::RANGE.name, crate::topics::PLAN.name])
        );
    }
}

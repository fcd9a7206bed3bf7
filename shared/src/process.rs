//! Reports of a process about itself.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::metrics::{self, MetricName, MetricValue, Metrics};
use crate::msg::Seq;

/// Topics that one process reads, at most.
pub const MAX_INPUTS: usize = 12;

macro_rules! processes {
    ($($(#[$about:meta])* $kind:ident: $name:literal;)*) => {
        /// The processes of a vessel and its drone.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum ProcessKind { $($(#[$about])* $kind,)* }

        impl ProcessKind {
            /// Name of the process.
            pub const fn name(self) -> &'static str {
                match self { $(ProcessKind::$kind => $name,)* }
            }
            /// The process of this name.
            pub fn named(name: &str) -> Option<ProcessKind> {
                match name { $($name => Some(ProcessKind::$kind),)* _ => None }
            }
        }
    };
}
processes! {
    /// The simulated vehicles.
    #[default]
    World: "world";
    /// The vessel's estimator and broadcast.
    Vessel: "vessel";
    /// The drone's end of the radio.
    Bridge: "bridge";
    /// The deck's forecast.
    Predictor: "predictor";
    /// The state machine.
    Mission: "mission";
    /// The trajectory.
    Planner: "planner";
    /// The set-points.
    Pilot: "pilot";
    /// The emulated radio of a trial.
    Link: "link";
    /// The link to the autopilot.
    Autopilot: "autopilot";
    /// The vessel's real sensors.
    Sensors: "sensors";
    /// The belly camera's images.
    Camera: "camera";
    /// The ultraviolet camera's images.
    Uvdar: "uvdar";
    /// A viewer for people.
    View: "view";
}

impl ProcessKind {
    /// The subcommand that runs it; `vessel` is the service.
    pub const fn subcommand(self) -> &'static str {
        if matches!(self, ProcessKind::Vessel) {
            "estimator"
        } else {
            self.name()
        }
    }
}

/// Counts of what a process read on one topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct InputState {
    /// Index of the topic in [`crate::topics::ALL`].
    pub topic: u32,
    /// Messages received since the process began.
    pub received: u64,
    /// Messages missed by their sequence numbers.
    pub missed: u64,
    /// Age of the newest, s; infinite without one.
    pub age_s: f64,
    /// Median age when it was read, s.
    pub read_age_p50_s: f64,
    /// 99th percentile of the age when it was read, s.
    pub read_age_p99_s: f64,
}

/// Keys on which one process speaks over the radio, at most.
pub const MAX_FLOWS: usize = 11;

/// Counts of what a process sent over the radio on one key.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RadioFlow {
    /// Index of the topic in [`crate::topics::ALL`]; beyond it: its own report.
    pub topic: u32,
    /// Messages over the last seconds, Hz.
    pub rate_hz: f32,
    /// Bytes over the last seconds with the middleware's, UDP's and IP's headers, bytes/s.
    pub bytes_per_s: f32,
}

/// Report of a process about itself, twice a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ProcessState {
    /// Which.
    pub kind: ProcessKind,
    /// Process id.
    pub pid: u32,
    /// Random number of each start.
    pub boot: u32,
    /// The steady clock when this was written, ns.
    pub at_ns: i64,
    /// The steady clock when the process began, ns.
    pub began_ns: i64,
    /// Steps of its node.
    pub steps: u64,
    /// Processor time since it began, s.
    pub cpu_s: f64,
    /// Resident memory, bytes.
    pub resident_bytes: u64,
    /// Median time of one step of the node, s.
    pub step_p50_s: f64,
    /// 99th percentile of the same, s.
    pub step_p99_s: f64,
    /// Messages that it could not send.
    pub unsent: u64,
    /// Further counts and measurements of the process.
    #[serde(serialize_with = "metrics::serialize")]
    #[schemars(with = "Metrics")]
    pub metrics: Metrics,
    /// State of each topic that it reads.
    pub inputs: Seq<InputState, MAX_INPUTS>,
    /// State of each key that it sends over the radio.
    pub flows: Seq<RadioFlow, MAX_FLOWS>,
}

impl ProcessState {
    /// The metric of that name, if it has one.
    pub fn metric(&self, name: MetricName) -> Option<MetricValue> {
        self.metrics.iter().find(|m| m.name == name).map(|m| m.value)
    }
    /// A time among its metrics, s; NaN when it has none of that name.
    pub fn seconds(&self, name: MetricName) -> f64 {
        match self.metric(name) {
            Some(MetricValue::Seconds(s)) => s,
            Some(_) | None => f64::NAN,
        }
    }
    /// A count among its metrics; 0 when it has none of that name.
    pub fn count(&self, name: MetricName) -> u64 {
        match self.metric(name) {
            Some(MetricValue::Count(n)) => n,
            Some(_) | None => 0,
        }
    }
}

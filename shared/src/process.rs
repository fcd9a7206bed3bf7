//! Reports of processes about themselves.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    metrics::{self, MetricName, MetricValue, Metrics},
    msg::Seq,
    radio::RadioTopic,
    tags::ForeignTag,
};

/// Maximum number of topics read by one process.
pub const MAX_INPUTS: usize = 14;

macro_rules! processes {
    ($($(#[$about:meta])* $kind:ident: $name:literal;)*) => {
        /// Processes of a vessel and its drone.
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
    /// Simulated vehicles.
    #[default]
    World: "world";
    /// The vessel's estimator and broadcast.
    Vessel: "vessel";
    /// The drone's radio end.
    Bridge: "bridge";
    /// Deck forecast.
    Predictor: "predictor";
    /// Mission state machine.
    Mission: "mission";
    /// Trajectory planner.
    Planner: "planner";
    /// Set-point generator.
    Pilot: "pilot";
    /// Emulated radio of a trial.
    Link: "link";
    /// Link to the autopilot.
    Autopilot: "autopilot";
    /// The vessel's real sensors.
    Sensors: "sensors";
    /// Belly camera.
    Camera: "camera";
    /// Ultraviolet camera.
    Uvdar: "uvdar";
    /// Web page with the display.
    View: "view";
}

impl ProcessKind {
    /// Subcommand that runs it; `vessel` is the service.
    pub const fn subcommand(self) -> &'static str {
        if matches!(self, ProcessKind::Vessel) {
            "estimator"
        } else {
            self.name()
        }
    }
}

/// Counts of one topic as read by a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct InputState {
    /// Index of the topic in [`crate::topics::ALL`].
    pub topic: u32,
    /// Messages received since the process started.
    pub received: u64,
    /// Messages missed according to their sequence numbers.
    pub missed: u64,
    /// Age of the newest message, s; infinite without one.
    pub age_s: f64,
    /// Median age of messages when read, s.
    pub read_age_p50_s: f64,
    /// 99th percentile of the age when read, s.
    pub read_age_p99_s: f64,
}

/// Maximum number of radio keys on which one process publishes: it reports the rate of each.
pub const MAX_FLOWS: usize = RadioTopic::MAX_SENT;

/// Counts of messages that a process sent on one radio key.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RadioFlow {
    /// Index of the topic in [`crate::topics::ALL`]; larger values mean the process's own report.
    pub topic: u32,
    /// Message rate over the last seconds, Hz.
    pub rate_hz: f32,
    /// Data rate over the last seconds including headers of the middleware, UDP and IP, bytes/s.
    pub bytes_per_s: f32,
}

/// Report of a process about itself, published twice a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ProcessState {
    /// Kind of process.
    pub kind: ProcessKind,
    /// Process id.
    pub pid: u32,
    /// Random number drawn at each start.
    pub boot: u32,
    /// Steady clock at the time of the report, ns.
    pub at_ns: i64,
    /// Steady clock at the start of the process, ns.
    pub began_ns: i64,
    /// Number of steps of its node.
    pub steps: u64,
    /// Processor time since the start, s.
    pub cpu_s: f64,
    /// Resident memory, bytes.
    pub resident_bytes: u64,
    /// Median duration of a step, s.
    pub step_p50_s: f64,
    /// 99th percentile of the duration of a step, s.
    pub step_p99_s: f64,
    /// Messages that could not be sent.
    pub unsent: u64,
    /// Further counts and measurements of the process.
    #[serde(serialize_with = "metrics::serialize")]
    #[schemars(with = "Metrics")]
    pub metrics: Metrics,
    /// State of each topic read.
    pub inputs: Seq<InputState, MAX_INPUTS>,
    /// State of each key published on the radio.
    pub flows: Seq<RadioFlow, MAX_FLOWS>,
}

impl ProcessState {
    /// Value of the metric with this name, if present.
    pub fn metric(&self, name: MetricName) -> Option<MetricValue> {
        self.metrics.iter().find(|m| m.name == name).map(|m| m.value)
    }
    /// Time metric of this name, s; NaN if missing.
    pub fn seconds(&self, name: MetricName) -> f64 {
        match self.metric(name) {
            Some(MetricValue::Seconds(s)) => s,
            Some(_) | None => f64::NAN,
        }
    }
    /// Content of the camera's image in place of the deck's tags, if it is known.
    pub fn foreign_tag(&self) -> Option<ForeignTag> {
        match self.metric(MetricName::ForeignTag) {
            Some(MetricValue::ForeignTag(tag)) => tag,
            Some(_) | None => None,
        }
    }
    /// Count metric of this name; 0 if missing.
    pub fn count(&self, name: MetricName) -> u64 {
        match self.metric(name) {
            Some(MetricValue::Count(n)) => n,
            Some(_) | None => 0,
        }
    }
}

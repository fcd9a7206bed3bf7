//! Metrics of processes under stable names.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

use crate::{
    admission::{AccessRejection, RejectionReason},
    msg::{Seq, State},
    tags::ForeignTag,
};

/// Maximum number of metrics of one process.
pub const MAX_METRICS: usize = 32;
/// Metrics of one process.
pub type Metrics = Seq<Metric, MAX_METRICS>;

macro_rules! names {
    ($($metric:ident: $name:literal,)* ; $($newer:ident: $newer_name:literal,)*) => {
        /// Subject of a metric.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum MetricName {
            $(#[doc = $name] $metric,)*
            /// Inputs rejected for this reason.
            Rejected(RejectionReason),
            /// Peers rejected for this reason.
            PeersRejectedFor(AccessRejection),
            $(#[doc = $newer_name] $newer,)*
        }
        impl MetricName {
            /// Name for display.
            pub fn text(self) -> String {
                match self {
                    $(MetricName::$metric => $name.into(),)*
                    $(MetricName::$newer => $newer_name.into(),)*
                    MetricName::Rejected(reason) => format!("rejected {}", reason.name()),
                    MetricName::PeersRejectedFor(reason) => format!("peers rejected for {}", reason.name()),
                }
            }
        }
    };
}
names! {
    // Vessel.
    SensorReadingsMissed: "sensor readings missed",
    BytesSent: "bytes sent",
    PacketsDropped: "packets dropped",
    TimeRequestsRejected: "time requests rejected",
    DroneMessages: "drone messages received",
    DroneMessagesRejected: "drone messages rejected",
    DroneMessageAge: "age of drone message",
    DroneState: "drone state",
    DroneDescents: "drone descents",
    DroneBattery: "drone battery",
    RateFraction: "fraction of the full rates",
    PeersRejected: "unauthorised peers rejected",
    LastPeerRejection: "last peer rejected for",
    MeasurementToEstimateP50: "measurement to estimate p50",
    MeasurementToEstimateP99: "measurement to estimate p99",
    // Bridge.
    BytesReceived: "bytes received",
    SessionsReopened: "sessions reopened",
    VesselStatusRejected: "vessel status rejected",
    // Pilot.
    VesselToSetPointP50: "vessel measurement to set-point p50",
    VesselToSetPointP99: "vessel measurement to set-point p99",
    OdometryToSetPointP50: "odometry to set-point p50",
    OdometryToSetPointP99: "odometry to set-point p99",
    // Autopilot link.
    ClockUncertainty: "clock uncertainty",
    SamplesRejected: "samples rejected",
    ClockRestarts: "clock restarts",
    HoverThrust: "hover thrust",
    SetPointsSent: "set-points sent",
    LinkReopened: "link reopened",
    UnsignedFrames: "unsigned frames rejected",
    OtherKeyFrames: "frames signed with another key rejected",
    OldFrames: "frames with an old signature rejected",
    UncheckedSignatures: "signatures not checked",
    // Cameras.
    Images: "images",
    WrongSize: "images of another size",
    TagDetections: "tag detections",
    OtherTags: "other tags",
    FaintTags: "faint tags",
    MisshapenTags: "misshapen tags",
    DeckFixes: "deck fixes",
    Markers: "markers identified",
    SingleMarkers: "single markers",
    WithoutPose: "without a pose",
    ExposureToFixP50: "exposure to fix p50",
    ExposureToFixP99: "exposure to fix p99",
    SourceReopened: "source reopened",
    Exposure: "exposure",
    Gain: "gain",
    TagContrast: "tag contrast",
    TagSaturation: "tag saturation",
    // Simulated world.
    LatestTick: "latest tick",
    LateTicks: "late ticks",
    TimeSinceStart: "time since start",
    SlicesUnanswered: "slices unanswered",
    ImagesDropped: "images dropped",
    // All recording processes.
    StepsUnrecorded: "steps not recorded",
    // All processes that step at a fixed rate.
    LongestStep: "longest time between steps",
    LateSteps: "late steps",
    ;
    // The number of a name is part of the message layout: append names at the end, and increase the message version.
    DroneSessions: "sessions of drones",
    NewestAsked: "newest messages asked for",
    VesselSession: "sessions of the vessel",
    ImageMean: "image mean",
    TooDark: "too dark",
    MemoryWarnings: "warnings of the shared memory",
    RtcmPassedOn: "RTCM frames passed on",
    RtcmDropped: "RTCM frames dropped",
    RepeatedImages: "images equal to the one before",
    ForeignTag: "no tag of the deck:",
}

/// Value of a metric with its unit.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C, u8)]
pub enum MetricValue {
    /// Number of occurrences.
    Count(u64),
    /// Time, s.
    Seconds(f64),
    /// Fraction, 0 to 1.
    Fraction(f64),
    /// Reason for rejecting a peer, if one was rejected.
    AccessRejection(Option<AccessRejection>),
    /// State of the mission, if known.
    State(Option<State>),
    /// Content of an image in place of the deck's tags; None once a tag was detected.
    ForeignTag(Option<ForeignTag>),
}

/// Metric of a process.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Metric {
    /// Subject of the metric.
    pub name: MetricName,
    /// Value of the metric.
    pub value: MetricValue,
}

impl Default for Metric {
    fn default() -> Self {
        MetricName::BytesSent.count(0_u32)
    }
}

impl MetricName {
    /// Metric with this value.
    pub fn with(self, value: MetricValue) -> Metric {
        Metric { name: self, value }
    }
    /// Metric with a count.
    pub fn count(self, n: impl Into<u64>) -> Metric {
        self.with(MetricValue::Count(n.into()))
    }
    /// Metric with a time, s.
    pub fn seconds(self, s: f64) -> Metric {
        self.with(MetricValue::Seconds(s))
    }
    /// Metric with a fraction, 0 to 1.
    pub fn fraction(self, fraction: f64) -> Metric {
        self.with(MetricValue::Fraction(fraction))
    }
}

impl Metric {
    /// Machine-readable name: lower case, underscores, times with their unit.
    pub fn key(&self) -> String {
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() {
                c.to_ascii_lowercase()
            } else {
                '_'
            }
        };
        let mut key: String = self.name.text().chars().map(plain).collect();
        if matches!(self.value, MetricValue::Seconds(_)) {
            key.push_str("_s");
        }
        key
    }
    /// Machine-readable value.
    pub fn json(&self) -> serde_json::Value {
        match self.value {
            MetricValue::Count(n) => n.into(),
            MetricValue::Seconds(v) | MetricValue::Fraction(v) => v.into(),
            MetricValue::AccessRejection(why) => why.map(AccessRejection::name).into(),
            MetricValue::State(state) => state.map(State::name).into(),
            MetricValue::ForeignTag(tag) => tag.map(|t| t.to_string()).into(),
        }
    }
}

/// Serialises an object of names and values for readable formats, the list for binary ones.
pub(crate) fn serialize<S: Serializer>(metrics: &Metrics, s: S) -> Result<S::Ok, S::Error> {
    if s.is_human_readable() {
        s.collect_map(metrics.iter().map(|m| (m.key(), m.json())))
    } else {
        metrics.serialize(s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metric_keys_and_values() {
        let shown = |m: Metric| (m.key(), m.json());
        assert_eq!(
            shown(MetricName::OdometryToSetPointP50.seconds(0.25)),
            ("odometry_to_set_point_p50_s".into(), 0.25.into())
        );
        let rejected = MetricName::Rejected(RejectionReason::Stale).count(3_u32);
        assert_eq!(shown(rejected), ("rejected_stale".into(), 3.into()));
        let state = MetricName::DroneState.with(MetricValue::State(Some(State::Landed)));
        assert_eq!(shown(state), ("drone_state".into(), "Landed".into()));
    }
}

//! Plain data that may lie in shared memory, and its topics. Beside a descriptor's number in `memory` the only `unsafe`
//! of Alight.
#![allow(unsafe_code)]

use core::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;
use serde::Serialize;

use crate::msg;
use crate::time::DroneClock;
use crate::topics::{self, Topic};
use crate::transport::TransportError;
use crate::transport::process::ProcessState;

/// A message that lies in shared memory as it is, and the one topic it travels on.
pub trait Plain: ZeroCopySend + Copy + Debug + Serialize + 'static {
    /// Its topic: name, buffer and staleness limit.
    const TOPIC: &'static Topic;
    /// Its sequence number and boot id, to count what was missed; None for messages without.
    fn order(&self) -> Option<(u32, u32)>;
    /// Its time of validity, ns on its own clock.
    fn at_ns(&self) -> i64;
}

/// What is done for every type of shared memory.
pub(super) trait Visitor {
    /// For one.
    fn visit<T: Plain>(&mut self) -> Result<(), TransportError>;
}

// SAFETY: every type below is plain data of fixed size without pointers, references or handles,
// all the way down, and `repr(C)` but for two details whose layout Rust fixes only within one
// compilation: enumerations (`repr(u8)`) with few valid values, and `Option` in a plan, in surroundings, in the checkpoints, in
// metrics and in what the vessel's processes report. Both are sound here because a service's attributes carry `MESSAGE_VERSION` and the package's version, so
// that only processes of one program ever share a service, and because no process writes a message
// otherwise than by copying a whole valid value. Bounded lists check their length when they are read.
macro_rules! plain {
    ($($ty:ty => $topic:ident;)*) => {
        $(
            unsafe impl ZeroCopySend for $ty {
                unsafe fn type_name() -> &'static str {
                    topics::$topic.type_name()
                }
            }
            impl Plain for $ty {
                const TOPIC: &'static Topic = &topics::$topic;
                fn order(&self) -> Option<(u32, u32)> {
                    Some((self.header.boot, self.header.sequence))
                }
                fn at_ns(&self) -> i64 {
                    self.header.at.nanos()
                }
            }
        )*
        /// Visits every type.
        pub(super) fn each(visitor: &mut impl Visitor) -> Result<(), TransportError> {
            $(visitor.visit::<$ty>()?;)*
            visitor.visit::<ProcessState>()
        }
    };
}
plain! {
    msg::DroneState => DRONE_STATE;
    msg::AutopilotState => AUTOPILOT;
    msg::TagPose => TAG;
    msg::UvdarFix => UVDAR;
    msg::RangeSample => RANGE;
    msg::LinkState => LINK;
    msg::VesselEstimate<DroneClock> => BRIDGE_ESTIMATE;
    msg::WaveModel<DroneClock> => BRIDGE_WAVE;
    msg::VesselPrediction<DroneClock> => BRIDGE_PREDICTION;
    msg::VesselSurroundings<DroneClock> => BRIDGE_SURROUNDINGS;
    msg::DeckGrant<DroneClock> => BRIDGE_DECK;
    msg::DeckForecast => FORECAST;
    msg::MissionState => MISSION;
    msg::Plan => PLAN;
    msg::SetPoint => SET_POINT;
    msg::Command => COMMAND;
    msg::SettingsOrder => SETTINGS;
    msg::DeckBeacon => BEACON;
    msg::CameraLight => CAMERA_LIGHT;
    msg::MissionCheckpoint => MISSION_CHECKPOINT;
    msg::PredictorCheckpoint => PREDICTOR_CHECKPOINT;
    msg::LinkCheckpoint => LINK_CHECKPOINT;
    msg::SensorReadings => SENSORS;
    msg::SourceReport => SOURCES;
    msg::VesselStatus => VESSEL;
    msg::CrewOrder => CREW;
}

// SAFETY: as above.
unsafe impl ZeroCopySend for ProcessState {
    unsafe fn type_name() -> &'static str {
        topics::PROCESS.type_name()
    }
}
impl Plain for ProcessState {
    const TOPIC: &'static Topic = &topics::PROCESS;
    fn order(&self) -> Option<(u32, u32)> {
        // Many processes share the topic: a gap means nothing.
        None
    }
    fn at_ns(&self) -> i64 {
        self.at_ns
    }
}

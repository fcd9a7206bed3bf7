//! Moving base: RTCM 3 of the vessel's receiver on its way to the drone's, and the relative place that comes of it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, MAX_POSITION_M, Seq, positive, within};
use crate::rtcm::MAX_FRAME_BYTES;
use crate::time::{Clock, DroneClock, Time};

/// Frames of RTCM 3 of the vessel's receiver, passed on as they are: as many of one time as fit, so that an epoch is whole or lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct RtcmFrames<C: Clock> {
    /// Identity; `at` is the time of its arrival at the vessel's computer.
    pub header: Header<C>,
    /// Antenna of the receiver from the deck's centre, in the vessel's body frame, m.
    pub antenna_m: [f32; 3],
    /// One frame or several, each from its preamble to its checksum.
    pub bytes: Seq<u8, MAX_FRAME_BYTES>,
}

restamped!(RtcmFrames { antenna_m, bytes });
message!(@C RtcmFrames<C>, C, |m| {
    within(&m.antenna_m, 100.0) => "antenna_m",
    crate::rtcm::frames(&m.bytes).is_some() => "bytes",
});

/// Solution of the carrier phases' ambiguities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum CarrierSolution {
    /// None: the place is by code alone, to a metre or more.
    #[default]
    None,
    /// Float: to some decimetres, with errors that last.
    Float,
    /// Fixed: to centimetres, where it is the right one.
    Fixed,
}

/// Place of the drone's antenna relative to the vessel's, by a receiver that uses the vessel's as its moving base.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RelativePlace {
    /// Identity; `at` is the time of the measurement.
    pub header: Header<DroneClock>,
    /// From the vessel's antenna to the drone's, NED, m.
    pub baseline_m: [f64; 3],
    /// Standard deviation of each component, m.
    pub baseline_sd_m: [f64; 3],
    /// Solution of the ambiguities.
    pub solution: CarrierSolution,
    /// Antenna of the vessel's receiver from the deck's centre, in the vessel's body frame, m.
    pub antenna_m: [f32; 3],
}

message!(RelativePlace, DroneClock, |m| {
    within(&m.baseline_m, MAX_POSITION_M) => "baseline_m",
    positive(&m.baseline_sd_m, 1e4) => "baseline_sd_m",
    within(&m.antenna_m, 100.0) => "antenna_m",
});

/// State of the relative place in a forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RelativeState {
    /// Newest solution.
    pub solution: CarrierSolution,
    /// Standard deviation of each horizontal axis, as the receiver states it, m.
    pub sd_m: f64,
    /// Age of the newest measurement, s.
    pub age_s: f64,
    /// Age of the newest that was used, s; infinite when there was none since it is trusted.
    pub used_age_s: f64,
    /// The tags have confirmed this solution.
    pub confirmed: bool,
    /// The tags have contradicted it, by so much, m: it is not used until it has been solved again.
    pub contradicted_m: Option<f64>,
}

impl RelativeState {
    /// Age of a measurement that may stand in for a detection of the deck, s: of a fixed solution that the tags have confirmed;
    /// infinite without one.
    pub fn stands_in_age_s(&self) -> f64 {
        if self.confirmed && self.contradicted_m.is_none() {
            self.used_age_s
        } else {
            f64::INFINITY
        }
    }
    pub(super) fn is_sound(&self) -> bool {
        let all = [self.sd_m, self.contradicted_m.unwrap_or(0.0)];
        all.iter().all(|v| (0.0..1e4).contains(v)) && self.age_s >= 0.0 && self.used_age_s >= 0.0
    }
}

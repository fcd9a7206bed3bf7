//! Moving base: RTCM 3 frames of the vessel's receiver for the drone's, and the resulting relative position.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, MAX_POSITION_M, Seq, positive, within};
use crate::{
    rtcm::MAX_FRAME_BYTES,
    time::{Clock, DroneClock, Time},
};

/// RTCM 3 frames of the vessel's receiver, unchanged. An epoch that fits into one message arrives whole or is lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct RtcmFrames<C: Clock> {
    /// Identity; `at` is the arrival time at the vessel's computer.
    pub header: Header<C>,
    /// Antenna of the receiver relative to the deck's centre, in the vessel's body frame, m.
    pub antenna_m: [f32; 3],
    /// One or several frames, each from its preamble to its checksum.
    pub bytes: Seq<u8, MAX_FRAME_BYTES>,
}

restamped!(RtcmFrames { antenna_m, bytes });
message!(@C RtcmFrames<C>, C, |m| {
    within(&m.antenna_m, 100.0) => "antenna_m",
    crate::rtcm::frames(&m.bytes).is_some() => "bytes",
});

/// Carrier-phase ambiguity solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum CarrierSolution {
    /// No solution: code position only, accurate to a metre or more.
    #[default]
    None,
    /// Float solution: accurate to a few decimetres, with persistent errors.
    Float,
    /// Fixed solution: accurate to centimetres if the ambiguities are correct.
    Fixed,
}

/// Position of the drone's antenna relative to the vessel's, from a receiver that uses the vessel's as moving base.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RelativePlace {
    /// Identity; `at` is the time of the measurement.
    pub header: Header<DroneClock>,
    /// Baseline from the vessel's antenna to the drone's, NED, m.
    pub baseline_m: [f64; 3],
    /// Standard deviation of each component, m.
    pub baseline_sd_m: [f64; 3],
    /// Ambiguity solution.
    pub solution: CarrierSolution,
    /// Antenna of the vessel's receiver relative to the deck's centre, in the vessel's body frame, m.
    pub antenna_m: [f32; 3],
}

message!(RelativePlace, DroneClock, |m| {
    within(&m.baseline_m, MAX_POSITION_M) => "baseline_m",
    positive(&m.baseline_sd_m, 1e4) => "baseline_sd_m",
    within(&m.antenna_m, 100.0) => "antenna_m",
});

/// State of the relative position in a forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct RelativeState {
    /// Newest solution.
    pub solution: CarrierSolution,
    /// Standard deviation on each horizontal axis as stated by the receiver, m.
    pub sd_m: f64,
    /// Age of the newest measurement, s.
    pub age_s: f64,
    /// Age of the newest measurement used, s; infinite if none was used since it became trusted.
    pub used_age_s: f64,
    /// The tags have confirmed this solution.
    pub confirmed: bool,
    /// Distance by which the tags have contradicted the solution, m; the solution is not used until solved again.
    pub contradicted_m: Option<f64>,
}

impl RelativeState {
    /// Age of a measurement that may replace a detection, s; infinite unless its solution is fixed and confirmed by tags.
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

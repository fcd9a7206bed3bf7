//! Measurements of the vessel's sensors, on its clock, in axes rotated to its FRD. Lever arms are configured.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, MAX_TILT_RAD, positive, within};
use crate::{geodesy::Datum, time::VesselClock};

/// Maximum number of sources of one kind of measurement on a vessel.
pub const MAX_SOURCES: usize = 8;
/// Standard deviation of a component that its source does not measure (m, m/s): the filter ignores it.
pub const NOT_MEASURED_SD: f64 = 5e3;

/// Measurement of an inertial sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ImuSample {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Angular rate, rad/s.
    pub gyro: [f64; 3],
    /// Specific force, m/s².
    pub accelerometer: [f64; 3],
    /// Number of the inertial sensor.
    pub source: u8,
    /// Position of the sensor in the vessel's body frame, m; None: as configured.
    pub lever_arm: Option<[f64; 3]>,
}

/// GNSS fix of an antenna.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct GnssFix {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Origin of the NED plane that `position` is expressed in.
    pub datum: Datum,
    /// Antenna position, NED, m.
    pub position: [f64; 3],
    /// Antenna velocity, NED, m/s.
    pub velocity: [f64; 3],
    /// Standard deviation of each component of `position` without slow bias, m.
    pub position_sd: [f64; 3],
    /// Standard deviation of each component of `velocity`, m/s.
    pub velocity_sd: [f64; 3],
    /// Standard deviation of the height's reference surface, m, common to all fixes of a receiver, so that it
    /// does not average out; zero if the receiver states heights above the ellipsoid.
    pub height_spread: f64,
    /// Number of the receiver.
    pub source: u8,
    /// Position of the antenna in the vessel's body frame, m; None: as configured.
    pub lever_arm: Option<[f64; 3]>,
}

/// Heading from a compass or from two GNSS antennas.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct HeadingFix {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Heading, rad from true north towards east.
    pub heading: f64,
    /// Standard deviation, rad.
    pub heading_sd: f64,
    /// Rate of turn, rad/s, if reported.
    pub rate: Option<f64>,
    /// Number of the heading sensor.
    pub source: u8,
}

/// Attitude and related outputs of a motion sensor or INS. It replaces the inertial sensor on a vessel without one.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AttitudeFix {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Roll and pitch of the vessel's body, rad.
    pub tilt: [f64; 2],
    /// Standard deviation of each, rad.
    pub tilt_sd: f64,
    /// Angular rate of the body, rad/s.
    pub rates: Option<[f64; 3]>,
    /// Heave of the reference point about its mean level, m, positive down.
    pub heave: Option<f64>,
    /// Standard deviation of the heave, m.
    pub heave_sd: f64,
    /// Number of the attitude sensor.
    pub source: u8,
}

fn is_source(source: u8) -> bool {
    usize::from(source) < MAX_SOURCES
}
fn is_lever_arm(lever_arm: &Option<[f64; 3]>) -> bool {
    lever_arm.is_none_or(|a| within(&a, 100.0))
}

message!(ImuSample, VesselClock, |m| {
    within(&m.gyro, MAX_RATE_RPS) => "gyro",
    within(&m.accelerometer, 500.0) => "accelerometer",
    is_source(m.source) => "source",
    is_lever_arm(&m.lever_arm) => "lever_arm",
});
message!(GnssFix, VesselClock, |m| {
    within(&m.position, MAX_POSITION_M) => "position",
    within(&m.velocity, MAX_SPEED_MPS) => "velocity",
    m.datum.is_on_earth() => "datum",
    positive(&m.position_sd, 1e4) && positive(&m.velocity_sd, 1e4) => "standard deviations",
    within([&m.height_spread], 1e4) && m.height_spread >= 0.0 => "height_spread",
    is_source(m.source) => "source",
    is_lever_arm(&m.lever_arm) => "lever_arm",
});
message!(HeadingFix, VesselClock, |m| {
    within([&m.heading], 50.0) => "heading",
    positive([&m.heading_sd], 10.0) => "heading_sd",
    m.rate.is_none_or(|r| within([&r], MAX_RATE_RPS)) => "rate",
    is_source(m.source) => "source",
});
message!(AttitudeFix, VesselClock, |m| {
    within(&m.tilt, MAX_TILT_RAD) => "tilt",
    positive([&m.tilt_sd], 10.0) => "tilt_sd",
    m.rates.is_none_or(|r| within(&r, MAX_RATE_RPS)) => "rates",
    m.heave.is_none_or(|h| within([&h], 100.0) && positive([&m.heave_sd], 1e4)) => "heave",
    is_source(m.source) => "source",
});

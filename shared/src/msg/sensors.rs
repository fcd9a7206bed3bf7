//! What the vessel's sensors measure, on the vessel's clock, in the sensor's own axes turned to
//! the vessel's FRD. Lever arms are configuration.

use serde::{Deserialize, Serialize};

use super::{Header, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, Message, within};
use crate::frames::Datum;
use crate::time::VesselClock;

/// Most sources of one kind of measurement on a vessel.
pub const MAX_SOURCES: usize = 8;
/// Standard deviation of a component that its source does not measure (m, m/s): the filter learns
/// nothing from it.
pub const NOT_MEASURED_SD: f64 = 5e3;

/// An inertial measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[repr(C)]
pub struct ImuSample {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Angular rate, rad/s.
    pub gyro: [f64; 3],
    /// Specific force, m/s².
    pub accelerometer: [f64; 3],
    /// Which of the vessel's inertial sensors.
    pub source: u8,
    /// Its place in the vessel's body frame, m; none: where the configuration has it.
    pub lever_arm: Option<[f64; 3]>,
}

/// A GNSS fix of the antenna.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Standard deviation of each component of `position`, without slow bias, m.
    pub position_sd: [f64; 3],
    /// Standard deviation of each component of `velocity`, m/s.
    pub velocity_sd: [f64; 3],
    /// Which of the vessel's receivers.
    pub source: u8,
    /// Its antenna in the vessel's body frame, m; none: where the configuration has it.
    pub lever_arm: Option<[f64; 3]>,
}

/// A heading, from a compass or from two GNSS antennas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[repr(C)]
pub struct HeadingFix {
    /// Identity and time of measurement.
    pub header: Header<VesselClock>,
    /// Heading, rad from true north towards east.
    pub heading: f64,
    /// Standard deviation, rad.
    pub heading_sd: f64,
    /// Rate of turn, rad/s, where it is told.
    pub rate: Option<f64>,
    /// Which of the vessel's heading sensors.
    pub source: u8,
}

/// An attitude, and what comes with it, as a motion sensor or an INS works it out itself. It stands
/// in for the inertial sensor where there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Heave of the reference point about the mean level, m down.
    pub heave: Option<f64>,
    /// Its standard deviation, m.
    pub heave_sd: f64,
    /// Which of the vessel's attitude sensors.
    pub source: u8,
}

/// A source that there may be, in a place on a vessel.
fn check_source(source: u8, lever_arm: Option<&[f64; 3]>) -> Result<(), &'static str> {
    if usize::from(source) >= MAX_SOURCES {
        return Err("source");
    }
    if !lever_arm.is_none_or(|a| within(a, 100.0)) {
        return Err("arm");
    }
    Ok(())
}

impl Message for ImuSample {
    type Clock = VesselClock;
    fn header(&self) -> &Header<VesselClock> {
        &self.header
    }
    fn check(&self) -> Result<(), &'static str> {
        if !within(&self.gyro, MAX_RATE_RPS) {
            return Err("gyro");
        }
        if !within(&self.accelerometer, 500.0) {
            return Err("accelerometer");
        }
        check_source(self.source, self.lever_arm.as_ref())?;
        Ok(())
    }
}
impl Message for GnssFix {
    type Clock = VesselClock;
    fn header(&self) -> &Header<VesselClock> {
        &self.header
    }
    fn check(&self) -> Result<(), &'static str> {
        if !within(&self.position, MAX_POSITION_M) {
            return Err("position");
        }
        if !within(&self.velocity, MAX_SPEED_MPS) {
            return Err("velocity");
        }
        if !within([&self.datum.latitude_deg], 90.0)
            || !within([&self.datum.longitude_deg], 360.0)
            || !within([&self.datum.height_m], 1e4)
        {
            return Err("datum");
        }
        if !self
            .position_sd
            .iter()
            .chain(&self.velocity_sd)
            .all(|v| *v > 0.0 && *v < 1e4)
        {
            return Err("standard deviations");
        }
        check_source(self.source, self.lever_arm.as_ref())?;
        Ok(())
    }
}
impl Message for HeadingFix {
    type Clock = VesselClock;
    fn header(&self) -> &Header<VesselClock> {
        &self.header
    }
    fn check(&self) -> Result<(), &'static str> {
        if !within([&self.heading], 50.0) {
            return Err("heading");
        }
        if !(self.heading_sd > 0.0 && self.heading_sd < 10.0) {
            return Err("heading_sd");
        }
        if !self.rate.is_none_or(|r| within([&r], MAX_RATE_RPS)) {
            return Err("rate");
        }
        check_source(self.source, None)
    }
}
impl Message for AttitudeFix {
    type Clock = VesselClock;
    fn header(&self) -> &Header<VesselClock> {
        &self.header
    }
    fn check(&self) -> Result<(), &'static str> {
        // Beyond it a vessel has capsized.
        if !within(&self.tilt, 1.3) {
            return Err("tilt");
        }
        if !(self.tilt_sd > 0.0 && self.tilt_sd < 10.0) {
            return Err("tilt_sd");
        }
        if !self.rates.is_none_or(|r| within(&r, MAX_RATE_RPS)) {
            return Err("rates");
        }
        if !self
            .heave
            .is_none_or(|h| within([&h], 100.0) && self.heave_sd > 0.0 && self.heave_sd < 1e4)
        {
            return Err("heave");
        }
        check_source(self.source, None)
    }
}

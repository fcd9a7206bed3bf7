//! What the vessel's sensors measure, on the vessel's clock, in the sensor's own axes turned to
//! the vessel's FRD. Lever arms are configuration.

use serde::{Deserialize, Serialize};

use super::{Header, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, Message, within};
use crate::frames::Datum;
use crate::time::VesselClock;

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
        if !self
            .position_sd
            .iter()
            .chain(&self.velocity_sd)
            .all(|v| *v > 0.0 && *v < 1e4)
        {
            return Err("standard deviations");
        }
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
        Ok(())
    }
}

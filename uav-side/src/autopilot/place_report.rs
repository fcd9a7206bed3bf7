//! Position of another system, received by MAVLink.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaceReport {
    /// Deg, north positive.
    pub latitude_deg: f64,
    /// Deg, east positive.
    pub longitude_deg: f64,
    /// Velocity north and east, m/s; None if not reported.
    pub velocity: Option<[f64; 2]>,
    /// Horizontal error, m; None if not stated.
    pub error_m: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AisReport {
    /// Maritime Mobile Service Identity of the vessel, nine digits.
    pub mmsi: u32,
    pub place: PlaceReport,
    /// Time since the report was received, s.
    pub age_s: f64,
}

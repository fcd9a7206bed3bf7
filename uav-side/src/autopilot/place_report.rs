//! Position of another system, received by MAVLink.

use alight_shared::mavlink::dialect as m;
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

impl From<&m::GLOBAL_POSITION_INT_DATA> for PlaceReport {
    fn from(d: &m::GLOBAL_POSITION_INT_DATA) -> PlaceReport {
        PlaceReport {
            latitude_deg: f64::from(d.lat) * 1e-7,
            longitude_deg: f64::from(d.lon) * 1e-7,
            velocity: Some([d.vx, d.vy].map(|v| f64::from(v) * 0.01)),
            error_m: None,
        }
    }
}

impl From<&m::FOLLOW_TARGET_DATA> for PlaceReport {
    fn from(d: &m::FOLLOW_TARGET_DATA) -> PlaceReport {
        let [north, east, _] = d.vel.map(f64::from);
        let error_m = f64::from(d.position_cov[0]);
        PlaceReport {
            latitude_deg: f64::from(d.lat) * 1e-7,
            longitude_deg: f64::from(d.lon) * 1e-7,
            // Zeros mean that the velocity is unknown.
            velocity: Some([north, east]).filter(|v| *v != [0.0; 2]),
            error_m: Some(error_m).filter(|m| *m > 0.0 && m.is_finite()),
        }
    }
}

impl PlaceReport {
    pub fn follow_target(&self) -> m::MavMessage {
        let [north, east] = self.velocity.unwrap_or_default();
        m::MavMessage::FOLLOW_TARGET(m::FOLLOW_TARGET_DATA {
            lat: (self.latitude_deg * 1e7).round() as i32,
            lon: (self.longitude_deg * 1e7).round() as i32,
            vel: [north as f32, east as f32, 0.0],
            position_cov: [self.error_m.unwrap_or(0.0) as f32, 0.0, 0.0],
            ..m::FOLLOW_TARGET_DATA::DEFAULT
        })
    }
}

impl From<&m::AIS_VESSEL_DATA> for AisReport {
    /// The velocity requires a valid speed and course.
    fn from(d: &m::AIS_VESSEL_DATA) -> AisReport {
        let valid = m::AisFlags::AIS_FLAGS_VALID_COG | m::AisFlags::AIS_FLAGS_VALID_VELOCITY;
        let (sin, cos) = (f64::from(d.COG) * 0.01).to_radians().sin_cos();
        let speed_mps = f64::from(d.velocity) * 0.01;
        AisReport {
            mmsi: d.MMSI,
            place: PlaceReport {
                latitude_deg: f64::from(d.lat) * 1e-7,
                longitude_deg: f64::from(d.lon) * 1e-7,
                velocity: (d.flags.contains(valid)).then_some([speed_mps * cos, speed_mps * sin]),
                error_m: None,
            },
            age_s: f64::from(d.tslc),
        }
    }
}

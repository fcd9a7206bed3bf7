//! Measured shapes that vessel and drone agree on.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::config::{Check, ConfigError, Keys};

/// Standard gravity, m/s².
pub const GRAVITY: f64 = 9.806_65;

/// The landing deck, in the vessel's body frame (FRD, origin midships on the waterline at rest).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeckGeometry {
    /// Centre of the deck's upper surface, m.
    pub centre_m: [f64; 3],
    /// Length along the vessel, m.
    pub length_m: f64,
    /// Width across the vessel, m.
    pub width_m: f64,
    /// Side of the fiducial tag, black square, m.
    pub tag_side_m: f64,
    /// Tag's centre in the deck frame, m.
    pub tag_centre_m: [f64; 3],
}

impl Default for DeckGeometry {
    /// The paper's vessel: deck 2.5 x 1.7 m with an AprilTag of 1 m side (Procházka 2024); height
    /// of 1.3 m from the Virtual RobotX WAM-V.
    fn default() -> Self {
        DeckGeometry {
            centre_m: [0.0, 0.0, -1.3],
            length_m: 2.5,
            width_m: 1.7,
            tag_side_m: 1.0,
            tag_centre_m: [0.0, 0.0, 0.0],
        }
    }
}
impl DeckGeometry {
    /// Deck centre in the body frame, m.
    pub fn centre(&self) -> Vector3<f64> {
        Vector3::from(self.centre_m)
    }
}
impl Check for DeckGeometry {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.ranges("centre_m", &self.centre_m, -50.0, 50.0)?;
        at.range("length_m", self.length_m, 0.5, 100.0)?;
        at.range("width_m", self.width_m, 0.5, 100.0)?;
        at.range("tag_side_m", self.tag_side_m, 0.02, 10.0)?;
        at.ranges("tag_centre_m", &self.tag_centre_m, -50.0, 50.0)
    }
}

/// The drone as its planner and pilot know it: nominal values, the real ones differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DroneGeometry {
    /// Take-off mass, kg.
    pub mass_kg: f64,
    /// Moments of inertia about forward, right, down, kg m².
    pub inertia_kgm2: [f64; 3],
    /// Distance of each rotor from the centre, m.
    pub arm_m: f64,
    /// Ratio of rotor drag moment to thrust, m.
    pub moment_per_force_m: f64,
    /// Greatest total thrust, N.
    pub max_thrust_n: f64,
    /// Fore-aft and sideways distance between the feet, m.
    pub feet_span_m: [f64; 2],
    /// Foot plane below the centre of mass, m.
    pub feet_below_m: f64,
    /// Camera's optical centre in the body frame, m; it looks down, image up is forward.
    pub camera_m: [f64; 3],
    /// Rangefinder in the body frame, m; it looks down.
    pub rangefinder_m: [f64; 3],
    /// Lag of the autopilot's attitude loop, s.
    pub attitude_lag_s: f64,
}

impl Default for DroneGeometry {
    /// The paper's drone: 3.5 kg on a Tarot T650 (Procházka 2024; mass, arm), inertia and thrust
    /// limit as derived from ctu-mrs `t650`: rotor force 7.3385e-7 N/rpm² up to 5832 rpm.
    fn default() -> Self {
        DroneGeometry {
            mass_kg: 3.5,
            inertia_kgm2: [0.099, 0.099, 0.185],
            arm_m: 0.325,
            moment_per_force_m: 0.016,
            max_thrust_n: 99.8,
            feet_span_m: [0.40, 0.40],
            feet_below_m: 0.30,
            camera_m: [0.0, 0.0, 0.08],
            rangefinder_m: [0.10, 0.0, 0.08],
            attitude_lag_s: 0.2,
        }
    }
}
impl Check for DroneGeometry {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("mass_kg", self.mass_kg, 0.1, 100.0)?;
        at.ranges("inertia_kgm2", &self.inertia_kgm2, 1e-4, 100.0)?;
        at.range("arm_m", self.arm_m, 0.05, 5.0)?;
        at.range("moment_per_force_m", self.moment_per_force_m, 1e-4, 1.0)?;
        at.range(
            "max_thrust_n",
            self.max_thrust_n,
            1.2 * self.mass_kg * GRAVITY,
            1e4,
        )?;
        at.ranges("feet_span_m", &self.feet_span_m, 0.05, 5.0)?;
        at.range("feet_below_m", self.feet_below_m, 0.02, 5.0)?;
        at.ranges("camera_m", &self.camera_m, -5.0, 5.0)?;
        at.ranges("rangefinder_m", &self.rangefinder_m, -5.0, 5.0)?;
        at.range("attitude_lag_s", self.attitude_lag_s, 0.0, 1.0)
    }
}

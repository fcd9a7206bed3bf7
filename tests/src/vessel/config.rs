//! The simulated vessel's figures.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

/// What the vessel's own autopilot does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Course {
    /// Engines off.
    #[default]
    Drift,
    /// Along the starting heading at a set speed.
    Straight,
    /// Around a square, turning to starboard, the first leg along the starting heading.
    Square,
}

/// Somebody presses or pushes the vessel, and lets go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Push {
    /// When, s of true time.
    pub at_s: f64,
    /// For how long, s.
    pub for_s: f64,
    /// How hard: surge, sway, heave, roll, pitch, yaw of the body, N and Nm.
    pub by_n_nm: [f64; 6],
}

/// Vessel as truth: nonlinear, and by purpose not the model that estimator and predictor use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VesselConfig {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of gravity in the body frame (origin midships on the waterline at rest), m.
    pub centre_of_gravity_m: [f64; 3],
    /// Moments of inertia about the centre of gravity, forward, right, down, kg m².
    pub inertia_kgm2: [f64; 3],
    /// Added mass as a share of mass (surge, sway, heave) and of inertia (roll, pitch, yaw), -.
    pub added_mass: [f64; 6],
    /// Radius of the half-cylinder hulls, m.
    pub hull_radius_m: f64,
    /// Their length, m.
    pub hull_length_m: f64,
    /// Distance of each hull from the centre line, m.
    pub hull_offset_m: f64,
    /// Sections per hull over which pressure is integrated.
    pub sections_per_hull: usize,
    /// Damping ratio of heave, roll and pitch relative to the moving water, -.
    pub damping_ratio: [f64; 3],
    /// Linear drag relative to the moving water, surge and sway, N/(m/s).
    pub linear_drag_nspm: [f64; 2],
    /// Quadratic drag, surge and sway, N/(m/s)².
    pub quadratic_drag_ns2pm2: [f64; 2],
    /// Linear yaw drag, Nm/(rad/s).
    pub linear_yaw_drag_nms: f64,
    /// Quadratic yaw drag, Nm/(rad/s)².
    pub quadratic_yaw_drag_nms2: f64,
    /// How much of the water's horizontal motion reaches surge, sway and yaw: 1 is physics, 0 the stock
    /// simulator whose buoyancy is purely vertical.
    pub sideways_coupling: f64,
    /// Greatest forward thrust of each of the two engines, N.
    pub thrust_forward_n: f64,
    /// Greatest reverse thrust of each, N.
    pub thrust_reverse_n: f64,
    /// What the vessel's autopilot does.
    pub course: Course,
    /// Its speed through the water, m/s.
    pub speed_mps: f64,
    /// Side of the square, m.
    pub side_m: f64,
    /// Starting heading clockwise from north, deg; drawn per seed where absent.
    pub heading_deg: Option<f64>,
    /// Pushes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pushes: Vec<Push>,
}

impl Default for VesselConfig {
    /// Virtual RobotX WAM-V with both engines (osrf/vrx: mass, inertia, hulls, surge drag, thrust; sway and
    /// yaw drag from its newer set); added mass of the Otter (Fossen, MSS toolbox; its surge share is 0.1),
    /// relative damping heave 0.3, roll 0.2, pitch 0.4 (likewise). Ours: centre of gravity 0.2 m above the
    /// water, 12 sections per hull, square of 40 m so that a leg lasts 20 s at 2 m/s.
    fn default() -> Self {
        VesselConfig {
            mass_kg: 211.0,
            centre_of_gravity_m: [0.0, 0.0, -0.2],
            inertia_kgm2: [120.0, 393.0, 446.0],
            added_mass: [0.1, 1.5, 1.0, 0.2, 0.8, 1.7],
            hull_radius_m: 0.213,
            hull_length_m: 4.9,
            hull_offset_m: 1.03,
            sections_per_hull: 12,
            damping_ratio: [0.3, 0.2, 0.4],
            linear_drag_nspm: [51.3, 100.0],
            quadratic_drag_ns2pm2: [72.4, 100.0],
            linear_yaw_drag_nms: 400.0,
            quadratic_yaw_drag_nms2: 800.0,
            sideways_coupling: 1.0,
            thrust_forward_n: 250.0,
            thrust_reverse_n: 100.0,
            course: Course::Drift,
            speed_mps: 2.0,
            side_m: 40.0,
            heading_deg: None,
            pushes: Vec::new(),
        }
    }
}

impl Check for VesselConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("hull_radius_m", self.hull_radius_m, 0.05, 5.0)?;
        at.range("hull_length_m", self.hull_length_m, 0.5, 50.0)?;
        at.range("hull_offset_m", self.hull_offset_m, 0.1, 20.0)?;
        // Two half cylinders carry at most rho pi r² L; beyond 0.7 of it they would be awash.
        let carried = crate::sea::WATER_DENSITY
            * core::f64::consts::PI
            * self.hull_radius_m.powi(2)
            * self.hull_length_m;
        at.range("mass_kg", self.mass_kg, 0.02 * carried, 0.7 * carried)?;
        at.ranges("centre_of_gravity_m", &self.centre_of_gravity_m, -2.0, 2.0)?;
        // Radii of gyration between a twentieth and twice the hull's length.
        let l2 = self.mass_kg * self.hull_length_m.powi(2);
        at.ranges("inertia_kgm2", &self.inertia_kgm2, l2 / 400.0, 4.0 * l2)?;
        at.ranges("added_mass", &self.added_mass, 0.0, 5.0)?;
        at.require(
            (5..=40).contains(&self.sections_per_hull),
            "sections_per_hull",
            self.sections_per_hull,
            "5 to 40",
        )?;
        at.ranges("damping_ratio", &self.damping_ratio, 0.0, 2.0)?;
        at.ranges("linear_drag_nspm", &self.linear_drag_nspm, 0.0, 5e3)?;
        at.ranges("quadratic_drag_ns2pm2", &self.quadratic_drag_ns2pm2, 0.0, 5e3)?;
        at.range("linear_yaw_drag_nms", self.linear_yaw_drag_nms, 0.0, 2e4)?;
        at.range("quadratic_yaw_drag_nms2", self.quadratic_yaw_drag_nms2, 0.0, 2e4)?;
        at.range("sideways_coupling", self.sideways_coupling, 0.0, 1.0)?;
        at.range("thrust_forward_n", self.thrust_forward_n, 0.0, 1e5)?;
        at.range("thrust_reverse_n", self.thrust_reverse_n, 0.0, 1e5)?;
        at.range("speed_mps", self.speed_mps, 0.0, 10.0)?;
        at.range("side_m", self.side_m, 5.0, 5e3)?;
        for push in &self.pushes {
            at.range("pushes.at_s", push.at_s, 0.0, 1e6)?;
            at.range("pushes.for_s", push.for_s, 0.0, 1e3)?;
            at.ranges("pushes.by_n_nm", &push.by_n_nm, -1e6, 1e6)?;
        }
        at.require(
            self.pushes.len() <= 100,
            "pushes",
            self.pushes.len(),
            "at most 100",
        )?;
        if let Some(h) = self.heading_deg {
            at.range("heading_deg", h, -360.0, 360.0)?;
        }
        Ok(())
    }
}

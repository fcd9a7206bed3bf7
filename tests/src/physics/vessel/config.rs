use alight_shared::config;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VesselCourse {
    /// Engines off.
    #[default]
    Drift,
    /// Straight along the starting heading.
    Straight,
    /// A square to starboard; the first leg is along the starting heading.
    Square,
    /// Turns by 20 to 40 deg to alternate sides of the starting heading, every 10 to 20 s.
    Zigzag,
    /// One turn of 45 to 120 deg to either side.
    Turn,
    /// One speed change by half, up or down.
    SpeedChange,
    /// Keeps position within 1.5 m and heading within 12 deg, in limit cycles of thrusters with a dead band.
    /// The seed draws the cycles; thrusters are not simulated.
    StationKeeping,
    /// Sheers at anchor: the bow swings by 20 to 40 deg to either side in 60 to 120 s, and the hull moves along an arc.
    Anchored,
}

impl VesselCourse {
    pub const ALL: [VesselCourse; 8] = [
        VesselCourse::Drift,
        VesselCourse::Straight,
        VesselCourse::Square,
        VesselCourse::Zigzag,
        VesselCourse::Turn,
        VesselCourse::SpeedChange,
        VesselCourse::StationKeeping,
        VesselCourse::Anchored,
    ];
    pub fn is_under_way(self) -> bool {
        match self {
            VesselCourse::Drift | VesselCourse::StationKeeping | VesselCourse::Anchored => false,
            VesselCourse::Straight
            | VesselCourse::Square
            | VesselCourse::Zigzag
            | VesselCourse::Turn
            | VesselCourse::SpeedChange => true,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VesselLoad {
    /// Start of the load, s of true time.
    pub at_s: f64,
    pub for_s: f64,
    /// Force and moment in the vessel's body axes: surge, sway, heave, roll, pitch, yaw, N and Nm.
    pub by_n_nm: [f64; 6],
}

config! {
    /// Truth model of the vessel: nonlinear, and intentionally different from the model of estimator and predictor.
    ///
    /// Defaults: Virtual RobotX WAM-V with both engines (osrf/vrx: mass, inertia, hulls, surge drag, thrust;
    /// sway and yaw drag from its newer set); added mass (with a surge fraction of 0.1) and damping ratios
    /// (heave 0.3, roll 0.2, pitch 0.4) of the Otter (Fossen, MSS toolbox). Chosen: centre of gravity 0.2 m
    /// above the water, 12 sections per hull, a square with sides of 40 m (20 s per leg at 2 m/s).
    pub struct VesselConfig {
        /// Mass, kg.
        pub mass_kg: f64 = 211.0;
        /// Centre of gravity in the body frame (origin amidships at the still-water line), m.
        pub centre_of_gravity_m: [f64; 3] = [0.0, 0.0, -0.2], in -2.0..=2.0;
        /// Moments of inertia about the centre of gravity, forward, right, down, kg m².
        pub inertia_kgm2: [f64; 3] = [120.0, 393.0, 446.0];
        /// Added mass as a fraction of mass (surge, sway, heave) and of inertia (roll, pitch, yaw).
        pub added_mass: [f64; 6] = [0.1, 1.5, 1.0, 0.2, 0.8, 1.7], in 0.0..=5.0;
        /// Radius of the half-cylinder hulls, m.
        pub hull_radius_m: f64 = 0.213, in 0.05..=5.0;
        /// Length of the hulls, m.
        pub hull_length_m: f64 = 4.9, in 0.5..=50.0;
        /// Distance of each hull from the centre line, m.
        pub hull_offset_m: f64 = 1.03, in 0.1..=20.0;
        /// Sections per hull for the integration of the pressure.
        pub sections_per_hull: usize = 12, in 5.0..=40.0;
        /// Damping ratio of heave, roll and pitch relative to the moving water.
        pub damping_ratio: [f64; 3] = [0.3, 0.2, 0.4], in 0.0..=2.0;
        /// Linear drag relative to the moving water, surge and sway, N/(m/s).
        pub linear_drag_nspm: [f64; 2] = [51.3, 100.0], in 0.0..=5e3;
        /// Quadratic drag, surge and sway, N/(m/s)².
        pub quadratic_drag_ns2pm2: [f64; 2] = [72.4, 100.0], in 0.0..=5e3;
        /// Linear yaw drag, Nm/(rad/s).
        pub linear_yaw_drag_nms: f64 = 400.0, in 0.0..=2e4;
        /// Quadratic yaw drag, Nm/(rad/s)².
        pub quadratic_yaw_drag_nms2: f64 = 800.0, in 0.0..=2e4;
        /// Fraction of the water's horizontal motion that acts on surge, sway and yaw. 1 is physical; 0
        /// corresponds to VRX, whose buoyancy is purely vertical.
        pub sideways_coupling: f64 = 1.0, in 0.0..=1.0;
        /// Maximum forward thrust of each engine, N.
        pub thrust_forward_n: f64 = 250.0, in 0.0..=1e5;
        /// Maximum reverse thrust of each engine, N.
        pub thrust_reverse_n: f64 = 100.0, in 0.0..=1e5;
        /// Course that the vessel's autopilot follows.
        pub course: VesselCourse = VesselCourse::Drift;
        /// Speed of the vessel through the water, m/s.
        pub speed_mps: f64 = 2.0, in 0.0..=10.0;
        /// Start of the course's turn or speed change, s of true time. If missing, it is a random time 0 to 6
        /// s after a trial's first descent, unknown to all nodes.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub change_at_s: Option<f64> = None, in 0.0..=1e6;
        /// Length of the square's sides, m.
        pub side_m: f64 = 40.0, in 5.0..=5e3;
        /// Starting heading, clockwise from north, deg; drawn per seed if missing.
        pub heading_deg: Option<f64> = None, in -360.0..=360.0;
        /// Loads that act on the vessel for a limited time.
        #[serde(skip_serializing_if = "Vec::is_empty", alias = "pushes")]
        pub loads: Vec<VesselLoad> = Vec::new();
    }
    check |this, at| {
        // Two half-cylinders carry at most rho pi r² L, and are awash above 0.7 of that.
        let carried = crate::physics::sea::WATER_DENSITY
            * core::f64::consts::PI
            * this.hull_radius_m.powi(2)
            * this.hull_length_m;
        at.range("mass_kg", this.mass_kg, 0.02 * carried, 0.7 * carried)?;
        // Radii of gyration are limited to a twentieth to twice the hull's length.
        let l2 = this.mass_kg * this.hull_length_m.powi(2);
        at.ranges("inertia_kgm2", &this.inertia_kgm2, l2 / 400.0, 4.0 * l2)?;
        for push in &this.loads {
            at.range("loads.at_s", push.at_s, 0.0, 1e6)?;
            at.range("loads.for_s", push.for_s, 0.0, 1e3)?;
            at.ranges("loads.by_n_nm", &push.by_n_nm, -1e6, 1e6)?;
        }
        at.require(
            this.loads.len() <= 100,
            "loads",
            this.loads.len(),
            "at most 100",
        )?;
    }
}

impl VesselConfig {
    pub fn power(&mut self) {
        // A speed change may increase the speed by half.
        let most = if self.course == VesselCourse::SpeedChange {
            1.5
        } else {
            1.0
        };
        self.power_for(most * self.speed_mps);
    }
    /// Raises the engines' thrust to reach this speed (m/s): quadratic drag, with the reserve of the default
    /// engines, which are sized for 1.5 m/s.
    pub fn power_for(&mut self, speed_mps: f64) {
        let more = (speed_mps / 1.5).powi(2);
        let default = VesselConfig::default();
        self.thrust_forward_n = self.thrust_forward_n.max(more * default.thrust_forward_n);
        self.thrust_reverse_n = self.thrust_reverse_n.max(more * default.thrust_reverse_n);
    }
}

//! Measured geometry of deck and drone.

use nalgebra::Vector3;

use crate::{
    config,
    msg::DeckDimensions,
    tags::{DeckTag, Tags, suggested},
};

/// Standard gravity, m/s².
pub const GRAVITY: f64 = 9.806_65;

config! {
    /// Landing deck in the vessel's body frame (FRD, origin midships on the waterline at rest).
    ///
    /// Defaults: The paper's vessel: deck 2.5 x 1.7 m (Procházka 2024; one AprilTag of 1 m side there); height of 1.3 m
    /// from the Virtual RobotX WAM-V.
    #[derive(Copy)]
    pub struct DeckGeometry {
        /// Centre of the deck's upper surface, m.
        pub centre_m: [f64; 3] = [0.0, 0.0, -1.3], in -50.0..=50.0;
        /// Length along the vessel, m.
        pub length_m: f64 = 2.5, in 0.5..=100.0;
        /// Width across the vessel, m.
        pub width_m: f64 = 1.7, in 0.5..=100.0;
        /// Fiducial tags with id, side_m and centre_m; empty: those of `alight tag --suggest` for this deck.
        pub tags: Tags = Tags::new();
        /// Side of the black square of a single tag in place of `tags`, m.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub tag_side_m: Option<f64> = None, in 0.02..=10.0;
        /// Centre of the single tag relative to the deck's centre, m.
        pub tag_centre_m: [f64; 3] = [0.0, 0.0, 0.0], in -50.0..=50.0;
        /// Force with which the deck holds a standing drone (net, magnets, suction, latch), down along its
        /// normal, N; it increases friction. A quarter acts on each foot in contact. 0: a plain deck.
        pub hold_n: f64 = 0.0, in 0.0..=1e4;
    }
    check |this, at| {
        this.tags.iter().try_for_each(|tag| tag.check(&at.table("tags")))?;
        at.require(
            this.tag_side_m.is_none() || this.tags.is_empty(),
            "tag_side_m",
            this.tag_side_m.unwrap_or_default(),
            "either tag_side_m for a single tag, or the list `tags`",
        )?;
    }
}

impl DeckGeometry {
    /// Deck centre in the vessel's body frame, m.
    pub fn centre(&self) -> Vector3<f64> {
        Vector3::from(self.centre_m)
    }
    /// Tags on the deck, or the suggested ones.
    pub fn tags(&self) -> Tags {
        match self.tag_side_m {
            Some(side_m) => Tags::filled([DeckTag {
                side_m,
                centre_m: self.tag_centre_m,
                ..DeckTag::default()
            }]),
            None if self.tags.is_empty() => suggested(self.length_m, self.width_m),
            None => self.tags,
        }
    }
    /// This deck with other tags.
    #[must_use]
    pub fn with_tags(self, tags: &Tags) -> DeckGeometry {
        DeckGeometry {
            tags: *tags,
            tag_side_m: None,
            tag_centre_m: [0.0; 3],
            ..self
        }
    }
    /// Dimensions as sent in messages.
    pub fn dimensions(&self) -> DeckDimensions {
        DeckDimensions {
            centre: self.centre_m.map(|x| x as f32),
            size: [self.length_m, self.width_m].map(|x| x as f32),
        }
    }
    /// Side of the largest tag, m.
    pub fn largest_tag_m(&self) -> f64 {
        self.tags().iter().fold(0.0, |most, tag| tag.side_m.max(most))
    }
}

impl DroneGeometry {
    /// Radius of a sphere about the centre of mass that encloses the drone, m; X-frame rotors do not overlap.
    pub fn body_radius_m(&self) -> f64 {
        let rotors = self.arm_m * (1.0 + core::f64::consts::FRAC_1_SQRT_2);
        let feet = 0.5 * self.feet_span_m[0].hypot(self.feet_span_m[1]);
        rotors.max(feet.hypot(self.feet_below_m))
    }
}

config! {
    /// Nominal drone geometry used by planner and pilot; the actual drone deviates from it.
    ///
    /// Defaults: The paper's drone: 3.5 kg on a Tarot T650 (Procházka 2024; mass, rotor arm), inertia and
    /// thrust limit as derived from ctu-mrs `t650`: rotor force 7.3385e-7 N/rpm² up to 5832 rpm.
    #[derive(Copy)]
    pub struct DroneGeometry {
        /// Take-off mass, kg.
        pub mass_kg: f64 = 3.5, in 0.1..=100.0;
        /// Moments of inertia about forward, right, down, kg m².
        pub inertia_kgm2: [f64; 3] = [0.099, 0.099, 0.185], in 1e-4..=100.0;
        /// Distance of each rotor from the centre, m.
        pub arm_m: f64 = 0.325, in 0.05..=5.0;
        /// Ratio of rotor drag moment to thrust, m.
        pub moment_per_force_m: f64 = 0.016, in 1e-4..=1.0;
        /// Maximum total thrust, N.
        pub max_thrust_n: f64 = 99.8;
        /// Fore-aft and sideways distance between the feet, m.
        pub feet_span_m: [f64; 2] = [0.40, 0.40], in 0.05..=5.0;
        /// Distance of the foot plane below the centre of mass, m.
        pub feet_below_m: f64 = 0.30, in 0.02..=5.0;
        /// Camera's optical centre in the body frame, m. The camera looks down with the top of the image forward.
        pub camera_m: [f64; 3] = [0.0, 0.0, 0.08], in -5.0..=5.0;
        /// Rangefinder in the body frame, m, looking down.
        pub rangefinder_m: [f64; 3] = [0.10, 0.0, 0.08], in -5.0..=5.0;
        /// Antenna of the GNSS receiver that measures the position relative to the vessel, in the body frame, m.
        pub gnss_antenna_m: [f64; 3] = [0.0, 0.0, -0.10], in -5.0..=5.0;
        /// Lag of the autopilot's attitude loop, s.
        pub attitude_lag_s: f64 = 0.2, in 0.0..=1.0;
    }
    check |this, at| {
        at.range(
            "max_thrust_n",
            this.max_thrust_n,
            1.2 * this.mass_kg * GRAVITY,
            1e4,
        )?;
    }
}

//! The figures' message types: what a plot shows. SI units; angles in degrees where the name says.

use crate::record::flat::Flat;
use crate::record::flat::Kind::{Number, Numbers, Text};

/// Drone and deck as they are.
pub const TRUTH: Flat = Flat {
    name: "Truth",
    fields: &[
        ("deck_heave_m", Number),
        ("deck_roll_deg", Number),
        ("deck_pitch_deg", Number),
        ("deck_yaw_deg", Number),
        ("deck_velocity_mps", Numbers),
        ("drone_roll_deg", Number),
        ("drone_pitch_deg", Number),
        ("drone_yaw_deg", Number),
        ("drone_velocity_mps", Numbers),
        ("horizontal_distance_m", Number),
        ("height_above_deck_m", Number),
        ("relative_speed_mps", Number),
        ("tilt_error_deg", Number),
    ],
};
/// The vessel's state as its computer says it.
pub const VESSEL_ESTIMATE: Flat = Flat {
    name: "VesselEstimate",
    fields: &[
        ("eta", Numbers),
        ("eta_dot", Numbers),
        ("eta_ddot", Numbers),
        ("variance_eta", Numbers),
        ("variance_eta_dot", Numbers),
        ("roll_deg", Number),
        ("pitch_deg", Number),
        ("yaw_deg", Number),
    ],
};
/// The wave model.
pub const WAVE: Flat = Flat {
    name: "WaveModel",
    fields: &[
        ("significant_height_m", Number),
        ("confidence", Number),
        ("wave_following_deficit", Number),
        ("omega_radps", Numbers),
        ("direction_rad", Numbers),
        ("omega_encounter_radps", Numbers),
        ("apparent_slopes", Numbers),
    ],
};
/// The vessel's inertial sensor.
pub const IMU: Flat = Flat {
    name: "Imu",
    fields: &[("gyro_radps", Numbers), ("accelerometer_mps2", Numbers)],
};
/// The vessel's GNSS.
pub const GNSS: Flat = Flat {
    name: "Gnss",
    fields: &[
        ("position_m", Numbers),
        ("velocity_mps", Numbers),
        ("position_sd_m", Numbers),
        ("velocity_sd_mps", Numbers),
    ],
};
/// The vessel's heading.
pub const HEADING: Flat = Flat {
    name: "Heading",
    fields: &[("heading_deg", Number), ("heading_sd_deg", Number)],
};
/// UV markers.
pub const UVDAR: Flat = Flat {
    name: "Uvdar",
    fields: &[("position_m", Numbers), ("variance_m2", Numbers)],
};
/// Rangefinder.
pub const RANGE: Flat = Flat {
    name: "Range",
    fields: &[("range_m", Number), ("variance_m2", Number)],
};
/// The link.
pub const LINK: Flat = Flat {
    name: "Link",
    fields: &[
        ("clock_offset_s", Number),
        ("clock_offset_sd_s", Number),
        ("age_s", Number),
        ("loss", Number),
        ("out_of_order", Number),
        ("latency_p50_s", Number),
        ("latency_p99_s", Number),
        ("rejected", Number),
    ],
};
/// The forecast's provenance and its deck now and a second ahead.
pub const FORECAST: Flat = Flat {
    name: "Forecast",
    fields: &[
        ("source", Text),
        ("radio_age_s", Number),
        ("vision_age_s", Number),
        ("tag_age_s", Number),
        ("wave_confidence", Number),
        ("wave_following_deficit", Number),
        ("position_sd_m", Numbers),
        ("euler_sd_rad", Numbers),
        ("ahead_1s_position_sd_m", Numbers),
        ("ahead_1s_heave_m", Number),
        ("ahead_1s_roll_deg", Number),
        ("ahead_1s_pitch_deg", Number),
        ("predicted_slopes", Numbers),
    ],
};
/// The mission.
pub const MISSION: Flat = Flat {
    name: "Mission",
    fields: &[
        ("state", Text),
        ("entered_because", Text),
        ("waiting_because", Text),
        ("state_number", Number),
        ("attempts", Number),
        ("height_m", Number),
        ("descent_mps", Number),
    ],
};
/// The planner's solver.
pub const SOLVER: Flat = Flat {
    name: "Solver",
    fields: &[
        ("solve", Text),
        ("iterations", Number),
        ("touchdown_in_s", Number),
        ("alignment", Number),
        ("stages", Number),
    ],
};
/// The autopilot.
pub const AUTOPILOT: Flat = Flat {
    name: "Autopilot",
    fields: &[
        ("mode", Text),
        ("armed", Number),
        ("battery", Number),
        ("thrust", Number),
        ("hover_thrust", Number),
    ],
};
/// The pilot's set-point.
pub const SET_POINT: Flat = Flat {
    name: "SetPoint",
    fields: &[
        ("kind", Text),
        ("motors", Text),
        ("position_m", Numbers),
        ("velocity_mps", Numbers),
        ("acceleration_mps2", Numbers),
        ("roll_deg", Number),
        ("pitch_deg", Number),
        ("yaw_deg", Number),
        ("thrust", Number),
        ("plan_age_s", Number),
    ],
};

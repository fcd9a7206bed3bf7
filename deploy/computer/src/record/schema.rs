//! Message types for a recording's plots that have no well-known schema. SI units; angles in degrees where the name
//! states it. A field without a value is not written.

// Derived schemas list files in a hash set, whose order has no effect.
#![allow(clippy::disallowed_types)]

use foxglove::Encode;

/// Vessel state as estimated by its computer.
#[derive(Encode)]
pub struct VesselEstimate {
    pub eta: [f64; 6],
    pub eta_dot: [f64; 6],
    pub eta_ddot: [f64; 6],
    pub variance_eta: [f64; 6],
    pub variance_eta_dot: [f64; 6],
    pub roll_deg: f64,
    pub pitch_deg: f64,
    pub yaw_deg: f64,
}

#[derive(Encode)]
pub struct WaveModel {
    pub significant_height_m: f64,
    pub confidence: f64,
    pub omega_radps: Vec<f64>,
    pub decay_1ps: Vec<f64>,
    pub heave_m: Vec<f64>,
    pub tilt_north_rad: Vec<f64>,
    pub tilt_east_rad: Vec<f64>,
    pub apparent_slopes: Vec<f64>,
}

#[derive(Encode)]
pub struct Imu {
    pub gyro_radps: [f64; 3],
    pub accelerometer_mps2: [f64; 3],
}

#[derive(Encode)]
pub struct Gnss {
    pub position_m: [f64; 3],
    pub velocity_mps: [f64; 3],
    pub position_sd_m: [f64; 3],
    pub velocity_sd_mps: [f64; 3],
}

#[derive(Encode)]
pub struct Heading {
    pub heading_deg: f64,
    pub heading_sd_deg: f64,
}

/// Fix by ultraviolet markers.
#[derive(Encode)]
pub struct Uvdar {
    pub position_m: [f64; 3],
    pub variance_m2: [f64; 3],
}

#[derive(Encode)]
pub struct Range {
    pub range_m: f64,
    pub variance_m2: f64,
}

#[derive(Encode)]
pub struct Link {
    pub clock_offset_s: f64,
    pub clock_offset_sd_s: f64,
    pub age_s: f64,
    pub loss: f64,
    pub out_of_order: f64,
    pub latency_p50_s: f64,
    pub latency_p99_s: f64,
    pub rejected: u32,
}

/// Ages of the forecast's sources, and its deck now and 1 s ahead.
#[derive(Encode)]
pub struct Forecast {
    pub source: String,
    pub radio_age_s: f64,
    pub vision_age_s: f64,
    pub tag_age_s: f64,
    pub wave_confidence: f64,
    pub position_sd_m: Vec<f64>,
    pub euler_sd_rad: Vec<f64>,
    pub ahead_1s_position_sd_m: Vec<f64>,
    pub ahead_1s_heave_m: Option<f64>,
    pub ahead_1s_roll_deg: Option<f64>,
    pub ahead_1s_pitch_deg: Option<f64>,
    pub predicted_slopes: Vec<f64>,
}

/// The wind is the odometry's mean estimate, towards north and east, with its standard deviation.
#[derive(Encode)]
pub struct Mission {
    pub state: String,
    pub entered_because: String,
    pub waiting_because: String,
    pub state_number: u32,
    pub attempts: u32,
    pub height_m: f64,
    pub descent_mps: f64,
    pub wind_north_mps: Option<f64>,
    pub wind_east_mps: Option<f64>,
    pub wind_speed_mps: Option<f64>,
    pub wind_sd_mps: Option<f64>,
}

#[derive(Encode)]
pub struct Solver {
    pub solve: String,
    pub iterations: u32,
    pub touchdown_in_s: Option<f64>,
    pub alignment: f64,
    pub stages: u32,
}

#[derive(Encode)]
pub struct Autopilot {
    pub mode: String,
    pub armed: bool,
    pub battery: Option<f64>,
    pub battery_v: Option<f64>,
    pub battery_a: Option<f64>,
    pub set_points_lost: bool,
    pub thrust: Option<f64>,
    pub hover_thrust: f64,
    pub shadow_apart_deg: Option<f64>,
    pub shadow_apart_mps: Option<f64>,
}

#[derive(Encode)]
pub struct SetPoint {
    pub kind: String,
    pub motors: String,
    pub position_m: [f64; 3],
    pub velocity_mps: [f64; 3],
    pub acceleration_mps2: [f64; 3],
    pub roll_deg: f64,
    pub pitch_deg: f64,
    pub yaw_deg: f64,
    pub thrust: f64,
    pub plan_age_s: Option<f64>,
}

/// True state of drone and deck. Positions are the drone's centre of mass and the deck's centre, heights up;
/// `forward_m`, `starboard_m` and `height_above_deck_m` are the vector from the deck's centre to the centroid of the
/// feet in the deck's axes, in which errors are drone minus deck. The wind is the air's velocity at the drone,
/// including gusts and the deck's lee, NED (towards).
#[derive(Encode)]
pub struct Truth {
    pub deck_north_m: f64,
    pub deck_east_m: f64,
    pub deck_heave_m: f64,
    pub deck_roll_deg: f64,
    pub deck_pitch_deg: f64,
    pub deck_yaw_deg: f64,
    pub deck_velocity_mps: [f64; 3],
    pub drone_north_m: f64,
    pub drone_east_m: f64,
    pub drone_height_m: f64,
    pub drone_roll_deg: f64,
    pub drone_pitch_deg: f64,
    pub drone_yaw_deg: f64,
    pub drone_velocity_mps: [f64; 3],
    pub wind_mps: [f64; 3],
    pub wind_speed_mps: f64,
    pub horizontal_distance_m: f64,
    pub forward_m: f64,
    pub starboard_m: f64,
    pub height_above_deck_m: f64,
    pub relative_speed_mps: f64,
    pub roll_error_deg: f64,
    pub pitch_error_deg: f64,
    pub yaw_error_deg: f64,
    pub tilt_error_deg: f64,
}

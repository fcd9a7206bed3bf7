//! Tests of the sensors against their configured parameters.

mod drone;
mod night;
mod uvdar;
mod vessel;

use super::*;
use alight_shared::{
    estimation::moments,
    frames::{Point, Rotation, TrueNed, Vector, body_rates},
};

fn tick(k: usize) -> Time<TrueTime> {
    Time::from_nanos(k as i64 * 10_000_000)
}

struct Rig {
    clocks: clocks::Clocks,
    vessel: VesselSensors,
    drone: DroneSensors,
}

/// Deck with the paper's tag alone.
fn sensors(config: &SensorConfig, seed: u64) -> Rig {
    let deck = DeckGeometry {
        tag_side_m: Some(1.0),
        ..DeckGeometry::default()
    };
    let (geometry, streams) = (DroneGeometry::default(), Streams::new(seed));
    let clocks = clocks::Clocks::new(&config.clocks, &streams);
    let id = |drone, clock| SenderIdentity {
        vessel: 1,
        drone,
        boot: 1,
        clock,
    };
    Rig {
        clocks,
        vessel: VesselSensors::new(config, None, id(0, clocks.vessel), &streams),
        drone: DroneSensors::new(config, &geometry, &deck, None, id(1, clocks.drone), &streams),
    }
}

/// Sensors without errors and failures, but with latencies.
fn ideal() -> SensorConfig {
    let mut c = SensorConfig::default();
    let imu = &mut c.vessel_imu;
    imu.lever_arm_error_sd_m = 0.0;
    imu.alignment_sd_deg = 0.0;
    imu.gyro_white_sd_radps = 0.0;
    imu.gyro_bias_sd_radps = 0.0;
    imu.accelerometer_white_sd_mps2 = 0.0;
    imu.accelerometer_bias_sd_mps2 = 0.0;
    let gnss = &mut c.vessel_gnss;
    gnss.antenna_error_sd_m = 0.0;
    gnss.dropout = 0.0;
    gnss.error.bias_sd_m = 0.0;
    gnss.error.white_sd_m = 0.0;
    gnss.error.velocity_sd_mps = 0.0;
    let heading = &mut c.vessel_heading;
    heading.white_sd_deg = 0.0;
    heading.bias_sd_deg = 0.0;
    heading.dropout = 0.0;
    c.tag.corner_sd_px = 1e-6;
    c.tag.stated_sd_px = 1e-6;
    c.tag.small_sd_px = 0.0;
    c.tag.blur_sd = 0.0;
    c.tag.width_spread = 0.0;
    c.tag.loss = vision_loss::VisionLossConfig::none();
    c.uvdar.miss = 0.0;
    c.rangefinder.white_sd_m = 0.0;
    c.rangefinder.deck_miss = 0.0;
    c.rangefinder.water_miss = 0.0;
    c.camera_mount.angle_sd_deg = 0.0;
    c.camera_mount.position_sd_m = 0.0;
    c
}

fn still<B>(position: [f64; 3], euler: [f64; 3]) -> RigidState<B> {
    RigidState {
        position: Point::from(Vector3::from(position)),
        attitude: Rotation::from_euler(euler[0], euler[1], euler[2]),
        ..RigidState::default()
    }
}

/// Smooth motion in six degrees of freedom; the derivatives are central differences of analytic positions and angles.
fn rocking<B>(t: f64) -> RigidState<B> {
    let wave = |t: f64, a: f64, w: f64, p: f64| a * (w * t + p).sin();
    let place = |t: f64| {
        Vector3::new(
            1.5 * t + wave(t, 0.4, 1.1, 0.2),
            wave(t, 0.6, 0.9, 1.0),
            wave(t, 0.5, 1.26, 0.0),
        )
    };
    let angles = |t: f64| {
        Vector3::new(
            wave(t, 0.15, 1.3, 0.4),
            wave(t, 0.12, 1.26, 1.4),
            0.5 + 0.05 * t + wave(t, 0.1, 0.7, 0.0),
        )
    };
    let h = 1e-3;
    let rates = |t: f64| {
        let e = angles(t);
        body_rates(e.x, e.y, (angles(t + h) - angles(t - h)) / (2.0 * h))
    };
    let e = angles(t);
    RigidState {
        position: Point::from(place(t)),
        velocity: Vector::from((place(t + h) - place(t - h)) / (2.0 * h)),
        acceleration: Vector::from((place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h)),
        attitude: Rotation::from_euler(e.x, e.y, e.z),
        rates: Vector::from(rates(t)),
        angular_acceleration: Vector::from((rates(t + h) - rates(t - h)) / (2.0 * h)),
    }
}

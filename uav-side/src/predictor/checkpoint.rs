//! Checkpoint of the predictor: the offset between the deck's positions by camera and by radio. The camera cannot
//! detect the deck in the last half metre. A predictor that restarts there without a checkpoint would know the deck's
//! position only to the error of two GNSS receivers.

use alight_shared::{
    frames::wrap_angle,
    msg::{DroneState, PredictorCheckpoint},
    time::DroneTime,
};
use nalgebra::Vector3;

use super::{axis::AxisNoise, track::JUMP_M, waves::AXES};
use alight_shared::checkpoint::validate;

pub(super) fn is_valid(
    now: DroneTime,
    drone: &DroneState,
    vessel_boot: u32,
    m: &PredictorCheckpoint,
) -> bool {
    validate(now, drone.header.drone, m).is_ok() && m.vessel_boot == vessel_boot && same_frame(drone, m)
}

/// Variances of the checkpoint's offsets at `now`.
pub(super) fn variances(now: DroneTime, noise: &[AxisNoise; AXES], m: &PredictorCheckpoint) -> [f64; AXES] {
    let age = (now - m.header.at).secs().max(0.0);
    core::array::from_fn(|i| aged(m.offset_sd[i].powi(2), &noise[i], age))
}

/// Whether the odometry's origin is unchanged: the drone has moved as its velocities predict.
fn same_frame(drone: &DroneState, given: &PredictorCheckpoint) -> bool {
    if drone.datum != given.datum {
        return false;
    }
    let since = drone.datum_offset() - Vector3::from(given.datum_offset);
    let turned = wrap_angle(drone.heading_jumps - given.heading_jumps);
    if since.norm() > JUMP_M || turned != 0.0 {
        return false;
    }
    let dt = (drone.header.at - given.odometry_at).secs();
    let moved = drone.position() - Vector3::from(given.position);
    let mean = 0.5 * (drone.velocity() + Vector3::from(given.velocity));
    (moved - mean * dt).norm() <= JUMP_M
}

/// Variance of an offset after `age` (s): slow errors change; the odometry's drift is constant in the worst case.
fn aged(variance: f64, noise: &AxisNoise, age: f64) -> f64 {
    let walk = |(sd, time): (f64, f64)| 2.0 * sd * sd * age / time;
    variance + walk(noise.radio) + walk(noise.vision) + (noise.drift.0 * age).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};

    #[test]
    fn checkpoint_of_a_moved_origin() {
        let given = PredictorCheckpoint {
            position: [1.0, 2.0, -3.0],
            velocity: [4.0, 0.0, 0.0],
            odometry_at: Time::from_secs(10.0),
            ..PredictorCheckpoint::default()
        };
        let later = |x: f64| DroneState {
            header: Header::new(1, 1, 1, 1, Time::from_secs(11.0)),
            position: [x, 2.0, -3.0],
            velocity: [4.0, 0.0, 0.0],
            ..DroneState::default()
        };
        assert!(same_frame(&later(5.0), &given));
        assert!(same_frame(&later(5.6), &given));
        assert!(!same_frame(&later(1.0), &given));
        assert!(!same_frame(&later(6.0), &given));
        let elsewhere = DroneState {
            datum: alight_shared::geodesy::Datum::new(1e-6, 0.0, 0.0),
            ..later(5.0)
        };
        assert!(!same_frame(&elsewhere, &given));
    }

    #[test]
    fn checkpoint_uncertainty_by_age() {
        let noise = AxisNoise::all(&super::super::PredictorConfig::default())[0];
        let sd = |age: f64| aged(0.05_f64.powi(2), &noise, age).sqrt();
        assert_eq!(sd(0.0), 0.05);
        assert!(
            sd(1.0) > 0.08 && sd(2.0) > sd(1.0) && sd(2.0) < 0.5,
            "{} {}",
            sd(1.0),
            sd(2.0)
        );
    }
}

//! Conversion of set-points into references for the simulated autopilot.

use nalgebra::{UnitQuaternion, Vector3};

use super::attitude::AttitudeSetPoint;

#[derive(Clone, Copy, Debug)]
pub(super) struct PositionReference {
    pub(super) position: Vector3<f64>,
    pub(super) velocity: Vector3<f64>,
    pub(super) acceleration: Vector3<f64>,
    pub(super) yaw: f64,
    pub(super) yaw_rate: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum FlightReference {
    Track(PositionReference),
    Attitude(AttitudeSetPoint),
}

impl FlightReference {
    pub(super) fn track(
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        acceleration: Vector3<f64>,
        yaw: f64,
        yaw_rate: f64,
    ) -> FlightReference {
        FlightReference::Track(PositionReference {
            position,
            velocity,
            acceleration,
            yaw,
            yaw_rate,
        })
    }
    pub(super) fn attitude(
        attitude: UnitQuaternion<f64>,
        rates: Vector3<f64>,
        thrust: f64,
    ) -> FlightReference {
        FlightReference::Attitude(AttitudeSetPoint {
            attitude,
            yaw_rate: 0.0,
            rates,
            thrust,
        })
    }
}

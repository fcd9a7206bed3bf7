//! Truth in the log of the world's process: both bodies at the beginning of every tick.

use alight_shared::frames::{DroneBody, Point, Rotation, Vector, VesselBody, wxyz};
use alight_sim::physics::body::RigidState;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Body: position, velocity, acceleration (NED), attitude (w, x, y, z), angular velocity and acceleration (body), SI.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyTruth {
    vectors: [[f64; 3]; 5],
    attitude: [f64; 4],
}

/// Both bodies; the drone, once present, with its wind (NED, m/s, towards).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TruthSample {
    vessel: BodyTruth,
    drone: Option<(BodyTruth, [f64; 3])>,
}

impl BodyTruth {
    fn of<B>(s: &RigidState<B>) -> BodyTruth {
        BodyTruth {
            vectors: [
                s.position.0,
                s.velocity.0,
                s.acceleration.0,
                s.rates.0,
                s.angular_acceleration.0,
            ]
            .map(Into::into),
            attitude: wxyz(&s.attitude.0),
        }
    }
    fn state<B>(&self) -> RigidState<B> {
        let [p, v, a, w, dw] = self.vectors.map(Vector3::from);
        let [qw, x, y, z] = self.attitude;
        RigidState {
            position: Point::from(p),
            velocity: Vector::from(v),
            acceleration: Vector::from(a),
            // The quaternion has unit length: normalising it again could change a bit.
            attitude: Rotation::from(UnitQuaternion::new_unchecked(Quaternion::new(qw, x, y, z))),
            rates: Vector::from(w),
            angular_acceleration: Vector::from(dw),
        }
    }
}

impl TruthSample {
    pub fn of(
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) -> TruthSample {
        TruthSample {
            vessel: BodyTruth::of(vessel),
            drone: drone.map(|(drone, wind)| (BodyTruth::of(drone), (*wind).into())),
        }
    }
    pub fn vessel(&self) -> RigidState<VesselBody> {
        self.vessel.state()
    }
    /// State of the drone, and its wind, NED, m/s, towards.
    pub fn drone(&self) -> Option<(RigidState<DroneBody>, Vector3<f64>)> {
        let (drone, wind) = self.drone.as_ref()?;
        Some((drone.state(), Vector3::from(*wind)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_round_trip() {
        let state = RigidState::<DroneBody> {
            position: Point::from(Vector3::new(1.0, -2.0, 3.5)),
            velocity: Vector::from(Vector3::new(0.1, 0.2, 0.3)),
            attitude: Rotation::from(UnitQuaternion::from_euler_angles(0.1, -0.2, 3.0)),
            ..RigidState::default()
        };
        let body = BodyTruth::of(&state);
        assert_eq!(BodyTruth::of(&body.state::<DroneBody>()), body);
        assert_eq!(body.vectors[0], [1.0, -2.0, 3.5]);
        let wind = Vector3::new(6.0, -1.0, 0.2);
        let truth = TruthSample::of(&RigidState::default(), Some(&(state, wind)));
        assert_eq!(truth.drone().map(|(_, wind)| wind), Some(wind));
    }
}

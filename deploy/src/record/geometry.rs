//! Frames of a recording, and positions and attitudes as Foxglove writes them.

use foxglove::messages::{Pose, Quaternion, Vector3};
use nalgebra::UnitQuaternion;

/// Frames of the scene.
pub mod frame {
    /// Foxglove's fixed frame: east, north, up.
    pub const WORLD: &str = "world";
    /// The true NED.
    pub const NED: &str = "ned";
    /// The vessel's body.
    pub const VESSEL: &str = "vessel";
    /// The deck.
    pub const DECK: &str = "deck";
    /// The drone's body.
    pub const DRONE: &str = "drone";
    /// The camera.
    pub const CAMERA: &str = "camera";
    /// The NED of the drone's odometry, laid so that the odometry meets the true drone.
    pub const DRONE_NED: &str = "drone_ned";
}

/// A vector.
pub fn vector(v: [f64; 3]) -> Vector3 {
    Vector3 {
        x: v[0],
        y: v[1],
        z: v[2],
    }
}
/// A rotation.
pub fn quaternion(q: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}
/// A pose.
pub fn pose(position: [f64; 3], attitude: &UnitQuaternion<f64>) -> Pose {
    Pose {
        position: Some(vector(position)),
        orientation: Some(quaternion(attitude)),
    }
}

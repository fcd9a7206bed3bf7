//! Frames of a recording; positions and attitudes in Foxglove's convention.

use foxglove::messages::{Pose, Quaternion, Vector3};
use nalgebra::UnitQuaternion;

/// Frames of the scene.
pub mod frame {
    /// Foxglove's fixed frame: east, north, up.
    pub const WORLD: &str = "world";
    /// The true NED.
    pub const NED: &str = "ned";
    /// At the vessel's position on the water, east, north, up: a viewer's camera follows it. A camera that followed the
    /// vessel's own frame, whose third axis points down, would be upside down.
    pub const CHASE: &str = "chase";
    /// The vessel's body.
    pub const VESSEL: &str = "vessel";
    pub const DECK: &str = "deck";
    /// The drone's body.
    pub const DRONE: &str = "drone";
    pub const CAMERA: &str = "camera";
    /// The NED frame of the drone's odometry, placed so that the odometry matches the true drone.
    pub const DRONE_NED: &str = "drone_ned";
}

/// Position in [`frame::WORLD`] on the water below or above a position in [`frame::NED`].
pub fn on_the_water([north, east, _]: [f64; 3]) -> [f64; 3] {
    [east, north, 0.0]
}

pub fn vector(v: [f64; 3]) -> Vector3 {
    Vector3 {
        x: v[0],
        y: v[1],
        z: v[2],
    }
}
pub fn quaternion(q: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}
pub fn pose(position: [f64; 3], attitude: &UnitQuaternion<f64>) -> Pose {
    Pose {
        position: Some(vector(position)),
        orientation: Some(quaternion(attitude)),
    }
}

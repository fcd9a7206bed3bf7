//! Frames of a recording; positions and attitudes in Foxglove's convention.

use foxglove::messages::{Pose, Quaternion, Vector3};
use nalgebra::UnitQuaternion;

pub mod frame {
    /// Foxglove's fixed frame: east, north, up.
    pub const WORLD: &str = "world";
    /// NED of the true world.
    pub const NED: &str = "ned";
    /// East, north, up at the vessel's position on the water, for a viewer's camera that follows the vessel. In the
    /// vessel's own frame, whose third axis points down, that camera would be upside down.
    pub const CHASE: &str = "chase";
    pub const VESSEL: &str = "vessel";
    pub const DECK: &str = "deck";
    pub const DRONE: &str = "drone";
    pub const CAMERA: &str = "camera";
    /// NED frame of the drone's odometry, placed so that the odometry matches the true drone.
    pub const DRONE_NED: &str = "drone_ned";
}

/// Converts a position in [`frame::NED`] to the point on the water below or above it, in [`frame::WORLD`].
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

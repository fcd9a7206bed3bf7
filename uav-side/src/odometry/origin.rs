//! Jumps of the autopilot's estimate of its heading, which put everything in its frame elsewhere.

use nalgebra::{UnitQuaternion, Vector3};

/// A heading that differs by more than this from what the gyroscopes turned it to is a reset of the autopilot's estimate,
/// rad (4 deg).
const YAW_JUMP_RAD: f64 = 0.07;
/// Samples further apart contain nothing of it, s.
const YAW_STEP_S: f64 = 0.05;

/// By how much the heading (rad, from north to east) has jumped within the last `dt` seconds: attitude (NED from body) now
/// against the one before, turned on by the mean body rates (rad/s) of both; None: not at all.
pub(crate) fn yaw_jump(
    before: (&UnitQuaternion<f64>, Vector3<f64>),
    now: (&UnitQuaternion<f64>, Vector3<f64>),
    dt: f64,
) -> Option<f64> {
    let turned = before.0 * UnitQuaternion::from_scaled_axis((before.1 + now.1) * (0.5 * dt));
    let yaw = (now.0 * turned.inverse()).scaled_axis().z;
    // In an impact the rates change between two samples, and their mean may be wrong by all of that.
    let limit = YAW_JUMP_RAD + (now.1 - before.1).norm() * dt;
    (dt > 0.0 && dt < YAW_STEP_S && yaw.abs() > limit).then_some(yaw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaw_jump_during_a_quick_turn() {
        let spin = Vector3::new(1.5, -0.8, 2.0);
        let before = UnitQuaternion::from_euler_angles(0.2, -0.1, 3.0);
        let now = before * UnitQuaternion::from_scaled_axis(spin * 0.02);
        assert_eq!(yaw_jump((&before, spin), (&now, spin), 0.02), None);
        let reset = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3) * now;
        let jump = yaw_jump((&before, spin), (&reset, spin), 0.02).unwrap();
        assert!((jump - 0.3).abs() < 1e-9, "{jump}");
        assert_eq!(yaw_jump((&before, spin), (&reset, spin), 0.2), None);
        let hit = Vector3::new(0.0, 0.0, 30.0);
        assert_eq!(yaw_jump((&before, spin), (&reset, spin + hit), 0.02), None);
    }
}

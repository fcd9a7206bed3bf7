//! Jumps of the autopilot's heading estimate, which rotate everything in its frame.

use nalgebra::{UnitQuaternion, Vector3};

/// Difference between reported heading and integrated gyroscopes that indicates a reset, rad (4 deg).
const YAW_JUMP_RAD: f64 = 0.07;
/// Maximum interval between two samples in which a jump is detected, s.
const YAW_STEP_S: f64 = 0.05;

/// Heading jump within `dt` seconds (rad, from north to east): the current attitude (NED from body) relative to the
/// previous one rotated by the mean of both body rates (rad/s).
pub(crate) fn yaw_jump(
    before: (&UnitQuaternion<f64>, Vector3<f64>),
    now: (&UnitQuaternion<f64>, Vector3<f64>),
    dt: f64,
) -> Option<f64> {
    let turned = before.0 * UnitQuaternion::from_scaled_axis((before.1 + now.1) * (0.5 * dt));
    let yaw = (now.0 * turned.inverse()).scaled_axis().z;
    // In an impact the rates change between two samples, so their mean may be wrong by the whole change.
    let limit = YAW_JUMP_RAD + (now.1 - before.1).norm() * dt;
    (dt > 0.0 && dt < YAW_STEP_S && yaw.abs() > limit).then_some(yaw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::frames::yaw_rotation;

    #[test]
    fn yaw_jump_during_a_quick_turn() {
        let spin = Vector3::new(1.5, -0.8, 2.0);
        let before = UnitQuaternion::from_euler_angles(0.2, -0.1, 3.0);
        let now = before * UnitQuaternion::from_scaled_axis(spin * 0.02);
        assert_eq!(yaw_jump((&before, spin), (&now, spin), 0.02), None);
        let reset = yaw_rotation(0.3) * now;
        let jump = yaw_jump((&before, spin), (&reset, spin), 0.02).unwrap();
        assert!((jump - 0.3).abs() < 1e-9, "{jump}");
        assert_eq!(yaw_jump((&before, spin), (&reset, spin), 0.2), None);
        let hit = Vector3::new(0.0, 0.0, 30.0);
        assert_eq!(yaw_jump((&before, spin), (&reset, spin + hit), 0.02), None);
    }
}

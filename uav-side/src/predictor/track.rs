//! Recent states of the drone, for late measurements.

use std::collections::VecDeque;

use alight_shared::{
    frames::{wrap_angle, wxyz, yaw_rotation},
    msg::DroneState,
    time::{DroneTime, Span},
};
use nalgebra::{UnitQuaternion, Vector3};

use crate::odometry::origin::yaw_jump;

/// Number of stored states: more than a second at 100 Hz.
const MAX_STATES: usize = 128;
/// Maximum time over which a state is extrapolated, s.
const MAX_AHEAD_S: f64 = 0.1;
/// Difference from the position predicted by velocity that shows that a restarted link has changed the frame, m.
pub(super) const JUMP_M: f64 = 0.7;
/// Maximum time between two states for jump detection, s.
const JUMP_STEP_S: f64 = 0.2;

/// Jump of the autopilot's estimate, as detected by the odometry, in the odometry's continuous frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameJump {
    /// Jump of the frame itself, m; zero unless a restarted link lost it.
    pub moved: Vector3<f64>,
    /// Jump of the datum to which the radio's position refers, m.
    pub datum: Vector3<f64>,
    /// Jump of the heading, rad.
    pub yaw: f64,
    /// Position of the drone after the jump, m; the detections rotate about it.
    pub about: Vector3<f64>,
}

impl FrameJump {
    /// New position of a point detected at `place` (m) before the jump.
    pub fn of(&self, place: &Vector3<f64>) -> Vector3<f64> {
        let turn = yaw_rotation(self.yaw);
        self.about + turn * (place + self.moved - self.about)
    }
    fn between(last: &DroneState, s: &DroneState) -> Option<FrameJump> {
        let dt = (s.header.at - last.header.at).secs();
        let mut jump = FrameJump {
            moved: Vector3::zeros(),
            datum: s.datum_offset() - last.datum_offset(),
            yaw: wrap_angle(s.heading_jumps - last.heading_jumps),
            about: s.position(),
        };
        if s.header.boot != last.header.boot {
            // The odometry's integrals may restart; its own reports of jumps take precedence.
            let expected = last.position() + (last.velocity() + s.velocity()) * (0.5 * dt);
            let moved = s.position() - expected;
            if dt < JUMP_STEP_S && moved.norm() > JUMP_M {
                jump.moved = moved;
            }
            let rates = |d: &DroneState| Vector3::from(d.rates);
            let before = last.attitude();
            let now = s.attitude();
            jump.yaw = yaw_jump((&before, rates(last)), (&now, rates(s)), dt).unwrap_or(0.0);
        }
        let some = jump.moved != Vector3::zeros() || jump.datum != Vector3::zeros() || jump.yaw != 0.0;
        some.then_some(jump)
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Pose {
    pub position: Vector3<f64>,
    /// Rotation from body to NED.
    pub attitude: UnitQuaternion<f64>,
    /// Variances of `position`, m².
    pub variance: Vector3<f64>,
}

#[derive(Clone, Debug)]
pub struct DroneTrack {
    states: VecDeque<DroneState>,
}

impl Default for DroneTrack {
    fn default() -> Self {
        DroneTrack {
            states: VecDeque::with_capacity(MAX_STATES),
        }
    }
}

impl DroneTrack {
    /// Adds a newer state. If the autopilot's estimate has jumped, applies the jump to earlier states and returns it.
    pub fn push(&mut self, s: &DroneState) -> Option<FrameJump> {
        let jump = self.states.back().and_then(|last| FrameJump::between(last, s));
        if let Some(jump) = jump {
            let turn = yaw_rotation(jump.yaw);
            for old in &mut self.states {
                // The path was correct but the heading was not.
                old.position = (old.position() + jump.moved).into();
                old.attitude = wxyz(&(turn * old.attitude()));
            }
        }
        if self.states.len() == MAX_STATES {
            self.states.pop_front();
        }
        self.states.push_back(*s);
        jump
    }
    pub fn newest(&self) -> Option<&DroneState> {
        self.states.back()
    }
    /// Pose at `t`, interpolated, or extrapolated shortly beyond the newest state; None otherwise.
    pub fn at(&self, t: DroneTime) -> Option<Pose> {
        let i = self.states.partition_point(|s| s.header.at <= t);
        let a = self.states.get(i.checked_sub(1)?)?;
        let since = (t - a.header.at).secs();
        let variance = Vector3::from(a.position_sd.map(|s| s * s));
        match self.states.get(i) {
            Some(b) => {
                let gap = (b.header.at - a.header.at).secs();
                if gap > 0.5 {
                    return None;
                }
                let f = if gap > 0.0 { since / gap } else { 0.0 };
                Some(Pose {
                    position: a.position().lerp(&b.position(), f),
                    attitude: a.attitude().nlerp(&b.attitude(), f),
                    variance,
                })
            }
            None if t - a.header.at <= Span::from_secs(MAX_AHEAD_S) => Some(Pose {
                position: a.position() + a.velocity() * since,
                attitude: a.attitude() * UnitQuaternion::from_scaled_axis(Vector3::from(a.rates) * since),
                variance,
            }),
            None => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};

    fn state(t: f64, x: f64) -> DroneState {
        DroneState {
            header: Header::new(1, 1, 1, 0, Time::from_secs(t)),
            position: [x, 0.0, -5.0],
            velocity: [1.0, 0.0, 0.0],
            ..Default::default()
        }
    }

    #[test]
    fn track_interpolation_and_extrapolation() {
        let mut t = DroneTrack::default();
        t.push(&state(1.0, 1.0));
        t.push(&state(1.1, 1.1));
        let at = |s: f64| t.at(Time::from_secs(s)).map(|p| p.position.x);
        assert!((at(1.05).unwrap() - 1.05).abs() < 1e-9);
        assert!((at(1.15).unwrap() - 1.15).abs() < 1e-9);
        assert_eq!(at(0.99), None);
        assert_eq!(at(1.5), None);
    }

    #[test]
    fn track_at_a_jump_of_the_datum() {
        let mut t = DroneTrack::default();
        t.push(&state(1.0, 1.0));
        let jump = t
            .push(&DroneState {
                datum_offset: [-5.0, 0.0, 0.4],
                ..state(1.01, 1.01)
            })
            .unwrap();
        assert!(
            jump.datum == Vector3::new(-5.0, 0.0, 0.4) && jump.moved == Vector3::zeros() && jump.yaw == 0.0
        );
        assert!((t.at(Time::from_secs(1.0)).unwrap().position.x - 1.0).abs() < 1e-9);
        let point = Vector3::new(3.0, 1.0, 1.0);
        assert_eq!(jump.of(&point), point);
    }

    #[test]
    fn track_with_a_restarted_link() {
        let mut t = DroneTrack::default();
        t.push(&DroneState {
            datum_offset: [-5.0, 0.0, 0.0],
            ..state(1.0, 1.0)
        });
        let mut restarted = state(1.01, 6.01);
        restarted.header.boot += 1;
        let jump = t.push(&restarted).unwrap();
        assert!((jump.moved.x - 5.0).abs() < 1e-6 && jump.datum.x == 5.0 && jump.yaw == 0.0);
        assert!((t.at(Time::from_secs(1.0)).unwrap().position.x - 6.0).abs() < 1e-6);
    }

    #[test]
    fn track_with_a_yaw_reset() {
        let mut t = DroneTrack::default();
        t.push(&state(1.0, 1.0));
        let jump = t
            .push(&DroneState {
                attitude: wxyz(&yaw_rotation(0.3)),
                heading_jumps: 0.3,
                ..state(1.01, 1.01)
            })
            .unwrap();
        assert!((jump.yaw - 0.3).abs() < 1e-9 && jump.moved == Vector3::zeros());
        let before = t.at(Time::from_secs(1.0)).unwrap();
        assert!((before.attitude.euler_angles().2 - 0.3).abs() < 1e-9);
        assert!((before.position.x - 1.0).abs() < 1e-9);
        // The detection two metres north of the drone rotates about the drone.
        let point = jump.of(&Vector3::new(3.01, 0.0, 1.0));
        assert!((point - Vector3::new(1.01 + 2.0 * 0.3_f64.cos(), 2.0 * 0.3_f64.sin(), 1.0)).norm() < 1e-9);
    }
}

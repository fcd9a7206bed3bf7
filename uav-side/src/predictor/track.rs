//! Where the drone was: its last states, for measurements that come late.

use std::collections::VecDeque;

use alight_shared::msg::DroneState;
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{UnitQuaternion, Vector3};

/// States kept: more than a second at 100 Hz.
const MAX_STATES: usize = 128;
/// A state may be rolled on by this much, s.
const MAX_AHEAD_S: f64 = 0.1;
/// A position that is further than this from where velocity would have brought it is a reset of
/// the autopilot's origin, m.
pub(super) const JUMP_M: f64 = 0.7;

/// The drone's pose at some instant, in its NED.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Centre of mass, m.
    pub position: Vector3<f64>,
    /// NED from body.
    pub attitude: UnitQuaternion<f64>,
    /// Variances of `position`, m².
    pub variance: Vector3<f64>,
}

/// The last states, in order.
#[derive(Clone, Debug)]
pub struct Track {
    states: VecDeque<DroneState>,
}

impl Default for Track {
    fn default() -> Self {
        Track {
            states: VecDeque::with_capacity(MAX_STATES),
        }
    }
}

impl Track {
    /// Takes a newer state; false when it is not newer. `Some` jump (m) when the autopilot has
    /// moved its origin: the earlier states are moved along.
    pub fn push(&mut self, s: &DroneState) -> Option<Vector3<f64>> {
        let mut jump = None;
        if let Some(last) = self.states.back() {
            let dt = (s.header.at - last.header.at).secs();
            let expected = last.position() + (last.velocity() + s.velocity()) * (0.5 * dt);
            let moved = s.position() - expected;
            if dt < 0.2 && moved.norm() > JUMP_M {
                for old in &mut self.states {
                    for (p, m) in old.position.iter_mut().zip(moved.iter()) {
                        *p += m;
                    }
                }
                jump = Some(moved);
            }
        }
        if self.states.len() == MAX_STATES {
            self.states.pop_front();
        }
        self.states.push_back(*s);
        jump
    }
    /// The newest state.
    pub fn newest(&self) -> Option<&DroneState> {
        self.states.back()
    }
    /// The pose at `t`: between two states by interpolation, shortly after the newest by rolling
    /// on; None before the oldest and long after the newest.
    pub fn at(&self, t: Time<DroneClock>) -> Option<Pose> {
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
    use alight_shared::msg::Header;

    fn state(t: f64, x: f64) -> DroneState {
        DroneState {
            header: Header::new(1, 1, 1, 0, Time::from_secs(t)),
            position: [x, 0.0, -5.0],
            velocity: [1.0, 0.0, 0.0],
            ..Default::default()
        }
    }

    #[test]
    fn track_interpolates_extrapolates_and_rejects_beyond() {
        let mut t = Track::default();
        t.push(&state(1.0, 1.0));
        t.push(&state(1.1, 1.1));
        let at = |s: f64| t.at(Time::from_secs(s)).map(|p| p.position.x);
        assert!((at(1.05).unwrap() - 1.05).abs() < 1e-9);
        assert!((at(1.15).unwrap() - 1.15).abs() < 1e-9);
        assert_eq!(at(0.99), None);
        assert_eq!(at(1.5), None);
    }

    #[test]
    fn track_moves_its_past_when_the_origin_jumps() {
        let mut t = Track::default();
        t.push(&state(1.0, 1.0));
        let jump = t.push(&state(1.01, 6.01)).unwrap();
        assert!((jump.x - 5.0).abs() < 1e-6);
        assert!((t.at(Time::from_secs(1.0)).unwrap().position.x - 6.0).abs() < 1e-6);
    }
}

//! A vessel under set-points of heading and speed: rudder and engine with their lags, rate of turn and acceleration bounded.
//!
//! `r' = (clamp(k_psi e_psi, r_max) - r) / T_rudder`, `a' = (clamp(k_u e_u, a_max) - a) / T_engine`, `psi' = r`, `u' = a`
//! (the first-order steering model of Nomoto with a proportional autopilot; Fossen 2011, section 12.2). Both kinds of hull
//! have it: the nonlinear one follows it with its engines, the one of a response table is moved along it, and meets the
//! waves at the heading and the speed that it has.

use alight_shared::frames::wrap_angle;
use nalgebra::Vector2;

/// Point of the mean path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// North and east, m.
    pub position: Vector2<f64>,
    /// Their derivative, m/s.
    pub velocity: Vector2<f64>,
    /// Heading, rad.
    pub heading: f64,
}

/// Heading (rad) and speed (m/s) that a boat's autopilot steers to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeringSetPoint {
    /// rad from north.
    pub heading: f64,
    /// m/s.
    pub speed: f64,
}

/// Largest rate of turn, rad/s (8 deg/s: a small boat that does not heel for it; ours).
const MAX_RATE: f64 = 0.14;
/// Largest change of speed, m/s² (a displacement hull; ours).
const MAX_ACCELERATION: f64 = 0.4;
/// Gains of the autopilot on heading and speed, 1/s.
const GAINS: [f64; 2] = [0.4, 0.5];
/// Lags of rudder and engine, s.
const LAGS: [f64; 2] = [0.8, 1.2];
/// Step of the integration, s: the world's tick.
pub const STEP_S: f64 = 0.01;

/// Heading and speed on their way to a set-point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steered {
    /// Position on the path.
    pub position: Vector2<f64>,
    /// Heading (rad) and rate of turn (rad/s).
    pub heading: [f64; 2],
    /// Speed (m/s) and its derivative (m/s²).
    pub speed: [f64; 2],
}

impl Steered {
    /// From this place, at its heading and speed, straight on.
    pub fn from(here: &PathPoint) -> Steered {
        let ahead = Vector2::new(here.heading.cos(), here.heading.sin());
        Steered {
            position: here.position,
            heading: [here.heading, 0.0],
            speed: [here.velocity.dot(&ahead), 0.0],
        }
    }
    /// One step of [`STEP_S`] towards a set-point.
    #[must_use]
    pub fn step(mut self, to: &SteeringSetPoint) -> Steered {
        let h = STEP_S;
        let [psi, u] = [&mut self.heading, &mut self.speed];
        let wanted = [
            (GAINS[0] * wrap_angle(to.heading - psi[0])).clamp(-MAX_RATE, MAX_RATE),
            (GAINS[1] * (to.speed - u[0])).clamp(-MAX_ACCELERATION, MAX_ACCELERATION),
        ];
        let before = (psi[0], u[0]);
        for (state, (wanted, lag)) in [psi, u].into_iter().zip(wanted.into_iter().zip(LAGS)) {
            state[1] += (wanted - state[1]) * h / lag;
            state[0] += state[1] * h;
        }
        let (heading, speed) = (
            0.5 * (before.0 + self.heading[0]),
            0.5 * (before.1 + self.speed[0]),
        );
        self.position += Vector2::new(heading.cos(), heading.sin()) * (speed * h);
        self
    }
    /// As a point of a path.
    pub fn point(&self) -> PathPoint {
        let [heading, speed] = [self.heading[0], self.speed[0]];
        PathPoint {
            position: self.position,
            velocity: Vector2::new(heading.cos(), heading.sin()) * speed,
            heading,
        }
    }
}

/// A path under set-points, sampled at the world's ticks: it is known a little beyond the present.
#[derive(Clone, Debug)]
pub struct SteeredPath {
    to: SteeringSetPoint,
    /// Number of the newest sample: its time in steps.
    newest: i64,
    /// The last samples, the newest last.
    samples: Vec<Steered>,
}

/// Samples that are kept: a tick before and after the present, and a reserve.
const KEPT: usize = 8;

impl SteeredPath {
    /// From the place `here` at `t` (s) on.
    pub fn begin(t: f64, here: &PathPoint, to: SteeringSetPoint) -> SteeredPath {
        // What was before it, straight: the motion about the path is differentiated over three ticks.
        let before = |ticks: f64| PathPoint {
            position: here.position - here.velocity * (ticks * STEP_S),
            ..*here
        };
        SteeredPath {
            to,
            newest: (t / STEP_S).round() as i64,
            samples: [2.0, 1.0, 0.0].map(|k| Steered::from(&before(k))).to_vec(),
        }
    }
    /// Another set-point, from the newest sample on.
    pub fn set(&mut self, to: SteeringSetPoint) {
        self.to = to;
    }
    /// Goes on until `t`, s.
    pub fn extend(&mut self, t: f64) {
        let wanted = (t / STEP_S).round() as i64;
        while self.newest < wanted {
            let Some(last) = self.samples.last() else { return };
            let next = last.step(&self.to);
            if self.samples.len() == KEPT {
                self.samples.remove(0);
            }
            self.samples.push(next);
            self.newest += 1;
        }
    }
    /// The point at `t` (s), one of the samples; the oldest of what was before.
    pub fn at(&self, t: f64) -> PathPoint {
        let back = self.newest - (t / STEP_S).round() as i64;
        let last = self.samples.len().saturating_sub(1);
        let index = last.saturating_sub(usize::try_from(back).unwrap_or(0));
        self.samples.get(index).map_or(
            PathPoint {
                position: Vector2::zeros(),
                velocity: Vector2::zeros(),
                heading: 0.0,
            },
            Steered::point,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steered_path_to_a_set_point() {
        let here = PathPoint {
            position: Vector2::new(3.0, 4.0),
            velocity: Vector2::new(5.0, 0.0),
            heading: 0.0,
        };
        let to = SteeringSetPoint {
            heading: -1.0,
            speed: 2.0,
        };
        let mut path = SteeredPath::begin(10.0, &here, to);
        let (mut fastest, mut hardest, mut before) = (0.0_f64, 0.0_f64, path.at(10.0));
        for k in 1..3000 {
            let t = 10.0 + STEP_S * f64::from(k);
            path.extend(t);
            let now = path.at(t);
            let moved = (now.position - before.position) / STEP_S;
            assert!(
                (moved - 0.5 * (now.velocity + before.velocity)).norm() < 1e-3,
                "{t}"
            );
            fastest = fastest.max((now.heading - before.heading).abs() / STEP_S);
            hardest = hardest.max((now.velocity.norm() - before.velocity.norm()).abs() / STEP_S);
            before = now;
        }
        assert!(
            fastest < MAX_RATE + 1e-9 && hardest < MAX_ACCELERATION + 1e-9,
            "{fastest} {hardest}"
        );
        assert!((before.heading + 1.0).abs() < 1e-3 && (before.velocity.norm() - 2.0).abs() < 1e-3);
    }
}

//! The mean path of a vessel that is moved by a table: at rest, straight on, or around a square with rounded
//! corners. Twice differentiable: the heading turns by a quintic step.

use core::f64::consts::FRAC_PI_2;

use nalgebra::Vector2;

use crate::physics::spline::smooth_step;
use crate::physics::vessel::config::{Course, VesselConfig};

/// A turn by 90 deg takes so long, s (11 deg/s: a small boat that does not heel for it; ours).
const TURN_S: f64 = 8.0;
/// Parts of a turn over which its way is integrated.
const TURN_PARTS: usize = 400;

/// Where the mean path is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// North and east, m.
    pub position: Vector2<f64>,
    /// Their derivative, m/s.
    pub velocity: Vector2<f64>,
    /// Heading, rad.
    pub heading: f64,
}

/// The mean path.
#[derive(Clone, Debug)]
pub struct MeanPath {
    heading: f64,
    speed: f64,
    corners: Option<Corners>,
}

/// The corners of a square.
#[derive(Clone, Debug)]
struct Corners {
    /// Duration of a turn and of the first and every other straight leg, s.
    turn: f64,
    first: f64,
    leg: f64,
    /// Way made in a turn by its parts, m, along and across its first heading.
    way: Vec<Vector2<f64>>,
}

/// `v` turned by `angle`, rad.
fn turned(v: Vector2<f64>, angle: f64) -> Vector2<f64> {
    let (s, c) = angle.sin_cos();
    Vector2::new(c * v.x - s * v.y, s * v.x + c * v.y)
}

impl MeanPath {
    /// The path of `config` from the origin on, with this heading, rad.
    pub fn new(config: &VesselConfig, heading: f64) -> MeanPath {
        let under_way = config.course != Course::Drift && config.speed_mps > 0.0;
        let speed = if under_way { config.speed_mps } else { 0.0 };
        let corners =
            (under_way && config.course == Course::Square).then(|| Corners::new(speed, config.side_m));
        MeanPath {
            heading,
            speed,
            corners,
        }
    }

    /// Whether the heading turns at `t` (s) or within `margin` (s) of it.
    pub fn turns(&self, t: f64, margin: f64) -> bool {
        self.corners.as_ref().is_some_and(|c| {
            let [a, b] = [t - margin, t + margin].map(|t| c.phase(t));
            a.1 < c.turn || b.1 < c.turn && b.0 >= 0.0
        })
    }

    /// The path at `t`, s.
    pub fn at(&self, t: f64) -> PathPoint {
        let straight = |from: Vector2<f64>, heading: f64, since: f64| {
            let velocity = turned(Vector2::new(self.speed, 0.0), heading);
            PathPoint {
                position: from + velocity * since,
                velocity,
                heading,
            }
        };
        let Some(c) = &self.corners else {
            return straight(Vector2::zeros(), self.heading, t);
        };
        let (turn, since) = c.phase(t);
        if turn < 0.0 {
            return straight(Vector2::zeros(), self.heading, t);
        }
        let heading = self.heading + turn * FRAC_PI_2;
        // The way from the start of a turn to that of the next, in the frame of its heading; four close.
        let whole = c.way.last().copied().unwrap_or_default();
        let step = whole + Vector2::new(0.0, self.speed * c.leg);
        let start = turned(Vector2::new(self.speed * c.first, 0.0), self.heading)
            + (0..(turn as u64 % 4))
                .map(|k| turned(step, self.heading + k as f64 * FRAC_PI_2))
                .sum::<Vector2<f64>>();
        if since >= c.turn {
            return straight(
                start + turned(whole, heading),
                heading + FRAC_PI_2,
                since - c.turn,
            );
        }
        let here = FRAC_PI_2 * smooth_step(since, c.turn).y;
        PathPoint {
            position: start + turned(c.position(since, self.speed), heading),
            velocity: turned(Vector2::new(self.speed, 0.0), heading + here),
            heading: heading + here,
        }
    }
}

impl Corners {
    fn new(speed: f64, side: f64) -> Corners {
        // The way made in a turn scales with its duration; two have to fit into a side.
        let shape = way(1.0, 1.0).last().map_or(0.0, |w| w.x);
        let turn = TURN_S.min(0.45 * side / (speed * shape));
        let reach = shape * speed * turn;
        Corners {
            turn,
            first: (side - reach) / speed,
            leg: (side - 2.0 * reach) / speed,
            way: way(speed, turn),
        }
    }
    /// Number of the last turn begun (negative before the first) and the time since it began, s.
    fn phase(&self, t: f64) -> (f64, f64) {
        let since = t - self.first;
        if since < 0.0 {
            return (-1.0, f64::INFINITY);
        }
        let turn = (since / (self.turn + self.leg)).floor();
        (turn, since - turn * (self.turn + self.leg))
    }
    /// The way made `since` the turn began: cubic between the parts, with the velocity at their ends.
    fn position(&self, since: f64, speed: f64) -> Vector2<f64> {
        let h = self.turn / TURN_PARTS as f64;
        let i = ((since / h).floor().max(0.0) as usize).min(TURN_PARTS - 1);
        let s = since / h - i as f64;
        let velocity = |k: usize| {
            let heading = FRAC_PI_2 * smooth_step(k as f64 * h, self.turn).y;
            turned(Vector2::new(speed, 0.0), heading) * h
        };
        let (p, q) = (self.way[i], self.way[i + 1]);
        let (v, w) = (velocity(i), velocity(i + 1));
        let (c2, c3) = ((q - p) * 3.0 - v * 2.0 - w, (p - q) * 2.0 + v + w);
        p + (v + (c2 + c3 * s) * s) * s
    }
}

/// Way made in a turn of `turn` seconds at `speed`, by its parts (Simpson's rule).
fn way(speed: f64, turn: f64) -> Vec<Vector2<f64>> {
    let h = turn / TURN_PARTS as f64;
    let velocity = |t: f64| turned(Vector2::new(speed, 0.0), FRAC_PI_2 * smooth_step(t, turn).y);
    let mut out = vec![Vector2::zeros()];
    let mut sum = Vector2::zeros();
    for i in 0..TURN_PARTS {
        let t = i as f64 * h;
        sum += (velocity(t) + velocity(t + 0.5 * h) * 4.0 + velocity(t + h)) * (h / 6.0);
        out.push(sum);
    }
    out
}

//! Mean path of a vessel: position, speed and heading without waves, twice differentiable. Heading and speed change by
//! a quintic step, or oscillate sinusoidally. Random parameters are drawn from the stream `vessel/course`.

use core::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector2;
use rand::RngExt;

use super::config::{VesselConfig, VesselCourse};
use crate::physics::{spline::smooth_step, streams::Streams};

/// Duration of a turn by 90 deg, s; the duration is proportional to the angle. Chosen: 11 deg/s, at which a
/// small boat does not heel.
const TURN_S: f64 = 8.0;
const TURN_PARTS: usize = 400;
/// Duration of a speed change, s. Chosen: time constant of a planing boat's surge.
const SPEED_CHANGE_S: f64 = 5.0;
/// Maximum delay of a turn or speed change after the first descent, s; the helmsman does not know about the descent.
const CHANGE_WITHIN_S: f64 = 4.0;
/// Longer than any trial, s.
const FOR_GOOD_S: f64 = 1e9;
/// Harmonics of a limit cycle: a free drift is a parabola, and a thruster pulse a kink that the thruster's
/// lag rounds off.
const HARMONICS: [f64; 3] = [1.0, 2.0, 3.0];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// North and east, m.
    pub position: Vector2<f64>,
    pub velocity: Vector2<f64>,
    pub heading: f64,
}

#[derive(Clone, Debug)]
pub struct MeanPath {
    heading: f64,
    speed: f64,
    shape: Shape,
}

#[derive(Clone, Debug)]
enum Shape {
    /// Straight or at rest.
    Straight,
    Turns(Turns),
    SpeedChange {
        begins: Begin,
        by: f64,
    },
    /// Station keeping: limit cycles to north (m), to east (m) and in heading (rad).
    LimitCycles([Cycle; 3]),
    Anchored(Sheer),
}

#[derive(Clone, Copy, Debug)]
struct Begin {
    /// Start, s; infinite until [`Begin::ask`] is called.
    at: f64,
    /// Delay from that call, s.
    delay: f64,
}

impl Begin {
    fn ask(&mut self, now: f64) {
        if self.at.is_infinite() {
            self.at = now + self.delay;
        }
    }
}

fn turned(v: Vector2<f64>, angle: f64) -> Vector2<f64> {
    let (s, c) = angle.sin_cos();
    Vector2::new(c * v.x - s * v.y, s * v.x + c * v.y)
}

impl MeanPath {
    pub fn new(config: &VesselConfig, heading: f64, streams: &Streams) -> MeanPath {
        let mut draw = streams.stream("vessel/course");
        let mut between = |low: f64, high: f64| low + (high - low) * draw.random::<f64>();
        let under_way = config.course.is_under_way() && config.speed_mps > 0.0;
        let speed = if under_way { config.speed_mps } else { 0.0 };
        let side = between(-1.0, 1.0).signum();
        let begins = Begin {
            at: config.change_at_s.unwrap_or(f64::INFINITY),
            delay: between(0.0, CHANGE_WITHIN_S),
        };
        let mut path = MeanPath {
            heading,
            speed,
            shape: Shape::Straight,
        };
        path.shape = match config.course {
            VesselCourse::Drift | VesselCourse::Straight => Shape::Straight,
            VesselCourse::StationKeeping => {
                Shape::LimitCycles([(0.3, 0.8), (0.3, 0.8), (0.05, 0.15)].map(|(low, high)| Cycle {
                    amplitude: between(low, high),
                    omega: TAU / between(20.0, 50.0),
                    phase: between(0.0, TAU),
                }))
            }
            VesselCourse::Anchored => Shape::Anchored(Sheer {
                rode: between(15.0, 30.0),
                swing: between(20.0, 40.0).to_radians(),
                omega: TAU / between(60.0, 120.0),
                phase: between(0.0, TAU),
            }),
            _ if !under_way => Shape::Straight,
            VesselCourse::Square => Shape::Turns(Turns::square(speed, config.side_m)),
            VesselCourse::Zigzag => {
                let angle = side * between(10.0, 20.0).to_radians();
                let leg = between(10.0, 20.0);
                // The first leg is off the mean course by half the turn's angle.
                path.heading -= angle;
                Shape::Turns(Turns::zigzag(speed, 2.0 * angle, leg))
            }
            VesselCourse::Turn => {
                let angle = side * between(45.0, 120.0).to_radians();
                Shape::Turns(Turns::once(speed, angle, begins))
            }
            VesselCourse::SpeedChange => Shape::SpeedChange {
                begins,
                by: 0.5 * side * speed,
            },
        };
        path
    }

    /// Starts the turn or speed change of the course a random time after `t`, s, unless its start is configured.
    pub fn ask_change(&mut self, t: f64) {
        match &mut self.shape {
            Shape::Turns(turns) => turns.begins.ask(t),
            Shape::SpeedChange { begins, .. } => begins.ask(t),
            Shape::Straight | Shape::LimitCycles(_) | Shape::Anchored(_) => {}
        }
    }

    /// Whether heading or speed changes within `margin` (s) of `t` (s).
    pub fn changes(&self, t: f64, margin: f64) -> bool {
        match &self.shape {
            Shape::Straight => false,
            Shape::Turns(c) => {
                let [a, b] = [t - margin, t + margin].map(|t| c.phase(t));
                a.1 < c.turn || b.1 < c.turn && b.0 >= 0.0
            }
            Shape::SpeedChange { begins, .. } => {
                (begins.at - margin..=begins.at + SPEED_CHANGE_S + margin).contains(&t)
            }
            Shape::LimitCycles(_) | Shape::Anchored(_) => true,
        }
    }

    pub fn at(&self, t: f64) -> PathPoint {
        match &self.shape {
            Shape::Straight => straight(Vector2::zeros(), self.speed, self.heading, t),
            Shape::Turns(turns) => turns.at(self.heading, self.speed, t),
            Shape::SpeedChange { begins, by } => {
                let s = ((t - begins.at) / SPEED_CHANGE_S).max(0.0);
                let c = s.min(1.0);
                // Integral of the quintic step, plus the time at the new speed.
                let more = SPEED_CHANGE_S * (c.powi(4) * (2.5 - 3.0 * c + c * c) + (s - c));
                let ahead = turned(Vector2::new(1.0, 0.0), self.heading);
                PathPoint {
                    position: ahead * (self.speed * t + by * more),
                    velocity: ahead * (self.speed + by * smooth_step(s, 1.0).y),
                    heading: self.heading,
                }
            }
            Shape::LimitCycles(cycles) => {
                let [north, east, heading] = cycles.map(|c| c.at(t));
                PathPoint {
                    position: Vector2::new(north[0] - cycles[0].at(0.0)[0], east[0] - cycles[1].at(0.0)[0]),
                    velocity: Vector2::new(north[1], east[1]),
                    heading: self.heading + heading[0],
                }
            }
            Shape::Anchored(sheer) => sheer.at(self.heading, t),
        }
    }
}

fn straight(from: Vector2<f64>, speed: f64, heading: f64, since: f64) -> PathPoint {
    let velocity = turned(Vector2::new(speed, 0.0), heading);
    PathPoint {
        position: from + velocity * since,
        velocity,
        heading,
    }
}

/// Limit cycle of a thruster with a dead band in steady wind, in one degree of freedom.
#[derive(Clone, Copy, Debug)]
struct Cycle {
    /// Amplitude of the first harmonic, m or rad.
    amplitude: f64,
    /// Angular frequency, rad/s.
    omega: f64,
    phase: f64,
}

impl Cycle {
    /// Value and derivative at `t`, s.
    fn at(&self, t: f64) -> [f64; 2] {
        let angle = self.omega * t + self.phase;
        let sum = |f: fn(f64, f64) -> f64| HARMONICS.into_iter().map(|k| f(k, k * angle)).sum::<f64>();
        [
            self.amplitude * sum(|k, x| x.cos() / (k * k)),
            -self.amplitude * self.omega * sum(|k, x| x.sin() / k),
        ]
    }
}

#[derive(Clone, Copy, Debug)]
struct Sheer {
    /// Distance from the anchor to amidships, m.
    rode: f64,
    /// Maximum swing of the bow to one side, rad; the rode swings half as far.
    swing: f64,
    omega: f64,
    phase: f64,
}

impl Sheer {
    /// The anchor is ahead at the heading `rest`. When the hull moves fastest, the bow is at its largest
    /// angle to the side of the motion.
    fn at(&self, rest: f64, t: f64) -> PathPoint {
        let (sin, cos) = (self.omega * t + self.phase).sin_cos();
        let arc = |sin: f64| turned(Vector2::new(-self.rode, 0.0), rest + 0.5 * self.swing * sin);
        let here = arc(sin);
        PathPoint {
            position: here - arc(self.phase.sin()),
            velocity: Vector2::new(-here.y, here.x) * (0.5 * self.swing * self.omega * cos),
            heading: rest - self.swing * cos,
        }
    }
}

#[derive(Clone, Debug)]
struct Turns {
    begins: Begin,
    /// Angle of the first turn, to starboard, rad.
    angle: f64,
    /// Turns alternate between starboard and port.
    alternates: bool,
    /// Durations of a turn, and of the straight leg after it, s.
    turn: f64,
    leg: f64,
    /// Points along the first turn, m: along and across the initial heading.
    way: Vec<Vector2<f64>>,
}

impl Turns {
    fn new(speed: f64, first: Begin, angle: f64, turn: f64, leg: f64) -> Turns {
        Turns {
            begins: first,
            angle,
            alternates: false,
            turn,
            leg,
            way: way(speed, angle, turn),
        }
    }
    fn square(speed: f64, side: f64) -> Turns {
        // A turn covers a distance proportional to its duration, and two turns must fit into a side.
        let shape = way(1.0, FRAC_PI_2, 1.0).last().map_or(0.0, |w| w.x);
        let turn = TURN_S.min(0.45 * side / (speed * shape));
        let reach = shape * speed * turn;
        let first = Begin {
            at: (side - reach) / speed,
            delay: 0.0,
        };
        Turns::new(speed, first, FRAC_PI_2, turn, (side - 2.0 * reach) / speed)
    }
    /// Turns to alternating sides, `between` seconds apart.
    fn zigzag(speed: f64, angle: f64, between: f64) -> Turns {
        let turn = TURN_S * angle.abs() / FRAC_PI_2;
        let first = Begin {
            at: between,
            delay: 0.0,
        };
        Turns {
            alternates: true,
            ..Turns::new(speed, first, angle, turn, between - turn)
        }
    }
    fn once(speed: f64, angle: f64, begins: Begin) -> Turns {
        let turn = TURN_S * angle.abs() / FRAC_PI_2;
        Turns::new(speed, begins, angle, turn, FOR_GOOD_S)
    }

    /// Number of the turn begun last (negative before the first), and the time since its start, s.
    fn phase(&self, t: f64) -> (f64, f64) {
        let since = t - self.begins.at;
        if since < 0.0 {
            return (-1.0, f64::INFINITY);
        }
        let turn = (since / (self.turn + self.leg)).floor();
        (turn, since - turn * (self.turn + self.leg))
    }
    /// 1 to starboard; if turns alternate, -1 for every second turn.
    fn side(&self, k: u64) -> f64 {
        if self.alternates && k % 2 == 1 { -1.0 } else { 1.0 }
    }
    /// Heading before turn `k` relative to the heading before the first turn, rad.
    fn turned_before(&self, k: u64) -> f64 {
        let turns = if self.alternates { k % 2 } else { k };
        turns as f64 * self.angle
    }
    /// Displacement from the start of turn `k` to the start of the next, in the axes of the first heading, m.
    fn step(&self, k: u64, speed: f64) -> Vector2<f64> {
        let whole = self.way.last().copied().unwrap_or_default();
        let whole = Vector2::new(whole.x, self.side(k) * whole.y);
        let leg = turned(Vector2::new(speed * self.leg, 0.0), self.turned_before(k + 1));
        turned(whole, self.turned_before(k)) + leg
    }
    /// Point at `t` (s); `first_heading` is the heading before the first turn, rad.
    fn at(&self, first_heading: f64, speed: f64, t: f64) -> PathPoint {
        let (turn, since) = self.phase(t);
        if turn < 0.0 {
            return straight(Vector2::zeros(), speed, first_heading, t);
        }
        let turn = turn as u64;
        // Four corners close a square; after two turns a zigzag is back on its mean course.
        let cycle = if self.alternates { 2 } else { 4 };
        let steps = |n: u64| (0..n).map(|k| self.step(k, speed)).sum::<Vector2<f64>>();
        let rounds = if self.alternates {
            (turn / cycle) as f64
        } else {
            0.0
        };
        let start = Vector2::new(speed * self.begins.at, 0.0) + steps(cycle) * rounds + steps(turn % cycle);
        let start = turned(start, first_heading);
        let heading = first_heading + self.turned_before(turn);
        let side = self.side(turn);
        let mirrored = |v: Vector2<f64>| Vector2::new(v.x, side * v.y);
        if since >= self.turn {
            let whole = mirrored(self.way.last().copied().unwrap_or_default());
            let next = first_heading + self.turned_before(turn + 1);
            return straight(start + turned(whole, heading), speed, next, since - self.turn);
        }
        let here = heading + side * self.angle * smooth_step(since, self.turn).y;
        PathPoint {
            position: start + turned(mirrored(self.position(since, speed)), heading),
            velocity: turned(Vector2::new(speed, 0.0), here),
            heading: here,
        }
    }
    /// Position `since` seconds after the first turn began: cubic between the points, using their velocities.
    fn position(&self, since: f64, speed: f64) -> Vector2<f64> {
        let h = self.turn / TURN_PARTS as f64;
        let i = ((since / h).floor().max(0.0) as usize).min(TURN_PARTS - 1);
        let s = since / h - i as f64;
        let velocity = |k: usize| {
            let heading = self.angle * smooth_step(k as f64 * h, self.turn).y;
            turned(Vector2::new(speed, 0.0), heading) * h
        };
        let p = self.way[i];
        let q = self.way[i + 1];
        let v = velocity(i);
        let w = velocity(i + 1);
        let c2 = (q - p) * 3.0 - v * 2.0 - w;
        let c3 = (p - q) * 2.0 + v + w;
        p + (v + (c2 + c3 * s) * s) * s
    }
}

/// Points along a turn by `angle` (rad) in `turn` seconds at `speed`, by Simpson's rule.
fn way(speed: f64, angle: f64, turn: f64) -> Vec<Vector2<f64>> {
    let h = turn / TURN_PARTS as f64;
    let velocity = |t: f64| turned(Vector2::new(speed, 0.0), angle * smooth_step(t, turn).y);
    let mut out = vec![Vector2::zeros()];
    let mut sum = Vector2::zeros();
    for i in 0..TURN_PARTS {
        let t = i as f64 * h;
        sum += (velocity(t) + velocity(t + 0.5 * h) * 4.0 + velocity(t + h)) * (h / 6.0);
        out.push(sum);
    }
    out
}

#[cfg(test)]
mod tests {
    use alight_shared::frames::wrap_angle;

    use super::*;

    fn path_of(course: VesselCourse, seed: u64) -> MeanPath {
        let config = VesselConfig {
            course,
            change_at_s: Some(20.0),
            ..VesselConfig::default()
        };
        MeanPath::new(&config, 0.4, &Streams::new(seed))
    }

    #[test]
    fn path_velocity_on_every_course() {
        for course in VesselCourse::ALL {
            for seed in 0..6 {
                let path = path_of(course, seed);
                let h = 1e-3;
                for k in 1..4000 {
                    let t = 0.0501 * f64::from(k);
                    let [a, b, c] = [t - h, t, t + h].map(|t| path.at(t));
                    let v = (c.position - a.position) / (2.0 * h);
                    assert!((v - b.velocity).norm() < 1e-3, "{course:?} {seed} at {t}: {v}");
                    let acceleration = (c.velocity - a.velocity).norm() / (2.0 * h);
                    let rate = (c.heading - a.heading).abs() / (2.0 * h);
                    assert!(
                        acceleration < 1.0 && rate < 0.4,
                        "{course:?} {seed}: {acceleration} {rate}"
                    );
                    let steady = acceleration < 1e-6 && rate < 1e-6;
                    assert!(steady || path.changes(t, 2.0 * h), "{course:?} {seed} at {t}");
                }
            }
        }
    }

    #[test]
    fn moored_vessel_path() {
        for (course, near, swing) in [
            (VesselCourse::StationKeeping, 4.0, [0.1, 0.5]),
            (VesselCourse::Anchored, 22.0, [0.6, 1.5]),
        ] {
            for seed in 0..20 {
                let path = path_of(course, seed);
                let points = || (0..3000).map(|k| path.at(0.1 * f64::from(k)));
                assert!(points().all(|p| p.position.norm() < near), "{course:?} {seed}");
                let headings = || points().map(|p| p.heading);
                let range = headings().fold(f64::MIN, f64::max) - headings().fold(f64::MAX, f64::min);
                assert!(
                    (swing[0]..swing[1]).contains(&range),
                    "{course:?} {seed}: {range}"
                );
            }
        }
    }

    #[test]
    fn zigzag_path() {
        for seed in 0..20 {
            let end = path_of(VesselCourse::Zigzag, seed).at(200.0).position;
            let along = turned(end, -0.4);
            assert!(along.x > 0.9 * 400.0 && along.y.abs() < 15.0, "{seed}: {along}");
        }
    }

    #[test]
    fn open_turn_within_six_seconds() {
        let mut sides = [0; 2];
        let mut angles = [f64::MAX, 0.0];
        for seed in 0..40 {
            let config = VesselConfig {
                course: VesselCourse::Turn,
                ..VesselConfig::default()
            };
            let mut path = MeanPath::new(&config, 0.4, &Streams::new(seed));
            assert!((path.at(500.0).heading - 0.4).abs() < 1e-12);
            path.ask_change(100.0);
            path.ask_change(300.0);
            assert!((path.at(100.0).heading - 0.4).abs() < 1e-12);
            let by = wrap_angle(path.at(118.0).heading - 0.4);
            assert!((path.at(500.0).heading - 0.4 - by).abs() < 1e-9, "{seed}");
            sides[usize::from(by > 0.0)] += 1;
            angles = [angles[0].min(by.abs()), angles[1].max(by.abs())];
        }
        assert!(sides.iter().all(|n| *n > 10), "{sides:?}");
        assert!(angles[0] > 0.78 && angles[0] < 1.1 && angles[1] < 2.1 && angles[1] > 1.8);
    }
}

//! Autopilot of the simulated vessel: course and speed with two engines, or station keeping.

use core::f64::consts::FRAC_PI_2;

use alight_shared::frames::wrap_angle;
use nalgebra::{Vector2, Vector3, Vector6};

use super::{
    config::{VesselConfig, VesselCourse},
    path::{MeanPath, PathPoint},
};
use crate::physics::streams::Streams;

#[derive(Clone, Debug)]
pub struct Helm {
    course: VesselCourse,
    path: MeanPath,
    t: f64,
    side: f64,
    limits: [f64; 2],
    engine_offset: f64,
    drag: [f64; 2],
    /// Inertia in surge and sway (kg) and yaw (kg m²), including added mass.
    inertia: [f64; 3],
    /// Start of the current leg, north and east, m.
    from: Vector2<f64>,
    /// Direction of the leg, rad.
    leg: f64,
    /// Speed through the water with the waves filtered out, m/s.
    smooth_speed: f64,
    /// Integral part of the speed controller, N.
    integral: f64,
}

/// Look-ahead of the line-of-sight guidance, m. Chosen: three times half the default vessel's length.
const LOOK_AHEAD_M: f64 = 8.0;
/// Minimum look-ahead, s; a fast vessel overshoots its line with less.
const LOOK_AHEAD_S: f64 = 4.0;
/// Speed up to which the heading gain is constant, m/s. Above it the gain grows with the Munk moment, which
/// turns the hull broadside to its course and is proportional to the square of speed.
const SLOW_MPS: f64 = 2.0;
/// Distance before a corner at which the turn begins, m.
const EARLY_M: f64 = 5.0;
/// Natural frequency of the heading loop, rad/s; damping ratio 1.
const YAW_FREQUENCY: f64 = 0.7;
/// Natural frequency of the position hold, rad/s, well below the wave frequencies; damping ratio 1.
const HOLD_FREQUENCY: f64 = 0.35;
/// Time constant of the speed loop and of the wave filter, s.
const SPEED_TIME_S: f64 = 2.0;

impl Helm {
    pub fn new(config: &VesselConfig, inertia: [f64; 3], heading: f64, streams: &Streams) -> Self {
        let path = MeanPath::new(config, heading, streams);
        Helm {
            course: config.course,
            smooth_speed: path.at(0.0).velocity.norm(),
            path,
            t: 0.0,
            side: config.side_m,
            limits: [-config.thrust_reverse_n, config.thrust_forward_n],
            engine_offset: config.hull_offset_m,
            drag: [config.linear_drag_nspm[0], config.quadratic_drag_ns2pm2[0]],
            inertia,
            from: Vector2::zeros(),
            leg: heading,
            integral: 0.0,
        }
    }

    /// Starts the turn or speed change of the course a random time after `t`, s.
    pub fn ask_change(&mut self, t: f64) {
        self.path.ask_change(t);
    }

    /// Force in surge and sway (N) and yaw moment (Nm), `dt` after the last call, from position (m), heading
    /// (rad) and body velocity (m/s, rad/s).
    pub fn steer(&mut self, at: Vector2<f64>, heading: f64, nu: &Vector6<f64>, dt: f64) -> Vector3<f64> {
        self.t += dt;
        let here = self.path.at(self.t);
        let speed = here.velocity.norm();
        match self.course {
            VesselCourse::Drift => Vector3::zeros(),
            VesselCourse::StationKeeping | VesselCourse::Anchored => self.hold(&here, at, heading, nu),
            VesselCourse::Straight => self.engines(self.line_of_sight(at, speed), speed, heading, nu, dt),
            VesselCourse::Square => {
                if self.along(at).x > self.side - EARLY_M {
                    self.from += Vector2::new(self.leg.cos(), self.leg.sin()) * self.side;
                    self.leg = wrap_angle(self.leg + FRAC_PI_2);
                }
                self.engines(self.line_of_sight(at, speed), speed, heading, nu, dt)
            }
            // Steered by compass and log.
            VesselCourse::Zigzag | VesselCourse::Turn | VesselCourse::SpeedChange => {
                self.engines(here.heading, speed, heading, nu, dt)
            }
        }
    }

    /// Effect of anchor rode, wind and thrusters: a soft spring towards the mean path that has little effect
    /// at wave frequencies.
    fn hold(&self, here: &PathPoint, at: Vector2<f64>, heading: f64, nu: &Vector6<f64>) -> Vector3<f64> {
        let (s, c) = heading.sin_cos();
        let body = |v: Vector2<f64>| Vector2::new(c * v.x + s * v.y, c * v.y - s * v.x);
        let off = body(here.position - at);
        let velocity = body(here.velocity);
        let w = HOLD_FREQUENCY;
        let pull = |mass: f64, off: f64, rate: f64| mass * w * (w * off + 2.0 * rate);
        let [surge, sway, yaw] = self.inertia;
        Vector3::new(
            pull(surge, off.x, velocity.x - nu[0]),
            pull(sway, off.y, velocity.y - nu[1]),
            pull(yaw, wrap_angle(here.heading - heading), -nu[5]),
        )
    }

    /// Line-of-sight guidance (Fossen 2011, section 10.3): heading towards a point ahead on the leg, rad.
    fn line_of_sight(&self, at: Vector2<f64>, speed: f64) -> f64 {
        let look_ahead = LOOK_AHEAD_M.max(LOOK_AHEAD_S * speed);
        self.leg - (self.along(at).y / look_ahead).atan()
    }

    /// Thrust of the engines that achieves a heading (rad) and speed (m/s).
    fn engines(&mut self, wanted: f64, speed: f64, heading: f64, nu: &Vector6<f64>, dt: f64) -> Vector3<f64> {
        let [mass, _, yaw_inertia] = self.inertia;
        let error = wrap_angle(wanted - heading);
        let frequency = YAW_FREQUENCY * (speed / SLOW_MPS).max(1.0).powf(1.5);
        let moment = yaw_inertia * frequency * (frequency * error - 2.0 * nu[5]);

        self.smooth_speed += (nu[0] - self.smooth_speed) * (dt / SPEED_TIME_S).min(1.0);
        let lack = speed - self.smooth_speed;
        let [low, high] = self.limits;
        let step = mass / (SPEED_TIME_S * 5.0) * lack * dt;
        self.integral = (self.integral + step).clamp(2.0 * low, 2.0 * high);
        let force =
            self.drag[0] * speed + self.drag[1] * speed * speed + mass / SPEED_TIME_S * lack + self.integral;

        // Steering has priority: saturated engines reduce their common thrust.
        let turn = (0.5 * moment / self.engine_offset).clamp(0.5 * (low - high), 0.5 * (high - low));
        let common = (0.5 * force).clamp(low + turn.abs(), high - turn.abs());
        // More thrust from the port engine turns the bow to starboard.
        let [port, starboard] = [common + turn, common - turn];
        Vector3::new(port + starboard, 0.0, self.engine_offset * (port - starboard))
    }

    /// Distance along the leg, and to starboard of the leg, m.
    fn along(&self, at: Vector2<f64>) -> Vector2<f64> {
        let (s, c) = self.leg.sin_cos();
        let d = at - self.from;
        Vector2::new(c * d.x + s * d.y, c * d.y - s * d.x)
    }
}

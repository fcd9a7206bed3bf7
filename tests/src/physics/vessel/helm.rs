//! The vessel's own autopilot: course and speed by two engines. It is part of the world.

use core::f64::consts::FRAC_PI_2;

use alight_shared::frames::wrap_angle;
use nalgebra::{Vector2, Vector6};

use super::config::{Course, VesselConfig};

/// Where it is steering.
#[derive(Clone, Debug)]
pub struct Helm {
    course: Course,
    speed: f64,
    side: f64,
    limits: [f64; 2],
    engine_offset: f64,
    drag: [f64; 2],
    yaw_inertia: f64,
    mass: f64,
    /// Start of the present leg, north and east, m.
    from: Vector2<f64>,
    /// Its direction, rad.
    leg: f64,
    /// Speed through the water without the waves' share, m/s.
    smooth_speed: f64,
    /// Integral part of the speed controller, N.
    integral: f64,
}

/// Look-ahead of the line-of-sight guidance, m (ours: three lengths of the default vessel's half) ...
const LOOK_AHEAD_M: f64 = 8.0;
/// ... and at least this far in time, s: a fast vessel would overshoot its line.
const LOOK_AHEAD_S: f64 = 4.0;
/// Up to this speed the heading loop is that of a slow vessel, m/s. Above it the gain grows with the
/// hull's own moment, which turns it across its way with the square of the speed (Munk).
const SLOW_MPS: f64 = 2.0;
/// Distance before a corner where it starts to turn, m.
const EARLY_M: f64 = 5.0;
/// Natural frequency of the heading loop, rad/s; damping ratio 1.
const YAW_FREQUENCY: f64 = 0.7;
/// Time constant of the speed loop and of the filter against waves, s.
const SPEED_TIME_S: f64 = 2.0;

impl Helm {
    /// Steering along `heading` (rad) from `from`.
    pub fn new(
        config: &VesselConfig,
        surge_mass: f64,
        yaw_inertia: f64,
        from: Vector2<f64>,
        heading: f64,
    ) -> Self {
        Helm {
            course: config.course,
            speed: config.speed_mps,
            side: config.side_m,
            limits: [-config.thrust_reverse_n, config.thrust_forward_n],
            engine_offset: config.hull_offset_m,
            drag: [config.linear_drag_nspm[0], config.quadratic_drag_ns2pm2[0]],
            yaw_inertia,
            mass: surge_mass,
            from,
            leg: heading,
            smooth_speed: if config.course == Course::Drift {
                0.0
            } else {
                config.speed_mps
            },
            integral: 0.0,
        }
    }

    /// Thrust of the port and starboard engine, N, from position (m), heading (rad) and body velocity
    /// (m/s, rad/s), `dt` after the last call.
    pub fn thrust(&mut self, at: Vector2<f64>, heading: f64, nu: &Vector6<f64>, dt: f64) -> [f64; 2] {
        match self.course {
            Course::Drift => return [0.0; 2],
            Course::Straight => {}
            Course::Square => {
                if self.along(at).x > self.side - EARLY_M {
                    self.from += Vector2::new(self.leg.cos(), self.leg.sin()) * self.side;
                    self.leg = wrap_angle(self.leg + FRAC_PI_2);
                }
            }
        }
        // Line of sight (Fossen 2011, section 10.3): steer at a point on the leg ahead.
        let look_ahead = LOOK_AHEAD_M.max(LOOK_AHEAD_S * self.speed);
        let wanted = self.leg - (self.along(at).y / look_ahead).atan();
        let error = wrap_angle(wanted - heading);
        let frequency = YAW_FREQUENCY * (self.speed / SLOW_MPS).max(1.0).powf(1.5);
        let moment = self.yaw_inertia * frequency * (frequency * error - 2.0 * nu[5]);

        self.smooth_speed += (nu[0] - self.smooth_speed) * (dt / SPEED_TIME_S).min(1.0);
        let lack = self.speed - self.smooth_speed;
        let [low, high] = self.limits;
        let step = self.mass / (SPEED_TIME_S * 5.0) * lack * dt;
        self.integral = (self.integral + step).clamp(2.0 * low, 2.0 * high);
        let force = self.drag[0] * self.speed
            + self.drag[1] * self.speed * self.speed
            + self.mass / SPEED_TIME_S * lack
            + self.integral;

        // Steering goes first: the engines' common part gives way.
        let turn = (0.5 * moment / self.engine_offset).clamp(0.5 * (low - high), 0.5 * (high - low));
        let common = (0.5 * force).clamp(low + turn.abs(), high - turn.abs());
        // The port engine pushes the bow to starboard.
        [common + turn, common - turn]
    }

    /// Way made along the leg and to starboard of it, m.
    fn along(&self, at: Vector2<f64>) -> Vector2<f64> {
        let (s, c) = self.leg.sin_cos();
        let d = at - self.from;
        Vector2::new(c * d.x + s * d.y, c * d.y - s * d.x)
    }
}

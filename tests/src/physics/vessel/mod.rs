//! True vessel: a nonlinear rigid body in moving water, with six degrees of freedom.
//!
//! `M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + d(nu_r) = tau_pressure + tau_weight + tau_engines`
//! (Fossen 2011, eq. 8.126), where `nu_r = nu - nu_w` and `nu_w` is the water's mean motion over the hulls.
//!
//! - Pressure (buoyancy and Froude-Krylov force together): by Gauss' theorem the force on a section of submerged volume
//!   V is `-V grad p = rho V (a - g)` with the water's acceleration `a` at the section, acting at the centroid of the
//!   submerged segment. It is normal to the surface, so waves also push in surge and sway.
//! - Added mass acts on the acceleration relative to the water, drag on the relative velocity, so that in
//!   waves much longer than the hull the vessel moves like a particle of the water.
//!
//! The water is sampled at all sections once per step, at the time and position of the step's end, and
//! interpolated within the step (error below 1e-4 of the elevation at 10 ms).

pub mod config;
pub mod helm;
pub mod hull;
pub mod path;
pub mod response;
pub mod rigid;

use core::f64::consts::TAU;

use alight_shared::{
    frames::{Point, Rotation, TrueNed, Vector, VesselBody},
    geometry::GRAVITY,
    time::{Span, Time, WorldTime},
};
use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector2, Vector3, Vector6};
use rand::RngExt;

pub use config::{VesselConfig, VesselCourse, VesselLoad};

use self::{
    helm::Helm,
    hull::{Hull, segment},
    rigid::{coriolis, head, join, rigid_body_mass, tail},
};
use crate::physics::{
    body::RigidState,
    sea::{Sea, WATER_DENSITY, WaterSample},
    streams::Streams,
};

/// Bounds of speed (m/s) and rate (rad/s) that protect the integrator; no permitted sea causes such motion.
const MAX_SPEED: f64 = 30.0;
const MAX_RATE: f64 = 12.0;

#[derive(Clone, Copy, Debug)]
struct Motion {
    position: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    nu: Vector6<f64>,
}

/// Water at the sections at one time, and the positions of the samples.
#[derive(Clone, Debug)]
struct WaterAt {
    time: WorldTime,
    places: Vec<Vector2<f64>>,
    samples: Vec<WaterSample>,
}

#[derive(Clone, Debug)]
pub struct Vessel {
    hull: Hull,
    rigid_mass: Matrix6<f64>,
    added_mass: Matrix6<f64>,
    inverse_mass: Matrix6<f64>,
    weight: f64,
    centre_of_gravity: Vector3<f64>,
    linear_drag: Vector6<f64>,
    quadratic_drag: Vector6<f64>,
    coupling: f64,
    substep_limit_s: f64,
    helm: Helm,
    /// Force from engines or position hold: surge and sway (N), yaw (Nm).
    steering: Vector3<f64>,
    loads: Vec<VesselLoad>,
    /// Load from [`Vessel::push`]: surge, sway, heave, roll, pitch, yaw, N and Nm.
    pushed: Vector6<f64>,
    /// Current load from the configuration.
    pushing: Vector6<f64>,
    motion: Motion,
    nu_dot: Vector6<f64>,
    before: WaterAt,
    after: WaterAt,
}

impl Vessel {
    /// Vessel that floats at the origin at time zero; the stream `vessel/heading` draws its heading unless
    /// configured. It moves with the water, and at its configured speed unless it drifts.
    pub fn new(config: &VesselConfig, sea: &Sea, streams: &Streams) -> Vessel {
        let drawn = streams.stream("vessel/heading").random::<f64>() * TAU;
        let heading = config.heading_deg.map_or(drawn, f64::to_radians);
        let hull = Hull::new(config, GRAVITY);
        let cg = Vector3::from(config.centre_of_gravity_m);
        let inertia = Vector3::from(config.inertia_kgm2);
        let rigid_mass = rigid_body_mass(config.mass_kg, cg, inertia);
        let base = join(Vector3::repeat(config.mass_kg), inertia);
        let added_mass = Matrix6::from_diagonal(&base.component_mul(&Vector6::from(config.added_mass)));
        let mass = rigid_mass + added_mass;
        // The matrix is positive definite within the checked ranges; the fallback avoids a panic.
        let inverse_mass = mass.try_inverse().unwrap_or_else(Matrix6::identity);

        let mut linear_drag = Vector6::zeros();
        let mut quadratic_drag = Vector6::zeros();
        for i in 0..2 {
            linear_drag[i] = config.linear_drag_nspm[i];
            quadratic_drag[i] = config.quadratic_drag_ns2pm2[i];
        }
        linear_drag[5] = config.linear_yaw_drag_nms;
        quadratic_drag[5] = config.quadratic_yaw_drag_nms2;
        let mut fastest = 1.0_f64;
        for i in 0..3 {
            let k = hull.stiffness[i].max(0.0);
            let m = mass[(i + 2, i + 2)];
            linear_drag[i + 2] = 2.0 * config.damping_ratio[i] * (k * m).sqrt();
            fastest = fastest.max((k / m).sqrt() * (1.0 + config.damping_ratio[i]));
        }

        let start = sea.surface(Time::EPOCH, 0.0, 0.0);
        let attitude = level(&start, heading);
        let mut drift = start.velocity;
        drift.x *= config.sideways_coupling;
        drift.y *= config.sideways_coupling;
        let mut nu = join(attitude.inverse() * drift, Vector3::zeros());
        if config.course.is_under_way() {
            nu[0] += config.speed_mps;
        }
        let motion = Motion {
            position: Vector3::new(0.0, 0.0, start.surface_z()),
            attitude,
            nu,
        };
        let none = WaterAt {
            time: Time::EPOCH,
            places: vec![Vector2::zeros(); hull.centres.len()],
            samples: vec![WaterSample::default(); hull.centres.len()],
        };
        let mut vessel = Vessel {
            helm: Helm::new(
                config,
                [mass[(0, 0)], mass[(1, 1)], mass[(5, 5)]],
                heading,
                streams,
            ),
            weight: config.mass_kg * GRAVITY,
            centre_of_gravity: cg,
            coupling: config.sideways_coupling,
            // RK4 with w dt <= 0.5 is accurate to 1e-4 per period.
            substep_limit_s: 0.5 / fastest,
            hull,
            rigid_mass,
            added_mass,
            inverse_mass,
            linear_drag,
            quadratic_drag,
            steering: Vector3::zeros(),
            loads: config.loads.clone(),
            pushed: Vector6::zeros(),
            pushing: Vector6::zeros(),
            motion,
            nu_dot: Vector6::zeros(),
            before: none.clone(),
            after: none,
        };
        vessel.ask_water(Time::EPOCH, sea);
        vessel.before.clone_from(&vessel.after);
        vessel.nu_dot = vessel.acceleration(&vessel.motion, 1.0);
        vessel
    }

    /// Advances from `t` by `dt_s`, which is at most 0.1 s.
    pub fn step(&mut self, t: WorldTime, dt_s: f64, sea: &Sea) {
        if !(dt_s > 0.0 && dt_s <= 0.1) {
            return;
        }
        if self.after.time != t {
            self.ask_water(t, sea);
        }
        self.pushing = self
            .loads
            .iter()
            .filter(|p| (p.at_s..p.at_s + p.for_s).contains(&t.secs()))
            .map(|p| Vector6::from(p.by_n_nm))
            .sum::<Vector6<f64>>()
            + self.pushed;
        core::mem::swap(&mut self.before, &mut self.after);
        // The error of these predicted section positions enters only as slope times dt².
        let here = self.motion;
        let (v, _) = world_rates(&here);
        self.motion.position += v * dt_s;
        self.ask_water(t + Span::from_secs(dt_s), sea);
        self.motion = here;

        let n = (dt_s / self.substep_limit_s).ceil().clamp(1.0, 50.0);
        let h = dt_s / n;
        for i in 0..n as usize {
            self.runge_kutta(h, i as f64 / n, 1.0 / n);
        }
        let m = &mut self.motion;
        for i in 0..6 {
            let bound = if i < 3 { MAX_SPEED } else { MAX_RATE };
            m.nu[i] = m.nu[i].clamp(-bound, bound);
        }
        let heading = m.attitude.euler_angles().2;
        self.steering = self.helm.steer(m.position.xy(), heading, &m.nu, dt_s);
        self.nu_dot = self.acceleration(&self.motion, 1.0);
    }

    /// Applies a load from now on: surge, sway, heave, roll, pitch, yaw in body axes, N and Nm.
    pub fn push(&mut self, by_n_nm: [f64; 6]) {
        self.pushed = Vector6::from(by_n_nm);
    }
    pub fn state(&self) -> RigidState<VesselBody> {
        let m = &self.motion;
        let v = head(&m.nu);
        let w = tail(&m.nu);
        RigidState {
            position: Point::<TrueNed>::from(m.position),
            velocity: Vector::from(m.attitude * v),
            // Derivative of R v is R (v' + w x v).
            acceleration: Vector::from(m.attitude * (head(&self.nu_dot) + w.cross(&v))),
            attitude: Rotation::from(m.attitude),
            rates: Vector::from(w),
            angular_acceleration: Vector::from(tail(&self.nu_dot)),
        }
    }
    pub fn ask_change(&mut self, t: WorldTime) {
        self.helm.ask_change(t.secs());
    }

    /// Samples the sea at the sections, at half the draft.
    fn ask_water(&mut self, t: WorldTime, sea: &Sea) {
        let m = &self.motion;
        for (place, c) in self.after.places.iter_mut().zip(&self.hull.centres) {
            *place = (m.position + m.attitude * c).xy();
        }
        let depth = 0.5 * self.hull.draft;
        sea.sample(t, &self.after.places, depth, &mut self.after.samples);
        for s in &mut self.after.samples {
            s.velocity.x *= self.coupling;
            s.velocity.y *= self.coupling;
            s.acceleration.x *= self.coupling;
            s.acceleration.y *= self.coupling;
        }
        self.after.time = t;
    }

    /// Classical Runge-Kutta step of `h` seconds, starting at the fraction `f` of the water's interval.
    fn runge_kutta(&mut self, h: f64, f: f64, df: f64) {
        let start = self.motion;
        // The first stage repeats the derivative at the end of the last step, with the same water and thrust.
        let a1 = if f == 0.0 {
            self.nu_dot
        } else {
            self.acceleration(&start, f)
        };
        let k1 = (world_rates(&start), a1);
        let at = |k: &((Vector3<f64>, Quaternion<f64>), Vector6<f64>), dt: f64| Motion {
            position: start.position + k.0.0 * dt,
            attitude: UnitQuaternion::new_normalize(start.attitude.into_inner() + k.0.1 * dt),
            nu: start.nu + k.1 * dt,
        };
        let m2 = at(&k1, 0.5 * h);
        let k2 = (world_rates(&m2), self.acceleration(&m2, f + 0.5 * df));
        let m3 = at(&k2, 0.5 * h);
        let k3 = (world_rates(&m3), self.acceleration(&m3, f + 0.5 * df));
        let m4 = at(&k3, h);
        let k4 = (world_rates(&m4), self.acceleration(&m4, f + df));
        let mean = (
            (
                (k1.0.0 + (k2.0.0 + k3.0.0) * 2.0 + k4.0.0) / 6.0,
                (k1.0.1 + (k2.0.1 + k3.0.1) * 2.0 + k4.0.1) / 6.0,
            ),
            (k1.1 + (k2.1 + k3.1) * 2.0 + k4.1) / 6.0,
        );
        self.motion = at(&mean, h);
    }

    /// `nu'` of a motion, at the fraction `f` of the water's interval.
    fn acceleration(&self, m: &Motion, f: f64) -> Vector6<f64> {
        let r = m.attitude.to_rotation_matrix();
        let down = r.inverse() * Vector3::z();
        let w = tail(&m.nu);
        let n = self.hull.centres.len() as f64;

        let mut pressure = Vector6::zeros();
        let mut volume_sum = 0.0;
        // Sums for the water's mean velocity and acceleration over the hulls, body frame.
        let mut u_sum = Vector3::zeros();
        let mut a_sum = Vector3::zeros();
        let mut u_turn = Vector3::zeros();
        let mut a_turn = Vector3::zeros();
        let mut arms = Vector3::<f64>::zeros();
        for (i, c) in self.hull.centres.iter().enumerate() {
            let centre = m.position + r * c;
            let s0 = &self.before.samples[i];
            let s1 = &self.after.samples[i];
            let mix = |a: f64, b: f64| a + (b - a) * f;
            let slope = s0.slope + (s1.slope - s0.slope) * f;
            let place = self.before.places[i] + (self.after.places[i] - self.before.places[i]) * f;
            let surface = mix(s0.elevation_m, s1.elevation_m) + slope.dot(&(centre.xy() - place));
            // Depth of the circle's centre along the surface's normal; adding the radius gives that of the
            // lowest point.
            let normal_fraction = 1.0 / (1.0 + slope.norm_squared()).sqrt();
            let depth = (centre.z + surface) * normal_fraction;
            let (area, lever_arm) = segment(self.hull.radius, depth + self.hull.radius);
            let volume = area * self.hull.section_length;
            volume_sum += volume;

            let u = r.inverse() * (s0.velocity + (s1.velocity - s0.velocity) * f);
            let a = r.inverse() * (s0.acceleration + (s1.acceleration - s0.acceleration) * f);
            let force = (a - down * GRAVITY) * (WATER_DENSITY * volume);
            // The centroid lies opposite to the surface's normal, relative to the circle's centre.
            let normal = r.inverse() * Vector3::new(slope.x, slope.y, 1.0) * normal_fraction;
            let centroid = c + normal * lever_arm;
            pressure += join(force, centroid.cross(&force));

            u_sum += u;
            a_sum += a;
            // Least-squares fit of w = p y - q x and of (u, v) = (-r y, r x).
            u_turn += Vector3::new(c.y * u.z, -c.x * u.z, c.x * u.y - c.y * u.x);
            a_turn += Vector3::new(c.y * a.z, -c.x * a.z, c.x * a.y - c.y * a.x);
            arms += Vector3::new(c.y * c.y, c.x * c.x, c.x * c.x + c.y * c.y);
        }
        let nu_w = join(u_sum / n, u_turn.component_div(&arms));
        let nu_w_dot = join(a_sum / n - w.cross(&(u_sum / n)), a_turn.component_div(&arms));
        let nu_r = m.nu - nu_w;

        let weight = down * self.weight;
        let gravity = join(weight, self.centre_of_gravity.cross(&weight));
        let [surge, sway, yaw] = self.steering.into();
        let engines = Vector6::new(surge, sway, 0.0, 0.0, 0.0, yaw);
        // Hulls that leave the water lose added mass and drag, in proportion to the submerged volume below
        // half of that at rest. With full added mass, the boat could not fall off a steep crest.
        let wet = (2.0 * volume_sum / self.hull.rest_volume).min(1.0);
        let from_water = self.added_mass * nu_w_dot
            - coriolis(&self.added_mass, &nu_r)
            - nu_r.component_mul(&self.linear_drag)
            - nu_r
                .component_mul(&nu_r.abs())
                .component_mul(&self.quadratic_drag);
        let total = pressure + gravity + engines + self.pushing - coriolis(&self.rigid_mass, &m.nu)
            + from_water * wet;
        if wet < 1.0 {
            let mass = self.rigid_mass + self.added_mass * wet;
            if let Some(l) = mass.cholesky() {
                return l.solve(&total);
            }
        }
        self.inverse_mass * total
    }
}

/// Velocity in NED, and the quaternion's derivative `q' = q (0, w) / 2`.
fn world_rates(m: &Motion) -> (Vector3<f64>, Quaternion<f64>) {
    let w = tail(&m.nu);
    (
        m.attitude * head(&m.nu),
        m.attitude.into_inner() * Quaternion::from_imag(w) * 0.5,
    )
}

/// Attitude parallel to the surface with this heading, rad.
fn level(water: &WaterSample, heading: f64) -> UnitQuaternion<f64> {
    let (s, c) = heading.sin_cos();
    // A surface that rises ahead pitches the bow up; one that rises to starboard rolls to port.
    let ahead = water.slope.x * c + water.slope.y * s;
    let right = -water.slope.x * s + water.slope.y * c;
    let pitch = ahead.atan();
    let roll = -(right * pitch.cos()).atan();
    UnitQuaternion::from_euler_angles(roll, pitch, heading)
}

#[cfg(test)]
mod tests;

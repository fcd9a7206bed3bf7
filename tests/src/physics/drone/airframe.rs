//! Rotors, drag, ground effect, and equations of motion in free air.

use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use super::{
    config::AirframeConfig,
    frame::{MAX_ROTORS, RotorFrame},
};
use crate::physics::streams::Streams;

/// State of the centre of mass in double precision, NED and FRD, SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AirframeMotion {
    pub(crate) position: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
    /// Rotation NED from body.
    pub(crate) attitude: UnitQuaternion<f64>,
    pub(crate) rates: Vector3<f64>,
}

impl AirframeMotion {
    /// Position of the body-fixed point `lever_arm`, NED.
    pub(crate) fn point(&self, lever_arm: &Vector3<f64>) -> Vector3<f64> {
        self.position + self.attitude * lever_arm
    }
    /// Velocity of the body-fixed point `lever_arm`, NED.
    pub(crate) fn point_velocity(&self, lever_arm: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.attitude * self.rates.cross(lever_arm)
    }
    /// Motion after `dt` at constant linear (NED) and angular (body) acceleration; second order in position
    /// and attitude.
    pub(crate) fn advanced(&self, a: &Vector3<f64>, dw: &Vector3<f64>, dt: f64) -> AirframeMotion {
        let turn = (self.rates + dw * (0.5 * dt)) * dt;
        let mut attitude = self.attitude * UnitQuaternion::from_scaled_axis(turn);
        attitude.renormalize_fast();
        AirframeMotion {
            position: self.position + self.velocity * dt + a * (0.5 * dt * dt),
            velocity: self.velocity + a * dt,
            attitude,
            rates: self.rates + dw * dt,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Airframe {
    pub(crate) mass: f64,
    pub(crate) inertia: Vector3<f64>,
    /// Maximum thrust of a rotor, N.
    pub(crate) rotor_max: f64,
    frame: RotorFrame,
    hubs: Vec<Vector3<f64>>,
    moment_per_force: f64,
    idle: f64,
    lag: f64,
    drag: f64,
    parked_drag: f64,
    radius: f64,
    deck_half: [f64; 2],
    /// Rotor speeds as fractions of the maximum.
    speeds: [f64; MAX_ROTORS],
}

impl Airframe {
    pub(crate) fn new(
        config: &AirframeConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        streams: &Streams,
    ) -> Self {
        let mut rng = streams.stream("drone.airframe");
        let mut factor = |bound: f64| 1.0 + bound * (2.0 * rng.random::<f64>() - 1.0);
        let heavier = config.mass_factor * factor(config.mass_error);
        let stronger = config.thrust_factor * factor(config.thrust_error);
        let d = drone.arm_m / 2.0_f64.sqrt();
        Airframe {
            mass: drone.mass_kg * heavier,
            inertia: Vector3::from(drone.inertia_kgm2) * heavier,
            rotor_max: drone.max_thrust_n * stronger / config.frame.count() as f64,
            frame: config.frame,
            hubs: (config.frame.rotors().iter())
                .map(|[x, y, _]| Vector3::new(x * d, y * d, -config.rotor_above_m))
                .collect(),
            moment_per_force: drone.moment_per_force_m,
            idle: config.idle_thrust,
            lag: config.rotor_lag_s,
            drag: config.drag_n_per_mps2,
            parked_drag: config.parked_drag_n_per_mps2,
            radius: config.rotor_radius_m,
            deck_half: [0.5 * deck.length_m, 0.5 * deck.width_m],
            speeds: [0.0; MAX_ROTORS],
        }
    }

    /// Collective thrust for hovering in still air, as a fraction of the true maximum.
    pub(crate) fn hover(&self) -> f64 {
        self.mass * GRAVITY / (self.rotor_max * self.hubs.len() as f64)
    }
    /// Current collective thrust, as a fraction of the true maximum.
    pub(crate) fn thrust(&self) -> f64 {
        self.speeds.iter().map(|s| s * s).sum::<f64>() / self.hubs.len() as f64
    }
    /// Sets rotors to hover speed.
    pub(crate) fn spin_up(&mut self) {
        let hover = self.hover().min(1.0).sqrt();
        self.speeds[..self.hubs.len()].fill(hover);
    }
    pub(crate) fn stand_still(&mut self) {
        self.speeds = [0.0; MAX_ROTORS];
    }
    pub(crate) fn hubs(&self) -> &[Vector3<f64>] {
        &self.hubs
    }

    /// Applies rotor commands (fractions of the maximum thrust; None: stopped) for `dt`: `T ~ n²` and `dn/dt
    /// = (n_c - n) / lag`, integrated exactly.
    pub(crate) fn spin(&mut self, command: Option<&[f64; MAX_ROTORS]>, dt: f64) {
        let keep = (-dt / self.lag).exp();
        for (i, speed) in self.speeds.iter_mut().take(self.hubs.len()).enumerate() {
            let wanted = command.map_or(0.0, |c| c[i].clamp(self.idle, 1.0).sqrt());
            *speed = wanted + (*speed - wanted) * keep;
        }
    }

    /// Drag coefficient, N/(m/s)²: sum of the body's and the rotors'. The rotors' share reaches its full
    /// value at idle speed.
    fn drag(&self) -> f64 {
        let turning = (self.thrust() / self.idle.max(1e-4)).min(1.0).sqrt();
        self.parked_drag + (self.drag - self.parked_drag) * turning
    }

    /// Force without gravity (NED, N), and moment about the centre of mass (body, N m). `deck` is the centre
    /// of the deck's surface and the rotation NED from deck.
    pub(crate) fn loads(
        &self,
        m: &AirframeMotion,
        wind: &Vector3<f64>,
        deck: Option<(&Vector3<f64>, &UnitQuaternion<f64>)>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let mut lift = 0.0;
        let mut moment = Vector3::zeros();
        for ((speed, hub), [_, _, sense]) in self.speeds.iter().zip(&self.hubs).zip(self.frame.rotors()) {
            let mut thrust = self.rotor_max * speed * speed;
            if let Some((centre, turn)) = deck {
                thrust *= self.ground_effect(&m.point(hub), &m.attitude, centre, turn);
            }
            lift += thrust;
            // `r x (0, 0, -T)`, plus the rotor's drag moment.
            moment += Vector3::new(
                -hub.y * thrust,
                hub.x * thrust,
                sense * self.moment_per_force * thrust,
            );
        }
        let air = m.velocity - wind;
        let force = m.attitude * Vector3::new(0.0, 0.0, -lift) - air * (self.drag() * air.norm());
        (force, moment)
    }

    /// Thrust near the deck relative to free air at equal power, `1 / (1 - (R / 4z)²)` (Cheeseman and Bennett 1955, eq.
    /// 8), where z is the distance along the rotor's axis to the surface, z >= R/2; 1 if the axis misses the deck.
    fn ground_effect(
        &self,
        hub: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
        centre: &Vector3<f64>,
        turn: &UnitQuaternion<f64>,
    ) -> f64 {
        let from = turn.inverse_transform_vector(&(hub - centre));
        let axis = turn.inverse_transform_vector(&(attitude * Vector3::z()));
        if from.z >= 0.0 || axis.z < 0.3 || self.radius <= 0.0 {
            return 1.0;
        }
        let z = -from.z / axis.z;
        let hit = from + axis * z;
        if hit.x.abs() > self.deck_half[0] || hit.y.abs() > self.deck_half[1] {
            return 1.0;
        }
        let ratio = self.radius / (4.0 * z.max(0.5 * self.radius));
        1.0 / (1.0 - ratio * ratio)
    }

    /// Linear (NED) and angular (body) acceleration over `dt`: `dv = F/m + g`, and Euler's `dw = J^-1 (tau -
    /// w x J w)` by the midpoint rule.
    pub(crate) fn accelerations(
        &self,
        m: &AirframeMotion,
        force: &Vector3<f64>,
        moment: &Vector3<f64>,
        dt: f64,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let euler = |w: &Vector3<f64>| {
            let gyroscopic = w.cross(&self.inertia.component_mul(w));
            (moment - gyroscopic).component_div(&self.inertia)
        };
        let half = m.rates + euler(&m.rates) * (0.5 * dt);
        (force / self.mass + Vector3::z() * GRAVITY, euler(&half))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn airframe(seed: u64) -> Airframe {
        Airframe::new(
            &AirframeConfig::default(),
            &DroneGeometry::default(),
            &DeckGeometry::default(),
            &Streams::new(seed),
        )
    }
    fn at(height: f64) -> AirframeMotion {
        AirframeMotion {
            position: Vector3::new(0.0, 0.0, -height),
            velocity: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            rates: Vector3::zeros(),
        }
    }

    #[test]
    fn rotor_moment_signs() {
        let mut a = airframe(1);
        let moment = |a: &mut Airframe, [a1, a2, a3, a4]: [f64; 4]| {
            a.spin(Some(&[a1, a2, a3, a4, 0.0, 0.0]), 10.0);
            a.loads(&at(10.0), &Vector3::zeros(), None).1
        };
        // More lift on the left rolls right; more lift at the front pitches up.
        assert!(moment(&mut a, [0.3, 0.4, 0.4, 0.3]).x > 0.1);
        assert!(moment(&mut a, [0.4, 0.3, 0.4, 0.3]).y > 0.1);
        assert!(moment(&mut a, [0.4, 0.4, 0.3, 0.3]).z > 0.01);
        assert!(moment(&mut a, [0.3; 4]).norm() < 1e-12);
    }

    #[test]
    fn hover_thrust_and_drawn_errors() {
        let mut masses = Vec::new();
        for seed in 0..50 {
            let mut a = airframe(seed);
            a.spin_up();
            let m = at(10.0);
            let (f, tau) = a.loads(&m, &Vector3::zeros(), None);
            let (dv, dw) = a.accelerations(&m, &f, &tau, 0.002);
            assert!(dv.norm() < 1e-9 && dw.norm() < 1e-9, "{dv} {dw}");
            assert!((a.mass / 3.5 - 1.0).abs() <= 0.05);
            masses.push(a.mass);
        }
        let spread = masses.iter().copied().fold(0.0, f64::max) - masses.iter().copied().fold(9.0, f64::min);
        assert!(spread > 0.2, "{spread}");
    }

    #[test]
    fn ground_effect_of_cheeseman_and_bennett() {
        let mut a = airframe(3);
        a.spin_up();
        let centre = Vector3::zeros();
        let turn = UnitQuaternion::identity();
        let lift = |m: &AirframeMotion| -a.loads(m, &Vector3::zeros(), Some((&centre, &turn))).0.z;
        let free = a.mass * GRAVITY;
        // The rotor plane is 0.05 m above the centre of mass.
        let z: f64 = 0.35;
        let expected = 1.0 / (1.0 - (0.19 / (4.0 * z)).powi(2));
        assert!((lift(&at(0.30)) / free - expected).abs() < 1e-9);
        let mut off_deck = at(0.30);
        off_deck.position.y = 1.5;
        assert!((lift(&off_deck) / free - 1.0).abs() < 1e-12);
        assert!(lift(&at(5.0)) / free - 1.0 < 1e-3);
    }

    #[test]
    fn drag_with_and_without_rotors() {
        let mut a = airframe(6);
        let c = AirframeConfig::default();
        let wind = Vector3::new(10.0, 0.0, 0.0);
        let drag = |a: &Airframe| a.loads(&at(10.0), &wind, None).0.x / 100.0;
        assert!((drag(&a) - c.parked_drag_n_per_mps2).abs() < 1e-12);
        a.spin(Some(&[0.0; MAX_ROTORS]), 10.0);
        assert!(
            (drag(&a) - c.drag_n_per_mps2).abs() < 1e-9,
            "at idle: {}",
            drag(&a)
        );
        a.spin_up();
        assert_eq!(a.drag().to_bits(), c.drag_n_per_mps2.to_bits());
    }

    #[test]
    fn rotor_speed_lag() {
        let mut a = airframe(4);
        a.spin(Some(&[0.25; MAX_ROTORS]), 10.0);
        for _ in 0..15 {
            a.spin(Some(&[1.0; MAX_ROTORS]), 0.002);
        }
        // Speed rises from 0.5 to 1 - 0.5/e after one time constant of 0.03 s.
        let speed = a.thrust().sqrt();
        assert!(
            (speed - (1.0 - 0.5 / core::f64::consts::E)).abs() < 1e-9,
            "{speed}"
        );
    }

    #[test]
    fn torque_free_tumbling() {
        let mut a = airframe(5);
        a.inertia = Vector3::new(0.09, 0.13, 0.19);
        let mut m = at(100.0);
        m.rates = Vector3::new(0.3, 4.0, 0.2);
        let invariants = |m: &AirframeMotion| {
            let l = a.inertia.component_mul(&m.rates);
            (0.5 * m.rates.dot(&l), m.attitude * l)
        };
        let before = invariants(&m);
        for _ in 0..5000 {
            let (_, dw) = a.accelerations(&m, &Vector3::zeros(), &Vector3::zeros(), 0.002);
            m = m.advanced(&Vector3::zeros(), &dw, 0.002);
        }
        let after = invariants(&m);
        assert!(
            (after.0 / before.0 - 1.0).abs() < 1e-3,
            "{} {}",
            before.0,
            after.0
        );
        assert!(
            (after.1 - before.1).norm() / before.1.norm() < 0.05,
            "{:?} {:?}",
            before,
            after
        );
    }
}

//! Contact of the drone with the deck, solved by rapier3d.
//!
//! Free flight is integrated in double precision. Rapier runs only near the deck; its result is used only in sub-steps
//! in which a contact carries an impulse or the deck holds a foot. Rapier's frame has its origin at the deck's centre
//! and translates with it during a sub-step, so that the deck only rotates and single precision resolves micrometres.

use alight_shared::{
    frames::{Deck, Point},
    geometry::{DeckGeometry, DroneGeometry},
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rapier3d::prelude::{
    ColliderBuilder, ColliderHandle, FrictionModel, MassProperties, PhysicsWorld, RigidBodyBuilder,
    RigidBodyHandle,
};

use super::{
    airframe::{Airframe, AirframeMotion},
    config::ContactConfig,
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// 0 front right, 1 rear left, 2 front left, 3 rear right.
    Foot(usize),
    /// End of an arm at the rotor, numbered like the feet.
    Arm(usize),
    Body,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    pub part: Part,
    /// Approach speed along the deck's normal before the impact, m/s.
    pub normal_mps: f64,
    /// Relative speed along the deck before the impact, m/s.
    pub tangential_mps: f64,
    /// Point of impact, deck frame, m.
    pub position: Point<Deck>,
}

/// The deck's surface in a sub-step, NED, SI units: centre of the upper surface and rotation NED from deck at
/// the start, and the velocities over the sub-step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeckSpan {
    pub(crate) centre: Vector3<f64>,
    pub(crate) turn: UnitQuaternion<f64>,
    pub(crate) velocity: Vector3<f64>,
    pub(crate) spin: Vector3<f64>,
}

impl DeckSpan {
    fn point_velocity(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.spin.cross(&(at - self.centre))
    }
}

type V = rapier3d::math::Vector;
type Pose = rapier3d::math::Pose;
type Turn = rapier3d::math::Rotation;

fn to_rapier(v: &Vector3<f64>) -> V {
    V::new(v.x as f32, v.y as f32, v.z as f32)
}
fn from_rapier(v: V) -> Vector3<f64> {
    Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}
fn pose(position: &Vector3<f64>, q: &UnitQuaternion<f64>) -> Pose {
    let turn = Turn::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32);
    Pose::from_parts(to_rapier(position), turn.normalize())
}

struct PartContact {
    part: Part,
    collider: ColliderHandle,
    /// Centre in the body frame, and radius, m.
    offset: Vector3<f64>,
    radius: f64,
    /// Sub-steps since the last impulse.
    idle: u32,
}

pub(crate) struct GearContact {
    world: PhysicsWorld,
    drone: RigidBodyHandle,
    deck: RigidBodyHandle,
    surface: ColliderHandle,
    parts: Vec<PartContact>,
    half: Vector3<f64>,
    reach: f64,
    mass: f64,
    inertia: Vector3<f64>,
    /// Force that holds each foot down, N.
    holds: [f64; 4],
}

/// Sub-steps (10 ms) for which a part counts as touching after its last impulse: a resting foot's impulse may
/// vanish for single sub-steps.
const HOLD_STEPS: u32 = 5;
/// Maximum speed at which a renewed contact counts as the same contact, m/s.
const RENEWED_MPS: f64 = 0.05;
/// Radius of the arm's end (motor), m. Chosen.
const ARM_RADIUS_M: f64 = 0.03;
/// Signs of the feet's positions, forward and right: front right, rear left, front left, rear right.
const FEET: [[f64; 2]; 4] = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];
/// Half extents of the body, m. Source: the T650's body is 0.15 m high (ctu-mrs t650). Chosen: length and width.
const BODY_HALF_M: [f64; 3] = [0.12, 0.12, 0.075];

/// World without gravity, which is part of the loads.
fn empty_world() -> PhysicsWorld {
    let mut world = PhysicsWorld::new();
    world.gravity = V::new(0.0, 0.0, 0.0);
    let p = &mut world.integration_parameters;
    p.length_unit = 0.1;
    p.contact_clustering = false;
    p.contact_recycling = false;
    p.num_solver_iterations = 4;
    p.friction_model = FrictionModel::Coulomb;
    world
}

fn drone_body(airframe: &Airframe) -> RigidBodyBuilder {
    let mass = MassProperties::new(
        V::new(0.0, 0.0, 0.0),
        airframe.mass as f32,
        to_rapier(&airframe.inertia),
    );
    RigidBodyBuilder::dynamic()
        .additional_mass_properties(mass)
        .can_sleep(false)
        .gyroscopic_forces_enabled(false)
}

impl GearContact {
    pub(crate) fn new(
        config: &ContactConfig,
        airframe: &Airframe,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
    ) -> Self {
        let mut world = empty_world();
        let body = world.insert_body(drone_body(airframe));
        let finish = |c: ColliderBuilder| {
            c.density(0.0)
                .friction(config.friction as f32)
                .restitution(config.restitution as f32)
        };
        let mut parts = Vec::new();
        let mut add = |part, offset: Vector3<f64>, radius: f64, shape: ColliderBuilder| {
            let shape = finish(shape).translation(to_rapier(&offset));
            let collider = world.colliders.insert_with_parent(shape, body, &mut world.bodies);
            parts.push(PartContact {
                part,
                collider,
                offset,
                radius,
                idle: u32::MAX,
            });
        };
        let r = config.foot_radius_m;
        let [length, width] = drone.feet_span_m;
        for (i, [x, y]) in FEET.into_iter().enumerate() {
            let offset = Vector3::new(0.5 * x * length, 0.5 * y * width, drone.feet_below_m - r);
            add(Part::Foot(i), offset, r, ColliderBuilder::ball(r as f32));
        }
        for (i, hub) in airframe.hubs().iter().enumerate() {
            add(
                Part::Arm(i),
                *hub,
                ARM_RADIUS_M,
                ColliderBuilder::ball(ARM_RADIUS_M as f32),
            );
        }
        let [hx, hy, hz] = BODY_HALF_M.map(|h| h as f32);
        add(
            Part::Body,
            Vector3::zeros(),
            0.0,
            ColliderBuilder::cuboid(hx, hy, hz),
        );

        let half = Vector3::new(deck.length_m, deck.width_m, config.deck_thickness_m) * 0.5;
        let hold_per_foot = deck.hold_n / FEET.len() as f64;
        let (deck, surface) = world.insert(
            RigidBodyBuilder::kinematic_velocity_based(),
            finish(ColliderBuilder::cuboid(
                half.x as f32,
                half.y as f32,
                half.z as f32,
            )),
        );
        let reach = parts
            .iter()
            .map(|t| t.offset.norm() + t.radius)
            .fold(0.2, f64::max);
        GearContact {
            world,
            drone: body,
            deck,
            surface,
            parts,
            half,
            reach,
            mass: airframe.mass,
            inertia: airframe.inertia,
            holds: [hold_per_foot; 4],
        }
    }

    /// Holds a foot to the deck with this force, N.
    pub(crate) fn snag(&mut self, foot: usize, newton: f64) {
        for h in self.holds.iter_mut().skip(foot).take(1) {
            *h = newton;
        }
    }

    /// Force and moment about the centre of mass that hold touching feet to the deck, NED. The force acts
    /// along the deck's normal and increases the normal force and thereby the friction (Coulomb). It ends
    /// when a larger force pulls the foot off.
    fn hold(&self, before: &AirframeMotion, deck: &DeckSpan) -> (Vector3<f64>, Vector3<f64>) {
        let down = deck.turn * Vector3::z();
        let held = self.parts.iter().filter(|t| t.idle <= HOLD_STEPS);
        held.fold(Default::default(), |(force, moment), t| {
            let Part::Foot(k) = t.part else {
                return (force, moment);
            };
            let pull = down * self.holds.get(k).copied().unwrap_or(0.0);
            (force + pull, moment + (before.attitude * t.offset).cross(&pull))
        })
    }

    /// Distance from the deck's box to a sphere at `position` that encloses all parts, m; negative: overlap.
    pub(crate) fn distance(&self, position: &Vector3<f64>, deck: &DeckSpan) -> f64 {
        let p = deck.turn.inverse_transform_vector(&(position - deck.centre));
        let outside = Vector3::new(
            p.x.abs() - self.half.x,
            p.y.abs() - self.half.y,
            (p.z - self.half.z).abs() - self.half.z,
        );
        outside.map(|d| d.max(0.0)).norm() - self.reach
    }

    pub(crate) fn away(&mut self) {
        for t in &mut self.parts {
            t.idle = t.idle.saturating_add(1);
        }
    }

    /// Solves a sub-step of `dt` from `before`; `dv` and `dw` (NED, body) are changes caused by forces other
    /// than contact. Returns the final motion if a contact carried an impulse or the deck holds a foot.
    /// Appends new impacts to `impacts`.
    pub(crate) fn step(
        &mut self,
        before: &AirframeMotion,
        dv: &Vector3<f64>,
        dw: &Vector3<f64>,
        deck: &DeckSpan,
        dt: f64,
        impacts: &mut Vec<Impact>,
    ) -> Option<AirframeMotion> {
        // Applied as a force, the load is distributed over rapier's sub-steps and balanced by the stored
        // friction impulse.
        let (hold, hold_moment) = self.hold(before, deck);
        let force = dv * (self.mass / dt) + hold;
        let moment = before.attitude * dw.component_mul(&self.inertia) / dt + hold_moment;
        if let Some(b) = self.world.bodies.get_mut(self.deck) {
            // Rapier needs the velocity of the box's centre.
            let middle = deck.turn * Vector3::new(0.0, 0.0, self.half.z);
            b.set_position(pose(&middle, &deck.turn), true);
            b.set_linvel(to_rapier(&deck.spin.cross(&middle)), true);
            b.set_angvel(to_rapier(&deck.spin), true);
        }
        if let Some(b) = self.world.bodies.get_mut(self.drone) {
            b.set_position(pose(&(before.position - deck.centre), &before.attitude), true);
            b.set_linvel(to_rapier(&(before.velocity - deck.velocity)), true);
            b.set_angvel(to_rapier(&(before.attitude * before.rates)), true);
            b.reset_forces(true);
            b.reset_torques(true);
            b.add_force(to_rapier(&force), true);
            b.add_torque(to_rapier(&moment), true);
        }
        self.world.integration_parameters.dt = dt as f32;
        self.world.step();

        let mut touched = hold != Vector3::zeros();
        for t in &mut self.parts {
            let pair = self.world.narrow_phase.contact_pair(t.collider, self.surface);
            let pushed = pair.and_then(|p| {
                let (impulse, normal) = p.max_impulse();
                let sign = if p.collider1 == self.surface { 1.0 } else { -1.0 };
                (impulse > 0.0).then(|| from_rapier(normal) * sign)
            });
            let Some(normal) = pushed else {
                t.idle = t.idle.saturating_add(1);
                continue;
            };
            touched = true;
            // The part's deepest point in the deck, and its velocity before the contact in this sub-step.
            let offset = t.offset - before.attitude.inverse_transform_vector(&normal) * t.radius;
            let at = before.point(&offset);
            let relative = before.point_velocity(&offset) + dv * 0.5 - deck.point_velocity(&at);
            let approach = -relative.dot(&normal);
            if t.idle > HOLD_STEPS || (t.idle > 0 && approach > RENEWED_MPS) {
                impacts.push(Impact {
                    part: t.part,
                    normal_mps: approach.max(0.0),
                    tangential_mps: (relative + normal * approach).norm(),
                    position: Point::from(deck.turn.inverse_transform_vector(&(at - deck.centre))),
                });
            }
            t.idle = 0;
        }
        if !touched {
            return None;
        }
        let after = self.raw(deck, dt);
        let finite = after
            .position
            .iter()
            .chain(after.velocity.iter())
            .chain(after.rates.iter());
        finite.copied().all(f64::is_finite).then_some(after)
    }

    /// Motion that rapier computed in a sub-step.
    pub(crate) fn raw(&self, deck: &DeckSpan, dt: f64) -> AirframeMotion {
        let b = &self.world.bodies[self.drone];
        let q = b.rotation();
        let attitude = UnitQuaternion::from_quaternion(Quaternion::new(
            f64::from(q.w),
            f64::from(q.x),
            f64::from(q.y),
            f64::from(q.z),
        ));
        AirframeMotion {
            position: deck.centre + deck.velocity * dt + from_rapier(b.translation()),
            velocity: deck.velocity + from_rapier(b.linvel()),
            attitude,
            rates: attitude.inverse_transform_vector(&from_rapier(b.angvel())),
        }
    }

    pub(crate) fn feet(&self) -> [bool; 4] {
        let mut feet = [false; 4];
        for t in &self.parts {
            if let (Part::Foot(i), true) = (t.part, t.idle <= HOLD_STEPS) {
                feet[i] = true;
            }
        }
        feet
    }
    /// Whether a part other than a foot touches.
    pub(crate) fn other(&self) -> bool {
        self.parts
            .iter()
            .any(|t| t.idle <= HOLD_STEPS && !matches!(t.part, Part::Foot(_)))
    }
    pub(crate) fn soles(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        self.parts
            .iter()
            .filter(|t| matches!(t.part, Part::Foot(_)))
            .map(|t| t.offset + Vector3::z() * t.radius)
    }
}

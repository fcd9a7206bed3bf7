//! Descent without a plan, or with an outdated plan.

use alight_shared::{
    geometry::{DroneGeometry, GRAVITY},
    msg::PlanStage,
};
use nalgebra::Vector3;

use super::{
    below::{Body, DeckBelow},
    climb::Climb,
};
use crate::flatness::attitude_of_thrust;

/// Speed of a soft contact relative to the deck, m/s: that of the mission's flare.
pub(crate) const SINK_MPS: f64 = 0.5;
/// Deceleration that limits the contact speed, m/s², and that speed, m/s. The plan brakes at 2.5 m/s² to 0.28 m/s; a
/// foot that touches the deck at 0.6 m/s rotates the opposite foot onto it at 0.9 m/s.
const BRAKING_MPS2: f64 = 3.0;
const FAST_MPS: f64 = 0.35;
/// Speed to which a faster drone is braked, m/s.
const BRAKED_MPS: f64 = 0.25;
/// Time in which a drone rotates to the deck's attitude, s, and horizontal fraction of thrust that is negligible.
const TURN_S: f64 = 0.15;
const MIN_TILT: f64 = 0.02;
/// Time before contact at which braking must be finished, with or without a plan, s.
const SOFT_S: f64 = 0.2;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Completion<'a> {
    pub(crate) body: &'a Body,
    pub(crate) below: &'a DeckBelow,
    pub(crate) drone: &'a DroneGeometry,
    /// Clearance below which the drone aligns with the deck, m.
    pub(crate) aligns_below_m: f64,
}

impl Completion<'_> {
    /// Stage of a landing without a plan: constant braking to a soft contact, at first level and then aligned.
    pub(crate) fn stage(&self) -> PlanStage {
        let body = self.body;
        let below = self.below;
        let up = below.stage.normal();
        let sinks = -below.normal_speed;
        let climb = Climb::new(body.position.z, body.velocity.z, self.drone);
        let braking = climb.braking(sinks, below.clearance - SOFT_S * SINK_MPS, SINK_MPS);
        let mut stage = PlanStage {
            position: body.position.into(),
            velocity: (Vector3::from(below.stage.velocity) - up * SINK_MPS.max(sinks)).into(),
            acceleration: (Vector3::from(below.stage.acceleration) + up * braking).into(),
            euler: [0.0, 0.0, body.yaw()],
            euler_rates: [0.0; 3],
        };
        self.align(&mut stage);
        stage
    }

    /// Vertical acceleration (NED, m/s²) that brakes a drone too fast for a soft contact; None while there is still
    /// enough height to brake later. With the speed `v` towards the deck and the height `h` at the time when the thrust
    /// acts, which is `lag_s` later, it applies if
    ///
    /// `v² > v_t² + 2 a (h - v lag)`, where `a` is at most the rotors' margin over a deck that accelerates upwards.
    pub(crate) fn reflex(&self, lag_s: f64) -> Option<f64> {
        let body = self.body;
        let below = self.below;
        let climb = Climb::new(body.position.z, body.velocity.z, self.drone);
        let sinks = (-below.normal_speed).max(0.0);
        let deck = below.stage.acceleration[2];
        let a = (climb.acceleration_mps2() + deck).clamp(0.0, BRAKING_MPS2);
        let left = below.clearance - sinks * lag_s;
        if sinks.powi(2) <= FAST_MPS.powi(2) + 2.0 * a * left.max(0.0) {
            return None;
        }
        let braking = climb.braking(sinks, left - SOFT_S * BRAKED_MPS, BRAKED_MPS);
        let until_s = 2.0 * left.max(0.0) / (sinks + BRAKED_MPS);
        let braking = braking.min(self.shared_braking(sinks, until_s)).max(0.0);
        Some(deck + below.stage.normal().z * braking)
    }

    /// Deceleration `b`, m/s², from the speed `sinks` over `until_s`, that makes the speeds along the deck and towards
    /// it equal at contact. A tilted drone rotates within `T`; its thrust has a horizontal component of the fraction
    /// `t` of the vertical one and so accelerates along the deck. With the speed `v` in that direction and the deck's
    /// accelerations `d` downwards and `e` along:
    ///
    /// `v + (t (g - d + b) - e) T = sinks - b until_s`
    fn shared_braking(&self, sinks: f64, until_s: f64) -> f64 {
        let body = self.body;
        let deck = &self.below.stage;
        let up = body.attitude * -Vector3::z();
        let tilt = up.xy() / (-up.z).max(0.5);
        let Some(towards) = tilt.try_normalize(MIN_TILT) else {
            return f64::INFINITY;
        };
        let along = |v: Vector3<f64>| v.xy().dot(&towards);
        let t = tilt.norm();
        let lasts_s = until_s.min(TURN_S);
        let speed = along(body.velocity - Vector3::from(deck.velocity));
        let [.., down] = deck.acceleration;
        let drives = t * (GRAVITY - down) - along(deck.acceleration.into());
        (sinks - speed - drives * lasts_s) / (t * lasts_s + until_s).max(MIN_TILT * TURN_S)
    }

    /// Tilts the attitude of `stage` towards the deck's attitude, more strongly near the deck.
    fn align(&self, stage: &mut PlanStage) {
        let near = 1.0 - (self.below.clearance / self.aligns_below_m).clamp(0.0, 1.0);
        let [roll, pitch, yaw] = stage.euler;
        let deck = attitude_of_thrust(&self.below.stage.normal(), yaw).euler_angles();
        stage.euler = [
            roll + near * (deck.0 - roll),
            pitch + near * (deck.1 - pitch),
            yaw,
        ];
    }

    /// `stage` of an outdated plan with braking and alignment added; None if it sinks no faster than in a soft contact.
    pub(crate) fn renewed(&self, stage: &PlanStage) -> Option<PlanStage> {
        let relative = Vector3::from(stage.velocity) - Vector3::from(self.below.stage.velocity);
        if -relative.dot(&self.below.stage.normal()) <= SINK_MPS {
            return None;
        }
        let own = self.stage();
        let mut stage = *stage;
        stage.position[2] = own.position[2];
        stage.velocity[2] = own.velocity[2];
        stage.acceleration[2] = own.acceleration[2];
        self.align(&mut stage);
        Some(stage)
    }
}

//! Admission of plans, whoever has made them: at every sample of a plan the drone must still be able to brake or climb
//! so that a contact stays within the limits.
//!
//! At each step of the pilot a plan is checked against the airframe ([`within_airframe`]), and the drone that follows it
//! for 0.3 s against deck, obstacles and water ([`brakes`]). The deck is that of the present, propagated by its measured
//! velocity, acceleration and rates; its forecast is not used.

use alight_shared::{
    geometry::{DroneGeometry, GRAVITY},
    landing::{MAX_MPS, MAX_TILT_RAD},
    msg::{DeckStage, MissionState, Phase, Plan, PlanCheck, PlanRefusal, PlanStage},
    time::{DroneTime, Span},
    topics,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::Pilot;
use crate::{
    contingency::{Body, DeckBelow, outside_m, propagated},
    surroundings::{WITH_DECK_M, in_deck},
};

/// Limits of a stage, and of the change between stages: speed, m/s; acceleration downwards, m/s²; tilt, rad; Euler
/// rates, rad/s.
/// Source: above what the own planners plan, below what the airframe cannot follow.
const MAX_SPEED_MPS: f64 = 20.0;
const MAX_DOWN_MPS2: f64 = 7.0;
const MAX_PLANNED_TILT_RAD: f64 = 1.2;
const MAX_RATES_RPS: f64 = 6.0;
/// Maximum difference between plan and drone, m and m/s.
/// Source: 1.1 m and 1.6 m/s in 24 landings by the own planners.
const APART_M: f64 = 2.5;
const APART_MPS: f64 = 2.0;
/// Time constant with which the pilot reduces a difference in vertical velocity between plan and drone, s.
const TRACKS_S: f64 = 0.4;
/// Times ahead that are checked, s; the last is a period of the plans, the link's delay and the attitude's lag.
const AHEAD_S: [f64; 4] = [0.0, 0.1, 0.2, 0.3];
/// Time until the thrust brakes, s; the times ahead include the other delays.
const REACTION_S: f64 = 0.1;
/// Maximum deceleration towards deck and water, m/s², and the usable part of the thrust beyond hover.
const BRAKING_MPS2: f64 = 5.0;
const USABLE: f64 = 0.8;
/// Time in which a drone tilts to brake in front of an obstacle, s, and its deceleration, m/s².
const TILTS_S: f64 = 0.3;
const ASTERN_MPS2: f64 = 3.0;
/// Number of points of the path to the stop that are compared with a volume.
const STOPPING: u32 = 24;
/// Speed of a permitted contact, m/s, with a reserve for errors of estimates and tracking; and closing speed at a
/// surface that must not be touched, which leads to it slowly.
const CONTACT_MPS: f64 = 0.9 * MAX_MPS;
const SLOW_MPS: f64 = 0.3;
/// Rates at which the drone reduces tilt (rad/s), speed along the deck (m/s²) and distance to the deck (m/s) before a
/// contact.
const TURNS_RPS: f64 = 1.0;
const ALONG_MPS2: f64 = 2.5;
const ASIDE_MPS: f64 = 1.0;
/// Clearance that remains without a permitted contact over the deck, m, and the addition beside it, which grows with
/// the distance.
const STOPS_ABOVE_M: f64 = 0.1;
const BESIDE_ABOVE_M: f64 = 1.0;
/// Error of the rangefinder's clearance, m.
const RANGE_ERROR_M: f64 = 0.15;
/// Height below the mission's minimum at which a plan still stops, m.
const BELOW_MINIMUM_M: f64 = 1.0;

fn bounded(check: PlanCheck, value: f64, limit: f64) -> Result<(), PlanRefusal> {
    if value <= limit {
        return Ok(());
    }
    Err(PlanRefusal { check, value, limit })
}

fn within_airframe(plan: &Plan, drone: &DroneGeometry) -> Result<(), PlanRefusal> {
    let mut before = plan.stages.first();
    for stage in plan.stages.iter() {
        let last = before.replace(stage).unwrap_or(stage);
        let rate = |begin: [f64; 3], end: [f64; 3]| {
            (Vector3::from(end) - Vector3::from(begin)).norm() / plan.step.secs()
        };
        let speed = Vector3::from(stage.velocity).norm();
        let thrust = Vector3::from(stage.acceleration) - Vector3::z() * GRAVITY;
        // A drone in free fall accelerates without thrust.
        let accelerates = rate(last.velocity, stage.velocity) - GRAVITY;
        let most_mps2 = drone.max_thrust_n / drone.mass_kg;
        for (check, value, limit) in [
            (
                PlanCheck::Speed,
                speed.max(rate(last.position, stage.position)),
                MAX_SPEED_MPS,
            ),
            (PlanCheck::Acceleration, thrust.norm().max(accelerates), most_mps2),
            (PlanCheck::Acceleration, stage.acceleration[2], MAX_DOWN_MPS2),
            (
                PlanCheck::Tilt,
                up(stage).angle(&-Vector3::z()),
                MAX_PLANNED_TILT_RAD,
            ),
            (
                PlanCheck::Rates,
                Vector3::from(stage.euler_rates).amax(),
                MAX_RATES_RPS,
            ),
        ] {
            bounded(check, value, limit)?;
        }
    }
    Ok(())
}

fn up(stage: &PlanStage) -> Vector3<f64> {
    let [roll, pitch, yaw] = stage.euler;
    UnitQuaternion::from_euler_angles(roll, pitch, yaw) * -Vector3::z()
}

/// Checks whether a drone with the closing speed `s` and the distance `h` can brake at `a` after the time `T` to the
/// speed `v` at a surface: `s² <= v² + 2 a (h - T s)`.
fn brakes(check: PlanCheck, closing: f64, left_m: f64, ends_mps: f64, mps2: f64) -> Result<(), PlanRefusal> {
    let left_m = (left_m - REACTION_S * closing).max(0.0);
    bounded(check, closing, (ends_mps.powi(2) + 2.0 * mps2 * left_m).sqrt())
}

impl Pilot {
    /// Returns the newest plan if it is admitted, otherwise the last admitted one while it is recent and still passes.
    pub(super) fn admitted_plan(
        &mut self,
        now: DroneTime,
        newest: &Plan,
        mission: &MissionState,
        body: &Body,
        below: Option<&DeckBelow>,
    ) -> Option<Plan> {
        let admit = |plan: &Plan| self.admit(now, plan, mission, body, below);
        let recent = |plan: &Plan| now - plan.header.at <= topics::PLAN.stale_after;
        let refusal = admit(newest).err();
        let flown = if refusal.is_none() {
            Some(*newest)
        } else {
            self.admitted.filter(|p| recent(p) && admit(p).is_ok())
        };
        self.refusal = refusal;
        self.admitted = flown;
        flown
    }

    fn admit(
        &self,
        now: DroneTime,
        plan: &Plan,
        mission: &MissionState,
        body: &Body,
        below: Option<&DeckBelow>,
    ) -> Result<(), PlanRefusal> {
        within_airframe(plan, &self.geometry)?;
        bounded(PlanCheck::Start, (plan.header.at - now).secs(), 0.0)?;
        let first = plan.sample(now).unwrap_or_default();
        let offset = body.position - Vector3::from(first.position);
        let drift = body.velocity - Vector3::from(first.velocity);
        bounded(PlanCheck::Position, offset.norm(), APART_M)?;
        bounded(PlanCheck::Velocity, drift.norm(), APART_MPS)?;
        for t in AHEAD_S {
            let mut stage = plan.sample(now + Span::from_secs(t)).unwrap_or(first);
            let position = Vector3::from(stage.position) + offset;
            let mut velocity = Vector3::from(stage.velocity) + drift;
            velocity.z -= drift.z * (1.0 - (-t / TRACKS_S).exp());
            stage.position = position.into();
            stage.velocity = velocity.into();
            let deck = below.map(|b| (b, propagated(&b.measured, t)));
            let aside_m = |d: &DeckStage| (position - Vector3::from(d.position)).xy().norm();
            if let Some((below, deck)) = deck.filter(|(_, d)| aside_m(d) < WITH_DECK_M) {
                self.stops_at_obstacles(&stage, body, &deck, below)?;
                self.brakes_above_deck(now, &stage, body, &deck, below, mission)?;
            } else {
                let left_m = BELOW_MINIMUM_M - position.z - mission.minimum_altitude_m;
                brakes(
                    PlanCheck::Water,
                    velocity.z,
                    left_m,
                    SLOW_MPS,
                    self.braking_mps2(0.0),
                )?;
            }
        }
        Ok(())
    }

    /// Deceleration towards a surface that accelerates downwards at `down_mps2`, m/s².
    fn braking_mps2(&self, down_mps2: f64) -> f64 {
        let surplus = self.geometry.max_thrust_n / self.geometry.mass_kg - GRAVITY;
        (USABLE * surplus + down_mps2).clamp(SLOW_MPS, BRAKING_MPS2)
    }

    /// The refusal has the reason for which the drone must not touch the deck.
    fn brakes_above_deck(
        &self,
        now: DroneTime,
        stage: &PlanStage,
        body: &Body,
        deck: &DeckStage,
        below: &DeckBelow,
        mission: &MissionState,
    ) -> Result<(), PlanRefusal> {
        let drone = &self.geometry;
        let position = Vector3::from(stage.position);
        let velocity = Vector3::from(stage.velocity);
        let up = up(stage);
        let normal = deck.normal();
        let feet = in_deck(deck, &(position - up * drone.feet_below_m));
        let outside = outside_m(&feet.xy(), &self.deck, drone);
        let tilt_error = up
            .angle(&normal)
            .max((body.attitude * -Vector3::z()).angle(&normal));
        let half_span_m = 0.5 * drone.feet_span_m[0].hypot(drone.feet_span_m[1]);
        let mut clearance = deck.height_of(&position) - drone.feet_below_m;
        if outside <= 0.0
            && let Some(range_m) = self.detector.median(now)
        {
            let measured = range_m + drone.rangefinder_m[2] - drone.feet_below_m + RANGE_ERROR_M;
            clearance += (measured - below.clearance).min(0.0);
        }
        // The lowest foot touches first.
        clearance -= half_span_m * tilt_error.sin();
        let closing = -deck.speed_away(&velocity);
        let along = (velocity - Vector3::from(deck.velocity) + normal * closing).norm();
        let left_s = clearance.max(0.0) / closing.max(SLOW_MPS);
        let lands = mission.state.phase() == Phase::Landing && mission.descent_mps > 0.0;
        let forbidden = !lands || mission.lowest_clearance_m.is_some();
        let refused = [
            (PlanCheck::Permission, f64::from(u8::from(forbidden)), 0.0),
            (PlanCheck::Outside, outside, ASIDE_MPS * left_s),
            (
                PlanCheck::Tilted,
                up.angle(&normal),
                MAX_TILT_RAD + TURNS_RPS * left_s,
            ),
            (PlanCheck::Along, along, CONTACT_MPS + ALONG_MPS2 * left_s),
        ];
        let mps2 = self.braking_mps2(deck.acceleration[2]);
        match refused.iter().find(|(_, value, limit)| value > limit) {
            None => brakes(PlanCheck::Deck, closing, clearance, CONTACT_MPS, mps2),
            Some((check, ..)) => {
                let kept_m = STOPS_ABOVE_M + outside.clamp(0.0, BESIDE_ABOVE_M);
                brakes(*check, closing, clearance - kept_m, SLOW_MPS, mps2)
            }
        }
    }

    /// Compares the distance in which the drone stops with that at which it touches a volume, m. A drone that climbs
    /// without a plan accelerates along its tilt, present or commanded, until it is level.
    fn stops_at_obstacles(
        &self,
        stage: &PlanStage,
        body: &Body,
        deck: &DeckStage,
        below: &DeckBelow,
    ) -> Result<(), PlanRefusal> {
        let here = in_deck(deck, &stage.position.into());
        let commanded = self.tracker.commanded().unwrap_or(body.attitude);
        let most_mps2 = self.geometry.max_thrust_n / self.geometry.mass_kg;
        for attitude in [UnitQuaternion::identity(), body.attitude, commanded] {
            let thrown = (attitude * -Vector3::z()).xy() * (most_mps2 * TILTS_S);
            let mut relative = Vector3::from(stage.velocity) - Vector3::from(deck.velocity);
            relative.x += thrown.x;
            relative.y += thrown.y;
            let speed = relative.norm();
            let stops_m = speed * (TILTS_S + speed / (2.0 * ASTERN_MPS2));
            let path = deck.rotation().transpose() * relative * (stops_m / speed.max(1e-6));
            let mut free_m = 0.0;
            for part in (0..=STOPPING).map(|k| f64::from(k) / f64::from(STOPPING)) {
                let place = here + path * part;
                let mut volumes = below.around.keep_out.iter();
                if volumes.any(|v| v.distance(&place) < self.geometry.body_radius_m()) {
                    bounded(PlanCheck::Obstacle, stops_m, free_m)?;
                }
                free_m = part * stops_m;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{
        PlanCheck::{Along, Deck, Outside, Permission, Tilted, Water},
        *,
    };
    use crate::{
        fixtures::{forecast, header, level, mission, plan},
        pilot::PilotConfig,
    };
    use alight_shared::{geometry::DeckGeometry, msg::State, time::Time};

    #[test]
    fn plans_that_can_or_cannot_end_within_limits() {
        let drone = DroneGeometry::default();
        let header = header(1, Time::from_secs(5.0));
        let deck = forecast(header, |_| level([0.0, 0.0, -1.3]));
        let pilot = Pilot::new(&PilotConfig::default(), &drone, &DeckGeometry::default(), 1, 1);
        // Clearance, distance from the deck's centre, speeds along the deck and down, roll.
        for (state, [clearance, north, along, down, roll], expected) in [
            (State::Flare, [0.5, 0.0, 0.0, 0.8, 0.0], None),
            (State::Descent, [3.0, 0.0, 0.0, 3.5, 0.0], None),
            (State::Flare, [0.5, 0.0, 0.0, 2.2, 0.0], Some(Deck)),
            (State::Tracking, [0.5, 0.0, 0.0, 1.5, 0.0], Some(Permission)),
            (State::Flare, [0.5, 2.0, 0.0, 0.8, 0.0], Some(Outside)),
            (State::Flare, [0.1, 0.0, 0.0, 0.8, 0.5], Some(Tilted)),
            (State::Flare, [0.1, 0.0, 2.0, 0.8, 0.0], Some(Along)),
            (State::Descent, [0.5, 20.0, 0.0, 4.9, 0.0], Some(Water)),
        ] {
            let body = Body {
                position: Vector3::new(north, 0.0, -1.3 - drone.feet_below_m - clearance),
                velocity: Vector3::new(along, 0.0, down),
                attitude: UnitQuaternion::identity(),
            };
            let plan = plan(header, |t| PlanStage {
                position: (body.position + body.velocity * t).into(),
                velocity: body.velocity.into(),
                euler: [roll, 0.0, 0.0],
                ..PlanStage::default()
            });
            let below = DeckBelow::of(header.at, &deck, &body, &drone);
            let mission = mission(header, state, 0.5);
            let found = pilot.admit(header.at, &plan, &mission, &body, below.as_ref());
            assert_eq!(found.err().map(|r| r.check), expected, "{clearance} m: {found:?}");
            // A predicted fall of the deck admits nothing more.
            let now = header.at + Span::from_millis(100);
            let falls = forecast(header, |t| level([0.0, 0.0, 20.0 * t - 1.3]));
            let below = DeckBelow::of(now, &falls, &body, &drone);
            let found = pilot.admit(now, &plan, &mission, &body, below.as_ref());
            assert!(expected.is_none() || found.is_err(), "{clearance} m");
        }
    }
}

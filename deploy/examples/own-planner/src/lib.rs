//! Example planner: it follows the predicted deck and reduces its height above it at the permitted descent speed.
//!
//! `cargo test --release -p own-planner` flies it on three seeds.

use alight_shared::{
    geometry::GRAVITY,
    msg::{DeckForecast, DroneState, MissionState, Phase, Plan, PlanStage},
    time::{DroneTime, Span},
};
use alight_uav::planner::{
    law::Law,
    model::{ModelState, tilt_of},
    reference::PlanReference,
};
use nalgebra::Vector3;

/// Time constant with which the drone approaches its goal, s.
const APPROACH_S: f64 = 1.2;
const STEP_S: f64 = 0.05;

#[derive(Debug, Default)]
pub struct Ride {
    drone: Option<DroneState>,
}

impl Law for Ride {
    fn observe(&mut self, drone: Option<&DroneState>, _: Option<&DeckForecast>, _: &PlanReference) {
        self.drone = drone.copied().or(self.drone);
    }
    /// None leaves the plan to the common planner, which flies to the vessel.
    fn own_plan(
        &mut self,
        now: DroneTime,
        mission: &MissionState,
        forecast: Option<&DeckForecast>,
        _start: Option<(ModelState, f64)>,
    ) -> Option<Plan> {
        let drone = self.drone?;
        let forecast = forecast?;
        let level = forecast.mean_z?;
        let lands = mission.descent_mps > 0.0;
        if !matches!(mission.state.phase(), Phase::Follow | Phase::Landing) {
            return None;
        }
        let below_m = forecast.at(now)?.position[2] - drone.position[2];
        // Goal `t` seconds ahead: position, velocity, acceleration. Before a descent it is above the deck's mean level.
        let goal = |t: f64| {
            let deck = forecast.at(now + Span::from_secs(t))?;
            let mut goal = [deck.position, deck.velocity, deck.acceleration];
            if lands {
                goal[0][2] += mission.descent_mps * t - below_m;
                goal[1][2] += mission.descent_mps;
            } else {
                [goal[0][2], goal[1][2], goal[2][2]] = [level - mission.height_m, 0.0, 0.0];
            }
            Some(goal)
        };
        let start = goal(0.0)?;
        let yaw = drone.euler().z;
        let mut plan = Plan {
            step: Span::from_secs(STEP_S),
            ..Plan::default()
        };
        for t in (0..=20).map(|k| STEP_S * f64::from(k)) {
            let Some([mut position, mut velocity, mut acceleration]) = goal(t) else {
                break;
            };
            // The difference from the goal decays as with critical damping.
            let rate = 1.0 / APPROACH_S;
            for i in 0..3 {
                let gap = drone.position[i] - start[0][i];
                let slope = drone.velocity[i] - start[1][i] + rate * gap;
                let left = gap + slope * t;
                let decay = (-rate * t).exp();
                position[i] += left * decay;
                velocity[i] += (slope - rate * left) * decay;
                acceleration[i] += rate * (rate * left - 2.0 * slope) * decay;
            }
            let up = Vector3::from(acceleration) - Vector3::new(0.0, 0.0, GRAVITY);
            let (roll, pitch) = tilt_of(&up.normalize(), yaw);
            plan.stages
                .push(PlanStage {
                    position,
                    velocity,
                    acceleration,
                    euler: [roll, pitch, yaw],
                    ..PlanStage::default()
                })
                .ok()?;
        }
        Some(plan)
    }
}

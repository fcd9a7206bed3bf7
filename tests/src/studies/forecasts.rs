//! Errors of a drone's forecasts of the deck against its true motion, beside a ridge regression on the true motion of the
//! last two minutes and the forecast's present held constant.

use alight_shared::{
    frames::{Deck, DroneBody, VesselBody},
    msg::DeckForecast,
    step::Step,
    time::{DroneTime, Span, VesselTime, WorldTime},
};
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::review::Predictions;
use nalgebra::Vector3;

use crate::{
    harness::{
        foresight::{OdometryError, stage_of},
        observer::WorldObserver,
        physics::TICK,
        scenario::Scenario,
    },
    physics::body::RigidState,
};

/// Maximum age of the vision in a forecast that is compared, s. Before, the errors of two GNSS receivers hide those of the
/// prediction.
const IN_VIEW_S: f64 = 1.0;
/// Interval at which the regression receives the true motion, ticks.
const EVERY_TICKS: i64 = 5;

/// Comparison of the first drone's forecasts, in the frame of its odometry.
#[derive(Default)]
pub struct ForecastErrors {
    pub compared: Predictions,
    centre: Vector3<f64>,
    /// True states of the deck and the drone.
    deck: Option<RigidState<Deck>>,
    drone: Option<RigidState<DroneBody>>,
    odometry: OdometryError,
}

fn at(forecast: &DeckForecast, ahead_s: f64) -> Option<([f64; 6], [f64; 6])> {
    let s = forecast.at(forecast.header.at + Span::from_secs(ahead_s))?;
    let [x, y, z] = s.position;
    let [roll, pitch, yaw] = s.euler;
    let [sx, sy, sz] = s.position_sd;
    let [s_roll, s_pitch, s_yaw] = s.euler_sd;
    Some(([x, y, z, roll, pitch, yaw], [sx, sy, sz, s_roll, s_pitch, s_yaw]))
}

impl ForecastErrors {
    pub fn of(scenario: &Scenario, seed: u64) -> ForecastErrors {
        ForecastErrors {
            centre: scenario.drawn(seed).deck.centre(),
            ..ForecastErrors::default()
        }
    }
}

impl WorldObserver for ForecastErrors {
    fn truth(
        &mut self,
        t: WorldTime,
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        let deck = vessel.at(self.centre);
        self.deck = Some(deck);
        self.drone = drone.map(|(drone, _)| *drone);
        if t.nanos() % (EVERY_TICKS * TICK.nanos()) == 0 {
            let stage = stage_of(&deck, &Vector3::zeros(), &Vector3::zeros());
            let [roll, pitch, _] = stage.euler;
            let [roll_rate, pitch_rate, _] = stage.euler_rates;
            let heave = stage.position[2];
            let motion = [roll, pitch, heave, roll_rate, pitch_rate, stage.velocity[2]];
            self.compared.publish(VesselTime::from_nanos(t.nanos()), motion);
        }
    }

    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        let (Some(input), Some(output)) = (step.input::<PredictorIn>(), step.output::<PredictorOut>()) else {
            return;
        };
        let (Some(deck), Some(drone)) = (&self.deck, &self.drone) else {
            return;
        };
        if let Some(odometry) = &input.drone {
            self.odometry = OdometryError::of(odometry, DroneTime::from_nanos(step.now_ns), drone);
        }
        let offset = self.odometry.position;
        let truth = stage_of(deck, &offset, &self.odometry.velocity);
        let [x, y, z] = truth.position;
        let [roll, pitch, yaw] = truth.euler;
        let eta = [x, y, z, roll, pitch, yaw];
        self.compared.compare(VesselTime::from_nanos(t.nanos()), eta);
        if let Some(forecast) = output.forecast.filter(|f| f.vision_age_s < IN_VIEW_S) {
            let age_ns = step.now_ns - forecast.header.at.nanos();
            let begins_at = VesselTime::from_nanos(t.nanos() - age_ns);
            let predicted = |ahead_s| at(&forecast, ahead_s);
            self.compared.push(begins_at, predicted, offset.z);
        }
    }
}

//! Truth in a recording: the scene, and the relation of drone and deck.

use alight_computer::record::{Recorder, scenery::Scenery, schema::Truth, sink::Sink, views::ViewTopic};
use alight_shared::{
    frames::{Deck, DroneBody, VesselBody},
    time::WorldTime,
};
use alight_sim::{harness::scenario::Scenario, physics::body::RigidState};
use mcap::McapError;
use nalgebra::Vector3;

const SCENE_MS: i64 = 5_000;

pub struct TruthViews {
    scenario: Scenario,
    scenery: Scenery,
    truth: ViewTopic<Truth>,
}

impl TruthViews {
    pub fn new(sink: &mut Sink, scenario: &Scenario) -> Result<TruthViews, McapError> {
        Ok(TruthViews {
            scenario: scenario.clone(),
            scenery: Scenery::new(sink, &scenario.deck, &scenario.airframe, SCENE_MS)?,
            truth: ViewTopic::open(sink, "/truth")?,
        })
    }
    /// Shows both bodies at `t`, the drone with its wind (NED, m/s, towards).
    pub fn show(
        &mut self,
        recorder: &mut Recorder,
        t: WorldTime,
        vessel: &RigidState<VesselBody>,
        drone: Option<(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        let Recorder { sink, views, .. } = recorder;
        views.true_drone = drone.as_ref().map(|(d, _)| d.position.0.into());
        if let (true, Some((drone, wind))) = (views.fast(t), &drone) {
            let deck = vessel.at(self.scenario.deck.centre());
            self.truth.put(sink, t, &self.relation(&deck, drone, wind));
        }
        let placed = (vessel.position.0.into(), vessel.attitude.0);
        let drone = drone.map(|(d, _)| (d.position.0.into(), d.attitude.0));
        self.scenery.draw(sink, views, t, Some(placed), drone);
    }

    fn relation(&self, deck: &RigidState<Deck>, drone: &RigidState<DroneBody>, wind: &Vector3<f64>) -> Truth {
        let offset = drone.position - deck.position;
        let speed = drone.velocity.0 - deck.velocity.0;
        let below = Vector3::new(0.0, 0.0, self.scenario.airframe.feet_below_m);
        let feet = drone.at::<DroneBody>(below).position;
        let feet = (deck.attitude.inverse() * (feet - deck.position)).0;
        let (roll, pitch, yaw) = (deck.attitude.inverse() * drone.attitude).euler();
        let tilt = deck.attitude.down().dot(&drone.attitude.down());
        let d = deck.euler().map(f64::to_degrees);
        let q = drone.euler().map(f64::to_degrees);
        Truth {
            deck_north_m: deck.position.0.x,
            deck_east_m: deck.position.0.y,
            deck_heave_m: -deck.position.0.z,
            deck_roll_deg: d.x,
            deck_pitch_deg: d.y,
            deck_yaw_deg: d.z,
            deck_velocity_mps: deck.velocity.0.into(),
            drone_north_m: drone.position.0.x,
            drone_east_m: drone.position.0.y,
            drone_height_m: -drone.position.0.z,
            drone_roll_deg: q.x,
            drone_pitch_deg: q.y,
            drone_yaw_deg: q.z,
            drone_velocity_mps: drone.velocity.0.into(),
            wind_mps: (*wind).into(),
            wind_speed_mps: wind.norm(),
            horizontal_distance_m: offset.0.xy().norm(),
            forward_m: feet.x,
            starboard_m: feet.y,
            height_above_deck_m: -feet.z,
            relative_speed_mps: speed.norm(),
            roll_error_deg: roll.to_degrees(),
            pitch_error_deg: pitch.to_degrees(),
            yaw_error_deg: yaw.to_degrees(),
            tilt_error_deg: tilt.clamp(-1.0, 1.0).acos().to_degrees(),
        }
    }
}

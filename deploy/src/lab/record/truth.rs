//! The truth beside a recording: transforms, shapes and the relation of drone and deck.

use alight_shared::frames::{Deck, DroneBody, VesselBody};
use alight_shared::time::{Time, TrueTime};
use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::body::RigidState;
use foxglove::messages::{FrameTransforms, PointCloud, SceneUpdate};
use mcap::McapError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::record::geometry::{frame, on_the_water};
use crate::record::schema::Truth;
use crate::record::sink::Sink;
use crate::record::views::{Topic, due, timestamp, transform};
use crate::record::{Recorder, cloud, shapes};

/// Period of the shapes, ms.
const SCENE_MS: i64 = 5_000;

/// Channels of the truth.
pub struct TruthViews {
    scenario: Scenario,
    scene: Topic<SceneUpdate>,
    deck: Topic<PointCloud>,
    drone: Topic<PointCloud>,
    truth: Topic<Truth>,
}

impl TruthViews {
    /// Opens them.
    pub fn new(sink: &mut Sink, scenario: &Scenario) -> Result<TruthViews, McapError> {
        Ok(TruthViews {
            scenario: scenario.clone(),
            scene: Topic::open(sink, "/scene")?,
            deck: Topic::open(sink, "/points/deck")?,
            drone: Topic::open(sink, "/points/drone")?,
            truth: Topic::open(sink, "/truth")?,
        })
    }
    /// Both bodies at `t`.
    pub fn show(
        &self,
        recorder: &mut Recorder,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&RigidState<DroneBody>>,
    ) {
        let Recorder { sink, views, .. } = recorder;
        let appeared = views.true_drone.is_none() && drone.is_some();
        views.true_drone = drone.map(|d| d.position.0.into());
        let (deck, airframe) = (&self.scenario.deck, &self.scenario.airframe);
        if due(t, SCENE_MS) || appeared {
            let now = timestamp(t);
            self.scene.put(sink, t, &shapes::scene(now, deck, airframe));
            self.deck.put(sink, t, &cloud::deck(now, deck));
            if drone.is_some() {
                self.drone.put(sink, t, &cloud::drone(now, airframe));
            }
        }
        if !views.fast(t) {
            return;
        }
        let north_east_down = UnitQuaternion::new_normalize(Quaternion::new(0.0, 1.0, 1.0, 0.0));
        let still = UnitQuaternion::identity();
        let body =
            |child: &str, position: [f64; 3], attitude| transform(t, frame::NED, child, position, attitude);
        let chase = on_the_water(vessel.position.0.into());
        let mut transforms = vec![
            transform(t, frame::WORLD, frame::NED, [0.0; 3], &north_east_down),
            transform(t, frame::WORLD, frame::CHASE, chase, &still),
            body(frame::VESSEL, vessel.position.0.into(), &vessel.attitude.0),
            transform(t, frame::VESSEL, frame::DECK, deck.centre_m, &still),
        ];
        if let Some(d) = drone {
            // The camera looks down, the top of its image is forward.
            let down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::FRAC_PI_2);
            transforms.push(body(frame::DRONE, d.position.0.into(), &d.attitude.0));
            transforms.push(transform(
                t,
                frame::DRONE,
                frame::CAMERA,
                airframe.camera_m,
                &down,
            ));
            self.truth
                .put(sink, t, &self.relation(&vessel.at(deck.centre()), d));
        }
        views.transforms.put(sink, t, &FrameTransforms { transforms });
    }

    fn relation(&self, deck: &RigidState<Deck>, drone: &RigidState<DroneBody>) -> Truth {
        let (offset, speed) = (drone.position - deck.position, drone.velocity.0 - deck.velocity.0);
        let up = (deck.attitude.inverse() * offset).0;
        let tilt = deck.attitude.down().dot(&drone.attitude.down());
        let (d, q) = (
            deck.euler().map(f64::to_degrees),
            drone.euler().map(f64::to_degrees),
        );
        Truth {
            deck_heave_m: -deck.position.0.z,
            deck_roll_deg: d.x,
            deck_pitch_deg: d.y,
            deck_yaw_deg: d.z,
            deck_velocity_mps: deck.velocity.0.into(),
            drone_roll_deg: q.x,
            drone_pitch_deg: q.y,
            drone_yaw_deg: q.z,
            drone_velocity_mps: drone.velocity.0.into(),
            horizontal_distance_m: offset.0.xy().norm(),
            height_above_deck_m: -up.z - self.scenario.airframe.feet_below_m,
            relative_speed_mps: speed.norm(),
            tilt_error_deg: tilt.clamp(-1.0, 1.0).acos().to_degrees(),
        }
    }
}

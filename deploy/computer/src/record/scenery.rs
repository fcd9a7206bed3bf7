//! Vessel, deck and drone in Foxglove's scene: as the drone estimates them, or with their true poses in a recording
//! of the simulation.

use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry},
    msg::{DeckForecast, DroneState},
    time::WorldTime,
};
use foxglove::messages::{FrameTransforms, PointCloud, SceneUpdate};
use mcap::McapError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::record::{
    cloud,
    geometry::{frame, on_the_water},
    shapes,
    sink::{OpenChannels, TakeMessages},
    views::{ViewTopic, Views, due, timestamp, transform},
};

/// Position and attitude in [`frame::NED`].
pub type Placed = ([f64; 3], UnitQuaternion<f64>);

pub struct Scenery {
    deck: DeckGeometry,
    airframe: DroneGeometry,
    scene: ViewTopic<SceneUpdate>,
    deck_points: ViewTopic<PointCloud>,
    drone_points: ViewTopic<PointCloud>,
    period_ms: i64,
    shown: Option<bool>,
    /// Water level relative to the deck's mean level, m down, in the drone's NED, whose origin may be at any height.
    water_m: Option<f64>,
}

impl Scenery {
    /// Opens the channels; a new viewer receives the shapes within `period_ms`.
    pub fn new(
        opening: &mut impl OpenChannels,
        deck: &DeckGeometry,
        airframe: &DroneGeometry,
        period_ms: i64,
    ) -> Result<Scenery, McapError> {
        Ok(Scenery {
            deck: *deck,
            airframe: *airframe,
            scene: ViewTopic::open(opening, "/scene")?,
            deck_points: ViewTopic::open(opening, "/points/deck")?,
            drone_points: ViewTopic::open(opening, "/points/drone")?,
            period_ms,
            shown: None,
            water_m: None,
        })
    }
    /// Position and attitude of the vessel's reference point; updates the water level.
    fn vessel(&mut self, forecast: Option<&DeckForecast>) -> Option<(Vector3<f64>, UnitQuaternion<f64>)> {
        let forecast = forecast?;
        let stage = forecast.stages.first()?;
        let [roll, pitch, yaw] = stage.euler;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let vessel = Vector3::from(stage.position) - q * self.deck.centre();
        self.water_m = forecast.mean_z.map(|z| z - self.deck.centre().z).or(self.water_m);
        Some((vessel, q))
    }
    /// Converts a position from the drone's NED to the scene's, whose origin is on the water.
    pub fn in_scene(&self, [north, east, down]: [f64; 3]) -> [f64; 3] {
        [north, east, down - self.water_m.unwrap_or_default()]
    }
    pub fn show(
        &mut self,
        sink: &mut impl TakeMessages,
        views: &Views,
        t: WorldTime,
        forecast: Option<&DeckForecast>,
        drone: Option<&DroneState>,
    ) {
        let vessel = self.vessel(forecast);
        let vessel = vessel.map(|(at, q)| (self.in_scene(at.into()), q));
        let drone = drone.map(|d| (self.in_scene(d.position), d.attitude()));
        self.draw(sink, views, t, vessel, drone);
    }
    /// Draws vessel and drone at these poses of the scene, if known.
    pub fn draw(
        &mut self,
        sink: &mut impl TakeMessages,
        views: &Views,
        t: WorldTime,
        vessel: Option<Placed>,
        drone: Option<Placed>,
    ) {
        if due(t, self.period_ms) || self.shown != Some(drone.is_some()) {
            self.shown = Some(drone.is_some());
            let now = timestamp(t);
            self.scene
                .put(sink, t, &shapes::scene(now, &self.deck, &self.airframe));
            self.deck_points.put(sink, t, &cloud::deck(now, &self.deck));
            if drone.is_some() {
                self.drone_points.put(sink, t, &cloud::drone(now, &self.airframe));
            }
        }
        if !views.fast(t) {
            return;
        }
        let north_east_down = UnitQuaternion::new_normalize(Quaternion::new(0.0, 1.0, 1.0, 0.0));
        let still = UnitQuaternion::identity();
        let mut transforms = vec![transform(t, frame::WORLD, frame::NED, [0.0; 3], &north_east_down)];
        if let Some((at, q)) = vessel {
            transforms.push(transform(t, frame::WORLD, frame::CHASE, on_the_water(at), &still));
            transforms.push(transform(t, frame::NED, frame::VESSEL, at, &q));
        }
        let deck = self.deck.centre_m;
        transforms.push(transform(t, frame::VESSEL, frame::DECK, deck, &still));
        if let Some((at, q)) = drone {
            // The camera looks down, with the top of its image forward.
            let down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::FRAC_PI_2);
            transforms.push(transform(t, frame::NED, frame::DRONE, at, &q));
            let camera = self.airframe.camera_m;
            transforms.push(transform(t, frame::DRONE, frame::CAMERA, camera, &down));
        }
        views.transforms.put(sink, t, &FrameTransforms { transforms });
    }
}

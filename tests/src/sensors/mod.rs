//! Everything that measures the world, with its noise, bias, latency and failures.
//!
//! Each error has its own named random stream, and each is drawn whether or not the measurement is
//! delivered: two planners that fly differently meet the same errors at the same time.
//!
//! Reading order: [`noise`], [`gnss`] and [`imu`] for the vessel; [`camera`], [`square_pose`] and
//! [`tag`] for the drone.

pub mod camera;
pub mod clocks;
pub mod delay;
pub mod gnss;
pub mod heading;
pub mod imu;
pub mod noise;
pub mod rangefinder;
pub mod render;
pub mod square_pose;
pub mod tag;
pub mod uvdar;

use alight_shared::config;
use alight_shared::frames::{Deck, DroneBody, VesselBody};
use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::msg::{GnssFix, HeadingFix, ImuSample, RangeSample, TagPose, UvdarFix};
use alight_shared::time::{Time, TrueTime};
use nalgebra::Vector3;

use crate::physics::body::RigidState;
use crate::physics::streams::Streams;
use camera::CameraMount;
use clocks::Clocks;

/// Most measurements of one sensor under way at a time.
const QUEUE: usize = 256;

config! {
    /// All sensors of both craft.
    pub struct SensorConfig {
        /// The vessel's inertial measurement unit.
        pub vessel_imu: imu::VesselImuConfig;
        /// The vessel's GNSS receiver.
        pub vessel_gnss: gnss::VesselGnssConfig;
        /// The vessel's heading sensor.
        pub vessel_heading: heading::VesselHeadingConfig;
        /// The detector of the deck's tag.
        pub tag: tag::TagConfig;
        /// The UVDAR system.
        pub uvdar: uvdar::UvdarConfig;
        /// The drone's rangefinder.
        pub rangefinder: rangefinder::RangefinderConfig;
        /// The two computers' clocks.
        pub clocks: clocks::ClockConfig;
        /// What the camera's mount is wrong by.
        pub camera_mount: camera::CameraMountConfig;
        /// Images of the belly camera.
        pub render: render::RenderConfig;
    }
}

/// What the sensors write into their headers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The vessel.
    pub vessel: u32,
    /// The drone.
    pub drone: u32,
    /// The start of the sensors' senders.
    pub boot: u32,
}

impl Default for Identity {
    fn default() -> Self {
        Identity {
            vessel: 1,
            drone: 1,
            boot: 1,
        }
    }
}

/// What the vessel's sensors delivered in one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VesselReadings {
    /// Inertial samples.
    pub imu: Vec<ImuSample>,
    /// GNSS fixes.
    pub gnss: Vec<GnssFix>,
    /// Headings.
    pub heading: Vec<HeadingFix>,
}

/// What the drone's deck sensors delivered in one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DroneReadings {
    /// Tag sightings.
    pub tags: Vec<TagPose>,
    /// Images that were begun, where they take the sightings' place.
    pub shots: Vec<render::Shot>,
    /// The same of the ultraviolet camera.
    pub uv_shots: Vec<render::Shot>,
    /// UVDAR fixes.
    pub uvdar: Vec<UvdarFix>,
    /// Rangefinder readings.
    pub ranges: Vec<RangeSample>,
}

/// The sensors of both craft at work. Both calls are made once per tick of 10 ms with the truth
/// at that tick; what they return has arrived by then, stamped with the time it was measured.
#[derive(Clone, Debug)]
pub struct Sensors {
    /// The clocks that stamp.
    pub clocks: Clocks,
    identity: Identity,
    mount: CameraMount,
    imu: imu::VesselImu,
    gnss: gnss::VesselGnss,
    heading: heading::VesselHeading,
    tag: tag::TagDetector,
    shutter: Option<render::Shutter>,
    uv_shutter: Option<render::Shutter>,
    uvdar: uvdar::Uvdar,
    rangefinder: rangefinder::Rangefinder,
}

impl Sensors {
    /// The sensors of this seed, with the default [`Identity`].
    pub fn new(config: &SensorConfig, drone: &DroneGeometry, deck: &DeckGeometry, streams: &Streams) -> Self {
        let mount = CameraMount::new(&config.camera_mount, drone, streams);
        Sensors {
            clocks: Clocks::new(&config.clocks, streams),
            identity: Identity::default(),
            mount,
            imu: imu::VesselImu::new(&config.vessel_imu, streams),
            gnss: gnss::VesselGnss::new(&config.vessel_gnss, streams),
            heading: heading::VesselHeading::new(&config.vessel_heading, streams),
            tag: tag::TagDetector::new(&config.tag, deck, streams),
            shutter: config
                .render
                .on
                .then(|| render::Shutter::new(config.tag.rate_hz, config.tag.exposure_s)),
            uv_shutter: config
                .render
                .markers
                .then(|| render::Shutter::new(config.uvdar.rate_hz, config.tag.exposure_s)),
            uvdar: uvdar::Uvdar::new(&config.uvdar, &mount, streams),
            rangefinder: rangefinder::Rangefinder::new(&config.rangefinder, drone, deck, streams),
        }
    }
    /// The same sensors, with other names in their headers.
    pub fn identified(mut self, identity: Identity) -> Self {
        self.identity = identity;
        self
    }
    /// Where the camera really sits (truth).
    pub fn camera_mount(&self) -> &CameraMount {
        &self.mount
    }
    /// What the vessel's GNSS bias displaces the vessel's NED plane by now, m (truth): positions
    /// in the vessel's NED are true positions plus this.
    pub fn vessel_gnss_bias(&self) -> Vector3<f64> {
        self.gnss.bias()
    }
    /// The vessel's sensors at `t`.
    pub fn vessel(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> VesselReadings {
        let (id, clocks) = (&self.identity, &self.clocks);
        VesselReadings {
            imu: self.imu.step(t, vessel, id, clocks),
            gnss: self.gnss.step(t, vessel, id, clocks),
            heading: self.heading.step(t, vessel, id, clocks),
        }
    }
    /// The drone's deck sensors at `t`; `water(north, east)` is the surface's NED z, m.
    pub fn drone(
        &mut self,
        t: Time<TrueTime>,
        drone: &RigidState<DroneBody>,
        deck: &RigidState<Deck>,
        water: impl Fn(f64, f64) -> f64,
    ) -> DroneReadings {
        let (id, clocks) = (&self.identity, &self.clocks);
        let view = self.mount.view(drone);
        let (tags, shots) = match &mut self.shutter {
            None => (self.tag.step(t, &view, deck, id, clocks), Vec::new()),
            Some(shutter) => (Vec::new(), shutter.step(t, &view, deck, clocks)),
        };
        let (uvdar, uv_shots) = match &mut self.uv_shutter {
            None => (self.uvdar.step(t, &view, deck, id, clocks), Vec::new()),
            Some(shutter) => (Vec::new(), shutter.step(t, &view, deck, clocks)),
        };
        DroneReadings {
            tags,
            shots,
            uvdar,
            uv_shots,
            ranges: self.rangefinder.step(t, drone, deck, water, id, clocks),
        }
    }
}

#[cfg(test)]
mod tests;

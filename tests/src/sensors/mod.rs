//! Simulated sensors with noise, bias, latency and failures.
//!
//! Each error has its own named random stream and is drawn whether or not its measurement is delivered, so
//! that planners that fly differently experience the same errors at the same time.
//!
//! Start with [`noise`], [`gnss`] and [`imu`] for the vessel, then [`camera`], [`square_pose`],
//! [`vision_loss`], [`occlusion`], [`night`] and [`tag`] for the drone.

pub mod attitude;
pub mod beacon;
pub mod bytes;
pub mod camera;
pub mod clocks;
pub mod delay;
pub mod gnss;
pub mod heading;
pub mod imu;
pub mod moving_base;
pub mod night;
pub mod noise;
pub mod occlusion;
pub mod outlet;
pub mod rangefinder;
pub mod render;
pub mod square_pose;
pub mod tag;
pub mod uvdar;
pub mod vision_loss;

use alight_shared::{
    config,
    frames::{Deck, DroneBody, VesselBody},
    geodesy::Datum,
    geometry::{DeckGeometry, DroneGeometry},
    msg::{CameraLight, RangeSample, TagPose, UvdarFix},
    time::{DroneClock, Span, Time, TrueTime},
    topics::CAMERA_LIGHT,
};
use alight_uav::{autopilot::place_report::PlaceReport, camera::metering::Setting};
use alight_usv::sensors::Readings;
use nalgebra::Vector3;

use crate::physics::{body::RigidState, streams::Streams};
use camera::CameraMount;
use noise::Windows;
use occlusion::Occlusion;
use outlet::{Outlet, SenderIdentity};

config! {
    /// All sensors of vessel and drone.
    pub struct SensorConfig {
        /// The vessel's inertial measurement unit.
        pub vessel_imu: imu::VesselImuConfig;
        /// The vessel's GNSS receiver.
        pub vessel_gnss: gnss::VesselGnssConfig;
        /// The vessel's heading sensor.
        pub vessel_heading: heading::VesselHeadingConfig;
        /// The vessel's attitude sensor, if any.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub vessel_attitude: Option<attitude::VesselAttitudeConfig> = None;
        /// The vessel's beacon, if any.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub beacon: Option<beacon::BeaconConfig> = None;
        /// The vessel's GNSS receiver as moving base for the drone's receiver, if enabled.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub moving_base: Option<moving_base::MovingBaseConfig> = None;
        /// The detector of the deck's tag.
        pub tag: tag::TagConfig;
        /// The UVDAR system.
        pub uvdar: uvdar::UvdarConfig;
        /// The drone's rangefinder.
        pub rangefinder: rangefinder::RangefinderConfig;
        /// Clocks of the two computers.
        pub clocks: clocks::ClockErrorConfig;
        /// Error of the camera's mount.
        pub camera_mount: camera::CameraMountConfig;
        /// Images of the belly camera.
        pub render: render::RenderConfig;
        /// Light at night. None: daylight; the belly camera then uses the exposure `tag.exposure_s` and the
        /// white level `render.white`.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub night: Option<night::NightConfig> = None;
    }
    check |this, at| {
        if let Some(attitude) = &this.vessel_attitude {
            attitude.check(&at.table("vessel_attitude"))?;
        }
        if let Some(beacon) = &this.beacon {
            beacon.check(&at.table("beacon"))?;
        }
        if let Some(moving_base) = &this.moving_base {
            moving_base.check(&at.table("moving_base"))?;
        }
        if let Some(night) = &this.night {
            night.check(&at.table("night"))?;
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct DroneReadings {
    /// Beacon messages on the autopilot's link.
    pub beacons: Vec<PlaceReport>,
    /// Bytes of the drone's own GNSS receiver (UBX).
    pub receiver: Vec<u8>,
    pub tags: Vec<TagPose>,
    /// Exposures begun, if images replace the detections.
    pub shots: Vec<render::Shot>,
    /// Exposures begun by the ultraviolet camera.
    pub uv_shots: Vec<render::Shot>,
    pub uvdar: Vec<UvdarFix>,
    pub ranges: Vec<RangeSample>,
    /// Light in the belly camera's images, if reported.
    pub light: Option<CameraLight>,
}

impl DroneReadings {
    pub fn shift(&mut self, by: Span) {
        self.tags.iter_mut().for_each(|m| m.header.at += by);
        self.uvdar.iter_mut().for_each(|m| m.header.at += by);
        self.light.iter_mut().for_each(|m| m.header.at += by);
    }
}

/// The vessel's sensors. [`VesselSensors::step`] is called in each tick of 10 ms with the truth and returns
/// the measurements that have arrived, stamped with their time of measurement.
#[derive(Clone, Debug)]
pub struct VesselSensors {
    imu: imu::VesselImu,
    gnss: gnss::VesselGnss,
    heading: heading::VesselHeading,
    attitude: Option<attitude::VesselAttitude>,
    moving_base: Option<moving_base::BaseReceiver>,
}

impl VesselSensors {
    /// `place` is the geographic position; None if it is not needed.
    pub fn new(
        config: &SensorConfig,
        place: Option<Datum>,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        VesselSensors {
            imu: imu::VesselImu::new(&config.vessel_imu, identity, streams),
            gnss: gnss::VesselGnss::new(&config.vessel_gnss, place, identity, streams),
            heading: heading::VesselHeading::new(&config.vessel_heading, identity, streams),
            attitude: (config.vessel_attitude.as_ref())
                .map(|c| attitude::VesselAttitude::new(c, identity, streams)),
            moving_base: (config.moving_base.as_ref())
                .map(|c| moving_base::BaseReceiver::new(c, identity, streams)),
        }
    }
    /// Displacement of the vessel's NED plane by its GNSS bias, m; add it to a true position.
    pub fn gnss_bias(&self) -> Vector3<f64> {
        self.gnss.bias()
    }
    pub fn rtcm(&mut self, t: Time<TrueTime>) -> Vec<u8> {
        self.moving_base.as_mut().map_or_else(Vec::new, |b| b.step(t))
    }
    pub fn step(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> Readings {
        Readings {
            imu: self.imu.step(t, vessel),
            gnss: self.gnss.step(t, vessel),
            heading: self.heading.step(t, vessel),
            attitude: self
                .attitude
                .as_mut()
                .map_or_else(Vec::new, |a| a.step(t, vessel)),
        }
    }
}

/// The drone's sensors; used like [`VesselSensors`].
#[derive(Clone)]
pub struct DroneSensors {
    beacon: Option<beacon::Beacon>,
    rover: Option<moving_base::MovingBaseRover>,
    mount: CameraMount,
    tag: tag::SimulatedTagDetector,
    /// Detector for another boat's tags in the same image.
    other_tag: tag::SimulatedTagDetector,
    other: Option<RigidState<Deck>>,
    tag_outlet: Outlet<TagPose, DroneClock>,
    /// Light at night, reported without rendered images.
    light: Option<Outlet<CameraLight, DroneClock>>,
    /// Exposure time of the ultraviolet camera, and of the belly camera by day, s.
    exposure_s: f64,
    shutter: Option<render::Shutter>,
    uv_shutter: Option<render::Shutter>,
    uvdar: uvdar::SimulatedUvdar,
    rangefinder: rangefinder::Rangefinder,
}

impl DroneSensors {
    pub fn new(
        config: &SensorConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        place: Option<Datum>,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        let mount = CameraMount::new(&config.camera_mount, drone, streams);
        let shutter = |on: bool, rate_hz: f64| on.then(|| render::Shutter::new(rate_hz, identity.clock));
        let tag = |name: &str| {
            let sun = render::sun(&config.render, streams);
            tag::SimulatedTagDetector::new(&config.tag, deck, name, streams)
                .below(Occlusion::new(drone, &mount, sun))
                .at_night(config.night.as_ref())
        };
        DroneSensors {
            beacon: (config.beacon.as_ref()).map(|c| beacon::Beacon::new(c, place, identity, streams)),
            rover: (config.moving_base.as_ref())
                .map(|c| moving_base::MovingBaseRover::new(c, drone.gnss_antenna_m, streams)),
            mount,
            tag: tag("drone.tag"),
            other_tag: tag("drone.other_tag"),
            other: None,
            exposure_s: config.tag.exposure_s,
            // With rendered images, the camera node reports the light instead.
            light: (config.night.is_some() && !config.render.on).then(|| {
                Outlet::new(
                    CAMERA_LIGHT.rate_hz,
                    config.tag.latency_s,
                    &Windows::default(),
                    identity,
                )
            }),
            tag_outlet: Outlet::new(
                config.tag.rate_hz,
                config.tag.latency_s,
                &config.tag.outages_s,
                identity,
            ),
            shutter: shutter(config.render.on, config.tag.rate_hz),
            uv_shutter: shutter(config.render.markers, config.uvdar.rate_hz),
            uvdar: uvdar::SimulatedUvdar::new(&config.uvdar, &mount, identity, streams),
            rangefinder: rangefinder::Rangefinder::new(&config.rangefinder, drone, deck, identity, streams),
        }
    }
    /// Shows another boat's deck with the vessel's tags.
    pub fn show(&mut self, other: Option<RigidState<Deck>>) {
        self.other = other;
    }
    /// Passes complete frames to the receiver that uses the moving base.
    pub fn receive_rtcm(&mut self, t: Time<TrueTime>, bytes: &[u8]) {
        self.rover.iter_mut().for_each(|r| r.receive(t, bytes));
    }
    pub fn fail_moving_base(&mut self, faults: moving_base::MovingBaseFaults) {
        self.rover.iter_mut().for_each(|r| r.faults = faults);
    }
    /// Readings that have arrived by `t`; `water(north, east)` is the NED z of the surface, m.
    pub fn step(
        &mut self,
        t: Time<TrueTime>,
        drone: &RigidState<DroneBody>,
        deck: &RigidState<Deck>,
        water: impl Fn(f64, f64) -> f64,
    ) -> DroneReadings {
        let view = self.mount.view(drone);
        let mut readings = DroneReadings {
            ranges: self.rangefinder.step(t, drone, deck, self.other.as_ref(), water),
            beacons: self.beacon.as_mut().map_or_else(Vec::new, |b| b.step(t, deck)),
            receiver: self
                .rover
                .as_mut()
                .map_or_else(Vec::new, |r| r.step(t, drone, deck)),
            ..DroneReadings::default()
        };
        match &mut self.shutter {
            None => {
                if self.tag_outlet.due(t).is_some() {
                    let pose = self.tag.detect(t, &view, deck);
                    self.tag_outlet
                        .send(t, false, |header| pose.map(|pose| TagPose { header, ..pose }));
                    let other = self.other.and_then(|deck| self.other_tag.detect(t, &view, &deck));
                    if let Some(pose) = other {
                        let send = |header| Some(TagPose { header, ..pose });
                        self.tag_outlet.send(t, false, send);
                    }
                }
                readings.tags = self.tag_outlet.arrived(t);
            }
            Some(shutter) => readings.shots = shutter.step(t, &view, deck, || self.tag.setting(&view, deck)),
        }
        match &mut self.uv_shutter {
            None => readings.uvdar = self.uvdar.step(t, &view, deck),
            Some(shutter) => {
                let (exposure_s, gain) = (self.exposure_s, 1.0);
                readings.uv_shots = shutter.step(t, &view, deck, || Setting { exposure_s, gain });
            }
        }
        if let Some(outlet) = &mut self.light {
            if outlet.due(t).is_some() {
                let light = self.tag.light(&view, deck);
                outlet.send(t, false, |header| {
                    light.map(|light| CameraLight { header, ..light })
                });
            }
            readings.light = outlet.arrived(t).pop();
        }
        readings
    }
}

#[cfg(test)]
mod tests;

//! The drone's cameras in lock-step: images rendered, delivered late, looked at by the drone's camera nodes.

use alight_shared::node::Node;
use alight_shared::tags::Tags;
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_uav::camera::metering::{Exposed, Light, Metering, Setting};
use alight_uav::camera::node::CameraIdentity;
use alight_uav::camera::uvdar::UvdarNode;
use alight_uav::camera::{CameraIn, CameraNode, CameraSettings, Frame, GreyImage};

use crate::harness::scenario::Scenario;
use crate::physics::streams::Streams;
use crate::sensors::DroneReadings;
use crate::sensors::camera::CameraMount;
use crate::sensors::delay::DelayLine;
use crate::sensors::night::NightConfig;
use crate::sensors::render::ultraviolet::Ultraviolet;
use crate::sensors::render::{Renderer, Shot};

/// Most images under way at a time.
const MAX_UNDER_WAY: usize = 256;

/// A camera's link: what is exposed arrives late.
struct ImageDelay {
    latency: Span,
    line: DelayLine<Shot>,
}

impl ImageDelay {
    fn new(latency_s: f64) -> ImageDelay {
        ImageDelay {
            latency: Span::from_secs(latency_s),
            line: DelayLine::new(MAX_UNDER_WAY),
        }
    }
    /// The images that have arrived by `t`, rendered now.
    fn frames(
        &mut self,
        t: Time<TrueTime>,
        shots: &[Shot],
        mut render: impl FnMut(&Shot) -> Option<GreyImage>,
    ) -> CameraIn {
        for shot in shots {
            // A full line loses the newest image, no more.
            let _full = self.line.push(shot.t + self.latency, *shot);
        }
        let frame = |shot: Shot| {
            Some(Frame {
                at: shot.at,
                image: render(&shot)?,
            })
        };
        CameraIn {
            frames: self.line.arrived(t).into_iter().filter_map(frame).collect(),
            exposed: None,
        }
    }
}

/// Exposure and gain by night, set by the drone's metering.
struct NightExposure {
    metering: Metering,
    /// Images begun and images metered so far.
    begun: u64,
    metered: u64,
}

impl NightExposure {
    fn new(night: &NightConfig, longest_s: f64) -> NightExposure {
        let [exposure_s, gain] = night.ranges(longest_s);
        // As it was by day.
        let start = Setting {
            exposure_s: exposure_s.least,
            gain: gain.least,
        };
        NightExposure {
            metering: Metering::new(exposure_s, gain, start),
            begun: 0,
            metered: 0,
        }
    }
    fn exposed(&self) -> Exposed {
        Exposed {
            setting: self.metering.setting(),
            at_limit: self.metering.at_limit(),
        }
    }
    /// The same images as the camera is set to take them.
    fn set(&mut self, shots: &[Shot]) -> Vec<Shot> {
        self.begun += shots.len() as u64;
        let Setting { exposure_s, gain } = self.metering.setting();
        let set = |shot: &Shot| Shot {
            exposure_s,
            gain,
            ..*shot
        };
        shots.iter().map(set).collect()
    }
    /// Images have been looked at; the newest shows this light.
    fn meter(&mut self, images: usize, light: &Light) {
        if images > 0 {
            self.metered += images as u64;
            self.metering.step(self.metered, self.begun, light);
        }
    }
}

/// The belly camera with its way and its node.
struct Belly {
    renderer: Renderer,
    delay: ImageDelay,
    node: CameraNode,
    night: Option<NightExposure>,
}

impl Belly {
    fn step(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, readings: &mut DroneReadings) {
        let Belly {
            renderer,
            delay,
            node,
            night,
        } = self;
        let render = |shot: &Shot| renderer.image(shot);
        let mut input = match night {
            None => delay.frames(t, &readings.shots, render),
            Some(night) => delay.frames(t, &night.set(&readings.shots), render),
        };
        input.exposed = night.as_ref().map(NightExposure::exposed);
        let found = node.step(now, &input);
        readings.tags.extend(found.tags);
        readings.light = found.light;
        if let Some(night) = night {
            night.meter(input.frames.len(), &node.light());
        }
    }
}

/// The belly camera and the ultraviolet one, each with its way and its node, where images take the place of
/// the measurement models.
pub struct SimulatedCameras {
    belly: Option<Belly>,
    ultraviolet: Option<(Ultraviolet, ImageDelay, UvdarNode)>,
}

impl SimulatedCameras {
    /// The cameras of a seed; None where measurement models stand for both.
    pub fn new(
        scenario: &Scenario,
        settings: &CameraSettings,
        tags: &Tags,
        names: CameraIdentity,
        streams: &Streams,
    ) -> Option<SimulatedCameras> {
        let sensors = &scenario.sensors;
        let render = &sensors.render;
        (render.on || render.markers).then(|| SimulatedCameras {
            belly: render.on.then(|| Belly {
                renderer: Renderer::new(render, &scenario.deck, streams)
                    .below(
                        &scenario.airframe,
                        &CameraMount::new(&sensors.camera_mount, &scenario.airframe, streams),
                    )
                    .at_night(sensors.night.as_ref()),
                delay: ImageDelay::new(sensors.tag.latency_s),
                node: CameraNode::new(settings, tags, names),
                night: (sensors.night.as_ref())
                    .map(|night| NightExposure::new(night, sensors.tag.exposure_s)),
            }),
            ultraviolet: render.markers.then(|| {
                (
                    Ultraviolet::new(&settings.uvdar, render.glints as usize, streams),
                    ImageDelay::new(sensors.uvdar.latency_s),
                    UvdarNode::new(&settings.uvdar, names),
                )
            }),
        })
    }
    /// Adds to `readings` the nodes' output on the images that have arrived by `t`.
    pub fn step(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, readings: &mut DroneReadings) {
        if let Some(belly) = &mut self.belly {
            belly.step(t, now, readings);
        }
        if let Some((camera, delay, node)) = &mut self.ultraviolet {
            let input = delay.frames(t, &readings.uv_shots, |shot| camera.image(shot));
            readings.uvdar.extend(node.step(now, &input).fixes);
        }
    }
}

//! The drone's cameras in lock-step: images rendered, delivered late, looked at by the drone's camera nodes.

use alight_shared::node::Node;
use alight_shared::tags::Tags;
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_uav::camera::node::CameraIdentity;
use alight_uav::camera::uvdar::UvdarNode;
use alight_uav::camera::{CameraIn, CameraNode, CameraSettings, Frame, GreyImage};

use crate::harness::scenario::Scenario;
use crate::physics::streams::Streams;
use crate::sensors::DroneReadings;
use crate::sensors::camera::CameraMount;
use crate::sensors::delay::DelayLine;
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
        }
    }
}

/// The belly camera and the ultraviolet one, each with its way and its node, where images take the place of
/// the measurement models.
pub struct SimulatedCameras {
    belly: Option<(Renderer, ImageDelay, CameraNode)>,
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
            belly: render.on.then(|| {
                (
                    Renderer::new(render, &scenario.deck, streams).below(
                        &scenario.airframe,
                        &CameraMount::new(&sensors.camera_mount, &scenario.airframe, streams),
                    ),
                    ImageDelay::new(sensors.tag.latency_s),
                    CameraNode::new(settings, tags, names),
                )
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
        if let Some((renderer, delay, node)) = &mut self.belly {
            let input = delay.frames(t, &readings.shots, |shot| renderer.image(shot));
            readings.tags.extend(node.step(now, &input).tags);
        }
        if let Some((camera, delay, node)) = &mut self.ultraviolet {
            let input = delay.frames(t, &readings.uv_shots, |shot| camera.image(shot));
            readings.uvdar.extend(node.step(now, &input).fixes);
        }
    }
}

//! The drone's cameras in lock-step: images rendered and delivered late, the edge of its rows.

use alight_shared::time::{Span, Time, TrueTime};
use alight_uav::camera::metering::{Exposed, Light, Metering, Setting};
use alight_uav::camera::{CameraFrame, CameraIn, CameraSettings, GreyImage};

use crate::harness::scenario::Scenario;
use crate::physics::streams::Streams;
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
            Some(CameraFrame {
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
            exposure_s: exposure_s.low,
            gain: gain.low,
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
    /// These images as the camera is set to take them.
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

/// The belly camera with its way.
struct Belly {
    renderer: Renderer,
    delay: ImageDelay,
    night: Option<NightExposure>,
}

/// The belly camera and the ultraviolet one, each with its way, where images take the place of the measurement models.
pub struct SimulatedCameras {
    belly: Option<Belly>,
    ultraviolet: Option<(Ultraviolet, ImageDelay)>,
}

impl SimulatedCameras {
    /// The cameras of a seed; None where measurement models stand for both.
    pub fn new(
        scenario: &Scenario,
        settings: &CameraSettings,
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
                night: (sensors.night.as_ref())
                    .map(|night| NightExposure::new(night, sensors.tag.exposure_s)),
            }),
            ultraviolet: render.markers.then(|| {
                (
                    Ultraviolet::new(&settings.uvdar, render.glints as usize, streams),
                    ImageDelay::new(sensors.uvdar.latency_s),
                )
            }),
        })
    }
    /// The belly camera's images that have arrived by `t`, of which these were begun now.
    pub fn belly(&mut self, t: Time<TrueTime>, shots: &[Shot]) -> CameraIn {
        let Some(belly) = &mut self.belly else {
            return CameraIn::default();
        };
        let render = |shot: &Shot| belly.renderer.image(shot);
        let input = match &mut belly.night {
            None => belly.delay.frames(t, shots, render),
            Some(night) => belly.delay.frames(t, &night.set(shots), render),
        };
        let exposed = belly.night.as_ref().map(NightExposure::exposed);
        CameraIn { exposed, ..input }
    }
    /// So many of them were looked at, and the newest shows this light.
    pub fn metered(&mut self, images: usize, light: &Light) {
        if let Some(night) = self.belly.as_mut().and_then(|b| b.night.as_mut()) {
            night.meter(images, light);
        }
    }
    /// Images of the ultraviolet camera.
    pub fn ultraviolet(&mut self, t: Time<TrueTime>, shots: &[Shot]) -> CameraIn {
        (self.ultraviolet.as_mut()).map_or_else(CameraIn::default, |(camera, delay)| {
            delay.frames(t, shots, |shot| camera.image(shot))
        })
    }
}

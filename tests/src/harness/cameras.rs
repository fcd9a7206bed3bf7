//! The drone's cameras in lock-step, at the edge of its rows: images are rendered and delivered after a delay.

use alight_shared::time::{Span, WorldTime};
use alight_uav::camera::{
    CameraFrame, CameraIn, CameraSettings, GreyImage,
    metering::{Exposed, Light, Metering, Setting},
};

use crate::{
    harness::scenario::Scenario,
    physics::streams::Streams,
    sensors::{
        camera::CameraMount,
        delay::DelayLine,
        night::NightConfig,
        render::{Renderer, Shot, ultraviolet::Ultraviolet},
    },
};

const MAX_UNDER_WAY: usize = 256;

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
    fn frames(
        &mut self,
        t: WorldTime,
        shots: &[Shot],
        mut render: impl FnMut(&Shot) -> Option<GreyImage>,
    ) -> CameraIn {
        for shot in shots {
            // A full delay line drops the newest image.
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

struct NightExposure {
    metering: Metering,
    /// Number of exposures begun; `metered` counts metered images.
    begun: u64,
    metered: u64,
}

impl NightExposure {
    fn new(night: &NightConfig, longest_s: f64) -> NightExposure {
        let [exposure_s, gain] = night.ranges(longest_s);
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
    fn meter(&mut self, images: usize, light: &Light) {
        if images > 0 {
            self.metered += images as u64;
            self.metering.step(self.metered, self.begun, light);
        }
    }
}

struct Belly {
    renderer: Renderer,
    delay: ImageDelay,
    night: Option<NightExposure>,
}

/// The belly and ultraviolet cameras and their links; their images replace the measurement models.
pub struct SimulatedCameras {
    belly: Option<Belly>,
    ultraviolet: Option<(Ultraviolet, ImageDelay)>,
}

impl SimulatedCameras {
    /// None if measurement models replace both cameras.
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
    /// Returns the belly camera's images that have arrived by `t`; the exposures `shots` begin now.
    pub fn belly(&mut self, t: WorldTime, shots: &[Shot]) -> CameraIn {
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
    pub fn metered(&mut self, images: usize, light: &Light) {
        if let Some(night) = self.belly.as_mut().and_then(|b| b.night.as_mut()) {
            night.meter(images, light);
        }
    }
    pub fn ultraviolet(&mut self, t: WorldTime, shots: &[Shot]) -> CameraIn {
        (self.ultraviolet.as_mut()).map_or_else(CameraIn::default, |(camera, delay)| {
            delay.frames(t, shots, |shot| camera.image(shot))
        })
    }
}

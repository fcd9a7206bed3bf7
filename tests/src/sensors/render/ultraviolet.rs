//! Images of the ultraviolet camera: dark except for the deck's blinking markers and glints on the water.

use alight_uav::camera::{
    GreyImage,
    uvdar::{UvdarSettings, blink::Code},
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::Shot;
use crate::{physics::streams::Streams, sensors::noise::Noise};

/// Light of a marker at 1 m, grey levels times pixels. Chosen: above the detection threshold up to 35 m.
const LIGHT: f64 = 6e5;
const SPOT_SD_PX: f64 = 1.0;
/// Radius of a spot, px.
const REACH_PX: i64 = 6;
/// Standard deviation of the sensor noise, grey levels.
const NOISE_SD: f64 = 3.0;
const BLACK: f64 = 8.0;

#[derive(Clone, Debug)]
pub struct Ultraviolet {
    settings: UvdarSettings,
    codes: Vec<Code>,
    uv_from_belly: UnitQuaternion<f64>,
    /// Phase of the markers' clock relative to the camera's, in bits, and its relative rate.
    phase: f64,
    faster: f64,
    glints: usize,
    noise: Noise,
    normals: Vec<f32>,
}

impl Ultraviolet {
    /// `glints` is the number of glints per image.
    pub fn new(settings: &UvdarSettings, glints: usize, streams: &Streams) -> Ultraviolet {
        let mut noise = Noise::new(streams, "drone.ultraviolet");
        Ultraviolet {
            codes: settings.parsed(),
            uv_from_belly: settings.belly_from_uv().inverse(),
            phase: 1000.0 * noise.uniform(),
            faster: 1e-5 * noise.normal(),
            glints,
            normals: (0..super::DRAWS).map(|_| noise.normal() as f32).collect(),
            noise,
            settings: settings.clone(),
        }
    }
    fn lit(&self, k: usize, shot: &Shot) -> f64 {
        let Some(code) = self.codes.get(k) else { return 0.0 };
        let bits = |s: f64| (shot.t.secs() + s) * self.settings.rate_hz * (1.0 + self.faster) + self.phase;
        let parts = 4;
        let lit = |i: i32| {
            let s = ((f64::from(i) + 0.5) / f64::from(parts) - 0.5) * shot.exposure_s;
            f64::from(u8::from(code.lit(bits(s).max(0.0) as u64)))
        };
        (0..parts).map(lit).sum::<f64>() / f64::from(parts)
    }
    /// None for a size that the configuration check rejects.
    pub fn image(&mut self, shot: &Shot) -> Option<GreyImage> {
        let lens = &self.settings.lens;
        let (width, height) = (lens.width_px as usize, lens.height_px as usize);
        let mut light = vec![0.0_f32; width * height];
        let centre = shot.view.to_camera_frame(shot.deck.position);
        let axes = shot.view.camera_from_world * shot.deck.attitude;
        let above = axes.down().0.dot(&centre) > 0.0;
        for (k, marker) in self.settings.markers_m.iter().enumerate() {
            let belly = axes.0 * Vector3::from(*marker) + centre - Vector3::from(self.settings.offset_m);
            let direction = self.uv_from_belly * belly;
            let range = direction.norm().max(0.3);
            if let (true, Some(px)) = (above, lens.project(&direction)) {
                spot(&mut light, width, px, LIGHT / (range * range) * self.lit(k, shot));
            }
        }
        for _ in 0..self.glints {
            let place = Vector2::new(
                self.noise.uniform() * width as f64,
                self.noise.uniform() * height as f64,
            );
            let strength = 3000.0 * self.noise.uniform().powi(3);
            spot(&mut light, width, place, strength);
        }
        let mut at = (self.noise.uniform() * super::DRAWS as f64) as usize;
        let stride = 2 * (self.noise.uniform() * (super::DRAWS / 2) as f64) as usize + 1;
        let pixels = light.iter().map(|l| {
            at = (at + stride) & (super::DRAWS - 1);
            let noise = self.normals.get(at).copied().unwrap_or(0.0) * NOISE_SD as f32;
            (l + BLACK as f32 + noise).clamp(0.0, 255.0) as u8
        });
        GreyImage::new(width, height, pixels.collect()).ok()
    }
}

fn spot(light: &mut [f32], width: usize, px: Vector2<f64>, strength: f64) {
    let (column, row) = (px.x.round() as i64, px.y.round() as i64);
    let norm = strength / (core::f64::consts::TAU * SPOT_SD_PX * SPOT_SD_PX);
    for y in row - REACH_PX..=row + REACH_PX {
        for x in column - REACH_PX..=column + REACH_PX {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else {
                continue;
            };
            if x >= width {
                continue;
            }
            if let Some(out) = light.get_mut(y * width + x) {
                let d2 = (x as f64 - px.x).powi(2) + (y as f64 - px.y).powi(2);
                *out += (norm * (-0.5 * d2 / (SPOT_SD_PX * SPOT_SD_PX)).exp()) as f32;
            }
        }
    }
}

//! Conversion of light to grey levels: scatter in the lens at night, and the sensor.

use alight_uav::camera::metering::Setting;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::{
    super::{
        camera::CameraMotion,
        night::{NightConfig, veil},
    },
    DRAWS, DeckInCamera, RenderConfig, Renderer, Shot,
    rays::Ray,
};

/// Side of the pixel squares between which scatter is computed, px.
const SQUARE_PX: usize = 16;
/// Fraction of the brightest square below which scatter is negligible.
const FAINT: f32 = 0.01;

pub(super) struct Sensor {
    /// Grey levels per unit of light.
    scale: f32,
    /// Noise variance in the dark, and its increase per grey level.
    dark: f32,
    shot: f32,
}

impl Sensor {
    /// By day light is a fraction of white, whose grey level is configured; at night exposure and gain
    /// determine the level.
    pub(super) fn of(config: &RenderConfig, night: Option<&NightConfig>, shot: &Shot) -> Sensor {
        let Some(night) = night else {
            return Sensor {
                scale: config.white as f32,
                dark: (config.dark_sd * config.dark_sd) as f32,
                shot: config.shot as f32,
            };
        };
        let Shot { exposure_s, gain, .. } = *shot;
        let dark = night.noise(0.0, gain, config.dark_sd).powi(2);
        Sensor {
            scale: night.grey_per_lux(&Setting { exposure_s, gain }) as f32,
            dark: dark as f32,
            shot: (night.noise(1.0, gain, config.dark_sd).powi(2) - dark) as f32,
        }
    }
}

/// The sun's mirror image on a wet deck.
pub(super) struct Glare {
    from: [f32; 3],
    peak: f32,
    width: f32,
}

impl Glare {
    /// Additional light along a direction at unit distance: Gaussian in the angle from the mirror image.
    pub(super) fn at(&self, [u, v]: [f32; 2]) -> f32 {
        let length = (u * u + v * v + 1.0).sqrt();
        let cos = (self.from[0] * u + self.from[1] * v + self.from[2]) / length;
        self.peak * ((cos - 1.0) / self.width).exp()
    }
}

fn direction(ray: &Ray) -> Vector3<f32> {
    Vector3::new(ray.at[0], ray.at[1], 1.0).normalize()
}

impl Renderer {
    /// None if the deck is dry.
    pub(super) fn glare_on(&self, view: &CameraMotion, deck_in_camera: &DeckInCamera) -> Option<Glare> {
        if !(self.config.glare > 0.0) || self.night.is_some() {
            return None;
        }
        let normal = deck_in_camera.axes * Vector3::z();
        let sun = (view.camera_from_world * self.sun).0;
        let from = sun - normal * (2.0 * sun.dot(&normal));
        Some(Glare {
            from: [from.x as f32, from.y as f32, from.z as f32],
            peak: self.config.glare as f32,
            width: self.config.glare_sd_deg.to_radians().powi(2) as f32,
        })
    }
    /// Converts light to grey levels in chunks of `band` pixels; the noise uses the draws from `start` on
    /// with a stride.
    pub(super) fn expose(
        &self,
        sensor: &Sensor,
        light: &[f32],
        [start, stride]: [usize; 2],
        band: usize,
        pixels: &mut [u8],
    ) {
        let bands = pixels.par_chunks_mut(band).zip(light.par_chunks(band));
        bands.enumerate().for_each(|(k, (pixels, light))| {
            let mut place = start + stride * k * band;
            for (pixel, light) in pixels.iter_mut().zip(light) {
                place = (place + stride) & (DRAWS - 1);
                let grey = (light * sensor.scale).max(0.0);
                let noise = self.normals.get(place).copied().unwrap_or(0.0);
                let noisy = grey + noise * (sensor.dark + sensor.shot * grey).sqrt();
                *pixel = (noisy + 0.5).clamp(0.0, 255.0) as u8;
            }
        });
    }
    /// Adds the lamp, and the light from scene and lamp that the lens scatters.
    pub(super) fn scatter(&self, night: &NightConfig, shot: &Shot, light: &mut [f32]) {
        let width = self.config.lens.width_px as usize;
        let own = self.own_scatter(light, width);
        let columns = width.div_ceil(SQUARE_PX);
        let deck = DeckInCamera::new(&shot.view, &shot.deck);
        let lamp = deck.axes * Vector3::from(night.lamp_m) + deck.at;
        let (to_lamp, at_lens) = (lamp.normalize().map(|v| v as f32), night.lamp_lux(lamp.norm()));
        let (surface_lux, lamp_m) = night.lamp_surface();
        let on = at_lens > 0.0 && lamp.z > 0.0;
        // A lamp smaller than a pixel lights that pixel alone.
        let radius = 0.5 * lamp_m / lamp.norm();
        let pixel = 0.7 / self.config.lens.focal_px[0];
        let core = (
            radius.max(pixel) as f32,
            (surface_lux * (radius / pixel).min(1.0).powi(2)) as f32,
        );
        light.par_chunks_mut(width).enumerate().for_each(|(row, light)| {
            for (column, light) in light.iter_mut().enumerate() {
                *light += own
                    .get(row / SQUARE_PX * columns + column / SQUARE_PX)
                    .copied()
                    .unwrap_or(0.0);
                if let Some(ray) = self.rays.all.get(row * width + column).filter(|_| on) {
                    let off = (direction(ray) - to_lamp).norm();
                    let lamp = if off < core.0 { core.1 } else { 0.0 };
                    *light += lamp + (at_lens * veil(f64::from(off))) as f32;
                }
            }
        });
    }
    /// Light scattered into each square from the others: `Σ veil(θ) ω E/π`, for light `E` and solid angle `ω`.
    fn own_scatter(&self, light: &[f32], width: usize) -> Vec<f32> {
        let (columns, rows) = (width.div_ceil(SQUARE_PX), light.len().div_ceil(width * SQUARE_PX));
        let height = light.len() / width.max(1);
        let square = |k: usize| {
            let (left, top) = (k % columns * SQUARE_PX, k / columns * SQUARE_PX);
            let (right, bottom) = ((left + SQUARE_PX).min(width), (top + SQUARE_PX).min(height));
            let row = |row: usize| light.get(row * width + left..row * width + right).unwrap_or(&[]);
            let sum: f32 = (top..bottom).map(|r| row(r).iter().sum::<f32>()).sum();
            let middle = (top + bottom) / 2 * width + (left + right) / 2;
            let toward = self.rays.all.get(middle).map_or_else(Vector3::z, direction);
            (toward, sum)
        };
        let squares: Vec<(Vector3<f32>, f32)> = (0..columns * rows).into_par_iter().map(square).collect();
        let brightest = squares.iter().map(|(_, sum)| *sum).fold(0.0, f32::max);
        let focal = self.config.lens.focal_px;
        let pixel = (1.0 / (core::f64::consts::PI * focal[0] * focal[1])) as f32;
        let sources: Vec<_> = squares
            .iter()
            .filter(|(_, sum)| *sum > FAINT * brightest)
            .collect();
        let into = |(at, _): &(Vector3<f32>, f32)| {
            let from = |(toward, sum): &&(Vector3<f32>, f32)| {
                // The solid angle of a pixel decreases with the cube of the cosine of the angle off axis.
                sum * toward.z.powi(3) * veil(f64::from((toward - at).norm())) as f32
            };
            pixel * sources.iter().map(from).sum::<f32>()
        };
        squares.par_iter().map(into).collect()
    }
}

//! Images of deck and sea from the belly camera: perspective, lens distortion, optical and motion blur, glare, sensor
//! noise. A pixel is the mean of rays that are distributed over its area and the optical blur, each at its own instant
//! of the exposure. The only data shared with the node that processes the images are the lens parameters.

mod light;
mod paint;
mod plane;
mod rays;
pub mod ultraviolet;

use alight_shared::{
    config,
    frames::{Deck, TrueNed, Vector},
    geometry::{DeckGeometry, DroneGeometry},
    time::{DroneClock, Time, TrueTime},
};
use alight_uav::camera::{GreyImage, Lens, metering::Setting};
use rayon::prelude::*;

use super::{
    camera::{CameraMotion, CameraMount},
    clocks::ClockModel,
    night::NightConfig,
    noise::{Noise, SampleSchedule},
    occlusion::{Occlusion, Shadow},
};
use crate::physics::{body::RigidState, streams::Streams};
use light::{Glare, Sensor};
use paint::{DeckPaint, Paint, Patch, SeaPaint, SeaScene};
use plane::{DeckInCamera, ToDeck};
use rays::{Pattern, Ray, RaySample, Rays};

config! {
    /// True parameters of camera and light.
    pub struct RenderConfig {
        /// Use images instead of the tags' measurement model.
        pub on: bool = false;
        /// Also use images instead of the UV markers' measurement model.
        pub markers: bool = false;
        /// Number of sun glints in an ultraviolet image.
        pub glints: u32 = 10, in 0.0..=1e4;
        /// True lens; the node uses a calibrated lens.
        pub lens: Lens;
        /// Grey level of a sunlit white surface; above 255 it is clipped.
        /// Chosen: a typical machine-vision sensor and a lens of moderate quality in daylight.
        pub white: f64 = 210.0, in 1.0..=1e4;
        /// Standard deviation of the optical blur, px.
        pub optics_sd_px: f64 = 0.6, in 0.0..=5.0;
        /// Standard deviation of the sensor noise in the dark, grey levels.
        pub dark_sd: f64 = 2.0, in 0.0..=50.0;
        /// Variance of the photon noise per grey level, grey levels.
        pub shot: f64 = 0.05, in 0.0..=10.0;
        /// Brightness of the sun's mirror image on a wet deck, as a fraction of white; 0: dry deck.
        pub glare: f64 = 0.0, in 0.0..=100.0;
        /// Width of the sun's mirror image (standard deviation), deg.
        pub glare_sd_deg: f64 = 8.0, in 0.5..=90.0;
        /// Elevation of the sun above the horizon, deg; its azimuth is drawn per seed.
        pub sun_height_deg: f64 = 50.0, in 0.0..=90.0;
    }
}

#[derive(Clone, Copy)]
pub struct Shot {
    /// Middle of the exposure.
    pub t: Time<TrueTime>,
    pub at: Time<DroneClock>,
    pub exposure_s: f64,
    /// Gain relative to the sensor's minimum gain; has no effect by day.
    pub gain: f64,
    pub view: CameraMotion,
    pub deck: RigidState<Deck>,
}

/// Within one world, shots at equal times are equal.
impl PartialEq for Shot {
    fn eq(&self, o: &Shot) -> bool {
        self.t == o.t
    }
}
impl core::fmt::Debug for Shot {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Shot({:?})", self.t)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Shutter {
    schedule: SampleSchedule,
    clock: ClockModel,
}

impl Shutter {
    pub(super) fn new(rate_hz: f64, clock: ClockModel) -> Shutter {
        Shutter {
            schedule: SampleSchedule::new(rate_hz),
            clock,
        }
    }
    /// Image that starts at `t` with this setting, if one is due.
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        view: &CameraMotion,
        deck: &RigidState<Deck>,
        setting: impl FnOnce() -> Setting,
    ) -> Vec<Shot> {
        let shot = |_| {
            let Setting { exposure_s, gain } = setting();
            Shot {
                t,
                at: self.clock.read(t),
                exposure_s,
                gain,
                view: *view,
                deck: *deck,
            }
        };
        self.schedule.due(t).map(shot).into_iter().collect()
    }
}

/// Number of sensor noise draws, which are reused in a different order for each image.
const DRAWS: usize = 1 << 14;

#[derive(Clone, Debug)]
pub struct Renderer {
    config: RenderConfig,
    rays: Rays,
    patterns: Vec<Pattern>,
    paint: DeckPaint,
    sea: SeaPaint,
    sun: Vector<TrueNed>,
    /// The drone, and a mask of the pixels that its legs hide.
    drone: Option<(Occlusion, Vec<bool>)>,
    /// Light is a fraction of white by day, lux on white by night.
    night: Option<NightConfig>,
    normals: Vec<f32>,
    noise: Noise,
}

/// Light from the sky in a shadow on a clear day, as a fraction of full light.
const SHADE: f32 = 0.2;
/// Light from a carbon leg, as a fraction of white.
const LEG: f32 = 0.04;

pub(super) fn sun(config: &RenderConfig, streams: &Streams) -> Vector<TrueNed> {
    sun_of(config, &mut Noise::new(streams, "light"))
}
fn sun_of(config: &RenderConfig, light: &mut Noise) -> Vector<TrueNed> {
    let (sin, cos) = config.sun_height_deg.to_radians().sin_cos();
    let (east, north) = (core::f64::consts::TAU * light.uniform()).sin_cos();
    Vector::new(cos * north, cos * east, -sin)
}

/// Maximum side of a block that is drawn at once, px.
const BLOCK_PX: usize = 16;
/// Maximum deviation of a straight line from straight within a block, px.
const BEND_PX: f32 = 0.5;

#[derive(Clone, Copy)]
struct Block {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Block {
    /// Quarters of a block, or halves of a line.
    fn parts(&self) -> impl Iterator<Item = Block> {
        let halves = |from: usize, to: usize| {
            let middle = from + (to - from) / 2;
            [Some((from, middle)), (middle < to).then_some((middle + 1, to))]
        };
        let rows = halves(self.top, self.bottom).into_iter().flatten();
        let columns = halves(self.left, self.right);
        rows.flat_map(move |(top, bottom)| {
            columns.into_iter().flatten().map(move |(left, right)| Block {
                left,
                top,
                right,
                bottom,
            })
        })
    }
}

struct Band<'a> {
    light: &'a mut [f32],
    top: usize,
    width: usize,
}

impl Band<'_> {
    /// Applies `each`, with the index in the image, to the pixels of a block that are in the band.
    fn pixels(&mut self, block: &Block, mut each: impl FnMut(usize, &mut f32)) {
        for row in block.top..=block.bottom {
            let from = (row - self.top) * self.width;
            let line = self.light.get_mut(from + block.left..=from + block.right);
            let place = row * self.width + block.left;
            let pixels = line.into_iter().flatten();
            pixels.zip(place..).for_each(|(out, k)| each(k, out));
        }
    }
}

struct Scene<'a> {
    sea: SeaScene<'a>,
    /// The deck, and the bounds of its pixels in the image: left, top, right, bottom.
    deck: Option<(DeckScene<'a>, [usize; 4])>,
}

struct DeckScene<'a> {
    deck: DeckInCamera,
    /// Rays, each with the deck at the ray's time.
    rays: Vec<(ToDeck, &'a RaySample)>,
    /// Maximum distance of a ray from the pixel's centre, px.
    reach_px: f32,
    blur_px: f64,
    shadow: Option<Shadow>,
    glare: Option<Glare>,
}

impl DeckScene<'_> {
    /// Deck at the start and end of the exposure.
    fn ends(&self) -> Option<[&ToDeck; 2]> {
        let time = |(_, sample): &&(ToDeck, &RaySample)| sample.time;
        let by_time = |a: &&(ToDeck, &RaySample), b: &&(ToDeck, &RaySample)| time(a).total_cmp(&time(b));
        let (first, last) = (
            self.rays.iter().min_by(by_time)?,
            self.rays.iter().max_by(by_time)?,
        );
        Some([&first.0, &last.0])
    }
    /// Light along a ray: paint lit by the sun, or by the sky alone in shadow, plus the sun's mirror image
    /// over a fraction of the pixel.
    fn lit(&self, ray: &Ray, paint: f32, fraction: f32) -> f32 {
        let in_shadow = |shadow: &Shadow| self.deck.meet(ray.at).is_some_and(|at| shadow.covers(at));
        let shade = if self.shadow.as_ref().is_some_and(in_shadow) {
            SHADE
        } else {
            1.0
        };
        let shine = self.glare.as_ref().map_or(0.0, |g| g.at(ray.at));
        paint * shade + shine * fraction
    }
}

impl Renderer {
    pub fn new(config: &RenderConfig, deck: &DeckGeometry, streams: &Streams) -> Renderer {
        let mut noise = Noise::new(streams, "drone.camera.pixels");
        let normals = (0..DRAWS).map(|_| noise.normal() as f32).collect();
        let mut light = Noise::new(streams, "light");
        let sun = sun_of(config, &mut light);
        Renderer {
            rays: Rays::new(&config.lens),
            patterns: (2..=5)
                .map(|n| Pattern::new(n, config.optics_sd_px, &mut light))
                .collect(),
            paint: DeckPaint::new(deck),
            sea: SeaPaint::new(&mut light),
            sun,
            drone: None,
            night: None,
            normals,
            noise,
            config: config.clone(),
        }
    }

    /// Adds the drone, which occludes and shades the scene.
    pub fn below(mut self, drone: &DroneGeometry, mount: &CameraMount) -> Renderer {
        let occlusion = Occlusion::new(drone, mount, self.sun);
        let lens = &self.config.lens;
        let [width, height] = [lens.width_px, lens.height_px].map(|s| s as usize);
        let mut covered = vec![false; width * height];
        for (at, radius) in &occlusion.legs {
            let [x, y] = self.rays.pixel(lens, at.x, at.y);
            let reach = radius * lens.focal_px[0];
            let span = |v: f64, size: usize| {
                let end = |v: f64| v.clamp(0.0, size as f64) as usize;
                end((v - reach).ceil())..end((v + reach).floor() + 1.0)
            };
            for row in span(y, height) {
                span(x, width).for_each(|column| covered[row * width + column] = true);
            }
        }
        self.drone = Some((occlusion, covered));
        self
    }
    pub fn at_night(mut self, night: Option<&NightConfig>) -> Renderer {
        if let Some(night) = night {
            self.paint = self.paint.at_night(night);
            self.night = Some(*night);
        }
        self
    }

    /// None for a size that the configuration check rejects.
    pub fn image(&mut self, shot: &Shot) -> Option<GreyImage> {
        let lens = &self.config.lens;
        let (width, height) = (lens.width_px as usize, lens.height_px as usize);
        let mut pixels = vec![0; width * height];
        self.render(shot, &mut pixels);
        GreyImage::new(width, height, pixels).ok()
    }
    /// Renders the image in rows from the top.
    pub fn render(&mut self, shot: &Shot, pixels: &mut [u8]) {
        let [width, height] = [self.config.lens.width_px, self.config.lens.height_px].map(|s| s as usize);
        // Each image uses the draws in a different order; an odd stride visits all of them.
        let start = (self.noise.uniform() * DRAWS as f64) as usize;
        let stride = 2 * (self.noise.uniform() * (DRAWS / 2) as f64) as usize + 1;
        let scene = self.scene(shot);
        let mut light = vec![0.0; width * height];
        let bands = light.par_chunks_mut(width * BLOCK_PX).enumerate();
        bands.for_each(|(k, light)| {
            let top = k * BLOCK_PX;
            self.draw(&mut Band { light, top, width }, &scene);
        });
        if let Some(night) = &self.night {
            self.scatter(night, shot, &mut light);
        }
        let sensor = Sensor::of(&self.config, self.night.as_ref(), shot);
        self.expose(&sensor, &light, [start, stride], width * BLOCK_PX, pixels);
    }

    fn scene(&self, shot: &Shot) -> Scene<'_> {
        let Shot {
            t,
            exposure_s,
            ref view,
            ref deck,
            ..
        } = *shot;
        let deck = self.deck_scene(view, deck, exposure_s);
        Scene {
            sea: self.sea.scene(view, self.sun, t.secs() as f32),
            deck: deck.and_then(|deck| {
                let bounds = self.bounds(&deck.deck, exposure_s, deck.blur_px)?;
                Some((deck, bounds))
            }),
        }
    }
    /// Draws the sea, the deck in front of it, and the legs in front of both.
    fn draw(&self, band: &mut Band, scene: &Scene) {
        let white = self.night.map_or(1.0, |night| night.scene_lux() as f32);
        let (width, rows) = (band.width, band.light.len() / band.width.max(1));
        for left in (0..width).step_by(BLOCK_PX) {
            let block = Block {
                left,
                top: band.top,
                right: (left + BLOCK_PX).min(width) - 1,
                bottom: band.top + rows - 1,
            };
            let shows = |[left, top, right, bottom]: &[usize; 4]| {
                block.left <= *right && *left <= block.right && block.top <= *bottom && *top <= block.bottom
            };
            let deck = scene.deck.as_ref().filter(|(_, bounds)| shows(bounds));
            let patch = deck.and_then(|(deck, _)| self.patch(deck, &block, width));
            if !patch.is_some_and(|p| self.paint.covers(&p)) {
                band.pixels(&block, |k, out| {
                    *out = self
                        .rays
                        .all
                        .get(k)
                        .map_or(0.0, |ray| white * scene.sea.light(ray));
                });
            }
            if let Some((deck, _)) = deck {
                self.draw_block(band, deck, &block);
            }
        }
        if let Some((_, covered)) = &self.drone {
            let covered = covered.iter().skip(band.top * width);
            let legs = band.light.iter_mut().zip(covered).filter(|(_, c)| **c);
            legs.for_each(|(light, _)| *light = white * LEG);
        }
    }
    /// None if the camera is not above the deck.
    fn deck_scene(
        &self,
        view: &CameraMotion,
        deck: &RigidState<Deck>,
        exposure_s: f64,
    ) -> Option<DeckScene<'_>> {
        let deck = DeckInCamera::new(view, deck);
        let focal = self.config.lens.focal_px[0];
        let distance = deck.at.norm().max(0.1);
        let cell_px = self.paint.min_cell_px(focal / distance);
        let speed = deck.drift.norm() / distance + deck.turn.norm();
        let blur_px = speed * exposure_s * focal;
        // Enough rays for small cells, and at least one per half pixel of motion blur.
        let side = if cell_px > 16.0 {
            2
        } else if cell_px > 5.0 {
            3
        } else {
            4
        };
        let side = side.max((2.0 * blur_px).sqrt().ceil().min(5.0) as usize);
        let pattern = self.patterns.iter().find(|p| p.side >= side)?;
        let deck_at = |ray: &'_ RaySample| {
            let (at, axes) = deck.after(ray.time * exposure_s);
            ToDeck::new(&at, &axes)
        };
        let rays: Option<Vec<_>> = pattern
            .rays
            .iter()
            .map(|ray| Some((deck_at(ray)?, ray)))
            .collect();
        Some(DeckScene {
            rays: rays?,
            reach_px: pattern.reach_px() + BEND_PX,
            blur_px,
            // At night light comes from all directions.
            shadow: (self.drone.as_ref().filter(|_| self.night.is_none()))
                .map(|(drone, _)| drone.shadow(view)),
            glare: self.glare_on(view, &deck),
            deck,
        })
    }

    /// Draws a block at once if all its rays meet the same light, otherwise in four parts.
    fn draw_block(&self, band: &mut Band, scene: &DeckScene, block: &Block) {
        let paint = self
            .patch(scene, block, band.width)
            .map_or(Paint::Edges, |p| self.paint.within(&p));
        match paint {
            Paint::Outside => {}
            Paint::Even(even) => band.pixels(block, |k, out| {
                if let Some(ray) = self.rays.all.get(k) {
                    *out = scene.lit(ray, even, 1.0);
                }
            }),
            Paint::Edges if block.right - block.left <= 1 && block.bottom - block.top <= 1 => {
                band.pixels(block, |k, out| {
                    if let Some(ray) = self.rays.all.get(k) {
                        self.draw_pixel(out, scene, ray);
                    }
                });
            }
            Paint::Edges => {
                for part in block.parts() {
                    self.draw_block(band, scene, &part);
                }
            }
        }
    }
    fn draw_pixel(&self, out: &mut f32, scene: &DeckScene, ray: &Ray) {
        let (mut sum, mut hits) = (0.0_f32, 0.0_f32);
        for (map, sample) in &scene.rays {
            let [u, v] = ray.moved(sample.right, sample.down);
            if let Some(bright) = map.meet(u, v).and_then(|[x, y]| self.paint.at(x, y)) {
                sum += bright;
                hits += 1.0;
            }
        }
        if hits > 0.0 {
            let fraction = 1.0 / scene.rays.len() as f32;
            *out = *out * (1.0 - hits * fraction) + scene.lit(ray, sum * fraction, hits * fraction);
        }
    }
    /// Area of the deck's plane under a block; None if a ray misses the plane.
    fn patch(&self, scene: &DeckScene, block: &Block, width: usize) -> Option<Patch> {
        let mut patch = Patch {
            x: [f32::INFINITY, f32::NEG_INFINITY],
            y: [f32::INFINITY, f32::NEG_INFINITY],
        };
        let (ends, reach) = (scene.ends()?, scene.reach_px);
        for (row, down) in [(block.top, -reach), (block.bottom, reach)] {
            for (column, right) in [(block.left, -reach), (block.right, reach)] {
                let [u, v] = self.rays.all.get(row * width + column)?.moved(right, down);
                for map in ends {
                    let [x, y] = map.meet(u, v)?;
                    patch.x = [patch.x[0].min(x), patch.x[1].max(x)];
                    patch.y = [patch.y[0].min(y), patch.y[1].max(y)];
                }
            }
        }
        Some(patch)
    }

    /// Bounds of the deck's pixels: left, top, right, bottom.
    fn bounds(&self, deck_in_camera: &DeckInCamera, exposure_s: f64, blur_px: f64) -> Option<[usize; 4]> {
        let lens = &self.config.lens;
        let whole = [0, 0, lens.width_px as usize - 1, lens.height_px as usize - 1];
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for s in [-0.5, 0.5] {
            let (at, axes) = deck_in_camera.after(s * exposure_s);
            for edge in self.paint.outline() {
                let p = axes * edge + at;
                if p.z < 0.05 {
                    return Some(whole);
                }
                let px = self.rays.pixel(lens, p.x / p.z, p.y / p.z);
                for i in 0..2 {
                    low[i] = low[i].min(px[i]);
                    high[i] = high[i].max(px[i]);
                }
            }
        }
        let margin = 4.0 + blur_px.min(50.0);
        let (right, bottom) = (whole[2] as f64, whole[3] as f64);
        if high[0] < -margin || high[1] < -margin || low[0] > right + margin || low[1] > bottom + margin {
            return None;
        }
        let within = |v: f64, max: f64| v.clamp(0.0, max) as usize;
        Some([
            within(low[0] - margin, right),
            within(low[1] - margin, bottom),
            within(high[0] + margin, right),
            within(high[1] + margin, bottom),
        ])
    }
}

#[cfg(test)]
mod tests;

//! Detector of the deck's fiducial tags: corners, noise, pose. Each tag is decoded independently, unless it
//! is partly outside the image, behind a leg or in the drone's shadow.
//!
//! The detection probability is fitted to the camera node on 4000 rendered images with random range, incidence and
//! motion (`study camera` at commit 2bb52893), the corner noise on 2000 such images with AprilTag 3.4.5. Two
//! quantities in the image predict them, px: the tag's narrowest width `w` (area over longest side), and its motion
//! `b` during the exposure.
//! Incidence needs no separate term because an oblique tag is narrow.
//!
//! ```text
//! chance = 1 / (1 + ((w0 + c b²) / w)^(1/s))
//! sd²    = corner² + (small min(1, (w1/w)⁴))² + (k b²/w)²
//! ```
//!
//! Maximum-likelihood fit: `w0` 13.3 px, `c` 0.27 /px, `s` 0.093; corner 0.046, small 0.17, `w1` 18 px, `k` 0.24.
//!
//! At night ([`super::night`]) the tag's contrast `c` (white minus black) and the noise `n` of a pixel add
//! two factors to the probability and a term to the corner noise:
//!
//! ```text
//! factor = 1 / (1 + exp((m0 - c/2) / m1)) · 1 / (1 + (r w^-0.23 n / c)^q)      sd² += (k n / c)²
//! ```
//!
//! `m0` is 16 grey levels, the detector's minimum margin before its sharpening by a quarter; `m1` is 0.5: all images
//! are decoded at `c/2` of 17, none at 9. Rendered images at 24 to 48 dB gave `r` 7.0, `q` 9, `k` 1.05.
//!
//! [`super::vision_loss`] models temporary covers of the tag.

use alight_shared::{
    config,
    frames::{Deck, Tag},
    geometry::DeckGeometry,
    msg::{CameraLight, MIN_GLARE, TagPose},
    tags::{DeckTag, Tags},
    time::{Time, TrueTime},
};
use alight_uav::camera::metering::Setting;
use nalgebra::{Vector2, Vector3};

use super::{
    camera::{CameraMotion, PinholeLens},
    night::{NightConfig, veil},
    noise::{Noise, Windows},
    occlusion::Occlusion,
    square_pose::{DetectedTag, corners, solve},
    vision_loss::{VisionLoss, VisionLossConfig},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// Tag detector and its camera.
    pub struct TagConfig {
        /// Frames per second.
        /// Source: 30 Hz, 50 ms latency, 1 px at 640 x 480.
        pub rate_hz: f64 = 30.0, in 0.1..=100.0;
        /// Delay from exposure to delivery, s.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// Image width, px.
        pub width_px: f64 = 640.0, in 16.0..=1e4;
        /// Image height, px.
        pub height_px: f64 = 480.0, in 16.0..=1e4;
        /// Horizontal field of view, deg.
        /// Chosen: a typical wide lens that is not a fisheye.
        pub fov_deg: f64 = 90.0, in 10.0..=150.0;
        /// Noise of each corner coordinate of a large, sharp tag, px.
        /// Source: 0.046 on rendered images; larger here because real lenses are imperfectly calibrated and
        /// paint is not flat. The error of the camera's mount is far larger.
        pub corner_sd_px: f64 = 0.1, in 1e-6..=20.0;
        /// Standard deviation added (root sum of squares) for tags of at most [`TagConfig::small_width_px`], px.
        /// Source: rendered images, as for the next five keys.
        pub small_sd_px: f64 = 0.17, in 0.0..=20.0;
        /// Width above which `small_sd_px` decreases with the fourth power of the width, px.
        pub small_width_px: f64 = 18.0, in 1.0..=1e4;
        /// Standard deviation due to motion, as a fraction of blur²/width.
        pub blur_sd: f64 = 0.24, in 0.0..=20.0;
        /// Minimum standard deviation that the detector reports, px.
        /// Source: the camera node reports 0.15 for a large, sharp tag. Chosen: larger, to be conservative.
        pub stated_sd_px: f64 = 0.2, in 1e-6..=20.0;
        /// Standard deviation that the detector assumes for the positions of several tags, per axis, m.
        /// Source: the camera node.
        pub place_sd_m: f64 = 0.002, in 0.0..=0.1;
        /// Tags in the camera node's configuration; empty: the true tags. Set when the world is drawn.
        #[serde(skip)]
        pub known: Tags = Tags::new();
        /// Width at which half of the frames are decoded, px. It limits the range and, since an oblique view
        /// narrows the tag, the incidence.
        pub min_width_px: f64 = 13.3, in 1.0..=1e4;
        /// Spread of that limit (logistic in the logarithm of the width); 0: a step.
        pub width_spread: f64 = 0.093, in 0.0..=10.0;
        /// Increase of that limit per px of squared blur.
        pub blur_cost_per_px: f64 = 0.27, in 0.0..=100.0;
        /// Maximum angle between the line of sight and the tag's normal, deg.
        /// Source: maximum in the rendered images.
        pub max_incidence_deg: f64 = 80.0, in 1.0..=89.0;
        /// Minimum distance along the optical axis that is in focus, m.
        /// Source: circle of confusion `f a (1/d - 1/s)`. A focal length of 320 px, an aperture of 0.7 mm (1.9 mm
        /// f/2.8) and a focus at 1 m cause a blur of 1.6 px at 0.12 m, a tenth of the smallest tag's cell.
        pub min_distance_m: f64 = 0.12, in 0.01..=100.0;
        /// Exposure, s.
        pub exposure_s: f64 = 0.004, in 0.0..=0.1;
        /// Maximum motion of the tag in the image during the exposure, px.
        pub max_blur_px: f64 = 20.0, in 0.1..=1e3;
        /// Temporary losses of the tag by glare, spray or a cover.
        pub loss: VisionLossConfig;
        /// Windows `[start, end)` without detections, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

#[derive(Clone, Debug)]
pub(crate) struct SimulatedTagDetector {
    config: TagConfig,
    lens: PinholeLens,
    /// True tags, and the tags in the camera node's configuration.
    tags: Tags,
    known: Tags,
    occlusion: Option<Occlusion>,
    night: Option<NightConfig>,
    corner: Noise,
    loss: VisionLoss,
    read: Noise,
}

impl SimulatedTagDetector {
    /// Uses the random streams `NAME.corner` and `NAME.read`.
    pub(crate) fn new(config: &TagConfig, deck: &DeckGeometry, name: &str, streams: &Streams) -> Self {
        SimulatedTagDetector {
            lens: PinholeLens::new(config.width_px, config.height_px, config.fov_deg.to_radians()),
            tags: deck.tags(),
            known: if config.known.is_empty() {
                deck.tags()
            } else {
                config.known
            },
            occlusion: None,
            night: None,
            corner: Noise::new(streams, &format!("{name}.corner")),
            loss: VisionLoss::new(&config.loss, streams),
            read: Noise::new(streams, &format!("{name}.read")),
            config: config.clone(),
        }
    }
    /// Adds occlusion by the drone.
    pub(crate) fn below(self, occlusion: Occlusion) -> Self {
        SimulatedTagDetector {
            occlusion: Some(occlusion),
            ..self
        }
    }
    pub(crate) fn at_night(self, night: Option<&NightConfig>) -> Self {
        SimulatedTagDetector {
            night: night.copied(),
            ..self
        }
    }
    /// Exposure and gain for this view: fixed by day, from metering on the tags' light at night.
    pub(crate) fn setting(&self, view: &CameraMotion, deck: &RigidState<Deck>) -> Setting {
        let tag_views: Vec<_> = self.tag_views(view, deck).into_iter().flatten().collect();
        self.converged_setting(&tag_views)
    }
    /// None by day.
    pub(crate) fn light(&self, view: &CameraMotion, deck: &RigidState<Deck>) -> Option<CameraLight> {
        let night = self.night.as_ref()?;
        let tag_views: Vec<_> = self.tag_views(view, deck).into_iter().flatten().collect();
        let setting = self.converged_setting(&tag_views);
        let grey = |lux: f64| (lux * night.grey_per_lux(&setting)).min(255.0);
        let [white, black] = night.tag_lux();
        // A tag with its margin is half white; the deck is half as bright as white, the sea a quarter.
        let tag = |s: &TagView| grey(0.5 * (white + black) + s.veil_lux);
        let brightest = tag_views
            .iter()
            .map(tag)
            .fold(grey(0.5 * night.scene_lux()), f64::max);
        let lamp = night.lamp_lux(1.0) > 0.0 && self.lamp(view, deck).z > 0.0;
        Some(CameraLight {
            mean: grey(0.25 * night.scene_lux()),
            exposure_s: Some(setting.exposure_s),
            dark: night.at_limit(&setting, self.config.exposure_s) && !lamp && brightest < MIN_MARGIN,
            glare: self.glare(night, &setting, &tag_views, self.lamp(view, deck)),
            ..CameraLight::default()
        })
    }
    /// Fraction of the image that the lamp at `lamp` (camera axes, m) saturates if its veil prevents all
    /// decoding: a circle up to the angle at which `pi VEIL E / angle²` is 255 grey levels.
    fn glare(
        &self,
        night: &NightConfig,
        setting: &Setting,
        tag_views: &[TagView],
        lamp: Vector3<f64>,
    ) -> Option<f64> {
        let lost = tag_views
            .iter()
            .all(|s| self.image(s, setting).chance < MIN_CHANCE);
        let grey_at_1_rad = night.lamp_lux(lamp.norm()) * veil(1.0) * night.grey_per_lux(setting);
        let radius_px = self.lens.focal_px * (grey_at_1_rad / 255.0).sqrt();
        let circle_px2 = core::f64::consts::PI * radius_px * radius_px;
        let part = (circle_px2 / (self.config.width_px * self.config.height_px)).min(1.0);
        let in_image = lamp.z > 0.0 && self.lens.project(lamp).is_some_and(|px| self.lens.holds(px));
        (lost && in_image && part > MIN_GLARE).then_some(part)
    }
    /// Lamp in camera axes, m.
    fn lamp(&self, view: &CameraMotion, deck: &RigidState<Deck>) -> Vector3<f64> {
        let lamp_m = self.night.map_or([0.0; 3], |night| night.lamp_m);
        view.to_camera_frame(deck.at::<Deck>(Vector3::from(lamp_m)).position)
    }
    /// Views of all tags; None for a tag that is not completely in the image.
    fn tag_views(&self, view: &CameraMotion, deck: &RigidState<Deck>) -> Vec<Option<TagView>> {
        self.tags
            .iter()
            .map(|tag| self.tag_view(view, deck, tag))
            .collect()
    }
    fn converged_setting(&self, tag_views: &[TagView]) -> Setting {
        let max_exposure_s = self.config.exposure_s;
        let Some(night) = &self.night else {
            return Setting {
                exposure_s: max_exposure_s,
                gain: 1.0,
            };
        };
        let largest = tag_views.iter().max_by(|a, b| a.width.total_cmp(&b.width));
        // Without a tag the mean is metered: a third of the white's level, from a quarter of its light.
        let white_lux = largest.map_or(0.75 * night.scene_lux(), |s| night.tag_lux()[0] + s.veil_lux);
        night.auto_exposure(white_lux, max_exposure_s)
    }
    pub(crate) fn detect(
        &mut self,
        t: Time<TrueTime>,
        view: &CameraMotion,
        deck: &RigidState<Deck>,
    ) -> Option<TagPose> {
        let hidden = self.loss.hides(t);
        let tag_views = self.tag_views(view, deck);
        let shown: Vec<_> = tag_views.iter().flatten().copied().collect();
        let setting = self.converged_setting(&shown);
        let detected: Vec<DetectedTag> = (0..self.tags.len())
            .filter_map(|k| {
                // Drawn even without a detection, so that planners experience the same noise at the same time.
                let noise: [Vector2<f64>; 4] =
                    core::array::from_fn(|_| Vector2::new(self.corner.normal(), self.corner.normal()));
                let luck = self.read.uniform();
                let tag_view = tag_views.get(k)?.as_ref()?;
                let image = Some(self.image(tag_view, &setting)).filter(|i| !hidden && luck < i.chance)?;
                self.measure(self.known.get(k)?, &image, &noise)
            })
            .collect();
        let s = solve(&detected)?;
        let q = s.attitude.quaternion();
        Some(TagPose {
            position: s.position.into(),
            attitude: [q.w, q.i, q.j, q.k],
            variance: s.variance.into(),
            ..TagPose::default()
        })
    }
    /// None if the tag cannot be decoded at all.
    #[cfg(test)]
    pub(super) fn image_of(
        &self,
        view: &CameraMotion,
        deck: &RigidState<Deck>,
        tag: &DeckTag,
    ) -> Option<TagImage> {
        let tag_view = self.tag_view(view, deck, tag)?;
        let setting = self.converged_setting(&[tag_view]);
        (tag_view.speed_pxps * setting.exposure_s <= self.config.max_blur_px)
            .then(|| self.image(&tag_view, &setting))
    }
    /// None if the tag is not completely in the image.
    fn tag_view(&self, view: &CameraMotion, deck: &RigidState<Deck>, tag: &DeckTag) -> Option<TagView> {
        let state = deck.at::<Tag>(Vector3::from(tag.centre_m));
        let centre = view.to_camera_frame(state.position);
        let rotation = view.camera_from_world * state.attitude;
        // The printed face points to the tag's -z.
        let cos_incidence = rotation.down().0.dot(&centre) / centre.norm();
        if !(centre.z >= self.config.min_distance_m)
            || !(cos_incidence >= self.config.max_incidence_deg.to_radians().cos())
        {
            return None;
        }
        let mut pixels = [Vector2::zeros(); 4];
        let corners = corners(tag.side_m).map(|corner| rotation.0 * corner + centre);
        for (px, corner) in pixels.iter_mut().zip(corners) {
            *px = self.lens.project(corner)?;
            if !self.lens.holds(*px) {
                return None;
            }
        }
        if let Some(drone) = &self.occlusion {
            // The shadow is far larger than a small tag, and far away while a larger tag is completely in the image.
            let points = corners.into_iter().chain([centre]);
            let shadow = drone.shadow(view);
            // At night light comes from all directions.
            let shaded = self.night.is_none() && points.into_iter().any(|p| shadow.covers(p));
            if shaded || drone.covers(&corners.map(|p| p.xy() / p.z)) {
                return None;
            }
        }
        let moves = view.drift(centre, state.velocity);
        let speed_pxps =
            (moves.xy() - centre.xy() * (moves.z / centre.z)).norm() * self.lens.focal_px / centre.z;
        let width = width(&pixels);
        Some(TagView {
            pixels,
            width,
            speed_pxps,
            veil_lux: self.night.map_or(0.0, |night| {
                let lamp = self.lamp(view, deck);
                let own_deg = (0.5 * width / self.lens.focal_px).to_degrees();
                let in_view = f64::from(u8::from(lamp.z > 0.0));
                OWN_VEIL * (1.0 + own_deg).ln() * night.tag_lux()[0]
                    + in_view * night.lamp_lux(lamp.norm()) * veil(lamp.angle(&centre))
            }),
        })
    }
    fn image(&self, tag_view: &TagView, setting: &Setting) -> TagImage {
        let (width, blur) = (tag_view.width, tag_view.speed_pxps * setting.exposure_s);
        let night = self.night.map(|night| {
            let grey = |lux: f64| ((lux + tag_view.veil_lux) * night.grey_per_lux(setting)).min(255.0);
            let [white, black] = night.tag_lux().map(grey);
            let noise = night.noise(0.5 * (white + black), setting.gain, DARK_SD);
            (white - black, noise / (white - black).max(1e-6))
        });
        let (factor, noise_px) = night.map_or((1.0, 0.0), |(contrast, noise)| {
            let margin = 1.0 / (1.0 + ((MIN_MARGIN - 0.5 * contrast) / MARGIN_SPREAD).exp());
            let clear =
                1.0 / (1.0 + (NOISE_LIMIT * width.max(1.0).powf(NOISE_WIDTH) * noise).powf(NOISE_STEEPNESS));
            (margin * clear, CORNER_NOISE * noise)
        });
        // A larger blur is outside the range of the fit.
        let chance = if blur <= self.config.max_blur_px {
            self.config.chance(width, blur) * factor
        } else {
            0.0
        };
        TagImage {
            pixels: tag_view.pixels,
            chance,
            sd_px: self.config.sd_px(width, blur).hypot(noise_px),
        }
    }
    /// Noisy corners, and the noise that the detector reports for them.
    fn measure(&self, known: &DeckTag, image: &TagImage, noise: &[Vector2<f64>; 4]) -> Option<DetectedTag> {
        let measured: [Vector2<f64>; 4] =
            core::array::from_fn(|i| self.lens.normalised(image.pixels[i] + noise[i] * image.sd_px));
        let stated = image.sd_px.max(self.config.stated_sd_px) / self.lens.focal_px;
        let place = self.config.place_sd_m * width(&image.pixels) / (self.lens.focal_px * known.side_m);
        let sd = if self.known.len() > 1 {
            stated.hypot(place)
        } else {
            stated
        };
        Some(DetectedTag {
            tag: *known,
            image: measured,
            sd,
        })
    }
}

/// Half the contrast at which half of the tags are decoded, grey levels, and its logistic spread.
const MIN_MARGIN: f64 = 16.0;
const MARGIN_SPREAD: f64 = 0.5;
const MIN_CHANCE: f64 = 0.05;
/// Contrast-to-noise ratio at which half of the tags of 1 px are decoded, the exponent of its decrease with
/// the width, and the steepness.
const NOISE_LIMIT: f64 = 7.0;
const NOISE_WIDTH: f64 = -0.23;
const NOISE_STEEPNESS: f64 = 9.0;
/// Corner error per noise-to-contrast ratio, px.
const CORNER_NOISE: f64 = 0.75;
/// Noise in the dark, grey levels, as in rendered images.
const DARK_SD: f64 = 2.0;
/// Scatter of a tag's own white over half its square, per logarithm of its half width in degrees: `10 · 0.52
/// · 2π (π/180)²`.
const OWN_VEIL: f64 = 0.01;

#[derive(Clone, Copy, Debug)]
struct TagView {
    /// True corners, px.
    pixels: [Vector2<f64>; 4],
    /// Narrowest width, px.
    width: f64,
    /// Speed of the centre, px/s.
    speed_pxps: f64,
    /// Light scattered over the tag by lamp and tag at night, lux on white.
    veil_lux: f64,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct TagImage {
    /// True corners, px.
    pixels: [Vector2<f64>; 4],
    pub(crate) chance: f64,
    /// Noise of each corner coordinate.
    pub(crate) sd_px: f64,
}

impl TagConfig {
    fn chance(&self, width_px: f64, blur_px: f64) -> f64 {
        let need = self.min_width_px + self.blur_cost_per_px * blur_px.powi(2);
        let steep = 1.0 / self.width_spread.max(1e-9);
        1.0 / (1.0 + ((need / width_px.max(1e-9)).ln() * steep).exp())
    }
    fn sd_px(&self, width_px: f64, blur_px: f64) -> f64 {
        let width = width_px.max(1.0);
        let small = self.small_sd_px * (self.small_width_px / width).powi(4).min(1.0);
        let blur = self.blur_sd * blur_px.powi(2) / width;
        self.corner_sd_px.hypot(small).hypot(blur)
    }
}

/// Narrowest width of a quadrilateral, px: area over longest side.
fn width(p: &[Vector2<f64>; 4]) -> f64 {
    let longest = (0..4)
        .map(|i| (p[(i + 1) % 4] - p[i]).norm())
        .fold(f64::MIN_POSITIVE, f64::max);
    0.5 * (p[2] - p[0]).perp(&(p[3] - p[1])).abs() / longest
}

//! The detector of the deck's fiducial tags: corners, noise, pose. Each tag is decoded or not by itself; one that is partly
//! outside of the image, behind a leg or touched by the drone's shadow is not.
//!
//! Chance of a detection and noise of the corners follow the camera node on rendered images
//! (`studies::camera`): 4000 of them at random over range, incidence and motion. Two measures of the
//! image tell it: the tag's narrowest width in it `w` (area over longest side) and its motion during the
//! exposure `b`, both in px. Incidence needs nothing of its own, because an oblique tag is a narrow one.
//!
//! ```text
//! chance = 1 / (1 + ((w0 + c b²) / w)^(1/s))
//! sd²    = corner² + (small min(1, (w1/w)⁴))² + (k b²/w)²
//! ```
//!
//! Maximum likelihood gave `w0` 13.3 px, `c` 0.27 /px, `s` 0.093; corner 0.072, small 0.229, `w1`
//! 16.1 px, `k` 0.198. Not in it is what hides the tag for a while, of which [`super::sight_loss`] has a model of
//! its own.

use alight_shared::config;
use alight_shared::frames::{Deck, Tag};
use alight_shared::geometry::DeckGeometry;
use alight_shared::msg::TagPose;
use alight_shared::tags::{DeckTag, Tags};
use alight_shared::time::{Time, TrueTime};
use nalgebra::{Vector2, Vector3};

use super::camera::{Lens, View};
use super::noise::{Noise, Windows};
use super::occlusion::Occlusion;
use super::sight_loss::{SightLoss, SightLossConfig};
use super::square_pose::{SeenTag, corners, solve};
use crate::physics::body::RigidState;
use crate::physics::streams::Streams;

config! {
    /// The tag detector and its camera.
    pub struct TagConfig {
        /// Frames per second.
        /// Source: 30 Hz, 50 ms late, 1 px at 640 x 480.
        pub rate_hz: f64 = 30.0, in 0.1..=100.0;
        /// From exposure to delivery, s.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// Image width, px.
        pub width_px: f64 = 640.0, in 16.0..=1e4;
        /// Image height, px.
        pub height_px: f64 = 480.0, in 16.0..=1e4;
        /// Horizontal field of view, deg.
        /// Chosen: a usual wide lens without fisheye.
        pub fov_deg: f64 = 90.0, in 10.0..=150.0;
        /// Noise of each coordinate of each corner of a large, sharp tag, px.
        /// Source: Rendered images give 0.072 to a large, sharp tag. More, because no lens is
        /// calibrated perfectly and no paint is flat; the camera's mount is wrong by far more than
        /// that.
        pub corner_sd_px: f64 = 0.1, in 1e-6..=20.0;
        /// What is added to it (root of squares) for a tag of [`TagConfig::small_width_px`] or less, px.
        /// Source: Rendered images, these six.
        pub small_sd_px: f64 = 0.23, in 0.0..=20.0;
        /// Width in the image from which on that falls with the fourth power of the width, px.
        pub small_width_px: f64 = 16.0, in 1.0..=1e4;
        /// What motion adds, as a share of blur²/width.
        pub blur_sd: f64 = 0.2, in 0.0..=20.0;
        /// The detector states at least this much, px.
        /// Source: The camera node states 0.15 for a large, sharp tag; ours, on the safe side of
        /// it.
        pub stated_sd_px: f64 = 0.2, in 1e-6..=20.0;
        /// How exactly the detector takes several tags to lie where it has them, m, each axis.
        /// Source: the camera node's.
        pub place_sd_m: f64 = 0.002, in 0.0..=0.1;
        /// The tags as the camera's node has them; none: as they are. Of what is drawn.
        #[serde(skip)]
        pub known: Tags = Tags::new();
        /// Narrowest width of the tag in the image at which half of the frames are decoded, px: this limits
        /// range and, with the width that an oblique view leaves, incidence.
        pub min_width_px: f64 = 13.3, in 1.0..=1e4;
        /// Spread of that limit (logistic in the logarithm of the width); 0: all or nothing.
        pub width_spread: f64 = 0.093, in 0.0..=10.0;
        /// By how much blur raises it, per px of squared blur.
        pub blur_cost_per_px: f64 = 0.27, in 0.0..=100.0;
        /// Largest angle between the line of sight and the tag's normal, deg.
        /// Source: As far as images were rendered.
        pub max_incidence_deg: f64 = 80.0, in 1.0..=89.0;
        /// Shortest distance along the optical axis that is in focus, m.
        /// Source: circle of confusion `f a (1/d - 1/s)`: 320 px of focal length, an aperture of 0.7 mm (1.9 mm f/2.8) and
        /// focus at 1 m blur by 1.6 px at 0.12 m, a tenth of a cell of the smallest tag there.
        pub min_distance_m: f64 = 0.12, in 0.01..=100.0;
        /// Exposure, s.
        pub exposure_s: f64 = 0.004, in 0.0..=0.1;
        /// Largest motion of the tag in the image during the exposure, px.
        pub max_blur_px: f64 = 20.0, in 0.1..=1e3;
        /// What hides the tag for a while: glare, spray, a cover.
        pub loss: SightLossConfig;
        /// Windows `[start, end)` without detections, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

/// The tag detector at work.
#[derive(Clone, Debug)]
pub(crate) struct TagDetector {
    config: TagConfig,
    lens: Lens,
    /// As they are, and as the camera's node has them.
    tags: Tags,
    known: Tags,
    occlusion: Option<Occlusion>,
    corner: Noise,
    loss: SightLoss,
    read: Noise,
}

impl TagDetector {
    /// With the streams `NAME.corner` and `NAME.read`.
    pub(crate) fn new(config: &TagConfig, deck: &DeckGeometry, name: &str, streams: &Streams) -> Self {
        TagDetector {
            lens: Lens::new(config.width_px, config.height_px, config.fov_deg.to_radians()),
            tags: deck.tags(),
            known: if config.known.is_empty() {
                deck.tags()
            } else {
                config.known
            },
            occlusion: None,
            corner: Noise::new(streams, &format!("{name}.corner")),
            loss: SightLoss::new(&config.loss, streams),
            read: Noise::new(streams, &format!("{name}.read")),
            config: config.clone(),
        }
    }
    /// The same below a drone that hides part of the deck.
    pub(crate) fn below(self, occlusion: Occlusion) -> Self {
        TagDetector {
            occlusion: Some(occlusion),
            ..self
        }
    }
    /// The detection in the image of `t`.
    pub(crate) fn detect(
        &mut self,
        t: Time<TrueTime>,
        view: &View,
        deck: &RigidState<Deck>,
    ) -> Option<TagPose> {
        let hidden = self.loss.hides(t);
        let seen: Vec<SeenTag> = (0..self.tags.len())
            .filter_map(|k| {
                // The noise of a frame is drawn whether the tag is detected or not: two planners meet the same
                // noise at the same time.
                let noise: [Vector2<f64>; 4] =
                    core::array::from_fn(|_| Vector2::new(self.corner.normal(), self.corner.normal()));
                let luck = self.read.uniform();
                let tag = self.tags.get(k)?;
                let image = self
                    .image(view, deck, tag)
                    .filter(|i| !hidden && luck < i.chance)?;
                self.measure(self.known.get(k)?, &image, &noise)
            })
            .collect();
        let s = solve(&seen)?;
        let q = s.attitude.quaternion();
        Some(TagPose {
            position: s.position.into(),
            attitude: [q.w, q.i, q.j, q.k],
            variance: s.variance.into(),
            ..TagPose::default()
        })
    }
    /// A tag in an image; None when it cannot be decoded at all.
    pub(crate) fn image(&self, view: &View, deck: &RigidState<Deck>, tag: &DeckTag) -> Option<TagImage> {
        let state = deck.at::<Tag>(Vector3::from(tag.centre_m));
        let centre = view.to_camera_frame(state.position);
        let rotation = view.camera_from_world * state.attitude;
        // The printed face looks along -z of the tag.
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
            // Shadow is far larger than a tag of a few centimetres, and far away where a larger one is seen whole.
            let points = corners.into_iter().chain([centre]);
            let shadow = drone.shadow(view);
            let shaded = points.into_iter().any(|p| shadow.covers(p));
            if shaded || drone.covers(&corners.map(|p| p.xy() / p.z)) {
                return None;
            }
        }
        let moves = view.drift(centre, state.velocity);
        let blur = (moves.xy() - centre.xy() * (moves.z / centre.z)).norm() * self.lens.focal_px / centre.z
            * self.config.exposure_s;
        let width = width(&pixels);
        (blur <= self.config.max_blur_px).then(|| TagImage {
            pixels,
            chance: self.config.chance(width, blur),
            sd_px: self.config.sd_px(width, blur),
        })
    }
    /// What the detector makes of it: noisy corners, and the noise that it states of them.
    fn measure(&self, known: &DeckTag, image: &TagImage, noise: &[Vector2<f64>; 4]) -> Option<SeenTag> {
        let measured: [Vector2<f64>; 4] =
            core::array::from_fn(|i| self.lens.normalised(image.pixels[i] + noise[i] * image.sd_px));
        let stated = image.sd_px.max(self.config.stated_sd_px) / self.lens.focal_px;
        let place = self.config.place_sd_m * width(&image.pixels) / (self.lens.focal_px * known.side_m);
        let sd = if self.known.len() > 1 {
            stated.hypot(place)
        } else {
            stated
        };
        Some(SeenTag {
            tag: *known,
            image: measured,
            sd,
        })
    }
}

/// The tag as an image holds it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TagImage {
    /// Its corners' true pixels.
    pixels: [Vector2<f64>; 4],
    /// Chance that it is decoded.
    pub(crate) chance: f64,
    /// Noise of each coordinate of each corner, px.
    pub(crate) sd_px: f64,
}

impl TagConfig {
    /// Chance that a tag of that width with that blur is decoded.
    fn chance(&self, width_px: f64, blur_px: f64) -> f64 {
        let need = self.min_width_px + self.blur_cost_per_px * blur_px.powi(2);
        // A spread of nothing is a step.
        let steep = 1.0 / self.width_spread.max(1e-9);
        1.0 / (1.0 + ((need / width_px.max(1e-9)).ln() * steep).exp())
    }
    /// Noise of its corners, px.
    fn sd_px(&self, width_px: f64, blur_px: f64) -> f64 {
        let width = width_px.max(1.0);
        let small = self.small_sd_px * (self.small_width_px / width).powi(4).min(1.0);
        let blur = self.blur_sd * blur_px.powi(2) / width;
        self.corner_sd_px.hypot(small).hypot(blur)
    }
}

/// Narrowest width of a quadrilateral: its area over its longest side, px.
fn width(p: &[Vector2<f64>; 4]) -> f64 {
    let longest = (0..4)
        .map(|i| (p[(i + 1) % 4] - p[i]).norm())
        .fold(f64::MIN_POSITIVE, f64::max);
    0.5 * (p[2] - p[0]).perp(&(p[3] - p[1])).abs() / longest
}

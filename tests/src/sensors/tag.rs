//! The detector of the deck's fiducial tag: corners, noise, pose.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::frames::{Deck, Tag};
use alight_shared::geometry::DeckGeometry;
use alight_shared::msg::{Header, TagPose};
use alight_shared::time::{Span, Time, TrueTime};
use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::camera::{Lens, View};
use super::clocks::Clocks;
use super::delay::DelayLine;
use super::noise::{Noise, Schedule, check_windows, covers};
use super::square_pose::{corners, solve};
use super::{Identity, QUEUE};
use crate::body::RigidState;
use crate::streams::Streams;

/// The tag detector and its camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TagConfig {
    /// Frames per second.
    pub rate_hz: f64,
    /// From exposure to delivery, s.
    pub latency_s: f64,
    /// Image width, px.
    pub width_px: f64,
    /// Image height, px.
    pub height_px: f64,
    /// Horizontal field of view, deg.
    pub fov_deg: f64,
    /// Noise of each coordinate of each corner, px.
    pub corner_sd_px: f64,
    /// Shortest side of the tag in the image that is still decoded, px: this limits the range.
    pub min_side_px: f64,
    /// Largest angle between the line of sight and the tag's normal, deg.
    pub max_incidence_deg: f64,
    /// Shortest distance along the optical axis that is in focus, m.
    pub min_distance_m: f64,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Largest motion of the tag in the image during the exposure, px.
    pub max_blur_px: f64,
    /// Probability that a frame is missed for no reason that is modelled (glare, spray, shadow).
    pub miss: f64,
    /// Windows `[start, end)` without detections, s of true time.
    pub outages_s: Vec<[f64; 2]>,
}

impl Default for TagConfig {
    fn default() -> Self {
        TagConfig {
            // Issue 2: 30 Hz, 50 ms late, 1 px at 640 x 480.
            rate_hz: 30.0,
            latency_s: 0.05,
            width_px: 640.0,
            height_px: 480.0,
            // Ours: a usual wide lens without fisheye.
            fov_deg: 90.0,
            corner_sd_px: 1.0,
            // Ours: a tag36h11 has 8 cells across its black square; under two pixels a cell it is
            // lost. 14 px is 23 m for a side of 1 m.
            min_side_px: 14.0,
            // Ours.
            max_incidence_deg: 70.0,
            min_distance_m: 0.25,
            exposure_s: 0.004,
            max_blur_px: 6.0,
            miss: 0.03,
            outages_s: Vec::new(),
        }
    }
}
impl Check for TagConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("rate_hz", self.rate_hz, 0.1, 100.0)?;
        at.range("latency_s", self.latency_s, 0.0, 2.0)?;
        at.range("width_px", self.width_px, 16.0, 1e4)?;
        at.range("height_px", self.height_px, 16.0, 1e4)?;
        at.range("fov_deg", self.fov_deg, 10.0, 150.0)?;
        at.range("corner_sd_px", self.corner_sd_px, 1e-6, 20.0)?;
        at.range("min_side_px", self.min_side_px, 1.0, 1e4)?;
        at.range("max_incidence_deg", self.max_incidence_deg, 1.0, 89.0)?;
        at.range("min_distance_m", self.min_distance_m, 0.01, 100.0)?;
        at.range("exposure_s", self.exposure_s, 0.0, 0.1)?;
        at.range("max_blur_px", self.max_blur_px, 0.1, 1e3)?;
        at.range("miss", self.miss, 0.0, 1.0)?;
        check_windows(at, "outages_s", &self.outages_s)
    }
}

/// The tag detector at work.
#[derive(Clone, Debug)]
pub(crate) struct TagDetector {
    config: TagConfig,
    lens: Lens,
    side: f64,
    centre: Vector3<f64>,
    corner: Noise,
    miss: Noise,
    schedule: Schedule,
    sequence: u32,
    line: DelayLine<TagPose>,
}

impl TagDetector {
    pub(crate) fn new(config: &TagConfig, deck: &DeckGeometry, streams: &Streams) -> Self {
        TagDetector {
            lens: Lens::new(config.width_px, config.height_px, config.fov_deg.to_radians()),
            side: deck.tag_side_m,
            centre: Vector3::from(deck.tag_centre_m),
            corner: Noise::new(streams, "drone.tag.corner"),
            miss: Noise::new(streams, "drone.tag.miss"),
            schedule: Schedule::new(config.rate_hz),
            sequence: 0,
            line: DelayLine::new(QUEUE),
            config: config.clone(),
        }
    }
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        view: &View,
        deck: &RigidState<Deck>,
        id: &Identity,
        clocks: &Clocks,
    ) -> Vec<TagPose> {
        if self.schedule.due(t).is_some()
            && let Some(pose) = self.sight(t, view, deck)
        {
            let sighting = TagPose {
                header: Header::new(id.vessel, id.drone, id.boot, self.sequence, clocks.drone_time(t)),
                ..pose
            };
            self.sequence = self.sequence.wrapping_add(1);
            self.line
                .push(t + Span::from_secs(self.config.latency_s), sighting);
        }
        self.line.arrived(t)
    }
    /// One image's sighting.
    pub(crate) fn sight(
        &mut self,
        t: Time<TrueTime>,
        view: &View,
        deck: &RigidState<Deck>,
    ) -> Option<TagPose> {
        // The noise of a frame is drawn whether the tag is seen or not: two planners meet the same
        // noise at the same time.
        let noise: [Vector2<f64>; 4] =
            core::array::from_fn(|_| Vector2::new(self.corner.normal(), self.corner.normal()));
        let missed = self.miss.chance(self.config.miss);
        if missed || covers(&self.config.outages_s, t) {
            return None;
        }
        let tag = deck.at::<Tag>(self.centre);
        self.measure(&self.visible(view, &tag)?, &noise)
    }
    /// The corners' true pixels, when the tag can be decoded.
    fn visible(&self, view: &View, tag: &RigidState<Tag>) -> Option<[Vector2<f64>; 4]> {
        let centre = view.sees(tag.position);
        let rotation = view.camera_from_world * tag.attitude;
        // The printed face looks along -z of the tag.
        let cos_incidence = rotation.down().0.dot(&centre) / centre.norm();
        if !(centre.z >= self.config.min_distance_m)
            || !(cos_incidence >= self.config.max_incidence_deg.to_radians().cos())
        {
            return None;
        }
        let mut pixels = [Vector2::zeros(); 4];
        for (px, corner) in pixels.iter_mut().zip(corners(self.side)) {
            *px = self.lens.project(rotation.0 * corner + centre)?;
            if !self.lens.holds(*px) {
                return None;
            }
        }
        let shortest = (0..4)
            .map(|i| (pixels[(i + 1) % 4] - pixels[i]).norm())
            .fold(f64::INFINITY, f64::min);
        let moves = view.drift(centre, tag.velocity);
        let blur = (moves.xy() - centre.xy() * (moves.z / centre.z)).norm() * self.lens.focal_px / centre.z
            * self.config.exposure_s;
        (shortest >= self.config.min_side_px && blur <= self.config.max_blur_px).then_some(pixels)
    }
    /// The pose from noisy corners.
    fn measure(&self, pixels: &[Vector2<f64>; 4], noise: &[Vector2<f64>; 4]) -> Option<TagPose> {
        let sd = self.config.corner_sd_px;
        let image: [Vector2<f64>; 4] =
            core::array::from_fn(|i| self.lens.normalised(pixels[i] + noise[i] * sd));
        let s = solve(self.side, &image, sd / self.lens.focal_px)?;
        let q = s.attitude.quaternion();
        Some(TagPose {
            position: s.position.into(),
            attitude: [q.w, q.i, q.j, q.k],
            variance: s.variance.into(),
            ..TagPose::default()
        })
    }
}

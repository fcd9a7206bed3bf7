//! Camera node: deck pose and covariance from the tags in images.

use alight_shared::{
    bus::wiring,
    geometry::DeckGeometry,
    msg::{CameraLight, Header, TagPose},
    node::Node,
    tags::Tags,
    time::{DroneClock, Span, Time},
};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    CameraSettings, Lens, decks,
    detector::{TagCounts, TagDetection, TagDetector, TagSettings},
    image::{CameraFrame, GreyImage},
    light::{ImageLight, TagLight, mean_level},
    marked::MarkedImage,
    metering::{Exposed, Light},
    motion_blur::width_px,
    square_pose::{DetectedTag, solve},
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CameraIdentity {
    pub vessel: u32,
    pub drone: u32,
    pub boot: u32,
}

/// Identity of the camera, and the images that it has processed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exposures {
    identity: CameraIdentity,
    sequence: u32,
    last: Option<Time<DroneClock>>,
}

impl Exposures {
    pub(super) fn of(identity: CameraIdentity) -> Exposures {
        Exposures {
            identity,
            sequence: 0,
            last: None,
        }
    }
    /// Accepts each image once, in the order of exposure.
    pub(super) fn accept(&mut self, now: Time<DroneClock>, at: Time<DroneClock>) -> bool {
        let accepted = at <= now && self.last.is_none_or(|last| at > last);
        if accepted {
            self.last = Some(at);
        }
        accepted
    }
    pub(super) fn header(&mut self, at: Time<DroneClock>) -> Header<DroneClock> {
        let CameraIdentity { vessel, drone, boot } = self.identity;
        let header = Header::new(vessel, drone, boot, self.sequence, at);
        self.sequence = self.sequence.wrapping_add(1);
        header
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraIn {
    pub frames: Vec<CameraFrame>,
    /// Exposure of the newest image; None if the drone does not control it.
    pub exposed: Option<Exposed>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraOut {
    pub tags: Vec<TagPose>,
    /// Light in the newest image, twice a second.
    pub light: Option<CameraLight>,
}

wiring! {
    CameraPorts of CameraNode: CameraIn => CameraOut {
        reads {}
        edge { frames, exposed }
        writes { tags: TagPose, light: CameraLight }
        wakes {}
    }
}

const LIGHT_PERIOD: Span = Span::from_millis(500);

pub struct CameraNode {
    lens: Lens,
    mount: UnitQuaternion<f64>,
    tag: TagSettings,
    /// Standard deviation of the tags' positions on the deck, m; 0 for a single tag, because that tag defines the deck.
    place_sd_m: f64,
    detector: TagDetector,
    exposures: Exposures,
    newest: Newest,
    /// Newest image that differs from the one before.
    previous: Option<GreyImage>,
    reports: Exposures,
}

#[derive(Default)]
struct Newest {
    tags: Vec<TagDetection>,
    pose: Option<TagPose>,
    image: ImageLight,
}

impl CameraNode {
    pub fn new(settings: &CameraSettings, tags: &Tags, identity: CameraIdentity) -> CameraNode {
        CameraNode {
            lens: settings.lens,
            mount: settings.mount().0,
            tag: settings.tag.clone(),
            place_sd_m: if tags.len() > 1 {
                settings.tag.place_sd_m
            } else {
                0.0
            },
            detector: TagDetector::new(&settings.tag, tags),
            exposures: Exposures::of(identity),
            newest: Newest::default(),
            previous: None,
            reports: Exposures::of(identity),
        }
    }
    /// Light on the largest tag in the newest image, or of the whole image if there is no tag.
    pub fn light(&self) -> Light {
        self.tag_light()
            .map_or(Light::Image(self.newest.image), Light::Tag)
    }
    pub fn tag_light(&self) -> Option<TagLight> {
        let width = |d: &TagDetection| width_px(&d.corners);
        let largest = self
            .newest
            .tags
            .iter()
            .max_by(|a, b| width(a).total_cmp(&width(b)));
        largest.map(|d| d.light)
    }
    /// Reduced copy of `frame` with the detected tags and the deck; None unless it is the newest processed image.
    pub fn marked(&self, frame: &CameraFrame, deck: &DeckGeometry) -> Option<MarkedImage> {
        if self.exposures.last != Some(frame.at) {
            return None;
        }
        let mut marked = MarkedImage::of(&frame.image);
        if let Some(pose) = &self.newest.pose {
            // The pose is in the axes of the designed camera, the image in those of the mounted one.
            let [w, i, j, k] = pose.attitude;
            let back = self.mount.inverse();
            let attitude = back * UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
            let position = back * Vector3::from(pose.position);
            marked.draw_outline(deck, |p| self.lens.project_inside(&(attitude * p + position)));
        }
        self.newest
            .tags
            .iter()
            .for_each(|tag| marked.draw_tag(&tag.corners));
        Some(marked)
    }
    pub fn counts(&self) -> TagCounts {
        self.detector.counts
    }
    /// Deck pose in an image; if there are several decks, that of the deck with the largest tag.
    pub fn detect(&mut self, image: &GreyImage) -> Option<TagPose> {
        self.decks(image).first().copied()
    }
    /// Poses of all decks in an image, starting with the deck of the largest tag.
    pub fn decks(&mut self, image: &GreyImage) -> Vec<TagPose> {
        self.newest = Newest {
            image: ImageLight::of(image),
            ..Newest::default()
        };
        if !image.has_size(self.lens.width_px, self.lens.height_px) {
            self.detector.counts.wrong_size += 1;
            return Vec::new();
        }
        let tags = self.detector.find(image);
        let detected = tags.iter().filter_map(|d| self.placed(d)).collect();
        let poses: Vec<TagPose> = decks::apart(detected)
            .into_iter()
            .filter_map(|deck| self.common_pose(deck))
            .collect();
        (self.newest.tags, self.newest.pose) = (tags, poses.first().copied());
        poses
    }
    fn report(&mut self, frame: &CameraFrame, exposed: Option<Exposed>) -> Option<CameraLight> {
        let due = self
            .reports
            .last
            .is_none_or(|last| frame.at - last >= LIGHT_PERIOD);
        if self.exposures.last != Some(frame.at) || !due {
            return None;
        }
        self.reports.last = Some(frame.at);
        // An unknown exposure counts as being at its limit.
        let at_limit = exposed.is_none_or(|e| e.at_limit);
        let undetected = self.newest.tags.is_empty();
        Some(CameraLight {
            header: self.reports.header(frame.at),
            mean: mean_level(&frame.image),
            exposure_s: exposed.map(|e| e.setting.exposure_s),
            dark: at_limit && undetected && self.newest.image.is_dark(self.tag.min_margin),
            glare: self.newest.image.glare().filter(|_| undetected),
        })
    }
    /// Deck pose from the corners of its tags, excluding tags that do not fit a common pose.
    fn common_pose(&mut self, mut detected: Vec<DetectedTag>) -> Option<TagPose> {
        while !detected.is_empty() {
            if let Some(pose) = self.pose(&detected) {
                self.detector.counts.detected += 1;
                return Some(pose);
            }
            self.detector.counts.misfit += 1;
            let without = |k: usize| {
                let others: Vec<DetectedTag> = (detected.iter().enumerate())
                    .filter_map(|(i, s)| (i != k).then_some(*s))
                    .collect();
                solve(&others).map_or(f64::INFINITY, |s| s.misfit)
            };
            let odd = (0..detected.len())
                .map(|k| (k, without(k)))
                .min_by(|a, b| a.1.total_cmp(&b.1))?;
            detected.remove(odd.0);
        }
        None
    }
    /// Detection at unit distance. Its noise includes the uncertainty of the tag's position on the deck.
    fn placed(&self, detection: &TagDetection) -> Option<DetectedTag> {
        let mut image = [Vector2::zeros(); 4];
        // All corners have the same weight, set by the largest pixel at unit distance.
        let mut pixel = 0.0_f64;
        for (n, px) in image.iter_mut().zip(&detection.corners) {
            *n = self.lens.normalised(*px)?;
            pixel = pixel.max(self.lens.pixel_size(*n)?);
        }
        let place_sd = self.place_sd_m * width_px(&image) / detection.tag.side_m;
        let sd = (corner_sd_px(&self.tag, detection) * pixel).hypot(place_sd);
        Some(DetectedTag {
            tag: detection.tag,
            image,
            sd,
        })
    }
    fn pose(&self, detected: &[DetectedTag]) -> Option<TagPose> {
        let s = solve(detected)?;
        // Eight coordinates per tag minus the pose's six, so a single tag leaves two degrees of freedom.
        let freedom = 8.0 * detected.len() as f64 - 6.0;
        // Limit of equal tail probability for more degrees of freedom (Laurent and Massart 2000, lemma 1).
        let more = freedom - 2.0;
        let most = self.tag.max_misfit + more + (2.0 * more * self.tag.max_misfit).sqrt();
        if !(s.misfit <= most) {
            return None;
        }
        // A misfit in excess of the corner noise, from glare or motion, inflates all variances.
        let inflation = (s.misfit / freedom).max(1.0);
        let variance = s.variance * inflation;
        let position = self.mount * s.position;
        let attitude = self.mount * s.attitude;
        let turn = self.mount.to_rotation_matrix().into_inner();
        let turned = |v: Vector3<f64>| turn.component_mul(&turn) * v;
        let moved = turned(variance.fixed_rows::<3>(0).into_owned());
        let tilted = turned(variance.fixed_rows::<3>(3).into_owned());
        Some(TagPose {
            position: position.into(),
            attitude: [attitude.w, attitude.i, attitude.j, attitude.k],
            variance: [moved.x, moved.y, moved.z, tilted.x, tilted.y, tilted.z],
            ..TagPose::default()
        })
    }
}

/// Standard deviation of each corner coordinate, px: `sd² = corner² + (fraction side)² + (small min(1,
/// (w1/w)⁴))² + (k b²/w)²`, with the tag's longest side, its minimum width `w` and the motion blur `b` in the
/// image, px. The form follows rendered images over range, incidence and motion.
fn corner_sd_px(tag: &TagSettings, detection: &TagDetection) -> f64 {
    let [a, b, c, d] = detection.corners;
    let side = [b - a, c - b, d - c, a - d]
        .iter()
        .fold(0.0, |most: f64, side| most.max(side.norm()));
    let width = width_px(&detection.corners).max(1.0);
    let small = tag.small_sd_px * (tag.small_width_px / width).powi(4).min(1.0);
    let motion_blur = tag.motion_blur_sd * detection.motion_blur_px2 / width;
    tag.corner_sd_px
        .hypot(tag.corner_sd_fraction * side)
        .hypot(small)
        .hypot(motion_blur)
}

impl Node for CameraNode {
    type Clock = DroneClock;
    type In = CameraIn;
    type Out = CameraOut;

    fn step(&mut self, now: Time<DroneClock>, input: &CameraIn) -> CameraOut {
        let mut out = CameraOut::default();
        for CameraFrame { at, image } in &input.frames {
            if self.exposures.accept(now, *at) {
                // Noise differs between images, so an identical image shows where the deck was before.
                let repeated = self.previous.as_ref() == Some(image);
                let poses = self.decks(image);
                if repeated {
                    self.detector.counts.repeated += u64::from(!poses.is_empty());
                    continue;
                }
                self.previous = Some(image.clone());
                for pose in poses {
                    let header = self.exposures.header(*at);
                    out.tags.push(TagPose { header, ..pose });
                }
            }
        }
        out.light = (input.frames.last()).and_then(|newest| self.report(newest, input.exposed));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::{super::square_pose::corners_of, *};
    use alight_shared::tags::DeckTag;

    #[test]
    fn pose_without_a_loose_tag() {
        let tags = DeckGeometry::default().tags();
        let settings = CameraSettings::default();
        let identity = CameraIdentity {
            vessel: 1,
            drone: 1,
            boot: 1,
        };
        let mut node = CameraNode::new(&settings, &tags, identity);
        let (at, turn) = (
            Vector3::new(0.1, -0.05, 2.5),
            UnitQuaternion::from_euler_angles(0.05, 0.1, 1.5),
        );
        // Tag 2 lies 3 cm from its nominal place.
        let mut loose = tags;
        loose[2].centre_m[0] += 0.03;
        let detected: Vec<TagDetection> = (loose.iter().zip(tags.iter()).take(6))
            .map(|(lies, known)| TagDetection {
                tag: *known,
                corners: corners_of(lies).map(|p| settings.lens.project(&(turn * p + at)).unwrap()),
                wrong_bits: 0,
                margin: 100.0,
                motion_blur_px2: 0.0,
                light: TagLight::default(),
            })
            .collect();
        let placed: Vec<DetectedTag> = detected.iter().filter_map(|d| node.placed(d)).collect();
        let pose = node.common_pose(placed.clone()).unwrap();
        assert!((Vector3::from(pose.position) - at).norm() < 1e-4, "{pose:?}");
        assert_eq!((node.counts().detected, node.counts().misfit), (1, 1));
        // The pose from all tags is more accurate than that from the best tag alone.
        let alone = node.common_pose(placed[..1].to_vec()).unwrap();
        assert!(pose.variance[5] < 0.5 * alone.variance[5]);
    }

    #[test]
    fn reports_of_the_light_twice_a_second() {
        use super::super::metering::Setting;
        let tags = DeckGeometry::default().tags();
        let settings = CameraSettings::default();
        let identity = CameraIdentity {
            vessel: 1,
            drone: 1,
            boot: 1,
        };
        let mut node = CameraNode::new(&settings, &tags, identity);
        let mut look = |ms: i64, level: u8, at_limit: Option<bool>| {
            let setting = Setting {
                exposure_s: 0.004,
                gain: 16.0,
            };
            let at = Time::from_nanos(ms * 1_000_000);
            let image = GreyImage::new(640, 480, vec![level; 640 * 480]).unwrap();
            let input = CameraIn {
                frames: vec![CameraFrame { at, image }],
                exposed: at_limit.map(|at_limit| Exposed { setting, at_limit }),
            };
            node.step(at, &input).light
        };
        // The image is dark, with exposure and gain at their limits.
        let first = look(1000, 3, Some(true)).unwrap();
        assert!(
            first.dark && (first.mean, first.exposure_s) == (3.0, Some(0.004)),
            "{first:?}"
        );
        assert_eq!(look(1033, 3, Some(true)), None);
        // The exposure can still increase; the drone does not control it; the image is bright enough.
        for (k, level, at_limit, dark) in [
            (3, 3, Some(false), false),
            (4, 3, None, true),
            (5, 40, Some(true), false),
            (6, 255, Some(true), false),
        ] {
            let light = look(500 * k, level, at_limit).unwrap();
            assert_eq!(light.glare.is_some(), level == 255, "{light:?}");
            assert_eq!(
                (light.dark, light.header.sequence),
                (dark, k as u32 - 2),
                "{light:?}"
            );
        }
    }

    #[test]
    fn corner_sd_of_small_and_blurred_tags() {
        let tag = TagSettings::default();
        let sd = |side: f64, motion_blur_px2: f64| {
            let corners = [[0.0, side], [0.0, 0.0], [side, 0.0], [side, side]].map(Vector2::from);
            let detection = TagDetection {
                tag: DeckTag::default(),
                corners,
                wrong_bits: 0,
                margin: 100.0,
                motion_blur_px2,
                light: TagLight::default(),
            };
            corner_sd_px(&tag, &detection)
        };
        assert!((sd(100.0, 0.0) / tag.corner_sd_px - 1.0).abs() < 0.01);
        assert!(sd(14.0, 0.0) > 2.0 * sd(40.0, 0.0));
        // 10 px of motion across a tag of 80 px.
        assert!((0.35..0.45).contains(&sd(80.0, 100.0)), "{}", sd(80.0, 100.0));
        assert!(sd(40.0, 100.0) > 1.5 * sd(80.0, 100.0));
    }
}

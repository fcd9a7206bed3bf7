//! Detections of the tag by the belly camera in rendered images, compared with the measurement model that stands
//! for it in lock-step: range, incidence, blur, glare, false sightings.

use alight_shared::estimation::quantile;
use alight_shared::frames::{Camera, Deck, Point, Rotation, TrueNed, Vector};
use alight_shared::geometry::DeckGeometry;
use alight_shared::msg::TagPose;
use alight_shared::tags::DeckTag;
use alight_shared::time::Time;
use alight_uav::camera::node::CameraIdentity;
use alight_uav::camera::{CameraNode, CameraSettings, GreyImage};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::Serialize;

use crate::physics::body::RigidState;
use crate::physics::streams::Streams;
use crate::sensors::SensorConfig;
use crate::sensors::camera::CameraMotion;
use crate::sensors::noise::Noise;
use crate::sensors::render::{Renderer, Shot};
use crate::sensors::sight_loss::SightLossConfig;
use crate::sensors::square_pose::corners;
use crate::sensors::tag::{SimulatedTagDetector, TagConfig};

/// One cell of a table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Condition {
    /// From the camera to the tag's centre, m.
    pub range_m: f64,
    /// Between the line of sight and the tag's normal, deg.
    pub incidence_deg: f64,
    /// Motion in the image during the exposure, px.
    pub blur_px: f64,
    /// The sun's mirror image, as a share of white.
    pub glare: f64,
}

impl Default for Condition {
    /// The easiest one.
    fn default() -> Self {
        Condition {
            range_m: 4.0,
            incidence_deg: 20.0,
            blur_px: 0.5,
            glare: 0.0,
        }
    }
}

/// Quality of measured poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Quality {
    /// Fraction of the images in which the tag was detected.
    pub rate: f64,
    /// Mean position error, m.
    pub position_m: f64,
    /// 95 % of position errors are smaller, m.
    pub position_p95_m: f64,
    /// Mean attitude error, deg.
    pub attitude_deg: f64,
    /// Squared error over stated variance, mean of the three axes of position; 1 when consistent.
    pub nees_position: f64,
    /// Squared error over stated variance, mean of the three axes of attitude; 1 when consistent.
    pub nees_attitude: f64,
}

/// One row: detections in rendered images, and those of the model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraRow {
    /// Condition of the row.
    pub condition: Condition,
    /// Images.
    pub images: usize,
    /// The node on rendered images.
    pub pixels: Quality,
    /// The measurement model.
    pub model: Quality,
    /// Root mean square error of a corner's coordinate in the images, px.
    pub corner_rms_px: f64,
    /// The model's corner error in images in which it would detect the tag, px.
    pub model_corner_px: f64,
    /// Share of the images in which the model would see it.
    pub model_rate: f64,
}

/// Fit of the model to rows of rendered images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ModelFit {
    /// Root mean square difference of the fraction of images in which the tag is detected.
    pub rate: f64,
    /// Geometric mean of the model's corner noise over that in the images; rows where both see the tag
    /// in a fifth of the images at least.
    pub corner: f64,
    /// Factor that holds two thirds of the rows' ratios about that mean.
    pub corner_spread: f64,
    /// Geometric mean of the ratios of the mean position errors.
    pub position: f64,
    /// Spread of those ratios about their mean.
    pub position_spread: f64,
    /// Rows that were compared so.
    pub rows: usize,
}

impl ModelFit {
    /// Over rows; those with glare are left out, of which the model knows nothing.
    pub fn of(rows: &[CameraRow]) -> ModelFit {
        let dry: Vec<&CameraRow> = rows.iter().filter(|r| r.condition.glare <= 0.0).collect();
        let n = dry.len().max(1) as f64;
        let rate = dry
            .iter()
            .map(|r| (r.model_rate - r.pixels.rate).powi(2))
            .sum::<f64>()
            / n;
        let both: Vec<&&CameraRow> = dry
            .iter()
            .filter(|r| r.pixels.rate.min(r.model.rate) >= 0.2)
            .collect();
        let spread = |of: &dyn Fn(&CameraRow) -> f64| {
            let m = both.len().max(1) as f64;
            let logs: Vec<f64> = both.iter().map(|r| of(r).max(1e-9).ln()).collect();
            let mean = logs.iter().sum::<f64>() / m;
            let var = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / m;
            (mean.exp(), var.sqrt().exp())
        };
        let (corner, corner_spread) = spread(&|r| r.model_corner_px / r.corner_rms_px.max(1e-9));
        let (position, position_spread) = spread(&|r| r.model.position_m / r.pixels.position_m.max(1e-9));
        ModelFit {
            rate: rate.sqrt(),
            corner,
            corner_spread,
            position,
            position_spread,
            rows: both.len(),
        }
    }
}

/// The deck with one tag alone.
pub(super) fn alone(deck: &DeckGeometry) -> DeckGeometry {
    DeckGeometry {
        tag_side_m: deck.tag_side_m.or(Some(1.0)),
        ..*deck
    }
}

/// The camera, its node and its model.
pub struct CameraBench {
    renderer: Renderer,
    node: CameraNode,
    model: SimulatedTagDetector,
    sensors: SensorConfig,
    tag: DeckTag,
    draw: Noise,
}

impl CameraBench {
    /// Everything of one seed; `sensors` is the camera as it is. One tag lies on the deck alone, of a metre where the deck
    /// has several.
    pub fn new(
        sensors: &SensorConfig,
        settings: &CameraSettings,
        deck: &DeckGeometry,
        seed: u64,
    ) -> CameraBench {
        let streams = Streams::new(seed);
        let names = CameraIdentity {
            vessel: 1,
            drone: 1,
            boot: 1,
        };
        // As nothing hides the tag of the rendered images either.
        let in_sight = TagConfig {
            loss: SightLossConfig::none(),
            ..sensors.tag.clone()
        };
        let deck = alone(deck);
        let tags = deck.tags();
        CameraBench {
            renderer: Renderer::new(&sensors.render, &deck, &streams).at_night(sensors.night.as_ref()),
            node: CameraNode::new(settings, &tags, names),
            model: SimulatedTagDetector::new(&in_sight, &deck, "drone.tag", &streams)
                .at_night(sensors.night.as_ref()),
            sensors: sensors.clone(),
            tag: tags.first().copied().unwrap_or_default(),
            draw: Noise::new(&streams, "study.camera"),
        }
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.draw.uniform()
    }

    /// A camera that looks at the tag, up to 10 deg off its axis but wholly in the image where it fits,
    /// from anywhere around it.
    pub fn shot(&mut self, c: &Condition) -> Shot {
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let yaw = self.within(-3.1, 3.1);
        let tilt_about = self.within(-3.1, 3.1);
        let tilt = self.within(0.0, 0.2);
        let deck = RigidState::<Deck> {
            position: Point::new(0.0, 0.0, -1.3),
            attitude: Rotation::from(
                turn(Vector3::new(tilt_about.cos(), tilt_about.sin(), 0.0), tilt) * turn(Vector3::z(), yaw),
            ),
            ..Default::default()
        };
        let centre = deck.at::<Deck>(Vector3::from(self.tag.centre_m)).position;
        // From the tag to the camera: its upward normal, leaned by the incidence.
        let about = self.within(-3.1, 3.1);
        let incidence = turn(
            Vector3::new(about.cos(), about.sin(), 0.0),
            c.incidence_deg.to_radians(),
        );
        let away = (deck.attitude * Vector::<Deck>::from(incidence * -Vector3::z())).0;
        let from = centre.0 + away * c.range_m;
        // The optical axis at the tag, then a little off, and any side up.
        let axis = -away;
        let side = axis.cross(&Vector3::new(0.3, 0.9, 0.1)).normalize();
        let world_from_camera = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[
            side,
            axis.cross(&side),
            axis,
        ]));
        let roll = turn(Vector3::z(), self.within(-3.1, 3.1));
        // Half the image's height less half the tag, as an angle.
        let half = 0.5 * self.sensors.tag.height_px / self.sensors.render.lens.focal_px[1];
        let room = (half - 0.75 * self.tag.side_m / c.range_m).clamp(0.0, 0.17);
        let off = turn(
            Vector3::new(self.within(-room, room), self.within(-room, room), 0.0),
            1.0,
        );
        let camera_from_world =
            off * roll * UnitQuaternion::from_rotation_matrix(&world_from_camera.inverse());
        let exposure_s = self.sensors.tag.exposure_s;
        let heading = self.within(-3.1, 3.1);
        let rate = c.blur_px / (exposure_s.max(1e-6) * self.sensors.render.lens.focal_px[0]);
        self.renderer_light(c, &deck, away);
        let t = Time::from_nanos((self.within(0.0, 600.0) * 1e9) as i64);
        let view = CameraMotion {
            centre: Point::from(from),
            velocity: Vector::zero(),
            camera_from_world: Rotation::from(camera_from_world),
            rates: Vector::new(rate * heading.cos(), rate * heading.sin(), 0.0),
        };
        let setting = self.model.setting(&view, &deck);
        Shot {
            t,
            at: Time::from_nanos(t.nanos()),
            exposure_s: setting.exposure_s,
            gain: setting.gain,
            view,
            deck,
        }
    }

    /// A sun whose mirror image in the deck is near the tag as the camera sees it.
    fn renderer_light(&mut self, c: &Condition, deck: &RigidState<Deck>, away: Vector3<f64>) {
        if !(c.glare > 0.0) {
            return;
        }
        let normal = deck.attitude.down().0;
        // The ray to the camera, mirrored: where light has to come from.
        let from = -(away - normal * (2.0 * away.dot(&normal)));
        let off = Vector3::new(self.draw.normal(), self.draw.normal(), self.draw.normal()) * 0.1;
        let sun = UnitQuaternion::from_scaled_axis(off) * from;
        self.renderer.lit_from(Vector::<TrueNed>::from(sun));
    }

    /// The rendered image.
    pub fn image(&mut self, shot: &Shot) -> Option<GreyImage> {
        self.renderer.image(shot)
    }
    /// The node.
    pub fn node(&mut self) -> &mut CameraNode {
        &mut self.node
    }

    /// `images` of a condition.
    pub fn row(&mut self, condition: &Condition, images: usize) -> CameraRow {
        self.renderer.set_glare(condition.glare);
        let (mut pixels, mut model) = (PoseErrors::default(), PoseErrors::default());
        let (mut square, mut count) = (0.0, 0.0);
        let (mut expected, mut chance) = (0.0, 0.0);
        for _ in 0..images {
            let shot = self.shot(condition);
            let truth = Truth::of(&shot);
            let detection = self
                .image(&shot)
                .map_or_else(Vec::new, |image| self.node.find(&image));
            if let Some(detected) = detection.first() {
                for (corner, at) in detected.corners.iter().zip(corners(self.tag.side_m)) {
                    let p = truth.attitude.0 * at + truth.position;
                    if let Some(px) = self.sensors.render.lens.project(&p) {
                        square += 0.5 * (corner - px).norm_squared();
                        count += 1.0;
                    }
                }
            }
            let pose = self.node.estimate_pose(&detection);
            pixels.add(pose.as_ref(), &truth);
            if let Some(modelled_image) = self.model.image_of(&shot.view, &shot.deck, &self.tag) {
                expected += modelled_image.chance * modelled_image.sd_px.powi(2);
                chance += modelled_image.chance;
            }
            let modelled = self.model.detect(shot.t, &shot.view, &shot.deck);
            model.add(modelled.as_ref(), &truth);
        }
        CameraRow {
            condition: *condition,
            images,
            pixels: pixels.quality(),
            model: model.quality(),
            corner_rms_px: (square / f64::max(count, 1.0)).sqrt(),
            model_corner_px: (expected / f64::max(chance, 1e-9)).sqrt(),
            model_rate: chance / images.max(1) as f64,
        }
    }

    /// Place of the tag's centre in an image, px, and the length of its side there.
    pub fn tag_px(&self, shot: &Shot) -> Option<([f64; 2], f64)> {
        let truth = Truth::of(shot);
        let px = self.sensors.render.lens.project(&truth.position)?;
        let side = self.tag.side_m * self.sensors.render.lens.focal_px[0] / truth.position.norm();
        Some((px.into(), side))
    }
}

struct Truth {
    position: Vector3<f64>,
    attitude: Rotation<Camera, Deck>,
}

impl Truth {
    fn of(shot: &Shot) -> Truth {
        Truth {
            position: shot.view.to_camera_frame(shot.deck.position),
            attitude: shot.view.camera_from_world * shot.deck.attitude,
        }
    }
}

#[derive(Default)]
struct PoseErrors {
    images: usize,
    position: Vec<f64>,
    attitude: Vec<f64>,
    nees: [f64; 2],
}

impl PoseErrors {
    fn add(&mut self, pose: Option<&TagPose>, truth: &Truth) {
        self.images += 1;
        let Some(pose) = pose else { return };
        let [w, x, y, z] = pose.attitude;
        let detected = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        let moved = Vector3::from(pose.position) - truth.position;
        let turned = (detected * truth.attitude.0.inverse()).scaled_axis();
        self.position.push(moved.norm());
        self.attitude.push(turned.norm().to_degrees());
        for i in 0..3 {
            self.nees[0] += moved[i].powi(2) / pose.variance[i] / 3.0;
            self.nees[1] += turned[i].powi(2) / pose.variance[i + 3] / 3.0;
        }
    }
    fn quality(mut self) -> Quality {
        let size = self.position.len();
        if size == 0 {
            return Quality::default();
        }
        let n = size as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let (position_m, attitude_deg) = (mean(&self.position), mean(&self.attitude));
        let p95 = quantile(&mut self.position, 0.95);
        Quality {
            rate: n / self.images as f64,
            position_m,
            position_p95_m: p95.unwrap_or(f64::NAN),
            attitude_deg,
            nees_position: self.nees[0] / n,
            nees_attitude: self.nees[1] / n,
        }
    }
}

//! Fixes of the ultraviolet camera's node by rendered markers on a rocking deck, by range.

use alight_shared::frames::{Deck, DroneBody, Point, Rotation, Vector};
use alight_shared::time::Time;
use alight_uav::camera::node::CameraIdentity;
use alight_uav::camera::uvdar::{UvdarNode, UvdarSettings};
use nalgebra::Vector3;
use serde::Serialize;

use crate::physics::body::RigidState;
use crate::physics::streams::Streams;
use crate::sensors::camera::{CameraMount, body_from_camera};
use crate::sensors::noise::Noise;
use crate::sensors::render::Shot;
use crate::sensors::render::ultraviolet::Ultraviolet;
use crate::sensors::uvdar::UvdarConfig;

/// Images of one flight: 4 s at 20 Hz.
const IMAGES: usize = 80;
/// The first of them, in which codes are still being read, do not count.
const FIRST: usize = 20;
/// A fix that is further off than this share of the range was made from wrong markers.
const OUTLIER_FRACTION: f64 = 0.5;

/// One row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct UvdarRow {
    /// From the camera to the deck's centre, m.
    pub range_m: f64,
    /// Angle between the line of sight and the level deck's normal, deg; None: 15 to 70, drawn.
    pub incidence_deg: Option<f64>,
    /// Images that count.
    pub images: usize,
    /// Share of them with a fix.
    pub rate: f64,
    /// Root mean square error of the direction, each of two axes, deg.
    pub bearing_deg: f64,
    /// Root mean square error of the distance, as a share of it.
    pub distance: f64,
    /// Mean of the same: positive is too far.
    pub distance_bias: f64,
    /// Squared error over stated variance, mean of three axes; 1 when consistent.
    pub nees: f64,
    /// Fixes off by more than half the range.
    pub outliers: usize,
    /// Share of images with a fix as the measurement model has it.
    pub model_rate: f64,
    /// Bearing error of the model, deg.
    pub model_bearing_deg: f64,
    /// Distance error of the model.
    pub model_distance: f64,
}

/// Fixes in images without a marker: a camera that looks up, with so many glints in each. How many images,
/// and how many of them gave a fix.
pub fn without_markers(settings: &UvdarSettings, glints: usize, flights: usize, seed: u64) -> (usize, usize) {
    let up = UvdarSettings {
        tilt_down_deg: -90.0,
        ..settings.clone()
    };
    let model = UvdarConfig::default();
    let row = row((&up, &model), (20.0, None), glints, flights, seed);
    let fixes = (row.rate * row.images as f64).round() as usize;
    (row.images, fixes + row.outliers)
}

/// Motions of a drone past a rocking deck.
struct Pass {
    range_m: f64,
    /// Elevation of the drone above the deck's horizon, rad.
    up: f64,
    bearing: f64,
    heading: f64,
    phase: f64,
    speed: f64,
    rock: f64,
    begin: f64,
}

impl Pass {
    fn drawn(draw: &mut Noise, range_m: f64, incidence_deg: Option<f64>) -> Pass {
        let mut between = |low: f64, high: f64| low + (high - low) * draw.uniform();
        let drawn = between(0.35, 1.3);
        Pass {
            range_m,
            up: incidence_deg.map_or(drawn, |deg| (90.0 - deg).to_radians()),
            bearing: between(-3.1, 3.1),
            heading: between(-3.1, 3.1),
            phase: between(0.0, 6.2),
            speed: between(0.0, 2.0),
            rock: between(0.02, 0.12),
            begin: between(0.0, 600.0),
        }
    }
    /// Image `s` seconds after the beginning: after 2 s the drone has the range.
    fn shot(&self, s: f64, mount: &CameraMount) -> Shot {
        let (up, bearing, rock) = (self.up, self.bearing, self.rock);
        let wave = |shift: f64, period: f64| (core::f64::consts::TAU * s / period + self.phase + shift).sin();
        let deck = RigidState::<Deck> {
            position: Point::new(0.0, 0.0, -1.3 + 0.3 * wave(1.0, 5.0)),
            attitude: Rotation::from_euler(rock * wave(0.0, 5.0), rock * wave(2.0, 4.0), self.heading),
            ..Default::default()
        };
        let along = Vector3::new(bearing.cos(), bearing.sin(), 0.0);
        let side = Vector3::new(-bearing.sin(), bearing.cos(), 0.0);
        let from = -along * (self.range_m * up.cos()) - Vector3::z() * (self.range_m * up.sin())
            + side * (self.speed * (s - 2.0));
        let drone = RigidState::<DroneBody> {
            position: Point::from(from + Vector3::new(0.0, 0.0, -1.3)),
            velocity: Vector::from(side * self.speed),
            attitude: Rotation::from_euler(0.05 * wave(0.5, 2.0), 0.05 * wave(1.5, 2.3), bearing),
            ..Default::default()
        };
        let t = Time::from_nanos(((self.begin + s) * 1e9) as i64);
        Shot {
            t,
            at: Time::from_nanos(t.nanos()),
            exposure_s: 0.004,
            gain: 1.0,
            view: mount.view(&drone),
            deck,
        }
    }
}

/// `flights` past a deck at a range in metres and an incidence in degrees, with so many glints in each
/// image, compared with the measurement model.
pub fn row(
    (settings, model): (&UvdarSettings, &UvdarConfig),
    (range_m, incidence_deg): (f64, Option<f64>),
    glints: usize,
    flights: usize,
    seed: u64,
) -> UvdarRow {
    let names = CameraIdentity {
        vessel: 1,
        drone: 1,
        boot: 1,
    };
    let mount = CameraMount {
        position: Vector3::zeros(),
        attitude: body_from_camera(),
    };
    let mut draw = Noise::new(&Streams::new(seed), "study.uvdar");
    let (mut fixes, mut sums, mut row) = (0.0, [0.0; 4], UvdarRow::default());
    for flight in 0..flights {
        let streams = Streams::new(seed.wrapping_mul(1000).wrapping_add(flight as u64));
        let mut camera = Ultraviolet::new(settings, glints, &streams);
        let mut node = UvdarNode::new(settings, names);
        let pass = Pass::drawn(&mut draw, range_m, incidence_deg);
        for k in 0..IMAGES {
            let shot = pass.shot(k as f64 / settings.rate_hz, &mount);
            let fix = camera.image(&shot).and_then(|image| node.detect(shot.at, &image));
            if k < FIRST {
                continue;
            }
            row.images += 1;
            let Some(fix) = fix else { continue };
            let truth = shot.view.to_camera_frame(shot.deck.position);
            let e = Vector3::from(fix.position) - truth;
            if e.norm() > OUTLIER_FRACTION * truth.norm() {
                row.outliers += 1;
                continue;
            }
            fixes += 1.0;
            let along = truth.normalize();
            let far = e.dot(&along) / truth.norm();
            let aside = (e - along * e.dot(&along)).norm_squared() / truth.norm_squared();
            sums[0] += 0.5 * aside;
            sums[1] += far * far;
            sums[2] += far;
            sums[3] += (0..3).map(|i| e[i].powi(2) / fix.variance[i]).sum::<f64>() / 3.0;
        }
    }
    let n = f64::max(fixes, 1.0);
    let [model_bearing, model_distance] = model.sd(range_m);
    let within = (model.min_range_m..=model.max_range_m).contains(&range_m);
    UvdarRow {
        range_m,
        incidence_deg,
        model_rate: if within { 1.0 - model.miss } else { 0.0 },
        model_bearing_deg: model_bearing.to_degrees(),
        model_distance,
        rate: fixes / row.images.max(1) as f64,
        bearing_deg: (sums[0] / n).sqrt().to_degrees(),
        distance: (sums[1] / n).sqrt(),
        distance_bias: sums[2] / n,
        nees: sums[3] / n,
        ..row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uvdar_node_among_glints() {
        let row = row(
            (&UvdarSettings::default(), &UvdarConfig::default()),
            (12.0, None),
            10,
            4,
            3,
        );
        assert!(row.rate > 0.5, "{row:?}");
        assert!(row.bearing_deg < 0.5 && row.distance < 0.15, "{row:?}");
        assert_eq!(row.outliers, 0, "{row:?}");
        // The model was fitted to it.
        assert!((row.model_rate - row.rate).abs() < 0.1, "{row:?}");
        assert!(
            (0.6..1.7).contains(&(row.model_bearing_deg / row.bearing_deg)),
            "{row:?}"
        );
        assert!(
            (0.6..1.7).contains(&(row.model_distance / row.distance)),
            "{row:?}"
        );
    }

    #[test]
    fn uvdar_node_in_glints_alone() {
        let (images, fixes) = without_markers(&UvdarSettings::default(), 60, 4, 5);
        assert_eq!((images, fixes), (240, 0));
    }
}

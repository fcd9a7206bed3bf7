//! Deck, drone and paths as coloured points (`foxglove.PointCloud`): every viewer draws points, including viewers
//! that do not support the shapes of a `foxglove.SceneUpdate`.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use foxglove::messages::{
    PackedElementField, PointCloud, Pose, Timestamp, packed_element_field::NumericType,
};

use crate::record::geometry::{frame, pose};

const SPACING_M: f64 = 0.05;
/// Maximum number of points of one line or circle, which bounds the message for a deck of any length.
const POINTS: u32 = 400;
/// Bytes of one point: three coordinates and a colour.
const STRIDE: u32 = 16;

type Rgb = [u8; 3];
const ORANGE: Rgb = [220, 140, 50];
const WHITE: Rgb = [240, 240, 240];
const RED: Rgb = [220, 40, 30];
const GREY: Rgb = [120, 125, 140];
const YELLOW: Rgb = [230, 205, 30];
const GREEN: Rgb = [60, 200, 90];
const BLUE: Rgb = [70, 140, 255];

#[derive(Default)]
struct Points(Vec<u8>);

impl Points {
    fn add(&mut self, at: [f64; 3], [r, g, b]: Rgb) {
        for x in at {
            self.0.extend((x as f32).to_le_bytes());
        }
        self.0.extend([r, g, b, 255]);
    }
    fn line(&mut self, from: [f64; 3], to: [f64; 3], color: Rgb) {
        let square: f64 = from.iter().zip(to).map(|(a, b)| (b - a) * (b - a)).sum();
        let n = ((square.sqrt() / SPACING_M).ceil().min(f64::from(POINTS)) as u32).max(1);
        for k in 0..n {
            let s = f64::from(k) / f64::from(n);
            let mut at = from;
            for (x, b) in at.iter_mut().zip(to) {
                *x += s * (b - *x);
            }
            self.add(at, color);
        }
    }
    /// Rectangle about `centre` in the frame's first two axes.
    fn rectangle(&mut self, centre: [f64; 3], [length, width]: [f64; 2], color: Rgb) {
        let [x, y] = [0.5 * length, 0.5 * width];
        let corners = [[x, y], [x, -y], [-x, -y], [-x, y], [x, y]];
        for (a, b) in corners.iter().zip(corners.iter().skip(1)) {
            let at = |c: &[f64; 2]| [centre[0] + c[0], centre[1] + c[1], centre[2]];
            self.line(at(a), at(b), color);
        }
    }
    fn circle(&mut self, centre: [f64; 3], radius: f64, color: Rgb) {
        for k in 0..24 {
            let (sin, cos) = (core::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
            self.add(
                [centre[0] + radius * cos, centre[1] + radius * sin, centre[2]],
                color,
            );
        }
    }
    fn cloud(self, timestamp: Timestamp, frame: &str) -> PointCloud {
        let field = |name: &str, offset, numeric: NumericType| PackedElementField {
            name: name.into(),
            offset,
            r#type: numeric.into(),
        };
        PointCloud {
            timestamp: Some(timestamp),
            frame_id: frame.into(),
            pose: Some(pose([0.0; 3], &nalgebra::UnitQuaternion::identity())),
            point_stride: STRIDE,
            fields: vec![
                field("x", 0, NumericType::Float32),
                field("y", 4, NumericType::Float32),
                field("z", 8, NumericType::Float32),
                field("red", 12, NumericType::Uint8),
                field("green", 13, NumericType::Uint8),
                field("blue", 14, NumericType::Uint8),
                field("alpha", 15, NumericType::Uint8),
            ],
            data: self.0.into(),
        }
    }
}

/// The deck's edge, its tags and a line forward from its centre.
pub fn deck(timestamp: Timestamp, deck: &DeckGeometry) -> PointCloud {
    let mut points = Points::default();
    points.rectangle([0.0; 3], [deck.length_m, deck.width_m], ORANGE);
    for tag in deck.tags().iter() {
        points.rectangle(tag.centre_m, [tag.side_m; 2], WHITE);
    }
    points.line([0.0; 3], [0.5 * deck.length_m, 0.0, 0.0], WHITE);
    points.cloud(timestamp, frame::DECK)
}

/// Rotors (front ones red), arms and feet.
pub fn drone(timestamp: Timestamp, drone: &DroneGeometry) -> PointCloud {
    let mut points = Points::default();
    let at = drone.arm_m / core::f64::consts::SQRT_2;
    let [x, y] = drone.feet_span_m.map(|s| 0.5 * s);
    for (i, j) in [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)] {
        let rotor = [i * at, j * at, -0.06];
        points.line([0.0; 3], rotor, GREY);
        points.circle(rotor, 0.18, if i > 0.0 { RED } else { GREY });
        points.line([0.0; 3], [i * x, j * y, drone.feet_below_m], YELLOW);
    }
    points.cloud(timestamp, frame::DRONE)
}

pub fn forecast(timestamp: Timestamp, poses: &[Pose]) -> PointCloud {
    along(timestamp, poses, GREEN)
}
pub fn plan(timestamp: Timestamp, poses: &[Pose]) -> PointCloud {
    along(timestamp, poses, BLUE)
}
fn along(timestamp: Timestamp, poses: &[Pose], color: Rgb) -> PointCloud {
    let mut points = Points::default();
    for at in poses.iter().filter_map(|p| p.position.as_ref()) {
        points.add([at.x, at.y, at.z], color);
    }
    points.cloud(timestamp, frame::DRONE_NED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deck_cloud_bounds() {
        let now = Timestamp::new(0, 0);
        let long = DeckGeometry {
            length_m: 1e9,
            ..DeckGeometry::default()
        };
        for of in [DeckGeometry::default(), long] {
            let cloud = deck(now, &of);
            let points = cloud.data.len() / STRIDE as usize;
            assert_eq!(cloud.data.len() % STRIDE as usize, 0);
            assert!(points > 100 && points <= 9 * POINTS as usize, "{points}");
            let x: Vec<f32> = cloud
                .data
                .chunks(STRIDE as usize)
                .map(|p| f32::from_le_bytes([p[0], p[1], p[2], p[3]]))
                .collect();
            let far = x.iter().fold(0.0_f32, |far, x| far.max(x.abs()));
            assert!((far - 0.5 * of.length_m as f32).abs() <= 1e-6 * far, "{far}");
        }
    }
}

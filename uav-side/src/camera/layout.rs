//! Layout of a deck's tags, and the positions from which the camera sees a complete tag.

use alight_shared::{
    frames::body_from_camera,
    geometry::{DeckGeometry, DroneGeometry},
    tags::{DeckTag, MARGIN},
};
use nalgebra::{Rotation3, Vector3};

use super::{CameraSettings, motion_blur::width_px, square_pose::corners_of};

/// Codes of family 36h11 by number, from the library of its authors (Wang and Olson 2016; BSD licence): 6 x 6 cells,
/// rows from the top, most significant bit first, 1 white.
const CODES: &str = include_str!("tag36h11.txt");
pub const CELLS: usize = 10;

/// Whether each cell of a tag is white, by rows from its upper edge, including the white margin; None if the family has
/// no such tag.
pub fn cells(id: u16) -> Option<[[bool; CELLS]; CELLS]> {
    let code = CODES.split_whitespace().nth(usize::from(id))?;
    let code = u64::from_str_radix(code, 16).ok()?;
    let white = |row: usize, column: usize| {
        let ring = [row, column, CELLS - 1 - row, CELLS - 1 - column]
            .into_iter()
            .fold(CELLS, usize::min);
        ring == 0 || (ring > 1 && (code >> (35 - ((row - 2) * 6 + column - 2))) & 1 == 1)
    };
    Some(core::array::from_fn(|row| {
        core::array::from_fn(|column| white(row, column))
    }))
}

/// Height of the feet above the deck up to which a tag must be visible, m.
const MAX_HEIGHT_M: f64 = 10.0;
/// Maximum offset from the deck's centre, m, and tilt relative to the deck, rad, at which a tag must be visible.
/// Source: with the poorest sensors 99 of 100 landings are within 0.2 m (docs/envelope.md); decks rock by 8 deg.
const OFFSET_M: f64 = 0.2;
const TILT_RAD: f64 = 8.0 * core::f64::consts::PI / 180.0;
/// Width of a tag that is decoded in nine of ten images, px.
/// Source: rendered images (`alight study camera` at commit 2bb52893): half are decoded at 13.3 px, with a logistic
/// spread of 0.093 of the width's logarithm.
const DECODED_PX: f64 = 16.3;
/// Number of directions tested for offset, tilt and heading.
const DIRECTIONS: u32 = 8;

/// Whether the camera sees a complete and sufficiently large tag when the drone's lowest foot is `height_m` above the
/// deck, at every offset up to [`OFFSET_M`], tilt up to [`TILT_RAD`] and heading.
fn sees(tags: &[DeckTag], camera: &CameraSettings, drone: &DroneGeometry, height_m: f64) -> bool {
    let around = |k: u32| core::f64::consts::TAU * f64::from(k) / f64::from(DIRECTIONS);
    let mount = Rotation3::from_matrix_unchecked(body_from_camera()) * camera.mount().0.to_rotation_matrix();
    let [x, y] = drone.feet_span_m.map(|span| 0.5 * span);
    let feet = [[x, y], [x, -y], [-x, y], [-x, -y]].map(|[x, y]| Vector3::new(x, y, drone.feet_below_m));
    let size = [camera.lens.width_px, camera.lens.height_px].map(f64::from);
    let from = |heading: f64, tilt: f64, about: f64, offset: Vector3<f64>| {
        let tilted = Rotation3::from_scaled_axis(Vector3::new(about.cos(), about.sin(), 0.0) * tilt);
        let body = tilted * Rotation3::from_axis_angle(&Vector3::z_axis(), heading);
        let lowest = feet.iter().map(|foot| (body * foot).z).fold(f64::MIN, f64::max);
        let middle = body * Vector3::z() * drone.feet_below_m;
        let centre = Vector3::new(offset.x - middle.x, offset.y - middle.y, -height_m - lowest);
        let (optical, camera_from_deck) = (
            centre + body * Vector3::from(drone.camera_m),
            (body * mount).inverse(),
        );
        tags.iter().any(|tag| {
            let corners = corners_of(tag).map(|p| camera.lens.project(&(camera_from_deck * (p - optical))));
            let [Some(a), Some(b), Some(c), Some(d)] = corners else {
                return false;
            };
            let whole = [a, b, c, d]
                .iter()
                .all(|px| (0..2).all(|i| (0.0..=size[i] - 1.0).contains(&px[i])));
            whole && width_px(&[a, b, c, d]) >= DECODED_PX
        })
    };
    (0..DIRECTIONS).all(|heading| {
        [0.0, TILT_RAD].into_iter().all(|tilt| {
            (0..DIRECTIONS).all(|about| {
                from(around(heading), tilt, around(about), Vector3::zeros())
                    && (0..DIRECTIONS).all(|to| {
                        let (sin, cos) = around(to).sin_cos();
                        from(
                            around(heading),
                            tilt,
                            around(about),
                            Vector3::new(cos, sin, 0.0) * OFFSET_M,
                        )
                    })
            })
        })
    })
}

/// Ranges (from, to, m) of the feet's height, between contact and 10 m, in which the camera may see no complete tag.
pub fn gaps(tags: &[DeckTag], camera: &CameraSettings, drone: &DroneGeometry) -> Vec<[f64; 2]> {
    let mut gaps: Vec<[f64; 2]> = Vec::new();
    let (mut height, mut open) = (0.0, false);
    while height <= MAX_HEIGHT_M {
        let visible = sees(tags, camera, drone, height);
        match gaps.last_mut() {
            Some(gap) if open && !visible => gap[1] = height,
            _ if !visible => gaps.push([height; 2]),
            _ => {}
        }
        open = !visible;
        height += 0.02 + 0.05 * height;
    }
    gaps
}

/// Fractions of a tag's range and of the view's width used in a search, allowing for deck errors and oblique views.
const SEARCH_RANGE: f64 = 0.8;

/// Height above the deck from which a search detects the largest tag, and radius of the area in which it does so, m, at
/// any heading and any tilt up to [`TILT_RAD`].
pub fn search_view(tags: &[DeckTag], camera: &CameraSettings) -> [f64; 2] {
    let lens = &camera.lens;
    let side_m = tags.iter().fold(0.0, |max: f64, tag| tag.side_m.max(max));
    let [fx, fy] = lens.focal_px;
    let height_m = SEARCH_RANGE * fx.min(fy) * side_m / DECODED_PX;
    let half = (0.5 * f64::from(lens.width_px) / fx).min(0.5 * f64::from(lens.height_px) / fy);
    let visible = (half.atan() - TILT_RAD).max(0.0).tan();
    [height_m, (height_m * visible - side_m).max(0.5)]
}

/// Faults of a deck's tags as texts: repeated or unknown ids, and tags that overlap or extend beyond the edges.
pub fn faults(tags: &[DeckTag], deck: &DeckGeometry) -> Vec<String> {
    let mut faults = Vec::new();
    let half = |tag: &DeckTag| 0.5 * MARGIN * tag.side_m;
    for (k, tag) in tags.iter().enumerate() {
        let edges = [0.5 * deck.length_m, 0.5 * deck.width_m];
        let over = (0..2)
            .map(|i| tag.centre_m[i].abs() + half(tag) - edges[i])
            .fold(f64::MIN, f64::max);
        // Tolerance of a measuring tape, 1 mm.
        if over > 1e-3 {
            faults.push(format!(
                "tag {} with its margin reaches {over:.3} m beyond the deck's edge",
                tag.id
            ));
        }
        for other in tags.iter().skip(k + 1) {
            if other.id == tag.id {
                faults.push(format!("id {} is on two tags", tag.id));
            }
            let apart = |i: usize| (tag.centre_m[i] - other.centre_m[i]).abs() - half(tag) - half(other);
            let overlap = -apart(0).max(apart(1));
            if overlap > 1e-3 {
                faults.push(format!(
                    "tags {} and {} overlap by {overlap:.3} m, margins included",
                    tag.id, other.id
                ));
            }
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaps_of(deck: &DeckGeometry) -> Vec<[f64; 2]> {
        gaps(
            &deck.tags(),
            &CameraSettings::default(),
            &DroneGeometry::default(),
        )
    }

    #[test]
    fn suggested_tags_from_10_m_to_contact() {
        for (length_m, width_m) in [(2.5, 1.7), (2.0, 1.6), (1.8, 1.7), (1.7, 1.7), (6.0, 4.0)] {
            let deck = DeckGeometry {
                length_m,
                width_m,
                ..DeckGeometry::default()
            };
            assert_eq!(gaps_of(&deck), Vec::<[f64; 2]>::new(), "{length_m} x {width_m}");
        }
    }

    #[test]
    fn visibility_of_one_tag_alone() {
        let deck = DeckGeometry {
            tag_side_m: Some(1.0),
            ..DeckGeometry::default()
        };
        let gaps = gaps_of(&deck);
        assert_eq!((gaps.len(), gaps[0][0]), (1, 0.0));
        assert!((0.8..2.0).contains(&gaps[0][1]), "{gaps:?}");
    }

    #[test]
    fn suggested_tags_on_any_deck() {
        for (length_m, width_m) in
            (0..40).flat_map(|i| (0..40).map(move |j| (0.5 + 0.1 * f64::from(i), 0.5 + 0.1 * f64::from(j))))
        {
            let deck = DeckGeometry {
                length_m,
                width_m,
                ..DeckGeometry::default()
            };
            assert_eq!(
                faults(&deck.tags(), &deck),
                Vec::<String>::new(),
                "{length_m} x {width_m}"
            );
        }
    }

    #[test]
    fn faulty_tags_by_number() {
        let deck = DeckGeometry::default();
        let tag = |id, side_m, x| DeckTag {
            id,
            side_m,
            centre_m: [x, 0.0, 0.0],
        };
        let found = faults(&[tag(3, 0.8, 0.0), tag(3, 0.4, 0.6), tag(4, 0.4, 1.1)], &deck);
        let wanted = [
            "id 3 is on two tags",
            "tags 3 and 3 overlap by 0.150 m, margins included",
            "tag 4 with its margin reaches 0.100 m beyond the deck's edge",
        ];
        assert_eq!(found, wanted);
    }

    #[test]
    fn cells_of_a_tag() {
        let cells = cells(0).unwrap();
        assert!(cells[0].iter().all(|white| *white) && cells[1][1..9].iter().all(|white| !white));
        // 0xd5d628584 begins with 1101 01.
        assert_eq!(cells[2][2..8], [true, true, false, true, false, true]);
        assert_eq!(super::cells(587), None);
    }
}

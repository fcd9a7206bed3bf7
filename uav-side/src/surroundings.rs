//! Passage of keep-out volumes, above or on a side.
//!
//! A volume is widened by the drone's size and errors ([`margin_m`]) and moves with the predicted deck. In the deck's
//! frame a point is `q = R' (p - c)` with the deck's centre `c`. A drone passes a volume outside the face that it is
//! beyond now: `n . (p - c) >= b` holds at every stage, where the face's normal `n` is rotated by that stage's `R`.

use alight_shared::{
    geometry::DroneGeometry,
    msg::DeckStage,
    surroundings::{KeepOut, Surroundings},
};
use nalgebra::{Vector2, Vector3};

/// Horizontal distance from the deck's centre within which deck and obstacles can reach the drone, m.
pub(crate) const WITH_DECK_M: f64 = 10.0;
/// Errors of forecast and tracking near the deck, m: half of the planner's reset distance.
const MARGIN_M: f64 = 0.5;
/// Angle between waypoints on the path round the vessel, rad.
const AHEAD_RAD: f64 = core::f64::consts::FRAC_PI_6;
/// Angle from the sector's edges at which a drone counts as inside, rad; in a narrow sector a quarter of its width.
const EDGE_RAD: f64 = 0.17;

pub(crate) fn margin_m(drone: &DroneGeometry) -> f64 {
    drone.body_radius_m() + MARGIN_M
}

/// Distance from the deck's centre within which a drone counts as at the vessel, m.
pub(crate) fn ring_m(around: &Surroundings, drone: &DroneGeometry) -> f64 {
    if around.keep_out.is_empty() {
        return WITH_DECK_M;
    }
    WITH_DECK_M.max(around.reach_m() + margin_m(drone))
}

/// Waypoint (relative to the deck's centre, NED, m) on the path round the vessel from `from` to the approach sector;
/// None within the sector. `admitted`: whether the drone was within the sector before.
pub(crate) fn way_round(
    around: &Surroundings,
    drone: &DroneGeometry,
    heading: f64,
    from: &Vector2<f64>,
    admitted: &mut bool,
) -> Option<Vector2<f64>> {
    let bearing = from.y.atan2(from.x) - heading;
    let edge = EDGE_RAD.min(0.25 * f64::from(around.sector[1]));
    let turn = around.outside_sector(bearing, edge);
    *admitted = turn == 0.0 || *admitted && around.outside_sector(bearing, 0.0) == 0.0;
    if *admitted {
        return None;
    }
    let next = heading + bearing + (turn + edge.copysign(turn)).clamp(-AHEAD_RAD, AHEAD_RAD);
    // A drone that steers to a point ahead on a circle flies a smaller circle.
    let radius = ring_m(around, drone) / AHEAD_RAD.cos();
    Some(Vector2::new(next.cos(), next.sin()) * radius)
}

/// Converts a position from the drone's NED to the deck's frame, m.
pub(crate) fn in_deck(deck: &DeckStage, p: &Vector3<f64>) -> Vector3<f64> {
    deck.rotation().transpose() * (p - Vector3::from(deck.position))
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Face {
    Top,
    /// Axis of the deck (0: forward, 1: right) and its sign.
    Side(usize, f64),
}

/// Distance of a side of the volume from the deck's centre, along its normal, m.
fn bound(volume: &KeepOut, axis: usize, sign: f64) -> f64 {
    f64::from(if sign > 0.0 {
        volume.high[axis]
    } else {
        -volume.low[axis]
    })
}

/// Widened volume, and the face beyond which the drone stays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passage {
    volume: KeepOut,
    margin: f64,
    face: Face,
}

impl Passage {
    /// Face by which a drone at `here` passes the volume: the top if the drone is higher. Otherwise, of the sides that
    /// it is beyond, the one with the most room at the plan's end `there`; from inside, the nearest side. Each position
    /// comes with the deck of its time.
    ///
    /// At speed another side is out of reach. Therefore the face in `former` also counts within [`MARGIN_M`] of its bound,
    /// which moves with a rocking deck, and another side replaces it only if the plan ends beyond that side.
    pub(crate) fn of(
        volume: &KeepOut,
        margin: f64,
        here: (&DeckStage, &Vector3<f64>),
        there: (&DeckStage, &Vector3<f64>),
        former: &[Passage],
    ) -> Passage {
        let [from, to] = [here, there].map(|(deck, place)| in_deck(deck, place));
        let former = former.iter().find(|p| p.volume == *volume).map(|p| p.face);
        // Larger is better: depth inside the face, at most 0; whether the plan ends beyond it; room there.
        let rank = |face, beyond: f64, room: f64| {
            let is_former = former == Some(face);
            let depth = (beyond + if is_former { MARGIN_M } else { 0.0 }).min(0.0);
            (depth, is_former || room >= 0.0, room)
        };
        let above = f64::from(volume.low[2]) - margin - from.z;
        // From inside, the nearest face has priority.
        let mut best = (Face::Top, rank(Face::Top, above, f64::INFINITY));
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            let beyond = |q: &Vector3<f64>| sign * q[axis] - bound(volume, axis, sign) - margin;
            let face = Face::Side(axis, sign);
            let side = (face, rank(face, beyond(&from), beyond(&to)));
            if side.1 > best.1 {
                best = side;
            }
        }
        Passage {
            volume: *volume,
            margin,
            face: best.0,
        }
    }

    /// Maximum NED z (minimum height) at (x, y) over a volume that is passed above, m; None outside its outline.
    ///
    /// The vertical line through (x, y) is `q(z) = R' (x - c_x, y - c_y, 0) + z R' e_z` above the deck's centre; its
    /// part within the volume lies between the widened faces of all axes.
    pub(crate) fn top_z(&self, deck: &DeckStage, x: f64, y: f64) -> Option<f64> {
        if self.face != Face::Top {
            return None;
        }
        let into = deck.rotation().transpose();
        let q = into * Vector3::new(x - deck.position[0], y - deck.position[1], 0.0);
        let mut from = f64::NEG_INFINITY;
        let mut to = f64::INFINITY;
        for i in 0..3 {
            let low = f64::from(self.volume.low[i]) - self.margin - q[i];
            let high = f64::from(self.volume.high[i]) + self.margin - q[i];
            let d = into[(i, 2)];
            if d.abs() < 1e-6 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            from = from.max((low / d).min(high / d));
            to = to.min((low / d).max(high / d));
        }
        (from < to).then_some(deck.position[2] + from)
    }

    /// Half-space of a volume that is passed on a side: `n . p >= b`.
    pub(crate) fn side(&self, deck: &DeckStage) -> Option<(Vector3<f64>, f64)> {
        let Face::Side(axis, sign) = self.face else {
            return None;
        };
        let n = deck.rotation().column(axis) * sign;
        let b = bound(&self.volume, axis, sign) + self.margin + n.dot(&Vector3::from(deck.position));
        Some((n, b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]
        /// A drone above the top or beyond its side stays outside the widened volume at any attitude of the deck.
        #[test]
        fn passage_outside_the_widened_volume(
            corner in prop::array::uniform3(-8.0..8.0f64), size in prop::array::uniform3(0.1..6.0f64),
            now in prop::array::uniform3(-15.0..15.0f64), then in prop::array::uniform3(-15.0..15.0f64),
            euler in prop::array::uniform3(-0.4..0.4f64), later in prop::array::uniform3(-0.4..0.4f64),
        ) {
            let volume = KeepOut {
                low: corner.map(|v| v as f32),
                high: core::array::from_fn(|i| (corner[i] + size[i]) as f32),
            };
            let stage = |position, euler| DeckStage { position, euler, ..DeckStage::default() };
            let deck = stage([1.0, 2.0, -1.0], euler);
            let after = stage([3.0, -1.0, -2.0], later);
            let mut p = Vector3::from(then);
            let passage = Passage::of(&volume, 1.0, (&deck, &Vector3::from(now)), (&after, &p), &[]);
            if let Some(z) = passage.top_z(&after, p.x, p.y) {
                p.z = p.z.min(z);
            }
            if let Some((n, b)) = passage.side(&after) {
                let push = (b - n.dot(&p)).max(0.0) / n.xy().norm_squared();
                p.x += push * n.x;
                p.y += push * n.y;
            }
            // A drone below the widened volume is not above it.
            let beyond = volume.beyond(&in_deck(&after, &p));
            let widened = |v: f64| v >= 1.0 - 1e-5;
            prop_assert!(beyond.iter().any(|v| widened(*v)), "{passage:?} {beyond:?}");
        }
    }

    #[test]
    fn passage_round_the_vessel_into_its_sector() {
        let around = Surroundings {
            sector: [2.1, 2.1],
            ..Surroundings::default()
        };
        let drone = DroneGeometry::default();
        for (heading, begins) in [(0.4, 0.5), (-2.0, -2.6), (3.0, 0.0)] {
            let begins: f64 = begins + heading;
            let mut p = Vector2::new(begins.cos(), begins.sin()) * 50.0;
            let mut admitted = false;
            while p.norm() > 3.0 {
                let to = way_round(&around, &drone, heading, &p, &mut admitted).unwrap_or_default();
                let step = to - p;
                p += step * (0.1 / step.norm().max(0.1));
                let outside = around.outside_sector(p.y.atan2(p.x) - heading, 0.0) != 0.0;
                assert!(
                    !outside || p.norm() > ring_m(&around, &drone) - 0.2 || p.norm() < 0.1,
                    "{p:?}"
                );
            }
        }
    }
}

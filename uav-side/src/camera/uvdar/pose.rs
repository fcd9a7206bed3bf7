//! Pose of the deck from the directions of known markers, by least squares on the sphere.
//!
//! The unknowns are the deck's centre `t` and attitude `R` in the camera's axes. A marker at `m` in the deck's axes
//! lies in the direction `p = R m + t`; its residual is the angle to the measured direction in two axes, divided by the
//! bearing's standard deviation. The prior of the deck's tilt adds two residuals, which select one of the two tilts
//! that a small square permits, and with which two markers suffice. Two markers have two solutions, a deck's width
//! apart; the one near the previous image's attitude is chosen if it is unique.

use nalgebra::{Matrix2x3, Matrix3, Matrix6, UnitQuaternion, UnitVector3, Vector2, Vector3, Vector6};

use crate::camera::refine::{CameraPose, NormalEquations, RefinementLimits, refine};

const STARTS: usize = 8;
const LIMITS: RefinementLimits = RefinementLimits {
    steps: 25,
    damping: 1e-3,
    min_damping: 1e-9,
    relative_gain: 1e-6,
    absolute_gain: 1e-12,
    step: 0.0,
};
/// Difference between sums of squared residuals below which another solution counts as a rival: 3 sigma.
const RIVAL: f64 = 9.0;
/// Distance between solutions, as a fraction of the range, below which they count as the same.
const SAME_FRACTION: f64 = 0.02;
/// Maximum rotation from the previous attitude to a solution, rad, and the factor by which that of its rivals must be
/// larger.
const CONTINUITY_RAD: f64 = 0.5;
const RIVAL_TURNS: f64 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerBearing {
    /// Position of the marker in the deck's axes, m.
    pub marker: Vector3<f64>,
    pub direction: Vector3<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePrior {
    /// Standard deviation of a direction, each of two axes, rad.
    pub bearing_sd: f64,
    /// Down as a unit vector in the camera's axes, for a level drone.
    pub down: Vector3<f64>,
    /// Standard deviation of the deck's normal relative to `down`, each of two axes, rad.
    pub tilt_sd: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct MarkerPose {
    pub position: Vector3<f64>,
    /// Covariance of the position, m².
    pub covariance: Matrix3<f64>,
    /// Rotation from the deck to the camera.
    pub attitude: UnitQuaternion<f64>,
    pub misfit: f64,
}

type Solution = (CameraPose, f64);

/// Two orthogonal unit vectors perpendicular to `v`.
fn across(v: &Vector3<f64>) -> Option<Matrix2x3<f64>> {
    let other = if v.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let a = v.cross(&other).try_normalize(1e-9)?;
    let b = v.cross(&a).try_normalize(1e-9)?;
    Some(Matrix2x3::from_rows(&[a.transpose(), b.transpose()]))
}

/// Gauss-Newton matrix, gradient and cost at `s`, for a translation and a rotation about the camera's axes.
fn equations(s: &CameraPose, bearings: &[MarkerBearing], known: &PosePrior) -> Option<NormalEquations> {
    let (mut a, mut b, mut cost) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    let mut add = |residual: Vector2<f64>, moved: Matrix2x3<f64>, turned: Matrix2x3<f64>, sd: f64| {
        for i in 0..2 {
            let e = residual[i] / sd;
            cost += e * e;
            let j = Vector6::new(
                moved[(i, 0)],
                moved[(i, 1)],
                moved[(i, 2)],
                turned[(i, 0)],
                turned[(i, 1)],
                turned[(i, 2)],
            ) / sd;
            a.ger(1.0, &j, &j, 1.0);
            b.axpy(-e, &j, 1.0);
        }
    };
    for one in bearings {
        let lever_arm = s.attitude * one.marker;
        let p = lever_arm + s.position;
        let range = p.norm();
        if !(range > 0.1) {
            return None;
        }
        let unit = p / range;
        let plane = across(&one.direction)?;
        // A point opposite to the measured direction is a mirror solution.
        if !(unit.dot(&one.direction) > 0.0) {
            return None;
        }
        let slope = plane * (Matrix3::identity() - unit * unit.transpose()) / range;
        add(
            plane * unit,
            slope,
            slope * -lever_arm.cross_matrix(),
            known.bearing_sd,
        );
    }
    let plane = across(&known.down)?;
    let normal = s.attitude * Vector3::z();
    add(
        plane * normal,
        Matrix2x3::zeros(),
        plane * -normal.cross_matrix(),
        known.tilt_sd,
    );
    cost.is_finite().then_some((a, b, cost))
}

/// Covariance of the position due to the curvature of its dependence on the tilt: with `p(x) = p(0) + a x + c x²` and a
/// standard normal `x` for each axis of the tilt, the mean of `e e'` is `a a' + 3 c c'`, and a linear fit gives `a a'`.
fn curvature(at: &CameraPose, bearings: &[MarkerBearing], known: &PosePrior) -> Option<Matrix3<f64>> {
    let mut whole = Matrix3::zeros();
    for axis in across(&known.down)?.row_iter() {
        let moved = |sign: f64| {
            let turn = UnitQuaternion::new(axis.transpose() * sign * known.tilt_sd);
            let tilted = PosePrior {
                down: turn * known.down,
                ..*known
            };
            let (found, _) = refine(*at, &LIMITS, |pose| equations(pose, bearings, &tilted))?;
            Some(found.position - at.position)
        };
        let c = (moved(1.0)? + moved(-1.0)?) / 2.0;
        whole += 3.0 * c * c.transpose();
    }
    Some(whole)
}

/// The only one of `rivals` (equally good solutions, best first) that is near the attitude `last`, or None.
fn which<'a>(rivals: &[&'a Solution], last: Option<&UnitQuaternion<f64>>) -> Option<&'a Solution> {
    if let [alone] = rivals {
        return Some(alone);
    }
    let last = last?;
    let mut turned: Vec<(f64, &Solution)> = rivals
        .iter()
        .map(|found| (found.0.attitude.angle_to(last), *found))
        .collect();
    turned.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(smallest, found), (next, _), ..] = turned.as_slice() else {
        return None;
    };
    (*smallest < CONTINUITY_RAD && *next > RIVAL_TURNS * smallest).then_some(found)
}

/// Solves with two or more markers. None if there is no position, or several that `last` cannot resolve.
pub fn solve(
    bearings: &[MarkerBearing],
    known: &PosePrior,
    last: Option<&UnitQuaternion<f64>>,
) -> Option<MarkerPose> {
    if bearings.len() < 2 {
        return None;
    }
    let mut range: f64 = 0.0;
    let mut middle = Vector3::zeros();
    let mut centre = Vector3::zeros();
    for (k, a) in bearings.iter().enumerate() {
        middle += a.direction / bearings.len() as f64;
        centre += a.marker / bearings.len() as f64;
        for b in bearings.iter().skip(k + 1) {
            let angle = a.direction.cross(&b.direction).norm().max(1e-4);
            range = range.max((a.marker - b.marker).norm() / angle);
        }
    }
    let direction = middle.try_normalize(1e-6)?;
    let level = UnitQuaternion::rotation_between(&Vector3::z(), &known.down)?;
    let mut all: Vec<Solution> = Vec::with_capacity(2 * STARTS);
    for k in 0..STARTS {
        let heading = core::f64::consts::TAU * k as f64 / STARTS as f64;
        let turn = UnitQuaternion::from_axis_angle(&UnitVector3::new_normalize(known.down), heading);
        let attitude = turn * level;
        for fraction in [1.0, 0.5] {
            let start = CameraPose {
                position: direction * (range * fraction).clamp(0.5, 500.0) - attitude * centre,
                attitude,
            };
            all.extend(refine(start, &LIMITS, |pose| equations(pose, bearings, known)));
        }
    }
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    let smallest = all.first()?.1;
    let mut rivals: Vec<&Solution> = Vec::new();
    for found in all.iter().take_while(|(_, cost)| *cost < smallest + RIVAL) {
        let apart = |other: &&Solution| {
            (other.0.position - found.0.position).norm() > SAME_FRACTION * found.0.position.norm()
        };
        if rivals.iter().all(apart) {
            rivals.push(found);
        }
    }
    let (state, misfit) = *which(&rivals, last)?;
    let (a, _, _) = equations(&state, bearings, known)?;
    let all = a.cholesky()?.inverse();
    let covariance = all.fixed_view::<3, 3>(0, 0) + curvature(&state, bearings, known)?;
    covariance.iter().all(|v| v.is_finite()).then_some(MarkerPose {
        position: state.position,
        covariance,
        attitude: state.attitude,
        misfit,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CORNERS: [[f64; 3]; 4] = [
        [1.25, -0.85, 0.0],
        [1.25, 0.85, 0.0],
        [-1.25, 0.85, 0.0],
        [-1.25, -0.85, 0.0],
    ];

    fn known() -> PosePrior {
        let slope = 45_f64.to_radians();
        PosePrior {
            bearing_sd: 0.002,
            down: Vector3::new(0.0, slope.cos(), slope.sin()),
            tilt_sd: 0.2,
        }
    }
    fn bearings(t: Vector3<f64>, r: UnitQuaternion<f64>, markers: usize) -> Vec<MarkerBearing> {
        CORNERS
            .iter()
            .take(markers)
            .map(|m| {
                let marker = Vector3::from(*m);
                MarkerBearing {
                    marker,
                    direction: (r * marker + t).normalize(),
                }
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn marker_pose_from_exact_bearings(
            range in 3.0..30.0_f64, side in -0.6..0.6_f64, up in -0.5..0.5_f64, heading in -3.1..3.1_f64,
            tilt in prop::array::uniform2(-0.1..0.1_f64),
        ) {
            let known = known();
            let t = Vector3::new(side, up, 1.0).normalize() * range;
            let level = UnitQuaternion::rotation_between(&Vector3::z(), &known.down).unwrap();
            let r = level * UnitQuaternion::from_euler_angles(tilt[0], tilt[1], heading);
            // At long range the previous attitude selects one of two positions that may fit equally well.
            let followed = || solve(&bearings(t, r, 4), &known, Some(&r)).filter(|_| range > 7.0);
            let pose = solve(&bearings(t, r, 4), &known, None).or_else(followed).unwrap();
            // A tilted deck is biased towards level, by less than the stated uncertainty.
            let e = pose.position - t;
            let off = e.dot(&pose.covariance.cholesky().unwrap().solve(&e));
            prop_assert!(off < 3.0, "{off}: {} {t}", pose.position);
            prop_assert!(pose.misfit < 1.0);
            let before = UnitQuaternion::from_euler_angles(0.02, -0.02, 0.03) * r;
            if let Some(two) = solve(&bearings(t, r, 2), &known, Some(&before)) {
                prop_assert!(two.covariance.trace() > pose.covariance.trace());
                let e = two.position - t;
                let off = e.dot(&two.covariance.cholesky().unwrap().solve(&e));
                prop_assert!(off < 12.0, "{off}: {} {t}", two.position);
            }
        }
        #[test]
        fn marker_pose_from_any_bearings(d in prop::collection::vec(-1.0..1.0_f64, 12)) {
            let bearings: Vec<MarkerBearing> = CORNERS.iter().zip(d.chunks(3)).map(|(m, d)| MarkerBearing {
                marker: Vector3::from(*m),
                direction: Vector3::new(d[0], d[1], d[2]).try_normalize(1e-9).unwrap_or(Vector3::z()),
            }).collect();
            if let Some(pose) = solve(&bearings, &known(), None) {
                prop_assert!(pose.position.iter().chain(pose.covariance.iter()).all(|v| v.is_finite()));
                prop_assert!((0..3).all(|i| pose.covariance[(i, i)] >= 0.0));
            }
        }
    }

    #[test]
    fn marker_pose_from_one_marker() {
        let r = UnitQuaternion::identity();
        assert!(solve(&bearings(Vector3::new(0.0, 0.0, 5.0), r, 1), &known(), None).is_none());
    }
}

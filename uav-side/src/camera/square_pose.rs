//! Pose of a deck from the image corners of its square tags, which form one rigid body.
//!
//! The initial pose comes from the closed-form homography (Heckbert 1989, section 2.2.3) of the most accurate tag.
//! Levenberg-Marquardt refines it on the reprojection error of all corners, each in units of its noise. A small distant
//! square has a second minimum, tilted the other way about the viewing direction (Collins and Bartoli 2014,
//! "Infinitesimal plane-based pose estimation", section 3). Both are refined and the one with the smaller error is
//! reported; noise sometimes favours the wrong one.
//!
//! Example: for a tag of 1 m, 320 px focal length and corner noise of 1 px, the tilt is known to 0.8 deg at 1.5 m, 3
//! deg at 3 m and 11 deg at 7 m. From about 5 m on, the best fit is usually too tilted and therefore too near, on
//! average by 4 cm at 5 m, 11 cm at 7 m and 25 cm at 10 m; the variance covers this.

use alight_shared::tags::DeckTag;
use nalgebra::{Matrix2x3, Matrix3, Matrix6, UnitQuaternion, Vector2, Vector3, Vector6};

use super::refine::{CameraPose, NormalEquations, RefinementLimits, refine};

const LIMITS: RefinementLimits = RefinementLimits {
    steps: 12,
    damping: 1e-4,
    min_damping: 0.0,
    relative_gain: 1e-4,
    absolute_gain: 0.0,
    step: 1e-10,
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedTag {
    pub tag: DeckTag,
    /// Corners of the square at unit distance, in the order of [`corners`].
    pub image: [Vector2<f64>; 4],
    /// Standard deviation of each coordinate, at unit distance.
    pub sd: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct DeckPose {
    /// Centre of the deck in camera coordinates, m.
    pub position: Vector3<f64>,
    /// Rotation from the deck to the camera.
    pub attitude: UnitQuaternion<f64>,
    /// Second moments of the error (position, m²; rotation about the camera's x, y, z, rad²) for the given corner
    /// noise. The other minimum is weighted by its likelihood.
    pub variance: Vector6<f64>,
    /// Sum of squared reprojection errors, in units of the corner variance.
    pub misfit: f64,
}

/// Corners of a square in its plane (x forward, y right): aft port, forward port, forward starboard, aft starboard.
pub fn corners(side: f64) -> [Vector3<f64>; 4] {
    let h = 0.5 * side;
    [
        Vector3::new(-h, -h, 0.0),
        Vector3::new(h, -h, 0.0),
        Vector3::new(h, h, 0.0),
        Vector3::new(-h, h, 0.0),
    ]
}
pub fn corners_of(tag: &DeckTag) -> [Vector3<f64>; 4] {
    corners(tag.side_m).map(|corner| corner + Vector3::from(tag.centre_m))
}

/// Corner: position on the deck, image at unit distance, inverse variance of each coordinate.
type Corner = (Vector3<f64>, Vector2<f64>, f64);

/// Deck pose; None without a tag, for degenerate corners, or if the refinement fails.
pub fn solve(tags: &[DetectedTag]) -> Option<DeckPose> {
    let (best, size) = (tags.iter())
        .map(|s| (s, (s.image[2] - s.image[0]).norm_squared() / (s.sd * s.sd)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    if !size.is_finite() {
        return None;
    }
    let on_deck: Vec<Corner> = (tags.iter())
        .flat_map(|s| {
            corners_of(&s.tag)
                .into_iter()
                .zip(s.image)
                .map(|(x, z)| (x, z, 1.0 / (s.sd * s.sd)))
        })
        .collect();
    // The two minima are tilted about the middle of the tags, so the tilt is estimated there.
    let middle = on_deck.iter().map(|c| c.0).sum::<Vector3<f64>>() / on_deck.len() as f64;
    let body: Vec<Corner> = on_deck.iter().map(|(x, z, w)| (x - middle, *z, *w)).collect();
    let refined = |start| refine(start, &LIMITS, |pose| normal_equations(pose, &body));
    let start = from_homography(best.tag.side_m, &best.image)?;
    let first = refined(start.about(middle - Vector3::from(best.tag.centre_m)))?;
    let second = refined(other_tilt(&first.0)?);
    let ((best, misfit), other) = match second {
        Some(s) if s.1 < first.1 => (s, Some(first)),
        other => (first, other),
    };
    let best = best.about(-middle);
    let mut second_moments = variance(&best, &on_deck)?;
    if let Some((other, other_misfit)) = other {
        let other = other.about(-middle);
        // The two minima are weighted by their likelihoods under the corner noise.
        let w = 1.0 / (1.0 + (0.5 * (other_misfit - misfit)).min(700.0).exp());
        if let (true, Some(theirs)) = (w > 1e-6, variance(&other, &on_deck)) {
            let dt = other.position - best.position;
            let dr = (other.attitude * best.attitude.inverse()).scaled_axis();
            let apart = Vector6::new(dt.x, dt.y, dt.z, dr.x, dr.y, dr.z);
            second_moments = second_moments * (1.0 - w) + (theirs + apart.component_mul(&apart)) * w;
        }
    }
    let finite = second_moments.iter().all(|v| v.is_finite());
    finite.then_some(DeckPose {
        position: best.position,
        attitude: best.attitude,
        variance: second_moments,
        misfit,
    })
}

/// Pose with mirrored depths, which has the same image under parallel projection along the viewing direction `v`: `R2 =
/// (I - 2 v v') R diag(1, 1, -1)`.
fn other_tilt(pose: &CameraPose) -> Option<CameraPose> {
    let v = pose.position.try_normalize(1e-9)?;
    let mirror = Matrix3::identity() - v * v.transpose() * 2.0;
    let turned = mirror
        * pose.attitude.to_rotation_matrix().matrix()
        * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    Some(CameraPose {
        attitude: rotation(turned),
        ..*pose
    })
}

/// Normal equations of the reprojection error for a translation, and a rotation about the camera's axes through the
/// body's origin: `p = R x + t`, `dp = dt + dr x (R x)`.
fn normal_equations(pose: &CameraPose, corners: &[Corner]) -> Option<NormalEquations> {
    let r = pose.attitude.to_rotation_matrix();
    let (mut a, mut b, mut cost) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    for (x, z, weight) in corners {
        let lever_arm = r * x;
        let p = lever_arm + pose.position;
        if !(p.z > 1e-3) {
            return None;
        }
        let w = 1.0 / p.z;
        let e = z - p.xy() * w;
        cost += weight * e.norm_squared();
        let d = Matrix2x3::new(w, 0.0, -p.x * w * w, 0.0, w, -p.y * w * w);
        for row in 0..2 {
            let g = Vector3::new(d[(row, 0)], d[(row, 1)], d[(row, 2)]);
            // g . (dr x l) = dr . (l x g) with the lever arm l.
            let t = lever_arm.cross(&g);
            let j = Vector6::new(g.x, g.y, g.z, t.x, t.y, t.z);
            a.ger(*weight, &j, &j, 1.0);
            b.axpy(weight * e[row], &j, 1.0);
        }
    }
    cost.is_finite().then_some((a, b, cost))
}
fn variance(pose: &CameraPose, corners: &[Corner]) -> Option<Vector6<f64>> {
    // The Gauss-Newton matrix does not depend on the measured image.
    let (a, _, _) = normal_equations(pose, corners)?;
    Some(a.cholesky()?.inverse().diagonal())
}

fn rotation(m: Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(m))
}

/// Rigid motion nearest to the homography from the square's plane to the image.
fn from_homography(side: f64, image: &[Vector2<f64>; 4]) -> Option<CameraPose> {
    let [p0, p1, p2, p3] = image;
    let (d1, d2, sum) = (p1 - p2, p3 - p2, p0 - p1 + p2 - p3);
    let area = d1.perp(&d2);
    if !(area.abs() > 1e-12) {
        return None;
    }
    let (g, h) = (sum.perp(&d2) / area, d1.perp(&sum) / area);
    // Columns of the homography of the unit square, then of the square centred on the origin.
    let (cu, cv) = (p1 - p0 + p1 * g, p3 - p0 + p3 * h);
    let (u, v) = (Vector3::new(cu.x, cu.y, g), Vector3::new(cv.x, cv.y, h));
    let centre = Vector3::new(p0.x, p0.y, 1.0) + (u + v) * 0.5;
    let (nu, nv) = (u.norm() / side, v.norm() / side);
    let scale = 2.0 / (nu + nv);
    let (u, v) = (u.try_normalize(1e-12)?, v.try_normalize(1e-12)?);
    // Orthonormal pair with the same bisector.
    let (c, d) = ((u + v).try_normalize(1e-9)?, (u - v).try_normalize(1e-9)?);
    let half = core::f64::consts::FRAC_1_SQRT_2;
    let (x, y) = ((c + d) * half, (c - d) * half);
    let attitude = rotation(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    let position = centre * scale;
    (position.z > 1e-3 && position.iter().all(|c| c.is_finite())).then_some(CameraPose { position, attitude })
}

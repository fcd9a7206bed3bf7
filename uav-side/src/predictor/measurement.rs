//! Measurement function `h(x)` of vision, rangefinder and relative position, its Jacobian, and innovations `z - h(x)`.
//!
//! A detection `z` is the deck relative to the drone's measured pose, expressed in the drone's NED. It depends on the
//! filters' state: the deck `d` (mean, waves and modes), the slow errors `b` of vision, and the vector `l` from the
//! drone to the deck:
//!
//! ```text
//! north, east  d + b + L(l) w             w: rotation of vision, as far as it shifts distant detections
//! down         d + b + s(t, y) + m x l    s: lever-arm heave of a deck that heads y = d + b + k
//! tilt         T(k) (t + m)               t: tilt d as that of a vessel heading north by the vessel's compass, which
//!                                            reads k more than the drone's; m: rotation of the camera's mount, b of tilt
//! heading      d + b
//! ```
//! A range and a relative position have no camera line of sight. With `l = 0` the height is `d + b + s(t, y)`, and the
//! relative position is `d + b` north and east. `b` is that of vision, because the conversion uses the same odometry.
//!
//! The filters are not coupled: each is corrected with its own block of the Jacobian, the tilt with the inverse of its
//! block. Of the other states only the camera's mount adds uncertainty to the height, because errors due to lever-arm
//! heave and compass affect forecast and measurement equally.

use alight_shared::{frames::wrap_angle, vessel_model::turn_tilt};
use nalgebra::{Matrix2, Matrix2x3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::{
    axis::{Axis, Innovation, MeasurementRow, TURN, VISION, compass},
    lever_arm_heave::lever_arm_heave,
    observation::{DeckObservation, ObservationKind, Plane},
    waves::{AXES, DeckMotion, TILT},
};

/// Arguments of `h`: degrees of freedom of the deck, with position and heading in the drone's frame; rotation of the
/// camera's mount about north and east; rotation of vision that shifts a detection north and east; reading of the
/// vessel's compass minus that of the drone's.
type Arguments = SVector<f64, 11>;
type Jacobian = SMatrix<f64, AXES, 11>;
const MOUNT: [usize; 2] = [6, 7];
const ROTATION: [usize; 2] = [8, 9];
const COMPASS: usize = 10;

fn arguments(s: &[Axis; AXES], modes: &DeckMotion) -> Arguments {
    Arguments::from_fn(|i, _| match i {
        3 | 4 => s[i].predicted(MeasurementRow::Level) + modes.value[i],
        0..=2 | 5 => s[i].predicted(MeasurementRow::Vision) + modes.value[i],
        6 | 7 => s[i - 3].x[VISION],
        8 | 9 => s[i - 8].x[TURN],
        _ => compass(&s[5].x),
    })
}

/// Tilt after the vessel's heading has changed by `delta`, and its derivatives with respect to both tilts and `delta`.
fn turned(tilt: [f64; 2], delta: f64) -> ([f64; 2], Matrix2x3<f64>) {
    let [(sr, cr), (sp, cp)] = tilt.map(f64::sin_cos);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -delta);
    let n = turn * Vector3::new(sp * cr, -sr, cp * cr);
    let by_roll = turn * Vector3::new(-sp * sr, -cr, -cp * sr);
    let by_pitch = turn * Vector3::new(cp * cr, 0.0, -sp * cr);
    // Derivatives of asin(-y) and atan2(x, z) of the deck's normal, with x² + y² + z² = 1.
    let square = n.x * n.x + n.z * n.z;
    let slopes = [by_roll, by_pitch, Vector3::new(n.y, -n.x, 0.0)]
        .map(|d| Vector2::new(-d.y / square.sqrt(), (n.z * d.x - n.x * d.z) / square));
    let (roll, pitch) = turn_tilt(tilt[0], tilt[1], delta);
    ([roll, pitch], Matrix2x3::from_columns(&slopes))
}

/// Derivative of a detected height with respect to the mount's rotation, m.
fn mount_slopes(o: &DeckObservation) -> [f64; 2] {
    [o.from_drone.y, -o.from_drone.x]
}

/// Measurement `h` and its Jacobian `dh/du`. `lever_arm`: position of the deck's centre on the vessel, m.
fn predicted(u: &Arguments, o: &DeckObservation, lever_arm: &Vector3<f64>) -> (SVector<f64, AXES>, Jacobian) {
    let lever = o.lever();
    let mount = mount_slopes(o);
    let (tilt, by_tilt) = turned([u[3] + u[MOUNT[0]], u[4] + u[MOUNT[1]]], u[COMPASS]);
    let (euler, by_level) = turned([u[3], u[4]], u[5] + u[COMPASS]);
    let [heave, ..] = lever_arm_heave(lever_arm, euler, [0.0; 2], [0.0; 2]);
    let h = [
        u[0] + lever[0] * u[ROTATION[0]],
        u[1] + lever[1] * u[ROTATION[1]],
        u[2] + heave + mount[0] * u[MOUNT[0]] + mount[1] * u[MOUNT[1]],
        tilt[0],
        tilt[1],
        u[5],
    ];
    let mut slopes = Jacobian::identity();
    for k in 0..2 {
        slopes[(k, ROTATION[k])] = lever[k];
        slopes[(2, MOUNT[k])] = mount[k];
    }
    for k in 0..3 {
        // The derivatives of tilt about north, tilt about east and heading are treated as rates.
        let rates = [by_level[(0, k)], by_level[(1, k)]];
        let [_, slope, _] = lever_arm_heave(lever_arm, euler, rates, [0.0; 2]);
        slopes[(2, 3 + k)] = slope;
    }
    slopes[(2, COMPASS)] = slopes[(2, 5)];
    for (columns, from) in [(3, 0), (4, 1), (MOUNT[0], 0), (MOUNT[1], 1), (COMPASS, 2)] {
        (slopes[(3, columns)], slopes[(4, columns)]) = (by_tilt[(0, from)], by_tilt[(1, from)]);
    }
    (h.into(), slopes)
}

/// Variance of a detected height due to the mount's rotation, m².
fn mount_variance(s: &[Axis; AXES], o: &DeckObservation) -> f64 {
    let of = |(slope, i): (f64, usize)| slope * slope * s[i].p[VISION][VISION].max(0.0);
    mount_slopes(o).into_iter().zip(TILT).map(of).sum()
}

/// Innovations for the filters' state at the observation's time, in the form that each filter uses: heading wrapped,
/// detected tilt rotated back to the vessel's north.
pub(super) fn innovations(
    s: &[Axis; AXES],
    modes: &DeckMotion,
    lever_arm: &Vector3<f64>,
    o: &DeckObservation,
) -> [Option<Innovation>; AXES] {
    let by_radio = o.kind == ObservationKind::Estimate;
    let (h, slopes) = predicted(&arguments(s, modes), o, lever_arm);
    let mut all: [Option<Innovation>; AXES] = core::array::from_fn(|i| {
        let (z, variance) = o.value[i]?;
        if by_radio {
            return Some(s[i].innovation(MeasurementRow::Radio, z - modes.value[i], variance));
        }
        let row = match ROTATION.get(i).map(|k| slopes[(i, *k)]) {
            Some(lever) if lever != 0.0 => MeasurementRow::Camera(lever),
            Some(_) | None => MeasurementRow::Vision,
        };
        let value = z - h[i];
        Some(Innovation { row, value, variance })
    });
    let [_, _, height, north, east, heading] = &mut all;
    if let Some(heading) = heading {
        heading.value = wrap_angle(heading.value);
    }
    if let Some(height) = height {
        height.variance += mount_variance(s, o);
    }
    if let (Some(north), Some(east), false) = (north, east, by_radio) {
        let block = slopes.fixed_view::<2, 2>(TILT[0], TILT[0]).into_owned();
        let back = block.try_inverse().unwrap_or_else(Matrix2::identity);
        let value = back * Vector2::new(north.value, east.value);
        let variance = back.component_mul(&back) * Vector2::new(north.variance, east.variance);
        north.value = value.x;
        north.variance = variance.x;
        east.value = value.y;
        east.variance = variance.y;
    }
    all
}

/// Detection without the mount's effect on its height.
pub(super) fn without_mount(s: &[Axis; AXES], mut o: DeckObservation) -> DeckObservation {
    let [north, east] = mount_slopes(&o);
    let variance = mount_variance(s, &o);
    if let Some((height, r)) = &mut o.value[2] {
        *height -= north * s[TILT[0]].x[VISION] + east * s[TILT[1]].x[VISION];
        *r += variance;
    }
    o
}

pub(super) fn plane(s: &[Axis; AXES], modes: &DeckMotion, lever_arm: &Vector3<f64>) -> Plane {
    let u = arguments(s, modes);
    let (roll, pitch) = turn_tilt(u[3], u[4], u[5] + u[COMPASS]);
    let [heave, ..] = lever_arm_heave(lever_arm, [roll, pitch], [0.0; 2], [0.0; 2]);
    let sd = |axes: [usize; 2], row| {
        let [a, b] = axes.map(|i| s[i].project(row).1);
        a.max(b).sqrt()
    };
    Plane {
        centre: Vector3::new(u[0], u[1], u[2] + heave),
        rotation: UnitQuaternion::from_euler_angles(roll, pitch, u[5]),
        position_sd: sd([0, 1], MeasurementRow::Vision),
        tilt_sd: sd(TILT, MeasurementRow::Level),
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{
            axis::{AxisNoise, MEAN, RADIO},
            config::PredictorConfig,
            observation,
            track::Pose,
        },
        *,
    };
    use alight_shared::{
        frames::{body_from_camera, wxyz},
        msg::TagPose,
        time::Time,
    };
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    const CENTRE: Vector3<f64> = Vector3::new(-4.0, 0.5, -1.3);

    /// Cases with a detection along any line of sight, or with a relative position.
    fn case() -> impl Strategy<Value = (Arguments, DeckObservation)> {
        let units = prop::array::uniform11(-1.0_f64..1.0);
        let line = prop::option::weighted(0.7, prop::array::uniform3(-8.0_f64..8.0));
        (units, line).prop_map(|(units, line)| {
            let largest = [10.0, 10.0, 10.0, 0.4, 0.4, 3.0, 0.05, 0.05, 0.05, 0.05, 0.2];
            let o = DeckObservation {
                at: Time::EPOCH,
                kind: match line {
                    Some(_) => ObservationKind::Tag,
                    None => ObservationKind::Relative,
                },
                value: [None; AXES],
                rate: [None; AXES],
                from_drone: line.unwrap_or_default().into(),
            };
            (Arguments::from(units).component_mul(&Arguments::from(largest)), o)
        })
    }
    fn state(u: &Arguments, modes: &DeckMotion) -> [Axis; AXES] {
        let noise = AxisNoise::all(&PredictorConfig::default());
        let mut s: [Axis; AXES] = core::array::from_fn(|i| Axis::new(&noise[i], &[], i, u[i], 0.1, 0.1));
        for (i, axis) in s.iter_mut().enumerate() {
            let slow = if TILT.contains(&i) { 0.0 } else { 0.02 };
            axis.x[MEAN] -= modes.value[i] + slow;
            axis.x[VISION] = slow;
        }
        for k in 0..2 {
            (s[3 + k].x[VISION], s[k].x[TURN]) = (u[MOUNT[k]], u[ROTATION[k]]);
        }
        s[5].x[RADIO] = u[COMPASS] + 0.02;
        s
    }

    proptest! {
        #[test]
        fn jacobian_against_central_differences((u, o) in case()) {
            let (_, slopes) = predicted(&u, &o, &CENTRE);
            for k in 0..u.len() {
                let at = |by: f64| {
                    let mut u = u;
                    u[k] += by;
                    predicted(&u, &o, &CENTRE).0
                };
                let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                let error = (difference - slopes.column(k)).amax();
                prop_assert!(error < 1e-7, "argument {k}: {difference} {}", slopes.column(k));
            }
        }

        #[test]
        fn innovation_of_a_predicted_measurement((u, mut o) in case(), turns in -1.0_f64..1.0) {
            let modes = DeckMotion { value: [0.3, -0.2, 0.5, 0.05, -0.04, 0.1], ..DeckMotion::default() };
            let (h, _) = predicted(&u, &o, &CENTRE);
            let relative = o.kind == ObservationKind::Relative;
            o.value = core::array::from_fn(|i| (i < 3 || !relative).then_some((h[i], 1e-4)));
            o.value[5] = (!relative).then_some((h[5] + TAU * turns.round(), 1e-4));
            for nu in innovations(&state(&u, &modes), &modes, &CENTRE, &o).into_iter().flatten() {
                prop_assert!(nu.value.abs() < 1e-9, "{nu:?}");
                // A relative position depends on neither the camera's rotation nor its mount.
                let vision = nu.row == MeasurementRow::Vision && nu.variance == 1e-4;
                prop_assert!(vision || !relative, "{nu:?}");
            }
        }

        /// Innovations are linear in the measurement; that of the height also in the mount's rotation.
        #[test]
        fn innovation_variance_by_propagation((u, mut o) in case()) {
            const STEP: f64 = 1e-3;
            let modes = DeckMotion::default();
            let (h, _) = predicted(&u, &o, &CENTRE);
            let r = [1e-4, 2e-4, 3e-4, 4e-4, 9e-4, 6e-4];
            o.value = core::array::from_fn(|i| Some((h[i], r[i])));
            let s = state(&u, &modes);
            let innovations = |s: &[Axis; AXES], o: &DeckObservation| {
                innovations(s, &modes, &CENTRE, o).map(Option::unwrap)
            };
            let all = innovations(&s, &o);
            let square = |moved: &Innovation, i: usize| ((moved.value - all[i].value) / STEP).powi(2);
            for i in 0..AXES {
                let mut expected = 0.0;
                for j in 0..AXES {
                    let mut measured = o;
                    measured.value[j] = Some((h[j] + STEP, r[j]));
                    expected += square(&innovations(&s, &measured)[i], i) * r[j];
                }
                for k in TILT.into_iter().filter(|_| i == 2) {
                    let mut mounted = s;
                    mounted[k].x[VISION] += STEP;
                    expected += square(&innovations(&mounted, &o)[i], i) * s[k].p[VISION][VISION];
                }
                let off = all[i].variance / expected - 1.0;
                prop_assert!(off.abs() < 1e-6, "{i}: {} instead of {expected}", all[i].variance);
            }
        }
    }

    /// Maximum innovation of a tag, from geometry, with the camera's mount rotated by `mount`, rad, and different
    /// compasses.
    fn innovation_of_a_tilted_tag(mount: Vector3<f64>) -> f64 {
        let c = PredictorConfig::default();
        let roll = 0.15;
        let pitch = -0.05;
        let yaw = 1.0;
        let more = 0.1;
        let deck = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let level = Vector3::new(2.0, -1.5, -1.0);
        let centre = level + Vector3::z() * ((deck * CENTRE).z - CENTRE.z);
        let drone = Pose {
            position: Vector3::new(1.0, -2.0, -9.0),
            attitude: UnitQuaternion::from_euler_angles(-0.05, 0.08, 0.9),
            variance: Vector3::zeros(),
        };
        let turn = UnitQuaternion::from_scaled_axis(mount);
        let to_camera = (drone.attitude.to_rotation_matrix().into_inner() * body_from_camera()).transpose();
        let from_lens = turn * (centre - drone.position) - drone.attitude * Vector3::from(c.drone.camera_m);
        let tag = TagPose {
            position: (to_camera * from_lens).into(),
            attitude: wxyz(&UnitQuaternion::from_matrix(
                &(to_camera * (turn * deck).to_rotation_matrix().into_inner()),
            )),
            variance: [1e-4; 6],
            ..TagPose::default()
        };
        let (north, east) = turn_tilt(roll, pitch, -(yaw + more));
        let [x, y, z]: [f64; 3] = level.into();
        let [mx, my, _]: [f64; 3] = mount.into();
        let u = Arguments::from([x, y, z, north, east, yaw, mx, my, my, mx, more]);
        let modes = DeckMotion::default();
        let all = innovations(
            &state(&u, &modes),
            &modes,
            &CENTRE,
            &observation::tag(&tag, &drone, &c),
        );
        let sizes = all.map(|nu| nu.map_or(f64::INFINITY, |nu| nu.value.abs()));
        sizes.into_iter().fold(0.0, f64::max)
    }
    #[test]
    fn tag_of_a_tilted_deck_by_a_rotated_camera() {
        let level = innovation_of_a_tilted_tag(Vector3::zeros());
        assert!(level < 1e-9, "{level}");
        // A mount angle affects the tilt along the vessel's north and the height along the drone's north.
        let rotated = innovation_of_a_tilted_tag(Vector3::new(2e-4, -3e-4, 0.0));
        assert!(rotated < 1e-4, "{rotated}");
    }
}

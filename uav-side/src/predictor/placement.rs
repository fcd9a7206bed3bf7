//! Placement of the vessel's estimate in the drone's frame, from the positions of both origins on the ellipsoid.

use alight_shared::{
    frames::{DroneNed, Vector, VesselNed, wrap_angle},
    geodesy::Datum,
    msg::{MAX_POSITION_M, VesselEstimate, f16},
    time::DroneClock,
    vessel_model::{HEAVE, SURGE, SWAY, YAW},
};
use nalgebra::{Rotation2, Vector2, Vector3};

/// Estimate `e` relative to the drone's `origin`, which is at `offset` (m) in the drone's frame; None beyond
/// [`MAX_POSITION_M`].
///
/// The vessel's sensors measure north and down at the vessel's position, not at its datum. The convergence of the
/// meridians rotates the estimate's directions, by 2 mrad at 5 km and 70 deg of latitude. The modes are not rotated;
/// the error is 2 mm/s for a motion of 1 m/s.
pub fn placed(
    e: &VesselEstimate<DroneClock>,
    origin: &Datum,
    offset: &Vector3<f64>,
) -> Option<VesselEstimate<DroneClock>> {
    let mut p = about(e, origin)?;
    for (i, by) in [SURGE, SWAY, HEAVE].into_iter().zip(offset.iter()) {
        p.eta[i] += by;
    }
    Some(p)
}

fn about(e: &VesselEstimate<DroneClock>, origin: &Datum) -> Option<VesselEstimate<DroneClock>> {
    if e.datum == *origin {
        return Some(*e);
    }
    let place = e.datum.at(&Vector::<VesselNed>::from(e.position()));
    if !(origin.distance_m(&place) < MAX_POSITION_M) {
        return None;
    }
    let turn = origin.convergence_rad(&place);
    let turned = |[x, y]: [f64; 2]| <[f64; 2]>::from(Rotation2::new(turn) * Vector2::new(x, y));
    let mut p = *e;
    p.datum = *origin;
    [p.eta[SURGE], p.eta[SWAY], p.eta[HEAVE]] = origin.to::<DroneNed>(&place).0.into();
    p.eta[YAW] = wrap_angle(e.eta[YAW] + turn);
    let [x, y] = turned([0, 1].map(|i| f64::from(e.eta_dot[i])));
    (p.eta_dot[SURGE], p.eta_dot[SWAY]) = (x as f32, y as f32);
    let [x, y] = turned([0, 1].map(|i| f64::from(e.eta_ddot[i])));
    (p.eta_ddot[SURGE], p.eta_ddot[SWAY]) = (f16::from_f64(x), f16::from_f64(y));
    p.mean_velocity = turned(e.mean_velocity.map(f64::from)).map(|v| v as f32);
    p.mean_heading[0] = wrap_angle(f64::from(e.mean_heading[0]) + turn) as f32;
    Some(p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Message;

    /// Vessel that heads east at 3 m/s, `at` metres from its datum.
    fn vessel(datum: Datum, at: [f64; 3]) -> VesselEstimate<DroneClock> {
        VesselEstimate {
            datum,
            eta: [at[0], at[1], at[2], 0.1, -0.05, core::f64::consts::FRAC_PI_2],
            eta_dot: [0.0, 3.0, 0.2, 0.0, 0.0, 0.0],
            ..VesselEstimate::default()
        }
    }

    #[test]
    fn placement_at_two_instants() {
        for [lat, lon] in [[-33.9, 18.4], [47.6, -122.4], [-16.8, 179.99], [70.1, 19.2]] {
            let datum = Datum::new(lat, lon, 30.0);
            let origin = datum.at(&Vector::<VesselNed>::new(-2900.0, 3900.0, -4.0));
            let [a, b] = [0.0, 3.0]
                .map(|east| placed(&vessel(datum, [200.0, east, 1.0]), &origin, &Vector3::zeros()).unwrap());
            let moved = b.position() - a.position();
            let stated = Vector3::new(f64::from(a.eta_dot[SURGE]), f64::from(a.eta_dot[SWAY]), 0.0);
            assert!((moved - stated).norm() < 1e-4, "{moved} {stated}");
            let heading = stated.y.atan2(stated.x);
            assert!((heading - a.eta[YAW]).abs() < 1e-6 && a.eta[YAW] != core::f64::consts::FRAC_PI_2);
            assert!((a.eta[HEAVE] - 5.0).abs() < 1e-6, "height {}", a.eta[HEAVE]);
            assert!(a.check().is_ok());
        }
    }

    #[test]
    fn placement_of_a_restarted_vessel() {
        let first = Datum::new(-16.8, 179.999, 30.0);
        let origin = Datum::new(-16.79, -179.999, 12.0);
        let before = placed(&vessel(first, [50.0, 300.0, 0.5]), &origin, &Vector3::zeros()).unwrap();
        let second = first.at(&Vector::<VesselNed>::new(48.0, 303.0, -1.5));
        let at = second.to::<VesselNed>(&first.at(&Vector::<VesselNed>::new(50.0, 300.0, 0.5)));
        let after = placed(&vessel(second, at.0.into()), &origin, &Vector3::zeros()).unwrap();
        assert!((after.position() - before.position()).norm() < 1e-6);
        assert!((after.eta[YAW] - before.eta[YAW]).abs() < 1e-9);
    }

    #[test]
    fn placement_beyond_100_km() {
        let at = |lat| {
            placed(
                &vessel(Datum::new(lat, 7.0, 0.0), [0.0; 3]),
                &Datum::new(45.0, 7.0, 0.0),
                &Vector3::zeros(),
            )
        };
        assert!(at(45.8).is_some() && at(46.0).is_none());
        let antipode = vessel(Datum::new(-45.0, -173.0, 0.0), [0.0; 3]);
        assert!(placed(&antipode, &Datum::new(45.0, 7.0, 0.0), &Vector3::zeros()).is_none());
    }
}

//! Positions on the WGS-84 ellipsoid and local frames about them.

use core::f64::consts::TAU;

use nalgebra::{Matrix3, Rotation3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frames::Vector;

const A: f64 = 6_378_137.0;
const F: f64 = 1.0 / 298.257_223_563;
const E2: f64 = F * (2.0 - F);
/// Iterations for a latitude: each reduces the error by 1 / `E2` = 150; this number reaches the last bit.
const ITERATIONS: usize = 8;

/// Speed of one knot, m/s: one nautical mile per hour.
pub const KNOT_MPS: f64 = 1852.0 / 3600.0;

/// WGS-84 position of the origin of a local frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(deny_unknown_fields)]
pub struct Datum {
    /// Geodetic latitude, deg, north positive.
    pub latitude_deg: f64,
    /// Longitude, deg, east positive.
    pub longitude_deg: f64,
    /// Height above the ellipsoid, m.
    pub height_m: f64,
}

impl Datum {
    /// Position from geodetic latitude and longitude, deg, and height above the ellipsoid, m.
    pub const fn new(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> Self {
        Datum {
            latitude_deg,
            longitude_deg,
            height_m,
        }
    }

    /// Whether the position is on or near the Earth.
    pub fn is_on_earth(&self) -> bool {
        // NaN compares false.
        self.latitude_deg.abs() <= 90.0 && self.longitude_deg.abs() <= 360.0 && self.height_m.abs() <= 1e4
    }

    /// Whether latitude and longitude are exactly zero: a receiver without a fix.
    pub fn is_nowhere(&self) -> bool {
        self.latitude_deg == 0.0 && self.longitude_deg == 0.0
    }

    /// Position of `other` in the local frame with this origin, m: north and east in the tangent plane, via
    /// ECEF; down by the heights above the ellipsoid, as autopilots and GNSS receivers define it, without the
    /// tangent plane's fall (2 m at 5 km). Inverse of [`Datum::at`].
    pub fn to<F>(&self, other: &Datum) -> Vector<F> {
        if self == other {
            return Vector::zero();
        }
        let ned = self.axes().transpose() * (other.ecef() - self.ecef());
        Vector::new(ned.x, ned.y, self.height_m - other.height_m)
    }

    /// Position at `local` (m) in the local frame with this origin.
    pub fn at<F>(&self, local: &Vector<F>) -> Datum {
        if local.0 == Vector3::zeros() {
            return *self;
        }
        let axes = self.axes();
        let height_m = self.height_m - local.0.z;
        let mut down = local.0.z;
        let mut place = *self;
        // Each iteration reduces the height error by `(distance / radius)²`.
        for _ in 0..ITERATIONS {
            place = Datum::of_ecef(self.ecef() + axes * Vector3::new(local.0.x, local.0.y, down));
            down += place.height_m - height_m;
        }
        Datum { height_m, ..place }
    }

    /// Straight distance between two positions, m.
    pub fn distance_m(&self, other: &Datum) -> f64 {
        (self.ecef() - other.ecef()).norm()
    }

    /// Meridian convergence: angle from this frame's north axis eastwards to north at `place`, rad. Add it to a heading
    /// at `place` to express the heading in this frame.
    pub fn convergence_rad(&self, place: &Datum) -> f64 {
        if self == place {
            return 0.0;
        }
        let north = self.axes().transpose() * place.axes() * Vector3::x();
        north.y.atan2(north.x)
    }

    /// Local metres, north and east, per map metre of a firmware with a spherical Earth of `radius_m`: radii
    /// of curvature along meridian and parallel (Groves 2013, eq. 2.105 and 2.106) divided by `radius_m`.
    pub fn metres_per_map_metre(&self, radius_m: f64) -> [f64; 2] {
        let w2 = 1.0 - E2 * self.latitude_deg.to_radians().sin().powi(2);
        let prime = A / w2.sqrt();
        let meridian = A * (1.0 - E2) / (w2 * w2.sqrt());
        [meridian, prime].map(|r| (r + self.height_m) / radius_m)
    }

    /// The place with these Earth-centred, Earth-fixed coordinates, m.
    pub fn from_ecef(at: [f64; 3]) -> Datum {
        Datum::of_ecef(at.into())
    }
    /// Earth-centred, Earth-fixed coordinates, m (Groves 2013, eq. 2.112).
    fn ecef(&self) -> Vector3<f64> {
        let lat = self.latitude_deg.to_radians();
        let lon = self.longitude_deg.to_radians();
        let prime = A / (1.0 - E2 * lat.sin().powi(2)).sqrt();
        let parallel = (prime + self.height_m) * lat.cos();
        Vector3::new(
            parallel * lon.cos(),
            parallel * lon.sin(),
            (prime * (1.0 - E2) + self.height_m) * lat.sin(),
        )
    }
    /// Position from ECEF coordinates, m: fixed point of `tan(lat) = (z + e² N sin(lat)) / p`.
    fn of_ecef(at: Vector3<f64>) -> Datum {
        let parallel = at.x.hypot(at.y);
        let mut lat = at.z.atan2(parallel * (1.0 - E2));
        for _ in 0..ITERATIONS {
            let prime = A / (1.0 - E2 * lat.sin().powi(2)).sqrt();
            lat = (at.z + E2 * prime * lat.sin()).atan2(parallel);
        }
        let surface = A * (1.0 - E2 * lat.sin().powi(2)).sqrt();
        Datum {
            latitude_deg: lat.to_degrees(),
            longitude_deg: at.y.atan2(at.x).to_degrees(),
            height_m: parallel * lat.cos() + at.z * lat.sin() - surface,
        }
    }
    /// Rotation from local NED to ECEF (Groves 2013, eq. 2.150).
    fn axes(&self) -> Matrix3<f64> {
        let lat = self.latitude_deg.to_radians();
        let lon = self.longitude_deg.to_radians();
        let level = Rotation3::from_axis_angle(&Vector3::y_axis(), -lat - 0.25 * TAU);
        (Rotation3::from_axis_angle(&Vector3::z_axis(), lon) * level).into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::TrueNed;
    use proptest::prelude::*;

    /// South, west, both sides of the date line, far north.
    const PLACES: [Datum; 5] = [
        Datum::new(-33.9, 18.4, 31.0),
        Datum::new(47.6, -122.4, -21.0),
        Datum::new(-16.8, 179.999, 55.0),
        Datum::new(-16.8, -179.999, 55.0),
        Datum::new(70.1, 19.2, 30.0),
    ];

    /// Reference without ECEF, by local radii of curvature: accurate to millimetres within 100 m.
    fn by_radii(from: &Datum, to: &Datum) -> Vector3<f64> {
        let lat = (0.5 * (from.latitude_deg + to.latitude_deg)).to_radians();
        let w2 = 1.0 - E2 * lat.sin().powi(2);
        let east = (to.longitude_deg - from.longitude_deg + 540.0).rem_euclid(360.0) - 180.0;
        Vector3::new(
            (to.latitude_deg - from.latitude_deg).to_radians() * A * (1.0 - E2) / w2.powf(1.5),
            east.to_radians() * A / w2.sqrt() * lat.cos(),
            from.height_m - to.height_m,
        )
    }

    #[test]
    fn known_ecef_coordinates() {
        // By definition at the equator and the pole; in between by EPSG guidance note 7-2 (section 4.1.1).
        let at = |lat, lon, h| Datum::new(lat, lon, h).ecef();
        assert!((at(0.0, 90.0, 1.0) - Vector3::new(0.0, A + 1.0, 0.0)).norm() < 1e-6);
        assert!((at(90.0, 0.0, 0.0) - Vector3::new(0.0, 0.0, 6_356_752.314_2)).norm() < 1e-3);
        let epsg = at(
            53.0 + 48.0 / 60.0 + 33.820 / 3600.0,
            2.0 + 7.0 / 60.0 + 46.380 / 3600.0,
            73.0,
        );
        assert!(
            (epsg - Vector3::new(3_771_793.968, 140_253.342, 5_124_304.349)).norm() < 2e-2,
            "{epsg}"
        );
    }

    #[test]
    fn short_displacement_by_the_local_radii() {
        for d in PLACES {
            let other = Datum {
                latitude_deg: d.latitude_deg + 4e-4,
                longitude_deg: d.longitude_deg - 5e-4,
                height_m: 12.0,
            };
            let exact = d.to::<TrueNed>(&other).0;
            let radii = by_radii(&d, &other);
            assert!((exact - radii).norm() < 2e-3, "{d:?} {exact} {radii}");
        }
    }

    #[test]
    fn date_line_crossed_by_200_m() {
        let west = PLACES[2].to::<TrueNed>(&PLACES[3]).0;
        assert!((west.y - 213.2).abs() < 1.0 && west.x.abs() < 0.1, "{west}");
        let turned = Datum {
            longitude_deg: 180.001,
            ..PLACES[3]
        };
        assert!((PLACES[2].to::<TrueNed>(&turned).0 - west).norm() < 1e-6);
    }

    #[test]
    fn convergence_of_meridians_at_70_north() {
        let d = PLACES[4];
        let east = d.at(&Vector::<TrueNed>::new(0.0, 5e3, 0.0));
        // distance / radius * tan(latitude); sign: east of the origin, north points west of the frame's north axis.
        let expected = 5e3 / 6.397e6 * d.latitude_deg.to_radians().tan();
        let convergence = d.convergence_rad(&east);
        assert!((convergence + expected).abs() < 2e-6, "{convergence} {expected}");
    }

    #[test]
    fn map_of_a_sphere_at_the_equator() {
        let [north, east] = Datum::new(0.0, 0.0, 0.0).metres_per_map_metre(6_371_000.0);
        assert!((north - 0.994_42).abs() < 1e-5 && (east - 1.001_12).abs() < 1e-5);
    }

    proptest! {
        #[test]
        fn round_trip_to_a_millimetre_at_5_km(
            k in 0..PLACES.len(),
            bearing in 0.0..TAU,
            distance in 0.0..5e3_f64,
            down in -500.0..50.0_f64,
        ) {
            let d = PLACES[k];
            let there = Vector::<TrueNed>::new(distance * bearing.cos(), distance * bearing.sin(), down);
            let place = d.at(&there);
            prop_assert!((d.to::<TrueNed>(&place).0 - there.0).norm() < 1e-6);
            prop_assert_eq!(place.height_m, d.height_m - down);
            let again = d.at(&d.to::<TrueNed>(&place));
            prop_assert!(again.distance_m(&place) < 1e-6);
            prop_assert!((d.distance_m(&place) - distance.hypot(down)).abs() < 3.0);
        }

        #[test]
        fn frames_of_two_places_by_the_convergence(
            k in 0..PLACES.len(),
            bearing in 0.0..TAU,
            distance in 0.0..5e3_f64,
            course in 0.0..TAU,
        ) {
            let ours = PLACES[k];
            let step = 10.0;
            let theirs = ours.at(&Vector::<TrueNed>::new(distance * bearing.cos(), distance * bearing.sin(), 3.0));
            let ahead = theirs.at(&Vector::<TrueNed>::new(step * course.cos(), step * course.sin(), 0.0));
            let moved = ours.to::<TrueNed>(&ahead).0 - ours.to::<TrueNed>(&theirs).0;
            let turned = course + ours.convergence_rad(&theirs);
            let error = (moved.xy() - step * nalgebra::Vector2::new(turned.cos(), turned.sin())).norm();
            prop_assert!(error < 1e-4, "{error}");
        }
    }
}

//! Geoid: mean sea level above the WGS-84 ellipsoid, for heights above the sea without a geoid separation.
//!
//! `height above the ellipsoid = height above the sea + undulation`. A receiver that reports no undulation
//! has used an unknown table: from EGM96 itself down to 10 by 10 degrees (STANAG 4294, annex A, interpolated
//! bilinearly), whose errors over 2500 positions within 75 degrees of the equator are 3.5 m (rms), 12.6 m (99
//! %) and 22.5 m (maximum). The stated spread covers these.

use crate::geodesy::Datum;

/// Minimum spread of receivers' tables, m. A 5 by 5 degree table has an error of 2.1 m (rms), a model older
/// than EGM96 up to 6 m (one maker's manual), EGM96 itself 0.5 m (NASA/TP-1998-206861, section 10), and mean
/// sea level differs from the geoid by 0.6 m.
const TABLE_SD: f64 = 2.0;
/// Spacing of the coarsest table in receivers, deg.
const COARSE_DEG: f64 = 10.0;
/// Distance within which an undulation is reused, deg: 0.2 km, 0.1 m on the steepest geoid.
const NEAR_DEG: f64 = 0.002;

/// Mean sea level above the ellipsoid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Undulation {
    /// EGM96 to degree 360, m, positive up.
    pub height_m: f64,
    /// Standard deviation of a receiver's undulation about `height_m`, m: a constant error that averaging does not reduce.
    pub sigma_m: f64,
}

/// Undulation at a geodetic latitude and longitude, rad. Takes 5 ms: five series of 65,000 terms.
pub fn undulation(latitude_rad: f64, longitude_rad: f64) -> Undulation {
    let place = [latitude_rad, longitude_rad].map(f64::to_degrees);
    if !place.iter().all(|v| v.is_finite()) {
        return Undulation {
            height_m: 0.0,
            sigma_m: LARGEST_M,
        };
    }
    let [latitude, longitude] = place;
    let height_m = egm96::egm96_compute_altitude_offset(latitude, longitude);
    Undulation {
        height_m,
        sigma_m: TABLE_SD.hypot(height_m - coarse(latitude, longitude)),
    }
}

/// Bound of the undulation's magnitude, m: from -107 m south of India to 86 m at New Guinea.
pub const LARGEST_M: f64 = 110.0;

/// Undulation in the coarsest table in receivers, m.
fn coarse(latitude: f64, longitude: f64) -> f64 {
    let corner = |v: f64| (v / COARSE_DEG).floor() * COARSE_DEG;
    let south = corner(latitude).clamp(-90.0, 90.0 - COARSE_DEG);
    let west = corner(longitude);
    let u = (latitude - south) / COARSE_DEG;
    let v = (longitude - west) / COARSE_DEG;
    let row = |at: f64| {
        let node = egm96::egm96_compute_altitude_offset;
        (1.0 - v) * node(at, west) + v * node(at, west + COARSE_DEG)
    };
    (1.0 - u) * row(south) + u * row(south + COARSE_DEG)
}

/// Geoid along a path, recomputed after a move.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocalGeoid {
    last: Option<([f64; 2], Undulation)>,
}

impl LocalGeoid {
    /// Undulation at `place`; its height is ignored.
    pub fn at(&mut self, place: &Datum) -> Undulation {
        let here = [place.latitude_deg, place.longitude_deg];
        let near = |there: &[f64; 2]| (0..2).all(|k| (here[k] - there[k]).abs() < NEAR_DEG);
        if let Some((_, undulation)) = self.last.filter(|(there, _)| near(there)) {
            return undulation;
        }
        let here_now = undulation(here[0].to_radians(), here[1].to_radians());
        self.last = Some((here, here_now));
        here_now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn undulation_deg(latitude_deg: f64, longitude_deg: f64) -> Undulation {
        undulation(latitude_deg.to_radians(), longitude_deg.to_radians())
    }

    /// Points published by NGA with the EGM96 program (F477, output of the harmonic synthesis).
    #[test]
    fn undulation_at_published_points() {
        for (latitude, longitude, published) in [
            (38.628155, 269.779155, -31.63),
            (-14.621217, 305.021114, -2.97),
            (46.874319, 102.448729, -43.57),
            (-23.617446, 133.874712, 15.87),
            (38.625473, 359.9995, 50.07),
            (-0.466744, 0.0023, 17.33),
        ] {
            let u = undulation_deg(latitude, longitude);
            assert!(
                (u.height_m - published).abs() < 0.02,
                "{latitude} {longitude}: {u:?}"
            );
        }
    }

    /// Undulations stated by receivers (GGA, field 11), within three times the stated spread.
    #[test]
    fn undulation_that_receivers_state() {
        for (latitude, longitude, stated) in [
            // Examples of the NMEA standard (Munich), u-blox (Zurich) and Trimble (California).
            (48.1173, 11.5167, 46.9),
            (47.28523, 8.56526, 48.0),
            (37.39, -122.03, -25.7),
        ] {
            let u = undulation_deg(latitude, longitude);
            assert!((u.height_m - stated).abs() < 3.0 * u.sigma_m, "{stated}: {u:?}");
        }
    }

    #[test]
    fn undulation_anywhere() {
        for latitude in [-90.0, -60.0, -10.0, 0.0, 35.0, 89.9, 90.0] {
            for longitude in [-180.0, -179.9, -66.0, 0.0, 10.0, 179.9, 180.0] {
                let u = undulation_deg(latitude, longitude);
                assert!(u.height_m.abs() < LARGEST_M, "{u:?}");
                assert!(
                    (TABLE_SD..30.0).contains(&u.sigma_m),
                    "{latitude} {longitude}: {u:?}"
                );
            }
        }
        // The date line is one meridian, and the pole one point.
        assert!((undulation_deg(20.0, -180.0).height_m - undulation_deg(20.0, 180.0).height_m).abs() < 1e-9);
        assert!((undulation_deg(90.0, 0.0).height_m - undulation_deg(90.0, 123.0).height_m).abs() < 1e-6);
        assert_eq!(undulation_deg(f64::NAN, 0.0).sigma_m, LARGEST_M);
    }

    #[test]
    fn undulation_along_a_path() {
        let mut geoid = LocalGeoid::default();
        // Towards the Puerto Rico trench, where the geoid is steepest; 20 km in steps of 50 m.
        let mut last: Option<f64> = None;
        for k in 0..400 {
            let place = Datum::new(18.6 + 0.00045 * f64::from(k), -66.0, 0.0);
            let height = geoid.at(&place).height_m;
            assert!(
                last.is_none_or(|l| (height - l).abs() < 0.15),
                "{last:?} {height}"
            );
            last = Some(height);
        }
        assert!((geoid.at(&Datum::new(50.0, 14.5, 0.0)).height_m - 45.25).abs() < 0.01);
    }
}

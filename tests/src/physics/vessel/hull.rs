use nalgebra::Vector3;

use super::config::VesselConfig;
use crate::physics::sea::WATER_DENSITY;

/// Submerged part of a half-circle section of radius `r`, whose keel is `depth` below the water: area (m²),
/// and depth of its centroid below the circle's centre (m). Depths above `r` are clamped to `r`.
pub fn segment(r: f64, depth: f64) -> (f64, f64) {
    let d = depth.clamp(0.0, r);
    if d <= 0.0 {
        return (0.0, r);
    }
    let up = r - d;
    let half_width = (d * (2.0 * r - d)).max(0.0).sqrt();
    let area = r * r * (up / r).acos() - up * half_width;
    // First moment of a circular segment about the centre: (2/3) half_width³.
    let lever_arm = if area > 1e-12 {
        2.0 / 3.0 * half_width.powi(3) / area
    } else {
        r
    };
    (area, lever_arm)
}

#[derive(Clone, Debug)]
pub struct Hull {
    pub radius: f64,
    pub draft: f64,
    pub section_length: f64,
    /// Centres of the circles in the body frame, m.
    pub centres: Vec<Vector3<f64>>,
    /// Displaced volume at rest, m³.
    pub rest_volume: f64,
    /// Stiffness in heave (N/m), roll and pitch (Nm/rad) at rest.
    pub stiffness: [f64; 3],
}

impl Hull {
    /// Hulls that float at the draft at which they carry the mass.
    pub fn new(config: &VesselConfig, gravity: f64) -> Hull {
        let r = config.hull_radius_m;
        let n = config.sections_per_hull.max(1);
        let length = config.hull_length_m;
        let volume = config.mass_kg / WATER_DENSITY;
        // Bisection: the area increases with the draft.
        let mut low = 0.0;
        let mut high = r;
        for _ in 0..60 {
            let mid = 0.5 * (low + high);
            if 2.0 * length * segment(r, mid).0 < volume {
                low = mid;
            } else {
                high = mid;
            }
        }
        let draft = 0.5 * (low + high);
        let step = length / n as f64;
        let centres: Vec<Vector3<f64>> = [-1.0, 1.0]
            .into_iter()
            .flat_map(|side| {
                (0..n).map(move |i| {
                    Vector3::new(
                        (i as f64 + 0.5) * step - 0.5 * length,
                        side * config.hull_offset_m,
                        draft - r,
                    )
                })
            })
            .collect();
        let width = 2.0 * (draft * (2.0 * r - draft)).max(0.0).sqrt();
        let per_section = WATER_DENSITY * gravity * width * step;
        let weight = config.mass_kg * gravity;
        // rho g (I_A) + weight (z_G - z_B), z down: a higher centre of gravity reduces the stiffness.
        let buoyancy_z = draft - r + segment(r, draft).1;
        let lever = weight * (config.centre_of_gravity_m[2] - buoyancy_z);
        let moment = |lever_arm: fn(&Vector3<f64>) -> f64, own: f64| {
            per_section
                * (centres.iter().map(|c| lever_arm(c).powi(2)).sum::<f64>() + centres.len() as f64 * own)
                + lever
        };
        Hull {
            radius: r,
            draft,
            section_length: step,
            rest_volume: volume,
            stiffness: [
                per_section * centres.len() as f64,
                moment(|c| c.y, width * width / 12.0),
                moment(|c| c.x, step * step / 12.0),
            ],
            centres,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_segment_area() {
        let r = 0.213;
        for depth in [0.01, 0.089, 0.15, 0.213, 0.5] {
            let (area, lever_arm) = segment(r, depth);
            let d = f64::min(depth, r);
            let n = 20_000;
            let mut a = 0.0;
            let mut m = 0.0;
            for i in 0..n {
                let z = r - d + d * (f64::from(i) + 0.5) / f64::from(n);
                let strip = 2.0 * (r * r - z * z).sqrt() * d / f64::from(n);
                a += strip;
                m += strip * z;
            }
            assert!((area / a - 1.0).abs() < 1e-4, "{depth}: {area} {a}");
            assert!((lever_arm / (m / a) - 1.0).abs() < 1e-4, "{depth}: {lever_arm}");
        }
        assert_eq!(segment(r, -0.1).0, 0.0);
    }

    #[test]
    fn draught_of_the_default_hull() {
        // Published values for fresh water: draft 0.089 m, heave stiffness 33 kN/m, roll stiffness 35 kNm/rad.
        let h = Hull::new(&VesselConfig::default(), 9.806_65);
        assert!((h.draft - 0.089).abs() < 0.003, "{}", h.draft);
        assert!((h.stiffness[0] - 34e3).abs() < 1.5e3, "{:?}", h.stiffness);
        assert!((h.stiffness[1] - 35e3).abs() < 3e3, "{:?}", h.stiffness);
        assert!(h.centres.len() >= 20);
    }
}

use super::*;
use alight_shared::time::Time;

fn at(s: f64) -> WorldTime {
    Time::from_secs(s)
}
fn paper(a: f64, t: f64, seed: u64) -> Sea {
    Sea::new(&SeaConfig::paper(a, t), &Streams::new(seed))
}
fn irregular_sea(seed: u64) -> Sea {
    let config = SeaConfig {
        kind: SeaKind::Jonswap,
        significant_height_m: 2.0,
        peak_period_s: 6.0,
        ..SeaConfig::default()
    };
    Sea::new(&config, &Streams::new(seed))
}

#[test]
fn paper_sea_components() {
    for seed in 0..50 {
        let sea = paper(0.5, 5.0, seed);
        let [short, middle, long] = sea.components() else {
            panic!("three components");
        };
        let s = middle.wave_number / long.wave_number;
        assert!((1.1..1.5).contains(&s), "{s}");
        assert!((middle.wave_number - (TAU / 5.0).powi(2) / GRAVITY).abs() < 1e-12);
        assert!((short.wave_number / middle.wave_number - s).abs() < 1e-9);
        assert!((long.amplitude_m - 0.5 * s).abs() < 1e-9 && (short.amplitude_m - 0.5 / s).abs() < 1e-9);
        assert!((short.direction.dot(&middle.direction) - 0.4_f64.cos()).abs() < 1e-9);
        assert!((short.direction.dot(&long.direction) - 0.8_f64.cos()).abs() < 1e-9);
    }
}

#[test]
fn paper_sea_slopes_and_speeds() {
    // Derived from the paper's sea of 0.5 m, 5 s: up to about 3 m from crest to trough, a slope of up to 13.8
    // deg, and a vertical speed of up to 1.9 m/s. No seed exceeds these by much, and some come close.
    let mut slope = 0.0_f64;
    let mut range = 0.0_f64;
    let mut speed = 0.0_f64;
    for seed in 0..40 {
        let sea = paper(0.5, 5.0, seed);
        let mut low = 0.0_f64;
        let mut high = 0.0_f64;
        for i in 0..1500 {
            let w = sea.surface(at(0.2 * f64::from(i)), 0.0, 0.0);
            slope = slope.max(w.slope.norm().atan().to_degrees());
            speed = speed.max(w.velocity.z.abs());
            low = low.min(w.elevation_m);
            high = high.max(w.elevation_m);
        }
        range = range.max(high - low);
    }
    assert!((12.0..17.0).contains(&slope), "slope {slope} deg");
    assert!((2.5..3.4).contains(&range), "crest to trough {range} m");
    assert!((1.6..2.2).contains(&speed), "vertical speed {speed} m/s");
}

#[test]
fn sea_surface_against_particles() {
    // Compares particles displaced by their labels (Lagrangian, no solving) with the surface sampled at their
    // positions.
    for (sea, tolerance) in [
        (paper(0.8, 5.0, 1), 2e-3),
        (paper(1.0, 6.0, 2), 2e-3),
        (irregular_sea(3), 2e-2),
    ] {
        for i in 0..300 {
            let label = Vector2::new(0.7 * f64::from(i), -0.3 * f64::from(i));
            let t = 0.13 * f64::from(i);
            let mut x = label;
            let mut up = 0.0;
            let mut v = Vector3::zeros();
            for c in sea.components() {
                let (s, co) = (c.wave_number * c.direction.dot(&label) - c.frequency * t + c.phase).sin_cos();
                x -= c.direction * (sea.steepness_factor * c.amplitude_m * s);
                up += c.amplitude_m * co;
                let h = sea.steepness_factor * c.amplitude_m * c.frequency * co;
                v += Vector3::new(
                    c.direction.x * h,
                    c.direction.y * h,
                    -c.amplitude_m * c.frequency * s,
                );
            }
            let w = sea.surface(at(t), x.x, x.y);
            assert!((w.elevation_m - up).abs() < tolerance, "{} {up}", w.elevation_m);
            assert!((w.velocity - v).norm() < tolerance, "{} {v}", w.velocity);
        }
    }
}

#[test]
fn sea_slope_against_elevation_gradient() {
    for sea in [paper(0.8, 5.0, 4), irregular_sea(4)] {
        for i in 0..100 {
            let n = 1.7 * f64::from(i);
            let e = 40.0 - f64::from(i);
            let t = at(0.31 * f64::from(i));
            let h = 1e-3;
            let dn = (sea.elevation(t, n + h, e) - sea.elevation(t, n - h, e)) / (2.0 * h);
            let de = (sea.elevation(t, n, e + h) - sea.elevation(t, n, e - h)) / (2.0 * h);
            let s = sea.surface(t, n, e).slope;
            assert!((s - Vector2::new(dn, de)).norm() < 5e-3, "{s} {dn} {de}");
        }
    }
}

#[test]
fn sea_surface_against_pressure_gradient() {
    // At the free surface of a Gerstner wave, g - a is normal to the surface.
    let sea = Sea::regular(0.8, 40.0, 0.6);
    for i in 0..100 {
        let w = sea.surface(at(0.1 * f64::from(i)), 3.0 * f64::from(i), 1.0);
        let force = w.acceleration - Vector3::new(0.0, 0.0, GRAVITY);
        let angle = force.normalize().dot(&w.normal().0);
        assert!(angle > 1.0 - 1e-6, "{angle}");
    }
}

#[test]
fn water_at_rest_far_below() {
    let sea = paper(0.5, 5.0, 7);
    let speed = |depth_m: f64| {
        let mut out = [WaterSample::default()];
        sea.sample(at(12.3), &[Vector2::new(4.0, 5.0)], depth_m, &mut out);
        out[0].velocity.norm()
    };
    assert!(speed(60.0) < 0.02 * speed(0.0) && speed(5.0) < speed(0.5));
}

#[test]
fn irregular_sea_heights() {
    let sea = irregular_sea(5);
    assert!((4.0 * sea.variance().sqrt() - 2.0).abs() < 1e-9);
    let z: Vec<f64> = (0..12_000)
        .map(|i| sea.elevation(at(0.1 * f64::from(i)), 0.0, 0.0))
        .collect();
    let mean = z.iter().sum::<f64>() / z.len() as f64;
    let sd = (z.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / z.len() as f64).sqrt();
    assert!((0.42..0.58).contains(&sd), "{sd}");
    // The autocorrelation at 60 to 600 s stays well below 1.
    let base = &z[..6000];
    for lag in 600..6000 {
        let c = base
            .iter()
            .zip(&z[lag..])
            .map(|(a, b)| (a - mean) * (b - mean))
            .sum::<f64>()
            / 6000.0;
        assert!(c / (sd * sd) < 0.9, "repeats after {lag} samples");
    }
}

#[test]
fn steep_sea_without_loops() {
    let mut config = SeaConfig {
        kind: SeaKind::PiersonMoskowitz,
        significant_height_m: 6.0,
        peak_period_s: 4.0,
        components: 64,
        ..SeaConfig::default()
    };
    for seed in 0..10 {
        config.spread = 1.0 + seed as f64;
        let sea = Sea::new(&config, &Streams::new(seed));
        assert!(sea.steepness() < 0.901);
        for i in 0..200 {
            let w = sea.surface(at(f64::from(i)), f64::from(i), 0.0);
            assert!(w.elevation_m.is_finite() && w.slope.norm().is_finite());
        }
    }
}

#[test]
fn sea_of_a_calm() {
    let calm = Sea::new(&SeaConfig::paper(0.0, 5.0), &Streams::new(1));
    assert_eq!(calm.surface(at(5.0), 1.0, 2.0), WaterSample::default());
}

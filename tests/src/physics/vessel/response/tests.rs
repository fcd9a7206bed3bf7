use super::{table::COLUMNS, *};
use crate::physics::{sea::SeaConfig, vessel::VesselCourse};
use alight_shared::geometry::GRAVITY;

fn at(s: f64) -> WorldTime {
    Time::from_secs(s)
}

fn vessel_of(hull: &str, course: VesselCourse, sea: &Sea, seed: u64) -> ResponseVessel {
    let files = HullFiles::load(hull).unwrap();
    let vessel = VesselConfig {
        course,
        change_at_s: Some(20.0),
        ..VesselConfig::default()
    };
    ResponseVessel::new(&files, &HullConfig::default(), &vessel, sea, &Streams::new(seed))
}

/// Table with the same response at all frequencies and directions.
fn flat(response: impl Fn(f64, f64) -> [f64; 12]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for omega in [0.5, 1.0, 2.0, 4.0] {
        for direction in [0.0, 60.0, 120.0, 180.0] {
            let r = response(omega, direction).map(|v| v.to_string());
            text += &format!("{omega},{direction},{}\n", r.join(","));
        }
    }
    text
}

#[test]
fn supplied_hulls_in_long_waves() {
    for name in HULLS {
        let hull = HullFiles::load(name).unwrap();
        assert_eq!(hull.table.range(), [0.4, 5.0], "{name}");
        // In waves much longer than the hull, the hull heaves and surges with the water.
        for deg in [0.0, 45.0, 90.0, 135.0, 180.0, -45.0, -90.0, 270.0] {
            let r = hull.table.at_frequency(0.4).towards(f64::to_radians(deg));
            assert!(
                (r.re[2] - 1.0).abs() < 0.02 && r.im[2].abs() < 0.03,
                "{name} {deg}"
            );
            let along = r.im[0];
            let port = r.im[1];
            let (s, c) = f64::to_radians(deg).sin_cos();
            assert!(
                (along - c).abs() < 0.05 && (port - s).abs() < 0.05,
                "{name} {deg}: {along} {port}"
            );
        }
    }
}

#[test]
fn response_nodes_and_symmetry() {
    let table = HullFiles::load("mono-5m").unwrap().table;
    let text = SUPPLIED[1].1;
    let row: Vec<f64> = text
        .lines()
        .find(|l| l.starts_with("1.5,60,"))
        .map(|l| l.split(',').map(|v| v.parse().unwrap()).collect())
        .unwrap();
    let r = table.at_frequency(1.5).towards(60_f64.to_radians());
    for d in 0..DOFS {
        assert!((r.re[d] - row[2 + 2 * d]).abs() < 1e-12 && (r.im[d] - row[3 + 2 * d]).abs() < 1e-12);
    }
    for k in 0..72 {
        let direction = 0.05 + 0.0871 * f64::from(k);
        for omega in [0.2, 0.77, 1.913, 6.0] {
            let here = table.at_frequency(omega).towards(direction);
            let there = table.at_frequency(omega).towards(-direction);
            for (d, sign) in [1.0, -1.0, 1.0, -1.0, 1.0, -1.0].into_iter().enumerate() {
                assert!((here.re[d] - sign * there.re[d]).abs() < 1e-12);
                assert!((here.im[d] - sign * there.im[d]).abs() < 1e-12);
            }
        }
    }
    // Linear between the frequencies.
    let [a, m, b] = [1.5, 1.53, 1.6].map(|w| table.at_frequency(w).towards(1.0));
    assert!((m.im[3] - (0.7 * a.im[3] + 0.3 * b.im[3])).abs() < 1e-12);
}

#[test]
fn bad_response_table() {
    let good = flat(|_, _| [0.1; 12]);
    assert!(ResponseTable::parse(&good, "boat.csv").is_ok());
    let line = |n: usize, text: &str| {
        let mut lines: Vec<&str> = good.lines().collect();
        lines[n - 1] = text;
        lines.join("\n")
    };
    let without = |n: usize| {
        let mut lines: Vec<&str> = good.lines().collect();
        lines.remove(n - 1);
        lines.join("\n")
    };
    let zeros = ",0,0,0,0,0,0,0,0,0,0,0,0";
    for (text, n, part) in [
        (String::new(), 1, "empty"),
        (line(1, "omega,direction"), 1, "columns"),
        (line(1, "t_s,roll_deg,pitch_deg"), 1, "--deck-motion"),
        ("\u{FFFD}HDF".into(), 1, "alight.convert"),
        (line(3, &format!("0.5,sixty{zeros}")), 3, "`sixty`, not a number"),
        (line(3, "0.5,60,1,2"), 3, "missing"),
        (line(3, &format!("0.5,60{zeros},7")), 3, "too many"),
        (line(4, &format!("0.5,60{zeros}")), 4, "does not ascend"),
        (line(4, &format!("nan,120{zeros}")), 4, "omega_radps"),
        (line(7, "1.0,60,0,0,0,0,0,0,45.3,0,0,0,0,0"), 7, "roll_re is 45.3"),
        (line(6, &format!("0.3,0{zeros}")), 6, "ascend"),
        (line(5, &format!("0.5,170{zeros}")), 6, "0 to 180"),
        (line(8, &format!("1.0,110{zeros}")), 8, "differs"),
        (without(9), 9, "directions"),
        (without(17), 16, "ends early"),
        (
            good.lines().take(5).collect::<Vec<_>>().join("\n"),
            5,
            "ends early",
        ),
    ] {
        let e = ResponseTable::parse(&text, "boat.csv").unwrap_err().to_string();
        assert!(
            e.contains(&format!("boat.csv, line {n}:")) && e.contains(part),
            "{e}"
        );
    }
    let e = HullFiles::load("no-such-hull").unwrap_err().to_string();
    assert!(e.contains("no-such-hull") && e.contains("twin-5m"), "{e}");
    let places = SUPPLIED[0].2.replace("length_m = 2.0", "length_m = 0.1");
    let e = Places::parse(&places, "boat.toml").unwrap_err().to_string();
    assert!(e.contains("boat.toml: deck.length_m is 0.1"), "{e}");
    assert!(Places::parse("[deck]\nforward = 1", "boat.toml").is_err());
}

#[test]
fn response_in_a_long_wave() {
    // Wave of 300 m length from astern, abeam and ahead, on both sides.
    for towards in [0.0, 0.8, 1.9, 3.1, -0.8, -2.2] {
        let wave = SeaComponent::deep(2.0, 0.453, towards, 0.7);
        let sea = Sea::of_linear_components(vec![wave]);
        let mut vessel = vessel_of("twin-5m", VesselCourse::Drift, &sea, 3);
        vessel.trim = [0.0; 2];
        for k in 0..60 {
            let t = at(0.5 * f64::from(k));
            let state = vessel.state_at(t);
            let p = state.position.0;
            // Surge and sway shift the position by 2 m, a small part of the wavelength.
            let water = sea.surface(t, 0.0, 0.0);
            assert!(
                (water.elevation_m + p.z).abs() < 0.06,
                "{} {}",
                water.elevation_m,
                p.z
            );
            assert!((state.velocity.0 - water.velocity).norm() < 0.06, "{}", towards);
            let heading = vessel.path.at(0.0).heading;
            let (s, c) = heading.sin_cos();
            let (roll, pitch, _) = state.attitude.euler();
            let ahead = water.slope.x * c + water.slope.y * s;
            let right = -water.slope.x * s + water.slope.y * c;
            assert!(
                (pitch - ahead).abs() < 0.006 && (roll + right).abs() < 0.006,
                "{pitch} {ahead} {roll} {right}"
            );
        }
    }
}

#[test]
fn response_motion_derivatives() {
    let config = "jonswap:0.8,4.5+jonswap:1,8@60".parse::<SeaConfig>().unwrap();
    let sea = Sea::linear(&config, &Streams::new(5));
    assert!(sea.components().len() >= 240);
    for course in VesselCourse::ALL {
        let mut vessel = vessel_of("mono-5m", course, &sea, 5);
        let mut worst = [0.0_f64; 4];
        let mut roughest = 0.0_f64;
        for k in 0..6000 {
            // Times in a leg, a turn and a leg, off the tick grid.
            let t = 0.503 + 0.01 * f64::from(k);
            let h = 1e-3;
            let [a, b, c] = [t - h, t, t + h].map(|t| vessel.state_at(at(t)));
            let v = (c.position.0 - a.position.0) / (2.0 * h);
            let acc = (c.velocity.0 - a.velocity.0) / (2.0 * h);
            let turn = (a.attitude.0.inverse() * c.attitude.0).scaled_axis() / (2.0 * h);
            let dw = (c.rates.0 - a.rates.0) / (2.0 * h);
            let errors = [
                (v - b.velocity.0).norm(),
                (acc - b.acceleration.0).norm(),
                (turn - b.rates.0).norm(),
                (dw - b.angular_acceleration.0).norm(),
            ];
            for (w, e) in worst.iter_mut().zip(errors) {
                *w = w.max(e);
            }
            roughest = roughest.max(b.acceleration.0.norm());
        }
        println!("{course:?}: {worst:?}, up to {roughest} m/s²");
        assert!(worst[0] < 2e-3 && worst[2] < 2e-3, "{course:?}: {worst:?}");
        assert!(worst[1] < 0.15 && worst[3] < 0.15, "{course:?}: {worst:?}");
        assert!((0.5..8.0).contains(&roughest), "{roughest}");
    }
}

#[test]
fn response_frequency_of_encounter() {
    // omega - k U cos(beta): head sea, following sea, and overtaking a short following wave.
    for (beta, omega, speed) in [
        (core::f64::consts::PI, 1.2, 3.0),
        (0.0, 1.2, 3.0),
        (0.0, 2.5, 6.0),
        (1.2, 1.5, 4.0),
    ] {
        let files = HullFiles {
            table: ResponseTable::parse(
                &flat(|_, _| [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
                "flat",
            )
            .unwrap(),
            places: HullFiles::load("twin-5m").unwrap().places,
        };
        let vessel = VesselConfig {
            course: VesselCourse::Straight,
            speed_mps: speed,
            heading_deg: Some(0.0),
            ..VesselConfig::default()
        };
        let sea = Sea::of_linear_components(vec![SeaComponent::deep(0.5, omega, beta, 0.0)]);
        let mut vessel = ResponseVessel::new(&files, &HullConfig::default(), &vessel, &sea, &Streams::new(1));
        let encounter = omega - omega * omega / GRAVITY * speed * f64::cos(beta);
        // Heave equals the water's elevation at the mean position, and oscillates at the frequency of encounter.
        let mut ups = Vec::new();
        let mut before = 0.0;
        for k in 0..20_000 {
            let t = 0.01 * f64::from(k);
            let z = vessel.state_at(at(t)).position.0.z;
            assert!((z + sea.elevation(at(t), speed * t, 0.0)).abs() < 1e-9);
            if before < 0.0 && z >= 0.0 {
                ups.push(t);
            }
            before = z;
        }
        let period = (ups[ups.len() - 1] - ups[0]) / (ups.len() - 1) as f64;
        assert!(
            (period * encounter.abs() / TAU - 1.0).abs() < 0.01,
            "{period} {encounter}"
        );
    }
}

#[test]
fn square_path_closure_and_speed() {
    for (speed, side) in [(2.0, 40.0), (1.0, 10.0), (6.0, 40.0)] {
        let config = VesselConfig {
            course: VesselCourse::Square,
            speed_mps: speed,
            side_m: side,
            ..VesselConfig::default()
        };
        let path = MeanPath::new(&config, 0.4, &Streams::new(1));
        let round = 4.0 * side / speed;
        let mut widest = 0.0_f64;
        let mut t = 0.0;
        // The start is on the first leg; later legs cut the corner at which the first leg began.
        let start = path.at(0.3 * side / speed).position;
        let mut nearest_after = f64::INFINITY;
        while t < 1.2 * round {
            let b = path.at(t);
            assert!((b.velocity.norm() - speed).abs() < 1e-9);
            widest = widest.max((b.position - start).norm());
            if t > 0.5 * round {
                nearest_after = nearest_after.min((b.position - start).norm());
            }
            t += 0.037;
        }
        assert!(widest < 1.3 * side && widest > 0.9 * side, "{widest}");
        assert!(nearest_after < 0.05 * speed, "{nearest_after}");
    }
}

#[test]
fn sea_heights_and_periods() {
    let config: SeaConfig = "jonswap:1.5,6".parse().unwrap();
    for seed in 0..3 {
        let sea = Sea::linear(&config, &Streams::new(seed));
        // Elevation at one position over twenty minutes: zero crossings.
        let z: Vec<f64> = (0..12_000)
            .map(|i| sea.elevation(at(0.1 * f64::from(i)), 3.0, -7.0))
            .collect();
        let ups = z.windows(2).filter(|w| w[0] < 0.0 && w[1] >= 0.0).count();
        // JONSWAP 3.3: T_z = 0.78 Tp (Goda 2000).
        let crossing = 1200.0 / ups as f64;
        assert!((crossing / (0.78 * 6.0) - 1.0).abs() < 0.1, "{crossing}");
    }
    let cross: SeaConfig = "jonswap:0.8,4.5+jonswap:1,8@90".parse().unwrap();
    let sea = Sea::linear(&cross, &Streams::new(2));
    assert!((16.0 * sea.variance() - 0.64 - 1.0).abs() < 1e-9);
    let mean = |low: f64, high: f64| {
        let in_band = |c: &&SeaComponent| (low..high).contains(&c.frequency);
        let sum: Vector2<f64> = sea.components().iter().filter(in_band).map(|c| c.direction).sum();
        sum.y.atan2(sum.x)
    };
    let apart = alight_shared::frames::wrap_angle(mean(0.6, 0.9) - mean(1.8, 4.0));
    assert!((apart - core::f64::consts::FRAC_PI_2).abs() < 0.35, "{apart}");
}

#[test]
fn linear_water_consistency() {
    let config: SeaConfig = "pm:1,5".parse().unwrap();
    let sea = Sea::linear(&config, &Streams::new(4));
    for i in 0..50 {
        let n = 3.7 * f64::from(i);
        let e = -f64::from(i);
        let t = 0.9 * f64::from(i);
        let h = 1e-4;
        let w = sea.surface(at(t), n, e);
        let slope = Vector2::new(
            (sea.elevation(at(t), n + h, e) - sea.elevation(at(t), n - h, e)) / (2.0 * h),
            (sea.elevation(at(t), n, e + h) - sea.elevation(at(t), n, e - h)) / (2.0 * h),
        );
        assert!((w.slope - slope).norm() < 1e-6);
        let up = (sea.elevation(at(t + h), n, e) - sea.elevation(at(t - h), n, e)) / (2.0 * h);
        assert!((w.velocity.z + up).abs() < 1e-6);
        let acc = (sea.surface(at(t + h), n, e).velocity - sea.surface(at(t - h), n, e).velocity) / (2.0 * h);
        assert!((w.acceleration - acc).norm() < 1e-6);
    }
}

#[test]
fn seed_draws_of_phases_directions_and_heading() {
    let config: SeaConfig = "jonswap:1,5".parse().unwrap();
    let angle = |seed: u64| {
        let sea = Sea::linear(&config, &Streams::new(seed));
        let vessel = vessel_of("twin-5m", VesselCourse::Drift, &sea, seed);
        let pose = vessel.state().position.0.z;
        (
            (vessel.path.at(0.0).heading - sea.mean_direction()).rem_euclid(TAU),
            pose,
        )
    };
    let all: Vec<(f64, f64)> = (0..40).map(angle).collect();
    assert_eq!(angle(7), all[7]);
    for quarter in 0..4 {
        let range = TAU / 4.0 * f64::from(quarter)..TAU / 4.0 * f64::from(quarter + 1);
        assert!(all.iter().filter(|a| range.contains(&a.0)).count() >= 4);
    }
    let spread = all.iter().map(|a| a.1 * a.1).sum::<f64>() / 40.0;
    assert!(spread > 0.02, "{spread}");
}

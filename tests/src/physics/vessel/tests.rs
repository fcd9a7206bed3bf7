use super::*;
use crate::physics::sea::{SeaConfig, SeaKind};

const DT: f64 = 0.01;

fn calm() -> Sea {
    Sea::from_components(Vec::new())
}
fn heading_north() -> VesselConfig {
    VesselConfig {
        heading_deg: Some(0.0),
        ..VesselConfig::default()
    }
}
fn run(vessel: &mut Vessel, sea: &Sea, seconds: f64, mut see: impl FnMut(f64, &RigidState<VesselBody>)) {
    for i in 0..(seconds / DT).round() as i64 {
        let t = Time::from_nanos(i * 10_000_000);
        vessel.step(t, DT, sea);
        see((i + 1) as f64 * DT, &vessel.state());
    }
}

#[test]
fn vessel_on_calm_water() {
    let sea = calm();
    let mut vessel = Vessel::new(&heading_north(), &sea, &Streams::new(1));
    run(&mut vessel, &sea, 20.0, |_, _| {});
    let s = vessel.state();
    assert!(s.position.0.norm() < 1e-6, "{:?}", s.position);
    assert!(s.velocity.norm() < 1e-6 && s.rates.norm() < 1e-6);
    assert!(s.attitude.0.angle() < 1e-6);
}

#[test]
fn vessel_natural_periods() {
    // Released 3 cm too high, or tilted by 2 deg, with little damping.
    let sea = calm();
    let config = VesselConfig {
        damping_ratio: [0.02; 3],
        ..heading_north()
    };
    for (axis, low, high) in [("heave", 0.6, 0.8), ("roll", 0.3, 0.5), ("pitch", 0.45, 0.75)] {
        let mut vessel = Vessel::new(&config, &sea, &Streams::new(1));
        match axis {
            "heave" => vessel.motion.position.z = -0.03,
            "roll" => vessel.motion.attitude = UnitQuaternion::from_euler_angles(0.035, 0.0, 0.0),
            _ => vessel.motion.attitude = UnitQuaternion::from_euler_angles(0.0, 0.035, 0.0),
        }
        let mut crossings = Vec::new();
        let mut before = 1.0;
        run(&mut vessel, &sea, 5.0, |t, s| {
            let e = s.euler();
            let x = match axis {
                "heave" => s.position.0.z,
                "roll" => e.x,
                _ => e.y,
            };
            if x < 0.0 && before >= 0.0 {
                crossings.push(t);
            }
            before = x;
        });
        let n = crossings.len();
        let period = (crossings[n - 1] - crossings[0]) / (n - 1) as f64;
        assert!((low..high).contains(&period), "{axis}: {period} s");
    }
}

#[test]
fn vessel_in_long_waves() {
    // Wave of 160 m length and 0.8 m amplitude; the length is 33 times the hull's.
    let sea = Sea::regular(0.8, 160.0, 0.5);
    let config = VesselConfig {
        heading_deg: Some(60.0),
        ..VesselConfig::default()
    };
    let mut vessel = Vessel::new(&config, &sea, &Streams::new(1));
    let mut heave = 0.0_f64;
    let mut tilt = 0.0_f64;
    let mut deficit = 0.0_f64;
    let mut speed = 0.0_f64;
    run(&mut vessel, &sea, 60.0, |t, s| {
        let w = sea.surface(Time::from_secs(t), s.position.0.x, s.position.0.y);
        heave = heave.max((s.position.0.z - w.surface_z()).abs());
        tilt = tilt.max((s.attitude.down().0 + w.normal().0).norm());
        deficit = deficit.max((s.velocity.0 - w.velocity).norm());
        speed = speed.max(w.velocity.norm());
    });
    assert!(heave < 0.02, "{heave} m off the surface");
    assert!(
        tilt.to_degrees() < 0.35,
        "{} deg off the slope",
        tilt.to_degrees()
    );
    assert!(deficit < 0.08 * speed, "slips {deficit} of {speed} m/s");
}

#[test]
fn vessel_without_sideways_coupling() {
    let sea = Sea::regular(0.8, 80.0, 0.0);
    let reach = |coupling: f64| {
        let config = VesselConfig {
            sideways_coupling: coupling,
            ..heading_north()
        };
        let mut vessel = Vessel::new(&config, &sea, &Streams::new(1));
        let mut low = 0.0_f64;
        let mut high = 0.0_f64;
        run(&mut vessel, &sea, 30.0, |_, s| {
            low = low.min(s.velocity.0.x);
            high = high.max(s.velocity.0.x);
        });
        high - low
    };
    let full = reach(1.0);
    let half = reach(0.5);
    let none = reach(0.0);
    assert!(none < 0.35 * full && half < 0.75 * full, "{full} {half} {none}");
}

#[test]
fn vessel_motion_derivatives() {
    let sea = Sea::new(&SeaConfig::paper(0.8, 5.0), &Streams::new(2));
    let mut vessel = Vessel::new(&VesselConfig::default(), &sea, &Streams::new(2));
    let mut last: Vec<RigidState<VesselBody>> = Vec::new();
    run(&mut vessel, &sea, 20.0, |_, s| last.push(*s));
    for w in last[200..].windows(3) {
        let v = (w[2].position.0 - w[0].position.0) / (2.0 * DT);
        assert!((v - w[1].velocity.0).norm() < 2e-3);
        let a = (w[2].velocity.0 - w[0].velocity.0) / (2.0 * DT);
        assert!(
            (a - w[1].acceleration.0).norm() < 5e-2,
            "{a} {}",
            w[1].acceleration.0
        );
        let turn = (w[0].attitude.0.inverse() * w[2].attitude.0).scaled_axis() / (2.0 * DT);
        assert!((turn - w[1].rates.0).norm() < 5e-3);
        let dw = (w[2].rates.0 - w[0].rates.0) / (2.0 * DT);
        assert!((dw - w[1].angular_acceleration.0).norm() < 0.1);
    }
}

#[test]
fn vessel_in_ten_minutes_of_steep_seas() {
    let irregular = SeaConfig {
        kind: SeaKind::Jonswap,
        significant_height_m: 3.0,
        peak_period_s: 6.0,
        ..SeaConfig::default()
    };
    for (config, course) in [
        (SeaConfig::paper(1.0, 6.0), VesselCourse::Drift),
        (SeaConfig::paper(1.0, 6.0), VesselCourse::Square),
        (irregular, VesselCourse::Drift),
    ] {
        let sea = Sea::new(&config, &Streams::new(11));
        let vessel_config = VesselConfig {
            course,
            ..VesselConfig::default()
        };
        let mut vessel = Vessel::new(&vessel_config, &sea, &Streams::new(11));
        run(&mut vessel, &sea, 600.0, |t, s| {
            let w = sea.surface(Time::from_secs(t), s.position.0.x, s.position.0.y);
            assert!((s.position.0.z - w.surface_z()).abs() < 0.6, "heave at {t}");
            assert!(s.velocity.norm() < 8.0 && s.rates.norm() < 3.0, "fast at {t}");
            assert!(s.attitude.down().0.z > 0.6, "tilted at {t}");
        });
    }
}

#[test]
fn vessel_square_course_at_2_mps() {
    let sea = calm();
    let config = VesselConfig {
        course: VesselCourse::Square,
        ..heading_north()
    };
    let mut vessel = Vessel::new(&config, &sea, &Streams::new(3));
    let mut legs = [0_u32; 4];
    let mut low = Vector3::repeat(f64::MAX);
    let mut high = Vector3::repeat(f64::MIN);
    run(&mut vessel, &sea, 90.0, |_, s| {
        let quarter = (s.euler().z.rem_euclid(TAU) / (TAU / 4.0)).round() as usize % 4;
        legs[quarter] += 1;
        low = low.inf(&s.position.0);
        high = high.sup(&s.position.0);
    });
    assert!(legs.iter().all(|n| *n > 1600), "{legs:?}");
    for i in 0..2 {
        assert!((38.0..52.0).contains(&(high[i] - low[i])), "{low} {high}");
    }
}

#[test]
fn vessel_mean_path_on_every_course() {
    let sea = Sea::new(&SeaConfig::paper(0.4, 5.0), &Streams::new(3));
    for course in [
        VesselCourse::Straight,
        VesselCourse::Zigzag,
        VesselCourse::Turn,
        VesselCourse::SpeedChange,
        VesselCourse::StationKeeping,
        VesselCourse::Anchored,
    ] {
        let mut config = VesselConfig {
            course,
            change_at_s: Some(30.0),
            ..heading_north()
        };
        config.power_for(3.0);
        for seed in 0..3 {
            let streams = Streams::new(seed);
            let path = path::MeanPath::new(&config, 0.0, &streams);
            let mut vessel = Vessel::new(&config, &sea, &streams);
            let mut speed = 0.0;
            let mut heading = 0.0;
            let mut place = 0.0_f64;
            let mut n = 0.0;
            run(&mut vessel, &sea, 120.0, |t, s| {
                // The waves average out.
                let here = path.at(t);
                let off = alight_shared::frames::wrap_angle(s.euler().z - here.heading);
                heading += off * off;
                let ahead = Vector2::new(here.heading.cos(), here.heading.sin());
                speed += ahead.dot(&(s.velocity.0.xy() - here.velocity));
                place = place.max((s.position.0.xy() - here.position).norm());
                n += 1.0;
            });
            let heading = f64::sqrt(heading / n).to_degrees();
            let speed: f64 = speed / n;
            println!("{course:?} {seed}: heading {heading} deg, speed {speed} m/s, place {place} m");
            assert!(
                heading < 18.0 && speed.abs() < 0.3,
                "{course:?} {seed}: {heading} deg, {speed} m/s"
            );
            assert!(
                course.is_under_way() || place < 4.0,
                "{course:?} {seed}: {place} m"
            );
        }
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(24))]
    #[test]
    fn vessel_of_any_configuration_in_any_sea(
        mass in 60.0..450.0_f64, damping in 0.0..2.0_f64, radius in 0.0..1.0_f64,
        amplitude in 0.0..1.2_f64, period in 5.0..12.0_f64, coupling in 0.0..1.0_f64, seed in 0_u64..1000,
    ) {
        use alight_shared::config::{Check, Keys};
        let l2 = mass * 4.9 * 4.9;
        let config = VesselConfig {
            mass_kg: mass,
            // Inertias from the minimum to a quarter of the maximum.
            inertia_kgm2: [l2 * (1.0 / 400.0 + radius); 3],
            damping_ratio: [damping; 3],
            sideways_coupling: coupling,
            course: VesselCourse::Square,
            ..VesselConfig::default()
        };
        proptest::prop_assert!(config.check(&Keys::ROOT).is_ok());
        let sea = Sea::new(&SeaConfig::paper(amplitude, period), &Streams::new(seed));
        let mut vessel = Vessel::new(&config, &sea, &Streams::new(seed));
        run(&mut vessel, &sea, 30.0, |_, _| {});
        let s = vessel.state();
        proptest::prop_assert!(s.position.0.norm() < 300.0 && s.velocity.norm() < 15.0, "{:?}", s.position);
        proptest::prop_assert!(s.acceleration.norm() < 100.0 && s.rates.norm() < 10.0);
    }
}

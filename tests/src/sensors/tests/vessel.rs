use super::*;
use alight_shared::msg::{ImuSample, Message};
use nalgebra::UnitQuaternion;

#[test]
fn ideal_imu_on_its_lever_arm() {
    let config = ideal();
    let lever_arm = Vector3::from(config.vessel_imu.lever_arm_m);
    let mut s = sensors(&config, 1);
    let start = rocking::<VesselBody>(0.0).at::<VesselBody>(lever_arm);
    let (mut q, mut v, mut p) = (start.attitude.0, start.velocity.0, start.position.0);
    let gravity = Vector3::new(0.0, 0.0, alight_shared::geometry::GRAVITY);
    let (dt, seconds) = (0.01, 20.0);
    let mut last: Option<ImuSample> = None;
    let mut k = 0;
    while (k as f64) * dt <= seconds + 1e-9 {
        let t = tick(k);
        for m in s.vessel.step(t, &rocking(t.secs())).imu {
            assert_eq!(m.check(), Ok(()));
            assert_eq!(m.header.at, s.clocks.vessel.read(t));
            if let Some(l) = last {
                // Trapezoidal rule for the rate, and for the specific force in NED.
                let mean = (Vector3::from(l.gyro) + Vector3::from(m.gyro)) * 0.5;
                let next = q * UnitQuaternion::from_scaled_axis(mean * dt);
                let a = (q * Vector3::from(l.accelerometer) + next * Vector3::from(m.accelerometer)) * 0.5
                    + gravity;
                p += v * dt + a * (0.5 * dt * dt);
                v += a * dt;
                q = next;
            }
            last = Some(m);
        }
        k += 1;
    }
    let end = rocking::<VesselBody>(seconds).at::<VesselBody>(lever_arm);
    assert!(
        q.angle_to(&end.attitude.0) < 1e-4,
        "{}",
        q.angle_to(&end.attitude.0)
    );
    assert!((v - end.velocity.0).norm() < 5e-3, "{v} {:?}", end.velocity);
    assert!((p - end.position.0).norm() < 5e-2, "{p} {:?}", end.position);
    // Without its lever arm the position would be wrong.
    assert!((end.position - rocking::<VesselBody>(seconds).position).norm() > 0.3);
}

#[test]
fn level_imu_at_rest() {
    let mut s = sensors(&ideal(), 1);
    let m = s.vessel.step(tick(0), &still([0.0; 3], [0.0; 3])).imu;
    assert_eq!(m.len(), 1);
    assert!((Vector3::from(m[0].accelerometer) - Vector3::new(0.0, 0.0, -9.806_65)).norm() < 1e-12);
    // With the bow up, the forward axis measures part of the reaction to gravity.
    let m = s.vessel.step(tick(1), &still([0.0; 3], [0.0, 0.1, 0.0])).imu;
    assert!((m[0].accelerometer[0] - 9.806_65 * 0.1_f64.sin()).abs() < 1e-12);
}

#[test]
fn imu_noise_and_bias() {
    let (mut gyro_means, mut force_means) = (vec![], vec![]);
    let (mut gyro_sd, mut force_sd) = (0.0, 0.0);
    let mut config = SensorConfig::default();
    config.vessel_imu.alignment_sd_deg = 0.0;
    let seeds = 200;
    for seed in 0..seeds {
        let mut s = sensors(&config, seed);
        let (mut g, mut f) = (vec![], vec![]);
        for k in 0..200 {
            for m in s.vessel.step(tick(k), &still([0.0; 3], [0.0; 3])).imu {
                g.push(m.gyro[1]);
                f.push(m.accelerometer[0]);
            }
        }
        let (a, b) = (moments(&g), moments(&f));
        gyro_means.push(a.0);
        force_means.push(b.0);
        gyro_sd += a.1 / seeds as f64;
        force_sd += b.1 / seeds as f64;
    }
    assert!((gyro_sd / 0.009 - 1.0).abs() < 0.03, "{gyro_sd}");
    assert!((force_sd / 0.021 - 1.0).abs() < 0.03, "{force_sd}");
    let (gyro_bias, force_bias) = (moments(&gyro_means).1, moments(&force_means).1);
    assert!((gyro_bias / 0.005 - 1.0).abs() < 0.2, "{gyro_bias}");
    assert!((force_bias / 0.05 - 1.0).abs() < 0.2, "{force_bias}");
}

#[test]
fn ideal_gnss_fix() {
    let config = ideal();
    let antenna = Vector3::from(config.vessel_gnss.antenna_m);
    let mut s = sensors(&config, 1);
    let mut n = 0;
    for k in 0..1000 {
        let t = tick(k);
        for fix in s.vessel.step(t, &rocking(t.secs())).gnss {
            assert_eq!(fix.check(), Ok(()));
            let at = s.clocks.vessel.true_time(fix.header.at);
            // The clock's drift is rounded to a nanosecond.
            assert!(((t - at).secs() - 0.05).abs() < 1e-8);
            let truth = rocking::<VesselBody>(at.secs()).at::<VesselBody>(antenna);
            assert!((Vector3::from(fix.position) - truth.position.0).norm() < 1e-6);
            assert!((Vector3::from(fix.velocity) - truth.velocity.0).norm() < 1e-6);
            assert_eq!(fix.header.sequence, n);
            n += 1;
        }
    }
    assert_eq!(n, 100);
}

#[test]
fn gnss_errors() {
    let mut config = SensorConfig::default();
    config.vessel_gnss.antenna_error_sd_m = 0.0;
    config.vessel_gnss.antenna_m = [0.0; 3];
    let (mut biases, mut white, mut speed) = (vec![], vec![], vec![]);
    for seed in 0..150 {
        let mut s = sensors(&config, seed);
        let mut north = vec![];
        for k in 0..600 {
            for fix in s.vessel.step(tick(k), &still([0.0; 3], [0.0; 3])).gnss {
                assert_eq!(fix.position_sd, [0.3; 3]);
                north.push(fix.position);
                speed.extend(fix.velocity);
            }
        }
        for axis in 0..3 {
            let x: Vec<f64> = north.iter().map(|p| p[axis]).collect();
            // Differences between successive samples do not contain the slow bias.
            white.extend(x.windows(2).map(|w| (w[1] - w[0]) / 2_f64.sqrt()));
            biases.push(moments(&x).0);
        }
        let mean = Vector3::from(core::array::from_fn::<f64, 3, _>(|a| {
            north.iter().map(|p| p[a]).sum::<f64>() / north.len() as f64
        }));
        assert!((mean - s.vessel.gnss_bias()).norm() < 0.8);
    }
    let sd = moments(&white).1;
    assert!((sd / 0.3 - 1.0).abs() < 0.03, "white {sd}");
    let sd = moments(&biases).1;
    assert!((sd / 1.0 - 1.0).abs() < 0.12, "bias {sd}");
    let sd = moments(&speed).1;
    assert!((sd / 0.1 - 1.0).abs() < 0.03, "velocity {sd}");
}

#[test]
fn gnss_errors_of_the_two_craft() {
    let config = gnss::GnssErrorConfig::default();
    let (mut product, n) = (0.0, 300);
    for seed in 0..n {
        let s = Streams::new(seed);
        let (a, b) = (
            gnss::GnssError::new(&config, &s, "vessel"),
            gnss::GnssError::new(&config, &s, "drone"),
        );
        product += a.bias().dot(&b.bias()) / 3.0 / n as f64;
    }
    assert!(product.abs() < 0.15, "{product}");
}

#[test]
fn heading_errors() {
    let truth = 3.1;
    let (mut white, mut mean) = (vec![], vec![]);
    for seed in 0..150 {
        let mut s = sensors(&SensorConfig::default(), seed);
        let mut errors = vec![];
        for k in 0..600 {
            for fix in s
                .vessel
                .step(tick(k), &still([0.0; 3], [0.2, -0.1, truth]))
                .heading
            {
                assert_eq!(fix.check(), Ok(()));
                assert!(fix.heading.abs() <= core::f64::consts::PI);
                errors.push(alight_shared::frames::wrap_angle(fix.heading - truth).to_degrees());
            }
        }
        white.extend(errors.windows(2).map(|w| (w[1] - w[0]) / 2_f64.sqrt()));
        mean.push(moments(&errors).0);
    }
    assert!((moments(&white).1 - 1.0).abs() < 0.03, "{}", moments(&white).1);
    assert!((moments(&mean).1 / 0.5 - 1.0).abs() < 0.2, "{}", moments(&mean).1);
}

#[test]
fn gnss_outages_and_dropouts() {
    let run = |outages: Vec<[f64; 2]>, dropout| {
        let mut config = SensorConfig::default();
        config.vessel_gnss.outages_s = noise::Windows(outages);
        config.vessel_gnss.dropout = dropout;
        let mut s = sensors(&config, 4);
        (0..6000)
            .flat_map(|k| s.vessel.step(tick(k), &still([0.0; 3], [0.0; 3])).gnss)
            .map(|f| (f.header.at, f.position))
            .collect::<Vec<_>>()
    };
    let all = run(vec![], 0.0);
    let cut = run(vec![[10.0, 20.0]], 0.0);
    assert_eq!((all.len(), cut.len()), (600, 500));
    assert!(cut.iter().all(|f| all.contains(f)));
    let thin = run(vec![], 0.3);
    assert!((360..480).contains(&thin.len()), "{}", thin.len());
    assert!(thin.iter().all(|f| all.contains(f)));
}

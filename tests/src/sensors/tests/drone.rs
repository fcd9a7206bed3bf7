use super::*;
use alight_shared::{frames::Camera, msg::Message};
use nalgebra::{Quaternion, UnitQuaternion};

/// Level deck at the origin, 1.3 m above the water.
fn deck() -> RigidState<Deck> {
    still([0.0; 3], [0.0; 3])
}
const FLAT: fn(f64, f64) -> f64 = |_, _| 1.3;

fn watch(
    config: &SensorConfig,
    drone: &RigidState<DroneBody>,
    deck: &RigidState<Deck>,
    ticks: usize,
) -> DroneReadings {
    let mut s = sensors(config, 1);
    let mut all = DroneReadings::default();
    for k in 0..ticks {
        let r = s.drone.step(tick(k), drone, deck, FLAT);
        all.tags.extend(r.tags);
        all.uvdar.extend(r.uvdar);
        all.ranges.extend(r.ranges);
    }
    all
}
fn sees_tag(drone: [f64; 3], euler: [f64; 3]) -> bool {
    !watch(&ideal(), &still(drone, euler), &deck(), 20).tags.is_empty()
}
fn sees_uvdar(drone: [f64; 3], euler: [f64; 3]) -> bool {
    !watch(&ideal(), &still(drone, euler), &deck(), 20)
        .uvdar
        .is_empty()
}
fn range(drone: [f64; 3], euler: [f64; 3], deck: &RigidState<Deck>) -> Option<f64> {
    let r = watch(&ideal(), &still(drone, euler), deck, 5).ranges;
    r.first().map(|m| m.range_m)
}

#[test]
fn ideal_tag_detection() {
    let mut config = ideal();
    config.tag.latency_s = 0.05;
    let geometry = DroneGeometry::default();
    let mut s = sensors(&config, 1);
    let mut n = 0;
    let drone = |t: f64| {
        let mut d = rocking::<DroneBody>(0.7 * t + 1.0);
        d.position = rocking::<Deck>(t).position + Vector::<TrueNed>::new(0.5, -0.4, -6.0);
        d
    };
    for k in 0..300 {
        let t = tick(k);
        for m in s.drone.step(t, &drone(t.secs()), &rocking(t.secs()), FLAT).tags {
            assert_eq!(m.check(), Ok(()));
            let at = s.clocks.drone.true_time(m.header.at);
            assert!(((t - at).secs() - 0.05).abs() < 1e-8);
            let (d, deck) = (drone(at.secs()), rocking::<Deck>(at.secs()));
            let measured = Vector::<Camera>::from(Vector3::from(m.position));
            let body = camera::body_from_camera() * measured;
            let centre = d.position
                + d.attitude * (Vector::<DroneBody>::from(Vector3::from(geometry.camera_m)) + body);
            assert!(
                (centre - deck.position).norm() < 1e-4,
                "{:?}",
                centre - deck.position
            );
            let [w, i, j, k] = m.attitude;
            let q = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
            let measured = d.attitude.0 * camera::body_from_camera().0 * q;
            assert!(
                measured.angle_to(&deck.attitude.0) < 1e-4,
                "{}",
                measured.angle_to(&deck.attitude.0)
            );
            n += 1;
        }
    }
    assert!(n > 80, "{n}");
}

#[test]
fn tag_visibility_limits() {
    let level = [0.0; 3];
    assert!(sees_tag([0.0, 0.0, -7.0], level));
    // 480 rows cover 73.7 deg fore and aft, 640 columns cover 90 deg across.
    assert!(!sees_tag([0.0, 7.0, -7.0], level) && sees_tag([0.0, 6.0, -7.0], level));
    assert!(!sees_tag([5.0, 0.0, -7.0], level) && sees_tag([4.5, 0.0, -7.0], level));
    // A tilt moves the tag in the image: at 30 deg bow up, a tag straight below is at the upper edge.
    assert!(sees_tag([0.0, 0.0, -7.0], [0.0, 0.5, 0.0]));
    assert!(!sees_tag([0.0, 0.0, -7.0], [0.0, 0.62, 0.0]));
    // At 24.1 m and a focal length of 320 px, 1 m corresponds to 13.3 px.
    assert!(sees_tag([0.0, 0.0, -23.6], level) && !sees_tag([0.0, 0.0, -24.6], level));
    // Below 0.67 m the corners of a 1 m tag do not fit into 73.7 deg.
    assert!(sees_tag([0.0, 0.0, -0.80], level) && !sees_tag([0.0, 0.0, -0.70], level));
    // The width limits an oblique view; the permitted angle is greater nearby than far away.
    let reads = |height: f64, deg: f64| {
        let tilted = still::<Deck>([0.0; 3], [0.0, deg.to_radians(), 0.0]);
        let at = still([0.0, 0.0, -height], level);
        !watch(&ideal(), &at, &tilted, 20).tags.is_empty()
    };
    assert!(reads(3.0, 75.0) && !reads(3.0, 85.0));
    assert!(reads(13.0, 45.0) && !reads(13.0, 65.0));
    // The back of the tag is blank.
    assert!(!sees_tag([0.0, 0.0, 3.0], [core::f64::consts::PI, 0.0, 0.0]));
}

#[test]
fn tag_blur_tolerance_by_size() {
    // At 320 px and 4 ms, each rad/s causes 1.28 px of motion.
    let reads = |height: f64, rate: f64| {
        let mut spinning = still([0.0, 0.0, -height], [0.0; 3]);
        spinning.rates = Vector::new(rate, 0.0, 0.0);
        !watch(&ideal(), &spinning, &deck(), 20).tags.is_empty()
    };
    assert!(reads(4.0, 9.0) && !reads(4.0, 14.0));
    assert!(reads(12.0, 4.0) && !reads(12.0, 7.0));
}

/// Root mean square error of detections, m, reported error, m, and fraction of frames with a detection.
fn scatter(config: &SensorConfig, drone: &RigidState<DroneBody>, seconds: usize) -> (f64, f64, f64) {
    let tags = watch(config, drone, &deck(), 100 * seconds).tags;
    let exact = watch(&ideal(), drone, &deck(), 20).tags[0];
    let n = tags.len() as f64;
    let moved = |m: &TagPose| (Vector3::from(m.position) - Vector3::from(exact.position)).norm_squared();
    let stated = |m: &TagPose| m.variance[..3].iter().sum::<f64>();
    (
        (tags.iter().map(moved).sum::<f64>() / n).sqrt(),
        (tags.iter().map(stated).sum::<f64>() / n).sqrt(),
        n / (30 * seconds) as f64,
    )
}

#[test]
fn tag_detection_by_size() {
    let mut config = SensorConfig::default();
    config.camera_mount.angle_sd_deg = 0.0;
    config.camera_mount.position_sd_m = 0.0;
    config.tag.loss = vision_loss::VisionLossConfig::none();
    let mut last = (0.0, 1.1);
    for height in [2.0, 6.0, 12.0, 23.0] {
        let (real, stated, rate) = scatter(&config, &still([0.2, 0.1, -height], [0.0, 0.05, 0.3]), 20);
        assert!(real > last.0 && rate <= last.1, "{height} m: {real} m, {rate}");
        // For a large, sharp tag the error is half the reported error. For a small tag two tilts fit equally
        // well; the wrong one exceeds any reported deviation.
        assert!(
            (0.75..4.0).contains(&(stated / real)),
            "{height} m: {real} {stated}"
        );
        last = (real, rate);
    }
    assert!(last.1 < 0.95, "{}", last.1);
    // Noise of one pixel at the corners, independent of the image.
    config.tag.corner_sd_px = 1.0;
    let (coarse, _, _) = scatter(&config, &still([0.2, 0.1, -6.0], [0.0, 0.05, 0.3]), 20);
    config.tag.corner_sd_px = 0.1;
    let (fine, _, _) = scatter(&config, &still([0.2, 0.1, -6.0], [0.0, 0.05, 0.3]), 20);
    assert!(coarse > 4.0 * fine, "{coarse} {fine}");
}

#[test]
fn camera_mount_errors() {
    let config = SensorConfig::default();
    let (mut turns, mut shifts) = (vec![], vec![]);
    for seed in 0..300 {
        let s = sensors(&config, seed);
        let error = camera::body_from_camera().inverse() * s.drone.mount.attitude;
        turns.extend(error.0.scaled_axis().iter().map(|r| r.to_degrees()));
        let shift = s.drone.mount.position - Vector3::from(DroneGeometry::default().camera_m);
        shifts.extend(shift.iter().copied());
    }
    assert!((moments(&turns).1 - 1.0).abs() < 0.08, "{:?}", moments(&turns));
    assert!(
        (moments(&shifts).1 / 0.01 - 1.0).abs() < 0.08,
        "{:?}",
        moments(&shifts)
    );
    let mut wrong = ideal();
    wrong.camera_mount.angle_sd_deg = 1.0;
    let drone = still([0.0, 0.0, -10.0], [0.0; 3]);
    let (a, b) = (
        watch(&ideal(), &drone, &deck(), 10).tags[0],
        watch(&wrong, &drone, &deck(), 10).tags[0],
    );
    let moved = (Vector3::from(a.position) - Vector3::from(b.position)).norm();
    // A degree at 10 m corresponds to 17 cm.
    assert!((0.02..0.8).contains(&moved), "{moved}");
}

#[test]
fn uvdar_range() {
    let level = [0.0; 3];
    assert!(sees_uvdar([-26.0, 0.0, -13.0], level) && !sees_tag([-26.0, 0.0, -13.0], level));
    assert!(!sees_uvdar([-30.0, 0.0, -15.0], level), "beyond 31 m");
    assert!(
        !sees_uvdar([-10.0, 0.0, 0.5], level),
        "the deck is above the drone"
    );
    assert!(sees_uvdar([0.0, 0.0, -7.0], level), "straight down");
    assert!(!sees_uvdar([30.0, 0.0, -5.0], level), "behind, near the horizon");
    assert!(!sees_uvdar([0.0, 0.0, -1.0], level), "too near");
}

#[test]
fn uvdar_fix_variance() {
    let mut config = ideal();
    config.uvdar.distance_correlation_s = 0.05;
    // The reported deviation must exceed its minimum.
    (config.uvdar.bearing_sd_deg, config.uvdar.distance_sd) = (0.5, 0.07);
    config.uvdar.aside_sd_m = 0.0;
    let drone = still([-12.0, 5.0, -9.0], [0.05, -0.03, 0.2]);
    let fixes = watch(&config, &drone, &deck(), 20_000).uvdar;
    let camera = Vector::<DroneBody>::from(Vector3::from(DroneGeometry::default().camera_m));
    let lever_arm = drone.attitude.inverse() * (Point::<TrueNed>::origin() - drone.position) - camera;
    let truth = camera::body_from_camera().inverse() * lever_arm;
    let (mut distance, mut chi) = (vec![], [0.0; 3]);
    for f in &fixes {
        assert_eq!(f.check(), Ok(()));
        let p = Vector3::from(f.position);
        distance.push(p.norm() / truth.norm() - 1.0);
        for i in 0..3 {
            chi[i] += (p[i] - truth.0[i]).powi(2) / f.variance[i] / fixes.len() as f64;
        }
    }
    let (mean, sd) = moments(&distance);
    assert!(mean.abs() < 0.01 && (sd / 0.07 - 1.0).abs() < 0.08, "{mean} {sd}");
    assert!(chi.iter().all(|c| (0.8..1.25).contains(c)), "{chi:?}");
}

#[test]
fn rangefinder_over_deck_and_water() {
    // The rangefinder is 0.10 m ahead of and 0.08 m below the centre of mass.
    let level = [0.0; 3];
    let near = |a: Option<f64>, b: f64| assert!(a.is_some_and(|a| (a - b).abs() < 1e-9), "{a:?} {b}");
    near(range([0.0, 0.0, -5.0], level, &deck()), 4.92);
    near(range([1.14, 0.0, -5.0], level, &deck()), 4.92);
    near(range([1.16, 0.0, -5.0], level, &deck()), 4.92 + 1.3);
    near(range([0.0, 0.86, -5.0], level, &deck()), 4.92 + 1.3);
    // The deck rises towards the bow.
    let up = still::<Deck>([0.0; 3], [0.0, 0.2, 0.0]);
    near(range([0.4, 0.0, -5.0], level, &up), 4.92 - 0.5 * 0.2_f64.tan());
    // A tilted drone measures along its own down axis.
    near(
        range([-0.1, 0.0, -50.0 / 3.0], [0.9, 0.0, 0.0], &deck()),
        (50.0 / 3.0 - 0.08 * 0.9_f64.cos() + 1.3) / 0.9_f64.cos(),
    );
    assert_eq!(range([0.0, 0.0, -31.0], level, &deck()), None);
    assert_eq!(range([0.0, 0.0, -0.12], level, &deck()), None);
    assert_eq!(
        range([0.0, 0.0, -5.0], [core::f64::consts::PI, 0.0, 0.0], &deck()),
        None
    );
}

#[test]
fn rangefinder_over_waves() {
    let surface = |n: f64, e: f64| 0.8 * (0.3 * n).sin() + 0.5 * (0.4 * e + 1.0).cos();
    let mut s = sensors(&ideal(), 1);
    let far = still::<Deck>([500.0, 0.0, 0.0], [0.0; 3]);
    let mut n = 0;
    for k in 0..400 {
        let a = k as f64 * 0.1;
        let drone = still::<DroneBody>([3.0 * a, 2.0 * a, -9.0], [0.25 * a.sin(), 0.25 * a.cos(), a]);
        let mut at = s.drone.step(tick(2 * k), &drone, &far, surface).ranges;
        at.extend(s.drone.step(tick(2 * k + 1), &drone, &far, surface).ranges);
        for m in at {
            let eye = drone.at::<DroneBody>(Vector3::new(0.10, 0.0, 0.08)).position.0;
            let end = eye + drone.attitude.down().0 * m.range_m;
            assert!((end.z - surface(end.x, end.y)).abs() < 0.01);
            n += 1;
        }
    }
    assert!(n >= 399, "{n}");
}

#[test]
fn rangefinder_noise_misses_and_latency() {
    let drone = still([0.0, 0.0, -5.0], [0.0; 3]);
    let mut s = sensors(&SensorConfig::default(), 3);
    let (mut error, mut over_deck) = (vec![], 0);
    for k in 0..10_000 {
        for m in s.drone.step(tick(k), &drone, &deck(), FLAT).ranges {
            assert_eq!(m.check(), Ok(()));
            let at = s.clocks.drone.true_time(m.header.at);
            assert!(((tick(k) - at).secs() - 0.01).abs() < 1e-8);
            error.push(m.range_m - 4.92);
            over_deck += 1;
        }
    }
    let (mean, sd) = moments(&error);
    assert!(
        mean.abs() < 0.002 && (sd / 0.03 - 1.0).abs() < 0.04,
        "{mean} {sd}"
    );
    assert!((4940..=4999).contains(&over_deck), "{over_deck}");
    let off = still([5.0, 0.0, -5.0], [0.0; 3]);
    let n = watch(&SensorConfig::default(), &off, &deck(), 10_000)
        .ranges
        .len();
    assert!((3900..4100).contains(&n), "{n}");
}

#[test]
fn sensors_with_a_non_finite_state() {
    let mut broken = still([0.0, 0.0, -5.0], [0.0; 3]);
    broken.position = Point::new(f64::NAN, 0.0, f64::INFINITY);
    let r = watch(&ideal(), &broken, &deck(), 50);
    assert_eq!(r, DroneReadings::default());
}

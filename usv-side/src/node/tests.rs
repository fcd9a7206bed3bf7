//! Invalid input to the node is counted, and causes neither a panic nor an unsafe message.

use alight_shared::{
    admission::{RejectionReason, Rejections},
    msg::{GnssFix, HeadingFix, ImuSample, Message, NOT_MEASURED_SD},
    time::{DroneTime, Time},
    vessel_model::{HEAVE, PITCH, ROLL, SURGE, SWAY},
    wire::{decode, encode},
};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::VesselNodeConfig;

const TICK: i64 = 10_000_000;

fn time(tick: i64) -> VesselTime {
    Time::from_nanos(5_000_000_000 + tick * TICK)
}
fn imu(tick: i64) -> ImuSample {
    ImuSample {
        header: Header::new(1, 0, 1, tick as u32, time(tick)),
        // Small changing noise, because constant samples count as stuck.
        gyro: [1e-6 * (tick % 3) as f64, 0.0, 0.0],
        accelerometer: [0.0, 0.0, -9.806_65],
        ..ImuSample::default()
    }
}
fn fix(tick: i64) -> GnssFix {
    GnssFix {
        header: Header::new(1, 0, 1, tick as u32, time(tick)),
        datum: Default::default(),
        // Antenna of a level vessel at (10, 20), heading north.
        position: [9.2, 20.2, -2.0],
        velocity: [0.0; 3],
        position_sd: [0.3; 3],
        velocity_sd: [0.1; 3],
        ..GnssFix::default()
    }
}
fn heading(tick: i64) -> HeadingFix {
    HeadingFix {
        header: Header::new(1, 0, 1, tick as u32, time(tick)),
        heading: 0.0,
        heading_sd: 0.02,
        ..HeadingFix::default()
    }
}
/// Measurements of a vessel at rest at a tick.
fn rest(tick: i64) -> Readings {
    let tenth = tick % 10 == 0;
    Readings {
        imu: vec![imu(tick)],
        gnss: if tenth { vec![fix(tick)] } else { vec![] },
        heading: if tenth { vec![heading(tick)] } else { vec![] },
        ..Readings::default()
    }
}
fn node() -> VesselNode {
    VesselNode::new(&VesselNodeConfig::default(), 1, 9)
}

#[test]
fn stuck_inertial_sensor_with_a_good_one() {
    let frozen = |k: i64| ImuSample {
        header: imu(k).header,
        gyro: [0.0, 0.3, 0.0],
        ..imu(0)
    };
    let mut n = node();
    let mut step = |k: i64, with: &dyn Fn(i64) -> Vec<ImuSample>| {
        let imu = with(k);
        n.step(time(k), &Readings { imu, ..rest(k) }.into());
        (n.source(IMU, 0), n.source(IMU, 1))
    };
    for k in 0..500 {
        step(k, &|k| vec![imu(k)]);
    }
    // The sensor repeats its sample with new time stamps; the other one replaces it like a silent sensor.
    let both = |k: i64| vec![frozen(k), ImuSample { source: 1, ..imu(k) }];
    let mut at = (SourceCounts::default(), SourceCounts::default());
    for k in 500..700 {
        at = step(k, &both);
    }
    let repeated = u64::from(crate::sensors::MAX_REPEATED) - 1;
    assert!(at.0.is_stuck && !at.1.is_stuck);
    assert_eq!((at.0.stuck, at.0.rejected), (200 - repeated, 200 - repeated));
    assert!(at.1.taken > 100, "{:?}", at.1);
    for k in 700..710 {
        at = step(k, &|k| vec![imu(k)]);
    }
    assert!(!at.0.is_stuck, "it measures again");
    assert_eq!(n.rejected().of(RejectionReason::Stuck) as u64, 200 - repeated);
}

/// An accelerometer of a vessel at rest that clips below gravity: apparent downward acceleration of 1.3 m/s².
#[test]
fn accelerometer_that_clips_for_a_while() {
    let mut n = node();
    let mut run = |ticks: core::ops::Range<i64>, most: f64| {
        let mut estimates = Vec::new();
        for k in ticks {
            let mut input = rest(k);
            let imu = input.imu.iter_mut();
            for m in imu {
                m.accelerometer[2] = m.accelerometer[2].max(-most);
            }
            estimates.extend(n.step(time(k), &input.into()).estimate);
        }
        estimates
    };
    assert!(!run(0..2000, 10.0).is_empty());
    run(2000..2300, 8.5);
    assert_eq!(run(2300..4500, 8.5), [], "no estimate from clipped samples");
    run(4500..4800, 10.0);
    let after = run(4800..6000, 10.0);
    assert!(after.len() > 350, "{}", after.len());
    for e in after {
        assert!(e.eta_dot[HEAVE].abs() < 0.1 && e.eta[HEAVE].abs() < 0.3, "{e:?}");
    }
    let filter = n.estimator().filter();
    let observed_s = filter.map(|f| f.motion.observed_s());
    assert!(
        observed_s.is_some_and(|s| s < 15.0),
        "{observed_s:?}: the identification starts again"
    );
}

/// Node and estimates each second of a vessel heading north at `speed` m/s, with compasses off by `off` rad.
fn headed<const N: usize>(
    (until_s, speed): (i64, f64),
    off: impl Fn(f64) -> [f64; N],
) -> (VesselNode, Vec<VesselEstimate<VesselClock>>) {
    let mut n = node();
    let mut estimates = Vec::new();
    for k in 0..100 * until_s {
        let t = 0.01 * k as f64;
        let mut input = rest(k);
        let noise = 0.01 * (k / 10 % 3 - 1) as f64;
        for fix in &mut input.gnss {
            fix.position[0] += speed * t;
            fix.velocity[0] = speed;
        }
        let headings = input.heading.drain(..).flat_map(|h| {
            let read = |(source, off)| HeadingFix {
                source: source as u8,
                heading: alight_shared::frames::wrap_angle(h.heading + off + noise),
                ..h
            };
            off(t).into_iter().enumerate().map(read).collect::<Vec<_>>()
        });
        input.heading = headings.collect();
        let estimate = n.step(time(k), &input.into()).estimate;
        if estimate.is_some() && estimates.len() as i64 <= k / 100 {
            estimates.extend(estimate);
        }
    }
    (n, estimates)
}
/// Error of the heading, rad, and its standard deviation.
fn heading_error(e: &VesselEstimate<VesselClock>) -> (f64, f64) {
    (e.eta[5].abs(), e.covariance(5)[0].sqrt())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn heading_whose_first_second_was_wrong(
        off in prop_oneof![0.1..core::f64::consts::PI, Just(core::f64::consts::PI)],
        sign in prop::sample::select(vec![-1.0, 1.0]),
    ) {
        let (_, all) = headed((20, 0.0), |t| [if t < 1.0 { sign * off } else { 0.0 }]);
        for e in all.iter().filter(|e| e.header.at >= time(500)) {
            let (error, sd) = heading_error(e);
            prop_assert!(error <= 3.0 * sd, "{error} +- {sd} at {:?}", e.header.at);
            prop_assert!(e.header.at < time(1500) || error < 0.1, "{error} at {:?}", e.header.at);
        }
    }
}

/// According to the gyroscope the vessel has not turned: the compass is wrong now, or was wrong before.
#[test]
fn compass_that_is_corrected() {
    for (speed, limit) in [(0.0, 0.35), (2.0, 0.15)] {
        let (n, all) = headed((50, speed), |t| [if t < 30.0 { 0.3 } else { 0.0 }]);
        assert!(n.source(HEADING, 0).outliers < 40, "{:?}", n.source(HEADING, 0));
        for e in all.iter().filter(|e| e.header.at >= time(3500)) {
            let (error, sd) = heading_error(e);
            assert!(error <= 3.0 * sd, "{error} +- {sd} at {:?}", e.header.at);
        }
        let (error, _) = heading_error(&all[49]);
        assert!(error < limit, "{error} at {speed} m/s");
    }
}

#[test]
fn compass_that_is_disturbed() {
    for lasts_s in [2.0, 8.0] {
        let off = |t: f64| {
            [if (30.0..30.0 + lasts_s).contains(&t) {
                0.5
            } else {
                0.0
            }]
        };
        let (_, all) = headed((50, 0.0), off);
        assert!(all.iter().all(|e| heading_error(e).0 < 0.05), "{lasts_s} s");
        let (_, sd) = heading_error(&all[49]);
        assert!(sd < 0.03, "{sd} after {lasts_s} s");
    }
}

#[test]
fn compass_next_to_another() {
    let (n, all) = headed((45, 0.0), |t| [if t < 30.0 { 0.0 } else { 0.5 }, 0.0]);
    let (error, sd) = heading_error(&all[44]);
    assert!(
        error < 0.02 && sd < 0.03,
        "{error} +- {sd}: the other contradicts it"
    );
    assert!(n.source(HEADING, 0).outliers > 140 && n.source(HEADING, 1).outliers == 0);
    let (_, all) = headed((45, 0.0), |t| [if t < 30.0 { 0.0 } else { 0.5 }; 2]);
    let (error, sd) = heading_error(&all[44]);
    assert!(
        (error - 0.5).abs() < 0.05 && sd < 0.05,
        "{error} +- {sd}: both report it"
    );
}

#[test]
fn estimate_of_a_vessel_at_rest() {
    let mut n = node();
    let mut last = None;
    let mut estimates = 0;
    let mut waves = 0;
    let mut predictions = 0;
    for k in 0..2000 {
        let out = n.step(time(k), &rest(k).into());
        estimates += usize::from(out.estimate.is_some());
        waves += usize::from(out.wave.is_some());
        predictions += usize::from(out.prediction.is_some());
        last = out.estimate.or(last);
    }
    let e = last.unwrap();
    assert!(
        (e.eta[SURGE] - 10.0).abs() < 0.05 && (e.eta[SWAY] - 20.0).abs() < 0.05,
        "{e:?}"
    );
    assert!(e.eta[HEAVE].abs() < 0.05 && e.eta[ROLL].abs() < 0.005 && e.eta[PITCH].abs() < 0.005);
    assert!((580..=600).contains(&estimates), "{estimates}");
    assert!((95..=100).contains(&waves) && (19..=20).contains(&predictions));
    assert_eq!(n.rejected(), Rejections::default());
}

/// Height above the ellipsoid and its standard deviation, m, after `ticks` at rest with these fixes.
fn height_of(
    n: &mut VesselNode,
    ticks: core::ops::Range<i64>,
    with: impl Fn(GnssFix) -> Vec<GnssFix>,
) -> [f64; 2] {
    let mut last = None;
    for k in ticks {
        let rest = rest(k);
        let gnss = rest.gnss.iter().flat_map(|g| with(*g)).collect();
        last = n
            .step(time(k), &Readings { gnss, ..rest }.into())
            .estimate
            .or(last);
    }
    let e = last.unwrap();
    [e.datum.height_m - e.eta[HEAVE], e.covariance(HEAVE)[0].sqrt()]
}

#[test]
fn height_whose_reference_is_uncertain() {
    let uncertain = |g: GnssFix| GnssFix {
        height_spread: 3.0,
        ..g
    };
    // An error common to all fixes does not average out.
    let mut n = node();
    let [_, sd] = height_of(&mut n, 0..6000, |g| vec![uncertain(g)]);
    assert!((3.0..3.5).contains(&sd), "{sd}");
    // A better receiver, with heights above the ellipsoid, is not biased by the uncertain one.
    let [height, sd] = height_of(&mut n, 6000..12_000, |g| {
        let up = GnssFix {
            source: 2,
            position: [g.position[0], g.position[1], g.position[2] - 5.0],
            ..uncertain(g)
        };
        vec![g, up]
    });
    assert!(sd < 1.2 && (height - 0.0).abs() < 1.0, "{height} +- {sd}");
    let [_, sd] = height_of(&mut n, 12_000..13_500, |g| vec![uncertain(g)]);
    assert!((3.0..4.0).contains(&sd), "{sd}");
}

#[test]
fn height_that_is_not_measured() {
    let flat = |g: GnssFix| GnssFix {
        position_sd: [0.3, 0.3, NOT_MEASURED_SD],
        ..g
    };
    let mut n = node();
    let [_, sd] = height_of(&mut n, 0..6000, |g| vec![flat(g)]);
    assert!(sd > 100.0, "no height is not a height of zero: {sd}");
    // The first measured height replaces any assumed one.
    let [height, sd] = height_of(&mut n, 6000..6500, |g| {
        vec![GnssFix {
            datum: alight_shared::geodesy::Datum::new(0.0, 0.0, 48.0),
            ..g
        }]
    });
    assert!((height - 48.0).abs() < 1.0 && sd < 2.0, "{height} +- {sd}");
}

#[test]
fn lateral_push_observed_by_gnss_only() {
    let mut n = node();
    let begins = 2000;
    let speed = 2.0;
    let mut last = None;
    for k in 0..begins + 200 {
        let mut input = rest(k);
        let since = 0.01 * (k - begins).max(0) as f64;
        for fix in input.gnss.iter_mut().filter(|_| since > 0.0) {
            fix.position[1] += speed * since;
            fix.velocity[1] = speed;
        }
        last = n.step(time(k), &input.into()).estimate.or(last);
    }
    let e = last.unwrap();
    assert!((e.eta[SWAY] - 20.0 - 4.0).abs() < 0.5, "place {:?}", e.eta);
    assert!(
        (f64::from(e.eta_dot[SWAY]) - speed).abs() < 0.3,
        "velocity {:?}",
        e.eta_dot
    );
    assert_eq!(n.estimator.outliers().restarts, 0);
}

/// Frequency of the strongest roll mode, rad/s, identified at this inertial rate on a vessel that rolls by
/// 0.1 rad at 2.5 s; the sensor is silent in these ticks.
fn identified_roll(rate_hz: i64, silent: core::ops::Range<i64>) -> f64 {
    let omega = 2.0 * core::f64::consts::PI / 2.5;
    let mut n = node();
    let mut sampled = 0;
    for k in 0..6000 {
        let mut input = rest(k);
        input.imu.clear();
        for f in &mut input.gnss {
            f.position = [10.0, 20.0, 0.0];
            f.lever_arm = Some([0.0; 3]);
        }
        while sampled * 100 <= k * rate_hz {
            let at = Time::from_nanos(time(0).nanos() + sampled * 1_000_000_000 / rate_hz);
            let phase = omega * sampled as f64 / rate_hz as f64;
            let roll = 0.1 * phase.sin();
            input.imu.push(ImuSample {
                header: Header::new(1, 0, 1, sampled as u32, at),
                gyro: [0.1 * omega * phase.cos(), 0.0, 0.0],
                accelerometer: [0.0, -9.806_65 * roll.sin(), -9.806_65 * roll.cos()],
                lever_arm: Some([0.0; 3]),
                ..ImuSample::default()
            });
            sampled += 1;
        }
        if silent.contains(&k) {
            input.imu.clear();
        }
        n.step(time(k), &input.into());
    }
    let modes = n.estimator.filter().unwrap().motion.modes().unwrap();
    let roll = |m: &alight_shared::vessel_model::Mode| m.shape[3].norm().max(m.shape[4].norm());
    let most = modes.modes.iter().max_by(|a, b| roll(a).total_cmp(&roll(b)));
    most.map_or(f64::NAN, |m| m.pole.im.abs())
}

/// Pairs of 50 Hz samples are 40 ms apart; taken for 20 ms, they would give frequencies a fifth too high.
#[test]
fn identified_frequency_at_any_inertial_rate() {
    for rate_hz in [20, 50, 80, 100, 125, 400] {
        let found = identified_roll(rate_hz, 0..0);
        assert!((found - 2.513).abs() < 0.05, "{rate_hz} Hz: {found} rad/s");
    }
}

/// A gap must not restart the motion record, which would leave no mode for 5.7 s.
#[test]
fn modes_half_a_second_after_an_inertial_gap() {
    for gap in [20, 50, 90] {
        let found = identified_roll(100, 5950 - gap..5950);
        assert!((found - 2.513).abs() < 0.05, "gap of {gap} ticks: {found} rad/s");
    }
}

/// Measurements on a circle at 2 m/s and 0.05 rad/s, rolling by 3 deg at 2.5 s about a heel of 3 deg.
fn circling(k: i64) -> Readings {
    let speed = 2.0;
    let turn = 0.05;
    let omega = 2.0 * core::f64::consts::PI / 2.5;
    let t = k as f64 * 1e-2;
    let (s, c) = (omega * t).sin_cos();
    let yaw = turn * t;
    let roll = 0.052 + 0.052 * s;
    let roll_rate = 0.052 * omega * c;
    // Specific force in level axes along and across the heading: centripetal acceleration minus gravity.
    let force = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), -roll)
        * nalgebra::Vector3::new(0.0, speed * turn, -9.806_65);
    let mut input = rest(k);
    for sample in &mut input.imu {
        sample.gyro = [roll_rate, turn * roll.sin(), turn * roll.cos()];
        sample.accelerometer = force.into();
        sample.lever_arm = Some([0.0; 3]);
    }
    for fix in &mut input.gnss {
        let (s, c) = yaw.sin_cos();
        fix.position = [speed / turn * s, speed / turn * (1.0 - c), 0.0];
        fix.lever_arm = Some([0.0; 3]);
        fix.velocity = [speed * c, speed * s, 0.0];
    }
    for heading in &mut input.heading {
        heading.heading = alight_shared::frames::wrap_angle(yaw);
    }
    input
}

/// In a turn the mean trim and velocity differ from the present ones. The prediction still starts at the
/// estimate, and its interval covers the later position.
#[test]
fn prediction_that_begins_at_the_estimate() {
    let mut n = node();
    let mut estimates = Vec::new();
    let mut predictions = Vec::new();
    for k in 0..12_000 {
        let out = n.step(time(k), &circling(k).into());
        estimates.extend(out.estimate);
        predictions.extend(out.prediction.filter(|_| k > 4000));
    }
    let difference = |d: usize, a: f64, b: f64| {
        if d < 3 {
            a - b
        } else {
            alight_shared::frames::wrap_angle(a - b)
        }
    };
    // Estimate at a time; the identification's newest sample is up to 0.1 s old.
    let at = |t: VesselTime| -> Option<[f64; 6]> {
        let k = estimates.partition_point(|e| e.header.at <= t);
        let a = estimates.get(k.checked_sub(1)?)?;
        let b = estimates.get(k)?;
        let fraction = (t - a.header.at).secs() / (b.header.at - a.header.at).secs();
        Some(core::array::from_fn(|d| {
            a.eta[d] + fraction * difference(d, b.eta[d], a.eta[d])
        }))
    };
    let mut compared = 0;
    let mut inside = 0;
    for p in &predictions {
        let (Some(now), Some(then)) = (at(p.header.at), at(p.header.at + Span::from_secs(1.0))) else {
            continue;
        };
        let (begins, _) = p.at(0.0).unwrap();
        for d in 0..6 {
            let off = difference(d, begins[d], now[d]);
            let limit = if d < 3 { 0.02 } else { 4e-3 };
            assert!(
                off.abs() < limit,
                "{:?}: the start of degree of freedom {d} is off by {off}",
                p.header.at
            );
        }
        let (there, sd) = p.at(1.0).unwrap();
        for d in 0..2 {
            compared += 1;
            inside += usize::from((there[d] - then[d]).abs() < 1.96 * sd[d]);
        }
    }
    assert!(
        compared > 100 && 10 * inside >= 9 * compared,
        "{inside} of {compared}"
    );
}

/// Receiver with one fix per second, half a second late.
#[test]
fn start_with_a_slow_and_late_receiver() {
    let mut n = node();
    let mut last = None;
    for k in 0..3000 {
        let mut input = rest(k);
        input.gnss = if k % 100 == 50 { vec![fix(k - 50)] } else { vec![] };
        last = n.step(time(k), &input.into()).estimate.or(last);
    }
    let e = last.unwrap();
    assert!(
        (e.eta[SURGE] - 10.0).abs() < 0.1 && (e.eta[SWAY] - 20.0).abs() < 0.1,
        "{:?}",
        e.eta
    );
}

#[test]
fn output_before_all_sensors_and_after_imu_loss() {
    let mut n = node();
    for k in 0..100 {
        let only = Readings {
            imu: vec![imu(k)],
            ..Readings::default()
        };
        assert!(n.step(time(k), &only.into()).estimate.is_none());
    }
    for k in 100..400 {
        n.step(time(k), &rest(k).into());
    }
    // During a silence, the estimate is withheld after one second.
    for k in 400..700 {
        let out = n.step(time(k), &VesselIn::default());
        assert!(k < 505 || out.estimate.is_none(), "{k}");
    }
    let mut back = false;
    for k in 700..900 {
        back |= n.step(time(k), &rest(k).into()).estimate.is_some();
    }
    assert!(back);
}

#[test]
fn repeated_and_reordered_samples() {
    let mut clean = node();
    let mut dirty = node();
    for k in 0..500 {
        let input = rest(k);
        let mut twice = input.clone();
        twice.imu.push(imu(k));
        twice.imu.push(imu(k - 3));
        let a = clean.step(time(k), &input.into());
        let b = dirty.step(time(k), &twice.into());
        assert_eq!(a.estimate, b.estimate);
    }
    assert_eq!(dirty.rejected().of(RejectionReason::OutOfOrder), 1000);
}

#[test]
fn time_replies() {
    let mut n = node();
    let ask = |vessel| {
        let message = TimeRequest {
            header: Header::new(vessel, 7, 1, 0, DroneTime::from_secs(77.0)),
            newest_at: Time::EPOCH,
            newest_boot: 0,
        };
        Arrival {
            at: time(3),
            sender: Sender::Drone(7),
            message,
        }
    };
    let out = n.step(
        time(4),
        &VesselIn {
            time_requests: vec![ask(1), ask(2)],
            ..VesselIn::default()
        },
    );
    assert_eq!(out.time_replies.len(), 1);
    let r = out.time_replies[0];
    assert_eq!(
        (r.requested_at, r.received_at, r.header.at),
        (Time::from_secs(77.0), time(3), time(4))
    );
    assert_eq!((r.header.drone, n.rejected().of(RejectionReason::Vessel)), (7, 1));
}

#[test]
fn modes_of_identified_motion() {
    let mut n = node();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut noisy =
        |v: f64, sd: f64| v + sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let modes: Vec<usize> = (0..3000)
        .filter_map(|k| {
            let mut input = rest(k);
            for sample in &mut input.imu {
                sample.gyro = sample.gyro.map(|v| noisy(v, 0.002));
                sample.accelerometer = sample.accelerometer.map(|v| noisy(v, 0.03));
            }
            n.step(time(k), &input.into()).wave
        })
        .map(|w| w.modes.len())
        .collect();
    let first = modes.iter().position(|m| *m > 0).unwrap();
    assert!(first > 0, "no modes before the identification");
    assert!(modes[first..].iter().all(|m| *m > 0), "{modes:?}");
}

#[test]
fn vessel_message_encoding() {
    let mut n = node();
    let mut slopes = 0;
    for k in 0..200 {
        let out = n.step(time(k), &rest(k).into());
        if let Some(w) = out.wave {
            assert_eq!(decode::<WaveModel<VesselClock>>(&encode(&w).unwrap()).unwrap(), w);
            slopes = w.slopes.len();
        }
        if let Some(p) = out.prediction {
            assert!(encode(&p).unwrap().len() <= 1200);
        }
    }
    assert!(slopes > 0, "the wave model holds the apparent slopes");
}

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(0.0),
        -1.0..1.0,
        -600.0..600.0,
        -1e12..1e12,
    ]
}
fn wild3() -> impl Strategy<Value = [f64; 3]> {
    [wild(), wild(), wild()]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn arbitrary_input_among_good_input(
        garbage in prop::collection::vec((20i64..600, 0u8..3, wild3(), wild3(), -2000i64..2000), 1..80)
    ) {
        let mut n = node();
        for k in 0..700 {
            let mut input = rest(k);
            for (at, kind, a, b, shift) in &garbage {
                if *at != k {
                    continue;
                }
                let header = Header::new(1, 0, 1, 0, time(k + shift / 100));
                match kind {
                    0 => input.imu.insert(0, ImuSample { header, gyro: *a, accelerometer: *b, ..ImuSample::default() }),
                    1 => input.gnss.insert(0, GnssFix {
                        header, position: *a, velocity: *b, position_sd: [0.3; 3],
                        velocity_sd: *a, ..GnssFix::default()
                    }),
                    _ => input.heading.insert(0, HeadingFix {
                        header, heading: a[0], heading_sd: b[0], ..HeadingFix::default()
                    }),
                }
            }
            let out = n.step(time(k), &input.into());
            if let Some(e) = out.estimate {
                prop_assert!(e.check().is_ok());
            }
            if let Some(w) = out.wave {
                prop_assert!(w.check().is_ok());
            }
            if let Some(p) = out.prediction {
                prop_assert!(p.check().is_ok());
            }
        }
        // The estimate has returned to the vessel at rest, or is withheld.
        let mut last = None;
        for k in 700..2200 {
            last = n.step(time(k), &rest(k).into()).estimate.or(last);
        }
        let e = last.unwrap();
        prop_assert!((e.eta[SURGE] - 10.0).abs() < 1.0 && (e.eta[SWAY] - 20.0).abs() < 1.0, "{:?}", e.eta);
        prop_assert!(e.eta[ROLL].abs() < 0.1 && e.eta[PITCH].abs() < 0.1, "{:?}", e.eta);
    }
}

//! Behaviour of the drone as a whole: flight, failsafes, contact.

use alight_shared::config::{Check, Keys};
use alight_shared::frames::{Deck, Point, Rotation, Vector};
use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use alight_shared::msg::{AutopilotMode, Header, LandedState, Message, Motors, SetPoint, SetPointKind};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;

const DT: f64 = 0.01;
const FEET: f64 = 0.30;
const WATER: f64 = 1.3;

/// No errors and no noise: tests of physics and control alone.
fn ideal() -> DroneConfig {
    let mut c = DroneConfig::default();
    c.airframe.mass_error = 0.0;
    c.airframe.thrust_error = 0.0;
    c.navigation = NavigationConfig {
        gnss_bias_m: 0.0,
        gnss_noise_m: 0.001,
        gnss_velocity_mps: 0.001,
        gyro_noise_rps: 0.0,
        gyro_bias_rps: 0.0,
        accelerometer_noise_mps2: 0.001,
        accelerometer_bias_mps2: 0.0,
        vibration_mps2: 0.0,
        tilt_error_deg: 0.0,
        heading_error_deg: 0.0,
        attitude_noise_deg: 0.0,
        ..NavigationConfig::default()
    };
    c
}
fn drone(config: &DroneConfig, seed: u64, position: Vector3<f64>) -> SimulatedDrone {
    let (d, deck) = (DroneGeometry::default(), DeckGeometry::default());
    SimulatedDrone::new(
        config,
        &d,
        &deck,
        &Streams::new(seed),
        DroneStart { position, yaw: 0.0 },
    )
}
fn deck_at(position: Vector3<f64>, roll: f64, pitch: f64) -> RigidState<Deck> {
    RigidState {
        position: Point::from(position),
        attitude: Rotation::from_euler(roll, pitch, 0.0),
        ..RigidState::default()
    }
}
/// A deck far below.
fn nowhere() -> RigidState<Deck> {
    deck_at(Vector3::new(0.0, 0.0, 500.0), 0.0, 0.0)
}
fn stop() -> SetPoint {
    SetPoint {
        motors: Motors::Stop,
        ..SetPoint::default()
    }
}
fn attitude_set_point(roll: f64, pitch: f64, yaw: f64, thrust: f64) -> SetPoint {
    let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    SetPoint {
        kind: SetPointKind::Attitude,
        attitude: [q.w, q.i, q.j, q.k],
        thrust,
        ..SetPoint::default()
    }
}
fn trajectory(position: Vector3<f64>, velocity: Vector3<f64>, acceleration: Vector3<f64>) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Trajectory,
        position: position.into(),
        velocity: velocity.into(),
        acceleration: acceleration.into(),
        ..SetPoint::default()
    }
}
/// Runs for `seconds` over a resting deck; returns every impact.
fn rest(w: &mut SimulatedDrone, deck: &RigidState<Deck>, seconds: f64) -> Vec<Impact> {
    let mut impacts = Vec::new();
    for _ in 0..(seconds / DT).round() as usize {
        let t = w.now_s;
        impacts.extend(w.step(t, DT, deck, deck, 100.0).impacts);
    }
    impacts
}
/// Places the drone, motors off and stopped.
fn drop_from(w: &mut SimulatedDrone, m: Motion) {
    w.apply(&stop());
    w.airframe.spin(None, 100.0);
    w.motion = m;
}
fn still(position: Vector3<f64>, roll: f64, pitch: f64) -> Motion {
    Motion {
        position,
        velocity: Vector3::zeros(),
        attitude: UnitQuaternion::from_euler_angles(roll, pitch, 0.0),
        rates: Vector3::zeros(),
    }
}

#[test]
fn simulated_autopilot_hovers_with_default_errors_and_in_gusty_wind() {
    for (seed, wind) in [(1, 0.0), (2, 0.0), (3, 8.0)] {
        let mut c = DroneConfig::default();
        c.wind.mean_mps = wind;
        let start = Vector3::new(3.0, -2.0, -15.0);
        let mut w = drone(&c, seed, start);
        let offset = w.frame_offset();
        let mut worst: f64 = 0.0;
        for k in 0..6000 {
            let t = f64::from(k) * DT;
            w.step(t, DT, &nowhere(), &nowhere(), WATER);
            // In its own frame, which drifts with its GNSS.
            let error = w.motion.position + w.frame_offset() - start - offset;
            if t > 20.0 {
                worst = worst.max(error.norm());
            }
        }
        println!("hover, wind {wind}: at most {worst} m");
        let limit = if wind > 0.0 { 2.0 } else { 1.0 };
        assert!(worst < limit, "seed {seed} wind {wind}: {worst} m");
        assert!(worst > 0.01, "errors must show: {worst}");
        assert_eq!(w.autopilot.mode(), AutopilotMode::Offboard);
    }
}

#[test]
fn simulated_odometry_is_valid_and_has_the_stated_errors() {
    let mut w = drone(&DroneConfig::default(), 5, Vector3::new(0.0, 0.0, -10.0));
    rest(&mut w, &nowhere(), 5.0);
    let o = w.odometry(Header::default());
    assert!(o.check().is_ok());
    let error = o.position() - w.motion.position - w.frame_offset();
    assert!(
        error.norm() < 6.0 * o.position_sd[0],
        "{error} sd {}",
        o.position_sd[0]
    );
    assert!(
        (0.02..0.2).contains(&o.position_sd[0]) && (0.01..0.1).contains(&o.velocity_sd[0]),
        "{o:?}"
    );
    assert!((w.truth().velocity.0 - o.velocity()).norm() < 6.0 * o.velocity_sd[0]);
    let a = w.autopilot_state(Header::default());
    assert!(a.check().is_ok() && a.armed && a.landed == LandedState::InAir);
    // Hover thrust differs from the nominal by the hidden errors, and is found.
    let expected = w.mass_kg() * GRAVITY / (4.0 * w.airframe.rotor_max);
    assert!(
        (a.hover_thrust / expected - 1.0).abs() < 0.02,
        "{} {expected}",
        a.hover_thrust
    );
}

#[test]
fn simulated_autopilot_settles_a_position_step_without_much_overshoot() {
    let mut w = drone(&ideal(), 1, Vector3::new(0.0, 0.0, -10.0));
    let goal = Vector3::new(2.0, -1.0, -11.0);
    let (mut peak, mut at_5) = (0.0_f64, 9.0);
    for k in 0..1500 {
        w.apply(&trajectory(goal, Vector3::zeros(), Vector3::zeros()));
        w.step(f64::from(k) * DT, DT, &nowhere(), &nowhere(), WATER);
        peak = peak.max(w.motion.position.x);
        if k == 600 {
            at_5 = (w.motion.position - goal).norm();
        }
    }
    assert!(peak < 2.5, "overshoot to {peak}");
    assert!(at_5 < 0.5, "{at_5}");
    assert!((w.motion.position - goal).norm() < 0.05, "{}", w.motion.position);
}

#[test]
fn simulated_autopilot_follows_a_circle_as_px4_was_measured_to() {
    // Circle of 4 m at 2 m/s plus heave 0.5 m / 5 s; PX4 with an external plant: 0.146 m rms.
    let mut w = drone(&ideal(), 1, Vector3::new(4.0, 0.0, -10.0));
    let (omega, heave) = (0.5_f64, core::f64::consts::TAU / 5.0);
    let (mut square, mut n) = (0.0, 0.0);
    for k in 0..4000 {
        let t = f64::from(k) * DT;
        let (s, c) = (omega * t).sin_cos();
        let (hs, hc) = (heave * t).sin_cos();
        let p = Vector3::new(4.0 * c, 4.0 * s, -10.0 - 0.5 * hs);
        let v = Vector3::new(-2.0 * s, 2.0 * c, -0.5 * heave * hc);
        let a = Vector3::new(-c, -s, 0.5 * heave * heave * hs);
        w.apply(&trajectory(p, v, a));
        w.step(t, DT, &nowhere(), &nowhere(), WATER);
        if t > 15.0 {
            square += (w.motion.position - p).norm_squared();
            n += 1.0;
        }
    }
    let rms = (square / n).sqrt();
    println!("circle rms {rms}");
    assert!((0.01..0.3).contains(&rms), "{rms}");
}

/// Lag that maximises the cross-correlation of a 0.5 Hz roll set-point and the true roll.
fn measured_lag(lag_s: f64, use_rates: bool) -> f64 {
    let mut c = ideal();
    c.autopilot.attitude_lag_s = lag_s;
    c.autopilot.use_rates = use_rates;
    let mut w = drone(&c, 1, Vector3::new(0.0, 0.0, -50.0));
    let omega = core::f64::consts::PI;
    let (mut asked, mut got) = (Vec::new(), Vec::new());
    for k in 0..2000 {
        let t = f64::from(k) * DT;
        let (s, c) = (omega * t).sin_cos();
        let mut sp = attitude_set_point(0.1 * s, 0.0, 0.0, w.airframe.hover());
        sp.rates = [0.1 * omega * c, 0.0, 0.0];
        w.apply(&sp);
        // The state at the time the set-point is for, before the step.
        asked.push(0.1 * s);
        got.push(w.truth().euler().x);
        w.step(t, DT, &nowhere(), &nowhere(), WATER);
    }
    // 0.05 s steps refined by a parabola are enough for 0.01 s: search 1 ms by interpolation.
    let correlation = |shift: f64| -> f64 {
        (500..1900)
            .map(|i| {
                let x = i as f64 + shift / DT;
                let (j, f) = (x as usize, x.fract());
                asked[i] * (got[j] * (1.0 - f) + got[j + 1] * f)
            })
            .sum()
    };
    (0..600)
        .map(|ms| f64::from(ms) * 1e-3)
        .max_by(|a, b| correlation(*a).total_cmp(&correlation(*b)))
        .unwrap()
}

#[test]
fn simulated_attitude_lag_is_the_configured_one() {
    for lag in [0.15, 0.2, 0.3] {
        let measured = measured_lag(lag, false);
        println!("lag {lag}: measured {measured}");
        assert!((measured / lag - 1.0).abs() < 0.2, "{lag}: {measured}");
    }
    // Rate feed-forward, when used, takes most of the lag away.
    assert!(measured_lag(0.2, true) < 0.1);
}

#[test]
fn simulated_autopilot_holds_on_set_point_loss_and_returns_to_offboard() {
    let mut w = drone(&ideal(), 1, Vector3::new(0.0, 0.0, -20.0));
    let run = Vector3::new(3.0, 0.0, 0.0);
    let mut t = 0.0;
    let mut fly = |w: &mut SimulatedDrone, seconds: f64, sending: bool| {
        for _ in 0..(seconds / DT).round() as usize {
            if sending {
                let p = Vector3::new(3.0 * t, 0.0, -20.0);
                w.apply(&trajectory(p, run, Vector3::zeros()));
            }
            w.step(t, DT, &nowhere(), &nowhere(), WATER);
            t += DT;
        }
    };
    fly(&mut w, 5.0, true);
    assert!((w.motion.velocity.x - 3.0).abs() < 0.3);
    let limit = ideal().autopilot.loss_after_s;
    fly(&mut w, limit - 0.05, false);
    assert_eq!(w.autopilot.mode(), AutopilotMode::Offboard);
    fly(&mut w, 0.15, false);
    assert_eq!(w.autopilot.mode(), AutopilotMode::Hold);
    fly(&mut w, 8.0, false);
    assert!(w.motion.velocity.norm() < 0.1, "{}", w.motion.velocity);
    assert!((w.motion.position.z + 20.0).abs() < 0.2);
    fly(&mut w, 0.05, true);
    assert_eq!(w.autopilot.mode(), AutopilotMode::Offboard);
}

#[test]
fn simulated_autopilot_lands_by_itself_and_disarms_on_a_resting_deck() {
    let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
    let mut w = drone(&ideal(), 1, Vector3::new(0.1, 0.1, -5.0));
    w.command_mode(AutopilotMode::Land);
    let impacts = rest(&mut w, &deck, 20.0);
    assert!(!w.autopilot.armed());
    assert_eq!(w.autopilot.landed(), LandedState::OnGround);
    assert!(w.contact.feet().iter().all(|f| *f) && !w.contact.other());
    assert!((impacts[0].normal_mps - 0.7).abs() < 0.15, "{:?}", impacts[0]);
}

#[test]
fn simulated_autopilot_obeys_a_forced_disarm_at_once_and_for_good() {
    let mut w = drone(&ideal(), 1, Vector3::new(0.0, 0.0, -50.0));
    rest(&mut w, &nowhere(), 1.0);
    w.apply(&stop());
    let report = w.step(w.now_s, DT, &nowhere(), &nowhere(), WATER);
    assert!(!report.armed);
    rest(&mut w, &nowhere(), 0.2);
    assert!(w.thrust_n() < 0.05, "{}", w.thrust_n());
    w.apply(&attitude_set_point(0.0, 0.0, 0.0, 0.5));
    rest(&mut w, &nowhere(), 0.5);
    assert!(w.thrust_n() < 0.05 && w.motion.velocity.z > 4.0);
    assert!(!w.autopilot_state(Header::default()).armed);
}

#[test]
fn contact_bounce_matches_the_coefficient_of_restitution() {
    for (speed, e) in [(0.5_f64, 0.3), (1.0, 0.3), (2.0, 0.3), (1.0, 0.6)] {
        let mut c = ideal();
        c.contact.restitution = e;
        let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
        let mut w = drone(&c, 1, Vector3::zeros());
        let height = speed * speed / (2.0 * GRAVITY);
        drop_from(&mut w, still(Vector3::new(0.0, 0.0, -FEET - height), 0.0, 0.0));
        let (mut impacts, mut top, mut fastest) = (Vec::new(), 0.0_f64, 0.0_f64);
        for k in 0..60 {
            impacts.extend(w.step(f64::from(k) * DT, DT, &deck, &deck, 100.0).impacts);
            if impacts.len() >= 4 && impacts.len() < 5 {
                top = top.max(-w.motion.position.z - FEET);
                fastest = fastest.max(-w.motion.velocity.z);
            }
        }
        let expected = e * e * height;
        println!(
            "speed {speed} e {e}: up {fastest}, height {top} expected {expected}; {:?}",
            &impacts[..4]
        );
        for i in &impacts[..4] {
            assert!(
                (i.normal_mps / speed - 1.0).abs() < 0.06 && i.tangential_mps < 1e-3,
                "{i:?}"
            );
        }
        assert!(
            (top - expected).abs() < 0.15 * expected + 5e-4,
            "{top} for {expected}"
        );
    }
}

#[test]
fn contact_friction_holds_at_10_deg_and_slides_at_30() {
    for (tilt, slides) in [(10.0_f64, false), (15.0, false), (30.0, true)] {
        let deck = deck_at(Vector3::zeros(), tilt.to_radians(), 0.0);
        let mut w = drone(&ideal(), 1, Vector3::zeros());
        let up = deck.attitude.0 * Vector3::new(0.0, 0.0, -FEET - 0.001);
        drop_from(&mut w, still(up, tilt.to_radians(), 0.0));
        rest(&mut w, &deck, 0.5);
        let from = deck.attitude.0.inverse() * w.motion.position;
        rest(&mut w, &deck, 0.4);
        let moved = (deck.attitude.0.inverse() * w.motion.position - from).norm();
        println!("tilt {tilt}: moved {moved}");
        assert_eq!(moved > 0.05, slides, "{tilt} deg: {moved} m");
        if !slides {
            assert!(moved < 1e-3, "creeps {moved} m in 0.4 s");
            assert_eq!(w.contact.feet(), [true; 4]);
        }
    }
}

#[test]
fn contact_sliding_deceleration_is_that_of_coulomb() {
    // 1.5 m/s sideways, level deck: a = mu g until it stops after v²/(2 mu g) = 0.287 m.
    let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let mut m = still(Vector3::new(-0.4, 0.0, -FEET), 0.0, 0.0);
    m.velocity.x = 1.5;
    drop_from(&mut w, m);
    rest(&mut w, &deck, 2.0);
    let slid = w.motion.position.x + 0.4;
    let expected = 1.5 * 1.5 / (2.0 * 0.4 * GRAVITY);
    println!("slid {slid} expected {expected}");
    assert!((slid / expected - 1.0).abs() < 0.1, "{slid} for {expected}");
    assert!(w.motion.velocity.norm() < 0.01);
}

#[test]
fn drone_tips_over_when_dropped_at_45_deg() {
    let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let mut m = still(Vector3::new(0.0, 0.0, -0.6), 45.0_f64.to_radians(), 0.0);
    m.velocity.y = 1.0;
    drop_from(&mut w, m);
    let impacts = rest(&mut w, &deck, 3.0);
    assert!(w.contact.other() || w.motion.position.z > 0.0, "{:?}", w.motion);
    assert!(impacts.iter().any(|i| !matches!(i.part, Part::Foot(_))));
    let down = w.motion.attitude * Vector3::z();
    assert!(down.z < 0.7, "came back upright: {down}");
}

#[test]
fn drone_rests_on_a_rocking_deck_and_moves_with_it() {
    // Roll 8 deg / 5 s, heave 0.5 m / 5 s, surge 1 m/s: the rest must follow without creep.
    let deck = |t: f64| {
        let w = core::f64::consts::TAU / 5.0;
        let (s, c) = (w * t).sin_cos();
        let roll = 8.0_f64.to_radians();
        RigidState::<Deck> {
            position: Point::new(1000.0 + t, -500.0, -1.3 + 0.5 * s),
            velocity: Vector::new(1.0, 0.0, 0.5 * w * c),
            attitude: Rotation::from_euler(roll * s, 0.0, 0.3),
            rates: Vector::new(roll * w * c, 0.0, 0.0),
            ..RigidState::default()
        }
    };
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let d = deck(0.0);
    let m = Motion {
        position: d.position.0 - Vector3::z() * (FEET + 0.005),
        velocity: d.velocity.0,
        attitude: d.attitude.0,
        rates: Vector3::zeros(),
    };
    drop_from(&mut w, m);
    let place = |w: &SimulatedDrone, d: &RigidState<Deck>| {
        d.attitude.0.inverse() * (w.motion.position - d.position.0)
    };
    let (mut settled, mut worst_speed, mut moved) = (Vector3::zeros(), 0.0_f64, 0.0_f64);
    for k in 0..1200 {
        let t = f64::from(k) * DT;
        let r = w.step(t, DT, &deck(t), &deck(t + DT), 100.0);
        let d = deck(t + DT);
        if k == 200 {
            settled = place(&w, &d);
        }
        if k > 200 {
            assert_eq!(r.feet, [true; 4], "at {t}");
            assert!(!r.other);
            moved = moved.max((place(&w, &d) - settled).norm());
            let lever_arm = w.motion.position - d.position.0;
            let v = d.velocity.0 + (d.attitude.0 * d.rates.0).cross(&lever_arm);
            worst_speed = worst_speed.max((w.motion.velocity - v).norm());
        }
    }
    println!("moved {moved} m in 10 s, relative speed up to {worst_speed}");
    assert!(moved < 0.005, "{moved}");
    assert!(worst_speed < 0.02, "{worst_speed}");
    let force = w.odometry(Header::default()).specific_force;
    assert!((Vector3::from(force).norm() - GRAVITY).abs() < 1.5, "{force:?}");
}

#[test]
fn free_fall_has_no_jump_at_the_hand_over_to_rapier() {
    // Falls past the deck's edge: rapier is asked near it, but nothing touches.
    let deck = deck_at(Vector3::new(123.0, 45.0, -1.3), 0.05, 0.1);
    let mut c = ideal();
    c.airframe.drag_n_per_mps2 = 0.0;
    let mut w = drone(&c, 1, Vector3::zeros());
    let start = Vector3::new(123.0, 45.0 + 0.85 + 0.45, -4.0);
    drop_from(&mut w, still(start, 0.0, 0.0));
    let mut asked = false;
    for k in 0..100 {
        w.step(f64::from(k) * DT, DT, &deck, &deck, 100.0);
        let t = f64::from(k + 1) * DT;
        let span = DeckPath::new(&deck, &deck, DT).span(0.0, 0.002);
        asked |= w.contact.distance(&w.motion.position, &span) < CONTACT_MARGIN_M;
        assert!((w.motion.velocity.z - GRAVITY * t).abs() < 1e-9);
        assert!((w.motion.position.z - start.z - 0.5 * GRAVITY * t * t).abs() < 1e-9);
    }
    assert!(asked);
}

#[test]
fn rapier_agrees_with_the_free_flight_where_it_is_asked() {
    // One sub-step of rapier with nothing in reach against the same in double precision.
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let m = Motion {
        position: Vector3::new(1000.2, 200.3, -2.5),
        velocity: Vector3::new(3.0, -1.0, 2.0),
        attitude: UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3),
        rates: Vector3::new(0.3, -0.2, 0.1),
    };
    let deck = DeckSpan {
        centre: Vector3::new(1000.0, 200.0, -1.3),
        turn: UnitQuaternion::identity(),
        velocity: Vector3::new(2.0, 0.0, 0.5),
        spin: Vector3::zeros(),
    };
    let dv = Vector3::new(0.0, 0.0, 0.0196);
    let mut impacts = Vec::new();
    let none = w
        .contact
        .step(&m, &dv, &Vector3::zeros(), &deck, 0.002, &mut impacts);
    assert!(none.is_none() && impacts.is_empty());
    let body = w.contact.raw(&deck, 0.002);
    assert!((body.velocity - m.velocity - dv).norm() < 1e-6);
    // Rapier's position lies between explicit and implicit Euler.
    assert!((body.position - m.position - (m.velocity + dv * 0.5) * 0.002).norm() < 2e-5);
}

#[test]
fn contact_energy_never_grows_while_the_drone_bounces_to_rest() {
    let deck = deck_at(Vector3::zeros(), 0.1, -0.05);
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let mut m = still(Vector3::new(0.1, 0.0, -0.7), 0.15, -0.1);
    m.velocity = Vector3::new(0.3, 0.2, 1.0);
    m.rates = Vector3::new(0.5, -0.4, 0.3);
    drop_from(&mut w, m);
    let energy = |w: &SimulatedDrone| {
        let m = &w.motion;
        let j = w.airframe.inertia;
        0.5 * w.airframe.mass * m.velocity.norm_squared() + 0.5 * m.rates.dot(&j.component_mul(&m.rates))
            - w.airframe.mass * GRAVITY * m.position.z
    };
    let mut last = energy(&w);
    for k in 0..300 {
        w.step(f64::from(k) * DT, DT, &deck, &deck, 100.0);
        let now = energy(&w);
        assert!(now < last + 0.03, "gained {} J at {k}", now - last);
        last = now;
    }
    assert!(w.motion.velocity.norm() < 0.01);
}

#[test]
fn drone_is_in_water_when_a_foot_is_below_the_surface() {
    let mut w = drone(&ideal(), 1, Vector3::new(0.0, 0.0, -5.0));
    assert!(!w.step(0.0, DT, &nowhere(), &nowhere(), -4.6).in_water);
    assert!(w.step(DT, DT, &nowhere(), &nowhere(), -4.8).in_water);
}

#[test]
fn drone_is_bit_identical_for_a_seed_and_differs_between_seeds() {
    let run = |seed: u64| {
        let mut c = DroneConfig::default();
        c.wind.mean_mps = 5.0;
        let deck = deck_at(Vector3::zeros(), 0.05, 0.0);
        let mut w = drone(&c, seed, Vector3::new(0.0, 0.0, -1.5));
        w.command_mode(AutopilotMode::Land);
        rest(&mut w, &deck, 6.0);
        let o = w.odometry(Header::default());
        (w.motion, o, w.autopilot_state(Header::default()))
    };
    assert_eq!(run(11), run(11));
    assert_ne!(run(11).0, run(12).0);
}

#[test]
fn drone_configuration_survives_toml_and_rejects_nonsense() {
    let c = DroneConfig::default();
    let text = toml::to_string(&c).unwrap();
    let back: DroneConfig = alight_shared::config::parse(&text, "test").unwrap();
    assert_eq!(c, back);
    let e = alight_shared::config::parse::<DroneConfig>("[contact]\nrestitution = 1.5", "test");
    assert!(e.unwrap_err().to_string().contains("contact.restitution"));
    assert!(DroneConfig::default().check(&Keys::ROOT).is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn simulated_autopilot_rejects_absurd_set_points_and_stays_finite(
        values in proptest::array::uniform14(proptest::num::f64::ANY),
        kind in 0..3_u8,
    ) {
        let mut w = drone(&DroneConfig::default(), 9, Vector3::new(0.0, 0.0, -30.0));
        let v = |i: usize| [values[i], values[i + 1], values[i + 2]];
        let sp = SetPoint {
            kind: [SetPointKind::None, SetPointKind::Trajectory, SetPointKind::Attitude][usize::from(kind)],
            position: v(0), velocity: v(3), acceleration: v(6), rates: v(9),
            yaw: values[12], thrust: values[13],
            ..SetPoint::default()
        };
        let refused = sp.check().is_err();
        w.apply(&sp);
        prop_assert_eq!(w.rejected(), u64::from(refused));
        rest(&mut w, &nowhere(), 1.0);
        prop_assert!(w.odometry(Header::default()).check().is_ok());
        prop_assert!(w.autopilot_state(Header::default()).check().is_ok());
    }

    #[test]
    fn simulated_autopilot_survives_extreme_but_valid_set_points(
        p in proptest::array::uniform3(-9e4_f64..9e4), v in proptest::array::uniform3(-99.0_f64..99.0),
        a in proptest::array::uniform3(-199.0_f64..199.0), yaw in -49.0_f64..49.0,
    ) {
        let mut w = drone(&DroneConfig::default(), 9, Vector3::new(0.0, 0.0, -30.0));
        let mut sp = trajectory(Vector3::from(p), Vector3::from(v), Vector3::from(a));
        sp.yaw = yaw;
        for _ in 0..30 {
            w.apply(&sp);
            rest(&mut w, &nowhere(), 0.1);
        }
        prop_assert_eq!(w.rejected(), 0);
        prop_assert!(w.odometry(Header::default()).check().is_ok());
        // Still upright: its own limits hold.
        prop_assert!((w.motion.attitude * Vector3::z()).z > 0.4);
    }
}

/// Tilt (rad) of a drone 0.3 s after it was asked to lean by 0.2 rad, least and most over seeds; before it was sent `first`
/// for 3 s.
fn lean_after(first: &SetPoint) -> [f64; 2] {
    let tilts = (0..12).map(|seed| {
        let mut w = drone(&ideal(), seed, Vector3::new(0.0, 0.0, -10.0));
        for k in 0..330 {
            let lean = attitude_set_point(0.2, 0.0, 0.0, w.autopilot.hover_thrust());
            w.apply(if k < 300 { first } else { &lean });
            rest(&mut w, &nowhere(), DT);
        }
        w.motion.attitude.angle()
    });
    tilts.fold([f64::INFINITY, 0.0], |[least, most], t| {
        [least.min(t), most.max(t)]
    })
}

#[test]
fn kind_of_set_point_changed_between_two_publications_of_the_control_mode() {
    let hover = Vector3::new(0.0, 0.0, -10.0);
    let zero = Vector3::zeros();
    let [least, most] = lean_after(&attitude_set_point(0.0, 0.0, 0.0, 0.34));
    assert!(least > 0.12 && most - least < 0.01, "{least} {most}");
    // Position control writes attitudes, too, until it learns of the change: at once, or 0.5 s later.
    let [least, most] = lean_after(&trajectory(hover, zero, zero));
    assert!(least < 0.1 && most > 0.12, "{least} {most}");
}

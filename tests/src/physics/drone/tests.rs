use alight_shared::{
    frames::{Deck, Point, Rotation, Vector},
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    time::Time,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::*;

const DT: f64 = 0.01;
const FEET: f64 = 0.30;

/// Parameters without errors of mass and thrust.
fn ideal() -> DroneConfig {
    let mut c = DroneConfig::default();
    c.airframe.mass_error = 0.0;
    c.airframe.thrust_error = 0.0;
    c
}
fn drone(config: &DroneConfig, seed: u64, position: Vector3<f64>) -> SimulatedDrone {
    drone_over(config, &DeckGeometry::default(), seed, position)
}
fn drone_over(
    config: &DroneConfig,
    deck: &DeckGeometry,
    seed: u64,
    position: Vector3<f64>,
) -> SimulatedDrone {
    SimulatedDrone::new(
        config,
        &DroneGeometry::default(),
        deck,
        Seq::new(),
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
fn nowhere() -> RigidState<Deck> {
    deck_at(Vector3::new(0.0, 0.0, 500.0), 0.0, 0.0)
}
fn tick(
    w: &mut SimulatedDrone,
    t: f64,
    from: &RigidState<Deck>,
    to: &RigidState<Deck>,
    water_z: f64,
) -> StepReport {
    let t = Time::from_secs(t);
    let dt = Span::from_secs(DT);
    w.step(t, dt, &[*from, *to], water_z, 1, |_| None).remove(0)
}
/// Impacts within `seconds` above a deck at rest.
fn rest(w: &mut SimulatedDrone, deck: &RigidState<Deck>, seconds: f64) -> Vec<Impact> {
    (0..(seconds / DT).round() as usize)
        .flat_map(|k| tick(w, k as f64 * DT, deck, deck, 100.0).impacts)
        .collect()
}
/// Sets the motion, with the rotors stopped.
fn drop_from(w: &mut SimulatedDrone, m: AirframeMotion) {
    w.airframe.spin(None, 100.0);
    w.motion = m;
}
fn still(position: Vector3<f64>, roll: f64, pitch: f64) -> AirframeMotion {
    AirframeMotion {
        position,
        velocity: Vector3::zeros(),
        attitude: UnitQuaternion::from_euler_angles(roll, pitch, 0.0),
        rates: Vector3::zeros(),
    }
}

#[test]
fn contact_restitution() {
    for (speed, e) in [(0.5_f64, 0.3), (1.0, 0.3), (2.0, 0.3), (1.0, 0.6)] {
        let mut c = ideal();
        c.contact.restitution = e;
        let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
        let mut w = drone(&c, 1, Vector3::zeros());
        let height = speed * speed / (2.0 * GRAVITY);
        drop_from(&mut w, still(Vector3::new(0.0, 0.0, -FEET - height), 0.0, 0.0));
        let mut impacts = Vec::new();
        let mut top = 0.0_f64;
        let mut fastest = 0.0_f64;
        for k in 0..60 {
            impacts.extend(tick(&mut w, f64::from(k) * DT, &deck, &deck, 100.0).impacts);
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
fn contact_friction_at_10_and_30_deg() {
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

fn on_holding_deck(config: &DroneConfig, hold_n: f64, tilt: f64) -> (SimulatedDrone, RigidState<Deck>) {
    let deck = DeckGeometry {
        hold_n,
        ..DeckGeometry::default()
    };
    let tilt = tilt.to_radians();
    let at = deck_at(Vector3::zeros(), tilt, 0.0);
    let mut w = drone_over(config, &deck, 1, Vector3::zeros());
    let above = at.attitude.0 * Vector3::new(0.0, 0.0, -FEET - 0.001);
    drop_from(&mut w, still(above, tilt, 0.0));
    rest(&mut w, &at, 0.5);
    (w, at)
}

#[test]
fn hold_along_the_deck() {
    // On 30 deg at a friction of 0.4: 34.3 sin 30 = 17.2 N need 0.4 (34.3 cos 30 + hold), so hold = 13.2 N.
    for (hold_n, slides) in [(9.0, true), (18.0, false)] {
        let (mut w, deck) = on_holding_deck(&ideal(), hold_n, 30.0);
        let from = w.motion.position;
        rest(&mut w, &deck, 0.5);
        let moved = (w.motion.position - from).norm();
        assert_eq!(moved > 0.01, slides, "{hold_n} N: {moved} m");
    }
}

#[test]
fn hold_under_a_greater_pull() {
    for (pull_n, leaves) in [(15.0, false), (25.0, true)] {
        let (mut w, deck) = on_holding_deck(&ideal(), 20.0, 0.0);
        let fraction = (w.airframe.mass * GRAVITY + pull_n) / (4.0 * w.airframe.rotor_max);
        for k in 0..60 {
            let t = Time::from_secs(f64::from(k) * DT);
            w.step(t, Span::from_secs(DT), &[deck, deck], 100.0, 1, |_| {
                Some([fraction; MAX_ROTORS])
            });
        }
        let up = -FEET - w.motion.position.z;
        assert_eq!(up > 0.05, leaves, "{pull_n} N of 20: {up} m");
    }
}

#[test]
fn parked_drone_under_drag_and_friction() {
    // At a friction of 0.1 the deck holds 3.4 N: 0.05 N/(m/s)² times the square of 8.1 m/s or more.
    for (mean_mps, slides) in [(9.0, false), (13.0, true)] {
        let mut c = ideal();
        c.contact.friction = 0.1;
        c.wind.mean_mps = mean_mps;
        c.wind.to_deg = Some(90.0);
        c.wind.gusts = false;
        let deck = deck_at(Vector3::new(0.0, 0.0, -1.3), 0.0, 0.0);
        let mut w = drone(&c, 1, Vector3::zeros());
        drop_from(&mut w, still(Vector3::new(0.0, 0.0, -1.3 - FEET), 0.0, 0.0));
        for k in 0..100 {
            tick(&mut w, f64::from(k) * DT, &deck, &deck, 0.0);
        }
        // By Smith's profile, 0.83 of the wind remains at 1.6 m.
        assert!((w.wind().norm() / mean_mps - 0.83).abs() < 0.02, "{}", w.wind());
        assert_eq!(
            w.motion.position.y > 0.05,
            slides,
            "{mean_mps}: {}",
            w.motion.position
        );
    }
}

#[test]
fn contact_sliding_deceleration() {
    // At 1.5 m/s sideways on a level deck: a = mu g until the drone stops after v²/(2 mu g) = 0.287 m.
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
fn drone_dropped_at_45_deg() {
    let deck = deck_at(Vector3::zeros(), 0.0, 0.0);
    // Deck wide enough for the drone to come to rest on it.
    let wide = DeckGeometry {
        width_m: 20.0,
        ..DeckGeometry::default()
    };
    let mut w = drone_over(&ideal(), &wide, 1, Vector3::zeros());
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
fn drone_at_rest_on_a_rocking_deck() {
    // Roll 8 deg / 5 s, heave 0.5 m / 5 s, surge 1 m/s: a resting drone must follow the deck without creep.
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
    let m = AirframeMotion {
        position: d.position.0 - Vector3::z() * (FEET + 0.005),
        velocity: d.velocity.0,
        attitude: d.attitude.0,
        rates: Vector3::zeros(),
    };
    drop_from(&mut w, m);
    let place = |w: &SimulatedDrone, d: &RigidState<Deck>| {
        d.attitude.0.inverse() * (w.motion.position - d.position.0)
    };
    let mut at_rest = Vector3::zeros();
    let mut worst_speed = 0.0_f64;
    let mut moved = 0.0_f64;
    for k in 0..1200 {
        let t = f64::from(k) * DT;
        let r = tick(&mut w, t, &deck(t), &deck(t + DT), 100.0);
        let d = deck(t + DT);
        if k == 200 {
            at_rest = place(&w, &d);
        }
        if k > 200 {
            assert_eq!(r.feet, [true; 4], "at {t}");
            assert!(!r.other);
            moved = moved.max((place(&w, &d) - at_rest).norm());
            let lever_arm = w.motion.position - d.position.0;
            let v = d.velocity.0 + (d.attitude.0 * d.rates.0).cross(&lever_arm);
            worst_speed = worst_speed.max((w.motion.velocity - v).norm());
        }
    }
    println!("moved {moved} m in 10 s, relative speed up to {worst_speed}");
    assert!(moved < 0.005, "{moved}");
    assert!(worst_speed < 0.02, "{worst_speed}");
    let force = w.specific_force;
    assert!((force.norm() - GRAVITY).abs() < 1.5, "{force:?}");
}

#[test]
fn free_fall_across_the_hand_over_to_rapier() {
    // The drone falls past the deck's edge: rapier runs, but no part touches.
    let deck = deck_at(Vector3::new(123.0, 45.0, -1.3), 0.05, 0.1);
    let mut c = ideal();
    c.airframe.drag_n_per_mps2 = 0.0;
    c.airframe.parked_drag_n_per_mps2 = 0.0;
    let mut w = drone(&c, 1, Vector3::zeros());
    let start = Vector3::new(123.0, 45.0 + 0.85 + 0.45, -4.0);
    drop_from(&mut w, still(start, 0.0, 0.0));
    let mut asked = false;
    for k in 0..100 {
        tick(&mut w, f64::from(k) * DT, &deck, &deck, 100.0);
        let t = f64::from(k + 1) * DT;
        let span = DeckPath::new(&deck, &deck, DT).span(0.0, 0.002);
        asked |= w.contact.distance(&w.motion.position, &span) < CONTACT_MARGIN_M;
        assert!((w.motion.velocity.z - GRAVITY * t).abs() < 1e-9);
        assert!((w.motion.position.z - start.z - 0.5 * GRAVITY * t * t).abs() < 1e-9);
    }
    assert!(asked);
}

#[test]
fn rapier_against_free_flight() {
    // Compares one sub-step of rapier without contact with the integration in double precision.
    let mut w = drone(&ideal(), 1, Vector3::zeros());
    let m = AirframeMotion {
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
    // Rapier's position is between those of explicit and implicit Euler.
    assert!((body.position - m.position - (m.velocity + dv * 0.5) * 0.002).norm() < 2e-5);
}

#[test]
fn contact_energy_while_bouncing_to_rest() {
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
        tick(&mut w, f64::from(k) * DT, &deck, &deck, 100.0);
        let now = energy(&w);
        assert!(now < last + 0.03, "gained {} J at {k}", now - last);
        last = now;
    }
    assert!(w.motion.velocity.norm() < 0.01);
}

#[test]
fn foot_below_the_water_surface() {
    let mut w = drone(&ideal(), 1, Vector3::new(0.0, 0.0, -5.0));
    assert!(!tick(&mut w, 0.0, &nowhere(), &nowhere(), -4.6).in_water);
    assert!(tick(&mut w, DT, &nowhere(), &nowhere(), -4.8).in_water);
}

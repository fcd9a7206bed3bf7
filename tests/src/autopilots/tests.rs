//! A stand-in for a firmware uses both protocols to take off from the pad, hover, and land on the deck.

use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_uav::autopilot::{message::MavlinkMessage, wire::Decoder};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::{FirmwareConfig, FirmwareSensors, ardupilot, motors, px4::Px4Plant, stand_in};
use crate::{
    harness::{
        physics::{Physics, TICK},
        scenario::Scenario,
    },
    physics::{
        drone::{MAX_ROTORS, NavigationConfig, PlantState, RotorFrame},
        sea::SeaConfig,
    },
};

const EXCHANGES_PER_TICK: u32 = 4;
const RATE_HZ: f64 = 400.0;

/// Rotor outputs (linear in thrust) for a flight to `place`: cascaded loops of position, attitude and rate.
fn outputs(b: &PlantState, place: &Vector3<f64>, descend: f64) -> [f64; MAX_ROTORS] {
    let g = DroneGeometry::default();
    let along = (place - b.position).map(|e| e.clamp(-2.0, 2.0));
    let mut wanted = along * 1.2 + (Vector3::z() * descend - b.velocity) * 2.0;
    wanted = Vector3::new(
        wanted.x.clamp(-3.0, 3.0),
        wanted.y.clamp(-3.0, 3.0),
        wanted.z.clamp(-5.0, 4.0),
    );
    let down = Vector3::new(-wanted.x, -wanted.y, GRAVITY - wanted.z).normalize();
    let tilt = UnitQuaternion::rotation_between(&(b.attitude * Vector3::z()), &down).unwrap_or_default();
    let error = b.attitude.inverse_transform_vector(&tilt.scaled_axis());
    let (_, _, yaw) = b.attitude.euler_angles();
    let rates = Vector3::new(6.0 * error.x, 6.0 * error.y, -yaw);
    let moment = (rates - b.rates)
        .component_mul(&Vector3::new(15.0, 15.0, 5.0))
        .component_mul(&Vector3::from(g.inertia_kgm2));
    let thrust = g.mass_kg * (GRAVITY - wanted.z);
    let side = g.arm_m / 2.0_f64.sqrt();
    let rotor = g.max_thrust_n / 4.0;
    let mut out = [0.0; MAX_ROTORS];
    for (o, [x, y, sense]) in out.iter_mut().zip(RotorFrame::QuadX.rotors()) {
        let force =
            thrust - y * moment.x / side + x * moment.y / side + sense * moment.z / g.moment_per_force_m;
        *o = (force / (4.0 * rotor)).clamp(0.03, 1.0);
    }
    out
}

/// Take-off, flight to above the deck, hover, landing. Returns destination and descent speed; None if the
/// motors are off.
fn plan(t_s: f64, start: &Vector3<f64>, deck: &Vector3<f64>, grounded: bool) -> Option<(Vector3<f64>, f64)> {
    let above = deck - Vector3::z() * 4.0;
    match t_s {
        t if t < 1.0 => None,
        t if t < 5.0 => Some((start - Vector3::z() * 4.0, 0.0)),
        t if t < 18.0 => Some((above, 0.0)),
        _ if grounded => None,
        t => Some((above + Vector3::z() * (0.5 * (t - 18.0)), 0.5)),
    }
}

fn calm() -> Scenario {
    let mut s = Scenario {
        sea: SeaConfig::named("calm").expect("a sea of that name"),
        ..Scenario::default()
    };
    s.start.warm_up_s = 1.0;
    s.start.hover_s = 1.0;
    s.start.distance_m = [6.0, 6.0];
    s.start.height_m = [2.0, 2.0];
    s.drone.airframe.mass_error = 0.0;
    s.drone.airframe.thrust_error = 0.0;
    s
}

fn fly(
    mut physics: Physics,
    mut exchange: impl FnMut(&PlantState, f64, &Vector3<f64>, &Vector3<f64>) -> Option<[f64; MAX_ROTORS]>,
) -> (f64, f64, f64) {
    physics.place_drone_on_pad(0);
    let start = physics.drone(0).unwrap_or_default().position.0;
    let mut hover = 0.0_f64;
    let mut impact = 0.0_f64;
    let mut touched = false;
    for tick in 0..3500_u32 {
        let t_s = TICK.secs() * f64::from(tick);
        let deck = physics.deck().position.0;
        physics.advance_with(EXCHANGES_PER_TICK, |_, truth| exchange(truth, t_s, &start, &deck));
        let drone = physics.drone(0).unwrap_or_default().position.0;
        if (14.0..18.0).contains(&t_s) {
            hover = hover.max((drone - (deck - Vector3::z() * 4.0)).norm());
        }
        for touch in physics
            .observation(0, &alight_shared::msg::MissionState::default())
            .contacts
        {
            touched = true;
            impact = impact.max(touch.normal_mps);
        }
    }
    assert!(touched, "no contact with the deck");
    let off = physics.drone(0).unwrap_or_default().position.0 - physics.deck().position.0;
    (hover, impact, off.xy().norm())
}

#[test]
fn ardupilot_plant_take_off_hover_and_landing() {
    let physics = Physics::new(&calm(), 3).expect("a world");
    let c = FirmwareConfig::default();
    let mut frame = 0_u32;
    let mut grounded = false;
    let (hover, impact, off) = fly(physics, |truth, t_s, start, deck| {
        let line = ardupilot::answer(truth, 0.0);
        assert!(line.starts_with("\n{") && line.ends_with("}\n") && !line.contains(' '));
        let b = stand_in::read_line(&line).expect("each key");
        grounded |= t_s > 20.0 && b.velocity.norm() < 0.05 && b.specific_force.norm() > 9.0;
        let u = plan(t_s, start, deck, grounded).map_or([0.0; MAX_ROTORS], |(p, v)| outputs(&b, &p, v));
        frame += 1;
        let servos = ardupilot::servos(&stand_in::servo_packet(frame, u)).expect("a packet");
        assert_eq!(servos.frame, frame);
        ardupilot::rotors(&c, &servos)
    });
    assert!(hover < 0.3, "hover within {hover} m");
    assert!(
        (0.05..1.2).contains(&impact),
        "contact with the deck at {impact} m/s"
    );
    assert!(off < 0.5, "{off} m from the deck's centre");
}

#[test]
fn px4_plant_take_off_hover_and_landing() {
    let scenario = calm();
    let streams = crate::physics::streams::Streams::new(3);
    // The stand-in's simple estimator needs good sensors.
    let navigation = NavigationConfig {
        gnss_bias_m: 0.0,
        gnss_noise_m: 0.02,
        gnss_velocity_mps: 0.02,
        gyro_bias_rps: 0.0,
        accelerometer_bias_mps2: 0.0,
        ..scenario.drone.navigation.clone()
    };
    let datum = alight_shared::geodesy::Datum::new(43.5, 16.3, 0.0);
    let c = FirmwareConfig::default();
    let mut plant = Px4Plant::new(&c, FirmwareSensors::new(&c, &navigation, datum, &streams));
    let physics = Physics::new(&scenario, 3).expect("a world");
    let mut decoder = Decoder::default();
    let mut belief = None::<PlantState>;
    let mut grounded = false;
    let mut fixes = 0;
    let (hover, impact, off) = fly(physics, |truth, t_s, start, deck| {
        decoder.push(&plant.encode_sensors(truth, RATE_HZ));
        let mut answer = None;
        while let Some(f) = decoder.next_frame() {
            match f.message {
                MavlinkMessage::HilGps(g) => {
                    fixes += 1;
                    let place = stand_in::place(&g, &datum);
                    let b = belief.get_or_insert(PlantState {
                        position: place,
                        attitude: truth.attitude,
                        ..PlantState::default()
                    });
                    stand_in::correct(b, &g, place, 0.3);
                }
                MavlinkMessage::HilSensor(s) => {
                    if let Some(b) = &mut belief {
                        stand_in::advance(b, &s, 1.0 / RATE_HZ);
                        grounded |= t_s > 20.0 && b.velocity.norm() < 0.1 && b.position.z > deck.z - 0.6;
                        let wanted = plan(t_s, start, deck, grounded);
                        let u = wanted.map_or([0.0; MAX_ROTORS], |(p, v)| outputs(b, &p, v));
                        answer = Some(stand_in::motor_answer(s.time_us, u, wanted.is_some()));
                    }
                }
                _ => panic!("PX4 does not accept this message from a simulator"),
            }
        }
        if let Some(a) = answer {
            assert!(plant.decode(&a));
        }
        plant.motors()
    });
    assert!((340..=352).contains(&fixes), "{fixes} fixes in 35 s");
    assert!(hover < 0.6, "hover within {hover} m");
    assert!(
        (0.05..1.5).contains(&impact),
        "contact with the deck at {impact} m/s"
    );
    assert!(off < 0.8, "{off} m from the deck's centre");
}

fn px4_plant() -> Px4Plant {
    let c = FirmwareConfig::default();
    let streams = crate::physics::streams::Streams::new(1);
    let sensors = FirmwareSensors::new(&c, &NavigationConfig::default(), Default::default(), &streams);
    Px4Plant::new(&c, sensors)
}

#[test]
fn px4_plant_with_every_second_sample_answered() {
    let mut plant = px4_plant();
    let mut wanted = Vec::new();
    for k in 1..=24_u64 {
        let at = alight_shared::time::Time::from_nanos(k as i64 * 2_500_000);
        plant.encode_sensors(
            &PlantState {
                at,
                ..PlantState::default()
            },
            RATE_HZ,
        );
        wanted.push((plant.due(), plant.is_overdue()));
        if k <= 8 || k.is_multiple_of(2) && k <= 16 {
            plant.decode(&stand_in::motor_answer(
                1_000_000 + k * 2500,
                [0.25; MAX_ROTORS],
                true,
            ));
        }
    }
    // PX4 answers each sample, misses one because of a short delay, then answers every second sample, then
    // stops; its answer is overdue after four samples.
    assert_eq!(wanted[7], (true, false));
    assert_eq!(wanted[8], (true, false));
    assert_eq!(
        wanted[10..14],
        [(false, false), (true, false), (false, false), (true, false)]
    );
    assert_eq!(wanted[19..24], [(true, true); 5]);
}

#[test]
fn drone_without_a_firmware_on_its_pad() {
    let mut physics = Physics::new(&calm(), 5).expect("a world");
    physics.place_drone_on_pad(0);
    let before = physics.drone(0).unwrap_or_default().position.0;
    let mut exchanges = 0;
    for _ in 0..500 {
        physics.advance_with(EXCHANGES_PER_TICK, |_, truth| {
            exchanges += 1;
            assert!((truth.specific_force - Vector3::new(0.0, 0.0, -GRAVITY)).norm() < 1e-6);
            None
        });
    }
    assert_eq!(exchanges, 500 * EXCHANGES_PER_TICK);
    // An idle mission does not imply that the motors are off.
    let mission = alight_shared::msg::MissionState::default();
    assert!(physics.observation(0, &mission).motors_on);
    assert!((physics.drone(0).unwrap_or_default().position.0 - before).norm() < 1e-9);
    assert!((physics.now().secs() - 5.0).abs() < 1e-9);
}

#[test]
fn exchange_rates_of_the_firmwares() {
    let hz = |exchange_hz| FirmwareConfig {
        exchange_hz,
        ..FirmwareConfig::default()
    };
    // ArduCopter arms only if its gyroscopes are read 1.8 times in each of 400 loops per second.
    assert!(f64::from(hz(0).exchanges(ardupilot::EXCHANGE_HZ)) / TICK.secs() > 1.8 * 400.0);
    assert_eq!(hz(0).exchanges(400), EXCHANGES_PER_TICK);
    assert_eq!(hz(1000).exchanges(400), 10);
    for wrong in [50, 250, 1100] {
        let text = format!("exchange_hz = {wrong}");
        assert!(alight_shared::config::parse::<FirmwareConfig>(&text, "a file").is_err());
    }
}

#[test]
fn ardupilot_plant_malformed_packets() {
    let good = |magic: u16, n: usize| {
        let mut p = magic.to_le_bytes().to_vec();
        p.extend([0_u8; 6]);
        p.extend(vec![0; 2 * n]);
        p
    };
    assert_eq!(
        ardupilot::servos(&good(18458, 16)).map(|s| s.pwm_us.len()),
        Some(16)
    );
    assert_eq!(
        ardupilot::servos(&good(29569, 32)).map(|s| s.pwm_us.len()),
        Some(32)
    );
    for bad in [
        good(18458, 15),
        good(18457, 16),
        good(18458, 32),
        vec![],
        vec![0x1a],
    ] {
        assert_eq!(ardupilot::servos(&bad), None);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_firmware_outputs(
        all in prop::collection::vec(prop_oneof![any::<f64>(), -0.5..1.5_f64, Just(f64::NAN)], 0..20),
        curve in 0.0..1.0_f64,
    ) {
        let c = FirmwareConfig { thrust_curve: curve, ..FirmwareConfig::default() };
        if let Some(thrusts) = motors(&c, &all) {
            prop_assert!(thrusts.iter().all(|s| (0.0..=1.0).contains(s)), "{thrusts:?}");
        }
    }

    #[test]
    fn arbitrary_firmware_bytes(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _any = ardupilot::servos(&bytes);
        let mut plant = px4_plant();
        plant.decode(&bytes);
        prop_assert!(plant.motors().is_none_or(|m| m.iter().all(|s| s.is_finite())));
    }
}

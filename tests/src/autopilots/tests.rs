//! Protocols of the firmwares' simulators. `deploy/tests/live/firmware.rs` lands through them.

use alight_shared::geometry::GRAVITY;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::{FirmwareConfig, FirmwareSensors, ardupilot, motors, px4::Px4Plant, stand_in};
use crate::{
    harness::{
        physics::{Physics, TICK},
        scenario::Scenario,
    },
    physics::{
        drone::{MAX_ROTORS, NavigationConfig, PlantState},
        sea::SeaConfig,
    },
};

const EXCHANGES_PER_TICK: u32 = 4;
const RATE_HZ: f64 = 400.0;

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

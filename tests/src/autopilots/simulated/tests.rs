//! Flights of the simulated autopilot: control, failsafes, differences between the firmwares.

use alight_shared::{
    frames::{Deck, Point, wxyz},
    geometry::{DeckGeometry, GRAVITY},
    mavlink::{MessageData as _, dialect as m, dialect::MavState},
    msg::{LandedState, Seq},
    time::Time,
};
use alight_uav::autopilot::message::{
    AttitudeThrustTarget, FORCE, MavCmd, MavMessage, MavResult, PositionTarget,
};
use proptest::prelude::*;

use super::*;
use crate::physics::{
    body::RigidState,
    drone::{DroneConfig, DroneStart, Impact, LossAction, SimulatedDrone},
};

const TICK: Span = Span::from_millis(10);
const DT: f64 = 0.01;
const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduCopter];

/// Configuration without errors and noise, to test control alone.
fn ideal(firmware: Firmware) -> DroneConfig {
    let mut c = DroneConfig::default();
    c.airframe.mass_error = 0.0;
    c.airframe.thrust_error = 0.0;
    c.autopilot.firmware = firmware;
    c.navigation = NavigationConfig::without_errors();
    c
}

struct Flown {
    drone: SimulatedDrone,
    a: SimulatedAutopilot,
    t: WorldTime,
    deck: RigidState<Deck>,
    arrived: Vec<MavlinkMessage>,
    impacts: Vec<Impact>,
}

impl Flown {
    fn new(c: &DroneConfig, seed: u64, position: Vector3<f64>) -> Flown {
        let geometry = DroneGeometry::default();
        let streams = Streams::new(seed);
        let start = DroneStart { position, yaw: 0.0 };
        let drone = SimulatedDrone::new(
            c,
            &geometry,
            &DeckGeometry::default(),
            Seq::new(),
            &streams,
            start,
        );
        let state = drone.plant_state(Time::EPOCH);
        let hover = drone.hover_thrust();
        let a = SimulatedAutopilot::new(&c.autopilot, &c.navigation, &geometry, &streams, &state, hover);
        Flown {
            drone,
            a,
            t: Time::EPOCH,
            deck: RigidState {
                position: Point::new(0.0, 0.0, 500.0),
                ..RigidState::default()
            },
            arrived: Vec::new(),
            impacts: Vec::new(),
        }
    }
    fn offboard(c: &DroneConfig, seed: u64, position: Vector3<f64>) -> Flown {
        let mut f = Flown::new(c, seed, position);
        f.fly(1.2, |_| Some(track(position, [0.0; 3], [0.0; 3])));
        assert!(f.a.choose(mode_number(f.a.firmware(), AutopilotMode::Offboard)));
        f
    }
    fn tick(&mut self) {
        let a = &mut self.a;
        let arrived = &mut self.arrived;
        let deck = [self.deck; 2];
        let reports = self
            .drone
            .step(self.t, TICK, &deck, 100.0, INNER_PER_OUTER, |truth| {
                a.step(truth, &core::mem::take(arrived))
            });
        self.impacts.extend(reports.into_iter().flat_map(|r| r.impacts));
        self.t += TICK;
    }
    fn fly(&mut self, seconds: f64, mut set_point: impl FnMut(f64) -> Option<MavlinkMessage>) {
        for _ in 0..(seconds / DT).round() as usize {
            self.arrived.extend(set_point(self.t.secs()));
            self.tick();
        }
    }
    fn rest(&mut self, seconds: f64) {
        self.fly(seconds, |_| None);
    }
    fn command(&mut self, command: MavCmd, parameters: [f64; 2]) {
        let c = CommandLong::new(self.a.address, command, parameters);
        self.arrived.push(c.into());
    }
    fn position(&self) -> Vector3<f64> {
        self.drone.truth().position.0
    }
    fn velocity(&self) -> Vector3<f64> {
        self.drone.truth().velocity.0
    }
    fn kind(&self) -> AutopilotMode {
        self.a.firmware().mode(self.a.mode())
    }
}

const TO: Address = Address::new(3, 1);

fn track(position: Vector3<f64>, velocity: [f64; 3], acceleration: [f64; 3]) -> MavlinkMessage {
    MavlinkMessage::Position(PositionTarget {
        to: TO,
        position: position.into(),
        velocity,
        acceleration,
        yaw: 0.0,
        yaw_rate: 0.0,
    })
}
fn attitude(roll: f64, thrust: f64) -> MavlinkMessage {
    MavlinkMessage::AttitudeThrust(AttitudeThrustTarget {
        to: TO,
        attitude: wxyz(&UnitQuaternion::from_euler_angles(roll, 0.0, 0.0)),
        rates: None,
        thrust,
    })
}

#[test]
fn hover_with_default_errors_and_gusty_wind() {
    for (seed, wind) in [(1, 0.0), (2, 0.0), (3, 8.0)] {
        let mut c = DroneConfig::default();
        c.wind.mean_mps = wind;
        let start = Vector3::new(3.0, -2.0, -15.0);
        let mut f = Flown::new(&c, seed, start);
        let offset = f.a.frame_offset();
        f.rest(20.0);
        let mut worst: f64 = 0.0;
        for _ in 0..4000 {
            f.tick();
            // GNSS errors make the autopilot's frame drift.
            let error = f.position() + f.a.frame_offset() - start - offset;
            worst = worst.max(error.norm());
        }
        let limit = if wind > 0.0 { 2.0 } else { 1.0 };
        assert!(
            (0.01..limit).contains(&worst),
            "seed {seed} wind {wind}: {worst} m"
        );
        // Hidden errors change the hover thrust, and the estimator identifies it.
        let found = f.a.hover_thrust();
        let hover = f.drone.hover_thrust();
        let near = (found / hover - 1.0).abs() < 0.03;
        assert!(near || wind > 0.0, "{found} {hover}");
        assert!(f.a.armed() && f.a.flight.landed() == LandedState::InAir);
    }
}

#[test]
fn position_step_without_much_overshoot() {
    for firmware in BOTH {
        let mut f = Flown::offboard(&ideal(firmware), 1, Vector3::new(0.0, 0.0, -10.0));
        let goal = Vector3::new(2.0, -1.0, -11.0);
        let mut peak = 0.0_f64;
        for _ in 0..1500 {
            f.fly(DT, |_| Some(track(goal, [0.0; 3], [0.0; 3])));
            peak = peak.max(f.position().x);
        }
        assert!(peak < 2.5, "{firmware:?}: overshoot to {peak}");
        assert!((f.position() - goal).norm() < 0.05, "{}", f.position());
    }
}

#[test]
fn circle_as_measured_on_the_firmwares() {
    // Circle of 4 m radius at 2 m/s with 0.5 m of heave in 5 s. The real firmwares with an external plant:
    // PX4 0.146 m rms, ArduCopter 0.080 m.
    for (firmware, limits) in [(Firmware::Px4, 0.01..0.3), (Firmware::ArduCopter, 0.01..0.2)] {
        let mut f = Flown::offboard(&ideal(firmware), 1, Vector3::new(4.0, 0.0, -10.0));
        let omega = 0.5_f64;
        let heave = core::f64::consts::TAU / 5.0;
        let at = |t: f64| {
            let (s, c) = (omega * t).sin_cos();
            let (hs, hc) = (heave * t).sin_cos();
            let p = Vector3::new(4.0 * c, 4.0 * s, -10.0 - 0.5 * hs);
            let v = [-2.0 * s, 2.0 * c, -0.5 * heave * hc];
            (p, track(p, v, [-c, -s, 0.5 * heave * heave * hs]))
        };
        f.fly(15.0, |t| Some(at(t).1));
        let mut square = 0.0;
        for _ in 0..2500 {
            f.fly(DT, |t| Some(at(t).1));
            square += (f.position() - at(f.t.secs()).0).norm_squared();
        }
        let rms = (square / 2500.0).sqrt();
        println!("{firmware:?}: circle {rms} m rms");
        assert!(limits.contains(&rms), "{firmware:?}: {rms}");
    }
}

/// Lag that maximises the cross-correlation of a 0.5 Hz roll set-point and the true roll.
fn measured_lag(lag_s: f64) -> f64 {
    let mut c = ideal(Firmware::Px4);
    c.autopilot.attitude_lag_s = Some(lag_s);
    let mut f = Flown::offboard(&c, 1, Vector3::new(0.0, 0.0, -50.0));
    let hover = f.drone.hover_thrust();
    let roll = |t: f64| 0.1 * (core::f64::consts::PI * t).sin();
    let mut asked = Vec::new();
    let mut got = Vec::new();
    for _ in 0..2000 {
        asked.push(roll(f.t.secs()));
        got.push(f.drone.truth().euler().x);
        f.fly(DT, |t| Some(attitude(roll(t), hover)));
    }
    let correlation = |shift: f64| -> f64 {
        (500..1900)
            .map(|i| {
                let x = i as f64 + shift / DT;
                let j = x as usize;
                let f = x.fract();
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
fn attitude_lag_as_configured() {
    for lag in [0.15, 0.2, 0.3] {
        let measured = measured_lag(lag);
        assert!((measured / lag - 1.0).abs() < 0.2, "{lag}: {measured}");
    }
}

/// Range over seeds of the tilt (rad) 0.3 s after a command to tilt by 0.2 rad, with `first` commanded for
/// the 3 s before.
fn tilt_after(firmware: Firmware, first: &MavlinkMessage) -> [f64; 2] {
    let tilts = (0..12).map(|seed| {
        let mut f = Flown::offboard(&ideal(firmware), seed, Vector3::new(0.0, 0.0, -10.0));
        f.fly(3.0, |_| Some(first.clone()));
        let tilted = attitude(0.2, f.a.hover_thrust());
        f.fly(0.3, |_| Some(tilted.clone()));
        f.drone.truth().attitude.0.angle()
    });
    tilts.fold([f64::INFINITY, 0.0], |[min, max], t| [min.min(t), max.max(t)])
}

#[test]
fn set_point_kind_changed_between_control_modes() {
    let hover = track(Vector3::new(0.0, 0.0, -10.0), [0.0; 3], [0.0; 3]);
    for (firmware, first, late) in [
        (Firmware::Px4, attitude(0.0, 0.34), false),
        (Firmware::ArduCopter, hover.clone(), false),
        // Position control overwrites attitudes until it notices the change: immediately, or 0.5 s later.
        (Firmware::Px4, hover, true),
    ] {
        let [min, max] = tilt_after(firmware, &first);
        assert!(max > 0.12, "{firmware:?}: {min} {max}");
        assert_eq!(min < 0.1, late, "{firmware:?}: {min} {max}");
    }
}

#[test]
fn set_points_lost_and_back() {
    for (firmware, action, expected) in [
        (Firmware::Px4, LossAction::Hold, AutopilotMode::Hold),
        (Firmware::Px4, LossAction::Land, AutopilotMode::Land),
        (Firmware::Px4, LossAction::Return, AutopilotMode::Return),
        (Firmware::ArduCopter, LossAction::Hold, AutopilotMode::Offboard),
    ] {
        let mut c = ideal(firmware);
        c.autopilot.loss_action = action;
        let mut f = Flown::offboard(&c, 1, Vector3::new(0.0, 0.0, -20.0));
        let run = |t: f64| {
            Some(track(
                Vector3::new(3.0 * t, 0.0, -20.0),
                [3.0, 0.0, 0.0],
                [0.0; 3],
            ))
        };
        f.fly(5.0, run);
        assert!((f.velocity().x - 3.0).abs() < 0.3, "{}", f.velocity());
        f.rest(c.autopilot.loss_after_s - 0.05);
        assert_eq!(f.kind(), AutopilotMode::Offboard);
        f.rest(0.15);
        assert_eq!(f.kind(), expected);
        if action == LossAction::Hold {
            f.rest(8.0);
            assert!(f.velocity().norm() < 0.1, "{}", f.velocity());
            assert!((f.position().z + 20.0).abs() < 0.2, "{}", f.position());
        }
        f.fly(0.05, run);
        assert_eq!(f.kind(), AutopilotMode::Offboard);
    }
}

#[test]
fn ardu_copter_level_without_attitudes() {
    let mut f = Flown::offboard(&ideal(Firmware::ArduCopter), 1, Vector3::new(0.0, 0.0, -20.0));
    let thrust = 0.9 * f.drone.hover_thrust();
    f.fly(1.0, |_| Some(attitude(0.2, thrust)));
    f.rest(2.0);
    let truth = f.drone.truth();
    assert!(
        truth.euler().xy().norm() < 0.01 && truth.velocity.0.z.abs() < 0.2,
        "{:?}",
        truth.velocity
    );
    assert!(truth.velocity.0.xy().norm() > 0.5);
}

/// Failsafe with these parameters: condition, mode 1 s later and 8 s later, and whether the heartbeat is CRITICAL.
type FailsafeCase = (
    Firmware,
    fn(&mut SimulatedAutopilot),
    &'static [(&'static str, f64)],
    [AutopilotMode; 2],
    bool,
);

#[test]
fn failsafes_as_their_parameters_say() {
    use AutopilotMode::{Hold, Land, Offboard, Other, Return};
    use Firmware::{ArduCopter, Px4};
    let remote: fn(&mut SimulatedAutopilot) = |a| a.conditions.remote_lost = true;
    let stick: fn(&mut SimulatedAutopilot) = SimulatedAutopilot::move_stick;
    let station: fn(&mut SimulatedAutopilot) = |a| a.conditions.station_lost = true;
    let estimator: fn(&mut SimulatedAutopilot) = |a| a.conditions.estimator_bad = true;
    let reckoning: fn(&mut SimulatedAutopilot) = |a| a.conditions.dead_reckoning = true;
    let battery: fn(&mut SimulatedAutopilot) = |a| a.battery = 0.03;
    let fence: fn(&mut SimulatedAutopilot) = |a| a.conditions.fence_breached = true;
    let cases: &[FailsafeCase] = &[
        // As documented, a failsafe leaves OFFBOARD and GUIDED alone.
        (Px4, remote, &[], [Offboard; 2], false),
        (Px4, stick, &[], [Offboard; 2], false),
        (Px4, station, &[], [Offboard; 2], false),
        (Px4, fence, &[], [Offboard; 2], false),
        (ArduCopter, remote, &[], [Offboard; 2], true),
        (ArduCopter, stick, &[], [Offboard; 2], false),
        (ArduCopter, station, &[], [Offboard; 2], false),
        (ArduCopter, reckoning, &[], [Offboard; 2], false),
        (ArduCopter, fence, &[], [Offboard; 2], false),
        // PX4 waits in Hold before it returns or lands.
        (Px4, remote, &[("COM_RCL_EXCEPT", 0.0)], [Hold; 2], true),
        (
            Px4,
            remote,
            &[("COM_RCL_EXCEPT", 0.0), ("NAV_RCL_ACT", 2.0)],
            [Hold, Return],
            true,
        ),
        (
            Px4,
            remote,
            &[("COM_RCL_EXCEPT", 0.0), ("NAV_RCL_ACT", 7.0)],
            [Offboard; 2],
            false,
        ),
        (Px4, station, &[("NAV_DLL_ACT", 1.0)], [Hold; 2], true),
        (Px4, stick, &[("COM_RC_OVERRIDE", 3.0)], [Other; 2], false),
        (Px4, stick, &[("MAN_OVERRIDE_SPD", 1.0)], [Other; 2], false),
        // The set-points of this test are positions.
        (Px4, estimator, &[], [Land; 2], true),
        (Px4, reckoning, &[], [Offboard, Land], true),
        (Px4, battery, &[("COM_LOW_BAT_ACT", 3.0)], [Hold, Land], true),
        (Px4, fence, &[("GF_ACTION", 2.0)], [Hold; 2], true),
        (ArduCopter, remote, &[("FS_OPTIONS", 16.0)], [Hold; 2], true),
        (
            ArduCopter,
            remote,
            &[("FS_OPTIONS", 16.0), ("FS_THR_ENABLE", 1.0)],
            [Return; 2],
            true,
        ),
        (ArduCopter, station, &[("FS_GCS_ENABLE", 5.0)], [Land; 2], true),
        (ArduCopter, estimator, &[], [Land; 2], true),
        (ArduCopter, estimator, &[("FS_EKF_ACTION", 2.0)], [Other; 2], true),
        (ArduCopter, reckoning, &[("FS_DR_ENABLE", 2.0)], [Return; 2], true),
        (
            ArduCopter,
            battery,
            &[("BATT_CRT_VOLT", 14.1), ("BATT_FS_CRT_ACT", 1.0)],
            [Land; 2],
            true,
        ),
        (ArduCopter, fence, &[("FENCE_ACTION", 4.0)], [Hold; 2], false),
    ];
    for (k, (firmware, condition, parameters, expected, critical)) in cases.iter().enumerate() {
        let mut f = Flown::offboard(&ideal(*firmware), 1, Vector3::new(0.0, 0.0, -40.0));
        f.a.parameters.extend(parameters.iter().copied());
        condition(&mut f.a);
        f.a.sent();
        let hold = track(Vector3::new(0.0, 0.0, -40.0), [0.0; 3], [0.0; 3]);
        f.fly(1.0, |_| Some(hold.clone()));
        let first = f.kind();
        f.fly(7.0, |_| Some(hold.clone()));
        assert_eq!([first, f.kind()], *expected, "case {k}");
        let announced = |m: &MavlinkMessage| matches!(m, MavlinkMessage::Text { .. });
        let sent = f.a.sent();
        let mut beats = sent.iter().filter_map(|m| match m {
            MavlinkMessage::Common(MavMessage::HEARTBEAT(d)) => {
                Some(d.system_status == MavState::MAV_STATE_CRITICAL)
            }
            _ => None,
        });
        assert_eq!(beats.next_back(), Some(*critical), "case {k}");
        if *critical {
            assert!(sent.iter().any(announced), "case {k}");
        }
        // The mode remains when the condition ends, and a person ends it.
        f.a.conditions = FailsafeConditions::default();
        f.fly(1.0, |_| Some(hold.clone()));
        assert_eq!(f.kind(), expected[1], "case {k}");
        assert!(f.a.choose(mode_number(*firmware, Offboard)));
        f.fly(0.5, |_| Some(hold.clone()));
        assert_eq!(f.kind(), Offboard, "case {k}");
    }
}

#[test]
fn own_landing_on_a_resting_deck() {
    for firmware in BOTH {
        let mut f = Flown::new(&ideal(firmware), 1, Vector3::new(0.1, 0.1, -5.0));
        f.deck.position = Point::new(0.0, 0.0, 0.0);
        assert!(f.a.choose(mode_number(firmware, AutopilotMode::Land)));
        f.rest(20.0);
        assert!(!f.a.armed() && f.a.flight.landed() == LandedState::OnGround);
        assert!((f.impacts[0].normal_mps - 0.7).abs() < 0.15, "{:?}", f.impacts[0]);
    }
}

#[test]
fn disarm_in_the_air_only_by_force_and_for_good() {
    for firmware in BOTH {
        let mut f = Flown::offboard(&ideal(firmware), 1, Vector3::new(0.0, 0.0, -50.0));
        f.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 0.0]);
        f.rest(0.1);
        assert!(f.a.armed());
        f.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, FORCE]);
        f.rest(0.3);
        assert!(
            !f.a.armed() && f.drone.thrust_n() < 0.05,
            "{}",
            f.drone.thrust_n()
        );
        f.fly(0.5, |_| Some(attitude(0.0, 0.5)));
        assert!(f.drone.thrust_n() < 0.05 && f.velocity().z > 4.0);
    }
}

#[test]
fn streams_at_their_rate_and_denials() {
    // ArduCopter's telemetry sends at most 40 Hz.
    for (firmware, which, denied, hz) in [
        (
            Firmware::Px4,
            m::ODOMETRY_DATA::ID,
            m::SCALED_IMU_DATA::ID,
            50_usize,
        ),
        (
            Firmware::ArduCopter,
            m::LOCAL_POSITION_NED_DATA::ID,
            m::ODOMETRY_DATA::ID,
            40,
        ),
    ] {
        let mut f = Flown::new(&ideal(firmware), 1, Vector3::new(0.0, 0.0, -20.0));
        f.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [f64::from(which), 2e4]);
        f.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [f64::from(denied), 2e4]);
        f.rest(0.1);
        let acks: Vec<_> = f.a.sent();
        let denials = acks.iter().filter(|m| {
            matches!(m, MavlinkMessage::Common(MavMessage::COMMAND_ACK(d)) if d.result != MavResult::MAV_RESULT_ACCEPTED)
        });
        assert_eq!(denials.count(), 1);
        f.rest(2.0);
        let positions = |m: &&MavlinkMessage| {
            matches!(
                m,
                MavlinkMessage::Common(MavMessage::ODOMETRY(_) | MavMessage::LOCAL_POSITION_NED(_))
            )
        };
        let sent = f.a.sent().iter().filter(positions).count();
        assert!(
            (2 * hz - 1..=2 * hz + 1).contains(&sent),
            "{sent} in 2 s at {hz} Hz"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn arbitrary_set_points(values in proptest::array::uniform16(proptest::num::f64::ANY), attitudes: bool) {
        let start = Vector3::new(0.0, 0.0, -30.0);
        let mut f = Flown::offboard(&DroneConfig::default(), 9, start);
        let v = |i: usize| [values[i], values[i + 1], values[i + 2]];
        let message = if attitudes {
            let attitude = [values[0], values[1], values[2], values[3]];
            MavlinkMessage::AttitudeThrust(AttitudeThrustTarget { to: TO, attitude, rates: Some(v(4)), thrust: values[7] })
        } else {
            MavlinkMessage::Position(PositionTarget {
                to: TO, position: v(0), velocity: v(3), acceleration: v(6), yaw: values[9], yaw_rate: values[10],
            })
        };
        f.fly(DT, |_| Some(message.clone()));
        f.rest(1.0);
        prop_assert!(f.a.position().iter().chain(f.position().iter()).all(|v| v.is_finite()));
    }

    #[test]
    fn extreme_but_valid_set_points(
        p in proptest::array::uniform3(-9e4_f64..9e4), v in proptest::array::uniform3(-99.0_f64..99.0),
        a in proptest::array::uniform3(-199.0_f64..199.0),
    ) {
        let mut f = Flown::offboard(&DroneConfig::default(), 9, Vector3::new(0.0, 0.0, -30.0));
        f.fly(3.0, |_| Some(track(Vector3::from(p), v, a)));
        prop_assert_eq!(f.a.rejected, 0);
        // The drone is still upright: the autopilot's limits hold.
        prop_assert!((f.drone.truth().attitude.0 * Vector3::z()).z > 0.4);
        prop_assert!(f.drone.mass_kg() * GRAVITY > 0.0);
    }
}

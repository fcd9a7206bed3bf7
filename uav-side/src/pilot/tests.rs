use alight_shared::{
    config::parse,
    frames::wxyz,
    msg::{DeckStage, LandedState, Motors},
    time::Time,
};
use nalgebra::UnitQuaternion;
use proptest::prelude::*;

use super::*;
use crate::{
    fixtures::{airborne, drone, forecast, header, level, mission, plan},
    flatness::{attitude_of_thrust, lead, slewed, thrust_of_attitude, tilt_limited, upright},
    tracking::{Authority, TrackingConfig},
};

proptest! {
    #[test]
    fn attitude_and_thrust_inverse(roll in -1.0..1.0_f64, pitch in -1.0..1.0_f64, yaw in -3.1..3.1_f64, down in -5.0..5.0_f64) {
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let t = thrust_of_attitude(&q, down, GRAVITY);
        prop_assert!((t.z + GRAVITY - down).abs() < 1e-9 || t.norm() < 1e-9);
        prop_assert!(attitude_of_thrust(&t, yaw).angle_to(&q) < 1e-6);
        let tilt = tilt_limited(&t, 0.3, 1.0);
        prop_assert!(tilt.x.hypot(tilt.y) <= -tilt.z * 0.3_f64.tan() + 1e-9 && tilt.z <= -1.0);
    }

    #[test]
    fn upright_attitude_limit(roll in -3.1..3.1_f64, pitch in -1.5..1.5_f64, yaw in -3.1..3.1_f64) {
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let is = q * -Vector3::z();
        let limited = upright(&q, 0.6) * -Vector3::z();
        let tilt = |up: &Vector3<f64>| up.angle(&-Vector3::z());
        prop_assert!(tilt(&limited) <= 0.6 + 1e-6);
        prop_assert!(tilt(&is) > 0.6 || upright(&q, 0.6) == q);
        prop_assert!(is.xy().perp(&limited.xy()).abs() < 1e-6 && is.xy().dot(&limited.xy()) >= 0.0);
    }

    #[test]
    fn slewed_attitude_limit(a in -1.0..1.0_f64, b in -1.0..1.0_f64, max in 0.0..0.5_f64) {
        let p = UnitQuaternion::from_euler_angles(a, b, 0.0);
        let q = UnitQuaternion::from_euler_angles(b, 0.2, a);
        let r = slewed(&p, &q, max);
        prop_assert!(p.angle_to(&r) <= max + 1e-6);
        prop_assert!(r.angle_to(&q) <= p.angle_to(&q) + 1e-6);
    }
}

/// RMS tilt error of an attitude loop above a deck, with and without lead compensation.
fn follow(order: usize, lag: f64, compensated: bool) -> f64 {
    let w = std::f64::consts::TAU / 5.0;
    let dt = 0.001;
    let mut x = [0.0; 2];
    let mut square = 0.0;
    let mut n = 0.0;
    for k in 0..20_000_i32 {
        let t = f64::from(k) * dt;
        let deck = 0.1 * (w * t).sin();
        let rate = 0.1 * w * (w * t).cos();
        let command = if compensated {
            lead(&[deck, 0.0, 0.0], &[rate, 0.0, 0.0], lag)[0]
        } else {
            deck
        };
        let tau = lag / order as f64;
        let mut from = command;
        for s in x.iter_mut().take(order) {
            *s += (from - *s) * dt / tau;
            from = *s;
        }
        if t > 5.0 {
            square += (from - deck).powi(2);
            n += 1.0;
        }
    }
    f64::sqrt(square / n).to_degrees()
}

#[test]
fn attitude_error_with_lead() {
    let bare = follow(1, 0.2, false);
    assert!(bare > 0.8, "{bare}");
    assert!(follow(1, 0.2, true) < 0.02 * bare);
    assert!(follow(2, 0.3, true) < 0.15 * follow(2, 0.3, false));
}

#[test]
fn feedback_tilt_over_the_deck() {
    let c = TrackingConfig::default();
    let planned = UnitQuaternion::from_euler_angles(0.05, -0.1, 0.3);
    let body = Body {
        position: Vector3::new(1.0, -1.0, 0.0),
        velocity: Vector3::zeros(),
        attitude: planned,
    };
    let stage = PlanStage {
        euler: [0.05, -0.1, 0.3],
        ..PlanStage::default()
    };
    let estimate = FlightEstimator::new(0.34);
    let off = |authority| {
        let mut t = Tracker::default();
        let mut a = None;
        for _ in 0..200 {
            a = Some(t.track(&stage, &body, &estimate, authority, 0.2, 0.01, &c));
        }
        a.unwrap().attitude.angle_to(&planned)
    };
    let touching = off(Authority::flare(0.0, &c));
    assert!(touching < c.contact_feedback_tilt_rad * 1.1, "{touching}");
    assert!(off(Authority::descent(&c)) > 3.0 * touching);
}

fn new_pilot() -> Pilot {
    Pilot::new(
        &PilotConfig::default(),
        &DroneGeometry::default(),
        &DeckGeometry::default(),
        1,
        1,
    )
}
fn everything(n: u32, now: DroneTime, state: State, height: f64) -> PilotIn {
    let header = header(n, now);
    let stage = PlanStage {
        position: [1.0, 2.0, -1.6 - height],
        ..PlanStage::default()
    };
    PilotIn {
        plan: Some(plan(header, |_| stage)),
        mission: Some(mission(header, state, 0.5)),
        forecast: Some(forecast(header, |_| level([0.0, 0.0, -1.3]))),
        drone: Some(drone(header, [0.0, 0.0, -1.6 - height])),
        autopilot: Some(airborne(header)),
        ranges: vec![],
    }
}
/// Last set-point after one second with all inputs, followed by `secs` (s) with the inputs as modified by
/// `change`.
fn after(state: State, height: f64, secs: f64, change: impl Fn(&mut PilotIn)) -> SetPoint {
    run(&PilotConfig::default(), state, height, secs, change)
}
fn run(
    config: &PilotConfig,
    state: State,
    height: f64,
    secs: f64,
    change: impl Fn(&mut PilotIn),
) -> SetPoint {
    let mut pilot = Pilot::new(config, &DroneGeometry::default(), &DeckGeometry::default(), 1, 1);
    let mut last = SetPoint::default();
    for k in 0..(100.0 * (1.0 + secs)) as u32 {
        let now = Time::from_secs(5.0 + f64::from(k) * 0.01);
        let mut input = everything(k, now, state, height);
        if k >= 100 {
            change(&mut input);
        }
        last = pilot.step(now, &input).set_point.unwrap();
        assert_eq!(last.motors, Motors::Run);
    }
    last
}

#[test]
fn set_point_kind_in_all_phases() {
    for (state, held) in [
        (State::Idle, true),
        (State::GetAltitude, false),
        (State::Approach, false),
        (State::Tracking, false),
        (State::Tracking, true),
        (State::Descent, false),
        (State::Descent, true),
        (State::Flare, false),
    ] {
        for output in [Output::Attitude, Output::Trajectory] {
            let config = PilotConfig {
                output,
                ..PilotConfig::default()
            };
            let s = run(&config, state, 5.0, 1.0, |i| i.plan = i.plan.filter(|_| !held));
            let kind = match output {
                Output::Attitude => SetPointKind::Attitude,
                Output::Trajectory => SetPointKind::Trajectory,
            };
            assert_eq!(s.kind, kind, "{state:?}");
        }
    }
    let s = after(State::Tracking, 5.0, 0.0, |_| ());
    assert_eq!(s.position, [1.0, 2.0, -6.6]);
}

#[test]
fn idle_thrust_on_the_ground() {
    let drone = DroneGeometry::default();
    let feet_m = drone.feet_below_m - drone.rangefinder_m[2];
    // A reduced thrust also needs the rangefinder, which reads 0 without a measurement.
    for (range_m, stands) in [
        (Some(feet_m), true),
        (Some(12.0), false),
        (Some(0.0), false),
        (None, false),
    ] {
        let s = after(State::Idle, 0.0, 1.0, |i| {
            let autopilot = i.autopilot.as_mut().unwrap();
            autopilot.landed = LandedState::OnGround;
            i.ranges.extend(range_m.map(|range_m| RangeSample {
                header: autopilot.header,
                range_m,
                variance: 1e-4,
            }));
        });
        assert_eq!(s.kind, SetPointKind::Attitude);
        assert_eq!((0.0..0.15).contains(&s.thrust), stands, "{range_m:?}: {s:?}");
    }
    // Without a rangefinder the drone stands at the height at which it was disarmed.
    let mut pilot = new_pilot();
    let mut last = SetPoint::default();
    for k in 0..200 {
        let now = Time::from_secs(5.0 + f64::from(k) * 0.01);
        let mut input = everything(k, now, State::Idle, 0.0);
        let autopilot = input.autopilot.as_mut().unwrap();
        autopilot.landed = LandedState::OnGround;
        autopilot.armed = k >= 100;
        last = pilot.step(now, &input).set_point.unwrap();
    }
    assert!((0.0..0.15).contains(&last.thrust), "{last:?}");
}

#[test]
fn response_with_manual_attitudes() {
    // A pilot rocks the drone by remote control while set-points are streamed for the handover.
    let mut pilot = new_pilot();
    let before = pilot.response.get().lag_s;
    for k in 0..1000 {
        let t = f64::from(k) * 0.01;
        let now = Time::from_secs(5.0 + t);
        let mut i = everything(k, now, State::Idle, 5.0);
        i.autopilot.as_mut().unwrap().mode = AutopilotMode::Other;
        let d = i.drone.as_mut().unwrap();
        d.attitude = wxyz(&UnitQuaternion::from_euler_angles(
            0.2 * (2.0 * t).sin(),
            0.0,
            0.0,
        ));
        d.rates = [0.4 * (2.0 * t).cos(), 0.0, 0.0];
        pilot.step(now, &i);
    }
    assert_eq!(pilot.response.get().lag_s, before);
}

#[test]
fn attitude_beyond_the_tilt_limit() {
    let geometry = DroneGeometry::default();
    let hover = geometry.mass_kg * GRAVITY / geometry.max_thrust_n;
    let limit = TrackingConfig::default().tilt_limit_rad;
    // The drone is at its target and rises, so the plan requires little thrust.
    for (tilt, of_hover) in [
        (0.0, 0.25..0.6),
        (0.7, 0.7..1.1),
        (-0.7, 0.7..1.1),
        (1.2, 0.9..1.1),
    ] {
        let s = after(State::Descent, 5.0, 0.1, |i| {
            let attitude = UnitQuaternion::from_euler_angles(tilt, 0.0, 0.0);
            let d = i.drone.as_mut().unwrap();
            d.position = [1.0, 2.0, -6.6];
            d.velocity = [0.0, 0.0, -3.0];
            d.attitude = wxyz(&attitude);
        });
        let commanded = (s.attitude() * Vector3::z()).angle(&Vector3::z());
        assert!(commanded <= limit + 1e-6, "{tilt}: {s:?}");
        assert!(of_hover.contains(&(s.thrust / hover)), "{tilt}: {s:?}");
    }
}

/// A drone that has slid over the deck's edge sinks next to the vessel, below the deck.
#[test]
fn hold_below_the_edge_of_a_deck() {
    let geometry = DroneGeometry::default();
    let hover = geometry.mass_kg * GRAVITY / geometry.max_thrust_n;
    for (aside_m, height_m, min_of_hover) in [
        (3.3, -0.6, 1.2),
        (1.0, -0.6, 1.2),
        (3.3, 0.05, 1.2),
        (9.0, -0.1, 1.2),
    ] {
        let s = after(State::Idle, height_m, 1.0, |i| {
            let d = i.drone.as_mut().unwrap();
            (d.position[0], d.velocity[2]) = (aside_m, 0.6);
        });
        assert!(
            s.thrust > min_of_hover * hover,
            "{aside_m} m aside, {height_m} m: {s:?}"
        );
    }
}

#[test]
fn withdrawn_landing_with_plans_that_go_on() {
    // The landing is withdrawn at 6 s; the planner publishes its last plan at `until`.
    let climbs_from = |pilot: &mut Pilot, until: f64| {
        let mut first = None;
        for k in 0..150_u32 {
            let t = 5.0 + f64::from(k) * 0.01;
            let now = Time::from_secs(t);
            let wanted = if t < 6.0 { State::Descent } else { State::GaveUp };
            let mut i = everything(k, now, wanted, 2.0);
            let mission = i.mission.as_mut().unwrap();
            mission.since = Time::from_secs(if t < 6.0 { 4.0 } else { 6.0 });
            mission.previous = if t < 6.0 { State::Tracking } else { State::Descent };
            if t > until {
                i.plan = None;
            }
            let s = pilot.step(now, &i).set_point.unwrap();
            if t >= 6.0 && s.velocity[2] < -0.2 {
                first.get_or_insert(t);
            }
        }
        first
    };
    for until in [5.9, 6.0] {
        let mut pilot = new_pilot();
        let first = climbs_from(&mut pilot, until).unwrap();
        assert!((6.1..6.3).contains(&first), "{first}");
    }
    let mut other = new_pilot();
    assert_eq!(climbs_from(&mut other, 7.0), None, "the planner responds");
}

#[test]
fn stale_plan() {
    let s = after(State::Tracking, 6.0, 1.0, |i| i.plan = None);
    assert_eq!(s.velocity, [0.0; 3]);
    assert_eq!(s.position, [0.0, 0.0, -7.6]);
    let s = after(State::Descent, 2.0, 1.0, |i| i.plan = None);
    assert_eq!(s.velocity, [0.0, 0.0, -3.0]);
    assert!(s.position[2] < -4.4, "{s:?}");
    // Near the vessel the drone is clear only at the mission's height.
    let high = |i: &mut PilotIn| (i.plan, i.mission.as_mut().unwrap().height_m) = (None, 7.0);
    let s = after(State::Tracking, 5.0, 1.0, high);
    assert_eq!(s.velocity, [0.0, 0.0, -3.0]);
    let s = after(State::Tracking, 6.0, 1.0, high);
    assert_eq!(s.velocity, [0.0; 3]);
    let s = after(State::Tracking, 5.0, 1.0, |i| {
        high(i);
        i.forecast.as_mut().unwrap().surroundings.escape = Some(core::f32::consts::FRAC_PI_2);
    });
    assert!(
        s.velocity[1] > 1.99 && s.velocity[2] == -3.0,
        "to starboard: {s:?}"
    );
    let s = after(State::Tracking, 2.0, 1.0, |i| {
        high(i);
        i.drone.as_mut().unwrap().position[0] += 20.0;
    });
    assert_eq!(s.velocity, [0.0; 3]);
    // A committed drone is level and sinks onto the deck.
    let s = after(State::Flare, 0.4, 1.0, |i| i.plan = None);
    assert!((s.velocity[2] - 0.5).abs() < 1e-9);
    assert!(s.attitude().angle() < 0.01 && s.thrust < 0.34, "{s:?}");
}

#[test]
fn climb_without_a_plan_from_a_rising_deck() {
    let mut pilot = new_pilot();
    let mut last = SetPoint::default();
    for k in 0..200 {
        let now = Time::from_secs(5.0 + f64::from(k) * 0.01);
        let (state, height) = if k < 170 {
            (State::Descent, 1.0)
        } else {
            (State::Flare, 0.6)
        };
        let mut input = everything(k, now, state, height);
        input.plan = input.plan.filter(|_| k < 100);
        last = pilot.step(now, &input).set_point.unwrap();
    }
    assert_eq!(last.velocity[2], -3.0);
}

/// Thrust, as a fraction of hover, of a drone in the flare, `age_s` after the last plan.
#[derive(Clone, Copy)]
struct InFlare {
    age_s: f64,
    clearance_m: f64,
    sinks_mps: f64,
    planned_mps: f64,
    /// Upward acceleration of the deck, m/s².
    rises_mps2: f64,
    /// Tilt of the drone, rad, and its speed in the direction of the tilt, m/s.
    tilt: f64,
    along_mps: f64,
}

/// Drone that sinks at 2 m/s, as planned, 0.6 m above a resting deck.
const SINKS: InFlare = InFlare {
    age_s: 0.0,
    clearance_m: 0.6,
    sinks_mps: 2.0,
    planned_mps: 2.0,
    rises_mps2: 0.0,
    tilt: 0.0,
    along_mps: 0.0,
};

impl InFlare {
    fn thrust(self) -> f64 {
        let geometry = DroneGeometry::default();
        let mut pilot = new_pilot();
        let mut thrust = pilot.estimate.hover();
        for k in 0..=(20 + (100.0 * self.age_s) as u32) {
            let now = Time::from_secs(5.0 + f64::from(k) * 0.01);
            let mut input = everything(k, now, State::Flare, self.clearance_m);
            let d = input.drone.as_mut().unwrap();
            d.velocity = [-self.along_mps, 0.0, self.sinks_mps];
            d.attitude = wxyz(&UnitQuaternion::from_euler_angles(0.0, self.tilt, 0.0));
            // The specific force is that of the last command's thrust.
            d.specific_force = [0.0, 0.0, -pilot.estimate.specific(thrust)];
            let stage = PlanStage {
                position: d.position,
                velocity: [-self.along_mps, 0.0, self.planned_mps],
                ..PlanStage::default()
            };
            let new = |p: Plan| plan(p.header, |_| stage);
            input.plan = input.plan.map(new).filter(|_| k <= 20);
            let deck = DeckStage {
                acceleration: [0.0, 0.0, -self.rises_mps2],
                ..level([0.0, 0.0, -1.3])
            };
            input.forecast = input.forecast.map(|f| forecast(f.header, |_| deck));
            thrust = pilot.step(now, &input).set_point.unwrap().thrust;
        }
        thrust * geometry.max_thrust_n / (geometry.mass_kg * GRAVITY)
    }
}

#[test]
fn braking_of_a_plan_not_renewed() {
    // The deceleration is (2² - 0.5²) / 2 (0.6 - 0.1) m/s², within half of the rotors' reserve beyond hover.
    let old = InFlare { age_s: 0.2, ..SINKS };
    let braked = old.thrust();
    assert!((1.3..1.5).contains(&braked), "{braked}");
    // Tilted by 0.5 rad the same vertical force needs more thrust.
    let tilted = InFlare { tilt: 0.5, ..old }.thrust();
    assert!(tilted > 1.05 * braked, "{tilted} {braked}");
    // A plan that already brakes harder is followed.
    let soft = InFlare {
        planned_mps: 0.2,
        ..old
    }
    .thrust();
    assert!(soft > braked, "{soft}");
}

#[test]
fn braking_of_a_drone_too_fast_onto_the_deck() {
    // The plan is followed while v² is at most 0.35² + 2 3 (h - 0.05 v).
    for (speed, clearance_m) in [(2.0, 1.0), (1.0, 0.3), (0.3, 0.1)] {
        let flown = InFlare {
            clearance_m,
            sinks_mps: speed,
            planned_mps: speed,
            ..SINKS
        };
        let followed = flown.thrust();
        assert!((0.9..1.1).contains(&followed), "{speed}: {followed}");
    }
    // The deceleration is (2² - 0.25²) / 2 (0.6 - 0.1 - 0.05) m/s².
    let braked = SINKS.thrust();
    assert!((1.35..1.55).contains(&braked), "{braked}");
    // The plan is followed above a deck that accelerates upwards and so reduces the rotors' reserve.
    let rising = InFlare {
        clearance_m: 1.0,
        rises_mps2: 8.0,
        ..SINKS
    };
    assert!(rising.thrust() > 1.8);
    // A tilted drone brakes only until its speeds along and onto the deck are equal.
    let [slow, fast] = [-1.0, 1.5].map(|along_mps| {
        InFlare {
            tilt: 0.2,
            along_mps,
            ..SINKS
        }
        .thrust()
    });
    assert!(
        slow > braked - 0.05 && fast < braked - 0.2,
        "{slow} {fast} {braked}"
    );
}

/// Set-point a second after the loss of plan and mission, 0.3 m above a deck that then rises.
fn alone(state: State, rise_mps2: f64) -> SetPoint {
    after(state, 0.3, 1.0, |i| {
        i.plan = None;
        i.mission = None;
        let deck = |t: f64| DeckStage {
            velocity: [0.0, 0.0, -rise_mps2 * t],
            ..level([0.0, 0.0, -1.3 - 0.5 * rise_mps2 * t * t])
        };
        i.forecast = i.drone.map(|d| forecast(d.header, deck));
    })
}

#[test]
fn landing_without_plan_and_mission() {
    for state in [State::Descent, State::Flare] {
        let climbs = alone(state, 0.0);
        let up = climbs.velocity[2];
        assert!(up < -1.0, "{climbs:?}");
        let lands = alone(state, 12.0);
        assert!((lands.velocity[2] - 0.5).abs() < 1e-9, "{lands:?}");
    }
}

#[test]
fn set_point_without_odometry_mission_or_control() {
    let none = |s: SetPoint| assert_eq!(s.kind, SetPointKind::None);
    none(after(State::Tracking, 6.0, 1.0, |i| i.drone = None));
    none(after(State::Tracking, 6.0, 2.0, |i| i.autopilot = None));
    none(after(State::Tracking, 6.0, 1.0, |i| {
        i.autopilot.as_mut().unwrap().armed = false;
    }));
    none(after(State::Tracking, 6.0, 5.0, |i| i.mission = None));
    none(after(State::Landed, 6.0, 1.0, |_| ()));
    let s = after(State::Tracking, 6.0, 2.0, |i| i.mission = None);
    assert_eq!(s.kind, SetPointKind::Attitude, "holds for a moment first");
}

/// Feeds a pilot with missions and autopilot states, 10 ms apart.
#[derive(Default)]
struct Answers(u32);

impl Answers {
    fn next(&mut self, pilot: &mut Pilot, state: State, armed: bool) -> Motors {
        self.0 += 1;
        let t = Time::from_secs(5.0 + 0.01 * f64::from(self.0));
        let mut i = everything(self.0, t, state, 2.0);
        i.autopilot.as_mut().unwrap().armed = armed;
        pilot.step(t, &i).set_point.unwrap().motors
    }
}

#[test]
fn false_touchdown_taken_back() {
    let mut pilot = new_pilot();
    let mut answers = Answers::default();
    let mut next = |pilot: &mut Pilot, state, armed| answers.next(pilot, state, armed);
    assert_eq!(next(&mut pilot, State::Flare, true), Motors::Run);
    pilot.stop_from(Time::from_secs(5.01));
    // The mission does not receive the touchdown at first, then receives it, then flies.
    assert_eq!(next(&mut pilot, State::Flare, true), Motors::Stop);
    assert_eq!(next(&mut pilot, State::Landed, true), Motors::Stop);
    assert_eq!(next(&mut pilot, State::GaveUp, true), Motors::Run);
    // After a true touchdown the motors are released once the drone is disarmed and the mission idle.
    pilot.stop_from(Time::from_secs(5.04));
    assert_eq!(next(&mut pilot, State::Idle, true), Motors::Stop);
    assert_eq!(next(&mut pilot, State::Landed, false), Motors::Stop);
    assert_eq!(next(&mut pilot, State::Idle, false), Motors::Run);
}

#[test]
fn pilot_at_an_origin_reset() {
    let s = after(State::Tracking, 6.0, 0.3, |i| {
        i.plan = None;
        let drone = i.drone.as_mut().unwrap();
        drone.frames = 1;
        drone.position[0] = 3.0;
    });
    assert_eq!(s.position, [3.0, 0.0, -7.6]);
}

#[test]
fn pilot_configuration() {
    assert!(parse::<PilotConfig>("", "test").is_ok());
    let e = parse::<PilotConfig>("[tracking]\nflare_feedback_tilt_rad = 0.5", "test")
        .unwrap_err()
        .to_string();
    assert!(e.contains("tracking.flare_feedback_tilt_rad"), "{e}");
    let c = parse::<PilotConfig>("output = \"trajectory\"", "test").unwrap();
    assert_eq!(c.output, Output::Trajectory);
}

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -3.0..3.0_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(1e200),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]
    #[test]
    fn pilot_random_input(
        blows in prop::collection::vec(
            (any::<u8>(), 0..10_u8, prop::array::uniform6(wild()), -200..900_i64, 0.0..3.0_f64, 1..40_u32), 1..40),
        landing in any::<bool>(),
    ) {
        let mut pilot = new_pilot();
        let mut now = Time::from_secs(5.0);
        let mut n = 0;
        let states = [
            State::Idle, State::GetAltitude, State::Approach, State::Tracking, State::TrackingStable,
            State::Descent, State::Flare, State::Landed, State::Hold, State::GaveUp,
        ];
        for (mask, state, v, age, height, repeat) in blows {
            let state = states[usize::from(state) % states.len()];
            // In half of the cases contact is never permitted.
            let touches = state.phase() == Phase::Landing || state == State::Landed;
            let state = if !landing && touches { State::Tracking } else { state };
            for _ in 0..repeat {
                n += 1;
                now += Span::from_millis(10);
                let then = if age > 500 { now - Span::from_millis(age - 500) } else { now };
                let mut i = everything(n, then, state, height);
                i.ranges = vec![RangeSample { header: header(n, then), range_m: v[0].abs(), variance: 1e-3 }];
                let force = i.drone.as_mut().unwrap();
                if landing {
                    force.specific_force = [v[1], v[2], 0.0];
                } else {
                    force.specific_force = [v[1], v[2], v[3] * 30.0];
                }
                if mask & 1 != 0 { force.velocity = [v[1], v[2], v[3]] }
                if mask & 2 != 0 { i.plan.as_mut().unwrap().stages[3].position = [v[3], v[4], v[5]] }
                if mask & 4 != 0 { i.forecast.as_mut().unwrap().stages[0].position = [v[5], v[4], v[3]] }
                if mask & 8 != 0 { i.autopilot.as_mut().unwrap().thrust = Some(v[4]) }
                if mask & 16 != 0 { i.plan = None }
                if mask & 32 != 0 { i.mission = None }
                if mask & 64 != 0 { i.drone = None }
                if mask & 128 != 0 { i.forecast = None }
                let out = pilot.step(now, &i);
                let s = out.set_point.unwrap();
                prop_assert!(s.check().is_ok(), "{s:?}");
                prop_assert_eq!(s.motors, Motors::Run);
                prop_assert!(out.touchdown.is_none());
            }
        }
    }
}

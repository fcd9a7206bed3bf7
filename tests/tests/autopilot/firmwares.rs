//! What PX4 and ArduCopter make of an attitude and a thrust, as the makers' own programs were seen to.

use alight_shared::msg::{DroneState, SetPoint, State};
use alight_uav::autopilot::AutopilotLinkConfig;
use alight_uav::autopilot::modes::Firmware;
use nalgebra::{Quaternion, UnitQuaternion};

use super::rig::{Rig, hover, press};
use super::{BOTH, config};

/// A pilot that rocks the drone about its own axis at a heading of 180 degrees, as above a rocking deck.
fn rock(d: &DroneState) -> SetPoint {
    let turning = core::f64::consts::TAU / 1.5;
    let (sin, cos) = (turning * d.header.at.secs()).sin_cos();
    let q = UnitQuaternion::from_euler_angles(0.15 * sin, 0.0, core::f64::consts::PI);
    SetPoint {
        attitude: [q.w, q.i, q.j, q.k],
        rates: [0.15 * turning * cos, 0.0, 0.0],
        thrust: hover(),
        ..press(d)
    }
}

#[test]
fn ardu_copter_is_sent_no_body_rates() {
    // How far its attitude is from the one wanted, root of the mean square over three periods, rad.
    let apart = |firmware, send_rates| {
        let c = AutopilotLinkConfig {
            send_rates,
            ..config()
        };
        let mut p = Rig::at(firmware, 50.0, core::f64::consts::PI, &c);
        p.take_command();
        p.mission = State::Descent;
        p.pilot = Some(rock);
        p.run(1.5);
        let mut sum = 0.0;
        for _ in 0..450 {
            p.run(0.01);
            let state = p.odometry.last().expect("odometry").1;
            let [w, x, y, z] = rock(&state).attitude;
            let wanted = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            sum += p.truth().attitude.0.angle_to(&wanted).powi(2);
        }
        (sum / 450.0).sqrt()
    };
    let default = AutopilotLinkConfig::default().send_rates;
    let [px4, copter] = BOTH.map(|f| apart(f, default));
    assert!((px4 - copter).abs() < 0.1 * px4, "{px4} {copter}");
    // What they would do.
    let with = apart(Firmware::ArduCopter, true);
    assert!(with > 1.2 * copter, "{with} {copter}");
}

/// A pilot that leans the drone by 0.4 rad with the thrust that hovers upright.
fn lean(d: &DroneState) -> SetPoint {
    let q = UnitQuaternion::from_euler_angles(0.4, 0.0, 0.0);
    SetPoint {
        attitude: [q.w, q.i, q.j, q.k],
        thrust: hover(),
        ..press(d)
    }
}

#[test]
fn tilted_drone_gets_the_thrust_that_the_pilot_commands() {
    // ArduCopter would add 9 % for the lean by itself.
    for firmware in BOTH {
        let mut p = Rig::commanding(firmware, 50.0, &config());
        p.mission = State::Descent;
        p.pilot = Some(lean);
        p.run(2.0);
        assert!(
            (p.linked.autopilot.thrust() - hover()).abs() < 0.005,
            "{firmware:?}: {}",
            p.linked.autopilot.thrust()
        );
        // The thrust that is applied is reported.
        let reported = p.state().thrust;
        assert!((reported - hover()).abs() < 0.01, "{firmware:?}: {reported}");
    }
}

//! Parameters of the companion computer that a ground station reads and sets.

use super::{
    BOTH, config,
    ground::{STATION, VEHICLE},
    rig::LinkRig,
};
use alight_shared::{mavlink::dialect as m, msg::LandingMode};
use alight_uav::autopilot::message::{MavMessage as M, MavlinkMessage, chars};

pub(super) fn set(target_component: u8, name: &str, param_value: f32) -> MavlinkMessage {
    let message = M::PARAM_SET(m::PARAM_SET_DATA {
        param_value,
        target_system: VEHICLE,
        target_component,
        param_id: chars(name),
        param_type: m::MavParamType::MAV_PARAM_TYPE_REAL32,
    });
    message.into()
}

fn disarmed(firmware: alight_uav::autopilot::modes::Firmware) -> LinkRig {
    let mut p = LinkRig::new(firmware, 0.3, &config());
    p.linked.autopilot.arm(false);
    p.run(4.0);
    assert!(!p.state().armed, "{firmware:?}");
    p
}

#[test]
fn parameters_of_the_companion() {
    for firmware in BOTH {
        let mut p = disarmed(firmware);
        let expected: Vec<(String, f32)> = [
            ("ALIGHT_MODE", 2.0),
            ("ALIGHT_APPR_H", 15.0),
            ("ALIGHT_TRACK_H", 7.0),
            ("ALIGHT_MATCH_H", 2.0),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
        // Addressed to this component, and to all components.
        for target_component in [191, 0] {
            let list = m::PARAM_REQUEST_LIST_DATA {
                target_system: VEHICLE,
                target_component,
            };
            p.inject(STATION, &M::PARAM_REQUEST_LIST(list).into());
            p.run(0.1);
            assert_eq!(core::mem::take(&mut p.parameters), expected, "{firmware:?}");
        }
        let read = |name: &str, param_index| m::PARAM_REQUEST_READ_DATA {
            param_index,
            target_system: VEHICLE,
            target_component: 191,
            param_id: chars(name),
        };
        for request in [read("", 3), read("ALIGHT_MATCH_H", -1), read("", 4)] {
            p.inject(STATION, &M::PARAM_REQUEST_READ(request).into());
        }
        p.run(0.1);
        let twice = [expected[3].clone(), expected[3].clone()];
        assert_eq!(core::mem::take(&mut p.parameters), twice, "{firmware:?}");

        // Answered once the mission reports the new value.
        p.inject(STATION, &set(191, "ALIGHT_MODE", 1.0));
        p.run(0.05);
        assert!(p.parameters.is_empty());
        p.mission_settings = p.settings.last().expect("an order").settings;
        assert_eq!(p.mission_settings.mode, LandingMode::Match);
        p.run(0.1);
        let mode = |value| vec![("ALIGHT_MODE".to_owned(), value)];
        assert_eq!(core::mem::take(&mut p.parameters), mode(1.0), "{firmware:?}");
        let text = "ground station 255 sets ALIGHT_MODE to 1 (match)";
        assert!(p.texts.iter().any(|t| t == text), "{:?}", p.texts);
    }
}

#[test]
fn parameters_that_stay() {
    for firmware in BOTH {
        let mut p = disarmed(firmware);
        let rejected = |p: &mut LinkRig, component, value, why: &str| {
            p.notes.clear();
            p.inject(STATION, &set(component, "ALIGHT_APPR_H", value));
            p.run(0.1);
            let text = format!("ALIGHT_APPR_H unchanged: {why}");
            let known = core::mem::take(&mut p.parameters);
            assert!(p.settings.is_empty(), "{firmware:?} {why}");
            (p.notes.iter().any(|(_, t)| *t == text), known.len())
        };
        assert_eq!(rejected(&mut p, 191, 500.0, "500 not in 2 to 200"), (true, 1));
        // Requests to another component, and to all components, get no answer.
        assert_eq!(rejected(&mut p, 1, 12.0, ""), (false, 0));
        assert_eq!(rejected(&mut p, 0, 12.0, ""), (false, 0));
        p.settable = false;
        p.run(0.1);
        assert_eq!(
            rejected(&mut p, 191, 12.0, "landing or take-off ordered"),
            (true, 1)
        );
        p.settable = true;
        p.linked.autopilot.arm(true);
        p.run(1.5);
        assert_eq!(rejected(&mut p, 191, 12.0, "the drone is armed"), (true, 1));
        p.mission_silent = true;
        p.run(1.0);
        assert_eq!(rejected(&mut p, 191, 12.0, "no mission reports"), (true, 1));
    }
}

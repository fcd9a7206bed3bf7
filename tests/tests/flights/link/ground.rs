//! Reports to a ground station through the autopilot, and commands from an RC switch.

use alight_shared::{
    mavlink::{FrameReader, dialect},
    msg::{CommandKind, ReasonCode, State},
};
use alight_sim::harness::{
    rig::Rig,
    scenario::{NodeConfigs, Scenario},
};
use alight_uav::autopilot::{
    AutopilotLinkConfig,
    ground_station::{AGE, DISTANCE},
    message::{Address, CommandLong, MavCmd, MavMessage, MavResult, MavlinkMessage, command_ack, severity},
    wire::Encoder,
};

use super::{BOTH, aloft, commanding, config, rig::LinkRig};

/// RC channel to which the switch is assigned.
const CHANNEL: u8 = 7;
const MIDDLE: u16 = 1500;
const HIGH: u16 = 2000;

/// Channels with the switch at this pulse width, us.
fn channels(us: u16) -> Option<[u16; 18]> {
    let mut all = [1500; 18];
    all[usize::from(CHANNEL) - 1] = us;
    Some(all)
}

#[test]
fn companion_component() {
    for firmware in BOTH {
        let mut p = aloft(firmware);
        p.run(2.0);
        p.heartbeats.clear();
        p.run(10.0);
        let vehicle = p.linked.autopilot.address.system;
        assert!((9..=11).contains(&p.heartbeats.len()), "{}", p.heartbeats.len());
        for (_, from, heartbeat) in &p.heartbeats {
            assert_eq!((from.system, from.component), (vehicle, 191));
            let bytes = Encoder::default().frame(*from, heartbeat).expect("a frame");
            let mut frames = FrameReader::default();
            frames.push(&bytes);
            let frame = frames.next_frame().and_then(|f| f.message());
            let Some(dialect::MavMessage::HEARTBEAT(h)) = frame else {
                panic!("{frame:?}")
            };
            assert_eq!(h.mavtype, dialect::MavType::MAV_TYPE_ONBOARD_CONTROLLER);
            assert_eq!(h.autopilot, dialect::MavAutopilot::MAV_AUTOPILOT_INVALID);
            assert_eq!(h.system_status, dialect::MavState::MAV_STATE_ACTIVE);
        }
    }
}

#[test]
fn ground_station_states_and_values() {
    for firmware in BOTH {
        let mut p = commanding(firmware);
        p.notes.clear();
        p.values.clear();
        for state in [State::Tracking, State::Descent, State::GaveUp] {
            p.mission = state;
            p.run(1.0);
        }
        let names: Vec<&str> = p.notes.iter().map(|(_, t)| t.as_str()).collect();
        assert_eq!(names, ["Tracking", "Descent", "Gave up"], "{firmware:?}");
        let severities: Vec<u8> = p.notes.iter().map(|(s, _)| *s).collect();
        assert_eq!(severities, [severity::INFO, severity::INFO, severity::WARNING]);
        let values = |name: &str| {
            p.values
                .iter()
                .filter(|(_, n, _)| n == name)
                .map(|v| v.2)
                .collect::<Vec<_>>()
        };
        let distances = values(DISTANCE);
        let ages = values(AGE);
        assert!(
            (5..=7).contains(&distances.len()) && distances.len() == ages.len(),
            "{distances:?}"
        );
        let height = -p.truth().position.0.z;
        assert!(
            distances.iter().all(|d| (d - height).abs() < 0.3),
            "{distances:?} at {height} m"
        );
        assert!(ages.iter().all(|a| (0.0..0.1).contains(a)), "{ages:?}");
        // Without forecasts the reported age increases, and no distance is reported.
        p.forecast = false;
        p.run(3.0);
        p.values.clear();
        p.run(1.1);
        let age = p.values.iter().rfind(|v| v.1 == AGE).expect("an age");
        assert!(age.2 > 3.0, "{:?}", p.values);
        assert!(p.values.iter().all(|v| v.1 != DISTANCE), "{:?}", p.values);
    }
}

pub(super) fn order(number: MavCmd) -> MavlinkMessage {
    CommandLong::new(Address::new(VEHICLE, 191), number, []).into()
}
pub(super) const STATION: Address = Address::new(255, 190);
pub(super) const VEHICLE: u8 = 3;

/// By default an abort is accepted from any sender. Other orders need a signature; a rejection states the reason.
#[test]
fn orders_of_a_link_as_shipped() {
    for firmware in BOTH {
        let mut p = LinkRig::new(firmware, 5.0, &AutopilotLinkConfig::default());
        p.waits_for_flight = true;
        p.run(3.0);
        p.inject(STATION, &order(MavCmd::MAV_CMD_USER_1));
        p.run(1.0);
        let denied = (MavCmd::MAV_CMD_USER_1, MavResult::MAV_RESULT_DENIED);
        assert_eq!(p.answers, [denied], "{firmware:?}");
        let texts = &p.notes;
        assert!(
            texts.iter().any(|(_, text)| text.contains("signing_key")),
            "{texts:?}"
        );
        assert!(p.orders.is_empty(), "{:?}", p.orders);
        p.inject(STATION, &order(MavCmd::MAV_CMD_USER_2));
        p.run(0.1);
        assert!(p.orders.iter().any(|c| c.kind == CommandKind::Abort));
    }
}

fn by_int(to: Address, command: MavCmd) -> MavlinkMessage {
    let message = MavMessage::COMMAND_INT(dialect::COMMAND_INT_DATA {
        target_system: to.system,
        target_component: to.component,
        command,
        ..dialect::COMMAND_INT_DATA::DEFAULT
    });
    message.into()
}

#[test]
fn order_by_command_int() {
    for firmware in BOTH {
        let mut p = aloft(firmware);
        p.run(3.0);
        p.waits_for_flight = true;
        let to = Address::new(VEHICLE, 191);
        let command = MavCmd::MAV_CMD_USER_1;
        p.inject(STATION, &by_int(to, command));
        p.run(1.0);
        let results = [MavResult::MAV_RESULT_IN_PROGRESS, MavResult::MAV_RESULT_ACCEPTED];
        assert_eq!(p.answers, results.map(|r| (command, r)), "{firmware:?}");
        assert_eq!(p.answered, [STATION; 2]);
        assert!(p.orders.iter().all(|c| c.kind == CommandKind::Land) && !p.orders.is_empty());
        // Orders addressed to another component, and to all components.
        p.orders.clear();
        for component in [0, 154] {
            let to = Address::new(VEHICLE, component);
            p.inject(STATION, &by_int(to, command));
        }
        p.run(1.0);
        assert_eq!((p.answers.len(), p.orders.len()), (2, 0));
    }
}

#[test]
fn answers_to_another_station() {
    for firmware in BOTH {
        let mut p = aloft(firmware);
        p.run(3.0);
        let autopilot = p.linked.autopilot.address;
        let mut denied = |to| {
            p.texts.clear();
            let denial = command_ack(MavCmd::MAV_CMD_DO_SET_MODE, MavResult::MAV_RESULT_DENIED, to);
            p.inject(autopilot, &denial);
            p.run(0.1);
            p.texts.iter().filter(|t| t.contains("denied")).count()
        };
        let own = Address::new(VEHICLE, 191);
        // A firmware that does not report its address leaves both ids, or only the component, unspecified.
        for to in [own, Address::default(), Address::new(VEHICLE, 0)] {
            assert_eq!(denied(to), 1, "{firmware:?} {to:?}");
        }
        for to in [STATION, Address::new(VEHICLE, 190), Address::new(255, 0)] {
            assert_eq!(denied(to), 0, "{firmware:?} {to:?}");
        }
    }
}

pub(super) fn by_mavlink() -> NodeConfigs {
    NodeConfigs {
        autopilot: config(),
        ..NodeConfigs::default()
    }
}

#[test]
fn abort_by_ground_station_and_landing_by_rc_switch() {
    let mut nodes = by_mavlink();
    nodes.autopilot.rc_switch = CHANNEL;
    let mut rig = Rig::landing(&Scenario::default(), &nodes, 1).unwrap();
    let turn = |rig: &mut Rig, us: u16| rig.world.linked(0).unwrap().autopilot.channels = channels(us);
    turn(&mut rig, MIDDLE);
    assert!(rig.until(60.0, |r| r.state(0) == State::Descent));
    let t = rig.world.physics().now();
    let up = &mut rig.world.linked(0).unwrap().up;
    up.send(t, STATION, &order(MavCmd::MAV_CMD_USER_2));
    assert!(rig.until(60.0, |r| r.state(0) == State::GaveUp));
    let m = rig.mission(0);
    assert!(
        m.abort.is_some() && m.entered.code == ReasonCode::Operator,
        "{m:?}"
    );
    // The link does not send the command again before the abort is accepted and answered.
    assert!(!rig.until(2.0, |r| r.state(0) == State::Descent));
    turn(&mut rig, HIGH);
    let landed = rig.until(60.0, |r| r.state(0) == State::Landed);
    assert!(landed, "{:?}", rig.state(0));
}

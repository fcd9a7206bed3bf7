//! Messages of a ground station through encoder and decoder.

use super::ground::{STATION, VEHICLE, order};
use super::station_parameters::set;
use alight_uav::autopilot::ground_station::{AGE, DISTANCE, WIND};
use alight_uav::autopilot::message::{
    Address, CommandResult, LandingTarget, MavlinkMessage, ParameterValue, RC_RECEIVER, RcChannels,
    TargetFrame, command, severity,
};
use alight_uav::autopilot::wire::{Decoder, Encoder};

fn messages() -> Vec<MavlinkMessage> {
    let target = |frame| {
        MavlinkMessage::LandingTarget(LandingTarget {
            time_us: 123_456_789_012,
            frame,
            position: [1.5, -2.25, 4.0],
            distance_m: 4.75,
            attitude: [0.5, -0.5, 0.5, -0.5],
            size_m: 1.5,
        })
    };
    let mut sent: Vec<MavlinkMessage> = TargetFrame::ALL.into_iter().map(target).collect();
    let pulses_us: [u16; 18] = core::array::from_fn(|k| 1000 + 10 * k as u16);
    sent.extend([
        MavlinkMessage::RemoteControl(RcChannels { count: 16, pulses_us }),
        MavlinkMessage::RemoteControlOverride {
            to: Address::new(3, 1),
            pulses_us: core::array::from_fn(|k| pulses_us[k]),
        },
        order(command::USER_1),
        order(command::USER_2),
        order(command::USER_3),
        MavlinkMessage::CommandInt {
            to: Address::new(VEHICLE, 191),
            command: command::USER_4,
            first: [25.0, -30.0, 10.0, 20.0],
        },
        MavlinkMessage::CommandAck {
            command: command::USER_2,
            result: CommandResult::InProgress,
            to: STATION,
        },
        MavlinkMessage::ParameterList {
            to: Address::new(VEHICLE, 0),
        },
        MavlinkMessage::ParameterRequest {
            to: Address::new(VEHICLE, 191),
            name: "ALIGHT_MODE".into(),
            index: None,
        },
        MavlinkMessage::ParameterRequest {
            to: Address::new(VEHICLE, 191),
            name: String::new(),
            index: Some(3),
        },
        set(191, "ALIGHT_MODE", 1.0),
        MavlinkMessage::Parameter {
            name: "ALIGHT_MODE".into(),
            value: ParameterValue {
                bits: 2.0_f32.to_bits(),
                integer: false,
            },
            index: 1,
            count: 4,
        },
        MavlinkMessage::SystemStatus {
            present: RC_RECEIVER | 1,
            healthy: RC_RECEIVER,
        },
        MavlinkMessage::NamedValue {
            time_ms: 77,
            name: AGE.into(),
            value: 0.25,
        },
        MavlinkMessage::Text {
            severity: severity::WARNING,
            text: "x".repeat(50),
        },
    ]);
    sent
}

#[test]
fn message_values_over_the_wire() {
    for message in messages() {
        let mut decoder = Decoder::default();
        decoder.push(
            &Encoder::default()
                .frame(Address::new(3, 191), &message)
                .expect("a frame"),
        );
        assert_eq!(decoder.next_frame().map(|f| f.message), Some(message));
    }
    // Named values have names of up to ten characters.
    assert!(
        [DISTANCE, AGE, WIND[0], WIND[1]]
            .iter()
            .all(|name| name.len() <= 10)
    );
}

//! Arbitrary input causes no panic and no unbounded memory use.

use alight_shared::{
    geometry::DroneGeometry,
    mavlink::{MavlinkSender, Message as _, Outgoing, dialect as m, encode},
    node::Node,
    time::Time,
    wire::{decode_record, encode_record},
};
use alight_uav::{
    autopilot::{
        AutopilotIn, AutopilotLink, AutopilotLinkConfig,
        message::{
            Address, CommandLong, HilGps, MavCmd, MavMessage, MavModeFlag, MavResult, MavType, MavlinkFrame,
            MavlinkMessage, ParameterValue, chars, command_ack, heartbeat, narrow, parameter,
        },
        modes::{Firmware, px4_mode},
        wire::{Decoder, Encoder},
    },
    odometry::OdometryConfig,
};
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -10.0..10.0_f64,
        any::<f64>(),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(1e30),
    ]
}
fn three() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(number())
}

/// Message of the dialect with an arbitrary payload; None if it is unused or has a value outside of the dialect.
fn payload() -> impl Strategy<Value = Option<MavlinkMessage>> {
    let word = prop_oneof![
        any::<u32>(),
        0..20_u32,
        (-10.0..10.0_f32).prop_map(f32::to_bits),
        Just(f32::NAN.to_bits()),
        Just(f32::INFINITY.to_bits()),
    ];
    let id = prop::sample::select(MavMessage::all_ids());
    (id, prop::collection::vec(word, 0..60)).prop_map(|(id, words)| {
        let payload = words.into_iter().flat_map(u32::to_le_bytes).collect();
        let message = Outgoing::new(id, MavMessage::extra_crc(id), payload);
        let from = MavlinkSender {
            system: 1,
            component: 1,
            sequence: 0,
        };
        let mut decoder = Decoder::default();
        decoder.push(&encode(from, message, None));
        Some(decoder.next_frame()?.message)
    })
}

/// Messages with the values that the link looks for.
fn known() -> impl Strategy<Value = MavlinkMessage> {
    let four = || prop::array::uniform4(number());
    let own = Address::new(1, 191);
    let commands = || {
        prop_oneof![
            Just(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM),
            Just(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL),
            Just(MavCmd::MAV_CMD_DO_SET_MODE),
            Just(MavCmd::MAV_CMD_USER_4),
        ]
    };
    let values = || any::<(u32, bool)>().prop_map(|(bits, integer)| ParameterValue { bits, integer });
    prop_oneof![
        (any::<bool>(), any::<u8>(), any::<u32>()).prop_map(|(px4, mode, custom_mode)| {
            let firmware = if px4 { Firmware::Px4 } else { Firmware::ArduCopter };
            beat(firmware, MavModeFlag::from_bits_retain(mode), custom_mode)
        }),
        (any::<u64>(), four(), any::<bool>(), any::<[f32; 6]>()).prop_map(|(time_usec, q, body, v)| {
            MavMessage::ODOMETRY(m::ODOMETRY_DATA {
                time_usec,
                q: narrow(q),
                x: v[0],
                vx: v[1],
                yawspeed: v[2],
                pose_covariance: [v[3]; 21],
                velocity_covariance: [v[4]; 21],
                frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
                child_frame_id: if body {
                    m::MavFrame::MAV_FRAME_BODY_FRD
                } else {
                    m::MavFrame::MAV_FRAME_LOCAL_NED
                },
                ..m::ODOMETRY_DATA::DEFAULT
            })
            .into()
        }),
        (any::<u32>(), any::<[u16; 3]>()).prop_map(
            |(time_boot_ms, [current_distance, min_distance, max_distance])| {
                MavMessage::DISTANCE_SENSOR(m::DISTANCE_SENSOR_DATA {
                    time_boot_ms,
                    min_distance,
                    max_distance,
                    current_distance,
                    orientation: m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
                    ..m::DISTANCE_SENSOR_DATA::DEFAULT
                })
                .into()
            }
        ),
        (
            prop_oneof![
                "[A-Z_]{0,20}",
                Just("GUID_OPTIONS".to_owned()),
                Just("COM_OBL_RC_ACT".to_owned())
            ],
            values()
        )
            .prop_map(|(name, value)| parameter(&name, value, 0, 1)),
        (commands(), any::<u8>(), four()).prop_map(move |(command, confirmation, first)| {
            let command = CommandLong {
                confirmation,
                ..CommandLong::new(own, command, first)
            };
            command.into()
        }),
        commands().prop_map(|command| command_ack(command, MavResult::MAV_RESULT_DENIED, Address::default())),
        (
            prop_oneof![Just("ALIGHT_MODE"), Just("ALIGHT_APPR_H"), Just("ALIGHT_X")],
            values()
        )
            .prop_map(move |(name, value)| {
                let message = MavMessage::PARAM_SET(m::PARAM_SET_DATA {
                    param_value: f32::from_bits(value.bits),
                    target_system: own.system,
                    target_component: own.component,
                    param_id: chars(name),
                    param_type: value.kind(),
                });
                message.into()
            }),
        (0..8_u8, "\\PC{0,12}").prop_map(|(severity, text)| MavlinkMessage::Text { severity, text }),
        any::<u16>().prop_map(|flags| MavlinkMessage::EkfStatus { flags }),
        (three(), number()).prop_map(|(velocity, altitude_m)| {
            MavlinkMessage::HilGps(HilGps {
                time_us: 0,
                latitude: altitude_m,
                longitude: altitude_m,
                altitude_m,
                velocity,
                sd_m: [1.0; 2],
            })
        }),
    ]
}
fn beat(firmware: Firmware, base_mode: MavModeFlag, custom_mode: u32) -> MavlinkMessage {
    heartbeat(
        firmware.autopilot(),
        MavType::MAV_TYPE_QUADROTOR,
        base_mode,
        custom_mode,
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn decoder_frames_among_noise(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..40),
    ) {
        let mut decoder = Decoder::default();
        let mut encoder = Encoder::default();
        let mut sent = 0;
        let mut found = 0;
        let beat = beat(Firmware::Px4, MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 7);
        for piece in &pieces {
            decoder.push(piece);
            // Noise may look like the start of a frame; a silence as long as a frame ends it.
            decoder.push(&[0; 300]);
            decoder.push(&encoder.frame(Address::new(1, 1), &beat).unwrap());
            sent += 1;
            while let Some(f) = decoder.next_frame() {
                found += u32::from(f.message == beat);
            }
        }
        prop_assert!(found >= sent, "{found} of {sent}");
    }

    #[test]
    fn encoded_message_round_trip(known in known(), payload in payload()) {
        for m in [known].into_iter().chain(payload) {
            let mut decoder = Decoder::default();
            decoder.push(&Encoder::default().frame(Address::new(9, 1), &m).unwrap());
            let back = decoder.next_frame().map(|f| (f.from, std::mem::discriminant(&f.message)));
            prop_assert_eq!(back, Some((Address::new(9, 1), std::mem::discriminant(&m))));
            prop_assert!(decoder.next_frame().is_none());
            // Read back as recorded.
            let recorded = encode_record(&m).unwrap();
            let read: MavlinkMessage = decode_record(&recorded).unwrap();
            prop_assert_eq!(encode_record(&read).unwrap(), recorded);
        }
    }

    #[test]
    fn arbitrary_messages_to_the_link(
        all in prop::collection::vec((prop::collection::vec((known(), payload()), 0..12), 0..400_i64), 1..60),
    ) {
        use alight_shared::msg::Message as _;
        let mut link = AutopilotLink::new(
            &AutopilotLinkConfig { publish_deck: true, may_arm: true, rc_switch: 7, ..AutopilotLinkConfig::default() },
            &OdometryConfig::default(),
            &DroneGeometry::default(),
            true,
            1,
            1,
        );
        let from = Address::new(1, 1);
        let mut now_ms = 1000;
        let known = beat(Firmware::Px4, MavModeFlag::from_bits_retain(129), px4_mode(6, 0));
        for (messages, wait_ms) in all {
            now_ms += wait_ms;
            let received = core::iter::once(known.clone())
                .chain(messages.into_iter().flat_map(|(known, payload)| [Some(known), payload]).flatten())
                .map(|message| MavlinkFrame { from, message })
                .collect();
            let now = Time::from_nanos(now_ms * 1_000_000);
            let out = link.step(now, &AutopilotIn { received, ..AutopilotIn::default() });
            prop_assert!(out.odometry.iter().all(|o| o.check().is_ok()));
            prop_assert!(out.ranges.iter().all(|r| r.check().is_ok()));
            prop_assert!(out.state.is_none_or(|s| s.check().is_ok()), "{:?}", out.state);
            prop_assert!(out.messages.len() < 64 && out.texts.len() <= 8);
            // No set-point is sent without the pilot's set-points.
            let flown = |m: &MavlinkMessage| matches!(m, MavlinkMessage::Position(_) | MavlinkMessage::AttitudeThrust(_));
            prop_assert!(!out.messages.iter().any(flown));
        }
    }
}

#[test]
fn decoder_buffer_bound() {
    let mut decoder = Decoder::default();
    for _ in 0..1000 {
        decoder.push(&[0xfd; 1000]);
    }
    assert!(decoder.lost() > 900_000);
    while decoder.next_frame().is_some() {}
    let beat = beat(
        Firmware::ArduCopter,
        MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        4,
    );
    decoder.push(&[0; 300]);
    decoder.push(&Encoder::default().frame(Address::new(1, 1), &beat).unwrap());
    assert_eq!(decoder.next_frame().unwrap().message, beat);
}

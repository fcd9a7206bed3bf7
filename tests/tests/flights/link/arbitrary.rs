//! Arbitrary input causes no panic and no unbounded memory use.

use std::sync::OnceLock;

use alight_shared::{
    geometry::DroneGeometry,
    mavlink::{MavlinkSender, Message as _, Outgoing, encode},
    node::Node,
    time::Time,
    wire::{decode_record, encode_record},
};
use alight_uav::{
    autopilot::{
        AutopilotIn, AutopilotLink, AutopilotLinkConfig,
        message::{
            Address, CommandLong, MavCmd, MavMessage, MavModeFlag, MavType, MavlinkFrame, MavlinkMessage,
            heartbeat,
        },
        modes::{Firmware, px4_mode},
        wire::{Decoder, Encoder},
    },
    odometry::OdometryConfig,
};
use proptest::prelude::*;

use super::{BOTH, config, rig::LinkRig, station_parameters::set};

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

/// Messages of the simulated autopilots as they set up their link, and those of a ground station.
fn genuine() -> &'static [MavlinkMessage] {
    static ALL: OnceLock<Vec<MavlinkMessage>> = OnceLock::new();
    ALL.get_or_init(|| {
        let own = Address::new(1, 191);
        let commands = [
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            MavCmd::MAV_CMD_DO_SET_MODE,
            MavCmd::MAV_CMD_USER_4,
        ];
        let commands = commands.map(|c| CommandLong::new(own, c, [1.0, 2.0, 3.0]).into());
        let settings = ["ALIGHT_MODE", "ALIGHT_APPR_H", "ALIGHT_X"].map(|name| set(own.component, name, 1.0));
        let mut all = [commands.as_slice(), &settings].concat();
        for firmware in BOTH {
            let mut p = LinkRig::new(firmware, 0.3, &config());
            for _ in 0..600 {
                p.run(0.005);
                all.extend(p.received.iter().map(|frame| frame.message.clone()));
            }
        }
        all
    })
}
/// Genuine message with this number in place of some of its recorded bytes, unless the decoder rejects it.
fn known() -> impl Strategy<Value = MavlinkMessage> {
    let number = prop_oneof![
        any::<u32>(),
        0..20_u32,
        Just(f32::NAN.to_bits()),
        Just(f32::INFINITY.to_bits())
    ];
    (prop::sample::select(genuine()), any::<usize>(), number).prop_map(|(message, at, number)| {
        let mut bytes = encode_record(&message).unwrap();
        let at = at % bytes.len();
        for (byte, value) in bytes[at..].iter_mut().zip(number.to_le_bytes()) {
            *byte = value;
        }
        decode_record(&bytes).unwrap_or(message)
    })
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
    fn encoded_message_round_trip(known in prop::sample::select(genuine()), payload in payload()) {
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

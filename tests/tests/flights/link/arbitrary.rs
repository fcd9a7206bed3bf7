//! Arbitrary input causes no panic and no unbounded memory use.

use alight_shared::geometry::DroneGeometry;
use alight_shared::node::Node;
use alight_shared::time::Time;
use alight_uav::autopilot::message::{
    Address, AttitudeReport, CommandLong, CommandResult, DistanceReport, Heartbeat, HilGps, ImuReport,
    MavlinkFrame, MavlinkMessage, OdometryReport, ParameterValue, PositionReport, RcChannels, VelocityFrame,
};
use alight_uav::autopilot::wire::{Decoder, Encoder};
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotLinkConfig};
use alight_uav::odometry::OdometryConfig;
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

fn message() -> impl Strategy<Value = MavlinkMessage> {
    let four = || prop::array::uniform4(number());
    let commands = || prop_oneof![Just(400_u16), Just(511), Just(176)];
    prop_oneof![
        (0..20_u8, 0..40_u8, any::<u8>(), any::<u32>()).prop_map(|(autopilot, vehicle, base_mode, mode)| {
            heartbeat(autopilot, vehicle, base_mode, mode)
        }),
        (any::<i64>(), any::<i64>())
            .prop_map(|(remote_ns, local_ns)| MavlinkMessage::Timesync { remote_ns, local_ns }),
        (
            any::<u64>(),
            three(),
            four(),
            three(),
            any::<bool>(),
            three(),
            any::<u8>()
        )
            .prop_map(|(time_us, position, attitude, velocity, body, v, resets)| {
                MavlinkMessage::Odometry(OdometryReport {
                    time_us,
                    position,
                    attitude,
                    velocity,
                    frame: [VelocityFrame::Ned, VelocityFrame::Body][usize::from(body)],
                    rates: v,
                    variances: Some([v; 3]),
                    resets,
                })
            }),
        (any::<u32>(), three(), three()).prop_map(|(time_ms, position, velocity)| {
            MavlinkMessage::LocalPosition(PositionReport {
                time_ms,
                position,
                velocity,
            })
        }),
        (any::<u32>(), four(), three()).prop_map(|(time_ms, attitude, rates)| {
            MavlinkMessage::Attitude(AttitudeReport {
                time_ms,
                attitude,
                rates,
            })
        }),
        (any::<u64>(), three(), three()).prop_map(|(time_us, accelerometer, gyro)| {
            MavlinkMessage::Imu(ImuReport {
                time_us,
                accelerometer,
                gyro,
            })
        }),
        (any::<u32>(), number(), number(), number()).prop_map(|(time_ms, range_m, limit, v)| {
            MavlinkMessage::Distance(DistanceReport {
                time_ms,
                range_m,
                limits_m: [0.0, limit],
                variance: Some(v),
            })
        }),
        (0..6_u8).prop_map(|state| MavlinkMessage::Landed { state }),
        (any::<u8>(), three()).prop_map(
            |(number, [remaining, voltage, current])| MavlinkMessage::Battery {
                number,
                remaining: Some(remaining),
                voltage_v: Some(voltage),
                current_a: Some(current),
            }
        ),
        number().prop_map(|thrust| MavlinkMessage::AttitudeTargetThrust { thrust }),
        (any::<u8>(), any::<[u16; 8]>())
            .prop_map(|(port, pulses_us)| MavlinkMessage::Outputs { port, pulses_us }),
        any::<u32>().prop_map(|custom_mode| MavlinkMessage::Mode { custom_mode }),
        (
            prop_oneof![
                "[A-Z_]{0,20}",
                Just("GUID_OPTIONS".to_owned()),
                Just("COM_OBL_RC_ACT".to_owned())
            ],
            any::<(u32, bool)>()
        )
            .prop_map(|(name, (bits, integer))| {
                let value = ParameterValue { bits, integer };
                MavlinkMessage::Parameter {
                    name,
                    value,
                    index: 0,
                    count: 1,
                }
            }),
        (commands(), any::<u8>()).prop_map(|(command, confirmation)| {
            MavlinkMessage::Command(CommandLong {
                confirmation,
                ..CommandLong::new(Address::default(), command, [])
            })
        }),
        (commands(), Just(CommandResult::Denied)).prop_map(|(command, result)| MavlinkMessage::CommandAck {
            command,
            result,
            to: Address::default(),
        }),
        (
            prop_oneof![Just("ALIGHT_MODE"), Just("ALIGHT_APPR_H"), Just("ALIGHT_X")],
            any::<(u32, bool)>(),
        )
            .prop_map(|(name, (bits, integer))| MavlinkMessage::ParameterSet {
                to: Address::new(1, 191),
                name: name.into(),
                value: ParameterValue { bits, integer },
            }),
        (0..9_u16).prop_map(|index| MavlinkMessage::ParameterRequest {
            to: Address::new(1, 191),
            name: String::new(),
            index: Some(index),
        }),
        (0..2_u8).prop_map(|component| MavlinkMessage::ParameterList {
            to: Address::new(1, 191 * component),
        }),
        (commands(), any::<[f32; 4]>()).prop_map(|(command, first)| MavlinkMessage::CommandInt {
            to: Address::new(1, 191),
            command,
            first: first.map(f64::from),
        }),
        (0..8_u8, "\\PC{0,12}").prop_map(|(severity, text)| MavlinkMessage::Text { severity, text }),
        any::<u16>().prop_map(|flags| MavlinkMessage::EstimatorStatus { flags }),
        any::<u16>().prop_map(|flags| MavlinkMessage::EkfStatus { flags }),
        any::<(u32, u32)>().prop_map(|(present, healthy)| MavlinkMessage::SystemStatus { present, healthy }),
        (
            any::<u8>(),
            prop_oneof![any::<u16>(), Just(1000), Just(1500), Just(2000)]
        )
            .prop_map(|(count, us)| {
                MavlinkMessage::RemoteControl(RcChannels {
                    count,
                    pulses_us: [us; 18],
                })
            }),
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
fn heartbeat(autopilot: u8, vehicle: u8, base_mode: u8, custom_mode: u32) -> MavlinkMessage {
    MavlinkMessage::Heartbeat(Heartbeat {
        autopilot,
        vehicle,
        base_mode,
        custom_mode,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn decoder_frames_among_noise(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..40),
    ) {
        let mut decoder = Decoder::default();
        let (mut encoder, mut sent, mut found) = (Encoder::default(), 0, 0);
        let beat = heartbeat(12, 2, 1, 7);
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
    fn encoded_message_round_trip(m in message()) {
        // Messages that are not in the dialect are not sent.
        if let Some(bytes) = Encoder::default().frame(Address::new(9, 1), &m) {
            let mut decoder = Decoder::default();
            decoder.push(&bytes);
            let back = decoder.next_frame().map(|f| (f.from, std::mem::discriminant(&f.message)));
            prop_assert_eq!(back, Some((Address::new(9, 1), std::mem::discriminant(&m))));
            prop_assert!(decoder.next_frame().is_none());
        }
    }

    #[test]
    fn arbitrary_messages_to_the_link(
        all in prop::collection::vec((prop::collection::vec(message(), 0..12), 0..400_i64), 1..60),
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
        let known = heartbeat(12, 2, 129, 6 << 16);
        for (messages, wait_ms) in all {
            now_ms += wait_ms;
            let received = core::iter::once(known.clone())
                .chain(messages)
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
    let beat = heartbeat(3, 2, 1, 4);
    decoder.push(&[0; 300]);
    decoder.push(&Encoder::default().frame(Address::new(1, 1), &beat).unwrap());
    assert_eq!(decoder.next_frame().unwrap().message, beat);
}

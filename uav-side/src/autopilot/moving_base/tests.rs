use alight_shared::{geometry::DroneGeometry, msg::Seq, node::Node as _, time::Time};

use super::{
    super::{
        AutopilotIn, AutopilotLink, AutopilotLinkConfig,
        message::{
            AUTOPILOT_COMPONENT, Address, MavAutopilot, MavModeFlag, MavType, MavlinkFrame, MavlinkMessage,
            heartbeat,
        },
        wire::{Decoder, Encoder},
    },
    *,
};
use crate::odometry::OdometryConfig;

/// Valid RTCM 3 frame with a total of `length` bytes.
fn rtcm(length: usize) -> Vec<u8> {
    // The message number is 1077.
    let payload = [0x43, 0x50].into_iter().chain((0..).map(|k: usize| k as u8));
    alight_shared::rtcm::frame(&payload.take(length - 6).collect::<Vec<_>>())
}
/// Frame as the bridge publishes it, from vessel 5 with its antenna 2 m ahead of the deck's centre.
fn frame(at_s: f64, length: usize) -> RtcmFrames<DroneClock> {
    RtcmFrames {
        header: Header::new(5, 0, 1, 1, Time::from_secs(at_s)),
        antenna_m: [2.0, 0.0, -1.0],
        bytes: Seq::filled(rtcm(length)),
    }
}

/// Receiver that reassembles `GPS_RTCM_DATA` frames as MAVLink defines.
#[derive(Default)]
struct Reader {
    sequence: u8,
    parts: Vec<Option<Vec<u8>>>,
    frames: Vec<Vec<u8>>,
}

impl Reader {
    fn take(&mut self, message: &MavlinkMessage) {
        let MavlinkMessage::Common(MavMessage::GPS_RTCM_DATA(d)) = message else {
            return;
        };
        let data = d.data[..usize::from(d.len)].to_vec();
        if d.flags & 1 == 0 {
            self.frames.push(data);
            return;
        }
        let number = usize::from((d.flags >> 1) & 3);
        let sequence = d.flags >> 3;
        if self.parts.len() != 4 || sequence != self.sequence {
            self.sequence = sequence;
            self.parts = vec![None; 4];
        }
        self.parts[number] = Some(data);
        let ends = |p: &Option<Vec<u8>>| p.as_ref().is_some_and(|p| p.len() < 180);
        let length = self.parts.iter().position(ends).map_or(4, |k| k + 1);
        if self.parts[..length].iter().all(Option::is_some) {
            let whole = self.parts[..length].iter().flatten().flatten();
            self.frames.push(whole.copied().collect());
            self.parts.clear();
        }
    }
}

#[test]
fn fragments_reassembled_to_the_frame() {
    let bytes: Vec<u8> = (0..2000).map(|k| (k % 251) as u8).collect();
    let mut reader = Reader::default();
    let lengths = [(6, 1), (180, 1), (181, 2), (360, 3), (540, 4), (720, 4)];
    for (k, (length, count)) in (30_u8..).zip(lengths) {
        let parts = fragments(&bytes[..length], k).unwrap();
        assert_eq!(parts.len(), count, "{length}");
        // The fragments are encoded, which drops trailing zeros, and decoded again.
        for part in parts.into_iter().map(MavMessage::GPS_RTCM_DATA) {
            let mut decoder = Decoder::default();
            let to = Address::new(1, 191);
            let part = MavlinkMessage::from(part);
            decoder.push(&Encoder::default().frame(to, &part).unwrap());
            let received = decoder.next_frame().unwrap().message;
            assert_eq!(received, part, "{length}");
            reader.take(&received);
        }
        assert_eq!(reader.frames.pop().as_deref(), Some(&bytes[..length]), "{length}");
    }
    assert_eq!(fragments(&bytes[..721], 0), None);
}

/// Relative position from a report with this time of week and position that arrives at `now_s`.
fn place(
    base: &mut MovingBase,
    now_s: f64,
    of_week_s: f64,
    place: Option<[[f64; 3]; 2]>,
) -> Option<RelativePlace> {
    let report = RelativeReport {
        of_week_ns: (of_week_s * 1e9) as i64,
        station: None,
        place,
        solution: Some(CarrierSolution::Fixed),
        is_moving_base: true,
    };
    let latency = Span::from_millis(20);
    base.place(
        Time::from_secs(now_s),
        &report,
        latency,
        &mut OutputHeaders::default(),
    )
}

#[test]
fn place_dated_by_the_smallest_delay() {
    let mut base = MovingBase::default();
    let measured = Some([[1.0, 2.0, -3.0], [0.01; 3]]);
    // The report is delayed by 50 ms.
    assert_eq!(place(&mut base, 99.85, 604_798.8, measured), None, "no frame yet");
    let taken = &mut AutopilotOut::default();
    base.take(
        Time::from_secs(99.9),
        &[frame(99.8, 60)],
        RtcmTarget::Receiver,
        taken,
    );
    // Positions are measured every 0.2 s from 100.0 s on, across the end of the week, and delayed by at least
    // 20 ms.
    let mut errors = Vec::new();
    for k in 0..40_i32 {
        let made_s = 100.0 + 0.2 * f64::from(k);
        let delay_s = 0.02 + 0.01 * f64::from((k * 7 + 6) % 12);
        let of_week_s = (made_s + 604_699.0) % 604_800.0;
        let p = place(&mut base, made_s + delay_s, of_week_s, measured).unwrap();
        errors.push((p.header.at.secs() - made_s).abs());
        assert_eq!((p.header.vessel, p.antenna_m), (5, [2.0, 0.0, -1.0]));
        assert_eq!(
            (p.baseline_m, p.solution),
            ([1.0, 2.0, -3.0], CarrierSolution::Fixed)
        );
    }
    assert!(errors[6..].iter().all(|e| *e < 2e-3), "{errors:?}");
    // Only the state of the solution is known.
    let p = place(&mut base, 108.02, 7.0, None).unwrap();
    assert_eq!((p.baseline_m, p.baseline_sd_m), ([0.0; 3], [MAX_SD_M; 3]));
    // The vessel's antenna position has expired.
    assert_eq!(place(&mut base, 110.02, 9.0, measured), None);
}

/// The receiver's time message is not delayed and dates a relative position that the radio has delayed.
#[test]
fn place_dated_by_the_receivers_own_time() {
    let mut base = MovingBase::default();
    let mut headers = OutputHeaders::default();
    let taken = &mut AutopilotOut::default();
    base.take(
        Time::from_secs(99.9),
        &[frame(99.8, 60)],
        RtcmTarget::Receiver,
        taken,
    );
    for k in 0..20_i32 {
        let made_s = 100.0 + 0.2 * f64::from(k);
        let mut arrive = |delay_s: f64, place, solution| {
            let report = RelativeReport {
                of_week_ns: (made_s * 1e9) as i64,
                station: Some(0),
                place,
                solution,
                is_moving_base: true,
            };
            base.place(
                Time::from_secs(made_s + delay_s),
                &report,
                Span::ZERO,
                &mut headers,
            )
        };
        assert_eq!(arrive(0.04, None, None), None);
        let measured = Some([[1.0; 3], [0.01; 3]]);
        let p = arrive(0.17, measured, Some(CarrierSolution::Fixed)).unwrap();
        let late_s = p.header.at.secs() - made_s;
        assert!((late_s - 0.04).abs() < 2e-3, "{late_s}");
    }
}

#[test]
fn place_relative_to_another_station() {
    let mut base = MovingBase::default();
    let now = Time::from_secs(1.0);
    let taken = &mut AutopilotOut::default();
    base.take(now, &[frame(0.9, 60)], RtcmTarget::Receiver, taken);
    let report = RelativeReport {
        of_week_ns: 0,
        station: Some(7),
        place: Some([[1.0; 3], [0.01; 3]]),
        solution: Some(CarrierSolution::Fixed),
        is_moving_base: true,
    };
    let p = base
        .place(now, &report, Span::ZERO, &mut OutputHeaders::default())
        .unwrap();
    assert_eq!(
        (p.solution, p.baseline_sd_m),
        (CarrierSolution::None, [MAX_SD_M; 3])
    );
    let text = base.other_station(now, &report).unwrap();
    assert!(text.contains("station 7, vessel sends 0"), "{text}");
    assert_eq!(base.other_station(now, &report), None, "once");
}

/// Output at 1 s of a link that has received a PX4 heartbeat and these frames of the vessel's receiver.
fn link_out(receiver: &str, frames: Vec<RtcmFrames<DroneClock>>) -> (AutopilotOut, AutopilotLink) {
    let config = AutopilotLinkConfig {
        receiver: receiver.into(),
        ..AutopilotLinkConfig::default()
    };
    let odometry = OdometryConfig::default();
    let geometry = DroneGeometry::default();
    let mut link = AutopilotLink::new(&config, &odometry, &geometry, false, 1, 1);
    let heartbeat = MavlinkFrame {
        from: Address::new(1, AUTOPILOT_COMPONENT),
        message: heartbeat(
            MavAutopilot::MAV_AUTOPILOT_PX4,
            MavType::MAV_TYPE_QUADROTOR,
            MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            0,
        ),
    };
    let received = vec![heartbeat];
    let first = AutopilotIn {
        received,
        ..AutopilotIn::default()
    };
    link.step(Time::from_secs(0.9), &first);
    let own = RelativeReport {
        of_week_ns: 0,
        station: Some(0),
        place: Some([[1.0; 3], [0.02; 3]]),
        solution: Some(CarrierSolution::Fixed),
        is_moving_base: true,
    };
    let input = AutopilotIn {
        rtcm: frames,
        received: vec![MavlinkFrame {
            from: Address::default(),
            message: MavlinkMessage::RelativePlace(own),
        }],
        ..AutopilotIn::default()
    };
    (link.step(Time::from_secs(1.0), &input), link)
}

#[test]
fn frames_to_the_autopilot_or_to_the_receiver() {
    let frames = || vec![frame(0.9, 60), frame(0.9, 400), frame(0.9, 721), frame(-1.5, 60)];
    let counts = |link: &AutopilotLink| {
        let m = link.metrics(Time::from_secs(1.0));
        [m.rtcm_passed_on, m.rtcm_dropped]
    };
    let (out, link) = link_out("", frames());
    let mut reader = Reader::default();
    for m in &out.messages {
        reader.take(m);
    }
    assert_eq!(reader.frames, [rtcm(60), rtcm(400)]);
    assert!(out.rtcm.is_empty());
    assert_eq!(counts(&link), [2, 2], "too long, and too old");

    let (out, link) = link_out("serial:///dev/ttyACM0:115200", frames());
    let is_rtcm = |m: &&MavlinkMessage| matches!(m, MavlinkMessage::Common(MavMessage::GPS_RTCM_DATA(_)));
    assert_eq!(out.messages.iter().filter(is_rtcm).count(), 0);
    assert_eq!(out.rtcm, [rtcm(60), rtcm(400), rtcm(721)]);
    assert_eq!(counts(&link), [3, 1]);
    let [p] = out.relative[..] else {
        panic!("{:?}", out.relative)
    };
    assert_eq!((p.header.vessel, p.header.drone, p.header.sequence), (5, 1, 1));
    assert_eq!(
        link_out("serial:///dev/ttyACM0:115200", Vec::new()).0.relative,
        []
    );
}

#[test]
fn texts_of_the_relative_place_on_change() {
    let state = |solution, contradicted_m| RelativeState {
        solution,
        sd_m: 0.02,
        age_s: 0.1,
        contradicted_m,
        ..RelativeState::default()
    };
    let float = state(CarrierSolution::Float, None);
    let fixed = state(CarrierSolution::Fixed, None);
    let mut reports = RelativeReports::default();
    let mut texts = Vec::new();
    for (s, state) in [
        (0.0, None),
        (1.0, Some(float)),
        (2.0, Some(fixed)),
        (3.0, Some(fixed)),
        (4.0, Some(float)),
        (5.0, Some(fixed)),
        (8.0, Some(float)),
        (14.0, Some(fixed)),
        (20.0, Some(state(CarrierSolution::Fixed, Some(0.5)))),
        (26.0, None),
    ] {
        texts.extend(reports.change(Time::from_secs(s), state.as_ref()));
    }
    let fixed = (severity::INFO, "Moving base fixed: position to 2 cm".to_owned());
    let lost = |why: &str| (severity::WARNING, format!("Moving base lost: {why}"));
    let off = "Moving base 0.50 m off the tags: not used";
    let expected = [
        fixed.clone(),
        lost("float solution"),
        fixed,
        (severity::WARNING, off.to_owned()),
        lost("no measurement"),
    ];
    assert_eq!(texts, expected);
}

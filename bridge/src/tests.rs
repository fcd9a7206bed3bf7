//! The bridge with a simulated vessel: admission, rejection, clock uncertainty.

use crate::{Bridge, BridgeConfig, BridgeIn, BridgeOut, Packet};
use alight_shared::{
    admission::{RejectionReason, Sender},
    geodesy::Datum,
    msg::{
        AutopilotState, CommandKind, EstimateUpdate, Header, Message, MissionState, OperatorCommand,
        PredictedStage, Seq, State, TimeReply, TimeRequest, VesselEstimate, VesselPrediction, f16,
        message_version,
    },
    node::Node,
    radio::RadioTopic,
    time::{Clock, DroneClock, DroneTime, Span, Stamped, Time, VesselClock, VesselTime},
    wire,
};
use proptest::prelude::*;

mod rtcm;
mod waves;

const OFFSET: f64 = 0.35;

fn bridge() -> Bridge {
    Bridge::new(&BridgeConfig::default(), 9)
}
fn drone(s: f64) -> DroneTime {
    Time::from_secs(s)
}
fn vessel(s: f64) -> VesselTime {
    Time::from_secs(s - OFFSET)
}

fn estimate(boot: u32, sequence: u32, at: VesselTime) -> VesselEstimate<VesselClock> {
    VesselEstimate {
        header: Header::new(1, 0, boot, sequence, at),
        datum: Datum::default(),
        // Distinct numbers that 16-bit floats represent exactly.
        eta: [1.0, 2.0, 0.125, 0.0625, -0.03125, 1.5],
        eta_dot: [0.5, -0.5, 0.25, -0.25, -0.125, 0.375],
        eta_ddot: [0.1, 0.2, 0.3, 0.4, 0.6, 0.7].map(f16::from_f32),
        uncertainty: core::array::from_fn(|d| [0.2 + d as f32, 0.3 + d as f32, 0.1].map(f16::from_f32)),
        deck_centre: [-4.0, 0.75, -1.3],
        mean_velocity: [3.0, -1.0],
        mean_heading: [1.25, 0.03],
    }
}
/// Content of an estimate without its header.
fn stated<C: Clock>(e: &VesselEstimate<C>) -> VesselEstimate<VesselClock> {
    VesselEstimate {
        header: Header::default(),
        datum: e.datum,
        eta: e.eta,
        eta_dot: e.eta_dot,
        eta_ddot: e.eta_ddot,
        uncertainty: e.uncertainty,
        deck_centre: e.deck_centre,
        mean_velocity: e.mean_velocity,
        mean_heading: e.mean_heading,
    }
}
fn packet<T: serde::Serialize>(arrival: f64, kind: RadioTopic, m: &T) -> Stamped<DroneClock, Packet> {
    Stamped::new(
        drone(arrival),
        Packet {
            kind,
            sender: Sender::Vessel(1),
            bytes: wire::encode(m).unwrap(),
        },
    )
}
fn estimate_packet(arrival: f64, m: &VesselEstimate<VesselClock>) -> Stamped<DroneClock, Packet> {
    packet(arrival, RadioTopic::Estimate, &EstimateUpdate::whole(m))
}
fn step(b: &mut Bridge, now: f64, packets: Vec<Stamped<DroneClock, Packet>>) -> BridgeOut {
    b.step(
        drone(now),
        &BridgeIn {
            packets,
            ..BridgeIn::default()
        },
    )
}
fn reply(q: &TimeRequest<DroneClock>, boot: u32, at: f64) -> TimeReply<VesselClock, DroneClock> {
    TimeReply {
        header: Header::new(1, q.header.drone, boot, q.header.sequence, vessel(at)),
        requested_at: q.header.at,
        received_at: vessel(at),
    }
}

fn admitted(b: &mut Bridge, now: f64, m: &VesselEstimate<VesselClock>) -> Option<VesselEstimate<DroneClock>> {
    step(b, now, vec![estimate_packet(now, m)]).estimate
}

/// Bridge after `seconds` of exchanges, and the time at their end; `delays` returns those of request and
/// reply for each 10 ms step.
fn exchanged(seconds: u32, delays: impl Fn(u32) -> (f64, f64)) -> (Bridge, f64) {
    let mut b = bridge();
    let mut in_flight: Vec<(f64, TimeReply<VesselClock, DroneClock>)> = Vec::new();
    for k in 0..100 * seconds {
        let now = 0.01 * f64::from(k);
        let (arrived, rest): (Vec<_>, Vec<_>) = in_flight.into_iter().partition(|(t, _)| *t <= now);
        in_flight = rest;
        let packets = arrived
            .iter()
            .map(|(t, r)| packet(*t, RadioTopic::TimeReply, r))
            .collect();
        if let Some(q) = step(&mut b, now, packets).time_request {
            let (there, back) = delays(k);
            in_flight.push((now + there + back, reply(&q, 1, now + there)));
        }
    }
    (b, f64::from(seconds))
}
fn converged(seconds: u32) -> (Bridge, f64) {
    exchanged(seconds, |_| (0.05, 0.05))
}

#[test]
fn bridge_estimate_on_the_drone_clock() {
    let (mut b, now) = converged(5);
    let m = estimate(1, 0, vessel(now - 0.04));
    let e = admitted(&mut b, now, &m).unwrap();
    assert!(
        (e.header.at.secs() - (now - 0.04)).abs() < 0.002,
        "{:?}",
        e.header.at
    );
    assert_eq!(stated(&e), stated(&m));
    assert_eq!(b.rejections().total(), 0);
}

#[test]
fn bridge_without_clock_offset() {
    let mut b = bridge();
    let m = estimate(1, 0, vessel(1.0));
    let out = step(&mut b, 1.0, vec![estimate_packet(1.0, &m)]);
    assert!(out.estimate.is_none());
    assert_eq!(b.rejections().of(RejectionReason::NoClock), 1);
    assert_eq!(out.link.unwrap().clock_offset_sd_s, f64::INFINITY);
}

#[test]
fn bridge_abort_old_or_without_clock_offset() {
    let abort = |sequence: u32, given: VesselTime| OperatorCommand {
        header: Header::new(1, BridgeConfig::default().drone_id, 1, sequence, given),
        kind: CommandKind::Abort,
    };
    let at = |b: &mut Bridge, now: f64, m: &OperatorCommand<VesselClock>| {
        let out = step(b, now, vec![packet(now, RadioTopic::Command, m)]);
        out.commands.first().map(|c| c.header.at.secs())
    };
    let (mut b, now) = converged(5);
    let given = now - 20.0;
    for k in 0..4 {
        let passed = at(&mut b, now + 0.5 * f64::from(k), &abort(k, vessel(given))).unwrap();
        assert!((passed - given).abs() < 0.01, "{passed}");
    }
    let mut without_a_clock = bridge();
    assert_eq!(at(&mut without_a_clock, 7.0, &abort(0, vessel(1.0))), Some(7.0));
}

#[test]
fn bridge_rejection_reasons() {
    let (mut b, now) = converged(5);
    let good = estimate(1, 10, vessel(now - 0.05));
    let edit = |f: &dyn Fn(&mut VesselEstimate<VesselClock>)| {
        let mut m = estimate(1, 11, vessel(now - 0.02));
        f(&mut m);
        estimate_packet(now, &m)
    };
    assert!(admitted(&mut b, now, &good).is_some());
    let mut long = estimate_packet(now, &good);
    long.value.bytes.resize(wire::MAX_WIRE_BYTES + 1, 0);
    let mut short = estimate_packet(now, &good);
    short.value.bytes.truncate(100);
    let mut elsewhere = estimate_packet(now, &estimate(1, 11, vessel(now - 0.02)));
    elsewhere.value.sender = Sender::Vessel(2);
    let faults = [
        (long, RejectionReason::Oversized),
        (short, RejectionReason::Malformed),
        (elsewhere, RejectionReason::Sender),
        (
            edit(&|m| m.header.version = message_version() ^ 1),
            RejectionReason::Version,
        ),
        (edit(&|m| m.header.vessel = 2), RejectionReason::Vessel),
        (edit(&|m| m.header.drone = 77), RejectionReason::Drone),
        (
            edit(&|m| {
                m.header.boot = 2;
                m.header.at = vessel(now - 0.5);
            }),
            RejectionReason::Boot,
        ),
        (edit(&|m| m.header.sequence = 10), RejectionReason::Duplicate),
        (edit(&|m| m.header.sequence = 9), RejectionReason::OutOfOrder),
        (edit(&|m| m.header.at = vessel(now - 1.2)), RejectionReason::Stale),
        (
            edit(&|m| m.header.at = vessel(now + 0.2)),
            RejectionReason::Future,
        ),
        (edit(&|m| m.eta[2] = f64::NAN), RejectionReason::OutOfRange),
        (edit(&|m| m.eta_dot[0] = 1e6), RejectionReason::OutOfRange),
    ];
    for (p, reason) in faults {
        let before = b.rejections().of(reason);
        let out = step(&mut b, now, vec![p]);
        assert!(out.estimate.is_none(), "{reason:?}");
        assert_eq!(b.rejections().of(reason), before + 1, "{reason:?}");
    }
    let unasked = TimeReply::<VesselClock, DroneClock> {
        header: Header::new(1, 1, 1, 99, vessel(now)),
        requested_at: drone(now - 0.123),
        received_at: vessel(now),
    };
    step(&mut b, now, vec![packet(now, RadioTopic::TimeReply, &unasked)]);
    assert_eq!(b.rejections().of(RejectionReason::Unsolicited), 1);
}

#[test]
fn bridge_restarted_vessel() {
    let (mut b, now) = converged(5);
    let old = estimate(1, 500, vessel(now - 0.2));
    assert!(admitted(&mut b, now, &old).is_some());
    assert!(admitted(&mut b, now, &estimate(2, 0, vessel(now - 0.05))).is_none());
    let now = now + 0.6;
    assert!(admitted(&mut b, now, &estimate(2, 17, vessel(now - 0.05))).is_some());
    let late = estimate(1, 501, vessel(now - 0.01));
    assert!(admitted(&mut b, now, &late).is_none());
    assert_eq!(b.rejections().of(RejectionReason::Boot), 2);
    assert_eq!(b.second_sender(drone(now)), None);
}

/// Runs two computers publishing as vessel 1 for `seconds`: the current computer (boot 1) except during `outage`, s
/// since the start, and another (boot 2) from 0.2 s on, which replies in a tenth of the time and has the later clock.
/// Returns the boots whose estimates were admitted.
fn next_to_a_second_computer(
    b: &mut Bridge,
    start: f64,
    seconds: f64,
    outage: core::ops::Range<f64>,
) -> Vec<(f64, u32)> {
    let ahead = 5.0;
    let mut replies = Vec::new();
    let mut passed = Vec::new();
    for k in 0..(100.0 * seconds) as u32 {
        let since = 0.01 * f64::from(k);
        let now = start + since;
        let (arrived, rest): (Vec<_>, Vec<_>) = replies.into_iter().partition(|(t, _)| *t <= now);
        replies = rest;
        let mut packets: Vec<_> = arrived
            .iter()
            .map(|(_, r): &(f64, TimeReply<VesselClock, DroneClock>)| packet(now, RadioTopic::TimeReply, r))
            .collect();
        let speaks = [!outage.contains(&since), since >= 0.2];
        let senders = [(1, now), (2, now + ahead)]
            .into_iter()
            .zip(speaks)
            .filter(|(_, s)| *s);
        for ((boot, at), _) in senders.clone().filter(|_| k % 3 == 0) {
            let m = estimate(boot, 1000 + k, vessel(at - 0.01));
            packets.push(estimate_packet(now, &m));
        }
        let out = step(b, now, packets);
        passed.extend(out.estimate.map(|e| (since, e.header.boot)));
        for ((boot, at), _) in senders.filter(|_| out.time_request.is_some()) {
            let delay = if boot == 1 { 0.1 } else { 0.01 };
            let mut r = reply(&out.time_request.unwrap(), boot, at + delay);
            r.header.at = vessel(at + delay);
            r.received_at = vessel(at + delay);
            replies.push((now + 2.0 * delay, r));
        }
    }
    passed
}

#[test]
fn second_computer_with_the_vessels_identity() {
    let (mut b, now) = converged(5);
    let before = b.offset(drone(now)).unwrap().offset_s;
    let passed = next_to_a_second_computer(&mut b, now, 20.0, 100.0..100.0);
    assert!(passed.len() > 500 && passed.iter().all(|(_, boot)| *boot == 1));
    let after = b.offset(drone(now + 20.0)).unwrap().offset_s;
    assert!((after - before).abs() < 0.01, "{before} {after}");
    assert_eq!(b.second_sender(drone(now + 20.0)), Some(2));
    assert!(b.rejections().of(RejectionReason::SecondSender) > 500);
    assert_eq!(b.rejections().of(RejectionReason::Unsolicited), 0);
    let link = step(&mut b, now + 20.1, vec![]).link.unwrap();
    assert_eq!(link.second_sender, Some(2));
    // It remains the second computer during a radio outage of the current one, even one as long as a descent.
    let (mut b, now) = converged(5);
    let passed = next_to_a_second_computer(&mut b, now, 50.0, 1.0..45.0);
    assert!(passed.iter().all(|(_, boot)| *boot == 1));
    assert!(passed.iter().any(|(t, _)| *t > 45.0));
    // After a permanent outage, the second computer takes over the identity.
    let (mut b, now) = converged(5);
    let passed = next_to_a_second_computer(&mut b, now, 70.0, 1.0..100.0);
    let first = passed.iter().find(|(_, boot)| *boot == 2).unwrap().0;
    assert!((61.0..62.0).contains(&first), "{first}");
}

#[test]
fn second_computer_first_received_in_an_outage() {
    let (mut b, now) = converged(5);
    // The second computer counts as a restart of the vessel until the current computer replies.
    let passed = next_to_a_second_computer(&mut b, now, 10.0, 0.1..3.0);
    assert!(passed.iter().any(|(_, boot)| *boot == 2));
    assert!(
        passed.iter().all(|(t, boot)| *t < 4.0 || *boot == 1),
        "{passed:?}"
    );
    assert_eq!(b.second_sender(drone(now + 10.0)), Some(2));
}

#[test]
fn abort_through_a_second_computer() {
    let (mut b, now) = converged(5);
    assert!(admitted(&mut b, now, &estimate(1, 1, vessel(now - 0.05))).is_some());
    let order = |kind, sequence| OperatorCommand::<VesselClock> {
        header: Header::new(1, 1, 2, sequence, vessel(now)),
        kind,
    };
    for (kind, counts) in [
        (CommandKind::Land, 0),
        (CommandKind::Abort, 1),
        (CommandKind::Hold, 0),
    ] {
        let out = step(
            &mut b,
            now,
            vec![packet(now, RadioTopic::Command, &order(kind, 5))],
        );
        assert_eq!(out.commands.len(), counts, "{kind:?}");
    }
}

#[test]
fn bridge_restarted_vessel_with_earlier_clock() {
    let (mut b, now) = converged(5);
    // A vessel that restarts with its clock 100 s behind.
    let behind = |s: f64| vessel(s - 100.0);
    let e = |seq: u32, s: f64| estimate(2, seq, behind(s - 0.05));
    assert!(admitted(&mut b, now, &estimate(1, 1, vessel(now - 0.05))).is_some());
    assert!(admitted(&mut b, now, &e(0, now)).is_none());
    // The restarted computer is accepted when it replies to a request and its predecessor is silent.
    let mut t = now + 0.6;
    let q = loop {
        t += 0.01;
        if let Some(q) = step(&mut b, t, vec![]).time_request {
            break q;
        }
    };
    let mut r = reply(&q, 2, t + 0.05);
    r.header.at = behind(t + 0.05);
    r.received_at = behind(t + 0.05);
    t += 0.1;
    step(&mut b, t, vec![packet(t, RadioTopic::TimeReply, &r)]);
    let now_dated = admitted(&mut b, t, &e(1, t)).unwrap();
    assert!((now_dated.header.at.secs() - (t - 0.05)).abs() < 0.01);
}

#[test]
fn bridge_link_state_at_10_hz() {
    let (mut b, start) = converged(5);
    let mut links = Vec::new();
    for k in 0..300_u32 {
        let now = start + 0.01 * f64::from(k);
        // Estimates at 25 Hz, of which every fifth is lost; silence after 2 s.
        let sent = k % 4 == 0 && now < start + 2.0;
        let seq = k / 4;
        let m = estimate(1, seq, vessel(now - 0.06));
        let received = (sent && seq % 5 != 4).then(|| estimate_packet(now, &m));
        let out = step(&mut b, now, received.into_iter().collect());
        links.extend(out.link.map(|l| (now, l)));
    }
    assert!((28..=32).contains(&links.len()), "{}", links.len());
    let (_, mid) = links.iter().rfind(|(t, _)| *t < start + 2.0).unwrap();
    assert!((mid.loss - 0.2).abs() < 0.05, "{}", mid.loss);
    assert!((mid.latency_p50_s - 0.06).abs() < 0.002, "{}", mid.latency_p50_s);
    let (_, last) = links.last().unwrap();
    assert!((0.9..1.3).contains(&last.age_s), "{}", last.age_s);
    last.check().unwrap();
}

fn uniform(k: u32) -> f64 {
    f64::from(k.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn clock_offset_sd_with_arbitrary_delays(
        there in 0.0..0.2f64, back in 0.0..0.2f64, jitter in 0.0..0.1f64, seed in any::<u32>(),
    ) {
        let noise = |k: u32| jitter * uniform(seed.wrapping_add(k));
        let (b, now) = exchanged(10, |k| (there + noise(2 * k), back + noise(2 * k + 1)));
        let o = b.offset(drone(now)).unwrap();
        prop_assert!((o.offset_s - OFFSET).abs() <= 2.0 * o.sd_s);
    }

    #[test]
    fn bridge_random_bytes(
        bytes in prop::collection::vec(any::<u8>(), 0..600), kind in 0..4usize,
    ) {
        let (mut b, now) = converged(1);
        let kind = [RadioTopic::Estimate, RadioTopic::Wave, RadioTopic::Prediction, RadioTopic::TimeReply][kind];
        let out = step(&mut b, now, vec![Stamped::new(drone(now), Packet {
                kind,
                sender: Sender::Vessel(1),
                bytes,
            })]);
        prop_assert!(out.estimate.is_none() && out.wave.is_none() && out.prediction.is_none());
        prop_assert_eq!(b.rejections().total(), 1);
    }

    #[test]
    fn bridge_damaged_estimates(
        cut in 0..300usize, flip in 0..2000usize, which in 0..2u8,
    ) {
        let (mut b, now) = converged(1);
        let mut p = estimate_packet(now, &estimate(1, 0, vessel(now - 0.05)));
        let n = p.value.bytes.len();
        if which == 0 {
            p.value.bytes.truncate(cut % n);
        } else {
            p.value.bytes[(flip / 8) % n] ^= 1 << (flip % 8);
        }
        let out = step(&mut b, now, vec![p]);
        match out.estimate {
            Some(e) => prop_assert!(e.check().is_ok() && which == 1),
            None => prop_assert_eq!(b.rejections().total(), 1),
        }
    }

    #[test]
    fn bridge_estimates_in_any_order(order in Just((0..40u32).collect::<Vec<_>>()).prop_shuffle()) {
        let (mut b, start) = converged(1);
        let mut newest: Option<(u32, DroneTime)> = None;
        let mut passed = 0;
        let mut sent = 0;
        for (k, seq) in order.iter().enumerate() {
            let now = start + 0.5 + 0.002 * k as f64;
            let m = estimate(1, *seq, vessel(start + 0.01 * f64::from(*seq)));
            let p = estimate_packet(now, &m);
            sent += 2;
            if let Some(e) = step(&mut b, now, vec![p.clone(), p]).estimate {
                passed += 1;
                if let Some((s, at)) = newest {
                    prop_assert!(e.header.sequence > s && e.header.at > at - Span::from_millis(1));
                }
                newest = Some((e.header.sequence, e.header.at));
            }
        }
        prop_assert_eq!(newest.map(|n| n.0), Some(39));
        prop_assert_eq!(b.rejections().total(), sent - passed);
    }

    #[test]
    fn bridge_extreme_time_stamps(at in any::<i64>(), t2 in any::<i64>(), t3 in any::<i64>()) {
        let mut b = bridge();
        let q = step(&mut b, 0.0, vec![]).time_request.unwrap();
        let r = TimeReply::<VesselClock, DroneClock> {
            header: Header::new(1, 1, 1, 0, Time::from_nanos(t3)),
            requested_at: q.header.at,
            received_at: Time::from_nanos(t2),
        };
        let e = estimate(1, 0, Time::from_nanos(at));
        let out = step(&mut b, 0.1, vec![
            packet(0.1, RadioTopic::TimeReply, &r),
            estimate_packet(0.1, &e),
        ]);
        if let Some(e) = out.estimate {
            prop_assert!((e.header.at.secs() - 0.1).abs() < 1.2);
        }
        if let Some(o) = b.offset(drone(0.1)) {
            prop_assert!(o.offset_s.is_finite() && o.sd_s <= 1.2);
        }
    }
}

/// The status is assembled from the newest reports twice a second, once the mission publishes.
#[test]
fn status_of_the_drone() {
    let mut b = bridge().disarmed_within(2.0);
    let at = |s| Header::new(1, 1, 3, 1, drone(s));
    let mut step = |s: f64, mission, autopilot| {
        let input = BridgeIn {
            mission,
            autopilot,
            ..BridgeIn::default()
        };
        b.step(drone(s), &input).status
    };
    let armed = AutopilotState {
        header: at(1.0),
        armed: true,
        ..AutopilotState::default()
    };
    assert_eq!(step(1.0, None, Some(armed)), None);
    let landed = MissionState {
        header: at(1.1),
        state: State::Landed,
        since: drone(1.1),
        ..MissionState::default()
    };
    let first = step(1.1, Some(landed), None).unwrap();
    assert_eq!(
        (first.state, first.armed, first.still_armed_s),
        (State::Landed, true, None)
    );
    assert_eq!(step(1.5, None, None), None);
    let later = (2..8).filter_map(|k| step(1.1 + 0.5 * f64::from(k), None, None));
    let later: Vec<_> = later.collect();
    assert_eq!(later.len(), 6);
    assert!(
        later
            .last()
            .is_some_and(|s| s.still_armed_s.is_some_and(|s| s > 2.0) && !s.is_current())
    );
}

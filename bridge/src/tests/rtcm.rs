//! RTCM 3 frames that are lost, repeated, late or damaged on the radio.

use super::*;
use alight_shared::msg::RtcmFrames;

#[test]
fn rtcm_frames_over_a_lossy_radio() {
    // Example of message 1005 in RTCM 10403.3.
    let example = [
        0xD3, 0x00, 0x13, 0x3E, 0xD7, 0xD3, 0x02, 0x02, 0x98, 0x0E, 0xDE, 0xEF, 0x34, 0xB4, 0xBD, 0x62, 0xAC,
        0x09, 0x41, 0x98, 0x6F, 0x33, 0x36, 0x0B, 0x98,
    ];
    let (mut b, start) = converged(5);
    let frame = |k: u32, now: f64| RtcmFrames::<VesselClock> {
        header: Header::new(1, 0, 1, k, vessel(now - 0.05)),
        antenna_m: [1.0, 2.0, -3.0],
        bytes: Seq::filled(example),
    };
    let mut received = Vec::new();
    let mut late = None;
    for k in 1..=100_u32 {
        let now = start + 0.02 * f64::from(k);
        let sent = packet(now, RadioTopic::Rtcm, &frame(k, now));
        let arrived = match k % 20 {
            7 => vec![],
            8 => vec![sent.clone(), sent],
            9 => {
                late = Some(sent);
                vec![]
            }
            10 => [sent].into_iter().chain(late.take()).collect(),
            _ => vec![sent],
        };
        received.extend(step(&mut b, now, arrived).rtcm);
    }
    let in_order = (1..=100).filter(|k| k % 20 != 7);
    let overtaken = |k: u32| match k % 20 {
        9 => k + 1,
        10 => k - 1,
        _ => k,
    };
    let expected: Vec<u32> = in_order.map(overtaken).collect();
    let sequences: Vec<u32> = received.iter().map(|f| f.header.sequence).collect();
    assert_eq!(sequences, expected);
    assert!(
        received
            .iter()
            .all(|f| *f.bytes == example && f.antenna_m == [1.0, 2.0, -3.0])
    );
    let rejected = [RejectionReason::Duplicate, RejectionReason::OutOfOrder].map(|r| b.rejections().of(r));
    assert_eq!(rejected, [5, 0]);
    let mut damaged = frame(101, start + 2.02);
    damaged.bytes[9] ^= 1;
    let out = step(
        &mut b,
        start + 2.02,
        vec![packet(start + 2.02, RadioTopic::Rtcm, &damaged)],
    );
    assert!(out.rtcm.is_empty() && b.rejections().of(RejectionReason::OutOfRange) == 1);
}

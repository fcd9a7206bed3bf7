//! The drone's own GNSS receiver with the vessel's receiver as moving base: UBX NAV-RELPOSNED of a u-blox F9 with
//! firmware 1.13 or later.
//!
//! A message needs a valid checksum. Reports carry the receiver's time of week; the moving base dates them. NAV-PVT
//! does not wait for the base and arrives with the smallest delay, so it dates a NAV-RELPOSNED that the radio has
//! delayed.

use std::collections::VecDeque;

use alight_shared::msg::CarrierSolution;
use serde::{Deserialize, Serialize};
use ublox::{
    FixedBuffer, Parser, UbxPacket,
    proto27::{PacketRef, Proto27},
};

/// Buffer for an unfinished message, bytes: exceeds the longest message decoded.
const MAX_WAITING: usize = 2048;
const PART: usize = 512;
/// Queue length: more reports than a receiver sends in a second.
const MAX_REPORTS: usize = 32;
pub const WEEK_NS: i64 = 7 * 86_400_000_000_000;
/// Maximum standard deviation, m; it marks an unknown position.
pub const MAX_SD_M: f64 = 9_999.0;

/// Receiver report: position relative to the base, or only the receiver's time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RelativeReport {
    pub of_week_ns: i64,
    /// Base station number; None if the report contains only the receiver's time.
    pub station: Option<u16>,
    /// Position of the drone's antenna relative to the base's, NED, m, and the standard deviation of each component, m;
    /// None if invalid.
    pub place: Option<[[f64; 3]; 2]>,
    /// Carrier ambiguity solution; None if the report contains only the receiver's time.
    pub solution: Option<CarrierSolution>,
    /// The receiver takes its base for a moving one, as the vessel's is.
    pub is_moving_base: bool,
}

impl RelativeReport {
    /// Distance to a base that does not move, m.
    pub fn fixed_base_m(&self) -> Option<f64> {
        let [[north, east, down], _] = self.place?;
        if self.is_moving_base {
            None
        } else {
            Some(north.hypot(east).hypot(down))
        }
    }
}

pub struct ReceiverDecoder {
    parser: Parser<FixedBuffer<MAX_WAITING>, Proto27>,
    reports: VecDeque<RelativeReport>,
}

impl Default for ReceiverDecoder {
    fn default() -> Self {
        ReceiverDecoder {
            parser: Parser::with_fixed_buffer(),
            reports: VecDeque::default(),
        }
    }
}

impl ReceiverDecoder {
    /// Decodes bytes; when the queue is full, the oldest report is dropped.
    pub fn push(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(PART) {
            let mut packets = self.parser.consume_ubx(part);
            while let Some(packet) = packets.next() {
                let Ok(UbxPacket::Proto27(packet)) = packet else {
                    continue;
                };
                if let Some(report) = report(&packet) {
                    if self.reports.len() == MAX_REPORTS {
                        self.reports.pop_front();
                    }
                    self.reports.push_back(report);
                }
            }
        }
    }
    pub fn next_report(&mut self) -> Option<RelativeReport> {
        self.reports.pop_front()
    }
}

/// Lower bound on the standard deviation of a solution, m: receivers understate errors due to multipath and wrong float
/// solutions.
const fn min_sd_m(solution: CarrierSolution) -> f64 {
    match solution {
        CarrierSolution::Fixed => 0.01,
        CarrierSolution::Float => 0.2,
        CarrierSolution::None => 2.0,
    }
}

/// Report in a message; None for other messages and for a time of week out of range.
fn report(packet: &PacketRef<'_>) -> Option<RelativeReport> {
    /// gnssFixOK, relPosValid.
    const VALID: u32 = 1 | 1 << 2;
    /// refPosMiss, refObsMiss: the base's position or observations are extrapolated, with decimetres of error if the
    /// base rocks.
    const EXTRAPOLATED: u32 = 1 << 6 | 1 << 7;
    /// isMoving.
    const MOVING: u32 = 1 << 5;
    let (of_week_ms, place, solution) = match packet {
        PacketRef::NavPvt(p) => (p.itow(), None, None),
        PacketRef::NavRelPosNed(p) if p.flags_raw() & EXTRAPOLATED != 0 => (p.itow(), None, None),
        PacketRef::NavRelPosNed(p) => {
            let flags = p.flags_raw();
            let valid = flags & VALID == VALID;
            // Carrier solution: 0 none, 1 float, 2 fixed; 3 is reserved.
            let solution = match (flags >> 3) & 3 {
                2 if valid => CarrierSolution::Fixed,
                1 if valid => CarrierSolution::Float,
                _ => CarrierSolution::None,
            };
            let metres = |cm: f64, mm: f64| 1e-2 * cm + 1e-3 * mm;
            let baseline_m = [
                metres(p.rel_pos_n_cm(), p.rel_pos_hp_n_mm()),
                metres(p.rel_pos_e_cm(), p.rel_pos_hp_e_mm()),
                metres(p.rel_pos_d_cm(), p.rel_pos_hp_d_mm()),
            ];
            let sd_m = [p.acc_n_mm(), p.acc_e_mm(), p.acc_d_mm()]
                .map(|mm| (1e-3 * mm).clamp(min_sd_m(solution), MAX_SD_M));
            (p.itow(), valid.then_some([baseline_m, sd_m]), Some(solution))
        }
        _ => return None,
    };
    let of_week_ns = i64::from(of_week_ms) * 1_000_000;
    let (station, is_moving_base) = match packet {
        PacketRef::NavRelPosNed(p) => (Some(p.ref_station_id()), p.flags_raw() & MOVING != 0),
        _ => (None, false),
    };
    (of_week_ns < WEEK_NS).then_some(RelativeReport {
        of_week_ns,
        station,
        place,
        solution,
        is_moving_base,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// NAV-RELPOSNED version 1 at 12.3457 m, -0.501 m and 3 m, with these flags and its checksum (Fletcher, from class
    /// to payload).
    fn message(of_week_ms: u32, flags: u32) -> Vec<u8> {
        let mut payload = [0; 64];
        let mut put = |at: usize, bytes: &[u8]| payload[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &[1]);
        put(4, &of_week_ms.to_le_bytes());
        put(8, &1234_i32.to_le_bytes());
        put(12, &(-50_i32).to_le_bytes());
        put(16, &300_i32.to_le_bytes());
        // High-precision parts of the position: 5.7 mm, -1.0 mm, 0.
        put(32, &[57, (-10_i8) as u8, 0]);
        // Standard deviations: 12.3 mm, 5 mm, 400 mm.
        put(36, &123_u32.to_le_bytes());
        put(40, &50_u32.to_le_bytes());
        put(44, &4000_u32.to_le_bytes());
        put(60, &flags.to_le_bytes());
        let body = [&[0x01, 0x3c, 64, 0][..], &payload].concat();
        let (a, b) = body.iter().fold((0_u8, 0_u8), |(a, b), x| {
            let a = a.wrapping_add(*x);
            (a, b.wrapping_add(a))
        });
        [&[0xb5, 0x62][..], &body, &[a, b]].concat()
    }
    fn decoded(bytes: &[u8], cut: usize) -> Vec<RelativeReport> {
        let mut decoder = ReceiverDecoder::default();
        for part in bytes.chunks(cut) {
            decoder.push(part);
        }
        core::iter::from_fn(|| decoder.next_report()).collect()
    }

    fn valid(solution: u32) -> u32 {
        0b101 | solution << 3
    }

    #[test]
    fn relative_places_of_each_solution() {
        for (flags, solution, sd, base_m) in [
            (
                valid(2),
                CarrierSolution::Fixed,
                [0.0123, 0.01, 0.4],
                Some(12.715),
            ),
            // The base is moving.
            (
                valid(2) | 1 << 5,
                CarrierSolution::Fixed,
                [0.0123, 0.01, 0.4],
                None,
            ),
            (valid(1), CarrierSolution::Float, [0.2, 0.2, 0.4], Some(12.715)),
            (valid(0), CarrierSolution::None, [2.0; 3], Some(12.715)),
            (valid(3), CarrierSolution::None, [2.0; 3], Some(12.715)),
        ] {
            let [r] = decoded(&message(604_799_999, flags), 7)[..] else {
                panic!("{flags:b}")
            };
            assert_eq!((r.of_week_ns, r.solution), (604_799_999_000_000, Some(solution)));
            assert_eq!(r.fixed_base_m().map(|m| (1e3 * m).round() * 1e-3), base_m);
            let [baseline, stated] = r.place.unwrap();
            let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(
                near(baseline, [12.3457, -0.501, 3.0]) && near(stated, sd),
                "{r:?}"
            );
        }
        // Without a fix or a relative position only the solution's state is used.
        for flags in [valid(2) & !1, valid(2) & !4] {
            let [r] = decoded(&message(1, flags), 64)[..] else {
                panic!("{flags:b}")
            };
            assert_eq!((r.place, r.solution), (None, Some(CarrierSolution::None)));
        }
        // If the base is extrapolated, only the time is used.
        for flags in [valid(2) | 1 << 6, valid(2) | 1 << 7] {
            let [r] = decoded(&message(1, flags), 64)[..] else {
                panic!("{flags:b}")
            };
            assert_eq!((r.of_week_ns, r.place, r.solution), (1_000_000, None, None));
        }
    }

    #[test]
    fn relative_places_among_other_bytes() {
        let sound = message(200, valid(2));
        let mut damaged = sound.clone();
        damaged[20] ^= 1;
        // The bytes contain an RTCM preamble, an NMEA sentence, a damaged message, and a message with a time of week
        // out of range.
        let bytes = [
            &b"\xd3\x00\x13$GNGGA,1*00\r\n"[..],
            &damaged,
            &message(604_800_000, valid(2)),
            &sound,
        ]
        .concat();
        for cut in [1, 5, 4096] {
            let times: Vec<_> = decoded(&bytes, cut).iter().map(|r| r.of_week_ns).collect();
            assert_eq!(times, [200_000_000], "{cut}");
        }
        // The queue is bounded and keeps the newest reports.
        let many: Vec<u8> = (0..100).flat_map(|k| message(k, valid(2))).collect();
        let all = decoded(&many, 512);
        assert_eq!((all.len(), all[0].of_week_ns), (MAX_REPORTS, 68_000_000));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_of_a_receiver(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
            let mut decoder = ReceiverDecoder::default();
            decoder.push(&bytes);
            prop_assert!(decoder.reports.len() <= MAX_REPORTS);
        }
    }
}

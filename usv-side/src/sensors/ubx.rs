//! UBX of u-blox: NAV-PVT to a fix, NAV-RELPOSNED of a moving base to a heading. TIM-TP announces the time of the
//! next pulse. Its edge is not observed, so it gives no measurement a time; it shows whether pulse and fixes use
//! one time base, on which a computer that takes its clock from the pulse relies.

use alight_shared::geodesy::Datum;
use alight_shared::msg::{HeadingFix, NOT_MEASURED_SD};
use ublox::proto27::{PacketRef, Proto27};
use ublox::{FixedBuffer, GnssFixType, Parser, UbxPacket};

use super::clock::Rollover;
use super::{Decoded, Decoder, Measurement, Mounting, SourceMeasurement};

/// Longest unfinished message, bytes: above the longest message that is used.
const MAX_WAITING: usize = 2048;
/// Bytes given to the parser at a time.
const PART: usize = 512;
const WEEK_NS: i64 = 7 * 86_400_000_000_000;
/// An announced pulse comes within its period of 1 s (the receivers' default) after the last fix; a message in
/// between may be late by as much. UTC and GPS time are whole seconds apart, 18 since 2017.
const PULSE_NS: i64 = 2_000_000_000;
/// Fraction of a receiver's stated error that changes within a minute (ours).
const FAST_FRACTION: f64 = 0.3;

/// Decodes UBX.
pub struct UbxDecoder {
    mounting: Mounting,
    parser: Parser<FixedBuffer<MAX_WAITING>, Proto27>,
    decoded: Decoded,
    week: Rollover<WEEK_NS>,
}

/// The content of a message.
enum Content {
    /// Valid or not.
    Measurement(Option<Measurement>),
    Pulse,
}

impl UbxDecoder {
    /// For a source with this mounting.
    pub fn new(mounting: &Mounting) -> Self {
        UbxDecoder {
            mounting: mounting.clone(),
            parser: Parser::with_fixed_buffer(),
            decoded: Decoded::default(),
            week: Rollover::default(),
        }
    }

    /// Takes the content of a message with its time of week, ms.
    fn take(&mut self, of_week_ms: u32, content: Content, out: &mut Vec<SourceMeasurement>) {
        let of_week = i64::from(of_week_ms) * 1_000_000;
        if of_week >= WEEK_NS {
            self.decoded.corrupted += 1;
            return;
        }
        self.decoded.good += 1;
        match content {
            Content::Measurement(measurement) => {
                let at_ns = self.week.unwrap(of_week);
                out.extend(measurement.map(|m| SourceMeasurement::new(at_ns, m)));
            }
            Content::Pulse => {
                self.decoded.pulses += 1;
                let apart = self
                    .week
                    .last
                    .is_some_and(|last| after(of_week, last).abs() > PULSE_NS);
                self.decoded.mismatched_pulses += u64::from(apart);
            }
        }
    }
}

impl Decoder for UbxDecoder {
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for part in bytes.chunks(PART) {
            let mut all = Vec::new();
            let mut packets = self.parser.consume_ubx(part);
            while let Some(packet) = packets.next() {
                match packet {
                    Ok(UbxPacket::Proto27(p)) => match content(&p, &self.mounting) {
                        Some(message) => all.push(message),
                        None => self.decoded.ignored += 1,
                    },
                    Err(_) => self.decoded.corrupted += 1,
                }
            }
            drop(packets);
            for (of_week_ms, content) in all {
                self.take(of_week_ms, content, out);
            }
        }
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
}

/// Time from one time of week to another, ns, by the shorter way round the week.
fn after(of_week_ns: i64, than_ns: i64) -> i64 {
    (of_week_ns - than_ns + WEEK_NS / 2).rem_euclid(WEEK_NS) - WEEK_NS / 2
}

/// Time of week, ms, and content of a message of a kind that is used.
fn content(packet: &PacketRef<'_>, mounting: &Mounting) -> Option<(u32, Content)> {
    Some(match packet {
        PacketRef::NavPvt(p) => {
            let kind = p.fix_type();
            let three = matches!(kind, GnssFixType::Fix3D | GnssFixType::GPSPlusDeadReckoning);
            // gnssFixOK.
            let valid = p.flags_raw() & 1 != 0;
            let fix = (valid && (three || matches!(kind, GnssFixType::Fix2D))).then(|| {
                let across = (FAST_FRACTION * p.horizontal_accuracy()).max(0.005);
                let down = (FAST_FRACTION * p.vertical_accuracy()).max(0.005);
                let velocity_sd = p.speed_accuracy().clamp(0.02, 100.0);
                let datum = Datum::new(p.latitude(), p.longitude(), p.height_above_ellipsoid());
                let velocity = [p.vel_north(), p.vel_east(), p.vel_down()];
                let down = if three { down } else { NOT_MEASURED_SD };
                mounting.fix(datum, velocity, [across, across, down], [velocity_sd; 3])
            });
            (p.itow(), Content::Measurement(fix.map(Measurement::Gnss)))
        }
        PacketRef::NavRelPosNed(p) => {
            // relPosHeadingValid (interface description of the F9 receivers).
            let valid = p.flags_raw() & (1 << 8) != 0;
            let heading = valid.then(|| HeadingFix {
                heading_sd: p.acc_heading_degrees().to_radians().clamp(1e-3, 1.0),
                ..mounting.heading_fix(mounting.heading(p.rel_pos_heading_degrees().to_radians()))
            });
            (p.itow(), Content::Measurement(heading.map(Measurement::Heading)))
        }
        PacketRef::TimTp(p) => (p.tow_ms(), Content::Pulse),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{self, damage, damaged};
    use crate::sensors::Mount;
    use proptest::prelude::*;

    /// A message with its checksum (Fletcher's, over class to payload).
    fn message(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
        let body = [&[class, id][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
        let (a, b) = body.iter().fold((0_u8, 0_u8), |(a, b), x| {
            let a = a.wrapping_add(*x);
            (a, b.wrapping_add(a))
        });
        [&[0xb5, 0x62][..], &body, &[a, b]].concat()
    }
    fn put(payload: &mut [u8], at: usize, bytes: &[u8]) {
        payload[at..at + bytes.len()].copy_from_slice(bytes);
    }
    fn pvt(tow_ms: u32) -> Vec<u8> {
        let mut p = [0; 92];
        put(&mut p, 0, &tow_ms.to_le_bytes());
        (p[20], p[21]) = (3, 1);
        put(&mut p, 24, &145_000_000_i32.to_le_bytes());
        put(&mut p, 28, &500_000_000_i32.to_le_bytes());
        put(&mut p, 32, &255_000_i32.to_le_bytes());
        put(&mut p, 40, &1000_u32.to_le_bytes());
        put(&mut p, 44, &2000_u32.to_le_bytes());
        put(&mut p, 52, &(-1500_i32).to_le_bytes());
        put(&mut p, 68, &100_u32.to_le_bytes());
        message(1, 7, &p)
    }
    fn pulse(tow_ms: u32) -> Vec<u8> {
        let mut p = [0; 16];
        put(&mut p, 0, &tow_ms.to_le_bytes());
        message(0x0d, 1, &p)
    }
    fn relative(tow_ms: u32, valid: bool) -> Vec<u8> {
        let mut p = [0; 64];
        p[0] = 1;
        put(&mut p, 4, &tow_ms.to_le_bytes());
        put(&mut p, 24, &9_000_000_i32.to_le_bytes());
        put(&mut p, 52, &50_000_u32.to_le_bytes());
        put(&mut p, 60, &(0b111_u32 | u32::from(valid) << 8).to_le_bytes());
        message(1, 0x3c, &p)
    }
    fn decode(bytes: &[u8], cut: usize) -> (Vec<SourceMeasurement>, UbxDecoder) {
        let mount = Mount {
            heading_offset_deg: 90.0,
            ..Mount::default()
        };
        fixtures::decode(UbxDecoder::new(&Mounting::new(&mount)), bytes, cut)
    }

    #[test]
    fn ubx_moving_base() {
        let week_ms = 604_800_000;
        let bytes = [
            pvt(week_ms - 200),
            relative(week_ms - 200, true),
            pulse(0),
            message(1, 0x35, &[0; 8]),
            relative(0, false),
            pvt(0),
        ]
        .concat();
        let (all, d) = decode(&bytes, 7);
        let n = d.decoded();
        assert_eq!((n.good, n.corrupted, n.pulses, n.mismatched_pulses), (5, 0, 1, 0));
        let times: Vec<i64> = all.iter().map(|h| h.at_ns - all[0].at_ns).collect();
        assert_eq!(times, [0, 0, 200_000_000], "a new week");
        let (Measurement::Gnss(g), Measurement::Heading(h)) = (all[0].measurement, all[1].measurement) else {
            panic!("{all:?}");
        };
        assert!((g.datum.latitude_deg - 50.0).abs() < 1e-9 && (g.datum.height_m - 255.0).abs() < 1e-9);
        assert!((g.velocity[1] + 1.5).abs() < 1e-9 && (g.position_sd[0] - 0.3).abs() < 1e-9);
        assert!(h.heading.abs() < 1e-9 && (h.heading_sd - 0.5_f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn ubx_pulse_of_another_time_base() {
        let before_any_fix = pulse(77_000);
        // The next second; the one that just passed, late; the next one of UTC, 18 s behind; a new week.
        let bytes = [
            before_any_fix,
            pvt(20_200),
            pulse(21_000),
            pulse(19_000),
            pulse(3_000),
            pvt(604_799_800),
            pulse(0),
            message(0x0d, 1, &u32::MAX.to_le_bytes().repeat(4)),
        ]
        .concat();
        let (_, d) = decode(&bytes, 9);
        let n = d.decoded();
        assert_eq!((n.pulses, n.mismatched_pulses, n.corrupted), (5, 1, 1));
    }

    #[test]
    fn ubx_messages_after_damage() {
        let mut bad = pvt(1000);
        bad[40] ^= 1;
        let cut = &pvt(2000)[..60];
        let bytes = [&bad[..], &pvt(3000), cut, &pvt(4000), b"$GPGGA,noise", &pvt(5000)].concat();
        let (all, d) = decode(&bytes, 64);
        assert!(d.decoded().corrupted >= 2, "{:?}", d.decoded());
        assert!(
            all.len() >= 2 && all.iter().any(|h| h.at_ns == 5_000_000_000),
            "{all:?}"
        );
    }

    proptest! {
        #[test]
        fn ubx_arbitrary_damage(
            damage in damage(60), noise in prop::collection::vec(any::<u8>(), 0..600), cut in 1_usize..700,
        ) {
            let whole = (0..10).flat_map(|k| [pvt(200 * k), relative(200 * k, true)].concat()).collect();
            let bytes = [damaged(whole, damage), noise].concat();
            let (all, _) = decode(&bytes, cut);
            prop_assert!(all.len() <= 40);
        }
    }
}

//! u-blox's UBX: NAV-PVT to a fix, NAV-RELPOSNED of a moving base to a heading. TIM-TP announces the
//! time of the next pulse. Without the pulse's edge it dates nothing; it tells whether pulse and fixes
//! count the same time, which is what a computer that takes its clock from the pulse relies on.

use alight_shared::frames::Datum;
use alight_shared::msg::{GnssFix, HeadingFix, NOT_MEASURED_SD};
use ublox::proto27::{PacketRef, Proto27};
use ublox::{FixedBuffer, GnssFixType, Parser, UbxPacket};

use super::{Decoded, Measurement, Mounting, SourceMeasurement};

/// Bytes that wait for their end, at most: above the longest message that is used.
const MAX_WAITING: usize = 2048;
/// Bytes given to the parser at a time.
const PART: usize = 512;
const WEEK_NS: i64 = 7 * 86_400_000_000_000;
/// The pulse that is announced comes within its period of 1 s (the receivers' default) after the fix
/// before; a message in between may be late by as much. UTC and GPS time are whole seconds apart, 18 since 2017.
const PULSE_NS: i64 = 2_000_000_000;
/// What changes within a minute of the error that a receiver tells (ours).
const FAST_SHARE: f64 = 0.3;

/// Bytes to measurements.
pub struct UbxDecoder {
    mounting: Mounting,
    parser: Parser<FixedBuffer<MAX_WAITING>, Proto27>,
    decoded: Decoded,
    week: i64,
    last_ns: Option<i64>,
}

/// What a message says, its time of week in ms first.
enum Said {
    Fix(u32, Option<GnssFix>),
    Heading(u32, Option<HeadingFix>),
    Pulse(u32),
    Other,
}

impl UbxDecoder {
    /// Of a source so mounted.
    pub fn new(mounting: &Mounting) -> Self {
        UbxDecoder {
            mounting: mounting.clone(),
            parser: Parser::with_fixed_buffer(),
            decoded: Decoded::default(),
            week: 0,
            last_ns: None,
        }
    }
    /// What became of what it was given.
    pub fn decoded(&self) -> Decoded {
        self.decoded
    }

    /// Takes bytes, however they are cut.
    pub fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for part in bytes.chunks(PART) {
            let mut all = Vec::new();
            {
                let mut packets = self.parser.consume_ubx(part);
                while let Some(packet) = packets.next() {
                    match packet {
                        Ok(UbxPacket::Proto27(p)) => all.push(said(&p, &self.mounting)),
                        Err(_) => self.decoded.corrupted += 1,
                    }
                }
            }
            for said in all {
                self.take(said, out);
            }
        }
    }

    /// A pulse is announced for this time of week, ms.
    fn pulse(&mut self, of_week_ms: u32) {
        let of_week = i64::from(of_week_ms) * 1_000_000;
        if of_week >= WEEK_NS {
            self.decoded.corrupted += 1;
            return;
        }
        self.decoded.good += 1;
        self.decoded.pulses += 1;
        let apart = self
            .last_ns
            .is_some_and(|last| after(of_week, last).abs() > PULSE_NS);
        self.decoded.mismatched_pulses += u64::from(apart);
    }

    fn take(&mut self, said: Said, out: &mut Vec<SourceMeasurement>) {
        let (of_week_ms, measurement) = match said {
            Said::Fix(t, fix) => (t, fix.map(Measurement::Gnss)),
            Said::Heading(t, heading) => (t, heading.map(Measurement::Heading)),
            Said::Pulse(t) => return self.pulse(t),
            Said::Other => {
                self.decoded.ignored += 1;
                return;
            }
        };
        let of_week = i64::from(of_week_ms) * 1_000_000;
        if of_week >= WEEK_NS {
            self.decoded.corrupted += 1;
            return;
        }
        self.decoded.good += 1;
        // The week is the one that brings the time nearest to the last.
        if let Some(last) = self.last_ns {
            let off = last - (self.week * WEEK_NS + of_week);
            if off > WEEK_NS / 2 {
                self.week += 1;
            } else if off < -WEEK_NS / 2 {
                self.week -= 1;
            }
        }
        let at_ns = self.week * WEEK_NS + of_week;
        self.last_ns = Some(at_ns);
        out.extend(measurement.map(|measurement| SourceMeasurement { at_ns, measurement }));
    }
}

/// What one time of week is after another, ns, by the shorter way round the week.
fn after(of_week_ns: i64, than_ns: i64) -> i64 {
    (of_week_ns - than_ns + WEEK_NS / 2).rem_euclid(WEEK_NS) - WEEK_NS / 2
}

fn said(packet: &PacketRef<'_>, mounting: &Mounting) -> Said {
    match packet {
        PacketRef::NavPvt(p) => {
            let kind = p.fix_type();
            let three = matches!(kind, GnssFixType::Fix3D | GnssFixType::GPSPlusDeadReckoning);
            // gnssFixOK.
            let sound = p.flags_raw() & 1 != 0;
            let fix = (sound && (three || matches!(kind, GnssFixType::Fix2D))).then(|| {
                let across = (FAST_SHARE * p.horizontal_accuracy()).max(0.005);
                let down = (FAST_SHARE * p.vertical_accuracy()).max(0.005);
                let velocity_sd = p.speed_accuracy().clamp(0.02, 100.0);
                GnssFix {
                    datum: Datum {
                        latitude_deg: p.latitude(),
                        longitude_deg: p.longitude(),
                        height_m: p.height_above_ellipsoid(),
                    },
                    velocity: [p.vel_north(), p.vel_east(), p.vel_down()],
                    position_sd: mounting.position_sd([
                        across,
                        across,
                        if three { down } else { NOT_MEASURED_SD },
                    ]),
                    velocity_sd: mounting.velocity_sd([velocity_sd; 3]),
                    lever_arm: Some(mounting.mount.antenna_m),
                    ..GnssFix::default()
                }
            });
            Said::Fix(p.itow(), fix)
        }
        PacketRef::NavRelPosNed(p) => {
            // relPosHeadingValid (interface description of the F9 receivers).
            let valid = p.flags_raw() & (1 << 8) != 0;
            let heading = valid.then(|| HeadingFix {
                heading: mounting.heading(p.rel_pos_heading_degrees().to_radians()),
                heading_sd: p.acc_heading_degrees().to_radians().clamp(1e-3, 1.0),
                ..HeadingFix::default()
            });
            Said::Heading(p.itow(), heading)
        }
        PacketRef::TimTp(p) => Said::Pulse(p.tow_ms()),
        _ => Said::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        let mut d = UbxDecoder::new(&Mounting::new(&mount));
        let mut out = Vec::new();
        bytes.chunks(cut).for_each(|part| d.push(part, &mut out));
        (out, d)
    }

    #[test]
    fn ubx_moving_base_gives_fixes_and_headings() {
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
    fn ubx_decoder_detects_a_pulse_of_another_time_base() {
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
    fn ubx_decoder_counts_damage_and_reads_the_next_message() {
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
        fn ubx_decoder_survives_any_damage(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..60),
            noise in prop::collection::vec(any::<u8>(), 0..600),
            cut in 1_usize..700,
        ) {
            let mut bytes: Vec<u8> = (0..10).flat_map(|k| [pvt(200 * k), relative(200 * k, true)].concat()).collect();
            for (at, to) in changes {
                let k = at.index(bytes.len());
                bytes[k] = to;
            }
            bytes.extend(noise);
            let (all, _) = decode(&bytes, cut);
            prop_assert!(all.len() <= 40);
        }
    }
}

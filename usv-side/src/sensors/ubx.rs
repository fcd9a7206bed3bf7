//! UBX of u-blox: NAV-PVT, or the messages of its parts ([`parts`]), to a fix; NAV-RELPOSNED of a moving base to a heading.
//! What else comes is named in the source's report. TIM-TP announces the time of the
//! next pulse. Its edge is not observed, so it gives no measurement a time; it shows whether pulse and fixes use
//! one time base, on which a computer that takes its clock from the pulse relies.

mod parts;

use alight_shared::geodesy::Datum;
use alight_shared::msg::{HeadingFix, NOT_MEASURED_SD};
use ublox::proto27::{PacketRef, Proto27};
use ublox::{FixedBuffer, GnssFixType, Parser, ParserError, UbxPacket};

use super::clock::Rollover;
use super::nmea::account::{Account, Why};
use super::{Decoded, Decoder, Measurement, Mounting, Remark, SourceMeasurement};
use parts::{FixPart, FixParts, FixPlace, FixState};

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
    parts: FixParts,
    account: Account,
}

/// The content of a message.
enum Content {
    /// Or why there is none.
    Measurement(Result<Measurement, Why>),
    /// A part of a fix.
    Part(FixPart),
    Pulse,
}

/// A standard deviation by what a receiver states of an error, m.
fn sd(stated_m: f64) -> f64 {
    (FAST_FRACTION * stated_m).max(0.005)
}

/// The messages that are read: one of these of a length that the parser does not know is of another generation of receivers.
const READ: [&str; 8] = [
    "NAV-PVT",
    "NAV-RELPOSNED",
    "NAV-POSLLH",
    "NAV-HPPOSLLH",
    "NAV-VELNED",
    "NAV-SOL",
    "NAV-STATUS",
    "TIM-TP",
];

/// Names of messages by class and number; others are named by their numbers.
const NAMES: [((u8, u8), &str); 30] = [
    ((0x01, 0x01), "NAV-POSECEF"),
    ((0x01, 0x02), "NAV-POSLLH"),
    ((0x01, 0x03), "NAV-STATUS"),
    ((0x01, 0x04), "NAV-DOP"),
    ((0x01, 0x05), "NAV-ATT"),
    ((0x01, 0x06), "NAV-SOL"),
    ((0x01, 0x07), "NAV-PVT"),
    ((0x01, 0x09), "NAV-ODO"),
    ((0x01, 0x11), "NAV-VELECEF"),
    ((0x01, 0x12), "NAV-VELNED"),
    ((0x01, 0x13), "NAV-HPPOSECEF"),
    ((0x01, 0x14), "NAV-HPPOSLLH"),
    ((0x01, 0x20), "NAV-TIMEGPS"),
    ((0x01, 0x21), "NAV-TIMEUTC"),
    ((0x01, 0x22), "NAV-CLOCK"),
    ((0x01, 0x26), "NAV-TIMELS"),
    ((0x01, 0x30), "NAV-SVINFO"),
    ((0x01, 0x35), "NAV-SAT"),
    ((0x01, 0x36), "NAV-COV"),
    ((0x01, 0x3b), "NAV-SVIN"),
    ((0x01, 0x3c), "NAV-RELPOSNED"),
    ((0x01, 0x43), "NAV-SIG"),
    ((0x01, 0x61), "NAV-EOE"),
    ((0x02, 0x13), "RXM-SFRBX"),
    ((0x02, 0x15), "RXM-RAWX"),
    ((0x02, 0x32), "RXM-RTCM"),
    ((0x0a, 0x09), "MON-HW"),
    ((0x0a, 0x38), "MON-RF"),
    ((0x0d, 0x01), "TIM-TP"),
    ((0x0d, 0x03), "TIM-TM2"),
];

/// The name of a message.
fn name(of: (u8, u8)) -> String {
    let known = NAMES.iter().find(|(numbers, _)| *numbers == of);
    known.map_or_else(
        || format!("UBX-{:02X}-{:02X}", of.0, of.1),
        |(_, name)| (*name).into(),
    )
}

impl UbxDecoder {
    /// For a source with this mounting.
    pub fn new(mounting: &Mounting) -> Self {
        UbxDecoder {
            mounting: mounting.clone(),
            parser: Parser::with_fixed_buffer(),
            decoded: Decoded::default(),
            week: Rollover::default(),
            parts: FixParts::default(),
            account: Account::default(),
        }
    }

    /// Takes the content of a message with its name and its time of week, ms.
    fn take(&mut self, (name, of_week_ms): (&str, u32), content: Content, out: &mut Vec<SourceMeasurement>) {
        let of_week = i64::from(of_week_ms) * 1_000_000;
        if of_week >= WEEK_NS {
            self.decoded.corrupted += 1;
            return;
        }
        self.decoded.good += 1;
        match content {
            Content::Measurement(Ok(measurement)) => {
                let at_ns = self.week.unwrap(of_week);
                if let Measurement::Gnss(_) = measurement {
                    self.parts.whole(at_ns);
                }
                out.push(SourceMeasurement::new(at_ns, measurement));
            }
            Content::Measurement(Err(why)) => {
                let at_ns = self.week.unwrap(of_week);
                if why == Why::NoFix {
                    self.parts.whole(at_ns);
                }
                self.leave_out(name, why);
            }
            Content::Part(part) => {
                let at_ns = self.week.unwrap(of_week);
                self.part(name, at_ns, part, out);
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
    /// Takes a part of a fix where no whole fixes come.
    fn part(&mut self, name: &str, at_ns: i64, part: FixPart, out: &mut Vec<SourceMeasurement>) {
        if self.parts.are_spare(at_ns) {
            return self.leave_out(name, Why::Spare);
        }
        if part == FixPart::State(FixState::NoFix) {
            self.leave_out(name, Why::NoFix);
        }
        self.parts.take(at_ns, part, &self.mounting, out);
    }
    /// A whole message of a kind that is read gives nothing.
    fn leave_out(&mut self, name: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
    }
}

impl Decoder for UbxDecoder {
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for part in bytes.chunks(PART) {
            let mut all = Vec::new();
            let mut packets = self.parser.consume_ubx(part);
            while let Some(packet) = packets.next() {
                match packet {
                    Ok(UbxPacket::Proto27(p)) => {
                        let name = name(p.class_and_msg_id());
                        if let Some((of_week_ms, content)) = content(&p, &self.mounting) {
                            all.push((name, of_week_ms, content));
                        } else if matches!(p, PacketRef::Unknown(_)) && READ.contains(&name.as_str()) {
                            self.decoded.corrupted += 1;
                            self.account.leave_out(&name, Why::Length);
                        } else {
                            self.decoded.ignored += 1;
                            self.account.leave_out(&name, Why::NotRead);
                        }
                    }
                    // Its checksum is right: of another generation of receivers.
                    Err(ParserError::InvalidPacketLen { packet, .. }) => {
                        self.decoded.corrupted += 1;
                        self.account.leave_out(packet, Why::Length);
                    }
                    Err(_) => self.decoded.corrupted += 1,
                }
            }
            drop(packets);
            for (name, of_week_ms, content) in all {
                self.take((name.as_str(), of_week_ms), content, out);
            }
        }
    }
    fn finish(&mut self, out: &mut Vec<SourceMeasurement>) {
        self.parts.finish(&self.mounting, out);
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
    fn remarks(&self) -> Vec<Remark> {
        let lacks = self.parts.has_state && !self.parts.has_place;
        let placeless = lacks.then(|| {
            Remark::fault(
                "its messages have the state of a fix, and not its place".into(),
                "switch NAV-PVT on, or NAV-POSLLH and NAV-VELNED",
            )
        });
        placeless.into_iter().chain(self.account.remarks()).collect()
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
                let (across, down) = (sd(p.horizontal_accuracy()), sd(p.vertical_accuracy()));
                let velocity_sd = p.speed_accuracy().clamp(0.02, 100.0);
                let datum = Datum::new(p.latitude(), p.longitude(), p.height_above_ellipsoid());
                let velocity = [p.vel_north(), p.vel_east(), p.vel_down()];
                let down = if three { down } else { NOT_MEASURED_SD };
                mounting.fix(datum, velocity, [across, across, down], [velocity_sd; 3])
            });
            (
                p.itow(),
                Content::Measurement(fix.map(Measurement::Gnss).ok_or(Why::NoFix)),
            )
        }
        PacketRef::NavRelPosNed(p) => {
            // relPosHeadingValid (interface description of the F9 receivers).
            let valid = p.flags_raw() & (1 << 8) != 0;
            let heading = valid.then(|| HeadingFix {
                heading_sd: p.acc_heading_degrees().to_radians().clamp(1e-3, 1.0),
                ..mounting.heading_fix(mounting.heading(p.rel_pos_heading_degrees().to_radians()))
            });
            let heading = heading.map(Measurement::Heading).ok_or(Why::Invalid);
            (p.itow(), Content::Measurement(heading))
        }
        PacketRef::TimTp(p) => (p.tow_ms(), Content::Pulse),
        _ => return part(packet).map(|(of_week_ms, part)| (of_week_ms, Content::Part(part))),
    })
}

/// Time of week, ms, and content of a message that has a part of a fix.
fn part(packet: &PacketRef<'_>) -> Option<(u32, FixPart)> {
    Some(match packet {
        PacketRef::NavPosLlh(p) => {
            let place = FixPlace {
                datum: Datum::new(p.lat_degrees(), p.lon_degrees(), p.height_meters()),
                across_m: p.h_ack(),
                down_m: p.v_acc(),
                is_fine: false,
            };
            (p.itow(), FixPart::Place(place))
        }
        PacketRef::NavHpPosLlh(p) if !p.flags().invalid_llh() => {
            // Its rests of the height and its errors are in tenths of a millimetre; they are given in millimetres.
            let place = FixPlace {
                datum: Datum::new(
                    p.lat_degrees() + p.lat_hp_degrees(),
                    p.lon_degrees() + p.lon_hp_degrees(),
                    p.height_meters() + 1e-3 * p.height_hp_meters(),
                ),
                across_m: 1e-3 * p.horizontal_accuracy(),
                down_m: 1e-3 * p.vertical_accuracy(),
                is_fine: true,
            };
            (p.itow(), FixPart::Place(place))
        }
        PacketRef::NavVelNed(p) => {
            let velocity = [p.vel_north(), p.vel_east(), p.vel_down()];
            (p.itow(), FixPart::Velocity(velocity, p.speed_accuracy_estimate()))
        }
        PacketRef::NavSol(p) => (p.itow(), FixPart::State(state(p.fix_type(), p.flags_raw()))),
        PacketRef::NavStatus(p) => (p.itow(), FixPart::State(state(p.fix_type(), p.flags_raw()))),
        _ => return None,
    })
}

/// The state of a fix by its kind and its flags, whose first is gpsFixOk.
fn state(kind: GnssFixType, flags: u8) -> FixState {
    match kind {
        GnssFixType::Fix3D | GnssFixType::GPSPlusDeadReckoning if flags & 1 != 0 => FixState::Whole,
        GnssFixType::Fix2D if flags & 1 != 0 => FixState::Flat,
        _ => FixState::NoFix,
    }
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

    /// NAV-POSLLH, NAV-STATUS with this kind of fix, NAV-VELNED and, where it is `fine`, NAV-HPPOSLLH, as a receiver sends them.
    fn parts(tow_ms: u32, fix: u8, fine: bool) -> Vec<u8> {
        let mut place = [0; 28];
        put(&mut place, 0, &tow_ms.to_le_bytes());
        put(&mut place, 4, &145_000_000_i32.to_le_bytes());
        put(&mut place, 8, &500_000_000_i32.to_le_bytes());
        put(&mut place, 12, &255_000_i32.to_le_bytes());
        put(&mut place, 20, &1000_u32.to_le_bytes());
        put(&mut place, 24, &2000_u32.to_le_bytes());
        let mut status = [0; 16];
        put(&mut status, 0, &tow_ms.to_le_bytes());
        (status[4], status[5]) = (fix, u8::from(fix > 0));
        let mut velocity = [0; 36];
        put(&mut velocity, 0, &tow_ms.to_le_bytes());
        put(&mut velocity, 8, &(-150_i32).to_le_bytes());
        put(&mut velocity, 28, &10_u32.to_le_bytes());
        let mut precise = [0; 36];
        put(&mut precise, 4, &tow_ms.to_le_bytes());
        put(&mut precise, 8, &145_000_000_i32.to_le_bytes());
        put(&mut precise, 12, &500_000_000_i32.to_le_bytes());
        put(&mut precise, 16, &255_000_i32.to_le_bytes());
        (precise[25], precise[26]) = (50, 9);
        put(&mut precise, 28, &1000_u32.to_le_bytes());
        put(&mut precise, 32, &2000_u32.to_le_bytes());
        let precise = if fine {
            message(1, 0x14, &precise)
        } else {
            Vec::new()
        };
        [
            message(1, 2, &place),
            message(1, 3, &status),
            message(1, 0x12, &velocity),
            precise,
        ]
        .concat()
    }

    #[test]
    fn ubx_receiver_without_whole_fixes() {
        for fine in [false, true] {
            let bytes: Vec<u8> = (0..20).flat_map(|k| parts(200 * k, 3, fine)).collect();
            let (all, d) = decode(&bytes, 7);
            // The first shows what comes with each.
            assert_eq!(all.len(), 19, "{fine}: {:?}", d.decoded());
            for (k, m) in (1..).zip(&all) {
                assert_eq!(m.at_ns, 200_000_000 * k);
            }
            for m in all.iter().skip(1) {
                let Measurement::Gnss(g) = m.measurement else {
                    panic!("{m:?}");
                };
                let (height, across) = if fine { (255.0009, 0.03) } else { (255.0, 0.3) };
                let latitude = if fine { 50.000_000_05 } else { 50.0 };
                assert!(
                    (g.datum.latitude_deg - latitude).abs() < 1e-10
                        && (g.datum.longitude_deg - 14.5).abs() < 1e-10
                );
                assert!((g.datum.height_m - height).abs() < 1e-6, "{g:?}");
                assert!(
                    (g.position_sd[0] - across).abs() < 1e-9 && (g.velocity[1] + 1.5).abs() < 1e-9,
                    "{g:?}"
                );
                assert!((g.velocity_sd[0] - 0.1).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn ubx_parts_without_a_fix_and_with_a_whole_one() {
        let bytes: Vec<u8> = (0..20).flat_map(|k| parts(200 * k, 0, false)).collect();
        let (all, d) = decode(&bytes, 7);
        assert!(all.is_empty());
        let reports = |d: &UbxDecoder, part: &str| d.remarks().iter().any(|r| r.text.contains(part));
        assert!(reports(&d, "20 NAV-STATUS (no fix)"), "{:?}", d.remarks());
        // NAV-PVT has it all; once it is silent for 2 s, the parts stand in. Their first time shows what comes with each.
        let part = |k: u32| {
            [
                parts(200 * k, 3, false),
                if k < 20 { pvt(200 * k) } else { Vec::new() },
            ]
            .concat()
        };
        let bytes: Vec<u8> = (0..40).flat_map(part).collect();
        let (all, d) = decode(&bytes, 7);
        let times: Vec<i64> = all.iter().map(|m| m.at_ns / 200_000_000).collect();
        let expected: Vec<i64> = (0..20).chain(31..40).collect();
        assert_eq!(times, expected, "{:?}", d.remarks());
        assert!(reports(&d, "NAV-POSLLH") && reports(&d, "a better one is there"));
    }

    #[test]
    fn ubx_messages_that_are_not_read() {
        let mut sol = [0; 52];
        (sol[10], sol[11]) = (3, 1);
        let messages = [
            message(1, 0x35, &[0; 8]),
            message(1, 0x04, &[0; 18]),
            message(1, 0x04, &[0; 18]),
            message(0x0a, 0x77, &[0; 4]),
            message(1, 0x06, &sol),
            message(1, 7, &[0; 84]),
        ];
        let (_, d) = decode(&messages.concat(), 7);
        let text: Vec<String> = d.remarks().into_iter().map(|r| r.text).collect();
        let text = text.join("; ");
        for part in [
            "2 NAV-DOP",
            "1 NAV-SAT",
            "1 UBX-0A-77",
            "and not its place",
            "of another length",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let n = d.decoded();
        assert_eq!((n.good, n.ignored, n.corrupted), (1, 4, 1));
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

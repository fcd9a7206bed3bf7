//! u-blox's UBX. NAV-PVT, or messages with its parts ([`parts`]), gives a fix, and NAV-RELPOSNED of a moving
//! base a heading. Other messages appear in the source's report. TIM-TP announces the next pulse, whose edge
//! is not observed, so it dates no measurement. It shows whether pulse and fixes have one time base, for a
//! computer whose clock follows the pulse.

mod parts;

use alight_shared::{
    estimation::Rollover,
    geodesy::Datum,
    msg::{AttitudeFix, HeadingFix, NOT_MEASURED_SD},
};
use ublox::{
    FixedBuffer, GnssFixType, Parser, ParserError, UbxPacket,
    proto27::{PacketRef, Proto27},
};

use super::{
    Decoded, Measurement, Mounting, Remark, SensorDecoder, SourceMeasurement,
    nmea::account::{Account, Why},
};
use parts::{FixPart, FixParts, FixPlace, FixState, Grade};

/// Maximum length of an unfinished message, bytes, above that of any used message.
const MAX_WAITING: usize = 2048;
/// Number of bytes passed to the parser at a time.
const PART: usize = 512;
const WEEK_NS: i64 = 7 * 86_400_000_000_000;
/// Maximum time from a fix to an announced pulse, ns: its period of 1 s (the default) and 1 s for a late
/// message. UTC and GPS time differ by whole seconds, 18 since 2017.
const PULSE_NS: i64 = 2_000_000_000;
/// Fraction of a receiver's stated error that changes within a minute (our choice).
const FAST_FRACTION: f64 = 0.3;

pub struct UbxDecoder {
    mounting: Mounting,
    parser: Parser<FixedBuffer<MAX_WAITING>, Proto27>,
    decoded: Decoded,
    week: Rollover<WEEK_NS>,
    parts: FixParts,
    account: Account,
}

enum Content {
    /// Measurement, or the reason why the message has none.
    Measurement(Result<Measurement, Why>),
    /// Roll and pitch, and the heading if available.
    Attitude(AttitudeFix, Option<HeadingFix>),
    /// Two-antenna heading with a float solution.
    Float,
    Part(FixPart),
    Pulse,
}

/// Standard deviation from a receiver's stated error, m.
fn sd(stated_m: f64) -> f64 {
    (FAST_FRACTION * stated_m).max(0.005)
}

/// Supported messages; one of unknown length is from another receiver generation.
const READ: [&str; 10] = [
    "NAV-PVT",
    "NAV-RELPOSNED",
    "NAV-POSLLH",
    "NAV-HPPOSLLH",
    "NAV-VELNED",
    "NAV-SOL",
    "NAV-STATUS",
    "NAV-POSECEF",
    "NAV-ATT",
    "TIM-TP",
];

/// Message names by class and id; others appear as numbers.
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

fn name(of: (u8, u8)) -> String {
    let known = NAMES.iter().find(|(numbers, _)| *numbers == of);
    known.map_or_else(
        || format!("UBX-{:02X}-{:02X}", of.0, of.1),
        |(_, name)| (*name).into(),
    )
}

impl UbxDecoder {
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

    /// Processes the content of a message with this name and time of week, ms.
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
                match measurement {
                    Measurement::Gnss(_) => self.parts.whole(at_ns),
                    Measurement::Heading(_) => self.account.antennas(false),
                    Measurement::Imu(_) | Measurement::Attitude(_) => {}
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
            Content::Attitude(attitude, heading) => {
                let at_ns = self.week.unwrap(of_week);
                out.push(SourceMeasurement::new(at_ns, attitude));
                out.extend(heading.map(|h| SourceMeasurement::new(at_ns, h)));
            }
            Content::Float => {
                let _at_ns = self.week.unwrap(of_week);
                self.decoded.left_out += 1;
                self.account.antennas(true);
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
    /// Processes a part of a fix, unless there are whole fixes.
    fn part(&mut self, name: &str, at_ns: i64, part: FixPart, out: &mut Vec<SourceMeasurement>) {
        if self.parts.are_spare(at_ns) {
            return self.leave_out(name, Why::Spare);
        }
        if matches!(
            part,
            FixPart::State(FixState::NoFix) | FixPart::Solution(FixState::NoFix, _)
        ) {
            self.leave_out(name, Why::NoFix);
        }
        self.parts.take(at_ns, part, &self.mounting, out);
    }
    fn leave_out(&mut self, name: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
    }
}

impl SensorDecoder for UbxDecoder {
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
                    // The checksum is valid, so the message is from another receiver generation.
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
                "its messages contain the state of a fix, but no position".into(),
                "switch NAV-PVT on, or NAV-POSLLH and NAV-VELNED",
            )
        });
        placeless.into_iter().chain(self.account.remarks()).collect()
    }
}

/// Difference between two times of week, ns, wrapped to half a week.
fn after(of_week_ns: i64, than_ns: i64) -> i64 {
    (of_week_ns - than_ns + WEEK_NS / 2).rem_euclid(WEEK_NS) - WEEK_NS / 2
}

/// Time of week, ms, and content of a supported message.
fn content(packet: &PacketRef<'_>, mounting: &Mounting) -> Option<(u32, Content)> {
    Some(match packet {
        PacketRef::NavPvt(p) => {
            let kind = p.fix_type();
            let three = matches!(kind, GnssFixType::Fix3D | GnssFixType::GPSPlusDeadReckoning);
            // gnssFixOK, and not invalidLlh.
            let is_nowhere = Datum::new(p.latitude(), p.longitude(), 0.0).is_nowhere();
            let valid = p.flags_raw() & 1 != 0 && !p.flags3().invalid_llh() && !is_nowhere;
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
            let heading = HeadingFix {
                heading_sd: p.acc_heading_degrees().to_radians().clamp(1e-3, 1.0),
                ..mounting.heading_fix(mounting.heading(p.rel_pos_heading_degrees().to_radians()))
            };
            (p.itow(), moving_base(p.flags_raw(), heading))
        }
        // An accuracy of 90 degrees marks an unknown heading.
        PacketRef::NavAtt(p) => {
            let [roll, pitch, heading] =
                [p.vehicle_roll(), p.vehicle_pitch(), p.vehicle_heading()].map(f64::to_radians);
            let [roll, pitch, yaw] = mounting.attitude([roll, pitch, heading]);
            let sd = |degrees: f64| degrees.to_radians().max(1e-3);
            let tilt_sd = sd(p.vehicle_roll_accuracy().max(p.vehicle_pitch_accuracy()));
            let of_heading = HeadingFix {
                heading_sd: sd(p.vehicle_heading_accuracy()),
                ..mounting.heading_fix(yaw)
            };
            let heading = (p.vehicle_heading_accuracy() < 90.0).then_some(of_heading);
            let attitude = AttitudeFix {
                tilt_sd,
                ..mounting.tilt([roll, pitch])
            };
            (p.itow(), Content::Attitude(attitude, heading))
        }
        PacketRef::TimTp(p) => (p.tow_ms(), Content::Pulse),
        _ => return part(packet).map(|(of_week_ms, part)| (of_week_ms, Content::Part(part))),
    })
}

/// Heading by the flags of NAV-RELPOSNED (interface description of the F9). A float solution may be off by
/// tens of degrees, although it states the accuracy of a fixed one.
fn moving_base(flags: u32, heading: HeadingFix) -> Content {
    /// gnssFixOK, relPosValid, relPosHeadingValid.
    const VALID: u32 = 1 | 1 << 2 | 1 << 8;
    const IS_MOVING: u32 = 1 << 5;
    // Carrier solution: 0 none, 1 float, 2 fixed; 3 is reserved.
    let why = match (flags >> 3) & 3 {
        _ if flags & VALID != VALID => Why::Invalid,
        _ if flags & IS_MOVING == 0 => Why::FixedBase,
        2 => return Content::Measurement(Ok(heading.into())),
        1 => return Content::Float,
        _ => Why::Invalid,
    };
    Content::Measurement(Err(why))
}

/// Time of week, ms, and content of a message with a part of a fix.
fn part(packet: &PacketRef<'_>) -> Option<(u32, FixPart)> {
    Some(match packet {
        PacketRef::NavPosLlh(p) => {
            let place = FixPlace {
                datum: Datum::new(p.lat_degrees(), p.lon_degrees(), p.height_meters()),
                across_m: p.h_ack(),
                down_m: p.v_acc(),
                grade: Grade::Geodetic,
            };
            (p.itow(), FixPart::Place(place))
        }
        PacketRef::NavHpPosLlh(p) if !p.flags().invalid_llh() => {
            // High-precision parts are in 0.1 mm; the parser returns millimetres.
            let place = FixPlace {
                datum: Datum::new(
                    p.lat_degrees() + p.lat_hp_degrees(),
                    p.lon_degrees() + p.lon_hp_degrees(),
                    p.height_meters() + 1e-3 * p.height_hp_meters(),
                ),
                across_m: 1e-3 * p.horizontal_accuracy(),
                down_m: 1e-3 * p.vertical_accuracy(),
                grade: Grade::Fine,
            };
            (p.itow(), FixPart::Place(place))
        }
        PacketRef::NavVelNed(p) => {
            let velocity = [p.vel_north(), p.vel_east(), p.vel_down()];
            (p.itow(), FixPart::Velocity(velocity, p.speed_accuracy_estimate()))
        }
        PacketRef::NavSol(p) => {
            let at = [p.ecef_x(), p.ecef_y(), p.ecef_z()];
            let state = state(p.fix_type(), p.flags_raw());
            let place = ecef_place(at, p.position_accuracy_estimate());
            let part = place.map_or(FixPart::State(state), |place| FixPart::Solution(state, place));
            (p.itow(), part)
        }
        PacketRef::NavPosEcef(p) => {
            let at = [p.ecef_x_meters(), p.ecef_y_meters(), p.ecef_z_meters()];
            (p.itow(), FixPart::Place(ecef_place(at, p.p_acc_meters())?))
        }
        PacketRef::NavStatus(p) => (p.itow(), FixPart::State(state(p.fix_type(), p.flags_raw()))),
        _ => return None,
    })
}

/// Position from Earth-centred coordinates and their common error, m; None at the Earth's centre.
fn ecef_place(at: [f64; 3], error_m: f64) -> Option<FixPlace> {
    let datum = Datum::from_ecef(at);
    datum.is_on_earth().then_some(FixPlace {
        datum,
        across_m: error_m,
        down_m: error_m,
        grade: Grade::Ecef,
    })
}

/// Fix state from its kind and flags, the first of which is gpsFixOk.
fn state(kind: GnssFixType, flags: u8) -> FixState {
    match kind {
        GnssFixType::Fix3D | GnssFixType::GPSPlusDeadReckoning if flags & 1 != 0 => FixState::Whole,
        GnssFixType::Fix2D if flags & 1 != 0 => FixState::Flat,
        _ => FixState::NoFix,
    }
}

#[cfg(test)]
mod tests;

//! MAVLink from a boat's autopilot or INS: ATTITUDE_QUATERNION, HIGHRES_IMU, RAW_IMU, GPS_RAW_INT, GPS2_RAW, ODOMETRY
//! (with GPS_GLOBAL_ORIGIN for its position), and ESTIMATOR_STATUS or EKF_STATUS_REPORT for the validity of the
//! attitude. Payloads are read by their offsets in the message definition (common.xml, ardupilotmega.xml), including
//! extension fields and truncated zeros. One of the systems on the link is the vessel's ([`crate::mavlink_systems`]).

use alight_shared::geodesy::Datum;
use alight_shared::mavlink::{
    self, EKF_STATUS_REPORT, Fields, FrameReader, MAX_WAITING, MavlinkSender, Signing, dialect as m,
};
use alight_shared::msg::{AttitudeFix, GnssFix, HeadingFix, ImuSample, NOT_MEASURED_SD};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::heights::EllipsoidHeights;
use super::nmea::account::{Account, Why};
use super::{Decoded, Mounting, Remark, SensorDecoder, SourceMeasurement, euler};
use crate::mavlink_systems::{AUTOPILOT, Systems};

/// `RAW_IMU` of ArduPilot: m/s² per mG, rad/s per mrad/s.
const MILLI_G: f64 = 9.806_65e-3;
/// Minimum time between two headings used from an autopilot's filter, ns; headings in between add no information.
const HEADING_STEP_NS: i64 = 200_000_000;
/// Fraction of a receiver's error that changes within a minute (ours), and error assumed for a receiver that
/// states none, horizontal and vertical, m.
const FAST_FRACTION: f64 = 0.3;
const POSITION_SD: [f64; 2] = [2.0, 4.0];
/// Velocity standard deviation assumed for a receiver that states none, m/s.
const VELOCITY_SD: f64 = 0.3;

/// Requested messages, each with its interval, us.
const WANTED: [(u32, f32); 6] = [
    (31, 40_000.0),
    (105, 10_000.0),
    (24, 200_000.0),
    (124, 200_000.0),
    (ESTIMATOR_STATUS, 1_000_000.0),
    (EKF_STATUS_REPORT.0, 1_000_000.0),
];
/// Messages with an attitude or a position that are not read.
const NOT_READ: [(u32, &str); 2] = [(30, "ATTITUDE"), (33, "GLOBAL_POSITION_INT")];
const ESTIMATOR_STATUS: u32 = 230;
/// First flag of the estimator's status, and of ArduPilot's report: valid attitude.
const ATTITUDE_GOOD: u16 = 1;
/// Number of attitudes rejected after a report without that flag (10 s at 25 Hz), unless a report with it arrives.
const UNFIT: u16 = 250;
/// `quality` of ODOMETRY when the odometry has failed: -1 instead of 0 to 100 %.
const FAILED: u8 = u8::MAX;
/// Our own component: an onboard computer of the autopilot's system.
const COMPANION: u8 = 191;

#[derive(Default)]
pub struct MavlinkDecoder {
    mounting: Mounting,
    frames: FrameReader,
    signing: Option<Signing>,
    decoded: Decoded,
    systems: Systems,
    sequence: u8,
    heights: EllipsoidHeights,
    /// Newest separation of sea and ellipsoid from the receiver, m.
    separation: Option<f64>,
    /// Origin of the local frame, with its height above the sea.
    origin: Option<Datum>,
    heading_ns: i64,
    gps_heading: bool,
    /// Number of attitudes still to be rejected after the estimator's newest report.
    unfit: u16,
    account: Account,
    requests: u32,
}

/// Value in millimetres at `at` as m. None if zero, which means unknown.
fn known_mm(p: &Fields<'_>, at: usize) -> Option<f64> {
    Some(p.u32(at)).filter(|v| *v > 0).map(|v| f64::from(v) * 1e-3)
}

fn finite<const N: usize>(v: [f64; N]) -> Option<[f64; N]> {
    v.iter().all(|x| x.is_finite()).then_some(v)
}

impl MavlinkDecoder {
    pub fn new(mounting: &Mounting) -> Self {
        MavlinkDecoder {
            mounting: mounting.clone(),
            heading_ns: i64::MIN,
            ..MavlinkDecoder::default()
        }
    }

    /// Selects this system as the vessel's; zero: the first system whose type is a boat.
    pub fn of_system(self, system: u8) -> Self {
        MavlinkDecoder {
            systems: Systems::new(Some(system).filter(|s| *s > 0)),
            ..self
        }
    }

    fn take(&mut self, id: u32, p: &Fields<'_>, out: &mut Vec<SourceMeasurement>) {
        let boot_ms = |at: usize| i64::from(p.u32(at)) * 1_000_000;
        let time_us = |at: usize| i64::try_from(p.u64(at).saturating_mul(1000)).unwrap_or(i64::MAX);
        let before = out.len();
        let understood = match id {
            31 if self.is_unfit() => self.leave_out("ATTITUDE_QUATERNION", Why::Invalid),
            331 if self.is_unfit() || p.u8(232) == FAILED => self.leave_out("ODOMETRY", Why::Invalid),
            ESTIMATOR_STATUS => self.estimator(p.u16(40)),
            // An autopilot without this estimator sends zero.
            id if id == EKF_STATUS_REPORT.0 => match p.u16(20) {
                0 => Some(()),
                flags => self.estimator(flags),
            },
            31 => self.attitude(boot_ms(0), p.floats(4), Some(p.floats(20)), out),
            // Accelerometers and gyroscopes are included in this message.
            105 if p.u16(60) & 0x3f == 0x3f => self.imu(time_us(0), p.floats(8), p.floats(20), 0, out),
            105 => Some(()),
            27 => {
                let three = |at: usize| core::array::from_fn(|k| p.i16(at + 2 * k));
                let force: [f64; 3] = three(8);
                let gyro: [f64; 3] = three(14);
                self.imu(
                    time_us(0),
                    force.map(|a| a * MILLI_G),
                    gyro.map(|w| w * 1e-3),
                    1,
                    out,
                )
            }
            24 => self.gps(time_us(0), p, &FIRST, 0, out),
            124 => self.gps(time_us(0), p, &SECOND, 1, out),
            49 => {
                self.origin = Some(Datum::new(p.i32(0) * 1e-7, p.i32(4) * 1e-7, p.i32(8) * 1e-3));
                Some(())
            }
            331 => self.odometry(time_us(0), p, out),
            id => {
                self.decoded.ignored += 1;
                let name = NOT_READ.iter().find(|(known, _)| *known == id);
                name.into_iter()
                    .for_each(|(_, name)| self.account.leave_out(name, Why::NotRead));
                return;
            }
        };
        match understood {
            Some(()) => self.decoded.good += 1,
            None => {
                out.truncate(before);
                self.decoded.corrupted += 1;
            }
        }
    }

    /// Counts a message of a supported kind that yields no measurement.
    fn leave_out(&mut self, name: &str, why: Why) -> Option<()> {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
        Some(())
    }
    fn estimator(&mut self, flags: u16) -> Option<()> {
        self.unfit = if flags & ATTITUDE_GOOD == 0 { UNFIT } else { 0 };
        Some(())
    }
    fn is_unfit(&mut self) -> bool {
        let is_unfit = self.unfit > 0;
        self.unfit = self.unfit.saturating_sub(1);
        is_unfit
    }

    fn imu(
        &self,
        at_ns: i64,
        force: [f64; 3],
        gyro: [f64; 3],
        source: u8,
        out: &mut Vec<SourceMeasurement>,
    ) -> Option<()> {
        let sample = ImuSample {
            source,
            ..self.mounting.imu(finite(gyro)?, finite(force)?)
        };
        out.push(SourceMeasurement::new(at_ns, sample));
        Some(())
    }

    fn attitude(
        &mut self,
        at_ns: i64,
        q: [f64; 4],
        rates: Option<[f64; 3]>,
        out: &mut Vec<SourceMeasurement>,
    ) -> Option<()> {
        let [roll, pitch, yaw] = self.mounting.attitude(euler(q)?);
        let rates = rates.and_then(finite).map(|r| self.mounting.vector(r));
        let fix = AttitudeFix {
            rates,
            ..self.mounting.tilt([roll, pitch])
        };
        out.push(SourceMeasurement::new(at_ns, fix));
        if !self.gps_heading && at_ns.saturating_sub(self.heading_ns).saturating_abs() >= HEADING_STEP_NS {
            self.heading_ns = at_ns;
            out.push(SourceMeasurement::new(at_ns, self.mounting.heading_fix(yaw)));
        }
        Some(())
    }

    fn gps(
        &mut self,
        at_ns: i64,
        p: &Fields<'_>,
        at: &Receiver,
        source: u8,
        out: &mut Vec<SourceMeasurement>,
    ) -> Option<()> {
        // 0 no receiver, 1 no fix, 2 two-dimensional, 3 and above three-dimensional.
        let kind = p.u8(at.fix_type);
        let (latitude_deg, longitude_deg) = (p.i32(8) * 1e-7, p.i32(12) * 1e-7);
        if kind >= 2 && (latitude_deg.abs() > 90.0 || longitude_deg.abs() > 180.0) {
            return None;
        }
        if kind == 1 {
            self.leave_out(at.names[0], Why::NoFix);
        }
        let across = known_mm(p, at.accuracy).unwrap_or(POSITION_SD[0]) * FAST_FRACTION;
        let down = known_mm(p, at.accuracy + 4).unwrap_or(POSITION_SD[1]) * FAST_FRACTION;
        let (speed, course) = (p.u16(at.speed), p.u16(at.speed + 2));
        let measured = speed != u16::MAX && course != u16::MAX;
        let (speed, course) = (f64::from(speed) * 0.01, (f64::from(course) * 0.01).to_radians());
        let (velocity, velocity_sd) = if measured {
            let sd = known_mm(p, at.accuracy + 8).unwrap_or(VELOCITY_SD).max(0.02);
            ([speed * course.cos(), speed * course.sin(), 0.0], sd)
        } else {
            ([0.0; 3], NOT_MEASURED_SD)
        };
        let antenna = match source {
            0 => self.mounting.mount.antenna_m.unwrap_or_default(),
            _ => self.mounting.mount.second_antenna_m,
        };
        let place = Datum::new(latitude_deg, longitude_deg, 0.0);
        if kind >= 2 && place.is_nowhere() {
            self.leave_out(at.names[0], Why::Nowhere);
        } else if kind >= 2 {
            // A height of zero above the ellipsoid means that the autopilot does not provide it.
            let sea_m = p.i32(16) * 1e-3;
            let stated = Some(p.i32(at.ellipsoid) * 1e-3)
                .filter(|h| *h != 0.0)
                .map(|h| h - sea_m);
            self.separation = stated.or(self.separation);
            let (separation, height_spread) = self.heights.separation(&place, sea_m, self.separation);
            let down = if kind >= 3 {
                down.max(0.005)
            } else {
                NOT_MEASURED_SD
            };
            let across = across.max(0.005);
            let datum = Datum {
                height_m: sea_m + separation,
                ..place
            };
            let (position_sd, velocity_sd) = (
                [across, across, down],
                [velocity_sd, velocity_sd, NOT_MEASURED_SD],
            );
            let fix = GnssFix {
                source,
                height_spread,
                lever_arm: Some(antenna),
                ..self.mounting.fix(datum, velocity, position_sd, velocity_sd)
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        }
        // Heading by two antennas: 0 not supported, 65535 currently unavailable, 36000 north.
        let yaw = p.u16(at.yaw);
        if (1..=36_000).contains(&yaw) {
            self.gps_heading = true;
            let heading = self.mounting.heading((f64::from(yaw) * 0.01).to_radians());
            let fix = HeadingFix {
                source,
                ..self.mounting.heading_fix(heading)
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        } else if yaw == u16::MAX {
            self.leave_out(at.names[1], Why::Invalid);
        }
        Some(())
    }

    fn odometry(&mut self, at_ns: i64, p: &Fields<'_>, out: &mut Vec<SourceMeasurement>) -> Option<()> {
        // Position, attitude, velocity, rates, two covariances, frames; in NED, or the velocity in body axes.
        let (frame, child) = (p.u8(228), p.u8(229));
        let (position, q, velocity): ([f64; 3], [f64; 4], [f64; 3]) =
            (p.floats(8), p.floats(20), p.floats(36));
        if frame != m::MavFrame::MAV_FRAME_LOCAL_NED as u8 {
            return Some(());
        }
        self.attitude(at_ns, q, Some(p.floats(48)), out)?;
        let Some(origin) = self.origin else {
            return Some(());
        };
        let (separation, height_spread) = self.heights.separation(&origin, origin.height_m, self.separation);
        let datum = Datum {
            height_m: origin.height_m + separation,
            ..origin
        };
        let [w, x, y, z] = q;
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let measured = finite(velocity).map(Vector3::from);
        let velocity = match child {
            c if c == m::MavFrame::MAV_FRAME_LOCAL_NED as u8 => measured,
            c if c == m::MavFrame::MAV_FRAME_BODY_FRD as u8 => measured.map(|v| turn * v),
            _ => None,
        };
        // Upper triangle of a 6 x 6 matrix, row by row. The first element is NaN if the covariance is unknown.
        let sd = |at: usize, k: usize, otherwise: f64| {
            let [v]: [f64; 1] = p.floats(at + 4 * k);
            if v.is_finite() && v > 0.0 {
                v.sqrt().clamp(0.005, 100.0)
            } else {
                otherwise
            }
        };
        let position_sd = [sd(60, 0, 0.5), sd(60, 6, 0.5), sd(60, 11, 1.0)];
        let velocity_sd = match velocity {
            Some(_) => [0, 6, 11].map(|k| sd(144, k, VELOCITY_SD)),
            None => [NOT_MEASURED_SD; 3],
        };
        let velocity = velocity.unwrap_or_default().into();
        let fix = GnssFix {
            position: finite(position)?,
            source: 2,
            height_spread,
            // Position of the autopilot itself.
            lever_arm: Some(self.mounting.mount.lever_arm_m.unwrap_or_default()),
            ..self.mounting.fix(datum, velocity, position_sd, velocity_sd)
        };
        out.push(SourceMeasurement::new(at_ns, fix));
        Some(())
    }

    fn frame(&mut self, message: &m::MavMessage) -> Vec<u8> {
        let from = MavlinkSender {
            system: self.systems.own().unwrap_or(1),
            component: COMPANION,
            sequence: self.sequence,
        };
        self.sequence = self.sequence.wrapping_add(1);
        mavlink::encode(from, message, self.signing.as_ref())
    }
}

impl SensorDecoder for MavlinkDecoder {
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for part in bytes.chunks(MAX_WAITING / 4) {
            self.frames.push(part);
            while let Some(raw) = self.frames.next_frame() {
                if self.systems.is_own(&raw) {
                    self.take(raw.id, &raw.fields(), out);
                } else {
                    self.decoded.left_out += 1;
                }
            }
        }
    }
    fn decoded(&self) -> Decoded {
        Decoded {
            corrupted: self.decoded.corrupted + self.frames.gaps() + self.frames.unreadable(),
            ..self.decoded
        }
    }
    fn sign(&mut self, key: Signing) {
        self.frames = FrameReader::signed(Some(key.clone()));
        self.signing = Some(key);
    }
    fn remarks(&self) -> Vec<Remark> {
        let signatures = self.frames.signatures().finding(false);
        self.heights
            .remark()
            .into_iter()
            .chain(self.systems.remark().map(|(text, remedy)| match remedy {
                Some(remedy) => Remark::fault(text, remedy),
                None => Remark::fine(text),
            }))
            .chain(signatures.map(|(text, remedy)| Remark::fault(text, remedy)))
            .chain(self.account.remarks())
            .collect()
    }
    /// Heartbeat, and the message requests with every fifth one.
    fn request(&mut self) -> Option<Vec<u8>> {
        let mut bytes = self.frame(&m::MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            mavtype: m::MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_INVALID,
            system_status: m::MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
            ..m::HEARTBEAT_DATA::DEFAULT
        }));
        let own = self.systems.own().filter(|_| self.requests.is_multiple_of(5));
        if let Some(system) = own {
            for (id, interval_us) in WANTED {
                let wanted = m::COMMAND_LONG_DATA {
                    target_system: system,
                    target_component: AUTOPILOT,
                    command: m::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                    param1: id as f32,
                    param2: interval_us,
                    ..m::COMMAND_LONG_DATA::DEFAULT
                };
                bytes.extend(self.frame(&m::MavMessage::COMMAND_LONG(wanted)));
            }
        }
        self.requests = self.requests.wrapping_add(1);
        Some(bytes)
    }
}

/// Field offsets in the messages of both receivers.
struct Receiver {
    /// Names of the message and of its heading.
    names: [&'static str; 2],
    speed: usize,
    fix_type: usize,
    ellipsoid: usize,
    accuracy: usize,
    yaw: usize,
}
const FIRST: Receiver = Receiver {
    names: ["GPS_RAW_INT", "GPS_RAW_INT-yaw"],
    speed: 24,
    fix_type: 28,
    ellipsoid: 30,
    accuracy: 34,
    yaw: 50,
};
const SECOND: Receiver = Receiver {
    names: ["GPS2_RAW", "GPS2_RAW-yaw"],
    speed: 28,
    fix_type: 32,
    ellipsoid: 37,
    accuracy: 41,
    yaw: 35,
};

#[cfg(test)]
mod tests;

//! MAVLink from a boat's autopilot or INS: ATTITUDE_QUATERNION, HIGHRES_IMU, RAW_IMU, GPS_RAW_INT, GPS2_RAW, ODOMETRY
//! (with GPS_GLOBAL_ORIGIN for its position), and ESTIMATOR_STATUS or EKF_STATUS_REPORT for the validity of the
//! attitude. One of the systems on the link is the vessel's ([`crate::mavlink_systems`]).

use alight_shared::{
    geodesy::Datum,
    mavlink::{
        self, EKF_STATUS_REPORT, FrameReader, MAX_WAITING, MavlinkSender, MessageData as _, RawFrame,
        Signing, dialect as m, fields,
    },
    msg::{AttitudeFix, GnssFix, HeadingFix, ImuSample, NOT_MEASURED_SD},
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{
    Decoded, Mounting, Remark, SensorDecoder, SourceMeasurement, euler,
    heights::EllipsoidHeights,
    nmea::account::{Account, Why},
};
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
    (m::ATTITUDE_QUATERNION_DATA::ID, 40_000.0),
    (m::HIGHRES_IMU_DATA::ID, 10_000.0),
    (m::GPS_RAW_INT_DATA::ID, 200_000.0),
    (m::GPS2_RAW_DATA::ID, 200_000.0),
    (m::ESTIMATOR_STATUS_DATA::ID, 1_000_000.0),
    (EKF_STATUS_REPORT, 1_000_000.0),
];
/// Messages with an attitude or a position that are not read.
const NOT_READ: [(u32, &str); 2] = [
    (m::ATTITUDE_DATA::ID, m::ATTITUDE_DATA::NAME),
    (m::GLOBAL_POSITION_INT_DATA::ID, m::GLOBAL_POSITION_INT_DATA::NAME),
];
/// Number of attitudes rejected after a report without that flag (10 s at 25 Hz), unless a report with it arrives.
const UNFIT: u16 = 250;
/// `quality` of ODOMETRY when the odometry has failed: -1 instead of 0 to 100 %.
const FAILED: i8 = -1;
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
    /// The estimator reports that its yaw is not aligned.
    unaligned: bool,
    account: Account,
    requests: u32,
}

/// Value in millimetres as m. None if zero, which means unknown.
fn known_mm(mm: u32) -> Option<f64> {
    if mm > 0 { Some(f64::from(mm) * 1e-3) } else { None }
}
fn ns(time_us: u64) -> i64 {
    i64::try_from(time_us.saturating_mul(1000)).unwrap_or(i64::MAX)
}
/// Accelerometers and gyroscopes.
fn inertial() -> m::HighresImuUpdatedFlags {
    m::HighresImuUpdatedFlags::from_bits_retain(0x3f)
}
/// Report of the second receiver as one of the first.
fn as_first(d: &m::GPS2_RAW_DATA) -> m::GPS_RAW_INT_DATA {
    m::GPS_RAW_INT_DATA {
        time_usec: d.time_usec,
        lat: d.lat,
        lon: d.lon,
        alt: d.alt,
        vel: d.vel,
        cog: d.cog,
        fix_type: d.fix_type,
        alt_ellipsoid: d.alt_ellipsoid,
        h_acc: d.h_acc,
        v_acc: d.v_acc,
        vel_acc: d.vel_acc,
        yaw: d.yaw,
        ..m::GPS_RAW_INT_DATA::DEFAULT
    }
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

    fn take(&mut self, raw: &RawFrame, out: &mut Vec<SourceMeasurement>) {
        use m::MavMessage as M;
        let before = out.len();
        let message = raw.message();
        let understood = match &message {
            Some(M::ATTITUDE_QUATERNION(_)) if self.is_unfit() => {
                self.leave_out("ATTITUDE_QUATERNION", Why::Invalid)
            }
            Some(M::ODOMETRY(d)) if self.is_unfit() || d.quality == FAILED => {
                self.leave_out("ODOMETRY", Why::Invalid)
            }
            Some(M::ATTITUDE_QUATERNION(d)) => {
                let attitude = fields!(d, q1 q2 q3 q4);
                let rates = fields!(d, rollspeed pitchspeed yawspeed);
                let at_ns = i64::from(d.time_boot_ms) * 1_000_000;
                self.attitude(at_ns, attitude.map(f64::from), rates.map(f64::from), out)
            }
            Some(M::HIGHRES_IMU(d)) => {
                let force = fields!(d, xacc yacc zacc).map(f64::from);
                let rates = fields!(d, xgyro ygyro zgyro).map(f64::from);
                if d.fields_updated.contains(inertial()) {
                    self.imu(ns(d.time_usec), force, rates, 0, out)
                } else {
                    Some(())
                }
            }
            Some(M::RAW_IMU(d)) => {
                let force = fields!(d, xacc yacc zacc).map(|a| f64::from(a) * MILLI_G);
                let rates = fields!(d, xgyro ygyro zgyro).map(|w| f64::from(w) * 1e-3);
                self.imu(ns(d.time_usec), force, rates, 1, out)
            }
            Some(M::GPS_RAW_INT(d)) => self.gps(d, 0, out),
            Some(M::GPS2_RAW(d)) => self.gps(&as_first(d), 1, out),
            Some(M::GPS_GLOBAL_ORIGIN(d)) => {
                self.origin = Some(mavlink::place(d.latitude, d.longitude, d.altitude));
                Some(())
            }
            Some(M::ODOMETRY(d)) => self.odometry(d, out),
            Some(M::ESTIMATOR_STATUS(d)) => self.estimator(d.flags),
            Some(_) | None => match raw.ekf_status() {
                // An autopilot without this estimator sends zero.
                Some(flags) if flags.is_empty() => Some(()),
                Some(flags) => self.estimator(flags),
                None => {
                    self.decoded.ignored += 1;
                    if let Some((_, name)) = NOT_READ.iter().find(|(known, _)| *known == raw.id) {
                        self.account.leave_out(name, Why::NotRead);
                    }
                    return;
                }
            },
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
    fn estimator(&mut self, flags: m::EstimatorStatusFlags) -> Option<()> {
        use m::EstimatorStatusFlags as F;
        let is_fit = flags.contains(F::ESTIMATOR_ATTITUDE);
        self.unfit = if is_fit { 0 } else { UNFIT };
        // The attitude's flag needs only the tilt; a horizontal position needs the yaw.
        self.unaligned =
            !flags.contains(F::ESTIMATOR_POS_HORIZ_ABS) || flags.contains(F::ESTIMATOR_CONST_POS_MODE);
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
        rates: [f64; 3],
        out: &mut Vec<SourceMeasurement>,
    ) -> Option<()> {
        let [roll, pitch, yaw] = self.mounting.attitude(euler(q)?);
        let rates = finite(rates).map(|r| self.mounting.vector(r));
        let fix = AttitudeFix {
            rates,
            ..self.mounting.tilt([roll, pitch])
        };
        out.push(SourceMeasurement::new(at_ns, fix));
        if !self.gps_heading && at_ns.saturating_sub(self.heading_ns).saturating_abs() >= HEADING_STEP_NS {
            self.heading_ns = at_ns;
            if self.unaligned {
                return self.leave_out("yaw-not-aligned", Why::Invalid);
            }
            out.push(SourceMeasurement::new(at_ns, self.mounting.heading_fix(yaw)));
        }
        Some(())
    }

    fn gps(&mut self, d: &m::GPS_RAW_INT_DATA, source: u8, out: &mut Vec<SourceMeasurement>) -> Option<()> {
        let at_ns = ns(d.time_usec);
        let [name, yaw_name] = match source {
            0 => ["GPS_RAW_INT", "GPS_RAW_INT-yaw"],
            _ => ["GPS2_RAW", "GPS2_RAW-yaw"],
        };
        // 0 no receiver, 1 no fix, 2 two-dimensional, 3 and above three-dimensional.
        let kind = d.fix_type as u8;
        let Datum {
            latitude_deg,
            longitude_deg,
            height_m: sea_m,
        } = mavlink::place(d.lat, d.lon, d.alt);
        if kind >= 2 && (latitude_deg.abs() > 90.0 || longitude_deg.abs() > 180.0) {
            return None;
        }
        if kind == 1 {
            self.leave_out(name, Why::NoFix);
        }
        let across = known_mm(d.h_acc).unwrap_or(POSITION_SD[0]) * FAST_FRACTION;
        let down = known_mm(d.v_acc).unwrap_or(POSITION_SD[1]) * FAST_FRACTION;
        let (speed, course) = (f64::from(d.vel) * 0.01, (f64::from(d.cog) * 0.01).to_radians());
        let (velocity, velocity_sd) = if d.vel != u16::MAX && d.cog != u16::MAX {
            let sd = known_mm(d.vel_acc).unwrap_or(VELOCITY_SD).max(0.02);
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
            self.leave_out(name, Why::Nowhere);
        } else if kind >= 2 {
            // A height of zero above the ellipsoid means that the autopilot does not provide it.
            if d.alt_ellipsoid != 0 {
                self.separation = Some(f64::from(d.alt_ellipsoid) * 1e-3 - sea_m);
            }
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
        if (1..=36_000).contains(&d.yaw) {
            self.gps_heading = true;
            let heading = self.mounting.heading((f64::from(d.yaw) * 0.01).to_radians());
            let fix = HeadingFix {
                source,
                ..self.mounting.heading_fix(heading)
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        } else if d.yaw == u16::MAX {
            self.leave_out(yaw_name, Why::Invalid);
        }
        Some(())
    }

    fn odometry(&mut self, d: &m::ODOMETRY_DATA, out: &mut Vec<SourceMeasurement>) -> Option<()> {
        use m::MavFrame::{MAV_FRAME_BODY_FRD, MAV_FRAME_LOCAL_NED};
        if d.frame_id != MAV_FRAME_LOCAL_NED {
            return Some(());
        }
        let at_ns = ns(d.time_usec);
        let q = d.q.map(f64::from);
        let rates = fields!(d, rollspeed pitchspeed yawspeed).map(f64::from);
        self.attitude(at_ns, q, rates, out)?;
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
        let measured = finite(fields!(d, vx vy vz).map(f64::from)).map(Vector3::from);
        let velocity = match d.child_frame_id {
            MAV_FRAME_LOCAL_NED => measured,
            MAV_FRAME_BODY_FRD => measured.map(|v| turn * v),
            _ => None,
        };
        // Upper triangles of 6 x 6 matrices, row by row. The first element is NaN if the covariance is unknown.
        let sd = |variance: f32, otherwise: f64| {
            let sd = f64::from(variance).sqrt();
            if sd.is_finite() && sd > 0.0 {
                sd.clamp(0.005, 100.0)
            } else {
                otherwise
            }
        };
        let (p, v) = (&d.pose_covariance, &d.velocity_covariance);
        let position_sd = [sd(p[0], 0.5), sd(p[6], 0.5), sd(p[11], 1.0)];
        let velocity_sd = match velocity {
            Some(_) => [v[0], v[6], v[11]].map(|v| sd(v, VELOCITY_SD)),
            None => [NOT_MEASURED_SD; 3],
        };
        let velocity = velocity.unwrap_or_default().into();
        let fix = GnssFix {
            position: finite(fields!(d, x y z).map(f64::from))?,
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
                    self.take(&raw, out);
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

#[cfg(test)]
mod tests;

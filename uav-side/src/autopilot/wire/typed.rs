//! Typed messages to and from those of the dialect.

use alight_shared::mavlink::{
    CharArray, Outgoing,
    dialect::{self as m, MavFrame::MAV_FRAME_LOCAL_NED, MavMessage as M},
    fields,
};

use super::super::message::{
    Address, AttitudeThrustTarget, HilGps, HilSensor, MavlinkMessage, PositionTarget, TargetAbsolute,
    TargetRelative, narrow, text, wide,
};

const VELOCITY_FRAMES: [m::MavFrame; 2] = [MAV_FRAME_LOCAL_NED, m::MavFrame::MAV_FRAME_BODY_FRD];
const DOWN: m::MavSensorOrientation = m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270;

/// Message of the dialect as the link uses it; None for unused messages.
pub(super) fn decode(message: M) -> Option<MavlinkMessage> {
    Some(match &message {
        M::SET_POSITION_TARGET_LOCAL_NED(d) => MavlinkMessage::Position(PositionTarget {
            to: Address::new(d.target_system, d.target_component),
            position: wide(fields!(d, x y z)),
            velocity: wide(fields!(d, vx vy vz)),
            acceleration: wide(fields!(d, afx afy afz)),
            yaw: d.yaw.into(),
            yaw_rate: d.yaw_rate.into(),
        }),
        M::SET_ATTITUDE_TARGET(d) => {
            let ignored = m::AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE;
            MavlinkMessage::AttitudeThrust(AttitudeThrustTarget {
                to: Address::new(d.target_system, d.target_component),
                attitude: wide(d.q),
                rates: (!d.type_mask.contains(ignored))
                    .then(|| wide(fields!(d, body_roll_rate body_pitch_rate body_yaw_rate))),
                thrust: d.thrust.into(),
            })
        }
        M::STATUSTEXT(d) => MavlinkMessage::Text {
            severity: d.severity as u8,
            text: text(&d.text),
        },
        M::HIL_SENSOR(d) => MavlinkMessage::HilSensor(HilSensor {
            time_us: d.time_usec,
            accelerometer: wide(fields!(d, xacc yacc zacc)),
            gyro: wide(fields!(d, xgyro ygyro zgyro)),
            magnetometer: wide(fields!(d, xmag ymag zmag)),
            pressure_hpa: d.abs_pressure.into(),
            pressure_altitude_m: d.pressure_alt.into(),
            temperature_degc: d.temperature.into(),
        }),
        M::HIL_GPS(d) => MavlinkMessage::HilGps(HilGps {
            time_us: d.time_usec,
            latitude: (f64::from(d.lat) * 1e-7).to_radians(),
            longitude: (f64::from(d.lon) * 1e-7).to_radians(),
            altitude_m: f64::from(d.alt) * 1e-3,
            velocity: fields!(d, vn ve vd).map(|v| f64::from(v) * 0.01),
            sd_m: [d.eph, d.epv].map(|v| f64::from(v) * 0.01),
        }),
        // In other frames, and of rangefinders that do not point downwards.
        M::ODOMETRY(d)
            if d.frame_id != MAV_FRAME_LOCAL_NED || !VELOCITY_FRAMES.contains(&d.child_frame_id) =>
        {
            return None;
        }
        M::DISTANCE_SENSOR(d) if d.orientation != DOWN => return None,
        M::ODOMETRY(_)
        | M::DISTANCE_SENSOR(_)
        | M::GLOBAL_POSITION_INT(_)
        | M::FOLLOW_TARGET(_)
        | M::AIS_VESSEL(_)
        | M::LANDING_TARGET(_)
        | M::HEARTBEAT(_)
        | M::SYS_STATUS(_)
        | M::PARAM_REQUEST_READ(_)
        | M::PARAM_REQUEST_LIST(_)
        | M::PARAM_VALUE(_)
        | M::PARAM_SET(_)
        | M::GPS_RAW_INT(_)
        | M::SCALED_IMU(_)
        | M::ATTITUDE_QUATERNION(_)
        | M::LOCAL_POSITION_NED(_)
        | M::SERVO_OUTPUT_RAW(_)
        | M::MISSION_CURRENT(_)
        | M::MISSION_ITEM_REACHED(_)
        | M::GPS_GLOBAL_ORIGIN(_)
        | M::RC_CHANNELS(_)
        | M::RC_CHANNELS_OVERRIDE(_)
        | M::COMMAND_INT(_)
        | M::COMMAND_LONG(_)
        | M::COMMAND_ACK(_)
        | M::ATTITUDE_TARGET(_)
        | M::AUTOPILOT_VERSION(_)
        | M::HIL_ACTUATOR_CONTROLS(_)
        | M::HIGHRES_IMU(_)
        | M::TIMESYNC(_)
        | M::BATTERY_STATUS(_)
        | M::ESTIMATOR_STATUS(_)
        | M::GPS_RTCM_DATA(_)
        | M::HOME_POSITION(_)
        | M::EXTENDED_SYS_STATE(_)
        | M::NAMED_VALUE_FLOAT(_)
        | M::DEBUG_FLOAT_ARRAY(_)
        | M::CURRENT_MODE(_) => MavlinkMessage::Common(message),
        _ => return None,
    })
}

/// Message to send; None for texts, which [`status_texts`] encodes, and for reports that are only received.
pub(super) fn encode(message: &MavlinkMessage) -> Option<Outgoing> {
    let message = match message {
        MavlinkMessage::Common(message) => return Some(message.into()),
        MavlinkMessage::Position(p) => {
            // All fields are used except the time, which neither autopilot evaluates.
            let mut d = m::SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT;
            d.target_system = p.to.system;
            d.target_component = p.to.component;
            d.coordinate_frame = m::MavFrame::MAV_FRAME_LOCAL_NED;
            d.type_mask = m::PositionTargetTypemask::empty();
            fields!(d, x y z) = narrow(p.position);
            fields!(d, vx vy vz) = narrow(p.velocity);
            fields!(d, afx afy afz) = narrow(p.acceleration);
            [d.yaw, d.yaw_rate] = narrow([p.yaw, p.yaw_rate]);
            M::SET_POSITION_TARGET_LOCAL_NED(d)
        }
        MavlinkMessage::AttitudeThrust(a) => {
            use m::AttitudeTargetTypemask as Mask;
            let mut d = m::SET_ATTITUDE_TARGET_DATA::DEFAULT;
            d.target_system = a.to.system;
            d.target_component = a.to.component;
            d.type_mask = match a.rates {
                Some(_) => Mask::empty(),
                None => {
                    Mask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                        | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
                        | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
                }
            };
            d.q = narrow(a.attitude);
            fields!(d, body_roll_rate body_pitch_rate body_yaw_rate) = narrow(a.rates.unwrap_or_default());
            d.thrust = a.thrust as f32;
            M::SET_ATTITUDE_TARGET(d)
        }
        // MAVLink's development dialect.
        MavlinkMessage::TargetRelative(t) => return Some(Outgoing::new(511, 28, target_relative(t))),
        MavlinkMessage::TargetAbsolute(t) => return Some(Outgoing::new(510, 245, target_absolute(t))),
        MavlinkMessage::EkfStatus { flags } => {
            let flags = m::EstimatorStatusFlags::from_bits_retain(*flags);
            return Some(Outgoing::ekf_status(flags));
        }
        MavlinkMessage::Ais(_) | MavlinkMessage::RelativePlace(_) | MavlinkMessage::Text { .. } => {
            return None;
        }
        MavlinkMessage::HilSensor(s) => {
            let mut d = m::HIL_SENSOR_DATA::DEFAULT;
            d.time_usec = s.time_us;
            fields!(d, xacc yacc zacc) = narrow(s.accelerometer);
            fields!(d, xgyro ygyro zgyro) = narrow(s.gyro);
            fields!(d, xmag ymag zmag) = narrow(s.magnetometer);
            [d.abs_pressure, d.pressure_alt] = narrow([s.pressure_hpa, s.pressure_altitude_m]);
            d.temperature = s.temperature_degc as f32;
            // Accelerometer, gyroscope, magnetometer, pressure, altitude, temperature.
            d.fields_updated = m::HilSensorUpdatedFlags::from_bits_retain(0x1fff);
            M::HIL_SENSOR(d)
        }
        MavlinkMessage::HilGps(g) => {
            let centi = |v: f64| (v * 100.0).round();
            let [north, east, _] = g.velocity;
            let mut d = m::HIL_GPS_DATA::DEFAULT;
            d.time_usec = g.time_us;
            d.fix_type = 3;
            d.satellites_visible = 14;
            [d.lat, d.lon] = [g.latitude, g.longitude].map(|v| degrees(v.to_degrees()));
            d.alt = (g.altitude_m * 1e3).round() as i32;
            [d.eph, d.epv] = g.sd_m.map(|v| centi(v) as u16);
            fields!(d, vn ve vd) = g.velocity.map(|v| centi(v) as i16);
            d.vel = centi(north.hypot(east)) as u16;
            d.cog = (east.atan2(north).to_degrees().rem_euclid(360.0) * 100.0) as u16;
            M::HIL_GPS(d)
        }
    };
    Some(Outgoing::from(&message))
}

fn degrees(value: f64) -> i32 {
    (value * 1e7).round() as i32
}

/// Consecutive little-endian fields.
#[derive(Default)]
struct Payload(Vec<u8>);

impl Payload {
    fn floats(mut self, values: &[f64]) -> Payload {
        let bytes = values.iter().flat_map(|v| (*v as f32).to_le_bytes());
        self.0.extend(bytes);
        self
    }
    fn bytes(mut self, values: &[u8]) -> Payload {
        self.0.extend_from_slice(values);
        self
    }
}

/// `TARGET_RELATIVE`: time, position, its deviations, the heading's deviation, attitudes of the target and of
/// the sensor (none); number, frame (2: `TARGET_OBS_FRAME_LOCAL_OFFSET_NED`), type (2: fiducial marker).
fn target_relative(t: &TargetRelative) -> Vec<u8> {
    Payload::default()
        .bytes(&t.time_us.to_le_bytes())
        .floats(&t.position)
        .floats(&t.position_sd)
        .floats(&[t.yaw_sd])
        .floats(&t.attitude)
        .floats(&[1.0, 0.0, 0.0, 0.0])
        .bytes(&[0, 2, 2])
        .0
}
/// `TARGET_ABSOLUTE`: time, latitude, longitude, height above the sea, velocity, acceleration (not stated),
/// attitude, rates (not stated), deviations of position, velocity and acceleration; number, validity bits (1:
/// position, 2: velocity). The attitude makes the velocity along the target's axes equal to PX4's NED.
fn target_absolute(t: &TargetAbsolute) -> Vec<u8> {
    Payload::default()
        .bytes(&t.time_us.to_le_bytes())
        .bytes(&degrees(t.place.latitude_deg).to_le_bytes())
        .bytes(&degrees(t.place.longitude_deg).to_le_bytes())
        .floats(&[t.place.height_m])
        .floats(&t.velocity)
        .floats(&[0.0; 3])
        .floats(&[1.0, 0.0, 0.0, 0.0])
        .floats(&[0.0; 3])
        .floats(&t.place_sd)
        .floats(&t.velocity_sd)
        .floats(&[0.0; 3])
        .bytes(&[0, 1 | 2])
        .0
}

/// Maximum length of one `STATUSTEXT`, bytes.
const TEXT: usize = 50;
/// Parts of a text with a common number; a single part has none, and the last part is not full.
pub(super) fn status_texts(severity: m::MavSeverity, text: &str, number: u16) -> Vec<m::STATUSTEXT_DATA> {
    let id = if text.len() > TEXT { number } else { 0 };
    let full = text.as_bytes().chunks_exact(TEXT);
    let rest = Some(full.remainder()).filter(|rest| id != 0 || !rest.is_empty() || text.is_empty());
    let part = |(chunk_seq, part): (u8, &[u8])| {
        let mut text = [0; TEXT];
        for (to, byte) in text.iter_mut().zip(part) {
            *to = *byte;
        }
        m::STATUSTEXT_DATA {
            severity,
            text: CharArray::new(text),
            id,
            chunk_seq,
        }
    };
    (0..=u8::MAX).zip(full.chain(rest)).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::geodesy::Datum;

    /// Offsets and lengths as in MAVLink's development dialect.
    #[test]
    fn targets_by_their_places() {
        let float = |bytes: &[u8], at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let floats = |bytes: &[u8], at: usize| [0, 4, 8].map(|k| float(bytes, at + k));
        let bytes = target_relative(&TargetRelative {
            time_us: 7,
            position: [1.0, 2.0, 3.0],
            position_sd: [0.5, 0.25, 0.125],
            attitude: [0.5, -0.5, 0.25, -0.25],
            yaw_sd: 0.75,
        });
        assert_eq!((bytes.len(), bytes[0]), (71, 7));
        let expected = [[1.0, 2.0, 3.0], [0.5, 0.25, 0.125], [0.75, 0.5, -0.5]];
        assert_eq!([8, 20, 32].map(|at| floats(&bytes, at)), expected);
        assert_eq!((float(&bytes, 52), &bytes[68..]), (1.0, &[0, 2, 2][..]));
        let bytes = target_absolute(&TargetAbsolute {
            time_us: 7,
            place: Datum::new(47.5, -8.25, 12.5),
            place_sd: [0.5, 0.25],
            velocity: [1.0, 2.0, 3.0],
            velocity_sd: [4.0, 5.0, 6.0],
        });
        let degrees = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!([degrees(8), degrees(12)], [475_000_000, -82_500_000]);
        let expected = [[12.5, 1.0, 2.0], [0.5, 0.25, 4.0]];
        assert_eq!([16, 72].map(|at| floats(&bytes, at)), expected);
        assert_eq!((bytes.len(), &bytes[104..]), (106, &[0, 3][..]));
    }
}

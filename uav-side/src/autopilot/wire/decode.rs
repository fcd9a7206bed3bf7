use alight_shared::geodesy::Datum;
use alight_shared::mavlink::{Fields, dialect as m};

use super::super::message::{
    Address, AttitudeReport, AttitudeThrustTarget, CommandLong, CommandResult, DistanceReport, Heartbeat,
    HilGps, HilSensor, ImuReport, MavlinkMessage, OdometryReport, ParameterValue, PositionReport,
    PositionTarget, RcChannels, VelocityFrame,
};
use super::super::place_report::{AisReport, PlaceReport};
use super::extension::{
    ACK_TO_AT, DISTANCE_INVALID, DISTANCE_QUALITY_AT, ELLIPSOID_HEIGHT_AT, RESET_COUNTER_AT,
};
use super::{text, wide};

/// Factor of `SCALED_IMU`, m/s² per mG.
const MILLI_G: f64 = 9.806_65e-3;

/// Decodes the messages that Alight uses, with extension fields taken from the payload.
pub(super) fn decode(message: m::MavMessage, payload: Fields<'_>) -> Option<MavlinkMessage> {
    use m::MavMessage as M;
    Some(match message {
        M::HEARTBEAT(d) => MavlinkMessage::Heartbeat(Heartbeat {
            autopilot: d.autopilot as u8,
            vehicle: d.mavtype as u8,
            base_mode: d.base_mode.bits(),
            custom_mode: d.custom_mode,
        }),
        M::TIMESYNC(d) => MavlinkMessage::Timesync {
            remote_ns: d.tc1,
            local_ns: d.ts1,
        },
        M::ODOMETRY(d) => MavlinkMessage::Odometry(odometry(&d, payload)?),
        M::LOCAL_POSITION_NED(d) => MavlinkMessage::LocalPosition(PositionReport {
            time_ms: d.time_boot_ms,
            position: wide([d.x, d.y, d.z]),
            velocity: wide([d.vx, d.vy, d.vz]),
        }),
        M::ATTITUDE_QUATERNION(d) => MavlinkMessage::Attitude(AttitudeReport {
            time_ms: d.time_boot_ms,
            attitude: wide([d.q1, d.q2, d.q3, d.q4]),
            rates: wide([d.rollspeed, d.pitchspeed, d.yawspeed]),
        }),
        M::HIGHRES_IMU(d) => MavlinkMessage::Imu(ImuReport {
            time_us: d.time_usec,
            accelerometer: wide([d.xacc, d.yacc, d.zacc]),
            gyro: wide([d.xgyro, d.ygyro, d.zgyro]),
        }),
        M::SCALED_IMU(d) => MavlinkMessage::Imu(ImuReport {
            time_us: u64::from(d.time_boot_ms) * 1000,
            accelerometer: [d.xacc, d.yacc, d.zacc].map(|a| f64::from(a) * MILLI_G),
            gyro: [d.xgyro, d.ygyro, d.zgyro].map(|w| f64::from(w) * 1e-3),
        }),
        M::DISTANCE_SENSOR(d) => {
            let down = d.orientation == m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270;
            if !down {
                return None;
            }
            let metres = |cm: u16| f64::from(cm) * 0.01;
            let is_invalid = payload.u8(DISTANCE_QUALITY_AT) == DISTANCE_INVALID;
            MavlinkMessage::Distance(DistanceReport {
                time_ms: d.time_boot_ms,
                // 0 m is invalid, because rangefinders cannot measure it.
                range_m: if is_invalid {
                    0.0
                } else {
                    metres(d.current_distance)
                },
                limits_m: [metres(d.min_distance), metres(d.max_distance)],
                // cm²; 255: unknown.
                variance: Some(d.covariance)
                    .filter(|c| !matches!(c, 0 | 255))
                    .map(|c| f64::from(c) * 1e-4),
            })
        }
        M::CURRENT_MODE(d) => MavlinkMessage::Mode {
            custom_mode: d.custom_mode,
        },
        M::EXTENDED_SYS_STATE(d) => MavlinkMessage::Landed {
            state: d.landed_state as u8,
        },
        M::BATTERY_STATUS(d) => MavlinkMessage::Battery {
            number: d.id,
            remaining: (0..=100)
                .contains(&d.battery_remaining)
                .then(|| f64::from(d.battery_remaining) * 0.01),
            voltage_v: volts(&d.voltages),
            current_a: (d.current_battery >= 0).then(|| f64::from(d.current_battery) * 0.01),
        },
        M::SERVO_OUTPUT_RAW(d) => MavlinkMessage::Outputs {
            port: d.port,
            pulses_us: [
                d.servo1_raw,
                d.servo2_raw,
                d.servo3_raw,
                d.servo4_raw,
                d.servo5_raw,
                d.servo6_raw,
                d.servo7_raw,
                d.servo8_raw,
            ],
        },
        M::ATTITUDE_TARGET(d) => MavlinkMessage::AttitudeTargetThrust {
            thrust: d.thrust.into(),
        },
        M::PARAM_REQUEST_LIST(d) => MavlinkMessage::ParameterList {
            to: Address::new(d.target_system, d.target_component),
        },
        M::PARAM_REQUEST_READ(d) => MavlinkMessage::ParameterRequest {
            to: Address::new(d.target_system, d.target_component),
            name: text(&d.param_id),
            // -1: the parameter is requested by name.
            index: u16::try_from(d.param_index).ok(),
        },
        M::PARAM_SET(d) => MavlinkMessage::ParameterSet {
            to: Address::new(d.target_system, d.target_component),
            name: text(&d.param_id),
            value: parameter(d.param_value, d.param_type),
        },
        M::PARAM_VALUE(d) => MavlinkMessage::Parameter {
            name: text(&d.param_id),
            value: parameter(d.param_value, d.param_type),
            index: d.param_index,
            count: d.param_count,
        },
        M::GPS_GLOBAL_ORIGIN(d) => MavlinkMessage::Origin(Datum::new(
            f64::from(d.latitude) * 1e-7,
            f64::from(d.longitude) * 1e-7,
            f64::from(d.altitude) * 1e-3,
        )),
        M::HOME_POSITION(d) => MavlinkMessage::Home(Datum::new(
            f64::from(d.latitude) * 1e-7,
            f64::from(d.longitude) * 1e-7,
            f64::from(d.altitude) * 1e-3,
        )),
        M::GPS_RAW_INT(d) => MavlinkMessage::GnssHeights {
            sea_m: f64::from(d.alt) * 1e-3,
            ellipsoid_m: payload.i32(ELLIPSOID_HEIGHT_AT) * 1e-3,
        },
        M::GLOBAL_POSITION_INT(d) => MavlinkMessage::GlobalPosition(PlaceReport {
            latitude_deg: f64::from(d.lat) * 1e-7,
            longitude_deg: f64::from(d.lon) * 1e-7,
            velocity: Some([d.vx, d.vy].map(|v| f64::from(v) * 0.01)),
            error_m: None,
        }),
        M::FOLLOW_TARGET(d) => MavlinkMessage::FollowTarget(PlaceReport {
            latitude_deg: f64::from(d.lat) * 1e-7,
            longitude_deg: f64::from(d.lon) * 1e-7,
            // Zeros mean that the velocity is unknown.
            velocity: Some([d.vel[0], d.vel[1]].map(f64::from)).filter(|v| *v != [0.0; 2]),
            error_m: Some(f64::from(d.position_cov[0])).filter(|m| *m > 0.0 && m.is_finite()),
        }),
        M::AIS_VESSEL(d) => MavlinkMessage::Ais(ais(&d)),
        M::GPS_RTCM_DATA(d) => MavlinkMessage::Rtcm {
            flags: d.flags,
            data: d.data.get(..usize::from(d.len))?.to_vec(),
        },
        M::COMMAND_LONG(d) => MavlinkMessage::Command(CommandLong {
            to: Address::new(d.target_system, d.target_component),
            command: d.command as u16,
            confirmation: d.confirmation,
            parameters: wide([
                d.param1, d.param2, d.param3, d.param4, d.param5, d.param6, d.param7,
            ]),
        }),
        M::COMMAND_INT(d) => MavlinkMessage::CommandInt {
            to: Address::new(d.target_system, d.target_component),
            command: d.command as u16,
            first: wide([d.param1, d.param2, d.param3, d.param4]),
        },
        M::COMMAND_ACK(d) => MavlinkMessage::CommandAck {
            command: d.command as u16,
            to: Address::new(payload.u8(ACK_TO_AT), payload.u8(ACK_TO_AT + 1)),
            result: match d.result {
                m::MavResult::MAV_RESULT_ACCEPTED => CommandResult::Accepted,
                m::MavResult::MAV_RESULT_TEMPORARILY_REJECTED => CommandResult::TemporarilyRejected,
                m::MavResult::MAV_RESULT_DENIED => CommandResult::Denied,
                m::MavResult::MAV_RESULT_UNSUPPORTED => CommandResult::Unsupported,
                m::MavResult::MAV_RESULT_FAILED => CommandResult::Failed,
                m::MavResult::MAV_RESULT_IN_PROGRESS => CommandResult::InProgress,
                _ => CommandResult::Other,
            },
        },
        M::SET_POSITION_TARGET_LOCAL_NED(d) => MavlinkMessage::Position(PositionTarget {
            to: Address::new(d.target_system, d.target_component),
            position: wide([d.x, d.y, d.z]),
            velocity: wide([d.vx, d.vy, d.vz]),
            acceleration: wide([d.afx, d.afy, d.afz]),
            yaw: d.yaw.into(),
            yaw_rate: d.yaw_rate.into(),
        }),
        M::SET_ATTITUDE_TARGET(d) => {
            let ignored = m::AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE;
            MavlinkMessage::AttitudeThrust(AttitudeThrustTarget {
                to: Address::new(d.target_system, d.target_component),
                attitude: wide(d.q),
                rates: (!d.type_mask.contains(ignored))
                    .then(|| wide([d.body_roll_rate, d.body_pitch_rate, d.body_yaw_rate])),
                thrust: d.thrust.into(),
            })
        }
        M::SYS_STATUS(d) => MavlinkMessage::SystemStatus {
            present: d.onboard_control_sensors_present.bits(),
            healthy: d.onboard_control_sensors_health.bits(),
        },
        M::RC_CHANNELS(d) => MavlinkMessage::RemoteControl(RcChannels {
            count: d.chancount,
            pulses_us: [
                d.chan1_raw,
                d.chan2_raw,
                d.chan3_raw,
                d.chan4_raw,
                d.chan5_raw,
                d.chan6_raw,
                d.chan7_raw,
                d.chan8_raw,
                d.chan9_raw,
                d.chan10_raw,
                d.chan11_raw,
                d.chan12_raw,
                d.chan13_raw,
                d.chan14_raw,
                d.chan15_raw,
                d.chan16_raw,
                d.chan17_raw,
                d.chan18_raw,
            ],
        }),
        M::RC_CHANNELS_OVERRIDE(d) => MavlinkMessage::RemoteControlOverride {
            to: Address::new(d.target_system, d.target_component),
            pulses_us: [
                d.chan1_raw,
                d.chan2_raw,
                d.chan3_raw,
                d.chan4_raw,
                d.chan5_raw,
                d.chan6_raw,
                d.chan7_raw,
                d.chan8_raw,
            ],
        },
        M::NAMED_VALUE_FLOAT(d) => MavlinkMessage::NamedValue {
            time_ms: d.time_boot_ms,
            name: text(&d.name),
            value: d.value.into(),
        },
        M::STATUSTEXT(d) => MavlinkMessage::Text {
            severity: d.severity as u8,
            text: text(&d.text),
        },
        M::HIL_SENSOR(d) => MavlinkMessage::HilSensor(HilSensor {
            time_us: d.time_usec,
            accelerometer: wide([d.xacc, d.yacc, d.zacc]),
            gyro: wide([d.xgyro, d.ygyro, d.zgyro]),
            magnetometer: wide([d.xmag, d.ymag, d.zmag]),
            pressure_hpa: d.abs_pressure.into(),
            pressure_altitude_m: d.pressure_alt.into(),
            temperature_degc: d.temperature.into(),
        }),
        M::HIL_GPS(d) => MavlinkMessage::HilGps(HilGps {
            time_us: d.time_usec,
            latitude: (f64::from(d.lat) * 1e-7).to_radians(),
            longitude: (f64::from(d.lon) * 1e-7).to_radians(),
            altitude_m: f64::from(d.alt) * 1e-3,
            velocity: [d.vn, d.ve, d.vd].map(|v| f64::from(v) * 0.01),
            sd_m: [d.eph, d.epv].map(|v| f64::from(v) * 0.01),
        }),
        M::HIL_ACTUATOR_CONTROLS(d) => MavlinkMessage::HilActuators {
            time_us: d.time_usec,
            controls: wide(d.controls),
            mode: d.mode.bits(),
        },
        _ => return None,
    })
}

/// The velocity requires a valid speed and course.
fn ais(d: &m::AIS_VESSEL_DATA) -> AisReport {
    let valid = m::AisFlags::AIS_FLAGS_VALID_COG | m::AisFlags::AIS_FLAGS_VALID_VELOCITY;
    let (sin, cos) = (f64::from(d.COG) * 0.01).to_radians().sin_cos();
    let speed_mps = f64::from(d.velocity) * 0.01;
    AisReport {
        mmsi: d.MMSI,
        place: PlaceReport {
            latitude_deg: f64::from(d.lat) * 1e-7,
            longitude_deg: f64::from(d.lon) * 1e-7,
            velocity: (d.flags.contains(valid)).then_some([speed_mps * cos, speed_mps * sin]),
            error_m: None,
        },
        age_s: f64::from(d.tslc),
    }
}

fn parameter(value: f32, kind: m::MavParamType) -> ParameterValue {
    use m::MavParamType::{MAV_PARAM_TYPE_REAL32, MAV_PARAM_TYPE_REAL64};
    ParameterValue {
        bits: value.to_bits(),
        integer: !matches!(kind, MAV_PARAM_TYPE_REAL32 | MAV_PARAM_TYPE_REAL64),
    }
}

/// Battery voltage, V, from its cell voltages, mV. The first one may be the total; 65535: not measured.
fn volts(cells: &[u16]) -> Option<f64> {
    let known = cells.iter().filter(|v| !matches!(**v, 0 | u16::MAX));
    let sum: f64 = known.map(|v| f64::from(*v)).sum();
    (sum > 0.0).then_some(sum * 1e-3)
}

fn odometry(d: &m::ODOMETRY_DATA, payload: Fields<'_>) -> Option<OdometryReport> {
    use m::MavFrame as F;
    // Other frames, e.g. a camera's, are not NED.
    if d.frame_id != F::MAV_FRAME_LOCAL_NED {
        return None;
    }
    let frame = match d.child_frame_id {
        F::MAV_FRAME_LOCAL_NED => VelocityFrame::Ned,
        F::MAV_FRAME_BODY_FRD => VelocityFrame::Body,
        _ => return None,
    };
    let (p, v) = (wide(d.pose_covariance), wide(d.velocity_covariance));
    // Upper triangles of 6 x 6 matrices, row by row; the first element of an unknown covariance is NaN.
    let known = p[0].is_finite() && v[0].is_finite();
    Some(OdometryReport {
        time_us: d.time_usec,
        position: wide([d.x, d.y, d.z]),
        attitude: wide(d.q),
        velocity: wide([d.vx, d.vy, d.vz]),
        frame,
        rates: wide([d.rollspeed, d.pitchspeed, d.yawspeed]),
        variances: known.then_some([[p[0], p[6], p[11]], [p[15], p[18], p[20]], [v[0], v[6], v[11]]]),
        resets: payload.u8(RESET_COUNTER_AT),
    })
}

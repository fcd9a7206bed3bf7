//! Our words in the dialect's.

use alight_shared::mavlink::dialect as m;
use num_traits::FromPrimitive;

use super::super::message::{CommandResult, Message};
use super::{chars, narrow};

/// A message in the dialect's words.
pub(super) fn encode(message: &Message) -> Option<m::MavMessage> {
    use m::MavMessage as M;
    Some(match message {
        Message::Heartbeat {
            autopilot,
            vehicle,
            base_mode,
            custom_mode,
        } => M::HEARTBEAT(m::HEARTBEAT_DATA {
            autopilot: m::MavAutopilot::from_u8(*autopilot)?,
            mavtype: m::MavType::from_u8(*vehicle)?,
            base_mode: m::MavModeFlag::from_bits_retain(*base_mode),
            custom_mode: *custom_mode,
            system_status: m::MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        }),
        Message::Timesync { remote_ns, local_ns } => M::TIMESYNC(m::TIMESYNC_DATA {
            tc1: *remote_ns,
            ts1: *local_ns,
        }),
        Message::LocalPosition {
            time_ms,
            position,
            velocity,
        } => {
            let ([x, y, z], [vx, vy, vz]) = (narrow(*position), narrow(*velocity));
            M::LOCAL_POSITION_NED(m::LOCAL_POSITION_NED_DATA {
                time_boot_ms: *time_ms,
                x,
                y,
                z,
                vx,
                vy,
                vz,
            })
        }
        Message::Attitude {
            time_ms,
            attitude,
            rates,
        } => {
            let ([q1, q2, q3, q4], [rollspeed, pitchspeed, yawspeed]) = (narrow(*attitude), narrow(*rates));
            M::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
                time_boot_ms: *time_ms,
                q1,
                q2,
                q3,
                q4,
                rollspeed,
                pitchspeed,
                yawspeed,
            })
        }
        Message::Imu {
            time_us,
            accelerometer,
            gyro,
        } => {
            let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro]) = (narrow(*accelerometer), narrow(*gyro));
            M::HIGHRES_IMU(m::HIGHRES_IMU_DATA {
                time_usec: *time_us,
                xacc,
                yacc,
                zacc,
                xgyro,
                ygyro,
                zgyro,
                ..m::HIGHRES_IMU_DATA::DEFAULT
            })
        }
        Message::Distance {
            time_ms,
            range_m,
            limits_m,
            variance,
        } => {
            // `as` saturates and maps NaN to zero.
            let cm = |v: f64| (v * 100.0).round() as u16;
            M::DISTANCE_SENSOR(m::DISTANCE_SENSOR_DATA {
                time_boot_ms: *time_ms,
                min_distance: cm(limits_m[0]),
                max_distance: cm(limits_m[1]),
                current_distance: cm(*range_m),
                orientation: m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
                covariance: variance.map_or(255, |v| (v * 1e4).round().clamp(1.0, 254.0) as u8),
                ..m::DISTANCE_SENSOR_DATA::DEFAULT
            })
        }
        Message::Mode { custom_mode } => M::CURRENT_MODE(m::CURRENT_MODE_DATA {
            custom_mode: *custom_mode,
            intended_custom_mode: *custom_mode,
            ..m::CURRENT_MODE_DATA::DEFAULT
        }),
        Message::Landed { state } => M::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
            landed_state: m::MavLandedState::from_u8(*state)?,
            ..m::EXTENDED_SYS_STATE_DATA::DEFAULT
        }),
        Message::Battery { number, remaining } => M::BATTERY_STATUS(m::BATTERY_STATUS_DATA {
            id: *number,
            battery_remaining: remaining.map_or(-1, |r| (r * 100.0).round() as i8),
            ..m::BATTERY_STATUS_DATA::DEFAULT
        }),
        Message::AttitudeTargetThrust { thrust } => M::ATTITUDE_TARGET(m::ATTITUDE_TARGET_DATA {
            thrust: *thrust as f32,
            ..m::ATTITUDE_TARGET_DATA::DEFAULT
        }),
        Message::ParameterRequest { to, name } => M::PARAM_REQUEST_READ(m::PARAM_REQUEST_READ_DATA {
            target_system: to.system,
            target_component: to.component,
            param_id: chars(name),
            // By name.
            param_index: -1,
        }),
        Message::Parameter { name, value } => M::PARAM_VALUE(m::PARAM_VALUE_DATA {
            param_id: chars(name),
            param_value: *value as f32,
            ..m::PARAM_VALUE_DATA::DEFAULT
        }),
        Message::Origin(d) => M::GPS_GLOBAL_ORIGIN(m::GPS_GLOBAL_ORIGIN_DATA {
            latitude: (d.latitude_deg * 1e7).round() as i32,
            longitude: (d.longitude_deg * 1e7).round() as i32,
            altitude: (d.height_m * 1e3).round() as i32,
        }),
        Message::Command(c) => {
            let [param1, param2, param3, param4, param5, param6, param7] = narrow(c.parameters);
            M::COMMAND_LONG(m::COMMAND_LONG_DATA {
                target_system: c.to.system,
                target_component: c.to.component,
                command: m::MavCmd::from_u16(c.command)?,
                confirmation: c.confirmation,
                param1,
                param2,
                param3,
                param4,
                param5,
                param6,
                param7,
            })
        }
        Message::CommandAck { command, result } => M::COMMAND_ACK(m::COMMAND_ACK_DATA {
            command: m::MavCmd::from_u16(*command)?,
            result: match result {
                CommandResult::Accepted => m::MavResult::MAV_RESULT_ACCEPTED,
                CommandResult::TemporarilyRejected => m::MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                CommandResult::Denied => m::MavResult::MAV_RESULT_DENIED,
                CommandResult::Unsupported => m::MavResult::MAV_RESULT_UNSUPPORTED,
                CommandResult::Failed => m::MavResult::MAV_RESULT_FAILED,
                CommandResult::InProgress => m::MavResult::MAV_RESULT_IN_PROGRESS,
                CommandResult::Other => m::MavResult::MAV_RESULT_CANCELLED,
            },
        }),
        Message::Position(p) => {
            let ([x, y, z], [vx, vy, vz]) = (narrow(p.position), narrow(p.velocity));
            let [afx, afy, afz] = narrow(p.acceleration);
            M::SET_POSITION_TARGET_LOCAL_NED(m::SET_POSITION_TARGET_LOCAL_NED_DATA {
                // Not used by either autopilot; its own time would be the autopilot's.
                time_boot_ms: 0,
                target_system: p.to.system,
                target_component: p.to.component,
                coordinate_frame: m::MavFrame::MAV_FRAME_LOCAL_NED,
                // Nothing is to be ignored.
                type_mask: m::PositionTargetTypemask::empty(),
                x,
                y,
                z,
                vx,
                vy,
                vz,
                afx,
                afy,
                afz,
                yaw: p.yaw as f32,
                yaw_rate: p.yaw_rate as f32,
            })
        }
        Message::AttitudeThrust(a) => {
            use m::AttitudeTargetTypemask as Mask;
            let [body_roll_rate, body_pitch_rate, body_yaw_rate] = narrow(a.rates.unwrap_or_default());
            M::SET_ATTITUDE_TARGET(m::SET_ATTITUDE_TARGET_DATA {
                time_boot_ms: 0,
                target_system: a.to.system,
                target_component: a.to.component,
                type_mask: match a.rates {
                    Some(_) => Mask::empty(),
                    None => {
                        Mask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                            | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
                            | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
                    }
                },
                q: narrow(a.attitude),
                body_roll_rate,
                body_pitch_rate,
                body_yaw_rate,
                thrust: a.thrust as f32,
            })
        }
        // Made byte by byte.
        Message::Odometry(_) | Message::LandingTarget { .. } | Message::Deck { .. } => return None,
        Message::Text { severity, text } => M::STATUSTEXT(m::STATUSTEXT_DATA {
            severity: m::MavSeverity::from_u8(*severity)?,
            text: chars(text),
        }),
        Message::HilSensor(s) => {
            let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro]) = (narrow(s.accelerometer), narrow(s.gyro));
            let [xmag, ymag, zmag] = narrow(s.magnetometer);
            M::HIL_SENSOR(m::HIL_SENSOR_DATA {
                time_usec: s.time_us,
                xacc,
                yacc,
                zacc,
                xgyro,
                ygyro,
                zgyro,
                xmag,
                ymag,
                zmag,
                abs_pressure: s.pressure_hpa as f32,
                diff_pressure: 0.0,
                pressure_alt: s.pressure_altitude_m as f32,
                temperature: s.temperature_degc as f32,
                // Accelerometer, gyroscope, magnetometer, pressure, altitude, temperature.
                fields_updated: m::HilSensorUpdatedFlags::from_bits_retain(0x1fff),
            })
        }
        Message::HilGps(g) => {
            let degrees = |v: f64| (v.to_degrees() * 1e7).round() as i32;
            let [vn, ve, vd] = g.velocity.map(|v| (v * 100.0).round() as i16);
            let [north, east, _] = g.velocity;
            M::HIL_GPS(m::HIL_GPS_DATA {
                time_usec: g.time_us,
                fix_type: 3,
                lat: degrees(g.latitude),
                lon: degrees(g.longitude),
                alt: (g.altitude_m * 1e3).round() as i32,
                eph: (g.sd_m[0] * 100.0).round() as u16,
                epv: (g.sd_m[1] * 100.0).round() as u16,
                vel: (north.hypot(east) * 100.0).round() as u16,
                vn,
                ve,
                vd,
                cog: (east.atan2(north).to_degrees().rem_euclid(360.0) * 100.0) as u16,
                satellites_visible: 14,
            })
        }
        Message::HilActuators {
            time_us,
            controls,
            mode,
        } => M::HIL_ACTUATOR_CONTROLS(m::HIL_ACTUATOR_CONTROLS_DATA {
            time_usec: *time_us,
            controls: narrow(*controls),
            mode: m::MavModeFlag::from_bits_retain(*mode),
            ..m::HIL_ACTUATOR_CONTROLS_DATA::DEFAULT
        }),
    })
}

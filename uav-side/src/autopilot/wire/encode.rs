use alight_shared::mavlink::dialect as m;
use num_traits::FromPrimitive;

use super::super::message::{MavlinkMessage, ParameterValue};
use super::{chars, narrow};

/// Encodes a message; None if its payload is encoded byte by byte, or for a number unknown to the dialect.
pub(super) fn encode(message: &MavlinkMessage) -> Option<m::MavMessage> {
    use m::MavMessage as M;
    Some(match message {
        MavlinkMessage::Heartbeat(h) => M::HEARTBEAT(m::HEARTBEAT_DATA {
            autopilot: m::MavAutopilot::from_u8(h.autopilot)?,
            mavtype: m::MavType::from_u8(h.vehicle)?,
            base_mode: m::MavModeFlag::from_bits_retain(h.base_mode),
            custom_mode: h.custom_mode,
            system_status: m::MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        }),
        MavlinkMessage::Timesync { remote_ns, local_ns } => M::TIMESYNC(m::TIMESYNC_DATA {
            tc1: *remote_ns,
            ts1: *local_ns,
        }),
        MavlinkMessage::LocalPosition(p) => {
            let mut d = m::LOCAL_POSITION_NED_DATA::DEFAULT;
            d.time_boot_ms = p.time_ms;
            [d.x, d.y, d.z] = narrow(p.position);
            [d.vx, d.vy, d.vz] = narrow(p.velocity);
            M::LOCAL_POSITION_NED(d)
        }
        MavlinkMessage::Attitude(a) => {
            let mut d = m::ATTITUDE_QUATERNION_DATA::DEFAULT;
            d.time_boot_ms = a.time_ms;
            [d.q1, d.q2, d.q3, d.q4] = narrow(a.attitude);
            [d.rollspeed, d.pitchspeed, d.yawspeed] = narrow(a.rates);
            M::ATTITUDE_QUATERNION(d)
        }
        MavlinkMessage::Imu(i) => {
            let mut d = m::HIGHRES_IMU_DATA::DEFAULT;
            d.time_usec = i.time_us;
            [d.xacc, d.yacc, d.zacc] = narrow(i.accelerometer);
            [d.xgyro, d.ygyro, d.zgyro] = narrow(i.gyro);
            M::HIGHRES_IMU(d)
        }
        MavlinkMessage::Distance(s) => {
            // `as` saturates and maps NaN to zero.
            let cm = |v: f64| (v * 100.0).round() as u16;
            M::DISTANCE_SENSOR(m::DISTANCE_SENSOR_DATA {
                time_boot_ms: s.time_ms,
                min_distance: cm(s.limits_m[0]),
                max_distance: cm(s.limits_m[1]),
                current_distance: cm(s.range_m),
                orientation: m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
                covariance: s
                    .variance
                    .map_or(255, |v| (v * 1e4).round().clamp(1.0, 254.0) as u8),
                ..m::DISTANCE_SENSOR_DATA::DEFAULT
            })
        }
        MavlinkMessage::GlobalPosition(p) => {
            let mut d = m::GLOBAL_POSITION_INT_DATA::DEFAULT;
            [d.lat, d.lon] = [p.latitude_deg, p.longitude_deg].map(|v| (v * 1e7).round() as i32);
            [d.vx, d.vy] = p.velocity.unwrap_or_default().map(|v| (v * 100.0).round() as i16);
            M::GLOBAL_POSITION_INT(d)
        }
        MavlinkMessage::FollowTarget(p) => {
            let mut d = m::FOLLOW_TARGET_DATA::DEFAULT;
            [d.lat, d.lon] = [p.latitude_deg, p.longitude_deg].map(|v| (v * 1e7).round() as i32);
            let [north, east] = p.velocity.unwrap_or_default();
            d.vel = narrow([north, east, 0.0]);
            d.position_cov = narrow([p.error_m.unwrap_or(0.0), 0.0, 0.0]);
            M::FOLLOW_TARGET(d)
        }
        MavlinkMessage::Ais(r) => {
            let mut d = m::AIS_VESSEL_DATA::DEFAULT;
            d.MMSI = r.mmsi;
            [d.lat, d.lon] = [r.place.latitude_deg, r.place.longitude_deg].map(|v| (v * 1e7).round() as i32);
            d.tslc = r.age_s.round() as u16;
            d.flags = m::AisFlags::empty();
            if let Some([north, east]) = r.place.velocity {
                d.flags = m::AisFlags::AIS_FLAGS_VALID_COG | m::AisFlags::AIS_FLAGS_VALID_VELOCITY;
                d.velocity = (north.hypot(east) * 100.0).round() as u16;
                let course_deg = f64::atan2(east, north).to_degrees().rem_euclid(360.0);
                d.COG = (course_deg * 100.0).round() as u16;
            }
            M::AIS_VESSEL(d)
        }
        MavlinkMessage::Mode { custom_mode } => M::CURRENT_MODE(m::CURRENT_MODE_DATA {
            custom_mode: *custom_mode,
            intended_custom_mode: *custom_mode,
            ..m::CURRENT_MODE_DATA::DEFAULT
        }),
        MavlinkMessage::Landed { state } => M::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
            landed_state: m::MavLandedState::from_u8(*state)?,
            ..m::EXTENDED_SYS_STATE_DATA::DEFAULT
        }),
        MavlinkMessage::Battery {
            number,
            remaining,
            voltage_v,
            current_a,
        } => M::BATTERY_STATUS(m::BATTERY_STATUS_DATA {
            id: *number,
            // Battery voltage as that of the first cell, mV, and current, cA.
            voltages: core::array::from_fn(|k| match voltage_v {
                Some(v) if k == 0 => (v * 1e3).round() as u16,
                Some(_) | None => u16::MAX,
            }),
            current_battery: current_a.map_or(-1, |a| (a * 1e2).round() as i16),
            battery_remaining: remaining.map_or(-1, |r| (r * 100.0).round() as i8),
            ..m::BATTERY_STATUS_DATA::DEFAULT
        }),
        MavlinkMessage::Outputs { port, pulses_us } => {
            let mut d = m::SERVO_OUTPUT_RAW_DATA::DEFAULT;
            d.port = *port;
            [
                d.servo1_raw,
                d.servo2_raw,
                d.servo3_raw,
                d.servo4_raw,
                d.servo5_raw,
                d.servo6_raw,
                d.servo7_raw,
                d.servo8_raw,
            ] = *pulses_us;
            M::SERVO_OUTPUT_RAW(d)
        }
        MavlinkMessage::AttitudeTargetThrust { thrust } => M::ATTITUDE_TARGET(m::ATTITUDE_TARGET_DATA {
            thrust: *thrust as f32,
            ..m::ATTITUDE_TARGET_DATA::DEFAULT
        }),
        MavlinkMessage::ParameterList { to } => M::PARAM_REQUEST_LIST(m::PARAM_REQUEST_LIST_DATA {
            target_system: to.system,
            target_component: to.component,
        }),
        MavlinkMessage::ParameterRequest { to, name, index } => {
            M::PARAM_REQUEST_READ(m::PARAM_REQUEST_READ_DATA {
                target_system: to.system,
                target_component: to.component,
                param_id: chars(name),
                // -1: the parameter is requested by name.
                param_index: index.and_then(|k| i16::try_from(k).ok()).unwrap_or(-1),
            })
        }
        MavlinkMessage::ParameterSet { to, name, value } => M::PARAM_SET(m::PARAM_SET_DATA {
            target_system: to.system,
            target_component: to.component,
            param_id: chars(name),
            param_value: f32::from_bits(value.bits),
            param_type: kind(*value),
        }),
        MavlinkMessage::Parameter {
            name,
            value,
            index,
            count,
        } => M::PARAM_VALUE(m::PARAM_VALUE_DATA {
            param_id: chars(name),
            param_value: f32::from_bits(value.bits),
            param_type: kind(*value),
            param_index: *index,
            param_count: *count,
        }),
        MavlinkMessage::Origin(o) => M::GPS_GLOBAL_ORIGIN(m::GPS_GLOBAL_ORIGIN_DATA {
            latitude: (o.latitude_deg * 1e7).round() as i32,
            longitude: (o.longitude_deg * 1e7).round() as i32,
            altitude: (o.height_m * 1e3).round() as i32,
        }),
        MavlinkMessage::Home(home) => M::HOME_POSITION(m::HOME_POSITION_DATA {
            latitude: (home.latitude_deg * 1e7).round() as i32,
            longitude: (home.longitude_deg * 1e7).round() as i32,
            altitude: (home.height_m * 1e3).round() as i32,
            ..m::HOME_POSITION_DATA::DEFAULT
        }),
        MavlinkMessage::Command(c) => {
            let mut d = m::COMMAND_LONG_DATA::DEFAULT;
            (d.target_system, d.target_component) = (c.to.system, c.to.component);
            d.command = m::MavCmd::from_u16(c.command)?;
            d.confirmation = c.confirmation;
            [
                d.param1, d.param2, d.param3, d.param4, d.param5, d.param6, d.param7,
            ] = narrow(c.parameters);
            M::COMMAND_LONG(d)
        }
        MavlinkMessage::CommandInt { to, command, first } => {
            let mut d = m::COMMAND_INT_DATA::DEFAULT;
            (d.target_system, d.target_component) = (to.system, to.component);
            d.command = m::MavCmd::from_u16(*command)?;
            [d.param1, d.param2, d.param3, d.param4] = narrow(*first);
            M::COMMAND_INT(d)
        }
        MavlinkMessage::Position(p) => {
            // All fields are used except the time, which neither autopilot evaluates.
            let mut d = m::SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT;
            (d.target_system, d.target_component) = (p.to.system, p.to.component);
            d.coordinate_frame = m::MavFrame::MAV_FRAME_LOCAL_NED;
            d.type_mask = m::PositionTargetTypemask::empty();
            [d.x, d.y, d.z] = narrow(p.position);
            [d.vx, d.vy, d.vz] = narrow(p.velocity);
            [d.afx, d.afy, d.afz] = narrow(p.acceleration);
            [d.yaw, d.yaw_rate] = narrow([p.yaw, p.yaw_rate]);
            M::SET_POSITION_TARGET_LOCAL_NED(d)
        }
        MavlinkMessage::AttitudeThrust(a) => {
            use m::AttitudeTargetTypemask as Mask;
            let mut d = m::SET_ATTITUDE_TARGET_DATA::DEFAULT;
            (d.target_system, d.target_component) = (a.to.system, a.to.component);
            d.type_mask = match a.rates {
                Some(_) => Mask::empty(),
                None => {
                    Mask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                        | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
                        | Mask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
                }
            };
            d.q = narrow(a.attitude);
            [d.body_roll_rate, d.body_pitch_rate, d.body_yaw_rate] = narrow(a.rates.unwrap_or_default());
            d.thrust = a.thrust as f32;
            M::SET_ATTITUDE_TARGET(d)
        }
        MavlinkMessage::Rtcm { flags, data } => {
            let mut d = m::GPS_RTCM_DATA_DATA::DEFAULT;
            (d.flags, d.len) = (*flags, u8::try_from(data.len()).ok()?);
            d.data.get_mut(..data.len())?.copy_from_slice(data);
            M::GPS_RTCM_DATA(d)
        }
        // Received from the drone's own receiver, never sent.
        MavlinkMessage::RelativePlace(_) => return None,
        // Encoded byte by byte.
        MavlinkMessage::Odometry(_)
        | MavlinkMessage::Text { .. }
        | MavlinkMessage::CommandAck { .. }
        | MavlinkMessage::GnssHeights { .. }
        | MavlinkMessage::EstimatorStatus { .. }
        | MavlinkMessage::EkfStatus { .. }
        | MavlinkMessage::MissionCurrent { .. }
        | MavlinkMessage::MissionItemReached { .. }
        | MavlinkMessage::LandingTarget(_)
        | MavlinkMessage::TargetRelative(_)
        | MavlinkMessage::TargetAbsolute(_)
        | MavlinkMessage::Deck { .. } => return None,
        MavlinkMessage::SystemStatus { present, healthy } => {
            let sensors = m::MavSysStatusSensor::from_bits_retain;
            M::SYS_STATUS(m::SYS_STATUS_DATA {
                onboard_control_sensors_present: sensors(*present),
                onboard_control_sensors_enabled: sensors(*present),
                onboard_control_sensors_health: sensors(*healthy),
                ..m::SYS_STATUS_DATA::DEFAULT
            })
        }
        MavlinkMessage::RemoteControl(c) => {
            let mut d = m::RC_CHANNELS_DATA::DEFAULT;
            d.chancount = c.count;
            [
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
            ] = c.pulses_us;
            d.rssi = u8::MAX;
            M::RC_CHANNELS(d)
        }
        MavlinkMessage::RemoteControlOverride { to, pulses_us } => {
            let mut d = m::RC_CHANNELS_OVERRIDE_DATA::DEFAULT;
            (d.target_system, d.target_component) = (to.system, to.component);
            [
                d.chan1_raw,
                d.chan2_raw,
                d.chan3_raw,
                d.chan4_raw,
                d.chan5_raw,
                d.chan6_raw,
                d.chan7_raw,
                d.chan8_raw,
            ] = *pulses_us;
            M::RC_CHANNELS_OVERRIDE(d)
        }
        MavlinkMessage::NamedValue { time_ms, name, value } => {
            M::NAMED_VALUE_FLOAT(m::NAMED_VALUE_FLOAT_DATA {
                time_boot_ms: *time_ms,
                value: *value as f32,
                name: chars(name),
            })
        }
        MavlinkMessage::HilSensor(s) => {
            let mut d = m::HIL_SENSOR_DATA::DEFAULT;
            d.time_usec = s.time_us;
            [d.xacc, d.yacc, d.zacc] = narrow(s.accelerometer);
            [d.xgyro, d.ygyro, d.zgyro] = narrow(s.gyro);
            [d.xmag, d.ymag, d.zmag] = narrow(s.magnetometer);
            [d.abs_pressure, d.pressure_alt] = narrow([s.pressure_hpa, s.pressure_altitude_m]);
            d.temperature = s.temperature_degc as f32;
            // Accelerometer, gyroscope, magnetometer, pressure, altitude, temperature.
            d.fields_updated = m::HilSensorUpdatedFlags::from_bits_retain(0x1fff);
            M::HIL_SENSOR(d)
        }
        MavlinkMessage::HilGps(g) => {
            let degrees = |v: f64| (v.to_degrees() * 1e7).round() as i32;
            let centi = |v: f64| (v * 100.0).round();
            let [north, east, _] = g.velocity;
            let mut d = m::HIL_GPS_DATA::DEFAULT;
            d.time_usec = g.time_us;
            (d.fix_type, d.satellites_visible) = (3, 14);
            (d.lat, d.lon) = (degrees(g.latitude), degrees(g.longitude));
            d.alt = (g.altitude_m * 1e3).round() as i32;
            [d.eph, d.epv] = g.sd_m.map(|v| centi(v) as u16);
            [d.vn, d.ve, d.vd] = g.velocity.map(|v| centi(v) as i16);
            d.vel = centi(north.hypot(east)) as u16;
            d.cog = (east.atan2(north).to_degrees().rem_euclid(360.0) * 100.0) as u16;
            M::HIL_GPS(d)
        }
        MavlinkMessage::HilActuators {
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

const fn kind(value: ParameterValue) -> m::MavParamType {
    if value.integer {
        m::MavParamType::MAV_PARAM_TYPE_INT32
    } else {
        m::MavParamType::MAV_PARAM_TYPE_REAL32
    }
}

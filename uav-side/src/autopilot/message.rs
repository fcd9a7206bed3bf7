//! Messages of the link: those of MAVLink's `common` dialect as they are, and typed ones where units, optional values
//! or other dialects need them. [`super::wire`] encodes and decodes them; tests simulate an autopilot without bytes.

pub use alight_shared::mavlink::dialect::{
    MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavResult, MavType,
};
use alight_shared::{
    geodesy::Datum,
    mavlink::{
        self, CharArray,
        dialect::{self as m, MavParamType},
        fields,
    },
};
use serde::{Deserialize, Serialize};

use super::{place_report::AisReport, receiver::RelativeReport};

/// Severity of a text.
pub mod severity {
    use alight_shared::mavlink::dialect::MavSeverity;

    /// Immediate action is required.
    pub const CRITICAL: u8 = MavSeverity::MAV_SEVERITY_CRITICAL as u8;
    pub const WARNING: u8 = MavSeverity::MAV_SEVERITY_WARNING as u8;
    /// Unusual event that is not an error.
    pub const NOTICE: u8 = MavSeverity::MAV_SEVERITY_NOTICE as u8;
    pub const INFO: u8 = MavSeverity::MAV_SEVERITY_INFO as u8;
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Address {
    pub system: u8,
    pub component: u8,
}

impl Address {
    pub const fn new(system: u8, component: u8) -> Address {
        Address { system, component }
    }
}

pub const AUTOPILOT_COMPONENT: u8 = m::MavComponent::MAV_COMP_ID_AUTOPILOT1 as u8;
pub const COMPANION_COMPONENT: u8 = m::MavComponent::MAV_COMP_ID_ONBOARD_COMPUTER as u8;
pub const ALL_COMPONENTS: u8 = m::MavComponent::MAV_COMP_ID_ALL as u8;
/// Second parameter of `MAV_CMD_COMPONENT_ARM_DISARM`: disarm even in the air.
pub const FORCE: f64 = 21196.0;

/// `COMMAND_LONG`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandLong {
    pub to: Address,
    pub command: MavCmd,
    pub confirmation: u8,
    pub parameters: [f64; 7],
}

impl CommandLong {
    /// Command with these first parameters; the others are zero.
    pub fn new<const N: usize>(to: Address, command: MavCmd, first: [f64; N]) -> CommandLong {
        let mut parameters = [0.0; 7];
        for (p, v) in parameters.iter_mut().zip(first) {
            *p = v;
        }
        CommandLong {
            to,
            command,
            confirmation: 0,
            parameters,
        }
    }
    /// Disarm command number `sent` of a series.
    pub(crate) fn disarm(to: Address, sent: u32) -> CommandLong {
        CommandLong {
            confirmation: u8::try_from(sent.saturating_sub(1)).unwrap_or(u8::MAX),
            ..CommandLong::new(to, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, FORCE])
        }
    }
    pub fn mode(to: Address, [main, sub]: [f64; 2]) -> CommandLong {
        let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
        CommandLong::new(to, MavCmd::MAV_CMD_DO_SET_MODE, [f64::from(custom), main, sub])
    }
    /// Command that requests message `id`.
    pub fn request(to: Address, id: u32) -> CommandLong {
        CommandLong::new(to, MavCmd::MAV_CMD_REQUEST_MESSAGE, [f64::from(id)])
    }
}

impl From<CommandLong> for MavlinkMessage {
    fn from(c: CommandLong) -> MavlinkMessage {
        let [param1, param2, param3, param4, param5, param6, param7] = narrow(c.parameters);
        let message = MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
            target_system: c.to.system,
            target_component: c.to.component,
            command: c.command,
            confirmation: c.confirmation,
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
        });
        message.into()
    }
}

impl From<&m::COMMAND_LONG_DATA> for CommandLong {
    fn from(d: &m::COMMAND_LONG_DATA) -> CommandLong {
        let parameters = fields!(d, param1 param2 param3 param4 param5 param6 param7);
        CommandLong {
            to: Address::new(d.target_system, d.target_component),
            command: d.command,
            confirmation: d.confirmation,
            parameters: wide(parameters),
        }
    }
}

/// Major and minor number of the firmware's version.
pub fn version(d: &m::AUTOPILOT_VERSION_DATA) -> [u8; 2] {
    let [_, _, minor, major] = d.flight_sw_version.to_le_bytes();
    [major, minor]
}

/// Result without its prefix.
pub(crate) fn result_name(result: MavResult) -> String {
    format!("{result:?}").replace("MAV_RESULT_", "")
}

/// Answer to a command of `to`.
pub fn command_ack(command: MavCmd, result: MavResult, to: Address) -> MavlinkMessage {
    let message = MavMessage::COMMAND_ACK(m::COMMAND_ACK_DATA {
        command,
        result,
        // Percent; 255: unknown.
        progress: match result {
            MavResult::MAV_RESULT_IN_PROGRESS => u8::MAX,
            _ => 0,
        },
        target_system: to.system,
        target_component: to.component,
        ..m::COMMAND_ACK_DATA::DEFAULT
    });
    message.into()
}

pub fn heartbeat(
    autopilot: MavAutopilot,
    mavtype: MavType,
    base_mode: MavModeFlag,
    custom_mode: u32,
) -> MavlinkMessage {
    let message = MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
        autopilot,
        mavtype,
        base_mode,
        custom_mode,
        system_status: m::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    });
    message.into()
}

/// Set-point whose position, velocity, acceleration, yaw and yaw rate are all used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionTarget {
    pub to: Address,
    /// Autopilot's NED, m.
    pub position: [f64; 3],
    /// m/s.
    pub velocity: [f64; 3],
    /// m/s².
    pub acceleration: [f64; 3],
    /// rad.
    pub yaw: f64,
    /// rad/s.
    pub yaw_rate: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudeThrustTarget {
    pub to: Address,
    /// NED from body, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body rates, rad/s; None if unused.
    pub rates: Option<[f64; 3]>,
    /// Collective thrust as an autopilot command, 0 to 1.
    pub thrust: f64,
}

/// Parameter value whose bit encoding depends on the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterValue {
    /// Bits of the message's float.
    pub bits: u32,
    /// Whether the message declares an integer type.
    pub integer: bool,
}

impl ParameterValue {
    pub fn read(value: f32, kind: MavParamType) -> ParameterValue {
        use MavParamType::{MAV_PARAM_TYPE_REAL32, MAV_PARAM_TYPE_REAL64};
        ParameterValue {
            bits: value.to_bits(),
            integer: !matches!(kind, MAV_PARAM_TYPE_REAL32 | MAV_PARAM_TYPE_REAL64),
        }
    }
    pub fn kind(self) -> MavParamType {
        if self.integer {
            MavParamType::MAV_PARAM_TYPE_INT32
        } else {
            MavParamType::MAV_PARAM_TYPE_REAL32
        }
    }
}

/// `PARAM_VALUE` of parameter `param_index` among `param_count`, with a name of at most 16 characters.
pub fn parameter(name: &str, value: ParameterValue, param_index: u16, param_count: u16) -> MavlinkMessage {
    let message = MavMessage::PARAM_VALUE(m::PARAM_VALUE_DATA {
        param_id: chars(name),
        param_value: f32::from_bits(value.bits),
        param_type: value.kind(),
        param_index,
        param_count,
    });
    message.into()
}

/// `TARGET_RELATIVE`: a target detected by the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetRelative {
    /// Companion's time, us.
    pub time_us: u64,
    /// Position relative to the vehicle, NED, m.
    pub position: [f64; 3],
    pub position_sd: [f64; 3],
    /// NED from target (w, x, y, z).
    pub attitude: [f64; 4],
    /// Standard deviation of the heading, rad.
    pub yaw_sd: f64,
}

/// `TARGET_ABSOLUTE`: a target whose own receiver measures its position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetAbsolute {
    /// Companion's time, us.
    pub time_us: u64,
    /// Geodetic position, with height above the sea.
    pub place: Datum,
    /// Standard deviations of the place, horizontal and vertical, m.
    pub place_sd: [f64; 2],
    /// NED, m/s.
    pub velocity: [f64; 3],
    pub velocity_sd: [f64; 3],
}

/// Message of the link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MavlinkMessage {
    /// Message of the `common` dialect that is used as it is.
    Common(#[serde(with = "mavlink::recorded")] MavMessage),
    /// Sentence of an AIS receiver; not a MAVLink message.
    Ais(AisReport),
    /// Report of the drone's own GNSS receiver; not a MAVLink message.
    RelativePlace(RelativeReport),
    /// `SET_POSITION_TARGET_LOCAL_NED`.
    Position(PositionTarget),
    /// `SET_ATTITUDE_TARGET`.
    AttitudeThrust(AttitudeThrustTarget),
    /// `TARGET_RELATIVE`: deck for PX4's vision target estimator, as a detected marker.
    TargetRelative(TargetRelative),
    /// `TARGET_ABSOLUTE`: deck for PX4's vision target estimator, as a receiver on the target.
    TargetAbsolute(TargetAbsolute),
    /// `EKF_STATUS_REPORT` of ArduPilot, with the bits of `ESTIMATOR_STATUS_FLAGS`.
    EkfStatus { flags: u16 },
    /// One or several `STATUSTEXT`.
    Text {
        /// `MAV_SEVERITY`: 0 emergency to 7 debug.
        severity: u8,
        text: String,
    },
    /// `HIL_SENSOR` of a simulator.
    HilSensor(HilSensor),
    /// `HIL_GPS` of a simulator.
    HilGps(HilGps),
}

impl From<MavMessage> for MavlinkMessage {
    fn from(message: MavMessage) -> MavlinkMessage {
        MavlinkMessage::Common(message)
    }
}

pub fn wide<const N: usize>(v: [f32; N]) -> [f64; N] {
    v.map(f64::from)
}
pub fn narrow<const N: usize>(v: [f64; N]) -> [f32; N] {
    v.map(|x| x as f32)
}
pub fn text<const N: usize>(t: &CharArray<N>) -> String {
    t.to_str().unwrap_or_default().to_owned()
}
pub fn chars<const N: usize>(t: &str) -> CharArray<N> {
    let mut bytes = [0; N];
    for (b, c) in bytes.iter_mut().zip(t.bytes()) {
        *b = c;
    }
    CharArray::new(bytes)
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HilSensor {
    pub time_us: u64,
    /// Specific force, body, m/s².
    pub accelerometer: [f64; 3],
    /// Body, rad/s.
    pub gyro: [f64; 3],
    /// Body, gauss.
    pub magnetometer: [f64; 3],
    pub pressure_hpa: f64,
    /// Pressure altitude above sea level, m.
    pub pressure_altitude_m: f64,
    pub temperature_degc: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HilGps {
    pub time_us: u64,
    /// rad.
    pub latitude: f64,
    /// rad.
    pub longitude: f64,
    /// m above sea level.
    pub altitude_m: f64,
    /// NED, m/s.
    pub velocity: [f64; 3],
    /// Reported horizontal and vertical standard deviations, m.
    pub sd_m: [f64; 2],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MavlinkFrame {
    pub from: Address,
    pub message: MavlinkMessage,
}

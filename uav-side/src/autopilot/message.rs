//! MAVLink messages that Alight uses, in SI units, radians and plain enums.
//!
//! The state machine in this folder uses only these types. Bytes and the MAVLink crate are hidden in
//! [`super::wire`], so a new release or dialect changes one file, and tests simulate an autopilot without
//! bytes. Numbers are those of MAVLink's `common` dialect.

use alight_shared::geodesy::Datum;
use serde::{Deserialize, Serialize};

mod numbers;

use super::place_report::{AisReport, PlaceReport};
use super::receiver::RelativeReport;
pub use numbers::{command, estimator, id, severity};

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

/// `MAV_COMP_ID_AUTOPILOT1`.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// `MAV_COMP_ID_ONBOARD_COMPUTER`.
pub const COMPANION_COMPONENT: u8 = 191;
/// `MAV_COMP_ID_ALL`.
pub const ALL_COMPONENTS: u8 = 0;
/// `MAV_TYPE_ONBOARD_CONTROLLER`.
pub const COMPANION_TYPE: u8 = 18;
/// `MAV_AUTOPILOT_INVALID`: not an autopilot.
pub const NO_AUTOPILOT: u8 = 8;
/// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
pub const ARDUPILOT: u8 = 3;
/// `MAV_AUTOPILOT_PX4`.
pub const PX4: u8 = 12;

/// Number of outputs that Alight reads, enough for an octorotor.
pub const OUTPUTS: usize = 8;

/// `MAV_SYS_STATUS_SENSOR_RC_RECEIVER`.
pub const RC_RECEIVER: u32 = 1 << 16;

/// `MAV_MODE_FLAG_CUSTOM_MODE_ENABLED`.
pub const CUSTOM_MODE: u8 = 1;
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
pub const ARMED: u8 = 128;

/// Result of a command (`MAV_RESULT`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CommandResult {
    Accepted,
    /// A retry may succeed.
    TemporarilyRejected,
    /// A retry in the same state fails again.
    Denied,
    Unsupported,
    Failed,
    InProgress,
    Other,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum VelocityFrame {
    Ned,
    /// Body frame: forward, right, down.
    Body,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandLong {
    pub to: Address,
    pub command: u16,
    pub confirmation: u8,
    pub parameters: [f64; 7],
}

impl CommandLong {
    /// Command with these first parameters; the others are zero.
    pub fn new<const N: usize>(to: Address, command: u16, first: [f64; N]) -> CommandLong {
        let mut parameters = [0.0; 7];
        parameters.iter_mut().zip(first).for_each(|(p, v)| *p = v);
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
            ..CommandLong::new(to, command::ARM_DISARM, [0.0, command::FORCE])
        }
    }
    pub fn mode(to: Address, [main, sub]: [f64; 2]) -> CommandLong {
        CommandLong::new(to, command::SET_MODE, [f64::from(CUSTOM_MODE), main, sub])
    }
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

/// Pose and velocity of the vehicle with their covariance (`ODOMETRY`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OdometryReport {
    /// Autopilot's time, us.
    pub time_us: u64,
    /// NED, m.
    pub position: [f64; 3],
    /// NED from body (w, x, y, z).
    pub attitude: [f64; 4],
    /// m/s.
    pub velocity: [f64; 3],
    pub frame: VelocityFrame,
    /// Body, rad/s.
    pub rates: [f64; 3],
    /// Variances of position (m²), attitude (rad²) and velocity (m²/s²); None if not reported.
    pub variances: Option<[[f64; 3]; 3]>,
    pub resets: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// `MAV_AUTOPILOT`.
    pub autopilot: u8,
    /// `MAV_TYPE`.
    pub vehicle: u8,
    /// `MAV_MODE_FLAG` bits.
    pub base_mode: u8,
    pub custom_mode: u32,
}

/// `LOCAL_POSITION_NED`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionReport {
    /// Autopilot's time, ms.
    pub time_ms: u32,
    /// NED, m.
    pub position: [f64; 3],
    /// NED, m/s.
    pub velocity: [f64; 3],
}

/// `ATTITUDE_QUATERNION`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudeReport {
    /// Autopilot's time, ms.
    pub time_ms: u32,
    /// NED from body (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body, rad/s.
    pub rates: [f64; 3],
}

/// `HIGHRES_IMU`, or `SCALED_IMU` in SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuReport {
    /// Autopilot's time, us.
    pub time_us: u64,
    /// Specific force, body, m/s².
    pub accelerometer: [f64; 3],
    /// Body, rad/s.
    pub gyro: [f64; 3],
}

/// Parameter value whose bit encoding depends on the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterValue {
    /// Bits of the message's float.
    pub bits: u32,
    /// Whether the message declares an integer type.
    pub integer: bool,
}

/// `DISTANCE_SENSOR` that points downwards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceReport {
    /// Autopilot's time, ms.
    pub time_ms: u32,
    /// m.
    pub range_m: f64,
    /// Minimum and maximum measurable distance, m.
    pub limits_m: [f64; 2],
    /// m²; None when unknown.
    pub variance: Option<f64>,
}

/// Remote control channels as the autopilot's receiver reports them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RcChannels {
    pub count: u8,
    /// Pulse of each channel, us; 65535: channel absent.
    pub pulses_us: [u16; 18],
}

/// Frame of a landing target's position (`MAV_FRAME`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TargetFrame {
    /// `MAV_FRAME_LOCAL_NED`: the autopilot's NED, relative to its origin.
    LocalNed,
    /// `MAV_FRAME_BODY_FRD`: relative to the vehicle, along its body axes.
    BodyFrd,
    /// `MAV_FRAME_LOCAL_FRD`: relative to the vehicle, level, forward along its heading.
    LocalFrd,
}

impl TargetFrame {
    pub const ALL: [TargetFrame; 3] = [TargetFrame::LocalNed, TargetFrame::BodyFrd, TargetFrame::LocalFrd];
    /// Number in `MAV_FRAME`.
    pub const fn number(self) -> u8 {
        match self {
            TargetFrame::LocalNed => 1,
            TargetFrame::BodyFrd => 12,
            TargetFrame::LocalFrd => 20,
        }
    }
}

/// `LANDING_TARGET` with a position (`position_valid` 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LandingTarget {
    /// Time, us: the companion's for PX4, which converts it; the autopilot's for ArduPilot.
    pub time_us: u64,
    pub frame: TargetFrame,
    /// Centre of the deck, m.
    pub position: [f64; 3],
    /// Distance from the vehicle to the deck's centre, m; 0: not stated.
    pub distance_m: f64,
    /// Rotation from the deck to `frame` (w, x, y, z).
    pub attitude: [f64; 4],
    /// Size of the tag, m.
    pub size_m: f64,
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

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MavlinkMessage {
    Heartbeat(Heartbeat),
    /// Request (`remote_ns` zero) or answer of the clock synchronisation.
    Timesync {
        /// `tc1`: clock of the answering side, ns; 0 in a request.
        remote_ns: i64,
        /// `ts1`: clock of the requesting side, ns.
        local_ns: i64,
    },
    Odometry(OdometryReport),
    LocalPosition(PositionReport),
    Attitude(AttitudeReport),
    Imu(ImuReport),
    Distance(DistanceReport),
    /// `CURRENT_MODE`, sent when the mode changes.
    Mode {
        custom_mode: u32,
    },
    /// `EXTENDED_SYS_STATE`: `MAV_LANDED_STATE`.
    Landed {
        /// 1 on ground, 2 in air, 3 taking off, 4 landing.
        state: u8,
    },
    /// `BATTERY_STATUS`.
    Battery {
        number: u8,
        /// Remaining charge, 0 to 1; None if not reported.
        remaining: Option<f64>,
        /// V; None if not reported.
        voltage_v: Option<f64>,
        /// A; None if not reported.
        current_a: Option<f64>,
    },
    /// `SERVO_OUTPUT_RAW`: signals at the autopilot's outputs.
    Outputs {
        port: u8,
        /// Pulses, us, or the numbers of a digital protocol; 0: none.
        pulses_us: [u16; OUTPUTS],
    },
    /// `ATTITUDE_TARGET`: current reference of the autopilot's attitude loop.
    AttitudeTargetThrust {
        /// Collective thrust, 0 to 1.
        thrust: f64,
    },
    /// `PARAM_REQUEST_LIST`.
    ParameterList {
        to: Address,
    },
    /// `PARAM_REQUEST_READ`.
    ParameterRequest {
        to: Address,
        /// At most 16 characters.
        name: String,
        /// Index that replaces the name in the request.
        index: Option<u16>,
    },
    /// `PARAM_SET`.
    ParameterSet {
        to: Address,
        /// At most 16 characters.
        name: String,
        value: ParameterValue,
    },
    /// `PARAM_VALUE`.
    Parameter {
        /// At most 16 characters.
        name: String,
        value: ParameterValue,
        /// Index among the sender's parameters.
        index: u16,
        count: u16,
    },
    /// `GPS_GLOBAL_ORIGIN`: origin of the autopilot's NED, with height above mean sea level.
    Origin(Datum),
    /// `HOME_POSITION`: destination of return mode, with height above mean sea level.
    Home(Datum),
    /// `GPS_RAW_INT`: GNSS height above mean sea level and above the ellipsoid, m; the latter is 0 if
    /// unknown.
    GnssHeights {
        /// `alt`.
        sea_m: f64,
        /// `alt_ellipsoid`.
        ellipsoid_m: f64,
    },
    /// `GLOBAL_POSITION_INT`: position of a system.
    GlobalPosition(PlaceReport),
    /// `FOLLOW_TARGET`: position of a phone or ground station.
    FollowTarget(PlaceReport),
    /// `AIS_VESSEL` or an AIS receiver's sentence: position of a vessel.
    Ais(AisReport),
    /// Report of the drone's own GNSS receiver; not a MAVLink message.
    RelativePlace(RelativeReport),
    /// `GPS_RTCM_DATA`: RTCM frame, or fragment of one, for the autopilot's receiver.
    Rtcm {
        /// Bit 0: fragmented; bits 1 and 2: fragment number; bits 3 to 7: frame number.
        flags: u8,
        /// At most 180 bytes.
        data: Vec<u8>,
    },
    Command(CommandLong),
    CommandInt {
        to: Address,
        command: u16,
        /// First four parameters of the command; Alight's orders use no geodetic position.
        first: [f64; 4],
    },
    CommandAck {
        command: u16,
        result: CommandResult,
        /// Sender of the acknowledged command; zeros if not stated.
        to: Address,
    },
    /// `SET_POSITION_TARGET_LOCAL_NED`.
    Position(PositionTarget),
    /// `SET_ATTITUDE_TARGET`.
    AttitudeThrust(AttitudeThrustTarget),
    /// `LANDING_TARGET`: deck for the autopilot's own guidance.
    LandingTarget(LandingTarget),
    /// `TARGET_RELATIVE`: deck for PX4's vision target estimator, as a detected marker.
    TargetRelative(TargetRelative),
    /// `TARGET_ABSOLUTE`: deck for PX4's vision target estimator, as a receiver on the target.
    TargetAbsolute(TargetAbsolute),
    /// `DEBUG_FLOAT_ARRAY` named "deck". `ODOMETRY` is not used, because an autopilot would treat it as its
    /// own pose.
    Deck {
        /// Autopilot's time, us.
        time_us: u64,
        /// Position (m), velocity (m/s) in NED, roll, pitch, yaw (rad), their rates (rad/s), and standard
        /// deviation of the position (m).
        values: [[f64; 3]; 5],
    },
    /// `SYS_STATUS`: sensors as bits of `MAV_SYS_STATUS_SENSOR`.
    SystemStatus {
        present: u32,
        healthy: u32,
    },
    /// `ESTIMATOR_STATUS` of PX4, bits of [`estimator`].
    EstimatorStatus {
        flags: u16,
    },
    /// `EKF_STATUS_REPORT` of ArduPilot, with the same bits.
    EkfStatus {
        flags: u16,
    },
    /// `MISSION_CURRENT`: progress of the autopilot's own mission.
    MissionCurrent {
        /// Number of items; 0: not stated, 65535: no mission.
        total: u16,
        /// `MISSION_STATE`: 0 not stated, 2 not started, 3 active, 4 paused, 5 complete.
        state: u8,
    },
    MissionItemReached {
        item: u16,
    },
    /// `RC_CHANNELS`.
    RemoteControl(RcChannels),
    /// `RC_CHANNELS_OVERRIDE`: first eight channels, as set by a ground station.
    RemoteControlOverride {
        to: Address,
        /// Pulse of each channel, us; 0: returned to the receiver, 65535: unchanged.
        pulses_us: [u16; 8],
    },
    /// `NAMED_VALUE_FLOAT`.
    NamedValue {
        /// Autopilot's time, ms.
        time_ms: u32,
        /// At most 10 characters.
        name: String,
        value: f64,
    },
    /// `STATUSTEXT`.
    Text {
        /// `MAV_SEVERITY`: 0 emergency to 7 debug.
        severity: u8,
        /// At most 50 characters.
        text: String,
    },
    /// `HIL_SENSOR` of a simulator.
    HilSensor(HilSensor),
    /// `HIL_GPS` of a simulator.
    HilGps(HilGps),
    /// `HIL_ACTUATOR_CONTROLS`: outputs of a firmware to its simulated motors.
    HilActuators {
        /// Firmware's time, us.
        time_us: u64,
        /// Outputs; 0 to 1 for motors.
        controls: [f64; 16],
        /// `MAV_MODE_FLAG` bits.
        mode: u8,
    },
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

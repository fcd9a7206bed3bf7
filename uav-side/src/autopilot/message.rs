//! Messages of MAVLink that Alight uses: SI units, radians, plain enums.
//!
//! The state machine of this folder knows these types only. Bytes and the MAVLink crate are behind
//! [`super::wire`], so a new release of the crate, or another dialect, changes one file, and a test
//! can play an autopilot without a byte. Numbers are those of MAVLink's `common` dialect.

use alight_shared::geodesy::Datum;
use serde::{Deserialize, Serialize};

mod numbers;

use super::place_report::{AisReport, PlaceReport};
use super::receiver::RelativeReport;
pub use numbers::{command, estimator, id, severity};

/// Sender or receiver: system and component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Address {
    /// Number of the vehicle.
    pub system: u8,
    /// Component; 1 is the autopilot.
    pub component: u8,
}

impl Address {
    /// A component of a system.
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

/// Outputs of a set that Alight reads: those of an octorotor.
pub const OUTPUTS: usize = 8;

/// `MAV_SYS_STATUS_SENSOR_RC_RECEIVER`.
pub const RC_RECEIVER: u32 = 1 << 16;

/// `MAV_MODE_FLAG_CUSTOM_MODE_ENABLED`.
pub const CUSTOM_MODE: u8 = 1;
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
pub const ARMED: u8 = 128;

/// The answer to a command (`MAV_RESULT`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CommandResult {
    /// Done.
    Accepted,
    /// Not now; may work later.
    TemporarilyRejected,
    /// Never in this state.
    Denied,
    /// Unknown to the autopilot.
    Unsupported,
    /// Tried, and failed.
    Failed,
    /// Being done.
    InProgress,
    /// Any other answer.
    Other,
}

/// The frame of a velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum VelocityFrame {
    /// The NED of the position.
    Ned,
    /// The body: forward, right, down.
    Body,
}

/// A command with its seven parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommandLong {
    pub to: Address,
    pub command: u16,
    /// Number of repetitions.
    pub confirmation: u8,
    /// Parameters of the command.
    pub parameters: [f64; 7],
}

impl CommandLong {
    /// A command whose first parameters are `first` and whose others are zero.
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
    /// The command number `sent` that stops the motors by force.
    pub(crate) fn disarm(to: Address, sent: u32) -> CommandLong {
        CommandLong {
            confirmation: u8::try_from(sent.saturating_sub(1)).unwrap_or(u8::MAX),
            ..CommandLong::new(to, command::ARM_DISARM, [0.0, command::FORCE])
        }
    }
    /// The command that chooses the mode with this main and sub number of the firmware.
    pub fn mode(to: Address, [main, sub]: [f64; 2]) -> CommandLong {
        CommandLong::new(to, command::SET_MODE, [f64::from(CUSTOM_MODE), main, sub])
    }
}

/// A position set-point: all of position, velocity, acceleration, yaw and yaw rate are to be used.
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

/// An attitude set-point with thrust.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudeThrustTarget {
    pub to: Address,
    /// NED from body, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body rates, rad/s; None: not to be used.
    pub rates: Option<[f64; 3]>,
    /// Collective thrust as the autopilot commands it, 0 to 1.
    pub thrust: f64,
}

/// The vehicle's pose and motion with their covariance, from the autopilot (`ODOMETRY`).
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
    /// Frame of `velocity`.
    pub frame: VelocityFrame,
    /// Body, rad/s.
    pub rates: [f64; 3],
    /// Variances of position (m²), attitude (rad²) and velocity (m²/s²); None when not reported.
    pub variances: Option<[[f64; 3]; 3]>,
    /// Counts jumps of the estimate.
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
    /// The autopilot's own number of its mode.
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

/// A parameter's value as it stands in the message: what the bits mean depends on the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterValue {
    /// The message's float.
    pub bits: u32,
    /// It is of an integer type, by the message.
    pub integer: bool,
}

/// `DISTANCE_SENSOR` that looks down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceReport {
    /// Autopilot's time, ms.
    pub time_ms: u32,
    /// m.
    pub range_m: f64,
    /// Minimum and maximum distance that it can measure, m.
    pub limits_m: [f64; 2],
    /// m²; None when not known.
    pub variance: Option<f64>,
}

/// Pulses of the remote control, as the autopilot's receiver has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RcChannels {
    /// Channels that it has.
    pub count: u8,
    /// Pulse of each channel, us; 65535: not there.
    pub pulses_us: [u16; 18],
}

/// The frame of a landing target's position (`MAV_FRAME`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TargetFrame {
    /// `MAV_FRAME_LOCAL_NED`: the autopilot's NED, from its origin.
    LocalNed,
    /// `MAV_FRAME_BODY_FRD`: from the vehicle, along its forward, right and down axes.
    BodyFrd,
    /// `MAV_FRAME_LOCAL_FRD`: from the vehicle, forward by its heading, right and down, level.
    LocalFrd,
}

impl TargetFrame {
    pub const ALL: [TargetFrame; 3] = [TargetFrame::LocalNed, TargetFrame::BodyFrd, TargetFrame::LocalFrd];
    /// `MAV_FRAME` of the frame.
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
    /// PX4: our time, which it converts; ArduPilot: its own; us.
    pub time_us: u64,
    /// Frame of position and attitude.
    pub frame: TargetFrame,
    /// Deck's centre, m.
    pub position: [f64; 3],
    /// From the vehicle to the deck's centre, m; 0: not stated.
    pub distance_m: f64,
    /// That frame from deck (w, x, y, z).
    pub attitude: [f64; 4],
    /// Size of the tag, m.
    pub size_m: f64,
}

/// `TARGET_RELATIVE`: a target as the vehicle sees it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetRelative {
    /// Our time, us.
    pub time_us: u64,
    /// From the vehicle, NED, m.
    pub position: [f64; 3],
    /// Standard deviations of the position, m.
    pub position_sd: [f64; 3],
    /// NED from target (w, x, y, z).
    pub attitude: [f64; 4],
    /// Standard deviation of its heading, rad.
    pub yaw_sd: f64,
}

/// `TARGET_ABSOLUTE`: a target as its own receiver has it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetAbsolute {
    /// Our time, us.
    pub time_us: u64,
    /// Place of the system; height above the sea.
    pub place: Datum,
    /// Standard deviations of that, horizontal and vertical, m.
    pub place_sd: [f64; 2],
    /// NED, m/s.
    pub velocity: [f64; 3],
    /// Standard deviations of the velocity, m/s.
    pub velocity_sd: [f64; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MavlinkMessage {
    Heartbeat(Heartbeat),
    /// Question (`remote_ns` zero) or answer about clocks.
    Timesync {
        /// `tc1`: the answering clock, ns; 0 in a question.
        remote_ns: i64,
        /// `ts1`: the asking clock, ns.
        local_ns: i64,
    },
    Odometry(OdometryReport),
    /// `LOCAL_POSITION_NED`.
    LocalPosition(PositionReport),
    /// `ATTITUDE_QUATERNION`.
    Attitude(AttitudeReport),
    /// `HIGHRES_IMU`, or `SCALED_IMU` in SI.
    Imu(ImuReport),
    /// `DISTANCE_SENSOR` that looks down.
    Distance(DistanceReport),
    /// `CURRENT_MODE`: the mode in force, sent when it changes.
    Mode {
        /// As in the heartbeat.
        custom_mode: u32,
    },
    /// `EXTENDED_SYS_STATE`: `MAV_LANDED_STATE`.
    Landed {
        /// 1 on ground, 2 in air, 3 taking off, 4 landing.
        state: u8,
    },
    /// `BATTERY_STATUS`.
    Battery {
        /// Which of several.
        number: u8,
        /// Remaining, 0 to 1; None when not reported.
        remaining: Option<f64>,
        /// V; None when not reported.
        voltage_v: Option<f64>,
        /// A; None when not reported.
        current_a: Option<f64>,
    },
    /// `SERVO_OUTPUT_RAW`: what the autopilot's outputs give.
    Outputs {
        /// Which of its sets of outputs.
        port: u8,
        /// Pulses, us, or the numbers of a digital protocol; 0: none.
        pulses_us: [u16; OUTPUTS],
    },
    /// `ATTITUDE_TARGET`: the present reference of the autopilot's attitude loop.
    AttitudeTargetThrust {
        /// Collective, 0 to 1.
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
        /// In place of the name.
        index: Option<u16>,
    },
    /// `PARAM_SET`.
    ParameterSet {
        to: Address,
        /// At most 16 characters.
        name: String,
        /// Value of the parameter.
        value: ParameterValue,
    },
    /// `PARAM_VALUE`.
    Parameter {
        /// At most 16 characters.
        name: String,
        /// Value of the parameter.
        value: ParameterValue,
        /// Index among the sender's parameters.
        index: u16,
        /// Number of the sender's parameters.
        count: u16,
    },
    /// `GPS_GLOBAL_ORIGIN`: where the autopilot's NED begins; height above mean sea level.
    Origin(Datum),
    /// `HOME_POSITION`: destination of its return mode; height above mean sea level.
    Home(Datum),
    /// `GPS_RAW_INT`: the receiver's height above mean sea level and above the ellipsoid, m; the latter 0 where it is not
    /// known.
    GnssHeights {
        /// `alt`.
        sea_m: f64,
        /// `alt_ellipsoid`.
        ellipsoid_m: f64,
    },
    /// `GLOBAL_POSITION_INT`: where a system is.
    GlobalPosition(PlaceReport),
    /// `FOLLOW_TARGET`: where a phone or a ground station is.
    FollowTarget(PlaceReport),
    /// `AIS_VESSEL`, or a sentence of an AIS receiver: where a vessel is.
    Ais(AisReport),
    /// No message of MAVLink: a report of the drone's own GNSS receiver.
    RelativePlace(RelativeReport),
    /// `GPS_RTCM_DATA`: a frame of RTCM for the autopilot's receiver, or a fragment of one.
    Rtcm {
        /// Bit 0: fragmented; bits 1 and 2: number of the fragment; bits 3 to 7: number of the frame.
        flags: u8,
        /// At most 180 bytes.
        data: Vec<u8>,
    },
    /// `COMMAND_LONG`.
    Command(CommandLong),
    CommandInt {
        to: Address,
        command: u16,
        /// First four parameters of the command; no order of ours has a place on earth.
        first: [f64; 4],
    },
    CommandAck {
        command: u16,
        result: CommandResult,
        /// Whoever gave the command; zeros: not stated.
        to: Address,
    },
    /// `SET_POSITION_TARGET_LOCAL_NED`.
    Position(PositionTarget),
    /// `SET_ATTITUDE_TARGET`.
    AttitudeThrust(AttitudeThrustTarget),
    /// `LANDING_TARGET`: the deck for the autopilot's own guidance.
    LandingTarget(LandingTarget),
    /// `TARGET_RELATIVE`: the same for PX4's vision target estimator ...
    TargetRelative(TargetRelative),
    /// `TARGET_ABSOLUTE`: ... and as if a receiver stood on the deck.
    TargetAbsolute(TargetAbsolute),
    /// `DEBUG_FLOAT_ARRAY` named "deck": the estimated deck. Not `ODOMETRY`, which an autopilot would
    /// take for a measurement of its own pose.
    Deck {
        /// Autopilot's time, us.
        time_us: u64,
        /// Position (NED, m), velocity (NED, m/s), roll, pitch, yaw (rad), their rates (rad/s),
        /// standard deviation of the position (m).
        values: [[f64; 3]; 5],
    },
    /// `SYS_STATUS`: sensors by the bits of `MAV_SYS_STATUS_SENSOR`.
    SystemStatus {
        /// That are there.
        present: u32,
        /// That work.
        healthy: u32,
    },
    /// `ESTIMATOR_STATUS`: what PX4's estimator knows, bits of [`estimator`].
    EstimatorStatus {
        /// `ESTIMATOR_STATUS_FLAGS`.
        flags: u16,
    },
    /// `EKF_STATUS_REPORT`: the same of ArduPilot's, with the same bits.
    EkfStatus {
        /// `EKF_STATUS_FLAGS`.
        flags: u16,
    },
    /// `MISSION_CURRENT`: how far the autopilot's own mission is.
    MissionCurrent {
        /// Items; 0: not stated, 65535: none.
        total: u16,
        /// `MISSION_STATE`: 0 not stated, 2 not started, 3 active, 4 paused, 5 complete.
        state: u8,
    },
    MissionItemReached {
        /// Number of the item.
        item: u16,
    },
    /// `RC_CHANNELS`.
    RemoteControl(RcChannels),
    /// `RC_CHANNELS_OVERRIDE`: the first eight channels as a ground station sets them.
    RemoteControlOverride {
        to: Address,
        /// us; 0: as the receiver has it, 65535: as before.
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
    /// `HIL_SENSOR`: a simulator's sensors.
    HilSensor(HilSensor),
    /// `HIL_GPS`: a simulator's GNSS.
    HilGps(HilGps),
    /// `HIL_ACTUATOR_CONTROLS`: a firmware's commands to its simulated motors.
    HilActuators {
        /// Firmware's time, us.
        time_us: u64,
        /// Outputs, 0 to 1 for motors.
        controls: [f64; 16],
        /// `MAV_MODE_FLAG` bits.
        mode: u8,
    },
}

/// A simulator's inertial sensors, barometer and magnetometer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HilSensor {
    /// Simulated time, us.
    pub time_us: u64,
    /// Specific force, body, m/s².
    pub accelerometer: [f64; 3],
    /// Body, rad/s.
    pub gyro: [f64; 3],
    /// Body, gauss.
    pub magnetometer: [f64; 3],
    pub pressure_hpa: f64,
    /// m above sea level by pressure.
    pub pressure_altitude_m: f64,
    /// Degrees Celsius.
    pub temperature_degc: f64,
}

/// A simulator's GNSS.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HilGps {
    /// Simulated time, us.
    pub time_us: u64,
    /// rad.
    pub latitude: f64,
    /// rad.
    pub longitude: f64,
    /// m above sea level.
    pub altitude_m: f64,
    /// NED, m/s.
    pub velocity: [f64; 3],
    /// Reported standard deviations: horizontal, vertical, m.
    pub sd_m: [f64; 2],
}

/// A message and its sender.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MavlinkFrame {
    /// Sender of the message.
    pub from: Address,
    pub message: MavlinkMessage,
}

//! MAVLink numbers: messages, severities, estimator status bits, commands.

/// Messages whose rate Alight requests.
pub mod id {
    pub const HEARTBEAT: u32 = 0;
    pub const SYS_STATUS: u32 = 1;
    pub const SCALED_IMU: u32 = 26;
    pub const ATTITUDE_QUATERNION: u32 = 31;
    pub const LOCAL_POSITION_NED: u32 = 32;
    pub const RC_CHANNELS: u32 = 65;
    pub const SERVO_OUTPUT_RAW: u32 = 36;
    pub const ATTITUDE_TARGET: u32 = 83;
    pub const HIGHRES_IMU: u32 = 105;
    pub const GPS_RAW_INT: u32 = 24;
    pub const GPS_GLOBAL_ORIGIN: u32 = 49;
    pub const HOME_POSITION: u32 = 242;
    pub const DISTANCE_SENSOR: u32 = 132;
    pub const BATTERY_STATUS: u32 = 147;
    pub const MISSION_CURRENT: u32 = 42;
    pub const MISSION_ITEM_REACHED: u32 = 46;
    /// `EKF_STATUS_REPORT` (ArduPilot).
    pub const EKF_STATUS_REPORT: u32 = alight_shared::mavlink::EKF_STATUS_REPORT.0;
    /// `ESTIMATOR_STATUS` (PX4).
    pub const ESTIMATOR_STATUS: u32 = 230;
    pub const EXTENDED_SYS_STATE: u32 = 245;
    pub const ODOMETRY: u32 = 331;
    pub const CURRENT_MODE: u32 = 436;
}

/// Severity of a text (`MAV_SEVERITY`).
pub mod severity {
    /// Immediate action is required.
    pub const CRITICAL: u8 = 2;
    pub const WARNING: u8 = 4;
    /// Unusual event that is not an error.
    pub const NOTICE: u8 = 5;
    pub const INFO: u8 = 6;
}

/// Bits of an estimator's status, common to both firmwares.
pub mod estimator {
    /// Attitude: tilt only in PX4; tilt and heading in ArduPilot.
    pub const ATTITUDE: u16 = 1;
    pub const VELOCITY_HORIZ: u16 = 2;
    pub const VELOCITY_VERT: u16 = 4;
    /// Position by GNSS. PX4 (`EKF2`) and ArduPilot (`EKF3`) fuse GNSS only after tilt and heading are aligned.
    pub const POSITION_HORIZ_ABS: u16 = 16;
    pub const POSITION_VERT_ABS: u16 = 32;
    /// The estimator has no position measurement and assumes a constant position.
    pub const CONSTANT_POSITION: u16 = 128;
}

pub mod command {
    /// `MAV_CMD_DO_SET_MODE`.
    pub const SET_MODE: u16 = 176;
    /// `MAV_CMD_DO_SET_HOME`, with latitude, longitude (deg) and height above the sea (m) as the last
    /// parameters.
    pub const SET_HOME: u16 = 179;
    /// `MAV_CMD_MISSION_START`. With first and last item 0 it restarts the mission: always in PX4, and after
    /// a disarm in ArduCopter.
    pub const MISSION_START: u16 = 300;
    /// `MAV_CMD_COMPONENT_ARM_DISARM`.
    pub const ARM_DISARM: u16 = 400;
    /// `MAV_CMD_SET_MESSAGE_INTERVAL`.
    pub const MESSAGE_INTERVAL: u16 = 511;
    /// `MAV_CMD_REQUEST_MESSAGE`.
    pub const REQUEST_MESSAGE: u16 = 512;
    /// `MAV_CMD_NAV_LAND`, interpreted by the companion as an order to land on the vessel.
    pub const NAV_LAND: u16 = 21;
    /// `MAV_CMD_NAV_TAKEOFF`, interpreted by the companion as an order to take off from the deck.
    pub const NAV_TAKEOFF: u16 = 22;
    /// `MAV_CMD_USER_1`: land.
    pub const USER_1: u16 = 31010;
    /// `MAV_CMD_USER_2`: abort.
    pub const USER_2: u16 = 31011;
    /// `MAV_CMD_USER_3`: hold.
    pub const USER_3: u16 = 31012;
    /// `MAV_CMD_USER_4`: keep station. Parameters: height, m; distances ahead of and to starboard of the
    /// deck's centre, m; duration, min.
    pub const USER_4: u16 = 31013;
    /// Second parameter of `ARM_DISARM`: disarm even in the air.
    pub const FORCE: f64 = 21196.0;
}

//! ROS 2 messages that are published and served, with the fields of their `.msg` and `.srv` files.
//!
//! Hashes are those of REP 2016 (`RIHS01`) for the definitions that Jazzy and Kilted share. Source: `share/*/*.json`
//! of the PyPI packages ros-nav-msgs, ros-geometry-msgs, ros-diagnostic-msgs and ros-std-srvs 5.5.1 (Kilted). The
//! hash of `TFMessage`, which has no package, was computed by REP 2016 from the same files; ros2_pyterfaces 0.3.0, on
//! which pyzeros 0.1.0 is built, computes the same hash. The hash of `Marker` is that of rosbags 0.11.9 for Humble,
//! Jazzy and Kilted, which also reproduces the others.

use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RosType {
    pub name: &'static str,
    pub hash: &'static str,
}

pub trait RosMessage: Serialize {
    const TYPE: RosType;
}

/// `std_srvs/srv/Trigger`: an empty request; the response has success and message.
pub const TRIGGER: RosType = RosType {
    name: "std_srvs::srv::dds_::Trigger_",
    hash: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
};

/// `builtin_interfaces/msg/Time`, of the system's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RosTime {
    /// Whole seconds since 1970.
    pub sec: i32,
    /// Fraction, ns.
    pub nanosec: u32,
}

impl RosTime {
    /// Time from nanoseconds since 1970, limited to the range of the type (1970 to 2038).
    pub fn from_nanos(ns: i64) -> RosTime {
        match i32::try_from(ns.div_euclid(1_000_000_000)) {
            Ok(sec) => RosTime {
                sec,
                nanosec: ns.rem_euclid(1_000_000_000) as u32,
            },
            Err(_) if ns < 0 => RosTime::default(),
            Err(_) => RosTime {
                sec: i32::MAX,
                nanosec: 0,
            },
        }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RosHeader {
    pub stamp: RosTime,
    pub frame_id: String,
}

/// `geometry_msgs/msg/Point` and `Vector3`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/msg/Quaternion`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

/// `geometry_msgs/msg/Pose`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RosPose {
    /// m.
    pub position: Vector3,
    /// Rotation from the child's frame to the header's.
    pub orientation: Quaternion,
}

/// Row-major 6 x 6 matrix for x, y, z and the rotations about x, y, z: 36 consecutive numbers on the wire.
pub type Covariance = [[f64; 6]; 6];

/// `geometry_msgs/msg/PoseWithCovariance`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseWithCovariance {
    pub pose: RosPose,
    /// m², rad².
    pub covariance: Covariance,
}

/// `geometry_msgs/msg/Twist`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Twist {
    /// m/s.
    pub linear: Vector3,
    /// rad/s.
    pub angular: Vector3,
}

/// `geometry_msgs/msg/TwistWithCovariance`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TwistWithCovariance {
    pub twist: Twist,
    /// (m/s)², (rad/s)²; zeros if unknown.
    pub covariance: Covariance,
}

/// `geometry_msgs/msg/PoseWithCovarianceStamped`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseWithCovarianceStamped {
    pub header: RosHeader,
    pub pose: PoseWithCovariance,
}

/// `nav_msgs/msg/Odometry`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RosOdometry {
    pub header: RosHeader,
    /// Frame of the body, in which the twist is given.
    pub child_frame_id: String,
    pub pose: PoseWithCovariance,
    pub twist: TwistWithCovariance,
}

/// `geometry_msgs/msg/TransformStamped` with the fields of its transform.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TransformStamped {
    pub header: RosHeader,
    pub child_frame_id: String,
    /// Origin of the child in the parent, m.
    pub translation: Vector3,
    /// Rotation from the child's frame to the parent's.
    pub rotation: Quaternion,
}

/// `tf2_msgs/msg/TFMessage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TfMessage {
    pub transforms: Vec<TransformStamped>,
}

/// `visualization_msgs/msg/Marker` of a solid shape.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Marker {
    pub header: RosHeader,
    pub ns: String,
    pub id: i32,
    /// 1: a cube.
    pub kind: i32,
    /// 0: add or change the marker.
    pub action: i32,
    /// Centre of the shape in the header's frame.
    pub pose: RosPose,
    /// Size along each axis, m.
    pub scale: Vector3,
    /// Red, green, blue, opacity, 0 to 1.
    pub color: [f32; 4],
    /// Seconds, and fraction in ns, after which a viewer removes the marker.
    pub lifetime: (i32, u32),
    pub frame_locked: bool,
    pub unused: MarkerContent,
}

/// Points, texture, text and mesh of a marker, which are empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MarkerContent {
    points: Vec<Vector3>,
    colors: Vec<[f32; 4]>,
    texture_resource: String,
    texture: (RosHeader, String, Vec<u8>),
    uv_coordinates: Vec<[f32; 2]>,
    text: String,
    mesh_resource: String,
    mesh_file: (String, Vec<u8>),
    mesh_use_embedded_materials: bool,
}

/// `diagnostic_msgs/msg/KeyValue`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct KeyValue {
    pub key: String,
    pub value: String,
}

/// Levels of a `diagnostic_msgs/msg/DiagnosticStatus`.
pub mod level {
    pub const OK: u8 = 0;
    pub const WARN: u8 = 1;
    pub const ERROR: u8 = 2;
    /// No recent data.
    pub const STALE: u8 = 3;
}

/// `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DiagnosticStatus {
    /// One of [`level`].
    pub level: u8,
    pub name: String,
    pub message: String,
    pub hardware_id: String,
    pub values: Vec<KeyValue>,
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DiagnosticArray {
    pub header: RosHeader,
    pub status: Vec<DiagnosticStatus>,
}

/// Response of `std_srvs/srv/Trigger`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TriggerResponse {
    pub success: bool,
    pub message: String,
}

macro_rules! messages {
    ($($message:ident = $name:literal, $hash:literal;)*) => {$(
        impl RosMessage for $message {
            const TYPE: RosType = RosType {
                name: $name,
                hash: concat!("RIHS01_", $hash),
            };
        }
    )*};
}
messages! {
    RosOdometry = "nav_msgs::msg::dds_::Odometry_",
        "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
    PoseWithCovarianceStamped = "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
        "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e";
    TfMessage = "tf2_msgs::msg::dds_::TFMessage_",
        "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";
    Marker = "visualization_msgs::msg::dds_::Marker_",
        "45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0";
    DiagnosticArray = "diagnostic_msgs::msg::dds_::DiagnosticArray_",
        "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e";
}

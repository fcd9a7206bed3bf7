//! All topics, each declared once with name, type, rate, maximum size and staleness limit.

use core::mem::size_of;

use schemars::Schema;
use serde_json::{Value, json};

use crate::{
    msg, schema,
    time::{DroneClock, Span, VesselClock},
    wire::hash_record,
};

/// Medium of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// Between computers, as bincode; `bytes` is the limit on the wire.
    Radio,
    /// Inside one computer, as plain data in shared memory; `bytes` is the size in memory.
    Memory,
}

impl Medium {
    /// Name for display and for other programs.
    pub const fn name(self) -> &'static str {
        match self {
            Medium::Radio => "radio",
            Medium::Memory => "memory",
        }
    }
}

/// Reports of processes about themselves; not in the table, as no node reads them.
pub const PROCESS: Topic = Topic {
    name: "process/state",
    message: "ProcessState",
    medium: Medium::Memory,
    rate_hz: 2.0,
    bytes: size_of::<crate::process::ProcessState>(),
    stale_after: Span::from_millis(2000),
    buffer: 16,
    schema: schema::of::<crate::process::ProcessState>,
};

/// Report of the vessel's process about itself, broadcast to its drones at half the rate on a congested link.
pub const VESSEL_PROCESS: Topic = Topic {
    name: "process",
    medium: Medium::Radio,
    rate_hz: 1.0,
    bytes: crate::wire::MAX_WIRE_BYTES,
    stale_after: Span::from_millis(6000),
    ..PROCESS
};
/// Topic of process reports: of this computer, or of the vessel if `by_radio`.
pub const fn process_reports(by_radio: bool) -> &'static Topic {
    if by_radio { &VESSEL_PROCESS } else { &PROCESS }
}

/// Interval of an order's repetitions, and their timeout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retries {
    /// Interval between repetitions.
    pub period: Span,
    /// Maximum time without an acknowledgement.
    pub timeout: Span,
}

impl Retries {
    const fn of_millis(period: i64, timeout: i64) -> Retries {
        Retries {
            period: Span::from_millis(period),
            timeout: Span::from_millis(timeout),
        }
    }
}

/// [`COMMAND`] from a ground station or the remote control, via the autopilot link.
pub const AUTOPILOT_RETRIES: Retries = Retries::of_millis(250, 5000);
/// [`COMMAND`] or [`BEACON`] from the operator at the computer; acknowledging states arrive at 50 Hz.
pub const LOCAL_RETRIES: Retries = Retries::of_millis(500, 2000);
/// [`SETTINGS`]: a ground station repeats its request after one second.
pub const SETTINGS_RETRIES: Retries = Retries::of_millis(100, 800);
/// [`CREW`]: long enough for a restart of the vessel's process.
pub const CREW_RETRIES: Retries = Retries::of_millis(500, 6000);
/// [`OPERATOR`] from ashore to the vessel: requires a session and two radio links.
pub const ASHORE_RETRIES: Retries = Retries::of_millis(500, 12_000);
/// [`OPERATOR`] from the vessel to a drone; an abort has no timeout.
pub const RELAY_RETRIES: Retries = Retries::of_millis(500, 10_000);

/// Declaration of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Topic {
    /// Key expression suffix (radio) or service name (shared memory).
    pub name: &'static str,
    /// Message type.
    pub message: &'static str,
    /// Medium of the topic.
    pub medium: Medium,
    /// Nominal rate, Hz.
    pub rate_hz: f64,
    /// Maximum size, bytes.
    pub bytes: usize,
    /// Age at which a consumer treats a message as missing.
    pub stale_after: Span,
    /// Shared memory: maximum number of messages waiting for a subscriber; the oldest is dropped. State
    /// streams need the newest only, event streams all between two wake-ups.
    pub buffer: usize,
    /// Schema of the message.
    pub schema: fn() -> Schema,
}

impl Topic {
    /// Name of the message type without path and clocks.
    pub fn type_name(&self) -> &'static str {
        let bare = self.message.split('<').next().unwrap_or_default();
        bare.rsplit("::").next().unwrap_or_default()
    }
    /// Message version for Zenoh: the part after `;` in each message's encoding `application/octet-stream`.
    /// The key determines topic and type.
    pub fn encoding_schema() -> String {
        format!("{:04x}", msg::message_version())
    }
    /// Hash of the message's layout in memory: names, types and variants of its fields in order, size, and the compiler,
    /// which places the content of `Option` and enumerations. The rest is `repr(C)`.
    pub fn layout(&self) -> u64 {
        let fields = schema::hash(&(self.schema)());
        hash_record(&(self.message, fields, self.bytes, env!("ALIGHT_COMPILER"))).unwrap_or_default()
    }
    /// Topic with the schema of its message, for other programs.
    pub fn described(&self) -> Value {
        json!({
            "topic": self.name,
            "message": self.type_name(),
            "version": msg::message_version(),
            "medium": self.medium.name(),
            "rate_hz": self.rate_hz,
            "max_bytes": self.bytes,
            "stale_after_s": self.stale_after.secs(),
            "schema": (self.schema)(),
        })
    }
}

macro_rules! topics {
    (
        radio {$($(#[$radio_doc:meta])* $radio:ident: $radio_name:literal, $sent:ty, $radio_rate:literal Hz, $bytes:expr, $radio_stale:literal ms;)*}
        memory {$($(#[$doc:meta])* $id:ident: $name:literal, $ty:ty, $rate:literal Hz, $stale:literal ms, $buffer:literal deep;)*}
    ) => {
        $($(#[$radio_doc])* pub const $radio: Topic = Topic {
            name: $radio_name, message: stringify!($sent), medium: Medium::Radio, rate_hz: $radio_rate,
            bytes: $bytes, stale_after: Span::from_millis($radio_stale), buffer: 2, schema: schema::of::<$sent>,
        };)*
        $($(#[$doc])* pub const $id: Topic = Topic {
            name: $name, message: stringify!($ty), medium: Medium::Memory, rate_hz: $rate,
            bytes: size_of::<$ty>(), stale_after: Span::from_millis($stale), buffer: $buffer, schema: schema::of::<$ty>,
        };)*
        // Compile-time check that every type exists and fits.
        $(const _: () = assert!(size_of::<$sent>() <= 64 * 1024);)*
        $(const _: () = assert!(size_of::<$ty>() <= 64 * 1024);)*
        /// All topics.
        pub const ALL: &[Topic] = &[$($radio,)* $($id),*];
        plain! { $($ty => $id;)* }
    };
}
// Reports refer to topics by position: append new ones, and increase the message version.
topics! {
    radio {
        /// State of the vessel.
        ESTIMATE: "estimate", msg::EstimateUpdate<VesselClock>, 30.0 Hz, 300, 1000 ms;
        /// Wave model of the vessel.
        WAVE: "wave", msg::WaveUpdate<VesselClock>, 5.0 Hz, 1200, 5000 ms;
        /// Prediction of the vessel.
        PREDICTION: "prediction", msg::VesselPrediction<VesselClock>, 1.0 Hz, 1200, 3000 ms;
        /// Obstacles around the vessel's deck, if it has any.
        SURROUNDINGS: "surroundings", msg::VesselSurroundings<VesselClock>, 1.0 Hz, 300, 3000 ms;
        /// Time request of a drone.
        TIME_REQUEST: "time/request", msg::TimeRequest<DroneClock>, 2.0 Hz, 64, 2000 ms;
        /// Time reply of the vessel.
        TIME_REPLY: "time/reply", msg::TimeReply<VesselClock, DroneClock>, 2.0 Hz, 64, 2000 ms;
        /// Deck grant of the vessel.
        DECK: "deck", msg::DeckGrant<VesselClock>, 2.0 Hz, 112, 2000 ms;
        /// Operator command, from the operator to the vessel and from the vessel to a drone.
        OPERATOR: "command", msg::OperatorCommand<VesselClock>, 0.1 Hz, 64, 5000 ms;
        /// Drone statuses received by the vessel, for operators.
        DRONES: "drones", msg::DroneStatus, 2.0 Hz, 136, 2000 ms;
        /// Progress of operator commands, for operators.
        RECEIPTS: "receipts", msg::CommandReceipt, 2.0 Hz, 64, 2000 ms;
        /// Status of the drone, for the vessel's deck.
        DRONE_STATUS: "status", msg::DroneStatus, 2.0 Hz, 136, 2000 ms;
        /// RTCM 3 frames of the vessel's receiver, for a receiver that uses it as moving base.
        RTCM: "rtcm", msg::RtcmFrames<VesselClock>, 8.0 Hz, 1100, 2000 ms;
    }
    memory {
        /// Odometry of the autopilot.
        DRONE_STATE: "drone/state", msg::DroneState, 100.0 Hz, 200 ms, 2 deep;
        /// State of the autopilot.
        AUTOPILOT: "drone/autopilot", msg::AutopilotState, 10.0 Hz, 1000 ms, 2 deep;
        /// Detections of the deck's tags.
        TAG: "camera/tag", msg::TagPose, 30.0 Hz, 500 ms, 16 deep;
        /// Detections of the deck's UV markers.
        UVDAR: "camera/uvdar", msg::UvdarFix, 20.0 Hz, 500 ms, 16 deep;
        /// Rangefinder measurements.
        RANGE: "drone/range", msg::RangeSample, 50.0 Hz, 200 ms, 16 deep;
        /// State of the vessel on the drone's clock, admitted by the bridge.
        BRIDGE_ESTIMATE: "bridge/estimate", msg::VesselEstimate<DroneClock>, 30.0 Hz, 1000 ms, 4 deep;
        /// Wave model of the vessel on the drone's clock.
        BRIDGE_WAVE: "bridge/wave", msg::WaveModel<DroneClock>, 5.0 Hz, 5000 ms, 2 deep;
        /// Prediction of the vessel on the drone's clock.
        BRIDGE_PREDICTION: "bridge/prediction", msg::VesselPrediction<DroneClock>, 1.0 Hz, 3000 ms, 2 deep;
        /// Obstacles around the vessel's deck, on the drone's clock.
        BRIDGE_SURROUNDINGS: "bridge/surroundings", msg::VesselSurroundings<DroneClock>, 1.0 Hz, 3000 ms, 2 deep;
        /// Deck grant of the vessel on the drone's clock.
        BRIDGE_DECK: "bridge/deck", msg::DeckGrant<DroneClock>, 2.0 Hz, 2000 ms, 2 deep;
        /// State of link and clocks, measured by the bridge.
        LINK: "bridge/link", msg::LinkState, 10.0 Hz, 1000 ms, 2 deep;
        /// Forecast of the deck.
        FORECAST: "deck/forecast", msg::DeckForecast, 50.0 Hz, 300 ms, 2 deep;
        /// State of the mission.
        MISSION: "mission/state", msg::MissionState, 50.0 Hz, 500 ms, 2 deep;
        /// Trajectory of the planner.
        PLAN: "planner/plan", msg::Plan, 50.0 Hz, 500 ms, 2 deep;
        /// Set-point of the pilot node.
        SET_POINT: "pilot/setpoint", msg::SetPoint, 100.0 Hz, 100 ms, 2 deep;
        /// Command of the operator.
        COMMAND: "operator/command", msg::Command, 0.1 Hz, 5000 ms, 16 deep;
        /// Checkpoint of the mission. When it is stale, the pilot node has returned the drone to its autopilot.
        MISSION_CHECKPOINT: "mission/checkpoint", msg::MissionCheckpoint, 50.0 Hz, 5000 ms, 4 deep;
        /// Checkpoint of the predictor. When it is stale, the odometry and the drone have drifted.
        PREDICTOR_CHECKPOINT: "deck/checkpoint", msg::PredictorCheckpoint, 50.0 Hz, 2000 ms, 4 deep;
        /// Checkpoint of the autopilot link. A killed link is back after 0.4 to 0.7 s on a busy computer. By then PX4
        /// has switched from OFFBOARD to its hold, and returns to OFFBOARD at the first set-points if no other mode
        /// was chosen. The next report of the mode, within half a second, shows this; until then no set-point is
        /// followed.
        LINK_CHECKPOINT: "drone/checkpoint", msg::LinkCheckpoint, 50.0 Hz, 1500 ms, 4 deep;
        /// Measurements of the vessel's sensors.
        SENSORS: "vessel/sensors", msg::SensorReadings, 100.0 Hz, 500 ms, 64 deep;
        /// Byte counts of each of the vessel's real sensors.
        SOURCES: "vessel/sources", msg::SourceReport, 2.0 Hz, 3000 ms, 8 deep;
        /// State of the vessel's process.
        VESSEL: "vessel/status", msg::VesselStatus, 2.0 Hz, 3000 ms, 2 deep;
        /// Order of the vessel's crew.
        CREW: "vessel/crew", msg::CrewOrder, 0.1 Hz, 10000 ms, 16 deep;
        /// Mission settings from a ground station.
        SETTINGS: "operator/settings", msg::SettingsOrder, 0.1 Hz, 1000 ms, 2 deep;
        /// Position of the vessel from a beacon, which states its validity.
        BEACON: "deck/beacon", msg::DeckBeacon, 1.0 Hz, 10000 ms, 8 deep;
        /// Brightness of the belly camera's images.
        CAMERA_LIGHT: "camera/light", msg::CameraLight, 2.0 Hz, 2000 ms, 2 deep;
        /// Report of a computer about itself, from its supervisor.
        COMPUTER: "computer/report", msg::ComputerReport, 2.0 Hz, 3000 ms, 2 deep;
        /// RTCM 3 frames from the vessel's sensors.
        VESSEL_RTCM: "vessel/rtcm", msg::RtcmFrames<VesselClock>, 8.0 Hz, 2000 ms, 32 deep;
        /// RTCM 3 frames on the drone's clock, admitted by the bridge.
        BRIDGE_RTCM: "bridge/rtcm", msg::RtcmFrames<DroneClock>, 8.0 Hz, 2000 ms, 32 deep;
        /// Position of the drone relative to the vessel, by its receiver.
        RELATIVE: "drone/relative", msg::RelativePlace, 5.0 Hz, 1000 ms, 8 deep;
    }
}

impl crate::process::ProcessKind {
    /// Output topic that other processes wait for; None: the process waits for images, orders or the simulated world.
    pub const fn awaited(self) -> Option<&'static Topic> {
        match self {
            Self::Vessel => Some(&ESTIMATE),
            Self::Bridge => Some(&LINK),
            Self::Predictor => Some(&FORECAST),
            Self::Mission => Some(&MISSION),
            Self::Planner => Some(&PLAN),
            Self::Pilot => Some(&SET_POINT),
            Self::Autopilot => Some(&DRONE_STATE),
            Self::World | Self::Link | Self::Sensors | Self::Camera | Self::Uvdar | Self::View => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Serialize;

    use super::*;
    use crate::{
        msg::*,
        schema::{Field, SchemaKind, fields, is_optional},
        surroundings::{KeepOut, Surroundings},
        wire,
    };

    fn take<'a>(bytes: &mut &'a [u8], n: usize) -> &'a [u8] {
        let (taken, rest) = bytes.split_at(n);
        *bytes = rest;
        taken
    }
    fn integer(bytes: &mut &[u8], n: usize) -> u64 {
        let mut value = [0; 8];
        value[..n].copy_from_slice(take(bytes, n));
        u64::from_le_bytes(value)
    }
    /// Decodes numbers by path from the schema alone, as another program would.
    fn read(
        path: &str,
        schema: &serde_json::Map<String, Value>,
        bytes: &mut &[u8],
        out: &mut BTreeMap<String, f64>,
    ) {
        if is_optional(schema) && integer(bytes, 1) == 0 {
            return;
        }
        let mut set = |value| {
            out.insert(path.to_owned(), value);
        };
        match SchemaKind::of(schema) {
            SchemaKind::Number("double") => set(f64::from_bits(integer(bytes, 8))),
            SchemaKind::Number("float") => set(f32::from_bits(integer(bytes, 4) as u32).into()),
            SchemaKind::Number("float16") => set(f16::from_bits(integer(bytes, 2) as u16).into()),
            SchemaKind::Number("int64") => set(integer(bytes, 8) as i64 as f64),
            SchemaKind::Number("uint64") => set(integer(bytes, 8) as f64),
            SchemaKind::Number("uint32") => set(integer(bytes, 4) as f64),
            SchemaKind::Number("uint16") => set(integer(bytes, 2) as f64),
            SchemaKind::Number("uint8") => set(integer(bytes, 1) as f64),
            SchemaKind::Bool => set(integer(bytes, 1) as f64),
            SchemaKind::Enum(variants) => {
                let number = integer(bytes, 4) as usize;
                set(number as f64);
                if let (_, Some(content)) = variants[number] {
                    read(&format!("{path}.{}", variants[number].0), content, bytes, out);
                }
            }
            SchemaKind::Array(items, n) => {
                for k in 0..n {
                    read(&format!("{path}[{k}]"), items, bytes, out);
                }
            }
            SchemaKind::List(items, most) => {
                let n = integer(bytes, 8);
                assert!(n <= most, "{path}: {n} of {most}");
                for k in 0..n {
                    read(&format!("{path}[{k}]"), items, bytes, out);
                }
            }
            SchemaKind::Struct(content) => {
                for (name, s) in &content {
                    read(&format!("{path}.{name}"), s, bytes, out);
                }
            }
            other => panic!("{path}: {other:?}"),
        }
    }
    fn decoded(topic: &Topic, message: &impl Serialize) -> BTreeMap<String, f64> {
        let bytes = wire::encode(message).unwrap();
        let mut out = BTreeMap::new();
        let schema = (topic.schema)();
        let mut left = bytes.as_slice();
        read("", schema.as_object().unwrap(), &mut left, &mut out);
        assert!(left.is_empty(), "{}: {} bytes left over", topic.name, left.len());
        out
    }

    #[test]
    fn estimate_and_wave_decoded_by_their_schemas() {
        let header = Header::new(1, 2, 3, 4, crate::time::Time::from_nanos(5));
        let estimate = VesselEstimate::<VesselClock> {
            header,
            eta: [1.0, 2.0, 3.0, 0.1, 0.2, 0.25],
            uncertainty: [[f16::ONE, f16::ZERO, f16::from_f32(0.5)]; 6],
            mean_heading: [0.25, -0.5],
            ..VesselEstimate::default()
        };
        let read = decoded(&ESTIMATE, &EstimateUpdate::whole(&estimate));
        assert_eq!((read[".header.at"], read[".header.sequence"]), (5.0, 4.0));
        assert_eq!(
            (
                read[".attitude[2]"],
                read[".rest.uncertainty[5][2]"],
                read[".rest.mean_heading[1]"]
            ),
            (0.25, 0.5, -0.5)
        );
        let read = decoded(&ESTIMATE, &EstimateUpdate::of(&estimate));
        assert!(
            !read.contains_key(".rest.mean_heading[1]"),
            "the fourth estimate has no rest"
        );
        let wave = WaveModel::<VesselClock> {
            header,
            significant_height_m: 1.5,
            confidence: 0.5,
            modes: Seq::filled(
                [WaveMode {
                    pole: [-0.5, 2.0],
                    ..WaveMode::default()
                }; 3],
            ),
            slopes: Seq::filled([10, 20]),
            advice: Some(CourseAdvice {
                speed: [5.0, 3.0],
                ..CourseAdvice::default()
            }),
        };
        let mut sender = WaveSender::default();
        let read = decoded(&WAVE, &sender.update(&wave));
        assert_eq!((read[".modes[2].pole[1]"], read[".slopes[1]"]), (2.0, 20.0));
        let next = Header {
            sequence: 5,
            ..header
        };
        let read = decoded(&WAVE, &sender.update(&WaveModel { header: next, ..wave }));
        assert_eq!((read[".base"], read.get(".modes[2].pole[1]")), (4.0, None));
        assert!(read.contains_key(".factors[2][1]"));
    }

    #[test]
    fn radio_messages_decoded_by_their_schemas() {
        let header = Header::new(1, 2, 3, 4, crate::time::Time::from_nanos(5));
        let prediction = VesselPrediction::<VesselClock> {
            header,
            step_s: 0.5,
            origin: [0.0; 3],
            stages: Seq::filled(
                [PredictedStage {
                    eta: [7.0; 6],
                    ..PredictedStage::default()
                }; 2],
            ),
        };
        assert_eq!(decoded(&PREDICTION, &prediction)[".stages[1].eta[5]"], 7.0);
        let around = Surroundings {
            keep_out: Seq::filled([KeepOut::default(); 2]),
            ..Surroundings::default()
        };
        decoded(
            &SURROUNDINGS,
            &VesselSurroundings::<VesselClock> {
                header,
                surroundings: around,
            },
        );
        let frame = RtcmFrames::<VesselClock> {
            header,
            bytes: Seq::filled([0xD3; crate::rtcm::MAX_FRAME_BYTES]),
            ..RtcmFrames::default()
        };
        assert!(wire::encode(&frame).unwrap().len() <= RTCM.bytes);
        decoded(&RTCM, &frame);
        let course = Course::Steady(60.0);
        let grant = DeckGrant::<VesselClock> {
            header,
            owner: 2,
            course,
            ..DeckGrant::default()
        };
        let read = decoded(&DECK, &grant);
        assert_eq!(
            (read[".owner"], read[".course"], read[".course.Steady"]),
            (2.0, 1.0, 60.0)
        );
        let turning = DeckGrant::<VesselClock> {
            course: Course::Turning,
            ..grant
        };
        assert_eq!(decoded(&DECK, &turning)[".course"], 2.0);
        let kind = CommandKind::Hold;
        assert_eq!(
            decoded(&OPERATOR, &OperatorCommand::<VesselClock> { header, kind })[".kind"],
            2.0
        );
        decoded(&TIME_REQUEST, &TimeRequest::<DroneClock>::default());
        decoded(&TIME_REPLY, &TimeReply::<VesselClock, DroneClock>::default());
        let progress = CommandProgress::Replaced;
        assert_eq!(
            decoded(
                &RECEIPTS,
                &CommandReceipt {
                    progress,
                    ..CommandReceipt::default()
                }
            )[".progress"],
            4.0
        );
    }

    #[test]
    fn drone_status_decoded_by_its_schema() {
        let silent = DroneStatus::default();
        assert!(!decoded(&DRONE_STATUS, &silent).contains_key(".battery"));
        let status = DroneStatus {
            state: State::Flare,
            waiting: ReasonCode::TooFar.into(),
            battery: Some(0.5),
            deck_distance_m: Some(2.0),
            abort: Some([8, 9]),
            landed: LandedState::InAir,
            ..silent
        };
        let read = decoded(&DRONE_STATUS, &status);
        assert_eq!(
            (read[".state"], read[".waiting.code"]),
            (6.0, f64::from(ReasonCode::TooFar as u8))
        );
        assert_eq!(
            (read[".battery"], read[".deck_distance_m"], read[".abort[1]"]),
            (0.5, 2.0, 9.0)
        );
    }

    /// Numbers without a unit: counts, computer numbers, fractions, probabilities, ratios.
    const WITHOUT_UNIT: [&str; 24] = [
        "boot",
        "sequence",
        "vessel",
        "drone",
        "version",
        "confidence",
        "likelihood",
        "slopes",
        "newest_boot",
        "owner",
        "places",
        "attempts",
        "battery",
        "abort",
        "hold",
        "order",
        "operator",
        "value",
        "limit",
        "uncertainty",
        "datum_sum",
        "base",
        "factors",
        "bytes",
    ];

    #[test]
    fn units_of_the_radio_messages() {
        for topic in ALL.iter().filter(|t| t.medium == Medium::Radio) {
            for field in fields(&(topic.schema)()) {
                let Field {
                    path,
                    kind,
                    unit,
                    description,
                    ..
                } = &field;
                let is_number = kind.starts_with(['f', 'i', 'u']);
                let name = path.rsplit('.').next().unwrap();
                assert!(
                    !is_number || !unit.is_empty() || WITHOUT_UNIT.contains(&name),
                    "{}: {field:?} has no unit",
                    topic.name
                );
                assert!(
                    !description.is_empty(),
                    "{}: {path} has no description",
                    topic.name
                );
            }
        }
        let field_of = |topic: &Topic, path: &str| {
            let all = fields(&(topic.schema)());
            let f = all.into_iter().find(|f| f.path == path).unwrap();
            (f.kind, f.unit, f.frame)
        };
        let text = |kind: &str, unit: &str, frame: &str| (kind.to_owned(), unit.to_owned(), frame.to_owned());
        assert_eq!(
            field_of(&ESTIMATE, "position"),
            text("f32[3]", "m", "vessel's NED")
        );
        assert_eq!(
            field_of(&BRIDGE_ESTIMATE, "eta"),
            text("f64[6]", "m, rad", "vessel's NED")
        );
        assert_eq!(
            field_of(&ESTIMATE, "header.at"),
            text("i64", "ns", "vessel clock")
        );
        assert_eq!(field_of(&WAVE, "modes[].pole"), text("f32[2]", "1/s", ""));
        assert_eq!(field_of(&WAVE, "slopes"), text("u8[<= 60]", "", "deck's axes"));
        assert_eq!(
            field_of(&DRONE_STATUS, "deck_distance_m"),
            text("f32?", "m", "deck's centre")
        );
    }

    #[test]
    fn fields_of_every_topic() {
        for topic in ALL {
            for field in fields(&(topic.schema)()) {
                assert!(!field.kind.contains('-'), "{}: {field:?}", topic.name);
            }
        }
    }

    #[test]
    fn vessel_report_on_the_radio() {
        let radio = VESSEL_PROCESS.described();
        let memory = PROCESS.described();
        assert_eq!(
            (&radio["topic"], &radio["medium"], &radio["max_bytes"]),
            (&json!("process"), &json!("radio"), &json!(wire::MAX_WIRE_BYTES))
        );
        assert_eq!(
            (&memory["medium"], &radio["schema"]),
            (&json!("memory"), &memory["schema"])
        );
    }

    #[test]
    fn unique_topic_names() {
        let reports = [&PROCESS, &VESSEL_PROCESS];
        let mut names: Vec<&str> = ALL.iter().chain(reports).map(|t| t.name).collect();
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{names:?}");
    }

    #[test]
    fn topic_staleness_of_three_periods() {
        for t in ALL.iter().filter(|t| t.rate_hz >= 1.0) {
            assert!(t.stale_after.secs() * t.rate_hz >= 3.0, "{}", t.name);
        }
    }
}

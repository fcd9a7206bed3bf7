//! The topics, each declared once: name, type, rate, largest size and staleness limit.

use core::mem::size_of;

use crate::msg;
use crate::time::{DroneClock, Span, VesselClock};

/// How a topic travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// Between the computers, as bincode: `bytes` is the bound on the wire.
    Radio,
    /// Inside one computer, as plain data in shared memory: `bytes` is the size in memory.
    Memory,
}

/// What the processes report about themselves; declared beside the table because its type belongs to
/// the transport.
#[cfg(feature = "transport")]
pub const PROCESS: Topic = Topic {
    name: "process/state",
    message: "ProcessState",
    medium: Medium::Memory,
    rate_hz: 2.0,
    bytes: size_of::<crate::transport::process::ProcessState>(),
    stale_after: Span::from_millis(2000),
    buffer: 16,
};

/// A topic.
#[derive(Clone, Copy, Debug)]
pub struct Topic {
    /// Key expression suffix (radio) or service name (shared memory).
    pub name: &'static str,
    /// Message type.
    pub message: &'static str,
    /// How it travels.
    pub medium: Medium,
    /// Nominal rate, Hz.
    pub rate_hz: f64,
    /// Largest size, bytes.
    pub bytes: usize,
    /// Older than this, a consumer treats it as missing.
    pub stale_after: Span,
    /// Shared memory: how many messages wait for a subscriber; the oldest gives way. State streams
    /// need the newest only, event streams must not lose what came between two wake-ups.
    pub buffer: usize,
}

macro_rules! topics {
    ($($(#[$doc:meta])* $id:ident: $name:literal, $ty:ty, $medium:ident, $rate:literal Hz, $bytes:expr, $stale:literal ms, $buffer:literal deep;)*) => {
        $($(#[$doc])* pub const $id: Topic = Topic {
            name: $name, message: stringify!($ty), medium: Medium::$medium, rate_hz: $rate,
            bytes: $bytes, stale_after: Span::from_millis($stale), buffer: $buffer,
        };)*
        // Every topic's type exists and fits: a radio message is never larger in memory than 4 kB.
        $(const _: () = assert!(size_of::<$ty>() <= 64 * 1024);)*
        /// Every topic.
        pub const ALL: &[Topic] = &[$($id),*];
    };
}
topics! {
    /// The vessel's state.
    ESTIMATE: "estimate", msg::VesselEstimate<VesselClock>, Radio, 30.0 Hz, 300, 1000 ms, 2 deep;
    /// The vessel's wave model.
    WAVE: "wave", msg::WaveModel<VesselClock>, Radio, 5.0 Hz, 1200, 5000 ms, 2 deep;
    /// The vessel's own prediction.
    PREDICTION: "prediction", msg::VesselPrediction<VesselClock>, Radio, 1.0 Hz, 1200, 3000 ms, 2 deep;
    /// What stands around the vessel's deck; only where there is something.
    SURROUNDINGS: "surroundings", msg::VesselSurroundings<VesselClock>, Radio, 1.0 Hz, 300, 3000 ms, 2 deep;
    /// The drone's question for the vessel's time.
    TIME_REQUEST: "time/request", msg::TimeRequest<DroneClock>, Radio, 2.0 Hz, 64, 2000 ms, 2 deep;
    /// The vessel's answer.
    TIME_REPLY: "time/reply", msg::TimeReply<VesselClock, DroneClock>, Radio, 2.0 Hz, 64, 2000 ms, 2 deep;
    /// Whose the vessel's deck is.
    DECK: "deck", msg::DeckGrant<VesselClock>, Radio, 2.0 Hz, 80, 2000 ms, 2 deep;
    /// An operator's command, from the operator to the vessel and from the vessel to a drone.
    OPERATOR: "command", msg::OperatorCommand<VesselClock>, Radio, 0.1 Hz, 64, 5000 ms, 2 deep;
    /// Statuses of drones as the vessel received them, for operators.
    DRONES: "drones", msg::DroneStatus, Radio, 2.0 Hz, 128, 2000 ms, 2 deep;
    /// What became of an operator's command, for operators.
    RECEIPTS: "receipts", msg::CommandReceipt, Radio, 2.0 Hz, 64, 2000 ms, 2 deep;
    /// The drone's status, for the vessel's deck.
    DRONE_STATUS: "status", msg::DroneStatus, Radio, 2.0 Hz, 128, 2000 ms, 2 deep;
    /// The autopilot's odometry.
    DRONE_STATE: "drone/state", msg::DroneState, Memory, 100.0 Hz, size_of::<msg::DroneState>(), 200 ms, 2 deep;
    /// The autopilot's state.
    AUTOPILOT: "drone/autopilot", msg::AutopilotState, Memory, 10.0 Hz, size_of::<msg::AutopilotState>(), 1000 ms, 2 deep;
    /// Tag detections.
    TAG: "camera/tag", msg::TagPose, Memory, 30.0 Hz, size_of::<msg::TagPose>(), 500 ms, 16 deep;
    /// UV marker detections.
    UVDAR: "camera/uvdar", msg::UvdarFix, Memory, 20.0 Hz, size_of::<msg::UvdarFix>(), 500 ms, 16 deep;
    /// Rangefinder.
    RANGE: "drone/range", msg::RangeSample, Memory, 50.0 Hz, size_of::<msg::RangeSample>(), 200 ms, 16 deep;
    /// The vessel's state on the drone's clock, as the bridge admitted it.
    BRIDGE_ESTIMATE: "bridge/estimate", msg::VesselEstimate<DroneClock>, Memory, 30.0 Hz, size_of::<msg::VesselEstimate<DroneClock>>(), 1000 ms, 4 deep;
    /// The vessel's wave model on the drone's clock.
    BRIDGE_WAVE: "bridge/wave", msg::WaveModel<DroneClock>, Memory, 5.0 Hz, size_of::<msg::WaveModel<DroneClock>>(), 5000 ms, 2 deep;
    /// The vessel's own prediction on the drone's clock.
    BRIDGE_PREDICTION: "bridge/prediction", msg::VesselPrediction<DroneClock>, Memory, 1.0 Hz, size_of::<msg::VesselPrediction<DroneClock>>(), 3000 ms, 2 deep;
    /// What stands around the vessel's deck, on the drone's clock.
    BRIDGE_SURROUNDINGS: "bridge/surroundings", msg::VesselSurroundings<DroneClock>, Memory, 1.0 Hz, size_of::<msg::VesselSurroundings<DroneClock>>(), 3000 ms, 2 deep;
    /// Whose the vessel's deck is, on the drone's clock.
    BRIDGE_DECK: "bridge/deck", msg::DeckGrant<DroneClock>, Memory, 2.0 Hz, size_of::<msg::DeckGrant<DroneClock>>(), 2000 ms, 2 deep;
    /// The bridge's view of link and clocks.
    LINK: "bridge/link", msg::LinkState, Memory, 10.0 Hz, size_of::<msg::LinkState>(), 1000 ms, 2 deep;
    /// The deck's forecast.
    FORECAST: "deck/forecast", msg::DeckForecast, Memory, 50.0 Hz, size_of::<msg::DeckForecast>(), 300 ms, 2 deep;
    /// The mission's state.
    MISSION: "mission/state", msg::MissionState, Memory, 50.0 Hz, size_of::<msg::MissionState>(), 500 ms, 2 deep;
    /// The planner's trajectory.
    PLAN: "planner/plan", msg::Plan, Memory, 50.0 Hz, size_of::<msg::Plan>(), 500 ms, 2 deep;
    /// The pilot's set-point.
    SET_POINT: "pilot/setpoint", msg::SetPoint, Memory, 100.0 Hz, size_of::<msg::SetPoint>(), 100 ms, 2 deep;
    /// The operator's command.
    COMMAND: "operator/command", msg::Command, Memory, 0.1 Hz, size_of::<msg::Command>(), 5000 ms, 16 deep;
    /// What a ground station sets of the mission.
    SETTINGS: "operator/settings", msg::SettingsOrder, Memory, 0.1 Hz, size_of::<msg::SettingsOrder>(), 1000 ms, 2 deep;
    /// The mission's checkpoint. After this time the pilot has left the drone to its autopilot.
    MISSION_CHECKPOINT: "mission/checkpoint", msg::MissionCheckpoint, Memory, 50.0 Hz, size_of::<msg::MissionCheckpoint>(), 5000 ms, 4 deep;
    /// The predictor's checkpoint. After this time the odometry has drifted, and so has the drone.
    PREDICTOR_CHECKPOINT: "deck/checkpoint", msg::PredictorCheckpoint, Memory, 50.0 Hz, size_of::<msg::PredictorCheckpoint>(), 2000 ms, 4 deep;
    /// The autopilot link's checkpoint. A link that was killed is back after 0.4 to 0.7 s on a busy computer. PX4 has left
    /// OFFBOARD for its own hold by then, and comes back with the first set-points if nobody chose another mode; who did is seen
    /// by the next report of the mode, half a second later at most, and until then no set-point is followed.
    LINK_CHECKPOINT: "drone/checkpoint", msg::LinkCheckpoint, Memory, 50.0 Hz, size_of::<msg::LinkCheckpoint>(), 1500 ms, 4 deep;
    /// Measurements of the vessel's sensors.
    SENSORS: "vessel/sensors", msg::SensorReadings, Memory, 100.0 Hz, size_of::<msg::SensorReadings>(), 500 ms, 64 deep;
    /// What became of the bytes of each of the vessel's real sensors.
    SOURCES: "vessel/sources", msg::SourceReport, Memory, 2.0 Hz, size_of::<msg::SourceReport>(), 3000 ms, 8 deep;
    /// What the vessel's process knows.
    VESSEL: "vessel/status", msg::VesselStatus, Memory, 2.0 Hz, size_of::<msg::VesselStatus>(), 3000 ms, 2 deep;
    /// An order of the vessel's crew.
    CREW: "vessel/crew", msg::CrewOrder, Memory, 0.1 Hz, size_of::<msg::CrewOrder>(), 10000 ms, 16 deep;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unique_topic_names() {
        for (i, a) in ALL.iter().enumerate() {
            assert!(ALL.iter().skip(i + 1).all(|b| b.name != a.name), "{}", a.name);
        }
    }

    #[test]
    fn topic_staleness_of_three_periods() {
        for t in ALL.iter().filter(|t| t.rate_hz >= 1.0) {
            assert!(t.stale_after.secs() * t.rate_hz >= 3.0, "{}", t.name);
        }
    }
}

//! Test messages from vessel 1 to drone 1, shared by the tests of several modules.

use alight_shared::{
    msg::{
        AutopilotMode, AutopilotState, Command, CommandKind, DeckForecast, DeckStage, DroneState,
        FORECAST_STAGES, Header, LandedState, MissionState, Plan, PlanStage, Seq, Source, State,
    },
    time::{DroneClock, DroneTime, Span},
    wire::{decode_record, encode_record},
};
use serde::{Serialize, de::DeserializeOwned};

const STEP: Span = Span::from_millis(100);

pub(crate) fn header(n: u32, t: DroneTime) -> Header<DroneClock> {
    Header::new(1, 1, 1, n, t)
}

/// The input with this number in place of eight of its recorded bytes, unless the decoder rejects it.
pub(crate) fn with_number<T: Serialize + DeserializeOwned>(input: T, at: usize, number: f64) -> T {
    let mut bytes = encode_record(&input).unwrap();
    let at = at % (bytes.len() - 7);
    bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
    decode_record(&bytes).unwrap_or(input)
}

pub(crate) fn level(position: [f64; 3]) -> DeckStage {
    DeckStage {
        position,
        ..DeckStage::default()
    }
}

/// Forecast over 4 s with `Source::Both`; `deck` maps seconds from now to the deck's state.
pub(crate) fn forecast(header: Header<DroneClock>, deck: impl Fn(f64) -> DeckStage) -> DeckForecast {
    let stages: Seq<DeckStage, FORECAST_STAGES> =
        Seq::filled((0..FORECAST_STAGES).map(|k| deck(STEP.secs() * k as f64)));
    let mean_z = stages.iter().map(|s| s.position[2]).sum::<f64>() / FORECAST_STAGES as f64;
    DeckForecast {
        header,
        step: STEP,
        source: Source::Both,
        mean_z: Some(mean_z),
        stages,
        ..DeckForecast::default()
    }
}

/// Plan over 2 s; `stage` maps seconds from now to a stage.
pub(crate) fn plan(header: Header<DroneClock>, stage: impl Fn(f64) -> PlanStage) -> Plan {
    Plan {
        header,
        step: STEP,
        stages: Seq::filled((0..21).map(|k| stage(STEP.secs() * f64::from(k)))),
        ..Plan::default()
    }
}

pub(crate) fn mission(header: Header<DroneClock>, state: State, descent_mps: f64) -> MissionState {
    MissionState {
        header,
        state,
        descent_mps,
        commit_clearance_m: 0.8,
        ..MissionState::default()
    }
}

pub(crate) fn drone(header: Header<DroneClock>, position: [f64; 3]) -> DroneState {
    DroneState {
        header,
        position,
        ..DroneState::default()
    }
}

pub(crate) fn airborne(header: Header<DroneClock>) -> AutopilotState {
    AutopilotState {
        header,
        armed: true,
        mode: AutopilotMode::Offboard,
        landed: LandedState::InAir,
        battery: Some(0.9),
        thrust: Some(0.34),
        hover_thrust: 0.34,
        ..AutopilotState::default()
    }
}

pub(crate) fn command(header: Header<DroneClock>, kind: CommandKind) -> Command {
    Command { header, kind }
}

//! Mutants: what a node of ours would do with a defect that a storm has to find. They stand between the nodes of the
//! simulated world, never in the program that flies.

use alight_bridge::BridgeOut;
use alight_shared::msg::{
    AutopilotState, Command, CommandKind, DeckForecast, DeckGrant, DroneState, MissionCheckpoint,
    MissionState, Motors, RangeSample, SetPoint, State,
};
use alight_shared::time::{DroneClock, Span, Time};
use alight_uav::mission::MissionIn;
use serde::Serialize;

/// Ranges below this stop the motors of a mutant, m: its legs are 0.3 m long.
const STOPS_BELOW_M: f64 = 0.35;

/// A mutant's deck is released after this.
const SILENT: Span = Span::from_millis(1500);

/// A defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mutant {
    /// The mission takes no abort on the way down.
    AbortIgnored,
    /// The mission takes its last order to land for a new one.
    OrderKept,
    /// The motors stop on the rangefinder alone.
    StopsByRange,
    /// A forecast never grows old.
    StaleForecast,
    /// A mission's state never grows old.
    StaleMission,
    /// Jumps of the autopilot's frame are not noticed.
    FramesIgnored,
    /// A thrust that is not reported is none.
    ThrustMissing,
    /// A battery that is not reported is full, and so is one that is empty.
    ReserveWaived,
    /// Whoever has the deck, each drone takes it for its own.
    TwoOwners,
    /// A vessel that is silent has released its deck.
    DeckReleased,
    /// The offset of the two clocks stays as it was learnt first.
    ClockKept,
    /// A mission begins by the checkpoint of another boot: the flight's first.
    OldCheckpoint,
}

/// What a mutant remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mutated {
    /// The newest order to land.
    pub ordered: Option<Command>,
    /// The newest grant.
    pub grant: Option<DeckGrant<DroneClock>>,
    /// The first checkpoint of a mission that has an order.
    pub checkpoint: Option<MissionCheckpoint>,
}

impl Mutant {
    /// All of them.
    pub const ALL: [Mutant; 12] = [
        Mutant::AbortIgnored,
        Mutant::OrderKept,
        Mutant::StopsByRange,
        Mutant::StaleForecast,
        Mutant::StaleMission,
        Mutant::FramesIgnored,
        Mutant::ThrustMissing,
        Mutant::ReserveWaived,
        Mutant::TwoOwners,
        Mutant::DeckReleased,
        Mutant::ClockKept,
        Mutant::OldCheckpoint,
    ];
    /// What it makes of what the bridge received; the vessel's clock went `apart` from the drone's since the start.
    pub fn received(
        self,
        now: Time<DroneClock>,
        received: &mut BridgeOut,
        (drone, apart): (u32, Span),
        mutated: &mut Mutated,
    ) {
        mutated.grant = received.deck.or(mutated.grant);
        if self == Mutant::ClockKept {
            received.estimate.iter_mut().for_each(|m| m.header.at += apart);
            received.prediction.iter_mut().for_each(|m| m.header.at += apart);
        }
        let silent = |g: &DeckGrant<DroneClock>| now - g.header.at > SILENT;
        let granted = match self {
            Mutant::TwoOwners => received.deck,
            Mutant::DeckReleased => mutated.grant.filter(silent),
            Mutant::AbortIgnored
            | Mutant::OrderKept
            | Mutant::StopsByRange
            | Mutant::StaleForecast
            | Mutant::StaleMission
            | Mutant::FramesIgnored
            | Mutant::ThrustMissing
            | Mutant::ReserveWaived
            | Mutant::ClockKept
            | Mutant::OldCheckpoint => None,
        };
        if let Some(mut grant) = granted {
            (grant.owner, grant.header.at) = (drone, now);
            received.deck = Some(grant);
        }
    }
    /// What it makes of the mission's input.
    pub fn mission_in(self, now: Time<DroneClock>, input: &mut MissionIn, mutated: &Mutated) {
        let answered = input.checkpoint.filter(|c| c.header.boot != 0);
        if let (Mutant::OldCheckpoint, Some(_), Some(mut old)) = (self, answered, mutated.checkpoint) {
            old.header.at = now;
            input.checkpoint = Some(old);
        }
    }
    /// What it makes of commands in this state.
    pub fn commands(
        self,
        now: Time<DroneClock>,
        commands: &mut Vec<Command>,
        state: State,
        given: &mut Option<Command>,
    ) {
        let landing = |c: &Command| c.kind == CommandKind::Land;
        *given = commands.iter().copied().rfind(landing).or(*given);
        if self == Mutant::AbortIgnored && matches!(state, State::Descent | State::Flare) {
            commands.retain(|c| c.kind != CommandKind::Abort);
        }
        if let (Mutant::OrderKept, State::GaveUp, Some(command)) = (self, state, given) {
            // As an order that is new.
            (command.header.at, command.header.sequence) = (now, command.header.sequence.wrapping_add(1));
            commands.push(*command);
        }
    }
    /// What it makes of odometry.
    pub fn odometry(self, state: DroneState) -> DroneState {
        if self != Mutant::FramesIgnored {
            return state;
        }
        DroneState {
            frames: 0,
            heading_jumps: 0.0,
            ..state
        }
    }
    /// What it makes of the autopilot's state.
    pub fn autopilot(self, state: AutopilotState) -> AutopilotState {
        let (thrust, battery) = (state.thrust, state.battery);
        AutopilotState {
            thrust: thrust.or((self == Mutant::ThrustMissing).then_some(0.0)),
            battery: if self == Mutant::ReserveWaived {
                Some(1.0)
            } else {
                battery
            },
            ..state
        }
    }
    /// What it makes of this step's forecast, the last one being `last`.
    pub fn forecast(
        self,
        now: Time<DroneClock>,
        new: Option<DeckForecast>,
        last: Option<DeckForecast>,
    ) -> Option<DeckForecast> {
        let fresh = |f: DeckForecast| {
            let mut f = f;
            (f.header.at, f.radio_age_s, f.vision_age_s) = (now, 0.0, 0.0);
            f
        };
        if self == Mutant::StaleForecast {
            new.or(last).map(fresh)
        } else {
            new
        }
    }
    /// What it makes of this step's mission, the last one being `last`.
    pub fn mission(
        self,
        now: Time<DroneClock>,
        new: Option<MissionState>,
        last: &MissionState,
    ) -> Option<MissionState> {
        let kept = || {
            let mut kept = *last;
            kept.header.at = now;
            kept
        };
        new.or_else(|| (self == Mutant::StaleMission).then(kept))
    }
    /// What it makes of a set-point.
    pub fn set_point(self, set_point: SetPoint, ranges: &[RangeSample], state: State) -> SetPoint {
        let low = ranges.iter().any(|r| r.range_m < STOPS_BELOW_M);
        if self == Mutant::StopsByRange && low && matches!(state, State::Descent | State::Flare) {
            return SetPoint {
                motors: Motors::Stop,
                ..set_point
            };
        }
        set_point
    }
}

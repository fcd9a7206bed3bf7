//! The state machine of Procházka et al. 2024, section IV, as a pure function: phase, progress,
//! order and situation in, phase and reasons out.
//!
//! Interrupts first (touchdown, abort, loss of control, old data, hold, battery, patience), then
//! the row of the state table. The rows are in `rows`.

use alight_shared::msg::{AutopilotMode, CommandKind, Reason, ReasonCode, State};
use alight_shared::time::{DroneClock, Time};
use nalgebra::Vector3;

use super::config::MissionConfig;
use super::rows;
use super::situation::{ControlState, Situation};

pub(super) type DroneTime = Time<DroneClock>;

/// Why a hold began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldCause {
    /// An operator said so; ends with the next landing command.
    Operator,
    /// Data were old; ends when they are fresh again.
    Data,
}

/// A state with what it has to remember.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissionPhase {
    /// Waits.
    Idle,
    /// Straight up or down.
    GetAltitude {
        /// North and east where it began, m.
        from: [f64; 2],
    },
    /// Towards the vessel.
    Approach {
        /// In sight since.
        detected: Option<DroneTime>,
    },
    /// Over the vessel.
    Tracking {
        /// Steady since.
        steady: Option<DroneTime>,
    },
    /// Steady over the vessel.
    TrackingStable,
    /// Descends to the flare.
    Descent {
        /// A condition has been violated since.
        violated: Option<DroneTime>,
        /// Waits above the flare since.
        paused: Option<DroneTime>,
    },
    /// Descends to the deck.
    Flare {
        /// Below the commit clearance: only hard reasons break it off.
        committed: bool,
        /// A condition has been violated since.
        violated: Option<DroneTime>,
    },
    /// On the deck.
    Landed {
        /// The autopilot has been seen disarmed.
        disarmed: bool,
    },
    /// Stays at a safe height.
    Hold {
        /// Why.
        cause: HoldCause,
        /// Where, drone's NED, m.
        at: Vector3<f64>,
        /// Heading, rad.
        yaw: f64,
        /// Data have been fresh since.
        fresh: Option<DroneTime>,
    },
    /// Ended without landing.
    GaveUp {
        /// Where it stays, drone's NED, m.
        at: Vector3<f64>,
        /// Heading, rad.
        yaw: f64,
    },
}

impl MissionPhase {
    /// Its name on the wire.
    pub const fn state(&self) -> State {
        match self {
            MissionPhase::Idle => State::Idle,
            MissionPhase::GetAltitude { .. } => State::GetAltitude,
            MissionPhase::Approach { .. } => State::Approach,
            MissionPhase::Tracking { .. } => State::Tracking,
            MissionPhase::TrackingStable => State::TrackingStable,
            MissionPhase::Descent { .. } => State::Descent,
            MissionPhase::Flare { .. } => State::Flare,
            MissionPhase::Landed { .. } => State::Landed,
            MissionPhase::Hold { .. } => State::Hold,
            MissionPhase::GaveUp { .. } => State::GaveUp,
        }
    }
    /// Whether the mission flies the drone.
    const fn flies(&self) -> bool {
        !matches!(self, MissionPhase::Idle | MissionPhase::Landed { .. })
    }
    /// Whether the mission still means to land and depends on fresh data.
    const fn needs_data(&self) -> bool {
        self.flies() && !matches!(self, MissionPhase::Hold { .. } | MissionPhase::GaveUp { .. })
    }
}

/// What survives_pause a state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// A landing is wanted.
    pub landing: bool,
    /// Descents begun since the command.
    pub attempts: u32,
    /// When the landing was begun.
    pub started: DroneTime,
    /// The operator asked for a landing after the battery's reserve was reached.
    pub reserve_waived: bool,
}

/// What a step decided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// The phase from now on.
    pub phase: MissionPhase,
    /// What is remembered beside it.
    pub progress: Progress,
    /// Why the state changed; None when it did not.
    pub entered: Option<Reason>,
    /// Why the next state is not entered yet.
    pub waiting: Reason,
}

/// The outcome of one row of the table.
pub(super) enum Transition {
    /// Stays, waiting for this.
    Stay(MissionPhase, Reason),
    /// Goes to that phase for this reason.
    Go(MissionPhase, Reason),
    /// Breaks the landing off for this reason.
    BreakOff(Reason),
}

/// One step of the mission.
pub fn decide(
    phase: MissionPhase,
    progress: Progress,
    order: Option<CommandKind>,
    s: &Situation,
    c: &MissionConfig,
) -> Decision {
    let mut progress = progress;
    let row = interrupt(phase, &mut progress, order, s, c).unwrap_or_else(|| match phase {
        MissionPhase::Idle => rows::idle(&mut progress, s, c),
        MissionPhase::GetAltitude { from } => rows::get_altitude(from, s, c),
        MissionPhase::Approach { detected } => rows::approach(detected, s, c),
        MissionPhase::Tracking { steady } => rows::tracking(steady, s, c),
        MissionPhase::TrackingStable => rows::tracking_stable(&mut progress, s, c),
        MissionPhase::Descent { violated, paused } => rows::descent(violated, paused, s, c),
        MissionPhase::Flare { committed, violated } => rows::flare(committed, violated, s, c),
        MissionPhase::Landed { disarmed } => rows::landed(disarmed, &mut progress, s),
        MissionPhase::Hold {
            cause,
            at,
            yaw,
            fresh,
        } => rows::hold(cause, at, yaw, fresh, &progress, s, c),
        MissionPhase::GaveUp { .. } => Transition::Stay(phase, Reason::plain(ReasonCode::NotCommanded)),
    });
    let (phase, entered, waiting) = match row {
        Transition::Stay(p, waiting) => (p, None, waiting),
        Transition::Go(p, why) => (p, Some(why), Reason::default()),
        Transition::BreakOff(why) if progress.attempts >= c.max_attempts => {
            let spent = Reason::new(
                ReasonCode::OutOfRetries,
                f64::from(progress.attempts),
                f64::from(c.max_attempts),
            );
            (gave_up(s, c), Some(spent), why)
        }
        Transition::BreakOff(why) => (MissionPhase::Tracking { steady: None }, Some(why), why),
    };
    if matches!(phase, MissionPhase::GaveUp { .. } | MissionPhase::Landed { .. }) {
        progress.landing = false;
    }
    Decision {
        phase,
        progress,
        entered,
        waiting,
    }
}

/// What holds in every state that flies.
fn interrupt(
    phase: MissionPhase,
    progress: &mut Progress,
    order: Option<CommandKind>,
    s: &Situation,
    c: &MissionConfig,
) -> Option<Transition> {
    if phase.flies() && s.motors_stopped {
        return Some(Transition::Go(
            MissionPhase::Landed { disarmed: false },
            Reason::plain(ReasonCode::Touchdown),
        ));
    }
    match order {
        Some(CommandKind::Abort) => {
            progress.landing = false;
            if phase.flies() && !matches!(phase, MissionPhase::GaveUp { .. }) {
                return Some(Transition::Go(gave_up(s, c), Reason::plain(ReasonCode::Operator)));
            }
        }
        Some(CommandKind::Hold) => {
            progress.landing = false;
            if phase.flies() {
                return Some(Transition::Go(
                    holding(HoldCause::Operator, s, c),
                    Reason::plain(ReasonCode::Operator),
                ));
            }
        }
        Some(CommandKind::Land) => {
            let restarts = match phase {
                MissionPhase::Idle | MissionPhase::GaveUp { .. } => true,
                MissionPhase::Hold { cause, .. } => cause == HoldCause::Operator,
                MissionPhase::GetAltitude { .. }
                | MissionPhase::Approach { .. }
                | MissionPhase::Tracking { .. }
                | MissionPhase::TrackingStable
                | MissionPhase::Descent { .. }
                | MissionPhase::Flare { .. }
                | MissionPhase::Landed { .. } => false,
            };
            if restarts {
                progress.landing = true;
                progress.attempts = 0;
                progress.started = s.now;
                progress.reserve_waived = s.battery.is_some_and(|b| b < c.battery_reserve);
                if phase.flies() && matches!(phase, MissionPhase::GaveUp { .. }) {
                    return Some(Transition::Go(
                        holding(HoldCause::Data, s, c),
                        Reason::plain(ReasonCode::Commanded),
                    ));
                }
            }
        }
        None => {}
    }
    if !phase.flies() {
        return None;
    }
    match s.flight {
        ControlState::Disarmed => {
            progress.landing = false;
            return Some(Transition::Go(
                MissionPhase::Idle,
                Reason::plain(ReasonCode::NotFlying),
            ));
        }
        ControlState::OtherControl(mode) => {
            // The autopilot's own hold is a lapse of the link; anything else is somebody's will.
            progress.landing &= mode == AutopilotMode::Hold;
            return Some(Transition::Go(
                MissionPhase::Idle,
                Reason::plain(ReasonCode::NotFlying),
            ));
        }
        ControlState::Unknown if phase.needs_data() => {
            return Some(Transition::Go(
                holding(HoldCause::Data, s, c),
                Reason::plain(ReasonCode::NotFlying),
            ));
        }
        ControlState::Unknown | ControlState::OnGround | ControlState::Ours => {}
    }
    if let Some(why) = old_data(s).filter(|_| phase.needs_data()) {
        return Some(Transition::Go(holding(HoldCause::Data, s, c), why));
    }
    // In the air with the vessel below, landing is the quickest way out of an empty battery.
    let landing = matches!(phase, MissionPhase::Descent { .. } | MissionPhase::Flare { .. });
    let waits = matches!(
        phase,
        MissionPhase::Hold {
            cause: HoldCause::Operator,
            ..
        }
    );
    if landing || waits || matches!(phase, MissionPhase::GaveUp { .. }) {
        return None;
    }
    if let Some(b) = s
        .battery
        .filter(|b| *b < c.battery_reserve && !progress.reserve_waived)
    {
        return Some(Transition::Go(
            gave_up(s, c),
            Reason::new(ReasonCode::BatteryLow, b, c.battery_reserve),
        ));
    }
    let took = (s.now - progress.started).secs();
    if took > c.mission_timeout_s {
        return Some(Transition::Go(
            gave_up(s, c),
            Reason::new(ReasonCode::TooLong, took, c.mission_timeout_s),
        ));
    }
    None
}

/// What is too old to go on.
pub(super) fn old_data(s: &Situation) -> Option<Reason> {
    exceeds(ReasonCode::OdometryStale, s.odometry_age_s, s.odometry_limit_s)
        .or_else(|| exceeds(ReasonCode::ForecastStale, s.forecast_age_s, s.forecast_limit_s))
        .or_else(|| s.deck.is_none().then_some(Reason::plain(ReasonCode::NoVessel)))
}

/// The reason when `value` is beyond `limit`; a NaN is beyond.
pub(super) fn exceeds(code: ReasonCode, value: f64, limit: f64) -> Option<Reason> {
    (value > limit || value.is_nan()).then_some(Reason::new(code, value, limit))
}

/// Since when `holds` has been true, and for how long, s.
pub(super) fn lasting(holds: bool, since: Option<DroneTime>, now: DroneTime) -> (Option<DroneTime>, f64) {
    if !holds {
        return (None, 0.0);
    }
    let since = since.unwrap_or(now);
    (Some(since), (now - since).secs())
}

/// Hold where the drone is, not below the tracking height over the deck nor the minimum altitude.
pub(super) fn holding(cause: HoldCause, s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, c.tracking_height_m);
    MissionPhase::Hold {
        cause,
        at,
        yaw,
        fresh: None,
    }
}

/// Climb straight up to the approach height over the deck.
fn gave_up(s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = safe_place(s, c, c.approach_height_m);
    MissionPhase::GaveUp { at, yaw }
}

/// Straight above (or at) the drone's place, at least `height` over the deck's mean level.
fn safe_place(s: &Situation, c: &MissionConfig, height: f64) -> (Vector3<f64>, f64) {
    let (mut at, yaw) = s
        .own
        .map_or((Vector3::zeros(), 0.0), |own| (own.position, own.yaw));
    if let Some(mean) = s.mean_deck_z {
        at.z = at.z.min(mean - height);
    }
    at.z = at.z.min(s.water_z - c.minimum_altitude_m);
    (at, yaw)
}

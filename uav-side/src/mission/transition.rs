//! The state machine of Procházka et al. 2024, section IV, as a pure function: phase, progress,
//! order and situation in, phase and reasons out.
//!
//! Interrupts first (touchdown, abort, loss of control, old data, hold, battery, patience), then
//! the row of the state table. Each function below is one row.

use alight_shared::msg::{AutopilotMode, CommandKind, Reason, ReasonCode, State};
use alight_shared::time::{DroneClock, Time};
use nalgebra::Vector3;

use super::config::MissionConfig;
use super::situation::{Deck, Flight, Situation};

type Instant = Time<DroneClock>;

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
        seen: Option<Instant>,
    },
    /// Over the vessel.
    Tracking {
        /// Steady since.
        steady: Option<Instant>,
    },
    /// Steady over the vessel.
    TrackingStable,
    /// Descends to the flare.
    Descent {
        /// A condition has been violated since.
        violated: Option<Instant>,
        /// Waits above the flare since.
        gated: Option<Instant>,
    },
    /// Descends to the deck.
    Flare {
        /// Below the commit clearance: only hard reasons break it off.
        committed: bool,
        /// A condition has been violated since.
        violated: Option<Instant>,
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
        fresh: Option<Instant>,
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

/// What outlives a state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// A landing is wanted.
    pub landing: bool,
    /// Descents begun since the command.
    pub attempts: u32,
    /// When the landing was begun.
    pub started: Instant,
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
enum Row {
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
        MissionPhase::Idle => idle(&mut progress, s, c),
        MissionPhase::GetAltitude { from } => get_altitude(from, s, c),
        MissionPhase::Approach { seen } => approach(seen, s, c),
        MissionPhase::Tracking { steady } => tracking(steady, s, c),
        MissionPhase::TrackingStable => tracking_stable(&mut progress, s, c),
        MissionPhase::Descent { violated, gated } => descent(violated, gated, s, c),
        MissionPhase::Flare { committed, violated } => flare(committed, violated, s, c),
        MissionPhase::Landed { disarmed } => landed(disarmed, &mut progress, s),
        MissionPhase::Hold {
            cause,
            at,
            yaw,
            fresh,
        } => hold(cause, at, yaw, fresh, &progress, s, c),
        MissionPhase::GaveUp { .. } => Row::Stay(phase, Reason::plain(ReasonCode::NotCommanded)),
    });
    let (phase, entered, waiting) = match row {
        Row::Stay(p, waiting) => (p, None, waiting),
        Row::Go(p, why) => (p, Some(why), Reason::default()),
        Row::BreakOff(why) if progress.attempts >= c.max_attempts => {
            let spent = Reason::new(
                ReasonCode::OutOfRetries,
                f64::from(progress.attempts),
                f64::from(c.max_attempts),
            );
            (gave_up(s, c), Some(spent), why)
        }
        Row::BreakOff(why) => (MissionPhase::Tracking { steady: None }, Some(why), why),
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
) -> Option<Row> {
    if phase.flies() && s.motors_stopped {
        return Some(Row::Go(
            MissionPhase::Landed { disarmed: false },
            Reason::plain(ReasonCode::Touchdown),
        ));
    }
    match order {
        Some(CommandKind::Abort) => {
            progress.landing = false;
            if phase.flies() && !matches!(phase, MissionPhase::GaveUp { .. }) {
                return Some(Row::Go(gave_up(s, c), Reason::plain(ReasonCode::Operator)));
            }
        }
        Some(CommandKind::Hold) => {
            progress.landing = false;
            if phase.flies() {
                return Some(Row::Go(
                    holding(HoldCause::Operator, s, c),
                    Reason::plain(ReasonCode::Operator),
                ));
            }
        }
        Some(CommandKind::Land) => {
            let anew = match phase {
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
            if anew {
                progress.landing = true;
                progress.attempts = 0;
                progress.started = s.now;
                progress.reserve_waived = s.battery.is_some_and(|b| b < c.battery_reserve);
                if phase.flies() && matches!(phase, MissionPhase::GaveUp { .. }) {
                    return Some(Row::Go(
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
        Flight::Disarmed => {
            progress.landing = false;
            return Some(Row::Go(MissionPhase::Idle, Reason::plain(ReasonCode::NotFlying)));
        }
        Flight::NotOurs(mode) => {
            // The autopilot's own hold is a lapse of the link; anything else is somebody's will.
            progress.landing &= mode == AutopilotMode::Hold;
            return Some(Row::Go(MissionPhase::Idle, Reason::plain(ReasonCode::NotFlying)));
        }
        Flight::Unknown if phase.needs_data() => {
            return Some(Row::Go(
                holding(HoldCause::Data, s, c),
                Reason::plain(ReasonCode::NotFlying),
            ));
        }
        Flight::Unknown | Flight::OnGround | Flight::Ours => {}
    }
    if let Some(why) = old_data(s).filter(|_| phase.needs_data()) {
        return Some(Row::Go(holding(HoldCause::Data, s, c), why));
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
        return Some(Row::Go(
            gave_up(s, c),
            Reason::new(ReasonCode::BatteryLow, b, c.battery_reserve),
        ));
    }
    let took = (s.now - progress.started).secs();
    if took > c.mission_timeout_s {
        return Some(Row::Go(
            gave_up(s, c),
            Reason::new(ReasonCode::TooLong, took, c.mission_timeout_s),
        ));
    }
    None
}

/// Idle: waits for command, flight and the vessel's state by radio.
fn idle(progress: &mut Progress, s: &Situation, c: &MissionConfig) -> Row {
    let stay = |why| Row::Stay(MissionPhase::Idle, why);
    if !progress.landing {
        return stay(Reason::plain(ReasonCode::NotCommanded));
    }
    if s.flight != Flight::Ours {
        return stay(Reason::plain(ReasonCode::NotFlying));
    }
    if let Some(why) = old_data(s) {
        return stay(why);
    }
    match (s.fresh_deck(), s.own) {
        (Some(deck), Some(own)) if deck.radio_age_s <= c.radio_fresh_s => {
            progress.started = s.now;
            Row::Go(
                MissionPhase::GetAltitude {
                    from: [own.position.x, own.position.y],
                },
                Reason::plain(ReasonCode::Commanded),
            )
        }
        _ => stay(Reason::plain(ReasonCode::NoVessel)),
    }
}

/// Get altitude: until the approach height is reached.
fn get_altitude(from: [f64; 2], s: &Situation, c: &MissionConfig) -> Row {
    let stay = |why| Row::Stay(MissionPhase::GetAltitude { from }, why);
    let (Some(own), Some(mean)) = (s.own, s.mean_deck_z) else {
        return stay(Reason::plain(ReasonCode::NoVessel));
    };
    let error = (own.position.z - (mean - c.approach_height_m)).abs();
    if error > c.height_tolerance_m {
        return stay(Reason::new(ReasonCode::TooFar, error, c.height_tolerance_m));
    }
    Row::Go(
        MissionPhase::Approach { seen: None },
        Reason::plain(ReasonCode::Reached),
    )
}

/// Approach: until visual contact is confirmed.
fn approach(seen: Option<Instant>, s: &Situation, c: &MissionConfig) -> Row {
    let Some(deck) = s.fresh_deck() else {
        return Row::Stay(
            MissionPhase::Approach { seen: None },
            Reason::plain(ReasonCode::NoVessel),
        );
    };
    if deck.vision_age_s > c.sight_fresh_s {
        if deck.radio_age_s > c.radio_lost_s {
            return Row::Go(
                holding(HoldCause::Data, s, c),
                Reason::plain(ReasonCode::NoVessel),
            );
        }
        return Row::Stay(
            MissionPhase::Approach { seen: None },
            Reason::plain(ReasonCode::NotSeen),
        );
    }
    let since = seen.unwrap_or(s.now);
    if (s.now - since).secs() < c.contact_confirm_s {
        return Row::Stay(
            MissionPhase::Approach { seen: Some(since) },
            Reason::plain(ReasonCode::NotSeen),
        );
    }
    Row::Go(
        MissionPhase::Tracking { steady: None },
        Reason::plain(ReasonCode::Reached),
    )
}

/// What is unsteady above the deck; `slack` widens the limits.
fn unsteady(deck: &Deck, s: &Situation, c: &MissionConfig, slack: f64) -> Option<Reason> {
    let height = match (s.own, s.mean_deck_z) {
        (Some(own), Some(mean)) => (own.position.z - (mean - c.tracking_height_m)).abs(),
        _ => f64::INFINITY,
    };
    exceeds(ReasonCode::TooFar, deck.distance_m, c.steady_distance_m * slack)
        .or_else(|| {
            exceeds(
                ReasonCode::TooFast,
                deck.relative_speed_mps,
                c.steady_speed_mps * slack,
            )
        })
        .or_else(|| exceeds(ReasonCode::TooFar, height, c.steady_height_m * slack))
}

/// Sight lost in a state that follows the vessel by sight: the radio leads back to it, or nothing.
fn lost_sight(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<Row> {
    let why = exceeds(ReasonCode::SightLost, deck.vision_age_s, c.sight_lost_s)?;
    Some(if deck.radio_age_s <= c.radio_fresh_s {
        Row::Go(MissionPhase::Approach { seen: None }, why)
    } else {
        Row::Go(holding(HoldCause::Data, s, c), why)
    })
}

/// Tracking: until stably above the deck.
fn tracking(steady: Option<Instant>, s: &Situation, c: &MissionConfig) -> Row {
    let Some(deck) = s.fresh_deck() else {
        return Row::Stay(
            MissionPhase::Tracking { steady: None },
            Reason::plain(ReasonCode::NoVessel),
        );
    };
    if let Some(row) = lost_sight(deck, s, c) {
        return row;
    }
    if let Some(why) = unsteady(deck, s, c, 1.0) {
        return Row::Stay(MissionPhase::Tracking { steady: None }, why);
    }
    let since = steady.unwrap_or(s.now);
    let lasted = (s.now - since).secs();
    if lasted < c.steady_s {
        return Row::Stay(
            MissionPhase::Tracking { steady: Some(since) },
            Reason::new(ReasonCode::NotSteady, lasted, c.steady_s),
        );
    }
    Row::Go(
        MissionPhase::TrackingStable,
        Reason::new(ReasonCode::Reached, lasted, c.steady_s),
    )
}

/// Tracking stable: until the descent's conditions hold.
fn tracking_stable(progress: &mut Progress, s: &Situation, c: &MissionConfig) -> Row {
    let stay = |why| Row::Stay(MissionPhase::TrackingStable, why);
    let Some(deck) = s.fresh_deck() else {
        return stay(Reason::plain(ReasonCode::NoVessel));
    };
    if let Some(row) = lost_sight(deck, s, c) {
        return row;
    }
    if let Some(why) = unsteady(deck, s, c, c.break_factor) {
        return Row::Go(MissionPhase::Tracking { steady: None }, why);
    }
    if s.flight != Flight::Ours {
        return stay(Reason::plain(ReasonCode::NotFlying));
    }
    let refusal = exceeds(ReasonCode::SightLost, deck.vision_age_s, c.descent_sight_s)
        .or_else(|| exceeds(ReasonCode::TooFar, deck.distance_m, c.descent_distance_m))
        .or_else(|| exceeds(ReasonCode::TooFast, deck.relative_speed_mps, c.descent_speed_mps))
        .or_else(|| unfit(deck, c, 1.0))
        .or_else(|| exceeds(ReasonCode::NoPlan, s.plan_age_s, s.plan_limit_s));
    if let Some(why) = refusal {
        return stay(why);
    }
    if progress.attempts >= c.max_attempts {
        return Row::BreakOff(Reason::default());
    }
    progress.attempts += 1;
    Row::Go(
        MissionPhase::Descent {
            violated: None,
            gated: None,
        },
        Reason::new(ReasonCode::Reached, deck.distance_m, c.descent_distance_m),
    )
}

/// What makes the predicted deck unfit for a landing: uncertainty, motion or tilt.
fn unfit(deck: &Deck, c: &MissionConfig, slack: f64) -> Option<Reason> {
    use ReasonCode::{Infeasible, TooSteep, Uncertain};
    [
        (Uncertain, deck.horizontal_sd_m, c.horizontal_sd_m),
        (Uncertain, deck.vertical_sd_m, c.vertical_sd_m),
        (Infeasible, deck.speed_mps, c.deck_speed_mps),
        (Infeasible, deck.heave_mps, c.deck_heave_mps),
        (Infeasible, deck.acceleration_mps2, c.deck_acceleration_mps2),
        (TooSteep, deck.tilt_rad, c.deck_tilt_rad),
    ]
    .into_iter()
    .find_map(|(code, value, limit)| exceeds(code, value, limit * slack))
}

/// What forbids the flare at the gate.
fn not_ready_to_flare(deck: &Deck, c: &MissionConfig) -> Option<Reason> {
    let newest = deck.vision_age_s.min(deck.radio_age_s);
    exceeds(
        ReasonCode::SightLost,
        newest,
        c.radio_fresh_s.max(c.sight_fresh_s),
    )
    .or_else(|| exceeds(ReasonCode::SightLost, deck.vision_age_s, c.descent_sight_s))
    .or_else(|| exceeds(ReasonCode::TooFar, deck.distance_m, c.flare_distance_m))
    .or_else(|| exceeds(ReasonCode::TooFast, deck.relative_speed_mps, c.descent_speed_mps))
    .or_else(|| exceeds(ReasonCode::TooSteep, deck.tilt_rad, c.flare_tilt_rad))
}

/// What violates the conditions of a landing that has begun.
fn violation(deck: &Deck, s: &Situation, c: &MissionConfig, blind: f64) -> Option<Reason> {
    let cone = c.break_distance_m + c.break_cone * deck.clearance_m.max(0.0);
    exceeds(ReasonCode::SightLost, deck.vision_age_s, blind)
        .or_else(|| exceeds(ReasonCode::Deviated, deck.distance_m, cone))
        .or_else(|| unfit(deck, c, c.break_factor))
        .or_else(|| exceeds(ReasonCode::NoPlan, s.plan_age_s, s.plan_limit_s))
}

/// Descent: until the flare; an unmet condition of the flare stops the descent at the gate.
fn descent(violated: Option<Instant>, gated: Option<Instant>, s: &Situation, c: &MissionConfig) -> Row {
    let Some(deck) = s.fresh_deck() else {
        return Row::BreakOff(Reason::plain(ReasonCode::NoVessel));
    };
    let violation = violation(deck, s, c, c.descent_sight_s);
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    let close = deck.clearance_m < c.commit_clearance_m;
    // Below the commit clearance going on is safer than breaking off, while the deck is below.
    if let Some(why) = violation.filter(|_| lasted > c.violation_s && !close) {
        return Row::BreakOff(why);
    }
    if close && let Some(why) = exceeds(ReasonCode::Deviated, s.outside_m, c.lost_outside_m) {
        return Row::BreakOff(why);
    }
    let refusal = not_ready_to_flare(deck, c);
    if deck.clearance_m < c.flare_clearance_m && (refusal.is_none() || close) {
        return Row::Go(
            MissionPhase::Flare {
                committed: close,
                violated: None,
            },
            Reason::new(ReasonCode::Reached, deck.clearance_m, c.flare_clearance_m),
        );
    }
    let stopped = refusal.filter(|_| deck.clearance_m < c.gate_clearance_m);
    let (gated, waited) = lasting(stopped.is_some(), gated, s.now);
    if let Some(why) = stopped.filter(|_| waited > c.gate_timeout_s) {
        return Row::BreakOff(why);
    }
    let waiting = stopped.or(violation).unwrap_or(Reason::new(
        ReasonCode::TooFar,
        deck.clearance_m,
        c.flare_clearance_m,
    ));
    Row::Stay(MissionPhase::Descent { violated, gated }, waiting)
}

/// Flare: until touchdown; deck missed or lost breaks it off, soft reasons only while it is not
/// committed.
fn flare(committed: bool, violated: Option<Instant>, s: &Situation, c: &MissionConfig) -> Row {
    let Some(deck) = s.fresh_deck() else {
        return Row::BreakOff(Reason::plain(ReasonCode::NoVessel));
    };
    // The deck may fall away again: half a metre above the commit clearance there is time to judge.
    let committed = if committed {
        deck.clearance_m < c.commit_clearance_m + 0.5
    } else {
        deck.clearance_m < c.commit_clearance_m
    };
    let hard = exceeds(ReasonCode::Missed, -deck.clearance_m, c.missed_m).or_else(|| {
        exceeds(ReasonCode::Deviated, s.outside_m, c.lost_outside_m)
            .filter(|_| deck.clearance_m < c.commit_clearance_m)
    });
    if let Some(why) = hard {
        return Row::BreakOff(why);
    }
    let violation = violation(deck, s, c, blind_limit(deck, c));
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    if let Some(why) = violation.filter(|_| lasted > c.violation_s && !committed) {
        return Row::BreakOff(why);
    }
    let waiting = violation.unwrap_or(Reason::new(ReasonCode::TooFar, deck.clearance_m, 0.0));
    Row::Stay(MissionPhase::Flare { committed, violated }, waiting)
}

/// How long a flare may last without sight: longer while the radio tells where the vessel is, s.
pub(super) fn blind_limit(deck: &Deck, c: &MissionConfig) -> f64 {
    if deck.radio_age_s <= c.radio_fresh_s {
        c.flare_radio_blind_s
    } else {
        c.flare_blind_s
    }
}

/// Landed: until the drone, disarmed in between, is armed again.
fn landed(disarmed: bool, progress: &mut Progress, s: &Situation) -> Row {
    progress.landing = false;
    let armed = matches!(s.flight, Flight::OnGround | Flight::NotOurs(_) | Flight::Ours);
    if disarmed && armed {
        return Row::Go(MissionPhase::Idle, Reason::plain(ReasonCode::Reached));
    }
    Row::Stay(
        MissionPhase::Landed {
            disarmed: disarmed || s.flight == Flight::Disarmed,
        },
        Reason::default(),
    )
}

/// Hold: until data are fresh again and a landing is wanted.
fn hold(
    cause: HoldCause,
    at: Vector3<f64>,
    yaw: f64,
    fresh: Option<Instant>,
    progress: &Progress,
    s: &Situation,
    c: &MissionConfig,
) -> Row {
    let stay = |fresh, why| {
        Row::Stay(
            MissionPhase::Hold {
                cause,
                at,
                yaw,
                fresh,
            },
            why,
        )
    };
    if cause == HoldCause::Operator && !progress.landing {
        return stay(None, Reason::plain(ReasonCode::Operator));
    }
    if s.flight == Flight::Unknown {
        return stay(None, Reason::plain(ReasonCode::NotFlying));
    }
    if let Some(why) = old_data(s) {
        return stay(None, why);
    }
    let (Some(deck), Some(own)) = (s.fresh_deck(), s.own) else {
        return stay(None, Reason::plain(ReasonCode::NoVessel));
    };
    if deck.vision_age_s > c.sight_fresh_s && deck.radio_age_s > c.radio_fresh_s {
        return stay(
            None,
            Reason::new(ReasonCode::SightLost, deck.vision_age_s, c.sight_fresh_s),
        );
    }
    let (fresh, lasted) = lasting(true, fresh, s.now);
    if lasted < c.recover_s {
        return stay(fresh, Reason::new(ReasonCode::NotSteady, lasted, c.recover_s));
    }
    let next = if deck.vision_age_s <= c.sight_fresh_s && deck.distance_m <= c.resume_distance_m {
        MissionPhase::Tracking { steady: None }
    } else {
        MissionPhase::GetAltitude {
            from: [own.position.x, own.position.y],
        }
    };
    Row::Go(next, Reason::new(ReasonCode::Reached, lasted, c.recover_s))
}

/// What is too old to go on.
fn old_data(s: &Situation) -> Option<Reason> {
    exceeds(ReasonCode::OdometryOld, s.odometry_age_s, s.odometry_limit_s)
        .or_else(|| exceeds(ReasonCode::ForecastOld, s.forecast_age_s, s.forecast_limit_s))
        .or_else(|| s.deck.is_none().then_some(Reason::plain(ReasonCode::NoVessel)))
}

/// The reason when `value` is beyond `limit`; a NaN is beyond.
fn exceeds(code: ReasonCode, value: f64, limit: f64) -> Option<Reason> {
    (!(value <= limit)).then_some(Reason::new(code, value, limit))
}

/// Since when `holds` has been true, and for how long, s.
fn lasting(holds: bool, since: Option<Instant>, now: Instant) -> (Option<Instant>, f64) {
    if !holds {
        return (None, 0.0);
    }
    let since = since.unwrap_or(now);
    (Some(since), (now - since).secs())
}

/// Hold where the drone is, not below the tracking height over the deck nor the minimum altitude.
fn holding(cause: HoldCause, s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = refuge(s, c, c.tracking_height_m);
    MissionPhase::Hold {
        cause,
        at,
        yaw,
        fresh: None,
    }
}

/// Climb straight up to the approach height over the deck.
fn gave_up(s: &Situation, c: &MissionConfig) -> MissionPhase {
    let (at, yaw) = refuge(s, c, c.approach_height_m);
    MissionPhase::GaveUp { at, yaw }
}

/// Straight above (or at) the drone's place, at least `height` over the deck's mean level.
fn refuge(s: &Situation, c: &MissionConfig, height: f64) -> (Vector3<f64>, f64) {
    let (mut at, yaw) = s
        .own
        .map_or((Vector3::zeros(), 0.0), |own| (own.position, own.yaw));
    if let Some(mean) = s.mean_deck_z {
        at.z = at.z.min(mean - height);
    }
    at.z = at.z.min(s.water_z - c.minimum_altitude_m);
    (at, yaw)
}

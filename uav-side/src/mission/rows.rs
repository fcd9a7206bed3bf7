//! The rows of the state table: one function per state, what it waits for and where it goes.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{Reason, ReasonCode};
use nalgebra::Vector3;

use super::config::MissionConfig;
use super::situation::{ControlState, Deck, Situation};
use super::transition::{
    DroneTime, HoldCause, MissionPhase, Progress, Transition, exceeds, holding, lasting, old_data,
};

/// Idle: waits for command, flight and the vessel's state by radio.
pub(super) fn idle(progress: &mut Progress, s: &Situation, c: &MissionConfig) -> Transition {
    let stay = |why| Transition::Stay(MissionPhase::Idle, why);
    if !progress.landing {
        return stay(Reason::plain(ReasonCode::NotCommanded));
    }
    if s.flight != ControlState::Ours {
        return stay(Reason::plain(ReasonCode::NotFlying));
    }
    if let Some(why) = old_data(s) {
        return stay(why);
    }
    match (s.fresh_deck(), s.own) {
        (Some(deck), Some(own)) if deck.radio_age_s <= c.radio_fresh_s => {
            progress.started = s.now;
            Transition::Go(
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
pub(super) fn get_altitude(from: [f64; 2], s: &Situation, c: &MissionConfig) -> Transition {
    let stay = |why| Transition::Stay(MissionPhase::GetAltitude { from }, why);
    let (Some(own), Some(mean)) = (s.own, s.mean_deck_z) else {
        return stay(Reason::plain(ReasonCode::NoVessel));
    };
    let error = (own.position.z - (mean - c.approach_height_m)).abs();
    if error > c.height_tolerance_m {
        return stay(Reason::new(ReasonCode::TooFar, error, c.height_tolerance_m));
    }
    Transition::Go(
        MissionPhase::Approach { detected: None },
        Reason::plain(ReasonCode::Reached),
    )
}

/// Approach: until visual contact is confirmed.
pub(super) fn approach(detected: Option<DroneTime>, s: &Situation, c: &MissionConfig) -> Transition {
    let Some(deck) = s.fresh_deck() else {
        return Transition::Stay(
            MissionPhase::Approach { detected: None },
            Reason::plain(ReasonCode::NoVessel),
        );
    };
    if deck.vision_age_s > c.vision_fresh_s {
        if deck.radio_age_s > c.radio_lost_s {
            return Transition::Go(
                holding(HoldCause::Data, s, c),
                Reason::plain(ReasonCode::NoVessel),
            );
        }
        return Transition::Stay(
            MissionPhase::Approach { detected: None },
            Reason::plain(ReasonCode::NoVision),
        );
    }
    let since = detected.unwrap_or(s.now);
    if (s.now - since).secs() < c.contact_confirm_s {
        return Transition::Stay(
            MissionPhase::Approach {
                detected: Some(since),
            },
            Reason::plain(ReasonCode::NoVision),
        );
    }
    Transition::Go(
        MissionPhase::Tracking { steady: None },
        Reason::plain(ReasonCode::Reached),
    )
}

/// What is unsteady above the deck; `slack` widens the limits.
pub(super) fn unsteady(deck: &Deck, s: &Situation, c: &MissionConfig, slack: f64) -> Option<Reason> {
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
pub(super) fn lost_sight(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<Transition> {
    let why = exceeds(ReasonCode::VisionLost, deck.vision_age_s, c.vision_lost_s)?;
    Some(if deck.radio_age_s <= c.radio_fresh_s {
        Transition::Go(MissionPhase::Approach { detected: None }, why)
    } else {
        Transition::Go(holding(HoldCause::Data, s, c), why)
    })
}

/// Tracking: until stably above the deck.
pub(super) fn tracking(steady: Option<DroneTime>, s: &Situation, c: &MissionConfig) -> Transition {
    let Some(deck) = s.fresh_deck() else {
        return Transition::Stay(
            MissionPhase::Tracking { steady: None },
            Reason::plain(ReasonCode::NoVessel),
        );
    };
    if let Some(row) = lost_sight(deck, s, c) {
        return row;
    }
    if let Some(why) = unsteady(deck, s, c, 1.0) {
        return Transition::Stay(MissionPhase::Tracking { steady: None }, why);
    }
    let since = steady.unwrap_or(s.now);
    let lasted = (s.now - since).secs();
    if lasted < c.steady_s {
        return Transition::Stay(
            MissionPhase::Tracking { steady: Some(since) },
            Reason::new(ReasonCode::NotSteady, lasted, c.steady_s),
        );
    }
    Transition::Go(
        MissionPhase::TrackingStable,
        Reason::new(ReasonCode::Reached, lasted, c.steady_s),
    )
}

/// Tracking stable: until the descent's conditions hold.
pub(super) fn tracking_stable(progress: &mut Progress, s: &Situation, c: &MissionConfig) -> Transition {
    let stay = |why| Transition::Stay(MissionPhase::TrackingStable, why);
    let Some(deck) = s.fresh_deck() else {
        return stay(Reason::plain(ReasonCode::NoVessel));
    };
    if let Some(row) = lost_sight(deck, s, c) {
        return row;
    }
    if let Some(why) = unsteady(deck, s, c, c.break_factor) {
        return Transition::Go(MissionPhase::Tracking { steady: None }, why);
    }
    if s.flight != ControlState::Ours {
        return stay(Reason::plain(ReasonCode::NotFlying));
    }
    let rejection = (s.reservation.rejection())
        .or_else(|| exceeds(ReasonCode::VisionLost, deck.vision_age_s, c.descent_vision_s))
        .or_else(|| exceeds(ReasonCode::TooFar, deck.distance_m, c.descent_distance_m))
        .or_else(|| exceeds(ReasonCode::TooFast, deck.relative_speed_mps, c.descent_speed_mps))
        .or_else(|| deck_infeasible(deck, c, 1.0))
        .or_else(|| exceeds(ReasonCode::Infeasible, deck.turn_radps, c.deck_turn_radps))
        .or_else(|| exceeds(ReasonCode::TooSteep, s.recent_tilt_rad, c.recent_tilt_rad))
        .or_else(|| slides(deck, s, c))
        .or_else(|| exceeds(ReasonCode::TooWindy, s.wind_peak_mps2, c.wind_peak_mps2))
        .or_else(|| {
            let taken = deck
                .predicted_slope
                .map_or(s.friction_used_mps2, |slope| slope * GRAVITY);
            let left = c.friction * GRAVITY - taken + c.friction_margin_mps2;
            exceeds(ReasonCode::TooWindy, s.wind_peak_mps2, left)
        })
        .or_else(|| exceeds(ReasonCode::NoPlan, s.plan_age_s, s.plan_limit_s));
    if let Some(why) = rejection {
        return stay(why);
    }
    if progress.attempts >= c.max_attempts {
        return Transition::BreakOff(Reason::default());
    }
    progress.attempts += 1;
    Transition::Go(
        MissionPhase::Descent {
            violated: None,
            paused: None,
        },
        Reason::new(ReasonCode::Reached, deck.distance_m, c.descent_distance_m),
    )
}

/// Why a drone that went down now would be shed: a slope foretold before it has come to rest. Where that is
/// the waves' plain sum, also one felt a moment ago, when no wave foretold it; while nothing is foretold,
/// the next group of waves like the last.
fn slides(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let refused = |(since, limit)| Reason::new(ReasonCode::SlideObserved, since, limit);
    match deck.predicted_slope {
        Some(slope) if deck.wave_following_deficit >= c.bound_wave_deficit => {
            exceeds(ReasonCode::SlidePredicted, slope, c.bound_wave_slope_limit)
        }
        Some(slope) => exceeds(ReasonCode::SlidePredicted, slope, c.slope_limit)
            .or_else(|| s.apparent_slope.just_now(c).map(refused)),
        None => s.apparent_slope.rejection(c).map(refused),
    }
}

/// What makes the predicted deck unfit for a landing: uncertainty, motion or tilt.
pub(super) fn deck_infeasible(deck: &Deck, c: &MissionConfig, slack: f64) -> Option<Reason> {
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
pub(super) fn not_ready_to_flare(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let newest = deck.vision_age_s.min(deck.radio_age_s);
    exceeds(ReasonCode::VisionLost, newest, c.vision_fresh_s)
        .or_else(|| exceeds(ReasonCode::VisionLost, deck.vision_age_s, c.descent_vision_s))
        .or_else(|| exceeds(ReasonCode::TooFar, deck.distance_m, c.flare_distance_m))
        .or_else(|| exceeds(ReasonCode::TooFast, deck.relative_speed_mps, c.flare_speed_mps))
        .or_else(|| exceeds(ReasonCode::TooSteep, deck.tilt_rad, c.flare_tilt_rad))
        .or_else(|| exceeds(ReasonCode::Infeasible, deck.turn_radps, c.deck_turn_radps))
        .or_else(|| exceeds(ReasonCode::TooWindy, s.wind_mps2, c.wind_peak_mps2))
}

/// What violates the conditions of a landing that has begun.
pub(super) fn violation(deck: &Deck, s: &Situation, c: &MissionConfig, blind: f64) -> Option<Reason> {
    let cone = c.break_distance_m + c.break_cone * deck.clearance_m.max(0.0);
    exceeds(ReasonCode::VisionLost, deck.vision_age_s, blind)
        .or_else(|| exceeds(ReasonCode::Deviated, deck.distance_m, cone))
        .or_else(|| deck_infeasible(deck, c, c.break_factor))
        .or_else(|| exceeds(ReasonCode::NoPlan, s.plan_age_s, s.plan_limit_s))
}

/// Descent: until the flare; an unmet condition of the flare stops the descent at the gate.
pub(super) fn descent(
    violated: Option<DroneTime>,
    paused: Option<DroneTime>,
    s: &Situation,
    c: &MissionConfig,
) -> Transition {
    let Some(deck) = s.fresh_deck() else {
        return Transition::BreakOff(Reason::plain(ReasonCode::NoVessel));
    };
    let violation = violation(deck, s, c, c.descent_vision_s);
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    let close = deck.clearance_m < c.commit_clearance_m;
    // Below the commit clearance going on is safer than breaking off, while the deck is below.
    if let Some(why) = violation.filter(|_| lasted > c.violation_s && !close) {
        return Transition::BreakOff(why);
    }
    if close && let Some(why) = exceeds(ReasonCode::Deviated, s.outside_m, c.lost_outside_m) {
        return Transition::BreakOff(why);
    }
    if let Some(why) = s.reservation.lost().filter(|_| !close) {
        return Transition::BreakOff(why);
    }
    let rejection = not_ready_to_flare(deck, s, c);
    if deck.clearance_m < c.flare_clearance_m && (rejection.is_none() || close) {
        return Transition::Go(
            MissionPhase::Flare {
                committed: close,
                violated: None,
            },
            Reason::new(ReasonCode::Reached, deck.clearance_m, c.flare_clearance_m),
        );
    }
    let stopped = rejection.filter(|_| deck.clearance_m < c.decision_clearance_m);
    let (paused, waited) = lasting(stopped.is_some(), paused, s.now);
    if let Some(why) = stopped.filter(|_| waited > c.decision_timeout_s) {
        return Transition::BreakOff(why);
    }
    let waiting = stopped.or(violation).unwrap_or(Reason::new(
        ReasonCode::TooFar,
        deck.clearance_m,
        c.flare_clearance_m,
    ));
    Transition::Stay(MissionPhase::Descent { violated, paused }, waiting)
}

/// Flare: until touchdown; deck missed or lost breaks it off, soft reasons only while it is not
/// committed.
pub(super) fn flare(
    committed: bool,
    violated: Option<DroneTime>,
    s: &Situation,
    c: &MissionConfig,
) -> Transition {
    let Some(deck) = s.fresh_deck() else {
        return Transition::BreakOff(Reason::plain(ReasonCode::NoVessel));
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
        return Transition::BreakOff(why);
    }
    if let Some(why) = s.reservation.lost().filter(|_| !committed) {
        return Transition::BreakOff(why);
    }
    let violation = violation(deck, s, c, blind_limit(deck, c));
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    if let Some(why) = violation.filter(|_| lasted > c.violation_s && !committed) {
        return Transition::BreakOff(why);
    }
    let waiting = violation.unwrap_or(Reason::new(ReasonCode::TooFar, deck.clearance_m, 0.0));
    Transition::Stay(MissionPhase::Flare { committed, violated }, waiting)
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
pub(super) fn landed(disarmed: bool, progress: &mut Progress, s: &Situation) -> Transition {
    progress.landing = false;
    let armed = matches!(
        s.flight,
        ControlState::OnGround | ControlState::OtherControl(_) | ControlState::Ours
    );
    if disarmed && armed {
        return Transition::Go(MissionPhase::Idle, Reason::plain(ReasonCode::Reached));
    }
    Transition::Stay(
        MissionPhase::Landed {
            disarmed: disarmed || s.flight == ControlState::Disarmed,
        },
        Reason::default(),
    )
}

/// Hold: until data are fresh again and a landing is wanted.
pub(super) fn hold(
    cause: HoldCause,
    at: Vector3<f64>,
    yaw: f64,
    fresh: Option<DroneTime>,
    progress: &Progress,
    s: &Situation,
    c: &MissionConfig,
) -> Transition {
    let stay = |fresh, why| {
        Transition::Stay(
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
    if s.flight == ControlState::Unknown {
        return stay(None, Reason::plain(ReasonCode::NotFlying));
    }
    if let Some(why) = old_data(s) {
        return stay(None, why);
    }
    let (Some(deck), Some(own)) = (s.fresh_deck(), s.own) else {
        return stay(None, Reason::plain(ReasonCode::NoVessel));
    };
    if deck.vision_age_s > c.vision_fresh_s && deck.radio_age_s > c.radio_fresh_s {
        return stay(
            None,
            Reason::new(ReasonCode::VisionLost, deck.vision_age_s, c.vision_fresh_s),
        );
    }
    let (fresh, lasted) = lasting(true, fresh, s.now);
    if lasted < c.recover_s {
        return stay(fresh, Reason::new(ReasonCode::NotSteady, lasted, c.recover_s));
    }
    let next = if deck.vision_age_s <= c.vision_fresh_s && deck.distance_m <= c.resume_distance_m {
        MissionPhase::Tracking { steady: None }
    } else {
        MissionPhase::GetAltitude {
            from: [own.position.x, own.position.y],
        }
    };
    Transition::Go(next, Reason::new(ReasonCode::Reached, lasted, c.recover_s))
}

//! Concerns: the table of conditions that interrupt a state.
//!
//! A row applies in the phases of `in_phase` and acts while its condition holds; the first row that acts decides.
//! Inputs are already filtered: touchdown by the pilot's detector, control by two heartbeats, data by the staleness
//! limit of each topic, charge by `battery_lasts_s`. When the condition clears, the state resumes: a hold for data ends
//! once they are fresh, a landing restarts after a set-point loss, and the flight resumes once the charge is above the
//! reserve. A landing that a pilot or operator has ended needs a new order.
//!
//! | row | action | clears by | overruled by |
//! |---|---|---|---|
//! | touchdown | Landed | rotors that carry above the deck | a false touchdown |
//! | contact | Landed, or the flare again | rotors that carry above the deck | - |
//! | return | lands as if ordered | - | an operator's stop |
//! | control | Idle | control given back | - |
//! | report | Hold | the autopilot's next report | - |
//! | data | Hold, or completes the landing | fresh data | a softer landing |
//! | charge | deck, home or here | a charge above the reserve | an operator's stop, for a quarter of the reserve |
//! | rest | Hold at a safe height | an order | - |
//! | way | gives up | an order | charge, while it leads elsewhere |
//! | time | gives up | an order | charge, while it leads elsewhere |

use alight_shared::msg::{BatteryPlace, OwnMission, Phase, Reason, ReasonCode};

use super::{
    charge::{charge, is_unordered},
    checkpoint::{ends_softer, rests},
    limits::exceeds,
    phase::{
        HoldCause, MissionPhase, MissionProgress, PhaseTransition, gave_up, hard_contact, holding, lasting,
        old_data,
    },
    situation::{ControlState, Deck, Situation},
    take_off,
};
use crate::mission_config::MissionConfig;

pub(super) struct Concern {
    in_phase: fn(MissionPhase, &MissionProgress, &Situation, &MissionConfig) -> bool,
    act: fn(MissionPhase, &mut MissionProgress, &Situation, &MissionConfig) -> Option<PhaseTransition>,
}

/// Row that is checked before an operator's command.
pub(super) const BEFORE_ORDERS: [Concern; 1] = [Concern {
    in_phase: |phase, progress, _, _| phase.flies() && !progress.overruled,
    act: |_, _, s, _| {
        let touchdown = hard_contact(s).unwrap_or(ReasonCode::Touchdown.into());
        s.motors_stopped.then(|| MissionPhase::LANDED.enter(touchdown))
    },
}];
pub(super) const AFTER_ORDERS: [Concern; 9] = [
    Concern {
        // contact
        in_phase: |_, progress, _, _| progress.landing,
        act: |phase, progress, s, c| resume_landing(phase, progress, s, c),
    },
    Concern {
        // return
        in_phase: |phase, progress, s, _| returns(phase, progress, s),
        act: turn_back,
    },
    Concern {
        // control
        in_phase: |phase, _, _, _| phase.flies(),
        act: control,
    },
    Concern {
        // report
        in_phase: |phase, _, _, _| phase.needs_data(),
        act: |_, progress, s, c| {
            let silent = s.flight == ControlState::Unknown;
            silent.then(|| without_data(progress, s, c).enter(ReasonCode::NotFlying))
        },
    },
    Concern {
        // data
        in_phase: |phase, _, _, _| phase.needs_data(),
        act: data,
    },
    Concern {
        // charge
        // A climb over the deck continues until the drone is clear of the deck.
        in_phase: |phase, _, s, c| phase.flies() && !phase.takes_off() || is_unordered(phase, s, c),
        act: charge,
    },
    Concern {
        // rest
        in_phase: |phase, _, s, c| is_unordered(phase, s, c),
        act: rest,
    },
    Concern {
        // way
        in_phase: |phase, _, _, _| is_under_way(phase),
        act: way,
    },
    Concern {
        // time
        in_phase: |phase, _, _, _| is_under_way(phase),
        act: |_, progress, s, c| {
            let took_s = (s.now - progress.started).secs();
            let why = exceeds(ReasonCode::TooLong, took_s, c.mission_timeout_s)?;
            Some(gave_up(s, c).enter(why))
        },
    },
];

pub(super) fn interrupt(
    rows: &[Concern],
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let counts = |row: &&Concern, progress: &MissionProgress| (row.in_phase)(phase, progress, s, c);
    let mut rows = rows.iter();
    rows.find_map(|row| {
        counts(&row, progress)
            .then(|| (row.act)(phase, progress, s, c))
            .flatten()
    })
}

/// Whether the drone is on its way to a landing, before the descent.
pub(super) fn is_under_way(phase: MissionPhase) -> bool {
    let ended = matches!(phase, MissionPhase::GaveUp { .. }) || phase.waits_for_operator();
    phase.flies() && !phase.takes_off() && phase.state().phase() != Phase::Landing && !ended
}

/// Time without data in a committed flare after which a contact may have been missed, and time after the flare for
/// which resting feet are those of this landing, s.
const UNOBSERVED_S: f64 = 0.2;
const FLARED_S: f64 = 5.0;

/// Speed away from the deck of a drone that already climbs, m/s.
const CLIMBS_MPS: f64 = 1.0;

/// Maximum speed along the deck of feet that rest on it, m/s.
const RESTS_MPS: f64 = 0.5;

/// Continues a flare whose end was not observed, or whose set-points were lost: Landed if the feet rest on the deck, the
/// flare if the drone is still low above it. A drone that has drifted to
/// where some feet may not stand climbs.
pub(super) fn resume_landing(
    phase: MissionPhase,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let since_s = (s.now - progress.flared?).secs();
    let from_s = match s.flight {
        ControlState::SetPointsLost => 0.0,
        ControlState::OnGround | ControlState::Ours => UNOBSERVED_S,
        ControlState::Unknown | ControlState::Disarmed | ControlState::OtherControl(_) => return None,
    };
    if !(from_s..=FLARED_S).contains(&since_s) {
        return None;
    }
    let deck = s.fresh_deck()?;
    let outside_m = s.outside_m.max(s.rests_outside_m);
    let carried = s.rotors_carry == Some(true);
    if outside_m < 0.0 && rests(s) && !carried && deck.relative_speed_mps < RESTS_MPS {
        return Some(MissionPhase::LANDED.enter(ReasonCode::Touchdown));
    }
    if outside_m > 0.0 {
        return None;
    }
    let low = deck.clearance_m < c.commit_clearance_m && deck.sinking_mps > -CLIMBS_MPS;
    let waits = phase.waits_for_data() && s.flight != ControlState::SetPointsLost;
    if !(low && waits) {
        return None;
    }
    let flare = MissionPhase::Flare {
        committed: true,
        violated: None,
    };
    Some(flare.enter(Reason::new(ReasonCode::GivenBack, deck.clearance_m, 0.0)))
}

/// Whether the drone returns without an order: on a sortie, or in our mode after radio silence.
fn returns(phase: MissionPhase, progress: &MissionProgress, s: &Situation) -> bool {
    let silent = s.flight == ControlState::Ours && s.fresh_deck().is_none();
    let waits = phase.waits_for_operator() || phase == MissionPhase::Idle;
    waits && (progress.sortie || silent) && !progress.landing && !progress.stopped
}

/// Ends a sortie because of the battery or because the autopilot's own mission is complete: the drone lands as if
/// ordered. While the pilot or that mission flies it, the order waits.
fn turn_back(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let idles = phase == MissionPhase::Idle;
    let done = idles && progress.sortie && s.sortie.own_mission == OwnMission::Done;
    let why = (s.sortie.turns_back).or(done.then(|| ReasonCode::MissionDone.into()))?;
    (progress.landing, progress.started, progress.attempts) = (true, s.now, 0);
    let next = if idles {
        phase
    } else {
        holding(HoldCause::Data, s, c)
    };
    Some(next.enter(why))
}

/// Transition when a pilot or the autopilot controls the drone.
fn control(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    match s.flight {
        ControlState::Disarmed | ControlState::OtherControl(_) => {
            progress.landing = false;
            Some(MissionPhase::Idle.enter(s.not_flying()))
        }
        // When the drone follows set-points again low above the deck, it climbs.
        ControlState::SetPointsLost if phase.takes_off() => take_off::set_points_lost(phase, s, c),
        // When the drone follows set-points again, it resumes its hold or its climb to it.
        ControlState::SetPointsLost if phase.rests() => None,
        ControlState::SetPointsLost => Some(MissionPhase::Idle.enter(ReasonCode::NotFlying)),
        ControlState::Unknown | ControlState::OnGround | ControlState::Ours => None,
    }
}

/// Maximum age of data with which a landing is completed, s.
const COMPLETES_WITHOUT_DATA_S: f64 = 1.0;

/// Transition on stale data: a landing continues if that is softer; otherwise the drone holds.
fn data(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let why = old_data(s)?;
    Some(if completes_without_data(phase, progress, s, c) {
        phase.stay(why)
    } else {
        without_data(progress, s, c).enter(why)
    })
}

/// Whether a landing that was not stopped continues for a moment with old data, because that is softer, or because the
/// drone's own odometry is missing low above the deck. Without odometry nothing is commanded, so the decision to leave
/// can wait for it.
fn completes_without_data(
    phase: MissionPhase,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> bool {
    let known = s.forecast_age_s.max(s.odometry_age_s) <= COMPLETES_WITHOUT_DATA_S;
    let lands = phase.state().phase() == Phase::Landing && !progress.stopped;
    let touches = c.lowest_plan_m().is_none();
    let blind = s.odometry_age_s > s.odometry_limit_s && s.forecast_age_s <= s.forecast_limit_s;
    let goes_on = |d: Deck| blind && d.ends.is_some() || ends_softer(&d, s);
    lands && touches && known && s.deck.is_some_and(goes_on)
}

fn without_data(progress: &MissionProgress, s: &Situation, c: &MissionConfig) -> MissionPhase {
    if progress.stopped {
        gave_up(s, c)
    } else {
        holding(HoldCause::Data, s, c)
    }
}

/// Time after which a low hover without an order ends, s: enough for a pilot's handover and an order.
const RESTS_LOW_S: f64 = 3.0;

/// Transition of a drone without an order within reach of waves: it holds at a safe height. A drone whose rotors do not
/// carry it may be standing on the deck or the ground.
fn rest(
    _: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let own = s.own?;
    let height_m = s.water_z - own.position.z;
    let flies = s.rotors_carry == Some(true) && s.false_touchdown().is_some();
    let low = flies
        && height_m < c.minimum_altitude_m
        && !progress.landing
        && s.odometry_age_s <= s.odometry_limit_s;
    let (since, lasted) = lasting(low, progress.low_since, s.now);
    progress.low_since = since;
    let why = Reason::new(ReasonCode::TooLow, height_m, c.minimum_altitude_m);
    (lasted > RESTS_LOW_S).then(|| holding(HoldCause::Operator, s, c).enter(why))
}

/// Transition of a drone that a beacon alone has led too far, because a moving beacon could lead it anywhere.
fn way(
    _: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let deck = s.fresh_deck()?;
    let known = deck.radio_age_s <= c.radio_fresh_s || deck.vision_age_s <= c.vision_fresh_s;
    if known || s.moved.is_some() || deck.beacon.is_none() {
        progress.led_from = None;
        return None;
    }
    let here = s.own?.position;
    let [x, y] = *progress.led_from.get_or_insert([here.x, here.y]);
    let way_m = (here.x - x).hypot(here.y - y);
    let why = exceeds(ReasonCode::VesselTooFar, way_m, c.beacon_max_way_m)?;
    // Even on low battery the drone does not follow the beacon further.
    progress.deck_declined = true;
    Some(gave_up(s, c).enter(why))
}

pub(super) fn is_elsewhere(progress: &MissionProgress) -> bool {
    matches!(
        progress.low_battery,
        Some(BatteryPlace::Home | BatteryPlace::Here)
    )
}

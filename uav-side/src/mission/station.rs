//! Station: a place next to the vessel, ordered for a limited time, in the frame of the vessel's mean heading.
//!
//! It is a hold ([`HoldCause::Station`]) and ends like any hold. Its height is an approach height, clear of all
//! keep-out volumes; over a shared deck it differs from other drones' places and stations. If two drones are ordered to
//! the same height at once, the vessel's grant decides which is first, and the other leaves.

use alight_shared::{
    frames::wrap_angle,
    msg::{
        KeptStation, OWNER_ONLY_M, PLACES, Phase, Reason,
        ReasonCode::{
            BatteryLow, NoPlace, NoVessel, NotFlying, OnStation, Operator, StationNotNow, StationOver,
            StationTaken, StationTooLow, StationTooNear,
        },
        STATION_APART_M, Station, WaitingPlace,
    },
    time::Span,
};
use nalgebra::Vector3;

use super::{
    limits::exceeds,
    phase::{
        HoldCause, MissionPhase, MissionProgress, PhaseTransition, RejectedOrder, holding, moving_place,
        old_data, too_far,
    },
    reservation::Reservation,
    situation::{ControlState, Situation},
};
use crate::mission_config::MissionConfig;

/// Reason why the vessel's surroundings or other drones do not permit the place.
fn impossible(station: &Station, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let height_m = f64::from(station.height_m);
    if height_m < c.approach_height_m {
        return Some(Reason::new(StationTooLow, height_m, c.approach_height_m));
    }
    let shared = c.reservation_required;
    let owned = matches!(s.reservation, Reservation::Ours | Reservation::NotNeeded);
    if !owned && station.distance_m() < OWNER_ONLY_M {
        return Some(Reason::new(StationTooNear, station.distance_m(), OWNER_ONLY_M));
    }
    let others = (0..PLACES as u8).zip(s.others).filter(|(_, drone)| *drone != 0);
    let places = others.map(|(number, _)| c.approach_height_m + WaitingPlace::of(number).above_m);
    let stations = s
        .other_stations_m
        .iter()
        .filter(|m| **m != 0)
        .map(|m| f64::from(*m));
    places
        .chain(stations)
        .find(|other_m| shared && (other_m - height_m).abs() < STATION_APART_M)
        .map(|other_m| Reason::new(StationTaken, other_m, STATION_APART_M))
        // Only a drone with a waiting place gets a station.
        .or((shared && s.place.is_none()).then(|| Reason::new(NoPlace, PLACES as f64, 0.0)))
}

fn lost(s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let silent_s = match s.fresh_deck() {
        Some(deck) if deck.vision_age_s <= c.vision_lost_s => 0.0,
        Some(deck) => deck.radio_age_s,
        None => s.forecast_age_s.max(s.odometry_age_s),
    };
    exceeds(NoVessel, silent_s, c.radio_lost_s)
}

/// Reason to reject a station in `phase`.
fn rejected(
    phase: MissionPhase,
    station: &Station,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<Reason> {
    let searches = matches!(phase, MissionPhase::Search(_) | MissionPhase::Seek);
    let waits = phase == MissionPhase::Idle;
    let lands = phase.state().phase() == Phase::Landing;
    if waits && s.flight != ControlState::Ours {
        return Some(NotFlying.into());
    }
    if !(phase.flies() || waits) || phase.takes_off() || lands || searches {
        return Some(StationNotNow.into());
    }
    let low = s.battery.filter(|b| *b < s.battery_reserve);
    (s.rejection)
        .or_else(|| low.map(|b| Reason::new(BatteryLow, b, s.battery_reserve)))
        .or(s.sortie.turns_back.filter(|_| progress.sortie))
        .or_else(|| old_data(s))
        .or_else(|| s.fresh_deck().and_then(|deck| too_far(deck, c)))
        .or_else(|| {
            let radio_age_s = s.fresh_deck().map_or(f64::INFINITY, |d| d.radio_age_s);
            exceeds(NoVessel, radio_age_s, c.radio_fresh_s)
        })
        .or_else(|| impossible(station, s, c))
}

/// Transition on an order for a station; if it is rejected, continuation with the reason.
pub(super) fn commanded(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    station: Station,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let station = station.of_approach(c.approach_height_m);
    if let Some(why) = rejected(phase, &station, progress, s, c) {
        progress.rejected = Some(RejectedOrder { at: s.now, why });
        return None;
    }
    progress.cycles.end(Operator.into());
    (progress.landing, progress.stopped) = (false, false);
    (progress.deck_first, progress.low_battery) = (false, None);
    let kept = KeptStation {
        station,
        until: s.now + Span::from_secs(60.0 * f64::from(station.for_min)),
    };
    let mut next = holding(HoldCause::Station(kept), s, c);
    // A drone above the vessel climbs straight up first.
    if let (MissionPhase::Hold { at, .. }, Some(mean)) = (&mut next, s.mean_deck_z) {
        at.z = at.z.min(mean - f64::from(station.height_m));
    }
    Some(next.enter(waiting(&kept, s)))
}

/// Distance from the station, m, and the remaining time there.
fn waiting(kept: &KeptStation, s: &Situation) -> Reason {
    let left_s = (kept.until - s.now).secs().max(0.0);
    let off_m = s.fresh_deck().map_or(0.0, |deck| {
        // Position of the drone relative to the deck's centre.
        let own = Vector3::new(-deck.bearing_rad.cos(), -deck.bearing_rad.sin(), 0.0) * deck.distance_m;
        let bearing = deck.heading_rad + kept.station.bearing_rad();
        let there = Vector3::new(bearing.cos(), bearing.sin(), 0.0) * kept.station.distance_m();
        let height_m = (s.mean_deck_z.zip(s.own)).map_or(0.0, |(mean, own)| mean - own.position.z);
        (there - own + Vector3::z() * (f64::from(kept.station.height_m) - height_m)).norm()
    });
    Reason::new(OnStation, left_s, off_m)
}

/// Keeps the station in `phase` until its time is over or the place becomes impossible. Without the vessel the drone
/// stays over ground. Orders, low battery and mode changes take precedence.
pub(super) fn keeps(
    phase: MissionPhase,
    kept: &KeptStation,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let over = (s.now >= kept.until).then(|| StationOver.into());
    let far = || s.fresh_deck().and_then(|deck| too_far(deck, c));
    let ends = over.or_else(|| impossible(&kept.station, s, c)).or_else(far);
    if let Some(why) = ends {
        return leaves(phase, holding(HoldCause::Operator, s, c), s, c).enter(why);
    }
    let without = lost(s, c).or_else(|| old_data(s));
    phase.stay(without.unwrap_or_else(|| waiting(kept, s)))
}

/// A drone that leaves a station moves to the height of its waiting place, because that of the station may be reserved.
pub(super) fn leaves(
    phase: MissionPhase,
    mut next: MissionPhase,
    s: &Situation,
    c: &MissionConfig,
) -> MissionPhase {
    let kept = phase.station().and(s.place).and(s.mean_deck_z);
    if let (Some(mean), MissionPhase::Hold { at, .. } | MissionPhase::GaveUp { at, .. }) = (kept, &mut next) {
        at.z = s.no_lower(mean - s.approach_height_m(c));
    }
    next
}

/// Next waypoint around the deck to the station, relative to the deck's centre, NED, m. None while the drone climbs
/// from low above the vessel, or while the vessel is lost.
pub(super) fn offset(
    kept: &KeptStation,
    at: &Vector3<f64>,
    s: &Situation,
    c: &MissionConfig,
) -> Option<[f64; 2]> {
    let received = lost(s, c).is_none();
    let deck = s
        .fresh_deck()
        .filter(|_| received && !moving_place(at, s, false).0)?;
    let bearing = wrap_angle(deck.heading_rad + kept.station.bearing_rad());
    let distance_m = kept.station.distance_m();
    Some(if distance_m < OWNER_ONLY_M {
        [distance_m * bearing.cos(), distance_m * bearing.sin()]
    } else {
        deck.round(distance_m, bearing)
    })
}

/// Position of a drone that loses the vessel on the way to the station; `at` is the position of the hold.
pub(super) fn held_place(
    kept: &KeptStation,
    at: &Vector3<f64>,
    s: &Situation,
    c: &MissionConfig,
) -> Vector3<f64> {
    match (offset(kept, at, s, c), s.own) {
        (Some(_), Some(own)) => {
            let z = (s.mean_deck_z).map_or(at.z, |mean| mean - f64::from(kept.station.height_m));
            Vector3::new(own.position.x, own.position.y, s.no_lower(z))
        }
        (Some(_) | None, _) => moving_place(at, s, false).1,
    }
}

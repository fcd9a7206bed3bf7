//! Rules for every tick of a storm. `CONTRIBUTING.md` lists them with the faults that excuse them.

use core::fmt;
use std::collections::BTreeMap;

use alight_shared::msg::{BatteryPlace, ReasonCode, SetPoint, State};
use serde::Serialize;

use super::FlightKind;
use crate::{
    autopilots::simulated::SimulatedAutopilot,
    harness::{
        errors::EstimateError,
        outcome::{ContactEvent, FALSE_STOP_M, MAX_CONTACT_MPS},
        rig::Rig,
    },
};

/// Maximum time from the end of a command fault to the next set-point, s.
pub const RESUME_S: f64 = 1.5;
/// Maximum contact speed along the deck's normal during several simultaneous faults, m/s.
const SEVERAL_MPS: f64 = 2.0;
/// Time after the start or end of a fault during which contacts are excused, s.
const GRACE_S: f64 = 0.5;
/// Maximum time for which the rotors may carry the drone in `Landed`, s.
const CARRY_S: f64 = 3.0;
/// Time after an excused impact until the rules apply again, s.
const STRUCK_S: f64 = 5.0;
/// Maximum time from an abort to its effect, s.
const ABORT_S: f64 = 1.0;

/// Fraction of the battery's reserve below which a stopped landing resumes without an order.
pub(super) const SPENT_OF_RESERVE: f64 = 0.75;
/// Fraction of the reserve above which a drone must land safely despite a drained battery.
const LANDS_WITH: f64 = 0.5;

/// Maximum time armed on the deck without a report, s.
const ARMED_S: f64 = 10.0;
/// Limits of "low over the deck": height above the deck, and distance from its centre, m.
const LOW_M: f64 = 1.5;
/// Maximum time low over the deck without descending, s; a climb takes less.
const LOW_S: f64 = 3.0;

/// Error from which an estimate is wrong, in its standard deviations, and time after which a descent may not begin on it
/// unless a finding doubts it, s.
const WRONG_SDS: f64 = 3.0;
const UNDOUBTED_S: f64 = 5.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StormEnding {
    /// The drone is on the deck with motors off.
    Landed,
    /// Away from the deck, with a stated reason.
    Waits,
    /// Off the deck with motors off, or in the water, after a fault that excuses it: alone it ends as badly.
    Crashed,
    /// A rule was broken because parameters that only cause a warning are at the maker's default.
    Warned,
    Violated,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StormRule {
    StopInTheAir,
    HardContact,
    /// A part other than a foot touched the deck.
    TippedOver,
    Water,
    CarriesLanded,
    /// The mission neither follows an abort nor rejects it with a reason.
    AbortIgnored,
    /// A descent began after an abort, with charge left and no new order.
    Unordered,
    /// Low over the deck without descending.
    NotPermitted,
    KeepOut,
    TwoAtDeck,
    /// The battery ran empty in the air although faults had left enough charge for a landing.
    BatterySpent,
    Collision,
    StillArmed,
    NotFinite,
    /// Neither landed nor waiting for a stated reason, long after the last fault.
    Stuck,
    /// Waited in OFFBOARD (GUIDED) next to a free deck until the battery was spent.
    NoLastResort,
    /// Crashed, although the faults that excuse it end well alone.
    NotExcused,
    /// A descent began on an estimate that was wrong and that no finding doubted.
    Undoubted,
    /// Waits in the air without reporting its charge (sufficient or low) or its next step.
    WaitsUnreported,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Violation {
    pub rule: StormRule,
    pub t_s: f64,
    /// Height above the deck (m), speed (m/s), time (s), charge (0 to 1), or error (standard deviations), depending on
    /// the rule.
    pub figure: f64,
    pub state: State,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Violation { t_s, figure, .. } = self;
        let state = self.state.name();
        match self.rule {
            StormRule::StopInTheAir => write!(f, "motors stopped {figure:.2} m above the deck"),
            StormRule::HardContact => write!(f, "hit the deck at {figure:.2} m/s"),
            StormRule::TippedOver => {
                write!(f, "hit the deck with a part other than a foot at {figure:.2} m/s")
            }
            StormRule::Water => write!(f, "in the water"),
            StormRule::CarriesLanded => write!(f, "rotors carried the drone for {figure:.1} s on the deck"),
            StormRule::AbortIgnored => write!(f, "an abort had no effect within {figure:.1} s"),
            StormRule::Unordered => write!(f, "descends {figure:.1} s after its order was withdrawn"),
            StormRule::NotPermitted => {
                write!(f, "stayed low over the deck for {figure:.1} s without descending")
            }
            StormRule::KeepOut => write!(f, "{:.2} m inside a keep-out volume", -figure),
            StormRule::TwoAtDeck => write!(f, "{figure} drones are at the deck"),
            StormRule::BatterySpent => write!(f, "its battery ran empty {figure:.2} m above the deck"),
            StormRule::Collision => write!(f, "two drones collided"),
            StormRule::StillArmed => {
                write!(f, "armed on the deck for {figure:.1} s without reporting it")
            }
            StormRule::NotFinite => write!(f, "a set-point was not finite"),
            StormRule::Stuck => write!(f, "neither landed nor reports a reason to wait"),
            StormRule::NoLastResort => write!(
                f,
                "waited next to a free deck until its battery was at {:.0} %",
                100.0 * figure
            ),
            StormRule::NotExcused => {
                write!(f, "crashed, although the faults that excuse it end well alone")
            }
            StormRule::Undoubted => write!(
                f,
                "began to descend on an estimate that was wrong by {figure:.1} standard deviations for {UNDOUBTED_S} s, \
                 and no finding doubted it"
            ),
            StormRule::WaitsUnreported => write!(
                f,
                "waits with its battery at {:.0} % and reports neither that nor its next step",
                100.0 * figure
            ),
        }?;
        write!(f, " ({t_s:.2} s, {state})")
    }
}

/// Active faults that affect rules.
#[derive(Clone, Copy, Debug)]
pub struct StormScene {
    pub flight: FlightKind,
    /// Number of active and recent faults.
    pub faults: usize,
    /// Time of the last start or end of a fault, s.
    pub newest_s: f64,
    /// Set-points are missing or have just resumed.
    pub uncommanded: bool,
    /// A failsafe of the autopilot has chosen the mode.
    pub failsafe: bool,
    /// A fault has reduced the thrust.
    pub without_power: bool,
    /// The drone waits for its battery to run low.
    pub runs_low: bool,
    /// Charge left after a battery fault, 0 to 1 (0 during the fault); None without such a fault.
    pub charge_left: Option<f64>,
    /// Time at which the mission received the first abort, s.
    pub aborted_s: Option<f64>,
    pub last_abort_s: Option<f64>,
    /// Time of the abort or take-over that withdrew the order to land, s; None after a new order.
    pub withdrawn_s: Option<f64>,
}

impl StormScene {
    const fn is_uncommanded(&self) -> bool {
        self.uncommanded || self.failsafe
    }
    fn lands_with(&self, rig: &Rig) -> bool {
        let reserve = rig.nodes.drone.mission.battery_reserve;
        self.charge_left.is_none_or(|left| left >= LANDS_WITH * reserve)
    }
    /// Scene for drones without faults.
    const fn of_others(&self) -> StormScene {
        StormScene {
            uncommanded: false,
            failsafe: false,
            without_power: false,
            charge_left: None,
            aborted_s: None,
            last_abort_s: None,
            withdrawn_s: None,
            ..*self
        }
    }
}

#[derive(Clone, Debug, Default)]
pub struct StormWatch {
    turned: bool,
    /// Last excused impact or fall into the water, s; rules are suspended for [`STRUCK_S`] after it.
    struck_s: Option<f64>,
    /// Time since which the rotors have carried the drone in `Landed`, s.
    carries_since_s: Option<f64>,
    /// Time since which the drone has been low over the deck without descending, s.
    low_since_s: Option<f64>,
    /// Time since which the drone has been armed on the deck without a report, s.
    armed_since_s: Option<f64>,
    /// Time since which each estimated quantity has been wrong, s.
    wrong_since_s: BTreeMap<&'static str, f64>,
    /// State at the last tick.
    state: State,
    /// Start of the first landing for a spent battery, s.
    spent_s: Option<f64>,
    /// The drone has a drained battery, may not know the deck's position, and flies elsewhere.
    elsewhere: bool,
}

impl StormWatch {
    pub fn look(&mut self, rig: &Rig, k: usize, scene: &StormScene) -> Option<Violation> {
        let scene = if k == 0 { *scene } else { scene.of_others() };
        let broken = self
            .contacts(rig, k, &scene)
            .or_else(|| self.standing(rig, k, &scene))
            .or_else(|| self.orders(rig, k, &scene))
            .or_else(|| self.places(rig, k, &scene));
        let is_doubted = || rig.world.vessel_is_doubted();
        let estimates = self.estimates((rig.t_s(), rig.state(k)), rig.world.errors(k), is_doubted);
        let (rule, figure) = broken.or(estimates)?;
        Some(Violation {
            rule,
            t_s: rig.t_s(),
            figure,
            state: rig.state(k),
        })
    }

    fn contacts(&mut self, rig: &Rig, k: usize, scene: &StormScene) -> Option<(StormRule, f64)> {
        let o = rig.world.observation_of(k);
        let stopped = core::mem::replace(&mut self.turned, o.motors_on) && !o.motors_on;
        self.look_elsewhere(rig, k, scene);
        if stopped && o.feet_height_m() > FALSE_STOP_M && !self.elsewhere {
            match (is_empty(rig, k), scene.lands_with(rig)) {
                (true, false) => {}
                (true, true) => return Some((StormRule::BatterySpent, o.feet_height_m())),
                (false, _) => return Some((StormRule::StopInTheAir, o.feet_height_m())),
            }
        }
        let t_s = rig.t_s();
        let too_recent = t_s < scene.newest_s + GRACE_S;
        let without_power = scene.without_power || is_empty(rig, k) && !scene.lands_with(rig);
        let excused = scene.is_uncommanded() || without_power || too_recent || self.elsewhere;
        let strikes = |c: &ContactEvent| !c.foot || c.normal_mps > MAX_CONTACT_MPS;
        let rests = !o.motors_on || o.in_water || !o.contacts.is_empty();
        if excused && o.contacts.iter().any(strikes) || self.struck_s.is_some() && rests {
            self.struck_s = Some(t_s);
        }
        self.struck_s = self.struck_s.filter(|at| t_s < at + STRUCK_S);
        let struck = self.struck_s.is_some();
        if !(excused || struck) {
            let limit_mps = if scene.faults > 1 {
                SEVERAL_MPS
            } else {
                MAX_CONTACT_MPS
            };
            let hard = o.contacts.iter().find(|c| c.normal_mps > limit_mps);
            if let Some(contact) = hard {
                return Some((StormRule::HardContact, contact.normal_mps));
            }
            if let Some(contact) = o.contacts.iter().find(|c| !c.foot) {
                return Some((StormRule::TippedOver, contact.normal_mps));
            }
        }
        if (without_power || self.elsewhere) && o.in_water {
            self.struck_s = Some(t_s);
        }
        (o.in_water && self.struck_s.is_none()).then(|| (StormRule::Water, o.feet_height_m()))
    }
    /// Tracks a drone with a low battery that may not know the deck's position: the autopilot flies it home
    /// or down, unless it descends to the deck after all.
    fn look_elsewhere(&mut self, rig: &Rig, k: usize, scene: &StormScene) {
        let sent = matches!(
            rig.mission(k).low_battery,
            Some(BatteryPlace::Home | BatteryPlace::Here)
        );
        let without_deck = scene.runs_low && !rig.world.deck_is_free(k);
        // The autopilot's failsafe lands it where the mission would.
        let goes = sent || without_deck && scene.failsafe;
        let may = scene.flight.may_land_elsewhere() && scene.charge_left.is_some() || without_deck;
        self.elsewhere = may && (goes || self.elsewhere && !rig.state(k).meets_deck());
    }

    /// Checks for rotors that carry the drone on the deck, and for an unreported armed state.
    fn standing(&mut self, rig: &Rig, k: usize, scene: &StormScene) -> Option<(StormRule, f64)> {
        let t_s = rig.t_s();
        let state = rig.state(k);
        let o = rig.world.observation_of(k);
        let carries = state == State::Landed && o.motors_on && rig.thrust(k) > 0.5 * rig.hover_thrust(k);
        let carried_s = lasts(&mut self.carries_since_s, carries, t_s);
        if carried_s > CARRY_S && !scene.is_uncommanded() {
            return Some((StormRule::CarriesLanded, carried_s));
        }
        // Motors may turn on the deck in these states.
        let turns = state == State::Flare || state.is_take_off();
        let stands = o.motors_on && o.feet_height_m().abs() < FALSE_STOP_M && !turns;
        let reported = rig
            .world
            .drones()
            .get(k)
            .is_some_and(|d| d.still_armed_s().is_some());
        let armed_s = lasts(&mut self.armed_since_s, stands && !reported, t_s);
        (armed_s > ARMED_S && !scene.is_uncommanded()).then_some((StormRule::StillArmed, armed_s))
    }

    /// Checks for a descent that begins on a wrong estimate without a finding.
    fn estimates(
        &mut self,
        (t_s, state): (f64, State),
        errors: impl Iterator<Item = EstimateError>,
        is_doubted: impl FnOnce() -> bool,
    ) -> Option<(StormRule, f64)> {
        let before = core::mem::take(&mut self.wrong_since_s);
        let mut worst_sds = 0.0_f64;
        for e in errors.filter(|e| e.in_deviations() > WRONG_SDS) {
            let since_s = before.get(e.quantity).copied().unwrap_or(t_s);
            self.wrong_since_s.insert(e.quantity, since_s);
            if t_s > since_s + UNDOUBTED_S {
                worst_sds = worst_sds.max(e.in_deviations());
            }
        }
        let before = core::mem::replace(&mut self.state, state);
        let begins = self.state == State::Descent && before != State::Descent;
        let breaks = begins && worst_sds > 0.0 && !is_doubted();
        breaks.then_some((StormRule::Undoubted, worst_sds))
    }

    /// Checks for ignored aborts, and for descents whose order was withdrawn.
    fn orders(&mut self, rig: &Rig, k: usize, scene: &StormScene) -> Option<(StormRule, f64)> {
        let t_s = rig.t_s();
        let state = rig.state(k);
        let o = rig.world.observation_of(k);
        // A mission complies if it climbs, holds, has landed, or continues for a stated reason.
        let mission = rig.mission(k);
        let stated = mission.waiting.code == ReasonCode::CompletesLanding || mission.low_battery.is_some();
        let goes_on = !stated && goes_on(scene.flight, rig, k);
        let withdrawn = scene.aborted_s.filter(|at| scene.withdrawn_s == Some(*at));
        if let Some(at) = withdrawn.filter(|at| o.motors_on && goes_on && t_s > at + ABORT_S) {
            return Some((StormRule::AbortIgnored, t_s - at));
        }
        // After an abort the operator keeps part of the reserve; after a take-over the landing may use all of it.
        let fraction = scene.aborted_s.map_or(1.0, |_| SPENT_OF_RESERVE);
        self.spent_s = self.spent_s.or(is_spent(rig, k, fraction).then_some(t_s));
        // A drone that waits until its battery runs low lands as a last resort.
        let at = scene.withdrawn_s.filter(|_| o.motors_on && !scene.runs_low)?;
        // An abort after the charge was spent declines the deck.
        let before = |spent_s: f64| scene.last_abort_s.is_none_or(|abort_s| abort_s <= spent_s);
        if self.spent_s.is_some_and(before) {
            return None;
        }
        let descends = state == State::Descent && rig.entered_s(k) > at + ABORT_S;
        descends.then_some((StormRule::Unordered, t_s - at))
    }

    fn places(&mut self, rig: &Rig, k: usize, scene: &StormScene) -> Option<(StormRule, f64)> {
        let t_s = rig.t_s();
        let state = rig.state(k);
        let o = rig.world.observation_of(k);
        let at_deck = rig.using_the_deck().len();
        if at_deck > 1 {
            return Some((StormRule::TwoAtDeck, at_deck as f64));
        }
        if o.collisions > 0 {
            return Some((StormRule::Collision, f64::from(o.collisions)));
        }
        let excused = scene.uncommanded || scene.without_power || self.struck_s.is_some();
        let gap_m = o
            .keep_out_gap_m
            .filter(|gap| *gap < 0.0 && o.motors_on && !excused && !scene.failsafe);
        if let Some(gap_m) = gap_m {
            return Some((StormRule::KeepOut, gap_m));
        }
        let on_deck = state.stands_for_take_off() || state == State::TakeOff;
        let stands = state == State::Idle && o.feet_height_m().abs() < FALSE_STOP_M;
        let descends = on_deck || state.meets_deck() || stands;
        let low = o.motors_on && o.feet_height_m() < LOW_M && o.horizontal_m < LOW_M;
        let low_s = lasts(&mut self.low_since_s, low && !descends && !excused, t_s);
        if low_s > LOW_S {
            return Some((StormRule::NotPermitted, low_s));
        }
        let set_point = rig.world.drones().get(k).and_then(|d| d.last_set_point);
        (!set_point.as_ref().is_none_or(is_finite)).then_some((StormRule::NotFinite, f64::NAN))
    }
}

fn is_empty(rig: &Rig, k: usize) -> bool {
    let drone = rig.world.drones().get(k);
    drone
        .and_then(|d| d.autopilot())
        .is_some_and(SimulatedAutopilot::is_empty)
}

/// Whether the drone lands because its charge is below this fraction of the reserve.
fn is_spent(rig: &Rig, k: usize, fraction: f64) -> bool {
    let charge = rig
        .world
        .drones()
        .get(k)
        .and_then(|d| d.autopilot())
        .map_or(1.0, |a| a.battery);
    let spent = charge < fraction * rig.nodes.drone.mission.battery_reserve;
    spent && rig.mission(k).low_battery == Some(BatteryPlace::Deck)
}

/// Whether an operation continues that an abort must stop: a landing, or a take-off before the feet leave the
/// deck. A hold for the next order does not count.
pub(super) fn goes_on(flight: FlightKind, rig: &Rig, k: usize) -> bool {
    let state = rig.state(k);
    let waits = rig.mission(k).waiting.code;
    let on_deck = matches!(state, State::Preparing | State::Countdown | State::SpinUp);
    let waits = matches!(waits, ReasonCode::NotCommanded | ReasonCode::Operator);
    let rests = flight.takes_off() && state == State::Hold && waits;
    on_deck || state.is_landing() && !rests
}

/// Ending of a flight in which the first drone neither broke a rule nor rested on the deck for long enough.
pub fn end(rig: &Rig) -> StormEnding {
    let o = rig.world.observation();
    if !o.motors_on && !o.in_water && o.feet_height_m().abs() < FALSE_STOP_M {
        StormEnding::Landed
    } else if o.in_water || !o.motors_on {
        StormEnding::Crashed
    } else {
        StormEnding::Waits
    }
}
pub fn no_last_resort(rig: &Rig) -> Violation {
    let autopilot = rig.world.drones().first().and_then(|d| d.autopilot());
    Violation {
        rule: StormRule::NoLastResort,
        t_s: rig.t_s(),
        figure: autopilot.map_or(0.0, |a| a.battery),
        state: rig.state(0),
    }
}
/// Violation, long after the last fault, by a drone that neither landed nor stated a reason to wait, or that
/// is held by a failsafe of PX4.
pub fn is_stuck(rig: &Rig) -> Option<Violation> {
    let o = rig.world.observation();
    let mission = rig.mission(0);
    let states_reason = mission.waiting.code != ReasonCode::None;
    let autopilot = rig.world.drones().first().and_then(|d| d.autopilot());
    let failsafe = autopilot.is_some_and(SimulatedAutopilot::holds_by_itself);
    let rests =
        states_reason && !failsafe && matches!(mission.state, State::GaveUp | State::Hold | State::Idle);
    let lands = matches!(mission.state, State::Descent | State::Flare | State::Landed);
    let fine = !o.motors_on || rests || (states_reason && !lands);
    (!fine).then(|| Violation {
        rule: StormRule::Stuck,
        t_s: rig.t_s(),
        figure: o.feet_height_m(),
        state: mission.state,
    })
}

const fn names_battery(why: ReasonCode) -> bool {
    matches!(
        why,
        ReasonCode::BatteryLow
            | ReasonCode::BatteryWaits
            | ReasonCode::BatteryDeck
            | ReasonCode::BatteryHome
            | ReasonCode::BatteryHere
            | ReasonCode::BatteryStopped
            | ReasonCode::BatteryUnknown
            | ReasonCode::TakeOffBattery
            | ReasonCode::TurnsBack
    )
}

/// Maximum age of a reported condition, s; a permitted step reports none.
const REPORTS_S: f64 = 1.0;

/// Violation, long after the last fault, by an airborne drone that follows our set-points without reporting why it
/// waits; `reported_s` is the time of the last reported condition. A complete report has the condition for the next
/// step and at least one of these: the charge, which the status compares with the way to the deck and one attempt; on
/// a sortie, the time until the drone turns back; the landing place for a low battery; a reason that names the battery.
pub fn is_unreported(rig: &Rig, reported_s: f64) -> Option<Violation> {
    let o = rig.world.observation();
    let mission = rig.mission(0);
    let autopilot = rig.world.drones().first().and_then(|d| d.autopilot());
    let waits = o.motors_on && !o.in_water && autopilot.is_some_and(SimulatedAutopilot::in_offboard);
    let promised = mission.battery.is_some() || mission.turns_in_s.is_some_and(|left_s| left_s > 0.0);
    let reasons = [mission.waiting, mission.entered]
        .into_iter()
        .chain(mission.rejected);
    let alarms = mission.low_battery.is_some() || reasons.map(|why| why.code).any(names_battery);
    let reports = (promised || alarms) && rig.t_s() - reported_s < REPORTS_S;
    (waits && !reports).then(|| Violation {
        rule: StormRule::WaitsUnreported,
        t_s: rig.t_s(),
        figure: mission.battery.unwrap_or(0.0),
        state: mission.state,
    })
}

/// Time for which `is_so` has held, s; `since` stores its start.
fn lasts(since: &mut Option<f64>, is_so: bool, t_s: f64) -> f64 {
    *since = is_so.then(|| since.unwrap_or(t_s));
    since.map_or(0.0, |at| t_s - at)
}

fn is_finite(s: &SetPoint) -> bool {
    let vectors = [s.position, s.velocity, s.acceleration, s.rates];
    let scalars = [s.yaw, s.yaw_rate, s.thrust];
    let all = vectors.as_flattened().iter().chain(&scalars).chain(&s.attitude);
    all.copied().all(f64::is_finite)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rule broken by a descent that begins at 10 s, with an estimate wrong by `sds` deviations for `wrong_s` before.
    fn broken(sds: f64, wrong_s: f64, doubted: bool) -> Option<(StormRule, f64)> {
        let mut watch = StormWatch::default();
        let mut found = None;
        for tick in 0..=1000 {
            let t_s = f64::from(tick) * 0.01;
            let errors = [EstimateError {
                quantity: "roll",
                error: if t_s > 10.0 - wrong_s { sds } else { 0.0 },
                sd: 1.0,
            }];
            let state = if t_s < 10.0 {
                State::Tracking
            } else {
                State::Descent
            };
            found = watch
                .estimates((t_s, state), errors.into_iter(), || doubted)
                .or(found);
        }
        found
    }

    #[test]
    fn descent_on_a_wrong_estimate_breaks_a_rule() {
        assert_eq!(broken(3.5, 6.0, false), Some((StormRule::Undoubted, 3.5)));
        assert_eq!(broken(2.9, 6.0, false), None);
        assert_eq!(broken(3.5, 4.9, false), None);
        assert_eq!(broken(3.5, 6.0, true), None);
    }
}

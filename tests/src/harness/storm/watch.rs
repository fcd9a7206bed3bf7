//! The rules that hold in every tick of a storm; `deploy/docs/storm.md` has them as a table, with what each fault excuses.

use core::fmt;

use alight_shared::msg::{ReasonCode, SetPoint, State};
use serde::Serialize;

use crate::harness::outcome::{ContactEvent, FALSE_STOP_M, MAX_CONTACT_MPS};
use crate::harness::rig::Rig;

/// After a fault of the command the drone is commanded again within this time, s.
pub const RESUME_S: f64 = 1.5;
/// Hardest contact along the deck's normal with several faults, m/s.
const SEVERAL_MPS: f64 = 2.0;
/// A fault that began or ended within this time excuses a contact, s.
const GRACE_S: f64 = 0.5;
/// Rotors carry in `Landed` for at most so long, s.
const CARRY_S: f64 = 3.0;
/// An abort is taken within this time, s.
const ABORT_S: f64 = 1.0;

/// How a storm's flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// On the deck with motors off.
    Landed,
    /// Away from the deck, for a reason that it states.
    Waits,
    /// Off the deck with motors off, or in the water, after a fault that excuses it.
    Crashed,
    /// A rule was broken.
    Violated,
}

/// A rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// Motors stop in the air.
    StopInTheAir,
    /// A contact was too hard.
    HardContact,
    /// Something else than a foot met the deck.
    TippedOver,
    /// The drone is in the water.
    Water,
    /// Rotors carry in `Landed`.
    CarriesLanded,
    /// An abort was not taken.
    AbortIgnored,
    /// A descent began after an abort, with no new order.
    Unordered,
    /// A set-point is not finite.
    NotFinite,
    /// Long after the last fault it has neither landed nor states a reason to wait.
    Stuck,
}

/// A rule that was broken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Which.
    pub rule: Rule,
    /// When, s after the order.
    pub t_s: f64,
    /// The figure that broke it: m above the deck, m/s, or s.
    pub figure: f64,
    /// The mission's state then.
    pub state: State,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Violation { t_s, figure, .. } = self;
        let state = self.state.name();
        match self.rule {
            Rule::StopInTheAir => write!(f, "motors stopped {figure:.2} m above the deck"),
            Rule::HardContact => write!(f, "met the deck at {figure:.2} m/s"),
            Rule::TippedOver => write!(f, "met the deck with more than its feet, at {figure:.2} m/s"),
            Rule::Water => write!(f, "in the water"),
            Rule::CarriesLanded => write!(f, "rotors carried for {figure:.1} s on the deck"),
            Rule::AbortIgnored => write!(f, "an abort was not taken within {figure:.1} s"),
            Rule::Unordered => write!(f, "descends without an order, {figure:.1} s after an abort"),
            Rule::NotFinite => write!(f, "a set-point was not finite"),
            Rule::Stuck => write!(f, "neither landed nor states a reason to wait"),
        }?;
        write!(f, " ({t_s:.2} s, {state})")
    }
}

/// The faults as the rules see them.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Faults that have begun.
    pub faults: usize,
    /// When the newest of them began or ended, s.
    pub newest_s: f64,
    /// Nobody commands, or has not for long.
    pub uncommanded: bool,
    /// Thrust or battery was taken.
    pub without_power: bool,
    /// When an abort was given aboard, s.
    pub aborted_s: Option<f64>,
    /// The mission's process was there to receive it.
    pub received: bool,
    /// A landing was ordered after it.
    pub ordered_again: bool,
}

/// Watches a storm.
#[derive(Debug, Default)]
pub struct Watch {
    /// The motors turned in the last tick.
    turned: bool,
    /// It was struck, or fell into the water, under a fault that excuses it: no rule covers what follows.
    struck: bool,
    /// Since when rotors carry in `Landed`, s.
    carries_since_s: Option<f64>,
}

impl Watch {
    /// The first rule that this tick breaks.
    pub fn look(&mut self, rig: &Rig, scene: &Scene) -> Option<Violation> {
        let (t_s, state, o) = (rig.t_s(), rig.state(0), rig.world.observation());
        let broken = |rule, figure| {
            Some(Violation {
                rule,
                t_s,
                figure,
                state,
            })
        };
        let stopped = core::mem::replace(&mut self.turned, o.motors_on) && !o.motors_on;
        if stopped && o.feet_height_m() > FALSE_STOP_M {
            return broken(Rule::StopInTheAir, o.feet_height_m());
        }
        let too_recent = t_s < scene.newest_s + GRACE_S;
        let excused = scene.uncommanded || scene.without_power || too_recent;
        let strikes = |c: &ContactEvent| !c.foot || c.normal_mps > MAX_CONTACT_MPS;
        self.struck |= excused && o.contacts.iter().any(strikes);
        if !(excused || self.struck) {
            let limit_mps = if scene.faults > 1 {
                SEVERAL_MPS
            } else {
                MAX_CONTACT_MPS
            };
            let hard = o.contacts.iter().find(|c| c.normal_mps > limit_mps);
            if let Some(contact) = hard {
                return broken(Rule::HardContact, contact.normal_mps);
            }
            if let Some(contact) = o.contacts.iter().find(|c| !c.foot) {
                return broken(Rule::TippedOver, contact.normal_mps);
            }
        }
        self.struck |= scene.without_power && o.in_water;
        if o.in_water && !self.struck {
            return broken(Rule::Water, o.feet_height_m());
        }
        let carries = state == State::Landed && o.motors_on && rig.thrust(0) > 0.5 * rig.hover_thrust(0);
        self.carries_since_s = carries.then(|| self.carries_since_s.unwrap_or(t_s));
        if let Some(since_s) = self.carries_since_s
            && t_s - since_s > CARRY_S
            && !scene.uncommanded
        {
            return broken(Rule::CarriesLanded, t_s - since_s);
        }
        if let Some(at) = scene.aborted_s.filter(|_| scene.received && o.motors_on) {
            let taken = rig.mission(0).abort.is_some() || state == State::Landed;
            if !taken && t_s > at + ABORT_S {
                return broken(Rule::AbortIgnored, t_s - at);
            }
            let descends = state == State::Descent && rig.entered_s(0) > at + ABORT_S;
            if descends && !scene.ordered_again {
                return broken(Rule::Unordered, t_s - at);
            }
        }
        let set_point = rig.world.drones().first().and_then(|d| d.last_set_point);
        if !set_point.as_ref().is_none_or(is_finite) {
            return broken(Rule::NotFinite, f64::NAN);
        }
        None
    }

    /// How it ended that has neither landed nor broken a rule.
    pub fn end(&self, rig: &Rig) -> Ending {
        let o = rig.world.observation();
        if o.in_water || !o.motors_on {
            Ending::Crashed
        } else {
            Ending::Waits
        }
    }
    /// Long after the last fault: broken where it has neither landed nor states a reason to wait.
    pub fn is_stuck(&self, rig: &Rig) -> Option<Violation> {
        let (o, mission) = (rig.world.observation(), rig.mission(0));
        let states_reason = mission.waiting.code != ReasonCode::None;
        let rests = matches!(mission.state, State::GaveUp | State::Hold | State::Idle);
        let lands = matches!(mission.state, State::Descent | State::Flare | State::Landed);
        let fine = !o.motors_on || rests || (states_reason && !lands);
        (!fine).then(|| Violation {
            rule: Rule::Stuck,
            t_s: rig.t_s(),
            figure: o.feet_height_m(),
            state: mission.state,
        })
    }
}

fn is_finite(s: &SetPoint) -> bool {
    let vectors = [s.position, s.velocity, s.acceleration, s.rates];
    let scalars = [s.yaw, s.yaw_rate, s.thrust];
    let all = vectors.as_flattened().iter().chain(&scalars).chain(&s.attitude);
    all.copied().all(f64::is_finite)
}

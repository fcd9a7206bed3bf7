//! Touchdown detector, with evidence from thrust, accelerometers, rangefinder and relative motion.
//!
//! In the air the specific force equals the rotors' thrust. On the deck the feet add to it, and this *excess* increases
//! as the thrust is reduced. A contact is first suspected (after an impact, an excess, or resting at the feet's range);
//! then the thrust is cut to a fraction of hover, and the touchdown is confirmed only if the drone is still supported.
//! A drone in the air begins to fall instead, and the suspicion is dropped.
//!
//! Aerodynamic forces add lift as well: the air cushion above the deck, drag on the way down, and in wind the drag
//! along the rotors' axis, which changes as a tilted drone aligns with the deck. These change slowly, so the excess is
//! measured relative to its mean over the last [`AIR_TIME_S`] in the air.
//!
//! No single sensor can cut the thrust. An impact or an excess counts only if rangefinder and forecast show that the
//! deck is near. Resting at the feet's range counts only while odometry and forecast confirm that the drone stays on
//! the deck. A rangefinder that has not followed the descent ([`RangeWitness`]) is ignored. If the autopilot does not
//! report its thrust, the command is used instead, and the drone must stay on the deck for longer.

use alight_shared::{
    estimation::{low_pass, median},
    msg::Header,
    time::{DroneClock, DroneTime, Time},
    topics,
};

use serde::{Deserialize, Serialize};

use crate::{
    contingency::HARD_MPS,
    range_witness::{BELOW_FEET_M, RangeWitness, disagree},
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Touchdown {
    /// `at` is the time of confirmation.
    pub header: Header<DroneClock>,
    pub suspected_at: DroneTime,
    /// Rangefinder reading, m; None without one.
    pub range_m: Option<f64>,
    /// Height of the foot plane above the forecast deck, m.
    pub clearance_m: Option<f64>,
    /// Speed away from the deck along its normal, m/s.
    pub normal_speed_mps: Option<f64>,
    /// Specific force in excess of the applied thrust, m/s².
    pub excess_mps2: f64,
    /// Applied thrust as a fraction of hover.
    pub thrust_of_hover: f64,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TouchdownEvidence {
    pub(crate) permitted: bool,
    pub(crate) descending: bool,
    /// Specific force along the body's up axis, m/s²; None without a new measurement.
    pub(crate) force: Option<f64>,
    /// Maximum specific thrust of the rotors, m/s², until a command is in effect; None once the thrust is known.
    pub(crate) begins_within: Option<f64>,
    /// Specific thrust commanded by the pilot node, m/s²; None while the autopilot closes the loop.
    pub(crate) own_thrust: Option<f64>,
    /// Specific thrust that the autopilot reports, m/s²; None without a recent report.
    pub(crate) reported_thrust: Option<f64>,
    /// Specific thrust in hover, m/s² (gravity).
    pub(crate) hover_thrust: f64,
    /// Height of the foot plane above the forecast deck, m.
    pub(crate) clearance: Option<f64>,
    /// Speed away from the deck along its normal, m/s.
    pub(crate) normal_speed: Option<f64>,
}

impl TouchdownEvidence {
    /// Larger of own command and report, because a thrust that was not cut also explains the force.
    fn applied_thrust(&self) -> Option<f64> {
        match (self.own_thrust, self.reported_thrust) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum TouchdownContact {
    #[default]
    Clear,
    /// Contact is suspected, so the drone presses down with little thrust.
    Suspected {
        since: DroneTime,
        /// Time since which the excess has been large.
        carried: Option<DroneTime>,
    },
    Confirmed,
}

// "Excess" is specific force in excess of the applied thrust: support by something other than the rotors. The
// thresholds suit a rangefinder with 3 cm of noise at 50 Hz (median of five: 1.7 cm).

/// Maximum rangefinder reading of feet near the deck, relative to the reading on the deck, m.
const RANGE_MARGIN_M: f64 = 0.10;
/// Rangefinder reading above which the drone has left the deck, relative to the reading on the deck, m.
const RANGE_RELEASE_M: f64 = 0.25;
/// Maximum forecast clearance for a contact without the rangefinder, m.
const BLIND_CLEARANCE_M: f64 = 0.20;
/// Forecast clearance above which no contact is accepted, m.
const CLEARANCE_VETO_M: f64 = 0.5;
/// Speed along the deck's normal above which no touchdown is confirmed, m/s.
const SPEED_VETO_MPS: f64 = 0.8;
/// Maximum speed along the deck's normal of a drone that stays on the deck, m/s: the estimate's error.
const STAYS_MPS: f64 = 0.25;
const STAYS_TIME_S: f64 = 0.15;
/// Minimum sustained excess for a suspected contact, m/s².
const SUSPECT_EXCESS_MPS2: f64 = 1.5;
/// Factor on [`SUSPECT_EXCESS_MPS2`] if rangefinder and forecast disagree; exceeds any gust or air cushion.
const DOUBTED: f64 = 2.0;
/// Duration of that excess after which contact is suspected, s.
const SUSPECT_S: f64 = 0.03;
/// Minimum excess in a single sample (an impact) for a suspected contact, m/s².
const IMPACT_MPS2: f64 = 6.0;
/// Time at the feet's range in a commanded descent after which contact is suspected, s.
const RESTING_S: f64 = 0.3;
/// Thrust on suspicion, as a fraction of hover. A larger thrust resists wind better but makes a bounce harder.
const PRESS_OF_HOVER: f64 = 0.4;
/// Thrust at the end of the ramp, as a fraction of hover, for a deck that falls at 3.8 m/s².
const PRESS_END_OF_HOVER: f64 = 0.3;
const PRESS_RAMP_S: f64 = 0.2;
/// Minimum sustained excess that confirms a touchdown, m/s².
const CONFIRM_EXCESS_MPS2: f64 = 2.0;
/// Duration of that excess for a confirmation, s.
const CONFIRM_S: f64 = 0.08;
/// Duration for a confirmation without the rangefinder, s.
const BLIND_CONFIRM_S: f64 = 0.2;
/// Time after which an unconfirmed suspicion is dropped, s.
const GIVE_UP_S: f64 = 0.6;
/// Excess below which the drone counts as unsupported while the thrust is cut, m/s².
const FALLS_EXCESS_MPS2: f64 = 1.0;
/// Time without support after which the drone counts as in the air, s: longer than between the contacts of a soft
/// bounce. In this time the drone gains 0.9 m/s, which it can brake from [`CLEARANCE_VETO_M`].
const FALLS_S: f64 = 0.15;
/// Duration on the deck for a confirmation without the autopilot's thrust report, s: five times the delay from its
/// command to the rotors.
const SILENT_CONFIRM_S: f64 = 0.4;
/// Time before a contact over which the maximum closing speed is taken, s.
const BEFORE_CONTACT_S: f64 = 0.1;
/// Pause after a dropped suspicion, s.
const PAUSE_S: f64 = 0.2;
/// Maximum age of a thrust report that is used for a confirmation, s.
pub(super) const AUTOPILOT_AGE_S: f64 = 0.5;
const READINGS: usize = 32;
/// Number of readings over which the median is taken.
const MEDIAN: usize = 5;
/// Time constant of the sustained excess, s: three samples of odometry.
const EXCESS_TIME_S: f64 = 0.03;
/// Averaging time of the aerodynamic lift, s: less than the 0.4 s in which a tilt of 20 deg is levelled.
const AIR_TIME_S: f64 = 0.3;
/// Limit of the aerodynamic lift, m/s²: drag of 4 m/s² along rotors that have rotated by 30 deg.
const MAX_AIR_MPS2: f64 = 2.0;

#[derive(Clone, Debug)]
pub(crate) struct TouchdownDetector {
    /// Reading with the feet on the deck, m.
    feet_range: f64,
    contact: TouchdownContact,
    readings: [(DroneTime, f64); READINGS],
    next: usize,
    excess: f64,
    sure_excess: f64,
    air: f64,
    loaded: Option<DroneTime>,
    pause_until: DroneTime,
    witness: RangeWitness,
    /// Speed away from the deck along its normal, low-pass filtered, m/s; None if unknown.
    along: Option<f64>,
    /// Start of a period without support while the thrust is cut.
    falls: Option<DroneTime>,
    /// Maximum speed towards the deck within [`BEFORE_CONTACT_S`], and its time.
    closing: (DroneTime, f64),
    /// Speed of the hardest contact above the limit of hard contacts, m/s.
    hard_mps: Option<f64>,
}

impl TouchdownDetector {
    /// `feet_range`: reading with the feet on the deck, m.
    pub(crate) fn new(feet_range: f64) -> Self {
        TouchdownDetector {
            feet_range,
            contact: TouchdownContact::Clear,
            readings: [(Time::from_nanos(i64::MIN), f64::INFINITY); READINGS],
            next: 0,
            excess: 0.0,
            sure_excess: 0.0,
            air: 0.0,
            loaded: None,
            pause_until: Time::from_nanos(i64::MIN),
            witness: RangeWitness::default(),
            along: None,
            falls: None,
            closing: (Time::from_nanos(i64::MIN), 0.0),
            hard_mps: None,
        }
    }
    /// Speed of the hardest hard contact since [`Self::forget_contacts`], m/s.
    pub(crate) fn hard_mps(&self) -> Option<f64> {
        self.hard_mps
    }
    pub(crate) fn forget_contacts(&mut self) {
        self.hard_mps = None;
    }
    pub(crate) fn contact(&self) -> TouchdownContact {
        self.contact
    }
    pub(crate) fn clear(&mut self) {
        self.contact = TouchdownContact::Clear;
        self.loaded = None;
        self.falls = None;
    }
    pub(crate) fn range(&mut self, at: DroneTime, range_m: f64) {
        if range_m < self.feet_range - BELOW_FEET_M {
            return;
        }
        self.witness.reads(at, range_m);
        if let Some(r) = self.readings.get_mut(self.next) {
            *r = (at, range_m);
        }
        self.next = (self.next + 1) % READINGS;
    }
    /// Median of the newest readings, m; None if they are too old or have not followed the drone's motion.
    pub(crate) fn median(&self, now: DroneTime) -> Option<f64> {
        if self.witness.contradicts() {
            return None;
        }
        let newest = (1..=MEDIAN).map(|k| self.readings[(self.next + READINGS - k) % READINGS]);
        let fresh = newest.filter(|(at, _)| now - *at <= topics::RANGE.stale_after);
        median(fresh.map(|(_, r)| r))
    }
    /// Whether the mean of the readings over the last [`RESTING_S`] is the feet's range without outliers, and odometry
    /// and forecast also show that the drone stays on the deck.
    fn resting(&self, now: DroneTime) -> bool {
        if self.witness.contradicts() || !self.stays() {
            return false;
        }
        let mut n = 0_u32;
        let mut sum = 0.0;
        let mut oldest = 0.0_f64;
        for (at, r) in &self.readings {
            let age = (now - *at).secs();
            if age > RESTING_S {
                continue;
            }
            if (r - self.feet_range).abs() > RANGE_MARGIN_M {
                return false;
            }
            n += 1;
            sum += r - self.feet_range;
            oldest = oldest.max(age);
        }
        n >= 8 && oldest > 0.8 * RESTING_S && (sum / f64::from(n)).abs() < 0.4 * RANGE_MARGIN_M
    }

    fn stays(&self) -> bool {
        self.along.is_some_and(|v| v.abs() <= STAYS_MPS)
    }
    fn watch(&mut self, now: DroneTime, dt: f64, e: &TouchdownEvidence) {
        self.witness.moves(dt, e.normal_speed);
        self.along = e.normal_speed.map(|v| low_pass(self.along, v, dt, STAYS_TIME_S));
        let closing = e.normal_speed.map_or(0.0, |v| -v);
        let (at, fastest) = self.closing;
        if closing >= fastest || (now - at).secs() > BEFORE_CONTACT_S {
            self.closing = (now, closing);
        }
    }
    /// Records the speed of a hard contact, detected by an impact near the deck.
    fn notice(&mut self, impact: f64, e: &TouchdownEvidence) {
        let near = e.clearance.is_some_and(|v| v.abs() <= CLEARANCE_VETO_M);
        let (_, closing) = self.closing;
        if near && impact > IMPACT_MPS2 && closing > HARD_MPS {
            self.hard_mps = Some(self.hard_mps.map_or(closing, |v| v.max(closing)));
        }
    }

    /// Updates the excess and the aerodynamic lift; returns this step's excess.
    fn weigh(&mut self, dt: f64, e: &TouchdownEvidence) -> f64 {
        if let Some(max_thrust) = e.begins_within {
            // Only a force above the maximum thrust indicates a contact.
            self.excess = 0.0;
            self.sure_excess = 0.0;
            self.air = 0.0;
            return e.force.map_or(0.0, |force| force - max_thrust);
        }
        let (Some(force), Some(thrust), Some(sure)) =
            (e.force, e.own_thrust.or(e.reported_thrust), e.applied_thrust())
        else {
            return 0.0;
        };
        let impact = force - thrust;
        // A single impact must not saturate the sustained excess.
        let bound = |v: f64| (v - self.air).clamp(-10.0, 10.0);
        self.excess = low_pass(self.excess, bound(impact), dt, EXCESS_TIME_S);
        self.sure_excess = low_pass(self.sure_excess, bound(force - sure), dt, EXCESS_TIME_S);
        if self.contact == TouchdownContact::Clear && impact.is_finite() {
            let carries = impact.clamp(0.0, MAX_AIR_MPS2);
            self.air = low_pass(self.air, carries, dt, AIR_TIME_S);
        }
        impact
    }

    /// Returns the touchdown in the step that confirms it.
    pub(crate) fn step(&mut self, now: DroneTime, dt: f64, e: &TouchdownEvidence) -> Option<Touchdown> {
        if self.contact == TouchdownContact::Confirmed {
            return None;
        }
        let impact = self.weigh(dt, e);
        self.watch(now, dt, e);
        self.notice(impact, e);
        if !e.permitted {
            self.clear();
            return None;
        }
        // If the rangefinder contradicts the forecast height, the excess decides, but must be larger.
        let apart = |r: &f64| disagree(r - self.feet_range, e.clearance);
        let read = self.median(now);
        let range = read.filter(|r| !apart(r));
        match self.contact {
            TouchdownContact::Clear => {
                let contradicted = read.is_some() && range.is_none();
                let min_excess = SUSPECT_EXCESS_MPS2 * if contradicted { DOUBTED } else { 1.0 };
                self.suspect(now, impact, min_excess, range, e);
                None
            }
            TouchdownContact::Suspected { since, carried } => self.confirm(now, (since, carried), range, e),
            TouchdownContact::Confirmed => None,
        }
    }

    /// Suspects contact after an impact, an excess above `min_excess`, or resting at the feet's range.
    fn suspect(
        &mut self,
        now: DroneTime,
        impact: f64,
        min_excess: f64,
        range: Option<f64>,
        e: &TouchdownEvidence,
    ) {
        if now < self.pause_until || !self.near(range, e, RANGE_MARGIN_M) {
            self.loaded = None;
            return;
        }
        self.loaded = (self.excess > min_excess).then(|| self.loaded.unwrap_or(now));
        let carried = self.loaded.is_some_and(|t| (now - t).secs() >= SUSPECT_S);
        let rests = e.descending && self.resting(now);
        if carried || impact > IMPACT_MPS2 || rests {
            self.contact = TouchdownContact::Suspected {
                since: now,
                carried: None,
            };
        }
    }

    /// Confirms the touchdown of a supported drone with its thrust cut; gives up after [`GIVE_UP_S`].
    fn confirm(
        &mut self,
        now: DroneTime,
        (since, carried): (DroneTime, Option<DroneTime>),
        range: Option<f64>,
        e: &TouchdownEvidence,
    ) -> Option<Touchdown> {
        let applied = e.applied_thrust();
        let cut = applied.is_some_and(|t| t <= 0.8 * e.hover_thrust);
        let unsupported = cut && self.sure_excess < FALLS_EXCESS_MPS2;
        self.falls = unsupported.then(|| self.falls.unwrap_or(now));
        let falls = self.falls.is_some_and(|t| (now - t).secs() >= FALLS_S);
        let left = !self.near(range, e, RANGE_RELEASE_M);
        if left || falls || (now - since).secs() > GIVE_UP_S {
            self.clear();
            self.pause_until = now + alight_shared::time::Span::from_secs(PAUSE_S);
            return None;
        }
        let (slow, needed) = match (e.reported_thrust, range) {
            (None, _) => (self.stays(), SILENT_CONFIRM_S),
            (Some(_), Some(_)) => (Self::is_slow(e), CONFIRM_S),
            (Some(_), None) => (Self::is_slow(e), BLIND_CONFIRM_S),
        };
        let holds =
            self.near(range, e, RANGE_MARGIN_M) && slow && cut && self.sure_excess > CONFIRM_EXCESS_MPS2;
        let carried = holds.then(|| carried.unwrap_or(now));
        self.contact = TouchdownContact::Suspected { since, carried };
        if !carried.is_some_and(|t| (now - t).secs() >= needed) {
            return None;
        }
        self.contact = TouchdownContact::Confirmed;
        Some(Touchdown {
            header: Header::new(0, 0, 0, 0, now),
            suspected_at: since,
            range_m: range,
            clearance_m: e.clearance,
            normal_speed_mps: e.normal_speed,
            excess_mps2: self.sure_excess,
            thrust_of_hover: applied.map_or(0.0, |t| t / e.hover_thrust),
        })
    }

    fn is_slow(e: &TouchdownEvidence) -> bool {
        e.normal_speed.is_none_or(|v| v.abs() <= SPEED_VETO_MPS)
    }

    /// Whether the feet are near the deck: by the rangefinder unless the forecast vetoes it, otherwise by the forecast.
    fn near(&self, range: Option<f64>, e: &TouchdownEvidence, margin: f64) -> bool {
        let veto = e.clearance.is_some_and(|v| v > CLEARANCE_VETO_M || v.is_nan());
        let close = match range {
            Some(r) => r <= self.feet_range + margin,
            None => e.clearance.is_some_and(|v| v <= BLIND_CLEARANCE_M),
        };
        close && !veto
    }
}

/// Thrust while contact is suspected, as a fraction of hover: cut at once, then ramped down.
pub(crate) fn press_fraction(since: DroneTime, now: DroneTime) -> f64 {
    let s = ((now - since).secs() / PRESS_RAMP_S).clamp(0.0, 1.0);
    PRESS_OF_HOVER + s * (PRESS_END_OF_HOVER - PRESS_OF_HOVER)
}

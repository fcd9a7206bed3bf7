//! The touchdown detector: evidence from thrust, accelerometers, rangefinder and relative motion.
//!
//! What distinguishes the deck from the air is what carries the drone. In the air the specific force is what
//! the rotors give, whatever the thrust; on the deck the feet carry the rest, and the less the
//! rotors give the larger that *excess* becomes. So a contact is first suspected (an impact, an
//! excess, or resting at the feet's range), the thrust is then cut to a part of hover, and the
//! touchdown is confirmed only when the drone is still carried although its rotors do not carry it.
//! A drone in the air begins to fall instead, shows no excess, and the suspicion is dropped.
//!
//! Air carries, too: its cushion over the deck, drag on the way down, and in wind the drag along the rotors' axis, which changes as
//! a tilted drone aligns with the deck. That comes more slowly than a deck does, so the excess is what exceeds the mean of the
//! last [`AIR_TIME_S`] in the air.
//!
//! No thrust is cut on one witness alone. An impact or an excess counts near the deck by rangefinder and forecast; resting at
//! the feet's range counts while odometry and forecast, too, see the drone stay on the deck; and a rangefinder that has not
//! followed the way down ([`RangeWitness`]) is none. Where the autopilot's report of its thrust has stopped, the command
//! that it follows stands in for it, on a drone that stays on the deck for longer.

use alight_shared::estimation::{low_pass, median};
use alight_shared::msg::Header;
use alight_shared::time::{DroneClock, Time};
use alight_shared::topics;

use serde::{Deserialize, Serialize};

use crate::contingency::HARD_MPS;
use crate::range_witness::{BELOW_FEET_M, RangeWitness, disagree};

type DroneTime = Time<DroneClock>;

/// The measurements on which a touchdown was confirmed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Touchdown {
    /// Identity; `at` is the time of confirmation.
    pub header: Header<DroneClock>,
    /// When contact was first suspected.
    pub suspected_at: Time<DroneClock>,
    /// Rangefinder, m; None when it was silent.
    pub range_m: Option<f64>,
    /// Foot plane above the deck as forecast, m.
    pub clearance_m: Option<f64>,
    /// Speed away from the deck along its normal, m/s.
    pub normal_speed_mps: Option<f64>,
    /// Specific force that the applied thrust does not explain, m/s².
    pub excess_mps2: f64,
    /// Applied thrust as a fraction of hover.
    pub thrust_of_hover: f64,
}

/// What the detector sees in one step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TouchdownEvidence {
    /// The mission permits touching the deck.
    pub(crate) permitted: bool,
    /// A descent is commanded.
    pub(crate) descending: bool,
    /// Specific force along the body's up axis, m/s²; None without a new measurement.
    pub(crate) force: Option<f64>,
    /// Greatest specific thrust of the rotors, m/s², while what the pilot commands is not in force yet: what they give is not
    /// known. None: known by command or report.
    pub(crate) begins_within: Option<f64>,
    /// Specific thrust that the pilot's own command applies, m/s²; None while the autopilot closes
    /// the loop.
    pub(crate) own_thrust: Option<f64>,
    /// Specific thrust that the autopilot reports, m/s²; None when there was no report lately.
    pub(crate) reported_thrust: Option<f64>,
    /// Specific thrust that hovers, m/s² (gravity).
    pub(crate) hover_thrust: f64,
    /// Foot plane above the deck as forecast, m.
    pub(crate) clearance: Option<f64>,
    /// Speed away from the deck along its normal, m/s.
    pub(crate) normal_speed: Option<f64>,
}

impl TouchdownEvidence {
    /// Own command or report, whichever is larger: a thrust that was not cut explains the force.
    fn applied_thrust(&self) -> Option<f64> {
        match (self.own_thrust, self.reported_thrust) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        }
    }
}

/// How far the detector has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum TouchdownContact {
    /// In the air.
    #[default]
    Clear,
    /// Contact suspected: pressing down with little thrust.
    Suspected {
        since: DroneTime,
        /// The excess has been large since.
        carried: Option<DroneTime>,
    },
    /// On the deck.
    Confirmed,
}

// "Excess" is the specific force that the applied thrust does not explain: what carries the drone instead of its rotors.
// Chosen for a rangefinder of 3 cm noise at 50 Hz (median of five: 1.7 cm).

/// The rangefinder reads at most this much more than it does on the deck, m.
const RANGE_MARGIN_M: f64 = 0.10;
/// The rangefinder has left the deck beyond this much more, m.
const RANGE_RELEASE_M: f64 = 0.25;
/// Without the rangefinder: the forecast's clearance is at most this, m.
const BLIND_CLEARANCE_M: f64 = 0.20;
/// Beyond this forecast clearance no contact is accepted, m.
const CLEARANCE_VETO_M: f64 = 0.5;
/// Beyond this speed along the deck's normal no touchdown is confirmed, m/s.
const SPEED_VETO_MPS: f64 = 0.8;
/// A drone that goes along the deck's normal no faster than this stays on it, m/s: the error of odometry and forecast.
const STAYS_MPS: f64 = 0.25;
/// Time constant of that speed, s: half of [`RESTING_S`].
const STAYS_TIME_S: f64 = 0.15;
/// Smallest sustained excess that makes contact suspected, m/s².
const SUSPECT_EXCESS_MPS2: f64 = 1.5;
/// So many times that where rangefinder and forecast contradict each other: no gust and no cushion of air.
const DOUBTED: f64 = 2.0;
/// It must last this long, s.
const SUSPECT_S: f64 = 0.03;
/// Smallest single excess that makes contact suspected, m/s².
const IMPACT_MPS2: f64 = 6.0;
/// So long at the feet's range while a descent is commanded makes contact suspected, s.
const RESTING_S: f64 = 0.3;
/// Thrust on suspicion, as a fraction of hover: the more the feet carry the less a wind moves them, and the harder is a second
/// contact when it bounces.
const PRESS_OF_HOVER: f64 = 0.4;
/// Thrust at the end of the ramp, as a fraction of hover.
/// Source: Low enough to unload on a deck that falls at 3.8 m/s².
const PRESS_END_OF_HOVER: f64 = 0.3;
/// Length of the ramp, s.
const PRESS_RAMP_S: f64 = 0.2;
/// Smallest sustained excess that confirms touchdown, m/s².
const CONFIRM_EXCESS_MPS2: f64 = 2.0;
/// It must last this long, s.
const CONFIRM_S: f64 = 0.08;
/// The same without the rangefinder, s.
const BLIND_CONFIRM_S: f64 = 0.2;
/// Not confirmed after this long, the suspicion is dropped, s.
const GIVE_UP_S: f64 = 0.6;
/// With the thrust cut and an excess below this, m/s², nothing carries the drone ...
const FALLS_EXCESS_MPS2: f64 = 1.0;
/// ... and after this long it is in the air, s: longer than between two touches of a soft bounce. It has become faster by
/// 0.9 m/s, which from [`CLEARANCE_VETO_M`] it brakes again.
const FALLS_S: f64 = 0.15;
/// The excess has to last this long without the autopilot's report of its thrust, on a drone that stays on the deck, s: its
/// command reaches the rotors within a fifth of that.
const SILENT_CONFIRM_S: f64 = 0.4;
/// The speed of a contact is the greatest within this time before it, s.
const BEFORE_CONTACT_S: f64 = 0.1;
/// No new suspicion for this long after that, s.
const PAUSE_S: f64 = 0.2;
/// The autopilot's report of its thrust must be no older than this to confirm, s.
pub(super) const AUTOPILOT_AGE_S: f64 = 0.5;
/// Readings kept for the median and for resting.
const READINGS: usize = 32;
/// Readings whose median counts as the range.
const MEDIAN: usize = 5;
/// Time constant of the sustained excess, s: three samples of odometry.
const EXCESS_TIME_S: f64 = 0.03;
/// What the air carries is the mean over this time, s: a tilt of 20 deg is levelled in 0.4 s.
const AIR_TIME_S: f64 = 0.3;
/// Air carries no more, m/s²: drag of 4 m/s² along rotors that turned by 30 deg.
const MAX_AIR_MPS2: f64 = 2.0;

#[derive(Clone, Debug)]
pub(crate) struct TouchdownDetector {
    /// The rangefinder's reading with the feet on the deck, m.
    feet_range: f64,
    contact: TouchdownContact,
    readings: [(DroneTime, f64); READINGS],
    /// Where the next reading goes.
    next: usize,
    excess: f64,
    sure_excess: f64,
    /// What the air carries, m/s².
    air: f64,
    loaded: Option<DroneTime>,
    pause_until: DroneTime,
    witness: RangeWitness,
    /// Speed away from the deck along its normal, smoothed, m/s; None: not known.
    along: Option<f64>,
    /// Nothing has carried the drone since, with the thrust cut.
    falls: Option<DroneTime>,
    /// Greatest speed towards the deck lately, and when that was.
    closing: (DroneTime, f64),
    /// The hardest of the hard contacts, m/s.
    hard_mps: Option<f64>,
}

impl TouchdownDetector {
    /// For feet that the rangefinder sees at `feet_range` (m).
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
    /// The hardest contact since [`Self::forget_contacts`], when it was hard, m/s.
    pub(crate) fn hard_mps(&self) -> Option<f64> {
        self.hard_mps
    }
    /// Another flight begins.
    pub(crate) fn forget_contacts(&mut self) {
        self.hard_mps = None;
    }
    /// How far it has come.
    pub(crate) fn contact(&self) -> TouchdownContact {
        self.contact
    }
    /// In the air again, e.g. after a new take-off.
    pub(crate) fn clear(&mut self) {
        self.contact = TouchdownContact::Clear;
        (self.loaded, self.falls) = (None, None);
    }
    /// Takes a reading of the rangefinder.
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
    /// Median of the newest readings, m; None when they are too old, or have not followed the drone.
    pub(crate) fn median(&self, now: DroneTime) -> Option<f64> {
        if self.witness.contradicts() {
            return None;
        }
        let newest = (1..=MEDIAN).map(|k| self.readings[(self.next + READINGS - k) % READINGS]);
        let fresh = newest.filter(|(at, _)| now - *at <= topics::RANGE.stale_after);
        median(fresh.map(|(_, r)| r))
    }
    /// All readings of the last `resting_s` average to the feet's range, none is far from it, and the drone stays there by
    /// odometry and forecast, too.
    fn resting(&self, now: DroneTime) -> bool {
        if self.witness.contradicts() || !self.stays() {
            return false;
        }
        let (mut n, mut sum, mut oldest) = (0_u32, 0.0, 0.0_f64);
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

    /// The drone stays on the deck by odometry and forecast.
    fn stays(&self) -> bool {
        self.along.is_some_and(|v| v.abs() <= STAYS_MPS)
    }
    /// Takes the speed along the deck's normal.
    fn watch(&mut self, now: DroneTime, dt: f64, e: &TouchdownEvidence) {
        self.witness.moves(dt, e.normal_speed);
        self.along = e.normal_speed.map(|v| low_pass(self.along, v, dt, STAYS_TIME_S));
        let closing = e.normal_speed.map_or(0.0, |v| -v);
        let (at, greatest) = self.closing;
        if closing >= greatest || (now - at).secs() > BEFORE_CONTACT_S {
            self.closing = (now, closing);
        }
    }
    /// A contact that is noticed by its impact near the deck, when it is hard.
    fn notice(&mut self, impact: f64, e: &TouchdownEvidence) {
        let near = e.clearance.is_some_and(|v| v.abs() <= CLEARANCE_VETO_M);
        let (_, closing) = self.closing;
        if near && impact > IMPACT_MPS2 && closing > HARD_MPS {
            self.hard_mps = Some(self.hard_mps.map_or(closing, |v| v.max(closing)));
        }
    }

    /// Takes what carries the drone; gives this step's excess.
    fn weigh(&mut self, dt: f64, e: &TouchdownEvidence) -> f64 {
        if let Some(greatest) = e.begins_within {
            // Only what no thrust explains is a contact.
            (self.excess, self.sure_excess, self.air) = (0.0, 0.0, 0.0);
            return e.force.map_or(0.0, |force| force - greatest);
        }
        let (Some(force), Some(thrust), Some(sure)) =
            (e.force, e.own_thrust.or(e.reported_thrust), e.applied_thrust())
        else {
            return 0.0;
        };
        let impact = force - thrust;
        // A single impact must not fill the memory of the sustained excess.
        let bound = |v: f64| (v - self.air).clamp(-10.0, 10.0);
        self.excess = low_pass(self.excess, bound(impact), dt, EXCESS_TIME_S);
        self.sure_excess = low_pass(self.sure_excess, bound(force - sure), dt, EXCESS_TIME_S);
        if self.contact == TouchdownContact::Clear && impact.is_finite() {
            let carries = impact.clamp(0.0, MAX_AIR_MPS2);
            self.air = low_pass(self.air, carries, dt, AIR_TIME_S);
        }
        impact
    }

    /// One step; gives the evidence at the moment of confirmation.
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
        // One that contradicts the forecast's height is out-voted by what carries the drone, which then has to be plain.
        let apart = |r: &f64| disagree(r - self.feet_range, e.clearance);
        let read = self.median(now);
        let range = read.filter(|r| !apart(r));
        match self.contact {
            TouchdownContact::Clear => {
                let contradicted = read.is_some() && range.is_none();
                let least = SUSPECT_EXCESS_MPS2 * if contradicted { DOUBTED } else { 1.0 };
                self.suspect(now, impact, least, range, e);
                None
            }
            TouchdownContact::Suspected { since, carried } => self.confirm(now, (since, carried), range, e),
            TouchdownContact::Confirmed => None,
        }
    }

    /// An impact, an excess of `least`, or resting at the feet's range makes contact suspected.
    fn suspect(
        &mut self,
        now: DroneTime,
        impact: f64,
        least: f64,
        range: Option<f64>,
        e: &TouchdownEvidence,
    ) {
        if now < self.pause_until || !self.near(range, e, RANGE_MARGIN_M) {
            self.loaded = None;
            return;
        }
        self.loaded = (self.excess > least).then(|| self.loaded.unwrap_or(now));
        let carried = self.loaded.is_some_and(|t| (now - t).secs() >= SUSPECT_S);
        let rests = e.descending && self.resting(now);
        if carried || impact > IMPACT_MPS2 || rests {
            self.contact = TouchdownContact::Suspected {
                since: now,
                carried: None,
            };
        }
    }

    /// Touchdown, when the drone is carried for long enough although its thrust is cut; else the suspicion is dropped after a
    /// while.
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

    /// No faster along the deck's normal than a drone on it.
    fn is_slow(e: &TouchdownEvidence) -> bool {
        e.normal_speed.is_none_or(|v| v.abs() <= SPEED_VETO_MPS)
    }

    /// The feet are about on the deck: by the rangefinder, or by the forecast when it is silent;
    /// the forecast can veto.
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

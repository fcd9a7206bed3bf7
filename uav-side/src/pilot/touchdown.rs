//! The touchdown detector: evidence from thrust, accelerometers, rangefinder and relative motion.
//!
//! What distinguishes the deck from the air is what carries the drone. In the air the specific force is what
//! the rotors give, whatever the thrust; on the deck the feet carry the rest, and the less the
//! rotors give the larger that *excess* becomes. So a contact is first suspected (an impact, an
//! excess, or resting at the feet's range), the thrust is then cut to a part of hover, and the
//! touchdown is confirmed only when the drone is still carried although its rotors do not carry it.
//! A drone in the air begins to fall instead, shows no excess, and the suspicion is dropped.

use alight_shared::msg::Header;
use alight_shared::time::{DroneClock, Time};

use super::config::TouchdownConfig;
use serde::{Deserialize, Serialize};

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
pub(crate) struct Evidence {
    /// The mission permits touching the deck.
    pub(crate) permitted: bool,
    /// A descent is commanded.
    pub(crate) descending: bool,
    /// Specific force along the body's up axis, m/s²; None without a new measurement.
    pub(crate) force: Option<f64>,
    /// Specific thrust that the pilot's own command applies, m/s²; None while the autopilot closes
    /// the loop.
    pub(crate) own_thrust: Option<f64>,
    /// Specific thrust that the autopilot reports, m/s²; None when the report is old.
    pub(crate) reported_thrust: Option<f64>,
    /// Specific thrust that hovers, m/s² (gravity).
    pub(crate) hover_thrust: f64,
    /// Foot plane above the deck as forecast, m.
    pub(crate) clearance: Option<f64>,
    /// Speed away from the deck along its normal, m/s.
    pub(crate) normal_speed: Option<f64>,
}

impl Evidence {
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
pub enum Contact {
    /// In the air.
    #[default]
    Clear,
    /// Contact suspected: pressing down with little thrust.
    Suspected {
        /// Since.
        since: DroneTime,
        /// The excess has been large since.
        carried: Option<DroneTime>,
    },
    /// On the deck.
    Confirmed,
}

/// Readings kept for the median and for resting.
const READINGS: usize = 32;
/// Readings whose median counts as the range.
const MEDIAN: usize = 5;
/// Time constant of the sustained excess, s: three samples of odometry.
const EXCESS_TIME_S: f64 = 0.03;

/// The detector.
#[derive(Clone, Debug)]
pub(crate) struct TouchdownDetector {
    /// The rangefinder's reading with the feet on the deck, m.
    feet_range: f64,
    contact: Contact,
    readings: [(DroneTime, f64); READINGS],
    /// Where the next reading goes.
    next: usize,
    excess: f64,
    sure_excess: f64,
    loaded: Option<DroneTime>,
    pause_until: DroneTime,
}

impl TouchdownDetector {
    /// For feet that the rangefinder sees at `feet_range` (m).
    pub(crate) fn new(feet_range: f64) -> Self {
        TouchdownDetector {
            feet_range,
            contact: Contact::Clear,
            readings: [(Time::from_nanos(i64::MIN), f64::INFINITY); READINGS],
            next: 0,
            excess: 0.0,
            sure_excess: 0.0,
            loaded: None,
            pause_until: Time::from_nanos(i64::MIN),
        }
    }
    /// How far it has come.
    pub(crate) fn contact(&self) -> Contact {
        self.contact
    }
    /// In the air again, e.g. after a new take-off.
    pub(crate) fn clear(&mut self) {
        self.contact = Contact::Clear;
        self.loaded = None;
    }
    /// Takes a reading of the rangefinder.
    pub(crate) fn range(&mut self, at: DroneTime, range_m: f64) {
        if let Some(r) = self.readings.get_mut(self.next) {
            *r = (at, range_m);
        }
        self.next = (self.next + 1) % READINGS;
    }
    /// Median of the newest readings, m; None when they are too old.
    pub(crate) fn median(&self, now: DroneTime, c: &TouchdownConfig) -> Option<f64> {
        let mut newest = [f64::INFINITY; MEDIAN];
        let mut n = 0;
        for k in 1..=MEDIAN {
            let (at, r) = self.readings[(self.next + READINGS - k) % READINGS];
            if (now - at).secs() <= c.range_age_s {
                newest[n] = r;
                n += 1;
            }
        }
        let some = &mut newest[..n];
        some.sort_by(f64::total_cmp);
        some.get(n / 2).copied()
    }
    /// All readings of the last `resting_s` average to the feet's range, and none is far from it.
    fn resting(&self, now: DroneTime, c: &TouchdownConfig) -> bool {
        let (mut n, mut sum, mut oldest) = (0_u32, 0.0, 0.0_f64);
        for (at, r) in &self.readings {
            let age = (now - *at).secs();
            if age > c.resting_s {
                continue;
            }
            if (r - self.feet_range).abs() > c.range_margin_m {
                return false;
            }
            n += 1;
            sum += r - self.feet_range;
            oldest = oldest.max(age);
        }
        n >= 8 && oldest > 0.8 * c.resting_s && (sum / f64::from(n)).abs() < 0.4 * c.range_margin_m
    }

    /// Takes what carries the drone; gives this step's excess.
    fn weigh(&mut self, dt: f64, e: &Evidence) -> f64 {
        let (Some(force), Some(thrust), Some(sure)) =
            (e.force, e.own_thrust.or(e.reported_thrust), e.applied_thrust())
        else {
            return 0.0;
        };
        let fraction = 1.0 - (-dt / EXCESS_TIME_S).exp();
        let impact = force - thrust;
        // A single impact must not fill the memory of the sustained excess.
        let bound = |v: f64| v.clamp(-10.0, 10.0);
        self.excess += fraction * (bound(impact) - self.excess);
        self.sure_excess += fraction * (bound(force - sure) - self.sure_excess);
        impact
    }

    /// One step; gives the evidence at the moment of confirmation.
    pub(crate) fn step(
        &mut self,
        now: DroneTime,
        dt: f64,
        e: &Evidence,
        c: &TouchdownConfig,
    ) -> Option<Touchdown> {
        if self.contact == Contact::Confirmed {
            return None;
        }
        let impact = self.weigh(dt, e);
        if !e.permitted {
            self.clear();
            return None;
        }
        let range = self.median(now, c);
        match self.contact {
            Contact::Clear => {
                self.suspect(now, impact, range, e, c);
                None
            }
            Contact::Suspected { since, carried } => self.confirm(now, (since, carried), range, e, c),
            Contact::Confirmed => None,
        }
    }

    /// An impact, an excess, or resting at the feet's range makes contact suspected.
    fn suspect(
        &mut self,
        now: DroneTime,
        impact: f64,
        range: Option<f64>,
        e: &Evidence,
        c: &TouchdownConfig,
    ) {
        if now < self.pause_until || !self.near(range, e, c, c.range_margin_m) {
            self.loaded = None;
            return;
        }
        self.loaded = (self.excess > c.suspect_excess_mps2).then(|| self.loaded.unwrap_or(now));
        let carried = self.loaded.is_some_and(|t| (now - t).secs() >= c.suspect_s);
        let rests = e.descending && self.resting(now, c);
        if carried || impact > c.impact_mps2 || rests {
            self.contact = Contact::Suspected {
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
        e: &Evidence,
        c: &TouchdownConfig,
    ) -> Option<Touchdown> {
        let left = !self.near(range, e, c, c.range_release_m);
        if left || (now - since).secs() > c.give_up_s {
            self.clear();
            self.pause_until = now + alight_shared::time::Span::from_secs(c.pause_s);
            return None;
        }
        let applied = e.applied_thrust();
        let slow = e.normal_speed.is_none_or(|v| v.abs() <= c.speed_veto_mps);
        let cut = applied.is_some_and(|t| t <= 0.8 * e.hover_thrust);
        let holds = self.near(range, e, c, c.range_margin_m)
            && slow
            && cut
            && e.reported_thrust.is_some()
            && self.sure_excess > c.confirm_excess_mps2;
        let carried = holds.then(|| carried.unwrap_or(now));
        self.contact = Contact::Suspected { since, carried };
        let needed = if range.is_some() {
            c.confirm_s
        } else {
            c.blind_confirm_s
        };
        if !carried.is_some_and(|t| (now - t).secs() >= needed) {
            return None;
        }
        self.contact = Contact::Confirmed;
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

    /// The feet are about on the deck: by the rangefinder, or by the forecast when it is silent;
    /// the forecast can veto.
    fn near(&self, range: Option<f64>, e: &Evidence, c: &TouchdownConfig, margin: f64) -> bool {
        let veto = e.clearance.is_some_and(|v| v > c.clearance_veto_m || v.is_nan());
        let close = match range {
            Some(r) => r <= self.feet_range + margin,
            None => e.clearance.is_some_and(|v| v <= c.blind_clearance_m),
        };
        close && !veto
    }
}

/// Thrust while contact is suspected, as a fraction of hover: cut at once, then ramped down.
pub(crate) fn press_fraction(since: DroneTime, now: DroneTime, c: &TouchdownConfig) -> f64 {
    let s = ((now - since).secs() / c.press_ramp_s.max(1e-3)).clamp(0.0, 1.0);
    c.press_of_hover + s * (c.press_end_of_hover - c.press_of_hover)
}

//! Outcome of a trial. The criteria use the truth and are the same for every planner.
//!
//! Success: at the first foot contact, normal and tangential speed relative to the deck are at most 1.0 m/s
//! and the tilt difference is at most 10 deg; later impacts are at most 1.0 m/s; only feet touch, and only
//! the deck; no keep-out volume is entered; motors stop within 2 s of first contact; starting 1 s after that
//! stop, all four feet stay inside the deck's edges for 3 s; all this happens within 180 s of the start.

#[cfg(test)]
mod tests;

use alight_shared::msg::{Reason, WaitingTimes};
use serde::{Deserialize, Serialize};

/// Maximum normal or tangential speed at any contact, m/s.
pub const MAX_CONTACT_MPS: f64 = 1.0;
/// Maximum angle between the normals of deck and foot plane at first contact, rad.
pub const MAX_TILT_ERROR_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// Maximum time from first contact to the stop of the motors, s.
pub const MAX_STOP_S: f64 = 2.0;
/// Time from the stop of the motors to the start of the rest period, s.
pub const SETTLING_S: f64 = 1.0;
pub const REST_S: f64 = 3.0;
pub const TIME_LIMIT_S: f64 = 180.0;
/// Maximum height of a foot above the deck that counts as contact, m.
pub const ON_DECK_M: f64 = 0.02;
/// Speed above which an impact is counted separately, for any part, direction and time, m/s.
pub const FAST_CONTACT_MPS: f64 = 2.0;
/// Minimum height of the lowest foot at which stopped motors count as a stop in the air, m.
pub const FALSE_STOP_M: f64 = 0.10;
/// Maximum limit ratio of a safe trial.
const BELOW_LIMIT: f64 = 1.0 - 1e-9;
/// Reason for a time-out without another failure.
const NOT_AT_REST: &str = "not at rest on the deck";

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    Success,
    /// Normal speed above the limit at any contact.
    Hard,
    /// Tangential speed above the limit at first contact.
    Fast,
    /// Tilt difference above the limit at first contact.
    Tilted,
    Missed,
    /// A foot crossed the deck's edge after landing.
    Slid,
    /// A part other than a foot touched, or feet lifted off.
    Tipped,
    Water,
    FalseStop,
    /// Not landed, or motors not stopped, in time.
    Timeout,
    GaveUp,
    /// Entered a keep-out volume, or hit another drone.
    Collision,
}

impl Ending {
    pub const fn name(self) -> &'static str {
        match self {
            Ending::Success => "success",
            Ending::Hard => "hard",
            Ending::Fast => "fast",
            Ending::Tilted => "tilted",
            Ending::Missed => "missed",
            Ending::Slid => "slid",
            Ending::Tipped => "tipped",
            Ending::Water => "water",
            Ending::FalseStop => "false-stop",
            Ending::Timeout => "timeout",
            Ending::GaveUp => "gave-up",
            Ending::Collision => "collision",
        }
    }
}

/// An impact of the drone, from the truth just before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEvent {
    /// False: the contact was with a part other than a foot.
    pub foot: bool,
    /// True: contact with the deck's upper surface; false: with its side.
    pub on_deck: bool,
    pub normal_mps: f64,
    pub tangential_mps: f64,
}

#[derive(Clone, Debug)]
pub struct TrialObservation<'a> {
    pub t_s: f64,
    pub contacts: &'a [ContactEvent],
    /// Feet in the deck frame: x forward, y right, height above the surface, m.
    pub feet: [[f64; 3]; 4],
    /// Attitude relative to the deck, in its axes, rad.
    pub relative_euler: [f64; 3],
    /// Angle between the normals of deck and foot plane, rad.
    pub tilt_error: f64,
    /// Horizontal distance from the drone to the deck centre, m.
    pub horizontal_m: f64,
    pub motors_on: bool,
    pub descending: bool,
    pub attempts: u32,
    pub gave_up: bool,
    /// Reason for which the mission delays its next state.
    pub waiting: Reason,
    pub in_water: bool,
    /// Whether the vessel lies upside down.
    pub capsized: bool,
    /// Distance from the drone's body to the nearest keep-out volume, m; negative inside, None without volumes.
    pub keep_out_gap_m: Option<f64>,
    pub collisions: u32,
}

impl TrialObservation<'_> {
    pub fn feet_height_m(&self) -> f64 {
        self.feet.iter().map(|f| f[2]).sum::<f64>() / 4.0
    }
}

/// Outcome of a trial; metrics of the first contact are null without a contact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    pub outcome: Ending,
    pub success: bool,
    /// Cause of the ending, with the value that decided it.
    pub reason: String,
    pub seed: u64,
    pub sea: String,
    pub planner: String,
    /// Predictor supplied by the caller; null: the drone's own.
    #[serde(default)]
    pub predictor: Option<String>,
    /// Number of descents begun.
    pub attempts: u32,
    /// Number of contacts that exceed the limits.
    pub unsafe_contacts: u32,
    #[serde(default)]
    pub water_contacts: u32,
    #[serde(default)]
    pub collisions: u32,
    #[serde(default)]
    pub contacts_above_2_mps: u32,
    /// Maximum ratio of a metric to its limit over all contacts: 1 or more if and only if the trial was
    /// unsafe; 0 without contact.
    #[serde(default)]
    pub limit_ratio: f64,
    /// Number of entries into keep-out volumes; absent without volumes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keep_out_collisions: Option<u32>,
    /// Minimum distance from the drone's body to a keep-out volume, m; negative inside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keep_out_gap_m: Option<f64>,
    /// Distance from the deck centre to the feet's centroid at first contact, in the deck plane, m.
    pub position_error_m: Option<f64>,
    /// Position error at the end of the rest, m.
    pub rest_position_error_m: Option<f64>,
    /// Speed along the deck's normal at first contact, m/s.
    pub touchdown_speed_mps: Option<f64>,
    pub tangential_speed_mps: Option<f64>,
    /// Angle between the normals at first contact, deg.
    pub tilt_error_deg: Option<f64>,
    /// Roll of the drone relative to the deck, in the deck's axes, at first contact, deg.
    pub roll_error_deg: Option<f64>,
    /// Pitch of the drone relative to the deck, in the deck's axes, at first contact, deg.
    pub pitch_error_deg: Option<f64>,
    /// Yaw of the drone relative to the deck, in the deck's axes, at first contact, deg.
    pub yaw_error_deg: Option<f64>,
    /// Time from the start of the first descent to first contact, including interruptions, s.
    pub landing_time_s: Option<f64>,
    /// Time from first being within 2 m of the deck centre horizontally to first contact, s.
    pub over_deck_time_s: Option<f64>,
    pub stop_time_s: Option<f64>,
    /// Age of the newest vessel estimate in the forecast at first contact, s; null when none was used.
    #[serde(default)]
    pub radio_age_s: Option<f64>,
    /// Age of the newest detection in the forecast at first contact, s.
    #[serde(default)]
    pub vision_age_s: Option<f64>,
    /// Position error after the scenario's `stay_s`, m; null when not observed.
    #[serde(default)]
    pub stay_position_error_m: Option<f64>,
    /// Predicted probability of success at the last descent's start; null when unknown.
    #[serde(default)]
    pub likelihood: Option<f64>,
    /// Predicted probability of an unsafe contact at the last descent's start; null when unknown.
    #[serde(default)]
    pub harm: Option<f64>,
    /// Harm at the last flare's start, the commitment; null without a flare in the last descent.
    #[serde(default)]
    pub committed_harm: Option<f64>,
    /// Simulated time including warm-up, s.
    pub sim_time_s: f64,
    pub wall_time_s: f64,
    /// 99th percentile of the planner's step durations, ms; null if not measured.
    #[serde(default)]
    pub solve_p99_ms: Option<f64>,
    /// Fraction of the flight during which the pilot did not admit the newest plan.
    #[serde(default)]
    pub refused_plans: f64,
    /// Hash of every true state and set-point; equal digests mean bit-identical flights.
    pub digest: String,
}

impl Outcome {
    /// Whether the drone neither landed in time nor exceeded a contact limit: it waited, aborted, or began
    /// its descent too late.
    pub fn is_rejected(&self) -> bool {
        let out_of_time = self.outcome == Ending::GaveUp || self.reason.starts_with(NOT_AT_REST);
        !self.success && out_of_time && self.unsafe_contacts == 0
    }
    /// Whether the trial is neither a success nor [`Outcome::is_rejected`].
    pub fn is_unsafe(&self) -> bool {
        !self.success && !self.is_rejected()
    }
}

struct FirstContact {
    t_s: f64,
    position_error: f64,
    normal: f64,
    tangential: f64,
    tilt: f64,
    euler: [f64; 3],
}

#[derive(Default)]
pub struct Judge {
    descent_began: Option<f64>,
    over_deck: Option<f64>,
    first: Option<FirstContact>,
    stopped: Option<f64>,
    failure: Option<(Ending, String)>,
    unsafe_contacts: u32,
    water_contacts: u32,
    fast_contacts: u32,
    nearest: f64,
    /// Number of entries into keep-out volumes, minimum distance from one (m), and whether the drone is inside one now.
    keep_out: Option<(u32, f64, bool)>,
    collisions: u32,
    attempts: u32,
    rest_error: Option<f64>,
    ended: bool,
    /// Durations of the mission's reasons to wait, and the time of the newest observation, s.
    waited: WaitingTimes,
    newest_s: f64,
}

pub(super) fn centroid_error(feet: &[[f64; 3]; 4]) -> f64 {
    let mean = |i: usize| feet.iter().map(|f| f[i]).sum::<f64>() / 4.0;
    mean(0).hypot(mean(1))
}

impl Judge {
    /// Judges one tick; returns true when the trial is over. `half_deck` is half the deck's length and width, m.
    pub fn observe(&mut self, o: &TrialObservation<'_>, half_deck: [f64; 2]) -> bool {
        self.attempts = o.attempts;
        self.waited.add(o.waiting, o.t_s - self.newest_s);
        self.newest_s = o.t_s;
        if o.descending {
            self.descent_began.get_or_insert(o.t_s);
        }
        if o.horizontal_m <= 2.0 {
            self.over_deck.get_or_insert(o.t_s);
        }
        for touch in o.contacts {
            self.touch(o, touch, half_deck);
        }
        if let Some(gap) = o.keep_out_gap_m {
            let within = gap <= 0.0;
            let (entries, nearest, was_within) = self.keep_out.unwrap_or((0, gap, false));
            let entered = within && !was_within;
            self.keep_out = Some((entries + u32::from(entered), nearest.min(gap), within));
            if within {
                self.fail(
                    Ending::Collision,
                    format!("in a keep-out volume after {:.1} s", o.t_s),
                );
            }
        }
        self.collisions = o.collisions;
        if o.collisions > 0 {
            self.fail(Ending::Collision, "met another drone".into());
        }
        if o.in_water {
            self.water_contacts += 1;
            self.fail(Ending::Water, format!("in the water after {:.1} s", o.t_s));
            self.ended = true;
        }
        if !o.motors_on && self.stopped.is_none() {
            self.stopped = Some(o.t_s);
            let lowest = o.feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min);
            if self.first.is_none() || lowest > FALSE_STOP_M {
                self.fail(
                    Ending::FalseStop,
                    format!("motors stopped {lowest:.2} m above the deck"),
                );
            }
        }
        match (self.first.as_ref().map(|f| f.t_s), self.stopped) {
            (Some(first), None) if o.t_s > first + MAX_STOP_S => {
                self.fail(
                    Ending::Timeout,
                    format!("motors still on {MAX_STOP_S} s after first contact"),
                );
            }
            (_, Some(stopped)) => self.rest(o, stopped, half_deck),
            (Some(_) | None, None) => {}
        }
        if o.gave_up && self.first.is_none() {
            self.fail(
                Ending::GaveUp,
                format!("the mission gave up at attempt {}", o.attempts),
            );
            self.ended = true;
        }
        if o.capsized {
            let reason = format!("the simulated vessel has capsized after {:.1} s", o.t_s);
            self.fail(Ending::GaveUp, reason);
            self.ended = true;
        }
        if o.t_s >= TIME_LIMIT_S {
            let longest = self.waited.longest();
            let waiting = longest.map_or_else(String::new, |(why, s)| {
                format!(", for {s:.0} s of them mission waiting: {why}")
            });
            let reason = format!("{NOT_AT_REST} after {TIME_LIMIT_S} s{waiting}");
            self.fail(Ending::Timeout, reason);
            self.ended = true;
        }
        self.ended
    }

    fn touch(&mut self, o: &TrialObservation<'_>, touch: &ContactEvent, half_deck: [f64; 2]) {
        let normal = touch.normal_mps;
        let tangential = touch.tangential_mps;
        let mut unsafe_contact = true;
        if !touch.foot {
            self.fail(
                Ending::Tipped,
                format!("a part other than a foot touched at {normal:.2} m/s"),
            );
        } else if !touch.on_deck {
            self.fail(
                Ending::Missed,
                "a foot touched something other than the deck".into(),
            );
        } else if normal > MAX_CONTACT_MPS {
            self.fail(
                Ending::Hard,
                format!("contact at {normal:.2} m/s (limit {MAX_CONTACT_MPS})"),
            );
        } else if self.first.is_some() {
            unsafe_contact = false;
        } else if tangential > MAX_CONTACT_MPS {
            self.fail(
                Ending::Fast,
                format!("first contact at {tangential:.2} m/s along the deck"),
            );
        } else if o.tilt_error > MAX_TILT_ERROR_RAD {
            let deg = o.tilt_error.to_degrees();
            self.fail(
                Ending::Tilted,
                format!("first contact {deg:.1} deg off the deck's tilt"),
            );
        } else {
            unsafe_contact = false;
        }
        self.nearest = self.nearest.max(normal / MAX_CONTACT_MPS);
        if self.first.is_none() {
            let ratios = [tangential / MAX_CONTACT_MPS, o.tilt_error / MAX_TILT_ERROR_RAD];
            self.nearest = ratios.into_iter().fold(self.nearest, f64::max);
        }
        if unsafe_contact {
            self.unsafe_contacts += 1;
        }
        if normal.hypot(tangential) > FAST_CONTACT_MPS {
            self.fast_contacts += 1;
        }
        if self.first.is_none() {
            let position_error = centroid_error(&o.feet);
            if o.feet
                .iter()
                .all(|f| f[0].abs() > half_deck[0] || f[1].abs() > half_deck[1])
            {
                self.fail(
                    Ending::Missed,
                    format!("first contact {position_error:.2} m off the centre"),
                );
            }
            self.first = Some(FirstContact {
                t_s: o.t_s,
                position_error,
                normal,
                tangential,
                tilt: o.tilt_error,
                euler: o.relative_euler,
            });
        }
    }

    fn rest(&mut self, o: &TrialObservation<'_>, stopped: f64, half_deck: [f64; 2]) {
        if o.t_s > stopped + SETTLING_S && self.failure.is_none() {
            if o.feet
                .iter()
                .any(|f| f[0].abs() > half_deck[0] || f[1].abs() > half_deck[1])
            {
                self.fail(Ending::Slid, "a foot left the deck's edges".into());
            } else if let Some(f) = o.feet.iter().find(|f| f[2] > ON_DECK_M) {
                self.fail(Ending::Tipped, format!("a foot is {:.2} m above the deck", f[2]));
            }
        }
        if o.t_s >= stopped + SETTLING_S + REST_S {
            self.rest_error = Some(centroid_error(&o.feet));
            self.ended = true;
        }
    }

    fn fail(&mut self, ending: Ending, reason: String) {
        // The first failure decides; later failures follow from it.
        self.failure.get_or_insert((ending, reason));
    }

    pub fn first_contact_s(&self) -> Option<f64> {
        self.first.as_ref().map(|f| f.t_s)
    }

    pub fn outcome(&self, seed: u64, sea: &str, planner: &str, sim_time_s: f64) -> Outcome {
        let (ending, reason) = match (&self.failure, self.ended, self.first.is_some()) {
            (Some((e, r)), _, _) => (*e, r.clone()),
            (None, true, true) => (Ending::Success, "at rest on the deck".into()),
            (None, _, _) => (Ending::Timeout, "not over yet".into()),
        };
        let first = self.first.as_ref();
        let deg = |f: fn(&FirstContact) -> f64| first.map(|c| f(c).to_degrees());
        let mut outcome = Outcome {
            outcome: ending,
            success: ending == Ending::Success,
            reason,
            seed,
            sea: sea.into(),
            planner: planner.into(),
            predictor: None,
            attempts: self.attempts,
            unsafe_contacts: self.unsafe_contacts,
            water_contacts: self.water_contacts,
            collisions: self.collisions,
            contacts_above_2_mps: self.fast_contacts,
            limit_ratio: self.nearest,
            keep_out_collisions: self.keep_out.map(|(entries, ..)| entries),
            keep_out_gap_m: self.keep_out.map(|(_, nearest, _)| nearest),
            position_error_m: first.map(|c| c.position_error),
            rest_position_error_m: self.rest_error,
            touchdown_speed_mps: first.map(|c| c.normal),
            tangential_speed_mps: first.map(|c| c.tangential),
            tilt_error_deg: deg(|c| c.tilt),
            roll_error_deg: deg(|c| c.euler[0]),
            pitch_error_deg: deg(|c| c.euler[1]),
            yaw_error_deg: deg(|c| c.euler[2]),
            landing_time_s: first.and_then(|c| self.descent_began.map(|d| c.t_s - d)),
            over_deck_time_s: first.and_then(|c| self.over_deck.map(|d| c.t_s - d)),
            stop_time_s: first.and_then(|c| self.stopped.map(|s| s - c.t_s)),
            radio_age_s: None,
            vision_age_s: None,
            likelihood: None,
            harm: None,
            committed_harm: None,
            stay_position_error_m: None,
            sim_time_s,
            wall_time_s: 0.0,
            solve_p99_ms: None,
            refused_plans: 0.0,
            digest: String::new(),
        };
        // Unsafe endings without a metric have the ratio 1: motors that stop in the air or do not stop,
        // water, an edge, another drone.
        outcome.limit_ratio = if outcome.is_unsafe() {
            outcome.limit_ratio.max(1.0)
        } else {
            outcome.limit_ratio.min(BELOW_LIMIT)
        };
        outcome
    }
}

//! Parameters of the rendezvous planner.

use std::collections::BTreeMap;

use alight_shared::config;
use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

use crate::planner::weights::FaaDistance;

/// A stage's weight: far from the contact, and what is added at it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightSchedule {
    /// Far from the contact.
    pub far: f64,
    /// Added at the contact.
    pub contact: f64,
}

impl WeightSchedule {
    /// The weight at the fraction `g` of contact, 0 to 1.
    pub fn at(&self, g: f64) -> f64 {
        self.far + self.contact * g
    }
}
impl Check for WeightSchedule {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("far", self.far, 0.0, 1e6)?;
        at.range("contact", self.contact, 0.0, 1e7)
    }
    fn describe(at: &Keys<'_>, keys: &mut BTreeMap<String, String>) {
        keys.insert(at.key("far"), " Far from the contact.".into());
        keys.insert(at.key("contact"), " Added at the contact.".into());
    }
}

config! {
    /// The way down: fast, braked, soft.
    ///
    /// Chosen: after a prototype. The soft part is as long as the drone's lag makes the contact come too soon: with 40 ms on
    /// the wire to the autopilot 79 of 80 landings stop their motors in time at 0.28 s, 76 at 0.2 s, 80 at 0.35 s. In it the
    /// tag is out of view: each 0.1 s of it adds 8 mm to the error of the place.
    #[derive(Copy)]
    pub struct ProfileConfig {
        /// Greatest speed of sinking, m/s.
        pub sink_mps: f64 = 2.5;
        /// Deceleration before the soft part, m/s².
        pub braking_mps2: f64 = 2.5, in 0.2..=6.0;
        /// Greatest acceleration downwards, m/s².
        pub acceleration_mps2: f64 = 3.0, in 0.2..=8.0;
        /// When late, sinking at most this much faster than `sink_mps`, m/s.
        pub hurry_mps: f64 = 0.5, in 0.0..=4.0;
        /// Speed of the soft part relative to the deck, m/s.
        pub touch_mps: f64 = 0.28, in 0.05..=1.0;
        /// Duration of the soft part, s.
        pub soft_s: f64 = 0.2, in 0.0..=5.0;
        /// After the contact the reference goes on into the deck down to here, m.
        pub press_m: f64 = 0.5, in 0.01..=1.0;
        /// Higher than this above the deck its heave is not followed, m ...
        pub mean_above_m: f64 = 4.5;
        /// ... lower than this it is followed fully, m.
        pub heave_below_m: f64 = 1.5, in 0.3..=50.0;
    }
    check |this, at| {
        at.range("sink_mps", this.sink_mps, this.touch_mps, 4.0)?;
        at.range("mean_above_m", this.mean_above_m, this.heave_below_m + 0.1, 100.0)?;
    }
}

config! {
    /// Choice of the touchdown time.
    ///
    /// Chosen: after a prototype.
    #[derive(Copy)]
    pub struct TouchdownTimeConfig {
        /// The instant is chosen within this time after the earliest, s; 0 takes the earliest.
        pub window_s: f64 = 2.5, in 0.0..=4.0;
        /// Chosen no more when the contact is nearer than this, s.
        pub freeze_s: f64 = 1.3, in 0.1..=4.0;
        /// Acceleration of the deck that an aligned drone does not have and that counts as 1, m/s².
        pub mismatch_mps2: f64 = 0.5, in 0.01..=100.0;
        /// Tilt that counts as 1/2, deg.
        pub tilt_deg: f64 = 5.0, in 0.1..=90.0;
        /// Rate of tilt that counts as 1/2, deg/s.
        pub tilt_rate_dps: f64 = 5.0, in 0.1..=1e3;
        /// Speed at which the deck rises that counts as 1/2, m/s: it meets a drone that waits for it sooner or later
        /// than predicted, before the drone is aligned.
        pub rising_mps: f64 = 0.8, in 0.01..=1e3;
        /// Cost of waiting, 1/s.
        pub waiting_per_s: f64 = 0.3, in 0.0..=100.0;
        /// Another instant is taken when it costs less by this much.
        pub hysteresis: f64 = 0.2, in 0.0..=100.0;
        /// When late, the contact may be planned this much sooner than by the profile, s.
        pub hurry_s: f64 = 0.15, in 0.0..=1.0;
        /// In the flare the contact comes at most this much later than the profile has it, s: low over the deck
        /// the tag is out of view, and a drone that waits there drifts off or is left behind.
        pub linger_s: f64 = 0.05, in 0.0..=10.0;
    }
}

config! {
    /// The rendezvous planner (`alight`).
    ///
    /// Chosen: on landings on seven decks (40 each). Tilt weighs more far away than alignment needs so that the plan does
    /// not chase the forecast's noise. Stages count as contact for as long as the contact may come too late (`after_s`,
    /// 0.1 s): an alignment that lasts longer costs place and tilt, because a drone with a matched tilt accelerates away
    /// from the deck.
    #[derive(Copy)]
    pub struct RendezvousConfig {
        /// The way down.
        pub profile: ProfileConfig;
        /// The instant of contact.
        pub touchdown_time: TouchdownTimeConfig;
        /// Tilt is planned as the horizontal acceleration that it causes at the planned vertical one; else
        /// as `g tilt`, the linear model's.
        pub true_tilt: bool = true;
        /// Whose height over the deck measures how near the contact is.
        pub distance: FaaDistance = FaaDistance::PerStage;
        /// A landing begins from the measured state; else from the plan that was followed.
        pub start_from_measured: bool = true;
        /// Height over the deck at which a stage counts as contact by exp(-1), m.
        pub near_m: f64 = 0.12, in 0.01..=5.0;
        /// Stages this long after the contact count by exp(-1), s.
        pub after_s: f64 = 0.1, in 0.01..=10.0;
        /// Position x, y, 1/m².
        pub horizontal: WeightSchedule = WeightSchedule { far: 40.0, contact: 12_000.0 }, table;
        /// Velocity x, y, s²/m².
        pub horizontal_velocity: WeightSchedule = WeightSchedule { far: 4.0, contact: 300.0 }, table;
        /// Tilt, as horizontal acceleration per g, 1/rad².
        pub tilt: WeightSchedule = WeightSchedule { far: 50.0, contact: 14_000.0 }, table;
        /// Its rate, s²/rad².
        pub rates: WeightSchedule = WeightSchedule { far: 5.0, contact: 30.0 }, table;
        /// Position z, 1/m².
        pub vertical: WeightSchedule = WeightSchedule { far: 40.0, contact: 1000.0 }, table;
        /// Velocity z, s²/m².
        pub vertical_velocity: WeightSchedule = WeightSchedule { far: 40.0, contact: 300.0 }, table;
    }
}

use std::collections::BTreeMap;

use alight_shared::{
    config,
    config::{Check, ConfigError, Keys},
};
use serde::{Deserialize, Serialize};

use crate::planner::weights::FaaDistance;

/// Weight of a stage, increased near contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightSchedule {
    /// Weight far from contact.
    pub far: f64,
    /// Increment at contact.
    pub contact: f64,
}

impl WeightSchedule {
    /// Weight at the proximity `g` to contact, 0 to 1.
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
        keys.insert(at.key("far"), " Weight far from contact.".into());
        keys.insert(at.key("contact"), " Increment at contact.".into());
    }
}

config! {
    /// Descent profile with a fast, a braked and a soft part.
    ///
    /// Chosen: with a prototype. The soft part is long enough for the drone's lag, which can cause an early contact: with
    /// 40 ms of delay to the autopilot the motors stop in time in 79 of 80 landings at 0.28 s, in 76 at 0.2 s and in 80
    /// at 0.35 s. During the soft part the tag is out of view, and each 0.1 s adds 8 mm to the position error.
    #[derive(Copy)]
    pub struct ProfileConfig {
        /// Maximum sink rate, m/s.
        pub sink_mps: f64 = 2.5;
        /// Deceleration before the soft part, m/s².
        pub braking_mps2: f64 = 2.5, in 0.2..=6.0;
        /// Maximum downward acceleration, m/s².
        pub acceleration_mps2: f64 = 3.0, in 0.2..=8.0;
        /// Maximum increase of `sink_mps` for a late drone, m/s.
        pub hurry_mps: f64 = 0.5, in 0.0..=4.0;
        /// Sink rate of the soft part relative to the deck, m/s.
        pub touch_mps: f64 = 0.28, in 0.05..=1.0;
        /// Duration of the soft part, s.
        pub soft_s: f64 = 0.2, in 0.0..=5.0;
        /// Depth below the deck's plane at which the reference ends after contact, m.
        pub press_m: f64 = 0.5, in 0.01..=1.0;
        /// Height above the deck above which the reference does not follow its heave, m.
        pub mean_above_m: f64 = 4.5;
        /// Height above the deck below which the reference follows its heave fully, m.
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
    /// Chosen: with a prototype.
    #[derive(Copy)]
    pub struct TouchdownTimeConfig {
        /// Search window after the earliest touchdown time, s; 0 selects the earliest time.
        pub window_s: f64 = 2.5, in 0.0..=4.0;
        /// Time to contact below which the choice is final, s.
        pub freeze_s: f64 = 1.3, in 0.1..=4.0;
        /// Acceleration of the deck relative to an aligned drone that has a cost of 1, m/s².
        pub mismatch_mps2: f64 = 0.5, in 0.01..=100.0;
        /// Tilt that has a cost of 1/2, deg.
        pub tilt_deg: f64 = 5.0, in 0.1..=90.0;
        /// Tilt rate that has a cost of 1/2, deg/s.
        pub tilt_rate_dps: f64 = 5.0, in 0.1..=1e3;
        /// Rising speed of the deck that has a cost of 1/2, m/s: a rising deck makes the contact time of an unaligned
        /// drone uncertain.
        pub rising_mps: f64 = 0.8, in 0.01..=1e3;
        /// Cost of waiting, 1/s.
        pub waiting_per_s: f64 = 0.3, in 0.0..=100.0;
        /// Minimum cost reduction for another time to replace the chosen one.
        pub hysteresis: f64 = 0.2, in 0.0..=100.0;
        /// Maximum advance of the contact relative to the profile for a late drone, s.
        pub hurry_s: f64 = 0.15, in 0.0..=1.0;
        /// Maximum delay of the contact relative to the profile in the flare, s: without the tag in view a waiting
        /// drone drifts away from the deck.
        pub linger_s: f64 = 0.05, in 0.0..=10.0;
    }
}

config! {
    /// The rendezvous planner (`alight`).
    ///
    /// Chosen: from 40 landings on each of seven decks. Far from the deck the tilt has a larger weight than alignment
    /// needs, so that the plan does not follow the forecast's noise. Stages keep the weights of contact for as long as
    /// the contact may be late (`after_s`, 0.1 s). A longer alignment increases the errors of position and tilt,
    /// because a drone with a matched tilt accelerates away from the deck.
    #[derive(Copy)]
    pub struct RendezvousConfig {
        /// Descent profile.
        pub profile: ProfileConfig;
        /// Choice of the touchdown time.
        pub touchdown_time: TouchdownTimeConfig;
        /// Plan the tilt as the horizontal acceleration that it causes at the planned vertical acceleration. If false,
        /// as `g tilt` of the linear model.
        pub true_tilt: bool = true;
        /// Clearance that determines the proximity to contact: that of each stage, or the current one.
        pub distance: FaaDistance = FaaDistance::PerStage;
        /// Start a landing from the measured state. If false, from the previous plan.
        pub start_from_measured: bool = true;
        /// Height above the deck at which the proximity to contact is exp(-1), m.
        pub near_m: f64 = 0.12, in 0.01..=5.0;
        /// Time after contact at which the proximity is exp(-1), s.
        pub after_s: f64 = 0.1, in 0.01..=10.0;
        /// Position x, y, 1/m².
        pub horizontal: WeightSchedule = WeightSchedule { far: 40.0, contact: 12_000.0 }, table;
        /// Velocity x, y, s²/m².
        pub horizontal_velocity: WeightSchedule = WeightSchedule { far: 4.0, contact: 300.0 }, table;
        /// Tilt, as horizontal acceleration per g, 1/rad².
        pub tilt: WeightSchedule = WeightSchedule { far: 50.0, contact: 14_000.0 }, table;
        /// Rate of that tilt, s²/rad².
        pub rates: WeightSchedule = WeightSchedule { far: 5.0, contact: 30.0 }, table;
        /// Position z, 1/m².
        pub vertical: WeightSchedule = WeightSchedule { far: 40.0, contact: 1000.0 }, table;
        /// Velocity z, s²/m².
        pub vertical_velocity: WeightSchedule = WeightSchedule { far: 40.0, contact: 300.0 }, table;
    }
}

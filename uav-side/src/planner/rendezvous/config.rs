//! Figures of the rendezvous planner.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

use crate::planner::weights::FaaDistance;

/// A stage's weight: far from the contact, and what is added at it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Meeting {
    /// Far from the contact.
    pub far: f64,
    /// Added at the contact.
    pub contact: f64,
}

impl Meeting {
    /// The weight at the share `g` of contact, 0 to 1.
    pub fn at(&self, g: f64) -> f64 {
        self.far + self.contact * g
    }
}
impl Check for Meeting {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("far", self.far, 0.0, 1e6)?;
        at.range("contact", self.contact, 0.0, 1e7)
    }
}

/// The way down: fast, braked, soft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProfileConfig {
    /// Greatest speed of sinking, m/s.
    pub sink_mps: f64,
    /// Deceleration before the soft part, m/s².
    pub braking_mps2: f64,
    /// Greatest acceleration downwards, m/s².
    pub acceleration_mps2: f64,
    /// When late, sinking at most this much faster than `sink_mps`, m/s.
    pub hurry_mps: f64,
    /// Speed of the soft part relative to the deck, m/s.
    pub touch_mps: f64,
    /// Duration of the soft part, s.
    pub soft_s: f64,
    /// After the contact the reference goes on into the deck down to here, m.
    pub press_m: f64,
    /// Higher than this above the deck its heave is not followed, m ...
    pub mean_above_m: f64,
    /// ... lower than this it is followed wholly, m.
    pub heave_below_m: f64,
}

impl Default for ProfileConfig {
    /// Ours, after a prototype: 2.5 m/s, then 0.28 m/s for the last 0.35 s.
    fn default() -> Self {
        ProfileConfig {
            sink_mps: 2.5,
            braking_mps2: 2.5,
            acceleration_mps2: 3.0,
            hurry_mps: 0.5,
            touch_mps: 0.28,
            soft_s: 0.35,
            press_m: 0.5,
            mean_above_m: 4.5,
            heave_below_m: 1.5,
        }
    }
}
impl Check for ProfileConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("touch_mps", self.touch_mps, 0.05, 1.0)?;
        at.range("sink_mps", self.sink_mps, self.touch_mps, 4.0)?;
        at.range("braking_mps2", self.braking_mps2, 0.2, 6.0)?;
        at.range("acceleration_mps2", self.acceleration_mps2, 0.2, 8.0)?;
        at.range("hurry_mps", self.hurry_mps, 0.0, 4.0)?;
        at.range("soft_s", self.soft_s, 0.0, 5.0)?;
        at.range("press_m", self.press_m, 0.01, 1.0)?;
        at.range("heave_below_m", self.heave_below_m, 0.3, 50.0)?;
        at.range("mean_above_m", self.mean_above_m, self.heave_below_m + 0.1, 100.0)
    }
}

/// Which instant is a good one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InstantConfig {
    /// The instant is chosen within this time after the earliest, s; 0 takes the earliest.
    pub window_s: f64,
    /// Chosen no more when the contact is nearer than this, s.
    pub freeze_s: f64,
    /// Acceleration of the deck that an aligned drone does not share and that counts as 1, m/s².
    pub mismatch_mps2: f64,
    /// Tilt that counts as 1/2, deg.
    pub tilt_deg: f64,
    /// Rate of tilt that counts as 1/2, deg/s.
    pub tilt_rate_dps: f64,
    /// Speed at which the deck rises that counts as 1/2, m/s: it meets a drone that waits for it sooner or later
    /// than foretold, before the drone is aligned.
    pub rising_mps: f64,
    /// Cost of waiting, 1/s.
    pub waiting_per_s: f64,
    /// Another instant is taken when it costs less by this much.
    pub hysteresis: f64,
    /// When late, the contact may be meant to come this much sooner than the profile has it, s.
    pub hurry_s: f64,
    /// In the flare the contact comes at most this much later than the profile has it, s: low over the deck
    /// the tag is out of view, and a drone that waits there drifts off or is left behind.
    pub linger_s: f64,
}

impl Default for InstantConfig {
    /// Ours, after a prototype.
    fn default() -> Self {
        InstantConfig {
            window_s: 2.5,
            freeze_s: 1.3,
            mismatch_mps2: 0.5,
            tilt_deg: 5.0,
            tilt_rate_dps: 5.0,
            rising_mps: 0.8,
            waiting_per_s: 0.3,
            hysteresis: 0.2,
            hurry_s: 0.15,
            linger_s: 0.05,
        }
    }
}
impl Check for InstantConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("window_s", self.window_s, 0.0, 4.0)?;
        at.range("freeze_s", self.freeze_s, 0.1, 4.0)?;
        at.range("mismatch_mps2", self.mismatch_mps2, 0.01, 100.0)?;
        at.range("tilt_deg", self.tilt_deg, 0.1, 90.0)?;
        at.range("tilt_rate_dps", self.tilt_rate_dps, 0.1, 1e3)?;
        at.range("rising_mps", self.rising_mps, 0.01, 1e3)?;
        at.range("waiting_per_s", self.waiting_per_s, 0.0, 100.0)?;
        at.range("hysteresis", self.hysteresis, 0.0, 100.0)?;
        at.range("hurry_s", self.hurry_s, 0.0, 1.0)?;
        at.range("linger_s", self.linger_s, 0.0, 10.0)
    }
}

/// The wind in the plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindConfig {
    /// Time constant with which it is learnt, s.
    pub time_s: f64,
    /// Largest acceleration believed, m/s².
    pub limit_mps2: f64,
    /// Closer than this to the deck nothing is learnt: a contact is no wind, m.
    pub free_m: f64,
    /// Wind up to this acceleration blows an aligned drone along, m/s² ...
    pub aligned_mps2: f64,
    /// ... and this share of what is beyond; for the rest it keeps leaning.
    pub aligned_share: f64,
}

impl Default for WindConfig {
    /// Ours. Slower than the pilot's: the plan allows for the mean, the pilot for gusts; at most the
    /// wind of 14 m/s on the default drone. An alignment lasts about 0.3 s, so each m/s² costs
    /// 0.3 m/s along the deck, and each that is leant against 6 deg: at 5 m/s (0.7 m/s²) aligning
    /// is cheap, at 8 m/s (1.8 m/s²) both are shared.
    fn default() -> Self {
        WindConfig {
            time_s: 0.7,
            limit_mps2: 6.0,
            free_m: 0.5,
            aligned_mps2: 1.2,
            aligned_share: 0.6,
        }
    }
}
impl Check for WindConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("time_s", self.time_s, 0.05, 60.0)?;
        at.range("limit_mps2", self.limit_mps2, 0.0, 9.0)?;
        at.range("free_m", self.free_m, 0.0, 10.0)?;
        at.range("aligned_mps2", self.aligned_mps2, 0.0, 9.0)?;
        at.range("aligned_share", self.aligned_share, 0.0, 1.0)
    }
}

/// The rendezvous planner (`alight`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RendezvousConfig {
    /// The way down.
    pub profile: ProfileConfig,
    /// The instant of contact.
    pub instant: InstantConfig,
    /// The wind.
    pub wind: WindConfig,
    /// Tilt is planned as the horizontal acceleration that it causes at the planned vertical one; else
    /// as `g tilt`, the linear model's.
    pub true_tilt: bool,
    /// Whose height over the deck tells how near the contact is.
    pub distance: FaaDistance,
    /// A landing begins from the measured state; else from the plan that was followed.
    pub begins_measured: bool,
    /// Height over the deck at which a stage counts as contact by exp(-1), m.
    pub near_m: f64,
    /// Stages this long after the contact count by exp(-1), s.
    pub after_s: f64,
    /// Position x, y, 1/m².
    pub horizontal: Meeting,
    /// Velocity x, y, s²/m².
    pub horizontal_velocity: Meeting,
    /// Tilt, as horizontal acceleration per g, 1/rad².
    pub tilt: Meeting,
    /// Its rate, s²/rad².
    pub rates: Meeting,
    /// Position z, 1/m².
    pub vertical: Meeting,
    /// Velocity z, s²/m².
    pub vertical_velocity: Meeting,
}

impl Default for RendezvousConfig {
    /// Ours, after a prototype (position 20 + 300 g, velocity 4 + 60 g, tilt 0.02 + 100 g in
    /// (m/s²)⁻², times g² here, `g = exp(-(h / 0.1 m)²)`). More of place and velocity at the contact
    /// cost 0.1 deg and gained 1 cm on 100 landings (0,0 and 0.8,5: 0.076 -> 0.069 m, 0.094 -> 0.084), and once
    /// more 0.5 cm on 200 at 0.8,5 (1500 and 150: 0.0642 -> 0.0596 m; tilt p95 1.9 -> 2.6 deg);
    /// tilt weighs more far away so that the plan does not chase the forecast's noise. With 9600 a drone leaned
    /// against the slope until 0.1 s before the contact, so that one that came early met it askew: 0.8 m, 5 s
    /// without sideways coupling, 400 seeds: tilt p95 4.75 -> 4.2 (13 000) and 3.6 deg (16 000), place 0.060 -> 0.062 and 0.063 m.
    fn default() -> Self {
        let meeting = |far, contact| Meeting { far, contact };
        RendezvousConfig {
            profile: ProfileConfig::default(),
            instant: InstantConfig::default(),
            wind: WindConfig::default(),
            true_tilt: true,
            distance: FaaDistance::PerStage,
            begins_measured: true,
            near_m: 0.1,
            after_s: 0.3,
            horizontal: meeting(40.0, 8000.0),
            horizontal_velocity: meeting(4.0, 300.0),
            tilt: meeting(50.0, 14_000.0),
            rates: meeting(5.0, 30.0),
            vertical: meeting(40.0, 1000.0),
            vertical_velocity: meeting(40.0, 300.0),
        }
    }
}
impl Check for RendezvousConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.profile.check(&at.table("profile"))?;
        self.instant.check(&at.table("instant"))?;
        self.wind.check(&at.table("wind"))?;
        at.range("near_m", self.near_m, 0.01, 5.0)?;
        at.range("after_s", self.after_s, 0.01, 10.0)?;
        self.horizontal.check(&at.table("horizontal"))?;
        self.horizontal_velocity.check(&at.table("horizontal_velocity"))?;
        self.tilt.check(&at.table("tilt"))?;
        self.rates.check(&at.table("rates"))?;
        self.vertical.check(&at.table("vertical"))?;
        self.vertical_velocity.check(&at.table("vertical_velocity"))
    }
}

//! Weights that increase near the deck: Forcing Attitude Alignment (FAA), Procházka et al. 2024, section III,
//! Table 4.

use serde::{Deserialize, Serialize};

use std::collections::BTreeMap;

use alight_shared::{
    config,
    config::{Check, ConfigError, Keys},
};

use super::model::{ModelState, STATES, state};

config! {
    /// Diagonal of Q far from the deck, for the paper's groups of states.
    ///
    /// Defaults: Procházka 2024, Table 4, without the exponentials.
    #[derive(Copy)]
    pub struct Weights {
        /// Position x, y, 1/m².
        pub horizontal: f64 = 30.0, in 0.0..=1e6;
        /// Position z, 1/m².
        pub vertical: f64 = 40.0, in 0.0..=1e6;
        /// Roll and pitch, 1/rad².
        pub tilt: f64 = 1.0, in 0.0..=1e6;
        /// Heading, 1/rad².
        pub yaw: f64 = 50.0, in 0.0..=1e6;
        /// Velocity x, y, s²/m².
        pub horizontal_velocity: f64 = 1.0, in 0.0..=1e6;
        /// Velocity z, s²/m².
        pub vertical_velocity: f64 = 3000.0, in 0.0..=1e6;
        /// Euler rates, s²/rad².
        pub rates: f64 = 1.0, in 0.0..=1e6;
    }
}

impl Weights {
    /// Diagonal of Q in the paper's order of states.
    pub const fn diagonal(&self) -> ModelState {
        let (p, v, w) = (self.horizontal, self.horizontal_velocity, self.rates);
        [
            p,
            p,
            self.vertical,
            self.tilt,
            self.tilt,
            self.yaw,
            v,
            v,
            self.vertical_velocity,
            w,
            w,
            w,
        ]
    }
}

/// Exponential `gain e^(-decay d)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExponentialWeight {
    /// Increment at contact, in the weight's own unit.
    pub gain: f64,
    /// Decay with clearance, 1/m.
    pub decay_per_m: f64,
}

impl ExponentialWeight {
    fn at(&self, clearance_m: f64) -> f64 {
        self.gain * (-self.decay_per_m * clearance_m).exp()
    }
}
impl Check for ExponentialWeight {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("gain", self.gain, 0.0, 1e7)?;
        at.range("decay_per_m", self.decay_per_m, 0.1, 1000.0)
    }
    fn describe(at: &Keys<'_>, keys: &mut BTreeMap<String, String>) {
        keys.insert(
            at.key("gain"),
            " Increment at contact, in the weight's own unit.".into(),
        );
        keys.insert(at.key("decay_per_m"), " Decay with clearance, 1/m.".into());
    }
}

/// Clearance `d` that determines the weights of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaaDistance {
    /// Current clearance, for all stages (as in the paper).
    #[default]
    Current,
    /// Clearance of the reference at each stage.
    PerStage,
}

config! {
    /// Weights that increase near the deck.
    ///
    /// Defaults: Procházka 2024, Table 4.
    #[derive(Copy)]
    pub struct Faa {
        /// Clearance that determines the weights.
        pub distance: FaaDistance = FaaDistance::Current;
        /// Roll and pitch: the paper's `f(d) = 1 + alpha / e^(beta d)`.
        pub tilt: ExponentialWeight = ExponentialWeight {
                gain: 50_000.0,
                decay_per_m: 10.0,
            }, table;
        /// Position z.
        pub vertical: ExponentialWeight = ExponentialWeight {
                gain: 10_000.0,
                decay_per_m: 20.0,
            }, table;
        /// Velocity z.
        pub vertical_velocity: ExponentialWeight = ExponentialWeight {
                gain: 3000.0,
                decay_per_m: 25.0,
            }, table;
    }
}

impl Faa {
    /// Diagonal of Q at the foot plane's clearance `d` above the deck, m; below the deck, that at contact.
    pub fn apply(&self, far: &ModelState, clearance_m: f64) -> ModelState {
        let d = clearance_m.max(0.0);
        let mut q = *far;
        q[state::DOWN] += self.vertical.at(d);
        q[state::PHI] += self.tilt.at(d);
        q[state::THETA] += self.tilt.at(d);
        q[state::V_DOWN] += self.vertical_velocity.at(d);
        q
    }
}

const _: () = assert!(STATES == 12);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faa_weights_of_table_4() {
        let (faa, far) = (Faa::default(), Weights::default().diagonal());
        assert_eq!(
            far,
            [30.0, 30.0, 40.0, 1.0, 1.0, 50.0, 1.0, 1.0, 3000.0, 1.0, 1.0, 1.0]
        );
        // The paper lists the attitude weight at these clearances: 3, 47, 339, 2490, 18395.
        for (d, expected) in [
            (1.0, 3.27),
            (0.7, 46.6),
            (0.5, 337.9),
            (0.3, 2490.4),
            (0.1, 18394.97),
        ] {
            let q = faa.apply(&far, d);
            assert!(
                (q[state::PHI] / expected - 1.0).abs() < 2e-3 && q[state::PHI] == q[state::THETA],
                "d = {d}: {}",
                q[state::PHI]
            );
        }
        let q = faa.apply(&far, -0.2);
        assert_eq!(
            (q[state::DOWN], q[state::PHI], q[state::V_DOWN]),
            (10_040.0, 50_001.0, 6000.0)
        );
        assert_eq!(
            (
                q[state::NORTH],
                q[state::PSI],
                q[state::V_NORTH],
                q[state::PHI_DOT]
            ),
            (30.0, 50.0, 1.0, 1.0)
        );
    }
}

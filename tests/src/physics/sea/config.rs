//! Which sea: the paper's three-component sea, an irregular sea by spectrum, or calm water.

use core::f64::consts::TAU;
use core::str::FromStr;

use alight_shared::config;
use alight_shared::config::{Check, Keys};
use alight_shared::geometry::GRAVITY;
use serde::{Deserialize, Serialize};

/// Most components a sea may have.
pub const MAX_COMPONENTS: usize = 64;

/// The family of seas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SeaKind {
    /// Still water.
    Calm,
    /// Three Gerstner components described by one amplitude and one period (Procházka 2024).
    #[default]
    Paper,
    /// Irregular, JONSWAP spectrum (Hasselmann 1973), directional spread cos^2s.
    Jonswap,
    /// Irregular, Pierson-Moskowitz shape with given height and peak period (JONSWAP, gamma 1).
    PiersonMoskowitz,
}

config! {
    /// A sea state.
    ///
    /// Defaults: Moderate of the paper (0.5 m, 5 s); scale and direction step: Procházka 2024.
    /// Irregular: a height and period of the same order (ours), gamma 3.3 (Hasselmann 1973), s = 10
    /// (wind sea, Goda 2000), 24 components (ours: does not repeat within a trial).
    pub struct SeaConfig {
        /// The family; the keys that another family uses have no effect.
        pub kind: SeaKind = SeaKind::Paper;
        /// Paper sea: amplitude of the middle component, m.
        pub amplitude_m: f64 = 0.5, in 0.0..=10.0;
        /// Paper sea: period of the middle component, s.
        pub period_s: f64 = 5.0, in 1.0..=30.0;
        /// Paper sea: ratio between neighbouring wavelengths and amplitudes; drawn from 1.1 to 1.5 per
        /// seed where absent.
        pub wavelength_scale: Option<f64> = None;
        /// Paper sea: angle between neighbouring components, rad.
        pub direction_step_rad: f64 = 0.4, in 0.0..=3.2;
        /// Irregular seas: significant height, m.
        pub significant_height_m: f64 = 1.0, in 0.0..=20.0;
        /// Irregular seas: period of the spectrum's peak, s.
        pub peak_period_s: f64 = 5.0, in 1.0..=30.0;
        /// JONSWAP: peak enhancement.
        pub gamma: f64 = 3.3, in 1.0..=7.0;
        /// Irregular seas: exponent s of the directional spread cos^2s((direction - mean)/2).
        pub spread: f64 = 10.0, in 1.0..=100.0;
        /// Irregular seas: number of components.
        pub components: usize = 24;
        /// Where the waves go, clockwise from north, deg; drawn per seed where absent.
        pub mean_direction_deg: Option<f64> = None;
    }
    check |this, at| {
        if this.kind == SeaKind::Paper {
            // Each of the three has k A of the middle one; the sum must stay below 1 (loop-free).
            let k = (TAU / this.period_s).powi(2) / GRAVITY;
            at.range("amplitude_m", this.amplitude_m, 0.0, 0.95 / (3.0 * k))?;
        }
        if let Some(s) = this.wavelength_scale {
            at.range("wavelength_scale", s, 1.0, 3.0)?;
        }
        at.require(
            (1..=MAX_COMPONENTS).contains(&this.components),
            "components",
            this.components,
            "1 to 64",
        )?;
        if let Some(d) = this.mean_direction_deg {
            at.range("mean_direction_deg", d, -360.0, 360.0)?;
        }
    }
}

impl SeaConfig {
    /// The paper's sea of amplitude `amplitude_m` and period `period_s`; an amplitude of zero is calm.
    pub fn paper(amplitude_m: f64, period_s: f64) -> Self {
        if amplitude_m == 0.0 {
            return SeaConfig {
                kind: SeaKind::Calm,
                ..Self::default()
            };
        }
        SeaConfig {
            kind: SeaKind::Paper,
            amplitude_m,
            period_s,
            ..Self::default()
        }
    }
    /// The levels with a name: calm, slight, moderate, rough, very-rough.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "calm" => Self::paper(0.0, 5.0),
            "slight" => Self::paper(0.3, 5.0),
            "moderate" => Self::paper(0.5, 5.0),
            "rough" => Self::paper(0.8, 5.0),
            "very-rough" => Self::paper(1.0, 6.0),
            _ => return None,
        })
    }
}

impl FromStr for SeaConfig {
    type Err = String;
    /// A level's name or `amplitude,period`, e.g. `0.5,5`.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(named) = Self::named(text) {
            return Ok(named);
        }
        let expected = || {
            format!(
                "`{text}` is no sea: give calm, slight, moderate, rough, very-rough, or amplitude (m) and \
                 period (s) as A,T, e.g. 0.5,5"
            )
        };
        let (a, t) = text.split_once(',').ok_or_else(expected)?;
        let number = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let (a, t) = (number(a).ok_or_else(expected)?, number(t).ok_or_else(expected)?);
        if a == 0.0 && t == 0.0 {
            return Ok(Self::paper(0.0, 5.0));
        }
        // Checked before `paper` so that a negative or absurd value is named, not replaced.
        let sea = SeaConfig {
            amplitude_m: a,
            period_s: t,
            ..Self::default()
        };
        sea.check(&Keys::ROOT.table("sea")).map_err(|e| e.to_string())?;
        Ok(Self::paper(a, t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sea_argument_accepts_names_and_pairs_and_rejects_the_rest_with_a_hint() {
        let rough: SeaConfig = "rough".parse().unwrap();
        assert_eq!((rough.amplitude_m, rough.period_s), (0.8, 5.0));
        assert_eq!("0.8,5".parse::<SeaConfig>().unwrap(), rough);
        assert_eq!("0,0".parse::<SeaConfig>().unwrap().kind, SeaKind::Calm);
        for bad in [
            "", "stormy", "1", "1,2,3", "nan,5", "-1,5", "1,0", "0.5,inf", "3,3",
        ] {
            let e = bad.parse::<SeaConfig>().unwrap_err();
            assert!(e.contains("A,T") || e.contains("sea."), "{bad}: {e}");
        }
    }

    #[test]
    fn sea_default_survives_toml() {
        let text = toml::to_string(&SeaConfig::default()).unwrap();
        let back: SeaConfig = alight_shared::config::parse(&text, "test").unwrap();
        assert_eq!(back, SeaConfig::default());
        assert!(alight_shared::config::parse::<SeaConfig>("height = 1", "test").is_err());
    }
}

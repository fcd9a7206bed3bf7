//! Kinds of sea: the paper's three components, irregular with a spectrum, or calm.

use core::{f64::consts::TAU, str::FromStr};

use alight_shared::{
    config,
    config::{Check, Keys},
    geometry::GRAVITY,
};
use serde::{Deserialize, Serialize};

pub const MAX_COMPONENTS: usize = 64;
pub const MAX_SYSTEMS: usize = 4;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SeaKind {
    Calm,
    /// Three Gerstner components defined by one amplitude and one period (Procházka 2024).
    #[default]
    Paper,
    /// Irregular: JONSWAP spectrum (Hasselmann 1973), directional spread cos^2s.
    Jonswap,
    /// Pierson-Moskowitz spectrum (JONSWAP with gamma 1) with a given height and peak period.
    PiersonMoskowitz,
    Systems,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spectrum {
    /// Wind sea (Hasselmann 1973).
    #[default]
    Jonswap,
    /// Fully developed sea (Pierson and Moskowitz 1964).
    PiersonMoskowitz,
}

config! {
    /// One of several wave systems, such as a wind sea or a swell.
    ///
    /// Defaults: those of [`SeaConfig`].
    pub struct WaveSystem {
        /// Shape of the system's spectrum.
        pub spectrum: Spectrum = Spectrum::Jonswap;
        /// Significant height, m.
        pub significant_height_m: f64 = 1.0, in 0.0..=20.0;
        /// Period of the spectrum's peak, s.
        pub peak_period_s: f64 = 5.0, in 1.0..=30.0;
        /// JONSWAP: peak enhancement.
        pub gamma: f64 = 3.3, in 1.0..=7.0;
        /// Exponent s of the directional spread cos^2s((direction - mean)/2).
        pub spread: f64 = 10.0, in 1.0..=100.0;
        /// Direction in which the waves travel, clockwise from the sea's mean direction, deg.
        pub from_mean_deg: f64 = 0.0, in -360.0..=360.0;
    }
}

impl WaveSystem {
    /// Peak enhancement; 1 for Pierson-Moskowitz.
    pub fn enhancement(&self) -> f64 {
        match self.spectrum {
            Spectrum::Jonswap => self.gamma,
            Spectrum::PiersonMoskowitz => 1.0,
        }
    }
}

config! {
    /// A sea state.
    ///
    /// Defaults: Moderate of the paper (0.5 m, 5 s); scale and direction step: Procházka 2024. Irregular
    /// seas: height and period of the same order (chosen), gamma 3.3 (Hasselmann 1973), s = 10 (wind sea,
    /// Goda 2000), 24 components (chosen so that the sea does not repeat within a trial).
    pub struct SeaConfig {
        /// Kind of sea; keys of other kinds have no effect.
        pub kind: SeaKind = SeaKind::Paper;
        /// Paper sea: amplitude of the middle component, m.
        pub amplitude_m: f64 = 0.5, in 0.0..=10.0;
        /// Paper sea: period of the middle component, s.
        pub period_s: f64 = 5.0, in 1.0..=30.0;
        /// Paper sea: ratio between neighbouring wavelengths and amplitudes; drawn from 1.1 to 1.5 per seed if missing.
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
        /// Direction in which the waves travel, clockwise from north, deg; drawn per seed if missing.
        pub mean_direction_deg: Option<f64> = None;
        /// Wave systems of the kind `systems`, with `components` components each.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub systems: Vec<WaveSystem> = Vec::new();
    }
    check |this, at| {
        if this.kind == SeaKind::Paper {
            // Each component has the steepness k A of the middle one; at a sum of 1 the surface loops.
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
        at.require(
            this.systems.len() <= MAX_SYSTEMS && this.systems.is_empty() == (this.kind != SeaKind::Systems),
            "systems",
            this.systems.len(),
            "1 to 4 for the kind systems, none for the others",
        )?;
        for system in &this.systems {
            system.check(&at.table("systems"))?;
        }
    }
}

impl SeaConfig {
    /// The paper's sea; calm water if the amplitude is zero.
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
    pub fn of_systems(systems: Vec<WaveSystem>) -> Self {
        SeaConfig {
            kind: SeaKind::Systems,
            systems,
            ..Self::default()
        }
    }
    pub fn jonswap(significant_height_m: f64, peak_period_s: f64) -> Self {
        Self::of_systems(vec![WaveSystem {
            significant_height_m,
            peak_period_s,
            ..WaveSystem::default()
        }])
    }
    /// Sea state 1 to 5: a fully developed sea with the middle significant height of its class in WMO code
    /// table 3700 (0 to 0.1, 0.1 to 0.5, 0.5 to 1.25, 1.25 to 2.5, 2.5 to 4 m) and the peak period `2 pi /
    /// (0.4 sqrt(g / Hs))` (Pierson and Moskowitz 1964, as in Fossen 2011, section 8.2.1).
    pub fn of_sea_state(state: u8) -> Option<Self> {
        let height = *[0.05, 0.3, 0.875, 1.875, 3.25].get(usize::from(state).checked_sub(1)?)?;
        Some(Self::of_systems(vec![WaveSystem {
            spectrum: Spectrum::PiersonMoskowitz,
            significant_height_m: height,
            peak_period_s: TAU / (0.4 * (GRAVITY / height).sqrt()),
            ..WaveSystem::default()
        }]))
    }
    /// Empty for calm water and the paper's sea.
    pub fn wave_systems(&self) -> Vec<WaveSystem> {
        let one = |spectrum| WaveSystem {
            spectrum,
            significant_height_m: self.significant_height_m,
            peak_period_s: self.peak_period_s,
            gamma: self.gamma,
            spread: self.spread,
            from_mean_deg: 0.0,
        };
        match self.kind {
            SeaKind::Calm | SeaKind::Paper => Vec::new(),
            SeaKind::Jonswap => vec![one(Spectrum::Jonswap)],
            SeaKind::PiersonMoskowitz => vec![one(Spectrum::PiersonMoskowitz)],
            SeaKind::Systems => self.systems.clone(),
        }
    }
    /// Significant height, m: four standard deviations of the elevation.
    pub fn significant_height(&self) -> f64 {
        let height = |s: &WaveSystem| s.significant_height_m * s.significant_height_m;
        match self.kind {
            SeaKind::Calm => 0.0,
            SeaKind::Paper => {
                // The mean of the distribution replaces a drawn scale.
                let s = self.wavelength_scale.unwrap_or(1.3);
                4.0 * self.amplitude_m * (0.5 * (1.0 + s * s + 1.0 / (s * s))).sqrt()
            }
            SeaKind::Jonswap | SeaKind::PiersonMoskowitz | SeaKind::Systems => {
                self.wave_systems().iter().map(height).sum::<f64>().sqrt()
            }
        }
    }
    /// Wind U10 that causes a fully developed sea, m/s: `sqrt(Hs g² / 2.06)` at 19.4 m (Fossen 2011, eq.
    /// 8.77) times `(10/19.4)^(1/7)`.
    pub fn wind_of_height(significant_height_m: f64) -> f64 {
        (significant_height_m * GRAVITY * GRAVITY / 2.06).sqrt() * (10.0_f64 / 19.4).powf(1.0 / 7.0)
    }
    /// `name` is calm, slight, moderate, rough or very-rough.
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
    /// Parses a level's name or `amplitude,period`, e.g. `0.5,5`.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(named) = Self::named(text) {
            return Ok(named);
        }
        let expected = || {
            format!(
                "`{text}` is no sea: give calm, slight, moderate, rough, very-rough, or amplitude (m) and \
                 period (s) as A,T, e.g. 0.5,5, or wave systems by significant height and peak period as \
                 jonswap:HS,TP or pm:HS,TP, joined by +, with their direction from the mean (deg) behind \
                 an @, e.g. jonswap:0.8,4.5+jonswap:1,8@60"
            )
        };
        if text.contains(':') {
            let systems: Option<Vec<WaveSystem>> = text.split('+').map(wave_system).collect();
            let sea = SeaConfig::of_systems(systems.ok_or_else(expected)?);
            sea.check(&Keys::ROOT.table("sea")).map_err(|e| e.to_string())?;
            return Ok(sea);
        }
        let (a, t) = text.split_once(',').ok_or_else(expected)?;
        let number = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let a = number(a).ok_or_else(expected)?;
        let t = number(t).ok_or_else(expected)?;
        if a == 0.0 && t == 0.0 {
            return Ok(Self::paper(0.0, 5.0));
        }
        // Checked before `paper`, so that the error names a negative or implausible value.
        let sea = SeaConfig {
            amplitude_m: a,
            period_s: t,
            ..Self::default()
        };
        sea.check(&Keys::ROOT.table("sea")).map_err(|e| e.to_string())?;
        Ok(Self::paper(a, t))
    }
}

/// Parses `jonswap:HS,TP@DEG`; without `@DEG` the system has the mean direction.
fn wave_system(text: &str) -> Option<WaveSystem> {
    let number = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let (spectrum, rest) = text.split_once(':')?;
    let (size, direction) = rest.split_once('@').unwrap_or((rest, "0"));
    let (height, period) = size.split_once(',')?;
    Some(WaveSystem {
        spectrum: match spectrum.trim() {
            "jonswap" | "js" => Spectrum::Jonswap,
            "pm" | "pierson-moskowitz" => Spectrum::PiersonMoskowitz,
            _ => return None,
        },
        significant_height_m: number(height)?,
        peak_period_s: number(period)?,
        from_mean_deg: number(direction)?,
        ..WaveSystem::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sea_argument_with_wave_systems() {
        let sea: SeaConfig = "jonswap:0.8,4.5+pm:1,8@60".parse().unwrap();
        let [wind, swell] = &sea.systems[..] else {
            panic!("two systems");
        };
        assert_eq!((wind.significant_height_m, wind.peak_period_s), (0.8, 4.5));
        assert_eq!(
            (swell.spectrum, swell.from_mean_deg),
            (Spectrum::PiersonMoskowitz, 60.0)
        );
        let text = toml::to_string(&sea).unwrap();
        assert_eq!(
            alight_shared::config::parse::<SeaConfig>(&text, "test").unwrap(),
            sea
        );
        for bad in [
            "jonswap:1",
            "js:1,2,3",
            "sea:1,5",
            "jonswap:1,5+",
            "pm:-1,5",
            "pm:1,0.1",
            "js:1,5@x",
        ] {
            assert!(bad.parse::<SeaConfig>().is_err(), "{bad}");
        }
    }

    #[test]
    fn sea_state_heights_and_winds() {
        let limits = [0.0, 0.1, 0.5, 1.25, 2.5, 4.0];
        // Sustained wind of the sea state, kn, at 19.5 m (Bales 1983, STANAG 4194).
        let wind_kn = [3.0, 8.5, 13.5, 19.0, 24.5];
        for state in 1..=5_u8 {
            let sea = SeaConfig::of_sea_state(state).unwrap();
            assert!(sea.check(&Keys::ROOT).is_ok());
            let height = sea.systems[0].significant_height_m;
            let n = usize::from(state);
            assert!((limits[n - 1]..limits[n]).contains(&height), "{state}: {height}");
            let wind = SeaConfig::wind_of_height(height) / (10.0_f64 / 19.4).powf(1.0 / 7.0);
            assert!((wind - wind_kn[n - 1] * 0.5144).abs() < 0.8, "{state}: {wind}");
        }
        assert!(SeaConfig::of_sea_state(0).is_none() && SeaConfig::of_sea_state(6).is_none());
    }

    #[test]
    fn sea_argument_names_pairs_and_rejection() {
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
}

//! The belly camera at night: exposure, brightness of scene, lit tags and a lamp in a pixel, and noise.
//!
//! Light is expressed in lux on a white surface: a surface of luminance `L` looks like a white surface under
//! `π L` lux. For a pixel with exposure `t` and gain `g`:
//!
//! ```text
//! electrons = s E t        grey = 255 g electrons / well        sd² = dark² + (255 g / well)² (read² + electrons)
//! ```
//!
//! A lamp scatters light in the lens as in an eye. The veil has the luminance `10 E / θ²` (Stiles and
//! Holladay; CIE 146), where `E` is the illuminance at the lens, lux, and `θ` the angle from the lamp, deg,
//! at least 1. Lit tags scatter in the same way.
//!
//! Rendered images and the measurement model of the tags ([`super::tag`]) share only this module. The model's
//! probabilities and noise are fitted to the drone's detector on rendered images.

use alight_shared::config;
use alight_uav::camera::metering::Setting;
use core::f64::consts::PI;

config! {
    /// Light, and the belly camera's response to it.
    #[derive(Copy)]
    pub struct NightConfig {
        /// Illuminance of deck and sea, lux: overcast noon 10 000, sunset 400, a lit quay 20, end of civil twilight 3,
        /// full moon 0.2, stars 0.001.
        pub ambient_lux: f64 = 0.2, in 0.0..=2e5;
        /// Luminance of the white of lit tags, cd/m²; 0: printed tags.
        /// Chosen: LED panels behind film have 50 to 1000.
        pub tags_cdpm2: f64 = 0.0, in 0.0..=1e5;
        /// Luminous intensity of a lamp on the deck in the direction of the drone, cd; 0: no lamp. A 10 W
        /// floodlight has 150 cd, a 100 W searchlight 10 000 cd.
        pub lamp_cd: f64 = 0.0, in 0.0..=1e6;
        /// Position of the lamp relative to the deck's centre: forward, right, down, m.
        pub lamp_m: [f64; 3] = [-1.5, 0.0, -0.5], in -50.0..=50.0;
        /// Fraction of the light from scene and lamp that passes the camera's filter; light from lit tags
        /// passes completely.
        /// Source: an infra-red filter below 850 nm passes a hundredth of the light of white LEDs and almost
        /// none of moonlight.
        pub filter: f64 = 1.0, in 0.0..=1.0;
        /// Electrons in a pixel per lux on a white surface and second of exposure.
        /// Source: `T ρ/(4 N²)` of the scene's illuminance reaches the sensor, 0.027 at f/2.8 and T 0.9; a
        /// pixel of 3 µm collects 22 000 electrons per lux and second at a quantum efficiency of 0.6.
        pub electrons: f64 = 600.0, in 0.1..=1e6;
        /// Electrons at grey level 255 and a gain of 1.
        /// Source: `render.shot` by day, a variance of 0.05 grey levels per grey level.
        pub well: f64 = 5100.0, in 100.0..=1e6;
        /// Read noise of a pixel (standard deviation), electrons.
        /// Source: data sheets of CMOS sensors, 2 to 6.
        pub read: f64 = 4.0, in 0.0..=200.0;
        /// Maximum gain, relative to the gain 1 of `well`.
        /// Source: 24 dB, a typical analogue range.
        pub max_gain: f64 = 16.0, in 1.0..=1e3;
    }
}

/// Reflectance of a tag's white and black, relative to a white surface.
pub(super) const TAG: [f64; 2] = [0.95, 0.06];
const LAMP_M: f64 = 0.06;
/// Coefficient of the veil, cd/m² deg² per lux, and its minimum angle, deg.
const VEIL: f64 = 10.0;
const MIN_VEIL_DEG: f64 = 1.0;
const MIN_EXPOSURE_S: f64 = 1e-4;
/// Grey level of a tag's white at which metering aims.
const AIM: f64 = 180.0;

/// Veil of a source at the angle `angle` (rad), lux on white per lux at the lens.
pub(super) fn veil(angle: f64) -> f64 {
    PI * VEIL / angle.to_degrees().max(MIN_VEIL_DEG).powi(2)
}

impl NightConfig {
    /// Light of the scene after the filter, lux.
    pub(super) fn scene_lux(&self) -> f64 {
        self.ambient_lux * self.filter
    }
    /// Light from a tag's white and black areas, lux on white.
    pub(super) fn tag_lux(&self) -> [f64; 2] {
        let [white, black] = TAG.map(|reflectance| reflectance * self.scene_lux());
        [white + PI * self.tags_cdpm2, black]
    }
    /// Illuminance by the lamp at a lens `distance_m` away, after the filter, lux.
    pub(super) fn lamp_lux(&self, distance_m: f64) -> f64 {
        self.lamp_cd * self.filter / distance_m.max(LAMP_M).powi(2)
    }
    /// Brightness of the lamp's surface, lux on white, and its diameter, m.
    pub(super) fn lamp_surface(&self) -> (f64, f64) {
        let area = 0.25 * PI * LAMP_M * LAMP_M;
        (PI * self.lamp_cd * self.filter / area, LAMP_M)
    }
    fn step(&self, gain: f64) -> f64 {
        255.0 * gain / self.well
    }
    /// Grey levels per lux on white.
    pub(super) fn grey_per_lux(&self, setting: &Setting) -> f64 {
        self.electrons * setting.exposure_s * self.step(setting.gain)
    }
    /// Standard deviation of a pixel at this grey level and gain, grey levels; `dark` is added as root sum of squares.
    pub(super) fn noise(&self, grey: f64, gain: f64, dark: f64) -> f64 {
        let step = self.step(gain);
        (dark * dark + step * step * self.read * self.read + step * grey.max(0.0)).sqrt()
    }
    /// Setting to which metering converges for a white under `white_lux`: longer exposure up to
    /// `max_exposure_s`, then more gain.
    pub fn auto_exposure(&self, white_lux: f64, max_exposure_s: f64) -> Setting {
        let exposure_s = |gain: f64| AIM / (self.electrons * self.step(gain) * white_lux.max(1e-9));
        Setting {
            exposure_s: exposure_s(1.0).clamp(MIN_EXPOSURE_S.min(max_exposure_s), max_exposure_s),
            gain: (exposure_s(1.0) / max_exposure_s).clamp(1.0, self.max_gain),
        }
    }
    pub(super) fn at_limit(&self, setting: &Setting, max_exposure_s: f64) -> bool {
        setting.exposure_s >= max_exposure_s && setting.gain >= self.max_gain
    }
    pub fn ranges(&self, max_exposure_s: f64) -> [alight_uav::camera::metering::SettingRange; 2] {
        let range = |low, most, step| alight_uav::camera::metering::SettingRange { low, most, step };
        let min_s = MIN_EXPOSURE_S.min(max_exposure_s);
        [
            range(min_s, max_exposure_s, 0.1 * min_s),
            range(1.0, self.max_gain, (self.max_gain - 1.0).max(1e-3) / 256.0),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAX_EXPOSURE_S: f64 = 0.004;

    #[test]
    fn exposure_before_gain_up_to_both_limits() {
        let night = NightConfig::default();
        // A white of 180 grey levels corresponds to 3600 electrons.
        let grey = |lux: f64| lux * night.grey_per_lux(&night.auto_exposure(lux, MAX_EXPOSURE_S));
        for lux in [2e3, 1e4, 5e4] {
            let s = night.auto_exposure(lux, MAX_EXPOSURE_S);
            assert_eq!(s.gain, 1.0);
            assert!((s.exposure_s - 6.0 / lux).abs() < 1e-9 && (grey(lux) - 180.0).abs() < 1e-6);
        }
        let s = night.auto_exposure(300.0, MAX_EXPOSURE_S);
        assert!((s.exposure_s, s.gain) == (MAX_EXPOSURE_S, 5.0) && (grey(300.0) - 180.0).abs() < 1e-6);
        // The gain reaches 24 dB at 94 lux; a tenth of that light gives a tenth of the level.
        let s = night.auto_exposure(9.4, MAX_EXPOSURE_S);
        assert!(
            night.at_limit(&s, MAX_EXPOSURE_S) && (grey(9.4) - 18.0).abs() < 0.1,
            "{s:?}"
        );
    }

    #[test]
    fn noise_of_photons_and_reading() {
        let night = NightConfig::default();
        // Variance of 0.05 per grey level, as in an image by day.
        assert!((night.noise(200.0, 1.0, 2.0).powi(2) - 14.04).abs() < 1e-9);
        // At 24 dB one electron corresponds to 0.8 grey levels.
        assert!((night.noise(0.0, 16.0, 0.0) - 3.2).abs() < 1e-9);
        assert!((night.noise(160.0, 16.0, 0.0) - (10.24 + 128.0_f64).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn veil_of_a_lamp() {
        // 1 lux at the lens at 10 deg gives a veil of 0.1 cd/m².
        assert!((veil(10.0_f64.to_radians()) - 0.1 * PI).abs() < 1e-9);
        assert_eq!(veil(0.0), veil(1.0_f64.to_radians()));
        let night = NightConfig {
            lamp_cd: 100.0,
            filter: 0.1,
            ..NightConfig::default()
        };
        assert!((night.lamp_lux(5.0) - 0.4).abs() < 1e-12);
    }
}

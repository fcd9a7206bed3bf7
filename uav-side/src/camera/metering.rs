//! Control of exposure and gain by the tag's white: adjusts in stops (factors of two) towards a white of 180 grey
//! levels.
//!
//! A sensor's signal is proportional to the exposure, so only the exposure is adjusted, up to the maximum that motion
//! blur permits. The gain, whose scale depends on the device (linear, dB), changes by fractions of its range: up if the
//! maximum exposure is too dark, down if the exposure is short, because gain adds noise.
//!
//! Without a detected tag the image's mean is metered. A dark image with clipped parts shows either overexposed lit
//! tags at night, or a lamp or glint next to a dark deck. Metering alternates between these two cases; each turn starts
//! from the setting with which the same case last ended.

use serde::{Deserialize, Serialize};

use super::light::{ImageLight, TagLight};

/// Target of the tag's white, grey levels: black is then 10 to 20, and a third more light does not clip.
const WHITE: f64 = 180.0;
/// Tolerated deviation from the target, stops: 150 to 216 grey levels.
const WHITE_BAND: f64 = 0.26;
/// White level above which the light is unknown and assumed to be too bright by a factor of two, grey levels.
const CLIPPED: f64 = 250.0;
/// Target of the mean of an image without a tag, grey levels. If a deck fills the image, its white is then at least 60;
/// over dark water the tag's black stays below 120.
const MEAN: f64 = 60.0;
/// Tolerated deviation from that target, stops.
const MEAN_BAND: f64 = 0.5;
/// Number of images without the tag after which the image's mean is metered, because single detections can fail.
const UNDETECTED: u32 = 5;
/// Length of a turn, images, when mean and brightest part call for opposite changes: enough for ten changes.
const TURN: u32 = 60;
/// Maximum number of images until a change takes effect.
const SETTLING: u64 = 3;
const MAX_STEP: f64 = 2.0;
/// Change of the gain per missing stop (at most one), as a fraction of its range. A linear gain up to 100 overshoots by
/// less than [`SHORT`]; a gain of 48 dB changes by half a stop.
const GAIN_STEP: f64 = 1.0 / 16.0;
/// Decrease of the gain when the exposure is short, as a fraction of its range: 0.75 dB of 48 dB.
const GAIN_FALL: f64 = 1.0 / 64.0;
/// Fraction of the maximum exposure below which the exposure counts as short.
const SHORT: f64 = 0.25;

/// Values that a device accepts: `low + k step`, up to `most`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingRange {
    pub low: f64,
    pub most: f64,
    /// Difference between neighbouring values, above 0.
    pub step: f64,
}

impl SettingRange {
    pub fn nearest(&self, value: f64) -> f64 {
        let steps = |v: f64| (v - self.low) / self.step;
        // Tolerance for the remainder of the division into steps.
        let most = (steps(self.most) + 1e-6).floor().max(0.0);
        self.low + self.step * steps(value).round().clamp(0.0, most)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    pub exposure_s: f64,
    /// In the device's unit.
    pub gain: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    Tag(TagLight),
    Image(ImageLight),
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exposed {
    pub setting: Setting,
    /// Whether exposure and gain are both at their maximum.
    pub at_limit: bool,
}

#[derive(Clone, Debug)]
pub struct Metering {
    exposure_s: SettingRange,
    gain: SettingRange,
    setting: Setting,
    /// Number of the newest image when the setting last changed.
    set_at: u64,
    undetected: u32,
    /// Whether the image was too dark and partly clipped when its mean was last metered.
    contradicted: bool,
    /// Whether the brightest part of the image is metered instead of its mean.
    by_brightest: bool,
    /// Last setting of the other turn, in which the tag or the brightest part was metered.
    other: Setting,
}

impl Metering {
    /// Starts at the accepted values nearest to `setting`. The range `exposure_s` must end at the maximum permitted
    /// exposure.
    pub fn new(exposure_s: SettingRange, gain: SettingRange, setting: Setting) -> Metering {
        let setting = Setting {
            exposure_s: exposure_s.nearest(setting.exposure_s),
            gain: gain.nearest(setting.gain),
        };
        Metering {
            exposure_s,
            gain,
            setting,
            set_at: 0,
            undetected: 0,
            contradicted: false,
            by_brightest: false,
            other: setting,
        }
    }
    pub fn setting(&self) -> Setting {
        self.setting
    }
    pub fn at_limit(&self) -> bool {
        let most = |range: &SettingRange| range.nearest(range.most);
        self.setting.exposure_s >= most(&self.exposure_s) && self.setting.gain >= most(&self.gain)
    }
    /// Next setting, if it changes, for the light of image number `image`, when the device's newest image is number
    /// `newest`. Images that may have been taken with the previous setting are not metered.
    pub fn step(&mut self, image: u64, newest: u64, light: &Light) -> Option<Setting> {
        let next = if self.takes_turn(light) {
            core::mem::replace(&mut self.other, self.setting)
        } else if image <= self.set_at + SETTLING {
            return None;
        } else {
            let stops = self.missing_stops(light)?;
            self.next(stops)
        };
        if next == self.setting {
            return None;
        }
        self.setting = next;
        self.set_at = newest;
        Some(next)
    }
    /// Counts images without the tag. Returns whether the other turn begins.
    fn takes_turn(&mut self, light: &Light) -> bool {
        match light {
            Light::Tag(_) => {
                (self.undetected, self.by_brightest, self.contradicted) = (0, false, false);
                self.other = self.setting;
                false
            }
            Light::Image(_) => {
                self.undetected = self.undetected.saturating_add(1);
                let ends = self.contradicted && self.undetected.is_multiple_of(TURN);
                self.by_brightest ^= ends;
                ends
            }
        }
    }
    /// Missing light in stops: negative if too bright, zero within the tolerance, None if there is nothing to meter.
    fn missing_stops(&mut self, light: &Light) -> Option<f64> {
        let (level, goal, band) = match light {
            Light::Tag(tag) => (f64::from(tag.white), WHITE, WHITE_BAND),
            Light::Image(_) if self.undetected <= UNDETECTED => return None,
            Light::Image(image) if self.by_brightest => (image.brightest, WHITE, WHITE_BAND),
            Light::Image(image) => {
                self.contradicted =
                    image.brightest >= CLIPPED && (MEAN / image.mean.max(1.0)).log2() >= MEAN_BAND;
                (image.mean, MEAN, MEAN_BAND)
            }
        };
        let stops = if level >= CLIPPED {
            -(level / goal).log2().max(1.0)
        } else {
            (goal / level.max(1.0)).log2()
        };
        Some(if stops.abs() < band {
            0.0
        } else {
            stops.clamp(-MAX_STEP, MAX_STEP)
        })
    }
    fn next(&self, stops: f64) -> Setting {
        let (now, exposure) = (self.setting, self.exposure_s);
        let [min_s, max_s] = [exposure.low, exposure.most].map(|e| exposure.nearest(e));
        let wanted_s = now.exposure_s * stops.exp2();
        // Rounding with a dead band prevents an oscillation of half a step.
        let steps = (wanted_s - now.exposure_s) / exposure.step;
        let moved_s = exposure.step * (steps.abs() + 0.4).floor().copysign(steps);
        let exposure_s = exposure.nearest(now.exposure_s + moved_s);
        let by = |part: f64| {
            let range = self.gain.most - self.gain.low;
            (part * range).abs().max(self.gain.step).copysign(part)
        };
        let more = if stops > 0.0 && wanted_s > max_s {
            by(GAIN_STEP * (wanted_s / max_s).log2().min(1.0))
        } else if stops < 0.0 && wanted_s < min_s {
            by(-GAIN_STEP * (min_s / wanted_s).log2().min(1.0))
        } else if exposure_s == now.exposure_s && exposure_s < SHORT * max_s {
            by(-GAIN_FALL)
        } else {
            0.0
        };
        Setting {
            exposure_s,
            gain: self.gain.nearest(now.gain + more),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    const MAX_EXPOSURE_S: f64 = 0.004;
    const CONVERGED: u64 = 240;

    #[derive(Clone, Copy, Debug)]
    enum Scale {
        Linear,
        TenthDecibel,
    }

    /// Linear 8-bit sensor whose settings take effect after `latency` images and which is metered `queue` images late.
    struct Sensor {
        metering: Metering,
        scale: Scale,
        latency: u64,
        queue: u64,
        /// Settings, each with the first image that may use it.
        pending: VecDeque<(u64, Setting)>,
        shown: Setting,
        images: VecDeque<(u64, Light)>,
        image: u64,
        changes: u64,
    }

    impl Sensor {
        fn new(scale: Scale, latency: u64, queue: u64, step_s: f64, start: Setting) -> Sensor {
            let exposure = SettingRange {
                low: step_s,
                most: MAX_EXPOSURE_S,
                step: step_s,
            };
            let gain = match scale {
                Scale::Linear => SettingRange {
                    low: 1.0,
                    most: 64.0,
                    step: 1.0,
                },
                Scale::TenthDecibel => SettingRange {
                    low: 0.0,
                    most: 480.0,
                    step: 1.0,
                },
            };
            let metering = Metering::new(exposure, gain, start);
            let shown = metering.setting();
            Sensor {
                metering,
                scale,
                latency,
                queue,
                pending: VecDeque::new(),
                shown,
                images: VecDeque::new(),
                image: 0,
                changes: 0,
            }
        }
        /// White level without clipping, grey levels; a `light` of 1 gives 255 at 1 s with a gain of 1.
        fn white(&self, light: f64, setting: Setting) -> f64 {
            let gain = match self.scale {
                Scale::Linear => setting.gain,
                Scale::TenthDecibel => 10_f64.powf(setting.gain / 200.0),
            };
            255.0 * light * setting.exposure_s * gain
        }
        /// Takes one image; the water around the tag has a tenth of the tag's light. Returns the tag's white.
        fn take(&mut self, light: f64) -> f64 {
            self.image += 1;
            while let Some((from, setting)) = self.pending.front().copied()
                && from <= self.image
            {
                self.shown = setting;
                self.pending.pop_front();
            }
            let white = self.white(light, self.shown);
            let level = |fraction: f64| (fraction * white).round().clamp(0.0, 255.0) as u8;
            let tag = TagLight {
                black: level(0.063),
                white: level(1.0),
                saturation: 0.0,
            };
            let detected = tag.contrast() > 40.0 / 255.0;
            let water = f64::from(level(0.1));
            self.images.push_back((
                self.image,
                if detected {
                    Light::Tag(tag)
                } else {
                    Light::Image(ImageLight {
                        mean: water,
                        brightest: f64::from(tag.white),
                        ..ImageLight::default()
                    })
                },
            ));
            while self.images.len() as u64 > self.queue {
                let Some((number, light)) = self.images.pop_front() else {
                    break;
                };
                if let Some(setting) = self.metering.step(number, self.image, &light) {
                    assert!(setting.exposure_s <= MAX_EXPOSURE_S + 1e-12, "{setting:?}");
                    self.changes += 1;
                    self.pending.push_back((self.image + self.latency + 1, setting));
                }
            }
            white
        }
        /// Final white level after many images in constant light, and number of setting changes during the last of
        /// them.
        fn converge(&mut self, light: f64) -> (f64, u64) {
            for _ in 0..CONVERGED {
                self.take(light);
            }
            for _ in 0..4 * CONVERGED {
                self.take(light);
            }
            let before = self.changes;
            let white = (0..CONVERGED).map(|_| self.take(light)).last().unwrap_or(0.0);
            (white, self.changes - before)
        }
    }

    fn scales() -> impl Strategy<Value = Scale> {
        prop_oneof![Just(Scale::Linear), Just(Scale::TenthDecibel)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn metering_over_six_decades(
            scale in scales(), latency in 1_u64..=3, queue in 0_u64..=3,
            decades in 0.0..6.0_f64, exposure_s in 0.0..0.02_f64, gain in -10.0..500.0_f64,
        ) {
            // The faintest light needs the maximum exposure and gain, the brightest an exposure of 0.2 us.
            let light = 3.0 * 10_f64.powf(decades);
            let start = Setting { exposure_s, gain };
            let mut sensor = Sensor::new(scale, latency, queue, 2e-8, start);
            for _ in 0..CONVERGED {
                sensor.take(light);
            }
            // A small linear gain changes by a factor of two per step, so the accepted whites span one stop.
            let whites: Vec<f64> = (0..60).map(|_| sensor.take(light)).collect();
            let good = whites.iter().filter(|w| (110.0..225.0).contains(*w)).count();
            let Setting { exposure_s, gain } = sensor.metering.setting();
            let most = exposure_s > 0.99 * MAX_EXPOSURE_S && gain > 63.0 && whites[59] < 150.0;
            prop_assert!(good >= 45 || most, "{whites:?} at {exposure_s} s, gain {gain}");
        }
        #[test]
        fn metering_with_any_latency(
            scale in scales(), latency in 1_u64..=3, queue in 0_u64..=3,
            decades in 1.0..4.0_f64, gain in 0.0..500.0_f64,
        ) {
            let start = Setting { exposure_s: 0.001, gain };
            let mut sensor = Sensor::new(scale, latency, queue, 1e-4, start);
            let (white, changes) = sensor.converge(3.0 * 10_f64.powf(decades));
            prop_assert_eq!(changes, 0, "white {}", white);
        }
    }

    #[test]
    fn metering_in_sudden_shade_and_glare() {
        for (scale, latency) in [(Scale::Linear, 1), (Scale::Linear, 3), (Scale::TenthDecibel, 2)] {
            for factor in [1.0 / 30.0, 0.1, 0.5, 2.0, 10.0, 30.0_f64] {
                let start = Setting {
                    exposure_s: 0.001,
                    gain: 0.0,
                };
                let mut sensor = Sensor::new(scale, latency, 1, 1e-5, start);
                sensor.converge(1000.0);
                // Two seconds at 30 Hz.
                let whites: Vec<f64> = (0..60).map(|_| sensor.take(1000.0 * factor)).collect();
                assert!((140.0..225.0).contains(&whites[59]), "{factor}: {whites:?}");
                // The deviation never exceeds its initial value.
                let off = 1.5 * factor.max(1.0 / factor);
                let within = 180.0 / off..180.0 * off;
                assert!(whites.iter().all(|w| within.contains(w)), "{factor}: {whites:?}");
            }
        }
    }

    fn from_a_millisecond() -> Metering {
        let range = |most| SettingRange {
            low: 0.0001,
            most,
            step: 0.0001,
        };
        let start = Setting {
            exposure_s: 0.001,
            gain: 1.0,
        };
        Metering::new(range(MAX_EXPOSURE_S), range(8.0), start)
    }

    /// Whether lit tags in the dark are decoded in each image, and the number of images with the setting at its limits.
    /// The tags fill a hundredth of the image; overexposed tags are not decoded.
    fn night(scale: Scale, light: f64, lamp: bool) -> (Vec<bool>, usize) {
        let start = Setting {
            exposure_s: MAX_EXPOSURE_S,
            gain: 0.0,
        };
        let mut sensor = Sensor::new(scale, 2, 1, 1e-4, start);
        let mut at_limit = 0;
        let detected = (1..=8 * u64::from(TURN)).map(|number| {
            let white = sensor.white(light, sensor.metering.setting());
            // At four times the clipping level, the lens scatters enough light to brighten the black cells.
            let decoded = (40.0..1020.0).contains(&white);
            let level = white.min(255.0);
            let detected = if decoded {
                Light::Tag(TagLight {
                    white: level as u8,
                    ..TagLight::default()
                })
            } else {
                Light::Image(ImageLight {
                    mean: 2.0 + 0.01 * level,
                    brightest: if lamp { 255.0 } else { level },
                    ..ImageLight::default()
                })
            };
            sensor.metering.step(number, number, &detected);
            at_limit += usize::from(sensor.metering.at_limit());
            decoded
        });
        (detected.collect(), at_limit)
    }

    #[test]
    fn metering_on_lit_tags_in_the_dark() {
        for scale in [Scale::Linear, Scale::TenthDecibel] {
            for light in [30.0, 300.0, 3e3, 1e4, 3e4] {
                for lamp in [false, true] {
                    let (detected, _) = night(scale, light, lamp);
                    let from = 4 * TURN as usize;
                    assert!(detected[from..].iter().all(|s| *s), "{scale:?} {light} {lamp}");
                }
            }
        }
    }

    #[test]
    fn metering_at_its_limit_in_the_dark() {
        // Without bright parts the setting stays at the limit; with a lamp the search for hidden tags begins.
        let (detected, at_limit) = night(Scale::Linear, 0.01, false);
        assert!(
            !detected.contains(&true) && at_limit > detected.len() * 2 / 3,
            "{at_limit}"
        );
        let (_, at_limit) = night(Scale::Linear, 0.01, true);
        assert!(
            (detected.len() / 8..detected.len() * 7 / 8).contains(&at_limit),
            "{at_limit}"
        );
    }

    #[test]
    fn metering_with_images_of_the_former_setting() {
        let mut metering = from_a_millisecond();
        let dark = Light::Tag(TagLight {
            white: 90,
            ..TagLight::default()
        });
        let next = metering.step(10, 12, &dark).unwrap();
        assert!((next.exposure_s - 0.002).abs() < 1e-9, "{next:?}");
        assert!((11..=15).all(|image| metering.step(image, image, &dark).is_none()));
        assert!(metering.step(16, 16, &dark).is_some());
    }

    #[test]
    fn metering_without_the_tag_in_single_images() {
        let mut metering = from_a_millisecond();
        let water = Light::Image(ImageLight {
            mean: 15.0,
            brightest: 60.0,
            ..ImageLight::default()
        });
        assert!((10..15).all(|image| metering.step(image, image, &water).is_none()));
        let next = metering.step(15, 15, &water).unwrap();
        assert!((next.exposure_s - MAX_EXPOSURE_S).abs() < 1e-9, "{next:?}");
    }

    #[test]
    fn nearest_setting_steps_and_bounds() {
        let range = SettingRange {
            low: 1.0,
            most: 40.4,
            step: 2.0,
        };
        assert_eq!(
            [-5.0, 1.9, 2.1, 39.0, 900.0].map(|v| range.nearest(v)),
            [1.0, 1.0, 3.0, 39.0, 39.0]
        );
        let hundred_us = SettingRange {
            low: 1e-4,
            most: 0.004,
            step: 1e-4,
        };
        assert!((hundred_us.nearest(0.03) - 0.004).abs() < 1e-9);
    }
}

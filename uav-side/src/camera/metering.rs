//! Exposure and gain, metered on the tag: a step in stops (factors of two) towards a white of 180 grey levels.
//!
//! Light on a sensor grows in proportion to the exposure, so that alone follows, up to the longest that motion blur
//! permits. The gain, whose scale each device chooses itself (linear, dB), is moved by parts of its range: up while
//! the longest exposure is too dark, down while the exposure is far from its longest, because gain is noise.
//!
//! While no tag is detected, the image's mean is metered. A dark image with something clipped in it has two explanations: lit
//! tags by night, which are overexposed, or a lamp or glint next to a deck in the dark. Both are tried in turns, each
//! from the setting in which its last turn ended.

use serde::{Deserialize, Serialize};

use super::light::{ImageLight, TagLight};

/// Level of the tag's white that is aimed at, grey levels: black is then 10 to 20, a third of light more clips nothing.
const WHITE: f64 = 180.0;
/// Largest deviation from it, stops, that is left: 150 to 216 grey levels.
const WHITE_BAND: f64 = 0.26;
/// White from which on the light may be any: it counts as twice too bright, grey levels.
const CLIPPED: f64 = 250.0;
/// Mean of an image without the tag that is aimed at, grey levels. A deck that fills it has its white at 60 or above;
/// on water of a thirtieth of white, the tag's black stays below 120.
const MEAN: f64 = 60.0;
/// Largest deviation from it, stops.
const MEAN_BAND: f64 = 0.5;
/// Images without the tag before the image's mean is metered: the tag is lost for single ones.
const UNDETECTED: u32 = 5;
/// Images of one turn where mean and brightest part of an image ask for opposite exposures: some ten changes of the setting.
const TURN: u32 = 60;
/// Images that a device takes at most until a change shows.
const SETTLING: u64 = 3;
/// Largest step of the exposure, stops.
const MAX_STEP: f64 = 2.0;
/// Part of the gain's range for each stop that is missing, of one stop at most: a linear gain up to 100 is not overdone
/// by more than the stops to [`SHORT`], a gain of 48 dB moves by half a stop.
const GAIN_STEP: f64 = 1.0 / 16.0;
/// Part of its range by which the gain falls while the exposure is short: 0.75 dB of 48 dB, which the band holds.
const GAIN_FALL: f64 = 1.0 / 64.0;
/// Exposure below this part of the longest is short: the gain may fall by up to two stops.
const SHORT: f64 = 0.25;

/// Values that a device can be set to: `low + k step`, up to `most`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingRange {
    pub low: f64,
    pub most: f64,
    /// Between neighbours, above 0.
    pub step: f64,
}

impl SettingRange {
    /// The nearest that can be set.
    pub fn nearest(&self, value: f64) -> f64 {
        let steps = |v: f64| (v - self.low) / self.step;
        // What a division loses of a whole number of steps.
        let most = (steps(self.most) + 1e-6).floor().max(0.0);
        self.low + self.step * steps(value).round().clamp(0.0, most)
    }
}

/// Exposure and gain of a device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// Exposure, s.
    pub exposure_s: f64,
    /// Gain in the device's own unit.
    pub gain: f64,
}

/// Light in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// That on the tag.
    Tag(TagLight),
    /// That of the whole image: no tag was detected.
    Image(ImageLight),
}

/// Exposure of an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exposed {
    /// Exposure and gain.
    pub setting: Setting,
    /// Neither may be more.
    pub at_limit: bool,
}

/// Metering of one device.
#[derive(Clone, Debug)]
pub struct Metering {
    exposure_s: SettingRange,
    gain: SettingRange,
    setting: Setting,
    /// The newest image when it was set.
    set_at: u64,
    /// Images in a row without the tag.
    undetected: u32,
    /// When the image's mean was metered last, it asked for more light, and something in the image was clipped.
    contradicted: bool,
    /// The image's brightest part is metered instead of its mean.
    by_brightest: bool,
    /// Setting of the other turn: in which the tag, or the brightest part, was metered last.
    other: Setting,
}

impl Metering {
    /// A device with these ranges, the exposure's up to the longest that is permitted; it begins at `setting` or what
    /// is nearest to it.
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
    /// Setting of the device.
    pub fn setting(&self) -> Setting {
        self.setting
    }
    /// Whether neither exposure nor gain may be more.
    pub fn at_limit(&self) -> bool {
        let most = |range: &SettingRange| range.nearest(range.most);
        self.setting.exposure_s >= most(&self.exposure_s) && self.setting.gain >= most(&self.gain)
    }
    /// Image number `image` of the device, whose newest is number `newest`, had this light: the next setting, if it
    /// is another one. Images that may be of the former setting are not metered.
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
    /// Counts images without the tag; whether the other turn begins with this one.
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
    /// Stops of light that are missing, less than zero where it is too bright; zero within the band. None where
    /// nothing is metered.
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
        // Rounded, but half a step does not count: the way back would be half a step, too.
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

    /// The longest exposure, s.
    const MAX_EXPOSURE_S: f64 = 0.004;
    /// Images within which a level is reached.
    const CONVERGED: u64 = 240;

    /// Gain of a device's number.
    #[derive(Clone, Copy, Debug)]
    enum Scale {
        Linear,
        TenthDecibel,
    }

    /// A linear sensor with 8 bits, whose settings show after `latency` images and whose images are metered `queue`
    /// images late.
    struct Sensor {
        metering: Metering,
        scale: Scale,
        latency: u64,
        queue: u64,
        /// Settings, and the first image that may show each.
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
        /// White, grey levels without a limit: `light` is that of a white of 255 at 1 s with a gain of 1.
        fn white(&self, light: f64, setting: Setting) -> f64 {
            let gain = match self.scale {
                Scale::Linear => setting.gain,
                Scale::TenthDecibel => 10_f64.powf(setting.gain / 200.0),
            };
            255.0 * light * setting.exposure_s * gain
        }
        /// One image; the water around the tag is a tenth as bright. Returns the tag's white.
        fn take(&mut self, light: f64) -> f64 {
            self.image += 1;
            while let Some((from, setting)) = self.pending.front().copied()
                && from <= self.image
            {
                self.shown = setting;
                self.pending.pop_front();
            }
            let white = self.white(light, self.shown);
            let level = |share: f64| (share * white).round().clamp(0.0, 255.0) as u8;
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
        /// Many images of one light; the last one's white, and the changes during the last of them.
        fn settle(&mut self, light: f64) -> (f64, u64) {
            for _ in 0..CONVERGED {
                self.take(light);
            }
            // The gain may go on falling, which the exposure makes up for.
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
            // From what the longest exposure with most gain needs to what 0.2 us do.
            let light = 3.0 * 10_f64.powf(decades);
            let start = Setting { exposure_s, gain };
            let mut sensor = Sensor::new(scale, latency, queue, 2e-8, start);
            for _ in 0..CONVERGED {
                sensor.take(light);
            }
            // The gain may go on falling, by halves where its numbers are small; a stop below 225 the tag is fit.
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
            let (white, changes) = sensor.settle(3.0 * 10_f64.powf(decades));
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
                sensor.settle(1000.0);
                // Two seconds at 30 Hz.
                let whites: Vec<f64> = (0..60).map(|_| sensor.take(1000.0 * factor)).collect();
                assert!((140.0..225.0).contains(&whites[59]), "{factor}: {whites:?}");
                // Never further off than it began.
                let off = 1.5 * factor.max(1.0 / factor);
                let within = 180.0 / off..180.0 * off;
                assert!(whites.iter().all(|w| within.contains(w)), "{factor}: {whites:?}");
            }
        }
    }

    /// A camera at 1 ms and gain 1.
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

    /// Lit tags in the dark: overexposed they are not decoded, and they are a hundredth of the image. Returns whether they are
    /// decoded in each image, and how many images are at the limits.
    fn night(scale: Scale, light: f64, lamp: bool) -> (Vec<bool>, usize) {
        let start = Setting {
            exposure_s: MAX_EXPOSURE_S,
            gain: 0.0,
        };
        let mut sensor = Sensor::new(scale, 2, 1, 1e-4, start);
        let mut at_limit = 0;
        let detected = (1..=8 * u64::from(TURN)).map(|number| {
            let white = sensor.white(light, sensor.metering.setting());
            // Of four times the white that clips, a lens scatters enough to fill the black.
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
            // From faint ones, which the longest exposure shows, to those that the shortest shows.
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
        // Nothing is bright: it stays at the limit. A lamp is: it looks for what the lamp may hide, and comes back.
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

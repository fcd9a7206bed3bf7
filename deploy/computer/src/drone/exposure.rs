//! Exposure and gain of a V4L2 device through its controls, fixed or metered on the tag.

use std::io::{Error, ErrorKind};

use alight_uav::camera::metering::{Light, Metering, Setting, SettingRange};
use rscam::CtrlData;

use crate::config::camera::CameraSource;

const UNIT_S: f64 = 1e-4;

pub trait Controls {
    fn query(&self, id: u32) -> Result<CtrlData, Error>;
    fn set(&self, id: u32, value: i32) -> Result<(), Error>;
}

impl Controls for rscam::Camera {
    fn query(&self, id: u32) -> Result<CtrlData, Error> {
        self.get_control(id).map(|control| control.data)
    }
    fn set(&self, id: u32, value: i32) -> Result<(), Error> {
        self.set_control(id, &value)
    }
}

pub struct ExposureControl {
    metering: Metering,
    /// Exposure and gain are metered; otherwise they are fixed.
    metered: bool,
    /// Control id of the gain, if the device has one.
    gain: Option<u32>,
}

impl ExposureControl {
    /// Starts from the exposure and gain that the device's automatic control has set. The error text completes a
    /// sentence about the device.
    pub fn take(device: &impl Controls, config: &CameraSource) -> Result<ExposureControl, String> {
        let (range, value) = integer(device, rscam::CID_EXPOSURE_ABSOLUTE)
            .map_err(|e| format!("has no control exposure_time_absolute ({e})"))?;
        let exposure_s = SettingRange {
            low: range.low * UNIT_S,
            most: (range.most * UNIT_S).min(config.exposure_s),
            step: range.step * UNIT_S,
        };
        if exposure_s.low > config.exposure_s {
            return Err(format!(
                "exposes for {:.1} ms at least, longer than exposure_s",
                1e3 * exposure_s.low
            ));
        }
        if device.query(rscam::CID_EXPOSURE_AUTO).is_ok() {
            // Devices support one of these two modes in which a program sets the exposure time.
            let set = |mode: u32| device.set(rscam::CID_EXPOSURE_AUTO, mode as i32);
            set(rscam::EXPOSURE_MANUAL)
                .or_else(|_| set(rscam::EXPOSURE_SHUTTER_PRIORITY))
                .map_err(|e| format!("does not leave its automatic exposure ({e})"))?;
        }
        // Many devices have no automatic gain.
        let _none = device.set(rscam::CID_AUTOGAIN, 0);
        let found = [rscam::CID_GAIN, rscam::CID_ANALOGUE_GAIN]
            .into_iter()
            .find_map(|id| integer(device, id).ok().map(|(range, value)| (id, range, value)));
        let (id, gain, gain_now) = found.map_or_else(
            || {
                (
                    None,
                    SettingRange {
                        low: 0.0,
                        most: 0.0,
                        step: 1.0,
                    },
                    0.0,
                )
            },
            |(id, range, value)| (Some(id), range, value),
        );
        let start = match config.fixed_gain() {
            Some(gain) => Setting {
                exposure_s: config.exposure_s,
                gain,
            },
            None => Setting {
                exposure_s: value * UNIT_S,
                gain: gain_now,
            },
        };
        let control = ExposureControl {
            metering: Metering::new(exposure_s, gain, start),
            metered: config.fixed_gain().is_none(),
            gain: id,
        };
        control.write(device)?;
        Ok(control)
    }
    pub fn setting(&self) -> Setting {
        self.metering.setting()
    }
    /// Whether exposure and gain are both at their limits or fixed.
    pub fn at_limit(&self) -> bool {
        !self.metered || self.metering.at_limit()
    }
    /// Meters the device's image number `image` by its light; `newest` is the number of the newest image.
    pub fn meter(
        &mut self,
        device: &impl Controls,
        image: u64,
        newest: u64,
        light: &Light,
    ) -> Result<(), String> {
        if self.metered && self.metering.step(image, newest, light).is_some() {
            self.write(device)?;
        }
        Ok(())
    }
    fn write(&self, device: &impl Controls) -> Result<(), String> {
        let Setting { exposure_s, gain } = self.setting();
        device
            .set(rscam::CID_EXPOSURE_ABSOLUTE, (exposure_s / UNIT_S).round() as i32)
            .map_err(|e| format!("does not accept an exposure of {:.1} ms ({e})", 1e3 * exposure_s))?;
        self.gain.map_or(Ok(()), |id| {
            device
                .set(id, gain.round() as i32)
                .map_err(|e| format!("does not accept a gain of {gain:.0} ({e})"))
        })
    }
}

fn integer(device: &impl Controls, id: u32) -> Result<(SettingRange, f64), Error> {
    match device.query(id)? {
        CtrlData::Integer {
            value,
            minimum,
            maximum,
            step,
            ..
        } => Ok((
            SettingRange {
                low: minimum.into(),
                most: maximum.into(),
                step: step.max(1).into(),
            },
            value.into(),
        )),
        _ => Err(Error::new(ErrorKind::Unsupported, "not a number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_uav::camera::{ImageLight, TagLight};
    use std::cell::RefCell;

    /// Simulated device: controls (minimum, maximum, value), and the values that were set.
    struct Device {
        controls: Vec<(u32, [i32; 3])>,
        written: RefCell<Vec<(u32, i32)>>,
    }

    impl Device {
        fn with(controls: &[(u32, [i32; 3])]) -> Device {
            Device {
                controls: controls.to_vec(),
                written: RefCell::default(),
            }
        }
    }

    impl Controls for Device {
        fn query(&self, id: u32) -> Result<CtrlData, Error> {
            let found = self.controls.iter().find(|(own, _)| *own == id);
            let (_, [minimum, maximum, value]) = *found.ok_or(ErrorKind::InvalidInput)?;
            Ok(CtrlData::Integer {
                value,
                default: value,
                minimum,
                maximum,
                step: 1,
            })
        }
        fn set(&self, id: u32, value: i32) -> Result<(), Error> {
            self.query(id)?;
            self.written.borrow_mut().push((id, value));
            Ok(())
        }
    }

    const WEBCAM: [(u32, [i32; 3]); 3] = [
        (rscam::CID_EXPOSURE_AUTO, [0, 3, 3]),
        (rscam::CID_EXPOSURE_ABSOLUTE, [3, 2047, 312]),
        (rscam::CID_GAIN, [0, 100, 20]),
    ];

    fn source(exposure_s: f64, gain: i64) -> CameraSource {
        CameraSource {
            exposure_s,
            gain,
            ..CameraSource::default()
        }
    }

    #[test]
    fn manual_exposure_after_automatic() {
        let device = Device::with(&WEBCAM);
        let control = ExposureControl::take(&device, &source(0.004, -1)).unwrap();
        let written = device.written.borrow();
        assert_eq!(written[0], (rscam::CID_EXPOSURE_AUTO, 1));
        // The automatic exposure of 31.2 ms exceeds the permitted one.
        assert_eq!(
            written[1..],
            [(rscam::CID_EXPOSURE_ABSOLUTE, 40), (rscam::CID_GAIN, 20)]
        );
        assert!((control.setting().exposure_s - 0.004).abs() < 1e-9);
    }

    #[test]
    fn metered_and_fixed_exposure() {
        let bright = Light::Tag(TagLight {
            black: 90,
            white: 255,
            saturation: 0.3,
        });
        for (gain, exposure) in [(-1, 20), (7, 40)] {
            let device = Device::with(&WEBCAM);
            let mut control = ExposureControl::take(&device, &source(0.004, gain)).unwrap();
            control.meter(&device, 9, 10, &bright).unwrap();
            let of_exposure =
                |(id, value): &(u32, i32)| (*id == rscam::CID_EXPOSURE_ABSOLUTE).then_some(*value);
            let written = device.written.borrow();
            assert_eq!(written.iter().filter_map(of_exposure).next_back(), Some(exposure));
            assert_eq!(
                written.last(),
                Some(&(rscam::CID_GAIN, if gain < 0 { 20 } else { 7 }))
            );
        }
    }

    #[test]
    fn exposure_at_its_limit_in_the_dark() {
        let dark = Light::Image(ImageLight::default());
        let device = Device::with(&WEBCAM);
        let mut control = ExposureControl::take(&device, &source(0.004, -1)).unwrap();
        assert!(!control.at_limit());
        for image in 1..400 {
            control.meter(&device, image, image, &dark).unwrap();
        }
        let Setting { exposure_s, gain } = control.setting();
        assert!(
            control.at_limit() && (exposure_s, gain) == (0.004, 100.0),
            "{exposure_s} {gain}"
        );
        assert!(
            ExposureControl::take(&device, &source(0.004, 7))
                .unwrap()
                .at_limit()
        );
    }

    #[test]
    fn exposure_without_device_controls() {
        let rejection = |controls: &[(u32, [i32; 3])]| {
            let device = Device::with(controls);
            ExposureControl::take(&device, &source(0.004, -1))
                .err()
                .unwrap_or_default()
        };
        assert!(rejection(&WEBCAM[2..]).contains("has no control exposure_time_absolute"));
        assert!(rejection(&[(rscam::CID_EXPOSURE_ABSOLUTE, [50, 2047, 312])]).contains("5.0 ms at least"));
        assert_eq!(rejection(&WEBCAM[1..2]), "");
    }
}

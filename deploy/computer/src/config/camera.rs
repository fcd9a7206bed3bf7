use alight_shared::config;

/// Source name for images that the simulated world renders.
const SIMULATION: &str = "simulation";

config! {
    /// Image source of a camera.
    pub struct CameraSource {
        /// V4L2 device (/dev/video0), PGM file or directory of PGM files, named pipe of raw grey images, or
        /// "simulation"; empty: no camera process, because another program publishes the detections.
        pub source: String = String::new();
        /// Pixel format requested from a V4L2 device: GREY, YUYV, NV12 or YU12.
        /// Source: Format of most USB cameras.
        pub format: String = "YUYV".into();
        /// Images per second requested from a device, or read from files.
        pub rate_hz: f64 = 30.0, in 1.0..=120.0;
        /// Time from the middle of the exposure to the image's time stamp (V4L2: set by the driver, otherwise the
        /// arrival time), s. Chosen: half an exposure and the transfer of a USB camera.
        pub delay_s: f64 = 0.02, in 0.0..=1.0;
        /// Maximum exposure of a V4L2 device, s; up to this value the exposure is metered on the tag. 0: the device's
        /// own automatic exposure. An exposure is rejected if it is too long to decode the tag from
        /// `tracking_height_m` at the planner's maximum rate (`limits.rates_rps`). Chosen: motion during 4 ms is 2.6
        /// px at 2 rad/s and a focal length of 320 px; the tag is decoded with up to 11 px.
        pub exposure_s: f64 = 0.004, in 0.0..=0.1;
        /// Fixed gain of a V4L2 device in its own unit (v4l2-ctl --list-ctrls), which also fixes the exposure at
        /// `exposure_s`; -1: gain and exposure are metered.
        pub gain: i64 = -1, in -1.0..=1e6;
    }
    check |this, at| {
        at.require(
            ["GREY", "YUYV", "NV12", "YU12"].contains(&this.format.as_str()),
            "format",
            &this.format,
            "GREY, YUYV, NV12 or YU12",
        )?;
    }
}

impl CameraSource {
    pub fn is_there(&self) -> bool {
        !self.source.is_empty()
    }
    pub fn is_simulation(&self) -> bool {
        self.source == SIMULATION
    }
    /// Fixed gain, which also fixes the exposure; None if both are metered.
    pub fn fixed_gain(&self) -> Option<f64> {
        (self.gain >= 0).then_some(self.gain as f64)
    }
    /// The simulation's camera if `on`, otherwise no camera.
    pub fn of_simulation(on: bool) -> CameraSource {
        CameraSource {
            source: if on { SIMULATION.into() } else { String::new() },
            ..CameraSource::default()
        }
    }
}

config! {
    /// Image source of an ultraviolet camera; its image rate is the bit rate of the markers.
    pub struct UltravioletSource {
        /// As [`CameraSource::source`], except the simulation, which renders markers in lock-step only.
        pub source: String = String::new();
        /// As [`CameraSource::format`]. Source: A single channel behind a filter.
        pub format: String = "GREY".into();
        /// As [`CameraSource::delay_s`].
        pub delay_s: f64 = CameraSource::default().delay_s;
        /// Fixed exposure of a V4L2 device, s, short enough that only the markers exceed their threshold; 0: the
        /// device's own automatic exposure.
        pub exposure_s: f64 = 0.0, in 0.0..=0.1;
        /// Gain at this exposure, in the device's own unit.
        pub gain: i64 = 0, in 0.0..=1e6;
    }
    check |this, at| {
        let images = this.at_rate(CameraSource::default().rate_hz);
        images.check(at)?;
        at.require(
            !images.is_simulation(),
            "source",
            &this.source,
            "a V4L2 device, PGM files or a named pipe: the simulation renders markers in lock-step only (a \
             scenario's [sensors.render] markers)",
        )?;
    }
}

impl UltravioletSource {
    pub fn at_rate(&self, rate_hz: f64) -> CameraSource {
        CameraSource {
            source: self.source.clone(),
            format: self.format.clone(),
            rate_hz,
            delay_s: self.delay_s,
            exposure_s: self.exposure_s,
            gain: self.gain,
        }
    }
}

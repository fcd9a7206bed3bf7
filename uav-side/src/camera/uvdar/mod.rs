//! Blinking ultraviolet markers (Walter et al. 2019, "UVDAR system for visual relative localization"), identified by
//! their codes. They give the deck's position from farther away than the tag.
//!
//! Read in this order: [`blobs`], [`blink`], [`fisheye`], [`pose`].

pub mod blink;
pub mod blobs;
pub mod fisheye;
pub mod pose;

use alight_shared::{
    bus::wiring,
    config,
    msg::UvdarFix,
    node::Node,
    time::{DroneClock, Span, Time},
};
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    image::{CameraFrame, GreyImage},
    node::{CameraIdentity, CameraIn, Exposures},
};
use blink::{BlinkTracker, Code};
use blobs::BlobLimits;
pub use fisheye::Fisheye;
use pose::{MarkerBearing, PosePrior, solve};

pub const MAX_MARKERS: usize = 16;
/// Time for which the attitude of a fix is used, s.
const ATTITUDE_MEMORY_S: f64 = 0.5;
/// Minimum number of bits in which two codes differ.
const MIN_CODE_DISTANCE: u32 = 3;

config! {
    /// Settings of the ultraviolet camera and of the deck's markers.
    pub struct UvdarSettings {
        /// Lens of the camera.
        pub lens: Fisheye;
        /// Angle of the optical axis below the body's forward axis, deg.
        pub tilt_down_deg: f64 = 45.0, in -90.0..=90.0;
        /// Position of the optical centre relative to the belly camera's, in the belly camera's axes (right, aft,
        /// down), m.
        pub offset_m: [f64; 3] = [0.0; 3], in -5.0..=5.0;
        /// Image rate, Hz, equal to the markers' bit rate.
        pub rate_hz: f64 = 20.0, in 1.0..=200.0;
        /// Minimum grey level of a marker.
        pub threshold: u8 = 80, in 5.0..=255.0;
        /// Maximum number of pixels of a marker.
        pub max_pixels: u16 = 200, in 1.0..=1e4;
        /// Markers in the deck's frame, m.
        /// Chosen: the corners of the deck.
        pub markers_m: Vec<[f64; 3]> = vec![
                [1.25, -0.85, 0.0],
                [1.25, 0.85, 0.0],
                [-1.25, 0.85, 0.0],
                [-1.25, -0.85, 0.0],
            ];
        /// Codes of the markers, one bit per image, 1 lit.
        /// Chosen: twelve bits, dark for at most two, any two codes four bits apart in any phase.
        pub codes: Vec<String> = ["001001001011", "001001100101", "001010101111", "001100110111"]
                .map(String::from)
                .to_vec();
        /// Number of wrong bits tolerated in a code.
        pub wrong_bits: u32 = 1, in 0.0..=3.0;
        /// Maximum deviation of a spot from its predicted position in the next image, px.
        pub gate_px: f64 = 6.0, in 0.5..=100.0;
        /// Standard deviation of a spot's position, each coordinate, px.
        /// Chosen: three times that of rendered images.
        pub spot_sd_px: f64 = 0.15, in 0.01..=10.0;
        /// Standard deviation of the deck's tilt relative to the drone, each axis, deg.
        pub tilt_sd_deg: f64 = 12.0, in 0.5..=60.0;
        /// Maximum sum of squared residuals, in variances.
        pub max_misfit: f64 = 40.0, in 1.0..=1e6;
    }
    check |this, at| {
        at.require(
            (2..=MAX_MARKERS).contains(&this.markers_m.len()) && this.markers_m.len() == this.codes.len(),
            "markers_m, codes",
            format!("{} and {}", this.markers_m.len(), this.codes.len()),
            "2 to 16 markers, one code for each",
        )?;
        for marker in &this.markers_m {
            at.ranges("markers_m", marker, -50.0, 50.0)?;
        }
        let codes = this.parsed();
        let length = codes.first().map_or(0, Code::images);
        let apart = |(k, a): (usize, &Code)| codes.iter().skip(k + 1).all(|b| a.apart(b) >= MIN_CODE_DISTANCE);
        at.require(
            codes.len() == this.codes.len()
                && codes.iter().all(|c| c.images() == length)
                && codes.iter().enumerate().all(apart),
            "codes",
            format!("{:?}", this.codes),
            "4 to 32 bits (0 or 1) each, all of equal length, any two at least 3 bits apart in every phase",
        )?;
    }
}

impl UvdarSettings {
    pub fn parsed(&self) -> Vec<Code> {
        self.codes.iter().filter_map(|c| Code::parse(c)).collect()
    }
    /// Rotation from the ultraviolet camera to the belly camera, about the common x axis.
    pub fn belly_from_uv(&self) -> UnitQuaternion<f64> {
        let turn = core::f64::consts::FRAC_PI_2 - self.tilt_down_deg.to_radians();
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), turn)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct UvdarCounts {
    pub images: u64,
    pub fixes: u64,
    pub markers: u64,
    /// Number of images with a single marker, which gives a direction but no distance.
    pub single: u64,
    /// Number of images whose markers fit no position, or several.
    pub misfit: u64,
    pub wrong_size: u64,
}

pub struct UvdarNode {
    settings: UvdarSettings,
    tracker: BlinkTracker,
    belly_from_uv: UnitQuaternion<f64>,
    known: PosePrior,
    exposures: Exposures,
    /// Attitude of the newest fix, from deck to camera.
    last_attitude: Option<(Time<DroneClock>, UnitQuaternion<f64>)>,
    pub counts: UvdarCounts,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct UvdarOut {
    pub fixes: Vec<UvdarFix>,
}

wiring! {
    UvdarPorts of UvdarNode: CameraIn => UvdarOut {
        reads {}
        edge { frames, exposed }
        writes { fixes: UvdarFix }
        wakes {}
    }
}

impl UvdarNode {
    pub fn new(settings: &UvdarSettings, identity: CameraIdentity) -> UvdarNode {
        let period = Span::from_secs(1.0 / settings.rate_hz);
        let belly_from_uv = settings.belly_from_uv();
        UvdarNode {
            tracker: BlinkTracker::new(settings.parsed(), settings.wrong_bits, settings.gate_px, period),
            known: PosePrior {
                bearing_sd: settings.spot_sd_px * settings.lens.pixel_rad(),
                down: belly_from_uv.inverse() * Vector3::z(),
                tilt_sd: settings.tilt_sd_deg.to_radians(),
            },
            belly_from_uv,
            settings: settings.clone(),
            exposures: Exposures::of(identity),
            last_attitude: None,
            counts: UvdarCounts::default(),
        }
    }
    pub fn detect(&mut self, at: Time<DroneClock>, image: &GreyImage) -> Option<UvdarFix> {
        self.counts.images += 1;
        let s = &self.settings;
        if !image.has_size(s.lens.width_px, s.lens.height_px) {
            self.counts.wrong_size += 1;
            return None;
        }
        let spot = BlobLimits {
            threshold: s.threshold,
            max_pixels: usize::from(s.max_pixels),
        };
        let known = self.tracker.step(at, &blobs::find(image, &spot));
        self.counts.markers += known.len() as u64;
        let bearings: Vec<MarkerBearing> = known
            .iter()
            .filter_map(|k| {
                Some(MarkerBearing {
                    marker: Vector3::from(*s.markers_m.get(k.marker)?),
                    direction: s.lens.direction(k.at)?,
                })
            })
            .collect();
        if bearings.len() < 2 {
            self.counts.single += u64::from(bearings.len() == 1);
            return None;
        }
        let last = self
            .last_attitude
            .filter(|(then, _)| (at - *then).secs() < ATTITUDE_MEMORY_S)
            .map(|(_, attitude)| attitude);
        let found = solve(&bearings, &self.known, last.as_ref());
        let Some(pose) = found.filter(|p| p.misfit <= s.max_misfit) else {
            self.counts.misfit += 1;
            return None;
        };
        self.last_attitude = Some((at, pose.attitude));
        self.counts.fixes += 1;
        let position = self.belly_from_uv * pose.position + Vector3::from(s.offset_m);
        let turn = self.belly_from_uv.to_rotation_matrix().into_inner();
        let variance = (turn * pose.covariance * turn.transpose()).diagonal();
        Some(UvdarFix {
            position: position.into(),
            variance: variance.into(),
            ..UvdarFix::default()
        })
    }
}

impl Node for UvdarNode {
    type Clock = DroneClock;
    type In = CameraIn;
    type Out = UvdarOut;

    fn step(&mut self, now: Time<DroneClock>, input: &CameraIn) -> UvdarOut {
        let mut out = UvdarOut::default();
        for CameraFrame { at, image } in &input.frames {
            if self.exposures.accept(now, *at)
                && let Some(fix) = self.detect(*at, image)
            {
                let header = self.exposures.header(*at);
                out.fixes.push(UvdarFix { header, ..fix });
            }
        }
        out
    }
}

//! Belly camera: deck pose from the tags in its images.
//!
//! Read in this order: [`image`], [`lens`] (directions of pixels), [`layout`] (visibility of tags), [`detector`]
//! (corners), [`motion_blur`], [`square_pose`] (pose and covariance), [`node`]; [`light`] and [`metering`] (exposure
//! and gain); [`marked`] (display), [`foreign_tags`] (other tags); [`uvdar`] (second camera).

mod apriltag;
mod decks;
pub mod detector;
pub mod foreign_tags;
pub mod image;
pub mod layout;
pub mod lens;
pub mod light;
pub mod marked;
pub mod metering;
pub mod motion_blur;
pub mod node;
mod refine;
pub mod square_pose;
pub mod uvdar;

use alight_shared::{
    config,
    frames::{Camera, Rotation},
};

pub use detector::TagSettings;
pub use image::{CameraFrame, GreyImage, ImageError};
pub use lens::Lens;
pub use light::{ImageLight, TagLight};
pub use node::{CameraIn, CameraNode, CameraOut};
pub use uvdar::UvdarSettings;

config! {
    /// Settings of the camera and its detectors.
    pub struct CameraSettings {
        /// Rotation of the camera's mount relative to the design (optical axis down, upper edge forward): roll, pitch
        /// and yaw about the camera's x (right in the image), y (down in the image) and z, deg.
        pub mount_rotation_deg: [f64; 3] = Default::default(), in -180.0..=180.0;
        /// Lens of the camera, from its calibration.
        pub lens: Lens;
        /// Detector of the deck's tags.
        pub tag: TagSettings;
        /// Ultraviolet camera and the deck's markers.
        pub uvdar: UvdarSettings;
    }
}

impl CameraSettings {
    /// Rotation from the mounted to the designed camera.
    pub fn mount(&self) -> Rotation<Camera, Camera> {
        let [roll, pitch, yaw] = self.mount_rotation_deg.map(f64::to_radians);
        Rotation::from_euler(roll, pitch, yaw)
    }
}

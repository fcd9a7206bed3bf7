//! The belly camera by night: rendered images compared with the measurement model.

use alight_shared::geometry::DeckGeometry;
use alight_uav::camera::CameraSettings;

use crate::sensors::SensorConfig;
use crate::sensors::night::NightConfig;
use crate::studies::camera::{CameraBench, CameraRow, Condition};

/// A tag of a metre from this distance in this light.
fn row(night: NightConfig, range_m: f64, images: usize) -> CameraRow {
    let sensors = SensorConfig {
        night: Some(night),
        ..SensorConfig::default()
    };
    let (settings, deck) = (CameraSettings::default(), DeckGeometry::default());
    let condition = Condition {
        range_m,
        ..Condition::default()
    };
    CameraBench::new(&sensors, &settings, &deck, 7).row(&condition, images)
}

#[test]
fn detection_by_night_in_images_and_model() {
    let printed = |ambient_lux: f64, max_gain: f64| NightConfig {
        ambient_lux,
        max_gain,
        ..NightConfig::default()
    };
    let lit = |tags_cdpm2: f64, lamp_cd: f64| NightConfig {
        ambient_lux: 0.01,
        tags_cdpm2,
        lamp_cd,
        ..NightConfig::default()
    };
    // The floodlit deck; 24 dB at their limit; 36 dB whose noise is; lit tags too faint, plain and dazzling; a lamp.
    let conditions = [
        (printed(200.0, 16.0), 4.0),
        (printed(40.0, 16.0), 12.0),
        (printed(10.0, 16.0), 4.0),
        (printed(10.0, 64.0), 12.0),
        (printed(2.5, 256.0), 4.0),
        (lit(3.0, 0.0), 4.0),
        (lit(12.0, 0.0), 12.0),
        (lit(100.0, 1e4), 8.0),
        (lit(1000.0, 0.0), 20.0),
    ];
    for (night, range_m) in conditions {
        let r = row(night, range_m, 30);
        let (images, model) = (r.pixels.rate, r.model_rate);
        assert!(
            (images - model).abs() < 0.2,
            "{images} of the images, {model}: {night:?}"
        );
        // The corners' noise, too, where it is known from more than a few.
        let ratio = r.model_corner_px / r.corner_rms_px;
        assert!(
            images < 0.5 || (0.5..2.0).contains(&ratio),
            "corners {ratio}: {night:?}"
        );
    }
}

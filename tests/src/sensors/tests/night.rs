//! The belly camera by night: rendered images beside the measurement model.

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
            images < 0.5 || (0.6..1.8).contains(&ratio),
            "corners {ratio}: {night:?}"
        );
    }
}

#[test]
#[ignore = "explore"]
fn explore() {
    let show = |name: String, r: CameraRow| {
        println!(
            "{name:28} images {:.2} model {:.2}  corner {:.3} model {:.3}  nees {:.2} {:.2}",
            r.pixels.rate,
            r.model_rate,
            r.corner_rms_px,
            r.model_corner_px,
            r.pixels.nees_position,
            r.pixels.nees_attitude
        );
    };
    for range in [4.0, 12.0] {
        for lux in [24.0, 20.0, 19.0, 18.0, 17.0, 16.0, 15.0, 14.0, 12.0] {
            let night = NightConfig {
                ambient_lux: lux,
                ..NightConfig::default()
            };
            show(format!("lux {lux} at {range}"), row(night, range, 40));
        }
    }
    for range in [2.5, 4.0, 12.0] {
        for lux in [20.0, 14.0, 10.0, 7.0, 5.0] {
            let night = NightConfig {
                ambient_lux: lux,
                max_gain: 128.0,
                ..NightConfig::default()
            };
            show(format!("gain 128 lux {lux} at {range}"), row(night, range, 40));
        }
    }
    for (tags, lux) in [(0.0, 100.0), (100.0, 0.01)] {
        for lamp in [1e4, 3e4, 1e5, 3e5] {
            for range in [4.0, 8.0] {
                let night = NightConfig {
                    tags_cdpm2: tags,
                    ambient_lux: lux,
                    lamp_cd: lamp,
                    ..NightConfig::default()
                };
                show(
                    format!("lit {tags} lux {lux} lamp {lamp} at {range}"),
                    row(night, range, 40),
                );
            }
        }
    }
}

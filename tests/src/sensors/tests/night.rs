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
        for lux in [1000.0, 200.0, 100.0, 60.0, 50.0, 45.0, 40.0, 35.0, 20.0] {
            let night = NightConfig {
                ambient_lux: lux,
                ..NightConfig::default()
            };
            show(format!("lux {lux} at {range}"), row(night, range, 60));
        }
    }
    // More gain: noise limits.
    for max_gain in [64.0, 256.0] {
        for range in [4.0, 12.0] {
            for lux in [40.0, 20.0, 10.0, 5.0, 2.5, 1.2] {
                let night = NightConfig {
                    ambient_lux: lux,
                    max_gain,
                    ..NightConfig::default()
                };
                show(
                    format!("gain {max_gain} lux {lux} at {range}"),
                    row(night, range, 60),
                );
            }
        }
    }
    for range in [4.0, 12.0, 20.0] {
        for tags in [3.0, 10.0, 12.0, 14.0, 20.0, 100.0, 1000.0, 10000.0] {
            let night = NightConfig {
                tags_cdpm2: tags,
                ambient_lux: 0.01,
                ..NightConfig::default()
            };
            show(format!("lit {tags} at {range}"), row(night, range, 60));
        }
    }
    for (tags, lux) in [(0.0, 100.0), (100.0, 0.01)] {
        for lamp in [100.0, 1000.0, 3000.0, 10000.0, 1e5] {
            for range in [4.0, 8.0] {
                let night = NightConfig {
                    tags_cdpm2: tags,
                    ambient_lux: lux,
                    lamp_cd: lamp,
                    ..NightConfig::default()
                };
                show(
                    format!("lit {tags} lux {lux} lamp {lamp} at {range}"),
                    row(night, range, 60),
                );
            }
        }
    }
}

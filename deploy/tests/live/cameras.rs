//! `alight camera` and `alight uvdar` as processes that read images from files: the deck is rendered, written as PGM,
//! and detected at its position.
use std::{
    fs,
    path::{Path, PathBuf},
    process::Output,
};

use alight_shared::{
    frames::{Deck, DroneBody, Point},
    time::Time,
};
use alight_sim::{
    harness::scenario::Scenario,
    physics::{body::RigidState, streams::Streams},
    sensors::{
        camera::{CameraMount, body_from_camera},
        render::{Renderer, Shot, ultraviolet::Ultraviolet},
    },
};
use alight_uav::camera::{GreyImage, uvdar::UvdarSettings};
use nalgebra::Vector3;
use serde_json::Value;

use crate::common::{self, errors, printed, scratch};

struct Directory(PathBuf);

impl Directory {
    fn new(name: &str) -> Directory {
        let path = scratch(name);
        fs::create_dir_all(&path).unwrap();
        Directory(path)
    }
    fn write(&self, k: usize, image: &GreyImage) {
        fs::write(self.0.join(format!("{k:03}.pgm")), image.to_pgm()).unwrap();
    }
    fn configuration(&self, text: &str) -> PathBuf {
        let path = self.0.join("drone.toml");
        fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        let _gone = fs::remove_dir_all(&self.0);
    }
}

/// Image from the camera of a drone at rest, `k / rate_hz` after the start, with the deck at `below` in the camera's
/// axes (right, aft, down), m.
fn shot(k: usize, rate_hz: f64, below: Vector3<f64>) -> (Shot, Vector3<f64>) {
    let mount = CameraMount {
        position: Vector3::zeros(),
        attitude: body_from_camera(),
    };
    let view = mount.view(&RigidState::<DroneBody>::default());
    let at = mount.attitude.0 * below;
    let deck = RigidState::<Deck> {
        position: Point::from(at),
        ..Default::default()
    };
    let ns = (k as f64 / rate_hz * 1e9) as i64;
    let shot = Shot {
        t: Time::from_nanos(ns),
        at: Time::from_nanos(ns),
        exposure_s: 0.004,
        gain: 1.0,
        view,
        deck,
    };
    (shot, shot.view.to_camera_frame(deck.position))
}

fn run(verb: &str, config: &Path, more: &str) -> Output {
    common::run(format!("{verb} --config {} {more}", config.display()))
}

/// Distances of the printed positions from `truth`, and the counts of the last line.
fn places(out: &Output, truth: &Vector3<f64>) -> (Vec<f64>, Value) {
    let text = printed(out);
    assert!(out.status.success(), "{text}{}", errors(out));
    let lines: Vec<Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let off = |line: &Value| {
        let p: [f64; 3] = serde_json::from_value(line["position_m"].clone()).ok()?;
        Some((Vector3::from(p) - truth).norm())
    };
    let counts = lines.last().unwrap()["counts"].clone();
    (lines.iter().filter_map(off).collect(), counts)
}

#[test]
fn uvdar_process_on_files() {
    let directory = Directory::new("uvdar");
    let settings = UvdarSettings::default();
    let mut camera = Ultraviolet::new(&settings, 10, &Streams::new(5));
    let mut truth = Vector3::zeros();
    for k in 0..48 {
        // The camera looks ahead of the drone and down.
        let (shot, detected) = shot(k, settings.rate_hz, Vector3::new(1.0, -6.0, 8.0));
        truth = detected;
        directory.write(k, &camera.image(&shot).unwrap());
    }
    let source = directory.0.to_str().unwrap().to_string();
    let config = directory.configuration(&format!("[uvdar]\nsource = \"{source}\"\n"));
    let (off, counts) = places(&run("uvdar", &config, "--print"), &truth);
    assert_eq!(counts["images"], 48, "{counts}");
    // The first code is read without prior information.
    assert!(off.len() > 12, "{counts}");
    assert!(off.iter().all(|e| *e < 1.0), "{off:?}");
}

#[test]
fn camera_process_on_files() {
    let directory = Directory::new("camera");
    let scenario = Scenario::default();
    let mut camera = Renderer::new(&scenario.sensors.render, &scenario.deck, &Streams::new(5));
    let mut truth = Vector3::zeros();
    for k in 0..6 {
        let (shot, detected) = shot(k, 30.0, Vector3::new(0.3, -0.4, 4.0));
        truth = detected;
        directory.write(k, &camera.image(&shot).unwrap());
    }
    let source = directory.0.to_str().unwrap().to_string();
    let config = directory.configuration("");
    let (off, counts) = places(
        &run("camera", &config, &format!("--print --source {source}")),
        &truth,
    );
    assert_eq!((off.len(), counts["detected"].as_u64()), (6, Some(6)), "{counts}");
    assert!(off.iter().all(|e| *e < 0.03), "{off:?}");
}

use alight_shared::{
    frames::{wxyz, yaw_rotation},
    msg::{Header, f16},
    time::Time,
};

use super::*;

/// Calibration over `seconds` with a drone at `r` on a vessel that rolls and pitches by `rocking`; `away` is an
/// additional motion of the drone's position and heading, m and rad.
fn stood(
    rocking: f64,
    seconds: f64,
    r: Vector3<f64>,
    away: impl Fn(f64) -> (Vector3<f64>, f64),
) -> Result<DeckCalibrationResult, DeckCalibrationError> {
    let config = PredictorConfig::default();
    let mut calibration = DeckCalibration::new(&config, DronePlacement::centred(&config));
    let bias = Vector3::new(1.3, -0.8, 0.9);
    for k in 0..(seconds * 100.0) as u32 {
        let t = 5.0 + f64::from(k) * 0.01;
        let at = Time::from_secs(t);
        let roll = rocking * (1.3 * t).sin();
        let pitch = rocking * (1.1 * t).cos();
        let vessel = UnitQuaternion::from_euler_angles(roll, pitch, 0.4);
        let (moved, turned) = away(t);
        let attitude = vessel * yaw_rotation(0.2 + turned);
        let n = |c: u32| (f64::from(k * c) * 0.754_877_666_246_693).fract() - 0.5;
        let noise = Vector3::new(n(1), n(3), n(7)) * 0.05;
        let feet = vessel * (r + moved) + bias + noise;
        let position = feet - attitude * Vector3::z() * config.drone.feet_below_m;
        calibration.drone(&DroneState {
            header: Header::new(1, 1, 1, k, at),
            position: position.into(),
            attitude: wxyz(&attitude),
            ..DroneState::default()
        });
        if k % 3 == 0 {
            calibration.estimate(&VesselEstimate {
                header: Header::new(1, 1, 1, k, at),
                eta: [0.0, 0.0, 0.0, roll, pitch, 0.4],
                ..empty()
            });
        }
    }
    calibration.result()
}

fn empty() -> VesselEstimate<DroneClock> {
    VesselEstimate {
        uncertainty: [[0.1, 0.1, 0.0].map(f16::from_f32); 6],
        ..VesselEstimate::default()
    }
}

const STILL: fn(f64) -> (Vector3<f64>, f64) = |_| (Vector3::new(0.0, 0.0, 0.0), 0.0);

#[test]
fn deck_calibration_with_receivers_metres_apart() {
    let r = Vector3::new(0.4, -0.2, -1.6);
    // The receivers' drift matters less when the vessel rocks more, here by 0.12 rad.
    let found = stood(0.12, 90.0, r, STILL).unwrap();
    for (f, truth) in found.centre.iter().zip(r.iter()) {
        assert!(
            (f.value - truth).abs() < 3.0 * f.sd && f.sd < 0.1,
            "{f:?} {truth}"
        );
    }
    assert!((found.heading.value - 0.2).abs() < 1e-3, "{found:?}");
    assert!(found.tilt.iter().all(|t| t.value.abs() < 1e-3), "{found:?}");
    assert!(found.mount.is_none());
}

#[test]
fn deck_calibration_without_rocking() {
    let r = Vector3::new(0.4, -0.2, -1.6);
    let found = stood(0.0, 90.0, r, STILL).unwrap();
    for (f, truth) in found.centre.iter().zip(r.iter()) {
        assert!(
            f.sd > 1.0 && (f.value - truth).abs() < 3.0 * f.sd,
            "{f:?} {truth}"
        );
    }
}

#[test]
fn deck_calibration_with_a_moving_drone() {
    let r = Vector3::new(0.0, 0.0, -1.3);
    let walks = |t: f64| (Vector3::new((1.5 * t).sin(), 0.0, 0.0), 0.0);
    assert!(matches!(
        stood(0.05, 60.0, r, walks),
        Err(DeckCalibrationError::Moves { .. })
    ));
    let turns = |t: f64| (Vector3::zeros(), 0.01 * t);
    assert!(matches!(
        stood(0.05, 60.0, r, turns),
        Err(DeckCalibrationError::Turns { .. })
    ));
    let few = stood(0.05, 10.0, r, STILL);
    assert!(matches!(few, Err(DeckCalibrationError::Few { .. })), "{few:?}");
    assert!(
        few.unwrap_err()
            .to_string()
            .contains("leave the drone on the deck")
    );
}

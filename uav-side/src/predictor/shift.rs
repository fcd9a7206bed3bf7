//! Corrects the filters for a jump of the autopilot's estimate. Values measured in the drone's frame stay relative to
//! the drone; values received by radio move with the datum.
//!
//! The deck's position is the mean, which is the radio's part, plus vision's slow error. The mean moves with a jump of
//! the datum; the slow error changes by the difference in proportion to the weight of vision. A deck that was never
//! detected stays at the radio's position through any jump of the heading. PX4 and ArduPilot align their heading by up
//! to 180 deg once the origin is known; a deck rotated with it would be wrong by `2 d sin(yaw / 2)`.

use nalgebra::Vector3;

use super::{
    axis::{Axis, AxisNoise, DRIFT, MEAN, MeasurementRow, TURN, VISION},
    track::FrameJump,
    waves::AXES,
};

/// State of the filters after `jump`. `measured`: degrees of freedom ever measured in the drone's frame, and whether
/// the position comes from the relative position, which does not depend on the heading. Returns the degrees of freedom
/// that are still known.
pub(super) fn state(
    s: &mut [Axis; AXES],
    jump: &FrameJump,
    (measured, by_relative): (&[bool; AXES], bool),
    noise: &[AxisNoise; AXES],
    gate: f64,
) -> [bool; AXES] {
    let mut known = *measured;
    let place = Vector3::from_fn(|i, _| s[i].project(MeasurementRow::Vision).0);
    let by_vision = if by_relative {
        jump.moved
    } else {
        jump.of(&place) - place
    };
    let moves = [0, 1, 2]
        .map(|i| (i, jump.datum[i], by_vision[i]))
        .into_iter()
        .chain([(5, 0.0, jump.yaw)]);
    for (i, by_radio, by_vision) in moves {
        let a = &mut s[i];
        let n = &noise[i];
        let apart = by_vision - by_radio;
        a.x[MEAN] += by_radio;
        if !measured[i] {
            continue;
        }
        match VisionWeight::of(a, n).weight(apart, gate) {
            Some(weight) => a.x[VISION] += weight * apart,
            None => {
                known[i] = false;
                a.forget(VISION, n.vision.0);
                a.forget(DRIFT, n.drift.0);
            }
        }
    }
    // The camera's mount has rotated with the drone.
    let (sin, cos) = jump.yaw.sin_cos();
    let turned = |north: f64, east: f64| (cos * north - sin * east, sin * north + cos * east);
    (s[3].x[VISION], s[4].x[VISION]) = turned(s[3].x[VISION], s[4].x[VISION]);
    (s[1].x[TURN], s[0].x[TURN]) = turned(s[1].x[TURN], s[0].x[TURN]);
    known
}

/// Variances of the deck's position along an axis in the drone's frame.
struct VisionWeight {
    whole: f64,
    /// Variance without vision: the radio's, plus the slow errors of radio and camera.
    by_radio: f64,
}

impl VisionWeight {
    fn of(a: &Axis, noise: &AxisNoise) -> VisionWeight {
        VisionWeight {
            whole: a.project(MeasurementRow::Vision).1,
            by_radio: a.project(MeasurementRow::Radio).1 + noise.radio.0.powi(2) + noise.vision.0.powi(2),
        }
    }
    /// Weight of vision in the deck's estimate, 0 to 1, when the positions by vision and radio are `apart` from each
    /// other. For the product of two normal distributions with variances `S` (radio) and `V`, where
    /// `1 / whole = 1 / S + 1 / V`, it is `S / (S + V) = 1 - whole / S`. Beyond `gate` standard deviations only the more accurate position
    /// is used; None stands for the radio.
    fn weight(&self, apart: f64, gate: f64) -> Option<f64> {
        let weight = (1.0 - self.whole / self.by_radio).clamp(0.0, 1.0);
        // S + V = S / share.
        if apart * apart * weight <= gate * gate * self.by_radio {
            return Some(weight);
        }
        (weight > 0.5).then_some(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Predictor, PredictorConfig, PredictorIn},
        *,
    };
    use crate::odometry::{Odometry, OdometryConfig};
    use alight_shared::{
        frames::{DroneNed, Vector, VesselNed, body_from_camera, wxyz, yaw_rotation},
        msg::{CarrierSolution, DroneState, Header, RelativePlace, UvdarFix, VesselEstimate},
        node::Node,
        time::DroneTime,
    };
    use proptest::prelude::*;

    /// Odometry and predictor of a drone at rest while the estimate of its autopilot jumps.
    struct Bench {
        odometry: Odometry,
        predictor: Predictor,
        tick: u32,
        /// Position of the drone as estimated by the autopilot.
        place: Vector3<f64>,
        yaw: f64,
        /// Position of the deck received by radio, relative to the datum.
        deck: Vector3<f64>,
        /// Boot id, and position of the datum.
        vessel: (u32, Vector3<f64>),
        origin: Vector3<f64>,
        /// Position of the deck relative to the drone, measured by the camera, in the drone's axes.
        detection: Option<Vector3<f64>>,
        /// Position of the deck relative to the drone, measured by a receiver, NED.
        relative: Option<Vector3<f64>>,
        /// Positions of the deck (forecast) and of the drone (odometry).
        newest: Option<(Vector3<f64>, Vector3<f64>)>,
    }

    impl Bench {
        fn new(place: Vector3<f64>, yaw: f64, deck: Vector3<f64>) -> Bench {
            Bench {
                odometry: Odometry::new(&OdometryConfig::default()),
                predictor: Predictor::new(&PredictorConfig::default(), 1),
                tick: 0,
                place,
                yaw,
                deck,
                vessel: (1, Vector3::zeros()),
                origin: Vector3::zeros(),
                detection: None,
                relative: None,
                newest: None,
            }
        }
        fn run(&mut self, seconds: f64) {
            for _ in 0..(seconds * 100.0) as u32 {
                self.step();
            }
        }
        fn step(&mut self) {
            self.tick += 1;
            let now = DroneTime::from_secs(10.0 + 0.01 * f64::from(self.tick));
            let header = Header::new(1, 1, 1, self.tick, now);
            let first = DroneState::default().datum;
            let reported = DroneState {
                header,
                datum: first.at(&Vector::<DroneNed>::from(self.origin)),
                position: (self.place - self.origin).into(),
                attitude: wxyz(&yaw_rotation(self.yaw)),
                specific_force: [0.0, 0.0, -9.806_65],
                ..DroneState::default()
            };
            let drone = self.odometry.step(&reported, false);
            let (boot, from) = self.vessel;
            let [x, y, z]: [f64; 3] = (self.deck - from).into();
            let estimate = self.tick.is_multiple_of(5).then(|| VesselEstimate {
                header: Header { boot, ..header },
                datum: first.at(&Vector::<VesselNed>::from(from)),
                eta: [x, y, z, 0.0, 0.0, 0.4],
                ..VesselEstimate::default()
            });
            let uvdar = self
                .detection
                .filter(|_| self.tick.is_multiple_of(3))
                .map(|detection| UvdarFix {
                    header,
                    position: (body_from_camera().transpose() * detection).into(),
                    variance: [1e-4; 3],
                });
            let antenna = Vector3::from(PredictorConfig::default().drone.gnss_antenna_m);
            let relative = (self.relative)
                .filter(|_| self.tick.is_multiple_of(20))
                .map(|deck| RelativePlace {
                    header,
                    baseline_m: (antenna - deck).into(),
                    baseline_sd_m: [0.01; 3],
                    solution: CarrierSolution::Fixed,
                    antenna_m: [0.0; 3],
                });
            let out = self.predictor.step(
                now,
                &PredictorIn {
                    drone: Some(drone),
                    estimate,
                    relative: relative.into_iter().collect(),
                    uvdar: uvdar.into_iter().collect(),
                    ..PredictorIn::default()
                },
            );
            if let Some(stage) = out.forecast.and_then(|f| f.at(now)) {
                self.newest = Some((stage.position.into(), drone.position()));
            }
        }
        #[track_caller]
        fn assert_stays(&self, before: &Vector3<f64>, within_m: f64) {
            let moved = self.apart() - before;
            assert!(moved.norm() < within_m, "{moved:?}");
        }
        fn detect(&mut self) {
            self.detection = Some(self.apart());
        }
        /// Estimated position of the deck relative to the drone, level, north up.
        fn apart(&self) -> Vector3<f64> {
            self.newest
                .map_or(Vector3::repeat(f64::NAN), |(deck, drone)| deck - drone)
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        /// The deck stays at the radio's position through any jump of heading and position.
        #[test]
        fn undetected_deck_at_any_jump(
            yaw in -3.1_f64..3.1,
            by in prop::array::uniform3(-60.0_f64..60.0),
            bearing in 0.0_f64..6.2,
            distance in 5.0_f64..80.0,
        ) {
            let deck = Vector3::new(distance * bearing.cos(), distance * bearing.sin(), 0.0);
            let mut b = Bench::new(Vector3::new(0.0, 0.0, -12.0), 0.5, deck);
            b.run(3.0);
            let before = b.apart();
            b.yaw += yaw;
            b.place += Vector3::from(by);
            b.run(0.1);
            // The drone has moved, but the radio's position relative to the datum has not.
            let moved = b.apart() - (before - Vector3::from(by));
            prop_assert!(moved.norm() < 0.3, "{moved:?} at {yaw} {by:?}");
        }

        /// The deck stays at the camera's position through any jump.
        #[test]
        fn detected_deck_at_any_jump(
            yaw in -3.1_f64..3.1,
            by in prop::array::uniform3(-20.0_f64..20.0),
        ) {
            // A heading change of less than 4 deg does not count as a jump and rotates the detections, here by up to 4
            // cm.
            let place = Vector3::new(0.0, 0.0, -4.0);
            let heading = 0.5;
            let mut b = Bench::new(place, heading, Vector3::new(0.5, 0.2, 0.0));
            b.run(2.0);
            let in_body = yaw_rotation(-heading) * b.apart();
            b.detection = Some(in_body);
            b.run(2.0);
            let before = yaw_rotation(-b.yaw) * b.apart();
            b.detection = None;
            b.yaw += yaw;
            b.place += Vector3::from(by);
            b.run(0.1);
            let after = yaw_rotation(-b.yaw) * b.apart();
            prop_assert!((after - before).norm() < 0.05, "{before:?} {after:?}");
        }
    }

    #[test]
    fn deck_by_relative_place_at_a_jump() {
        // The receiver measures the deck 55 m away and 2 m off the radio's position; there is no detection to rotate.
        let mut b = Bench::new(Vector3::new(0.0, 0.0, -10.0), 0.0, Vector3::new(55.0, 0.0, 0.0));
        b.run(2.0);
        b.relative = Some(b.apart() + Vector3::new(0.0, 2.0, 0.5));
        b.run(3.0);
        let before = b.apart();
        assert!((before - b.relative.unwrap()).norm() < 0.05, "{before:?}");
        b.relative = None;
        b.yaw = 2.0;
        b.place += Vector3::new(3.0, -4.0, 1.0);
        b.run(0.1);
        b.assert_stays(&before, 0.05);
    }

    #[test]
    fn deck_at_a_restart_of_the_vessel() {
        let mut b = Bench::new(Vector3::new(0.0, 0.0, -4.0), 0.0, Vector3::new(2.0, 0.0, 0.0));
        b.run(3.0);
        let before = b.apart();
        b.vessel = (2, Vector3::new(0.7, -0.9, -2.2));
        for _ in 0..20 {
            b.run(0.1);
            b.assert_stays(&before, 0.05);
        }
    }

    #[test]
    fn detected_deck_at_a_moved_origin() {
        let mut b = Bench::new(Vector3::new(0.0, 0.0, -4.0), 0.0, Vector3::new(2.0, 0.0, 0.0));
        b.run(2.0);
        b.detect();
        b.run(2.0);
        let before = b.apart();
        b.origin = Vector3::new(-20.0, 35.0, 1.0);
        b.newest = None;
        b.run(0.1);
        b.assert_stays(&before, 0.2);
        b.run(1.0);
        b.assert_stays(&before, 0.05);
    }

    #[test]
    fn heading_aligned_before_the_first_detection() {
        // The alignment turns the heading by 118 deg. If a deck 55 m away were rotated with it, it would be wrong
        // by 94 m.
        let mut b = Bench::new(Vector3::new(0.0, 0.0, -10.0), 0.0, Vector3::new(55.0, 0.0, 0.0));
        b.run(2.0);
        let before = b.apart();
        b.yaw = 118.0_f64.to_radians();
        b.run(2.0);
        b.assert_stays(&before, 0.2);
    }

    #[test]
    fn deck_detected_a_minute_ago_at_a_jump() {
        let mut b = Bench::new(Vector3::new(0.0, 0.0, -10.0), 0.0, Vector3::new(20.0, 0.0, 0.0));
        b.run(2.0);
        b.detect();
        b.run(1.0);
        b.detection = None;
        b.run(60.0);
        let before = b.apart();
        b.yaw = 2.0;
        b.run(0.5);
        b.assert_stays(&before, 1.5);
    }
}

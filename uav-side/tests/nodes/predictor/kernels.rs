//! Filter of one axis, and vision geometry, against closed forms.

use alight_shared::{
    frames::{body_from_camera, wxyz},
    msg::{RangeSample, TagPose},
    time::{DroneTime, Time},
};
use alight_uav::predictor::{
    PredictorConfig,
    axis::{Axis, AxisNoise, HEAD, MeasurementRow, OscillatorStep, RATE},
    filter::Filter,
    observation::{self, DeckObservation, ObservationKind, Plane},
    track::Pose,
    waves::Waves,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::world::{self, SimulatedVessel, header};

#[test]
fn axis_in_one_long_and_many_short_steps() {
    let config = PredictorConfig::default();
    let waves = Waves::new(&config);
    let noise = AxisNoise::all(&config)[2];
    let oscillators = waves.oscillators(Time::default());
    let mut a = Axis::new(&noise, &oscillators, 2, 1.0, 0.3, 0.0);
    a.update(MeasurementRow::Radio, 1.4, 0.01);
    a.update(MeasurementRow::Rate, -0.2, 0.04);
    let mut b = a;
    let step = OscillatorStep::new(&oscillators, 2.0);
    a.propagate(&noise, &oscillators, 2, &step);
    let step = OscillatorStep::new(&oscillators, 0.01);
    for _ in 0..200 {
        b.propagate(&noise, &oscillators, 2, &step);
    }
    for i in 0..a.n {
        assert!((a.x[i] - b.x[i]).abs() < 1e-9);
        for j in 0..a.n {
            let (p, q) = (a.p[i][j], b.p[i][j]);
            assert!((p - q).abs() < 1e-9, "{i} {j}: {p} {q}");
        }
    }
}

#[test]
fn axis_covariance_and_update() {
    let config = PredictorConfig::default();
    let waves = Waves::new(&config);
    let noise = AxisNoise::all(&config)[3];
    let oscillators = waves.oscillators(Time::default());
    let mut a = Axis::new(&noise, &oscillators, 3, 0.0, 0.01, 0.0);
    let before = a;
    let step = OscillatorStep::new(&oscillators, 7.0);
    a.propagate(&noise, &oscillators, 3, &step);
    for i in HEAD..a.n {
        assert!((a.p[i][i] / before.p[i][i] - 1.0).abs() < 1e-9, "state {i}");
    }
    let (_, spread) = a.project(MeasurementRow::Vision);
    a.update(MeasurementRow::Vision, 0.05, 1e-4);
    let (value, left) = a.project(MeasurementRow::Vision);
    // Scalar closed form: (1/P + 1/R)^-1, and the weighted mean.
    let expected = 1.0 / (1.0 / spread + 1.0 / 1e-4);
    assert!((left / expected - 1.0).abs() < 1e-9);
    assert!((value - 0.05 * expected / 1e-4).abs() < 1e-9);
}

#[test]
fn tag_and_rangefinder_observations() {
    let c = PredictorConfig::default();
    let deck = UnitQuaternion::from_euler_angles(0.1, -0.15, 0.6);
    let centre = Vector3::new(3.0, -2.0, -1.4);
    let drone = Pose {
        position: Vector3::new(3.2, -2.1, -4.0),
        attitude: UnitQuaternion::from_euler_angles(-0.05, 0.08, 0.9),
        variance: Vector3::zeros(),
    };
    let camera = drone.attitude.to_rotation_matrix().into_inner() * body_from_camera();
    let lens = drone.position + drone.attitude * Vector3::from(c.drone.camera_m);
    let relative = camera.transpose() * (centre - lens);
    let tag = TagPose {
        header: header(1, 1.0),
        position: relative.into(),
        attitude: wxyz(&UnitQuaternion::from_matrix(
            &(camera.transpose() * deck.to_rotation_matrix().into_inner()),
        )),
        variance: [1e-4; 6],
    };
    let o = observation::tag(&tag, &drone, &c);
    for i in 0..3 {
        assert!((o.value[i].unwrap().0 - centre[i]).abs() < 1e-6);
    }
    let (roll, pitch) =
        alight_shared::vessel_model::turn_tilt(o.value[3].unwrap().0, o.value[4].unwrap().0, 0.6);
    assert!((roll - 0.1).abs() < 1e-6 && (pitch + 0.15).abs() < 1e-6);
    assert!((o.value[5].unwrap().0 - 0.6).abs() < 1e-6);

    // Intersection of the rangefinder's beam with the deck's plane.
    let beam = drone.attitude * Vector3::z();
    let start = drone.position + drone.attitude * Vector3::from(c.drone.rangefinder_m);
    let normal = deck * Vector3::z();
    let range_m = normal.dot(&(centre - start)) / normal.dot(&beam);
    let sample = RangeSample {
        header: header(1, 1.0),
        range_m,
        variance: 9e-4,
    };
    let plane = Plane {
        centre,
        rotation: deck,
        position_sd: 0.05,
        tilt_sd: 0.01,
    };
    let o = observation::range(&sample, &drone, &plane, &c).unwrap();
    assert!((o.value[2].unwrap().0 - centre.z).abs() < 1e-6);
    let away = Plane {
        centre: centre + Vector3::new(0.0, 1.5, 0.0),
        ..plane
    };
    assert!(observation::range(&sample, &drone, &away, &c).is_none());
}

#[test]
fn filter_of_a_turning_vessel() {
    // Given a vessel at 2 m/s to the north that turns at 0.3 rad/s,
    let config = PredictorConfig::default();
    let waves = Waves::new(&config);
    let turn = 0.3;
    let at = |t: f64| {
        let (s, c) = f64::sin_cos(turn * t);
        let radius = 2.0 / turn;
        let known = |v: f64| Some((v, 1e-4));
        let [north, east] = [radius * s, radius * (1.0 - c)];
        let heading = Some((turn * t, 1e-6));
        DeckObservation {
            at: DroneTime::from_secs(t),
            kind: ObservationKind::Estimate,
            value: [
                known(north),
                known(east),
                known(0.0),
                known(0.0),
                known(0.0),
                heading,
            ],
            rate: [
                known(2.0 * c),
                known(2.0 * s),
                known(0.0),
                None,
                None,
                Some((turn, 1e-6)),
            ],
            from_drone: Vector3::zeros(),
        }
    };
    let mut filter = Filter::new(AxisNoise::all(&config), config.gate_sd, &waves, &at(0.0));
    for k in 1..300 {
        filter.fuse(&waves, &at(f64::from(k) * 0.033));
    }
    // when reports stop for half a second,
    let now = 299.0 * 0.033;
    let before = filter.at(&waves, Time::from_secs(now));
    let after = filter.at(&waves, Time::from_secs(now + 0.5));
    // then the mean velocity has turned and kept its magnitude,
    let heading = |s: &alight_uav::predictor::filter::FilterState| s[1].x[RATE].atan2(s[0].x[RATE]);
    let speed = |s: &alight_uav::predictor::filter::FilterState| s[1].x[RATE].hypot(s[0].x[RATE]);
    let turned = alight_shared::frames::wrap_angle(heading(&after) - heading(&before));
    assert!((0.08..0.17).contains(&turned), "{turned}");
    assert!((speed(&after) / speed(&before) - 1.0).abs() < 0.02);
    // and it is less certain than on a vessel at rest, but only while the radio is received.
    let walk = |f: &Filter, s| f.noise(s)[0].rate_walk;
    let still = AxisNoise::all(&config)[0].rate_walk;
    assert!(walk(&filter, &after) > 4.0 * still);
    filter.set_radio_available(false);
    assert_eq!(walk(&filter, &after), still);
}

/// New modes have the opposite phase, half a metre each, although the deck has not moved.
#[test]
fn newer_modes_with_vision() {
    let config = PredictorConfig::default();
    let vessel = SimulatedVessel::moderate();
    let mut waves = Waves::new(&config);
    waves.receive_prediction(&world::spread(1, 0.9));
    waves.receive(&world::waves(&vessel, 1, 0.9));
    let deck = |t: f64| DeckObservation {
        at: DroneTime::from_secs(t),
        kind: ObservationKind::Tag,
        value: [0.3, -0.2, -1.0, 0.02, -0.01, 0.1].map(|v| Some((v, 1e-5))),
        rate: [None; 6],
        from_drone: Vector3::zeros(),
    };
    let noise = AxisNoise::all(&config);
    let mut filter = Filter::new(noise, config.gate_sd, &waves, &deck(0.9));
    for k in 1..20 {
        filter.fuse(&waves, &deck(0.9 + 0.02 * f64::from(k)));
    }
    let now = Time::from_secs(1.29);
    let place = |filter: &Filter, waves: &Waves| {
        let state = filter.at(waves, now);
        let modes = waves.motion(now);
        [0, 1, 2, 3, 4, 5].map(|i| state[i].project(MeasurementRow::Vision).0 + modes.value[i])
    };
    let before = place(&filter, &waves);
    // Valid from the middle of these observations on, with the opposite content.
    let mut newer = world::waves(&vessel, 2, 1.1);
    for mode in newer.modes.iter_mut() {
        mode.shape = mode.shape.map(|c| c.map(|x| -x));
    }
    waves.receive(&newer);
    filter.rebase(&waves, newer.header.at);
    for (i, (a, b)) in before.into_iter().zip(place(&filter, &waves)).enumerate() {
        assert!((a - b).abs() < 0.01, "{i}: {a} {b}");
    }
}

/// In calm water the vessel's modes, which predict nothing, replace the bank; for a vessel without modes the bank is
/// kept.
#[test]
fn modes_without_confidence() {
    let mut waves = Waves::new(&PredictorConfig::default());
    waves.receive_prediction(&world::spread(1, 0.9));
    let mut model = world::waves(&SimulatedVessel::moderate(), 1, 0.9);
    let modes = core::mem::take(&mut model.modes);
    assert!(!waves.receive(&model) && !waves.are_identified());
    let heave = |waves: &Waves| -> f64 {
        let all = waves.oscillators(Time::from_secs(1.0));
        all.iter().map(|o| o.sd[2].powi(2)).sum::<f64>().sqrt()
    };
    let unknown = heave(&waves);
    model.header = header(2, 1.0);
    model.modes = modes;
    model.confidence = 0.0;
    assert!(waves.receive(&model) && waves.are_identified());
    assert!(heave(&waves) < 0.1 * unknown, "{} {unknown}", heave(&waves));
}

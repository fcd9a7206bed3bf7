//! The predictor against a deck made of sinusoids: given a motion, messages as vessel and camera
//! would send them, then what it says of now and of a second ahead.

#![allow(clippy::unwrap_used)] // Helpers of a test may.

use std::collections::VecDeque;

use alight_shared::frames::wrap_angle;
use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{
    DeckForecast, DeckStage, DroneState, Header, LinkState, Message, RangeSample, Source, TagPose, UvdarFix,
    VesselEstimate, WaveComponent, WaveModel,
};
use alight_shared::node::Node;
use alight_shared::seq::Seq;
use alight_shared::time::{DroneClock, Time};
use alight_uav::predictor::axis::{Axis, AxisNoise, Row, Step};
use alight_uav::predictor::observation::{self, Mount, Plane, body_from_camera};
use alight_uav::predictor::track::Pose;
use alight_uav::predictor::waves::Waves;
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn, Rejection};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

fn time(s: f64) -> Time<DroneClock> {
    Time::from_secs(s)
}

/// One sinusoid: amplitude of the surface (m), frequency (rad/s), direction (rad), phase (rad).
#[derive(Clone, Copy)]
struct Wave {
    amplitude: f64,
    omega: f64,
    direction: f64,
    phase: f64,
}

/// A vessel that follows the surface: heave, orbital motion, slope. With a mean velocity north.
#[derive(Clone)]
struct Vessel {
    waves: Vec<Wave>,
    speed: f64,
    heading: f64,
}

impl Vessel {
    fn moderate() -> Self {
        let wave = |amplitude, omega, direction, phase| Wave {
            amplitude,
            omega,
            direction,
            phase,
        };
        Vessel {
            waves: vec![
                wave(0.5, 1.26, 0.4, 0.3),
                wave(0.42, 1.38, 0.8, 1.9),
                wave(0.6, 1.15, 0.0, 4.0),
            ],
            speed: 0.2,
            heading: 0.7,
        }
    }
    /// Reference point (NED) and Euler angles.
    fn eta(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let mut p = Vector3::new(self.speed * t, 0.0, 0.0);
        let (mut n, mut e) = (0.0, 0.0);
        for w in &self.waves {
            let (s, c) = (w.omega * t + w.phase).sin_cos();
            let (ds, dc) = w.direction.sin_cos();
            p += Vector3::new(
                0.8 * w.amplitude * s * dc,
                0.8 * w.amplitude * s * ds,
                w.amplitude * c,
            );
            let slope = w.omega * w.omega / 9.81 * w.amplitude * s;
            n += slope * dc;
            e += slope * ds;
        }
        let (s, c) = self.heading.sin_cos();
        let (along, across) = (c * n + s * e, -s * n + c * e);
        (p, Vector3::new(-across, along, self.heading + 0.1 * across))
    }
    fn rates(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let h = 1e-4;
        let (a, b) = (self.eta(t - h), self.eta(t + h));
        ((b.0 - a.0) / (2.0 * h), (b.1 - a.1) / (2.0 * h))
    }
    fn accelerations(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let h = 1e-3;
        let (a, b) = (self.rates(t - h), self.rates(t + h));
        ((b.0 - a.0) / (2.0 * h), (b.1 - a.1) / (2.0 * h))
    }
    /// Deck centre and its attitude.
    fn deck(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (p, e) = self.eta(t);
        (
            p + Rotation3::from_euler_angles(e.x, e.y, e.z) * Vector3::new(0.0, 0.0, -1.3),
            e,
        )
    }
}

/// A slow error.
struct Markov {
    value: Vector3<f64>,
    sd: f64,
    time: f64,
}
impl Markov {
    fn new(rng: &mut ChaCha8Rng, sd: f64, time: f64) -> Self {
        Markov {
            value: normal3(rng) * sd,
            sd,
            time,
        }
    }
    fn step(&mut self, rng: &mut ChaCha8Rng, dt: f64) -> Vector3<f64> {
        let a = (-dt / self.time).exp();
        self.value = self.value * a + normal3(rng) * (self.sd * (1.0 - a * a).sqrt());
        self.value
    }
}
fn normal3(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

/// What is switched on.
#[derive(Clone, Copy)]
struct Setup {
    seed: u64,
    /// Radio is there before this time, s.
    radio_until: f64,
    /// Sight is there from this time to that, s.
    sight: (f64, f64),
    /// Extra age of what the radio claims, s.
    clock_error: f64,
    clock_sd: f64,
    /// Radio latency: least and spread, s.
    latency: (f64, f64),
    height: f64,
}
impl Default for Setup {
    fn default() -> Self {
        Setup {
            seed: 1,
            radio_until: 1e9,
            sight: (10.0, 1e9),
            clock_error: 0.0,
            clock_sd: 0.01,
            latency: (0.03, 0.04),
            height: 7.0,
        }
    }
}

/// One forecast with the truth, as the drone's frame sees it at `now`.
struct Sample {
    now: f64,
    forecast: DeckForecast,
    /// Drone's GNSS error at `now`.
    frame: Vector3<f64>,
}
impl Sample {
    /// Errors of position and of Euler angles `ahead` seconds from now, with the stage.
    fn error(&self, v: &Vessel, ahead: f64) -> (Vector3<f64>, Vector3<f64>, DeckStage) {
        let s = self.forecast.at(time(self.now + ahead)).unwrap();
        let (p, e) = v.deck(self.now + ahead);
        let mut turn = Vector3::from(s.euler) - e;
        turn.z = wrap_angle(turn.z);
        (Vector3::from(s.position) - self.frame - p, turn, s)
    }
}

struct Run {
    samples: Vec<Sample>,
    predictor: Predictor,
}

fn header(k: u32, at: f64) -> Header<DroneClock> {
    Header::new(1, 0, 1, k, time(at))
}

fn run(v: &Vessel, set: &Setup, seconds: f64, config: &PredictorConfig) -> Run {
    let mut rng = ChaCha8Rng::seed_from_u64(set.seed);
    let mut predictor = Predictor::new(config, 1);
    let geometry = DroneGeometry::default();
    let mut vessel_frame = Markov::new(&mut rng, 1.0, 300.0);
    let mut drone_frame = Markov::new(&mut rng, 1.0, 300.0);
    // The vessel's filtered errors.
    let mut position_error = Markov::new(&mut rng, 0.08, 1.0);
    let mut velocity_error = Markov::new(&mut rng, 0.08, 0.5);
    let mut angle_error = Markov::new(&mut rng, 0.006, 1.0);
    let mut rate_error = Markov::new(&mut rng, 0.004, 0.3);
    let mount = UnitQuaternion::from_scaled_axis(normal3(&mut rng) * 0.6_f64.to_radians());
    let mut in_flight: VecDeque<(f64, PredictorIn)> = VecDeque::new();
    let mut samples = Vec::new();
    for k in 0..(seconds * 100.0) as u32 {
        let now = f64::from(k) * 0.01;
        let dt = 0.01;
        let vf = vessel_frame.step(&mut rng, dt);
        let df = drone_frame.step(&mut rng, dt);
        let pe = position_error.step(&mut rng, dt);
        let ve = velocity_error.step(&mut rng, dt);
        let ae = angle_error.step(&mut rng, dt);
        let re = rate_error.step(&mut rng, dt);
        let (p, e) = v.eta(now);
        let (vel, rates) = v.rates(now);
        if k % 3 == 0 && now < set.radio_until {
            let (acc, angular) = v.accelerations(now);
            let six = |a: Vector3<f64>, b: Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
            let block = |a: f64, b: f64| [(a * a) as f32, 0.0, (b * b) as f32];
            let m = VesselEstimate {
                header: header(k, now + set.clock_error),
                datum: Default::default(),
                eta: six(p + vf + pe, e + ae),
                eta_dot: six(vel + ve, rates + re).map(|x| x as f32),
                eta_ddot: six(acc, angular).map(|x| x as f32),
                covariance: [
                    block(0.08, 0.08),
                    block(0.08, 0.08),
                    block(0.08, 0.08),
                    block(0.006, 0.004),
                    block(0.006, 0.004),
                    block(0.006, 0.004),
                ],
                deck_centre: [0.0, 0.0, -1.3],
                mean_velocity: [v.speed as f32, 0.0],
                mean_heading: [v.heading as f32, 0.0],
            };
            let late: f64 = StandardNormal.sample(&mut rng);
            let due = now + set.latency.0 + set.latency.1 * late.abs();
            in_flight.push_back((
                due,
                PredictorIn {
                    estimate: Some(m),
                    ..Default::default()
                },
            ));
        }
        if k % 20 == 0 && now < set.radio_until {
            let due = now + set.latency.0 + set.latency.1;
            let wave = Some(waves(v, k, now));
            in_flight.push_back((
                due,
                PredictorIn {
                    wave,
                    ..Default::default()
                },
            ));
        }
        let above = v.deck(now).0;
        let drone = Vector3::new(above.x, above.y, -1.3 - set.height) + Vector3::new(0.3, -0.2, 0.0);
        let attitude = UnitQuaternion::from_euler_angles(0.02, -0.03, v.heading);
        let state = DroneState {
            header: header(k, now),
            position: (drone + df).into(),
            velocity: [0.0; 3],
            attitude: [attitude.w, attitude.i, attitude.j, attitude.k],
            position_sd: [0.02; 3],
            ..Default::default()
        };
        if k % 3 == 1 && (set.sight.0..set.sight.1).contains(&now) {
            let camera = attitude.to_rotation_matrix().into_inner()
                * mount.to_rotation_matrix().into_inner()
                * body_from_camera();
            let (centre, angles) = v.deck(now);
            let lens = drone + attitude * Vector3::from(geometry.camera_m);
            let seen = camera.transpose() * (centre - lens);
            let turned =
                camera.transpose() * Rotation3::from_euler_angles(angles.x, angles.y, angles.z).into_inner();
            let z = seen.z;
            let sd = Vector3::new(0.002 * z, 0.002 * z, 0.002 * z * z);
            let asd = 0.01 * z;
            let noise = UnitQuaternion::from_scaled_axis(normal3(&mut rng) * asd);
            let q = noise * UnitQuaternion::from_matrix(&turned);
            let tag = TagPose {
                header: header(k, now),
                position: (seen + sd.component_mul(&normal3(&mut rng))).into(),
                attitude: [q.w, q.i, q.j, q.k],
                variance: [
                    sd.x * sd.x,
                    sd.y * sd.y,
                    sd.z * sd.z,
                    asd * asd,
                    asd * asd,
                    asd * asd,
                ],
            };
            in_flight.push_back((
                now + 0.05,
                PredictorIn {
                    tags: vec![tag],
                    ..Default::default()
                },
            ));
        }
        let link = (k % 10 == 0).then(|| LinkState {
            header: header(k, now),
            clock_offset_sd_s: set.clock_sd,
            ..Default::default()
        });
        let (arrived, rest): (VecDeque<_>, VecDeque<_>) = in_flight.into_iter().partition(|(t, _)| *t <= now);
        in_flight = rest;
        let mut input = PredictorIn {
            drone: Some(state),
            link,
            ..Default::default()
        };
        for (_, m) in arrived {
            // State streams keep the newest.
            if let Some(e) = m.estimate
                && input
                    .estimate
                    .is_none_or(|o: VesselEstimate<DroneClock>| o.header.at < e.header.at)
            {
                input.estimate = Some(e);
            }
            input.wave = m.wave.or(input.wave);
            input.tags.extend(m.tags);
        }
        if let Some(forecast) = predictor.step(time(now), &input).forecast {
            forecast.check().unwrap();
            samples.push(Sample {
                now,
                forecast,
                frame: df,
            });
        }
    }
    Run { samples, predictor }
}

fn waves(v: &Vessel, k: u32, now: f64) -> WaveModel<DroneClock> {
    WaveModel {
        header: header(k, now),
        significant_height_m: 2.0,
        confidence: 0.9,
        components: Seq::filled(v.waves.iter().map(|w| {
            let slope = w.omega * w.omega / 9.81 * w.amplitude;
            let sd = [
                w.omega * w.omega * w.amplitude * 0.5,
                w.omega * w.omega * w.amplitude * 0.5,
                w.amplitude * 0.7,
                slope * 0.5,
                slope * 0.5,
                0.01,
            ];
            WaveComponent {
                // Identified to a tenth of a per cent.
                omega: (w.omega * 1.001) as f32,
                omega_encounter: (w.omega * 1.001) as f32,
                direction: w.direction as f32,
                direction_sd: 1.5,
                damping: 0.01,
                drive: sd.map(|s| (4.0 * 0.01 * w.omega.powi(3) * s * s) as f32),
                ..Default::default()
            }
        })),
    }
}

/// Root mean square over samples: horizontal, vertical (m), tilt (rad); and the mean normalised
/// squared error per degree of freedom of position and of roll and pitch.
struct Figures {
    horizontal: f64,
    vertical: f64,
    tilt: f64,
    nees_position: f64,
    nees_tilt: f64,
}
fn figures<'a>(v: &Vessel, samples: impl Iterator<Item = &'a Sample>, ahead: f64) -> Figures {
    let mut f = Figures {
        horizontal: 0.0,
        vertical: 0.0,
        tilt: 0.0,
        nees_position: 0.0,
        nees_tilt: 0.0,
    };
    let mut n = 0.0;
    for s in samples {
        let (p, e, stage) = s.error(v, ahead);
        n += 1.0;
        f.horizontal += p.x * p.x + p.y * p.y;
        f.vertical += p.z * p.z;
        f.tilt += e.x * e.x + e.y * e.y;
        f.nees_position += (0..3).map(|i| (p[i] / stage.position_sd[i]).powi(2)).sum::<f64>() / 3.0;
        f.nees_tilt += (0..2).map(|i| (e[i] / stage.euler_sd[i]).powi(2)).sum::<f64>() / 2.0;
    }
    assert!(n > 10.0, "{n} samples");
    Figures {
        horizontal: (f.horizontal / n).sqrt(),
        vertical: (f.vertical / n).sqrt(),
        tilt: (f.tilt / n).sqrt(),
        nees_position: f.nees_position / n,
        nees_tilt: f.nees_tilt / n,
    }
}
/// The figures over several seeds from `from` s on.
fn over_seeds(v: &Vessel, set: &Setup, seconds: f64, from: f64, ahead: f64) -> Figures {
    let runs: Vec<Run> = (0..5)
        .map(|seed| run(v, &Setup { seed, ..*set }, seconds, &PredictorConfig::default()))
        .collect();
    let f = figures(
        v,
        runs.iter().flat_map(|r| &r.samples).filter(|s| s.now > from),
        ahead,
    );
    println!(
        "{ahead} s ahead: horizontal {:.3} m, vertical {:.3} m, tilt {:.2} deg, NEES {:.2} {:.2}",
        f.horizontal,
        f.vertical,
        f.tilt.to_degrees(),
        f.nees_position,
        f.nees_tilt
    );
    f
}

#[test]
fn with_radio_and_sight_the_deck_is_known_to_centimetres() {
    let v = Vessel::moderate();
    let set = Setup {
        height: 3.0,
        ..Default::default()
    };
    let near = over_seeds(&v, &set, 60.0, 30.0, 0.2);
    let far = over_seeds(&v, &set, 60.0, 30.0, 1.0);
    assert!(near.horizontal < 0.06 && near.vertical < 0.045 && near.tilt.to_degrees() < 0.7);
    // Frames that wander by 8 cm in a second, as raw as here, cost some of it.
    assert!(far.horizontal < 0.12 && far.vertical < 0.09 && far.tilt.to_degrees() < 1.0);
    // The covariance says so, and is not absurdly cautious.
    assert!((0.1..2.0).contains(&near.nees_position), "{}", near.nees_position);
    assert!((0.1..2.0).contains(&near.nees_tilt), "{}", near.nees_tilt);
    assert!((0.1..2.0).contains(&far.nees_position), "{}", far.nees_position);
}

#[test]
fn the_sight_finds_the_offset_between_the_two_frames() {
    let v = Vessel::moderate();
    let r = run(
        &v,
        &Setup {
            seed: 3,
            ..Default::default()
        },
        40.0,
        &PredictorConfig::default(),
    );
    let radio_only = figures(&v, r.samples.iter().filter(|s| s.now > 5.0 && s.now < 10.0), 0.0);
    let both = figures(&v, r.samples.iter().filter(|s| s.now > 20.0), 0.0);
    assert!(
        radio_only.horizontal > 0.3,
        "the frames differ: {}",
        radio_only.horizontal
    );
    assert!(
        radio_only.nees_position < 4.0,
        "and it is known: {}",
        radio_only.nees_position
    );
    assert!(both.horizontal < 0.15, "{}", both.horizontal);
    let source = |t: f64| {
        r.samples
            .iter()
            .rev()
            .find(|s| s.now < t)
            .unwrap()
            .forecast
            .source
    };
    assert_eq!((source(9.9), source(39.9)), (Source::Radio, Source::Both));
}

#[test]
fn in_silence_the_forecast_goes_on_and_grows_less_certain() {
    let v = Vessel::moderate();
    let set = Setup {
        radio_until: 20.0,
        sight: (5.0, 20.0),
        ..Default::default()
    };
    let r = run(&v, &set, 26.0, &PredictorConfig::default());
    let sd = |t: f64| {
        let s = r.samples.iter().find(|s| s.now >= t).unwrap();
        (
            s.forecast.stages[0].position_sd[0],
            s.forecast.stages[0].euler_sd[1],
        )
    };
    assert!(sd(25.0).0 > 1.5 * sd(21.0).0 && sd(21.0).0 > sd(19.0).0);
    assert!(sd(25.0).1 > sd(19.0).1);
    let last = r.samples.last().unwrap();
    assert_eq!(last.forecast.source, Source::None);
    assert!((last.forecast.radio_age_s - 6.0).abs() < 0.3);
    let f = figures(&v, r.samples.iter().filter(|s| s.now > 21.0), 0.0);
    assert!(
        f.nees_position < 2.0 && f.nees_tilt < 2.0,
        "{} {}",
        f.nees_position,
        f.nees_tilt
    );
}

#[test]
fn with_the_radio_gone_the_sight_alone_carries_on() {
    let v = Vessel::moderate();
    let set = Setup {
        radio_until: 25.0,
        height: 4.0,
        ..Default::default()
    };
    let f = over_seeds(&v, &set, 60.0, 35.0, 1.0);
    assert!(f.horizontal < 0.16 && f.vertical < 0.12 && f.tilt.to_degrees() < 1.2);
    assert!(
        f.nees_position < 2.0 && f.nees_tilt < 2.5,
        "{} {}",
        f.nees_position,
        f.nees_tilt
    );
}

#[test]
fn without_any_radio_the_default_bank_and_the_sight_give_a_usable_deck() {
    let v = Vessel::moderate();
    let set = Setup {
        radio_until: 0.0,
        sight: (0.0, 1e9),
        height: 4.0,
        ..Default::default()
    };
    let f = over_seeds(&v, &set, 60.0, 20.0, 0.5);
    assert!(f.horizontal < 0.3 && f.vertical < 0.35 && f.tilt.to_degrees() < 4.5);
    assert!(
        f.nees_position < 2.0 && f.nees_tilt < 2.0,
        "{} {}",
        f.nees_position,
        f.nees_tilt
    );
}

#[test]
fn a_clock_error_within_its_sd_moves_the_deck_by_no_more_than_the_covariance() {
    let v = Vessel::moderate();
    // 100 ms of asymmetry: an offset that is 50 ms wrong, of which the bridge says 58 ms.
    let set = Setup {
        clock_error: 0.05,
        clock_sd: 0.058,
        height: 3.0,
        ..Default::default()
    };
    for ahead in [0.2, 1.0] {
        let f = over_seeds(&v, &set, 50.0, 25.0, ahead);
        assert!(
            f.nees_position < 2.0 && f.nees_tilt < 2.0,
            "{} {}",
            f.nees_position,
            f.nees_tilt
        );
    }
}

#[test]
fn reordered_messages_give_the_same_deck_as_ordered_ones() {
    let v = Vessel::moderate();
    let calm = Setup {
        latency: (0.06, 0.0),
        ..Default::default()
    };
    let wild = Setup {
        latency: (0.06, 0.15),
        ..Default::default()
    };
    let (a, b) = (
        run(&v, &calm, 30.0, &PredictorConfig::default()),
        run(&v, &wild, 30.0, &PredictorConfig::default()),
    );
    let f = |r: &Run| figures(&v, r.samples.iter().filter(|s| s.now > 20.0), 0.2);
    let (fa, fb) = (f(&a), f(&b));
    assert!(
        fb.horizontal < fa.horizontal + 0.03 && fb.tilt < fa.tilt + 0.005,
        "{} {}",
        fa.tilt,
        fb.tilt
    );
    assert_eq!(b.predictor.rejections().of(Rejection::Late), 0);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let v = Vessel::moderate();
    let one = run(&v, &Setup::default(), 15.0, &PredictorConfig::default());
    let two = run(&v, &Setup::default(), 15.0, &PredictorConfig::default());
    assert!(
        one.samples
            .iter()
            .zip(&two.samples)
            .all(|(a, b)| a.forecast == b.forecast)
    );
    assert_eq!(one.samples.len(), two.samples.len());
}

/// Any number, absurd ones included.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -10.0..10.0f64,
        any::<f64>(),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(-1e300)
    ]
}

#[test]
fn one_long_step_equals_many_short_ones() {
    let config = PredictorConfig::default();
    let waves = Waves::new(&config);
    let noise = AxisNoise::all(&config)[2];
    let mut a = Axis::new(&noise, waves.oscillators(), 2, 1.0, 0.3, 0.0);
    a.update(Row::Radio, 1.4, 0.01);
    a.update(Row::Rate, -0.2, 0.04);
    let mut b = a;
    a.propagate(
        &noise,
        waves.oscillators(),
        2,
        &Step::new(waves.oscillators(), 2.0),
    );
    for _ in 0..200 {
        b.propagate(
            &noise,
            waves.oscillators(),
            2,
            &Step::new(waves.oscillators(), 0.01),
        );
    }
    for i in 0..a.n {
        assert!((a.x[i] - b.x[i]).abs() < 1e-9);
        for j in 0..a.n {
            assert!(
                (a.p[i][j] - b.p[i][j]).abs() < 1e-9,
                "{i} {j}: {} {}",
                a.p[i][j],
                b.p[i][j]
            );
        }
    }
}

#[test]
fn an_undisturbed_axis_keeps_its_stationary_spread_and_an_update_only_shrinks_it() {
    let config = PredictorConfig::default();
    let waves = Waves::new(&config);
    let noise = AxisNoise::all(&config)[3];
    let mut a = Axis::new(&noise, waves.oscillators(), 3, 0.0, 0.01, 0.0);
    let before = a;
    a.propagate(
        &noise,
        waves.oscillators(),
        3,
        &Step::new(waves.oscillators(), 7.0),
    );
    for i in 4..a.n {
        assert!((a.p[i][i] / before.p[i][i] - 1.0).abs() < 1e-9, "state {i}");
    }
    let (_, spread) = a.project(Row::Vision);
    a.update(Row::Vision, 0.05, 1e-4);
    let (value, left) = a.project(Row::Vision);
    // Of a scalar: (1/P + 1/R)^-1, and the weighted mean.
    let expected = 1.0 / (1.0 / spread + 1.0 / 1e-4);
    assert!((left / expected - 1.0).abs() < 1e-9);
    assert!((value - 0.05 * expected / 1e-4).abs() < 1e-9);
}

#[test]
fn tag_and_rangefinder_find_the_deck_they_look_at() {
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
    let seen = camera.transpose() * (centre + deck * Vector3::from(c.deck.tag_centre_m) - lens);
    let q = UnitQuaternion::from_matrix(&(camera.transpose() * deck.to_rotation_matrix().into_inner()));
    let tag = TagPose {
        header: header(1, 1.0),
        position: seen.into(),
        attitude: [q.w, q.i, q.j, q.k],
        variance: [1e-4; 6],
    };
    let o = observation::tag(&tag, &drone, &Mount::default(), &c);
    for i in 0..3 {
        assert!((o.value[i].unwrap().0 - centre[i]).abs() < 1e-6);
    }
    let (roll, pitch) =
        alight_shared::vessel_model::turn_tilt(o.value[3].unwrap().0, o.value[4].unwrap().0, 0.6);
    assert!((roll - 0.1).abs() < 1e-6 && (pitch + 0.15).abs() < 1e-6);
    assert!((o.value[5].unwrap().0 - 0.6).abs() < 1e-6);

    // The beam from the rangefinder meets the deck's plane.
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
    // Beside the deck it says nothing.
    let away = Plane {
        centre: centre + Vector3::new(0.0, 1.5, 0.0),
        ..plane
    };
    assert!(observation::range(&sample, &drone, &away, &c).is_none());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn garbage_is_counted_and_does_no_harm(
        x in prop::collection::vec(any_number(), 24), which in 0..7u8, at in prop_oneof![0.0..30.0f64, any_number()],
        from in 0..3u8,
    ) {
        let v = Vessel::moderate();
        let seconds = [0.0, 2.0, 12.0][usize::from(from)];
        let mut r = run(&v, &Setup::default(), seconds, &PredictorConfig::default());
        let before = r.predictor.rejections().total();
        let h = Header::new(1, 0, 1, 1_000_000, time(at));
        let a3 = |i: usize| [x[i], x[i + 1], x[i + 2]];
        let six = |i: usize| core::array::from_fn(|k| x[i + k]);
        let mut bad = PredictorIn::default();
        match which {
            0 => bad.tags = vec![TagPose { header: h, position: a3(0), attitude: [x[3], x[4], x[5], x[6]],
                variance: six(7) }; 3],
            1 => bad.uvdar = vec![UvdarFix { header: h, position: a3(0), variance: a3(3) }; 3],
            2 => bad.ranges = vec![RangeSample { header: h, range_m: x[0], variance: x[1] }; 3],
            3 => bad.drone = Some(DroneState { header: h, position: a3(0), velocity: a3(3), ..Default::default() }),
            4 => bad.link = Some(LinkState { header: h, clock_offset_sd_s: x[0], age_s: x[1], ..Default::default() }),
            5 => bad.estimate = Some(VesselEstimate { header: h, datum: Default::default(), eta: six(0),
                eta_dot: six(6).map(|v: f64| v as f32), eta_ddot: [x[12] as f32; 6],
                covariance: [[x[13] as f32, 0.0, x[14] as f32]; 6], deck_centre: [0.0, 0.0, -1.3],
                mean_velocity: [x[15] as f32; 2], mean_heading: [x[16] as f32; 2] }),
            _ => bad.wave = Some(WaveModel { header: h, significant_height_m: 1.0, confidence: x[0] as f32,
                components: Seq::filled([WaveComponent { omega: x[1] as f32, omega_encounter: x[2] as f32,
                    damping: x[3] as f32, state: [[x[4] as f32; 2]; 6], drive: [x[5] as f32; 6],
                    direction: x[6] as f32, direction_sd: x[7] as f32, ..Default::default() }; 6]) }),
        }
        let sane = match which {
            0 => bad.tags[0].check(),
            1 => bad.uvdar[0].check(),
            2 => bad.ranges[0].check(),
            3 => bad.drone.unwrap().check(),
            4 => bad.link.unwrap().check(),
            5 => bad.estimate.unwrap().check(),
            _ => bad.wave.unwrap().check(),
        };
        for k in 0..20 {
            let now = time(seconds + 0.01 * f64::from(k));
            if let Some(f) = r.predictor.step(now, &bad).forecast {
                prop_assert!(f.check().is_ok(), "{:?}", f.check());
                prop_assert!(f.stages.iter().all(|s| s.position_sd.iter().all(|v| v.is_finite())));
            }
        }
        if sane.is_err() {
            prop_assert!(r.predictor.rejections().total() >= before + 20);
        }
    }
}

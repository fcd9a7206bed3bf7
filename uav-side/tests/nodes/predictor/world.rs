use std::{ops::Range, rc::Rc};

use alight_shared::{
    frames::{body_from_camera, wrap_angle, wxyz},
    geometry::DroneGeometry,
    msg::{
        CarrierSolution, DeckForecast, DeckStage, DroneState, Header, LinkState, Message, PredictedStage,
        RangeSample, RelativePlace, Seq, TagPose, VesselEstimate, VesselPrediction, WaveMode, WaveModel, f16,
    },
    node::Node,
    time::{DroneClock, DroneTime, Time},
};
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn};
use nalgebra::{Complex, Rotation3, UnitQuaternion, Vector3};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};

pub fn time(s: f64) -> DroneTime {
    Time::from_secs(s)
}

/// Sinusoid: amplitude of the surface (m), frequency (rad/s), direction (rad), phase (rad).
#[derive(Clone, Copy)]
pub struct Wave {
    pub amplitude: f64,
    pub omega: f64,
    pub direction: f64,
    pub phase: f64,
}

/// Vessel that follows the surface with heave, orbital motion and slope, and moves north.
#[derive(Clone)]
pub struct SimulatedVessel {
    pub waves: Vec<Wave>,
    /// Fraction of the water's horizontal motion that the vessel follows.
    pub sway: f64,
    pub speed: f64,
    pub heading: f64,
}

impl SimulatedVessel {
    pub fn moderate() -> Self {
        let wave = |amplitude, omega, direction, phase| Wave {
            amplitude,
            omega,
            direction,
            phase,
        };
        SimulatedVessel {
            waves: vec![
                wave(0.5, 1.26, 0.4, 0.3),
                wave(0.42, 1.38, 0.8, 1.9),
                wave(0.6, 1.15, 0.0, 4.0),
            ],
            sway: 0.8,
            speed: 0.2,
            heading: 0.7,
        }
    }
    /// Position of the reference point (NED), and Euler angles.
    pub fn eta(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let mut p = Vector3::new(self.speed * t, 0.0, 0.0);
        let mut n = 0.0;
        let mut e = 0.0;
        for w in &self.waves {
            let (s, c) = (w.omega * t + w.phase).sin_cos();
            let (ds, dc) = w.direction.sin_cos();
            p += Vector3::new(
                self.sway * w.amplitude * s * dc,
                self.sway * w.amplitude * s * ds,
                w.amplitude * c,
            );
            let slope = w.omega * w.omega / 9.81 * w.amplitude * s;
            n += slope * dc;
            e += slope * ds;
        }
        let (s, c) = self.heading.sin_cos();
        let along = c * n + s * e;
        let across = -s * n + c * e;
        (p, Vector3::new(-across, along, self.heading + 0.1 * across))
    }
    pub fn rates(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let h = 1e-4;
        let a = self.eta(t - h);
        let b = self.eta(t + h);
        ((b.0 - a.0) / (2.0 * h), (b.1 - a.1) / (2.0 * h))
    }
    pub fn accelerations(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let h = 1e-3;
        let a = self.rates(t - h);
        let b = self.rates(t + h);
        ((b.0 - a.0) / (2.0 * h), (b.1 - a.1) / (2.0 * h))
    }
    /// Apparent slope over the second around `t`: tangent of the angle between the deck's normal and the mean specific
    /// force.
    pub fn apparent_slope(&self, t: f64) -> f64 {
        let h = 1e-2;
        let force = |t: f64| {
            let [a, b, c] = [t - h, t, t + h].map(|t| self.deck(t));
            let turn = Rotation3::from_euler_angles(b.1.x, b.1.y, b.1.z);
            turn.inverse() * ((a.0 - 2.0 * b.0 + c.0) / (h * h) - Vector3::z() * 9.81)
        };
        let f: Vector3<f64> = (0..=20).map(|k| force(t - 0.5 + 0.05 * f64::from(k))).sum();
        f.xy().norm() / -f.z
    }
    pub fn deck(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (p, e) = self.eta(t);
        (
            p + Rotation3::from_euler_angles(e.x, e.y, e.z) * Vector3::new(0.0, 0.0, -1.3),
            e,
        )
    }
}

/// First-order Gauss-Markov error.
pub struct Markov {
    pub value: Vector3<f64>,
    pub sd: f64,
    pub time: f64,
}
impl Markov {
    pub fn new(rng: &mut ChaCha8Rng, sd: f64, time: f64) -> Self {
        Markov {
            value: normal3(rng) * sd,
            sd,
            time,
        }
    }
    pub fn step(&mut self, rng: &mut ChaCha8Rng, dt: f64) -> Vector3<f64> {
        let a = (-dt / self.time).exp();
        self.value = self.value * a + normal3(rng) * (self.sd * (1.0 - a * a).sqrt());
        self.value
    }
}
pub fn normal3(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

#[derive(Clone, Copy)]
pub struct Setup {
    pub seed: u64,
    /// Time until which the radio is available, s.
    pub radio_until: f64,
    /// Time span with vision, s.
    pub vision: (f64, f64),
    /// Error of the radio's time stamps, s.
    pub clock_error: f64,
    pub clock_sd: f64,
    pub latency: (f64, f64),
    pub height: f64,
    /// Time of the first rangefinder reading, s.
    pub ranges_from: f64,
    /// Time span with a relative position, s.
    pub relative: (f64, f64),
    /// Time of a process restart, s, and whether the checkpoint is kept.
    pub restart: Option<(f64, bool)>,
}
impl Default for Setup {
    fn default() -> Self {
        Setup {
            seed: 1,
            radio_until: 1e9,
            vision: (10.0, 1e9),
            clock_error: 0.0,
            clock_sd: 0.01,
            latency: (0.03, 0.04),
            height: 7.0,
            ranges_from: f64::INFINITY,
            relative: (f64::INFINITY, f64::INFINITY),
            restart: None,
        }
    }
}

/// Forecast, with the truth in the drone's frame at `now`.
pub struct Sample {
    pub now: f64,
    pub forecast: DeckForecast,
    /// Error of the smoothed odometry every 10 ms, to beyond the end of the run: an initial offset and drift.
    pub frames: Rc<Vec<Vector3<f64>>>,
}
impl Sample {
    /// Errors of position and Euler angles `ahead` seconds from now, and the stage.
    pub fn error(&self, v: &SimulatedVessel, ahead: f64) -> (Vector3<f64>, Vector3<f64>, DeckStage) {
        let s = self.forecast.at(time(self.now + ahead)).unwrap();
        let (p, e) = v.deck(self.now + ahead);
        let mut turn = Vector3::from(s.euler) - e;
        turn.z = wrap_angle(turn.z);
        let frame = self.frames[((self.now + ahead) * 100.0).round() as usize];
        (Vector3::from(s.position) - frame - p, turn, s)
    }
}

pub struct Run {
    pub samples: Vec<Sample>,
    pub predictor: Predictor,
}

pub fn header(k: u32, at: f64) -> Header<DroneClock> {
    Header::new(1, 0, 1, k, time(at))
}

fn input(message: impl FnOnce(&mut PredictorIn)) -> PredictorIn {
    let mut i = PredictorIn::default();
    message(&mut i);
    i
}

fn drifting_frames(rng: &mut ChaCha8Rng, seconds: f64) -> Vec<Vector3<f64>> {
    let mut drift = Markov::new(rng, 0.05, 3.0);
    let mut frame = normal3(rng);
    (0..(seconds * 100.0) as u32)
        .map(|_| {
            frame += drift.step(rng, 0.01) * 0.01;
            frame
        })
        .collect()
}

/// Estimate with errors of the frame, of position and angles, and of their rates.
fn estimate(
    v: &SimulatedVessel,
    header: Header<DroneClock>,
    now: f64,
    [vf, pe, ae, ve, re]: [Vector3<f64>; 5],
) -> VesselEstimate<DroneClock> {
    let (p, e) = v.eta(now);
    let (vel, rates) = v.rates(now);
    let (acc, angular) = v.accelerations(now);
    let six = |a: Vector3<f64>, b: Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
    let block = |a: f64, b: f64| [a, b, 0.0].map(f16::from_f64);
    VesselEstimate {
        header,
        datum: Default::default(),
        eta: six(p + vf + pe, e + ae),
        eta_dot: six(vel + ve, rates + re).map(|x| x as f32),
        eta_ddot: six(acc, angular).map(f16::from_f64),
        uncertainty: core::array::from_fn(|i| {
            if i < 3 {
                block(0.08, 0.08)
            } else {
                block(0.006, 0.004)
            }
        }),
        deck_centre: [0.0, 0.0, -1.3],
        mean_velocity: [v.speed as f32, 0.0],
        mean_heading: [v.heading as f32, 0.0],
    }
}

fn odometry(
    header: Header<DroneClock>,
    position: Vector3<f64>,
    attitude: &UnitQuaternion<f64>,
) -> DroneState {
    DroneState {
        header,
        position: position.into(),
        velocity: [0.0; 3],
        attitude: wxyz(attitude),
        position_sd: [0.02; 3],
        ..Default::default()
    }
}

fn tag(
    rng: &mut ChaCha8Rng,
    header: Header<DroneClock>,
    (centre, angles): (Vector3<f64>, Vector3<f64>),
    (drone, attitude): (&Vector3<f64>, &UnitQuaternion<f64>),
    mount: &UnitQuaternion<f64>,
) -> TagPose {
    let camera = attitude.to_rotation_matrix().into_inner()
        * mount.to_rotation_matrix().into_inner()
        * body_from_camera();
    let lens = drone + attitude * Vector3::from(DroneGeometry::default().camera_m);
    let relative = camera.transpose() * (centre - lens);
    let turned = camera.transpose() * Rotation3::from_euler_angles(angles.x, angles.y, angles.z).into_inner();
    let z = relative.z;
    let sd = Vector3::new(0.002 * z, 0.002 * z, 0.002 * z * z);
    let asd = 0.01 * z;
    let noise = UnitQuaternion::from_scaled_axis(normal3(rng) * asd);
    TagPose {
        header,
        position: (relative + sd.component_mul(&normal3(rng))).into(),
        attitude: wxyz(&(noise * UnitQuaternion::from_matrix(&turned))),
        variance: [sd.x, sd.y, sd.z, asd, asd, asd].map(|s| s * s),
    }
}

fn range(
    header: Header<DroneClock>,
    (centre, e): (Vector3<f64>, Vector3<f64>),
    (drone, attitude): (&Vector3<f64>, &UnitQuaternion<f64>),
) -> RangeSample {
    let normal = Rotation3::from_euler_angles(e.x, e.y, e.z) * Vector3::z();
    let from = drone + attitude * Vector3::from(DroneGeometry::default().rangefinder_m);
    let beam = attitude * Vector3::z();
    RangeSample {
        header,
        range_m: (centre - from).dot(&normal) / beam.dot(&normal),
        variance: 0.03_f64.powi(2),
    }
}

/// Position relative to an antenna that is forward of the deck and above it.
fn relative(
    rng: &mut ChaCha8Rng,
    header: Header<DroneClock>,
    (centre, e): (Vector3<f64>, Vector3<f64>),
    (drone, attitude): (&Vector3<f64>, &UnitQuaternion<f64>),
) -> RelativePlace {
    let antenna_m = [1.5_f32, 0.5, -1.0];
    let turn = Rotation3::from_euler_angles(e.x, e.y, e.z);
    let vessels = centre + turn * Vector3::from(antenna_m.map(f64::from));
    let own = drone + attitude * Vector3::from(DroneGeometry::default().gnss_antenna_m);
    RelativePlace {
        header,
        baseline_m: (own - vessels + normal3(rng) * 0.01).into(),
        baseline_sd_m: [0.01; 3],
        solution: CarrierSolution::Fixed,
        antenna_m,
    }
}

/// Adds a message; state topics keep the newest.
fn receive(arrived: &mut PredictorIn, m: PredictorIn) {
    if let Some(e) = m.estimate
        && arrived.estimate.is_none_or(|o| o.header.at < e.header.at)
    {
        arrived.estimate = Some(e);
    }
    arrived.wave = m.wave.or(arrived.wave);
    arrived.prediction = m.prediction.or(arrived.prediction);
    arrived.tags.extend(m.tags);
    arrived.relative.extend(m.relative);
}

pub fn run(v: &SimulatedVessel, set: &Setup, seconds: f64) -> Run {
    run_with(v, set, seconds, |_, arrived| arrived)
}

/// Run whose inputs `change` replaces, given the number of the step.
pub fn run_with(
    v: &SimulatedVessel,
    set: &Setup,
    seconds: f64,
    mut change: impl FnMut(u32, PredictorIn) -> PredictorIn,
) -> Run {
    let mut rng = ChaCha8Rng::seed_from_u64(set.seed);
    let mut predictor = Predictor::new(&PredictorConfig::default(), 1);
    let mut vessel_frame = Markov::new(&mut rng, 1.0, 300.0);
    let frames = Rc::new(drifting_frames(&mut rng, seconds + 3.0));
    // Errors of the vessel's estimator.
    let mut position_error = Markov::new(&mut rng, 0.08, 1.0);
    let mut velocity_error = Markov::new(&mut rng, 0.08, 0.5);
    let mut angle_error = Markov::new(&mut rng, 0.006, 1.0);
    let mut rate_error = Markov::new(&mut rng, 0.004, 0.3);
    let mount = UnitQuaternion::from_scaled_axis(normal3(&mut rng) * 0.6_f64.to_radians());
    let mut in_flight = Vec::<(f64, PredictorIn)>::new();
    let mut samples = Vec::new();
    let mut kept = None;
    let mut given = None;
    for k in 0..(seconds * 100.0) as u32 {
        let now = f64::from(k) * 0.01;
        let dt = 0.01;
        let vf = vessel_frame.step(&mut rng, dt);
        let pe = position_error.step(&mut rng, dt);
        let ve = velocity_error.step(&mut rng, dt);
        let ae = angle_error.step(&mut rng, dt);
        let re = rate_error.step(&mut rng, dt);
        if k % 3 == 0 && now < set.radio_until {
            let header = header(k, now + set.clock_error);
            let m = estimate(v, header, now, [vf, pe, ae, ve, re]);
            let late: f64 = StandardNormal.sample(&mut rng);
            let due = now + set.latency.0 + set.latency.1 * late.abs();
            in_flight.push((due, input(|i| i.estimate = Some(m))));
        }
        if k % 20 == 0 && now < set.radio_until {
            let due = now + set.latency.0 + set.latency.1;
            let model = input(|i| (i.wave, i.prediction) = (Some(waves(v, k, now)), Some(spread(k, now))));
            in_flight.push((due, model));
        }
        let above = v.deck(now).0;
        let drone = Vector3::new(above.x, above.y, -1.3 - set.height) + Vector3::new(0.3, -0.2, 0.0);
        let attitude = UnitQuaternion::from_euler_angles(0.02, -0.03, v.heading);
        let state = odometry(header(k, now), drone + frames[k as usize], &attitude);
        if k % 3 == 1 && (set.vision.0..set.vision.1).contains(&now) {
            let tag = tag(&mut rng, header(k, now), v.deck(now), (&drone, &attitude), &mount);
            in_flight.push((now + 0.05, input(|i| i.tags.push(tag))));
        }
        if k % 20 == 7 && (set.relative.0..set.relative.1).contains(&now) {
            let m = relative(&mut rng, header(k, now), v.deck(now), (&drone, &attitude));
            in_flight.push((now + 0.12, input(|i| i.relative.push(m))));
        }
        let range = (k % 4 == 2 && now >= set.ranges_from)
            .then(|| range(header(k, now), v.deck(now), (&drone, &attitude)));
        let link = (k % 10 == 0).then(|| LinkState {
            header: header(k, now),
            clock_offset_sd_s: set.clock_sd,
            ..Default::default()
        });
        let mut arrived = PredictorIn {
            drone: Some(state),
            ranges: range.into_iter().collect(),
            link,
            ..Default::default()
        };
        for (_, m) in in_flight.extract_if(.., |(t, _)| *t <= now) {
            receive(&mut arrived, m);
        }
        if let Some((_, remembers)) = set.restart.filter(|(at, _)| k == (at * 100.0) as u32) {
            predictor = Predictor::new(&PredictorConfig::default(), 2).as_successor();
            // Boot number 0 means no checkpoint.
            given = Some(kept.filter(|_| remembers).unwrap_or_default());
        }
        arrived.checkpoint = given.filter(|_| k % 2 == 0);
        let out = predictor.step(time(now), &change(k, arrived));
        kept = out.checkpoint.or(kept);
        if let Some(forecast) = out.forecast {
            forecast.check().unwrap();
            samples.push(Sample {
                now,
                forecast,
                frames: Rc::clone(&frames),
            });
        }
    }
    Run { samples, predictor }
}

/// Modes of these waves, identified to 0.1 %.
pub fn waves(v: &SimulatedVessel, k: u32, now: f64) -> WaveModel<DroneClock> {
    let (s, c) = v.heading.sin_cos();
    let mode = |w: &Wave| {
        let phase = Complex::from_polar(1.0, w.omega * now + w.phase);
        let (ds, dc) = w.direction.sin_cos();
        let slope = w.omega * w.omega / 9.81 * w.amplitude * phase * -Complex::i();
        let speed = v.sway * w.amplitude * w.omega * phase;
        let shape = [
            speed * dc,
            speed * ds,
            w.amplitude * phase,
            -slope * ds,
            slope * dc,
            0.1 * slope * (c * ds - s * dc),
        ];
        WaveMode {
            pole: [-0.005, (w.omega * 1.015) as f32],
            shape: shape.map(|z| [z.re, z.im].map(f16::from_f64)),
        }
    };
    WaveModel {
        header: header(k, now),
        significant_height_m: 2.0,
        confidence: 0.9,
        slopes: Seq::filled([10]),
        advice: None,
        modes: Seq::filled(v.waves.iter().map(mode)),
    }
}

pub fn spread(k: u32, now: f64) -> VesselPrediction<DroneClock> {
    let stage = |h: u8| PredictedStage {
        sd: [0.02, 0.02, 0.008, 0.0015, 0.0015, 0.005]
            .map(|sd| f16::from_f32(sd * (1.0 + 0.5 * f32::from(h)))),
        ..Default::default()
    };
    VesselPrediction {
        header: header(k, now),
        step_s: 0.2,
        origin: [0.0; 3],
        stages: Seq::filled((0..16).map(stage)),
    }
}

/// RMS over samples: horizontal, vertical (m), tilt (rad); and mean normalised squared error per degree of freedom of
/// position, and of roll and pitch.
#[derive(Debug, Default)]
pub struct Accuracy {
    pub horizontal: f64,
    pub vertical: f64,
    pub tilt: f64,
    pub nees_position: f64,
    pub nees_tilt: f64,
}

impl Accuracy {
    pub fn of<'a>(v: &SimulatedVessel, samples: impl Iterator<Item = &'a Sample>, ahead: f64) -> Accuracy {
        let mut f = Accuracy::default();
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
        Accuracy {
            horizontal: (f.horizontal / n).sqrt(),
            vertical: (f.vertical / n).sqrt(),
            tilt: (f.tilt / n).sqrt(),
            nees_position: f.nees_position / n,
            nees_tilt: f.nees_tilt / n,
        }
    }
    pub fn assert_below(&self, horizontal_m: f64, vertical_m: f64, tilt_deg: f64) {
        let below = self.horizontal < horizontal_m && self.vertical < vertical_m;
        assert!(below && self.tilt.to_degrees() < tilt_deg, "{self:?}");
    }
    pub fn assert_consistent(&self, nees_position: [f64; 2], nees_tilt: [f64; 2]) {
        let within = |[low, high]: [f64; 2], v: f64| (low..high).contains(&v);
        let consistent = within(nees_position, self.nees_position) && within(nees_tilt, self.nees_tilt);
        assert!(consistent, "{self:?}");
    }
}
impl Run {
    pub fn accuracy(&self, v: &SimulatedVessel, between: Range<f64>, ahead: f64) -> Accuracy {
        let samples = self.samples.iter().filter(|s| between.contains(&s.now));
        Accuracy::of(v, samples, ahead)
    }
}
/// Accuracy over several seeds, starting at `from` s.
pub fn over_seeds(v: &SimulatedVessel, set: &Setup, seconds: f64, from: f64, ahead: f64) -> Accuracy {
    let runs = [0, 1, 2, 3, 4].map(|seed| run(v, &Setup { seed, ..*set }, seconds));
    let samples = runs.iter().flat_map(|r| &r.samples).filter(|s| s.now > from);
    Accuracy::of(v, samples, ahead)
}

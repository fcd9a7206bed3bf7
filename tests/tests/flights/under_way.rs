//! The drone's forecast on boats under way, by radio alone, against the vessel's own estimates: its tilt begins at the
//! estimate.

use std::path::Path;

use alight_shared::frames::{Vector, VesselNed, wrap_angle};
use alight_shared::geodesy::Datum;
use alight_shared::msg::{DeckForecast, DeckStage, DroneState, Header, LinkState, VesselEstimate};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Time, VesselClock};
use alight_sim::harness::physics::{Physics, TICK};
use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::vessel::{Course, VesselConfig};
use alight_uav::predictor::{Predictor, PredictorConfig, PredictorIn};
use alight_usv::node::VesselIn;
use alight_usv::review::ridge::{Published, RefittedRidge};
use alight_usv::sensors::{Measurement, Mount};
use alight_usv::{VesselNode, VesselNodeConfig};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

/// Forecasts are compared so far ahead, s.
const AHEAD_S: [f64; 4] = [0.0, 0.5, 1.0, 2.0];
/// The filters of both sides have settled, s.
const SETTLED_S: f64 = 60.0;

fn on_drone(t: Time<VesselClock>) -> Time<DroneClock> {
    Time::EPOCH + (t - Time::EPOCH)
}

/// Place of the deck's centre about the drone's datum, roll, pitch and heading.
fn deck(e: &VesselEstimate<VesselClock>, datum: &Datum) -> [f64; 6] {
    let [.., roll, pitch, yaw] = e.eta;
    let place = e.datum.at(&Vector::<VesselNed>::from(e.position()));
    let centre =
        datum.to::<VesselNed>(&place).0 + Rotation3::from_euler_angles(roll, pitch, yaw) * e.deck_centre();
    [centre.x, centre.y, centre.z, roll, pitch, yaw]
}

fn less(a: [f64; 6], b: [f64; 6]) -> [f64; 6] {
    core::array::from_fn(|d| {
        if d < 3 {
            a[d] - b[d]
        } else {
            wrap_angle(a[d] - b[d])
        }
    })
}

/// A vessel's node and a drone that hovers above where it began, with the vessel's clock and datum.
struct Watch {
    vessel: VesselNode,
    drone: Predictor,
    hover: Option<DroneState>,
    estimates: Vec<VesselEstimate<VesselClock>>,
    forecasts: Vec<DeckForecast>,
}

impl Watch {
    fn new() -> Watch {
        Watch {
            vessel: VesselNode::new(&VesselNodeConfig::default(), 1, 1),
            drone: Predictor::new(&PredictorConfig::default(), 1),
            hover: None,
            estimates: Vec::new(),
            forecasts: Vec::new(),
        }
    }
    fn tick(&mut self, now: Time<VesselClock>, input: &VesselIn) {
        let out = self.vessel.step(now, input);
        self.estimates.extend(out.estimate);
        let now = on_drone(now);
        let mut arrived = PredictorIn {
            estimate: out.estimate.map(|m| m.restamped(on_drone(m.header.at))),
            wave: out.wave.map(|m| m.restamped(on_drone(m.header.at))),
            prediction: out.prediction.map(|m| m.restamped(on_drone(m.header.at))),
            link: Some(LinkState {
                header: Header::new(1, 1, 1, 1, now),
                clock_offset_sd_s: 1e-3,
                ..LinkState::default()
            }),
            ..PredictorIn::default()
        };
        if let Some(e) = &arrived.estimate
            && self.hover.is_none()
        {
            self.hover = Some(DroneState {
                position: (e.position() - Vector3::new(0.0, 0.0, 10.0)).into(),
                position_sd: [0.02; 3],
                datum: e.datum,
                ..DroneState::default()
            });
        }
        arrived.drone = self.hover.map(|state| DroneState {
            header: Header::new(1, 1, 1, (now - Time::EPOCH).secs() as u32, now),
            ..state
        });
        self.forecasts.extend(self.drone.step(now, &arrived).forecast);
    }
    /// The estimate of the deck at a time.
    fn at(&self, t: Time<DroneClock>) -> Option<[f64; 6]> {
        let k = self.estimates.partition_point(|e| on_drone(e.header.at) <= t);
        let (a, b) = (self.estimates.get(k.checked_sub(1)?)?, self.estimates.get(k)?);
        let whole = (b.header.at - a.header.at).secs();
        let share = (t - on_drone(a.header.at)).secs() / whole;
        let datum = self.hover?.datum;
        let (a, b) = (deck(a, &datum), deck(b, &datum));
        let step = less(b, a);
        (whole < 0.2).then(|| core::array::from_fn(|d| a[d] + share * step[d]))
    }
    fn scores(&self) -> Scores {
        let mut scores = Scores::default();
        let Some(first) = self.estimates.first() else {
            return scores;
        };
        let (mut published, mut fresh) = (Published::default(), self.estimates.iter().peekable());
        let mut ridge = RefittedRidge::new(first.header.at, &AHEAD_S[1..]);
        for f in &self.forecasts {
            let now = f.header.at;
            while let Some(e) = fresh.next_if(|e| on_drone(e.header.at) <= now) {
                published.push(e, 0.0);
                published.forget();
            }
            if (now - on_drone(first.header.at)).secs() < SETTLED_S {
                continue;
            }
            let by_ridge = ridge.predict(&published, Time::EPOCH + (now - Time::EPOCH));
            for (h, ahead) in AHEAD_S.into_iter().enumerate() {
                let t = now + Span::from_secs(ahead);
                if let (Some(stage), Some(then)) = (f.at(t), self.at(t)) {
                    scores.0[h].add(&stage, then);
                    let ridge = by_ridge.as_ref().and_then(|r| r.get(h.checked_sub(1)?));
                    if let Some([roll, pitch, _]) = ridge {
                        scores.0[h].add_ridge([*roll, *pitch], then);
                    }
                }
            }
        }
        scores
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Score {
    n: f64,
    squares: [f64; 6],
    inside: [f64; 6],
    ridge_n: f64,
    ridge: [f64; 2],
}

impl Score {
    fn add(&mut self, stage: &DeckStage, then: [f64; 6]) {
        let ([x, y, z], [roll, pitch, yaw]) = (stage.position, stage.euler);
        let off = less([x, y, z, roll, pitch, yaw], then);
        self.n += 1.0;
        for (d, sd) in stage.position_sd.into_iter().chain(stage.euler_sd).enumerate() {
            self.squares[d] += off[d] * off[d];
            self.inside[d] += f64::from(off[d].abs() < 1.96 * sd);
        }
    }
    fn add_ridge(&mut self, [roll, pitch]: [f64; 2], then: [f64; 6]) {
        self.ridge_n += 1.0;
        self.ridge[0] += wrap_angle(roll - then[3]).powi(2);
        self.ridge[1] += wrap_angle(pitch - then[4]).powi(2);
    }
    fn rms(&self, dof: usize) -> f64 {
        (self.squares[dof] / self.n).sqrt()
    }
    fn ridge_rms(&self, dof: usize) -> f64 {
        (self.ridge[dof - 3] / self.ridge_n).sqrt()
    }
}

/// By [`AHEAD_S`].
#[derive(Clone, Copy, Debug, Default)]
struct Scores([Score; AHEAD_S.len()]);

impl Scores {
    fn print(&self, name: &str) {
        for (s, ahead) in self.0.iter().zip(AHEAD_S) {
            let deg = |d: usize| s.rms(d).to_degrees();
            let ridge = |d: usize| s.rms(d) / s.ridge_rms(d);
            let inside = s.inside.map(|i| (100.0 * i / s.n).round());
            println!(
                "{name:16} {ahead:.1} s: place {:.3} height {:.3} m, roll {:.2} pitch {:.2} yaw {:.2} deg, {:.2} {:.2} x ridge, \
                 inside {inside:?}",
                s.rms(0).hypot(s.rms(1)),
                s.rms(2),
                deg(3),
                deg(4),
                deg(5),
                ridge(3),
                ridge(4),
            );
        }
    }
}

fn recorded(name: &str) -> Scores {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/underway");
    let bytes = std::fs::read(folder.join(name)).unwrap();
    let recording = alight_usv::log::read(&bytes, name, &Mount::default()).unwrap();
    let mut coming = recording.measurements.iter().peekable();
    let mut now = coming.peek().unwrap().at();
    let mut watch = Watch::new();
    while coming.peek().is_some() {
        let mut input = VesselIn::default();
        while let Some(m) = coming.next_if(|m| m.at() <= now) {
            match m {
                Measurement::Imu(m) => input.imu.push(*m),
                Measurement::Gnss(m) => input.gnss.push(*m),
                Measurement::Heading(m) => input.heading.push(*m),
                Measurement::Attitude(m) => input.attitude.push(*m),
            }
        }
        watch.tick(now, &input);
        now += TICK;
    }
    watch.scores()
}

/// Two minutes and a half of a simulated sea.
fn simulated(sea: &str, course: Course, speed_mps: f64, seed: u64) -> Scores {
    let mut vessel = VesselConfig {
        course,
        speed_mps,
        ..VesselConfig::default()
    };
    vessel.power_for(speed_mps);
    let scenario = Scenario {
        sea: sea.parse().unwrap(),
        vessel,
        ..Scenario::default()
    };
    let mut physics = Physics::new(&scenario, seed).unwrap();
    let mut watch = Watch::new();
    for _ in 0..15_000 {
        let readings = physics.vessel_readings();
        watch.tick(physics.vessel_now(), &readings.input());
        physics.advance();
    }
    watch.scores()
}

/// The tilt begins at the estimate, within what the drone leaves to slow errors of its own.
fn assert_tilt_begins_at_the_estimate(name: &str, scores: &Scores) {
    let now = &scores.0[0];
    assert!(now.n > 1000.0, "{name}: {} forecasts", now.n);
    for dof in [3, 4] {
        let deg = now.rms(dof).to_degrees();
        assert!(deg < 0.1, "{name}: degree of freedom {dof} begins {deg} deg off");
    }
}

/// Of place and heading two receivers' and two compasses' slow errors are states of the drone's.
#[test]
fn forecast_that_begins_at_the_estimate() {
    let seas = [
        ("moderate", Course::Drift, 0.0),
        ("moderate", Course::Square, 2.0),
        ("0.3,4", Course::Zigzag, 4.0),
    ];
    seas.into_par_iter().for_each(|(sea, course, speed)| {
        let name = format!("{sea} {course:?}");
        let scores = simulated(sea, course, speed, 300);
        scores.print(&name);
        assert_tilt_begins_at_the_estimate(&name, &scores);
        let now = &scores.0[0];
        for (dof, inside) in now.inside.into_iter().enumerate() {
            assert!(inside > 0.9 * now.n, "{name}: {dof} {inside} of {}", now.n);
        }
    });
}

/// A real boat under way, whose heel moves with each turn.
#[test]
#[ignore = "needs ../shared/data/underway beside the project"]
fn recorded_boat_by_the_drone() {
    let scores = recorded("figure-of-eight.csv");
    scores.print("figure of eight");
    assert_tilt_begins_at_the_estimate("figure of eight", &scores);
    for (ahead, s) in AHEAD_S.into_iter().zip(&scores.0).skip(1) {
        let [roll, pitch] = [3, 4].map(|d| s.rms(d) / s.ridge_rms(d));
        assert!(
            roll < 1.5 && pitch < 1.9,
            "{ahead} s: {roll}, {pitch} x the ridge regression"
        );
        // The receiver's velocities are 2.4 s old.
        for dof in [0, 1] {
            let inside = s.inside[dof] / s.n;
            assert!(inside > 0.9, "{ahead} s: {dof} {inside} inside its interval");
        }
    }
}

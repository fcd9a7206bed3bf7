//! Closed-loop tests of the pilot: a drone with lags above a heaving, tilting deck.

use alight_shared::{
    frames::wxyz,
    msg::{DeckStage, Header, Motors},
    time::Time,
};
use nalgebra::UnitQuaternion;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::*;
use crate::fixtures::{airborne, forecast, mission, plan};

/// Distance of the feet below the centre of mass, m.
const FEET: f64 = 0.30;
const STEP: f64 = 0.001;

#[derive(Clone, Copy)]
struct Sea {
    amplitude: f64,
    pitch: f64,
    period: f64,
    phase: f64,
}
impl Sea {
    fn deck(&self, t: f64) -> DeckStage {
        let w = std::f64::consts::TAU / self.period;
        let (s, c) = (w * t + self.phase).sin_cos();
        DeckStage {
            position: [0.0, 0.0, -1.3 - self.amplitude * s],
            velocity: [0.0, 0.0, -self.amplitude * w * c],
            acceleration: [0.0, 0.0, self.amplitude * w * w * s],
            euler: [0.0, self.pitch * c, 0.0],
            euler_rates: [0.0, -self.pitch * w * s, 0.0],
            position_sd: [0.05; 3],
            velocity_sd: [0.05; 3],
            euler_sd: [0.01; 3],
            ..DeckStage::default()
        }
    }
}

#[derive(Clone, Copy)]
enum Task {
    /// Clearance and time at the start of a descent at 0.5 m/s that ends 0.3 m below the deck's plane.
    Land(f64, f64),
    Follow(f64),
    /// NED height of the feet.
    Stay(f64),
}

/// Reading of a simulated rangefinder, m, as a function of true range and clearance, m.
type Reads = fn(f64, f64) -> f64;

struct World {
    sea: Sea,
    task: Task,
    t: f64,
    p: Vector3<f64>,
    v: Vector3<f64>,
    q: UnitQuaternion<f64>,
    thrust: f64,
    /// True hover thrust; the autopilot's estimate is 2 % too high, that of the geometry 7 % too low.
    hover: f64,
    damping: f64,
    ranges: bool,
    reads: Reads,
    reports: bool,
    state: State,
    mode: AutopilotMode,
    pilot: Pilot,
    rng: ChaCha8Rng,
    first_contact: Option<(f64, f64, f64)>,
    hardest: f64,
    stopped: Option<f64>,
    touchdown: Option<Touchdown>,
    last: SetPoint,
    tick: u32,
}

impl World {
    fn new(sea: Sea, task: Task, seed: u64) -> Self {
        let geometry = DroneGeometry::default();
        let hover = geometry.mass_kg * GRAVITY / geometry.max_thrust_n * 1.07;
        let mut w = World {
            sea,
            task,
            t: 0.0,
            p: Vector3::zeros(),
            v: Vector3::zeros(),
            q: UnitQuaternion::identity(),
            thrust: hover,
            hover,
            damping: 120.0,
            ranges: true,
            reads: |range, _| range.max(0.05),
            reports: true,
            state: State::Flare,
            mode: AutopilotMode::Offboard,
            pilot: Pilot::new(&PilotConfig::default(), &geometry, &DeckGeometry::default(), 1, 1),
            rng: ChaCha8Rng::seed_from_u64(seed),
            first_contact: None,
            hardest: 0.0,
            stopped: None,
            touchdown: None,
            last: SetPoint::default(),
            tick: 0,
        };
        let start = w.reference(0.0);
        w.p = Vector3::from(start.position);
        w.v = Vector3::from(start.velocity);
        w
    }
    fn noise(&mut self, sd: f64) -> f64 {
        Normal::new(0.0, sd).unwrap().sample(&mut self.rng)
    }
    fn vector(&mut self, sd: f64) -> Vector3<f64> {
        Vector3::new(self.noise(sd), self.noise(sd), self.noise(sd))
    }
    fn reference(&self, t: f64) -> PlanStage {
        let d = self.sea.deck(t);
        let height = match self.task {
            Task::Land(from, begin) => (from - 0.5 * (t - begin).max(0.0)).max(-0.3),
            Task::Follow(h) => h,
            Task::Stay(z) => {
                return PlanStage {
                    position: [0.0, 0.0, z - FEET],
                    ..PlanStage::default()
                };
            }
        };
        let sink = match self.task {
            Task::Land(from, begin) if t > begin && from - 0.5 * (t - begin) > -0.3 => 0.5,
            _ => 0.0,
        };
        // The deck's tilt affects attitude and lateral acceleration only near contact.
        let align = (-height.max(0.0) / 0.15).exp();
        let at = Vector3::from(d.position) + d.normal() * (FEET + height);
        PlanStage {
            position: at.into(),
            velocity: [0.0, 0.0, d.velocity[2] + sink],
            acceleration: d.acceleration,
            euler: d.euler.map(|e| e * align),
            euler_rates: d.euler_rates.map(|e| e * align),
        }
    }
    fn clearance(&self) -> (f64, Vector3<f64>, f64) {
        let d = self.sea.deck(self.t);
        let n = d.normal();
        let c = (self.p - Vector3::from(d.position)).dot(&n) - FEET;
        (c, n, (self.v - Vector3::from(d.velocity)).dot(&n))
    }
    /// Advances the physics by 10 ms; returns the mean specific force, m/s².
    fn move_drone(&mut self) -> Vector3<f64> {
        let mut force = Vector3::zeros();
        for _ in 0..10 {
            let running = self.stopped.is_none();
            let asked = if running { self.last.thrust } else { 0.0 };
            let target = self.last.attitude();
            if self.last.kind == SetPointKind::Attitude {
                self.q = self.q.slerp(&target, STEP / 0.2);
                self.thrust += (asked - self.thrust) * STEP / 0.03;
            } else if self.last.kind == SetPointKind::Trajectory {
                let e = Vector3::from(self.last.position) - self.p;
                let ev = Vector3::from(self.last.velocity) - self.v;
                let a = Vector3::from(self.last.acceleration) + e * 4.0 + ev * 3.5;
                self.thrust = (self.hover * (GRAVITY - a.z) / GRAVITY).clamp(0.02, 1.0);
                self.v.x += a.x * STEP;
                self.v.y += a.y * STEP;
            }
            let up = self.q * -Vector3::z();
            let mut specific = up * (self.thrust * GRAVITY / self.hover);
            let (c, n, speed) = self.clearance();
            if c < 0.0 {
                if self.first_contact.is_none() {
                    let tilt = up.angle(&n);
                    self.first_contact = Some((self.t, -speed, tilt));
                }
                self.hardest = self.hardest.max(-speed);
                let push = (2.0e4 * -c - self.damping * speed).max(0.0) / 3.5;
                let slide = self.v - Vector3::from(self.sea.deck(self.t).velocity) - n * speed;
                specific += n * push - slide * (0.4 * push / slide.norm().max(0.05)).min(50.0);
                let wanted = UnitQuaternion::rotation_between(&up, &n).unwrap_or_default() * self.q;
                self.q = self.q.slerp(&wanted, STEP / 0.1);
            }
            force += specific * 0.1;
            self.v += (specific + Vector3::z() * GRAVITY) * STEP;
            self.p += self.v * STEP;
            self.t += STEP;
        }
        force
    }
    fn step(&mut self) {
        let force = self.move_drone();
        self.tick += 1;
        let now = Time::from_secs(self.t);
        let n = self.tick;
        let header = Header::new(1, 1, 1, n, now);
        let mut input = PilotIn::default();
        let drone = DroneState {
            header,
            position: (self.p + self.vector(0.01)).into(),
            velocity: (self.v + self.vector(0.05)).into(),
            attitude: wxyz(&self.q),
            specific_force: (self.q.inverse() * force + self.vector(0.3)).into(),
            ..DroneState::default()
        };
        input.drone = Some(drone);
        let (clearance, up, _) = self.clearance();
        if n.is_multiple_of(2) {
            let down = self.q * Vector3::z();
            let range = (clearance + FEET) / -down.dot(&up) - 0.08 + self.noise(0.03);
            if self.ranges {
                input.ranges.push(RangeSample {
                    header,
                    range_m: (self.reads)(range, clearance),
                    variance: 9e-4,
                });
            }
            let sink = if self.state.phase() == Phase::Landing {
                0.5
            } else {
                0.0
            };
            input.mission = Some(mission(header, self.state, sink));
            let error = self.noise(0.03);
            input.forecast = Some(forecast(header, |ahead| {
                let mut d = self.sea.deck(self.t + ahead);
                d.position[2] += error;
                d
            }));
            input.plan = Some(plan(header, |ahead| self.reference(self.t + ahead)));
        }
        if n.is_multiple_of(10) {
            input.autopilot = Some(AutopilotState {
                armed: self.stopped.is_none(),
                mode: self.mode,
                thrust: self.reports.then_some(self.thrust),
                hover_thrust: self.hover * 1.02,
                ..airborne(header)
            });
        }
        let out = self.pilot.step(now, &input);
        self.last = out.set_point.unwrap();
        assert!(self.last.check().is_ok(), "{:?}", self.last);
        if out.touchdown.is_some() {
            self.touchdown = out.touchdown;
        }
        if self.last.motors == Motors::Stop && self.stopped.is_none() {
            self.stopped = Some(self.t);
        }
    }
    fn fly(&mut self, secs: f64) {
        for _ in 0..(secs * 100.0) as usize {
            self.step();
        }
    }
}

fn moderate(phase: f64) -> Sea {
    Sea {
        amplitude: 0.6,
        pitch: 0.10,
        period: 5.0,
        phase,
    }
}

/// Landing in a moderate sea, modified by `change`, and the delay (s) from first contact to motor stop.
fn landed(phase: f64, seed: u64, change: impl FnOnce(&mut World)) -> (World, f64) {
    landed_from(0.9, phase, seed, change)
}
fn landed_from(height_m: f64, phase: f64, seed: u64, change: impl FnOnce(&mut World)) -> (World, f64) {
    let mut w = World::new(moderate(phase), Task::Land(height_m, 2.0), seed);
    change(&mut w);
    w.fly(10.0);
    let (at, _, _) = w.first_contact.expect("no contact");
    let stop = w.stopped.expect("not stopped") - at;
    (w, stop)
}

#[test]
fn touchdown_on_a_moving_deck() {
    let mut worst: (f64, f64, f64, f64) = (0.0, 0.0, 0.0, 0.0);
    for k in 0..24 {
        let (w, stop) = landed(f64::from(k) * 0.26, k as u64, |_| ());
        let (_, speed, tilt) = w.first_contact.expect("no contact");
        let t = w.touchdown.expect("no evidence");
        assert!(t.excess_mps2 > 2.0 && t.thrust_of_hover < 0.8, "{t:?}");
        worst = (
            worst.0.max(stop),
            worst.1.max(speed),
            worst.2.max(tilt.to_degrees()),
            worst.3.max(w.hardest),
        );
        assert!(stop > 0.0, "stopped {stop} s before the contact, phase {k}");
    }
    println!(
        "stop after {:.3} s, contact at {:.2} m/s, {:.2} deg, hardest {:.2} m/s",
        worst.0, worst.1, worst.2, worst.3
    );
    assert!(
        worst.0 < 0.5 && worst.1 < 0.8 && worst.2 < 4.0 && worst.3 < 0.9,
        "{worst:?}"
    );
}

#[test]
fn touchdown_without_a_rangefinder() {
    for k in 0..6 {
        let (_, stop) = landed(f64::from(k), 100 + k as u64, |w| w.ranges = false);
        assert!((0.0..1.0).contains(&stop), "{stop}");
    }
}

/// Landing from 1.5 m, so that a fault can begin during the descent.
fn landed_from_above(phase: f64, seed: u64, change: impl FnOnce(&mut World)) -> (World, f64) {
    landed_from(1.5, phase, seed, change)
}

#[test]
fn touchdown_with_a_rangefinder_that_sticks() {
    let faults: [(&str, Reads); 5] = [
        ("at the feet from the start", |_, _| 0.22),
        ("at the feet below 1 m", |r, h| if h < 1.0 { 0.22 } else { r }),
        ("at the feet below 0.45 m", |r, h| if h < 0.45 { 0.22 } else { r }),
        ("on the water below 1 m", |r, h| if h < 1.0 { r + 1.3 } else { r }),
        ("invalid below 1 m", |r, h| if h < 1.0 { 0.0 } else { r }),
    ];
    for (what, reads) in faults {
        for k in 0..6 {
            let (w, stop) = landed_from_above(f64::from(k), 500 + k as u64, |w| w.reads = reads);
            assert!((0.0..1.0).contains(&stop), "{what}, {k}: {stop} s");
            assert!(w.hardest < 1.0, "{what}, {k}: {} m/s", w.hardest);
            assert!(w.last.hard_contact_mps.is_none(), "{what}, {k}: {:?}", w.last);
        }
    }
}

#[test]
fn touchdown_without_reports_of_the_thrust() {
    for k in 0..6 {
        let (w, stop) = landed_from_above(f64::from(k), 600 + k as u64, |w| w.reports = false);
        assert!(
            (0.0..1.5).contains(&stop) && w.hardest < 1.0,
            "{k}: {stop} s, {} m/s",
            w.hardest
        );
    }
    for (k, clearance) in [0.15, 0.2, 0.3].into_iter().enumerate() {
        let mut w = World::new(moderate(0.4), Task::Follow(clearance), 610 + k as u64);
        w.reports = false;
        w.fly(60.0);
        assert_eq!((w.first_contact, w.stopped), (None, None), "{clearance} m");
    }
}

/// Set-points restart low above the deck after the autopilot has braked with more thrust than they command. The
/// remaining thrust of the rotors must not be detected as contact.
#[test]
fn thrust_of_before_is_no_contact() {
    for (k, reports) in [true, false].into_iter().enumerate() {
        let mut w = World::new(moderate(0.4), Task::Follow(0.15), 620 + k as u64);
        w.reports = reports;
        w.fly(5.0);
        w.pilot.estimate.commanded(None, 0.01, 0.0);
        for _ in 0..15 {
            w.thrust = 1.4 * w.hover;
            w.step();
            assert_eq!(
                w.pilot.detector.contact(),
                TouchdownContact::Clear,
                "reports: {reports}"
            );
        }
    }
}

#[test]
fn hard_contact_by_speed_and_impact() {
    let met = |speed: f64, clearance: f64, impact: f64| {
        let mut d = TouchdownDetector::new(0.22);
        let evidence = |force: f64, speed: f64| TouchdownEvidence {
            permitted: true,
            descending: true,
            begins_within: None,
            force: Some(force),
            own_thrust: Some(GRAVITY),
            reported_thrust: Some(GRAVITY),
            hover_thrust: GRAVITY,
            clearance: Some(clearance),
            normal_speed: Some(speed),
        };
        let at = |k: u32| Time::from_secs(10.0 + 0.01 * f64::from(k));
        for k in 0..20 {
            d.step(at(k), 0.01, &evidence(GRAVITY, -speed));
        }
        d.step(at(20), 0.01, &evidence(GRAVITY + impact, -0.3 * speed));
        d.hard_mps()
    };
    assert!(met(2.6, 0.05, 60.0).is_some_and(|v| (v - 2.6).abs() < 1e-9));
    assert_eq!(met(0.9, 0.05, 60.0), None, "a good contact");
    assert_eq!(met(2.6, 3.0, 60.0), None, "a gust in the air");
    assert_eq!(met(2.6, 0.05, 1.0), None, "no contact force");
}

/// A tilted drone levels off in strong wind low above the deck, so the aerodynamic lift increases.
#[test]
fn excess_of_the_air_and_of_a_deck() {
    // Whether contact is suspected 0.5 s after the excess (m/s²) began.
    let suspected = |excess: &dyn Fn(f64) -> f64| {
        let mut d = TouchdownDetector::new(0.22);
        let mut found = false;
        for k in 0..150 {
            let t = 0.01 * f64::from(k);
            let now = Time::from_secs(10.0 + t);
            d.range(now, 0.30);
            let evidence = TouchdownEvidence {
                permitted: true,
                force: Some(GRAVITY + excess(t - 1.0)),
                own_thrust: Some(GRAVITY),
                reported_thrust: Some(GRAVITY),
                hover_thrust: GRAVITY,
                clearance: Some(0.08),
                normal_speed: Some(-0.1),
                ..TouchdownEvidence::default()
            };
            d.step(now, 0.01, &evidence);
            found |= d.contact() != TouchdownContact::Clear;
        }
        found
    };
    let air = |t: f64| 1.9 * (t / 0.4).clamp(0.0, 1.0);
    assert!(!suspected(&air));
    let deck = |t: f64| if t > 0.3 { 2.5 } else { 0.0 };
    assert!(suspected(&deck));
    assert!(suspected(&|t| air(t) + deck(t)));
}

#[test]
fn touchdown_after_a_bounce() {
    for k in 0..6 {
        // This damping gives a restitution of about 0.6.
        let (w, stop) = landed(f64::from(k), 200 + k as u64, |w| w.damping = 80.0);
        assert!((0.0..1.0).contains(&stop), "{stop}");
        assert!(w.hardest < 1.0, "{}", w.hardest);
    }
}

/// In a flare close to the deck without contact the motors keep running, and a suspicion does not lower the drone.
#[test]
fn motors_close_to_the_deck_without_contact() {
    for (k, clearance) in [0.15, 0.2, 0.3].into_iter().enumerate() {
        for ranges in [true, false] {
            let mut w = World::new(moderate(0.4), Task::Follow(clearance), 300 + k as u64);
            w.ranges = ranges;
            w.fly(60.0);
            assert_eq!(w.first_contact, None, "touched at {clearance}");
            assert_eq!(w.stopped, None, "stopped at {clearance}");
        }
    }
}

#[test]
fn motors_over_a_deck_heaving_close() {
    let sea = Sea {
        pitch: 0.0,
        ..moderate(0.0)
    };
    // The deck rises to 12 cm below the feet.
    let mut w = World::new(sea, Task::Stay(-1.3 - 0.6 - 0.12), 7);
    w.fly(60.0);
    assert_eq!((w.first_contact, w.stopped), (None, None));
}

#[test]
fn motors_outside_a_landing() {
    for (state, mode) in [
        (State::Tracking, AutopilotMode::Offboard),
        (State::Approach, AutopilotMode::Offboard),
        (State::Hold, AutopilotMode::Offboard),
        (State::Flare, AutopilotMode::Hold),
        (State::Flare, AutopilotMode::Other),
    ] {
        let mut w = World::new(moderate(1.0), Task::Land(0.5, 1.0), 9);
        w.state = state;
        w.mode = mode;
        w.fly(8.0);
        assert!(w.first_contact.is_some(), "{state:?}: pressed onto the deck");
        assert_eq!(w.stopped, None, "{state:?} {mode:?}");
    }
}

/// Twenty minutes of hover, tracking and approach above a rough deck while the mission permits contact.
#[test]
fn motors_in_the_air() {
    for (k, clearance) in [0.6, 1.5, 7.0, 15.0].into_iter().enumerate() {
        let sea = Sea {
            amplitude: 0.9,
            pitch: 0.25,
            period: 5.0,
            phase: 0.0,
        };
        let mut w = World::new(sea, Task::Follow(clearance), 400 + k as u64);
        w.fly(300.0);
        assert_eq!((w.first_contact, w.stopped), (None, None), "{clearance}");
        assert_eq!(w.pilot.detector.contact(), TouchdownContact::Clear);
    }
}

#[test]
fn plan_tracking_error() {
    let sea = Sea {
        pitch: 0.0,
        ..moderate(0.0)
    };
    let mut w = World::new(sea, Task::Follow(2.0), 11);
    w.fly(10.0);
    let mut square = 0.0;
    let mut n = 0.0;
    for _ in 0..2000 {
        w.step();
        square += (w.p - Vector3::from(w.reference(w.t).position)).norm_squared();
        n += 1.0;
    }
    let rms = f64::sqrt(square / n);
    println!("rms {rms:.3} m");
    assert!(rms < 0.12, "{rms}");
    assert!((w.pilot.estimate.hover() / w.hover - 1.0).abs() < 0.02);
}

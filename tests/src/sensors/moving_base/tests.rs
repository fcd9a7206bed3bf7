//! Tests of the two receivers against their configured parameters.

use super::*;
use crate::sensors::clocks::ClockModel;
use alight_shared::{
    estimation::moments,
    frames::{Point, Rotation},
};
use alight_uav::autopilot::receiver::{ReceiverDecoder, RelativeReport};

const RADIO_S: f64 = 0.05;

fn tick(k: i64) -> Time<TrueTime> {
    Time::from_nanos(k * 10_000_000)
}

/// Vessel that heads east, and drone 3 m north of and 10 m above the deck's centre.
struct Pair {
    base: BaseReceiver,
    rover: MovingBaseRover,
    radio: DelayLine<Vec<u8>>,
    decoder: ReceiverDecoder,
    ticks: i64,
}

/// Vector between the antennas, m.
const TRUTH: [f64; 3] = [3.0 + 0.6, 1.4, -10.1 - 0.1];

impl Pair {
    fn new(config: &MovingBaseConfig, seed: u64) -> Pair {
        let streams = Streams::new(seed);
        let identity = SenderIdentity {
            vessel: 1,
            drone: 1,
            boot: 1,
            clock: ClockModel::new(100.0, 0.0),
        };
        Pair {
            base: BaseReceiver::new(config, identity, &streams),
            rover: MovingBaseRover::new(config, [0.0, 0.0, -0.1], &streams),
            radio: DelayLine::new(EPOCHS),
            decoder: ReceiverDecoder::default(),
            ticks: 0,
        }
    }
    /// Solutions of the next `seconds` with arrival times, s; only messages accepted by `passes` arrive.
    fn run(&mut self, seconds: f64, passes: impl Fn(u16) -> bool) -> Vec<(f64, RelativeReport)> {
        let drone = RigidState {
            position: Point::new(3.0, 0.0, -10.0),
            ..RigidState::default()
        };
        let deck = RigidState {
            attitude: Rotation::from_euler(0.0, 0.0, core::f64::consts::FRAC_PI_2),
            ..RigidState::default()
        };
        let mut places = Vec::new();
        for _ in 0..(seconds * 100.0) as u32 {
            let t = tick(self.ticks);
            self.ticks += 1;
            for (number, frame) in rtcm::frames(&self.base.step(t)).unwrap_or_default() {
                if passes(number.message) {
                    let arrival = t + Span::from_secs(RADIO_S);
                    assert!(self.radio.push(arrival, frame.to_vec()));
                }
            }
            self.rover.receive(t, &self.radio.arrived(t).concat());
            self.decoder.push(&self.rover.step(t, &drone, &deck));
            let reports = core::iter::from_fn(|| self.decoder.next_report());
            places.extend(reports.filter(|r| r.solution.is_some()).map(|r| (t.secs(), r)));
        }
        places
    }
}

/// Position errors of the solutions, m.
fn errors(places: &[(f64, RelativeReport)], solution: CarrierSolution) -> Vec<Vector3<f64>> {
    let of = places.iter().filter(|(_, p)| p.solution == Some(solution));
    of.map(|(_, p)| Vector3::from(p.place.unwrap()[0]) - Vector3::from(TRUTH))
        .collect()
}
/// Receiver with a lasting fix from the start.
fn steady() -> MovingBaseConfig {
    MovingBaseConfig {
        time_to_fix_s: 0.1,
        fix_lost_every_s: 1e6,
        ..MovingBaseConfig::default()
    }
}

#[test]
fn frames_of_each_epoch() {
    let mut pair = Pair::new(&MovingBaseConfig::default(), 1);
    let mut counts = [0; MESSAGES.len()];
    for k in 0..1000 {
        for (n, frame) in rtcm::frames(&pair.base.step(tick(k))).unwrap_or_default() {
            counts[MESSAGES.iter().position(|m| m.0 == n.message).unwrap()] += 1;
            assert!((66..=156).contains(&frame.len()), "{n}");
        }
    }
    assert_eq!(counts, [40, 40, 40, 40, 40, 8]);
}

#[test]
fn solution_by_the_age_of_corrections() {
    let config = MovingBaseConfig {
        fix_lost_every_s: 1e6,
        ..MovingBaseConfig::default()
    };
    let mut a = Ambiguities::new(&config, &Streams::new(2));
    let mut now_s = 0.0;
    let mut after = |seconds: f64, age_s: f64, lost: bool| {
        for _ in 0..(seconds * 10.0).round() as u32 {
            now_s += 0.1;
            a.step(Time::from_secs(now_s), age_s, lost);
        }
        a.solution
    };
    assert_eq!(after(5.0, f64::INFINITY, false), CarrierSolution::None);
    assert_eq!(after(0.9, 0.2, false), CarrierSolution::None);
    assert_eq!(after(0.3, 0.2, true), CarrierSolution::Float);
    assert_eq!(after(100.0, 3.0, false), CarrierSolution::Float);
    assert_eq!(after(100.0, 0.2, false), CarrierSolution::Fixed);
    assert_eq!(after(1.0, 4.9, false), CarrierSolution::Fixed);
    assert_eq!(after(0.1, 5.1, false), CarrierSolution::Float);
    assert_eq!(after(1.0, 19.9, false), CarrierSolution::Float);
    assert_eq!(after(0.1, 20.1, false), CarrierSolution::None);
    assert_eq!(after(100.0, 0.2, false), CarrierSolution::Fixed);
    assert_eq!(after(0.1, 0.2, true), CarrierSolution::Float);
}

#[test]
fn mean_time_to_a_fix() {
    for (blocked, expected_s) in [(0.0, 9.0), (1.0, 33.0)] {
        let config = MovingBaseConfig {
            blocked,
            ..MovingBaseConfig::default()
        };
        let time_s = |seed: u64| {
            let mut a = Ambiguities::new(&config, &Streams::new(seed));
            let fixed = |k: &i64| {
                a.step(tick(10 * k), 0.2, false);
                a.solution == CarrierSolution::Fixed
            };
            (0..10_000).find(fixed).unwrap() as f64 * 0.1
        };
        let mean = (0..600).map(time_s).sum::<f64>() / 600.0;
        assert!((mean / expected_s - 1.0).abs() < 0.15, "{mean} s");
    }
}

#[test]
fn errors_of_a_fix_as_stated() {
    let places = Pair::new(&steady(), 3).run(400.0, |_| true);
    let fixed = errors(&places, CarrierSolution::Fixed);
    assert!(fixed.len() > 760, "{}", fixed.len());
    let [_, stated] = places.last().unwrap().1.place.unwrap();
    for axis in 0..3 {
        let (mean, sd) = moments(&fixed.iter().map(|e| e[axis]).collect::<Vec<_>>());
        assert!(
            mean.abs() < 0.005 && (sd / stated[axis] - 1.0).abs() < 0.12,
            "{mean} {sd}"
        );
    }
    for (arrival_s, place) in &places {
        let at_s = place.of_week_ns as f64 * 1e-9;
        assert!((at_s * 4.0 - (at_s * 4.0).round()).abs() < 1e-6);
        let late_s = BASE_LATENCY_S + RADIO_S + PROCESSING_S;
        assert!((arrival_s - at_s - late_s).abs() < 1e-6, "{arrival_s} {at_s}");
    }
}

#[test]
fn errors_of_a_float_solution_as_stated() {
    let mut all = Vec::new();
    for seed in 0..30 {
        let mut pair = Pair::new(&steady(), seed);
        pair.rover.faults.fix_lost = true;
        let places = pair.run(60.0, |_| true);
        assert!(errors(&places, CarrierSolution::Fixed).is_empty());
        all.extend(errors(&places, CarrierSolution::Float));
    }
    let mean_square = all.iter().map(Vector3::norm_squared).sum::<f64>() / (3 * all.len()) as f64;
    assert!(
        (mean_square.sqrt() / FLOAT_SD_M - 1.0).abs() < 0.2,
        "{mean_square}"
    );
}

#[test]
fn false_fix_that_lasts_as_long_as_it() {
    let config = MovingBaseConfig {
        time_to_fix_s: 1.0,
        fix_lost_every_s: 20.0,
        false_fix_m: 0.5,
        ..MovingBaseConfig::default()
    };
    let places = Pair::new(&config, 4).run(400.0, |_| true);
    let fixed = errors(&places, CarrierSolution::Fixed);
    assert!(fixed.len() > 600 && fixed.iter().all(|e| (e.norm() - 0.5).abs() < 0.1));
    let jumps = fixed.windows(2).filter(|w| (w[1] - w[0]).norm() > 0.15).count();
    let others = fixed.iter().filter(|e| (*e - fixed[0]).norm() > 0.3).count();
    assert!((1..50).contains(&jumps) && others > 50, "{jumps} {others}");
    // A false fix caused by a fault begins and ends during a fix.
    let mut pair = Pair::new(&steady(), 5);
    let mut off_m = |false_fix_m: f64| {
        pair.rover.faults.false_fix_m = false_fix_m;
        let places = pair.run(5.0, |_| true);
        errors(&places, CarrierSolution::Fixed).last().unwrap().norm()
    };
    assert!(off_m(0.0) < 0.1 && (off_m(1.0) - 1.0).abs() < 0.1 && off_m(0.0) < 0.1);
}

#[test]
fn places_of_complete_epochs_alone() {
    let solved = |lost: u16| Pair::new(&steady(), 6).run(10.0, |n| n != lost).len();
    assert_eq!(solved(1097), 0);
    assert_eq!(solved(4072), 0);
    assert!(solved(1230) >= 39);
    let mut pair = Pair::new(&steady(), 6);
    assert_eq!(
        pair.run(10.0, |_| true).last().unwrap().1.solution,
        Some(CarrierSolution::Fixed)
    );
    pair.rover.faults.corrections_lost = true;
    assert!(pair.run(6.0, |_| true).len() <= 1);
    pair.rover.faults.corrections_lost = false;
    assert_eq!(
        pair.run(1.0, |_| true)[0].1.solution,
        Some(CarrierSolution::Float)
    );
}

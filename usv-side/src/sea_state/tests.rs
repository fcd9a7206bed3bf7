//! The identification on synthetic records: given a sea, when a record is fed, then the components.

use alight_shared::frames::wrap_angle;
use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::vessel_model::WaveNonlinearity;
use nalgebra::{Complex, DMatrix, DVector};
use proptest::prelude::*;

use super::synthetic::{Plane, Voyage, jitter, jonswap, paper, truth};
use super::*;

const STILL: &dyn Fn(f64) -> [f64; 2] = &|_| [0.0; 2];

fn voyage<'a>(
    seed: u64,
    seconds: f64,
    velocity: &'a dyn Fn(f64) -> [f64; 2],
    sea: &'a dyn Fn(f64) -> Vec<Plane>,
) -> Voyage<'a> {
    Voyage {
        seed,
        rate_hz: 25.0,
        seconds,
        tilt_noise: 0.2_f64.to_radians(),
        acceleration_noise: 0.03,
        velocity,
        sea,
    }
}

fn identify(samples: &[(MotionSample, [f64; 2])]) -> Option<SeaState> {
    let mut identifier = Identifier::new(&SeaStateConfig::default());
    let mut last = None;
    for (s, _) in samples {
        identifier.push(s);
        last = identifier.update(s.at, WaveNonlinearity::default()).cloned();
    }
    last
}

/// Largest relative error of the frequencies and largest error of the directions (deg), each true
/// component against the nearest identified one.
fn errors(state: &SeaState, planes: &[Plane]) -> (f64, f64) {
    let mut worst = (0.0_f64, 0.0_f64);
    for p in planes {
        let Some(c) = state
            .components
            .iter()
            .min_by(|a, b| (a.omega - p.omega).abs().total_cmp(&(b.omega - p.omega).abs()))
        else {
            return (f64::INFINITY, f64::INFINITY);
        };
        worst.0 = worst.0.max((c.omega / p.omega - 1.0).abs());
        worst.1 = worst
            .1
            .max(wrap_angle(c.direction - p.direction).abs().to_degrees());
    }
    worst
}

#[test]
fn identifier_resolves_three_components_within_a_minute() {
    for (s, limit) in [(1.1, 0.02), (1.2, 0.01), (1.3, 0.01), (1.4, 0.01), (1.5, 0.01)] {
        for seed in 0..4 {
            let planes = paper(seed, 0.5, 5.0, s);
            let state = identify(&voyage(seed, 61.0, STILL, &|_| planes.clone()).samples()).unwrap();
            let (f, d) = errors(&state, &planes);
            assert!(
                f < limit && d < 10.0,
                "s {s} seed {seed}: {f} {d} {:?}",
                state.components
            );
            assert_eq!(state.verdict, Verdict::Identified);
            assert!(state.confidence > 0.9, "{}", state.confidence);
        }
    }
}

#[test]
fn identifier_is_usable_after_30_s() {
    for seed in 0..4 {
        let planes = paper(seed, 0.5, 5.0, 1.3);
        let state = identify(&voyage(seed, 27.0, STILL, &|_| planes.clone()).samples()).unwrap();
        let (f, _) = errors(&state, &planes);
        assert!(f < 0.02, "seed {seed}: {f}");
        assert!(
            state.confidence < 0.9,
            "a short record is not fully trusted: {}",
            state.confidence
        );
    }
}

#[test]
fn identifier_recovers_heave_and_significant_height() {
    let planes = paper(1, 0.5, 5.0, 1.3);
    let state = identify(&voyage(1, 61.0, STILL, &|_| planes.clone()).samples()).unwrap();
    let variance: f64 = planes.iter().map(|p| 0.5 * p.a * p.a).sum();
    assert!((state.significant_height_m / (4.0 * variance.sqrt()) - 1.0).abs() < 0.05);
    for c in state.components.iter() {
        let p = planes
            .iter()
            .min_by(|a, b| (a.omega - c.omega).abs().total_cmp(&(b.omega - c.omega).abs()))
            .unwrap();
        assert!((c.amplitude_heave_m / p.a - 1.0).abs() < 0.1);
    }
}

#[test]
fn identifier_keeps_earth_frame_frequencies_through_a_turn() {
    let turn = |t: f64| {
        let a = ((t - 35.0) / 5.0).clamp(0.0, 1.0) * core::f64::consts::FRAC_PI_2;
        [2.0 * a.cos(), 2.0 * a.sin()]
    };
    for seed in 0..4 {
        let planes = paper(seed, 0.5, 5.0, 1.4);
        let state = identify(&voyage(seed, 61.0, &turn, &|_| planes.clone()).samples()).unwrap();
        let (f, d) = errors(&state, &planes);
        assert!(f < 0.02 && d < 10.0, "seed {seed}: {f} {d}");
        let u = state.mean_velocity;
        assert!(u[0].abs() < 0.2 && (u[1] - 2.0).abs() < 0.2, "{u:?}");
    }
}

#[test]
fn identifier_follows_a_changed_sea_within_a_minute() {
    for seed in 0..3 {
        let (before, after) = (paper(seed, 0.5, 5.0, 1.3), paper(seed + 77, 0.8, 6.3, 1.2));
        let sea = |t: f64| {
            if t < 70.0 { before.clone() } else { after.clone() }
        };
        let state = identify(&voyage(seed, 140.0, STILL, &sea).samples()).unwrap();
        let (f, _) = errors(&state, &after);
        assert!(f < 0.02, "seed {seed}: {f} {:?}", state.components);
    }
}

#[test]
fn identifier_finds_no_components_in_a_calm_sea() {
    let state = identify(&voyage(3, 61.0, STILL, &|_| Vec::new()).samples()).unwrap();
    assert_eq!(state.verdict, Verdict::Calm);
    assert!(state.components.is_empty());
    assert_eq!(state.significant_height_m, 0.0);
}

#[test]
fn identifier_finds_a_single_wave_and_a_fast_small_deck() {
    let fast = paper(5, 0.03, 1.43, 1.3);
    let state = identify(&voyage(5, 61.0, STILL, &|_| fast.clone()).samples()).unwrap();
    assert!(errors(&state, &fast).0 < 0.01);
    let single = paper(6, 0.5, 5.0, 1.3)[..1].to_vec();
    let state = identify(&voyage(6, 61.0, STILL, &|_| single.clone()).samples()).unwrap();
    assert!(errors(&state, &single).0 < 0.01);
    assert_eq!(state.components.len(), 1);
}

#[test]
fn identifier_bounds_its_components_in_an_irregular_sea() {
    let planes = jonswap(2, 2.0, 6.0);
    let state = identify(&voyage(2, 90.0, STILL, &|_| planes.clone()).samples()).unwrap();
    assert!(state.components.len() <= MAX_COMPONENTS);
    for c in state.components.iter() {
        assert!((0.3..=7.0).contains(&c.omega));
        assert!(c.amplitude_heave_m < 3.0, "{c:?}");
    }
    assert!(state.confidence < 1.0);
}

/// Tilt (north, east) ahead of the end of `samples`: by the state, by holding, by a fixed bank of
/// five frequencies fitted to the last 20 s.
fn prediction_errors(
    samples: &[(MotionSample, [f64; 2])],
    state: &SeaState,
    ahead: f64,
) -> ([f64; 2], [f64; 2], [f64; 2]) {
    let last = samples[samples.len() - 1].0;
    let tau = (last.at - state.at).secs() + ahead;
    let ours = core::array::from_fn(|i| {
        state
            .components
            .iter()
            .map(|c| (c.normal[i] * Complex::from_polar(1.0, c.encounter(state.mean_velocity) * tau)).re)
            .sum()
    });
    let bank: Vec<f64> = (0..5)
        .map(|i| 0.8 * (2.5_f64 / 0.8).powf(f64::from(i) / 4.0))
        .collect();
    let row = |t: f64| {
        let mut x = vec![1.0];
        for w in &bank {
            x.extend([(w * t).cos(), (w * t).sin()]);
        }
        DVector::from_vec(x)
    };
    let mut gram = DMatrix::<f64>::identity(11, 11) * 0.3;
    let mut moment = [DVector::<f64>::zeros(11), DVector::<f64>::zeros(11)];
    for (s, _) in &samples[samples.len() - 500..] {
        let x = row((s.at - last.at).secs());
        gram += &x * x.transpose();
        for i in 0..2 {
            moment[i] += &x * s.normal[i];
        }
    }
    let factor = gram.cholesky().unwrap();
    let fixed = core::array::from_fn(|i| factor.solve(&moment[i]).dot(&row(ahead)));
    (ours, last.normal, fixed)
}

#[test]
fn identified_sea_predicts_2_s_better_than_holding_or_a_fixed_bank() {
    let (mut ours, mut hold, mut bank) = (0.0, 0.0, 0.0);
    for seed in 0..6 {
        let planes = paper(seed, 0.5, 5.0, 1.1 + 0.08 * seed as f64);
        let samples = voyage(seed, 63.0, STILL, &|_| planes.clone()).samples();
        let record = &samples[..1525];
        let state = identify(record).unwrap();
        let end = (record[record.len() - 1].0.at - Time::from_secs(1000.0)).secs();
        let y = truth(&planes, end + 2.0, [0.0; 2], [0.0; 2]);
        let (a, b, c) = prediction_errors(record, &state, 2.0);
        let error = |x: [f64; 2]| (x[0] - y[1]).powi(2) + (x[1] - y[2]).powi(2);
        ours += error(a);
        hold += error(b);
        bank += error(c);
    }
    // Trims and noise are in the other two; both are small beside their errors.
    assert!(ours < 0.05 * hold && ours < 0.05 * bank, "{ours} {hold} {bank}");
}

#[test]
fn identifier_tolerates_uneven_times_gaps_and_repeats() {
    let planes = paper(4, 0.5, 5.0, 1.3);
    let mut random = jitter(4);
    let mut identifier = Identifier::new(&SeaStateConfig::default());
    let mut state = None;
    let samples = voyage(4, 62.0, STILL, &|_| planes.clone()).samples();
    for (i, (s, _)) in samples.iter().enumerate() {
        // A third is lost, two seconds are missing, each tenth comes twice, each twentieth is not finite.
        if random() < 0.33 || (800..850).contains(&i) {
            continue;
        }
        identifier.push(s);
        if i % 10 == 0 {
            identifier.push(s);
        }
        if i % 20 == 0 {
            identifier.push(&MotionSample {
                acceleration_up: f64::NAN,
                ..*s
            });
        }
        state = identifier.update(s.at, WaveNonlinearity::default()).cloned();
    }
    let (f, d) = errors(&state.unwrap(), &planes);
    assert!(f < 0.01 && d < 10.0, "{f} {d}");
    assert!(identifier.rejected() > 100);
}

#[test]
fn identifier_goes_stale_in_silence_and_restarts_after_a_clock_jump() {
    let planes = paper(7, 0.5, 5.0, 1.3);
    let samples = voyage(7, 50.0, STILL, &|_| planes.clone()).samples();
    let mut identifier = Identifier::new(&SeaStateConfig::default());
    for (s, _) in &samples {
        identifier.push(s);
        identifier.update(s.at, WaveNonlinearity::default());
    }
    let end = samples[samples.len() - 1].0.at;
    assert!(identifier.update(end, WaveNonlinearity::default()).is_some());
    assert!(
        identifier
            .update(end + Span::from_secs(20.0), WaveNonlinearity::default())
            .is_none()
    );
    // One stamp from a far future, then the old clock again: the record recovers.
    identifier.push(&MotionSample {
        at: end + Span::from_secs(1e6),
        ..samples[0].0
    });
    let mut state = None;
    for (s, _) in &samples {
        identifier.push(s);
        state = identifier.update(s.at, WaveNonlinearity::default()).cloned();
    }
    assert!(errors(&state.unwrap(), &planes).0 < 0.02);
}

#[test]
fn identifier_is_deterministic() {
    let planes = paper(8, 0.5, 5.0, 1.2);
    let samples = voyage(8, 45.0, STILL, &|_| planes.clone()).samples();
    assert_eq!(identify(&samples), identify(&samples));
}

fn any_sample() -> impl Strategy<Value = MotionSample> {
    let number = || {
        prop_oneof![
            Just(f64::NAN),
            Just(f64::INFINITY),
            -1e300..1e300f64,
            -2.0..2.0f64,
            -0.5..0.5f64
        ]
    };
    (
        -5_000_000_000i64..120_000_000_000i64,
        number(),
        number(),
        number(),
        number(),
        number(),
    )
        .prop_map(|(ns, a, b, c, d, e)| MotionSample {
            at: Time::<VesselClock>::from_nanos(ns),
            mean_velocity: [a, b],
            normal: [c, d],
            acceleration_up: e,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn identifier_stays_in_range_for_any_input(
        mut samples in proptest::collection::vec(any_sample(), 1..600),
        sorted in any::<bool>(),
    ) {
        if sorted {
            samples.sort_by_key(|s| s.at);
        }
        let mut identifier = Identifier::new(&SeaStateConfig::default());
        for s in &samples {
            identifier.push(s);
            if let Some(state) = identifier.update(s.at, WaveNonlinearity::default()) {
                prop_assert!((0.0..=1.0).contains(&state.confidence));
                prop_assert!(state.significant_height_m.is_finite());
                for c in state.components.iter() {
                    prop_assert!((0.3..=7.0).contains(&c.omega));
                    prop_assert!(c.direction.abs() <= 3.2 && (0.0..=3.2).contains(&c.direction_sd));
                    prop_assert!(c.heave.norm().is_finite() && c.amplitude_tilt_rad.is_finite());
                }
            }
        }
    }
}

#[test]
fn identifier_directions_are_robust_to_orbital_motion_in_a_drift() {
    for seed in 0..4 {
        let planes = paper(seed, 0.8, 5.0, 1.3);
        let along = planes[1].direction;
        let drift = [0.35 * along.cos(), 0.35 * along.sin()];
        let mut samples = voyage(seed, 61.0, &|_| drift, &|_| planes.clone()).samples();
        for (i, (s, _)) in samples.iter_mut().enumerate() {
            let (sin, cos) = (1.25 * i as f64 / 25.0).sin_cos();
            s.mean_velocity[0] += 0.8 * cos;
            s.mean_velocity[1] += 0.8 * sin;
        }
        let state = identify(&samples).unwrap();
        let (f, d) = errors(&state, &planes);
        assert!(
            f < 0.01 && d < 10.0,
            "seed {seed}: {f} {d} {:?}",
            state.components
        );
        let off = (state.mean_velocity[0] - drift[0]).hypot(state.mean_velocity[1] - drift[1]);
        assert!(off < 0.1, "seed {seed}: {:?}", state.mean_velocity);
    }
}

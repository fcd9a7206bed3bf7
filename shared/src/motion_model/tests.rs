//! Identification of motions with known modes.

use crate::vessel_model::{HEAVE, PITCH, ROLL};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::{
    msg::{Header, Seq, UpdateReceiver, WaveMode, WaveModel, WaveSender},
    time::VesselClock,
    wire::encode,
};

/// Heave and tilt of waves (rad/s, m, rad, phase) at time `t`, ordered as a sample's value, and rates.
fn waves(t: f64) -> ([f64; DOFS], [f64; 5]) {
    let mut value = [0.0; DOFS];
    let mut rate = [0.0; 5];
    value[ROLL] = 0.05;
    for (omega, heave, tilt, phase) in [
        (1.15, 0.4, 0.03, 0.2),
        (1.26, 0.3, -0.02, 2.0),
        (2.4, 0.1, 0.05, 4.0_f64),
    ] {
        let (s, c) = f64::sin_cos(omega * t + phase);
        let parts = [
            (HEAVE, heave * c, -heave * omega * s),
            (ROLL, tilt * s, tilt * omega * c),
            (PITCH, -tilt * c, tilt * omega * s),
        ];
        for (k, (dof, v, r)) in parts.into_iter().enumerate() {
            value[dof] += v;
            rate[k] += r;
        }
    }
    (value, rate)
}

/// Relative error of the tilt predicted one second ahead while the vessel turns by 90 deg every 25 s. The
/// waves either roll the vessel about its own axes or tilt the water in a fixed direction.
fn error_on_a_square(turns_with_vessel: bool) -> f64 {
    let mut model = MotionModel::<VesselClock>::default();
    let mut waiting = std::collections::VecDeque::new();
    let mut squares = 0.0;
    let mut motion = 0.0;
    for k in 0..3000 {
        let t = SAMPLE_S * f64::from(k);
        let leg = (t / 25.0).floor();
        let since = t % 25.0;
        let heading = core::f64::consts::FRAC_PI_2 * (leg + (since / 8.0).min(1.0));
        let axes = if turns_with_vessel { heading } else { 0.0 };
        let (tilt, rate) = [(1.15, 0.04), (1.7, 0.03), (2.4, 0.02)]
            .into_iter()
            .fold((0.0, 0.0), |(v, r), (w, a): (f64, f64)| {
                (v + a * (w * t).sin(), r + a * w * (w * t).cos())
            });
        let (s, c) = axes.sin_cos();
        let mut sample = MotionSample {
            at: Time::from_secs(t),
            mean_heading: heading,
            value: [0.0; DOFS],
            rate: [0.0, c * rate, s * rate, 0.0, 0.0],
            level_variance: 0.0,
        };
        (sample.value[ROLL], sample.value[PITCH]) = (c * tilt, s * tilt);
        model.push(sample);
        model.work();
        let predicted = model.motion(1.0);
        waiting.push_back([predicted[ROLL][0], predicted[PITCH][0]]);
        if waiting.len() > 10
            && let Some([roll, pitch]) = waiting.pop_front()
            && t > 100.0
        {
            squares += (roll - c * tilt).powi(2) + (pitch - s * tilt).powi(2);
            motion += tilt * tilt;
        }
    }
    (squares / motion).sqrt()
}

#[test]
fn motion_model_of_both_hulls_in_turns() {
    for turns_with_vessel in [false, true] {
        let error = error_on_a_square(turns_with_vessel);
        assert!(
            error < 0.35,
            "turns with the vessel: {turns_with_vessel}: {error}"
        );
    }
}

/// Boat in waves that turns and heels by `heel` (rad) from 120 s on. Returns the rms error of the tilt one second ahead
/// over two minutes, rad, and the maximum difference between a prediction's start and the estimate, m or rad.
fn error_with_heel(heel: f64) -> (f64, f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut model = MotionModel::<VesselClock>::default();
    let mut waiting = std::collections::VecDeque::new();
    let mut squares = 0.0;
    let mut apart = 0.0_f64;
    for k in 0..2400 {
        let t = SAMPLE_S * f64::from(k);
        let (mut value, rate) = waves(t);
        let (mean_heading, heel) = if t < 120.0 {
            (0.0, 0.0)
        } else {
            (0.05 * (t - 120.0), heel)
        };
        let [north, east] = turned([heel, 0.0], -mean_heading);
        (value[ROLL], value[PITCH]) = (value[ROLL] + north, value[PITCH] + east);
        let mut noisy =
            |v: f64| v + 0.003 * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let estimated = value.map(&mut noisy);
        model.push(MotionSample {
            at: Time::from_secs(t),
            mean_heading,
            value: estimated,
            rate: rate.map(&mut noisy),
            level_variance: 0.0,
        });
        model.work();
        let now = about(model.heel(mean_heading), model.motion(0.0));
        for d in [HEAVE, ROLL, PITCH] {
            apart = apart.max((now[d][0] - estimated[d]).abs());
        }
        let ahead = about(model.heel(mean_heading + 0.05), model.motion(1.0));
        waiting.push_back([ahead[ROLL][0], ahead[PITCH][0]]);
        if waiting.len() > 10
            && let Some([roll, pitch]) = waiting.pop_front()
            && t > 121.0
        {
            squares += (roll - value[ROLL]).powi(2) + (pitch - value[PITCH]).powi(2);
        }
    }
    ((squares / 1190.0).sqrt(), apart)
}

/// A turn heels the boat by 3 deg. A prediction about the mean of the last 100 s would be 2 deg off for a minute.
#[test]
fn heel_of_a_turn_within_seconds() {
    let (upright, _) = error_with_heel(0.0);
    let (heeled, apart) = error_with_heel(0.052);
    assert!(heeled < upright + 0.006, "{heeled} rad for {upright}");
    assert!(apart < 1e-9, "a prediction begins {apart} off the estimate");
}

/// Model after `seconds` of these waves with white noise of this amplitude.
fn after(seconds: f64, noise: f64) -> MotionModel<VesselClock> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut model = MotionModel::default();
    for k in 0..(seconds / SAMPLE_S) as u32 {
        let at = Time::from_secs(SAMPLE_S * f64::from(k));
        let (value, rate) = waves(at.secs());
        let mut noisy =
            |v: f64| v + noise * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let sample = MotionSample {
            at,
            mean_heading: 0.0,
            value: value.map(&mut noisy),
            rate: rate.map(&mut noisy),
            level_variance: 0.0,
        };
        assert!(model.is_due(at));
        model.push(sample);
        model.work();
    }
    model
}

#[test]
fn motion_model_frequencies_and_prediction() {
    let model = after(120.0, 0.003);
    let modes = model.modes().unwrap();
    for omega in [1.15, 1.26, 2.4] {
        let near = |m: &&Mode| (m.pole.im - omega).abs() < 0.03;
        let found = modes.modes.iter().find(near).unwrap();
        assert!(-found.pole.re < 0.05, "{omega}: {}", found.pole);
    }
    for ahead in [0.0, 0.5, 1.0, 2.0] {
        let (truth, _) = waves(modes.at.secs() + ahead);
        let predicted = about(model.heel(0.0), model.motion(ahead));
        for (dof, limit) in [(HEAVE, 0.02), (ROLL, 0.006), (PITCH, 0.006)] {
            let off = predicted[dof][0] - truth[dof];
            assert!(off.abs() < limit, "{dof} {ahead} s ahead: {off}");
        }
    }
    let heave = model.spread(1.0)[HEAVE];
    assert!((0.001..0.03).contains(&heave), "{heave}");
}

#[test]
fn motion_model_after_a_gap_and_nan() {
    let mut model = after(60.0, 0.003);
    assert!(model.modes().is_some());
    let sample = |at: f64, v: f64| MotionSample {
        at: Time::from_secs(at),
        mean_heading: 0.0,
        value: [v; DOFS],
        rate: [0.0; 5],
        level_variance: 0.0,
    };
    model.push(sample(60.0, f64::NAN));
    assert!(model.modes().is_some());
    model.push(sample(63.0, 0.1));
    let fading = &model.modes().unwrap().modes;
    assert!(
        matches!(&fading[..], [m] if m.pole.im == 0.0),
        "the past has a gap"
    );
}

/// The drone propagates the vessel's modes between two messages; most messages contain one factor per mode.
#[test]
fn wave_models_over_the_radio() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut noisy =
        |v: f64| v + 0.003 * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let mut model = MotionModel::<VesselClock>::default();
    let mut sender = WaveSender::default();
    let mut receiver = UpdateReceiver::default();
    let mut sizes = Vec::new();
    let mut whole = 0;
    let mut worst = 0.0_f64;
    for k in 0..1800 {
        let t = SAMPLE_S * f64::from(k);
        let (value, rate) = waves(t);
        model.push(MotionSample {
            at: Time::from_secs(t),
            mean_heading: 0.3,
            value: value.map(&mut noisy),
            rate: rate.map(&mut noisy),
            level_variance: 0.0,
        });
        model.work();
        if k < 600 || k % 2 != 0 {
            continue;
        }
        let modes = model.modes().unwrap();
        let sent = WaveModel {
            header: Header::new(1, 0, 7, k, modes.at),
            significant_height_m: 1.0,
            confidence: 1.0,
            modes: Seq::filled(modes.modes.iter().map(WaveMode::from)),
            slopes: Seq::filled([10; 60]),
            advice: None,
        };
        let update = sender.update(&sent);
        sizes.push(encode(&update).unwrap().len());
        whole += u32::from(!update.modes.is_empty());
        let received = Modes::from(&receiver.waves(&update).unwrap());
        for ahead in [0.0, 1.0, 2.0] {
            let a = received.motion(ahead);
            let b = modes.motion(ahead);
            for (dof, of) in [(HEAVE, 0.5), (ROLL, 0.06), (PITCH, 0.06)] {
                worst = worst.max((a[dof][0] - b[dof][0]).abs() / of);
            }
        }
    }
    let bytes = sizes.iter().sum::<usize>() as f64 / sizes.len() as f64;
    assert!(
        f64::from(whole) < 0.5 * sizes.len() as f64,
        "{whole} of {}",
        sizes.len()
    );
    assert!(worst < 0.02, "{worst}");
    assert!(bytes < 480.0, "{bytes}");
}

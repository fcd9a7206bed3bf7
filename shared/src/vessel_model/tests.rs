//! The model against independent calculations.

use nalgebra::DMatrix;

use super::*;
use crate::config::{Check, Keys};
use crate::estimation::Update;

fn waves() -> Vec<Component> {
    [(1.26, 0.4), (1.05, 0.0), (1.5, -0.4)]
        .iter()
        .map(|&(omega, direction)| Component {
            omega,
            direction,
            direction_sd: 0.1,
            omega_encounter: omega,
            damping: 0.02,
            drive: core::array::from_fn(|d| 0.01 * (d + 1) as f64),
        })
        .collect()
}
fn coupled() -> VesselModelConfig {
    VesselModelConfig {
        inertia_coupling: vec![Coupling {
            row: SWAY,
            column: YAW,
            value: 60.0,
        }],
        stiffness_coupling: vec![Coupling {
            row: HEAVE,
            column: PITCH,
            value: -4e3,
        }],
        ..Default::default()
    }
}
fn spec() -> BeliefSpec {
    BeliefSpec {
        couplings: vec![(SURGE, PITCH), (SWAY, ROLL)],
        extras: core::array::from_fn(|d| {
            let bias = Extra {
                sd: 0.1,
                walk: 0.01,
                time_s: f64::INFINITY,
            };
            if d == PITCH || d == ROLL {
                vec![bias]
            } else {
                vec![]
            }
        }),
        initial_sd: [[1.0, 0.5]; 6],
    }
}
/// A belief with some values everywhere.
fn filled(model: &VesselModel) -> Belief {
    let mut b = Belief::new(model, &spec());
    for dof in 0..DOFS {
        for slot in 0..b.layout().slots(dof) {
            b.set(dof, slot, 0.1 * ((3 * dof + 7 * slot) % 11) as f64 - 0.4);
        }
    }
    b
}

/// The whole continuous system of a group at once, as paper eq. 1-3 write it.
fn dense(model: &VesselModel, dofs: &[usize]) -> (DMatrix<f64>, DMatrix<f64>) {
    let (nc, c) = (model.components().len(), model.config());
    let stride = HEAD + 2 * nc;
    let n = stride * dofs.len();
    let (mut f, mut w) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let inverse = c.inertia().try_inverse().unwrap();
    let (drag, spring) = (inverse * c.damping(), inverse * c.stiffness());
    for (li, &i) in dofs.iter().enumerate() {
        let r = li * stride;
        f[(r + ETA, r + NU)] = 1.0;
        for (lk, &k) in dofs.iter().enumerate() {
            let s = lk * stride;
            f[(r + NU, s + ETA)] = -spring[(i, k)];
            f[(r + NU, s + NU)] = -drag[(i, k)];
            let stiff = c.stiffness()[(k, k)] > 0.0;
            let input = if stiff {
                spring[(i, k)]
            } else {
                f64::from(u8::from(i == k))
            };
            f[(r + NU, s + SLOW)] = if stiff { spring[(i, k)] } else { drag[(i, k)] };
            f[(r + NU, s + DISTURBANCE)] = input;
            for j in 0..nc {
                f[(r + NU, s + HEAD + 2 * j)] = input;
            }
        }
        w[(r, r)] = c.eta_walk_m_rad[i].powi(2);
        w[(r + SLOW, r + SLOW)] = c.slow_walk_mps_m_rad_radps[i].powi(2);
        let tau = c.disturbance_time_s[i];
        f[(r + DISTURBANCE, r + DISTURBANCE)] = -1.0 / tau;
        w[(r + DISTURBANCE, r + DISTURBANCE)] = 2.0 * c.disturbance_sd_mps2_m_rad_radps2[i].powi(2) / tau;
        for (j, wave) in model.components().iter().enumerate() {
            let (v, o) = (r + HEAD + 2 * j, wave.omega_encounter);
            f[(v, v + 1)] = 1.0;
            f[(v + 1, v)] = -o * o;
            f[(v + 1, v + 1)] = -2.0 * wave.damping * o;
            w[(v + 1, v + 1)] = wave.drive[i];
        }
    }
    (f, w)
}

#[test]
fn discretisation_by_parts_equals_van_loan_of_the_whole() {
    let config = coupled();
    assert!(config.check(&Keys::ROOT).is_ok());
    let model = VesselModel::new(&config, &waves());
    assert_eq!(model.groups().len(), 4, "{:?}", model.groups());
    for dt in [0.01, 0.1] {
        for g in &model.discretise(dt).groups {
            let (f, w) = dense(&model, &g.dofs);
            let (a, q) = van_loan(&f, &w, dt);
            assert!((&g.a - a).amax() < 1e-10, "A of {:?}", g.dofs);
            assert!((&g.q - q).amax() < 1e-12, "Q of {:?}", g.dofs);
        }
    }
}

#[test]
fn horizon_equals_stepping() {
    let model = VesselModel::new(&coupled(), &waves());
    let mut belief = filled(&model);
    let horizon = Horizon::new(&model, 0.1, 20);
    let start = belief.clone();
    let step = belief.step(&model, 0.1);
    for k in 0..=20 {
        for dof in 0..DOFS {
            let m = horizon.mean(&start, dof, k);
            assert!((m[0] - belief.get(dof, ETA)).abs() < 1e-9);
            assert!((m[1] - belief.get(dof, NU)).abs() < 1e-9);
            assert!(
                (m[2] - belief.acceleration(&model, dof)).abs() < 1e-7,
                "{dof} {k}"
            );
            let (p, e) = (horizon.covariance(&start, dof, k), belief.motion_covariance(dof));
            for i in 0..3 {
                assert!(
                    (p[i] - e[i]).abs() < 1e-9 * (1.0 + e[i].abs()),
                    "{dof} {k} {p:?} {e:?}"
                );
            }
        }
        belief.propagate(&step);
    }
}

#[test]
fn heave_follows_a_long_wave() {
    // Given a stiff follower and a 5 s wave alone.
    let mut wave = waves()[0];
    wave.drive = [0.0; 6];
    wave.damping = 1e-4;
    let model = VesselModel::new(&VesselModelConfig::default(), &[wave]);
    let mut b = Belief::new(&model, &spec());
    b.set(HEAVE, b.layout().value(HEAVE, 0), 0.5);
    b.set(HEAVE, ETA, 0.5);
    let step = b.step(&model, 0.05);
    let mut worst = 0.0_f64;
    for _ in 0..400 {
        b.propagate(&step);
        worst = worst.max((b.get(HEAVE, ETA) - b.wave(HEAVE)).abs());
    }
    // Then heave is the wave to a few per cent of its amplitude (phase lag 2 zeta omega / omega_n).
    assert!(worst < 0.06, "{worst}");
    assert!(worst > 1e-3, "the hull's own dynamics must be there");
}

#[test]
fn belief_turned_there_and_back_keeps_its_mean() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves());
    let before = filled(&model);
    let mut b = before.clone();
    b.turn(0.7);
    let length = |b: &Belief, slot| b.get(SURGE, slot).hypot(b.get(SWAY, slot));
    assert!((length(&b, NU) - length(&before, NU)).abs() < 1e-12);
    // A velocity to the north of a frame that has turned east points to port.
    let mut north = before.clone();
    north.set(SURGE, NU, 1.0);
    north.set(SWAY, NU, 0.0);
    north.turn(core::f64::consts::FRAC_PI_2);
    assert!(north.get(SURGE, NU).abs() < 1e-12 && (north.get(SWAY, NU) + 1.0).abs() < 1e-12);
    // Trim and biases belong to the body.
    assert_eq!(b.get(PITCH, SLOW), before.get(PITCH, SLOW));
    assert_eq!(b.get(ROLL, HEAD), before.get(ROLL, HEAD));
    b.turn(-0.7);
    for dof in 0..DOFS {
        for slot in 0..b.layout().slots(dof) {
            assert!((b.get(dof, slot) - before.get(dof, slot)).abs() < 1e-12);
        }
    }
}

#[test]
fn turn_tilt_keeps_the_normal_and_agrees_with_the_linear_rotation() {
    let (roll, pitch, delta) = (0.2, -0.15, 1.1);
    let (r, p) = turn_tilt(roll, pitch, delta);
    let normal = |r: f64, p: f64, y: f64| {
        nalgebra::UnitQuaternion::from_euler_angles(r, p, y) * nalgebra::Vector3::z()
    };
    assert!((normal(roll, pitch, 0.3) - normal(r, p, 0.3 + delta)).norm() < 1e-12);
    let (r, p) = turn_tilt(1e-3, 2e-3, delta);
    let (s, c) = delta.sin_cos();
    assert!((r - (c * 1e-3 + s * 2e-3)).abs() < 1e-8 && (p - (-s * 1e-3 + c * 2e-3)).abs() < 1e-8);
}

#[test]
fn encounter_frequency_falls_in_following_seas() {
    // 2 m/s with a 5 s wave: omega² U / g = 0.322 rad/s.
    let o = core::f64::consts::TAU / 5.0;
    let with = encounter_frequency(o, 0.0, [2.0, 0.0]);
    let against = encounter_frequency(o, core::f64::consts::PI, [2.0, 0.0]);
    let beam = encounter_frequency(o, core::f64::consts::FRAC_PI_2, [2.0, 0.0]);
    assert!((o - with - 0.322).abs() < 1e-3 && (against - o - 0.322).abs() < 1e-3);
    assert!((beam - o).abs() < 1e-12);
}

#[test]
fn change_of_model_keeps_value_and_amplitude() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves());
    let mut b = filled(&model);
    let l = b.layout().clone();
    let (value, rate) = (b.get(HEAVE, l.value(HEAVE, 1)), b.get(HEAVE, l.rate(HEAVE, 1)));
    let total = b.wave(HEAVE);
    // Component 1 moves by 5 %, component 2 disappears into its neighbour.
    let mut moved = waves();
    moved.truncate(2);
    moved[1].omega_encounter *= 1.05;
    b.change_model(&VesselModel::new(&VesselModelConfig::default(), &moved), 0.2);
    let l = b.layout().clone();
    assert_eq!(b.get(HEAVE, l.value(HEAVE, 1)), value);
    assert!((b.get(HEAVE, l.rate(HEAVE, 1)) - 1.05 * rate).abs() < 1e-12);
    assert!((b.wave(HEAVE) - total).abs() < 1e-12, "the sum is handed on");
    assert!(b.is_finite());
}

#[test]
fn wave_message_carries_the_oscillators_in_ned() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves());
    let belief = filled(&model);
    let mut north = belief.clone();
    north.turn(-0.6);
    let message = belief.wave_message(0.6);
    assert_eq!(message.len(), 3);
    for (j, wave) in message.iter().enumerate() {
        for dof in 0..DOFS {
            let slot = belief.layout().value(dof, j);
            assert!((f64::from(wave.state[dof][0]) - north.get(dof, slot)).abs() < 1e-6);
            assert!((f64::from(wave.state[dof][1]) - north.get(dof, slot + 1)).abs() < 1e-6);
        }
    }
}

#[test]
fn update_leaves_the_state_on_a_gated_outlier() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves()[..1]);
    let mut belief = Belief::new(&model, &spec());
    let before = belief.clone();
    let row = [Term::new(HEAVE, ETA, 1.0)];
    assert!(matches!(
        belief.update(&row, 50.0, 0.1, 5.4),
        Update::Gated { .. }
    ));
    assert_eq!(belief.update(&row, f64::NAN, 0.1, 5.4), Update::Invalid);
    for (b, old) in belief.blocks().iter().zip(before.blocks()) {
        assert_eq!((&b.x, &b.p), (&old.x, &old.p));
    }
}

#[test]
fn update_across_blocks_gives_exact_marginals() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves()[..1]);
    let row = [Term::new(HEAVE, ETA, 1.0), Term::new(YAW, ETA, 0.5)];
    let mut split = Belief::new(&model, &spec());
    let mut joint = Belief::new(
        &model,
        &BeliefSpec {
            couplings: vec![(HEAVE, YAW)],
            ..spec()
        },
    );
    assert!(matches!(split.update(&row, 0.3, 0.1, 9.0), Update::Fused { .. }));
    assert!(matches!(joint.update(&row, 0.3, 0.1, 9.0), Update::Fused { .. }));
    for dof in [HEAVE, YAW] {
        assert!((split.get(dof, ETA) - joint.get(dof, ETA)).abs() < 1e-12);
        assert!((split.variance(dof, ETA) - joint.variance(dof, ETA)).abs() < 1e-12);
    }
}

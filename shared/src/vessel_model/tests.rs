//! Comparison of the model with independent calculations.

use nalgebra::DMatrix;

use super::*;
use crate::{
    config::{Check, Keys},
    estimation::Update,
};

fn waves() -> Vec<Component> {
    [1.26, 1.05, 1.5]
        .iter()
        .map(|&omega| Component {
            omega,
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
fn filled(model: &VesselModel) -> Belief {
    let mut b = Belief::new(model, &spec());
    for dof in 0..DOFS {
        for slot in 0..b.layout().slots(dof) {
            b.set(dof, slot, 0.1 * ((3 * dof + 7 * slot) % 11) as f64 - 0.4);
        }
    }
    b
}

/// Complete continuous system of a group, as in eq. 1-3 of the paper.
fn dense(model: &VesselModel, dofs: &[usize]) -> (DMatrix<f64>, DMatrix<f64>) {
    let nc = model.components().len();
    let c = model.config();
    let stride = HEAD + 2 * nc;
    let n = stride * dofs.len();
    let mut f = DMatrix::zeros(n, n);
    let mut w = DMatrix::zeros(n, n);
    let inverse = c.inertia().try_inverse().unwrap();
    let drag = inverse * c.damping();
    let spring = inverse * c.stiffness();
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
            let v = r + HEAD + 2 * j;
            let o = wave.omega;
            f[(v, v + 1)] = 1.0;
            f[(v + 1, v)] = -o * o;
            f[(v + 1, v + 1)] = -2.0 * wave.damping * o;
            w[(v + 1, v + 1)] = wave.drive[i];
        }
    }
    (f, w)
}

#[test]
fn discretisation_by_parts_against_van_loan() {
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
fn heave_in_a_long_wave() {
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
    // Heave then equals the wave within a few per cent of its amplitude (phase lag 2 zeta omega / omega_n).
    assert!(worst < 0.06, "{worst}");
    assert!(worst > 1e-3, "the hull's own dynamics must be there");
}

#[test]
fn belief_turned_there_and_back() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves());
    let before = filled(&model);
    let mut b = before.clone();
    b.turn(0.7);
    let length = |b: &Belief, slot| b.get(SURGE, slot).hypot(b.get(SWAY, slot));
    assert!((length(&b, NU) - length(&before, NU)).abs() < 1e-12);
    // A northward velocity in a frame that has turned east points to port.
    let mut north = before.clone();
    north.set(SURGE, NU, 1.0);
    north.set(SWAY, NU, 0.0);
    north.turn(core::f64::consts::FRAC_PI_2);
    assert!(north.get(SURGE, NU).abs() < 1e-12 && (north.get(SWAY, NU) + 1.0).abs() < 1e-12);
    // Trim and biases are fixed to the body.
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
fn turn_tilt_against_linear_rotation() {
    let roll = 0.2;
    let pitch = -0.15;
    let delta = 1.1;
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
fn update_with_a_rejected_outlier() {
    let model = VesselModel::new(&VesselModelConfig::default(), &waves()[..1]);
    let mut belief = Belief::new(&model, &spec());
    let before = belief.clone();
    let row = [Term::new(HEAVE, ETA, 1.0)];
    assert!(matches!(
        belief.update(&row, 50.0, 0.1, 5.4),
        Update::Rejected { .. }
    ));
    assert_eq!(belief.update(&row, f64::NAN, 0.1, 5.4), Update::Invalid);
    for (b, old) in belief.blocks().iter().zip(before.blocks()) {
        assert_eq!((&b.x, &b.p), (&old.x, &old.p));
    }
}

#[test]
fn update_across_blocks() {
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

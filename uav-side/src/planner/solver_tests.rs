use alight_shared::geometry::DroneGeometry;
use nalgebra::SVector;

use super::{
    condensed::{Condensed, StageCost},
    mpc_faa::{Side, heading_free},
    qp::NO_CEILING,
    tests::{
        approach::{ABOVE, Approach, MODERATE, naive_data},
        naive,
    },
    *,
};

/// Every tenth problem of a landing from 5 m off the deck's centre, and whether the solver was needed.
fn recorded(config: &PlannerConfig) -> Vec<(Problem, bool)> {
    let (mut all, mut count) = (Vec::new(), 0);
    let from = [ABOVE[0] - 4.0, ABOVE[1] + 3.0, ABOVE[2]];
    Approach::new(MODERATE, from, 2.0).land(config, |p, plan| {
        if count % 10 == 0 {
            all.push((p.problem().clone(), plan.iterations > 0));
        }
        count += 1;
    });
    all
}

fn weights_that_grow() -> Vec<StageCost<4>> {
    let cost = |k: u8| StageCost {
        reference: SVector::from([0.1 * f64::from(k), 0.5, 0.05, 0.0]),
        weight: SVector::from([30.0, 1.0, 1.0 + 100.0 * f64::from(k), 1.0]),
    };
    (0..20).map(cost).collect()
}

#[test]
fn condensed_solution_against_dense_optimum() {
    let c = PlannerConfig::default();
    let mut mpc = Mpc::new(&c, &DroneGeometry::default());
    let (mut compared, mut solution) = (0, Solution::default());
    for (mut problem, limited) in recorded(&c) {
        if limited {
            continue;
        }
        let ceiling = problem.ceiling.clone();
        mpc.solve(&mut problem, |k, _, _| ceiling[k], &mut solution);
        let dense = naive::unconstrained(&naive_data(&c, &mpc, &problem)).expect("positive definite");
        assert!(largest_difference(&solution.inputs, &dense) < 1e-8);
        compared += 1;
    }
    assert!(compared > 10, "{compared}");
}

#[test]
fn qp_solution_against_dense_optimum() {
    // Half of the default slew and less tilt, so that limits are often reached.
    let mut c = PlannerConfig::default();
    c.rotors.slew_per_s = 4.0;
    c.limits.tilt_deg = 10.0;
    c.limits.rates_rps = 0.5;
    let mut mpc = Mpc::new(&c, &DroneGeometry::default());
    let (mut compared, mut solution, mut worst) = (0, Solution::default(), 0.0_f64);
    for (mut problem, limited) in recorded(&c) {
        if !limited {
            continue;
        }
        let ceiling = problem.ceiling.clone();
        mpc.solve(&mut problem, |k, _, _| ceiling[k], &mut solution);
        assert_eq!(solution.solve, Solve::Optimal);
        let mut data = naive_data(&c, &mpc, &problem);
        // Late inputs hardly affect the cost, so only a small duality gap determines them.
        data.tolerance = 1e-12;
        let dense = naive::constrained(&data).expect("solved");
        worst = worst.max(largest_difference(&solution.inputs, &dense));
        let (ours, theirs) = (naive::cost(&data, &solution.inputs), naive::cost(&data, &dense));
        assert!(ours <= theirs + 1e-5 * (1.0 + theirs), "{ours} {theirs}");
        compared += 1;
    }
    assert!(compared > 20, "{compared}");
    // The tilt input has a range of 0.6, and the solver's duality gap is 1e-9.
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn factor_of_one_tilt_for_the_other() {
    let model = heading_free(&DroneGeometry::default());
    let chains = [model.x_chain(), model.y_chain()].map(|chain| chain.discrete(0.1));
    let [mut x, mut y] = chains.map(|model| Condensed::new(model, 20, 0.1));
    let mut adopts = y.clone();
    let cost = weights_that_grow();
    let state = SVector::from([0.4, -0.3, 0.1, 0.05]);
    let (mut own, mut adopted) = ([0.0; 20], [0.0; 20]);
    assert!(x.solve(&state, 0.02, &cost, &mut own));
    adopts.adopt_factor(&x);
    assert!(y.solve(&state, 0.02, &cost, &mut own) && adopts.solve(&state, 0.02, &cost, &mut adopted));
    assert_eq!(own, adopted);
}

fn largest_difference(a: &[[f64; 4]], b: &[[f64; 4]]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The side of a volume rotates and heaves with the deck, so the drone may be on the wrong side without having moved.
#[test]
fn planner_on_the_wrong_side_of_a_volume() {
    let config = PlannerConfig::default();
    let mut mpc = Mpc::new(&config, &DroneGeometry::default());
    let weight = config.follow.diagonal();
    let mut problem = Problem {
        reference: vec![[0.0; 12]; config.stages],
        weight: vec![weight; config.stages],
        sides: (0..config.stages)
            .map(|stage| Side {
                stage,
                normal: [0.98, 0.2, 0.0],
                offset: 3.0,
            })
            .collect(),
        ..Problem::default()
    };
    let mut solution = Solution::default();
    mpc.solve(&mut problem, |_, _, _| NO_CEILING, &mut solution);
    let tilt = solution.states.iter().map(|x| x[3].abs().max(x[4].abs()));
    let tilt = tilt.fold(0.0, f64::max);
    assert!(tilt < 1.02 * config.limits.tilt_deg.to_radians(), "{tilt}");
    let last = solution.states[config.stages - 1];
    assert!(0.98 * last[0] + 0.2 * last[1] > 2.9, "{last:?}");
}

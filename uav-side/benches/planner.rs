//! `cargo bench -p alight-uav --bench planner` times the planner's step (references, solve, message) over
//! recorded landings, then runs criterion on an unconstrained and a constrained solve of both planners.

// Parts that only the planner's tests use.
#[allow(dead_code)]
mod approach;
#[allow(dead_code)]
mod naive;

use core::hint::black_box;
use std::time::{Duration, Instant};

use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry},
    node::Node,
};
use alight_uav::planner;
use criterion::Criterion;

use approach::{ABOVE, Approach, BenchSea, MODERATE};
use planner::{
    Planner, PlannerConfig, PlannerKind,
    mpc_faa::{Mpc, Problem, Solution},
};

// A benchmark is a shell, not a node, so it may read a clock.
#[allow(clippy::disallowed_methods)]
fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let out = black_box(work());
    (out, start.elapsed())
}

fn main() {
    let mut criterion = Criterion::default()
        .configure_from_args()
        .sample_size(20)
        .measurement_time(Duration::from_secs(2));
    for kind in [PlannerKind::Alight, PlannerKind::MpcFaa] {
        let config = PlannerConfig {
            kind,
            ..PlannerConfig::default()
        };
        measure(&config, &mut criterion);
    }
    criterion.final_summary();
}

fn measure(config: &PlannerConfig, criterion: &mut Criterion) {
    let drone = DroneGeometry::default();
    let deck = DeckGeometry::default();
    let name = config.kind.name();
    let (mut steps, mut recorded): (Vec<Duration>, Vec<(Problem, u32)>) = Default::default();
    for phase in [0.0, 2.0, 4.0] {
        let mut planner = Planner::new(config, &drone, &deck, 1);
        // Covers the last metres of the approach, then tracking, descent, flare and contact.
        let from = [ABOVE[0] - 4.0, ABOVE[1] + 3.0, ABOVE[2]];
        let mut approach = Approach::new(BenchSea { phase, ..MODERATE }, from, 2.0);
        while approach
            .tick(|now, input| {
                let (out, time) = timed(|| planner.step(now, input));
                if let Some(plan) = &out.plan {
                    steps.push(time);
                    recorded.push((planner.problem().clone(), plan.iterations));
                }
                out.plan
            })
            .is_some()
        {}
    }
    steps.sort_unstable();
    let quantile = |q: f64| steps.get(((steps.len() as f64 - 1.0) * q).round() as usize);
    println!(
        "{name}: whole step: p50 {:?}, p99 {:?}, longest {:?} of {}, {} limited, most iterations {}",
        quantile(0.5).copied().unwrap_or_default(),
        quantile(0.99).copied().unwrap_or_default(),
        quantile(1.0).copied().unwrap_or_default(),
        steps.len(),
        recorded.iter().filter(|(_, iterations)| *iterations > 0).count(),
        recorded
            .iter()
            .map(|(_, iterations)| *iterations)
            .max()
            .unwrap_or_default()
    );
    let mut mpc = Mpc::new(config, &drone);
    let mut solution = Solution::default();
    for (limits, limited) in [("free", false), ("limited", true)] {
        let instance = recorded
            .iter()
            .rfind(|(_, iterations)| (*iterations > 0) == limited);
        let Some((problem, _)) = instance else { continue };
        let ceiling = problem.ceiling.clone();
        let mut problem = problem.clone();
        criterion.bench_function(&format!("{name}/{limits}"), |b| {
            b.iter(|| mpc.solve(&mut problem, |k, _, _| ceiling[k], &mut solution));
        });
    }
}

//! `cargo bench -p alight-uav --bench planner`: the planner's step (references, solve, message)
//! against the naive solve of the same problem, over recorded landings; then criterion
//! on a free and a limited instance.
#![allow(missing_docs)]

mod approach;
mod naive;

use core::hint::black_box;
use std::time::{Duration, Instant};

use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::node::Node;
use alight_uav::planner;
use criterion::Criterion;

use approach::{ABOVE, Approach, MODERATE, Sea, naive_data};
use planner::mpc_faa::{Mpc, Problem, Solution};
use planner::{Planner, PlannerConfig};

// A benchmark is a shell, not a node: it may read a clock.
#[allow(clippy::disallowed_methods)]
fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let out = black_box(work());
    (out, start.elapsed())
}

fn percentile(sorted: &[Duration], share: f64) -> f64 {
    let i = ((sorted.len() as f64 - 1.0) * share).round() as usize;
    sorted.get(i).map_or(f64::NAN, |d| d.as_secs_f64() * 1e6)
}

fn main() {
    let config = PlannerConfig::default();
    let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
    let mut mpc = Mpc::new(&config, &drone);
    let seas = [
        MODERATE,
        Sea {
            phase: 2.0,
            ..MODERATE
        },
        Sea {
            heave: 0.8,
            roll: 0.17,
            pitch: 0.2,
            phase: 4.0,
            ..MODERATE
        },
    ];
    // The loop is deterministic: each repetition meets the same problems, and the least time of
    // each counts, so that other processes of a busy machine do not.
    const REPEATS: usize = 5;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut recorded: Vec<(Problem, u32)> = Vec::new();
    for sea in seas {
        let first = recorded.len();
        for repeat in 0..REPEATS {
            let mut planner = Planner::new(&config, &drone, &deck, 1);
            // The last metres of the approach, tracking, descent, flare, contact.
            let mut approach = Approach::new(sea, [ABOVE[0] - 4.0, ABOVE[1] + 3.0, ABOVE[2]], 2.0);
            let mut i = first;
            while approach
                .tick(|now, input| {
                    let (out, time) = timed(|| planner.step(now, input));
                    if let Some(plan) = &out.plan {
                        if repeat == 0 {
                            ours.push(time);
                            recorded.push((planner.problem().clone(), plan.iterations));
                        } else if let Some(least) = ours.get_mut(i) {
                            *least = time.min(*least);
                        }
                        i += 1;
                    }
                    out.plan
                })
                .is_some()
            {}
            if repeat == 0 {
                println!("landing: {:?}", approach.contact);
            }
        }
    }
    let mut solution = Solution::default();
    let mut solves = vec![Duration::MAX; recorded.len()];
    for _ in 0..REPEATS {
        for ((problem, _), least) in recorded.iter().zip(&mut solves) {
            let mut problem = problem.clone();
            let ceiling = problem.ceiling.clone();
            let (_, time) = timed(|| mpc.solve(&mut problem, |k, _, _| ceiling[k], &mut solution));
            *least = time.min(*least);
        }
    }
    for (problem, _) in &recorded {
        let least = (0..2)
            .map(|_| timed(|| naive::constrained(&naive_data(&config, &mpc, problem))).1)
            .min();
        theirs.extend(least);
    }
    let limited = recorded.iter().filter(|(_, iterations)| *iterations > 0).count();
    println!("{} instances, {limited} with active limits", recorded.len());
    let mean = |d: &[Duration]| d.iter().sum::<Duration>().as_secs_f64() * 1e6 / d.len() as f64;
    let means = [mean(&ours), mean(&solves), mean(&theirs)];
    for list in [&mut ours, &mut solves, &mut theirs] {
        list.sort_unstable();
    }
    println!("microseconds                     p50       p99      mean");
    for (name, list, mean) in [
        ("planner step, all of it", &ours, means[0]),
        ("  of it the solve", &solves, means[1]),
        ("naive solve", &theirs, means[2]),
    ] {
        let (p50, p99) = (percentile(list, 0.5), percentile(list, 0.99));
        println!("{name:<26} {p50:>9.1} {p99:>9.1} {mean:>9.1}");
    }
    println!(
        "naive / planner step: p50 {:.1} x (wanted 20), p99 {:.1} x (wanted 10)",
        percentile(&theirs, 0.5) / percentile(&ours, 0.5),
        percentile(&theirs, 0.99) / percentile(&ours, 0.99),
    );

    let mut criterion = Criterion::default()
        .configure_from_args()
        .sample_size(20)
        .measurement_time(Duration::from_secs(2));
    let free = recorded.iter().rfind(|(_, iterations)| *iterations == 0);
    let limited = recorded.iter().rfind(|(_, iterations)| *iterations > 0);
    for (name, instance) in [("free", free), ("limited", limited)] {
        let Some((problem, _)) = instance else {
            continue;
        };
        let ceiling = problem.ceiling.clone();
        let mut mine = problem.clone();
        criterion.bench_function(&format!("planner/{name}"), |b| {
            b.iter(|| mpc.solve(&mut mine, |k, _, _| ceiling[k], &mut solution));
        });
        criterion.bench_function(&format!("naive/{name}"), |b| {
            b.iter(|| naive::constrained(&naive_data(&config, &mpc, problem)));
        });
    }
    criterion.final_summary();
}

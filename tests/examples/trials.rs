//! Lock-step landings without the `alight` program, and therefore without building zenoh, iceoryx2 or tokio.
//!
//! `cargo run --release -p alight-sim --example trials -- SEA SEED0 TRIALS` prints a line per landing and the
//! number of successes. SEA is an argument of `alight trial --sea` (`moderate`, `jonswap:1,5`). `alight trial
//! --trials N` flies the same landings and prints tables.

use std::process::ExitCode;

use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::trial;

const USAGE: &str = "trials SEA SEED0 TRIALS, such as: trials moderate 1 20";

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("trials: {error}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<bool, String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [sea, seed0, trials] = arguments.as_slice() else {
        return Err(format!("three arguments are needed: {USAGE}"));
    };
    let number = |text: &str| {
        text.parse::<u32>()
            .map_err(|e| format!("{text} is not a whole number ({e}): {USAGE}"))
    };
    let (seed0, trials) = (number(seed0)?, number(trials)?);
    let scenario = Scenario {
        sea: sea.parse().map_err(|e| format!("sea {sea} is invalid: {e}"))?,
        ..Scenario::default()
    };
    let nodes = NodeConfigs::default();
    let mut landed = 0;
    for seed in (u64::from(seed0)..).take(trials as usize) {
        let o = trial::outcome(&scenario, &nodes, seed, sea).map_err(|e| format!("seed {seed}: {e}"))?;
        let metric = |value: Option<f64>| value.map_or_else(|| "-".into(), |v| format!("{v:.2}"));
        println!(
            "seed {seed}: {} ({}), {} m, {} m/s, {} s, digest {}",
            o.outcome.name(),
            o.reason,
            metric(o.position_error_m),
            metric(o.touchdown_speed_mps),
            metric(o.landing_time_s),
            o.digest
        );
        landed += u32::from(o.success);
    }
    println!("{landed} of {trials} landed");
    Ok(landed == trials)
}

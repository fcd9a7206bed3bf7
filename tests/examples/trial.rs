//! Landings without the `alight` program, and therefore without building zenoh, iceoryx2 or tokio: `cargo trial` from
//! the root. The flags are those of `alight trial`, which flies the same landings and has more.

use std::{path::PathBuf, process::ExitCode};

use alight_shared::config;
use alight_sim::{
    chart::landing,
    harness::{
        outcome::Outcome,
        scenario::{NodeConfigs, Scenario},
        trial::{Event, FlownTrial, Watch, fly},
    },
};
use alight_uav::planner::PlannerKind;

const USAGE: &str = "\
Usage: cargo trial [FLAG VALUE]...
  --sea SEA             calm, slight, moderate [default], rough, very-rough,
                        AMPLITUDE_M,PERIOD_S, or jonswap:HEIGHT_M,PERIOD_S
  --scenario FILE.toml  a scene, such as deploy/scenarios/night.toml
  --planner NAME        alight [default] or mpc-faa, the paper's
  --seed N              first seed [default: 1]
  --trials N            landings of consecutive seeds [default: 1]
  --plot FILE.svg       draw the last landing";

struct Arguments {
    sea: String,
    scenario: Scenario,
    nodes: NodeConfigs,
    seed: u64,
    trials: u64,
    plot: Option<PathBuf>,
}

impl Arguments {
    fn read(typed: impl Iterator<Item = String>) -> Result<Arguments, String> {
        let mut arguments = Arguments {
            sea: "moderate".into(),
            scenario: Scenario::default(),
            nodes: NodeConfigs::default(),
            seed: 1,
            trials: 1,
            plot: None,
        };
        let mut typed = typed;
        while let Some(flag) = typed.next() {
            let value = typed.next().ok_or(format!("{flag}: its value is missing"))?;
            arguments.set(&flag, value)?;
        }
        Ok(arguments)
    }
    fn set(&mut self, flag: &str, value: String) -> Result<(), String> {
        let number = |limit: u64| {
            let number = value.parse().ok().filter(|n| *n <= limit);
            number.ok_or(format!(
                "{flag} {value}: a whole number of at most {limit} is needed"
            ))
        };
        match flag {
            "--sea" => {
                self.scenario.sea = value.parse().map_err(|e| format!("--sea {value}: {e}"))?;
                self.sea = value;
            }
            "--scenario" => {
                self.scenario = config::load(value.as_ref()).map_err(|e| e.to_string())?;
                self.sea = "scenario".into();
            }
            "--planner" => {
                self.nodes.drone.planner.kind = match value.as_str() {
                    "alight" => PlannerKind::Alight,
                    "mpc-faa" => PlannerKind::MpcFaa,
                    _ => return Err(format!("--planner {value}: alight or mpc-faa is needed")),
                };
            }
            "--seed" => self.seed = number(1 << 60)?,
            "--trials" => self.trials = number(1_000_000)?,
            "--plot" => self.plot = Some(value.into()),
            _ => return Err(format!("{flag} is no flag of cargo trial")),
        }
        Ok(())
    }
    fn fly(&self, seed: u64) -> Result<FlownTrial, String> {
        let mut show = |event: &Event| {
            let Event::Phase { t_s, name, reason } = event;
            if self.trials == 1 {
                println!("{t_s:>7.2} s  {name:<16} {reason}");
            }
        };
        let watch = Watch {
            on_event: &mut show,
            trace_step_s: self.plot.as_ref().map(|_| 0.05),
        };
        fly(&self.scenario, &self.nodes, seed, &self.sea, watch).map_err(|e| format!("seed {seed}: {e}"))
    }
}

fn print(o: &Outcome) {
    println!("\n{}: {}", o.outcome.name(), o.reason);
    let rows = [
        ("off the deck's centre, m", o.position_error_m, "first contact"),
        ("speed onto the deck, m/s", o.touchdown_speed_mps, "limit 1.0"),
        ("speed along the deck, m/s", o.tangential_speed_mps, "limit 1.0"),
        ("tilt against the deck, deg", o.tilt_error_deg, "limit 10"),
        ("motors off, s", o.stop_time_s, "after the contact, limit 2"),
        ("descent, s", o.landing_time_s, "to the contact"),
    ];
    for (name, value, meaning) in rows {
        let value = value.map_or_else(|| "-".into(), |v| format!("{v:.2}"));
        println!("  {name:<26} {value:>6}  {meaning}");
    }
    println!("  digest {}", o.digest);
}

fn run() -> Result<bool, String> {
    let arguments = Arguments::read(std::env::args().skip(1))?;
    let mut landed = 0;
    for seed in (arguments.seed..).take(arguments.trials as usize) {
        let flown = arguments.fly(seed)?;
        let o = &flown.outcome;
        landed += u64::from(o.success);
        if arguments.trials == 1 {
            print(o);
        } else {
            println!(
                "seed {seed}: {} ({}), digest {}",
                o.outcome.name(),
                o.reason,
                o.digest
            );
        }
        if let (Some(path), Some(trace)) = (&arguments.plot, &flown.trace) {
            landing::write(trace, &landing::title(o), path)
                .map_err(|e| format!("{}: {e}", path.display()))?;
        }
    }
    println!("{landed} of {} landed", arguments.trials);
    Ok(landed == arguments.trials)
}

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("cargo trial: {error}\n{USAGE}");
            ExitCode::from(2)
        }
    }
}

//! `alight example`: the files that the pages use, for installations without the sources.

use std::path::PathBuf;

use alight_computer::{
    exit::{CliError, Exit},
    terminal,
};
use clap::{Args, builder::PossibleValuesParser};

use super::init::write_new;

struct Example {
    path: &'static str,
    purpose: &'static str,
    content: &'static [u8],
}

impl Example {
    fn name(&self) -> &'static str {
        self.path.rsplit('/').next().unwrap_or(self.path)
    }
}

macro_rules! examples {
    ($($path:literal $purpose:literal)*) => {
        const EXAMPLES: &[Example] = &[$(Example {
            path: $path,
            purpose: $purpose,
            content: include_bytes!(concat!("../../../", $path)),
        }),*];
    };
}
examples! {
    "examples/boat.csv" "a boat's motion for estimate, trial --deck-motion"
    "examples/deck.toml" "a study of your own"
    "examples/poor-radio.toml" "scenario: loss and delay of the radio"
    "examples/silent-vessel.toml" "scenario: the vessel's computer is off"
    "examples/tags-suffice.toml" "drone: lands by tags alone"
    "examples/beacon.toml" "scenario: a silent vessel with a beacon"
    "examples/beacon-suffices.toml" "drone: flies to a beacon"
    "examples/pd_descent.py" "a planner of your own"
    "examples/hold_deck.py" "a predictor of your own"
    "scenarios/at-sea.toml" "scenario: one place on Earth"
    "scenarios/coarse-tag.toml" "scenario: a coarse tag detector"
    "scenarios/cold-start.toml" "scenario: the vessel has just started"
    "scenarios/jonswap.toml" "scenario: an irregular sea"
    "scenarios/moving-base.toml" "scenario: RTCM from the vessel"
    "scenarios/night.toml" "scenario: a night, lit tags"
    "scenarios/square.toml" "scenario: the vessel drives a square"
    "scenarios/windy.toml" "scenario: wind"
    "examples/python/ground_station.py" "a ground station in Python"
    "examples/python/landing.ipynb" "a notebook on one landing"
    "examples/mission-planner/alight.py" "a script for Mission Planner"
    "examples/qgroundcontrol/AlightActions.json" "buttons for QGroundControl"
    "examples/ros2/alight.launch.py" "ROS 2: router, node and RViz"
    "examples/ros2/alight.rviz" "ROS 2: a view, beside the launch file"
    "foxglove-layout.json" "a layout for Foxglove and Lichtblick"
    "vessel/zenohd.json5" "a Zenoh router with access rules"
    "cluster/slurm.sh" "a study as a SLURM array"
    "cluster/kubernetes.yaml" "a study as a Kubernetes job"
}

#[derive(Args, Debug)]
pub struct ExampleArgs {
    /// Files to write [default: none, they are listed]
    #[arg(value_name = "NAME", hide_possible_values = true,
          value_parser = PossibleValuesParser::new(EXAMPLES.iter().map(Example::name)))]
    names: Vec<String>,
    /// Existing directory to write into
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

pub fn run(args: &ExampleArgs) -> Result<Exit, CliError> {
    if args.names.is_empty() {
        for example in EXAMPLES {
            terminal::line(format_args!("{:<21} {}", example.name(), example.purpose));
        }
        terminal::line("alight example NAME writes one here");
    }
    for example in EXAMPLES {
        if args.names.iter().any(|name| name == example.name()) {
            let path = args.out.join(example.name());
            write_new(&path, example.content)?;
            terminal::line(format_args!("written: {}", path.display()));
        }
    }
    Ok(Exit::Success)
}

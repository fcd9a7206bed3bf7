//! `alight calibrate`: measures configuration values of this vessel and drone, and prints them as lines for the file.
//! It changes nothing.

mod deck;
mod drone;
mod vessel;

use std::fmt::Write;

use alight_computer::exit::{CliError, Exit};
use clap::{Args, Subcommand};

/// Calibration to make.
#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// Subject of the measurement
    #[command(subcommand)]
    pub what: What,
}

/// Subject of the measurement.
#[derive(Subcommand, Debug)]
pub enum What {
    /// Deck's position on the vessel and the camera's mount, with the drone on the deck.
    Deck(deck::DeckArgs),
    /// Response of the drone's attitude to set-points, from a flight.
    Drone(drone::DroneArgs),
    /// Damping, stiffness and GNSS antenna position, from a recording of the vessel's sensors.
    Vessel(vessel::VesselArgs),
}

pub fn run(args: &CalibrateArgs) -> Result<Exit, CliError> {
    match &args.what {
        What::Deck(a) => deck::run(a),
        What::Drone(a) => drone::run(a),
        What::Vessel(a) => vessel::run(a),
    }
}

/// Line of a TOML list, rounded to `digits` decimals.
fn list(key: &str, values: &[f64], digits: usize) -> String {
    let mut text = format!("{key} = [");
    for (k, v) in values.iter().enumerate() {
        let comma = if k == 0 { "" } else { ", " };
        // Writing to memory cannot fail. Adding zero turns -0.0 into 0.0.
        let unit = 10_f64.powi(i32::try_from(digits).unwrap_or(0));
        let rounded = (v * unit).round() / unit + 0.0;
        let _written = write!(text, "{comma}{rounded:?}");
    }
    text.push(']');
    text
}

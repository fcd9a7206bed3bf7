//! Force with which the deck has to hold a landed drone (`hold_n`), computed from the boat's motion in a cell's sea
//! and wind for the probability of staying that the mission requires.

use alight_computer::exit::{CliError, Doing};
use alight_shared::{
    apparent_slope::{ApparentSlope, RATE_HZ},
    landing::{Slopes, WindPush, needed_hold_n},
    msg::{DeckForecast, SLOPE_WINDOW_S, SLOPE_WINDOWS},
};
use alight_sim::harness::physics::{Physics, TICK};
use nalgebra::Vector2;

use super::super::rows::StudyRow;
use crate::trials::{in_parallel, seeds};

/// Number of draws of the sea, each of which requires a separate force.
const DRAWS: u32 = 3;

/// Force for each scene, N, that suffices in every draw; None if 1 kN does not suffice.
pub fn needed_n(scenes: &[StudyRow], seed0: u64, jobs: Option<u16>) -> Result<Vec<Option<f64>>, CliError> {
    let seeds = seeds(seed0, DRAWS)?;
    in_parallel(jobs, "decks", scenes, |row| {
        let each: Result<Vec<Option<f64>>, CliError> = seeds.iter().map(|s| of_draw(row, *s)).collect();
        Ok(each?.into_iter().try_fold(0.0_f64, |most, n| Some(most.max(n?))))
    })
}

/// Force in one draw of the sea, from the steepest apparent slopes in two minutes of the deck's true motion.
fn of_draw(row: &StudyRow, seed: u64) -> Result<Option<f64>, CliError> {
    let world = &row.world;
    let nodes = &row.nodes;
    let mut physics = Physics::new(world, seed).doing(format_args!(
        "setting up the deck of seed {seed} at {}",
        row.scenario
    ))?;
    // The simulation places the hull in the sea at rest, so the transient is skipped.
    while physics.now() < physics.started() {
        physics.advance();
    }
    let mut slope = ApparentSlope::default();
    let ticks = (SLOPE_WINDOWS as f64 * SLOPE_WINDOW_S / TICK.secs()) as u64;
    let every = (1.0 / RATE_HZ / TICK.secs()) as u64;
    let mut way = Vector2::zeros();
    for tick in 0..ticks {
        physics.advance();
        let deck = physics.deck();
        way += deck.velocity.0.xy() / ticks as f64;
        if tick % every == 0 {
            slope.push(physics.now(), &deck.attitude.0, deck.velocity.0);
        }
    }
    let watched = DeckForecast {
        slopes: slope.slopes(physics.now()),
        ..DeckForecast::default()
    };
    let (wind, to) = (
        &world.drone.wind,
        world.drone.wind.to_deg.unwrap_or_default().to_radians(),
    );
    let wind = WindPush::over(Vector2::new(to.cos(), to.sin()) * wind.mean_mps, way);
    let (deck, drone, mission) = (&nodes.drone.deck, &nodes.drone.airframe, &nodes.drone.mission);
    Ok(needed_hold_n(
        &Slopes::of(Some(&watched), &wind),
        (deck, drone),
        mission.friction,
        mission.min_probability,
    ))
}

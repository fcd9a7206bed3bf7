//! `alight study envelope`: the relative winds, directions and seas in which a drone lands on a boat (navies call it
//! ship-helicopter operating limits). The Python module draws it.

mod grid;
mod hold;

use std::{collections::BTreeSet, path::Path};

use alight_computer::{
    exit::{CliError, Exit},
    table::{Cell, Table},
    terminal::{note, wrapped},
};
use alight_sim::{
    harness::outcome::Outcome,
    physics::sea::SeaConfig,
    studies::statistics::{FailureCount, Summary, at_most_95},
};
use serde_json::{Value, json};

use super::{
    result::{StudyResult, configuration_hash, write_files},
    rows::StudyRow,
    run::{self, GridRun},
    table::replay_command,
};
use crate::{args::EnvelopeArgs, scene::Scene};
use grid::{EnvelopeCell, EnvelopeGrid};

const STUDY: &str = "# alight envelope\n";
/// Maximum number of unsafe landings that are printed with a replay command.
const MAX_UNSAFE: usize = 12;
const HOLD_TITLE: &str =
    "hold_n, N, with which a landed drone stays in every wind flown (0: friction is enough; -: over 1 kN)";

fn name(state: u8, wind: f64, from: f64) -> String {
    format!("sea state {state}, {wind} m/s from {from:.0} deg")
}

/// Scene of one condition: the bow to the north, wind and waves relative to it.
fn scene(base: &Scene, (state, wind, from): (u8, f64, f64)) -> StudyRow {
    let mut world = base.scenario.clone();
    world.sea = SeaConfig::of_sea_state(state).unwrap_or_default();
    world.sea.mean_direction_deg = Some((from + 180.0).rem_euclid(360.0));
    world.vessel.heading_deg = Some(0.0);
    let way = if world.vessel.course.is_under_way() {
        world.vessel.speed_mps
    } else {
        0.0
    };
    let (east, north) = from.to_radians().sin_cos();
    let north = way - wind * north;
    let east = -wind * east;
    world.drone.wind.mean_mps = north.hypot(east);
    world.drone.wind.to_deg = Some(east.atan2(north).to_degrees());
    world.drone.wind.with_waves = false;
    StudyRow::of(name(state, wind, from), world, base.nodes.clone())
}

/// Condition that the mission waits for, without the preceding text of the judge.
fn waits_for(failure: &FailureCount) -> String {
    let why = failure.reason.rsplit("mission waiting: ").next();
    why.unwrap_or_default().into()
}

fn cells(grid: &EnvelopeGrid, outcomes: &[Outcome], holds: &[Option<f64>]) -> Vec<EnvelopeCell> {
    let cell = |((state, wind_mps, from_deg), hold_n): (_, &Option<f64>)| {
        let name = name(state, wind_mps, from_deg);
        let set: Vec<&Outcome> = outcomes.iter().filter(|o| o.sea == name).collect();
        let summary = Summary::of(&set);
        EnvelopeCell {
            state,
            wind_mps,
            from_deg,
            trials: summary.trials,
            landed: summary.successes,
            rejected: summary.rejected,
            unsafe_seeds: set.iter().filter(|o| o.is_unsafe()).map(|o| o.seed).collect(),
            reason: summary.failures.first().map(waits_for).unwrap_or_default(),
            hold_n: *hold_n,
        }
    };
    grid.conditions().zip(holds).map(cell).collect()
}

/// Base of all scenes: boat and drone as their configurations describe them.
fn base(args: &EnvelopeArgs) -> Result<Scene, CliError> {
    let s = &args.scene;
    let own = [
        ("sea", s.sea.is_some()),
        ("sea-state", s.sea_state.is_some()),
        ("wind", s.wind.is_some()),
        ("deck-motion", s.deck_motion.is_some()),
    ];
    if let Some((flag, _)) = own.iter().find(|(_, given)| *given) {
        return Err(CliError(format!(
            "--{flag}: the envelope flies seas and winds of its own; choose them with --sea-states, --winds and \
             --directions"
        )));
    }
    let mut base = Scene::of(s)?;
    if s.scenario.is_none() {
        base.describe();
    }
    Ok(base)
}

/// `program`: version and commit.
pub fn run(args: &EnvelopeArgs, program: &str) -> Result<Exit, CliError> {
    let (grid, base) = (EnvelopeGrid::of(args), base(args)?);
    let scenes: Vec<StudyRow> = grid.conditions().map(|c| scene(&base, c)).collect();
    let boat = args.scene.hull.as_deref().unwrap_or("the simulated vessel");
    note(
        args.form.alone(),
        wrapped(&format!(
            "envelope: {} landings on {boat}, {} in each of {} cells; an interrupted run continues where it stopped",
            scenes.len() * grid.trials as usize,
            grid.trials,
            scenes.len()
        )),
    );
    if let Some(why) = grid.too_few() {
        note(true, wrapped(&format!("warning: {why}")));
    }
    let flights = GridRun {
        study: STUDY,
        result: StudyResult::new(program, STUDY, &args.scene.given(), &scenes),
        trials: grid.trials,
        seed0: args.seed0,
        jobs: args.jobs,
        out: Some(&args.out),
        shard: None,
        within: None,
        records_failed: false,
        timed: false,
        alone: args.form.alone(),
    };
    let outcomes = run::fly_grid(&flights, &scenes)?;
    let holds = hold::needed_n(&scenes, args.seed0, args.jobs)?;
    run::end_if_asked(&flights, outcomes.len(), outcomes.len());
    let cells = cells(&grid, &outcomes, &holds);
    let hash = configuration_hash(&base.nodes);
    let title = format!("Landing envelope of {boat}");
    let limits = by_direction(&grid, |state, from| grid.limit(&cells, state, from));
    let needed = by_direction(&grid, |state, from| grid.hold_n(&cells, state, from));
    let texts = [
        wrapped(&format!(
            "{title}: relative wind, m/s, up to which at least {:.0} % land (-: not shown for the lightest)",
            100.0 * grid.rate
        )),
        limits.text(),
        wrapped(&bound(&cells)),
        wrapped(HOLD_TITLE),
        needed.text(),
    ];
    for text in texts
        .iter()
        .chain(&unsafe_landings(&args.out, &scenes, &outcomes))
    {
        note(args.form.alone(), text);
    }
    let rows: Vec<Value> = cells.iter().map(|c| c.json(grid.rate)).collect();
    let value = json!({
        "hull": boat, "configuration": hash, "grid": { "sea_states": grid.states, "winds_mps": grid.winds,
        "directions": grid.directions, "trials": grid.trials, "seed0": args.seed0 },
        "rate": grid.rate, "too_few": grid.too_few(),
        "cells": rows,
    });
    write_files(&args.out, &[("envelope.json", value.to_string())])?;
    note(
        args.form.alone(),
        format_args!(
            "written: {0}/envelope.json; python3 -m alight {0} draws it",
            args.out.display()
        ),
    );
    args.form.print(&value, &rows)?;
    Ok(Exit::Success)
}

/// Bound on unsafe landings over the whole grid. All cells use the same seeds, so only the landings of one cell are
/// independent of each other.
fn bound(cells: &[EnvelopeCell]) -> String {
    let seeds: BTreeSet<u64> = cells.iter().flat_map(|c| &c.unsafe_seeds).copied().collect();
    let draws = cells.iter().map(|c| c.trials).max().unwrap_or_default();
    format!(
        "unsafe: {} of {} landings, in {} of {draws} draws of sea and wind; of all draws, with 95 % confidence, at most \
         {:.1} % are unsafe in a cell",
        cells.iter().map(EnvelopeCell::unsafe_count).sum::<usize>(),
        cells.iter().map(|c| c.trials).sum::<usize>(),
        seeds.len(),
        100.0 * at_most_95(seeds.len(), draws)
    )
}

/// Values by direction (one per row) and sea state.
fn by_direction(grid: &EnvelopeGrid, figure: impl Fn(u8, f64) -> Option<f64>) -> Table {
    let heads = grid.states.iter().map(|s| EnvelopeGrid::sea_name(*s));
    let mut table = Table::new(0.., core::iter::once("wind from, deg".into()).chain(heads));
    for from in grid.bearings() {
        let of_state = |s: &u8| Cell::number(figure(*s, from), 0);
        let row = core::iter::once(Cell::number(from, 0));
        table.row(row.chain(grid.states.iter().map(of_state)));
    }
    table
}

fn unsafe_landings(out: &Path, rows: &[StudyRow], outcomes: &[Outcome]) -> Vec<String> {
    let line = |o: &Outcome| {
        let row = rows.iter().find(|r| r.scenario == o.sea);
        let again = row.and_then(|r| replay_command(out, r)).unwrap_or_default();
        format!(
            "{}: {} ({})\n    {again} --seed {}",
            o.sea,
            o.outcome.name(),
            o.reason,
            o.seed
        )
    };
    outcomes
        .iter()
        .filter(|o| o.is_unsafe())
        .take(MAX_UNSAFE)
        .map(line)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{grid::Class, *};
    use crate::args::typed;

    fn args(arguments: &str) -> EnvelopeArgs {
        typed(core::iter::once("envelope").chain(arguments.split_whitespace()))
    }
    fn cell(wind_mps: f64, landed: usize, rejected: usize) -> EnvelopeCell {
        EnvelopeCell {
            state: 3,
            wind_mps,
            from_deg: 90.0,
            trials: 4,
            landed,
            rejected,
            unsafe_seeds: (0..(4_usize.saturating_sub(landed + rejected)) as u64).collect(),
            reason: String::new(),
            hold_n: (wind_mps < 10.0).then_some(4.0 * wind_mps),
        }
    }

    #[test]
    fn envelope_grid_of_wind_direction_and_sea() {
        let grid = EnvelopeGrid::of(&args("--quick --winds 8,4,8 --directions 4 --sea-states 3"));
        assert_eq!((grid.winds.as_slice(), grid.trials), (&[4.0, 8.0][..], 5));
        assert_eq!(grid.conditions().count(), 8);
        assert_eq!(grid.bearings().collect::<Vec<_>>(), [0.0, 90.0, 180.0, 270.0]);
    }

    #[test]
    fn envelope_scene_relative_wind() {
        let base = base(&args("--vessel straight --speed 3")).unwrap();
        let s = scene(&base, (3, 8.0, 90.0)).world;
        let to = s.drone.wind.to_deg.unwrap().to_radians();
        // Wind from starboard on a vessel that moves north at 3 m/s.
        let relative = [
            s.drone.wind.mean_mps * to.cos() - 3.0,
            s.drone.wind.mean_mps * to.sin(),
        ];
        assert!(
            relative[0].abs() < 1e-9 && (relative[1] + 8.0).abs() < 1e-9,
            "{relative:?}"
        );
        assert_eq!(s.sea.mean_direction_deg, Some(270.0));
    }

    #[test]
    fn envelope_limit_at_the_first_cell_beyond() {
        let grid = EnvelopeGrid::of(&args("--winds 4,8,12 --rate 50"));
        let limit = |cells: &[EnvelopeCell]| grid.limit(cells, 3, 90.0);
        assert_eq!(
            limit(&[cell(4.0, 4, 0), cell(8.0, 4, 0), cell(12.0, 3, 1)]),
            Some(8.0)
        );
        assert_eq!(
            limit(&[cell(4.0, 4, 0), cell(8.0, 3, 0), cell(12.0, 4, 0)]),
            Some(4.0)
        );
        assert_eq!(limit(&[cell(4.0, 0, 4), cell(8.0, 4, 0)]), None);
    }

    #[test]
    fn envelope_cell_class() {
        let class = |landed, rejected| cell(4.0, landed, rejected).class(0.75);
        assert_eq!([class(4, 0), class(3, 1)], [Class::Landed; 2]);
        assert_eq!([class(2, 2), class(0, 4)], [Class::Rejected; 2]);
        let exact = EnvelopeCell {
            trials: 20,
            ..cell(4.0, 11, 9)
        };
        assert_eq!(exact.class(0.55), Class::Landed);
        // One unsafe landing of four outweighs the three that landed.
        assert_eq!(class(3, 0), Class::Unsafe);
    }

    #[test]
    fn envelope_limit_only_where_enough_landed() {
        let grid = EnvelopeGrid::of(&args("--winds 4,8"));
        assert_eq!((grid.trials, grid.too_few()), (35, None));
        let flown = |trials, landed| EnvelopeCell {
            trials,
            ..cell(4.0, landed, trials - landed)
        };
        let limit = |c: EnvelopeCell| grid.limit(&[c], 3, 90.0);
        assert_eq!(limit(flown(35, 35)), Some(4.0));
        // All of 34, and 34 of 35: the lower ends are 89.8 % and 85.5 %.
        assert_eq!([limit(flown(34, 34)), limit(flown(35, 34))], [None; 2]);
        let few = EnvelopeGrid::of(&args("--quick")).too_few().unwrap();
        assert!(
            few.contains("shows 57 %") && few.contains("needs 35 landings"),
            "{few}"
        );
        assert_eq!(EnvelopeGrid::of(&args("--quick --rate 50")).too_few(), None);
    }

    #[test]
    fn envelope_holding_force_of_a_direction() {
        let grid = EnvelopeGrid::of(&args("--winds 4,8,12"));
        let needed = |winds: &[f64]| {
            let cells: Vec<EnvelopeCell> = winds.iter().map(|w| cell(*w, 4, 0)).collect();
            grid.hold_n(&cells, 3, 90.0)
        };
        assert_eq!(needed(&[4.0, 8.0]), Some(32.0));
        assert_eq!(needed(&[4.0, 8.0, 12.0]), None);
        // In a breeze from astern, a boat at rest in sea state 1 needs only friction; in state 4 from abeam friction
        // does not suffice.
        let base = base(&args("--hull mono-5m")).unwrap();
        let scenes = [(1, 3.0, 180.0), (4, 10.0, 90.0)].map(|c| scene(&base, c));
        let force = hold::needed_n(&scenes, 1, Some(1)).unwrap();
        assert_eq!(force[0], Some(0.0));
        assert!(force[1].is_none_or(|n| n > 0.0), "{force:?}");
    }

    #[test]
    fn envelope_bound_over_all_draws() {
        let cells = [cell(4.0, 4, 0), cell(8.0, 2, 1)];
        assert_eq!(
            bound(&cells),
            "unsafe: 1 of 8 landings, in 1 of 4 draws of sea and wind; of all draws, with 95 % confidence, at most 75.1 % \
             are unsafe in a cell"
        );
    }
}

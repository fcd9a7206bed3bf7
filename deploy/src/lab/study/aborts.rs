//! `alight study aborts`: landings that are aborted, held or lose their planner at a random height.

use alight_sim::studies::aborts::{Draw, Interrupted, Interruption, drive, fly};
use alight_sim::studies::statistics::wilson;
use serde_json::{Value, json};

use super::grid;
use super::variant::StudyScene;
use crate::cells;
use crate::exit::{CliError, Doing};
use crate::lab::args::StudyArgs;
use crate::lab::scene::Scene;
use crate::lab::trials::{in_parallel, seeds};
use crate::table::Table;
use crate::terminal::note;

/// An interrupted landing and what was drawn for it.
struct Flight {
    scene: String,
    seed: u64,
    draw: Draw,
    interruption: Interruption,
    report: Interrupted,
}

impl Flight {
    fn json(&self) -> Value {
        json!({
            "scene": self.scene, "seed": self.seed, "draw": self.draw, "interruption": self.interruption,
            "report": self.report,
        })
    }
}

/// The study: each seed with its sea, speed and height on every hull, once with each interruption.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let scenes = grid::hulls(&args.scene, &Scene::of(&args.scene)?)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let mut hulls: Vec<&str> = scenes.iter().map(hull).collect();
    hulls.dedup();
    let mut all: Vec<Flight> = Vec::new();
    for name in &hulls {
        let seas: Vec<&StudyScene> = scenes.iter().filter(|s| hull(s) == *name).collect();
        let items: Vec<(u64, Interruption)> = seeds
            .iter()
            .flat_map(|seed| Interruption::ALL.map(|i| (*seed, i)))
            .collect();
        let flown = in_parallel(args.jobs, name, &items, |(seed, interruption)| {
            let mut draw = Draw::of(*seed, seas.len());
            draw.speed_mps = args.scene.speed.unwrap_or(draw.speed_mps);
            let Some(scene) = seas.get(draw.sea) else {
                return Ok(None);
            };
            let mut world = scene.world.clone();
            drive(&mut world, draw.speed_mps);
            let report = fly(&world, &scene.nodes, *seed, *interruption, draw.height_m)
                .doing(format_args!("setting up the trial of seed {seed}"))?;
            Ok(report.map(|report| Flight {
                scene: scene.name.clone(),
                seed: *seed,
                draw,
                interruption: *interruption,
                report,
            }))
        })?;
        all.extend(flown.into_iter().flatten());
    }
    let mut table = Table::new(
        2..,
        [
            "hull",
            "interruption",
            "flights",
            "unsafe",
            "hardest m/s",
            "in water",
            "strayed",
            "slid",
            "landed",
        ],
    );
    let mut rows = Vec::new();
    let mut add = |name: &str, what: &str, flights: &[&Flight]| {
        let count = |f: fn(&Interrupted) -> bool| flights.iter().filter(|x| f(&x.report)).count();
        let hardest = flights.iter().map(|x| x.report.hardest_mps).fold(0.0, f64::max);
        let landed = count(|r| r.landed);
        let row = json!({
            "hull": name, "interruption": what, "flights": flights.len(),
            "unsafe_contacts": count(|r| r.unsafe_contact), "hardest_mps": hardest,
            "in_water": count(|r| r.water), "strayed": count(Interrupted::strayed), "slid": count(Interrupted::slid),
            "landed": landed, "landed_interval": <[f64; 2]>::from(wilson(landed, flights.len())),
        });
        table.row(cells![
            name,
            what,
            flights.len(),
            count(|r| r.unsafe_contact),
            format_args!("{hardest:.2}"),
            count(|r| r.water),
            count(Interrupted::strayed),
            count(Interrupted::slid),
            landed,
        ]);
        rows.push(row);
    };
    for name in &hulls {
        for what in Interruption::ALL {
            let of = |f: &&Flight| f.scene.starts_with(name) && f.interruption == what;
            add(name, what.name(), &all.iter().filter(of).collect::<Vec<_>>());
        }
    }
    add("all", "", &all.iter().collect::<Vec<_>>());
    note(args.json, table.text());
    let wrong: Vec<&Flight> = all
        .iter()
        .filter(|f| !f.report.safe() || f.report.slid())
        .collect();
    // By these they can be flown again.
    for f in &wrong {
        let (r, d) = (&f.report, &f.draw);
        note(
            args.json,
            format_args!(
                "{}, {} m/s, seed {}, {} at {:.2} m: {:.2} m/s, in water {}, {:.1} m off, slid {}",
                f.scene,
                d.speed_mps,
                f.seed,
                f.interruption.name(),
                d.height_m,
                r.hardest_mps,
                r.water,
                r.strayed_m,
                r.slid_after_s.map_or("no".into(), |s| format!("after {s:.1} s"))
            ),
        );
    }
    let wrong: Vec<Value> = wrong.iter().map(|f| f.json()).collect();
    Ok(json!({ "rows": rows, "wrong": wrong }))
}

/// The scene's hull: the first word of its name.
fn hull(scene: &StudyScene) -> &str {
    scene.name.split(' ').next().unwrap_or_default()
}

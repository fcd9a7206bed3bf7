//! The vessel's prediction and the drone's beside the reference, hold and constant velocity, in the same runs.

use alight_sim::studies::reference::{
    self as reference, DRONE_RADIO, HORIZONS_S, JUDGED_FROM_S, Predictor, QUANTITIES, RunErrors,
};
use serde_json::{Value, json};

use super::variant::StudyScene;
use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::report::chart::{self, Curve};
use crate::lab::report::document::{Block, Chart};
use crate::lab::trials::in_parallel;
use crate::table::{Cell, Table};
use crate::terminal::note;

/// Indices of 0.5, 1 and 2 s in [`HORIZONS_S`].
const SHOWN: [usize; 3] = [1, 3, 5];
/// The node's RMSE is at most so many times the reference's.
const REQUIRED_RATIO: f64 = 1.1;

/// What was measured on one deck, of the vessel's prediction or of the drone's.
struct DeckErrors {
    name: String,
    /// The node that predicts.
    node: &'static str,
    runs: Vec<RunErrors>,
}

impl DeckErrors {
    /// RMSE about the run's mean error and that mean, after the given start.
    fn rmse(&self, who: Predictor, stretch: usize, quantity: usize, h: usize) -> Option<[f64; 2]> {
        reference::rmse(&self.runs, who, stretch, quantity, h)
    }
    fn ratio(&self, stretch: usize, quantity: usize, h: usize) -> Option<f64> {
        let [node, _] = self.rmse(Predictor::Node, stretch, quantity, h)?;
        let [base, _] = self.rmse(Predictor::Reference, stretch, quantity, h)?;
        (base > 0.0).then(|| node / base)
    }
}

/// Runs every scene with every seed, prints the table, gives blocks of the report and the JSON.
pub fn run(
    args: &StudyArgs,
    scenes: &[StudyScene],
    seeds: &[u64],
) -> Result<(Vec<Block>, Vec<Value>), CliError> {
    let mut decks = Vec::new();
    for scene in scenes {
        let vessel = |seed| reference::run(&scene.world, &scene.nodes.vessel, seed);
        let drone = |seed| reference::run_drone(&scene.world, &scene.nodes, seed);
        let nodes: [(_, &(dyn Fn(u64) -> _ + Sync)); 2] = [("vessel", &vessel), ("drone", &drone)];
        for (node, measure) in nodes {
            let name = format!("{} {node}", scene.name);
            let runs = in_parallel(args.jobs, &name, seeds, |seed| {
                measure(*seed).map_err(|e| CliError::because(format!("setting up the run of seed {seed}"), e))
            })?;
            decks.push(DeckErrors {
                name: scene.name.clone(),
                node,
                runs,
            });
        }
    }
    let text = format!(
        "Prediction against the truth, {} seeds from {} on: RMSE with each run's mean error removed (in brackets \
         that mean error), from {} s after the start on, and from {} s on; heave about its mean level. Reference: \
         ridge regression on the vessel's own published estimates; required: at most {REQUIRED_RATIO} times it. The \
         drone follows over a radio that loses {:.0} % and delays by {:.0} ms; its height is the deck's, against the \
         reference's at horizon plus age.",
        seeds.len(),
        args.seed0,
        JUDGED_FROM_S[1],
        JUDGED_FROM_S[0],
        100.0 * DRONE_RADIO.1,
        1000.0 * DRONE_RADIO.0,
    );
    let table = table(&decks);
    note(args.json, format_args!("{text}\n{}", table.text()));
    let mut blocks = vec![
        Block::Heading("Beside the reference, hold and constant velocity".into()),
        Block::Text(text),
        Block::Table(table),
    ];
    blocks.extend(decks.iter().flat_map(charts).map(Block::Chart));
    Ok((blocks, decks.iter().map(json_of).collect()))
}

fn table(decks: &[DeckErrors]) -> Table {
    let heads = [
        "deck",
        "by",
        "quantity",
        "horizon s",
        "node",
        "reference",
        "ratio",
        "hold",
        "const. vel.",
        "node, 60 s",
        "reference, 60 s",
    ];
    let mut table = Table::new(3.., heads);
    for deck in decks {
        for (q, quantity) in QUANTITIES.into_iter().enumerate() {
            for h in SHOWN {
                let cell = |who, stretch| {
                    let error = deck.rmse(who, stretch, q, h);
                    Cell::number(error.map(|e| e[0]), 4)
                };
                let mean = deck.rmse(Predictor::Node, 1, q, h).map(|e| e[1]);
                let node = cell(Predictor::Node, 1);
                let ratio = deck.ratio(1, q, h);
                let judged = |r: f64| Cell::number(r, 2).judged(r <= REQUIRED_RATIO);
                table.row([
                    Cell::from(&deck.name),
                    deck.node.into(),
                    quantity.into(),
                    HORIZONS_S.get(h).map_or("-".into(), Cell::from),
                    mean.map_or(node.clone(), |m| node.note(format_args!("{m:.4}"))),
                    cell(Predictor::Reference, 1),
                    ratio.map_or("-".into(), judged),
                    cell(Predictor::Hold, 1),
                    cell(Predictor::ConstantVelocity, 1),
                    cell(Predictor::Node, 0),
                    cell(Predictor::Reference, 0),
                ]);
            }
        }
    }
    table
}

/// RMSE over the horizon, a chart per quantity.
fn charts(deck: &DeckErrors) -> Vec<Chart> {
    let labels: Vec<String> = HORIZONS_S.iter().map(f64::to_string).collect();
    let chart = |(q, quantity): (usize, &str)| {
        // Rolling the velocity on leaves the page.
        let top = (0..HORIZONS_S.len())
            .filter_map(|h| deck.rmse(Predictor::Hold, 1, q, h))
            .fold(0.0_f64, |a, e| a.max(e[0]));
        let point = |who, h| deck.rmse(who, 1, q, h).map(|e| e[0]).filter(|e| *e <= 1.2 * top);
        let curve = |who: Predictor| Curve {
            name: who.name().into(),
            points: (0..HORIZONS_S.len()).map(|h| point(who, h)).collect(),
        };
        Chart {
            caption: format!(
                "{}, {}: {quantity}, RMSE over the horizon, s",
                deck.name, deck.node
            ),
            svg: chart::curves(&labels, &Predictor::ALL.map(curve)),
        }
    };
    QUANTITIES.into_iter().enumerate().map(chart).collect()
}

fn json_of(deck: &DeckErrors) -> Value {
    let mut scores = Vec::new();
    for (stretch, from) in JUDGED_FROM_S.into_iter().enumerate() {
        for (q, quantity) in QUANTITIES.into_iter().enumerate() {
            for (h, horizon) in HORIZONS_S.into_iter().enumerate() {
                for who in Predictor::ALL {
                    if let Some([rmse, mean]) = deck.rmse(who, stretch, q, h) {
                        scores.push(json!({
                            "predictor": who, "from_s": from, "quantity": quantity, "horizon_s": horizon,
                            "rmse": rmse, "mean_error": mean,
                        }));
                    }
                }
            }
        }
    }
    json!({ "deck": deck.name, "by": deck.node, "seeds": deck.runs.len(), "predictors": scores })
}

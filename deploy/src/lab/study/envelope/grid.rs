//! The grid of an envelope: what is flown, and what became of each cell.

use alight_sim::physics::sea::SeaConfig;
use alight_sim::studies::statistics::wilson;
use serde_json::{Value, json};

use crate::lab::args::EnvelopeArgs;

/// A cell is within the limit when at this rate or more is landed, by the lower end of its interval: more likely than not.
const LIMIT_RATE: f64 = 0.5;
/// Relative winds of the full grid and of the quick one, m/s.
const FULL_MPS: [f64; 7] = [2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0];
const QUICK_MPS: [f64; 5] = [4.0, 6.0, 8.0, 10.0, 12.0];

/// What is flown: relative winds (10 m above the water, m/s) from directions all round, in sea states, so often a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Sea states, WMO code table 3700.
    pub states: Vec<u8>,
    /// Ascending, m/s.
    pub winds: Vec<f64>,
    /// Evenly spaced, the first from ahead.
    pub directions: u16,
    /// Landings tried in each cell.
    pub trials: u32,
}

/// One wind in one sea, and what became of the drones.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Sea state.
    pub state: u8,
    /// Relative wind, m/s.
    pub wind_mps: f64,
    /// Where it and the waves come from, clockwise from the bow, deg.
    pub from_deg: f64,
    /// Landings tried.
    pub trials: usize,
    /// At rest on the deck.
    pub landed: usize,
    /// No landing in time, and no contact beyond its limits.
    pub refused: usize,
    /// The most frequent reason of those that did not land.
    pub reason: String,
}

impl Cell {
    /// What neither landed nor was refused.
    pub fn unsafe_count(&self) -> usize {
        self.trials - self.landed - self.refused
    }
    fn is_within(&self) -> bool {
        self.unsafe_count() == 0 && wilson(self.landed, self.trials).0 >= LIMIT_RATE
    }
    /// With the intervals of its rates.
    pub fn json(&self) -> Value {
        json!({
            "sea_state": self.state, "wind_mps": self.wind_mps, "from_deg": self.from_deg, "trials": self.trials,
            "landed": self.landed, "landed_interval": wilson(self.landed, self.trials),
            "refused": self.refused, "refused_interval": wilson(self.refused, self.trials),
            "unsafe": self.unsafe_count(), "unsafe_interval": wilson(self.unsafe_count(), self.trials),
        })
    }
}

impl Grid {
    /// As the flags have it.
    pub fn of(args: &EnvelopeArgs) -> Grid {
        let quick = args.quick;
        let mut winds = args.winds.clone();
        if winds.is_empty() {
            winds = if quick {
                QUICK_MPS.to_vec()
            } else {
                FULL_MPS.to_vec()
            };
        }
        winds.sort_by(f64::total_cmp);
        winds.dedup();
        let mut states = args.sea_states.clone();
        if states.is_empty() {
            states = if quick { vec![2, 3, 4] } else { vec![1, 2, 3, 4] };
        }
        states.sort_unstable();
        states.dedup();
        Grid {
            states,
            winds,
            directions: args.directions.unwrap_or(if quick { 8 } else { 12 }),
            trials: args.trials.unwrap_or(if quick { 5 } else { 10 }),
        }
    }
    /// A sea state with its waves.
    pub fn sea_name(state: u8) -> String {
        let systems = SeaConfig::of_sea_state(state).unwrap_or_default().systems;
        let waves = systems
            .first()
            .map(|w| (w.significant_height_m, w.peak_period_s))
            .unwrap_or_default();
        format!("sea state {state}: {:.1} m, {:.1} s", waves.0, waves.1)
    }
    /// Directions, clockwise from the bow, deg.
    pub fn bearings(&self) -> impl Iterator<Item = f64> + Clone + use<> {
        let n = self.directions;
        (0..n).map(move |k| 360.0 * f64::from(k) / f64::from(n))
    }
    /// All cells: sea state, wind, direction.
    pub fn conditions(&self) -> impl Iterator<Item = (u8, f64, f64)> {
        let winds_of = |state: &u8| self.winds.iter().map(|wind| (*state, *wind)).collect::<Vec<_>>();
        let winds = self.states.iter().flat_map(winds_of);
        winds.flat_map(|(state, wind)| self.bearings().map(move |from| (state, wind, from)))
    }
    /// The fastest wind up to which every wind from there is within the limit, m/s; None: not even the lightest.
    pub fn limit(&self, cells: &[Cell], state: u8, from_deg: f64) -> Option<f64> {
        let here = cells
            .iter()
            .filter(|c| (c.state, c.from_deg) == (state, from_deg));
        here.take_while(|c| c.is_within()).last().map(|c| c.wind_mps)
    }
}

//! Grid of an envelope: its conditions, and the result of each cell.

use alight_sim::{
    physics::sea::SeaConfig,
    studies::statistics::{at_most_95, successes_to_show, wilson},
};
use serde_json::{Value, json};

use crate::args::EnvelopeArgs;

/// Relative winds of the full and of the quick grid, m/s.
const FULL_MPS: [f64; 7] = [2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0];
const QUICK_MPS: [f64; 5] = [4.0, 6.0, 8.0, 10.0, 12.0];

/// Conditions to fly: relative winds (10 m above the water, m/s) from directions all round, in sea states, with
/// `trials` landings per cell.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvelopeGrid {
    /// Sea states by WMO code table 3700.
    pub states: Vec<u8>,
    pub winds: Vec<f64>,
    /// Number of evenly spaced directions, the first from ahead.
    pub directions: u16,
    pub trials: u32,
    /// Landing rate that every wind up to the limit must reach.
    pub rate: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// No landing was unsafe, and the required rate was reached.
    Landed,
    /// No landing was unsafe, but the rate was not reached.
    Rejected,
    Unsafe,
}

impl Class {
    pub fn name(self) -> &'static str {
        match self {
            Class::Landed => "landed",
            Class::Rejected => "rejected",
            Class::Unsafe => "unsafe",
        }
    }
}

#[derive(Clone, Debug)]
pub struct EnvelopeCell {
    pub state: u8,
    pub wind_mps: f64,
    /// Direction from which wind and waves come, clockwise from the bow, deg.
    pub from_deg: f64,
    pub trials: usize,
    pub landed: usize,
    /// Trials without a landing in time and without a contact beyond its limits.
    pub rejected: usize,
    pub unsafe_seeds: Vec<u64>,
    /// Most frequent reason of the trials that did not land.
    pub reason: String,
    /// Force with which the deck has to hold a landed drone, N; None if 1 kN does not suffice.
    pub hold_n: Option<f64>,
}

impl EnvelopeCell {
    pub fn unsafe_count(&self) -> usize {
        self.unsafe_seeds.len()
    }
    pub fn class(&self, rate: f64) -> Class {
        if self.unsafe_count() > 0 {
            Class::Unsafe
        // The tolerance covers rounding: 0.55 times 20 is a little more than 11 in floating point.
        } else if self.landed as f64 >= rate * self.trials as f64 - 1e-6 {
            Class::Landed
        } else {
            Class::Rejected
        }
    }
    /// Whether the trials show a landing rate of at least `rate`.
    fn is_within(&self, rate: f64) -> bool {
        self.unsafe_count() == 0 && wilson(self.landed, self.trials).0 >= rate
    }
    pub fn json(&self, rate: f64) -> Value {
        json!({
            "class": self.class(rate).name(), "unsafe_at_most_95": at_most_95(self.unsafe_count(), self.trials),
            "sea_state": self.state, "wind_mps": self.wind_mps, "from_deg": self.from_deg, "trials": self.trials,
            "landed": self.landed, "landed_interval": wilson(self.landed, self.trials),
            "rejected": self.rejected, "rejected_interval": wilson(self.rejected, self.trials),
            "hold_n": self.hold_n, "unsafe": self.unsafe_count(), "unsafe_interval": wilson(self.unsafe_count(), self.trials),
            "unsafe_seeds": self.unsafe_seeds, "mostly": self.reason,
        })
    }
}

impl EnvelopeGrid {
    pub fn of(args: &EnvelopeArgs) -> EnvelopeGrid {
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
        let rate = f64::from(args.rate) / 100.0;
        let enough = u32::try_from(successes_to_show(rate)).unwrap_or(u32::MAX);
        EnvelopeGrid {
            rate,
            states,
            winds,
            directions: args.directions.unwrap_or(if quick { 8 } else { 12 }),
            trials: args.trials.unwrap_or(if quick { 5 } else { enough }),
        }
    }
    /// Reason why no limit can be drawn, if the trials are too few.
    pub fn too_few(&self) -> Option<String> {
        let trials = self.trials as usize;
        let needed = successes_to_show(self.rate);
        let shown = 100.0 * wilson(trials, trials).0;
        (trials < needed).then(|| {
            format!(
                "{trials} landings a cell are too few for a limit: all of them landed shows {shown:.0} %, and {:.0} % is \
                 asked for, which needs {needed} landings a cell (--trials {needed})",
                100.0 * self.rate
            )
        })
    }
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
    /// Force with which the deck has to hold the drone in every wind from this direction, N; None if 1 kN does not
    /// suffice.
    pub fn hold_n(&self, cells: &[EnvelopeCell], state: u8, from_deg: f64) -> Option<f64> {
        within(cells, state, from_deg)
            .map(|c| c.hold_n)
            .try_fold(0.0_f64, |most, n| Some(most.max(n?)))
    }
    /// Fastest wind, m/s, up to which every wind from this direction is within the limit; None if the lightest is
    /// not.
    pub fn limit(&self, cells: &[EnvelopeCell], state: u8, from_deg: f64) -> Option<f64> {
        within(cells, state, from_deg)
            .take_while(|c| c.is_within(self.rate))
            .last()
            .map(|c| c.wind_mps)
    }
}

/// Cells with this sea state and wind direction.
fn within(cells: &[EnvelopeCell], state: u8, from_deg: f64) -> impl Iterator<Item = &EnvelopeCell> {
    let here = move |c: &&EnvelopeCell| (c.state, c.from_deg) == (state, from_deg);
    cells.iter().filter(here)
}

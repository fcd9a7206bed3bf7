//! `alight land --follow`: the drone follows the vessel for as long as one likes and does not land.

use core::fmt;

use alight_shared::msg::{Phase, State};
use serde::{Deserialize, Serialize};

use crate::lab::scene::Scene;

/// The longest time to follow: the longest mission that the configuration allows, s.
pub const MAX_FOLLOW_S: f64 = 36_000.0;
/// A battery for the longest time ten times over, s.
const ENDURANCE_S: f64 = 10.0 * MAX_FOLLOW_S;

/// Changes what the mission permits: everything but the descent.
pub fn disable_landing(scene: &mut Scene) {
    let mission = &mut scene.nodes.drone.mission;
    // No landing is certain: it follows.
    mission.min_probability = 1.0;
    mission.mission_timeout_s = MAX_FOLLOW_S;
    scene.scenario.drone.autopilot.endurance_s = ENDURANCE_S;
}

/// How it went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Followed {
    /// Time since the start, s.
    pub followed_s: f64,
    /// Time above the deck in Tracking or Tracking stable, s.
    pub above_deck_s: f64,
    /// How often it left them.
    pub left: u32,
    #[serde(skip)]
    above: bool,
}

impl Followed {
    /// A tick of `dt_s` at `t_s` since the start.
    pub fn update(&mut self, t_s: f64, dt_s: f64, state: State) {
        if t_s <= 0.0 {
            return;
        }
        self.followed_s = t_s;
        let above = state.phase() == Phase::Follow;
        self.left += u32::from(self.above && !above);
        self.above_deck_s += if above { dt_s } else { 0.0 };
        self.above = above;
    }
}

impl fmt::Display for Followed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "followed for {:.0} s, {:.0} s of them above the deck, left it {} times; nothing touched",
            self.followed_s, self.above_deck_s, self.left
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_above_the_deck_and_departures() {
        let mut followed = Followed::default();
        let states = [
            State::Approach,
            State::Tracking,
            State::TrackingStable,
            State::Hold,
            State::Tracking,
        ];
        followed.update(-1.0, 1.0, State::Tracking);
        for (k, state) in states.into_iter().enumerate() {
            followed.update(k as f64 + 1.0, 1.0, state);
        }
        assert_eq!(
            (followed.followed_s, followed.above_deck_s, followed.left),
            (5.0, 3.0, 1)
        );
    }
}

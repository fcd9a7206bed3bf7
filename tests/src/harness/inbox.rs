//! Input of a node whose process may stand still: what its shell finds when it goes on, of a topic the newest message, of a
//! queue all.

use alight_uav::mission::MissionIn;
use alight_uav::pilot::PilotIn;
use alight_uav::predictor::PredictorIn;

/// Input that waits.
pub trait Waits {
    /// This input with a later one behind it.
    fn then(self, later: Self) -> Self;
}

/// What waits for a node's next step.
#[derive(Debug)]
pub struct Inbox<I> {
    /// The node's process stands still.
    pub frozen: bool,
    waiting: Option<I>,
}

impl<I> Default for Inbox<I> {
    fn default() -> Self {
        Inbox {
            frozen: false,
            waiting: None,
        }
    }
}

impl<I: Waits> Inbox<I> {
    /// Input of a step, with what has waited; None while the process stands still.
    pub fn take(&mut self, new: I) -> Option<I> {
        let input = match self.waiting.take() {
            Some(before) => before.then(new),
            None => new,
        };
        if self.frozen {
            self.waiting = Some(input);
            return None;
        }
        Some(input)
    }
}

/// A queue with a later one behind it.
fn both<T>(mut before: Vec<T>, later: Vec<T>) -> Vec<T> {
    before.extend(later);
    before
}

impl Waits for PredictorIn {
    fn then(self, later: Self) -> Self {
        PredictorIn {
            estimate: later.estimate.or(self.estimate),
            wave: later.wave.or(self.wave),
            prediction: later.prediction.or(self.prediction),
            surroundings: later.surroundings.or(self.surroundings),
            link: later.link.or(self.link),
            drone: later.drone.or(self.drone),
            autopilot: later.autopilot.or(self.autopilot),
            beacons: both(self.beacons, later.beacons),
            tags: both(self.tags, later.tags),
            uvdar: both(self.uvdar, later.uvdar),
            ranges: both(self.ranges, later.ranges),
            checkpoint: later.checkpoint.or(self.checkpoint),
        }
    }
}

impl Waits for MissionIn {
    fn then(self, later: Self) -> Self {
        MissionIn {
            forecast: later.forecast.or(self.forecast),
            drone: later.drone.or(self.drone),
            autopilot: later.autopilot.or(self.autopilot),
            plan: later.plan.or(self.plan),
            set_point: later.set_point.or(self.set_point),
            commands: both(self.commands, later.commands),
            settings: later.settings.or(self.settings),
            deck: later.deck.or(self.deck),
            light: later.light.or(self.light),
            ranges: both(self.ranges, later.ranges),
            checkpoint: later.checkpoint.or(self.checkpoint),
        }
    }
}

impl Waits for PilotIn {
    fn then(self, later: Self) -> Self {
        PilotIn {
            plan: later.plan.or(self.plan),
            mission: later.mission.or(self.mission),
            forecast: later.forecast.or(self.forecast),
            drone: later.drone.or(self.drone),
            autopilot: later.autopilot.or(self.autopilot),
            ranges: both(self.ranges, later.ranges),
        }
    }
}

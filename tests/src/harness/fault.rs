//! Faults of a flight: which part, what happens to it, when, and for how long. Lock-step and real processes fly the same.

use alight_shared::msg::State;

use crate::physics::streams::Streams;
use crate::sensors::noise::Noise;

/// What may fail of a drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The process of the bridge.
    Bridge,
    /// The process of the predictor.
    Predictor,
    /// The process of the mission.
    Mission,
    /// The process of the planner.
    Planner,
    /// The process of the pilot.
    Pilot,
    /// The process that links to the autopilot.
    Link,
    /// The cable to the autopilot.
    Cable,
    /// The supervisor, and with it every process of the drone's computer.
    Supervisor,
}

/// What happens to a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// It is gone at once and started again by its supervisor.
    Kill,
    /// It stands still for 0.2 to 2 s and knows nothing of the time between.
    Freeze,
}

impl FaultKind {
    /// Both.
    pub const ALL: [FaultKind; 2] = [FaultKind::Kill, FaultKind::Freeze];
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            FaultKind::Kill => "kill",
            FaultKind::Freeze => "freeze",
        }
    }
}

/// When a fault happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// After this state was entered for the first time. `Landed` begins with the stop of the motors.
    In(State),
    /// At the first contact.
    Contact,
}

impl Moment {
    /// The longest time that a fault waits after its moment began, s: less than the phase usually lasts; after the stop of
    /// the motors as long as a disarm that is denied at first takes.
    const fn max_delay_s(self) -> f64 {
        match self {
            Moment::In(state) => match state {
                State::Approach | State::Search => 2.0,
                State::GetAltitude | State::Tracking => 0.5,
                State::TrackingStable => 0.1,
                State::Descent => 2.5,
                State::Flare => 0.8,
                State::Landed => 0.3,
                State::Idle
                | State::Hold
                | State::GaveUp
                | State::Preparing
                | State::Countdown
                | State::SpinUp
                | State::TakeOff
                | State::ClimbOut
                | State::StandDown => 0.0,
            },
            Moment::Contact => 0.0,
        }
    }
}

/// How long a frozen process stays frozen, s: shorter and longer than its readers wait for its messages.
const FROZEN_S: [f64; 2] = [0.2, 2.0];
/// How long a killed process is away in lock-step, s: a supervisor starts it again after 0.1 s, and on a busy computer its
/// start takes most of a second.
const AWAY_S: [f64; 2] = [0.15, 1.0];

/// A fault's times, drawn from the seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultTimes {
    /// From the moment's beginning to the fault, s.
    pub delay_s: f64,
    /// So long a frozen process stands still, s.
    pub frozen_s: f64,
    /// So long a killed one is away, s.
    pub away_s: f64,
}

impl FaultTimes {
    /// The times of this seed.
    pub fn drawn(moment: Moment, seed: u64) -> FaultTimes {
        let mut noise = Noise::new(&Streams::new(seed), "fault");
        let delay_s = moment.max_delay_s() * noise.uniform();
        let fraction = noise.uniform();
        let within = |[shortest, longest]: [f64; 2]| shortest + (longest - shortest) * fraction;
        FaultTimes {
            delay_s,
            frozen_s: within(FROZEN_S),
            away_s: within(AWAY_S),
        }
    }
    /// From the fault to its end, s.
    pub const fn lasts_s(&self, kind: FaultKind) -> f64 {
        match kind {
            FaultKind::Kill => self.away_s,
            FaultKind::Freeze => self.frozen_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_times_by_seed() {
        let moment = Moment::In(State::Descent);
        let all: Vec<_> = (0..20).map(|seed| FaultTimes::drawn(moment, seed)).collect();
        assert!(all.iter().all(|t| (0.0..2.5).contains(&t.delay_s)), "{all:?}");
        assert!(all.iter().all(|t| (0.2..2.0).contains(&t.frozen_s)), "{all:?}");
        assert_eq!(FaultTimes::drawn(moment, 3), all[3]);
        assert!(all.iter().any(|t| t.delay_s != all[0].delay_s));
    }
}

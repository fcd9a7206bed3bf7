//! The radio's keys, and the impairment of the radio inside a process, for trials.

use alight_shared::msg::State;
#[cfg(feature = "lab")]
use alight_shared::time::{Time, TrueTime};
use alight_shared::topics;
#[cfg(feature = "lab")]
use alight_sim::harness::scenario::StateOutage;
#[cfg(feature = "lab")]
use alight_sim::physics::streams::Streams;
#[cfg(feature = "lab")]
use alight_sim::radio::{Direction, Radio, on_air};

#[cfg(feature = "lab")]
use crate::config::LinkImpairment;

/// The key of `topic` as vessel `id` publishes it.
pub fn vessel_key(id: u32, topic: &str) -> String {
    format!("alight/vessel-{id}/{topic}")
}
/// The key of `topic` as drone `id` publishes it.
pub fn drone_key(id: &str, topic: &str) -> String {
    format!("alight/drone-{id}/{topic}")
}
/// What processes say about themselves.
pub const STATUS: &str = "status";
/// What drones say about themselves, from any drone. One chunk of a key is `drone-N`.
pub fn any_drone_status() -> String {
    format!("alight/drone-$*/{}", topics::DRONE_STATUS.name)
}
/// Commands of any operator.
pub fn any_operator_command() -> String {
    format!("alight/operator-$*/{}", topics::OPERATOR.name)
}
/// The drones' questions for the time, from any drone.
pub fn any_time_request() -> String {
    format!("alight/*/{}", topics::TIME_REQUEST.name)
}

/// Delays and loses what a process receives, as its profile says. Without a profile everything goes
/// straight through.
pub struct Impaired<T> {
    #[cfg(feature = "lab")]
    radio: Option<Radio<T>>,
    #[cfg(feature = "lab")]
    outage: Option<StateOutage>,
    #[cfg(feature = "lab")]
    epoch_ns: i64,
    through: Vec<(i64, T)>,
}

#[cfg(not(feature = "lab"))]
impl<T> Default for Impaired<T> {
    fn default() -> Self {
        Impaired { through: Vec::new() }
    }
}

#[cfg(not(feature = "lab"))]
impl<T> Impaired<T> {
    /// Something of `bytes` came at `at_ns` of the steady clock.
    pub fn take(&mut self, at_ns: i64, _bytes: usize, value: T) {
        self.through.push((at_ns, value));
    }
    /// What has arrived, with its time of arrival on the steady clock, ns.
    pub fn arrived(&mut self, _now_ns: i64) -> Vec<(i64, T)> {
        std::mem::take(&mut self.through)
    }
    /// The mission is in this state: nothing falls silent with it.
    pub fn enter(&mut self, _now_ns: i64, _state: State) {}
}

#[cfg(feature = "lab")]
impl<T: Clone> Impaired<T> {
    /// The impairment of one direction; `epoch_ns` is the steady clock at the profile's time zero.
    pub fn new(link: Option<&LinkImpairment>, direction: Direction, epoch_ns: i64) -> Impaired<T> {
        let radio = link.map(|l| Radio::new(&l.profile, direction, &Streams::new(l.seed)));
        Impaired {
            radio,
            outage: link.and_then(|l| l.outage),
            epoch_ns,
            through: Vec::new(),
        }
    }
    fn true_time(&self, steady_ns: i64) -> Time<TrueTime> {
        Time::from_nanos(steady_ns.saturating_sub(self.epoch_ns))
    }
    /// Something of `bytes` came at `at_ns` of the steady clock.
    pub fn take(&mut self, at_ns: i64, bytes: usize, value: T) {
        let at = self.true_time(at_ns);
        match &mut self.radio {
            Some(radio) => radio.send(at, on_air(bytes), value),
            None => self.through.push((at_ns, value)),
        }
    }
    /// What has arrived by `now_ns`, with its time of arrival on the steady clock, ns.
    pub fn arrived(&mut self, now_ns: i64) -> Vec<(i64, T)> {
        let now = self.true_time(now_ns);
        let epoch_ns = self.epoch_ns;
        match &mut self.radio {
            Some(radio) => radio
                .receive(now)
                .into_iter()
                .map(|(at, v)| (at.nanos().saturating_add(epoch_ns), v))
                .collect(),
            None => std::mem::take(&mut self.through),
        }
    }
    /// The mission is in this state, and with its first entry into some the radio falls silent.
    pub fn enter(&mut self, now_ns: i64, state: State) {
        let now = self.true_time(now_ns);
        if let (Some(radio), Some(outage)) = (&mut self.radio, self.outage.filter(|o| o.state == state)) {
            radio.set_outage(outage.window(now));
        }
    }
}

#[cfg(all(test, feature = "lab"))]
mod tests {
    use super::*;
    use alight_shared::msg::State;
    use alight_sim::radio::RadioConfig;

    #[test]
    fn impaired_link_delays_and_loses_and_a_clean_link_does_not() {
        let link = LinkImpairment {
            seed: 3,
            outage: Some(StateOutage {
                state: State::Flare,
                after_s: 0.5,
                duration_s: 1.0,
            }),
            profile: RadioConfig {
                loss: 0.0,
                duplicate: 0.0,
                ..RadioConfig::default()
            },
        };
        let mut impaired = Impaired::new(Some(&link), Direction::ToDrone, 1_000);
        let mut clean = Impaired::new(None, Direction::ToDrone, 1_000);
        impaired.take(2_000, 300, 'a');
        clean.take(2_000, 300, 'a');
        assert_eq!(clean.arrived(2_000), vec![(2_000, 'a')]);
        assert_eq!(impaired.arrived(2_000), vec![]);
        let late = impaired.arrived(1_000_000_000);
        assert!(late.len() == 1 && late[0].0 > 5_000_000, "{late:?}");
        impaired.enter(1_900_000_000, State::Descent);
        impaired.enter(2_000_000_000, State::Flare);
        for (at_ns, value) in [(2_400_000_000, 'b'), (2_600_000_000, 'c'), (3_600_000_000, 'd')] {
            impaired.take(at_ns, 300, value);
        }
        let after: Vec<char> = impaired.arrived(9_000_000_000).into_iter().map(|a| a.1).collect();
        assert_eq!(after, vec!['b', 'd']);
    }
}

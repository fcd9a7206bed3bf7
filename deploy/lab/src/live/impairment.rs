//! Impairment of one direction of the radio: of IP packets in the link emulator, or of a process's messages if no
//! emulator is permitted.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicI64, Ordering},
    },
    time::Duration,
};

use alight_shared::{
    msg::MissionState,
    time::{Span, Time, WorldTime},
};
use alight_sim::{
    harness::storm::{Fault, Moment},
    physics::streams::Streams,
    radio::{ChannelCounts, Direction, SimulatedRadio, on_air},
};
use alight_transport::{Received, clock::steady_ns, memory::Instance, observe::ReceiveChannel, wake};

use super::config::LinkImpairment;

const MAX_WAIT: Duration = Duration::from_millis(50);

pub struct Impaired<T> {
    radio: SimulatedRadio<T>,
    epoch_ns: i64,
    outage: Option<Fault>,
    /// Time at which the mission first entered the outage's state, steady clock, ns; 0 before that.
    entered_ns: Arc<AtomicI64>,
}

impl<T: Clone> Impaired<T> {
    pub fn new(link: &LinkImpairment, direction: Direction) -> Impaired<T> {
        Impaired {
            radio: SimulatedRadio::new(&link.profile, direction, &Streams::new(link.seed)),
            epoch_ns: link.epoch_ns,
            outage: link.outage,
            entered_ns: Arc::default(),
        }
    }
    /// Waits for the instance's mission to enter the outage's state, on a thread that ends with the process.
    pub fn follow_mission(&mut self, instance: Instance) {
        let Some(outage) = self.outage else { return };
        let entered_ns = Arc::clone(&self.entered_ns);
        std::thread::spawn(move || {
            let followed = wake::follow(
                &instance,
                "impairment",
                MAX_WAIT,
                |missions: Vec<MissionState>| {
                    let entered = missions.iter().any(|m| Moment::In(m.state) == outage.moment);
                    if entered {
                        entered_ns.store(steady_ns(), Ordering::Relaxed);
                    }
                    !entered
                },
            );
            if let Err(e) = followed {
                alight_computer::terminal::note(
                    true,
                    format_args!("alight: the outage does not follow the mission: {e}"),
                );
            }
        });
    }
    /// Records that the mission entered the outage's state at `at_ns` of the steady clock.
    pub fn begin_outage(&self, at_ns: i64) {
        self.entered_ns.store(at_ns, Ordering::Relaxed);
    }
    pub fn counts(&self) -> ChannelCounts {
        self.radio.counts()
    }
    /// Time from `now_ns` to the next arrival, at most `most`.
    pub fn idle(&self, now_ns: i64, most: Duration) -> Duration {
        let early = self.radio.next().map(|at| at - self.true_time(now_ns));
        early.map_or(most, |e| {
            Duration::from_nanos(e.nanos().max(0).unsigned_abs()).min(most)
        })
    }
    fn true_time(&self, steady_ns: i64) -> WorldTime {
        Time::from_nanos(steady_ns.saturating_sub(self.epoch_ns))
    }
    /// Sends a value of `bytes` over the radio at `at_ns` of the steady clock.
    pub fn take(&mut self, at_ns: i64, bytes: usize, value: T) {
        let at = self.true_time(at_ns);
        self.radio.send(at, bytes, value);
    }
    /// Values that have arrived by `now_ns`, with their arrival times on the steady clock, ns.
    pub fn arrived(&mut self, now_ns: i64) -> Vec<(i64, T)> {
        let entered_ns = self.entered_ns.load(Ordering::Relaxed);
        if let (1.., Some(outage)) = (entered_ns, self.outage.take_if(|_| entered_ns > 0)) {
            let from = self.true_time(entered_ns) + Span::from_secs(outage.after_s);
            // An outage longer than any landing is treated as permanent.
            let until = from + Span::from_secs(outage.lasts_s.min(1e6));
            self.radio.set_outage([from, until]);
        }
        let epoch_ns = self.epoch_ns;
        let arrived = self.radio.receive(self.true_time(now_ns)).into_iter();
        arrived
            .map(|(at, v)| (at.nanos().saturating_add(epoch_ns), v))
            .collect()
    }
}

pub struct Inbound {
    impaired: Impaired<Received>,
    ready: VecDeque<Received>,
}

impl Inbound {
    pub fn new(impaired: Impaired<Received>) -> Inbound {
        Inbound {
            impaired,
            ready: VecDeque::new(),
        }
    }
}

impl ReceiveChannel for Inbound {
    fn take(&mut self, packet: Received) {
        let bytes = on_air(packet.bytes.len());
        self.impaired.take(packet.at_ns, bytes, packet);
    }
    fn ready(&mut self, now_ns: i64) -> Option<Received> {
        let arrived = self.impaired.arrived(now_ns).into_iter();
        self.ready
            .extend(arrived.map(|(at_ns, packet)| Received { at_ns, ..packet }));
        self.ready.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::State;
    use alight_sim::{harness::storm::FaultKind, radio::SimulatedRadioConfig};

    #[test]
    fn impaired_link_delay_and_outage() {
        let link = LinkImpairment {
            epoch_ns: 1_000,
            seed: 3,
            outage: Some(Fault::new(
                FaultKind::RadioLost,
                Moment::In(State::Flare),
                0.5,
                1.0,
            )),
            profile: SimulatedRadioConfig {
                loss: 0.0,
                duplicate: 0.0,
                ..SimulatedRadioConfig::default()
            },
        };
        let mut impaired = Impaired::new(&link, Direction::ToDrone);
        impaired.take(2_000, 300, 'a');
        assert_eq!(impaired.arrived(2_000), vec![]);
        let late = impaired.arrived(1_000_000_000);
        assert!(late.len() == 1 && late[0].0 > 5_000_000, "{late:?}");
        impaired.begin_outage(2_000_000_000);
        assert_eq!(impaired.arrived(2_000_000_000), vec![]);
        for (at_ns, value) in [(2_400_000_000, 'b'), (2_600_000_000, 'c'), (3_600_000_000, 'd')] {
            impaired.take(at_ns, 300, value);
        }
        let after: Vec<char> = impaired.arrived(9_000_000_000).into_iter().map(|a| a.1).collect();
        assert_eq!(after, vec!['b', 'd']);
    }
}

//! One direction of a link at layer 3: the fate of each packet.
//!
//! Effects in order: the sender's queue and rate, outages, random loss, bursts of loss (Gilbert 1960, Elliott
//! 1963), duplication, delay with jitter.

use alight_shared::time::{Span, Time, WorldTime};

use serde::{Deserialize, Serialize};

use super::SimulatedRadioConfig;
use crate::{physics::streams::Streams, sensors::noise::Noise};

/// Interval of the vessel's packets at full rates, s.
const BURST_STEP_S: f64 = 0.025;
/// Number of steps after which the chain's state is independent of its start.
const MAX_BURST_STEPS: u32 = 1000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    ToDrone,
    ToVessel,
}

impl Direction {
    const fn stream(self) -> &'static str {
        match self {
            Direction::ToDrone => "radio.to_drone",
            Direction::ToVessel => "radio.to_vessel",
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelCounts {
    pub sent: u64,
    pub sent_bytes: u64,
    /// Packets lost randomly, in a burst, or in an outage.
    pub lost: u64,
    /// Packets dropped because the queue of a slow link was full.
    pub overflowed: u64,
    pub doubled: u64,
}

/// Faults of a channel in addition to its configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChannelFault {
    /// Fraction of packets lost, 0 to 1.
    pub loss: f64,
    /// Additional delay, s.
    pub delay_s: f64,
    /// Maximum of an additional uniform delay, s, which reorders packets.
    pub jitter_s: f64,
    /// Fraction of packets duplicated, 0 to 1.
    pub doubled: f64,
}

#[derive(Clone, Debug)]
pub struct RadioChannel {
    config: SimulatedRadioConfig,
    extra_s: f64,
    noise: Noise,
    bursts: Noise,
    in_burst: bool,
    last_sent: Option<WorldTime>,
    outage: Option<[WorldTime; 2]>,
    fault: ChannelFault,
    idle_at: WorldTime,
    last_arrival: WorldTime,
    counts: ChannelCounts,
}

impl RadioChannel {
    /// Uses the random streams `radio.to_drone` and `radio.to_vessel`, each with `.burst` for bursts.
    pub fn new(config: &SimulatedRadioConfig, direction: Direction, streams: &Streams) -> RadioChannel {
        let extra_s = match direction {
            Direction::ToDrone => config.to_drone_extra_s,
            Direction::ToVessel => config.to_vessel_extra_s,
        };
        RadioChannel::named(config, extra_s, direction.stream(), streams)
    }
    /// Channel for acknowledgements of `direction`, with a separate random stream.
    pub fn back(config: &SimulatedRadioConfig, direction: Direction, streams: &Streams) -> RadioChannel {
        let extra_s = match direction {
            Direction::ToDrone => config.to_vessel_extra_s,
            Direction::ToVessel => config.to_drone_extra_s,
        };
        RadioChannel::named(config, extra_s, &format!("{}.back", direction.stream()), streams)
    }
    /// Channel for traffic other than messages, with a separate random stream.
    pub fn probe(config: &SimulatedRadioConfig, direction: Direction, streams: &Streams) -> RadioChannel {
        let extra_s = match direction {
            Direction::ToDrone => config.to_drone_extra_s,
            Direction::ToVessel => config.to_vessel_extra_s,
        };
        RadioChannel::named(config, extra_s, &format!("{}.probe", direction.stream()), streams)
    }
    fn named(config: &SimulatedRadioConfig, extra_s: f64, name: &str, streams: &Streams) -> RadioChannel {
        RadioChannel {
            config: config.clone(),
            extra_s,
            noise: Noise::new(streams, name),
            bursts: Noise::new(streams, &format!("{name}.burst")),
            in_burst: false,
            last_sent: None,
            outage: None,
            fault: ChannelFault::default(),
            idle_at: Time::from_nanos(i64::MIN / 2),
            last_arrival: Time::from_nanos(i64::MIN / 2),
            counts: ChannelCounts::default(),
        }
    }

    /// Arrival times of a packet sent at `t`, and of its duplicate.
    pub fn send(&mut self, t: WorldTime, bytes: usize) -> [Option<WorldTime>; 2] {
        // Every packet makes all draws, so that an outage does not change the fate of later packets.
        let lost = self.noise.chance(self.config.loss);
        let twice = self.noise.chance(self.config.duplicate);
        let first = self.delay();
        let second = self.delay();
        let in_burst = self.burst(t);
        self.counts.sent += 1;
        self.counts.sent_bytes += bytes as u64;
        let Some(on_air) = self.transmit(t, bytes) else {
            self.counts.overflowed += 1;
            return [None, None];
        };
        let outage = self.outage.is_some_and(|[from, until]| from <= t && t < until);
        // A total loss needs no random draw.
        let fails = self.fault.loss >= 1.0 || (self.fault.loss > 0.0 && self.bursts.chance(self.fault.loss));
        if lost || in_burst || outage || fails || self.config.outages_s.cover(t) {
            self.counts.lost += 1;
            return [None, None];
        }
        let twice = twice || (self.fault.doubled > 0.0 && self.bursts.chance(self.fault.doubled));
        self.counts.doubled += u64::from(twice);
        let on_air = on_air + Span::from_secs(self.fault.delay_s);
        if self.fault.jitter_s > 0.0 {
            let mut late = || Span::from_secs(self.fault.jitter_s * self.bursts.uniform());
            return [
                Some(on_air + first + late()),
                twice.then(|| on_air + second + late()),
            ];
        }
        let arrival = self.in_order(on_air + first);
        [Some(arrival), twice.then(|| self.in_order(on_air + second))]
    }

    pub const fn fail(&mut self, fault: ChannelFault) {
        self.fault = fault;
    }
    /// Loses all packets sent in the window `[from, until)`; packets in transit arrive. Later calls do not
    /// change the window.
    pub fn set_outage(&mut self, window: [WorldTime; 2]) {
        self.outage = Some(self.outage.unwrap_or(window));
    }
    pub const fn counts(&self) -> ChannelCounts {
        self.counts
    }
    pub(super) fn drop_one(&mut self) {
        self.counts.lost += 1;
    }

    /// Whether this packet is lost in a burst: a Markov chain with two states, one step per packet. A burst
    /// lasts `1 / r` packets on average; the fraction `p / (p + r)` of all packets is lost in bursts. Without
    /// traffic the chain advances every [`BURST_STEP_S`], so that a fade ends even if the sender backs off.
    fn burst(&mut self, t: WorldTime) -> bool {
        let fraction = self.config.burst_loss;
        if fraction <= 0.0 {
            return false;
        }
        let r = 1.0 / self.config.burst_packets.max(1.0);
        let p = (r * fraction / (1.0 - fraction).max(1e-9)).min(1.0);
        let idle_s = self.last_sent.map_or(0.0, |at| (t - at).secs().max(0.0));
        self.last_sent = Some(t);
        let idle = ((idle_s / BURST_STEP_S) as u32).min(MAX_BURST_STEPS);
        for _ in 0..idle.max(1) {
            self.in_burst = if self.in_burst {
                !self.bursts.chance(r)
            } else {
                self.bursts.chance(p)
            };
        }
        self.in_burst
    }

    /// Departure time of the packet's last bit; None if the queue is full.
    fn transmit(&mut self, t: WorldTime, bytes: usize) -> Option<WorldTime> {
        let rate = self.config.rate_bps;
        if rate <= 0.0 {
            return Some(t);
        }
        let seconds = |bytes: f64| 8.0 * bytes / rate;
        let waiting_s = (self.idle_at - t).secs().max(0.0);
        if waiting_s > 0.0 && waiting_s + seconds(bytes as f64) > seconds(f64::from(self.config.queue_bytes))
        {
            return None;
        }
        self.idle_at = self.idle_at.max(t) + Span::from_secs(seconds(bytes as f64));
        Some(self.idle_at)
    }

    fn in_order(&mut self, arrival: WorldTime) -> WorldTime {
        if !self.config.keep_order {
            return arrival;
        }
        self.last_arrival = self.last_arrival.max(arrival);
        self.last_arrival
    }

    /// Normal delay, truncated at the minimum and at ten standard deviations.
    fn delay(&mut self) -> Span {
        let c = &self.config;
        let mut d = c.delay_s + c.delay_sd_s * self.noise.normal();
        // Redrawing keeps the truncated shape; the bound ensures that the loop ends for extreme configurations.
        for _ in 0..8 {
            if d >= c.delay_min_s {
                break;
            }
            d = c.delay_s + c.delay_sd_s * self.noise.normal();
        }
        Span::from_secs(
            d.clamp(c.delay_min_s, c.delay_min_s + c.delay_s + 10.0 * c.delay_sd_s) + self.extra_s,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn clean() -> SimulatedRadioConfig {
        SimulatedRadioConfig {
            loss: 0.0,
            duplicate: 0.0,
            delay_sd_s: 0.0,
            ..SimulatedRadioConfig::default()
        }
    }
    /// Delays of `n` packets of `bytes`, sent `step_s` apart; None: the packet is lost.
    fn fates(config: &SimulatedRadioConfig, n: usize, step_s: f64, bytes: usize) -> Vec<Option<f64>> {
        let mut channel = RadioChannel::new(config, Direction::ToDrone, &Streams::new(11));
        (0..n)
            .map(|k| {
                let t = Time::from_secs(k as f64 * step_s);
                channel.send(t, bytes)[0].map(|at| (at - t).secs())
            })
            .collect()
    }

    /// Fraction of `n` packets lost in bursts, and mean burst length (configured: 0.2 and 8).
    fn bursts(n: usize, step_s: f64) -> (f64, f64) {
        let config = SimulatedRadioConfig {
            burst_loss: 0.2,
            burst_packets: 8.0,
            ..clean()
        };
        let fates = fates(&config, n, step_s, 300);
        let lost = fates.iter().filter(|f| f.is_none()).count() as f64;
        let begins = |w: &&[Option<f64>]| w[0].is_some() && w[1].is_none();
        (
            lost / n as f64,
            lost / fates.windows(2).filter(begins).count() as f64,
        )
    }

    #[test]
    fn burst_loss_fraction_and_length() {
        let (fraction, length) = bursts(200_000, 0.01);
        // 5000 bursts give a standard error of the mean length of 8 / sqrt(5000) = 0.11.
        assert!((fraction - 0.2).abs() < 0.012, "{fraction}");
        assert!((length - 8.0).abs() < 0.4, "{length}");
    }

    #[test]
    fn burst_loss_with_a_rare_sender() {
        // Two packets per second are 20 steps apart, by which time a burst of 8 is over.
        let (fraction, length) = bursts(40_000, 0.5);
        assert!((fraction - 0.2).abs() < 0.012, "{fraction}");
        assert!((1.2..1.4).contains(&length), "{length}");
    }

    #[test]
    fn burst_loss_with_random_loss() {
        let random = SimulatedRadioConfig { loss: 0.1, ..clean() };
        let both = SimulatedRadioConfig {
            burst_loss: 0.1,
            burst_packets: 4.0,
            ..random.clone()
        };
        let a = fates(&random, 50_000, 0.01, 300);
        let b = fates(&both, 50_000, 0.01, 300);
        assert!(a.iter().zip(&b).all(|(a, b)| a.is_some() || b.is_none()));
        let fraction = b.iter().filter(|f| f.is_none()).count() as f64 / 50_000.0;
        assert!((fraction - 0.19).abs() < 0.012, "{fraction}");
    }

    #[test]
    fn slow_link_rate_and_queue() {
        let config = SimulatedRadioConfig {
            rate_bps: 32_000.0,
            queue_bytes: 2_000,
            ..clean()
        };
        // 40 packets of 300 B per second are 96 kbit/s, three times the link's rate.
        let fates = fates(&config, 4_000, 0.025, 300);
        let passed = fates.iter().flatten().count() as f64 * 300.0 * 8.0 / 100.0;
        assert!((passed - 32_000.0).abs() < 700.0, "{passed} bit/s");
        let longest = fates.iter().flatten().fold(0.0_f64, |a, b| a.max(*b));
        let bound = 0.05 + 2_000.0 * 8.0 / 32_000.0;
        assert!(longest <= bound + 1e-9 && longest > 0.8 * bound, "{longest} s");
    }

    #[test]
    fn link_order() {
        let jitter = SimulatedRadioConfig {
            delay_sd_s: 0.02,
            ..clean()
        };
        let overtakes = |config: &SimulatedRadioConfig| {
            let fates = fates(config, 2_000, 0.01, 300);
            let at: Vec<f64> = fates
                .iter()
                .flatten()
                .enumerate()
                .map(|(k, d)| k as f64 * 0.01 + d)
                .collect();
            at.windows(2).filter(|w| w[1] < w[0] - 1e-9).count()
        };
        assert!(overtakes(&jitter) > 300);
        let ordered = SimulatedRadioConfig {
            keep_order: true,
            ..jitter
        };
        assert_eq!(overtakes(&ordered), 0);
    }

    proptest! {
        #[test]
        fn link_minimum_delay(
            loss in 0.0..1.0_f64, burst_loss in 0.0..0.9_f64, delay_s in 0.0..0.3_f64,
            delay_sd_s in 0.0..0.1_f64, rate_bps in 1e3..1e6_f64, keep_order: bool, bytes in 1_usize..1500,
        ) {
            let config = SimulatedRadioConfig {
                loss, burst_loss, burst_packets: 3.0, delay_s, delay_sd_s, rate_bps, keep_order,
                duplicate: 0.1, ..SimulatedRadioConfig::default()
            };
            let mut channel = RadioChannel::new(&config, Direction::ToVessel, &Streams::new(5));
            for k in 0..200 {
                let t = Time::from_secs(f64::from(k) * 0.01);
                let shortest = config.delay_min_s + 8.0 * bytes as f64 / rate_bps - 1e-8;
                for at in channel.send(t, bytes).into_iter().flatten() {
                    prop_assert!((at - t).secs() >= shortest);
                }
            }
            let c = channel.counts();
            prop_assert_eq!((c.sent, c.sent_bytes), (200, 200 * bytes as u64));
            prop_assert!(c.lost + c.overflowed <= c.sent);
        }
    }
}

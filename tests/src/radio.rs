//! The radio between vessel and drone: delay, loss, duplication, outages, one direction each.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::time::{Span, Time, TrueTime};
use serde::{Deserialize, Serialize};

use crate::sensors::delay::DelayLine;
use crate::sensors::noise::{Noise, check_windows, covers};
use crate::streams::Streams;

/// Packets under way in one direction at most; what comes on top is lost.
const QUEUE: usize = 4096;

/// The radio, both directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RadioConfig {
    /// Mean of the delay before truncation, s.
    pub delay_s: f64,
    /// Its standard deviation, s. Delays are independent, so packets overtake each other.
    pub delay_sd_s: f64,
    /// Shortest delay, s.
    pub delay_min_s: f64,
    /// More delay from vessel to drone, s.
    pub to_drone_extra_s: f64,
    /// More delay from drone to vessel, s.
    pub to_vessel_extra_s: f64,
    /// Probability that a packet is lost.
    pub loss: f64,
    /// Probability that a packet that is not lost comes twice.
    pub duplicate: f64,
    /// Windows `[start, end)` in which everything sent is lost, s of true time.
    pub outages_s: Vec<[f64; 2]>,
}

impl Default for RadioConfig {
    fn default() -> Self {
        RadioConfig {
            // Issue 2: 50 +- 20 ms, 2 % loss.
            delay_s: 0.05,
            delay_sd_s: 0.02,
            // Ours: time on air and in two network stacks.
            delay_min_s: 0.005,
            to_drone_extra_s: 0.0,
            to_vessel_extra_s: 0.0,
            loss: 0.02,
            // Ours: datagrams come twice now and then.
            duplicate: 0.001,
            outages_s: Vec::new(),
        }
    }
}
impl Check for RadioConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("delay_s", self.delay_s, 0.0, 10.0)?;
        at.range("delay_sd_s", self.delay_sd_s, 0.0, 10.0)?;
        at.range("delay_min_s", self.delay_min_s, 0.0, 10.0)?;
        at.range("to_drone_extra_s", self.to_drone_extra_s, 0.0, 10.0)?;
        at.range("to_vessel_extra_s", self.to_vessel_extra_s, 0.0, 10.0)?;
        at.range("loss", self.loss, 0.0, 1.0)?;
        at.range("duplicate", self.duplicate, 0.0, 1.0)?;
        check_windows(at, "outages_s", &self.outages_s)
    }
}

/// Which way packets go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the vessel to the drone.
    ToDrone,
    /// From the drone to the vessel.
    ToVessel,
}

/// One direction of the radio.
#[derive(Clone, Debug)]
pub struct Radio<T> {
    config: RadioConfig,
    extra_s: f64,
    noise: Noise,
    line: DelayLine<T>,
    cut_after: Option<Time<TrueTime>>,
    sent: u64,
    lost: u64,
}

impl<T: Clone> Radio<T> {
    /// The radio of this seed in one direction; its streams are `radio.to_drone` and
    /// `radio.to_vessel`.
    pub fn new(config: &RadioConfig, direction: Direction, streams: &Streams) -> Self {
        let (name, extra_s) = match direction {
            Direction::ToDrone => ("radio.to_drone", config.to_drone_extra_s),
            Direction::ToVessel => ("radio.to_vessel", config.to_vessel_extra_s),
        };
        Radio {
            config: config.clone(),
            extra_s,
            noise: Noise::new(streams, name),
            line: DelayLine::new(QUEUE),
            cut_after: None,
            sent: 0,
            lost: 0,
        }
    }
    /// Sends a packet at `t`.
    pub fn send(&mut self, t: Time<TrueTime>, packet: T) {
        // All draws are made for every packet, so that an outage does not shift the others.
        let (lost, twice) = (
            self.noise.chance(self.config.loss),
            self.noise.chance(self.config.duplicate),
        );
        let (first, second) = (self.delay(), self.delay());
        self.sent += 1;
        let cut = self.cut_after.is_some_and(|c| t >= c);
        if lost || cut || covers(&self.config.outages_s, t) {
            self.lost += 1;
            return;
        }
        if twice {
            self.line.push(t + second, packet.clone());
        }
        if !self.line.push(t + first, packet) {
            self.lost += 1;
        }
    }
    /// The packets that have arrived by `t`, in the order and with the times of their arrival.
    pub fn receive(&mut self, t: Time<TrueTime>) -> Vec<(Time<TrueTime>, T)> {
        core::iter::from_fn(|| self.line.pop(t)).collect()
    }
    /// From `t` on everything sent is lost; what is on its way still arrives. An earlier cut
    /// stays.
    pub fn cut_after(&mut self, t: Time<TrueTime>) {
        self.cut_after = Some(self.cut_after.map_or(t, |c| c.min(t)));
    }
    /// Packets sent and lost so far.
    pub const fn counts(&self) -> (u64, u64) {
        (self.sent, self.lost)
    }
    /// A normal delay cut off at the shortest and at ten standard deviations.
    fn delay(&mut self) -> Span {
        let c = &self.config;
        let mut d = c.delay_s + c.delay_sd_s * self.noise.normal();
        // Redrawing keeps the truncated shape; the bound keeps a strange configuration finite.
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

    fn run(config: &RadioConfig, direction: Direction, n: usize) -> Vec<(usize, f64)> {
        let mut radio = Radio::new(config, direction, &Streams::new(7));
        let mut out = vec![];
        for k in 0..n + 200 {
            let t = Time::from_nanos(k as i64 * 10_000_000);
            if k < n {
                radio.send(t, k);
            }
            for (at, i) in radio.receive(t) {
                assert!(at <= t);
                out.push((i, at.secs() - i as f64 * 0.01));
            }
        }
        out
    }

    #[test]
    fn delay_and_loss_are_as_stated() {
        let n = 20_000;
        let config = RadioConfig {
            duplicate: 0.0,
            ..RadioConfig::default()
        };
        let got = run(&config, Direction::ToDrone, n);
        let loss = 1.0 - got.len() as f64 / n as f64;
        assert!((loss - 0.02).abs() < 0.004, "loss {loss}");
        let mean = got.iter().map(|g| g.1).sum::<f64>() / got.len() as f64;
        let sd = (got.iter().map(|g| (g.1 - mean).powi(2)).sum::<f64>() / got.len() as f64).sqrt();
        // Truncation at 5 ms moves the mean by half a millisecond.
        assert!((mean - 0.0506).abs() < 0.001, "mean {mean}");
        assert!((sd - 0.0193).abs() < 0.001, "sd {sd}");
        assert!(got.iter().all(|g| g.1 >= 0.005));
        assert!(got.windows(2).any(|w| w[1].0 < w[0].0), "nothing overtakes");
    }

    #[test]
    fn asymmetry_outages_duplicates_and_the_cut_do_what_they_say() {
        let config = RadioConfig {
            to_vessel_extra_s: 0.1,
            duplicate: 0.25,
            outages_s: vec![[1.0, 2.0]],
            ..RadioConfig::default()
        };
        let mean = |d| {
            let g = run(&config, d, 4000);
            g.iter().map(|g| g.1).sum::<f64>() / g.len() as f64
        };
        let apart = mean(Direction::ToVessel) - mean(Direction::ToDrone);
        assert!((apart - 0.1).abs() < 0.002, "{apart}");
        let got = run(&config, Direction::ToDrone, 4000);
        assert!(got.iter().all(|g| !(100..200).contains(&g.0)));
        let expected = 3900.0 * 0.98 * 1.25;
        assert!((got.len() as f64 / expected - 1.0).abs() < 0.03, "{}", got.len());

        let mut radio = Radio::new(
            &RadioConfig { loss: 0.0, ..config },
            Direction::ToDrone,
            &Streams::new(1),
        );
        radio.cut_after(Time::from_secs(0.5));
        radio.cut_after(Time::from_secs(0.9));
        radio.send(Time::from_secs(0.49), 1);
        radio.send(Time::from_secs(0.5), 2);
        let got = radio.receive(Time::from_secs(5.0));
        assert!(!got.is_empty() && got.iter().all(|(_, v)| *v == 1));
        assert_eq!(radio.counts(), (2, 1));
    }

    #[test]
    fn an_outage_does_not_shift_the_other_packets() {
        let clear = run(&RadioConfig::default(), Direction::ToDrone, 500);
        let config = RadioConfig {
            outages_s: vec![[1.0, 2.0]],
            ..RadioConfig::default()
        };
        let cut = run(&config, Direction::ToDrone, 500);
        let rest: Vec<_> = clear.into_iter().filter(|g| !(100..200).contains(&g.0)).collect();
        assert_eq!(rest, cut);
    }
}

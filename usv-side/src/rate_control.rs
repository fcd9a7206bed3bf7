//! How much of its full rates the vessel uses: less while the link backs up, all of it when it is
//! free.
//!
//! Each drone's question for the time says which estimate was its newest. The time from that
//! estimate's validity to the question's arrival, all on the vessel's clock, is the way there, the
//! wait for the next message and the way back. Its shortest of late is the free link's; what comes
//! on top is a queue. Loss says nothing: a bad link loses whatever is sent. The rise after a start
//! and the fall at a full queue are those of congestion control (Jacobson 1988): quickly up to where
//! the link backed up last, slowly beyond, down by a factor.

use alight_shared::config;
use alight_shared::time::{Time, VesselClock};

/// Drones that are told apart.
const MAX_DRONES: usize = 8;
/// The shortest way of so long counts, in two halves, s.
const HALF_WINDOW_S: f64 = 30.0;
/// A drone that says nothing for so long is not asked any more, s.
const LINK_TIMEOUT_S: f64 = 10.0;
/// The share that backed up is respected for so long, s.
const THRESHOLD_MEMORY_S: f64 = 10.0;
/// Answers of a drone that was not heard before, at the first share: a queue that was there drains,
/// and the shortest way shows.
const STARTUP_SAMPLES: u32 = 8;
/// Share gained at an answer below and beyond the share that backed up, and factor on backing up.
const INCREASE: f64 = 0.1;
const SLOW_INCREASE: f64 = 0.005;
const DECREASE_FACTOR: f64 = 0.7;

config! {
    /// When a link counts as backed up.
    pub struct RateControlConfig {
        /// The way there and back is longer than the shortest of late by this, s.
        /// Source: Ours: above the jitter of every profile, below half of the predictor's patience.
        pub congestion_delay_s: f64 = 0.2, in 0.02..=10.0;
        /// Share of the full rates for a drone that was not heard before.
        /// Source: Ours: 2.5 kB/s with headers, clearly less than 32 kbit/s: the way that is found at the
        /// start is one without a queue. At 0.3 (4 kB/s) it was not: 0.74 s of it stayed.
        pub initial_fraction: f64 = 0.15, in 0.05..=1.0;
        /// The lowest share.
        /// Source: Ours: estimates at 4.5 Hz.
        pub min_fraction: f64 = 0.15, in 0.05..=1.0;
    }
}

/// One drone's link.
#[derive(Clone, Copy, Debug)]
struct DroneLink {
    drone: u32,
    at: Time<VesselClock>,
    /// The shortest way of this half of the window and of the one before, s.
    min_delay_s: [f64; 2],
    half_window_start: Time<VesselClock>,
    congested: u32,
    samples: u32,
    rate_fraction: f64,
    threshold: f64,
    threshold_at: Time<VesselClock>,
}

/// The share of the full rates.
#[derive(Clone, Debug)]
pub struct RateControl {
    config: RateControlConfig,
    links: Vec<DroneLink>,
}

impl RateControl {
    /// Nobody has answered yet.
    pub fn new(config: &RateControlConfig) -> RateControl {
        RateControl {
            config: config.clone(),
            links: Vec::with_capacity(MAX_DRONES),
        }
    }

    /// A question of `drone` arrived at `now`; its newest estimate was valid at `newest`, and
    /// estimates go out every `period_s`.
    pub fn observe(&mut self, now: Time<VesselClock>, drone: u32, newest: Time<VesselClock>, period_s: f64) {
        let delay_s = (now - newest).secs();
        if !(0.0..=60.0).contains(&delay_s) {
            return;
        }
        let config = &self.config;
        self.links.retain(|l| (now - l.at).secs() < LINK_TIMEOUT_S);
        let known = self.links.iter().position(|l| l.drone == drone);
        let index = match known {
            Some(index) => index,
            None if self.links.len() < MAX_DRONES => {
                self.links.push(DroneLink {
                    drone,
                    at: now,
                    min_delay_s: [delay_s; 2],
                    half_window_start: now,
                    congested: 0,
                    samples: 0,
                    rate_fraction: config.initial_fraction,
                    threshold: 1.0,
                    threshold_at: now,
                });
                return;
            }
            None => return,
        };
        let Some(l) = self.links.get_mut(index) else {
            return;
        };
        l.at = now;
        l.samples = l.samples.saturating_add(1);
        if (now - l.half_window_start).secs() > HALF_WINDOW_S {
            (l.half_window_start, l.min_delay_s) = (now, [delay_s, l.min_delay_s[0]]);
        }
        l.min_delay_s[0] = l.min_delay_s[0].min(delay_s);
        let queue_delay_s = delay_s - l.min_delay_s[0].min(l.min_delay_s[1]);
        // Between two estimates the newest grows older by a period without any queue; a lost one
        // makes it two.
        if queue_delay_s > config.congestion_delay_s + 1.5 * period_s {
            l.congested += 1;
        } else {
            l.congested = 0;
        }
        if (now - l.threshold_at).secs() > THRESHOLD_MEMORY_S {
            l.threshold = 1.0;
        }
        // Twice in a row: a single late one is an outage that has just ended.
        if l.congested >= 2 {
            (l.threshold, l.threshold_at) = (0.85 * l.rate_fraction, now);
            l.rate_fraction = (DECREASE_FACTOR * l.rate_fraction).max(config.min_fraction);
            l.congested = 0;
        } else if l.congested == 0 && l.samples > STARTUP_SAMPLES {
            let increase = if l.rate_fraction < l.threshold {
                INCREASE
            } else {
                SLOW_INCREASE
            };
            l.rate_fraction = (l.rate_fraction + increase).min(1.0);
        }
    }

    /// The share of the full rates, after the listener with the worst link; all while nobody answers.
    pub fn rate_fraction(&self) -> f64 {
        self.links
            .iter()
            .map(|l| l.rate_fraction)
            .reduce(f64::min)
            .unwrap_or(1.0)
    }
    /// What the share does to the rate of estimates.
    pub fn estimate_fraction(&self) -> f64 {
        self.rate_fraction()
    }
    /// What it does to the rate of the large messages: they give way first.
    pub fn model_fraction(&self) -> f64 {
        self.rate_fraction().powi(2).max(0.09)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers at 2 Hz over a link of `capacity` (share of the full rates) with a queue of `depth_s`;
    /// the shares over `seconds`.
    fn run(
        rate_control: &mut RateControl,
        from_s: f64,
        seconds: f64,
        capacity: f64,
        depth_s: f64,
    ) -> Vec<f64> {
        let (mut queue_s, mut fractions, mut t) = (0.0_f64, Vec::new(), from_s);
        while t < from_s + seconds {
            let rate_fraction = rate_control.rate_fraction();
            // Offered minus carried, as time in the queue.
            queue_s = (queue_s + 0.5 * (rate_fraction / capacity - 1.0)).clamp(0.0, depth_s);
            let now = Time::from_secs(t);
            let newest = Time::from_secs(t - 0.1 - queue_s);
            rate_control.observe(now, 7, newest, 0.033 / rate_fraction);
            fractions.push(rate_fraction);
            t += 0.5;
        }
        fractions
    }

    #[test]
    fn rate_control_reaches_full_rates_on_a_free_link_within_seconds() {
        let mut rate_control = RateControl::new(&RateControlConfig::default());
        assert_eq!(rate_control.rate_fraction(), 1.0);
        let fractions = run(&mut rate_control, 0.0, 12.0, 10.0, 1.0);
        assert_eq!(fractions[2], 0.15);
        assert_eq!(*fractions.last().unwrap(), 1.0);
    }

    #[test]
    fn rate_control_settles_near_the_capacity_of_a_narrow_link_and_recovers() {
        let mut rate_control = RateControl::new(&RateControlConfig::default());
        let fractions = run(&mut rate_control, 0.0, 120.0, 0.4, 1.0);
        let settled = &fractions[60..];
        let mean = settled.iter().sum::<f64>() / settled.len() as f64;
        assert!((0.25..0.45).contains(&mean), "{mean}");
        assert!(settled.iter().all(|s| *s < 0.75));
        let after = run(&mut rate_control, 120.0, 30.0, 10.0, 1.0);
        assert_eq!(*after.last().unwrap(), 1.0);
    }

    #[test]
    fn rate_control_ignores_one_late_sample_and_implausible_times() {
        let mut rate_control = RateControl::new(&RateControlConfig::default());
        run(&mut rate_control, 0.0, 15.0, 10.0, 1.0);
        let t = Time::from_secs(15.0);
        rate_control.observe(t, 7, Time::from_secs(5.0), 0.033);
        rate_control.observe(t, 8, Time::from_secs(16.0), 0.033);
        rate_control.observe(t, 9, Time::from_secs(-1e6), 0.033);
        assert_eq!(rate_control.rate_fraction(), 1.0);
    }
}

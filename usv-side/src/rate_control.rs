//! Rate control of the broadcast: lower rates while the radio link is congested, full rates while it is free.
//!
//! Each time request of a drone states the time of validity of its newest estimate. The time from this to the
//! request's arrival, on the vessel's clock, contains the delay to the drone, the wait for its next request and the
//! delay back. Its minimum over the last minute is the delay of a free link; the excess is queueing delay. Loss is
//! not a sign of congestion, because a bad link loses messages at any rate. The rate rises quickly to the last point
//! of congestion, slowly beyond it, and falls by a factor (Jacobson 1988).
//!
//! All drones receive one broadcast. The worst link limits its rate; during a descent only the descending
//! drone's link does, and a drone that connects in the meantime waits.

use alight_shared::{config, time::VesselTime};

const MAX_DRONES: usize = 8;
/// Half of the window for the minimum delay, s.
const HALF_WINDOW_S: f64 = 30.0;
/// Silence after which a drone's link is ignored, s.
const LINK_TIMEOUT_S: f64 = 10.0;
/// Time for which the fraction at the last congestion is avoided, s: above the slow rise to it (up to 15 s).
const THRESHOLD_MEMORY_S: f64 = 20.0;
/// Samples of a new drone at the initial fraction, while a queue drains and reveals the minimum delay.
const STARTUP_SAMPLES: u32 = 8;
/// Increase of the fraction per sample, below and above the threshold, and factor on congestion.
const INCREASE: f64 = 0.1;
const SLOW_INCREASE: f64 = 0.005;
const DECREASE_FACTOR: f64 = 0.7;

config! {
    /// Detection of congested links, and their message rates.
    pub struct RateControlConfig {
        /// Queueing delay of a congested link, s.
        /// Chosen: above the jitter of every radio profile, below half of the predictor's timeout.
        pub congestion_delay_s: f64 = 0.2, in 0.02..=10.0;
        /// Initial fraction of the full rates for a new drone.
        /// Chosen: 1.4 kB/s with headers, below 32 kbit/s, to measure the initial delay without a queue. At 4
        /// kB/s 0.74 s of queueing delay remained.
        pub initial_fraction: f64 = 0.15, in 0.05..=1.0;
        /// Minimum fraction of the full rates.
        /// Chosen: estimates at 4.5 Hz.
        pub min_fraction: f64 = 0.15, in 0.05..=1.0;
    }
}

#[derive(Clone, Copy, Debug)]
struct DroneLink {
    drone: u32,
    at: VesselTime,
    /// Minimum delay in this half of the window and in the previous one, s.
    min_delay_s: [f64; 2],
    half_window_start: VesselTime,
    congested: u32,
    samples: u32,
    rate_fraction: f64,
    threshold: f64,
    threshold_at: VesselTime,
}

impl DroneLink {
    fn new(config: &RateControlConfig, now: VesselTime, drone: u32, delay_s: f64) -> Self {
        DroneLink {
            drone,
            at: now,
            min_delay_s: [delay_s; 2],
            half_window_start: now,
            congested: 0,
            samples: 0,
            rate_fraction: config.initial_fraction,
            threshold: 1.0,
            threshold_at: now,
        }
    }

    fn observe(&mut self, config: &RateControlConfig, now: VesselTime, delay_s: f64, period_s: f64) {
        self.at = now;
        self.samples = self.samples.saturating_add(1);
        if (now - self.half_window_start).secs() > HALF_WINDOW_S {
            self.half_window_start = now;
            self.min_delay_s = [delay_s, self.min_delay_s[0]];
        }
        self.min_delay_s[0] = self.min_delay_s[0].min(delay_s);
        let queue_delay_s = delay_s - self.min_delay_s[0].min(self.min_delay_s[1]);
        // Without a queue, the newest estimate is up to one period old, or two after a loss.
        if queue_delay_s > config.congestion_delay_s + 1.5 * period_s {
            self.congested += 1;
        } else {
            self.congested = 0;
        }
        if (now - self.threshold_at).secs() > THRESHOLD_MEMORY_S {
            self.threshold = 1.0;
        }
        // A single late sample is an outage that has just ended.
        if self.congested >= 2 {
            self.threshold = 0.85 * self.rate_fraction;
            self.threshold_at = now;
            self.rate_fraction = (DECREASE_FACTOR * self.rate_fraction).max(config.min_fraction);
            self.congested = 0;
        } else if self.congested == 0 && self.samples > STARTUP_SAMPLES {
            let fast = self.rate_fraction < self.threshold;
            let increase = if fast { INCREASE } else { SLOW_INCREASE };
            self.rate_fraction = (self.rate_fraction + increase).min(1.0);
        }
    }
}

/// Selects the fraction of the full rates that the links carry.
#[derive(Clone, Debug)]
pub struct RateControl {
    config: RateControlConfig,
    links: Vec<DroneLink>,
    pub landing: Option<u32>,
}

impl RateControl {
    pub fn new(config: &RateControlConfig) -> RateControl {
        RateControl {
            config: config.clone(),
            links: Vec::with_capacity(MAX_DRONES),
            landing: None,
        }
    }

    /// Adds a time request of `drone` received at `now`, which names an estimate valid at `newest`; estimates
    /// are `period_s` apart.
    pub fn observe(&mut self, now: VesselTime, drone: u32, newest: VesselTime, period_s: f64) {
        let delay_s = (now - newest).secs();
        if !(0.0..=60.0).contains(&delay_s) {
            return;
        }
        let config = &self.config;
        self.links.retain(|l| (now - l.at).secs() < LINK_TIMEOUT_S);
        if let Some(link) = self.links.iter_mut().find(|l| l.drone == drone) {
            link.observe(config, now, delay_s, period_s);
        } else if self.links.len() < MAX_DRONES {
            self.links.push(DroneLink::new(config, now, drone, delay_s));
        }
    }

    /// Fraction of full rates for estimates, limited by the descending drone's link or else by the worst; 1 without links.
    pub fn rate_fraction(&self) -> f64 {
        let landing = self.links.iter().find(|l| self.landing == Some(l.drone));
        let worst = || self.links.iter().map(|l| l.rate_fraction).reduce(f64::min);
        landing.map(|l| l.rate_fraction).or_else(worst).unwrap_or(1.0)
    }
    /// Fraction for wave model and prediction: large messages are reduced first.
    pub fn model_fraction(&self) -> f64 {
        self.rate_fraction().powi(2).max(0.09)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    /// Fractions over `seconds` at 2 Hz on a link of `capacity` (fraction) with a queue of at most `depth_s`.
    fn control() -> RateControl {
        RateControl::new(&RateControlConfig::default())
    }
    fn run(
        rate_control: &mut RateControl,
        from_s: f64,
        seconds: f64,
        capacity: f64,
        depth_s: f64,
    ) -> Vec<f64> {
        let mut queue_s = 0.0_f64;
        let mut fractions = Vec::new();
        let mut t = from_s;
        while t < from_s + seconds {
            let rate_fraction = rate_control.rate_fraction();
            // Offered minus carried data, as time in the queue.
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
    fn rate_control_on_a_free_link() {
        let mut rate_control = control();
        assert_eq!(rate_control.rate_fraction(), 1.0);
        let fractions = run(&mut rate_control, 0.0, 12.0, 10.0, 1.0);
        assert_eq!(fractions[2], 0.15);
        assert_eq!(*fractions.last().unwrap(), 1.0);
    }

    #[test]
    fn rate_control_on_a_narrow_link() {
        let mut rate_control = control();
        let fractions = run(&mut rate_control, 0.0, 120.0, 0.4, 1.0);
        let steady = &fractions[60..];
        let mean = steady.iter().sum::<f64>() / steady.len() as f64;
        assert!((0.25..0.45).contains(&mean), "{mean}");
        assert!(steady.iter().all(|s| *s < 0.75));
        let after = run(&mut rate_control, 120.0, 30.0, 10.0, 1.0);
        assert_eq!(*after.last().unwrap(), 1.0);
    }

    #[test]
    fn rate_control_with_a_newcomer() {
        let mut rate_control = control();
        run(&mut rate_control, 0.0, 15.0, 10.0, 1.0);
        rate_control.landing = Some(7);
        for k in 0..8 {
            let t = 15.0 + 0.5 * f64::from(k);
            rate_control.observe(Time::from_secs(t), 8, Time::from_secs(t - 0.1), 0.033);
            rate_control.observe(Time::from_secs(t), 7, Time::from_secs(t - 0.1), 0.033);
            assert_eq!(rate_control.rate_fraction(), 1.0);
        }
        // The descending drone's own link still counts.
        let congested = run(&mut rate_control, 19.0, 30.0, 0.4, 1.0);
        assert!(*congested.last().unwrap() < 0.75, "{congested:?}");
        rate_control.landing = None;
        rate_control.observe(Time::from_secs(49.0), 9, Time::from_secs(48.9), 0.033);
        assert_eq!(rate_control.rate_fraction(), 0.15);
    }

    #[test]
    fn rate_control_with_implausible_times() {
        let mut rate_control = control();
        run(&mut rate_control, 0.0, 15.0, 10.0, 1.0);
        let t = Time::from_secs(15.0);
        rate_control.observe(t, 7, Time::from_secs(5.0), 0.033);
        rate_control.observe(t, 8, Time::from_secs(16.0), 0.033);
        rate_control.observe(t, 9, Time::from_secs(-1e6), 0.033);
        assert_eq!(rate_control.rate_fraction(), 1.0);
    }
}

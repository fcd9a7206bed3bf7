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
const DRONES: usize = 8;
/// The shortest way of so long counts, in two halves, s.
const HALF_WINDOW_S: f64 = 30.0;
/// A drone that says nothing for so long is not asked any more, s.
const SILENCE_S: f64 = 10.0;
/// The share that backed up is respected for so long, s.
const MEMORY_S: f64 = 10.0;
/// Answers of a drone that was not heard before, at the first share: a queue that was there drains,
/// and the shortest way shows.
const FIRST_ANSWERS: u32 = 8;
/// Share gained at an answer below and beyond the share that backed up, and factor on backing up.
const RISE: f64 = 0.1;
const SLOW_RISE: f64 = 0.005;
const FALL: f64 = 0.7;

config! {
    /// When a link counts as backed up.
    pub struct ThrottleConfig {
        /// The way there and back is longer than the shortest of late by this, s.
        /// Source: Ours: above the jitter of every profile, below half of the predictor's patience.
        pub backed_up_s: f64 = 0.2, in 0.02..=10.0;
        /// Share of the full rates for a drone that was not heard before.
        /// Source: Ours: 2.5 kB/s with headers, clearly less than 32 kbit/s: the way that is found at the
        /// start is one without a queue. At 0.3 (4 kB/s) it was not: 0.74 s of it stayed.
        pub first_share: f64 = 0.15, in 0.05..=1.0;
        /// The lowest share.
        /// Source: Ours: estimates at 4.5 Hz.
        pub lowest_share: f64 = 0.15, in 0.05..=1.0;
    }
}

/// One drone's link.
#[derive(Clone, Copy, Debug)]
struct Listener {
    drone: u32,
    at: Time<VesselClock>,
    /// The shortest way of this half of the window and of the one before, s.
    shortest_s: [f64; 2],
    half_began: Time<VesselClock>,
    backed_up: u32,
    answers: u32,
    share: f64,
    limit: f64,
    limit_at: Time<VesselClock>,
}

/// The share of the full rates.
#[derive(Clone, Debug)]
pub struct Throttle {
    config: ThrottleConfig,
    listeners: Vec<Listener>,
}

impl Throttle {
    /// Nobody has answered yet.
    pub fn new(config: &ThrottleConfig) -> Throttle {
        Throttle {
            config: config.clone(),
            listeners: Vec::with_capacity(DRONES),
        }
    }

    /// A question of `drone` arrived at `now`; its newest estimate was valid at `newest`, and
    /// estimates go out every `period_s`.
    pub fn heard(&mut self, now: Time<VesselClock>, drone: u32, newest: Time<VesselClock>, period_s: f64) {
        let way_s = (now - newest).secs();
        if !(0.0..=60.0).contains(&way_s) {
            return;
        }
        let config = &self.config;
        self.listeners.retain(|l| (now - l.at).secs() < SILENCE_S);
        let known = self.listeners.iter().position(|l| l.drone == drone);
        let index = match known {
            Some(index) => index,
            None if self.listeners.len() < DRONES => {
                self.listeners.push(Listener {
                    drone,
                    at: now,
                    shortest_s: [way_s; 2],
                    half_began: now,
                    backed_up: 0,
                    answers: 0,
                    share: config.first_share,
                    limit: 1.0,
                    limit_at: now,
                });
                return;
            }
            None => return,
        };
        let Some(l) = self.listeners.get_mut(index) else {
            return;
        };
        l.at = now;
        l.answers = l.answers.saturating_add(1);
        if (now - l.half_began).secs() > HALF_WINDOW_S {
            (l.half_began, l.shortest_s) = (now, [way_s, l.shortest_s[0]]);
        }
        l.shortest_s[0] = l.shortest_s[0].min(way_s);
        let queued_s = way_s - l.shortest_s[0].min(l.shortest_s[1]);
        // Between two estimates the newest grows older by a period without any queue; a lost one
        // makes it two.
        if queued_s > config.backed_up_s + 1.5 * period_s {
            l.backed_up += 1;
        } else {
            l.backed_up = 0;
        }
        if (now - l.limit_at).secs() > MEMORY_S {
            l.limit = 1.0;
        }
        // Twice in a row: a single late one is an outage that has just ended.
        if l.backed_up >= 2 {
            (l.limit, l.limit_at) = (0.85 * l.share, now);
            l.share = (FALL * l.share).max(config.lowest_share);
            l.backed_up = 0;
        } else if l.backed_up == 0 && l.answers > FIRST_ANSWERS {
            let rise = if l.share < l.limit { RISE } else { SLOW_RISE };
            l.share = (l.share + rise).min(1.0);
        }
    }

    /// The share of the full rates, after the listener with the worst link; all while nobody answers.
    pub fn share(&self) -> f64 {
        self.listeners
            .iter()
            .map(|l| l.share)
            .reduce(f64::min)
            .unwrap_or(1.0)
    }
    /// What the share does to the rate of estimates.
    pub fn of_state(&self) -> f64 {
        self.share()
    }
    /// What it does to the rate of the large messages: they give way first.
    pub fn of_models(&self) -> f64 {
        self.share().powi(2).max(0.09)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers at 2 Hz over a link of `capacity` (share of the full rates) with a queue of `depth_s`;
    /// the shares over `seconds`.
    fn run(throttle: &mut Throttle, from_s: f64, seconds: f64, capacity: f64, depth_s: f64) -> Vec<f64> {
        let (mut queue_s, mut shares, mut t) = (0.0_f64, Vec::new(), from_s);
        while t < from_s + seconds {
            let share = throttle.share();
            // Offered minus carried, as time in the queue.
            queue_s = (queue_s + 0.5 * (share / capacity - 1.0)).clamp(0.0, depth_s);
            let now = Time::from_secs(t);
            let newest = Time::from_secs(t - 0.1 - queue_s);
            throttle.heard(now, 7, newest, 0.033 / share);
            shares.push(share);
            t += 0.5;
        }
        shares
    }

    #[test]
    fn a_free_link_gets_the_full_rates_within_seconds() {
        let mut throttle = Throttle::new(&ThrottleConfig::default());
        assert_eq!(throttle.share(), 1.0);
        let shares = run(&mut throttle, 0.0, 12.0, 10.0, 1.0);
        assert_eq!(shares[2], 0.15);
        assert_eq!(*shares.last().unwrap(), 1.0);
    }

    #[test]
    fn a_narrow_link_settles_near_what_it_carries_and_a_free_one_gets_all_again() {
        let mut throttle = Throttle::new(&ThrottleConfig::default());
        let shares = run(&mut throttle, 0.0, 120.0, 0.4, 1.0);
        let settled = &shares[60..];
        let mean = settled.iter().sum::<f64>() / settled.len() as f64;
        assert!((0.25..0.45).contains(&mean), "{mean}");
        assert!(settled.iter().all(|s| *s < 0.75));
        let after = run(&mut throttle, 120.0, 30.0, 10.0, 1.0);
        assert_eq!(*after.last().unwrap(), 1.0);
    }

    #[test]
    fn one_late_answer_changes_nothing_and_nonsense_is_not_an_answer() {
        let mut throttle = Throttle::new(&ThrottleConfig::default());
        run(&mut throttle, 0.0, 15.0, 10.0, 1.0);
        let t = Time::from_secs(15.0);
        throttle.heard(t, 7, Time::from_secs(5.0), 0.033);
        throttle.heard(t, 8, Time::from_secs(16.0), 0.033);
        throttle.heard(t, 9, Time::from_secs(-1e6), 0.033);
        assert_eq!(throttle.share(), 1.0);
    }
}

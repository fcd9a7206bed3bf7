//! Offset of the drone's clock from the vessel's, from time stamps exchanged by radio (Mills' on-wire protocol, RFC
//! 5905, section 8).
//!
//! With `o` = drone clock minus vessel clock, the request left at t1 (drone) and arrived at t2 (vessel), and the reply
//! left at t3 (vessel) and arrived at t4 (drone). A message arrives after it was sent, so `t1 - t2 <= o <= t4 - t3` for
//! any delays: an interval of one round trip about Mills' estimate `((t1 - t2) + (t4 - t3)) / 2`. Time stamps do not
//! show how the round trip divides between the directions. The interval covers every division; its uniform standard
//! deviation is width / sqrt(12), and an error at its edge is sqrt(3) of these.
//!
//! Every exchange in the window contributes, with bounds widened by the drift since then. The fastest request and the
//! fastest reply therefore bound the offset even if they belong to different exchanges: Mills' minimum-delay sample per
//! direction. Vessel estimates provide upper bounds, because their time of validity precedes their arrival.
//!
//! The middle of the bounds is biased: with scattered delays, the direction with more messages has the smaller minimum
//! delay. The estimate is the median of Mills' estimates over the half of the exchanges with the shorter round trips,
//! limited to the bounds.

use std::collections::VecDeque;

use alight_shared::{
    estimation::{OffsetBounds, median},
    time::{DroneClock, DroneTime, Span, VesselTime},
};

use crate::config::ClockConfig;

const MAX_SAMPLES: usize = 256;
/// Number of exchanges that count as recent in the detection of a step.
const RECENT: usize = 10;

type Bounds = OffsetBounds<DroneClock>;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    pub offset_s: f64,
    /// Standard deviation including path asymmetry, s.
    pub sd_s: f64,
    /// Bound of the offset's error, s.
    pub max_error_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeRejection {
    RoundTrip,
    /// The exchange contradicts all others. It may be the first after a step, and is stored separately.
    Contradiction,
}

/// Bounds of the offset over a window of exchanges.
#[derive(Clone, Debug)]
pub struct ClockOffset {
    config: ClockConfig,
    samples: VecDeque<Bounds>,
    /// Upper bounds from one-way messages, the best of each half second.
    one_way: VecDeque<Bounds>,
    suspect: Option<Bounds>,
    steps: u32,
    /// Combined bounds at the time of the last change, to be widened by the drift.
    combined: Option<Bounds>,
    /// Median of Mills' estimates, s.
    median_s: f64,
}

/// Error of a time stamp caused by its resolution, s.
const CLOCK_RESOLUTION_S: f64 = 1e-7;

impl ClockOffset {
    pub fn new(config: &ClockConfig) -> Self {
        ClockOffset {
            config: config.clone(),
            samples: VecDeque::with_capacity(MAX_SAMPLES),
            one_way: VecDeque::with_capacity(MAX_SAMPLES),
            suspect: None,
            steps: 0,
            combined: None,
            median_s: 0.0,
        }
    }

    /// Forgets all exchanges after a restart of the vessel's computer.
    pub fn reset(&mut self) {
        self.samples.clear();
        self.one_way.clear();
        self.suspect = None;
        self.combined = None;
    }

    pub fn steps(&self) -> u32 {
        self.steps
    }

    pub fn exchange(
        &mut self,
        t1: DroneTime,
        t2: VesselTime,
        t3: VesselTime,
        t4: DroneTime,
    ) -> Result<(), ExchangeRejection> {
        let mut new = Bounds::of_exchange(t1, t2.nanos(), t3.nanos(), t4);
        let max_drift = self.config.max_drift;
        // On a cable the round trip can be shorter than the drift of two clocks during it.
        let drift = Span::from_secs((t4 - t1).secs().max(0.0) * max_drift + CLOCK_RESOLUTION_S);
        if (new.high - new.low).abs() < drift {
            (new.low, new.high) = (new.low.min(new.high) - drift, new.low.max(new.high) + drift);
        }
        let round_trip = (new.high - new.low).secs();
        if t3 < t2 || t4 < t1 || !(0.0..=self.config.max_round_trip_s).contains(&round_trip) {
            return Err(ExchangeRejection::RoundTrip);
        }
        let contradicts = |b: Bounds| new.contradicts(b.drifted(t4, max_drift));
        if self.combined.is_some_and(contradicts) {
            // Disjoint from all earlier bounds: accepted once a second exchange agrees.
            let agrees = self.suspect.is_some_and(|s| !contradicts(s));
            if !agrees {
                self.suspect = Some(new);
                return Err(ExchangeRejection::Contradiction);
            }
            self.steps = self.steps.saturating_add(1);
            let first = self.suspect.take();
            self.reset();
            self.samples.extend(first);
        }
        self.suspect = None;
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(new);
        self.detect_step(t4);
        self.combine(t4);
        Ok(())
    }

    /// Adds an upper bound from a message valid at `at`, unless no exchange is known or they contradict it.
    pub fn one_way(&mut self, at: VesselTime, arrival: DroneTime) {
        let new = Bounds::of_message(at.nanos(), arrival);
        let max_drift = self.config.max_drift;
        let Some(now) = self.combined.map(|b| b.drifted(arrival, max_drift)) else {
            return;
        };
        if new.contradicts(now) {
            return;
        }
        match self.one_way.back_mut() {
            Some(b) if (arrival - b.at).secs() < 0.5 => *b = b.and(new),
            _ => {
                if self.one_way.len() == MAX_SAMPLES {
                    self.one_way.pop_front();
                }
                self.one_way.push_back(new);
            }
        }
        if new.high < now.high {
            self.combined = Some(now.and(new));
        }
    }

    /// Offset at `now`; None before the first exchange.
    pub fn at(&self, now: DroneTime) -> Option<Offset> {
        let b = self.combined?.drifted(now, self.config.max_drift);
        let low = b.low.secs();
        let high = b.high.secs();
        let offset_s = self.median_s.clamp(low, high);
        let half = 0.5 * (high - low);
        let off_middle = offset_s - 0.5 * (low + high);
        Some(Offset {
            offset_s,
            sd_s: (half / 3f64.sqrt()).hypot(off_middle).max(self.config.min_sd_s),
            max_error_s: half + off_middle.abs(),
        })
    }

    /// Intersection of these bounds at `now`; None if there are none.
    fn both<'a>(&self, all: impl Iterator<Item = &'a Bounds>, now: DroneTime) -> Option<Bounds> {
        all.map(|b| b.drifted(now, self.config.max_drift))
            .reduce(Bounds::and)
    }

    /// Detects a step: both bounds moved the same way by more than `step_s`. Forgets earlier exchanges.
    fn detect_step(&mut self, now: DroneTime) {
        let n = self.samples.len();
        if n < 2 * RECENT {
            return;
        }
        let best = |r: core::ops::Range<usize>| self.both(self.samples.range(r), now);
        let Some((old, new)) = best(0..n - RECENT).zip(best(n - RECENT..n)) else {
            return;
        };
        let dl = (new.low - old.low).secs();
        let dh = (new.high - old.high).secs();
        if dl * dh > 0.0 && dl.abs().min(dh.abs()) > self.config.step_s {
            self.steps = self.steps.saturating_add(1);
            self.samples.drain(..n - RECENT);
            self.one_way.clear();
        }
    }

    /// Drops bounds outside the window and intersects the rest.
    fn combine(&mut self, now: DroneTime) {
        let window = self.config.window_s;
        self.samples.retain(|b| (now - b.at).secs() <= window);
        self.one_way.retain(|b| (now - b.at).secs() <= window);
        let both = self.both(self.samples.iter().chain(&self.one_way), now);
        // If the drift exceeds its limit, only the newest exchange is valid.
        let valid = both.filter(|b| b.low <= b.high);
        let Some(known) = valid.or(self.samples.back().copied()) else {
            return;
        };
        self.combined = Some(Bounds { at: now, ..known });
        self.median_s = self.median();
    }

    /// Median of Mills' estimates over the exchanges with the shorter round trips, s.
    fn median(&self) -> f64 {
        let mut sorted: Vec<Bounds> = self.samples.iter().copied().collect();
        sorted.sort_by_key(|b| b.high - b.low);
        sorted.truncate(sorted.len().div_ceil(2));
        median(sorted.iter().map(|b| 0.5 * (b.low.secs() + b.high.secs()))).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    fn offset() -> ClockOffset {
        ClockOffset::new(&ClockConfig::default())
    }
    fn t<C>(s: f64) -> Time<C> {
        Time::from_secs(s)
    }
    /// Performs an exchange at drone time `now` (s) with the given one-way delays and true offset.
    fn run(
        c: &mut ClockOffset,
        now: f64,
        there: f64,
        back: f64,
        offset: f64,
    ) -> Result<(), ExchangeRejection> {
        let t2 = now + there - offset;
        c.exchange(t(now), t(t2), t(t2 + 0.002), t(now + there + 0.002 + back))
    }

    #[test]
    fn clock_offset_with_symmetric_delays() {
        let mut c = offset();
        for k in 0..10 {
            run(&mut c, 0.5 * f64::from(k), 0.05, 0.05, 0.437).unwrap();
        }
        let o = c.at(t(5.0)).unwrap();
        assert!((o.offset_s - 0.437).abs() < 1e-4, "{o:?}");
        assert!((o.sd_s - 0.05 / 3f64.sqrt()).abs() < 1e-3, "{o:?}");
    }

    #[test]
    fn clock_offset_drifting_by_20_ppm() {
        let mut c = offset();
        for k in 0..1200 {
            let now = 0.5 * f64::from(k);
            run(&mut c, now, 0.03, 0.03, 0.2 + 20e-6 * now).unwrap();
        }
        let o = c.at(t(600.0)).unwrap();
        assert!((o.offset_s - 0.212).abs() < 2e-3, "{o:?}");
    }

    #[test]
    fn clock_offset_step_confirmed_by_second_exchange() {
        let mut c = offset();
        for k in 0..20 {
            run(&mut c, 0.5 * f64::from(k), 0.05, 0.05, 0.4).unwrap();
        }
        assert_eq!(
            run(&mut c, 10.0, 0.05, 0.05, -3.0),
            Err(ExchangeRejection::Contradiction)
        );
        assert_eq!(run(&mut c, 10.5, 0.05, 0.05, -3.0), Ok(()));
        assert_eq!(c.steps(), 1);
        assert!((c.at(t(10.6)).unwrap().offset_s + 3.0).abs() < 1e-3);
    }

    #[test]
    fn clock_offset_step_shorter_than_round_trip() {
        let mut c = offset();
        for k in 0..60 {
            let now = 0.5 * f64::from(k);
            let offset = if now < 20.0 { 0.0 } else { 0.06 };
            run(&mut c, now, 0.05, 0.05, offset).unwrap();
        }
        assert_eq!(c.steps(), 1);
        assert!((c.at(t(30.0)).unwrap().offset_s - 0.06).abs() < 2e-3);
    }

    #[test]
    fn clock_offset_from_one_way_messages() {
        let mut c = offset();
        c.one_way(t(0.0), t(0.5));
        assert_eq!(c.at(t(0.0)), None, "no offset from one direction alone");
        run(&mut c, 0.0, 0.05, 0.05, 0.4).unwrap();
        let before = c.at(t(1.0)).unwrap();
        c.one_way(t(0.6), t(1.01));
        let after = c.at(t(1.01)).unwrap();
        assert!(after.sd_s < before.sd_s && (after.offset_s - 0.4).abs() <= after.max_error_s);
        // A message cannot be valid after its arrival, so this one is ignored.
        c.one_way(t(5.0), t(1.02));
        assert!((c.at(t(1.02)).unwrap().offset_s - after.offset_s).abs() < 1e-6);
    }

    #[test]
    fn clock_offset_with_uneven_traffic() {
        let mut c = offset();
        // Delays vary between 60 and 140 ms, and thirty estimates arrive per two exchanges.
        let delay = |k: u32, phase: f64| 0.1 + 0.04 * (f64::from(k) * 2.4 + phase).sin();
        for k in 0..60 {
            let now = 0.5 * f64::from(k);
            run(&mut c, now, delay(k, 0.3), delay(k, 4.0), 0.4).unwrap();
            for j in 0..15 {
                // One of these estimates arrives after 10 ms.
                let late = if (k, j) == (40, 7) {
                    0.01
                } else {
                    delay(15 * k + j, 1.0)
                };
                let sent = now + 0.03 * f64::from(j);
                c.one_way(t(sent - 0.4), t(sent + late));
            }
        }
        let o = c.at(t(30.0)).unwrap();
        assert!((o.offset_s - 0.4).abs() < 6e-3, "{o:?}");
    }

    #[test]
    fn clock_offset_without_delay() {
        let mut c = offset();
        for k in 0..5 {
            let start = f64::from(k);
            // The vessel held the request for 10 ms on its own clock, which is 20 ppm fast.
            let t2 = start + 3.0;
            let t3 = start + 3.0 + 0.01 * 1.000_02;
            c.exchange(t(start), t(t2), t(t3), t(start + 0.01)).unwrap();
        }
        let offset = c.at(t(5.0)).unwrap();
        assert!(
            (offset.offset_s + 3.0).abs() < 1e-4 && offset.sd_s < 2e-3,
            "{offset:?}"
        );
    }

    #[test]
    fn clock_offset_impossible_round_trips() {
        let mut c = offset();
        assert_eq!(
            c.exchange(t(1.0), t(0.0), t(0.5), t(1.1)),
            Err(ExchangeRejection::RoundTrip)
        );
        assert_eq!(
            c.exchange(t(1.0), t(0.5), t(0.4), t(1.1)),
            Err(ExchangeRejection::RoundTrip)
        );
        assert_eq!(
            c.exchange(t(1.0), t(0.5), t(0.5), t(9.0)),
            Err(ExchangeRejection::RoundTrip)
        );
        assert_eq!(c.at(t(9.0)), None);
    }
}

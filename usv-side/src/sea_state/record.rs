//! The record: the last minute of motion in bins.

use std::collections::VecDeque;

use alight_shared::time::{Time, VesselClock};

use super::MotionSample;

/// Channels: acceleration upwards, normal north, normal east.
pub(super) const CHANNELS: usize = 3;
/// Longest gap within a record, s: the path across a longer one is not known well enough.
const MAX_GAP_S: f64 = 5.0;
/// Samples in a row that are older than the record after which the clock is taken to have jumped.
const CLOCK_JUMP: u32 = 100;
/// Beyond these a sample is implausible.
const MAX_ACCELERATION_MPS2: f64 = 50.0;
const MAX_MEAN_SPEED_MPS: f64 = 30.0;

/// The mean of the samples that fell into one bin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bin {
    /// Number of the bin since the record's start.
    pub index: i64,
    /// Mean time, s since the record's start.
    pub t: f64,
    /// Mean of the velocity: north, east, m/s.
    pub velocity: [f64; 2],
    /// Mean of the channels; that of the acceleration over its neighbours too, see [`smoothing`].
    pub y: [f64; CHANNELS],
    /// Mean of the acceleration in this bin alone, m/s².
    up: f64,
    /// Samples in it.
    count: f64,
}

/// A bounded record of bins.
#[derive(Clone, Debug)]
pub(super) struct Record {
    bin_s: f64,
    capacity: usize,
    bins: VecDeque<Bin>,
    open: Bin,
    start: Time<VesselClock>,
    newest: Option<MotionSample>,
    late_in_a_row: u32,
    rejected: u64,
}

impl Record {
    /// An empty record of `window_s` in bins of `bin_s`.
    pub fn new(window_s: f64, bin_s: f64) -> Self {
        let capacity = ((window_s / bin_s).ceil() as usize).clamp(16, 2048);
        Record {
            bin_s,
            capacity,
            bins: VecDeque::with_capacity(capacity + 1),
            open: Bin::default(),
            start: Time::EPOCH,
            newest: None,
            late_in_a_row: 0,
            rejected: 0,
        }
    }

    /// Takes a sample or counts it as rejected.
    pub fn push(&mut self, sample: &MotionSample) {
        if !plausible(sample) {
            self.rejected += 1;
            return;
        }
        let Some(last) = self.newest else {
            self.restart(sample);
            return;
        };
        let dt = (sample.at - last.at).secs();
        if dt <= 0.0 {
            self.rejected += 1;
            self.late_in_a_row += 1;
            if self.late_in_a_row > CLOCK_JUMP {
                self.restart(sample);
            }
            return;
        }
        self.late_in_a_row = 0;
        if dt > MAX_GAP_S {
            self.restart(sample);
            return;
        }
        self.newest = Some(*sample);
        self.add(sample);
    }

    fn restart(&mut self, sample: &MotionSample) {
        self.bins.clear();
        self.open = Bin::default();
        self.start = sample.at;
        self.late_in_a_row = 0;
        self.newest = Some(*sample);
        self.add(sample);
    }

    fn add(&mut self, sample: &MotionSample) {
        let t = (sample.at - self.start).secs();
        let index = (t / self.bin_s).floor() as i64;
        if index != self.open.index {
            self.close();
            self.open = Bin {
                index,
                ..Bin::default()
            };
        }
        let y = [sample.acceleration_up, sample.normal[0], sample.normal[1]];
        let open = &mut self.open;
        open.count += 1.0;
        let share = 1.0 / open.count;
        open.t += (t - open.t) * share;
        for i in 0..2 {
            open.velocity[i] += (sample.mean_velocity[i] - open.velocity[i]) * share;
        }
        for c in 0..CHANNELS {
            open.y[c] += (y[c] - open.y[c]) * share;
        }
    }

    fn close(&mut self) {
        if self.open.count > 0.0 {
            self.open.up = self.open.y[0];
            // The bin before now has both its neighbours.
            let mut last = self.bins.iter_mut().rev();
            if let (Some(middle), Some(before)) = (last.next(), last.next())
                && self.open.index - before.index == 2
            {
                middle.y[0] = 0.25 * (before.up + 2.0 * middle.up + self.open.up);
            }
            self.bins.push_back(self.open);
            // By index, not by number: missing bins age the record as well.
            let oldest = self.open.index - self.capacity as i64;
            while self.bins.front().is_some_and(|b| b.index <= oldest) {
                self.bins.pop_front();
            }
        }
    }

    /// The closed bins, oldest first.
    pub fn bins(&self) -> impl Iterator<Item = &Bin> + Clone + '_ {
        self.bins.iter()
    }
    /// From the oldest closed bin to the newest, s.
    pub fn span_s(&self) -> f64 {
        match (self.bins.front(), self.bins.back()) {
            (Some(a), Some(b)) => b.t - a.t,
            (Some(_), None) | (None, Some(_)) | (None, None) => 0.0,
        }
    }
    /// Time of the newest closed bin.
    pub fn newest(&self) -> Option<f64> {
        self.bins.back().map(|b| b.t)
    }
    /// Instant of the record's time `t`.
    pub fn instant(&self, t: f64) -> Time<VesselClock> {
        self.start + alight_shared::time::Span::from_secs(t)
    }
    /// The record's time of the instant `at`, s.
    pub fn elapsed(&self, at: Time<VesselClock>) -> f64 {
        (at - self.start).secs()
    }
    /// Samples rejected so far.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

/// What the weights 1/4, 1/2, 1/4 over neighbouring bins leave of an acceleration of angular frequency
/// `omega` (rad/s): `cos^2(omega T / 2)`. A platform that rocks swings its centre of gravity up twice a
/// period, by the lever to its axis times the tilt squared, faster than any wave heaves it: that stays
/// out of the fit.
pub(super) fn smoothing(omega: f64, bin_s: f64) -> f64 {
    (0.5 * omega * bin_s).cos().powi(2)
}

fn plausible(s: &MotionSample) -> bool {
    // A NaN fails every comparison.
    s.acceleration_up.abs() < MAX_ACCELERATION_MPS2
        && s.mean_velocity.iter().all(|v| v.abs() < MAX_MEAN_SPEED_MPS)
        && s.normal.iter().all(|n| n.abs() <= 1.0)
}

//! A byte stream over a lossy channel, such as TCP or TLS over TCP: each message waits for all earlier data
//! (head-of-line blocking).
//!
//! The model of the sender includes the features of a present-day kernel that affect message age. On loss, CUBIC (RFC
//! 9438) multiplies the congestion window by 0.7, and BBR (Cardwell et al. 2017) keeps at least four segments. Losses
//! are detected when later segments arrive first, with a timer for recent segments (RFC 8985, RACK); a tail-loss probe
//! follows two round trips without a known loss. The retransmission time-out is at least 200 ms, doubles (RFC 6298),
//! and restarts at every measured round trip, including selective acknowledgements, as in Linux. Like the middleware,
//! the sender drops messages that do not fit into the socket's buffer.

use std::collections::VecDeque;

use alight_shared::time::{Span, WorldTime};

use super::{ChannelCounts, Congestion, RadioChannel, SimulatedRadioConfig};
use crate::sensors::delay::DelayLine;

/// Maximum payload of a segment, bytes: 1500 minus IP and TCP headers and time stamps.
const SEGMENT: u64 = 1448;
const HEADERS: usize = 52;
/// Maximum number of segments and acknowledgements in transit.
const QUEUE: usize = 4096;
/// Initial congestion window, segments.
const FIRST_WINDOW: f64 = 10.0;
/// Minimum window of BBR after losses, segments.
const MIN_WINDOW: f64 = 4.0;
/// Window of BBR when the sender's data rate limits it, segments: twice the data of one round trip of these
/// messages (10 to 35 measured with a Linux kernel).
const USUAL_WINDOW: f64 = 24.0;
/// Minimum retransmission time-out, s.
const MIN_TIMEOUT_S: f64 = 0.2;
/// Maximum retransmission time-out, s.
const MAX_TIMEOUT_S: f64 = 120.0;
/// Number of recoveries after which an unneeded extension of the reordering window ends.
const REORDER_WINDOW_RECOVERIES: u8 = 16;
const RANGES: usize = 4;

/// Bytes `[from, until)`.
type Range = (u64, u64);

/// A segment that is not yet acknowledged.
#[derive(Clone, Copy, Debug)]
struct Segment {
    range: Range,
    sent_at: WorldTime,
    arrived: bool,
    lost: bool,
    /// The segment was sent more than once, so its acknowledgement measures no round trip.
    again: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timer {
    /// Timer after which overtaken segments count as lost.
    Reorder,
    /// Timer for the tail-loss probe.
    Probe,
    TimeOut,
}

#[derive(Clone, Debug)]
struct Acknowledgement {
    /// All bytes before this one have arrived.
    first: u64,
    /// Further ranges that have arrived, newest first.
    ranges: Vec<Range>,
    sent_at: WorldTime,
    /// The segment had already arrived before (RFC 2883).
    double: bool,
}

#[derive(Clone, Debug)]
enum Event {
    Data(Range, WorldTime),
    Ack(Acknowledgement),
}

/// One direction of a stream, with a separate channel for acknowledgements.
#[derive(Clone, Debug)]
pub struct RadioStream<T> {
    there: RadioChannel,
    back: RadioChannel,
    buffer: u64,
    congestion: Congestion,
    events: DelayLine<Event>,
    // Messages with the position of their end in the stream.
    messages: VecDeque<(u64, T)>,
    written: u64,
    sent: u64,
    acknowledged: u64,
    flight: VecDeque<Segment>,
    window: f64,
    threshold: f64,
    recover: u64,
    /// The window restarts at one segment until `recover` is acknowledged.
    after_time_out: bool,
    round_trip: Option<(f64, f64)>,
    /// Minimum round trip, s.
    shortest_s: f64,
    /// Send time and round trip (s) of the newest segment that has arrived.
    latest: Option<(WorldTime, f64)>,
    /// Wait for an overtaken segment, in quarters of the minimum round trip; the end of that wait's validity,
    /// and the remaining recoveries for which it holds (RFC 8985, 7.2).
    reorder_window: u8,
    reorder_window_until: Option<WorldTime>,
    recoveries: u8,
    backoff: i32,
    probed: bool,
    timer: Option<(WorldTime, Timer)>,
    /// Time of the retransmission time-out, independent of the timer's current purpose.
    time_out_at: Option<WorldTime>,
    received: Vec<Range>,
    delivered: u64,
    ready: Vec<(WorldTime, T)>,
    dropped: u64,
}

impl<T: Clone> RadioStream<T> {
    pub fn new(config: &SimulatedRadioConfig, there: RadioChannel, back: RadioChannel) -> RadioStream<T> {
        RadioStream {
            there,
            back,
            buffer: u64::from(config.stream_buffer_bytes),
            congestion: config.congestion,
            events: DelayLine::new(QUEUE),
            messages: VecDeque::new(),
            written: 0,
            sent: 0,
            acknowledged: 0,
            flight: VecDeque::new(),
            window: FIRST_WINDOW,
            threshold: f64::INFINITY,
            recover: 0,
            after_time_out: false,
            round_trip: None,
            shortest_s: f64::INFINITY,
            latest: None,
            reorder_window: 1,
            reorder_window_until: None,
            recoveries: 0,
            backoff: 0,
            probed: false,
            timer: None,
            time_out_at: None,
            received: Vec::new(),
            delivered: 0,
            ready: Vec::new(),
            dropped: 0,
        }
    }
    /// Reopens the stream on the same channels; data in transit are lost.
    pub fn reopen(&mut self, config: &SimulatedRadioConfig) {
        let fresh = RadioStream::new(config, self.there.clone(), self.back.clone());
        let dropped = self.dropped + self.messages.len() as u64;
        *self = RadioStream { dropped, ..fresh };
    }
    pub fn channels(&mut self) -> [&mut RadioChannel; 2] {
        [&mut self.there, &mut self.back]
    }
    pub const fn counts(&self) -> ChannelCounts {
        self.there.counts()
    }
    /// Number of messages that did not fit into the buffer, or were lost with the connection.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    pub fn send(&mut self, t: WorldTime, bytes: usize, message: T) {
        self.advance(t);
        if self.written - self.acknowledged + bytes as u64 > self.buffer {
            self.dropped += 1;
            return;
        }
        self.written += bytes as u64;
        self.messages.push_back((self.written, message));
        self.transmit(t);
    }
    /// Messages delivered by `t` with arrival times, in order.
    pub fn receive(&mut self, t: WorldTime) -> Vec<(WorldTime, T)> {
        self.advance(t);
        core::mem::take(&mut self.ready)
    }

    fn advance(&mut self, t: WorldTime) {
        loop {
            let event = self.events.next();
            let first = self.timer.filter(|(at, _)| event.is_none_or(|e| *at <= e));
            if let Some((at, timer)) = first {
                if at > t {
                    return;
                }
                self.on_timer(at, timer);
            } else {
                match self.events.pop(t) {
                    Some((at, Event::Data(range, sent_at))) => self.data(at, range, sent_at),
                    Some((at, Event::Ack(ack))) => self.ack(at, &ack),
                    None => return,
                }
            }
        }
    }

    fn under_way(&self) -> f64 {
        self.flight.iter().filter(|s| !s.arrived && !s.lost).count() as f64
    }
    fn put(&mut self, t: WorldTime, range: Range) {
        let bytes = (range.1 - range.0) as usize + HEADERS;
        for at in self.there.send(t, bytes).into_iter().flatten() {
            // A full delay line drops the segment.
            let _lost = self.events.push(at, Event::Data(range, t));
        }
    }
    /// Sends within the window: retransmissions first, then new data.
    fn transmit(&mut self, t: WorldTime) {
        let mut sent = false;
        while self.under_way() < self.window.floor().max(1.0) {
            if let Some(k) = self.flight.iter().position(|s| s.lost) {
                self.retransmit(t, k);
            } else if !self.send_new(t) {
                break;
            }
            sent = true;
        }
        // A write that waits does not change the timer.
        if sent {
            self.set_timer(t);
        }
    }
    fn retransmit(&mut self, t: WorldTime, k: usize) {
        let Some(segment) = self.flight.get_mut(k) else {
            return;
        };
        segment.lost = false;
        segment.again = true;
        segment.sent_at = t;
        let range = segment.range;
        self.put(t, range);
        if k == 0 {
            self.time_out_at = Some(t + self.time_out());
        }
    }
    /// Sends at most one segment of new data; returns false without any.
    fn send_new(&mut self, t: WorldTime) -> bool {
        if self.sent == self.written {
            return false;
        }
        let range = (self.sent, self.written.min(self.sent + SEGMENT));
        self.sent = range.1;
        if self.flight.is_empty() {
            self.time_out_at = Some(t + self.time_out());
        }
        self.flight.push_back(Segment {
            range,
            sent_at: t,
            arrived: false,
            lost: false,
            again: false,
        });
        self.put(t, range);
        true
    }

    fn data(&mut self, t: WorldTime, range: Range, sent_at: WorldTime) {
        let double =
            range.1 <= self.delivered || self.received.iter().any(|r| r.0 <= range.0 && range.1 <= r.1);
        self.received.push(range);
        self.received.sort_unstable();
        self.received.retain(|r| {
            let next = r.0 <= self.delivered;
            if next {
                self.delivered = self.delivered.max(r.1);
            }
            !next
        });
        self.received.dedup();
        while self
            .messages
            .front()
            .is_some_and(|(end, _)| *end <= self.delivered)
        {
            self.ready
                .extend(self.messages.pop_front().map(|(_, message)| (t, message)));
        }
        // The newest range is first.
        let mut ranges = vec![range];
        ranges.extend(self.received.iter().rev().take(RANGES - 1));
        for at in self.back.send(t, HEADERS + 12).into_iter().flatten() {
            let ack = Acknowledgement {
                first: self.delivered,
                ranges: ranges.clone(),
                sent_at,
                double,
            };
            let _lost = self.events.push(at, Event::Ack(ack));
        }
    }

    fn ack(&mut self, t: WorldTime, ack: &Acknowledgement) {
        let first = ack.first;
        let sent_at = ack.sent_at;
        let sample = (t - sent_at).secs();
        let limited = self.under_way() >= self.window.floor();
        let open = |flight: &VecDeque<Segment>| flight.iter().filter(|s| !s.arrived).count();
        let before = open(&self.flight);
        let progress = first > self.acknowledged;
        self.acknowledged = self.acknowledged.max(first);
        let head_at = self.flight.front().map(|s| s.sent_at);
        let mut measured = progress;
        for segment in self.flight.iter_mut().filter(|s| !s.arrived) {
            let inside = |r: &Range| r.0 <= segment.range.0 && segment.range.1 <= r.1;
            if segment.range.1 <= first || ack.ranges.iter().any(inside) {
                measured |= !segment.again;
                segment.arrived = true;
                segment.lost = false;
                if self.latest.is_none_or(|(at, _)| segment.sent_at > at) {
                    self.latest = Some((segment.sent_at, (t - segment.sent_at).secs()));
                }
            }
        }
        self.flight.retain(|s| s.range.1 > first);
        if measured {
            self.backoff = 0;
            self.shortest_s = self.shortest_s.min(sample);
            let (mean, spread) = match self.round_trip {
                None => (sample, 0.5 * sample),
                Some((mean, spread)) => (
                    mean + (sample - mean) / 8.0,
                    spread + ((sample - mean).abs() - spread) / 4.0,
                ),
            };
            self.round_trip = Some((mean, spread));
        }
        self.update_reorder_window(t, ack.double);
        self.find_lost(t);
        let gained = before.saturating_sub(open(&self.flight)) as f64;
        match self.congestion {
            // After a time-out the window grows with acknowledgements and is restored when all data have arrived.
            Congestion::Bbr => {
                let recovered = self.after_time_out && self.acknowledged >= self.recover;
                let window = if recovered {
                    USUAL_WINDOW
                } else {
                    self.window + gained
                };
                self.window = window.clamp(MIN_WINDOW, USUAL_WINDOW);
            }
            Congestion::Cubic if limited && (self.after_time_out || self.acknowledged >= self.recover) => {
                self.window += if self.window < self.threshold {
                    gained
                } else {
                    gained / self.window
                };
            }
            Congestion::Cubic => {}
        }
        self.after_time_out &= self.acknowledged < self.recover;
        self.probed &= !progress;
        // A segment sent after the head does not indicate how long the head is overdue.
        if progress || head_at.is_some_and(|at| sent_at < at) {
            self.time_out_at = Some(t + self.time_out());
        }
        self.transmit(t);
        self.set_timer(t);
    }

    /// Widens the reordering window, at most once per round trip, after an unnecessary retransmission (the
    /// segment was overtaken, not lost), for sixteen recoveries.
    fn update_reorder_window(&mut self, t: WorldTime, double: bool) {
        if double && self.reorder_window_until.is_none_or(|at| t >= at) {
            self.reorder_window = self.reorder_window.saturating_add(1);
            self.recoveries = REORDER_WINDOW_RECOVERIES;
            self.reorder_window_until = self.round_trip.map(|(mean, _)| t + Span::from_secs(mean));
        } else if self.recoveries == 0 {
            self.reorder_window = 1;
        }
    }

    /// Time by which a later segment may overtake one that is not lost, s: a number of quarters of the
    /// minimum round trip, at most the mean round trip.
    fn reordering_s(&self) -> f64 {
        let usual_s = self.round_trip.map_or(f64::INFINITY, |r| r.0);
        (0.25 * self.shortest_s.min(usual_s) * f64::from(self.reorder_window)).min(usual_s)
    }

    /// Marks segments as lost if they were sent long enough before a segment that has arrived.
    fn find_lost(&mut self, t: WorldTime) {
        let Some((latest_at, round_trip_s)) = self.latest else {
            return;
        };
        let limit = Span::from_secs(round_trip_s + self.reordering_s());
        let mut loss = false;
        for segment in self.flight.iter_mut().filter(|s| !s.arrived && !s.lost) {
            if segment.sent_at < latest_at && t >= segment.sent_at + limit {
                segment.lost = true;
                loss = true;
            }
        }
        if loss && self.acknowledged >= self.recover {
            self.recover = self.sent;
            self.recoveries = self.recoveries.saturating_sub(1);
            match self.congestion {
                Congestion::Cubic => {
                    self.threshold = (0.7 * self.window).max(2.0);
                    self.window = self.threshold;
                }
                Congestion::Bbr => {}
            }
        }
    }

    /// Retransmission time-out, measured from the sending of the oldest segment.
    fn time_out(&self) -> Span {
        let (mean, spread) = self.round_trip.unwrap_or((0.5, 0.125));
        let timeout = mean + (4.0 * spread).max(MIN_TIMEOUT_S);
        Span::from_secs((timeout * 2f64.powi(self.backoff)).min(MAX_TIMEOUT_S))
    }

    fn set_timer(&mut self, t: WorldTime) {
        let Some(time_out_at) = self.time_out_at.filter(|_| !self.flight.is_empty()) else {
            self.timer = None;
            self.time_out_at = None;
            return;
        };
        let round_trip_s = self.round_trip.map_or(0.5, |r| r.0);
        let overtaken = self.latest.and_then(|(latest_at, round_trip_s)| {
            let limit = Span::from_secs(round_trip_s + self.reordering_s());
            let waits = self.flight.iter().filter(|s| !s.arrived && !s.lost);
            waits
                .filter(|s| s.sent_at < latest_at)
                .map(|s| s.sent_at + limit)
                .min()
        });
        let undisturbed =
            self.acknowledged >= self.recover && !self.flight.iter().any(|s| s.arrived || s.lost);
        self.timer = Some(match overtaken {
            Some(at) if at < time_out_at => (at.max(t), Timer::Reorder),
            Some(_) | None if undisturbed && !self.probed && self.backoff == 0 => {
                let alone = if self.flight.len() == 1 {
                    MIN_TIMEOUT_S
                } else {
                    0.0
                };
                let at = t + Span::from_secs(2.0 * round_trip_s + alone);
                if at < time_out_at {
                    (at, Timer::Probe)
                } else {
                    (time_out_at, Timer::TimeOut)
                }
            }
            Some(_) | None => (time_out_at.max(t), Timer::TimeOut),
        });
    }
    fn on_timer(&mut self, t: WorldTime, timer: Timer) {
        match timer {
            Timer::Reorder => {
                self.find_lost(t);
                self.transmit(t);
                self.set_timer(t);
            }
            Timer::Probe => {
                // Sends new data, or the last segment again; its acknowledgement reveals the gaps.
                self.probed = true;
                if !self.send_new(t)
                    && let Some(last) = self.flight.iter().rposition(|s| !s.arrived)
                {
                    self.retransmit(t, last);
                }
                self.time_out_at = Some(t + self.time_out());
                self.set_timer(t);
            }
            Timer::TimeOut => {
                self.threshold = (0.7 * self.window).max(2.0);
                self.recover = self.sent;
                self.after_time_out = true;
                self.backoff = (self.backoff + 1).min(10);
                // Segments of the last round trip may still arrive; only the oldest counts as lost.
                let round_trip_s = self.latest.map_or(0.0, |l| l.1);
                let recent = t - Span::from_secs(round_trip_s);
                for (k, segment) in self.flight.iter_mut().enumerate().filter(|(_, s)| !s.arrived) {
                    segment.lost |= k == 0 || segment.sent_at <= recent;
                }
                self.window = self.under_way() + 1.0;
                self.time_out_at = Some(t + self.time_out());
                self.transmit(t);
                self.set_timer(t);
            }
        }
    }
}

#[cfg(test)]
mod tests;

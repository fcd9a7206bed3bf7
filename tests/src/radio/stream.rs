//! A byte stream over a lossy channel: how late a message comes when everything before it has to
//! come first (head-of-line blocking), as TCP, and TLS over it, have it.
//!
//! The sender is that of a present-day kernel as far as the age of a message depends on it: a
//! congestion window in segments that shrinks to 0.7 at a loss (RFC 9438), losses told by what was
//! sent later and came first (RFC 8985, RACK), a probe of the tail after two round trips, a
//! retransmission timer from round-trip times of at least 200 ms that doubles (RFC 6298). A message
//! that does not fit into the socket's buffer is dropped, as the middleware drops it.

use std::collections::VecDeque;

use alight_shared::time::{Span, Time, TrueTime};

use super::{Channel, RadioConfig};
use crate::sensors::delay::DelayLine;

/// Largest payload of a segment, bytes: 1500 without IP and TCP headers and time stamps.
const SEGMENT: u64 = 1448;
/// Headers of a segment, bytes.
const HEADERS: usize = 52;
/// Segments and acknowledgements under way at most.
const QUEUE: usize = 4096;
/// Segments that may be under way at the start.
const FIRST_WINDOW: f64 = 10.0;
/// Shortest retransmission time-out, s.
const SHORTEST_TIMEOUT_S: f64 = 0.2;
/// Longest, s.
const LONGEST_TIMEOUT_S: f64 = 120.0;
/// Ranges that an acknowledgement names beside the first.
const RANGES: usize = 4;

/// Bytes `[from, until)`.
type Range = (u64, u64);

/// A segment that was sent and is not acknowledged.
#[derive(Clone, Copy, Debug)]
struct Segment {
    range: Range,
    sent_at: Time<TrueTime>,
    arrived: bool,
    lost: bool,
}

#[derive(Clone, Debug)]
enum Event {
    /// A segment comes in.
    Data(Range, Time<TrueTime>),
    /// An acknowledgement comes in: everything before, ranges beyond, when the segment that it
    /// answers was sent.
    Ack(u64, Vec<Range>, Time<TrueTime>),
}

/// One direction of a stream; its acknowledgements come back on a channel of their own.
#[derive(Clone, Debug)]
pub struct Stream<T> {
    there: Channel,
    back: Channel,
    buffer: u64,
    events: DelayLine<Event>,
    // What was written: where it ends, and what it is.
    messages: VecDeque<(u64, T)>,
    written: u64,
    sent: u64,
    acknowledged: u64,
    flight: VecDeque<Segment>,
    window: f64,
    threshold: f64,
    recover: u64,
    /// The window grows again from one segment, before everything up to `recover` has come.
    after_time_out: bool,
    round_trip: Option<(f64, f64)>,
    backoff: i32,
    probed: bool,
    timer: Option<Time<TrueTime>>,
    // The receiver.
    received: Vec<Range>,
    delivered: u64,
    ready: Vec<(Time<TrueTime>, T)>,
    dropped: u64,
}

impl<T: Clone> Stream<T> {
    /// A stream that has just been opened, with the channel that carries it and the one back.
    pub fn new(config: &RadioConfig, there: Channel, back: Channel) -> Stream<T> {
        Stream {
            there,
            back,
            buffer: u64::from(config.stream_buffer_bytes),
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
            backoff: 0,
            probed: false,
            timer: None,
            received: Vec::new(),
            delivered: 0,
            ready: Vec::new(),
            dropped: 0,
        }
    }
    /// The same channels with a stream that has just been opened: what was under way is lost.
    pub fn reopen(&mut self, config: &RadioConfig) {
        let fresh = Stream::new(config, self.there.clone(), self.back.clone());
        let dropped = self.dropped + self.messages.len() as u64;
        *self = Stream { dropped, ..fresh };
    }
    /// Both channels.
    pub fn channels(&mut self) -> [&mut Channel; 2] {
        [&mut self.there, &mut self.back]
    }
    /// Messages that did not fit into the buffer or were lost with the connection.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Writes a message of `bytes` at `t`.
    pub fn send(&mut self, t: Time<TrueTime>, bytes: usize, message: T) {
        self.advance(t);
        if self.written - self.acknowledged + bytes as u64 > self.buffer {
            self.dropped += 1;
            return;
        }
        self.written += bytes as u64;
        self.messages.push_back((self.written, message));
        self.transmit(t);
    }
    /// The messages that have been delivered by `t`, in order, with the times of their arrival.
    pub fn receive(&mut self, t: Time<TrueTime>) -> Vec<(Time<TrueTime>, T)> {
        self.advance(t);
        core::mem::take(&mut self.ready)
    }

    fn advance(&mut self, t: Time<TrueTime>) {
        loop {
            let (event, timer) = (self.events.next(), self.timer);
            let timer_first = timer.is_some_and(|at| event.is_none_or(|e| at <= e));
            if timer_first {
                let Some(at) = timer.filter(|at| *at <= t) else {
                    return;
                };
                self.time_out(at);
            } else {
                match self.events.pop(t) {
                    Some((at, Event::Data(range, sent_at))) => self.data(at, range, sent_at),
                    Some((at, Event::Ack(first, ranges, sent_at))) => self.ack(at, first, &ranges, sent_at),
                    None => return,
                }
            }
        }
    }

    fn under_way(&self) -> f64 {
        self.flight.iter().filter(|s| !s.arrived && !s.lost).count() as f64
    }
    fn put(&mut self, t: Time<TrueTime>, range: Range) {
        let bytes = (range.1 - range.0) as usize + HEADERS;
        for at in self.there.send(t, bytes).into_iter().flatten() {
            // A line that is full is a link that is: the segment is lost.
            let _lost = self.events.push(at, Event::Data(range, t));
        }
    }
    /// Sends what the window allows: first again what was lost, then what is new.
    fn transmit(&mut self, t: Time<TrueTime>) {
        while self.under_way() < self.window.floor().max(1.0) {
            if let Some(segment) = self.flight.iter_mut().find(|s| s.lost) {
                (segment.lost, segment.sent_at) = (false, t);
                let range = segment.range;
                self.put(t, range);
            } else if self.sent < self.written {
                let range = (self.sent, self.written.min(self.sent + SEGMENT));
                self.sent = range.1;
                self.flight.push_back(Segment {
                    range,
                    sent_at: t,
                    arrived: false,
                    lost: false,
                });
                self.put(t, range);
            } else {
                break;
            }
        }
        if self.timer.is_none() {
            self.set_timer(t);
        }
    }

    fn data(&mut self, t: Time<TrueTime>, range: Range, sent_at: Time<TrueTime>) {
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
        // The range that has just come is named first.
        let mut ranges = vec![range];
        ranges.extend(self.received.iter().rev().take(RANGES - 1));
        for at in self.back.send(t, HEADERS + 12).into_iter().flatten() {
            let _lost = self
                .events
                .push(at, Event::Ack(self.delivered, ranges.clone(), sent_at));
        }
    }

    fn ack(&mut self, t: Time<TrueTime>, first: u64, ranges: &[Range], sent_at: Time<TrueTime>) {
        let sample = (t - sent_at).secs();
        let (mean, spread) = match self.round_trip {
            None => (sample, 0.5 * sample),
            Some((mean, spread)) => (
                mean + (sample - mean) / 8.0,
                spread + ((sample - mean).abs() - spread) / 4.0,
            ),
        };
        self.round_trip = Some((mean, spread));
        let limited = self.under_way() >= self.window.floor();
        let open = |flight: &VecDeque<Segment>| flight.iter().filter(|s| !s.arrived).count();
        let before = open(&self.flight);
        let progress = first > self.acknowledged;
        self.acknowledged = self.acknowledged.max(first);
        for segment in &mut self.flight {
            let inside = |r: &Range| r.0 <= segment.range.0 && segment.range.1 <= r.1;
            if ranges.iter().any(inside) {
                (segment.arrived, segment.lost) = (true, false);
            }
        }
        self.flight.retain(|s| s.range.1 > first);
        // What was sent a quarter of a round trip before something that came is lost.
        let margin = Span::from_secs(mean / 4.0);
        let mut loss = false;
        for segment in self.flight.iter_mut().filter(|s| !s.arrived && !s.lost) {
            if segment.sent_at + margin < sent_at {
                segment.lost = true;
                loss = true;
            }
        }
        if loss && self.acknowledged >= self.recover {
            self.threshold = (0.7 * self.window).max(2.0);
            self.window = self.threshold;
            self.recover = self.sent;
        } else if limited && (self.after_time_out || self.acknowledged >= self.recover) {
            let gained = before.saturating_sub(open(&self.flight)) as f64;
            self.window += if self.window < self.threshold {
                gained
            } else {
                gained / self.window
            };
        }
        self.after_time_out &= self.acknowledged < self.recover;
        if progress {
            (self.backoff, self.probed) = (0, false);
        }
        self.set_timer(t);
        self.transmit(t);
    }

    fn set_timer(&mut self, t: Time<TrueTime>) {
        if self.flight.is_empty() {
            self.timer = None;
            return;
        }
        let (mean, spread) = self.round_trip.unwrap_or((0.5, 0.125));
        let wait_s = if self.probed || self.backoff > 0 {
            let timeout = (mean + 4.0 * spread).max(mean + SHORTEST_TIMEOUT_S);
            (timeout * 2f64.powi(self.backoff)).min(LONGEST_TIMEOUT_S)
        } else {
            2.0 * mean
        };
        self.timer = Some(t + Span::from_secs(wait_s));
    }
    fn time_out(&mut self, t: Time<TrueTime>) {
        if !self.probed && self.backoff == 0 {
            // A probe: the last one again, so that its acknowledgement shows the gaps.
            self.probed = true;
            if let Some(last) = self.flight.iter_mut().rev().find(|s| !s.arrived) {
                last.sent_at = t;
                let range = last.range;
                self.put(t, range);
            }
        } else {
            self.threshold = (0.7 * self.window).max(2.0);
            self.window = 1.0;
            self.recover = self.sent;
            self.after_time_out = true;
            self.backoff = (self.backoff + 1).min(10);
            for segment in self.flight.iter_mut().filter(|s| !s.arrived) {
                segment.lost = true;
            }
            self.transmit(t);
        }
        self.set_timer(t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::Direction;
    use crate::streams::Streams;

    fn run(config: &RadioConfig, seed: u64, n: usize, bytes: usize) -> (Vec<(usize, f64)>, u64) {
        let streams = Streams::new(seed);
        let there = Channel::new(config, Direction::ToDrone, &streams);
        let back = Channel::back(config, Direction::ToDrone, &streams);
        let mut stream = Stream::new(config, there, back);
        let mut got = Vec::new();
        for k in 0..n + 2000 {
            let t = Time::from_secs(k as f64 * 0.02);
            if k < n {
                stream.send(t, bytes, k);
            }
            for (at, m) in stream.receive(t) {
                got.push((m, at.secs() - m as f64 * 0.02));
            }
        }
        (got, stream.dropped())
    }
    fn config(loss: f64) -> RadioConfig {
        RadioConfig {
            loss,
            duplicate: 0.0,
            delay_sd_s: 0.0,
            ..RadioConfig::default()
        }
    }
    fn quantile(got: &[(usize, f64)], q: f64) -> f64 {
        let mut v: Vec<f64> = got.iter().map(|g| g.1).collect();
        v.sort_by(f64::total_cmp);
        v[((v.len() - 1) as f64 * q) as usize]
    }

    #[test]
    fn without_loss_a_message_takes_the_delay() {
        let (got, dropped) = run(&config(0.0), 1, 500, 300);
        assert_eq!((got.len(), dropped), (500, 0));
        assert!(got.iter().all(|g| (g.1 - 0.05).abs() < 1e-6));
    }

    #[test]
    fn with_loss_everything_comes_once_in_order_and_later() {
        let (got, dropped) = run(&config(0.1), 2, 3000, 1024);
        assert_eq!(got.len() as u64 + dropped, 3000);
        assert!(got.windows(2).all(|w| w[0].0 < w[1].0), "out of order");
        // Measured over an emulated link at 10 % loss each way, 50 ms, 50 Hz, 1024 B: 80 ms and
        // 312 ms (reference); a tenth of the messages waits for a retransmission of its own.
        let (median, late) = (quantile(&got, 0.5), quantile(&got, 0.99));
        assert!((0.05..0.16).contains(&median), "{median}");
        assert!((0.15..0.9).contains(&late), "{late}");
    }

    #[test]
    fn the_buffer_bounds_what_waits_and_an_outage_ends_in_what_waited() {
        let config = RadioConfig {
            outages_s: vec![[5.0, 8.0]],
            stream_buffer_bytes: 6000,
            ..config(0.0)
        };
        let (got, dropped) = run(&config, 3, 1000, 300);
        assert!(dropped > 100 && got.len() as u64 + dropped == 1000, "{dropped}");
        let waited = got.iter().filter(|g| g.1 > 1.0).count();
        assert!((1..=20).contains(&waited), "{waited}");
    }
}

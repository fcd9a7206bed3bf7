//! Deltas of a Signal K server, one per line ([`delta`]), converted to measurements by [`SensorBus`].
//!
//! An update has the time of its arrival at the server, or of the receiver's sentence, so each kind of
//! measurement has its own clock. Related values are matched by arrival; in a recording, by these times. A
//! repeated time (the server truncates GGA's to seconds) is replaced by the arrival, unless the update was
//! delayed.

mod delta;

use alight_shared::{
    estimation::{JITTER_S, SourceClock},
    lines::LineBuffer,
    time::{Span, Time, VesselClock},
};

use super::{
    Decoded, Measurement, Mounting, Remark, SensorDecoder, SourceMeasurement,
    bus::{Content, PAIR_NS, SensorBus, is_near},
    clock::utc_ns,
    nmea::account::{Account, Why},
};
use crate::node::KINDS;
use delta::{DeltaMessage, DeltaUpdate};

/// Maximum message length, bytes.
pub const MAX_MESSAGE: usize = 256 << 10;
/// Maximum number of sources distinguished; the rest count as one.
const MAX_SOURCES: usize = 64;

/// Difference between times of different clocks, ns, and number of consecutive times after which the clock is changed.
const OTHER_CLOCK_NS: i64 = 3_600_000_000_000;
const MAX_OTHERS: u8 = 10;
/// Age of an update that was delayed, s: a stamp that is truncated to whole seconds is up to one second early.
const LATE_S: f64 = 1.0 + JITTER_S;
/// Period of a receiver's week number, 1024 weeks, s.
const ROLLOVER_S: f64 = 1024.0 * 7.0 * 86_400.0;

/// Time of an update.
#[derive(Clone, Copy, Debug)]
struct When {
    /// Time for comparison with other updates, ns.
    at_ns: i64,
    /// Time stamp on its own clock, ns.
    stamp_ns: Option<i64>,
}

#[derive(Clone, Debug)]
pub struct SignalKDecoder {
    lines: LineBuffer,
    decoded: Decoded,
    account: Account,
    bus: SensorBus,
    /// Arrival time of the pushed bytes, ns; None in a recording.
    now_ns: Option<i64>,
    own: Option<String>,
    sources: Vec<String>,
    /// Groups and sources since the server's greeting; None before it.
    begun: Option<Vec<(usize, u32)>>,
    /// Newest speed over ground, m/s, its source, and its time, ns.
    speed: Option<(f64, u32, i64)>,
    /// Newest time of each kind, ns.
    newest_ns: [Option<i64>; KINDS.len()],
    /// Newest time of each kind on the clock in use, and consecutive times of another clock.
    clocks: [Option<(i64, u8)>; KINDS.len()],
    /// A source with two clocks, and their difference, s.
    two_clocks: Option<(u32, f64)>,
    /// Clocks of the time stamps, by which an update is late.
    stamps: [SourceClock<VesselClock>; KINDS.len()],
    /// Measurements dated by arrival, at most one per kind.
    timeless: Vec<Measurement>,
}

impl SignalKDecoder {
    pub fn new(mounting: &Mounting) -> Self {
        let mut bus = SensorBus::new(mounting);
        bus.name(MAX_SOURCES as u32, ["others", ""]);
        SignalKDecoder {
            lines: LineBuffer::new(MAX_MESSAGE),
            decoded: Decoded::default(),
            account: Account::default(),
            bus,
            now_ns: None,
            own: None,
            sources: Vec::new(),
            begun: None,
            speed: None,
            newest_ns: [None; KINDS.len()],
            clocks: [None; KINDS.len()],
            two_clocks: None,
            stamps: Default::default(),
            timeless: Vec::new(),
        }
    }

    fn take(&mut self, line: &[u8], out: &mut Vec<SourceMeasurement>) {
        // The message may follow a logger's prefix.
        let begin = line.iter().position(|b| *b == b'{').unwrap_or_default();
        let json = line.get(begin..).unwrap_or_default();
        let Ok(message) = serde_json::from_slice::<DeltaMessage>(json) else {
            self.decoded.corrupted += 1;
            return;
        };
        if let Some(own) = message.own {
            let own = own.strip_prefix("vessels.").unwrap_or(&own);
            (self.own, self.begun) = (Some(own.into()), Some(Vec::new()));
        }
        let is_own = self.is_own(message.context.as_deref());
        for update in &message.updates {
            let Some(update) = DeltaUpdate::read(update) else {
                self.decoded.corrupted += 1;
                continue;
            };
            for value in &update.values {
                let name = value.path.rsplit('.').next().unwrap_or_default();
                let published = value.path.strip_prefix("notifications.").unwrap_or(&value.path);
                if published.starts_with("alight.") {
                    // The server echoes the values that this vessel's own process publishes.
                } else if !is_own {
                    self.ignore("AIS");
                } else if !delta::is_read(&value.path) {
                    self.ignore(name);
                } else if value.is_missing() {
                    self.decoded.good += 1;
                    self.left_out(name, Why::Empty);
                }
            }
            if is_own {
                self.update(&update, out);
            }
        }
    }
    fn ignore(&mut self, name: &str) {
        self.decoded.ignored += 1;
        self.account.leave_out(name, Why::NotRead);
    }
    fn is_own(&self, context: Option<&str>) -> bool {
        let Some(context) = context else { return true };
        let vessel = context.strip_prefix("vessels.");
        vessel.is_some_and(|v| v == "self" || self.own.as_deref() == Some(v))
    }
    fn number(&mut self, source: &str) -> u32 {
        let known = self.sources.iter().position(|s| s == source);
        let number = known.unwrap_or(self.sources.len());
        if known.is_none() && number < MAX_SOURCES {
            self.sources.push(source.into());
            self.bus.name(number as u32, [source, ""]);
        }
        number as u32
    }

    fn update(&mut self, update: &DeltaUpdate, out: &mut Vec<SourceMeasurement>) {
        let source = self.number(&update.source());
        let stamp_ns = update.timestamp.as_deref().and_then(utc_ns);
        let mut contents = update.contents();
        let Some(at_ns) = self.now_ns.or(stamp_ns) else {
            self.decoded.good += contents.len() as u64;
            self.decoded.undated += contents.len() as u64;
            return;
        };
        // The velocity belongs to the position that follows.
        let velocity = self.velocity(update, source, at_ns);
        drop(contents.splice(0..0, velocity.map(|v| ("velocity", v))));
        for (name, content) in contents {
            self.decoded.good += 1;
            if self.is_cached(content.group(), source) {
                self.left_out(name, Why::Cached);
                continue;
            }
            self.content(name, source, When { at_ns, stamp_ns }, content, out);
        }
    }
    fn content(
        &mut self,
        name: &str,
        source: u32,
        when: When,
        content: Content,
        out: &mut Vec<SourceMeasurement>,
    ) {
        let m = match self.bus.take(source, when.at_ns, content) {
            Ok(Some(m)) => m,
            Ok(None) => return,
            Err(why) => return self.left_out(name, why),
        };
        if when
            .stamp_ns
            .is_some_and(|s| self.is_of_other_clock(m.kind(), source, s))
        {
            return match self.now_ns {
                Some(_) => self.by_arrival(name, m),
                None => self.left_out(name, Why::OtherClock),
            };
        }
        let newest = self.newest_ns.get_mut(m.kind());
        let repeated = newest.is_some_and(|n| core::mem::replace(n, when.stamp_ns) == when.stamp_ns);
        let late = match (self.now_ns, when.stamp_ns, self.stamps.get_mut(m.kind())) {
            (Some(now_ns), Some(stamp_ns), Some(clock)) => {
                let now = Time::from_nanos(now_ns);
                let at = clock.local_time(now, stamp_ns, Span::ZERO);
                at.is_none_or(|at| (now - at).secs() > LATE_S)
            }
            _ => false,
        };
        match when.stamp_ns.filter(|_| !repeated) {
            Some(stamp_ns) => out.push(SourceMeasurement::new(stamp_ns, m)),
            None if late => self.left_out(name, Why::HeldUp),
            None if self.now_ns.is_some() => self.by_arrival(name, m),
            None => self.decoded.undated += 1,
        }
    }
    /// Whether a time is from another clock than others of its kind, such as a receiver's date among the server's.
    fn is_of_other_clock(&mut self, kind: usize, source: u32, stamp_ns: i64) -> bool {
        let Some(clock) = self.clocks.get_mut(kind) else {
            return false;
        };
        let (newest_ns, others) = clock.get_or_insert((stamp_ns, 0));
        let apart_ns = stamp_ns.saturating_sub(*newest_ns);
        if apart_ns.saturating_abs() <= OTHER_CLOCK_NS || *others >= MAX_OTHERS {
            *clock = Some((stamp_ns, 0));
            return false;
        }
        *others += 1;
        self.two_clocks = Some((source, apart_ns.saturating_abs() as f64 * 1e-9));
        true
    }
    /// Dates a measurement by arrival. If several of one kind arrive at once, only the newest is kept; the
    /// others count as delayed.
    fn by_arrival(&mut self, name: &str, m: Measurement) {
        match self.timeless.iter_mut().find(|of| of.kind() == m.kind()) {
            Some(older) => {
                *older = m;
                self.left_out(name, Why::HeldUp);
            }
            None => {
                self.decoded.by_arrival += 1;
                self.timeless.push(m);
            }
        }
    }
    fn left_out(&mut self, name: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
    }
    /// Whether this is a cached value: after its greeting, a server sends the last value of each path.
    fn is_cached(&mut self, group: usize, source: u32) -> bool {
        let key = (group, source);
        let begun = self.begun.as_mut().filter(|b| !b.contains(&key));
        begun.map(|b| b.push(key)).is_some()
    }
    /// Velocity of an update; the speed may be in the previous update.
    fn velocity(&mut self, update: &DeltaUpdate, source: u32, at_ns: i64) -> Option<Content> {
        let (speed, course) = update.over_ground();
        if let Some(speed) = speed {
            self.speed = Some((speed, source, at_ns));
            return Content::velocity(speed, course);
        }
        let (speed, of, then_ns) = self.speed?;
        let is_its = of == source && is_near(at_ns, then_ns, PAIR_NS);
        Content::velocity(speed, Some(course.filter(|_| is_its)?))
    }
}

impl SensorDecoder for SignalKDecoder {
    fn arrive(&mut self, now: Time<VesselClock>) {
        self.now_ns = Some(now.nanos());
    }
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for line in self.lines.whole(bytes, &mut self.decoded.corrupted) {
            self.take(&line, out);
        }
    }
    fn finish(&mut self, out: &mut Vec<SourceMeasurement>) {
        // A file's last line may lack its terminator.
        if let Some(line) = self.lines.last(&mut self.decoded.corrupted) {
            self.take(&line, out);
        }
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
    fn timeless(&mut self) -> Vec<Measurement> {
        core::mem::take(&mut self.timeless)
    }
    fn has_clocks_by_kind(&self) -> bool {
        true
    }
    fn remarks(&self) -> Vec<Remark> {
        let mut all = self.bus.remarks(&self.account);
        if let Some((source, apart_s)) = self.two_clocks {
            let name = self.sources.get(source as usize).map_or("others", String::as_str);
            let rollovers = apart_s / ROLLOVER_S;
            let apart = match (rollovers.round(), (rollovers - rollovers.round()).abs() < 1e-3) {
                (n, true) if n >= 1.0 => {
                    format!("{:.0} weeks apart (its week number has rolled over)", 1024.0 * n)
                }
                _ => format!("{apart_s:.0} s apart"),
            };
            all.push(Remark::fault(
                format!("{name}: two clocks, {apart}: the times of one of them are not used"),
                "let the server date its values, or renew the receiver",
            ));
        }
        all
    }
}

#[cfg(test)]
mod tests;

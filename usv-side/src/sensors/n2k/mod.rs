//! NMEA 2000 as text of a gateway or logger ([`line`]), converted to measurements by [`SensorBus`].
//!
//! The bus has no common clock, so the time of a message is that of its line, or its arrival.

mod line;
mod pgn;

use alight_shared::{
    estimation::Rollover,
    lines::LineBuffer,
    time::{Time, VesselClock},
};

use super::{
    Decoded, Measurement, Mounting, Remark, SensorDecoder, SourceMeasurement,
    bus::{SensorBus, name_text},
    clock::DAY_NS,
    config::MAX_ADDRESS,
    nmea::account::{Account, JSON, Why},
};
use line::{MAX_MESSAGE, N2kLine, N2kStamp};

/// Longest line, bytes: a message in canboat's plain format.
const MAX_LINE: usize = 800;
/// Start of a binary frame of Actisense's gateways: DLE, STX, message received from the bus.
pub(crate) const ACTISENSE: [u8; 3] = [0x10, 0x02, 0x93];
const BINARY: &str = "set the gateway to RAW or N2K ASCII, or put canboat's actisense-serial before it";
/// Maximum number of incomplete multi-frame messages.
const OPEN: usize = 8;

/// Incomplete multi-frame message.
#[derive(Clone, Debug)]
struct Open {
    source: u8,
    pgn: u32,
    sequence: u8,
    next: u8,
    length: usize,
    data: Vec<u8>,
}

#[derive(Clone, Debug)]
pub struct N2kDecoder {
    lines: LineBuffer,
    decoded: Decoded,
    account: Account,
    day: Rollover<DAY_NS>,
    /// Arrival time of the pushed bytes, ns; None in a recording.
    now_ns: Option<i64>,
    open: Vec<Open>,
    /// Newest time since the start of a recording, ns.
    relative: Option<i64>,
    bus: SensorBus,
    timeless: Vec<Measurement>,
}

/// Whether a text is a line of NMEA 2000.
pub(super) fn is_line(text: &str) -> bool {
    N2kLine::parse(text).is_some()
}

impl N2kDecoder {
    pub fn new(mounting: &Mounting) -> Self {
        N2kDecoder {
            lines: LineBuffer::new(MAX_LINE),
            decoded: Decoded::default(),
            account: Account::default(),
            day: Rollover::default(),
            now_ns: None,
            open: Vec::with_capacity(OPEN),
            relative: None,
            bus: SensorBus::new(mounting),
            timeless: Vec::new(),
        }
    }

    fn take(&mut self, text: &[u8], out: &mut Vec<SourceMeasurement>) {
        let parsed = core::str::from_utf8(text).ok().and_then(N2kLine::parse);
        let Some(line) = parsed else {
            if text.trim_ascii_start().starts_with(b"{") {
                self.account.leave_out("canboat-JSON", Why::Foreign(JSON));
            } else if text.windows(ACTISENSE.len()).any(|w| w == ACTISENSE) {
                self.account.leave_out("Actisense-binary", Why::Foreign(BINARY));
            }
            self.decoded.corrupted += 1;
            return;
        };
        let Some((name, is_long)) = pgn::used(line.pgn) else {
            self.decoded.ignored += 1;
            self.account.leave_out(&line.pgn.to_string(), Why::NotRead);
            return;
        };
        let (at_ns, is_stamped) = match line.at {
            N2kStamp::OfDay(of_day) => (self.day.unwrap(of_day), true),
            N2kStamp::Unix(at) => (at, true),
            // In a recording, times since its start are used; times since the previous line may decrease.
            N2kStamp::Relative(at)
                if self.now_ns.is_none() && self.relative.is_none_or(|last| at >= last) =>
            {
                self.relative = Some(at);
                (at, true)
            }
            N2kStamp::Relative(_) | N2kStamp::None => {
                self.relative = self.relative.map(|_| i64::MAX);
                (self.now_ns.unwrap_or_default(), false)
            }
        };
        let (pgn, source) = (line.pgn, line.source);
        let data = if is_long && !line.whole {
            match self.assemble(line) {
                Some(whole) => whole,
                None => return,
            }
        } else {
            line.data
        };
        self.decoded.good += 1;
        if pgn == pgn::ADDRESS_CLAIM {
            return self.claim(source, &data);
        }
        let content = pgn::read(pgn, &data).ok_or(match pgn::is_error(pgn, &data) {
            true => Why::Invalid,
            false => Why::Empty,
        });
        match content.and_then(|c| self.bus.take(source.into(), at_ns, c)) {
            Ok(Some(m)) if is_stamped => out.push(SourceMeasurement::new(at_ns, m)),
            Ok(Some(m)) if self.now_ns.is_some() => {
                self.decoded.by_arrival += 1;
                self.timeless.push(m);
            }
            Ok(Some(_)) => self.decoded.undated += 1,
            Ok(None) => self.account.stamp(name, at_ns),
            Err(why) => self.left_out(name, why),
        }
    }
    fn claim(&mut self, source: u8, data: &[u8]) {
        match pgn::claimed(data).filter(|_| source <= MAX_ADDRESS) {
            Some(name) => {
                let names = [source.to_string(), name_text(name)];
                self.bus.name(source.into(), [&names[0], &names[1]]);
            }
            // The device found no free address.
            None => self.left_out("60928", Why::Empty),
        }
    }
    fn left_out(&mut self, name: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(name, why);
    }
    /// Message completed by this frame. Its frames share a sequence number, with indices from 0; the first
    /// states the length.
    fn assemble(&mut self, line: N2kLine) -> Option<Vec<u8>> {
        let (head, data) = line.data.split_first()?;
        let (sequence, index) = (head >> 5, head & 0x1f);
        let is_it = |o: &Open| (o.source, o.pgn) == (line.source, line.pgn);
        if index == 0 {
            let (length, first) = data.split_first()?;
            self.open.retain(|o| !is_it(o));
            if self.open.len() >= OPEN {
                self.open.remove(0);
            }
            self.open.push(Open {
                source: line.source,
                pgn: line.pgn,
                sequence,
                next: 1,
                length: usize::from(*length).min(MAX_MESSAGE),
                data: first.to_vec(),
            });
        } else {
            let open = self.open.iter_mut().find(|o| is_it(o))?;
            if (open.sequence, open.next) != (sequence, index) {
                // A frame is missing.
                self.decoded.corrupted += 1;
                self.open.retain(|o| !is_it(o));
                return None;
            }
            open.next += 1;
            open.data.extend_from_slice(data);
        }
        let k = self
            .open
            .iter()
            .position(|o| is_it(o) && o.data.len() >= o.length)?;
        let mut whole = self.open.remove(k);
        whole.data.truncate(whole.length);
        Some(whole.data)
    }
}

impl SensorDecoder for N2kDecoder {
    fn arrive(&mut self, now: Time<VesselClock>) {
        self.now_ns = Some(now.nanos());
    }
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for line in self.lines.whole(bytes, &mut self.decoded.corrupted) {
            self.take(&line, out);
        }
    }
    fn finish(&mut self, out: &mut Vec<SourceMeasurement>) {
        // A file's last line may lack its terminator; a truncated message lacks a field or a frame.
        if let Some(line) = self.lines.last(&mut self.decoded.corrupted) {
            self.take(&line, out);
        }
        self.decoded.corrupted += self.open.drain(..).len() as u64;
    }
    fn decoded(&self) -> Decoded {
        self.decoded
    }
    fn timeless(&mut self) -> Vec<Measurement> {
        core::mem::take(&mut self.timeless)
    }
    fn remarks(&self) -> Vec<Remark> {
        self.bus.remarks(&self.account)
    }
}

#[cfg(test)]
mod tests;

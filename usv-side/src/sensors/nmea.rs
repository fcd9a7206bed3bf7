//! NMEA 0183: decodes GGA, GNS, RMC, GLL, VTG, HDT, THS, HDG, HDM, ROT, XDR, HPR, PASHR, PRDID, PSXN, PTNL,AVR, PTNTHPR
//! and ZDA, and the NMEA 2000 carried by PCDIN, MXPGN and PDGY ([`carried`]).
//!
//! A sentence with a time opens an epoch. Sentences without one belong to that epoch or the next, depending on the pauses
//! between arrivals ([`attribution`]). An epoch has one sentence of each kind; a second one is counted and dropped. If
//! several sentences of a kind arrive per time stamp, or there are no time stamps, the arrival is the time. In a recording,
//! without arrivals, attitudes are spread evenly up to the next time. Position and velocity of an epoch form one fix,
//! heading and rate of turn one heading. A rarer part is awaited only in the epochs that should have it ([`partner`]).

pub(super) mod account;
mod attribution;
mod carried;
mod devices;
pub(super) mod foreign;
pub(super) mod partner;
pub(super) mod sentences;
mod shape;

use alight_shared::{
    estimation::Rollover,
    geodesy::Datum,
    lines::{Cut, LineBuffer},
    msg::{AttitudeFix, GnssFix, HeadingFix, NOT_MEASURED_SD},
    time::{Time, VesselClock},
};
use nmea_kit::{NmeaFrame, nmea::NmeaSentence, parse_frame};

use super::{
    Decoded, Measurement, Mounting, Remark, SensorDecoder, SourceMeasurement,
    bus::{Devices, HEADINGS, PLACES, TILTS, TURNS, Variations},
    clock::{DAY_NS, time_of_day_ns},
    heights::EllipsoidHeights,
};
use account::{Account, Why};
use attribution::Attribution;
use carried::{Carried, CarriedMessage};
use foreign::UbxSkip;
use partner::Partner;

/// Maximum line length, bytes (82 in the standard, more in proprietary sentences).
const MAX_LINE: usize = 512;
/// Number of magnetic headings ignored after a true heading: 2 s at 25 Hz.
const MAX_SPARE: u8 = 50;
/// Number of sentences without a checksum after which a stream is taken to have none (before version 2 of the standard).
const UNCHECKED_STREAM: u32 = 10;
/// Maximum time over which attitudes of a recording are spread, ns.
const MAX_SPREAD_NS: i64 = 2_000_000_000;
/// Maximum number of attitudes that are spread.
const MAX_SPREAD: usize = 1000;
/// Maximum age of a rate of turn that has its own time, ns.
const RATE_AGE_NS: i64 = 200_000_000;

#[derive(Clone, Debug)]
pub struct NmeaDecoder {
    mounting: Mounting,
    lines: LineBuffer,
    /// Sentences without a checksum since the start; None once one had a checksum.
    unchecked: Option<u32>,
    decoded: Decoded,
    account: Account,
    heights: EllipsoidHeights,
    day: Rollover<DAY_NS>,
    epoch: Option<Epoch>,
    attribution: Attribution,
    /// Sentences that precede their time.
    waiting: Vec<Untimed>,
    /// Attitudes of a recording after the first one of their epoch.
    spread: Vec<([f64; 2], Option<f64>)>,
    /// Measurements whose time is their arrival.
    timeless: Vec<Measurement>,
    /// Newest rate of turn that has its own time, rad/s, and its arrival time.
    own_rate: Option<(f64, i64)>,
    variation: Variations,
    /// Talkers and proprietary sentences, which are the devices of a stream, numbered by index.
    devices: Devices,
    talkers: Vec<String>,
    /// First half of an attitude in XDR: roll or pitch, rad, and the device that sent it.
    half_tilt: [Option<f64>; 2],
    half_of: Option<u32>,
    /// Clock in use: sentence that sets it, its newest time, ns, and its majority over another clock.
    clock: Option<(String, i64, u8)>,
    /// Remaining bytes of a UBX message.
    ubx: UbxSkip,
    /// Parts that complete an epoch: the velocity of a position, the rate of a heading, and the height of a position.
    velocity: Partner,
    rate: Partner,
    height: Partner,
    /// GSA states a two-dimensional fix.
    is_flat: bool,
    /// No epoch is complete yet, so it is unknown whether epochs have a better position.
    is_first: bool,
    /// Number of magnetic headings since the last true heading.
    without_true: u8,
    /// Heading, and roll and pitch, marked invalid by Seatex's sensor in separate sentences (PSXN,20).
    seatex_invalid: [bool; 2],
    carried: Carried,
}

#[derive(Clone, Copy, Debug)]
struct Position {
    datum: Datum,
    sd: [f64; 3],
    height_spread: f64,
}

impl Position {
    fn has_height(&self) -> bool {
        self.sd[2] < NOT_MEASURED_SD
    }
}

#[derive(Clone, Debug, Default)]
struct Epoch {
    at_ns: i64,
    position: Option<Position>,
    velocity: Option<[f64; 2]>,
    heading: Option<(f64, f64)>,
    rate: Option<f64>,
    /// The receiver marks the position as invalid.
    rejected: bool,
    /// The sentence with heights has arrived, even if empty.
    levelled: bool,
    fixed: bool,
    headed: bool,
    tilted: bool,
}

#[derive(Clone, Copy, Debug)]
enum Untimed {
    Velocity([f64; 2]),
    /// Heading and its standard deviation, rad.
    Heading(f64, f64),
    Rate(f64),
    /// Roll and pitch, heading if available, rad; heave as sent, m.
    Tilt([f64; 2], Option<f64>, Option<f64>),
}

impl Untimed {
    /// Kind index in [`Attribution`].
    const fn kind(&self) -> usize {
        match self {
            Untimed::Velocity(_) => 0,
            Untimed::Heading(..) => 1,
            Untimed::Rate(_) => 2,
            Untimed::Tilt(..) => 3,
        }
    }
}

impl NmeaDecoder {
    pub fn new(mounting: &Mounting) -> Self {
        NmeaDecoder {
            mounting: mounting.clone(),
            lines: LineBuffer::new(MAX_LINE),
            unchecked: Some(0),
            decoded: Decoded::default(),
            account: Account::default(),
            heights: EllipsoidHeights::default(),
            day: Rollover::default(),
            epoch: None,
            attribution: Attribution::new(mounting.mount.untimed_lead),
            waiting: Vec::new(),
            spread: Vec::new(),
            timeless: Vec::new(),
            own_rate: None,
            variation: Variations::default(),
            devices: Devices::new(mounting).merged(),
            talkers: Vec::new(),
            half_tilt: [None; 2],
            half_of: None,
            clock: None,
            ubx: UbxSkip::default(),
            velocity: Partner::default(),
            rate: Partner::default(),
            height: Partner::default(),
            is_flat: false,
            is_first: true,
            without_true: MAX_SPARE,
            seatex_invalid: [false; 2],
            carried: Carried::new(mounting),
        }
    }
    /// Decoder for a recording without times: the gateway's counter dates the NMEA 2000 messages.
    pub(crate) fn by_counter(mut self) -> Self {
        self.carried.by_counter();
        self
    }
    /// Statistics of the sentences; one that carries NMEA 2000 counts as good.
    pub(crate) fn sentences(&self) -> Decoded {
        Decoded {
            good: self.decoded.good + self.carried.sentences,
            ..self.decoded
        }
    }
    /// Whether another format appeared among the sentences.
    pub(super) fn is_foreign(&self) -> bool {
        self.account.has_foreign()
    }
    /// Remarks on the NMEA 2000 messages in the sentences.
    pub(crate) fn carried_remarks(&self) -> Vec<Remark> {
        self.carried.remarks()
    }
    fn take(&mut self, line: &[u8], out: &mut Vec<SourceMeasurement>) {
        let Some(text) = core::str::from_utf8(line).ok().filter(|t| t.is_ascii()) else {
            self.decoded.corrupted += 1;
            return;
        };
        if let Some((name, why)) = foreign::line(text) {
            self.decoded.ignored += 1;
            self.account.leave_out(name, why);
            return;
        }
        if !text.contains(['$', '!', '*']) {
            self.decoded.ignored += 1;
            return;
        }
        // Prefix of a logger, or tags of IEC 61162-450.
        let sentence = text
            .find(['$', '!'])
            .and_then(|at| text.get(at..))
            .unwrap_or_default();
        // iKonvert's sentences have no checksum.
        if let Some(message) = sentence.strip_prefix("!PDGY,") {
            return self.carrier("PDGY", CarriedMessage::of_pdgy(message).map(Some));
        }
        if sentence.starts_with("$PDGY,") {
            return self.pass_over("PDGY");
        }
        let Some(frame) = self.frame(sentence) else {
            self.decoded.corrupted += 1;
            return;
        };
        self.sentence(&frame, out);
    }
    fn pass_over(&mut self, address: &str) {
        self.decoded.ignored += 1;
        self.account.leave_out(address, foreign::not_read(address));
    }
    /// Processes an NMEA 2000 message; inner None: its byte order is not known yet.
    fn carrier(&mut self, address: &str, message: Option<Option<CarriedMessage>>) {
        match message {
            None => self.decoded.corrupted += 1,
            Some(_) if self.carried.is_spare(address) => self.leave_out(address, Why::Spare),
            Some(None) => self.pass_over(address),
            Some(Some(message)) => self.carried.take(message, self.attribution.now_ns),
        }
    }
    /// Appends carried measurements after the sentence's own, which start at these indices.
    fn add_carried(&mut self, [dated, timeless]: [usize; 2], out: &mut Vec<SourceMeasurement>) {
        let own = out.iter().skip(dated).map(|m| m.measurement.kind());
        let own = own.chain(self.timeless.iter().skip(timeless).map(Measurement::kind));
        own.for_each(|kind| self.carried.own(kind));
        let is_live = self.attribution.now_ns.is_some();
        let (all, spare) = self.carried.measurements(is_live);
        (0..spare).for_each(|_| self.account.leave_out("NMEA-2000", Why::Spare));
        if is_live {
            self.timeless.extend(all.into_iter().map(|m| m.measurement));
        } else if !all.is_empty() {
            out.extend(all);
            if let Some(new) = out.get_mut(dated..) {
                new.sort_by_key(|m| m.at_ns);
            }
        }
    }
    /// Frame of a sentence with a valid checksum, or without any in a stream that has none.
    fn frame<'a>(&mut self, sentence: &'a str) -> Option<NmeaFrame<'a>> {
        if sentence.contains('*') {
            self.unchecked = None;
            return parse_frame(sentence).ok();
        }
        let count = self.unchecked.as_mut()?;
        *count = count.saturating_add(1);
        if *count < UNCHECKED_STREAM {
            return None;
        }
        let frame = parse_frame(sentence).ok().filter(shape::is_whole)?;
        self.account.unchecked += 1;
        Some(frame)
    }
    fn sentence(&mut self, frame: &NmeaFrame<'_>, out: &mut Vec<SourceMeasurement>) {
        let address = format!("{}{}", frame.talker, frame.sentence_type);
        let fields = &frame.fields;
        // Ashtech's other messages have a name in place of the time.
        let named = fields
            .first()
            .is_some_and(|f| f.starts_with(|c: char| c.is_ascii_alphabetic()));
        if frame.sentence_type == "PASHR" && named {
            return self.pass_over(&foreign::name(&address, fields));
        }
        if let Err(why) = shape::is_shifted(frame) {
            return self.leave_out(&address, why);
        }
        match NmeaSentence::parse(frame) {
            NmeaSentence::Gga(s) => self.gga(&address, &s, fields, out),
            NmeaSentence::Gns(s) => self.gns(&address, &s, fields, out),
            NmeaSentence::Rmc(s) => self.rmc(&address, &s, fields, out),
            NmeaSentence::Gll(s) => self.gll(&address, &s, fields, out),
            NmeaSentence::Vtg(s) => self.vtg(&address, &s, out),
            NmeaSentence::Hdt(s) => self.heading(&address, s.heading_true, Ok(()), out),
            NmeaSentence::Ths(s) => {
                self.heading(&address, s.heading_true, sentences::mode_of_ths(s.mode), out)
            }
            NmeaSentence::Hdg(s) => self.hdg(&address, &s, out),
            NmeaSentence::Hdm(s) => self.magnetic(&address, s.heading_mag, None, out),
            NmeaSentence::Rot(s) => self.rot(&address, &s, out),
            NmeaSentence::Xdr(s) => self.xdr(&address, &s, out),
            NmeaSentence::Pashr(s) => self.pashr(&address, &s, out),
            NmeaSentence::Prdid(s) => self.prdid(&address, &s, out),
            NmeaSentence::Zda(s) => {
                // The time opens an epoch; the date is not needed.
                let _epoch = self.open(&address, s.time.as_deref(), out);
            }
            _ => match frame.sentence_type {
                "PCDIN" => self.carrier(&address, CarriedMessage::of_pcdin(fields).map(Some)),
                "PGN" => {
                    let message = self.carried.of_mxpgn(fields);
                    self.carrier(&address, message);
                }
                "PSXN" if fields.first() == Some(&"20") => self.psxn_quality(fields),
                "PSXN" if fields.first() == Some(&"23") => self.psxn(&address, fields, out),
                "PTNL" if fields.first() == Some(&"AVR") => self.avr("PTNL-AVR", fields, out),
                "PTNTHPR" => self.ptnthpr(&address, fields, out),
                "HPR" => self.hpr(&address, fields, out),
                "GSA" => {
                    self.decoded.good += 1;
                    self.is_flat = fields.get(1) == Some(&"2");
                }
                _ => self.pass_over(&foreign::name(&address, fields)),
            },
        }
    }
    /// Counts a complete sentence of a supported kind that yields no measurement.
    fn leave_out(&mut self, address: &str, why: Why) {
        self.decoded.good += 1;
        self.left_out(address, why);
    }
    /// Marks a counted sentence as unused.
    fn left_out(&mut self, address: &str, why: Why) {
        self.decoded.left_out += 1;
        self.account.leave_out(address, why);
    }

    /// Epoch at a sentence's time; an invalid time is counted and gives None.
    fn open(
        &mut self,
        address: &str,
        time: Option<&str>,
        out: &mut Vec<SourceMeasurement>,
    ) -> Option<&mut Epoch> {
        let Some(time) = time.filter(|t| !t.is_empty()) else {
            // The receiver does not know the time yet.
            self.leave_out(address, Why::Empty);
            return None;
        };
        let Some(of_day) = time_of_day_ns(time) else {
            self.decoded.corrupted += 1;
            return None;
        };
        let at_ns = self.day.unwrap(of_day);
        if !self.is_of_clock(address, at_ns) {
            self.day.last = self.clock.as_ref().map(|(_, newest_ns, _)| *newest_ns);
            self.leave_out(address, Why::OtherClock);
            return None;
        }
        self.decoded.good += 1;
        self.account.stamp(address, at_ns);
        let is_new = self.epoch.as_ref().is_none_or(|e| e.at_ns != at_ns);
        self.attribution.timed(is_new);
        if is_new {
            self.close(Some(at_ns), out);
            self.epoch = Some(Epoch {
                at_ns,
                ..Epoch::default()
            });
            for untimed in core::mem::take(&mut self.waiting) {
                self.add(untimed, out);
            }
        }
        self.epoch.as_mut()
    }

    /// Dates a sentence without a time by arrival, adds it to its epoch, or keeps it for the next epoch.
    fn untimed(&mut self, untimed: Untimed, out: &mut Vec<SourceMeasurement>) {
        self.decoded.good += 1;
        let kind = untimed.kind();
        self.attribution.untimed(kind);
        if let Some(now_ns) = self.attribution.own_time(kind) {
            self.arrived(untimed, now_ns, out);
        } else if self.attribution.leads(kind) {
            // The newest sentence of a kind is nearest to the next time.
            let before = self.waiting.len();
            self.waiting.retain(|w| w.kind() != kind);
            self.decoded.undated += (before - self.waiting.len()) as u64;
            self.waiting.push(untimed);
        } else {
            self.add(untimed, out);
        }
    }
    /// Processes a sentence whose arrival is its time.
    fn arrived(&mut self, untimed: Untimed, now_ns: i64, out: &mut Vec<SourceMeasurement>) {
        let before = self.timeless.len();
        match untimed {
            // A velocity cannot be used without its position; one velocity is used per time.
            Untimed::Velocity(_) => return self.add(untimed, out),
            Untimed::Rate(rate) => self.own_rate = Some((rate, now_ns)),
            Untimed::Heading(heading, sd) => self.own_heading(now_ns, heading, sd),
            Untimed::Tilt(tilt, heading, heave) => {
                let fix = self.tilt(tilt, heave, self.mounting.tilt_sd());
                self.timeless.push(fix.into());
                if let Some(heading) = heading {
                    self.own_heading(now_ns, heading, self.mounting.heading_sd());
                }
            }
        }
        self.decoded.by_arrival += (self.timeless.len() - before) as u64;
    }
    /// Rate of turn that is dated by its arrival, if it is fresh, rad/s.
    fn own_rate(&self, now_ns: Option<i64>) -> Option<f64> {
        let (rate, at_ns) = self.own_rate?;
        (now_ns? - at_ns <= RATE_AGE_NS).then_some(rate)
    }
    fn own_heading(&mut self, now_ns: i64, heading: f64, heading_sd: f64) {
        let fix = HeadingFix {
            heading_sd,
            rate: self.own_rate(Some(now_ns)),
            ..self.mounting.heading_fix(self.mounting.heading(heading))
        };
        self.timeless.push(fix.into());
    }
    fn add(&mut self, untimed: Untimed, out: &mut Vec<SourceMeasurement>) {
        let is_recorded = self.attribution.now_ns.is_none();
        let Some(e) = self.epoch.as_mut() else {
            self.decoded.undated += 1;
            return;
        };
        let taken = match untimed {
            Untimed::Velocity(v) => e.velocity.replace(v).is_none(),
            Untimed::Heading(h, sd) => e.heading.replace((h, sd)).is_none(),
            Untimed::Rate(r) => e.rate.replace(r).is_none(),
            Untimed::Tilt(tilt, heading, heave) => {
                if !core::mem::replace(&mut e.tilted, true) {
                    let at_ns = e.at_ns;
                    if let Some(heading) = heading {
                        e.heading.get_or_insert((heading, self.mounting.heading_sd()));
                    }
                    let fix = self.tilt(tilt, heave, self.mounting.tilt_sd());
                    out.push(SourceMeasurement::new(at_ns, fix));
                    true
                } else if is_recorded && self.spread.len() < MAX_SPREAD {
                    self.spread.push((tilt, heave));
                    true
                } else {
                    false
                }
            }
        };
        self.decoded.undated += u64::from(!taken);
        self.emit(false, out);
    }

    /// Emits complete measurements, and at the end of the epoch also incomplete ones.
    fn emit(&mut self, last: bool, out: &mut Vec<SourceMeasurement>) {
        let own_rate = self.own_rate(self.attribution.now_ns);
        let Some(e) = self.epoch.as_mut() else { return };
        let at_ns = e.at_ns;
        let waits = |here: bool, partner: Partner| !here && !last && partner.is_due(at_ns);
        let is_first = self.is_first;
        if let Some(p) = e.position.as_mut().filter(|p| self.is_flat && p.has_height()) {
            // A held height is not measured.
            self.account.leave_out("height", Why::Flat);
            (p.datum.height_m, p.sd[2], p.height_spread) = (0.0, NOT_MEASURED_SD, 0.0);
        }
        // The first epoch may lack a better position, or the kind of its fix, until it ends.
        let is_whole = |p: &Position| !is_first || last && p.has_height();
        if let Some(p) = e.position.filter(|p| !e.fixed && is_whole(p))
            && !waits(e.velocity.is_some(), self.velocity)
            && !waits(p.has_height() || e.levelled, self.height)
        {
            e.fixed = true;
            if !p.has_height() {
                self.heights.none();
            }
            let [north, east] = e.velocity.unwrap_or_default();
            let velocity_sd = e.velocity.map_or(NOT_MEASURED_SD, |_| sentences::VELOCITY_SD);
            let velocity_sd = [velocity_sd, velocity_sd, NOT_MEASURED_SD];
            let fix = GnssFix {
                height_spread: p.height_spread,
                ..self.mounting.fix(p.datum, [north, east, 0.0], p.sd, velocity_sd)
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        }
        if let Some((heading, heading_sd)) = e.heading.filter(|_| !e.headed)
            && !waits(e.rate.is_some(), self.rate)
        {
            e.headed = true;
            let fix = HeadingFix {
                heading_sd,
                rate: e.rate.or(own_rate),
                ..self.mounting.heading_fix(self.mounting.heading(heading))
            };
            out.push(SourceMeasurement::new(at_ns, fix));
        }
    }
    /// Ends the epoch; `next_ns` is the time of the next one, if known.
    fn close(&mut self, next_ns: Option<i64>, out: &mut Vec<SourceMeasurement>) {
        self.emit(true, out);
        let at_ns = self.epoch.as_ref().map(|e| e.at_ns);
        self.carried.date(at_ns.zip(next_ns));
        let Some(e) = &self.epoch else { return };
        self.is_first = false;
        let at_ns = e.at_ns;
        if e.position.is_some() {
            self.velocity.end_epoch(at_ns, e.velocity.is_some());
        }
        if e.position.is_some() || e.levelled {
            self.height.end_epoch(at_ns, e.levelled);
        }
        if e.heading.is_some() {
            self.rate.end_epoch(at_ns, e.rate.is_some());
        }
        self.spread_evenly(at_ns, next_ns, out);
    }
    /// Dates a recorded epoch's attitudes evenly between its time and the next, except the first.
    fn spread_evenly(&mut self, at_ns: i64, next_ns: Option<i64>, out: &mut Vec<SourceMeasurement>) {
        let all = core::mem::take(&mut self.spread);
        let count = all.len() as i64 + 1;
        let whole = next_ns.map(|next| next.saturating_sub(at_ns));
        match whole.filter(|t| (1..=MAX_SPREAD_NS).contains(t)) {
            Some(whole) => {
                self.decoded.spread += all.len() as u64;
                for (k, (tilt, heave)) in (1..).zip(all) {
                    let fix = self.tilt(tilt, heave, self.mounting.tilt_sd());
                    out.push(SourceMeasurement::new(at_ns + whole / count * k, fix));
                }
            }
            None => self.decoded.undated += all.len() as u64,
        }
    }

    fn tilt(&self, [roll, pitch]: [f64; 2], heave: Option<f64>, tilt_sd: f64) -> AttitudeFix {
        let [roll, pitch, _] = self.mounting.attitude([roll, pitch, 0.0]);
        AttitudeFix {
            tilt_sd,
            heave: heave.and_then(|h| self.mounting.heave(h)),
            heave_sd: self.mounting.mount.heave_sd_m,
            ..self.mounting.tilt([roll, pitch])
        }
    }
}

impl SensorDecoder for NmeaDecoder {
    fn arrive(&mut self, now: Time<VesselClock>) {
        self.attribution.arrive(now.nanos());
    }
    fn push(&mut self, bytes: &[u8], out: &mut Vec<SourceMeasurement>) {
        for byte in bytes {
            if self.ubx.is_inside(*byte) {
                if self.ubx.begins() {
                    drop(self.lines.restart());
                    self.decoded.ignored += 1;
                    self.account.leave_out("UBX", Why::Foreign(foreign::UBX));
                }
                continue;
            }
            // After lost bytes, a sentence may start in the middle of a line.
            if *byte == b'$' {
                // A logger's prefix before a sentence is not damage.
                let dropped = self.lines.restart();
                self.decoded.corrupted += u64::from(dropped.starts_with(b"$"));
            }
            match self.lines.push(*byte) {
                Some(Cut::Line(line)) => {
                    let before = [out.len(), self.timeless.len()];
                    self.take(&line, out);
                    self.add_carried(before, out);
                }
                Some(Cut::Overlong) => self.decoded.corrupted += 1,
                None => {}
            }
        }
    }
    fn finish(&mut self, out: &mut Vec<SourceMeasurement>) {
        // A sentence without its terminator may be truncated.
        self.decoded.corrupted += u64::from(self.lines.end().is_some());
        // The last epoch is complete.
        self.close(None, out);
    }
    fn decoded(&self) -> Decoded {
        self.carried.decoded(&self.decoded)
    }
    fn timeless(&mut self) -> Vec<Measurement> {
        core::mem::take(&mut self.timeless)
    }
    fn remarks(&self) -> Vec<Remark> {
        self.heights
            .remark()
            .into_iter()
            .chain(self.devices.remarks())
            .chain(self.variation.remarks(&self.devices))
            .chain(self.account.remarks())
            .chain(self.carried_remarks())
            .collect()
    }
}

#[cfg(test)]
mod tests;

//! Account of unused sentences, with the reasons as text.

use std::{borrow::Cow, collections::BTreeMap};

use crate::sensors::Remark;

/// Remedy for JSON in place of a format's lines.
pub(in crate::sensors) const JSON: &str =
    "record or send the plain format in place of JSON (candump -L; analyzer without -json)";
/// Maximum number of sentence addresses that are distinguished.
const MAX_ADDRESSES: usize = 48;
/// Maximum number of addresses in a remark.
const MAX_NAMED: usize = 6;
/// Maximum address length, bytes.
const MAX_ADDRESS: usize = 20;
/// Fraction of a kind's sentences above which an irregularity is a habit of the source: equal time stamps are
/// then not duplicate datagrams, and headings of a float solution are not a start-up effect.
const HABIT: f64 = 0.2;

/// Standard deviation of a position that its receiver marks as unsafe (navigational status U of version 4.1), m (ours).
pub(super) const UNSAFE_SD: f64 = 10.0;

/// Text on unsupported kinds with an attitude or a heading.
pub(crate) const ANGLES: &str =
    "attitude or heading in an unsupported kind; supported: HDT, PASHR, PSXN, PRDID, HPR, XDR";

/// Reason why a valid sentence yields no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::sensors) enum Why {
    Simulated,
    NoFix,
    /// A fix without a height.
    Flat,
    /// Fix quality, as in GGA.
    Quality(u8),
    Magnetic,
    /// Number of fields, and number known for the kind.
    Fields(u8, u8),
    /// A number in place of a letter.
    Shifted,
    /// Latitude and longitude of exactly zero.
    Nowhere,
    /// Angles in another unit than degrees.
    Unit,
    Range,
    Length,
    Invalid,
    FixedBase,
    OtherClock,
    /// Another format among the sentences, with the remedy.
    Foreign(&'static str),
    Spare,
    Cached,
    HeldUp,
    Empty,
    Angles,
    NotRead,
}

impl Why {
    /// Text, and remedy; no remedy if the reason is not a fault.
    fn texts(self) -> (Cow<'static, str>, Option<&'static str>) {
        const COMMA: &str = "set the program that sends it to decimal points (its locale)";
        const FIX: &str = "the receiver has no fix: check its antenna and its view of the sky";
        let (text, remedy) = match self {
            Why::Quality(q) => {
                let remedy = "set the receiver to the qualities of NMEA 0183 (0 to 8), or report this one";
                return (format!("of unknown quality {q}").into(), Some(remedy));
            }
            Why::Fields(n, known) => {
                let text = format!("{n} fields, {known} are known: a decimal comma?");
                return (text.into(), Some(COMMA));
            }
            Why::Foreign(remedy) => ("another format", remedy),
            Why::Shifted => ("a number in place of a letter: a decimal comma?", COMMA),
            Why::Nowhere => ("at 0 N 0 E: a receiver without a fix", FIX),
            Why::NoFix => ("no fix", FIX),
            Why::Flat => (
                "a two-dimensional fix (GSA 2): its height is not measured",
                "give the antenna a free view of the sky: a height needs four satellites or more",
            ),
            Why::Unit => ("angles not in degrees (D)", "set the instrument to degrees"),
            Why::Invalid => (
                "marked as invalid",
                "the sensor itself marks it as invalid: check its alignment and its antennas",
            ),
            Why::Simulated => (
                "simulated or set by hand",
                "end the device's demonstration mode, or its position set by hand",
            ),
            Why::Magnetic => (
                "magnetic, and the variation is not known",
                "a heading from the north is needed: HDT, or RMC or HDG with the variation; on NMEA 2000 one from the north, or 127258; on \
                 Signal K navigation.magneticVariation",
            ),
            Why::Length => (
                "of an unexpected length",
                "the receiver is of another generation: switch on other messages that are read, or NMEA",
            ),
            Why::Range => (
                "a heading outside of 0 to 360 deg",
                "set the instrument to headings of 0 to 360 deg",
            ),
            Why::OtherClock => (
                "of another clock than the other times",
                "set the clock of that instrument to UTC, or switch its sentence off",
            ),
            Why::NotRead => ("an unsupported kind", ""),
            Why::Angles => (ANGLES, ""),
            Why::Empty => ("empty", ""),
            Why::Spare => ("a better one is used", ""),
            Why::Cached => ("the first after the server's greeting, of any age", ""),
            Why::HeldUp => ("delayed, and without a time of its own", ""),
            Why::FixedBase => ("of a fixed base: the direction to it is not a heading", ""),
        };
        (text.into(), Some(remedy).filter(|remedy| !remedy.is_empty()))
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Stamps {
    newest_ns: Option<i64>,
    count: u64,
    repeated: u64,
}

#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct Account {
    left_out: BTreeMap<(Why, String), u64>,
    stamps: BTreeMap<String, Stamps>,
    /// Number of two-antenna headings with a float solution, and of all valid ones.
    antennas: [u64; 2],
    pub(in crate::sensors) unsafe_positions: u64,
    pub(in crate::sensors) unchecked: u64,
}

/// Name of a message, shortened and restricted to letters, digits, hyphens and underscores.
fn bounded(address: &str) -> String {
    address
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'))
        .take(MAX_ADDRESS)
        .collect()
}

impl Account {
    pub(in crate::sensors) fn leave_out(&mut self, address: &str, why: Why) {
        let key = (why, bounded(address));
        let full = self.left_out.len() >= MAX_ADDRESSES && !self.left_out.contains_key(&key);
        let key = if full { (why, "others".into()) } else { key };
        *self.left_out.entry(key).or_default() += 1;
    }
    pub(in crate::sensors) fn has_foreign(&self) -> bool {
        self.left_out
            .keys()
            .any(|(why, _)| matches!(why, Why::Foreign(_)))
    }
    /// Counts a valid two-antenna heading; one with a float solution is not used.
    pub(in crate::sensors) fn antennas(&mut self, is_float: bool) {
        let [float, all] = &mut self.antennas;
        *float += u64::from(is_float);
        *all += 1;
    }
    pub(in crate::sensors) fn stamp(&mut self, address: &str, at_ns: i64) {
        let name = bounded(address);
        if self.stamps.len() >= MAX_ADDRESSES && !self.stamps.contains_key(&name) {
            return;
        }
        let stamps = self.stamps.entry(name).or_default();
        stamps.count += 1;
        stamps.repeated += u64::from(stamps.newest_ns == Some(at_ns));
        stamps.newest_ns = Some(at_ns);
    }
    pub(in crate::sensors) fn remarks(&self) -> Vec<Remark> {
        let mut all = Vec::from_iter(self.float());
        let mut each: Vec<Why> = self.left_out.keys().map(|(why, _)| *why).collect();
        each.dedup();
        all.extend(each.into_iter().filter_map(|why| self.left_out(why)));
        all.extend(self.repeated_stamps());
        if self.unsafe_positions > 0 {
            all.push(Remark::fault(
                format!(
                    "{} positions are marked as unsafe by their receiver: taken as accurate to {UNSAFE_SD} m",
                    self.unsafe_positions
                ),
                "check the antenna's view of the sky, and look for interference",
            ));
        }
        if self.unchecked > 0 {
            all.push(Remark::fine(format!(
                "{} sentences without a checksum: damage to them is not detected",
                self.unchecked
            )));
        }
        all
    }
    fn left_out(&self, why: Why) -> Option<Remark> {
        let of = self.left_out.iter().filter(|((w, _), _)| *w == why);
        let mut each: Vec<(&str, u64)> = of.map(|((_, address), n)| (address.as_str(), *n)).collect();
        if each.is_empty() {
            return None;
        }
        each.sort_by_key(|(_, n)| core::cmp::Reverse(*n));
        let mut named: Vec<String> = each
            .iter()
            .take(MAX_NAMED)
            .map(|(address, n)| format!("{n} {address}"))
            .collect();
        if each.len() > MAX_NAMED {
            named.push("others".into());
        }
        let (why, remedy) = why.texts();
        let text = format!("left out: {} ({why})", named.join(", "));
        Some(match remedy {
            Some(remedy) => Remark::fault(text, remedy),
            None => Remark::fine(text),
        })
    }
    /// Remark on headings with a float solution: a fault if they are more than a brief start-up effect.
    fn float(&self) -> Option<Remark> {
        let [float, all] = self.antennas;
        let text = format!("moving base: float in {float} of {all} headings: left out");
        let remark = match float as f64 > HABIT * all as f64 {
            true => Remark::fault(
                text,
                "check the corrections between its two receivers, its view of the sky and its antennas; until it is fixed \
                 another heading is needed",
            ),
            false => Remark::fine(text),
        };
        (float > 0).then_some(remark)
    }
    fn repeated_stamps(&self) -> Option<Remark> {
        let habit = |s: &&Stamps| s.count >= 10 && s.repeated as f64 > HABIT * s.count as f64;
        let (address, s) = self.stamps.iter().find(|(_, s)| habit(s))?;
        Some(Remark::fault(
            format!(
                "{} of {} {address} repeat the previous time (whole seconds): only the first of each is used",
                s.repeated, s.count
            ),
            "set the device to times with a fraction of a second, or to one sentence a second",
        ))
    }
}

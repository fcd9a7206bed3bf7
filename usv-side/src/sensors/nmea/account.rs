//! What was left out of a source's sentences, and why, in words.

use std::collections::BTreeMap;

use crate::sensors::Remark;

/// Most addresses of sentences that are distinguished.
const MAX_ADDRESSES: usize = 48;
/// Most that one remark names.
const MAX_NAMED: usize = 6;
/// Longest address, bytes.
const MAX_ADDRESS: usize = 20;
/// Above this fraction of one kind's sentences, stamps that repeat are the source's habit and no doubled datagram.
const HABIT: f64 = 0.2;

/// Why a sound sentence gave no measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::sensors) enum Why {
    NotRead,
    Empty,
    Spare,
    Invalid,
    NoFix,
    Simulated,
    Magnetic,
    Cached,
    HeldUp,
    Length,
}

impl Why {
    const fn words(self) -> &'static str {
        match self {
            Why::NotRead => "a kind that is not read",
            Why::Empty => "empty",
            Why::Spare => "a better one is there",
            Why::Invalid => "marked as invalid",
            Why::NoFix => "no fix",
            Why::Simulated => "simulated or set by hand",
            Why::Magnetic => "magnetic, and the variation is not known",
            Why::Cached => "the first after the server's greeting, of any age",
            Why::HeldUp => "held up on the way, and without a time of its own",
            Why::Length => "of another length than is known of them",
        }
    }
    /// What to do about it, where it is a fault.
    const fn remedy(self) -> Option<&'static str> {
        match self {
            Why::NotRead | Why::Empty | Why::Spare | Why::Cached | Why::HeldUp => None,
            Why::Invalid => {
                Some("the sensor itself does not trust it: see to its alignment and its antennas")
            }
            Why::NoFix => Some("the receiver has no fix: see to its antenna and its view of the sky"),
            Why::Simulated => Some("end the device's demonstration mode, or its position set by hand"),
            Why::Length => {
                Some("the receiver is of another generation: switch on other messages that are read, or NMEA")
            }
            Why::Magnetic => Some(
                "a heading from the north is needed: HDT, or RMC or HDG with the variation; on NMEA 2000 one from the north, or 127258; on \
                 Signal K navigation.magneticVariation",
            ),
        }
    }
}

/// Stamps of one address.
#[derive(Clone, Copy, Debug, Default)]
struct Stamps {
    newest_ns: Option<i64>,
    count: u64,
    repeated: u64,
}

/// The account of a decoder.
#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct Account {
    left_out: BTreeMap<(Why, String), u64>,
    stamps: BTreeMap<String, Stamps>,
    /// Sentences that were taken without a checksum.
    pub(in crate::sensors) unchecked: u64,
}

/// A message's name, short and of letters, digits and hyphens.
fn bounded(address: &str) -> String {
    address
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '-')
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
    /// Notes the time of a sentence.
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
        let mut all = Vec::new();
        for why in [
            Why::Simulated,
            Why::NoFix,
            Why::Magnetic,
            Why::Length,
            Why::Invalid,
            Why::Spare,
            Why::Cached,
            Why::HeldUp,
            Why::Empty,
            Why::NotRead,
        ] {
            all.extend(self.left_out(why));
        }
        all.extend(self.repeated_stamps());
        if self.unchecked > 0 {
            all.push(Remark::fine(format!(
                "{} sentences without a checksum: damage to them is not noticed",
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
        let text = format!("left out: {} ({})", named.join(", "), why.words());
        Some(match why.remedy() {
            Some(remedy) => Remark::fault(text, remedy),
            None => Remark::fine(text),
        })
    }
    fn repeated_stamps(&self) -> Option<Remark> {
        let habit = |s: &&Stamps| s.count >= 10 && s.repeated as f64 > HABIT * s.count as f64;
        let (address, s) = self.stamps.iter().find(|(_, s)| habit(s))?;
        Some(Remark::fault(
            format!(
                "{} of {} {address} carry the time of the one before: whole seconds, and only the first of each is used",
                s.repeated, s.count
            ),
            "set the device to times with a fraction of a second, or to one sentence a second",
        ))
    }
}

//! A marine autopilot over NMEA 0183: it steers to the heading of APB (heading to steer to a waypoint, cross-track error 0)
//! and of HSC (heading steering command), as makers document both. The speed stays the skipper's.
//!
//! There is no mode to set: he puts it into track or navigation control when he agrees, and it warns and holds its heading
//! once the sentences end. Where it sends HTD its override and steering mode are read back: it follows in track control (APB)
//! and in heading control (HSC) only.

use alight_shared::lines::{Cut, LineBuffer};
use alight_shared::time::{Span, Time, VesselClock};

use super::command::{Command, ReadBack};

/// Time between two pairs of sentences: navigators send them once a second.
const PERIOD: Span = Span::from_millis(1000);
/// Longest sentence, bytes; what is longer is no sentence.
const MAX_SENTENCE: usize = 120;
/// What HTD says counts for so long.
const FRESH: Span = Span::from_millis(5000);

/// The link to it.
#[derive(Clone, Debug)]
pub(super) struct NmeaHelm {
    open: bool,
    lines: LineBuffer,
    due: Option<Time<VesselClock>>,
    /// Its newest HTD, and who steers by it.
    htd: Option<(Time<VesselClock>, Steers)>,
}

/// Who steers, by an autopilot's own report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Steers {
    /// A hand: its override is in use, or its steering mode is manual.
    Hand,
    /// Our sentences, in track or heading control.
    Sentences,
    /// Itself, as its skipper has set it, or none.
    Itself,
}

impl Default for NmeaHelm {
    fn default() -> Self {
        NmeaHelm {
            open: false,
            lines: LineBuffer::new(MAX_SENTENCE),
            due: None,
            htd: None,
        }
    }
}

impl NmeaHelm {
    /// Takes what came at `now`; None: the link is not open.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: Option<&[u8]>) {
        self.open = bytes.is_some();
        for byte in bytes.unwrap_or_default() {
            if let Some(Cut::Line(line)) = self.lines.push(*byte) {
                let steers = core::str::from_utf8(&line).ok().and_then(steers);
                self.htd = steers.map(|steers| (now, steers)).or(self.htd);
            }
        }
    }
    /// What it reports: of one that reports nothing no more is known to be missing than its link.
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        let newest = self.htd.filter(|(at, _)| now - *at <= FRESH);
        let steers = newest.map(|(_, steers)| steers);
        ReadBack {
            present: self.open,
            mode: None,
            reported: None,
            is_ours: steers.is_none_or(|by| by == Steers::Sentences),
            denied: false,
            by_hand: steers == Some(Steers::Hand),
        }
    }
    /// The sentences that are due at `now` for a command.
    pub(super) fn send(&mut self, now: Time<VesselClock>, command: &Command) -> Vec<u8> {
        let Command::Steer { heading_rad, .. } = *command else {
            self.due = None;
            return Vec::new();
        };
        if self.due.is_some_and(|due| now < due) {
            return Vec::new();
        }
        self.due = Some(now + PERIOD);
        let deg = heading_rad.to_degrees().rem_euclid(360.0);
        // 359.96 is written as 0.0.
        let deg = if deg >= 359.95 { 0.0 } else { deg };
        let apb = format!("EIAPB,A,A,0.00,R,N,V,V,{deg:.1},T,ALIGHT,{deg:.1},T,{deg:.1},T,A");
        let hsc = format!("EIHSC,{deg:.1},T,,M");
        [apb, hsc].iter().flat_map(|s| sentence(s)).collect()
    }
}

/// A sentence with its checksum: exclusive or of all between `$` and `*`.
fn sentence(content: &str) -> Vec<u8> {
    format!("${content}*{:02X}\r\n", checksum(content)).into_bytes()
}
fn checksum(content: &str) -> u8 {
    content.bytes().fold(0, |sum, b| sum ^ b)
}

/// Who steers, by an HTD whose checksum is right.
fn steers(line: &str) -> Option<Steers> {
    let (content, sum) = line.trim().strip_prefix('$')?.split_once('*')?;
    (u8::from_str_radix(sum, 16).ok()? == checksum(content)).then_some(())?;
    let mut fields = content.split(',');
    fields.next()?.get(2..).filter(|kind| *kind == "HTD")?;
    let (overridden, mode) = (fields.next()?, fields.nth(2)?);
    Some(match mode {
        _ if overridden == "A" => Steers::Hand,
        "M" => Steers::Hand,
        "T" | "H" => Steers::Sentences,
        _ => Steers::Itself,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_of_a_heading() {
        let mut helm = NmeaHelm::default();
        let steer = |deg: f64| Command::Steer {
            heading_rad: deg.to_radians(),
            speed_mps: 2.0,
        };
        let text = String::from_utf8(helm.send(Time::EPOCH, &steer(-20.0))).unwrap();
        let lines: Vec<&str> = text.split("\r\n").collect();
        // Checksums computed outside.
        assert_eq!(
            lines[0],
            "$EIAPB,A,A,0.00,R,N,V,V,340.0,T,ALIGHT,340.0,T,340.0,T,A*52"
        );
        assert_eq!(lines[1], "$EIHSC,340.0,T,,M*64");
        assert!(
            helm.send(Time::from_secs(0.5), &steer(0.0)).is_empty(),
            "once a second"
        );
        let next = String::from_utf8(helm.send(Time::from_secs(1.0), &steer(-0.01))).unwrap();
        assert!(next.contains("$EIHSC,0.0,T"), "{next}");
        assert!(helm.send(Time::from_secs(3.0), &Command::Nothing).is_empty());
    }

    #[test]
    fn hand_by_the_autopilots_own_report() {
        let mut helm = NmeaHelm::default();
        let mut reports = |content: &str, wrong: u8| {
            let line = format!("${content}*{:02X}\r\n", checksum(content) ^ wrong);
            helm.receive(Time::EPOCH, Some(line.as_bytes()));
            let r = helm.read_back(Time::EPOCH);
            (r.by_hand, r.is_ours)
        };
        let (hand, ours, other) = ((true, false), (false, true), (false, false));
        let htd =
            |overridden: &str, mode: &str| format!("AGHTD,{overridden},,,{mode},N,,,,,340.0,,,T,A,A,A,339.0");
        assert_eq!(reports(&htd("V", "H"), 0), ours);
        assert_eq!(reports(&htd("V", "M"), 1), ours, "damaged");
        assert_eq!(reports(&htd("V", "M"), 0), hand);
        assert_eq!(reports(&htd("V", "T"), 0), ours);
        // On its own heading, or by its rudder alone, it does not follow.
        assert_eq!(reports(&htd("V", "S"), 0), other);
        assert_eq!(reports(&htd("V", "R"), 0), other);
        assert_eq!(reports(&htd("A", "T"), 0), hand);
        // The end of a line that is too long is no sentence, though it reads as one.
        let overlong = "x".repeat(MAX_SENTENCE + 1);
        helm.receive(Time::EPOCH, Some(overlong.as_bytes()));
        let line = format!("${}*{:02X}\r\n", htd("V", "T"), checksum(&htd("V", "T")));
        helm.receive(Time::EPOCH, Some(line.as_bytes()));
        assert!(helm.read_back(Time::EPOCH).by_hand, "overlong");
        let old = helm.read_back(Time::from_secs(9.0));
        assert!(!old.by_hand && old.is_ours, "it may report nothing any more");
    }

    #[test]
    fn link_that_is_not_open() {
        let mut helm = NmeaHelm::default();
        let mut present = |bytes: Option<&[u8]>| {
            helm.receive(Time::EPOCH, bytes);
            helm.read_back(Time::EPOCH).present
        };
        assert!(!present(None));
        assert!(present(Some(b"")), "it may have nothing to report");
        assert!(!present(None));
    }
}

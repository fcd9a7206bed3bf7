//! A marine autopilot over NMEA 0183: it steers to the heading of APB (heading to steer to a waypoint, cross-track error 0)
//! and of HSC (heading steering command), as makers document both. The speed stays the skipper's.
//!
//! Many a pilot goes into track control only with a distance to a waypoint (Raymarine forum, thread 4077; Furuno NAVpilot-500
//! manual, 2-12). RMB and BWC have one: it lies a fixed way ahead on the course, moves with the boat, and is never reached. Its
//! place is known with the boat's own; without that APB and HSC go out alone. All bearings of APB are of one north: pilots
//! reject a sentence that mixes them (SignalK/signalk-to-nmea0183 issue 144, pull requests 168 to 171); RMB's is always true.
//!
//! There is no mode to set: he puts it into track or navigation control when he agrees, and it warns and holds its heading
//! once the sentences end. Where it sends HTD its override and steering mode are read back: it follows in track control (APB)
//! and in heading control (HSC) only.

use alight_shared::frames::{Vector, VesselNed};
use alight_shared::geodesy::{Datum, KNOT_MPS};
use alight_shared::lines::{Cut, LineBuffer};
use alight_shared::time::{Span, Time, VesselClock};

use super::BoatPlace;
use super::command::{HelmCommand, ReadBack};
use super::config::{HelmBearings, HelmConfig};

/// Time between two pairs of sentences: navigators send them once a second.
const PERIOD: Span = Span::from_millis(1000);
/// A nautical mile, m.
const MILE_M: f64 = 1852.0;
/// The waypoint lies so far ahead, nautical miles: beyond the radius in which a pilot reports an arrival.
const AHEAD_MILES: f64 = 5.0;
/// Longest sentence, bytes; what is longer is no sentence.
const MAX_SENTENCE: usize = 120;
/// An HTD sentence counts for so long.
const FRESH: Span = Span::from_millis(5000);

/// The link to it.
#[derive(Clone, Debug)]
pub(super) struct NmeaHelm {
    open: bool,
    lines: LineBuffer,
    due: Option<Time<VesselClock>>,
    /// Newest HTD, and who steers by it.
    htd: Option<(Time<VesselClock>, Steers)>,
    bearings: HelmBearings,
    /// East positive, rad.
    variation_rad: Option<f64>,
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

impl NmeaHelm {
    /// With the bearings of this configuration.
    pub(super) fn new(config: &HelmConfig) -> NmeaHelm {
        NmeaHelm {
            open: false,
            lines: LineBuffer::new(MAX_SENTENCE),
            due: None,
            htd: None,
            bearings: config.bearings,
            variation_rad: config.variation_rad(),
        }
    }
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
    /// Report of the autopilot: of one that reports nothing no more is known to be missing than its link.
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
    /// The sentences that are due at `now` for a command, from where the boat is.
    pub(super) fn send(
        &mut self,
        now: Time<VesselClock>,
        command: &HelmCommand,
        boat: Option<&BoatPlace>,
    ) -> Vec<u8> {
        let HelmCommand::Steer {
            heading_rad,
            speed_mps,
        } = *command
        else {
            self.due = None;
            return Vec::new();
        };
        if self.due.is_some_and(|due| now < due) {
            return Vec::new();
        }
        self.due = Some(now + PERIOD);
        let geographic = bearing(heading_rad);
        let magnetic = self.variation_rad.map(|east| bearing(heading_rad - east));
        let steer = match (self.bearings, &magnetic) {
            (HelmBearings::Magnetic, Some(magnetic)) => format!("{magnetic},M"),
            (HelmBearings::Magnetic, None) | (HelmBearings::True, _) => format!("{geographic},T"),
        };
        let magnetic = magnetic.unwrap_or_default();
        let mut all = vec![
            format!("EIAPB,A,A,0.00,R,N,V,V,{steer},ALIGHT,{steer},{steer},A"),
            format!("EIHSC,{geographic},T,{magnetic},M"),
        ];
        if let Some(boat) = boat {
            let (at, knots) = (place(&ahead(boat, heading_rad)), speed_mps / KNOT_MPS);
            let far = format!("{AHEAD_MILES:.2}");
            all.push(format!(
                "EIRMB,A,0.00,R,START,ALIGHT,{at},{far},{geographic},{knots:.1},V,A"
            ));
            // The time of a fix may be left out.
            all.push(format!(
                "EIBWC,,{at},{geographic},T,{magnetic},M,{far},N,ALIGHT,A"
            ));
        }
        all.iter().flat_map(|s| sentence(s)).collect()
    }
}

/// An angle as a bearing, deg.
fn bearing(rad: f64) -> String {
    let deg = rad.to_degrees().rem_euclid(360.0);
    // 359.96 is written as 0.0.
    let deg = if deg >= 359.95 { 0.0 } else { deg };
    format!("{deg:.1}")
}

/// The waypoint on this course from where the boat is.
fn ahead(boat: &BoatPlace, heading_rad: f64) -> Datum {
    let (sin, cos) = heading_rad.sin_cos();
    let way_m = AHEAD_MILES * MILE_M;
    let [north_m, east_m] = boat.position_m;
    let here = boat.datum.at(&Vector::<VesselNed>::new(north_m, east_m, 0.0));
    here.at(&Vector::<VesselNed>::new(way_m * cos, way_m * sin, 0.0))
}

/// Four fields: latitude and longitude in degrees and minutes, each with its letter.
fn place(at: &Datum) -> String {
    let fields = |deg: f64, width: usize, letter: char| {
        // Ten thousandths of a minute, 0.2 m; rounded first, since 60 minutes are written as a degree.
        let all = (deg.abs() * 600_000.0).round() as u64;
        let (whole, minutes) = (all / 600_000, all % 600_000);
        format!(
            "{whole:0width$}{:02}.{:04},{letter}",
            minutes / 10_000,
            minutes % 10_000
        )
    };
    let (latitude, longitude) = (at.latitude_deg, at.longitude_deg);
    let north = fields(latitude, 2, if latitude < 0.0 { 'S' } else { 'N' });
    let east = fields(longitude, 3, if longitude < 0.0 { 'W' } else { 'E' });
    format!("{north},{east}")
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

    fn steer(deg: f64) -> HelmCommand {
        HelmCommand::Steer {
            heading_rad: deg.to_radians(),
            speed_mps: 2.0,
        }
    }
    fn plain() -> NmeaHelm {
        NmeaHelm::new(&HelmConfig::default())
    }
    /// The first sentences of a helm with this north for a course from this place.
    fn sentences(bearings: HelmBearings, variation_deg: Option<f64>, boat: &BoatPlace) -> Vec<String> {
        let config = HelmConfig {
            bearings,
            variation_deg,
            ..HelmConfig::default()
        };
        let bytes = NmeaHelm::new(&config).send(Time::EPOCH, &steer(-20.0), Some(boat));
        let text = String::from_utf8(bytes).unwrap();
        text.split_terminator("\r\n").map(str::to_owned).collect()
    }
    const BOAT: BoatPlace = BoatPlace {
        datum: Datum::new(59.9, 10.6, 40.0),
        position_m: [100.0, -50.0],
    };

    /// Places and checksums computed outside, from the ellipsoid.
    #[test]
    fn waypoint_ahead_of_the_boat() {
        let lines = sentences(HelmBearings::True, None, &BOAT);
        assert_eq!(
            lines,
            [
                "$EIAPB,A,A,0.00,R,N,V,V,340.0,T,ALIGHT,340.0,T,340.0,T,A*52",
                "$EIHSC,340.0,T,,M*64",
                "$EIRMB,A,0.00,R,START,ALIGHT,5958.7393,N,01032.5431,E,5.00,340.0,3.9,V,A*35",
                "$EIBWC,,5958.7393,N,01032.5431,E,340.0,T,,M,5.00,N,ALIGHT,A*7A",
            ]
        );
        // With its end no sentence is longer than 82 characters.
        assert!(lines.iter().all(|line| line.len() + 2 <= 82), "{lines:?}");
    }

    #[test]
    fn magnetic_bearings_by_the_variation() {
        let lines = sentences(HelmBearings::Magnetic, Some(-4.5), &BOAT);
        assert_eq!(
            lines,
            [
                "$EIAPB,A,A,0.00,R,N,V,V,344.5,M,ALIGHT,344.5,M,344.5,M,A*4A",
                "$EIHSC,340.0,T,344.5,M*4C",
                "$EIRMB,A,0.00,R,START,ALIGHT,5958.7393,N,01032.5431,E,5.00,340.0,3.9,V,A*35",
                "$EIBWC,,5958.7393,N,01032.5431,E,340.0,T,344.5,M,5.00,N,ALIGHT,A*52",
            ]
        );
        // With true bearings a known variation is in the fields that are of magnetic north anyhow.
        let lines = sentences(HelmBearings::True, Some(-4.5), &BOAT);
        assert!(
            lines
                .iter()
                .any(|line| line.contains("APB") && !line.contains(",M,")),
            "{lines:?}"
        );
        assert!(
            lines.iter().any(|line| line.contains("HSC,340.0,T,344.5,M")),
            "{lines:?}"
        );
    }

    /// Data that Raymarine wants before a pilot tracks (forum, thread 4077), and which sentence has each.
    #[test]
    fn data_that_a_pilot_wants_for_its_track_mode() {
        let lines = sentences(HelmBearings::Magnetic, Some(-4.5), &BOAT);
        let fields = |kind: &str| -> Vec<String> {
            let of = |line: &&String| line.get(3..6) == Some(kind);
            let line = lines.iter().find(of).unwrap();
            let content = line.split('*').next().unwrap();
            content.split(',').map(str::to_owned).collect()
        };
        let (apb, rmb, bwc) = (fields("APB"), fields("RMB"), fields("BWC"));
        assert_eq!((apb.len(), rmb.len(), bwc.len()), (16, 15, 14));
        assert_eq!([&apb[3], &rmb[2]], ["0.00", "0.00"], "cross-track error");
        assert_eq!([&apb[10], &rmb[5], &bwc[12]], ["ALIGHT"; 3], "waypoint");
        assert_eq!([&apb[11], &apb[12]], ["344.5", "M"], "magnetic bearing");
        assert_eq!(
            [&rmb[11], &bwc[6], &bwc[8]],
            ["340.0", "340.0", "344.5"],
            "bearings"
        );
        assert_eq!([&rmb[10], &bwc[10]], ["5.00", "5.00"], "distance");
    }

    #[test]
    fn places_south_west_and_at_a_whole_degree() {
        let at = |latitude, longitude| place(&Datum::new(latitude, longitude, 0.0));
        assert_eq!(at(-33.5, -0.25), "3330.0000,S,00015.0000,W");
        assert_eq!(at(9.999_999_99, 179.999_999_99), "1000.0000,N,18000.0000,E");
    }

    #[test]
    fn sentences_of_a_heading() {
        let mut helm = plain();
        let text = String::from_utf8(helm.send(Time::EPOCH, &steer(-20.0), None)).unwrap();
        let lines: Vec<&str> = text.split("\r\n").collect();
        // Checksums computed outside.
        assert_eq!(
            lines[0],
            "$EIAPB,A,A,0.00,R,N,V,V,340.0,T,ALIGHT,340.0,T,340.0,T,A*52"
        );
        assert_eq!(
            lines[1..],
            ["$EIHSC,340.0,T,,M*64", ""],
            "no waypoint without a place"
        );
        let mut at = |t_s: f64, command: &HelmCommand| {
            String::from_utf8(helm.send(Time::from_secs(t_s), command, None)).unwrap()
        };
        assert_eq!(at(0.5, &steer(0.0)), "", "once a second");
        let next = at(1.0, &steer(-0.01));
        assert!(next.contains("$EIHSC,0.0,T"), "{next}");
        assert_eq!(at(3.0, &HelmCommand::Nothing), "");
    }

    #[test]
    fn hand_by_the_autopilots_own_report() {
        let mut helm = plain();
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
        let mut helm = plain();
        let mut present = |bytes: Option<&[u8]>| {
            helm.receive(Time::EPOCH, bytes);
            helm.read_back(Time::EPOCH).present
        };
        assert!(!present(None));
        assert!(present(Some(b"")), "it may have nothing to report");
        assert!(!present(None));
    }
}

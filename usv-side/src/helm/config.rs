//! Whether and how the vessel's computer steers, and the limits that the skipper sets.

use alight_shared::config;
use serde::{Deserialize, Serialize};

/// The boat's autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HelmOutput {
    /// The vessel is not steered.
    #[default]
    None,
    /// ArduPilot Rover (GUIDED) or PX4 (OFFBOARD): heading and speed.
    Mavlink,
    /// A marine autopilot that takes NMEA 0183 (APB, HSC, RMB, BWC): heading.
    Nmea0183,
    /// A marine autopilot behind the autopilot API (version 2) of a Signal K server: heading.
    #[serde(rename = "signalk")]
    SignalK,
}

/// The north from which a marine autopilot takes a heading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HelmBearings {
    /// True north.
    #[default]
    True,
    /// Magnetic north: the true heading less the variation.
    Magnetic,
}

config! {
    /// Steering for a landing or a take-off. The skipper stays responsible for traffic, and is asked before each.
    pub struct HelmConfig {
        /// The boat's autopilot: "mavlink" (ArduPilot Rover, PX4), "nmea0183" (APB, HSC, RMB and BWC), "signalk" (the autopilot
        /// API of a Signal K server), "none": it is not steered.
        pub output: HelmOutput = HelmOutput::None;
        /// Address of the boat's autopilot, in the form of a sensor's: serial:///dev/ttyUSB1:57600,
        /// udpin://127.0.0.1:14560; of Signal K ws://HOST:3000.
        pub connect: String = String::new();
        /// Bearings that a marine autopilot is sent: "true", or "magnetic", which wants `variation_deg`.
        /// Source: Raymarine forum, thread 4077: magnetic ones are preferred, true ones need the variation.
        pub bearings: HelmBearings = HelmBearings::True;
        /// Magnetic variation where the boat sails, deg, east positive: the chart's, for this year; none: it is not known.
        pub variation_deg: Option<f64> = None, in -180.0..=180.0;
        /// File with the passphrase of its MAVLink signing; empty: frames are not signed.
        pub signing_key: String = String::new();
        /// Largest change of the heading from that before the landing, deg.
        /// Chosen: most of what a heading brings, and no way back.
        pub heading_change_deg: f64 = 60.0, in 0.0..=180.0;
        /// Lowest and highest speed over ground that is commanded, m/s.
        /// Chosen: slower a boat does not answer its rudder.
        pub speed_mps: [f64; 2] = [2.0, 5.0], in 0.3..=15.0;
        /// Sectors of headings that are not steered and not turned through, each clockwise from the first to the second,
        /// deg from true north, not by a magnetic compass. To keep every heading: heading_change_deg = 0.
        pub keep_out_deg: Vec<[f64; 2]> = Vec::new(), in 0.0..=360.0;
        /// Digital input by which the skipper agrees: 0 to 1 while the lamp asks (from 3 s on) is yes, back to 0 takes the
        /// helm back; a line or a file; empty: none. Unreadable counts as 0.
        pub consent_switch: String = String::new();
        /// The course is kept for so long after a landing, s: the drone is secured before the deck moves otherwise.
        /// Chosen: the minute for which a landed drone is judged to stay.
        pub secure_s: f64 = 60.0, in 0.0..=3600.0;
        /// One yes steers no longer than this for a drone that comes, s.
        /// Chosen: two attempts to land.
        pub max_time_s: f64 = 600.0, in 60.0..=3600.0;
        /// ... and no further than this, m, along the boat's way: room that the skipper has looked at.
        /// Chosen: a nautical mile.
        pub max_way_m: f64 = 1852.0, in 100.0..=20_000.0;
    }
    check |this, at| {
        let [low, high] = this.speed_mps;
        at.require(low <= high, "speed_mps", format!("[{low}, {high}]"), "the lowest speed first")?;
        let count = this.keep_out_deg.len();
        at.require(count <= MAX_SECTORS, "keep_out_deg", format!("{count} sectors"), "at most 8 sectors")?;
        let is_one = |[from, to]: &&[f64; 2]| (to - from).rem_euclid(360.0) == 0.0;
        if let Some([from, to]) = this.keep_out_deg.iter().find(is_one) {
            at.require(
                false,
                "keep_out_deg",
                format!("[{from}, {to}]"),
                "two different headings; to keep every heading, heading_change_deg = 0.0",
            )?;
        }
        at.require(
            this.bearings == HelmBearings::True || this.variation_deg.is_some(),
            "variation_deg",
            "none",
            "the chart's variation, east positive, as bearings = \"magnetic\" wants it, or bearings = \"true\"",
        )?;
        at.require(
            this.output == HelmOutput::None || !this.connect.is_empty(),
            "connect",
            "empty",
            "the address of the boat's autopilot, or output = \"none\"",
        )?;
    }
}

impl HelmConfig {
    /// The variation, rad, east positive; None: not known.
    pub(super) fn variation_rad(&self) -> Option<f64> {
        self.variation_deg.map(f64::to_radians)
    }
}

/// Sectors, at most.
const MAX_SECTORS: usize = 8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn helm_configurations_that_are_rejected() {
        let rejects = |text: &str| config::parse::<HelmConfig>(text, "test").unwrap_err().to_string();
        assert!(rejects("output = \"mavlink\"").contains("`connect`"));
        assert!(rejects("output = \"signalk\"").contains("`connect`"));
        assert!(rejects("bearings = \"magnetic\"").contains("variation_deg"));
        assert!(rejects("variation_deg = 200.0").contains("variation_deg"));
        let magnetic = "bearings = \"magnetic\"\nvariation_deg = -4.5";
        assert!(config::parse::<HelmConfig>(magnetic, "test").is_ok());
        assert!(rejects("speed_mps = [5.0, 2.0]").contains("lowest speed first"));
        assert!(rejects("keep_out_deg = [[350.0, 400.0]]").contains("keep_out_deg"));
        assert!(config::parse::<HelmConfig>("keep_out_deg = [[350.0, 10.0]]", "test").is_ok());
        // A whole circle and a single heading look the same.
        for same in ["[0.0, 360.0]", "[180.0, 180.0]", "[360.0, 0.0]"] {
            let sectors = format!("keep_out_deg = [[80.0, 120.0], {same}]");
            assert!(rejects(&sectors).contains("heading_change_deg = 0"), "{same}");
        }
    }
}

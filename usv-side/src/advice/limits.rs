//! Limits on the advised course set by the skipper: change of heading, speeds, and keep-out sectors.

use alight_shared::{config, frames::wrap_angle};

/// Angular step for checking headings, rad: 1 deg.
const STEP_RAD: f64 = core::f64::consts::PI / 180.0;
/// Maximum turn if there are keep-out sectors, rad (150 deg), because only the shorter way is checked.
const SURE_TURN_RAD: f64 = 2.62;
const MAX_SECTORS: usize = 8;

config! {
    /// Limits on the advised course set by the skipper, who steers and is responsible for traffic and depth.
    pub struct AdviceConfig {
        /// Maximum advised change of heading, deg; 0: only the speed may change.
        pub heading_change_deg: f64 = 180.0, in 0.0..=180.0;
        /// Minimum and maximum advised speed over ground, m/s.
        pub speed_mps: [f64; 2] = [0.0, 30.0], in 0.0..=30.0;
        /// Sectors of headings that are neither advised nor turned through, each clockwise from the first to the
        /// second, deg from true (not magnetic) north. To keep every heading, set heading_change_deg = 0.
        pub keep_out_deg: Vec<[f64; 2]> = Vec::new(), in 0.0..=360.0;
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
    }
}

impl AdviceConfig {
    /// Whether the skipper permits a turn by the shorter way from the heading `now` (rad) to this heading
    /// (rad) and speed (m/s). The turn may lead out of a sector.
    pub(super) fn permits(&self, [heading, speed]: [f64; 2], now: f64) -> bool {
        let turn = wrap_angle(heading - now);
        let steps = (turn.abs() / STEP_RAD).ceil().max(1.0);
        let way = (0..=steps as u32).map(|k| now + turn * f64::from(k) / steps);
        let [low, high] = self.speed_mps;
        // Tolerance for rounding errors of headings.
        turn.abs() <= self.largest_turn() + 0.5 * STEP_RAD
            && (low..=high).contains(&speed)
            && way.map(|on_it| self.keeps_out(on_it)).is_sorted_by(|a, b| a >= b)
            && !self.keeps_out(heading)
    }
    fn largest_turn(&self) -> f64 {
        let limit = self.heading_change_deg.to_radians();
        if self.keep_out_deg.is_empty() {
            limit
        } else {
            limit.min(SURE_TURN_RAD)
        }
    }
    fn keeps_out(&self, heading_rad: f64) -> bool {
        let deg = heading_rad.to_degrees();
        // Half a step wider, so that no turn enters a sector by rounding.
        let within = |[from, to]: &[f64; 2]| {
            (deg - from + 0.5).rem_euclid(360.0) <= (to - from).rem_euclid(360.0) + 1.0
        };
        self.keep_out_deg.iter().any(within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_are_rejected() {
        let rejects = |text: &str| {
            config::parse::<AdviceConfig>(text, "test")
                .unwrap_err()
                .to_string()
        };
        assert!(rejects("speed_mps = [5.0, 2.0]").contains("lowest speed first"));
        assert!(rejects("keep_out_deg = [[350.0, 400.0]]").contains("keep_out_deg"));
        assert!(config::parse::<AdviceConfig>("keep_out_deg = [[350.0, 10.0]]", "test").is_ok());
        // A full circle and a single heading look the same.
        for same in ["[0.0, 360.0]", "[180.0, 180.0]", "[360.0, 0.0]"] {
            let sectors = format!("keep_out_deg = [[80.0, 120.0], {same}]");
            assert!(rejects(&sectors).contains("heading_change_deg = 0"), "{same}");
        }
    }

    #[test]
    fn courses_that_the_skipper_permits() {
        let permits = |c: &AdviceConfig, from: f64, to: f64, speed_mps: f64| {
            c.permits([to.to_radians(), speed_mps], from.to_radians())
        };
        let c = AdviceConfig {
            heading_change_deg: 60.0,
            speed_mps: [2.0, 5.0],
            keep_out_deg: Vec::new(),
        };
        // The shorter way leads through north.
        assert!(permits(&c, 10.0, 70.0, 2.0) && permits(&c, 10.0, 310.0, 5.0));
        assert!(
            !permits(&c, 10.0, 71.0, 3.0) && !permits(&c, 10.0, 309.0, 3.0),
            "too far"
        );
        assert!(
            !permits(&c, 0.0, 30.0, 1.9) && !permits(&c, 0.0, 30.0, 5.1),
            "its speed"
        );
        let shore = AdviceConfig {
            keep_out_deg: vec![[20.0, 40.0], [350.0, 355.0]],
            ..AdviceConfig::default()
        };
        let clear = |from: f64, to: f64| permits(&shore, from, to, 3.0);
        assert!(clear(0.0, 15.0) && clear(30.0, 60.0), "out of a sector");
        // Turns into, through and between sectors, and a half turn that may lead through any sector.
        for (from, to) in [
            (0.0, 30.0),
            (60.0, 30.0),
            (60.0, 0.0),
            (30.0, 340.0),
            (90.0, 255.0),
        ] {
            assert!(!clear(from, to), "{from} to {to}");
        }
        assert!(!clear(30.0, 30.0), "slower within one");
        assert!(permits(&AdviceConfig::default(), 57.0, 235.0, 3.0));
    }
}

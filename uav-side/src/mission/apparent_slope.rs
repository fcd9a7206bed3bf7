//! The deck's apparent slope as the vessel reports it, as a question of when to land.
//!
//! Waves come in groups. A group in which a landed drone would have slid is followed by calm, and by another group
//! about as long after it as the last one came after the one before. A descent has to begin so soon after a
//! group that the drone is down and has come to rest before the next.

use alight_shared::msg::{SLOPE_STEP, SLOPE_WINDOW_S};

use super::config::MissionConfig;

/// Windows below the slide limit between two above it that belong to one group: a wave and a little.
const APART: usize = 3;

/// When a landed drone would have slid recently.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ApparentSlopeHistory {
    /// Time since a landed drone would last have slid, s, to [`SLOPE_WINDOW_S`]; None when it would not.
    pub since_s: Option<f64>,
    /// The shortest calm between two such groups of waves, s; None before there were two.
    pub calm_s: Option<f64>,
}

impl ApparentSlopeHistory {
    /// From the reported slopes, newest first; a drone slides beyond `limit`.
    pub fn of(slopes: &[u8], shed: f64) -> Self {
        let slides = |s: &u8| f64::from(*s) * SLOPE_STEP > shed;
        let mut apparent_slope = ApparentSlopeHistory::default();
        let mut calm = 0_usize;
        for s in slopes {
            if !slides(s) {
                calm += 1;
                continue;
            }
            let lasted = SLOPE_WINDOW_S * calm as f64;
            if apparent_slope.since_s.is_none() {
                apparent_slope.since_s = Some(lasted);
            } else if calm >= APART {
                apparent_slope.calm_s = Some(apparent_slope.calm_s.map_or(lasted, |c: f64| c.min(lasted)));
            }
            calm = 0;
        }
        apparent_slope
    }

    /// A drone would have slid a moment ago: the time since, and how long that counts, s.
    pub fn just_now(&self, c: &MissionConfig) -> Option<(f64, f64)> {
        let since = self.since_s.filter(|t| *t < c.slide_over_s)?;
        Some((since, c.slide_over_s))
    }

    /// Why no descent may begin: the time since the last steep wave, and the limit that it breaks, s.
    pub fn rejection(&self, c: &MissionConfig) -> Option<(f64, f64)> {
        let since = self.since_s?;
        if let Some(refused) = self.just_now(c) {
            return Some(refused);
        }
        let calm = self.calm_s.unwrap_or(c.calm_prior_s);
        // Right after a group is the best that such a sea offers.
        let latest = (calm - c.time_to_rest_s).max(c.slide_over_s + SLOPE_WINDOW_S);
        (since > latest).then_some((since, latest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spans(of: &[(u8, usize)]) -> Vec<u8> {
        of.iter().flat_map(|(s, n)| std::iter::repeat_n(*s, *n)).collect()
    }
    fn refused(slopes: &[u8]) -> bool {
        let c = MissionConfig::default();
        ApparentSlopeHistory::of(slopes, c.slide_slope)
            .rejection(&c)
            .is_some()
    }

    #[test]
    fn apparent_slope_permits_descent_when_no_wave_exceeded_the_slide_limit() {
        assert!(!refused(&[]));
        assert!(!refused(&spans(&[(20, 60)])));
    }

    #[test]
    fn apparent_slope_separates_wave_groups_and_keeps_their_shortest_calm() {
        // Two waves of one group, 4 s apart; calms of 20 and 30 s.
        let slopes = spans(&[
            (10, 4),
            (60, 1),
            (10, 2),
            (60, 1),
            (10, 15),
            (70, 2),
            (10, 10),
            (50, 1),
        ]);
        let f = ApparentSlopeHistory::of(&slopes, 0.45);
        assert_eq!((f.since_s, f.calm_s), (Some(8.0), Some(20.0)));
    }

    #[test]
    fn apparent_slope_permits_descent_only_soon_after_a_wave_group() {
        let after = |n: usize| spans(&[(10, n), (60, 2), (10, 15), (60, 2)]);
        let c = MissionConfig::default();
        let (first, last) = (c.slide_over_s, 30.0 - c.time_to_rest_s);
        for n in 0..20 {
            let t = SLOPE_WINDOW_S * n as f64;
            assert_eq!(refused(&after(n)), t < first || t > last, "{t} s after");
        }
        // Nothing of the kind within two minutes: free again.
        assert!(!refused(&spans(&[(10, 60)])));
    }
}

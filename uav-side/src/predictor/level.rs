//! Mean level of the deck, from forecasts.

use alight_shared::{estimation::low_pass, msg::DeckStage, time::DroneTime};

/// Time constant of the level, s: two periods of a long swell.
const LEVEL_TIME_S: f64 = 10.0;
/// Difference between the level and a forecast's mean above which the frame or the estimate has jumped, m; heave is
/// smaller.
const LEVEL_JUMP_M: f64 = 3.0;

/// First-order low-pass of the mean predicted height, NED z. A forecast spans about one wave.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MeanDeckLevel(Option<(DroneTime, f64)>);

impl MeanDeckLevel {
    /// Level after the forecast `stages` at `now`, m. None without a stage.
    pub(super) fn follow(&mut self, now: DroneTime, stages: &[DeckStage]) -> Option<f64> {
        let sum = stages.iter().map(|s| s.position[2]).sum::<f64>();
        let z = (!stages.is_empty()).then(|| sum / stages.len() as f64)?;
        let known = self.0.filter(|(_, level)| (z - level).abs() < LEVEL_JUMP_M);
        let level = known.map_or(z, |(at, level)| {
            low_pass(level, z, (now - at).secs(), LEVEL_TIME_S)
        });
        self.0 = Some((now, level));
        Some(level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::level;
    use alight_shared::time::Time;

    #[test]
    fn level_of_a_heaving_deck_that_moves() {
        let mut deck = MeanDeckLevel::default();
        assert_eq!(deck.follow(Time::EPOCH, &[]), None);
        for k in 0..3000 {
            let t = 0.02 * f64::from(k);
            let mean = if k < 2000 { -1.3 } else { -6.3 };
            let stages: Vec<DeckStage> = (0..41)
                .map(|i| level([0.0, 0.0, mean + 0.8 * (t + 0.1 * f64::from(i)).sin()]))
                .collect();
            let found = deck.follow(Time::from_secs(t), &stages).unwrap();
            let limit_m = if (1000..2000).contains(&k) { 0.1 } else { 0.4 };
            assert!((found - mean).abs() < limit_m, "{t}: {found}");
        }
    }
}

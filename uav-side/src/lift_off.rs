//! Height that a drone has risen from the deck that it stood on.

use alight_shared::time::{DroneClock, Time};

/// Odometry further apart than this counts as this far apart, s.
const MAX_STEP_S: f64 = 1.0;
/// A longer gap, s, may hide when the feet left: at 5 m/s² the mean of two velocities errs by 4 cm over it, and by 0.4 m over 1 s.
const GAP_S: f64 = 0.3;
/// The feet have left the deck once the drone has risen by this, m: three times what velocity and forecast err by in a second.
pub(crate) const LEFT_M: f64 = 0.3;
/// A drone whose feet leave the deck lies on it until it has risen by this, m: then a foot clears a deck that tilts by
/// another 20 deg under it.
pub(crate) const LIES_BELOW_M: f64 = 0.15;
/// The feet leave the deck within this time, s: three times what a drone of half the surplus thrust takes.
pub(crate) const LEAVES_WITHIN_S: f64 = 1.0;

/// Height over the deck since the motors began to lift the drone: `h' = w_deck - w`, both down (NED, m/s), by the mean of each two
/// successive differences. Speeds alone: until the camera sees the deck, its place in the drone's frame is the difference of two
/// receivers', and may jump by metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rise {
    at: Option<Time<DroneClock>>,
    /// Upwards from the deck, m/s.
    speed_mps: Option<f64>,
    risen_m: f64,
    /// Odometry or forecast was missing meanwhile.
    has_gap: bool,
}

impl Rise {
    /// One that begins now.
    pub(crate) fn begun(now: Time<DroneClock>) -> Rise {
        Rise {
            at: Some(now),
            ..Rise::default()
        }
    }
    /// By the velocities of drone and deck at `at`, NED down, m/s; a deck that is not known rests.
    pub(crate) fn update(&mut self, at: Time<DroneClock>, drone_mps: f64, deck_mps: Option<f64>) {
        let dt = self.at.map_or(0.0, |before| (at - before).secs());
        if dt < 0.0 {
            return;
        }
        let speed_mps = deck_mps.unwrap_or(0.0) - drone_mps;
        let mean_mps = 0.5 * (self.speed_mps.unwrap_or(speed_mps) + speed_mps);
        (self.at, self.speed_mps) = (Some(at), Some(speed_mps));
        self.has_gap |= dt > GAP_S || deck_mps.is_none();
        self.risen_m += mean_mps * dt.min(MAX_STEP_S);
    }
    /// Height of the feet over where they stood, m.
    pub(crate) fn risen_m(&self) -> f64 {
        self.risen_m
    }
    /// Every part of it was measured.
    pub(crate) fn is_measured(&self) -> bool {
        !self.has_gap
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rise_over_a_deck_that_heaves() {
        let mut rise = Rise::default();
        for k in 0..=100 {
            let t = 0.01 * f64::from(k);
            let deck = 0.6 * (1.2 * t).cos();
            rise.update(Time::from_secs(t), deck - 2.0, Some(deck));
        }
        assert!((rise.risen_m() - 2.0).abs() < 1e-9, "{}", rise.risen_m());
        assert!(rise.is_measured());
        // What is older counts as nothing, a gap as its longest, and it is remembered.
        rise.update(Time::from_secs(0.5), -1.0, Some(0.0));
        let before_m = rise.risen_m();
        rise.update(Time::from_secs(9.0), -2.0, Some(0.0));
        assert!(
            (rise.risen_m() - before_m - 2.0).abs() < 1e-9,
            "{}",
            rise.risen_m()
        );
        assert!(!rise.is_measured());
    }

    /// A drone that accelerates by 5 m/s² while its odometry is missing for half a second.
    #[test]
    fn rise_over_a_gap() {
        let mut rise = Rise::begun(Time::EPOCH);
        for t in [0.0, 0.1, 0.6] {
            rise.update(Time::from_secs(t), -5.0 * t, Some(0.0));
        }
        assert!((rise.risen_m() - 0.9).abs() < 1e-9 && !rise.is_measured());
        let mut blind = Rise::begun(Time::EPOCH);
        blind.update(Time::from_secs(0.1), 0.0, None);
        assert!(!blind.is_measured(), "of a deck that is not known");
    }
}

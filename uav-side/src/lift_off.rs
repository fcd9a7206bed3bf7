//! How far a drone has risen from the deck that it stood on.

use alight_shared::time::{DroneClock, Time};

/// Odometry further apart than this counts as this far apart, s.
const MAX_STEP_S: f64 = 0.1;
/// The feet have left the deck once the drone has risen by this, m: three times what velocity and forecast err by in a second.
pub(crate) const LEFT_M: f64 = 0.3;
/// A drone whose feet leave the deck lies on it until it has risen by this, m: then a foot clears a deck that tilts by
/// another 20 deg under it.
pub(crate) const LIES_BELOW_M: f64 = 0.15;

/// Height over the deck since the motors began to lift the drone: `h' = w_deck - w`, both down (NED, m/s). Speeds alone: until
/// the camera sees the deck, its place in the drone's frame is the difference of two receivers', and may jump by metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rise {
    at: Option<Time<DroneClock>>,
    risen_m: f64,
}

impl Rise {
    /// By the velocities of drone and deck at `at`, NED down, m/s; a deck that is not known rests.
    pub(crate) fn update(&mut self, at: Time<DroneClock>, drone_mps: f64, deck_mps: Option<f64>) {
        let dt = self.at.map_or(0.0, |before| (at - before).secs());
        if dt < 0.0 {
            return;
        }
        self.at = Some(at);
        self.risen_m += (deck_mps.unwrap_or(0.0) - drone_mps) * dt.min(MAX_STEP_S);
    }
    /// Height of the feet over where they stood, m.
    pub(crate) fn risen_m(&self) -> f64 {
        self.risen_m
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
        // A gap counts as its longest, and what is older as nothing.
        rise.update(Time::from_secs(9.0), -1.0, None);
        rise.update(Time::from_secs(8.0), -1.0, None);
        assert!((rise.risen_m() - 2.1).abs() < 1e-9, "{}", rise.risen_m());
    }
}

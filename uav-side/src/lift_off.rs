//! Height gained above the deck at take-off.

use alight_shared::time::DroneTime;

/// Maximum integration step between two odometry samples, s.
const MAX_STEP_S: f64 = 1.0;
/// Maximum gap that cannot hide the lift-off, s: at 5 m/s² the mean of two velocities is wrong by 4 cm.
const GAP_S: f64 = 0.3;
/// Rise at which the feet have left the deck, m: three times the error of velocity and forecast over a second.
pub(crate) const LEFT_M: f64 = 0.3;
/// Rise below which a drone rests on the deck, m: a foot clears a deck that tilts by another 20 deg.
pub(crate) const LIES_BELOW_M: f64 = 0.15;
/// Time within which the feet leave the deck, s: three times the time needed with half of the surplus thrust.
pub(crate) const LEAVES_WITHIN_S: f64 = 1.0;

/// Height above the deck gained since the rotors began to lift the drone: `h' = w_deck - w`, both down (NED, m/s),
/// integrated by the trapezoidal rule. It uses only velocities, because until the camera detects the deck, the deck's
/// position in the drone's frame is the difference of two GNSS receivers and may jump by metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Rise {
    at: Option<DroneTime>,
    /// Upward speed relative to the deck, m/s.
    speed_mps: Option<f64>,
    risen_m: f64,
    /// Whether odometry or forecast has been missing since the start.
    has_gap: bool,
}

impl Rise {
    pub(crate) fn begun(now: DroneTime) -> Rise {
        Rise {
            at: Some(now),
            ..Rise::default()
        }
    }
    /// Integrates to `at`; velocities are NED down, m/s. An unknown deck counts as at rest.
    pub(crate) fn update(&mut self, at: DroneTime, drone_mps: f64, deck_mps: Option<f64>) {
        let dt = self.at.map_or(0.0, |before| (at - before).secs());
        if dt < 0.0 {
            return;
        }
        let speed_mps = deck_mps.unwrap_or(0.0) - drone_mps;
        let mean_mps = 0.5 * (self.speed_mps.unwrap_or(speed_mps) + speed_mps);
        self.at = Some(at);
        self.speed_mps = Some(speed_mps);
        self.has_gap |= dt > GAP_S || deck_mps.is_none();
        self.risen_m += mean_mps * dt.min(MAX_STEP_S);
    }
    /// Height of the feet above their initial position, m.
    pub(crate) fn risen_m(&self) -> f64 {
        self.risen_m
    }
    pub(crate) fn is_measured(&self) -> bool {
        !self.has_gap
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

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
        // Older samples are ignored; a gap is integrated up to the maximum step and remembered.
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

    /// A drone accelerates at 5 m/s² while its odometry is missing for 0.5 s.
    #[test]
    fn rise_over_a_gap() {
        let mut rise = Rise::begun(Time::EPOCH);
        for t in [0.0, 0.1, 0.6] {
            rise.update(Time::from_secs(t), -5.0 * t, Some(0.0));
        }
        assert!((rise.risen_m() - 0.9).abs() < 1e-9 && !rise.is_measured());
        let mut blind = Rise::begun(Time::EPOCH);
        blind.update(Time::from_secs(0.1), 0.0, None);
        assert!(!blind.is_measured(), "unknown deck");
    }
}

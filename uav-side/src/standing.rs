//! Whether a drone whose rotors turn stands on the deck: what a forced disarm, and a thrust that does not carry it, rest on.
//!
//! Two witnesses have to agree, and none may speak against it. One of them is what carries the drone: with little thrust in force,
//! by the autopilot's report, the specific force stays near gravity only where something else carries it, and falls with the
//! drone where nothing does. The other is a height, which a drone that hovers low over the deck has as well: the rangefinder, the
//! way risen since the rotors could first lift it, the autopilot's own report of the ground. No height speaks against a drone
//! that something carries: a rangefinder may stick.

use alight_shared::time::{DroneClock, Span, Time};

use crate::range_witness::BELOW_FEET_M;

/// The thrust of a drone that something else carries, as a fraction of hover, and of one that the rotors may carry. A thrust
/// that hovers is known no better than to a third before the first flight: this much gives less than [`CARRIED_G`] even then.
const LOW_OF_HOVER: f64 = 0.5;
const LIFTS_OF_HOVER: f64 = 0.9;
/// The specific force of a drone that something carries, as a fraction of gravity, and of one that falls.
const CARRIED_G: f64 = 0.75;
const FALLS_G: f64 = 0.6;
/// Each of these has to last so long: several time constants of the specific force, and the rotors' lag.
const CARRIED: Span = Span::from_millis(300);
const FALLS: Span = Span::from_millis(100);
const LIFTS: Span = Span::from_millis(300);
/// A height speaks against it after so long: what carries a drone that was just armed is known before.
const ABOVE: Span = Span::from_millis(400);
/// Feet on the deck by a height, and feet above it, m: what a rangefinder and a tilted deck differ by, and what a deck that
/// sinks leaves.
const ON_DECK_M: f64 = 0.15;
const ABOVE_M: f64 = 0.35;
/// Both witnesses have to be there within this time after the thrust was cut.
pub(crate) const WITNESSED_WITHIN_S: f64 = 0.7;

/// Conclusion of the witnesses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum StandingVerdict {
    /// Fewer than two speak for it.
    #[default]
    Unknown,
    Stands,
    /// One speaks against it.
    Flies,
}

/// A height of the feet as a witness; None: it is not known, or decides nothing.
pub(crate) fn by_height(height_m: Option<f64>) -> Option<bool> {
    match height_m? {
        h if h <= ON_DECK_M => Some(true),
        h if h > ABOVE_M => Some(false),
        _ => None,
    }
}

/// By a rangefinder: a reading that ends above the feet does not count, since a sensor out of its range reports 0.
pub(crate) fn by_range(height_m: Option<f64>) -> Option<bool> {
    by_height(height_m.filter(|m| *m >= -BELOW_FEET_M))
}

/// The witness of what carries the drone, over time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StandingMonitor {
    carried: Option<Time<DroneClock>>,
    falls: Option<Time<DroneClock>>,
    lifts: Option<Time<DroneClock>>,
    above: Option<Time<DroneClock>>,
}

impl StandingMonitor {
    /// `thrust`: in force, as a fraction of hover; `force`: specific force as a fraction of gravity; None: not reported lately.
    /// `heights`: the other witnesses.
    pub(crate) fn step(
        &mut self,
        now: Time<DroneClock>,
        thrust: Option<f64>,
        force: Option<f64>,
        heights: &[Option<bool>],
    ) -> StandingVerdict {
        let low = thrust.is_some_and(|t| t <= LOW_OF_HOVER);
        let lasts = |since: &mut Option<Time<DroneClock>>, holds: bool, span: Span| {
            *since = holds.then(|| since.unwrap_or(now));
            since.is_some_and(|at| now - at >= span)
        };
        let carried = lasts(
            &mut self.carried,
            low && force.is_some_and(|f| f >= CARRIED_G),
            CARRIED,
        );
        let falls = lasts(&mut self.falls, low && force.is_some_and(|f| f < FALLS_G), FALLS);
        let lifts = lasts(
            &mut self.lifts,
            thrust.is_some_and(|t| t >= LIFTS_OF_HOVER),
            LIFTS,
        );
        let speak = |on_deck: bool| heights.iter().filter(|h| **h == Some(on_deck)).count();
        let above = lasts(&mut self.above, !carried && speak(false) > 0, ABOVE);
        if falls || lifts || above {
            StandingVerdict::Flies
        } else if carried && speak(true) > 0 {
            StandingVerdict::Stands
        } else {
            StandingVerdict::Unknown
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After half a second of this.
    fn after(thrust: Option<f64>, force: Option<f64>, heights: &[Option<bool>]) -> StandingVerdict {
        let mut m = StandingMonitor::default();
        let steps = (0..50).map(|k| m.step(Time::from_secs(0.01 * f64::from(k)), thrust, force, heights));
        steps.last().unwrap()
    }

    #[test]
    fn drone_that_stands_by_two_witnesses() {
        use StandingVerdict::{Flies, Stands, Unknown};
        let (yes, no) = (Some(true), Some(false));
        for (thrust, force, heights, expected) in [
            (Some(0.3), Some(1.0), [yes, None, None], Stands),
            (Some(0.0), Some(1.0), [None, yes, None], Stands),
            // One alone shows nothing: a range that sticks, a report that is wrong, a drone that somebody holds; nor do heights
            // of one that hovers next to the deck.
            (None, None, [yes, yes, yes], Unknown),
            (Some(0.8), Some(1.0), [yes, yes, yes], Unknown),
            // It hovers by a thrust that hovers, which was taken to be a fifth higher.
            (Some(0.65), Some(0.8), [yes, None, None], Unknown),
            (Some(0.3), Some(1.0), [None, None, None], Unknown),
            (None, None, [yes, None, None], Unknown),
            (Some(0.3), None, [None, yes, None], Unknown),
            // A rangefinder that sticks at a height lifts no drone that the deck carries.
            (Some(0.3), Some(1.0), [no, yes, None], Stands),
            (Some(0.3), Some(1.0), [no, None, None], Unknown),
            // One against it suffices: a height, a fall, rotors that carry.
            (None, None, [yes, no, yes], Flies),
            (Some(0.3), Some(0.3), [yes, yes, yes], Flies),
            (Some(1.0), Some(1.0), [yes, None, yes], Flies),
        ] {
            assert_eq!(
                after(thrust, force, &heights),
                expected,
                "{thrust:?}, {force:?}, {heights:?}"
            );
        }
        assert_eq!([0.02, 0.25, 0.5].map(|h| by_height(Some(h))), [yes, None, no]);
        assert_eq!(by_height(Some(f64::NAN)), None);
    }

    /// From its arming on, a rangefinder that sticks at a height lifts no drone.
    #[test]
    fn range_of_a_sensor_out_of_its_range() {
        let feet_m = 0.3;
        let readings = [0.0, 0.25, 0.31, 0.9].map(|range_m| by_range(Some(range_m - feet_m)));
        assert_eq!(readings, [None, Some(true), Some(true), Some(false)]);
    }

    #[test]
    fn rangefinder_that_sticks_on_the_deck() {
        let mut m = StandingMonitor::default();
        for k in 0..100 {
            let now = Time::from_secs(0.01 * f64::from(k));
            let s = m.step(now, Some(0.3), Some(1.0), &[Some(false), Some(true)]);
            assert_ne!(s, StandingVerdict::Flies, "{k}");
        }
    }

    /// The thrust was low a moment ago, and the drone hovers: what carried it then is no witness of now.
    #[test]
    fn thrust_that_has_come_back() {
        let mut m = StandingMonitor::default();
        for k in 0..100 {
            let t = 0.01 * f64::from(k);
            let (thrust, force) = if t < 0.5 { (0.3, 1.0) } else { (0.8, 1.0) };
            let s = m.step(Time::from_secs(t), Some(thrust), Some(force), &[Some(true)]);
            if t > 0.5 {
                assert_eq!(s, StandingVerdict::Unknown);
            }
        }
    }
}

//! Evidence that a drone with turning rotors stands on the deck. A forced disarm and a reduced thrust depend on it.
//!
//! Two witnesses must agree, and none may contradict them. The first is support: at a low thrust, as reported by the
//! autopilot, the specific force stays near gravity only if something other than the rotors carries the drone, and
//! drops in a fall. The second is a height, which a drone that hovers low above the deck also has: the rangefinder, the
//! rise since the rotors could first lift the drone, or the autopilot's own ground report. A height does not overrule
//! the support, because a rangefinder may be stuck.

use alight_shared::time::{DroneTime, Span};

use crate::range_witness::BELOW_FEET_M;

/// Maximum thrust of a supported drone, as a fraction of hover, and thrust from which the rotors may carry it. Before
/// the first flight the hover thrust is known to within a third; [`LOW_OF_HOVER`] then still yields less than
/// [`CARRIED_G`].
const LOW_OF_HOVER: f64 = 0.5;
const LIFTS_OF_HOVER: f64 = 0.9;
/// Specific forces of a supported and of a falling drone, as fractions of gravity.
const CARRIED_G: f64 = 0.75;
const FALLS_G: f64 = 0.6;
/// Durations for which support and fall must last: several time constants of the specific force, and the rotors' lag.
const CARRIED: Span = Span::from_millis(300);
const FALLS: Span = Span::from_millis(100);
const LIFTS: Span = Span::from_millis(300);
/// Time after which a height contradicts the support, which is known earlier for a drone that has just been armed.
const ABOVE: Span = Span::from_millis(400);
/// Heights of the feet that count as on the deck and above it, m; rangefinder, tilt and a sinking deck cause errors.
const ON_DECK_M: f64 = 0.15;
const ABOVE_M: f64 = 0.35;
/// Time after the thrust is cut within which both witnesses must agree.
pub(crate) const WITNESSED_WITHIN_S: f64 = 0.7;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum StandingVerdict {
    #[default]
    Unknown,
    Stands,
    Flies,
}

/// Evidence from the height of the feet; None: unknown or undecided.
pub(crate) fn by_height(height_m: Option<f64>) -> Option<bool> {
    match height_m? {
        h if h <= ON_DECK_M => Some(true),
        h if h > ABOVE_M => Some(false),
        _ => None,
    }
}

/// Evidence from a rangefinder. A reading shorter than the distance to the feet is ignored, because out of range it is
/// 0.
pub(crate) fn by_range(height_m: Option<f64>) -> Option<bool> {
    by_height(height_m.filter(|m| *m >= -BELOW_FEET_M))
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StandingMonitor {
    carried: Option<DroneTime>,
    falls: Option<DroneTime>,
    lifts: Option<DroneTime>,
    above: Option<DroneTime>,
}

impl StandingMonitor {
    /// Verdict from `thrust` (fraction of hover) and specific `force` (fraction of gravity), each None without a recent
    /// report, and from the evidence of `heights`.
    pub(crate) fn step(
        &mut self,
        now: DroneTime,
        thrust: Option<f64>,
        force: Option<f64>,
        heights: &[Option<bool>],
    ) -> StandingVerdict {
        let low = thrust.is_some_and(|t| t <= LOW_OF_HOVER);
        let lasts = |since: &mut Option<DroneTime>, holds: bool, span: Span| {
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
    use alight_shared::time::Time;

    /// Verdict after half a second of constant evidence.
    fn after(thrust: Option<f64>, force: Option<f64>, heights: &[Option<bool>]) -> StandingVerdict {
        let mut m = StandingMonitor::default();
        let steps = (0..50).map(|k| m.step(Time::from_secs(0.01 * f64::from(k)), thrust, force, heights));
        steps.last().unwrap()
    }

    #[test]
    fn drone_that_stands_by_two_witnesses() {
        use StandingVerdict::{Flies, Stands, Unknown};
        let yes = Some(true);
        let no = Some(false);
        for (thrust, force, heights, expected) in [
            (Some(0.3), Some(1.0), [yes, None, None], Stands),
            (Some(0.0), Some(1.0), [None, yes, None], Stands),
            // A single witness is not sufficient, nor are the heights of a drone that hovers next to the deck.
            (None, None, [yes, yes, yes], Unknown),
            (Some(0.8), Some(1.0), [yes, yes, yes], Unknown),
            // The drone hovers, with a hover thrust that was assumed a fifth too high.
            (Some(0.65), Some(0.8), [yes, None, None], Unknown),
            (Some(0.3), Some(1.0), [None, None, None], Unknown),
            (None, None, [yes, None, None], Unknown),
            (Some(0.3), None, [None, yes, None], Unknown),
            // A rangefinder that is stuck at a height does not contradict the support by the deck.
            (Some(0.3), Some(1.0), [no, yes, None], Stands),
            (Some(0.3), Some(1.0), [no, None, None], Unknown),
            // One contradiction suffices: a height, a fall, or rotors that carry the drone.
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

    /// From arming on, a rangefinder that is stuck at a height does not make a drone count as airborne.
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

    /// Support at an earlier low thrust is no evidence while the drone hovers.
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

//! Lapse: distinction of PX4's own hold, after our set-points ceased, from a person's.
//!
//! Both look the same on the link. PX4's own begins COM_OF_LOSS_T after the last set-point and ends with the next one; any
//! other is the will of a person, who has taken the drone over. ArduCopter never holds by itself: its Brake is chosen.

use alight_shared::msg::AutopilotMode;
use alight_shared::time::Span;

use super::modes::Firmware;
use super::{AutopilotLink, DroneTime};

/// Nothing was sent for longer than this, s: five periods of the set-points.
const GAP_S: f64 = 0.1;
/// PX4 leaves OFFBOARD and reports so no later than this after COM_OF_LOSS_T, s: its commander's period, its failsafe, and
/// half of a heartbeat's period.
const REPORTED_WITHIN_S: f64 = 0.5;
/// A predecessor's hold may be its lapse for so long: as long as a mission's checkpoint counts.
const PREDECESSOR: Span = Span::from_millis(5000);
/// PX4 that holds by itself comes back with the first set-points; one that has been sent them for so long, s, does not
/// because a person chose the hold.
const RETURNS_WITHIN_S: f64 = 3.0;

/// The hold's origin, decided where the mode changes and kept until it changes again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LapseMonitor {
    mode: AutopilotMode,
    lapsed: bool,
    /// Began after a link that had commanded a moment before, and has sent nothing yet.
    succeeded_at: Option<DroneTime>,
    /// Set-points have been sent into the hold since.
    streams: Option<DroneTime>,
}

impl LapseMonitor {
    pub(super) fn is_lapsed(&self) -> bool {
        self.lapsed
    }
    /// A link before this one commanded in OFFBOARD until `written`: what it did not see of the mode since began then.
    pub(super) fn succeed(&mut self, now: DroneTime, written: DroneTime) {
        if now - written <= PREDECESSOR {
            self.mode = AutopilotMode::Offboard;
            self.succeeded_at = Some(now);
        }
    }
    /// Takes the autopilot's `mode`. The last set-point went out at `sent_at`; without one PX4 leaves OFFBOARD after
    /// `loss_s`, None for a firmware that does not.
    fn step(&mut self, now: DroneTime, mode: AutopilotMode, sent_at: Option<DroneTime>, loss_s: Option<f64>) {
        if mode != self.mode {
            let left = self.mode == AutopilotMode::Offboard && mode == AutopilotMode::Hold;
            let of_gap = |loss_s: f64| match (sent_at, self.succeeded_at) {
                (Some(at), _) => {
                    let gap_s = (now - at).secs();
                    GAP_S < gap_s && gap_s <= loss_s + REPORTED_WITHIN_S
                }
                (None, Some(at)) => (now - at).secs() <= loss_s + REPORTED_WITHIN_S,
                (None, None) => false,
            };
            self.lapsed = left && loss_s.is_some_and(of_gap);
            self.mode = mode;
        }
        let sends = self.lapsed && sent_at.is_some_and(|at| (now - at).secs() <= GAP_S);
        self.streams = self.streams.filter(|_| sends).or(sends.then_some(now));
        self.lapsed &= self
            .streams
            .is_none_or(|since| (now - since).secs() <= RETURNS_WITHIN_S);
    }
}

impl AutopilotLink {
    /// Judges a hold that has just begun.
    pub(super) fn watch_lapse(&mut self, now: DroneTime) {
        let Some(peer) = &self.peer else { return };
        let loss_s = match peer.firmware {
            Firmware::Px4 => Some(peer.parameters.loss_s()),
            Firmware::ArduCopter => None,
        };
        self.lapse.step(now, peer.mode, self.sent_at, loss_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    const SENT_S: f64 = 10.0;

    /// Whether a hold that is seen so long after the last set-point is a lapse.
    fn lapsed(from: AutopilotMode, to: AutopilotMode, after_s: f64, loss_s: Option<f64>) -> bool {
        let sent_at = Some(Time::from_secs(SENT_S));
        let mut m = LapseMonitor::default();
        m.step(Time::from_secs(SENT_S), from, sent_at, loss_s);
        m.step(Time::from_secs(SENT_S + after_s), to, sent_at, loss_s);
        m.is_lapsed()
    }

    #[test]
    fn lapse_as_a_hold_after_offboard() {
        use AutopilotMode::{Hold, Land, Offboard, Other};
        for (from, to, after_s, loss_s, expected) in [
            (Offboard, Hold, 0.35, Some(0.25), true),
            (Offboard, Hold, 0.7, Some(0.25), true),
            // Set-points went out: a person chose it.
            (Offboard, Hold, 0.02, Some(0.25), false),
            (Offboard, Hold, 0.8, Some(0.25), false),
            (Offboard, Hold, 0.8, Some(0.5), true),
            // ArduCopter's Brake; other modes.
            (Offboard, Hold, 0.35, None, false),
            (Other, Hold, 0.35, Some(0.25), false),
            (Offboard, Land, 0.35, Some(0.25), false),
        ] {
            let found = lapsed(from, to, after_s, loss_s);
            assert_eq!(found, expected, "{from:?} to {to:?} after {after_s} s");
        }
    }

    #[test]
    fn lapse_not_ended_by_set_points() {
        let mut m = LapseMonitor::default();
        let at = |s: f64| Time::from_secs(SENT_S + s);
        m.step(at(0.0), AutopilotMode::Offboard, Some(at(0.0)), Some(0.25));
        m.step(at(0.3), AutopilotMode::Hold, Some(at(0.0)), Some(0.25));
        // The pilot is away: nobody knows.
        m.step(at(60.0), AutopilotMode::Hold, Some(at(0.0)), Some(0.25));
        assert!(m.is_lapsed());
        for k in 0..40 {
            let now = at(60.0 + 0.1 * f64::from(k));
            m.step(now, AutopilotMode::Hold, Some(now), Some(0.25));
            assert_eq!(m.is_lapsed(), k <= 30, "{k}");
        }
    }
}

//! Set-point loss: distinction of PX4's own hold, after our set-points ceased, from a person's.
//!
//! Both look the same on the link. PX4's own begins COM_OF_LOSS_T after the last set-point that it has taken and ends with the
//! next one; any other is the will of a person, who has taken the drone over. Set-points cease where the pilot or this link
//! pauses, where the whole computer stands still (then the link itself does not step), and where the autopilot does, or the
//! wire, which its silence shows. A computer that was suspended with its clock knows of no gap: the autopilot's clock, which went
//! on, shows it. Before this link's first set-point all is a gap: what an armed drone holds for then is not known, and a link
//! before this one may have died. A hold that may have begun in a gap is PX4's own; for a person's it then counts as
//! soon as set-points do not end it. ArduCopter never holds by itself: its Brake is chosen.

use alight_shared::msg::AutopilotMode;

use super::DroneTime;
use super::clock::RemoteClock;
use super::modes::Firmware;
use super::peer::MavlinkPeer;

/// Nothing was sent for longer than this, s: five periods of the set-points.
const GAP_S: f64 = 0.1;
/// PX4 leaves OFFBOARD and reports so no later than this after COM_OF_LOSS_T, s: its commander's period, its failsafe, and
/// half of a heartbeat's period.
const REPORTED_WITHIN_S: f64 = 0.5;
/// PX4 that holds by itself comes back with the first set-points; one that has been sent them for so long, s, does not
/// because a person chose the hold.
const RETURNS_WITHIN_S: f64 = 3.0;

/// Observation of the link in a step.
#[derive(Clone, Copy, Debug)]
struct Observed {
    /// The autopilot's mode.
    mode: AutopilotMode,
    /// Motors may turn.
    armed: bool,
    /// Something of the autopilot arrived in this step.
    received: bool,
    /// When the last set-point went out.
    sent_at: Option<DroneTime>,
    /// Without one PX4 leaves OFFBOARD after this, s; None for a firmware that does not.
    loss_s: Option<f64>,
    /// This computer stood still with its clock: known since, and for how long, s.
    stood_still: Option<(DroneTime, f64)>,
}

/// A stream's newest gap: when it ended, and how long it was, s.
#[derive(Clone, Copy, Debug, Default)]
struct Gaps {
    last: Option<DroneTime>,
    newest: Option<(DroneTime, f64)>,
}

/// A gap in which PX4 that waits `loss_s` for set-points may have begun to hold, of which it may report by `now`.
fn explains((ended, gap_s): (DroneTime, f64), now: DroneTime, loss_s: f64) -> bool {
    gap_s > (loss_s - GAP_S).max(GAP_S) && (now - ended).secs() <= loss_s + REPORTED_WITHIN_S
}

impl Gaps {
    /// The stream has gone on at `at`, known now.
    fn goes_on(&mut self, now: DroneTime, at: DroneTime) {
        let gap_s = self.last.map_or(f64::INFINITY, |last| (at - last).secs());
        if gap_s > GAP_S {
            self.newest = Some((now, gap_s));
        }
        self.last = Some(at);
    }
    fn explains(&self, now: DroneTime, loss_s: f64) -> bool {
        self.newest.is_some_and(|gap| explains(gap, now, loss_s))
    }
}

/// The hold's origin, decided where the mode changes and kept until it changes again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LapseMonitor {
    /// None: not reported yet.
    mode: Option<AutopilotMode>,
    lapsed: bool,
    /// Set-points have been sent into the hold since.
    streams: Option<DroneTime>,
    /// The step before this one.
    stepped: Option<DroneTime>,
    /// Gaps of our set-points, and of the autopilot's messages.
    sent: Gaps,
    received: Gaps,
}

impl LapseMonitor {
    pub(super) fn is_lapsed(&self) -> bool {
        self.lapsed
    }
    /// Judges a hold where it begins.
    fn step(&mut self, now: DroneTime, o: &Observed) {
        let before = self.stepped.replace(now).unwrap_or(now);
        if let Some(at) = o.sent_at.filter(|at| self.sent.last != Some(*at)) {
            self.sent.goes_on(now, at);
        }
        if o.received {
            self.received.goes_on(now, now);
        }
        if self.mode != Some(o.mode) {
            let left = self.mode.is_none_or(|mode| mode == AutopilotMode::Offboard);
            let holds = o.armed && o.mode == AutopilotMode::Hold;
            let follows = |loss_s| {
                let suspended = o.stood_still.is_some_and(|gap| explains(gap, now, loss_s));
                suspended || self.follows_a_gap(now, before, o.sent_at, loss_s)
            };
            self.lapsed = left && holds && o.loss_s.is_some_and(follows);
            self.mode = Some(o.mode);
        }
        let sent_at = o.sent_at;
        let sends = self.lapsed && sent_at.is_some_and(|at| (now - at).secs() <= GAP_S);
        self.streams = self.streams.filter(|_| sends).or(sends.then_some(now));
        let returns = |since: DroneTime| (now - since).secs() <= RETURNS_WITHIN_S;
        self.lapsed &= o.armed && self.streams.is_none_or(returns);
    }
    /// Whether a hold that began between the step `before` and `now` may be PX4's own.
    fn follows_a_gap(
        &self,
        now: DroneTime,
        before: DroneTime,
        sent_at: Option<DroneTime>,
        loss_s: f64,
    ) -> bool {
        let ours = sent_at
            .is_none_or(|at| (now - at).secs() > GAP_S && (before - at).secs() <= loss_s + REPORTED_WITHIN_S);
        ours || self.sent.explains(now, loss_s) || self.received.explains(now, loss_s)
    }
    /// Judges a hold that has just begun; `received`: something of the autopilot arrived in this step.
    pub(super) fn watch(
        &mut self,
        now: DroneTime,
        received: bool,
        sent_at: Option<DroneTime>,
        peer: &MavlinkPeer,
        clock: &RemoteClock,
    ) {
        let loss_s = (peer.firmware == Firmware::Px4).then(|| peer.parameters.loss_s());
        let observed = Observed {
            mode: peer.mode,
            armed: peer.armed,
            received,
            sent_at,
            loss_s,
            stood_still: clock.stood_still(now),
        };
        self.step(now, &observed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    const SENT_S: f64 = 10.0;

    fn at(s: f64) -> DroneTime {
        Time::from_secs(SENT_S + s)
    }
    fn observed(mode: AutopilotMode, sent_s: f64, loss_s: Option<f64>) -> Observed {
        Observed {
            mode,
            armed: true,
            received: true,
            sent_at: Some(at(sent_s)),
            loss_s,
            stood_still: None,
        }
    }
    /// Steps of 10 ms between these times, s.
    fn steps(from_s: f64, to_s: f64) -> impl Iterator<Item = f64> {
        (0..((to_s - from_s) * 100.0).round() as u32).map(move |k| from_s + 0.01 * f64::from(k))
    }

    /// Whether a hold that is observed so long after the last set-point is a lapse.
    fn lapsed(from: AutopilotMode, to: AutopilotMode, after_s: f64, loss_s: Option<f64>) -> bool {
        let mut m = LapseMonitor::default();
        for t in steps(-1.0, after_s) {
            m.step(at(t), &observed(from, t.min(0.0), loss_s));
        }
        m.step(at(after_s), &observed(to, 0.0, loss_s));
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

    /// This computer, or the autopilot's, stands still for so long, s; the hold is reported so long after the gap. Its
    /// set-points go on meanwhile where it is the autopilot that is silent.
    #[test]
    fn lapse_after_a_standstill() {
        use AutopilotMode::{Hold, Offboard};
        for (own, gap_s, after_s, expected) in [
            (true, 0.5, 0.0, true),
            (true, 0.8, 0.0, true),
            (true, 1.5, 0.0, true),
            // Of the frames that have queued up, those of the hold come later.
            (true, 1.5, 0.4, true),
            (false, 0.76, 0.0, true),
            (false, 0.76, 0.4, true),
            // A person's, a second after it or after a hiccup.
            (true, 1.5, 1.0, false),
            (false, 0.76, 1.0, false),
            (true, 0.12, 0.2, false),
            (false, 0.12, 0.2, false),
        ] {
            let mut m = LapseMonitor::default();
            let goes_on = |m: &mut LapseMonitor, t: f64, mode, received| {
                m.step(
                    at(t),
                    &Observed {
                        received,
                        ..observed(mode, t, Some(0.25))
                    },
                );
            };
            for t in steps(-1.0, 0.0) {
                goes_on(&mut m, t, Offboard, true);
            }
            for t in steps(0.0, if own { 0.0 } else { gap_s }) {
                goes_on(&mut m, t, Offboard, false);
            }
            // The step's own set-point goes out after it.
            let observe = |m: &mut LapseMonitor, t: f64, mode| {
                let sent_s = if t > gap_s || !own { t - 0.01 } else { -0.01 };
                m.step(at(t), &observed(mode, sent_s, Some(0.25)));
            };
            for t in steps(gap_s, gap_s + after_s) {
                observe(&mut m, t, Offboard);
            }
            observe(&mut m, gap_s + after_s, Hold);
            assert_eq!(m.is_lapsed(), expected, "own {own}, {gap_s} s, {after_s} s after");
        }
    }

    /// This computer was suspended with its clock: its own set-points show no gap.
    #[test]
    fn lapse_of_a_suspended_computer() {
        for (gap_s, expected) in [(1.5, true), (0.1, false)] {
            let mut m = LapseMonitor::default();
            for t in steps(-1.0, 0.0) {
                m.step(at(t), &observed(AutopilotMode::Offboard, t, Some(0.25)));
            }
            let back = Observed {
                stood_still: Some((at(0.0), gap_s)),
                ..observed(AutopilotMode::Hold, -0.01, Some(0.25))
            };
            m.step(at(0.0), &back);
            assert_eq!(m.is_lapsed(), expected, "{gap_s}");
        }
    }

    /// A link without its predecessor's checkpoint, which has sent nothing, or its first set-point so long before (s).
    #[test]
    fn hold_found_at_the_start() {
        use AutopilotMode::{Hold, Offboard, Other};
        let first = |before: &[AutopilotMode], armed, sent_s: Option<f64>, loss_s| {
            let mut m = LapseMonitor::default();
            for (k, mode) in before.iter().chain([&Hold]).enumerate() {
                let t = 20.0 * k as f64;
                let sent_at = sent_s.filter(|_| *mode == Hold).map(|s| at(t - s));
                let o = Observed {
                    armed,
                    sent_at,
                    ..observed(*mode, 0.0, loss_s)
                };
                m.step(at(t), &o);
            }
            m.is_lapsed()
        };
        let px4 = Some(0.25);
        for (before, armed, sent_s, loss_s, expected) in [
            (&[][..], true, None, px4, true),
            (&[Offboard], true, None, px4, true),
            (&[Offboard], true, Some(0.01), px4, true),
            // A pilot flew it; it stands disarmed; ArduCopter.
            (&[Other], true, None, px4, false),
            (&[], false, None, px4, false),
            (&[], true, None, None, false),
        ] {
            let found = first(before, armed, sent_s, loss_s);
            assert_eq!(
                found, expected,
                "{before:?}, armed {armed}, {sent_s:?}, {loss_s:?}"
            );
        }
    }

    #[test]
    fn lapse_not_ended_by_set_points() {
        let mut m = LapseMonitor::default();
        let mut step = |t: f64, mode, sent_s: f64| {
            m.step(at(t), &observed(mode, sent_s, Some(0.25)));
            m.is_lapsed()
        };
        step(0.0, AutopilotMode::Offboard, 0.0);
        step(0.3, AutopilotMode::Hold, 0.0);
        // The pilot does not react, so that nothing shows who chose the mode.
        assert!(step(60.0, AutopilotMode::Hold, 0.0));
        for k in 0..40 {
            let t = 60.0 + 0.1 * f64::from(k);
            assert_eq!(step(t, AutopilotMode::Hold, t), k <= 30, "{k}");
        }
    }
}

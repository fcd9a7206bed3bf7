//! Set-point loss: distinguishes PX4's own hold after a loss of set-points from a hold chosen by the pilot. The hold is
//! the mode that COM_OBL_RC_ACT gives.
//!
//! Both holds look the same on the link. PX4's own hold begins COM_OF_LOSS_T after the last set-point received and ends
//! with the next one; any other hold is a takeover by the pilot. Set-points stop when the pilot node or this link
//! pauses, when the computer is suspended, and when the autopilot or the serial line stalls, which its silence shows. A
//! computer that is suspended together with its clock sees no gap, but the autopilot's clock shows it. The time before
//! this link's first set-point counts as a gap, because a previous link may have died. A hold that may have begun in a
//! gap is first attributed to PX4, and later to the pilot if set-points do not end it. ArduCopter stays in GUIDED without
//! set-points: its Brake is the pilot's choice or another failsafe's (FS_THR_ENABLE 7), never the end of a gap.

use alight_shared::msg::AutopilotMode;

use super::{DroneTime, clock::RemoteClock, modes::Firmware, peer::MavlinkPeer};

/// Time without a set-point that counts as a gap, s: five periods.
const GAP_S: f64 = 0.1;
/// Maximum time from COM_OF_LOSS_T to PX4's report, s: commander period, failsafe, and half a heartbeat period.
const REPORTED_WITHIN_S: f64 = 0.5;
/// Time within which set-points end PX4's own hold, s; a longer hold is the pilot's.
const RETURNS_WITHIN_S: f64 = 3.0;

#[derive(Clone, Copy, Debug)]
struct Observed {
    mode: AutopilotMode,
    armed: bool,
    received: bool,
    sent_at: Option<DroneTime>,
    /// Time without a set-point after which PX4 leaves OFFBOARD, s; None for other firmware.
    loss_s: Option<f64>,
    /// Mode that PX4 then enters.
    loss_mode: AutopilotMode,
    /// Suspension of the computer together with its clock: time of detection, and duration in s.
    stood_still: Option<(DroneTime, f64)>,
}

/// End and length (s) of a stream's newest gap.
#[derive(Clone, Copy, Debug, Default)]
struct Gaps {
    last: Option<DroneTime>,
    newest: Option<(DroneTime, f64)>,
}

/// Whether a gap can explain a PX4 hold reported by `now`; `loss_s` is PX4's set-point timeout.
fn explains((ended, gap_s): (DroneTime, f64), now: DroneTime, loss_s: f64) -> bool {
    gap_s > (loss_s - GAP_S).max(GAP_S) && (now - ended).secs() <= loss_s + REPORTED_WITHIN_S
}

impl Gaps {
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

/// Decides the origin of a hold when the mode changes, and keeps it until the next change.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetPointLossMonitor {
    /// Newest mode; None before the first report.
    mode: Option<AutopilotMode>,
    lost: bool,
    /// Time since which set-points have been sent during the hold.
    streams: Option<DroneTime>,
    stepped: Option<DroneTime>,
    /// Gaps in our set-points and in the autopilot's messages.
    sent: Gaps,
    received: Gaps,
}

impl SetPointLossMonitor {
    pub(super) fn is_lost(&self) -> bool {
        self.lost
    }
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
            let holds = o.armed && o.mode == o.loss_mode;
            let follows = |loss_s| {
                let suspended = o.stood_still.is_some_and(|gap| explains(gap, now, loss_s));
                suspended || self.follows_a_gap(now, before, o.sent_at, loss_s)
            };
            self.lost = left && holds && o.loss_s.is_some_and(follows);
            self.mode = Some(o.mode);
        }
        let sent_at = o.sent_at;
        let sends = self.lost && sent_at.is_some_and(|at| (now - at).secs() <= GAP_S);
        self.streams = self.streams.filter(|_| sends).or(sends.then_some(now));
        let returns = |since: DroneTime| (now - since).secs() <= RETURNS_WITHIN_S;
        self.lost &= o.armed && self.streams.is_none_or(returns);
    }
    /// Whether a hold that began between `before` and `now` may be PX4's own.
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
    /// Classifies a new hold. `received`: whether the autopilot sent a message in this step.
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
            loss_mode: peer.parameters.loss_mode(),
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
            loss_mode: AutopilotMode::Hold,
            stood_still: None,
        }
    }
    fn steps(from_s: f64, to_s: f64) -> impl Iterator<Item = f64> {
        (0..((to_s - from_s) * 100.0).round() as u32).map(move |k| from_s + 0.01 * f64::from(k))
    }

    /// Whether a hold that begins `after_s` after the last set-point counts as a set-point loss.
    fn lost(from: AutopilotMode, to: AutopilotMode, after_s: f64, loss_s: Option<f64>) -> bool {
        let mut m = SetPointLossMonitor::default();
        for t in steps(-1.0, after_s) {
            m.step(at(t), &observed(from, t.min(0.0), loss_s));
        }
        m.step(at(after_s), &observed(to, 0.0, loss_s));
        m.is_lost()
    }

    #[test]
    fn set_point_loss_as_a_hold_after_offboard() {
        use AutopilotMode::{Hold, Land, Offboard, Other};
        for (from, to, after_s, loss_s, expected) in [
            (Offboard, Hold, 0.35, Some(0.25), true),
            (Offboard, Hold, 0.7, Some(0.25), true),
            (Offboard, Hold, 0.02, Some(0.25), false),
            (Offboard, Hold, 0.8, Some(0.25), false),
            (Offboard, Hold, 0.8, Some(0.5), true),
            // ArduCopter's Brake, and other modes.
            (Offboard, Hold, 0.35, None, false),
            (Other, Hold, 0.35, Some(0.25), false),
            (Offboard, Land, 0.35, Some(0.25), false),
        ] {
            let found = lost(from, to, after_s, loss_s);
            assert_eq!(found, expected, "{from:?} to {to:?} after {after_s} s");
        }
    }

    /// This computer or the autopilot stalls for `gap_s`, and the hold is reported `after_s` later.
    #[test]
    fn set_point_loss_after_a_standstill() {
        use AutopilotMode::{Hold, Offboard};
        for (own, gap_s, after_s, expected) in [
            (true, 0.5, 0.0, true),
            (true, 0.8, 0.0, true),
            (true, 1.5, 0.0, true),
            // The frames that report the hold are at the end of a long queue.
            (true, 1.5, 0.4, true),
            (false, 0.76, 0.0, true),
            (false, 0.76, 0.4, true),
            // Hold by the pilot: a second after the gap, or after a delay too short for a loss.
            (true, 1.5, 1.0, false),
            (false, 0.76, 1.0, false),
            (true, 0.12, 0.2, false),
            (false, 0.12, 0.2, false),
        ] {
            let mut m = SetPointLossMonitor::default();
            let goes_on = |m: &mut SetPointLossMonitor, t: f64, mode, received| {
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
            // The step's own set-point is sent after the observation.
            let observe = |m: &mut SetPointLossMonitor, t: f64, mode| {
                let sent_s = if t > gap_s || !own { t - 0.01 } else { -0.01 };
                m.step(at(t), &observed(mode, sent_s, Some(0.25)));
            };
            for t in steps(gap_s, gap_s + after_s) {
                observe(&mut m, t, Offboard);
            }
            observe(&mut m, gap_s + after_s, Hold);
            assert_eq!(m.is_lost(), expected, "own {own}, {gap_s} s, {after_s} s after");
        }
    }

    /// When a computer is suspended together with its clock, its set-points show no gap.
    #[test]
    fn set_point_loss_of_a_suspended_computer() {
        for (gap_s, expected) in [(1.5, true), (0.1, false)] {
            let mut m = SetPointLossMonitor::default();
            for t in steps(-1.0, 0.0) {
                m.step(at(t), &observed(AutopilotMode::Offboard, t, Some(0.25)));
            }
            let back = Observed {
                stood_still: Some((at(0.0), gap_s)),
                ..observed(AutopilotMode::Hold, -0.01, Some(0.25))
            };
            m.step(at(0.0), &back);
            assert_eq!(m.is_lost(), expected, "{gap_s}");
        }
    }

    /// A link without its predecessor's checkpoint, before or just after its first set-point.
    #[test]
    fn hold_found_at_the_start() {
        use AutopilotMode::{Hold, Offboard, Other};
        let first = |before: &[AutopilotMode], armed, sent_s: Option<f64>, loss_s| {
            let mut m = SetPointLossMonitor::default();
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
            m.is_lost()
        };
        let px4 = Some(0.25);
        for (before, armed, sent_s, loss_s, expected) in [
            (&[][..], true, None, px4, true),
            (&[Offboard], true, None, px4, true),
            (&[Offboard], true, Some(0.01), px4, true),
            // The pilot flew the drone; the drone is disarmed; the firmware is ArduCopter.
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
    fn set_point_loss_not_ended_by_set_points() {
        let mut m = SetPointLossMonitor::default();
        let mut step = |t: f64, mode, sent_s: f64| {
            m.step(at(t), &observed(mode, sent_s, Some(0.25)));
            m.is_lost()
        };
        step(0.0, AutopilotMode::Offboard, 0.0);
        step(0.3, AutopilotMode::Hold, 0.0);
        // As long as the pilot does not act, the origin of the hold stays unknown.
        assert!(step(60.0, AutopilotMode::Hold, 0.0));
        for k in 0..40 {
            let t = 60.0 + 0.1 * f64::from(k);
            assert_eq!(step(t, AutopilotMode::Hold, t), k <= 30, "{k}");
        }
    }
}

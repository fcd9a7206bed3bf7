//! Hold that a failsafe has chosen because the remote control is lost.
//!
//! A landing is safer completed than held over a heaving deck, so the link asks for its mode back. This needs positive
//! evidence: the autopilot left our mode for a hold, its parameter, as reported, selects this hold, and within 1 s
//! HEARTBEAT.system_status rose to CRITICAL and the loss was reported (SYS_STATUS, or ArduCopter's text). Without all of
//! it the hold is a person's, and nothing contests it. CRITICAL lasts as long as the loss, so a later hold is a person's
//! even then.
//!
//! Sources: PX4's `failsafe/framework.cpp` and `Commander` (1.16); ArduCopter's `events.cpp` (4.6).

use alight_shared::{msg::AutopilotMode, time::Span};

use super::{
    AutopilotOut, DroneTime,
    message::{CommandLong, severity},
    peer::MavlinkPeer,
};

/// Maximum time between the mode change and its evidence: PX4's heartbeat comes once a second.
const EVIDENT_WITHIN: Span = Span::from_millis(1100);
const MAX_REQUESTS: u32 = 3;
/// Time between two requests; PX4 needs set-points for a second before it accepts the first one.
const SPACING: Span = Span::from_millis(1000);

/// Hold that began in the middle of a landing.
#[derive(Clone, Copy, Debug)]
struct Held {
    since: DroneTime,
    confirmed: bool,
    next: DroneTime,
}

#[derive(Clone, Debug, Default)]
pub(super) struct FailsafeMonitor {
    mode: Option<AutopilotMode>,
    was_critical: bool,
    /// Newest time at which HEARTBEAT.system_status became CRITICAL.
    rose: Option<DroneTime>,
    /// Newest text that says that the remote control is lost.
    named: Option<DroneTime>,
    held: Option<Held>,
    /// Number of requests since CRITICAL rose.
    requests: u32,
}

impl FailsafeMonitor {
    /// Whether a failsafe holds the drone, or its evidence may still arrive.
    pub(super) fn holds(&self) -> bool {
        self.held.is_some()
    }
    /// Notes one of the autopilot's warnings.
    pub(super) fn on_text(&mut self, now: DroneTime, text: &str) {
        if text.starts_with("Radio Failsafe") {
            self.named = Some(now);
        }
    }
    /// An operator has withdrawn the order to land.
    pub(super) fn withdraw(&mut self) {
        self.held = None;
    }
    /// `lands`: whether the mission flies a landing; `remote_lost`: whether the autopilot reports no receiver.
    pub(super) fn step(&mut self, now: DroneTime, peer: &MavlinkPeer, lands: bool, remote_lost: bool) {
        if peer.is_critical && !self.was_critical {
            self.rose = Some(now);
            self.requests = 0;
        }
        self.was_critical = peer.is_critical;
        let before = self.mode.replace(peer.mode);
        if before != Some(peer.mode) {
            let from_ours = before == Some(AutopilotMode::Offboard) && peer.mode == AutopilotMode::Hold;
            self.held = None;
            if from_ours && lands && peer.parameters.remote_loss_holds() {
                self.held = Some(Held {
                    since: now,
                    confirmed: false,
                    next: now,
                });
            }
        }
        let Some(held) = &mut self.held else { return };
        let is_near = |event: Option<DroneTime>| {
            event.is_some_and(|at| (at - held.since).secs().abs() <= EVIDENT_WITHIN.secs())
        };
        held.confirmed |= is_near(self.rose) && (remote_lost || is_near(self.named));
        let over = if held.confirmed {
            self.requests >= MAX_REQUESTS && now >= held.next
        } else {
            now - held.since > EVIDENT_WITHIN
        };
        if over || !peer.armed {
            self.held = None;
        }
    }
    /// Asks for our mode, at most [`MAX_REQUESTS`] times.
    pub(super) fn ask(&mut self, now: DroneTime, peer: &MavlinkPeer, out: &mut AutopilotOut) {
        let Some(held) = &mut self.held else { return };
        if !held.confirmed || self.requests >= MAX_REQUESTS || now < held.next {
            return;
        }
        self.requests += 1;
        held.next = now + SPACING;
        if self.requests == 1 {
            let autopilot = peer.firmware.name();
            let text = format!(
                "{autopilot} holds because the remote control is lost: the landing asks for its mode"
            );
            out.alarm(severity::WARNING, text);
        }
        out.send(CommandLong::mode(peer.address, peer.firmware.offboard()));
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{
            config::AutopilotLinkConfig,
            message::{Address, MavlinkMessage, ParameterValue},
            modes::Firmware,
        },
        *,
    };
    use alight_shared::time::Time;

    const TO: Address = Address::new(1, 1);

    /// Requests within 10 s after a hold at 5 s, with CRITICAL from `rises_s` on; NAV_RCL_ACT is `action`.
    fn requests(action: f64, rises_s: f64, remote_lost: bool, lands: bool) -> usize {
        let mut peer = MavlinkPeer::new(
            TO,
            Firmware::Px4,
            Time::EPOCH,
            &AutopilotLinkConfig::default(),
            true,
        );
        peer.parameters.on_version([1, 16]);
        let value: ParameterValue = Firmware::Px4.parameter_value(action, true);
        peer.parameters.received("NAV_RCL_ACT", value);
        peer.armed = true;
        peer.mode = AutopilotMode::Offboard;
        let mut monitor = FailsafeMonitor::default();
        let mut out = AutopilotOut::default();
        for k in 0..150 {
            let t_s = 0.1 * f64::from(k);
            let now = Time::from_secs(t_s);
            if t_s >= 5.0 {
                peer.mode = AutopilotMode::Hold;
            }
            peer.is_critical = t_s >= rises_s;
            monitor.step(now, &peer, lands, remote_lost && t_s >= rises_s);
            monitor.ask(now, &peer, &mut out);
        }
        assert!(!monitor.holds());
        out.messages
            .iter()
            .filter(|m| !matches!(m, MavlinkMessage::Text { .. }))
            .count()
    }

    #[test]
    fn evidence_of_a_failsafes_hold() {
        assert_eq!(requests(1.0, 5.0, true, true), 3);
        // The heartbeat comes a second after the mode.
        assert_eq!(requests(1.0, 6.0, true, true), 3);
        // Each part of the evidence lacks once: the return as action, CRITICAL long before or never, the cause, a landing.
        assert_eq!(requests(2.0, 5.0, true, true), 0);
        assert_eq!(requests(1.0, 2.0, true, true), 0);
        assert_eq!(requests(1.0, 99.0, true, true), 0);
        assert_eq!(requests(1.0, 5.0, false, true), 0);
        assert_eq!(requests(1.0, 5.0, true, false), 0);
    }
}

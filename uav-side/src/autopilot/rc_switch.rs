//! Three-position switch on the remote control: low aborts, middle does nothing, high lands.
//!
//! Only a change between two held positions gives a command. The initial position, and the first one after a
//! loss of the remote control, give none, so a switch left on high does not start a landing. The mission
//! applies its own rules to the command.

use alight_shared::{
    mavlink::{
        dialect::{MavSysStatusSensor, RC_CHANNELS_DATA},
        fields,
    },
    msg::{Command, CommandKind, Header, MissionState},
    time::{DroneClock, Span},
};

use super::{
    DroneTime,
    orders::{self, SentCommand},
};

/// Silence of the channel after which the remote control counts as lost.
const LOST: Span = Span::from_millis(600);
const PULSES_US: core::ops::RangeInclusive<u16> = 800..=2200;
/// Pulse limits of the positions, us; values in between belong to no position.
const LOW_US: u16 = 1300;
const MIDDLE_US: core::ops::RangeInclusive<u16> = 1400..=1600;
const HIGH_US: u16 = 1700;
/// Time for which low or middle must be held. A receiver's failsafe may move the channel before the autopilot
/// reports the loss; an unnecessary abort is acceptable.
const HELD: Span = Span::from_millis(500);
/// Time for which high must be held: long enough for a loss to be reported (PX4: COM_RC_LOSS_T 0.5 s).
const HELD_HIGH: Span = Span::from_millis(1500);
const MIN_READINGS: u32 = 3;
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Position {
    Low,
    Middle,
    High,
}

impl Position {
    fn of(pulse_us: u16) -> Option<Position> {
        match pulse_us {
            us if us <= LOW_US => Some(Position::Low),
            us if us >= HIGH_US => Some(Position::High),
            us if MIDDLE_US.contains(&us) => Some(Position::Middle),
            _ => None,
        }
    }
    fn held(self) -> Span {
        match self {
            Position::Low | Position::Middle => HELD,
            Position::High => HELD_HIGH,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    position: Position,
    since: DroneTime,
    readings: u32,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RcSwitch {
    /// Accepted position; None until one has been held after the start or after a loss of the remote control.
    position: Option<Position>,
    candidate: Option<Candidate>,
    received_at: Option<DroneTime>,
    /// Time of the last report that the receiver works; None if there was none, as with some firmware.
    healthy_at: Option<DroneTime>,
    lost: bool,
    given: Option<SentCommand>,
}

impl RcSwitch {
    /// Processes the sensor status. PX4 reports a working receiver as present, ArduCopter as healthy.
    pub(super) fn on_status(
        &mut self,
        now: DroneTime,
        present: MavSysStatusSensor,
        healthy: MavSysStatusSensor,
    ) {
        if (present & healthy).contains(MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_RC_RECEIVER) {
            self.healthy_at = Some(now);
            self.lost = false;
        } else if self.healthy_at.is_some() {
            self.lost = true;
            self.forget();
        }
    }
    /// Processes the channels, with the switch on number `channel` (from 1). Returns the command that a
    /// change gives.
    pub(super) fn on_channels(
        &mut self,
        now: DroneTime,
        channel: u8,
        channels: &RC_CHANNELS_DATA,
    ) -> Option<CommandKind> {
        let pulse_us = pulse_us(channel, channels).filter(|us| !self.lost && PULSES_US.contains(us));
        let Some(pulse_us) = pulse_us else {
            self.forget();
            return None;
        };
        self.received_at = Some(now);
        let position = Position::of(pulse_us);
        match (&mut self.candidate, position) {
            (Some(c), Some(p)) if c.position == p => c.readings = c.readings.saturating_add(1),
            (candidate, position) => {
                *candidate = position.map(|position| Candidate {
                    position,
                    since: now,
                    readings: 1,
                });
            }
        }
        self.accept_held(now)
    }
    fn accept_held(&mut self, now: DroneTime) -> Option<CommandKind> {
        let c = self.candidate?;
        let works = self.healthy_at.is_none_or(|at| at >= c.since);
        if self.position == Some(c.position)
            || now - c.since < c.position.held()
            || c.readings < MIN_READINGS
            || !works
        {
            return None;
        }
        self.position.replace(c.position)?;
        match c.position {
            Position::Low => Some(CommandKind::Abort),
            Position::Middle => None,
            Position::High => Some(CommandKind::Land),
        }
    }
    pub(super) fn is_remote_lost(&self) -> bool {
        self.lost
    }
    fn forget(&mut self) {
        self.position = None;
        self.candidate = None;
        self.received_at = None;
    }
    /// Whether the switch aborts or is on abort, so that no landing is accepted.
    pub(super) fn bars(&self) -> bool {
        let aborts = |o: SentCommand| o.message.kind == CommandKind::Abort;
        self.position == Some(Position::Low) || self.given.is_some_and(aborts)
    }
    /// Whether the switch is held on abort, so that no order to land or take off is accepted. A switch that
    /// moves away from abort does not block its own command.
    pub(super) fn is_held_on_abort(&self) -> bool {
        let low = |p: Position| p == Position::Low;
        self.position.is_some_and(low) && self.candidate.is_none_or(|c| low(c.position))
    }
    pub(super) fn give(&mut self, header: Header<DroneClock>, kind: CommandKind) {
        self.given = Some(orders::sent(header, kind));
    }
    /// Order to publish now, and a text on a failed order. Also detects loss of the remote control.
    pub(super) fn poll(
        &mut self,
        now: DroneTime,
        mission: Option<&MissionState>,
    ) -> (Option<Command>, Option<String>) {
        if self.received_at.is_some_and(|at| now - at > LOST) {
            self.forget();
        }
        let Some(given) = &mut self.given else {
            return (None, None);
        };
        let Some(taken) = orders::outcome(given, now, mission) else {
            return (given.due(now), None);
        };
        let text = (!taken).then(|| orders::rejection_text(given, mission));
        self.given = None;
        (None, text)
    }
}

/// Pulse of a channel (from 1), us; None for a channel that the receiver lacks.
fn pulse_us(channel: u8, d: &RC_CHANNELS_DATA) -> Option<u16> {
    let pulses_us = fields!(d, chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw);
    if channel > d.chancount {
        return None;
    }
    let place = usize::from(channel).checked_sub(1)?;
    pulses_us.get(place).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use CommandKind::{Abort, Land};
    use alight_shared::{
        msg::{ReasonCode, State},
        time::Time,
    };

    const CHANNEL: u8 = 7;
    const RECEIVER: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_RC_RECEIVER;
    const NONE: MavSysStatusSensor = MavSysStatusSensor::empty();

    fn at(s: f64) -> DroneTime {
        Time::from_secs(s)
    }
    /// Channels with the switch on number [`CHANNEL`].
    fn channels(chan7_raw: u16) -> RC_CHANNELS_DATA {
        RC_CHANNELS_DATA {
            chancount: 8,
            chan7_raw,
            ..RC_CHANNELS_DATA::DEFAULT
        }
    }

    /// Commands given by a switch with these pulses (us; 0: none) and durations (s) at 10 Hz. With
    /// `reports_health`, the receiver's health is reported at 5 Hz.
    fn commands(reports_health: bool, course: &[(u16, f64)]) -> Vec<CommandKind> {
        let mut switch = RcSwitch::default();
        let mut now_s = 100.0;
        let mut all = Vec::new();
        for &(pulse_us, for_s) in course {
            for k in 0..(10.0 * for_s) as u32 {
                now_s += 0.1;
                if reports_health && k % 2 == 0 {
                    let healthy = if pulse_us == 0 { NONE } else { RECEIVER };
                    switch.on_status(at(now_s), RECEIVER, healthy);
                }
                if pulse_us != 0 {
                    all.extend(switch.on_channels(at(now_s), CHANNEL, &channels(pulse_us)));
                }
                assert_eq!(switch.poll(at(now_s), None), (None, None));
            }
        }
        all
    }

    #[test]
    fn rc_switch_held_changes() {
        const LOW: u16 = 1000;
        const MIDDLE: u16 = 1500;
        const HIGH: u16 = 2000;
        for reports_health in [false, true] {
            for (course, expected) in [
                (&[(LOW, 9.0)][..], &[][..]),
                (&[(HIGH, 9.0)], &[]),
                (&[(HIGH, 3.0), (MIDDLE, 3.0)], &[]),
                (&[(MIDDLE, 3.0), (HIGH, 3.0)], &[Land]),
                (&[(MIDDLE, 3.0), (LOW, 1.0)], &[Abort]),
                (&[(HIGH, 3.0), (LOW, 1.0)], &[Abort]),
                (&[(LOW, 3.0), (MIDDLE, 3.0), (LOW, 1.0)], &[Abort]),
                (
                    &[(MIDDLE, 3.0), (HIGH, 3.0), (LOW, 3.0), (HIGH, 3.0)],
                    &[Land, Abort, Land],
                ),
                // A position held too briefly, or a pulse between two positions.
                (&[(MIDDLE, 3.0), (LOW, 0.3), (MIDDLE, 3.0)], &[]),
                (&[(MIDDLE, 3.0), (HIGH, 1.0), (MIDDLE, 3.0)], &[]),
                (&[(MIDDLE, 3.0), (1350, 3.0), (1650, 3.0)], &[]),
                // The remote control is lost and returns with the switch in another position.
                (&[(MIDDLE, 3.0), (0, 2.0), (HIGH, 9.0)], &[]),
                (&[(MIDDLE, 3.0), (0, 2.0), (LOW, 9.0)], &[]),
                (&[(HIGH, 3.0), (0, 2.0), (MIDDLE, 3.0), (HIGH, 3.0)], &[Land]),
                (&[(MIDDLE, 3.0), (500, 3.0)], &[]),
                (&[(MIDDLE, 3.0), (65535, 3.0)], &[]),
            ] {
                assert_eq!(commands(reports_health, course), expected, "{course:?}");
            }
        }
    }

    #[test]
    fn rc_switch_held_on_abort() {
        let mut switch = RcSwitch::default();
        let mut held = |from_s: f64, pulse_us: u16| {
            for k in 0..10 {
                switch.on_channels(at(from_s + 0.1 * f64::from(k)), CHANNEL, &channels(pulse_us));
            }
            switch.is_held_on_abort()
        };
        assert_eq!([held(0.0, 1500), held(1.0, 1000)], [false, true]);
        assert!(!held(2.0, 2000));
        assert_eq!([held(3.0, 1000), held(4.0, 65535)], [true, false], "lost");
    }

    #[test]
    fn rc_switch_with_a_receiver_failsafe() {
        // The receiver sets the channel to high a second before the loss is reported.
        let mut switch = RcSwitch::default();
        for k in 0..100 {
            let now = at(0.1 * f64::from(k));
            let high = k >= 30;
            let healthy = if k >= 40 { NONE } else { RECEIVER };
            switch.on_status(now, RECEIVER, healthy);
            let given = switch.on_channels(now, CHANNEL, &channels(if high { 2000 } else { 1500 }));
            assert_eq!(given, None, "{k}");
        }
    }

    #[test]
    fn rc_switch_on_a_missing_channel() {
        let mut switch = RcSwitch::default();
        for k in 0..100 {
            let c = RC_CHANNELS_DATA {
                chancount: 6,
                ..channels(if k < 50 { 1500 } else { 1000 })
            };
            assert_eq!(switch.on_channels(at(0.1 * f64::from(k)), CHANNEL, &c), None);
        }
    }

    #[test]
    fn rc_switch_command_repetition() {
        let mission = |s, state, waiting: ReasonCode, abort| MissionState {
            header: Header::new(0, 1, 5, 1, at(s)),
            state,
            waiting: waiting.into(),
            abort,
            ..MissionState::default()
        };
        let before = mission(9.9, State::Tracking, ReasonCode::NotSteady, None);
        let other = mission(11.0, State::GaveUp, ReasonCode::Operator, Some([7, 2]));
        let own = mission(11.0, State::GaveUp, ReasonCode::Operator, Some([7, 3]));
        let published = |kind, mission: &MissionState| {
            let mut switch = RcSwitch::default();
            switch.give(Header::new(0, 1, 7, 3, at(10.0)), kind);
            let polls =
                (0..1000).filter_map(|k| switch.poll(at(10.0 + 0.01 * f64::from(k)), Some(mission)).0);
            polls.map(|c| assert_eq!(c.header.at, at(10.0))).count()
        };
        // The order is published every 0.25 s for 5 s while the mission's state does not reflect it.
        assert_eq!(published(Abort, &before), 21);
        assert_eq!(published(Abort, &other), 21);
        assert_eq!(published(Abort, &own), 0);
        assert_eq!(published(Land, &before), 21);
        let taken = MissionState {
            order: Some([7, 3]),
            ..mission(10.1, State::Approach, ReasonCode::TooFar, None)
        };
        assert_eq!(published(Land, &taken), 0);
    }
}

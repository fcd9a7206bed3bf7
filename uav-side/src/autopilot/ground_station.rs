//! Landing reports to a ground station through the autopilot: a text for each change of the mission's state
//! and for each alarm, and four named values at a low rate.

use alight_shared::{
    admission::Periodic,
    mavlink::dialect::NAMED_VALUE_FLOAT_DATA,
    msg::{MissionState, ReasonCode, State, Wind},
    time::{DroneClock, Span},
};
use nalgebra::Vector3;

use super::{
    AutopilotOut, DroneTime,
    clock::RemoteClock,
    drone_state::DroneEstimate,
    inputs::LinkInputs,
    message::{MavMessage, MavlinkMessage, chars, severity},
    moving_base::RelativeReports,
    rc_switch::RcSwitch,
    station::StationOrders,
    station_parameters::StationParameters,
};

const VALUES: Span = Span::from_millis(500);
/// Time for which the mission must wait for one condition before it is reported.
const WAITS: Span = Span::from_millis(3000);
/// Text for an abort or hold given so low that a climb would hit the deck harder than the landing.
const STOPPED_LOW: &str = "Stopped too low to climb: completes the landing";
/// Name of the value with the distance between the centres of drone and deck, m.
pub const DISTANCE: &str = "deck_m";
/// Name of the value with the age of the vessel estimate behind the forecast, s.
pub const AGE: &str = "link_age_s";
/// Names of the values with the true wind speed, m/s, and the direction that the wind comes from, deg.
pub const WIND: [&str; 2] = ["wind_mps", "wind_deg"];

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GroundReports {
    entered: Option<(State, DroneTime)>,
    /// Awaited condition, start of the wait, and whether it was reported.
    waiting: Option<(ReasonCode, DroneTime, bool)>,
    rejected: Option<ReasonCode>,
    relative: RelativeReports,
    values: Periodic<DroneClock>,
}

impl AutopilotOut {
    pub(super) fn alarm(&mut self, severity: u8, text: String) {
        self.messages.push(status_text(severity, &text));
        self.texts.push(text);
    }
    pub(super) fn send(&mut self, message: impl Into<MavlinkMessage>) {
        self.messages.push(message.into());
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Operators {
    pub(super) reports: GroundReports,
    pub(super) switch: RcSwitch,
    pub(super) station: StationOrders,
    pub(super) parameters: StationParameters,
}

impl Operators {
    /// Publishes an order from the remote control's switch or a ground station; an abort takes precedence.
    pub(super) fn publish_order(&mut self, now: DroneTime, m: Option<&MissionState>, out: &mut AutopilotOut) {
        let (by_switch, rejection) = if self.station.aborts() {
            (None, None)
        } else {
            self.switch.poll(now, m)
        };
        if let Some(text) = rejection {
            out.alarm(severity::WARNING, text);
        }
        if by_switch.is_some() {
            out.command = by_switch;
            return;
        }
        let (command, answer) = self.station.poll(now, m);
        out.command = command;
        if let Some(answer) = answer {
            out.messages.extend(answer.messages());
            if let Some(text) = answer.text {
                out.alarm(severity::WARNING, text);
            }
        }
    }
}

impl GroundReports {
    /// Reports changes of the mission's state and of the moving base, and named values when due.
    pub(super) fn publish(
        &mut self,
        now: DroneTime,
        inputs: &LinkInputs,
        estimate: &DroneEstimate,
        clock: &RemoteClock,
        out: &mut AutopilotOut,
    ) {
        let mission = inputs.mission.get();
        out.messages.extend(mission.and_then(|m| self.report(now, m)));
        if let Some(forecast) = inputs.fresh_forecast(now)
            && let Some((severity, text)) = self.relative.change(now, forecast.relative.as_ref())
        {
            out.alarm(severity, text);
        }
        if !self.values.is_due_spaced(now, VALUES) {
            return;
        }
        let time_boot_ms = (clock.remote_time_us(now, now) / 1000) as u32;
        let wind = estimate.state.and_then(|s| s.wind).map(Wind::towards);
        let apart = (estimate.fresh(now).zip(inputs.deck(now)))
            .map(|(state, deck)| (Vector3::from(deck.position) - state.position()).norm());
        let values = [
            (DISTANCE, apart),
            (AGE, inputs.link_age_s(now)),
            (WIND[0], wind.map(|w| w.speed_mps)),
            (WIND[1], wind.map(|w| w.from_deg as f64)),
        ];
        for (name, value) in values {
            if let Some(value) = value {
                out.send(MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
                    time_boot_ms,
                    value: value as f32,
                    name: chars(name),
                }));
            }
        }
    }
    /// Text for a new state, otherwise for the awaited condition.
    fn report(&mut self, now: DroneTime, m: &MissionState) -> Option<MavlinkMessage> {
        if self.entered != Some((m.state, m.since)) {
            self.entered = Some((m.state, m.since));
            self.waiting = None;
            return Some(status_text(severity_of(m), &m.state.because(&m.entered)));
        }
        let rejected = m.rejected.map(|why| why.code);
        if core::mem::replace(&mut self.rejected, rejected) != rejected
            && let Some(why) = m.rejected
        {
            return Some(status_text(severity::WARNING, &why.to_string()));
        }
        let code = m.waiting.code;
        match &mut self.waiting {
            Some((known, since, reported)) if *known == code => {
                if *reported || now - *since < WAITS {
                    return None;
                }
                *reported = true;
            }
            waiting => {
                let nothing = matches!(code, ReasonCode::None | ReasonCode::NotCommanded);
                // An operator who ordered the stop must learn at once that the descent is intended.
                let stopped = code == ReasonCode::CompletesLanding;
                *waiting = Some((code, now, nothing || stopped));
                return stopped.then(|| status_text(severity::WARNING, STOPPED_LOW));
            }
        }
        let severity = if m.waits_in_trouble() {
            severity::WARNING
        } else {
            severity::INFO
        };
        Some(status_text(severity, &format!("Waits: {}", m.waiting)))
    }
}

fn severity_of(m: &MissionState) -> u8 {
    match m.state {
        _ if m.was_entered_in_trouble() => severity::WARNING,
        State::Countdown | State::SpinUp => severity::WARNING,
        State::Hold | State::Landed | State::TakeOff => severity::NOTICE,
        State::Idle
        | State::GetAltitude
        | State::Approach
        | State::Search
        | State::Tracking
        | State::TrackingStable
        | State::Descent
        | State::Flare
        | State::GaveUp
        | State::Preparing
        | State::ClimbOut
        | State::StandDown => severity::INFO,
    }
}

/// Splits a long ASCII text into several STATUSTEXTs.
fn status_text(severity: u8, text: &str) -> MavlinkMessage {
    let ascii = |c: char| match c {
        '²' => '2',
        c if c.is_ascii() => c,
        _ => '?',
    };
    let text = text.chars().map(ascii).collect();
    MavlinkMessage::Text { severity, text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        msg::{Header, Reason},
        time::Time,
    };

    fn state(state: State, since_s: f64, code: ReasonCode) -> MissionState {
        MissionState {
            header: Header::new(0, 1, 1, 1, Time::from_secs(since_s)),
            state,
            since: Time::from_secs(since_s),
            entered: code.into(),
            waiting: Reason::plain(ReasonCode::NoVision),
            ..MissionState::default()
        }
    }

    #[test]
    fn severities_of_states_by_their_kind() {
        use ReasonCode::{ForecastStale, Matched, Operator, Permitted, Touchdown};
        for (previous, entered, code, expected) in [
            (State::Tracking, State::Descent, Permitted, severity::INFO),
            (State::Flare, State::Landed, Touchdown, severity::NOTICE),
            (State::Descent, State::GaveUp, Operator, severity::WARNING),
            (State::Tracking, State::GaveUp, Operator, severity::WARNING),
            (State::Tracking, State::Hold, ForecastStale, severity::WARNING),
            (State::Tracking, State::Hold, Operator, severity::NOTICE),
            (
                State::Descent,
                State::GetAltitude,
                ForecastStale,
                severity::WARNING,
            ),
            (State::Descent, State::GetAltitude, Matched, severity::INFO),
        ] {
            let m = MissionState {
                previous,
                ..state(entered, 1.0, code)
            };
            assert_eq!(severity_of(&m), expected, "{entered:?} after {previous:?}");
        }
    }

    #[test]
    fn text_of_a_stop_that_completes_the_landing() {
        let mut reports = GroundReports::default();
        let mut m = state(State::Flare, 0.0, ReasonCode::Permitted);
        assert!(reports.report(Time::from_secs(0.0), &m).is_some());
        m.waiting = ReasonCode::CompletesLanding.into();
        let first = reports.report(Time::from_secs(0.1), &m);
        let expected = MavlinkMessage::Text {
            severity: severity::WARNING,
            text: STOPPED_LOW.into(),
        };
        assert_eq!(first, Some(expected));
        assert!((2..100).all(|k| reports.report(Time::from_secs(0.1 * f64::from(k)), &m).is_none()));
    }

    #[test]
    fn texts_of_states_and_waiting_reasons() {
        let mut reports = GroundReports::default();
        let mut texts = Vec::new();
        for k in 0..100 {
            let at = 0.1 * f64::from(k);
            let m = if k < 50 {
                state(State::Tracking, 0.0, ReasonCode::InSight)
            } else {
                state(State::Hold, 5.0, ReasonCode::Operator)
            };
            texts.extend(reports.report(Time::from_secs(at), &m).map(|t| match t {
                MavlinkMessage::Text { text, .. } => text,
                other => panic!("{other:?}"),
            }));
        }
        let waits = "Waits: deck not detected yet";
        assert_eq!(
            texts,
            [
                "Tracking: the deck is in sight",
                waits,
                "Hold: operator's command",
                waits
            ]
        );
    }
}

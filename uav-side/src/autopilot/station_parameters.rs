//! Mission settings that an operator changes from a ground station with MAVLink's parameter protocol.
//!
//! The mission's state reports the values and whether they may be changed. A PARAM_SET becomes a [`SettingsOrder`] to
//! the mission, which is repeated until the state shows the new value and then answered with PARAM_VALUE. If it is
//! rejected, the answer is the current value and a text with the reason. Settings last until the processes are
//! restarted and survive a crash through the mission's checkpoint. If that is lost, a text reports the current values;
//! a link that crashed as well recovers the mode but not the heights. Values are REAL32, for which MAVLink's bytewise
//! and C-cast encodings coincide.

use alight_shared::{
    admission::Retransmission,
    config::ConfigError,
    msg::{LandingMode, MissionSettings, MissionState, SettingsOrder},
    time::DroneClock,
    topics,
};

use super::{
    AutopilotLink, AutopilotOut, DroneTime, Output,
    message::{Address, MavlinkMessage, ParameterValue, parameter, severity},
    station::UNSIGNED,
};
use crate::mission_config::MissionConfig;

/// Rounding steps per unit: single precision resolves a thousandth of a height.
const STEPS: f64 = 1e3;
const PREFIX: &str = "ALIGHT_";
const MODES: [(LandingMode, &str); 3] = [
    (LandingMode::Shadow, "shadow"),
    (LandingMode::Match, "match"),
    (LandingMode::Land, "land"),
];

/// The MAVLink index is the position in this list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StationParameter {
    Mode,
    ApproachHeight,
    TrackingHeight,
    LowestClearance,
}

impl StationParameter {
    const ALL: [StationParameter; 4] = [
        StationParameter::Mode,
        StationParameter::ApproachHeight,
        StationParameter::TrackingHeight,
        StationParameter::LowestClearance,
    ];
    /// At most 16 characters.
    const fn name(self) -> &'static str {
        match self {
            StationParameter::Mode => "ALIGHT_MODE",
            StationParameter::ApproachHeight => "ALIGHT_APPR_H",
            StationParameter::TrackingHeight => "ALIGHT_TRACK_H",
            StationParameter::LowestClearance => "ALIGHT_MATCH_H",
        }
    }
    /// Key in `[drone.mission]`.
    const fn key(self) -> &'static str {
        match self {
            StationParameter::Mode => "mode",
            StationParameter::ApproachHeight => "approach_height_m",
            StationParameter::TrackingHeight => "tracking_height_m",
            StationParameter::LowestClearance => "lowest_clearance_m",
        }
    }
    fn named(name: &str) -> Option<StationParameter> {
        StationParameter::ALL.into_iter().find(|p| p.name() == name)
    }
    fn value(self, s: &MissionSettings) -> f64 {
        match self {
            StationParameter::Mode => MODES
                .iter()
                .position(|(mode, _)| *mode == s.mode)
                .map_or(f64::NAN, |k| k as f64),
            StationParameter::ApproachHeight => s.approach_height_m,
            StationParameter::TrackingHeight => s.tracking_height_m,
            StationParameter::LowestClearance => s.lowest_clearance_m,
        }
    }
    fn changed(self, s: &MissionSettings, value: f64) -> Result<MissionSettings, String> {
        let value = (value * STEPS).round() / STEPS;
        let mut changed = *s;
        match self {
            StationParameter::Mode => {
                let numbered = MODES.iter().enumerate().find(|(k, _)| *k as f64 == value);
                let (_, (mode, _)) = numbered.ok_or(format!("{value} is not 0, 1 or 2"))?;
                changed.mode = *mode;
            }
            StationParameter::ApproachHeight => changed.approach_height_m = value,
            // The camera's exposure depends on the height in the configuration file.
            StationParameter::TrackingHeight => return Err("only the file sets it".into()),
            StationParameter::LowestClearance => changed.lowest_clearance_m = value,
        }
        // The settings' limits do not depend on the rest of the mission's configuration.
        match MissionConfig::default().with(&changed) {
            Ok(_) => Ok(changed),
            Err(ConfigError::Range { key, value, allowed }) => {
                let other = StationParameter::ALL
                    .into_iter()
                    .find(|p| p.key() == key && *p != self);
                let whose = other.map_or(String::new(), |p| {
                    format!("{} ", p.name().trim_start_matches(PREFIX))
                });
                Err(format!("{whose}{value} not in {allowed}"))
            }
            Err(why @ (ConfigError::Read { .. } | ConfigError::Parse { .. })) => Err(why.to_string()),
        }
    }
    fn shown(self, s: &MissionSettings) -> String {
        let value = self.value(s);
        let mode = MODES
            .iter()
            .find(|(mode, _)| self == StationParameter::Mode && *mode == s.mode);
        mode.map_or(format!("{value}"), |(_, name)| format!("{value} ({name})"))
    }
    fn message(self, s: &MissionSettings) -> MavlinkMessage {
        let value = ParameterValue {
            bits: (self.value(s) as f32).to_bits(),
            integer: false,
        };
        parameter(
            self.name(),
            value,
            self as u16,
            StationParameter::ALL.len() as u16,
        )
    }
}

#[derive(Clone, Debug)]
struct UnderWay {
    order: Retransmission<DroneClock, SettingsOrder>,
    /// Changed parameters, and the station that sent the last change.
    changes: Vec<StationParameter>,
    station: u8,
}

#[derive(Clone, Debug, Default)]
pub(super) struct StationParameters {
    known: Option<MissionSettings>,
    /// Mode of the previous mission, from the previous link's checkpoint, until the mission reports.
    pub(super) recalled: Option<LandingMode>,
    under_way: Option<UnderWay>,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Polled {
    order: Option<SettingsOrder>,
    values: Vec<StationParameter>,
    texts: Vec<(u8, String)>,
}

impl StationParameters {
    /// Starts a change of `p` in addition to pending changes.
    fn begin(&mut self, order: SettingsOrder, station: u8, p: StationParameter) {
        let before = self.under_way.take().map(|u| u.changes);
        let mut changes = before.unwrap_or_default();
        if !changes.contains(&p) {
            changes.push(p);
        }
        self.under_way = Some(UnderWay {
            order: Retransmission::new(order, order.header.at, topics::SETTINGS_RETRIES),
            changes,
            station,
        });
    }
    fn poll(&mut self, now: DroneTime, mission: &MissionState) -> Polled {
        let settings = &mission.settings;
        let recalled = self.recalled.take();
        let recalled = recalled.map(|mode| MissionSettings { mode, ..*settings });
        let before = recalled.or(self.known);
        self.known = Some(*settings);
        let mut polled = Polled::default();
        let Some(under_way) = &mut self.under_way else {
            let moved = |p: &StationParameter| before.is_some_and(|b| p.value(&b) != p.value(settings));
            polled.values = StationParameter::ALL.into_iter().filter(moved).collect();
            let again = |p: &StationParameter| {
                let text = format!("{} is {} now: mission restarted", p.name(), p.shown(settings));
                (severity::WARNING, text)
            };
            polled.texts = polled.values.iter().map(again).collect();
            return polled;
        };
        // A state older than the order may still reflect the previous order.
        let ordered = under_way.order.message;
        let is_taken = mission.header.at > ordered.header.at && ordered.settings == *settings;
        if !is_taken && !under_way.order.is_over(now) {
            polled.order = under_way.order.due(now);
            return polled;
        }
        let text = |p: &StationParameter| {
            let name = p.name();
            let station = under_way.station;
            if is_taken {
                let value = p.shown(settings);
                let text = format!("ground station {station} sets {name} to {value}");
                (severity::NOTICE, text)
            } else {
                let text = format!("{name} unchanged: not accepted by the mission");
                (severity::WARNING, text)
            }
        };
        polled.texts = under_way.changes.iter().map(text).collect();
        polled.values.clone_from(&under_way.changes);
        self.under_way = None;
        polled
    }
}

impl AutopilotLink {
    /// Answers a request for all parameters; without a mission they are unknown.
    pub(super) fn list_parameters(&self, out: &mut AutopilotOut) {
        if let Some(m) = self.inputs.mission.get() {
            out.messages
                .extend(StationParameter::ALL.map(|p| p.message(&m.settings)));
        }
    }
    pub(super) fn read_parameter(&self, name: &str, index: Option<u16>, out: &mut AutopilotOut) {
        let parameter = match index {
            Some(k) => StationParameter::ALL.get(usize::from(k)).copied(),
            None => StationParameter::named(name),
        };
        let known = self.inputs.mission.get().map(|m| m.settings);
        out.messages
            .extend(parameter.zip(known).map(|(p, s)| p.message(&s)));
    }
    pub(super) fn set_parameter(
        &mut self,
        now: DroneTime,
        from: Address,
        name: &str,
        value: ParameterValue,
        out: &mut AutopilotOut,
    ) {
        let Some(p) = StationParameter::named(name) else {
            let text = format!("{name} is not a parameter of this companion");
            return out.alarm(severity::WARNING, text);
        };
        let firmware = self.firmware().unwrap_or_default();
        match self.changed_settings(now, p, firmware.parameter(value)) {
            Ok(settings) if self.is_set(&settings) => self.read_parameter(name, None, out),
            Ok(settings) => {
                let header = self.headers.next(Output::Settings, now);
                let order = SettingsOrder { header, settings };
                self.operators.parameters.begin(order, from.system, p);
            }
            Err(why) => {
                self.read_parameter(name, None, out);
                out.alarm(severity::WARNING, format!("{name} unchanged: {why}"));
            }
        }
    }
    fn is_set(&self, settings: &MissionSettings) -> bool {
        let shown = self.inputs.mission.get().is_some_and(|m| m.settings == *settings);
        shown && self.operators.parameters.under_way.is_none()
    }
    fn changed_settings(
        &self,
        now: DroneTime,
        p: StationParameter,
        value: f64,
    ) -> Result<MissionSettings, String> {
        let mission = self.inputs.fresh_mission(now).ok_or("no mission reports")?;
        if !self.config.takes_orders() {
            return Err(UNSIGNED.into());
        }
        if let Some(why) = self.is_locked(now, mission) {
            return Err(why.into());
        }
        let under_way = self.operators.parameters.under_way.as_ref();
        let wanted = under_way.map_or(mission.settings, |u| u.order.message.settings);
        p.changed(&wanted, value)
    }
    fn is_locked(&self, now: DroneTime, mission: &MissionState) -> Option<&'static str> {
        let peer = self.peer.as_ref();
        let alive = peer.is_some_and(|p| (now - p.heartbeat_at).secs() <= self.config.heartbeat_loss_s);
        match peer {
            Some(p) if p.armed => Some("the drone is armed"),
            Some(_) if alive => (!mission.settable).then_some("landing or take-off ordered"),
            Some(_) | None => Some("the autopilot is silent"),
        }
    }
    pub(super) fn publish_settings(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        // Nothing is sent to stations until the autopilot has been found.
        let Some(mission) = self.inputs.mission.get().filter(|_| self.peer.is_some()) else {
            return;
        };
        let polled = self.operators.parameters.poll(now, mission);
        let settings = mission.settings;
        out.settings = polled.order;
        let values = polled.values.iter().map(|p| p.message(&settings));
        out.messages.extend(values);
        for (severity, text) in polled.texts {
            out.alarm(severity, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};
    use proptest::prelude::*;

    fn at(s: f64) -> DroneTime {
        Time::from_secs(s)
    }
    fn configured() -> MissionSettings {
        MissionConfig::default().settings()
    }
    fn order(s: f64, settings: MissionSettings) -> SettingsOrder {
        let header = Header::new(0, 1, 7, 1, at(s));
        SettingsOrder { header, settings }
    }
    fn shown(s: f64, settings: &MissionSettings) -> MissionState {
        MissionState {
            header: Header::new(0, 1, 5, 1, at(s)),
            settings: *settings,
            ..MissionState::default()
        }
    }
    fn poll(parameters: &mut StationParameters, s: f64, settings: &MissionSettings) -> Polled {
        parameters.poll(at(s), &shown(s, settings))
    }

    #[test]
    fn parameter_names_of_sixteen_characters() {
        for p in StationParameter::ALL {
            assert!(p.name().len() <= 16 && p.name().starts_with(PREFIX));
            assert!(StationParameter::named(p.name()) == Some(p));
        }
        let file = alight_shared::config::commented(&MissionConfig::default()).unwrap();
        assert!(
            StationParameter::ALL.iter().all(|p| file.contains(p.key())),
            "{file}"
        );
    }

    #[test]
    fn parameter_limits_of_the_configuration() {
        use StationParameter::{ApproachHeight, LowestClearance, Mode, TrackingHeight};
        let c = configured();
        let matching = Mode.changed(&c, 1.0).unwrap();
        assert_eq!(matching.mode, LandingMode::Match);
        for (settings, p, value, expected) in [
            (c, Mode, 3.0, "3 is not 0, 1 or 2"),
            (c, Mode, 0.5, "0.5 is not 0, 1 or 2"),
            (c, Mode, f64::NAN, "NaN is not 0, 1 or 2"),
            (c, ApproachHeight, 500.0, "500 not in 2 to 200"),
            (c, ApproachHeight, f64::NAN, "NaN not in 2 to 200"),
            (c, ApproachHeight, 5.0, "TRACK_H 7 not in 2 to 5"),
            (c, TrackingHeight, 6.0, "only the file sets it"),
            (matching, LowestClearance, 6.5, "6.5 not in 1 to 6"),
        ] {
            assert_eq!(p.changed(&settings, value), Err(expected.into()), "{p:?}");
        }
        let height = ApproachHeight.changed(&c, f64::from(12.3_f32)).unwrap();
        assert_eq!(height.approach_height_m, 12.3);
    }

    #[test]
    fn settings_until_the_mission_shows_them() {
        let mut parameters = StationParameters::default();
        let before = configured();
        assert_eq!(poll(&mut parameters, 9.9, &before), Polled::default());
        let first = StationParameter::Mode.changed(&before, 1.0).unwrap();
        parameters.begin(order(10.0, first), 255, StationParameter::Mode);
        let both = StationParameter::ApproachHeight.changed(&first, 12.0).unwrap();
        parameters.begin(order(10.01, both), 255, StationParameter::ApproachHeight);
        let sent = (0..10).filter_map(|k| poll(&mut parameters, 10.01 + 0.02 * f64::from(k), &before).order);
        let sent: Vec<_> = sent.collect();
        assert_eq!(sent, [order(10.01, both); 2]);
        let done = poll(&mut parameters, 10.3, &both);
        assert_eq!(
            done.values,
            [StationParameter::Mode, StationParameter::ApproachHeight]
        );
        assert_eq!(
            done.texts[0].1,
            "ground station 255 sets ALIGHT_MODE to 1 (match)"
        );
        assert_eq!(poll(&mut parameters, 10.4, &both), Polled::default());
        // The restarted mission has lost the settings.
        let lost = poll(&mut parameters, 20.0, &before);
        assert_eq!(lost.values, done.values);
        assert_eq!(lost.texts[0].1, "ALIGHT_MODE is 2 (land) now: mission restarted");
    }

    #[test]
    fn settings_that_the_mission_does_not_take() {
        let mut parameters = StationParameters::default();
        let before = configured();
        let wanted = StationParameter::Mode.changed(&before, 0.0).unwrap();
        parameters.begin(order(10.0, wanted), 255, StationParameter::Mode);
        let mut last = Polled::default();
        let mut published = 0;
        for k in 0..50 {
            last = poll(&mut parameters, 10.0 + 0.02 * f64::from(k), &before);
            published += usize::from(last.order.is_some());
            if !last.values.is_empty() {
                break;
            }
        }
        assert_eq!(last.values, [StationParameter::Mode]);
        assert!((8..=9).contains(&published), "{published}");
        assert_eq!(
            last.texts[0].1,
            "ALIGHT_MODE unchanged: not accepted by the mission"
        );
    }

    #[test]
    fn settings_shown_before_they_were_ordered() {
        let mut parameters = StationParameters::default();
        let before = configured();
        let other = StationParameter::ApproachHeight.changed(&before, 12.0).unwrap();
        parameters.begin(order(10.0, other), 255, StationParameter::ApproachHeight);
        assert!(poll(&mut parameters, 10.0, &before).order.is_some());
        // The change is reverted while the earlier order may still take effect, so the old value is ordered again.
        parameters.begin(order(10.02, before), 255, StationParameter::ApproachHeight);
        let old = shown(10.01, &before);
        let ordered = parameters.poll(at(10.02), &old);
        assert_eq!(
            (ordered.order, ordered.values.len()),
            (Some(order(10.02, before)), 0)
        );
        assert_eq!(poll(&mut parameters, 10.04, &other), Polled::default());
        let done = poll(&mut parameters, 10.06, &before);
        assert_eq!(done.values, [StationParameter::ApproachHeight]);
    }

    #[test]
    fn mode_of_a_mission_lost_with_the_link() {
        let land = configured();
        let lost = |mode| {
            let mut parameters = StationParameters {
                recalled: mode,
                ..StationParameters::default()
            };
            let first = poll(&mut parameters, 10.0, &land);
            assert_eq!(poll(&mut parameters, 10.1, &land), Polled::default());
            first
        };
        let reported = lost(Some(LandingMode::Shadow));
        assert_eq!(reported.values, [StationParameter::Mode]);
        let text = "ALIGHT_MODE is 2 (land) now: mission restarted".to_owned();
        assert_eq!(reported.texts, [(severity::WARNING, text)]);
        for same in [None, Some(LandingMode::Land)] {
            assert_eq!(lost(same), Polled::default());
        }
    }

    proptest! {
        /// The mission's configuration stays valid for any values.
        #[test]
        fn settings_by_arbitrary_values(values in prop::collection::vec((0..4_usize, any::<f32>()), 1..20)) {
            let mut settings = configured();
            for (k, value) in values {
                if let Ok(changed) = StationParameter::ALL[k].changed(&settings, f64::from(value)) {
                    settings = changed;
                }
                prop_assert!(MissionConfig::default().with(&settings).is_ok());
            }
        }
    }
}

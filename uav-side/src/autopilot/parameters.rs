//! Checks the autopilot parameters that affect a landing.

use alight_shared::autopilot_parameters::{
    Parameter, REQUESTS, Severity, THRUST_OPTION, of_ardu_copter, of_px4,
};
use alight_shared::mavlink::dialect::PARAM_REQUEST_READ_DATA;
use alight_shared::msg::{Reason, ReasonCode};
use alight_shared::time::Span;

use super::DroneTime;
use super::message::{Address, ParameterValue, chars};
use super::modes::Firmware;

const SPACING: Span = Span::from_millis(20);
/// Time allowed for an answer: several times the delay of a telemetry radio.
const ANSWER: Span = Span::from_millis(500);
/// Re-read period of an unsuitable parameter, because an operator may correct it.
const REVIEW: Span = Span::from_millis(1000);
/// Time after which a parameter that has never been reported is requested again.
const SILENT: Span = Span::from_millis(5000);
/// PX4's parameter for the time without set-points until it leaves OFFBOARD.
const LOSS_TIME: &str = "COM_OF_LOSS_T";
/// Value assumed until it is reported, s: the maximum that permits a landing.
const UNKNOWN_LOSS_S: f64 = 0.5;

#[derive(Clone, Debug)]
struct Item {
    number: usize,
    parameter: &'static Parameter,
    value: Option<f64>,
    requests: u32,
    next: DroneTime,
    /// Whether the autopilot has restarted since the value was read.
    old: bool,
    new: bool,
}

impl Item {
    fn reason(&self) -> Option<Reason> {
        let number = self.number as f64;
        match self.value {
            None => {
                let code = ReasonCode::AutopilotParameterUnknown;
                Some(Reason::new(code, f64::from(self.requests), number))
            }
            Some(value) if self.parameter.suits(value) => None,
            Some(value) => Some(Reason::new(ReasonCode::AutopilotParameter, value, number)),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Parameters {
    firmware: Firmware,
    items: Vec<Item>,
    next: DroneTime,
    /// Whether the autopilot interpreted thrust as thrust before the restart of autopilot or link.
    thrust_was_thrust: bool,
}

impl Parameters {
    /// `attitudes`: whether the pilot node sends attitude set-points.
    pub fn new(firmware: Firmware, attitudes: bool, now: DroneTime) -> Parameters {
        let own: Vec<_> = match firmware {
            Firmware::Px4 => of_px4().collect(),
            Firmware::ArduCopter => of_ardu_copter().collect(),
        };
        let items = own
            .into_iter()
            .filter(|(_, p)| attitudes || p.name != THRUST_OPTION);
        Parameters {
            firmware,
            items: items
                .map(|(number, parameter)| Item {
                    number,
                    parameter,
                    value: None,
                    requests: 0,
                    next: now,
                    old: false,
                    new: false,
                })
                .collect(),
            next: now,
            thrust_was_thrust: false,
        }
    }
    /// Until the option is reported, assumes that the autopilot interprets thrust as thrust.
    pub(super) fn trust_thrust(&mut self) {
        self.thrust_was_thrust = true;
    }
    pub fn received(&mut self, name: &str, value: ParameterValue) {
        let value = self.firmware.parameter(value);
        if let Some(item) = self.items.iter_mut().find(|i| i.parameter.name == name)
            && value.is_finite()
        {
            item.new |= item.value != Some(value);
            item.value = Some(value);
            item.old = false;
        }
    }
    /// Requests all parameters again after the autopilot has restarted; the old values are used until then.
    pub fn read_again(&mut self) {
        self.items.iter_mut().for_each(|i| i.old = true);
    }
    /// Next due request: an unreported parameter, or an unsuitable one at intervals.
    pub fn ask(&mut self, now: DroneTime, to: Address) -> Option<PARAM_REQUEST_READ_DATA> {
        if now < self.next {
            return None;
        }
        let due = |i: &&mut Item| now >= i.next && (i.old || i.reason().is_some());
        let item = self.items.iter_mut().find(due)?;
        self.next = now + SPACING;
        if item.value.is_none() {
            item.requests = item.requests.saturating_add(1);
            item.new |= item.requests == REQUESTS;
        }
        item.next = now
            + match item.value {
                None if item.requests < REQUESTS => ANSWER,
                None => SILENT,
                Some(_) => REVIEW,
            };
        Some(PARAM_REQUEST_READ_DATA {
            target_system: to.system,
            target_component: to.component,
            param_id: chars(item.parameter.name),
            // By name.
            param_index: -1,
        })
    }
    pub fn faults(&self) -> impl Iterator<Item = (&'static Parameter, Reason)> + '_ {
        self.items
            .iter()
            .filter_map(|i| i.reason().map(|why| (i.parameter, why)))
    }
    pub fn complete(&self) -> bool {
        self.items
            .iter()
            .all(|i| i.value.is_some() || i.requests >= REQUESTS)
    }
    /// Reason that prohibits a landing (empty code: permitted), unsuitable parameters before unreported ones.
    pub fn rejection(&self) -> Reason {
        let forbids = |i: &&Item| i.parameter.severity == Severity::Reject;
        let reasons = || self.items.iter().filter(forbids).filter_map(Item::reason);
        reasons()
            .find(|r| r.code == ReasonCode::AutopilotParameter)
            .or_else(|| reasons().next())
            .unwrap_or_default()
    }
    /// First unsuitable or unreported parameter that only causes a warning.
    pub fn warning(&self) -> Reason {
        let known = |i: &&Item| i.value.is_some() || i.requests >= REQUESTS;
        let warning = |i: &&Item| i.parameter.severity == Severity::Warn;
        let mut reasons = self
            .items
            .iter()
            .filter(known)
            .filter(warning)
            .filter_map(Item::reason);
        reasons.next().unwrap_or_default()
    }
    pub(super) fn thrust_is_thrust(&self) -> Option<bool> {
        let of_option = |i: &&Item| i.parameter.name == THRUST_OPTION;
        let Some(why) = self.items.iter().find(of_option).and_then(Item::reason) else {
            return Some(true);
        };
        if why.code == ReasonCode::AutopilotParameterUnknown {
            self.thrust_was_thrust.then_some(true)
        } else {
            Some(false)
        }
    }
    /// COM_OF_LOSS_T, s.
    pub(super) fn loss_s(&self) -> f64 {
        let item = self.items.iter().find(|i| i.parameter.name == LOSS_TIME);
        item.and_then(|i| i.value).unwrap_or(UNKNOWN_LOSS_S)
    }
    pub(super) fn news(&mut self) -> impl Iterator<Item = String> + '_ {
        let firmware = self.firmware.name();
        self.items.iter_mut().filter_map(move |i| {
            let is_new = core::mem::take(&mut i.new);
            i.reason()
                .filter(|_| is_new)
                .map(|why| match i.parameter.severity {
                    Severity::Reject => format!("{firmware}, no landing: {why}"),
                    Severity::Warn => format!("{firmware}, a warning: {why}"),
                })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::message::text;
    use super::*;
    use alight_shared::autopilot_parameters::Wanted;
    use alight_shared::time::Time;

    const TO: Address = Address::new(1, 1);

    fn asked(p: &mut Parameters, from_s: f64, seconds: f64) -> Vec<String> {
        (0..(seconds * 100.0) as u32)
            .filter_map(|k| p.ask(Time::from_secs(from_s + 0.01 * f64::from(k)), TO))
            .map(|request| text(&request.param_id))
            .collect()
    }
    fn report(p: &mut Parameters, name: &str, value: f64) {
        let firmware = p.firmware;
        p.received(name, firmware.parameter_value(value, value.fract() == 0.0));
    }

    fn report_the_others(p: &mut Parameters, but: &[&str]) {
        let unknown: Vec<_> = p
            .faults()
            .filter(|(_, why)| why.code == ReasonCode::AutopilotParameterUnknown)
            .filter(|(of, _)| !but.contains(&of.name))
            .map(|(of, _)| *of)
            .collect();
        for of in unknown {
            let value = match of.wanted {
                Wanted::Within(low, _) => low,
                Wanted::Is(value, _) => value,
                Wanted::OneOf(values) => values[0].0,
                Wanted::Bits(bits) => f64::from(bits),
            };
            let integer = value.fract() == 0.0 && of.unit.is_empty();
            let value = p.firmware.parameter_value(value, integer);
            p.received(of.name, value);
        }
    }

    #[test]
    fn suitable_parameters() {
        let mut p = Parameters::new(Firmware::Px4, true, Time::from_secs(0.0));
        assert_eq!(p.rejection().code, ReasonCode::AutopilotParameterUnknown);
        let first = asked(&mut p, 0.0, 0.2);
        assert_eq!(
            first[..4],
            ["COM_OF_LOSS_T", "COM_OBL_RC_ACT", "MPC_ACC_UP_MAX", "MC_AIRMODE"]
        );
        report_the_others(
            &mut p,
            &["COM_OF_LOSS_T", "COM_OBL_RC_ACT", "MPC_ACC_UP_MAX", "MC_AIRMODE"],
        );
        report(&mut p, "COM_OF_LOSS_T", 0.25);
        report(&mut p, "COM_OBL_RC_ACT", 5.0);
        p.received("MPC_ACC_UP_MAX", Firmware::Px4.parameter_value(8.0, false));
        assert!(!p.complete());
        assert_eq!(p.rejection(), Reason::default());
        report(&mut p, "MC_AIRMODE", 1.0);
        assert!(p.complete() && asked(&mut p, 0.2, 60.0).is_empty());
        assert_eq!(p.news().count(), 0);
    }

    #[test]
    fn unsuitable_parameters() {
        let mut p = Parameters::new(Firmware::ArduCopter, true, Time::from_secs(0.0));
        asked(&mut p, 0.0, 0.2);
        for (name, value) in [
            ("GUID_TIMEOUT", 3.0),
            ("GUID_OPTIONS", 8.0),
            ("ATC_THR_MIX_MIN", 0.1),
        ] {
            report(&mut p, name, value);
        }
        report(&mut p, "FS_THR_ENABLE", 3.0);
        report_the_others(&mut p, &[]);
        let why = p.rejection();
        assert_eq!(why.code, ReasonCode::AutopilotParameter);
        assert!(
            why.to_string()
                .starts_with("GUID_TIMEOUT is 3 s; 0.1 to 0.5 s is needed"),
            "{why}"
        );
        let news: Vec<String> = p.news().collect();
        assert_eq!(news.len(), 2, "{news:?}");
        assert!(news[1].contains("a warning: FS_THR_ENABLE is 3"), "{news:?}");
        assert_eq!(p.news().count(), 0);
        let again = asked(&mut p, 0.2, 3.0);
        let of_timeout = again.iter().filter(|n| *n == "GUID_TIMEOUT").count();
        assert!((2..=4).contains(&of_timeout), "{again:?}");
        report(&mut p, "GUID_TIMEOUT", 0.3);
        assert_eq!(p.rejection(), Reason::default());
    }

    #[test]
    fn parameter_never_reported() {
        let mut p = Parameters::new(Firmware::Px4, true, Time::from_secs(0.0));
        for (name, value) in [
            ("COM_OF_LOSS_T", 0.25),
            ("COM_OBL_RC_ACT", 5.0),
            ("MC_AIRMODE", 1.0),
        ] {
            report(&mut p, name, value);
        }
        report_the_others(&mut p, &["MPC_ACC_UP_MAX"]);
        let names = asked(&mut p, 0.0, 4.9);
        assert_eq!(names.len(), REQUESTS as usize);
        assert!(p.complete());
        assert!(asked(&mut p, 4.9, 60.0).len() <= 12);
        let why = p.rejection().to_string();
        assert!(
            why.contains("MPC_ACC_UP_MAX") && why.contains("check_parameters"),
            "{why}"
        );
        assert!(p.news().next().is_some_and(|t| t.contains("MPC_ACC_UP_MAX")));
    }

    #[test]
    fn parameter_encoding_of_the_firmwares() {
        let value = Firmware::Px4.parameter_value(5.0, true);
        assert_eq!(value.bits, 5);
        assert_eq!(Firmware::Px4.parameter(value), 5.0);
        assert_eq!(
            Firmware::Px4.parameter(ParameterValue {
                bits: u32::MAX,
                integer: true
            }),
            -1.0
        );
        let value = Firmware::ArduCopter.parameter_value(8.0, true);
        assert_eq!(value.bits, 8.0_f32.to_bits());
        assert_eq!(Firmware::ArduCopter.parameter(value), 8.0);
    }
}

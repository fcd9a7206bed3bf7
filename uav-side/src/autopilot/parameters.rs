//! Checks the autopilot parameters that affect a landing.

use alight_shared::{
    autopilot_parameters::{Parameter, REQUESTS, Severity, THRUST_OPTION, Version, Versions, Wanted},
    mavlink::{
        MessageData as _,
        dialect::{AUTOPILOT_VERSION_DATA, PARAM_REQUEST_READ_DATA},
    },
    msg::{AutopilotMode, Reason, ReasonCode},
    time::Span,
};

use super::{
    DroneTime,
    message::{Address, CommandLong, MavMessage, MavlinkMessage, ParameterValue, chars},
    modes::Firmware,
};

const SPACING: Span = Span::from_millis(20);
/// Time allowed for an answer: several times the delay of a telemetry radio.
const ANSWER: Span = Span::from_millis(500);
/// Re-read period of an unsuitable parameter, because an operator may correct it.
const REVIEW: Span = Span::from_millis(1000);
/// Time after which a parameter that has never been reported is requested again.
const SILENT: Span = Span::from_millis(5000);
/// PX4's parameter for the time without set-points until it leaves OFFBOARD.
const LOSS_TIME: &str = "COM_OF_LOSS_T";
/// PX4's parameter for the mode that it then enters.
const LOSS_ACTION: &str = "COM_OBL_RC_ACT";
/// Value assumed until it is reported, s: the maximum that permits a landing.
const UNKNOWN_LOSS_S: f64 = 0.5;

/// Requests for one answer of the autopilot.
#[derive(Clone, Copy, Debug)]
struct Inquiry {
    requests: u32,
    next: DroneTime,
}

impl Inquiry {
    const fn new(now: DroneTime) -> Inquiry {
        Inquiry {
            requests: 0,
            next: now,
        }
    }
    const fn is_given_up(&self) -> bool {
        self.requests >= REQUESTS
    }
    /// Counts a request that has had no answer.
    fn sent(&mut self, now: DroneTime) {
        self.requests = self.requests.saturating_add(1);
        self.next = now + if self.is_given_up() { SILENT } else { ANSWER };
    }
}

#[derive(Clone, Debug)]
struct Item {
    number: usize,
    parameter: &'static Parameter,
    value: Option<f64>,
    inquiry: Inquiry,
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
                Some(Reason::new(code, f64::from(self.inquiry.requests), number))
            }
            Some(value) if self.parameter.suits(value) => None,
            Some(value) => Some(Reason::new(ReasonCode::AutopilotParameter, value, number)),
        }
    }
    fn is_decided(&self) -> bool {
        self.value.is_some() || self.inquiry.is_given_up()
    }
    fn is_due(&self, now: DroneTime) -> bool {
        now >= self.inquiry.next && (self.old || self.reason().is_some())
    }
}

/// Parameters of the autopilot's firmware in its version. Until AUTOPILOT_VERSION is reported, or ten requests for it
/// have had no answer, only parameters of every version are read.
#[derive(Clone, Debug)]
pub struct Parameters {
    firmware: Firmware,
    /// Whether the pilot node sends attitude set-points.
    attitudes: bool,
    version: Option<Version>,
    version_inquiry: Inquiry,
    items: Vec<Item>,
    next: DroneTime,
    /// Whether the autopilot interpreted thrust as thrust before the restart of autopilot or link.
    thrust_was_thrust: bool,
}

impl Parameters {
    /// `attitudes`: whether the pilot node sends attitude set-points.
    pub fn new(firmware: Firmware, attitudes: bool, now: DroneTime) -> Parameters {
        let mut parameters = Parameters {
            firmware,
            attitudes,
            version: None,
            version_inquiry: Inquiry::new(now),
            items: Vec::new(),
            next: now,
            thrust_was_thrust: false,
        };
        parameters.select(firmware.maker().assumed());
        parameters
    }
    /// Selects the parameters of this version; known values stay.
    fn select(&mut self, version: Version) {
        let rows = self.firmware.maker().parameters(version);
        let mut before = core::mem::take(&mut self.items);
        let is_used = |p: &Parameter| self.attitudes || p.name != THRUST_OPTION;
        for (number, parameter) in rows.filter(|(_, p)| p.wanted != Wanted::Any && is_used(p)) {
            let known = before.iter().position(|i| i.number == number);
            self.items.push(match known {
                Some(k) => before.swap_remove(k),
                None => Item {
                    number,
                    parameter,
                    value: None,
                    inquiry: Inquiry::new(self.next),
                    old: false,
                    new: false,
                },
            });
        }
    }
    /// Whether the version is known, or assumed because the autopilot does not report it.
    fn knows_version(&self) -> bool {
        self.version.is_some() || self.version_inquiry.is_given_up()
    }
    /// Parameters that exist in the autopilot's firmware, as far as its version is known.
    fn items(&self) -> impl Iterator<Item = &Item> {
        let any_version = self.knows_version();
        let valid = move |i: &&Item| any_version || i.parameter.versions == Versions::ALL;
        self.items.iter().filter(valid)
    }
    pub fn on_version(&mut self, version: Version) {
        if self.version != Some(version) {
            self.version = Some(version);
            self.select(version);
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
    /// Requests version and parameters again after the autopilot has restarted, perhaps with another firmware. The old
    /// values are used until then.
    pub fn read_again(&mut self) {
        self.version = None;
        self.version_inquiry = Inquiry::new(self.next);
        for i in &mut self.items {
            i.old = true;
        }
    }
    /// Next due request: the version, an unreported parameter, or an unsuitable one at intervals.
    pub fn ask(&mut self, now: DroneTime, to: Address) -> Option<MavlinkMessage> {
        if now < self.next {
            return None;
        }
        if !self.knows_version() && now >= self.version_inquiry.next {
            self.next = now + SPACING;
            self.version_inquiry.sent(now);
            return Some(CommandLong::request(to, AUTOPILOT_VERSION_DATA::ID).into());
        }
        let number = self.items().find(|i| i.is_due(now))?.number;
        let item = self.items.iter_mut().find(|i| i.number == number)?;
        self.next = now + SPACING;
        if item.value.is_none() {
            item.inquiry.sent(now);
            item.new |= item.inquiry.requests == REQUESTS;
        } else {
            item.inquiry.next = now + REVIEW;
        }
        let request = PARAM_REQUEST_READ_DATA {
            target_system: to.system,
            target_component: to.component,
            param_id: chars(item.parameter.name),
            // By name.
            param_index: -1,
        };
        Some(MavMessage::PARAM_REQUEST_READ(request).into())
    }
    pub fn faults(&self) -> impl Iterator<Item = (&'static Parameter, Reason)> + '_ {
        self.items()
            .filter_map(|i| i.reason().map(|why| (i.parameter, why)))
    }
    pub fn complete(&self) -> bool {
        self.knows_version() && self.items.iter().all(Item::is_decided)
    }
    /// Reason that prohibits a landing (empty code: permitted), unsuitable parameters before unreported ones.
    pub fn rejection(&self) -> Reason {
        let forbids = |i: &&Item| i.parameter.severity == Severity::Reject;
        let reasons = || self.items().filter(forbids).filter_map(Item::reason);
        reasons()
            .find(|r| r.code == ReasonCode::AutopilotParameter)
            .or_else(|| reasons().next())
            .unwrap_or_default()
    }
    /// First unsuitable or unreported parameter that only causes a warning.
    pub fn warning(&self) -> Reason {
        let warns = |i: &&Item| i.parameter.severity == Severity::Warn && i.is_decided();
        let mut reasons = self.items().filter(warns).filter_map(Item::reason);
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
    fn value(&self, name: &str) -> Option<f64> {
        self.items.iter().find(|i| i.parameter.name == name)?.value
    }
    /// Whether the loss of the remote control makes the autopilot hold while it follows our set-points.
    pub(super) fn remote_loss_holds(&self) -> bool {
        let bits = |name: &str| self.value(name).map_or(0, |bits| bits as u32);
        let exempt = bits("COM_RCL_EXCEPT") & 4 != 0 || bits("FS_OPTIONS") & 4 != 0;
        let holds = match self.firmware {
            Firmware::Px4 => self.value("NAV_RCL_ACT") == Some(1.0),
            Firmware::ArduCopter => self.value("FS_THR_ENABLE") == Some(7.0),
        };
        holds && !exempt
    }
    /// COM_OF_LOSS_T, s.
    pub(super) fn loss_s(&self) -> f64 {
        self.value(LOSS_TIME).unwrap_or(UNKNOWN_LOSS_S)
    }
    /// Mode that PX4 enters without set-points.
    pub(super) fn loss_mode(&self) -> AutopilotMode {
        match self.value(LOSS_ACTION).map(|action| action as u32) {
            Some(3) => AutopilotMode::Return,
            Some(4) => AutopilotMode::Land,
            Some(_) | None => AutopilotMode::Hold,
        }
    }
    pub(super) fn news(&mut self) -> impl Iterator<Item = String> + '_ {
        let firmware = self.firmware.name();
        self.items.iter_mut().filter_map(move |i| {
            if !core::mem::take(&mut i.new) {
                return None;
            }
            let why = i.reason()?;
            Some(match i.parameter.severity {
                Severity::Reject => format!("{firmware}, no landing: {why}"),
                Severity::Warn => format!("{firmware}, a warning: {why}"),
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{super::message::text, *};
    use alight_shared::time::Time;

    const TO: Address = Address::new(1, 1);

    fn asked(p: &mut Parameters, from_s: f64, seconds: f64) -> Vec<String> {
        (0..(seconds * 100.0) as u32)
            .filter_map(|k| p.ask(Time::from_secs(from_s + 0.01 * f64::from(k)), TO))
            .filter_map(|message| match message {
                MavlinkMessage::Common(MavMessage::PARAM_REQUEST_READ(d)) => Some(text(&d.param_id)),
                _ => None,
            })
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
            report(p, of.name, of.corrected(0.0));
        }
    }
    fn known(firmware: Firmware, version: Version) -> Parameters {
        let mut p = Parameters::new(firmware, true, Time::from_secs(0.0));
        p.on_version(version);
        p
    }

    #[test]
    fn suitable_parameters() {
        let mut p = known(Firmware::Px4, [1, 17]);
        assert_eq!(p.rejection().code, ReasonCode::AutopilotParameterUnknown);
        let first = asked(&mut p, 0.0, 0.2);
        let expected = [
            "COM_OF_LOSS_T",
            "COM_OBL_RC_ACT",
            "MPC_ACC_UP_MAX",
            "MPC_JERK_AUTO",
        ];
        assert_eq!(first[..4], expected);
        report_the_others(&mut p, &["MC_AIRMODE"]);
        assert!(!p.complete());
        assert_eq!(p.rejection(), Reason::default());
        report(&mut p, "MC_AIRMODE", 1.0);
        assert!(p.complete() && asked(&mut p, 0.2, 60.0).is_empty());
        assert_eq!(p.news().count(), 0);
    }

    #[test]
    fn parameters_by_the_reported_version() {
        let named = |p: &Parameters, name| p.faults().any(|(of, _)| of.name == name);
        let mut p = Parameters::new(Firmware::ArduCopter, true, Time::from_secs(0.0));
        let first = p.ask(Time::from_secs(0.0), TO);
        assert_eq!(
            first,
            Some(CommandLong::request(TO, AUTOPILOT_VERSION_DATA::ID).into())
        );
        // A name of one version is neither requested nor missed before the version is known.
        assert!(!named(&p, "RTL_ALT_FINAL") && !named(&p, "RTL_ALT_FINAL_M"));
        assert!(named(&p, "GUID_TIMEOUT"));
        report_the_others(&mut p, &[]);
        assert!(!p.complete());
        p.on_version([4, 7]);
        assert!(named(&p, "RTL_ALT_FINAL_M") && !named(&p, "RTL_ALT_FINAL") && !named(&p, "GUID_TIMEOUT"));
        report(&mut p, "RTL_ALT_FINAL_M", 10.0);
        assert!(p.complete() && p.faults().next().is_none());
        // Another firmware may have been installed.
        p.read_again();
        p.on_version([4, 6]);
        assert!(named(&p, "RTL_ALT_FINAL") && !p.complete());
        // A firmware without a version counts as the assumed one.
        let mut p = Parameters::new(Firmware::Px4, true, Time::from_secs(0.0));
        asked(&mut p, 0.0, 10.0);
        assert!(p.complete() && named(&p, "COM_RCL_EXCEPT"));
    }

    #[test]
    fn unsuitable_parameters() {
        let mut p = known(Firmware::ArduCopter, [4, 6]);
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
        let mut p = known(Firmware::Px4, [1, 17]);
        report_the_others(&mut p, &["MPC_ACC_UP_MAX"]);
        let names = asked(&mut p, 0.0, 4.9);
        assert_eq!(names.len(), REQUESTS as usize);
        assert!(p.complete());
        let why = p.rejection().to_string();
        assert_eq!(why, "the autopilot has not reported MPC_ACC_UP_MAX (10 requests)");
        assert!(asked(&mut p, 4.9, 60.0).len() <= 12);
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

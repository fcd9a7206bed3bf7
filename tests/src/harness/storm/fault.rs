//! One fault: kind, start, duration and permitted sizes. This module does not depend on the world, because
//! scenarios also contain faults.

use alight_shared::{
    config::{ConfigError, Keys},
    msg::State,
};
use serde::{
    Deserialize, Serialize,
    de::{
        IntoDeserializer as _,
        value::{Error, StrDeserializer},
    },
};

use super::kinds::FaultKind;
use crate::{physics::streams::Streams, sensors::noise::Noise};

/// Maximum delay after entry to the state, and maximum duration of a fault in a storm, s.
pub(super) const MAX_S: f64 = 60.0;
const MAX_ENTRY: u8 = 9;
const CONTACT: &str = "Contact";

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    pub kind: FaultKind,
    /// Moment from which the delay counts.
    #[serde(rename = "state")]
    pub moment: Moment,
    /// The entry of the state at which the fault begins, counted from 1; the first contact occurs once.
    #[serde(default = "first")]
    pub entry: u8,
    #[serde(default)]
    pub after_s: f64,
    /// Size, in the unit of [`Spec::of`](super::Spec::of).
    #[serde(default)]
    pub size: f64,
    /// Duration, s; 0: instantaneous. In a scenario, `inf` is permanent.
    #[serde(default)]
    pub lasts_s: f64,
}

const fn first() -> u8 {
    1
}

/// Moment from which a fault's delay counts; in a list, the name of a state, or `Contact`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Moment {
    /// The [`Fault::entry`]-th entry of this state. `Landed` begins when the motors stop.
    In(State),
    Contact,
}

impl Moment {
    /// Maximum delay of a drawn fault, s: shorter than the usual phase. After the motors stop, it covers the
    /// time in which a disarm may be denied at first.
    const fn max_delay_s(self) -> f64 {
        match self {
            Moment::In(state) => match state {
                State::Approach | State::Search => 2.0,
                State::GetAltitude | State::Tracking => 0.5,
                State::TrackingStable => 0.1,
                State::Descent => 2.5,
                State::Flare => 0.8,
                State::Landed => 0.3,
                State::Idle
                | State::Hold
                | State::GaveUp
                | State::Preparing
                | State::Countdown
                | State::SpinUp
                | State::TakeOff
                | State::ClimbOut
                | State::StandDown => 0.0,
            },
            Moment::Contact => 0.0,
        }
    }
}

impl TryFrom<String> for Moment {
    type Error = Error;
    fn try_from(name: String) -> Result<Moment, Error> {
        if name == CONTACT {
            return Ok(Moment::Contact);
        }
        let name: StrDeserializer<'_, Error> = name.as_str().into_deserializer();
        State::deserialize(name).map(Moment::In)
    }
}

impl From<Moment> for String {
    fn from(moment: Moment) -> String {
        match moment {
            Moment::In(state) => format!("{state:?}"),
            Moment::Contact => CONTACT.into(),
        }
    }
}

/// Duration of a drawn freeze, s: from below to above the receivers' time-outs.
const FROZEN_S: [f64; 2] = [0.2, 2.0];
/// Downtime of a killed process in lock-step, s. A supervisor restarts it after 0.1 s; on a busy computer the
/// start-up takes most of a second.
const AWAY_S: [f64; 2] = [0.15, 1.0];

impl Fault {
    /// Fault of size 0 at the first entry of the state.
    pub const fn new(kind: FaultKind, moment: Moment, after_s: f64, lasts_s: f64) -> Fault {
        Fault {
            kind,
            moment,
            entry: first(),
            after_s,
            size: 0.0,
            lasts_s,
        }
    }
    /// Process fault within the phase that begins at `moment`; the seed draws delay and duration.
    pub fn drawn(kind: FaultKind, moment: Moment, seed: u64) -> Fault {
        let mut noise = Noise::new(&Streams::new(seed), "fault");
        let after_s = moment.max_delay_s() * noise.uniform();
        let [shortest, longest] = if kind.freezes() { FROZEN_S } else { AWAY_S };
        let lasts_s = shortest + (longest - shortest) * noise.uniform();
        Fault::new(kind, moment, after_s, lasts_s)
    }
    /// Checks the ranges; `longest_s` is the maximum duration. The error names the value that is out of range.
    pub(crate) fn check_all(faults: &[Fault], at: &Keys<'_>, longest_s: f64) -> Result<(), ConfigError> {
        for fault in faults {
            let at = at.table(fault.kind.name());
            let spec = fault.kind.spec();
            let largest = spec.size[0].abs().max(spec.size[1].abs());
            let quantity = if spec.of.is_empty() { "none" } else { spec.of };
            at.range(&format!("size ({quantity})"), fault.size, -largest, largest)?;
            at.range("entry", fault.entry.into(), 1.0, MAX_ENTRY.into())?;
            at.range("after_s", fault.after_s, 0.0, MAX_S)?;
            at.range("lasts_s", fault.lasts_s, 0.0, longest_s)?;
        }
        Ok(())
    }
    /// Time of the fault's moment, s, from the drone's state entries and its first contact.
    pub(crate) fn moment_s(&self, entered: &[(State, f64)], touched_s: Option<f64>) -> Option<f64> {
        match self.moment {
            Moment::In(state) => {
                let mut entries = entered.iter().filter(|(s, _)| *s == state);
                let (_, at_s) = entries.nth(usize::from(self.entry).saturating_sub(1))?;
                Some(*at_s)
            }
            Moment::Contact => touched_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use alight_shared::config;

    use super::*;
    use crate::harness::scenario::Scenario;

    #[test]
    fn times_by_seed() {
        let drawn = |kind| move |seed| Fault::drawn(kind, Moment::In(State::Descent), seed);
        let all: Vec<_> = (0..20).map(drawn(FaultKind::PilotFrozen)).collect();
        assert!(all.iter().all(|f| (0.0..2.5).contains(&f.after_s)), "{all:?}");
        assert!(all.iter().all(|f| (0.2..2.0).contains(&f.lasts_s)), "{all:?}");
        assert_eq!(drawn(FaultKind::PilotFrozen)(3), all[3]);
        assert!(all.iter().any(|f| f.after_s != all[0].after_s));
        assert!(
            (0..20)
                .map(drawn(FaultKind::PilotKilled))
                .all(|f| f.lasts_s < 1.0)
        );
    }

    #[test]
    fn entries_of_a_state() {
        let entered = [
            (State::Idle, 0.0),
            (State::Descent, 20.0),
            (State::Tracking, 24.0),
            (State::Descent, 31.0),
        ];
        let at = |moment, entry| {
            let fault = Fault {
                entry,
                ..Fault::drawn(FaultKind::PilotFrozen, moment, 1)
            };
            fault.moment_s(&entered, Some(33.0))
        };
        let descent = Moment::In(State::Descent);
        assert_eq!([1, 2, 3].map(|n| at(descent, n)), [Some(20.0), Some(31.0), None]);
        assert_eq!(at(Moment::In(State::Flare), 1), None);
        assert_eq!(at(Moment::In(State::Idle), 1), Some(0.0));
        assert_eq!(at(Moment::Contact, 2), Some(33.0));
    }

    #[test]
    fn faults_of_a_scenario() {
        let read = |fault: &str| config::parse::<Scenario>(&format!("[[fault]]\n{fault}"), "test");
        let lost = Fault::new(FaultKind::RadioLost, Moment::In(State::Flare), 0.5, f64::INFINITY);
        let text = "kind = \"radio-lost\"\nstate = \"Flare\"\nafter_s = 0.5\nlasts_s = inf";
        let scenario = read(text).unwrap();
        assert_eq!(scenario.faults, [lost]);
        let written = config::commented(&scenario).unwrap();
        assert_eq!(config::parse::<Scenario>(&written, "test").unwrap(), scenario);
        let late = read(&text.replace("0.5", "61.0")).unwrap_err().to_string();
        assert!(
            late.contains("`fault.radio-lost.after_s` is 61; allowed: 0 to 60"),
            "{late}"
        );
        let former = config::parse::<Scenario>("[radio_outage]\nstate = \"Flare\"\nduration_s = 1", "test");
        let former = former.unwrap_err().to_string();
        assert!(
            former.contains("`radio_outage`") && former.contains("`fault`"),
            "{former}"
        );
    }

    #[test]
    fn moment_by_name() {
        for moment in [Moment::In(State::TrackingStable), Moment::Contact] {
            assert_eq!(Moment::try_from(String::from(moment)), Ok(moment));
        }
        let wrong = Moment::try_from(String::from("Ashore")).unwrap_err().to_string();
        assert!(wrong.contains("Ashore"), "{wrong}");
    }
}

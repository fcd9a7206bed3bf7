//! GO or NO-GO for a landing, and the stages of one.

use alight_shared::msg::{Reason, ReasonCode, State};
use serde::Serialize;

use super::finding::{Finding, FindingLevel};

/// Stages of a landing in their order; hold, idle and giving up are none of them.
const STAGES: [State; 7] = [
    State::GetAltitude,
    State::Approach,
    State::Tracking,
    State::TrackingStable,
    State::Descent,
    State::Flare,
    State::Landed,
];

/// A forecast of less than this quality is shown as one of 0 %.
const NO_QUALITY: f64 = 0.005;
/// Text for an unknown wind.
pub const NO_WIND: &str = "the wind is not known yet";

/// Text for a forecast without this quality, 0 to 1; None: it has some.
pub fn no_forecast(quality: f64) -> Option<&'static str> {
    let none = !(quality >= NO_QUALITY);
    none.then_some("forecast quality 0 %: the vessel's motion is not identified yet, or she lies still")
}

/// Reason against an order to land in a state that was `entered` so: the drone stands, is to take off, or has given up, be it by
/// an abort; None: a landing may be ordered, or goes on.
pub fn barred(state: State, entered: &Reason) -> Option<String> {
    let bars = state.ending().is_some() || state.stands_for_take_off() || state == State::TakeOff;
    bars.then(|| state.because(entered))
}

/// The one sentence that counts in a state, for people: why a landing has ended or was stopped; else how far it is, or
/// `waits: ` with what the next state waits for (`waits_for`, the text of `code`); else what the drone does.
pub fn sentence(state: State, entered: &Reason, code: ReasonCode, waits_for: String) -> String {
    let why = entered.to_string();
    if (state.ending().is_some() || state.is_setback()) && !why.is_empty() {
        return why;
    }
    // These texts describe what goes on, and name nothing that is missing.
    let goes_on = matches!(
        code,
        ReasonCode::Descending
            | ReasonCode::DescendingTo
            | ReasonCode::Flaring
            | ReasonCode::Counting
            | ReasonCode::Leaving
            | ReasonCode::Searching
            | ReasonCode::SeeksVessel
            | ReasonCode::HandsOver
            | ReasonCode::TurnsBack
            | ReasonCode::OnStation
    );
    if waits_for.is_empty() {
        state.does().into()
    } else if goes_on {
        waits_for
    } else {
        format!("waits: {waits_for}")
    }
}

/// Whether a landing may be ordered now, or go on, with the reason in one sentence.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Go {
    /// None: not known.
    pub go: Option<bool>,
    /// The reason against it; of a GO other facts for the crew.
    pub why: String,
}

impl Go {
    /// One that is not known, because this is missing.
    pub fn unknown(missing: impl Into<String>) -> Go {
        Go {
            go: None,
            why: missing.into(),
        }
    }
    /// A NO-GO for this reason.
    pub fn barred(why: impl Into<String>) -> Go {
        Go {
            go: Some(false),
            why: why.into(),
        }
    }
    /// The worse of both, of equals the first: a NO-GO before what is not known, that before a GO.
    pub fn worse(self, other: Option<Go>) -> Go {
        let rank = |go: &Go| match go.go {
            Some(false) => 2,
            None => 1,
            Some(true) => 0,
        };
        match other {
            Some(other) if rank(&other) > rank(&self) => other,
            Some(_) | None => self,
        }
    }
    /// By what was found; `unknown` names what is missing for a judgement.
    pub fn of(findings: &[Finding], unknown: Option<&str>) -> Go {
        // Of several the worst; of equals the first.
        let worst = findings.iter().filter(|f| f.stops).rev().max_by_key(|f| f.level);
        if let Some(f) = worst {
            // The text of the mission's finding has a subject of its own.
            let has_subject = f.topic == "mission";
            return Go::barred(if has_subject {
                f.found.clone()
            } else {
                format!("{}: {}", f.topic, f.found)
            });
        }
        if let Some(missing) = unknown {
            return Go::unknown(missing);
        }
        let why = match findings.iter().filter(|f| f.level > FindingLevel::Fine).count() {
            0 => "no finding stops a landing".into(),
            1 => "one warning, which does not stop a landing".into(),
            n => format!("{n} warnings, which do not stop a landing"),
        };
        Go { go: Some(true), why }
    }
}

/// A stage, and whether the landing is past it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stage {
    pub name: &'static str,
    /// Place of the landing in relation to it.
    pub is: StageProgress,
}

/// Place of a landing in relation to a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StageProgress {
    Done,
    Now,
    Ahead,
}

/// The stages, by a state.
pub fn stages(state: State) -> Vec<Stage> {
    // A search is the end of the approach to a vessel that is known by its beacon.
    let shown = if state == State::Search {
        State::Approach
    } else {
        state
    };
    let now = STAGES.iter().position(|s| *s == shown);
    let stage = |(k, s): (usize, &State)| Stage {
        name: s.name(),
        is: match now {
            Some(now) if k < now => StageProgress::Done,
            Some(now) if k == now => StageProgress::Now,
            Some(_) | None => StageProgress::Ahead,
        },
    };
    STAGES.iter().enumerate().map(stage).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingTopic;

    #[test]
    fn go_and_what_stops_it() {
        let lamp = FindingTopic("course").warning("the lamp is broken", "mend it");
        let closed = FindingTopic("deck").stopping("closed by the crew", "open it");
        let link = FindingTopic("link").broken("the estimate is 3 s old", "is it in reach?");
        let fine = FindingTopic("battery").fine("at 80 %");
        let go = |all: &[&Finding], unknown| {
            let all: Vec<Finding> = all.iter().map(|f| (*f).clone()).collect();
            let go = Go::of(&all, unknown);
            (go.go, go.why)
        };
        assert_eq!(go(&[&fine], None).0, Some(true));
        assert_eq!(
            go(&[&fine, &lamp], None),
            (Some(true), "one warning, which does not stop a landing".into())
        );
        assert_eq!(
            go(&[&lamp, &closed], None),
            (Some(false), "deck: closed by the crew".into())
        );
        assert_eq!(
            go(&[&closed, &link], None),
            (Some(false), "link: the estimate is 3 s old".into())
        );
        assert_eq!(
            go(&[&fine], Some("no mission reports")),
            (None, "no mission reports".into())
        );
        assert_eq!(go(&[&link], Some("no mission reports")).0, Some(false));
    }

    #[test]
    fn worse_of_two_goes() {
        let go = || Go::of(&[], None);
        let (unknown, barred) = (|| Go::unknown("no wind"), || Go::barred("Landed"));
        assert_eq!(go().worse(None), go());
        assert_eq!(go().worse(Some(unknown())), unknown());
        assert_eq!(unknown().worse(Some(go())), unknown());
        assert_eq!(unknown().worse(Some(barred())), barred());
        assert_eq!(barred().worse(Some(unknown())), barred());
    }

    #[test]
    fn states_in_which_no_landing_is_ordered() {
        let why = |state, code: ReasonCode| barred(state, &code.into());
        assert_eq!(
            why(State::GaveUp, ReasonCode::Operator).as_deref(),
            Some("Gave up: operator's command")
        );
        let bars = |state| why(state, ReasonCode::None).is_some();
        assert!([State::Landed, State::Preparing, State::TakeOff, State::StandDown].map(bars) == [true; 4]);
        // The mission takes an order in a climb after a take-off, and one goes on in a descent.
        assert!([State::Idle, State::Hold, State::ClimbOut, State::Descent].map(bars) == [false; 4]);
        assert!(
            no_forecast(0.004).is_some() && no_forecast(f64::NAN).is_some() && no_forecast(0.3).is_none()
        );
    }

    /// No state's sentence calls progress a wait, and an end names its cause.
    #[test]
    fn sentences_of_states() {
        let of =
            |state, entered: Reason, waits: Reason| sentence(state, &entered, waits.code, waits.to_string());
        let none = Reason::default();
        let sinking = Reason::new(ReasonCode::Descending, 2.1, 0.9);
        let fast = Reason::new(ReasonCode::TooFast, 0.45, 0.3);
        let aborted = Reason::from(ReasonCode::Operator);
        for (state, entered, waits, expected) in [
            (
                State::Idle,
                none,
                ReasonCode::NotCommanded.into(),
                "waits: no landing commanded",
            ),
            (
                State::TrackingStable,
                none,
                fast,
                "waits: 0.45 m/s relative to the deck (limit 0.30)",
            ),
            (State::Descent, none, sinking, "descending, 1.2 m to the flare"),
            (
                State::Flare,
                none,
                Reason::new(ReasonCode::Flaring, 0.4, 0.0),
                "flaring, 0.4 m above the deck",
            ),
            (State::Landed, ReasonCode::Touchdown.into(), none, "touchdown"),
            (State::Landed, none, none, "stands on the deck"),
            (State::GaveUp, aborted, fast, "operator's command"),
            (State::Hold, aborted, fast, "operator's command"),
            (State::TakeOff, none, none, "leaves the deck"),
        ] {
            assert_eq!(of(state, entered, waits), expected, "{state:?}");
        }
    }

    #[test]
    fn stages_of_a_landing() {
        let is = |state| stages(state).iter().map(|s| s.is).collect::<Vec<_>>();
        assert!(is(State::Hold).iter().all(|s| *s == StageProgress::Ahead));
        let descent = is(State::Descent);
        assert_eq!(
            (descent[3], descent[4], descent[5]),
            (StageProgress::Done, StageProgress::Now, StageProgress::Ahead)
        );
        assert_eq!(is(State::Landed).last(), Some(&StageProgress::Now));
    }
}

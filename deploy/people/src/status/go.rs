use alight_shared::msg::{DroneStatus, Phase, Reason, ReasonCode, State};
use serde::Serialize;

use super::{
    StateView,
    finding::{Finding, FindingLevel},
};

/// Stages of a landing in order, without hold, idle and abort states.
const STAGES: [State; 7] = [
    State::GetAltitude,
    State::Approach,
    State::Tracking,
    State::TrackingStable,
    State::Descent,
    State::Flare,
    State::Landed,
];

const NO_QUALITY: f64 = 0.005;
pub const NO_WIND: &str = "the wind is not known yet";

/// Text for a forecast of unusable quality (0 to 1); None if the quality suffices.
pub fn no_forecast(quality: f64) -> Option<&'static str> {
    let none = !(quality >= NO_QUALITY);
    none.then_some("forecast quality 0 %: the vessel's motion is not identified yet, or she lies still")
}

/// Reason why the state, entered for the reason `entered`, forbids a landing order: the drone stands on the deck,
/// takes off, or has ended or aborted its attempt. None if a landing may be ordered or continue.
pub fn barred(state: State, entered: &Reason) -> Option<String> {
    let bars = state.ending().is_some() || state.stands_for_take_off() || state == State::TakeOff;
    bars.then(|| state.because(entered))
}

/// Whether a landing is ordered. In `Idle` and `Hold` the awaited condition shows it.
pub fn is_ordered(d: &DroneStatus) -> bool {
    match d.state {
        State::Idle | State::Hold => {
            let unordered = matches!(
                d.waiting.code,
                ReasonCode::None
                    | ReasonCode::NotCommanded
                    | ReasonCode::Operator
                    | ReasonCode::HandsOver
                    | ReasonCode::HeldLow
                    | ReasonCode::BatteryStopped
            );
            !unordered && d.station.is_none()
        }
        state => state.is_landing(),
    }
}

/// Whether the probability of a landing is too low.
pub const fn is_unlikely(code: ReasonCode) -> bool {
    matches!(
        code,
        ReasonCode::LikelyHard
            | ReasonCode::LikelyFast
            | ReasonCode::LikelyTilted
            | ReasonCode::LikelyOutside
            | ReasonCode::LikelySlides
            | ReasonCode::TurnTooFast
            | ReasonCode::HarmLikely
    )
}

/// Condition of the next state. A flare has none: its violations last for a fraction of a second.
fn awaited(d: &DroneStatus) -> String {
    if d.state == State::Flare {
        return String::new();
    }
    d.waits()
}

/// The outcome of an attempt that has ended; otherwise its progress, or `waits: ` with the condition of the next state;
/// otherwise the drone's activity.
fn sentence(d: &DroneStatus) -> String {
    let why = d.entered.to_string();
    let ended = d.state.ending().is_some() || d.state == State::StandDown;
    if ended && !why.is_empty() {
        return why;
    }
    // These texts describe progress, not a missing condition.
    let goes_on = matches!(
        d.waiting.code,
        ReasonCode::Descending
            | ReasonCode::DescendingTo
            | ReasonCode::Counting
            | ReasonCode::Leaving
            | ReasonCode::Searching
            | ReasonCode::SeeksVessel
            | ReasonCode::HandsOver
            | ReasonCode::TurnsBack
            | ReasonCode::OnStation
    );
    let waits = awaited(d);
    if waits.is_empty() {
        d.state.does().into()
    } else if goes_on {
        waits
    } else {
        format!("waits: {waits}")
    }
}

pub fn view(d: &DroneStatus, name: String, since_s: f64, stale: bool) -> StateView {
    StateView {
        name,
        does: d.state.does(),
        since_s,
        entered: d.entered.to_string(),
        waiting: awaited(d),
        rejected: d.rejected.map(|why| why.to_string()).unwrap_or_default(),
        sentence: sentence(d),
        stages: stages(d.state),
        stale,
    }
}

/// Whether a landing may be ordered now or may continue, with the reason.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Go {
    /// None if unknown.
    pub go: Option<bool>,
    /// Verdict for the crew: before an order GO, NO-GO or unknown; after it LANDS, WAITS, or ACT if the crew has to
    /// act; then the outcome.
    pub verdict: &'static str,
    /// Activity of the drone, or action required of the crew.
    pub why: String,
}

const UNKNOWN: &str = "unknown";

impl Go {
    pub fn unknown(missing: impl Into<String>) -> Go {
        Go {
            go: None,
            verdict: UNKNOWN,
            why: missing.into(),
        }
    }
    pub fn barred(why: impl Into<String>) -> Go {
        Go {
            go: Some(false),
            verdict: "NO-GO",
            why: why.into(),
        }
    }
    /// Judgement of an ordered landing or of its end by the mission's report; None before an order. `alarm` requires
    /// the crew to act; without one, the landing continues by the means `how`.
    pub fn answer(d: &DroneStatus, alarm: Option<&Finding>, how: Option<String>) -> Option<Go> {
        if !is_ordered(d) {
            let ended = Go::ended(d.state, &d.entered, d.armed);
            return ended.filter(|_| alarm.is_none());
        }
        if let Some(alarm) = alarm {
            let barred = Go::barred(alarm.remedy.as_str());
            return Some(Go {
                verdict: "ACT",
                ..barred
            });
        }
        let descends = matches!(d.waiting.code, ReasonCode::Descending | ReasonCode::None);
        let sinks = d.state == State::Descent && descends;
        if sinks || d.state == State::Flare {
            return Some(Go {
                go: (!is_unlikely(d.waiting.code)).then_some(true),
                verdict: "LANDS",
                why: how.unwrap_or_else(|| "no action needed".into()),
            });
        }
        let waits = Go::unknown(how.unwrap_or_else(|| sentence(d).replacen("waits: ", "", 1)));
        Some(Go {
            verdict: "WAITS",
            ..waits
        })
    }
    /// Outcome of an attempt that has ended as planned or by order; otherwise None.
    fn ended(state: State, entered: &Reason, armed: bool) -> Option<Go> {
        let verdict = state.named(entered);
        let why = if state == State::Landed && entered.code != ReasonCode::HardContact {
            if armed {
                "keep clear until it is disarmed"
            } else {
                "disarmed: close the deck before anyone goes to it"
            }
        } else if state == State::GaveUp && verdict != state.name() {
            "holds clear of the deck: order a landing, or take over"
        } else {
            return None;
        };
        let barred = Go::barred(why);
        Some(Go { verdict, ..barred })
    }
    /// The worse of the two, or the first if they are equal: NO-GO before unknown before GO.
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
    /// Judgement by findings; `unknown` names missing data.
    pub fn of(findings: &[Finding], unknown: Option<&str>) -> Go {
        let worst = findings.iter().filter(|f| f.stops).rev().max_by_key(|f| f.level);
        if let Some(f) = worst {
            // The text of the mission's finding already has a subject.
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
            0 => "ready to land".into(),
            1 => "one warning, which does not stop a landing".into(),
            n => format!("{n} warnings, which do not stop a landing"),
        };
        Go {
            go: Some(true),
            verdict: "GO",
            why,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stage {
    pub name: &'static str,
    pub is: StageProgress,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StageProgress {
    Done,
    Now,
    Ahead,
}

/// Whether the drone descends, so that the decision to begin is past.
pub fn descends(state: State) -> bool {
    state.phase() == Phase::Landing
}

pub fn stages(state: State) -> Vec<Stage> {
    // A search ends the approach to a vessel that is located by its beacon.
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
    fn states_in_which_no_landing_is_ordered() {
        let why = |state, code: ReasonCode| barred(state, &code.into());
        assert_eq!(
            why(State::GaveUp, ReasonCode::Operator).as_deref(),
            Some("Aborted: operator's command")
        );
        let bars = |state| why(state, ReasonCode::None).is_some();
        assert!([State::Landed, State::Preparing, State::TakeOff, State::StandDown].map(bars) == [true; 4]);
        // The mission accepts an order during the climb after a take-off; a landing continues during a descent.
        assert!([State::Idle, State::Hold, State::ClimbOut, State::Descent].map(bars) == [false; 4]);
        assert!(
            no_forecast(0.004).is_some() && no_forecast(f64::NAN).is_some() && no_forecast(0.3).is_none()
        );
    }

    /// State, reason for entering it, reason for waiting, verdict and its colour, and the large sentence.
    #[test]
    fn answer_and_sentence_of_each_state() {
        let none = Reason::default();
        let fast = Reason::new(ReasonCode::TooFast, 0.45, 0.3);
        let sinks = Reason::new(ReasonCode::Descending, 2.1, 0.9);
        let steps = Reason::new(ReasonCode::DescendingTo, 5.0, 3.0);
        let aborted = ReasonCode::Operator.into();
        let idle = ReasonCode::NotCommanded.into();
        let unlikely = Reason::new(ReasonCode::LikelyTilted, 0.45, 0.95);
        let percent = "waits: probability of a landing 45 % (needs 95 %): the deck may tilt too far";
        for (state, entered, waiting, verdict, go, sentence) in [
            (
                State::Hold,
                aborted,
                idle,
                "",
                None,
                "waits: no landing commanded",
            ),
            (
                State::Hold,
                idle,
                fast,
                "WAITS",
                None,
                "waits: 0.45 m/s relative to the deck (limit 0.30)",
            ),
            (State::TrackingStable, none, unlikely, "WAITS", None, percent),
            (
                State::Descent,
                none,
                sinks,
                "LANDS",
                Some(true),
                "descending, 1.2 m to the flare",
            ),
            (
                State::Descent,
                none,
                steps,
                "WAITS",
                None,
                "descending, 2.0 m to 3.0 m above the deck",
            ),
            (State::Descent, none, unlikely, "WAITS", None, percent),
            (
                State::Flare,
                none,
                fast,
                "LANDS",
                Some(true),
                "sets down with the deck's attitude",
            ),
            (
                State::Flare,
                none,
                unlikely,
                "LANDS",
                None,
                "sets down with the deck's attitude",
            ),
            (
                State::GaveUp,
                aborted,
                fast,
                "Aborted",
                Some(false),
                "operator's command",
            ),
        ] {
            let report = DroneStatus {
                state,
                entered,
                waiting,
                rejected: Some(fast),
                ..DroneStatus::default()
            };
            let answer = Go::answer(&report, None, None).unwrap_or_default();
            assert_eq!(
                (answer.verdict, answer.go),
                (verdict, go),
                "{state:?} {waiting:?}"
            );
            let view = view(&report, String::new(), 0.0, false);
            assert_eq!(
                (view.sentence.as_str(), view.rejected),
                (sentence, fast.to_string())
            );
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

//! GO or NO-GO for a landing, and the stages of one.

use alight_shared::msg::State;
use serde::Serialize;

use super::finding::{Finding, Level};

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

/// Whether a landing may go on, in one word and one sentence.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Go {
    /// None: not known.
    pub go: Option<bool>,
    /// What stands against it; of a GO what else is to be known.
    pub why: String,
}

impl Go {
    /// By what was found; `unknown` says what is missing for a judgement.
    pub fn of(findings: &[Finding], unknown: Option<&str>) -> Go {
        // Of several the worst; of equals the first.
        let worst = findings.iter().filter(|f| f.stops).rev().max_by_key(|f| f.level);
        if let Some(f) = worst {
            return Go {
                go: Some(false),
                why: format!("{}: {}", f.topic, f.found),
            };
        }
        if let Some(missing) = unknown {
            return Go {
                go: None,
                why: missing.into(),
            };
        }
        let why = match findings.iter().filter(|f| f.level > Level::Fine).count() {
            0 => "nothing stands against a landing".into(),
            1 => "one warning, which does not stop a landing".into(),
            n => format!("{n} warnings, which do not stop a landing"),
        };
        Go { go: Some(true), why }
    }
}

/// A stage, and whether the landing is past it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stage {
    /// Its name.
    pub name: &'static str,
    /// Where the landing is in relation to it.
    pub is: Progress,
}

/// Where a landing is in relation to a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Progress {
    /// Past it.
    Done,
    /// In it.
    Now,
    /// Before it.
    Ahead,
}

/// The stages, seen from a state.
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
            Some(now) if k < now => Progress::Done,
            Some(now) if k == now => Progress::Now,
            Some(_) | None => Progress::Ahead,
        },
    };
    STAGES.iter().enumerate().map(stage).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::Topic;

    #[test]
    fn go_and_what_stops_it() {
        let lamp = Topic("course").warning("the lamp is broken", "mend it");
        let closed = Topic("deck").stopping("closed by the crew", "open it");
        let link = Topic("link").broken("the estimate is 3 s old", "is it in reach?");
        let fine = Topic("battery").fine("at 80 %");
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
    fn stages_of_a_landing() {
        let is = |state| stages(state).iter().map(|s| s.is).collect::<Vec<_>>();
        assert!(is(State::Hold).iter().all(|s| *s == Progress::Ahead));
        let descent = is(State::Descent);
        assert_eq!(
            (descent[3], descent[4], descent[5]),
            (Progress::Done, Progress::Now, Progress::Ahead)
        );
        assert_eq!(is(State::Landed).last(), Some(&Progress::Now));
    }
}

//! Handshake about the vessel's helm: drone, vessel's computer, skipper, boat's autopilot.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::within;

/// Longest time until a vessel that turns promises to be steady, s: half a circle at 3 deg/s.
pub const MAX_HELM_TURN_S: f32 = 60.0;

/// State of the handshake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum HelmState {
    /// Nothing is asked: no landing or take-off is under way, or no course is better.
    #[default]
    Idle,
    /// The skipper is asked whether the vessel may be steered.
    Asked,
    /// He agreed: the vessel turns to the course.
    Agreed,
    /// The vessel is on the course and keeps it.
    Steady,
    /// The landing is over: the vessel goes back to the course and the mode that it had.
    Done,
    /// The handshake has ended before the landing did ([`HelmStatus::why`]): the boat steers as its skipper has it.
    Withdrawn,
}

impl HelmState {
    /// The vessel's computer steers.
    pub fn steers(self) -> bool {
        match self {
            HelmState::Agreed | HelmState::Steady | HelmState::Done => true,
            HelmState::Idle | HelmState::Asked | HelmState::Withdrawn => false,
        }
    }
}

/// Why a handshake was withdrawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum HelmEnd {
    /// It was not.
    #[default]
    None,
    /// The skipper refused, or took the helm back by order or switch.
    Refused,
    /// The skipper has not answered.
    Unanswered,
    /// The measured course or speed is not what was commanded: somebody steers by hand, or the boat does not follow.
    HandOnHelm,
    /// The boat's autopilot was switched to another mode.
    ModeChanged,
    /// The boat's autopilot is silent, or its link is not open.
    LinkLost,
    /// The boat's autopilot denies the mode in which it takes a course.
    Denied,
    /// The vessel's own motion is not known, so that a hand on the helm would not be noticed.
    NoEstimate,
    /// The helm states that the vessel turns or may turn.
    Turning,
    /// The vessel's process ended, or was restarted, while it steered.
    Restarted,
    /// A drone began its descent or its take-off before the boat's autopilot had taken the helm.
    Descent,
    /// The drone that comes has not landed for too long.
    TooLong,
    /// The boat's autopilot has not taken its former mode back, or it is unknown whether it has.
    NotGivenBack,
    /// The boat was not steady on the course in time.
    NotSettled,
    /// It has gone as far as one yes allows.
    TooFar,
}

impl fmt::Display for HelmEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            HelmEnd::None => "no reason",
            HelmEnd::Refused => "refused by the skipper",
            HelmEnd::Unanswered => "the skipper has not answered",
            HelmEnd::HandOnHelm => "course or speed is not what was commanded: a hand on the helm",
            HelmEnd::ModeChanged => "the boat's autopilot was switched to another mode",
            HelmEnd::LinkLost => "the boat's autopilot is silent, or its link is not open",
            HelmEnd::Denied => "the boat's autopilot denies the mode that takes a course",
            HelmEnd::NoEstimate => "the vessel's motion is not known",
            HelmEnd::Turning => "the helm states that the vessel turns",
            HelmEnd::Restarted => "the vessel's process ended or was restarted",
            HelmEnd::Descent => "a drone descends or takes off on the course that is",
            HelmEnd::TooLong => "the drone has not landed for too long (helm.max_time_s)",
            HelmEnd::NotGivenBack => "the former mode was not taken back by the boat's autopilot",
            HelmEnd::NotSettled => "the boat is not steady on the course",
            HelmEnd::TooFar => "the boat has gone as far as one yes allows (helm.max_way_m)",
        })
    }
}

/// The course of a question to the skipper, as it is shown to him.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AskedCourse {
    /// Heading, whole degrees from true north, 0 to 359.
    pub heading_deg: u16,
    /// Speed over ground, tenths of m/s.
    pub speed_dmps: u16,
}

impl fmt::Display for AskedCourse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mps = f64::from(self.speed_dmps) / 10.0;
        write!(f, "{:03} deg true at {mps:.1} m/s", self.heading_deg)
    }
}

/// The skipper's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(C, u8)]
pub enum HelmAnswer {
    /// The vessel's computer may steer this course for this landing; it counts while that is what is asked.
    Yes(AskedCourse),
    /// It may not, whatever is asked; the helm is taken back.
    No,
}

/// State of the handshake about the helm, as it goes over the radio with the deck's owner.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct HelmStatus {
    /// State of the handshake.
    pub state: HelmState,
    /// Why it was withdrawn.
    pub why: HelmEnd,
    /// Heading that is asked for or commanded, rad.
    pub heading_rad: f32,
    /// Speed over ground that is asked for or commanded, m/s.
    pub speed_mps: f32,
    /// With [`HelmState::Agreed`]: the vessel is steady in so long, s.
    pub steady_in_s: f32,
    /// Probability of a landing once it is steady, 0 to 1; 1 where it is not computed.
    pub likelihood: f32,
}

impl HelmStatus {
    /// Every number is finite and possible.
    pub fn is_sound(&self) -> bool {
        within([&self.heading_rad], 7.0)
            && (0.0..=30.0).contains(&self.speed_mps)
            && (0.0..=MAX_HELM_TURN_S).contains(&self.steady_in_s)
            && (0.0..=1.0).contains(&self.likelihood)
    }
    /// The heading, deg from true north, 0 to 360.
    pub fn heading_deg(&self) -> f64 {
        compass_deg(f64::from(self.heading_rad))
    }
    /// Course that the skipper is asked for, while he is.
    pub fn asked(&self) -> Option<AskedCourse> {
        (self.state == HelmState::Asked).then(|| AskedCourse {
            heading_deg: self.heading_deg() as u16,
            speed_dmps: (10.0 * self.speed_mps).round() as u16,
        })
    }
}

/// An angle as a compass shows it, in whole degrees from 0 to 359.
pub(crate) fn compass_deg(rad: f64) -> f64 {
    // No negative zero.
    rad.to_degrees().round().rem_euclid(360.0) + 0.0
}

impl fmt::Display for HelmStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (deg, mps) = (self.heading_deg(), self.speed_mps);
        match self.state {
            HelmState::Idle => write!(f, "not asked"),
            HelmState::Asked => write!(f, "asks to steer {deg:03.0} deg true at {mps:.1} m/s"),
            HelmState::Agreed => write!(
                f,
                "turns to {deg:03.0} deg true at {mps:.1} m/s, steady in {:.0} s",
                self.steady_in_s
            ),
            HelmState::Steady => write!(f, "steady on {deg:03.0} deg true at {mps:.1} m/s"),
            HelmState::Done => write!(f, "goes back to {deg:03.0} deg true at {mps:.1} m/s"),
            HelmState::Withdrawn => write!(f, "withdrawn: {}", self.why),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn helm_status_texts() {
        let status = HelmStatus {
            state: HelmState::Agreed,
            heading_rad: -0.0001,
            speed_mps: 2.0,
            steady_in_s: 12.0,
            ..HelmStatus::default()
        };
        assert_eq!(
            status.to_string(),
            "turns to 000 deg true at 2.0 m/s, steady in 12 s"
        );
        let refused = HelmStatus {
            state: HelmState::Withdrawn,
            why: HelmEnd::Refused,
            ..status
        };
        assert_eq!(refused.to_string(), "withdrawn: refused by the skipper");
        // The course that is asked is named as it is shown.
        let asked = HelmStatus {
            state: HelmState::Asked,
            heading_rad: 0.7,
            speed_mps: 2.04,
            ..status
        };
        let course = asked.asked().map(|c| format!("asks to steer {c}"));
        assert_eq!(course, Some(asked.to_string()));
        assert_eq!((status.asked(), refused.asked()), (None, None));
    }

    #[test]
    fn impossible_helm_status() {
        let sound = HelmStatus::default();
        assert!(sound.is_sound());
        for wrong in [
            HelmStatus {
                heading_rad: f32::NAN,
                ..sound
            },
            HelmStatus {
                speed_mps: -1.0,
                ..sound
            },
            HelmStatus {
                steady_in_s: 1e6,
                ..sound
            },
            HelmStatus {
                likelihood: 2.0,
                ..sound
            },
        ] {
            assert!(!wrong.is_sound(), "{wrong:?}");
        }
    }
}

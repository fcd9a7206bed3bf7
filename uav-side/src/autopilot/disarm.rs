//! Forced disarm on the deck.
//!
//! Stock land detectors do not disarm on a heaving deck (PX4: not within 90 s at 0.5 m). After the pilot's
//! confirmed touchdown the link therefore sends `MAV_CMD_COMPONENT_ARM_DISARM` with 21196, which an autopilot
//! executes even in the air. To prevent that, the drone must also be near the deck, slow relative to it, and
//! supported by something other than its rotors. Each command requires fresh evidence; the intervals increase
//! after a quick series.

use core::fmt;

use alight_shared::{
    admission::Periodic,
    msg::{MissionState, State},
    time::{DroneClock, Span},
};
use serde::{Deserialize, Serialize};

use super::{DroneTime, config::DisarmConfig};

/// Duration of the evidence without the pilot's set-points, s: several time constants of the specific force.
pub(crate) const HOLD_ALONE_S: f64 = 0.2;

/// Height of resting feet by the rangefinder, m, their speed along the deck's normal, m/s, and the duration of this
/// evidence, s. A drone that hovers there falls onto the deck with 0.95 m/s at most.
pub(crate) const RESTS_M: f64 = 0.04;
pub(crate) const RESTS_NORMAL_MPS: f64 = 0.3;
const RESTS_HOLD_S: f64 = 0.05;
/// Time between commands after the quick series, s; the autopilot may accept one of these.
const RARE_S: f64 = 2.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ContactEvidence {
    pub(crate) landing: bool,
    /// Height of the feet above the deck by rangefinder, m; None without an accepted reading.
    pub(crate) range_height: Option<f64>,
    pub(crate) range_doubted: bool,
    pub(crate) forecast_height: Option<f64>,
    /// Speed relative to the deck, m/s; None without a forecast.
    pub(crate) speed: Option<f64>,
    pub(crate) load_factor: Option<f64>,
    /// Reported thrust as a fraction of hover; None without a recent report.
    pub(crate) thrust: Option<f64>,
    /// Whether the commanded thrust has been that of a resting drone for long enough to take effect.
    pub(crate) commanded_low: bool,
    /// Whether something other than the rotors carries a drone that does not rotate. It needs no forecast.
    pub(crate) stands: bool,
    /// Whether the mission has landed and two heights show the feet on the deck, with which they move. Then the drone may
    /// be disarmed although its autopilot holds it with more thrust.
    pub(crate) rests: bool,
    pub(crate) reports_on_ground: bool,
}

/// Maximum thrust, as a fraction of hover, and rotation rate, rad/s, of a drone that stands: below the load factor of
/// [`DisarmConfig`] with an error of 10 %, and above those of a rocking deck.
pub(crate) const STANDS_OF_HOVER: f64 = 0.6;
pub(crate) const STANDS_RADPS: f64 = 0.7;
/// Maximum speed relative to the deck of a drone at rest on it, when no thrust is reported, m/s.
pub(crate) const RESTS_MPS: f64 = 0.5;
/// Height from which a drone pressed down at half of hover thrust hits the deck at 1 m/s, the limit of a
/// successful landing, m: `h = v² / g`.
const PRESS_BELOW_M: f64 = 0.1;
/// Height below which the drone is pressed down when only the forecast gives the height, m: the forecast's
/// error.
pub(crate) const PRESS_BELOW_BLIND_M: f64 = 0.2;

impl ContactEvidence {
    pub(crate) fn is_low(&self) -> bool {
        match (self.range_height, self.forecast_height) {
            (Some(h), _) => h <= PRESS_BELOW_M,
            (None, Some(h)) => h <= PRESS_BELOW_BLIND_M,
            (None, None) => false,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DisarmInhibit {
    NotLanding,
    HeightUnknown,
    RangeHigh,
    ForecastHigh,
    Fast,
    /// The rotors carry the drone, or it is falling.
    NotSupported,
}

impl fmt::Display for DisarmInhibit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DisarmInhibit::NotLanding => "the mission does not land",
            DisarmInhibit::HeightUnknown => "neither rangefinder nor forecast gives the height of the feet",
            DisarmInhibit::RangeHigh => "the rangefinder measures air below the feet",
            DisarmInhibit::ForecastHigh => "the forecast deck is further below",
            DisarmInhibit::Fast => "too fast relative to the deck",
            DisarmInhibit::NotSupported => "the deck does not support the drone",
        })
    }
}

pub(crate) fn inhibit(e: &ContactEvidence, c: &DisarmConfig) -> Option<DisarmInhibit> {
    if !e.landing {
        return Some(DisarmInhibit::NotLanding);
    }
    if e.rests {
        return None;
    }
    // NaN counts as high, fast and unsupported.
    let high = |h: Option<f64>| h.is_some_and(|h| !(h <= c.height_m));
    if high(e.range_height) {
        return Some(DisarmInhibit::RangeHigh);
    }
    if high(e.forecast_height) {
        return Some(DisarmInhibit::ForecastHigh);
    }
    if e.range_height.is_none() && e.forecast_height.is_none() && !e.stands {
        return Some(DisarmInhibit::HeightUnknown);
    }
    if !e.speed.map_or(e.stands, |v| v <= c.speed_mps) {
        return Some(DisarmInhibit::Fast);
    }
    let supported = e.load_factor.is_some_and(|f| f >= c.min_load_factor);
    // A thrust that is no longer reported must not count as zero or as its last value. The commanded thrust
    // replaces it, and the motion with the deck shows that the drone follows the command.
    let idle = match e.thrust {
        Some(t) => t <= c.max_thrust_of_hover,
        None => e.commanded_low && e.speed.is_some_and(|v| v <= RESTS_MPS),
    };
    // The autopilot's on-ground report may replace the thrust, but never the load factor.
    if !(supported && (idle || e.reports_on_ground)) {
        return Some(DisarmInhibit::NotSupported);
    }
    None
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DisarmDecision {
    Press,
    Command,
    Idle,
    InAir(DisarmInhibit),
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DisarmSequence {
    missing_since: Option<DroneTime>,
    complete_since: Option<DroneTime>,
    next: Periodic<DroneClock>,
    sent: u32,
}

impl DisarmSequence {
    pub(crate) fn clear(&mut self) {
        *self = DisarmSequence::default();
    }
    pub(crate) fn sent(&self) -> u32 {
        self.sent
    }
    pub(crate) fn step(&mut self, now: DroneTime, e: &ContactEvidence, c: &DisarmConfig) -> DisarmDecision {
        if let Some(d) = inhibit(e, c) {
            self.complete_since = None;
            let missing_since = *self.missing_since.get_or_insert(now);
            return if (now - missing_since).secs() <= c.evidence_timeout_s {
                DisarmDecision::Press
            } else {
                DisarmDecision::InAir(d)
            };
        }
        self.missing_since = None;
        let complete_since = *self.complete_since.get_or_insert(now);
        // When a source is missing, the evidence must last longer.
        let hold_s = if e.rests {
            RESTS_HOLD_S
        } else if e.thrust.is_none() || e.range_doubted || e.speed.is_none() {
            c.hold_s.max(HOLD_ALONE_S)
        } else {
            c.hold_s
        };
        if (now - complete_since).secs() < hold_s {
            return DisarmDecision::Press;
        }
        if !c.on_deck || !self.next.is_ready(now) {
            return DisarmDecision::Idle;
        }
        self.sent = self.sent.saturating_add(1);
        let pause_s = if self.sent < c.tries { c.pause_s } else { RARE_S };
        self.next.restart(now, Span::from_secs(pause_s));
        DisarmDecision::Command
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ForcedDisarm {
    pub(super) touchdown: DisarmSequence,
    /// Sequence for an autopilot that holds by itself.
    pub(super) alone: DisarmSequence,
    pub(super) own_landing: DisarmSequence,
    pub(super) inhibited: Option<DisarmInhibit>,
    abort: Option<[u32; 2]>,
    pub(super) report: Periodic<DroneClock>,
}

impl ForcedDisarm {
    /// Repeats the quick commands after an abort on the deck, which requires the motors to stop.
    pub(super) fn restart(&mut self, mission: &MissionState) {
        if mission.abort != self.abort && mission.state == State::Landed {
            self.touchdown.clear();
            self.alone.clear();
        }
        self.abort = mission.abort;
    }
}

impl DisarmConfig {
    /// Maximum time from touchdown to the last answer, s: `evidence_timeout_s + hold_s + tries pause_s`.
    pub fn longest_s(&self) -> f64 {
        self.evidence_timeout_s + self.hold_s.max(HOLD_ALONE_S) + f64::from(self.tries) * self.pause_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::still_armed_s, time::Time};

    #[test]
    fn armed_drone_after_the_disarm_sequence() {
        let c = DisarmConfig::default();
        // The last command is answered within the pause before the end.
        let mut d = DisarmSequence::default();
        let within = ((c.longest_s() - c.pause_s) * 1e3) as i64;
        assert_eq!(commands(&mut d, 0, within, &ON_DECK, &c), c.tries);
        let landed = MissionState {
            state: State::Landed,
            since: Time::from_secs(10.0),
            ..MissionState::default()
        };
        let after = |s: f64, m: &MissionState, armed, c: &DisarmConfig| {
            still_armed_s(Time::from_secs(10.0 + s), m, armed, c.longest_s()).map(|s| s.round())
        };
        assert_eq!(after(c.longest_s() - 0.1, &landed, true, &c), None);
        assert_eq!(after(14.0, &landed, true, &c), Some(14.0));
        assert_eq!(after(14.0, &landed, false, &c), None);
        let off = DisarmConfig { on_deck: false, ..c };
        assert_eq!(after(14.0, &landed, true, &off), Some(14.0));
        let flies = MissionState {
            state: State::Hold,
            ..landed
        };
        assert_eq!(after(14.0, &flies, true, &c), None);
        let stopped = MissionState {
            state: State::StandDown,
            ..landed
        };
        let by_time = [4.0, 14.0].map(|s| after(s, &stopped, true, &c));
        assert_eq!(by_time, [None, Some(14.0)]);
    }

    const ON_DECK: ContactEvidence = ContactEvidence {
        landing: true,
        range_height: Some(0.02),
        range_doubted: false,
        forecast_height: Some(0.05),
        speed: Some(0.2),
        load_factor: Some(1.0),
        thrust: Some(0.3),
        commanded_low: true,
        stands: false,
        rests: false,
        reports_on_ground: false,
    };

    fn commands(d: &mut DisarmSequence, from_ms: i64, ms: i64, e: &ContactEvidence, c: &DisarmConfig) -> u32 {
        (0..ms / 10)
            .filter(|k| {
                d.step(Time::from_nanos((from_ms + 10 * k) * 1_000_000), e, c) == DisarmDecision::Command
            })
            .count() as u32
    }

    #[test]
    fn disarm_attempts_on_the_deck() {
        let c = DisarmConfig::default();
        let mut d = DisarmSequence::default();
        assert_eq!(commands(&mut d, 0, 40, &ON_DECK, &c), 1);
        // Ten commands within 2 s, then one every 2 s while the drone is armed on the deck.
        assert_eq!(commands(&mut d, 40, 2_000, &ON_DECK, &c), c.tries - 1);
        assert_eq!(commands(&mut d, 2_040, 58_000, &ON_DECK, &c), 29);
        let off = DisarmConfig { on_deck: false, ..c };
        assert_eq!(
            commands(&mut DisarmSequence::default(), 0, 10_000, &ON_DECK, &off),
            0
        );
    }

    #[test]
    fn disarm_evidence() {
        let c = DisarmConfig::default();
        type Change = fn(&mut ContactEvidence);
        let cases: [(Change, DisarmInhibit); 13] = [
            (|e| e.landing = false, DisarmInhibit::NotLanding),
            (|e| e.range_height = Some(1.0), DisarmInhibit::RangeHigh),
            (|e| e.range_height = Some(f64::NAN), DisarmInhibit::RangeHigh),
            (|e| e.forecast_height = Some(1.0), DisarmInhibit::ForecastHigh),
            (
                |e| (e.range_height, e.forecast_height) = (None, None),
                DisarmInhibit::HeightUnknown,
            ),
            (|e| e.speed = Some(3.0), DisarmInhibit::Fast),
            (|e| e.speed = None, DisarmInhibit::Fast),
            // Hovering drone.
            (|e| e.thrust = Some(1.0), DisarmInhibit::NotSupported),
            // Falling drone with the thrust cut, while the autopilot reports ground contact.
            (
                |e| (e.load_factor, e.reports_on_ground) = (Some(0.4), true),
                DisarmInhibit::NotSupported,
            ),
            (|e| e.load_factor = None, DisarmInhibit::NotSupported),
            // Low thrust is commanded but not reported, and the drone moves over the deck or falls.
            (
                |e| (e.thrust, e.commanded_low) = (None, false),
                DisarmInhibit::NotSupported,
            ),
            (
                |e| (e.thrust, e.speed) = (None, Some(0.8)),
                DisarmInhibit::NotSupported,
            ),
            (
                |e| (e.thrust, e.load_factor) = (None, Some(0.4)),
                DisarmInhibit::NotSupported,
            ),
        ];
        for (change, why) in cases {
            let mut e = ON_DECK;
            change(&mut e);
            assert_eq!(inhibit(&e, &c), Some(why), "{e:?}");
            assert_eq!(
                commands(&mut DisarmSequence::default(), 0, 10_000, &e, &c),
                0,
                "{e:?}"
            );
            let mut d = DisarmSequence::default();
            assert_eq!(d.step(Time::from_secs(0.0), &e, &c), DisarmDecision::Press);
            assert_eq!(d.step(Time::from_secs(1.0), &e, &c), DisarmDecision::InAir(why));
        }
        let blind = ContactEvidence {
            range_height: None,
            reports_on_ground: true,
            thrust: None,
            ..ON_DECK
        };
        assert_eq!(inhibit(&blind, &c), None);
        // Without forecast and rangefinder, gravity at little thrust shows that the drone stands.
        let unled = ContactEvidence {
            range_height: None,
            forecast_height: None,
            speed: None,
            stands: true,
            ..ON_DECK
        };
        assert_eq!(inhibit(&unled, &c), None);
    }

    #[test]
    fn disarm_with_a_witness_missing() {
        let c = DisarmConfig::default();
        let silent = ContactEvidence {
            thrust: None,
            ..ON_DECK
        };
        assert_eq!(inhibit(&silent, &c), None);
        let mut d = DisarmSequence::default();
        assert_eq!(commands(&mut d, 0, 190, &silent, &c), 0);
        assert_eq!(commands(&mut d, 190, 30, &silent, &c), 1);
        let doubted = ContactEvidence {
            range_height: None,
            range_doubted: true,
            ..ON_DECK
        };
        let mut d = DisarmSequence::default();
        assert_eq!(commands(&mut d, 0, 190, &doubted, &c), 0);
        assert_eq!(commands(&mut d, 190, 30, &doubted, &c), 1);
    }

    #[test]
    fn disarm_after_the_drone_left_the_deck() {
        let c = DisarmConfig::default();
        let mut d = DisarmSequence::default();
        assert_eq!(commands(&mut d, 0, 100, &ON_DECK, &c), 1);
        let falls = ContactEvidence {
            load_factor: Some(0.1),
            ..ON_DECK
        };
        assert_eq!(commands(&mut d, 100, 5_000, &falls, &c), 0);
    }
}

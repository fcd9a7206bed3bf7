//! End of a helm: back to the former course and to the former mode, or to the mode at once.
//!
//! The mode that is given back is the one that the skipper wants: that of before, or a newer one that he, or a failsafe, has set
//! while a request of ours may still have been on its way.

use alight_shared::msg::{HelmEnd, MAX_HELM_TURN_S};
use alight_shared::time::{Span, Time, VesselClock};

use super::command::ReadBack;
use super::response::LAG_S;
use super::{Goal, HelmCheckpoint, HelmNode, LEAD, Phase, Steering, View};
use crate::demand::Demand;

/// The mode is given back within this, or not at all.
const GIVE_BACK: Span = Span::from_millis(10_000);
/// A request of a mode is taken within this, and the next report shows it: a report that is older by less may be of before.
const LATENCY: Span = Span::from_millis(2000);
/// A mode that a former start left is given back where that was no longer ago, s: a process that crashed is started again
/// within seconds, and of a boat that has lain for longer it is unknown who set its mode.
const LEFT_S: f64 = 60.0;
/// A boat that is given back shows whether it turns as soon as after any command ([`LAG_S`]). From then on it is at rest once
/// it turns more slowly, rad/s (1.5 deg/s), and after this at the latest.
const AT_REST_RADPS: f64 = 0.026;
const AT_REST_WITHIN: Span = Span::from_millis(60_000);

/// Progress of giving a mode back.
#[derive(Clone, Copy, Debug, PartialEq)]
enum GivingBack {
    GoesOn,
    /// Given back, or never taken, or the skipper has chosen another meanwhile.
    Done,
    Failed,
}

/// Checkpoint to give back where the autopilot reports this: a mode that is not ours is the newest that the skipper wants.
fn newest(former: HelmCheckpoint, r: &ReadBack) -> HelmCheckpoint {
    HelmCheckpoint {
        mode: r.mode.filter(|_| r.present && !r.is_ours).or(former.mode),
        ..former
    }
}

impl HelmNode {
    /// Checkpoint that a former start left, where a boat is steered: an old mode is the skipper's affair.
    pub(super) fn found(now: Time<VesselClock>, former: HelmCheckpoint) -> Phase {
        let is_new = (0.0..=LEFT_S).contains(&(now - former.at).secs());
        Phase::Withdrawn {
            since: now,
            why: match is_new || former.mode.is_none() {
                true => HelmEnd::Restarted,
                false => HelmEnd::NotGivenBack,
            },
            former: is_new.then_some(former),
        }
    }
    /// Withdrawn; what was before is given back unless nothing was commanded yet, or the skipper has chosen a mode and no request
    /// of ours can be on its way.
    pub(super) fn withdraw(v: &View<'_>, why: HelmEnd, s: &Steering) -> Phase {
        let commanded = s.engaged || v.now - s.since > LEAD;
        let chosen = s.engaged && why == HelmEnd::ModeChanged;
        Phase::Withdrawn {
            since: v.now,
            why,
            former: (commanded && !chosen).then(|| newest(s.former, &v.read_back)),
        }
    }
    /// The former state is given back once; a landing that goes on is not asked for again, nor is any while the boat may
    /// be in the mode that it was to leave.
    pub(super) fn withdrawn(
        &self,
        v: &View<'_>,
        since: Time<VesselClock>,
        why: HelmEnd,
        former: Option<HelmCheckpoint>,
    ) -> Phase {
        let r = &v.read_back;
        let former = former.map(|f| newest(f, r));
        let (why, former) = match former.map(|f| Self::giving_back(v, since, &f)) {
            Some(GivingBack::GoesOn) => (why, former),
            Some(GivingBack::Failed) => (HelmEnd::NotGivenBack, None),
            Some(GivingBack::Done) | None => (why, None),
        };
        let left = why == HelmEnd::NotGivenBack && (!r.present || r.is_steered());
        match self.is_over(v.now) && former.is_none() && !left {
            true => Phase::Idle,
            false => Phase::Withdrawn { since, why, former },
        }
    }
    /// Progress of a mode that is given back from `since` on. The autopilot may yet take our last request, so that
    /// its report shows another mode for good only once it is later by [`LATENCY`].
    fn giving_back(v: &View<'_>, since: Time<VesselClock>, former: &HelmCheckpoint) -> GivingBack {
        let r = &v.read_back;
        let latest = r.reported.is_some_and(|at| at - since > LATENCY);
        if former.mode.is_none() || latest && r.present && !r.is_ours {
            GivingBack::Done
        } else if v.now - since > GIVE_BACK {
            GivingBack::Failed
        } else {
            GivingBack::GoesOn
        }
    }

    /// Back to the former course, as fast as before, or as now where that is beyond the limits. Given back as it goes is a
    /// boat that never was ours, one that would not answer its rudder because it was slower than the lowest speed, and one
    /// whose way back leads through a keep-out sector or into one.
    pub(super) fn return_to_former(&self, v: &View<'_>, mut s: Steering) -> Phase {
        let Some(motion) = v.motion else {
            return Self::withdraw(v, HelmEnd::NoEstimate, &s);
        };
        if !s.engaged && v.now - s.since <= LEAD {
            return Phase::Idle;
        }
        let [low, high] = self.config.speed_mps;
        let speed_mps = match self.autopilot.steers_speed() {
            true => s.former.speed_mps.clamp(0.0, high.max(motion.speed_mps)),
            false => motion.speed_mps,
        };
        let former = Goal {
            heading_rad: s.former.heading_rad,
            speed_mps,
            likelihood: None,
            slope_sd: None,
        };
        let clear = self.config.is_clear(motion.heading_rad, former.heading_rad);
        (s.since, s.way_m) = (v.now, 0.0);
        s.response = self.response(v.now, former, &motion);
        let at_once = !s.engaged || speed_mps < low || !clear;
        Phase::Returning {
            steering: s,
            mode_since: at_once.then_some(v.now),
        }
    }
    /// One step on the way back. A drone that comes down meanwhile is kept the course for.
    pub(super) fn give_back(
        &self,
        v: &View<'_>,
        mut s: Steering,
        mode_since: Option<Time<VesselClock>>,
    ) -> Phase {
        if let Some(since) = mode_since {
            s.former = newest(s.former, &v.read_back);
            return match Self::giving_back(v, since, &s.former) {
                GivingBack::Done => Phase::Idle,
                GivingBack::GoesOn => Phase::Returning {
                    steering: s,
                    mode_since,
                },
                GivingBack::Failed => Phase::Withdrawn {
                    since: v.now,
                    why: HelmEnd::NotGivenBack,
                    former: None,
                },
            };
        }
        self.follow(v, &mut s);
        if let Some(why) = self.ends(v, &s) {
            return Self::withdraw(v, why, &s);
        }
        if let Some(motion) = v.motion.filter(|_| v.input.demand == Demand::Descends) {
            self.keep(v.now, &mut s, &motion);
            return Phase::Steering(s);
        }
        let there = s.response.is_steady(v.now) || (v.now - s.since).secs() > f64::from(MAX_HELM_TURN_S);
        Phase::Returning {
            steering: s,
            mode_since: there.then_some(v.now),
        }
    }

    /// When it was steered last, while it may yet turn to the course of its own autopilot.
    pub(super) fn coming_to_rest(&self, v: &View<'_>) -> Option<Time<VesselClock>> {
        let steered = match &self.phase {
            Phase::Idle | Phase::Asked { .. } => false,
            Phase::Steering(s) => s.engaged,
            Phase::Returning { .. } => true,
            Phase::Withdrawn { former, .. } => former.is_some() && v.read_back.is_steered(),
        };
        if steered {
            return Some(v.now);
        }
        let since = self.coming_to_rest?;
        let turns = v.motion.is_none_or(|m| m.rate_radps.abs() > AT_REST_RADPS);
        let given = v.now - since;
        (given.secs() <= LAG_S || turns && given <= AT_REST_WITHIN).then_some(since)
    }
}

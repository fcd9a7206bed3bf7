//! Error that a boat may have that follows a command, and the time at which it is steady.
//!
//! One bound over the whole helm: from what it was off when the command was given, less what the slowest boat makes good
//! meanwhile, down to what a boat is off on a straight course. What lies beyond it for longer than a measurement errs is not
//! the boat's response: somebody steers, or it does not follow.

use alight_shared::estimation::low_pass;
use alight_shared::frames::wrap_angle;
use alight_shared::msg::MAX_HELM_TURN_S;
use alight_shared::time::{Time, VesselClock};

use super::{BoatMotion, Goal};

/// On a straight course a boat is off by no more: heading (rad, 15 deg: yaw in quartering seas about a mean that a low-pass
/// takes) and speed (m/s: surge about a mean likewise).
const STRAIGHT: [f64; 2] = [0.26, 1.2];
/// A command shows after so long, s: mode, rudder or engine, and the estimator's mean.
pub(super) const LAG_S: f64 = 6.0;
/// The slowest boat turns and changes its speed so fast, rad/s (3 deg/s) and m/s².
const SLOWEST: [f64; 2] = [0.052, 0.08];
/// A boat is expected to turn and to change its speed so fast, rad/s (6 deg/s) and m/s²; and to take so long in addition, s.
const USUAL: [f64; 2] = [0.105, 0.3];
const SETTLE_S: f64 = 4.0;
/// Beyond the bound for so long it is not the boat's response, s: half a wave.
const LASTS_S: f64 = 2.5;
/// Steady: heading (rad, 6 deg), speed (m/s) and rate of turn (rad/s, 1.5 deg/s) are within these for so long, s.
const STEADY: [f64; 3] = [0.105, 0.6, 0.026];
const STEADY_S: f64 = 2.0;
/// A boat that yaws and surges in waves is never so for two seconds: it is on the course by the average of a few waves, s.
const FEW_WAVES_S: f64 = 10.0;

/// A command that a boat follows.
#[derive(Clone, Copy, Debug)]
pub(super) struct SteeringResponse {
    goal: Goal,
    /// It does not steer the speed.
    heading_only: bool,
    began: Time<VesselClock>,
    /// Errors then: heading, rad, and speed, m/s.
    first: [f64; 2],
    beyond: Option<Time<VesselClock>>,
    steady: Option<Time<VesselClock>>,
    newest: [f64; 2],
    /// Averages of the errors of heading (rad) and speed (m/s) and of the rate of turn (rad/s), and their time.
    mean: [f64; 3],
    observed: Time<VesselClock>,
}

impl SteeringResponse {
    /// The command is given at `now` to a boat that moves so.
    pub(super) fn begin(
        now: Time<VesselClock>,
        goal: Goal,
        motion: &BoatMotion,
        heading_only: bool,
    ) -> SteeringResponse {
        let mut response = SteeringResponse {
            goal,
            heading_only,
            began: now,
            first: [0.0; 2],
            beyond: None,
            steady: None,
            newest: [0.0; 2],
            mean: [0.0; 3],
            observed: now,
        };
        response.mean = response.errors(motion);
        response.first = response.off(motion);
        response.newest = response.first;
        response
    }
    /// Commanded course.
    pub(super) fn goal(&self) -> Goal {
        self.goal
    }
    /// Heading (rad) and speed (m/s) less the command, and rate of turn, rad/s.
    fn errors(&self, motion: &BoatMotion) -> [f64; 3] {
        let heading = wrap_angle(motion.heading_rad - self.goal.heading_rad);
        let speed = motion.speed_mps - self.goal.speed_mps;
        [
            heading,
            if self.heading_only { 0.0 } else { speed },
            motion.rate_radps,
        ]
    }
    /// Heading (rad) and speed (m/s) off the command.
    fn off(&self, motion: &BoatMotion) -> [f64; 2] {
        let [heading, speed, _] = self.errors(motion);
        [heading.abs(), speed.abs()]
    }
    /// The boat moves so at `now`.
    pub(super) fn observe(&mut self, now: Time<VesselClock>, motion: &BoatMotion) {
        let off = self.off(motion);
        self.newest = off;
        let made_s = ((now - self.began).secs() - LAG_S).max(0.0);
        let beyond = (0..2).any(|k| {
            let bound = STRAIGHT[k] + (self.first[k] - SLOWEST[k] * made_s).max(0.0);
            !(off[k] <= bound)
        });
        self.beyond = beyond.then(|| self.beyond.unwrap_or(now));
        let steady = off[0] <= STEADY[0] && off[1] <= STEADY[1] && motion.rate_radps.abs() <= STEADY[2];
        self.steady = steady.then(|| self.steady.unwrap_or(now));
        let (errors, dt) = (self.errors(motion), (now - self.observed).secs());
        self.mean = core::array::from_fn(|k| low_pass(self.mean[k], errors[k], dt, FEW_WAVES_S));
        self.observed = now;
    }
    /// For too long it is not where a boat that follows would be.
    pub(super) fn is_violated(&self, now: Time<VesselClock>) -> bool {
        self.beyond.is_some_and(|since| (now - since).secs() > LASTS_S)
    }
    /// It is on the course and keeps it.
    pub(super) fn is_steady(&self, now: Time<VesselClock>) -> bool {
        self.steady.is_some_and(|since| (now - since).secs() >= STEADY_S)
    }
    /// By the average of a few waves it is on the course.
    pub(super) fn is_steady_on_average(&self) -> bool {
        self.mean
            .iter()
            .zip(STEADY)
            .all(|(mean, most)| mean.abs() <= most)
    }
    /// It is expected to be steady in so long, s.
    pub(super) fn steady_in_s(&self) -> f64 {
        let [heading, speed] = self.newest;
        let left_s = (heading / USUAL[0]).max(speed / USUAL[1]) + SETTLE_S;
        left_s.min(f64::from(MAX_HELM_TURN_S))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Span;

    fn motion(deg: f64, speed_mps: f64) -> BoatMotion {
        BoatMotion {
            heading_rad: deg.to_radians(),
            rate_radps: 0.0,
            speed_mps,
        }
    }
    /// When a boat that moves so for 40 s is violated, s; its command is 60 deg at 2 m/s, from north at 5 m/s.
    fn violated(at: impl Fn(f64) -> BoatMotion) -> Option<f64> {
        let goal = Goal {
            heading_rad: 60_f64.to_radians(),
            speed_mps: 2.0,
            likelihood: None,
            slope_sd: None,
        };
        let mut response = SteeringResponse::begin(Time::EPOCH, goal, &at(0.0), false);
        (1..400).map(|k| 0.1 * f64::from(k)).find(|t| {
            let now = Time::EPOCH + Span::from_secs(*t);
            response.observe(now, &at(*t));
            response.is_violated(now)
        })
    }

    #[test]
    fn boats_on_the_course_by_the_average() {
        let goal = Goal {
            heading_rad: 0.0,
            speed_mps: 3.0,
            likelihood: None,
            slope_sd: None,
        };
        // Steady, and steady on average, after a minute, where it moves so (yaw in waves: amplitude, rad) about so many deg.
        let judged = |deg: f64, yaw_rad: f64| {
            let at = |t: f64| BoatMotion {
                heading_rad: deg.to_radians() + yaw_rad * (1.3 * t).sin(),
                rate_radps: 1.3 * yaw_rad * (1.3 * t).cos(),
                speed_mps: 3.0,
            };
            let mut response = SteeringResponse::begin(Time::EPOCH, goal, &at(0.0), false);
            let times = (1..600).map(|k| 0.1 * f64::from(k));
            times.for_each(|t| response.observe(Time::EPOCH + Span::from_secs(t), &at(t)));
            let now = Time::EPOCH + Span::from_secs(60.0);
            assert!(!response.is_violated(now));
            (response.is_steady(now), response.is_steady_on_average())
        };
        assert_eq!(judged(1.0, 0.0), (true, true));
        assert_eq!(judged(1.0, 0.14), (false, true), "it yaws about the course");
        assert_eq!(judged(12.0, 0.0), (false, false), "it has never turned");
    }

    #[test]
    fn boats_that_follow_and_hands_on_the_helm() {
        let follows = |deg_per_s: f64, mps2: f64| {
            move |t: f64| {
                let t = (t - 2.0).max(0.0);
                motion((deg_per_s * t).min(60.0), (5.0 - mps2 * t).max(2.0))
            }
        };
        assert_eq!(violated(follows(3.5, 0.1)), None, "slow");
        assert_eq!(violated(follows(11.0, 0.6)), None, "agile");
        // Yaw and surge in waves.
        let waves = |t: f64| {
            let m = follows(6.0, 0.3)(t);
            motion(
                m.heading_rad.to_degrees() + 8.0 * (1.3 * t).sin(),
                m.speed_mps + 0.8 * (1.3 * t).cos(),
            )
        };
        assert_eq!(violated(waves), None);
        let away = violated(|t| motion(-8.0 * t, 5.0)).unwrap();
        assert!(away < 6.0, "turned the other way: {away}");
        let stays = violated(|_| motion(0.0, 5.0)).unwrap();
        assert!(stays < 18.0, "does not follow: {stays}");
        let taken = violated(|t| {
            if t < 25.0 {
                follows(6.0, 0.3)(t)
            } else {
                motion(60.0 - 10.0 * (t - 25.0), 2.0)
            }
        });
        assert!((25.0..31.0).contains(&taken.unwrap()), "{taken:?}");
    }
}

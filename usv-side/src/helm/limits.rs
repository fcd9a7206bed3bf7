//! The skipper's limits on a course: how far it may change, how fast, and through which headings it may not lead.

use alight_shared::frames::wrap_angle;

use super::config::HelmConfig;
use super::{BoatMotion, COURSE_ERROR_RAD, Goal};

/// Headings are looked at in steps of so much, rad: 1 deg.
const STEP_RAD: f64 = core::f64::consts::PI / 180.0;
/// A course that differs by less is not worth a helm: heading, rad (10 deg, two errors of a course), and speed, m/s.
const WORTH_RAD: f64 = 0.175;
const WORTH_MPS: f64 = 0.5;
/// Maximum turn where there are keep-out sectors, rad (150 deg): an autopilot may take a half turn by the other way, whose
/// sectors were not checked.
const SURE_TURN_RAD: f64 = 2.62;

impl HelmConfig {
    /// The course nearest to `advice` that the skipper permits from the motion `now`: the heading is turned to by the
    /// shorter way, as far as the limit of its change and the next keep-out sector. None where it is not worth a helm.
    pub fn permitted(&self, advice: &Goal, now: &BoatMotion) -> Option<Goal> {
        let [low, high] = self.speed_mps;
        let speed_mps = advice.speed_mps.clamp(low, high);
        let limit = self.largest_turn();
        let turn = wrap_angle(advice.heading_rad - now.heading_rad).clamp(-limit, limit);
        let turn = self.unobstructed(now.heading_rad, turn);
        let goal = Goal {
            heading_rad: wrap_angle(now.heading_rad + turn),
            speed_mps,
            likelihood: advice.likelihood,
            slope_sd: advice.slope_sd,
        };
        let worth = turn.abs() > WORTH_RAD || (speed_mps - now.speed_mps).abs() > WORTH_MPS;
        (worth && !self.keeps_out(goal.heading_rad)).then_some(goal)
    }
    /// The skipper permits this course as it is, from the motion `now`, whose heading is off by the error of a course from that
    /// which the change counts from; a speed outside its range counts as the nearest in it where that makes no difference.
    pub(super) fn permits(&self, course: &Goal, now: &BoatMotion) -> bool {
        let turn = wrap_angle(course.heading_rad - now.heading_rad);
        let [low, high] = self.speed_mps;
        let speed_off = (course.speed_mps - course.speed_mps.clamp(low, high)).abs();
        let reached = self.unobstructed(now.heading_rad, turn);
        turn.abs() <= self.largest_turn() + COURSE_ERROR_RAD
            && speed_off <= WORTH_MPS
            && (reached - turn).abs() < 0.5 * STEP_RAD
            && !self.keeps_out(course.heading_rad)
    }
    /// A turn from heading to heading (rad), by the shorter way, leads through no sector and into none.
    pub(super) fn is_clear(&self, from: f64, to: f64) -> bool {
        let turn = wrap_angle(to - from);
        let sure = self.keep_out_deg.is_empty() || turn.abs() <= SURE_TURN_RAD;
        sure && (self.unobstructed(from, turn) - turn).abs() < 0.5 * STEP_RAD && !self.keeps_out(to)
    }
    /// rad.
    fn largest_turn(&self) -> f64 {
        let limit = self.heading_change_deg.to_radians();
        match self.keep_out_deg.is_empty() {
            true => limit,
            false => limit.min(SURE_TURN_RAD),
        }
    }
    /// So much of a turn from `heading` as leads into no sector, rad.
    fn unobstructed(&self, heading: f64, turn: f64) -> f64 {
        let steps = (turn.abs() / STEP_RAD).ceil().max(1.0);
        let at = |k: f64| turn * k / steps;
        // A vessel that is in a sector already may leave it.
        let mut inside = self.keeps_out(heading);
        let mut reached = 0.0;
        for k in 1..=steps as u32 {
            let next = at(f64::from(k));
            let blocked = self.keeps_out(heading + next);
            if blocked && !inside {
                return reached;
            }
            (inside, reached) = (blocked, next);
        }
        reached
    }
    /// The heading lies in a keep-out sector.
    fn keeps_out(&self, heading_rad: f64) -> bool {
        let deg = heading_rad.to_degrees();
        // Half a step wider, so that no rounding leads in.
        let within = |[from, to]: &[f64; 2]| {
            (deg - from + 0.5).rem_euclid(360.0) <= (to - from).rem_euclid(360.0) + 1.0
        };
        self.keep_out_deg.iter().any(within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal(deg: f64, speed_mps: f64) -> Goal {
        Goal {
            heading_rad: deg.to_radians(),
            speed_mps,
            likelihood: None,
            slope_sd: None,
        }
    }
    fn motion(deg: f64, speed_mps: f64) -> BoatMotion {
        BoatMotion {
            heading_rad: deg.to_radians(),
            rate_radps: 0.0,
            speed_mps,
        }
    }
    fn deg(goal: Option<Goal>) -> Option<f64> {
        goal.map(|g| g.heading_rad.to_degrees().round().rem_euclid(360.0))
    }

    #[test]
    fn course_within_the_skippers_limits() {
        let c = HelmConfig::default();
        assert_eq!(deg(c.permitted(&goal(40.0, 3.0), &motion(0.0, 5.0))), Some(40.0));
        assert_eq!(deg(c.permitted(&goal(170.0, 3.0), &motion(0.0, 5.0))), Some(60.0));
        // By the shorter way, through north.
        assert_eq!(
            deg(c.permitted(&goal(330.0, 3.0), &motion(10.0, 5.0))),
            Some(330.0)
        );
        let slow = c.permitted(&goal(0.0, 0.4), &motion(0.0, 5.0)).unwrap();
        assert_eq!(slow.speed_mps, 2.0);
        assert_eq!(
            c.permitted(&goal(4.0, 5.0), &motion(0.0, 5.2)),
            None,
            "not worth a helm"
        );
    }

    #[test]
    fn courses_that_the_skipper_permits() {
        let c = HelmConfig {
            keep_out_deg: vec![[20.0, 40.0]],
            ..HelmConfig::default()
        };
        let permits = |deg: f64, speed_mps: f64| c.permits(&goal(deg, speed_mps), &motion(0.0, 5.2));
        // Within 60 deg and the error of a course, 5 deg.
        assert!(permits(-60.0, 2.0) && permits(15.0, 5.2));
        assert!(permits(-65.0, 3.0) && !permits(-65.1, 3.0), "too far");
        assert!(!permits(-30.0, 1.2), "too slow");
        assert!(
            !permits(30.0, 3.0) && !permits(45.0, 3.0),
            "into the sector, and through it"
        );
    }

    #[test]
    fn turn_towards_a_keep_out_sector() {
        let c = HelmConfig {
            keep_out_deg: vec![[20.0, 40.0], [350.0, 355.0]],
            ..HelmConfig::default()
        };
        // Neither into it nor through it.
        for target in [30.0, 50.0] {
            let reached = deg(c.permitted(&goal(target, 5.0), &motion(0.0, 5.0))).unwrap();
            assert!((18.9..20.0).contains(&reached), "{target}: {reached}");
        }
        // No more than a course that is not worth a helm is left.
        assert_eq!(c.permitted(&goal(340.0, 5.0), &motion(0.0, 5.0)), None);
        // Back into it from outside, through one, and by a half turn that may lead through any.
        let clear = |from: f64, to: f64| c.is_clear(from.to_radians(), to.to_radians());
        assert!(clear(0.0, 15.0) && clear(30.0, 60.0));
        assert!(!clear(60.0, 30.0) && !clear(60.0, 0.0) && !clear(90.0, 255.0));
        assert!(HelmConfig::default().is_clear(1.0, 4.1));
        let far = HelmConfig {
            heading_change_deg: 180.0,
            ..c.clone()
        };
        assert_eq!(
            deg(far.permitted(&goal(255.0, 5.0), &motion(90.0, 5.0))),
            Some(240.0)
        );
        // In the sector already: out of it, and no change of speed within.
        assert_eq!(deg(c.permitted(&goal(60.0, 5.0), &motion(30.0, 5.0))), Some(60.0));
        assert_eq!(c.permitted(&goal(30.0, 2.0), &motion(30.0, 5.0)), None);
    }
}

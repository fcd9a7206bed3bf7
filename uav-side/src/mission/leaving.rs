//! Evidence for a take-off: its probability, rotor thrust, rise, and whether the drone stands.

use alight_shared::{
    geometry::GRAVITY,
    msg::{RangeSample, State},
    topics,
};
use nalgebra::Vector3;

use super::{
    MissionNode,
    lift_off::LiftOffConditions,
    phase::DroneTime,
    situation::{ControlState, Situation, hover_thrust},
};
use crate::{
    lift_off::{LIES_BELOW_M, Rise},
    standing::{StandingMonitor, StandingVerdict, by_height, by_range},
};

/// Reported thrust above which the rotors turn, as a fraction of hover: a third of idle.
const TURN_OF_HOVER: f64 = 0.1;
/// Thrust that cannot lift the drone, and thrust that lifts it unless its feet stick, as fractions of hover.
const IDLE_OF_HOVER: f64 = 0.7;
const LIFTS_OF_HOVER: f64 = 1.05;
/// Maximum age of odometry and rotor reports as evidence that nothing has moved, s.
const RECENT_S: f64 = 0.2;

#[derive(Clone, Debug, Default)]
pub(super) struct LeavingMonitor {
    range: Option<RangeSample>,
    /// Rise since the rotors could first lift the drone; None if that moment was missed.
    rise: Option<Rise>,
    standing: StandingMonitor,
    verdict: StandingVerdict,
    /// Time of the last evidence that the drone stands, or start of the observation.
    witnessed: Option<DroneTime>,
    turn: Option<DroneTime>,
    lift: Option<DroneTime>,
}

/// Duration for which `holds` has been true, s; `since` stores its start.
fn lasts(since: &mut Option<DroneTime>, holds: bool, now: DroneTime) -> f64 {
    *since = holds.then(|| since.unwrap_or(now));
    since.map_or(0.0, |at| (now - at).secs())
}

impl MissionNode {
    pub(super) fn keep_range(&mut self, ranges: &[RangeSample]) {
        let newest = ranges.iter().max_by_key(|r| r.header.at);
        self.leaving.range = newest.copied().or(self.leaving.range);
    }

    pub(super) fn judge_take_off(&mut self, now: DroneTime, s: &mut Situation) {
        if let (true, Some(forecast)) = (
            self.phase.stands() && s.fresh_deck().is_some(),
            self.forecast.get(),
        ) {
            let jump = LiftOffConditions {
                forecast,
                wind: self.wind(),
                drone: &self.drone_geometry,
            };
            s.leaving.lift_off = jump.moments(now);
        }
        let autopilot = self.autopilot.fresh(now, topics::AUTOPILOT.stale_after);
        let hover = autopilot.map_or(1.0, |a| hover_thrust(a, &self.drone_geometry));
        let thrust = autopilot
            .filter(|a| a.armed)
            .and_then(|a| a.thrust)
            .map(|t| t / hover);
        let gives = |min: f64| thrust.is_some_and(|t| t >= min);
        let m = &mut self.leaving;
        s.leaving.rotors_turn_s = lasts(&mut m.turn, gives(TURN_OF_HOVER), now);
        let rises = self.phase.state() == State::TakeOff;
        let lifts_s = lasts(&mut m.lift, rises && gives(LIFTS_OF_HOVER), now);
        s.leaving.lifts_s = thrust.map(|_| lifts_s);
        self.judge_rise(now, thrust, s);
        self.judge_standing(now, thrust, s);
    }

    fn judge_rise(&mut self, now: DroneTime, thrust: Option<f64>, s: &mut Situation) {
        let m = &mut self.leaving;
        let leaves = matches!(
            self.phase.state(),
            State::SpinUp | State::TakeOff | State::StandDown
        );
        let idles = s.odometry_age_s <= RECENT_S && thrust.is_some_and(|t| t <= IDLE_OF_HOVER);
        let lay = (m.rise).is_some_and(|rise| rise.is_measured() && rise.risen_m() < LIES_BELOW_M);
        let stood = m.verdict == StandingVerdict::Stands || m.verdict == StandingVerdict::Unknown && lay;
        if s.flight == ControlState::Disarmed || leaves && idles && stood {
            m.rise = Some(Rise::begun(now));
        } else if !leaves {
            m.rise = None;
        } else if let (Some(d), Some(rise)) = (self.drone.get(), &mut m.rise) {
            let deck = self
                .forecast
                .get()
                .and_then(|f| f.at(d.header.at.max(f.header.at)));
            rise.update(d.header.at, d.velocity[2], deck.map(|deck| deck.velocity[2]));
        }
        s.leaving.risen_m = m.rise.map_or(0.0, |rise| rise.risen_m());
        s.leaving.rise_measured = m.rise.is_some_and(|rise| rise.is_measured());
    }

    fn judge_standing(&mut self, now: DroneTime, thrust: Option<f64>, s: &mut Situation) {
        let m = &mut self.leaving;
        let armed = !matches!(s.flight, ControlState::Disarmed | ControlState::Unknown);
        let state = self.phase.state();
        // In a take-off the rotors carry the drone.
        if !(armed && matches!(state, State::SpinUp | State::StandDown)) {
            (m.standing, m.verdict) = Default::default();
            m.witnessed = Some(now);
            return;
        }
        let drone = self.drone.fresh(now, topics::DRONE_STATE.stale_after);
        let force = drone.map(|d| Vector3::from(d.specific_force).norm() / GRAVITY);
        let feet_m = self.drone_geometry.feet_below_m - self.drone_geometry.rangefinder_m[2];
        let range = (m.range).filter(|r| now - r.header.at <= topics::RANGE.stale_after);
        let rise = (s.leaving.rise_measured).then_some(s.leaving.risen_m);
        let heights = [
            by_range(range.map(|r| r.range_m - feet_m)),
            by_height(rise),
            s.on_ground.then_some(true),
        ];
        m.verdict = m.standing.step(now, thrust, force, &heights);
        if m.verdict == StandingVerdict::Stands {
            m.witnessed = Some(now);
        }
        s.leaving.standing = m.verdict;
        s.leaving.unwitnessed_s = m.witnessed.map_or(0.0, |at| (now - at).secs());
    }
}

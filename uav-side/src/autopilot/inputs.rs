//! Newest message from each of the other nodes, and shadow mode, in which the pilot node's set-points are
//! only compared with the drone's motion.

use alight_shared::{
    admission::Latest,
    msg::{
        DeckForecast, DeckStage, DroneState, LandingMode, MissionState, Motors, Phase, SetPoint,
        SetPointKind, ShadowComparison, State, VesselLevel,
    },
    time::Span,
    topics,
};
use nalgebra::{Vector2, Vector3};

use super::{AutopilotIn, DroneTime};
use crate::contingency::GOES_ON_WITHOUT_MISSION_S;

#[derive(Clone, Debug, Default)]
pub(super) struct LinkInputs {
    set_point: Latest<SetPoint>,
    pub(super) mission: Latest<MissionState>,
    /// Landing mode of the mission, of any age; None before the first state.
    pub(super) mode: Option<LandingMode>,
    forecast: Latest<DeckForecast>,
}

impl LinkInputs {
    /// Stores a step's messages. Returns whether the mission was aborted, and whether the set-point is new.
    pub(super) fn take(&mut self, now: DroneTime, input: &AutopilotIn) -> [bool; 2] {
        let before = self.mission.get().and_then(|m| m.abort);
        let mission = (input.mission.as_ref()).filter(|m| self.mission.offer(now, m));
        self.mode = mission.map(|m| m.settings.mode).or(self.mode);
        if let Some(f) = &input.forecast {
            self.forecast.offer(now, f);
        }
        let aborted = mission.is_some_and(|m| m.abort.is_some() && m.abort != before);
        let new = input.set_point.is_some_and(|s| self.set_point.offer(now, &s));
        [aborted, new]
    }
    pub(super) fn fresh_set_point(&self, now: DroneTime) -> Option<&SetPoint> {
        self.set_point.fresh(now, topics::SET_POINT.stale_after)
    }
    pub(super) fn fresh_mission(&self, now: DroneTime) -> Option<&MissionState> {
        self.mission.fresh(now, topics::MISSION.stale_after)
    }
    pub(super) fn fresh_state(&self, now: DroneTime) -> Option<State> {
        self.fresh_mission(now).map(|m| m.state)
    }
    pub(super) fn last_mission(&self, now: DroneTime) -> Option<&MissionState> {
        let goes_on = Span::from_secs(GOES_ON_WITHOUT_MISSION_S);
        self.mission.fresh(now, topics::MISSION.stale_after + goes_on)
    }
    pub(super) fn last_state(&self, now: DroneTime) -> Option<State> {
        self.last_mission(now).map(|m| m.state)
    }
    pub(super) fn fresh_forecast(&self, now: DroneTime) -> Option<&DeckForecast> {
        self.forecast.fresh(now, topics::FORECAST.stale_after)
    }
    /// Forecast deck at `now`, under the same conditions as in the pilot node.
    pub(super) fn deck(&self, now: DroneTime) -> Option<DeckStage> {
        let forecast = self.forecast.get()?;
        forecast.at(now.max(forecast.header.at))
    }
    /// Horizontal velocity of the deck that the mission follows, NED, m/s.
    pub(super) fn followed_deck(&self, now: DroneTime) -> Option<Vector2<f64>> {
        let follows = self.fresh_mission(now)?.state.phase() == Phase::Follow;
        let known = self.forecast.age_s(now) <= topics::FORECAST.stale_after.secs();
        let deck = self.deck(now).filter(|_| follows && known)?;
        Some(Vector3::from(deck.velocity).xy())
    }
    /// Deck, unless only a beacon gives it, because an unauthenticated position is not forwarded.
    pub(super) fn known_deck(&self, now: DroneTime) -> Option<DeckStage> {
        let forecast = self.fresh_forecast(now)?;
        self.deck(now)
            .filter(|_| forecast.vessel_level() != VesselLevel::Beacon)
    }
    /// Age of the vessel estimate behind the forecast, s; None before the first one.
    pub(super) fn link_age_s(&self, now: DroneTime) -> Option<f64> {
        let forecast = self.forecast.get()?;
        let age_s = forecast.radio_age_s + (now - forecast.header.at).secs();
        age_s.is_finite().then_some(age_s)
    }
    /// Whether the link may command: never before the mission's first state, because the mission may be in
    /// shadow mode.
    pub(super) fn may_command(&self) -> bool {
        match self.mode {
            Some(LandingMode::Land | LandingMode::Match) => true,
            Some(LandingMode::Shadow) | None => false,
        }
    }

    pub(super) fn looks_on(&self) -> bool {
        self.mode == Some(LandingMode::Shadow)
    }

    /// Compares the pilot node's set-point with the drone's motion in a shadow mission: angle between the
    /// thrust axes, and velocity difference, at the same time despite the attitude lag.
    pub(super) fn shadow(&self, now: DroneTime, own: Option<DroneState>) -> Option<ShadowComparison> {
        let mission = self.fresh_mission(now);
        mission.filter(|m| self.looks_on() && m.state.phase() != Phase::None)?;
        let wanted = (self.fresh_set_point(now)).filter(|s| s.kind != SetPointKind::None)?;
        let own = own?;
        let attitude = wanted.attitude();
        let down = Vector3::z();
        let (roll, pitch, _) = attitude.euler_angles();
        Some(ShadowComparison {
            tilt: [roll, pitch],
            thrust: wanted.thrust,
            velocity: wanted.velocity,
            stops: wanted.motors == Motors::Stop,
            apart_rad: (attitude * down).angle(&(own.attitude() * down)),
            apart_mps: (Vector3::from(wanted.velocity) - own.velocity()).norm(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{forecast, header, mission};

    #[test]
    fn deck_that_the_mission_follows() {
        let moving = |_| DeckStage {
            velocity: [2.0, 1.0, 0.3],
            ..DeckStage::default()
        };
        let mut inputs = LinkInputs::default();
        let now = DroneTime::EPOCH;
        assert_eq!(inputs.followed_deck(now), None);
        inputs.forecast.offer(now, &forecast(header(1, now), moving));
        inputs
            .mission
            .offer(now, &mission(header(1, now), State::Tracking, 0.0));
        let later = now + topics::FORECAST.stale_after + Span::from_millis(1);
        let velocity = Some(Vector2::new(2.0, 1.0));
        assert_eq!([now, later].map(|t| inputs.followed_deck(t)), [velocity, None]);
        let next = now + Span::from_millis(20);
        inputs
            .mission
            .offer(next, &mission(header(2, next), State::Descent, 0.0));
        assert_eq!(inputs.followed_deck(next), None);
    }
}

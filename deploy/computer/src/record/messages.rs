//! Messages of a flight for viewers, from a recorded step or from shared memory.

use alight_bridge::BridgeOut;
use alight_shared::msg::{
    AutopilotState, Command, DeckForecast, DeckGrant, DroneState, LinkState, MissionState, Plan, RangeSample,
    SensorReadings, SetPoint, TagPose, UvdarFix, VesselEstimate, WaveModel,
};
use alight_shared::step::Step;
use alight_shared::time::{DroneClock, Time, VesselClock};
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut, Touchdown};
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::{ComputerIn, ComputerOut};

/// Message, with the time at which it was sent if that matters.
#[derive(Clone, Copy)]
pub enum Message<'a> {
    Sensors(&'a SensorReadings),
    /// The vessel's estimate on its own computer.
    OwnEstimate(&'a VesselEstimate<VesselClock>),
    OwnWave(&'a WaveModel<VesselClock>),
    /// The vessel's estimate as a drone received it.
    Estimate(&'a VesselEstimate<DroneClock>),
    Wave(&'a WaveModel<DroneClock>),
    Deck(&'a DeckGrant<DroneClock>),
    Link(&'a LinkState),
    Tag(&'a TagPose),
    Uvdar(&'a UvdarFix),
    Range(&'a RangeSample),
    Forecast(&'a DeckForecast),
    /// Comes after the forecast of the same time.
    Drone(&'a DroneState),
    Command(&'a Command),
    Autopilot(&'a AutopilotState),
    Mission(&'a MissionState),
    Plan(Time<DroneClock>, &'a Plan),
    FlownPlan(&'a Plan),
    SetPoint(Time<DroneClock>, &'a SetPoint),
    Touchdown(&'a Touchdown),
}

/// Passes the messages of a step to `each`: in the step of the row that writes them, or, for messages of sensors and
/// operators, in the step that uses them.
pub fn each_message(step: &Step<'_>, each: &mut dyn FnMut(Message<'_>)) {
    let now = Time::from_nanos(step.now_ns);
    if let (Some(i), Some(o)) = (step.input::<ComputerIn>(), step.output::<ComputerOut>()) {
        i.sensors.iter().for_each(|m| each(Message::Sensors(m)));
        o.vessel
            .estimate
            .iter()
            .for_each(|m| each(Message::OwnEstimate(m)));
        o.vessel.wave.iter().for_each(|m| each(Message::OwnWave(m)));
    }
    if let Some(o) = step.output::<BridgeOut>() {
        o.estimate.iter().for_each(|m| each(Message::Estimate(m)));
        o.wave.iter().for_each(|m| each(Message::Wave(m)));
        o.deck.iter().for_each(|m| each(Message::Deck(m)));
        o.link.iter().for_each(|m| each(Message::Link(m)));
    }
    if let (Some(i), Some(o)) = (step.input::<PredictorIn>(), step.output::<PredictorOut>()) {
        i.tags.iter().for_each(|m| each(Message::Tag(m)));
        i.uvdar.iter().for_each(|m| each(Message::Uvdar(m)));
        i.ranges.iter().for_each(|m| each(Message::Range(m)));
        o.forecast.iter().for_each(|m| each(Message::Forecast(m)));
        i.drone.iter().for_each(|m| each(Message::Drone(m)));
    }
    if let (Some(i), Some(o)) = (step.input::<MissionIn>(), step.output::<MissionOut>()) {
        i.commands.iter().for_each(|m| each(Message::Command(m)));
        i.autopilot.iter().for_each(|m| each(Message::Autopilot(m)));
        o.state.iter().for_each(|m| each(Message::Mission(m)));
    }
    if let Some(o) = step.output::<PlannerOut>() {
        o.plan.iter().for_each(|m| each(Message::Plan(now, m)));
    }
    if let (Some(i), Some(o)) = (step.input::<PilotIn>(), step.output::<PilotOut>()) {
        i.plan.iter().for_each(|m| each(Message::FlownPlan(m)));
        o.touchdown.iter().for_each(|m| each(Message::Touchdown(m)));
        o.set_point.iter().for_each(|m| each(Message::SetPoint(now, m)));
    }
}

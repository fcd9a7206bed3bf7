//! Messages of a flight for viewers, from a recorded step or from shared memory.

use alight_bridge::BridgeOut;
use alight_shared::{
    msg::{
        AutopilotState, Command, DeckForecast, DeckGrant, DroneState, LinkState, MissionState, Plan,
        RangeSample, SensorReadings, SetPoint, TagPose, UvdarFix, VesselEstimate, WaveModel,
    },
    step::Step,
    time::{DroneClock, DroneTime, Time, VesselClock},
};
use alight_uav::{
    mission::{MissionIn, MissionOut},
    pilot::{PilotIn, PilotOut, Touchdown},
    planner::PlannerOut,
    predictor::{PredictorIn, PredictorOut},
};
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
    Plan(DroneTime, &'a Plan),
    FlownPlan(&'a Plan),
    SetPoint(DroneTime, &'a SetPoint),
    Touchdown(&'a Touchdown),
}

/// Passes the messages of a step to `each`: in the step of the row that writes them, or, for messages of sensors and
/// operators, in the step that uses them.
pub fn each_message(step: &Step<'_>, each: &mut dyn FnMut(Message<'_>)) {
    let now = Time::from_nanos(step.now_ns);
    if let (Some(i), Some(o)) = (step.input::<ComputerIn>(), step.output::<ComputerOut>()) {
        for m in &i.sensors {
            each(Message::Sensors(m));
        }
        if let Some(m) = &o.vessel.estimate {
            each(Message::OwnEstimate(m));
        }
        if let Some(m) = &o.vessel.wave {
            each(Message::OwnWave(m));
        }
    }
    if let Some(o) = step.output::<BridgeOut>() {
        if let Some(m) = &o.estimate {
            each(Message::Estimate(m));
        }
        if let Some(m) = &o.wave {
            each(Message::Wave(m));
        }
        if let Some(m) = &o.deck {
            each(Message::Deck(m));
        }
        if let Some(m) = &o.link {
            each(Message::Link(m));
        }
    }
    if let (Some(i), Some(o)) = (step.input::<PredictorIn>(), step.output::<PredictorOut>()) {
        for m in &i.tags {
            each(Message::Tag(m));
        }
        for m in &i.uvdar {
            each(Message::Uvdar(m));
        }
        for m in &i.ranges {
            each(Message::Range(m));
        }
        if let Some(m) = &o.forecast {
            each(Message::Forecast(m));
        }
        if let Some(m) = &i.drone {
            each(Message::Drone(m));
        }
    }
    if let (Some(i), Some(o)) = (step.input::<MissionIn>(), step.output::<MissionOut>()) {
        for m in &i.commands {
            each(Message::Command(m));
        }
        if let Some(m) = &i.autopilot {
            each(Message::Autopilot(m));
        }
        if let Some(m) = &o.state {
            each(Message::Mission(m));
        }
    }
    if let Some(o) = step.output::<PlannerOut>()
        && let Some(m) = &o.plan
    {
        each(Message::Plan(now, m));
    }
    if let (Some(i), Some(o)) = (step.input::<PilotIn>(), step.output::<PilotOut>()) {
        if let Some(m) = &i.plan {
            each(Message::FlownPlan(m));
        }
        if let Some(m) = &o.touchdown {
            each(Message::Touchdown(m));
        }
        if let Some(m) = &o.set_point {
            each(Message::SetPoint(now, m));
        }
    }
}

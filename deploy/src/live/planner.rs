//! The drone's planner as a process: wakes with a forecast and with the mission's state.

use core::ops::ControlFlow;
use std::time::Duration;

use alight_shared::config;
use alight_shared::msg::{DeckForecast, MissionState};
use alight_shared::transport::memory::{Instance, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake;
use alight_uav::planner::{Planner, PlannerIn};

use super::args::ProcessArgs;
use super::config::DroneComputer;
use super::process::Process;
use crate::{End, Refused};

/// Without news the process wakes this often all the same.
const LONGEST: Duration = Duration::from_millis(20);

/// Runs until told to end.
pub fn run(args: &ProcessArgs) -> Result<End, Refused> {
    let computer: DroneComputer = config::load(&args.config).map_err(|e| Refused(e.to_string()))?;
    let drone = &computer.drone;
    let mut process = Process::start(ProcessKind::Planner, args, computer.clock, |boot| {
        Planner::new(&drone.planner, &drone.airframe, &drone.deck, boot)
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, "planner")?;
    let mut forecast = memory.subscriber()?;
    let mut mission = memory.subscriber()?;
    let mut odometry = memory.subscriber()?;
    let mut autopilot = memory.subscriber()?;
    let mut plan = memory.publisher()?;
    let mut state = memory.publisher()?;
    let (deck, permit) = (
        memory.listener::<DeckForecast>()?,
        memory.listener::<MissionState>()?,
    );

    wake::run(&[&deck, &permit], LONGEST, || {
        let now = process.now();
        let t = now.nanos();
        let input = PlannerIn {
            forecast: forecast.newest(t),
            mission: mission.newest(t),
            drone: odometry.newest(t),
            autopilot: autopilot.newest(t),
        };
        let out = process.step(now, &input, |out| out.plan.is_some());
        plan.send_any(out.plan.as_ref());
        let inputs = [
            forecast.intake().state(t),
            mission.intake().state(t),
            odometry.intake().state(t),
            autopilot.intake().state(t),
        ];
        let said = process.state(inputs, plan.unsent());
        state.send_any(said.as_ref());
        if process.ended() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    Ok(End::Success)
}

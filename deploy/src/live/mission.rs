//! The drone's mission as a process: wakes with odometry, with a forecast and with a command.

use core::ops::ControlFlow;
use std::time::Duration;

use alight_shared::config;
use alight_shared::msg::{Command, DeckForecast, DroneState};
use alight_shared::transport::memory::{Instance, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake;
use alight_uav::mission::{Mission, MissionIn};

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
    let mut process = Process::start(ProcessKind::Mission, args, computer.clock, |boot| {
        Mission::new(
            &drone.mission,
            &drone.airframe,
            &drone.deck,
            computer.bridge.drone_id,
            boot,
        )
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, "mission")?;
    let mut forecast = memory.subscriber()?;
    let mut odometry = memory.subscriber()?;
    let mut autopilot = memory.subscriber()?;
    let mut plan = memory.subscriber()?;
    let mut set_point = memory.subscriber()?;
    let mut command = memory.subscriber()?;
    let mut mission = memory.publisher()?;
    let mut state = memory.publisher()?;
    let (fresh_state, fresh_forecast, fresh_command) = (
        memory.listener::<DroneState>()?,
        memory.listener::<DeckForecast>()?,
        memory.listener::<Command>()?,
    );

    wake::run(&[&fresh_state, &fresh_forecast, &fresh_command], LONGEST, || {
        let now = process.now();
        let t = now.nanos();
        let input = MissionIn {
            forecast: forecast.newest(t),
            drone: odometry.newest(t),
            autopilot: autopilot.newest(t),
            plan: plan.newest(t),
            set_point: set_point.newest(t),
            command: command.newest(t),
        };
        let out = process.step(now, &input, |out| out.state.is_some());
        mission.send_any(out.state.as_ref());
        let inputs = [
            forecast.intake().state(t),
            odometry.intake().state(t),
            autopilot.intake().state(t),
            plan.intake().state(t),
            set_point.intake().state(t),
            command.intake().state(t),
        ];
        let said = process.state(inputs, mission.unsent());
        state.send_any(said.as_ref());
        if process.ended() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    Ok(End::Success)
}

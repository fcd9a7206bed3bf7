//! The drone's pilot as a process: wakes with the autopilot's odometry, answers each with a
//! set-point.

use core::ops::ControlFlow;
use std::time::Duration;

use alight_shared::config;
use alight_shared::msg::{DeckForecast, DroneState};
use alight_shared::transport::intake::Quantiles;
use alight_shared::transport::memory::{Instance, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake;
use alight_uav::pilot::{Pilot, PilotIn};

use super::args::ProcessArgs;
use super::config::DroneComputer;
use super::process::Process;
use crate::{End, Refused};

/// Without odometry the process wakes this often all the same.
const LONGEST: Duration = Duration::from_millis(20);

/// Runs until told to end. Its figures: age of the vessel's newest measurement behind the set-point
/// (median, 99th percentile), age of the odometry behind it (the same), s.
pub fn run(args: &ProcessArgs) -> Result<End, Refused> {
    let computer: DroneComputer = config::load(&args.config).map_err(|e| Refused(e.to_string()))?;
    let drone = &computer.drone;
    let mut process = Process::start(ProcessKind::Pilot, args, computer.clock, |boot| {
        Pilot::new(&drone.pilot, &drone.airframe, computer.bridge.drone_id, boot)
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, "pilot")?;
    let mut plan = memory.subscriber()?;
    let mut mission = memory.subscriber()?;
    let mut forecast = memory.subscriber::<DeckForecast>()?;
    let mut odometry = memory.subscriber::<DroneState>()?;
    let mut autopilot = memory.subscriber()?;
    let mut ranges = memory.subscriber()?;
    let mut set_point = memory.publisher()?;
    let mut state = memory.publisher()?;
    let fresh = memory.listener::<DroneState>()?;
    let (mut newest, mut from_vessel, mut from_odometry) = (None, Quantiles::default(), Quantiles::default());

    wake::run(&[&fresh], LONGEST, || {
        let now = process.now();
        let t = now.nanos();
        let input = PilotIn {
            plan: plan.newest(t),
            mission: mission.newest(t),
            forecast: forecast.newest(t),
            drone: odometry.newest(t),
            autopilot: autopilot.newest(t),
            ranges: ranges.all(t),
        };
        let out = process.step(now, &input, |out| out.set_point.is_some());
        set_point.send_any(out.set_point.as_ref());

        let sent = process.now();
        newest = input.forecast.map(|f| (f.header.at, f.radio_age_s)).or(newest);
        if let (Some((at, radio_age_s)), true) = (newest, out.set_point.is_some())
            && radio_age_s.is_finite()
        {
            from_vessel.add(radio_age_s + (sent - at).secs());
        }
        if let Some(d) = &input.drone {
            from_odometry.add((sent - d.header.at).secs());
        }
        process.life.figures = [
            from_vessel.quantile(0.5),
            from_vessel.quantile(0.99),
            from_odometry.quantile(0.5),
            from_odometry.quantile(0.99),
        ];
        let inputs = [
            plan.intake().state(t),
            mission.intake().state(t),
            forecast.intake().state(t),
            odometry.intake().state(t),
            autopilot.intake().state(t),
            ranges.intake().state(t),
        ];
        let said = process.state(inputs, set_point.unsent());
        state.send_any(said.as_ref());
        if process.ended() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    Ok(End::Success)
}

//! The drone's predictor as a process: wakes with the autopilot's odometry.

use core::ops::ControlFlow;
use std::time::Duration;

use alight_shared::config;
use alight_shared::msg::DroneState;
use alight_shared::transport::memory::{Instance, Memory};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake;
use alight_uav::predictor::{Predictor, PredictorIn};

use super::args::ProcessArgs;
use super::config::DroneComputer;
use super::process::Process;
use crate::{End, Refused};

/// Without odometry the process wakes this often all the same.
const LONGEST: Duration = Duration::from_millis(20);

/// Runs until told to end.
pub fn run(args: &ProcessArgs) -> Result<End, Refused> {
    let computer: DroneComputer = config::load(&args.config).map_err(|e| Refused(e.to_string()))?;
    let mut process = Process::start(ProcessKind::Predictor, args, computer.clock, |boot| {
        Predictor::new(&computer.drone.predictor(), boot)
    })?;
    let memory = Memory::join(&Instance::new(&computer.instance)?, "predictor")?;
    let mut estimate = memory.subscriber()?;
    let mut wave = memory.subscriber()?;
    let mut prediction = memory.subscriber()?;
    let mut link = memory.subscriber()?;
    let mut drone = memory.subscriber()?;
    let mut tags = memory.subscriber()?;
    let mut uvdar = memory.subscriber()?;
    let mut ranges = memory.subscriber()?;
    let mut forecast = memory.publisher()?;
    let mut state = memory.publisher()?;
    let odometry = memory.listener::<DroneState>()?;

    wake::run(&[&odometry], LONGEST, || {
        let now = process.now();
        let t = now.nanos();
        let input = PredictorIn {
            estimate: estimate.newest(t),
            wave: wave.newest(t),
            prediction: prediction.newest(t),
            link: link.newest(t),
            drone: drone.newest(t),
            tags: tags.all(t),
            uvdar: uvdar.all(t),
            ranges: ranges.all(t),
        };
        let out = process.step(now, &input, |out| out.forecast.is_some());
        forecast.send_any(out.forecast.as_ref());
        let inputs = [
            estimate.intake().state(t),
            wave.intake().state(t),
            prediction.intake().state(t),
            link.intake().state(t),
            drone.intake().state(t),
            tags.intake().state(t),
            uvdar.intake().state(t),
            ranges.intake().state(t),
        ];
        let said = process.state(inputs, forecast.unsent());
        state.send_any(said.as_ref());
        if process.ended() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    Ok(End::Success)
}

//! A drone's simulated autopilot, and the byte-level wire to its computer's link process.

use std::collections::VecDeque;

use alight_shared::time::{Span, WorldTime};
use alight_uav::autopilot::{
    AutopilotOut,
    message::{Address, MavCmd, MavMessage, MavlinkFrame, MavlinkMessage},
    wire::{Decoder, Encoder},
};

use nalgebra::Vector3;

use super::{
    failing::{Failing, weakened},
    physics::TICK,
};
use crate::{
    autopilots::simulated::SimulatedAutopilot,
    physics::{
        drone::{AutopilotConfig, MAX_ROTORS, PlantState},
        streams::Streams,
    },
    sensors::noise::Noise,
};

/// Checkpoints of a crashed process, for its successor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checkpoints {
    Kept,
    Lost,
}

/// One direction of the wire: bytes arrive in order after a random delay.
pub struct Wire {
    delay: Span,
    jitter: Span,
    noise: Noise,
    under_way: VecDeque<(WorldTime, Vec<u8>)>,
    decoder: Decoder,
    encoder: Encoder,
}

impl Wire {
    fn new(config: &AutopilotConfig, streams: &Streams, name: &str) -> Wire {
        Wire {
            delay: Span::from_secs(config.wire_s),
            jitter: Span::from_secs(config.wire_jitter_s),
            noise: Noise::new(streams, name),
            under_way: VecDeque::new(),
            decoder: Decoder::default(),
            encoder: Encoder::default(),
        }
    }
    pub fn send(&mut self, t: WorldTime, from: Address, message: &MavlinkMessage) {
        // Messages missing from the dialect are not sent.
        let Some(bytes) = self.encoder.frame(from, message) else {
            return;
        };
        let arrival = t + self.delay + Span::from_secs(self.jitter.secs() * self.noise.uniform());
        let arrival = self
            .under_way
            .back()
            .map_or(arrival, |(last, _)| arrival.max(*last));
        self.under_way.push_back((arrival, bytes));
    }
    /// Frames received by `t`; none while the cable is disconnected (`cut`).
    fn received(&mut self, t: WorldTime, cut: bool) -> Vec<MavlinkFrame> {
        let arrived = self.under_way.iter().take_while(|(at, _)| *at <= t).count();
        for (_, bytes) in self.under_way.drain(..arrived).filter(|_| !cut) {
            self.decoder.push(&bytes);
        }
        core::iter::from_fn(|| self.decoder.next_frame()).collect()
    }
}

pub struct LinkedAutopilot {
    pub autopilot: SimulatedAutopilot,
    pub cut: bool,
    /// Wire from the autopilot to the link.
    pub up: Wire,
    down: Wire,
    /// Number of set-points, mode changes and arm or disarm commands from the link.
    pub commanded: u32,
    /// Thrust loss of the first rotor, and of all rotors, 0 to 1.
    weak: [f64; 2],
    /// Lost fraction of the drone's weight.
    lighter: f64,
}

impl LinkedAutopilot {
    /// Wire delays use the random streams `link.up` and `link.down`.
    pub fn new(
        config: &AutopilotConfig,
        streams: &Streams,
        autopilot: SimulatedAutopilot,
    ) -> LinkedAutopilot {
        LinkedAutopilot {
            autopilot,
            cut: false,
            up: Wire::new(config, streams, "link.up"),
            down: Wire::new(config, streams, "link.down"),
            commanded: 0,
            weak: [0.0; 2],
            lighter: 0.0,
        }
    }
    pub(super) fn fail(&mut self, failing: &Failing) {
        let faults = &failing.autopilot;
        let autopilot = &mut self.autopilot;
        self.cut = faults.cut;
        self.weak = failing.weak;
        autopilot.silent = faults.silent;
        autopilot.answer = faults.answer;
        autopilot.muted.clone_from(&faults.muted);
        autopilot.battery_reported = !faults.no_battery;
        let [charge, _] = autopilot.battery_report.unwrap_or([autopilot.battery, 0.0]);
        let stuck = faults.battery_stuck.map(|by| [charge, by]);
        autopilot.battery_report = faults.battery_reads.map(|charge| [charge, 0.0]).or(stuck);
        autopilot.battery = (autopilot.battery - faults.drain_per_s * TICK.secs()).max(0.0);
        autopilot.landed_report = faults.landed_report;
        if faults.drift_mps != 0.0 {
            autopilot.reset_position(&(Vector3::x() * faults.drift_mps * TICK.secs()), false);
        }
        autopilot.conditions = faults.conditions;
    }
    pub(super) fn lighten(&mut self, fraction: f64) {
        self.lighter = fraction.clamp(0.0, 0.5);
    }
    /// Rotor commands for the drone's true state; None while motors are off.
    pub fn turn(&mut self, truth: &PlantState) -> Option<[f64; MAX_ROTORS]> {
        let arrived = self.down.received(truth.at, self.cut);
        let arrived: Vec<_> = arrived.into_iter().map(|f| f.message).collect();
        let motors = self.autopilot.step(truth, &arrived);
        for message in self.autopilot.sent() {
            self.up.send(truth.at, self.autopilot.address, &message);
        }
        motors.map(|motors| weakened(self.weak, motors).map(|m| m / (1.0 - self.lighter)))
    }
    pub fn received(&mut self, t: WorldTime) -> Vec<MavlinkFrame> {
        self.up.received(t, self.cut)
    }
    pub fn send(&mut self, t: WorldTime, out: &AutopilotOut) {
        for message in &out.messages {
            self.commanded += u32::from(commands(message));
            self.down.send(t, out.from, message);
        }
    }
}

fn commands(message: &MavlinkMessage) -> bool {
    match message {
        MavlinkMessage::Position(_) | MavlinkMessage::AttitudeThrust(_) => true,
        MavlinkMessage::Common(MavMessage::COMMAND_LONG(c)) => matches!(
            c.command,
            MavCmd::MAV_CMD_DO_SET_MODE | MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
        ),
        _ => false,
    }
}

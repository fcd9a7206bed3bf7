//! PX4's simulator API. PX4 connects as a client to TCP port 4560. The plant sends `HIL_SENSOR` and `HIL_GPS`; PX4
//! answers with `HIL_ACTUATOR_CONTROLS` and waits for the next sample (lock-step). IMU_GYRO_RATEMAX determines whether
//! PX4 runs its rate loop and answers at every sample, at every second or at every third.

use alight_uav::autopilot::{
    message::{Address, MavMessage, MavModeFlag, MavlinkMessage, wide},
    wire::{Decoder, Encoder},
};

use super::{FirmwareConfig, FirmwareSensors, motors};
use crate::physics::drone::{MAX_ROTORS, PlantState};

pub const PORT: u16 = 4560;
pub const EXCHANGE_HZ: u32 = 400;
/// Maximum number of samples per answer.
const MAX_ANSWER_PERIOD: u64 = 4;
/// MAVLink address of the simulator.
const US: Address = Address::new(1, 200);

pub struct Px4Plant {
    config: FirmwareConfig,
    sensors: FirmwareSensors,
    decoder: Decoder,
    encoder: Encoder,
    outputs: Option<[f64; 16]>,
    answers: u64,
    /// Time of the newest sample, us, and the interval before it.
    sampled_us: u64,
    period_us: u64,
    /// Time of the sample that was answered last, us, and the interval between answers.
    answered_us: u64,
    every_us: u64,
}

impl Px4Plant {
    pub fn new(config: &FirmwareConfig, sensors: FirmwareSensors) -> Px4Plant {
        Px4Plant {
            config: config.clone(),
            sensors,
            decoder: Decoder::default(),
            encoder: Encoder::default(),
            outputs: None,
            answers: 0,
            sampled_us: 0,
            period_us: 0,
            answered_us: 0,
            every_us: 0,
        }
    }
    /// Sensor messages of one sample. The GNSS fix precedes the inertial sample because PX4 starts its next
    /// step at the inertial sample.
    pub fn encode_sensors(&mut self, truth: &PlantState, rate_hz: f64) -> Vec<u8> {
        let fix = self.sensors.fix(truth).map(MavlinkMessage::HilGps);
        let sample = self.sensors.sample(truth, rate_hz);
        self.period_us = sample.time_us.saturating_sub(self.sampled_us);
        self.sampled_us = sample.time_us;
        let sample = MavlinkMessage::HilSensor(sample);
        let mut bytes = Vec::new();
        for message in fix.iter().chain([&sample]) {
            bytes.extend(self.encoder.frame(US, message).unwrap_or_default());
        }
        bytes
    }
    /// Decodes bytes from PX4; returns true if they contained motor outputs.
    pub fn decode(&mut self, bytes: &[u8]) -> bool {
        self.decoder.push(bytes);
        let before = self.answers;
        while let Some(frame) = self.decoder.next_frame() {
            if let MavlinkMessage::Common(MavMessage::HIL_ACTUATOR_CONTROLS(d)) = frame.message {
                self.answers += 1;
                self.every_us = match self.answered_us {
                    0 => 0,
                    before => (d.time_usec)
                        .saturating_sub(before)
                        .min(MAX_ANSWER_PERIOD * self.period_us),
                };
                self.answered_us = d.time_usec.min(self.sampled_us);
                let is_armed = d.mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.outputs = is_armed.then(|| wide(d.controls));
            }
        }
        self.answers > before
    }
    /// Whether PX4 should answer the newest sample, judged by the interval between its last answers.
    pub fn due(&self) -> bool {
        self.sampled_us.saturating_sub(self.answered_us) >= self.every_us
    }
    /// Whether the answer is later than PX4's longest interval: PX4 is busy and is not waiting for a sample.
    pub fn is_overdue(&self) -> bool {
        self.sampled_us.saturating_sub(self.answered_us) >= MAX_ANSWER_PERIOD * self.period_us
    }
    pub fn motors(&self) -> Option<[f64; MAX_ROTORS]> {
        self.outputs.and_then(|o| motors(&self.config, &o))
    }
    pub fn lost(&mut self) {
        self.outputs = None;
        self.decoder = Decoder::default();
        self.answered_us = 0;
        self.every_us = 0;
    }
}

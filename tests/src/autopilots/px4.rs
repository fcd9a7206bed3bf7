//! PX4's simulator API: PX4 is the TCP client of port 4560; the plant sends `HIL_SENSOR` and `HIL_GPS`,
//! PX4 answers with `HIL_ACTUATOR_CONTROLS` and waits for the next (lock-step). It answers where its rate
//! loop ran: each sample, or every second or third, as its IMU_GYRO_RATEMAX has it.

use alight_uav::autopilot::message::{Address, MavlinkMessage};
use alight_uav::autopilot::wire::{Decoder, Encoder};

use super::{FirmwareConfig, FirmwareSensors, motors};
use crate::physics::drone::{MAX_ROTORS, PlantState};

/// Port at which PX4 looks for a simulator.
pub const PORT: u16 = 4560;
/// Exchanges a second.
pub const EXCHANGE_HZ: u32 = 400;
/// It answers at least every so many samples.
const MAX_ANSWER_PERIOD: u64 = 4;
/// Address that PX4's simulators use.
const US: Address = Address::new(1, 200);
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
const ARMED: u8 = 128;

/// The plant's end of the conversation.
pub struct Px4Plant {
    config: FirmwareConfig,
    sensors: FirmwareSensors,
    decoder: Decoder,
    encoder: Encoder,
    outputs: Option<[f64; 16]>,
    answers: u64,
    /// Time of the newest sample, us, and after the one before.
    sampled_us: u64,
    period_us: u64,
    /// Time of the sample that was answered last, us, and after the answered one before.
    answered_us: u64,
    every_us: u64,
}

impl Px4Plant {
    /// A plant for PX4.
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
    /// Messages of the sensors, `rate_hz` times a second: the GNSS first, for the sample that follows is
    /// what PX4 goes on with.
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
    /// Bytes from PX4; true when they held its motors.
    pub fn decode(&mut self, bytes: &[u8]) -> bool {
        self.decoder.push(bytes);
        let before = self.answers;
        while let Some(frame) = self.decoder.next_frame() {
            if let MavlinkMessage::HilActuators {
                controls,
                mode,
                time_us,
            } = frame.message
            {
                self.answers += 1;
                self.every_us = match self.answered_us {
                    0 => 0,
                    before => time_us
                        .saturating_sub(before)
                        .min(MAX_ANSWER_PERIOD * self.period_us),
                };
                self.answered_us = time_us.min(self.sampled_us);
                self.outputs = (mode & ARMED != 0).then_some(controls);
            }
        }
        self.answers > before
    }
    /// An answer to the newest sample is to be waited for: as many went without one as before the last.
    pub fn due(&self) -> bool {
        self.sampled_us.saturating_sub(self.answered_us) >= self.every_us
    }
    /// It answers no sample as seldom as this: it is busy, not on its way to the next sample.
    pub fn is_overdue(&self) -> bool {
        self.sampled_us.saturating_sub(self.answered_us) >= MAX_ANSWER_PERIOD * self.period_us
    }
    /// Motors as received last.
    pub fn motors(&self) -> Option<[f64; MAX_ROTORS]> {
        self.outputs.and_then(|o| motors(&self.config, &o))
    }
    /// PX4 is gone.
    pub fn lost(&mut self) {
        self.outputs = None;
        self.decoder = Decoder::default();
        (self.answered_us, self.every_us) = (0, 0);
    }
    /// Answers so far.
    pub fn answers(&self) -> u64 {
        self.answers
    }
}

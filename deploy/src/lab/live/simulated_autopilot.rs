//! The drone's autopilot, camera and rangefinder as the other processes see them: topics of shared
//! memory. The link to a real autopilot (`alight autopilot`) publishes and reads the same topics, the
//! odometry made smooth and set-points brought back to the autopilot's frame.

use alight_shared::msg::{AutopilotState, DroneState, RangeSample, SetPoint, TagPose, UvdarFix};
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Memory, Publisher, Subscriber};
use alight_sim::harness::physics::DroneMeasurements;
use alight_sim::sensors::DroneReadings;
use alight_uav::odometry::{Odometry, OdometryConfig};

/// The simulated drone's end.
pub struct SimulatedAutopilot {
    odometry: Publisher<DroneState>,
    smooth: Odometry,
    autopilot: Publisher<AutopilotState>,
    tags: Publisher<TagPose>,
    uvdar: Publisher<UvdarFix>,
    ranges: Publisher<RangeSample>,
    /// Set-points as the autopilot receives them.
    pub set_points: Subscriber<SetPoint>,
    sequences: [u32; 2],
}

impl SimulatedAutopilot {
    /// Joins the drone's memory.
    pub fn join(memory: &Memory, odometry: &OdometryConfig) -> Result<SimulatedAutopilot, TransportError> {
        Ok(SimulatedAutopilot {
            odometry: memory.publisher()?,
            smooth: Odometry::new(odometry),
            autopilot: memory.publisher()?,
            tags: memory.publisher()?,
            uvdar: memory.publisher()?,
            ranges: memory.publisher()?,
            set_points: memory.subscriber()?,
            sequences: [0; 2],
        })
    }
    /// Says what camera and rangefinder say.
    pub fn publish_detections(&mut self, readings: &DroneReadings) {
        readings.tags.iter().for_each(|m| self.tags.send(m));
        readings.uvdar.iter().for_each(|m| self.uvdar.send(m));
        readings.ranges.iter().for_each(|m| self.ranges.send(m));
    }
    /// Says what the autopilot says; odometry last, because it wakes the other processes.
    pub fn publish(&mut self, flight: &DroneMeasurements) {
        if let Some(mut state) = flight.autopilot {
            self.sequences[1] = self.sequences[1].wrapping_add(1);
            state.header.sequence = self.sequences[1];
            self.autopilot.send(&state);
        }
        let mut odometry = self.smooth.step(&flight.odometry);
        self.sequences[0] = self.sequences[0].wrapping_add(1);
        odometry.header.sequence = self.sequences[0];
        self.odometry.send(&odometry);
    }
    /// The newest set-point, if one came, in the autopilot's frame; `now_ns` is the drone's clock.
    pub fn set_point(&mut self, now_ns: i64) -> Option<SetPoint> {
        let set_point = self.set_points.newest(now_ns)?;
        Some(self.smooth.for_autopilot(&set_point))
    }
    /// Messages that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.odometry.unsent() + self.autopilot.unsent() + self.tags.unsent() + self.ranges.unsent()
    }
}

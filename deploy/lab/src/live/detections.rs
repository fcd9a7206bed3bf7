//! Topics in shared memory for measurements of the drone's camera and rangefinder.

use alight_shared::msg::{CameraLight, RangeSample, TagPose, UvdarFix};
use alight_sim::sensors::DroneReadings;
use alight_transport::{
    TransportError,
    memory::{Memory, Publisher},
};

pub struct Detections {
    tags: Publisher<TagPose>,
    uvdar: Publisher<UvdarFix>,
    ranges: Publisher<RangeSample>,
    light: Publisher<CameraLight>,
}

impl Detections {
    pub fn join(memory: &Memory) -> Result<Detections, TransportError> {
        Ok(Detections {
            tags: memory.publisher()?,
            uvdar: memory.publisher()?,
            ranges: memory.publisher()?,
            light: memory.publisher()?,
        })
    }
    pub fn publish(&mut self, readings: &DroneReadings) {
        for m in &readings.tags {
            self.tags.send(m);
        }
        for m in &readings.uvdar {
            self.uvdar.send(m);
        }
        for m in &readings.ranges {
            self.ranges.send(m);
        }
        if let Some(m) = &readings.light {
            self.light.send(m);
        }
    }
    pub fn unsent(&self) -> u64 {
        self.tags.unsent() + self.uvdar.unsent() + self.ranges.unsent() + self.light.unsent()
    }
}

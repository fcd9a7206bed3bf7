//! Devices of a scene, as configured by an installer, and their bytes.

use alight_shared::time::{Span, Time, VesselClock};
use alight_uav::autopilot::AutopilotLinkConfig;
use alight_usv::sensors::{Format, Mount, Readings, SourceConfig};

use super::{BoatSensor, Carries, StatedErrors};
use crate::{
    harness::physics::TICK,
    sensors::{SensorConfig, beacon::BEACON, clocks::ClockModel},
};

/// Devices on each vessel: receiver, compass, IMU.
pub const DEVICES: usize = 3;

/// Address of the drone's own GNSS receiver in lock-step.
pub const RECEIVER: &str = "serial:///dev/receiver";

/// Latency rounded to the world's ticks, s.
pub fn in_ticks_s(latency_s: f64) -> f64 {
    (latency_s / TICK.secs() - 1e-6).ceil() * TICK.secs()
}

impl SensorConfig {
    /// Configuration of the devices: receiver (UBX), compass (NMEA 0183), IMU (MAVLink), and the port of the
    /// moving base (RTCM 3), if any. `deck_m` is the deck's centre in the vessel's body frame, m.
    pub fn sources(&self, deck_m: [f64; 3]) -> Vec<SourceConfig> {
        let source = |name: &str, format, latency_s, mount| SourceConfig {
            name: name.into(),
            format,
            latency_s: in_ticks_s(latency_s),
            mount,
            ..SourceConfig::default()
        };
        let (gnss, heading) = (&self.vessel_gnss, &self.vessel_heading);
        let compass = Mount {
            heading_sd_deg: heading.stated_factor * heading.white_sd_deg.hypot(heading.bias_sd_deg).max(1e-3),
            ..Mount::default()
        };
        let mut all = vec![
            source("receiver", Format::Ubx, gnss.latency_s, Mount::default()),
            source("compass", Format::Nmea, heading.latency_s, compass),
            source(
                "imu",
                Format::Mavlink,
                self.vessel_imu.latency_s,
                Mount::default(),
            ),
        ];
        if let Some(base) = &self.moving_base {
            let antenna_m = core::array::from_fn(|k| deck_m[k] + base.antenna_m[k]);
            let mount = Mount {
                antenna_m: Some(antenna_m),
                ..Mount::default()
            };
            all.push(source("base", Format::Rtcm, 0.0, mount));
        }
        all
    }
}

impl SensorConfig {
    /// The drone's link as an installer configures it for the scene's beacon and moving base; `receiver` is
    /// the address of the receiver that uses the moving base.
    pub fn wired(&self, link: &AutopilotLinkConfig, receiver: &str) -> AutopilotLinkConfig {
        let mut link = link.clone();
        if self.beacon.is_some() {
            link.beacon_system = BEACON.system;
        }
        if let Some(base) = &self.moving_base {
            link.receiver = receiver.into();
            link.receiver_latency_s = in_ticks_s(base.fix_latency_s);
        }
        link
    }
}

/// Devices with their wires. Their clock is GNSS time, which is the world's time.
#[derive(Clone, Debug)]
pub struct Boat {
    devices: Vec<BoatSensor>,
    base: Option<usize>,
    clock: ClockModel,
}

impl Boat {
    pub fn new(
        sources: &[SourceConfig],
        carries: Vec<Carries>,
        sensors: &SensorConfig,
        clock: ClockModel,
    ) -> Boat {
        let stated = StatedErrors::of(&sensors.vessel_gnss);
        let device = |(source, carries): (&SourceConfig, Carries)| {
            BoatSensor::new(source.format, &source.mount, carries, stated)
        };
        Boat {
            devices: sources.iter().zip(carries).map(device).collect(),
            base: sources.iter().position(SourceConfig::is_base),
            clock,
        }
    }
    pub fn bytes(&mut self, readings: &Readings, rtcm: &[u8]) -> Vec<Vec<u8>> {
        let own = self.on_own_clock(readings);
        let mut all: Vec<Vec<u8>> = self.devices.iter_mut().map(|d| d.bytes(&own)).collect();
        if let Some(base) = self.base.and_then(|k| all.get_mut(k)) {
            base.extend_from_slice(rtcm);
        }
        all
    }
    /// Measurements stamped by the devices' clock.
    fn on_own_clock(&self, readings: &Readings) -> Readings {
        let mut own = readings.clone();
        let date = |at: &mut Time<VesselClock>| {
            *at = Time::EPOCH + Span::from_nanos(self.clock.true_time(*at).nanos())
        };
        own.imu.iter_mut().for_each(|m| date(&mut m.header.at));
        own.gnss.iter_mut().for_each(|m| date(&mut m.header.at));
        own.heading.iter_mut().for_each(|m| date(&mut m.header.at));
        own
    }
}

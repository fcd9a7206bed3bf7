//! The autopilot at the other end, as it reports itself.

use alight_shared::msg::{AutopilotMode, LandedState};
use alight_shared::time::Span;

use super::DroneTime;
use super::config::AutopilotLinkConfig;
use super::message::{ARMED, Address};
use super::modes::Firmware;
use super::parameters::Parameters;
use super::streams::Streams;

/// A reported thrust is used for so long.
const THRUST_STALE: Span = Span::from_millis(300);
/// No battery of a multirotor has more, V.
const MAX_V: f64 = 500.0;
/// None gives or takes more, A.
const MAX_A: f64 = 2000.0;
/// Batteries, at most.
const MAX_BATTERIES: usize = 4;

/// The autopilot.
#[derive(Clone, Debug)]
pub(crate) struct Peer {
    pub(crate) address: Address,
    pub(crate) firmware: Firmware,
    pub(crate) mode: AutopilotMode,
    pub(crate) armed: bool,
    pub(crate) heartbeat_at: DroneTime,
    pub(crate) landed: LandedState,
    pub(crate) streams: Streams,
    /// Charge (0 to 1), voltage (V) and current (A) of each.
    batteries: [[Option<f64>; 3]; MAX_BATTERIES],
    thrust: Option<(DroneTime, f64)>,
    pub(crate) parameters: Parameters,
}

impl Peer {
    pub(crate) fn new(
        address: Address,
        firmware: Firmware,
        now: DroneTime,
        c: &AutopilotLinkConfig,
        attitudes: bool,
    ) -> Peer {
        Peer {
            address,
            firmware,
            mode: AutopilotMode::Other,
            armed: false,
            heartbeat_at: now,
            landed: LandedState::Unknown,
            streams: Streams::new(firmware, c, now),
            batteries: [[None; 3]; MAX_BATTERIES],
            thrust: None,
            parameters: Parameters::new(firmware, attitudes, now),
        }
    }
    /// Its heartbeat.
    pub(crate) fn heartbeat(&mut self, now: DroneTime, base_mode: u8, custom_mode: u32) {
        self.heartbeat_at = now;
        self.armed = base_mode & ARMED != 0;
        self.mode = self.firmware.mode(custom_mode);
    }
    /// Its `MAV_LANDED_STATE`.
    pub(crate) fn landed(&mut self, state: u8) {
        self.landed = match state {
            1 => LandedState::OnGround,
            2..=4 => LandedState::InAir,
            _ => LandedState::Unknown,
        };
    }
    pub(crate) fn battery(&mut self, number: u8, [charge, voltage_v, current_a]: [Option<f64>; 3]) {
        if let Some(b) = self.batteries.get_mut(usize::from(number)) {
            let charge = charge.filter(|r| (0.0..=1.0).contains(r));
            let voltage_v = voltage_v.filter(|v| (0.0..=MAX_V).contains(v));
            let current_a = current_a.filter(|a| a.abs() <= MAX_A);
            *b = [charge, voltage_v, current_a];
        }
    }
    /// Charge of the emptiest battery, 0 to 1; None when none is reported.
    pub(crate) fn charge(&self) -> Option<f64> {
        self.batteries.iter().filter_map(|b| b[0]).reduce(f64::min)
    }
    /// Voltage of the lowest, V.
    pub(crate) fn voltage_v(&self) -> Option<f64> {
        self.batteries.iter().filter_map(|b| b[1]).reduce(f64::min)
    }
    /// Current of all, A.
    pub(crate) fn current_a(&self) -> Option<f64> {
        self.batteries.iter().filter_map(|b| b[2]).reduce(|a, b| a + b)
    }
    pub(crate) fn thrust(&mut self, now: DroneTime, thrust: f64) {
        if (0.0..=1.0).contains(&thrust) {
            self.thrust = Some((now, thrust));
        }
    }
    /// What a tilted drone's thrust is divided by before it is applied: ArduCopter applies `T / cos` of the
    /// tilt (ATC_ANGLE_BOOST) and reports `T`.
    pub(crate) fn tilt_compensation(&self, attitude: [f64; 4]) -> f64 {
        let [_, x, y, _] = attitude;
        match self.firmware {
            Firmware::Px4 => 1.0,
            Firmware::ArduCopter => (1.0 - 2.0 * (x * x + y * y)).clamp(0.1, 1.0),
        }
    }
    /// Thrust that it applies now, its own measure.
    pub(crate) fn thrust_now(&self, now: DroneTime) -> Option<f64> {
        self.thrust
            .filter(|(at, _)| now - *at <= THRUST_STALE)
            .map(|(_, t)| t)
    }
}

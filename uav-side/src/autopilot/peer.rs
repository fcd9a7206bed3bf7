//! The autopilot at the other end, as it reports itself.

use alight_shared::msg::{AutopilotMode, LandedState};
use alight_shared::time::Span;

use super::DroneTime;
use super::config::AutopilotLinkConfig;
use super::message::{ARMED, Address, Message};
use super::modes::Firmware;
use super::streams::Streams;

/// ArduCopter's parameter of how it reads a set-point's thrust, and the bit that makes it a thrust.
pub(crate) const OPTION: &str = "GUID_OPTIONS";
const THRUST_IS_THRUST: u32 = 8;
/// Time between two requests for it, s.
const OPTION_PAUSE_S: f64 = 1.0;
/// A reported thrust is used for so long.
const THRUST_STALE: Span = Span::from_millis(300);
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
    batteries: [Option<f64>; MAX_BATTERIES],
    thrust: Option<(DroneTime, f64)>,
    /// Whether a set-point's thrust is read as thrust; None: not known yet.
    thrust_is_thrust: Option<bool>,
    option_next: DroneTime,
}

impl Peer {
    pub(crate) fn new(address: Address, firmware: Firmware, now: DroneTime, c: &AutopilotLinkConfig) -> Peer {
        Peer {
            address,
            firmware,
            mode: AutopilotMode::Other,
            armed: false,
            heartbeat_at: now,
            landed: LandedState::Unknown,
            streams: Streams::new(firmware, c, now),
            batteries: [None; MAX_BATTERIES],
            thrust: None,
            thrust_is_thrust: match firmware {
                Firmware::Px4 => Some(true),
                Firmware::ArduCopter => None,
            },
            option_next: now,
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
    pub(crate) fn battery(&mut self, number: u8, remaining: Option<f64>) {
        if let Some(b) = self.batteries.get_mut(usize::from(number)) {
            *b = remaining.filter(|r| (0.0..=1.0).contains(r));
        }
    }
    /// Charge of the emptiest battery, 0 to 1; None when none is reported.
    pub(crate) fn charge(&self) -> Option<f64> {
        self.batteries.iter().flatten().copied().reduce(f64::min)
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
    /// One of its parameters.
    pub(crate) fn parameter(&mut self, name: &str, value: f64) {
        if name == OPTION && self.firmware == Firmware::ArduCopter && (0.0..=1e9).contains(&value) {
            self.thrust_is_thrust = Some(value as u32 & THRUST_IS_THRUST != 0);
        }
    }
    /// Whether it reads a set-point's thrust as needed; `needed` when attitude set-points will be sent.
    pub(crate) fn thrust_option_suits(&self, needed: bool) -> Option<bool> {
        if needed { self.thrust_is_thrust } else { Some(true) }
    }
    /// Requests the option until it is as needed: a person may set it meanwhile.
    pub(crate) fn ask_option(&mut self, now: DroneTime, needed: bool) -> Option<Message> {
        if self.thrust_option_suits(needed) == Some(true) || now < self.option_next {
            return None;
        }
        self.option_next = now + Span::from_secs(OPTION_PAUSE_S);
        Some(Message::ParameterRequest {
            to: self.address,
            name: OPTION.into(),
        })
    }
}

//! Reports of the autopilot, each with its time.

use alight_shared::{
    geodesy::Datum,
    mavlink::dialect::{BATTERY_STATUS_DATA, MavLandedState},
    msg::{AutopilotMode, LandedState},
    time::Span,
};

use super::{
    DroneTime,
    config::AutopilotLinkConfig,
    message::{Address, MavModeFlag},
    modes::Firmware,
    parameters::Parameters,
    rotors::RotorOutputs,
    streams::MessageStreams,
};

const THRUST_STALE: Span = Span::from_millis(300);
/// Maximum reported thrust of rotors at rest.
const NO_THRUST: f64 = 0.01;
/// Time after an accepted arming in which a heartbeat may still report the state before it.
const ARMED_WITHIN: Span = Span::from_millis(200);
/// Validity of a battery status: five reports at the usual 1 Hz.
const BATTERY_STALE: Span = Span::from_millis(5000);
/// Validity of a landed state: three reports at the slowest rate, 1 Hz.
const LANDED_STALE: Span = Span::from_millis(3000);
const MAX_V: f64 = 500.0;
/// Charge drawn from one battery, Ah; more is not a measurement.
const MAX_USED_AH: f64 = 1e5;
const MAX_BATTERIES: usize = 4;

/// `BATTERY_STATUS`; None: not reported.
#[derive(Clone, Copy, Debug)]
struct BatteryReport {
    /// 0 to 1.
    charge: Option<f64>,
    voltage_v: Option<f64>,
    current_a: Option<f64>,
    used_ah: Option<f64>,
}

#[derive(Clone, Debug)]
pub(crate) struct MavlinkPeer {
    pub(crate) address: Address,
    pub(crate) firmware: Firmware,
    pub(crate) mode: AutopilotMode,
    pub(crate) flies_mission: bool,
    pub(crate) armed: bool,
    /// Whether a failsafe acts, by HEARTBEAT.system_status.
    pub(crate) is_critical: bool,
    pub(crate) heartbeat_at: DroneTime,
    arming_accepted: Option<DroneTime>,
    landed: Option<(DroneTime, LandedState)>,
    pub(crate) streams: MessageStreams,
    batteries: [Option<(DroneTime, BatteryReport)>; MAX_BATTERIES],
    /// Whether the silence of a battery gauge has been reported.
    battery_lost: bool,
    thrust: Option<(DroneTime, f64)>,
    pub(crate) home: Option<Datum>,
    pub(crate) rotors: RotorOutputs,
    pub(crate) parameters: Parameters,
}

impl MavlinkPeer {
    pub(crate) fn new(
        address: Address,
        firmware: Firmware,
        now: DroneTime,
        c: &AutopilotLinkConfig,
        attitudes: bool,
    ) -> MavlinkPeer {
        MavlinkPeer {
            address,
            firmware,
            mode: AutopilotMode::Other,
            flies_mission: false,
            armed: false,
            is_critical: false,
            heartbeat_at: now,
            arming_accepted: None,
            landed: None,
            streams: MessageStreams::new(firmware, c, now),
            batteries: [None; MAX_BATTERIES],
            battery_lost: false,
            thrust: None,
            home: None,
            rotors: RotorOutputs::default(),
            parameters: Parameters::new(firmware, attitudes, now),
        }
    }
    pub(crate) fn heartbeat(&mut self, now: DroneTime, base_mode: MavModeFlag, custom_mode: u32) {
        self.heartbeat_at = now;
        let just_armed = self.arming_accepted.is_some_and(|at| now - at <= ARMED_WITHIN);
        self.armed = base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED) || just_armed;
        self.on_mode(custom_mode);
    }
    /// The autopilot has accepted our arming command; its next heartbeat may be a second away.
    pub(crate) fn arming_accepted(&mut self, now: DroneTime) {
        self.armed = true;
        self.arming_accepted = Some(now);
    }
    pub(crate) fn on_mode(&mut self, custom_mode: u32) {
        self.mode = self.firmware.mode(custom_mode);
        self.flies_mission = self.firmware.flies_mission(custom_mode);
    }
    pub(crate) fn on_landed(&mut self, now: DroneTime, state: MavLandedState) {
        let state = match state {
            MavLandedState::MAV_LANDED_STATE_UNDEFINED => LandedState::Unknown,
            MavLandedState::MAV_LANDED_STATE_ON_GROUND => LandedState::OnGround,
            MavLandedState::MAV_LANDED_STATE_IN_AIR
            | MavLandedState::MAV_LANDED_STATE_TAKEOFF
            | MavLandedState::MAV_LANDED_STATE_LANDING => LandedState::InAir,
        };
        self.resume_landed(now, state);
    }
    pub(crate) fn resume_landed(&mut self, at: DroneTime, state: LandedState) {
        self.landed = Some((at, state));
    }
    pub(crate) fn landed(&self, now: DroneTime) -> LandedState {
        let fresh = self.landed.filter(|(at, _)| now - *at <= LANDED_STALE);
        fresh.map_or(LandedState::Unknown, |(_, state)| state)
    }
    pub(crate) fn battery(&mut self, now: DroneTime, d: &BATTERY_STATUS_DATA) {
        let Some(battery) = self.batteries.get_mut(usize::from(d.id)) else {
            return;
        };
        let is_reported = (0..=100).contains(&d.battery_remaining);
        let charge = is_reported.then(|| f64::from(d.battery_remaining) * 0.01);
        // The first cell's may be the total; 65535: not measured.
        let cells_mv = d.voltages.iter().filter(|mv| **mv != u16::MAX);
        let voltage_v = cells_mv.map(|mv| f64::from(*mv)).sum::<f64>() * 1e-3;
        let is_measured = voltage_v > 0.0 && voltage_v <= MAX_V;
        let current_a = (d.current_battery >= 0).then(|| f64::from(d.current_battery) * 0.01);
        let used_ah = f64::from(d.current_consumed) * 1e-3;
        let is_counted = (0.0..=MAX_USED_AH).contains(&used_ah);
        let report = BatteryReport {
            charge,
            voltage_v: is_measured.then_some(voltage_v),
            current_a,
            used_ah: is_counted.then_some(used_ah),
        };
        *battery = Some((now, report));
    }
    /// Combines one value over all batteries; None if none reports it or one has fallen silent.
    fn batteries(
        &self,
        now: DroneTime,
        of: impl Fn(&BatteryReport) -> Option<f64>,
        both: impl Fn(f64, f64) -> f64,
    ) -> Option<f64> {
        let known = || {
            self.batteries
                .iter()
                .flatten()
                .filter_map(|(at, b)| Some((*at, of(b)?)))
        };
        let silent = known().any(|(at, _)| now - at > BATTERY_STALE);
        known().map(|(_, v)| v).reduce(both).filter(|_| !silent)
    }
    /// Charge of the emptiest battery, 0 to 1; None if not reported or if a battery has fallen silent.
    pub(crate) fn charge(&self, now: DroneTime) -> Option<f64> {
        self.batteries(now, |b| b.charge, f64::min)
    }
    /// Lowest voltage of all batteries.
    pub(crate) fn voltage_v(&self, now: DroneTime) -> Option<f64> {
        self.batteries(now, |b| b.voltage_v, f64::min)
    }
    /// Total current of all batteries.
    pub(crate) fn current_a(&self, now: DroneTime) -> Option<f64> {
        self.batteries(now, |b| b.current_a, |a, b| a + b)
    }
    /// Total charge drawn since the autopilot's start, Ah.
    pub(crate) fn used_ah(&self, now: DroneTime) -> Option<f64> {
        self.batteries(now, |b| b.used_ah, |a, b| a + b)
    }
    pub(crate) fn battery_news(&mut self, now: DroneTime) -> Option<String> {
        let lost = self
            .batteries
            .iter()
            .flatten()
            .any(|(at, b)| b.charge.is_some() && now - *at > BATTERY_STALE);
        let news = lost != self.battery_lost;
        self.battery_lost = lost;
        news.then(|| if lost { format!(
                "{} no longer reports its battery (BATTERY_STATUS): the charge is extrapolated from the last report",
                self.firmware.name()
            ) } else { format!("{} reports its battery again", self.firmware.name()) })
    }
    pub(crate) fn thrust(&mut self, now: DroneTime, thrust: f64) {
        if (0.0..=1.0).contains(&thrust) {
            self.thrust = Some((now, thrust));
        }
    }
    /// Divisor of the reported thrust of a tilted drone: ArduCopter applies `T / cos` (ATC_ANGLE_BOOST) and
    /// reports `T`.
    pub(crate) fn tilt_compensation(&self, attitude: [f64; 4]) -> f64 {
        let [_, x, y, _] = attitude;
        match self.firmware {
            Firmware::Px4 => 1.0,
            Firmware::ArduCopter => (1.0 - 2.0 * (x * x + y * y)).clamp(0.1, 1.0),
        }
    }
    /// Applied thrust, as an autopilot command; None if the autopilot's outputs contradict its report.
    pub(crate) fn thrust_now(&self, now: DroneTime) -> Option<f64> {
        self.thrust
            .filter(|(at, _)| now - *at <= THRUST_STALE)
            .map(|(_, t)| t)
            .filter(|t| *t <= NO_THRUST || !self.rotors.wait(now))
    }
}

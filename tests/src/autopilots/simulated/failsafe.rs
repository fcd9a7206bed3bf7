//! Failsafes of both firmwares: each does what its parameters say, and is reported as by its maker.
//!
//! PX4 (`failsafe.cpp`, `framework.cpp` of main in 2026): a failsafe replaces the mode until somebody chooses one. Return
//! and Land begin after COM_FAIL_ACT_T in Hold. HEARTBEAT.system_status is CRITICAL while a failsafe acts.
//! ArduCopter (`events.cpp`, `ekf_check.cpp`, `fence.cpp` of 4.5): a failsafe acts once, when its condition begins, and
//! disarms on the ground. CRITICAL lasts as long as the condition, even if nothing is done; the fence never sets it.

use alight_shared::{
    mavlink::dialect::MavState,
    msg::{AutopilotMode, LandedState},
    time::{Span, WorldTime},
};
use alight_uav::autopilot::{
    message::{MavlinkMessage, severity},
    modes::Firmware,
};

use super::{SimulatedAutopilot, modes::mode_number};

/// Time without measurements of the position after which PX4's estimate is invalid (EKF2_NOAID_TOUT).
const PX4_RECKONS: Span = Span::from_millis(5000);
/// ArduCopter's ALT_HOLD.
pub(super) const ALT_HOLD: u32 = 2;
/// PX4 1.18 replaced COM_RC_OVERRIDE by MAN_OVERRIDE_SPD.
const STICK_SPEED: &str = "MAN_OVERRIDE_SPD";

/// Conditions for which the firmwares have a failsafe, apart from the battery's charge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FailsafeConditions {
    pub remote_lost: bool,
    pub station_lost: bool,
    /// The estimator rejects its measurements: no position.
    pub estimator_bad: bool,
    /// GNSS is lost.
    pub dead_reckoning: bool,
    pub fence_breached: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    Remote,
    Station,
    Estimator,
    DeadReckoning,
    BatteryCritical,
    BatteryEmpty,
    Fence,
}

const CAUSES: [Cause; 7] = [
    Cause::Remote,
    Cause::Station,
    Cause::Estimator,
    Cause::DeadReckoning,
    Cause::BatteryCritical,
    Cause::BatteryEmpty,
    Cause::Fence,
];

#[derive(Clone, Debug, Default)]
pub(super) struct Failsafes {
    /// Whether each of [`CAUSES`] is present.
    present: [bool; CAUSES.len()],
    reckons_since: Option<WorldTime>,
    /// Mode that a failsafe has chosen.
    acting: Option<u32>,
    /// PX4's mode after COM_FAIL_ACT_T in Hold.
    delayed: Option<(WorldTime, AutopilotMode)>,
}

/// Modes that the values of a parameter select, one letter for each value from 0 on: Hold (Brake), Return, Land.
const PX4_LINK: &str = "-HRL";
const PX4_CRITICAL: &str = "-RLR";
const PX4_EMERGENCY: &str = "-RLL";
const PX4_FENCE: &str = "--HR-L";
const COPTER_LINK: &str = "-RRLRLRH";
/// Battery and dead reckoning (`FailsafeAction`).
const COPTER_ACTION: &str = "-LRRR-RH";
const COPTER_FENCE: &str = "-RLRHL";

impl SimulatedAutopilot {
    pub(super) fn step_failsafes(&mut self) {
        let reckons = self.conditions.dead_reckoning;
        let since = self.failsafes.reckons_since.unwrap_or(self.now);
        self.failsafes.reckons_since = if reckons { Some(since) } else { None };
        if self.failsafes.acting.is_some_and(|mode| mode != self.chosen()) || !self.armed() {
            self.failsafes.acting = None;
            self.failsafes.delayed = None;
        }
        let present = CAUSES.map(|cause| self.is_present(cause));
        let before = core::mem::replace(&mut self.failsafes.present, present);
        for (cause, (is, was)) in CAUSES.into_iter().zip(present.into_iter().zip(before)) {
            if is && !was && self.armed() {
                self.begin_failsafe(cause);
            }
        }
        if let Some((_, mode)) = self.failsafes.delayed.take_if(|(at, _)| self.now >= *at) {
            self.enter_failsafe(mode_number(self.firmware(), mode));
        }
    }

    fn is_present(&self, cause: Cause) -> bool {
        let c = self.conditions;
        match cause {
            Cause::Remote => c.remote_lost,
            Cause::Station => c.station_lost,
            Cause::Estimator => self.has_no_position(),
            Cause::DeadReckoning => c.dead_reckoning,
            Cause::BatteryCritical | Cause::BatteryEmpty if !self.has_battery_monitor() => false,
            Cause::BatteryCritical => match self.firmware() {
                Firmware::Px4 => {
                    let critical = self.parameter("BAT_EMERGEN_THR")..self.parameter("BAT_CRIT_THR");
                    critical.contains(&self.shown_charge())
                }
                Firmware::ArduCopter => self.shown_voltage() < self.parameter("BATT_LOW_VOLT"),
            },
            Cause::BatteryEmpty => match self.firmware() {
                Firmware::Px4 => self.shown_charge() < self.parameter("BAT_EMERGEN_THR"),
                Firmware::ArduCopter => self.shown_voltage() < self.parameter("BATT_CRT_VOLT"),
            },
            Cause::Fence => c.fence_breached,
        }
    }
    /// Whether the autopilot measures its battery; ArduCopter by BATT_MONITOR.
    pub(super) fn has_battery_monitor(&self) -> bool {
        match self.firmware() {
            Firmware::Px4 => true,
            Firmware::ArduCopter => self.parameter("BATT_MONITOR") >= 3.0,
        }
    }
    /// Whether the estimate of the horizontal position is invalid.
    pub(super) fn has_no_position(&self) -> bool {
        let reckons = match self.firmware() {
            Firmware::Px4 => PX4_RECKONS,
            Firmware::ArduCopter => Span::from_secs(self.parameter("FS_DR_TIMEOUT")),
        };
        let since = self.failsafes.reckons_since;
        self.conditions.estimator_bad || since.is_some_and(|at| self.now - at > reckons)
    }

    /// Mode that a failsafe chooses by its parameters; None if it only warns.
    fn failsafe_mode(&self, cause: Cause) -> Option<u32> {
        let mode = match self.firmware() {
            Firmware::Px4 => self.px4_action(cause),
            Firmware::ArduCopter => {
                let alt_hold = self.parameter("FS_EKF_ACTION") == 2.0 && !self.conditions.remote_lost;
                if cause == Cause::Estimator && alt_hold {
                    return Some(ALT_HOLD);
                }
                self.copter_action(cause)
            }
        };
        mode.map(|mode| mode_number(self.firmware(), mode))
    }
    fn selected(&self, parameter: &str, modes: &str) -> Option<AutopilotMode> {
        match modes.as_bytes().get(self.parameter(parameter) as usize)? {
            b'H' => Some(AutopilotMode::Hold),
            b'R' => Some(AutopilotMode::Return),
            b'L' => Some(AutopilotMode::Land),
            _ => None,
        }
    }
    fn px4_action(&self, cause: Cause) -> Option<AutopilotMode> {
        let mode = self.firmware().mode(self.mode());
        match cause {
            Cause::Remote => {
                let bit = match mode {
                    AutopilotMode::Offboard => 4,
                    AutopilotMode::Hold | AutopilotMode::Return | AutopilotMode::Land => 2,
                    AutopilotMode::Other if self.flight.flies_own_mission() => 1,
                    AutopilotMode::Other => 0,
                };
                if self.parameter("COM_RCL_EXCEPT") as u32 & bit != 0 {
                    return None;
                }
                self.selected("NAV_RCL_ACT", PX4_LINK)
            }
            Cause::Station if mode == AutopilotMode::Land => None,
            Cause::Station => self.selected("NAV_DLL_ACT", PX4_LINK),
            // Attitude set-points need no position.
            Cause::Estimator if mode == AutopilotMode::Offboard && self.flight.follows_attitudes() => None,
            Cause::Estimator => Some(AutopilotMode::Land),
            Cause::DeadReckoning => None,
            Cause::BatteryCritical => self.selected("COM_LOW_BAT_ACT", PX4_CRITICAL),
            Cause::BatteryEmpty => self.selected("COM_LOW_BAT_ACT", PX4_EMERGENCY),
            Cause::Fence => self.selected("GF_ACTION", PX4_FENCE),
        }
    }
    fn copter_action(&self, cause: Cause) -> Option<AutopilotMode> {
        let mode = self.firmware().mode(self.mode());
        let option = |bit: u32| self.parameter("FS_OPTIONS") as u32 & bit != 0;
        let flies_mission = self.flight.flies_own_mission();
        let pilot = mode == AutopilotMode::Other && !flies_mission;
        match cause {
            Cause::Remote if mode == AutopilotMode::Offboard && option(4) => None,
            Cause::Remote if flies_mission && option(1) => None,
            Cause::Remote => self.selected("FS_THR_ENABLE", COPTER_LINK),
            Cause::Station if flies_mission && option(2) || pilot && option(16) => None,
            Cause::Station => self.selected("FS_GCS_ENABLE", COPTER_LINK),
            Cause::Estimator if self.parameter("FS_EKF_ACTION") == 0.0 => None,
            Cause::Estimator => Some(AutopilotMode::Land),
            Cause::DeadReckoning => self.selected("FS_DR_ENABLE", COPTER_ACTION),
            Cause::BatteryCritical => self.selected("BATT_FS_LOW_ACT", COPTER_ACTION),
            Cause::BatteryEmpty => self.selected("BATT_FS_CRT_ACT", COPTER_ACTION),
            Cause::Fence => self.selected("FENCE_ACTION", COPTER_FENCE),
        }
    }

    fn begin_failsafe(&mut self, cause: Cause) {
        let mode = self.failsafe_mode(cause);
        match self.firmware() {
            Firmware::Px4 => {
                let kind = mode.map(|mode| Firmware::Px4.mode(mode));
                match kind {
                    Some(kind @ (AutopilotMode::Return | AutopilotMode::Land))
                        if cause != Cause::Estimator && self.failsafes.acting.is_none() =>
                    {
                        let delay_s = self.parameter("COM_FAIL_ACT_T");
                        self.failsafes.delayed = Some((self.now + Span::from_secs(delay_s), kind));
                        self.announce(&format!(
                            "Failsafe activated, entering Hold for {delay_s:.0} seconds"
                        ));
                        self.enter_failsafe(mode_number(Firmware::Px4, AutopilotMode::Hold));
                    }
                    // A milder action does not replace a failsafe that acts.
                    Some(AutopilotMode::Hold) if self.failsafes.acting.is_some() => {}
                    Some(_) => {
                        self.failsafes.delayed = None;
                        self.announce("Failsafe activated");
                        if let Some(mode) = mode {
                            self.enter_failsafe(mode);
                        }
                    }
                    None => {}
                }
            }
            Firmware::ArduCopter => {
                let what = match cause {
                    Cause::Remote => "Radio Failsafe",
                    Cause::Station => "GCS Failsafe",
                    Cause::Estimator => "EKF Failsafe",
                    Cause::DeadReckoning => "Dead Reckoning started",
                    Cause::BatteryCritical | Cause::BatteryEmpty => "Battery Failsafe",
                    Cause::Fence => "Circle fence breached",
                };
                let on_ground = self.flight.landed() == LandedState::OnGround;
                match mode {
                    Some(_) if on_ground && !matches!(cause, Cause::Estimator | Cause::Fence) => {
                        self.announce(&format!("{what} - Disarming"));
                        self.arm(false);
                    }
                    Some(mode) => {
                        self.announce(what);
                        self.enter_failsafe(mode);
                    }
                    None if cause == Cause::Remote && self.in_offboard() => {
                        self.announce("Radio Failsafe - Continuing Guided Mode");
                    }
                    None => self.announce(what),
                }
            }
        }
    }
    fn enter_failsafe(&mut self, mode: u32) {
        self.choose(mode);
        self.failsafes.acting = Some(mode);
    }
    fn announce(&mut self, text: &str) {
        let severity = match self.firmware() {
            Firmware::Px4 => severity::CRITICAL,
            Firmware::ArduCopter => severity::WARNING,
        };
        let text = text.to_owned();
        self.outbox.push(MavlinkMessage::Text { severity, text });
    }

    /// The pilot moves a stick fast and far. It changes the mode in PX4 by its parameters, in ArduCopter's GUIDED never.
    pub fn move_stick(&mut self) {
        let mode = self.firmware().mode(self.mode());
        let bit = if mode == AutopilotMode::Offboard { 2 } else { 1 };
        let takes_over = match self.parameters.get(STICK_SPEED) {
            Some(speed) => *speed >= 0.0,
            None => self.parameter("COM_RC_OVERRIDE") as u32 & bit != 0,
        };
        if self.armed() && takes_over && mode != AutopilotMode::Other {
            self.choose(mode_number(self.firmware(), AutopilotMode::Other));
        }
    }
    /// Whether a failsafe has chosen the mode, and nobody another one since.
    pub fn obeys_failsafe(&self) -> bool {
        self.failsafes.acting.is_some()
    }

    pub(super) fn system_status(&self) -> MavState {
        let acts = match self.firmware() {
            Firmware::Px4 => self.obeys_failsafe() || self.holds_by_itself(),
            Firmware::ArduCopter => self.has_failsafe_flag(),
        };
        match (self.armed(), acts) {
            (_, true) => MavState::MAV_STATE_CRITICAL,
            (true, false) => MavState::MAV_STATE_ACTIVE,
            (false, false) => MavState::MAV_STATE_STANDBY,
        }
    }
    /// ArduCopter's `any_failsafe_triggered`.
    fn has_failsafe_flag(&self) -> bool {
        let enabled = |cause: Cause| match cause {
            Cause::Remote => self.parameter("FS_THR_ENABLE") > 0.0,
            Cause::Station => self.parameter("FS_GCS_ENABLE") > 0.0,
            Cause::DeadReckoning => self.parameter("FS_DR_ENABLE") > 0.0,
            Cause::Estimator | Cause::BatteryCritical | Cause::BatteryEmpty => true,
            Cause::Fence => false,
        };
        let mut present = CAUSES.into_iter().zip(self.failsafes.present);
        present.any(|(cause, is)| is && enabled(cause))
    }
}

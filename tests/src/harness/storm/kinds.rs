//! Kinds of faults: meaning of the size, ranges of drawn sizes and durations, excused rules, and effect. Only
//! `effects.rs` reads the column of effects. This module does not depend on the world, because scenarios also
//! contain faults.

use serde::{Deserialize, Serialize};

/// Capability that a fault takes from the drone; rules are excused while it is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    Nothing,
    /// Set-points are lost: the autopilot holds a fixed position, and the deck may rise into the drone.
    Command,
    Power,
}

/// Drawn ranges of a kind, and the rules that it excuses.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// Quantity and unit of the size.
    pub of: &'static str,
    pub size: [f64; 2],
    pub lasts_s: [f64; 2],
    pub takes: Takes,
}

/// Uses all columns of `each_kind` except the last.
macro_rules! names {
    ($($(#[$doc:meta])* $kind:ident, $name:literal, $of:literal, $size:expr, $lasts:expr, $takes:ident, $effect:expr;)*) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum FaultKind {
            $($(#[$doc])* #[serde(rename = $name)] $kind,)*
        }
        impl FaultKind {
            pub const ALL: &'static [FaultKind] = &[$(FaultKind::$kind),*];
            pub const fn name(self) -> &'static str {
                match self { $(FaultKind::$kind => $name,)* }
            }
            /// Whether half the size is a milder fault; false for identifiers and bounds.
            pub const fn is_milder_by_half(self) -> bool {
                !matches!(self, FaultKind::StreamStops | FaultKind::VesselImuClipped | FaultKind::BatteryAt)
            }
            pub const fn stops_mission(self) -> bool {
                matches!(
                    self,
                    FaultKind::MissionKilled
                        | FaultKind::MissionFrozen
                        | FaultKind::ComputerKilled
                        | FaultKind::ComputerFrozen
                        | FaultKind::ComputerSuspended
                        | FaultKind::ComputerRebooted
                        | FaultKind::ComputerClockSteps
                )
            }
            pub const fn empties(self) -> bool {
                matches!(self, FaultKind::BatteryAt | FaultKind::BatterySags | FaultKind::BatteryReadsLow)
            }
            /// Whether the autopilot has a failsafe of its own for the fault.
            pub const fn has_failsafe(self) -> bool {
                self.empties()
                    || matches!(
                        self,
                        FaultKind::RemoteLost
                            | FaultKind::StationLost
                            | FaultKind::EstimatorFailed
                            | FaultKind::DeadReckoning
                            | FaultKind::FenceBreached
                    )
            }
            /// Whether a bad ending may be excused by the fault.
            pub fn excuses(self) -> bool {
                self.spec().takes != Takes::Nothing || self.has_failsafe()
            }
            /// Whether the fault affects a moving base and is drawn only for storms with one.
            pub const fn needs_moving_base(self) -> bool {
                matches!(self, FaultKind::CorrectionsLost | FaultKind::FixLost | FaultKind::FalseFix)
            }
            /// Whether the fault is one of the vessel's devices, which a separate stream draws.
            pub const fn is_of_device(self) -> bool {
                matches!(
                    self,
                    FaultKind::VesselRatesZero
                        | FaultKind::VesselVelocityZero
                        | FaultKind::VesselHeadingZero
                        | FaultKind::VesselImuAhead
                        | FaultKind::VesselGnssAhead
                        | FaultKind::VesselHeadingAhead
                        | FaultKind::VesselYawRateInverted
                        | FaultKind::VesselRollInverted
                        | FaultKind::VesselRatesInDegrees
                        | FaultKind::VesselGnssMixed
                        | FaultKind::VesselLinesFull
                        | FaultKind::VesselCompassSlewed
                )
            }
            pub const fn spec(self) -> Spec {
                match self {
                    $(FaultKind::$kind => Spec {
                        of: $of, size: $size, lasts_s: $lasts, takes: Takes::$takes,
                    },)*
                }
            }
        }
    };
}

const NONE: [f64; 2] = [0.0, 0.0];
/// Downtime of a process, s.
const RESTART: [f64; 2] = [0.1, 1.0];
const FREEZE: [f64; 2] = [0.1, 3.0];
/// Duration of a measurement outage, s.
const GAP: [f64; 2] = [0.2, 8.0];
/// 0: the process finds its checkpoint; 1: it does not.
pub(super) const CHECKPOINT: [f64; 2] = [0.0, 1.0];
/// Duration of wrong measurements, s.
const WRONG: [f64; 2] = [2.0, 30.0];
/// Duration of a force or moment on the vessel, s.
const PUSH: [f64; 2] = [0.5, 15.0];

/// Passes the kinds to a macro with the columns name, meaning of the size, size, duration, lost capability, effect.
#[rustfmt::skip]
macro_rules! each_kind { ($with:ident) => { $with! {
    PredictorKilled, "predictor-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Nothing,
        Kills(ProcessKind::Predictor);
    MissionKilled, "mission-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Nothing,
        Kills(ProcessKind::Mission);
    PlannerKilled, "planner-killed", "", NONE, RESTART, Nothing,
        Kills(ProcessKind::Planner);
    PilotKilled, "pilot-killed", "", NONE, RESTART, Command,
        Kills(ProcessKind::Pilot);
    LinkKilled, "link-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Command,
        Kills(ProcessKind::Autopilot);
    /// The supervisor and all of the drone's processes are killed.
    ComputerKilled, "computer-killed", "1: without its checkpoints", CHECKPOINT, [0.3, 2.0], Command,
        Events(|r, _| r.world.kill_computer(0), |r, size| r.world.start_computer(0, kept(size)));
    BridgeKilled, "bridge-killed", "", NONE, RESTART, Nothing,
        Kills(ProcessKind::Bridge);
    /// The drone's computer loses power and reboots; files on its disk remain, shared memory does not.
    ComputerRebooted, "computer-rebooted", "", NONE, [5.0, 20.0], Command,
        Events(|r, _| r.world.kill_computer(0), |r, _| {
            r.world.restart_clock(0);
            r.world.start_computer(0, Checkpoints::Kept);
        });
    PredictorFrozen, "predictor-frozen", "", NONE, FREEZE, Nothing,
        Freezes(ProcessKind::Predictor);
    MissionFrozen, "mission-frozen", "", NONE, FREEZE, Nothing,
        Freezes(ProcessKind::Mission);
    PlannerFrozen, "planner-frozen", "", NONE, FREEZE, Nothing,
        Freezes(ProcessKind::Planner);
    PilotFrozen, "pilot-frozen", "", NONE, FREEZE, Command,
        Freezes(ProcessKind::Pilot);
    LinkFrozen, "link-frozen", "", NONE, FREEZE, Command,
        Freezes(ProcessKind::Autopilot);
    BridgeFrozen, "bridge-frozen", "", NONE, FREEZE, Nothing,
        Freezes(ProcessKind::Bridge);
    PlannerSlow, "planner-slow", "later, s", [0.02, 0.4], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.solve_s = size.max(0.0));
    ComputerFrozen, "computer-frozen", "", NONE, FREEZE, Command,
        Lasting(|f, _| f.frozen.computer = true);
    VesselFrozen, "vessel-frozen", "", NONE, [0.2, 10.0], Nothing,
        Freezes(ProcessKind::Vessel);
    VesselRestarted, "vessel-restarted", "", NONE, NONE, Nothing,
        Kills(ProcessKind::Vessel);
    VesselSuspended, "vessel-suspended", "", NONE, [0.2, 10.0], Nothing,
        Lasting(|f, _| (f.frozen.vessel, f.clock_rates[0]) = (true, -1.0));
    ComputerSuspended, "computer-suspended", "", NONE, FREEZE, Command,
        Lasting(|f, _| (f.frozen.computer, f.clock_rates[1]) = (true, -1.0));
    VesselClockSteps, "vessel-clock-steps", "s ahead", [0.02, 5.0], NONE, Nothing,
        Once(|r, size| r.world.step_clock(None, Span::from_secs(size.max(0.0))));
    ComputerClockSteps, "computer-clock-steps", "s ahead", [0.02, 5.0], NONE, Nothing,
        Once(|r, size| r.world.step_clock(Some(0), Span::from_secs(size.max(0.0))));
    ClocksDrift, "clocks-drift", "parts per million", [-500.0, 500.0], [5.0, 60.0], Nothing,
        Lasting(|f, size| f.clock_rates[0] += 1e-6 * size);
    RadioLost, "radio-lost", "", NONE, [0.5, 30.0], Nothing,
        Lasting(|f, _| f.radio = [LOST; 2]);
    RadioDeaf, "radio-deaf", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.radio[0] = LOST);
    RadioMute, "radio-mute", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.radio[1] = LOST);
    RadioLossy, "radio-lossy", "fraction lost", [0.2, 0.9], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.loss = r.loss.max(size)));
    RadioLate, "radio-late", "delay, s", [0.1, 1.5], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.delay_s = size.max(0.0)));
    RadioJitter, "radio-jitter", "maximum delay, s", [0.02, 0.5], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.jitter_s = size.max(0.0)));
    RadioDoubled, "radio-doubled", "fraction doubled", [0.2, 1.0], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.doubled = size));
    /// A second vessel sends with the same identity.
    VesselTwin, "vessel-twin", "m further north", [5.0, 60.0], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.twin_m = size);
    VesselImuLost, "vessel-imu-lost", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.vessel.imu_lost = true);
    VesselGnssLost, "vessel-gnss-lost", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.vessel.gnss_lost = true);
    VesselHeadingLost, "vessel-heading-lost", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.vessel.heading_lost = true);
    /// Constant heading offset, as near steel.
    VesselHeadingOff, "vessel-heading-off", "deg", [-15.0, 15.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.heading_off_rad = size.to_radians());
    VesselGnssOff, "vessel-gnss-off", "m to the north", [-3.0, 3.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.gnss_off_m[0] = size);
    VesselHeightOff, "vessel-height-off", "m up", [-3.0, 3.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.gnss_off_m[1] = size);
    /// Every second heading comes from another device, which has an offset.
    VesselHeadingMixed, "vessel-heading-mixed", "deg", [-30.0, 30.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.heading_mixed_rad = size.to_radians());
    VesselImuStuck, "vessel-imu-stuck", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.vessel.stuck[0] = true);
    VesselGnssStuck, "vessel-gnss-stuck", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.stuck[1] = true);
    VesselHeadingStuck, "vessel-heading-stuck", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.stuck[2] = true);
    VesselGyroOff, "vessel-gyro-off", "deg/s", [-2.0, 2.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.gyro_off_radps = size.to_radians());
    VesselImuClipped, "vessel-imu-clipped", "at, m/s2", [8.0, 10.5], WRONG, Nothing,
        Lasting(|f, size| f.vessel.clip_mps2 = size);
    /// Measurements arrive late and are stamped on arrival.
    VesselStampedLate, "vessel-stamped-late", "s", [0.02, 0.5], WRONG, Nothing,
        Lasting(|f, size| f.vessel.late_s = size);
    /// The vessel's IMU is rotated about the forward axis.
    VesselMountingOff, "vessel-mounting-off", "deg", [-5.0, 5.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.mounting_rad = size.to_radians());
    /// A shifted weight heels the vessel.
    VesselHeels, "vessel-heels", "Nm", [-900.0, 900.0], PUSH, Nothing,
        Lasting(|f, size| f.push[3] += size);
    VesselTurns, "vessel-turns", "Nm", [-300.0, 300.0], PUSH, Nothing,
        Lasting(|f, size| f.push[5] += size);
    VesselPushed, "vessel-pushed", "N", [-300.0, 300.0], PUSH, Nothing,
        Lasting(|f, size| f.push[0] += size);
    /// A wake excites roll with a period of 2.5 s.
    VesselInWake, "vessel-in-wake", "Nm", [200.0, 900.0], PUSH, Nothing,
        Lasting(|f, size| f.wake_nm = size);
    Blind, "blind", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.blind = true);
    ImagesLate, "images-late", "delay, s", [0.02, 0.3], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.images_late_s = size);
    #[serde(alias = "neighbour-seen")]
    NeighbourDetected, "neighbour-detected", "m to the east", [3.0, 30.0], [0.5, 10.0], Nothing,
        Lasting(|f, size| f.drone.neighbour_offset_m[1] = size);
    ImagesLossy, "images-lossy", "fraction lost", [0.3, 0.95], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.lost = size);
    ImagesSmeared, "images-smeared", "m", [0.02, 0.3], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.scatter_m = size);
    /// Every third detection is of another tag.
    FalseTag, "false-tag", "m to the right", [-5.0, 5.0], [0.5, 10.0], Nothing,
        Lasting(|f, size| f.drone.false_tag_m = size);
    RangeLost, "range-lost", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_lost = true);
    RangeStuck, "range-stuck", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_stuck = true);
    RangeOff, "range-off", "m too long", [-2.0, 2.0], GAP, Nothing,
        Lasting(|f, size| f.drone.range_off_m = size);
    /// A missing echo is reported as 0.
    RangeZero, "range-zero", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_zero = true);
    /// The estimate jumps, and the reset counter is incremented.
    PositionReset, "position-reset", "m to the north", [-2.0, 2.0], NONE, Nothing,
        Once(|r, size| r.world.reset_position(0, &(Vector3::x() * size), true));
    /// The estimate jumps, but the reset counter is not incremented.
    PositionJump, "position-jump", "m to the north", [-2.0, 2.0], NONE, Nothing,
        Once(|r, size| r.world.reset_position(0, &(Vector3::x() * size), false));
    HeightReset, "height-reset", "m up", [-2.0, 2.0], NONE, Nothing,
        Once(|r, size| r.world.reset_position(0, &(Vector3::z() * -size), true));
    HeightJump, "height-jump", "m up", [-2.0, 2.0], NONE, Nothing,
        Once(|r, size| r.world.reset_position(0, &(Vector3::z() * -size), false));
    HeadingReset, "heading-reset", "deg", [-25.0, 25.0], NONE, Nothing,
        Once(|r, size| r.world.reset_heading(0, size.to_radians()));
    /// The position drifts, as under slow spoofing.
    PositionDrifts, "position-drifts", "m/s to the north", [-0.5, 0.5], [2.0, 20.0], Nothing,
        Lasting(|f, size| f.autopilot.drift_mps = size);
    LandedReported, "landed-reported", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.autopilot.landed_report = Some(LandedState::OnGround));
    FlightReported, "flight-reported", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.autopilot.landed_report = Some(LandedState::InAir));
    AutopilotClock, "autopilot-clock", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.linked(0).into_iter().for_each(|l| l.autopilot.restart()));
    StreamStops, "stream-stops", "message id", [0.0, 500.0], [0.5, 15.0], Nothing,
        Lasting(|f, size| f.autopilot.muted.push(size as u32));
    AutopilotSilent, "autopilot-silent", "", NONE, [0.2, 5.0], Command,
        Lasting(|f, _| f.autopilot.silent = true);
    CableOut, "cable-out", "", NONE, [0.2, 5.0], Command,
        Lasting(|f, _| f.autopilot.cut = true);
    CommandsDenied, "commands-denied", "", NONE, [0.5, 10.0], Command,
        Lasting(|f, _| f.autopilot.answer = Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    BatteryAt, "battery-at", "charge, 0 to 1", [0.05, 0.4], NONE, Nothing,
        Once(|r, size| r.world.linked(0).into_iter().for_each(|l| l.autopilot.battery = size.max(0.0)));
    BatterySags, "battery-sags", "1/s", [0.002, 0.05], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.autopilot.drain_per_s = size.max(0.0));
    /// Charge and voltage freeze, or toggle between the frozen value and a higher one.
    BatteryStuck, "battery-stuck", "charge by which it toggles", [-0.02, 0.02], [1.0, 60.0], Nothing,
        Lasting(|f, size| f.autopilot.battery_stuck = Some(size.max(0.0)));
    /// An old or small battery: a full charge lasts for this flight time.
    BatteryAged, "battery-aged", "s", [300.0, 900.0], NONE, Nothing,
        Once(|r, size| r.world.linked(0).into_iter().for_each(|l| l.autopilot.endurance_s = size.max(10.0)));
    /// Neither charge nor voltage is reported.
    BatteryUnknown, "battery-unknown", "", NONE, [1.0, 60.0], Nothing,
        Lasting(|f, _| f.autopilot.no_battery = true);
    RemoteLost, "remote-lost", "", NONE, [1.0, 20.0], Nothing,
        Lasting(|f, _| f.autopilot.conditions.remote_lost = true);
    /// The pilot moves a stick, then gives the mode back.
    StickMoved, "stick-moved", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| move_stick(r), |r, _| give_back(r));
    StationLost, "station-lost", "", NONE, [1.0, 20.0], Nothing,
        Lasting(|f, _| f.autopilot.conditions.station_lost = true);
    /// The estimator rejects its measurements, and its position drifts.
    EstimatorFailed, "estimator-failed", "m/s to the north", [-0.5, 0.5], [1.0, 20.0], Nothing,
        Lasting(|f, size| (f.autopilot.conditions.estimator_bad, f.autopilot.drift_mps) = (true, size));
    /// GNSS is lost; the position drifts.
    DeadReckoning, "dead-reckoning", "m/s to the north", [-0.5, 0.5], [1.0, 60.0], Nothing,
        Lasting(|f, size| (f.autopilot.conditions.dead_reckoning, f.autopilot.drift_mps) = (true, size));
    /// The autopilot's gauge reads this charge, and its own battery failsafe acts on it.
    BatteryReadsLow, "battery-reads-low", "charge, 0 to 1", [0.0, 0.1], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.autopilot.battery_reads = Some(size.max(0.0)));
    /// The drone is beyond a fence of the autopilot, which the boat has left.
    FenceBreached, "fence-breached", "", NONE, [1.0, 60.0], Nothing,
        Lasting(|f, _| f.autopilot.conditions.fence_breached = true);
    MotorWeak, "motor-weak", "fraction lost", [0.05, 0.3], [1.0, 60.0], Power,
        Lasting(|f, size| f.weak[0] = f.weak[0].max(size));
    ThrustWeak, "thrust-weak", "fraction lost", [0.05, 0.2], [1.0, 60.0], Power,
        Lasting(|f, size| f.weak[1] = f.weak[1].max(size));
    PayloadDropped, "payload-dropped", "fraction of the weight", [0.03, 0.2], NONE, Nothing,
        Once(|r, size| r.world.lighten(size));
    HeldByStation, "held-by-station", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Hold), |r, _| choose(r, AutopilotMode::Offboard));
    ReturnedByStation, "returned-by-station", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Return), |r, _| choose(r, AutopilotMode::Offboard));
    /// The pilot takes manual control, then gives the mode back.
    TakenOver, "taken-over", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Other), |r, _| choose(r, AutopilotMode::Offboard));
    /// The operator aborts at the drone's computer.
    Abort, "abort", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.command_to(0, CommandKind::Abort));
    AbortAshore, "abort-ashore", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.operator_command(0, CommandKind::Abort));
    Hold, "hold", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.command_to(0, CommandKind::Hold));
    OrderedAgain, "ordered-again", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.command_to(0, CommandKind::Land));
    OrderedAshore, "ordered-ashore", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.operator_command(0, CommandKind::Land));
    /// The operator commands a drone that does not exist.
    OrderedOther, "ordered-other", "", NONE, NONE, Nothing,
        Once(|r, _| r.world.operator_command(7, CommandKind::Land));
    DeckOccupied, "deck-occupied", "", NONE, [1.0, 20.0], Nothing,
        Events(|r, _| occupy(r, true), |r, _| occupy(r, false));
    DeckClosed, "deck-closed", "", NONE, [1.0, 20.0], Nothing,
        Events(|r, _| r.world.deck_order(DeckOrder::Closed), |r, _| r.world.deck_order(DeckOrder::Open));
    CorrectionsLost, "corrections-lost", "", NONE, [0.5, 30.0], Nothing,
        Lasting(|f, _| f.moving_base.corrections_lost = true);
    FixLost, "fix-lost", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.moving_base.fix_lost = true);
    FalseFix, "false-fix", "m", [0.1, 2.0], WRONG, Nothing,
        Lasting(|f, size| f.moving_base.false_fix_m = size);
    /// The gyroscopes' values stay at zero.
    VesselRatesZero, "vessel-rates-zero", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.zero[0] = true);
    VesselVelocityZero, "vessel-velocity-zero", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.zero[1] = true);
    VesselHeadingZero, "vessel-heading-zero", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.zero[2] = true);
    VesselImuAhead, "vessel-imu-ahead", "s", [0.05, 5.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.ahead_s[0] = size);
    VesselGnssAhead, "vessel-gnss-ahead", "s", [0.05, 5.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.ahead_s[1] = size);
    VesselHeadingAhead, "vessel-heading-ahead", "s", [0.05, 5.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.ahead_s[2] = size);
    VesselYawRateInverted, "vessel-yaw-rate-inverted", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.yaw_rate_inverted = true);
    VesselRollInverted, "vessel-roll-inverted", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.roll_inverted = true);
    VesselRatesInDegrees, "vessel-rates-in-degrees", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.rates_in_degrees = true);
    /// Every second fix comes from a second receiver.
    VesselGnssMixed, "vessel-gnss-mixed", "m to the north", [-10.0, 10.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.gnss_mixed_m = size);
    /// The devices send more than their lines carry.
    VesselLinesFull, "vessel-lines-full", "s later each second", [0.01, 0.3], WRONG, Nothing,
        Lasting(|f, size| f.vessel.line_fills = size.max(0.0));
    /// A time service slews the clock of the compass's host: ntpd by 500 parts per million, chrony by up to 83 333.
    VesselCompassSlewed, "vessel-compass-slewed", "parts per million", [-80_000.0, 80_000.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.compass_clock_rate = 1e-6 * size);
} } }
pub(super) use each_kind;
each_kind!(names);

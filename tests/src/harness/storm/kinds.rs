//! The kinds of faults: of what each has a size, how large and how long they are drawn, what they excuse, and what they do.
//!
//! Their effects are a column that `effects.rs` reads, which knows the world; nothing here does, so a scenario has faults.

use alight_shared::process::ProcessKind;
use serde::{Deserialize, Serialize};

/// Means that a fault takes from the drone, so that not every rule can hold meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// Nothing: all rules hold.
    Nothing,
    /// Whoever commands: the autopilot holds a fixed place, and the deck may rise into the drone.
    Command,
    /// Thrust.
    Power,
}

/// Distribution of a kind, and what it excuses.
#[derive(Clone, Copy, Debug)]
pub struct Spec {
    /// Unit of the size, with its meaning.
    pub of: &'static str,
    /// Sizes are drawn between these.
    pub size: [f64; 2],
    /// Durations are drawn between these, s.
    pub lasts_s: [f64; 2],
    /// Means that the fault takes.
    pub takes: Takes,
}

/// Declares the kinds of `each_kind` with all columns but the last.
macro_rules! names {
    ($($(#[$doc:meta])* $kind:ident, $name:literal, $of:literal, $size:expr, $lasts:expr, $takes:ident, $effect:expr;)*) => {
        /// Kinds of faults.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum FaultKind {
            $($(#[$doc])* #[serde(rename = $name)] $kind,)*
        }
        impl FaultKind {
            /// All of them.
            pub const ALL: &'static [FaultKind] = &[$(FaultKind::$kind),*];
            /// The name in lists.
            pub const fn name(self) -> &'static str {
                match self { $(FaultKind::$kind => $name,)* }
            }
            /// Half of its size is a milder fault: not of a number that is a name, nor of a bound.
            pub const fn is_milder_by_half(self) -> bool {
                !matches!(self, FaultKind::StreamStops | FaultKind::VesselImuClipped | FaultKind::BatteryAt)
            }
            /// The mission's process does not take what comes.
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
            /// The one process that it kills or lets stand still.
            pub fn process(self) -> Option<ProcessKind> {
                STOPS.iter().find(|(kind, ..)| *kind == self).map(|(_, process, _)| *process)
            }
            /// That process stands still, and knows nothing of the time between.
            pub fn freezes(self) -> bool {
                STOPS.iter().any(|(kind, _, stop)| *kind == self && *stop == Stop::Freezes)
            }
            /// It takes of the battery, which stays taken.
            pub const fn empties(self) -> bool {
                matches!(self, FaultKind::BatteryAt | FaultKind::BatterySags)
            }
            /// It happens to a moving base, and is drawn of a storm with one alone.
            pub const fn needs_moving_base(self) -> bool {
                matches!(self, FaultKind::CorrectionsLost | FaultKind::FixLost | FaultKind::FalseFix)
            }
            /// Distribution of the kind, and what it excuses.
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

/// Range of a fault without size, or without duration.
const NONE: [f64; 2] = [0.0, 0.0];
/// A process is started again after so long, s.
const RESTART: [f64; 2] = [0.1, 1.0];
/// A process stands still so long, s.
const FREEZE: [f64; 2] = [0.1, 3.0];
/// A measurement does not come for so long, s.
const GAP: [f64; 2] = [0.2, 8.0];
/// 0: the successor has its predecessor's checkpoint; 1: it has none.
pub(super) const CHECKPOINT: [f64; 2] = [0.0, 1.0];
/// A sensor measures wrongly for so long, s.
const WRONG: [f64; 2] = [2.0, 30.0];
/// Somebody or something pushes the vessel for so long, s.
const PUSH: [f64; 2] = [0.5, 15.0];

/// Stop of a process.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stop {
    /// It is gone at once, and started again.
    Dies,
    /// It stands still.
    Freezes,
}
use Stop::{Dies, Freezes};

/// The kinds that happen to one process.
const STOPS: [(FaultKind, ProcessKind, Stop); 14] = [
    (FaultKind::PredictorKilled, ProcessKind::Predictor, Dies),
    (FaultKind::MissionKilled, ProcessKind::Mission, Dies),
    (FaultKind::PlannerKilled, ProcessKind::Planner, Dies),
    (FaultKind::PilotKilled, ProcessKind::Pilot, Dies),
    (FaultKind::LinkKilled, ProcessKind::Autopilot, Dies),
    (FaultKind::BridgeKilled, ProcessKind::Bridge, Dies),
    (FaultKind::VesselRestarted, ProcessKind::Vessel, Dies),
    (FaultKind::PredictorFrozen, ProcessKind::Predictor, Freezes),
    (FaultKind::MissionFrozen, ProcessKind::Mission, Freezes),
    (FaultKind::PlannerFrozen, ProcessKind::Planner, Freezes),
    (FaultKind::PilotFrozen, ProcessKind::Pilot, Freezes),
    (FaultKind::LinkFrozen, ProcessKind::Autopilot, Freezes),
    (FaultKind::BridgeFrozen, ProcessKind::Bridge, Freezes),
    (FaultKind::VesselFrozen, ProcessKind::Vessel, Freezes),
];

/// Gives a macro the kinds: name, of what the size is, size, duration, what it takes, effect.
#[rustfmt::skip]
macro_rules! each_kind { ($with:ident) => { $with! {
    /// The predictor's process dies.
    PredictorKilled, "predictor-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Nothing,
        Events(|r, _| kill(r, ProcessKind::Predictor), |r, size| start(r, ProcessKind::Predictor, size));
    /// The mission's.
    MissionKilled, "mission-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Nothing,
        Events(|r, _| kill(r, ProcessKind::Mission), |r, size| start(r, ProcessKind::Mission, size));
    /// The planner's.
    PlannerKilled, "planner-killed", "", NONE, RESTART, Nothing,
        Events(|r, _| kill(r, ProcessKind::Planner), |r, _| start(r, ProcessKind::Planner, 0.0));
    /// The pilot's.
    PilotKilled, "pilot-killed", "", NONE, RESTART, Command,
        Events(|r, _| kill(r, ProcessKind::Pilot), |r, _| start(r, ProcessKind::Pilot, 0.0));
    /// The autopilot link's.
    LinkKilled, "link-killed", "1: without its checkpoint", CHECKPOINT, RESTART, Command,
        Events(|r, _| kill(r, ProcessKind::Autopilot), |r, size| start(r, ProcessKind::Autopilot, size));
    /// The supervisor, and with it all of the drone's computer.
    ComputerKilled, "computer-killed", "1: without its checkpoints", CHECKPOINT, [0.3, 2.0], Command,
        Events(|r, _| r.world.kill_computer(0), |r, size| r.world.start_computer(0, kept(size)));
    /// The bridge's.
    BridgeKilled, "bridge-killed", "", NONE, RESTART, Nothing,
        Events(|r, _| kill(r, ProcessKind::Bridge), |r, _| start(r, ProcessKind::Bridge, 0.0));
    /// The drone's computer loses its supply and starts again, with what its memory had lost, and what lies on its disk.
    ComputerRebooted, "computer-rebooted", "", NONE, [5.0, 20.0], Command,
        Events(|r, _| r.world.kill_computer(0), |r, _| {
            r.world.restart_clock(0);
            r.world.start_computer(0, Checkpoints::Kept);
        });
    /// The predictor stands still.
    PredictorFrozen, "predictor-frozen", "", NONE, FREEZE, Nothing,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Predictor));
    /// The mission does.
    MissionFrozen, "mission-frozen", "", NONE, FREEZE, Nothing,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Mission));
    /// The planner does.
    PlannerFrozen, "planner-frozen", "", NONE, FREEZE, Nothing,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Planner));
    /// The pilot does.
    PilotFrozen, "pilot-frozen", "", NONE, FREEZE, Command,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Pilot));
    /// The link to the autopilot does.
    LinkFrozen, "link-frozen", "", NONE, FREEZE, Command,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Autopilot));
    /// The bridge does.
    BridgeFrozen, "bridge-frozen", "", NONE, FREEZE, Nothing,
        Lasting(|f, _| f.frozen.processes.push(ProcessKind::Bridge));
    /// The processor is slow: plans come late.
    PlannerSlow, "planner-slow", "later, s", [0.02, 0.4], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.solve_s = size.max(0.0));
    /// The whole computer of the drone does.
    ComputerFrozen, "computer-frozen", "", NONE, FREEZE, Command,
        Lasting(|f, _| f.frozen.computer = true);
    /// The vessel's computer stands still.
    VesselFrozen, "vessel-frozen", "", NONE, [0.2, 10.0], Nothing,
        Lasting(|f, _| f.frozen.vessel = true);
    /// The vessel's computer restarts.
    VesselRestarted, "vessel-restarted", "", NONE, NONE, Nothing,
        Events(|r, _| r.restart_vessel(), nothing);
    /// The vessel's computer is suspended, and its steady clock with it.
    VesselSuspended, "vessel-suspended", "", NONE, [0.2, 10.0], Nothing,
        Lasting(|f, _| (f.frozen.vessel, f.clock_rates[0]) = (true, -1.0));
    /// The drone's computer is.
    ComputerSuspended, "computer-suspended", "", NONE, FREEZE, Command,
        Lasting(|f, _| (f.frozen.computer, f.clock_rates[1]) = (true, -1.0));
    /// The vessel's steady clock goes ahead at once.
    VesselClockSteps, "vessel-clock-steps", "s ahead", [0.02, 5.0], NONE, Nothing,
        Events(|r, size| r.world.step_clock(None, Span::from_secs(size.max(0.0))), nothing);
    /// The drone's does.
    ComputerClockSteps, "computer-clock-steps", "s ahead", [0.02, 5.0], NONE, Nothing,
        Events(|r, size| r.world.step_clock(Some(0), Span::from_secs(size.max(0.0))), nothing);
    /// The two clocks drift apart.
    ClocksDrift, "clocks-drift", "parts per million", [-500.0, 500.0], [5.0, 60.0], Nothing,
        Lasting(|f, size| f.clock_rates[0] += 1e-6 * size);
    /// The radio loses everything, both ways.
    RadioLost, "radio-lost", "", NONE, [0.5, 30.0], Nothing,
        Lasting(|f, _| f.radio = [LOST; 2]);
    /// The radio loses everything to the drone.
    RadioDeaf, "radio-deaf", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.radio[0] = LOST);
    /// The radio loses everything to the vessel.
    RadioMute, "radio-mute", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.radio[1] = LOST);
    /// The radio loses a share of its packets.
    RadioLossy, "radio-lossy", "fraction lost", [0.2, 0.9], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.loss = r.loss.max(size)));
    /// Packets are late.
    RadioLate, "radio-late", "delay, s", [0.1, 1.5], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.delay_s = size.max(0.0)));
    /// Packets overtake each other.
    RadioJitter, "radio-jitter", "delay up to, s", [0.02, 0.5], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.jitter_s = size.max(0.0)));
    /// Packets come twice.
    RadioDoubled, "radio-doubled", "fraction doubled", [0.2, 1.0], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.radio.iter_mut().for_each(|r| r.doubled = size));
    /// A second vessel sends under this one's identity.
    VesselTwin, "vessel-twin", "m further north", [5.0, 60.0], [1.0, 30.0], Nothing,
        Lasting(|f, size| f.twin_m = size);
    /// The vessel's inertial samples do not come.
    VesselImuLost, "vessel-imu-lost", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.vessel.imu_lost = true);
    /// The vessel's fixes do not come.
    VesselGnssLost, "vessel-gnss-lost", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.vessel.gnss_lost = true);
    /// The vessel's heading does not come.
    VesselHeadingLost, "vessel-heading-lost", "", NONE, [0.5, 20.0], Nothing,
        Lasting(|f, _| f.vessel.heading_lost = true);
    /// The vessel's heading is off, as near steel.
    VesselHeadingOff, "vessel-heading-off", "deg", [-15.0, 15.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.heading_off_rad = size.to_radians());
    /// The vessel's fixes are off to the north.
    VesselGnssOff, "vessel-gnss-off", "m to the north", [-3.0, 3.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.gnss_off_m[0] = size);
    /// The vessel's fixes are too high.
    VesselHeightOff, "vessel-height-off", "m up", [-3.0, 3.0], [2.0, 30.0], Nothing,
        Lasting(|f, size| f.vessel.gnss_off_m[1] = size);
    /// Every second heading is another device's, which is off.
    VesselHeadingMixed, "vessel-heading-mixed", "deg", [-30.0, 30.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.heading_mixed_rad = size.to_radians());
    /// The vessel's inertial sensor repeats a sample.
    VesselImuStuck, "vessel-imu-stuck", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.vessel.stuck[0] = true);
    /// The vessel's receiver repeats a fix.
    VesselGnssStuck, "vessel-gnss-stuck", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.stuck[1] = true);
    /// The vessel's compass repeats a heading.
    VesselHeadingStuck, "vessel-heading-stuck", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.vessel.stuck[2] = true);
    /// The vessel's rate of roll is off.
    VesselGyroOff, "vessel-gyro-off", "deg/s", [-2.0, 2.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.gyro_off_radps = size.to_radians());
    /// The vessel's accelerometer clips.
    VesselImuClipped, "vessel-imu-clipped", "at, m/s2", [8.0, 10.5], WRONG, Nothing,
        Lasting(|f, size| f.vessel.clip_mps2 = size);
    /// The vessel's measurements arrive late, and are stamped then.
    VesselStampedLate, "vessel-stamped-late", "s", [0.02, 0.5], WRONG, Nothing,
        Lasting(|f, size| f.vessel.late_s = size);
    /// The vessel's inertial sensor was knocked about the bow's axis.
    VesselMountingOff, "vessel-mounting-off", "deg", [-5.0, 5.0], WRONG, Nothing,
        Lasting(|f, size| f.vessel.mounting_rad = size.to_radians());
    /// The weight of a crew member heels it.
    VesselHeels, "vessel-heels", "Nm", [-900.0, 900.0], PUSH, Nothing,
        Lasting(|f, size| f.push[3] += size);
    /// Something turns it.
    VesselTurns, "vessel-turns", "Nm", [-300.0, 300.0], PUSH, Nothing,
        Lasting(|f, size| f.push[5] += size);
    /// Something pushes it ahead or astern.
    VesselPushed, "vessel-pushed", "N", [-300.0, 300.0], PUSH, Nothing,
        Lasting(|f, size| f.push[0] += size);
    /// Another ship's wake rolls it with a period of 2.5 s.
    VesselInWake, "vessel-in-wake", "Nm", [200.0, 900.0], PUSH, Nothing,
        Lasting(|f, size| f.wake_nm = size);
    /// The drone's camera sees nothing.
    Blind, "blind", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.blind = true);
    /// Images are stamped late.
    ImagesLate, "images-late", "delay, s", [0.02, 0.3], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.images_late_s = size);
    /// A deck next to the vessel's is detected in its place.
    NeighbourSeen, "neighbour-seen", "m to the east", [3.0, 30.0], [0.5, 10.0], Nothing,
        Lasting(|f, size| f.drone.neighbour_offset_m[1] = size);
    /// Images are lost.
    ImagesLossy, "images-lossy", "fraction lost", [0.3, 0.95], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.lost = size);
    /// Images are smeared.
    ImagesSmeared, "images-smeared", "m", [0.02, 0.3], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.drone.scatter_m = size);
    /// Every third detection is of another tag.
    FalseTag, "false-tag", "m to the right", [-5.0, 5.0], [0.5, 10.0], Nothing,
        Lasting(|f, size| f.drone.false_tag_m = size);
    /// The rangefinder gives nothing.
    RangeLost, "range-lost", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_lost = true);
    /// It repeats the first range that it measures from then on.
    RangeStuck, "range-stuck", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_stuck = true);
    /// It measures too long.
    RangeOff, "range-off", "m too long", [-2.0, 2.0], GAP, Nothing,
        Lasting(|f, size| f.drone.range_off_m = size);
    /// It gives 0 where it measures nothing.
    RangeZero, "range-zero", "", NONE, GAP, Nothing,
        Lasting(|f, _| f.drone.range_zero = true);
    /// The autopilot's position jumps to the north, and it counts that.
    PositionReset, "position-reset", "m to the north", [-2.0, 2.0], NONE, Nothing,
        Events(|r, size| r.world.reset_position(0, &(Vector3::x() * size), true), nothing);
    /// The autopilot's position jumps to the north, and it does not count that.
    PositionJump, "position-jump", "m to the north", [-2.0, 2.0], NONE, Nothing,
        Events(|r, size| r.world.reset_position(0, &(Vector3::x() * size), false), nothing);
    /// The autopilot's height jumps, and it counts that.
    HeightReset, "height-reset", "m up", [-2.0, 2.0], NONE, Nothing,
        Events(|r, size| r.world.reset_position(0, &(Vector3::z() * -size), true), nothing);
    /// The autopilot's height jumps, and it does not count that.
    HeightJump, "height-jump", "m up", [-2.0, 2.0], NONE, Nothing,
        Events(|r, size| r.world.reset_position(0, &(Vector3::z() * -size), false), nothing);
    /// The autopilot's heading jumps, and it counts that.
    HeadingReset, "heading-reset", "deg", [-25.0, 25.0], NONE, Nothing,
        Events(|r, size| r.world.reset_heading(0, size.to_radians()), nothing);
    /// The autopilot's position drifts, as under a slow spoof.
    PositionDrifts, "position-drifts", "m/s to the north", [-0.5, 0.5], [2.0, 20.0], Nothing,
        Lasting(|f, size| f.autopilot.drift_mps = size);
    /// The autopilot reports that it stands on the ground.
    LandedReported, "landed-reported", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.autopilot.landed_report = Some(LandedState::OnGround));
    /// It reports that it flies.
    FlightReported, "flight-reported", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.autopilot.landed_report = Some(LandedState::InAir));
    /// The autopilot's clock restarts.
    AutopilotClock, "autopilot-clock", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.linked(0).into_iter().for_each(|l| l.autopilot.restart()), nothing);
    /// A message of the autopilot's is not sent any more.
    StreamStops, "stream-stops", "number of the message", [0.0, 500.0], [0.5, 15.0], Nothing,
        Lasting(|f, size| f.autopilot.muted.push(size as u32));
    /// The autopilot sends nothing.
    AutopilotSilent, "autopilot-silent", "", NONE, [0.2, 5.0], Command,
        Lasting(|f, _| f.autopilot.silent = true);
    /// The cable to it is out, both ways.
    CableOut, "cable-out", "", NONE, [0.2, 5.0], Command,
        Lasting(|f, _| f.autopilot.cut = true);
    /// It denies every command.
    CommandsDenied, "commands-denied", "", NONE, [0.5, 10.0], Command,
        Lasting(|f, _| f.autopilot.answer = Some(CommandResult::TemporarilyRejected));
    /// The drone's battery is as empty as that.
    BatteryAt, "battery-at", "charge, 0 to 1", [0.05, 0.4], NONE, Nothing,
        Events(|r, size| r.world.linked(0).into_iter().for_each(|l| l.autopilot.battery = size.max(0.0)), nothing);
    /// The drone's battery empties fast.
    BatterySags, "battery-sags", "1/s", [0.002, 0.05], [1.0, 20.0], Nothing,
        Lasting(|f, size| f.autopilot.drain_per_s = size.max(0.0));
    /// Gauge and voltage of the battery stay what they were, or toggle between that and more.
    BatteryStuck, "battery-stuck", "toggles by, charge", [-0.02, 0.02], [1.0, 60.0], Nothing,
        Lasting(|f, size| f.autopilot.battery_stuck = Some(size.max(0.0)));
    /// It is an old one, or a smaller: full it flies for so long.
    BatteryAged, "battery-aged", "s", [300.0, 900.0], NONE, Nothing,
        Events(|r, size| r.world.linked(0).into_iter().for_each(|l| l.autopilot.endurance_s = size.max(10.0)), nothing);
    /// It reports no battery, neither charge nor voltage.
    BatteryUnknown, "battery-unknown", "", NONE, [1.0, 60.0], Nothing,
        Lasting(|f, _| f.autopilot.no_battery = true);
    /// The remote control's signal is lost.
    RemoteLost, "remote-lost", "", NONE, [1.0, 20.0], Nothing,
        Lasting(|f, _| f.autopilot.remote_control_lost = true);
    /// A rotor gives less.
    MotorWeak, "motor-weak", "fraction lost", [0.05, 0.3], [1.0, 60.0], Power,
        Lasting(|f, size| f.weak[0] = f.weak[0].max(size));
    /// All rotors do.
    ThrustWeak, "thrust-weak", "fraction lost", [0.05, 0.2], [1.0, 60.0], Power,
        Lasting(|f, size| f.weak[1] = f.weak[1].max(size));
    /// The drone's load falls off.
    PayloadDropped, "payload-dropped", "fraction of its weight", [0.03, 0.2], NONE, Nothing,
        Events(|r, size| r.world.lighten(size), nothing);
    /// The ground station commands the autopilot's hold for so long.
    HeldByStation, "held-by-station", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Hold), |r, _| choose(r, AutopilotMode::Offboard));
    /// It commands a return for so long.
    ReturnedByStation, "returned-by-station", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Return), |r, _| choose(r, AutopilotMode::Offboard));
    /// The pilot takes over for so long, then gives the mode back.
    TakenOver, "taken-over", "", NONE, [0.5, 10.0], Command,
        Events(|r, _| choose(r, AutopilotMode::Other), |r, _| choose(r, AutopilotMode::Offboard));
    /// The operator aborts on the drone's computer.
    Abort, "abort", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.command_to(0, CommandKind::Abort), nothing);
    /// The operator aborts from ashore.
    AbortAshore, "abort-ashore", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.operator_command(0, CommandKind::Abort), nothing);
    /// The operator commands a hold.
    Hold, "hold", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.command_to(0, CommandKind::Hold), nothing);
    /// The operator orders the landing again.
    OrderedAgain, "ordered-again", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.command_to(0, CommandKind::Land), nothing);
    /// The operator orders a landing from ashore.
    OrderedAshore, "ordered-ashore", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.operator_command(0, CommandKind::Land), nothing);
    /// The operator orders another drone than there is.
    OrderedOther, "ordered-other", "", NONE, NONE, Nothing,
        Events(|r, _| r.world.operator_command(7, CommandKind::Land), nothing);
    /// The deck's sensor reports something on it for so long.
    DeckOccupied, "deck-occupied", "", NONE, [1.0, 20.0], Nothing,
        Events(|r, _| occupy(r, true), |r, _| occupy(r, false));
    /// The crew closes the deck for so long.
    DeckClosed, "deck-closed", "", NONE, [1.0, 20.0], Nothing,
        Events(|r, _| r.world.deck_order(DeckOrder::Closed), |r, _| r.world.deck_order(DeckOrder::Open));
    /// The frames of the moving base do not reach the drone's receiver.
    CorrectionsLost, "corrections-lost", "", NONE, [0.5, 30.0], Nothing,
        Lasting(|f, _| f.moving_base.corrections_lost = true);
    /// That receiver has no fix.
    FixLost, "fix-lost", "", NONE, WRONG, Nothing,
        Lasting(|f, _| f.moving_base.fix_lost = true);
    /// A false fix.
    FalseFix, "false-fix", "m", [0.1, 2.0], WRONG, Nothing,
        Lasting(|f, size| f.moving_base.false_fix_m = size);
} } }
pub(super) use each_kind;
each_kind!(names);

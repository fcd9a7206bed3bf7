//! The drone's own state, its plan and its set-point.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    FRACTION, Header, MAX_ACCELERATION_MPS2, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS,
    Reason, Seq, deviations, within,
};
use crate::frames::wrap_angle;
use crate::geodesy::Datum;
use crate::time::{DroneClock, Span, Time};

/// Stages of a plan.
pub const PLAN_STAGES: usize = 41;

/// The drone's odometry as its autopilot gives it.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneState {
    /// Identity and time of validity.
    pub header: Header<DroneClock>,
    /// Counts the frames of `position` (another autopilot, its restart, an origin that moved): with each, what was known in
    /// the one before is void. A jump of the estimate alone makes none (`datum_offset`).
    pub frames: u8,
    /// Origin of the drone's NED: that of its autopilot.
    pub datum: Datum,
    /// Position of `datum` in the frame of `position` now, NED, m. That frame goes on where the autopilot's estimate of its
    /// position jumps, and this takes up the jump: detections stay where they were, what is known by latitude and longitude
    /// (the vessel by radio) moves by it. 0 until the first jump.
    pub datum_offset: [f64; 3],
    /// Sum of the jumps of the autopilot's heading since its first odometry, -pi to pi, rad: `attitude` has them.
    pub heading_jumps: f64,
    /// Centre of mass in the drone's NED, m.
    pub position: [f64; 3],
    /// Velocity in NED, m/s.
    pub velocity: [f64; 3],
    /// Rotation NED from body, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body rates, rad/s.
    pub rates: [f64; 3],
    /// Specific force in the body frame (what accelerometers measure), m/s².
    pub specific_force: [f64; 3],
    /// Horizontal acceleration that is not the rotors', NED, m/s²: wind, and the errors of attitude and accelerometers.
    pub disturbance: [f64; 2],
    /// The true wind apart from the drone's own way, towards north and east, m/s; None until it is known to 3 m/s.
    pub wind: Option<[f64; 2]>,
    /// Standard deviation of the wind along the axis that is known worse, m/s; None until the wind is known.
    pub wind_sd_mps: Option<f64>,
    /// Mean disturbance of the drone while it followed the deck, NED, m/s²: that of the wind and the vessel's way; 0 before.
    pub wind_push: [f64; 2],
    /// Gusts about it: standard deviation of one axis, m/s²; 0 before.
    pub gust_sd: f64,
    /// Standard deviations of `position` (without the common GNSS offset), m.
    pub position_sd: [f64; 3],
    /// Standard deviations of `velocity`, m/s.
    pub velocity_sd: [f64; 3],
    /// Standard deviations of roll, pitch, yaw, rad.
    pub euler_sd: [f64; 3],
}

impl Default for DroneState {
    fn default() -> Self {
        DroneState {
            header: Header::default(),
            frames: 0,
            datum: Datum::default(),
            datum_offset: [0.0; 3],
            heading_jumps: 0.0,
            position: [0.0; 3],
            velocity: [0.0; 3],
            attitude: [1.0, 0.0, 0.0, 0.0],
            rates: [0.0; 3],
            specific_force: [0.0, 0.0, -9.81],
            disturbance: [0.0; 2],
            wind: None,
            wind_sd_mps: None,
            wind_push: [0.0; 2],
            gust_sd: 0.0,
            position_sd: [0.0; 3],
            velocity_sd: [0.0; 3],
            euler_sd: [0.0; 3],
        }
    }
}

impl DroneState {
    /// Position in the drone's NED, m.
    pub fn position(&self) -> Vector3<f64> {
        Vector3::from(self.position)
    }
    /// Position of `datum` in the frame of the position now, m.
    pub fn datum_offset(&self) -> Vector3<f64> {
        Vector3::from(self.datum_offset)
    }
    /// Velocity in NED, m/s.
    pub fn velocity(&self) -> Vector3<f64> {
        Vector3::from(self.velocity)
    }
    /// Rotation NED from body.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        quaternion(&self.attitude)
    }
    /// Horizontal acceleration that is not the rotors', NED, m/s².
    pub fn disturbance(&self) -> Vector2<f64> {
        Vector2::from(self.disturbance)
    }
    /// Distance of the origin from that of the state `before`, m; None: both are in the same frame.
    pub fn origin_moved_m(&self, before: &DroneState) -> Option<f64> {
        let same = (self.frames, self.datum) == (before.frames, before.datum);
        (!same).then(|| before.datum.distance_m(&self.datum))
    }
    /// Roll, pitch, yaw, rad.
    pub fn euler(&self) -> Vector3<f64> {
        let (r, p, y) = self.attitude().euler_angles();
        Vector3::new(r, p, y)
    }
}

/// The unit quaternion of (w, x, y, z); the identity when its norm is useless.
pub(crate) fn quaternion(q: &[f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 1e-9).unwrap_or_default()
}

/// Mode of the autopilot, reduced to what matters for landing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum AutopilotMode {
    /// A person flies, or a mode of the autopilot's own: Alight does not command.
    #[default]
    Other,
    /// PX4 OFFBOARD, ArduCopter GUIDED: set-points are followed.
    Offboard,
    /// The autopilot's own hold, after set-points were lost or by command.
    Hold,
    /// The autopilot lands by itself (its failsafe).
    Land,
    /// The autopilot returns home by itself.
    Return,
}

/// The autopilot's own opinion of where it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum LandedState {
    /// Not known.
    #[default]
    Unknown,
    /// On the ground.
    OnGround,
    /// In the air.
    InAir,
}

/// The autopilot's own mission (PX4 Mission, ArduCopter AUTO).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum OwnMission {
    /// It flies none.
    #[default]
    None,
    /// It flies it.
    Flies,
    /// It has flown all of it, and no other mode was chosen since.
    Done,
}

/// The autopilot's state.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AutopilotState {
    /// Identity and time of validity.
    pub header: Header<DroneClock>,
    /// Motors may turn.
    pub armed: bool,
    /// Mode of the autopilot.
    pub mode: AutopilotMode,
    /// It holds by itself because our set-points ceased, and follows them again as soon as they come; or it held when the link
    /// began, and nothing has shown yet that a pilot chose that. In any other hold it is a pilot's.
    pub lapsed: bool,
    /// State by the autopilot's land detector.
    pub landed: LandedState,
    /// Height of the origin of its NED above mean sea level, as it reports it, m; None: not reported.
    pub origin_sea_m: Option<f64>,
    /// Remaining battery, 0 to 1; None: not reported.
    pub battery: Option<f64>,
    /// Voltage of the battery, V; None: not reported.
    pub battery_v: Option<f64>,
    /// Current of the battery, A; None: not reported.
    pub battery_a: Option<f64>,
    /// Collective thrust that it applies now, 0 to 1 of the maximum; None: not reported lately.
    pub thrust: Option<f64>,
    /// The autopilot's estimate of the collective thrust that hovers, 0 to 1.
    pub hover_thrust: f64,
    /// Why no landing is permitted with it as it is (no origin, a parameter); without a code: it suits.
    pub rejection: Reason,
    /// A parameter that does not suit, but forbids no landing; without a code: all suit.
    pub warning: Reason,
    /// While a pilot flies and nothing is commanded: what would have been.
    pub shadow: Option<ShadowComparison>,
    /// Whether it flies its own mission.
    pub own_mission: OwnMission,
    /// Destination of its return mode, height above mean sea level; None: not reported.
    pub home: Option<Datum>,
}

/// Command of a landing that only looks on, compared with what the pilot does.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ShadowComparison {
    /// Roll and pitch that would be commanded, rad.
    pub tilt: [f64; 2],
    /// Collective thrust, 0 to 1 of the maximum.
    pub thrust: f64,
    /// Velocity, NED, m/s.
    pub velocity: [f64; 3],
    /// It would stop the motors.
    pub stops: bool,
    /// Between the thrust axes that would be commanded and are flown, rad.
    pub apart_rad: f64,
    /// Between the velocities, m/s.
    pub apart_mps: f64,
}

/// Checkpoint of the predictor: the camera's view of the deck against the radio's, which its successor could not
/// find again where the deck is too near to be detected.
///
/// It is published with every forecast once the camera has detected the deck, and validated by the successor before it
/// counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct PredictorCheckpoint {
    /// Identity of the writer and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// Boot of the vessel whose radio it is: another start of it has another error.
    pub vessel_boot: u32,
    /// Newest vision that was fused.
    pub vision_at: Time<DroneClock>,
    /// Newest tag that was fused.
    pub tag_at: Option<Time<DroneClock>>,
    /// Vision's slow error less the radio's: north, east, down (m), tilt about the vessel's pitch and roll axes at
    /// heading north, heading (rad).
    pub offset: [f64; 6],
    /// Standard deviations of the offset.
    pub offset_sd: [f64; 6],
    /// Origin of the drone's NED then: about another place the offset is void.
    pub datum: Datum,
    /// Jumps of the autopilot's estimate until then, as in [`DroneState`]: after another the offset is void.
    pub datum_offset: [f64; 3],
    /// Sum of the jumps of its heading, rad.
    pub heading_jumps: f64,
    /// Place of the drone by its odometry, NED, m: an origin that moves since makes the offset void.
    pub position: [f64; 3],
    /// Velocity of the drone, m/s.
    pub velocity: [f64; 3],
    /// When it was there.
    pub odometry_at: Time<DroneClock>,
}

/// Outcome of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Solve {
    /// Optimal to the solver's tolerance.
    #[default]
    Optimal,
    /// Stopped by the bound on iterations; the iterate is usable.
    IterationLimit,
    /// No input satisfies the hard limits; the plan is the previous one or a hold.
    Infeasible,
}

/// One instant of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct PlanStage {
    /// Centre of mass in the drone's NED, m.
    pub position: [f64; 3],
    /// Velocity, m/s.
    pub velocity: [f64; 3],
    /// Acceleration, m/s².
    pub acceleration: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub euler: [f64; 3],
    /// Euler-angle rates, rad/s.
    pub euler_rates: [f64; 3],
}

/// A trajectory that the pilot samples at its own rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Plan {
    /// Identity; `at` is the time of the first stage.
    pub header: Header<DroneClock>,
    /// Time between stages.
    pub step: Span,
    /// Outcome of the solve.
    pub solve: Solve,
    /// Iterations of the solver; 0 when the unconstrained optimum was feasible.
    pub iterations: u32,
    /// The planner expects the feet on the deck at this time; None when it does not mean to touch.
    pub touchdown_at: Option<Time<DroneClock>>,
    /// Weight of attitude alignment at the first stage (FAA), for display.
    pub alignment: f64,
    /// Horizontal acceleration by other than thrust (wind) that the attitudes allow for, NED, m/s².
    pub disturbance: [f64; 2],
    /// The trajectory.
    pub stages: Seq<PlanStage, PLAN_STAGES>,
}

impl Plan {
    /// The plan at time `t`: position by cubic Hermite, the rest by linear interpolation. After
    /// the last stage that stage is rolled on at constant velocity; None before the first stage or
    /// with fewer than two stages.
    pub fn sample(&self, t: Time<DroneClock>) -> Option<PlanStage> {
        let h = self.step.secs();
        let n = self.stages.len();
        if n < 2 || !(h > 0.0) {
            return None;
        }
        let x = (t - self.header.at).secs() / h;
        if !(x >= -1e-6) {
            return None;
        }
        let x = x.max(0.0);
        let last = (n - 1) as f64;
        if x >= last {
            let mut s = *self.stages.last()?;
            let dt = (x - last) * h;
            for i in 0..3 {
                s.position[i] += s.velocity[i] * dt;
                s.acceleration[i] = 0.0;
                s.euler_rates[i] = 0.0;
            }
            return Some(s);
        }
        let i = x as usize;
        let (a, b, s) = (self.stages.get(i)?, self.stages.get(i + 1)?, x - i as f64);
        let mix = |p: &[f64; 3], q: &[f64; 3]| core::array::from_fn(|k| p[k] + s * (q[k] - p[k]));
        let (s2, s3) = (s * s, s * s * s);
        let position = core::array::from_fn(|k| {
            (2.0 * s3 - 3.0 * s2 + 1.0) * a.position[k]
                + (s3 - 2.0 * s2 + s) * h * a.velocity[k]
                + (3.0 * s2 - 2.0 * s3) * b.position[k]
                + (s3 - s2) * h * b.velocity[k]
        });
        Some(PlanStage {
            position,
            velocity: mix(&a.velocity, &b.velocity),
            acceleration: mix(&a.acceleration, &b.acceleration),
            euler: core::array::from_fn(|k| a.euler[k] + s * wrap_angle(b.euler[k] - a.euler[k])),
            euler_rates: mix(&a.euler_rates, &b.euler_rates),
        })
    }
}

/// Kind of a set-point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum SetPointKind {
    /// Nothing: the autopilot's own behaviour.
    #[default]
    None,
    /// Position, velocity, acceleration and yaw.
    Trajectory,
    /// Attitude with body rates as feed-forward, and thrust.
    Attitude,
}

/// State of the motors that a set-point asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Motors {
    /// Turn.
    #[default]
    Run,
    /// Stop now: touchdown is confirmed.
    Stop,
}

/// Response of the drone's attitude to set-points, `T_r w'(t) + w(t) = (c(t - tau) - x(t)) / T` for roll and for pitch.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AttitudeResponse {
    /// The dead time `tau` from a set-point to the first answer, its way to the autopilot included, s.
    pub dead_time_s: f64,
    /// The time constants `T` of roll and pitch, s.
    pub lag_s: [f64; 2],
    /// The lag `T_r` of the rate loop, s.
    pub rate_lag_s: f64,
    /// It was identified in flight; otherwise it is the configured value.
    pub identified: bool,
}

impl Default for AttitudeResponse {
    fn default() -> Self {
        AttitudeResponse {
            dead_time_s: 0.0,
            lag_s: [0.2; 2],
            rate_lag_s: 0.06,
            identified: false,
        }
    }
}

/// The pilot's set-point to the autopilot.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SetPoint {
    /// Identity and time it is meant for.
    pub header: Header<DroneClock>,
    /// Which of the fields below are to be used.
    pub kind: SetPointKind,
    /// Motors on or off.
    pub motors: Motors,
    /// Position in the drone's NED, m.
    pub position: [f64; 3],
    /// Velocity, m/s.
    pub velocity: [f64; 3],
    /// Acceleration, m/s².
    pub acceleration: [f64; 3],
    /// Heading, rad.
    pub yaw: f64,
    /// Heading rate, rad/s.
    pub yaw_rate: f64,
    /// Rotation NED from body, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body rates, rad/s.
    pub rates: [f64; 3],
    /// Collective thrust, 0 to 1 of the maximum.
    pub thrust: f64,
    /// The response that the pilot counts on.
    pub response: AttitudeResponse,
    /// The hardest contact that was noticed since the motors were last stopped for good, along the deck's normal, m/s;
    /// None: none that was hard.
    pub hard_contact_mps: Option<f64>,
}

impl Default for SetPoint {
    fn default() -> Self {
        SetPoint {
            header: Header::default(),
            kind: SetPointKind::None,
            motors: Motors::Run,
            position: [0.0; 3],
            velocity: [0.0; 3],
            acceleration: [0.0; 3],
            yaw: 0.0,
            yaw_rate: 0.0,
            attitude: [1.0, 0.0, 0.0, 0.0],
            rates: [0.0; 3],
            thrust: 0.0,
            response: AttitudeResponse::default(),
            hard_contact_mps: None,
        }
    }
}
impl SetPoint {
    /// Rotation NED from body.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        quaternion(&self.attitude)
    }
}

/// Whether the norm is 1.
pub(super) fn is_unit(q: &[f64; 4]) -> bool {
    (q.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-3
}

message!(DroneState, DroneClock, |m| {
    m.datum.is_on_earth() => "datum",
    within(&m.datum_offset, MAX_POSITION_M) && within([&m.heading_jumps], MAX_ANGLE_RAD) =>
        "datum_offset or heading_jumps",
    within(&m.position, MAX_POSITION_M) => "position",
    within(&m.velocity, MAX_SPEED_MPS) => "velocity",
    is_unit(&m.attitude) => "attitude",
    within(&m.rates, MAX_RATE_RPS) => "rates",
    within(&m.specific_force, 1e3) => "specific_force",
    within(&m.disturbance, MAX_ACCELERATION_MPS2) => "disturbance",
    m.wind.is_none_or(|w| within(&w, MAX_SPEED_MPS)) => "wind",
    m.wind_sd_mps.is_none_or(|sd| (0.0..=MAX_SPEED_MPS).contains(&sd)) => "wind_sd_mps",
    within(&m.wind_push, MAX_ACCELERATION_MPS2) && (0.0..f64::INFINITY).contains(&m.gust_sd) =>
        "wind_push or gust_sd",
    deviations([&m.position_sd, &m.velocity_sd, &m.euler_sd], 1e4) => "standard deviations",
});
message!(AutopilotState, DroneClock, |m| {
    m.origin_sea_m.is_none_or(|h| h.abs() <= 1e4) => "origin_sea_m",
    m.battery.is_none_or(|b| FRACTION.contains(&b)) => "battery",
    m.battery_v.is_none_or(|v| (0.0..=1e3).contains(&v)) => "battery_v",
    m.battery_a.is_none_or(|a| a.abs() <= 1e4) => "battery_a",
    m.shadow.is_none_or(|s| {
        within(&s.tilt, MAX_ANGLE_RAD)
            && FRACTION.contains(&s.thrust)
            && within(&s.velocity, MAX_SPEED_MPS)
            && within([&s.apart_rad, &s.apart_mps], 2.0 * MAX_SPEED_MPS)
    }) => "shadow",
    m.thrust.is_none_or(|t| FRACTION.contains(&t)) => "thrust",
    FRACTION.contains(&m.hover_thrust) => "hover_thrust",
});
message!(PredictorCheckpoint, DroneClock, |m| {
    m.datum.is_on_earth() => "datum",
    within(&m.datum_offset, MAX_POSITION_M) && within([&m.heading_jumps], MAX_ANGLE_RAD) =>
        "datum_offset or heading_jumps",
    within(&m.offset, MAX_POSITION_M) => "offset",
    m.offset_sd.iter().all(|s| (0.0..=1e3).contains(s)) => "offset_sd",
    within(&m.position, MAX_POSITION_M) && within(&m.velocity, MAX_SPEED_MPS) => "position or velocity",
});
message!(Plan, DroneClock, |m| {
    m.step > Span::ZERO => "step",
    within(&m.disturbance, MAX_ACCELERATION_MPS2) => "disturbance",
    m.stages.iter().all(|s| {
        within(&s.position, MAX_POSITION_M)
            && within(&s.velocity, MAX_SPEED_MPS)
            && within(&s.acceleration, MAX_ACCELERATION_MPS2)
            && within(&s.euler, MAX_ANGLE_RAD)
            && within(&s.euler_rates, MAX_RATE_RPS)
    }) => "stages",
});
message!(SetPoint, DroneClock, |m| {
    within(&m.position, MAX_POSITION_M) && within(&m.velocity, MAX_SPEED_MPS) => "position or velocity",
    within(&m.acceleration, MAX_ACCELERATION_MPS2) && within([&m.yaw, &m.yaw_rate], 50.0) =>
        "acceleration or yaw",
    is_unit(&m.attitude) && within(&m.rates, MAX_RATE_RPS) => "attitude or rates",
    (0.0..=1.0).contains(&m.thrust) => "thrust",
    within([&m.response.dead_time_s, &m.response.rate_lag_s], 2.0) && within(&m.response.lag_s, 2.0) => "response",
    m.hard_contact_mps.is_none_or(|v| (0.0..=MAX_SPEED_MPS).contains(&v)) => "hard_contact_mps",
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origin_of_another_frame() {
        let before = DroneState {
            datum: Datum::new(43.5, 16.3, 12.0),
            ..DroneState::default()
        };
        // A jump of the estimate alone.
        let jumped = DroneState {
            datum_offset: [5.0, 0.0, 0.0],
            position: [5.0, 0.0, 0.0],
            ..before
        };
        assert_eq!(jumped.origin_moved_m(&before), None);
        let restarted = DroneState { frames: 1, ..before };
        assert_eq!(restarted.origin_moved_m(&before), Some(0.0));
        let higher = DroneState {
            datum: Datum::new(43.5, 16.3, 15.0),
            ..before
        };
        let moved_m = higher.origin_moved_m(&before).unwrap();
        assert!((moved_m - 3.0).abs() < 1e-6, "{moved_m}");
    }
}

//! The drone's state, plan and set-point.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    FRACTION, Header, MAX_ACCELERATION_MPS2, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS,
    Reason, Seq, deviations, within,
};
use crate::{
    frames::wrap_angle,
    geodesy::Datum,
    time::{DroneClock, DroneTime, Span},
};

/// Number of stages of a plan.
pub const PLAN_STAGES: usize = 41;

/// Odometry of the drone's autopilot.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneState {
    /// Identity and time of validity.
    pub header: Header<DroneClock>,
    /// Number of the frame of `position`. Another autopilot, its restart or a moved origin increases the
    /// number and invalidates older data; a jump of the estimate (`datum_offset`) does not.
    pub frames: u8,
    /// Origin of the drone's NED: the autopilot's origin.
    pub datum: Datum,
    /// Position of `datum` in the frame of `position`, NED, m; 0 until the autopilot's position estimate
    /// jumps. `position` stays continuous: this offset absorbs the jump, so that detections keep their
    /// coordinates, while positions given by latitude and longitude (the vessel by radio) move.
    pub datum_offset: [f64; 3],
    /// Sum of the jumps of the autopilot's heading since its first odometry, -pi to pi, rad; included in `attitude`.
    pub heading_jumps: f64,
    /// Centre of mass in the drone's NED, m.
    pub position: [f64; 3],
    /// Velocity in NED, m/s.
    pub velocity: [f64; 3],
    /// Rotation NED from body, unit quaternion (w, x, y, z).
    pub attitude: [f64; 4],
    /// Body rates, rad/s.
    pub rates: [f64; 3],
    /// Specific force in the body frame (accelerometer measurement), m/s².
    pub specific_force: [f64; 3],
    /// Horizontal acceleration not caused by the rotors, NED, m/s²: wind, and errors of attitude and accelerometers.
    pub disturbance: [f64; 2],
    /// True wind, separated from airspeed, north and east, m/s; None until known to within 3 m/s.
    pub wind: Option<[f64; 2]>,
    /// Standard deviation of the wind on its less certain axis, m/s; None until the wind is known.
    pub wind_sd_mps: Option<f64>,
    /// Greatest speed of the wind in the last 5 to 10 min, m/s; None until the wind is known.
    pub gust_mps: Option<f64>,
    /// Mean disturbance while the drone followed the deck, NED, m/s², from wind and the vessel's speed; 0 before.
    pub wind_push: [f64; 2],
    /// Standard deviation of gusts about `wind_push` on one axis, m/s²; 0 before.
    pub gust_sd: f64,
    /// Standard deviations of `position` without the common GNSS offset, m.
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
            gust_mps: None,
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
    /// Position of `datum` in the frame of `position`, m.
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
    /// Horizontal acceleration not caused by the rotors, NED, m/s².
    pub fn disturbance(&self) -> Vector2<f64> {
        Vector2::from(self.disturbance)
    }
    /// Distance between the origins of this state and of `before`, m; None: both are in the same frame.
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

/// Unit quaternion from (w, x, y, z); the identity if its norm is invalid.
pub(crate) fn quaternion(q: &[f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::try_new(Quaternion::new(q[0], q[1], q[2], q[3]), 1e-9).unwrap_or_default()
}

/// Mode of the autopilot, as far as a landing depends on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum AutopilotMode {
    /// Flown by a pilot or by another autopilot mode: Alight sends no commands.
    #[default]
    Other,
    /// PX4 OFFBOARD or ArduCopter GUIDED: set-points are followed.
    Offboard,
    /// The autopilot's hold, by command or after set-point loss.
    Hold,
    /// The autopilot lands by itself (failsafe).
    Land,
    /// The autopilot returns home by itself.
    Return,
}

/// State reported by the autopilot's land detector.
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
    /// No mission in progress.
    #[default]
    None,
    /// Mission in progress.
    Flies,
    /// Mission completed, and no other mode chosen since.
    Done,
    /// Return or landing that Alight has commanded on low battery, and no other mode chosen since.
    SentAway,
}

/// State of the autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AutopilotState {
    /// Identity and time of validity.
    pub header: Header<DroneClock>,
    /// The motors may turn.
    pub armed: bool,
    /// Mode of the autopilot.
    pub mode: AutopilotMode,
    /// The autopilot holds because of set-point loss and follows set-points as soon as they return, or it was in hold
    /// when the link started and nothing shows that a pilot chose it. Any other hold belongs to a pilot.
    pub set_points_lost: bool,
    /// State reported by the autopilot's land detector.
    pub landed: LandedState,
    /// Height of the NED origin above mean sea level, as reported, m; None: not reported.
    pub origin_sea_m: Option<f64>,
    /// Remaining battery, 0 to 1; None: not reported.
    pub battery: Option<f64>,
    /// Voltage of the battery, V; None: not reported.
    pub battery_v: Option<f64>,
    /// Current of the battery, A; None: not reported.
    pub battery_a: Option<f64>,
    /// Charge drawn since the autopilot's start, Ah; None: not reported.
    pub battery_used_ah: Option<f64>,
    /// Collective thrust applied now, 0 to 1 of the maximum; None: not reported recently.
    pub thrust: Option<f64>,
    /// Collective thrust at hover as estimated by the autopilot, 0 to 1.
    pub hover_thrust: f64,
    /// Reason why the autopilot's state prevents a landing (no origin, a parameter); its code is
    /// `ReasonCode::None` if a landing is permitted.
    pub rejection: Reason,
    /// Unsuitable parameter that does not prevent a landing; `ReasonCode::None` if all are suitable.
    pub warning: Reason,
    /// Set-point that would be commanded, compared with the pilot's flight in shadow mode.
    pub shadow: Option<ShadowComparison>,
    /// Progress of the autopilot's own mission.
    pub own_mission: OwnMission,
    /// Destination of the return mode, height above mean sea level; None: not reported.
    pub home: Option<Datum>,
}

/// Computed set-point of a landing in shadow mode, compared with the pilot's flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ShadowComparison {
    /// Computed roll and pitch, rad.
    pub tilt: [f64; 2],
    /// Computed collective thrust, 0 to 1 of the maximum.
    pub thrust: f64,
    /// Computed velocity, NED, m/s.
    pub velocity: [f64; 3],
    /// A landing would stop the motors now.
    pub stops: bool,
    /// Angle between the computed and the actual thrust axis, rad.
    pub apart_rad: f64,
    /// Difference between the computed and the actual velocity, m/s.
    pub apart_mps: f64,
}

/// Checkpoint of the predictor: offset between the deck's pose by camera and by radio, which a restarted
/// process cannot measure if it is too close to the deck.
///
/// Published with every forecast once the camera has detected the deck. The restarted process validates it before use.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct PredictorCheckpoint {
    /// Identity and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// Boot id of the vessel received by radio. After its restart, the error of its radio position differs.
    pub vessel_boot: u32,
    /// Newest fused vision measurement.
    pub vision_at: DroneTime,
    /// Newest fused tag detection.
    pub tag_at: Option<DroneTime>,
    /// Slowly varying error of vision minus radio: north, east, down (m), tilt about the pitch and roll axes of a
    /// vessel that heads north, heading (rad).
    pub offset: [f64; 6],
    /// Standard deviations of the offset.
    pub offset_sd: [f64; 6],
    /// Origin of the drone's NED; another origin invalidates the offset.
    pub datum: Datum,
    /// Accumulated jumps of the autopilot's estimate, as in [`DroneState`]; a further jump invalidates the offset.
    pub datum_offset: [f64; 3],
    /// Sum of the heading jumps, rad.
    pub heading_jumps: f64,
    /// Position of the drone by odometry, NED, m. A moved origin shows as a jump and invalidates the offset.
    pub position: [f64; 3],
    /// Velocity of the drone, m/s.
    pub velocity: [f64; 3],
    /// Time of this odometry.
    pub odometry_at: DroneTime,
}

/// Outcome of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Solve {
    /// Optimal to the solver's tolerance.
    #[default]
    Optimal,
    /// Stopped at the iteration limit; the iterate is usable.
    IterationLimit,
    /// No input satisfies the hard limits; the plan is the previous one or a hold.
    Infeasible,
}

/// State of the drone at one time of a plan.
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

/// Trajectory that the pilot samples at its own rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Plan {
    /// Identity; `at` is the time of the first stage.
    pub header: Header<DroneClock>,
    /// Time between stages.
    pub step: Span,
    /// Outcome of the solve.
    pub solve: Solve,
    /// Iterations of the solver; 0 if the unconstrained optimum was feasible.
    pub iterations: u32,
    /// Predicted time at which the feet meet the deck; None: no touchdown is planned.
    pub touchdown_at: Option<DroneTime>,
    /// Weight of Forcing Attitude Alignment at the first stage, for display.
    pub alignment: f64,
    /// Horizontal disturbance acceleration (wind) compensated by the attitudes, NED, m/s².
    pub disturbance: [f64; 2],
    /// Stages at intervals of `step`.
    pub stages: Seq<PlanStage, PLAN_STAGES>,
}

impl Plan {
    /// State of the plan at time `t`: cubic Hermite interpolation of position, linear for the rest, constant
    /// velocity beyond the last stage. None before the first stage, or with fewer than two.
    pub fn sample(&self, t: DroneTime) -> Option<PlanStage> {
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
        let a = self.stages.get(i)?;
        let b = self.stages.get(i + 1)?;
        let s = x - i as f64;
        let mix = |p: &[f64; 3], q: &[f64; 3]| core::array::from_fn(|k| p[k] + s * (q[k] - p[k]));
        let s2 = s * s;
        let s3 = s * s * s;
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

/// Check of a plan by the pilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum PlanCheck {
    /// Speed of a stage or between stages, m/s.
    #[default]
    Speed,
    /// Acceleration or thrust per mass of a stage, or the wind that it compensates, m/s².
    Acceleration,
    /// Tilt of a stage, rad.
    Tilt,
    /// Euler rates of a stage, rad/s.
    Rates,
    /// Time until the first stage, s.
    Start,
    /// Distance from the drone, m.
    Position,
    /// Difference from the drone's velocity, m/s.
    Velocity,
    /// Speed towards the deck, m/s.
    Deck,
    /// Speed towards a deck that the mission does not permit to touch, m/s.
    Permission,
    /// Speed towards the deck's plane with the feet beside the deck, m/s.
    Outside,
    /// Speed towards the deck at an angle to it, m/s.
    Tilted,
    /// Speed towards the deck while moving along it, m/s.
    Along,
    /// Distance in which the drone stops in front of a keep-out volume, m.
    Obstacle,
    /// Speed towards the water, m/s.
    Water,
}

/// Reason why a plan is not flown.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct PlanRefusal {
    /// Check that the plan has not passed.
    pub check: PlanCheck,
    /// Value, in the unit of the check.
    pub value: f64,
    /// Its limit.
    pub limit: f64,
}

impl core::fmt::Display for PlanRefusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let what = match self.check {
            PlanCheck::Speed => "its speed is",
            PlanCheck::Acceleration => "its acceleration is",
            PlanCheck::Tilt => "its tilt is",
            PlanCheck::Rates => "its Euler rates are",
            PlanCheck::Start => "its first stage begins in",
            PlanCheck::Position => "its distance from the drone is",
            PlanCheck::Velocity => "its difference from the drone's velocity is",
            PlanCheck::Deck => "its speed towards the deck is",
            PlanCheck::Permission => "without permission to land its speed towards the deck is",
            PlanCheck::Outside => "with the feet beside the deck its speed downwards is",
            PlanCheck::Tilted => "with a tilt other than the deck's its speed towards the deck is",
            PlanCheck::Along => "while it moves along the deck its speed towards the deck is",
            PlanCheck::Obstacle => "the distance in which it stops in front of a keep-out volume is",
            PlanCheck::Water => "its speed towards the water is",
        };
        write!(f, "{what} {:.2}, at most {:.2} is flown", self.value, self.limit)
    }
}

/// Kind of a set-point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum SetPointKind {
    /// No set-point: the autopilot flies its own mode.
    #[default]
    None,
    /// Position, velocity, acceleration and yaw.
    Trajectory,
    /// Attitude with body rates as feed-forward, and thrust.
    Attitude,
}

/// Commanded state of the motors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Motors {
    /// Motors turn.
    #[default]
    Run,
    /// Stop now: touchdown is confirmed.
    Stop,
}

/// Response of the drone's attitude to set-points, `T_r w'(t) + w(t) = (c(t - tau) - x(t)) / T` for roll and for pitch.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct AttitudeResponse {
    /// Dead time `tau` from a set-point to the first response, including transport to the autopilot, s.
    pub dead_time_s: f64,
    /// Time constants `T` of roll and pitch, s.
    pub lag_s: [f64; 2],
    /// Time constant `T_r` of the rate loop, s.
    pub rate_lag_s: f64,
    /// Identified in flight; otherwise the configured values.
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

/// Set-point from the pilot node to the autopilot.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SetPoint {
    /// Identity and time at which it applies.
    pub header: Header<DroneClock>,
    /// Kind of set-point: selects the fields below.
    pub kind: SetPointKind,
    /// Commanded state of the motors.
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
    /// Attitude response that the pilot node assumes.
    pub response: AttitudeResponse,
    /// Speed along the deck's normal of the hardest contact since the motors last stopped on the deck, m/s.
    pub hard_contact_mps: Option<f64>,
    /// Reason why the newest plan is not flown; None if it is, or without a plan.
    pub plan_refusal: Option<PlanRefusal>,
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
            plan_refusal: None,
        }
    }
}
impl SetPoint {
    /// Rotation NED from body.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        quaternion(&self.attitude)
    }
}

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
    m.gust_mps.is_none_or(|g| (0.0..f64::INFINITY).contains(&g)) => "gust_mps",
    within(&m.wind_push, MAX_ACCELERATION_MPS2) && (0.0..f64::INFINITY).contains(&m.gust_sd) =>
        "wind_push or gust_sd",
    deviations([&m.position_sd, &m.velocity_sd, &m.euler_sd], 1e4) => "standard deviations",
});
message!(AutopilotState, DroneClock, |m| {
    m.origin_sea_m.is_none_or(|h| h.abs() <= 1e4) => "origin_sea_m",
    m.battery.is_none_or(|b| FRACTION.contains(&b)) => "battery",
    m.battery_v.is_none_or(|v| (0.0..=1e3).contains(&v)) => "battery_v",
    m.battery_a.is_none_or(|a| a.abs() <= 1e4) => "battery_a",
    m.battery_used_ah.is_none_or(|q| (0.0..=1e6).contains(&q)) => "battery_used_ah",
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
        // The estimate jumps, and the origin stays.
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

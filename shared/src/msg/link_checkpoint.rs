//! Checkpoint of the link to the autopilot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    FRACTION, Header, LandedState, LandingMode, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_SPEED_MPS, deviations,
    within,
};
use crate::geodesy::Datum;
use crate::mavlink::SigningTimes;
use crate::time::DroneClock;

/// Checkpoint of the link to the autopilot: a successor goes on commanding before the autopilot's own failsafe begins.
///
/// It is published 50 times a second, and validated by the successor before it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LinkCheckpoint {
    /// Identity of the writer and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// The autopilot follows our set-points: armed, and in the mode that a pilot gave.
    pub commanding: bool,
    /// The vehicle's MAVLink system.
    pub vehicle: u8,
    /// `MAV_AUTOPILOT` of the autopilot.
    pub autopilot: u8,
    /// Landing mode of the mission, by its newest state; None: no state was received.
    pub mode: Option<LandingMode>,
    /// State by the autopilot's land detector.
    pub landed: LandedState,
    /// Our clock less the autopilot's, ns.
    pub clock_offset_ns: i64,
    /// By how much that errs at most, s.
    pub clock_error_s: f64,
    /// Origin of its NED.
    pub datum: Datum,
    /// Height of the sea above the ellipsoid by which it was found, m.
    pub geoid_m: f64,
    /// [`DroneState::frames`](super::DroneState::frames).
    pub frames: u8,
    /// Jumps of its estimate as it counts them, where it does.
    pub reported_resets: Option<u8>,
    /// Sum of the jumps of its estimate: [`DroneState::datum_offset`](super::DroneState::datum_offset), m, and ...
    pub datum_offset: [f64; 3],
    /// ... [`DroneState::heading_jumps`](super::DroneState::heading_jumps), rad.
    pub heading_jumps: f64,
    /// Smooth odometry less the autopilot's: position (m) and velocity (m/s), NED; the bias of its acceleration, m/s²; and
    /// the disturbance, m/s², its third component 0.
    pub smoothing: [[f64; 3]; 4],
    /// The wind as it has learnt it.
    pub wind: WindCheckpoint,
    /// Collective thrust that hovers, 0 to 1.
    pub hover_thrust: f64,
    /// For so long it was identified, s.
    pub hover_learned_s: f64,
    /// It has ended the autopilot's own mission in this flight, by the battery, because it was done, by an order: who chooses
    /// that again has it.
    pub ended_missions: [bool; 3],
    /// The times of its signed frames.
    pub signing: SigningTimes,
    /// In this flight the autopilot has flown its own mission, and no other mode was chosen since.
    pub own_mission: bool,
}

/// Wind and drag that odometry has shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct WindCheckpoint {
    /// Logarithm of the drag per mass in 1/m; mean wind and gust, north and east, m/s; None before the first sample.
    pub state: Option<[f64; 5]>,
    /// Covariance of the state.
    pub covariance: [[f64; 5]; 5],
    /// The drone has followed the deck for so long, s, ...
    pub known_s: f64,
    /// ... at this mean velocity, NED, m/s, ...
    pub way: [f64; 2],
    /// ... with this mean disturbance, NED, m/s², ...
    pub mean: [f64; 2],
    /// ... whose variance along one axis is this, (m/s²)².
    pub variance: f64,
}

impl WindCheckpoint {
    fn is_sane(&self) -> bool {
        let learnt = self
            .state
            .iter()
            .flatten()
            .chain(self.covariance.iter().flatten());
        within(learnt.chain(&self.way).chain(&self.mean), 1e4)
            && deviations([&[self.known_s, self.variance]], 1e4)
    }
}

impl LinkCheckpoint {
    /// Part that outlives the computer's boot, and with that its clock; None: nothing.
    pub fn lasting(&self) -> Option<LinkCheckpoint> {
        let signed = self.signing != SigningTimes::default();
        let lasts = signed || self.own_mission || self.ended_missions.contains(&true);
        lasts.then(|| LinkCheckpoint {
            header: self.header.outdated(),
            mode: self.mode,
            ended_missions: self.ended_missions,
            own_mission: self.own_mission,
            signing: self.signing,
            ..LinkCheckpoint::default()
        })
    }
}

message!(LinkCheckpoint, DroneClock, |m| {
    within([&m.geoid_m], 1e3) => "geoid_m",
    (0.0..=1.0).contains(&m.clock_error_s) => "clock_error_s",
    m.datum.is_on_earth() => "datum",
    within(&m.datum_offset, MAX_POSITION_M) && within([&m.heading_jumps], MAX_ANGLE_RAD) =>
        "datum_offset or heading_jumps",
    m.smoothing.iter().all(|s| within(s, MAX_SPEED_MPS)) => "smoothing",
    m.wind.is_sane() => "wind",
    FRACTION.contains(&m.hover_thrust) && m.hover_learned_s >= 0.0 => "hover_thrust or hover_learned_s",
});

//! Checkpoint of the link to the autopilot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    FRACTION, Header, LandedState, LandingMode, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_SPEED_MPS, deviations,
    within,
};
use crate::{geodesy::Datum, mavlink::SigningTimes, time::DroneClock};

/// Checkpoint of the autopilot link, with which a restarted process sends set-points before the autopilot's failsafe acts.
///
/// Published at 50 Hz. The restarted process validates it before use.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LinkCheckpoint {
    /// Identity and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// The autopilot follows our set-points: it is armed and in the mode chosen by a pilot.
    pub commanding: bool,
    /// MAVLink system of the vehicle.
    pub vehicle: u8,
    /// `MAV_AUTOPILOT` of the autopilot.
    pub autopilot: u8,
    /// Landing mode in the mission's newest state; None: no state received.
    pub mode: Option<LandingMode>,
    /// State reported by the autopilot's land detector.
    pub landed: LandedState,
    /// Our clock minus the autopilot's, ns.
    pub clock_offset_ns: i64,
    /// Error bound of `clock_offset_ns`, s.
    pub clock_error_s: f64,
    /// Origin of the autopilot's NED.
    pub datum: Datum,
    /// Geoid height above the ellipsoid used to determine `datum`, m.
    pub geoid_m: f64,
    /// [`DroneState::frames`](super::DroneState::frames).
    pub frames: u8,
    /// Number of estimate jumps counted by the autopilot, if it reports one.
    pub reported_resets: Option<u8>,
    /// Sum of the position jumps of its estimate: [`DroneState::datum_offset`](super::DroneState::datum_offset), m.
    pub datum_offset: [f64; 3],
    /// Sum of the heading jumps: [`DroneState::heading_jumps`](super::DroneState::heading_jumps), rad.
    pub heading_jumps: f64,
    /// Smoothed minus reported odometry: position (m), velocity (m/s), NED; bias of the acceleration, m/s²;
    /// disturbance, m/s², with a third component of 0.
    pub smoothing: [[f64; 3]; 4],
    /// Identified wind and drag.
    pub wind: WindCheckpoint,
    /// Collective thrust at hover, 0 to 1.
    pub hover_thrust: f64,
    /// Duration of the hover-thrust identification, s.
    pub hover_learned_s: f64,
    /// Reasons for which this process ended the autopilot's mission in this flight: battery, completion,
    /// order. The same reason does not end it again if a pilot selects it.
    pub ended_missions: [bool; 4],
    /// Times of the signed frames.
    pub signing: SigningTimes,
    /// The autopilot has flown its own mission in this flight, and no other mode was chosen since.
    pub own_mission: bool,
}

/// Wind and drag identified from odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct WindCheckpoint {
    /// Logarithm of drag per mass in 1/m; mean wind and gust, north and east, m/s; None before the first sample.
    pub state: Option<[f64; 5]>,
    /// Covariance of `state`.
    pub covariance: [[f64; 5]; 5],
    /// Time during which the drone has followed the deck, s.
    pub known_s: f64,
    /// Mean velocity during `known_s`, NED, m/s.
    pub way: [f64; 2],
    /// Mean disturbance during `known_s`, NED, m/s².
    pub mean: [f64; 2],
    /// Variance of the disturbance on one axis, (m/s²)².
    pub variance: f64,
    /// Greatest wind speeds of the previous and the present span, m/s, and the age of the latter, s.
    pub gusts: [f64; 3],
}

impl WindCheckpoint {
    fn is_sane(&self) -> bool {
        let learnt = self
            .state
            .iter()
            .flatten()
            .chain(self.covariance.iter().flatten());
        within(learnt.chain(&self.way).chain(&self.mean).chain(&self.gusts), 1e4)
            && deviations([&[self.known_s, self.variance]], 1e4)
    }
}

impl LinkCheckpoint {
    /// Part that remains valid across a reboot, which resets the computer's clock; None if nothing does.
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

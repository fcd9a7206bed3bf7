//! Trace of a trial for plots and recordings, from the truth.

/// One instant.
#[derive(Clone, Copy, Debug, Default)]
pub struct TracePoint {
    /// Time since the start, s.
    pub t_s: f64,
    /// Drone's centre of mass, true NED, m.
    pub drone: [f64; 3],
    /// Deck centre, true NED, m.
    pub deck: [f64; 3],
    /// Drone's velocity, m/s.
    pub drone_velocity: [f64; 3],
    /// Deck centre's velocity, m/s.
    pub deck_velocity: [f64; 3],
    /// Drone's roll, pitch, yaw, rad.
    pub drone_euler: [f64; 3],
    /// Deck's roll, pitch, yaw, rad.
    pub deck_euler: [f64; 3],
    /// Clearance of the lowest foot above the deck plane, m.
    pub clearance_m: f64,
}

/// A trial's history and its landmarks.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Time between points, s.
    pub step_s: f64,
    /// The points.
    pub points: Vec<TracePoint>,
    /// Mission states as they began: time since start, name, reason.
    pub phases: Vec<(f64, &'static str, String)>,
    /// Time of first contact, s.
    pub touchdown_s: Option<f64>,
}

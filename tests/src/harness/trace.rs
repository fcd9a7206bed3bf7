//! Trace of a landing for plots.

#[derive(Clone, Copy, Debug, Default)]
pub struct TracePoint {
    pub t_s: f64,
    /// Centre of mass, NED, m.
    pub drone: [f64; 3],
    /// Deck centre, NED, m.
    pub deck: [f64; 3],
    pub drone_velocity: [f64; 3],
    pub deck_velocity: [f64; 3],
    pub deck_yaw: f64,
    /// Feet's centroid relative to the deck centre: forward, starboard, up from the deck's plane, m.
    pub displacement: [f64; 3],
    /// Attitude relative to the deck's axes: roll, pitch, yaw, rad.
    pub relative_euler: [f64; 3],
}

#[derive(Clone, Debug, Default)]
pub struct Trace {
    pub step_s: f64,
    pub points: Vec<TracePoint>,
    /// Time of first contact, s; None if the drone did not land.
    pub touchdown_s: Option<f64>,
}

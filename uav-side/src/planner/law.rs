//! Interface of a planner's law. Start, references, model, solver and message are common to all laws.

use alight_shared::{
    msg::{DeckForecast, DroneState, MissionState, Plan},
    time::{DroneClock, Time},
};
use nalgebra::{Vector2, Vector3};

pub use super::view::View;
use super::{
    model::{ModelState, state, up_of},
    mpc_faa::Problem,
    reference::{PlanReference, ReferenceGenerator},
};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LandingStart {
    pub measured: bool,
    /// Time constant with which later plans approach the drone's position and velocity, s. Their start is also limited
    /// in height above the drone and in sink rate by [`super::config::Reset`]. None: plans continue regardless of the
    /// drone.
    pub approach_time_s: Option<f64>,
}

/// Law of a planner. The default methods plan as in the paper, without attitude alignment.
pub trait Law: core::fmt::Debug + Send {
    /// Processes new odometry, the newest forecast, and the last plan's reference.
    fn observe(
        &mut self,
        _drone: Option<&DroneState>,
        _forecast: Option<&DeckForecast>,
        _last: &PlanReference,
    ) {
    }
    /// Wind that plans allow for, as an acceleration, m/s². If it is not zero, the tilt in a state represents the
    /// resulting acceleration; otherwise it is the tilt of the body.
    fn wind(&self) -> Vector2<f64> {
        Vector2::zeros()
    }
    fn landing_start(&self) -> LandingStart {
        LandingStart::default()
    }
    /// Whether [`Law::own_plan`] must restart at the common planner's start.
    fn begins(
        &self,
        _now: Time<DroneClock>,
        _mission: &MissionState,
        _forecast: Option<&DeckForecast>,
        _drone: Option<&DroneState>,
    ) -> bool {
        false
    }
    /// Plan from the law's own model and solver, restarted at `start` (state, and vertical acceleration in NED, m/s²)
    /// if given.
    fn own_plan(
        &mut self,
        _now: Time<DroneClock>,
        _mission: &MissionState,
        _forecast: Option<&DeckForecast>,
        _start: Option<(ModelState, f64)>,
    ) -> Option<Plan> {
        None
    }
    /// Whether there is no plan when [`Law::own_plan`] returns none; otherwise the common planner takes over.
    fn plans_alone(&self) -> bool {
        false
    }
    /// Replaces permission and deck in the view; the plan starts at `start`.
    fn limit(&mut self, _now: Time<DroneClock>, _start: &ModelState, _view: &mut View) {}
    /// Replaces references and weights. Returns the planned time to contact, s.
    fn refine(
        &mut self,
        _now: Time<DroneClock>,
        _view: &View,
        _generator: &ReferenceGenerator,
        _problem: &mut Problem,
        _reference: &mut PlanReference,
    ) -> Option<f64> {
        None
    }
    /// Upward axis of the body (NED) for a state and vertical acceleration (NED, m/s²), and the factor on tilt rates.
    fn attitude(&self, state: &ModelState, _vertical: f64) -> (Vector3<f64>, f64) {
        (up_of(state[state::PHI], state[state::THETA]), 1.0)
    }
}

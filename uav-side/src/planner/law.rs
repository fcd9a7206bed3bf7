//! Interface of a planner's law. The start of a plan, the references of each mission state, the model, its solver and
//! the message are common to all laws.

use alight_shared::msg::{DeckForecast, DroneState, MissionState, Plan};
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

use super::model::{ModelState, state, up_of};
use super::mpc_faa::Problem;
use super::reference::{PlanReference, ReferenceGenerator};
pub use super::view::View;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LandingStart {
    /// Whether the first plan of a landing starts from the measured state.
    pub measured: bool,
    /// Time constant with which the position and velocity of each later plan approach the drone's, s; the plan also
    /// starts no higher above the drone and sinks no slower than [`super::config::Reset`] allows. None if plans
    /// continue regardless of the drone.
    pub approach_time_s: Option<f64>,
}

/// Law of a planner. The default methods are those of the paper's planner without attitude alignment.
pub trait Law: core::fmt::Debug + Send {
    /// Processes new odometry, the newest forecast, and the last plan's reference.
    fn observe(
        &mut self,
        _drone: Option<&DroneState>,
        _forecast: Option<&DeckForecast>,
        _last: &PlanReference,
    ) {
    }
    /// Wind that plans allow for, as an acceleration, m/s². If it is not zero, the tilt in a state stands for the
    /// acceleration that results in this wind; otherwise it is the tilt of the body.
    fn wind(&self) -> Vector2<f64> {
        Vector2::zeros()
    }
    fn landing_start(&self) -> LandingStart {
        LandingStart::default()
    }
    /// Whether the law's own plan ([`Law::own_plan`]) has to restart at the common planner's start.
    fn begins(
        &self,
        _now: Time<DroneClock>,
        _mission: &MissionState,
        _forecast: Option<&DeckForecast>,
        _drone: Option<&DroneState>,
    ) -> bool {
        false
    }
    /// A plan by the law's own model and solver, restarted at `start` (state, and vertical acceleration in NED, m/s²)
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
    /// Replaces permission and deck in the view by those that the law plans with; the plan starts at `start`.
    fn limit(&mut self, _now: Time<DroneClock>, _start: &ModelState, _view: &mut View) {}
    /// Replaces references and weights; returns the time to contact if one is planned, s.
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
    /// Upward axis of the body in NED for a planned state and vertical acceleration (NED, m/s²), and the factor on the
    /// rates of tilt.
    fn attitude(&self, state: &ModelState, _vertical: f64) -> (Vector3<f64>, f64) {
        (up_of(state[state::PHI], state[state::THETA]), 1.0)
    }
}

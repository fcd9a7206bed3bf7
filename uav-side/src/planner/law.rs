//! Planner-specific steps. All else is common: the start of a plan, the references of each mission state, the
//! model, its solver and the message.

use alight_shared::msg::{DeckForecast, DroneState, MissionState, Plan};
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

use super::model::{ModelState, state, up_of};
use super::mpc_faa::Problem;
use super::reference::{PlanReference, ReferenceGenerator};
pub use super::view::View;

/// Start of the plans of a landing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LandingStart {
    /// The first one at the measured state.
    pub measured: bool,
    /// Each one no higher above the drone, and sinking no slower, than the limits of
    /// [`super::config::Reset`] allow; in place and velocity it yields to the drone's with this time constant, s.
    pub not_behind: Option<f64>,
}

/// The law of a planner. The defaults are those of the paper's planner without attitude alignment.
pub trait Law: core::fmt::Debug + Send {
    /// Learns from odometry when it is new, from the newest forecast, and from the last plan's reference.
    fn observe(
        &mut self,
        _drone: Option<&DroneState>,
        _forecast: Option<&DeckForecast>,
        _last: &PlanReference,
    ) {
    }
    /// The wind that plans allow for, as its acceleration, m/s². Where there is one, a state's tilt is the
    /// acceleration that it causes in this wind, else the tilt of the body.
    fn wind(&self) -> Vector2<f64> {
        Vector2::zeros()
    }
    /// Start of the plans of a landing.
    fn landing_start(&self) -> LandingStart {
        LandingStart::default()
    }
    /// Whether a plan of the law's own restarts, at the common planner's start.
    fn begins(
        &self,
        _now: Time<DroneClock>,
        _mission: &MissionState,
        _forecast: Option<&DeckForecast>,
        _drone: Option<&DroneState>,
    ) -> bool {
        false
    }
    /// A plan by a model and solver of the law's own, restarting at `start` (state, and vertical
    /// acceleration in NED, m/s²) if one is given.
    fn own_plan(
        &mut self,
        _now: Time<DroneClock>,
        _mission: &MissionState,
        _forecast: Option<&DeckForecast>,
        _start: Option<(ModelState, f64)>,
    ) -> Option<Plan> {
        None
    }
    /// Replaces permission and deck by those that the law plans with; the plan begins at `start`.
    fn limit(&mut self, _now: Time<DroneClock>, _start: &ModelState, _view: &mut View) {}
    /// Replaces references and weights; gives the time to the contact if one is planned, s.
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
    /// Upward axis of the body in NED for a planned state and vertical acceleration (NED, m/s²), and the factor by
    /// which rates of tilt grow.
    fn attitude(&self, state: &ModelState, _vertical: f64) -> (Vector3<f64>, f64) {
        (up_of(state[state::PHI], state[state::THETA]), 1.0)
    }
}

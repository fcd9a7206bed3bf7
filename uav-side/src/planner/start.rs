//! Start of a plan: the current point of the previous plan, or the measured state.

use alight_shared::{
    estimation::low_pass_gain,
    frames::wrap_angle,
    geometry::GRAVITY,
    msg::DroneState,
    time::{DroneClock, Time},
};
use nalgebra::Vector2;

use super::{
    config::Reset,
    law::LandingStart,
    model::{INPUTS, ModelState, measured_state, state},
    mpc_faa::{Mpc, Solution},
};

#[derive(Clone, Debug)]
pub(super) struct SolvedPlan {
    pub at: Time<DroneClock>,
    pub start: ModelState,
    pub solution: Solution,
}

impl SolvedPlan {
    /// Exact state and input at `t`: whole stages from the solver's states, the remainder from the discretised model.
    /// Before the plan begins, its start; after its end the drone continues level at constant velocity.
    pub fn sample(&self, t: Time<DroneClock>, mpc: &Mpc) -> (ModelState, [f64; INPUTS]) {
        let step = mpc.step_s();
        let x = (t - self.at).secs().max(0.0) / step;
        let k = (x + 1e-6).floor() as usize;
        let rest = ((x - k as f64) * step).max(0.0);
        let from = match k.checked_sub(1) {
            None => Some(self.start),
            Some(i) => self.solution.states.get(i).copied(),
        };
        match (from, self.solution.inputs.get(k)) {
            (Some(state), Some(input)) if rest > 1e-6 => (mpc.roll(&state, input, rest), *input),
            (Some(state), Some(input)) => (state, *input),
            _ => {
                let mut s = self.solution.states.last().copied().unwrap_or(self.start);
                let beyond = (x - self.solution.states.len() as f64) * step;
                for i in 0..3 {
                    s[i] += s[state::V_NORTH + i] * beyond;
                }
                for i in [
                    state::PHI,
                    state::THETA,
                    state::PHI_DOT,
                    state::THETA_DOT,
                    state::PSI_DOT,
                ] {
                    s[i] = 0.0;
                }
                (s, [0.0; INPUTS])
            }
        }
    }
}

pub(super) struct PlanStart {
    pub state: ModelState,
    pub input: [f64; INPUTS],
    pub measured: bool,
}

/// Start of the plan that follows `previous`, for a drone with this odometry in this wind (m/s²). In a `landing`,
/// `reset` limits its height above the drone and its sink rate, and it moves towards the drone's position.
pub(super) fn start(
    now: Time<DroneClock>,
    drone: &DroneState,
    previous: Option<&SolvedPlan>,
    mpc: &Mpc,
    wind: Vector2<f64>,
    landing: Option<LandingStart>,
    reset: &Reset,
) -> PlanStart {
    let mut measured = measured_state(drone);
    let wind = wind / GRAVITY;
    measured[state::PHI] += wind.y;
    measured[state::THETA] -= wind.x;
    if let Some(previous) = previous.filter(|p| (now - p.at).secs() <= reset.age_s) {
        let (then, _) = previous.sample(drone.header.at, mpc); // compared at the odometry's time
        let gap: ModelState = core::array::from_fn(|i| measured[i] - then[i]);
        let near = gap[state::NORTH].hypot(gap[state::EAST]) <= reset.horizontal_m
            && gap[state::V_NORTH].hypot(gap[state::V_EAST]) <= reset.horizontal_mps
            && gap[state::DOWN].abs() <= reset.vertical_m
            && gap[state::V_DOWN].abs() <= reset.vertical_mps
            && wrap_angle(gap[state::PSI]).abs() <= reset.yaw_deg.to_radians();
        if near {
            let (mut state, input) = previous.sample(now, mpc);
            if let Some(LandingStart {
                approach_time_s: Some(yields_s),
                ..
            }) = landing
            {
                // A drone below its plan would meet the deck sooner and faster than planned. Above its plan, the drone
                // is brought down by the pilot's tracking loop, so the plan is kept.
                for (i, max) in [(state::DOWN, reset.ahead_m), (state::V_DOWN, reset.ahead_mps)] {
                    state[i] += (gap[i] - max).max(0.0);
                }
                let yields = low_pass_gain((now - previous.at).secs(), yields_s);
                for i in [state::NORTH, state::EAST, state::V_NORTH, state::V_EAST] {
                    state[i] += yields * gap[i];
                }
            }
            return PlanStart {
                state,
                input,
                measured: false,
            };
        }
    }
    // All limits are soft except those of the inputs, which hover satisfies.
    PlanStart {
        state: measured,
        input: [0.0; INPUTS],
        measured: true,
    }
}

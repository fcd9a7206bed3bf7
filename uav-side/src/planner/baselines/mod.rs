//! Baselines: what others would fly, by the same mission, pilot and success rule.
//!
//! | planner | knows the deck by | predicts it by | descends |
//! |---|---|---|---|
//! | `mpc` | tag, radio, wave model | the predictor | at the mission's speed, no attitude alignment |
//! | `mpc-ne` ([`mpc_ne`]) | tag | Fourier modes and a Kalman filter ([`modes`]), 1 s | when predicted tilt lets it |
//! | `wait-calm` ([`wait_calm`]) | tag, radio, wave model | the predictor | in a predicted calm |
//! | `precision-land` ([`precision_land`]) | tag | not at all | at constant speed over the earth |
//! | `gnss-radio` ([`gnss_radio`]) | radio | constant velocity | at the mission's speed |
//!
//! All but `mpc-ne` see the world through a [`View`]: the deck as their law believes it and what
//! they make of the mission's permission. The common references and the MPC without attitude
//! alignment do the rest. What the predictor may use and which of the mission's figures differ is in
//! [`settings`].

pub mod config;
mod fourier;
pub mod gnss_radio;
pub mod jerk;
pub mod modes;
pub mod mpc_ne;
pub mod precision_land;
pub mod settings;
pub mod wait_calm;

#[cfg(test)]
mod tests;

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{DeckForecast, MissionState, State};
use alight_shared::time::{DroneClock, Time};

use super::config::{PlannerConfig, PlannerKind};
use super::model::State as Start;
use precision_land::PrecisionLand;
use wait_calm::WaitCalm;

/// The world as a baseline believes it.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// What the mission permits, less what the baseline itself forbids.
    pub mission: MissionState,
    /// The deck as its law predicts it.
    pub forecast: Option<DeckForecast>,
}

/// The views of all baselines.
#[derive(Clone, Debug)]
pub struct Views {
    config: config::BaselineConfig,
    feet: f64,
    wait_calm: WaitCalm,
    precision_land: PrecisionLand,
}

impl Views {
    /// Views without a past.
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry) -> Self {
        Views {
            config: config.baselines,
            feet: drone.feet_below_m,
            wait_calm: WaitCalm::default(),
            precision_land: PrecisionLand::default(),
        }
    }

    /// What a planner of this kind sees. `start` is where its plan begins.
    pub fn view(
        &mut self,
        kind: PlannerKind,
        now: Time<DroneClock>,
        mission: &MissionState,
        forecast: Option<DeckForecast>,
        start: &Start,
    ) -> View {
        let mut view = View {
            mission: *mission,
            forecast,
        };
        let c = &self.config;
        match kind {
            PlannerKind::MpcFaa | PlannerKind::Mpc | PlannerKind::Alight | PlannerKind::MpcNe => {}
            PlannerKind::WaitCalm => {
                let clearance = clearance(now, view.forecast.as_ref(), start, self.feet);
                self.wait_calm.judge(now, clearance, &mut view, &c.wait_calm);
            }
            PlannerKind::PrecisionLand => {
                self.precision_land
                    .judge(now, start, self.feet, &mut view, &c.precision_land)
            }
            PlannerKind::GnssRadio => {
                if let Some(f) = &mut view.forecast {
                    let flare = view.mission.state == State::Flare;
                    let lower_m = if flare { c.gnss_radio.below_m } else { 0.0 };
                    gnss_radio::extrapolate(f, lower_m, &c.gnss_radio);
                }
            }
        }
        view
    }
}

/// Feet of a level drone over the deck's centre, m; infinite while the deck is not known.
fn clearance(now: Time<DroneClock>, forecast: Option<&DeckForecast>, start: &Start, feet_m: f64) -> f64 {
    forecast
        .and_then(|f| f.at(now.max(f.header.at)))
        .map_or(f64::INFINITY, |d| d.position[2] - feet_m - start[2])
}

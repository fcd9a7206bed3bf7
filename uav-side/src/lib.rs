//! The drone's side of Alight: predictor, mission, planner, pilot.
pub mod mission;
pub mod pilot;
pub mod planner;
pub mod predictor;

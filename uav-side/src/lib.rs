//! Drone side of Alight: camera, predictor, mission, planner, pilot, autopilot link.
pub mod autopilot;
pub mod calibrate;
pub mod camera;
pub mod computer;
pub mod contingency;
#[cfg(test)]
mod fixtures;
mod flatness;
mod lift_off;
pub mod mission;
pub mod mission_config;
pub mod odometry;
pub mod pilot;
pub mod planner;
pub mod predictor;
mod range_witness;
pub mod settings;
mod standing;
mod surroundings;
mod tracking;

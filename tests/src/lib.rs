//! The simulated world of Alight: truth that shares no model with the nodes.
//!
//! Start at [`world`]: `World::tick` is the architecture diagram. [`trial`] flies one landing.

pub mod autopilots;
pub mod baselines;
#[doc = "World, trial, judge and taps."]
pub mod harness {
    #[doc = "Age of information."]
    pub mod age;
    #[doc = "The drone's cameras."]
    pub mod cameras;
    #[doc = "The judge."]
    pub mod outcome;
    #[doc = "What is flown."]
    pub mod scenario;
    #[doc = "Taps."]
    pub mod tap;
    #[doc = "Traces."]
    pub mod trace;
    #[doc = "One landing."]
    pub mod trial;
    #[doc = "The world."]
    pub mod world;
}
pub mod physics;
pub mod radio;
pub mod sensors;
pub mod studies;
//
//
//
//
//
//
//
//

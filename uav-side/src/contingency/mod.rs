//! Contingency near the deck: actions of a drone when plan, mission, forecast or autopilot is missing.
//!
//! [`action`] decides from the missing inputs; [`contact`] predicts which outcome is softer. [`climb`], [`hold`] and
//! [`escape`] lead away from the deck; [`completion`] lands on it.

mod action;
mod below;
mod climb;
mod completion;
mod contact;
mod escape;
mod hold;

pub(crate) use action::{ContingencyAction, ContingencyInput, GOES_ON_WITHOUT_MISSION_S};
pub(crate) use below::{Body, DeckBelow, LOST_OUTSIDE_M, NEAR_DECK_M, outside_m, propagated, slide};
pub(crate) use climb::{BELOW_M, Climb};
pub(crate) use completion::Completion;
pub(crate) use contact::HARD_MPS;
pub use contact::{ContactOutcomes, PredictedContact};
pub(crate) use escape::escape_velocity;
pub(crate) use hold::Hold;

//! Contingency near the deck: actions of a drone when plan, mission, forecast or autopilot is missing.
//!
//! [`action`] decides by the missing inputs; [`contact`] predicts the softer outcome. [`climb`], [`hold`] and
//! [`escape`] lead away from the deck, [`completion`] leads onto it.

mod action;
mod below;
mod climb;
mod completion;
mod contact;
mod escape;
mod hold;

pub(crate) use action::{ContingencyAction, ContingencyInput, GOES_ON_WITHOUT_MISSION_S};
pub(crate) use below::{Body, DeckBelow, NEAR_DECK_M};
pub(crate) use climb::{BELOW_M, Climb};
pub(crate) use completion::Completion;
pub(crate) use contact::HARD_MPS;
pub use contact::{ContactOutcomes, PredictedContact};
pub(crate) use escape::escape_velocity;
pub(crate) use hold::Hold;

//! Contingency near the deck: what a drone does there when plan, mission, forecast or autopilot is missing.
//!
//! [`action`] decides by what is missing, [`contact`] predicts which end is softer. [`climb`], [`hold`] and [`escape`] are the
//! way up and away, [`completion`] is the way down, and [`below`] where the drone is over the deck.

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

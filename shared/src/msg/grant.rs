//! Whose the deck is.

use serde::{Deserialize, Serialize};

use super::Header;
use crate::time::{Clock, Time};

/// In the place of a drone's number: the deck is closed to all.
pub const DECK_CLOSED: u32 = u32::MAX;

/// The vessel announces which drone may descend to its deck. Repeated while it runs: a drone descends only
/// on a fresh grant that names it, and breaks a descent off on one that names another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct DeckGrant<C: Clock> {
    /// Identity; `at` is when it was granted.
    pub header: Header<C>,
    /// The drone that has the deck; 0 when nobody has, [`DECK_CLOSED`] when nobody may.
    pub owner: u32,
    /// It stands on it.
    pub occupied: bool,
}

restamped!(DeckGrant { owner, occupied });
message!(@C DeckGrant<C>, C, |m| {});

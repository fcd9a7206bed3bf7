//! Messages for people about a silent drone that has the deck.

use core::fmt;

use serde::{Deserialize, Serialize};

/// The owner is silent for longer than a landing takes while another drone waits for the deck with a low battery.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Starved {
    /// The owner.
    pub owner: u32,
    /// Since its newest status, s.
    pub silent_s: f64,
    /// The one that waits; of several the one with the least battery.
    pub waiting: u32,
    /// Its battery, 0 to 1.
    pub battery: f64,
}

impl fmt::Display for Starved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "drone {} has the deck and is silent for {:.0} s, and drone {} waits for it with {:.0} % of its battery",
            self.owner,
            self.silent_s,
            self.waiting,
            100.0 * self.battery
        )
    }
}

/// A silent drone that may be on its way down.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unheard {
    /// Its number.
    pub drone: u32,
    /// Since its newest status, s.
    pub silent_s: f64,
    /// After so long whatever it had begun has ended, s.
    pub remaining_s: f64,
}

impl fmt::Display for Unheard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "drone {} is silent for {:.0} s and may be on its way down: it keeps the deck",
            self.drone, self.silent_s
        )
    }
}

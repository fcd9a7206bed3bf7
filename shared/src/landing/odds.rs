//! The probability of each limit of a good landing, and of all.

use crate::msg::{Reason, ReasonCode};

/// No landing is more likely than this: 1 of 100 fails of what is in no model.
pub const MAX_ODDS: f64 = 0.99;

/// What a landing may fail of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The speed onto the deck.
    Hard,
    /// The speed along it.
    Fast,
    /// The angle between the normals.
    Tilted,
    /// Four feet inside the deck's edges.
    Beside,
    /// Staying where it stands.
    Slides,
}

/// The probability that each limit is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odds {
    /// Of the speed onto the deck.
    pub hard: f64,
    /// Of the speed along it.
    pub fast: f64,
    /// Of the angle.
    pub tilted: f64,
    /// Of the place.
    pub beside: f64,
    /// Of staying.
    pub slides: f64,
    /// The vessel's turn is most of what makes the contact fast.
    pub turns: bool,
}

impl Odds {
    fn each(&self) -> [(Limit, f64); 5] {
        [
            (Limit::Hard, self.hard),
            (Limit::Fast, self.fast),
            (Limit::Tilted, self.tilted),
            (Limit::Beside, self.beside),
            (Limit::Slides, self.slides),
        ]
    }
    /// That all limits are kept; 0 where a figure is none.
    pub fn whole(&self) -> f64 {
        let p: f64 = self.each().iter().map(|(_, p)| *p).product();
        if p.is_finite() { p.min(MAX_ODDS) } else { 0.0 }
    }
    /// Why it is not likely enough: the number and the limit that costs most of it.
    pub fn below(&self, needed: f64) -> Option<Reason> {
        let p = self.whole();
        let least = |a: (Limit, f64), b: (Limit, f64)| if b.1 < a.1 || b.1.is_nan() { b } else { a };
        let (limit, _) = self.each().into_iter().fold((Limit::Hard, self.hard), least);
        let code = match limit {
            Limit::Hard => ReasonCode::LikelyHard,
            Limit::Fast if self.turns => ReasonCode::TurnTooFast,
            Limit::Fast => ReasonCode::LikelyFast,
            Limit::Tilted => ReasonCode::LikelyTilted,
            Limit::Beside => ReasonCode::LikelyBeside,
            Limit::Slides => ReasonCode::LikelySlides,
        };
        (p < needed).then_some(Reason::new(code, p, needed))
    }
}

//! The probability of each limit of a good landing, and of all.

use crate::msg::{Reason, ReasonCode};

/// No landing is more likely than this: 1 of 100 fails of what is in no model.
pub const MAX_ODDS: f64 = 0.99;

/// Limit that a landing may exceed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The speed onto the deck.
    Hard,
    /// The speed along it.
    Fast,
    /// The angle between the normals.
    Tilted,
    /// Four feet inside the deck's edges.
    Outside,
    /// Staying where it stands.
    Slides,
}

/// The probability that each limit is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odds {
    /// Probability for the speed onto the deck.
    pub hard: f64,
    /// Probability for the speed along it.
    pub fast: f64,
    /// Probability for the angle.
    pub tilted: f64,
    /// Probability for the place.
    pub outside: f64,
    /// Probability of staying.
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
            (Limit::Outside, self.outside),
            (Limit::Slides, self.slides),
        ]
    }
    /// The probability that all limits are kept; 0 where a value is not finite.
    pub fn whole(&self) -> f64 {
        let p: f64 = self.each().iter().map(|(_, p)| *p).product();
        if p.is_finite() { p.min(MAX_ODDS) } else { 0.0 }
    }
    /// The probability of an unsafe contact: too hard, too fast along the deck, too tilted, or with a foot over an edge; 1 where
    /// a value is not finite. A slide at rest is no contact.
    pub fn harm(&self) -> f64 {
        let safe = self.hard * self.fast * self.tilted * self.outside;
        if safe.is_finite() { 1.0 - safe } else { 1.0 }
    }
    /// Why an unsafe contact is likelier than `max`.
    pub fn harmful(&self, max: f64) -> Option<Reason> {
        let harm = self.harm();
        (harm > max).then_some(Reason::new(ReasonCode::HarmLikely, harm, max))
    }
    /// Why it is not likely enough: the number and the limit that costs most of it.
    pub fn below(&self, needed: f64) -> Option<Reason> {
        let p = self.whole();
        let lower = |a: (Limit, f64), b: (Limit, f64)| if b.1 < a.1 || b.1.is_nan() { b } else { a };
        let (limit, _) = self.each().into_iter().fold((Limit::Hard, self.hard), lower);
        let code = match limit {
            Limit::Hard => ReasonCode::LikelyHard,
            Limit::Fast if self.turns => ReasonCode::TurnTooFast,
            Limit::Fast => ReasonCode::LikelyFast,
            Limit::Tilted => ReasonCode::LikelyTilted,
            Limit::Outside => ReasonCode::LikelyBeside,
            Limit::Slides => ReasonCode::LikelySlides,
        };
        (p < needed).then_some(Reason::new(code, p, needed))
    }
}

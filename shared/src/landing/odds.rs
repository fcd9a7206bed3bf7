//! Probabilities of meeting each limit of a good landing, and all of them.

use crate::msg::{Reason, ReasonCode};

/// Maximum probability of a landing: 1 in 100 fails for reasons that are not modelled.
pub const MAX_ODDS: f64 = 0.99;

/// Limit of a good landing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// Speed onto the deck.
    Hard,
    /// Speed along the deck.
    Fast,
    /// Angle between the normals.
    Tilted,
    /// Four feet inside the deck's edges.
    Outside,
    /// The drone stays at rest.
    Slides,
}

/// Probability of meeting each limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odds {
    /// Probability for the speed onto the deck.
    pub hard: f64,
    /// Probability for the speed along the deck.
    pub fast: f64,
    /// Probability for the angle.
    pub tilted: f64,
    /// Probability for the position.
    pub outside: f64,
    /// Probability that the drone stays at rest.
    pub slides: f64,
    /// The vessel's turn dominates the speed along the deck.
    pub turns: bool,
    /// Gusts cause most of [`Odds::harm`]; they become known low above the deck.
    pub gusts: bool,
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
    /// Probability that all limits are met; 0 if a value is not finite.
    pub fn whole(&self) -> f64 {
        let p: f64 = self.each().iter().map(|(_, p)| *p).product();
        if p.is_finite() { p.min(MAX_ODDS) } else { 0.0 }
    }
    /// Probability of an unsafe contact: too hard, fast or tilted, or a foot beyond an edge; 1 if not finite.
    /// A later slide is not part of it.
    pub fn harm(&self) -> f64 {
        let safe = self.hard * self.fast * self.tilted * self.outside;
        if safe.is_finite() { 1.0 - safe } else { 1.0 }
    }
    /// Reason if an unsafe contact is more likely than `max`.
    pub fn harmful(&self, max: f64) -> Option<Reason> {
        let harm = self.harm();
        (harm > max).then_some(Reason::new(ReasonCode::HarmLikely, harm, max))
    }
    /// Reason if the probability of a landing is below `needed`: that probability, and the limit that is most likely to be missed.
    pub fn below(&self, needed: f64) -> Option<Reason> {
        let p = self.whole();
        let lower = |a: (Limit, f64), b: (Limit, f64)| if b.1 < a.1 || b.1.is_nan() { b } else { a };
        let (limit, _) = self.each().into_iter().fold((Limit::Hard, self.hard), lower);
        let code = match limit {
            Limit::Hard => ReasonCode::LikelyHard,
            Limit::Fast if self.turns => ReasonCode::TurnTooFast,
            Limit::Fast => ReasonCode::LikelyFast,
            Limit::Tilted => ReasonCode::LikelyTilted,
            Limit::Outside => ReasonCode::LikelyOutside,
            Limit::Slides => ReasonCode::LikelySlides,
        };
        (p < needed).then_some(Reason::new(code, p, needed))
    }
}

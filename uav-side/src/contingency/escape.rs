//! The vessel's escape direction, in which a drone leaves after it has climbed clear of the deck.

use alight_shared::{geometry::DroneGeometry, msg::DeckStage, surroundings::Surroundings};
use nalgebra::{Vector2, Vector3};

use crate::surroundings::{in_deck, margin_m, ring_m};

/// Height above the deck from which the drone flies in the escape direction, m: clear of deck and crew.
const ESCAPE_ABOVE_M: f64 = 3.0;
/// Speed in the escape direction relative to the deck, m/s: reached within a second at a tilt of 10 deg.
const ESCAPE_MPS: f64 = 2.0;

/// Horizontal velocity of a leaving drone relative to the deck, m/s. Zero while it is low, if there is no escape
/// direction, or if a keep-out volume blocks it.
pub(crate) fn escape_velocity(
    around: &Surroundings,
    deck: &DeckStage,
    drone: &DroneGeometry,
    position: &Vector3<f64>,
    clearance: f64,
) -> Vector2<f64> {
    let Some([forward, right]) = around.escape_direction().filter(|_| clearance > ESCAPE_ABOVE_M) else {
        return Vector2::zeros();
    };
    let q = in_deck(deck, position);
    let margin = margin_m(drone);
    let length = 2.0 * ring_m(around, drone);
    let mut volumes = around.keep_out.iter();
    if volumes.any(|v| v.blocks(&q, [forward, right], length, margin)) {
        return Vector2::zeros();
    }
    let (sin, cos) = deck.euler[2].sin_cos();
    Vector2::new(cos * forward - sin * right, sin * forward + cos * right) * ESCAPE_MPS
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::surroundings::KeepOut;

    #[test]
    fn escape_with_clearance_and_a_free_way() {
        let mut around = Surroundings {
            escape: Some(core::f32::consts::PI),
            ..Surroundings::default()
        };
        let deck = DeckStage::default();
        let drone = DroneGeometry::default();
        let velocity = |around: &Surroundings, clearance: f64| {
            escape_velocity(
                around,
                &deck,
                &drone,
                &Vector3::new(0.0, 0.0, -clearance - 0.3),
                clearance,
            )
        };
        assert_eq!(velocity(&around, 2.9), Vector2::zeros());
        assert!((velocity(&around, 3.1) - Vector2::new(-ESCAPE_MPS, 0.0)).norm() < 1e-6);
        let _ = around.keep_out.push(KeepOut {
            low: [-6.0, 0.0, -5.0],
            high: [-5.0, 3.0, 0.0],
        });
        assert_eq!(velocity(&around, 3.1), Vector2::zeros());
        assert!(velocity(&around, 6.0).norm() > 0.0, "above it");
    }
}

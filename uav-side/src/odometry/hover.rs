//! Hover thrust, identified in flight.

use alight_shared::geometry::GRAVITY;

/// The hover thrust `T g / f` that a thrust `T` and the specific force `f` upwards along the body's axis (m/s²)
/// show, in the thrust's unit. None outside `calm_g` (multiples of g): shocks and free fall do not show hover.
pub(crate) fn hover_sample(thrust: f64, up: f64, calm_g: [f64; 2]) -> Option<f64> {
    let [low, high] = calm_g;
    (low * GRAVITY..=high * GRAVITY)
        .contains(&up)
        .then(|| thrust * GRAVITY / up)
}

use alight_shared::geometry::GRAVITY;

/// Hover thrust `T g / f`, in the unit of `thrust`, from the thrust `T` and the specific force `f` along the body's up
/// axis (m/s²). None if `f` is outside `calm_g` (multiples of g), as in shocks and free fall.
pub(crate) fn hover_sample(thrust: f64, up: f64, calm_g: [f64; 2]) -> Option<f64> {
    let [low, high] = calm_g;
    (low * GRAVITY..=high * GRAVITY)
        .contains(&up)
        .then(|| thrust * GRAVITY / up)
}

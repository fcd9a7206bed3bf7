//! Wind over the deck: boundary layer of the deck plate, and wakes of obstacles. Deck axes (forward, right,
//! down from the deck's centre), m and m/s; the wind is relative to the deck.

use alight_shared::surroundings::KeepOut;
use nalgebra::{Vector2, Vector3};

/// Kinematic viscosity of air at 15 deg C, m²/s.
pub(crate) const VISCOSITY: f64 = 1.46e-5;
/// PRIME: speed deficit behind the lee face, and horizontal and vertical turbulence intensity far behind the
/// box; near the box the intensity is 1.7 times as high (Weil 1996).
const DEFICIT: f64 = 0.7;
const INTENSITY: [f64; 3] = [0.08, 0.08, 0.06];
const NEAR: f64 = 1.7;
/// Exponent of the decay of deficit and turbulence with distance.
const DECAY: f64 = 2.0 / 3.0;
/// Minimum wind speed in a wake, relative to the wind ahead.
const MIN_SPEED: f64 = 0.01;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BodyWake {
    /// Wind speed relative to the wind ahead of the box.
    pub(crate) speed: f64,
    /// Standard deviation of turbulence relative to the wind ahead: along the deck, across, vertical.
    pub(crate) intensity: [f64; 3],
    /// Length of the eddies, m: the scale R of the box.
    pub(crate) length: f64,
}

/// Root mean square of `u / U` over the heights `span` above a flat plate, at the distance `fetch` behind its
/// windward edge, in wind `U`; drag scales with its square. Turbulent boundary layer `u / U = (h /
/// delta)^(1/7)`, `delta = 0.37 x / Re_x^0.2` (Schlichting 1979, section 21.1).
pub(crate) fn boundary_layer(speed: f64, fetch: f64, span: [f64; 2]) -> f64 {
    let thickness = 0.37 * fetch * (speed * fetch / VISCOSITY).max(1.0).powf(-0.2);
    let [low, high] = span.map(|h| h.max(0.0));
    if low >= thickness || high <= low {
        return 1.0;
    }
    let up_to = |h: f64| {
        let inside = h.min(thickness);
        7.0 / 9.0 * inside * (inside / thickness).powf(2.0 / 7.0) + h - inside
    };
    ((up_to(high) - up_to(low)) / (high - low)).sqrt()
}

/// Distance from `place` to the windward edge of a deck with these half lengths, opposite to `towards`, m;
/// None outside the deck.
pub(crate) fn fetch(half: [f64; 2], place: &Vector3<f64>, towards: &Vector2<f64>) -> Option<f64> {
    let to_edge = |i: usize| (half[i] + place[i] * towards[i].signum()) / towards[i].abs().max(1e-9);
    let over = (0..2).all(|i| place[i].abs() <= half[i]);
    over.then(|| to_edge(0).min(to_edge(1)))
}

impl BodyWake {
    /// Wake of a box at `place`, in wind `towards` (unit vector) with the given turbulence intensities; None
    /// outside the wake.
    ///
    /// Source: building wake of PRIME (Schulman, Strimaitis and Scire 2000, J. Air & Waste Manage. Assoc.
    /// 50), for projected width W, length L, height H above the box's base, and `R = min(H, W)^(2/3) max(H,
    /// W)^(1/3)` (neither above eight times the other). From the windward face the wake is `1.2 R (x/R +
    /// (H/1.2R)³)^(1/3)` high and extends `W/2 + R/3 (x/R)^(1/3)` to either side. Mean deficit `0.7 ((x - L +
    /// R)/R)^(-2/3)`; cavity length by Fackrell (1984). Turbulence `i + (1.7 i0 - 0.3 i) / (((x - L +
    /// R)/R)^(2/3) - 0.7)`, with i0 of the wake and i the smaller of i0 and the wind's.
    pub(crate) fn of(
        body: &KeepOut,
        place: &Vector3<f64>,
        towards: &Vector2<f64>,
        ambient: [f64; 3],
    ) -> Option<BodyWake> {
        let [low, high] = [body.low, body.high].map(|c| Vector3::from(c.map(f64::from)));
        let size = high - low;
        let from = place - 0.5 * (low + high);
        let along = towards.abs();
        let across = Vector2::new(towards.y.abs(), towards.x.abs());
        let length = along.dot(&size.xy());
        let width = across.dot(&size.xy());
        let height = size.z;
        let x = from.xy().dot(towards) + 0.5 * length;
        let y = from.xy().perp(towards).abs();
        let z = high.z - place.z;
        if x <= 0.0 || z < 0.0 || width.min(height) <= 0.0 {
            return None;
        }
        let h = height.min(8.0 * width);
        let w = width.min(8.0 * height);
        let scale = h.min(w).powf(2.0 / 3.0) * h.max(w).cbrt();
        let top = 1.2 * scale * (x / scale + (height / (1.2 * scale)).powi(3)).cbrt();
        let side = 0.5 * width + scale / 3.0 * (x / scale).cbrt();
        if z >= top || y >= side {
            return None;
        }
        let full = (0.5 * width).max(side - scale / 3.0);
        let taper = if y > full { (side - y) / (side - full) } else { 1.0 };
        let decay = ((x - length).max(0.0) / scale + 1.0).powf(DECAY);
        let over_roof = (x / length.max(1e-9)).min(1.0);
        let deficit = DEFICIT * taper / decay * over_roof;
        // Constant up to the cavity's height, then linear up to the top of the wake.
        let cavity = cavity_height([length, width, height], scale, x);
        let below = (1.0 - 2.0 * top * deficit / (top + cavity)).max(0.0);
        let rise = ((z - cavity) / (top - cavity).max(1e-9)).clamp(0.0, 1.0);
        let intensity = core::array::from_fn(|i| {
            let far = INTENSITY[i].min(ambient[i]);
            let wake = far + (NEAR * INTENSITY[i] - (1.0 - DEFICIT) * far) / (decay - DEFICIT);
            ambient[i] + over_roof * taper * (wake - ambient[i]).max(0.0)
        });
        Some(BodyWake {
            speed: (below + (1.0 - below) * rise).max(MIN_SPEED),
            intensity,
            length: scale,
        })
    }
}

/// Height of the cavity at the distance `x` behind the windward face of a box, m; 0 beyond the cavity's
/// length `1.8 W / ((L/H)^e (1 + 0.24 W/H))`, with L/H clamped to 0.3 to 3 and e = 0.3, less for a slender
/// box (Fackrell 1984, as in PRIME).
fn cavity_height([length, width, height]: [f64; 3], scale: f64, x: f64) -> f64 {
    let ratio = width / height;
    let slender = (width / height - 0.33) / 0.67;
    let exponent = 0.3 * slender.clamp(0.0, 1.0);
    let behind = 1.8 * width / ((length / height).clamp(0.3, 3.0).powf(exponent) * (1.0 + 0.24 * ratio));
    let arc =
        |top: f64, from: f64, end: f64| top * (1.0 - ((x - from) / (end - from)).powi(2)).max(0.0).sqrt();
    if x >= length + behind {
        0.0
    } else if 0.9 * scale < length {
        // The flow reattaches on the roof.
        if x <= length {
            height
        } else {
            arc(height, length, length + behind)
        }
    } else {
        let top = height + 0.22 * scale;
        arc(top, 0.5 * scale, length + behind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALM: [f64; 3] = [0.0; 3];
    /// Wheelhouse, a cube of 2 m ahead of the deck, in a headwind.
    const CUBE: KeepOut = KeepOut {
        low: [2.0, -1.0, -2.0],
        high: [4.0, 1.0, 0.0],
    };
    fn aft(x: f64, y: f64, above: f64) -> Option<BodyWake> {
        BodyWake::of(
            &CUBE,
            &Vector3::new(2.0 - x, y, -above),
            &Vector2::new(-1.0, 0.0),
            CALM,
        )
    }

    #[test]
    fn boundary_layer_by_fetch_and_height() {
        // delta = 0.37 * 2.5 / (8 * 2.5 / 1.46e-5)^0.2 = 0.0547 m.
        let at = |h: f64| boundary_layer(8.0, 2.5, [h, h + 1e-6]);
        assert!(
            (at(0.0547 / 2.0) - 0.5_f64.powf(1.0 / 7.0)).abs() < 1e-3,
            "{}",
            at(0.027)
        );
        assert_eq!(at(0.06), 1.0);
        // The mean square over the whole layer is 7/9.
        assert!((boundary_layer(8.0, 2.5, [0.0, 0.0547]).powi(2) - 7.0 / 9.0).abs() < 2e-3);
        assert!(boundary_layer(8.0, 20.0, [0.0, 0.35]) < boundary_layer(8.0, 2.5, [0.0, 0.35]));
    }

    #[test]
    fn fetch_from_the_windward_edge() {
        let half = [1.25, 0.85];
        let from_ahead = Vector2::new(-1.0, 0.0);
        let at = |x: f64, y: f64| fetch(half, &Vector3::new(x, y, -0.3), &from_ahead);
        assert!((at(-1.0, 0.5).unwrap() - 2.25).abs() < 1e-9);
        assert_eq!(at(0.0, 0.9), None);
    }

    #[test]
    fn wake_deficit_and_turbulence_by_distance() {
        // R = 2 m; far behind, beyond the cavity, the mean over the height is 1 - 0.7 ((x + R)/R)^(-2/3).
        for x in [6.0_f64, 12.0, 30.0] {
            let wakes: Vec<BodyWake> = (0..2000)
                .map_while(|k| aft(x, 0.0, 0.005 * f64::from(k)))
                .collect();
            let mean = wakes.iter().map(|w| w.speed).sum::<f64>() / wakes.len() as f64;
            let expected = 1.0 - 0.7 * ((x + 2.0) / 2.0).powf(-2.0 / 3.0);
            assert!((mean - expected).abs() < 0.01, "{x} m: {mean} for {expected}");
        }
        let near = aft(1.0, 0.0, 1.0).unwrap();
        let far = aft(10.0, 0.0, 1.0).unwrap();
        // At 3 m behind the windward face the wake is 3.06 m high and the cavity 1.88 m: 1 - 2 * 3.06 * 0.534 / 4.94.
        assert!((near.speed - 0.338).abs() < 0.003 && far.speed > near.speed);
        assert!((near.intensity[2] - 0.102 / (1.5_f64.powf(2.0 / 3.0) - 0.7)).abs() < 1e-9);
        assert!(near.intensity[0] > near.intensity[2] && far.intensity[2] < 0.05);
    }

    #[test]
    fn wake_sides_and_top() {
        assert!(aft(-2.5, 0.0, 1.0).is_none(), "ahead of the box");
        assert!(aft(2.0, 3.0, 1.0).is_none() && aft(2.0, 0.0, 4.0).is_none());
        let middle = aft(2.0, 0.0, 0.5).unwrap();
        let edge = aft(2.0, 1.7, 0.5).unwrap();
        assert!(edge.speed > middle.speed && edge.intensity[0] < middle.intensity[0]);
        // The wind's own turbulence is not added twice.
        let gusty = BodyWake::of(
            &CUBE,
            &Vector3::new(-20.0, 0.0, -1.0),
            &Vector2::new(-1.0, 0.0),
            [0.3; 3],
        );
        assert_eq!(gusty.unwrap().intensity, [0.3; 3]);
    }
}

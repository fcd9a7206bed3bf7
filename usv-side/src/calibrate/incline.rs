//! Inclining experiment: a known weight at a known position tilts the vessel at rest, which determines the stiffness in
//! newton metres. Free decay gives `G/M`, and M follows from both.
//!
//! ```text
//! G_roll = m g y / (heel to starboard)     G_pitch = m g x / (trim by the bow)     M = G / (G/M)
//! ```
//!
//! Two recordings on calm water are compared, without and with the weight, so bias and mounting of the sensor cancel. The
//! weight is modelled as a force, although a weight at height h above the vessel's centre reduces G by m g h, and a hull
//! pressed deeper is stiffer if its sides flare. In simulation, 60 kg on a boat of 211 kg overestimate G by 2 to 10 % in
//! roll and 1 to 5 % in pitch. A lighter weight causes less error and less tilt.

use alight_shared::{
    estimation::{ValueWithSd, median},
    geometry::GRAVITY,
};

use super::decay::{Decay, DecaySignal};

/// Length of pieces, s, longer than a push and its decay; the level at rest is the median of their medians.
const PIECE_S: f64 = 5.0;
const MIN_PIECES: usize = 4;
const KNOWN: f64 = 0.1;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    pub mass_kg: f64,
    /// Position relative to the vessel's reference point, m: forward, right.
    pub at_m: [f64; 2],
}

/// Roll and pitch of a vessel at rest, rad; None if the record is too short.
pub type RestTilt = [Option<ValueWithSd>; 2];

/// Stiffness in roll and pitch, Nm/rad; if the tilt is too small, the tilt (rad), or None if not measured.
pub type Stiffness = [Result<ValueWithSd, Option<ValueWithSd>>; 2];

/// Level of a signal at rest; occasional impulses shift it by a fraction of the sensor's noise.
pub fn level(signal: &DecaySignal) -> Option<ValueWithSd> {
    let first = *signal.t_s.first()?;
    let mut pieces: Vec<Vec<f64>> = Vec::new();
    let mut number = None;
    for (t, y) in signal.t_s.iter().zip(&signal.y) {
        let k = ((t - first) / PIECE_S).floor();
        if number.replace(k) != Some(k) {
            pieces.push(Vec::new());
        }
        if let Some(piece) = pieces.last_mut() {
            piece.push(*y);
        }
    }
    let levels: Vec<f64> = pieces.into_iter().filter_map(median).collect();
    if levels.len() < MIN_PIECES {
        return None;
    }
    let value = median(levels.iter().copied())?;
    let spread = 1.4826 * median(levels.iter().map(|v| (v - value).abs()))?;
    // The standard error of a median exceeds that of a mean by sqrt(pi / 2).
    let sd = 1.2533 * spread / (levels.len() as f64).sqrt();
    Some(ValueWithSd::new(value, sd))
}

pub fn stiffness(weight: &Weight, without: &RestTilt, with: &RestTilt) -> Stiffness {
    let [x, y] = weight.at_m;
    // Roll is positive to starboard, pitch with the bow up.
    let states = [y, -x].map(|arm| weight.mass_kg * GRAVITY * arm);
    core::array::from_fn(|i| {
        let (Some(a), Some(b)) = (without[i], with[i]) else {
            return Err(None);
        };
        let heel = ValueWithSd::new(b.value - a.value, a.sd.hypot(b.sd));
        let value = states[i] / heel.value;
        let relative_sd = heel.sd / heel.value.abs();
        if value.is_finite() && value > 0.0 && relative_sd <= KNOWN {
            Ok(ValueWithSd::relative(value, relative_sd))
        } else {
            Err(Some(heel))
        }
    })
}

/// Inertia including added mass, kg m², from the stiffness and the free decay of a degree of freedom.
pub fn inertia(stiffness: &ValueWithSd, decay: &Decay) -> Option<ValueWithSd> {
    let value = stiffness.value / decay.stiffness.value;
    let relative_sd = (stiffness.sd / stiffness.value).hypot(decay.stiffness.sd / decay.stiffness.value);
    (value.is_finite() && value > 0.0).then_some(ValueWithSd::relative(value, relative_sd))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_rest(y: f64, seconds: usize, pushed: bool) -> DecaySignal {
        let mut s = DecaySignal::default();
        for k in 0..seconds * 100 {
            let t = k as f64 * 0.01;
            let noise = ((k * 7) as f64 * 0.754_877_666_246_693).fract() - 0.5;
            let push = if pushed && t % 12.0 < 2.0 { 0.1 } else { 0.0 };
            s.t_s.push(t);
            s.y.push(y + 0.01 * noise + push);
        }
        s
    }

    #[test]
    fn level_at_rest_with_impulses() {
        // Pushes of 0.1 for a sixth of the time: the mean would be off by 0.017.
        for (pushed, off) in [(false, 5e-4), (true, 1.5e-3)] {
            let found = level(&at_rest(0.02, 120, pushed)).unwrap();
            assert!((found.value - 0.02).abs() < off && found.sd < 1e-3, "{found:?}");
        }
        assert_eq!(level(&at_rest(0.02, 15, false)), None);
        assert_eq!(level(&DecaySignal::default()), None);
    }

    #[test]
    fn stiffness_by_a_known_weight() {
        let weight = Weight {
            mass_kg: 50.0,
            at_m: [1.5, 0.8],
        };
        let known = |value: f64| Some(ValueWithSd::new(value, 1e-4));
        let heel = [392.266 / 35e3, -735.499 / 38e3];
        let found = stiffness(
            &weight,
            &[known(0.01), known(-0.02)],
            &[known(0.01 + heel[0]), known(-0.02 + heel[1])],
        );
        for (g, truth) in found.iter().zip([35e3, 38e3]) {
            let g = g.unwrap();
            assert!((g.value - truth).abs() < 1.0 && g.sd < 0.03 * truth, "{g:?}");
        }
        // Tilt in the wrong direction, too little tilt, weight on the centre line, tilt not measured.
        let other = stiffness(&weight, &[known(0.0), None], &[known(-0.01), known(0.01)]);
        assert!(other[0].is_err() && other[1] == Err(None), "{other:?}");
        let middle = Weight {
            at_m: [1.5, 0.0],
            ..weight
        };
        let none = stiffness(&middle, &[known(0.0); 2], &[known(1e-5), known(-0.02)]);
        assert!(none[0].is_err() && none[1].is_ok(), "{none:?}");
    }

    #[test]
    fn inertia_error_of_stiffness_and_decay() {
        let with_sd = ValueWithSd::relative;
        let decay = Decay {
            damping: with_sd(6.0, 0.1),
            stiffness: with_sd(243.0, 0.03),
            impulses: 3,
        };
        let m = inertia(&with_sd(35e3, 0.04), &decay).unwrap();
        assert!(
            (m.value - 144.0).abs() < 0.1 && (m.sd / m.value - 0.05).abs() < 1e-9,
            "{m:?}"
        );
        let free = Decay {
            stiffness: ValueWithSd::default(),
            ..decay
        };
        assert_eq!(inertia(&with_sd(35e3, 0.04), &free), None);
    }
}

//! What the deck's motion differs by from the sum of the oscillators where the water's orbital motion does
//! not carry the hull along (`alight_shared::vessel_model::bound_waves`).

use alight_shared::vessel_model::{BoundMotion, WaveNonlinearity, WaveResponse, bound_motion};
use nalgebra::{Complex, Vector3};

use super::axis::{Axis, HEAD, MAX_STATES, RATE};
use super::observation::Observation;
use super::waves::{AXES, Oscillator};

/// Values, rates and accelerations per degree of freedom of the deck, m, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeckBoundMotion {
    /// m, rad.
    pub value: [f64; AXES],
    /// m/s, rad/s.
    pub rate: [f64; AXES],
    /// m/s², rad/s².
    pub acceleration: [f64; AXES],
}

impl DeckBoundMotion {
    /// Of a deck whose centre is on the `lever_arm` (m) from the vessel's reference point: bow up moves it aft,
    /// starboard down to starboard.
    fn new(b: &BoundMotion, lever_arm: &Vector3<f64>) -> Self {
        let deck = |[heave, roll, pitch]: [f64; 3]| {
            [pitch * lever_arm.z, -roll * lever_arm.z, heave, roll, pitch, 0.0]
        };
        DeckBoundMotion {
            value: deck(b.value),
            rate: deck(b.rate),
            acceleration: deck(b.acceleration),
        }
    }
    /// In a state of the filters.
    pub fn of(
        axes: &[Axis; AXES],
        oscillators: &[Oscillator],
        nonlinearity: WaveNonlinearity,
        lever_arm: &Vector3<f64>,
    ) -> Self {
        DeckBoundMotion::at(
            &axes.each_ref().map(|a| a.x),
            oscillators,
            nonlinearity,
            lever_arm,
        )
    }
    /// From the means of a state.
    pub fn at(
        means: &[[f64; MAX_STATES]; AXES],
        oscillators: &[Oscillator],
        nonlinearity: WaveNonlinearity,
        lever_arm: &Vector3<f64>,
    ) -> Self {
        if nonlinearity.is_linear() {
            return DeckBoundMotion::default();
        }
        let velocity = [means[0][RATE], means[1][RATE]];
        let waves: Vec<WaveResponse> = oscillators
            .iter()
            .enumerate()
            .map(|(k, o)| {
                let i = HEAD + 2 * k;
                let phasors = [2, 3, 4].map(|a: usize| Complex::new(means[a][i], -means[a][i + 1] / o.omega));
                let direction = (o.direction, o.direction_sd);
                WaveResponse::new(phasors, (o.earth_omega, o.omega), direction, velocity)
            })
            .collect();
        DeckBoundMotion::new(&bound_motion(&waves, nonlinearity, 0.0), lever_arm)
    }
    /// Removes it from an observation of the deck, for the filters hold sums of oscillators.
    #[must_use]
    pub fn removed_from(&self, o: &Observation) -> Observation {
        let mut rest = *o;
        for i in 0..AXES {
            if let Some((v, _)) = &mut rest.value[i] {
                *v -= self.value[i];
            }
            if let Some((r, _)) = &mut rest.rate[i] {
                *r -= self.rate[i];
            }
        }
        rest
    }
}

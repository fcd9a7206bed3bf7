//! Bound waves in the record (`alight_shared::vessel_model::bound_waves`): the free waves are fitted to the record less
//! the bound waves of the last fit.

use alight_shared::vessel_model::{WaveResponse, bound_motion};
use nalgebra::Complex;

use super::SeaComponent;
use super::fit::{Solution, Wave};
use super::record::{CHANNELS, smoothing};
use super::tracker::Tracker;

/// Rounds of removal; the next update continues from there.
const PASSES: usize = 2;

/// Frequency of encounter of a wave at a velocity north, east (m/s), rad/s.
fn encounter(w: &Wave, velocity: [f64; 2]) -> f64 {
    SeaComponent {
        omega: w.omega,
        direction: w.direction,
        ..SeaComponent::default()
    }
    .encounter(velocity)
}

impl Tracker {
    /// Fits the known waves again to the record less their bound waves, and keeps that record for later fits.
    pub(super) fn remove_bound_waves(&mut self, best: &mut Solution) {
        if self.nonlinearity.is_linear() || best.waves.is_empty() {
            return;
        }
        for _ in 0..PASSES {
            let known = self.bound(best);
            self.fitter.rows.less(&known);
            match self.fitter.solve(&self.waves.clone(), &[]) {
                Some(s) => *best = s,
                None => break,
            }
        }
    }

    /// Bound waves of `s` in the channels of every row.
    fn bound(&self, s: &Solution) -> Vec<[f64; CHANNELS]> {
        let rows = &self.fitter.rows;
        let u = rows.velocity_at_end();
        let waves: Vec<(Wave, WaveResponse)> = s
            .waves
            .iter()
            .enumerate()
            .map(|(j, w)| {
                let (heave, normal) = self.phasors(s, (j, w), Complex::new(1.0, 0.0), u);
                let response = WaveResponse::new(
                    [-heave, normal[1], -normal[0]],
                    (w.omega, encounter(w, u)),
                    (w.direction, 0.0),
                    u,
                );
                (*w, response)
            })
            .collect();
        (0..rows.len())
            .map(|i| {
                let then: Vec<WaveResponse> = waves
                    .iter()
                    .map(|(w, f)| {
                        let turn = Complex::from_polar(1.0, rows.phase(w, i));
                        WaveResponse {
                            phasors: f.phasors.map(|q| q * turn),
                            ..*f
                        }
                    })
                    .collect();
                let b = bound_motion(&then, self.nonlinearity, 0.0);
                [-b.acceleration[0], -b.value[2], b.value[1]]
            })
            .collect()
    }

    /// Phasors of component `j`'s heave upwards (m) and of the normal at the phase that `turn` is.
    pub(super) fn phasors(
        &self,
        s: &Solution,
        (j, w): (usize, &Wave),
        turn: Complex<f64>,
        velocity: [f64; 2],
    ) -> (Complex<f64>, [Complex<f64>; 2]) {
        let encounter = encounter(w, velocity);
        // On a moving vessel the column holds the change from omega to the encounter.
        let square = if self.fitter.rows.moving {
            w.omega
        } else {
            encounter
        }
        .powi(2);
        let left = smoothing(encounter, self.config.bin_s).max(0.1);
        let heave = -s.phasor(0, j) * turn / (left * square.max(0.01));
        (heave, [s.phasor(1, j) * turn, s.phasor(2, j) * turn])
    }
}

//! The residual's spectrum, summed over the channels: where to look for the next component.

use std::sync::Arc;

use nalgebra::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use super::record::CHANNELS;

/// A peak of the summed spectrum.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peak {
    /// Angular frequency as recorded (of encounter), rad/s.
    pub omega: f64,
    /// Phasors of the channels, up to a common real factor.
    pub phasors: [Complex<f64>; CHANNELS],
}

/// Spectrum of a record in bins, zero-padded to a power of two.
#[derive(Clone)]
pub(super) struct Spectrum {
    transform: Arc<dyn RealToComplex<f64>>,
    input: Vec<f64>,
    output: [Vec<Complex<f64>>; CHANNELS],
    scratch: Vec<Complex<f64>>,
    bin_s: f64,
}

impl Spectrum {
    /// For records of up to `bins` bins of `bin_s`.
    pub fn new(bins: usize, bin_s: f64) -> Self {
        // Fourfold padding: the grid is then finer than the basin of the refinement.
        let length = (4 * bins).next_power_of_two();
        let transform = RealFftPlanner::new().plan_fft_forward(length);
        Spectrum {
            input: transform.make_input_vec(),
            output: core::array::from_fn(|_| transform.make_output_vec()),
            scratch: transform.make_scratch_vec(),
            transform,
            bin_s,
        }
    }

    /// The strongest peak between `limits` (rad/s) of the `weights`-sum of the channels' power,
    /// with a Hann window over the record's `slots` (bin numbers).
    pub fn peak(
        &mut self,
        residual: &[Vec<f64>; CHANNELS],
        slots: &[usize],
        weights: &[f64; CHANNELS],
        limits: (f64, f64),
    ) -> Option<Peak> {
        let length = self.input.len();
        let last = slots.last().copied().unwrap_or(0) as f64 + 1.0;
        for c in 0..CHANNELS {
            self.input.fill(0.0);
            for (slot, r) in slots.iter().zip(&residual[c]) {
                let window = (core::f64::consts::PI * (*slot as f64 + 0.5) / last)
                    .sin()
                    .powi(2);
                if let Some(x) = self.input.get_mut(*slot) {
                    *x = window * r;
                }
            }
            self.transform
                .process_with_scratch(&mut self.input, &mut self.output[c], &mut self.scratch)
                .ok()?;
        }
        let grid = core::f64::consts::TAU / (length as f64 * self.bin_s);
        let (low, high) = (
            (limits.0 / grid).ceil() as usize,
            ((limits.1 / grid).floor() as usize).min(length / 2),
        );
        let power = |i: usize| -> f64 {
            (0..CHANNELS)
                .map(|c| weights[c] * self.output[c][i].norm_sqr())
                .sum()
        };
        let mut best: Option<(usize, f64)> = None;
        for i in low..=high {
            let p = power(i);
            if p.is_finite() && best.is_none_or(|(_, q)| p > q) {
                best = Some((i, p));
            }
        }
        best.map(|(i, _)| Peak {
            omega: i as f64 * grid,
            phasors: core::array::from_fn(|c| self.output[c][i]),
        })
    }
}

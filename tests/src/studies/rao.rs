//! Response of the simulated vessel to regular waves: surge, heave and pitch against wave length.

use core::f64::consts::TAU;

use alight_shared::geometry::GRAVITY;
use alight_shared::time::{Span, Time};
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;

use crate::physics::sea::Sea;
use crate::physics::streams::Streams;
use crate::physics::vessel::{Vessel, VesselConfig, VesselCourse};

/// Wave lengths from shorter than the hull to thirty times it, m.
pub const WAVELENGTHS_M: [f64; 14] = [
    3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 160.0,
];
/// Steepness k A of the waves, -.
const STEEPNESS: f64 = 0.02;

/// One wave length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RaoRow {
    /// Wave length, m.
    pub wavelength_m: f64,
    /// Period of the wave, s.
    pub period_s: f64,
    /// Surge amplitude over wave amplitude.
    pub surge: f64,
    /// Heave amplitude over wave amplitude.
    pub heave: f64,
    /// Pitch amplitude over wave slope k A.
    pub pitch: f64,
}

/// Simulates `vessel`, drifting with its bow where the waves go, in a regular wave.
pub fn rao(vessel: &VesselConfig, wavelength_m: f64) -> RaoRow {
    const DT: Span = Span::from_millis(10);
    let k = TAU / wavelength_m;
    let w = (GRAVITY * k).sqrt();
    let period_s = TAU / w;
    let amplitude = STEEPNESS / k;
    let sea = Sea::regular(amplitude, wavelength_m, 0.0);
    let config = VesselConfig {
        course: VesselCourse::Drift,
        heading_deg: Some(0.0),
        ..vessel.clone()
    };
    let mut boat = Vessel::new(&config, &sea, &Streams::new(0));
    // Settle for at least 20 s and five periods, then fit over five periods.
    let settle = (20.0_f64.max(5.0 * period_s) / DT.secs()).ceil() as i64;
    let measured = (5.0 * period_s / DT.secs()).round() as i64;
    let mut fits = [Fit::default(); 3];
    let mut t = Time::EPOCH;
    for i in 0..settle + measured {
        boat.step(t, DT.secs(), &sea);
        t += DT;
        if i >= settle {
            let s = boat.state();
            // The phase of the wave where the vessel is: drift does not smear the fit.
            let phase = w * t.secs() - k * s.position.0.x;
            let since = (i - settle) as f64 / measured as f64;
            for (fit, x) in fits.iter_mut().zip([s.position.0.x, s.position.0.z, s.euler().y]) {
                fit.add(phase, since, x);
            }
        }
    }
    RaoRow {
        wavelength_m,
        period_s,
        surge: fits[0].amplitude() / amplitude,
        heave: fits[1].amplitude() / amplitude,
        pitch: fits[2].amplitude() / STEEPNESS,
    }
}

/// Least squares of `a cos(phase) + b sin(phase) + c + d s`.
#[derive(Clone, Copy, Default)]
struct Fit {
    normal: Matrix4<f64>,
    right: Vector4<f64>,
}
impl Fit {
    fn add(&mut self, phase: f64, since: f64, x: f64) {
        let (s, c) = phase.sin_cos();
        let g = Vector4::new(c, s, 1.0, since);
        self.normal += g * g.transpose();
        self.right += g * x;
    }
    fn amplitude(&self) -> f64 {
        match self.normal.cholesky() {
            Some(l) => l.solve(&self.right).xy().norm(),
            None => f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rao_in_long_waves() {
        let [short, long, longest] = [4.0, 80.0, 160.0].map(|l| rao(&VesselConfig::default(), l));
        for r in [long, longest] {
            for x in [r.surge, r.heave, r.pitch] {
                assert!((x - 1.0).abs() < 0.06, "{r:?}");
            }
        }
        // The longer, the closer.
        assert!((longest.heave - 1.0).abs() < (long.heave - 1.0).abs() + 1e-3);
        // Waves shorter than the hull average out.
        assert!(
            short.heave < 0.7 && short.surge < 0.7 && short.pitch < 0.8,
            "{short:?}"
        );
    }

    #[test]
    fn rao_without_coupling() {
        let stock = VesselConfig {
            sideways_coupling: 0.0,
            ..VesselConfig::default()
        };
        let r = rao(&stock, 40.0);
        assert!(r.surge < 0.3 && r.heave > 0.9, "{r:?}");
    }
}

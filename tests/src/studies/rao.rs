//! Response of the simulated vessel to regular waves: surge, heave and pitch against wave length.

use core::f64::consts::TAU;
use core::fmt;

use alight_shared::config;
use alight_shared::geometry::GRAVITY;
use alight_shared::time::{Span, Time};
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;

use crate::physics::sea::Sea;
use crate::physics::streams::Streams;
use crate::physics::vessel::{Course, Vessel, VesselConfig};

/// What the columns mean, for under the table.
pub const TABLE_NOTE: &str = "Waves from astern, drifting vessel. Surge and heave: amplitude over wave \
amplitude; pitch: amplitude over wave slope. A particle of the water has 1, 1 and 1.";

config! {
    /// What to simulate.
    ///
    /// Chosen: from shorter than the hull to thirty times it; waves of 2 % steepness.
    pub struct RaoConfig {
        /// Wave lengths, m.
        pub wavelengths_m: Vec<f64> = vec![
                3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 160.0,
            ], in 1.0..=1000.0;
        /// Steepness k A of the waves, -.
        pub steepness: f64 = 0.02, in 1e-4..=0.2;
    }
    check |this, at| {
        at.require(
            (1..=1000).contains(&this.wavelengths_m.len()),
            "wavelengths_m",
            this.wavelengths_m.len(),
            "1 to 1000 lengths",
        )?;
    }
}

/// One wave length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RaoRow {
    /// Wave length, m.
    pub wavelength_m: f64,
    /// Its period, s.
    pub period_s: f64,
    /// Surge amplitude over wave amplitude.
    pub surge: f64,
    /// Heave amplitude over wave amplitude.
    pub heave: f64,
    /// Pitch amplitude over wave slope k A.
    pub pitch: f64,
}

/// The table; prints itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RaoTable {
    /// One row per wave length.
    pub rows: Vec<RaoRow>,
}

impl fmt::Display for RaoTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:>12} {:>10} {:>8} {:>8} {:>8}",
            "wavelength m", "period s", "surge", "heave", "pitch"
        )?;
        for r in &self.rows {
            writeln!(
                f,
                "{:>12.1} {:>10.2} {:>8.3} {:>8.3} {:>8.3}",
                r.wavelength_m, r.period_s, r.surge, r.heave, r.pitch
            )?;
        }
        f.write_str(TABLE_NOTE)
    }
}

/// Simulates `vessel`, drifting with its bow where the waves go, in each regular wave.
pub fn rao(vessel: &VesselConfig, config: &RaoConfig) -> RaoTable {
    let rows = config
        .wavelengths_m
        .iter()
        .map(|l| row(vessel, *l, config.steepness))
        .collect();
    RaoTable { rows }
}

fn row(vessel: &VesselConfig, wavelength_m: f64, steepness: f64) -> RaoRow {
    const DT: Span = Span::from_millis(10);
    let k = TAU / wavelength_m;
    let w = (GRAVITY * k).sqrt();
    let period_s = TAU / w;
    let amplitude = steepness / k;
    let sea = Sea::regular(amplitude, wavelength_m, 0.0);
    let config = VesselConfig {
        course: Course::Drift,
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
        pitch: fits[2].amplitude() / steepness,
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
        let config = RaoConfig {
            wavelengths_m: vec![4.0, 80.0, 160.0],
            ..RaoConfig::default()
        };
        let table = rao(&VesselConfig::default(), &config);
        for r in &table.rows[1..] {
            for x in [r.surge, r.heave, r.pitch] {
                assert!((x - 1.0).abs() < 0.06, "{r:?}");
            }
        }
        // The longer, the closer.
        assert!((table.rows[2].heave - 1.0).abs() < (table.rows[1].heave - 1.0).abs() + 1e-3);
        // Waves shorter than the hull average out.
        let short = table.rows[0];
        assert!(
            short.heave < 0.7 && short.surge < 0.7 && short.pitch < 0.8,
            "{short:?}"
        );
    }

    #[test]
    fn rao_without_coupling() {
        let config = RaoConfig {
            wavelengths_m: vec![40.0],
            ..RaoConfig::default()
        };
        let stock = VesselConfig {
            sideways_coupling: 0.0,
            ..VesselConfig::default()
        };
        let r = rao(&stock, &config).rows[0];
        assert!(r.surge < 0.3 && r.heave > 0.9, "{r:?}");
    }

    #[test]
    fn rao_table_lines() {
        let config = RaoConfig {
            wavelengths_m: vec![20.0, 30.0],
            ..RaoConfig::default()
        };
        let text = rao(&VesselConfig::default(), &config).to_string();
        assert_eq!(text.lines().count(), 4);
    }
}

//! A wave's frequency from its encounter, and its direction from its phasors.

use core::f64::consts::PI;

use alight_shared::geometry::GRAVITY;
use nalgebra::Complex;

use super::fit::DirectionPrior;
use super::record::CHANNELS;

/// Frequency in the earth frame from that of encounter at `along = U . d`, rad/s.
pub(super) fn from_encounter(encounter: f64, along: f64) -> f64 {
    let b = along / GRAVITY;
    let root = 1.0 - 4.0 * b * encounter;
    if b.abs() < 1e-6 || root <= 0.0 {
        return encounter;
    }
    (1.0 - root.sqrt()) / (2.0 * b)
}

/// Direction of travel from the channels' phasors (up acceleration, normal) and their variances.
pub(super) fn direction_of(p: [Complex<f64>; CHANNELS], variance: [f64; CHANNELS]) -> DirectionPrior {
    // zeta is proportional to -a_up; i zeta has the phase of n along d.
    let reference = p[0] * -Complex::<f64>::i();
    let size = reference.norm();
    if size <= 0.0 {
        return DirectionPrior { mean: 0.0, sd: PI };
    }
    let unit = reference.conj() / size;
    let (north, east) = (p[1] * unit, p[2] * unit);
    let along = north.re.hypot(east.re);
    if along <= 0.0 {
        return DirectionPrior { mean: 0.0, sd: PI };
    }
    let mean = east.re.atan2(north.re);
    // What contradicts one plane wave: noise, and tilt in phase with the heave.
    let (d_n, d_e) = (north.re / along, east.re / along);
    let across = (-d_e * north.im + d_n * east.im).abs();
    let heave_phase = variance[0].sqrt() / size;
    let noise = (0.5 * (variance[1] + variance[2])).sqrt();
    let sd = ((noise / along).powi(2) + (across / along).powi(2)).sqrt();
    // A heave lost in noise leaves the sign open.
    let sd = if heave_phase > 0.7 { PI } else { sd };
    DirectionPrior {
        mean,
        sd: sd.clamp(0.02, PI),
    }
}

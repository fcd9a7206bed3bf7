//! The vessel's broadcast prediction compared with the truth, 1 s ahead.
//!
//! *Heave* (Fossen 2011) is the height relative to the mean water level. Height in the vessel's NED also
//! contains the receiver's slow bias, which changes by 0.08 m per second, under 0.3 m of white noise at 10
//! Hz: no filter can estimate it to better than 0.09 m. The drone measures this bias by vision.

use alight_shared::{msg::VesselPrediction, time::VesselClock};
use alight_usv::VesselNodeConfig;

use super::estimator::{EstimatorRun, StageDeviations, difference, predicted, run};
use crate::harness::{
    physics::TICK,
    scenario::{Scenario, SetupError},
};

const AHEAD_S: f64 = 1.0;
/// Chi-square 95 % quantiles with one, two and three degrees of freedom.
const CHI2_95: [f64; 3] = [3.841, 5.991, 7.815];

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    count: u64,
    /// Sum of squared errors; with several components, of their norm.
    squares: f64,
    /// Sum of the normalised squared errors per component; equals `count` for a consistent covariance.
    normalised: f64,
    /// Number of predictions whose 95 % ellipse contains the truth.
    inside: u64,
}

impl Tally {
    fn add<const N: usize>(&mut self, errors: [f64; N], sds: [f64; N]) {
        let q: f64 = errors
            .iter()
            .zip(sds)
            .map(|(e, s)| (e / s.max(1e-9)).powi(2))
            .sum();
        self.count += 1;
        self.squares += errors.iter().map(|e| e * e).sum::<f64>();
        self.normalised += q / N as f64;
        self.inside += u64::from(CHI2_95.get(N - 1).is_some_and(|limit| q <= *limit));
    }
    #[must_use]
    pub fn and(self, o: Tally) -> Tally {
        Tally {
            count: self.count + o.count,
            squares: self.squares + o.squares,
            normalised: self.normalised + o.normalised,
            inside: self.inside + o.inside,
        }
    }
    pub fn rmse(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
    /// Mean per component; 1 for a consistent covariance.
    pub fn nees(&self) -> f64 {
        self.normalised / self.count.max(1) as f64
    }
    /// Fraction of truths inside the 95 % ellipse.
    pub fn inside(&self) -> f64 {
        self.inside as f64 / self.count.max(1) as f64
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    /// Heave of the reference point relative to the mean water level, m.
    pub heave: Tally,
    /// Roll and pitch, rad.
    pub tilt: Tally,
    /// Heave, roll and pitch as one ellipsoid, for the deck in waves; its RMSE has no meaning.
    pub deck: Tally,
}

impl Scores {
    #[must_use]
    pub fn and(self, o: Scores) -> Scores {
        Scores {
            heave: self.heave.and(o.heave),
            tilt: self.tilt.and(o.tilt),
            deck: self.deck.and(o.deck),
        }
    }
}

/// `span_s` is the time after the warm-up.
pub fn vessel(
    scenario: &Scenario,
    node: &VesselNodeConfig,
    seed: u64,
    span_s: f64,
) -> Result<Scores, SetupError> {
    let run = run(scenario, node, seed, span_s)?;
    let mut scores = Scores::default();
    for ((start, p), (level, sds)) in run.predictions.iter().zip(&run.levels) {
        let (Some([heave, roll, pitch]), Some(sd)) = (errors(&run, *start, p, *level), deviations(p, sds))
        else {
            continue;
        };
        scores.heave.add([heave], [sd[0]]);
        scores.tilt.add([roll, pitch], [sd[1], sd[2]]);
        scores.deck.add([heave, roll, pitch], sd);
    }
    Ok(scores)
}

/// Predicted minus true heave (m), roll and pitch (rad).
fn errors(run: &EstimatorRun, start: f64, p: &VesselPrediction<VesselClock>, level: f64) -> Option<[f64; 3]> {
    let tick = start + AHEAD_S / TICK.secs();
    let i = tick.max(0.0).floor() as usize;
    let f = tick.fract();
    let a = run.truth.get(i)?;
    let b = run.truth.get(i + 1)?;
    let angle = |dof: usize| {
        let then = a.eta[dof] + f * difference(dof, b.eta[dof], a.eta[dof]);
        Some(difference(dof, predicted(p, dof, AHEAD_S)?, then))
    };
    let heave = p.origin[2] + predicted(p, 2, AHEAD_S)? - level - (a.heave + f * (b.heave - a.heave));
    Some([heave, angle(3)?, angle(4)?])
}

/// Reported deviations of heave (m), roll and pitch (rad).
fn deviations(p: &VesselPrediction<VesselClock>, sds: &StageDeviations) -> Option<[f64; 3]> {
    let x = AHEAD_S / f64::from(p.step_s);
    let i = x.floor() as usize;
    let f = x.fract();
    let j = (i + 1).min(p.stages.len().saturating_sub(1));
    let a = sds.get(i)?;
    let b = sds.get(j)?;
    Some(core::array::from_fn(|d| a[d] + f * (b[d] - a[d])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tally_by_dimension() {
        let mut t = Tally::default();
        // 2.2 standard deviations are outside in one dimension, inside in two and three.
        t.add([2.2], [1.0]);
        assert_eq!((t.count, t.inside), (1, 0));
        t.add([2.2, 0.0], [1.0, 5.0]);
        t.add([0.0, 2.2, 0.0], [1.0, 1.0, 1.0]);
        assert_eq!((t.count, t.inside), (3, 2));
        assert!((t.rmse() - 2.2).abs() < 1e-12);
        assert!((t.nees() - 4.84 * (1.0 + 0.5 + 1.0 / 3.0) / 3.0).abs() < 1e-12);
        assert_eq!(t.and(t).count, 6);
    }
}

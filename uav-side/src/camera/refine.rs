//! Levenberg-Marquardt refinement of a pose in the camera's axes.

use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};

#[derive(Clone, Copy, Debug)]
pub(super) struct CameraPose {
    /// m.
    pub position: Vector3<f64>,
    /// Rotation from the object to the camera.
    pub attitude: UnitQuaternion<f64>,
}

impl CameraPose {
    /// This pose with the point `to` (in the object's axes) as origin.
    pub(super) fn about(&self, to: Vector3<f64>) -> CameraPose {
        CameraPose {
            position: self.position + self.attitude * to,
            ..*self
        }
    }
    /// Pose after a translation and a rotation about the camera's axes.
    fn moved(&self, step: &Vector6<f64>) -> CameraPose {
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
        CameraPose {
            position: self.position + step.fixed_rows::<3>(0),
            attitude: turn * self.attitude,
        }
    }
}

/// Gauss-Newton matrix, half of the negative gradient, and cost.
pub(super) type NormalEquations = (Matrix6<f64>, Vector6<f64>, f64);

pub(super) struct RefinementLimits {
    pub steps: usize,
    pub damping: f64,
    pub min_damping: f64,
    /// Relative cost reduction below which the refinement has converged.
    pub relative_gain: f64,
    /// Absolute cost reduction, added to the relative one.
    pub absolute_gain: f64,
    /// Norm of the step below which the refinement has converged.
    pub step: f64,
}

/// Pose of minimum cost near `start`, and its cost. None for an indefinite matrix or undefined equations.
pub(super) fn refine(
    start: CameraPose,
    limits: &RefinementLimits,
    equations: impl Fn(&CameraPose) -> Option<NormalEquations>,
) -> Option<(CameraPose, f64)> {
    let mut at = start;
    let (mut a, mut b, mut cost) = equations(&at)?;
    let mut damping = limits.damping;
    for _ in 0..limits.steps {
        let mut damped = a;
        for i in 0..6 {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&b);
        let to = at.moved(&step);
        match equations(&to) {
            Some((a2, b2, c2)) if c2 <= cost => {
                let gain = cost - c2;
                (at, a, b, cost) = (to, a2, b2, c2);
                damping = f64::max(0.1 * damping, limits.min_damping);
                let converged = gain <= limits.relative_gain * cost + limits.absolute_gain;
                if converged || step.norm() < limits.step {
                    break;
                }
            }
            Some(_) | None => damping *= 10.0,
        }
    }
    Some((at, cost))
}

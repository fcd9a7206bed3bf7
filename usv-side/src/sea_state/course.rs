//! The mean course: the vessel's velocity without the waves' orbital motion, by a spline.
//!
//! A causal low-pass would lag by metres in a turn, and a metre is a sixth of a radian of a 40 m
//! wave's phase. The whole record is at hand, so the velocity is fitted by linear B-splines with
//! knots [`KNOT_S`] apart and a penalty on their second difference (P-splines: Eilers and Marx
//! 1996), which has no lag and smooths to a straight line at the ends.

use nalgebra::{DMatrix, DVector};

/// Distance of the knots, s. Ours: close enough for a corner of a square course (3 s and 5 s predict worse after a
/// turn); waves that the spline could follow are removed by their phases.
const KNOT_S: f64 = 1.0;
/// Weight of the penalty, in samples per knot.
const PENALTY: f64 = 0.3;

/// Fits `values` at times `t` (ascending, s) by the spline plus the orbital motion of waves with
/// the given `phases` (rad, one list per wave), and replaces them by the spline alone.
pub(super) fn smooth(t: &[f64], values: [&mut Vec<f64>; 2], phases: &[Vec<f64>]) {
    let (Some(first), Some(last)) = (t.first(), t.last()) else {
        return;
    };
    let span = last - first;
    let intervals = ((span / KNOT_S).round() as usize).clamp(1, 64);
    let step = (span / intervals as f64).max(1e-3);
    let knots = intervals + 1;
    let size = knots + 2 * phases.len();
    let place = |time: f64| {
        let u = ((time - first) / step).clamp(0.0, intervals as f64);
        let i = (u as usize).min(intervals - 1);
        (i, u - i as f64)
    };
    // The non-zero entries of a row of the basis: two hats, then cosine and sine per wave.
    let mut row: Vec<(usize, f64)> = Vec::with_capacity(2 + 2 * phases.len());
    let fill = |k: usize, row: &mut Vec<(usize, f64)>| {
        row.clear();
        let (i, f) = place(t[k]);
        row.extend([(i, 1.0 - f), (i + 1, f)]);
        for (j, phase) in phases.iter().enumerate() {
            let (sin, cos) = phase.get(k).copied().unwrap_or(0.0).sin_cos();
            row.extend([(knots + 2 * j, cos), (knots + 2 * j + 1, sin)]);
        }
    };
    let mut normal = DMatrix::<f64>::identity(size, size) * 1e-3;
    let mut moments = [DVector::<f64>::zeros(size), DVector::zeros(size)];
    for k in 0..t.len() {
        fill(k, &mut row);
        for (a, x) in &row {
            for (b, y) in &row {
                normal[(*a, *b)] += x * y;
            }
            for (m, v) in moments.iter_mut().zip(&values) {
                m[*a] += x * v[k];
            }
        }
    }
    let weight = PENALTY * t.len() as f64 / knots as f64;
    for i in 1..knots.saturating_sub(1) {
        let bend = [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)];
        for (a, p) in bend {
            for (b, q) in bend {
                normal[(a, b)] += weight * p * q;
            }
        }
    }
    let Some(factor) = normal.cholesky() else { return };
    for (v, moment) in values.into_iter().zip(&moments) {
        let c = factor.solve(moment);
        for (time, x) in t.iter().zip(v.iter_mut()) {
            let (i, f) = place(*time);
            *x = (1.0 - f) * c[i] + f * c[i + 1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothed_course_follows_a_turn_without_lag_and_ignores_waves() {
        let t: Vec<f64> = (0..300).map(|i| 0.2 * f64::from(i)).collect();
        let turn = |t: f64| ((t - 28.0) / 6.0).clamp(0.0, 1.0) * core::f64::consts::FRAC_PI_2;
        let mut north: Vec<f64> = t
            .iter()
            .map(|t| 2.0 * turn(*t).cos() + 0.6 * (1.26 * t).sin())
            .collect();
        let mut east: Vec<f64> = t
            .iter()
            .map(|t| 2.0 * turn(*t).sin() + 0.6 * (1.1 * t).cos())
            .collect();
        smooth(&t, [&mut north, &mut east], &[]);
        let mut path = [0.0; 2];
        let mut wrong: f64 = 0.0;
        let mut right = [0.0; 2];
        for i in 0..t.len() {
            path[0] += 0.2 * north[i];
            path[1] += 0.2 * east[i];
            right[0] += 0.4 * turn(t[i]).cos();
            right[1] += 0.4 * turn(t[i]).sin();
            wrong = wrong.max((path[0] - right[0]).hypot(path[1] - right[1]));
        }
        assert!(wrong < 1.0, "path off by {wrong} m");
    }
}

//! Free decay: the motion of a vessel after being pushed and released determines its damping and stiffness per mass.
//!
//! ```text
//! stiff:  y'' + a y' + b y = 0,   y(t) = e^(-a t/2) (A C(t) + B S(t)) + c     a = D/M, b = G/M
//! free:   y' + a y = 0,           y(t) = A e^(-a t) + c
//! ```
//!
//! `C`, `S` are cosine and sine with the frequency `sqrt(b - a²/4)`, or hyperbolic functions. Position, rate and
//! acceleration of a degree of freedom decay in the same way, so `y` is whichever is measured; `c` includes the
//! sensor's bias. `a` and `b` are common to all impulses. `A`, `B` and `c` belong to each impulse and are eliminated
//! (variable projection, Golub and Pereyra 1973). The remaining problem is solved by the Levenberg-Marquardt method.

use alight_shared::estimation::{ValueWithSd, median};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// Minimum ratio of a push to the standard deviation at rest; noise alone reaches a ratio of four within minutes.
const STANDS_OUT: f64 = 6.0;
/// Ratio below which a push has ended.
const OVER: f64 = 3.0;
/// Minimum strength of a push relative to the strongest; weaker ones belong to another degree of freedom.
const STRONG: f64 = 0.2;
/// Minimum fraction of a push's motion explained by the fit.
const EXPLAINED: f64 = 0.8;
const MIN_SAMPLES: usize = 12;
/// Maximum number of impulses in a record, and of samples in an impulse.
const MAX_IMPULSES: usize = 64;
const MAX_SAMPLES: usize = 2000;
const ITERATIONS: usize = 50;
const KNOWN: f64 = 0.3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecayOrder {
    /// Degree of freedom that oscillates about its equilibrium: heave, roll, pitch.
    Stiff,
    /// Degree of freedom that only slows down: surge, sway, yaw.
    Free,
}

#[derive(Clone, Debug, Default)]
pub struct DecaySignal {
    pub t_s: Vec<f64>,
    pub y: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decay {
    /// Damping per mass, 1/s.
    pub damping: ValueWithSd,
    /// Stiffness per mass, 1/s²; zero for a free degree of freedom.
    pub stiffness: ValueWithSd,
    pub impulses: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotObservable {
    NotMeasured,
    /// No push exceeds the noise at rest.
    NotPushed {
        /// Ratio of the largest value to the standard deviation at rest.
        stands_out: f64,
    },
    /// The motion is not a free decay: the vessel was held, driven by waves, or moved in another way.
    NoDecay {
        /// Fraction of the motion explained by a free decay.
        explained: f64,
    },
    /// The motion is a free decay, but too short, weak or noisy.
    Vague,
}

/// Samples of one push from its peak on.
struct DecaySamples {
    t: Vec<f64>,
    y: DVector<f64>,
    peak: f64,
    spread: f64,
}

/// Pushes in a signal, and the ratio of its largest value to the standard deviation at rest.
fn impulses(signal: &DecaySignal, rest_s: f64) -> (Vec<DecaySamples>, f64) {
    let rest = median(signal.y.iter().copied()).unwrap_or_default();
    let spread = median(signal.y.iter().map(|v| (v - rest).abs())).unwrap_or_default();
    let spread = (1.4826 * spread).max(1e-9);
    let size = |k: usize| signal.y.get(k).map_or(0.0, |v| (v - rest).abs());
    let time = |k: usize| signal.t_s.get(k).copied().unwrap_or(f64::INFINITY);
    let n = signal.y.len().min(signal.t_s.len());
    let highest = (0..n).map(size).fold(0.0, f64::max);
    let mut found = Vec::new();
    let mut k = 0;
    while k < n && found.len() < MAX_IMPULSES {
        if size(k) < STANDS_OUT * spread {
            k += 1;
            continue;
        }
        let mut peak = k;
        let mut last = k;
        let mut j = k;
        while j < n && time(j) - time(last) < rest_s {
            if size(j) > size(peak) {
                peak = j;
            }
            if size(j) > OVER * spread {
                last = j;
            }
            j += 1;
        }
        // Include half of the motion's duration at rest to determine its level.
        let end = (last + (last - peak) / 2 + MIN_SAMPLES / 2)
            .min(n)
            .min(peak + MAX_SAMPLES);
        if end >= peak + MIN_SAMPLES && size(peak) > STRONG * highest {
            found.push(DecaySamples {
                t: (peak..end).map(|i| time(i) - time(peak)).collect(),
                y: DVector::from_iterator(end - peak, (peak..end).map(|i| signal.y[i] - rest)),
                peak: size(peak),
                spread,
            });
        }
        k = j.max(k + 1);
    }
    (found, highest / spread)
}

fn basis(order: DecayOrder, p: Vector2<f64>, t: &[f64]) -> DMatrix<f64> {
    let a = p.x.exp();
    let b = p.y.exp();
    match order {
        DecayOrder::Free => DMatrix::from_fn(t.len(), 2, |r, c| if c == 0 { (-a * t[r]).exp() } else { 1.0 }),
        DecayOrder::Stiff => {
            let d = b - 0.25 * a * a;
            let w = d.abs().sqrt().max(1e-6);
            DMatrix::from_fn(t.len(), 3, |r, c| {
                let x = w * t[r];
                let fall = -0.5 * a * t[r];
                match (c, d > 0.0) {
                    (0, true) => fall.exp() * x.cos(),
                    (1, true) => fall.exp() * x.sin() / w,
                    // A sum of two falling exponentials avoids growing factors.
                    (0, false) => 0.5 * ((fall + x).exp() + (fall - x).exp()),
                    (1, false) => 0.5 * ((fall + x).exp() - (fall - x).exp()) / w,
                    (_, _) => 1.0,
                }
            })
        }
    }
}

fn residual(order: DecayOrder, p: Vector2<f64>, push: &DecaySamples) -> Option<DVector<f64>> {
    let phi = basis(order, p, &push.t);
    let normal = phi.transpose() * &phi;
    let scale = normal.diagonal().max();
    let regular = normal + DMatrix::identity(phi.ncols(), phi.ncols()) * (1e-12 * scale);
    let x = regular.cholesky()?.solve(&(phi.transpose() * &push.y));
    let r = &push.y - phi * x;
    r.iter().all(|v| v.is_finite()).then_some(r)
}

fn residuals(order: DecayOrder, p: Vector2<f64>, impulses: &[&DecaySamples]) -> Option<Vec<DVector<f64>>> {
    // Strong and weak impulses have equal weight.
    impulses
        .iter()
        .map(|push| residual(order, p, push).map(|r| r / push.peak))
        .collect()
}

fn cost(r: &[DVector<f64>]) -> f64 {
    r.iter().map(DVector::norm_squared).sum()
}

/// Residuals and their derivatives with respect to the logarithms of the parameters.
fn slopes(order: DecayOrder, p: Vector2<f64>, impulses: &[&DecaySamples]) -> Option<[Vec<DVector<f64>>; 2]> {
    const H: f64 = 1e-4;
    let along = |e: Vector2<f64>| -> Option<Vec<DVector<f64>>> {
        let up = residuals(order, p + e, impulses)?;
        let down = residuals(order, p - e, impulses)?;
        Some(up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * H)).collect())
    };
    Some([along(Vector2::new(H, 0.0))?, along(Vector2::new(0.0, H))?])
}

fn normal(j: &[Vec<DVector<f64>>; 2], r: &[DVector<f64>], order: DecayOrder) -> (Matrix2<f64>, Vector2<f64>) {
    let dot = |a: &[DVector<f64>], b: &[DVector<f64>]| a.iter().zip(b).map(|(x, y)| x.dot(y)).sum::<f64>();
    let mut h = Matrix2::from_fn(|i, k| dot(&j[i], &j[k]));
    let mut g = Vector2::from_fn(|i, _| dot(&j[i], r));
    if order == DecayOrder::Free {
        (h[(0, 1)], h[(1, 0)], h[(1, 1)], g.y) = (0.0, 0.0, 1.0, 0.0);
    }
    (h, g)
}

/// Logarithms of `a` and `b` with the smallest residual, by Levenberg-Marquardt from the best point of a grid.
fn fit(order: DecayOrder, impulses: &[&DecaySamples]) -> Option<Vector2<f64>> {
    let cost_at = |p: Vector2<f64>| residuals(order, p, impulses).map_or(f64::INFINITY, |r| cost(&r));
    let mut best = (f64::INFINITY, Vector2::zeros());
    for k in 0..32 {
        let x = f64::from(k) / 31.0;
        let tries: &[Vector2<f64>] = &match order {
            // 0.02 to 10 1/s.
            DecayOrder::Free => [Vector2::new(0.02_f64.ln() + x * 500.0_f64.ln(), 0.0); 3],
            // 0.5 to 40 rad/s, damping ratios of 0.05, 0.2 and 0.6.
            DecayOrder::Stiff => [0.05, 0.2, 0.6].map(|ratio: f64| {
                let w = 0.5 * 80.0_f64.powf(x);
                Vector2::new((2.0 * ratio * w).ln(), (w * w).ln())
            }),
        };
        for p in tries {
            let c = cost_at(*p);
            if c < best.0 {
                best = (c, *p);
            }
        }
    }
    let (mut c, mut p) = best;
    if !c.is_finite() {
        return None;
    }
    let mut damp = 1e-3;
    for _ in 0..ITERATIONS {
        let r = residuals(order, p, impulses)?;
        let j = slopes(order, p, impulses)?;
        let (h, g) = normal(&j, &r, order);
        let lifted = h + Matrix2::from_diagonal(&h.diagonal()) * damp;
        let step = lifted.try_inverse()? * -g;
        let next = p + step.map(|v| v.clamp(-0.5, 0.5));
        let cn = cost_at(next);
        if cn < c {
            let done = step.norm() < 1e-9 || c - cn < 1e-12 * c;
            c = cn;
            p = next;
            damp = (damp * 0.3_f64).max(1e-12);
            if done {
                break;
            }
        } else {
            damp *= 10.0;
            if damp > 1e9 {
                break;
            }
        }
    }
    Some(p)
}

/// Covariance of the logarithms, with correlated residuals weighted accordingly (Newey and West 1987, over a quarter of
/// a push), but at least that of independent residuals.
fn covariance(order: DecayOrder, p: Vector2<f64>, impulses: &[&DecaySamples]) -> Option<Matrix2<f64>> {
    let r = residuals(order, p, impulses)?;
    let j = slopes(order, p, impulses)?;
    let (h, _) = normal(&j, &r, order);
    let bread = h.try_inverse()?;
    let n: usize = r.iter().map(DVector::len).sum();
    let own = match order {
        DecayOrder::Stiff => 3,
        DecayOrder::Free => 2,
    };
    let freedom = n.saturating_sub(own * impulses.len() + 2).max(1) as f64;
    let white = bread * (cost(&r) / freedom);
    let mut meat = Matrix2::zeros();
    for (k, res) in r.iter().enumerate() {
        let score = |i: usize| Vector2::new(j[0][k][i] * res[i], j[1][k][i] * res[i]);
        let lags = res.len() / 4;
        for i in 0..res.len() {
            for lag in 0..=lags.min(i) {
                let w = 1.0 - lag as f64 / (lags + 1) as f64;
                let g = score(i) * score(i - lag).transpose();
                meat += if lag == 0 { g } else { (g + g.transpose()) * w };
            }
        }
    }
    if order == DecayOrder::Free {
        meat[(0, 1)] = 0.0;
        meat[(1, 0)] = 0.0;
        meat[(1, 1)] = 0.0;
    }
    let shared = bread * meat * bread * (n as f64 / freedom);
    Some(if shared.trace() > white.trace() {
        shared
    } else {
        white
    })
}

/// Damping and stiffness per mass from the impulses in a signal.
pub fn identify(order: DecayOrder, signal: &DecaySignal) -> Result<Decay, NotObservable> {
    if signal.y.len() < 2 * MIN_SAMPLES {
        return Err(NotObservable::NotMeasured);
    }
    let rest_s = match order {
        DecayOrder::Stiff => 1.0,
        DecayOrder::Free => 3.0,
    };
    let (all, stands_out) = impulses(signal, rest_s);
    if all.is_empty() {
        return Err(NotObservable::NotPushed { stands_out });
    }
    let every: Vec<&DecaySamples> = all.iter().collect();
    let p = fit(order, &every).ok_or(NotObservable::Vague)?;
    let explained = |p: Vector2<f64>, push: &DecaySamples| {
        residual(order, p, push).map_or(0.0, |r| {
            let mean = push.y.mean();
            let noise = push.spread.powi(2) * r.len() as f64;
            // The fit does not have to explain sensor noise.
            let rest = (r.norm_squared() - noise).max(0.0);
            1.0 - rest / push.y.map(|v| v - mean).norm_squared().max(1e-300)
        })
    };
    // Drop impulses during which the boat was held, and impulses in another degree of freedom.
    let good: Vec<&DecaySamples> = all
        .iter()
        .filter(|push| explained(p, push) >= EXPLAINED)
        .collect();
    if good.is_empty() {
        let best = all.iter().map(|push| explained(p, push)).fold(0.0, f64::max);
        return Err(NotObservable::NoDecay { explained: best });
    }
    let p = fit(order, &good).ok_or(NotObservable::Vague)?;
    let mut variance = covariance(order, p, &good)
        .ok_or(NotObservable::Vague)?
        .diagonal();
    if good.len() >= 3 {
        // Differences between impulses are not sensor noise: they come from the water, the strength of the impulse, or
        // a hand on the boat.
        let own: Vec<Vector2<f64>> = good.iter().filter_map(|push| fit(order, &[push])).collect();
        let n = own.len() as f64;
        if own.len() >= 3 {
            let mean = own.iter().sum::<Vector2<f64>>() / n;
            let apart = own.iter().map(|o| (o - mean).component_mul(&(o - mean)));
            let scatter = apart.sum::<Vector2<f64>>() / (n * (n - 1.0));
            variance = variance.zip_map(&scatter, f64::max);
        }
    }
    let sd = variance.map(f64::sqrt);
    let known = sd.x < KNOWN && (order == DecayOrder::Free || sd.y < KNOWN);
    if !known {
        return Err(NotObservable::Vague);
    }
    let figure = |log: f64, sd: f64| ValueWithSd::relative(log.exp(), sd);
    Ok(Decay {
        damping: figure(p.x, sd.x),
        stiffness: match order {
            DecayOrder::Stiff => figure(p.y, sd.y),
            DecayOrder::Free => ValueWithSd::default(),
        },
        impulses: good.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reproducible noise: a Weyl sequence, uniform, standard deviation 1.
    fn noise(k: usize) -> f64 {
        let x = (k as f64 * 0.754_877_666_246_693).fract();
        let y = (k as f64 * 0.569_840_290_998_053).fract();
        (x + y - 1.0) * 6.0_f64.sqrt()
    }

    /// Pushes every 10 s of strength 1, at 100 Hz.
    fn pushed(order: DecayOrder, a: f64, b: f64, sd: f64, impulses: usize) -> DecaySignal {
        let mut s = DecaySignal::default();
        for k in 0..(impulses + 1) * 1000 {
            let t = k as f64 * 0.01;
            let since = t % 10.0;
            let w = (b - 0.25 * a * a).max(0.0).sqrt();
            let y = match order {
                _ if t < 10.0 => 0.0,
                DecayOrder::Stiff => (-0.5 * a * since).exp() * (w * since).cos(),
                DecayOrder::Free => (-a * since).exp(),
            };
            s.t_s.push(t);
            s.y.push(y + 0.02 + sd * noise(k));
        }
        s
    }

    #[test]
    fn free_decay_stated_errors() {
        for (order, a, b) in [
            (DecayOrder::Stiff, 6.2, 243.0),
            (DecayOrder::Stiff, 1.0, 9.0),
            (DecayOrder::Free, 0.9, 0.0),
        ] {
            for sd in [0.003, 0.02] {
                let found = identify(order, &pushed(order, a, b, sd, 4)).unwrap();
                assert!(
                    (found.damping.value - a).abs() < 3.0 * found.damping.sd,
                    "{a} {b} {sd}: {found:?}"
                );
                assert!(
                    (found.stiffness.value - b).abs() <= 3.0 * found.stiffness.sd,
                    "{a} {b}: {found:?}"
                );
                assert!(found.damping.sd < 0.1 * a, "{found:?}");
                assert_eq!(found.impulses, 4);
            }
        }
    }

    #[test]
    fn free_decay_at_rest_or_in_waves() {
        let still = pushed(DecayOrder::Stiff, 6.2, 243.0, 0.01, 0);
        assert!(matches!(
            identify(DecayOrder::Stiff, &still),
            Err(NotObservable::NotPushed { .. })
        ));
        let mut waves = still.clone();
        for (t, y) in waves.t_s.iter().zip(&mut waves.y) {
            *y += (1.2 * t).sin() + 0.4 * (0.9 * t + 1.0).sin();
        }
        assert!(matches!(
            identify(DecayOrder::Stiff, &waves),
            Err(NotObservable::NotPushed { .. })
        ));
        assert_eq!(
            identify(DecayOrder::Free, &DecaySignal::default()),
            Err(NotObservable::NotMeasured)
        );
    }

    #[test]
    fn free_decay_of_a_held_vessel() {
        let mut held = pushed(DecayOrder::Stiff, 6.2, 243.0, 0.005, 0);
        for k in 0..9 {
            // A sawtooth that jumps up and falls slowly.
            for (i, y) in held.y.iter_mut().skip(300 + 60 * k).take(20).enumerate() {
                *y += if (i + k) % 3 == 0 { 1.0 } else { -0.7 };
            }
        }
        let found = identify(DecayOrder::Stiff, &held);
        assert!(
            matches!(found, Err(NotObservable::NoDecay { .. } | NotObservable::Vague)),
            "{found:?}"
        );
    }
}

//! Estimator of the true wind and of the drone's drag.
//!
//! A drone that moves at `v` in the mean wind `w` with the gust `g` has the drag `d = -k s u` with `u = v - w - g` and
//! `s = sqrt(|u|² + u0²)`: quadratic, and linear below `u0`, where the rotors' drag dominates (Faessler et al. 2018).
//! The different speeds of an approach make both observable. An extended Kalman filter over `(ln k, w, g)` processes
//! the mean of each second: `dd/d(ln k) = d`, `dd/dw = dd/dg = k (s 1 + u u' / s)`. Gusts decay with the turbulence's
//! integral time and have its intensity. Changes faster than a gust are attributed to drag.

use alight_shared::landing::{DRAG_PER_M, LINEAR_MPS, TURBULENCE, drag};
use nalgebra::{Matrix2, Matrix2x5, SMatrix, SVector, Vector2};

/// Prior standard deviation of `ln k`.
const DRAG_LOG_SD: f64 = 0.5;
/// Maximum deviation of `ln k` from its prior: four standard deviations.
const DRAG_LOG_BOUND: f64 = 4.0 * DRAG_LOG_SD;
/// Bound of the wind, m/s.
const MAX_WIND_MPS: f64 = 60.0;
/// Prior standard deviation of each axis of the wind, m/s.
const UNKNOWN_MPS: f64 = 8.0;
/// Random walk of the mean wind, m/s per square root of a second: 1 m/s in seven minutes.
const CHANGE_MPS: f64 = 0.05;
/// Time after which gusts are independent, s: twice the integral time at 8 to 10 m/s.
pub(super) const INDEPENDENT_S: f64 = 10.0;
/// Integral time of the turbulence, s.
const GUST_S: f64 = 0.5 * INDEPENDENT_S;
/// Measurement noise of the disturbance, m/s²: tilt, accelerometers, and the drone's own manoeuvres.
const MEASURED_SD_MPS2: f64 = 0.15;
/// Averaging time of a sample, s.
const SAMPLE_S: f64 = 1.0;

/// `(ln k, w_north, w_east, g_north, g_east)`.
type State = SVector<f64, 5>;
type Covariance = SMatrix<f64, 5, 5>;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WindEstimator {
    /// None before the first sample.
    state: Option<(State, Covariance)>,
    /// Time integrals of disturbance and velocity, and elapsed time.
    sum: (Vector2<f64>, Vector2<f64>, f64),
}

impl Default for WindEstimator {
    fn default() -> Self {
        WindEstimator {
            state: None,
            sum: (Vector2::zeros(), Vector2::zeros(), 0.0),
        }
    }
}

impl WindEstimator {
    /// Restores `(ln k, w, g)` and its covariance.
    pub(super) fn resume(state: Option<[f64; 5]>, covariance: [[f64; 5]; 5]) -> Self {
        WindEstimator {
            state: state.map(|x| (bounded(x.into()), covariance.into())),
            ..WindEstimator::default()
        }
    }
    pub(super) fn learnt(&self) -> Option<([f64; 5], [[f64; 5]; 5])> {
        self.state.map(|(x, p)| (x.into(), p.into()))
    }
    /// Processes the disturbance `d` (m/s²) of a drone in free flight at the velocity `v` (m/s) for `dt` (s).
    pub(super) fn update(&mut self, d: &Vector2<f64>, v: &Vector2<f64>, dt: f64) {
        let (sum_d, sum_v, time) = &mut self.sum;
        (*sum_d, *sum_v, *time) = (*sum_d + d * dt, *sum_v + v * dt, *time + dt);
        if *time < SAMPLE_S {
            return;
        }
        let d = *sum_d / *time;
        let v = *sum_v / *time;
        self.sum = WindEstimator::default().sum;
        if (d.norm() + v.norm()).is_finite() {
            self.sample(&d, &v);
        }
    }

    fn sample(&mut self, d: &Vector2<f64>, v: &Vector2<f64>) {
        let (x, p) = match &self.state {
            Some((x, p)) => predicted(x, p),
            None => initial(d, v),
        };
        let (expected, slope) = drag(x[0].exp(), &(v - mean(&x) - gust(&x)));
        let mut h = Matrix2x5::zeros();
        h.set_column(0, &expected);
        h.fixed_columns_mut::<2>(1).copy_from(&slope);
        h.fixed_columns_mut::<2>(3).copy_from(&slope);
        let noise = Matrix2::identity() * MEASURED_SD_MPS2.powi(2);
        let Some(inverse) = (h * p * h.transpose() + noise).try_inverse() else {
            return;
        };
        let gain = p * h.transpose() * inverse;
        let x = x + gain * (d - expected);
        let p = (Covariance::identity() - gain * h) * p;
        if x.iter().chain(p.iter()).all(|v| v.is_finite()) {
            self.state = Some((bounded(x), 0.5 * (p + p.transpose())));
        }
    }

    /// Mean wind (direction of motion, NED, m/s), and the larger of its axes' standard deviations.
    pub(super) fn wind(&self) -> Option<(Vector2<f64>, f64)> {
        let (x, p) = self.state?;
        let sd = p[(1, 1)].max(p[(2, 2)]).max(0.0).sqrt();
        Some((mean(&x), sd))
    }
    /// Present speed of the wind with its gust, m/s.
    pub(super) fn speed(&self) -> Option<f64> {
        let (x, _) = self.state?;
        Some((mean(&x) + gust(&x)).norm())
    }
    /// Standard deviation of one axis of the gusts' acceleration on a drone that moves at `v`, m/s².
    pub(super) fn gust_sd(&self, v: &Vector2<f64>) -> Option<f64> {
        let (x, _) = self.state?;
        let (wind, sd) = self.wind()?;
        let (_, slope) = drag(x[0].exp(), &(v - wind));
        Some(slope.norm() * core::f64::consts::FRAC_1_SQRT_2 * TURBULENCE * wind.norm().hypot(sd))
    }
}

fn mean(x: &State) -> Vector2<f64> {
    Vector2::new(x[1], x[2])
}
fn gust(x: &State) -> Vector2<f64> {
    Vector2::new(x[3], x[4])
}

fn bounded(x: State) -> State {
    let usual = DRAG_PER_M.ln();
    let drag = x[0].clamp(usual - DRAG_LOG_BOUND, usual + DRAG_LOG_BOUND);
    let [w, g] = [mean(&x), gust(&x)].map(|v| v.cap_magnitude(MAX_WIND_MPS));
    State::from([drag, w.x, w.y, g.x, g.y])
}

/// Variance of each axis of a gust in this wind, m²/s².
fn gust_variance(x: &State) -> f64 {
    (TURBULENCE * mean(x).norm()).powi(2)
}

/// Predicts over one sample: constant drag, random walk of the mean wind, first-order Gauss-Markov gust.
fn predicted(x: &State, p: &Covariance) -> (State, Covariance) {
    let left = (-SAMPLE_S / GUST_S).exp();
    let rises = gust_variance(x) * (1.0 - left * left);
    let keep = State::from([1.0, 1.0, 1.0, left, left]);
    let changes = CHANGE_MPS.powi(2);
    let noise = Covariance::from_diagonal(&State::from([0.0, changes, changes, rises, rises]));
    let kept = Covariance::from_diagonal(&keep);
    (x.component_mul(&keep), kept * p * kept + noise)
}

/// Initial state: the wind that explains the first sample with the default drag.
fn initial(d: &Vector2<f64>, v: &Vector2<f64>) -> (State, Covariance) {
    let u = -d / (DRAG_PER_M * d.norm()).sqrt().max(DRAG_PER_M * LINEAR_MPS);
    let wind = v - u;
    let x = bounded(State::from([DRAG_PER_M.ln(), wind.x, wind.y, 0.0, 0.0]));
    let [k, w] = [DRAG_LOG_SD, UNKNOWN_MPS].map(|sd| sd * sd);
    let g = gust_variance(&x);
    (x, Covariance::from_diagonal(&State::from([k, w, w, g, g])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Estimator after hover, an approach at 7 m/s to a vessel that moves at `way`, and 25 s above it.
    fn flown(k: f64, wind: Vector2<f64>, way: Vector2<f64>) -> WindEstimator {
        let mut air = WindEstimator::default();
        for step in 0..4000 {
            let t = 0.01 * f64::from(step);
            let v = match t {
                t if t < 5.0 => Vector2::zeros(),
                t if t < 15.0 => Vector2::new(6.0, 3.0),
                _ => way,
            };
            let u: Vector2<f64> = v - wind;
            air.update(&(-u * (k * u.norm())), &v, 0.01);
        }
        air
    }

    #[test]
    fn true_wind_at_anchor_and_under_way() {
        for (k, wind, way) in [
            (0.028, [0.0, 0.0], [0.0, 0.0]),
            (0.028, [0.0, 0.0], [5.0, 0.0]),
            (0.05, [-6.0, 5.0], [0.0, 0.0]),
            (0.02, [8.0, 0.0], [-5.0, 2.0]),
        ] {
            let wind = Vector2::from(wind);
            let way = Vector2::from(way);
            let air = flown(k, wind, way);
            let (found, sd) = air.wind().unwrap();
            let error = (found - wind).norm();
            assert!(error < sd && error < 1.0, "{k} {wind} {way}: {found} sd {sd}");
            assert!(sd < 3.0, "{sd}");
        }
    }

    #[test]
    fn gusts_of_the_wind_and_none_of_the_way() {
        let way = Vector2::new(5.0, 0.0);
        let calm = flown(0.028, Vector2::zeros(), way).gust_sd(&way).unwrap();
        let windy = flown(0.028, -way, Vector2::zeros())
            .gust_sd(&Vector2::zeros())
            .unwrap();
        // Both drones have the same disturbance of 0.7 m/s².
        assert!(calm < 0.5 * windy, "{calm}, {windy}");
        // Expected value: 2 k u sigma along the wind and half of that across it, averaged over both axes.
        let expected = 0.028 * 5.0 * 0.19 * 5.0 * (0.5_f64 * 5.0).sqrt();
        assert!((windy / expected - 1.0).abs() < 0.3, "{windy}, {expected}");
    }

    proptest! {
        #[test]
        fn wind_of_any_odometry_is_finite(samples in proptest::collection::vec([-1e6..1e6_f64, -1e6..1e6, -1e4..1e4, -1e4..1e4], 1..40)) {
            let mut air = WindEstimator::default();
            for [a, b, c, d] in samples {
                air.update(&Vector2::new(a, b), &Vector2::new(c, d), 1.0);
                let (wind, sd) = air.wind().unwrap();
                prop_assert!(wind.norm().is_finite() && sd.is_finite());
                prop_assert!(air.gust_sd(&Vector2::zeros()).unwrap().is_finite());
            }
        }
    }
}

/// A value with its first (`d`) and second (`dd`) derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet {
    pub y: f64,
    pub d: f64,
    pub dd: f64,
}

impl Jet {
    /// `(1 - b) a + b c`, where the weight `b` is a jet.
    pub fn blend(a: Jet, c: Jet, b: Jet) -> Jet {
        let y = c.y - a.y;
        let d = c.d - a.d;
        let dd = c.dd - a.dd;
        Jet {
            y: a.y + b.y * y,
            d: a.d + b.d * y + b.y * d,
            dd: a.dd + b.dd * y + 2.0 * b.d * d + b.y * dd,
        }
    }
    pub fn shifted(self, offset: f64) -> Jet {
        Jet {
            y: self.y + offset,
            ..self
        }
    }
}

/// Step from 0 to 1 over `width`, evaluated at `x`: `10 s³ - 15 s⁴ + 6 s⁵`, twice differentiable.
pub fn smooth_step(x: f64, width: f64) -> Jet {
    let s = (x / width).clamp(0.0, 1.0);
    Jet {
        y: s * s * s * (10.0 + s * (6.0 * s - 15.0)),
        d: 30.0 * s * s * (1.0 - s).powi(2) / width,
        dd: 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (width * width),
    }
}

/// Natural cubic splines (second derivative zero at both ends) through several channels with common knots;
/// twice continuously differentiable.
#[derive(Clone, Debug)]
pub struct Splines<const N: usize> {
    x: Vec<f64>,
    y: Vec<[f64; N]>,
    m: Vec<[f64; N]>,
}

impl<const N: usize> Splines<N> {
    /// `x` must be strictly ascending. Returns None unless `x` and `y` have the same number of knots, at least two.
    pub fn through(x: Vec<f64>, y: Vec<[f64; N]>) -> Option<Self> {
        let n = x.len();
        if n < 2 || y.len() != n || !x.windows(2).all(|w| w[0] < w[1]) {
            return None;
        }
        // Thomas algorithm for h0 m0 + 2 (h0 + h1) m1 + h1 m2 = 6 (slope1 - slope0).
        let mut m = vec![[0.0; N]; n];
        let mut upper = vec![0.0; n];
        for i in 1..n - 1 {
            let h0 = x[i] - x[i - 1];
            let h1 = x[i + 1] - x[i];
            let pivot = 2.0 * (h0 + h1) - h0 * upper[i - 1];
            upper[i] = h1 / pivot;
            for c in 0..N {
                let bend = 6.0 * ((y[i + 1][c] - y[i][c]) / h1 - (y[i][c] - y[i - 1][c]) / h0);
                m[i][c] = (bend - h0 * m[i - 1][c]) / pivot;
            }
        }
        for i in (1..n - 1).rev() {
            for c in 0..N {
                m[i][c] -= upper[i] * m[i + 1][c];
            }
        }
        Some(Splines { x, y, m })
    }

    pub fn range(&self) -> (f64, f64) {
        (self.x[0], self.x[self.x.len() - 1])
    }

    /// Values at `at`, which is clamped to the range of the knots.
    pub fn at(&self, at: f64) -> [Jet; N] {
        let (low, high) = self.range();
        let at = at.clamp(low, high);
        let i = self.x.partition_point(|x| *x <= at).clamp(1, self.x.len() - 1) - 1;
        let h = self.x[i + 1] - self.x[i];
        let b = (at - self.x[i]) / h;
        let a = (self.x[i + 1] - at) / h;
        core::array::from_fn(|c| {
            let y0 = self.y[i][c];
            let y1 = self.y[i + 1][c];
            let m0 = self.m[i][c];
            let m1 = self.m[i + 1][c];
            Jet {
                y: a * y0 + b * y1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0,
                d: (y1 - y0) / h + ((1.0 - 3.0 * a * a) * m0 + (3.0 * b * b - 1.0) * m1) * h / 6.0,
                dd: a * m0 + b * m1,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spline_knots_and_derivatives() {
        let x: Vec<f64> = (0..200)
            .map(|i| f64::from(i) * 0.1 + 0.03 * f64::from(i % 3))
            .collect();
        let y: Vec<[f64; 2]> = x.iter().map(|x| [x.sin(), (0.7 * x).cos()]).collect();
        let s = Splines::through(x.clone(), y.clone()).unwrap();
        for (x, y) in x.iter().zip(&y) {
            assert!((s.at(*x)[0].y - y[0]).abs() < 1e-12 && (s.at(*x)[1].y - y[1]).abs() < 1e-12);
        }
        for i in 10..1900 {
            let t = f64::from(i) * 0.01;
            let l = s.at(t - 1e-4)[0];
            let m = s.at(t)[0];
            let r = s.at(t + 1e-4)[0];
            assert!(((r.y - l.y) / 2e-4 - m.d).abs() < 1e-5);
            assert!(((r.d - l.d) / 2e-4 - m.dd).abs() < 1e-2);
            assert!((m.y - t.sin()).abs() < 1e-3, "{t}");
        }
    }

    #[test]
    fn smooth_step_derivatives() {
        for i in -50..150 {
            let x = f64::from(i) * 0.02;
            let l = smooth_step(x - 1e-5, 2.0);
            let m = smooth_step(x, 2.0);
            let r = smooth_step(x + 1e-5, 2.0);
            assert!(((r.y - l.y) / 2e-5 - m.d).abs() < 1e-4);
            assert!(((r.d - l.d) / 2e-5 - m.dd).abs() < 1e-3);
        }
        assert_eq!(smooth_step(3.0, 2.0).y, 1.0);
    }

    #[test]
    fn spline_with_knots_out_of_order() {
        assert!(Splines::through(vec![0.0, 0.0], vec![[0.0], [1.0]]).is_none());
        assert!(Splines::through(vec![0.0], vec![[0.0]]).is_none());
    }
}

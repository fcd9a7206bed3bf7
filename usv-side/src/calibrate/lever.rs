//! Position of the GNSS antenna relative to the inertial sensor.
//!
//! ```text
//! v_gnss(t) = v_0 + integral of (R f + g) + R (omega x r)
//! ```
//!
//! Over a few seconds, the initial value `v_0` and the ramp caused by tilt error and accelerometer bias are
//! unknown in each window. They are projected out (Frisch, Waugh and Lovell); the rest is linear in `r`.

use alight_shared::{estimation::ValueWithSd, msg::GnssFix};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Length of a window, s: a wave period, within which biases are constant.
const WINDOW_S: f64 = 5.0;
/// Minimum number of fixes in a window, and of windows.
const MIN_FIXES: usize = 10;
const MIN_WINDOWS: usize = 5;
/// Number of samples on each side for averaging rates, whose noise biases `r` towards zero.
const AROUND: usize = 2;
/// Minimum standard error, m, and as a fraction of the distance (the estimate is 5 to 8 % short in simulation).
const FLOOR_M: f64 = 0.005;
const FLOOR_FRACTION: f64 = 0.05;

#[derive(Clone, Copy, Debug)]
pub struct InertialState {
    pub t_s: f64,
    /// Number of the uninterrupted run of samples.
    pub run: u32,
    /// Rotation NED from body.
    pub attitude: UnitQuaternion<f64>,
    /// Body rates, rad/s.
    pub rates: Vector3<f64>,
    /// Acceleration of the inertial sensor, NED, m/s².
    pub acceleration: Vector3<f64>,
}

/// Newest state up to `t_s`, at most one sample time old, with its index.
pub fn at(states: &[InertialState], t_s: f64) -> Option<(usize, &InertialState)> {
    let k = states.partition_point(|m| m.t_s <= t_s + 1e-6).checked_sub(1)?;
    let m = states.get(k)?;
    (t_s - m.t_s < 0.05).then_some((k, m))
}

/// Equation of one fix: time, velocity that the inertial sensor does not explain, and its dependence on `r`.
#[derive(Clone, Copy, Debug)]
struct Row {
    t_s: f64,
    y: Vector3<f64>,
    x: Matrix3<f64>,
}

#[derive(Clone, Debug, Default)]
pub struct Lever {
    window: Vec<Row>,
    run: u32,
    /// Velocity integrated from the start of the window to the present sample.
    velocity: Vector3<f64>,
    reached: usize,
    /// Normal equations of each window.
    windows: Vec<(Matrix3<f64>, Vector3<f64>, f64, usize)>,
}

impl Lever {
    pub fn fix(&mut self, fix: &GnssFix, states: &[InertialState]) {
        let Some((k, m)) = at(states, fix.header.at.secs()) else {
            return;
        };
        let over = self
            .window
            .first()
            .is_some_and(|first| m.t_s - first.t_s > WINDOW_S || m.run != self.run);
        if over {
            self.close();
        }
        if self.window.is_empty() {
            self.run = m.run;
            self.velocity = Vector3::zeros();
            self.reached = k;
        }
        for pair in states.get(self.reached..=k).unwrap_or_default().windows(2) {
            let [a, b] = pair else { continue };
            self.velocity += (a.acceleration + b.acceleration) * (0.5 * (b.t_s - a.t_s));
        }
        self.reached = k;
        let near = states
            .get(k.saturating_sub(AROUND)..(k + AROUND + 1).min(states.len()))
            .unwrap_or_default();
        let rates = near.iter().map(|m| m.rates).sum::<Vector3<f64>>() / near.len().max(1) as f64;
        self.window.push(Row {
            t_s: m.t_s,
            y: Vector3::from(fix.velocity) - self.velocity,
            x: m.attitude.to_rotation_matrix().into_inner() * rates.cross_matrix(),
        });
    }

    /// Ends a window, and removes mean and slope of every column.
    fn close(&mut self) {
        let rows = core::mem::take(&mut self.window);
        if rows.len() < MIN_FIXES {
            return;
        }
        let n = rows.len() as f64;
        let middle = rows.iter().map(|r| r.t_s).sum::<f64>() / n;
        let across = rows
            .iter()
            .map(|r| (r.t_s - middle).powi(2))
            .sum::<f64>()
            .max(1e-9);
        let mut y0 = Vector3::zeros();
        let mut y1 = Vector3::zeros();
        let mut x0 = Matrix3::zeros();
        let mut x1 = Matrix3::zeros();
        for r in &rows {
            let s = (r.t_s - middle) / across;
            y0 += r.y / n;
            x0 += r.x / n;
            y1 += r.y * s;
            x1 += r.x * s;
        }
        let mut h = Matrix3::zeros();
        let mut g = Vector3::zeros();
        let mut yy = 0.0;
        for r in &rows {
            let s = r.t_s - middle;
            let x = r.x - x0 - x1 * s;
            let y = r.y - y0 - y1 * s;
            h += x.transpose() * x;
            g += x.transpose() * y;
            yy += y.norm_squared();
        }
        self.windows.push((h, g, yy, 3 * rows.len().saturating_sub(2)));
    }

    /// Antenna minus inertial sensor, body frame, m; None if the vessel did not turn.
    pub fn identify(mut self) -> Option<[ValueWithSd; 3]> {
        self.close();
        if self.windows.len() < MIN_WINDOWS {
            return None;
        }
        let h: Matrix3<f64> = self.windows.iter().map(|w| w.0).sum();
        let g: Vector3<f64> = self.windows.iter().map(|w| w.1).sum();
        let bread = h.try_inverse()?;
        let r = bread * g;
        let rest: f64 = self.windows.iter().map(|w| w.2).sum::<f64>() - r.dot(&g);
        let freedom = self
            .windows
            .iter()
            .map(|w| w.3)
            .sum::<usize>()
            .saturating_sub(3)
            .max(1);
        let white = bread * (rest.max(0.0) / freedom as f64);
        // Covariance that allows for errors common to the fixes of a window (White 1980, one cluster per window).
        let meat: Matrix3<f64> = self
            .windows
            .iter()
            .map(|(h, g, _, _)| {
                let score = g - h * r;
                score * score.transpose()
            })
            .sum();
        let n = self.windows.len() as f64;
        let shared = bread * meat * bread * (n / (n - 1.0));
        let floor = FLOOR_M.hypot(FLOOR_FRACTION * r.norm());
        Some(core::array::from_fn(|i| {
            ValueWithSd::new(r[i], white[(i, i)].max(shared[(i, i)]).sqrt().hypot(floor))
        }))
    }
}

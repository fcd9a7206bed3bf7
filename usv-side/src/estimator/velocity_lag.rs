//! Lag of a receiver's velocities behind its positions.
//!
//! Marine receivers average speed and course over ground for several seconds but stamp them with the present time: a
//! recorded satellite compass lags by 2.4 s. In a turn, such a velocity points along the vessel's past course.
//!
//! The lag is the `tau` that minimises the mean square of `p(t) - p(t - T) - integral of v over [t - T + tau,
//! t + tau]`: the integral of the velocities then best matches the path of the positions. On a straight
//! course all lags fit equally well, and zero is used. Otherwise a velocity is rotated by the change of
//! heading over the lag, because in a turn the course follows the heading.

use std::collections::VecDeque;

use alight_shared::{
    frames::wrap_angle,
    msg::MAX_SOURCES,
    time::{Span, VesselTime},
};
use nalgebra::Vector2;

/// Spacing of the candidate lags, s, up to [`MAX_LAG_S`].
const STEP_S: f64 = 0.1;
const LAGS: usize = 41;
const MAX_LAG_S: f64 = STEP_S * (LAGS - 1) as f64;
/// Minimum time between two positions that are compared, s.
const PAIR_S: f64 = 1.0;
/// Maximum time between fixes of one path, s.
const GAP_S: f64 = 3.0;
/// Memory of the mean squares in pairs (a minute), and number of pairs required for an estimate.
const MEMORY: f64 = 60.0;
const FIRST: f64 = 20.0;
/// Ratio of a pair's smallest square to the mean above which it counts as a jump of the receiver, and number
/// of consecutive jumps after which they are accepted.
const JUMP: f64 = 25.0;
const JUMPS: u32 = 5;
/// Minimum gain in log likelihood over zero lag, exceeded by chance once in 10^5 cases.
const SURE: f64 = 10.0;
/// Maximum number of waiting samples: 25 velocities per second for more than the maximum lag.
const MAX_WAITING: usize = 256;

/// Integral of the velocities up to a time.
#[derive(Clone, Copy, Debug)]
struct Travelled {
    at: VesselTime,
    velocity: Vector2<f64>,
    path: Vector2<f64>,
    heading: f64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct VelocityLags([VelocityLag; MAX_SOURCES]);

impl VelocityLags {
    pub(super) fn of(&mut self, source: u8) -> Option<&mut VelocityLag> {
        self.0.get_mut(usize::from(source))
    }
}

/// Velocity lag of one receiver, measured from its fixes.
#[derive(Clone, Debug)]
pub(super) struct VelocityLag {
    positions: VecDeque<(VesselTime, Vector2<f64>)>,
    travelled: VecDeque<Travelled>,
    squares: [f64; LAGS],
    pairs: f64,
    jumps: u32,
}

impl Default for VelocityLag {
    fn default() -> Self {
        VelocityLag {
            positions: VecDeque::new(),
            travelled: VecDeque::new(),
            squares: [0.0; LAGS],
            pairs: 0.0,
            jumps: 0,
        }
    }
}

impl VelocityLag {
    /// Adds a position, north and east, m.
    pub(super) fn position(&mut self, at: VesselTime, place: Vector2<f64>) {
        if let Some((last, _)) = self.positions.back() {
            let apart = (at - *last).secs();
            if apart < PAIR_S {
                return;
            }
            if apart > GAP_S || self.positions.len() >= MAX_WAITING {
                self.positions.clear();
            }
        }
        self.positions.push_back((at, place));
    }
    /// Adds a velocity (north, east, m/s) at the vessel's `heading`, rad. Returns the change of heading since
    /// the velocity was valid, rad; zero if it is not newer than the last.
    pub(super) fn velocity(&mut self, at: VesselTime, velocity: Vector2<f64>, heading: f64) -> f64 {
        let path = match self.travelled.back() {
            Some(last) if at <= last.at => return 0.0,
            Some(last) if (at - last.at).secs() < GAP_S => {
                last.path + 0.5 * (at - last.at).secs() * (last.velocity + velocity)
            }
            Some(_) | None => {
                self.travelled.clear();
                Vector2::zeros()
            }
        };
        self.travelled.push_back(Travelled {
            at,
            velocity,
            path,
            heading,
        });
        if self.travelled.len() > MAX_WAITING {
            self.travelled.pop_front();
        }
        self.compare(at);
        self.turned_since()
    }
    /// Compares the pairs of positions for which all velocities up to `now` have arrived.
    fn compare(&mut self, now: VesselTime) {
        while let (Some(a), Some(b)) = (self.positions.front(), self.positions.get(1)) {
            let (from, begin) = *a;
            let (to, end) = *b;
            if (now - to).secs() < MAX_LAG_S {
                return;
            }
            self.positions.pop_front();
            let mut squares = [0.0; LAGS];
            for (k, square) in squares.iter_mut().enumerate() {
                let lag = Span::from_secs(STEP_S * k as f64);
                let (Some(first), Some(last)) = (self.path(from + lag), self.path(to + lag)) else {
                    return;
                };
                *square = (end - begin - (last - first)).norm_squared();
            }
            self.take(&squares);
        }
    }
    /// Integral of the velocities up to a time; None outside the record.
    fn path(&self, at: VesselTime) -> Option<Vector2<f64>> {
        let (a, b, fraction) = self.around(at)?;
        Some(a.path + fraction * (b.path - a.path))
    }
    /// Velocities before and after a time, and the interpolation weight, 0 to 1.
    fn around(&self, at: VesselTime) -> Option<(&Travelled, &Travelled, f64)> {
        let k = self.travelled.partition_point(|t| t.at < at).max(1);
        let a = self.travelled.get(k - 1)?;
        let b = self.travelled.get(k)?;
        let fraction = (at - a.at).secs() / (b.at - a.at).secs();
        (fraction >= 0.0).then_some((a, b, fraction))
    }
    /// Change of heading since the newest velocity was valid, rad.
    fn turned_since(&self) -> f64 {
        let lag_s = self.lag_s();
        let Some(newest) = self.travelled.back().filter(|_| lag_s > 0.0) else {
            return 0.0;
        };
        self.around(newest.at - Span::from_secs(lag_s))
            .map_or(0.0, |(a, b, fraction)| {
                wrap_angle(newest.heading - a.heading - fraction * wrap_angle(b.heading - a.heading))
            })
    }
    fn take(&mut self, squares: &[f64; LAGS]) {
        let smallest = |s: &[f64; LAGS]| s.iter().copied().fold(f64::INFINITY, f64::min);
        if self.pairs >= FIRST && smallest(squares) > JUMP * smallest(&self.squares) {
            self.jumps += 1;
            if self.jumps >= JUMPS {
                *self = VelocityLag::default();
            }
            return;
        }
        self.jumps = 0;
        self.pairs = (self.pairs + 1.0).min(MEMORY);
        for (mean, square) in self.squares.iter_mut().zip(squares) {
            *mean += (square - *mean) / self.pairs;
        }
    }
    /// Lag, s. Zero unless another lag fits significantly better.
    fn lag_s(&self) -> f64 {
        let first = self.squares[0];
        let rest = self.squares.iter().enumerate();
        let Some((k, smallest)) = rest.min_by(|a, b| a.1.total_cmp(b.1)) else {
            return 0.0;
        };
        let better = self.pairs * (first / smallest.max(f64::MIN_POSITIVE)).ln();
        if self.pairs >= FIRST && better > SURE {
            STEP_S * k as f64
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Lag estimated after 90 s at 3.9 m/s, turning by `turn` (rad/s): positions at 5 Hz with noise `sd` (m),
    /// velocities at 4 Hz behind by `lag` (s).
    fn lag_of(turn: f64, sd: f64, lag: f64) -> f64 {
        let heading = |t: f64| turn * t;
        let place = |t: f64| {
            let r = 3.9 / turn;
            r * Vector2::new(heading(t).sin(), 1.0 - heading(t).cos())
        };
        let velocity = |t: f64| 3.9 * Vector2::new(heading(t).cos(), heading(t).sin());
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut noise = || -> Vector2<f64> { Vector2::from_fn(|_, _| StandardNormal.sample(&mut rng)) };
        let mut measured = VelocityLag::default();
        for k in 0..1800_u32 {
            let t = 0.05 * f64::from(k);
            let at = Time::from_secs(t);
            if k % 4 == 0 {
                measured.position(at, place(t) + sd * noise());
            }
            if k % 5 == 0 {
                measured.velocity(at, velocity(t - lag) + 0.02 * noise(), heading(t));
            }
        }
        measured.lag_s()
    }

    #[test]
    fn lag_of_averaged_velocities() {
        for lag in [0.8, 1.5, 2.4, 3.5] {
            let measured = lag_of(0.03, 0.02, lag);
            assert!((measured - lag).abs() < 0.25, "{measured} of {lag} s");
        }
    }
    #[test]
    fn no_lag_where_none_is_observable() {
        // Without lag; on a nearly straight course; with noisy positions.
        for (turn, sd, lag) in [(0.03, 0.02, 0.0), (1e-4, 0.02, 2.0), (0.03, 1.5, 1.0)] {
            let measured = lag_of(turn, sd, lag);
            assert!(measured < 0.15, "{measured} s at {turn} rad/s, {sd} m, {lag} s");
        }
    }
    #[test]
    fn lag_of_one_receiver_of_two() {
        let mut lags = VelocityLags::default();
        let course = |t: f64| Vector2::new((0.1 * t).cos(), (0.1 * t).sin());
        let mut turned = [0.0; 2];
        for k in 0..2000_u32 {
            let t = 0.05 * f64::from(k);
            let [c, s] = course(t).into();
            for (source, lag) in [(0_u8, 0.0), (1, 2.4)] {
                let own = lags.of(source).unwrap();
                own.position(Time::from_secs(t), 40.0 * Vector2::new(s, -c));
                turned[usize::from(source)] =
                    own.velocity(Time::from_secs(t), 4.0 * course(t - lag), 0.1 * t);
            }
        }
        assert!(turned[0] == 0.0 && (turned[1] - 0.24).abs() < 0.02, "{turned:?}");
        // Same time stamp, or an earlier one.
        let late = lags.of(1).unwrap();
        assert_eq!(late.velocity(Time::from_secs(90.0), 4.0 * course(87.6), 9.0), 0.0);
        assert!(lags.of(MAX_SOURCES as u8).is_none());
    }
    #[test]
    fn lag_across_a_jump_of_the_receiver() {
        let mut measured = VelocityLag::default();
        for k in 0..2000_u32 {
            let t = 0.05 * f64::from(k);
            let course = |t: f64| Vector2::new((0.1 * t).cos(), (0.1 * t).sin());
            let jump = if t < 60.0 { 0.0 } else { 30.0 };
            if k % 4 == 0 {
                let [c, s] = course(t).into();
                measured.position(Time::from_secs(t), 40.0 * Vector2::new(s, -c).add_scalar(jump));
            }
            measured.velocity(Time::from_secs(t), 4.0 * course(t - 1.0), 0.1 * t);
        }
        assert!((measured.lag_s() - 1.0).abs() < 0.15, "{} s", measured.lag_s());
        let turned = measured.turned_since();
        assert!((turned - 0.1).abs() < 0.015, "{turned} rad");
    }
}

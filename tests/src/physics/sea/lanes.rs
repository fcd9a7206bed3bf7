//! Places side by side: numbers on which each operation works at once, so that the compiler takes several in one
//! instruction.

use core::array::from_fn;
use core::ops::{Add, Div, Mul, Sub};

use super::trig;

/// Places at a time.
pub(super) const LANES: usize = 4;

/// A number of each place.
#[derive(Clone, Copy)]
pub(super) struct Lanes<const L: usize>(pub(super) [f64; L]);

/// A horizontal vector of each place, north and east.
pub(super) type LanePair<const L: usize> = [Lanes<L>; 2];

impl<const L: usize> Default for Lanes<L> {
    fn default() -> Self {
        Lanes([0.0; L])
    }
}
impl<const L: usize> Add for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Lanes(from_fn(|l| self.0[l] + other.0[l]))
    }
}
impl<const L: usize> Sub for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Lanes(from_fn(|l| self.0[l] - other.0[l]))
    }
}
impl<const L: usize> Mul for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Lanes(from_fn(|l| self.0[l] * other.0[l]))
    }
}
impl<const L: usize> Mul<f64> for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Lanes(self.0.map(|v| v * factor))
    }
}
impl<const L: usize> Div for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Lanes(from_fn(|l| self.0[l] / other.0[l]))
    }
}
impl<const L: usize> Lanes<L> {
    /// Sines and cosines.
    #[inline(always)]
    pub(super) fn sin_cos(self) -> (Self, Self) {
        pair(self.0.map(trig::sin_cos))
    }
    /// Sines and cosines of small angles, which are clamped to those that [`trig::near_zero`] takes.
    #[inline(always)]
    pub(super) fn near_zero(self) -> (Self, Self) {
        pair(self.0.map(|v| trig::near_zero(v.clamp(-1.6, 1.6))))
    }
}

#[inline(always)]
fn pair<const L: usize>(v: [(f64, f64); L]) -> (Lanes<L>, Lanes<L>) {
    (Lanes(v.map(|p| p.0)), Lanes(v.map(|p| p.1)))
}

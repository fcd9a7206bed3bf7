//! Time with a clock type. Times of the vessel's computer, the drone's computer and the simulated truth
//! cannot be mixed by accident; only the bridge converts between them, with a stated uncertainty.

use core::{
    fmt,
    hash::Hash,
    marker::PhantomData,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub},
};
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// Clock of a time.
pub trait Clock: Copy + fmt::Debug + Default + Ord + Hash + 'static {
    /// Name used in messages.
    const NAME: &'static str;
}

macro_rules! clocks {
    ($($(#[$doc:meta])* $clock:ident = $name:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
        pub struct $clock;
        impl Clock for $clock {
            const NAME: &'static str = $name;
        }
    )*};
}
clocks! {
    /// Clock of the vessel's computer.
    VesselClock = "vessel clock";
    /// Clock of the drone's computer.
    DroneClock = "drone clock";
    /// Time of the simulated world, hidden from all nodes.
    TrueTime = "true time";
    /// The operating system's steady clock, common to all processes of a computer.
    SteadyClock = "steady clock";
}

/// Duration in whole nanoseconds with saturating arithmetic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(transparent)]
#[serde(transparent)]
pub struct Span(i64);

impl Span {
    /// Zero duration.
    pub const ZERO: Span = Span(0);
    /// Maximum duration.
    pub const MAX: Span = Span(i64::MAX);

    /// Duration of whole nanoseconds.
    pub const fn from_nanos(ns: i64) -> Self {
        Span(ns)
    }
    /// Duration of whole milliseconds.
    pub const fn from_millis(ms: i64) -> Self {
        Span(ms.saturating_mul(1_000_000))
    }
    /// Duration in seconds, rounded to the nanosecond; saturates, and a NaN becomes zero.
    pub fn from_secs(s: f64) -> Self {
        // `as` saturates and maps NaN to zero.
        Span((s * 1e9).round() as i64)
    }
    /// Duration in nanoseconds.
    pub const fn nanos(self) -> i64 {
        self.0
    }
    /// Duration in seconds.
    pub fn secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }
    /// Absolute value.
    pub const fn abs(self) -> Self {
        Span(self.0.saturating_abs())
    }
}

impl JsonSchema for Span {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Span".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "integer", "format": "int64", "unit": "ns" })
    }
}

impl Add for Span {
    type Output = Span;
    fn add(self, o: Span) -> Span {
        Span(self.0.saturating_add(o.0))
    }
}
impl Sub for Span {
    type Output = Span;
    fn sub(self, o: Span) -> Span {
        Span(self.0.saturating_sub(o.0))
    }
}
impl Neg for Span {
    type Output = Span;
    fn neg(self) -> Span {
        Span(self.0.saturating_neg())
    }
}
impl Mul<i64> for Span {
    type Output = Span;
    fn mul(self, k: i64) -> Span {
        Span(self.0.saturating_mul(k))
    }
}
impl Div<i64> for Span {
    type Output = Span;
    fn div(self, k: i64) -> Span {
        Span(self.0.checked_div(k).unwrap_or(0))
    }
}
impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.secs())
    }
}

/// Time on the clock of the drone's computer.
pub type DroneTime = Time<DroneClock>;
/// Time on the clock of the vessel's computer.
pub type VesselTime = Time<VesselClock>;
/// True time: that of the simulated world.
pub type WorldTime = Time<TrueTime>;

/// Time on clock `C` in nanoseconds since that clock's own epoch.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[repr(transparent)]
#[serde(transparent, bound = "")]
pub struct Time<C> {
    ns: i64,
    #[serde(skip)]
    clock: PhantomData<fn() -> C>,
}

impl<C: Clock> JsonSchema for Time<C> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        format!("Time on the {}", C::NAME).into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "integer", "format": "int64", "unit": "ns", "frame": C::NAME })
    }
}

impl<C> Time<C> {
    /// Epoch of the clock.
    pub const EPOCH: Time<C> = Time::from_nanos(0);

    /// Time from nanoseconds since the epoch.
    pub const fn from_nanos(ns: i64) -> Self {
        Time {
            ns,
            clock: PhantomData,
        }
    }
    /// Time from seconds since the epoch; saturates.
    pub fn from_secs(s: f64) -> Self {
        Self::from_nanos(Span::from_secs(s).nanos())
    }
    /// Nanoseconds since the epoch.
    pub const fn nanos(self) -> i64 {
        self.ns
    }
    /// Seconds since the epoch.
    pub fn secs(self) -> f64 {
        self.ns as f64 * 1e-9
    }
}

impl<C: Clock> fmt::Debug for Time<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s ({})", self.secs(), C::NAME)
    }
}
impl<C> Sub for Time<C> {
    type Output = Span;
    fn sub(self, o: Self) -> Span {
        Span(self.ns.saturating_sub(o.ns))
    }
}
impl<C> Add<Span> for Time<C> {
    type Output = Self;
    fn add(self, d: Span) -> Self {
        Self::from_nanos(self.ns.saturating_add(d.0))
    }
}
impl<C> AddAssign<Span> for Time<C> {
    fn add_assign(&mut self, d: Span) {
        self.ns = self.ns.saturating_add(d.0);
    }
}
impl<C> Sub<Span> for Time<C> {
    type Output = Self;
    fn sub(self, d: Span) -> Self {
        Self::from_nanos(self.ns.saturating_sub(d.0))
    }
}

/// Value with its time of validity.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(bound(serialize = "T: Serialize", deserialize = "T: Deserialize<'de>"))]
pub struct Stamped<C: Clock, T> {
    /// Time of validity (of measurement, or of the prediction), not of arrival.
    pub at: Time<C>,
    /// Value at that time.
    pub value: T,
}

impl<C: Clock, T> Stamped<C, T> {
    /// Value valid at `at`.
    pub const fn new(at: Time<C>, value: T) -> Self {
        Stamped { at, value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_saturation() {
        let end = Time::<TrueTime>::from_nanos(i64::MAX);
        assert_eq!(end + Span::from_secs(1.0), end);
        assert_eq!(
            Time::<TrueTime>::from_nanos(i64::MIN) - end,
            Span::from_nanos(i64::MIN)
        );
        assert_eq!(Span::from_secs(f64::NAN), Span::ZERO);
        assert_eq!(Span::from_secs(f64::INFINITY), Span::MAX);
    }

    #[test]
    fn time_round_trip_to_the_nanosecond() {
        assert_eq!(Span::from_secs(0.1).nanos(), 100_000_000);
        assert!((Time::<VesselClock>::from_secs(12.5).secs() - 12.5).abs() < 1e-9);
    }
}

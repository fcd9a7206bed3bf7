//! Offset between two clocks, from time stamps of what goes from one to the other.

use crate::time::{Clock, Span, Time};

/// Bounds of the offset of the own clock `C`, less the other, whose times are nanoseconds since an epoch of its own. Nothing
/// arrives before it left: `t1 - t2 <= o <= t4 - t3` with a request that left at `t1` and arrived at `t2`, and its reply that
/// left at `t3` and arrived at `t4` (Mills' on-wire protocol, RFC 5905, section 8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffsetBounds<C: Clock> {
    /// Time at which they hold.
    pub at: Time<C>,
    /// Smallest offset.
    pub low: Span,
    /// Largest offset.
    pub high: Span,
}

impl<C: Clock> OffsetBounds<C> {
    /// Bounds by a request and its reply, `t2` and `t3` of the other clock, ns.
    pub fn of_exchange(t1: Time<C>, t2_ns: i64, t3_ns: i64, t4: Time<C>) -> Self {
        OffsetBounds {
            low: t1 - Time::from_nanos(t2_ns),
            ..Self::of_message(t3_ns, t4)
        }
    }
    /// Upper bound by a message that left at `sent_ns` of the other clock and arrived at `at`.
    pub fn of_message(sent_ns: i64, at: Time<C>) -> Self {
        OffsetBounds {
            at,
            low: -Span::MAX,
            high: at - Time::from_nanos(sent_ns),
        }
    }
    /// Bounds at `now`, looser by what the clocks may drift apart since, `drift` in s/s.
    pub fn drifted(self, now: Time<C>, drift: f64) -> Self {
        let by = Span::from_nanos(((now - self.at).nanos().max(0) as f64 * drift) as i64);
        OffsetBounds {
            at: now.max(self.at),
            low: self.low - by,
            high: self.high + by,
        }
    }
    /// Bounds by both, which hold at one time.
    pub fn and(self, other: Self) -> Self {
        OffsetBounds {
            low: self.low.max(other.low),
            high: self.high.min(other.high),
            ..self
        }
    }
    /// Whether no offset is within both.
    pub fn contradicts(self, other: Self) -> bool {
        self.low > other.high || self.high < other.low
    }
    /// Middle of the bounds: Mills' estimate.
    pub fn middle(self) -> Span {
        self.low + (self.high - self.low) / 2
    }
    /// Largest error of the middle, s.
    pub fn error_s(self) -> f64 {
        0.5 * (self.high - self.low).secs()
    }
}

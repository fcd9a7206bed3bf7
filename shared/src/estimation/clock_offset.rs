//! Offset between two clocks, from the time stamps of messages exchanged between them.

use crate::time::{Clock, Span, Time};

/// Bounds on the local clock `C` minus a remote clock with times in ns. No message arrives before it is sent:
/// `t1 - t2 <= o <= t4 - t3` for a request sent at `t1` and received at `t2`, with a reply sent at `t3` and
/// received at `t4` (Mills' on-wire protocol, RFC 5905, section 8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffsetBounds<C: Clock> {
    /// Time at which the bounds hold.
    pub at: Time<C>,
    /// Smallest offset.
    pub low: Span,
    /// Largest offset.
    pub high: Span,
}

impl<C: Clock> OffsetBounds<C> {
    /// Bounds from a request and its reply; `t2` and `t3` are on the remote clock, ns.
    pub fn of_exchange(t1: Time<C>, t2_ns: i64, t3_ns: i64, t4: Time<C>) -> Self {
        OffsetBounds {
            low: t1 - Time::from_nanos(t2_ns),
            ..Self::of_message(t3_ns, t4)
        }
    }
    /// Upper bound from a message sent at `sent_ns` on the remote clock and received at `at`.
    pub fn of_message(sent_ns: i64, at: Time<C>) -> Self {
        OffsetBounds {
            at,
            low: -Span::MAX,
            high: at - Time::from_nanos(sent_ns),
        }
    }
    /// Bounds at `now`, widened by the possible drift since `self.at`; `drift` in s/s.
    pub fn drifted(self, now: Time<C>, drift: f64) -> Self {
        let by = Span::from_nanos(((now - self.at).nanos().max(0) as f64 * drift) as i64);
        OffsetBounds {
            at: now.max(self.at),
            low: self.low - by,
            high: self.high + by,
        }
    }
    /// Intersection of two bounds that hold at the same time.
    pub fn and(self, other: Self) -> Self {
        OffsetBounds {
            low: self.low.max(other.low),
            high: self.high.min(other.high),
            ..self
        }
    }
    /// Whether the two bounds have no offset in common.
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

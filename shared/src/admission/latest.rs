//! Newest valid copy of an input.

use super::{RejectionReason, check_message};
use crate::{
    msg::{Header, Message},
    time::{Clock, Span, Time},
};

/// Age limits for one kind of message.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Maximum time by which the time of validity may lie in the future.
    pub lead: Span,
    /// Maximum age.
    pub max_age: Span,
}

impl Rule {
    /// Accepts newer messages at any age. Within one computer, a time more than one tick in the future is corrupt.
    pub const NEWER: Rule = Rule {
        lead: Span::from_millis(50),
        max_age: Span::MAX,
    };
    /// Whether `at` is within `max_age` before and `lead` after `now`.
    pub fn is_fresh<C: Clock>(&self, now: Time<C>, at: Time<C>) -> bool {
        (-self.lead..=self.max_age).contains(&(now - at))
    }
    /// Checks a message at `now` after the message `last`.
    pub fn admit<M: Message>(
        &self,
        now: Time<M::Clock>,
        message: &M,
        last: Option<&Header<M::Clock>>,
    ) -> Result<(), RejectionReason> {
        check_message(message)?;
        let h = message.header();
        let age = now - h.at;
        if age < -self.lead {
            return Err(RejectionReason::Future);
        }
        if age > self.max_age {
            return Err(RejectionReason::Stale);
        }
        if last.is_none_or(|last| h.at > last.at) {
            Ok(())
        } else {
            Err(RejectionReason::OutOfOrder)
        }
    }
}

/// Stores the newest valid message of one kind and counts rejections.
#[derive(Clone, Debug)]
pub struct Latest<T> {
    value: Option<T>,
    rejected: u32,
}

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Latest {
            value: None,
            rejected: 0,
        }
    }
}

impl<T: Message + Copy> Latest<T> {
    /// Takes `message` if [`Rule::NEWER`] admits it, otherwise counts a rejection. Returns whether it was taken.
    pub fn offer(&mut self, now: Time<T::Clock>, message: &T) -> bool {
        self.offer_by(&Rule::NEWER, now, message)
    }
    /// Takes `message` if `rule` admits it.
    pub fn offer_by(&mut self, rule: &Rule, now: Time<T::Clock>, message: &T) -> bool {
        let last = self.value.as_ref().map(Message::header);
        let admitted = rule.admit(now, message, last).is_ok();
        if admitted {
            self.value = Some(*message);
        } else {
            self.rejected = self.rejected.saturating_add(1);
        }
        admitted
    }
    /// Newest message of any age.
    pub fn get(&self) -> Option<&T> {
        self.value.as_ref()
    }
    /// Newest message, if no older than `limit`.
    pub fn fresh(&self, now: Time<T::Clock>, limit: Span) -> Option<&T> {
        self.value.as_ref().filter(|v| now - v.header().at <= limit)
    }
    /// Age of the newest message, s; infinite without one.
    pub fn age_s(&self, now: Time<T::Clock>) -> f64 {
        self.value
            .as_ref()
            .map_or(f64::INFINITY, |v| (now - v.header().at).secs())
    }
    /// Removes the message; the count of rejections remains.
    pub fn forget(&mut self) {
        self.value = None;
    }
    /// Number of rejected messages.
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{msg::RangeSample, time::DroneTime};

    fn sample(at_ms: i64, boot: u32, sequence: u32) -> RangeSample {
        RangeSample {
            header: Header::new(1, 1, boot, sequence, Time::from_nanos(at_ms * 1_000_000)),
            range_m: 1.0,
            variance: 0.01,
        }
    }

    #[test]
    fn latest_newer_valid_messages() {
        let now = DroneTime::from_secs(1.0);
        let mut latest = Latest::default();
        assert!(latest.offer(now, &sample(900, 1, 5)));
        assert!(latest.offer(now, &sample(1050, 1, 4)), "within the lead");
        let damaged = RangeSample {
            range_m: f64::NAN,
            ..sample(1040, 1, 6)
        };
        for bad in [sample(1050, 1, 7), sample(1051, 1, 8), damaged] {
            assert!(!latest.offer(now, &bad));
        }
        assert_eq!((latest.rejected(), latest.age_s(now)), (3, -0.05));
        assert!(
            latest
                .fresh(now + Span::from_millis(250), Span::from_millis(200))
                .is_some()
        );
        assert!(
            latest
                .fresh(now + Span::from_millis(251), Span::from_millis(200))
                .is_none()
        );
    }

    #[test]
    fn latest_by_a_rule_of_its_own() {
        let rule = Rule {
            lead: Span::from_millis(20),
            max_age: Span::from_millis(500),
        };
        let now = DroneTime::from_secs(1.0);
        let mut latest = Latest::default();
        for (at_ms, taken) in [
            (499, false),
            (900, true),
            (900, false),
            (1030, false),
            (1020, true),
        ] {
            assert_eq!(
                latest.offer_by(&rule, now, &sample(at_ms, 1, 5)),
                taken,
                "{at_ms}"
            );
        }
    }
}

//! Newest message of a publication, stored for queries.

use std::sync::{Mutex, PoisonError};

use zenoh::bytes::ZBytes;

/// Maximum rate of replies with a held message, 1/s; each drone queries once when it connects.
const MAX_ANSWERS_PER_S: u32 = 20;

/// Rate limit that counts the replies within the present second.
#[derive(Debug, Default)]
pub(super) struct PerSecond {
    second: i64,
    answers: u32,
}

impl PerSecond {
    /// Whether another reply is permitted at `now_ns`, of at most `most` per second.
    pub(super) fn admits(&mut self, now_ns: i64, most: u32) -> bool {
        let second = now_ns.div_euclid(1_000_000_000);
        if second != self.second {
            self.second = second;
            self.answers = 0;
        }
        let admitted = self.answers < most;
        self.answers += u32::from(admitted);
        admitted
    }
}

#[derive(Debug, Default)]
pub(super) struct NewestMessage(Mutex<Newest>);

#[derive(Debug, Default)]
struct Newest {
    bytes: Option<ZBytes>,
    answers: PerSecond,
}

impl NewestMessage {
    pub(super) fn set(&self, bytes: ZBytes) {
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        newest.bytes = Some(bytes);
    }
    /// Message for a query at `now_ns`, within the rate limit.
    pub(super) fn take(&self, now_ns: i64) -> Option<ZBytes> {
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let admitted = newest.answers.admits(now_ns, MAX_ANSWERS_PER_S);
        newest.bytes.clone().filter(|_| admitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_message_for_many_who_ask() {
        let held = NewestMessage::default();
        assert!(held.take(0).is_none(), "nothing was published yet");
        held.set(ZBytes::from(vec![1]));
        held.set(ZBytes::from(vec![2]));
        let answered = |at_ns| (0..100).filter_map(|_| held.take(at_ns)).collect::<Vec<_>>();
        let all = answered(1_500_000_000);
        assert_eq!(all.len(), MAX_ANSWERS_PER_S as usize);
        assert!(all.iter().all(|b| b.to_bytes()[..] == [2]));
        assert!(answered(1_999_999_999).is_empty());
        assert_eq!(answered(2_000_000_000).len(), MAX_ANSWERS_PER_S as usize);
    }
}

use std::collections::VecDeque;

use alight_shared::time::{Time, TrueTime};

/// Bounded queue of values, ordered by arrival time; values with equal times keep their order. When full, it
/// drops and counts new values.
#[derive(Clone, Debug)]
pub struct DelayLine<T> {
    queue: VecDeque<(Time<TrueTime>, T)>,
    capacity: usize,
    dropped: u64,
}

impl<T> DelayLine<T> {
    pub const fn new(capacity: usize) -> Self {
        DelayLine {
            queue: VecDeque::new(),
            capacity,
            dropped: 0,
        }
    }
    /// Returns false if the line is full.
    pub fn push(&mut self, arrival: Time<TrueTime>, value: T) -> bool {
        if self.queue.len() >= self.capacity {
            self.dropped += 1;
            return false;
        }
        // Arrivals are almost in order, so the search from the back is short.
        let at = self
            .queue
            .iter()
            .rposition(|(t, _)| *t <= arrival)
            .map_or(0, |i| i + 1);
        self.queue.insert(at, (arrival, value));
        true
    }
    pub fn pop(&mut self, now: Time<TrueTime>) -> Option<(Time<TrueTime>, T)> {
        let (arrival, _) = self.queue.front()?;
        if *arrival > now {
            return None;
        }
        self.queue.pop_front()
    }
    pub fn next(&self) -> Option<Time<TrueTime>> {
        self.queue.front().map(|(arrival, _)| *arrival)
    }
    pub fn arrived(&mut self, now: Time<TrueTime>) -> Vec<T> {
        core::iter::from_fn(|| self.pop(now)).map(|(_, v)| v).collect()
    }
    pub fn len(&self) -> usize {
        self.queue.len()
    }
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn delay_line_order_and_delay(delays in proptest::collection::vec(0_i64..50, 1..60)) {
            let mut line = DelayLine::new(100);
            for (k, d) in delays.iter().enumerate() {
                prop_assert!(line.push(Time::from_nanos(k as i64 + d), k));
            }
            let (mut received, mut last) = (vec![], Time::EPOCH);
            for now in 0..200 {
                while let Some((at, k)) = line.pop(Time::from_nanos(now)) {
                    prop_assert!(at.nanos() <= now && at >= last);
                    last = at;
                    received.push(k);
                }
            }
            received.sort_unstable();
            prop_assert_eq!(received, (0..delays.len()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn full_delay_line() {
        let mut line = DelayLine::new(2);
        assert!(line.push(Time::EPOCH, 1) && line.push(Time::EPOCH, 2) && !line.push(Time::EPOCH, 3));
        assert_eq!((line.len(), line.dropped()), (2, 1));
        assert_eq!(line.arrived(Time::EPOCH), vec![1, 2]);
        assert!(line.is_empty());
    }
}

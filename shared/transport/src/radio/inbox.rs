//! Messages waiting for the process, orders first. Each subscription and sender has one ring for orders and
//! one for others, which drops its oldest message when full.
//!
//! Zenoh's ring (`handlers::RingChannel`, 1.10) counts no drops and serves a whole subscription: one drone
//! that floods `alight/drone-$*/status` would displace the statuses of all others.

use std::{
    collections::{BTreeMap, VecDeque},
    sync::{Condvar, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use tokio::sync::Notify;

use crate::Received;
use alight_shared::admission::Sender;

/// Capacity of a ring (one sender on one subscription): two seconds of estimates, or a status of every peer.
const RING: usize = 64;
/// Capacity of all rings together: 4 MB of the longest messages.
const MAX_WAITING: usize = 1024;

/// Non-empty rings by subscription and sender.
#[derive(Debug, Default)]
struct Rings(BTreeMap<(usize, Sender), VecDeque<Received>>);

impl Rings {
    fn push(&mut self, received: Received) -> u64 {
        let ring = self
            .0
            .entry((received.subscription, received.sender))
            .or_default();
        ring.push_back(received);
        let is_full = ring.len() > RING;
        if is_full {
            ring.pop_front();
        } else if self.0.values().map(VecDeque::len).sum::<usize>() > MAX_WAITING {
            if let Some(longest) = self.0.values_mut().max_by_key(|r| r.len()) {
                longest.pop_front();
            }
            self.0.retain(|_, r| !r.is_empty());
        } else {
            return 0;
        }
        1
    }
    fn pop(&mut self) -> Option<Received> {
        let fronts = self
            .0
            .iter()
            .filter_map(|(key, r)| Some((r.front()?.at_ns, *key)));
        let (_, key) = fronts.min()?;
        let ring = self.0.get_mut(&key)?;
        let received = ring.pop_front();
        if ring.is_empty() {
            self.0.remove(&key);
        }
        received
    }
}

#[derive(Debug, Default)]
struct Waiting {
    orders: Rings,
    others: Rings,
}

impl Waiting {
    fn is_empty(&self) -> bool {
        self.orders.0.is_empty() && self.others.0.is_empty()
    }
}

#[derive(Debug, Default)]
pub(super) struct Inbox {
    waiting: Mutex<Waiting>,
    arrived: (Condvar, Notify),
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Adds a message. Returns the number of dropped messages.
    pub(super) fn put(&self, received: Received, is_order: bool) -> u64 {
        let mut waiting = self.lock();
        let rings = if is_order {
            &mut waiting.orders
        } else {
            &mut waiting.others
        };
        let dropped = rings.push(received);
        drop(waiting);
        self.arrived.0.notify_one();
        self.arrived.1.notify_one();
        dropped
    }
    /// Takes the first order, otherwise the first message; waits at most `timeout`.
    pub(super) fn take(&self, timeout: Duration) -> Option<Received> {
        let waited = self
            .arrived
            .0
            .wait_timeout_while(self.lock(), timeout, |w| w.is_empty());
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let order = waiting.orders.pop();
        order.or_else(|| waiting.others.pop())
    }
    pub(super) async fn arrival(&self) {
        while self.lock().is_empty() {
            self.arrived.1.notified().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: usize = 0;
    const ORDER: usize = 1;

    fn message(subscription: usize, sender: Sender, number: i64) -> Received {
        Received {
            subscription,
            sender,
            at_ns: number,
            bytes: Vec::new(),
        }
    }
    fn taken(inbox: &Inbox) -> Vec<(usize, Sender, i64)> {
        let next = || inbox.take(Duration::ZERO);
        let all = std::iter::from_fn(next).map(|r| (r.subscription, r.sender, r.at_ns));
        all.collect()
    }

    #[test]
    fn abort_behind_ten_thousand_states() {
        let inbox = Inbox::default();
        let vessel = Sender::Vessel(1);
        let dropped: u64 = (0..10_000)
            .map(|k| inbox.put(message(STATE, vessel, k), false))
            .sum();
        assert_eq!(inbox.put(message(ORDER, vessel, 10_000), true), 0);
        let taken = taken(&inbox);
        assert_eq!(taken[0], (ORDER, vessel, 10_000));
        let states: Vec<i64> = taken[1..].iter().map(|(_, _, number)| *number).collect();
        let newest: Vec<i64> = (10_000 - RING as i64..10_000).collect();
        assert_eq!((states, dropped), (newest, 10_000 - RING as u64));
    }

    #[test]
    fn abort_and_states_in_the_flood_of_a_peer() {
        let inbox = Inbox::default();
        let own = Sender::Operator(1);
        let loud = Sender::Operator(2);
        inbox.put(message(ORDER, own, 0), true);
        inbox.put(message(STATE, Sender::Drone(1), 1), false);
        for k in 2..10_000 {
            inbox.put(message(STATE, Sender::Drone(2), k), false);
            inbox.put(message(ORDER, loud, k), true);
        }
        let taken = taken(&inbox);
        assert_eq!(taken[0], (ORDER, own, 0));
        let is_order: Vec<bool> = taken.iter().map(|(of, ..)| *of == ORDER).collect();
        assert!(is_order.is_sorted_by(|a, b| a >= b), "all orders come first");
        assert!(taken.contains(&(STATE, Sender::Drone(1), 1)));
        assert_eq!(taken.last(), Some(&(STATE, Sender::Drone(2), 9_999)));
        assert_eq!(taken.len(), 2 + 2 * RING);
    }

    /// Without certificates, any program may publish under any name.
    #[test]
    fn messages_under_many_names() {
        let inbox = Inbox::default();
        let mut dropped = 0;
        for k in 0..3 * MAX_WAITING {
            let sender = Sender::Drone(k as u32);
            dropped += inbox.put(message(STATE, sender, k as i64), false);
        }
        assert_eq!(
            (taken(&inbox).len(), dropped),
            (MAX_WAITING, 2 * MAX_WAITING as u64)
        );
        for k in 0..10 {
            inbox.put(message(STATE, Sender::Vessel(1), k), false);
        }
        for k in 10..MAX_WAITING as i64 + 5 {
            inbox.put(message(STATE, Sender::Drone(k as u32), k), false);
        }
        let of_vessel = taken(&inbox);
        let of_vessel = of_vessel
            .iter()
            .filter(|(_, sender, _)| *sender == Sender::Vessel(1));
        let numbers: Vec<i64> = of_vessel.map(|(_, _, number)| *number).collect();
        assert_eq!(numbers, [5, 6, 7, 8, 9]);
    }

    #[test]
    fn order_of_arrival_over_all_senders() {
        let inbox = Inbox::default();
        for k in 0..30 {
            inbox.put(message(STATE, Sender::Drone(3 - k as u32 % 3), k), false);
        }
        let numbers: Vec<i64> = taken(&inbox).iter().map(|(_, _, number)| *number).collect();
        assert!(numbers.iter().copied().eq(0..30));
    }
}

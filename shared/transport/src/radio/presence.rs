//! Liveliness tokens: each side has one with its name, `alight/NAME`, until zenoh loses its session.
//!
//! They show which peers are connected. A frozen process keeps its token (measured), so no decision depends
//! on tokens, only on messages and their ages.

use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex, PoisonError},
};

use zenoh::{Wait, liveliness::LivelinessToken, sample::SampleKind};

use crate::access;
use alight_shared::admission::Sender;

const ALL: &str = "alight/*";
/// Maximum number of stored tokens: peers of both sides, and operators.
const MAX_PRESENT: usize = 2 * access::PEERS;

#[derive(Clone, Debug, Default)]
pub(super) struct Present(Arc<Mutex<BTreeSet<Sender>>>);

impl Present {
    pub(super) fn of(session: &zenoh::Session) -> zenoh::Result<Present> {
        let present = Present::default();
        let followed = present.clone();
        session
            .liveliness()
            .declare_subscriber(ALL)
            .history(true)
            .callback(move |sample| {
                let sender = Sender::of_key(sample.key_expr().as_str());
                followed.set(sender, sample.kind() == SampleKind::Put);
            })
            .background()
            .wait()?;
        Ok(present)
    }
    fn set(&self, sender: Sender, is_there: bool) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !is_there {
            all.remove(&sender);
        } else if all.len() < MAX_PRESENT {
            all.insert(sender);
        }
    }
    pub(super) fn count(&self, is_counted: impl Fn(&Sender) -> bool) -> usize {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.iter().filter(|s| is_counted(s)).count()
    }
}

pub(super) fn declare(session: &zenoh::Session, name: &str) -> zenoh::Result<LivelinessToken> {
    session.liveliness().declare_token(name.to_owned()).wait()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_of_more_peers_than_are_stored() {
        let present = Present::default();
        let drone = |k: usize| Sender::of_key(&format!("alight/drone-{k}"));
        for k in 1..=2 * MAX_PRESENT {
            present.set(drone(k), true);
        }
        assert_eq!(present.count(|_| true), MAX_PRESENT);
        present.set(drone(1), false);
        assert_eq!(present.count(|_| true), MAX_PRESENT - 1);
    }
}

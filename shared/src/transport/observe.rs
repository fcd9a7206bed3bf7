//! A look at every send from outside, for measurements. A process that flies sets none.

use std::sync::OnceLock;

/// Stands around the sends of a process.
pub trait SendObserver: Send + Sync {
    /// Calls `send` once. `name` is the topic's or the radio key's, `order` the message's boot and sequence
    /// number where it has them, `bytes` the message encoded.
    fn around(
        &self,
        name: &str,
        order: Option<(u32, u32)>,
        bytes: &dyn Fn() -> Option<Vec<u8>>,
        send: &mut dyn FnMut(),
    );
}

static OBSERVER: OnceLock<Box<dyn SendObserver>> = OnceLock::new();

/// Sets the observer of this process, before it makes publishers or a radio; false when there is one already.
pub fn observe(observer: Box<dyn SendObserver>) -> bool {
    OBSERVER.set(observer).is_ok()
}

pub(super) fn observer() -> Option<&'static dyn SendObserver> {
    OBSERVER.get().map(Box::as_ref)
}

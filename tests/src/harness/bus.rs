//! The bus in lock-step: a ring of a topic's newest messages, as many as shared memory holds, and a place in it for each reader.

use core::any::{Any, TypeId};
use core::cell::RefCell;
use core::convert::Infallible;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use alight_shared::bus::{self, Bus, Reader, Received, Writer};
use alight_shared::plain::Plain;
use alight_shared::process::InputState;

/// A topic's newest messages.
struct Ring<M> {
    /// Messages sent so far.
    sent: u64,
    newest: VecDeque<M>,
}

/// The rings of one computer, each made when the first port asks for it.
#[derive(Clone, Default)]
pub struct LockStep(Rc<RefCell<BTreeMap<TypeId, Rc<dyn Any>>>>);

impl LockStep {
    fn ring<M: Plain>(&self) -> Rc<RefCell<Ring<M>>> {
        let mut rings = self.0.borrow_mut();
        let made = || -> Rc<dyn Any> {
            Rc::new(RefCell::new(Ring::<M> {
                sent: 0,
                newest: VecDeque::with_capacity(M::TOPIC.buffer),
            }))
        };
        let ring = rings.entry(TypeId::of::<M>()).or_insert_with(made);
        Rc::clone(ring)
            .downcast()
            .unwrap_or_else(|_| unreachable!("a ring has its type's place"))
    }
    /// A port that cannot fail to open.
    pub fn sender<M: Plain>(&self) -> Sender<M> {
        Sender(self.ring())
    }
    /// A port that cannot fail to open: what is sent from now on.
    pub fn receiver<M: Plain>(&self) -> Receiver<M> {
        let ring = self.ring();
        let read = ring.borrow().sent;
        Receiver {
            ring,
            read,
            received: Received::of(M::TOPIC),
        }
    }
}

impl Bus for LockStep {
    type Error = Infallible;
    type Reader<M: Plain> = Receiver<M>;
    type Writer<M: Plain> = Sender<M>;
    type Wake = Wake;

    fn reader<M: Plain>(&self) -> Result<Receiver<M>, Infallible> {
        Ok(self.receiver())
    }
    fn writer<M: Plain>(&self) -> Result<Sender<M>, Infallible> {
        Ok(self.sender())
    }
    fn wake<M: Plain>(&self) -> Result<Wake, Infallible> {
        let ring = self.ring::<M>();
        let seen = ring.borrow().sent;
        Ok(Wake {
            sent: Box::new(move || ring.borrow().sent),
            seen,
        })
    }
}

/// Whether a topic brought something.
pub struct Wake {
    sent: Box<dyn Fn() -> u64>,
    seen: u64,
}

impl bus::Wake for Wake {
    fn woke(&mut self) -> bool {
        let sent = (self.sent)();
        core::mem::replace(&mut self.seen, sent) != sent
    }
}

/// Writes messages.
pub struct Sender<M>(Rc<RefCell<Ring<M>>>);

impl<M: Plain> Writer<M> for Sender<M> {
    fn send(&mut self, message: &M) {
        let mut ring = self.0.borrow_mut();
        if ring.newest.len() == M::TOPIC.buffer {
            // Who has not read it has missed it.
            ring.newest.pop_front();
        }
        ring.newest.push_back(*message);
        ring.sent += 1;
    }
    fn unsent(&self) -> u64 {
        0
    }
}

/// Reads messages.
pub struct Receiver<M> {
    ring: Rc<RefCell<Ring<M>>>,
    /// Of the messages sent so far.
    read: u64,
    received: Received,
}

impl<M: Plain> Receiver<M> {
    /// What has not been read yet.
    fn take<T>(&mut self, taken: impl FnOnce(&mut dyn Iterator<Item = &M>) -> T) -> T {
        let ring = self.ring.borrow();
        let new = usize::try_from(ring.sent - self.read).unwrap_or(usize::MAX);
        self.read = ring.sent;
        let old = ring.newest.len().saturating_sub(new);
        let received = &mut self.received;
        let mut new = ring
            .newest
            .iter()
            .skip(old)
            .inspect(|m| received.count(m.order(), m.at_ns()));
        taken(&mut new)
    }
}

impl<M: Plain> Reader<M> for Receiver<M> {
    fn newest(&mut self, _now_ns: i64) -> Option<M> {
        self.take(|new| new.last().copied())
    }
    fn all(&mut self, _now_ns: i64) -> Vec<M> {
        self.take(|new| new.copied().collect())
    }
    fn state(&self, now_ns: i64) -> InputState {
        self.received.state(now_ns)
    }
}

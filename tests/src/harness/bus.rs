//! Bus in lock-step. Each topic has a ring of its newest messages, with the capacity of the shared-memory
//! bus; each reader has its own position in the ring.
//!
//! A [`Wrapper`] between a row and the bus changes messages to simulate a fault, or a defect that a storm must detect.

use core::{
    any::{Any, TypeId},
    cell::RefCell,
    convert::Infallible,
};
use std::{
    collections::{BTreeMap, VecDeque},
    rc::Rc,
};

use alight_shared::{
    bus::{self, Bus, ReadCounts, Reader, Writer},
    plain::Plain,
    process::{InputState, ProcessKind},
};

struct Ring<M> {
    sent: u64,
    newest: VecDeque<M>,
}

/// Changes messages. Arguments: the reader's clock or the written message's stamp (ns), and the messages.
pub type Wrapper<M> = Box<dyn FnMut(i64, Vec<M>) -> Vec<M>>;
type Place<M> = Rc<RefCell<Option<Wrapper<M>>>>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum BusSide {
    Read,
    Written,
}

/// State shared by the ports of one computer; entries are created on first use.
#[derive(Default)]
struct Shared {
    rings: BTreeMap<TypeId, Rc<dyn Any>>,
    places: BTreeMap<(ProcessKind, BusSide, TypeId), Rc<dyn Any>>,
}

/// Bus of one computer, for one of its rows or an outside observer.
#[derive(Clone, Default)]
pub struct LockStep {
    shared: Rc<RefCell<Shared>>,
    row: Option<ProcessKind>,
}

fn typed<T: 'static>(made: &Rc<dyn Any>) -> Rc<T> {
    Rc::clone(made)
        .downcast()
        .unwrap_or_else(|_| unreachable!("it has its type's place"))
}

impl LockStep {
    pub fn of(&self, row: ProcessKind) -> LockStep {
        LockStep {
            shared: Rc::clone(&self.shared),
            row: Some(row),
        }
    }
    /// Installs a wrapper between a row and the bus. It replaces an earlier wrapper and survives restarts of the row.
    pub fn wrap<M: Plain>(
        &self,
        row: ProcessKind,
        way: BusSide,
        wrapper: impl FnMut(i64, Vec<M>) -> Vec<M> + 'static,
    ) {
        *self.of(row).place(way).borrow_mut() = Some(Box::new(wrapper));
    }
    fn place<M: Plain>(&self, way: BusSide) -> Place<M> {
        let made = || -> Rc<dyn Any> { Rc::new(RefCell::new(None::<Wrapper<M>>)) };
        let Some(row) = self.row else {
            return typed(&made());
        };
        let mut shared = self.shared.borrow_mut();
        typed(
            shared
                .places
                .entry((row, way, TypeId::of::<M>()))
                .or_insert_with(made),
        )
    }
    fn ring<M: Plain>(&self) -> Rc<RefCell<Ring<M>>> {
        let mut shared = self.shared.borrow_mut();
        let made = || -> Rc<dyn Any> {
            Rc::new(RefCell::new(Ring::<M> {
                sent: 0,
                newest: VecDeque::with_capacity(M::TOPIC.buffer),
            }))
        };
        typed(shared.rings.entry(TypeId::of::<M>()).or_insert_with(made))
    }
    pub fn sender<M: Plain>(&self) -> LockStepSender<M> {
        LockStepSender {
            ring: self.ring(),
            place: self.place(BusSide::Written),
        }
    }
    /// Receives messages sent from now on.
    pub fn receiver<M: Plain>(&self) -> Receiver<M> {
        let ring = self.ring();
        let read = ring.borrow().sent;
        Receiver {
            ring,
            read,
            received: ReadCounts::of(M::TOPIC),
            place: self.place(BusSide::Read),
        }
    }
}

impl Bus for LockStep {
    type Error = Infallible;
    type Reader<M: Plain> = Receiver<M>;
    type Writer<M: Plain> = LockStepSender<M>;
    type Wake = LockStepWake;

    fn reader<M: Plain>(&self) -> Result<Receiver<M>, Infallible> {
        Ok(self.receiver())
    }
    fn writer<M: Plain>(&self) -> Result<LockStepSender<M>, Infallible> {
        Ok(self.sender())
    }
    fn wake<M: Plain>(&self) -> Result<LockStepWake, Infallible> {
        let ring = self.ring::<M>();
        let counted = ring.borrow().sent;
        Ok(LockStepWake {
            sent: Box::new(move || ring.borrow().sent),
            counted,
        })
    }
}

pub struct LockStepWake {
    sent: Box<dyn Fn() -> u64>,
    counted: u64,
}

impl bus::Wake for LockStepWake {
    fn woke(&mut self) -> bool {
        let sent = (self.sent)();
        core::mem::replace(&mut self.counted, sent) != sent
    }
}

pub struct LockStepSender<M> {
    ring: Rc<RefCell<Ring<M>>>,
    place: Place<M>,
}

impl<M: Plain> LockStepSender<M> {
    fn put(&self, message: M) {
        let mut ring = self.ring.borrow_mut();
        if ring.newest.len() == M::TOPIC.buffer {
            // A reader that lags this far behind misses the message.
            ring.newest.pop_front();
        }
        ring.newest.push_back(message);
        ring.sent += 1;
    }
}

impl<M: Plain> Writer<M> for LockStepSender<M> {
    fn send(&mut self, message: &M) {
        if let Some(wrapper) = self.place.borrow_mut().as_mut() {
            let written = wrapper(message.at_ns(), vec![*message]);
            for m in written {
                self.put(m);
            }
        } else {
            self.put(*message);
        }
    }
    fn unsent(&self) -> u64 {
        0
    }
}

pub struct Receiver<M> {
    ring: Rc<RefCell<Ring<M>>>,
    read: u64,
    received: ReadCounts,
    place: Place<M>,
}

impl<M: Plain> Receiver<M> {
    fn each_new(&mut self, mut each: impl FnMut(&M)) {
        let ring = self.ring.borrow();
        let new = usize::try_from(ring.sent - self.read).unwrap_or(usize::MAX);
        self.read = ring.sent;
        let old = ring.newest.len().saturating_sub(new);
        for message in ring.newest.range(old..) {
            self.received.count(message.order(), message.at_ns());
            each(message);
        }
    }
}

impl<M: Plain> Reader<M> for Receiver<M> {
    fn read_newest(&mut self, now_ns: i64, to: &mut Option<M>) {
        if self.place.borrow().is_some() {
            *to = self.all(now_ns).pop();
            return;
        }
        *to = None;
        self.each_new(|message| *to = Some(*message));
    }
    fn read_all(&mut self, now_ns: i64, to: &mut Vec<M>) {
        to.clear();
        self.each_new(|message| to.push(*message));
        if let Some(wrapper) = self.place.borrow_mut().as_mut() {
            *to = wrapper(now_ns, core::mem::take(to));
        }
    }
    fn state(&self, now_ns: i64) -> InputState {
        self.received.state(now_ns)
    }
}

//! Keeps what a node must not forget while its process is started anew. The supervisor does this: it lives as
//! long as the flight.

use alight_shared::admission::Latest;
use alight_shared::msg::{LinkMemory, Message, MissionMemory, PredictorMemory};
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Memory, Publisher, Subscriber};
use alight_shared::transport::plain::Plain;

use crate::exit::CliError;

/// Keeps the memories of predictor, mission and link.
pub struct MemoryKeeper {
    predictor: Kept<PredictorMemory>,
    mission: Kept<MissionMemory>,
    link: Kept<LinkMemory>,
}

impl MemoryKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<MemoryKeeper, CliError> {
        Ok(MemoryKeeper {
            predictor: Kept::join(memory)?,
            mission: Kept::join(memory)?,
            link: Kept::join(memory)?,
        })
    }
    /// Takes the newest of each and says it on the same topic, where a node that begins looks for one of another
    /// boot; while there is none it says that.
    pub fn poll(&mut self, now: Time<DroneClock>) {
        self.predictor.poll(now);
        self.mission.poll(now);
        self.link.poll(now);
    }
}

/// One node's.
struct Kept<M: Plain> {
    written: Subscriber<M>,
    said: Publisher<M>,
    newest: Latest<M>,
}

impl<M: Plain + Message<Clock = DroneClock> + Default> Kept<M> {
    fn join(memory: &Memory) -> Result<Kept<M>, CliError> {
        Ok(Kept {
            written: memory.subscriber()?,
            said: memory.publisher()?,
            newest: Latest::default(),
        })
    }
    /// Its own words come back as what it knows already.
    fn poll(&mut self, now: Time<DroneClock>) {
        for m in self.written.all(now.nanos()) {
            if m.header().boot != 0 {
                self.newest.offer(now, &m);
            }
        }
        self.said.send(&self.newest.get().copied().unwrap_or_default());
    }
}

/// A node's own end of it: what the one before it left, and what it writes for the one after it.
pub struct OwnMemory<M: Plain> {
    written: Publisher<M>,
    /// None: this node has written, and what it would read there are its own words.
    before: Option<Subscriber<M>>,
}

impl<M: Plain> OwnMemory<M> {
    /// Looks for what the one before it left.
    pub fn join(memory: &Memory) -> Result<OwnMemory<M>, TransportError> {
        Ok(OwnMemory {
            written: memory.publisher()?,
            before: Some(memory.subscriber()?),
        })
    }
    /// What the one before it left, until this one writes; `t` is the drone's clock, ns.
    pub fn before(&mut self, t: i64) -> Option<M> {
        self.before.as_mut().and_then(|before| before.newest(t))
    }
    /// Writes, where there is something to write.
    pub fn write(&mut self, m: Option<&M>) {
        if m.is_some() {
            self.before = None;
        }
        self.written.send_any(m);
    }
    /// Messages that could not be published.
    pub fn unsent(&self) -> u64 {
        self.written.unsent()
    }
}

//! Keeps what a node must not forget while its process is started anew. The supervisor does this: it lives as
//! long as the flight.

use alight_shared::admission::Latest;
use alight_shared::msg::{LinkMemory, Message, MissionMemory};
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::memory::{Memory, Publisher, Subscriber};
use alight_shared::transport::plain::Plain;

use crate::exit::CliError;

/// Keeps the memories of mission and link.
pub struct MemoryKeeper {
    mission: Kept<MissionMemory>,
    link: Kept<LinkMemory>,
}

impl MemoryKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<MemoryKeeper, CliError> {
        Ok(MemoryKeeper {
            mission: Kept::join(memory)?,
            link: Kept::join(memory)?,
        })
    }
    /// Takes the newest of each and says it on the same topic, where a node that begins looks for one of another
    /// boot; while there is none it says that.
    pub fn poll(&mut self, now: Time<DroneClock>) {
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

//! Keeps what a mission must not forget while its process is started anew. The supervisor does this: it lives as
//! long as the flight.

use alight_shared::admission::Latest;
use alight_shared::msg::MissionMemory;
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::memory::{Memory, Publisher, Subscriber};

use crate::exit::CliError;

/// Keeps the mission's memory and says it again.
pub struct MemoryKeeper {
    written: Subscriber<MissionMemory>,
    said: Publisher<MissionMemory>,
    kept: Latest<MissionMemory>,
}

impl MemoryKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<MemoryKeeper, CliError> {
        Ok(MemoryKeeper {
            written: memory.subscriber()?,
            said: memory.publisher()?,
            kept: Latest::default(),
        })
    }
    /// Takes the newest and says it on the same topic, where a mission that begins looks for one of another boot;
    /// while there is none it says that. Its own words come back as what it knows already.
    pub fn poll(&mut self, now: Time<DroneClock>) {
        for m in self.written.all(now.nanos()) {
            if m.header.boot != 0 {
                self.kept.offer(now, &m);
            }
        }
        self.said.send(&self.kept.get().copied().unwrap_or_default());
    }
}

//! Keeps the nodes' checkpoints while their processes are restarted. The supervisor does this: it lives as long as the
//! flight.

use alight_shared::admission::Latest;
use alight_shared::msg::{LinkCheckpoint, Message, MissionCheckpoint, PredictorCheckpoint};
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::TransportError;
use alight_shared::transport::memory::{Memory, Publisher, Subscriber};
use alight_shared::transport::plain::Plain;

use crate::exit::CliError;

/// Keeps the checkpoints of predictor, mission and link.
pub struct CheckpointKeeper {
    predictor: Kept<PredictorCheckpoint>,
    mission: Kept<MissionCheckpoint>,
    link: Kept<LinkCheckpoint>,
}

impl CheckpointKeeper {
    /// Keeps nothing yet.
    pub fn join(memory: &Memory) -> Result<CheckpointKeeper, CliError> {
        Ok(CheckpointKeeper {
            predictor: Kept::join(memory)?,
            mission: Kept::join(memory)?,
            link: Kept::join(memory)?,
        })
    }
    /// Takes the newest of each and publishes it on the same topic, where a node that begins looks for one of another
    /// boot; while there is none it publishes that.
    pub fn poll(&mut self, now: Time<DroneClock>) {
        self.predictor.poll(now);
        self.mission.poll(now);
        self.link.poll(now);
    }
}

/// One node's.
struct Kept<M: Plain> {
    received: Subscriber<M>,
    published: Publisher<M>,
    newest: Latest<M>,
}

impl<M: Plain + Message<Clock = DroneClock> + Default> Kept<M> {
    fn join(memory: &Memory) -> Result<Kept<M>, CliError> {
        Ok(Kept {
            received: memory.subscriber()?,
            published: memory.publisher()?,
            newest: Latest::default(),
        })
    }
    /// It receives its own publications, which are no newer.
    fn poll(&mut self, now: Time<DroneClock>) {
        for m in self.received.all(now.nanos()) {
            if m.header().boot != 0 {
                self.newest.offer(now, &m);
            }
        }
        self.published
            .send(&self.newest.get().copied().unwrap_or_default());
    }
}

/// A node's own end: the checkpoint of a crashed predecessor, and its own for a successor.
pub struct OwnCheckpoint<M: Plain> {
    published: Publisher<M>,
    /// None: this node has published, and would receive its own.
    predecessor: Option<Subscriber<M>>,
}

impl<M: Plain> OwnCheckpoint<M> {
    /// Looks for a predecessor's.
    pub fn join(memory: &Memory) -> Result<OwnCheckpoint<M>, TransportError> {
        Ok(OwnCheckpoint {
            published: memory.publisher()?,
            predecessor: Some(memory.subscriber()?),
        })
    }
    /// The predecessor's, until this one publishes; `t` is the drone's clock, ns.
    pub fn predecessor(&mut self, t: i64) -> Option<M> {
        self.predecessor.as_mut().and_then(|p| p.newest(t))
    }
    /// Publishes its own, where it is due.
    pub fn publish(&mut self, m: Option<&M>) {
        if m.is_some() {
            self.predecessor = None;
        }
        self.published.send_any(m);
    }
    /// Messages that could not be published.
    pub fn unsent(&self) -> u64 {
        self.published.unsent()
    }
}

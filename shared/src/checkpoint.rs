//! Checkpoints from which a restarted node continues. A node publishes its checkpoint as it runs, and a
//! [`CheckpointStore`] stores the newest of each node. A restarted node waits for the stored checkpoint ([`Recovery`])
//! and validates it before use ([`validate`]).

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{
    admission::Latest,
    bus::{Bus, Reader as _, Writer as _},
    msg::{LinkCheckpoint, Message, MissionCheckpoint, PredictorCheckpoint, message_version},
    plain::Plain,
    schema,
    time::{DroneClock, DroneTime, Span, Time},
    topics,
    wire::{self, WireError},
};

/// Timeout for the stored checkpoint: 15 of its periods.
const TIMEOUT: Span = Span::from_millis(300);
/// Maximum time by which a checkpoint may lie ahead of its reader's clock.
const AHEAD: Span = Span::from_millis(50);

/// Reason for rejecting a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CheckpointRejection {
    /// Another layout version.
    Version,
    /// Written by another drone.
    OtherDrone,
    /// Too old, or from the future.
    Age,
    /// Contains a number outside the range that its writer produces.
    Damaged,
    /// Written in another boot of the computer, on another clock, or for another vessel.
    OtherOwner,
}

impl fmt::Display for CheckpointRejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            CheckpointRejection::Version => "of another version",
            CheckpointRejection::OtherDrone => "another drone's",
            CheckpointRejection::Age => "too old",
            CheckpointRejection::Damaged => "damaged",
            CheckpointRejection::OtherOwner => "of another boot of the computer, or of another vessel",
        })
    }
}

/// Start-up of a node that waits for the checkpoint of its crashed predecessor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recovery<M> {
    since: Option<DroneTime>,
    answer: Option<M>,
}

impl<M: Message<Clock = DroneClock> + Copy> Recovery<M> {
    /// Takes the checkpoint `given` to the node with this `boot`. Returns true on arrival or timeout.
    pub fn poll(&mut self, now: DroneTime, boot: u32, given: Option<&M>) -> bool {
        self.answer = given.filter(|m| m.header().boot != boot).copied().or(self.answer);
        self.answer.is_some() || self.waited(now) >= TIMEOUT
    }
    /// Time since the first poll.
    pub fn waited(&mut self, now: DroneTime) -> Span {
        now - *self.since.get_or_insert(now)
    }
    /// Checkpoint of the predecessor, not yet validated; None if none is stored (boot 0).
    pub fn checkpoint(&self) -> Option<M> {
        self.answer.filter(|m| m.header().boot != 0)
    }
}

/// Validates `m` at `now` for drone `drone`.
pub fn validate<M: Checkpoint>(now: DroneTime, drone: u32, m: &M) -> Result<(), CheckpointRejection> {
    let h = m.header();
    if h.version != message_version() {
        return Err(CheckpointRejection::Version);
    }
    if h.drone != drone {
        return Err(CheckpointRejection::OtherDrone);
    }
    if now - h.at < -AHEAD || now - h.at > M::MAX_AGE {
        return Err(CheckpointRejection::Age);
    }
    m.check().map_err(|_field| CheckpointRejection::Damaged)
}

/// Checkpoint of a node, with its place in the [`CheckpointStore`].
pub trait Checkpoint: Message<Clock = DroneClock> + Copy + Default {
    /// Age above which the checkpoint is rejected.
    const MAX_AGE: Span;
    /// Stored checkpoint of this kind.
    fn of(store: &CheckpointStore) -> &Latest<Self>;
    /// Stored checkpoint of this kind, mutable.
    fn of_mut(store: &mut CheckpointStore) -> &mut Latest<Self>;
}

macro_rules! kept {
    ($($field:ident: $checkpoint:ty, $topic:ident;)*) => {
        /// Stores the newest checkpoint of each node of a drone for a restart.
        #[derive(Clone, Debug, Default)]
        pub struct CheckpointStore { $($field: Latest<$checkpoint>,)* }

        /// Part of a [`CheckpointStore`] that is saved to a file.
        #[derive(Default, JsonSchema, Serialize, Deserialize)]
        struct Checkpoints { $($field: Option<$checkpoint>,)* }

        impl CheckpointStore {
            fn checkpoints(&self) -> Checkpoints {
                Checkpoints { $($field: self.$field.get().copied(),)* }
            }
            fn take_all(&mut self, now: DroneTime, kept: &Checkpoints) {
                $(self.take(now, kept.$field.as_ref());)*
            }
        }
        $(impl Checkpoint for $checkpoint {
            const MAX_AGE: Span = topics::$topic.stale_after;
            fn of(store: &CheckpointStore) -> &Latest<Self> {
                &store.$field
            }
            fn of_mut(store: &mut CheckpointStore) -> &mut Latest<Self> {
                &mut store.$field
            }
        })*
    };
}
kept! {
    predictor: PredictorCheckpoint, PREDICTOR_CHECKPOINT;
    mission: MissionCheckpoint, MISSION_CHECKPOINT;
    link: LinkCheckpoint, LINK_CHECKPOINT;
}

/// File with state that outlives a process, and the fields that validate it.
#[derive(Serialize, Deserialize)]
struct File {
    version: u64,
    owner: String,
    checksum: u64,
    kept: Vec<u8>,
}

impl File {
    fn checksum(&self) -> Result<u64, WireError> {
        wire::hash_record(&(self.version, &self.owner, &self.kept))
    }
}

/// File that outlives a process: `kept`, the hash of its layout, its owner (boot or vessel), and a checksum.
pub fn to_file<T: Serialize + JsonSchema>(owner: &str, kept: &T) -> Result<Vec<u8>, WireError> {
    let mut file = File {
        version: schema::hash(&schema::of::<T>()),
        owner: owner.into(),
        checksum: 0,
        kept: wire::encode_record(kept)?,
    };
    file.checksum = file.checksum()?;
    wire::encode_record(&file)
}

/// Reads a file written by [`to_file`]. The file must be complete, and its layout and owner must match.
pub fn of_file<T: DeserializeOwned + JsonSchema>(owner: &str, file: &[u8]) -> Result<T, CheckpointRejection> {
    let damaged = |_: WireError| CheckpointRejection::Damaged;
    let file: File = wire::decode_record(file).map_err(damaged)?;
    if file.version != schema::hash(&schema::of::<T>()) {
        return Err(CheckpointRejection::Version);
    }
    if file.checksum != file.checksum().map_err(damaged)? {
        return Err(CheckpointRejection::Damaged);
    }
    if file.owner != owner {
        return Err(CheckpointRejection::OtherOwner);
    }
    wire::decode_record(&file.kept).map_err(damaged)
}

impl CheckpointStore {
    /// Takes a checkpoint published by a node. Returns whether it is newer than the stored one.
    pub fn take<M: Checkpoint>(&mut self, now: DroneTime, m: Option<&M>) -> bool {
        m.filter(|m| m.header().boot != 0)
            .is_some_and(|m| M::of_mut(self).offer(now, m))
    }
    /// Newest checkpoint; boot 0 without one.
    pub fn newest<M: Checkpoint>(&self) -> M {
        M::of(self).get().copied().unwrap_or_default()
    }
    /// Stored checkpoint for the node with this `boot`; None once it has published its own.
    pub fn answer<M: Checkpoint>(&self, boot: u32) -> Option<M> {
        Some(self.newest()).filter(|m: &M| m.header().boot != boot)
    }
    /// Part that remains valid across a reboot of the computer: the purpose of the flight.
    pub fn lasting(&self) -> CheckpointStore {
        let mut kept = CheckpointStore::default();
        let mission = self.mission.get().and_then(MissionCheckpoint::lasting);
        let link = self.link.get().and_then(LinkCheckpoint::lasting);
        kept.take(Time::EPOCH, mission.as_ref());
        kept.take(Time::EPOCH, link.as_ref());
        kept
    }
    /// Whether it holds no checkpoint.
    pub fn is_empty(&self) -> bool {
        self.predictor.get().is_none() && self.mission.get().is_none() && self.link.get().is_none()
    }
    /// Content of the file. The clock of the checkpoints restarts at each boot; `computer_boot` names it.
    pub fn encode(&self, computer_boot: &str) -> Result<Vec<u8>, WireError> {
        to_file(computer_boot, &self.checkpoints())
    }
    /// Restores the checkpoints of an earlier file.
    pub fn restore(
        &mut self,
        now: DroneTime,
        computer_boot: &str,
        file: &[u8],
    ) -> Result<(), CheckpointRejection> {
        self.take_all(now, &of_file(computer_boot, file)?);
        Ok(())
    }
}

/// Bus endpoint of the supervisor: takes the newest checkpoint of each node into a [`CheckpointStore`] and
/// publishes it on the same topic, where a starting node reads a checkpoint from another boot. Without a
/// checkpoint it publishes one with boot 0.
pub struct Republisher<B: Bus> {
    store: CheckpointStore,
    predictor: Republished<B, PredictorCheckpoint>,
    mission: Republished<B, MissionCheckpoint>,
    link: Republished<B, LinkCheckpoint>,
}

impl<B: Bus> Republisher<B> {
    /// Starts with the checkpoints in `store`.
    pub fn join(bus: &B, store: CheckpointStore) -> Result<Republisher<B>, B::Error> {
        Ok(Republisher {
            store,
            predictor: Republished::join(bus)?,
            mission: Republished::join(bus)?,
            link: Republished::join(bus)?,
        })
    }
    /// Takes published checkpoints. Returns whether one is new.
    pub fn take(&mut self, now: DroneTime) -> bool {
        let new = [
            self.predictor.take(now, &mut self.store),
            self.mission.take(now, &mut self.store),
            self.link.take(now, &mut self.store),
        ];
        new.contains(&true)
    }
    /// Takes new checkpoints and publishes the newest of each.
    pub fn poll(&mut self, now: DroneTime) -> bool {
        let new = self.take(now);
        self.predictor.own.send(&self.store.newest());
        self.mission.own.send(&self.store.newest());
        self.link.own.send(&self.store.newest());
        new
    }
    /// Stored checkpoints.
    pub const fn store(&self) -> &CheckpointStore {
        &self.store
    }
    /// Stored checkpoints, mutable.
    pub const fn store_mut(&mut self) -> &mut CheckpointStore {
        &mut self.store
    }
}

struct Republished<B: Bus, M: Plain> {
    nodes: B::Reader<M>,
    own: B::Writer<M>,
}

impl<B: Bus, M: Plain + Checkpoint> Republished<B, M> {
    fn join(bus: &B) -> Result<Self, B::Error> {
        Ok(Republished {
            nodes: bus.reader()?,
            own: bus.writer()?,
        })
    }
    /// Returns whether a new checkpoint arrived. The endpoint also receives its own publications, which are never newer.
    fn take(&mut self, now: DroneTime, store: &mut CheckpointStore) -> bool {
        let taken = |new, m| store.take(now, Some(&m)) | new;
        self.nodes.all(now.nanos()).into_iter().fold(false, taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::Header;

    fn at(s: f64) -> DroneTime {
        Time::from_secs(s)
    }
    fn mission(boot: u32, s: f64) -> MissionCheckpoint {
        let header = Header::new(1, 1, boot, 1, at(s));
        let mut m = MissionCheckpoint {
            header,
            ..MissionCheckpoint::default()
        };
        m.state.header = header;
        m
    }
    fn store() -> CheckpointStore {
        let mut k = CheckpointStore::default();
        assert!(k.take(at(1.0), Some(&mission(7, 1.0))));
        k
    }

    #[test]
    fn store_answer_to_a_successor() {
        let mut k = store();
        assert!(
            !k.take(at(1.0), Some(&mission(7, 0.9))) && !k.take(at(1.0), Some(&MissionCheckpoint::default()))
        );
        assert_eq!(k.answer(7), None::<MissionCheckpoint>);
        assert_eq!(k.answer(8), Some(mission(7, 1.0)));
        assert_eq!(k.answer(8), Some(LinkCheckpoint::default()));
    }

    #[test]
    fn store_file_round_trip() {
        let file = store().encode("this boot").unwrap();
        let mut k = CheckpointStore::default();
        assert_eq!(k.restore(at(1.5), "this boot", &file), Ok(()));
        assert_eq!(k.answer(8), Some(mission(7, 1.0)));
    }

    /// After a reboot, whatever the new clock reads, the purpose of the flight survives, and no checkpoint counts as fresh.
    #[test]
    fn store_after_a_reboot() {
        assert!(store().lasting().is_empty());
        let mut k = CheckpointStore::default();
        let away = MissionCheckpoint {
            armed: true,
            sortie: true,
            landing: true,
            ..mission(7, 900.0)
        };
        let link = LinkCheckpoint {
            header: away.header,
            commanding: true,
            own_mission: true,
            ..LinkCheckpoint::default()
        };
        assert!(k.take(at(900.0), Some(&away)) && k.take(at(900.0), Some(&link)));
        let file = k.lasting().encode("").unwrap();
        let mut k = CheckpointStore::default();
        assert_eq!(k.restore(at(0.1), "", &file), Ok(()));
        let kept = k.newest::<MissionCheckpoint>();
        let link = k.newest::<LinkCheckpoint>();
        assert!(kept.sortie && kept.landing && link.own_mission && !link.commanding);
        for now in [0.1, 3.0, 1000.0].map(at) {
            assert_eq!(validate(now, 1, &kept), Err(CheckpointRejection::Age));
        }
        assert!(k.take(at(1.0), Some(&mission(7, 1.0))));
        assert_eq!(k.answer(8), Some(mission(7, 1.0)));
    }

    #[test]
    fn store_file_rejection() {
        let file = store().encode("this boot").unwrap();
        let restored = |boot: &str, file: &[u8]| {
            let mut k = CheckpointStore::default();
            let result = k.restore(at(1.5), boot, file);
            assert_eq!(k.newest::<MissionCheckpoint>().header.boot == 7, result.is_ok());
            result
        };
        assert_eq!(
            restored("another boot", &file),
            Err(CheckpointRejection::OtherOwner)
        );
        assert_eq!(restored("this boot", &[]), Err(CheckpointRejection::Damaged));
        for at in 0..file.len() {
            let mut flipped = file.clone();
            let mut cut = file.clone();
            flipped[at] ^= 1;
            cut.truncate(at);
            assert!(restored("this boot", &flipped).is_err(), "{at}");
            assert_eq!(
                restored("this boot", &cut),
                Err(CheckpointRejection::Damaged),
                "{at}"
            );
        }
        let mut old = file.clone();
        old[0] += 1;
        assert_eq!(restored("this boot", &old), Err(CheckpointRejection::Version));
    }
}

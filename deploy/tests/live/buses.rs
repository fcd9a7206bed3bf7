//! Test suite for both buses: the simulated world's bus must carry topics as shared memory does.

use core::fmt::Debug;

use alight_shared::{
    admission::Latest,
    bus::{Bus, Reader, Wake, Writer},
    msg::{Header, RangeSample, SetPoint},
    plain::Plain,
    time::{DroneTime, Span, Time},
};
use alight_sim::harness::bus::LockStep;
use alight_transport::memory::{Instance, Memory, Services};
use proptest::{collection::vec, prelude::*};

fn in_memory(name: &str, suite: impl FnOnce(&Memory)) {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    instance.wipe().unwrap();
    let memory = Memory::join(&instance, "test").unwrap();
    let services = Services::create(&memory).unwrap();
    suite(&memory);
    drop((services, memory));
    instance.wipe().unwrap();
}

fn at(ms: i64) -> DroneTime {
    Time::from_nanos(ms * 1_000_000)
}
fn range(boot: u32, k: u32) -> RangeSample {
    RangeSample {
        header: Header::new(1, 1, boot, k, at(i64::from(k))),
        range_m: f64::from(k),
        variance: 1.0,
    }
}
fn set_point(k: u32) -> SetPoint {
    SetPoint {
        header: range(1, k).header,
        ..SetPoint::default()
    }
}
fn numbers(read: &[RangeSample]) -> Vec<u32> {
    read.iter().map(|m| m.header.sequence).collect()
}
fn counts<M>(reader: &impl Reader<M>) -> (u64, u64) {
    let state = reader.state(0);
    (state.received, state.missed)
}

fn conforms<B: Bus<Error: Debug>>(bus: &B) {
    newest_and_all(bus);
    full_queue(bus);
    restarts(bus);
    wakes(bus);
    stale(bus);
}

/// A state's reader gets the newest message once; a queue's reader gets all messages in order.
fn newest_and_all<B: Bus<Error: Debug>>(bus: &B) {
    let mut states = bus.writer().unwrap();
    let mut events = bus.writer().unwrap();
    let mut newest = bus.reader::<SetPoint>().unwrap();
    let mut all = bus.reader().unwrap();
    for k in 1..=10 {
        states.send(&set_point(k));
        events.send(&range(1, k));
    }
    assert_eq!(newest.newest(0), Some(set_point(10)));
    assert_eq!(newest.newest(0), None);
    assert_eq!(numbers(&all.all(0)), (1..=10).collect::<Vec<_>>());
    assert!(all.all(0).is_empty());
    assert_eq!((states.unsent(), events.unsent()), (0, 0));
}

/// A full queue drops the oldest message, and the reader counts it.
fn full_queue<B: Bus<Error: Debug>>(bus: &B) {
    let depth = RangeSample::TOPIC.buffer as u32;
    let mut writer = bus.writer().unwrap();
    let mut reader = bus.reader().unwrap();
    writer.send(&range(2, 1));
    assert_eq!(numbers(&reader.all(0)), [1]);
    let sent = 2..=depth + 6;
    for k in sent {
        writer.send(&range(2, k));
    }
    assert_eq!(numbers(&reader.all(0)), (7..=depth + 6).collect::<Vec<_>>());
    assert_eq!(counts(&reader), (1 + u64::from(depth), 5));
    assert_eq!(writer.unsent(), 0, "a writer does not wait for a reader");
}

/// Messages of a restarted writer are also read; a restarted or late reader gets the messages sent afterwards.
fn restarts<B: Bus<Error: Debug>>(bus: &B) {
    let mut writer = bus.writer().unwrap();
    let mut reader = bus.reader().unwrap();
    writer.send(&range(3, 90));
    drop(writer);
    let mut writer = bus.writer().unwrap();
    writer.send(&range(4, 1));
    assert_eq!(numbers(&reader.all(0)), [90, 1]);
    assert_eq!(counts(&reader), (2, 0));
    writer.send(&range(4, 2));
    drop(reader);
    let mut reader = bus.reader::<RangeSample>().unwrap();
    assert!(reader.all(0).is_empty());
    let mut second = bus.writer().unwrap();
    writer.send(&range(4, 3));
    second.send(&range(5, 1));
    let mut late = bus.reader::<RangeSample>().unwrap();
    let mut read = numbers(&reader.all(0));
    read.sort_unstable();
    assert_eq!(read, [1, 3]);
    assert!(late.all(0).is_empty());
}

/// Each message that was not yet awaited wakes the reader, whether it was read or not.
fn wakes<B: Bus<Error: Debug>>(bus: &B) {
    let mut writer = bus.writer().unwrap();
    writer.send(&range(6, 1));
    let mut wake = bus.wake::<RangeSample>().unwrap();
    assert!(!wake.woke());
    writer.send(&range(6, 2));
    writer.send(&range(6, 3));
    assert!(wake.woke() && !wake.woke());
}

/// A message older than its topic's limit can be read, but does not count as a fresh input.
fn stale<B: Bus<Error: Debug>>(bus: &B) {
    let mut writer = bus.writer().unwrap();
    let mut reader = bus.reader().unwrap();
    let limit = SetPoint::TOPIC.stale_after;
    let fresh = |latest: &Latest<SetPoint>, now| latest.fresh(now, limit).is_some();
    let mut latest = Latest::default();
    writer.send(&set_point(20));
    let now = at(20) + limit + Span::from_millis(1);
    let read = reader.newest(now.nanos()).unwrap();
    assert!(latest.offer(now, &read) && !fresh(&latest, now) && fresh(&latest, at(20) + limit));
    assert!(reader.state(now.nanos()).age_s > limit.secs());
}

#[test]
fn lock_step_conforms() {
    conforms(&LockStep::default());
}

#[test]
fn shared_memory_conforms() {
    in_memory("buses", conforms);
}

#[derive(Clone, Copy, Debug)]
enum Happens {
    Sends(usize),
    /// Number of the reader, and whether it reads the newest message or all.
    Reads(usize, bool),
    Restarts,
    Rejoins(usize),
}

const PORTS: usize = 3;

fn happens() -> impl Strategy<Value = Happens> {
    prop_oneof![
        8 => (0..PORTS).prop_map(Happens::Sends),
        3 => (0..PORTS, any::<bool>()).prop_map(|(k, all)| Happens::Reads(k, all)),
        1 => Just(Happens::Restarts),
        1 => (0..PORTS).prop_map(Happens::Rejoins),
    ]
}

/// Messages and counts that the readers get during these events. Readers receive from one writer at a time, because
/// the order of messages from two writers depends on the bus.
fn read<B: Bus<Error: Debug>>(bus: &B, all: &[Happens]) -> Vec<(Vec<RangeSample>, (u64, u64))> {
    let join = |_| bus.reader::<RangeSample>().unwrap();
    let mut readers = [0; PORTS].map(join);
    let mut writer = bus.writer().unwrap();
    let mut boot = 1;
    let mut sequence = 0;
    let mut read = Vec::new();
    for happens in all {
        match *happens {
            Happens::Sends(n) => {
                for _ in 0..=n * 4 {
                    sequence += 1;
                    writer.send(&range(boot, sequence));
                }
            }
            Happens::Reads(k, true) => read.push((readers[k].all(0), counts(&readers[k]))),
            Happens::Reads(k, false) => {
                let newest = readers[k].newest(0).into_iter().collect();
                read.push((newest, counts(&readers[k])));
            }
            Happens::Restarts => {
                // Shared memory loses the messages of a writer that ends before a reader's first read.
                read.extend(readers.iter_mut().map(|r| (r.all(0), counts(r))));
                boot += 1;
                sequence = 0;
                drop(writer);
                writer = bus.writer().unwrap();
            }
            Happens::Rejoins(k) => readers[k] = join(0),
        }
    }
    read
}

#[test]
fn both_buses_alike() {
    in_memory("buses-alike", |memory| {
        proptest!(ProptestConfig::with_cases(64), |(all in vec(happens(), 1..60))| {
            prop_assert_eq!(read(memory, &all), read(&LockStep::default(), &all));
        });
    });
}

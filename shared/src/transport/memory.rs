//! Shared memory between the processes of one computer: iceoryx2 services, one per topic, declared
//! once with their quality of service in [`crate::topics`].
//!
//! The settings of a service are those of whoever creates it first, and a process that dies while
//! it creates one can leave it unusable. So one process, the supervisor, creates all services
//! ([`Services::create`]) before any other begins, and the others only open them.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::node::{Node as IoxNode, NodeWaitFailure};
use iceoryx2::port::listener::Listener as IoxListener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::msg::{self, MESSAGE_VERSION};
use crate::time::DroneClock;
use crate::topics::Topic;
use crate::transport::TransportError;
use crate::transport::images::{self, ImagePublisher, ImageSubscriber};
use crate::transport::plain::Plain;
use crate::transport::process::ProcessState;
use crate::transport::relay::{Copier, RELAYED, key_in_memory};
use crate::transport::statistics::InputStatistics;
use crate::wire;

/// The kind of iceoryx2 service: between processes, ports used by one thread each.
pub(crate) type Ipc = ipc::Service;

/// Publishers of one topic: each process of a computer may publish its state, and one that was
/// killed keeps its place until it is cleaned up.
const PUBLISHERS: usize = 16;
/// Subscribers of one topic: all processes, and people who look on.
const SUBSCRIBERS: usize = 24;
/// Processes that have a topic open.
const NODES: usize = 32;
/// Directory of the installed services (RuntimeDirectory and TMPDIR in their units).
const SERVICE: &str = "/run/alight";
/// Most messages that one call reads: a publisher that runs wild does not hold its reader.
const MAX_PER_READ: usize = 64;

/// One set of processes on a computer; several may run side by side under different names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
}

impl Instance {
    /// The instance `name`: 1 to 32 of a-z, 0-9 and '-'.
    pub fn new(name: &str) -> Result<Instance, TransportError> {
        let fits = (1..=32).contains(&name.len())
            && name
                .bytes()
                .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
        if fits {
            Ok(Instance { name: name.into() })
        } else {
            Err(TransportError {
                doing: format!("naming the instance {name:?}"),
                what: "a name is 1 to 32 of a-z, 0-9 and '-'".into(),
            })
        }
    }
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Where it keeps its files beside shared memory: where a service keeps them if there is one of
    /// this name, so that an operator's commands find it, else among temporary files.
    pub fn directory(&self) -> PathBuf {
        let name = format!("alight-{}", self.name);
        let of_service = std::path::Path::new(SERVICE).join(&name);
        if of_service.exists() {
            of_service
        } else {
            std::env::temp_dir().join(name)
        }
    }
    /// The beginning of the names of its files in shared memory.
    pub fn prefix(&self) -> String {
        format!("alight_{}_", self.name)
    }
    /// Removes everything the instance left in shared memory and in its middleware's directory. To
    /// be called only while none of its processes lives.
    pub fn wipe(&self) -> std::io::Result<()> {
        let prefix = self.prefix();
        for directory in ["/dev/shm", "/tmp"] {
            let Ok(entries) = std::fs::read_dir(directory) else {
                continue;
            };
            for entry in entries.flatten() {
                if entry.file_name().to_string_lossy().starts_with(&prefix) {
                    // Another file that vanished meanwhile is as good as removed.
                    let _gone = std::fs::remove_file(entry.path());
                }
            }
        }
        match std::fs::remove_dir_all(self.middleware()) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(e),
            Ok(()) | Err(_) => Ok(()),
        }
    }
    fn middleware(&self) -> PathBuf {
        self.directory().join("iceoryx2")
    }
    fn config(&self) -> Result<Config, TransportError> {
        let fail = |e| TransportError::because(format!("naming the files of instance {}", self.name), e);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(fail)?;
        let root = format!("{}/", self.middleware().display());
        config
            .global
            .set_root_path(&Path::new(root.as_bytes()).map_err(fail)?);
        Ok(config)
    }
}

/// A process's place in shared memory.
pub struct Memory {
    node: IoxNode<Ipc>,
    copies: Option<PathBuf>,
}

/// A name that only processes of the same program share: the version of the messages' layout and of
/// the package are part of it.
fn service_name(topic: &Topic) -> Result<ServiceName, TransportError> {
    named(topic.name)
}
fn named(name: &str) -> Result<ServiceName, TransportError> {
    let name = format!("{name}/m{MESSAGE_VERSION}/{}", env!("CARGO_PKG_VERSION"));
    ServiceName::new(&name).map_err(|e| TransportError::because(format!("naming the service {name}"), e))
}

impl Memory {
    /// Joins `instance` under the name of a process.
    pub fn join(instance: &Instance, process: &str) -> Result<Memory, TransportError> {
        // What the middleware has to say reaches a person through the errors it returns.
        set_log_level(LogLevel::Fatal);
        let doing = || format!("joining the shared memory of instance {}", instance.name);
        std::fs::create_dir_all(instance.middleware()).map_err(|e| TransportError::because(doing(), e))?;
        let name = NodeName::new(process).map_err(|e| TransportError::because(doing(), e))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&instance.config()?)
            .create::<Ipc>()
            .map_err(|e| TransportError::because(doing(), e))?;
        Ok(Memory { node, copies: None })
    }
    /// From now on publishers of [`RELAYED`] send a copy of every message to the Unix socket `path` too.
    pub fn copy_to(&mut self, path: PathBuf) {
        self.copies = Some(path);
    }
    /// Removes what processes that were killed left behind.
    pub fn reap(&self) {
        let _left = self.node.try_cleanup_dead_nodes();
    }
    /// Waits, no longer than `span`; false when the process was asked to end. Another signal only
    /// cuts the wait short.
    pub fn wait(&self, span: Duration) -> bool {
        !matches!(self.node.wait(span), Err(NodeWaitFailure::TerminationRequest))
    }

    fn messages<T: Plain>(&self) -> Result<MessageBuilder<T>, TransportError> {
        Ok(self
            .node
            .service_builder(&service_name(T::TOPIC)?)
            .publish_subscribe::<T>()
            .enable_safe_overflow(true)
            .history_size(0)
            .subscriber_max_buffer_size(T::TOPIC.buffer)
            .subscriber_max_borrowed_samples(2)
            .max_publishers(PUBLISHERS)
            .max_subscribers(SUBSCRIBERS)
            .max_nodes(NODES))
    }
    fn events(
        &self,
        topic: &Topic,
    ) -> Result<iceoryx2::service::builder::event::Builder<Ipc>, TransportError> {
        Ok(self
            .node
            .service_builder(&service_name(topic)?)
            .event()
            .max_notifiers(PUBLISHERS)
            .max_listeners(SUBSCRIBERS)
            .max_nodes(NODES)
            .event_id_max_value(1))
    }
    /// A publisher of messages `T`, on their topic.
    pub fn publisher<T: Plain>(&self) -> Result<Publisher<T>, TransportError> {
        let doing = || format!("publishing {}", T::TOPIC.name);
        let fail = |e: &dyn core::fmt::Debug| TransportError::because(doing(), e);
        let port = self
            .messages::<T>()?
            .open()
            .map_err(|e| fail(&e))?
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| fail(&e))?;
        let notifier = self
            .events(T::TOPIC)?
            .open()
            .map_err(|e| fail(&e))?
            .notifier_builder()
            .create()
            .map_err(|e| fail(&e))?;
        let relayed = RELAYED.iter().position(|t| t.name == T::TOPIC.name);
        let copier = match (&self.copies, relayed.and_then(|k| u32::try_from(k).ok())) {
            (Some(path), Some(topic)) => Some((topic, Copier::unix(path)?)),
            (Some(_), None) | (None, _) => None,
        };
        Ok(Publisher {
            out: Out {
                port,
                notifier,
                unsent: 0,
            },
            copier,
        })
    }
    /// A subscriber to messages `T`, on their topic.
    pub fn subscriber<T: Plain>(&self) -> Result<Subscriber<T>, TransportError> {
        let fail =
            |e: &dyn core::fmt::Debug| TransportError::because(format!("reading {}", T::TOPIC.name), e);
        let port = self
            .messages::<T>()?
            .open()
            .map_err(|e| fail(&e))?
            .subscriber_builder()
            .buffer_size(T::TOPIC.buffer)
            .create()
            .map_err(|e| fail(&e))?;
        Ok(Subscriber {
            port,
            intake: InputStatistics::new(T::TOPIC),
        })
    }
    /// A publisher of images of at most `pixels`.
    pub fn image_publisher(&self, pixels: usize) -> Result<ImagePublisher, TransportError> {
        ImagePublisher::open(&self.node, &named(images::NAME)?, pixels)
    }
    /// A subscriber to images.
    pub fn image_subscriber(&self) -> Result<ImageSubscriber, TransportError> {
        ImageSubscriber::open(&self.node, &named(images::NAME)?)
    }
    /// Wakes up when a message `T` is published.
    pub fn listener<T: Plain>(&self) -> Result<Listener, TransportError> {
        let doing = || format!("listening for {}", T::TOPIC.name);
        let events = self
            .events(T::TOPIC)?
            .open()
            .map_err(|e| TransportError::because(doing(), e))?;
        let port = events
            .listener_builder()
            .create()
            .map_err(|e| TransportError::because(doing(), e))?;
        Ok(Listener { port })
    }
}

type MessageBuilder<T> = iceoryx2::service::builder::publish_subscribe::Builder<T, (), Ipc>;

/// What holds one service open.
type Held = (Box<dyn core::any::Any>, event::PortFactory<Ipc>);

/// All services of an instance, held open by the one process that creates them.
pub struct Services {
    held: Vec<Held>,
    /// That of images, which are no messages.
    _images: images::ImageService,
}

impl Services {
    /// Creates the service of every topic of shared memory.
    pub fn create(memory: &Memory) -> Result<Services, TransportError> {
        let mut services = Services {
            held: Vec::new(),
            _images: images::ImageService::create(&memory.node, &named(images::NAME)?)?,
        };
        macro_rules! each {
            ($($ty:ty),* $(,)?) => { $(services.add::<$ty>(memory)?;)* };
        }
        each!(
            msg::DroneState,
            msg::AutopilotState,
            msg::TagPose,
            msg::UvdarFix,
            msg::RangeSample,
            msg::LinkState,
            msg::VesselEstimate<DroneClock>,
            msg::WaveModel<DroneClock>,
            msg::VesselPrediction<DroneClock>,
            msg::DeckGrant<DroneClock>,
            msg::DeckForecast,
            msg::MissionState,
            msg::Plan,
            msg::SetPoint,
            msg::Command,
            ProcessState,
        );
        Ok(services)
    }
    fn add<T: Plain>(&mut self, memory: &Memory) -> Result<(), TransportError> {
        let fail =
            |e: &dyn core::fmt::Debug| TransportError::because(format!("creating {}", T::TOPIC.name), e);
        let messages: publish_subscribe::PortFactory<Ipc, T, ()> =
            memory.messages::<T>()?.create().map_err(|e| fail(&e))?;
        let events = memory.events(T::TOPIC)?.create().map_err(|e| fail(&e))?;
        self.held.push((Box::new(messages), events));
        Ok(())
    }
    /// How many there are.
    pub fn len(&self) -> usize {
        self.held.len()
    }
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }
}

/// Publishes messages `T`.
pub struct Publisher<T: Plain> {
    out: Out<T>,
    /// Where copies go, and the topic's index there; for trials.
    copier: Option<(u32, Copier)>,
}

struct Out<T: Plain> {
    port: IoxPublisher<Ipc, T, ()>,
    notifier: Notifier<Ipc>,
    unsent: u64,
}

impl<T: Plain> Out<T> {
    fn send(&mut self, message: &T) {
        let sent = self
            .port
            .loan_uninit()
            .is_ok_and(|slot| slot.write_payload(*message).send().is_ok());
        if !sent {
            self.unsent += 1;
            return;
        }
        // A listener that cannot be woken finds the message at its next wake-up.
        let _woken = self.notifier.notify();
    }
}

impl<T: Plain> Publisher<T> {
    /// Writes `message` into shared memory and wakes who listens. Never blocks: a subscriber that
    /// does not read loses the oldest.
    pub fn send(&mut self, message: &T) {
        let out = &mut self.out;
        match (&mut self.copier, message.order()) {
            (Some((topic, copier)), Some(order)) => copier.beside(
                *topic,
                key_in_memory(T::TOPIC, order),
                || wire::encode_record(message).ok(),
                || out.send(message),
            ),
            (Some(_), None) | (None, _) => out.send(message),
        }
    }
    /// The same for a message that may be there.
    pub fn send_any(&mut self, message: Option<&T>) {
        if let Some(message) = message {
            self.send(message);
        }
    }
    /// Messages that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.out.unsent
    }
}

/// Wakes a process up.
pub struct Listener {
    pub(crate) port: IoxListener<Ipc>,
}

/// Reads messages `T`.
pub struct Subscriber<T: Plain> {
    port: IoxSubscriber<Ipc, T, ()>,
    intake: InputStatistics,
}

impl<T: Plain> Subscriber<T> {
    /// The newest message that waits, if any does; `now_ns` is the clock of its stamps.
    pub fn newest(&mut self, now_ns: i64) -> Option<T> {
        self.all(now_ns).pop()
    }
    /// All messages that wait, in order, at most [`MAX_PER_READ`].
    pub fn all(&mut self, now_ns: i64) -> Vec<T> {
        let mut messages = Vec::new();
        while messages.len() < MAX_PER_READ {
            // An error is a publisher that went away in the middle: what it sent is lost, and the
            // next read looks again.
            let Ok(Some(sample)) = self.port.receive() else {
                break;
            };
            let message: T = *sample;
            self.intake.note(message.order(), message.at_ns(), now_ns);
            messages.push(message);
        }
        messages
    }
    /// What was read so far.
    pub fn intake(&self) -> &InputStatistics {
        &self.intake
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Header, RangeSample, SetPoint};
    use crate::time::Time;
    use core::ops::ControlFlow;

    fn at(sequence: u32) -> Header<DroneClock> {
        Header::new(
            1,
            1,
            9,
            sequence,
            Time::from_nanos(i64::from(sequence) * 1_000_000),
        )
    }

    #[test]
    fn subscribers_keep_the_newest_state_and_sixteen_events_and_leave_no_files() {
        let instance = Instance::new(&format!("memory-test-{}", std::process::id())).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let early = memory.publisher::<SetPoint>();
        assert!(
            early.is_err(),
            "a service that nobody created is not created by who opens it"
        );
        let services = Services::create(&memory).unwrap();
        assert_eq!(
            services.len(),
            crate::topics::ALL.iter().filter(|t| t.is_memory()).count() + 1
        );

        let mut set_points = memory.publisher::<SetPoint>().unwrap();
        let mut newest = memory.subscriber::<SetPoint>().unwrap();
        let mut ranges = memory.publisher::<RangeSample>().unwrap();
        let mut all = memory.subscriber::<RangeSample>().unwrap();
        let wake = memory.listener::<RangeSample>().unwrap();
        for k in 1..=20 {
            set_points.send(&SetPoint {
                header: at(k),
                thrust: f64::from(k),
                ..SetPoint::default()
            });
            ranges.send(&RangeSample {
                header: at(k),
                range_m: f64::from(k),
                variance: 1.0,
            });
        }
        assert_eq!((set_points.unsent(), ranges.unsent()), (0, 0));
        assert_eq!(newest.newest(0).map(|s| s.thrust), Some(20.0));
        assert_eq!(newest.newest(0), None);
        let read: Vec<f64> = all.all(0).iter().map(|r| r.range_m).collect();
        assert_eq!(read, (5..=20).map(f64::from).collect::<Vec<_>>());
        // Only gaps between messages that were read can be seen; the first four came before them.
        assert_eq!(all.intake().state(0).missed, 0);
        ranges.send(&RangeSample {
            header: at(24),
            range_m: 24.0,
            variance: 1.0,
        });
        assert_eq!(all.all(0).len(), 1);
        assert_eq!(all.intake().state(0).missed, 3);

        let mut steps = 0;
        crate::transport::wake::run(&[&wake], Duration::from_millis(1), || {
            steps += 1;
            if steps == 3 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })
        .unwrap();
        assert_eq!(steps, 3, "a drained listener does not spin, the timeout wakes");

        // The middleware leaves its own small segment behind; an instance's end wipes that too.
        drop((set_points, newest, ranges, all, wake, services, memory));
        instance.wipe().unwrap();
        let prefix = instance.prefix();
        let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
        assert_eq!(
            left.filter(|e| e.file_name().to_string_lossy().starts_with(&prefix))
                .count(),
            0
        );
        std::fs::remove_dir_all(instance.directory()).unwrap();
    }
}

//! Shared memory between processes of one computer: one iceoryx2 service per topic of
//! [`alight_shared::topics`].
//!
//! The creator of a service determines its settings, and may leave it unusable if it dies. Therefore one
//! process, the supervisor, creates all services ([`Services::create`]), and the others only open them.

use std::{
    fs,
    os::fd::{AsFd, AsRawFd, BorrowedFd, RawFd},
    time::Duration,
};

use iceoryx2::{
    node::Node as IoxNode,
    port::{
        listener::Listener as IoxListener, notifier::Notifier, publisher::Publisher as IoxPublisher,
        subscriber::Subscriber as IoxSubscriber,
    },
    prelude::*,
    service::{
        attribute::{AttributeKey, AttributeValue},
        builder::publish_subscribe::PublishSubscribeOpenError,
        port_factory::{event, publish_subscribe},
    },
};
use iceoryx2_bb_posix::file_descriptor::FileDescriptorBased;

pub use crate::instance::Instance;
use crate::{
    TransportContext, TransportError,
    images::{ImagePublisher, ImageServices, ImageSubscriber, ImageTopic},
    instance::{Ipc, service_name},
    signal::end_requested,
    statistics::InputStatistics,
    warnings,
};
use alight_shared::{
    bus::{self, Bus},
    plain::{self, Plain},
    process::InputState,
    topics::{self, Topic},
};

/// Maximum number of publishers per topic: any process may publish its state, and a killed one occupies its
/// port until it is cleaned up.
const PUBLISHERS: usize = 16;
/// Maximum number of subscribers per topic: all processes, and observers.
const SUBSCRIBERS: usize = 24;
/// Maximum number of processes that open a topic.
const NODES: usize = 32;
/// Maximum number of messages per read, so that no publisher blocks its reader.
const MAX_PER_READ: usize = 64;

/// Message as transported by iceoryx2; listings show the topic's own type.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
struct Sample<T: Plain>(T);

// SAFETY: `Plain` has the same requirements, and the wrapper does not change the layout.
#[allow(unsafe_code)]
unsafe impl<T: Plain> ZeroCopySend for Sample<T> {
    unsafe fn type_name() -> &'static str {
        T::TOPIC.type_name()
    }
}

pub struct Memory {
    node: IoxNode<Ipc>,
}

impl Memory {
    pub fn join(instance: &Instance, process: &str) -> Result<Memory, TransportError> {
        warnings::listen();
        let doing = || format!("joining the shared memory of instance {}", instance.name());
        fs::create_dir_all(instance.middleware()).doing(doing)?;
        let name = NodeName::new(process).doing(doing)?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&instance.config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .doing(doing)?;
        Ok(Memory { node })
    }
    pub fn reap(&self) {
        let _left = self.node.try_cleanup_dead_nodes();
    }
    /// Waits for at most `span`. Returns false if the process was asked to end; other signals shorten it.
    pub fn wait(&self, span: Duration) -> bool {
        let _asked = end_requested();
        let _early = self.node.wait(span);
        !end_requested()
    }

    fn messages<T: Plain>(&self) -> Result<MessageBuilder<T>, TransportError> {
        Ok(self
            .node
            .service_builder(&service_name(T::TOPIC.name)?)
            .publish_subscribe::<Sample<T>>()
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
            .service_builder(&service_name(topic.name)?)
            .event()
            .max_notifiers(PUBLISHERS)
            .max_listeners(SUBSCRIBERS)
            .max_nodes(NODES)
            .event_id_max_value(1))
    }
    /// Opens the service of a message whose layout has this hash.
    fn open<T: Plain>(&self, layout: u64, doing: impl Fn() -> String) -> Result<Service<T>, TransportError> {
        let (name, value) = layout_attribute(layout)?;
        let required = AttributeVerifier::new().require(&name, &value).doing(&doing)?;
        let opened = self.messages::<T>()?.open_with_attributes(&required);
        opened.map_err(|e| match e {
            PublishSubscribeOpenError::IncompatibleAttributes => TransportError {
                doing: doing(),
                what: "the processes of this instance are of another build, with another layout of this message: end \
                       them, and start all from one program"
                    .into(),
            },
            e => TransportError::because(doing(), e),
        })
    }
    pub fn publisher<T: Plain>(&self) -> Result<Publisher<T>, TransportError> {
        let doing = || format!("publishing {}", T::TOPIC.name);
        let messages = self.open::<T>(T::TOPIC.layout(), doing)?;
        let port = messages
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .doing(doing)?;
        let events = self.events(T::TOPIC)?.open().doing(doing)?;
        Ok(Publisher {
            port,
            notifier: events.notifier_builder().create().doing(doing)?,
            unsent: 0,
        })
    }
    pub fn subscriber<T: Plain>(&self) -> Result<Subscriber<T>, TransportError> {
        let doing = || format!("reading {}", T::TOPIC.name);
        let messages = self.open::<T>(T::TOPIC.layout(), doing)?;
        let port = messages
            .subscriber_builder()
            .buffer_size(T::TOPIC.buffer)
            .create()
            .doing(doing)?;
        Ok(Subscriber {
            port,
            statistics: InputStatistics::new(T::TOPIC),
        })
    }
    /// Publisher of images with at most `bytes` bytes of pixels.
    pub fn image_publisher(&self, topic: ImageTopic, bytes: usize) -> Result<ImagePublisher, TransportError> {
        ImagePublisher::open(&self.node, topic, bytes)
    }
    pub fn image_subscriber(&self, topic: ImageTopic) -> Result<ImageSubscriber, TransportError> {
        ImageSubscriber::open(&self.node, topic)
    }
    pub fn listener<T: Plain>(&self) -> Result<Listener, TransportError> {
        let doing = || format!("listening for {}", T::TOPIC.name);
        let events = self.events(T::TOPIC)?.open().doing(doing)?;
        let port = events.listener_builder().create().doing(doing)?;
        Ok(Listener { port })
    }
}

type MessageBuilder<T> = iceoryx2::service::builder::publish_subscribe::Builder<Sample<T>, (), Ipc>;
type Service<T> = publish_subscribe::PortFactory<Ipc, Sample<T>, ()>;

/// Attribute of a service: hash of its message's layout. A process with another layout cannot open the service.
fn layout_attribute(layout: u64) -> Result<(AttributeKey, AttributeValue), TransportError> {
    let doing = || "naming the layout of a message".to_owned();
    let key = AttributeKey::try_from("alight.layout").doing(doing)?;
    let value = AttributeValue::try_from(format!("{layout:016x}").as_str()).doing(doing)?;
    Ok((key, value))
}

type Held = (Box<dyn core::any::Any>, event::PortFactory<Ipc>);

/// All services of an instance, open as long as their creator runs.
pub struct Services {
    #[allow(dead_code, reason = "a service exists as long as its handle")]
    held: Vec<Held>,
    _images: ImageServices,
}

impl Services {
    pub fn create(memory: &Memory) -> Result<Services, TransportError> {
        let images = ImageServices::create(&memory.node)?;
        let mut created = Created(memory, Vec::new());
        topics::each_in_memory(&mut created)?;
        Ok(Services {
            held: created.1,
            _images: images,
        })
    }
}

struct Created<'a>(&'a Memory, Vec<Held>);

impl plain::Visitor for Created<'_> {
    type Error = TransportError;
    fn visit<T: Plain>(&mut self) -> Result<(), TransportError> {
        let Created(memory, held) = self;
        let doing = || format!("creating {}", T::TOPIC.name);
        let (name, value) = layout_attribute(T::TOPIC.layout())?;
        let messages: Service<T> = memory
            .messages::<T>()?
            .create_with_attributes(&AttributeSpecifier::new().define(&name, &value).doing(doing)?)
            .doing(doing)?;
        let events = memory.events(T::TOPIC)?.create().doing(doing)?;
        held.push((Box::new(messages), events));
        Ok(())
    }
}

pub struct Publisher<T: Plain> {
    port: IoxPublisher<Ipc, Sample<T>, ()>,
    notifier: Notifier<Ipc>,
    unsent: u64,
}

impl<T: Plain> Publisher<T> {
    /// Writes `message` without blocking and wakes listeners; a slow subscriber loses its oldest message.
    pub fn send(&mut self, message: &T) {
        let sent = self
            .port
            .loan_uninit()
            .is_ok_and(|slot| slot.write_payload(Sample(*message)).send().is_ok());
        if !sent {
            self.unsent += 1;
            return;
        }
        // A listener that cannot be woken finds the message at its next wake-up.
        let _woken = self.notifier.notify();
    }
    pub fn send_any(&mut self, message: Option<&T>) {
        if let Some(message) = message {
            self.send(message);
        }
    }
    pub fn unsent(&self) -> u64 {
        self.unsent
    }
}

pub struct Listener {
    pub(crate) port: IoxListener<Ipc>,
}

impl Listener {
    /// Consumes all wake-ups and returns whether there were any; otherwise a listener wakes again at once.
    pub fn drain(&self) -> bool {
        let mut woke = false;
        let _drained = self.port.try_wait(|_| woke = true);
        woke
    }
}

impl bus::Wake for Listener {
    fn woke(&mut self) -> bool {
        self.drain()
    }
}

/// Descriptor that becomes readable when a message is published, and can be awaited with others.
impl AsFd for Listener {
    #[allow(unsafe_code)]
    fn as_fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the port owns the descriptor, is the only one to close it, and outlives this borrow.
        unsafe { BorrowedFd::borrow_raw(self.port.file_descriptor().native_handle()) }
    }
}
impl AsRawFd for Listener {
    fn as_raw_fd(&self) -> RawFd {
        self.as_fd().as_raw_fd()
    }
}

pub struct Subscriber<T: Plain> {
    port: IoxSubscriber<Ipc, Sample<T>, ()>,
    statistics: InputStatistics,
}

impl<T: Plain> Subscriber<T> {
    /// Waiting messages in order, at most [`MAX_PER_READ`]; `now_ns` is on the clock of their stamps.
    fn waiting(&mut self, now_ns: i64) -> impl Iterator<Item = iceoryx2::sample::Sample<Ipc, Sample<T>, ()>> {
        let Subscriber { port, statistics } = self;
        (0..MAX_PER_READ).map_while(move |_| {
            // On an error, a publisher disappeared while sending: its message is lost, and the next read tries again.
            let sample = port.receive().ok()??;
            statistics.count(sample.0.order(), sample.0.at_ns(), now_ns);
            Some(sample)
        })
    }
    /// Newest waiting message, if any.
    pub fn newest(&mut self, now_ns: i64) -> Option<T> {
        self.waiting(now_ns).last().map(|sample| sample.0)
    }
    /// All waiting messages in order.
    pub fn all(&mut self, now_ns: i64) -> Vec<T> {
        self.waiting(now_ns).map(|sample| sample.0).collect()
    }
    pub fn statistics(&self) -> &InputStatistics {
        &self.statistics
    }
}

impl Bus for Memory {
    type Error = TransportError;
    type Reader<M: Plain> = Subscriber<M>;
    type Writer<M: Plain> = Publisher<M>;
    type Wake = Listener;

    fn reader<M: Plain>(&self) -> Result<Subscriber<M>, TransportError> {
        self.subscriber()
    }
    fn writer<M: Plain>(&self) -> Result<Publisher<M>, TransportError> {
        self.publisher()
    }
    fn wake<M: Plain>(&self) -> Result<Listener, TransportError> {
        self.listener::<M>()
    }
}

impl<M: Plain> bus::Reader<M> for Subscriber<M> {
    fn read_newest(&mut self, now_ns: i64, to: &mut Option<M>) {
        *to = None;
        if let Some(sample) = self.waiting(now_ns).last() {
            *to = Some(sample.0);
        }
    }
    fn read_all(&mut self, now_ns: i64, to: &mut Vec<M>) {
        to.clear();
        to.extend(self.waiting(now_ns).map(|sample| sample.0));
    }
    fn state(&self, now_ns: i64) -> InputState {
        self.statistics.state(now_ns)
    }
}

impl<M: Plain> bus::Writer<M> for Publisher<M> {
    fn send(&mut self, message: &M) {
        Publisher::send(self, message);
    }
    fn unsent(&self) -> u64 {
        self.unsent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::ImageHeader;
    use alight_shared::{
        msg::{Header, RangeSample, SetPoint},
        time::{DroneClock, Time},
        topics::Medium,
    };

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
    fn services_and_leftover_files() {
        let instance = Instance::new(&format!("memory-test-{}", std::process::id())).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let early = memory.publisher::<SetPoint>();
        assert!(early.is_err(), "opening a missing service does not create it");
        let services = Services::create(&memory).unwrap();
        let topics = alight_shared::topics::ALL
            .iter()
            .filter(|t| t.medium == Medium::Memory);
        assert_eq!(services.held.len(), topics.count() + 1);

        let doing = || "reading".to_owned();
        let other = memory.open::<SetPoint>(SetPoint::TOPIC.layout() ^ 1, doing);
        let refused = other.err().unwrap().to_string();
        assert!(
            refused.contains("another build, with another layout"),
            "{refused}"
        );

        let mut ranges = memory.publisher::<RangeSample>().unwrap();
        let wake = memory.listener::<RangeSample>().unwrap();
        ranges.send(&RangeSample {
            header: at(1),
            ..RangeSample::default()
        });

        let mut steps = 0;
        crate::wake::run(&[&wake], Duration::from_millis(1), || {
            steps += 1;
            steps < 3
        })
        .unwrap();
        assert_eq!(steps, 3, "a drained listener does not spin, the timeout wakes");

        // The middleware leaves a small segment, which is wiped at the end of an instance.
        drop((ranges, wake, services, memory));
        instance.wipe().unwrap();
        let prefix = instance.prefix();
        let left = fs::read_dir("/dev/shm").unwrap().flatten();
        assert_eq!(
            left.filter(|e| e.file_name().to_string_lossy().starts_with(&prefix))
                .count(),
            0
        );
        fs::remove_dir_all(instance.directory()).unwrap();
    }

    fn is_shared(instance: &Instance, bytes: &[u8]) -> bool {
        let at = bytes.as_ptr() as usize;
        let name = format!("/dev/shm/{}", instance.prefix());
        let maps = fs::read_to_string("/proc/self/maps").unwrap();
        let mut shared = maps.lines().filter(|line| line.contains(&name));
        shared.any(|line| {
            let (range, _) = line.split_once(' ').unwrap();
            let (from, to) = range.split_once('-').unwrap();
            let [from, to] = [from, to].map(|end| usize::from_str_radix(end, 16).unwrap());
            (from..to).contains(&at) && at + bytes.len() <= to
        })
    }

    #[test]
    fn image_transfer_and_oversized_image() {
        let instance = Instance::new(&format!("images-test-{}", std::process::id())).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let mut images = memory.image_publisher(ImageTopic::Marked, 64 * 48).unwrap();
        let mut others = memory.image_subscriber(ImageTopic::Simulated).unwrap();
        assert!(!images.is_read());
        let mut reader = memory.image_subscriber(ImageTopic::Marked).unwrap();
        assert!(images.is_read());
        let pixels: Vec<u8> = (0..64 * 48).map(|k| (k % 251) as u8).collect();
        let header = |at_ns| ImageHeader {
            at_ns,
            size: [64, 48],
            marks: [3, 1],
        };
        for k in 1..=4 {
            images.send(header(k), &pixels);
        }
        // Pixels are written in place: neither writer nor reader copies them.
        images.send_with(header(5), 64 * 48, |place| {
            assert!(is_shared(&instance, place));
            place.copy_from_slice(&pixels);
        });
        images.send_with(header(6), 640 * 480, |_| {
            panic!("an oversized image is not produced")
        });
        assert_eq!(images.unsent(), 1);
        assert!(others.next_image().is_none());
        let first = reader.next_image().unwrap();
        assert_eq!(*first.header(), header(4));
        assert_eq!(first.pixels(), pixels);
        let second = reader.next_image().unwrap();
        assert_eq!(second.header().at_ns, 5);
        for k in 7..=9 {
            images.send(header(k), &[7; 64 * 48]);
        }
        assert!(reader.next_image().is_none());
        for image in [&first, &second] {
            assert!(is_shared(&instance, image.pixels()));
            assert_eq!(image.pixels(), pixels);
        }
        drop((first, second));
        assert_eq!(reader.next_image().map(|i| i.header().at_ns), Some(8));
        drop((images, reader, others, services, memory));
        instance.wipe().unwrap();
        fs::remove_dir_all(instance.directory()).unwrap();
    }
}

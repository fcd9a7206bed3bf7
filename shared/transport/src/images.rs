//! Images between the processes of one computer: bytes of bounded number in shared memory, in the place
//! of a message of fixed size. Only the newest few wait; a reader that is slow loses the oldest. Nothing is
//! woken by one: its reader looks.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::{BackpressureStrategy, PortFactory as _};
use iceoryx2::service::builder::publish_subscribe;
use iceoryx2::service::port_factory;

use crate::instance::{Ipc, defined, required, service_name};
use crate::{Doing, TransportError};

/// Bytes before the pixels: time (8), width (4), height (4), tags (4), outlines (4).
const HEADER_BYTES: usize = 24;
/// Images that wait for a reader.
const BUFFER: usize = 2;
/// Images that a reader holds at a time.
const BORROWED: usize = 1;
/// Who may publish, and who may read, at a time; those that were killed keep their place for a while.
const PORTS: usize = 4;

/// Which images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageTopic {
    /// The simulated camera's, grey, one byte a pixel.
    Simulated,
    /// The belly camera's for people, with marks, red, green and blue, three bytes a pixel.
    Marked,
}

impl ImageTopic {
    /// All of them.
    const ALL: [ImageTopic; 2] = [ImageTopic::Simulated, ImageTopic::Marked];

    /// Name of the service, after [`alight_shared::topics`]'s.
    fn name(self) -> &'static str {
        match self {
            ImageTopic::Simulated => "camera/image",
            ImageTopic::Marked => "camera/marked",
        }
    }
}

/// An image as it travels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImageBytes {
    /// Middle of the exposure on the drone's clock, ns.
    pub at_ns: i64,
    /// Width and height, px, as its sender states.
    pub size: [u32; 2],
    /// Tags and outlines of the deck that are drawn in; none in an image as it was taken.
    pub marks: [u32; 2],
    /// Bytes of the pixels, row by row from the top.
    pub pixels: Vec<u8>,
}

type Messages = publish_subscribe::Builder<[u8], (), Ipc>;

/// Builder of the service with its quality.
fn messages(node: &Node<Ipc>, topic: ImageTopic) -> Result<Messages, TransportError> {
    Ok(node
        .service_builder(&service_name(topic.name())?)
        .publish_subscribe::<[u8]>()
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER)
        .subscriber_max_borrowed_samples(BORROWED)
        .max_publishers(PORTS)
        .max_subscribers(PORTS)
        .max_nodes(4 * PORTS))
}

type Service = port_factory::publish_subscribe::PortFactory<Ipc, [u8], ()>;

/// The services, held open by who created them.
pub(crate) struct ImageServices {
    _held: Vec<Service>,
}

impl ImageServices {
    pub(super) fn create(node: &Node<Ipc>) -> Result<ImageServices, TransportError> {
        let create = |topic: ImageTopic| {
            let created = messages(node, topic)?.create_with_attributes(&defined()?);
            created.doing(|| format!("creating {}", topic.name()))
        };
        let held = ImageTopic::ALL.into_iter().map(create);
        Ok(ImageServices {
            _held: held.collect::<Result<_, _>>()?,
        })
    }
}

/// Publishes images of at most so many bytes.
pub struct ImagePublisher {
    service: Service,
    port: IoxPublisher<Ipc, [u8], ()>,
    max_bytes: usize,
    unsent: u64,
}

impl ImagePublisher {
    pub(super) fn open(
        node: &Node<Ipc>,
        topic: ImageTopic,
        bytes: usize,
    ) -> Result<ImagePublisher, TransportError> {
        let doing = || format!("publishing {}", topic.name());
        let service = messages(node, topic)?
            .open_with_attributes(&required()?)
            .doing(doing)?;
        let port = service
            .publisher_builder()
            .initial_max_slice_len(HEADER_BYTES + bytes)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .doing(doing)?;
        Ok(ImagePublisher {
            service,
            port,
            max_bytes: HEADER_BYTES + bytes,
            unsent: 0,
        })
    }
    /// Sends an image; one that is larger than agreed is counted as not sent.
    pub fn send(&mut self, at_ns: i64, size: [u32; 2], marks: [u32; 2], pixels: &[u8]) {
        let length = HEADER_BYTES + pixels.len();
        let sent = length <= self.max_bytes
            && self.port.loan_slice(length).is_ok_and(|mut slot| {
                let (head, rest) = slot.payload_mut().split_at_mut(HEADER_BYTES);
                let numbers = size.into_iter().chain(marks).flat_map(u32::to_le_bytes);
                let header = at_ns.to_le_bytes().into_iter().chain(numbers);
                head.iter_mut().zip(header).for_each(|(to, byte)| *to = byte);
                rest.copy_from_slice(pixels);
                slot.send().is_ok()
            });
        self.unsent += u64::from(!sent);
    }
    /// Whether somebody reads: else an image need not be made.
    pub fn is_read(&self) -> bool {
        self.service.dynamic_config().number_of_subscribers() > 0
    }
    /// Images that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }
}

/// Reads images.
pub struct ImageSubscriber {
    port: IoxSubscriber<Ipc, [u8], ()>,
}

impl ImageSubscriber {
    pub(super) fn open(node: &Node<Ipc>, topic: ImageTopic) -> Result<ImageSubscriber, TransportError> {
        let doing = || format!("reading {}", topic.name());
        let port = messages(node, topic)?
            .open_with_attributes(&required()?)
            .doing(doing)?
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create()
            .doing(doing)?;
        Ok(ImageSubscriber { port })
    }
    /// The next image that waits.
    pub fn next_image(&mut self) -> Option<ImageBytes> {
        // An error is a publisher that went away in the middle: its image is lost.
        let sample = self.port.receive().ok()??;
        decode(sample.payload())
    }
}

pub(super) fn decode(bytes: &[u8]) -> Option<ImageBytes> {
    let (at, rest) = bytes.split_first_chunk::<8>()?;
    let (numbers, pixels) = rest.split_first_chunk::<16>()?;
    let number = |k: usize| numbers.as_chunks().0.get(k).copied().map(u32::from_le_bytes);
    Some(ImageBytes {
        at_ns: i64::from_le_bytes(*at),
        size: [number(0)?, number(1)?],
        marks: [number(2)?, number(3)?],
        pixels: pixels.to_vec(),
    })
}

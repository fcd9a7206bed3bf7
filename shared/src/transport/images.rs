//! Images between the processes of one computer: bytes of bounded number in shared memory, in the place
//! of a message of fixed size. Only the newest few wait; a reader that is slow loses the oldest. Nothing is
//! woken by one: its reader looks.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::BackpressureStrategy;
use iceoryx2::service::builder::publish_subscribe;
use iceoryx2::service::port_factory;

use crate::transport::instance::{Ipc, defined, required, service_name};
use crate::transport::{Doing, TransportError};

/// Name of the service, after [`crate::topics`]'s.
const NAME: &str = "camera/image";
/// Bytes before the pixels: time (8), width (4), height (4).
const HEADER_BYTES: usize = 16;
/// Images that wait for a reader.
const BUFFER: usize = 2;
/// Images that a reader holds at a time.
const BORROWED: usize = 1;
/// Who may publish, and who may read, at a time; those that were killed keep their place for a while.
const PORTS: usize = 4;

/// An image as it travels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageBytes {
    /// Middle of the exposure on the drone's clock, ns.
    pub at_ns: i64,
    /// Width and height, px, as its sender states.
    pub size: [u32; 2],
    /// Grey levels.
    pub pixels: Vec<u8>,
}

type Messages = publish_subscribe::Builder<[u8], (), Ipc>;

/// Builder of the service with its quality.
fn messages(node: &Node<Ipc>) -> Result<Messages, TransportError> {
    Ok(node
        .service_builder(&service_name(NAME)?)
        .publish_subscribe::<[u8]>()
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER)
        .subscriber_max_borrowed_samples(BORROWED)
        .max_publishers(PORTS)
        .max_subscribers(PORTS)
        .max_nodes(4 * PORTS))
}
/// The service, held open by who created it.
pub(crate) struct ImageService {
    _messages: port_factory::publish_subscribe::PortFactory<Ipc, [u8], ()>,
}

impl ImageService {
    pub(super) fn create(node: &Node<Ipc>) -> Result<ImageService, TransportError> {
        Ok(ImageService {
            _messages: messages(node)?
                .create_with_attributes(&defined()?)
                .doing(|| format!("creating {NAME}"))?,
        })
    }
}

/// Publishes images of at most so many pixels.
pub struct ImagePublisher {
    port: IoxPublisher<Ipc, [u8], ()>,
    max_bytes: usize,
    unsent: u64,
}

impl ImagePublisher {
    pub(super) fn open(node: &Node<Ipc>, pixels: usize) -> Result<ImagePublisher, TransportError> {
        let doing = || format!("publishing {NAME}");
        let port = messages(node)?
            .open_with_attributes(&required()?)
            .doing(doing)?
            .publisher_builder()
            .initial_max_slice_len(HEADER_BYTES + pixels)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .doing(doing)?;
        Ok(ImagePublisher {
            port,
            max_bytes: HEADER_BYTES + pixels,
            unsent: 0,
        })
    }
    /// Sends an image; one that is larger than agreed is counted as not sent.
    pub fn send(&mut self, at_ns: i64, size: [u32; 2], pixels: &[u8]) {
        let length = HEADER_BYTES + pixels.len();
        let sent = length <= self.max_bytes
            && self.port.loan_slice(length).is_ok_and(|mut slot| {
                let (head, rest) = slot.payload_mut().split_at_mut(HEADER_BYTES);
                let header = at_ns
                    .to_le_bytes()
                    .into_iter()
                    .chain(size.into_iter().flat_map(u32::to_le_bytes));
                head.iter_mut().zip(header).for_each(|(to, byte)| *to = byte);
                rest.copy_from_slice(pixels);
                slot.send().is_ok()
            });
        self.unsent += u64::from(!sent);
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
    pub(super) fn open(node: &Node<Ipc>) -> Result<ImageSubscriber, TransportError> {
        let doing = || format!("reading {NAME}");
        let port = messages(node)?
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
    let (width, rest) = rest.split_first_chunk::<4>()?;
    let (height, pixels) = rest.split_first_chunk::<4>()?;
    Some(ImageBytes {
        at_ns: i64::from_le_bytes(*at),
        size: [u32::from_le_bytes(*width), u32::from_le_bytes(*height)],
        pixels: pixels.to_vec(),
    })
}

//! Images between the processes of one computer: bytes of bounded number in shared memory, in the place
//! of a message of fixed size. Only the newest few wait; a reader that is slow loses the oldest. Nothing is
//! woken by one: its reader looks.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::{BackpressureStrategy, ServiceName};
use iceoryx2::service::builder::publish_subscribe;
use iceoryx2::service::port_factory;

use crate::transport::TransportError;
use crate::transport::memory::Ipc;

/// Name of the service, after [`crate::topics`]'s.
pub(crate) const NAME: &str = "camera/image";
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
    /// Width and height, px, as its sender says.
    pub size: [u32; 2],
    /// Grey levels.
    pub pixels: Vec<u8>,
}

type Messages = publish_subscribe::Builder<[u8], (), Ipc>;

/// Builder of the service with its quality.
pub(crate) fn messages(node: &Node<Ipc>, name: &ServiceName) -> Messages {
    node.service_builder(name)
        .publish_subscribe::<[u8]>()
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER)
        .subscriber_max_borrowed_samples(BORROWED)
        .max_publishers(PORTS)
        .max_subscribers(PORTS)
        .max_nodes(4 * PORTS)
}
/// The service, held open by who created it.
pub(crate) struct ImageService {
    _messages: port_factory::publish_subscribe::PortFactory<Ipc, [u8], ()>,
}

impl ImageService {
    pub(crate) fn create(node: &Node<Ipc>, name: &ServiceName) -> Result<ImageService, TransportError> {
        let fail = |e: &dyn core::fmt::Debug| TransportError::because(format!("creating {NAME}"), e);
        Ok(ImageService {
            _messages: messages(node, name).create().map_err(|e| fail(&e))?,
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
    pub(crate) fn open(
        node: &Node<Ipc>,
        name: &ServiceName,
        pixels: usize,
    ) -> Result<ImagePublisher, TransportError> {
        let fail = |e: &dyn core::fmt::Debug| TransportError::because(format!("publishing {NAME}"), e);
        let port = messages(node, name)
            .open()
            .map_err(|e| fail(&e))?
            .publisher_builder()
            .initial_max_slice_len(HEADER_BYTES + pixels)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| fail(&e))?;
        Ok(ImagePublisher {
            port,
            max_bytes: HEADER_BYTES + pixels,
            unsent: 0,
        })
    }
    /// Sends an image; one that is larger than was said is counted as not sent.
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
    pub(crate) fn open(node: &Node<Ipc>, name: &ServiceName) -> Result<ImageSubscriber, TransportError> {
        let fail = |e: &dyn core::fmt::Debug| TransportError::because(format!("reading {NAME}"), e);
        let port = messages(node, name)
            .open()
            .map_err(|e| fail(&e))?
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create()
            .map_err(|e| fail(&e))?;
        Ok(ImageSubscriber { port })
    }
    /// The next image that waits.
    pub fn next_image(&mut self) -> Option<ImageBytes> {
        // An error is a publisher that went away in the middle: its image is lost.
        let sample = self.port.receive().ok()??;
        decode(sample.payload())
    }
}

fn decode(bytes: &[u8]) -> Option<ImageBytes> {
    let (at, rest) = bytes.split_first_chunk::<8>()?;
    let (width, rest) = rest.split_first_chunk::<4>()?;
    let (height, pixels) = rest.split_first_chunk::<4>()?;
    Some(ImageBytes {
        at_ns: i64::from_le_bytes(*at),
        size: [u32::from_le_bytes(*width), u32::from_le_bytes(*height)],
        pixels: pixels.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::memory::{Instance, Memory, Services};

    #[test]
    fn image_arrives_whole_and_an_oversized_one_is_counted() {
        let instance = Instance::new(&format!("images-test-{}", std::process::id())).unwrap();
        instance.wipe().unwrap();
        let memory = Memory::join(&instance, "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let mut images = memory.image_publisher(64 * 48).unwrap();
        let mut reader = memory.image_subscriber().unwrap();
        let pixels: Vec<u8> = (0..64 * 48).map(|k| (k % 251) as u8).collect();
        for k in 1..=5 {
            images.send(k, [64, 48], &pixels);
        }
        images.send(6, [640, 480], &vec![0; 640 * 480]);
        assert_eq!(images.unsent(), 1);
        // Two wait, the older ones gave way.
        let first = reader.next_image().unwrap();
        assert_eq!((first.at_ns, first.size), (4, [64, 48]));
        assert_eq!(first.pixels, pixels);
        assert_eq!(reader.next_image().map(|i| i.at_ns), Some(5));
        assert_eq!(reader.next_image(), None);
        assert_eq!(decode(&[0; 15]), None);
        drop((images, reader, services, memory));
        instance.wipe().unwrap();
        std::fs::remove_dir_all(instance.directory()).unwrap();
    }
}

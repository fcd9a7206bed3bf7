//! Images between the processes of one computer: a header and bytes of bounded number in shared memory, in the place
//! of a message. Their writer makes the pixels there, and their reader reads them there. Only the newest few wait; a
//! reader that is slow loses the oldest. Nothing is woken by one: its reader looks.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::prelude::{BackpressureStrategy, PortFactory as _, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::service::builder::publish_subscribe;
use iceoryx2::service::port_factory;

use crate::instance::{Ipc, defined, required, service_name};
use crate::{TransportContext, TransportError};

/// Images that wait for a reader.
const BUFFER: usize = 2;
/// Images that a reader holds at a time: one, and the next that it takes in its place.
const BORROWED: usize = 2;
/// Who may publish, and who may read, at a time; those that were killed keep their place for a while.
const PORTS: usize = 4;

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

/// What goes with the pixels of an image, which lie row by row from the top.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("ImageHeader")]
pub struct ImageHeader {
    /// Middle of the exposure on the drone's clock, ns.
    pub at_ns: i64,
    /// Width and height, px, as its sender states.
    pub size: [u32; 2],
    /// Tags and outlines of the deck that are drawn in; none in an image as it was taken.
    pub marks: [u32; 2],
}

/// An image in shared memory, which keeps its place until this is dropped.
pub struct SharedImage(Sample<Ipc, [u8], ImageHeader>);

impl SharedImage {
    /// What goes with its pixels.
    pub fn header(&self) -> &ImageHeader {
        self.0.user_header()
    }
    /// Bytes of its pixels, where their writer has put them.
    pub fn pixels(&self) -> &[u8] {
        self.0.payload()
    }
}

type Messages = publish_subscribe::Builder<[u8], ImageHeader, Ipc>;

/// Builder of the service with its quality.
fn messages(node: &Node<Ipc>, topic: ImageTopic) -> Result<Messages, TransportError> {
    Ok(node
        .service_builder(&service_name(topic.name())?)
        .publish_subscribe::<[u8]>()
        .user_header::<ImageHeader>()
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(BUFFER)
        .subscriber_max_borrowed_samples(BORROWED)
        .max_publishers(PORTS)
        .max_subscribers(PORTS)
        .max_nodes(4 * PORTS))
}

type Service = port_factory::publish_subscribe::PortFactory<Ipc, [u8], ImageHeader>;

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
    port: IoxPublisher<Ipc, [u8], ImageHeader>,
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
            .initial_max_slice_len(bytes)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .doing(doing)?;
        Ok(ImagePublisher {
            service,
            port,
            unsent: 0,
        })
    }
    /// Sends an image of so many bytes, which `write` makes in the place where it is read; one that is larger than agreed
    /// is counted as not sent, and not made.
    pub fn send_with(&mut self, header: ImageHeader, bytes: usize, write: impl FnOnce(&mut [u8])) {
        let sent = self.port.loan_slice(bytes).is_ok_and(|mut slot| {
            *slot.user_header_mut() = header;
            write(slot.payload_mut());
            slot.send().is_ok()
        });
        self.unsent += u64::from(!sent);
    }
    /// Sends an image that lies elsewhere.
    pub fn send(&mut self, header: ImageHeader, pixels: &[u8]) {
        self.send_with(header, pixels.len(), |place| place.copy_from_slice(pixels));
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

pub struct ImageSubscriber {
    port: IoxSubscriber<Ipc, [u8], ImageHeader>,
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
    /// The next image that waits; none for a reader that holds two.
    pub fn next_image(&mut self) -> Option<SharedImage> {
        // An error is a publisher that went away in the middle: its image is lost.
        self.port.receive().ok()?.map(SharedImage)
    }
}

//! Images between processes of one computer: a header and bounded bytes in shared memory. The writer produces
//! the pixels in place, and the reader reads them there. The newest few are buffered; a slow reader loses the
//! oldest. An image causes no wake-up: its reader polls.

use iceoryx2::{
    node::Node,
    port::{publisher::Publisher as IoxPublisher, subscriber::Subscriber as IoxSubscriber},
    prelude::{BackpressureStrategy, PortFactory as _, ZeroCopySend},
    sample::Sample,
    service::{builder::publish_subscribe, port_factory},
};

use crate::{
    TransportContext, TransportError,
    instance::{Ipc, service_name},
};

const BUFFER: usize = 2;
/// Number of images held by a reader: the present one and its successor.
const BORROWED: usize = 2;
/// Maximum number of publishers and of readers; a killed process occupies its ports until they are cleaned up.
const PORTS: usize = 4;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageTopic {
    /// Image of the simulated camera: grey, one byte per pixel.
    Simulated,
    /// Image of the belly camera for display, with marks: red, green and blue, three bytes per pixel.
    Marked,
}

impl ImageTopic {
    const ALL: [ImageTopic; 2] = [ImageTopic::Simulated, ImageTopic::Marked];

    fn name(self) -> &'static str {
        match self {
            ImageTopic::Simulated => "camera/image",
            ImageTopic::Marked => "camera/marked",
        }
    }
}

/// Header of an image, whose pixels are stored row by row from the top.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("ImageHeader")]
pub struct ImageHeader {
    /// Middle of the exposure on the drone's clock, ns.
    pub at_ns: i64,
    /// Width and height stated by the sender, px.
    pub size: [u32; 2],
    /// Numbers of drawn tags and deck outlines; zero in an unmarked image.
    pub marks: [u32; 2],
}

/// Image in shared memory, released on drop.
pub struct SharedImage(Sample<Ipc, [u8], ImageHeader>);

impl SharedImage {
    pub fn header(&self) -> &ImageHeader {
        self.0.user_header()
    }
    pub fn pixels(&self) -> &[u8] {
        self.0.payload()
    }
}

type Messages = publish_subscribe::Builder<[u8], ImageHeader, Ipc>;

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

pub(crate) struct ImageServices {
    _held: Vec<Service>,
}

impl ImageServices {
    pub(super) fn create(node: &Node<Ipc>) -> Result<ImageServices, TransportError> {
        let create = |topic: ImageTopic| {
            let created = messages(node, topic)?.create();
            created.doing(|| format!("creating {}", topic.name()))
        };
        let held = ImageTopic::ALL.into_iter().map(create);
        Ok(ImageServices {
            _held: held.collect::<Result<_, _>>()?,
        })
    }
}

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
        let service = messages(node, topic)?.open().doing(doing)?;
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
    /// Sends an image of `bytes` bytes that `write` produces in place. Above the maximum size it is counted
    /// as unsent, without calling `write`.
    pub fn send_with(&mut self, header: ImageHeader, bytes: usize, write: impl FnOnce(&mut [u8])) {
        let sent = self.port.loan_slice(bytes).is_ok_and(|mut slot| {
            *slot.user_header_mut() = header;
            write(slot.payload_mut());
            slot.send().is_ok()
        });
        self.unsent += u64::from(!sent);
    }
    pub fn send(&mut self, header: ImageHeader, pixels: &[u8]) {
        self.send_with(header, pixels.len(), |place| place.copy_from_slice(pixels));
    }
    /// Whether a reader exists, so that an image is needed.
    pub fn is_read(&self) -> bool {
        self.service.dynamic_config().number_of_subscribers() > 0
    }
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
            .open()
            .doing(doing)?
            .subscriber_builder()
            .buffer_size(BUFFER)
            .create()
            .doing(doing)?;
        Ok(ImageSubscriber { port })
    }
    /// Next buffered image; None if the reader already holds two.
    pub fn next_image(&mut self) -> Option<SharedImage> {
        // On an error, a publisher disappeared while sending: its image is lost.
        self.port.receive().ok()?.map(SharedImage)
    }
}

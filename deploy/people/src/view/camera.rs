//! The drone's camera on the page: marked images from shared memory, encoded while the page has a viewer.

use alight_shared::time::{DroneClock, Time, TrueTime};
use alight_transport::{
    images::{ImageSubscriber, ImageTopic},
    memory::Memory,
};
use jpeg_encoder::{ColorType, Encoder};

use crate::view::{camera_image::ShownImage, view_observer::ViewObserver};

const MAX_BYTES: usize = 20_000;
/// JPEG qualities; the first that yields at most [`MAX_BYTES`] is used, and only noise needs the last.
const QUALITIES: [u8; 3] = [60, 30, 5];

#[derive(Default)]
pub struct CameraFeed {
    images: Option<ImageSubscriber>,
}

impl CameraFeed {
    /// Shows the newest image, if any. Without a viewer the camera makes none.
    pub fn poll(
        &mut self,
        memory: &Memory,
        t: Time<TrueTime>,
        now: Time<DroneClock>,
        observer: &mut ViewObserver,
    ) {
        if !observer.server.is_watched() {
            self.images = None;
            observer.board.camera = None;
            return;
        }
        if self.images.is_none() {
            // If all subscriptions are taken, the page continues without images and tries again.
            self.images = memory.image_subscriber(ImageTopic::Marked).ok();
        }
        let Some(images) = &mut self.images else { return };
        let newest = core::iter::from_fn(|| images.next_image()).last();
        let Some(image) = newest else { return };
        let header = image.header();
        if let Some(jpeg) = encode(header.size, image.pixels()) {
            let age = now - Time::from_nanos(header.at_ns);
            observer.server.show_camera(jpeg);
            observer.board.camera = Some(ShownImage {
                at: observer.board_time(t) - age,
                at_ns: header.at_ns,
                marks: header.marks,
            });
        }
    }
}

/// JPEG of an image; None if no quality makes it small enough, or if its size does not match its bytes.
fn encode(size: [u32; 2], pixels: &[u8]) -> Option<Vec<u8>> {
    let [width, height] = size.map(|s| u16::try_from(s).unwrap_or(0));
    QUALITIES.into_iter().find_map(|quality| {
        let mut jpeg = Vec::with_capacity(MAX_BYTES);
        let encoder = Encoder::new(&mut jpeg, quality);
        let encoded = encoder.encode(pixels, width, height, ColorType::Rgb);
        (encoded.is_ok() && jpeg.len() <= MAX_BYTES).then_some(jpeg)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::server::Served;
    use alight_computer::process::{instance::OwnedInstance, supervisor::pause};
    use alight_shared::msg::ComputerReport;
    use alight_transport::{images::ImageHeader, memory::Services};
    use std::{
        io::{Read, Write},
        net::TcpStream,
        time::Duration,
    };

    /// Maximum number of polls, 5 ms each.
    const MAX_POLLS: u32 = 2000;

    #[test]
    fn camera_image_while_somebody_looks() {
        let owned = OwnedInstance::take(&format!("test-marked-{}", std::process::id())).unwrap();
        let memory = Memory::join(owned.instance(), "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let mut camera = memory.image_publisher(ImageTopic::Marked, 3 * 64 * 48).unwrap();
        let served = Served {
            page: "127.0.0.1:0".parse().unwrap(),
            foxglove: None,
            name: "test".into(),
            may_order: false,
        };
        let mut observer = ViewObserver::start(served, ComputerReport::default(), &None, false).unwrap();
        let mut feed = CameraFeed::default();
        let mut poll = |observer: &mut ViewObserver| {
            feed.poll(&memory, Time::from_secs(50.0), Time::from_secs(7.0), observer);
            observer.board.picture(Time::from_secs(50.0)).camera
        };
        assert_eq!(poll(&mut observer), None);
        assert!(!camera.is_read(), "the camera works without a viewer");

        let to = observer.server.page();
        let ask = |path: &str| {
            let mut stream = TcpStream::connect(to).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            let request = format!("GET {path} HTTP/1.1\r\nHost: {to}\r\nConnection: close\r\n\r\n");
            stream.write_all(request.as_bytes()).unwrap();
            stream
        };
        let viewer = ask("/events");
        for _ in 0..MAX_POLLS {
            if !observer.server.is_watched() {
                pause(Duration::from_millis(5));
            }
        }
        assert_eq!(poll(&mut observer), None);
        assert!(camera.is_read());
        let header = ImageHeader {
            at_ns: 6_500_000_000,
            size: [64, 48],
            marks: [3, 1],
        };
        camera.send(header, &[90; 3 * 64 * 48]);
        let view = poll(&mut observer).unwrap();
        assert_eq!((view.age_s, view.number), (0.5, 6500));
        let mut answer = Vec::new();
        ask("/camera.jpg").read_to_end(&mut answer).unwrap();
        assert!(answer.windows(2).any(|w| w == [0xff, 0xd8]), "no JPEG");

        drop(viewer);
        for _ in 0..MAX_POLLS {
            if observer.server.is_watched() {
                // The server notices that a viewer is gone when it writes to it.
                observer
                    .server
                    .show(observer.board.picture(Time::from_secs(50.0)));
                pause(Duration::from_millis(5));
            }
        }
        assert_eq!(poll(&mut observer), None);
        assert!(!camera.is_read());
        drop((camera, feed, services, memory));
    }

    #[test]
    fn encoded_image_of_bounded_size() {
        let mut x = 1_u32;
        let noise = (0..3 * 320 * 320).map(|_| {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            x as u8
        });
        let jpeg = encode([320, 320], &noise.collect::<Vec<_>>()).unwrap();
        assert!(
            jpeg.len() <= MAX_BYTES && jpeg.starts_with(&[0xff, 0xd8]),
            "{}",
            jpeg.len()
        );
        assert!(encode([320, 320], &[90; 3 * 320 * 320]).is_some_and(|jpeg| jpeg.len() < 4000));
        assert_eq!(encode([320, 320], &[90; 3 * 320 * 319]), None);
        let of_size = |size| encode(size, &[90; 300]);
        assert_eq!(of_size([0, 10]), None);
        assert_eq!(of_size([u32::MAX, 10]), None);
    }
}

//! A camera of the drone as a process: images in; detections of the deck's tag (belly camera) or fixes of the
//! deck by its blinking markers (ultraviolet camera) to the topic that the predictor reads. Metrics of the
//! first: images, those with the tag, other tags, too faint, misshapen, without a pose, of another size,
//! contrast and saturation of the tag; of the second: images, those with a fix, markers, images with one marker
//! only, without a place, of another size. Of both: the time from exposure to detection (median, 99 %), times
//! its source was opened again, exposure and gain.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use alight_shared::bus::{Ports as Wiring, Wired};
use alight_shared::config::{self, Check as _, Keys};
use alight_shared::geometry::DeckGeometry;
use alight_shared::metrics::{Metric, MetricName};
use alight_shared::msg::{CameraLight, Reason, Seq, TagPose, UvdarFix};
use alight_shared::node::Node;
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::{DroneClock, Span, Time};
use alight_transport::clock::{ProcessClock, steady_ns};
use alight_transport::images::{ImageHeader, ImagePublisher, ImageSubscriber, ImageTopic};
use alight_transport::memory::{Instance, Memory, Publisher};
use alight_transport::statistics::Quantiles;
use alight_uav::camera::marked::MAX_BYTES;
use alight_uav::camera::metering::{Exposed, Light};
use alight_uav::camera::uvdar::UvdarNode;
use alight_uav::camera::{CameraFrame, CameraIn, CameraNode, GreyImage, TagLight};
use alight_uav::computer::Installed as _;
use serde_json::{Value, json};
use tracing::warn;

use crate::config::DroneComputerConfig;
use crate::config::camera::CameraSource;
use crate::drone::camera_source::Images;
use crate::exit::{CliError, Exit};
use crate::process::args::CameraArgs;
use crate::process::life::{Life, draw_boot};
use crate::terminal;

/// Pause when there is no image.
const IDLE_WAIT: Duration = Duration::from_millis(2);
/// Images that wait for the node; more are lost.
const QUEUE_LENGTH: usize = 2;
/// A source that broke is opened again after this long.
const RETRY_PERIOD: Duration = Duration::from_secs(1);
/// The light on the tag is reported for so long after it was detected.
const LIGHT_MEMORY: Span = Span::from_millis(1000);

/// Time between two images for people.
const SHOW_PERIOD: Span = Span::from_millis(500);

/// Topic of the detections.
struct Shared {
    memory: Memory,
    states: Publisher<ProcessState>,
}

/// A node's ports; None: nothing is published.
type Published<N> = Option<Box<<N as Wired>::Ports<Memory>>>;

/// Process of the images and topic of its detections.
enum Detector {
    /// For the tag, which people are shown as well.
    Tag(Box<CameraNode>, Published<CameraNode>, Option<Box<Shown>>),
    /// For the blinking markers.
    Markers(Box<UvdarNode>, Published<UvdarNode>),
}

/// Images for people, made only while somebody looks.
struct Shown {
    images: ImagePublisher,
    deck: DeckGeometry,
    next: Time<DroneClock>,
}

impl Shown {
    /// None, and reported, where there is no place for them: what is detected does not wait for what people see.
    fn open(memory: &Memory, deck: DeckGeometry) -> Option<Box<Shown>> {
        let opened = memory.image_publisher(ImageTopic::Marked, MAX_BYTES);
        let images = opened.inspect_err(|e| {
            warn!(
                "{e}: the tag is detected all the same, and the page shows no image; restart `alight drone` for one"
            );
        });
        Some(Box::new(Shown {
            images: images.ok()?,
            deck,
            next: Time::EPOCH,
        }))
    }
    /// Shows an image that `node` has processed, where one is due.
    fn show(&mut self, frame: &CameraFrame, node: &CameraNode) {
        let early = self.next - frame.at;
        if early > Span::ZERO && early <= SHOW_PERIOD || !self.images.is_read() {
            return;
        }
        if let Some(marked) = node.marked(frame, &self.deck) {
            self.next = frame.at + SHOW_PERIOD;
            let header = ImageHeader {
                at_ns: frame.at.nanos(),
                size: marked.size.map(|s| s as u32),
                marks: [marked.tags, marked.outlines],
            };
            self.images.send(header, &marked.rgb);
        }
    }
}

/// A detection for people.
struct Detection {
    at: Time<DroneClock>,
    line: Value,
}

impl Detector {
    fn new(
        kind: ProcessKind,
        computer: &DroneComputerConfig,
        boot: u32,
        memory: Option<&Memory>,
    ) -> Result<Detector, CliError> {
        let nodes = computer.nodes();
        Ok(if kind == ProcessKind::Uvdar {
            let ports = memory.map(Wiring::join).transpose()?.map(Box::new);
            Detector::Markers(Box::new(UvdarNode::installed(&nodes, boot)), ports)
        } else {
            let ports = memory.map(Wiring::join).transpose()?.map(Box::new);
            let node = Box::new(CameraNode::installed(&nodes, boot));
            Detector::Tag(
                node,
                ports,
                memory.and_then(|m| Shown::open(m, computer.drone.deck)),
            )
        })
    }
    /// Processes images and publishes what was detected, and the light where it is reported.
    fn detect(&mut self, now: Time<DroneClock>, input: &CameraIn) -> (Vec<Detection>, Option<CameraLight>) {
        match self {
            Detector::Tag(node, ports, _) => {
                let found = node.step(now, input);
                if let Some(ports) = ports {
                    ports.write(&found);
                }
                let detection = |m: &TagPose| Detection {
                    at: m.header.at,
                    line: json!({
                        "at_s": m.header.at.secs(),
                        "position_m": m.position,
                        "attitude_wxyz": m.attitude,
                        "sd": m.variance.map(f64::sqrt),
                    }),
                };
                (found.tags.iter().map(detection).collect(), found.light)
            }
            Detector::Markers(node, ports) => {
                let found = node.step(now, input);
                if let Some(ports) = ports {
                    ports.write(&found);
                }
                let detection = |m: &UvdarFix| Detection {
                    at: m.header.at,
                    line: json!({
                        "at_s": m.header.at.secs(),
                        "position_m": m.position,
                        "sd": m.variance.map(f64::sqrt),
                    }),
                };
                (found.fixes.iter().map(detection).collect(), None)
            }
        }
    }
    /// Light of the newest image; None where nothing is metered.
    fn light(&self) -> Option<Light> {
        match self {
            Detector::Tag(node, ..) => Some(node.light()),
            Detector::Markers(..) => None,
        }
    }
    /// Shows people what was detected in the newest of these images.
    fn show(&mut self, input: &CameraIn) {
        if let (Detector::Tag(node, _, Some(shown)), Some(frame)) = (self, input.frames.last()) {
            shown.show(frame, node);
        }
    }
    /// Messages that could not be sent.
    fn unsent(&self) -> u64 {
        match self {
            Detector::Tag(_, ports, _) => ports.as_ref().map_or(0, |p| p.unsent()),
            Detector::Markers(_, ports) => ports.as_ref().map_or(0, |p| p.unsent()),
        }
    }
    /// Counts of images.
    fn metrics(&self) -> Vec<Metric> {
        match self {
            Detector::Tag(node, ..) => {
                let c = node.counts();
                vec![
                    MetricName::Images.count(c.images),
                    MetricName::TagDetections.count(c.detected),
                    MetricName::OtherTags.count(c.other_tags),
                    MetricName::FaintTags.count(c.faint),
                    MetricName::MisshapenTags.count(c.misshapen),
                    MetricName::WithoutPose.count(c.misfit),
                    MetricName::WrongSize.count(c.wrong_size),
                ]
            }
            Detector::Markers(node, _) => {
                let c = &node.counts;
                vec![
                    MetricName::Images.count(c.images),
                    MetricName::DeckFixes.count(c.fixes),
                    MetricName::Markers.count(c.markers),
                    MetricName::SingleMarkers.count(c.single),
                    MetricName::WithoutPose.count(c.misfit),
                    MetricName::WrongSize.count(c.wrong_size),
                ]
            }
        }
    }
    /// The counts as text.
    fn counts(&self) -> Value {
        match self {
            Detector::Tag(node, ..) => json!(node.counts()),
            Detector::Markers(node, _) => json!(node.counts),
        }
    }
}

/// Source of images.
enum Source {
    /// The simulated world, through shared memory.
    Simulation(ImageSubscriber),
    /// A thread that waits for a device, a pipe or files; it takes the light of images by their number.
    Thread(Receiver<SourceEvent>, SyncSender<(u64, Light)>),
}

impl Source {
    /// Images that have come, the number of the newest, and whether there are no more; sets what exposed it, and counts
    /// how often the source broke. `names` are the process's and the source's.
    fn poll(
        &mut self,
        [process, source]: [&str; 2],
        exposed: &mut Option<Exposed>,
        opened: &mut u32,
    ) -> (CameraIn, u64, bool) {
        let mut input = CameraIn::default();
        let (mut over, mut number) = (false, 0);
        match self {
            Source::Simulation(images) => {
                while input.frames.len() < QUEUE_LENGTH
                    && let Some(image) = images.next_image()
                {
                    let [width, height] = image.header().size.map(|s| s as usize);
                    // The one copy: the node's input outlives the place in shared memory. Our publisher sends no image of
                    // another size than its header has.
                    if let Ok(grey) = GreyImage::new(width, height, image.pixels().to_vec()) {
                        let at = Time::from_nanos(image.header().at_ns);
                        input.frames.push(CameraFrame { at, image: grey });
                    }
                }
            }
            Source::Thread(events, _) => match events.recv_timeout(IDLE_WAIT) {
                Ok(SourceEvent::Image(frame, of_source, setting)) => {
                    (number, *exposed) = (of_source, setting);
                    input.frames.push(frame);
                }
                Ok(SourceEvent::Automatic(why)) => warn!(
                    "{process}: {source} {why}: its own automatic exposes, perhaps for longer than motion permits; alight \
                     check prints the remedy"
                ),
                Ok(SourceEvent::Failed(why)) => {
                    *opened = opened.saturating_add(1);
                    warn!("{process}: {why}; trying again");
                }
                Ok(SourceEvent::Finished) => over = true,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => over = true,
            },
        }
        (input, number, over)
    }
}

/// Report of that thread.
enum SourceEvent {
    /// An image, its number, and what exposed it where that is known.
    Image(CameraFrame, u64, Option<Exposed>),
    /// The device's own automatic exposes its images.
    Automatic(String),
    /// It broke; it is tried again.
    Failed(String),
    /// There are no more images.
    Finished,
}

/// The light of images, as it is reported and metered.
#[derive(Default)]
struct LightRecord {
    exposed: Option<Exposed>,
    tag: Option<(Time<DroneClock>, TagLight)>,
    /// The newest report.
    report: Option<CameraLight>,
}

impl LightRecord {
    /// The detector has looked at an image; `metered` takes what is metered of number `number`.
    fn looked(
        &mut self,
        frame: &CameraFrame,
        light: Option<Light>,
        metered: Option<(u64, &SyncSender<(u64, Light)>)>,
    ) {
        if let Some(Light::Tag(tag)) = light {
            self.tag = Some((frame.at, tag));
        }
        if let (Some((number, lights)), Some(light)) = (metered, light) {
            // The thread waits for its device; the next image is metered as well.
            let _full = lights.try_send((number, light));
        }
    }
    /// The light was reported: why it is too dark or too bright, where it has become so.
    fn reported(&mut self, light: CameraLight) -> Option<Reason> {
        let before = self.report.and_then(|r| r.hides_tags()).map(|r| r.code);
        self.report = Some(light);
        light.hides_tags().filter(|why| Some(why.code) != before)
    }
    fn metrics(&self, now: Time<DroneClock>) -> impl Iterator<Item = Metric> {
        let setting = self.exposed.map(|e| e.setting).map(|s| {
            [
                MetricName::Exposure.seconds(s.exposure_s),
                MetricName::Gain.count(s.gain.max(0.0) as u64),
            ]
        });
        let recent = self.tag.filter(|(at, _)| now - *at < LIGHT_MEMORY);
        let tag = recent.map(|(_, light)| {
            [
                MetricName::TagContrast.fraction(light.contrast()),
                MetricName::TagSaturation.fraction(light.saturation),
            ]
        });
        let image = self.report.map(|light| {
            [
                MetricName::ImageMean.fraction(light.mean / 255.0),
                MetricName::TooDark.count(u32::from(light.dark)),
            ]
        });
        setting.into_iter().chain(tag).chain(image).flatten()
    }
}

/// The drone's configuration with the named source, and that of the camera.
fn configured(args: &CameraArgs, kind: ProcessKind) -> Result<(DroneComputerConfig, CameraSource), CliError> {
    let mut computer: DroneComputerConfig = config::load(&args.process.config)?;
    let markers = kind == ProcessKind::Uvdar;
    if let Some(source) = &args.source {
        let named = if markers {
            &mut computer.uvdar.source
        } else {
            &mut computer.camera.source
        };
        named.clone_from(source);
    }
    let config = if markers {
        computer.ultraviolet()
    } else {
        computer.camera.clone()
    };
    // What was named here is held to the same rules.
    computer.check(&Keys::ROOT)?;
    if !config.is_there() {
        return Err(CliError(format!(
            "{}: no camera is configured; set source in [{}] to a V4L2 device such as /dev/video0, or name one \
             with --source",
            args.process.config.display(),
            kind.name()
        )));
    }
    Ok((computer, config))
}

/// Runs until it is asked to end, as the belly camera or as the ultraviolet one.
pub fn run(args: &CameraArgs, kind: ProcessKind) -> Result<Exit, CliError> {
    let (computer, config) = configured(args, kind)?;
    let boot = draw_boot();
    let shared = if args.print && !config.is_simulation() {
        None
    } else {
        let memory = Memory::join(&Instance::new(&computer.instance)?, kind.name())?;
        Some(Shared {
            states: memory.publisher()?,
            memory,
        })
    };
    let mut shared = shared;
    let mut detector = Detector::new(kind, &computer, boot, shared.as_ref().map(|s| &s.memory))?;
    let mut source = match &shared {
        Some(shared) if config.is_simulation() => {
            Source::Simulation(shared.memory.image_subscriber(ImageTopic::Simulated)?)
        }
        Some(_) | None => {
            let (events, lights) = spawn_source(kind, &config, &computer)?;
            Source::Thread(events, lights)
        }
    };
    let mut exposed = LightRecord::default();
    let mut life = Life::begin(kind, boot, args.process.supervised);
    let mut ages = Quantiles::default();
    let (mut opened, mut last) = (0_u32, Time::<DroneClock>::from_nanos(i64::MIN));
    while !life.ended() {
        let names = [kind.name(), config.source.as_str()];
        let (mut input, number, over) = source.poll(names, &mut exposed.exposed, &mut opened);
        if !input.frames.is_empty() {
            last = last.max(computer.clock.now());
            let before = steady_ns();
            input.exposed = exposed.exposed;
            let (detections, light) = detector.detect(last, &input);
            life.stepped(Some((steady_ns() - before) as f64 * 1e-9));
            if let Some(frame) = input.frames.last() {
                let metered = match &source {
                    Source::Thread(_, lights) => Some((number, lights)),
                    Source::Simulation(_) => None,
                };
                exposed.looked(frame, detector.light(), metered);
            }
            if let Some(why) = light.and_then(|light| exposed.reported(light)) {
                warn!("{}: {why}", kind.name());
            }
            let sent: Time<DroneClock> = computer.clock.now();
            detections.iter().for_each(|s| ages.add((sent - s.at).secs()));
            detector.show(&input);
            if args.print {
                print(&input, &detections);
            }
        } else if let (Some(shared), Source::Simulation(_)) = (&shared, &source)
            && !shared.memory.wait(IDLE_WAIT)
        {
            break;
        }
        let own = [
            MetricName::ExposureToFixP50.seconds(ages.quantile(0.5)),
            MetricName::ExposureToFixP99.seconds(ages.quantile(0.99)),
            MetricName::SourceReopened.count(opened),
        ];
        let light = exposed.metrics(computer.clock.now());
        life.metrics = Seq::filled(detector.metrics().into_iter().chain(own).chain(light));
        if let Some(shared) = &mut shared
            && let Some(report) = life.state(Vec::new, detector.unsent())
        {
            shared.states.send(&report);
        }
        if over {
            break;
        }
    }
    if args.print {
        terminal::line(json!({"counts": detector.counts()}));
    }
    Ok(Exit::Success)
}

/// A source's events, and the way back to it: the light on the tag in an image by its number.
type SourceChannels = (Receiver<SourceEvent>, SyncSender<(u64, Light)>);

/// Waits for images on a thread of its own, so that the process goes on saying that it lives.
fn spawn_source(
    kind: ProcessKind,
    config: &CameraSource,
    computer: &DroneComputerConfig,
) -> Result<SourceChannels, CliError> {
    let settings = &computer.drone.camera;
    let (tag, markers) = (&settings.lens, &settings.uvdar.lens);
    let size = if kind == ProcessKind::Uvdar {
        [markers.width_px, markers.height_px]
    } else {
        [tag.width_px, tag.height_px]
    };
    let size = size.map(|s| s as usize);
    // Bad input is rejected at once; what breaks later is tried again.
    let images = Images::open(config, size)?;
    let (events, received) = sync_channel(QUEUE_LENGTH);
    let (lights, metered) = sync_channel(1);
    let mut source = SourceThread {
        images,
        events,
        metered,
        number: 0,
        automatic: false,
    };
    let (config, clock) = (config.clone(), computer.clock);
    std::thread::spawn(move || {
        while let Some(why) = source.show(&clock) {
            if source.events.send(SourceEvent::Failed(why)).is_err() {
                return;
            }
            crate::process::supervisor::pause(RETRY_PERIOD);
            match Images::open(&config, size) {
                Ok(again) => source.images = again,
                Err(CliError(why)) => {
                    if source.events.send(SourceEvent::Failed(why)).is_err() {
                        return;
                    }
                }
            }
        }
    });
    Ok((received, lights))
}

/// The thread that waits for images.
struct SourceThread {
    images: Images,
    events: SyncSender<SourceEvent>,
    metered: Receiver<(u64, Light)>,
    /// Images so far.
    number: u64,
    /// It was reported that the device's own automatic exposes.
    automatic: bool,
}

impl SourceThread {
    /// Shows images until the source breaks: why. None when there are no more, or without a viewer.
    fn show(&mut self, clock: &ProcessClock) -> Option<String> {
        loop {
            let files = matches!(self.images, Images::Files(_));
            match self.images.next_frame(clock) {
                Ok(Some(frame)) => {
                    self.number += 1;
                    if let Ok((image, light)) = self.metered.try_recv() {
                        self.images.meter(image, self.number, &light);
                    }
                    let setting = match self.images.exposure() {
                        Some(Err(why)) if !self.automatic => {
                            self.automatic = true;
                            self.events.send(SourceEvent::Automatic(why)).ok()?;
                            None
                        }
                        Some(exposed) => exposed.ok().map(|setting| Exposed {
                            setting,
                            at_limit: self.images.at_limit(),
                        }),
                        None => None,
                    };
                    let image = SourceEvent::Image(frame, self.number, setting);
                    // Files wait for the node; of a camera the newest counts.
                    if files {
                        self.events.send(image).ok()?;
                    } else if let Err(TrySendError::Disconnected(_)) = self.events.try_send(image) {
                        return None;
                    }
                }
                Ok(None) => {
                    let _gone = self.events.send(SourceEvent::Finished);
                    return None;
                }
                // The next file may be sound.
                Err(CliError(why)) if files => self.events.send(SourceEvent::Failed(why)).ok()?,
                Err(CliError(why)) => return Some(why),
            }
        }
    }
}

/// A line for each image: where tag or deck is, or that it is not detected.
fn print(input: &CameraIn, detections: &[Detection]) {
    for frame in &input.frames {
        let found = detections.iter().find(|s| s.at == frame.at);
        let none = json!({"at_s": frame.at.secs(), "position_m": null});
        terminal::line(found.map_or(none, |s| s.line.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::instance::OwnedInstance;
    use alight_transport::memory::Services;

    #[test]
    fn camera_without_a_place_for_its_images() {
        let owned = OwnedInstance::take(&format!("test-places-{}", std::process::id())).unwrap();
        let memory = Memory::join(owned.instance(), "test").unwrap();
        let services = Services::create(&memory).unwrap();
        let is_shown = || {
            let computer = DroneComputerConfig::default();
            let detector = Detector::new(ProcessKind::Camera, &computer, 1, Some(&memory)).unwrap();
            matches!(detector, Detector::Tag(_, Some(_), Some(_)))
        };
        assert!(is_shown());
        let taken: Vec<_> = (0..100)
            .map_while(|_| memory.image_publisher(ImageTopic::Marked, 1).ok())
            .collect();
        assert!(taken.len() < 100 && !is_shown());
        drop((taken, services, memory));
    }
}

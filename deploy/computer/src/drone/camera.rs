//! Process of one of the drone's cameras, whose output the predictor reads. The belly camera detects the deck's tags;
//! the ultraviolet camera fixes the deck by its blinking markers.
//!
//! Metrics of the belly camera: images; images with the tag, with other tags, too faint, misshapen, without a pose,
//! of another size; contrast and saturation of the tag. Metrics of the ultraviolet camera: images; images with a fix;
//! markers; images with a single marker, without a position, of another size. Metrics of both cameras: time from
//! exposure to detection (median, 99 %), reopenings of the source, exposure and gain.

use std::{
    marker::PhantomData,
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    time::Duration,
};

use alight_shared::{
    bus::{Bus, Edge, Ports as _, RowStep},
    config::{self, Check as _, Keys},
    geometry::DeckGeometry,
    metrics::{Metric, MetricName, MetricValue},
    msg::{CameraLight, Reason, TagPose, UvdarFix},
    node::Node,
    tags::ForeignTag,
    time::{DroneClock, DroneTime, Span, Time},
};
use alight_transport::{
    clock::ProcessClock,
    images::{ImageHeader, ImagePublisher, ImageSubscriber, ImageTopic},
    memory::Memory,
    statistics::Quantiles,
};
use alight_uav::{
    camera::{
        CameraFrame, CameraIn, CameraNode, CameraOut, GreyImage, TagLight,
        foreign_tags::ForeignTags,
        marked::{MAX_BYTES, MarkedImage},
        metering::{Exposed, Light},
        uvdar::{UvdarNode, UvdarOut},
    },
    computer::Installed,
};
use serde_json::{Value, json};
use tracing::warn;

use crate::{
    config::{DroneComputerConfig, camera::CameraSource},
    drone::camera_source::Images,
    exit::{CliError, Exit},
    io::{runtime, wakes::Wakes},
    process::{
        args::CameraArgs,
        run::{AwaitedEdge, NodeView, Process, ProcessEdge},
        supervisor::pause,
    },
    terminal,
};

const IDLE_WAIT: Duration = Duration::from_millis(2);
/// Maximum number of images that wait for the node; further images are dropped.
const QUEUE_LENGTH: usize = 2;
const RETRY_PERIOD: Duration = Duration::from_secs(1);
/// Time after a detection for which the light on the tag is still reported.
const LIGHT_MEMORY: Span = Span::from_millis(1000);

/// Minimum time between two searches for foreign tags: a search takes several image periods.
const FOREIGN_PERIOD: Span = Span::from_millis(2000);
const SHOW_PERIOD: Span = Span::from_millis(500);

pub trait Detector: Installed + Node<In = CameraIn, Clock = DroneClock> {
    fn source(computer: &DroneComputerConfig) -> (CameraSource, [u32; 2]);
    fn set_source(computer: &mut DroneComputerConfig, source: &str);
    /// Time of each detection, with the line to print for it.
    fn detections(out: &Self::Out) -> Vec<(DroneTime, Value)>;
    fn counted(&self) -> (Vec<Metric>, Value);
    fn reported(_out: &Self::Out) -> Option<CameraLight> {
        None
    }
    /// Search for foreign tags in images without the deck's; None for a camera that does not detect tags.
    fn foreign_tags(_computer: &DroneComputerConfig) -> Option<ForeignTags> {
        None
    }
    /// Light of the newest image; None if the image is not metered.
    fn metered(&self) -> Option<Light> {
        None
    }
    fn drawn(&self, _frame: &CameraFrame, _deck: &DeckGeometry) -> Option<MarkedImage> {
        None
    }
    const IS_SHOWN: bool = false;
}

impl Detector for CameraNode {
    fn source(computer: &DroneComputerConfig) -> (CameraSource, [u32; 2]) {
        let lens = &computer.drone.camera.lens;
        (computer.camera.clone(), [lens.width_px, lens.height_px])
    }
    fn set_source(computer: &mut DroneComputerConfig, source: &str) {
        computer.camera.source = source.into();
    }
    fn detections(out: &CameraOut) -> Vec<(DroneTime, Value)> {
        let detection = |m: &TagPose| {
            let line = json!({
                "at_s": m.header.at.secs(),
                "position_m": m.position,
                "attitude_wxyz": m.attitude,
                "sd": m.variance.map(f64::sqrt),
            });
            (m.header.at, line)
        };
        out.tags.iter().map(detection).collect()
    }
    fn counted(&self) -> (Vec<Metric>, Value) {
        let c = self.counts();
        let metrics = vec![
            MetricName::Images.count(c.images),
            MetricName::TagDetections.count(c.detected),
            MetricName::OtherTags.count(c.other_tags),
            MetricName::FaintTags.count(c.faint),
            MetricName::MisshapenTags.count(c.misshapen),
            MetricName::WithoutPose.count(c.misfit),
            MetricName::WrongSize.count(c.wrong_size),
            MetricName::RepeatedImages.count(c.repeated),
        ];
        (metrics, json!(c))
    }
    fn reported(out: &CameraOut) -> Option<CameraLight> {
        out.light
    }
    fn foreign_tags(computer: &DroneComputerConfig) -> Option<ForeignTags> {
        let drone = &computer.drone;
        Some(ForeignTags::new(&drone.camera.tag, &drone.tags()))
    }
    fn metered(&self) -> Option<Light> {
        Some(self.light())
    }
    fn drawn(&self, frame: &CameraFrame, deck: &DeckGeometry) -> Option<MarkedImage> {
        self.marked(frame, deck)
    }
    const IS_SHOWN: bool = true;
}

impl Detector for UvdarNode {
    fn source(computer: &DroneComputerConfig) -> (CameraSource, [u32; 2]) {
        let lens = &computer.drone.camera.uvdar.lens;
        (computer.ultraviolet(), [lens.width_px, lens.height_px])
    }
    fn set_source(computer: &mut DroneComputerConfig, source: &str) {
        computer.uvdar.source = source.into();
    }
    fn detections(out: &UvdarOut) -> Vec<(DroneTime, Value)> {
        let detection = |m: &UvdarFix| {
            let line = json!({
                "at_s": m.header.at.secs(),
                "position_m": m.position,
                "sd": m.variance.map(f64::sqrt),
            });
            (m.header.at, line)
        };
        out.fixes.iter().map(detection).collect()
    }
    fn counted(&self) -> (Vec<Metric>, Value) {
        let c = &self.counts;
        let metrics = vec![
            MetricName::Images.count(c.images),
            MetricName::DeckFixes.count(c.fixes),
            MetricName::Markers.count(c.markers),
            MetricName::SingleMarkers.count(c.single),
            MetricName::WithoutPose.count(c.misfit),
            MetricName::WrongSize.count(c.wrong_size),
        ];
        (metrics, json!(c))
    }
}

/// Images for display, made only while there is a viewer.
struct Shown {
    images: ImagePublisher,
    deck: DeckGeometry,
    next: DroneTime,
}

impl Shown {
    /// None, with a warning, if no memory is available for the images: detection does not depend on the display.
    fn open(memory: &Memory, deck: DeckGeometry) -> Option<Shown> {
        let opened = memory.image_publisher(ImageTopic::Marked, MAX_BYTES);
        let images = opened.inspect_err(|e| {
            warn!(
                "{e}: detection continues, but the page shows no image; restart `alight drone` to restore it"
            );
        });
        Some(Shown {
            images: images.ok()?,
            deck,
            next: Time::EPOCH,
        })
    }
    /// Displays an image that `node` has processed, if one is due.
    fn show(&mut self, frame: &CameraFrame, node: &impl Detector) {
        let early = self.next - frame.at;
        if early > Span::ZERO && early <= SHOW_PERIOD || !self.images.is_read() {
            return;
        }
        if let Some(marked) = node.drawn(frame, &self.deck) {
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

enum Source {
    Simulation(ImageSubscriber),
    /// Thread that waits for a device, a pipe or files. It receives the light of each image by image number.
    Thread(Receiver<SourceEvent>, SyncSender<(u64, Light)>),
}

impl<D: Detector> CameraEdge<D> {
    fn poll(&mut self) {
        match &mut self.source {
            Source::Simulation(images) => {
                while self.input.frames.len() < QUEUE_LENGTH
                    && let Some(image) = images.next_image()
                {
                    let [width, height] = image.header().size.map(|s| s as usize);
                    // The image is copied only here, because the node's input outlives the slot in shared memory. The
                    // publisher guarantees that the size in the header matches the image.
                    if let Ok(grey) = GreyImage::new(width, height, image.pixels().to_vec()) {
                        let at = Time::from_nanos(image.header().at_ns);
                        self.input.frames.push(CameraFrame { at, image: grey });
                    }
                }
            }
            Source::Thread(events, _) => match events.recv_timeout(IDLE_WAIT) {
                Ok(SourceEvent::Image(frame, number, setting)) => {
                    self.number = number;
                    self.light.exposed = setting;
                    self.input.frames.push(frame);
                }
                Ok(SourceEvent::Automatic(why)) => warn!(
                    "{}: {} {why}: the camera's own automatic exposure is in use, perhaps longer than the motion permits; alight check prints \
                     the remedy",
                    D::KIND.name(),
                    self.name
                ),
                Ok(SourceEvent::Failed(why)) => {
                    self.opened = self.opened.saturating_add(1);
                    warn!("{}: {why}; trying again", D::KIND.name());
                }
                Ok(SourceEvent::Finished) => self.over = true,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => self.over = true,
            },
        }
    }
}

enum SourceEvent {
    Image(CameraFrame, u64, Option<Exposed>),
    /// Reason why the device's own automatic exposure is in use.
    Automatic(String),
    Failed(String),
    Finished,
}

/// Explains images without the deck's tags. The first detection proves that the camera is right and ends the search.
#[derive(Default)]
struct ForeignSearch {
    tags: Option<ForeignTags>,
    next: DroneTime,
    found: Option<ForeignTag>,
}

impl ForeignSearch {
    /// Searches an image without detections if a search is due. Returns a new explanation, if any.
    fn undetected(&mut self, frame: &CameraFrame) -> Option<ForeignTag> {
        let tags = self.tags.as_mut().filter(|_| frame.at >= self.next)?;
        self.next = frame.at + FOREIGN_PERIOD;
        let found = tags.find(&frame.image).filter(|tag| self.found != Some(*tag));
        self.found = found.or(self.found);
        found
    }
}

#[derive(Default)]
struct LightRecord {
    exposed: Option<Exposed>,
    tag: Option<(DroneTime, TagLight)>,
    report: Option<CameraLight>,
}

impl LightRecord {
    /// Records the light of an image that the detector has processed, and sends it with the image's number to the
    /// channel in `metered`.
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
            // A full queue means that the thread waits for its device; the next image is metered instead.
            let _full = lights.try_send((number, light));
        }
    }
    /// Records the light; returns the reason if it has become too dark or too bright.
    fn reported(&mut self, light: CameraLight) -> Option<Reason> {
        let before = self.report.and_then(|r| r.hides_tags()).map(|r| r.code);
        self.report = Some(light);
        light.hides_tags().filter(|why| Some(why.code) != before)
    }
    fn metrics(&self, now: DroneTime) -> impl Iterator<Item = Metric> {
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

/// The drone's configuration with the given source, that source, and the size of its images.
fn configured<D: Detector>(
    args: &CameraArgs,
) -> Result<(DroneComputerConfig, CameraSource, [u32; 2]), CliError> {
    let mut computer: DroneComputerConfig = config::load(&args.process.config)?;
    if let Some(source) = &args.source {
        D::set_source(&mut computer, source);
    }
    let (config, size) = D::source(&computer);
    // A source named on the command line must satisfy the same rules.
    computer.check(&Keys::ROOT)?;
    if !config.is_there() {
        return Err(CliError(format!(
            "{}: no camera is configured; set source in [{}] to a V4L2 device such as /dev/video0, or name one \
             with --source",
            args.process.config.display(),
            D::KIND.name()
        )));
    }
    Ok((computer, config, size))
}

pub fn run<D: Detector>(args: &CameraArgs) -> Result<Exit, CliError> {
    let (computer, config, size) = configured::<D>(args)?;
    let alone = args.print && !config.is_simulation();
    let of = (
        Some(computer.instance.as_str()).filter(|_| !alone),
        computer.clock,
    );
    let make = |boot| Ok(D::installed(&computer.nodes(), boot));
    let process = Process::start(D::KIND, &args.process, of, make)?;
    let memory = process.memory.as_ref();
    let shown = memory.filter(|_| D::IS_SHOWN);
    let mut edge = CameraEdge::<D> {
        source: match memory.filter(|_| config.is_simulation()) {
            Some(memory) => Source::Simulation(memory.image_subscriber(ImageTopic::Simulated)?),
            None => spawn_source(&config, size, computer.clock)?,
        },
        shown: shown.and_then(|memory| Shown::open(memory, computer.drone.deck)),
        name: config.source,
        input: CameraIn::default(),
        number: 0,
        over: false,
        keeps_images: computer.recorder.images,
        opened: 0,
        light: LightRecord::default(),
        foreign: ForeignSearch {
            tags: D::foreign_tags(&computer),
            ..ForeignSearch::default()
        },
        ages: Quantiles::default(),
        printed: args.print.then_some(Value::Null),
        detector: PhantomData,
    };
    let ended = runtime::block_on(process.run_awaiting(&mut edge));
    if let Some(counts) = edge.printed.filter(|_| ended.is_ok()) {
        let hint = edge.foreign.found.map(|tag| format!("{tag}: {}", tag.remedy()));
        terminal::line(json!({"counts": counts, "hint": hint}));
    }
    ended
}

struct CameraEdge<D> {
    source: Source,
    name: String,
    /// Received images, number of the newest image, and whether the source has ended.
    input: CameraIn,
    number: u64,
    over: bool,
    /// Images are recorded in full, not as hashes.
    keeps_images: bool,
    opened: u32,
    light: LightRecord,
    foreign: ForeignSearch,
    /// Time from exposure to detection, s.
    ages: Quantiles,
    shown: Option<Shown>,
    /// Counts so far, if each detection is printed.
    printed: Option<Value>,
    detector: PhantomData<D>,
}

impl<D: Detector> Edge<D> for CameraEdge<D> {
    fn read(&mut self, input: &mut CameraIn) {
        *input = core::mem::take(&mut self.input);
        input.exposed = self.light.exposed;
        if self.keeps_images {
            for frame in &mut input.frames {
                frame.image.keep();
            }
        }
    }
    fn write<B: Bus>(&mut self, _input: &CameraIn, out: &mut D::Out, ports: &mut D::Ports<B>) -> bool {
        ports.write(out);
        true
    }
}

impl<D: Detector> ProcessEdge<D> for CameraEdge<D> {
    fn stepped(&mut self, sent: &NodeView<'_, D>, step: &RowStep<D>) {
        let node = sent.node;
        let frames = &step.input.frames;
        if let Some(frame) = frames.last() {
            let metered = match &self.source {
                Source::Thread(_, lights) => Some((self.number, lights)),
                Source::Simulation(_) => None,
            };
            self.light.looked(frame, node.metered(), metered);
            if let Some(shown) = &mut self.shown {
                shown.show(frame, node);
            }
        }
        if let Some(why) = D::reported(&step.out).and_then(|light| self.light.reported(light)) {
            warn!("{}: {why}", D::KIND.name());
        }
        let detections = D::detections(&step.out);
        for (at, _) in &detections {
            self.ages.add((sent.now - *at).secs());
        }
        if !detections.is_empty() {
            self.foreign = ForeignSearch::default();
        } else if let Some(tag) = frames.last().and_then(|frame| self.foreign.undetected(frame)) {
            warn!("{}: {tag}: {}", D::KIND.name(), tag.remedy());
        }
        if self.printed.is_some() {
            print(frames, &detections);
        }
    }
    fn metrics(&mut self, at: &NodeView<'_, D>) -> Vec<Metric> {
        let own = [
            MetricName::ExposureToFixP50.seconds(self.ages.quantile(0.5)),
            MetricName::ExposureToFixP99.seconds(self.ages.quantile(0.99)),
            MetricName::SourceReopened.count(self.opened),
        ];
        let (counts, text) = at.node.counted();
        if let Some(printed) = &mut self.printed {
            *printed = text.clone();
        }
        counts
            .into_iter()
            .chain(own)
            .chain(self.light.metrics(at.now))
            .chain(
                (self.foreign.found)
                    .map(|tag| MetricName::ForeignTag.with(MetricValue::ForeignTag(Some(tag)))),
            )
            .collect()
    }
    fn is_over(&self) -> bool {
        self.over
    }
}

impl<D: Detector> AwaitedEdge<D> for CameraEdge<D> {
    /// Only the source wakes the process; this waits for it outside the runtime.
    async fn arrival(&mut self, _wakes: &Wakes) -> Result<bool, CliError> {
        self.poll();
        let due = !self.input.frames.is_empty();
        if !due && matches!(self.source, Source::Simulation(_)) {
            pause(IDLE_WAIT);
        }
        Ok(due)
    }
}

/// Waits for images on a separate thread, so that the process continues to report.
fn spawn_source(config: &CameraSource, size: [u32; 2], clock: ProcessClock) -> Result<Source, CliError> {
    let size = size.map(|s| s as usize);
    // Bad input is rejected at once; a source that fails later is retried.
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
    let config = config.clone();
    std::thread::spawn(move || {
        while let Some(why) = source.show(&clock) {
            if source.events.send(SourceEvent::Failed(why)).is_err() {
                return;
            }
            pause(RETRY_PERIOD);
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
    Ok(Source::Thread(received, lights))
}

struct SourceThread {
    images: Images,
    events: SyncSender<SourceEvent>,
    metered: Receiver<(u64, Light)>,
    number: u64,
    automatic: bool,
}

impl SourceThread {
    /// Sends images until the source fails, and returns the reason; None if there are no more images or no receiver.
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
                    // Files wait for the node; a camera's image is dropped if the queue is full.
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
                // A failed file does not end the source: the next file may be valid.
                Err(CliError(why)) if files => self.events.send(SourceEvent::Failed(why)).ok()?,
                Err(CliError(why)) => return Some(why),
            }
        }
    }
}

fn print(frames: &[CameraFrame], detections: &[(DroneTime, Value)]) {
    for frame in frames {
        let found = detections.iter().find(|(at, _)| *at == frame.at);
        let none = json!({"at_s": frame.at.secs(), "position_m": null});
        terminal::line(found.map_or(none, |(_, line)| line.clone()));
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
        let is_shown = || Shown::open(&memory, DeckGeometry::default()).is_some();
        assert!(is_shown());
        let taken: Vec<_> = (0..100)
            .map_while(|_| memory.image_publisher(ImageTopic::Marked, 1).ok())
            .collect();
        assert!(taken.len() < 100 && !is_shown());
        drop((taken, services, memory));
    }
}

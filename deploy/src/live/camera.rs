//! A camera of the drone as a process: images in; sightings of the deck's tag (belly camera) or fixes of the
//! deck by its blinking markers (ultraviolet camera) to the topic that the predictor reads.
//! Figures of the first: images, those with the tag, other tags, too faint, misshapen, without a pose, of
//! another size; of the second: images, those with a fix, markers, images with one marker only, without a
//! place, of another size. Of both: the time from exposure to sighting (median, 99 %), times its source was
//! opened again.

use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use alight_shared::config::{self, Check as _, Keys};
use alight_shared::msg::{TagPose, UvdarFix};
use alight_shared::node::Node;
use alight_shared::seq::Seq;
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::images::ImageSubscriber;
use alight_shared::transport::intake::Quantiles;
use alight_shared::transport::memory::{Instance, Memory, Publisher};
use alight_shared::transport::process::{ProcessKind, ProcessState};
use alight_uav::camera::node::Names;
use alight_uav::camera::uvdar::UvdarNode;
use alight_uav::camera::{CameraIn, CameraNode, Frame, Grey};
use serde_json::{Value, json};

use super::args::CameraArgs;
use super::camera_source::{CameraSource, Images};
use super::config::DroneComputer;
use super::process::{Life, draw_boot};
use crate::{End, Refused, say};

/// Without news it looks again after this long.
const BEAT: Duration = Duration::from_millis(2);
/// Images that wait for the node; more are lost.
const WAITING: usize = 2;
/// A source that broke is opened again after this long.
const AGAIN: Duration = Duration::from_secs(1);

/// Where sightings go.
struct Shared {
    memory: Memory,
    states: Publisher<ProcessState>,
}

/// What looks at images, and where it says what it saw.
enum Eye {
    /// For the tag.
    Tag(CameraNode, Option<Publisher<TagPose>>),
    /// For the blinking markers.
    Markers(UvdarNode, Option<Publisher<UvdarFix>>),
}

/// A sighting as people read it.
struct Sighting {
    at: Time<DroneClock>,
    line: Value,
}

impl Eye {
    fn new(
        kind: ProcessKind,
        computer: &DroneComputer,
        names: Names,
        memory: Option<&Memory>,
    ) -> Result<Eye, Refused> {
        let settings = &computer.drone.camera;
        Ok(if kind == ProcessKind::Uvdar {
            let fixes = memory.map(Memory::publisher).transpose()?;
            Eye::Markers(UvdarNode::new(&settings.uvdar, names), fixes)
        } else {
            let tags = memory.map(Memory::publisher).transpose()?;
            let node = CameraNode::new(settings, computer.drone.deck.tag_side_m, names);
            Eye::Tag(node, tags)
        })
    }
    /// Looks, and says what it saw.
    fn look(&mut self, now: Time<DroneClock>, input: &CameraIn) -> Vec<Sighting> {
        match self {
            Eye::Tag(node, port) => {
                let tags = node.step(now, input).tags;
                if let Some(port) = port {
                    tags.iter().for_each(|tag| port.send(tag));
                }
                let line = |m: &TagPose| {
                    json!({
                        "at_s": m.header.at.secs(),
                        "position_m": m.position,
                        "attitude_wxyz": m.attitude,
                        "sd": m.variance.map(f64::sqrt),
                    })
                };
                tags.iter()
                    .map(|m| Sighting {
                        at: m.header.at,
                        line: line(m),
                    })
                    .collect()
            }
            Eye::Markers(node, port) => {
                let fixes = node.step(now, input).fixes;
                if let Some(port) = port {
                    fixes.iter().for_each(|fix| port.send(fix));
                }
                let line = |m: &UvdarFix| {
                    json!({
                        "at_s": m.header.at.secs(),
                        "position_m": m.position,
                        "sd": m.variance.map(f64::sqrt),
                    })
                };
                fixes
                    .iter()
                    .map(|m| Sighting {
                        at: m.header.at,
                        line: line(m),
                    })
                    .collect()
            }
        }
    }
    /// Messages that could not be sent.
    fn unsent(&self) -> u64 {
        match self {
            Eye::Tag(_, port) => port.as_ref().map_or(0, Publisher::unsent),
            Eye::Markers(_, port) => port.as_ref().map_or(0, Publisher::unsent),
        }
    }
    /// What became of images, in the order of the figures.
    fn figures(&self) -> Vec<u64> {
        match self {
            Eye::Tag(node, _) => {
                let c = node.counts();
                vec![
                    c.images,
                    c.seen,
                    c.other_tags,
                    c.faint,
                    c.misshapen,
                    c.misfit,
                    c.wrong_size,
                ]
            }
            Eye::Markers(node, _) => {
                let c = &node.counts;
                vec![c.images, c.fixes, c.markers, c.single, c.misfit, c.wrong_size]
            }
        }
    }
    /// The same for people.
    fn counts(&self) -> Value {
        match self {
            Eye::Tag(node, _) => json!(node.counts()),
            Eye::Markers(node, _) => json!(node.counts),
        }
    }
}

/// Where images come from.
enum Source {
    /// The simulated world, through shared memory.
    Simulation(ImageSubscriber),
    /// A thread that waits for a device, a pipe or files.
    Outside(Receiver<Word>),
}

/// What that thread says.
enum Word {
    /// An image.
    Image(Frame),
    /// It broke; it is tried again.
    Broke(String),
    /// There are no more images.
    End,
}

/// Runs until told to end, as the belly camera or as the ultraviolet one.
pub fn run(args: &CameraArgs, kind: ProcessKind) -> Result<End, Refused> {
    let mut computer: DroneComputer =
        config::load(&args.process.config).map_err(|e| Refused(e.to_string()))?;
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
    computer.check(&Keys::ROOT).map_err(|e| Refused(e.to_string()))?;
    if !config.is_there() {
        return Err(Refused(format!(
            "{}: no camera is configured; set source in [{}] to a V4L2 device such as /dev/video0, or name one \
             with --source",
            args.process.config.display(),
            kind.name()
        )));
    }
    let names = Names {
        vessel: computer.bridge.vessel_id,
        drone: computer.bridge.drone_id,
        boot: draw_boot(),
    };
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
    let mut eye = Eye::new(kind, &computer, names, shared.as_ref().map(|s| &s.memory))?;
    let mut source = match &shared {
        Some(shared) if config.is_simulation() => Source::Simulation(shared.memory.image_subscriber()?),
        Some(_) | None => Source::Outside(outside(kind, &config, &computer)?),
    };
    let mut life = Life::begin(kind, names.boot, args.process.supervised);
    let mut ages = Quantiles::default();
    let (mut opened, mut last) = (0_u32, Time::<DroneClock>::from_nanos(i64::MIN));
    while !life.ended() {
        let mut input = CameraIn::default();
        let mut over = false;
        match &mut source {
            Source::Simulation(images) => {
                while input.frames.len() < WAITING
                    && let Some(image) = images.next_image()
                {
                    let [width, height] = image.size.map(|s| s as usize);
                    // One of another size than it says is what no publisher of ours sends.
                    if let Ok(grey) = Grey::new(width, height, image.pixels) {
                        let at = Time::from_nanos(image.at_ns);
                        input.frames.push(Frame { at, image: grey });
                    }
                }
            }
            Source::Outside(words) => match words.recv_timeout(BEAT) {
                Ok(Word::Image(frame)) => input.frames.push(frame),
                Ok(Word::Broke(why)) => {
                    opened = opened.saturating_add(1);
                    eprintln!("{}: {why}; trying again", kind.name());
                }
                Ok(Word::End) => over = true,
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => over = true,
            },
        }
        if !input.frames.is_empty() {
            last = last.max(computer.clock.now());
            let before = steady_ns();
            let seen = eye.look(last, &input);
            life.stepped(Some((steady_ns() - before) as f64 * 1e-9));
            let sent: Time<DroneClock> = computer.clock.now();
            seen.iter().for_each(|s| ages.add((sent - s.at).secs()));
            if args.print {
                print(&input, &seen);
            }
        } else if let (Some(shared), Source::Simulation(_)) = (&shared, &source)
            && !shared.memory.wait(BEAT)
        {
            break;
        }
        let figures = eye.figures().into_iter().map(|n| n as f64);
        let times = [ages.quantile(0.5), ages.quantile(0.99), f64::from(opened)];
        life.figures = Seq::filled(figures.chain(times));
        if let Some(shared) = &mut shared
            && let Some(said) = life.state(Vec::new, eye.unsent())
        {
            shared.states.send(&said);
        }
        if over {
            break;
        }
    }
    if args.print {
        say::line(json!({"counts": eye.counts()}));
    }
    Ok(End::Success)
}

/// Waits for images on a thread of its own, so that the process goes on saying that it lives.
fn outside(
    kind: ProcessKind,
    config: &CameraSource,
    computer: &DroneComputer,
) -> Result<Receiver<Word>, Refused> {
    let eyes = &computer.drone.camera;
    let (tag, markers) = (&eyes.lens, &eyes.uvdar.lens);
    let size = if kind == ProcessKind::Uvdar {
        [markers.width_px, markers.height_px]
    } else {
        [tag.width_px, tag.height_px]
    };
    let size = size.map(|s| s as usize);
    // Bad input is refused at once; what breaks later is tried again.
    let mut images = Images::open(config, size)?;
    let (sender, receiver) = sync_channel(WAITING);
    let (config, clock) = (config.clone(), computer.clock);
    std::thread::spawn(move || {
        loop {
            let why = loop {
                match images.next_frame(&clock) {
                    Ok(Some(frame)) => {
                        // Files wait for the node; of a camera the newest counts.
                        let sent = if matches!(images, Images::Files(_)) {
                            sender.send(Word::Image(frame)).is_ok()
                        } else {
                            !matches!(
                                sender.try_send(Word::Image(frame)),
                                Err(std::sync::mpsc::TrySendError::Disconnected(_))
                            )
                        };
                        if !sent {
                            return;
                        }
                    }
                    Ok(None) => {
                        let _gone = sender.send(Word::End);
                        return;
                    }
                    Err(Refused(why)) if matches!(images, Images::Files(_)) => {
                        // The next file may be sound.
                        if sender.send(Word::Broke(why)).is_err() {
                            return;
                        }
                    }
                    Err(Refused(why)) => break why,
                }
            };
            if sender.send(Word::Broke(why)).is_err() {
                return;
            }
            super::supervisor::pause(AGAIN);
            match Images::open(&config, size) {
                Ok(again) => images = again,
                Err(Refused(why)) => {
                    if sender.send(Word::Broke(why)).is_err() {
                        return;
                    }
                }
            }
        }
    });
    Ok(receiver)
}

/// A line for each image: where tag or deck is, or that it is not seen.
fn print(input: &CameraIn, seen: &[Sighting]) {
    for frame in &input.frames {
        let found = seen.iter().find(|s| s.at == frame.at);
        let none = json!({"at_s": frame.at.secs(), "position_m": null});
        say::line(found.map_or(none, |s| s.line.clone()));
    }
}

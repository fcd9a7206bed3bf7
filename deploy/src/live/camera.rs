//! The belly camera as a process: images in, sightings of the tag to the topic that the predictor reads.
//! Its figures: images, those with the tag, other tags, too faint, misshapen, without a pose, of another
//! size, the time from exposure to sighting (median, 99 %), times its source was opened again.

use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use alight_shared::config;
use alight_shared::node::Node;
use alight_shared::seq::Seq;
use alight_shared::time::{DroneClock, Time};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::images::ImageSubscriber;
use alight_shared::transport::intake::Quantiles;
use alight_shared::transport::memory::{Instance, Memory, Publisher};
use alight_shared::transport::process::{ProcessKind, ProcessState};
use alight_uav::camera::node::Names;
use alight_uav::camera::{CameraIn, CameraNode, CameraOut, Frame, Grey};
use serde_json::json;

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
    tags: Publisher<alight_shared::msg::TagPose>,
    states: Publisher<ProcessState>,
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

/// Runs until told to end.
pub fn run(args: &CameraArgs) -> Result<End, Refused> {
    let mut computer: DroneComputer =
        config::load(&args.process.config).map_err(|e| Refused(e.to_string()))?;
    if let Some(source) = &args.source {
        computer.camera.source.clone_from(source);
    }
    let config = computer.camera.clone();
    if !config.is_there() {
        return Err(Refused(format!(
            "{}: no camera is configured; set source in [camera] to a V4L2 device such as /dev/video0, or name \
             one with --source",
            args.process.config.display()
        )));
    }
    let names = Names {
        vessel: computer.bridge.vessel_id,
        drone: computer.bridge.drone_id,
        boot: draw_boot(),
    };
    let settings = &computer.drone.camera;
    let mut node = CameraNode::new(settings, computer.drone.deck.tag_side_m, names);
    let shared = if args.print && !config.is_simulation() {
        None
    } else {
        let memory = Memory::join(&Instance::new(&computer.instance)?, ProcessKind::Camera.name())?;
        Some(Shared {
            tags: memory.publisher()?,
            states: memory.publisher()?,
            memory,
        })
    };
    let mut shared = shared;
    let mut source = match &shared {
        Some(shared) if config.is_simulation() => Source::Simulation(shared.memory.image_subscriber()?),
        Some(_) | None => Source::Outside(outside(&config, &computer)?),
    };
    let mut life = Life::begin(ProcessKind::Camera, names.boot, args.process.supervised);
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
                    eprintln!("camera: {why}; trying again");
                }
                Ok(Word::End) => over = true,
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => over = true,
            },
        }
        if !input.frames.is_empty() {
            last = last.max(computer.clock.now());
            let before = steady_ns();
            let out = node.step(last, &input);
            life.stepped(Some((steady_ns() - before) as f64 * 1e-9));
            let sent: Time<DroneClock> = computer.clock.now();
            if let Some(shared) = &mut shared {
                out.tags.iter().for_each(|tag| shared.tags.send(tag));
            }
            out.tags
                .iter()
                .for_each(|tag| ages.add((sent - tag.header.at).secs()));
            if args.print {
                print(&input, &out);
            }
        } else if let (Some(shared), Source::Simulation(_)) = (&shared, &source)
            && !shared.memory.wait(BEAT)
        {
            break;
        }
        let c = node.counts();
        let counts = [
            c.images,
            c.seen,
            c.other_tags,
            c.faint,
            c.misshapen,
            c.misfit,
            c.wrong_size,
        ];
        let figures = counts.into_iter().map(|n| n as f64);
        let times = [ages.quantile(0.5), ages.quantile(0.99), f64::from(opened)];
        life.figures = Seq::filled(figures.chain(times));
        if let Some(shared) = &mut shared
            && let Some(said) = life.state(Vec::new, shared.tags.unsent())
        {
            shared.states.send(&said);
        }
        if over {
            break;
        }
    }
    if args.print {
        say::line(json!({"counts": node.counts()}));
    }
    Ok(End::Success)
}

/// Waits for images on a thread of its own, so that the process goes on saying that it lives.
fn outside(config: &CameraSource, computer: &DroneComputer) -> Result<Receiver<Word>, Refused> {
    // Bad input is refused at once; what breaks later is tried again.
    let mut images = Images::open(config, &computer.drone.camera.lens)?;
    let (sender, receiver) = sync_channel(WAITING);
    let (config, lens, clock) = (config.clone(), computer.drone.camera.lens, computer.clock);
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
            match Images::open(&config, &lens) {
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

/// A line for each image: where the tag is, or that it is not there.
fn print(input: &CameraIn, out: &CameraOut) {
    for frame in &input.frames {
        let seen = out.tags.iter().find(|tag| tag.header.at == frame.at);
        say::line(json!({
            "at_s": frame.at.secs(),
            "position_m": seen.map(|t| t.position),
            "attitude_wxyz": seen.map(|t| t.attitude),
            "sd": seen.map(|t| t.variance.map(f64::sqrt)),
        }));
    }
}

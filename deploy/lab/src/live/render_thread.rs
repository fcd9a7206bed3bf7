//! Simulated camera of a live landing: a thread that renders the shots of the world's shutter, and publishes the
//! images in the drone's shared memory or writes them as a device would.

use std::{
    fs::{File, OpenOptions},
    io::Write,
    os::unix::fs::OpenOptionsExt,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
        mpsc::{SyncSender, sync_channel},
    },
    time::Duration,
};

use alight_computer::{
    exit::CliError,
    process::{scheduling, supervisor::pause},
};
use alight_sim::{
    harness::scenario::Scenario,
    physics::streams::Streams,
    sensors::{
        camera::CameraMount,
        render::{Renderer, Shot},
    },
};
use alight_transport::{
    clock::steady_ns,
    images::{ImageHeader, ImagePublisher, ImageTopic},
    memory::{Instance, Memory},
};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

use crate::live::config::Devices;

/// Maximum number of shots in the queue; further shots are lost, as in an overrun camera.
const QUEUE_LENGTH: usize = 2;

/// Maximum lateness of a device's image, ns; a later image is lost, because the reader derives the age from the
/// nominal delay.
const MAX_LATE_NS: i64 = 5_000_000;

pub struct RenderThread {
    shots: SyncSender<Shot>,
    lost: Arc<AtomicU64>,
}

enum Sink {
    /// Shared memory of the drone, which must outlive its port.
    Memory { images: ImagePublisher, _memory: Memory },
    /// Named pipe that the drone's computer reads like a device.
    Pipe(Pipe),
}

impl Sink {
    /// Renders an image of this size into the drone's shared memory or for the pipe; false if it is lost.
    fn take(&mut self, shot: &Shot, size: [u32; 2], renderer: &mut Renderer) -> bool {
        match self {
            Sink::Memory { images, .. } => {
                let header = ImageHeader {
                    at_ns: shot.at.nanos(),
                    size,
                    marks: [0; 2],
                };
                let bytes = size.iter().map(|side| *side as usize).product();
                images.send_with(header, bytes, |pixels| renderer.render(shot, pixels));
                true
            }
            Sink::Pipe(pipe) => {
                let image = renderer.image(shot);
                image.is_some_and(|image| pipe.write(shot.at.nanos(), image.pixels()))
            }
        }
    }
    /// Whether an image exposed at this time would be lost. In shared memory an image carries its time and is never
    /// late.
    fn too_late(&self, shot: &Shot) -> bool {
        match self {
            Sink::Memory { .. } => false,
            Sink::Pipe(pipe) => pipe.early_ns(shot.at.nanos()) < -MAX_LATE_NS,
        }
    }
}

/// Named pipe of raw images, each delivered at its time.
struct Pipe {
    devices: Devices,
    open: Option<File>,
}

impl Pipe {
    /// Time until the image exposed at `at_ns` of the drone's clock (the steady clock) is due, ns.
    fn early_ns(&self, at_ns: i64) -> i64 {
        at_ns + (self.devices.camera_delay_s * 1e9) as i64 - steady_ns()
    }
    /// Delivers the image that was exposed at `at_ns`. A late image, or one without a reader, is lost.
    fn write(&mut self, at_ns: i64, pixels: &[u8]) -> bool {
        let early_ns = self.early_ns(at_ns);
        if early_ns < -MAX_LATE_NS {
            return false;
        }
        if early_ns > 0 {
            pause(Duration::from_nanos(early_ns.unsigned_abs()));
        }
        if self.open.is_none() {
            self.open = self.reader();
        }
        let written = self
            .open
            .as_mut()
            .is_some_and(|pipe| pipe.write_all(pixels).is_ok());
        if !written {
            self.open = None;
        }
        written
    }
    fn reader(&self) -> Option<File> {
        let flags = OFlags::NONBLOCK.bits().cast_signed();
        let pipe = OpenOptions::new()
            .write(true)
            .custom_flags(flags)
            .open(&self.devices.camera)
            .ok()?;
        let flags = fcntl_getfl(&pipe).ok()?;
        fcntl_setfl(&pipe, flags - OFlags::NONBLOCK).ok()?;
        Some(pipe)
    }
}

impl RenderThread {
    /// Camera for this seed that renders into shared memory; None if the measurement model replaces it.
    pub fn of(instance: &Instance, scenario: &Scenario, seed: u64) -> Result<Option<RenderThread>, CliError> {
        let render = &scenario.sensors.render;
        if !render.on {
            return Ok(None);
        }
        let pixels = render.lens.width_px as usize * render.lens.height_px as usize;
        let instance = instance.clone();
        let open = move || {
            // Ports of shared memory belong to the thread that uses them.
            let memory = Memory::join(&instance, "render_thread")?;
            let images = memory.image_publisher(ImageTopic::Simulated, pixels)?;
            Ok(Sink::Memory {
                images,
                _memory: memory,
            })
        };
        RenderThread::start(open, scenario, seed).map(Some)
    }
    pub fn into_pipe(devices: &Devices, scenario: &Scenario, seed: u64) -> Result<RenderThread, CliError> {
        let devices = devices.clone();
        let open = move || Ok(Sink::Pipe(Pipe { devices, open: None }));
        RenderThread::start(open, scenario, seed)
    }

    fn start(
        open: impl FnOnce() -> Result<Sink, CliError> + Send + 'static,
        scenario: &Scenario,
        seed: u64,
    ) -> Result<RenderThread, CliError> {
        let (shots, waiting) = sync_channel::<Shot>(QUEUE_LENGTH);
        let (result, joined) = sync_channel::<Result<(), CliError>>(1);
        let scenario = scenario.clone();
        let lost = Arc::<AtomicU64>::default();
        let lost_here = Arc::clone(&lost);
        std::thread::spawn(move || {
            // The world's motion takes precedence over its images.
            scheduling::leave_real_time();
            let mut sink = match open() {
                Ok(sink) => sink,
                Err(e) => {
                    let _gone = result.send(Err(e));
                    return;
                }
            };
            let streams = Streams::new(seed);
            let airframe = &scenario.airframe;
            let mount = CameraMount::new(&scenario.sensors.camera_mount, airframe, &streams);
            let mut renderer = Renderer::new(&scenario.sensors.render, &scenario.deck, &streams)
                .below(airframe, &mount)
                .at_night(scenario.sensors.night.as_ref());
            let lens = &scenario.sensors.render.lens;
            let size = [lens.width_px, lens.height_px];
            if result.send(Ok(())).is_err() {
                return;
            }
            // The thread ends when the world drops the sending end.
            while let Ok(shot) = waiting.recv() {
                let delivered = !sink.too_late(&shot) && sink.take(&shot, size, &mut renderer);
                lost_here.fetch_add(u64::from(!delivered), Ordering::Relaxed);
            }
        });
        match joined.recv() {
            Ok(Ok(())) => Ok(RenderThread { shots, lost }),
            Ok(Err(why)) => Err(why),
            Err(e) => Err(CliError::because("starting the simulated camera", e)),
        }
    }
    pub fn take(&mut self, shots: &[Shot]) {
        for shot in shots {
            let full = self.shots.try_send(*shot).is_err();
            self.lost.fetch_add(u64::from(full), Ordering::Relaxed);
        }
    }
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

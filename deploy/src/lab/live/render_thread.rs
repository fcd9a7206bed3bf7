//! The simulated camera of a live landing: a thread that renders what the world's shutter took, and
//! publishes the images in the drone's shared memory.

use std::sync::mpsc::{SyncSender, sync_channel};

use alight_shared::transport::memory::{Instance, Memory};
use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::streams::Streams;
use alight_sim::sensors::render::{Renderer, Shot};

use crate::exit::CliError;

/// Shots that wait for the thread; more are lost, as a camera that is overrun loses images.
const QUEUE_LENGTH: usize = 2;

/// The way to that thread.
pub struct RenderThread {
    shots: SyncSender<Shot>,
    lost: u64,
}

impl RenderThread {
    /// The camera of a seed; None where the measurement model stands for it.
    pub fn of(instance: &Instance, scenario: &Scenario, seed: u64) -> Result<Option<RenderThread>, CliError> {
        let render = &scenario.sensors.render;
        if !render.on {
            return Ok(None);
        }
        let pixels = render.lens.width_px as usize * render.lens.height_px as usize;
        let (shots, waiting) = sync_channel::<Shot>(QUEUE_LENGTH);
        let (result, joined) = sync_channel::<Result<(), CliError>>(1);
        let (instance, render, deck) = (instance.clone(), render.clone(), scenario.deck);
        std::thread::spawn(move || {
            // Shared memory's ports belong to the thread that uses them.
            let memory = Memory::join(&instance, "render_thread");
            let images = memory.and_then(|m| m.image_publisher(pixels).map(|p| (m, p)));
            let (_memory, mut images) = match images {
                Ok(images) => images,
                Err(e) => {
                    let _gone = result.send(Err(e.into()));
                    return;
                }
            };
            let mut renderer = Renderer::new(&render, &deck, &Streams::new(seed));
            if result.send(Ok(())).is_err() {
                return;
            }
            // Ends with the world, which holds the other end.
            while let Ok(shot) = waiting.recv() {
                if let Some(image) = renderer.image(&shot) {
                    let size = [image.width() as u32, image.height() as u32];
                    images.send(shot.at.nanos(), size, image.pixels());
                }
            }
        });
        match joined.recv() {
            Ok(Ok(())) => Ok(Some(RenderThread { shots, lost: 0 })),
            Ok(Err(why)) => Err(why),
            Err(e) => Err(CliError::because("starting the simulated camera", e)),
        }
    }
    /// Renders these.
    pub fn take(&mut self, shots: &[Shot]) {
        for shot in shots {
            self.lost += u64::from(self.shots.try_send(*shot).is_err());
        }
    }
    /// Images that were never rendered.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

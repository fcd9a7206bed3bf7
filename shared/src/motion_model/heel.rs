//! Slow tilt of a vessel, which turns with it.

use super::{SAMPLE_S, turned};

/// A low-pass of the tilt in the vessel's axes, at first the mean of all samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heel {
    /// About the vessel's bow and about starboard, rad.
    angles: [f64; 2],
    /// Time constant, s.
    memory_s: f64,
    /// Samples since the start.
    samples: f64,
}

impl Heel {
    /// Level, and followed over `memory_s` (s).
    pub(super) fn over(memory_s: f64) -> Heel {
        Heel {
            angles: [0.0; 2],
            memory_s,
            samples: 0.0,
        }
    }
    /// Follows a sample's tilt about north and about east (rad) of a vessel on this mean heading, rad.
    pub(super) fn follow(&mut self, tilt: [f64; 2], mean_heading: f64) {
        self.samples += 1.0;
        let fraction = (SAMPLE_S / self.memory_s).max(1.0 / self.samples);
        for (angle, tilt) in self.angles.iter_mut().zip(turned(tilt, mean_heading)) {
            *angle += (tilt - *angle) * fraction;
        }
    }
    /// Tilt about north and about east (rad) of a vessel on this mean heading, rad.
    pub(super) fn at(&self, mean_heading: f64) -> [f64; 2] {
        turned(self.angles, -mean_heading)
    }
}

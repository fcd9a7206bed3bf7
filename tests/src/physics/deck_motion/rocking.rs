//! A deck that rolls and pitches sinusoidally, like a small platform in short waves or a test rig.
//!
//! `roll = A_r sin(2 pi f t + p_r)`, `pitch = A_p sin(2 pi 0.8 f t + p_p)`. Phases are drawn per seed, and
//! the frequencies differ so that the axes do not stay in phase. The deck's centre heaves with the sea.

use core::f64::consts::TAU;

use alight_shared::config::{Check, ConfigError, Keys};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::recording::{CHANNELS, HEADING, PITCH, ROLL};
use crate::physics::{spline::Jet, streams::Streams};

const PITCH_FREQUENCY: f64 = 0.8;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RockingConfig {
    pub roll_rad: f64,
    pub pitch_rad: f64,
    pub frequency_hz: f64,
}

impl Check for RockingConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("roll_rad", self.roll_rad, 0.0, 0.8)?;
        at.range("pitch_rad", self.pitch_rad, 0.0, 0.8)?;
        at.range("frequency_hz", self.frequency_hz, 0.01, 5.0)
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Rocking {
    /// Amplitude (rad), angular frequency (rad/s), phase (rad) of roll and pitch.
    waves: [[f64; 3]; 2],
    heading: f64,
}

impl Rocking {
    /// `scale` multiplies the amplitudes; phases come from the stream `deck/rocking`.
    pub fn new(config: &RockingConfig, scale: f64, heading: f64, streams: &Streams) -> Self {
        let mut rng = streams.stream("deck/rocking");
        let omega = TAU * config.frequency_hz;
        let mut wave = |amplitude: f64, omega: f64| [scale * amplitude, omega, rng.random::<f64>() * TAU];
        Rocking {
            waves: [
                wave(config.roll_rad, omega),
                wave(config.pitch_rad, PITCH_FREQUENCY * omega),
            ],
            heading,
        }
    }

    pub(super) fn channels(&self, t: f64) -> [Jet; CHANNELS] {
        let mut j = [Jet::default(); CHANNELS];
        for (channel, [a, w, p]) in [ROLL, PITCH].into_iter().zip(self.waves) {
            let (s, c) = (w * t + p).sin_cos();
            j[channel] = Jet {
                y: a * s,
                d: a * w * c,
                dd: -a * w * w * s,
            };
        }
        j[HEADING].y = self.heading;
        j
    }
}

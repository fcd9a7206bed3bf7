//! Motion of the deck: simulated (vessel, or response table) or prescribed (recorded, or sinusoidal: [`rocking`]).
//!
//! A recording (CSV) has roll (positive starboard down), pitch (positive bow up) and optionally heave (positive up),
//! heading, surge and sway, at any rate, with jitter, repeated stamps and gaps. Natural cubic splines make it twice
//! differentiable, so that velocity, acceleration and rates are consistent with the motion.
//!
//! - The recording describes the deck: the angles rotate it about its centre; surge, sway and heave move that
//!   centre relative to its position at rest. The vessel's reference point follows rigidly.
//! - Surge and sway are displacements along and to starboard of the mean heading. Surge, sway and heave are
//!   relative to their means. The mean roll and pitch (usually a mounting error) are removed unless
//!   `keep_mean` is set. `scale` multiplies the deviations from the means.
//! - Without recorded heave, the deck centre follows the sea's elevation below it.
//! - Without a recorded heading, the heading is constant and drawn per seed.
//! - The recording loops: over the last seconds (5 s, or a quarter of a short recording) the end is blended
//!   into the beginning by a twice differentiable weight. Heading, surge and sway continue from their values
//!   at the end instead of jumping back.

mod recording;
pub mod rocking;

use core::f64::consts::TAU;
use std::path::PathBuf;

use alight_shared::{
    config,
    frames::{Deck, Point, Rotation, Vector, VesselBody},
    geometry::DeckGeometry,
    time::{Span, Time, WorldTime},
};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;

pub use self::recording::{DeckMotionError, Recording};
use self::{
    recording::{CHANNELS, HEADING, HEAVE, PITCH, ROLL, SURGE, SWAY},
    rocking::{Rocking, RockingConfig},
};
use crate::physics::{
    body::{RigidState, body_motion},
    sea::Sea,
    spline::{Jet, Splines, smooth_step},
    streams::Streams,
    vessel::{Vessel, VesselConfig, response::ResponseVessel},
};

const BLEND_S: f64 = 5.0;
/// Step of the sea's numerical derivatives, s. Error (w h)²/6: below 1e-3 for waves longer than 2 s.
const SEA_STEP_S: f64 = 0.02;
/// Maximum tilt of a scaled recording, rad (60 deg).
const MAX_TILT: f64 = core::f64::consts::FRAC_PI_3;

config! {
    /// A recording and its playback, or sinusoidal rocking. By default a recording is played as is, from its start.
    pub struct DeckMotionConfig {
        /// CSV file with t_s, roll_deg, pitch_deg and optionally heave_m, heading_deg, surge_m, sway_m; empty
        /// with `rocking`.
        pub file: PathBuf = PathBuf::new();
        /// Sinusoidal roll and pitch instead of a file.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub rocking: Option<RockingConfig> = None;
        /// Factor applied to the deviations from the means.
        pub scale: f64 = 1.0, in 0.0..=20.0;
        /// Factor applied to the playback speed: 2 plays twice as fast.
        pub speed: f64 = 1.0, in 0.02..=20.0;
        /// Time in the recording, from its first row, that is played at the world's time zero, s.
        pub start_s: f64 = 0.0, in 0.0..=1e7;
        /// Keep the mean roll and pitch.
        pub keep_mean: bool = false;
        /// Move the water's surface with the recorded heave, in addition to the sea.
        pub water_follows: bool = false;
    }
    check |this, at| {
        at.require(
            this.file.as_os_str().is_empty() == this.rocking.is_some(),
            "file",
            this.file.display(),
            "the path of a CSV file, or empty with a table `rocking`",
        )?;
        if let Some(rocking) = &this.rocking {
            rocking.check(&at.table("rocking"))?;
            let steepest = this.scale * rocking.roll_rad.max(rocking.pitch_rad);
            at.require(
                steepest <= MAX_TILT,
                "scale",
                this.scale,
                "a tilt of at most 60 deg",
            )?;
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct RecordingFacts {
    pub duration_s: f64,
    pub heave: bool,
    pub remarks: Vec<String>,
}

impl DeckMotionConfig {
    /// `trial_s` is the duration of the trial, s. None without a file.
    pub fn facts(&self, trial_s: f64) -> Result<Option<RecordingFacts>, DeckMotionError> {
        if self.rocking.is_some() {
            return Ok(None);
        }
        let recording = Recording::load(&self.file)?;
        let duration_s = recording.t.last().copied().unwrap_or_default();
        let mut remarks = recording.remarks;
        if recording.gaps > 0 {
            remarks.push(format!("{} gaps without data are bridged", recording.gaps));
        }
        let end = self.start_s + self.speed * trial_s;
        if end > duration_s && self.start_s < duration_s {
            remarks.push(format!(
                "it is {duration_s:.0} s long and a trial may take until {end:.0} s of it: it starts over, its end \
                 blended into its beginning"
            ));
        }
        Ok(Some(RecordingFacts {
            duration_s,
            heave: recording.has[HEAVE],
            remarks,
        }))
    }
}

#[derive(Clone)]
pub enum DeckCarrier {
    Simulated(Box<Vessel>),
    Responding(Box<ResponseVessel>),
    Recorded(Box<RecordedMotion>),
}

impl DeckCarrier {
    pub fn new(
        vessel: &VesselConfig,
        motion: Option<&DeckMotionConfig>,
        deck: &DeckGeometry,
        sea: &Sea,
        streams: &Streams,
    ) -> Result<Self, DeckMotionError> {
        match motion {
            None => Ok(DeckCarrier::Simulated(Box::new(Vessel::new(
                vessel, sea, streams,
            )))),
            Some(motion) => match &motion.rocking {
                Some(rocking) => Ok(RecordedMotion::rocking(motion, rocking, deck, sea, streams)),
                None => {
                    let recording = Recording::load(&motion.file)?;
                    RecordedMotion::new(motion, recording, deck, sea, streams)
                }
            }
            .map(|m| DeckCarrier::Recorded(Box::new(m))),
        }
    }
    pub fn step(&mut self, t: WorldTime, dt_s: f64, sea: &Sea) {
        match self {
            DeckCarrier::Simulated(vessel) => vessel.step(t, dt_s, sea),
            DeckCarrier::Responding(vessel) => vessel.step(t, dt_s),
            DeckCarrier::Recorded(motion) => motion.step(t, dt_s, sea),
        }
    }
    /// Starts the turn or speed change of the vessel's course, if it has one, a random time after `t`.
    pub fn ask_change(&mut self, t: WorldTime) {
        match self {
            DeckCarrier::Simulated(vessel) => vessel.ask_change(t),
            DeckCarrier::Responding(vessel) => vessel.ask_change(t),
            DeckCarrier::Recorded(_) => {}
        }
    }
    /// Applies a load from now on: surge, sway, heave, roll, pitch, yaw in body axes, N and Nm. Has no effect
    /// on a vessel with a response table or a recording.
    pub fn push(&mut self, by_n_nm: [f64; 6]) {
        match self {
            DeckCarrier::Simulated(vessel) => vessel.push(by_n_nm),
            DeckCarrier::Responding(_) | DeckCarrier::Recorded(_) => {}
        }
    }
    /// Height of the water's surface above the simulated sea's, m.
    pub fn water_lift(&self) -> f64 {
        match self {
            DeckCarrier::Simulated(_) | DeckCarrier::Responding(_) => 0.0,
            DeckCarrier::Recorded(motion) => motion.water_lift,
        }
    }
    /// State of the vessel's reference point.
    pub fn state(&self) -> RigidState<VesselBody> {
        match self {
            DeckCarrier::Simulated(vessel) => vessel.state(),
            DeckCarrier::Responding(vessel) => vessel.state(),
            DeckCarrier::Recorded(motion) => motion.state(),
        }
    }
}

#[derive(Clone)]
struct Rounds {
    splines: Splines<CHANNELS>,
    /// Duration of one loop, and of the blend at its start, s of the recording.
    period: f64,
    blend: f64,
    /// Change of heading, surge and sway per loop.
    per_round: [f64; CHANNELS],
}

impl Rounds {
    /// All channels at `at` (s, not negative), with derivatives per second of the recording.
    fn channels(&self, at: f64) -> [Jet; CHANNELS] {
        let round = (at / self.period).floor();
        let phase = at - round * self.period;
        let now = self.splines.at(phase);
        let blend = smooth_step(phase, self.blend);
        // During the blend: the end of the previous loop.
        let before = (round > 0.0 && phase < self.blend).then(|| self.splines.at(self.period + phase));
        core::array::from_fn(|c| {
            let here = now[c].shifted(round * self.per_round[c]);
            match &before {
                Some(b) => Jet::blend(b[c].shifted((round - 1.0) * self.per_round[c]), here, blend),
                None => here,
            }
        })
    }
}

#[derive(Clone)]
enum Source {
    Recording(Rounds),
    Rocking(Rocking),
}

#[derive(Clone)]
pub struct RecordedMotion {
    source: Source,
    speed: f64,
    start: f64,
    mean_heading: f64,
    heave_recorded: bool,
    water_follows: bool,
    water_lift: f64,
    /// Deck centre in the body frame, m.
    deck: Vector3<f64>,
    state: RigidState<VesselBody>,
}

impl RecordedMotion {
    /// Plays `recording` from time zero.
    pub fn new(
        config: &DeckMotionConfig,
        recording: Recording,
        deck: &DeckGeometry,
        sea: &Sea,
        streams: &Streams,
    ) -> Result<Self, DeckMotionError> {
        let whole = |message: String| DeckMotionError::Whole {
            origin: config.file.display().to_string(),
            message,
        };
        let Recording {
            t, mut y, has, mean, ..
        } = recording;
        let mean_heading = if has[HEADING] {
            mean[HEADING]
        } else {
            drawn_heading(streams)
        };
        let mut kept = [0.0; CHANNELS];
        kept[HEADING] = mean_heading;
        if config.keep_mean {
            kept[ROLL] = mean[ROLL];
            kept[PITCH] = mean[PITCH];
        }
        let mut steepest = 0.0_f64;
        for row in &mut y {
            for c in 0..CHANNELS {
                row[c] = kept[c] + config.scale * (row[c] - mean[c]);
            }
            steepest = steepest.max(row[ROLL].abs()).max(row[PITCH].abs());
        }
        if steepest > MAX_TILT {
            return Err(whole(format!(
                "scaled by {}, it tilts to {:.1} deg, allowed is 60; reduce the scale",
                config.scale,
                steepest.to_degrees()
            )));
        }
        let splines = Splines::through(t, y).ok_or_else(|| whole("its times do not ascend".into()))?;
        let duration = splines.range().1;
        if config.start_s >= duration {
            return Err(whole(format!(
                "the start at {} s is after its end ({duration:.1} s); start earlier",
                config.start_s
            )));
        }
        let blend = BLEND_S.min(0.25 * duration);
        let period = duration - blend;
        let head = splines.at(0.5 * blend);
        let tail = splines.at(period + 0.5 * blend);
        let mut per_round = [0.0; CHANNELS];
        for c in [HEADING, SURGE, SWAY] {
            per_round[c] = tail[c].y - head[c].y;
        }
        let rounds = Rounds {
            splines,
            period,
            blend,
            per_round,
        };
        Ok(RecordedMotion {
            source: Source::Recording(rounds),
            speed: config.speed,
            start: config.start_s,
            mean_heading,
            heave_recorded: has[HEAVE],
            water_follows: config.water_follows && has[HEAVE],
            water_lift: 0.0,
            deck: deck.centre(),
            state: RigidState::default(),
        }
        .begun(sea))
    }

    /// Rocks as configured by `rocking`, heaves with the sea, and has a heading drawn per seed.
    pub fn rocking(
        config: &DeckMotionConfig,
        rocking: &RockingConfig,
        deck: &DeckGeometry,
        sea: &Sea,
        streams: &Streams,
    ) -> Self {
        let mean_heading = drawn_heading(streams);
        RecordedMotion {
            source: Source::Rocking(Rocking::new(rocking, config.scale, mean_heading, streams)),
            speed: config.speed,
            start: config.start_s,
            mean_heading,
            heave_recorded: false,
            water_follows: false,
            water_lift: 0.0,
            deck: deck.centre(),
            state: RigidState::default(),
        }
        .begun(sea)
    }

    fn begun(mut self, sea: &Sea) -> Self {
        self.update(Time::EPOCH, sea);
        self
    }

    pub fn step(&mut self, t: WorldTime, dt_s: f64, sea: &Sea) {
        self.update(t + Span::from_secs(dt_s), sea);
    }
    fn update(&mut self, t: WorldTime, sea: &Sea) {
        self.state = self.state_at(t, sea);
        if self.water_follows {
            self.water_lift = self.channels(t.secs())[HEAVE].y;
        }
    }
    pub fn state(&self) -> RigidState<VesselBody> {
        self.state
    }

    /// All channels at world time `t` (s), with derivatives per second of world time.
    fn channels(&self, t: f64) -> [Jet; CHANNELS] {
        let at = (self.start + self.speed * t).max(0.0);
        match &self.source {
            Source::Recording(rounds) => rounds.channels(at),
            Source::Rocking(rocking) => rocking.channels(at),
        }
        .map(|j| Jet {
            y: j.y,
            d: j.d * self.speed,
            dd: j.dd * self.speed * self.speed,
        })
    }

    fn place(&self, j: &[Jet; CHANNELS]) -> Vector2<f64> {
        let (s, c) = self.mean_heading.sin_cos();
        let surge = j[SURGE].y;
        let sway = j[SWAY].y;
        Vector2::new(c * surge - s * sway, s * surge + c * sway)
    }

    pub fn state_at(&self, t: WorldTime, sea: &Sea) -> RigidState<VesselBody> {
        let s = t.secs();
        let j = self.channels(s);
        let heave = if self.heave_recorded {
            j[HEAVE]
        } else {
            let up = |j: &[Jet; CHANNELS], dt: f64| {
                let deck = self.place(j);
                sea.elevation(t + Span::from_secs(dt), deck.x, deck.y)
            };
            let h = SEA_STEP_S;
            let a = up(&self.channels(s - h), -h);
            let b = up(&j, 0.0);
            let c = up(&self.channels(s + h), h);
            Jet {
                y: b,
                d: (c - a) / (2.0 * h),
                dd: (a - 2.0 * b + c) / (h * h),
            }
        };
        let place = self.place(&j);
        let (sin, cos) = self.mean_heading.sin_cos();
        let level = |surge: f64, sway: f64, up: f64| {
            Vector3::new(cos * surge - sin * sway, sin * surge + cos * sway, -up)
        };
        let (rates, angular_acceleration) = body_motion(&j[ROLL], &j[PITCH], &j[HEADING]);
        let deck = RigidState::<Deck> {
            position: Point::new(place.x, place.y, self.deck.z - heave.y),
            velocity: Vector::from(level(j[SURGE].d, j[SWAY].d, heave.d)),
            acceleration: Vector::from(level(j[SURGE].dd, j[SWAY].dd, heave.dd)),
            attitude: Rotation::from_euler(j[ROLL].y, j[PITCH].y, j[HEADING].y),
            rates: Vector::from(rates),
            angular_acceleration: Vector::from(angular_acceleration),
        };
        deck.at(-self.deck)
    }
}

/// Heading if none is recorded, rad.
fn drawn_heading(streams: &Streams) -> f64 {
    streams.stream("vessel/heading").random::<f64>() * TAU
}

#[cfg(test)]
mod tests;

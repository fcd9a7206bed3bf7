//! The vessel's process: admission of its sensors, the estimator, broadcast, time replies.

use alight_shared::msg::{
    AttitudeFix, GnssFix, Header, HeadingFix, ImuSample, MAX_SOURCES, MESSAGE_VERSION, Message, TimeReply,
    TimeRequest, VesselEstimate, VesselPrediction, WaveModel,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Stamped, Time, VesselClock};
use serde::{Deserialize, Serialize};

use crate::VesselNodeConfig;
use crate::apparent_slope::{self, ApparentSlope};
use crate::estimator::{Estimator, Gated};
use crate::rate_control::RateControl;

/// Most measurements of one sensor that one step takes; the rest is counted as refused.
const MAX_PER_STEP: usize = 100;
/// A measurement may lie this far in the future of `now` (rounding of stamps), s.
const FUTURE_S: f64 = 0.02;
/// Of several inertial (or attitude) sensors one is used until it has been silent for this long, s:
/// two at a time would be taken for one with the noise of a single sample.
const SOURCE_TIMEOUT_S: f64 = 0.5;
/// An attitude that is older is refused, s: it carries the filter, as an inertial sample does.
const MAX_ATTITUDE_AGE_S: f64 = 0.5;

/// What arrived since the last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VesselIn {
    /// Inertial samples.
    pub imu: Vec<ImuSample>,
    /// GNSS fixes.
    pub gnss: Vec<GnssFix>,
    /// Headings.
    pub heading: Vec<HeadingFix>,
    /// Attitudes.
    pub attitude: Vec<AttitudeFix>,
    /// Drones' questions for the time, stamped with their arrival.
    pub time_requests: Vec<Stamped<VesselClock, TimeRequest<DroneClock>>>,
}

/// What the vessel says.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VesselOut {
    /// State estimate, when due.
    pub estimate: Option<VesselEstimate<VesselClock>>,
    /// Wave model, when due.
    pub wave: Option<WaveModel<VesselClock>>,
    /// Prediction, when due.
    pub prediction: Option<VesselPrediction<VesselClock>>,
    /// Answers to the time requests of this step.
    pub time_replies: Vec<TimeReply<VesselClock, DroneClock>>,
}

/// Inputs refused since start, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    /// Not finite or beyond what physics allows, or of another version.
    pub absurd: u64,
    /// Stamped in the future.
    pub future: u64,
    /// Too old.
    pub stale: u64,
    /// Not newer than the last one of its kind: reordered or repeated.
    pub order: u64,
    /// More than a step takes.
    pub flood: u64,
    /// Time requests for another vessel.
    pub other_vessel: u64,
    /// Outputs that failed their own check and were withheld.
    pub withheld: u64,
}

/// Kinds of measurements, in the order of [`VesselIn`].
pub const KINDS: [&str; 4] = ["imu", "gnss", "heading", "attitude"];
const IMU: usize = 0;
const GNSS: usize = 1;
const HEADING: usize = 2;
const ATTITUDE: usize = 3;

/// What became of the measurements of one source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SourceCounts {
    /// Given to the filter.
    pub taken: u64,
    /// Of those, with a component that the filter's gate refused; of inertial samples in pairs.
    pub gated: u64,
    /// Not newer than the last one of the source.
    pub order: u64,
    /// Too old, from the future, or absurd.
    pub rejected: u64,
    /// Not needed: another source of the kind, or an inertial sensor, is in use.
    pub spare: u64,
}

/// A source, as the node knows it.
#[derive(Clone, Copy, Debug, Default)]
struct SourceState {
    newest: Option<Time<VesselClock>>,
    counts: SourceCounts,
}

/// The source in use of a kind that is used one at a time.
#[derive(Clone, Copy, Debug, Default)]
struct SelectedSource(Option<(u8, Time<VesselClock>)>);

impl SelectedSource {
    /// A sample of `source` at `at` is to be used.
    fn accepts(&mut self, source: u8, at: Time<VesselClock>) -> bool {
        let accepts = self
            .0
            .is_none_or(|(used, last)| used == source || at - last > Span::from_secs(SOURCE_TIMEOUT_S));
        if accepts {
            self.0 = Some((source, at));
        }
        accepts
    }
}

/// When something periodic is due, without drift.
#[derive(Clone, Debug)]
struct Pace {
    hz: f64,
    next: Option<Time<VesselClock>>,
}
impl Pace {
    fn new(hz: f64) -> Self {
        Pace { hz, next: None }
    }
    /// Whether it is due, at this share of its full rate.
    fn due(&mut self, now: Time<VesselClock>, rate_fraction: f64) -> bool {
        let period = Span::from_secs(1.0 / (self.hz * rate_fraction));
        match self.next {
            Some(t) if now < t => false,
            Some(t) if now - t < period => {
                self.next = Some(t + period);
                true
            }
            // The first time, or long overdue.
            Some(_) | None => {
                self.next = Some(now + period);
                true
            }
        }
    }
}

/// The vessel's node.
#[derive(Clone, Debug)]
pub struct VesselNode {
    config: VesselNodeConfig,
    vessel: u32,
    boot: u32,
    estimator: Estimator,
    rejected: Rejections,
    sources: [[SourceState; MAX_SOURCES]; KINDS.len()],
    in_use: [SelectedSource; 2],
    estimate: (Pace, u32),
    wave: (Pace, u32),
    prediction: (Pace, u32),
    replies: u32,
    apparent_slope: (Pace, ApparentSlope),
    rate_control: RateControl,
}

impl VesselNode {
    /// A node that has heard nothing. `boot` is drawn anew at each start.
    pub fn new(config: &VesselNodeConfig, vessel_id: u32, boot: u32) -> Self {
        let b = &config.broadcast;
        VesselNode {
            config: config.clone(),
            vessel: vessel_id,
            boot,
            estimator: Estimator::new(config),
            rejected: Rejections::default(),
            sources: Default::default(),
            in_use: Default::default(),
            estimate: (Pace::new(b.estimate_hz), 0),
            wave: (Pace::new(b.wave_hz), 0),
            prediction: (Pace::new(b.prediction_hz), 0),
            replies: 0,
            apparent_slope: (Pace::new(apparent_slope::RATE_HZ), ApparentSlope::default()),
            rate_control: RateControl::new(&b.rate_control),
        }
    }
    /// A node that is told the waves' angular frequencies (rad/s) and directions (rad), for studies.
    pub fn with_known_waves(
        config: &VesselNodeConfig,
        vessel_id: u32,
        boot: u32,
        components: &[(f64, f64)],
    ) -> Self {
        VesselNode {
            estimator: Estimator::with_known_waves(config, components),
            ..Self::new(config, vessel_id, boot)
        }
    }
    /// Inputs refused at the door.
    pub fn rejected(&self) -> Rejections {
        self.rejected
    }
    /// Measurements refused by the filter's gates.
    pub fn gated(&self) -> Gated {
        self.estimator.gated()
    }
    /// What became of the measurements of source `source` of kind `kind` of [`KINDS`].
    pub fn source(&self, kind: usize, source: usize) -> SourceCounts {
        let source = self.sources.get(kind).and_then(|k| k.get(source));
        source.map(|k| k.counts).unwrap_or_default()
    }
    /// The share of its full rates that it uses.
    pub fn rate_fraction(&self) -> f64 {
        self.rate_control.rate_fraction()
    }
    /// The estimator, for display and tests.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    fn admit<M: Message<Clock = VesselClock>>(
        rejected: &mut Rejections,
        source: &mut SourceState,
        now: Time<VesselClock>,
        max_age_s: f64,
        m: &M,
    ) -> bool {
        let at = m.header().at;
        let reason = if m.header().version != MESSAGE_VERSION || m.check().is_err() {
            &mut rejected.absurd
        } else if at > now + Span::from_secs(FUTURE_S) {
            &mut rejected.future
        } else if now - at > Span::from_secs(max_age_s) {
            &mut rejected.stale
        } else if source.newest.is_some_and(|n| at <= n) {
            rejected.order += 1;
            source.counts.order += 1;
            return false;
        } else {
            source.newest = Some(at);
            return true;
        };
        *reason += 1;
        source.counts.rejected += 1;
        false
    }

    fn take_measurements(&mut self, now: Time<VesselClock>, input: &VesselIn) {
        let (rejected, config, estimator) = (&mut self.rejected, &self.config, &mut self.estimator);
        // A source beyond the last is absurd, and counted with the last.
        let place = |source: u8| usize::from(source).min(MAX_SOURCES - 1);
        let [imu_in_use, attitude_in_use] = &mut self.in_use;
        // Oldest first within a step: inertial samples bring the state to the others' time.
        for m in input.imu.iter().take(MAX_PER_STEP) {
            let source = &mut self.sources[IMU][place(m.source)];
            if Self::admit(rejected, source, now, 0.5, m) {
                if imu_in_use.accepts(m.source, m.header.at) {
                    let gated = estimator.gated().imu;
                    estimator.imu(m);
                    source.counts.taken += 1;
                    source.counts.gated += u64::from(estimator.gated().imu > gated);
                } else {
                    source.counts.spare += 1;
                }
            }
        }
        for m in input.attitude.iter().take(MAX_PER_STEP) {
            let source = &mut self.sources[ATTITUDE][place(m.source)];
            if Self::admit(rejected, source, now, MAX_ATTITUDE_AGE_S, m) {
                let used = attitude_in_use.accepts(m.source, m.header.at);
                let (used, gated) = if used { estimator.attitude(m) } else { (false, 0) };
                source.counts.taken += u64::from(used);
                source.counts.spare += u64::from(!used);
                source.counts.gated += u64::from(gated > 0);
            }
        }
        for m in input.gnss.iter().take(MAX_PER_STEP) {
            let source = &mut self.sources[GNSS][place(m.source)];
            if Self::admit(rejected, source, now, config.gnss.max_age_s, m) {
                source.counts.taken += 1;
                source.counts.gated += u64::from(estimator.gnss(m) > 0);
            }
        }
        for m in input.heading.iter().take(MAX_PER_STEP) {
            let source = &mut self.sources[HEADING][place(m.source)];
            if Self::admit(rejected, source, now, config.heading.max_age_s, m) {
                source.counts.taken += 1;
                source.counts.gated += u64::from(!estimator.heading(m));
            }
        }
        for n in [
            input.imu.len(),
            input.gnss.len(),
            input.heading.len(),
            input.attitude.len(),
            input.time_requests.len(),
        ] {
            rejected.flood += n.saturating_sub(MAX_PER_STEP) as u64;
        }
    }

    fn reply(&mut self, now: Time<VesselClock>, input: &VesselIn) -> Vec<TimeReply<VesselClock, DroneClock>> {
        let mut replies = Vec::new();
        for request in input.time_requests.iter().take(MAX_PER_STEP) {
            let asked = &request.value.header;
            if asked.version != MESSAGE_VERSION || request.at > now {
                self.rejected.absurd += 1;
            } else if asked.vessel != self.vessel {
                self.rejected.other_vessel += 1;
            } else {
                let period_s = 1.0 / (self.config.broadcast.estimate_hz * self.rate_control.rate_fraction());
                if asked_boot(&request.value) == Some(self.boot) {
                    let newest = request.value.newest_at;
                    self.rate_control
                        .observe(request.at, asked.drone, newest, period_s);
                }
                replies.push(TimeReply {
                    header: Header::new(self.vessel, asked.drone, self.boot, self.replies, now),
                    requested_at: asked.at,
                    received_at: request.at,
                });
                self.replies = self.replies.wrapping_add(1);
            }
        }
        replies
    }
}

/// The boot of the vessel whose estimate the drone heard last, if it heard any.
fn asked_boot(request: &TimeRequest<DroneClock>) -> Option<u32> {
    (request.newest_boot != 0).then_some(request.newest_boot)
}

/// Gives a message its sequence number and lets it out only when it passes its own check.
fn checked<M: Message<Clock = VesselClock>>(
    message: M,
    sequence: &mut u32,
    rejected: &mut Rejections,
) -> Option<M> {
    if message.check().is_err() {
        rejected.withheld += 1;
        return None;
    }
    *sequence = sequence.wrapping_add(1);
    Some(message)
}

impl Node for VesselNode {
    type Clock = VesselClock;
    type In = VesselIn;
    type Out = VesselOut;

    fn step(&mut self, now: Time<VesselClock>, input: &VesselIn) -> VesselOut {
        self.take_measurements(now, input);
        self.estimator.tick(now);
        let mut out = VesselOut {
            time_replies: self.reply(now, input),
            ..VesselOut::default()
        };
        let Some(filter) = self
            .estimator
            .filter()
            .filter(|f| f.can_publish(&self.config, now))
        else {
            return out;
        };
        let header = |sequence| Header::new(self.vessel, 0, self.boot, sequence, now);
        if self.estimate.0.due(now, self.rate_control.rate_fraction()) {
            let m = filter.estimate(&self.config, header(self.estimate.1));
            out.estimate = checked(m, &mut self.estimate.1, &mut self.rejected);
        }
        if self.apparent_slope.0.due(now, 1.0) {
            self.apparent_slope
                .1
                .update(&filter.estimate(&self.config, header(0)));
        }
        if self.wave.0.due(now, self.rate_control.model_fraction()) {
            let m = filter.wave_model(header(self.wave.1), self.apparent_slope.1.slopes(now));
            out.wave = checked(m, &mut self.wave.1, &mut self.rejected);
        }
        if self.prediction.0.due(now, self.rate_control.model_fraction()) {
            let m = filter.prediction(&self.config, header(self.prediction.1));
            out.prediction = checked(m, &mut self.prediction.1, &mut self.rejected);
        }
        out
    }
}

#[cfg(test)]
mod tests;

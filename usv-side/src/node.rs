//! The vessel's node: admission of measurements, estimator, broadcast, time replies.

use alight_shared::{
    admission::{Arrival, Periodic, RejectionReason, Rejections, Rule, Sender},
    apparent_slope::{self, ApparentSlope},
    msg::{
        CourseAdvice, DeckDimensions, EstimateUpdate, Header, MAX_SOURCES, Message, TimeReply, TimeRequest,
        VesselEstimate, VesselPrediction, VesselSurroundings, WaveModel, WaveSender, WaveUpdate,
        message_version,
    },
    node::Node,
    surroundings::Surroundings,
    time::{DroneClock, Span, VesselClock, VesselTime},
};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::{
    VesselNodeConfig,
    advice::{Advice, Advisor},
    estimator::{Estimator, OutlierCounts},
    rate_control::RateControl,
    sensors::{Measurement, Readings, RepeatedSamples},
};

/// Maximum number of inputs of one kind per step; further ones are rejected.
const MAX_PER_STEP: usize = 100;
/// Maximum time by which a measurement may lie ahead of `now` (rounding of stamps), s.
const FUTURE_S: f64 = 0.02;
/// Silence after which the next inertial (or attitude) sensor is used, s; an earlier change would mix their samples.
const SOURCE_TIMEOUT_S: f64 = 0.5;
/// Maximum age of an attitude, s; it drives the filter like an inertial sample.
const MAX_ATTITUDE_AGE_S: f64 = 0.5;
const MAX_IMU_AGE_S: f64 = 0.5;

/// Interval between messages about the deck's surroundings.
const SURROUNDINGS_PERIOD: Span = Span::from_millis(1000);

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VesselIn {
    pub readings: Readings,
    pub time_requests: Vec<Arrival<VesselClock, TimeRequest<DroneClock>>>,
}

impl From<Readings> for VesselIn {
    fn from(readings: Readings) -> VesselIn {
        VesselIn {
            readings,
            ..VesselIn::default()
        }
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VesselOut {
    pub estimate: Option<VesselEstimate<VesselClock>>,
    pub estimate_update: Option<EstimateUpdate<VesselClock>>,
    pub wave: Option<WaveModel<VesselClock>>,
    pub wave_update: Option<WaveUpdate<VesselClock>>,
    pub prediction: Option<VesselPrediction<VesselClock>>,
    /// Obstacles around the deck, when due; None without obstacles.
    pub surroundings: Option<VesselSurroundings<VesselClock>>,
    pub time_replies: Vec<TimeReply<VesselClock, DroneClock>>,
}

/// Kinds of measurements, in the order of [`Readings`].
pub const KINDS: [&str; 4] = ["imu", "gnss", "heading", "attitude"];
pub(crate) const IMU: usize = 0;
const GNSS: usize = 1;
const HEADING: usize = 2;
const ATTITUDE: usize = 3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SourceCounts {
    /// Measurements passed to the filter.
    pub taken: u64,
    /// Passed measurements with a component that the filter's gate rejected; inertial samples are counted by filter step.
    pub outliers: u64,
    /// Measurements not newer than the previous one of their source: out of order or repeated.
    pub out_of_order: u64,
    /// Measurements that are too old, from the future, or out of range.
    pub rejected: u64,
    /// Measurements rejected because the sensor repeats one sample.
    pub stuck: u64,
    /// The sensor repeats one sample now.
    pub is_stuck: bool,
    /// Measurements not used because of another source of their kind, or of an inertial sensor.
    pub spare: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct SourceState {
    newest: Option<Header<VesselClock>>,
    counts: SourceCounts,
    repetition: RepeatedSamples,
}

impl SourceState {
    /// Rejects the samples of a stuck inertial sensor, so that another one replaces it like a silent sensor.
    fn check_repetition(&mut self, m: &Measurement) -> Result<(), RejectionReason> {
        let Some(sample) = m.imu() else { return Ok(()) };
        self.counts.is_stuck = self.repetition.is_stuck(sample);
        self.counts.stuck += u64::from(self.counts.is_stuck);
        if self.counts.is_stuck {
            Err(RejectionReason::Stuck)
        } else {
            Ok(())
        }
    }
}

/// Source in use, for a kind of measurement of which only one source is used at a time.
#[derive(Clone, Copy, Debug, Default)]
struct SelectedSource(Option<(u8, VesselTime)>);

impl SelectedSource {
    fn accepts(&mut self, source: u8, at: VesselTime) -> bool {
        let accepts = self
            .0
            .is_none_or(|(used, last)| used == source || at - last > Span::from_secs(SOURCE_TIMEOUT_S));
        if accepts {
            self.0 = Some((source, at));
        }
        accepts
    }
}

#[derive(Clone, Debug)]
pub struct VesselNode {
    config: VesselNodeConfig,
    vessel: u32,
    boot: u32,
    estimator: Estimator,
    rejected: Rejections,
    sources: [[SourceState; MAX_SOURCES]; KINDS.len()],
    in_use: [SelectedSource; 2],
    estimate: (Periodic<VesselClock>, u32),
    wave: (Periodic<VesselClock>, u32),
    wave_sender: WaveSender<VesselClock>,
    prediction: (Periodic<VesselClock>, u32),
    around: (Surroundings, Periodic<VesselClock>, u32),
    replies: u32,
    apparent_slope: (Periodic<VesselClock>, ApparentSlope<VesselClock>),
    rate_control: RateControl,
    advisor: Advisor,
    /// True wind reported by a drone, towards NED, m/s.
    wind: Option<Vector2<f64>>,
}

impl VesselNode {
    pub fn new(config: &VesselNodeConfig, vessel_id: u32, boot: u32) -> Self {
        VesselNode {
            config: config.clone(),
            vessel: vessel_id,
            boot,
            estimator: Estimator::new(config),
            rejected: Rejections::default(),
            sources: Default::default(),
            in_use: Default::default(),
            estimate: Default::default(),
            wave: Default::default(),
            wave_sender: WaveSender::default(),
            prediction: Default::default(),
            around: (config.surroundings.around(&config.deck), Periodic::default(), 0),
            replies: 0,
            apparent_slope: Default::default(),
            rate_control: RateControl::new(&config.broadcast.rate_control),
            advisor: Advisor::new(&config.model, &config.deck, &config.advice),
            wind: None,
        }
    }
    pub fn dimensions(&self) -> DeckDimensions {
        self.config.deck.dimensions()
    }
    pub fn rejected(&self) -> Rejections {
        self.rejected
    }
    pub fn outliers(&self) -> OutlierCounts {
        self.estimator.outliers()
    }
    /// Statistics of source number `source` of a kind in [`KINDS`].
    pub fn source(&self, kind: usize, source: usize) -> SourceCounts {
        let source = self.sources.get(kind).and_then(|k| k.get(source));
        source.map(|k| k.counts).unwrap_or_default()
    }
    /// Fraction of the full rates in use.
    pub fn rate_fraction(&self) -> f64 {
        self.rate_control.rate_fraction()
    }
    /// Adapts the rates to the link of this drone alone, which is descending.
    pub fn prioritise(&mut self, landing: Option<u32>) {
        self.rate_control.landing = landing;
    }
    /// Sets the true wind reported by a drone, towards NED, m/s.
    pub fn blow(&mut self, wind: Option<Vector2<f64>>) {
        self.wind = wind;
    }
    pub fn advisor(&self) -> &Advisor {
        &self.advisor
    }
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// Admits measurements of one kind, counts them by source, and passes them to `fuse`, which returns
    /// whether the gate rejected a component, or None if it does not need the measurement.
    fn take<M: Message<Clock = VesselClock> + Copy + Into<Measurement>>(
        &mut self,
        now: VesselTime,
        (kind, max_age_s): (usize, f64),
        measurements: &[M],
        fuse: impl Fn(&mut Self, &M) -> Option<bool>,
    ) {
        let rule = Rule {
            lead: Span::from_secs(FUTURE_S),
            max_age: Span::from_secs(max_age_s),
        };
        for m in measurements.iter().take(MAX_PER_STEP) {
            // A measurement with an invalid source number is counted for the last source.
            let source = usize::from((*m).into().source()).min(MAX_SOURCES - 1);
            let state = &mut self.sources[kind][source];
            let admitted = rule.admit(now, m, state.newest.as_ref());
            if admitted.is_ok() {
                state.newest = Some(*m.header());
            }
            match admitted.and_then(|()| state.check_repetition(&(*m).into())) {
                Ok(()) => {
                    let fused = fuse(self, m);
                    let counts = &mut self.sources[kind][source].counts;
                    counts.taken += u64::from(fused.is_some());
                    counts.spare += u64::from(fused.is_none());
                    counts.outliers += u64::from(fused == Some(true));
                }
                Err(reason) => {
                    let out_of_order = reason == RejectionReason::OutOfOrder;
                    state.counts.out_of_order += u64::from(out_of_order);
                    state.counts.rejected += u64::from(!out_of_order);
                    self.rejected.count(reason);
                }
            }
        }
        self.count_flood(measurements.len());
    }

    fn count_flood(&mut self, inputs: usize) {
        self.rejected
            .count_many(RejectionReason::Flood, inputs.saturating_sub(MAX_PER_STEP));
    }

    fn take_measurements(&mut self, now: VesselTime, readings: &Readings) {
        let ages = (self.config.gnss.max_age_s, self.config.heading.max_age_s);
        // Inertial samples come first, because they propagate the state to the time of the others.
        self.take(now, (IMU, MAX_IMU_AGE_S), &readings.imu, |node, m| {
            let outliers = node.estimator.outliers().imu;
            let used = node.in_use[0].accepts(m.source, m.header.at);
            if used {
                node.estimator.imu(m);
            }
            used.then_some(node.estimator.outliers().imu > outliers)
        });
        self.take(
            now,
            (ATTITUDE, MAX_ATTITUDE_AGE_S),
            &readings.attitude,
            |node, m| {
                let accepted = node.in_use[1].accepts(m.source, m.header.at);
                let (used, outliers) = accepted.then(|| node.estimator.attitude(m))?;
                used.then_some(outliers > 0)
            },
        );
        self.take(now, (GNSS, ages.0), &readings.gnss, |node, m| {
            Some(node.estimator.gnss(m) > 0)
        });
        self.take(now, (HEADING, ages.1), &readings.heading, |node, m| {
            Some(!node.estimator.heading(m))
        });
    }

    fn surroundings(&mut self, now: VesselTime) -> Option<VesselSurroundings<VesselClock>> {
        let (surroundings, periodic, sequence) = &mut self.around;
        if surroundings.is_empty() || !periodic.is_due(now, SURROUNDINGS_PERIOD) {
            return None;
        }
        let message = VesselSurroundings {
            header: Header::new(self.vessel, 0, self.boot, *sequence, now),
            surroundings: *surroundings,
        };
        checked(message, sequence, &mut self.rejected)
    }

    fn reply(&mut self, now: VesselTime, input: &VesselIn) -> Vec<TimeReply<VesselClock, DroneClock>> {
        let mut replies = Vec::new();
        for request in input.time_requests.iter().take(MAX_PER_STEP) {
            let asked = &request.message.header;
            if request.sender != Sender::Drone(asked.drone) {
                self.rejected.count(RejectionReason::Sender);
            } else if asked.version != message_version() || request.at > now {
                self.rejected.count(RejectionReason::Version);
            } else if asked.vessel != self.vessel {
                self.rejected.count(RejectionReason::Vessel);
            } else {
                let period_s = 1.0 / (self.config.broadcast.estimate_hz * self.rate_control.rate_fraction());
                // Boot 0: the drone has received no estimate yet.
                if request.message.newest_boot != 0 && request.message.newest_boot == self.boot {
                    let newest = request.message.newest_at;
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

/// Increments the sequence number of a message; None if it fails its own check.
fn checked<M: Message<Clock = VesselClock>>(
    message: M,
    sequence: &mut u32,
    rejected: &mut Rejections,
) -> Option<M> {
    if message.check().is_err() {
        rejected.count(RejectionReason::Withheld);
        return None;
    }
    *sequence = sequence.wrapping_add(1);
    Some(message)
}

impl Node for VesselNode {
    type Clock = VesselClock;
    type In = VesselIn;
    type Out = VesselOut;

    fn step(&mut self, now: VesselTime, input: &VesselIn) -> VesselOut {
        self.take_measurements(now, &input.readings);
        self.count_flood(input.time_requests.len());
        self.estimator.tick(now);
        let mut out = VesselOut {
            time_replies: self.reply(now, input),
            surroundings: self.surroundings(now),
            ..VesselOut::default()
        };
        let Some(filter) = self
            .estimator
            .filter()
            .filter(|f| f.can_publish(&self.config, now))
        else {
            return out;
        };
        let slopes = self.apparent_slope.1.slopes(now);
        self.advisor.step(now, &filter.underway(self.wind, slopes));
        let header = |sequence| Header::new(self.vessel, 0, self.boot, sequence, now);
        let broadcast = &self.config.broadcast;
        let period = |hz: f64, fraction: f64| Span::from_secs(1.0 / (hz * fraction));
        let estimates = self.rate_control.rate_fraction();
        let models = self.rate_control.model_fraction();
        if self
            .estimate
            .0
            .is_due(now, period(broadcast.estimate_hz, estimates))
        {
            let m = filter.estimate(&self.config, header(self.estimate.1));
            out.estimate = checked(m, &mut self.estimate.1, &mut self.rejected);
            out.estimate_update = out.estimate.as_ref().map(EstimateUpdate::of);
        }
        if self
            .apparent_slope
            .0
            .is_due(now, period(apparent_slope::RATE_HZ, 1.0))
        {
            self.apparent_slope
                .1
                .update(&filter.estimate(&self.config, header(0)));
        }
        if self.wave.0.is_due(now, period(broadcast.wave_hz, models)) {
            let m = filter.wave_model(header(self.wave.1), self.apparent_slope.1.slopes(now));
            let advice = self.advisor.advice().filter(Advice::is_change);
            let advice = advice.as_ref().map(CourseAdvice::from);
            let m = m.map(|m| WaveModel { advice, ..m });
            out.wave = m.and_then(|m| checked(m, &mut self.wave.1, &mut self.rejected));
            out.wave_update = out.wave.as_ref().map(|m| self.wave_sender.update(m));
        }
        if self
            .prediction
            .0
            .is_due(now, period(broadcast.prediction_hz, models))
        {
            let m = filter.prediction(&self.config, header(self.prediction.1));
            out.prediction = m.and_then(|m| checked(m, &mut self.prediction.1, &mut self.rejected));
        }
        out
    }
}

#[cfg(test)]
mod tests;

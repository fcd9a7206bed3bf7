//! Offline evaluation of a recording with the vessel's node.
//!
//! Without a known truth, it uses the filter's innovations, and compares predictions with later estimates.

mod predictions;
pub mod ridge;

use alight_shared::{
    estimation::median,
    msg::{Decoded, GnssFix, HeadingFix, MAX_SOURCES, NOT_MEASURED_SD, WaveMode},
    node::Node,
    time::{Span, VesselTime},
    vessel_model::{HEAVE, PITCH, ROLL},
};
use serde::Serialize;

use crate::{
    VesselNodeConfig,
    advice::CourseOutlook,
    estimator::{Consistency, InnovationChannel, InnovationStatistics},
    log::SensorRecording,
    node::{KINDS, SourceCounts, VesselNode},
    sensors::{Measurement, Readings},
};
pub use predictions::{HORIZONS_S, PredictionReview, Predictions};

/// Step of the node, as in the vessel's process.
const TICK: Span = Span::from_millis(10);
/// Silence of all sources that is skipped, s.
const JUMP_S: f64 = 5.0;
/// Number of measurements after a jump ahead in time; if one of them returns to the former time, the jump is an outlier.
const LOOK_AHEAD: usize = 20;
/// Start of the evaluation, s, when the sea has been identified; in a shorter recording, a third of its length.
const WARM_UP_S: f64 = 60.0;
/// Minimum length of a gap in median steps, and in s.
const GAP_STEPS: f64 = 5.0;
const GAP_S: f64 = 0.3;
/// Standard deviations of assumed position and velocity without a receiver, m, m/s: a boat on station.
const STANDING_SD: [f64; 2] = [5.0, 1.0];
/// Standard deviation of an assumed heading without a sensor, rad.
const UNKNOWN_HEADING_SD: f64 = 0.2;

#[derive(Clone, Debug, Serialize)]
pub struct SourceReview {
    /// Kind of measurement from [`KINDS`].
    pub kind: &'static str,
    pub source: usize,
    pub samples: u64,
    /// Rate by the median step, Hz.
    pub rate_hz: f64,
    /// Number of silences longer than five median steps and 0.3 s.
    pub gaps: u64,
    pub longest_gap_s: f64,
    #[serde(flatten)]
    pub counts: SourceCounts,
}

#[derive(Clone, Debug, Serialize)]
pub struct SeaReview {
    /// Median significant height (4 standard deviations of heave), m; None if heave is not observable.
    pub significant_height_m: Option<f64>,
    /// Median period of the strongest mode, s.
    pub peak_period_s: Option<f64>,
    /// Fraction of the time with an identified sea, 0 to 1.
    pub identified_fraction: f64,
    /// Mean confidence with an identified sea, 0 to 1.
    pub confidence: f64,
    pub modes: Vec<ModeReview>,
}

#[derive(Clone, Debug, Serialize)]
pub struct ModeReview {
    /// Period of encounter, s.
    pub period_s: f64,
    pub damping_ratio: f64,
    /// Amplitude of heave, m; None if heave is not observable.
    pub heave_m: Option<f64>,
    pub tilt_deg: f64,
}

#[derive(Clone, Debug, Serialize)]
pub struct FitReview {
    pub channel: InnovationChannel,
    pub fused: u64,
    pub rejected: u64,
    /// Mean normalised innovation squared; 1 for a consistent filter.
    pub nis_mean: f64,
    /// Fraction within the 95 % bound.
    pub inside_95: f64,
}

#[derive(Clone, Debug, Serialize)]
pub struct Review {
    pub format: &'static str,
    /// Duration from the first to the last measurement, s.
    pub duration_s: f64,
    /// Start of the evaluation after the first measurement, s.
    pub evaluated_from_s: f64,
    pub decoded: Decoded,
    /// Measurements dated far ahead of the following ones.
    pub outliers_in_time: u64,
    pub sources: Vec<SourceReview>,
    pub restarts: u64,
    pub estimates: u64,
    /// Standard deviation of heave (m), roll and pitch (deg) of the estimates.
    pub motion_sd: [Option<f64>; 3],
    pub sea: SeaReview,
    /// Courses at the end, last one first, with their probabilities; empty if wave directions are unknown.
    pub courses: Vec<CourseOutlook>,
    pub innovations: Vec<FitReview>,
    pub predictions: Vec<PredictionReview>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

pub fn review(config: &VesselNodeConfig, recorded: &SensorRecording) -> Review {
    let all = without_outliers(&recorded.measurements);
    let first = all.first().map(|m| m.at()).unwrap_or_default();
    let last = all.iter().map(|m| m.at()).max().unwrap_or_default();
    let mut notes = recorded.notes.clone();
    let has = |is: fn(&Measurement) -> bool| all.iter().any(|m| is(m));
    let is_place = |m: &Measurement| matches!(m, Measurement::Gnss(g) if g.position_sd[0] < NOT_MEASURED_SD);
    let is_velocity =
        |m: &Measurement| matches!(m, Measurement::Gnss(g) if g.velocity_sd[0] < NOT_MEASURED_SD);
    let no_heading = !has(|m| matches!(m, Measurement::Heading(_)));
    let no_place = !has(is_place) && !has(is_velocity);
    if !has(is_place) && has(is_velocity) {
        notes.push(
            "no position recorded: an arbitrary start is assumed, and motion by the recorded velocity".into(),
        );
    }
    if no_place {
        notes.push("no position recorded: a boat on station is assumed, within 5 m".into());
    }
    if no_heading {
        notes.push("no heading recorded: a heading of north is assumed".into());
    }
    let mut node = VesselNode::new(config, 1, 1);
    let mut evaluation = Evaluation {
        from: first + Span::from_secs(WARM_UP_S.min((last - first).secs() / 3.0)),
        heave: heave_is_observable(&all),
        ..Evaluation::default()
    };
    let mut now = first;
    let mut substitute = Substitute {
        next: first,
        place: no_place,
        heading: no_heading,
    };
    let mut coming = all.iter().peekable();
    while let Some(next) = coming.peek() {
        if (next.at() - now).secs() > JUMP_S {
            now = next.at();
        }
        let mut readings = Readings::default();
        while let Some(m) = coming.next_if(|m| m.at() <= now) {
            readings.push(**m);
        }
        substitute.add(now, &mut readings);
        evaluation.step(&mut node, now, readings);
        now += TICK;
    }
    Review {
        format: recorded.format,
        duration_s: (last - first).secs(),
        evaluated_from_s: (evaluation.from - first).secs(),
        decoded: recorded.decoded,
        outliers_in_time: (recorded.measurements.len() - all.len()) as u64,
        sources: sources(&all, &node),
        restarts: node.outliers().restarts,
        estimates: evaluation.estimates,
        motion_sd: evaluation.motion_sd(),
        sea: evaluation.sea(),
        courses: node.advisor().outlooks().to_vec(),
        innovations: evaluation.innovations(&node.estimator().consistency()),
        predictions: evaluation.predictions.reviews(evaluation.heave),
        notes,
    }
}

/// Measurements without those dated far ahead of the following ones.
fn without_outliers(all: &[Measurement]) -> Vec<&Measurement> {
    let mut newest: Option<VesselTime> = None;
    let mut out = Vec::with_capacity(all.len());
    for (k, m) in all.iter().enumerate() {
        if newest.is_none_or(|n| (m.at() - n).secs() > JUMP_S) {
            let coming = all.get(k + 1..(k + 1 + LOOK_AHEAD).min(all.len()));
            let back = |later: &Measurement| {
                let known = newest.is_none_or(|n| (n - later.at()).secs() < JUMP_S);
                known && (m.at() - later.at()).secs() > JUMP_S
            };
            if coming.unwrap_or_default().iter().any(back) {
                continue;
            }
        }
        newest = Some(newest.map_or(m.at(), |n| n.max(m.at())));
        out.push(m);
    }
    out
}

/// Whether any measurement makes heave observable.
fn heave_is_observable(all: &[&Measurement]) -> bool {
    all.iter().any(|m| match m {
        Measurement::Imu(_) => true,
        Measurement::Gnss(g) => g.position_sd[2] < NOT_MEASURED_SD,
        Measurement::Attitude(a) => a.heave.is_some(),
        Measurement::Heading(_) => false,
    })
}

struct Substitute {
    next: VesselTime,
    place: bool,
    heading: bool,
}

impl Substitute {
    fn add(&mut self, now: VesselTime, readings: &mut Readings) {
        if now < self.next || !(self.place || self.heading) {
            return;
        }
        self.next = now + Span::from_secs(0.5);
        let header = alight_shared::msg::Header::new(1, 0, 1, 0, now);
        if self.place {
            let [place, velocity] = STANDING_SD;
            readings.gnss.push(GnssFix {
                header,
                position_sd: [place, place, NOT_MEASURED_SD],
                velocity_sd: [velocity, velocity, NOT_MEASURED_SD],
                lever_arm: Some([0.0; 3]),
                ..GnssFix::default()
            });
        }
        if self.heading {
            readings.heading.push(HeadingFix {
                header,
                heading: 0.0,
                heading_sd: UNKNOWN_HEADING_SD,
                ..HeadingFix::default()
            });
        }
    }
}

/// Period of a mode, s; infinite for a decaying mode.
fn period(m: &WaveMode) -> f64 {
    core::f64::consts::TAU / f64::from(m.pole[1].abs())
}
fn amplitude(m: &WaveMode, dof: usize) -> f64 {
    let [re, im] = m.shape.get(dof).copied().unwrap_or_default().map(f64::from);
    re.hypot(im)
}
fn tilt(m: &WaveMode) -> f64 {
    amplitude(m, ROLL).hypot(amplitude(m, PITCH))
}
fn strongest(modes: &[WaveMode], heave: bool) -> Option<&WaveMode> {
    let size = |m: &WaveMode| if heave { amplitude(m, HEAVE) } else { tilt(m) };
    let waves = modes.iter().filter(is_oscillation);
    waves.max_by(|a, b| size(a).total_cmp(&size(b)))
}

/// Whether a mode oscillates and decays; heel and trim do not.
fn is_oscillation(m: &&WaveMode) -> bool {
    m.pole.iter().all(|p| *p != 0.0)
}

/// Mean and variance of three quantities, by Welford (1962).
#[derive(Default)]
struct Spread {
    n: f64,
    mean: [f64; 3],
    sum: [f64; 3],
}

impl Spread {
    fn add(&mut self, v: [f64; 3]) {
        self.n += 1.0;
        for k in 0..3 {
            let off = v[k] - self.mean[k];
            self.mean[k] += off / self.n;
            self.sum[k] += off * (v[k] - self.mean[k]);
        }
    }
}

#[derive(Default)]
struct Evaluation {
    from: VesselTime,
    heave: bool,
    before: Option<Consistency>,
    estimates: u64,
    motion: Spread,
    predictions: Predictions,
    waves: u64,
    confidence: f64,
    heights: Vec<f64>,
    periods: Vec<f64>,
    modes: Vec<WaveMode>,
}

impl Evaluation {
    fn step(&mut self, node: &mut VesselNode, now: VesselTime, readings: Readings) {
        let out = node.step(now, &readings.into());
        let counted = now >= self.from;
        let level = node.estimator().level().unwrap_or_default();
        if counted && self.before.is_none() {
            self.before = Some(node.estimator().consistency());
        }
        if let Some(estimate) = &out.estimate {
            self.estimates += 1;
            let at = estimate.header.at;
            let eta = estimate.eta;
            let [roll, pitch, heave] = [ROLL, PITCH, HEAVE].map(|d| f64::from(estimate.eta_dot[d]));
            let motion = [eta[ROLL], eta[PITCH], eta[HEAVE] - level, roll, pitch, heave];
            self.predictions.publish(at, motion);
            self.predictions.compare(at, eta);
            if counted {
                let [_, _, heave, roll, pitch, _] = estimate.eta;
                self.motion.add([heave, roll, pitch]);
            }
        }
        if !counted {
            return;
        }
        if let Some(prediction) = &out.prediction {
            let predicted = |ahead_s| prediction.at(ahead_s);
            self.predictions.push(prediction.header.at, predicted, level);
        }
        if let Some(wave) = &out.wave {
            self.waves += 1;
            if !wave.modes.is_empty() {
                self.confidence += f64::from(wave.confidence);
                self.heights.push(f64::from(wave.significant_height_m));
                self.periods
                    .extend(strongest(&wave.modes, self.heave).map(period));
            }
            self.modes = wave.modes.iter().copied().collect();
        }
    }
    fn motion_sd(&self) -> [Option<f64>; 3] {
        let sd = |k: usize| (self.motion.n > 1.0).then(|| (self.motion.sum[k] / self.motion.n).sqrt());
        [
            sd(0).filter(|_| self.heave),
            sd(1).map(f64::to_degrees),
            sd(2).map(f64::to_degrees),
        ]
    }
    fn sea(&self) -> SeaReview {
        let identified = self.heights.len() as f64;
        let modes = self.modes.iter().filter(is_oscillation);
        SeaReview {
            significant_height_m: median(self.heights.iter().copied()).filter(|_| self.heave),
            peak_period_s: median(self.periods.iter().copied()),
            identified_fraction: identified / self.waves.max(1) as f64,
            confidence: self.confidence / identified.max(1.0),
            modes: modes
                .map(|m| ModeReview {
                    period_s: period(m),
                    damping_ratio: -f64::from(m.pole[0]) / f64::from(m.pole[0]).hypot(f64::from(m.pole[1])),
                    heave_m: self.heave.then(|| amplitude(m, HEAVE)),
                    tilt_deg: tilt(m).to_degrees(),
                })
                .collect(),
        }
    }
    fn innovations(&self, all: &Consistency) -> Vec<FitReview> {
        let before = self.before.unwrap_or_default();
        let rows = InnovationChannel::ALL.map(|channel| {
            let a = all.of(channel);
            let b = before.of(channel);
            let fit = InnovationStatistics {
                fused: a.fused - b.fused,
                sum: a.sum - b.sum,
                inside: a.inside - b.inside,
                rejected: a.rejected - b.rejected,
            };
            Some(FitReview {
                channel,
                fused: fit.fused,
                rejected: fit.rejected,
                nis_mean: fit.mean()?,
                inside_95: fit.fraction_inside()?,
            })
        });
        rows.into_iter().flatten().collect()
    }
}

/// Rates and gaps of every source, and the node's counts.
fn sources(all: &[&Measurement], node: &VesselNode) -> Vec<SourceReview> {
    let mut out = Vec::new();
    for (kind, name) in KINDS.iter().enumerate() {
        for source in 0..MAX_SOURCES {
            let own = all
                .iter()
                .filter(|m| m.kind() == kind && usize::from(m.source()) == source);
            let times: Vec<f64> = own.map(|m| m.at().secs()).collect();
            if times.is_empty() {
                continue;
            }
            let steps: Vec<f64> = times
                .windows(2)
                .filter_map(|w| w.first().zip(w.last()).map(|(a, b)| b - a))
                .filter(|d| *d > 0.0)
                .collect();
            let usual = median(steps.iter().copied()).unwrap_or_default();
            out.push(SourceReview {
                kind: name,
                source,
                samples: times.len() as u64,
                rate_hz: if usual > 0.0 { 1.0 / usual } else { 0.0 },
                gaps: steps
                    .iter()
                    .filter(|d| **d > (GAP_STEPS * usual).max(GAP_S))
                    .count() as u64,
                longest_gap_s: steps.iter().copied().fold(0.0, f64::max),
                counts: node.source(kind, source),
            });
        }
    }
    out
}

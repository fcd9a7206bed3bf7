//! The six filters over time: observations are fused at their own time, in any order of arrival.

use std::collections::VecDeque;

use alight_shared::{
    estimation::AidSource,
    msg::PredictorCheckpoint,
    time::{DroneClock, DroneTime, Span},
};
use nalgebra::{Rotation2, Vector2};

use super::{
    agreement,
    axis::{Axis, AxisNoise, HEAD, Innovation, MEAN, MeasurementRow, OscillatorStep, RATE, TURN, VISION},
    forecast::STEERAGE_MPS,
    measurement::innovations,
    observation::{DeckObservation, ObservationKind},
    shift,
    track::FrameJump,
    waves::{AXES, TILT, Waves},
};

/// Maximum number of observations stored for reordering.
const MAX_ENTRIES: usize = 96;
/// Maximum age of an observation relative to the newest one, s.
const MAX_LATE_S: f64 = 1.0;
/// Number of consecutive rejections after which vision or radio is accepted again.
const MAX_CONSECUTIVE_REJECTIONS: u32 = 12;
/// Maximum lateral acceleration in a turn, m/s²; exceeds that of any supported vessel.
const MAX_TURN_MPS2: f64 = 2.0;
/// Maximum speed, m/s; exceeds that of any supported vessel.
const MAX_SPEED_MPS: f64 = 10.0;
/// Maximum heading change in one valid step, rad.
const MAX_BEND_RAD: f64 = 1.0;

/// Degrees of freedom that are rejected as a group.
const GROUPS: [&[usize]; 3] = [&[0, 1, 2], &TILT, &[5]];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fused {
    All,
    /// Not fused, or only in part: number of rejected groups of degrees of freedom.
    Rejected(u32),
    /// The observation is older than the history.
    Late,
    /// An observation with this time and source has already been fused.
    Duplicate,
}

pub type FilterState = [Axis; AXES];

#[derive(Clone, Debug)]
struct Entry {
    at: DroneTime,
    observation: Option<DeckObservation>,
    after: Box<FilterState>,
}

#[derive(Clone, Debug)]
pub struct Filter {
    noise: [AxisNoise; AXES],
    gate: f64,
    /// Tilt error of the vessel that is common to all its estimates, rad.
    common_tilt: f64,
    entries: VecDeque<Entry>,
    spare: Vec<Box<FilterState>>,
    /// Indexed by [`ObservationKind`].
    sources: [AidSource<DroneClock>; ObservationKind::COUNT],
    radio_available: bool,
    /// Degrees of freedom that the camera or the rangefinder has measured at least once.
    observed: [bool; AXES],
    /// Whether the newest position in the drone's frame is a relative position from the moving base.
    by_relative: bool,
    /// Sum of the autopilot's estimate jumps that changed vision's slow error minus the radio's, north and east, m.
    taken: [f64; 2],
    started: DroneTime,
}

impl Filter {
    /// Initialises the filters from `first`. Degrees of freedom without a value start at zero.
    pub fn new(noise: [AxisNoise; AXES], gate: f64, waves: &Waves, first: &DeckObservation) -> Self {
        let common_tilt = noise[3].radio.0.max(noise[4].radio.0);
        let unknown = [100.0, 100.0, 100.0, 0.2, 0.2, 3.0];
        let rate_sd = [2.0, 2.0, 0.0, 0.0, 0.0, 0.2];
        let oscillators = waves.oscillators(first.at);
        let modes = waves.motion(first.at);
        let axes: FilterState = core::array::from_fn(|i| {
            let known = first.value[i].map(|(v, r)| (v - modes.value[i], r));
            let (level, var) = known.unwrap_or((0.0, f64::powi(unknown[i], 2)));
            let slow = noise[i].radio.0.powi(2).max(noise[i].vision.0.powi(2));
            let mut axis = Axis::new(&noise[i], &oscillators, i, level, 0.0, rate_sd[i]);
            let sea: f64 = oscillators.iter().map(|o| o.sd[i].powi(2)).sum();
            axis.p[MEAN][MEAN] = var + sea + slow;
            axis
        });
        let mut f = Filter {
            noise,
            gate,
            common_tilt,
            entries: VecDeque::with_capacity(MAX_ENTRIES + 1),
            spare: Vec::new(),
            sources: Default::default(),
            radio_available: true,
            observed: [false; AXES],
            by_relative: false,
            taken: [0.0; 2],
            started: first.at,
        };
        f.entries.push_back(Entry {
            at: first.at,
            observation: None,
            after: Box::new(axes),
        });
        f
    }

    /// Initialises the camera's rotation of a new filter from another filter.
    pub fn adopt_mount(&mut self, known: &FilterState) {
        let Some(first) = self.entries.front_mut().filter(|e| e.observation.is_none()) else {
            return;
        };
        for i in TILT {
            let axis = &mut first.after[i];
            let known = &known[i];
            axis.x[VISION] = known.x[VISION];
            axis.x[MEAN] -= known.x[VISION];
            axis.p[VISION][VISION] = known.p[VISION][VISION];
        }
    }

    pub fn at(&self, waves: &Waves, t: DroneTime) -> FilterState {
        let i = self.entries.partition_point(|e| e.at <= t).max(1);
        let Some(before) = self.entries.get(i - 1) else {
            // Unreachable, since entries are never empty.
            return core::array::from_fn(|i| Axis::new(&self.noise[i], &[], i, 0.0, 1e3, 1.0));
        };
        let mut state = *before.after;
        self.advance(&mut state, waves, before.at, t);
        state
    }
    pub fn started(&self) -> DroneTime {
        self.started
    }
    /// State after the newest observation.
    pub fn last(&self) -> Option<&FilterState> {
        self.entries.back().map(|e| &*e.after)
    }
    pub fn source(&self, kind: ObservationKind) -> &AidSource<DroneClock> {
        &self.sources[kind as usize]
    }
    pub fn newest(&self) -> Option<DroneTime> {
        self.entries.back().map(|e| e.at)
    }
    pub fn set_radio_available(&mut self, radio_available: bool) {
        self.radio_available = radio_available;
    }
    /// Noise parameters in state `s`. Under way, the helmsman and the waves change the mean velocity; in a turn, the
    /// hull also slips sideways and slows down. Without the radio a constant course is assumed, because vision cannot
    /// distinguish a change of the mean velocity from waves.
    pub fn noise(&self, s: &FilterState) -> [AxisNoise; AXES] {
        let mut noise = self.noise;
        if let Some(t) = turning(s).filter(|_| self.radio_available) {
            let across = (t.rate * t.speed).abs().min(MAX_TURN_MPS2);
            let speed = t.speed.min(MAX_SPEED_MPS);
            for n in noise.iter_mut().take(2) {
                n.rate_walk += (n.turn_walk * across).powi(2) + (n.speed_walk * speed).powi(2);
            }
        }
        noise
    }
    pub fn is_finite(&self) -> bool {
        self.entries
            .back()
            .is_some_and(|e| e.after.iter().all(Axis::is_finite))
    }

    /// Propagates a state from the newest modes at `from` to the newest modes at `to`. The difference between the modes
    /// of two messages is not a motion of the deck, so it is moved into the residual.
    fn advance(&self, s: &mut FilterState, waves: &Waves, from: DroneTime, to: DroneTime) {
        let dt = to - from;
        if dt <= Span::ZERO {
            return;
        }
        let oscillators = waves.oscillators(to);
        let step = OscillatorStep::new(&oscillators, dt.secs());
        let noise = self.noise(s);
        for (i, a) in s.iter_mut().enumerate() {
            a.propagate(&noise[i], &oscillators, i, &step);
        }
        propagate_turn(s, dt.secs());
        if let Some(change) = waves.change(from, to) {
            for (i, a) in s.iter_mut().enumerate() {
                let course = i < 2;
                // The integration constant of the velocity is arbitrary and is not wave motion.
                a.x[if course { MEAN } else { HEAD }] += change.value[i];
                a.x[HEAD + 1] += change.rate[i];
                // Pseudo-measurement: the newer modes leave the residual that the vessel states.
                if let Some(o) = oscillators.first() {
                    let var = o.sd[i].powi(2);
                    if !course {
                        a.update(MeasurementRow::Residual, 0.0, var);
                    }
                    a.update(MeasurementRow::ResidualRate, 0.0, var * o.omega * o.omega);
                }
            }
        }
    }
    /// Drops all states except the newest, because they were computed with other oscillators.
    fn keep_newest(&mut self) -> Option<&mut Entry> {
        let newest = self.entries.len().saturating_sub(1);
        self.spare.extend(self.entries.drain(..newest).map(|e| e.after));
        let e = self.entries.back_mut()?;
        e.observation = None;
        Some(e)
    }
    /// Fuses the predecessor's difference between vision's and the radio's slow errors, with its current variance.
    pub fn resume(&mut self, m: &PredictorCheckpoint, variance: &[f64; AXES]) {
        self.observed = [true; AXES];
        self.sources[ObservationKind::Tag as usize].fused_at = m.tag_at;
        self.sources[ObservationKind::Uvdar as usize].fused_at = Some(m.vision_at);
        let Some(e) = self.keep_newest() else { return };
        for (i, a) in e.after.iter_mut().enumerate() {
            a.update(MeasurementRow::Offset, m.offset[i], variance[i]);
        }
    }
    /// Discards a wrong position in the drone's frame: adds `apart_m` to the uncertainty of each axis, and resets the
    /// camera's rotation, which may have absorbed part of the error.
    pub fn give_up_place(&mut self, apart_m: f64) {
        let noise = self.noise;
        self.by_relative = false;
        let Some(e) = self.keep_newest() else { return };
        for (a, n) in e.after.iter_mut().zip(&noise).take(3) {
            a.p[VISION][VISION] += apart_m * apart_m;
            a.forget(TURN, n.turn.0);
        }
    }
    /// Replaces the default oscillators by the vessel's identified modes; the motion is split into modes and residual.
    pub fn adopt_modes(&mut self, waves: &Waves) {
        let Some(e) = self.keep_newest() else { return };
        let modes = waves.motion(e.at);
        for (i, a) in e.after.iter_mut().enumerate() {
            a.fold_oscillators();
            a.x[if i < 2 { MEAN } else { HEAD }] -= modes.value[i];
            a.x[HEAD + 1] -= modes.rate[i];
        }
    }
    /// From the newest observation on, replaces modes that are too old to extrapolate by oscillators, which share the
    /// residual motion in proportion to their variances.
    pub fn hold_modes(&mut self, waves: &mut Waves) {
        let Some(at) = self.newest() else { return };
        let Some(held) = waves.hand_over(at) else {
            return;
        };
        let oscillators = waves.oscillators(at);
        let Some(e) = self.keep_newest() else { return };
        for (i, a) in e.after.iter_mut().enumerate() {
            a.hold(&oscillators, i, &held);
        }
    }
    /// Recomputes the states since `since` with newer modes.
    pub fn rebase(&mut self, waves: &Waves, since: DroneTime) {
        self.replay(waves, self.entries.partition_point(|e| e.at < since).max(1));
    }

    /// Fuses `o` at its own time, and repeats all later observations.
    pub fn fuse(&mut self, waves: &Waves, o: &DeckObservation) -> Fused {
        let i = self.entries.partition_point(|e| e.at <= o.at);
        let late = self
            .newest()
            .is_some_and(|n| n - o.at > Span::from_secs(MAX_LATE_S));
        let (Some(before), false) = (i.checked_sub(1).and_then(|k| self.entries.get(k)), late) else {
            return Fused::Late;
        };
        let same = |e: &Entry| e.at == o.at && e.observation.is_some_and(|x| x.kind == o.kind);
        if self
            .entries
            .iter()
            .take(i)
            .rev()
            .take_while(|e| e.at == o.at)
            .any(same)
        {
            return Fused::Duplicate;
        }
        let since = before.at;
        let mut state = match self.spare.pop() {
            Some(mut s) => {
                *s = *before.after;
                s
            }
            None => before.after.clone(),
        };
        self.advance(&mut state, waves, since, o.at);
        let rejected = apply(&mut state, o, waves, self.gate, self.common_tilt);
        self.note(o, |k| rejected & (1 << k) == 0);
        let rejected = rejected.count_ones();
        self.entries.insert(
            i,
            Entry {
                at: o.at,
                observation: Some(*o),
                after: state,
            },
        );
        self.replay(waves, i + 1);
        while self.entries.len() > MAX_ENTRIES {
            if let Some(e) = self.entries.pop_front() {
                self.spare.push(e.after);
            }
        }
        self.record(o, rejected);
        if rejected == 0 {
            Fused::All
        } else {
            Fused::Rejected(rejected)
        }
    }

    /// Records which degrees of freedom were measured in the drone's frame; `used`: accepted groups.
    fn note(&mut self, o: &DeckObservation, used: impl Fn(usize) -> bool) {
        match o.kind {
            ObservationKind::Estimate => return,
            ObservationKind::Relative => {
                self.by_relative |= used(0);
                return;
            }
            ObservationKind::Tag | ObservationKind::Uvdar => self.by_relative &= !used(0),
            ObservationKind::Range => {}
        }
        for (k, group) in GROUPS.iter().enumerate() {
            for &i in *group {
                self.observed[i] |= used(k) && o.value[i].is_some();
            }
        }
    }

    /// Repeats the observations from entry `from` on.
    fn replay(&mut self, waves: &Waves, from: usize) {
        for k in from..self.entries.len() {
            let Some((state, at)) = k
                .checked_sub(1)
                .and_then(|j| self.entries.get(j))
                .map(|e| (*e.after, e.at))
            else {
                return;
            };
            let mut state = state;
            let Some((next, observation)) = self.entries.get(k).map(|e| (e.at, e.observation)) else {
                return;
            };
            self.advance(&mut state, waves, at, next);
            if let Some(o) = observation {
                apply(&mut state, &o, waves, self.gate, self.common_tilt);
            }
            if let Some(e) = self.entries.get_mut(k) {
                *e.after = state;
            }
        }
    }

    pub fn shift(&mut self, jump: &FrameJump) {
        let before = self.offsets();
        let by_relative = self.by_relative;
        let measured = core::array::from_fn(|i| self.observed[i] || by_relative && i < 3);
        let mut known = measured;
        for e in &mut self.entries {
            known = shift::state(
                &mut e.after,
                jump,
                (&measured, by_relative),
                &self.noise,
                self.gate,
            );
            if let Some(o) = &mut e.observation {
                o.shift(jump);
            }
        }
        let after = self.offsets();
        for (taken, (a, b)) in self.taken.iter_mut().zip(after.into_iter().zip(before)) {
            *taken += a - b;
        }
        for (observed, known) in self.observed.iter_mut().zip(known) {
            *observed &= known;
        }
        if !(known[0] && known[1]) {
            self.taken = [0.0; 2];
        }
    }
    /// Vision's slow error minus the radio's, north and east, m.
    fn offsets(&self) -> [f64; 2] {
        let offset = |i: usize| {
            self.last()
                .map_or(0.0, |s| s[i].project(MeasurementRow::Offset).0)
        };
        [offset(0), offset(1)]
    }
    /// Distance between the positions by vision and by radio, and its limit, m. None without vision.
    pub fn place_apart_m(&self) -> Option<[f64; 2]> {
        let [north, east, ..] = self.observed;
        let last = self.last().filter(|_| north && east)?;
        let offset = [0, 1].map(|i| last[i].project(MeasurementRow::Offset).0);
        Some(agreement::place(offset, 0.0, &self.noise, self.taken))
    }
    /// Distance between a detection and the radio's position, and its limit, m, if the limit is exceeded and a
    /// `followed` deck is not detected at its previous position. `s` is the state at the time of the detection.
    pub fn elsewhere(
        &self,
        waves: &Waves,
        s: &FilterState,
        o: &DeckObservation,
        followed: bool,
    ) -> Option<[f64; 2]> {
        let by_vision = place(s, waves, o, MeasurementRow::Vision)?;
        let same_place = (by_vision.iter().zip(s)).all(|(nu, axis)| axis.normalised(nu) <= self.gate);
        if followed && same_place {
            return None;
        }
        let [apart, limit] = self.apart(waves, s, o)?;
        (!(apart <= limit)).then_some([apart, limit])
    }
    /// Distance between a detection and the radio's position, and its limit, m, for the state `s` at its time.
    pub fn apart(&self, waves: &Waves, s: &FilterState, o: &DeckObservation) -> Option<[f64; 2]> {
        let by_radio = place(s, waves, o, MeasurementRow::Radio)?;
        let variance = |i: usize| {
            let lever = o.lever()[i];
            by_radio[i].variance + s[i].project(MeasurementRow::Radio).1 + lever * lever * s[i].p[TURN][TURN]
        };
        let more = variance(0).max(variance(1));
        let apart = by_radio.map(|nu| nu.value);
        Some(agreement::place(apart, more, &self.noise, self.taken))
    }

    /// Records the result. Many consecutive rejections of a source show that the filter is wrong, so its uncertainty is
    /// increased.
    fn record(&mut self, o: &DeckObservation, rejected: u32) {
        let source = &mut self.sources[o.kind as usize];
        source.record(o.at, 0.0, rejected == 0);
        let slow = match o.kind {
            ObservationKind::Range | ObservationKind::Relative => return,
            ObservationKind::Estimate => super::axis::RADIO,
            ObservationKind::Tag | ObservationKind::Uvdar => VISION,
        };
        if rejected < GROUPS.len() as u32 {
            source.fused_at = source.fused_at.max(Some(o.at));
        }
        if source.rejections < MAX_CONSECUTIVE_REJECTIONS {
            return;
        }
        source.rejections = 0;
        let reset_sd = [2.0, 2.0, 2.0, 0.1, 0.1, 0.5];
        if let Some(e) = self.entries.back_mut() {
            for (i, a) in e.after.iter_mut().enumerate() {
                a.p[slow][slow] += f64::powi(reset_sd[i], 2);
                for k in HEAD..a.n {
                    a.p[k][k] *= 4.0;
                }
            }
        }
    }
}

struct Turning {
    /// Mean rate of the heading, rad/s.
    rate: f64,
    /// Mean speed, m/s.
    speed: f64,
}

/// Turn of a vessel that is fast enough to steer.
fn turning(s: &FilterState) -> Option<Turning> {
    let speed = s[0].x[RATE].hypot(s[1].x[RATE]);
    (speed > STEERAGE_MPS).then_some(Turning {
        rate: s[5].x[RATE],
        speed,
    })
}

/// Rotates the mean velocity, heel and trim of a turning vessel over the last `dt` (s), without covariances: `v' =
/// omega x v`, the coordinated turn (Bar-Shalom, Li and Kirubarajan 2001, section 11.7).
fn propagate_turn(s: &mut FilterState, dt: f64) {
    let Some(turn) = turning(s) else {
        return;
    };
    let angle = turn.rate * dt;
    if !(angle.abs() < MAX_BEND_RAD) {
        return;
    }
    let turned = |s: &FilterState, slot: usize, [i, j]: [usize; 2]| {
        Rotation2::new(angle) * Vector2::new(s[i].x[slot], s[j].x[slot])
    };
    let heel = turned(s, MEAN, TILT);
    (s[TILT[0]].x[MEAN], s[TILT[1]].x[MEAN]) = (heel.x, heel.y);
    let velocity = turned(s, RATE, [0, 1]);
    for (i, after) in [velocity.x, velocity.y].into_iter().enumerate() {
        s[i].x[MEAN] += 0.5 * dt * (after - s[i].x[RATE]);
        s[i].x[RATE] = after;
    }
}

/// Innovations of a detection's position, north and east, measured by `row`.
fn place(
    s: &FilterState,
    waves: &Waves,
    o: &DeckObservation,
    row: MeasurementRow,
) -> Option<[Innovation; 2]> {
    let [Some(north), Some(east), ..] = o.value else {
        return None;
    };
    let modes = waves.motion(o.at).value;
    Some([(0, north), (1, east)].map(|(i, (v, r))| s[i].innovation(row, v - modes[i], r)))
}

/// Updates vision's rotation from the measured minus the predicted tilt of the tag. `common` (rad) is the error of the
/// vessel's own tilt, which does not average out because all measurements contain it.
fn update_camera_rotation(s: &mut FilterState, innovations: &[Option<Innovation>; AXES], common: f64) {
    for (i, j) in [(0, 4), (1, 3)] {
        let Some(nu) = &innovations[j] else { continue };
        // Measured tilt relative to the level without vision's slow error.
        let measured = nu.value + s[j].x[VISION];
        let (_, var) = s[j].project(MeasurementRow::Level);
        s[i].update(
            MeasurementRow::Turn,
            measured,
            nu.variance + var + common * common,
        );
        s[i].p[TURN][TURN] = s[i].p[TURN][TURN].max(common * common);
    }
}

/// Fuses an observation into a state of the same time. Returns the rejected groups as a bit mask.
fn apply(s: &mut FilterState, o: &DeckObservation, waves: &Waves, gate: f64, common: f64) -> u32 {
    let modes = waves.motion(o.at);
    let innovations = innovations(s, &modes, waves.lever_arm(), o);
    // An invalid value also counts as an outlier.
    let beyond = |a: &Axis, nu: Option<Innovation>| nu.is_some_and(|nu| !(a.normalised(&nu) <= gate));
    let rate =
        |a: &Axis, i: usize| o.rate[i].map(|(v, r)| a.innovation(MeasurementRow::Rate, v - modes.rate[i], r));
    let mut rejected = 0_u32;
    for (k, group) in GROUPS.into_iter().enumerate() {
        let outlier = |&i: &usize| beyond(&s[i], innovations[i]) || beyond(&s[i], rate(&s[i], i));
        if group.iter().any(outlier) {
            rejected |= 1 << k;
            continue;
        }
        if o.kind == ObservationKind::Tag && group == GROUPS[1] {
            update_camera_rotation(s, &innovations, common);
        }
        for &i in group {
            if let Some(nu) = &innovations[i] {
                s[i].correct(nu);
            }
            if let Some(nu) = rate(&s[i], i) {
                s[i].correct(&nu);
            }
        }
    }
    rejected
}

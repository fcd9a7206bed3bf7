//! Draws a storm: kinds are switched on or off by the seed (swarm), states are those in which most happens.

use alight_shared::msg::State;
use alight_uav::autopilot::message::id;
use alight_uav::autopilot::modes::Firmware;

use super::{Fault, Kind, MAX_FAULTS, Moment, Storm, kinds};
use crate::physics::streams::Streams;
use crate::physics::vessel::Course;
use crate::sensors::noise::Noise;

/// States in which faults begin, how often in parts, and within what time after their entry, s.
const STATES: [(State, u32, f64); 8] = [
    (State::GetAltitude, 1, 3.0),
    (State::Approach, 2, 8.0),
    (State::Tracking, 3, 4.0),
    (State::TrackingStable, 3, 2.0),
    (State::Descent, 7, 4.0),
    (State::Flare, 5, 1.2),
    (State::Landed, 3, 3.0),
    (State::Hold, 1, 3.0),
];

/// Messages of the autopilot that may cease.
const STREAMS: [u32; 9] = [
    id::ATTITUDE_QUATERNION,
    id::LOCAL_POSITION_NED,
    id::ODOMETRY,
    id::HIGHRES_IMU,
    id::ATTITUDE_TARGET,
    id::EXTENDED_SYS_STATE,
    id::BATTERY_STATUS,
    id::ESTIMATOR_STATUS,
    id::DISTANCE_SENSOR,
];

impl Storm {
    /// The storm of `seed` with so many faults, 16 at most.
    pub fn drawn(seed: u64, faults: usize) -> Storm {
        let mut noise = Noise::new(&Streams::new(seed), "storm");
        // Round values, easy to read in a list.
        let mut between =
            |[low, high]: [f64; 2], step: f64| ((low + (high - low) * noise.uniform()) / step).round() * step;
        let sea = [between([0.0, 0.45], 0.05), between([4.0, 7.0], 0.5)].map(round);
        let wind_mps = round(between([0.0, 8.0], 0.5));
        let speed_mps = round(between([1.0, 3.0], 0.5));
        let course = match noise.uniform() {
            u if u < 0.5 => Course::Drift,
            u if u < 0.75 => Course::Straight,
            _ => Course::Square,
        };
        let autopilot = if noise.chance(0.5) {
            Firmware::Px4
        } else {
            Firmware::ArduCopter
        };
        let reserved = noise.chance(0.5);
        let drones = if noise.chance(0.2) { 2 } else { 1 };
        let mast = noise.chance(0.2);
        let kinds: Vec<Kind> = Kind::ALL.iter().copied().filter(|_| noise.chance(0.5)).collect();
        let kinds = if kinds.is_empty() { Kind::ALL } else { &kinds };
        let faults = (0..faults.min(MAX_FAULTS)).map(|_| fault(kinds, &mut noise));
        Storm {
            seed,
            autopilot,
            sea,
            course,
            speed_mps: if course.is_under_way() { speed_mps } else { 0.0 },
            wind_mps,
            reserved,
            drones,
            mast,
            faults: faults.collect(),
        }
    }
    /// The same with its last fault of this kind in this state, its times and size drawn by the seed.
    #[must_use]
    pub fn aimed(mut self, (kind, state): Pair) -> Storm {
        let mut noise = Noise::new(&Streams::new(self.seed), "storm.aimed");
        let within_s = STATES.iter().find(|s| s.0 == state).map_or(1.0, |s| s.2);
        if let Some(last) = self.faults.last_mut() {
            *last = of_kind(kind, state, within_s, &mut noise);
        }
        self
    }
}

/// A kind of fault and the state in which it begins.
pub type Pair = (Kind, State);

/// All pairs that are drawn.
pub fn pairs() -> impl Iterator<Item = Pair> {
    let of = |kind: &'static Kind| STATES.iter().map(|(state, ..)| (*kind, *state));
    Kind::ALL.iter().flat_map(of)
}

/// To a thousandth: what is written is read again to the bit.
fn round(v: f64) -> f64 {
    (v * 1e3).round() / 1e3
}

fn fault(kinds: &[Kind], noise: &mut Noise) -> Fault {
    let kind = *pick(kinds, noise).unwrap_or(&Kind::Abort);
    let parts: u32 = STATES.iter().map(|s| s.1).sum();
    let mut part = (noise.uniform() * f64::from(parts)) as u32;
    let state = STATES.iter().find(|(_, parts, _)| {
        let here = part < *parts;
        part = part.saturating_sub(*parts);
        here
    });
    let (state, _, within_s) = *state.unwrap_or(&STATES[4]);
    of_kind(kind, state, within_s, noise)
}

fn of_kind(kind: Kind, state: State, within_s: f64, noise: &mut Noise) -> Fault {
    let spec = kind.spec();
    let mut between = |[low, high]: [f64; 2]| round(low + (high - low) * noise.uniform());
    let (after_s, size, lasts_s) = (
        between([0.0, within_s]),
        between(spec.size),
        between(spec.lasts_s),
    );
    let size = if kind == Kind::StreamStops {
        f64::from(*pick(&STREAMS, noise).unwrap_or(&id::ODOMETRY))
    } else if spec.size == kinds::CHECKPOINT {
        size.round()
    } else {
        size
    };
    Fault {
        kind,
        moment: Moment::In(state),
        after_s,
        size,
        lasts_s,
    }
}

fn pick<'a, T>(among: &'a [T], noise: &mut Noise) -> Option<&'a T> {
    among.get((noise.uniform() * among.len() as f64) as usize)
}

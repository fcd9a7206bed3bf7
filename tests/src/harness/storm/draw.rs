//! Draws a storm. The seed enables or disables each kind of fault (swarm testing); faults begin in the most
//! eventful states of the flight.

use alight_shared::{
    mavlink::{MessageData as _, dialect as m},
    msg::State,
};
use alight_uav::autopilot::modes::Firmware;

use super::{Fault, FaultKind, FlightKind, MAX_FAULTS, Moment, Storm, kinds, plan::PlannedPhase};
use crate::{
    physics::{streams::Streams, vessel::VesselCourse},
    sensors::noise::Noise,
};

/// Cumulative percentages of faults that begin at the first entry of their state, and at the second.
const ENTRIES: [f64; 2] = [85.0, 95.0];
/// Messages from the autopilot that a fault may stop.
const STREAMS: [u32; 9] = [
    m::ATTITUDE_QUATERNION_DATA::ID,
    m::LOCAL_POSITION_NED_DATA::ID,
    m::ODOMETRY_DATA::ID,
    m::HIGHRES_IMU_DATA::ID,
    m::ATTITUDE_TARGET_DATA::ID,
    m::EXTENDED_SYS_STATE_DATA::ID,
    m::BATTERY_STATUS_DATA::ID,
    m::ESTIMATOR_STATUS_DATA::ID,
    m::DISTANCE_SENSOR_DATA::ID,
];

impl Storm {
    /// `faults` is the number of faults, at most 16.
    pub fn drawn(seed: u64, faults: usize) -> Storm {
        let mut noise = Noise::new(&Streams::new(seed), "storm");
        // Rounded values make a list readable.
        let mut between =
            |[low, high]: [f64; 2], step: f64| ((low + (high - low) * noise.uniform()) / step).round() * step;
        let sea = [between([0.0, 0.45], 0.05), between([4.0, 7.0], 0.5)].map(round);
        let wind_mps = round(between([0.0, 8.0], 0.5));
        let speed_mps = round(between([1.0, 3.0], 0.5));
        let course = match noise.uniform() {
            u if u < 0.5 => VesselCourse::Drift,
            u if u < 0.75 => VesselCourse::Straight,
            _ => VesselCourse::Square,
        };
        let autopilot = if noise.chance(0.5) {
            Firmware::Px4
        } else {
            Firmware::ArduCopter
        };
        let reserved = noise.chance(0.5);
        let drones = if noise.chance(0.2) { 2 } else { 1 };
        let mast = noise.chance(0.2);
        let kinds: Vec<FaultKind> = FaultKind::ALL
            .iter()
            .copied()
            .filter(|kind| !kind.needs_moving_base() && !kind.is_of_device() && noise.chance(0.5))
            .collect();
        let kinds = if kinds.is_empty() { FaultKind::ALL } else { &kinds };
        // A separate stream keeps the sea and faults of existing landings unchanged.
        let mut others = Noise::new(&Streams::new(seed), "storm.flight");
        let flight = by_parts(&FlightKind::ALL, FlightKind::parts, others.uniform());
        let flight = flight.copied().unwrap_or_default();
        let faults = (0..faults.min(MAX_FAULTS)).map(|_| fault(flight, kinds, &mut noise, &mut others));
        let storm = Storm {
            seed,
            flight,
            autopilot,
            sea,
            course,
            speed_mps: if course.is_under_way() { speed_mps } else { 0.0 },
            wind_mps,
            reserved,
            drones,
            mast,
            moving_base: false,
            stock: false,
            version: None,
            faults: faults.collect(),
        };
        storm
            .fitted()
            .with_moving_base()
            .with_device_fault()
            .with_installation()
    }
    /// Draws the firmware's version, and in one storm of three leaves parameters that only cause a warning at the
    /// maker's default. Uses a separate stream so that other draws do not change.
    fn with_installation(mut self) -> Storm {
        let mut noise = Noise::new(&Streams::new(self.seed), "storm.installation");
        self.version = match self.autopilot {
            Firmware::Px4 => pick(&[[1, 16], [1, 17], [1, 18]], &mut noise),
            Firmware::ArduCopter => pick(&[[4, 6], [4, 7]], &mut noise),
        }
        .copied();
        self.stock = noise.chance(1.0 / 3.0);
        self
    }
    /// Gives one storm in six a moving base, which its first fault then affects. Uses a separate stream so
    /// that other draws do not change.
    fn with_moving_base(mut self) -> Storm {
        let mut noise = Noise::new(&Streams::new(self.seed), "storm.moving_base");
        self.moving_base = noise.chance(1.0 / 6.0) && !self.flight.is_silent();
        if self.moving_base {
            self.replace(0, FaultKind::needs_moving_base, &mut noise);
        }
        self
    }
    /// Gives one storm in three a fault of one of the vessel's devices instead of its second fault, likewise.
    fn with_device_fault(mut self) -> Storm {
        let mut noise = Noise::new(&Streams::new(self.seed), "storm.device");
        if noise.chance(1.0 / 3.0) {
            self.replace(1, FaultKind::is_of_device, &mut noise);
        }
        self
    }
    /// Draws fault number `k` again, among the kinds that `fits` selects.
    fn replace(&mut self, k: usize, fits: fn(FaultKind) -> bool, noise: &mut Noise) {
        let row = by_parts(self.flight.rows(), |row| row.1, noise.uniform());
        let kinds: Vec<FaultKind> = FaultKind::ALL
            .iter()
            .copied()
            .filter(|kind| fits(*kind))
            .collect();
        if let (Some(fault), Some(kind), Some(row)) = (self.faults.get_mut(k), pick(&kinds, noise), row) {
            *fault = of_kind(*kind, *row, 1, noise);
        }
    }
    /// Adapts the scene so that the flight is possible.
    fn fitted(mut self) -> Storm {
        self.drones = self.drones.min(self.flight.most_drones());
        // Only the radio informs the drone of obstacles, and the mast is on the usual hull only.
        self.mast &= !self.flight.is_silent();
        match self.flight {
            FlightKind::Landing | FlightKind::Station | FlightKind::Mavlink => {}
            FlightKind::TakeOff | FlightKind::Sortie | FlightKind::Cycles => self.reserved = true,
            FlightKind::Beacon => self.reserved = false,
            FlightKind::TagAlone => {
                self.reserved = false;
                // Before the order, a drone does not follow a moving vessel.
                self.course = VesselCourse::Drift;
                self.speed_mps = 0.0;
            }
        }
        self
    }
    /// Replaces the last fault with this kind in this state; the seed draws times and size.
    #[must_use]
    pub fn aimed(mut self, (kind, state): Pair) -> Storm {
        let mut noise = Noise::new(&Streams::new(self.seed), "storm.aimed");
        let rows = self.flight.rows();
        let row = rows.iter().find(|row| row.0 == state).copied();
        self.moving_base |= kind.needs_moving_base();
        if let Some(last) = self.faults.last_mut() {
            *last = of_kind(kind, row.unwrap_or((state, 1, 1.0)), 1, &mut noise);
        }
        self
    }
}

pub type Pair = (FaultKind, State);

pub fn pairs(flight: FlightKind) -> impl Iterator<Item = Pair> {
    let pairs_of = move |kind: &'static FaultKind| flight.states().map(move |state| (*kind, state));
    FaultKind::ALL.iter().flat_map(pairs_of)
}

/// Rounds to a thousandth, so that a list is reproduced exactly when it is read.
fn round(v: f64) -> f64 {
    (v * 1e3).round() / 1e3
}

fn fault(flight: FlightKind, kinds: &[FaultKind], noise: &mut Noise, others: &mut Noise) -> Fault {
    let kind = *pick(kinds, noise).unwrap_or(&FaultKind::Abort);
    let row = by_parts(flight.rows(), |row| row.1, noise.uniform());
    let row = row.copied().unwrap_or((State::Descent, 1, 4.0));
    let part = 100.0 * others.uniform();
    let later = ENTRIES.into_iter().filter(|most| part >= *most).count();
    of_kind(kind, row, 1 + later as u8, noise)
}

/// Fault at the `entry`-th entry of the state. The start of a flight in `Idle` does not count as an entry.
fn of_kind(kind: FaultKind, (state, _, within_s): PlannedPhase, entry: u8, noise: &mut Noise) -> Fault {
    let spec = kind.spec();
    let mut between = |[low, high]: [f64; 2]| round(low + (high - low) * noise.uniform());
    let after_s = between([0.0, within_s]);
    let size = between(spec.size);
    let lasts_s = between(spec.lasts_s);
    let size = if kind == FaultKind::StreamStops {
        f64::from(*pick(&STREAMS, noise).unwrap_or(&m::ODOMETRY_DATA::ID))
    } else if spec.size == kinds::CHECKPOINT {
        size.round()
    } else {
        size
    };
    Fault {
        kind,
        moment: Moment::In(state),
        entry: entry + u8::from(state == State::Idle),
        after_s,
        size,
        lasts_s,
    }
}

/// Draws with probabilities proportional to `parts`; `u` is uniform from 0 to 1.
fn by_parts<T>(among: &[T], parts: impl Fn(&T) -> u32, u: f64) -> Option<&T> {
    let all: u32 = among.iter().map(&parts).sum();
    let mut part = (u * f64::from(all)) as u32;
    among.iter().find(|&one| {
        let here = part < parts(one);
        part = part.saturating_sub(parts(one));
        here
    })
}

fn pick<'a, T>(among: &'a [T], noise: &mut Noise) -> Option<&'a T> {
    among.get((noise.uniform() * among.len() as f64) as usize)
}

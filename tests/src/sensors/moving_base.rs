//! Moving base: the vessel's receiver sends RTCM 3, and the drone's receiver computes the vector between the
//! two antennas.
//!
//! Both receivers measure at common GNSS times, the epochs, whose numbers are in the frames. An epoch yields a position
//! 80 ms after all its frames (base position and observations) have arrived; an incomplete epoch yields none.
//!
//! | solution | becomes | after |
//! |---|---|---|
//! | none | float | 1 s with corrections |
//! | float | fixed | an exponential time, with corrections |
//! | fixed | float | an exponential time, or 5 s without corrections |
//! | float, fixed | none | 20 s without corrections |

use std::collections::VecDeque;

use alight_shared::{
    config,
    frames::{Deck, DroneBody},
    geodesy::Datum,
    msg::CarrierSolution,
    rtcm,
    time::{Span, Time, TrueTime, VesselClock},
};
use nalgebra::Vector3;

use super::{
    bytes::{
        StatedErrors,
        rtcm::{content, frame},
        ubx,
    },
    delay::DelayLine,
    noise::{GaussMarkovError, Noise, SampleSchedule, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

/// Messages of an epoch with content sizes, bytes: position of the base, GPS, GLONASS, Galileo, BeiDou, and
/// in every fifth epoch the GLONASS biases. Source: message numbers of u-blox's moving base; sizes for 5 to 8
/// satellites per system and two signals per satellite.
const MESSAGES: [(u16, usize); 6] = [
    (rtcm::UBLOX, 57),
    (1077, 147),
    (1087, 107),
    (1097, 127),
    (1127, 137),
    (1230, 57),
];
/// Bits for the messages of a complete epoch.
const COMPLETE: u8 = 0b1_1111;
/// Time from an epoch to the arrival of its frames at the vessel's computer, s: 1 kB over a fast serial line.
const BASE_LATENCY_S: f64 = 0.03;
/// Time from the last frame of an epoch to the solution's arrival at the drone's computer, s.
const PROCESSING_S: f64 = 0.08;
/// Maximum number of epochs that wait for frames, and of solutions in transit.
const EPOCHS: usize = 64;
/// Maximum age of corrections that can improve a solution, s.
const FRESH_S: f64 = 2.0;
/// Times without corrections after which a fix, and any solution, is lost, s.
const FIX_LASTS_S: f64 = 5.0;
const FLOAT_LASTS_S: f64 = 20.0;
/// Time from the first corrections to the first float solution, s.
const START_S: f64 = 1.0;
/// Standard deviations of a fix, m: white (north, east, down), and correlated.
const FIXED_SD_M: [f64; 3] = [0.01, 0.01, 0.015];
const FIXED_SLOW_SD_M: f64 = 0.005;
/// Standard deviations of float and code solutions, m.
const FLOAT_SD_M: f64 = 0.3;
const CODE_SD_M: f64 = 1.5;
/// Correlation times of the slow errors of fixes, float and code solutions, s.
const SLOW_S: f64 = 20.0;
const FLOAT_S: f64 = 30.0;
const CODE_S: f64 = 60.0;
/// Error of a fix caused by different atmosphere, m per metre between the antennas.
const BASELINE_ERROR: f64 = 1e-6;

config! {
    /// The vessel's GNSS receiver as moving base for the drone's receiver.
    ///
    /// Defaults: two dual-frequency receivers (u-blox F9P) on open water; values chosen here.
    #[derive(Copy)]
    pub struct MovingBaseConfig {
        /// Epochs per second.
        /// Chosen: 2.9 kB/s on the radio including headers, of the 3 kB/s reserved for these frames.
        pub rate_hz: f64 = 4.0, in 1.0..=5.0;
        /// Antenna of the vessel's receiver relative to the deck's centre, in the vessel's body frame, m.
        /// Chosen: at the stern rail, below the feet of a landing drone.
        pub antenna_m: [f64; 3] = [-1.4, 0.6, 0.1], in -50.0..=50.0;
        /// Mean time from a float solution to a fix, s.
        pub time_to_fix_s: f64 = 8.0, in 0.1..=1e4;
        /// Mean duration of a fix, s.
        pub fix_lost_every_s: f64 = 120.0, in 1.0..=1e6;
        /// Error of every fix, m, in a direction that is constant during a fix.
        pub false_fix_m: f64 = 0.0, in 0.0..=100.0;
        /// Latency of the position fix (NAV-PVT) of the drone's receiver, s.
        pub fix_latency_s: f64 = 0.05, in 0.0..=0.5;
        /// Fraction of the sky that the vessel hides from its antenna. Noise and time to a fix increase by a
        /// factor of 1 + 3 times this fraction.
        pub blocked: f64 = 0.0, in 0.0..=1.0;
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MovingBaseFaults {
    pub corrections_lost: bool,
    pub fix_lost: bool,
    /// Error of every fix, m; 0: fixes are correct.
    pub false_fix_m: f64,
}

fn epoch_at(t: Time<TrueTime>, rate_hz: f64) -> u32 {
    // Rounded in the same way as the measurement schedule.
    (t.secs() * rate_hz + 1e-6).floor().max(0.0) as u32
}

#[derive(Clone, Debug)]
pub(super) struct BaseReceiver {
    config: MovingBaseConfig,
    random: Noise,
    outlet: Outlet<Vec<u8>, VesselClock>,
}

impl BaseReceiver {
    pub(super) fn new(config: &MovingBaseConfig, identity: SenderIdentity, streams: &Streams) -> Self {
        BaseReceiver {
            config: *config,
            random: Noise::new(streams, "vessel.moving_base.content"),
            outlet: Outlet::new(config.rate_hz, BASE_LATENCY_S, &Windows::default(), identity),
        }
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>) -> Vec<u8> {
        if self.outlet.due(t).is_some() {
            let epoch = epoch_at(t, self.config.rate_hz);
            let messages = MESSAGES.len() - usize::from(!epoch.is_multiple_of(5));
            for (number, length) in MESSAGES.into_iter().take(messages) {
                let mut content = epoch.to_be_bytes().to_vec();
                content.resize_with(length, || (256.0 * self.random.uniform()) as u8);
                self.outlet.send(t, false, |_| Some(frame(number, &content)));
            }
        }
        self.outlet.arrived(t).concat()
    }
}

#[derive(Clone, Debug)]
struct Ambiguities {
    solution: CarrierSolution,
    /// Time of the next change; None: the wait has not begun because there are no corrections.
    changes_at: Option<Time<TrueTime>>,
    /// Mean time to a fix, and to its loss, s.
    means_s: [f64; 2],
    times: Noise,
    directions: Noise,
    direction: Vector3<f64>,
}

impl Ambiguities {
    fn new(config: &MovingBaseConfig, streams: &Streams) -> Self {
        let time_to_fix_s = config.time_to_fix_s * (1.0 + 3.0 * config.blocked);
        Ambiguities {
            solution: CarrierSolution::None,
            changes_at: None,
            means_s: [time_to_fix_s, config.fix_lost_every_s],
            times: Noise::new(streams, "drone.moving_base.times"),
            directions: Noise::new(streams, "drone.moving_base.directions"),
            direction: Vector3::zeros(),
        }
    }
    /// `age_s` is the age of the corrections; `fix_lost`: no fix is possible.
    fn step(&mut self, t: Time<TrueTime>, age_s: f64, fix_lost: bool) {
        let fresh = age_s <= FRESH_S;
        let due = self.changes_at.is_some_and(|at| t >= at);
        match self.solution {
            CarrierSolution::None if !fresh => self.changes_at = None,
            CarrierSolution::None => {
                let at = *self.changes_at.get_or_insert(t + Span::from_secs(START_S));
                if t >= at {
                    self.enter(t, CarrierSolution::Float);
                }
            }
            CarrierSolution::Float | CarrierSolution::Fixed if age_s > FLOAT_LASTS_S => {
                (self.solution, self.changes_at) = (CarrierSolution::None, None);
            }
            CarrierSolution::Float if due && fresh && !fix_lost => self.enter(t, CarrierSolution::Fixed),
            CarrierSolution::Fixed if due || fix_lost || age_s > FIX_LASTS_S => {
                self.enter(t, CarrierSolution::Float);
            }
            CarrierSolution::Float | CarrierSolution::Fixed => {}
        }
    }
    /// Enters a float or fixed solution of exponential duration.
    fn enter(&mut self, t: Time<TrueTime>, solution: CarrierSolution) {
        let [to_fix_s, to_loss_s] = self.means_s;
        let mean_s = if solution == CarrierSolution::Fixed {
            self.direction = self.directions.normal3().normalize();
            to_loss_s
        } else {
            to_fix_s
        };
        let lasts_s = -mean_s * (1.0 - self.times.uniform()).ln();
        (self.solution, self.changes_at) = (solution, Some(t + Span::from_secs(lasts_s)));
    }
}

/// An epoch as received by the drone's receiver.
#[derive(Clone, Copy, Debug)]
struct Epoch {
    number: u32,
    at: Time<TrueTime>,
    /// Vector from the vessel's antenna to the drone's, NED, m.
    baseline: Vector3<f64>,
    /// Errors of a code, a float and a fixed solution, m.
    errors: [Vector3<f64>; 3],
    /// Bits for messages that have arrived.
    came: u8,
}

#[derive(Clone, Debug)]
pub(super) struct MovingBaseRover {
    config: MovingBaseConfig,
    pub(super) faults: MovingBaseFaults,
    /// Antenna in the drone's body frame, m.
    antenna: Vector3<f64>,
    schedule: SampleSchedule,
    white: Noise,
    slow: GaussMarkovError,
    float: GaussMarkovError,
    code: GaussMarkovError,
    epochs: VecDeque<Epoch>,
    newest: Option<(u32, Time<TrueTime>)>,
    ambiguities: Ambiguities,
    line: DelayLine<Vec<u8>>,
}

impl MovingBaseRover {
    pub(super) fn new(config: &MovingBaseConfig, antenna_m: [f64; 3], streams: &Streams) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("drone.moving_base.{what}"));
        MovingBaseRover {
            config: *config,
            faults: MovingBaseFaults::default(),
            antenna: Vector3::from(antenna_m),
            schedule: SampleSchedule::new(config.rate_hz),
            white: noise("white"),
            slow: GaussMarkovError::new(noise("slow"), FIXED_SLOW_SD_M, SLOW_S),
            float: GaussMarkovError::new(noise("float"), FLOAT_SD_M, FLOAT_S),
            code: GaussMarkovError::new(noise("code"), CODE_SD_M, CODE_S),
            epochs: VecDeque::with_capacity(EPOCHS),
            newest: None,
            ambiguities: Ambiguities::new(config, streams),
            line: DelayLine::new(2 * EPOCHS),
        }
    }
    pub(super) fn receive(&mut self, t: Time<TrueTime>, bytes: &[u8]) {
        if self.faults.corrections_lost {
            return;
        }
        for (number, frame) in rtcm::frames(bytes).unwrap_or_default() {
            let bit = MESSAGES.iter().position(|(m, _)| *m == number.message);
            let number = content(frame).first_chunk().copied().map(u32::from_be_bytes);
            let epoch = self.epochs.iter_mut().find(|e| Some(e.number) == number);
            let (Some(bit), Some(epoch)) = (bit, epoch) else {
                continue;
            };
            let before = epoch.came;
            epoch.came |= 1 << bit;
            let completes = epoch.came & COMPLETE == COMPLETE && before & COMPLETE != COMPLETE;
            if completes && self.newest.is_none_or(|(newest, _)| newest < epoch.number) {
                let epoch = *epoch;
                self.newest = Some((epoch.number, epoch.at));
                let place = self.solved(&epoch);
                // The line is full only if more frames are in transit than a radio can hold.
                let _full = self.line.push(t + Span::from_secs(PROCESSING_S), place);
            }
        }
    }
    fn solved(&mut self, epoch: &Epoch) -> Vec<u8> {
        let solution = self.ambiguities.solution;
        let off_m = self.config.false_fix_m.max(self.faults.false_fix_m.abs());
        let [code, float, fixed] = epoch.errors;
        let (error, sd_m) = match solution {
            CarrierSolution::None => (code, [CODE_SD_M; 3]),
            CarrierSolution::Float => (float, [FLOAT_SD_M; 3]),
            CarrierSolution::Fixed => {
                let false_fix = self.ambiguities.direction * off_m;
                let far_m = BASELINE_ERROR * epoch.baseline.norm();
                let sd_m = FIXED_SD_M.map(|sd| sd.hypot(FIXED_SLOW_SD_M) + far_m);
                (fixed + false_fix, sd_m)
            }
        };
        let baseline_m = (epoch.baseline + error).into();
        let sd_m = sd_m.map(|sd| sd * (1.0 + 3.0 * self.config.blocked));
        ubx::nav_relposned_of_place(epoch.at.nanos(), baseline_m, sd_m, solution)
    }
    /// Bytes that have arrived by `t`. Measures when an epoch is due.
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        drone: &RigidState<DroneBody>,
        deck: &RigidState<Deck>,
    ) -> Vec<u8> {
        let age_s = self.newest.map_or(f64::INFINITY, |(_, at)| (t - at).secs());
        self.ambiguities.step(t, age_s, self.faults.fix_lost);
        if let Some(dt) = self.schedule.due(t) {
            let base = Vector3::from(self.config.antenna_m);
            let baseline = drone.at::<DroneBody>(self.antenna).position.0 - deck.at::<Deck>(base).position.0;
            // Each epoch draws all errors, whether used or not.
            let white = self.white.normal3();
            let far = white * (BASELINE_ERROR * baseline.norm());
            let fixed = white.component_mul(&Vector3::from(FIXED_SD_M)) + self.slow.step(dt) + far;
            let errors = [self.code.step(dt), self.float.step(dt), fixed];
            if self.epochs.len() == EPOCHS {
                self.epochs.pop_front();
            }
            self.epochs.push_back(Epoch {
                number: epoch_at(t, self.config.rate_hz),
                at: t,
                baseline,
                errors: errors.map(|e| e * (1.0 + 3.0 * self.config.blocked)),
                came: 0,
            });
            // Only the time of this fix is used.
            let stated = StatedErrors {
                position_m: 1.5,
                velocity_mps: 0.1,
            };
            let fix = ubx::nav_pvt(t.nanos(), (Datum::default(), 0.0), [0.0; 3], &stated);
            let _full = self
                .line
                .push(t + Span::from_secs(self.config.fix_latency_s), fix);
        }
        self.line.arrived(t).concat()
    }
}

#[cfg(test)]
mod tests;

//! Deck motion model of MPC-NE (Gupta et al. 2023, section III). Heave, roll and pitch are each a constant
//! plus undamped oscillators. A Fourier transform of the tag's pose gives their frequencies, and a linear
//! Kalman filter tracks them. Surge and sway have no modes: the position drifts.

use alight_shared::{
    msg::DeckStage,
    time::{DroneTime, Span},
};
use nalgebra::{SMatrix, SVector};
use std::collections::VecDeque;

use super::fourier::{self, POINTS};

const RATE_HZ: f64 = 30.0;
pub const MODES: usize = 4;
/// Number of filter states: offset, and sine and cosine part of each mode.
const N: usize = 1 + 2 * MODES;
/// Degrees of freedom with modes: heave (z), roll, pitch.
const WAVY: usize = 3;
/// Amplitude below which a mode counts as noise: m, rad, rad.
const FLOOR: [f64; WAVY] = [0.01, 0.002, 0.002];
const BAND_HZ: [f64; 2] = [0.06, 1.2];
const GAP_S: f64 = 2.0;
const KEPT: usize = POINTS;
/// Length of the transform's record and the minimum length for modes, s.
const WINDOW_S: f64 = 20.0;
const MIN_S: f64 = 10.0;
const REFRESH_S: f64 = 1.0;
/// Modes with an amplitude below this fraction of the largest are dropped.
const GATE: f64 = 0.15;
/// Time constant of the filter for position and drift velocity, s. Surge and sway have no modes; the drift
/// velocity alone predicts them 1 s ahead.
const PLACE_S: f64 = 0.15;

#[derive(Clone, Copy, Debug)]
struct Noise {
    sd: f64,
    walk: f64,
    /// Random walk of the offset after 1 s. The authors' offset is constant; this one follows the heave drift
    /// of the odometry.
    offset_walk: f64,
}
const TILT: Noise = Noise {
    sd: 0.01,
    walk: 0.03,
    offset_walk: 0.0005,
};
const NOISE: [Noise; WAVY] = [
    Noise {
        sd: 0.03,
        walk: 0.09,
        offset_walk: 0.02,
    },
    TILT,
    TILT,
];

#[derive(Clone, Copy, Debug, PartialEq)]
struct Wavy {
    omega: [f64; MODES],
    modes: usize,
    x: SVector<f64, N>,
    p: SMatrix<f64, N, N>,
}

impl Wavy {
    fn new(first: f64, omega: [f64; MODES], modes: usize, spread: f64) -> Self {
        let mut x = SVector::zeros();
        x[0] = first;
        let mut p = SMatrix::zeros();
        p[(0, 0)] = spread * spread;
        for i in 0..2 * modes.min(MODES) {
            p[(1 + i, 1 + i)] = spread * spread;
        }
        Wavy { omega, modes, x, p }
    }
    /// Transition matrix: each oscillator rotates by `omega dt`, `[s, c]' = [c, -s] omega`, so that `s` is the motion.
    fn turn(&self, dt: f64) -> SMatrix<f64, N, N> {
        let mut a = SMatrix::identity();
        for (m, omega) in self.omega.iter().enumerate().take(self.modes) {
            let (s, c) = (omega * dt).sin_cos();
            let i = 1 + 2 * m;
            a[(i, i)] = c;
            a[(i, i + 1)] = s;
            a[(i + 1, i)] = -s;
            a[(i + 1, i + 1)] = c;
        }
        a
    }
    fn update(&mut self, dt: f64, measured: f64, noise: &Noise) {
        let a = self.turn(dt);
        self.x = a * self.x;
        self.p = a * self.p * a.transpose();
        let q = noise.walk * noise.walk * dt;
        self.p[(0, 0)] += noise.offset_walk * noise.offset_walk * dt;
        let mut h = SVector::<f64, N>::zeros();
        h[0] = 1.0;
        for m in 0..self.modes {
            let i = 1 + 2 * m;
            self.p[(i, i)] += q;
            self.p[(i + 1, i + 1)] += q;
            h[i] = 1.0;
        }
        let ph = self.p * h;
        let gain = ph / (h.dot(&ph) + noise.sd * noise.sd);
        self.x += gain * (measured - h.dot(&self.x));
        self.p -= gain * ph.transpose();
        self.p = 0.5 * (self.p + self.p.transpose());
    }
    /// Value and rate after the time `t`.
    fn at(&self, t: f64) -> (f64, f64) {
        let x = self.turn(t) * self.x;
        let mut out = (x[0], 0.0);
        for (m, omega) in self.omega.iter().enumerate().take(self.modes) {
            out.0 += x[1 + 2 * m];
            out.1 += omega * x[2 + 2 * m];
        }
        out
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    at: DroneTime,
    value: [f64; WAVY],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Predicted {
    /// Position of the centre: north, east, down, m.
    pub position: [f64; 3],
    /// Velocity of the centre, m/s.
    pub velocity: [f64; 3],
    /// `roll² + pitch²`, rad².
    pub tilt_squared: f64,
}

#[derive(Clone, Debug, Default)]
pub struct SpectralModes {
    record: VecDeque<Sample>,
    wavy: Option<[Wavy; WAVY]>,
    /// Position and drift velocity, north and east, m and m/s.
    place: Option<[[f64; 2]; 2]>,
    analysed: Option<DroneTime>,
}

impl SpectralModes {
    /// Whether the record has the minimum length for modes.
    pub fn ready(&self) -> bool {
        self.analysed.is_some()
    }

    pub fn observe(&mut self, at: DroneTime, detection: &DeckStage) {
        let value = [detection.position[2], detection.euler[0], detection.euler[1]];
        let dt = match self.record.back() {
            // A detection up to half a tick early counts as on time.
            Some(last) if (at - last.at).secs() < 1.0 / RATE_HZ - 0.005 => return,
            Some(last) if (at - last.at).secs() <= GAP_S => (at - last.at).secs(),
            Some(_) | None => {
                *self = SpectralModes::default();
                0.0
            }
        };
        while self.record.len() >= KEPT || self.record.front().is_some_and(|s| (at - s.at).secs() > WINDOW_S)
        {
            self.record.pop_front();
        }
        self.record.push_back(Sample { at, value });
        let wavy = self
            .wavy
            .get_or_insert_with(|| value.map(|v| Wavy::new(v, [0.0; MODES], 0, 1.0)));
        for (i, w) in wavy.iter_mut().enumerate() {
            w.update(dt, value[i], &NOISE[i]);
        }
        // Critically damped second-order filter (Benedict and Bordner 1962).
        let theta = (-dt / PLACE_S).exp();
        let place = self
            .place
            .get_or_insert_with(|| [[detection.position[0], 0.0], [detection.position[1], 0.0]]);
        if dt > 0.0 {
            for (i, [p, v]) in place.iter_mut().enumerate() {
                *p += *v * dt;
                let off = detection.position[i] - *p;
                *p += (1.0 - theta * theta) * off;
                *v += (1.0 - theta).powi(2) / dt * off;
            }
        }
        self.analyse(at);
    }

    fn analyse(&mut self, now: DroneTime) {
        let (Some(first), Some(last)) = (self.record.front().copied(), self.record.back().copied()) else {
            return;
        };
        if (last.at - first.at).secs() < MIN_S || self.analysed.is_some_and(|t| (now - t).secs() < REFRESH_S)
        {
            return;
        }
        self.analysed = Some(now);
        let even = self.even();
        let wavy: [Wavy; WAVY] = core::array::from_fn(|i| {
            let record: Vec<f64> = even.iter().map(|v| v[i]).collect();
            let peaks = fourier::peaks(&record, RATE_HZ, BAND_HZ);
            let gate = peaks
                .first()
                .map_or(f64::INFINITY, |p| (GATE * p.amplitude).max(FLOOR[i]));
            let mut omega = [0.0; MODES];
            let mut modes = 0;
            for (slot, p) in omega.iter_mut().zip(peaks.iter().filter(|p| p.amplitude >= gate)) {
                *slot = core::f64::consts::TAU * p.frequency;
                modes += 1;
            }
            let mean = record.iter().sum::<f64>() / record.len().max(1) as f64;
            let mut w = Wavy::new(mean, omega, modes, [1.0, 0.3, 0.3][i]);
            let mut before = first.at;
            for s in &self.record {
                let dt = (s.at - before).secs();
                w.update(dt, s.value[i], &NOISE[i]);
                before = s.at;
            }
            w
        });
        if wavy.iter().all(|w| w.x.iter().all(|v| v.is_finite())) {
            self.wavy = Some(wavy);
        }
    }

    fn even(&self) -> Vec<[f64; WAVY]> {
        let mut out = Vec::with_capacity(KEPT);
        let (Some(first), Some(last)) = (self.record.front(), self.record.back()) else {
            return out;
        };
        let mut later = self.record.iter().peekable();
        let mut before = first;
        for k in 0..KEPT {
            let t = first.at + Span::from_secs(k as f64 / RATE_HZ);
            if t > last.at {
                break;
            }
            while let Some(next) = later.peek()
                && next.at <= t
            {
                before = next;
                later.next();
            }
            let value = match later.peek() {
                Some(next) => {
                    let s = (t - before.at).secs() / (next.at - before.at).secs().max(1e-6);
                    core::array::from_fn(|i| before.value[i] + s * (next.value[i] - before.value[i]))
                }
                None => before.value,
            };
            out.push(value);
        }
        out
    }

    /// Mean level of the deck without the waves (NED z), m.
    pub fn level(&self) -> Option<f64> {
        self.wavy.as_ref().map(|[z, ..]| z.x[0])
    }

    /// Predicted deck at `t`; None before the first detection.
    pub fn at(&self, t: DroneTime) -> Option<Predicted> {
        let wavy = self.wavy.as_ref()?;
        let place = self.place?;
        let last = self.record.back()?;
        let ahead = (t - last.at).secs();
        let [(z, vz), (roll, _), (pitch, _)] = wavy.each_ref().map(|w| w.at(ahead));
        let [[n, vn], [e, ve]] = place;
        Some(Predicted {
            position: [n + vn * ahead, e + ve * ahead, z],
            velocity: [vn, ve, vz],
            tilt_squared: roll * roll + pitch * pitch,
        })
    }
}

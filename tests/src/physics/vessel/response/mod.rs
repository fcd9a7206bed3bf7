//! Linear seakeeping from a response table, instead of [`crate::physics::vessel::Vessel`].
//!
//! Motion about the mean path (amidships at the still-water line, with the mean heading): `xi_d(t) = sum_j
//! Re(H_d(omega_j, beta_j) a_j exp(i theta_j))`, `theta_j = k_j . x_mean(t) - omega_j t + phase_j`, where `theta_j` is
//! the phase of wave component j at the mean position (St. Denis and Pierson 1953; Fossen 2011, section 8.2.5). Under
//! way the derivative of `theta_j` is minus the frequency of encounter, `omega - k U cos(beta)`, of either sign. The
//! table is for zero speed and is evaluated at the wave's own frequency, which keeps wavelength and slope correct.
//!
//! Surge and sway are relative to the mean heading; trim, roll, pitch and yaw are added as Euler angles. In this module
//! the axes are x forward, y to port, z up; the resulting state is in NED and forward, right, down.

pub mod places;
pub mod table;

use core::f64::consts::TAU;
use std::path::{Path, PathBuf};

use alight_shared::{
    config,
    frames::{Point, Rotation, Vector, VesselBody},
    time::{Span, Time, WorldTime},
};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use thiserror::Error;

use self::{
    places::Places,
    table::{DOFS, Response, ResponseAtFrequency, ResponseTable},
};
use super::{
    config::VesselConfig,
    path::{MeanPath, PathPoint},
};
use crate::physics::{
    body::{RigidState, body_motion},
    sea::{Sea, SeaComponent, sin_cos},
    spline::Jet,
    streams::Streams,
};

/// Built-in hulls: name, table, places. Computed by linear potential flow (panel method), with 6 to 12 % of
/// critical roll damping added for viscosity.
const SUPPLIED: [(&str, &str, &str); 3] = [
    (
        "twin-5m",
        include_str!("../../../../hulls/twin-5m.csv"),
        include_str!("../../../../hulls/twin-5m.toml"),
    ),
    (
        "mono-5m",
        include_str!("../../../../hulls/mono-5m.csv"),
        include_str!("../../../../hulls/mono-5m.toml"),
    ),
    (
        "work-12m",
        include_str!("../../../../hulls/work-12m.csv"),
        include_str!("../../../../hulls/work-12m.toml"),
    ),
];

pub const HULLS: [&str; 3] = [SUPPLIED[0].0, SUPPLIED[1].0, SUPPLIED[2].0];

/// Step of the numerical derivatives in a turn: the world's tick, so that two of the three poses are already known.
const TURN_STEP: Span = Span::from_millis(10);

#[derive(Debug, Error)]
pub enum HullError {
    #[error(
        "reading hull {path}: {source}; give twin-5m, mono-5m, work-12m or the path of a response table \
         (CSV), with its places in a .toml of the same name next to it"
    )]
    Read { path: PathBuf, source: std::io::Error },
    #[error("response table {origin}, line {line}: {message}")]
    Row {
        origin: String,
        /// Line of the table, from 1.
        line: usize,
        message: String,
    },
    #[error("places of a hull, {origin}: {message}")]
    Places { origin: String, message: String },
}

config! {
    /// Vessel moved by a response table; `vessel` has its course, speed and heading.
    pub struct HullConfig {
        /// Built-in hull twin-5m, mono-5m or work-12m, or the path of a response table (CSV).
        pub table: String = String::new();
        /// Pitch at rest, positive bow up, deg; overrides the hull's file.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub trim_pitch_deg: Option<f64> = None, in -20.0..=20.0;
        /// Roll at rest, positive starboard down, deg; overrides the hull's file.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub trim_roll_deg: Option<f64> = None, in -20.0..=20.0;
    }
    check |this, at| {
        at.require(
            !this.table.is_empty(),
            "table",
            "empty",
            "twin-5m, mono-5m, work-12m or the path of a response table",
        )?;
    }
}

#[derive(Clone, Debug)]
pub struct HullFiles {
    pub table: ResponseTable,
    pub places: Places,
}

impl HullFiles {
    /// Loads a built-in hull, or a table with the .toml file next to it.
    pub fn load(name: &str) -> Result<HullFiles, HullError> {
        if let Some((name, table, places)) = SUPPLIED.iter().find(|s| s.0 == name) {
            return Ok(HullFiles {
                table: ResponseTable::parse(table, name)?,
                places: Places::parse(places, name)?,
            });
        }
        let path = Path::new(name);
        let read = |path: &Path| {
            std::fs::read(path)
                .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
                .map_err(|source| HullError::Read {
                    path: path.into(),
                    source,
                })
        };
        let sidecar = path.with_extension("toml");
        Ok(HullFiles {
            table: ResponseTable::parse(&read(path)?, name)?,
            places: Places::parse(&read(&sidecar)?, &sidecar.display().to_string())?,
        })
    }
}

#[derive(Clone, Debug)]
struct Wave {
    /// Amplitude, m.
    amplitude: f64,
    omega: f64,
    k: Vector2<f64>,
    /// Phase at the origin at time zero, rad.
    phase: f64,
    /// Direction in which the wave travels, clockwise from north, rad.
    towards: f64,
    responses: ResponseAtFrequency,
}

/// Pose relative to the mean path (surge, sway, heave, roll, pitch, yaw in NED and FRD).
type Motion = [Jet; DOFS];

#[derive(Clone)]
pub struct ResponseVessel {
    waves: Vec<Wave>,
    path: MeanPath,
    /// Roll and pitch at rest, rad.
    trim: [f64; 2],
    /// Mean heading, rad, and the product of amplitude and response of each wave.
    straight: (f64, Vec<Response>),
    /// Poses during a turn, oldest first.
    turning: [(WorldTime, Motion); 3],
    state: RigidState<VesselBody>,
}

impl ResponseVessel {
    /// Vessel of `hull` at the origin at time zero; the stream `vessel/heading` draws its heading unless configured.
    pub fn new(
        hull: &HullFiles,
        config: &HullConfig,
        vessel: &VesselConfig,
        sea: &Sea,
        streams: &Streams,
    ) -> Self {
        let drawn = streams.stream("vessel/heading").random::<f64>() * TAU;
        let heading = vessel.heading_deg.map_or(drawn, f64::to_radians);
        let wave = |c: &SeaComponent| Wave {
            amplitude: c.amplitude_m,
            omega: c.frequency,
            k: c.direction * c.wave_number,
            phase: c.phase,
            towards: c.direction.y.atan2(c.direction.x),
            responses: hull.table.at_frequency(c.frequency),
        };
        let trim = &hull.places.trim;
        let mut vessel = ResponseVessel {
            waves: sea.components().iter().map(wave).collect(),
            path: MeanPath::new(vessel, heading, streams),
            trim: [
                config.trim_roll_deg.unwrap_or(trim.roll_deg).to_radians(),
                config.trim_pitch_deg.unwrap_or(trim.pitch_deg).to_radians(),
            ],
            straight: (f64::NAN, Vec::new()),
            turning: [(Time::EPOCH, Motion::default()); 3],
            state: RigidState::default(),
        };
        vessel.state = vessel.state_at(Time::EPOCH);
        vessel
    }

    pub fn step(&mut self, t: WorldTime, dt_s: f64) {
        self.state = self.state_at(t + Span::from_secs(dt_s));
    }
    pub fn ask_change(&mut self, t: WorldTime) {
        self.path.ask_change(t.secs());
    }
    pub fn state(&self) -> RigidState<VesselBody> {
        self.state
    }

    /// Product of amplitude and response of every wave at a mean heading, rad.
    fn responses(&self, heading: f64) -> impl Iterator<Item = Response> + '_ {
        self.waves.iter().map(move |w| {
            // Compass angles are clockwise, those of the table counter-clockwise.
            let r = w.responses.towards(heading - w.towards);
            Response {
                re: r.re.map(|v| w.amplitude * v),
                im: r.im.map(|v| w.amplitude * v),
            }
        })
    }

    pub fn state_at(&mut self, t: WorldTime) -> RigidState<VesselBody> {
        let s = t.secs();
        let [north, east, down, roll, pitch, yaw] = if self.path.changes(s, 2.0 * TURN_STEP.secs()) {
            let h = TURN_STEP.secs();
            let poses = [t - TURN_STEP, t, t + TURN_STEP].map(|t| {
                let known = self.turning.iter().find(|k| k.0 == t && t > Time::EPOCH);
                known.copied().unwrap_or_else(|| (t, self.turning_pose(t)))
            });
            self.turning = poses;
            let [a, b, c] = poses.map(|p| p.1);
            core::array::from_fn(|d| Jet {
                y: b[d].y,
                d: (c[d].y - a[d].y) / (2.0 * h),
                dd: (a[d].y - 2.0 * b[d].y + c[d].y) / (h * h),
            })
        } else {
            let here = self.path.at(s);
            if self.straight.0 != here.heading {
                self.straight = (here.heading, self.responses(here.heading).collect());
            }
            pose(&here, &self.motion(s, &self.straight.1))
        };
        let trimmed = |j: Jet, rest: f64| j.shifted(rest);
        let roll = trimmed(roll, self.trim[0]);
        let pitch = trimmed(pitch, self.trim[1]);
        let (rates, angular_acceleration) = body_motion(&roll, &pitch, &yaw);
        let vector = |f: fn(&Jet) -> f64| Vector3::new(f(&north), f(&east), f(&down));
        RigidState {
            position: Point::from(vector(|j| j.y)),
            velocity: Vector::from(vector(|j| j.d)),
            acceleration: Vector::from(vector(|j| j.dd)),
            attitude: Rotation::from_euler(roll.y, pitch.y, yaw.y),
            rates: Vector::from(rates),
            angular_acceleration: Vector::from(angular_acceleration),
        }
    }

    /// Pose during a turn; its derivatives are invalid.
    fn turning_pose(&self, t: WorldTime) -> Motion {
        let there = self.path.at(t.secs());
        let responses: Vec<Response> = self.responses(there.heading).collect();
        pose(&there, &self.motion(t.secs(), &responses))
    }

    /// Motion relative to the mean path at `t` (s): forward, right, down, roll, pitch, yaw; the derivatives
    /// assume a constant mean heading.
    fn motion(&self, t: f64, responses: &[Response]) -> Motion {
        let here = self.path.at(t);
        let mut y = [0.0; DOFS];
        let mut d = [0.0; DOFS];
        let mut dd = [0.0; DOFS];
        for (w, r) in self.waves.iter().zip(responses) {
            let (sin, cos) = sin_cos(w.k.dot(&here.position) - w.omega * t + w.phase);
            // Minus the frequency of encounter.
            let rate = w.k.dot(&here.velocity) - w.omega;
            for i in 0..DOFS {
                let value = r.re[i] * cos - r.im[i] * sin;
                y[i] += value;
                d[i] -= rate * (r.re[i] * sin + r.im[i] * cos);
                dd[i] -= rate * rate * value;
            }
        }
        // From (forward, port, up) to (forward, right, down).
        const FRD: [f64; DOFS] = [1.0, -1.0, -1.0, 1.0, -1.0, -1.0];
        core::array::from_fn(|i| Jet {
            y: FRD[i] * y[i],
            d: FRD[i] * d[i],
            dd: FRD[i] * dd[i],
        })
    }
}

/// North, east, down, roll, pitch, yaw, from the mean path and the motion relative to it; the derivatives
/// assume a constant mean heading.
fn pose(mean: &PathPoint, m: &Motion) -> Motion {
    let (s, c) = mean.heading.sin_cos();
    let mut out = *m;
    let sum = |a: &Jet, fa: f64, b: &Jet, fb: f64| Jet {
        y: fa * a.y + fb * b.y,
        d: fa * a.d + fb * b.d,
        dd: fa * a.dd + fb * b.dd,
    };
    out[0] = sum(&m[0], c, &m[1], -s);
    out[1] = sum(&m[0], s, &m[1], c);
    for i in 0..2 {
        out[i].y += mean.position[i];
        out[i].d += mean.velocity[i];
    }
    out[5].y += mean.heading;
    out
}

#[cfg(test)]
mod tests;

//! Offline identification of the vessel's parameters from a recording of its sensors.
//!
//! Damping and stiffness come from free decay ([`decay`]): on calm water the crew press down one side, the bow or the whole
//! vessel, tow it or turn it, and then release it, with rests in between. Free motion determines `D/M` and `G/M` but not M,
//! which needs a known force: in roll and pitch a known weight ([`incline`]). The model needs only the two ratios, so in
//! the other degrees of freedom M stays as configured, and D and G follow.
//!
//! The position of the GNSS antenna comes from any rotation of the vessel, including in waves ([`lever`]). It is
//! relative to the inertial sensor, whose own position stays as configured because the reference point is arbitrary.

pub mod decay;
pub mod incline;
pub mod lever;

use alight_shared::{
    frames::wrap_angle,
    geometry::GRAVITY,
    msg::{GnssFix, HeadingFix, ImuSample, Message},
    vessel_model::{DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY, YAW},
};
use nalgebra::{UnitQuaternion, Vector3};

use crate::{VesselNodeConfig, sensors::Readings};
pub use alight_shared::estimation::ValueWithSd;
pub use decay::{Decay, DecayOrder, DecaySignal, NotObservable};
pub use incline::{RestTilt, Stiffness, Weight};
use lever::{InertialState, Lever};

pub const DOF_NAMES: [&str; DOFS] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];
/// Maximum length of a record, samples: an hour and a half at 100 Hz.
const MAX_SAMPLES: usize = 600_000;
/// Time constant of the attitude's correction by accelerometer and heading, s; the error in 5 s waves is 0.001 rad.
const LEVELLED_S: f64 = 100.0;
/// Samples on each side for the slope of the rates, which gives the angular acceleration: 60 ms at 100 Hz.
const SLOPE: usize = 3;
/// Gap between inertial samples that ends an integrated record, s.
const GAP_S: f64 = 0.1;

pub const fn order(dof: usize) -> DecayOrder {
    match dof {
        HEAVE | ROLL | PITCH => DecayOrder::Stiff,
        _ => DecayOrder::Free,
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct VesselCalibration {
    pub seconds: f64,
    pub decays: [Result<Decay, NotObservable>; DOFS],
    pub level: RestTilt,
    /// GNSS antenna in the vessel's body frame, m; None without fixes or rotation.
    pub antenna_m: Option<[ValueWithSd; 3]>,
}

#[derive(Clone, Debug, Default)]
pub struct Record {
    imu: Vec<ImuSample>,
    gnss: Vec<GnssFix>,
    heading: Vec<HeadingFix>,
}

fn push<M: Message + Copy>(to: &mut Vec<M>, m: &M) {
    let newer = to
        .last()
        .is_none_or(|l| m.header().at.nanos() > l.header().at.nanos());
    if newer && m.check().is_ok() && to.len() < MAX_SAMPLES {
        to.push(*m);
    }
}

impl Record {
    pub fn add(&mut self, readings: &Readings) {
        for m in &readings.imu {
            push(&mut self.imu, m);
        }
        for m in &readings.gnss {
            push(&mut self.gnss, m);
        }
        for m in &readings.heading {
            push(&mut self.heading, m);
        }
    }

    pub fn identify(&self, config: &VesselNodeConfig) -> VesselCalibration {
        let states = self.states();
        let signals = self.signals(config, &states);
        let seconds = match (states.first(), states.last()) {
            (Some(a), Some(b)) => b.t_s - a.t_s,
            (_, _) => 0.0,
        };
        let mut lever = Lever::default();
        for fix in &self.gnss {
            lever.fix(fix, &states);
        }
        let imu = config.imu.lever_arm_m;
        let antenna_m = lever.identify().map(|apart| {
            core::array::from_fn(|i| ValueWithSd {
                value: imu[i] + apart[i].value,
                ..apart[i]
            })
        });
        VesselCalibration {
            seconds,
            decays: identify(&signals),
            level: self.level(),
            antenna_m,
        }
    }

    /// Roll and pitch at rest, from the accelerometer.
    fn level(&self) -> RestTilt {
        let mut signals: [DecaySignal; 2] = Default::default();
        for m in &self.imu {
            let [x, y, z] = m.accelerometer;
            for (signal, tilt) in signals.iter_mut().zip([(-y).atan2(-z), x.atan2(y.hypot(z))]) {
                signal.t_s.push(m.header.at.secs());
                signal.y.push(tilt);
            }
        }
        signals.each_ref().map(incline::level)
    }

    /// Gyroscope bias: mean roll and pitch rates afloat are zero, and the mean yaw rate is the heading's.
    fn gyro_bias(&self) -> Vector3<f64> {
        let n = self.imu.len().max(1) as f64;
        let mean = self
            .imu
            .iter()
            .map(|s| Vector3::from(s.gyro))
            .sum::<Vector3<f64>>()
            / n;
        let turned: f64 = self
            .heading
            .windows(2)
            .filter_map(|w| w.first().zip(w.last()))
            .map(|(a, b)| wrap_angle(b.heading - a.heading))
            .sum();
        let seconds = match (self.imu.first(), self.imu.last()) {
            (Some(a), Some(b)) => (b.header.at - a.header.at).secs().max(1.0),
            (_, _) => 1.0,
        };
        mean - Vector3::z() * (turned / seconds)
    }

    /// Attitude and acceleration at each inertial sample, from integrated rates with slow levelling.
    fn states(&self) -> Vec<InertialState> {
        let Some(first) = self.imu.first() else {
            return Vec::new();
        };
        // The initial roll and pitch follow from the mean of the first second.
        let count = 100.min(self.imu.len());
        let force = self
            .imu
            .iter()
            .take(count)
            .map(|s| Vector3::from(s.accelerometer));
        let force = force.sum::<Vector3<f64>>() / count as f64;
        let tilt = UnitQuaternion::from_euler_angles(
            (-force.y).atan2(-force.z),
            force.x.atan2(force.y.hypot(force.z)),
            0.0,
        );
        let yaw = self.heading.first().map_or(0.0, |h| h.heading);
        let mut attitude = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * tilt;
        let mut headings = self.heading.iter().peekable();
        let bias = self.gyro_bias();
        let mut before = first.header.at;
        let mut run = 0_u32;
        self.imu
            .iter()
            .map(|s| {
                let dt = (s.header.at - before).secs();
                before = s.header.at;
                if dt > GAP_S {
                    run += 1;
                }
                let rates = Vector3::from(s.gyro) - bias;
                let dt = dt.min(GAP_S);
                attitude *= UnitQuaternion::from_scaled_axis(rates * dt);
                let force = attitude * Vector3::from(s.accelerometer);
                // At first, use the mean of all forces so far, so that the initial attitude has no effect.
                let over_s = (s.header.at - first.header.at).secs().clamp(1.0, LEVELLED_S);
                let mut correction = force.cross(&-Vector3::z()) / GRAVITY * (dt / over_s);
                while let Some(h) = headings.next_if(|h| h.header.at <= s.header.at) {
                    let error = wrap_angle(h.heading - attitude.euler_angles().2);
                    // Headings arrive about every tenth of a second.
                    correction.z += error * (0.1 / over_s);
                }
                attitude = UnitQuaternion::from_scaled_axis(correction) * attitude;
                InertialState {
                    t_s: s.header.at.secs(),
                    run,
                    attitude,
                    rates,
                    acceleration: attitude * Vector3::from(s.accelerometer) + Vector3::z() * GRAVITY,
                }
            })
            .collect()
    }

    fn signals(&self, config: &VesselNodeConfig, states: &[InertialState]) -> [DecaySignal; DOFS] {
        let mut signals: [DecaySignal; DOFS] = Default::default();
        let mut add = |dof: usize, t_s: f64, y: f64| {
            signals[dof].t_s.push(t_s);
            signals[dof].y.push(y);
        };
        let imu = Vector3::from(config.imu.lever_arm_m);
        for (k, m) in states.iter().enumerate() {
            for (i, dof) in [ROLL, PITCH, YAW].into_iter().enumerate() {
                add(dof, m.t_s, m.rates[i]);
            }
            let before = k.checked_sub(SLOPE).and_then(|b| states.get(b));
            let (Some(before), Some(after)) = (before, states.get(k + SLOPE)) else {
                continue;
            };
            if before.run != after.run {
                continue;
            }
            // Refer to the reference point: remove the acceleration caused by rotation at the sensor's position.
            let turning = (after.rates - before.rates) / (after.t_s - before.t_s);
            let lever = turning.cross(&imu) + m.rates.cross(&m.rates.cross(&imu));
            add(HEAVE, m.t_s, (m.acceleration - m.attitude * lever).z);
        }
        let antenna = Vector3::from(config.gnss.antenna_m);
        for fix in &self.gnss {
            let Some((_, m)) = lever::at(states, fix.header.at.secs()) else {
                continue;
            };
            let body = m.attitude.inverse() * Vector3::from(fix.velocity) - m.rates.cross(&antenna);
            add(SURGE, m.t_s, body.x);
            add(SWAY, m.t_s, body.y);
        }
        signals
    }
}

pub fn identify(signals: &[DecaySignal; DOFS]) -> [Result<Decay, NotObservable>; DOFS] {
    core::array::from_fn(|dof| decay::identify(order(dof), &signals[dof]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{geodesy::Datum, msg::Header, time::Time};

    /// A vessel that rolls and pitches about its reference point in two waves while drifting north.
    fn rocked(amplitude: f64, antenna: Vector3<f64>) -> Record {
        let mut record = Record::default();
        let imu = Vector3::new(0.3, 0.1, -0.3);
        let turn = |t: f64| {
            Vector3::new(
                amplitude * (1.3 * t).sin(),
                amplitude * (1.7 * t).cos(),
                0.4 * amplitude * (0.5 * t).sin(),
            )
        };
        let attitude = |t: f64| {
            let e = turn(t);
            UnitQuaternion::from_euler_angles(e.x, e.y, e.z)
        };
        let velocity = |t: f64, arm: &Vector3<f64>| {
            let h = 1e-4;
            (attitude(t + h) * arm - attitude(t - h) * arm) / (2.0 * h)
                + Vector3::new(0.5, 0.0, 0.3 * (1.3 * t).cos())
        };
        for k in 0..12_000_usize {
            let t = 10.0 + k as f64 * 0.01;
            let h = 1e-4;
            let header = Header::new(1, 0, 1, k as u32, Time::from_secs(t));
            let rates = (attitude(t - h).inverse() * attitude(t + h)).scaled_axis() / (2.0 * h);
            let acceleration = (velocity(t + h, &imu) - velocity(t - h, &imu)) / (2.0 * h);
            let force = attitude(t).inverse() * (acceleration - Vector3::z() * GRAVITY);
            let n = |c: usize| ((k * c) as f64 * 0.754_877_666_246_693).fract() - 0.5;
            record.imu.push(ImuSample {
                header,
                gyro: (rates + Vector3::new(n(1), n(3), n(7)) * 0.03).into(),
                accelerometer: (force + Vector3::new(n(11), n(13), n(17)) * 0.07).into(),
                ..ImuSample::default()
            });
            if k % 10 == 0 {
                let white = Vector3::new(n(19), n(23), n(29)) * 0.1 * 12.0_f64.sqrt();
                record.gnss.push(GnssFix {
                    header,
                    datum: Datum::default(),
                    velocity: (velocity(t, &antenna) + white).into(),
                    position_sd: [1.0; 3],
                    velocity_sd: [0.1; 3],
                    ..GnssFix::default()
                });
                record.heading.push(HeadingFix {
                    header,
                    heading: turn(t).z,
                    heading_sd: 0.01,
                    ..HeadingFix::default()
                });
            }
        }
        record
    }

    #[test]
    fn antenna_place_in_waves() {
        // The stated error is at least 5 % of the distance of 1.6 m, hence the limit of 0.1 m.
        let antenna = Vector3::new(-0.9, 0.35, -1.3);
        let found = rocked(0.12, antenna).identify(&VesselNodeConfig::default());
        for (f, truth) in found.antenna_m.unwrap().iter().zip(antenna.iter()) {
            assert!(
                (f.value - truth).abs() < 3.0 * f.sd && f.sd < 0.1,
                "{f:?} {truth}"
            );
        }
        for (dof, decay) in found.decays.iter().enumerate() {
            assert!(
                matches!(decay, Err(NotObservable::NotPushed { .. })),
                "{dof}: {decay:?}"
            );
        }
    }

    #[test]
    fn calibration_of_a_still_vessel() {
        let found = rocked(0.0, Vector3::new(-1.1, 0.35, -1.6)).identify(&VesselNodeConfig::default());
        for figure in found.antenna_m.iter().flatten() {
            assert!(figure.sd > 0.2, "{figure:?}");
        }
        assert!(found.decays.iter().all(Result::is_err), "{found:?}");
        let none = Record::default().identify(&VesselNodeConfig::default());
        assert!(none.antenna_m.is_none() && none.decays.iter().all(Result::is_err));
    }
}

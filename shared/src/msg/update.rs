//! Radio forms of the vessel's estimate and wave model: the changing part in every message, the rest in some.
//!
//! # Byte layout on the wire
//!
//! As in [`super::vessel`], which documents the header.
//!
//! | bytes | estimate (77 B, and 161 B in every third; 30 Hz, bound 300 B) |
//! |---|---|
//! | 26..38 | `position`: north, east, down, m (3 x f32) |
//! | 38..50 | `attitude`: roll, pitch, yaw, rad (3 x f32) |
//! | 50..62 | `eta_dot`, m/s, rad/s (6 x f16) |
//! | 62..74 | `eta_ddot`, m/s², rad/s² (6 x f16) |
//! | 74..76 | checksum of the datum (u16) |
//! | 76..77 | the rest follows (1), or does not (0) |
//! | + 0..24 | datum: latitude deg, longitude deg, height m (3 x f64) |
//! | + 24..60 | per degree of freedom: sd of eta, sd of eta_dot, their correlation (6 x 3 x f16) |
//! | + 60..72 | deck centre in the body frame, m (3 x f32) |
//! | + 72..76 | mean velocity north, east, m/s (2 x f16) |
//! | + 76..84 | mean heading rad, its rate rad/s (2 x f32) |
//!
//! | bytes | wave model (63 + 4 k + 32 n + m B and 44 B with advice; k, n <= 24 modes, m <= 60 slopes; 5 Hz, bound 1200 B) |
//! |---|---|
//! | 26..30 | significant height, m (f32) |
//! | 30..34 | confidence (f32) |
//! | 34..38 | `base`: sequence number of the whole model that this one continues, or its own (u32) |
//! | 38..46 | k (u64), 0 in a whole one |
//! | + 0..4 | factor of a mode's shape: real, imaginary part (2 x f16) |
//! | then 0..8 | n (u64), 0 in one that continues |
//! | + 0..8 | pole: real and imaginary part, 1/s (2 x f32) |
//! | + 8..32 | shape per degree of freedom: real, imaginary part (6 x 2 x f16) |
//! | then 0..8 | m (u64), 0 in one that continues |
//! | + 0..1 | steepest apparent slope, newest first, 0.01 (u8) |
//! | then 0..1 | advice follows (1), or none (0) |
//! | + 0..44 | `heading`, `speed`, `likelihood`, `tilt`, each now and advised, `turn_s`, `way_lost_m`, `waves_to` (11 x f32) |

use nalgebra::Complex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Header, MAX_ACCELERATION_MPS2, MAX_ANGLE_RAD, MAX_POSITION_M, MAX_RATE_RPS, MAX_SPEED_MPS, MAX_TILT_RAD,
    Message as _, Seq, f16,
    vessel::{
        CourseAdvice, MAX_MODES, SLOPE_WINDOWS, VesselEstimate, WaveMode, WaveModel, are_modes,
        are_uncertainties,
    },
    within,
};
use crate::{
    geodesy::Datum,
    schema::F16,
    time::{Clock, Span},
    wire::hash_record,
};

/// One in `REST_EVERY` estimates carries the slowly changing part.
const REST_EVERY: u32 = 3;
/// Maximum age of the slowly changing part for an estimate: at 4.5 Hz, the lowest rate, two may be lost.
const MAX_REST_AGE: Span = Span::from_millis(2000);
/// Interval between whole wave models: a drone receives one within a second even after a loss.
const WHOLE_PERIOD: Span = Span::from_millis(500);
/// Maximum error of a continued wave model relative to the root sum square of its modes.
const MAX_CONTINUED_ERROR: f64 = 0.01;
const DOFS: usize = 6;

/// The vessel's estimate on the radio. Rounding: velocities and accelerations 0.05 %, positions 6e-8 of the
/// distance from the datum.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct EstimateUpdate<C: Clock> {
    /// Identity and time of validity.
    pub header: Header<C>,
    /// Position of the reference point in the vessel's NED, m.
    pub position: [f32; 3],
    /// Roll, pitch, yaw, rad.
    pub attitude: [f32; 3],
    /// Velocity in NED (m/s), then Euler-angle rates (rad/s).
    #[schemars(with = "[F16; 6]")]
    pub eta_dot: [f16; 6],
    /// Acceleration in NED (m/s²), then Euler-angle accelerations (rad/s²).
    #[schemars(with = "[F16; 6]")]
    pub eta_ddot: [f16; 6],
    /// Checksum of the datum; the slowly changing part completes only estimates with the same checksum.
    pub datum_sum: u16,
    /// Slowly changing part, in every third estimate; it completes the following ones of the same boot and datum.
    pub rest: Option<EstimateRest>,
}

/// Slowly changing part of the vessel's estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
pub struct EstimateRest {
    /// Origin of the vessel's NED plane.
    pub datum: Datum,
    /// Per degree of freedom: standard deviation of eta, standard deviation of eta_dot, their correlation.
    #[schemars(with = "[[F16; 3]; 6]")]
    pub uncertainty: [[f16; 3]; 6],
    /// Centre of the landing deck's surface in the vessel's body frame, m.
    pub deck_centre: [f32; 3],
    /// Mean velocity over ground without the waves' orbital motion: north, east, m/s.
    #[schemars(with = "[F16; 2]")]
    pub mean_velocity: [f16; 2],
    /// Mean heading without wave motion, rad, and its rate, rad/s.
    pub mean_heading: [f32; 2],
}

impl EstimateRest {
    /// Checksum of its datum; two datums have the same checksum with probability 1/65536.
    fn datum_sum(&self) -> u16 {
        // Serialization of three numbers cannot fail.
        hash_record(&self.datum).map_or(0, |hash| (hash >> 48) as u16)
    }
}

impl<C: Clock> EstimateUpdate<C> {
    /// Radio form with the slowly changing part when it is due.
    pub fn of(e: &VesselEstimate<C>) -> Self {
        let whole = EstimateUpdate::whole(e);
        EstimateUpdate {
            rest: whole
                .rest
                .filter(|_| e.header.sequence.is_multiple_of(REST_EVERY)),
            ..whole
        }
    }
    /// Radio form with the slowly changing part.
    pub fn whole(e: &VesselEstimate<C>) -> Self {
        let [north, east, down, roll, pitch, yaw] = e.eta.map(|x| x as f32);
        let rest = EstimateRest {
            datum: e.datum,
            uncertainty: e.uncertainty,
            deck_centre: e.deck_centre,
            mean_velocity: e.mean_velocity.map(f16::from_f32),
            mean_heading: e.mean_heading,
        };
        EstimateUpdate {
            header: e.header,
            position: [north, east, down],
            attitude: [roll, pitch, yaw],
            eta_dot: e.eta_dot.map(f16::from_f32),
            eta_ddot: e.eta_ddot,
            datum_sum: rest.datum_sum(),
            rest: Some(rest),
        }
    }
    fn completed(&self, rest: &EstimateRest) -> VesselEstimate<C> {
        let [north, east, down] = self.position;
        let [roll, pitch, yaw] = self.attitude;
        VesselEstimate {
            header: self.header,
            datum: rest.datum,
            eta: [north, east, down, roll, pitch, yaw].map(f64::from),
            eta_dot: self.eta_dot.map(f32::from),
            eta_ddot: self.eta_ddot,
            uncertainty: rest.uncertainty,
            deck_centre: rest.deck_centre,
            mean_velocity: rest.mean_velocity.map(f32::from),
            mean_heading: rest.mean_heading,
        }
    }
}

/// The vessel's wave model on the radio: whole, or factors by which the modes of the newest whole model have changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct WaveUpdate<C: Clock> {
    /// Identity and time of validity of the oscillator states.
    pub header: Header<C>,
    /// Significant wave height from the vessel's heave, m.
    pub significant_height_m: f32,
    /// Fraction of the motion's variance that the modes predict one second ahead, 0 to 1.
    pub confidence: f32,
    /// Sequence number of the whole model that this message continues, or of this message if it is whole.
    pub base: u32,
    /// Complex factors that multiply the shapes of the base's modes; empty in a whole model.
    #[schemars(with = "Seq<[F16; 2], MAX_MODES>")]
    pub factors: Seq<[f16; 2], MAX_MODES>,
    /// Modes, strongest first; empty in a continued model.
    pub modes: Seq<WaveMode, MAX_MODES>,
    /// Steepest apparent slope of the deck in each window of 2 s, newest first, in steps of 0.01, by the
    /// force in the deck's axes; empty in a continued model.
    pub slopes: Seq<u8, SLOPE_WINDOWS>,
    /// Advice for the helm; None in a continued model.
    pub advice: Option<CourseAdvice>,
}

impl<C: Clock> WaveUpdate<C> {
    /// Encodes the whole model.
    pub fn whole(m: &WaveModel<C>) -> Self {
        WaveUpdate {
            header: m.header,
            significant_height_m: m.significant_height_m,
            confidence: m.confidence,
            base: m.header.sequence,
            factors: Seq::new(),
            modes: m.modes,
            slopes: m.slopes,
            advice: m.advice,
        }
    }
    /// Form that continues `base`; None if `base` is too old or has other modes, or if one factor per mode is too
    /// inaccurate. The shapes of a mode change together, except in the vessel's own axes during a turn.
    fn continued(m: &WaveModel<C>, base: &WaveModel<C>) -> Option<Self> {
        let same = m.header.boot == base.header.boot
            && m.advice.is_some() == base.advice.is_some()
            && m.modes.len() == base.modes.len()
            && m.modes
                .iter()
                .zip(base.modes.iter())
                .all(|(a, b)| a.pole == b.pole);
        let age = m.header.at - base.header.at;
        if !same || m.modes.is_empty() || age < Span::ZERO || age >= WHOLE_PERIOD {
            return None;
        }
        Some(WaveUpdate {
            base: base.header.sequence,
            factors: factors(&base.modes, &m.modes)?,
            modes: Seq::new(),
            slopes: Seq::new(),
            advice: None,
            ..WaveUpdate::whole(m)
        })
    }
    /// Whether it is a whole model.
    pub fn is_whole(&self) -> bool {
        self.base == self.header.sequence
    }
    /// The model that continues `base`; None if it continues another model.
    fn completed(&self, base: &WaveModel<C>) -> Option<WaveModel<C>> {
        let same = self.header.boot == base.header.boot
            && self.base == base.header.sequence
            && self.factors.len() == base.modes.len();
        let modes = base.modes.iter().zip(self.factors.iter());
        same.then(|| WaveModel {
            header: self.header,
            significant_height_m: self.significant_height_m,
            confidence: self.confidence,
            modes: Seq::filled(modes.map(|(mode, factor)| WaveMode {
                shape: mode.shape.map(|c| {
                    let c = complex(c) * complex(*factor);
                    [c.re, c.im].map(f16::from_f64)
                }),
                ..*mode
            })),
            ..*base
        })
    }
}

fn complex([re, im]: [f16; 2]) -> Complex<f64> {
    Complex::new(f64::from(re), f64::from(im))
}

/// Factors of the modes from their shapes in `base` to those in `now`, fitted over the degrees of freedom,
/// each relative to its sum of all modes; None if the error exceeds [`MAX_CONTINUED_ERROR`].
fn factors(base: &[WaveMode], now: &[WaveMode]) -> Option<Seq<[f16; 2], MAX_MODES>> {
    let square = |d: usize| -> f64 { now.iter().map(|m| complex(m.shape[d]).norm_sqr()).sum() };
    let squares: [f64; DOFS] = core::array::from_fn(square);
    let factor = |(a, b): (&WaveMode, &WaveMode)| {
        let mut product = Complex::default();
        let mut own = 0.0;
        for d in (0..DOFS).filter(|d| squares[*d] > 0.0) {
            let a = complex(a.shape[d]);
            let b = complex(b.shape[d]);
            product += a.conj() * b / squares[d];
            own += a.norm_sqr() / squares[d];
        }
        let factor = if own > 0.0 { product / own } else { product };
        [factor.re, factor.im].map(f16::from_f64)
    };
    let factors = Seq::<_, MAX_MODES>::filled(base.iter().zip(now).map(factor));
    let all = || base.iter().zip(now).zip(factors.iter());
    let holds = |d: usize| {
        let off = |((a, b), f): ((&WaveMode, &WaveMode), &[f16; 2])| {
            (complex(a.shape[d]) * complex(*f) - complex(b.shape[d])).norm_sqr()
        };
        // NaN compares false.
        all().map(off).sum::<f64>() <= MAX_CONTINUED_ERROR.powi(2) * squares[d]
    };
    (0..DOFS).all(holds).then_some(factors)
}

/// Sender of wave models; stores the newest whole one.
#[derive(Clone, Debug, Default)]
pub struct WaveSender<C: Clock> {
    base: Option<WaveModel<C>>,
}

impl<C: Clock> WaveSender<C> {
    /// Radio form of this model.
    pub fn update(&mut self, m: &WaveModel<C>) -> WaveUpdate<C> {
        let continued = self.base.as_ref().and_then(|base| WaveUpdate::continued(m, base));
        continued.unwrap_or_else(|| {
            self.base = Some(*m);
            WaveUpdate::whole(m)
        })
    }
}

/// Receiver of estimates and wave models; stores their slowly changing parts.
#[derive(Clone, Debug, Default)]
pub struct UpdateReceiver<C: Clock> {
    rest: Option<(Header<C>, EstimateRest)>,
    waves: Option<WaveModel<C>>,
}

impl<C: Clock> UpdateReceiver<C> {
    /// Estimate of an admitted message; None before the first slowly changing part of its boot and datum.
    pub fn estimate(&mut self, m: &EstimateUpdate<C>) -> Option<VesselEstimate<C>> {
        if let Some(rest) = m.rest {
            self.rest = Some((m.header, rest));
        }
        let (of, rest) = self.rest.as_ref()?;
        let completes = of.boot == m.header.boot
            && m.header.at - of.at <= MAX_REST_AGE
            && rest.datum_sum() == m.datum_sum;
        completes.then(|| m.completed(rest))
    }
    /// Whether this message is whole or continues the newest received whole model.
    pub fn has_base(&self, m: &WaveUpdate<C>) -> bool {
        let base = self.waves.as_ref();
        m.is_whole() || base.is_some_and(|base| m.completed(base).is_some())
    }
    /// Wave model of an admitted message; None if it continues a model that was not received.
    pub fn waves(&mut self, m: &WaveUpdate<C>) -> Option<WaveModel<C>> {
        if m.is_whole() {
            self.waves = Some(WaveModel {
                header: m.header,
                significant_height_m: m.significant_height_m,
                confidence: m.confidence,
                modes: m.modes,
                slopes: m.slopes,
                advice: m.advice,
            });
            return self.waves;
        }
        let model = m.completed(self.waves.as_ref()?)?;
        model.check().is_ok().then_some(model)
    }
}

message!(@C EstimateUpdate<C>, C, |m| {
    within(&m.position, MAX_POSITION_M) => "position",
    within(&m.attitude[..2], MAX_TILT_RAD) && within(&m.attitude[2..], MAX_ANGLE_RAD) => "attitude",
    within(&m.eta_dot[..3], MAX_SPEED_MPS) && within(&m.eta_dot[3..], MAX_RATE_RPS) => "eta_dot",
    within(&m.eta_ddot, MAX_ACCELERATION_MPS2) => "eta_ddot",
    m.rest.is_none_or(|r| are_uncertainties(&r.uncertainty)) => "uncertainty",
    m.rest.is_none_or(|r| within(&r.deck_centre, 100.0)) => "deck_centre",
    m.rest.is_none_or(|r| within(&r.mean_velocity, MAX_SPEED_MPS) && within(&r.mean_heading, 50.0)) => "mean motion",
    m.rest.is_none_or(|r| r.datum.is_on_earth() && r.datum_sum() == m.datum_sum) => "datum",
});
message!(@C WaveUpdate<C>, C, |m| {
    (0.0..=50.0).contains(&m.significant_height_m) => "significant_height_m",
    (0.0..=1.0).contains(&m.confidence) => "confidence",
    within(m.factors.iter().flatten(), 1e5) && (m.factors.is_empty() || m.modes.is_empty()) => "factors",
    are_modes(&m.modes) => "modes",
    m.advice.is_none_or(|a| a.is_sane()) => "advice",
});

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        time::{Time, VesselClock},
        vessel_model::Mode,
        wire::{decode, encode},
    };

    fn header(sequence: u32, at_s: f64) -> Header<VesselClock> {
        Header::new(1, 0, 7, sequence, Time::from_secs(at_s))
    }
    fn on_air(update: &EstimateUpdate<VesselClock>) -> EstimateUpdate<VesselClock> {
        decode(&encode(update).unwrap()).unwrap()
    }

    proptest! {
        /// Rounding of a valid estimate stays below the estimator's errors (1 cm, 0.1 deg, 2 cm/s at 10 m/s).
        #[test]
        fn estimate_rounded_on_the_radio(
            horizontal in prop::array::uniform2(-2e4..2e4_f64), down in -50.0..50.0_f64,
            tilt in prop::array::uniform2(-1.2..1.2_f64), yaw in -3.2..3.2_f64,
            rates in prop::array::uniform6(-12.0..12.0_f32), accelerations in prop::array::uniform6(-20.0..20.0_f32),
            mean in prop::array::uniform2(-12.0..12.0_f32), deviations in prop::array::uniform3(0.0..1.0_f32),
            latitude_deg in -90.0..90.0_f64, sequence in any::<u32>(),
        ) {
            let [value, rate, correlation] = deviations.map(f16::from_f32);
            let e = VesselEstimate::<VesselClock> {
                header: header(sequence, 5.0),
                datum: Datum::new(latitude_deg, 11.0, 47.0),
                eta: [horizontal[0], horizontal[1], down, tilt[0], tilt[1], yaw],
                eta_dot: rates,
                eta_ddot: accelerations.map(f16::from_f32),
                uncertainty: [[value, rate, correlation]; 6],
                deck_centre: [-2.0, 0.0, -1.3],
                mean_velocity: mean,
                mean_heading: [0.5, 0.01],
            };
            let mut receiver = UpdateReceiver::default();
            let whole = on_air(&EstimateUpdate::whole(&e));
            prop_assert_eq!(whole.check(), Ok(()));
            let got = receiver.estimate(&whole).unwrap();
            prop_assert_eq!(got.check(), Ok(()));
            let exact = |e: &VesselEstimate<VesselClock>| {
                (e.header, e.datum, e.eta_ddot, e.uncertainty, e.deck_centre, e.mean_heading)
            };
            prop_assert_eq!(exact(&got), exact(&e));
            prop_assert_eq!(got.mean_velocity, mean.map(|v| f16::from_f32(v).to_f32()));
            for d in 0..6 {
                let off = (got.eta[d] - e.eta[d]).abs();
                prop_assert!(off <= if d < 3 { 1e-3 } else { 2e-7 }, "{}: {}", d, off);
                let off = f64::from((got.eta_dot[d] - rates[d]).abs());
                prop_assert!(off <= 4.9e-4 * f64::from(rates[d].abs()) + 1e-7, "{}: {}", d, off);
                let [variance, covariance, of_rate] = got.covariance(d);
                prop_assert!(covariance * covariance <= variance * of_rate * (1.0 + 1e-9));
            }
            // Without the slowly changing part, the earlier one gives the same estimate.
            let brief = on_air(&EstimateUpdate { rest: None, ..whole });
            prop_assert_eq!(receiver.estimate(&brief), Some(got));
        }
    }

    /// No number becomes infinite at the bounds of valid values.
    #[test]
    fn estimate_at_its_bounds() {
        let e = VesselEstimate::<VesselClock> {
            eta: [
                MAX_POSITION_M,
                -MAX_POSITION_M,
                0.0,
                MAX_TILT_RAD,
                0.0,
                MAX_ANGLE_RAD,
            ]
            .map(|x| 0.999_999 * x),
            eta_dot: [100.0, -100.0, 0.0, 50.0, 0.0, -50.0],
            eta_ddot: [f16::from_f32(200.0); 6],
            uncertainty: [[1e4, 1e4, -1.0].map(f16::from_f32); 6],
            ..VesselEstimate::default()
        };
        assert_eq!(e.check(), Ok(()));
        assert_eq!(on_air(&EstimateUpdate::whole(&e)).check(), Ok(()));
    }

    #[test]
    fn rest_of_an_estimate_that_is_lost() {
        let mut estimate = VesselEstimate::<VesselClock> {
            header: header(0, 1.0),
            datum: Datum::new(50.0, 11.0, 47.0),
            ..VesselEstimate::default()
        };
        let mut receiver = UpdateReceiver::default();
        let mut usable =
            |e: &VesselEstimate<VesselClock>| receiver.estimate(&EstimateUpdate::of(e)).is_some();
        estimate.header = header(1, 1.0);
        assert!(!usable(&estimate), "no rest received before it");
        estimate.header = header(3, 1.1);
        assert!(usable(&estimate));
        estimate.header = header(7, 3.0);
        assert!(usable(&estimate), "the sixth message with its rest is lost");
        estimate.header = header(8, 3.2);
        assert!(!usable(&estimate), "for too long");
        estimate.header = header(9, 3.3);
        assert!(usable(&estimate));
        let other = Header {
            boot: 8,
            ..header(10, 3.4)
        };
        assert!(
            !usable(&VesselEstimate {
                header: other,
                ..estimate
            }),
            "of another boot"
        );
        estimate.header = header(11, 3.5);
        estimate.datum.height_m = 47.1;
        assert!(!usable(&estimate), "of another datum");
        estimate.header = header(12, 3.5);
        assert!(usable(&estimate));
        let damaged = EstimateUpdate {
            datum_sum: 1,
            ..EstimateUpdate::whole(&estimate)
        };
        assert_eq!(damaged.check(), Err("datum"));
    }

    /// Three modes, `t` seconds after their shapes were 1, rotated by `turned` from north towards east.
    fn waves(sequence: u32, t: f64, turned: f64) -> WaveModel<VesselClock> {
        let mode = |k: u32| {
            let pole = Complex::new(-0.1 * f64::from(k + 1), 0.7 + 0.4 * f64::from(k));
            let propagated = (pole * t).exp() * f64::from(k + 1);
            let shape = core::array::from_fn(|d| Complex::new(0.3, 0.1 * d as f64) * propagated);
            WaveMode::from(&Mode { pole, shape }.turned(turned))
        };
        WaveModel {
            header: header(sequence, 10.0 + t),
            significant_height_m: 1.0,
            confidence: 0.9,
            modes: Seq::filled((0..3).map(mode)),
            slopes: Seq::filled([10; 60]),
            advice: None,
        }
    }
    /// Maximum difference between two models in any degree of freedom, relative to the modes of the second.
    fn off(a: &WaveModel<VesselClock>, b: &WaveModel<VesselClock>) -> f64 {
        let ratio = |d: usize| {
            let both = || {
                a.modes
                    .iter()
                    .zip(b.modes.iter())
                    .map(|(a, b)| (complex(a.shape[d]), complex(b.shape[d])))
            };
            let (off, all): (f64, f64) = (
                both().map(|(a, b)| (a - b).norm_sqr()).sum(),
                both().map(|(_, b)| b.norm_sqr()).sum(),
            );
            (off / all).sqrt()
        };
        (0..DOFS).map(ratio).fold(0.0, f64::max)
    }

    #[test]
    fn wave_models_that_continue() {
        let mut sender = WaveSender::default();
        let mut receiver = UpdateReceiver::default();
        let mut late = UpdateReceiver::default();
        let mut whole = Vec::new();
        let mut bytes = 0;
        for k in 0..10 {
            let sent = waves(k, 0.2 * f64::from(k), 0.0);
            let message = encode(&sender.update(&sent)).unwrap();
            bytes += message.len();
            let update: WaveUpdate<VesselClock> = decode(&message).unwrap();
            assert_eq!(update.check(), Ok(()));
            whole.extend(update.is_whole().then_some(k));
            let got = receiver.waves(&update).unwrap();
            assert!(off(&got, &sent) < 2e-3, "{k}: {}", off(&got, &sent));
            assert_eq!(
                (got.header, got.slopes, got.advice),
                (sent.header, sent.slopes, sent.advice)
            );
            // After missing a whole model, a receiver decodes every model from the next whole one on.
            let received = ![0, 6].contains(&k) && late.waves(&update).is_some();
            assert_eq!(received, (3..6).contains(&k) || k >= 9, "{k}");
        }
        assert_eq!(whole, [0, 3, 6, 9]);
        assert_eq!(bytes, 4 * (63 + 3 * 32 + 60) + 6 * (63 + 3 * 4));
    }

    #[test]
    fn wave_model_of_a_vessel_that_turns() {
        let mut sender = WaveSender::default();
        assert!(sender.update(&waves(0, 0.0, 0.0)).is_whole());
        assert!(!sender.update(&waves(1, 0.1, 0.001)).is_whole());
        assert!(sender.update(&waves(2, 0.2, 0.1)).is_whole());
        let mut restarted = waves(0, 0.3, 0.1);
        restarted.header.boot = 8;
        assert!(sender.update(&restarted).is_whole());
        restarted.modes = Seq::filled(restarted.modes.iter().copied().take(2));
        restarted.header.sequence = 1;
        assert!(sender.update(&restarted).is_whole());
    }
}

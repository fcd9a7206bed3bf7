//! Motion of the deck in waves: the vessel's modes, extrapolated, plus one short oscillator per degree of freedom for
//! the residual. Until the vessel has identified its modes, a broad set of default oscillators is used.

use core::f64::consts::FRAC_PI_2;
use std::collections::VecDeque;

use alight_shared::{
    msg::{PREDICTION_STAGES, Seq, VesselPrediction, WaveModel},
    time::{DroneClock, DroneTime},
    vessel_model::{HEAVE, Mode, Modes, PITCH, ROLL, SURGE, SWAY, YAW},
};
use nalgebra::{Complex, Rotation2, Vector3};

use super::config::PredictorConfig;

/// Degrees of freedom: north, east, down, tilt about north, about east, heading.
pub const AXES: usize = 6;
/// Tilt about north and about east.
pub const TILT: [usize; 2] = [3, 4];
const MAX_BANK: usize = 6;
/// Default oscillators and the residual one.
pub const MAX_OSCILLATORS: usize = MAX_BANK + 1;
/// Number of stored messages, so that late observations use the modes of their time.
const MAX_MESSAGES: usize = 12;
/// Frequency range of the residual oscillator, rad/s: from a long swell to the fastest deck.
const FREQUENCY_RADPS: [f64; 2] = [0.4, 7.0];
/// Minimum age of the modes at which their residual is measured, s.
const FIRST_S: f64 = 0.2;
/// Minimum damping ratio of a mode that is replaced by an oscillator.
const MIN_DAMPING: f64 = 1e-3;
/// Maximum backward extrapolation of modes, s, because damped modes increase backwards.
const MAX_BACK_S: f64 = 0.1;

/// Oscillator `x'' + 2 lambda omega x' + omega² x = w`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Oscillator {
    /// Angular frequency of encounter, rad/s.
    pub omega: f64,
    pub damping: [f64; AXES],
    /// Stationary standard deviation per axis, m, rad.
    pub sd: [f64; AXES],
}

/// Motion of the deck due to the modes, by degree of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeckMotion {
    /// Value, m, rad.
    pub value: [f64; AXES],
    /// Rate, m/s, rad/s.
    pub rate: [f64; AXES],
    /// Acceleration, m/s², rad/s².
    pub acceleration: [f64; AXES],
}

/// Modes of the deck at one time, advanced in equal steps.
#[derive(Clone, Debug, Default)]
pub struct DeckModes {
    /// Pole, and phasor of each degree of freedom.
    modes: Vec<(Complex<f64>, [Complex<f64>; AXES])>,
    step: Vec<Complex<f64>>,
}

impl DeckModes {
    /// Modes `t` seconds after their time of validity, for a deck whose centre is at `lever_arm` (m, north, east, down
    /// of a level vessel) from the vessel's reference point. A positive pitch moves the deck aft, a positive roll to
    /// starboard, and a heading change across the lever arm. `step_s` is the step of [`DeckModes::advance`]; 0: it does nothing.
    fn new(modes: &Modes<DroneClock>, t: f64, lever_arm: &Vector3<f64>, step_s: f64) -> Self {
        let deck = |m: &Mode| {
            let factor = (m.pole * t).exp();
            let c = m.shape.map(|c| c * factor);
            let path = m.integral();
            [
                c[SURGE] * path + c[PITCH] * lever_arm.z - c[YAW] * lever_arm.y,
                c[SWAY] * path - c[ROLL] * lever_arm.z + c[YAW] * lever_arm.x,
                c[HEAVE],
                c[ROLL],
                c[PITCH],
                c[YAW],
            ]
        };
        let step = |m: &Mode| (m.pole * step_s).exp();
        DeckModes {
            modes: modes.modes.iter().map(|m| (m.pole, deck(m))).collect(),
            step: if step_s == 0.0 {
                Vec::new()
            } else {
                modes.modes.iter().map(step).collect()
            },
        }
    }
    pub fn advance(&mut self) {
        for ((_, c), step) in self.modes.iter_mut().zip(&self.step) {
            for c in c {
                *c *= step;
            }
        }
    }
    pub fn motion(&self) -> DeckMotion {
        let mut out = DeckMotion::default();
        for (pole, c) in &self.modes {
            out.add(*pole, c);
        }
        out
    }
}

impl DeckMotion {
    fn add(&mut self, pole: Complex<f64>, phasors: &[Complex<f64>; AXES]) {
        let square = pole * pole;
        for (i, c) in phasors.iter().enumerate() {
            self.value[i] += c.re;
            self.rate[i] += (c * pole).re;
            self.acceleration[i] += (c * square).re;
        }
    }
}

/// Motions, as oscillators, of modes that have become too old to extrapolate.
#[derive(Clone, Debug)]
pub struct HandOver {
    /// Motion of each oscillator, that of the residual oscillator first.
    pub motions: Vec<DeckMotion>,
    /// Fraction of the motion's variance that the modes do not explain, by degree of freedom.
    pub unknown: [f64; AXES],
}

/// Measured standard deviation that prediction adds to that of the estimate, by degree of freedom: m/s for the course,
/// m, rad.
#[derive(Clone, Debug, Default)]
pub struct Spread {
    /// Values at equal steps from now on.
    pub stages: Seq<[f64; AXES], PREDICTION_STAGES>,
    /// Time between two stages, s.
    pub step_s: f64,
}

#[derive(Clone, Debug)]
pub struct Waves {
    /// Residual oscillator first, then the default ones.
    oscillators: Vec<Oscillator>,
    residual_sd: [f64; AXES],
    /// Damping ratio of the residual of heave, tilt and heading with fresh modes, and with stale modes.
    residual_damping: [f64; 2],
    messages: VecDeque<Modes<DroneClock>>,
    /// Deck's centre relative to the vessel's reference point, in the vessel's axes, m.
    lever_arm: Vector3<f64>,
    /// Lever arm of a level vessel on its heading, NED, m.
    level_arm: Vector3<f64>,
    spread: Spread,
    /// Maximum standard deviation of the residual.
    largest: [f64; AXES],
    identified: bool,
    /// Fraction of the motion's variance predicted by the modes, 0 to 1.
    pub confidence: f64,
}

impl Waves {
    pub fn new(c: &PredictorConfig) -> Self {
        let own = |omega: f64, damping: f64, sd: [f64; AXES]| Oscillator {
            omega,
            damping: [damping; AXES],
            sd,
        };
        let residual = own(c.residual_omega_radps, c.residual_damping, c.residual_sd_m_rad);
        let bank = c.bank_omega_radps.iter().take(MAX_BANK);
        let bank = bank.map(|&w| own(w, c.bank_damping, c.bank_sd_m_rad));
        Waves {
            oscillators: core::iter::once(residual).chain(bank).collect(),
            residual_sd: c.residual_sd_m_rad,
            residual_damping: [c.residual_fresh_damping, c.residual_damping],
            messages: VecDeque::with_capacity(MAX_MESSAGES + 1),
            lever_arm: c.deck.centre(),
            level_arm: Vector3::new(0.0, 0.0, c.deck.centre().z),
            spread: Spread {
                step_s: 1.0,
                ..Spread::default()
            },
            largest: [0.0; AXES],
            identified: false,
            confidence: 0.0,
        }
    }
    /// Whether the vessel has identified its motion and published the deviation of its prediction.
    pub fn are_identified(&self) -> bool {
        self.identified && !self.spread.stages.is_empty()
    }
    /// Oscillators at time `at`. The modes' residual increases with their age. Its damping is interpolated with the
    /// fraction `(left now / left then)²`, where `then` is a quarter of a wave later: small for fresh modes, whose
    /// residual fades, and 1 for stale modes, whose residual oscillates like the waves. The residual of the course
    /// (north and east) always oscillates, because velocity errors accumulate in it.
    pub fn oscillators(&self, at: DroneTime) -> Seq<Oscillator, MAX_OSCILLATORS> {
        let mut all = Seq::filled(self.oscillators.iter().copied());
        if let (Some(newest), Some(residual)) = (self.messages.back(), all.first_mut()) {
            let age = (at - newest.at).secs();
            let now = self.left(age);
            let then = self.left(age.max(FIRST_S) + FRAC_PI_2 / residual.omega);
            residual.sd = now;
            let [fresh, stale] = self.residual_damping;
            for i in 2..AXES {
                let fraction = (now[i] / then[i]).powi(2).min(1.0);
                residual.damping[i] = fresh + (stale - fresh) * fraction;
            }
        }
        all
    }
    /// Standard deviation of the newest modes' residual at `age` seconds, by degree of freedom, m, rad: the error of
    /// their prediction, limited to the difference of two independent motions with the waves' spectrum.
    fn left(&self, age: f64) -> [f64; AXES] {
        let last = self.reach_s();
        let spread = self.spread(age.max(FIRST_S));
        core::array::from_fn(|i| {
            let unit = self.unit(i);
            let further = (age / last.max(FIRST_S)).max(1.0).sqrt();
            ((spread[i] * further).min(self.largest[i]).max(spread[i]) * unit).max(self.residual_sd[i])
        })
    }

    /// Factor from velocity error to position error on the course's axes: the memory of the residual oscillator, s; 1
    /// on the other axes.
    fn unit(&self, axis: usize) -> f64 {
        match (axis, self.oscillators.first()) {
            (0 | 1, Some(o)) => 1.0 / o.omega,
            _ => 1.0,
        }
    }

    /// Standard deviation added by a prediction over `ahead` seconds, by degree of freedom: m/s, m, rad; constant after
    /// the last stage.
    fn spread(&self, ahead: f64) -> [f64; AXES] {
        let stages = &self.spread.stages;
        let x = (ahead / self.spread.step_s).clamp(0.0, stages.len().saturating_sub(1) as f64);
        let i = x.floor() as usize;
        let f = x.fract();
        let before = stages.get(i).copied().unwrap_or_default();
        let after = stages.get(i + 1).copied().unwrap_or(before);
        core::array::from_fn(|d| before[d] + f * (after[d] - before[d]))
    }

    pub fn lever_arm(&self) -> &Vector3<f64> {
        &self.lever_arm
    }
    /// `lever_arm`: deck's centre in the vessel's axes, m; `heading`: rad.
    pub fn set_lever_arm(&mut self, lever_arm: Vector3<f64>, heading: f64) {
        self.lever_arm = lever_arm;
        self.turn(heading);
    }
    pub fn turn(&mut self, heading: f64) {
        let level = Rotation2::new(heading) * self.lever_arm.xy();
        self.level_arm = Vector3::new(level.x, level.y, self.lever_arm.z);
    }

    /// Updates the deviation from the vessel's own prediction.
    pub fn receive_prediction(&mut self, p: &VesselPrediction<DroneClock>) {
        if p.stages.is_empty() {
            return;
        }
        self.set_spread(Spread {
            stages: Seq::filled(p.stages.iter().map(|s| s.sd.map(f64::from))),
            step_s: f64::from(p.step_s),
        });
    }
    pub fn set_spread(&mut self, spread: Spread) {
        self.spread = spread;
    }

    /// Adopts the vessel's wave model once its deviation is known. Returns whether it replaces the default oscillators;
    /// the filters then fold their oscillators into the first one.
    pub fn receive(&mut self, m: &WaveModel<DroneClock>) -> bool {
        self.adopt(Modes::from(m), f64::from(m.confidence))
    }
    /// Adopts modes with this confidence, identified by the vessel or by the drone.
    pub fn adopt(&mut self, modes: Modes<DroneClock>, confidence: f64) -> bool {
        self.confidence = confidence.clamp(0.0, 1.0);
        self.identified = !modes.modes.is_empty();
        if !self.are_identified() {
            return false;
        }
        let newer = self.messages.back().is_none_or(|last| modes.at > last.at);
        if !newer {
            return false;
        }
        self.messages.push_back(modes);
        while self.messages.len() > MAX_MESSAGES {
            self.messages.pop_front();
        }
        let begun = self.oscillators.len() > 1;
        self.oscillators.truncate(1);
        if let Some(newest) = self.messages.back() {
            self.largest = core::array::from_fn(|d| {
                newest
                    .modes
                    .iter()
                    .map(|m| m.shape[d].norm_sqr())
                    .sum::<f64>()
                    .sqrt()
            });
            if let (Some(residual), Some(omega)) = (self.oscillators.first_mut(), newest.frequency()) {
                residual.omega = omega.clamp(FREQUENCY_RADPS[0], FREQUENCY_RADPS[1]);
            }
        }
        begun
    }

    /// Time of validity of the newest modes; None before the first modes, and after [`Waves::hand_over`].
    pub fn newest(&self) -> Option<DroneTime> {
        self.messages.back().map(|m| m.at)
    }
    /// Horizon of the vessel's published prediction deviation, s. Modes older than this are not extrapolated.
    pub fn reach_s(&self) -> f64 {
        self.spread.step_s * self.spread.stages.len().saturating_sub(1) as f64
    }
    /// Replaces the modes at `at` by oscillators that the filters estimate. Returns the oscillators' motions, that
    /// of the residual oscillator first.
    pub fn hand_over(&mut self, at: DroneTime) -> Option<HandOver> {
        let newest = self.messages.back()?;
        let age = (at - newest.at).secs();
        let left = self.left(age);
        let largest: [f64; AXES] =
            core::array::from_fn(|i| (self.largest[i] * self.unit(i)).max(f64::MIN_POSITIVE));
        let unknown = core::array::from_fn(|i| (left[i] / largest[i]).powi(2).min(1.0));
        let mut modes = DeckModes::new(newest, 0.0, &self.level_arm, 0.0).modes;
        // The largest modes in heave and tilt get oscillators of their own.
        let weight =
            |c: &[Complex<f64>; AXES]| -> f64 { (2..5).map(|i| (c[i].norm() / largest[i]).powi(2)).sum() };
        modes.sort_by(|(_, a), (_, b)| weight(b).total_cmp(&weight(a)));
        let mut motions = vec![DeckMotion::default()];
        for (k, (pole, c)) in modes.into_iter().enumerate() {
            let factor = (pole * age).exp();
            let apart = k < MAX_BANK && pole.im.abs() >= FREQUENCY_RADPS[0];
            if apart {
                self.oscillators.push(Oscillator {
                    omega: pole.norm().min(FREQUENCY_RADPS[1]),
                    damping: [(-pole.re / pole.norm()).clamp(MIN_DAMPING, 0.95); AXES],
                    sd: c.map(|c| c.norm()),
                });
                motions.push(DeckMotion::default());
            }
            let motion = if apart {
                motions.last_mut()
            } else {
                motions.first_mut()
            };
            if let Some(motion) = motion {
                motion.add(pole, &c.map(|c| c * factor));
            }
        }
        self.messages.clear();
        Some(HandOver { motions, unknown })
    }

    /// Modes at `t`, from the message that was the newest at that time; `step_s` is the step of
    /// [`DeckModes::advance`].
    pub fn modes(&self, t: DroneTime, step_s: f64) -> DeckModes {
        let i = self.messages.partition_point(|m| m.at <= t);
        let Some(m) = self.messages.get(i.saturating_sub(1)) else {
            return DeckModes::default();
        };
        DeckModes::new(m, (t - m.at).secs().max(-MAX_BACK_S), &self.level_arm, step_s)
    }
    /// Deck motion at `to` from the modes that were newest at `from`, minus that from the newest at `to`. None if they
    /// are the same modes.
    pub fn change(&self, from: DroneTime, to: DroneTime) -> Option<DeckMotion> {
        let index = |t| self.messages.partition_point(|m| m.at <= t).saturating_sub(1);
        let before = self.messages.get(index(from))?;
        let after = self.messages.get(index(to))?;
        if before.at == after.at {
            return None;
        }
        let motion =
            |m: &Modes<DroneClock>| DeckModes::new(m, (to - m.at).secs(), &self.level_arm, 0.0).motion();
        let before = motion(before);
        let after = motion(after);
        let less = |a: [f64; AXES], b: [f64; AXES]| core::array::from_fn(|i| a[i] - b[i]);
        Some(DeckMotion {
            value: less(before.value, after.value),
            rate: less(before.rate, after.rate),
            acceleration: less(before.acceleration, after.acceleration),
        })
    }
    pub fn motion(&self, t: DroneTime) -> DeckMotion {
        self.modes(t, 0.0).motion()
    }
    /// Variance of the newest modes' prediction from `now` to a number of seconds later, by degree of freedom, in
    /// excess of that of the residual oscillator.
    pub fn variance(&self, now: DroneTime) -> impl Fn(f64) -> [f64; AXES] {
        let age = self
            .messages
            .back()
            .map(|newest| (now - newest.at).secs().max(0.0));
        let held = age.map(|age| (age, self.left(age)));
        move |ahead| {
            let Some((age, held)) = held else {
                return [0.0; AXES];
            };
            let then = self.left(age + ahead);
            core::array::from_fn(|i| (then[i] * then[i] - held[i] * held[i]).max(0.0))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    /// A vessel heads east and yaws by 0.1 rad in 5 s, so its deck 4 m aft swings north and south.
    #[test]
    fn yaw_of_a_deck_off_the_reference_point() {
        let mut waves = Waves::new(&PredictorConfig::default());
        waves.set_lever_arm(Vector3::new(-4.0, 0.0, -1.3), FRAC_PI_2);
        let mut shape = [Complex::default(); AXES];
        shape[YAW] = Complex::from(0.1);
        let modes = Modes {
            at: Time::EPOCH,
            modes: vec![Mode {
                pole: Complex::new(0.0, 1.257),
                shape,
            }],
        };
        let now = DeckModes::new(&modes, 0.0, &waves.level_arm, 0.0).motion();
        assert!((now.value[0] - 0.4).abs() < 1e-9, "north {:?}", now.value);
        assert!(
            now.value[1].abs() < 1e-9 && now.value[2].abs() < 1e-9,
            "{:?}",
            now.value
        );
        assert!((now.value[YAW] - 0.1).abs() < 1e-12);
    }
}

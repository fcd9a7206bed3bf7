//! Bound (nonlinear) waves of the estimator: the wave-following deficit of the hull, the steepening of crests, and
//! the difference of heave and tilt from the linear sum of the waves (`alight_shared::vessel_model::bound_waves`).
//!
//! A particle of the surface is accelerated down its slope: surge `-g theta`, sway `g phi`. The fraction of it that
//! the hull's own surge and sway show, relative to its tilt over a few periods, is the wave following of the hull.

use alight_shared::geometry::GRAVITY;
use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::{
    Belief, BoundMotion, DISTURBANCE, ETA, HEAVE, NU, PITCH, ROLL, WaveNonlinearity,
};

use super::Filter;
use crate::sea_state::{SeaState, Verdict};

/// Memory of the means, s: several wave periods.
const MEMORY_S: f64 = 20.0;
/// Memory of the level of the motion (trim, a sensor's bias), s.
const LEVEL_S: f64 = 10.0;
/// Time before the first output, s.
const SETTLING_S: f64 = 12.0;
/// Longest time step, s.
const MAX_PAUSE_S: f64 = 0.2;
/// Slope (rad, rms) below which wave following is not observable and taken as complete.
const MIN_SLOPE: f64 = 0.01;
/// A smaller deficit counts as none.
const CARRIED: f64 = 0.2;
/// Squared vertical acceleration relative to the square of `g` times the slope: at the first value the tilt is none
/// of waves (a rocking platform), at the second it is.
const LIFTS: [f64; 2] = [0.4, 0.7];
/// Sum of the waves' slopes at which crest steepening begins and is complete; below, it is a twentieth of the slope.
const STEEP: [f64; 2] = [0.32, 0.37];
/// Fastest change of the deficit and of the steepening, 1/s.
const MAX_CHANGE_PER_S: f64 = 0.1;

/// Degrees of freedom of a [`BoundMotion`], in its order.
const BOUND: [usize; 3] = [HEAVE, ROLL, PITCH];

/// State of the bound waves.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BoundWaves {
    /// Time of the last sample and of the first.
    observed: Option<(Time<VesselClock>, Time<VesselClock>)>,
    /// Level of roll, pitch (rad), surge, sway and heave (m/s²).
    level: [f64; 5],
    /// Means of `a g s` and of `(g s)²` about it, m²/s⁴.
    shown: f64,
    whole: f64,
    /// Mean square of the vertical acceleration about its level, m²/s⁴.
    lifted: f64,
    /// Fraction of the orbital motion that the hull does not follow.
    wave_following_deficit: f64,
    /// Crest steepening, 0 to 1, as the sea demands and as it is used.
    crest_steepening: [f64; 2],
    /// Parts of heave, roll and pitch in the belief now: eta, nu, disturbance.
    held: [[f64; 3]; 3],
}

impl BoundWaves {
    /// Fraction of the orbital motion that the hull does not follow, 0 to 1.
    pub(crate) fn wave_following_deficit(&self) -> f64 {
        self.wave_following_deficit
    }
    /// Deficit and steepening.
    pub(crate) fn nonlinearity(&self) -> WaveNonlinearity {
        let [_, crest_steepening] = self.crest_steepening;
        WaveNonlinearity {
            wave_following_deficit: self.wave_following_deficit,
            crest_steepening,
        }
    }
    /// The sea has been identified anew.
    pub(super) fn update_encounter(&mut self, sea: &SeaState) {
        let steep: f64 = sea.components.iter().map(|c| c.amplitude_tilt_rad).sum();
        let [from, to] = STEEP;
        self.crest_steepening[0] = match sea.verdict {
            Verdict::Identified => ((steep - from) / (to - from)).clamp(0.0, 1.0),
            Verdict::Calm | Verdict::Broad => 0.0,
        };
    }

    /// Takes roll and pitch (rad) with the acceleration along, across and down (m/s²), in one frame.
    pub(super) fn observe(
        &mut self,
        at: Time<VesselClock>,
        [roll, pitch]: [f64; 2],
        [ahead, right, down]: [f64; 3],
    ) {
        let now = [roll, pitch, ahead, right, down];
        if now.iter().any(|v| !v.is_finite()) {
            return;
        }
        let Some((last, first)) = self.observed else {
            (self.observed, self.level) = (Some((at, at)), now);
            return;
        };
        self.observed = Some((at, first));
        let dt = (at - last).secs().clamp(0.0, MAX_PAUSE_S);
        for (level, v) in self.level.iter_mut().zip(now) {
            *level += dt / LEVEL_S * (v - *level);
        }
        let [roll, pitch, ahead, right, down] = core::array::from_fn(|i| now[i] - self.level[i]);
        let shown = GRAVITY * (right * roll - ahead * pitch);
        let whole = GRAVITY * GRAVITY * (roll * roll + pitch * pitch);
        self.shown += dt / MEMORY_S * (shown - self.shown);
        self.whole += dt / MEMORY_S * (whole - self.whole);
        self.lifted += dt / MEMORY_S * (down * down - self.lifted);
        if (at - first).secs() > SETTLING_S {
            let prior = (GRAVITY * MIN_SLOPE).powi(2);
            let lacks = 1.0 - (self.shown + prior) / (self.whole + prior);
            // In deep water a wave lifts by as much as it slopes: `omega² A = g k A`. What rocks without it is no
            // hull in waves.
            let [none, all] = LIFTS.map(|share| share * self.whole);
            let waves = ((self.lifted - none) / (all - none).max(prior)).clamp(0.0, 1.0);
            let wanted = waves * lacks.min(2.0 * (lacks - CARRIED)).clamp(0.0, 1.0);
            let most = dt * MAX_CHANGE_PER_S;
            self.wave_following_deficit += (wanted - self.wave_following_deficit).clamp(-most, most);
            let [wanted, crest_steepening] = self.crest_steepening;
            self.crest_steepening[1] += (wanted - crest_steepening).clamp(-most, most);
        }
    }

    /// The reference heading has turned by `delta`, rad.
    pub(super) fn turn(&mut self, delta: f64) {
        let (s, c) = delta.sin_cos();
        let [_, roll, pitch] = self.held;
        self.held[1] = core::array::from_fn(|k| c * roll[k] + s * pitch[k]);
        self.held[2] = core::array::from_fn(|k| -s * roll[k] + c * pitch[k]);
    }
}

/// Adds `sign` times the bound part of heave, roll and pitch to the belief.
fn put(b: &mut Belief, held: &[[f64; 3]; 3], sign: f64) {
    for (dof, share) in BOUND.into_iter().zip(held) {
        for (slot, value) in [ETA, NU, DISTURBANCE].into_iter().zip(share) {
            if *value != 0.0 {
                let sum = b.get(dof, slot) + sign * value;
                b.set(dof, slot, sum);
            }
        }
    }
}

impl Filter {
    /// Difference of heave, roll and pitch from the linear sum of the waves, in the frame at the reference heading,
    /// `ahead` seconds from now: from the waves identified over a minute, because the filter's own waves depend on
    /// it.
    pub(super) fn bound(&self, ahead: f64) -> BoundMotion {
        let nonlinearity = self.bound_waves.nonlinearity();
        let known = self.sea.identified && !nonlinearity.is_linear();
        let Some(state) = self.sea.state.as_ref().filter(|_| known) else {
            return BoundMotion::default();
        };
        let then = (self.at - state.at).secs() + ahead;
        let b = state.bound(nonlinearity, self.encounter_velocity(state), then);
        let (s, c) = self.reference.sin_cos();
        let turned = |[heave, roll, pitch]: [f64; 3]| [heave, c * roll + s * pitch, -s * roll + c * pitch];
        BoundMotion {
            value: turned(b.value),
            rate: turned(b.rate),
            acceleration: turned(b.acceleration),
        }
    }

    /// Bound part of heave, roll and pitch now: (eta, nu, and the equilibrium that causes this motion,
    /// `(c'' + M^-1 D c' + M^-1 G c) / gain`, in the units of the disturbance).
    fn bound_part(&self) -> [[f64; 3]; 3] {
        let b = self.bound(0.0);
        core::array::from_fn(|i| {
            let row = self.model.acceleration_row(BOUND[i], BOUND[i]);
            let gain = row[DISTURBANCE];
            let wanted = b.acceleration[i] - row[NU] * b.rate[i] - row[ETA] * b.value[i];
            [
                b.value[i],
                b.rate[i],
                if gain > 0.0 { wanted / gain } else { 0.0 },
            ]
        })
    }

    /// Removes the bound part from the belief, which then is a linear sum of waves that the model propagates.
    pub(super) fn remove_bound_waves(&mut self) {
        let held = core::mem::take(&mut self.bound_waves.held);
        put(&mut self.belief, &held, -1.0);
    }

    /// Adds the present bound part to the belief.
    pub(super) fn add_bound_waves(&mut self) {
        self.bound_waves.held = self.bound_part();
        let held = self.bound_waves.held;
        put(&mut self.belief, &held, 1.0);
    }

    /// The waves were identified anew: the belief stays, its bound part changes.
    pub(super) fn reassign_bound_waves(&mut self) {
        self.bound_waves.held = self.bound_part();
    }

    /// The belief without the bound part: a linear sum of waves, which the model's horizon propagates.
    pub(super) fn without_bound_waves(&self) -> Belief {
        let mut b = self.belief.clone();
        put(&mut b, &self.bound_waves.held, -1.0);
        b
    }

    /// Mean of (eta, nu, nu_dot) per degree of freedom at stage `k`, from [`Filter::without_bound_waves`].
    pub(super) fn predicted(&self, without_bound_waves: &Belief, k: usize) -> [[f64; 3]; 6] {
        let mut out: [[f64; 3]; 6] = core::array::from_fn(|d| self.horizon.mean(without_bound_waves, d, k));
        let then = self.bound(k as f64 * self.horizon.step_s());
        for (i, dof) in BOUND.into_iter().enumerate() {
            out[dof][0] += then.value[i];
            out[dof][1] += then.rate[i];
            out[dof][2] += then.acceleration[i];
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deficit after `seconds` of three waves of which the hull follows the fraction `follows` horizontally and
    /// `lifts` vertically.
    fn found(follows: f64, lifts: f64, amplitude: f64, seconds: f64) -> f64 {
        let mut bound_waves = BoundWaves::default();
        for k in 0..(25.0 * seconds) as u32 {
            let t = 0.04 * f64::from(k);
            let (mut roll, mut pitch, mut down) = (0.02, -0.03, 0.1);
            let (mut ahead, mut right) = (0.05, 0.04);
            for (omega, direction, phase) in [(1.15, 0.3, 0.1), (1.26, 0.7, 2.0), (1.38, 1.1, 4.0_f64)] {
                let slope = omega * omega / GRAVITY * amplitude;
                let (s, c) = (omega * t + phase).sin_cos();
                let (along, across) = (slope * s * f64::cos(direction), slope * s * f64::sin(direction));
                pitch += along;
                roll -= across;
                ahead -= follows * GRAVITY * along;
                right -= follows * GRAVITY * across;
                down += lifts * GRAVITY * slope * c;
            }
            bound_waves.observe(Time::from_secs(t), [roll, pitch], [ahead, right, down]);
        }
        bound_waves.wave_following_deficit()
    }

    #[test]
    fn wave_following_deficit_is_what_the_surface_does_not_carry_along() {
        for (follows, wave_following_deficit) in [(0.0, 1.0), (0.3, 0.7), (0.5, 0.5), (0.9, 0.0), (1.0, 0.0)]
        {
            let got = found(follows, 1.0, 0.5, 60.0);
            assert!((got - wave_following_deficit).abs() < 0.05, "{follows}: {got}");
        }
        assert_eq!(found(0.0, 1.0, 0.5, 10.0), 0.0, "too early to tell");
    }

    #[test]
    fn wave_following_deficit_is_zero_in_calm_water_and_on_a_rocking_platform() {
        assert!(found(0.0, 1.0, 0.005, 60.0) < 0.05);
        assert_eq!(found(0.0, 0.2, 0.5, 60.0), 0.0);
    }

    #[test]
    fn wave_following_deficit_ignores_nan_and_stopped_clocks() {
        let mut bound_waves = BoundWaves::default();
        for k in 0..2000 {
            let t = if k % 2 == 0 { 0.0 } else { 0.01 * f64::from(k) };
            let v = [f64::NAN, 0.1, f64::INFINITY][k as usize % 3];
            bound_waves.observe(Time::from_secs(t), [v, 0.1], [v, 0.0, 0.0]);
        }
        assert!((0.0..=1.0).contains(&bound_waves.wave_following_deficit()));
    }
}

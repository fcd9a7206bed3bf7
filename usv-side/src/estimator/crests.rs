//! Whether the water's orbital motion carries the hull along, and what its heave and tilt differ by from
//! the plain sum of the waves where it does not (`alight_shared::vessel_model::bound`).
//!
//! A particle of the surface is accelerated down its slope: surge `-g theta`, sway `g phi`. The share of it
//! that the hull's own surge and sway show, over its own tilt and a few periods, is what it follows by.

use alight_shared::geometry::GRAVITY;
use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::{Belief, Bound, Crested, DISTURBANCE, ETA, HEAVE, NU, PITCH, ROLL};

use super::Filter;
use crate::sea_state::{SeaState, Verdict};

/// Memory of the share, s: several periods of waves.
const MEMORY_S: f64 = 20.0;
/// Memory of the level that motion is reckoned from (trim, a sensor's bias), s.
const LEVEL_S: f64 = 10.0;
/// Before it has watched for this long nothing is said, s.
const SETTLE_S: f64 = 12.0;
/// A longer pause counts as this, s.
const LONGEST_S: f64 = 0.2;
/// Slope (rad, rms) below which nothing tells how the hull follows, and it is taken to.
const LEAST_SLOPE: f64 = 0.01;
/// A hull that lacks less than this share of the orbital motion is taken to be carried along.
const CARRIED: f64 = 0.2;
/// Square of the vertical acceleration per that of `g` times the slope below which, and from which on, the
/// slope is one of waves.
const LIFTS: [f64; 2] = [0.4, 0.7];
/// Sum of the waves' slopes from which, and to which, what crests are steeper by is reckoned with: below it is
/// a twentieth of the slope.
const STEEP: [f64; 2] = [0.32, 0.37];
/// Fastest change of the shares that are used, per second.
const SHARE_PER_S: f64 = 0.1;

/// Degrees of freedom of a [`Bound`], in its order.
const BOUND: [usize; 3] = [HEAVE, ROLL, PITCH];

/// What the filter knows of it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Crests {
    /// Time of the last sample and of the first.
    watched: Option<(Time<VesselClock>, Time<VesselClock>)>,
    /// Level of roll, pitch (rad), surge, sway and heave (m/s²).
    level: [f64; 5],
    /// Means of `a g s` and of `(g s)²` about it, m²/s⁴.
    shown: f64,
    whole: f64,
    /// Mean square of the vertical acceleration about its level, m²/s⁴.
    lifted: f64,
    /// Share of the orbital motion that passes under the hull, as it is used.
    slip: f64,
    /// Share of the crests' own sharpness, as it is wanted and as it is used.
    sharp: [f64; 2],
    /// What heave, roll and pitch hold of it now: eta, nu, disturbance.
    held: [[f64; 3]; 3],
}

impl Crests {
    /// Share of the orbital motion that passes under the hull, 0 to 1.
    pub(crate) fn slip(&self) -> f64 {
        self.slip
    }
    /// By how much the hull's motion is more than the waves' sum.
    pub(crate) fn crested(&self) -> Crested {
        let [_, sharp] = self.sharp;
        Crested {
            slip: self.slip,
            sharp,
        }
    }
    /// The sea has been identified anew.
    pub(super) fn meet(&mut self, sea: &SeaState) {
        let steep: f64 = sea.components.iter().map(|c| c.amplitude_tilt_rad).sum();
        let [from, to] = STEEP;
        self.sharp[0] = match sea.verdict {
            Verdict::Identified => ((steep - from) / (to - from)).clamp(0.0, 1.0),
            Verdict::Calm | Verdict::Broad => 0.0,
        };
    }

    /// Roll and pitch (rad) with the acceleration along, across and down (m/s²), in one frame.
    pub(super) fn watch(
        &mut self,
        at: Time<VesselClock>,
        [roll, pitch]: [f64; 2],
        [ahead, right, down]: [f64; 3],
    ) {
        let now = [roll, pitch, ahead, right, down];
        if now.iter().any(|v| !v.is_finite()) {
            return;
        }
        let Some((last, first)) = self.watched else {
            (self.watched, self.level) = (Some((at, at)), now);
            return;
        };
        self.watched = Some((at, first));
        let dt = (at - last).secs().clamp(0.0, LONGEST_S);
        for (level, v) in self.level.iter_mut().zip(now) {
            *level += dt / LEVEL_S * (v - *level);
        }
        let [roll, pitch, ahead, right, down] = core::array::from_fn(|i| now[i] - self.level[i]);
        let shown = GRAVITY * (right * roll - ahead * pitch);
        let whole = GRAVITY * GRAVITY * (roll * roll + pitch * pitch);
        self.shown += dt / MEMORY_S * (shown - self.shown);
        self.whole += dt / MEMORY_S * (whole - self.whole);
        self.lifted += dt / MEMORY_S * (down * down - self.lifted);
        if (at - first).secs() > SETTLE_S {
            let prior = (GRAVITY * LEAST_SLOPE).powi(2);
            let lacks = 1.0 - (self.shown + prior) / (self.whole + prior);
            // In deep water a wave lifts by as much as it slopes: `omega² A = g k A`. What rocks without it is no
            // hull in waves.
            let [none, all] = LIFTS.map(|share| share * self.whole);
            let waves = ((self.lifted - none) / (all - none).max(prior)).clamp(0.0, 1.0);
            let wanted = waves * lacks.min(2.0 * (lacks - CARRIED)).clamp(0.0, 1.0);
            let most = dt * SHARE_PER_S;
            self.slip += (wanted - self.slip).clamp(-most, most);
            let [wanted, sharp] = self.sharp;
            self.sharp[1] += (wanted - sharp).clamp(-most, most);
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

/// Adds `sign` times the crests' share of the head of heave, roll and pitch.
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
    /// What heave, roll and pitch differ by from the waves' sum, in the frame at the reference heading,
    /// `ahead` seconds from now: from the waves as they were identified over a minute, for what the filter
    /// itself makes of them follows from it.
    pub(super) fn bound(&self, ahead: f64) -> Bound {
        let crested = self.crests.crested();
        let known = self.sea.identified && !crested.is_plain();
        let Some(state) = self.sea.state.as_ref().filter(|_| known) else {
            return Bound::default();
        };
        let then = (self.at - state.at).secs() + ahead;
        let b = state.bound(crested, self.encounter_velocity(state), then);
        let (s, c) = self.reference.sin_cos();
        let turned = |[heave, roll, pitch]: [f64; 3]| [heave, c * roll + s * pitch, -s * roll + c * pitch];
        Bound {
            value: turned(b.value),
            rate: turned(b.rate),
            acceleration: turned(b.acceleration),
        }
    }

    /// What of the head of heave, roll and pitch is crests now: (eta, nu, and the equilibrium that makes the
    /// hull move so, `(c'' + M^-1 D c' + M^-1 G c) / gain`, in the units of the disturbance).
    fn share(&self) -> [[f64; 3]; 3] {
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

    /// Takes it out of the belief, which then is a plain sum of waves that the model can roll on.
    pub(super) fn unbind(&mut self) {
        let held = core::mem::take(&mut self.crests.held);
        put(&mut self.belief, &held, -1.0);
    }

    /// Puts in what belongs there now.
    pub(super) fn rebind(&mut self) {
        self.crests.held = self.share();
        let held = self.crests.held;
        put(&mut self.belief, &held, 1.0);
    }

    /// The waves have been named anew: the state stays, and what of it is crests is another part.
    pub(super) fn hand_over(&mut self) {
        self.crests.held = self.share();
    }

    /// The belief without it: a plain sum of waves, which the model's horizon rolls on.
    pub(super) fn unbound(&self) -> Belief {
        let mut b = self.belief.clone();
        put(&mut b, &self.crests.held, -1.0);
        b
    }

    /// Mean of (eta, nu, nu_dot) per degree of freedom at stage `k`, from [`Filter::unbound`].
    pub(super) fn foretold(&self, unbound: &Belief, k: usize) -> [[f64; 3]; 6] {
        let mut out: [[f64; 3]; 6] = core::array::from_fn(|d| self.horizon.mean(unbound, d, k));
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

    /// Slip that is found after `seconds` of three waves whose surface accelerates the hull by this share,
    /// and that lift it by that.
    fn found(follows: f64, lifts: f64, amplitude: f64, seconds: f64) -> f64 {
        let mut crests = Crests::default();
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
            crests.watch(Time::from_secs(t), [roll, pitch], [ahead, right, down]);
        }
        crests.slip()
    }

    #[test]
    fn what_the_surface_does_not_carry_along_slips() {
        for (follows, slip) in [(0.0, 1.0), (0.3, 0.7), (0.5, 0.5), (0.9, 0.0), (1.0, 0.0)] {
            let got = found(follows, 1.0, 0.5, 60.0);
            assert!((got - slip).abs() < 0.05, "{follows}: {got}");
        }
        assert_eq!(found(0.0, 1.0, 0.5, 10.0), 0.0, "too early to tell");
    }

    #[test]
    fn neither_calm_water_nor_a_deck_that_rocks_without_heave_has_crests() {
        assert!(found(0.0, 1.0, 0.005, 60.0) < 0.05);
        assert_eq!(found(0.0, 0.2, 0.5, 60.0), 0.0);
    }

    #[test]
    fn numbers_that_are_none_and_clocks_that_stand_change_nothing() {
        let mut crests = Crests::default();
        for k in 0..2000 {
            let t = if k % 2 == 0 { 0.0 } else { 0.01 * f64::from(k) };
            let v = [f64::NAN, 0.1, f64::INFINITY][k as usize % 3];
            crests.watch(Time::from_secs(t), [v, 0.1], [v, 0.0, 0.0]);
        }
        assert!((0.0..=1.0).contains(&crests.slip()));
    }
}

//! Mixers of PX4 and ArduCopter: rotor commands for a collective thrust and moments, and what gives way when
//! rotors saturate. All are fractions of a rotor's greatest thrust.

use crate::physics::drone::{LAYOUT, ROTORS};

/// More than a rotor has that yaw may ask for before it is reduced: thrust gives way to it at the upper end.
const YAW_MARGIN: f64 = 0.15;
/// A moment that is missing by less than this is not missing.
const ROUNDING: f64 = 1e-9;

/// Whose mixer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mixer {
    /// PX4's sequential desaturation; `airmode`: MC_AIRMODE 1 (roll and pitch).
    Px4 {
        /// Roll and pitch may raise the collective.
        airmode: bool,
    },
    /// ArduCopter's matrix mixer.
    ArduCopter {
        /// The collective that hovers.
        hover: f64,
        /// Fraction between the wanted collective and hover up to which roll and pitch may raise it
        /// (ATC_THR_MIX_MIN).
        mix: f64,
    },
}

/// Rotor commands, and which of roll, pitch and yaw is not given as wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixed {
    /// For each rotor.
    pub out: [f64; ROTORS],
    /// Roll, pitch, yaw.
    pub saturated: [bool; 3],
}

/// What a rotor adds for a unit of roll, pitch and yaw.
const AXES: [[f64; ROTORS]; 3] = [
    [-LAYOUT[0][1], -LAYOUT[1][1], -LAYOUT[2][1], -LAYOUT[3][1]],
    [LAYOUT[0][0], LAYOUT[1][0], LAYOUT[2][0], LAYOUT[3][0]],
    [LAYOUT[0][2], LAYOUT[1][2], LAYOUT[2][2], LAYOUT[3][2]],
];
const LESS_THRUST: [f64; ROTORS] = [-1.0; ROTORS];

impl Mixer {
    /// Rotor commands for the collective `thrust`, and what each rotor adds for roll and pitch (`tilt`) and for yaw
    /// (`turn`).
    pub fn mix(self, thrust: f64, tilt: &[f64; ROTORS], turn: &[f64; ROTORS]) -> Mixed {
        let thrust = thrust.clamp(0.0, 1.0);
        let out = match self {
            Mixer::Px4 { airmode } => px4(thrust, tilt, turn, airmode),
            Mixer::ArduCopter { hover, mix } => {
                let raised = (1.0 - mix) * thrust + mix * hover;
                ardu_copter(thrust, thrust.max(raised).min(1.0), tilt, turn)
            }
        }
        .map(|o| o.clamp(0.0, 1.0));
        let missing = |k: usize| along(&AXES[k], &out) - along(&AXES[k], if k == 2 { turn } else { tilt });
        Mixed {
            out,
            saturated: core::array::from_fn(|k| missing(k).abs() > ROUNDING),
        }
    }
}

/// PX4's `ControlAllocationSequentialDesaturation`: thrust is never raised without air mode; roll, then pitch give
/// way, each by as much as brings rotors back into their range; then yaw.
fn px4(thrust: f64, tilt: &[f64; ROTORS], turn: &[f64; ROTORS], airmode: bool) -> [f64; ROTORS] {
    let mut out = tilt.map(|t| thrust + t);
    desaturate(&mut out, &LESS_THRUST, 1.0, !airmode);
    desaturate(&mut out, &AXES[0], 1.0, false);
    desaturate(&mut out, &AXES[1], 1.0, false);
    out.iter_mut().zip(turn).for_each(|(o, t)| *o += t);
    desaturate(&mut out, &AXES[2], 1.0 + YAW_MARGIN, false);
    desaturate(&mut out, &LESS_THRUST, 1.0, true);
    out
}

/// Moves `out` along `axis` towards the range 0 to `most`, twice, the second time by half; `forward` only, or both
/// ways.
fn desaturate(out: &mut [f64; ROTORS], axis: &[f64; ROTORS], most: f64, forward: bool) {
    let gain = |out: &[f64; ROTORS]| {
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        for (o, a) in out.iter().zip(axis) {
            let beyond = o - o.clamp(0.0, most);
            if beyond != 0.0 {
                low = low.min(-beyond / a);
                high = high.max(-beyond / a);
            }
        }
        low + high
    };
    let first = gain(out);
    if forward && first < 0.0 {
        return;
    }
    out.iter_mut().zip(axis).for_each(|(o, a)| *o += first * a);
    let second = 0.5 * gain(out);
    out.iter_mut().zip(axis).for_each(|(o, a)| *o += second * a);
}

/// ArduCopter's `AP_MotorsMatrix`: roll and pitch raise the collective up to `raised`, beyond which they are scaled
/// down together; yaw has what they leave.
fn ardu_copter(thrust: f64, raised: f64, tilt: &[f64; ROTORS], turn: &[f64; ROTORS]) -> [f64; ROTORS] {
    let base = raised.min(0.5);
    let room = |t: f64, y: f64| {
        let left = if y > 0.0 { 1.0 - base - t } else { base + t };
        if y == 0.0 { 1.0 } else { left.max(0.0) / y.abs() }
    };
    let yaw_fraction = tilt
        .iter()
        .zip(turn)
        .map(|(t, y)| room(*t, *y))
        .fold(1.0, f64::min);
    let mut rpy: [f64; ROTORS] = core::array::from_fn(|i| tilt[i] + yaw_fraction * turn[i]);
    let (low, high) = span(&rpy);
    let mut scale = 1.0 / (high - low).max(1.0);
    if raised + low < 0.0 {
        scale = scale.min(raised / -low);
    }
    rpy = rpy.map(|v| v * scale);
    let (low, high) = span(&rpy);
    let collective = if scale < 1.0 {
        -low
    } else {
        thrust.max(-low).min(1.0 - high)
    };
    rpy.map(|v| collective + v)
}

/// What the rotors give along an axis.
fn along(axis: &[f64; ROTORS], out: &[f64; ROTORS]) -> f64 {
    axis.iter().zip(out).map(|(a, o)| a * o).sum::<f64>() / ROTORS as f64
}

fn span(values: &[f64; ROTORS]) -> (f64, f64) {
    values.iter().fold((0.0, 0.0), |(low, high): (f64, f64), v| {
        (low.min(*v), high.max(*v))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PX4: Mixer = Mixer::Px4 { airmode: false };
    const AIRMODE: Mixer = Mixer::Px4 { airmode: true };
    const COPTER: Mixer = Mixer::ArduCopter {
        hover: 0.35,
        mix: 0.1,
    };

    /// Collective, roll, pitch and yaw that the rotors give.
    fn given(m: &Mixed) -> [f64; 4] {
        [&[1.0; 4], &AXES[0], &AXES[1], &AXES[2]].map(|axis| along(axis, &m.out))
    }
    fn mix(mixer: Mixer, thrust: f64, [roll, pitch, yaw]: [f64; 3]) -> Mixed {
        let tilt = core::array::from_fn(|i| AXES[0][i] * roll + AXES[1][i] * pitch);
        mixer.mix(thrust, &tilt, &AXES[2].map(|s| s * yaw))
    }
    fn near(a: [f64; 4], b: [f64; 4]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn mixers_give_what_is_wanted_while_no_rotor_saturates() {
        for mixer in [PX4, AIRMODE, COPTER] {
            let m = mix(mixer, 0.4, [0.05, -0.08, 0.1]);
            assert!(near(given(&m), [0.4, 0.05, -0.08, 0.1]), "{mixer:?}: {m:?}");
            assert_eq!(m.saturated, [false; 3]);
        }
    }

    #[test]
    fn px4_without_air_mode_loses_roll_where_pitch_saturates_at_little_thrust() {
        // Pitch alone would leave no room; roll, a quarter of it, is given up whole.
        let m = mix(PX4, 0.1, [0.05, 0.2, 0.0]);
        assert!(near(given(&m), [0.1, 0.0, 0.1, 0.0]), "{:?}", given(&m));
        assert!(m.saturated[0] && m.saturated[1]);
        let m = mix(AIRMODE, 0.1, [0.05, 0.2, 0.0]);
        assert!(near(given(&m), [0.25, 0.05, 0.2, 0.0]), "{:?}", given(&m));
        // ArduCopter scales both alike, with a little more thrust.
        let [thrust, roll, pitch, _] = given(&mix(COPTER, 0.1, [0.05, 0.2, 0.0]));
        assert!((thrust - 0.125).abs() < 1e-12 && (pitch / roll - 4.0).abs() < 1e-9);
        assert!((roll - 0.025).abs() < 1e-12, "{roll}");
    }

    #[test]
    fn mixers_give_up_thrust_for_roll_and_pitch_at_the_upper_limit_and_yaw_first() {
        for mixer in [PX4, AIRMODE, COPTER] {
            let m = mix(mixer, 1.0, [0.2, 0.0, 0.5]);
            let [thrust, roll, _, yaw] = given(&m);
            assert!(
                (roll - 0.2).abs() < 1e-9 && thrust < 0.9 && yaw < 0.4,
                "{mixer:?}: {m:?}"
            );
            assert_eq!(m.saturated, [false, false, true]);
        }
    }
}

//! Mixers of PX4 and ArduCopter: rotor commands (fractions of a rotor's maximum thrust) for a collective
//! thrust and moments, with each firmware's priorities at saturation.

use crate::physics::drone::{MAX_ROTORS, RotorFrame};

/// Maximum excess over a rotor's range that yaw may cause; at the upper end, the thrust is reduced to make room.
const YAW_MARGIN: f64 = 0.15;
const ROUNDING: f64 = 1e-9;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mixer {
    Px4 {
        /// MC_AIRMODE 1: roll and pitch may increase the collective thrust.
        airmode: bool,
    },
    ArduCopter {
        hover: f64,
        /// Upper bound of the collective thrust when roll and pitch increase it: 0 keeps the requested
        /// thrust, 1 allows the hover thrust (ATC_THR_MIX_MIN).
        mix: f64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixed {
    pub out: [f64; MAX_ROTORS],
    /// Saturation of roll, pitch, yaw.
    pub saturated: [bool; 3],
}

impl Mixer {
    /// Rotor commands for the collective `thrust` and the per-rotor changes for roll and pitch (`tilt`) and
    /// yaw (`turn`). Entries beyond the frame's rotors are zero.
    pub fn mix(
        self,
        frame: RotorFrame,
        thrust: f64,
        tilt: &[f64; MAX_ROTORS],
        turn: &[f64; MAX_ROTORS],
    ) -> Mixed {
        let thrust = thrust.clamp(0.0, 1.0);
        let axes = frame.axes();
        let count = frame.count();
        let wanted_tilt = &tilt[..count];
        let wanted_turn = &turn[..count];
        let rotors = match self {
            Mixer::Px4 { airmode } => px4(&axes, thrust, wanted_tilt, wanted_turn, airmode),
            Mixer::ArduCopter { hover, mix } => {
                let raised = (1.0 - mix) * thrust + mix * hover;
                ardu_copter(thrust, thrust.max(raised).min(1.0), wanted_tilt, wanted_turn)
            }
        };
        let mut out = [0.0; MAX_ROTORS];
        for (o, r) in out.iter_mut().zip(rotors) {
            *o = r.clamp(0.0, 1.0);
        }
        let missing = |k: usize| {
            along(frame, &axes[k], &out) - along(frame, &axes[k], if k == 2 { turn } else { tilt })
        };
        Mixed {
            out,
            saturated: core::array::from_fn(|k| missing(k).abs() > ROUNDING),
        }
    }
}

/// PX4's `ControlAllocationSequentialDesaturation`: reduces roll, pitch and yaw, in this order, until all
/// rotors are within their range. Without air mode, thrust is never increased.
fn px4(axes: &[[f64; MAX_ROTORS]; 3], thrust: f64, tilt: &[f64], turn: &[f64], airmode: bool) -> Vec<f64> {
    let [roll, pitch, yaw] = axes;
    let less_thrust = [-1.0; MAX_ROTORS];
    let mut out: Vec<f64> = tilt.iter().map(|t| thrust + t).collect();
    desaturate(&mut out, &less_thrust, 1.0, !airmode);
    desaturate(&mut out, roll, 1.0, false);
    desaturate(&mut out, pitch, 1.0, false);
    for (o, t) in out.iter_mut().zip(turn) {
        *o += t;
    }
    desaturate(&mut out, yaw, 1.0 + YAW_MARGIN, false);
    desaturate(&mut out, &less_thrust, 1.0, true);
    out
}

/// Moves `out` along `axis` into the range from 0 to `most`, in two passes, the second with half the gain; `forward`
/// forbids negative moves. Rotors that the axis does not drive (two of a hexarotor in pitch) stay saturated.
fn desaturate(out: &mut [f64], axis: &[f64; MAX_ROTORS], most: f64, forward: bool) {
    let gain = |out: &[f64]| {
        let mut low = 0.0_f64;
        let mut high = 0.0_f64;
        for (o, a) in out.iter().zip(axis) {
            let beyond = o - o.clamp(0.0, most);
            if beyond != 0.0 && *a != 0.0 {
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
    for (o, a) in out.iter_mut().zip(axis) {
        *o += first * a;
    }
    let second = 0.5 * gain(out);
    for (o, a) in out.iter_mut().zip(axis) {
        *o += second * a;
    }
}

/// ArduCopter's `AP_MotorsMatrix`: roll and pitch increase the collective thrust up to `raised`; beyond that,
/// a common factor scales both down. Yaw gets the remaining range.
fn ardu_copter(thrust: f64, raised: f64, tilt: &[f64], turn: &[f64]) -> Vec<f64> {
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
    let mut rpy: Vec<f64> = tilt.iter().zip(turn).map(|(t, y)| t + yaw_fraction * y).collect();
    let (low, high) = span(&rpy);
    let mut scale = 1.0 / (high - low).max(1.0);
    if raised + low < 0.0 {
        scale = scale.min(raised / -low);
    }
    for v in &mut rpy {
        *v *= scale;
    }
    let (low, high) = span(&rpy);
    let collective = if scale < 1.0 {
        -low
    } else {
        thrust.max(-low).min(1.0 - high)
    };
    rpy.iter().map(|v| collective + v).collect()
}

/// Control authority of the rotors about an axis.
fn along(frame: RotorFrame, axis: &[f64; MAX_ROTORS], out: &[f64; MAX_ROTORS]) -> f64 {
    axis.iter().zip(out).map(|(a, o)| a * o).sum::<f64>() / frame.count() as f64
}

fn span(values: &[f64]) -> (f64, f64) {
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

    fn given(m: &Mixed) -> [f64; 4] {
        given_of(RotorFrame::QuadX, m)
    }
    fn given_of(frame: RotorFrame, m: &Mixed) -> [f64; 4] {
        let [roll, pitch, yaw] = frame.axes();
        [&[1.0; MAX_ROTORS], &roll, &pitch, &yaw].map(|axis| along(frame, axis, &m.out))
    }
    fn mix(mixer: Mixer, thrust: f64, moments: [f64; 3]) -> Mixed {
        mix_of(RotorFrame::QuadX, mixer, thrust, moments)
    }
    fn mix_of(frame: RotorFrame, mixer: Mixer, thrust: f64, [roll, pitch, yaw]: [f64; 3]) -> Mixed {
        let axes = frame.axes();
        let tilt = core::array::from_fn(|i| axes[0][i] * roll + axes[1][i] * pitch);
        mixer.mix(frame, thrust, &tilt, &axes[2].map(|s| s * yaw))
    }
    fn near(a: [f64; 4], b: [f64; 4]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn mixers_without_saturation() {
        for (frame, mixer) in [RotorFrame::QuadX, RotorFrame::HexaX]
            .into_iter()
            .flat_map(|f| [PX4, AIRMODE, COPTER].map(|m| (f, m)))
        {
            let m = mix_of(frame, mixer, 0.4, [0.05, -0.08, 0.1]);
            assert!(
                near(given_of(frame, &m), [0.4, 0.05, -0.08, 0.1]),
                "{mixer:?}: {m:?}"
            );
            assert_eq!(m.saturated, [false; 3]);
        }
    }

    #[test]
    fn hexarotor_roll_and_pitch_before_yaw() {
        for mixer in [PX4, AIRMODE, COPTER] {
            let m = mix_of(RotorFrame::HexaX, mixer, 0.9, [0.1, 0.05, 0.5]);
            let [_, roll, pitch, yaw] = given_of(RotorFrame::HexaX, &m);
            assert!((pitch / roll - 0.5).abs() < 0.05 && yaw < 0.4, "{mixer:?}: {m:?}");
            assert!(m.out.iter().all(|o| (0.0..=1.0).contains(o)));
        }
    }

    #[test]
    fn px4_mixer_without_air_mode_at_little_thrust() {
        // Pitch alone uses the whole range, so roll, which needs a quarter of pitch's, is dropped.
        let m = mix(PX4, 0.1, [0.05, 0.2, 0.0]);
        assert!(near(given(&m), [0.1, 0.0, 0.1, 0.0]), "{:?}", given(&m));
        assert!(m.saturated[0] && m.saturated[1]);
        let m = mix(AIRMODE, 0.1, [0.05, 0.2, 0.0]);
        assert!(near(given(&m), [0.25, 0.05, 0.2, 0.0]), "{:?}", given(&m));
        // ArduCopter scales both equally, with slightly more thrust.
        let [thrust, roll, pitch, _] = given(&mix(COPTER, 0.1, [0.05, 0.2, 0.0]));
        assert!((thrust - 0.125).abs() < 1e-12 && (pitch / roll - 4.0).abs() < 1e-9);
        assert!((roll - 0.025).abs() < 1e-12, "{roll}");
    }

    #[test]
    fn mixers_at_the_upper_limit() {
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

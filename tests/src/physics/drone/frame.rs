use serde::{Deserialize, Serialize};

/// Maximum number of rotors, which is the length of per-rotor arrays; unused entries are zero.
pub const MAX_ROTORS: usize = 6;

/// Rotors with the numbering and directions of PX4's airframe reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RotorFrame {
    /// Front right, rear left, front left, rear right.
    #[default]
    QuadX,
    /// Right, left, front left, rear right, front right, rear left.
    HexaX,
}

/// Components of an arm at 30 deg to the side, in units of arm / sqrt 2.
const HALF: f64 = core::f64::consts::FRAC_1_SQRT_2;
const LONG: f64 = 1.224_744_871_391_589;
const FULL: f64 = core::f64::consts::SQRT_2;

const QUAD_X: [[f64; 3]; 4] = [
    [1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, -1.0],
];
const HEXA_X: [[f64; 3]; 6] = [
    [0.0, FULL, -1.0],
    [0.0, -FULL, 1.0],
    [LONG, -HALF, -1.0],
    [-LONG, HALF, 1.0],
    [LONG, HALF, 1.0],
    [-LONG, -HALF, -1.0],
];

impl RotorFrame {
    /// `[forward, right, yaw]` of each rotor: position in units of arm / sqrt 2, and yaw direction. A rotor
    /// that turns counter-clockwise, viewed from above, yaws the body clockwise (+yaw in FRD). The squares of
    /// each column sum to the number of rotors.
    pub fn rotors(self) -> &'static [[f64; 3]] {
        match self {
            RotorFrame::QuadX => &QUAD_X,
            RotorFrame::HexaX => &HEXA_X,
        }
    }
    pub fn count(self) -> usize {
        self.rotors().len()
    }
    /// Change of each rotor's thrust per unit of roll, pitch and yaw; lift T at (x, y) has the moment (-y T, x T).
    pub(crate) fn axes(self) -> [[f64; MAX_ROTORS]; 3] {
        let mut axes = [[0.0; MAX_ROTORS]; 3];
        for (i, [x, y, sense]) in self.rotors().iter().enumerate() {
            axes[0][i] = -y;
            axes[1][i] = *x;
            axes[2][i] = *sense;
        }
        axes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_independent_and_of_equal_length() {
        for frame in [RotorFrame::QuadX, RotorFrame::HexaX] {
            let axes = frame.axes();
            for i in 0..3 {
                assert!(axes[i].iter().sum::<f64>().abs() < 1e-12, "{frame:?} lifts");
                for j in 0..3 {
                    let dot: f64 = axes[i].iter().zip(&axes[j]).map(|(a, b)| a * b).sum();
                    let wanted = if i == j { frame.count() as f64 } else { 0.0 };
                    assert!((dot - wanted).abs() < 1e-12, "{frame:?} {i} {j}: {dot}");
                }
            }
        }
    }
}

//! Inlined sine and cosine. The sea evaluates them several hundred thousand times per simulated second, and
//! they yield the same bits on every IEEE 754 machine.

use core::f64::consts::FRAC_2_PI;

/// pi/2 in two parts (Cody and Waite 1980): the first has so few bits that its multiples are exact.
const HALF_PI_HIGH: f64 = f64::from_bits(0x3ff9_21fb_5440_0000);
const HALF_PI_LOW: f64 = 6.077_100_506_506_192e-11;
/// Adding this constant rounds to a whole number, which is then in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// (sin x, cos x) for |x| up to 1e5 rad, with an error below 1e-11, and below 1e-15 within one turn.
/// Polynomials of fdlibm (`__kernel_sin`, `__kernel_cos`; Sun Microsystems 1993).
#[inline(always)]
pub fn sin_cos(x: f64) -> (f64, f64) {
    let rounded = x * FRAC_2_PI + ROUND;
    let quarter = rounded.to_bits();
    let n = rounded - ROUND;
    let r = (x - n * HALF_PI_HIGH) - n * HALF_PI_LOW;
    let (s, c) = near_zero(r);
    // Odd quarter turns swap sine and cosine; the signs follow.
    let odd = quarter & 1 == 1;
    let (s, c) = if odd { (c, s) } else { (s, c) };
    let flip = |v: f64, sign: u64| f64::from_bits(v.to_bits() ^ (sign << 63));
    (flip(s, (quarter >> 1) & 1), flip(c, ((quarter + 1) >> 1) & 1))
}

/// (sin r, cos r), exact to the last bit for |r| <= pi/4, with an error of 1e-7 up to 1.6.
#[inline(always)]
pub fn near_zero(r: f64) -> (f64, f64) {
    let z = r * r;
    let s = r + r
        * z
        * (-1.666_666_666_666_663_2e-1
            + z * (8.333_333_333_322_49e-3
                + z * (-1.984_126_982_985_795e-4
                    + z * (2.755_731_370_707_006_8e-6
                        + z * (-2.505_076_025_340_686_3e-8 + z * 1.589_690_995_211_55e-10)))));
    let c = 1.0 - 0.5 * z
        + z * z
            * (4.166_666_666_666_66e-2
                + z * (-1.388_888_888_887_411e-3
                    + z * (2.480_158_728_947_673e-5
                        + z * (-2.755_731_435_139_066_3e-7
                            + z * (2.087_572_321_298_175e-9 - z * 1.135_964_755_778_819_5e-11)))));
    (s, c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_sin_cos_against_the_standard_library() {
        for i in -40_000..40_000 {
            let x = 0.001_7 * f64::from(i);
            let (s, c) = sin_cos(x);
            assert!((s - x.sin()).abs() < 1e-14 && (c - x.cos()).abs() < 1e-14, "{x}");
            let far = 2.3 * f64::from(i);
            let (s, c) = sin_cos(far);
            assert!(
                (s - far.sin()).abs() < 1e-11 && (c - far.cos()).abs() < 1e-11,
                "{far}"
            );
        }
        for i in -160..=160 {
            let x = 0.01 * f64::from(i);
            let (s, c) = near_zero(x);
            assert!((s - x.sin()).abs() < 1e-7 && (c - x.cos()).abs() < 1e-7, "{x}");
        }
    }
}

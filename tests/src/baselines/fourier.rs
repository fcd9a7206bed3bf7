//! Frequencies of a short record: Hann window, radix-2 Fourier transform, peaks.

use core::f64::consts::TAU;

/// Number of points of the transform; shorter records are zero-padded.
pub(super) const POINTS: usize = 1024;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Peak {
    pub frequency: f64,
    /// Amplitude in the record's unit.
    pub amplitude: f64,
}

/// Spectral lines of `record` (`rate` samples per second) between two frequencies, strongest first. A line is a local
/// maximum, located between bins by a parabola through the logarithms of three bins. Uses at most [`POINTS`] samples.
pub(super) fn peaks(record: &[f64], rate: f64, [low, high]: [f64; 2]) -> Vec<Peak> {
    let n = record.len().min(POINTS);
    if n < 8 {
        return Vec::new();
    }
    let mean = record.iter().take(n).sum::<f64>() / n as f64;
    let mut z = vec![[0.0; 2]; POINTS];
    let mut gain = 0.0;
    for (i, (slot, x)) in z.iter_mut().zip(record).enumerate() {
        let w = 0.5 - 0.5 * (TAU * i as f64 / (n - 1) as f64).cos();
        gain += w;
        slot[0] = w * (x - mean);
    }
    transform(&mut z);
    let bin = rate / POINTS as f64;
    let size: Vec<f64> = z
        .iter()
        .take(POINTS / 2)
        .map(|[re, im]| 2.0 * re.hypot(*im) / gain + 1e-12)
        .collect();
    let mut found: Vec<Peak> = size
        .windows(3)
        .enumerate()
        .filter_map(|(i, w)| {
            let &[a, b, c] = w else { return None };
            let centre = (i + 1) as f64 * bin;
            if !(b > a && b >= c && (low..=high).contains(&centre)) {
                return None;
            }
            let la = a.ln();
            let lb = b.ln();
            let lc = c.ln();
            let bend = la - 2.0 * lb + lc;
            let shift = if bend < -1e-9 { 0.5 * (la - lc) / bend } else { 0.0 };
            Some(Peak {
                frequency: centre + shift.clamp(-0.5, 0.5) * bin,
                amplitude: b,
            })
        })
        .collect();
    found.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    found
}

/// In-place transform; the length must be a power of two (Cooley and Tukey 1965).
fn transform(z: &mut [[f64; 2]]) {
    let n = z.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            z.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let (ws, wc) = (-TAU / length as f64).sin_cos();
        for block in z.chunks_exact_mut(length) {
            let (head, tail) = block.split_at_mut(length / 2);
            let mut w = [1.0, 0.0];
            for (a, b) in head.iter_mut().zip(tail) {
                let t = [b[0] * w[0] - b[1] * w[1], b[0] * w[1] + b[1] * w[0]];
                *b = [a[0] - t[0], a[1] - t[1]];
                *a = [a[0] + t[0], a[1] + t[1]];
                w = [w[0] * wc - w[1] * ws, w[0] * ws + w[1] * wc];
            }
        }
        length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spectrum_of_two_sines() {
        let rate = 30.0;
        let record: Vec<f64> = (0..600)
            .map(|i| f64::from(i) / rate)
            .map(|t| 3.0 + 0.5 * (TAU * 0.2 * t + 0.3).sin() + 0.2 * (TAU * 0.37 * t).cos())
            .collect();
        let p = peaks(&record, rate, [0.05, 1.0]);
        assert!(
            (p[0].frequency - 0.2).abs() < 0.004 && (p[0].amplitude - 0.5).abs() < 0.04,
            "{p:?}"
        );
        assert!(
            (p[1].frequency - 0.37).abs() < 0.004 && (p[1].amplitude - 0.2).abs() < 0.03,
            "{p:?}"
        );
        assert!(p.get(2).is_none_or(|q| q.amplitude < 0.02), "{p:?}");
        assert!(peaks(&record[..4], rate, [0.05, 1.0]).is_empty());
        assert!(peaks(&[f64::NAN; 64], rate, [0.05, 1.0]).is_empty());
    }
}

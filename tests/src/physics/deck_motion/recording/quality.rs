//! Quality of a recording's channels (resolution, noise, held values, clipped peaks), and smoothing to the
//! bandwidth that this quality permits.
//!
//! Differentiating twice turns an error `e` of a sample at the interval `dt` into `e / dt²`: heave in steps of 1 cm at
//! 100 Hz yields tens of m/s² of spurious acceleration. The smoother fits a cubic to the samples within half a window
//! on either side (Savitzky and Golay 1964, for any spacing); its bandwidth is 1.25 divided by the window (Schafer
//! 2011, order 3). The window is the shortest that keeps [`ACCELERATION_LIMIT`].

use alight_shared::estimation::median;

use super::{CHANNELS, HEADING, PITCH, QUANTITIES, ROLL};

/// Maximum error of the second derivative after smoothing, m/s² or rad/s².
const ACCELERATION_LIMIT: f64 = 0.5;
/// Product of a window's bandwidth and length, Hz s.
const BANDWIDTH: f64 = 1.25;
const MAX_WINDOW_S: f64 = 1.5;
/// Ratio of the levels of successive orders of differences above which the noise counts as white. Sampled motion has a
/// ratio of 0.5 or less.
const WHITE: f64 = 0.85;

pub(super) struct Knots<'a> {
    pub(super) t: &'a [f64],
    pub(super) y: &'a mut [[f64; CHANNELS]],
    /// Typical time between rows, s.
    pub(super) step: f64,
    /// Maximum time between rows, s; a longer interval is a gap.
    pub(super) longest: f64,
}

pub(super) fn smooth(mut knots: Knots<'_>, has: &[bool; CHANNELS]) -> Vec<String> {
    let channels = (0..CHANNELS).filter(|c| has[*c]);
    channels.filter_map(|c| smooth_channel(&mut knots, c)).collect()
}

fn smooth_channel(knots: &mut Knots<'_>, c: usize) -> Option<String> {
    let values: Vec<f64> = knots.y.iter().map(|row| row[c]).collect();
    let (factor, unit) = match c {
        ROLL | PITCH | HEADING => (1_f64.to_degrees(), "deg"),
        _ => (1.0, "m"),
    };
    let steps = Steps::of(&values);
    let mut notes = Vec::new();
    let (clipped, places, limits) = unclipped(knots, &values, steps.size);
    if places > 0 {
        let limits: Vec<String> = limits.iter().map(|l| format!("{:.3}", l * factor)).collect();
        notes.push(format!(
            "clipped at {} {unit} in {places} places; peaks are extrapolated from their flanks",
            limits.join(" and ")
        ));
    }
    let mut window = 0.0_f64;
    let held = steps.changed < 0.4 && steps.typical > 2.5 * steps.size;
    if held {
        let every = knots.step / steps.changed.max(1e-6);
        window = 5.0 * every;
        notes.push(format!("values held for {every:.2} s"));
    } else if steps.size > 0.0
        && needed(steps.size / 12_f64.sqrt(), knots.step, steps.size) > 3.0 * knots.step
    {
        window = needed(steps.size / 12_f64.sqrt(), knots.step, steps.size);
        notes.push(format!("steps of {:.3} {unit}", steps.size * factor));
    }
    if let Some(noise) = white_noise(&clipped)
        && needed(noise, knots.step, 0.0) > window.max(3.0 * knots.step)
    {
        window = needed(noise, knots.step, 0.0);
        notes.push(format!("noise of {:.3} {unit}", noise * factor));
    }
    if notes.is_empty() {
        return None;
    }
    let mut text = format!("{}: {}", QUANTITIES[c].name(), notes.join(", "));
    let smoothed = if window > 0.0 {
        let window = window.min(MAX_WINDOW_S).max(5.0 * knots.step);
        text += &format!("; smoothed to {:.1} Hz", BANDWIDTH / window);
        fitted(knots, &clipped, window)
    } else {
        clipped
    };
    for (row, v) in knots.y.iter_mut().zip(smoothed) {
        row[c] = v;
    }
    Some(text)
}

/// Shortest window that keeps the limit of the second derivative's error, s. White noise `sd` at the interval
/// `dt` causes an error of `sd sqrt(720 dt / W^5)`; resolution steps of `size`, whose errors persist, cause
/// at most `12 size / W²`.
fn needed(sd: f64, dt: f64, size: f64) -> f64 {
    let white = (720.0 * dt * (sd / ACCELERATION_LIMIT).powi(2)).powf(0.2);
    white.max((12.0 * size / ACCELERATION_LIMIT).sqrt())
}

struct Steps {
    /// Common divisor of all changes; 0 without one.
    size: f64,
    /// Median change; 0 without changes.
    typical: f64,
    /// Fraction of rows that differ from the previous row.
    changed: f64,
}

impl Steps {
    fn of(values: &[f64]) -> Steps {
        let mut changes: Vec<f64> = values
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .filter(|d| *d > 1e-9)
            .collect();
        changes.sort_unstable_by(f64::total_cmp);
        let (Some(smallest), n) = (changes.first().copied(), changes.len()) else {
            return Steps {
                size: 0.0,
                typical: 0.0,
                changed: 0.0,
            };
        };
        let multiple = |d: &&f64| {
            let k = **d / smallest;
            (k - k.round()).abs() < 0.02 * k.clamp(1.0, 10.0)
        };
        let on_grid = changes.iter().filter(multiple).count();
        Steps {
            size: if on_grid as f64 > 0.98 * n as f64 {
                smallest
            } else {
                0.0
            },
            typical: changes[n / 2],
            changed: n as f64 / values.len().max(1) as f64,
        }
    }
}

/// Standard deviation of white noise superimposed on slow motion, from `sd(D^k) = sigma sqrt(binomial(2k,
/// k))`; None if the motion dominates the differences.
fn white_noise(values: &[f64]) -> Option<f64> {
    let mut differences = values.to_vec();
    let mut levels = Vec::new();
    for (order, norm) in [1.0, 2.0, 6.0, 20.0, 70.0, 252.0_f64].into_iter().enumerate() {
        if order > 0 {
            differences = differences.windows(2).map(|w| w[1] - w[0]).collect();
        }
        // The median ignores gaps and bumps.
        let size = median(differences.iter().map(|d| d.abs()))?;
        levels.push(size / 0.6745 / norm.sqrt());
    }
    let [.., a, b, c] = levels[..] else { return None };
    (a > 0.0 && b > WHITE * a && c > WHITE * b).then_some(c)
}

/// Values with extrapolated peaks, number of clipped places, and clipping limits.
fn unclipped(knots: &Knots<'_>, values: &[f64], step: f64) -> (Vec<f64>, usize, Vec<f64>) {
    let mut out = values.to_vec();
    let mut places = 0;
    let mut limits = Vec::new();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let range = high - low;
    for limit in [low, high] {
        let runs = runs(values, limit);
        let mut here = 0;
        for (first, last) in runs {
            // Flank slopes span at least two rows and 0.1 s.
            let reach = ((0.1 / knots.step).ceil() as usize).max(2);
            let (Some(before), after) = (first.checked_sub(reach), last + reach) else {
                continue;
            };
            if last - first < 2 || after >= values.len() {
                continue;
            }
            let time = |i: usize| knots.t[i];
            let duration = time(last) - time(first);
            if time(after) - time(before) > duration + 2.0 * reach as f64 * knots.longest {
                continue;
            }
            let up = (values[first] - values[before]) / (time(first) - time(before));
            let down = (values[after] - values[last]) / (time(after) - time(last));
            let rise = (up - down).abs() * duration / 8.0;
            if up * down >= 0.0 || rise < (4.0 * step).max(0.02 * range) {
                continue;
            }
            here += 1;
            let rise_limit = (0.5 * range / rise.max(1e-12)).min(1.0);
            for i in first + 1..last {
                let s = (time(i) - time(first)) / duration;
                let bump = (s - 2.0 * s * s + s * s * s) * up + (s * s * s - s * s) * down;
                out[i] = values[i] + rise_limit * duration * bump;
            }
        }
        if here > 0 {
            places += here;
            limits.push(limit);
        }
    }
    (out, places, limits)
}

/// First and last row of each stretch of three or more rows at `limit`.
fn runs(values: &[f64], limit: f64) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut begin = None;
    for (i, v) in values.iter().enumerate() {
        match (begin, (v - limit).abs() < 1e-9) {
            (None, true) => begin = Some(i),
            (Some(first), false) => {
                runs.push((first, i - 1));
                begin = None;
            }
            (Some(_), true) | (None, false) => {}
        }
    }
    runs
}

/// Cubic fits around each row within half a `window`, weighted by `1 - u²`; fits do not cross gaps.
fn fitted(knots: &Knots<'_>, values: &[f64], window: f64) -> Vec<f64> {
    let t = knots.t;
    let half = 0.6 * window;
    let mut from = 0;
    (0..values.len())
        .map(|i| {
            while t[i] - t[from] > half {
                from += 1;
            }
            let mut normal = nalgebra::Matrix4::<f64>::zeros();
            let mut right = nalgebra::Vector4::<f64>::zeros();
            for j in from..values.len() {
                let u = (t[j] - t[i]) / half;
                if u > 1.0 {
                    break;
                }
                let weight = 1.0 - 0.99 * u * u;
                let row = nalgebra::Vector4::new(1.0, u, u * u, u * u * u);
                normal += row * row.transpose() * weight;
                right += row * (weight * (values[j] - values[i]));
            }
            // A row is not smoothed if the window has fewer than four samples, as next to a gap.
            let fit = normal.cholesky().map_or(0.0, |l| l.solve(&right)[0]);
            values[i] + fit
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::physics::{
        deck_motion::recording::{HEAVE, Recording},
        streams::Streams,
    };

    fn heave(hz: f64, seconds: f64, mut f: impl FnMut(f64) -> f64) -> Recording {
        let mut text = String::from("t_s,roll_deg,pitch_deg,heave_m\n");
        for k in 0..(hz * seconds) as u32 {
            let t = f64::from(k) / hz;
            text += &format!(
                "{t:.4},{:.5},{:.5},{:.5}\n",
                (0.9 * t).sin(),
                (0.7 * t).cos(),
                f(t)
            );
        }
        Recording::parse(text.as_bytes(), "test.csv").unwrap()
    }
    fn swell(t: f64) -> f64 {
        0.7 * (1.05 * t).sin() + 0.3 * (1.7 * t + 1.0).sin()
    }
    /// Maximum error of the heave, and of its slope over three rows, relative to the swell.
    fn errors(r: &Recording) -> [f64; 2] {
        let mut worst = [0.0_f64; 2];
        for k in 200..r.t.len() - 200 {
            worst[0] = worst[0].max((r.y[k][HEAVE] - swell(r.t[k])).abs());
            let slope = |f: &dyn Fn(usize) -> f64| (f(k + 1) - f(k - 1)) / (r.t[k + 1] - r.t[k - 1]);
            let slope_error = slope(&|k| r.y[k][HEAVE]) - slope(&|k| swell(r.t[k]));
            worst[1] = worst[1].max(slope_error.abs());
        }
        worst
    }

    #[test]
    fn recording_heave_in_centimetre_steps() {
        let r = heave(100.0, 60.0, |t| (swell(t) * 100.0).round() / 100.0);
        assert_eq!(r.remarks.len(), 1, "{:?}", r.remarks);
        assert!(
            r.remarks[0].contains("heave_m: steps of 0.010 m") && r.remarks[0].contains("Hz"),
            "{:?}",
            r.remarks
        );
        let [e, v] = errors(&r);
        // The errors without smoothing are 5 mm and 0.5 m/s.
        assert!(e < 0.005 && v < 0.05, "{e} {v}");
    }

    #[test]
    fn clean_recordings() {
        for hz in [5.0, 10.0, 25.0, 100.0] {
            let r = heave(hz, 60.0, swell);
            assert!(r.remarks.is_empty(), "{hz}: {:?}", r.remarks);
            assert!(
                r.y.iter()
                    .zip(&r.t)
                    .all(|(y, t)| (y[HEAVE] - swell(*t)).abs() < 1e-5)
            );
        }
        // A resolution of 1 mm at 10 Hz is harmless.
        let r = heave(10.0, 60.0, |t| (swell(t) * 1e3).round() / 1e3);
        assert!(r.remarks.is_empty(), "{:?}", r.remarks);
    }

    #[test]
    fn recording_noise() {
        let mut noise = crate::sensors::noise::Noise::new(&Streams::new(1), "test");
        let r = heave(50.0, 60.0, |t| swell(t) + 0.02 * noise.normal());
        assert!(
            r.remarks.len() == 1 && r.remarks[0].contains("noise of 0.0"),
            "{:?}",
            r.remarks
        );
        let [e, v] = errors(&r);
        assert!(e < 0.04 && v < 0.25, "{e} {v}");
    }

    #[test]
    fn recording_held_values() {
        let r = heave(100.0, 60.0, |t| swell((t * 10.0 + 1e-6).floor() / 10.0));
        assert!(
            r.remarks.len() == 1 && r.remarks[0].contains("held for 0.10 s"),
            "{:?}",
            r.remarks
        );
        assert!(errors(&r)[1] < 0.3, "{:?}", errors(&r));
    }

    #[test]
    fn recording_clipped_peaks() {
        let r = heave(25.0, 60.0, |t| swell(t).clamp(-0.6, 0.6));
        assert!(
            r.remarks.len() == 1 && r.remarks[0].contains("clipped at -0.600 and 0.600 m"),
            "{:?}",
            r.remarks
        );
        let top = r.y.iter().map(|y| y[HEAVE]).fold(0.0, f64::max);
        assert!((0.75..1.2).contains(&top), "{top}");
    }
}

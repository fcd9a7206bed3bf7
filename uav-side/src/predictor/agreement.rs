//! Agreement between the deck's heights by rangefinder and by camera, and between its positions by camera and by radio.
//! A disagreement reveals a fault: images with late time stamps show a heaving deck at a past height; the tags of a
//! neighbouring deck have the right ids at the wrong position.

use alight_shared::{estimation::low_pass, time::DroneTime};

use super::axis::AxisNoise;

/// Averaging time of the rangefinder's disagreement, s: half the period of a swell.
const MEMORY_S: f64 = 3.0;
/// Maximum weight of one reading, as a time, s: a single echo from the water after a gap is no evidence.
const READING_S: f64 = 0.2;
/// Decay time of a contradiction, s: longer than a lull between two wave groups.
const RELEASE_S: f64 = 30.0;
/// Upper limit of one squared innovation, in variances: a gull below the drone is not a contradiction.
const MAX_SQUARE: f64 = 100.0;
/// Maximum distance between the positions by vision and by radio, in standard deviations of their slow errors. With a
/// Rayleigh distribution one valid landing in 3000 is rejected.
pub(super) const PLACE_SD: f64 = 4.0;

/// Compares the rangefinder's height with the height known without it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeightAgreement {
    newest: Option<Averaged>,
}

#[derive(Clone, Copy, Debug)]
struct Averaged {
    at: DroneTime,
    /// Mean of the normalised innovation squared.
    mean: f64,
    /// Decaying maximum of the mean, so that a faulty source stays rejected.
    peak: f64,
}

impl HeightAgreement {
    /// Adds a reading with this innovation, in standard deviations.
    pub(super) fn take(&mut self, at: DroneTime, innovation_sd: f64) {
        let squared = innovation_sd.powi(2).min(MAX_SQUARE);
        let since = |then: DroneTime| (at - then).secs().max(0.0);
        let (mean, peak, dt) = self.newest.map_or((1.0, 1.0, 0.0), |n| {
            let dt = since(n.at);
            (if dt <= MEMORY_S { n.mean } else { 1.0 }, n.peak, dt)
        });
        let mean = low_pass(mean, squared, dt.min(READING_S), MEMORY_S);
        let peak = mean.max(peak * (-dt / RELEASE_S).exp());
        self.newest = Some(Averaged { at, mean, peak });
    }
    /// Recent maximum of the mean; 1 if errors are as stated. None without readings or a remembered contradiction.
    pub(super) fn value(&self, now: DroneTime) -> Option<f64> {
        let n = self.newest?;
        let since = (now - n.at).secs().max(0.0);
        let peak = n.peak * (-since / RELEASE_S).exp();
        (since <= MEMORY_S || peak > 1.0).then_some(peak)
    }
}

/// Horizontal distance between the positions by vision and by radio, and its limit, m. `offset` is vision minus radio,
/// north and east; `taken` is the part of it caused by jumps of the autopilot's estimate since the first detection;
/// `more` is an additional variance, m².
pub(super) fn place(offset: [f64; 2], more: f64, noise: &[AxisNoise], taken: [f64; 2]) -> [f64; 2] {
    let [north, east] = [0, 1].map(|i| offset[i] - taken[i]);
    let spread = noise
        .iter()
        .take(2)
        .map(|n| n.radio.0.hypot(n.vision.0))
        .fold(0.0, f64::max);
    [north.hypot(east), PLACE_SD * spread.hypot(more.max(0.0).sqrt())]
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    fn after(seconds: f64, innovation_sd: impl Fn(f64) -> f64) -> HeightAgreement {
        let mut a = HeightAgreement::default();
        for k in 0..(seconds * 25.0) as u32 {
            let t = f64::from(k) * 0.04;
            a.take(Time::from_secs(t), innovation_sd(t));
        }
        a
    }

    #[test]
    fn rangefinder_that_contradicts_for_seconds() {
        let at = Time::from_secs(6.0);
        // Errors as stated, a single false echo, and late images of a heaving deck.
        let sound = after(6.0, |t| 1.4 * (40.0 * t).sin()).value(at).unwrap();
        assert!((0.7..1.6).contains(&sound), "{sound}");
        let gull = after(6.0, |t| if (3.0..3.1).contains(&t) { 40.0 } else { 1.0 })
            .value(at)
            .unwrap();
        assert!(gull < 9.0, "{gull}");
        let late = after(6.0, |t| 6.0 * (1.3 * t).sin()).value(at).unwrap();
        assert!(late > 12.0, "{late}");
        // The first reading after a gap is not a contradiction; a lasting contradiction is detected.
        let mut station = after(6.0, |_| 1.0);
        station.take(Time::from_secs(60.0), 40.0);
        let spot = station.value(Time::from_secs(60.0)).unwrap();
        assert!(spot < 9.0, "{spot}");
        for k in 1..20 {
            station.take(Time::from_secs(60.0 + 0.04 * f64::from(k)), 40.0);
        }
        assert!(station.value(Time::from_secs(61.0)).unwrap() > 9.0);
        // Without readings there is neither agreement nor contradiction, unless a contradiction is remembered.
        assert_eq!(after(6.0, |_| 1.0).value(Time::from_secs(9.1)), None);
        let remembered = after(6.0, |t| 6.0 * (1.3 * t).sin())
            .value(Time::from_secs(12.0))
            .unwrap();
        assert!(remembered > 9.0, "{remembered}");
    }
}

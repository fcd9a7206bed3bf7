//! Whether two witnesses of the deck agree: its height by the rangefinder and by the camera, its place by the camera and by the
//! radio. Neither is ever wrong alone without showing here: images that are stamped late show a heaving deck where it
//! was, the tags of a neighbour's deck are the right tags in the wrong place.

use alight_shared::estimation::low_pass;
use alight_shared::time::{DroneClock, Time};

use super::axis::AxisNoise;

/// The rangefinder's disagreement is averaged over this time, s: half a period of a swell.
const MEMORY_S: f64 = 3.0;
/// One reading stands for no longer than this, s: after a gap a single echo from the water next to the deck proves nothing.
const READING_S: f64 = 0.2;
/// A contradiction is forgotten within this time, s: longer than a lull between two groups of waves.
const RELEASE_S: f64 = 30.0;
/// One reading counts no more than this, in variances: a gull below the drone is no contradiction.
const MAX_SQUARE: f64 = 100.0;
/// The place by vision is the radio's within so many standard deviations of their slow errors; Rayleigh: one sound
/// landing in 3000 is refused.
pub(super) const PLACE_SD: f64 = 4.0;

/// Height by the rangefinder against what is known without it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeightAgreement {
    newest: Option<Averaged>,
}

#[derive(Clone, Copy, Debug)]
struct Averaged {
    at: Time<DroneClock>,
    /// Mean of the normalised innovation squared.
    mean: f64,
    /// The largest recent mean: a source that was wrong is trusted again slowly.
    peak: f64,
}

impl HeightAgreement {
    /// A reading that differs by so many standard deviations of both.
    pub(super) fn take(&mut self, at: Time<DroneClock>, innovation_sd: f64) {
        let squared = innovation_sd.powi(2).min(MAX_SQUARE);
        let since = |then: Time<DroneClock>| (at - then).secs().max(0.0);
        let (mean, peak, dt) = self.newest.map_or((1.0, 1.0, 0.0), |n| {
            let dt = since(n.at);
            (if dt <= MEMORY_S { n.mean } else { 1.0 }, n.peak, dt)
        });
        let mean = low_pass(mean, squared, dt.min(READING_S), MEMORY_S);
        let peak = mean.max(peak * (-dt / RELEASE_S).exp());
        self.newest = Some(Averaged { at, mean, peak });
    }
    /// The largest mean of late, 1 where both err as they state; None while there are no readings and nothing to remember.
    pub(super) fn value(&self, now: Time<DroneClock>) -> Option<f64> {
        let n = self.newest?;
        let since = (now - n.at).secs().max(0.0);
        let peak = n.peak * (-since / RELEASE_S).exp();
        (since <= MEMORY_S || peak > 1.0).then_some(peak)
    }
}

/// The place by vision less the place by radio, horizontal, and how far it may be by the spread of both, m; `offset`: of
/// both, north and east; `taken`: what jumps of the autopilot's estimate have put between them since the deck was
/// detected; `more`: variance of the offset besides, m².
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
        // As stated; one echo from elsewhere; late images of a deck that heaves.
        let sound = after(6.0, |t| 1.4 * (40.0 * t).sin()).value(at).unwrap();
        assert!((0.7..1.6).contains(&sound), "{sound}");
        let gull = after(6.0, |t| if (3.0..3.1).contains(&t) { 40.0 } else { 1.0 })
            .value(at)
            .unwrap();
        assert!(gull < 9.0, "{gull}");
        let late = after(6.0, |t| 6.0 * (1.3 * t).sin()).value(at).unwrap();
        assert!(late > 12.0, "{late}");
        // The first reading after a station without any; a contradiction that lasts is found.
        let mut station = after(6.0, |_| 1.0);
        station.take(Time::from_secs(60.0), 40.0);
        let spot = station.value(Time::from_secs(60.0)).unwrap();
        assert!(spot < 9.0, "{spot}");
        (1..20).for_each(|k| station.take(Time::from_secs(60.0 + 0.04 * f64::from(k)), 40.0));
        assert!(station.value(Time::from_secs(61.0)).unwrap() > 9.0);
        // None there: neither agreed nor contradicted, but for what is remembered.
        assert_eq!(after(6.0, |_| 1.0).value(Time::from_secs(9.1)), None);
        let remembered = after(6.0, |t| 6.0 * (1.3 * t).sin())
            .value(Time::from_secs(12.0))
            .unwrap();
        assert!(remembered > 9.0, "{remembered}");
    }
}

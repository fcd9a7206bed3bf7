//! Loss of vision by glare, spray, or an object on the tag.
//!
//! Each cause is an alternating renewal process with exponential durations in both states (the two-state
//! chain of Gilbert 1960 in continuous time): absent for `interval_s`, present for `duration_s` on average.
//! It starts in its stationary distribution and does not depend on the camera, so that planners experience
//! the same losses at the same times.

use alight_shared::{
    config,
    time::{Span, Time, TrueTime},
};

use super::noise::Noise;
use crate::physics::streams::Streams;

config! {
    /// Temporary losses of the tag; by default they affect 7 % of images.
    #[derive(Copy)]
    pub struct VisionLossConfig {
        /// Mean time between two glares (mirror image of the sun on a wet deck or in the lens), s.
        /// Chosen: every few waves the deck's normal passes through the direction that reflects the sun.
        pub glare_interval_s: f64 = 20.0, in 0.01..=1e6;
        /// Mean duration of a glare, s; 0: no glare.
        /// Chosen: a deck that rocks at 10 deg/s takes 0.3 to 1 s to pass through the reflecting direction,
        /// which is a few degrees wide on wet paint.
        pub glare_duration_s: f64 = 0.6, in 0.0..=60.0;
        /// Mean time between two clouds of spray, s.
        /// Chosen: one in a few bow waves breaks over the deck.
        pub spray_interval_s: f64 = 30.0, in 0.01..=1e6;
        /// Mean duration of a cloud of spray, s; 0: no spray.
        /// Chosen: drops that rise by 0.5 m fall back after 0.6 s, and the cloud is dense for half that time.
        pub spray_duration_s: f64 = 0.3, in 0.0..=60.0;
        /// Mean time between two covers of the tag (a rope, a net, a puddle, foam), s.
        /// Chosen: about one cover per landing.
        pub cover_interval_s: f64 = 60.0, in 0.01..=1e6;
        /// Mean duration of a cover of part of the tag, s; 0: no cover.
        /// Chosen: one or two rolls of the deck move the object away.
        pub cover_duration_s: f64 = 3.0, in 0.0..=600.0;
        /// Probability that a frame is decoded although part of the tag is covered.
        /// Chosen: the detector corrects one wrong bit of 36, and in some frames decodes the tag despite a thin rope.
        pub cover_chance: f64 = 0.3, in 0.0..=1.0;
    }
}

impl VisionLossConfig {
    pub fn none() -> Self {
        VisionLossConfig {
            glare_duration_s: 0.0,
            spray_duration_s: 0.0,
            cover_duration_s: 0.0,
            ..VisionLossConfig::default()
        }
    }
}

#[derive(Clone, Debug)]
struct Cause {
    noise: Noise,
    interval_s: f64,
    duration_s: f64,
    present: bool,
    until: Option<Time<TrueTime>>,
}

impl Cause {
    fn new(noise: Noise, interval_s: f64, duration_s: f64) -> Cause {
        let mut noise = noise;
        let present = noise.chance(duration_s / (interval_s + duration_s));
        Cause {
            noise,
            interval_s,
            duration_s,
            present,
            until: None,
        }
    }
    /// `t` must not decrease.
    fn present(&mut self, t: Time<TrueTime>) -> bool {
        if self.duration_s <= 0.0 {
            return false;
        }
        let mut until = self.until.unwrap_or_else(|| t + self.stay());
        while until <= t {
            self.present = !self.present;
            until += self.stay();
        }
        self.until = Some(until);
        self.present
    }
    /// Random time to the next change (exponential), at least 1 ms so that the loop in [`Cause::present`]
    /// ends.
    fn stay(&mut self) -> Span {
        let mean_s = if self.present {
            self.duration_s
        } else {
            self.interval_s
        };
        Span::from_secs((-mean_s * (1.0 - self.noise.uniform()).ln()).max(1e-3))
    }
}

#[derive(Clone, Debug)]
pub(crate) struct VisionLoss {
    glare: Cause,
    spray: Cause,
    cover: Cause,
    decoded: Noise,
    cover_chance: f64,
}

impl VisionLoss {
    /// Each cause has its own random stream.
    pub(crate) fn new(c: &VisionLossConfig, streams: &Streams) -> VisionLoss {
        let cause = |name: &str, interval_s, duration_s| {
            let stream = Noise::new(streams, &format!("drone.tag.{name}"));
            Cause::new(stream, interval_s, duration_s)
        };
        VisionLoss {
            glare: cause("glare", c.glare_interval_s, c.glare_duration_s),
            spray: cause("spray", c.spray_interval_s, c.spray_duration_s),
            cover: cause("cover", c.cover_interval_s, c.cover_duration_s),
            decoded: Noise::new(streams, "drone.tag.covered"),
            cover_chance: c.cover_chance,
        }
    }
    pub(crate) fn hides(&mut self, t: Time<TrueTime>) -> bool {
        // Every image evaluates all causes, so that no cause affects the draws of another.
        let decoded = self.decoded.chance(self.cover_chance);
        let [glare, spray, cover] = [&mut self.glare, &mut self.spray, &mut self.cover].map(|c| c.present(t));
        glare || spray || (cover && !decoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost(config: &VisionLossConfig, seed: u64, n: i64, step_s: f64) -> Vec<bool> {
        let mut loss = VisionLoss::new(config, &Streams::new(seed));
        (0..n)
            .map(|k| loss.hides(Time::from_secs(k as f64 * step_s)))
            .collect()
    }
    fn only(glare_s: f64, spray_s: f64, cover_s: f64) -> VisionLossConfig {
        VisionLossConfig {
            glare_duration_s: glare_s,
            spray_duration_s: spray_s,
            cover_duration_s: cover_s,
            ..VisionLossConfig::none()
        }
    }
    fn fraction_and_length(lost: &[bool], step_s: f64) -> (f64, f64) {
        let count = lost.iter().filter(|l| **l).count() as f64;
        let bursts = lost.windows(2).filter(|w| !w[0] && w[1]).count() as f64;
        (count / lost.len() as f64, count * step_s / bursts)
    }

    #[test]
    fn vision_loss_bursts() {
        for (config, fraction, length_s) in [
            (only(0.6, 0.0, 0.0), 0.6 / 20.6, 0.6),
            (only(0.0, 0.3, 0.0), 0.3 / 30.3, 0.3),
        ] {
            // 5.5 hours contain at least 660 bursts, whose mean is accurate to 4 %.
            let (lost_fraction, mean_s) = fraction_and_length(&lost(&config, 3, 2_000_000, 0.01), 0.01);
            assert!(
                (lost_fraction / fraction - 1.0).abs() < 0.13,
                "{lost_fraction}, expected {fraction}"
            );
            assert!(
                (mean_s / length_s - 1.0).abs() < 0.12,
                "{mean_s} s, expected {length_s} s"
            );
        }
    }

    #[test]
    fn covered_tag_detection_rate() {
        let lost = lost(&only(0.0, 0.0, 3.0), 4, 2_000_000, 1.0 / 30.0);
        let fraction = lost.iter().filter(|l| **l).count() as f64 / lost.len() as f64;
        let expected = 0.7 * 3.0 / 63.0;
        assert!(
            (fraction / expected - 1.0).abs() < 0.12,
            "{fraction} of {expected}"
        );
    }

    #[test]
    fn vision_loss_rate() {
        // The first 30 images after each of 3000 starts have the long-term loss rate.
        let config = VisionLossConfig::default();
        let images = (0..3000).flat_map(|seed| lost(&config, seed, 30, 1.0 / 30.0));
        let fraction = images.filter(|l| *l).count() as f64 / 90_000.0;
        assert!((0.055..0.085).contains(&fraction), "{fraction}");
    }

    #[test]
    fn vision_loss_times_at_any_rate() {
        let config = only(0.6, 0.3, 0.0);
        let (slow, fast) = (lost(&config, 5, 3_000, 0.1), lost(&config, 5, 30_000, 0.01));
        assert!(slow.iter().any(|l| *l));
        assert!(slow.iter().zip(fast.iter().step_by(10)).all(|(a, b)| a == b));
        // Causes do not affect each other.
        let glare = lost(&only(0.6, 0.0, 0.0), 5, 3_000, 0.1);
        assert!(slow.iter().zip(&glare).all(|(both, one)| *both || !one));
        assert!(!lost(&VisionLossConfig::none(), 5, 3_000, 0.1).contains(&true));
    }
}

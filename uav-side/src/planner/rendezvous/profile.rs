//! Descent profile: fast, then braked, and soft before contact.

use super::config::ProfileConfig;

/// Height above the deck and sink rate as functions of the time to contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    config: ProfileConfig,
    /// Time to contact at which braking begins, s.
    braking_from: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Height {
    /// Height of the foot plane above the deck, m.
    pub clearance: f64,
    /// Downward speed relative to the deck, m/s.
    pub sinking: f64,
}

impl Profile {
    pub fn new(config: &ProfileConfig) -> Self {
        let braking = (config.sink_mps - config.touch_mps).max(0.0) / config.braking_mps2;
        Profile {
            config: *config,
            braking_from: config.soft_s + braking,
        }
    }

    /// Height `left` seconds before contact: `v_t s`, then `v_t s + a (s - s_soft)² / 2`, then at full speed. After
    /// contact an exponential decay below the deck's plane keeps pressure on the contact.
    pub fn at(&self, left: f64) -> Height {
        let c = &self.config;
        if left < 0.0 {
            let rest = (left * c.touch_mps / c.press_m).exp();
            return Height {
                clearance: -c.press_m * (1.0 - rest),
                sinking: c.touch_mps * rest,
            };
        }
        let braked = (left.min(self.braking_from) - c.soft_s).max(0.0);
        let fast = (left - self.braking_from).max(0.0);
        Height {
            clearance: c.touch_mps * left.min(self.braking_from)
                + 0.5 * c.braking_mps2 * braked * braked
                + c.sink_mps * fast,
            sinking: c.touch_mps + c.braking_mps2 * braked,
        }
    }

    /// Time to contact at `clearance`, s; the inverse of [`Profile::at`].
    pub fn left(&self, clearance: f64) -> f64 {
        let c = &self.config;
        if clearance < 0.0 {
            let rest = (1.0 + clearance / c.press_m).max(1e-3);
            return c.press_m / c.touch_mps * rest.ln();
        }
        let soft = c.touch_mps * c.soft_s;
        if clearance <= soft {
            return clearance / c.touch_mps;
        }
        let fast = self.at(self.braking_from).clearance;
        if clearance >= fast {
            return self.braking_from + (clearance - fast) / c.sink_mps;
        }
        // v_t s + a s² / 2 = clearance - soft, with s from the end of the soft part.
        let (v, a, d) = (c.touch_mps, c.braking_mps2, clearance - soft);
        c.soft_s + (-v + (v * v + 2.0 * a * d).sqrt()) / a
    }

    /// Minimum time to contact from `clearance` at the sink rate `speed`, s: the profile's time plus the time lost
    /// while accelerating to the profile's speed.
    pub fn min_time(&self, clearance: f64, speed: f64) -> f64 {
        let left = self.left(clearance);
        let wanted = self.at(left).sinking;
        let missing = (wanted - speed).max(0.0);
        left + missing * missing / (2.0 * self.config.braking_mps2 * wanted.max(0.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profile_height_time_and_speed() {
        let p = Profile::new(&ProfileConfig::default());
        for k in -100..500 {
            let s = 0.01 * f64::from(k);
            let here = p.at(s);
            assert!((p.left(here.clearance) - s).abs() < 1e-6, "{s}");
            let h = 1e-6;
            let slope = (p.at(s + h).clearance - p.at(s - h).clearance) / (2.0 * h);
            assert!((slope - here.sinking).abs() < 1e-4, "{s}");
        }
        assert_eq!(p.at(0.0).clearance, 0.0);
        assert!((p.at(4.0).sinking - 2.5).abs() < 1e-12);
        assert!((p.at(0.1).sinking - 0.28).abs() < 1e-12);
    }

    #[test]
    fn profile_from_a_standing_start() {
        let p = Profile::new(&ProfileConfig::default());
        assert!(p.min_time(6.0, 0.0) > p.min_time(6.0, 2.5) + 0.4);
        assert_eq!(p.min_time(6.0, 2.5), p.left(6.0));
        assert!(p.left(-10.0).is_finite() && p.min_time(-10.0, 0.0).is_finite());
    }
}

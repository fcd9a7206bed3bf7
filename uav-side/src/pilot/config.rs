//! Parameters of the pilot: output to the autopilot, its response, and the link's dead time.

use alight_shared::config;
use serde::{Deserialize, Serialize};

use crate::tracking::{DESIGN_LAG_S, TrackingConfig};

/// Set-point fields that the autopilot follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// Position, velocity, acceleration, yaw: the autopilot closes the position loop.
    Trajectory,
    /// Attitude and thrust: the pilot closes the position loop.
    #[default]
    Attitude,
}

config! {
    pub struct PilotConfig {
        /// Kind of the set-points. It must not change while Alight commands: PX4 detects a change up to 0.5 s late, and
        /// until then two of its controllers alternate in writing attitudes.
        /// Source: the contact needs the plan's attitude, which with position set-points is decided by the autopilot's
        /// own loop (measured). PX4's Commander publishes vehicle_control_mode at 2 Hz.
        pub output: Output = Output::Attitude;
        /// The pilot's own tracking loop.
        pub tracking: TrackingConfig;
        /// Lag of the autopilot's attitude loop.
        pub lag: LagConfig;
        /// Dead time of the link to the autopilot.
        pub delay: DelayConfig;
    }
}

config! {
    /// Identification and compensation of the autopilot's attitude response.
    pub struct LagConfig {
        /// Time constant for which the tracking loop's gains are designed, s.
        pub design_s: f64 = DESIGN_LAG_S, in 0.02..=2.0;
        /// Minimum and maximum accepted time constant, s.
        pub bounds_s: [f64; 2] = [0.04, 0.6], in 0.02..=2.0;
        /// Lag of the inner rate loop until it is identified, s.
        pub rate_loop_s: f64 = 0.06, in 0.0..=0.2;
        /// Forgetting time of observations, s.
        pub memory_s: f64 = 10.0, in 0.5..=1e4;
    }
    check |this, at| {
        at.require(
            this.bounds_s[0] <= this.bounds_s[1],
            "bounds_s",
            format!("{:?}", this.bounds_s),
            "lower bound first",
        )?;
    }
}

config! {
    /// Estimator of the odometry's age, i.e. of the dead time from the autopilot.
    pub struct DelayConfig {
        /// Maximum accepted age, one way, s.
        pub limit_s: f64 = 0.15, in 0.0..=0.25;
        /// Time constant of the age estimate, s.
        pub time_s: f64 = 1.0, in 0.05..=60.0;
    }
}

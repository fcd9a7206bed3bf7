//! Parameters of the pilot: output to the autopilot, its response, the link's dead time.

use alight_shared::config;
use serde::{Deserialize, Serialize};

use crate::tracking::{DESIGN_LAG_S, TrackingConfig};

/// Which fields of the set-point the autopilot is to follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Output {
    /// Position, velocity, acceleration, yaw: the autopilot closes the position loop.
    Trajectory,
    /// Attitude and thrust: the pilot closes it.
    #[default]
    Attitude,
}

config! {
    /// Parameters of the pilot.
    pub struct PilotConfig {
        /// The kind of set-points, the same for as long as Alight commands: PX4 learns of another kind up to 0.5 s late,
        /// and until then two of its controllers write attitudes by turns.
        /// Source: The plan's attitude has to be met at the contact: measured on real autopilots,
        /// position set-points leave it to their own loop. PX4's Commander publishes vehicle_control_mode at 2 Hz.
        pub output: Output = Output::Attitude;
        /// The pilot's own tracking loop.
        pub tracking: TrackingConfig;
        /// The lag of the autopilot's attitude loop.
        pub lag: LagConfig;
        /// The dead time of the link to it.
        pub delay: DelayConfig;
    }
}

config! {
    /// How the response of the autopilot's attitude loop is identified and compensated.
    pub struct LagConfig {
        /// The time constant that the tracking loop's gains are laid out for, s.
        pub design_s: f64 = DESIGN_LAG_S, in 0.02..=2.0;
        /// Smallest and largest time constant accepted, s.
        pub bounds_s: [f64; 2] = [0.04, 0.6], in 0.02..=2.0;
        /// Lag of the rate loop below before one is identified, s.
        pub rate_loop_s: f64 = 0.06, in 0.0..=0.2;
        /// Observations count for this long, s.
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
    /// How the age of odometry, the dead time of the link from the autopilot, is learnt.
    pub struct DelayConfig {
        /// Largest accepted, one way, s.
        pub limit_s: f64 = 0.15, in 0.0..=0.25;
        /// Time constant of its estimate, s.
        pub time_s: f64 = 1.0, in 0.05..=60.0;
    }
}

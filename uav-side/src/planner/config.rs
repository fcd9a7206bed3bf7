//! The planner's configuration.

use serde::{Deserialize, Serialize};

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::geometry::{DroneGeometry, GRAVITY};
use alight_shared::msg::PLAN_STAGES;

use super::baselines::config::BaselineConfig;
use super::rendezvous::config::RendezvousConfig;
use super::weights::{Faa, Weights};

/// Which planner flies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlannerKind {
    /// The paper's MPC with flight-attitude alignment.
    MpcFaa,
    /// The same without: weights do not change with clearance.
    Mpc,
    /// Ours: place, velocity and attitude meet the deck at a chosen instant.
    #[default]
    Alight,
    /// Gupta et al. 2023: lands when its own prediction of the tilt allows it.
    MpcNe,
    /// `mpc` that descends only in a predicted calm.
    WaitCalm,
    /// Precision landing of today's autopilots.
    PrecisionLand,
    /// Position by radio, constant velocity.
    GnssRadio,
}

impl PlannerKind {
    /// The name on the command line and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            PlannerKind::MpcFaa => "mpc-faa",
            PlannerKind::Mpc => "mpc",
            PlannerKind::Alight => "alight",
            PlannerKind::MpcNe => "mpc-ne",
            PlannerKind::WaitCalm => "wait-calm",
            PlannerKind::PrecisionLand => "precision-land",
            PlannerKind::GnssRadio => "gnss-radio",
        }
    }
}

/// Rotor limits and how the four virtual inputs share them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RotorLimits {
    /// Least squared speed of a rotor, relative to hover.
    pub lowest: f64,
    /// Change of a rotor's squared speed per second, relative to hover.
    pub slew_per_s: f64,
    /// Magnitude that roll and pitch may each have, virtual input.
    pub tilt_input: f64,
    /// Magnitude that yaw may have, virtual input. Thrust has what then remains.
    pub yaw_input: f64,
    /// Shares of the slew for thrust, roll, pitch (the same) and yaw; 2 x tilt + the others <= 1.
    pub slew_shares: [f64; 3],
}

impl Default for RotorLimits {
    /// The paper bounds inputs and slew but publishes no value: all ours. Lowest speed from
    /// ctu-mrs `t650`: (875 rpm / 3420 rpm)². Slew: hover to twice hover in 0.1 s, three time
    /// constants of a motor; half of that made a third of a landing's problems limited. Tilt input 0.3: 12 rad/s² with the default drone, more than an
    /// autopilot's attitude loop follows.
    fn default() -> Self {
        RotorLimits {
            lowest: 0.065,
            slew_per_s: 10.0,
            tilt_input: 0.3,
            yaw_input: 0.25,
            slew_shares: [0.4, 0.25, 0.1],
        }
    }
}

impl RotorLimits {
    /// Bounds of the virtual inputs thrust (lower, upper), tilt and yaw that keep every rotor in
    /// `[lowest, highest]` in any mix: each rotor is `1 + (nu0 +- nu1 +- nu2 +- nu3) / 2`. Tilt and
    /// yaw shrink together where a weak drone would have no thrust left for itself. Tilt is about
    /// the axes of NED, not of the body: turning by the heading keeps `|nu1| + |nu2|` within
    /// `2 tilt`, because the box's corner has that same sum.
    pub fn bounds(&self, drone: &DroneGeometry) -> RotorBounds {
        let down = 2.0 * (1.0 - self.lowest);
        let up = 2.0 * (drone.max_thrust_n / (drone.mass_kg * GRAVITY) - 1.0);
        let wanted = 2.0 * self.tilt_input + self.yaw_input;
        let others = wanted.min(0.6 * down.min(up));
        let shrink = others / wanted;
        RotorBounds {
            thrust: [others - down, up - others],
            tilt: shrink * self.tilt_input,
            yaw: shrink * self.yaw_input,
        }
    }
    /// Bounds of the change per step of thrust, roll, pitch and yaw inputs: shares of the rotors'.
    pub fn slew(&self, step_s: f64) -> [f64; 4] {
        let all = 2.0 * self.slew_per_s * step_s;
        let [thrust, tilt, yaw] = self.slew_shares;
        [thrust * all, tilt * all, tilt * all, yaw * all]
    }
}

/// Hard bounds of the virtual inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorBounds {
    /// Thrust, lower and upper.
    pub thrust: [f64; 2],
    /// Magnitude of roll and pitch each.
    pub tilt: f64,
    /// Magnitude of yaw.
    pub yaw: f64,
}

impl Check for RotorLimits {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("lowest", self.lowest, 0.0, 0.5)?;
        at.range("slew_per_s", self.slew_per_s, 0.5, 100.0)?;
        at.range("tilt_input", self.tilt_input, 0.01, 0.4)?;
        at.range("yaw_input", self.yaw_input, 0.01, 0.4)?;
        at.ranges("slew_shares", &self.slew_shares, 0.01, 0.9)?;
        let [thrust, tilt, yaw] = self.slew_shares;
        at.require(
            thrust + 2.0 * tilt + yaw <= 1.0 + 1e-9,
            "slew_shares",
            format!("{:?}", self.slew_shares),
            "thrust + 2 x tilt + yaw at most 1",
        )
    }
}

/// Soft limits of the states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StateLimits {
    /// Roll and pitch, deg.
    pub tilt_deg: f64,
    /// Horizontal velocity per axis, m/s.
    pub horizontal_mps: f64,
    /// Vertical velocity, m/s.
    pub vertical_mps: f64,
    /// Euler rates, rad/s.
    pub rates_rps: f64,
    /// Linear cost of passing a limit by its own size.
    pub slack_linear: f64,
    /// Quadratic cost of the same.
    pub slack_quadratic: f64,
}
impl Default for StateLimits {
    /// Procházka 2024, Table 4; the costs of slack are ours: large against a metre of position
    /// error (30), small against FAA's last word (50000 per rad²).
    fn default() -> Self {
        StateLimits {
            tilt_deg: 45.0,
            horizontal_mps: 8.0,
            vertical_mps: 4.0,
            rates_rps: 2.0,
            slack_linear: 1e4,
            slack_quadratic: 1e4,
        }
    }
}
impl Check for StateLimits {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("tilt_deg", self.tilt_deg, 5.0, 60.0)?;
        at.range("horizontal_mps", self.horizontal_mps, 1.0, 30.0)?;
        at.range("vertical_mps", self.vertical_mps, 0.5, 15.0)?;
        at.range("rates_rps", self.rates_rps, 0.2, 10.0)?;
        at.range("slack_linear", self.slack_linear, 1.0, 1e7)?;
        at.range("slack_quadratic", self.slack_quadratic, 0.0, 1e7)
    }
}

/// How references approach their target: a point that moves towards it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shaping {
    /// Horizontal speed relative to the target, m/s.
    pub horizontal_mps: f64,
    /// Horizontal acceleration, m/s².
    pub horizontal_mps2: f64,
    /// Vertical speed, m/s.
    pub vertical_mps: f64,
    /// Vertical acceleration, m/s².
    pub vertical_mps2: f64,
    /// Yaw rate, rad/s.
    pub yaw_rps: f64,
    /// Yaw acceleration, rad/s².
    pub yaw_rps2: f64,
    /// Time constant of the last part, s.
    pub settle_s: f64,
}
impl Default for Shaping {
    /// Ours: inside the "fast" constraint set of ctu-mrs (8 m/s and 4 m/s² horizontal, 4 and 2
    /// vertical); yaw to what the rotors' small drag moment can do.
    fn default() -> Self {
        Shaping {
            horizontal_mps: 7.0,
            horizontal_mps2: 2.5,
            vertical_mps: 3.0,
            vertical_mps2: 1.5,
            yaw_rps: 0.8,
            yaw_rps2: 0.25,
            settle_s: 0.8,
        }
    }
}
impl Check for Shaping {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("horizontal_mps", self.horizontal_mps, 0.5, 30.0)?;
        at.range("horizontal_mps2", self.horizontal_mps2, 0.2, 10.0)?;
        at.range("vertical_mps", self.vertical_mps, 0.2, 10.0)?;
        at.range("vertical_mps2", self.vertical_mps2, 0.1, 10.0)?;
        at.range("yaw_rps", self.yaw_rps, 0.05, 4.0)?;
        at.range("yaw_rps2", self.yaw_rps2, 0.02, 10.0)?;
        at.range("settle_s", self.settle_s, 0.1, 5.0)
    }
}

/// When the plan lets go of its own past and starts from the measured state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reset {
    /// Horizontal distance of the measured state, m.
    pub horizontal_m: f64,
    /// Horizontal speed difference, m/s.
    pub horizontal_mps: f64,
    /// Vertical distance, m.
    pub vertical_m: f64,
    /// Vertical speed difference, m/s.
    pub vertical_mps: f64,
    /// Heading difference, deg.
    pub yaw_deg: f64,
    /// Age of the last plan, s.
    pub age_s: f64,
    /// In a landing the drone may be lower than the plan by this; the plan begins no higher above it, m.
    pub ahead_m: f64,
    /// ... and may sink faster by this; the plan begins sinking no slower, m/s.
    pub ahead_mps: f64,
}
impl Default for Reset {
    /// Ours: well above what a tracker leaves in gusts, below what would look like a jump.
    fn default() -> Self {
        Reset {
            horizontal_m: 1.0,
            horizontal_mps: 1.5,
            vertical_m: 0.8,
            vertical_mps: 1.5,
            yaw_deg: 30.0,
            age_s: 0.5,
            ahead_m: 0.0,
            ahead_mps: 0.1,
        }
    }
}
impl Check for Reset {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("horizontal_m", self.horizontal_m, 0.05, 100.0)?;
        at.range("horizontal_mps", self.horizontal_mps, 0.05, 100.0)?;
        at.range("vertical_m", self.vertical_m, 0.05, 100.0)?;
        at.range("vertical_mps", self.vertical_mps, 0.05, 100.0)?;
        at.range("yaw_deg", self.yaw_deg, 1.0, 180.0)?;
        at.range("age_s", self.age_s, 0.05, 10.0)?;
        at.range("ahead_m", self.ahead_m, 0.0, 100.0)?;
        at.range("ahead_mps", self.ahead_mps, 0.0, 100.0)
    }
}

/// The planner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerConfig {
    /// Which one.
    pub kind: PlannerKind,
    /// Stages of the horizon.
    pub stages: usize,
    /// Time between stages, s.
    pub step_s: f64,
    /// Solves per second in NAVIGATION.
    pub navigation_hz: f64,
    /// Solves per second in FOLLOW and LANDING.
    pub landing_hz: f64,
    /// R: weight of squared increments of the normalised squared rotor speeds.
    pub increment_weight: f64,
    /// Weights in NAVIGATION.
    pub navigation: Weights,
    /// Weights in FOLLOW.
    pub follow: Weights,
    /// Weights in LANDING, far from the deck.
    pub landing: Weights,
    /// How they grow near the deck (`mpc-faa` only).
    pub faa: Faa,
    /// Instant, way down and weights of the rendezvous (`alight` only).
    pub rendezvous: RendezvousConfig,
    /// The baselines.
    pub baselines: BaselineConfig,
    /// Rotor limits, hard.
    pub rotors: RotorLimits,
    /// State limits, soft.
    pub limits: StateLimits,
    /// Approach to a reference.
    pub shaping: Shaping,
    /// When to start from the measured state.
    pub reset: Reset,
    /// Time constant of the deck's mean height, s.
    pub mean_height_s: f64,
    /// After contact the reference goes on into the deck down to here, m.
    pub press_m: f64,
    /// Nearer than this the heading towards the vessel means nothing, m.
    pub heading_from_m: f64,
    /// The minimum altitude does not bind inside the deck's outline widened by this, m.
    pub outline_margin_m: f64,
    /// A forecast older than this is not used, s.
    pub forecast_age_s: f64,
    /// A mission state older than this is not followed, s.
    pub mission_age_s: f64,
    /// Odometry older than this is not used, s.
    pub odometry_age_s: f64,
}

impl Default for PlannerConfig {
    /// Horizon, rates, R and the landing weights: Procházka 2024, section III and Table 4. Weights
    /// of NAVIGATION and FOLLOW are not published (the velocity weights are raised while
    /// following): ours, as is all the rest.
    fn default() -> Self {
        PlannerConfig {
            kind: PlannerKind::Alight,
            stages: 20,
            step_s: 0.1,
            navigation_hz: 10.0,
            landing_hz: 50.0,
            increment_weight: 0.1,
            navigation: Weights {
                vertical: 40.0,
                tilt: 20.0,
                rates: 10.0,
                horizontal_velocity: 5.0,
                vertical_velocity: 40.0,
                ..Weights::default()
            },
            follow: Weights {
                vertical: 40.0,
                horizontal_velocity: 10.0,
                vertical_velocity: 40.0,
                ..Weights::default()
            },
            landing: Weights::default(),
            faa: Faa::default(),
            rendezvous: RendezvousConfig::default(),
            baselines: BaselineConfig::default(),
            rotors: RotorLimits::default(),
            limits: StateLimits::default(),
            shaping: Shaping::default(),
            reset: Reset::default(),
            mean_height_s: 8.0,
            press_m: 0.3,
            heading_from_m: 2.0,
            outline_margin_m: 0.5,
            forecast_age_s: 0.5,
            mission_age_s: 0.5,
            odometry_age_s: 0.2,
        }
    }
}

impl Check for PlannerConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.require(
            (2..PLAN_STAGES).contains(&self.stages),
            "stages",
            self.stages,
            &format!("2 to {}", PLAN_STAGES - 1),
        )?;
        at.range("step_s", self.step_s, 0.02, 0.5)?;
        at.range("navigation_hz", self.navigation_hz, 1.0, 100.0)?;
        at.range("landing_hz", self.landing_hz, 1.0, 100.0)?;
        at.range("increment_weight", self.increment_weight, 1e-4, 1e4)?;
        self.navigation.check(&at.table("navigation"))?;
        self.follow.check(&at.table("follow"))?;
        self.landing.check(&at.table("landing"))?;
        self.faa.check(&at.table("faa"))?;
        self.rendezvous.check(&at.table("rendezvous"))?;
        self.baselines.check(&at.table("baselines"))?;
        self.rotors.check(&at.table("rotors"))?;
        self.limits.check(&at.table("limits"))?;
        self.shaping.check(&at.table("shaping"))?;
        self.reset.check(&at.table("reset"))?;
        at.range("mean_height_s", self.mean_height_s, 0.5, 60.0)?;
        at.range("press_m", self.press_m, 0.0, 1.0)?;
        at.range("heading_from_m", self.heading_from_m, 0.1, 50.0)?;
        at.range("outline_margin_m", self.outline_margin_m, 0.0, 10.0)?;
        at.range("forecast_age_s", self.forecast_age_s, 0.05, 5.0)?;
        at.range("mission_age_s", self.mission_age_s, 0.05, 5.0)?;
        at.range("odometry_age_s", self.odometry_age_s, 0.02, 5.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_mix_of_virtual_inputs_keeps_every_rotor_in_range() {
        use super::super::model::MIXER;
        let strong = DroneGeometry::default();
        let weak = DroneGeometry {
            max_thrust_n: 1.2 * strong.mass_kg * GRAVITY,
            ..strong
        };
        let limits = RotorLimits::default();
        for drone in [strong, weak] {
            let highest = drone.max_thrust_n / (drone.mass_kg * GRAVITY);
            let b = limits.bounds(&drone);
            assert!(b.thrust[0] < -0.1 && b.thrust[1] > 0.1, "{b:?}");
            let (mut least, mut most) = (f64::MAX, f64::MIN);
            for corner in 0..16 {
                let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
                let nu = [
                    b.thrust[usize::from(corner & 1 == 1)],
                    sign(1) * b.tilt,
                    sign(2) * b.tilt,
                    sign(3) * b.yaw,
                ];
                for rotor in 0..4 {
                    let u = 1.0 + (0..4).map(|i| MIXER[i][rotor] * nu[i]).sum::<f64>();
                    least = least.min(u);
                    most = most.max(u);
                }
            }
            // Exactly used up, not passed.
            assert!((least - limits.lowest).abs() < 1e-12 && (most - highest).abs() < 1e-12);
        }
        let slew = limits.slew(0.1);
        assert!(slew.iter().sum::<f64>() / 2.0 <= limits.slew_per_s * 0.1 + 1e-12);
    }

    #[test]
    fn kinds_have_the_names_of_the_command_line() {
        let parse = |s: &str| alight_shared::config::parse::<PlannerConfig>(s, "test").map(|c| c.kind);
        assert_eq!(parse("kind = \"mpc\"").unwrap(), PlannerKind::Mpc);
        assert_eq!(parse("kind = \"alight\"").unwrap(), PlannerKind::Alight);
        assert_eq!(parse("").unwrap(), PlannerKind::Alight);
        assert!(parse("stages = 41").is_err());
        assert!(parse("[faa]\ndistance = \"per-stage\"").is_ok());
        assert!(parse("[rotors]\nslew_shares = [0.5, 0.3, 0.1]").is_err());
    }
}

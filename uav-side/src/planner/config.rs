use serde::{Deserialize, Serialize};

use alight_shared::{
    config,
    geometry::{DroneGeometry, GRAVITY},
    msg::PLAN_STAGES,
};

use super::{
    rendezvous::config::RendezvousConfig,
    weights::{Faa, Weights},
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlannerKind {
    /// The paper's MPC with Forcing Attitude Alignment.
    MpcFaa,
    /// Alight's own planner: position, velocity and attitude match the deck's at a chosen time.
    #[default]
    Alight,
}

impl PlannerKind {
    pub const fn name(self) -> &'static str {
        match self {
            PlannerKind::MpcFaa => "mpc-faa",
            PlannerKind::Alight => "alight",
        }
    }
}

config! {
    /// Rotor limits and their division among the four virtual inputs.
    ///
    /// Defaults: Alight's, because the paper publishes none. Lowest speed: (875 rpm / 3420 rpm)², from ctu-mrs `t650`.
    /// Slew: from hover to twice hover in 0.1 s, three time constants of a motor; with half of that value a third of a
    /// landing's problems reached a limit. Tilt input 0.3: 12 rad/s² with the default drone, more than an autopilot's
    /// attitude loop can follow.
    #[derive(Copy)]
    pub struct RotorLimits {
        /// Minimum squared speed of a rotor, relative to hover.
        pub lowest: f64 = 0.065, in 0.0..=0.5;
        /// Change of a rotor's squared speed per second, relative to hover.
        pub slew_per_s: f64 = 10.0, in 0.5..=100.0;
        /// Maximum magnitude of the virtual inputs roll and pitch, each.
        pub tilt_input: f64 = 0.3, in 0.01..=0.4;
        /// Maximum magnitude of the virtual input yaw. Thrust gets the remainder.
        pub yaw_input: f64 = 0.25, in 0.01..=0.4;
        /// Fractions of the slew for thrust, for roll and pitch each, and for yaw; thrust + 2 x tilt + yaw at most 1.
        pub slew_fractions: [f64; 3] = [0.4, 0.25, 0.1], in 0.01..=0.9;
    }
    check |this, at| {
        let [thrust, tilt, yaw] = this.slew_fractions;
        at.require(
            thrust + 2.0 * tilt + yaw <= 1.0 + 1e-9,
            "slew_fractions",
            format!("{:?}", this.slew_fractions),
            "thrust + 2 x tilt + yaw at most 1",
        )?;
    }
}

impl RotorLimits {
    /// Bounds of the virtual inputs thrust (lower, upper), tilt and yaw that keep every rotor within `[lowest,
    /// highest]` in any combination: each rotor is `1 + (nu0 +- nu1 +- nu2 +- nu3) / 2`. Tilt and yaw shrink together
    /// if a weak drone would otherwise have no thrust left. Tilt is about the axes of NED, not of the body; a rotation
    /// by the heading keeps `|nu1| + |nu2|` within `2 tilt`, because the corner of the box has the same sum.
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
    /// Bounds on the change of the thrust, roll, pitch and yaw inputs per step, as fractions of the rotors' slew.
    pub fn slew(&self, step_s: f64) -> [f64; 4] {
        let all = 2.0 * self.slew_per_s * step_s;
        let [thrust, tilt, yaw] = self.slew_fractions;
        [thrust * all, tilt * all, tilt * all, yaw * all]
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotorBounds {
    pub thrust: [f64; 2],
    pub tilt: f64,
    pub yaw: f64,
}

config! {
    /// Soft limits of the states.
    ///
    /// Defaults: Procházka 2024, Table 4. The costs of slack are Alight's: large compared with a metre of position
    /// error (30), small compared with FAA's largest weight (50000 per rad²).
    #[derive(Copy)]
    pub struct StateLimits {
        /// Roll and pitch, deg.
        pub tilt_deg: f64 = 45.0, in 5.0..=60.0;
        /// Horizontal velocity per axis, m/s.
        pub horizontal_mps: f64 = 8.0, in 1.0..=30.0;
        /// Vertical velocity, m/s.
        pub vertical_mps: f64 = 4.0, in 0.5..=15.0;
        /// Euler rates, rad/s.
        pub rates_rps: f64 = 2.0, in 0.2..=10.0;
        /// Linear cost of exceeding a limit by 100 %.
        pub slack_linear: f64 = 1e4, in 1.0..=1e7;
        /// Quadratic cost of exceeding a limit by 100 %.
        pub slack_quadratic: f64 = 1e4, in 0.0..=1e7;
    }
}

config! {
    /// Limits on how references approach their target.
    ///
    /// Chosen: within the "fast" constraint set of ctu-mrs (8 m/s and 4 m/s² horizontal, 4 and 2 vertical); yaw is
    /// limited by the small drag moment of the rotors.
    #[derive(Copy)]
    pub struct Shaping {
        /// Horizontal speed relative to the target, m/s.
        pub horizontal_mps: f64 = 7.0, in 0.5..=30.0;
        /// Horizontal acceleration, m/s².
        pub horizontal_mps2: f64 = 2.5, in 0.2..=10.0;
        /// Vertical speed, m/s.
        pub vertical_mps: f64 = 3.0, in 0.2..=10.0;
        /// Vertical acceleration, m/s².
        pub vertical_mps2: f64 = 1.5, in 0.1..=10.0;
        /// Yaw rate, rad/s.
        pub yaw_rps: f64 = 0.8, in 0.05..=4.0;
        /// Yaw acceleration, rad/s².
        pub yaw_rps2: f64 = 0.25, in 0.02..=10.0;
        /// Time constant of the final exponential part, s.
        #[serde(alias = "settle_s")]
        pub time_constant_s: f64 = 0.8, in 0.1..=5.0;
    }
}

config! {
    /// Differences above which the plan restarts from the measured state instead of the previous plan.
    ///
    /// Chosen: well above tracking errors in gusts and below a visible jump.
    #[derive(Copy)]
    pub struct Reset {
        /// Horizontal distance, m.
        pub horizontal_m: f64 = 1.0, in 0.05..=100.0;
        /// Horizontal speed difference, m/s.
        pub horizontal_mps: f64 = 1.5, in 0.05..=100.0;
        /// Vertical distance, m.
        pub vertical_m: f64 = 0.8, in 0.05..=100.0;
        /// Vertical speed difference, m/s.
        pub vertical_mps: f64 = 1.5, in 0.05..=100.0;
        /// Heading difference, deg.
        pub yaw_deg: f64 = 30.0, in 1.0..=180.0;
        /// Maximum age of the last plan, s.
        pub age_s: f64 = 0.5, in 0.05..=10.0;
        /// Maximum height above the drone at which a landing's plan starts, m.
        pub ahead_m: f64 = 0.0, in 0.0..=100.0;
        /// Maximum amount by which the drone's sink rate exceeds that at the start of a landing's plan, m/s.
        pub ahead_mps: f64 = 0.1, in 0.0..=100.0;
    }
}

config! {
    /// The planner.
    ///
    /// Defaults: horizon, rates, R and landing weights: Procházka 2024, section III and Table 4. The weights of
    /// NAVIGATION and FOLLOW are unpublished; these and all other values are Alight's.
    pub struct PlannerConfig {
        /// Kind of the planner.
        pub kind: PlannerKind = PlannerKind::Alight;
        /// Stages of the horizon.
        pub stages: usize = 20;
        /// Time between stages, s.
        pub step_s: f64 = 0.1, in 0.02..=0.5;
        /// Solves per second in NAVIGATION.
        pub navigation_hz: f64 = 10.0, in 1.0..=100.0;
        /// Solves per second in FOLLOW and LANDING.
        pub landing_hz: f64 = 50.0, in 1.0..=100.0;
        /// R: weight of squared increments of the normalised squared rotor speeds.
        pub increment_weight: f64 = 0.1, in 1e-4..=1e4;
        /// Weights in NAVIGATION.
        pub navigation: Weights = Weights {
                vertical: 40.0,
                tilt: 20.0,
                rates: 10.0,
                horizontal_velocity: 5.0,
                vertical_velocity: 40.0,
                ..Weights::default()
            }, table;
        /// Weights in FOLLOW.
        pub follow: Weights = Weights {
                vertical: 40.0,
                horizontal_velocity: 10.0,
                vertical_velocity: 40.0,
                ..Weights::default()
            }, table;
        /// Weights in LANDING, far from the deck.
        pub landing: Weights;
        /// Increase of the weights near the deck (`mpc-faa` only).
        pub faa: Faa;
        /// Touchdown time, descent profile and weights of the rendezvous (`alight` only).
        pub rendezvous: RendezvousConfig;
        /// Rotor limits, hard.
        pub rotors: RotorLimits;
        /// State limits, soft.
        pub limits: StateLimits;
        /// Limits on how the reference approaches its target.
        pub shaping: Shaping;
        /// Differences above which a plan restarts from the measured state.
        pub reset: Reset;
        /// Depth below the deck's plane at which the reference ends after contact, m.
        pub press_m: f64 = 0.3, in 0.0..=1.0;
    }
    check |this, at| {
        at.require(
            (2..PLAN_STAGES).contains(&this.stages),
            "stages",
            this.stages,
            &format!("2 to {}", PLAN_STAGES - 1),
        )?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotor_bounds_with_any_mix_of_inputs() {
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
            let (mut min, mut max) = (f64::MAX, f64::MIN);
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
                    min = min.min(u);
                    max = max.max(u);
                }
            }
            // The limits are reached but not exceeded.
            assert!((min - limits.lowest).abs() < 1e-12 && (max - highest).abs() < 1e-12);
        }
        let slew = limits.slew(0.1);
        assert!(slew.iter().sum::<f64>() / 2.0 <= limits.slew_per_s * 0.1 + 1e-12);
    }

    #[test]
    fn planner_kind_names() {
        let parse = |s: &str| alight_shared::config::parse::<PlannerConfig>(s, "test").map(|c| c.kind);
        assert_eq!(parse("kind = \"mpc-faa\"").unwrap(), PlannerKind::MpcFaa);
        assert!(
            parse("kind = \"mpc-ne\"").is_err(),
            "baselines fly only in the benchmark"
        );
        assert_eq!(parse("kind = \"alight\"").unwrap(), PlannerKind::Alight);
        assert_eq!(parse("").unwrap(), PlannerKind::Alight);
        assert!(parse("stages = 41").is_err());
        assert!(parse("[faa]\ndistance = \"per-stage\"").is_ok());
        assert!(parse("[rotors]\nslew_fractions = [0.5, 0.3, 0.1]").is_err());
    }
}

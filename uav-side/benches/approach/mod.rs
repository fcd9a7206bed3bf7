//! Closed-loop landing for tests and the benchmark. The drone follows its plan exactly; the deck heaves,
//! rolls and pitches sinusoidally and is predicted without error.
//!
//! The parent module must import `planner`.

use alight_shared::{
    frames::{body_rates, wxyz},
    geometry::{DeckGeometry, DroneGeometry},
    msg::{
        DeckForecast, DeckStage, DroneState, FORECAST_STAGES, Header, MissionState, Plan, Seq, State as Mode,
    },
    node::Node,
    time::{DroneClock, DroneTime, Span, Time},
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    naive,
    planner::{
        Planner, PlannerConfig, PlannerIn,
        model::{MIXER, clearance, discretise},
        mpc_faa::{Mpc, Problem, heading_free},
        qp::CEILING_SLACK_M,
    },
};

#[derive(Clone, Copy, Debug)]
pub struct BenchSea {
    /// Heave, m.
    pub heave: f64,
    /// Roll, rad.
    pub roll: f64,
    /// Pitch, rad.
    pub pitch: f64,
    /// Angular frequency, rad/s.
    pub omega: f64,
    /// Phase, rad.
    pub phase: f64,
}

/// Heave of 0.5 m in 5 s, roll of 6 deg, pitch of 8 deg.
pub const MODERATE: BenchSea = BenchSea {
    heave: 0.5,
    roll: 0.10,
    pitch: 0.14,
    omega: 1.2566,
    phase: 0.0,
};
/// Drift of the vessel, m/s, and its heading, rad.
const DRIFT: [f64; 2] = [0.3, -0.2];
const HEADING: f64 = 0.7;
/// Seven metres above the deck's mean level.
pub const ABOVE: [f64; 3] = [20.0, -8.0, -8.3];

impl BenchSea {
    /// Deck at time `t`, s.
    pub fn deck(&self, t: f64) -> DeckStage {
        let wave = |amplitude: f64, phase: f64| {
            let (s, c) = (self.omega * t + self.phase + phase).sin_cos();
            [
                amplitude * s,
                amplitude * self.omega * c,
                -amplitude * self.omega * self.omega * s,
            ]
        };
        let h = wave(self.heave, 0.0);
        let r = wave(self.roll, 1.0);
        let p = wave(self.pitch, 2.2);
        DeckStage {
            position: [20.0 + DRIFT[0] * t, -8.0 + DRIFT[1] * t, -1.3 + h[0]],
            velocity: [DRIFT[0], DRIFT[1], h[1]],
            acceleration: [0.0, 0.0, h[2]],
            euler: [r[0], p[0], HEADING],
            euler_rates: [r[1], p[1], 0.0],
            ..DeckStage::default()
        }
    }
    /// Perfect forecast over 2 s.
    pub fn forecast(&self, now: DroneTime, sequence: u32) -> DeckForecast {
        let step = Span::from_millis(50);
        DeckForecast {
            header: Header::new(1, 1, 1, sequence, now),
            step,
            mean_heading: HEADING,
            mean_z: Some(-1.3),
            stages: Seq::filled((0..FORECAST_STAGES).map(|k| self.deck((now + step * k as i64).secs()))),
            ..DeckForecast::default()
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct BenchContact {
    /// Time since the start of the descent, s.
    pub time_s: f64,
    /// Distance between the centres of the foot plane and the deck, m.
    pub off_m: f64,
    /// Angle between the normals of foot plane and deck, rad.
    pub tilt: f64,
    /// Closing speed along the deck's normal, m/s.
    pub speed_mps: f64,
    /// Time to contact in the last plan, s.
    pub announced_s: Option<f64>,
}

/// Ideal follower that stays exactly on its plan, updated every 10 ms.
pub struct PlanFollower {
    pub drone: DroneState,
    pub plan: Option<Plan>,
    pub tick: i64,
}

impl PlanFollower {
    pub fn new(position: [f64; 3]) -> Self {
        PlanFollower {
            drone: DroneState {
                position,
                ..DroneState::default()
            },
            plan: None,
            tick: 0,
        }
    }
    pub fn now(&self) -> DroneTime {
        Time::from_nanos(self.tick * 10_000_000)
    }
    pub fn header(&self) -> Header<DroneClock> {
        Header::new(1, 1, 1, self.tick as u32 + 1, self.now())
    }
    pub fn follow(&mut self) {
        if let Some(s) = self.plan.as_ref().and_then(|p| p.sample(self.now())) {
            self.drone.position = s.position;
            self.drone.velocity = s.velocity;
            self.drone.attitude = wxyz(&UnitQuaternion::from_euler_angles(
                s.euler[0], s.euler[1], s.euler[2],
            ));
            self.drone.rates = body_rates(s.euler[0], s.euler[1], Vector3::from(s.euler_rates)).into();
        }
        self.drone.header = self.header();
    }
    pub fn end_tick(&mut self, plan: Option<Plan>) {
        self.plan = plan.or(self.plan);
        self.tick += 1;
    }
}

pub struct Approach {
    sea: BenchSea,
    follower: PlanFollower,
    tracking_s: f64,
    pub contact: Option<BenchContact>,
}

impl Approach {
    /// Starts at rest at `from`; the descent begins after `tracking_s`.
    pub fn new(sea: BenchSea, from: [f64; 3], tracking_s: f64) -> Self {
        Approach {
            sea,
            follower: PlanFollower::new(from),
            tracking_s,
            contact: None,
        }
    }

    /// Runs a tick of 10 ms, with the planner run by `step`. Returns None after contact or after 45 s.
    pub fn tick(&mut self, step: impl FnOnce(DroneTime, &PlannerIn) -> Option<Plan>) -> Option<()> {
        if self.contact.is_some() || self.follower.tick > 4500 {
            return None;
        }
        let feet_below = DroneGeometry::default().feet_below_m;
        self.follower.follow();
        let now = self.follower.now();
        let header = self.follower.header();
        let drone = self.follower.drone;
        let t = now.secs();
        let deck = self.sea.deck(t);
        let p = drone.position();
        let up = drone.attitude() * -Vector3::z();
        let gap = clearance(&p, &up, &deck, feet_below);
        if gap <= 0.0 {
            let normal = deck.normal();
            let feet = p - up * feet_below;
            self.contact = Some(BenchContact {
                time_s: t - self.tracking_s,
                off_m: (feet - Vector3::from(deck.position)).norm(),
                tilt: up.dot(&normal).clamp(-1.0, 1.0).acos(),
                speed_mps: -(drone.velocity() - Vector3::from(deck.velocity)).dot(&normal),
                announced_s: self
                    .follower
                    .plan
                    .and_then(|p| p.touchdown_at)
                    .map(|at| (at - now).secs()),
            });
            return None;
        }
        let (state, descent_mps) = if t < self.tracking_s {
            (Mode::Tracking, 0.0)
        } else if gap > 0.8 {
            (Mode::Descent, 1.0)
        } else {
            (Mode::Flare, 0.5)
        };
        let input = PlannerIn {
            forecast: (self.follower.tick % 2 == 0).then(|| self.sea.forecast(now, header.sequence)),
            mission: Some(MissionState {
                header,
                state,
                height_m: 7.0,
                descent_mps,
                minimum_altitude_m: 1.5,
                ..MissionState::default()
            }),
            drone: Some(drone),
        };
        let plan = step(now, &input);
        self.follower.end_tick(plan);
        Some(())
    }

    /// Flies the landing; `see` is called after each plan.
    pub fn land(self, config: &PlannerConfig, see: impl FnMut(&Planner, &Plan)) -> Option<BenchContact> {
        let drone = DroneGeometry::default();
        let deck = DeckGeometry::default();
        self.land_with(Planner::new(config, &drone, &deck, 1), see)
    }

    pub fn land_with(
        mut self,
        mut planner: Planner,
        mut see: impl FnMut(&Planner, &Plan),
    ) -> Option<BenchContact> {
        while self
            .tick(|now, input| {
                let plan = planner.step(now, input).plan;
                if let Some(plan) = &plan {
                    see(&planner, plan);
                }
                plan
            })
            .is_some()
        {}
        self.contact
    }
}

/// This problem for the naive solver, with virtual inputs and equal limits.
pub fn naive_data<'a>(config: &PlannerConfig, mpc: &Mpc, problem: &'a Problem) -> naive::Data<'a> {
    let (a, b) = heading_free(&DroneGeometry::default()).continuous();
    let mixer = nalgebra::SMatrix::<f64, 4, 4>::from_fn(|i, j| MIXER[i][j]);
    let full = discretise(&a, &(b * mixer.transpose()), config.step_s);
    let (x, y, z, yaw) = mpc.limits();
    let l = &config.limits;
    let inf = f64::INFINITY;
    let v = l.horizontal_mps;
    let w = l.rates_rps;
    let t = l.tilt_deg.to_radians();
    naive::Data {
        a: full.a,
        b: full.b,
        state: problem.state,
        input: problem.input,
        reference: &problem.reference,
        weight: &problem.weight,
        ceiling: &problem.ceiling,
        increment_weight: config.increment_weight,
        lowest: [z.input[0], y.input[0], x.input[0], yaw.input[0]],
        highest: [z.input[1], y.input[1], x.input[1], yaw.input[1]],
        slew: [z.slew, y.slew, x.slew, yaw.slew],
        limit: [inf, inf, inf, t, t, inf, v, v, l.vertical_mps, w, w, w],
        slack: [l.slack_linear, l.slack_quadratic],
        ceiling_slack: CEILING_SLACK_M,
        tolerance: 1e-8,
    }
}

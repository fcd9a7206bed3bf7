//! References of the plan in each mission state (Procházka et al. 2024, section IV): the predicted deck with a height
//! profile, and a reference governor for distant targets.

mod bounds;

use alight_shared::{
    frames::wrap_angle,
    geometry::{DeckGeometry, DroneGeometry},
    msg::{DeckForecast, DeckStage, MissionState, State as Mode},
    time::{DroneClock, Span, Time},
};
use nalgebra::{Rotation2, Vector2};

use super::{
    config::{PlannerConfig, Shaping},
    governor::{GovernedMotion, Pace, ReferenceGovernor},
    model::{ModelState, angular_velocity, clearance, state, tilt_of, up_of},
    mpc_faa::Problem,
    view::View,
    weights::Weights,
};
use crate::{
    contingency::{BELOW_M, Climb, NEAR_DECK_M, escape_velocity},
    surroundings::{Passage, way_round},
};

/// Deceleration of an aborted descent, m/s².
const ABORTED_DESCENT_MPS2: f64 = 6.0;
/// Distance to the vessel below which the heading towards it is undefined, m.
const HEADING_FROM_M: f64 = 2.0;

/// Rate at which a station rotates about the deck's centre, rad/s; 0 for other places.
fn station_turns_radps(view: &View) -> f64 {
    let forecast = view.forecast.as_ref().filter(|_| view.mission.station.is_some());
    forecast.map_or(0.0, |f| f.mean_heading_rate)
}

/// Deck of the references, and requirements on the plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanReference {
    pub touch: bool,
    /// Current clearance of the foot plane above the deck, m; infinite while no deck is known.
    pub clearance_m: f64,
    /// Weight of the tilt at the first stage.
    pub alignment: f64,
    /// Deck now and at each stage; empty if unknown.
    pub deck: Vec<DeckStage>,
    /// Minimum height above the water outside the deck's outline, m.
    pub minimum_altitude_m: f64,
    /// Minimum clearance of the feet above the deck in a plan, m; None without a limit.
    pub lowest_clearance_m: Option<f64>,
    /// NED z, m; 0 if unknown.
    pub mean_z: f64,
    /// Volumes around the deck, with the side on which the plan passes.
    pub(super) passages: Vec<Passage>,
}

#[derive(Clone, Debug, Default)]
pub struct ReferenceGenerator {
    config: PlannerConfig,
    drone: DroneGeometry,
    deck: DeckGeometry,
    horizontal: ReferenceGovernor<2>,
    vertical: ReferenceGovernor<1>,
    yaw: ReferenceGovernor<1>,
    /// Position and heading to hold while the deck is unknown.
    frozen: Option<[f64; 4]>,
    admitted: bool,
}

struct Request<'a> {
    now: Time<DroneClock>,
    view: &'a View,
    goal: Goal,
    /// Position and heading of [`Goal::Hold`], m, rad.
    hold: [f64; 4],
    mean_z: Option<f64>,
    start: ModelState,
    reference: &'a PlanReference,
}

impl Request<'_> {
    fn near_deck(&self) -> bool {
        let aside = |d: &DeckStage| {
            (self.start[state::NORTH] - d.position[0]).hypot(self.start[state::EAST] - d.position[1])
        };
        let over = self
            .reference
            .deck
            .first()
            .is_some_and(|d| aside(d) < NEAR_DECK_M);
        over && self.reference.clearance_m < NEAR_DECK_M
    }
}

impl ReferenceGenerator {
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry, deck: &DeckGeometry) -> Self {
        ReferenceGenerator {
            config: config.clone(),
            drone: *drone,
            deck: *deck,
            ..ReferenceGenerator::default()
        }
    }

    /// Height of the deck above still water, m.
    pub(super) fn deck_height_m(&self) -> f64 {
        -self.deck.centre_m[2]
    }

    pub fn restart(&mut self) {
        self.horizontal = ReferenceGovernor::default();
        self.vertical = ReferenceGovernor::default();
        self.yaw = ReferenceGovernor::default();
        self.frozen = None;
    }

    /// Writes references and weights of the stages at `now + k step`; `problem.state` is the plan's start.
    pub fn write(
        &mut self,
        now: Time<DroneClock>,
        view: &View,
        problem: &mut Problem,
        reference: &mut PlanReference,
    ) {
        let (stages, step_s, start) = (self.config.stages, self.config.step_s, problem.state);
        let mission = &view.mission;
        reference.minimum_altitude_m = mission.minimum_altitude_m;
        reference.lowest_clearance_m = mission.lowest_clearance_m;
        reference.deck.clear();
        let mean_z = view.forecast.as_ref().and_then(|f| {
            sample_deck(now, f, stages, step_s, &mut reference.deck);
            f.mean_z.filter(|_| !reference.deck.is_empty())
        });
        reference.mean_z = mean_z.unwrap_or(0.0);
        let place = state::position(&start);
        let (p, up) = (place, up_of(start[state::PHI], start[state::THETA]));
        let feet = self.drone.feet_below_m;
        reference.clearance_m = reference
            .deck
            .first()
            .map_or(f64::INFINITY, |d| clearance(&p, &up, d, feet));

        let (goal, weights, hold) = self.goal(mission, mean_z, &start);
        reference.touch = matches!(goal, Goal::Touch) && mission.lowest_clearance_m.is_none();

        problem.reference.clear();
        problem.weight.clear();
        problem.reference.resize(stages, [0.0; 12]);
        problem.weight.resize(stages, weights.diagonal());
        let request = Request {
            now,
            view,
            goal,
            hold,
            mean_z,
            start,
            reference,
        };
        self.horizontal_and_tilt(&request, problem);
        self.height(&request, problem);
        self.heading(&request, problem);
        self.pass(view, &place, reference, problem);
        self.keep_above(reference, problem);
        reference.alignment = problem.alignment();
    }

    fn goal(
        &mut self,
        mission: &MissionState,
        mean_z: Option<f64>,
        start: &ModelState,
    ) -> (Goal, Weights, [f64; 4]) {
        let c = &self.config;
        let (goal, weights) = match mission.state {
            Mode::Idle
            | Mode::Landed
            | Mode::GetAltitude
            | Mode::Hold
            | Mode::GaveUp
            | Mode::Preparing
            | Mode::Countdown
            | Mode::SpinUp
            | Mode::TakeOff
            | Mode::ClimbOut
            | Mode::StandDown => (Goal::Hold, c.navigation),
            Mode::Approach | Mode::Search => (Goal::Above, c.navigation),
            Mode::Tracking | Mode::TrackingStable => (Goal::Above, c.follow),
            Mode::Descent => (Goal::Sink, c.landing),
            Mode::Flare => (Goal::Touch, c.landing),
        };
        let (goal, weights) = match mission.waiting_offset {
            Some(_) if mean_z.is_some() => (Goal::Above, c.navigation),
            Some(_) | None => (goal, weights),
        };
        // The drone flies towards a vessel whose radio is not received.
        let goal = match (mission.state, mean_z) {
            (Mode::Search, None) => Goal::Hold,
            (_, Some(_) | None) => goal,
        };
        if goal != Goal::Hold && mean_z.is_none() {
            // If the deck is unexpectedly unknown, the drone holds its position.
            let here = [state::NORTH, state::EAST, state::DOWN, state::PSI].map(|i| start[i]);
            return (Goal::Hold, weights, *self.frozen.get_or_insert(here));
        }
        self.frozen = None;
        if goal != Goal::Hold {
            return (goal, weights, [0.0; 4]);
        }
        let leaves = mission.with_deck && mean_z.is_some();
        let [x, y, z] = mission.hold_position;
        let goal = if leaves { Goal::Leave } else { Goal::Hold };
        (goal, weights, [x, y, z, mission.hold_yaw])
    }

    /// Next waypoint on the path round the vessel into the approach sector, relative to the deck's centre, m; None
    /// within the sector.
    fn way_round(&mut self, q: &Request<'_>) -> Option<Vector2<f64>> {
        let (forecast, deck) = (q.view.forecast.as_ref()?, q.reference.deck.first()?);
        let from = Vector2::new(
            q.start[state::NORTH] - deck.position[0],
            q.start[state::EAST] - deck.position[1],
        );
        // To a station, which is at an approach height, the mission sets the waypoints itself.
        let stays = q.view.mission.station.is_some();
        if q.goal != Goal::Above || stays || forecast.surroundings.is_open() || from.norm() < NEAR_DECK_M {
            return None;
        }
        let (around, heading) = (&forecast.surroundings, forecast.mean_heading);
        way_round(around, &self.drone, heading, &from, &mut self.admitted)
    }

    /// Horizontal velocity relative to the deck with which the drone leaves, m/s.
    fn escape(&self, q: &Request<'_>) -> Vector2<f64> {
        let (Some(f), Some(deck), Goal::Leave) = (&q.view.forecast, q.reference.deck.first(), q.goal) else {
            return Vector2::zeros();
        };
        let (around, clearance) = (&f.surroundings, q.reference.clearance_m);
        let place = state::position(&q.start);
        escape_velocity(around, deck, &self.drone, &place, clearance)
    }

    fn horizontal_and_tilt(&mut self, q: &Request<'_>, problem: &mut Problem) {
        let (feet, step_s) = (self.drone.feet_below_m, self.config.step_s);
        let (round, out) = (self.way_round(q), self.escape(q));
        let aside = round.unwrap_or_else(|| q.view.mission.waiting_offset.unwrap_or_default().into());
        let turns_radps = station_turns_radps(q.view);
        // Target at stage k (0 is now), and its tilt and tilt rate.
        let target = |k: usize| match (q.goal, q.reference.deck.get(k)) {
            (Goal::Hold, _) | (_, None) => (GovernedMotion::new([q.hold[0], q.hold[1]], [0.0; 2]), [0.0; 4]),
            (Goal::Leave, Some(d)) => {
                // The drone keeps its position in the deck's frame and moves out along the escape direction.
                let time = step_s * k as f64;
                let aside = |i: usize| q.start[i] - q.reference.deck.first().map_or(0.0, |d| d.position[i]);
                let place = [0, 1].map(|i| d.position[i] + aside(i) + out[i] * time);
                let velocity = [0, 1].map(|i| d.velocity[i] + out[i]);
                (GovernedMotion::new(place, velocity), [0.0; 4])
            }
            (Goal::Above | Goal::Sink, Some(d)) => {
                let ([x, y, _], [vx, vy, _]) = (d.position, d.velocity);
                let aside = Rotation2::new(turns_radps * step_s * k as f64) * aside;
                let around = turns_radps * Vector2::new(-aside.y, aside.x);
                let velocity = [vx + around.x, vy + around.y];
                (
                    GovernedMotion::new([x + aside.x, y + aside.y], velocity),
                    [0.0; 4],
                )
            }
            (Goal::Touch, Some(d)) => {
                // The target is a full pose, with the centre of the foot plane above the deck's centre.
                let (n, w) = (d.normal(), angular_velocity(d));
                let turn = w.cross(&n) * feet;
                let (phi, theta) = tilt_of(&n, 0.0);
                let motion = GovernedMotion::new(
                    [d.position[0] + feet * n.x, d.position[1] + feet * n.y],
                    [d.velocity[0] + turn.x, d.velocity[1] + turn.y],
                );
                (motion, [phi, theta, w.x, w.y])
            }
        };
        let s = self.config.shaping;
        let pace = Pace {
            speed: s.horizontal_mps,
            acceleration: s.horizontal_mps2,
            time_constant_s: s.time_constant_s,
        };
        let start = GovernedMotion::new(
            [q.start[state::NORTH], q.start[state::EAST]],
            [q.start[state::V_NORTH], q.start[state::V_EAST]],
        );
        let follows = q.goal.follows_deck();
        // A waypoint that moves ahead of the drone is approached rather than followed.
        let jump_m = if round.is_some() { 0.0 } else { 0.5 };
        if q.goal == Goal::Leave {
            self.horizontal = ReferenceGovernor::default();
        }
        self.horizontal
            .update(q.now, follows, &target(0).0, &start, &pace, [jump_m, 3.0]);
        let mut governor = self.horizontal.gap;
        for (k, r) in problem.reference.iter_mut().enumerate() {
            governor.advance(self.config.step_s, &pace);
            let (t, tilt) = target(k + 1);
            for i in 0..2 {
                r[i] = t.place[i] + governor.place[i];
                r[6 + i] = t.velocity[i] + governor.velocity[i];
                r[3 + i] = tilt[i];
                r[9 + i] = tilt[2 + i];
            }
        }
    }

    fn height(&mut self, q: &Request<'_>, problem: &mut Problem) {
        match q.goal {
            Goal::Hold | Goal::Leave | Goal::Above => {
                let z = match (q.goal, q.mean_z) {
                    (Goal::Above, Some(mean)) => mean - q.view.mission.height_m,
                    _ => q.hold[2],
                };
                let z = z.min(-q.view.mission.minimum_altitude_m);
                if q.near_deck() && q.start[state::DOWN] > z + BELOW_M {
                    self.climb(q, z, problem);
                } else {
                    self.approach_height(q, z, problem);
                }
            }
            Goal::Sink | Goal::Touch => self.sink(q, problem),
        }
    }

    /// References that climb from a nearby deck to the height `z`.
    fn climb(&mut self, q: &Request<'_>, z: f64, problem: &mut Problem) {
        self.vertical = ReferenceGovernor::default();
        let mut climb = Climb::new(q.start[state::DOWN], q.start[state::V_DOWN], &self.drone);
        for (r, deck) in problem.reference.iter_mut().zip(&q.reference.deck) {
            climb.advance(self.config.step_s, deck.velocity[2]);
            (r[2], r[8]) = (climb.z.max(z), climb.velocity);
        }
    }

    fn approach_height(&mut self, q: &Request<'_>, z: f64, problem: &mut Problem) {
        let s = self.config.shaping;
        // When a descent is aborted over a rising deck, its sink rate is braked as hard as in a descent; the climb is
        // gentle.
        let sinks = matches!(q.goal, Goal::Hold | Goal::Leave)
            && q.start[state::V_DOWN] > 0.3
            && q.start[state::DOWN] > z - 1.0;
        let pace = Pace {
            speed: s.vertical_mps,
            acceleration: if sinks {
                ABORTED_DESCENT_MPS2
            } else {
                s.vertical_mps2
            },
            time_constant_s: s.time_constant_s,
        };
        let (target, start) = (
            GovernedMotion::new([z], [0.0]),
            GovernedMotion::new([q.start[state::DOWN]], [q.start[state::V_DOWN]]),
        );
        self.vertical
            .update(q.now, true, &target, &start, &pace, [0.3, 1.5]);
        let mut governor = self.vertical.gap;
        for r in &mut problem.reference {
            governor.advance(self.config.step_s, &pace);
            r[2] = z + governor.place[0];
            r[8] = governor.velocity[0];
        }
    }

    /// References that sink at constant speed relative to the predicted deck.
    fn sink(&mut self, q: &Request<'_>, problem: &mut Problem) {
        let (feet, step_s, mission) = (self.drone.feet_below_m, self.config.step_s, &q.view.mission);
        self.vertical = ReferenceGovernor::default();
        let contact_z = |k: usize| {
            q.reference.deck.get(k).map(|d| match q.goal {
                Goal::Touch => {
                    let n = d.normal();
                    let turn = angular_velocity(d).cross(&n) * feet;
                    (d.position[2] + feet * n.z, d.velocity[2] + turn.z)
                }
                Goal::Sink | Goal::Hold | Goal::Leave | Goal::Above => (d.position[2] - feet, d.velocity[2]),
            })
        };
        let start_at = contact_z(0).map_or(0.0, |(z, _)| z - q.start[state::DOWN]);
        let profile = Profile::new(start_at, mission.descent_mps, self.config.press_m);
        for (k, r) in problem.reference.iter_mut().enumerate() {
            let Some((z, vz)) = contact_z(k + 1) else {
                continue;
            };
            let (mut clearance, mut sinking) = profile.at(step_s * (k as f64 + 1.0));
            if let Some(lowest) = mission.lowest_clearance_m.filter(|l| clearance < *l) {
                (clearance, sinking) = (lowest, 0.0);
            }
            r[2] = z - clearance;
            r[8] = vz + sinking;
        }
    }

    fn heading(&mut self, q: &Request<'_>, problem: &mut Problem) {
        let mean = q.view.forecast.as_ref().map_or(q.hold[3], |f| f.mean_heading);
        let deck = &q.reference.deck;
        let far = deck.first().map(|d| {
            Vector2::new(
                d.position[0] - q.start[state::NORTH],
                d.position[1] - q.start[state::EAST],
            )
        });
        let target = |k: usize| match (q.goal, deck.get(k)) {
            (Goal::Hold | Goal::Leave, _) | (_, None) => (q.hold[3], 0.0),
            (Goal::Touch, Some(d)) => (d.euler[2], d.euler_rates[2]),
            (Goal::Above | Goal::Sink, Some(_)) => match (q.view.mission.state, far) {
                (Mode::Approach, Some(far)) if far.norm() > HEADING_FROM_M => (far.y.atan2(far.x), 0.0),
                _ => (mean, 0.0),
            },
        };
        let Shaping {
            yaw_rps,
            yaw_rps2,
            time_constant_s,
            ..
        } = self.config.shaping;
        let pace = Pace {
            speed: yaw_rps,
            acceleration: yaw_rps2,
            time_constant_s,
        };
        let (psi, rate) = target(0);
        // Target heading closest to the plan's, so that the drone takes the shorter rotation.
        let first = q.start[state::PSI] + wrap_angle(psi - q.start[state::PSI]);
        let start = GovernedMotion::new([q.start[state::PSI]], [q.start[state::PSI_DOT]]);
        self.yaw.update(
            q.now,
            true,
            &GovernedMotion::new([first], [rate]),
            &start,
            &pace,
            [0.1, 0.6],
        );
        let mut governor = self.yaw.gap;
        for (k, r) in problem.reference.iter_mut().enumerate() {
            governor.advance(self.config.step_s, &pace);
            let (psi_k, rate) = target(k + 1);
            r[5] = first + wrap_angle(psi_k - psi) + governor.place[0];
            r[11] = rate + governor.velocity[0];
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Goal {
    Hold,
    /// Climb at a constant position relative to the deck.
    Leave,
    /// Stay above the deck at a height above its mean level.
    Above,
    /// Sink towards the deck, level.
    Sink,
    /// Land, aligned with the deck.
    Touch,
}

impl Goal {
    fn follows_deck(self) -> bool {
        match self {
            Goal::Hold => false,
            Goal::Leave | Goal::Above | Goal::Sink | Goal::Touch => true,
        }
    }
}

/// Height above the deck as a function of time: constant speed to contact, then an exponential decay below the deck's
/// plane, which keeps pressure on the contact.
#[derive(Clone, Copy, Debug)]
struct Profile {
    /// Current clearance; below contact, that of a descent without the decay.
    unslowed_m: f64,
    speed_mps: f64,
    press_m: f64,
}

impl Profile {
    fn new(clearance_m: f64, speed_mps: f64, press_m: f64) -> Self {
        let press_m = press_m.max(1e-3);
        let unslowed_m = if clearance_m < 0.0 {
            press_m * (1.0 + clearance_m / press_m).max(1e-3).ln()
        } else {
            clearance_m
        };
        Profile {
            unslowed_m,
            speed_mps,
            press_m,
        }
    }
    /// Clearance (m) and sink rate relative to the deck (m/s) after `time_s`.
    fn at(&self, time_s: f64) -> (f64, f64) {
        let s = self.unslowed_m - self.speed_mps * time_s;
        if s >= 0.0 {
            return (s, self.speed_mps);
        }
        let left = (s / self.press_m).exp();
        (-self.press_m * (1.0 - left), self.speed_mps * left)
    }
}

/// Deck now and at each stage. Beyond the forecast the deck continues at constant velocity with its last attitude.
/// Empty if the forecast does not cover `now`.
fn sample_deck(
    now: Time<DroneClock>,
    forecast: &DeckForecast,
    stages: usize,
    step_s: f64,
    out: &mut Vec<DeckStage>,
) {
    let Some(last) = forecast.stages.last() else {
        return;
    };
    let end = forecast.header.at + forecast.step * (forecast.stages.len() as i64 - 1);
    for k in 0..=stages {
        // A forecast stamped ahead of now starts with its first stage.
        let t = (now + Span::from_secs(step_s * k as f64)).max(forecast.header.at);
        let beyond = (t - end).secs();
        if beyond > 0.0 {
            let mut d = *last;
            for i in 0..3 {
                d.position[i] += d.velocity[i] * beyond;
                d.euler_rates[i] = 0.0;
                d.acceleration[i] = 0.0;
            }
            out.push(d);
        } else if let Some(d) = forecast.at(t) {
            out.push(d);
        } else {
            out.clear();
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn height_profile_through_contact() {
        let p = Profile::new(1.0, 0.5, 0.3);
        assert_eq!(p.at(1.0), (0.5, 0.5));
        let (mut before, dt) = (p.at(0.0), 0.01);
        for k in 1..800 {
            let (c, v) = p.at(dt * f64::from(k));
            assert!((before.0 - c - v * dt).abs() < 1e-4 && (before.1 - v).abs() < 0.0085);
            before = (c, v);
        }
        assert!(before.0 > -0.3 && before.0 < -0.29 && before.1 < 0.01);
        // A profile that restarts below contact is unchanged.
        let later = Profile::new(p.at(2.4).0, 0.5, 0.3);
        assert!((later.at(0.3).0 - p.at(2.7).0).abs() < 1e-9);
        assert!(Profile::new(-5.0, 0.5, 0.0).at(1.0).0.is_finite());
    }
}

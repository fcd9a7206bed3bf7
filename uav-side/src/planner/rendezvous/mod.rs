//! Rendezvous planner `alight`: position, velocity and attitude match the deck's at a chosen time.
//!
//! Differences from the paper's planner ([`super::mpc_faa`], whose model and solver it shares):
//! - The touchdown time is chosen within the forecast ([`touchdown_time`]).
//! - The height is a function of the time to contact: a fast descent to just above the deck, then a soft one onto it
//!   ([`profile`]).
//! - The weights of a stage depend on the drone's height *at that stage*, `g = exp(-(h/h0)²)`: attitude, velocity and
//!   position are matched only briefly at contact, because a matched tilt accelerates the drone sideways.
//! - Tilt is planned as the horizontal acceleration that it causes at the planned vertical acceleration and
//!   in the wind, `a = (g - a_z) tan(tilt) + d`, not `g tilt`, so that the plan includes the wind during the
//!   alignment.

pub mod config;
pub mod profile;
pub(crate) mod push;
pub mod touchdown_time;

use alight_shared::{
    geometry::{DroneGeometry, GRAVITY},
    landing::{beyond_aligned, wind_during_alignment},
    msg::{DeckForecast, DeckStage, DroneState, MissionState, Phase, State as Mode},
    time::{DroneClock, Time},
};
use nalgebra::{Vector2, Vector3};

use super::{
    config::PlannerConfig,
    law::{LandingStart, Law, View},
    model::{ModelState, angular_velocity, state, up_of},
    mpc_faa::Problem,
    reference::{PlanReference, ReferenceGenerator},
    weights::FaaDistance,
};
use crate::flatness::aligned_acceleration;
use config::{RendezvousConfig, TouchdownTimeConfig};
use profile::{Height, Profile};
use push::LateralDisturbance;
use touchdown_time::TouchdownTime;

/// Clearance below which the wind is not estimated in a landing, m, because contact forces would disturb the estimate.
const FREE_M: f64 = 0.5;
/// Distance from the deck's centre up to which its plane is followed, m: more than half the width of the default deck.
const MAX_LATERAL_OFFSET_M: f64 = 1.0;
/// Time constant with which the plans of a landing approach the drone's position and velocity, s: a plan accepts a gap
/// that the pilot has not closed by then. It is longer than that of the pilot's loop, so that two loops do not close
/// the same gap, and shorter than the one second from full descent to contact.
const YIELDS_S: f64 = 0.3;
/// Law of `alight`.
#[derive(Clone, Debug)]
pub struct Rendezvous {
    config: RendezvousConfig,
    step_s: f64,
    profile: Profile,
    touchdown_time: TouchdownTime,
    push: LateralDisturbance,
    feet: f64,
    /// Distance from the feet's centre to each foot, m.
    half_span: f64,
}

#[derive(Clone, Copy, Debug)]
struct DescentPlan {
    /// Time to contact now, s; infinite while no contact is permitted.
    left: f64,
    /// Upper bound of the height, m: the drone's current height.
    ceiling: f64,
    /// Lower bound of the height while no contact is permitted, m.
    floor: f64,
    /// Planned position of the feet relative to the deck's centre, NED, m.
    lateral_offset: Vector2<f64>,
    /// Mean height of the deck, NED z, m.
    mean_z: f64,
    /// Wind that accelerates the drone during the alignment, m/s².
    wind: Vector2<f64>,
    /// Height of the target plane above the deck, along its normal, m.
    lifted_m: f64,
    /// Distance of the lowest foot below the feet's centre while the drone tilts against the wind, m.
    lowered_m: f64,
    /// Target of the feet relative to the deck's centre, NED, m.
    meets: Vector2<f64>,
}

impl DescentPlan {
    fn stops_above(&self) -> bool {
        self.lifted_m > 0.0
    }
}

impl Law for Rendezvous {
    /// Updates the disturbance unless the drone may be touching the deck.
    fn observe(
        &mut self,
        drone: Option<&DroneState>,
        _forecast: Option<&DeckForecast>,
        last: &PlanReference,
    ) {
        let near = last.touch && last.clearance_m < FREE_M;
        if let Some(d) = drone {
            self.push.measure(d, !near);
        }
    }
    fn wind(&self) -> Vector2<f64> {
        self.push.measured()
    }
    fn landing_start(&self) -> LandingStart {
        LandingStart {
            measured: self.config.start_from_measured,
            approach_time_s: Some(YIELDS_S),
        }
    }
    fn refine(
        &mut self,
        now: Time<DroneClock>,
        view: &View,
        generator: &ReferenceGenerator,
        problem: &mut Problem,
        reference: &mut PlanReference,
    ) -> Option<f64> {
        let lands = view.mission.state.phase() == Phase::Landing;
        let Some(forecast) = view.forecast.as_ref().filter(|_| lands) else {
            self.touchdown_time.forget();
            return None;
        };
        let water_z = reference.mean_z + generator.deck_height_m();
        self.push.know_water(water_z);
        let left = self.write_references(now, &view.mission, forecast, problem, reference);
        let touches = view.mission.lowest_clearance_m.is_none();
        let left = left.filter(|_| touches);
        reference.touch = left.is_some();
        reference.alignment = problem.alignment();
        generator.keep_above(reference, problem);
        left
    }
    fn attitude(&self, state: &ModelState, vertical: f64) -> (Vector3<f64>, f64) {
        let push = self.push.at(
            state[state::DOWN],
            &Vector2::new(state[state::V_NORTH], state[state::V_EAST]),
        );
        if self.config.true_tilt {
            return true_tilt(state, vertical, &push);
        }
        let wind = push / GRAVITY;
        (
            up_of(state[state::PHI] - wind.y, state[state::THETA] + wind.x),
            1.0,
        )
    }
}

impl Rendezvous {
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry) -> Self {
        Rendezvous {
            config: config.rendezvous,
            step_s: config.step_s,
            profile: Profile::new(&config.rendezvous.profile),
            touchdown_time: TouchdownTime::default(),
            push: LateralDisturbance::default(),
            feet: drone.feet_below_m,
            half_span: 0.5 * drone.feet_span_m[0].hypot(drone.feet_span_m[1]),
        }
    }

    /// Replaces references and weights of position, tilt and height. Returns the planned time to contact, s.
    fn write_references(
        &mut self,
        now: Time<DroneClock>,
        mission: &MissionState,
        forecast: &DeckForecast,
        problem: &mut Problem,
        reference: &PlanReference,
    ) -> Option<f64> {
        let here = reference.deck.first()?;
        let start = problem.state;
        // The drone meets a steep deck off its centre: 0.3 m down a slope of 20 deg its clearance is 0.1 m larger than
        // at the centre.
        let normal = here.normal();
        let lateral_offset = self.lateral_offset(&start, here, &normal);
        let lifted_m = mission.lowest_clearance_m.unwrap_or(0.0);
        let contact = self.contact_z(here, &normal, &lateral_offset, lifted_m);
        let push = self.push.at(contact, &Vector3::from(here.velocity).xy());
        let wind = wind_during_alignment(&push);
        let mean_z = reference.mean_z;
        // Height above the surface that the profile follows.
        let over =
            |fraction: f64| mean_z + fraction * (here.position[2] - mean_z) + (contact - here.position[2]);
        let clearance = over(self.heave_fraction(contact - start[state::DOWN])) - start[state::DOWN];
        let begin = Height {
            clearance,
            sinking: start[state::V_DOWN] - here.velocity[2] * self.heave_fraction(clearance),
        };
        let permitted = mission.descent_mps > 0.0;
        let (left, floor) = if permitted {
            let min_time = self.profile.min_time(clearance, begin.sinking);
            let left = self.profile.left(clearance);
            // Without the tag in view a waiting drone drifts away.
            let flare = mission.state == Mode::Flare;
            let c = &self.config.touchdown_time;
            let window_s = if flare || lifted_m > 0.0 { 0.0 } else { c.window_s };
            let c = TouchdownTimeConfig { window_s, ..*c };
            let left = self
                .touchdown_time
                .choose(now, forecast, &wind, min_time, left, flare, &c);
            (left, f64::NEG_INFINITY)
        } else {
            self.touchdown_time.forget();
            (f64::INFINITY, clearance)
        };
        let way = DescentPlan {
            left,
            ceiling: if lifted_m > 0.0 {
                clearance.max(0.0)
            } else {
                clearance
            },
            floor,
            lateral_offset,
            mean_z,
            wind,
            lifted_m,
            lowered_m: self.half_span * beyond_aligned(&push) / GRAVITY,
            meets: if lifted_m > 0.0 {
                Vector2::zeros()
            } else {
                mission.meets.into()
            },
        };
        let stages = problem.reference.iter_mut().zip(&mut problem.weight);
        for (k, ((r, q), deck)) in stages.zip(reference.deck.iter().skip(1)).enumerate() {
            let time = self.step_s * (k as f64 + 1.0);
            let (wanted, lowest) = (self.wanted(time, &way), self.lowest(&begin, time));
            let height = if lowest.clearance > wanted.clearance {
                lowest
            } else {
                wanted
            };
            self.stage(time, &height, deck, &way, r, q);
        }
        permitted.then_some(left)
    }

    /// Fraction of the deck's heave that the reference follows, 0 to 1: a smooth step between two heights.
    fn heave_fraction(&self, clearance: f64) -> f64 {
        let c = &self.config.profile;
        let s = ((c.mean_above_m - clearance) / (c.mean_above_m - c.heave_below_m)).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    }

    /// Horizontal position of an aligned drone's feet relative to the deck's centre (NED, m), limited to the extent of
    /// the deck.
    fn lateral_offset(&self, state: &ModelState, deck: &DeckStage, n: &Vector3<f64>) -> Vector2<f64> {
        let o = Vector2::from_fn(|i, _| state[i] - deck.position[i] - self.feet * n[i]);
        o * (MAX_LATERAL_OFFSET_M / o.norm().max(MAX_LATERAL_OFFSET_M))
    }

    /// NED z (m) of the centre of mass of an aligned drone that stands at `lateral_offset` from the deck's centre: `z -
    /// (n_x o_x + n_y o_y) / n_z + l n_z` with the normal `n`, the offset `o` and the feet's distance `l`; `lifted_m`
    /// higher along the normal.
    fn contact_z(
        &self,
        deck: &DeckStage,
        n: &Vector3<f64>,
        lateral_offset: &Vector2<f64>,
        lifted_m: f64,
    ) -> f64 {
        let up = (-n.z).max(0.3);
        deck.position[2] + (n.xy().dot(lateral_offset) - lifted_m) / up + self.feet * n.z
    }

    /// Height of the profile at `time`, limited to what the drone can follow.
    fn wanted(&self, time: f64, way: &DescentPlan) -> Height {
        let wanted = if way.stops_above() && way.left < time {
            Height {
                clearance: 0.0,
                sinking: 0.0,
            }
        } else if way.left.is_finite() {
            self.profile.at(way.left - time)
        } else {
            Height {
                clearance: way.floor,
                sinking: 0.0,
            }
        };
        if wanted.clearance > way.ceiling {
            return Height {
                clearance: way.ceiling,
                sinking: 0.0,
            };
        }
        wanted
    }

    /// Minimum height reachable `time` after `h` with bounded acceleration. If the reference fell faster, the rotors
    /// would have too little thrust to hold the position.
    fn lowest(&self, h: &Height, time: f64) -> Height {
        let c = &self.config.profile;
        let max = (c.sink_mps + c.hurry_mps).max(h.sinking);
        let until = ((max - h.sinking) / c.acceleration_mps2).min(time);
        let fallen = h.sinking * until + 0.5 * c.acceleration_mps2 * until * until;
        Height {
            clearance: h.clearance - fallen - max * (time - until),
            sinking: h.sinking + c.acceleration_mps2 * until,
        }
    }

    /// Reference `r` and weights `q` of the stage at `time` from now.
    fn stage(
        &self,
        time: f64,
        h: &Height,
        deck: &DeckStage,
        way: &DescentPlan,
        r: &mut ModelState,
        q: &mut ModelState,
    ) {
        let c = &self.config;
        let fraction = self.heave_fraction(h.clearance);
        let n = deck.normal();
        let spin = angular_velocity(deck);
        let turn = spin.cross(&n) * self.feet;
        let contact = self.contact_z(deck, &n, &way.lateral_offset, way.lifted_m);
        let (tilt, gain) = if c.true_tilt {
            let gain = (GRAVITY - deck.acceleration[2]) / GRAVITY;
            (aligned_acceleration(deck, &n) / GRAVITY, gain)
        } else {
            (n.xy() / (-n.z).max(0.3), 1.0)
        };
        for i in 0..2 {
            r[i] = deck.position[i] + way.meets[i] + self.feet * n[i];
            r[6 + i] = deck.velocity[i] + turn[i];
        }
        r[9] = gain * spin.x;
        r[10] = gain * spin.y;
        r[2] = way.mean_z + fraction * (deck.position[2] - way.mean_z) + (contact - deck.position[2])
            - h.clearance;
        r[8] = fraction * deck.velocity[2] + h.sinking;

        // After contact the drone need not match the deck.
        let after = (time - way.left.max(0.0)).max(0.0) / c.after_s;
        let clearance = match c.distance {
            FaaDistance::PerStage => h.clearance,
            FaaDistance::Current => way.ceiling,
        };
        let height = (clearance.max(0.0) / c.near_m).powi(2);
        let near = ((clearance - way.lowered_m).max(0.0) + way.lifted_m) / c.near_m;
        let g = (-near * near - after * after).exp();
        for i in 0..2 {
            q[i] = c.horizontal.at(g);
            q[6 + i] = c.horizontal_velocity.at(g);
            q[3 + i] = c.tilt.at(g);
            q[9 + i] = c.rates.at(g);
        }
        // Near contact the reference is the deck's tilt plus the wind's acceleration; elsewhere it is a small
        // acceleration. a = (-g theta, g phi).
        let contact = c.tilt.contact * g / c.tilt.at(g).max(1e-9);
        let meant = tilt + way.wind * (contact / GRAVITY);
        r[3] = meant.y;
        r[4] = -meant.x;
        // A descent that ends above the deck matches only the deck's height.
        let g = if way.stops_above() { (-height).exp() } else { g };
        q[2] = c.vertical.at(g);
        q[8] = c.vertical_velocity.at(g);
    }
}

/// Upward axis (NED) of the attitude whose thrust gives the planned accelerations, and the factor on tilt rates. The
/// tilt of `state` is horizontal acceleration per g, to which `wind` (m/s²) contributes; `down` is the vertical
/// acceleration (NED, m/s²).
pub fn true_tilt(state: &ModelState, down: f64, wind: &Vector2<f64>) -> (Vector3<f64>, f64) {
    let lift = (GRAVITY - down).max(0.2 * GRAVITY);
    let (x, y) = (
        (-GRAVITY * state[state::THETA] - wind.x) / lift,
        (GRAVITY * state[state::PHI] - wind.y) / lift,
    );
    let up = Vector3::new(x, y, -1.0).normalize();
    (up, GRAVITY / lift * up.z * up.z)
}

//! The situation: every quantity that a transition judges, computed once per step.

use alight_shared::frames::wrap_angle;
use alight_shared::geometry::{DeckGeometry, DroneGeometry, GRAVITY};
use alight_shared::msg::{
    AutopilotMode, AutopilotState, Course, DeckForecast, DeckStage, DroneState, LandedState, LandingMode,
    OwnMission, PLACES, Reason, ReasonCode, VesselLevel, WAITING_DISTANCE_M, WaitingPlace,
};
use alight_shared::time::{DroneClock, Span, Time};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::lift_off::Moments;
use super::limits::{LOST_OUTSIDE_M, exceeds, first_beyond};
use super::reservation::Reservation;
use crate::contingency::ContactOutcomes;
use crate::mission_config::MissionConfig;
use crate::standing::StandingVerdict;
use crate::surroundings::ring_m;
use alight_shared::landing::normal::larger;
use alight_shared::landing::{Odds, Staying};

/// Whether the drone flies and who controls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlState {
    /// No state of the autopilot for too long.
    Unknown,
    Disarmed,
    /// Armed and on the ground.
    OnGround,
    /// Armed, under a pilot's or the autopilot's own control.
    OtherControl(AutopilotMode),
    /// Armed, in the autopilot's hold because set-points ceased: no pilot has taken the drone over.
    Lapsed,
    /// Armed, in the air, following set-points.
    Ours,
}

impl ControlState {
    /// From the autopilot's state; None when it is missing or stale. Where the mission only looks on, whoever flies the
    /// drone flies what it would.
    pub fn of(autopilot: Option<&AutopilotState>, mode: LandingMode) -> Self {
        let Some(a) = autopilot else {
            return ControlState::Unknown;
        };
        if !a.armed {
            return ControlState::Disarmed;
        }
        match (a.mode, a.landed) {
            (_, LandedState::OnGround) if mode == LandingMode::Shadow => ControlState::OnGround,
            _ if mode == LandingMode::Shadow => ControlState::Ours,
            (AutopilotMode::Hold, _) if a.lapsed => ControlState::Lapsed,
            (AutopilotMode::Offboard, LandedState::OnGround) => ControlState::OnGround,
            (AutopilotMode::Offboard, LandedState::InAir | LandedState::Unknown) => ControlState::Ours,
            (
                m
                @ (AutopilotMode::Other | AutopilotMode::Hold | AutopilotMode::Land | AutopilotMode::Return),
                _,
            ) => ControlState::OtherControl(m),
        }
    }
}

/// The drone by its newest odometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnState {
    /// Drone's NED, m.
    pub position: Vector3<f64>,
    /// m/s.
    pub velocity: Vector3<f64>,
    /// rad.
    pub yaw: f64,
}

impl OwnState {
    /// From odometry.
    pub fn of(d: &DroneState) -> Self {
        OwnState {
            position: d.position(),
            velocity: d.velocity(),
            yaw: d.euler().z,
        }
    }
}

/// A vessel that turns faster than this is led sideways by its rudder as no forecast knows, rad/s: 11 deg/s.
const MAX_TURN_RADPS: f64 = 0.2;
/// The deck's motion is judged over this time, s.
const FEASIBLE_S: f64 = 2.0;

/// So long the forecast lags behind a turn, s: the low-pass of the vessel's mean heading rate, and the radio. A vessel at
/// speed `U` that turns at `r` accelerates by `U r` across her course, unforeseen for this long.
const TURN_LAG_S: f64 = 1.2;

/// The forecast deck relative to the drone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deck {
    /// Foot plane above the deck along the deck's normal, m.
    pub clearance_m: f64,
    /// Horizontal distance of the centre of mass from the deck's centre, m.
    pub distance_m: f64,
    /// Nearer than this the drone is over the vessel or next to it, m.
    pub ring_m: f64,
    /// The vessel asks drones to leave in a direction.
    pub escapes: bool,
    /// Direction to the deck's centre from north towards east, rad.
    pub bearing_rad: f64,
    /// The vessel's mean heading, rad.
    pub heading_rad: f64,
    /// Centre of the feet in the deck's plane: along and across, m.
    pub feet: Vector2<f64>,
    /// Speed at which the drone comes nearer to the deck, m/s.
    pub closing_mps: f64,
    /// Speed at which the vessel goes away from the drone, m/s.
    pub leaving_mps: f64,
    /// Horizontal speed relative to the deck, m/s.
    pub relative_speed_mps: f64,
    /// Age of the newest vessel estimate, s.
    pub radio_age_s: f64,
    /// Age of the newest vision measurement, s.
    pub vision_age_s: f64,
    /// Age of the newest relative place that may stand in for one, s: confirmed by the tags; infinite without.
    pub relative_age_s: f64,
    /// Speed at which drone and deck come together along its normal, m/s.
    pub sinking_mps: f64,
    /// Maximum predicted horizontal speed over the horizon, m/s.
    pub speed_mps: f64,
    /// Maximum predicted vertical speed over the horizon, m/s.
    pub heave_mps: f64,
    /// Maximum predicted tilt over the horizon, rad.
    pub tilt_rad: f64,
    /// Rate of the vessel's mean heading, rad/s, without a sign: the waves' yaw is no turn.
    pub turn_radps: f64,
    /// By how much the vessel's turn may change the deck's horizontal velocity before the forecast follows, m/s.
    pub turn_mps: f64,
    /// The motion of a vessel that is known by its tags alone is identified; that of another one she knows herself.
    pub identified: bool,
    /// The beacon that may lead to it: the standard deviation of its place, each horizontal axis, m, and its age, s; None, too,
    /// where the mission permits none.
    pub beacon: Option<[f64; 2]>,
    /// Two witnesses of its place or height contradict each other.
    pub contradicted: Option<Reason>,
    /// Outcomes of the landing, completed, and of a climb from now on; None above the commit clearance.
    pub ends: Option<ContactOutcomes>,
}

/// The rangefinder and the camera may disagree about the height by this many standard deviations of both, root mean square over
/// seconds. Chosen: 1 where both err as they state, 2.8 at most in 40 sound landings, 8 with images stamped 0.25 s late.
const MAX_HEIGHT_SD: f64 = 3.0;

/// Which decks are in sight of which one is the vessel's.
pub fn several(forecast: &DeckForecast) -> Option<Reason> {
    let decks = f64::from(forecast.decks_in_sight);
    (decks > 1.0).then(|| Reason::new(ReasonCode::SeveralDecks, decks, 0.0))
}

/// Which two witnesses of the deck contradict each other.
fn contradicted(forecast: &DeckForecast) -> Option<Reason> {
    let elsewhere = forecast
        .place_apart_m
        .and_then(|[apart, limit]| exceeds(ReasonCode::DeckElsewhere, apart, limit));
    let height_sd = forecast.height_nis.map(f64::sqrt);
    elsewhere.or_else(|| exceeds(ReasonCode::HeightContradicted, height_sd?, MAX_HEIGHT_SD))
}

/// Age of the newest relative place that may stand in for a vision measurement, s.
pub fn relative_age_s(forecast: &DeckForecast) -> f64 {
    forecast.relative.map_or(f64::INFINITY, |r| r.stands_in_age_s())
}

impl Deck {
    /// The deck at `now`; None when the forecast does not reach there.
    pub fn of(
        forecast: &DeckForecast,
        own: &OwnState,
        drone: &DroneGeometry,
        attitude: &nalgebra::UnitQuaternion<f64>,
        config: &MissionConfig,
        now: Time<DroneClock>,
    ) -> Option<Deck> {
        // A forecast stamped one tick ahead still covers now.
        let start = now.max(forecast.header.at);
        let here = forecast.at(start)?;
        let centre = Vector3::from(here.position);
        let r = own.position - centre;
        let v = own.velocity - Vector3::from(here.velocity);
        let feet = here.rotation().transpose() * (r + attitude * (Vector3::z() * drone.feet_below_m));

        let clearance_m = here.height_of(&own.position) - drone.feet_below_m;
        let [speed_mps, heave_mps, tilt_rad] = greatest_motion(forecast, start);
        let horizontal = |s: &DeckStage| Vector2::new(s.velocity[0], s.velocity[1]);
        let course: Vector2<f64> = forecast.stages.iter().map(horizontal).sum();
        let turn_radps = forecast.mean_heading_rate.abs();
        let mean_mps = course.norm() / forecast.stages.len().max(1) as f64;
        let to_deck = -r.xy() / r.xy().norm().max(1e-3);
        Some(Deck {
            clearance_m,
            closing_mps: v.xy().dot(&to_deck),
            leaving_mps: Vector3::from(here.velocity).xy().dot(&to_deck),
            distance_m: r.x.hypot(r.y),
            ring_m: ring_m(&forecast.surroundings, drone),
            escapes: forecast.surroundings.escape.is_some(),
            bearing_rad: (-r.y).atan2(-r.x),
            heading_rad: forecast.mean_heading,
            feet: feet.xy(),
            relative_speed_mps: v.x.hypot(v.y),
            radio_age_s: forecast.radio_age_s,
            vision_age_s: if config.vision_required {
                forecast.vision_age_s
            } else {
                forecast.vision_age_s.min(forecast.radio_age_s)
            },
            relative_age_s: relative_age_s(forecast),
            sinking_mps: -here.speed_away(&own.velocity),
            speed_mps,
            heave_mps,
            tilt_rad,
            turn_radps,
            turn_mps: mean_mps * turn_radps * TURN_LAG_S,
            identified: match forecast.vessel_level() {
                VesselLevel::Computer => true,
                VesselLevel::Tag | VesselLevel::Beacon => !forecast.predicted_slopes.is_empty(),
            },
            beacon: forecast
                .beacon
                .filter(|_| config.least_vessel <= VesselLevel::Beacon),
            contradicted: contradicted(forecast),
            ends: (clearance_m < config.commit_clearance_m)
                .then(|| ContactOutcomes::predict(now, forecast, &own.position, &own.velocity, drone))
                .flatten(),
        })
    }
    /// Age of what shows a landing that has begun where the deck is, s: the newest vision measurement, or what stands in for it where
    /// the tags are too near, hidden or too dark to be detected. A landing begins by the tags.
    pub fn located_age_s(&self) -> f64 {
        self.vision_age_s.min(self.relative_age_s)
    }
    /// Next place of the drone on its way to the place at this distance (m) and bearing (rad, from north) from the deck's
    /// centre, NED, m: around the deck, an eighth of a half turn at a time.
    pub fn round(&self, distance_m: f64, bearing_rad: f64) -> [f64; 2] {
        const STEP_RAD: f64 = core::f64::consts::PI / 8.0;
        let own = wrap_angle(self.bearing_rad + core::f64::consts::PI);
        let from = (own / STEP_RAD).round() * STEP_RAD;
        let bearing = from + wrap_angle(bearing_rad - from).clamp(-STEP_RAD, STEP_RAD);
        [distance_m * bearing.cos(), distance_m * bearing.sin()]
    }
    /// Limit that no likelihood overrules: deck motion or tilt beyond what drone and planner follow; `slack` widens it.
    pub fn infeasible(&self, c: &MissionConfig, slack: f64) -> Option<Reason> {
        first_beyond([
            (ReasonCode::Infeasible, self.speed_mps, c.deck_speed_mps * slack),
            (ReasonCode::Infeasible, self.heave_mps, c.deck_heave_mps * slack),
            (ReasonCode::Infeasible, self.turn_radps, MAX_TURN_RADPS * slack),
            (ReasonCode::TooSteep, self.tilt_rad, c.deck_tilt_rad * slack),
        ])
    }
    /// Distance of the centre of the feet outside the part of the deck on which all feet stand, m;
    /// negative inside.
    pub fn outside_m(&self, deck: &DeckGeometry, drone: &DroneGeometry) -> f64 {
        let along = self.feet.x.abs() - 0.5 * (deck.length_m - drone.feet_span_m[0]);
        let across = self.feet.y.abs() - 0.5 * (deck.width_m - drone.feet_span_m[1]);
        along.max(across)
    }
}

/// Maximum horizontal speed and vertical speed, m/s, and tilt, rad, of the deck from `start` on.
fn greatest_motion(forecast: &DeckForecast, start: Time<DroneClock>) -> [f64; 3] {
    let step = forecast.step.secs();
    let since = (start - forecast.header.at).secs();
    let mut greatest = [0.0_f64; 3];
    for (i, s) in forecast.stages.iter().enumerate() {
        let lead = i as f64 * step - since;
        if lead < -step || lead > FEASIBLE_S {
            continue;
        }
        let motion = [
            s.velocity[0].hypot(s.velocity[1]),
            s.velocity[2].abs(),
            angle_from_vertical(s.euler[0], s.euler[1]),
        ];
        for (most, value) in greatest.iter_mut().zip(motion) {
            *most = larger(*most, value);
        }
    }
    greatest
}

/// Angle between a body's down axis and the vertical for roll and pitch, rad.
pub fn angle_from_vertical(roll: f64, pitch: f64) -> f64 {
    (roll.cos() * pitch.cos()).clamp(-1.0, 1.0).acos()
}

/// A vessel that was received, where its last velocity has brought it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentVessel {
    /// From the drone, north and east, m.
    pub offset: Vector2<f64>,
    /// Not received for so long, s.
    pub silent_s: f64,
}

/// The way back from a sortie.
#[derive(Clone, Copy, Debug, Default)]
pub struct SortieEvidence {
    /// Expected place of a vessel that was received before.
    pub seeks: Option<SilentVessel>,
    /// Why the drone turns back now.
    pub turns_back: Option<Reason>,
    /// Time until it does, s; None while that is not known.
    pub turns_in_s: Option<f64>,
    /// Whether the autopilot flies its own mission, or has flown all of it.
    pub own_mission: OwnMission,
}

/// Evidence for a take-off.
#[derive(Clone, Copy, Debug, Default)]
pub struct TakeOffEvidence {
    /// Probability of a take-off now and soon; None while that is not known or not asked for.
    pub lift_off: Option<Moments>,
    /// Height that the drone has risen from the deck since its take-off began, m.
    pub risen_m: f64,
    /// All of that was measured.
    pub rise_measured: bool,
    /// Whether it stands, while it spins up or stands down.
    pub(crate) standing: StandingVerdict,
    /// It has not been witnessed to stand for so long, s.
    pub unwitnessed_s: f64,
    /// Time for which its rotors have turned by the autopilot's report, s.
    pub rotors_turn_s: f64,
    /// In a take-off they have given what lifts it for so long, s; None: the autopilot has not reported its thrust lately.
    pub lifts_s: Option<f64>,
    /// Angle between the drone and the deck that it leaves, a reaction from now, rad.
    pub tips_rad: f64,
}

/// Charge that each place needs from here, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Charges {
    /// Return by the autopilot, and a landing there.
    pub home: f64,
    /// Landing in place.
    pub here: f64,
    /// Attempt to land on the deck from above it.
    pub attempt: f64,
}

/// The situation that a transition judges.
#[derive(Clone, Copy, Debug)]
pub struct Situation {
    pub now: Time<DroneClock>,
    /// Whether the drone flies and who controls it.
    pub flight: ControlState,
    /// Why the autopilot as it is permits no landing; None when it does.
    pub rejection: Option<Reason>,
    /// The drone's frame has moved, and no forecast has come since.
    pub moved: Option<Reason>,
    /// Several decks are in sight, of which one is the vessel's.
    pub several: Option<Reason>,
    /// Remaining battery that counts; None when not reported.
    pub battery: Option<f64>,
    /// Reserve that has to be left of it, 0 to 1.
    pub battery_reserve: f64,
    /// Charge that each place to land needs.
    pub charges: Charges,
    /// The newest odometry.
    pub own: Option<OwnState>,
    /// Age of the odometry, s.
    pub odometry_age_s: f64,
    /// Oldest useful odometry, s.
    pub odometry_limit_s: f64,
    /// The deck; None when there is no forecast that reaches `now`.
    pub deck: Option<Deck>,
    /// The deck's mean level, NED z, m, or the higher one of a witness that contradicts it; None before the first forecast.
    pub mean_deck_z: Option<f64>,
    /// No lower than this, NED z, m, while no second witness confirms the deck's height; None: as low as the state asks.
    pub lowest_z: Option<f64>,
    /// Why no lower.
    pub doubt: Option<Reason>,
    /// Whether a drone that lands now will stay.
    pub staying: Staying,
    /// Tilt of the drone beyond what was commanded lately, rad.
    pub tilt_excess_rad: f64,
    /// Root mean square of what is commanded to and fro besides what plan and wind ask for, rad.
    pub swing_rad: f64,
    /// Probabilities of a landing from here; None while that is not known.
    pub odds: Option<Odds>,
    /// In a simulation alone: a descent begins at this time, however likely it succeeds.
    pub forced_descent: Option<Time<DroneClock>>,
    /// Above this probability waiting for a better moment is not worth its cost.
    pub worth_waiting: f64,
    /// The water's level in the drone's NED, from the deck's mean level, m; 0 until that is known.
    pub water_z: f64,
    /// Age of the forecast, s.
    pub forecast_age_s: f64,
    /// Oldest useful forecast, s.
    pub forecast_limit_s: f64,
    /// Age of the plan, s; infinite without one or when the solver failed.
    pub plan_age_s: f64,
    /// Oldest useful plan, s.
    pub plan_limit_s: f64,
    /// Distance of the feet outside the usable deck, m.
    pub outside_m: f64,
    /// Whether the deck is ours to descend to.
    pub reservation: Reservation,
    /// By the vessel the deck has other dimensions than in the drone's configuration.
    pub other_deck: Option<Reason>,
    /// Course of the vessel as its helm states it, from now on.
    pub course: Course,
    /// Too dark for the camera to detect a tag, or a light blinds it.
    pub dark: Option<Reason>,
    /// Waiting place for the deck; None: it has none, or reserves none.
    pub place: Option<WaitingPlace>,
    /// The other drones that have the waiting places, from the lowest on; 0: free, or its own.
    pub others: [u32; PLACES],
    /// The heights of their stations, m; 0: none.
    pub other_stations_m: [u8; PLACES],
    /// The pilot has stopped the motors.
    pub motors_stopped: bool,
    /// The rotors carry the drone, by the thrust that the autopilot reports; None where it has not reported it lately.
    pub rotors_carry: Option<bool>,
    /// The hardest contact that the pilot has noticed, when it was hard, m/s.
    pub hard_contact_mps: Option<f64>,
    /// Another drone asks for the deck on which this one stands.
    pub deck_wanted: bool,
    /// Why the vessel does not let the drone take off; None: it does.
    pub not_cleared: Option<Reason>,
    /// The autopilot reports the ground.
    pub on_ground: bool,
    /// The charge that a take-off needs, 0 to 1.
    pub battery_for_take_off: f64,
    /// The way back from a sortie.
    pub sortie: SortieEvidence,
    /// Evidence for a take-off.
    pub leaving: TakeOffEvidence,
}

/// A drone that tips on the deck goes on for so long after the thrust was cut, s: a period, the wire and three lags of the
/// rotors.
const TIPS_ON_S: f64 = 0.15;

/// Angle between drone and deck [`TIPS_ON_S`] from `now`, each turning on as it does, rad; 0 where the forecast does not reach.
pub fn tips_rad(forecast: &DeckForecast, drone: &DroneState, now: Time<DroneClock>) -> f64 {
    let at = now.max(forecast.header.at) + Span::from_secs(TIPS_ON_S);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(drone.rates) * TIPS_ON_S);
    let down = drone.attitude() * turn * Vector3::z();
    forecast.at(at).map_or(0.0, |deck| (-deck.normal()).angle(&down))
}

/// Feet this far above the deck do not stand on it, m: several times the forecast's error.
const ABOVE_DECK_M: f64 = 0.5;
/// A drone whose feet are by more than this outside the deck's edges does not rest on it, m: the forecast's error where no
/// camera sees the deck.
const OFF_DECK_M: f64 = 0.6;
/// A drone that moves relative to the deck slides for so long, s.
const SLIDES_S: f64 = 1.0;
/// Rotors that give this much of hover's thrust carry the drone, or most of it.
const CARRYING_OF_HOVER: f64 = 0.7;

/// Whether the rotors carry a drone that hovers at the thrust which the autopilot reports, or else its geometry gives; None
/// where the drone is armed and the autopilot has not reported lately what thrust it gives.
pub fn rotors_carry(a: &AutopilotState, drone: &DroneGeometry) -> Option<bool> {
    if !a.armed {
        return Some(false);
    }
    a.thrust.map(|t| t >= CARRYING_OF_HOVER * hover_thrust(a, drone))
}
/// The thrust that hovers, as the autopilot reports it, or else as the drone's geometry gives it.
pub fn hover_thrust(a: &AutopilotState, drone: &DroneGeometry) -> f64 {
    if a.hover_thrust > 0.0 {
        a.hover_thrust
    } else {
        drone.mass_kg * GRAVITY / drone.max_thrust_n
    }
}

impl Situation {
    /// Why there is no deck.
    pub fn no_deck(&self) -> Reason {
        self.moved.or(self.several).unwrap_or(ReasonCode::NoVessel.into())
    }
    /// Why a detected touchdown does not count: the rotors carry the drone, above the deck when that is known, or off the
    /// deck. Where the thrust is not known, the height above the deck shows it alone.
    pub fn false_touchdown(&self) -> Option<Reason> {
        let above = |m: f64| Reason::new(ReasonCode::FalseTouchdown, m.min(1e3), ABOVE_DECK_M);
        match (self.rotors_carry, self.fresh_deck()) {
            (Some(false), _) | (None, None) => None,
            (Some(true), None) => Some(above(f64::INFINITY)),
            (Some(true), Some(_)) if self.outside_m > OFF_DECK_M => {
                Some(Reason::new(ReasonCode::Deviated, self.outside_m, OFF_DECK_M))
            }
            (Some(true) | None, Some(d)) => (d.clearance_m > ABOVE_DECK_M).then(|| above(d.clearance_m)),
        }
    }
    /// Reason for a drone with its feet on the deck that is beyond its edge, or will be before it is disarmed and at rest.
    pub fn slides(&self) -> Option<Reason> {
        let outside_m = self.outside_m + SLIDES_S * self.fresh_deck()?.relative_speed_mps;
        exceeds(ReasonCode::Deviated, outside_m, LOST_OUTSIDE_M)
    }
    /// Whether a drone that reported its touchdown may fly for all that is known.
    pub fn may_fly(&self) -> bool {
        self.false_touchdown().is_some() || self.rotors_carry.is_none() && self.fresh_deck().is_none()
    }
    /// The height `z` (NED, m), or the lowest that the witnesses of the deck's height allow.
    pub fn no_lower(&self, z: f64) -> f64 {
        self.lowest_z.map_or(z, |lowest| z.min(lowest))
    }
    /// Height of the approach above the deck's mean level: that of its waiting place, m.
    pub fn approach_height_m(&self, c: &MissionConfig) -> f64 {
        c.approach_height_m + self.place.map_or(0.0, |p| p.above_m)
    }
    /// Why the deck is not detected: it is dark where the deck lies in a camera's image, within 45 deg of straight below;
    /// else what is known is that it is not detected.
    pub fn unseen(&self, deck: &Deck) -> Reason {
        let below = deck.distance_m <= deck.clearance_m;
        self.dark.filter(|_| below).unwrap_or(ReasonCode::NoVision.into())
    }
    /// Why it waits off the deck.
    pub fn waits(&self, c: &MissionConfig) -> Option<Reason> {
        self.reservation.rejection().filter(|_| c.reservation_required)
    }
    /// Place where it goes to wait ([`Deck::round`]), or stays while it has no place, from the deck's centre, NED, m.
    pub fn waiting_offset(&self) -> Option<[f64; 2]> {
        let deck = self.fresh_deck()?;
        Some(match self.place {
            Some(place) => deck.round(WAITING_DISTANCE_M, place.bearing_rad),
            None => {
                let own = wrap_angle(deck.bearing_rad + core::f64::consts::PI);
                [deck.distance_m * own.cos(), deck.distance_m * own.sin()]
            }
        })
    }
    /// Why no order to land or to take off counts: the pilot at the remote control holds the drone back.
    pub fn held_back(&self) -> Option<Reason> {
        self.rejection.filter(|why| why.code == ReasonCode::SwitchAborts)
    }
    /// The deck, when forecast and odometry are fresh.
    pub fn fresh_deck(&self) -> Option<&Deck> {
        if self.forecast_age_s <= self.forecast_limit_s && self.odometry_age_s <= self.odometry_limit_s {
            self.deck.as_ref()
        } else {
            None
        }
    }
    /// The feet above that deck, m; 0 where it is not known.
    pub fn clearance_m(&self) -> f64 {
        self.fresh_deck().map_or(0.0, |d| d.clearance_m)
    }
}

//! Situation: every quantity that transitions depend on, computed once per step.

use alight_shared::{
    frames::wrap_angle,
    geometry::{DroneGeometry, GRAVITY},
    msg::{
        AutopilotMode, AutopilotState, Course, DeckForecast, DeckStage, DroneState, LandedState, LandingMode,
        OwnMission, PLACES, Reason, ReasonCode, VesselLevel, WAITING_DISTANCE_M, WaitingPlace,
    },
    time::{DroneClock, Span, Time},
};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::{
    lift_off::Moments,
    limits::{LOST_OUTSIDE_M, exceeds, first_beyond},
    reservation::Reservation,
};
use crate::{
    contingency::{ContactOutcomes, slide},
    mission_config::MissionConfig,
    standing::StandingVerdict,
    surroundings::ring_m,
};
use alight_shared::landing::{Odds, Staying, normal::larger};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlState {
    Unknown,
    Disarmed,
    OnGround,
    /// Armed, controlled by a pilot or by the autopilot itself.
    OtherControl(AutopilotMode),
    /// Armed, in the autopilot's hold after a set-point loss without a takeover.
    SetPointsLost,
    /// Armed, in the air, following set-points.
    Ours,
}

impl ControlState {
    /// Control according to the autopilot's state (None: missing or stale). In shadow mode any control counts as ours.
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
            (_, _) if a.set_points_lost => ControlState::SetPointsLost,
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

/// Position (m) and velocity (m/s) in the drone's NED, and heading (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnState {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub yaw: f64,
}

impl OwnState {
    pub fn of(d: &DroneState) -> Self {
        OwnState {
            position: d.position(),
            velocity: d.velocity(),
            yaw: d.euler().z,
        }
    }
}

/// Turn rate of the vessel above which the acceleration due to the rudder makes the forecast unreliable, rad/s.
const MAX_TURN_RADPS: f64 = 0.2;
/// Time over which the deck's motion is assessed, s.
const FEASIBLE_S: f64 = 2.0;

/// Lag of the forecast behind a turn, s: low-pass of the vessel's mean heading rate, plus radio delay. During this time
/// the acceleration `U r` across the course, at speed `U` and turn rate `r`, is not predicted.
const TURN_LAG_S: f64 = 1.2;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deck {
    /// Height of the foot plane above the deck, along the deck's normal, m.
    pub clearance_m: f64,
    /// Horizontal distance of the centre of mass from the deck's centre, m.
    pub distance_m: f64,
    /// Distance below which the drone is above or next to the vessel, m.
    pub ring_m: f64,
    pub escapes: bool,
    /// Bearing of the deck's centre, from north towards east, rad.
    pub bearing_rad: f64,
    /// The vessel's mean heading, rad.
    pub heading_rad: f64,
    /// Centre of the feet in the deck's plane, along and across, m.
    pub feet: Vector2<f64>,
    /// Slide of the feet along and across the deck after a contact now, m.
    pub slide: Vector2<f64>,
    /// Speed of the drone towards the deck, m/s.
    pub closing_mps: f64,
    /// Speed of the vessel away from the drone, m/s.
    pub leaving_mps: f64,
    /// Horizontal speed relative to the deck, m/s.
    pub relative_speed_mps: f64,
    pub radio_age_s: f64,
    pub vision_age_s: f64,
    /// Age of the newest relative position confirmed by the tags, which may replace vision, s.
    pub relative_age_s: f64,
    /// Closing speed of drone and deck along its normal, m/s.
    pub sinking_mps: f64,
    /// Maximum predicted vertical speed over the horizon, m/s.
    pub heave_mps: f64,
    /// Maximum forecast tilt, rad.
    pub tilt_rad: f64,
    /// Magnitude of the vessel's mean heading rate, rad/s.
    pub turn_radps: f64,
    /// Change of the deck's horizontal velocity due to a turn before the forecast follows, m/s.
    pub turn_mps: f64,
    /// Whether the vessel's motion is reported, or identified from the tags.
    pub identified: bool,
    /// Standard deviation of the beacon's position per axis, m, and its age, s; None without a permitted beacon.
    pub beacon: Option<[f64; 2]>,
    /// Reason if two sources of the deck's position or height contradict each other.
    pub contradicted: Option<Reason>,
    /// Outcomes of landing and of climbing from now on; None above the commit clearance.
    pub ends: Option<ContactOutcomes>,
    pub climb: ClimbRoom,
}

/// Distance from the deck that a climb from now on keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClimbRoom {
    /// More than [`MAY_TOUCH_M`].
    Clear,
    /// Less than that: the last height from which the drone can climb.
    Last,
    /// The climb meets the deck.
    Meets,
}

/// Clearance below which the deck itself may tilt a drone, m: the forecast's error.
pub const MAY_TOUCH_M: f64 = 0.3;
/// Clearance from which any climb is clear, m: a drone that closes at 4 m/s stops within 2.5 m.
const ANY_CLIMB_M: f64 = 3.0;

impl ClimbRoom {
    fn of(
        clearance_m: f64,
        now: Time<DroneClock>,
        forecast: &DeckForecast,
        own: &OwnState,
        drone: &DroneGeometry,
    ) -> Self {
        let meets = |margin_m: f64| {
            let lower = DroneGeometry {
                feet_below_m: drone.feet_below_m + margin_m,
                ..*drone
            };
            let ends = ContactOutcomes::predict(now, forecast, &own.position, &own.velocity, &lower);
            ends.is_some_and(|ends| ends.climb.is_some())
        };
        if clearance_m > ANY_CLIMB_M || !meets(MAY_TOUCH_M) {
            ClimbRoom::Clear
        } else if meets(0.0) {
            ClimbRoom::Meets
        } else {
            ClimbRoom::Last
        }
    }
}

/// Limit of the RMS height difference between rangefinder and camera over seconds, in their standard deviations.
/// Chosen: at most 2.8 in 40 normal landings, 8 with images stamped 0.25 s late.
const MAX_HEIGHT_SD: f64 = 3.0;

/// Reason if several decks are detected and it is unknown which is the own one.
pub fn several(forecast: &DeckForecast) -> Option<Reason> {
    let decks = f64::from(forecast.decks_in_sight);
    (decks > 1.0).then(|| Reason::new(ReasonCode::SeveralDecks, decks, 0.0))
}

fn contradicted(forecast: &DeckForecast) -> Option<Reason> {
    let elsewhere = forecast
        .place_apart_m
        .and_then(|[apart, limit]| exceeds(ReasonCode::DeckElsewhere, apart, limit));
    let height_sd = forecast.height_nis.map(f64::sqrt);
    elsewhere.or_else(|| exceeds(ReasonCode::HeightContradicted, height_sd?, MAX_HEIGHT_SD))
}

/// Age of the newest relative position that may replace vision, s.
pub fn relative_age_s(forecast: &DeckForecast) -> f64 {
    forecast.relative.map_or(f64::INFINITY, |r| r.stands_in_age_s())
}

impl Deck {
    /// Deck at `now`; None if the forecast does not cover it.
    pub fn of(
        forecast: &DeckForecast,
        own: &OwnState,
        drone: &DroneGeometry,
        attitude: &nalgebra::UnitQuaternion<f64>,
        config: &MissionConfig,
        now: Time<DroneClock>,
    ) -> Option<Deck> {
        let start = now.max(forecast.header.at);
        let here = forecast.at(start)?;
        let centre = Vector3::from(here.position);
        let r = own.position - centre;
        let v = own.velocity - Vector3::from(here.velocity);
        let from_ned = here.rotation().transpose();
        let feet = from_ned * (r + attitude * (Vector3::z() * drone.feet_below_m));

        let clearance_m = here.height_of(&own.position) - drone.feet_below_m;
        let [heave_mps, tilt_rad] = max_motion(forecast, start);
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
            slide: slide(&(from_ned * v).xy()),
            relative_speed_mps: v.x.hypot(v.y),
            radio_age_s: forecast.radio_age_s,
            vision_age_s: if config.vision_required {
                forecast.vision_age_s
            } else {
                forecast.vision_age_s.min(forecast.radio_age_s)
            },
            relative_age_s: relative_age_s(forecast),
            sinking_mps: -here.speed_away(&own.velocity),
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
                .filter(|_| config.min_vessel <= VesselLevel::Beacon),
            contradicted: contradicted(forecast),
            ends: (clearance_m < config.commit_clearance_m)
                .then(|| ContactOutcomes::predict(now, forecast, &own.position, &own.velocity, drone))
                .flatten(),
            climb: ClimbRoom::of(clearance_m, now, forecast, own, drone),
        })
    }
    /// Age of the deck's position in a landing, s: by vision, or by the relative position that replaces it while the
    /// tags are too near, hidden or too dark. A landing begins only if the tags are detected.
    pub fn located_age_s(&self) -> f64 {
        self.vision_age_s.min(self.relative_age_s)
    }
    /// Next waypoint (relative to the deck's centre, NED, m) towards the place at this distance (m) and bearing (rad,
    /// from north). The path leads around the deck in steps of 22.5 deg.
    pub fn round(&self, distance_m: f64, bearing_rad: f64) -> [f64; 2] {
        const STEP_RAD: f64 = core::f64::consts::PI / 8.0;
        let own = wrap_angle(self.bearing_rad + core::f64::consts::PI);
        let from = (own / STEP_RAD).round() * STEP_RAD;
        let bearing = from + wrap_angle(bearing_rad - from).clamp(-STEP_RAD, STEP_RAD);
        [distance_m * bearing.cos(), distance_m * bearing.sin()]
    }
    /// Reason if drone and planner cannot follow the deck's motion or tilt. `slack` widens the limits.
    pub fn infeasible(&self, c: &MissionConfig, slack: f64) -> Option<Reason> {
        first_beyond([
            (ReasonCode::Infeasible, self.heave_mps, c.deck_heave_mps * slack),
            (ReasonCode::Infeasible, self.turn_radps, MAX_TURN_RADPS * slack),
            (ReasonCode::TooSteep, self.tilt_rad, c.deck_tilt_rad * slack),
        ])
    }
}

/// Maximum vertical speed, m/s, and maximum tilt, rad, of the deck from `start` on.
fn max_motion(forecast: &DeckForecast, start: Time<DroneClock>) -> [f64; 2] {
    let step = forecast.step.secs();
    let since = (start - forecast.header.at).secs();
    let mut largest = [0.0_f64; 2];
    for (i, s) in forecast.stages.iter().enumerate() {
        let lead = i as f64 * step - since;
        if lead < -step || lead > FEASIBLE_S {
            continue;
        }
        let motion = [s.velocity[2].abs(), angle_from_vertical(s.euler[0], s.euler[1])];
        for (most, value) in largest.iter_mut().zip(motion) {
            *most = larger(*most, value);
        }
    }
    largest
}

/// Angle between a body's down axis and the vertical at this roll and pitch, rad.
pub fn angle_from_vertical(roll: f64, pitch: f64) -> f64 {
    (roll.cos() * pitch.cos()).clamp(-1.0, 1.0).acos()
}

/// Vessel without reception, at the position extrapolated with its last velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SilentVessel {
    /// Offset from the drone, north and east, m.
    pub offset: Vector2<f64>,
    pub silent_s: f64,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct SortieEvidence {
    pub seeks: Option<SilentVessel>,
    pub turns_back: Option<Reason>,
    /// Time until the drone must turn back, s; None if unknown.
    pub turns_in_s: Option<f64>,
    pub own_mission: OwnMission,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct TakeOffEvidence {
    /// Probabilities of a take-off now and soon; None if not needed.
    pub lift_off: Option<Moments>,
    /// Rise of the drone since its take-off began, m.
    pub risen_m: f64,
    pub rise_measured: bool,
    /// Whether the drone stands, in spin-up or stand-down.
    pub(crate) standing: StandingVerdict,
    /// Time since the last evidence that the drone stands, s.
    pub unwitnessed_s: f64,
    /// Time for which the autopilot has reported turning rotors, s.
    pub rotors_turn_s: f64,
    /// Time for which the rotors have been able to lift the drone, s; None without a recent thrust report.
    pub lifts_s: Option<f64>,
    /// Predicted angle between drone and deck one reaction time ahead, rad.
    pub tips_rad: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Charges {
    /// Charge to return by autopilot and land at home.
    pub home: f64,
    /// Whether home is the sea: the vessel is there, or was at the take-off.
    pub home_is_sea: bool,
    /// Charge to land in place.
    pub here: f64,
    /// Charge to fly to the deck and land on it.
    pub deck: f64,
    /// Charge for an attempt to land on the deck from above it.
    pub attempt: f64,
    /// Whether the power behind these charges is known.
    pub known: bool,
}

#[derive(Clone, Copy, Debug)]
pub struct Situation {
    pub now: Time<DroneClock>,
    pub flight: ControlState,
    pub rejection: Option<Reason>,
    /// Reason if the drone's frame has jumped since the forecast.
    pub moved: Option<Reason>,
    /// Reason if several decks are detected and it is unknown which is the own one.
    pub several: Option<Reason>,
    /// Filtered battery charge, 0 to 1; None if not reported.
    pub battery: Option<f64>,
    /// Charge that must remain, 0 to 1.
    pub battery_reserve: f64,
    pub charges: Charges,
    pub own: Option<OwnState>,
    pub odometry_age_s: f64,
    pub odometry_limit_s: f64,
    /// Deck; None without a forecast that reaches `now`.
    pub deck: Option<Deck>,
    /// Mean level of the deck, or of a higher witness that contradicts it, NED z, m.
    pub mean_deck_z: Option<f64>,
    /// Lower limit of the height, NED z, m, until a second source confirms the deck's height.
    pub lowest_z: Option<f64>,
    pub doubt: Option<Reason>,
    pub staying: Staying,
    /// Tilt of the drone beyond the recently commanded one, rad.
    pub tilt_excess_rad: f64,
    /// RMS oscillation of the commanded tilt beyond what plan and wind require, rad.
    pub swing_rad: f64,
    pub odds: Option<Odds>,
    pub forced_descent: Option<Time<DroneClock>>,
    /// Probability above which waiting for a better time does not pay.
    pub worth_waiting: f64,
    /// Level of the water in the drone's NED, m; 0 if unknown.
    pub water_z: f64,
    pub forecast_age_s: f64,
    pub forecast_limit_s: f64,
    /// Age of the plan, s; infinite without a solution.
    pub plan_age_s: f64,
    pub plan_limit_s: f64,
    /// Distance of the feet outside the usable deck, m.
    pub outside_m: f64,
    /// The same after a contact now, once the feet have stopped sliding.
    pub rests_outside_m: f64,
    pub reservation: Reservation,
    /// Reason if the vessel reports different deck dimensions.
    pub other_deck: Option<Reason>,
    pub course: Course,
    /// Reason why the camera cannot detect a tag: darkness or glare.
    pub dark: Option<Reason>,
    /// Waiting place near the deck; None if none is assigned or reservations are not used.
    pub place: Option<WaitingPlace>,
    /// Ids of the other drones in the waiting places, lowest place first; 0: free, or this drone's own.
    pub others: [u32; PLACES],
    /// Heights of the stations of these drones, m; 0: no station.
    pub other_stations_m: [u8; PLACES],
    pub motors_stopped: bool,
    /// Whether the rotors carry the drone, according to the reported thrust; None without a recent report.
    pub rotors_carry: Option<bool>,
    /// Speed of the hardest contact that the pilot has reported as hard, m/s.
    pub hard_contact_mps: Option<f64>,
    /// Whether another drone has requested the deck on which this drone stands.
    pub deck_wanted: bool,
    pub not_cleared: Option<Reason>,
    pub on_ground: bool,
    pub battery_for_take_off: f64,
    pub sortie: SortieEvidence,
    pub leaving: TakeOffEvidence,
}

/// Time for which a drone keeps tipping after the thrust is cut, s: a period, the link, and three rotor lags.
const TIPS_ON_S: f64 = 0.15;

/// Angle between drone and deck [`TIPS_ON_S`] after `now` at their current rates, rad; 0 beyond the forecast.
pub fn tips_rad(forecast: &DeckForecast, drone: &DroneState, now: Time<DroneClock>) -> f64 {
    let at = now.max(forecast.header.at) + Span::from_secs(TIPS_ON_S);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(drone.rates) * TIPS_ON_S);
    let down = drone.attitude() * turn * Vector3::z();
    forecast.at(at).map_or(0.0, |deck| (-deck.normal()).angle(&down))
}

/// Clearance of feet that do not stand on the deck, m: several times the forecast's error.
const ABOVE_DECK_M: f64 = 0.5;
/// Distance outside the deck's edges of feet that do not rest on it, m: the error without a detection.
const OFF_DECK_M: f64 = 0.6;
/// Fraction of hover thrust above which the rotors carry most of the weight.
const CARRYING_OF_HOVER: f64 = 0.7;

/// Whether the rotors carry the drone, from the reported thrust and the hover thrust (the autopilot's, or that of the
/// geometry). None if an armed autopilot has not reported its thrust recently.
pub fn rotors_carry(a: &AutopilotState, drone: &DroneGeometry) -> Option<bool> {
    if !a.armed {
        return Some(false);
    }
    a.thrust.map(|t| t >= CARRYING_OF_HOVER * hover_thrust(a, drone))
}
/// Hover thrust reported by the autopilot, otherwise that of the drone's geometry.
pub fn hover_thrust(a: &AutopilotState, drone: &DroneGeometry) -> f64 {
    if a.hover_thrust > 0.0 {
        a.hover_thrust
    } else {
        drone.mass_kg * GRAVITY / drone.max_thrust_n
    }
}

impl Situation {
    /// Reason why the drone does not follow set-points.
    pub fn not_flying(&self) -> Reason {
        let in_other_mode = matches!(self.flight, ControlState::OtherControl(_));
        Reason::new(ReasonCode::NotFlying, f64::from(u8::from(in_other_mode)), 0.0)
    }
    pub fn no_deck(&self) -> Reason {
        self.moved.or(self.several).unwrap_or(ReasonCode::NoVessel.into())
    }
    /// Reason why a detected touchdown is false: the rotors carry the drone above the deck or outside it. Without a
    /// thrust report the height above the deck decides.
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
    /// Reason if feet on the deck are beyond its edge, or slide beyond it.
    pub fn slides(&self) -> Option<Reason> {
        self.fresh_deck()?;
        let outside_m = self.outside_m.max(self.rests_outside_m);
        exceeds(ReasonCode::Deviated, outside_m, LOST_OUTSIDE_M)
    }
    /// Whether a drone that reported touchdown may still be flying.
    pub fn may_fly(&self) -> bool {
        self.false_touchdown().is_some() || self.rotors_carry.is_none() && self.fresh_deck().is_none()
    }
    /// `z` (NED, m), raised to the limit of the height witnesses.
    pub fn no_lower(&self, z: f64) -> f64 {
        self.lowest_z.map_or(z, |lowest| z.min(lowest))
    }
    /// Approach height above the deck's mean level, m, plus the additional height of the waiting place.
    pub fn approach_height_m(&self, c: &MissionConfig) -> f64 {
        c.approach_height_m + self.place.map_or(0.0, |p| p.above_m)
    }
    /// Reason why the deck is not detected: darkness only if the deck is within 45 deg of straight below.
    pub fn not_detected(&self, deck: &Deck) -> Reason {
        let below = deck.distance_m <= deck.clearance_m;
        self.dark.filter(|_| below).unwrap_or(ReasonCode::NoVision.into())
    }
    pub fn waits(&self, c: &MissionConfig) -> Option<Reason> {
        self.reservation.rejection().filter(|_| c.reservation_required)
    }
    /// Next waypoint to the waiting place (relative to the deck's centre, NED, m), or the current position.
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
    /// Reason to reject any order to land or take off: the remote control's switch.
    pub fn held_back(&self) -> Option<Reason> {
        self.rejection.filter(|why| why.code == ReasonCode::SwitchAborts)
    }
    pub fn fresh_deck(&self) -> Option<&Deck> {
        if self.forecast_age_s <= self.forecast_limit_s && self.odometry_age_s <= self.odometry_limit_s {
            self.deck.as_ref()
        } else {
            None
        }
    }
    /// Clearance of the feet, m; 0 if unknown.
    pub fn clearance_m(&self) -> f64 {
        self.fresh_deck().map_or(0.0, |d| d.clearance_m)
    }
}

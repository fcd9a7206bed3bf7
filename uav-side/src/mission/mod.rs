//! Mission: grants permissions to the planner, with the reason for every restriction.
//!
//! Reading order: `transition` (the state machine as a pure function), `concerns` (interruptions of every state, with
//! `charge`), `states` (the state table), `phase` (states and their data), `search` and `seek` (the path to a deck that
//! only a beacon reports, or to a vessel that is not received), `situation` (every assessed quantity), `height`
//! (confirmation of the deck's height), `outlook` (probability of a landing, with `staying` for the time on the deck),
//! `take_off`, `lift_off` and `leaving` (the take-off), `cycles` (consecutive sorties), `waiting` (value of a better
//! moment), and `checkpoint` (state that outlives the process). This file stores the inputs and writes the output.

mod answers;
mod assessment;
mod battery;
mod charge;
mod checkpoint;
mod concerns;
mod cycles;
mod height;
mod leaving;
mod lift_off;
mod limits;
mod outlook;
mod phase;
mod place;
mod reservation;
mod search;
mod seek;
mod situation;
mod sortie;
mod states;
mod station;
mod succession;
mod swing;
mod take_off;
mod tilt;
mod transition;
mod turnaround;
mod waiting;

#[cfg(test)]
mod charge_tests;
#[cfg(test)]
mod concerns_tests;
#[cfg(test)]
mod cycles_tests;
#[cfg(test)]
mod descent_tests;
#[cfg(test)]
mod ending_tests;
#[cfg(test)]
mod interrupt_tests;
#[cfg(test)]
mod ladder_tests;
#[cfg(test)]
mod node_tests;
#[cfg(test)]
mod orders_tests;
#[cfg(test)]
#[cfg(test)]
mod random_tests;
#[cfg(test)]
mod settings_tests;
#[cfg(test)]
mod station_tests;
#[cfg(test)]
mod staying_tests;
#[cfg(test)]
mod successor_tests;
#[cfg(test)]
mod take_off_tests;
#[cfg(test)]
mod tests;

pub use crate::mission_config::MissionConfig;
pub use alight_shared::bus::wiring;
use alight_shared::checkpoint::CheckpointRejection;

use alight_shared::{
    admission::{CommandAdmission, Latest},
    geometry::{DeckGeometry, DroneGeometry},
    landing::{Odds, Staying},
    msg::{
        AutopilotState, CameraLight, Command, DeckForecast, DeckGrant, DroneState, Header, LastVessel,
        MissionCheckpoint, MissionSettings, MissionState, Phase, Plan, RangeSample, Reason, ReasonCode,
        SetPoint, SettingsOrder, State, VesselLevel, WaitingTimes,
    },
    node::Node,
    time::{DroneClock, Span, Time},
    topics,
};
use serde::{Deserialize, Serialize};

use battery::BatteryMonitor;
use checkpoint::MissionStartUp;
use concerns::is_under_way;
use height::{HeightWitnesses, Surface};
use leaving::LeavingMonitor;
use limits::{MATCHES_FROM_M, TAG_HEIGHT_M};
pub use phase::MAX_VESSEL_DISTANCE_M;
use phase::{Decision, MissionPhase, MissionProgress, RejectedOrder, gave_up};
use place::Waypoint;
use situation::{ControlState, Situation};
use states::{RADIO_BLIND_S, blind_limit};
use succession::MissionSuccession;
use swing::SwingMonitor;
use tilt::TiltMonitor;
use transition::decide;
use waiting::Waiting;

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MissionIn {
    pub forecast: Option<DeckForecast>,
    pub drone: Option<DroneState>,
    pub autopilot: Option<AutopilotState>,
    pub plan: Option<Plan>,
    /// Newest set-point; its `motors` field reports the touchdown.
    pub set_point: Option<SetPoint>,
    /// In order of arrival.
    pub commands: Vec<Command>,
    pub settings: Option<SettingsOrder>,
    pub deck: Option<DeckGrant<DroneClock>>,
    pub ranges: Vec<RangeSample>,
    pub light: Option<CameraLight>,
    /// Checkpoint of a crashed predecessor.
    pub checkpoint: Option<MissionCheckpoint>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MissionOut {
    /// Published at 50 Hz, and at once on a change of state.
    pub state: Option<MissionState>,
    pub checkpoint: Option<MissionCheckpoint>,
    /// Published once at the start, if the predecessor's checkpoint was rejected.
    pub rejected: Option<CheckpointRejection>,
}

wiring! {
    MissionPorts of MissionNode: MissionIn => MissionOut {
        reads {
            newest forecast: DeckForecast,
            newest drone: DroneState,
            newest autopilot: AutopilotState,
            newest plan: Plan,
            newest set_point: SetPoint,
            all commands: Command,
            newest settings: SettingsOrder,
            newest deck: DeckGrant<DroneClock>,
            all ranges: RangeSample,
            newest light: CameraLight,
        }
        writes { state: MissionState }
        wakes { DroneState, DeckForecast, Command }
        saves { checkpoint: MissionCheckpoint }
    }
}

const PERIOD: Span = Span::from_millis(20);
/// Shortest time for which a reason for waiting is published, s.
const SHOWN_S: f64 = 1.0;
#[derive(Clone, Debug, Default)]
pub struct MissionNode {
    /// Configuration with heights above all volumes around the deck.
    config: MissionConfig,
    settings: MissionSettings,
    drone_geometry: DroneGeometry,
    deck_geometry: DeckGeometry,
    drone_id: u32,
    boot: u32,
    sequence: u32,

    forecast: Latest<DeckForecast>,
    drone: Latest<DroneState>,
    autopilot: Latest<AutopilotState>,
    plan: Latest<Plan>,
    set_point: Latest<SetPoint>,
    /// Time at which the pilot last refused no plan.
    admitted_at: Option<Time<DroneClock>>,
    grant: Latest<DeckGrant<DroneClock>>,
    light: Latest<CameraLight>,
    commands: CommandAdmission<DroneClock>,
    /// Time and size of a jump of the drone's frame, kept until the next forecast.
    moved: Option<(Time<DroneClock>, f64)>,
    /// Mean level of the deck, NED z, m, and the time of its forecast.
    mean_deck_z: Option<(Time<DroneClock>, f64)>,
    heights: HeightWitnesses,
    surface: Surface,
    waiting: Waiting,
    tilt: TiltMonitor,
    swing: SwingMonitor,
    /// Time of the newest forecast, whether a landed drone stays on the deck, and the odds of a landing.
    judged: Option<(Time<DroneClock>, Staying, Option<Odds>)>,
    battery: BatteryMonitor,
    last_vessel: Option<LastVessel>,
    /// Target of the feet relative to the deck's centre, NED, m; fixed before the descent.
    meets: [f64; 2],
    leaving: LeavingMonitor,
    /// Time spent on each reason against the ordered landing.
    waited: WaitingTimes,
    /// Published reason for waiting, and the time since which it has this code.
    shown: (Reason, Time<DroneClock>),
    /// Newest abort and newest other order at that time: an answer is published at once.
    answered: [Option<[u32; 2]>; 2],

    /// Delay of a forced descent after the drone is first steady, and the resulting time.
    forced_descent: Option<(Span, Option<Time<DroneClock>>)>,
    succession: MissionSuccession,
    phase: MissionPhase,
    progress: MissionProgress,
    previous: State,
    since: Time<DroneClock>,
    entered: Reason,
    due: Time<DroneClock>,
    stepped: Option<Time<DroneClock>>,
}

impl MissionNode {
    pub fn new(
        config: &MissionConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        drone_id: u32,
        boot: u32,
    ) -> Self {
        MissionNode {
            config: config.clone(),
            settings: config.settings(),
            drone_geometry: *drone,
            deck_geometry: *deck,
            drone_id,
            boot,
            due: Time::from_nanos(i64::MIN),
            ..MissionNode::default()
        }
    }

    pub fn boot(&self) -> u32 {
        self.boot
    }
    /// Starts a descent this long after the drone is first steady, at any probability. For simulations.
    #[must_use]
    pub fn forced_descent(mut self, after: Option<Span>) -> Self {
        self.forced_descent = after.map(|after| (after, None));
        self
    }
    #[must_use]
    pub fn as_successor(mut self) -> Self {
        self.succession.beginning = Some(MissionStartUp::default());
        self
    }

    fn receive(&mut self, now: Time<DroneClock>, input: &MissionIn) {
        let mut moved_m = None;
        if let Some(m) = &input.autopilot
            && self.autopilot.offer(now, m)
        {
            self.battery.update(m, &self.config);
        }
        let before = self.drone.get().copied();
        if let Some(m) = &input.drone
            && self.drone.offer(now, m)
        {
            moved_m = before.and_then(|before| m.origin_moved_m(&before));
        }
        if let Some(by_m) = moved_m {
            // Forecast, plan and level refer to the frame before the jump.
            self.forecast.forget();
            self.plan.forget();
            self.mean_deck_z = None;
            self.heights.forget();
            self.surface = Surface::default();
            self.moved = Some((now, self.moved.map_or(by_m, |(_, before)| by_m.max(before))));
        }
        let since = self.moved.map(|(at, _)| at);
        if let Some(m) = input
            .forecast
            .filter(|m| since.is_none_or(|at| m.header.at >= at))
            && self.forecast.offer(now, &m)
        {
            self.moved = None;
            self.raise_heights();
            if let Some(z) = m.mean_z {
                self.follow_level(m.header.at, z);
            }
        }
        if let Some(m) = &input.plan {
            self.plan.offer(now, m);
        }
        if let Some(m) = &input.set_point
            && self.set_point.offer(now, m)
        {
            if m.plan_refusal.is_none() {
                self.admitted_at = Some(now);
            }
            self.tilt.update(m, self.drone.get());
            self.swing.update(m, self.drone.get());
        }
        if let Some(m) = &input.deck {
            self.grant.offer(now, m);
        }
        if let Some(m) = &input.light {
            self.light.offer(now, m);
        }
        self.see_surface(now, &input.ranges);
        self.keep_range(&input.ranges);
    }

    /// Sets the tracking and approach heights: above all volumes, and lower above a vessel known only by its tags.
    fn raise_heights(&mut self) {
        let forecast = self.forecast.get();
        let lowest_m = forecast.map_or(0.0, |f| f.surroundings.wait_height_m());
        let tracking_m = self.settings.tracking_height_m;
        // The drone climbs to find a lost deck again.
        let by_tag = forecast.is_some_and(|f| {
            f.vessel_level() == VesselLevel::Tag && f.vision_age_s <= self.config.vision_lost_s
        });
        let tracking_m = if by_tag {
            let min_m = self.config.lowest_plan_m().map_or(0.0, |m| m + MATCHES_FROM_M);
            tracking_m.min(TAG_HEIGHT_M.max(min_m))
        } else {
            tracking_m
        };
        self.config.tracking_height_m = tracking_m.max(lowest_m);
        self.config.approach_height_m = self.settings.approach_height_m.max(lowest_m);
    }
    /// Settings may change unless the drone may fly or has an order to land or take off.
    fn is_settable(&self, s: &Situation) -> bool {
        s.flight == ControlState::Disarmed && !self.progress.landing && !self.phase.stands()
    }
    /// Applies a ground station's settings if they are within the configuration's limits and may change.
    fn set(&mut self, now: Time<DroneClock>, order: &SettingsOrder, s: &Situation) {
        let age = now - order.header.at;
        let fresh = (Span::ZERO..=topics::SETTINGS.stale_after).contains(&age);
        let others = order.settings.tracking_height_m == self.settings.tracking_height_m;
        if fresh && others && self.is_settable(s) {
            self.adjust(&order.settings);
        }
    }
    fn adjust(&mut self, settings: &MissionSettings) {
        if let Ok(config) = self.config.with(settings) {
            (self.config, self.settings) = (config, *settings);
            self.raise_heights();
        }
    }

    fn limit_duration(&self, decision: Decision, now: Time<DroneClock>, s: &Situation) -> Decision {
        let limit = match decision.phase.state() {
            State::Descent => {
                let holds_s = self.config.lowest_plan_m().map_or(0.0, |_| self.config.match_s);
                self.config.descent_timeout_s + holds_s
            }
            State::Flare => self.config.flare_timeout_s,
            State::Idle
            | State::GetAltitude
            | State::Approach
            | State::Search
            | State::Tracking
            | State::TrackingStable
            | State::Landed
            | State::Hold
            | State::GaveUp
            | State::Preparing
            | State::Countdown
            | State::SpinUp
            | State::TakeOff
            | State::ClimbOut
            | State::StandDown => return decision,
        };
        let lasted = (now - self.since).secs();
        if decision.entered.is_some() || lasted <= limit {
            return decision;
        }
        let why = Reason::new(ReasonCode::TooLong, lasted, limit);
        let phase = if decision.progress.stopped || s.hard_contact_mps.is_some() {
            gave_up(s, &self.config)
        } else {
            MissionPhase::TRACKING
        };
        Decision {
            phase,
            entered: Some(why),
            waiting: why,
            ..decision
        }
    }

    /// Adds `dt` (s) to the reason that delays the landing. If a landing takes too long, the crew is shown the reason
    /// that delayed it longest.
    fn account(&mut self, dt: f64, mut decision: Decision, s: &Situation) -> Decision {
        if decision.progress.started != self.progress.started {
            self.waited = WaitingTimes::default();
        }
        if is_under_way(self.phase) {
            self.waited.add(decision.waiting, dt);
        }
        let gives_up = matches!(decision.phase, MissionPhase::GaveUp { .. });
        if let Some(took) = decision
            .entered
            .filter(|why| why.code == ReasonCode::TooLong && gives_up)
            && let Some((why, longest_s)) = self.waited.longest()
        {
            decision.entered = Some(Reason::new(ReasonCode::WaitedTooLong, longest_s, took.limit));
            decision.progress.rejected = Some(RejectedOrder { at: s.now, why });
        }
        decision
    }

    /// Permitted descent speed, m/s: zero unless deck, vision and control are available now.
    fn permitted_descent(&self, s: &Situation) -> f64 {
        let c = &self.config;
        let controlled = matches!(s.flight, ControlState::Ours | ControlState::OnGround);
        let Some(deck) = s.fresh_deck().filter(|_| controlled) else {
            return 0.0;
        };
        if let MissionPhase::Descent { paused, .. } = self.phase
            && (paused.is_none() || c.lowest_plan_m().is_some())
            && deck.located_age_s() <= c.descent_vision_s
        {
            return c.descent_mps;
        }
        // A committed flare continues without vision for a limited time.
        if let MissionPhase::Flare { committed, .. } = self.phase
            && (deck.located_age_s() <= blind_limit(deck)
                || (committed && deck.located_age_s() <= RADIO_BLIND_S + c.flare_timeout_s))
        {
            return c.flare_mps;
        }
        0.0
    }

    fn adopt(&mut self, now: Time<DroneClock>, decision: &Decision, s: &Situation) {
        let taken = self.progress.set_points_lost && !decision.progress.set_points_lost;
        self.progress = decision.progress;
        let was = self.phase.state();
        self.phase = decision.phase;
        let changed = decision.entered.is_some();
        // A drone that comes back under our control may be near the deck without an order.
        let away = matches!(
            s.flight,
            ControlState::SetPointsLost | ControlState::OtherControl(_)
        );
        if changed && away && self.phase == MissionPhase::Idle {
            self.succession
                .needs_safe_start
                .get_or_insert(ReasonCode::GivenBack);
        }
        if (changed || taken) && self.phase == MissionPhase::Idle && !self.progress.landing {
            // After a takeover a repeated order does not land the drone.
            self.commands.supersede(now);
        }
        if let Some(why) = decision.entered {
            self.previous = was;
            self.since = now;
            self.entered = why;
        }
    }

    /// Reason to publish: within one state and without a new order its code changes at most once in [`SHOWN_S`], so that
    /// people can read it.
    fn shown(&mut self, now: Time<DroneClock>, waiting: Reason) -> Reason {
        let (shown, at) = self.shown;
        let abort = self.commands.abort().map(|h| [h.boot, h.sequence]);
        let orders = [abort, self.commands.order()];
        let entered = at < self.since || orders != self.answered;
        self.answered = orders;
        if entered || shown.code == waiting.code || (now - at).secs() >= SHOWN_S {
            let same = !entered && shown.code == waiting.code;
            self.shown = (waiting, if same { at } else { now });
        }
        self.shown.0
    }

    fn message(&mut self, now: Time<DroneClock>, s: &Situation, waiting: Reason) -> MissionState {
        let waiting = self.shown(now, waiting);
        let c = &self.config;
        let place = Waypoint::of(self.phase, s, c);
        let state = self.phase.state();
        let altitude = if state.phase() == Phase::Landing || state == State::Landed {
            c.minimum_altitude_landing_m
        } else {
            c.minimum_altitude_m
        };
        // Doubt about the deck's height ends a landing in progress.
        let lands = state.phase() == Phase::Landing;
        let lowest_m = (s.lowest_z.filter(|_| !lands)).map_or(f64::NEG_INFINITY, |z| -z);
        // Fixed before the descent, so that the plan does not move sideways low above the deck.
        if !lands {
            self.meets = s.staying.meets.into();
        }
        self.sequence = self.sequence.wrapping_add(1);
        let vessel = self.forecast.get().map_or(0, |f| f.header.vessel);
        MissionState {
            header: Header::new(vessel, self.drone_id, self.boot, self.sequence, now),
            state,
            previous: self.previous,
            since: self.since,
            entered: self.entered,
            waiting,
            rejected: self.progress.rejected.and_then(|order| order.shown(now)),
            attempts: self.progress.attempts,
            height_m: place.height_m,
            descent_mps: self.permitted_descent(s),
            // The altitude is in the drone's NED, in which the water level is offset by a GNSS error.
            minimum_altitude_m: (altitude - s.water_z).max(lowest_m),
            hold_position: place.at.into(),
            hold_yaw: place.yaw,
            with_deck: place.with_deck,
            waiting_offset: place.offset,
            station: self.phase.station(),
            settings: self.settings,
            settable: self.is_settable(s),
            min_vessel: c.min_vessel,
            lowest_clearance_m: c.lowest_plan_m(),
            commit_clearance_m: c.commit_clearance_m,
            battery: s.battery,
            battery_reserve: s.battery_reserve,
            likelihood: match s.leaving.lift_off {
                Some(moments) => Some(moments.now.whole()),
                None => s.odds.map(|o| o.whole()),
            },
            harm: s.odds.filter(|_| s.leaving.lift_off.is_none()).map(|o| o.harm()),
            meets: self.meets,
            low_battery: self.progress.low_battery,
            last_resort: charge::last_resort(s, c),
            turns_in_s: s.sortie.turns_in_s,
            sorties: self.progress.cycles.count(c),
            abort: self.commands.abort().map(|h| [h.boot, h.sequence]),
            order: self.commands.order(),
        }
    }
}

impl Node for MissionNode {
    type Clock = DroneClock;
    type In = MissionIn;
    type Out = MissionOut;

    fn step(&mut self, now: Time<DroneClock>, input: &MissionIn) -> MissionOut {
        self.receive(now, input);
        if self.stepped.is_none() {
            self.since = now;
        }
        let mut s = self.situation(now);
        let begins = self.succession.beginning.is_some();
        let Some((order, rejected)) = self.order(now, input, &s) else {
            return MissionOut::default();
        };
        if let Some(order) = &input.settings {
            self.set(now, order, &s);
        }
        if begins || input.settings.is_some() {
            s = self.situation(now);
        }
        let dt = self.watch_way(now, &s);
        self.judge(now, &mut s);
        self.judge_take_off(now, &mut s);
        self.judge_sortie(now, &mut s);
        if let Some((after, at)) = &mut self.forced_descent
            && self.phase == MissionPhase::TrackingStable
        {
            at.get_or_insert(now + *after);
        }
        let decision = match order {
            None => self.keeps_clear(&s),
            Some(_) => None,
        };
        let decision = decision.unwrap_or_else(|| decide(self.phase, self.progress, order, &s, &self.config));
        let decision = self.limit_duration(decision, now, &s);
        let decision = self.account(dt, decision, &s);
        self.adopt(now, &decision, &s);
        let changed = decision.entered.is_some();
        if now < self.due && !changed {
            return MissionOut {
                rejected,
                ..MissionOut::default()
            };
        }
        self.due = if changed || now - self.due > PERIOD {
            now + PERIOD
        } else {
            self.due + PERIOD
        };
        self.succession.published = Some(now);
        let state = self.message(now, &s, decision.waiting);
        MissionOut {
            state: Some(state),
            checkpoint: Some(self.checkpoint(&state)),
            rejected,
        }
    }
}

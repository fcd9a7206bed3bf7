//! Outbound set-points from the pilot node, and commands to disarm, divert and arm.

use alight_shared::{
    admission::Periodic,
    frames::wxyz,
    geodesy::Datum,
    geometry::GRAVITY,
    msg::{
        AutopilotMode, BatteryPlace, Header, LandedState, Motors, PlanStage, ReasonCode, SetPoint,
        SetPointKind, State, still_armed, still_armed_s,
    },
    time::{DroneClock, Span},
};
use nalgebra::Vector3;

use super::{
    AutopilotLink, AutopilotOut, ControlAuthority, DisarmInhibit, DroneTime, HELD_LOW, STILL_ARMED,
    UNDECIDED,
    config::{DisarmConfig, Diversion},
    disarm::{self, ContactEvidence, DisarmDecision},
    message::{Address, AttitudeThrustTarget, CommandLong, MavCmd, MavlinkMessage, PositionTarget, severity},
    modes::Firmware,
    set_point_loss::SetPointLossMonitor,
    take_off::TakeOffSequence,
    thrust::{self, SentThrust},
};
use crate::{flatness::attitude_of_thrust, tracking::steer};

/// Repetition period of a set-point, s: 50 Hz.
const REPEAT_S: f64 = 0.02;
/// Maximum distance between the drone and a hold streamed before OFFBOARD, m.
const OFFER_WITHIN_M: f64 = 3.0;
/// Thrust, as a fraction of hover, that presses down a drone found on the deck while evidence is collected.
const PRESS_OF_HOVER: f64 = 0.5;
/// Climb of a drone that is in the air although the pilot node reported touchdown, m.
const CLEAR_M: f64 = 1.0;
/// Rangefinder reading below which the deck may be supporting the drone, m.
const NEAR_M: f64 = 0.6;
/// Height error between two GNSS receivers, m.
const RECEIVERS_ERR_M: f64 = 3.0;
const COMMAND_PAUSE: Span = Span::from_millis(1000);
/// Time after which a silent mission is not restarted any more, s.
const RESTARTS_S: f64 = 20.0;
/// Maximum time until a mission responds to a low charge, s: the upper bound of `battery_lasts_s`.
const COUNTED_S: f64 = 60.0;
/// Distance from the deck's centre at which the drone is off the deck, m: exceeds receiver errors and long
/// decks.
const AWAY_FROM_DECK_M: f64 = 20.0;
const ARM_TRIES: u32 = 3;

/// Position at which the link itself holds the drone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HeldPosition {
    place: Vector3<f64>,
    /// Position relative to the deck's centre, if known.
    from_deck: Option<Vector3<f64>>,
    yaw: f64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct SetPointStream {
    pub(super) attitudes: bool,
    pub(super) held: Option<HeldPosition>,
    pub(super) flown: Option<SetPoint>,
    pub(super) sent_at: Option<DroneTime>,
    pub(super) sent: u32,
    pub(super) thrust: SentThrust,
    pub(super) loss: SetPointLossMonitor,
}

/// Mode into which a diversion has sent the drone.
#[derive(Clone, Copy, Debug)]
struct SentAway {
    at: DroneTime,
    mode: AutopilotMode,
    /// Whether the autopilot has reported the mode since.
    reached: bool,
}

#[derive(Clone, Debug, Default)]
pub(super) struct LinkCommands {
    pub(super) pause: Periodic<DroneClock>,
    low_since: Option<DroneTime>,
    pub(super) diversions: u32,
    arm_tries: u32,
    sent_away: Option<SentAway>,
    pub(super) home: Option<(DroneTime, Datum)>,
    pub(super) departure: TakeOffSequence,
}

impl LinkCommands {
    /// Follows the mode after a diversion. Any change of it, and a late one to it, is a person's choice.
    pub(super) fn follow_mode(&mut self, now: DroneTime, armed: bool, mode: AutopilotMode) {
        let Some(sent) = &mut self.sent_away else { return };
        let waits = !sent.reached && mode == AutopilotMode::Offboard && now - sent.at <= UNDECIDED;
        sent.reached |= mode == sent.mode;
        if !armed || !(waits || mode == sent.mode) {
            self.sent_away = None;
        }
    }
    /// Whether the drone flies in the mode into which a diversion has sent it.
    pub(super) fn is_sent_away(&self) -> bool {
        self.sent_away.is_some_and(|sent| sent.reached)
    }
}

impl AutopilotLink {
    /// Whether the deck may be supporting the drone, which would falsify the hover thrust estimate.
    pub(super) fn may_touch(&self, now: DroneTime) -> bool {
        let state = self.inputs.last_state(now);
        let stands = state.is_some_and(|s| {
            s.stands_for_take_off() || matches!(s, State::TakeOff | State::Flare | State::Landed)
        });
        let range = self.estimate.range.fresh_m(now);
        // An idle drone may be standing on a deck whose height is known only from GNSS.
        let waits = state.is_none_or(|s| s == State::Idle);
        let above = self.estimate.relative_to(now, self.inputs.deck(now));
        let height = above.map(|(h, _, _)| h).filter(|_| waits);
        let near = range.is_some_and(|r| r < NEAR_M) || height.is_some_and(|h| h < RECEIVERS_ERR_M);
        // A restarted link keeps its predecessor's hover thrust.
        let began = state.is_none() || waits && self.succession.recovery.checkpoint().is_some();
        let unknown = began && range.is_none() && height.is_none();
        stands || near || unknown
    }

    pub(super) fn contact(&self, now: DroneTime) -> ContactEvidence {
        let state = self.estimate.fresh(now);
        let below = self.estimate.relative_to(now, self.inputs.deck(now));
        let (forecast_height, speed) = below.map(|(h, v, _)| (h, v)).unzip();
        let moves_with_deck = below.is_some_and(|(h, v, away)| {
            h.abs() <= disarm::PRESS_BELOW_BLIND_M
                && v <= self.config.disarm.speed_mps
                && away.abs() <= disarm::RESTS_NORMAL_MPS
        });
        let range = self.estimate.range.fresh_m(now);
        let believed = |r: &f64| self.estimate.range.believes(*r, forecast_height);
        let range_height = range.filter(believed).map(|r| r - self.estimate.range.feet_m);
        let landed = self.inputs.fresh_state(now) == Some(State::Landed);
        let peer = self.peer.as_ref();
        let load_factor = state.and(self.estimate.force).map(|f| f / GRAVITY);
        let thrust = self.thrust_of_hover(now);
        let carried = load_factor.is_some_and(|f| f >= self.config.disarm.min_load_factor)
            && thrust.is_some_and(|t| t <= disarm::STANDS_OF_HOVER);
        let turns = state.is_none_or(|s| Vector3::from(s.rates).norm() > disarm::STANDS_RADPS);
        ContactEvidence {
            // If the mission falls silent in the flare, the pilot node completes the landing.
            landing: self.inputs.last_state(now).is_some_and(State::meets_deck),
            range_height,
            range_doubted: range.is_some_and(|r| !believed(&r)),
            forecast_height,
            speed,
            load_factor,
            thrust,
            stands: carried && !turns,
            rests: landed && moves_with_deck && range_height.is_some_and(|h| h <= disarm::RESTS_M),
            commanded_low: self.control_authority().commands() && self.stream.thrust.is_low(now),
            reports_on_ground: peer.is_some_and(|p| p.landed(now) == LandedState::OnGround),
        }
    }

    fn apply(&mut self, now: DroneTime, wanted: &SetPoint, out: &mut AutopilotOut) -> Option<SetPoint> {
        if wanted.motors == Motors::Run {
            self.disarm.touchdown.clear();
            self.disarm.inhibited = None;
            if wanted.kind == SetPointKind::None {
                return None;
            }
            let carried = self.carried(now, *wanted);
            if carried == Some(*wanted) {
                self.stream.held = None;
            }
            self.stream.flown = carried;
            return carried;
        }
        let thrust_off = SetPoint {
            kind: SetPointKind::Attitude,
            thrust: 0.0,
            rates: [0.0; 3],
            ..*wanted
        };
        // The motor stop belongs to an earlier landing; a take-off has a separate disarm.
        if (self.inputs.last_state(now)).is_some_and(State::stands_for_take_off) {
            self.interrupted();
            return Some(thrust_off);
        }
        let evidence = self.contact(now);
        // After a gap the evidence must last longer, because the low-pass filtered load factor still shows
        // earlier support when the thrust has just been cut.
        let c = match self.stream.flown {
            Some(_) => self.config.disarm,
            None => self.lasting(),
        };
        match self.disarm.touchdown.step(now, &evidence, &c) {
            DisarmDecision::Press => {
                (self.stream.flown).or_else(|| self.press_or_climb(now, &evidence, &c, wanted.attitude))
            }
            DisarmDecision::Command => {
                self.command_disarm(self.disarm.touchdown.sent(), out);
                Some(thrust_off)
            }
            DisarmDecision::Idle => {
                self.disarm.inhibited = None;
                self.stream.held = None;
                Some(thrust_off)
            }
            DisarmDecision::InAir(inhibit) => {
                if self.disarm.inhibited != Some(inhibit) {
                    self.disarm.inhibited = Some(inhibit);
                    let text = format!("no disarm, the drone climbs by {CLEAR_M} m and holds: {inhibit}");
                    out.alarm(severity::CRITICAL, text);
                }
                self.hold_above(now)
            }
        }
    }

    /// Disarm evidence some time after touchdown, when the drone may have left the deck.
    fn lasting(&self) -> DisarmConfig {
        let c = self.config.disarm;
        DisarmConfig {
            hold_s: c.hold_s.max(disarm::HOLD_ALONE_S),
            height_m: c.height_m.min(disarm::PRESS_BELOW_BLIND_M),
            ..c
        }
    }

    /// Discards an earlier touchdown after a gap in the set-points.
    fn interrupted(&mut self) {
        self.disarm.touchdown.clear();
        self.stream.flown = None;
    }

    pub(super) fn command_disarm(&self, sent: u32, out: &mut AutopilotOut) {
        let to = self.peer.as_ref().map(|p| p.address).unwrap_or_default();
        out.send(CommandLong::disarm(to, sent));
        if sent == self.config.disarm.tries {
            out.alarm(
                severity::CRITICAL,
                format!("still armed after {sent} commands to disarm on the deck: disarm by remote control"),
            );
        }
    }

    pub(super) fn report_armed(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let armed = self.peer.as_ref().is_some_and(|p| p.armed);
        let mission = self.inputs.fresh_mission(now);
        let still_s = mission.and_then(|m| still_armed_s(now, m, armed, self.config.disarm.longest_s()));
        if let Some(s) = still_s.filter(|_| self.disarm.report.is_due_spaced(now, STILL_ARMED)) {
            out.alarm(severity::CRITICAL, still_armed(s as f32));
        }
    }

    /// Repeats the mission's alarm about a drone that another control holds low above the deck.
    pub(super) fn report_low(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let why = self.inputs.fresh_mission(now).map(|m| m.waiting);
        if let Some(why) = why.filter(|why| why.code == ReasonCode::HeldLow)
            && self.timers.low.is_due_spaced(now, HELD_LOW)
        {
            out.alarm(severity::CRITICAL, why.to_string());
        }
    }

    /// Whether the drone has landed and its autopilot ignores set-points: either it holds by itself after a
    /// failure of set-points, pilot node or link, or a pilot chose Hold. The two look the same.
    fn follows_none_on_deck(&self, now: DroneTime, wanted: Option<&SetPoint>) -> bool {
        let mode = AutopilotMode::Hold;
        let authority = self.control_authority();
        let holds = authority == ControlAuthority::TakenOver { mode }
            || authority == ControlAuthority::Standby { mode };
        (holds || authority.commands() && wanted.is_none()) && self.is_landed_armed(now)
    }
    fn is_landed_armed(&self, now: DroneTime) -> bool {
        let landed = self.inputs.fresh_state(now) == Some(State::Landed);
        landed && self.peer.as_ref().is_some_and(|p| p.armed)
    }
    /// Disarms a landed drone whose pilot node has not detected the touchdown, for example after a restart.
    fn disarm_at_rest(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let evidence = self.contact(now);
        let decision = self.disarm.alone.step(now, &evidence, &self.lasting());
        if evidence.rests && decision == DisarmDecision::Command {
            self.command_disarm(self.disarm.alone.sent(), out);
        }
    }
    /// Continues to disarm a drone in that hold, on lasting evidence. The set-point presses down or climbs
    /// above the deck, and returns PX4 from its failsafe to the mode chosen by the pilot.
    fn disarm_in_hold(&mut self, now: DroneTime, out: &mut AutopilotOut) -> Option<SetPoint> {
        let lasting = self.lasting();
        let evidence = self.contact(now);
        let decision = self.disarm.alone.step(now, &evidence, &lasting);
        if decision == DisarmDecision::Command {
            self.command_disarm(self.disarm.alone.sent(), out);
        }
        // The autopilot may ignore the set-point. If the drone follows it, pressing down requires evidence.
        let follows = self.control_authority().commands();
        let carried_by_rotors = decision == DisarmDecision::InAir(DisarmInhibit::NotSupported);
        if follows && carried_by_rotors {
            return self.hold_above(now);
        }
        self.press_or_climb(now, &evidence, &lasting, self.estimate.state?.attitude)
    }
    /// Set-point for a drone that may have left the deck. A low drone is pressed down gently at the given
    /// attitude. If the autopilot took off by itself and hovers over a rising deck, the drone climbs.
    fn press_or_climb(
        &mut self,
        now: DroneTime,
        evidence: &ContactEvidence,
        c: &DisarmConfig,
        attitude: [f64; 4],
    ) -> Option<SetPoint> {
        match disarm::inhibit(evidence, c) {
            None | Some(DisarmInhibit::NotSupported) if evidence.is_low() => {
                self.stream.held = None;
                Some(SetPoint {
                    header: Header::new(0, self.headers.drone_id, self.headers.boot, 0, now),
                    kind: SetPointKind::Attitude,
                    motors: Motors::Run,
                    thrust: PRESS_OF_HOVER * self.estimate.hover.value(),
                    attitude: self.aligned(now).unwrap_or(attitude),
                    ..SetPoint::default()
                })
            }
            // Waits for inputs that are expected to arrive.
            Some(DisarmInhibit::NotLanding | DisarmInhibit::HeightUnknown) => None,
            None
            | Some(
                DisarmInhibit::RangeHigh
                | DisarmInhibit::ForecastHigh
                | DisarmInhibit::Fast
                | DisarmInhibit::NotSupported,
            ) => self.hold_above(now),
        }
    }

    /// Attitude of the forecast deck in the drone's heading. A drone that is pressed down in the tilt of a hold slides.
    fn aligned(&self, now: DroneTime) -> Option<[f64; 4]> {
        let state = self.estimate.fresh(now)?;
        let deck = self.inputs.deck(now)?;
        Some(wxyz(&attitude_of_thrust(&deck.normal(), state.euler().z)))
    }

    /// Hold slightly above the position of the first call. While the forecast is fresh, it moves with the
    /// deck, but not down with a sinking deck, which will rise again.
    pub(super) fn hold_above(&mut self, now: DroneTime) -> Option<SetPoint> {
        let deck = self.inputs.deck(now);
        let centre = deck.map(|d| Vector3::from(d.position));
        if self.stream.held.is_none() {
            let s = self.estimate.state?;
            let place = s.position() - Vector3::z() * CLEAR_M;
            self.stream.held = Some(HeldPosition {
                place,
                from_deck: centre.map(|c| place - c),
                yaw: s.euler().z,
            });
        }
        let held = self.stream.held.as_mut()?;
        let mut velocity = [0.0; 3];
        if let (Some(d), Some(c), Some(r)) = (deck, centre, held.from_deck) {
            let highest = held.place.z;
            held.place = c + r;
            velocity = d.velocity;
            if held.place.z > highest {
                held.place.z = highest;
                velocity[2] = 0.0;
            }
        }
        let stage = PlanStage {
            position: held.place.into(),
            velocity,
            euler: [0.0, 0.0, held.yaw],
            ..PlanStage::default()
        };
        let header = Header::new(0, self.headers.drone_id, self.headers.boot, 0, now);
        let hold = if self.stream.attitudes {
            steer(&stage, &self.estimate.state?, self.estimate.hover.value())
        } else {
            SetPoint {
                kind: SetPointKind::Trajectory,
                position: stage.position,
                velocity,
                yaw: stage.euler[2],
                ..SetPoint::default()
            }
        };
        Some(SetPoint { header, ..hold })
    }

    /// Whether the set-point is a hold before a landing; `unknown` is returned without a mission.
    fn holds_before_landing(&self, wanted: &SetPoint, unknown: bool) -> bool {
        let mission = self.inputs.mission.get();
        let idle = mission.map_or(unknown, |m| m.state == State::Idle);
        idle && wanted.kind != SetPointKind::None && wanted.motors == Motors::Run
    }
    /// Hold at the drone's position for the pilot's handover.
    fn offered(&self, wanted: &SetPoint) -> Option<SetPoint> {
        let apart = Vector3::from(wanted.position) - self.estimate.state?.position();
        let offers = self.holds_before_landing(wanted, true) && apart.norm() <= OFFER_WITHIN_M;
        offers.then_some(*wanted)
    }

    pub(super) fn send_set_point(&mut self, now: DroneTime, new: bool, out: &mut AutopilotOut) {
        let wanted = self.inputs.fresh_set_point(now).copied();
        if let Some(mission) = self.inputs.fresh_mission(now) {
            self.disarm.restart(mission);
        }
        let since = self.stream.sent_at.map_or(f64::INFINITY, |t| (now - t).secs());
        let due = since >= REPEAT_S || new && since >= 0.8 / self.config.set_point_hz;
        let alone = self.follows_none_on_deck(now, wanted.as_ref());
        if alone || wanted.is_none() {
            self.interrupted();
        }
        let stops = wanted.is_some_and(|w| w.motors == Motors::Stop) && self.control_authority().commands();
        let repeats = self.is_landed_armed(now) && !stops;
        if !repeats {
            self.disarm.alone.clear();
        }
        if !due {
            return;
        }
        let outgoing = if alone {
            self.disarm_in_hold(now, out)
        } else {
            if repeats {
                self.disarm_at_rest(now, out);
            }
            wanted.and_then(|wanted| self.follow(now, &wanted, out))
        };
        if let Some(outgoing) = outgoing
            && let Some(to) = self.peer.as_ref().map(|p| p.address)
        {
            let low = self.config.disarm.max_thrust_of_hover * self.estimate.hover.value();
            let is_low = outgoing.kind == SetPointKind::Attitude && outgoing.thrust <= low;
            self.stream.thrust.sent(now, is_low);
            out.messages.push(self.to_mavlink(to, &outgoing));
            self.stream.sent_at = Some(now);
            self.stream.sent = self.stream.sent.saturating_add(1);
        }
    }

    /// Set-point to send: the pilot node's, a hold, or none.
    fn follow(&mut self, now: DroneTime, wanted: &SetPoint, out: &mut AutopilotOut) -> Option<SetPoint> {
        let authority = self.control_authority();
        let px4 = self.firmware() == Some(Firmware::Px4);
        // GUIDED holds by itself, and a hold would override its take-off. OFFBOARD ends without set-points.
        let guided_holds = !px4 && self.holds_before_landing(wanted, false);
        if authority.commands() && !guided_holds {
            return self.apply(now, wanted, out);
        }
        self.interrupted();
        if self.streams_ahead(now) {
            let flown = wanted.kind != SetPointKind::None && wanted.motors == Motors::Run;
            return if flown { self.carried(now, *wanted) } else { None };
        }
        // PX4 needs a set-point stream before the pilot can choose OFFBOARD; ArduCopter does not.
        let offers = authority.may_offer() && px4;
        self.offered(wanted).filter(|_| offers)
    }

    fn to_mavlink(&self, to: Address, s: &SetPoint) -> MavlinkMessage {
        let s = self.estimate.for_autopilot(s, self.firmware());
        if s.kind == SetPointKind::Attitude {
            let peer = self.peer.as_ref();
            let tilt = peer.map_or(1.0, |p| p.tilt_compensation(s.attitude));
            return MavlinkMessage::AttitudeThrust(AttitudeThrustTarget {
                to,
                attitude: s.attitude,
                rates: self.config.send_rates.then_some(s.rates),
                thrust: tilt * thrust::command(s.thrust, self.config.thrust_curve),
            });
        }
        MavlinkMessage::Position(PositionTarget {
            to,
            position: s.position,
            velocity: s.velocity,
            acceleration: s.acceleration,
            yaw: s.yaw,
            yaw_rate: s.yaw_rate,
        })
    }

    /// Diverts on low battery as the mission chooses, or at the final reserve if there is no mission.
    pub(super) fn divert(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let b = self.config.battery;
        let Some(peer) = &self.peer else { return };
        let mission = (self.inputs.last_mission(now)).filter(|_| self.disarm.inhibited.is_none());
        let chosen = mission.and_then(|m| m.low_battery);
        // Completing a descent in progress is the fastest way down, and a landed drone cannot be diverted.
        let lands = mission.is_some_and(|m| m.state.meets_deck());
        let lands = lands || chosen == Some(BatteryPlace::Deck);
        let diversion = |place: BatteryPlace| match place {
            BatteryPlace::Here => Diversion::Land,
            BatteryPlace::Home | BatteryPlace::Deck => Diversion::Return,
        };
        // A mission that is restarted lands the drone, so the last resort of a silent one waits for that.
        let silent = self.inputs.last_mission(now).is_none() && b.diversion != Diversion::None;
        let resort = self.inputs.mission.get().and_then(|m| m.last_resort);
        let resort = if silent { resort } else { None };
        let restarts = resort.is_some() && self.inputs.mission.age_s(now) < RESTARTS_S;
        let (to, limit, for_s) = match (chosen, resort) {
            (Some(place @ (BatteryPlace::Home | BatteryPlace::Here)), _) => {
                (diversion(place), f64::INFINITY, 0.0)
            }
            (Some(BatteryPlace::Deck) | None, Some(resort)) => {
                (diversion(resort.place), resort.charge, b.for_s)
            }
            (Some(BatteryPlace::Deck) | None, None) => (b.diversion, b.reserve, b.for_s),
        };
        // The mission chooses a landing place once it has confirmed the low charge, a restarted one some seconds after its
        // start. The final reserve must not act before that.
        let counts = limit.is_infinite() || mission.is_none_or(|m| m.battery.is_some_and(|b| b < limit));
        let due_s = if counts { for_s } else { for_s.max(COUNTED_S) };
        // The mission may have chosen a landing place because of the voltage alone.
        let reported = peer.charge(now);
        if !(limit.is_infinite() || reported.is_some_and(|c| c < limit)) {
            self.commands.low_since = None;
            return;
        }
        let low_s = (now - *self.commands.low_since.get_or_insert(now)).secs();
        let authority = self.control_authority();
        let repeated =
            matches!(authority, ControlAuthority::Diverted(_)) && peer.mode == AutopilotMode::Offboard;
        if !(authority.commands() && !lands || repeated)
            || low_s < due_s
            || restarts
            || !self.commands.pause.is_ready(now)
            || self.commands.diversions >= b.tries
        {
            return;
        }
        let Some(mode) = peer.firmware.diversion(to) else {
            return;
        };
        if !repeated {
            let order = if to == Diversion::Land { "land" } else { "return" };
            let charge = reported.map_or("of unknown charge".into(), |c| format!("at {:.0} %", 100.0 * c));
            let text = format!("battery {charge}: the autopilot is commanded to {order}");
            out.alarm(severity::WARNING, text);
        }
        out.send(CommandLong::mode(peer.address, mode));
        self.commands.diversions += 1;
        self.commands.pause.restart(now, COMMAND_PAUSE);
        self.authority.divert(now, to);
        let mode = match to {
            Diversion::Land => AutopilotMode::Land,
            Diversion::None | Diversion::Return => AutopilotMode::Return,
        };
        self.commands.sent_away = Some(SentAway {
            at: now,
            mode,
            reached: false,
        });
    }

    /// Whether the drone stands away from the deck, according to forecast and odometry. An order to land does
    /// not imply a cleared deck, and a drone whose vessel is unknown may be standing on the deck.
    fn is_away_from_deck(&self, now: DroneTime) -> bool {
        let both = self.estimate.fresh(now).zip(self.inputs.deck(now));
        let apart = both.map(|(s, deck)| s.position() - Vector3::from(deck.position));
        apart.is_some_and(|r| r.xy().norm() > AWAY_FROM_DECK_M)
    }
    /// Arms the drone on the ground away from the deck, if configured, in the pilot's mode and with a landing
    /// ordered. On the deck only a take-off starts the motors, after the crew's clearance and a countdown.
    pub(super) fn arm(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let Some(peer) = &self.peer else { return };
        if peer.mode != AutopilotMode::Offboard {
            self.commands.arm_tries = 0;
        }
        if peer.armed {
            // A later disarm comes from the pilot, or from us on the deck.
            self.commands.arm_tries = ARM_TRIES;
        }
        let mission = self.inputs.fresh_mission(now);
        let commanded =
            mission.is_some_and(|m| m.state == State::Idle && m.waiting.code == ReasonCode::NotFlying);
        if !self.config.may_arm
            || self.control_authority() != ControlAuthority::Disarmed
            || peer.landed(now) != LandedState::OnGround
            || !commanded
            || self.commands.arm_tries >= ARM_TRIES
            || !self.commands.pause.is_ready(now)
            || !self.is_away_from_deck(now)
        {
            return;
        }
        out.send(CommandLong::new(
            peer.address,
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [1.0],
        ));
        self.commands.arm_tries += 1;
        self.commands.pause.restart(now, COMMAND_PAUSE);
    }
}

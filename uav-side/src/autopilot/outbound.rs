//! What is done with the pilot's word, the battery and the permission to arm.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{
    AutopilotMode, Header, LandedState, Motors, Phase, ReasonCode, SetPoint, SetPointKind, State,
};
use alight_shared::time::Span;
use alight_shared::topics;
use nalgebra::Vector3;

use super::disarm::{ContactEvidence, DisarmDecision};
use super::message::{Address, AttitudeTarget, CUSTOM_MODE, CommandLong, Message, PositionTarget, command};
use super::modes::Firmware;
use super::{AutopilotLink, AutopilotOut, ControlAuthority, Instant, thrust};

/// The pilot's word is repeated this often while it says nothing new, s: 50 Hz.
const REPEAT_S: f64 = 0.02;
/// An offered place further than this from the drone is none to hold, m.
const OFFER_WITHIN_M: f64 = 3.0;
/// A rangefinder's word counts as evidence for so long.
const RANGE_STALE: Span = Span::from_millis(200);
/// A drone that was believed on the deck, and is not, goes up by this, m.
const CLEAR_M: f64 = 1.0;
/// With the rangefinder below this the deck may carry the drone, m.
const NEAR_M: f64 = 0.6;
/// Between two commands to arm or to divert, s.
const COMMAND_PAUSE_S: f64 = 1.0;
/// Commands to arm, at most.
const ARM_TRIES: u32 = 3;

impl AutopilotLink {
    /// The deck may carry the drone: what hovers cannot be learnt.
    pub(super) fn may_touch(&self, now: Instant) -> bool {
        let near = self
            .range
            .is_some_and(|r| now - r.header.at <= RANGE_STALE && r.range_m < NEAR_M);
        near || self
            .mission
            .fresh(now, topics::MISSION.stale_after)
            .is_some_and(|m| matches!(m.state, State::Flare | State::Landed))
    }

    /// The evidence of contact beside the pilot's word.
    fn contact(&self, now: Instant) -> ContactEvidence {
        let g = &self.geometry;
        let mission = self.mission.fresh(now, topics::MISSION.stale_after);
        let state = self
            .state
            .filter(|s| now - s.header.at <= topics::DRONE_STATE.stale_after);
        let deck = self
            .forecast
            .fresh(now, topics::FORECAST.stale_after)
            .and_then(|f| f.at(now.max(f.header.at)));
        let below = state.zip(deck).map(|(s, d)| {
            let apart = s.position() - Vector3::from(d.position);
            let height = d.normal().dot(&apart) - g.feet_below_m;
            (height, (s.velocity() - Vector3::from(d.velocity)).norm())
        });
        let feet = g.feet_below_m - g.rangefinder_m[2];
        let hover = self.hover.value();
        let peer = self.peer.as_ref();
        let told = peer
            .and_then(|p| p.thrust_now(now))
            .map(|t| thrust::fraction(t, self.config.thrust_curve));
        ContactEvidence {
            landing: mission.is_some_and(|m| match m.state {
                State::Descent | State::Flare | State::Landed => true,
                State::Idle
                | State::GetAltitude
                | State::Approach
                | State::Tracking
                | State::TrackingStable
                | State::Hold
                | State::GaveUp => false,
            }),
            range_height: self
                .range
                .filter(|r| now - r.header.at <= RANGE_STALE)
                .map(|r| r.range_m - feet),
            forecast_height: below.map(|(h, _)| h),
            speed: below
                .map(|(_, v)| v)
                .or_else(|| state.map(|s| s.velocity().norm())),
            load_factor: state.and(self.force).map(|f| f / GRAVITY),
            thrust: told.map(|t| t / hover),
            reports_on_ground: peer.is_some_and(|p| p.landed == LandedState::OnGround),
        }
    }

    /// What the autopilot is to be told of the pilot's set-point, while Alight commands.
    fn apply(&mut self, now: Instant, wanted: &SetPoint, out: &mut AutopilotOut) -> Option<SetPoint> {
        if wanted.motors == Motors::Run {
            self.disarm.clear();
            (self.inhibited, self.held) = (None, None);
            if wanted.kind == SetPointKind::None {
                return None;
            }
            self.flown = Some(*wanted);
            return Some(*wanted);
        }
        let evidence = self.contact(now);
        let before = self.disarm.sent();
        let thrust_off = SetPoint {
            kind: SetPointKind::Attitude,
            thrust: 0.0,
            rates: [0.0; 3],
            ..*wanted
        };
        match self.disarm.step(now, &evidence, &self.config.disarm) {
            DisarmDecision::Press => match self.flown {
                Some(flown) => Some(flown),
                None => self.hold_above(now),
            },
            DisarmDecision::Command => {
                let to = self.peer.as_ref().map(|p| p.address).unwrap_or_default();
                out.messages.push(Message::Command(CommandLong {
                    to,
                    command: command::ARM_DISARM,
                    confirmation: u8::try_from(before).unwrap_or(u8::MAX),
                    parameters: [0.0, command::FORCE, 0.0, 0.0, 0.0, 0.0, 0.0],
                }));
                if self.disarm.sent() == self.config.disarm.tries {
                    out.texts.push(format!(
                        "still armed after {} commands to disarm on the deck: disarm it by hand",
                        self.disarm.sent()
                    ));
                }
                Some(thrust_off)
            }
            DisarmDecision::Idle => {
                (self.inhibited, self.held) = (None, None);
                Some(thrust_off)
            }
            DisarmDecision::InAir(inhibit) => {
                if self.inhibited != Some(inhibit) {
                    self.inhibited = Some(inhibit);
                    out.texts.push(format!(
                        "no disarm, the drone climbs by {CLEAR_M} m and holds: {inhibit}"
                    ));
                }
                self.hold_above(now)
            }
        }
    }

    /// A place a little above where it was first asked for, for the autopilot's own loop.
    fn hold_above(&mut self, now: Instant) -> Option<SetPoint> {
        if self.held.is_none() {
            let s = self.state?;
            self.held = Some(SetPoint {
                kind: SetPointKind::Trajectory,
                position: (s.position() - Vector3::z() * CLEAR_M).into(),
                yaw: s.euler().z,
                ..SetPoint::default()
            });
        }
        self.held.map(|s| SetPoint {
            header: Header::new(0, self.drone_id, self.boot, 0, now),
            ..s
        })
    }

    /// A hold in the drone's place that a person may hand over to.
    fn offered(&self, wanted: &SetPoint) -> Option<SetPoint> {
        let here = self.state?.position();
        let idle = self.mission.get().is_none_or(|m| m.state.phase() == Phase::None);
        (wanted.kind == SetPointKind::Trajectory
            && wanted.motors == Motors::Run
            && idle
            && (Vector3::from(wanted.position) - here).norm() <= OFFER_WITHIN_M)
            .then_some(*wanted)
    }

    /// A hold before a landing is commanded: GUIDED holds by itself, and its own take-off command would be
    /// overridden. (OFFBOARD is left without a stream of set-points.)
    fn leaves_alone(&self, wanted: &SetPoint) -> bool {
        let idle = self.mission.get().is_some_and(|m| m.state.phase() == Phase::None);
        idle && wanted.kind == SetPointKind::Trajectory && wanted.motors == Motors::Run
    }

    /// The pilot's set-point, as far as it may go out now.
    pub(super) fn set_point(&mut self, now: Instant, new: bool, out: &mut AutopilotOut) {
        let control_authority = self.authority.control_authority();
        let wanted = self.set_point.fresh(now, topics::SET_POINT.stale_after).copied();
        let since = self.sent_at.map_or(f64::INFINITY, |t| (now - t).secs());
        let due = since >= REPEAT_S || new && since >= 0.8 / self.config.set_point_hz;
        let Some(wanted) = wanted else {
            self.disarm.clear();
            return;
        };
        if !due {
            return;
        }
        let px4 = self.peer.as_ref().is_some_and(|p| p.firmware == Firmware::Px4);
        let told = if control_authority.commands() && !px4 && self.leaves_alone(&wanted) {
            self.disarm.clear();
            None
        } else if control_authority.commands() {
            self.apply(now, &wanted, out)
        } else {
            self.disarm.clear();
            // PX4 wants a stream of set-points before a person can choose OFFBOARD; in other modes it
            // follows none. ArduCopter needs no offer.
            (control_authority.may_offer() && px4)
                .then(|| self.offered(&wanted))
                .flatten()
        };
        if let Some(told) = told
            && let Some(to) = self.peer.as_ref().map(|p| p.address)
        {
            out.messages.push(self.to_mavlink(to, &told));
            self.sent_at = Some(now);
            self.set_points = self.set_points.saturating_add(1);
        }
    }

    /// A set-point in the autopilot's own frame.
    pub(super) fn in_its_frame(&self, s: &SetPoint) -> SetPoint {
        let s = self.smooth.for_autopilot(s);
        let shift = self.shift.unwrap_or_default();
        SetPoint {
            position: (Vector3::from(s.position) - shift).into(),
            ..s
        }
    }

    /// A set-point in MAVLink's words and in the autopilot's frame.
    fn to_mavlink(&self, to: Address, s: &SetPoint) -> Message {
        let s = self.in_its_frame(s);
        if s.kind == SetPointKind::Attitude {
            let tilt_compensation = self
                .peer
                .as_ref()
                .map_or(1.0, |p| p.tilt_compensation(s.attitude));
            return Message::AttitudeThrust(AttitudeTarget {
                to,
                attitude: s.attitude,
                rates: self.config.send_rates.then_some(s.rates),
                thrust: tilt_compensation * thrust::command(s.thrust, self.config.thrust_curve),
            });
        }
        Message::Position(PositionTarget {
            to,
            position: s.position,
            velocity: s.velocity,
            acceleration: s.acceleration,
            yaw: s.yaw,
            yaw_rate: s.yaw_rate,
        })
    }

    /// The battery's last reserve: the drone is given to the autopilot's own return or landing.
    pub(super) fn divert(&mut self, now: Instant, out: &mut AutopilotOut) {
        let b = self.config.battery;
        let Some(peer) = &self.peer else { return };
        let Some(charge) = peer.charge().filter(|c| *c < b.reserve) else {
            self.low_since = None;
            return;
        };
        let since = *self.low_since.get_or_insert(now);
        let control_authority = self.authority.control_authority();
        // So near the deck landing is the quickest way down; on it there is nothing to divert.
        let landing = self
            .mission
            .fresh(now, topics::MISSION.stale_after)
            .is_some_and(|m| matches!(m.state, State::Flare | State::Landed));
        let flare = landing && self.inhibited.is_none();
        let given = matches!(control_authority, ControlAuthority::Diverted(_))
            && peer.mode == AutopilotMode::Offboard;
        if !(control_authority.commands() && !flare || given)
            || (now - since).secs() < b.for_s
            || now < self.command_next
            || self.diversions >= b.tries
        {
            return;
        }
        let Some([main, sub]) = peer.firmware.diversion(b.diversion) else {
            return;
        };
        if !given {
            out.texts.push(format!(
                "battery at {:.0} %, below the reserve of {:.0} %",
                100.0 * charge,
                100.0 * b.reserve
            ));
        }
        let to = peer.address;
        self.diversions += 1;
        self.command_next = now + Span::from_secs(COMMAND_PAUSE_S);
        self.authority.divert(now, b.diversion);
        out.messages.push(Message::Command(CommandLong {
            to,
            command: command::SET_MODE,
            confirmation: 0,
            parameters: [f64::from(CUSTOM_MODE), main, sub, 0.0, 0.0, 0.0, 0.0],
        }));
    }

    /// Arms on the ground, when that is configured, a person gave the mode and a landing is commanded.
    pub(super) fn arm(&mut self, now: Instant, out: &mut AutopilotOut) {
        let Some(peer) = &self.peer else { return };
        if peer.mode != AutopilotMode::Offboard {
            self.arm_tries = 0;
        }
        if peer.armed {
            // A disarm afterwards is somebody's will, or ours on the deck.
            self.arm_tries = ARM_TRIES;
        }
        let commanded = self
            .mission
            .fresh(now, topics::MISSION.stale_after)
            .is_some_and(|m| m.state == State::Idle && matches!(m.waiting.code, ReasonCode::NotFlying));
        if !self.config.may_arm
            || self.authority.control_authority() != ControlAuthority::Disarmed
            || peer.landed != LandedState::OnGround
            || !commanded
            || self.arm_tries >= ARM_TRIES
            || now < self.command_next
        {
            return;
        }
        let to = peer.address;
        self.arm_tries += 1;
        self.command_next = now + Span::from_secs(COMMAND_PAUSE_S);
        out.messages.push(Message::Command(CommandLong {
            to,
            command: command::ARM_DISARM,
            confirmation: 0,
            parameters: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        }));
    }
}

//! MAVLink link to an autopilot (PX4, ArduCopter) as a node with messages as input and output. It has no
//! socket and no clock, so a test can simulate the autopilot on the same clock. Its process is `alight
//! autopilot`.
//!
//! Read in this order:
//! - [`message`] (messages of the link), [`authority`] (control authority and its reason), [`set_point_loss`], `failsafe`;
//! - `rotors` (spin-up), `heading` (alignment), [`disarm`] and `take_off` (stopping and starting the motors);
//! - this file (one step), [`inbound`] and [`outbound`] (its two halves), [`inputs`] (messages of the other nodes,
//!   shadow mode);
//! - [`ground_station`], [`station`] and [`rc_switch`] (operators at a ground station and at the remote control, and
//!   their [`orders`]), [`station_parameters`] (mission settings of a ground station);
//! - [`guidance`] (the autopilot's own landing), [`own_mission`] (its own mission), `beacon` (vessel position
//!   from other systems, with [`ais`]), `moving_base` (RTCM for the drone's receiver and the relative
//!   position that it measures, with [`receiver`]);
//! - [`checkpoint`], [`clock`], [`streams`], [`drone_state`], [`modes`], [`parameters`] (autopilot parameters
//!   that affect a landing), and [`wire`] (bytes).
//!
//! Safety does not depend on this node. Without its set-points PX4 leaves OFFBOARD after COM_OF_LOSS_T and
//! enters the failsafe of COM_OBL_RC_ACT; ArduCopter stops after GUID_TIMEOUT and holds in GUIDED (after an
//! attitude set-point: level, without climb).

pub mod ais;
pub mod authority;
mod beacon;
mod checkpoint;
mod clock;
pub mod config;
mod deck;
mod disarm;
mod drone_state;
mod failsafe;
pub mod ground_station;
mod guidance;
mod heading;
mod inbound;
mod inputs;
pub mod message;
pub mod modes;
mod moving_base;
mod orders;
mod origin;
mod outbound;
pub mod own_mission;
pub mod parameters;
mod peer;
pub mod place_report;
mod rc_switch;
pub mod receiver;
mod rotors;
mod set_point_loss;
mod station;
mod station_parameters;
mod streams;
mod take_off;
mod thrust;
pub mod wire;

pub use authority::ControlAuthority;
pub use config::{AutopilotLinkConfig, DeckMessage, Diversion};
pub use disarm::DisarmInhibit;

use alight_shared::{
    admission::Periodic,
    bus::wiring,
    geometry::DroneGeometry,
    msg::{
        AutopilotMode, AutopilotState, Command, DeckBeacon, DeckForecast, DroneState, Header, LandedState,
        LinkCheckpoint, MissionState, OwnMission, Phase, RangeSample, Reason, ReasonCode, RelativePlace,
        RtcmFrames, SetPoint, SettingsOrder, State,
    },
    node::Node,
    time::{DroneClock, DroneTime, Span},
};
use serde::{Deserialize, Serialize};

use crate::odometry::OdometryConfig;
use authority::{AuthorityEvidence, AuthorityStateMachine};
use beacon::OtherSystems;
use checkpoint::LinkSuccession;
use clock::RemoteClock;
use disarm::ForcedDisarm;
use drone_state::DroneEstimate;
use failsafe::FailsafeMonitor;
use ground_station::Operators;
use inputs::LinkInputs;
use message::{
    Address, MavAutopilot, MavMessage, MavModeFlag, MavType, MavlinkFrame, MavlinkMessage, heartbeat,
    severity,
};
use modes::Firmware;
use moving_base::{MovingBase, RtcmTarget};
use outbound::{LinkCommands, SetPointStream};
use own_mission::OwnMissionSequence;
use peer::MavlinkPeer;

pub const MAX_FRAMES: usize = 512;
const MAX_TEXTS: usize = 8;
/// Heartbeat period, as is usual in MAVLink.
const HEARTBEAT: Span = Span::from_millis(1000);
/// Period of the alarm that a landed drone is still armed.
const STILL_ARMED: Span = Span::from_millis(10_000);
/// Period of the alarm that another control holds the drone low above the deck.
const HELD_LOW: Span = Span::from_millis(5000);
const STATE: Span = Span::from_millis(100);
/// Maximum time until our command counts as confirmed or rejected: several heartbeats and requests.
const UNDECIDED: Span = Span::from_millis(5000);

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct AutopilotIn {
    /// Frames from the link, in order of arrival.
    pub received: Vec<MavlinkFrame>,
    pub set_point: Option<SetPoint>,
    pub mission: Option<MissionState>,
    pub forecast: Option<DeckForecast>,
    pub rtcm: Vec<RtcmFrames<DroneClock>>,
    /// Checkpoint of a crashed predecessor (boot number 0: none), read until this link publishes its own.
    pub checkpoint: Option<LinkCheckpoint>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct AutopilotOut {
    pub from: Address,
    pub messages: Vec<MavlinkMessage>,
    /// Smoothed odometry, in time order.
    pub odometry: Vec<DroneState>,
    pub state: Option<AutopilotState>,
    pub ranges: Vec<RangeSample>,
    pub checkpoint: Option<LinkCheckpoint>,
    pub command: Option<Command>,
    pub settings: Option<SettingsOrder>,
    pub beacon: Option<DeckBeacon>,
    pub relative: Vec<RelativePlace>,
    pub rtcm: Vec<Vec<u8>>,
    /// Texts on authority changes and denied commands, and the autopilot's own texts.
    pub texts: Vec<String>,
}

wiring! {
    /// Odometry is written last, because it triggers the other nodes.
    AutopilotPorts of AutopilotLink: AutopilotIn => AutopilotOut {
        reads {
            newest set_point: SetPoint,
            newest mission: MissionState,
            newest forecast: DeckForecast,
            all rtcm: RtcmFrames<DroneClock>,
        }
        edge { received }
        writes {
            command: Command,
            settings: SettingsOrder,
            beacon: DeckBeacon,
            relative: RelativePlace,
            ranges: RangeSample,
            state: AutopilotState,
            odometry: DroneState,
        }
        wakes { SetPoint }
        saves { checkpoint: LinkCheckpoint }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkMetrics {
    pub clock_uncertainty_s: f64,
    /// Number of rejected samples and TIMESYNC answers.
    pub rejected: u32,
    pub restarts: u32,
    pub hover_thrust: f64,
    pub set_points: u32,
    pub rtcm_passed_on: u32,
    /// Number of RTCM frames that were too long, too old or damaged, or that came before an autopilot was
    /// found.
    pub rtcm_dropped: u32,
}

#[derive(Clone, Copy, Debug)]
enum Output {
    Odometry,
    State,
    Range,
    Checkpoint,
    Command,
    Settings,
    Beacon,
    Relative,
}

#[derive(Clone, Copy, Debug, Default)]
struct OutputHeaders {
    drone_id: u32,
    boot: u32,
    sequences: [u32; 8],
}

impl OutputHeaders {
    fn next(&mut self, output: Output, at: DroneTime) -> Header<DroneClock> {
        let s = &mut self.sequences[output as usize];
        *s = s.wrapping_add(1);
        Header::new(0, self.drone_id, self.boot, *s, at)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Timers {
    heartbeat: Periodic<DroneClock>,
    state: Periodic<DroneClock>,
    deck: Periodic<DroneClock>,
    low: Periodic<DroneClock>,
}

#[derive(Clone, Debug, Default)]
pub struct AutopilotLink {
    config: AutopilotLinkConfig,
    headers: OutputHeaders,
    succession: LinkSuccession,

    peer: Option<MavlinkPeer>,
    others: OtherSystems,
    moving_base: MovingBase,
    clock: RemoteClock,
    estimate: DroneEstimate,

    inputs: LinkInputs,
    authority: AuthorityStateMachine,
    disarm: ForcedDisarm,
    failsafe: FailsafeMonitor,
    stream: SetPointStream,
    operators: Operators,
    commands: LinkCommands,
    own_mission: OwnMissionSequence,
    timers: Timers,
}

impl AutopilotLink {
    /// `attitudes`: whether the pilot node sends attitude set-points.
    pub fn new(
        config: &AutopilotLinkConfig,
        odometry: &OdometryConfig,
        geometry: &DroneGeometry,
        attitudes: bool,
        drone_id: u32,
        boot: u32,
    ) -> Self {
        let mut link = AutopilotLink {
            config: config.clone(),
            estimate: DroneEstimate::new(odometry, geometry, config.hover_thrust),
            ..AutopilotLink::default()
        };
        link.headers.drone_id = drone_id;
        link.headers.boot = boot;
        link.stream.attitudes = attitudes;
        link
    }
    pub fn control_authority(&self) -> ControlAuthority {
        self.authority.control_authority()
    }
    pub fn metrics(&self, now: DroneTime) -> LinkMetrics {
        LinkMetrics {
            clock_uncertainty_s: self.clock.uncertainty_s(now),
            rejected: (self.clock.rejected).saturating_add(self.estimate.assembler.rejected),
            restarts: self.clock.restarts,
            hover_thrust: self.estimate.hover.value(),
            set_points: self.stream.sent,
            rtcm_passed_on: self.moving_base.passed_on,
            rtcm_dropped: self.moving_base.dropped,
        }
    }
    /// Our address: the vehicle's system number unless configured otherwise.
    fn address(&self) -> Address {
        let system = match self.config.system {
            0 => self.peer.as_ref().map_or(1, |p| p.address.system),
            configured => configured,
        };
        Address::new(system, self.config.component)
    }
    fn rtcm_target(&self) -> RtcmTarget {
        match &self.peer {
            _ if !self.config.receiver.is_empty() => RtcmTarget::Receiver,
            Some(_) => RtcmTarget::Autopilot,
            None => RtcmTarget::Nothing,
        }
    }
    fn firmware(&self) -> Option<Firmware> {
        self.peer.as_ref().map(|p| p.firmware)
    }
    fn applied_thrust(&self, now: DroneTime) -> Option<f64> {
        let t = self.peer.as_ref()?.thrust_now(now)?;
        Some(thrust::fraction(t, self.config.thrust_curve))
    }
    fn thrust_of_hover(&self, now: DroneTime) -> Option<f64> {
        self.applied_thrust(now).map(|t| t / self.estimate.hover.value())
    }
    fn evidence(&self, now: DroneTime, heartbeat: bool) -> AuthorityEvidence {
        let p = self.peer.as_ref();
        let e = &self.estimate;
        let recent = |at: DroneTime, s: f64| (now - at).secs() <= s;
        AuthorityEvidence {
            found: p.is_some(),
            alive: p.is_some_and(|p| recent(p.heartbeat_at, self.config.heartbeat_loss_s)),
            several: self.other_autopilot(now).is_some(),
            clock: self.clock.is_synchronised(),
            origin: e.origin.datum.is_some(),
            heading: e.heading.was_aligned(),
            odometry: if e.heading.was_aligned() {
                (e.state).is_some_and(|s| recent(s.header.at, self.config.odometry_loss_s))
            } else {
                // The heading must be monitored before odometry is forwarded.
                e.heading.is_watched(now, self.config.odometry_loss_s)
            },
            thrust: p.and_then(|p| p.parameters.thrust_is_thrust()),
            heartbeat,
            mode: p.map_or(AutopilotMode::Other, |p| p.mode),
            armed: p.is_some_and(|p| p.armed),
            set_points_lost: self.falls_back(),
        }
    }
    /// Whether the autopilot has left the mode of our set-points by itself.
    fn falls_back(&self) -> bool {
        self.stream.loss.is_lost() || self.failsafe.holds()
    }

    /// Sends messages that are due under any authority: heartbeat, clock, streams, parameters.
    fn send_periodic(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        if self.timers.heartbeat.is_due_spaced(now, HEARTBEAT) {
            out.send(heartbeat(
                MavAutopilot::MAV_AUTOPILOT_INVALID,
                MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
                0,
            ));
        }
        let Some(peer) = &mut self.peer else { return };
        if let Some(request) = self.clock.ask(now, self.config.timesync_hz) {
            out.send(MavMessage::TIMESYNC(request));
        }
        if let Some(request) = peer.streams.ask(now, peer.address) {
            out.send(request);
        }
        out.messages.extend(peer.parameters.ask(now, peer.address));
        for request in self.estimate.origin.ask(now, peer.address) {
            out.send(request);
        }
    }

    /// State for the other nodes; reports OFFBOARD only while this link may use it.
    fn state_report(&mut self, now: DroneTime, changed: bool, alive: bool) -> Option<AutopilotState> {
        if !alive || self.is_undecided(now) || !self.timers.state.is_ready(now) && !changed {
            return None;
        }
        self.timers.state.restart(now, STATE);
        let header = self.headers.next(Output::State, now);
        let origin = &self.estimate.origin;
        let hover = &self.estimate.hover;
        let p = self.peer.as_ref()?;
        let ours = self.control_authority().has_the_mode();
        let learned = hover.is_learned(self.config.hover_thrust_s);
        Some(AutopilotState {
            header,
            armed: p.armed,
            mode: match p.mode {
                AutopilotMode::Offboard if !ours => AutopilotMode::Other,
                mode => mode,
            },
            set_points_lost: self.falls_back(),
            landed: p.landed(now),
            origin_sea_m: (origin.datum.zip(origin.geoid_m)).map(|(d, geoid_m)| d.height_m - geoid_m),
            battery: p.charge(now),
            battery_v: p.voltage_v(now),
            battery_a: p.current_a(now),
            battery_used_ah: p.used_ah(now),
            thrust: self.applied_thrust(now),
            hover_thrust: if learned { hover.value() } else { 0.0 },
            rejection: self.rejection(now, p),
            warning: p.parameters.warning(),
            shadow: self.inputs.shadow(now, self.estimate.fresh(now)),
            own_mission: self.flies_alone(),
            home: p.home,
        })
    }
    fn rejection(&self, now: DroneTime, p: &MavlinkPeer) -> Reason {
        if self.operators.switch.is_held_on_abort() {
            return ReasonCode::SwitchAborts.into();
        }
        if let Some(other) = self.other_autopilot(now) {
            let own = f64::from(p.address.system);
            return Reason::new(ReasonCode::SeveralAutopilots, own, f64::from(other));
        }
        if !self.clock.is_synchronised() {
            return ReasonCode::NoTimesync.into();
        }
        match self.estimate.origin.datum {
            None => ReasonCode::NoOrigin.into(),
            Some(_) if !self.estimate.heading.is_aligned(now) => ReasonCode::HeadingUnaligned.into(),
            Some(_) if self.config.check_parameters => p.parameters.rejection(),
            Some(_) => Reason::default(),
        }
    }
    /// Whether the drone is armed in our mode while our command is neither confirmed nor rejected. After a
    /// set-point loss this state must not count as a pilot's takeover.
    fn is_undecided(&self, now: DroneTime) -> bool {
        let ours = |p: &MavlinkPeer| p.armed && p.mode == AutopilotMode::Offboard;
        self.peer.as_ref().is_some_and(ours)
            && now - self.authority.since() <= UNDECIDED
            && matches!(
                self.control_authority(),
                ControlAuthority::Searching
                    | ControlAuthority::LinkLost
                    | ControlAuthority::NoOrigin
                    | ControlAuthority::NoHeading
                    | ControlAuthority::OptionUnknown
                    | ControlAuthority::Standby { .. }
                    | ControlAuthority::TakenOver { .. }
            )
    }
    /// Fields whose changes are published at once.
    fn mode(&self, now: DroneTime) -> Option<(AutopilotMode, bool, LandedState, OwnMission)> {
        let peer = self.peer.as_ref();
        peer.map(|p| (p.mode, p.armed, p.landed(now), self.flies_alone()))
    }
    /// Flight of the autopilot without our set-points.
    fn flies_alone(&self) -> OwnMission {
        if self.commands.is_sent_away() {
            OwnMission::SentAway
        } else {
            self.own_mission.monitor.now()
        }
    }
}

impl Node for AutopilotLink {
    type Clock = DroneClock;
    type In = AutopilotIn;
    type Out = AutopilotOut;

    fn step(&mut self, now: DroneTime, input: &AutopilotIn) -> AutopilotOut {
        let mut out = AutopilotOut::default();
        let before = (self.mode(now), self.control_authority());
        let mut heartbeat = false;
        self.begin(now, input.checkpoint.as_ref(), &mut out);
        let target = self.rtcm_target();
        self.moving_base.take(now, &input.rtcm, target, &mut out);
        for frame in input.received.iter().take(MAX_FRAMES) {
            heartbeat |= self.receive(now, frame, &mut out);
        }
        let peer = self.peer.as_ref().map(|p| p.address);
        let received = input.received.iter().any(|f| Some(f.from) == peer);
        let [aborted, new] = self.inputs.take(now, input);
        if aborted {
            self.failsafe.withdraw();
            self.operators.station.stopped(now);
        }

        if let Some(peer) = &self.peer {
            let s = &mut self.stream;
            s.loss.watch(now, received, s.sent_at, peer, &self.clock);
            let remote_lost = self.operators.switch.is_remote_lost();
            let phase = self.inputs.fresh_state(now).map(State::phase);
            let lands = matches!(phase, Some(Phase::Follow | Phase::Landing));
            self.failsafe.step(now, peer, lands, remote_lost);
            (self.own_mission.monitor).step(peer.armed, peer.flies_mission, peer.mode);
        }
        self.watch_standing(now);
        let evidence = self.evidence(now, heartbeat);
        self.authority.step(now, &evidence);
        if evidence.mode != AutopilotMode::Offboard {
            self.commands.diversions = 0;
        }
        self.commands.follow_mode(now, evidence.armed, evidence.mode);
        if self.inputs.may_command() {
            self.divert(now, &mut out);
            self.send_set_point(now, new, &mut out);
            self.arm(now, &mut out);
            self.take_off(now, &mut out);
            let own = self.flies_alone();
            if let Some(peer) = &self.peer {
                self.failsafe.ask(now, peer, &mut out);
                let peer = (peer, self.authority.control_authority());
                let mission = self.inputs.fresh_mission(now);
                let pause = &mut self.commands.pause;
                self.own_mission.command(now, peer, own, mission, pause, &mut out);
            }
            self.send_home(now, &mut out);
        }
        self.report_armed(now, &mut out);
        self.report_low(now, &mut out);
        if self.peer.is_some() {
            let reports = &mut self.operators.reports;
            reports.publish(now, &self.inputs, &self.estimate, &self.clock, &mut out);
        }
        let mission = self.inputs.mission.get();
        self.operators.publish_order(now, mission, &mut out);
        self.publish_settings(now, &mut out);
        self.send_periodic(now, &mut out);
        if let Some(peer) = &self.peer {
            self.own_mission.ask(now, peer, &mut out);
        }
        self.publish_deck(now, &mut out);
        self.disarm_own_landing(now, &mut out);

        let after = (self.mode(now), self.control_authority());
        if after.1 != before.1 {
            if matches!(after.1, ControlAuthority::TakenOver { .. }) {
                self.operators.station.stopped(now);
            }
            out.texts.push(after.1.to_string());
        }
        let peer = &mut self.peer;
        out.texts
            .extend(peer.iter_mut().flat_map(|p| p.parameters.news()));
        if let Some(text) = peer.as_mut().and_then(|p| p.battery_news(now)) {
            out.alarm(severity::WARNING, text);
        }
        if let Some((peer, text)) = peer.as_ref().zip(self.estimate.assembler.news()) {
            out.alarm(severity::WARNING, format!("{}: {text}", peer.firmware.name()));
        }
        out.checkpoint = self.checkpoint(now);
        out.state = self.state_report(now, after != before, evidence.alive);
        out.texts.truncate(MAX_TEXTS);
        out.from = self.address();
        out
    }
}

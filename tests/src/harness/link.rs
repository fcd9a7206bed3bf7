//! A drone's simulated autopilot, the computer's link to it, and the wire between them, byte by byte.

use std::collections::VecDeque;
use std::rc::Rc;

use alight_shared::msg::{AutopilotState, Command, LinkCheckpoint, SettingsOrder};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_uav::autopilot::message::{Address, Frame, Message, command};
use alight_uav::autopilot::wire::{Decoder, Encoder};
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotOut, ControlAuthority};

use crate::autopilots::simulated::SimulatedAutopilot;
use crate::physics::drone::{AutopilotConfig, MAX_ROTORS, PlantState};
use crate::physics::streams::Streams;
use crate::sensors::noise::Noise;

/// Makes the link's node for a boot.
pub type MakeLink = Rc<dyn Fn(u32) -> AutopilotLink>;

/// What a successor is given of its crashed predecessor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checkpoints {
    /// Its checkpoint.
    Kept,
    /// Nothing.
    Lost,
}

/// One way of the wire: bytes arrive in order, after a delay that varies.
pub struct Wire {
    delay: Span,
    jitter: Span,
    noise: Noise,
    under_way: VecDeque<(Time<TrueTime>, Vec<u8>)>,
    decoder: Decoder,
    encoder: Encoder,
}

impl Wire {
    fn new(config: &AutopilotConfig, streams: &Streams, name: &str) -> Wire {
        Wire {
            delay: Span::from_secs(config.wire_s),
            jitter: Span::from_secs(config.wire_jitter_s),
            noise: Noise::new(streams, name),
            under_way: VecDeque::new(),
            decoder: Decoder::default(),
            encoder: Encoder::default(),
        }
    }
    /// Puts a message onto the wire.
    pub fn send(&mut self, t: Time<TrueTime>, from: Address, message: &Message) {
        // What the dialect does not know is not sent.
        let Some(bytes) = self.encoder.frame(from, message) else {
            return;
        };
        let arrival = t + self.delay + Span::from_secs(self.jitter.secs() * self.noise.uniform());
        let arrival = self
            .under_way
            .back()
            .map_or(arrival, |(last, _)| arrival.max(*last));
        self.under_way.push_back((arrival, bytes));
    }
    /// What has arrived by `t`; nothing of it where the cable is out.
    fn received(&mut self, t: Time<TrueTime>, cut: bool) -> Vec<Frame> {
        let arrived = self.under_way.iter().take_while(|(at, _)| *at <= t).count();
        for (_, bytes) in self.under_way.drain(..arrived).filter(|_| !cut) {
            self.decoder.push(&bytes);
        }
        core::iter::from_fn(|| self.decoder.next_frame()).collect()
    }
}

/// Both ends of the wire.
pub struct LinkedAutopilot {
    /// The autopilot.
    pub autopilot: SimulatedAutopilot,
    /// The link's node; None: its process is dead.
    link: Option<AutopilotLink>,
    /// What its supervisor keeps of it.
    pub kept: LinkCheckpoint,
    /// The cable is out.
    pub cut: bool,
    /// The link's process stands still: what the autopilot sends waits on the wire.
    pub frozen: bool,
    /// To the link.
    pub up: Wire,
    down: Wire,
    /// Set-points, modes and orders to arm or disarm that the link has sent.
    pub commanded: u32,
    make: MakeLink,
    boot: u32,
    /// A state that was reported where only set-points were looked for.
    state: Option<AutopilotState>,
    /// The same of a command.
    command: Option<Command>,
    /// The same of the mission's settings.
    settings: Option<SettingsOrder>,
}

impl LinkedAutopilot {
    /// `make` makes the link of a boot; this is the first. The wire's delays come from the streams `link.up` and
    /// `link.down`.
    pub fn new(
        config: &AutopilotConfig,
        streams: &Streams,
        autopilot: SimulatedAutopilot,
        make: MakeLink,
        boot: u32,
    ) -> LinkedAutopilot {
        LinkedAutopilot {
            autopilot,
            link: Some(make(boot)),
            kept: LinkCheckpoint::default(),
            cut: false,
            frozen: false,
            up: Wire::new(config, streams, "link.up"),
            down: Wire::new(config, streams, "link.down"),
            commanded: 0,
            make,
            boot,
            state: None,
            command: None,
            settings: None,
        }
    }
    /// The link's process dies.
    pub fn kill(&mut self) {
        self.link = None;
    }
    /// Another takes its place, with or without what was kept of it.
    pub fn start(&mut self, checkpoints: Checkpoints) {
        if checkpoints == Checkpoints::Lost {
            self.kept = LinkCheckpoint::default();
        }
        self.boot += 1;
        self.link = Some((self.make)(self.boot));
    }
    /// The link's node; None: its process is dead.
    pub fn node(&self) -> Option<&AutopilotLink> {
        self.link.as_ref()
    }
    /// Who commands, as the link has it.
    pub fn control_authority(&self) -> ControlAuthority {
        self.link
            .as_ref()
            .map_or(ControlAuthority::Searching, AutopilotLink::control_authority)
    }

    /// A turn of the autopilot: rotor commands for the drone's true state; None: motors off.
    pub fn turn(&mut self, truth: &PlantState) -> Option<[f64; MAX_ROTORS]> {
        let arrived = self.down.received(truth.at, self.cut);
        let arrived: Vec<_> = arrived.into_iter().map(|f| f.message).collect();
        let motors = self.autopilot.step(truth, &arrived);
        for message in self.autopilot.sent() {
            self.up.send(truth.at, self.autopilot.address, &message);
        }
        motors
    }
    /// A step of the link with what has arrived from the autopilot: for the drone's other nodes.
    pub fn receive(&mut self, t: Time<TrueTime>, now: Time<DroneClock>) -> AutopilotOut {
        if self.frozen {
            return AutopilotOut::default();
        }
        let received = self.up.received(t, self.cut);
        let mut out = self.step(
            t,
            now,
            AutopilotIn {
                received,
                ..AutopilotIn::default()
            },
        );
        out.state = out.state.or(self.state.take());
        out.command = out.command.or(self.command.take());
        out.settings = out.settings.or(self.settings.take());
        out
    }
    /// A step of the link with what those published. A state that it reports, and an order, is given with what is received
    /// next.
    pub fn send(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, input: AutopilotIn) -> AutopilotOut {
        let mut out = self.step(t, now, input);
        (self.state, self.command) = (out.state.take(), out.command.take());
        self.settings = out.settings.take();
        out
    }
    fn step(&mut self, t: Time<TrueTime>, now: Time<DroneClock>, input: AutopilotIn) -> AutopilotOut {
        let Some(link) = self.link.as_mut().filter(|_| !self.frozen) else {
            return AutopilotOut::default();
        };
        let checkpoint = Some(self.kept);
        let out = link.step(now, &AutopilotIn { checkpoint, ..input });
        self.kept = out.checkpoint.unwrap_or(self.kept);
        for message in &out.messages {
            self.commanded += u32::from(commands(message));
            self.down.send(t, out.from, message);
        }
        out
    }
}

/// Whether it makes the autopilot do something.
fn commands(message: &Message) -> bool {
    match message {
        Message::Position(_) | Message::AttitudeThrust(_) => true,
        Message::Command(c) => matches!(c.command, command::SET_MODE | command::ARM_DISARM),
        _ => false,
    }
}

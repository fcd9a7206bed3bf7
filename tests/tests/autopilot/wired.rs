//! The link's node and an autopilot at protocol level, with a wire between them that takes its time.

use std::collections::VecDeque;

use alight_shared::msg::LinkCheckpoint;
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Time};
use alight_sim::autopilots::fake::FakeAutopilot;
use alight_uav::autopilot::wire::{Decoder, encode};
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotOut};

/// Bytes under way, and when they arrive, s.
#[derive(Default)]
pub struct Wire(VecDeque<(f64, Vec<u8>)>);

impl Wire {
    pub fn send(&mut self, arrival_s: f64, bytes: Vec<u8>) {
        self.0.push_back((arrival_s, bytes));
    }
    fn arrived(&mut self, now_s: f64) -> Vec<Vec<u8>> {
        let n = self.0.iter().take_while(|(at, _)| *at <= now_s + 1e-9).count();
        self.0.drain(..n).map(|(_, bytes)| bytes).collect()
    }
}

/// Both ends of the wire.
pub struct Wired {
    pub link: AutopilotLink,
    /// What the link's supervisor keeps of it.
    pub kept: LinkCheckpoint,
    /// Makes the link of a boot.
    make: Box<dyn Fn(u32) -> AutopilotLink>,
    boot: u32,
    pub autopilot: FakeAutopilot,
    /// Bytes are lost.
    pub cut: bool,
    /// To the link.
    pub up: Wire,
    down: Wire,
    decoder: Decoder,
    sequence: u8,
    /// One way on the wire, s.
    wire_s: f64,
}

impl Wired {
    /// `make` makes the link of a boot.
    pub fn new(
        make: impl Fn(u32) -> AutopilotLink + 'static,
        autopilot: FakeAutopilot,
        wire_s: f64,
    ) -> Wired {
        let boot = 7;
        Wired {
            link: make(boot),
            kept: LinkCheckpoint::default(),
            make: Box::new(make),
            boot,
            autopilot,
            cut: false,
            up: Wire::default(),
            down: Wire::default(),
            decoder: Decoder::default(),
            sequence: 0,
            wire_s,
        }
    }
    /// A new process of the link takes the place of the one before.
    pub fn restart_link(&mut self) {
        self.boot += 1;
        self.link = (self.make)(self.boot);
    }
    fn arrived(cut: bool, wire: &mut Wire, now_s: f64) -> Vec<Vec<u8>> {
        let bytes = wire.arrived(now_s);
        if cut { Vec::new() } else { bytes }
    }
    /// Moves the autopilot on; it was switched on `on_s` ago.
    pub fn step_autopilot(&mut self, now_s: f64, on_s: f64) {
        let bytes = Wired::arrived(self.cut, &mut self.down, now_s);
        for b in self.autopilot.step(now_s + on_s, &bytes) {
            self.up.send(now_s + self.wire_s, b);
        }
    }
    /// The frames that have arrived at the link.
    pub fn received(&mut self, now_s: f64) -> AutopilotIn {
        for b in Wired::arrived(self.cut, &mut self.up, now_s) {
            self.decoder.push(&b);
        }
        AutopilotIn {
            received: core::iter::from_fn(|| self.decoder.next_frame()).collect(),
            ..AutopilotIn::default()
        }
    }
    /// One step of the link, whose messages go on the wire.
    pub fn step_link(&mut self, now_s: f64, now: Time<DroneClock>, input: &AutopilotIn) -> AutopilotOut {
        let checkpoint = Some(self.kept);
        let input = AutopilotIn {
            checkpoint,
            ..input.clone()
        };
        let out = self.link.step(now, &input);
        self.kept = out.checkpoint.unwrap_or(self.kept);
        for message in &out.messages {
            self.sequence = self.sequence.wrapping_add(1);
            let bytes = encode(out.from, self.sequence, message).expect("a message of ours");
            self.down.send(now_s + self.wire_s, bytes);
        }
        out
    }
}

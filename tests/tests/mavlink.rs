//! Whole landings over MAVLink in lock-step: the drone's nodes, the link's node, its bytes on a wire that takes
//! its time, and an autopilot at protocol level (the tests' own) whose rotor outputs fly the simulated drone.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../../uav-side/tests/autopilot/fake_autopilot.rs"]
mod fake_autopilot;

use std::collections::VecDeque;

use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Time};
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::trial::{Watch, land};
use alight_sim::harness::world::{FirmwareLink, FirmwareOutputs, NodeOutputs, World};
use alight_sim::physics::PlantState;
use alight_sim::physics::sea::SeaConfig;
use alight_uav::autopilot::config::AutopilotLinkConfig;
use alight_uav::autopilot::wire::{Decoder, encode};
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotOut, modes};
use fake_autopilot::FakeAutopilot;

/// Bytes under way, and when they arrive (true time, s).
#[derive(Default)]
struct Wire(VecDeque<(f64, Vec<u8>)>);

impl Wire {
    fn send(&mut self, arrival_s: f64, bytes: Vec<u8>) {
        self.0.push_back((arrival_s, bytes));
    }
    fn arrived(&mut self, now_s: f64) -> Vec<Vec<u8>> {
        let n = self.0.iter().take_while(|(at, _)| *at <= now_s + 1e-9).count();
        self.0.drain(..n).map(|(_, bytes)| bytes).collect()
    }
}

/// The link's node on one end of the wire and the autopilot on the other.
struct Linked {
    link: AutopilotLink,
    autopilot: FakeAutopilot,
    decoder: Decoder,
    sequence: u8,
    down: Wire,
    up: Wire,
    /// One way on the wire, s.
    wire_s: f64,
    now_s: f64,
    since_s: Option<f64>,
}

impl Linked {
    fn new(firmware: modes::Firmware, wire_s: f64, nodes: &NodeConfigs) -> Linked {
        let mut autopilot = FakeAutopilot::new(firmware, 0.0);
        autopilot.fly_plant();
        let d = &nodes.drone;
        let link = AutopilotLink::new(
            &AutopilotLinkConfig::default(),
            &d.odometry,
            &d.airframe,
            true,
            None,
            nodes.bridge.drone_id,
            1,
        );
        Linked {
            link,
            autopilot,
            decoder: Decoder::default(),
            sequence: 0,
            down: Wire::default(),
            up: Wire::default(),
            wire_s,
            now_s: 0.0,
            since_s: None,
        }
    }
    fn send(&mut self, out: &AutopilotOut) {
        for message in &out.messages {
            self.sequence = self.sequence.wrapping_add(1);
            let bytes = encode(out.from, self.sequence, message).expect("a message of ours");
            self.down.send(self.now_s + self.wire_s, bytes);
        }
    }
}

impl FirmwareLink for Linked {
    fn motors(&mut self, truth: &PlantState) -> Option<[f64; 4]> {
        self.now_s = truth.at.secs();
        let a = &mut self.autopilot;
        a.feels(
            truth.position,
            truth.velocity,
            truth.attitude,
            truth.rates,
            truth.specific_force,
        );
        // A person holds it where it is, and gives it away.
        a.manual_hold_position.get_or_insert(truth.position);
        let since_s = *self.since_s.get_or_insert(self.now_s);
        if self.now_s > since_s + 2.0 && a.chosen == FakeAutopilot::manual_mode(a.firmware) {
            // PX4 refuses until an offer has lasted: a person tries again.
            let _refused = a.choose(FakeAutopilot::offboard_mode(a.firmware));
        }
        // It was switched on long ago.
        let said = a.step(self.now_s + 1000.0, &self.down.arrived(self.now_s));
        for bytes in said {
            self.up.send(self.now_s + self.wire_s, bytes);
        }
        a.armed.then(|| a.motors())
    }
    fn receive(&mut self, now: Time<DroneClock>) -> FirmwareOutputs {
        for bytes in self.up.arrived(self.now_s) {
            self.decoder.push(&bytes);
        }
        let mut input = AutopilotIn::default();
        while let Some(frame) = self.decoder.next_frame() {
            input.received.push(frame);
        }
        let out = self.link.step(now, &input);
        self.send(&out);
        FirmwareOutputs {
            odometry: out.odometry.last().copied(),
            state: out.state,
        }
    }
    fn send(&mut self, now: Time<DroneClock>, outputs: &NodeOutputs) {
        let input = AutopilotIn {
            received: Vec::new(),
            set_point: outputs.set_point,
            mission: outputs.mission,
            forecast: outputs.forecast,
        };
        let out = self.link.step(now, &input);
        self.send(&out);
    }
}

fn fly(firmware: modes::Firmware, wire_s: f64, seed: u64) -> Outcome {
    let mut scenario = Scenario {
        sea: "moderate".parse::<SeaConfig>().unwrap(),
        ..Scenario::default()
    };
    // Long enough to find the autopilot and to be given the drone.
    scenario.start.hover_s = 8.0;
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, seed).unwrap();
    world.attach_firmware(Box::new(Linked::new(firmware, wire_s, &nodes)));
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    land(world, &scenario, &nodes, seed, "moderate", watch, &mut NoTap).outcome
}

/// Lands at Moderate on six seeds: all, nothing unsafe, within 0.15 m each.
fn lands(firmware: modes::Firmware, wire_s: f64) {
    for seed in 300..306 {
        let o = fly(firmware, wire_s, seed);
        let what = format!("{} over {wire_s} s: {o:?}", firmware.name());
        assert!(o.success && o.unsafe_contacts == 0, "{what}");
        assert!(o.position_error_m.is_some_and(|e| e < 0.15), "{what}");
    }
}

#[test]
fn drone_lands_over_px4_mavlink_at_moderate_with_5_to_40_ms_on_the_wire() {
    for wire_s in [0.005, 0.02, 0.04] {
        lands(modes::Firmware::Px4, wire_s);
    }
}

#[test]
fn drone_lands_over_arducopter_mavlink_at_moderate_with_5_to_40_ms_on_the_wire() {
    for wire_s in [0.005, 0.02, 0.04] {
        lands(modes::Firmware::ArduCopter, wire_s);
    }
}

/// The report behind the two tests above: `MAVLINK_TRIALS=100 cargo test --release --test mavlink -- --nocapture`.
#[test]
fn report() {
    let Some(trials) = std::env::var("MAVLINK_TRIALS")
        .ok()
        .and_then(|n| n.parse::<u64>().ok())
    else {
        return;
    };
    let seed0 = std::env::var("MAVLINK_SEED0")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(300);
    println!("autopilot    wire    landed  unsafe  water  error, m  max  time, s");
    for firmware in [modes::Firmware::Px4, modes::Firmware::ArduCopter] {
        for wire_s in [0.0, 0.005, 0.01, 0.02, 0.04, 0.06, 0.08] {
            let all: Vec<Outcome> = (seed0..seed0 + trials)
                .map(|s| fly(firmware, wire_s, s))
                .collect();
            for (o, seed) in all.iter().zip(seed0..).filter(|(o, _)| !o.success) {
                println!("seed {seed}: {o:?}");
            }
            let down: Vec<f64> = all.iter().filter_map(|o| o.position_error_m).collect();
            let times: Vec<f64> = all.iter().filter_map(|o| o.landing_time_s).collect();
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
            println!(
                "{:12} {:3.0} ms {:4}/{trials} {:6} {:6} {:9.3} {:6.3} {:6.1}",
                firmware.name(),
                1e3 * wire_s,
                all.iter().filter(|o| o.success).count(),
                all.iter().map(|o| o.unsafe_contacts).sum::<u32>(),
                all.iter().map(|o| o.water_contacts).sum::<u32>(),
                mean(&down),
                down.iter().copied().fold(0.0, f64::max),
                mean(&times),
            );
        }
    }
}

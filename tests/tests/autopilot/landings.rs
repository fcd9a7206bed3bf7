//! Whole landings over MAVLink in lock-step: the drone's nodes, the link's node, its bytes on a wire that takes
//! its time, and an autopilot at protocol level whose rotor outputs fly the simulated drone.

use std::cell::Cell;
use std::rc::Rc;

use alight_shared::time::{DroneClock, Time};
use alight_sim::autopilots::fake::FakeAutopilot;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::trial::{Event, Watch, land};
use alight_sim::harness::world::{FirmwareLink, FirmwareOutputs, NodeOutputs, World};
use alight_sim::physics::drone::PlantState;
use alight_sim::physics::sea::SeaConfig;
use alight_uav::autopilot::config::AutopilotLinkConfig;
use alight_uav::autopilot::message::CommandResult;
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotOut};

use crate::wired::Wired;

/// What a test does to the link and the autopilot.
#[derive(Default)]
pub struct Faults {
    /// The link's process is dead; alive again it is a new one.
    pub dead: Cell<bool>,
    /// Its cable is out.
    pub cut: Cell<bool>,
    /// The autopilot denies every command.
    pub denies: Cell<bool>,
}

/// Both ends of the wire in the simulated world.
pub struct Linked {
    wired: Wired,
    now_s: f64,
    since_s: Option<f64>,
    pub faults: Rc<Faults>,
    died: bool,
    /// For so long its failsafe is the firmware's default, s.
    pub failsafe_after_s: f64,
}

impl Linked {
    pub fn new(firmware: Firmware, wire_s: f64, nodes: &NodeConfigs) -> Linked {
        let mut autopilot = FakeAutopilot::new(firmware, 0.0);
        autopilot.fly_plant();
        let (d, id) = (nodes.drone.clone(), nodes.bridge.drone_id);
        let config = AutopilotLinkConfig::default();
        let link = move |boot| AutopilotLink::new(&config, &d.odometry, &d.airframe, true, None, id, boot);
        Linked {
            wired: Wired::new(link, autopilot, wire_s),
            now_s: 0.0,
            since_s: None,
            faults: Rc::default(),
            died: false,
            failsafe_after_s: 0.0,
        }
    }
    fn step_link(&mut self, now: Time<DroneClock>, input: &AutopilotIn) -> AutopilotOut {
        if self.faults.dead.get() {
            self.died = true;
            return AutopilotOut::default();
        }
        if core::mem::take(&mut self.died) {
            self.wired.restart_link();
        }
        self.wired.step_link(self.now_s, now, input)
    }
}

impl FirmwareLink for Linked {
    fn motors(&mut self, truth: &PlantState) -> Option<[f64; 4]> {
        self.now_s = truth.at.secs();
        let a = &mut self.wired.autopilot;
        a.set_motion(
            truth.position,
            truth.velocity,
            truth.attitude,
            truth.rates,
            truth.specific_force,
        );
        // A person holds it where it is, and hands it over.
        a.manual_hold_position.get_or_insert(truth.position);
        let since_s = *self.since_s.get_or_insert(self.now_s);
        if self.now_s > since_s + 2.0 && a.chosen == FakeAutopilot::manual_mode(a.firmware) {
            // PX4 refuses until set-points were streamed long enough: a person tries again.
            let _refused = a.choose(FakeAutopilot::offboard_mode(a.firmware));
        }
        if a.firmware == Firmware::Px4 {
            let is_set = self.now_s - since_s >= self.failsafe_after_s;
            let timeout_s = if is_set { 0.5 } else { 1.0 };
            a.parameters.insert("COM_OF_LOSS_T", timeout_s);
        }
        a.answer = self.faults.denies.get().then_some(CommandResult::Denied);
        self.wired.cut = self.faults.cut.get();
        // It was switched on long ago.
        self.wired.step_autopilot(self.now_s, 1000.0);
        let a = &self.wired.autopilot;
        a.armed.then(|| a.motors())
    }
    fn receive(&mut self, now: Time<DroneClock>) -> FirmwareOutputs {
        let input = self.wired.received(self.now_s);
        let out = self.step_link(now, &input);
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
            checkpoint: None,
        };
        self.step_link(now, &input);
    }
}

fn fly(firmware: Firmware, wire_s: f64, seed: u64) -> Outcome {
    let mut scenario = Scenario {
        sea: "moderate".parse::<SeaConfig>().unwrap(),
        ..Scenario::default()
    };
    // Long enough to find the autopilot and to be given the drone.
    scenario.start.hover_s = 8.0;
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, seed).unwrap();
    world.attach_firmware(0, Box::new(Linked::new(firmware, wire_s, &nodes)));
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    land(world, &scenario, &nodes, seed, "moderate", watch, &mut NoTap).outcome
}

/// Lands at Moderate on six seeds: all, nothing unsafe, within 0.15 m each.
fn lands(firmware: Firmware, wire_s: f64) {
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
        lands(Firmware::Px4, wire_s);
    }
}

#[test]
fn drone_lands_over_arducopter_mavlink_at_moderate_with_5_to_40_ms_on_the_wire() {
    for wire_s in [0.005, 0.02, 0.04] {
        lands(Firmware::ArduCopter, wire_s);
    }
}

#[test]
fn mission_begins_no_landing_before_the_autopilots_failsafe_is_set() {
    // The landing is commanded after 8 s, and a person sets the parameter 10 s later.
    let (commanded_s, set_s) = (8.0, 18.0);
    let mut scenario = Scenario::default();
    scenario.start.hover_s = commanded_s;
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, 300).unwrap();
    let mut linked = Linked::new(Firmware::Px4, 0.005, &nodes);
    linked.failsafe_after_s = set_s;
    world.attach_firmware(0, Box::new(linked));
    let mut began_s = None;
    let watch = Watch {
        on_event: &mut |Event::Phase { t_s, .. }| {
            began_s.get_or_insert(*t_s);
        },
        trace_step_s: None,
    };
    let o = land(world, &scenario, &nodes, 300, "default", watch, &mut NoTap).outcome;
    let waited = set_s - commanded_s;
    assert!(
        began_s.is_some_and(|t| (waited..waited + 2.5).contains(&t)),
        "{began_s:?}"
    );
    assert!(o.success, "{o:?}");
}

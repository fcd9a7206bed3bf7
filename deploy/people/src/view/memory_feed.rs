//! Messages of the processes of a drone's computer, read from their shared memory without waiting.

use alight_bridge::{BridgeIn, BridgeOut};
use alight_computer::record::observer::{NodeStep, StepObserver};
use alight_shared::bus::readers;
use alight_shared::msg::{
    AutopilotState, Command, ComputerReport, DeckForecast, DeckGrant, DroneState, LinkState, MissionState,
    Plan, RangeSample, SetPoint, TagPose, UvdarFix, VesselEstimate, WaveModel,
};
use alight_shared::process::ProcessState;
use alight_shared::time::{DroneClock, Time, TrueTime};
use alight_transport::clock::steady_ns;
use alight_transport::memory::Memory;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::pilot::{PilotIn, PilotOut};
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};

use crate::view::watcher::Watcher;

readers! {
    /// Reader of all messages that a viewer shows.
    pub struct MemoryFeed {
        computer: ComputerReport,
        processes: ProcessState,
        estimate: VesselEstimate<DroneClock>,
        wave: WaveModel<DroneClock>,
        deck: DeckGrant<DroneClock>,
        link: LinkState,
        tags: TagPose,
        uvdar: UvdarFix,
        ranges: RangeSample,
        drone: DroneState,
        forecast: DeckForecast,
        commands: Command,
        autopilot: AutopilotState,
        mission: MissionState,
        plan: Plan,
        set_point: SetPoint,
    }
}

impl MemoryFeed<Memory> {
    /// Passes new messages to `watcher`. Returns the mission's state if it is new.
    pub fn poll(
        &mut self,
        t: Time<TrueTime>,
        now: Time<DroneClock>,
        watcher: &mut Watcher,
    ) -> Option<MissionState> {
        let ns = now.nanos();
        let bridge = BridgeOut {
            estimate: self.estimate.newest(ns),
            wave: self.wave.newest(ns),
            deck: self.deck.newest(ns),
            link: self.link.newest(ns),
            ..BridgeOut::default()
        };
        watcher.step(t, NodeStep::Bridge(now, &BridgeIn::default(), &bridge));
        watcher.received(t, &bridge);
        let input = PredictorIn {
            tags: self.tags.all(ns),
            uvdar: self.uvdar.all(ns),
            ranges: self.ranges.all(ns),
            drone: self.drone.newest(ns),
            ..PredictorIn::default()
        };
        let predicted = PredictorOut {
            forecast: self.forecast.newest(ns),
            ..PredictorOut::default()
        };
        watcher.step(t, NodeStep::Predictor(now, &input, &predicted));
        let plan = self.plan.newest(ns);
        let planned = PlannerOut { plan };
        watcher.step(t, NodeStep::Planner(now, &PlannerIn::default(), &planned));
        let piloted = PilotOut {
            set_point: self.set_point.newest(ns),
            ..PilotOut::default()
        };
        let flown = PilotIn {
            plan,
            ..PilotIn::default()
        };
        watcher.step(t, NodeStep::Pilot(now, &flown, &piloted));
        let asked = MissionIn {
            autopilot: self.autopilot.newest(ns),
            commands: self.commands.all(ns),
            ..MissionIn::default()
        };
        let decided = MissionOut {
            state: self.mission.newest(ns),
            ..MissionOut::default()
        };
        watcher.board.reported(self.computer.newest(steady_ns()));
        watcher.board.processes(self.processes.all(steady_ns()));
        watcher.step(t, NodeStep::Mission(now, &asked, &decided));
        decided.state
    }
}

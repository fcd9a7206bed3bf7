use alight_computer::record::messages::Message;
use alight_shared::{
    bus::readers,
    msg::{
        AutopilotState, Command, ComputerReport, DeckForecast, DeckGrant, DroneState, LinkState,
        MissionState, Plan, RangeSample, SetPoint, TagPose, UvdarFix, VesselEstimate, WaveModel,
    },
    process::ProcessState,
    time::{DroneClock, Time, TrueTime},
};
use alight_transport::{clock::steady_ns, memory::Memory};

use crate::view::view_observer::ViewObserver;

readers! {
    pub struct MemoryObserver {
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

impl MemoryObserver<Memory> {
    /// Passes new messages to `observer`. Returns the mission's state if it is new.
    pub fn poll(
        &mut self,
        t: Time<TrueTime>,
        now: Time<DroneClock>,
        observer: &mut ViewObserver,
    ) -> Option<MissionState> {
        let ns = now.nanos();
        let (plan, state) = (self.plan.newest(ns), self.mission.newest(ns));
        observer.board.reported(self.computer.newest(steady_ns()));
        observer.board.processes(self.processes.all(steady_ns()));
        let mut show = |message: Message<'_>| observer.message(t, &message);
        self.estimate
            .newest(ns)
            .iter()
            .for_each(|m| show(Message::Estimate(m)));
        self.wave.newest(ns).iter().for_each(|m| show(Message::Wave(m)));
        self.deck.newest(ns).iter().for_each(|m| show(Message::Deck(m)));
        self.link.newest(ns).iter().for_each(|m| show(Message::Link(m)));
        self.tags.all(ns).iter().for_each(|m| show(Message::Tag(m)));
        self.uvdar.all(ns).iter().for_each(|m| show(Message::Uvdar(m)));
        self.ranges.all(ns).iter().for_each(|m| show(Message::Range(m)));
        self.forecast
            .newest(ns)
            .iter()
            .for_each(|m| show(Message::Forecast(m)));
        self.drone.newest(ns).iter().for_each(|m| show(Message::Drone(m)));
        self.commands
            .all(ns)
            .iter()
            .for_each(|m| show(Message::Command(m)));
        self.autopilot
            .newest(ns)
            .iter()
            .for_each(|m| show(Message::Autopilot(m)));
        state.iter().for_each(|m| show(Message::Mission(m)));
        plan.iter().for_each(|m| show(Message::Plan(now, m)));
        plan.iter().for_each(|m| show(Message::FlownPlan(m)));
        self.set_point
            .newest(ns)
            .iter()
            .for_each(|m| show(Message::SetPoint(now, m)));
        observer.show(t);
        state
    }
}

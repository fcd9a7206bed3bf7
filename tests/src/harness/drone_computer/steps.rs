//! Steps of a drone computer's rows, and the far ends of their edges.

use core::mem::swap;

use super::{MAX_WAITING, Moment, SimulatedDroneComputer, due};
use crate::{
    autopilots::simulated::mode_number,
    baselines::own::OwnReport,
    harness::{
        bus::LockStep,
        edge::edge,
        foresight::{Foresight, OdometryError},
        observer::WorldObserver,
        physics::Physics,
    },
    sensors::{beacon::BEACON, delay::DelayLine},
};
use alight_bridge::{Bridge, BridgeIn, BridgeOut, Packet};
use alight_shared::{
    admission::Sender,
    bus::{Bus, Edge, Row, Writer as _},
    msg::{AutopilotMode, Plan},
    node::Node,
    process::ProcessKind,
    radio::RadioTopic,
    time::{DroneClock, Span, Stamped, WorldTime},
};
use alight_uav::{
    autopilot::{
        AutopilotIn, AutopilotLink, AutopilotOut,
        message::{Address, MavlinkFrame, MavlinkMessage},
    },
    camera::{CameraNode, uvdar::UvdarNode},
    computer::Installed,
    planner::{Planner, PlannerIn, PlannerOut, PlannerPorts},
    predictor::{Predictor, PredictorIn, PredictorOut},
};

struct SolveTime<'a> {
    now: WorldTime,
    /// Solve time unless the law reports another; `slower` is the addition by a fault.
    delay: Span,
    slower: Span,
    law: &'a OwnReport,
    plans: &'a mut DelayLine<Plan>,
}

impl Edge<Planner> for SolveTime<'_> {
    fn write<B: Bus>(
        &mut self,
        _input: &PlannerIn,
        out: &mut PlannerOut,
        _ports: &mut PlannerPorts<B>,
    ) -> bool {
        if let Some(plan) = out.plan {
            let delay = self.law.get().solve.unwrap_or(self.delay);
            // A full delay line drops the plan; it fills only while plans are not read.
            let _full = self.plans.push(self.now + delay + self.slower, plan);
        }
        true
    }
}

impl SimulatedDroneComputer {
    pub(super) fn step_bridge(
        &mut self,
        (t, now): Moment,
        packets: Vec<Stamped<DroneClock, Packet>>,
        reports_status: bool,
        observer: &mut dyn WorldObserver,
    ) {
        let (runs, boot) = self.process(ProcessKind::Bridge);
        let Some(bridge) = &mut self.rows.bridge else {
            return;
        };
        if !runs {
            let room = MAX_WAITING.saturating_sub(self.waiting.len());
            let waiting = packets.into_iter().take(room).map(|p| p.value);
            self.waiting.extend(waiting);
            return;
        }
        // The bridge stamps waiting packets when it reads them.
        let waited = self.waiting.drain(..).map(|p| Stamped::new(now, p));
        let mut packets: Vec<_> = waited.chain(packets).collect();
        let sender = Sender::Drone(self.nodes.bridge.drone_id);
        let radio = &mut self.radio;
        let send = |_: &BridgeIn, out: &mut BridgeOut| {
            out.broadcast(|kind, bytes| {
                if reports_status || kind != RadioTopic::Status {
                    radio.send_to_vessel(t, bytes.len(), Packet { kind, sender, bytes });
                }
            });
        };
        let receive = |input: &mut BridgeIn| swap(&mut input.packets, &mut packets);
        let step = bridge.step(|| now, &mut edge::<Bridge>(receive, send));
        observer.step(t, &step.of(ProcessKind::Bridge, boot));
    }
    pub(super) fn receive_from_autopilot(
        &mut self,
        (t, now): Moment,
        physics: &Physics,
        observer: &mut dyn WorldObserver,
    ) {
        let runs = self.runs(ProcessKind::Autopilot);
        let Some(linked) = &mut self.linked else { return };
        if !self.handed_over {
            // PX4 rejects OFFBOARD without a sustained stream of set-points, so the pilot tries again.
            let autopilot = &mut linked.autopilot;
            let offboard = mode_number(autopilot.firmware(), AutopilotMode::Offboard);
            self.handed_over = autopilot.choose(offboard);
        }
        linked.autopilot.steel_m = physics.deck_distance_m(self.k);
        // A frozen process leaves bytes on the wire.
        let frames = if runs { linked.received(t) } else { Vec::new() };
        self.step_link((t, now), frames, observer);
    }
    pub(super) fn step_link(
        &mut self,
        (t, now): Moment,
        mut frames: Vec<MavlinkFrame>,
        observer: &mut dyn WorldObserver,
    ) {
        let (runs, boot) = self.process(ProcessKind::Autopilot);
        let (Some(link), Some(linked)) = (self.rows.autopilot.as_mut().filter(|_| runs), &mut self.linked)
        else {
            return;
        };
        let receiver = &mut self.receiver;
        let corrections = &mut self.corrections;
        let reports = core::iter::from_fn(|| receiver.next_report());
        frames.extend(reports.map(|report| MavlinkFrame {
            from: Address::new(0, 0),
            message: MavlinkMessage::RelativePlace(report),
        }));
        let send = |_: &AutopilotIn, out: &mut AutopilotOut| {
            linked.send(t, out);
            corrections.extend(out.rtcm.iter().flatten());
        };
        let mut wire = edge::<AutopilotLink>(|input| swap(&mut input.received, &mut frames), send);
        let step = link.step(|| now, &mut wire);
        observer.step(t, &step.of(ProcessKind::Autopilot, boot));
    }
    /// Steps the cameras with images, or with the measurement models' detections. Passes rangefinder, beacon
    /// and receiver data to the link's wires.
    pub(super) fn sense(
        &mut self,
        (t, now): Moment,
        physics: &mut Physics,
        observer: &mut dyn WorldObserver,
    ) {
        physics.receive_rtcm(self.k, &core::mem::take(&mut self.corrections));
        let Some(mut readings) = physics.drone_readings(self.k) else {
            return;
        };
        self.receiver.push(&readings.receiver);
        if let Some(faults) = &self.spoiled {
            let repeated_m = &mut self.repeated_range_m;
            faults.borrow().spoil_ranges(&mut readings.ranges, repeated_m);
        }
        if let Some(linked) = &mut self.linked {
            let clock = physics.drone_clock(self.k);
            for sample in readings.ranges.drain(..) {
                linked
                    .autopilot
                    .take_range(clock.true_time(sample.header.at), sample);
            }
            for report in readings.beacons.drain(..) {
                linked.up.send(t, BEACON, &report.follow_target().into());
            }
        }
        readings.shift(self.ahead);
        let [belly, ultraviolet] = [ProcessKind::Camera, ProcessKind::Uvdar].map(|p| self.process(p).1);
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.camera) {
            let mut images = cameras.belly(t, &readings.shots);
            let mut edge = edge::<CameraNode>(|i| swap(i, &mut images), |_, _| {});
            let step = row.step(|| now, &mut edge);
            observer.step(t, &step.of(ProcessKind::Camera, belly));
            cameras.metered(step.input.frames.len(), &row.node.light());
        }
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.uvdar) {
            let mut images = cameras.ultraviolet(t, &readings.uv_shots);
            let step = row.step(
                || now,
                &mut edge::<UvdarNode>(|i| swap(i, &mut images), |_, _| {}),
            );
            observer.step(t, &step.of(ProcessKind::Uvdar, ultraviolet));
        }
        self.outside.tags.send_each(&readings.tags);
        self.outside.uvdar.send_each(&readings.uvdar);
        self.outside.light.send_each(&readings.light);
    }
    pub(super) fn step_predictor(
        &mut self,
        (t, now): Moment,
        physics: &Physics,
        foresight: Option<&Foresight>,
        observer: &mut dyn WorldObserver,
    ) {
        let clock = physics.drone_clock(self.k).ahead(self.ahead);
        let truth = physics.drone(self.k);
        let process = self.process(ProcessKind::Predictor);
        let own = &mut self.own_predictor;
        let correct = |input: &PredictorIn, out: &mut PredictorOut| {
            if let Some(own) = own {
                own(input, &mut out.forecast);
            }
            let of = |(d, truth)| OdometryError::of(&d, now, &truth);
            let believed = input.drone.zip(truth).map(of).unwrap_or_default();
            if let (Some(foresight), Some(forecast)) = (foresight, &mut out.forecast) {
                foresight.correct(forecast, &clock, &believed);
            }
        };
        let mut edge = edge::<Predictor>(|_| {}, correct);
        step(&mut self.rows.predictor, process, (t, now), &mut edge, observer);
    }
    pub(super) fn step_mission(&mut self, at: Moment, observer: &mut dyn WorldObserver) {
        let process = self.process(ProcessKind::Mission);
        step(&mut self.rows.mission, process, at, &mut (), observer);
    }
    pub(super) fn step_planner(&mut self, (t, now): Moment, observer: &mut dyn WorldObserver) {
        let process = self.process(ProcessKind::Planner);
        let mut edge = SolveTime {
            now: t,
            delay: self.solve_delay,
            slower: self.slower,
            law: &self.law,
            plans: &mut self.plans,
        };
        step(&mut self.rows.planner, process, (t, now), &mut edge, observer);
    }
    pub(super) fn step_pilot(&mut self, at: Moment, observer: &mut dyn WorldObserver) {
        let process = self.process(ProcessKind::Pilot);
        step(&mut self.rows.pilot, process, at, &mut (), observer);
    }
}

/// Steps a row if its process is alive, in `runs`, and due for a step; shows the step to an observer.
fn step<N: Installed + Node<Clock = DroneClock>>(
    row: &mut Option<Box<Row<N, LockStep>>>,
    (runs, boot): (bool, u32),
    (t, now): Moment,
    edge: &mut impl Edge<N>,
    observer: &mut dyn WorldObserver,
) {
    if let Some(row) = due(row, runs, now) {
        observer.step(t, &row.step(|| now, edge).of(N::KIND, boot));
    }
}

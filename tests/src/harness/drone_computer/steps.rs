//! Steps of a drone computer's rows, each with the other ends of its edges.

use super::{MAX_WAITING, Moment, SimulatedDroneComputer, Uplink, due};
use crate::autopilots::simulated::mode_number;
use crate::harness::foresight::{Foresight, OdometryError};
use crate::harness::physics::Physics;
use crate::harness::tap::Tap;
use alight_bridge::{BridgeIn, Packet};
use alight_shared::bus::{Reader as _, Writer as _};
use alight_shared::msg::AutopilotMode;
use alight_shared::process::ProcessKind;
use alight_shared::time::{DroneClock, Stamped};
use alight_shared::topics::TIME_REQUEST;
use alight_shared::wire;
use alight_uav::autopilot::message::MavlinkFrame;
use alight_uav::planner::{PlannerIn, PlannerOut};
use alight_uav::predictor::{PredictorIn, PredictorOut};

impl SimulatedDroneComputer {
    pub(super) fn step_bridge(
        &mut self,
        (t, now): Moment,
        packets: Vec<Stamped<DroneClock, Packet>>,
        reports_status: bool,
        tap: &mut impl Tap,
    ) {
        let runs = self.runs(ProcessKind::Bridge);
        let mut shown = self.shown(ProcessKind::Bridge, (t, now), tap);
        let Some(bridge) = &mut self.rows.bridge else {
            return;
        };
        if !runs {
            let room = MAX_WAITING.saturating_sub(self.waiting.len());
            let waiting = packets.into_iter().take(room).map(|p| p.value);
            self.waiting.extend(waiting);
            return;
        }
        // What has waited bears the time of its reading.
        let waited = self.waiting.drain(..).map(|p| Stamped::new(now, p));
        let packets = waited.chain(packets).collect();
        let edge = |input: &mut BridgeIn| input.packets = packets;
        let out = bridge.step(now, edge, |input, out| shown(input, out));
        if let Some(request) = out.time_request {
            let request = Uplink::TimeRequest(request);
            self.radio.send_to_vessel(t, TIME_REQUEST.bytes, request);
        }
        if let Some(status) = out.status.filter(|_| reports_status)
            && let Ok(bytes) = wire::encode(&status)
        {
            self.radio.send_to_vessel(t, bytes.len(), Uplink::Status(status));
        }
    }
    /// The link with what the autopilot has sent.
    pub(super) fn receive_from_autopilot(&mut self, (t, now): Moment, physics: &Physics, tap: &mut impl Tap) {
        let runs = self.runs(ProcessKind::Autopilot);
        let Some(linked) = &mut self.linked else { return };
        if !self.handed_over {
            // PX4 denies until set-points were streamed for long enough: the person tries again.
            let autopilot = &mut linked.autopilot;
            let offboard = mode_number(autopilot.firmware(), AutopilotMode::Offboard);
            self.handed_over = autopilot.choose(offboard);
        }
        linked.autopilot.steel_m = physics.deck_distance_m(self.k);
        // What a process that stands still does not read waits on the wire.
        let frames = if runs { linked.received(t) } else { Vec::new() };
        self.step_link((t, now), frames, tap);
    }
    pub(super) fn step_link(&mut self, (t, now): Moment, frames: Vec<MavlinkFrame>, tap: &mut impl Tap) {
        let runs = self.runs(ProcessKind::Autopilot);
        let mut shown = self.shown(ProcessKind::Autopilot, (t, now), tap);
        let (Some(link), Some(linked)) = (self.rows.autopilot.as_mut().filter(|_| runs), &mut self.linked)
        else {
            return;
        };
        let out = link.step(
            now,
            |input| input.received = frames,
            |input, out| shown(input, out),
        );
        linked.send(t, &out);
    }
    /// The cameras with what they have exposed, or what models measure in their place.
    pub(super) fn sense(&mut self, (t, now): Moment, physics: &mut Physics) {
        // The link to the autopilot passes frames on, and what its receiver makes of them.
        let frames = self.observer.rtcm.all(now.nanos());
        let runs = self.rows.autopilot.is_some() && self.runs(ProcessKind::Autopilot);
        let passes = runs && self.linked.as_ref().is_some_and(|l| !l.cut);
        if passes {
            physics.receive_rtcm(self.k, &frames);
        }
        let Some(mut readings) = physics.drone_readings(self.k) else {
            return;
        };
        readings.relative.retain(|_| passes);
        readings.shift(self.ahead);
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.camera) {
            let input = cameras.belly(t, &readings.shots);
            let images = input.frames.len();
            row.step(now, |i| *i = input, |_, _| {});
            cameras.metered(images, &row.node.light());
        }
        if let (Some(cameras), Some(row)) = (&mut self.cameras, &mut self.rows.uvdar) {
            let input = cameras.ultraviolet(t, &readings.uv_shots);
            row.step(now, |i| *i = input, |_, _| {});
        }
        self.outside.tags.send_each(&readings.tags);
        self.outside.uvdar.send_each(&readings.uvdar);
        self.outside.ranges.send_each(&readings.ranges);
        self.outside.beacons.send_each(&readings.beacons);
        self.outside.relative.send_each(&readings.relative);
        self.outside.light.send_each(&readings.light);
    }
    pub(super) fn step_predictor(
        &mut self,
        (t, now): Moment,
        physics: &Physics,
        foresight: Option<&Foresight>,
        tap: &mut impl Tap,
    ) {
        let clock = physics.drone_clock(self.k).ahead(self.ahead);
        let (truth, runs) = (physics.drone(self.k), self.runs(ProcessKind::Predictor));
        let mut shown = self.shown(ProcessKind::Predictor, (t, now), tap);
        if let Some(predictor) = due(&mut self.rows.predictor, runs, now) {
            let look = |input: &PredictorIn, out: &mut PredictorOut| {
                let of = |(d, truth)| OdometryError::of(&d, now, &truth);
                let believed = input.drone.zip(truth).map(of).unwrap_or_default();
                if let (Some(foresight), Some(forecast)) = (foresight, &mut out.forecast) {
                    foresight.correct(forecast, &clock, &believed);
                }
                shown(input, out);
            };
            predictor.step(now, |_| {}, look);
        }
    }
    pub(super) fn step_mission(&mut self, (t, now): Moment, tap: &mut impl Tap) {
        let runs = self.runs(ProcessKind::Mission);
        let mut shown = self.shown(ProcessKind::Mission, (t, now), tap);
        if let Some(mission) = due(&mut self.rows.mission, runs, now) {
            mission.step(now, |_| {}, |input, out| shown(input, out));
        }
    }
    pub(super) fn step_planner(&mut self, (t, now): Moment, tap: &mut impl Tap) {
        let (runs, arrives) = (
            self.runs(ProcessKind::Planner),
            t + self.solve_delay + self.slower,
        );
        let mut shown = self.shown(ProcessKind::Planner, (t, now), tap);
        let plans = &mut self.plans;
        if let Some(planner) = due(&mut self.rows.planner, runs, now) {
            let look = |input: &PlannerIn, out: &mut PlannerOut| {
                shown(input, out);
                if let Some(plan) = out.plan.take() {
                    // A full line means plans that are not fetched: the oldest state is lost, no more.
                    let _full = plans.push(arrives, plan);
                }
            };
            planner.step(now, |_| {}, look);
        }
    }
    pub(super) fn step_pilot(&mut self, (t, now): Moment, tap: &mut impl Tap) {
        let runs = self.runs(ProcessKind::Pilot);
        let mut shown = self.shown(ProcessKind::Pilot, (t, now), tap);
        if let Some(pilot) = due(&mut self.rows.pilot, runs, now) {
            pilot.step(now, |_| {}, |input, out| shown(input, out));
        }
    }
}

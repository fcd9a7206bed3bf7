use std::collections::VecDeque;

use alight_shared::{
    msg::{
        CourseAdvice, DeckMotion, DeckStatus, DroneContact, EstimatorStatus, Header, Line, MAX_DEVICES,
        MAX_ORDERS, Seq, SourceUse, VesselStatus,
    },
    time::{VesselClock, VesselTime},
};
use alight_usv::{ComputerIn, ComputerOut, KINDS, VesselNode};

const MOTION_PERIOD_NS: i64 = 90_000_000;
/// Number of recent statuses over which the use of sources is counted: 10 s.
const LATELY: usize = 20;

/// Half the time over which the greatest motion is stated, ns (10 min).
const MOTION_SPAN_NS: i64 = 600_000_000_000;

pub struct CrewDeviceErrors {
    /// Reason why the deck's state would be lost with the process.
    pub file: Option<String>,
    pub inputs: Vec<String>,
    pub lamp: Option<String>,
}

#[derive(Default)]
pub struct VesselStatusReport {
    sensors_ns: [Option<i64>; 3],
    estimated_ns: Option<i64>,
    estimator: EstimatorStatus,
    motion_ns: i64,
    /// Number of the present span, and the motion in the previous and in this span.
    span: i64,
    spans: [DeckMotion; 2],
    occupied: bool,
    sequence: u32,
    /// Numbers of used and rejected measurements of each source at the previous statuses, oldest first.
    counts: VecDeque<[[u64; 2]; MAX_DEVICES]>,
}

impl VesselStatusReport {
    pub fn observe(&mut self, now_ns: i64, input: &ComputerIn, out: &ComputerOut) {
        self.occupied = out.grant.map_or(self.occupied, |g| g.occupied);
        let input = input.vessel().readings;
        let out = &out.vessel;
        let arrived = [
            // An attitude sensor replaces a missing inertial sensor.
            !(input.imu.is_empty() && input.attitude.is_empty()),
            !input.gnss.is_empty(),
            !input.heading.is_empty(),
        ];
        for (slot, arrived) in self.sensors_ns.iter_mut().zip(arrived) {
            *slot = if arrived { Some(now_ns) } else { *slot };
        }
        let estimator = &mut self.estimator;
        if let Some(e) = &out.estimate {
            self.estimated_ns = Some(now_ns);
            if now_ns.saturating_sub(self.motion_ns) >= MOTION_PERIOD_NS {
                self.motion_ns = now_ns;
                // Samples that do not fit would be too late for the page's picture of the motion.
                let _full = estimator.motion.push([e.eta[3], e.eta[4], -e.eta[2]]);
            }
            let span = now_ns / MOTION_SPAN_NS;
            if span != self.span {
                self.spans = [self.spans[1], DeckMotion::default()];
                self.span = span;
            }
            self.spans[1] = self.spans[1].and(DeckMotion::of(e));
            estimator.heading = Some(e.mean_heading[0]);
            estimator.mean_velocity = Some(e.mean_velocity.map(f64::from));
            let variance = |i: usize| e.covariance(i)[0];
            estimator.sd = [
                variance(0) + variance(1),
                variance(2),
                variance(3) + variance(4),
                variance(5),
            ]
            .map(f64::sqrt);
        }
        if let Some(w) = &out.wave {
            estimator.waves = Some([w.significant_height_m, w.confidence].map(f64::from));
        }
    }
    /// Status at the time of `header`, which is `now_ns` on the steady clock, after these orders of the crew.
    pub fn message(
        &mut self,
        computer: &alight_usv::VesselComputer,
        (header, now_ns): (Header<VesselClock>, i64),
        orders: Seq<u32, MAX_ORDERS>,
        errors: &CrewDeviceErrors,
    ) -> VesselStatus {
        let now = header.at;
        let node = computer.node();
        let outliers = node.outliers();
        let since = |t: Option<i64>| t.map(|t| (now_ns - t).max(0) as f64 * 1e-9);
        let estimator = EstimatorStatus {
            sensor_age_s: self.sensors_ns.map(since),
            estimate_age_s: since(self.estimated_ns),
            advice: node.advisor().advice().as_ref().map(CourseAdvice::from),
            outliers: [outliers.imu, outliers.gnss, outliers.heading],
            restarts: outliers.restarts,
            rejected: node.rejected().total().into(),
            greatest: self.spans[0].and(self.spans[1]),
            ..self.estimator
        };
        self.estimator.motion = Seq::new();
        self.sequence = self.sequence.wrapping_add(1);
        let contact = |s: &alight_shared::admission::Arrival<VesselClock, _>| DroneContact {
            age_s: (now - s.at).secs().max(0.0),
            status: s.message,
        };
        VesselStatus {
            header: Header {
                sequence: self.sequence,
                ..header
            },
            deck_owner: computer.arbiter().owner(),
            occupied: self.occupied,
            deck: deck(now, computer, errors),
            orders,
            drones: Seq::filled(computer.drones().statuses().map(contact)),
            estimator,
            uses: self.uses(node),
        }
    }
    /// Numbers of each source's used and rejected measurements, in total and over the recent statuses.
    fn uses(&mut self, node: &VesselNode) -> [SourceUse; MAX_DEVICES] {
        let mut uses = core::array::from_fn(|number| source_use(node, number));
        let now = uses.map(|u: SourceUse| [u.used - u.outliers.min(u.used), u.rejected + u.outliers]);
        let before = self.counts.front().copied().unwrap_or(now);
        for ((source, now), before) in uses.iter_mut().zip(now).zip(before) {
            source.lately = [now[0].saturating_sub(before[0]), now[1].saturating_sub(before[1])];
        }
        if self.counts.len() >= LATELY {
            self.counts.pop_front();
        }
        self.counts.push_back(now);
        uses
    }
}

/// A source of bytes counts as two sources of measurements.
fn source_use(node: &VesselNode, number: usize) -> SourceUse {
    let mut all = SourceUse::default();
    for kind in 0..KINDS.len() {
        for source in [2 * number, 2 * number + 1] {
            let c = node.source(kind, source);
            all.out_of_order += c.out_of_order;
            all.used += c.taken;
            all.outliers += c.outliers;
            all.rejected += c.rejected;
            all.stuck += c.stuck;
            all.is_stuck |= c.is_stuck;
        }
    }
    all
}

fn deck(now: VesselTime, node: &alight_usv::VesselComputer, errors: &CrewDeviceErrors) -> DeckStatus {
    let arbiter = node.arbiter();
    let line = |e: &String| Line::from(e.as_str());
    DeckStatus {
        closed: arbiter.closed(now),
        owner_age_s: arbiter.owner_age_s(now),
        doubles: Seq::filled(arbiter.doubles().map(|(id, _)| id)),
        unplaced: Seq::filled(arbiter.unplaced()),
        starved: arbiter.starved(now),
        silent_drones: Seq::filled(arbiter.silent_drones(now)),
        follows_another: node.follows_another(now),
        aborts: Seq::filled(node.relay().unacknowledged()),
        file_error: errors.file.as_ref().map(line),
        input_errors: Seq::filled(errors.inputs.iter().map(line)),
        lamp_error: errors.lamp.as_ref().map(line),
        course: arbiter.course(now),
        wants_steady: arbiter.wants_steady(now),
    }
}

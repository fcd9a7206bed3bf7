//! Mutants: nodes with a defect that a storm must detect. A mutant is a wrapper between a row and the bus in
//! lock-step, and never part of the flight software.

use core::cell::Cell;
use std::rc::Rc;

use alight_shared::{
    bus::Reader as _,
    msg::{
        AutopilotState, Command, CommandKind, DeckForecast, DeckGrant, DroneState, MissionCheckpoint,
        MissionState, Motors, RangeSample, SetPoint, State, VesselEstimate, VesselPrediction,
    },
    plain::Plain,
    process::ProcessKind::{self, Autopilot, Bridge, Mission, Pilot},
    time::{DroneClock, DroneTime, Span, Time},
};
use alight_uav::computer::PROCESSES;
use serde::Serialize;

use super::bus::{BusSide, LockStep};

/// Range at which a mutant stops the motors, m; legs are 0.3 m long.
const STOPS_BELOW_M: f64 = 0.35;

/// Silence of the vessel after which a mutant assumes that the deck is released.
const SILENT: Span = Span::from_millis(1500);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mutant {
    /// The mission ignores aborts during the descent.
    AbortIgnored,
    /// The mission accepts its last order as a new one.
    OrderKept,
    /// A short rangefinder reading alone stops the motors.
    StopsByRange,
    StaleForecast,
    StaleMission,
    FramesIgnored,
    /// An unreported thrust counts as zero.
    ThrustMissing,
    /// An unreported or empty battery counts as full.
    ReserveWaived,
    /// Each drone treats the deck as its own, regardless of the grant.
    TwoOwners,
    /// A silent vessel counts as having released its deck.
    DeckReleased,
    /// The clock offset keeps its first estimate.
    ClockKept,
    /// The mission restarts from the checkpoint of the flight's first boot.
    OldCheckpoint,
}

impl Mutant {
    pub const ALL: [Mutant; 12] = [
        Mutant::AbortIgnored,
        Mutant::OrderKept,
        Mutant::StopsByRange,
        Mutant::StaleForecast,
        Mutant::StaleMission,
        Mutant::FramesIgnored,
        Mutant::ThrustMissing,
        Mutant::ReserveWaived,
        Mutant::TwoOwners,
        Mutant::DeckReleased,
        Mutant::ClockKept,
        Mutant::OldCheckpoint,
    ];
    /// Installs the mutant between a drone computer's rows and their bus. `apart`: change of the vessel's
    /// clock relative to the drone's since the start.
    pub(super) fn stand(self, bus: &LockStep, drone: u32, apart: &Rc<Cell<Span>>) {
        match self {
            Mutant::AbortIgnored => abort_ignored(bus),
            Mutant::OrderKept => order_kept(bus),
            Mutant::StopsByRange => stops_by_range(bus),
            Mutant::StaleForecast => never_old(bus, |f: &mut DeckForecast, now| {
                f.header.at = now;
                f.radio_age_s = 0.0;
                f.vision_age_s = 0.0;
            }),
            Mutant::StaleMission => never_old(bus, |m: &mut MissionState, now| m.header.at = now),
            Mutant::FramesIgnored => each_written(bus, Autopilot, |m: &mut DroneState| {
                m.frames = 0;
                m.heading_jumps = 0.0;
            }),
            Mutant::ThrustMissing => each_written(bus, Autopilot, |m: &mut AutopilotState| {
                m.thrust = m.thrust.or(Some(0.0));
            }),
            Mutant::ReserveWaived => each_written(bus, Autopilot, |m: &mut AutopilotState| {
                m.battery = Some(1.0);
            }),
            Mutant::TwoOwners => bus.wrap(Mission, BusSide::Read, move |now_ns, mut read: Vec<Grant>| {
                for grant in &mut read {
                    *grant = own(grant, drone, now_ns);
                }
                read
            }),
            Mutant::DeckReleased => deck_released(bus, drone),
            Mutant::ClockKept => {
                let by = Rc::clone(apart);
                each_written(bus, Bridge, move |m: &mut VesselEstimate<DroneClock>| {
                    m.header.at += by.get();
                });
                let by = Rc::clone(apart);
                each_written(bus, Bridge, move |m: &mut VesselPrediction<DroneClock>| {
                    m.header.at += by.get();
                });
            }
            Mutant::OldCheckpoint => old_checkpoint(bus),
        }
    }
}

type Grant = DeckGrant<DroneClock>;

/// Grant rewritten as a new grant to this drone.
fn own(grant: &Grant, drone: u32, now_ns: i64) -> Grant {
    let mut own = *grant;
    own.owner = drone;
    own.header.at = Time::from_nanos(now_ns);
    own
}

fn each_written<M: Plain>(bus: &LockStep, row: ProcessKind, change: impl Fn(&mut M) + 'static) {
    bus.wrap(row, BusSide::Written, move |_, mut written: Vec<M>| {
        written.iter_mut().for_each(&change);
        written
    });
}

/// Renews the stamps of messages that a row reads; without a new message the row reads the last one again.
fn never_old<M: Plain>(bus: &LockStep, renew: fn(&mut M, DroneTime)) {
    for row in PROCESSES {
        let mut last = None;
        bus.wrap(*row, BusSide::Read, move |now_ns, read: Vec<M>| {
            last = read.last().copied().or(last);
            if let Some(m) = &mut last {
                renew(m, Time::from_nanos(now_ns));
            }
            last.into_iter().collect()
        });
    }
}

fn by_state<M: Plain>(
    bus: &LockStep,
    (row, way): (ProcessKind, BusSide),
    mut change: impl FnMut(i64, Vec<M>, State) -> Vec<M> + 'static,
) {
    let mut missions = bus.receiver::<MissionState>();
    let mut state = State::default();
    bus.wrap(row, way, move |now_ns, messages| {
        state = missions.newest(now_ns).map_or(state, |m| m.state);
        change(now_ns, messages, state)
    });
}

const fn goes_down(state: State) -> bool {
    matches!(state, State::Descent | State::Flare)
}

fn abort_ignored(bus: &LockStep) {
    by_state(
        bus,
        (Mission, BusSide::Read),
        |_, mut commands: Vec<Command>, state| {
            commands.retain(|c| !(goes_down(state) && c.kind == CommandKind::Abort));
            commands
        },
    );
}

fn order_kept(bus: &LockStep) {
    let mut ordered = None;
    by_state(
        bus,
        (Mission, BusSide::Read),
        move |now_ns, mut commands: Vec<Command>, state| {
            let landing = |c: &Command| c.kind == CommandKind::Land;
            ordered = commands.iter().copied().rfind(landing).or(ordered);
            if let (State::GaveUp, Some(command)) = (state, &mut ordered) {
                command.header.at = Time::from_nanos(now_ns);
                command.header.sequence = command.header.sequence.wrapping_add(1);
                commands.push(*command);
            }
            commands
        },
    );
}

fn stops_by_range(bus: &LockStep) {
    let mut ranges = bus.receiver::<RangeSample>();
    by_state(
        bus,
        (Pilot, BusSide::Written),
        move |now_ns, mut written: Vec<SetPoint>, state| {
            let low = ranges.all(now_ns).iter().any(|r| r.range_m < STOPS_BELOW_M);
            if low && goes_down(state) {
                for s in &mut written {
                    s.motors = Motors::Stop;
                }
            }
            written
        },
    );
}

fn deck_released(bus: &LockStep, drone: u32) {
    let mut last: Option<Grant> = None;
    bus.wrap(Mission, BusSide::Read, move |now_ns, read: Vec<Grant>| {
        last = read.last().copied().or(last);
        let silent = |g: &Grant| Time::from_nanos(now_ns) - g.header.at > SILENT;
        match last.filter(silent) {
            Some(grant) => vec![own(&grant, drone, now_ns)],
            None => read,
        }
    });
}

fn old_checkpoint(bus: &LockStep) {
    let first = Rc::new(Cell::new(None::<MissionCheckpoint>));
    let written = Rc::clone(&first);
    bus.wrap(
        Mission,
        BusSide::Written,
        move |_, new: Vec<MissionCheckpoint>| {
            let landing = new.iter().copied().find(|c| c.landing);
            written.set(written.get().or(landing));
            new
        },
    );
    bus.wrap(
        Mission,
        BusSide::Read,
        move |now_ns, mut read: Vec<MissionCheckpoint>| {
            for answered in read.iter_mut().filter(|c| c.header.boot != 0) {
                if let Some(mut old) = first.get() {
                    old.header.at = Time::from_nanos(now_ns);
                    *answered = old;
                }
            }
            read
        },
    );
}

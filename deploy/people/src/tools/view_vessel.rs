//! `alight view` on the vessel's computer: shows its status, judged as by `alight status`.

use alight_shared::msg::ComputerReport;
use std::collections::{BTreeMap, VecDeque};

use alight_computer::{
    config::VesselComputerConfig,
    exit::CliError,
    process::{facts::Facts, observer::InstanceFollower},
    situation::ObservedSituation,
    vessel::crew::OrderOnItsWay,
};
use alight_shared::{
    msg::{DeckOrder, State},
    process::ProcessKind,
    time::{Time, TrueTime},
};

use crate::{
    status::Status,
    tools::{flights, order::STEADY_S},
    view::{
        motion::MotionHistory,
        picture::{FlightLine, LogLine, OrderView, Picture, ResultView, TrackView},
        server::PageOrder,
    },
};

const LOG_LINES: usize = 12;
const DRONES: usize = 32;
const NOT_TAKEN: &str = "NOT TAKEN";
/// Names of the course orders; the first is valid for [`STEADY_S`].
const COURSE: [&str; 2] = ["steady", "turning"];

fn named(name: &str) -> Option<DeckOrder> {
    let [steady, turning] = COURSE;
    match name {
        "" => Some(DeckOrder::Closed),
        _ if name == steady => Some(DeckOrder::Steady(STEADY_S)),
        _ if name == turning => Some(DeckOrder::Turning),
        _ => None,
    }
}

pub struct VesselObserver<'a> {
    computer: &'a VesselComputerConfig,
    aboard: InstanceFollower,
    configured: ComputerReport,
    motion: MotionHistory,
    /// Time of the newest status on the steady clock, ns.
    ended_ns: i64,
    states: BTreeMap<u32, State>,
    log: VecDeque<(i64, String)>,
    /// Flights that had ended before the view began, from the vessel's process.
    earlier: Vec<FlightLine>,
    result: Option<(i64, &'static str, String)>,
    order: OrderView,
    given: Option<(OrderOnItsWay, PageOrder)>,
}

impl<'a> VesselObserver<'a> {
    /// Observer of this vessel; `may_order` lets the page close the deck.
    pub fn new(computer: &'a VesselComputerConfig, may_order: bool) -> Result<VesselObserver<'a>, CliError> {
        Ok(VesselObserver {
            computer,
            aboard: InstanceFollower::of(&computer.instance, ProcessKind::View.name())?,
            configured: Facts::vessel(computer).report,
            motion: MotionHistory::default(),
            ended_ns: i64::MIN,
            states: BTreeMap::new(),
            log: VecDeque::new(),
            earlier: flights::earlier(&computer.recorder.directory),
            result: None,
            order: OrderView {
                label: may_order.then_some("CLOSE THE DECK"),
                others: if may_order { &COURSE } else { &[] },
                answer: String::new(),
            },
            given: None,
        })
    }
    /// Carries out the crew's order, as `alight order` does. Orders after which rotors may turn are excluded,
    /// because the page has no password.
    pub fn carry_out(&mut self, order: Option<PageOrder>) {
        if let Some(order) = order {
            let memory = self.aboard.poll().map(|(memory, _)| memory);
            let given = match (memory.filter(|_| self.given.is_none()), named(&order.name)) {
                (_, None) => Err(format!("{} is no order of this page", order.name)),
                (Some(m), Some(o)) => OrderOnItsWay::give(m, self.computer, o).map_err(|e| e.to_string()),
                (None, Some(_)) => {
                    Err("the vessel's process does not run, or an order is under way".to_owned())
                }
            };
            match given {
                Ok(given) => self.given = Some((given, order)),
                Err(e) => self.answer(order, Err(format!("{NOT_TAKEN}: {e}"))),
            }
        }
        let Some((given, order)) = &mut self.given else {
            return;
        };
        let is_close = order.name.is_empty();
        let answer = match given.poll() {
            Some(status) if is_close && status.deck.closed.is_some() => Ok("the deck is closed".to_owned()),
            Some(_) if !is_close => Ok(format!("stated: {}", order.name)),
            None if !given.is_over() => return,
            Some(_) | None => Err(format!("{NOT_TAKEN}: the vessel's process does not confirm it")),
        };
        if let Some((_, order)) = self.given.take() {
            self.answer(order, answer);
        }
    }
    fn answer(&mut self, order: PageOrder, answer: Result<String, String>) {
        self.order.answer = answer.clone().unwrap_or_else(|e| e);
        let _gone = order.reply.send(answer);
    }
    pub fn picture(&mut self, now_ns: i64) -> Picture {
        let Some((_, snapshot)) = self.aboard.poll() else {
            return Picture {
                status: Status::absent(&self.configured),
                result: self.result(now_ns),
                ..Picture::default()
            };
        };
        let situation = ObservedSituation::look(snapshot, &self.configured, now_ns);
        self.take(&situation);
        let ago = |(at, text): &(i64, String)| LogLine {
            ago_s: situation.since_s(*at),
            text: text.clone(),
        };
        Picture {
            clock_s: 0.0,
            log: self.log.iter().rev().map(ago).collect(),
            status: Status::of(situation),
            scene: None,
            camera: None,
            motion: self.motion.view(),
            track: TrackView::default(),
            result: self.result(now_ns),
            flights: self.earlier.clone(),
            order: self.order.clone(),
            over: None,
            begins_in_s: None,
        }
    }

    fn result(&self, now_ns: i64) -> Option<ResultView> {
        let (at, outcome, text) = self.result.as_ref()?;
        Some(ResultView {
            ago_s: now_ns.saturating_sub(*at) as f64 * 1e-9,
            outcome,
            text: text.clone(),
        })
    }

    fn take(&mut self, s: &ObservedSituation) {
        let (Some(process), Some((_, status))) = (s.process(ProcessKind::Vessel), s.vessel()) else {
            return;
        };
        let at_ns = process.at_ns;
        if at_ns <= self.ended_ns {
            return;
        }
        self.ended_ns = at_ns;
        let samples = &status.estimator.motion;
        // The samples are evenly spaced over the preceding half second.
        let step_ns = 500_000_000 / i64::try_from(samples.len().max(1)).unwrap_or(1);
        for (k, sample) in (0..)
            .zip(samples.iter().rev())
            .collect::<Vec<_>>()
            .into_iter()
            .rev()
        {
            let t: Time<TrueTime> = Time::from_nanos(at_ns - k * step_ns);
            self.motion.add(t, Some(*sample));
        }
        for drone in status.drones.iter() {
            let (number, state) = (drone.status.header.drone, drone.status.state);
            let known = self.states.len() < DRONES || self.states.contains_key(&number);
            let before = self.states.get(&number).copied();
            if known && self.states.insert(number, state) != Some(state) {
                // A view that began with the drone already on the deck has observed no flight.
                if let (Some(_), Some(_)) = (state.ending(), before) {
                    let ended = state.named(&drone.status.entered);
                    self.result = Some((at_ns, ended, format!("drone {number}: {}", drone.status.entered)));
                }
                let entered = drone.status.state.because(&drone.status.entered);
                self.log.push_back((at_ns, format!("drone {number} {entered}")));
            }
        }
        while self.log.len() > LOG_LINES {
            self.log.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No order of the page opens the deck or clears a take-off.
    #[test]
    fn orders_of_the_vessels_page() {
        assert_eq!(named(""), Some(DeckOrder::Closed));
        assert_eq!(
            COURSE.map(named),
            [Some(DeckOrder::Steady(60)), Some(DeckOrder::Turning)]
        );
        assert_eq!(["open", "takeoff", "clear"].map(named), [None; 3]);
    }
}

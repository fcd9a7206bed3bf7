//! The vessel's computer for people with a browser: her status, judged, as `alight status` prints it.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::msg::{Charge, Course};
use alight_shared::time::{Time, TrueTime};
use alight_usv::deck::DeckOrder;

use crate::config::VesselComputer;
use crate::tools::check::finding::Level;
use crate::tools::flights;
use crate::tools::vessel_sources::MISSING_S;
use crate::tools::vessel_status::{LOST_CONTACT_S, STALE_S, judge};
use crate::vessel::deck_file;
use crate::vessel::status_file::{self, DroneContact, VesselStatus};
use crate::view::board::{age, minutes};
use crate::view::motion::MotionHistory;
use crate::view::picture::{Alarm, Figure, FlightLine, LogLine, OrderView, Picture, StateView, Tone};
use crate::view::server::Order;

/// Changes of drones' states that are kept.
const LOG_LINES: usize = 12;
/// Drones whose changes are followed.
const DRONES: usize = 32;

/// Looks at the vessel's status, again and again.
pub struct Look<'a> {
    computer: &'a VesselComputer,
    motion: MotionHistory,
    /// When the newest status was written, on the steady clock, ns.
    seen_ns: i64,
    states: BTreeMap<u32, String>,
    log: VecDeque<(i64, String)>,
    /// Flights that had ended when the look began, as the vessel's own process does.
    earlier: Vec<FlightLine>,
    order: OrderView,
}

impl<'a> Look<'a> {
    /// At this vessel; `may_order`: the page may close her deck.
    pub fn new(computer: &'a VesselComputer, may_order: bool) -> Look<'a> {
        Look {
            computer,
            motion: MotionHistory::default(),
            seen_ns: i64::MIN,
            states: BTreeMap::new(),
            log: VecDeque::new(),
            earlier: flights::earlier(&computer.recorder.directory),
            order: OrderView {
                label: may_order.then_some("CLOSE THE DECK"),
                answer: String::new(),
            },
        }
    }
    /// The crew's word on the deck, as `alight command deck closed` gives it.
    pub fn close_deck(&mut self, order: Order) {
        let answer = match deck_file::leave(self.computer, DeckOrder::Closed) {
            Ok(_) => Ok("the deck is ordered closed: it is once `deck` says so above".to_owned()),
            Err(e) => Err(format!("THE DECK IS NOT CLOSED: {e}")),
        };
        self.order.answer = answer.clone().unwrap_or_else(|e| e);
        // Who gave it may have gone.
        let _gone = order.reply.send(answer);
    }
    /// The picture at `now_ns` of the steady clock.
    pub fn picture(&mut self, now_ns: i64) -> Picture {
        let title = format!("vessel {}", self.computer.vessel_id);
        match status_file::read(self.computer) {
            None => Picture::empty(
                title,
                "no vessel's process runs on this computer, or this user may not see it: systemctl status alight-vessel",
            ),
            Some(Err(e)) => Picture::empty(title, format!("{e}; restart the vessel's process")),
            Some(Ok(status)) => {
                self.take(&status);
                self.of(title, &status, now_ns)
            }
        }
    }

    /// What is new in it.
    fn take(&mut self, status: &VesselStatus) {
        let at_ns = status.process.at_ns;
        if at_ns <= self.seen_ns {
            return;
        }
        self.seen_ns = at_ns;
        let samples = &status.estimator.motion;
        // They were taken evenly over the half second before.
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
        for drone in &status.drones {
            let known = self.states.len() < DRONES || self.states.contains_key(&drone.drone);
            if known && self.states.get(&drone.drone) != Some(&drone.state) {
                self.states.insert(drone.drone, drone.state.clone());
                self.log.push_back((at_ns, named(drone)));
            }
        }
        while self.log.len() > LOG_LINES {
            self.log.pop_front();
        }
    }

    fn of(&self, title: String, status: &VesselStatus, now_ns: i64) -> Picture {
        let since_s = |ns: i64| now_ns.saturating_sub(ns) as f64 * 1e-9;
        let stale = since_s(status.process.at_ns) > STALE_S;
        let mut alarms: Vec<Alarm> = judge(status, now_ns)
            .into_iter()
            .filter(|f| f.level > Level::Fine)
            .map(|f| Alarm {
                tone: if f.level == Level::Broken {
                    Tone::Alarm
                } else {
                    Tone::Warning
                },
                text: if f.remedy.is_empty() {
                    format!("{}: {}", f.topic, f.found)
                } else {
                    format!("{}: {}. {}", f.topic, f.found, f.remedy)
                },
            })
            .collect();
        alarms.sort_by_key(|a| core::cmp::Reverse(a.tone));
        Picture {
            title,
            clock_s: 0.0,
            state: foremost(status).map(|d| StateView {
                name: format!("Drone {}: {}", d.drone, d.state),
                since_s: 0.0,
                entered: d.entered.clone(),
                waiting: d.waiting.clone(),
                stale: stale || d.age_s > LOST_CONTACT_S,
            }),
            scene: None,
            figures: figures(status, stale),
            alarms,
            motion: self.motion.view(),
            log: self
                .log
                .iter()
                .rev()
                .map(|(at, text)| LogLine {
                    ago_s: since_s(*at),
                    text: text.clone(),
                })
                .collect(),
            flights: self.earlier.clone(),
            order: self.order.clone(),
        }
    }
}

/// The drone that has the deck, else the one that was received last.
fn foremost(status: &VesselStatus) -> Option<&DroneContact> {
    let owner = status.drones.iter().find(|d| Some(d.drone) == status.deck_owner);
    let newest = status.drones.iter().min_by(|a, b| a.age_s.total_cmp(&b.age_s));
    owner.or(newest)
}

fn named(drone: &DroneContact) -> String {
    let reason = if drone.entered.is_empty() {
        String::new()
    } else {
        format!(": {}", drone.entered)
    };
    format!("drone {} {}{reason}", drone.drone, drone.state)
}

fn figures(status: &VesselStatus, stale: bool) -> Vec<Figure> {
    let (deck, estimator) = (&status.deck, &status.estimator);
    let figure = |name, value: Option<String>, note: String, tone| Figure {
        name,
        value,
        note,
        tone,
        stale,
    };
    let occupied = if status.occupied { "occupied" } else { "" };
    let owner = match (deck.closed, status.deck_owner) {
        (Some(_), _) => "CLOSED".into(),
        (None, Some(id)) => format!("drone {id}'s"),
        (None, None) => "free".into(),
    };
    let course = match deck.course {
        Course::Unknown => "not stated".into(),
        Course::Steady(s) => format!("steady, {}", minutes(f64::from(s))),
        Course::Turning => "turning".into(),
    };
    let keep = if deck.wants_steady {
        "KEEP COURSE AND SPEED"
    } else {
        ""
    };
    let drone = foremost(status);
    let age_s = estimator.estimate_age_s.filter(|s| *s <= MISSING_S);
    let closed = if deck.closed.is_some() {
        Tone::Warning
    } else {
        Tone::Fine
    };
    let asked = if deck.wants_steady {
        Tone::Warning
    } else {
        Tone::Fine
    };
    let unheard = if drone.is_some_and(|d| d.age_s > LOST_CONTACT_S) {
        Tone::Alarm
    } else {
        Tone::Fine
    };
    let estimate = if age_s.is_some() { Tone::Fine } else { Tone::Alarm };
    vec![
        figure("deck", Some(owner), occupied.into(), closed),
        figure("course", Some(course), keep.into(), asked),
        figure(
            "link",
            drone.map(|d| age(d.age_s)),
            drone.map_or(String::new(), |d| format!("old, from drone {}", d.drone)),
            unheard,
        ),
        figure(
            "battery",
            drone.and_then(|d| d.battery).map(|b| Charge(Some(b)).to_string()),
            drone.map_or(String::new(), |d| format!("of drone {}", d.drone)),
            Tone::Fine,
        ),
        figure(
            "waves",
            estimator.waves.map(|[height_m, _]| format!("{height_m:.1} m")),
            estimator.waves.map_or(String::new(), |[_, confidence]| {
                format!("predicted to {:.0} %", 100.0 * confidence)
            }),
            Tone::Fine,
        ),
        figure("estimate", age_s.map(age), "old".into(), estimate),
        // She has no wind sensor that Alight reads.
        figure(
            "wind",
            None,
            "the drone's page knows it in flight".into(),
            Tone::Fine,
        ),
    ]
}

//! The vessel's computer for people with a browser: her status, judged, as `alight status` prints it.

use std::collections::{BTreeMap, VecDeque};

use alight_shared::msg::{Charge, Course, DeckOrder, DroneContact, DroneStatus, State};
use alight_shared::time::{Time, TrueTime};
use alight_shared::transport::process::ProcessKind;

use crate::config::VesselComputer;
use crate::exit::CliError;
use crate::process::observer::Follower;
use crate::tools::check::finding::Level;
use crate::tools::flights;
use crate::tools::vessel_sources::MISSING_S;
use crate::tools::vessel_status::{LOST_CONTACT_S, judge};
use crate::vessel::crew::OrderOnItsWay;
use crate::vessel::status::{CertificateStatus, STALE_S, Situation};
use crate::view::board::{age, minutes};
use crate::view::motion::MotionHistory;
use crate::view::picture::{Alarm, Figure, FlightLine, LogLine, OrderView, Picture, StateView, Tone};
use crate::view::server::Order;

/// The certificate's file is read again this often, ns.
const CERTIFICATE_PERIOD_NS: i64 = 60_000_000_000;
/// Changes of drones' states that are kept.
const LOG_LINES: usize = 12;
/// Drones whose changes are followed.
const DRONES: usize = 32;

/// Looks at the vessel's status, again and again.
pub struct Look<'a> {
    computer: &'a VesselComputer,
    aboard: Follower,
    /// When its file is read again, and what that said.
    certificate: (i64, CertificateStatus),
    motion: MotionHistory,
    /// When the newest status was written, on the steady clock, ns.
    seen_ns: i64,
    states: BTreeMap<u32, State>,
    log: VecDeque<(i64, String)>,
    /// Flights that had ended when the look began, as the vessel's own process does.
    earlier: Vec<FlightLine>,
    order: OrderView,
    /// The page's order under way to the vessel's process.
    given: Option<(OrderOnItsWay, Order)>,
}

impl<'a> Look<'a> {
    /// At this vessel; `may_order`: the page may close her deck.
    pub fn new(computer: &'a VesselComputer, may_order: bool) -> Result<Look<'a>, CliError> {
        Ok(Look {
            computer,
            aboard: Follower::of(&computer.instance, ProcessKind::View.name())?,
            certificate: (i64::MIN, CertificateStatus::None),
            motion: MotionHistory::default(),
            seen_ns: i64::MIN,
            states: BTreeMap::new(),
            log: VecDeque::new(),
            earlier: flights::earlier(&computer.recorder.directory),
            order: OrderView {
                label: may_order.then_some("CLOSE THE DECK"),
                answer: String::new(),
            },
            given: None,
        })
    }
    /// The crew's word on the deck, as `alight command deck closed` gives it.
    pub fn close_deck(&mut self, order: Option<Order>) {
        if let Some(order) = order {
            let memory = self.aboard.poll().map(|(memory, _)| memory);
            let given = match memory.filter(|_| self.given.is_none()) {
                Some(m) => {
                    OrderOnItsWay::give(m, self.computer, DeckOrder::Closed).map_err(|e| e.to_string())
                }
                None => Err("the vessel's process does not run, or an order is under way".to_owned()),
            };
            match given {
                Ok(given) => self.given = Some((given, order)),
                Err(e) => self.answer(order, Err(format!("THE DECK IS NOT CLOSED: {e}"))),
            }
        }
        let Some((given, _)) = &mut self.given else { return };
        let answer = match given.poll() {
            Some(status) if status.deck.closed.is_some() => Ok("the deck is closed".to_owned()),
            None if !given.is_over() => return,
            Some(_) | None => Err("THE DECK IS NOT CLOSED: the vessel's process has not taken it".to_owned()),
        };
        if let Some((_, order)) = self.given.take() {
            self.answer(order, answer);
        }
    }
    fn answer(&mut self, order: Order, answer: Result<String, String>) {
        self.order.answer = answer.clone().unwrap_or_else(|e| e);
        // Who gave it may have gone.
        let _gone = order.reply.send(answer);
    }
    /// The picture at `now_ns` of the steady clock.
    pub fn picture(&mut self, now_ns: i64) -> Picture {
        let title = format!("vessel {}", self.computer.vessel_id);
        let Some((_, seen)) = self.aboard.poll() else {
            return Picture::empty(
                title,
                "no vessel's process runs on this computer, or this user may not see it: systemctl status alight-vessel",
            );
        };
        if now_ns >= self.certificate.0 {
            self.certificate = (
                now_ns + CERTIFICATE_PERIOD_NS,
                CertificateStatus::of(self.computer),
            );
        }
        match Situation::of(self.computer, &self.certificate.1, seen, now_ns) {
            None => Picture::empty(
                title,
                "the vessel's process does not report: journalctl -u alight-vessel",
            ),
            Some(situation) => {
                self.take(&situation);
                self.of(title, &situation, now_ns)
            }
        }
    }

    /// What is new in it.
    fn take(&mut self, seen: &Situation) {
        let (at_ns, status) = (seen.process.at_ns, &seen.status);
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
        for drone in status.drones.iter() {
            let (number, state) = (drone.status.header.drone, drone.status.state);
            let known = self.states.len() < DRONES || self.states.contains_key(&number);
            if known && self.states.insert(number, state) != Some(state) {
                self.log.push_back((at_ns, named(drone)));
            }
        }
        while self.log.len() > LOG_LINES {
            self.log.pop_front();
        }
    }

    fn of(&self, title: String, status: &Situation, now_ns: i64) -> Picture {
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
                name: format!("Drone {}: {}", d.status.header.drone, d.status.state.name()),
                since_s: 0.0,
                entered: d.status.entered.to_string(),
                waiting: d.status.waiting.to_string(),
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
fn foremost(seen: &Situation) -> Option<&DroneContact> {
    let drones = &seen.status.drones;
    let owner = drones
        .iter()
        .find(|d| Some(d.status.header.drone) == seen.status.deck_owner);
    let newest = drones.iter().min_by(|a, b| a.age_s.total_cmp(&b.age_s));
    owner.or(newest)
}

fn named(drone: &DroneContact) -> String {
    let DroneStatus {
        header,
        state,
        entered,
        ..
    } = &drone.status;
    let reason = entered.to_string();
    let reason = if reason.is_empty() {
        reason
    } else {
        format!(": {reason}")
    };
    format!("drone {} {}{reason}", header.drone, state.name())
}

fn figures(seen: &Situation, stale: bool) -> Vec<Figure> {
    let status = &seen.status;
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
    let drone = foremost(seen);
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
            drone.map_or(String::new(), |d| {
                format!("old, from drone {}", d.status.header.drone)
            }),
            unheard,
        ),
        figure(
            "battery",
            drone
                .and_then(|d| d.status.battery)
                .map(|b| Charge(Some(b)).to_string()),
            drone.map_or(String::new(), |d| format!("of drone {}", d.status.header.drone)),
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

//! Board: newest state of a running flight, and the picture of it that the page shows.

use std::collections::VecDeque;

use alight_bridge::BridgeOut;
use alight_shared::frames::wrap_angle;
use alight_shared::geometry::DeckGeometry;
use alight_shared::msg::{
    AutopilotState, Course, DECK_CLOSED, DeckForecast, DeckGrant, DroneState, LinkState, MissionState, Plan,
    ReasonCode, State, WaveModel, Wind, still_armed,
};
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_shared::topics::{self, Topic};
use alight_uav::autopilot::config::DisarmConfig;
use alight_uav::autopilot::still_armed_s;
use alight_uav::mission::{MissionIn, MissionOut};
use alight_uav::planner::PlannerOut;
use alight_uav::predictor::{PredictorIn, PredictorOut};
use alight_usv::ComputerOut;

use crate::view::motion::MotionHistory;
use crate::view::picture::{
    Alarm, DroneView, Figure, FlightLine, LogLine, OrderView, Picture, Place, SceneView, StateView, Tone,
};

/// Changes of state that are kept.
const LOG_LINES: usize = 12;
/// Flights that are kept.
const FLIGHTS: usize = 8;
/// Every so many stages of forecast and plan are drawn.
const PATH_STEP: usize = 2;
/// A plan that is older is not drawn any more, s: the vessel has left it behind.
const FORGOTTEN_S: f64 = 5.0;
/// People look on a few times a second: nothing younger than this is called old, s.
const SHORTEST_STALE_S: f64 = 1.0;

/// The newest of a kind, and when it came.
struct Newest<T> {
    value: Option<(Time<TrueTime>, T)>,
    stale_s: f64,
}

impl<T> Newest<T> {
    fn of(topic: &Topic) -> Newest<T> {
        Newest {
            value: None,
            stale_s: topic.stale_after.secs().max(SHORTEST_STALE_S),
        }
    }
    fn set(&mut self, t: Time<TrueTime>, value: Option<T>) {
        self.value = value.map(|v| (t, v)).or(self.value.take());
    }
    /// Value, age (s), and whether it is an old one.
    fn get(&self, now: Time<TrueTime>) -> Option<(&T, f64, bool)> {
        let (at, value) = self.value.as_ref()?;
        let age_s = (now - *at).secs().max(0.0);
        Some((value, age_s, age_s > self.stale_s))
    }
    fn fresh(&self, now: Time<TrueTime>) -> Option<&T> {
        self.get(now).filter(|(_, _, stale)| !stale).map(|(v, _, _)| v)
    }
}

/// What does not change, as far as it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// What is shown.
    pub title: String,
    /// The deck.
    pub deck: Option<DeckGeometry>,
    /// The motors on the deck.
    pub disarm: DisarmConfig,
}

/// A flight that ended.
struct Ended {
    at: Time<TrueTime>,
    outcome: &'static str,
    text: String,
}

/// What is known of a flight.
pub struct Board {
    known: Known,
    mission: Newest<MissionState>,
    autopilot: Newest<AutopilotState>,
    drone: Newest<DroneState>,
    forecast: Newest<DeckForecast>,
    link: Newest<LinkState>,
    plan: Newest<Plan>,
    grant: Newest<DeckGrant<DroneClock>>,
    wave: Newest<WaveModel<DroneClock>>,
    /// Roll, pitch (rad) and height (m) by the vessel's own estimate.
    own_motion: Newest<[f64; 3]>,
    motion: MotionHistory,
    /// The newest motion is the vessel's own estimate of it.
    is_own: bool,
    log: VecDeque<(Time<TrueTime>, String)>,
    flights: VecDeque<Ended>,
    /// When the landing was begun that goes on.
    begun: Option<Time<TrueTime>>,
    shown: Option<State>,
    /// What the source of all this knows beside, such as processes that are silent.
    pub alarms: Vec<Alarm>,
    /// Flights of earlier runs, the newest first, from whoever keeps them.
    pub earlier: Vec<FlightLine>,
    /// The order that may be given, and its answer.
    pub order: OrderView,
}

impl Board {
    /// Nothing is known yet but this.
    pub fn new(known: Known) -> Board {
        Board {
            known,
            mission: Newest::of(&topics::MISSION),
            autopilot: Newest::of(&topics::AUTOPILOT),
            drone: Newest::of(&topics::DRONE_STATE),
            forecast: Newest::of(&topics::FORECAST),
            link: Newest::of(&topics::LINK),
            plan: Newest::of(&topics::PLAN),
            grant: Newest::of(&topics::BRIDGE_DECK),
            wave: Newest::of(&topics::BRIDGE_WAVE),
            own_motion: Newest::of(&topics::ESTIMATE),
            motion: MotionHistory::default(),
            is_own: false,
            log: VecDeque::new(),
            flights: VecDeque::new(),
            begun: None,
            shown: None,
            alarms: Vec::new(),
            earlier: Vec::new(),
            order: OrderView::default(),
        }
    }
    /// Forgets what is known but for the flights that ended.
    pub fn reset(&mut self) {
        let known = core::mem::take(&mut self.known);
        let flights = core::mem::take(&mut self.flights);
        let earlier = core::mem::take(&mut self.earlier);
        *self = Board {
            flights,
            earlier,
            ..Board::new(known)
        };
    }
    /// A step of the vessel.
    pub fn vessel(&mut self, t: Time<TrueTime>, o: &ComputerOut) {
        let estimate = o.vessel.estimate.as_ref();
        self.own_motion.set(t, estimate.map(|e| motion(&e.eta)));
        self.sample(t);
    }
    /// The vessel's broadcast as the bridge received it.
    pub fn received(&mut self, t: Time<TrueTime>, o: &BridgeOut) {
        self.own_motion
            .set(t, o.estimate.as_ref().map(|e| motion(&e.eta)));
        self.sample(t);
    }
    /// A step of the bridge.
    pub fn bridge(&mut self, t: Time<TrueTime>, o: &BridgeOut) {
        self.link.set(t, o.link);
        self.grant.set(t, o.deck);
        self.wave.set(t, o.wave);
    }
    /// A step of the predictor.
    pub fn predictor(&mut self, t: Time<TrueTime>, i: &PredictorIn, o: &PredictorOut) {
        self.drone.set(t, i.drone);
        self.forecast.set(t, o.forecast);
        self.sample(t);
    }
    /// A step of the mission.
    pub fn mission(&mut self, t: Time<TrueTime>, i: &MissionIn, o: &MissionOut) {
        self.autopilot.set(t, i.autopilot);
        if let Some(m) = &o.state {
            self.entered(t, m);
        }
        self.mission.set(t, o.state);
    }
    /// A step of the planner.
    pub fn planner(&mut self, t: Time<TrueTime>, o: &PlannerOut) {
        self.plan.set(t, o.plan);
    }

    /// The motion by the vessel's own estimate; by the drone's forecast where that does not come.
    fn sample(&mut self, t: Time<TrueTime>) {
        let stage = self.forecast.fresh(t).and_then(|f| f.stages.first());
        let of_forecast = stage.map(|s| [s.euler[0], s.euler[1], -s.position[2]]);
        let own = self.own_motion.fresh(t).copied();
        let sample = own.or(of_forecast);
        if own.is_some() != self.is_own {
            // They count heights from levels of their own.
            self.is_own = own.is_some();
            self.motion.relevel(sample);
        }
        self.motion.add(t, sample);
    }

    /// Keeps a change of state, and what it ends.
    fn entered(&mut self, t: Time<TrueTime>, m: &MissionState) {
        let before = self.shown.replace(m.state);
        if before == Some(m.state) {
            return;
        }
        let reason = m.entered.to_string();
        keep(
            &mut self.log,
            (t, with_reason(m.state.name(), &reason)),
            LOG_LINES,
        );
        let outcome = match m.state {
            State::Idle => None,
            State::Landed => Some("landed"),
            State::GaveUp => Some("gave up"),
            _ => {
                self.begun.get_or_insert(t);
                None
            }
        };
        // Who looks on since the drone stood on the deck has seen no flight.
        if let (Some(outcome), Some(_)) = (outcome, before) {
            let took = self.begun.take().map(|at| (t - at).secs());
            let took = took.map_or(String::new(), |s| format!(", after {}", minutes(s)));
            let plural = if m.attempts == 1 { "" } else { "s" };
            let text = format!("{reason}; {} descent{plural}{took}", m.attempts);
            keep(&mut self.flights, Ended { at: t, outcome, text }, FLIGHTS);
        }
        if matches!(m.state, State::Idle | State::Landed | State::GaveUp) {
            self.begun = None;
        }
    }

    /// The picture at `t`.
    pub fn picture(&self, t: Time<TrueTime>) -> Picture {
        Picture {
            title: self.known.title.clone(),
            clock_s: 0.0,
            state: self.mission.get(t).map(|(m, age_s, stale)| StateView {
                name: m.state.name().into(),
                since_s: if m.since == Time::EPOCH {
                    // It has not changed since the mission began.
                    0.0
                } else {
                    (m.header.at - m.since).secs() + age_s
                },
                entered: m.entered.to_string(),
                waiting: m.waiting.to_string(),
                stale,
            }),
            scene: self.scene(t),
            figures: self.figures(t),
            alarms: self.all_alarms(t),
            motion: self.motion.view(),
            log: self
                .log
                .iter()
                .rev()
                .map(|(at, text)| LogLine {
                    ago_s: (t - *at).secs(),
                    text: text.clone(),
                })
                .collect(),
            flights: self
                .flights
                .iter()
                .rev()
                .map(|f| FlightLine {
                    when: format!("{} ago", minutes((t - f.at).secs())),
                    outcome: f.outcome.into(),
                    text: f.text.clone(),
                })
                .chain(self.earlier.iter().cloned())
                .take(FLIGHTS)
                .collect(),
            order: self.order.clone(),
        }
    }

    fn scene(&self, t: Time<TrueTime>) -> Option<SceneView> {
        let (forecast, age_s, forecast_stale) = self.forecast.get(t)?;
        let first = forecast.stages.first()?;
        let deck = forecast
            .at(forecast.header.at + Span::from_secs(age_s))
            .unwrap_or(*first);
        let heading = forecast.mean_heading;
        let place = |at: [f64; 3]| place(at, deck.position, heading);
        let path =
            |stages: &mut dyn Iterator<Item = [f64; 3]>| stages.step_by(PATH_STEP).map(place).collect();
        let drone = self.drone.get(t).map(|(d, _, stale)| {
            let e = d.euler();
            DroneView {
                at: place(d.position),
                euler_deg: degrees([e.x, e.y, wrap_angle(e.z - heading)]),
                stale,
            }
        });
        let plan = self.plan.get(t).filter(|(_, age_s, _)| *age_s < FORGOTTEN_S);
        let [roll, pitch, yaw] = deck.euler;
        Some(SceneView {
            size_m: self.known.deck.as_ref().map(|d| [d.length_m, d.width_m]),
            euler_deg: degrees([roll, pitch, wrap_angle(yaw - heading)]),
            heading_deg: tenth(heading.to_degrees().rem_euclid(360.0)),
            forecast: path(&mut forecast.stages.iter().map(|s| s.position)),
            forecast_stale,
            plan: plan.map_or_else(Vec::new, |(p, _, _)| {
                path(&mut p.stages.iter().map(|s| s.position))
            }),
            plan_stale: plan.is_none_or(|(_, _, stale)| stale),
            drone,
        })
    }

    fn figures(&self, t: Time<TrueTime>) -> Vec<Figure> {
        vec![
            self.distance(t),
            self.link_age(t),
            self.battery(t),
            self.owner(t),
            self.wind(t),
            self.waves(t),
            self.mode(t),
            self.planned(t),
        ]
    }
    fn distance(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "distance";
        let (Some((f, _, old)), Some((d, _, older))) = (self.forecast.get(t), self.drone.get(t)) else {
            return unknown(NAME);
        };
        let Some(deck) = f.stages.first() else {
            return unknown(NAME);
        };
        let [forward, right, up] = place(d.position, deck.position, f.mean_heading);
        Figure {
            name: NAME,
            value: Some(format!("{:.1} m", forward.hypot(right))),
            note: format!("{up:.1} m above deck"),
            stale: old || older,
            tone: Tone::Fine,
        }
    }
    fn link_age(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "link";
        let Some((l, age_s, _)) = self.link.get(t) else {
            return unknown(NAME);
        };
        let age_s = l.age_s + age_s;
        if age_s.is_infinite() {
            return Figure {
                note: "no vessel received yet".into(),
                tone: Tone::Warning,
                ..unknown(NAME)
            };
        }
        let limit_s = topics::ESTIMATE.stale_after.secs();
        Figure {
            name: NAME,
            value: Some(age(age_s)),
            note: format!("old, {:.0} % lost", 100.0 * l.loss),
            tone: if age_s > limit_s {
                Tone::Alarm
            } else if age_s > 0.5 * limit_s {
                Tone::Warning
            } else {
                Tone::Fine
            },
            stale: age_s > limit_s,
        }
    }
    /// The newest reserve, by a mission that lives or not.
    fn reserve(&self) -> Option<f64> {
        let (_, m) = self.mission.value.as_ref()?;
        Some(m.battery_reserve)
    }
    fn battery(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "battery";
        let Some((a, _, stale)) = self.autopilot.get(t) else {
            return unknown(NAME);
        };
        let reserve = self.reserve();
        let volts = a.battery_v.map(|v| format!("{v:.1} V"));
        let needs = reserve.map(|r| format!("needs {:.0} %", 100.0 * r));
        let note: Vec<String> = needs.into_iter().chain(volts).collect();
        let low = a.battery.zip(reserve).is_some_and(|(b, r)| b < r);
        Figure {
            name: NAME,
            value: a.battery.map(|b| format!("{:.0} %", 100.0 * b)),
            note: note.join(", "),
            tone: if low { Tone::Alarm } else { Tone::Fine },
            stale,
        }
    }
    fn owner(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "deck";
        let Some((g, age_s, stale)) = self.grant.get(t) else {
            return unknown(NAME);
        };
        let own = g.header.drone;
        let own = self.mission.value.as_ref().map_or(own, |(_, m)| m.header.drone);
        let course = match g.course.after(age_s) {
            Course::Unknown => String::new(),
            Course::Steady(s) => format!("course steady for {s:.0} s"),
            Course::Turning => "vessel turns".into(),
        };
        let occupied = if g.occupied { "occupied" } else { "" };
        let note: Vec<&str> = [occupied, &course]
            .into_iter()
            .filter(|s| !s.is_empty())
            .collect();
        let (value, tone) = match g.owner {
            DECK_CLOSED => ("CLOSED".into(), Tone::Warning),
            0 => ("free".into(), Tone::Fine),
            owner if owner == own => ("ours".into(), Tone::Fine),
            owner => (format!("drone {owner}'s"), Tone::Fine),
        };
        Figure {
            name: NAME,
            value: Some(value),
            note: note.join(", "),
            tone,
            stale,
        }
    }
    /// The true wind, and what it and the way through the air push the drone with.
    fn wind(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "wind";
        let Some((m, _, stale)) = self.mission.get(t) else {
            return unknown(NAME);
        };
        let Some(wind) = m.wind.map(Wind::towards) else {
            return unknown(NAME);
        };
        let push = self
            .plan
            .get(t)
            .map(|(p, ..)| p.disturbance[0].hypot(p.disturbance[1]));
        Figure {
            name: NAME,
            value: Some(wind.to_string()),
            note: push.map_or(String::new(), |a| format!("pushes {a:.1} m/s²")),
            tone: Tone::Fine,
            stale,
        }
    }
    fn waves(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "waves";
        let Some((w, _, stale)) = self.wave.get(t) else {
            return unknown(NAME);
        };
        Figure {
            name: NAME,
            value: Some(format!("{:.1} m", w.significant_height_m)),
            note: format!("predicted to {:.0} %", 100.0 * w.confidence),
            tone: Tone::Fine,
            stale,
        }
    }
    fn mode(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "autopilot";
        let Some((a, _, stale)) = self.autopilot.get(t) else {
            return unknown(NAME);
        };
        Figure {
            name: NAME,
            value: Some(format!("{:?}", a.mode)),
            note: if a.armed { "armed" } else { "disarmed" }.into(),
            tone: Tone::Fine,
            stale,
        }
    }

    fn planned(&self, t: Time<TrueTime>) -> Figure {
        const NAME: &str = "touchdown";
        let Some((p, age_s, stale)) = self.plan.get(t) else {
            return unknown(NAME);
        };
        let left = p.touchdown_at.map(|at| (at - p.header.at).secs() - age_s);
        Figure {
            name: NAME,
            value: match left {
                // A countdown that nobody keeps is none.
                Some(_) if stale => None,
                Some(s) => Some(format!("in {:.1} s", s.max(0.0))),
                None => Some("not planned".into()),
            },
            note: format!("plan {} old, {:?}", age(age_s), p.solve).to_lowercase(),
            tone: Tone::Fine,
            stale,
        }
    }

    fn all_alarms(&self, t: Time<TrueTime>) -> Vec<Alarm> {
        let mut all = self.alarms.clone();
        let mut add = |tone: Tone, text: String| all.push(Alarm { tone, text });
        if let Some((m, age_s, stale)) = self.mission.get(t) {
            match m.state {
                _ if stale => add(
                    Tone::Alarm,
                    format!("no message from the mission for {}", minutes(age_s)),
                ),
                State::GaveUp => add(Tone::Alarm, with_reason("gave up", &m.entered.to_string())),
                State::Hold => add(Tone::Warning, with_reason("holds", &m.entered.to_string())),
                _ => {}
            }
            let armed = self.autopilot.fresh(t).is_some_and(|a| a.armed);
            if let Some(s) = still_armed_s(m.header.at, m, armed, &self.known.disarm) {
                add(Tone::Alarm, still_armed(s as f32));
            }
        }
        if let Some(a) = self.autopilot.fresh(t)
            && a.rejection.code != ReasonCode::None
        {
            add(Tone::Warning, format!("no landing: {}", a.rejection));
        }
        for figure in [self.link_age(t), self.battery(t)] {
            if let (Tone::Alarm, Some(value)) = (figure.tone, figure.value) {
                add(Tone::Alarm, format!("{} {value} ({})", figure.name, figure.note));
            }
        }
        all.sort_by_key(|a| core::cmp::Reverse(a.tone));
        all
    }
}

/// Roll, pitch, height of a vessel's estimate.
fn motion(eta: &[f64; 6]) -> [f64; 3] {
    [eta[3], eta[4], -eta[2]]
}

fn keep<T>(kept: &mut VecDeque<T>, new: T, most: usize) {
    kept.push_back(new);
    while kept.len() > most {
        kept.pop_front();
    }
}

fn unknown(name: &'static str) -> Figure {
    Figure {
        name,
        ..Figure::default()
    }
}

fn with_reason(what: &str, reason: &str) -> String {
    if reason.is_empty() {
        what.into()
    } else {
        format!("{what}: {reason}")
    }
}

/// An age that a person reads at a glance.
pub fn age(s: f64) -> String {
    if s < 1.0 {
        format!("{:.0} ms", 1e3 * s)
    } else {
        format!("{s:.1} s")
    }
}

/// A time that a person reads at a glance.
pub fn minutes(s: f64) -> String {
    if !(s >= 90.0) {
        format!("{s:.0} s")
    } else if s < 5400.0 {
        format!("{:.0} min", s / 60.0)
    } else {
        format!("{:.0} h", s / 3600.0)
    }
}

/// A place of the NED as seen from the deck at `deck`.
fn place(at: [f64; 3], deck: [f64; 3], heading: f64) -> Place {
    let (sin, cos) = heading.sin_cos();
    let [north, east, down] = [at[0] - deck[0], at[1] - deck[1], at[2] - deck[2]];
    [cos * north + sin * east, cos * east - sin * north, -down].map(|x| (100.0 * x).round() / 100.0)
}

fn degrees(euler: [f64; 3]) -> [f64; 3] {
    euler.map(|a| tenth(a.to_degrees()))
}

fn tenth(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}

#[cfg(test)]
mod tests;

//! Two drones and one deck: the missions of both and the vessel's keeper, on one clock.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::msg::Seq;
use alight_shared::msg::{
    AutopilotMode, AutopilotState, Command, CommandKind, DeckForecast, DeckGrant, DeckStage, DroneState,
    DroneStatus, Header, LandedState, MissionState, Motors, Phase, Plan, ReasonCode, SetPoint, Source, State,
};
use alight_shared::node::Node;
use alight_shared::time::{DroneClock, Span, Time, VesselClock};
use alight_uav::mission::{Mission, MissionConfig, MissionIn};
use alight_usv::deck::{ArbiterIn, DeckArbiter, DeckConfig};
use nalgebra::Vector3;

/// Height of the deck, NED z, m.
const DECK_Z: f64 = -1.3;

/// An obedient drone: it goes at once where its mission wants it.
struct Drone {
    id: u32,
    mission: Mission,
    at: Vector3<f64>,
    state: MissionState,
    landed: bool,
    sequence: u32,
    /// Its radio works.
    radio: bool,
}

impl Drone {
    fn new(id: u32, north_m: f64) -> Drone {
        let config = MissionConfig {
            reservation_required: true,
            ..MissionConfig::default()
        };
        Drone {
            id,
            mission: Mission::new(
                &config,
                &DroneGeometry::default(),
                &DeckGeometry::default(),
                id,
                id,
            ),
            at: Vector3::new(north_m, 0.0, -12.0),
            state: MissionState::default(),
            landed: false,
            sequence: 0,
            radio: true,
        }
    }
    fn step(
        &mut self,
        t: Time<DroneClock>,
        command: Option<CommandKind>,
        grant: Option<DeckGrant<DroneClock>>,
    ) {
        self.sequence += 1;
        let header = Header::new(1, self.id, 1, self.sequence, t);
        let stage = DeckStage {
            position: [0.0, 0.0, DECK_Z],
            ..DeckStage::default()
        };
        let input = MissionIn {
            forecast: Some(DeckForecast {
                header,
                step: Span::from_millis(100),
                source: Source::Both,
                radio_age_s: 0.05,
                vision_age_s: 0.05,
                tag_age_s: 0.05,
                wave_confidence: 1.0,
                wave_following_deficit: 0.0,
                mean_heading: 0.0,
                stages: Seq::filled((0..41).map(|_| stage)),
                slopes: Seq::new(),
                predicted_slopes: Seq::new(),
            }),
            drone: Some(DroneState {
                header,
                position: self.at.into(),
                ..DroneState::default()
            }),
            autopilot: Some(AutopilotState {
                header,
                armed: true,
                mode: AutopilotMode::Offboard,
                landed: self.landed_state(),
                battery: 0.8,
                thrust: 0.34,
                hover_thrust: 0.34,
                ..AutopilotState::default()
            }),
            plan: Some(Plan {
                header,
                step: Span::from_millis(100),
                ..Plan::default()
            }),
            set_point: self.landed.then(|| SetPoint {
                header,
                motors: Motors::Stop,
                ..SetPoint::default()
            }),
            command: command.map(|kind| Command { header, kind }),
            deck: grant,
        };
        self.state = self.mission.step(t, &input).state.unwrap_or(self.state);
        let goal = match self.state.state.phase() {
            Phase::Navigation if self.state.state != State::Approach => self.state.hold_position(),
            Phase::Navigation | Phase::Follow => Vector3::new(0.0, 0.0, DECK_Z - self.state.height_m),
            Phase::Landing => Vector3::new(0.0, 0.0, self.at.z + self.state.descent_mps),
            Phase::None => self.at,
        };
        let max_step = if self.state.state.phase() == Phase::Landing {
            0.02 * self.state.descent_mps
        } else {
            0.08
        };
        let step = goal - self.at;
        self.at += step * (max_step / step.norm().max(max_step));
        self.landed |= self.at.z > DECK_Z - 0.3;
    }
    fn landed_state(&self) -> LandedState {
        if self.landed {
            LandedState::OnGround
        } else {
            LandedState::InAir
        }
    }
    fn status(&self, t: Time<DroneClock>) -> DroneStatus {
        DroneStatus {
            header: Header::new(1, self.id, 1, self.sequence, t),
            state: self.state.state,
            entered: self.state.entered,
            waiting: self.state.waiting,
            attempts: self.state.attempts,
            battery: 0.8,
            landed: self.landed_state(),
        }
    }
    fn descends(&self) -> bool {
        matches!(self.state.state, State::Descent | State::Flare)
    }
}

/// Drones and their deck; every state in which a drone was seen.
struct Fleet {
    drones: [Drone; 2],
    arbiter: DeckArbiter,
    k: u32,
    visited: [Vec<State>; 2],
}

impl Fleet {
    fn new() -> Fleet {
        Fleet {
            drones: [Drone::new(1, 20.0), Drone::new(2, -22.0)],
            arbiter: DeckArbiter::new(&DeckConfig::default(), 1, 1),
            k: 0,
            visited: Default::default(),
        }
    }
    /// For `secs`; on the way no two drones descend, and none where another stands.
    fn fly(&mut self, secs: f64) {
        for _ in 0..(secs * 100.0) as u32 {
            self.k += 1;
            let t_s = 10.0 + f64::from(self.k) * 0.01;
            let (t, vessel_t) = (
                Time::<DroneClock>::from_secs(t_s),
                Time::<VesselClock>::from_secs(t_s),
            );
            let speak = self.k.is_multiple_of(50);
            let statuses: Vec<DroneStatus> = self
                .drones
                .iter()
                .filter(|d| speak && d.radio)
                .map(|d| d.status(t))
                .collect();
            let out = self.arbiter.step(vessel_t, &ArbiterIn { statuses });
            let grant = out.grant.map(|g| g.restamped(t));
            let command = (self.k == 5).then_some(CommandKind::Land);
            for (d, visited) in self.drones.iter_mut().zip(&mut self.visited) {
                let received = grant.filter(|_| d.radio);
                d.step(t, command, received);
                if visited.last() != Some(&d.state.state) {
                    visited.push(d.state.state);
                }
            }
            let descend = self.drones.iter().filter(|d| d.descends() && !d.landed).count();
            let stand = self.drones.iter().filter(|d| d.landed).count();
            assert!(
                descend + stand <= 1,
                "{t_s} s: {descend} descend, {stand} stand on the deck"
            );
        }
    }
}

#[test]
fn arbiter_lets_one_of_two_drones_descend_and_tells_the_other_why_it_waits() {
    let mut fleet = Fleet::new();
    fleet.fly(40.0);
    let [first, second] = &fleet.drones;
    assert_eq!(first.state.state, State::Landed, "{:?}", fleet.visited);
    assert_eq!(second.state.state, State::TrackingStable, "{:?}", fleet.visited);
    assert_eq!(second.state.waiting.code, ReasonCode::DeckReserved);
    assert_eq!(second.state.waiting.to_string(), "the deck is drone 1's");
    // The first is lifted off, by a person.
    let first = &mut fleet.drones[0];
    first.mission = Drone::new(1, 0.0).mission;
    first.state = MissionState::default();
    (first.landed, first.at) = (false, Vector3::new(30.0, 0.0, -20.0));
    fleet.fly(20.0);
    assert_eq!(fleet.drones[1].state.state, State::Landed, "{:?}", fleet.visited);
}

#[test]
fn arbiter_restarted_during_a_descent_keeps_the_other_drone_away() {
    let mut fleet = Fleet::new();
    while !fleet.drones[0].descends() {
        fleet.fly(0.1);
    }
    fleet.arbiter = DeckArbiter::new(&DeckConfig::default(), 1, 2);
    fleet.fly(30.0);
    assert_eq!(fleet.drones[0].state.state, State::Landed, "{:?}", fleet.visited);
    assert!(!fleet.visited[1].contains(&State::Descent), "{:?}", fleet.visited);
}

#[test]
fn drone_without_radio_begins_no_descent_but_completes_one_under_way() {
    let mut fleet = Fleet::new();
    fleet.drones[1].radio = false;
    while !fleet.drones[0].descends() {
        fleet.fly(0.1);
    }
    fleet.drones[0].radio = false;
    fleet.fly(30.0);
    assert_eq!(fleet.drones[0].state.state, State::Landed, "{:?}", fleet.visited);
    assert_eq!(fleet.drones[1].state.state, State::TrackingStable);
    assert_eq!(fleet.drones[1].state.waiting.code, ReasonCode::DeckGrantStale);
}

//! Steps before a first landing: a pilot lands in the mode `shadow`; a drone follows the deck in the mode
//! `match` and then climbs.

use alight_shared::{
    msg::{AutopilotState, CommandKind, LandingMode, ReasonCode, State},
    step::Step,
    time::WorldTime,
};
use alight_sim::harness::{physics::TICK, rig::Rig, scenario::NodeConfigs};
use alight_uav::mission::MissionIn;
use nalgebra::Vector3;

use crate::at_sea;

fn nodes(mode: LandingMode) -> NodeConfigs {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.mode = mode;
    nodes
}

#[derive(Default)]
struct Received(Vec<AutopilotState>);

impl alight_sim::harness::observer::WorldObserver for Received {
    fn step(&mut self, _: WorldTime, step: &Step<'_>) {
        self.0.extend(step.input::<MissionIn>().and_then(|i| i.autopilot));
    }
}

/// Height above the deck that a pilot flies at the time `t`, m: approach height, tracking height, 2 m for a
/// while, then the deck.
fn by_hand(t: f64) -> f64 {
    let down = [
        (20.0, 1.0, 15.0, 7.0),
        (45.0, 0.5, 7.0, 2.0),
        (60.0, 0.4, 2.0, -1.0),
    ];
    down.iter().fold(15.0, |height, (from_s, speed, from_m, to_m)| {
        if t < *from_s {
            height
        } else {
            (from_m - speed * (t - from_s)).max(*to_m)
        }
    })
}

#[test]
fn shadow_while_a_pilot_lands() {
    let scenario = at_sea("0.5,5");
    let nodes = nodes(LandingMode::Shadow);
    let mut received = Received::default();
    let mut rig = Rig::observed(&scenario, &nodes, 71, &mut received).unwrap();
    rig.world.command(CommandKind::Land);
    let mut landed_for = 0;
    for _ in 0..(90.0 / TICK.secs()) as u32 {
        rig.tick(&mut received);
        let t = rig.t_s();
        let world = &mut rig.world;
        let over = world.physics().deck().position.0 - Vector3::z() * by_hand(t);
        let apart = over - world.physics().drone(0).unwrap().position.0;
        let on_deck = world.observation().feet_height_m() < 0.05;
        let autopilot = &mut world.linked(0).unwrap().autopilot;
        autopilot.hold_at(autopilot.position() + apart);
        // The pilot disarms on the deck.
        landed_for = if on_deck { landed_for + 1 } else { 0 };
        if landed_for > 30 {
            autopilot.arm(false);
        }
    }
    let linked = rig.world.linked(0).unwrap();
    assert!(!linked.autopilot.armed(), "never landed");
    assert_eq!(linked.commanded, 0);
    let visited = rig.visited(0);
    // The mission passes through all states and ends when the pilot disarms.
    for state in [
        State::GetAltitude,
        State::Approach,
        State::TrackingStable,
        State::Descent,
    ] {
        assert!(visited.contains(&state), "{visited:?}");
    }
    assert_eq!(visited.last(), Some(&State::Idle), "{visited:?}");
    let compared: Vec<_> = received.0.iter().filter_map(|a| a.shadow).collect();
    assert!(compared.len() > 300, "{}", compared.len());
    assert!(compared.iter().all(|s| !s.stops));
    // Compares the attitudes while both hover above the deck.
    let mut apart: Vec<f64> = compared.iter().map(|s| s.apart_rad.to_degrees()).collect();
    apart.sort_by(f64::total_cmp);
    let [median, most] = [apart.len() / 2, apart.len() * 9 / 10].map(|k| apart[k]);
    println!("apart by {median:.1} deg in the median, 9 of 10 below {most:.1} deg");
    assert!((0.01..10.0).contains(&median), "{median} deg");
}

#[test]
fn match_over_the_deck() {
    let scenario = at_sea("0.5,5");
    let nodes = nodes(LandingMode::Match);
    let c = &nodes.drone.mission;
    let mut flown = Vec::new();
    for seed in 81..83 {
        let mut rig = Rig::landing(&scenario, &nodes, seed).unwrap();
        let mut lowest_m = f64::INFINITY;
        let mut near_s = 0.0;
        let mut matched_at = None;
        let mut climbed_m = 0.0_f64;
        rig.each(180.0, |rig| {
            let t = rig.t_s();
            let o = rig.world.observation();
            let m = rig.mission(0);
            assert!(o.contacts.is_empty(), "seed {seed}: a contact");
            let height_m = o.feet.iter().map(|f| f[2]).fold(f64::INFINITY, f64::min);
            lowest_m = lowest_m.min(height_m);
            near_s += if height_m < c.lowest_clearance_m + 1.5 {
                TICK.secs()
            } else {
                0.0
            };
            if m.state == State::GaveUp {
                assert_eq!(m.entered.code, ReasonCode::Matched, "seed {seed}: {}", m.entered);
                matched_at.get_or_insert(t);
                climbed_m = climbed_m.max(height_m);
            }
            matched_at.is_some_and(|at| t > at + 12.0)
        });
        flown.push(format!(
            "seed {seed}: lowest {lowest_m:.2} m, near for {near_s:.1} s, matched at {matched_at:?} s, \
             then up to {climbed_m:.1} m"
        ));
        let sound = lowest_m >= c.lowest_clearance_m && near_s >= c.match_s && climbed_m > 10.0;
        assert!(sound && matched_at.is_some(), "{}", flown.join("\n"));
    }
    println!("{}", flown.join("\n"));
}

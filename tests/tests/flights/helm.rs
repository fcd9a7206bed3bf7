//! A boat that helps, in the whole world: from the question to the skipper to the course given back.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::{CommandKind, DeckOrder, HelmAnswer, HelmEnd, HelmState, ReasonCode};
use alight_sim::autopilots::boat::{AUTO, GUIDED, MANUAL};
use alight_sim::harness::outcome::{Judge, Outcome};
use alight_sim::harness::physics::TICK;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::physics::vessel::VesselCourse;
use alight_usv::helm::HelmOutput;

/// A vessel under way at 5 m/s in a sea of 1 m and 5 s, with a plain deck, by the response table of a hull; it can be
/// steered by its autopilot.
fn scene() -> (Scenario, NodeConfigs) {
    let (mut scenario, mut nodes) = (Scenario::default(), NodeConfigs::default());
    scenario.sea = "jonswap:1,5".parse().unwrap();
    scenario.vessel.course = VesselCourse::Straight;
    scenario.vessel.speed_mps = 5.0;
    scenario.vessel.power_for(5.0);
    scenario.install_hull(&mut nodes, "mono-5m").unwrap();
    nodes.drone.mission.reservation_required = true;
    nodes.vessel.helm.output = HelmOutput::Mavlink;
    nodes.vessel.helm.connect = "udpin://127.0.0.1:14560".into();
    (scenario, nodes)
}

/// Headings of a vessel under way, deg: waves run to 0.
const HEADINGS_DEG: [f64; 5] = [90.0, 60.0, 120.0, 30.0, 150.0];

/// A hull on the first of these headings from which a better course is advised, and the skipper asked; with that heading, deg.
fn asked(seed: u64) -> (Rig, f64) {
    let (mut scenario, nodes) = scene();
    scenario.sea = "jonswap:1.5,5".parse().unwrap();
    scenario.sea.mean_direction_deg = Some(0.0);
    for heading_deg in HEADINGS_DEG {
        scenario.vessel.heading_deg = Some(heading_deg);
        let mut rig = Rig::landing(&scenario, &nodes, seed).unwrap();
        if until(&mut rig, 30.0, HelmState::Asked) {
            return (rig, heading_deg);
        }
    }
    panic!("no course is advised on {HEADINGS_DEG:?} deg")
}
fn helm(rig: &Rig) -> HelmState {
    rig.world.helm().state
}
fn until(rig: &mut Rig, limit_s: f64, state: HelmState) -> bool {
    rig.until(limit_s, |rig| helm(rig) == state)
}
/// Heading of the vessel, deg, and its speed over ground, m/s.
fn course(rig: &Rig) -> [f64; 2] {
    let vessel = rig.world.physics().vessel();
    let (_, _, yaw) = vessel.attitude.euler();
    [yaw.to_degrees(), vessel.velocity.0.xy().norm()]
}
fn off_deg(a: f64, b: f64) -> f64 {
    wrap_angle((a - b).to_radians()).to_degrees().abs()
}
/// The skipper agrees to what he is asked.
fn agree(rig: &mut Rig) {
    let asked = rig.world.helm().asked();
    let yes = asked.map(|course| DeckOrder::Helm(HelmAnswer::Yes(course)));
    yes.into_iter().for_each(|yes| rig.world.deck_order(yes));
}
/// Asked, and agreed by the skipper, in which the drone had no part yet.
fn agreed(seed: u64) -> (Rig, f64) {
    let (mut rig, heading_deg) = asked(seed);
    agree(&mut rig);
    assert!(until(&mut rig, 1.0, HelmState::Agreed));
    (rig, heading_deg)
}

#[test]
fn boat_that_turns_for_a_landing_and_back() {
    let (mut rig, before) = agreed(31);
    assert!(until(&mut rig, 70.0, HelmState::Steady), "{:?}", rig.world.helm());
    assert_eq!(rig.world.boat().mode, GUIDED);
    let steered = rig.world.helm();
    let [heading, _] = course(&rig);
    assert!(
        off_deg(heading, steered.heading_deg()) < 20.0 && off_deg(heading, before) < 80.0,
        "{before} {heading} {steered}"
    );
    rig.run(5.0);
    assert_eq!(helm(&rig), HelmState::Steady);
    // The landing is over once the drone has left.
    rig.world.command(CommandKind::Abort);
    assert!(until(&mut rig, 90.0, HelmState::Done), "{:?}", rig.state(0));
    assert!(until(&mut rig, 90.0, HelmState::Idle));
    rig.run(5.0);
    let [heading, speed] = course(&rig);
    assert!(
        off_deg(heading, before) < 20.0 && (speed - 5.0).abs() < 1.5,
        "{heading} {speed}"
    );
    assert_eq!(rig.world.boat().mode, AUTO);
}

#[test]
fn refused_helm() {
    let (mut rig, heading_deg) = asked(32);
    rig.world.deck_order(DeckOrder::Helm(HelmAnswer::No));
    assert!(until(&mut rig, 1.0, HelmState::Withdrawn));
    assert_eq!(rig.world.helm().why, HelmEnd::Refused);
    // For a minute nothing is commanded, and the drone waits for no course: as on a boat that is not steered.
    assert!(!rig.until(60.0, |rig| rig.mission(0).waiting.code == ReasonCode::HelmTurns));
    assert_eq!(rig.world.boat().mode, AUTO);
    assert!(off_deg(course(&rig)[0], heading_deg) < 20.0);
}

#[test]
fn hand_on_the_helm() {
    // With and without the mode switch.
    for (with_switch, why, mode) in [
        (true, HelmEnd::ModeChanged, MANUAL),
        (false, HelmEnd::HandOnHelm, AUTO),
    ] {
        let (mut rig, _) = agreed(34);
        assert!(until(&mut rig, 70.0, HelmState::Steady));
        let [heading, _] = course(&rig);
        rig.world.boat().take(heading.to_radians(), 4.0, with_switch);
        assert!(
            until(&mut rig, 15.0, HelmState::Withdrawn),
            "{:?}",
            rig.world.helm()
        );
        assert_eq!(rig.world.helm().why, why);
        rig.run(3.0);
        assert_eq!(rig.world.boat().mode, mode);
    }
}

#[test]
fn lost_link_to_the_boats_autopilot() {
    let (mut rig, _) = agreed(35);
    rig.run(4.0);
    assert_eq!(rig.world.boat().mode, GUIDED);
    rig.world.boat().cut = true;
    assert!(until(&mut rig, 4.0, HelmState::Withdrawn));
    assert_eq!(rig.world.helm().why, HelmEnd::LinkLost);
    rig.run(3.0);
    rig.world.boat().cut = false;
    rig.run(3.0);
    assert_eq!(rig.world.boat().mode, AUTO, "given back once it is there again");
}

/// A landing whose skipper agrees three seconds after he is asked.
fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Outcome {
    let mut rig = Rig::landing(scenario, nodes, seed).unwrap();
    let half_deck = [scenario.deck.length_m / 2.0, scenario.deck.width_m / 2.0];
    let mut judge = Judge::default();
    let (mut asked, mut over) = (0.0, false);
    rig.each(650.0, |rig| {
        if helm(rig) == HelmState::Asked {
            asked += TICK.secs();
            if asked > 3.0 {
                agree(rig);
            }
        }
        over = judge.observe(&rig.world.observation(), half_deck);
        over
    });
    judge.outcome(seed, "jonswap:1,5", nodes.planner_name(), rig.t_s())
}

#[test]
fn plain_deck_at_5_mps_with_a_boat_that_helps() {
    let (scenario, nodes) = scene();
    let all = [7104, 7105].map(|seed| flown(&scenario, &nodes, seed));
    for o in &all {
        assert!(
            o.unsafe_contacts == 0 && o.water_contacts == 0,
            "{}: {}",
            o.seed,
            o.reason
        );
    }
    assert!(
        all.iter().any(|o| o.success),
        "{} {}",
        all[0].reason,
        all[1].reason
    );
}
